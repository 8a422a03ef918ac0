//! `./x report` and `./x bench`: what is measured, as tables, or compared with a record.

use std::process::ExitCode;

use crate::system::{self, Need};
use crate::{Failure, run};

/// Hands over to `hlod-report` of hlod-tests, which runs the released programs.
pub fn report(what: &str, arguments: &[String]) -> Result<ExitCode, Failure> {
    run::announce_first_build("release", "10 to 15 minutes")?;
    system::provide(&[Need::VulkanLoader, Need::VulkanDriver], false)?;
    let mut build = run::cargo();
    build.args(["build", "--release", "--package", "hlod-build", "--package", "hlod-render"]);
    run::run(build.args(["--package", "hlod-tests", "--bins"]))?;
    let mut report = run::program("hlod-report")?;
    let is_good = run::run(report.arg(what).args(arguments)).is_ok();
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
