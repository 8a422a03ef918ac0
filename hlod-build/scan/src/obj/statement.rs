//! The statements of an OBJ or MTL file: a keyword and words.

use std::borrow::Cow;
use std::path::Path;
use std::str::SplitAsciiWhitespace;

use crate::error::{Place, ScanError, Spot};
use crate::input::{BUFFER_BYTES, Input};

/// One line, or several joined by a backslash at their ends.
pub(super) struct Statement<'a> {
    pub(super) path: &'a Path,
    pub(super) line: u64,
    pub(super) keyword: &'a str,
    pub(super) words: SplitAsciiWhitespace<'a>,
}

impl Statement<'_> {
    pub(super) fn at(&self) -> Spot {
        Spot::new(self.path, Place::Line(self.line))
    }

    pub(super) fn malformed(&self, what: impl Into<String>) -> ScanError {
        ScanError::malformed(self.at(), what)
    }

    pub(super) fn numbers<const N: usize>(&mut self) -> Result<[f64; N], ScanError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            let Some(word) = self.words.next() else {
                let what = format!("`{}` needs {N} numbers", self.keyword);
                return Err(self.malformed(what));
            };
            *number = self.number(word)?;
        }
        Ok(numbers)
    }

    pub(super) fn number(&self, word: &str) -> Result<f64, ScanError> {
        word.parse().map_err(|_| self.malformed(format!("`{word}` is not a number")))
    }
}

/// Progress is told this often.
const PROGRESS_BYTES: u64 = 1 << 22;

/// Calls `read` for each statement up to the end of the file.
pub(super) fn each_statement(
    input: &mut Input,
    progress: &mut dyn FnMut(u64) -> bool,
    mut read: impl FnMut(Statement<'_>) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let path = input.path().to_path_buf();
    let mut joined = Vec::new();
    let mut next_report = 0;
    loop {
        if input.offset() >= next_report {
            next_report = input.offset() + PROGRESS_BYTES;
            if !progress(input.offset()) {
                return Err(ScanError::Stopped { at: Spot::new(&path, Place::File) });
            }
        }
        let line_number = input.line_number();
        let Some(mut line) = input.line()? else {
            return Ok(());
        };
        // Join continued lines; few files have any.
        joined.clear();
        while let Some(begin) = line.strip_suffix(b"\\") {
            joined.extend_from_slice(begin);
            if joined.len() > BUFFER_BYTES {
                let at = Spot::new(&path, Place::Line(line_number));
                return Err(ScanError::malformed(at, "a continued line does not end"));
            }
            line = input.line()?.unwrap_or_default();
        }
        let text: Cow<'_, str> = if joined.is_empty() {
            String::from_utf8_lossy(line)
        } else {
            joined.extend_from_slice(line);
            String::from_utf8_lossy(&joined)
        };
        let text = text.split('#').next().unwrap_or_default();
        let mut words = text.split_ascii_whitespace();
        if let Some(keyword) = words.next() {
            read(Statement { path: &path, line: line_number, keyword, words })?;
        }
    }
}
