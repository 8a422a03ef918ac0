//! The README's first screen: pictures of a sample statue, with what they cost beside them.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::error::ReportError;
use super::markdown::{fixed, whole};
use super::models::{Model, Stock};
use super::programs::{Line, Programs, number};

/// The statue that is shown.
const STATUE: &str = "4M";
/// What the README has around what is written here.
const BEGIN: &str = "<!-- ./x pictures writes what follows -->\n";
const END: &str = "<!-- up to here -->";

const FOV_Y_DEG: f64 = 35.0;
const TAU_PX: f64 = 0.5;

/// A still view: eye and target in statue heights from the middle, along right, up and front.
struct View {
    name: &'static str,
    eye: [f64; 3],
    target: [f64; 3],
}

/// From the whole figure to one chisel mark.
const STRIP: [View; 5] = [
    View { name: "whole", eye: [0.5, 0.1, 2.0], target: [0.0, 0.0, 0.0] },
    View { name: "bust", eye: [0.3, 0.22, 1.15], target: [0.0, 0.1, 0.0] },
    View { name: "plinth", eye: [0.1, -0.3, 0.8], target: [0.0, -0.38, 0.2] },
    View { name: "word", eye: [-0.04, -0.33, 0.46], target: [-0.02, -0.36, 0.2] },
    View { name: "mark", eye: [-0.06, -0.345, 0.29], target: [-0.05, -0.36, 0.2] },
];

/// The inscription by raking light.
const INSCRIPTION: View =
    View { name: "inscription", eye: [-0.075, -0.33, 0.43], target: [-0.065, -0.345, 0.2] };
const RAKING: &str = "--light=-70,14";
const PLAIN_MAP: &str = "--map-projection plain --map-size 2048";

/// Makes all pictures in `pictures` and replaces the README's part between its marks.
///
/// # Errors
/// When a program fails, or the README has no such marks.
pub fn pictures(
    programs: &Programs,
    folder: &Path,
    data: Option<&Path>,
    readme: &Path,
    say: &mut dyn FnMut(&str),
) -> Result<(), ReportError> {
    std::fs::create_dir_all(folder).map_err(ReportError::io(folder, "create"))?;
    let text = std::fs::read_to_string(readme).map_err(ReportError::io(readme, "read"))?;
    // Before minutes of work.
    replaced(&text, "").ok_or_else(|| ReportError::unexpected(readme.display(), "has no marks"))?;
    let stock = Stock { programs, folder, data };
    let models = stock.models(&[], &[STATUE.to_owned()], say)?;
    let model = &models[0];
    stock.make_scan(&model.scan, (&model.name, true), say)?;
    let shown = Shown { stock, model, pictures: PathBuf::from("tests/pictures") };
    let mut part = shown.strip(say)?;
    part += &shown.costs(say)?;
    part += &shown.shadows(say)?;
    part += &shown.plate(say)?;
    let text = replaced(&text, &part)
        .ok_or_else(|| ReportError::unexpected(readme.display(), "has no marks"))?;
    hlod_build::write_whole(readme, text.as_bytes())
        .map_err(|error| ReportError::unexpected(readme.display(), error))
}

/// The text with another part between its marks.
fn replaced(text: &str, part: &str) -> Option<String> {
    let (before, rest) = text.split_once(BEGIN)?;
    let (_, after) = rest.split_once(END)?;
    Some(format!("{before}{BEGIN}\n{part}{END}{after}"))
}

struct Shown<'a> {
    stock: Stock<'a>,
    model: &'a Model,
    pictures: PathBuf,
}

impl View {
    fn camera(&self) -> String {
        let point = |p: [f64; 3]| p.map(|x| x.to_string()).join(",");
        format!("--camera={}:{}", point(self.eye), point(self.target))
    }

    fn distance(&self) -> f64 {
        glam::DVec3::from(self.eye).distance(self.target.into())
    }

    /// A path that stays here.
    fn path(&self, folder: &Path) -> Result<PathBuf, ReportError> {
        let key = |at: f64| json!({ "at_secs": at, "eye": self.eye, "target": self.target });
        let path = json!({
            "version": 1, "name": self.name, "purpose": "a still view", "duration_secs": 1.0,
            "peak_speed_heights_per_sec": 0.0, "fov_y_deg": FOV_Y_DEG, "keys": [key(0.0), key(1.0)]
        });
        let file = folder.join(format!("still-{}.json", self.name));
        std::fs::write(&file, path.to_string()).map_err(ReportError::io(&file, "write"))?;
        Ok(file)
    }
}

impl Shown<'_> {
    fn shot(&self, view: &View, file: &str, more: &str) -> Result<(), ReportError> {
        let line = Line::new("hlod-render").words("shot").with(&self.model.file).words("-o");
        let line = line.with(self.pictures.join(file)).with(view.camera());
        self.stock.programs.json(&line.words(more)).map(drop)
    }

    fn bench(&self, view: &View, more: &str) -> Result<serde_json::Value, ReportError> {
        let line = Line::new("hlod-render").words("bench").with(&self.model.file).words("--path");
        let line = line.with(view.path(self.stock.folder)?).words("--frames 12").words(more);
        self.stock.programs.json(&line)
    }

    fn strip(&self, say: &mut dyn FnMut(&str)) -> Result<String, ReportError> {
        let (mut pictures, mut costs) = (Vec::new(), Vec::new());
        let low = self.model.info["bounds_min"][1].as_f64().unwrap_or(0.0);
        let high = self.model.info["bounds_max"][1].as_f64().unwrap_or(0.0);
        for view in &STRIP {
            say(&format!("picture: {}", view.name));
            let file = format!("strip-{}.png", view.name);
            self.shot(view, &file, "--size 240x320 --supersampling 3 --light=-60,30")?;
            let cost = self.bench(view, "--size 640x480")?;
            // What τ allows where the camera looks.
            let height_mm =
                2.0 * view.distance() * (high - low) * (FOV_Y_DEG / 2.0).to_radians().tan();
            pictures.push(format!("![{}](tests/pictures/{file})", view.name));
            costs.push(format!(
                "{} ms · {} MB · {} K drawn · within {} mm",
                fixed(number(&cost, "frame_ms.p50")?, 0),
                fixed(number(&cost, "resident_bytes_max")? / 1e6, 0),
                fixed(number(&cost, "primitives_mean")? / 1e3, 0),
                fixed(TAU_PX * height_mm / 480.0, 3),
            ));
        }
        let adapter = self.bench(&STRIP[0], "")?["adapter"].as_str().unwrap_or("").to_owned();
        Ok(format!(
            "*From the whole figure to one chisel mark*, a sample statue of {} triangles: time and memory of a frame \
             of 640×480 at τ = 0.5 px by {adapter}, and how far from the scan a drawn surface may be where the \
             camera looks.\n\n|{}\n|{}|\n| {} |\n| {} |\n\n",
            whole(self.model.triangles),
            " |".repeat(STRIP.len()),
            vec!["---"; STRIP.len()].join("|"),
            pictures.join(" | "),
            costs.join(" | "),
        ))
    }

    fn costs(&self, say: &mut dyn FnMut(&str)) -> Result<String, ReportError> {
        say("certificates");
        let line = Line::new("hlod-build").words("verify").with(&self.model.file);
        let verified = self.stock.programs.json(&line.words("--share 0.1"))?;
        let of = |key: &str| number(&self.model.build, key);
        let rate = self.model.triangles / of("cpu_secs")? / 1e3;
        Ok(format!(
            "| | this | others, on a machine of this kind |\n|---|---|---|\n\
             | build | {} s, {} K triangles a CPU second, every error proven | Nexus 2025.05: 29 to 33 K; \
             clusterlod of meshoptimizer (August 2026), in memory: 200 to 270 K |\n\
             | memory at most | {} MB; as little as `--memory` allows | 1,244 MB and 1,484 MB, of 16 M triangles |\n\
             | file | {} bytes a triangle, two hierarchies | 3.43 (16 M) and 8.6 to 10.8, one |\n\
             | stated error ÷ sampled error | {} (median), {} (95 %), never below 1 | meshoptimizer's estimate: \
             0.04 to 0.4 |\n\n",
            fixed(of("wall_secs")?, 0),
            fixed(rate, 0),
            fixed(of("peak_anonymous_bytes")? / 1e6, 0),
            fixed(of("bytes_total")? / self.model.triangles, 2),
            fixed(number(&verified, "tightness_median")?, 2),
            fixed(number(&verified, "tightness_p95")?, 2),
        ))
    }

    fn shadows(&self, say: &mut dyn FnMut(&str)) -> Result<String, ReportError> {
        let kinds = ["none", "map", "hard", "traced", "soft"];
        for kind in kinds {
            say(&format!("picture: shadows {kind}"));
            let more = match kind {
                "soft" => "--light-size 2",
                "map" => PLAIN_MAP,
                _ => "",
            };
            self.shot(
                &INSCRIPTION,
                &format!("shadow-{kind}.png"),
                &format!(
                    "--size 240x240 --tau 0.25 --supersampling 2 {RAKING} --shadow {kind} {more}"
                ),
            )?;
        }
        let edge = |options: &str, say: &mut dyn FnMut(&str)| {
            say(&format!("edges of shadows, {options}"));
            let line = Line::new("hlod-render").words("audit").with(&self.model.file);
            let line = line.words("--against").with(&self.model.scan).words("--path");
            let line =
                line.with(INSCRIPTION.path(self.stock.folder)?).words("--views 1 --shadow-exact");
            let audit = self.stock.programs.json(&line.words(options).with(RAKING))?;
            number(&audit, "shadow_edge_px.deg60.p999")
        };
        let ours = edge("--shadow hard", say)?;
        let map = edge(&format!("--shadow map {PLAIN_MAP}"), say)?;
        let pictures =
            kinds.map(|kind| format!("![{kind}](tests/pictures/shadow-{kind}.png)")).join(" | ");
        Ok(format!(
            "*A shadow you may publish*, the inscription by raking light. 99.9 % of the shadows' edges are so far from \
             those that rays find, where light falls in at up to 60°, in a picture of 640×480 with `--shadow-exact`; \
             the map has 2048 × 2048 texels for the whole statue.\n\n| {pictures} |\n\
             |---|---|---|---|---|\n| none | plain shadow map: {} px | ours: {} px | rays against all {} triangles | \
             ours, of a light that is 2° wide |\n\n",
            fixed(map, 2),
            fixed(ours, 2),
            whole(self.model.triangles)
        ))
    }

    fn plate(&self, say: &mut dyn FnMut(&str)) -> Result<String, ReportError> {
        say("picture: plate");
        let line = Line::new("hlod-render").words("plate").with(&self.model.file);
        let line = line.words("-o").with(self.pictures.join("plate.png"));
        self.stock.programs.run(&line.words("--scale 1:10 --dpi 60 --section x=0 --quiet"))?;
        Ok("*A figure anyone can remake*, by `hlod-render plate statue.hlod -o plate.png --scale 1:10 --dpi 60 --section x=0`:\n\n\
            ![a plate: five views and a section at one scale](tests/pictures/plate.png)\n\n"
            .to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_part_between_the_marks_is_replaced() {
        let text = format!("a\n{BEGIN}old\n{END}\nb\n");
        let new = replaced(&text, "new\n").unwrap();
        assert_eq!(new, format!("a\n{BEGIN}\nnew\n{END}\nb\n"));
        assert_eq!(replaced(&new, "new\n").unwrap(), new);
        assert_eq!(replaced("no marks", "new"), None);
    }
}
