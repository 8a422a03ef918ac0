//! The program: raw flags → validated options → library calls → tables or JSON.

pub mod args;
mod progress_bar;
mod progress_lines;
mod tables;

use std::io::Write;
use std::path::Path;

use hlod_build::progress::{Progress, Unit};
use hlod_build::synth::{StatueOptions, describe, write_statue};
use hlod_build::{
    MetadataReport, VerifyOptions, build, compare, export, info, list_steps, prepare,
    read_metadata, run_step, verify, write_whole,
};
use hlod_compress::{METADATA_EXAMPLE, METADATA_SCHEMA};
use outcome::Outcome;
use serde::Serialize;

use args::{
    BuildArgs, Cli, Command, ExportArgs, JsonArgs, MetaArgs, StepArgs, SynthArgs, VerifyArgs,
};
use progress_bar::Bars;

pub use outcome::Failure;

/// Exit codes and messages, decided in one place.
mod outcome {
    use std::fmt::Display;

    /// Why a command did not succeed.
    #[derive(Debug)]
    pub enum Failure {
        /// The work failed: exit status 1.
        Work(String),
        /// The command line was wrong: exit status 2.
        Usage(String),
        /// Something was checked and refuted: exit status 3; it has been printed.
        Refuted,
    }

    pub type Outcome = Result<(), Failure>;

    impl From<hlod_build::BuildError> for Failure {
        fn from(error: hlod_build::BuildError) -> Failure {
            Failure::of(error.is_usage(), &error)
        }
    }

    impl From<hlod_build::synth::SynthError> for Failure {
        fn from(error: hlod_build::synth::SynthError) -> Failure {
            use hlod_build::synth::SynthError::{Exists, Triangles};
            Failure::of(matches!(error, Exists(_) | Triangles(_)), &error)
        }
    }

    impl Failure {
        fn of(is_usage: bool, error: &dyn Display) -> Failure {
            if is_usage {
                Failure::Usage(error.to_string())
            } else {
                Failure::Work(error.to_string())
            }
        }
    }
}

pub fn run(cli: &Cli) -> Outcome {
    let progress = Bars::new(cli.quiet, cli.progress);
    match &cli.command {
        Command::Build(args) => run_build(args, &progress, cli.quiet),
        Command::Info(args) => {
            let info = info(&args.file)?;
            print(&args.json, &info, || tables::info(&info))
        }
        Command::Step(args) => run_steps(args, &progress),
        Command::Verify(args) => run_verify(args, &progress),
        Command::Export(args) => run_export(args),
        Command::Compare(args) => {
            let report = compare(&args.reference, &args.mesh, args.samples, &progress)?;
            print(&args.json, &report, || tables::compare(&report))
        }
        Command::Synth(args) => run_synth(args, &progress),
        Command::Meta(args) => run_meta(args),
    }
}

fn run_build(args: &BuildArgs, progress: &Bars, quiet: bool) -> Outcome {
    let mut options = args.options().map_err(Failure::Usage)?;
    options.metadata = args.meta.as_deref().map(read_metadata).transpose()?;
    if let (Some(metadata), Some(path), false) = (&options.metadata, &args.meta, quiet) {
        for key in metadata.unknown_keys() {
            let _ = writeln!(
                std::io::stderr(),
                "{}: {key} is kept; nothing is known of it",
                path.display()
            );
        }
    }
    start_work(args.threads, progress)?;
    if args.prepare {
        let folder = prepare(&args.input, &args.output, &options, progress)?;
        let steps = list_steps(&folder)?;
        return print(&args.json, &steps, || tables::prepared(&steps, &folder));
    }
    let report = build(&args.input, &args.output, &options, progress)?;
    if let Some(path) = &args.report {
        write_json(path, &report)?;
    }
    if !quiet {
        for input in &report.inputs {
            for remark in tables::input_remarks(input) {
                let _ = writeln!(std::io::stderr(), "{}: {remark}", input.path.display());
            }
        }
    }
    print(&args.json, &report, || tables::build(&report))
}

fn start_work(threads: Option<u16>, progress: &Bars) -> Outcome {
    if let Some(threads) = threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
        pool.build_global().map_err(|e| Failure::Work(format!("cannot start threads: {e}")))?;
    }
    progress
        .stop_on_interrupt()
        .map_err(|e| Failure::Work(format!("cannot listen for Ctrl-C: {e}")))
}

fn run_steps(args: &StepArgs, progress: &Bars) -> Outcome {
    if args.name.is_empty() {
        let steps = list_steps(&args.work_dir)?;
        return print(&args.json, &steps, || tables::steps(&steps));
    }
    start_work(args.threads, progress)?;
    for name in &args.name {
        run_step(&args.work_dir, name, args.memory, progress)?;
    }
    let mut done = list_steps(&args.work_dir)?;
    done.retain(|step| args.name.contains(&step.name));
    print(&args.json, &done, || tables::steps(&done))
}

fn run_verify(args: &VerifyArgs, progress: &Bars) -> Outcome {
    let options = VerifyOptions {
        against: args.against.clone(),
        transforms: args::transforms(&args.transform).map_err(Failure::Usage)?,
        share: args.share,
        memory_bytes: args.memory,
        ..VerifyOptions::default()
    };
    let report = verify(&args.file, &options, progress)?;
    print(&args.json, &report, || tables::verify(&report))?;
    if report.is_refuted() { Err(Failure::Refuted) } else { Ok(()) }
}

fn run_export(args: &ExportArgs) -> Outcome {
    let report = export(&args.file, &args.output, args.selection(), args.kind(), args.force)?;
    print(&args.json, &report, || tables::export(&report, &args.output))
}

fn run_synth(args: &SynthArgs, progress: &Bars) -> Outcome {
    let options = StatueOptions { triangles: args.triangles, seed: args.seed };
    let Some(output) = &args.output else {
        return print_line(&to_json(&describe(&options))?);
    };
    progress.begin("synth", options.triangles, Unit::Triangles);
    let mut reported = 0;
    let report = write_statue(&options, output, args.force, &mut |done, _total| {
        progress.advance(done.saturating_sub(reported));
        reported = reported.max(done);
    })?;
    progress.end();
    print(&args.json, &report, || tables::synth(&report, output))
}

fn run_meta(args: &MetaArgs) -> Outcome {
    match &args.file {
        Some(path) => {
            let report = MetadataReport::of(&read_metadata(path)?);
            print(&args.json, &report, || tables::metadata(&report))
        }
        None if args.template => print_line(METADATA_EXAMPLE.trim_end()),
        None => print_line(METADATA_SCHEMA.trim_end()),
    }
}

/// JSON where it was asked for, else a table.
fn print(json: &JsonArgs, result: &impl Serialize, table: impl Fn() -> String) -> Outcome {
    match &json.json {
        Some(Some(path)) => {
            write_json(path, result)?;
            print_line(&table())
        }
        Some(None) => print_line(&to_json(result)?),
        None => print_line(&table()),
    }
}

fn to_json(result: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string_pretty(result)
        .map_err(|e| Failure::Work(format!("cannot write JSON: {e}")))
}

fn write_json(path: &Path, result: &impl Serialize) -> Outcome {
    let text = to_json(result)? + "\n";
    Ok(write_whole(path, text.as_bytes())?)
}

fn print_line(text: &str) -> Outcome {
    match writeln!(std::io::stdout().lock(), "{text}") {
        // Whoever reads has seen enough.
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        other => other.map_err(|e| Failure::Work(format!("cannot write to standard output: {e}"))),
    }
}
