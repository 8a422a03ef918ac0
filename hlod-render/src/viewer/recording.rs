//! Recording how someone moved, as a camera path that `bench` can drive along.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glam::DVec3;

use crate::error::RenderError;
use crate::framing::Framing;
use crate::path::{CameraPath, Key};

/// Ten keys a second: curves between them follow a hand.
const INTERVAL: Duration = Duration::from_millis(100);
/// A path of hours is a recording that someone forgot.
const KEYS_MAX: usize = 36_000;

/// A path that is being recorded.
#[derive(Debug, Clone)]
pub struct Recording {
    began: Instant,
    keys: Vec<Key>,
}

impl Recording {
    /// Begins with the view at this moment.
    pub fn begin(now: Instant, framing: &Framing, eye: DVec3, target: DVec3) -> Recording {
        Recording { began: now, keys: vec![key(0.0, framing, eye, target)] }
    }

    /// When the next key is due; `None` when the recording is full.
    pub fn due(&self) -> Option<Instant> {
        let last = self.keys.last().map_or(0.0, |k| k.at_secs);
        let next = self.began + Duration::from_secs_f64(last) + INTERVAL;
        (self.keys.len() < KEYS_MAX).then_some(next)
    }

    /// Notes the view at this moment, if a key is due.
    pub fn sample(&mut self, now: Instant, framing: &Framing, eye: DVec3, target: DVec3) {
        if self.due().is_some_and(|due| now >= due) {
            let at_secs = now.saturating_duration_since(self.began).as_secs_f64();
            self.keys.push(key(at_secs, framing, eye, target));
        }
    }

    /// Duration so far.
    pub fn secs(&self, now: Instant) -> f64 {
        now.saturating_duration_since(self.began).as_secs_f64()
    }

    /// The recorded path; `None` where it is too short to be one.
    pub fn finish(self, name: &str, framing: &Framing, fov_y: f64) -> Option<CameraPath> {
        let duration_secs = self.keys.last()?.at_secs;
        let mut path = CameraPath {
            version: 1,
            name: name.to_owned(),
            purpose: "recorded in the viewer".to_owned(),
            duration_secs,
            peak_speed_heights_per_sec: 0.0,
            fov_y_deg: fov_y.to_degrees(),
            anchor: None,
            keys: self.keys,
        };
        if path.keys.len() < 2 {
            return None;
        }
        // Without an anchor, no file is read.
        let placed = path.place(*framing, Path::new("")).ok()?;
        path.peak_speed_heights_per_sec = placed.peak_speed();
        path.validate().is_ok().then_some(path)
    }
}

fn key(at_secs: f64, framing: &Framing, eye: DVec3, target: DVec3) -> Key {
    // A billionth of a statue is far below a pixel of the closest view.
    let rounded = |p: DVec3| framing.relative(p).map(|c| (c * 1e9).round() / 1e9);
    Key {
        at_secs,
        eye: rounded(eye),
        target: rounded(target),
        eye_anchored: 0.0,
        target_anchored: 0.0,
    }
}

/// Writes a path to the first free name of `NAME-001.json`, `NAME-002.json`, … in `folder`, and
/// names the path after it.
///
/// # Errors
/// When the file cannot be written.
pub fn save_new(folder: &Path, name: &str, mut path: CameraPath) -> Result<PathBuf, RenderError> {
    for number in 1..=999 {
        path.name = format!("{name}-{number:03}");
        let file = folder.join(format!("{}.json", path.name));
        // Whoever else creates it first keeps it.
        let mut opened = match std::fs::File::create_new(&file) {
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => continue,
            other => other.map_err(RenderError::io(&file, "create"))?,
        };
        let text = serde_json::to_string_pretty(&path)
            .map_err(|e| RenderError::Malformed { path: file.clone(), why: e.to_string() })?;
        opened
            .write_all(text.as_bytes())
            .and_then(|()| opened.write_all(b"\n"))
            .map_err(RenderError::io(&file, "write"))?;
        return Ok(file);
    }
    Err(RenderError::Usage(format!("{}: 999 recorded paths are there already", folder.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn framing() -> Framing {
        let at = DVec3::new(10_000.0, 0.0, 0.0);
        Framing::new((at - 5.0, at + 5.0), DVec3::Y, DVec3::Z)
    }

    fn recorded(secs: f64) -> Option<CameraPath> {
        let begin = Instant::now();
        let framing = framing();
        let eye = |t: f64| framing.point([t, 0.0, 2.0]);
        let mut recording = Recording::begin(begin, &framing, eye(0.0), framing.centre);
        // Frames at 37 Hz.
        let frames = (secs * 37.0) as u32;
        for i in 1..=frames {
            let t = f64::from(i) / 37.0;
            recording.sample(begin + Duration::from_secs_f64(t), &framing, eye(t), framing.centre);
        }
        recording.finish("test", &framing, 0.6)
    }

    #[test]
    fn a_recorded_path_is_valid_and_drives_where_the_hand_did() {
        let path = recorded(3.0).unwrap();
        path.validate().unwrap();
        assert!((20..=31).contains(&path.keys.len()), "{}", path.keys.len());
        assert!((path.peak_speed_heights_per_sec - 1.0).abs() < 1e-3);
        let placed = path.place(framing(), Path::new("")).unwrap();
        let eye = framing().relative(placed.camera_at(1.5).eye);
        assert!((eye[0] - 1.5).abs() < 1e-6 && (eye[2] - 2.0).abs() < 1e-6, "{eye:?}");
    }

    #[test]
    fn a_moment_is_no_path() {
        assert!(recorded(0.05).is_none());
    }

    #[test]
    fn nothing_is_overwritten_and_what_is_written_can_be_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let path = recorded(1.0).unwrap();
        let first = save_new(folder.path(), "statue-path", path.clone()).unwrap();
        let before = std::fs::read(&first).unwrap();
        let second = save_new(folder.path(), "statue-path", path).unwrap();
        assert_ne!(first, second);
        assert_eq!(std::fs::read(&first).unwrap(), before);
        let loaded = CameraPath::load(&second).unwrap();
        assert_eq!(loaded.name, "statue-path-002");
    }
}
