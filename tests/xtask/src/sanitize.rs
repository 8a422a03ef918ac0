//! `./x sanitize`: the decoders' tests where every access to memory is checked.

use std::path::PathBuf;
use std::process::{Command, ExitCode};

use crate::{Failure, run};

/// What reads bytes from outside. The builder and the renderer read through these.
const DECODERS: [&str; 2] = ["hlod-compress", "hlod-scan"];

/// The one that the runtime is looked for of.
const TARGET: &str = "x86_64-unknown-linux-gnu";

/// What compilation with another compiler or other flags leaves, apart from the usual.
const FOLDER: &str = "out/sanitize";

pub fn sanitize(with_miri: bool) -> Result<ExitCode, Failure> {
    if with_miri { miri() } else { address() }
}

/// AddressSanitizer, which needs its runtime library, part of Rust's own for some systems.
fn address() -> Result<ExitCode, Failure> {
    let on_target = cfg!(all(target_os = "linux", target_arch = "x86_64", target_env = "gnu"));
    if !on_target || !has_runtime() {
        return Ok(skipped(&format!(
            "AddressSanitizer: it needs {TARGET} and the runtime of a compiler from rustup"
        )));
    }
    let mut test = run::cargo();
    // The flag is not stable; the variable lets the stable compiler, which is the one that programs
    // are made with, have it. A target that is named keeps the flags from build scripts and macros.
    test.env("RUSTC_BOOTSTRAP", "1").env("RUSTFLAGS", "-Zsanitizer=address");
    test.args(["test", "--target", TARGET, "--target-dir", FOLDER, "--lib", "--tests"]);
    run::run(test.args(packages()))?;
    Ok(ExitCode::SUCCESS)
}

/// Miri interprets, and so finds undefined behaviour of other kinds, too; it is a component of nightly
/// compilers, and slow.
fn miri() -> Result<ExitCode, Failure> {
    let nightly = |arguments: &[&str]| {
        let mut command = Command::new("rustup");
        command.current_dir(run::root()).args(["run", "nightly", "cargo", "miri"]).args(arguments);
        command
    };
    if !run::succeeds(&mut nightly(&["--version"])) {
        return Ok(skipped(
            "Miri: 'rustup toolchain install nightly --component miri' would install it",
        ));
    }
    let mut test = nightly(&["test", "--target-dir", FOLDER, "--lib"]);
    // Tests read files; property tests of so few cases end within the day.
    test.env("MIRIFLAGS", "-Zmiri-disable-isolation").env("PROPTEST_CASES", "4");
    run::run(test.args(packages()))?;
    Ok(ExitCode::SUCCESS)
}

fn packages() -> impl Iterator<Item = &'static str> {
    DECODERS.into_iter().flat_map(|package| ["--package", package])
}

/// Seen, and no failure: nothing was found wrong.
fn skipped(why: &str) -> ExitCode {
    println!("Skipped: {why}");
    ExitCode::SUCCESS
}

fn has_runtime() -> bool {
    let compiler = std::env::var_os("RUSTC").unwrap_or("rustc".into());
    let Ok(output) = Command::new(compiler).args(["--print", "sysroot"]).output() else {
        return false;
    };
    let sysroot = PathBuf::from(String::from_utf8_lossy(&output.stdout).trim());
    let libraries = sysroot.join("lib/rustlib").join(TARGET).join("lib");
    let names = std::fs::read_dir(libraries).into_iter().flatten().flatten();
    names.into_iter().any(|entry| entry.file_name().to_string_lossy().ends_with("_rt.asan.a"))
}
