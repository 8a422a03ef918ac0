//! `./x targets`: whether everything compiles for systems that are not this one.

use std::process::ExitCode;

use crate::{Failure, run};

/// Checked without their linkers, which other systems would need.
const TARGETS: [&str; 3] =
    ["x86_64-unknown-linux-gnu", "x86_64-pc-windows-gnu", "aarch64-apple-darwin"];

/// Libraries and programs; the window has its own system libraries, which are only linked.
const PACKAGES: [&str; 5] =
    ["hlod-compress", "hlod-scan", "hlod-shaders", "hlod-build", "hlod-render"];

pub fn targets() -> Result<ExitCode, Failure> {
    let mut outcomes = Vec::new();
    for target in TARGETS {
        let outcome = if !is_installed(target) {
            // Not a failure: without a network nothing can be installed.
            "skipped: rustup cannot add it here"
        } else {
            let mut check = run::cargo();
            check.args(["check", "--target", target, "--features", "hlod-render/viewer"]);
            // Nothing is linked, so that what libraries compile of C need not be compiled.
            if cfg!(unix) && target != host() {
                let of_target = target.replace('-', "_");
                for tool in ["CC", "CXX", "AR"] {
                    check.env(format!("{tool}_{of_target}"), "true");
                }
            }
            for package in PACKAGES {
                check.args(["--package", package]);
            }
            if run::run(&mut check).is_ok() { "compiles" } else { "FAILED" }
        };
        outcomes.push((target, outcome));
    }
    println!();
    for (target, outcome) in &outcomes {
        println!("{target:<28}{outcome}");
    }
    let failed = outcomes.iter().any(|(_, outcome)| *outcome == "FAILED");
    Ok(if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// What this program was compiled for.
fn host() -> &'static str {
    match (std::env::consts::OS, std::env::consts::ARCH) {
        ("linux", "x86_64") => "x86_64-unknown-linux-gnu",
        ("windows", "x86_64") => "x86_64-pc-windows-gnu",
        ("macos", "aarch64") => "aarch64-apple-darwin",
        _ => "",
    }
}

/// Adds a target's libraries where rustup can.
fn is_installed(target: &str) -> bool {
    run::succeeds(std::process::Command::new("rustup").args(["target", "add", target]))
}
