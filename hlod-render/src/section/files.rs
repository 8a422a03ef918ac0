//! Files that are there as a whole or not at all.

use std::io::Write;
use std::path::Path;

use crate::error::RenderError;

/// Writes a file aside, to `NAME.part`, and renames it when it is on the disk.
///
/// # Errors
/// When the system refuses; what was there before is then still there.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RenderError> {
    let mut aside = path.as_os_str().to_owned();
    aside.push(".part");
    let aside = std::path::PathBuf::from(aside);
    let write = || {
        let mut file = std::fs::File::create(&aside)?;
        file.write_all(bytes)?;
        file.sync_all()
    };
    let written = write().map_err(RenderError::io(&aside, "write"));
    let renamed = written
        .and_then(|()| std::fs::rename(&aside, path).map_err(RenderError::io(path, "create")));
    if renamed.is_err() {
        // What cannot be removed either is not worth a second message.
        let _ = std::fs::remove_file(&aside);
    }
    renamed
}
