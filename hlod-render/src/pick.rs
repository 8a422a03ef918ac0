//! Where a ray meets the scan: on the leaves, never on the level that is shown.

use glam::DVec3;

use crate::error::RenderError;
use crate::leaves::{Leaf, LeafRef, Leaves};

/// A point on the scan's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// In source coordinates.
    pub position: DVec3,
    /// Unit normal of the triangle, or of the point's disc, that was met; towards where the ray
    /// came from.
    pub normal: DVec3,
    /// Whether that is the back of it, which closed bodies show only where they are cut open.
    pub is_back: bool,
    /// Distance from the ray's origin in units of its direction's length.
    pub distance: f64,
    /// How far the file's surface may be from the scan's here, in the source's unit; proven for
    /// triangles, 0 for points, which are the scan's own.
    pub error: f64,
}

/// The first point of the leaves' triangles, or points, on the ray from `origin` along `direction`,
/// both in source coordinates; `None` where it meets nothing. Reads the leaves that the ray passes,
/// and waits for them.
///
/// # Errors
/// When the file cannot be read or is damaged.
pub fn first_hit(
    leaves: &Leaves,
    origin: DVec3,
    direction: DVec3,
) -> Result<Option<Hit>, RenderError> {
    let passed = leaves.within(|min, max| enter_box(origin, direction, min, max).is_some())?;
    // In the order in which the ray enters their bounds.
    let mut entered: Vec<(f64, LeafRef)> = passed
        .into_iter()
        .filter_map(|leaf| Some((enter_box(origin, direction, leaf.min, leaf.max)?, leaf)))
        .collect();
    entered.sort_by(|a, b| a.0.total_cmp(&b.0));

    let mut best: Option<Hit> = None;
    for (enter, leaf) in entered {
        if best.is_some_and(|hit| hit.distance <= enter) {
            break;
        }
        let hit = hit_leaf(leaves, &*leaves.load(&leaf)?, origin, direction);
        if let Some(hit) = hit
            && best.is_none_or(|best| hit.distance < best.distance)
        {
            best = Some(hit);
        }
    }
    Ok(best)
}

/// The first point of one leaf on a ray.
fn hit_leaf(leaves: &Leaves, leaf: &Leaf, origin: DVec3, direction: DVec3) -> Option<Hit> {
    let (mesh, points) = (&leaf.content.mesh, &leaf.content.points);
    let step = leaves.header().lattice.step;
    let mut best = f64::INFINITY;
    let mut met = (DVec3::ZERO, 0.0);
    for i in 0..points.len() {
        let normal = DVec3::from_array(points.normals[i].decode().map(f64::from));
        let radius = points.radii[i].steps() * step;
        let centre = leaves.place(points.positions[i]);
        if let Some(t) = hit_disc(origin, direction, centre, normal, radius)
            && t < best
        {
            (best, met) = (t, (normal, 0.0));
        }
    }
    for t in &mesh.triangles {
        let corners = t.map(|v| leaves.place(mesh.positions[v as usize]));
        if let Some(t) = hit_triangle(origin, direction, corners)
            && t < best
        {
            let [a, b, c] = corners;
            (best, met) = (t, ((b - a).cross(c - a).normalize_or_zero(), leaf.at.error));
        }
    }
    let (normal, error) = met;
    let is_back = normal.dot(direction) > 0.0;
    let towards = if is_back { -normal } else { normal };
    best.is_finite().then(|| Hit {
        position: origin + direction * best,
        normal: towards,
        is_back,
        distance: best,
        error,
    })
}

/// Where the ray enters a box, at least 0.
fn enter_box(origin: DVec3, direction: DVec3, min: DVec3, max: DVec3) -> Option<f64> {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        let (a, b) = (min[axis] - origin[axis], max[axis] - origin[axis]);
        if direction[axis] == 0.0 {
            if a > 0.0 || b < 0.0 {
                return None;
            }
            continue;
        }
        let (a, b) = (a / direction[axis], b / direction[axis]);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    // Flat boxes and rounding: a relative hair's breadth.
    (enter <= leave * (1.0 + 1e-12)).then_some(enter)
}

/// Möller & Trumbore 1997, both sides.
fn hit_triangle(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let s = (origin - a) / determinant;
    let u = s.dot(p);
    let q = s.cross(ab);
    let v = direction.dot(q);
    let t = ac.dot(q);
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then_some(t)
}

/// The disc that a point is drawn as, both sides.
fn hit_disc(
    origin: DVec3,
    direction: DVec3,
    centre: DVec3,
    normal: DVec3,
    radius: f64,
) -> Option<f64> {
    let t = normal.dot(centre - origin) / normal.dot(direction);
    let apart = (origin + t * direction).distance(centre);
    (t >= 0.0 && t.is_finite() && apart <= radius).then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_meet_triangles_and_boxes_where_they_should() {
        let t = [DVec3::ZERO, DVec3::X * 2.0, DVec3::Y * 2.0];
        let down = |x, y| hit_triangle(DVec3::new(x, y, 3.0), -DVec3::Z, t);
        assert_eq!(down(0.5, 0.5), Some(3.0));
        assert_eq!(down(1.5, 1.5), None);
        assert_eq!(hit_triangle(DVec3::new(0.5, 0.5, -1.0), -DVec3::Z, t), None);
        let disc = |x, z| {
            hit_disc(DVec3::new(x, 0.0, z), -DVec3::Z, DVec3::ZERO, DVec3::new(0.6, 0.0, 0.8), 2.0)
        };
        assert!((disc(0.0, 3.0).unwrap() - 3.0).abs() < 1e-12);
        // It slopes down to (1.6, 0, −1.2).
        assert!((disc(1.5, 3.0).unwrap() - 4.125).abs() < 1e-12);
        assert_eq!((disc(1.7, 3.0), disc(0.0, -1.0)), (None, None));
        let inside = |o: DVec3, d| enter_box(o, d, DVec3::ZERO, DVec3::ONE);
        assert_eq!(inside(DVec3::new(0.5, 0.5, 3.0), -DVec3::Z), Some(2.0));
        assert_eq!(inside(DVec3::splat(0.5), DVec3::X), Some(0.0));
        assert_eq!(inside(DVec3::new(2.0, 0.5, 0.5), DVec3::X), None);
        assert_eq!(inside(DVec3::new(2.0, 0.5, 0.5), DVec3::Y), None);
    }
}
