//! What is known of a scan besides its shape: what it shows, who holds it, how it was made.
//!
//! A text of JSON, kept byte for byte as it was given, in a range of the file that the header names,
//! with a checksum. Keys are named after *IIIF Presentation API 3.0* (2020, sections 3.1 and 3.2: `label`,
//! `summary`, `rights`, `requiredStatement`) where that has them; [`keys`] says which concepts of
//! CIDOC CRM (7.1.3) and CRMdig (4.0) the others are. `compress/metadata.schema.json` is the JSON Schema,
//! `compress/metadata.example.json` an example.
//!
//! Other keys are kept, too: who wrote them knows what they mean.

mod keys;
#[cfg(test)]
mod tests;

use serde_json::{Map, Value};

use crate::{FormatError, Unit};

/// No text of metadata is longer, in bytes.
pub const METADATA_BYTES_MAX: usize = 1 << 20;

/// The JSON Schema (2020-12) of what is known of metadata.
pub const METADATA_SCHEMA: &str = include_str!("../../metadata.schema.json");

/// A text of metadata to begin with.
pub const METADATA_EXAMPLE: &str = include_str!("../../metadata.example.json");

/// Where a file's metadata lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MetadataRef {
    /// First byte in the file.
    pub offset: u64,
    /// Length in bytes, at most [`METADATA_BYTES_MAX`].
    pub text_bytes: u32,
    /// CRC-32 of those bytes.
    pub crc32: u32,
}

/// Metadata that were checked: JSON, and what is known of it is of the right kind.
#[derive(Debug, Clone, PartialEq)]
pub struct Metadata {
    text: String,
    root: Map<String, Value>,
}

/// The uncertainty of lengths that whoever scanned declares.
#[derive(Debug, Clone, PartialEq)]
pub struct Accuracy {
    /// Expanded uncertainty of a length, in `unit` (JCGM 100:2008, section 6).
    pub value: f64,
    /// Its unit; never unknown.
    pub unit: Unit,
    /// The coverage factor.
    pub k: f64,
    /// Who or what says so.
    pub source: String,
}

impl Metadata {
    /// Reads and checks a text.
    ///
    /// # Errors
    /// When it is too long, is no JSON object, or a known key has a value of another kind, which is then
    /// named.
    pub fn parse(text: &[u8]) -> Result<Metadata, FormatError> {
        let bad = |why: String| FormatError::Malformed { what: "metadata", why };
        if text.len() > METADATA_BYTES_MAX {
            return Err(FormatError::TooLarge {
                what: "metadata",
                count: text.len() as u64,
                unit: "bytes",
                limit: METADATA_BYTES_MAX as u64,
            });
        }
        let text = std::str::from_utf8(text).map_err(|_| bad("it is not UTF-8".into()))?;
        let root = match serde_json::from_str(text) {
            Ok(Value::Object(root)) => root,
            Ok(_) => return Err(bad("expected an object, { … }".into())),
            Err(error) => return Err(bad(format!("it is no JSON: {error}"))),
        };
        keys::check(&root).map_err(bad)?;
        Ok(Metadata { text: text.to_owned(), root })
    }

    /// The text as it was given.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The same as a JSON value.
    pub fn value(&self) -> Value {
        Value::Object(self.root.clone())
    }

    /// Where the text lies, but for its offset, which [`crate::FileWriter`] finds.
    pub(crate) fn reference(&self) -> MetadataRef {
        let bytes = self.text.as_bytes();
        MetadataRef { offset: 0, text_bytes: bytes.len() as u32, crc32: crc32fast::hash(bytes) }
    }

    /// Keys that nothing is known of, as paths: `digitization.weather`.
    pub fn unknown_keys(&self) -> Vec<String> {
        keys::unknown(&self.root)
    }

    /// What is known, for people: names and values, without line ends, in a fixed order.
    pub fn lines(&self) -> Vec<(String, String)> {
        keys::lines(&self.root)
    }

    /// The line that whoever holds it wants beside each picture: `requiredStatement`.
    pub fn required_statement(&self) -> Option<String> {
        keys::required_statement(&self.root)
    }

    /// The uncertainty declared in `digitization.accuracy`.
    pub fn accuracy(&self) -> Option<Accuracy> {
        let accuracy = self.root.get("digitization")?.get("accuracy")?;
        Some(Accuracy {
            value: accuracy.get("value")?.as_f64()?,
            unit: accuracy.get("unit")?.as_str()?.parse().ok()?,
            k: accuracy.get("k")?.as_f64()?,
            source: printable(accuracy.get("source")?.as_str()?),
        })
    }
}

impl MetadataRef {
    /// Compares a text with its checksum, and reads it.
    ///
    /// # Errors
    /// When it is damaged, or as [`Metadata::parse`].
    pub fn parse(&self, text: &[u8]) -> Result<Metadata, FormatError> {
        let found = crc32fast::hash(text);
        if found != self.crc32 {
            let (what, offset, expected) = ("metadata", self.offset, self.crc32);
            return Err(FormatError::Checksum { what, offset, found, expected });
        }
        Metadata::parse(text)
    }
}

/// Without what ends lines or moves cursors: texts come from outside.
fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
