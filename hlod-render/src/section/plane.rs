//! A plane to cut with, and how a drawing of what it cuts lies in it.

use glam::{DVec2, DVec3};
use hlod_compress::Header;

use crate::error::RenderError;

/// The points with `normal · p = offset`, in source coordinates and the source's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit vector towards the side that sections are seen from.
    pub normal: DVec3,
    /// Distance from the origin along the normal, in the source's unit.
    pub offset: f64,
}

/// Where a drawing of a plane has its origin and its axes, in source coordinates: `u` to the right
/// and `v` up for an eye on the side to which the normal points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// The point of the plane next to the origin of the source's coordinates.
    pub origin: DVec3,
    /// Unit vector to the right.
    pub u: DVec3,
    /// Unit vector up; u × v is the plane's normal.
    pub v: DVec3,
}

/// A plane that is steeper than this against up has up in its drawing: cosine of the angle between
/// them.
const LEVEL: f64 = 1e-3;

/// Three points are no plane when their triangle's height is below this share of its longest edge.
const COLLINEAR: f64 = 1e-9;

impl Plane {
    /// The plane `normal · p = offset` of a normal of any length, as equations are given.
    ///
    /// # Errors
    /// When the normal is zero, or something is not finite.
    pub fn from_equation(normal: DVec3, offset: f64) -> Result<Plane, RenderError> {
        let length = normal.length();
        let plane = Plane { normal: normal / length, offset: offset / length };
        plane.checked()
    }

    /// The plane through a point, perpendicular to `normal`, which may have any length.
    ///
    /// # Errors
    /// When the normal is zero, or something is not finite.
    pub fn at_point(point: DVec3, normal: DVec3) -> Result<Plane, RenderError> {
        let normal = normal / normal.length();
        Plane { normal, offset: normal.dot(point) }.checked()
    }

    /// The plane through three points, seen from where they turn counter-clockwise.
    ///
    /// # Errors
    /// When they lie on a line, or are not finite.
    pub fn through([a, b, c]: [DVec3; 3]) -> Result<Plane, RenderError> {
        let area = (b - a).cross(c - a);
        let longest =
            [b - a, c - a, c - b].map(|e| e.length_squared()).into_iter().fold(0.0, f64::max);
        let height = area.length() / longest;
        // NaN where they are one point.
        if height.is_nan() || height <= COLLINEAR {
            let why = "a plane through three points: they lie on a line";
            return Err(RenderError::Usage(why.into()));
        }
        Plane::at_point((a + b + c) / 3.0, area)
    }

    /// The plane on which the coordinate of `axis` (0, 1 or 2 for x, y or z) is `offset`.
    ///
    /// # Errors
    /// When the offset is not finite.
    pub fn across(axis: usize, offset: f64) -> Result<Plane, RenderError> {
        Plane { normal: DVec3::AXES[axis % 3], offset }.checked()
    }

    /// The plane beside this one, `distance` farther along the normal.
    pub fn moved(&self, distance: f64) -> Plane {
        Plane { offset: self.offset + distance, ..*self }
    }

    /// Signed distance of a point, positive on the side to which the normal points.
    pub fn distance(&self, p: DVec3) -> f64 {
        self.normal.dot(p) - self.offset
    }

    /// Whether any part of a box is on the plane, or within `margin` of it.
    pub fn meets(&self, min: DVec3, max: DVec3, margin: f64) -> bool {
        let reach = 0.5 * (max - min).dot(self.normal.abs());
        self.distance(0.5 * (min + max)).abs() <= reach + margin
    }

    /// Axes of a drawing in which up, or as much of it as there is, points up. In a level plane
    /// right stays right, so that a plan seen from above has the front below.
    pub fn frame(&self, header: &Header) -> Frame {
        let up = DVec3::from_array(header.up.direction());
        let front = DVec3::from_array(header.front.direction());
        let in_plane = |d: DVec3| d - self.normal * self.normal.dot(d);
        let origin = self.normal * self.offset;
        let v = in_plane(up);
        if v.length() > LEVEL {
            let v = v.normalize();
            return Frame { origin, u: v.cross(self.normal), v };
        }
        let right = in_plane(up.cross(front)).normalize_or_zero();
        // A header whose front is its up has no right.
        let u = if right == DVec3::ZERO { self.normal.any_orthonormal_vector() } else { right };
        Frame { origin, u, v: self.normal.cross(u) }
    }

    /// The same plane, if it is one.
    ///
    /// # Errors
    /// When the normal is not a unit vector or the offset not finite.
    pub fn checked(self) -> Result<Plane, RenderError> {
        if self.normal.is_normalized() && self.offset.is_finite() {
            return Ok(self);
        }
        Err(RenderError::Usage(
            "a plane needs a normal that is not zero, and finite numbers".into(),
        ))
    }
}

impl Frame {
    /// A point as the drawing has it, after projection onto the plane; in the source's unit.
    pub fn to_plane(&self, p: DVec3) -> DVec2 {
        DVec2::new((p - self.origin).dot(self.u), (p - self.origin).dot(self.v))
    }

    /// A point of the drawing in source coordinates.
    pub fn to_space(&self, q: DVec2) -> DVec3 {
        self.origin + self.u * q.x + self.v * q.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_what_they_were_made_from() {
        let points =
            [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, -1.0, 3.5), DVec3::new(0.0, 0.0, 9.0)];
        let plane = Plane::through(points).unwrap();
        assert!(points.iter().all(|p| plane.distance(*p).abs() < 1e-12));
        // Seen from where they turn counter-clockwise.
        let turn = (points[1] - points[0]).cross(points[2] - points[0]);
        assert!(plane.normal.dot(turn) > 0.0);
        let same = Plane::from_equation(plane.normal * 5.0, plane.offset * 5.0).unwrap();
        assert!(points.iter().all(|p| same.distance(*p).abs() < 1e-12));
        assert!((plane.moved(2.0).distance(points[0]) + 2.0).abs() < 1e-12);
        assert!(Plane::through([points[0]; 3]).is_err());
        assert!(Plane::through([points[0], points[1], points[0].lerp(points[1], 0.3)]).is_err());
    }

    #[test]
    fn boxes_are_met_where_a_corner_is_on_the_other_side() {
        let plane = Plane::at_point(DVec3::splat(0.9), DVec3::ONE).unwrap();
        assert!(plane.meets(DVec3::ZERO, DVec3::ONE, 0.0));
        assert!(!plane.meets(DVec3::ZERO, DVec3::splat(0.85), 0.0));
        assert!(plane.meets(DVec3::ZERO, DVec3::splat(0.85), 0.1));
    }
}
