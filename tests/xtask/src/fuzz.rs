//! `./x fuzz`: changed inputs for everything that reads, for as long as one likes.

use std::process::ExitCode;

use crate::{Failure, run};

/// Hands over to `hlod-fuzz` of hlod-tests, in the debug profile: it is optimised here, and checks for
/// overflow.
pub fn fuzz(arguments: &[String]) -> Result<ExitCode, Failure> {
    run::announce_first_build("debug", "about 8 minutes")?;
    let mut fuzz = run::cargo();
    fuzz.args(["run", "--quiet", "--package", "hlod-tests", "--bin", "hlod-fuzz", "--"]);
    let is_good = run::run(fuzz.args(arguments)).is_ok();
    if run::succeeds(run::cargo().args(["fuzz", "--version"])) {
        println!(
            "cargo-fuzz is here: `cargo +nightly fuzz run TARGET` looks deeper, guided by coverage."
        );
    }
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
