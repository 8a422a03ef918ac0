//! Planes that cut the statue open on the screen: what lies on the side to which a plane's normal points
//! is not drawn, and where that shows the inside of a closed body, the cut face is painted instead.
//!
//! A cut face needs no geometry. A line of sight that comes out of what is removed and then meets a
//! surface from behind was inside the body when it passed the plane: what it meets last of the planes
//! is the cut face. Open scans have no inside; their backs are shown.

use glam::{DMat4, DVec3, Mat4, Vec3, Vec4};

use crate::error::RenderError;
use crate::scene::{Shadow, Shot};
use crate::section::Plane;

/// So many planes at most cut the statue at the same time.
pub const PLANES_MAX: usize = 3;

/// Colours of planes and of what they cut, sRGB. People who see fewer colours can tell them apart (Okabe
/// & Ito 2008): orange, sky blue, green.
pub const PLANE_COLOURS: [[u8; 3]; PLANES_MAX] = [[230, 159, 0], [86, 180, 233], [0, 158, 115]];

/// The planes, world space. A place in the list decides a plane's colour.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClipPlanes {
    planes: [Option<Plane>; PLANES_MAX],
}

/// What shaders know of the planes, for one model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ClipUniform {
    /// For each plane c with c · (ndc.xy, depth, 1) > 0 where nothing is drawn; zero for none.
    pub(crate) planes: [Vec4; PLANES_MAX],
    /// Linear light of their cut faces.
    pub(crate) colours: [Vec4; PLANES_MAX],
}

impl ClipPlanes {
    /// Of what a list has, up to [`PLANES_MAX`].
    pub fn new(planes: impl IntoIterator<Item = Option<Plane>>) -> ClipPlanes {
        let mut clip = ClipPlanes::default();
        for (place, plane) in clip.planes.iter_mut().zip(planes) {
            *place = plane;
        }
        clip
    }

    /// The same planes, moved with a statue.
    pub fn moved(&self, by: DVec3) -> ClipPlanes {
        ClipPlanes { planes: self.planes.map(|plane| plane.map(|p| p.moved(p.normal.dot(by)))) }
    }

    /// The same planes of a statue all of whose coordinates are multiplied.
    pub fn scaled(&self, by: f64) -> ClipPlanes {
        let scaled = |p: Plane| Plane { offset: p.offset * by, ..p };
        ClipPlanes { planes: self.planes.map(|plane| plane.map(scaled)) }
    }

    /// Whether everything is drawn.
    pub fn is_none(&self) -> bool {
        self.planes.iter().all(Option::is_none)
    }

    /// Whether a point is not drawn.
    pub fn removes(&self, point: DVec3) -> bool {
        self.planes.iter().flatten().any(|plane| plane.distance(point) > 0.0)
    }

    /// Whether nothing of a box is drawn.
    pub fn removes_all(&self, corners: &[DVec3]) -> bool {
        let beyond = |plane: &Plane| corners.iter().all(|p| plane.distance(*p) > 0.0);
        self.planes.iter().flatten().any(beyond)
    }

    /// From where to where along a ray things are drawn, as multiples of its direction from 0 on;
    /// `None` where nothing is.
    pub fn interval(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let (mut from, mut to) = (0.0f64, f64::INFINITY);
        for plane in self.planes.iter().flatten() {
            let (distance, along) = (plane.distance(origin), plane.normal.dot(direction));
            if along == 0.0 {
                if distance > 0.0 {
                    return None;
                }
            } else if along < 0.0 {
                from = from.max(-distance / along);
            } else {
                to = to.min(-distance / along);
            }
        }
        (from < to).then_some((from, to))
    }

    /// The same planes in a model's space; models may be rotated, moved and scaled uniformly.
    pub(crate) fn in_model(&self, world_from_model: &DMat4) -> ClipPlanes {
        ClipPlanes {
            planes: self.planes.map(|plane| {
                let plane = plane?;
                let row = world_from_model.transpose() * plane.normal.extend(-plane.offset);
                let scale = row.truncate().length();
                Some(Plane { normal: row.truncate() / scale, offset: -row.w / scale })
            }),
        }
    }

    /// Planes as shaders test them: a plane n · p = o of world space is the row (n, −o) · W · M⁻¹ of clip
    /// space, where W takes the model to the world and M to clip space. It is scaled, so that no
    /// number is too large for `f32`.
    pub(crate) fn uniform(&self, clip_from_model: &Mat4, world_from_model: &DMat4) -> ClipUniform {
        let world_from_clip = *world_from_model * clip_from_model.as_dmat4().inverse();
        let planes = self.planes.map(|plane| {
            let Some(plane) = plane else { return Vec4::ZERO };
            let row = world_from_clip.transpose() * plane.normal.extend(-plane.offset);
            (row / row.abs().max_element()).as_vec4()
        });
        let colours = PLANE_COLOURS.map(|srgb| linear_from_srgb(srgb).extend(1.0));
        ClipUniform { planes, colours }
    }
}

/// Whether a shot can be drawn as far as planes decide.
///
/// # Errors
/// When a statue that is cut open is to cast shadows: what is removed would still hide the light.
pub fn check_clip(shot: &Shot) -> Result<(), RenderError> {
    if shot.clip.is_none() || shot.shadow == Shadow::None {
        return Ok(());
    }
    Err(RenderError::Usage(
        "shadows are not drawn of a statue that is cut open; try --shadow none".into(),
    ))
}

fn linear_from_srgb(srgb: [u8; 3]) -> Vec3 {
    Vec3::from_array(srgb.map(|value| {
        let value = f32::from(value) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};

    fn planes() -> ClipPlanes {
        let first = Plane { normal: DVec3::new(0.6, 0.0, 0.8), offset: 1.5 };
        let second = Plane { normal: DVec3::NEG_Y, offset: -0.25 };
        ClipPlanes::new([Some(first), None, Some(second)])
    }

    #[test]
    fn shaders_tell_the_sides_of_a_plane_as_points_do() {
        let projections =
            [Projection::Perspective { fov_y: 0.7 }, Projection::Orthographic { height: 9.0 }];
        // As far from the origin as a scan in a country's coordinates.
        let centre = DVec3::new(3000.0, -200.0, 5000.0);
        let (clip, world_from_model) = (
            ClipPlanes::new(planes().planes.map(|plane| {
                plane.map(|p| Plane { offset: p.offset + p.normal.dot(centre), ..p })
            })),
            DMat4::from_translation(centre),
        );
        for projection in projections {
            let camera = Camera {
                eye: centre + DVec3::new(5.0, 4.0, 9.0),
                target: centre,
                up: DVec3::Y,
                projection,
                near: 0.01,
            };
            let matrix = camera.clip_from_model(world_from_model, 1.5, glam::DVec2::ZERO);
            let uniform = clip.uniform(&matrix, &world_from_model);
            let mut removed = 0;
            for i in 0..1000 {
                let share = |n: u32| f64::from((i * n) % 1009) / 1009.0 * 6.0 - 3.0;
                let p = DVec3::new(share(7), share(101), share(463));
                let seen = matrix.as_dmat4() * p.extend(1.0);
                let at = (seen / seen.w).as_vec4();
                let by_shader = uniform.planes.iter().any(|plane| plane.dot(at) > 0.0);
                let nearest = clip.planes.iter().flatten().map(|c| c.distance(centre + p).abs());
                if nearest.fold(f64::INFINITY, f64::min) > 1e-3 {
                    assert_eq!(by_shader, clip.removes(centre + p), "{projection:?}, {p}");
                }
                removed += u32::from(by_shader);
            }
            assert!((200..800).contains(&removed), "{removed} of 1000");
        }
    }

    #[test]
    fn rays_are_drawn_where_their_points_are() {
        let clip = planes();
        for i in 0..500 {
            let share = |n: u32| f64::from((i * n) % 503) / 503.0 * 6.0 - 3.0;
            let origin = DVec3::new(share(5), share(11), share(71));
            let direction = DVec3::new(share(17), share(29), share(43));
            let interval = clip.interval(origin, direction);
            for step in 1..40 {
                let t = f64::from(step) * 0.05;
                let inside = interval.is_some_and(|(from, to)| (from..to).contains(&t));
                assert_eq!(
                    inside,
                    !clip.removes(origin + direction * t),
                    "{origin} {direction} {t}"
                );
            }
        }
        assert_eq!(
            ClipPlanes::default().interval(DVec3::ZERO, DVec3::X),
            Some((0.0, f64::INFINITY))
        );
    }

    #[test]
    fn boxes_are_removed_when_one_plane_removes_all_of_them() {
        let corners = |at: DVec3| crate::select::corners(at - 0.5, at + 0.5);
        assert!(planes().removes_all(&corners(DVec3::new(3.0, 0.0, 3.0))));
        assert!(!planes().removes_all(&corners(DVec3::new(0.0, 0.5, 0.0))));
        let placed = DMat4::from_scale_rotation_translation(
            DVec3::splat(2.0),
            glam::DQuat::from_rotation_x(0.7),
            DVec3::new(5.0, -3.0, 1.0),
        );
        for p in corners(DVec3::splat(0.4)) {
            let there = placed.transform_point3(p);
            assert_eq!(planes().in_model(&placed).removes(p), planes().removes(there));
        }
        assert!(!ClipPlanes::default().removes_all(&corners(DVec3::ZERO)));
    }
}
