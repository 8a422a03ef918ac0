//! Where the viewer stands: always upright, like someone before a turntable.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;

use crate::camera::Camera;
use crate::framing::Framing;

/// A view in the terms in which people move: round something, nearer, further, higher.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// What is looked at, in the picture's middle; world space.
    pub focus: DVec3,
    /// Turn to the right round the statue's up axis, radians; 0 stands before its front.
    pub yaw: f64,
    /// Rise above the horizon, radians, −π/2 to π/2.
    pub pitch: f64,
    /// From the eye to the focus, world units. Parallel views show as much as a perspective one
    /// shows at this distance.
    pub distance: f64,
}

impl Pose {
    /// The pose of a perspective camera. A camera that is rolled comes out upright.
    pub fn from_camera(camera: &Camera, framing: &Framing) -> Pose {
        let [right, up, front] = framing.axes;
        let [camera_right, _, back] = camera.axes();
        let sine = back.dot(up).clamp(-1.0, 1.0);
        let yaw = if sine.abs() > 0.9999 {
            // Seen along the up axis, only what lies to the right tells the turn.
            (-camera_right.dot(front)).atan2(camera_right.dot(right))
        } else {
            back.dot(right).atan2(back.dot(front))
        };
        let distance = camera.eye.distance(camera.target);
        Pose { focus: camera.target, yaw, pitch: sine.asin(), distance }
    }

    /// Unit vectors right, up and backwards in world space.
    pub fn axes(&self, framing: &Framing) -> [DVec3; 3] {
        let [right, up, front] = framing.axes;
        let (sin_yaw, cos_yaw) = self.yaw.sin_cos();
        let (sin_pitch, cos_pitch) = self.pitch.sin_cos();
        let outwards = right * sin_yaw + front * cos_yaw;
        [
            right * cos_yaw - front * sin_yaw,
            up * cos_pitch - outwards * sin_pitch,
            outwards * cos_pitch + up * sin_pitch,
        ]
    }

    /// Position of the eye.
    pub fn eye(&self, framing: &Framing) -> DVec3 {
        self.focus + self.axes(framing)[2] * self.distance
    }

    /// Moves the eye and what it looks at.
    pub fn with_eye(self, eye: DVec3, framing: &Framing) -> Pose {
        Pose { focus: eye - self.axes(framing)[2] * self.distance, ..self }
    }

    /// Looks at something nearer or further on the same line of sight, with the eye in its place.
    pub fn with_distance(self, distance: f64, framing: &Framing) -> Pose {
        let eye = self.eye(framing);
        Pose { distance, ..self }.with_eye(eye, framing)
    }

    /// Turned and risen about a point, which keeps its place in the picture.
    pub fn turned_about(self, pivot: DVec3, yaw: f64, pitch: f64, framing: &Framing) -> Pose {
        let turned = Pose {
            yaw: wrapped(self.yaw + yaw),
            pitch: (self.pitch + pitch).clamp(-FRAC_PI_2, FRAC_PI_2),
            ..self
        };
        let offset = self.focus - pivot;
        let within_view = self.axes(framing).map(|axis| offset.dot(axis));
        let [right, up, back] = turned.axes(framing);
        let offset = right * within_view[0] + up * within_view[1] + back * within_view[2];
        Pose { focus: pivot + offset, ..turned }
    }

    /// On the way to another pose, `share` of it; distances shrink by equal ratios.
    pub fn towards(self, other: Pose, share: f64) -> Pose {
        Pose {
            focus: self.focus.lerp(other.focus, share),
            yaw: wrapped(self.yaw + share * wrapped(other.yaw - self.yaw)),
            pitch: self.pitch + share * (other.pitch - self.pitch),
            distance: self.distance * (other.distance / self.distance).powf(share),
        }
    }
}

/// The same angle within −π to π.
fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}
