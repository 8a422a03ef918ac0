//! Files that are there as a whole or not at all.

use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use crate::error::RenderError;

/// Lets `make` write a file aside, as `NAME.part`, and renames it when it is on the disk. Where that
/// fails nothing is left, and what was there before still is. What a link leads to is written, not the
/// link.
///
/// # Errors
/// When `make` fails or the system refuses; when there is something that is no regular file.
pub fn write_aside<T>(
    path: &Path,
    make: impl FnOnce(&mut BufWriter<File>) -> Result<T, RenderError>,
) -> Result<T, RenderError> {
    let path = &place_of(path).map_err(RenderError::io(path, "write"))?;
    let mut aside = path.as_os_str().to_owned();
    aside.push(".part");
    let aside = PathBuf::from(aside);
    // Opening a pipe would wait for a reader, and a link leads elsewhere.
    if aside.symlink_metadata().is_ok_and(|there| !there.is_file()) {
        let why = std::io::Error::new(ErrorKind::AlreadyExists, "is there and no regular file");
        return Err(RenderError::io(&aside, "write")(why));
    }
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

/// Where a file that may be a link really is, or will be: a rename would put a regular file in the place
/// of a device, a pipe or a link.
fn place_of(path: &Path) -> std::io::Result<PathBuf> {
    let refused = |why| Err(std::io::Error::new(ErrorKind::InvalidInput, why));
    match path.canonicalize() {
        Ok(place) if place.is_file() => Ok(place),
        Ok(_) => refused("is no regular file"),
        Err(_) if path.symlink_metadata().is_ok() => refused("is a link that leads nowhere"),
        Err(_) => Ok(path.to_owned()),
    }
}

/// Writes a file of these bytes so.
///
/// # Errors
/// When the system refuses.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RenderError> {
    write_aside(path, |out| out.write_all(bytes).map_err(RenderError::io(path, "write")))
}
