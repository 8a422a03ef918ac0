//! Recorded camera paths, model-relative, so that one serves every statue.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::error::RenderError;
use crate::framing::Framing;
use crate::leaves::Leaves;
use crate::pick::first_hit;

/// A camera path, as in `bench-paths/*.json`.
///
/// Positions are model-relative (see [`Framing`]). A path that goes close to the surface names an
/// anchor: the first point of the scan on a ray. Each key says how far its positions are counted
/// from the statue's centre (0) or from the anchor (1).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// Version of this format.
    pub version: u32,
    /// Its name.
    pub name: String,
    /// What it is for.
    pub purpose: String,
    /// Time from the first key to the last.
    pub duration_secs: f64,
    /// Fastest motion of the eye, in statue heights a second, for a statue whose anchor lies a
    /// quarter of its height before its centre; checked when the path is loaded.
    pub peak_speed_heights_per_sec: f64,
    /// Vertical field of view.
    pub fov_y_deg: f64,
    /// Where the path comes close.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anchor: Option<AnchorRay>,
    /// At least two, in ascending order of time.
    pub keys: Vec<Key>,
}

/// A ray, model-relative.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AnchorRay {
    /// Where it starts.
    pub from: [f64; 3],
    /// A point it passes.
    pub towards: [f64; 3],
}

/// Eye and target at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// Seconds since the path began.
    pub at_secs: f64,
    /// Position of the eye.
    pub eye: [f64; 3],
    /// Where it looks.
    pub target: [f64; 3],
    /// 0: the eye is counted from the centre; 1: from the anchor; in between: from between.
    #[serde(default)]
    pub eye_anchored: f64,
    /// The same for the target.
    #[serde(default)]
    pub target_anchored: f64,
}

const VERSION: u32 = 1;
/// A day. Speeds are sampled along all of it, which would take as long as someone writes here.
const DURATION_SECS_MAX: f64 = 86_400.0;

impl CameraPath {
    /// Reads and checks a path.
    ///
    /// # Errors
    /// When the file cannot be read or does not make sense.
    pub fn load(path: &Path) -> Result<CameraPath, RenderError> {
        // A path of a day at one key a frame is far smaller.
        const BYTES_MAX: u64 = 64 << 20;
        let bytes = std::fs::metadata(path).map_err(RenderError::io(path, "open"))?.len();
        let malformed = |why: String| RenderError::Malformed { path: path.to_owned(), why };
        if bytes > BYTES_MAX {
            return Err(malformed(format!("{bytes} bytes are too many for a camera path")));
        }
        let text = std::fs::read_to_string(path).map_err(RenderError::io(path, "read"))?;
        let parsed: CameraPath =
            serde_json::from_str(&text).map_err(|e| malformed(e.to_string()))?;
        parsed.validate().map_err(malformed)?;
        Ok(parsed)
    }

    /// Says what does not make sense, if anything does not.
    ///
    /// # Errors
    /// A sentence that names the first thing wrong.
    pub fn validate(&self) -> Result<(), String> {
        if self.version != VERSION {
            return Err(format!("version {} of camera paths is not known", self.version));
        }
        if self.keys.len() < 2 {
            return Err("a path needs at least two keys".into());
        }
        let finite = |k: &Key| {
            k.eye
                .iter()
                .chain(&k.target)
                .chain([&k.at_secs, &k.eye_anchored, &k.target_anchored])
                .all(|v| v.is_finite())
        };
        if let Some(i) = self
            .keys
            .iter()
            .position(|k| !finite(k) || k.eye == k.target && k.eye_anchored == k.target_anchored)
        {
            return Err(format!("key {i} is no view"));
        }
        if let Some(i) = self.keys.windows(2).position(|w| w[0].at_secs >= w[1].at_secs) {
            return Err(format!("key {} is not later than the one before", i + 1));
        }
        let (first, last) = (self.keys[0].at_secs, self.keys[self.keys.len() - 1].at_secs);
        if first != 0.0 || (last - self.duration_secs).abs() > 1e-6 {
            return Err(format!("keys run from {first} to {last} s, not from 0 to duration_secs"));
        }
        if self.duration_secs > DURATION_SECS_MAX {
            let secs = self.duration_secs;
            return Err(format!("{secs} s: a path lasts at most {DURATION_SECS_MAX} s"));
        }
        if !(1.0..=170.0).contains(&self.fov_y_deg) {
            return Err(format!("a field of view of {}°", self.fov_y_deg));
        }
        let anchored = self.keys.iter().any(|k| k.eye_anchored != 0.0 || k.target_anchored != 0.0);
        if anchored && self.anchor.is_none() {
            return Err("keys are anchored, but there is no anchor".into());
        }
        if let Some(ray) = self.anchor.filter(|r| {
            r.from == r.towards || r.from.iter().chain(&r.towards).any(|v| !v.is_finite())
        }) {
            return Err(format!("the anchor's ray has no direction: {ray:?}"));
        }
        let unit = Framing::new((DVec3::splat(-0.5), DVec3::splat(0.5)), DVec3::Y, DVec3::Z);
        let peak = self.place_at(unit, DVec3::Z * 0.25).peak_speed();
        if (peak - self.peak_speed_heights_per_sec).abs() > 0.01 * peak + 1e-6 {
            let stated = self.peak_speed_heights_per_sec;
            return Err(format!("its peak speed is {peak:.3} heights a second, not {stated}"));
        }
        Ok(())
    }

    /// Places the path before a model.
    ///
    /// # Errors
    /// When the file cannot be read, or the anchor's ray misses the model.
    pub fn place(&self, framing: Framing, file: &Path) -> Result<PlacedPath, RenderError> {
        let anchor = match self.anchor {
            None => framing.centre,
            Some(ray) => {
                let (from, towards) = (framing.point(ray.from), framing.point(ray.towards));
                let hit = first_hit(&Leaves::open(file)?, from, towards - from)?;
                let hit = hit.ok_or_else(|| {
                    RenderError::Usage(format!(
                        "path {}: its anchor's ray misses {}",
                        self.name,
                        file.display()
                    ))
                })?;
                hit.position
            }
        };
        Ok(self.place_at(framing, anchor))
    }

    fn place_at(&self, framing: Framing, anchor: DVec3) -> PlacedPath {
        let place =
            |p: [f64; 3], anchored: f64| framing.centre.lerp(anchor, anchored) + framing.vector(p);
        let times = self.keys.iter().map(|k| k.at_secs).collect();
        let eyes = self.keys.iter().map(|k| place(k.eye, k.eye_anchored)).collect();
        let targets = self.keys.iter().map(|k| place(k.target, k.target_anchored)).collect();
        PlacedPath { framing, fov_y_deg: self.fov_y_deg, times, eyes, targets }
    }
}

/// A path in a model's world space.
#[derive(Debug, Clone)]
pub struct PlacedPath {
    framing: Framing,
    fov_y_deg: f64,
    times: Vec<f64>,
    eyes: Vec<DVec3>,
    targets: Vec<DVec3>,
}

impl PlacedPath {
    /// The camera at a moment, by cubic Hermite curves through the keys (Catmull & Rom 1974, with
    /// tangents by finite differences over unequal times).
    pub fn camera_at(&self, secs: f64) -> Camera {
        let eye = hermite(&self.times, &self.eyes, secs);
        let target = hermite(&self.times, &self.targets, secs);
        self.framing.camera(eye, target, self.fov_y_deg)
    }

    /// Fastest motion of the eye, in statue heights a second, sampled at 240 Hz.
    pub fn peak_speed(&self) -> f64 {
        const HZ: f64 = 240.0;
        let duration = self.times.last().copied().unwrap_or(0.0);
        let eye = |i: u32| hermite(&self.times, &self.eyes, f64::from(i) / HZ);
        let steps = (duration * HZ) as u32;
        let longest = (0..steps).map(|i| eye(i).distance(eye(i + 1))).fold(0.0, f64::max);
        longest * HZ / self.framing.height
    }
}

fn hermite(times: &[f64], points: &[DVec3], at: f64) -> DVec3 {
    let last = times.len() - 1;
    let i = times.partition_point(|&t| t <= at).clamp(1, last) - 1;
    let slope = |k: usize| {
        let (a, b) = (k.saturating_sub(1), (k + 1).min(last));
        (points[b] - points[a]) / (times[b] - times[a])
    };
    let span = times[i + 1] - times[i];
    let s = ((at - times[i]) / span).clamp(0.0, 1.0);
    let (s2, s3) = (s * s, s * s * s);
    points[i] * (2.0 * s3 - 3.0 * s2 + 1.0)
        + slope(i) * span * (s3 - 2.0 * s2 + s)
        + points[i + 1] * (3.0 * s2 - 2.0 * s3)
        + slope(i + 1) * span * (s3 - s2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path() -> CameraPath {
        let key = |at_secs, x| Key {
            at_secs,
            eye: [x, 0.0, 2.0],
            target: [0.0; 3],
            eye_anchored: 0.0,
            target_anchored: 0.0,
        };
        CameraPath {
            version: 1,
            name: "test".into(),
            purpose: "a straight line at constant speed".into(),
            duration_secs: 4.0,
            peak_speed_heights_per_sec: 0.5,
            fov_y_deg: 40.0,
            anchor: None,
            keys: vec![key(0.0, -1.0), key(1.0, -0.5), key(4.0, 1.0)],
        }
    }

    fn framing() -> Framing {
        Framing::new((DVec3::splat(-5.0), DVec3::splat(5.0)), DVec3::Y, DVec3::Z)
    }

    #[test]
    fn keys_on_a_line_at_constant_speed_stay_there() {
        let placed = path().place(framing(), Path::new("unused")).unwrap();
        for t in [0.0, 0.3, 1.0, 2.7, 4.0, 9.0] {
            let expected = DVec3::new(-10.0 + 5.0 * f64::min(t, 4.0), 0.0, 20.0);
            assert!(placed.camera_at(t).eye.distance(expected) < 1e-9, "at {t}");
        }
        assert!((placed.peak_speed() - 0.5).abs() < 1e-6);
    }

    #[test]
    fn paths_that_make_no_sense_are_refused() {
        path().validate().unwrap();
        let broken: [fn(&mut CameraPath); 10] = [
            |p| p.peak_speed_heights_per_sec = 2.0,
            |p| p.version = 2,
            |p| p.keys.truncate(1),
            |p| p.keys[1].at_secs = 0.0,
            |p| p.keys[1].eye[0] = f64::NAN,
            |p| p.keys[1].eye = p.keys[1].target,
            |p| p.duration_secs = 5.0,
            |p| {
                p.duration_secs = 1e12;
                p.keys[2].at_secs = 1e12;
                p.peak_speed_heights_per_sec = 0.5;
            },
            |p| p.fov_y_deg = 180.0,
            |p| p.keys[0].eye_anchored = 1.0,
        ];
        for (i, breaking) in broken.into_iter().enumerate() {
            let mut p = path();
            breaking(&mut p);
            assert!(p.validate().is_err(), "breakage {i}");
        }
    }
}
