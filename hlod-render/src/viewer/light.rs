//! The light's direction, as someone before the picture thinks of it.

use crate::camera::Camera;
use crate::scene::{Light, light_from_angles};

/// Azimuth and elevation in degrees relative to the picture: 0, 0 comes from the eye, positive
/// from the right and from above. The light turns with the viewer, so that what a raking light
/// shows keeps being raked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightAngles {
    /// −180 to 180.
    pub azimuth_deg: f64,
    /// −90 to 90.
    pub elevation_deg: f64,
}

/// From the upper left at 45°, as drawings and catalogues have it.
pub const UPPER_LEFT: LightAngles = LightAngles { azimuth_deg: -45.0, elevation_deg: 45.0 };

/// Directions that have a name.
pub const PRESETS: [(&str, LightAngles); 4] = [
    ("Upper left 45°", UPPER_LEFT),
    ("From the eye", LightAngles { azimuth_deg: 0.0, elevation_deg: 0.0 }),
    ("Raking, left", LightAngles { azimuth_deg: -80.0, elevation_deg: 10.0 }),
    ("Raking, above", LightAngles { azimuth_deg: 0.0, elevation_deg: 80.0 }),
];

impl LightAngles {
    /// Brought into range: azimuth wraps, elevation stops.
    pub fn new(azimuth_deg: f64, elevation_deg: f64) -> LightAngles {
        LightAngles {
            azimuth_deg: (azimuth_deg + 180.0).rem_euclid(360.0) - 180.0,
            elevation_deg: elevation_deg.clamp(-90.0, 90.0),
        }
    }

    /// Turned by a drag of so many shares of the picture's smaller side, to the right and down:
    /// the light follows the cursor, and one side is 180°.
    pub fn dragged(self, right: f64, down: f64) -> LightAngles {
        LightAngles::new(self.azimuth_deg + 180.0 * right, self.elevation_deg - 180.0 * down)
    }

    /// The light for a picture of this camera.
    pub fn light(self, camera: &Camera) -> Light {
        light_from_angles(camera, self.azimuth_deg, self.elevation_deg)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::camera::Projection;

    #[test]
    fn upper_left_lies_left_of_and_above_the_eye_whatever_the_view() {
        for eye in [DVec3::new(0.0, 0.0, 5.0), DVec3::new(-3.0, 1.0, 2.0)] {
            let camera = Camera {
                eye,
                target: DVec3::ZERO,
                up: DVec3::Y,
                projection: Projection::Perspective { fov_y: 0.6 },
                near: 0.1,
            };
            let [right, up, back] = camera.axes();
            let Light::Directional(light) = UPPER_LEFT.light(&camera) else { panic!("parallel") };
            assert!((light.dot(right) + 0.5).abs() < 1e-9);
            assert!((light.dot(up) - 0.5f64.sqrt()).abs() < 1e-9);
            assert!((light.dot(back) - 0.5).abs() < 1e-9);
        }
    }

    #[test]
    fn dragging_follows_the_cursor_and_stays_in_range() {
        let centre = LightAngles::new(0.0, 0.0);
        let dragged = centre.dragged(0.25, -0.25);
        assert_eq!((dragged.azimuth_deg, dragged.elevation_deg), (45.0, 45.0));
        assert_eq!(LightAngles::new(170.0, 0.0).dragged(0.25, 0.0).azimuth_deg, -145.0);
        assert_eq!(centre.dragged(0.0, -9.0).elevation_deg, 90.0);
        assert_eq!(centre.dragged(0.0, 9.0).elevation_deg, -90.0);
    }
}
