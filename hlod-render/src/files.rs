//! Files that are there as a whole or not at all.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::RenderError;

/// Lets `make` write a file aside, as `NAME.part`, and renames it when it is on the disk. Where that
/// fails nothing is left, and what was there before still is.
///
/// # Errors
/// When `make` fails or the system refuses.
pub fn write_aside<T>(
    path: &Path,
    make: impl FnOnce(&mut BufWriter<File>) -> Result<T, RenderError>,
) -> Result<T, RenderError> {
    let mut aside = path.as_os_str().to_owned();
    aside.push(".part");
    let aside = PathBuf::from(aside);
    let file = File::create(&aside).map_err(RenderError::io(path, "create"))?;
    let mut out = BufWriter::new(file);
    let made = make(&mut out).and_then(|made| {
        let file = out.into_inner().map_err(|e| e.into_error());
        file.and_then(|file| file.sync_all()).map_err(RenderError::io(path, "write"))?;
        std::fs::rename(&aside, path).map_err(RenderError::io(path, "create"))?;
        Ok(made)
    });
    if made.is_err() {
        // What failed is said; what cannot be removed either is not worth a second message.
        let _ = std::fs::remove_file(&aside);
    }
    made
}

/// Writes a file of these bytes so.
///
/// # Errors
/// When the system refuses.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RenderError> {
    write_aside(path, |out| out.write_all(bytes).map_err(RenderError::io(path, "write")))
}
