//! The place of the surface that is nearest to a point.

use glam::DVec3;

use super::SurfacePoint;
use crate::error::RenderError;
use crate::leaves::{Leaf, Leaves};

/// The point of the leaves that is nearest to `to` and no farther than `reach`; source coordinates.
/// `None` where there is none. Reads the leaves that could hold it.
///
/// # Errors
/// When the file cannot be read or is damaged.
pub fn nearest_point(
    leaves: &Leaves,
    to: DVec3,
    reach: f64,
) -> Result<Option<SurfacePoint>, RenderError> {
    let apart = |min: DVec3, max: DVec3| to.distance(to.clamp(min, max));
    let mut near = leaves.within(|min, max| apart(min, max) <= reach)?;
    near.sort_by(|a, b| apart(a.min, a.max).total_cmp(&apart(b.min, b.max)));
    let mut best: Option<(f64, SurfacePoint)> = None;
    for leaf in near {
        let far = best.map_or(reach, |(distance, _)| distance);
        if apart(leaf.min, leaf.max) > far {
            break;
        }
        if let Some(found) = nearest_of(leaves, &*leaves.load(&leaf)?, to, far) {
            best = Some(found);
        }
    }
    Ok(best.map(|(_, point)| point))
}

/// The nearest point of one leaf within `far`.
fn nearest_of(
    leaves: &Leaves,
    leaf: &Leaf,
    to: DVec3,
    mut far: f64,
) -> Option<(f64, SurfacePoint)> {
    let (mesh, points) = (&leaf.content.mesh, &leaf.content.points);
    let place = |p: [i32; 3]| leaves.place(p);
    let mut best = None;
    let mut note = |at: DVec3, normal: DVec3, file_bound: f64| {
        let distance = at.distance(to);
        if distance <= far {
            far = distance;
            let (position, normal) = (at.to_array(), normal.to_array());
            let point = SurfacePoint { position, normal, file_bound, pixel_length: None };
            best = Some((distance, point));
        }
    };
    for (position, normal) in points.positions.iter().zip(&points.normals) {
        note(place(*position), DVec3::from_array(normal.decode().map(f64::from)), 0.0);
    }
    for t in &mesh.triangles {
        let corners = t.map(|v| place(mesh.positions[v as usize]));
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        note(closest_on_triangle(to, corners), normal, leaf.at.error);
    }
    best
}

/// The point of a triangle that is nearest to `p`, by the regions in which it can lie (Ericson 2005,
/// *Real-Time Collision Detection*, section 5.1.5, in which the cases are derived).
pub(crate) fn closest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let on_edge = |from: DVec3, to: DVec3| {
        let along = to - from;
        let length = along.length_squared();
        let share = if length > 0.0 { (p - from).dot(along) / length } else { 0.0 };
        from + along * share.clamp(0.0, 1.0)
    };
    let normal = (b - a).cross(c - a);
    let inside = |from: DVec3, to: DVec3| (to - from).cross(p - from).dot(normal) >= 0.0;
    if normal.length_squared() > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
        return p - normal * ((p - a).dot(normal) / normal.length_squared());
    }
    let candidates = [on_edge(a, b), on_edge(b, c), on_edge(c, a)];
    let mut best = candidates[0];
    for candidate in candidates {
        if candidate.distance_squared(p) < best.distance_squared(p) {
            best = candidate;
        }
    }
    best
}
