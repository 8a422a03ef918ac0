//! Metadata of a scan, as `build --meta` and `hlod-build meta` read them.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use hlod_compress::{METADATA_BYTES_MAX, Metadata};
use serde::Serialize;

use crate::error::BuildError;

/// Reads and checks a file of metadata.
///
/// # Errors
/// When it cannot be read, is too long, is no JSON object, or a known key has a value of another kind.
pub fn read_metadata(path: &Path) -> Result<Metadata, BuildError> {
    let file = File::open(path).map_err(BuildError::io(path, "open"))?;
    let mut text = Vec::new();
    // A byte more than there may be: a file that never ends is refused like one that is too long.
    file.take(METADATA_BYTES_MAX as u64 + 1)
        .read_to_end(&mut text)
        .map_err(BuildError::io(path, "read"))?;
    Metadata::parse(&text).map_err(BuildError::format(path))
}

/// What a file of metadata says; the keys are stable.
#[derive(Debug, Serialize)]
pub struct MetadataReport {
    /// What is known, for people: names and values.
    pub lines: Vec<(String, String)>,
    /// Keys that nothing is known of; they are kept.
    pub unknown_keys: Vec<String>,
}

impl MetadataReport {
    /// Of metadata that were read.
    pub fn of(metadata: &Metadata) -> MetadataReport {
        MetadataReport { lines: metadata.lines(), unknown_keys: metadata.unknown_keys() }
    }
}
