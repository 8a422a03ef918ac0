//! Outputs take their name only when they are complete.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::error::BuildError;
use crate::system::set_usual_permissions;

/// Refuses, before any work, an output that would be lost or could not be written.
pub(crate) fn check_output(
    inputs: &[PathBuf],
    output: &Path,
    force: bool,
) -> Result<(), BuildError> {
    if let Ok(existing) = output.canonicalize() {
        if inputs.iter().any(|input| input.canonicalize().is_ok_and(|i| i == existing)) {
            return Err(BuildError::OutputIsInput(output.to_owned()));
        }
        if !existing.is_file() {
            return Err(BuildError::Usage(format!("{}: is not a regular file", output.display())));
        }
        if !force {
            return Err(BuildError::OutputExists(output.to_owned()));
        }
    }
    // A link that leads nowhere, or round in circles, would be replaced by the file.
    if !output.exists() && output.symlink_metadata().is_ok() {
        return Err(BuildError::Usage(format!(
            "{}: is a link that leads nowhere; remove it, or name another file",
            output.display()
        )));
    }
    // Fails now, not after an hour, where the folder is missing or may not be written.
    Aside::create(output).map(drop)
}

/// A file beside its final place; removed unless committed.
pub(crate) struct Aside(tempfile::NamedTempFile);

impl Aside {
    pub(crate) fn create(output: &Path) -> Result<Aside, BuildError> {
        let folder = match output.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let file = tempfile::Builder::new()
            .prefix(".hlod-build-")
            .tempfile_in(folder)
            .map_err(BuildError::io(output, "create a file in its folder"))?;
        Ok(Aside(file))
    }

    pub(crate) fn file(&self) -> &File {
        self.0.as_file()
    }

    /// Syncs the file to disk and gives it its name. Unless that was allowed by `force`, what has got
    /// that name meanwhile stays, and the file is gone.
    pub(crate) fn commit(self, output: &Path, force: bool) -> Result<(), BuildError> {
        self.file().sync_all().map_err(BuildError::io(output, "write"))?;
        set_usual_permissions(self.file()).map_err(BuildError::io(output, "set permissions of"))?;
        if force {
            self.0.persist(output).map_err(|e| BuildError::io(output, "create")(e.error))?;
            return Ok(());
        }
        match self.0.persist_noclobber(output) {
            Ok(_) => Ok(()),
            Err(e) if output.symlink_metadata().is_ok() => {
                drop(e);
                Err(BuildError::OutputExists(output.to_owned()))
            }
            // Some file systems have neither hard links nor a renaming that spares.
            Err(e) => {
                let done = e.file.persist(output).map(drop);
                done.map_err(|e| BuildError::io(output, "create")(e.error))
            }
        }
    }
}

/// Writes a small file: aside and renamed, so that nobody finds half of one. What is no regular file, as
/// a terminal, is written to as it is.
///
/// # Errors
/// When the system refuses.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), BuildError> {
    if path.exists() && !path.is_file() {
        return std::fs::write(path, bytes).map_err(BuildError::io(path, "write"));
    }
    // What a link leads to is written, not the link.
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let aside = Aside::create(&path)?;
    aside.file().write_all(bytes).map_err(BuildError::io(&path, "write"))?;
    aside.commit(&path, true)
}
