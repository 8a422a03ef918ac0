//! `./x soak`: a long session, and whether memory stays as it is.

use std::process::ExitCode;

use crate::system::{self, Need};
use crate::{Failure, run};

/// Hands over to `hlod-soak` of hlod-tests.
pub fn soak(arguments: &[String]) -> Result<ExitCode, Failure> {
    run::announce_first_build("debug", "about 8 minutes")?;
    system::provide(&[Need::VulkanLoader, Need::VulkanDriver], false)?;
    let mut soak = run::cargo();
    soak.args(["run", "--quiet", "--package", "hlod-tests", "--bin", "hlod-soak", "--"]);
    let is_good = run::run(soak.args(arguments)).is_ok();
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
