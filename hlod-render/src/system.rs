//! What systems do in their own ways: the one place of this crate that tells them apart.

use std::path::{Path, PathBuf};

use crate::error::RenderError;

/// Asks the system to forget what it has of the file in memory; does nothing where it cannot be asked.
#[cfg(target_os = "linux")]
pub(crate) fn drop_file_cache(file: &Path) -> Result<(), RenderError> {
    let opened = std::fs::File::open(file).map_err(RenderError::io(file, "open"))?;
    rustix::fs::fadvise(&opened, 0, None, rustix::fs::Advice::DontNeed)
        .map_err(|e| RenderError::io(file, "drop from the file cache")(e.into()))
}

#[cfg(not(target_os = "linux"))]
pub(crate) fn drop_file_cache(_file: &Path) -> Result<(), RenderError> {
    Ok(())
}

/// Asks a program that was started to end as Ctrl-C would; ends it where it cannot be asked. Not by Ctrl-C's own signal,
/// which programs do not get whose window was started in the background of a shell.
#[cfg(all(unix, feature = "viewer"))]
pub(crate) fn interrupt(child: &mut std::process::Child) {
    let process = i32::try_from(child.id()).ok().and_then(rustix::process::Pid::from_raw);
    if let Some(process) = process {
        // It may have ended by itself; nobody has waited for it, so its number is not another's.
        let _ = rustix::process::kill_process(process, rustix::process::Signal::TERM);
    }
}

#[cfg(all(not(unix), feature = "viewer"))]
pub(crate) fn interrupt(child: &mut std::process::Child) {
    // It may have ended by itself.
    let _ = child.kill();
}

/// A folder that a variable names, unless it is empty.
pub(crate) fn folder_in(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// Where programs keep what their user made and is no document.
pub(crate) fn data_home() -> Option<PathBuf> {
    if cfg!(windows) {
        folder_in("APPDATA")
    } else if cfg!(target_os = "macos") {
        folder_in("HOME").map(|home| home.join("Library/Application Support"))
    } else {
        folder_in("XDG_DATA_HOME").or_else(|| folder_in("HOME").map(|h| h.join(".local/share")))
    }
}

/// Where programs keep what they can get again.
pub(crate) fn cache_home() -> Option<PathBuf> {
    if cfg!(windows) {
        folder_in("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        folder_in("HOME").map(|home| home.join("Library/Caches"))
    } else {
        folder_in("XDG_CACHE_HOME").or_else(|| folder_in("HOME").map(|h| h.join(".cache")))
    }
}
