//! What a person set once and keeps for every statue; and what was opened last.
//!
//! A file of its own in the user's data folder, as sessions belong to statues. Nothing in it is needed: where
//! it cannot be read the program begins as if there were none, and says so.

use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::mapping::Mapping;
use super::settings::Settings;
use crate::error::RenderError;
use crate::files::write_whole;
use crate::session::user_folder;
use crate::source::is_address;

/// Larger files are no preferences.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// So many files are remembered.
pub const RECENT_MAX: usize = 10;
/// Of this program; other versions' are read as far as they are understood.
const VERSION: u32 = 1;
/// How large letters may be, relative to what the system asks for.
pub const UI_SCALES: std::ops::RangeInclusive<f32> = 0.6..=3.0;

/// What survives the window.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Preferences {
    /// See [`VERSION`].
    pub version: u32,
    /// Files and addresses opened, the last one first.
    pub recent: Vec<PathBuf>,
    /// Which button of the mouse does what.
    pub mapping: Mapping,
    /// Size of letters and buttons, 1 as the system has them.
    pub ui_scale: f32,
    /// τ at rest in pixels.
    pub error_threshold_px: Option<f64>,
    /// What a frame may take while moving, in milliseconds.
    pub frame_target_ms: Option<f64>,
    /// Whether the panel is shown; by the window's width where nobody said.
    pub panel_open: Option<bool>,
}

impl Default for Preferences {
    fn default() -> Self {
        Preferences {
            version: VERSION,
            recent: Vec::new(),
            mapping: Mapping::default(),
            ui_scale: 1.0,
            error_threshold_px: None,
            frame_target_ms: None,
            panel_open: None,
        }
    }
}

impl Preferences {
    /// Those that were saved last, and why they could not be read where they could not.
    pub fn load() -> (Preferences, Option<RenderError>) {
        let Some(path) = path() else { return Default::default() };
        match read(&path) {
            Ok(preferences) => (preferences, None),
            Err(error) => (Preferences::default(), Some(error)),
        }
    }

    /// Puts a file at the head of those that were opened.
    pub fn note_opened(&mut self, file: &Path) {
        let file = if is_address(file) {
            file.to_owned()
        } else {
            std::path::absolute(file).unwrap_or_else(|_| file.to_owned())
        };
        self.recent.retain(|known| *known != file);
        self.recent.insert(0, file);
        self.recent.truncate(RECENT_MAX);
    }

    /// Takes over what was set in the panel; what the command line said and nobody changed is not kept.
    pub fn follow(&mut self, now: &Settings, before: &Settings) {
        if now.error_threshold_px != before.error_threshold_px {
            self.error_threshold_px = Some(now.error_threshold_px);
        }
        if now.frame_target_ms != before.frame_target_ms {
            self.frame_target_ms = Some(now.frame_target_ms);
        }
        if now.panel_open != before.panel_open {
            self.panel_open = Some(now.panel_open);
        }
    }

    /// Saves them; files that another window has opened meanwhile are kept behind one's own.
    ///
    /// # Errors
    /// When there is no place for them.
    pub fn save(&self) -> Result<(), RenderError> {
        let Some(path) = path() else { return Ok(()) };
        let mut all = self.clone();
        // What cannot be read is replaced: that was said when it was found.
        for other in read(&path).unwrap_or_default().recent {
            if !all.recent.contains(&other) && all.recent.len() < RECENT_MAX {
                all.recent.push(other);
            }
        }
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(RenderError::io(folder, "create"))?;
        }
        let failed = RenderError::io(&path, "write");
        let text = serde_json::to_vec_pretty(&all).map_err(|e| failed(e.into()))?;
        write_whole(&path, &text)
    }

    /// Within what makes sense, whatever the file says.
    fn checked(mut self) -> Preferences {
        let usable = |v: &f64, from: f64, to: f64| v.is_finite() && (from..=to).contains(v);
        self.version = VERSION;
        self.recent.truncate(RECENT_MAX);
        self.error_threshold_px = self.error_threshold_px.filter(|v| usable(v, 0.05, 64.0));
        self.frame_target_ms = self.frame_target_ms.filter(|v| usable(v, 1.0, 10_000.0));
        if !UI_SCALES.contains(&self.ui_scale) {
            self.ui_scale = 1.0;
        }
        self
    }
}

/// `viewer.json` in the user's folder.
fn path() -> Option<PathBuf> {
    Some(user_folder()?.join("viewer.json"))
}

fn read(path: &Path) -> Result<Preferences, RenderError> {
    let file = match std::fs::File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Default::default()),
        Err(error) => return Err(RenderError::io(path, "open")(error)),
    };
    let mut bytes = Vec::new();
    file.take(FILE_BYTES_MAX).read_to_end(&mut bytes).map_err(RenderError::io(path, "read"))?;
    let malformed = |why: String| RenderError::Malformed {
        path: path.to_owned(),
        why: format!("{why}; begun anew"),
    };
    let read: Preferences =
        serde_json::from_slice(&bytes).map_err(|e| malformed(format!("no preferences: {e}")))?;
    Ok(read.checked())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_opened_comes_first_and_once() {
        let mut preferences = Preferences::default();
        for i in 0..2 * RECENT_MAX {
            preferences.note_opened(Path::new(&format!("/statues/{}.hlod", i % 12)));
        }
        assert_eq!(preferences.recent.len(), RECENT_MAX);
        assert_eq!(preferences.recent[0], Path::new("/statues/7.hlod"));
        let mut once = preferences.recent.clone();
        once.sort();
        once.dedup();
        assert_eq!(once.len(), RECENT_MAX);
    }

    #[test]
    fn what_makes_no_sense_is_as_if_it_were_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("viewer.json");
        assert_eq!(read(&file).unwrap(), Preferences::default());
        let text = r#"{"version": 9, "ui_scale": 1e9, "error_threshold_px": -4, "later": true,
            "frame_target_ms": 40, "mapping": "blender"}"#;
        std::fs::write(&file, text).unwrap();
        let expected = Preferences {
            frame_target_ms: Some(40.0),
            mapping: Mapping::Blender,
            ..Preferences::default()
        };
        assert_eq!(read(&file).unwrap(), expected);
        std::fs::write(&file, "{").unwrap();
        assert!(read(&file).unwrap_err().to_string().contains("begun anew"));
    }
}
