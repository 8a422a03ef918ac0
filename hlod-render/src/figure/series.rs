//! Several pictures in a folder: all of them or none.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::file::save;
use super::provenance::Provenance;
use super::sheet::{Drawn, Sheet};
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::model::Model;

/// A folder that is being filled, aside; it gets its name when it is complete.
pub struct Series {
    folder: PathBuf,
    aside: PathBuf,
    is_complete: bool,
}

/// Whether a folder may be made.
///
/// # Errors
/// When something is there already, or it would lie in none.
pub fn check_folder(folder: &Path) -> Result<(), RenderError> {
    let refuse = |why: String| Err(RenderError::Usage(format!("{}: {why}", folder.display())));
    if folder.exists() {
        let is_empty = std::fs::read_dir(folder).is_ok_and(|mut all| all.next().is_none());
        if !is_empty {
            return refuse("it is there already, and not an empty folder; name another".into());
        }
    }
    match folder.parent().filter(|p| !p.as_os_str().is_empty()) {
        Some(parent) if !parent.is_dir() => {
            refuse(format!("there is no folder {}", parent.display()))
        }
        _ => Ok(()),
    }
}

impl Series {
    /// Begins a folder that is not there yet or empty.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn begin(folder: &Path) -> Result<Series, RenderError> {
        check_folder(folder)?;
        let mut aside = OsString::from(folder.components().as_path());
        aside.push(".part");
        let aside = PathBuf::from(aside);
        std::fs::create_dir(&aside).map_err(RenderError::io(&aside, "create"))?;
        Ok(Series { folder: folder.to_owned(), aside, is_complete: false })
    }

    /// Draws a page of that name.
    ///
    /// # Errors
    /// When it cannot be drawn or written.
    pub fn save(
        &self,
        name: &str,
        sheet: &Sheet,
        gpu: &Gpu,
        models: &mut [Model],
        provenance: &Provenance,
    ) -> Result<Drawn, RenderError> {
        let path = self.aside.join(name);
        save(sheet, gpu, models, &path, (provenance, None), &mut |_, _| {})
    }

    /// Writes a text beside the pictures.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, name: &str, text: &str) -> Result<(), RenderError> {
        let path = self.aside.join(name);
        std::fs::write(&path, text).map_err(RenderError::io(&path, "write"))
    }

    /// Gives the folder its name.
    ///
    /// # Errors
    /// When something came in the way meanwhile.
    pub fn finish(mut self) -> Result<(), RenderError> {
        if self.folder.is_dir() {
            // Empty, as it was; otherwise this fails.
            std::fs::remove_dir(&self.folder).map_err(RenderError::io(&self.folder, "replace"))?;
        }
        std::fs::rename(&self.aside, &self.folder)
            .map_err(RenderError::io(&self.folder, "create"))?;
        self.is_complete = true;
        Ok(())
    }
}

impl Drop for Series {
    fn drop(&mut self) {
        if !self.is_complete {
            // What failed was said; a folder that cannot be removed either is only in the way.
            let _ = std::fs::remove_dir_all(&self.aside);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_there_when_all_of_it_is() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("all");
        let series = Series::begin(&folder).unwrap();
        series.write("a", "b").unwrap();
        assert!(!folder.exists());
        drop(series);
        assert_eq!(std::fs::read_dir(parent.path()).unwrap().count(), 0);
        let series = Series::begin(&folder).unwrap();
        series.write("a", "b").unwrap();
        series.finish().unwrap();
        assert!(folder.join("a").is_file());
        assert!(check_folder(&folder).unwrap_err().is_usage(), "it is full");
        assert!(check_folder(&parent.path().join("none/all")).is_err());
    }
}
