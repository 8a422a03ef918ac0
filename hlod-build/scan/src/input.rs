//! A file behind one fixed buffer, read as bytes, as words or as lines.
//!
//! All readers share it. It never holds more than [`BUFFER_BYTES`] of the file, and
//! it knows where it stands (byte and line) for the sake of error messages.

use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::error::{Place, ScanError, Spot};

/// Size of the buffer; also the longest line, and the most that can be asked for at
/// once.
pub(crate) const BUFFER_BYTES: usize = 256 * 1024;

/// Longest word that can be a number or a keyword. Longer ones are no text of ours.
const WORD_BYTES_MAX: usize = 512;

/// A file being read from its begin to its end.
pub(crate) struct Input {
    path: PathBuf,
    file: File,
    file_bytes: u64,
    buffer: Vec<u8>,
    /// The part of the buffer not consumed yet.
    begin: usize,
    end: usize,
    /// Place of `buffer[0]` in the file.
    buffer_offset: u64,
    /// Line of the next byte, from 1. Only words and lines keep it up to date.
    line: u64,
}

impl Input {
    /// Opens a regular file at its begin.
    pub(crate) fn open(path: &Path) -> Result<Input, ScanError> {
        let at = || Spot::new(path, Place::File);
        // Ask what it is before opening it: opening a pipe would wait for a writer.
        let metadata = std::fs::metadata(path).map_err(|e| ScanError::from_io(at(), e))?;
        if !metadata.is_file() {
            return Err(ScanError::NotAFile { at: at() });
        }
        let file = File::open(path).map_err(|e| ScanError::from_io(at(), e))?;
        if metadata.len() == 0 {
            return Err(ScanError::EmptyFile { at: at() });
        }
        Ok(Input {
            path: path.to_path_buf(),
            file,
            file_bytes: metadata.len(),
            buffer: vec![0; BUFFER_BYTES],
            begin: 0,
            end: 0,
            buffer_offset: 0,
            line: 1,
        })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Size of the file when it was opened.
    pub(crate) fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// Bytes consumed so far.
    pub(crate) fn offset(&self) -> u64 {
        self.buffer_offset + self.begin as u64
    }

    /// Bytes not consumed yet, by the size at opening.
    pub(crate) fn remaining_bytes(&self) -> u64 {
        self.file_bytes.saturating_sub(self.offset())
    }

    /// The next byte, as a place for a message.
    pub(crate) fn at_byte(&self) -> Spot {
        Spot::new(&self.path, Place::Byte(self.offset()))
    }

    /// The current line, as a place for a message.
    pub(crate) fn at_line(&self) -> Spot {
        Spot::new(&self.path, Place::Line(self.line))
    }

    /// Current line, from 1.
    pub(crate) fn line_number(&self) -> u64 {
        self.line
    }

    /// The next bytes without consuming them: `count` of them, fewer only at the end
    /// of the file, often more. `count` is at most [`BUFFER_BYTES`].
    pub(crate) fn peek(&mut self, count: usize) -> Result<&[u8], ScanError> {
        debug_assert!(count <= BUFFER_BYTES);
        if self.end - self.begin < count {
            self.refill(count)?;
        }
        Ok(&self.buffer[self.begin..self.end])
    }

    /// Moves what is left to the front and reads until `count` bytes are there.
    #[cold]
    fn refill(&mut self, count: usize) -> Result<(), ScanError> {
        self.buffer.copy_within(self.begin..self.end, 0);
        self.buffer_offset += self.begin as u64;
        self.end -= self.begin;
        self.begin = 0;
        while self.end < count {
            match self.file.read(&mut self.buffer[self.end..]) {
                Ok(0) => break,
                Ok(read) => self.end += read,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => {
                    let place = Place::Byte(self.buffer_offset + self.end as u64);
                    return Err(ScanError::from_io(Spot::new(&self.path, place), e));
                }
            }
        }
        Ok(())
    }

    /// Marks `count` peeked bytes as consumed.
    pub(crate) fn consume(&mut self, count: usize) {
        debug_assert!(count <= self.end - self.begin);
        self.begin = (self.begin + count).min(self.end);
    }

    /// Consumes exactly `count` bytes, or none and gives `None` if fewer are left.
    pub(crate) fn take(&mut self, count: usize) -> Result<Option<&[u8]>, ScanError> {
        if self.peek(count)?.len() < count {
            return Ok(None);
        }
        self.begin += count;
        Ok(Some(&self.buffer[self.begin - count..self.begin]))
    }

    /// Consumes `count` bytes unseen. `false` if the file ends before.
    pub(crate) fn skip(&mut self, count: u64) -> Result<bool, ScanError> {
        let buffered = (self.end - self.begin) as u64;
        if count <= buffered {
            self.begin += count as usize;
            return Ok(true);
        }
        if count > self.remaining_bytes() {
            return Ok(false);
        }
        self.seek(self.offset() + count)?;
        Ok(true)
    }

    /// Goes to a byte of the file.
    pub(crate) fn seek(&mut self, offset: u64) -> Result<(), ScanError> {
        self.file
            .seek(SeekFrom::Start(offset))
            .map_err(|e| ScanError::from_io(Spot::new(&self.path, Place::Byte(offset)), e))?;
        self.begin = 0;
        self.end = 0;
        self.buffer_offset = offset;
        Ok(())
    }

    /// Consumes white space. `false` if the file ends here.
    pub(crate) fn skip_white_space(&mut self) -> Result<bool, ScanError> {
        loop {
            let bytes = self.peek(1)?;
            if bytes.is_empty() {
                return Ok(false);
            }
            let count =
                bytes.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(bytes.len());
            let lines = count_line_ends(&bytes[..count]);
            let found = count < bytes.len();
            self.consume(count);
            self.line += lines;
            if found {
                return Ok(true);
            }
        }
    }

    /// The next word between white space, or `None` at the end of the file.
    pub(crate) fn word(&mut self) -> Result<Option<&[u8]>, ScanError> {
        if !self.skip_white_space()? {
            return Ok(None);
        }
        let ends = |bytes: &[u8]| bytes.iter().position(u8::is_ascii_whitespace);
        // Most words lie in the buffer as a whole; only at its end read on.
        let length = match ends(&self.buffer[self.begin..self.end]) {
            Some(length) => length,
            None => {
                let bytes = self.peek(WORD_BYTES_MAX + 1)?;
                ends(bytes).unwrap_or(bytes.len())
            }
        };
        if length > WORD_BYTES_MAX {
            return Err(ScanError::malformed(
                self.at_line(),
                "a word of more than 512 bytes stands where a number or keyword should; \
                 this is no text",
            ));
        }
        self.take(length)
    }

    /// The next line without its end (LF or CR LF), or `None` at the end of the file.
    pub(crate) fn line(&mut self) -> Result<Option<&[u8]>, ScanError> {
        let ends = |bytes: &[u8]| bytes.iter().position(|byte| *byte == b'\n');
        let found = match ends(&self.buffer[self.begin..self.end]) {
            Some(length) => Some(length),
            None => ends(self.peek(BUFFER_BYTES)?),
        };
        let length = match found {
            Some(length) => length,
            None if self.end == self.begin => return Ok(None),
            None if self.end - self.begin == BUFFER_BYTES => {
                let what = format!("a line is longer than {BUFFER_BYTES} bytes; this is no text");
                return Err(ScanError::malformed(self.at_line(), what));
            }
            None => self.end - self.begin,
        };
        let begin = self.begin;
        self.begin += length + usize::from(found.is_some());
        self.line += u64::from(found.is_some());
        let line = &self.buffer[begin..begin + length];
        Ok(Some(line.strip_suffix(b"\r").unwrap_or(line)))
    }
}

fn count_line_ends(bytes: &[u8]) -> u64 {
    bytes.iter().filter(|byte| **byte == b'\n').count() as u64
}
