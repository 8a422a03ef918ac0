//! `./x bless NAME`: let image tests replace their goldens.

use std::process::{Command, ExitCode};

use crate::{Failure, run};

/// Runs the image tests whose names contain `name` and lists what changed in `tests/golden`.
///
/// The tests read `HLOD_BLESS`: one whose name contains its value writes its golden instead
/// of comparing with it. Nothing else ever writes a golden.
pub fn bless(name: &str) -> Result<ExitCode, Failure> {
    // `--workspace` chooses the same features of all libraries as `./x test`: no new build.
    let mut tests = run::cargo();
    tests.args(["test", "--workspace", "--test", "suite", "--", name]).env("HLOD_BLESS", name);
    let mut count = 0;
    let good = run::run_observed(&mut tests, |line| {
        count += usize::from(line.starts_with("test ") && line.ends_with(" ... ok"));
    })?;
    if count == 0 && good {
        return Err(Failure::Work(format!("No image test has a name with '{name}' in it.")));
    }

    println!("\nChanged in tests/golden (nothing, if no line follows); look before committing:");
    let mut status = Command::new("git");
    run::run(status.current_dir(run::root()).args(["status", "--short", "--", "tests/golden"]))?;
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
