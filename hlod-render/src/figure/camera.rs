//! Cameras of drawings: parallel, with the statue in the middle.

use glam::{DVec2, DVec3};

use crate::camera::{Camera, Projection};
use crate::framing::Framing;

/// Part of a picture's half that stays free round what is fitted.
const MARGIN: f64 = 0.04;

/// A parallel camera that looks at the centre of the bounds from a direction (world space); the
/// picture's height shows `height` world units.
pub fn orthographic(framing: &Framing, back: DVec3, up: DVec3, height: f64) -> Camera {
    let back = back.normalize_or(DVec3::Z);
    let (low, high) = framing.bounds;
    // What lies up to four times this far before or behind the centre shows.
    let distance = (high - low).length().max(f64::MIN_POSITIVE);
    Camera {
        eye: framing.centre + back * distance,
        target: framing.centre,
        up,
        projection: Projection::Orthographic { height },
        near: distance * 1e-3,
    }
}

/// Width and height of the bounds as a camera sees them in parallel projection, world units.
pub fn extent(framing: &Framing, camera: &Camera) -> DVec2 {
    let [right, up, _] = camera.axes();
    // A box is symmetric: corners reach as far one way as the other.
    DVec2::new(2.0 * framing.reach(right), 2.0 * framing.reach(up))
}

/// The same camera, parallel, and so that all of the bounds is in the picture with a margin.
pub fn fitting(framing: &Framing, camera: &Camera, aspect: f64) -> Camera {
    let size = extent(framing, camera);
    let height = size.y.max(size.x / aspect).max(f64::MIN_POSITIVE) * (1.0 + MARGIN);
    orthographic(framing, camera.axes()[2], camera.up, height)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_fitted_is_in_the_picture_and_not_much_smaller() {
        let bounds = (DVec3::new(-1.0, 2.0, -3.0), DVec3::new(5.0, 12.0, 1.0));
        let framing = Framing::new(bounds, DVec3::Y, DVec3::Z);
        for (aspect, back) in [(1.5, DVec3::Z), (0.5, DVec3::X), (1.0, DVec3::new(0.6, 0.2, 0.7))] {
            let camera = orthographic(&framing, back, DVec3::Y, 1.0);
            let camera = fitting(&framing, &camera, aspect);
            let clip = camera.clip_from_view(aspect) * camera.view_from_world();
            let mut most: f64 = 0.0;
            for i in 0..8 {
                let pick = |a: usize| if i >> a & 1 == 1 { bounds.1[a] } else { bounds.0[a] };
                let p = clip.project_point3(DVec3::new(pick(0), pick(1), pick(2)));
                most = most.max(p.x.abs()).max(p.y.abs());
                assert!((0.0..=1.0).contains(&p.z));
            }
            assert!((0.95..=1.0).contains(&most), "{most}");
        }
    }
}
