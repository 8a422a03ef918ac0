//! Which pixels of a picture anything is seen in.

use glam::{DVec2, DVec3, Mat4};

use crate::passes::{Rectangle, Targets};

/// The part of the picture in which anything is seen.
pub(crate) struct Seen {
    low: DVec2,
    high: DVec2,
    /// Of the whole picture.
    size: DVec2,
    /// What targets show of it.
    window: [DVec2; 2],
}

impl Seen {
    pub(crate) fn nothing(targets: &Targets) -> Seen {
        let (window, vec) = (targets.window(), |x: u32, y: u32| DVec2::new(x.into(), y.into()));
        let size = vec(window.picture_width, window.picture_height);
        let part = [vec(window.x, window.y), vec(targets.width(), targets.height())];
        Seen { low: size, high: DVec2::ZERO, size, window: part }
    }

    /// Adds a box, and so many pixels round it.
    pub(crate) fn add(&mut self, clip_from_model: &Mat4, min: DVec3, max: DVec3, margin_px: f64) {
        for corner in 0..8 {
            let pick = |i: usize| if corner >> i & 1 == 0 { min[i] } else { max[i] };
            let p = DVec3::new(pick(0), pick(1), pick(2)).as_vec3();
            let clip = *clip_from_model * p.extend(1.0);
            if clip.w <= 0.0 || clip.z > clip.w {
                // Nearer than the near plane: seen anywhere.
                (self.low, self.high) = (DVec2::ZERO, self.size);
                return;
            }
            let ndc = clip.truncate().truncate().as_dvec2() / f64::from(clip.w);
            let pixel = (ndc * DVec2::new(0.5, -0.5) + 0.5) * self.size;
            self.low = self.low.min(pixel - margin_px - 2.0);
            self.high = self.high.max(pixel + margin_px + 2.0);
        }
    }

    pub(crate) fn rectangle(&self) -> Rectangle {
        let [first, size] = self.window;
        let low = (self.low - first).clamp(DVec2::ZERO, size).floor().as_uvec2();
        let high = (self.high - first).clamp(DVec2::ZERO, size).ceil().as_uvec2();
        let extent = high.saturating_sub(low);
        Rectangle { x: low.x, y: low.y, width: extent.x, height: extent.y }
    }
}
