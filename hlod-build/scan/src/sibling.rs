//! Files that a scan names: found only in its own folder.
//!
//! A document from outside must not reach files outside: a name resolves only within the folder of
//! the document, after links are followed.

use std::fs::File;
use std::path::{Component, Path, PathBuf};

/// Where the file `name` beside (or in a folder beside) `document` really is; a regular file.
///
/// # Errors
/// Says in words, to be put after the name, why there is no such file to be had.
pub(crate) fn find(document: &Path, name: &str) -> Result<PathBuf, String> {
    let components: Vec<_> = Path::new(name).components().collect();
    let is_plain = |c: &Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
    // Backslashes and colons are separators and drives on other systems.
    if components.is_empty() || !components.iter().all(is_plain) || name.contains(['\\', ':', '\0'])
    {
        return Err("lies outside the folder of the document; put it beside the document".into());
    }
    let folder = match document.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let resolve = |path: &Path| path.canonicalize();
    let (Ok(path), Ok(folder)) = (resolve(&folder.join(name)), resolve(folder)) else {
        return Err("is not there; put it beside the document".into());
    };
    if !path.starts_with(&folder) {
        return Err("is a link that leads outside the folder of the document".into());
    }
    // Ask what it is before anything opens it: opening a pipe would wait for a writer.
    let metadata = std::fs::metadata(&path).map_err(|e| format!("cannot be read: {e}"))?;
    if !metadata.is_file() {
        return Err("is not a regular file".into());
    }
    Ok(path)
}

/// Opens such a file; gives it with its size.
///
/// # Errors
/// As [`find`].
pub(crate) fn open(document: &Path, name: &str) -> Result<(File, u64), String> {
    let unreadable = |error: std::io::Error| format!("cannot be read: {error}");
    let file = File::open(find(document, name)?).map_err(unreadable)?;
    let bytes = file.metadata().map_err(unreadable)?.len();
    Ok((file, bytes))
}
