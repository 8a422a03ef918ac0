//! Outputs take their name only when they are complete.

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::error::BuildError;

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

    /// Syncs the file to disk and gives it its name.
    pub(crate) fn commit(self, output: &Path) -> Result<(), BuildError> {
        self.file().sync_all().map_err(BuildError::io(output, "write"))?;
        set_usual_permissions(self.file()).map_err(BuildError::io(output, "set permissions of"))?;
        self.0.persist(output).map_err(|e| e.error).map_err(BuildError::io(output, "create"))?;
        Ok(())
    }
}

/// Temporary files are private; results are as readable as the user's other new files.
#[cfg(unix)]
fn set_usual_permissions(file: &File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let mask = rustix::process::umask(rustix::fs::Mode::empty());
    rustix::process::umask(mask);
    file.set_permissions(std::fs::Permissions::from_mode(0o666 & !mask.bits()))
}

#[cfg(not(unix))]
fn set_usual_permissions(_file: &File) -> std::io::Result<()> {
    Ok(())
}
