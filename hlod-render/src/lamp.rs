//! A light as someone before the picture thinks of it: where it comes from relative to the picture or to the statue, and
//! how far away it is.

use glam::DVec3;

use crate::camera::Camera;
use crate::framing::Framing;
use crate::scene::{Light, Spot, angles_from_direction, direction_from_angles};
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

/// A light and what it is relative to: to the picture, so that what a raking light shows keeps being raked while the
/// viewer turns; or to the statue, so that its shadows stay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Where it is.
    pub angles: LightAngles,
    /// What that is relative to.
    pub frame: LightFrame,
    /// From the middle of the picture or of the statue, world units; parallel light has none.
    pub distance: Option<f64>,
    /// How wide the cone is in which it shines, in degrees, aimed at that middle; without it, everywhere. Parallel
    /// light has no cone.
    pub spot_deg: Option<f64>,
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

/// The place from which a lamp's distance is counted, and at which it is aimed.
fn middle(frame: LightFrame, camera: &Camera, framing: &Framing) -> DVec3 {
    match frame {
        LightFrame::Picture => camera.target,
        LightFrame::Object => framing.centre,
    }
}

impl Lamp {
    /// Parallel light, relative to the picture.
    pub fn of_picture(angles: LightAngles) -> Lamp {
        Lamp { angles, frame: LightFrame::Picture, distance: None, spot_deg: None }
    }

    /// From the middle towards the light, world space.
    pub fn direction(&self, camera: &Camera, framing: &Framing) -> DVec3 {
        let LightAngles { azimuth_deg, elevation_deg } = self.angles;
        direction_from_angles(self.frame.axes(camera, framing), azimuth_deg, elevation_deg)
    }

    /// The light for a picture of this camera.
    pub fn light(&self, camera: &Camera, framing: &Framing) -> Light {
        let direction = self.direction(camera, framing);
        match self.distance {
            None => Light::Directional(direction),
            Some(distance) => {
                Light::Point(middle(self.frame, camera, framing) + direction * distance)
            }
        }
    }

    /// The cone in which it shines.
    pub fn spot(&self, camera: &Camera, framing: &Framing) -> Option<Spot> {
        let angle_deg = self.spot_deg.filter(|_| self.distance.is_some())?;
        Some(Spot { towards: -self.direction(camera, framing), angle_deg })
    }

    /// Its size as a [`crate::scene::Shot`] has it, where it is seen from the middle under this angle.
    pub fn size(&self, angle_deg: f64) -> f64 {
        let tangent = (angle_deg.min(170.0) / 2.0).to_radians().tan();
        self.distance.map_or(angle_deg, |distance| 2.0 * distance * tangent)
    }

    /// The same light from another direction, of any length: parallel stays parallel, a lamp as far away.
    pub fn towards(
        &self,
        direction: DVec3,
        frame: LightFrame,
        camera: &Camera,
        framing: &Framing,
    ) -> Lamp {
        let direction = direction.normalize_or(framing.axes[2]);
        let (azimuth, elevation) = angles_from_direction(frame.axes(camera, framing), direction);
        Lamp { angles: LightAngles::new(azimuth, elevation), frame, ..*self }
    }

    /// The same light relative to something else: it stays where it is. A cone is aimed at the other middle.
    pub fn relative_to(&self, frame: LightFrame, camera: &Camera, framing: &Framing) -> Lamp {
        if frame == self.frame {
            return *self;
        }
        match self.light(camera, framing) {
            Light::Directional(direction) => self.towards(direction, frame, camera, framing),
            Light::Point(place) => {
                let way = place - middle(frame, camera, framing);
                let lamp = self.towards(way, frame, camera, framing);
                Lamp { distance: Some(way.length().max(f64::MIN_POSITIVE)), ..lamp }
            }
        }
    }

    /// Turned by a drag in the picture, whatever it is relative to.
    pub fn dragged(&self, right: f64, down: f64, camera: &Camera, framing: &Framing) -> Lamp {
        let direction = self.direction(camera, framing);
        let seen = self.towards(direction, LightFrame::Picture, camera, framing);
        let angles = seen.angles.dragged(right, down);
        let turned = Lamp { angles, ..seen }.direction(camera, framing);
        self.towards(turned, self.frame, camera, framing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Projection;

    const UPPER_LEFT: LightAngles = LightAngles { azimuth_deg: -45.0, elevation_deg: 45.0 };

    fn framing() -> Framing {
        Framing::new((DVec3::splat(-1.0), DVec3::ONE), DVec3::Y, DVec3::Z)
    }

    fn camera(eye: DVec3) -> Camera {
        let projection = Projection::Perspective { fov_y: 0.6 };
        Camera { eye, target: DVec3::new(0.1, 0.3, 0.0), up: DVec3::Y, projection, near: 0.1 }
    }

    const EYES: [DVec3; 2] = [DVec3::new(0.1, 0.3, 5.0), DVec3::new(-3.0, 1.0, 2.0)];

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
    fn a_lamp_is_as_far_away_as_it_says_and_stays_there_when_its_frame_changes() {
        let [front, side] = EYES.map(camera);
        let lamp =
            Lamp { distance: Some(2.5), spot_deg: Some(30.0), ..Lamp::of_picture(UPPER_LEFT) };
        let place = |lamp: &Lamp, camera| match lamp.light(camera, &framing()) {
            Light::Point(place) => place,
            other => panic!("{other:?}"),
        };
        let at = place(&lamp, &front);
        assert!((at.distance(front.target) - 2.5).abs() < 1e-12);
        let of_statue = lamp.relative_to(LightFrame::Object, &front, &framing());
        assert!(place(&of_statue, &front).distance(at) < 1e-9);
        assert!(place(&of_statue, &side).distance(at) < 1e-9, "it stays when the viewer turns");
        assert!(place(&lamp, &side).distance(at) > 0.1);
        let back = of_statue.relative_to(LightFrame::Picture, &front, &framing());
        assert!((back.distance.unwrap() - 2.5).abs() < 1e-9);
        // The cone is aimed at the middle, and a lamp is as large as it looks from there.
        let spot = lamp.spot(&front, &framing()).unwrap();
        assert!((at + spot.towards * 2.5).distance(front.target) < 1e-9);
        assert!((lamp.size(90.0) - 5.0).abs() < 1e-9);
        let parallel = Lamp { distance: None, ..lamp };
        assert!(parallel.spot(&front, &framing()).is_none() && parallel.size(3.0) == 3.0);
        // Dragged it is as far away as before.
        let dragged = of_statue.dragged(0.2, 0.1, &front, &framing());
        assert_eq!(dragged.distance, of_statue.distance);
        assert!(place(&dragged, &front).distance(at) > 0.1);
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
