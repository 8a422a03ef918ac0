//! Lights that have a name, and light that rakes a place of the surface.

use glam::DVec3;

use crate::camera::Camera;
use crate::lamp::LightAngles;
use crate::scene::direction_from_angles;

/// From the upper left at 45°, as drawings and catalogues have it.
pub const UPPER_LEFT: LightAngles = LightAngles { azimuth_deg: -45.0, elevation_deg: 45.0 };

/// Directions that have a name, relative to the picture.
pub const PRESETS: [(&str, LightAngles); 4] = [
    ("Upper left 45°", UPPER_LEFT),
    ("From the eye", LightAngles { azimuth_deg: 0.0, elevation_deg: 0.0 }),
    ("Raking, left", LightAngles { azimuth_deg: -80.0, elevation_deg: 10.0 }),
    ("Raking, above", LightAngles { azimuth_deg: 0.0, elevation_deg: 80.0 }),
];

/// Elevations of raking light over the surface, in degrees.
pub const RAKING_DEG: std::ops::RangeInclusive<f64> = 2.0..=30.0;
/// How far a key turns a raking light.
const SWEEP_DEG: f64 = 10.0;

/// Light that rakes one place of the surface: it turns round the normal there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Raking {
    /// Unit normal of the place, and a unit vector along the surface from which azimuth counts.
    normal: DVec3,
    along: DVec3,
    /// Counter-clockwise for who looks at the place.
    pub azimuth_deg: f64,
    /// Above the surface, within [`RAKING_DEG`].
    pub elevation_deg: f64,
}

impl Raking {
    /// From the picture's left at 10° over a place with this normal.
    pub fn new(normal: DVec3, camera: &Camera) -> Raking {
        let [right, up, _] = camera.axes();
        let flat = |v: DVec3| (v - normal * v.dot(normal)).try_normalize();
        let along =
            flat(right).or_else(|| flat(up)).unwrap_or_else(|| normal.any_orthonormal_vector());
        Raking { normal, along, azimuth_deg: 180.0, elevation_deg: 10.0 }
    }

    /// Turned by a key's step.
    pub fn swept(self, steps: f64) -> Raking {
        let azimuth_deg = (self.azimuth_deg + SWEEP_DEG * steps).rem_euclid(360.0);
        Raking { azimuth_deg, ..self }
    }

    /// Towards the light, world space.
    pub fn direction(&self) -> DVec3 {
        let axes = [self.normal.cross(self.along), self.normal, self.along];
        direction_from_angles(axes, self.azimuth_deg, self.elevation_deg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Projection;

    fn camera(eye: DVec3) -> Camera {
        let projection = Projection::Perspective { fov_y: 0.6 };
        Camera { eye, target: DVec3::ZERO, up: DVec3::Y, projection, near: 0.1 }
    }

    const EYE: DVec3 = DVec3::new(0.0, 0.0, 5.0);

    #[test]
    fn raking_light_keeps_its_elevation_over_the_surface_all_round() {
        let normal = DVec3::new(0.3, -0.2, 0.9).normalize();
        let mut raking = Raking::new(normal, &camera(EYE));
        let first = raking.direction();
        assert!(first.dot(DVec3::X) < -0.8, "from the left: {first}");
        for _ in 0..36 {
            let elevation = raking.direction().dot(normal).asin().to_degrees();
            assert!((elevation - 10.0).abs() < 1e-9, "{elevation}");
            raking = raking.swept(1.0);
        }
        assert!(raking.direction().distance(first) < 1e-9, "once round");
        assert!(raking.swept(1.0).direction().distance(first) > 0.1);
    }
}
