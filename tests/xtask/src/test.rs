//! `./x test`: every check and every test, and one line at the end that counts them.

mod tally;

use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use crate::options::TestOptions;
use crate::system::{self, Need};
use crate::{Failure, run};
use tally::Tally;

/// Names a file to which a test that finds its scan, GPU or program missing, and so returns
/// early, appends one line: its own name and why. `cargo test` shows nothing of what a passing
/// test prints, so a message there would be lost.
const SKIP_LOG: &str = "HLOD_SKIP_LOG";

const EVERY_NEED: [Need; 4] =
    [Need::VulkanLoader, Need::VulkanDriver, Need::WindowLibraries, Need::VirtualDisplay];

pub fn test(options: &TestOptions) -> Result<ExitCode, Failure> {
    run::announce_first_build(
        "debug",
        "about 8 minutes on two cores, once with the viewer's window and once without",
    )?;
    system::provide(&EVERY_NEED, options.may_install)?;

    // Go on after a failure: everything is counted.
    let mut tally = Tally::default();
    if options.filters.is_empty() {
        let format = ["fmt", "--all", "--check"];
        check(&mut tally, "Format", "rustfmt", &format);
        let scope = ["--workspace", "--all-targets", "--features", "hlod-render/viewer"];
        let lints = [&["clippy"], &scope[..], &["--", "-D", "warnings"]].concat();
        check(&mut tally, "Lints", "clippy", &lints);
    }
    // Twice, because the renderer must work with its window and without. Cargo chooses the
    // features of common dependencies for all packages at once; the renderer's tests ask for the
    // window's in both cases, so that wgpu and most others are compiled once.
    let filters = &options.filters;
    tests(&mut tally, "Tests, without the viewer's window", &["--workspace"], filters)?;
    let viewer = ["--package", "hlod-render", "--features", "viewer"];
    tests(&mut tally, "Tests of the renderer with its window", &viewer, filters)?;

    if !tally.is_good() && tally.failed() == 0 {
        println!("\nNo test was run: none has a name with {} in it.", options.filters.join(" or "));
    }
    tally.print();
    Ok(if tally.is_good() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Runs a check that is a component of its own of Rust, and not always installed.
fn check(tally: &mut Tally, title: &str, component: &str, arguments: &[&str]) {
    let _section = Section::begin(title);
    if !run::succeeds(run::cargo().args([arguments[0], "--version"])) {
        let reason = format!("{title}: 'rustup component add {component}' would install it");
        println!("Skipped: {reason}");
        tally.skip(&reason);
        return;
    }
    let mut command = run::cargo();
    let good = run::run(command.args(arguments)).is_ok();
    tally.check(&run::shown(&command), good);
}

/// Builds and runs the tests of the selected packages, and counts.
fn tests(
    tally: &mut Tally,
    title: &str,
    selection: &[&str],
    filters: &[String],
) -> Result<(), Failure> {
    let _section = Section::begin(title);

    // `cargo test` alone would leave the programs, which some tests start, as they were before.
    let mut build = run::cargo();
    build.arg("build").args(selection).arg("--all-targets");
    if run::run(&mut build).is_err() {
        tally.check(&run::shown(&build), false);
        return Ok(());
    }

    // Run the tests. A program of tests that dies reports no failed one.
    let mut command = run::cargo();
    let log = SkipLog::create()?;
    command.arg("test").args(selection).arg("--no-fail-fast").env(SKIP_LOG, &log.0);
    if !filters.is_empty() {
        command.arg("--").args(filters);
    }
    let failed_before = tally.failed();
    let good = run::run_observed(&mut command, |line| tally.observe(line))?;
    if !good && tally.failed() == failed_before {
        tally.check(&run::shown(&command), false);
    }
    for line in log.lines()? {
        tally.skip_counted_as_passed(&line);
    }
    Ok(())
}

/// A heading, and at its end how long it took.
struct Section(Instant);

impl Section {
    fn begin(title: &str) -> Section {
        println!("\n== {title} ==");
        Section(Instant::now())
    }
}

impl Drop for Section {
    fn drop(&mut self) {
        let secs = self.0.elapsed().as_secs();
        match (secs / 60, secs % 60) {
            (0, secs) => println!("== {secs} s =="),
            (mins, secs) => println!("== {mins} min {secs} s =="),
        }
    }
}

/// A fresh file for skipped tests to tell of themselves; removed in the end.
struct SkipLog(PathBuf);

impl SkipLog {
    fn create() -> Result<SkipLog, Failure> {
        let path = run::target_folder()?.join(format!("skipped-{}.log", std::process::id()));
        let log = SkipLog(path);
        fs::write(&log.0, "").map_err(|error| log.failure("create", &error))?;
        Ok(log)
    }

    fn lines(&self) -> Result<Vec<String>, Failure> {
        let text = fs::read(&self.0).map_err(|error| self.failure("read", &error))?;
        let text = String::from_utf8_lossy(&text);
        Ok(text.lines().filter(|line| !line.trim().is_empty()).map(str::to_owned).collect())
    }

    fn failure(&self, action: &str, error: &std::io::Error) -> Failure {
        Failure::Work(format!("cannot {action} {}: {error}", self.0.display()))
    }
}

impl Drop for SkipLog {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}
