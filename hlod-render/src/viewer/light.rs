//! The light's direction, as someone before the picture thinks of it.

use glam::DVec3;

use crate::camera::Camera;
use crate::framing::Framing;
use crate::scene::{Light, angles_from_direction, direction_from_angles};
use crate::session::LightFrame;

/// Azimuth and elevation in degrees: 0, 0 comes from the eye, or from the statue's front, positive
/// from the right and from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightAngles {
    /// −180 to 180.
    pub azimuth_deg: f64,
    /// −90 to 90.
    pub elevation_deg: f64,
}

/// A light and what its angles are relative to: to the picture, so that what a raking light shows
/// keeps being raked while the viewer turns; or to the statue, so that its shadows stay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Where it is.
    pub angles: LightAngles,
    /// What that is relative to.
    pub frame: LightFrame,
}

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
}

impl Lamp {
    /// Relative to the picture.
    pub fn of_picture(angles: LightAngles) -> Lamp {
        Lamp { angles, frame: LightFrame::Picture }
    }

    /// Towards the light, world space.
    pub fn direction(&self, camera: &Camera, framing: &Framing) -> DVec3 {
        let LightAngles { azimuth_deg, elevation_deg } = self.angles;
        direction_from_angles(self.frame.axes(camera, framing), azimuth_deg, elevation_deg)
    }

    /// The light for a picture of this camera.
    pub fn light(&self, camera: &Camera, framing: &Framing) -> Light {
        Light::Directional(self.direction(camera, framing))
    }

    /// A light from this direction.
    pub fn of_direction(
        direction: DVec3,
        frame: LightFrame,
        camera: &Camera,
        framing: &Framing,
    ) -> Lamp {
        let (azimuth, elevation) = angles_from_direction(frame.axes(camera, framing), direction);
        Lamp { angles: LightAngles::new(azimuth, elevation), frame }
    }

    /// The same light relative to something else.
    pub fn relative_to(&self, frame: LightFrame, camera: &Camera, framing: &Framing) -> Lamp {
        if frame == self.frame {
            return *self;
        }
        Lamp::of_direction(self.direction(camera, framing), frame, camera, framing)
    }

    /// Turned by a drag in the picture, whatever it is relative to.
    pub fn dragged(&self, right: f64, down: f64, camera: &Camera, framing: &Framing) -> Lamp {
        let seen = self.relative_to(LightFrame::Picture, camera, framing);
        let angles = seen.angles.dragged(right, down);
        Lamp::of_picture(angles).relative_to(self.frame, camera, framing)
    }
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

    fn framing() -> Framing {
        Framing::new((DVec3::splat(-1.0), DVec3::ONE), DVec3::Y, DVec3::Z)
    }

    fn camera(eye: DVec3) -> Camera {
        let projection = Projection::Perspective { fov_y: 0.6 };
        Camera { eye, target: DVec3::ZERO, up: DVec3::Y, projection, near: 0.1 }
    }

    const EYES: [DVec3; 2] = [DVec3::new(0.0, 0.0, 5.0), DVec3::new(-3.0, 1.0, 2.0)];

    #[test]
    fn upper_left_lies_left_of_and_above_the_eye_whatever_the_view() {
        for eye in EYES {
            let camera = camera(eye);
            let [right, up, back] = camera.axes();
            let light = Lamp::of_picture(UPPER_LEFT).direction(&camera, &framing());
            assert!((light.dot(right) + 0.5).abs() < 1e-9);
            assert!((light.dot(up) - 0.5f64.sqrt()).abs() < 1e-9);
            assert!((light.dot(back) - 0.5).abs() < 1e-9);
        }
    }

    #[test]
    fn a_light_of_the_statue_stays_when_the_viewer_turns_and_changing_frames_moves_nothing() {
        let [front, side] = EYES.map(camera);
        let of_picture = Lamp::of_picture(LightAngles::new(-70.0, 20.0));
        let of_statue = of_picture.relative_to(LightFrame::Object, &side, &framing());
        let towards = |lamp: &Lamp, camera| lamp.direction(camera, &framing());
        assert!(towards(&of_statue, &side).distance(towards(&of_picture, &side)) < 1e-12);
        assert!(towards(&of_statue, &side).distance(towards(&of_statue, &front)) < 1e-12);
        assert!(towards(&of_picture, &side).distance(towards(&of_picture, &front)) > 0.1);
        let back = of_statue.relative_to(LightFrame::Picture, &side, &framing());
        assert!((back.angles.azimuth_deg + 70.0).abs() < 1e-9);
        // A drag does the same to both.
        let dragged = |lamp: &Lamp| lamp.dragged(0.1, 0.05, &side, &framing());
        let (a, b) = (dragged(&of_picture), dragged(&of_statue));
        assert!(towards(&a, &side).distance(towards(&b, &side)) < 1e-9);
        assert_eq!(b.frame, LightFrame::Object);
    }

    #[test]
    fn raking_light_keeps_its_elevation_over_the_surface_all_round() {
        let normal = DVec3::new(0.3, -0.2, 0.9).normalize();
        let mut raking = Raking::new(normal, &camera(EYES[0]));
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
