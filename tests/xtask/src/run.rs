//! Running other programs so that the reader sees, and can repeat, what is run.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::Failure;

/// The repository's root.
pub fn root() -> &'static Path {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.ancestors().nth(2).expect("this package lies two folders below the root")
}

/// The cargo that started us, at the repository's root.
pub fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
    command.current_dir(root());
    command
}

/// Where cargo leaves what it builds: we lie in its `debug` folder ourselves. So this holds
/// wherever the environment or a configuration file has put it.
pub fn target_folder() -> Result<PathBuf, Failure> {
    std::env::current_exe()
        .ok()
        .and_then(|program| Some(program.parent()?.parent()?.to_owned()))
        .ok_or_else(|| Failure::Work("cannot find cargo's target folder".into()))
}

/// One of the workspace's programs, built for release, to be run at the repository's root.
pub fn program(name: &str) -> Result<Command, Failure> {
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let mut command = Command::new(target_folder()?.join("release").join(file));
    command.current_dir(root());
    Ok(command)
}

/// Says how long a build will take, where nothing of it is there yet.
pub fn announce_first_build(profile: &str, duration: &str) -> Result<(), Failure> {
    let libraries = target_folder()?.join(profile).join("deps");
    let is_wgpu = |name: &OsStr| name.to_string_lossy().starts_with("libwgpu-");
    let entries = std::fs::read_dir(libraries).into_iter().flatten().flatten();
    if !entries.into_iter().any(|entry| is_wgpu(&entry.file_name())) {
        println!("The first build compiles some 230 crates: on two cores {duration}.");
    }
    Ok(())
}

/// Shows the command, runs it on this terminal and waits. A failed command is an error.
pub fn run(command: &mut Command) -> Result<(), Failure> {
    let line = shown(command);
    println!("$ {line}");
    match with_runtime_folder(command).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(Failure::Work(format!("This failed ({status}): {line}"))),
        Err(error) => Err(cannot_start(command, &error)),
    }
}

/// Shows the command, runs it, passes its standard output on and shows `observe` every line
/// of it. Returns whether the command succeeded.
pub fn run_observed(command: &mut Command, mut observe: impl FnMut(&str)) -> Result<bool, Failure> {
    let line = shown(command);
    println!("$ {line}");
    let mut child = with_runtime_folder(command)
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| cannot_start(command, &error))?;
    let lost = |error| Failure::Work(format!("lost the output of {line}: {error}"));

    // Bytes rather than `lines()`: a test may print what is not UTF-8.
    let mut output = BufReader::new(child.stdout.take().expect("it was just piped"));
    let mut bytes = Vec::new();
    while output.read_until(b'\n', &mut bytes).map_err(lost)? > 0 {
        let line = String::from_utf8_lossy(&bytes);
        print!("{line}");
        observe(line.trim_end());
        bytes.clear();
    }
    Ok(child.wait().map_err(lost)?.success())
}

/// Whether the command runs and succeeds, unseen.
pub fn succeeds(command: &mut Command) -> bool {
    let quiet = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    quiet.status().is_ok_and(|status| status.success())
}

/// The command as one would type it at the repository's root.
pub fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let program = match program.file_stem() {
        // Started by its full path, typed without.
        Some(name) if name == "cargo" => Path::new("cargo"),
        _ => program.strip_prefix(root()).unwrap_or(program),
    };
    let variables = command
        .get_envs()
        .filter_map(|(name, value)| Some(format!("{}={}", name.to_string_lossy(), quoted(value?))));
    let words = std::iter::once(program.as_os_str()).chain(command.get_args()).map(quoted);
    variables.chain(words).collect::<Vec<_>>().join(" ")
}

/// Where a login has set no `XDG_RUNTIME_DIR`, as in containers, graphics drivers complain on
/// every start: give them a folder of our own, which nobody else may read.
#[cfg(target_os = "linux")]
fn with_runtime_folder(command: &mut Command) -> &mut Command {
    use std::os::unix::fs::DirBuilderExt;
    if std::env::var_os("XDG_RUNTIME_DIR").is_some() {
        return command;
    }
    let folder = target_folder().map(|target| target.join("runtime"));
    // Without it, they complain and work.
    match folder {
        Ok(folder)
            if std::fs::DirBuilder::new().recursive(true).mode(0o700).create(&folder).is_ok() =>
        {
            command.env("XDG_RUNTIME_DIR", folder)
        }
        _ => command,
    }
}

#[cfg(not(target_os = "linux"))]
fn with_runtime_folder(command: &mut Command) -> &mut Command {
    command
}

fn cannot_start(command: &Command, error: &std::io::Error) -> Failure {
    Failure::Work(format!("cannot start {}: {error}", command.get_program().display()))
}

/// In single quotes where a shell would otherwise read more than the word.
fn quoted(word: &OsStr) -> String {
    let word = word.to_string_lossy();
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+@%\\".contains(c);
    match word.chars().all(plain) && !word.is_empty() {
        true => word.into_owned(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_shown_as_typed() {
        let mut command = Command::new(root().join("target/release/hlod-build"));
        command.args(["synth", "a b", "it's", ""]).env("HLOD_BLESS", "igea");
        assert_eq!(
            shown(&command),
            r"HLOD_BLESS=igea target/release/hlod-build synth 'a b' 'it'\''s' ''"
        );
        assert_eq!(shown(Command::new("/usr/lib/rust/bin/cargo").arg("test")), "cargo test");
    }

    #[test]
    fn output_is_observed_line_by_line() {
        let mut lines = Vec::new();
        let good = run_observed(cargo().arg("--version"), |line| lines.push(line.to_owned()));
        assert!(good.is_ok_and(|good| good));
        assert!(lines.len() == 1 && lines[0].starts_with("cargo "), "{lines:?}");
    }
}
