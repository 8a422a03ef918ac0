//! The programs, as their users start them: what is measured is what they print with `--json`.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use super::error::ReportError;
use super::kept::Kept;

/// Where `hlod-build` and `hlod-render` are, and what they measured before.
#[derive(Debug, Clone)]
pub struct Programs {
    folder: PathBuf,
    kept: Option<Kept>,
}

/// A command line: a program's name, then its arguments.
#[derive(Debug, Clone)]
pub(super) struct Line(Vec<OsString>);

impl Line {
    pub(super) fn new(program: &str) -> Line {
        Line(vec![program.into()])
    }

    /// The same with words, which spaces part.
    pub(super) fn words(mut self, words: &str) -> Line {
        self.0.extend(words.split(' ').filter(|word| !word.is_empty()).map(OsString::from));
        self
    }

    /// The same with one argument, which may have spaces.
    pub(super) fn with(mut self, argument: impl AsRef<OsStr>) -> Line {
        self.0.push(argument.as_ref().to_owned());
        self
    }

    fn text(&self) -> String {
        self.0.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
    }
}

impl Programs {
    /// Those beside the program that runs.
    ///
    /// # Errors
    /// When it cannot be told where that is.
    pub fn beside_this_one() -> Result<Programs, ReportError> {
        let this = std::env::current_exe().map_err(ReportError::io(Path::new("."), "find"))?;
        let folder = this.parent().unwrap_or(Path::new(".")).to_owned();
        Ok(Programs { folder, kept: None })
    }

    /// The same, keeping what is measured in a folder; what is there already counts if `goes_on`.
    pub(super) fn keeping(&self, kept: PathBuf, goes_on: bool) -> Result<Programs, ReportError> {
        let programs = [self.checksum("hlod-build")?, self.checksum("hlod-render")?];
        let kept = Kept::open(kept, programs, goes_on)?;
        Ok(Programs { folder: self.folder.clone(), kept: Some(kept) })
    }

    /// Tells whether a program is still the same.
    pub(super) fn checksum(&self, name: &str) -> Result<u32, ReportError> {
        let path = self.path(name.as_ref());
        let bytes = std::fs::read(&path).map_err(ReportError::io(&path, "read"))?;
        Ok(crc32fast::hash(&bytes))
    }

    fn path(&self, name: &OsStr) -> PathBuf {
        self.folder.join(name).with_extension(std::env::consts::EXE_EXTENSION)
    }

    /// How many outputs are of earlier runs, and how many there are.
    pub(super) fn kept(&self) -> (usize, usize) {
        self.kept.as_ref().map_or((0, 0), Kept::counts)
    }

    /// Runs a command line to its end.
    pub(super) fn run(&self, line: &Line) -> Result<Vec<u8>, ReportError> {
        let program = self.path(&line.0[0]);
        let mut command = Command::new(&program);
        let output = command
            .args(&line.0[1..])
            .output()
            .map_err(|source| ReportError::Start { program: program.clone(), source })?;
        // What is checked and refuted is a result, too.
        if output.status.success() || output.status.code() == Some(3) {
            return Ok(output.stdout);
        }
        let said = String::from_utf8_lossy(&output.stderr);
        let last: Vec<&str> = said.lines().rev().take(8).collect();
        Err(ReportError::Failed {
            command: line.text(),
            status: output.status,
            said: last.into_iter().rev().collect::<Vec<_>>().join("\n"),
        })
    }

    /// Runs a command line with `--json`; gives what it prints.
    pub(super) fn json(&self, line: &Line) -> Result<Value, ReportError> {
        let line = line.clone().words("--json --quiet");
        let printed = self.run(&line)?;
        serde_json::from_slice(&printed)
            .map_err(|error| ReportError::unexpected(line.text(), error))
    }

    /// As [`Self::json`], or what was kept of it.
    pub(super) fn measured(&self, line: &Line) -> Result<Value, ReportError> {
        let mut values = self.round(std::slice::from_ref(line), 0)?;
        values.pop().ok_or_else(|| ReportError::unexpected(line.text(), "was kept without output"))
    }

    /// What command lines print one after the other, or what was kept of this round of them.
    pub(super) fn round(&self, lines: &[Line], round: usize) -> Result<Vec<Value>, ReportError> {
        let measure = || lines.iter().map(|line| self.json(line)).collect();
        let Some(kept) = &self.kept else { return measure() };
        let number = [OsString::from(round.to_string())];
        let mut key: Vec<&[OsString]> = vec![&number];
        key.extend(lines.iter().map(|line| line.0.as_slice()));
        let values = kept.or_measure(&key, measure)?;
        match values.len() == lines.len() {
            true => Ok(values),
            false => Err(ReportError::unexpected(lines[0].text(), "was kept in part")),
        }
    }
}

/// A number in what a program printed: keys, parted by dots.
pub(super) fn number(value: &Value, keys: &str) -> Result<f64, ReportError> {
    let found = keys.split('.').try_fold(value, |value, key| value.get(key));
    found
        .and_then(Value::as_f64)
        .ok_or_else(|| ReportError::unexpected(keys, "no such number was printed"))
}

/// A text in what a program printed.
pub(super) fn text<'a>(value: &'a Value, key: &str) -> Result<&'a str, ReportError> {
    let found = value.get(key).and_then(Value::as_str);
    found.ok_or_else(|| ReportError::unexpected(key, "no such text was printed"))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_are_found_below_their_keys() {
        let value = json!({ "frame_ms": { "p50": 2.5 }, "name": "x" });
        assert_eq!(number(&value, "frame_ms.p50").unwrap(), 2.5);
        assert!(number(&value, "frame_ms.p51").is_err() && number(&value, "name").is_err());
        assert_eq!(text(&value, "name").unwrap(), "x");
    }
}
