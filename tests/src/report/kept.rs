//! Measurements that outlive a run that is interrupted: `report --resume` goes on where it stopped.
//!
//! A measurement is known by its command lines, by the programs that ran and by the files that they were
//! given: where any of them has changed, it is made again.

use std::cell::Cell;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::error::ReportError;

/// A folder with a file for each measurement.
#[derive(Debug, Clone)]
pub(super) struct Kept {
    folder: PathBuf,
    /// Checksums of the programs.
    programs: [u32; 2],
    made: Cell<usize>,
    found: Cell<usize>,
}

impl Kept {
    /// Opens the folder; what earlier runs left there is removed unless it is to be gone on with.
    pub(super) fn open(
        folder: PathBuf,
        programs: [u32; 2],
        goes_on: bool,
    ) -> Result<Kept, ReportError> {
        if !goes_on && folder.exists() {
            std::fs::remove_dir_all(&folder).map_err(ReportError::io(&folder, "remove"))?;
        }
        std::fs::create_dir_all(&folder).map_err(ReportError::io(&folder, "create"))?;
        Ok(Kept { folder, programs, made: Cell::new(0), found: Cell::new(0) })
    }

    /// What was measured under this key, or is now.
    pub(super) fn or_measure(
        &self,
        key: &[&[std::ffi::OsString]],
        measure: impl FnOnce() -> Result<Vec<Value>, ReportError>,
    ) -> Result<Vec<Value>, ReportError> {
        let key = json!({ "programs": self.programs, "commands": key.iter().map(|line| described(line)).collect::<Vec<_>>() });
        let file =
            self.folder.join(format!("{:08x}.json", crc32fast::hash(key.to_string().as_bytes())));
        if let Some(values) = stored(&file, &key) {
            self.found.set(self.found.get() + values.len());
            return Ok(values);
        }
        let values = measure()?;
        self.made.set(self.made.get() + values.len());
        let text = json!({ "key": key, "values": values }).to_string();
        hlod_build::write_whole(&file, text.as_bytes())
            .map_err(|error| ReportError::unexpected(file.display(), error))?;
        Ok(values)
    }

    /// How many outputs of programs were found, and how many there are.
    pub(super) fn counts(&self) -> (usize, usize) {
        (self.found.get(), self.found.get() + self.made.get())
    }
}

/// What is in the file, if it is of this key.
fn stored(file: &Path, key: &Value) -> Option<Vec<Value>> {
    let mut stored: Value = serde_json::from_slice(&std::fs::read(file).ok()?).ok()?;
    let Value::Array(values) = stored.get_mut("values")?.take() else { return None };
    (stored.get("key") == Some(key)).then_some(values)
}

/// A command line's words; of those that are files also how long and how old they are.
fn described(line: &[std::ffi::OsString]) -> Vec<Value> {
    let word = |word: &std::ffi::OsString| {
        let name = word.to_string_lossy();
        let Ok(about) = std::fs::metadata(word) else { return json!(name) };
        let since = |time: std::time::SystemTime| time.duration_since(std::time::UNIX_EPOCH).ok();
        let age = about.modified().ok().and_then(since).map(|time| time.as_nanos().to_string());
        json!([name, about.len(), age])
    };
    line.iter().map(word).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_measured_stays_until_programs_commands_or_files_change() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("model");
        std::fs::write(&model, "1").unwrap();
        let open = |program, goes_on| {
            Kept::open(folder.path().join("kept"), [program, 7], goes_on).unwrap()
        };
        let runs = Cell::new(0);
        let measure = |kept: &Kept, word: &str| {
            let line = ["bench".into(), model.clone().into_os_string(), word.into()];
            let run = || {
                runs.set(runs.get() + 1);
                Ok(vec![json!(runs.get())])
            };
            kept.or_measure(&[&line], run).unwrap()[0].as_u64().unwrap()
        };
        let kept = open(1, false);
        assert_eq!((measure(&kept, "a"), measure(&kept, "b"), measure(&kept, "a")), (1, 2, 1));
        assert_eq!(kept.counts(), (1, 3));
        assert_eq!(measure(&open(1, true), "b"), 2);
        std::fs::write(&model, "22").unwrap();
        assert_eq!(measure(&open(1, true), "b"), 3);
        assert_eq!(measure(&open(2, true), "b"), 4);
        assert_eq!(measure(&open(2, false), "b"), 5);
        // What is cut off is measured again.
        let files = std::fs::read_dir(folder.path().join("kept")).unwrap();
        files.for_each(|file| std::fs::write(file.unwrap().path(), "{").unwrap());
        assert_eq!(measure(&open(2, true), "b"), 6);
    }
}
