//! What the paper does not measure: builds, proofs, pictures, loading, decoding.

use std::path::Path;
use std::time::Instant;

use hlod_compress::{HlodFile, NodeRecord, RepresentationKind, decode_page};

use super::error::ReportError;
use super::markdown::{Section, fixed, whole};
use super::models::{Model, Stock};
use super::plots::{Curve, plot_curves};
use super::programs::{Line, number, text};
use super::turns::{ROUNDS, Turns, median};
use super::{Extent, Target};

/// Above this many triangles a share of nodes is verified, and no picture is compared with the scan.
const LARGE: f64 = 2e6;

/// Time and memory of builds, and whether what they prove is true.
pub(super) fn builds(
    models: &[Model],
    stock: &Stock<'_>,
    output: &Path,
    targets: &mut Vec<Target>,
    say: &mut dyn FnMut(&str),
) -> Result<Section, ReportError> {
    let mut section = Section::new(
        "Builds and certificates",
        "`hlod-build build`, once each: other work on the machine shows. `hlod-build verify F.hlod` samples all nodes \
         below 2 M triangles and 2 % of those above: stored errors against sampled ones (never below 1), and \
         independent bounds against stored errors.",
        &[
            "model",
            "triangles",
            "wall s",
            "thousand a CPU second",
            "memory, MB",
            "file, MB",
            "sampled",
            "over bound",
            "stored ÷ sampled, median / 95 %",
            "independent ÷ stored, max",
        ],
    );
    let mut rates = Vec::new();
    let (mut over, mut sampled) = (0.0, 0.0);
    for model in models {
        say(&format!("certificates: {}", model.name));
        let share = if model.triangles > LARGE { "--share 0.02" } else { "--share 1" };
        let line = Line::new("hlod-build").words("verify").with(&model.file).words(share);
        let verified = stock.programs.measured(&line)?;
        let of = |key: &str| number(&model.build, key);
        let rate = model.triangles / of("cpu_secs")? / 1e3;
        over += number(&verified, "nodes_over_bound")?;
        sampled += number(&verified, "representations_sampled")?;
        if model.is_statue {
            rates.push((model.triangles / 1e6, rate));
        }
        section.row(vec![
            model.name.clone(),
            whole(model.triangles),
            fixed(of("wall_secs")?, 1),
            fixed(rate, 1),
            fixed(of("peak_anonymous_bytes")? / 1e6, 0),
            fixed(of("bytes_total")? / 1e6, 2),
            whole(number(&verified, "representations_sampled")?),
            whole(number(&verified, "nodes_over_bound")?),
            format!(
                "{} / {}",
                fixed(number(&verified, "tightness_median")?, 2),
                fixed(number(&verified, "tightness_p95")?, 2)
            ),
            fixed(number(&verified, "independent_ratio_max")?, 2),
        ]);
    }
    let name = format!("errors that samples refute, of {}", whole(sampled));
    targets.push(Target::at_most(&name, over, Some(0.0)));
    if rates.len() > 1 {
        let curves = [Curve { name: "statues", points: rates }];
        let axes = ("million triangles", "thousand triangles a CPU second");
        plot_curves(&output.join("build-rate.svg"), "hlod-build build", axes, &curves)?;
        section.plots.push(("build-rate.svg".into(), "Build rate against size".into()));
    }
    Ok(section)
}

/// Pictures against the scan, pixel by pixel.
pub(super) fn pictures(
    models: &[Model],
    stock: &Stock<'_>,
    extent: &Extent,
    targets: &mut Vec<Target>,
    say: &mut dyn FnMut(&str),
) -> Result<Section, ReportError> {
    let mut section = Section::new(
        "Pictures against the scan",
        "`hlod-render audit F.hlod --against SCAN`, τ = 0.5 px, and with `--shadow hard`: pixels \
         of holes and overdraw, distances in pixels at which each pixel's shade, each silhouette and each edge of a \
         shadow is found in what rays see of every triangle (99.9 %; edges at up to 15° and 60° of incidence, and how \
         much of them was scored). `--seams`: pixels of holes, of overdraw and pushed out at τ of 0.5, 1 and 4 px, fronts as \
         asked for, mixed by chance and half loaded, 320×240. `--shadow soft --vary-light --light-size 0.05`: root of the \
         mean square by which visibility is off in penumbrae, of 1,024 rays, 320×240. Below 2 M triangles.",
        &[
            "model",
            "views",
            "holes",
            "overdraw",
            "appearance (floor)",
            "silhouette",
            "edge 15°",
            "edge 60°",
            "scored 60°",
            "seams: views",
            "holes · overdraw · out",
            "penumbra",
        ],
    );
    for model in models.iter().filter(|model| model.triangles < LARGE) {
        stock.make_scan(&model.scan, (&model.name, model.is_statue), say)?;
        let audit = |what: &str, options: &str, say: &mut dyn FnMut(&str)| {
            say(&format!("pictures: {}, {what}", model.name));
            let line = Line::new("hlod-render").words("audit").with(&model.file);
            stock.programs.measured(&line.words("--against").with(&model.scan).words(options))
        };
        let views = extent.views;
        let plain = audit("shades", &format!("--views {views} --shadow none"), say)?;
        // A quick report's pictures are small.
        let size = if extent.quick { " --size 320x240" } else { "" };
        let hard = format!("--views {views} --shadow hard{size}");
        let hard = audit("edges of shadows", &hard, say)?;
        let options = format!("--seams --size 320x240 --views {}", extent.seam_views);
        let seams = audit("seams", &options, say)?;
        let options = format!("--shadow soft --vary-light --light-size 0.05 --views {views}");
        let soft = audit("penumbrae", &format!("{options} --size 320x240"), say)?;
        let p999 = number(&plain, "appearance_distance_px.p999")?;
        let floor = number(&plain, "appearance_distance_px.floor_p999")?;
        let edge = number(&hard, "shadow_edge_px.deg15.p999");
        let holes = number(&plain, "hole_pixels")?;
        let most = (floor + 0.5).max(1.0);
        targets.push(Target::at_most(&format!("{}: holes, pixels", model.name), holes, Some(0.0)));
        let name = format!("{}: appearance distance, 99.9 %, px", model.name);
        targets.push(Target::at_most(&name, p999, Some(most)));
        let or_dash = |value: Result<f64, ReportError>| value.map_or("–".into(), |v| fixed(v, 2));
        section.row(vec![
            model.name.clone(),
            whole(number(&plain, "views")?),
            whole(holes),
            whole(number(&plain, "overdraw_pixels")?),
            format!("{} ({})", fixed(p999, 2), fixed(floor, 2)),
            fixed(number(&plain, "silhouette_distance_px.p999")?, 2),
            or_dash(edge),
            or_dash(number(&hard, "shadow_edge_px.deg60.p999")),
            or_dash(number(&hard, "shadow_edge_px.deg60.scored_share")),
            whole(number(&seams, "views")?),
            format!(
                "{} · {} · {}",
                whole(number(&seams, "hole_pixels")?),
                whole(number(&seams, "overdraw_pixels")?),
                whole(number(&seams, "pushed_out_pixels")?)
            ),
            number(&soft, "penumbra_rmse").map_or("–".into(), |rmse| fixed(rmse, 3)),
        ]);
    }
    Ok(section)
}

/// Ways to draw hard shadows: name, and options of `hlod-render`.
const WAYS: [(&str, &str); 7] = [
    ("ours", "--shadow hard"),
    ("plain map, 2048²", "--shadow map --map-projection plain --map-size 2048"),
    ("uniform map, 1024²", "--shadow map --map-projection uniform --map-size 1024"),
    ("uniform map, 2048²", "--shadow map --map-projection uniform --map-size 2048"),
    ("light-space map, 2048²", "--shadow map --map-projection light-space --map-size 2048"),
    ("perspective map, 2048²", "--shadow map --map-projection perspective --map-size 2048"),
    ("perspective map, 4096²", "--shadow map --map-projection perspective --map-size 4096"),
];

/// What shadows without maps gain.
pub(super) fn shadow_maps(
    models: &[Model],
    stock: &Stock<'_>,
    extent: &Extent,
    say: &mut dyn FnMut(&str),
) -> Result<Section, ReportError> {
    let mut section = Section::new(
        "Shadow maps",
        "Hard shadows with and without maps, of the same levels of detail, on statues below 2 M triangles. Maps but for the plain one are fitted to what \
         is visible. Time of the median frame along `orbit`, 640×480 (`hlod-render bench`), all in turns, five rounds; edges against \
         rays (`hlod-render audit`), τ = τ_c = 0.5 px: 99.9 % at up to 15° and 60° of incidence, \
         pixels dark or lit for no reason, and on how many a texel is longer than 0.35 px.",
        &["model", "way", "ms", "× none", "edge 15°", "edge 60°", "dark · lit", "texel too long"],
    );
    let most = if extent.quick { LARGE / 2.0 } else { LARGE };
    for model in models.iter().filter(|model| model.is_statue && model.triangles < most) {
        say(&format!("shadow maps: {}", model.name));
        let bench = |options: &str| {
            let line = Line::new("hlod-render").words("bench").with(&model.file).words("--path");
            let frames = extent.light_frames;
            line.words(&format!("bench-paths/orbit.json --frames {frames} {options}"))
        };
        let mut lines = vec![bench("--shadow none")];
        let ways = if extent.quick { &WAYS[..2] } else { &WAYS[..] };
        lines.extend(ways.iter().map(|(_, options)| bench(options)));
        let turns = Turns::take(stock.programs, &lines)?;
        stock.make_scan(&model.scan, (&model.name, model.is_statue), say)?;
        for (i, &(way, options)) in ways.iter().enumerate() {
            say(&format!("shadow maps: {}, {way}", model.name));
            let line = Line::new("hlod-render").words("audit").with(&model.file);
            let line = line.words("--against").with(&model.scan);
            let views = extent.views.min(2);
            let line = line.words(&format!("--views {views} {options}"));
            let audit = stock.programs.measured(&line)?;
            let of = |key: &str| number(&audit, &format!("shadow_edge_px.{key}"));
            let denied = of("maps.denied_share");
            let row = vec![
                model.name.clone(),
                way.to_owned(),
                fixed(turns.frames(i + 1).ms, 1),
                fixed(turns.ratio(0, i + 1), 2),
                fixed(of("deg15.p999")?, 2),
                fixed(of("deg60.p999")?, 2),
                format!("{} · {}", whole(of("acne_pixels")?), whole(of("leak_pixels")?)),
                denied.map_or("–".into(), |share| format!("{} %", fixed(100.0 * share, 1))),
            ];
            section.row(row);
        }
    }
    Ok(section)
}

/// Policies of reading ahead.
pub(super) fn policies(
    models: &[Model],
    stock: &Stock<'_>,
    extent: &Extent,
) -> Result<Section, ReportError> {
    let mut section = Section::new(
        "Reading ahead",
        "`hlod-render simulate F.hlod --path bench-paths/P.json` with the largest model: 50 MB/s, 1 ms, 128 MB kept, \
         30 frames a second. How many times coarser than asked frames were in the mean, frames coarser than \
         twice, frames that waited, MB read and MB that were drawn.",
        &["path", "policy", "frames", "times τ", "over 2 τ", "waited", "read", "drawn"],
    );
    let Some(model) = models.iter().max_by(|a, b| a.triangles.total_cmp(&b.triangles)) else {
        return Ok(section);
    };
    for path in extent.paths {
        let line = Line::new("hlod-render").words("simulate").with(&model.file);
        let line = line.words(&format!("--path bench-paths/{path}.json"));
        let printed = stock.programs.measured(&line)?;
        for policy in printed["policies"].as_array().map_or(&[][..], Vec::as_slice) {
            let of = |key: &str| number(policy, key);
            section.row(vec![
                (*path).to_owned(),
                text(policy, "policy")?.to_owned(),
                whole(of("frames")?),
                fixed(of("tau_ratio_mean")?, 2),
                whole(of("frames_over_2tau")?),
                whole(of("stalled_frames")?),
                fixed(of("bytes_read")? / 1e6, 1),
                fixed(of("bytes_drawn")? / 1e6, 1),
            ]);
        }
    }
    Ok(section)
}

/// How fast pages are decoded by one thread.
pub(super) fn decoding(models: &[Model]) -> Result<Section, ReportError> {
    let mut section = Section::new(
        "Decoding",
        "One thread, all pages of a kind (at most 64 MB), five rounds, medians: million triangles a second.",
        &["model", "leaves", "appearance above", "geometric above"],
    );
    for model in models {
        let mut row = vec![model.name.clone()];
        for kind in [
            RepresentationKind::Source,
            RepresentationKind::Appearance,
            RepresentationKind::Geometric,
        ] {
            row.push(fixed(decoding_rate(&model.file, kind)?, 1));
        }
        section.row(row);
    }
    Ok(section)
}

/// Million triangles a second; NaN where there are none.
fn decoding_rate(path: &Path, kind: RepresentationKind) -> Result<f64, ReportError> {
    let failed = |error| ReportError::unexpected(path.display(), error);
    let file = HlodFile::open(path).map_err(failed)?;
    let nodes = file.read_skeleton().map_err(failed)?;
    let is_of_kind = |node: &&NodeRecord| (kind == RepresentationKind::Source) == node.is_leaf();
    let (mut pages, mut bytes) = (Vec::new(), 0);
    for node in nodes.iter().filter(is_of_kind) {
        let Some(representation) = node.representation(kind) else { continue };
        let page = file.read_page(representation.page).map_err(failed)?;
        bytes += page.len();
        pages.push(page);
        if bytes > 64 << 20 {
            break;
        }
    }
    let mut rates = Vec::new();
    for _ in 0..ROUNDS {
        let begin = Instant::now();
        let mut triangles = 0;
        for page in &pages {
            triangles += decode_page(page).map_err(failed)?.mesh.triangles.len();
        }
        rates.push(triangles as f64 / begin.elapsed().as_secs_f64() / 1e6);
    }
    Ok(if pages.is_empty() { f64::NAN } else { median(rates) })
}
