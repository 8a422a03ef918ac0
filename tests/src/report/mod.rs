//! The tables of Guthe et al. 2004 with our numbers beside them, and what they do not measure: `cargo xtask report`.
//!
//! ```text
//! scans, sample statues
//!   │ models      built where they are not yet, with what the builds reported      models.rs
//!   │ tables 1–4, figure 7                                                         paper.rs
//!   │ builds, certificates, pictures, reading ahead, decoding                      beyond.rs
//!   ▼
//! RESULTS.md, its plots                                                            markdown.rs, plots.rs
//! ```
//!
//! Everything is measured by the programs as their users start them (programs.rs); whatever is stated as
//! a ratio comes of commands that took turns (turns.rs). `cargo xtask bench` keeps and compares a few such
//! ratios (ratios.rs).

mod beyond;
mod error;
mod kept;
mod markdown;
mod models;
mod paper;
pub mod pictures;
mod plots;
mod programs;
pub mod ratios;
mod turns;

use std::path::{Path, PathBuf};
use std::time::Instant;

pub use error::ReportError;
use markdown::{Section, fixed, whole};
use models::{Model, Stock};
pub use programs::Programs;
use programs::{Line, text};

/// What to measure, and where things are.
#[derive(Debug, Clone)]
pub struct ReportOptions {
    /// A subset that takes minutes.
    pub quick: bool,
    /// Go on with what an earlier run measured.
    pub resume: bool,
    /// The folder of scans; without one, sample statues alone.
    pub data: Option<PathBuf>,
    /// Where models are kept from run to run.
    pub folder: PathBuf,
    /// Sizes of sample statues, as `hlod-build synth` reads them, growing; as `quick` says if empty.
    pub statues: Vec<String>,
    /// Where RESULTS.md and its plots go.
    pub output: PathBuf,
}

impl ReportOptions {
    /// What was asked for, so that it can be asked for again.
    fn command(&self) -> String {
        let quick = if self.quick { " --quick" } else { "" };
        let statues = self.statues.iter().map(|size| format!(" --statue {size}"));
        format!("cargo xtask report{quick}{}", statues.collect::<String>())
    }
}

/// How much of everything.
pub(crate) struct Extent {
    quick: bool,
    /// Sizes of pictures, and how many frames along each path.
    sizes: &'static [(&'static str, u32)],
    paths: &'static [&'static str],
    light_frames: u32,
    views: u32,
    seam_views: u32,
}

const FULL: Extent = Extent {
    quick: false,
    sizes: &[("640x480", 12), ("1920x1080", 4)],
    paths: &["orbit", "approach", "sweep"],
    light_frames: 8,
    views: 3,
    seam_views: 20,
};

const QUICK: Extent = Extent {
    quick: true,
    sizes: &[("640x480", 12)],
    paths: &["orbit"],
    light_frames: 16,
    views: 1,
    seam_views: 12,
};

/// A number that is asked for somewhere.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Target {
    name: String,
    value: f64,
    least: Option<f64>,
    most: Option<f64>,
}

impl Target {
    fn at_least(name: &str, value: f64, least: Option<f64>) -> Target {
        Target { name: name.to_owned(), value, least, most: None }
    }

    fn at_most(name: &str, value: f64, most: Option<f64>) -> Target {
        Target { name: name.to_owned(), value, least: None, most }
    }

    /// `None` where nothing is asked for.
    fn is_met(&self) -> Option<bool> {
        match (self.least, self.most) {
            (None, None) => None,
            (least, most) => Some(
                least.is_none_or(|least| self.value >= least)
                    && most.is_none_or(|most| self.value <= most),
            ),
        }
    }
}

/// Measures everything and writes `RESULTS.md` with its plots. `say` is told what is being done.
///
/// # Errors
/// When a program fails, prints something unexpected, or a file cannot be written.
pub fn report(
    programs: &Programs,
    options: &ReportOptions,
    say: &mut dyn FnMut(&str),
) -> Result<PathBuf, ReportError> {
    let begin = Instant::now();
    let extent = if options.quick { QUICK } else { FULL };
    // What is stopped early does not take the place of a whole report.
    let draft = options.folder.join("draft");
    if draft.exists() {
        std::fs::remove_dir_all(&draft).map_err(ReportError::io(&draft, "remove"))?;
    }
    for folder in [&options.folder, &draft, &options.output] {
        std::fs::create_dir_all(folder).map_err(ReportError::io(folder, "create"))?;
    }
    let programs = &programs.keeping(options.folder.join("measured"), options.resume)?;
    let stock = Stock { programs, folder: &options.folder, data: options.data.as_deref() };
    let models = models_of(&stock, options, say)?;
    let machine = machine(programs, &models)?;
    let path = draft.join("RESULTS.md");
    let (mut targets, mut sections) = (Vec::new(), Vec::new());
    for part in 0..PARTS {
        sections.push(match part {
            0 => paper::sizes(&models)?,
            1 => paper::nodes(&models, &stock, &extent, say)?,
            2 => paper::growth(&models, &stock, &extent, &mut targets)?,
            3 => paper::frames(&models, &stock, &extent, &mut targets, say)?,
            4 => paper::lights(&models, &stock, &extent, &draft, &mut targets, say)?,
            5 => paper::stages(&models, &stock, &extent, say)?,
            6 => beyond::decoding(&models)?,
            7 => beyond::builds(&models, &stock, &draft, &mut targets, say)?,
            8 => beyond::policies(&models, &stock, &extent)?,
            9 => beyond::pictures(&models, &stock, &extent, &mut targets, say)?,
            _ => beyond::shadow_maps(&models, &stock, &extent, say)?,
        });
        // What was measured stays, whatever comes after it.
        let mut all = vec![judged(&targets)];
        all.extend(sections.iter().cloned());
        let made = made(&options.command(), begin.elapsed().as_secs_f64() / 60.0, programs.kept());
        let text = document(&made, &machine, &all);
        hlod_build::write_whole(&path, text.as_bytes())
            .map_err(|error| ReportError::unexpected(path.display(), error))?;
    }
    models.iter().try_for_each(|model| stock.forget_scan(model))?;
    for entry in std::fs::read_dir(&draft).map_err(ReportError::io(&draft, "read"))? {
        let entry = entry.map_err(ReportError::io(&draft, "read"))?;
        let to = options.output.join(entry.file_name());
        std::fs::copy(entry.path(), &to).map_err(ReportError::io(&to, "write"))?;
    }
    Ok(options.output.join("RESULTS.md"))
}

/// Parts of the report.
const PARTS: usize = 11;

fn models_of(
    stock: &Stock<'_>,
    options: &ReportOptions,
    say: &mut dyn FnMut(&str),
) -> Result<Vec<Model>, ReportError> {
    let (scans, usual): (&[&str], &[&str]) = match options.quick {
        true => (&["Bunny", "Happy Buddha"], &["900K", "4M"]),
        false => {
            let scans = &["Bunny", "Igea", "Dragon, 2nd level", "Happy Buddha"];
            (scans, &["900K", "8M", "28M", "56M"])
        }
    };
    let usual = usual.iter().map(|size| (*size).to_owned()).collect();
    let statues = if options.statues.is_empty() { usual } else { options.statues.clone() };
    stock.models(scans, &statues, say)
}

/// What was asked for, and what came of it.
fn judged(targets: &[Target]) -> Section {
    let mut section = Section::new(
        "What was asked for",
        "Why numbers are missed is said in [NOTES.md](NOTES.md).",
        &["", "measured", "asked", ""],
    );
    for target in targets {
        let asked = match (target.least, target.most) {
            (Some(least), _) => format!("≥ {least}"),
            (_, Some(most)) => format!("≤ {most}"),
            _ => "–".to_owned(),
        };
        let met = match target.is_met() {
            Some(true) => "met",
            Some(false) => "**missed**",
            None => "",
        };
        section.row(vec![target.name.clone(), fixed(target.value, 2), asked, met.to_owned()]);
    }
    section
}

/// The machine and the versions, a line each.
fn machine(programs: &Programs, models: &[Model]) -> Result<Vec<String>, ReportError> {
    let mut lines = Vec::new();
    if let Some(model) = models.first() {
        let line = Line::new("hlod-render").words("bench").with(&model.file);
        let line = line.words("--path bench-paths/orbit.json --frames 2");
        let printed = programs.json(&line)?;
        lines.push(format!("adapter: {}", text(&printed, "adapter")?));
        lines.push(format!("system: {}", text(&printed, "machine")?));
        lines.push(format!("version: {}", text(&printed, "version")?));
    }
    let information = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = information.lines().find_map(|line| line.strip_prefix("model name"));
    lines.extend(
        name.map(|name| format!("processor: {}", name.trim_start_matches([' ', '\t', ':']))),
    );
    Ok(lines)
}

/// By what, in what time, and how much of it an earlier run measured.
fn made(command: &str, minutes: f64, (found, all): (usize, usize)) -> String {
    let kept = match found {
        0 => String::new(),
        _ => format!(
            "; {} of {} outputs of programs are of a run before it, which was ended early",
            whole(found as f64),
            whole(all as f64)
        ),
    };
    format!("Written by `{command}` in {} minutes{kept}.", whole(minutes))
}

fn document(made: &str, machine: &[String], sections: &[Section]) -> String {
    let mut out = format!(
        "# Results\n\n{made} Ratios come of commands that took turns; absolute times hold for this machine \
         alone:\n\n"
    );
    machine.iter().for_each(|line| out += &format!("- {line}\n"));
    let parts = sections.len() - 1;
    if parts < PARTS {
        out += &format!("\n**Stopped after {parts} of {PARTS} parts.**\n");
    }
    out += "\nWhat was measured by hand besides, and why what is missed is missed: [NOTES.md](NOTES.md).\n\n";
    sections.iter().for_each(|section| out += &section.markdown());
    format!("{}\n", out.trim_end())
}

/// Makes what is below `folder` what it is from the workspace's root, where programs run.
pub fn enter_workspace() -> std::io::Result<()> {
    std::env::set_current_dir(Path::new(&crate::workspace()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_met_missed_or_none() {
        assert_eq!(Target::at_least("", 0.7, Some(0.7)).is_met(), Some(true));
        assert_eq!(Target::at_least("", 0.69, Some(0.7)).is_met(), Some(false));
        assert_eq!(Target::at_most("", f64::NAN, Some(1.0)).is_met(), Some(false));
        assert_eq!(Target::at_most("", 3.0, None).is_met(), None);
        let section = judged(&[Target::at_most("a", 2.0, Some(1.5))]);
        assert_eq!(section.rows, [["a", "2.00", "≤ 1.5", "**missed**"]]);
    }

    #[test]
    fn a_report_says_what_an_earlier_run_measured() {
        assert_eq!(made("c", 2.2, (0, 7)), "Written by `c` in 2 minutes.");
        assert!(made("c", 2.2, (3, 7)).contains("; 3 of 7 outputs"));
    }
}
