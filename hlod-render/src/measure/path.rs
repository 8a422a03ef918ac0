//! The way along the surface from one point to another.

use glam::DVec3;

use super::SurfacePoint;
use crate::error::RenderError;
use crate::leaves::Leaves;
use crate::section::{Line, Plane, cut};

/// The line in which the surface between two of its points meets the plane through both that stands
/// upright on it there: what a tape laid straight from one to the other follows. Not the shortest way
/// (a geodesic), which would wander with every grain; both points are on it.
///
/// # Errors
/// When the file cannot be read, or no surface joins the points in that plane.
pub fn surface_path(
    leaves: &Leaves,
    a: &SurfacePoint,
    b: &SurfacePoint,
) -> Result<Vec<DVec3>, RenderError> {
    let (from, to) = (a.place(), b.place());
    let plane = upright(a, b)
        .ok_or_else(|| usage("surface-length: two of its points are the same, or face opposite"))?;
    // Most ways stay near; those that do not are looked for everywhere.
    let reach = DVec3::splat(from.distance(to));
    let near = (from.min(to) - reach, from.max(to) + reach);
    let tolerance = |p: &SurfacePoint| 2.0 * p.file_bound + 4.0 * leaves.header().lattice.step;
    for within in [Some(near), None] {
        let section = cut(leaves, &plane, within)?;
        let ways = section.lines.iter().filter_map(|line| {
            let [start, end] = [(from, tolerance(a)), (to, tolerance(b))].map(|(point, most)| {
                let (distance, at) = place_on(line, point)?;
                (distance <= most).then_some(at)
            });
            Some(between(line, start?, end?))
        });
        let length = |way: &Vec<DVec3>| way.windows(2).map(|p| p[0].distance(p[1])).sum::<f64>();
        if let Some(way) = ways.min_by(|a, b| length(a).total_cmp(&length(b))) {
            return Ok(way);
        }
    }
    Err(usage("surface-length: no surface joins the points in the plane through both"))
}

fn usage(why: &str) -> RenderError {
    RenderError::Usage(why.to_owned())
}

/// The plane through two points that holds the mean of their normals.
fn upright(a: &SurfacePoint, b: &SurfacePoint) -> Option<Plane> {
    let mean = DVec3::from_array(a.normal) + DVec3::from_array(b.normal);
    let along = b.place() - a.place();
    let normal = along.cross(mean).try_normalize()?;
    Some(Plane { normal, offset: normal.dot(a.place()) })
}

/// Where on a line something is: on which of its segments, and how far along it, 0 to 1.
type At = (usize, f64);

/// The place on a line that is nearest to a point, and how far it is.
fn place_on(line: &Line, point: DVec3) -> Option<(f64, At)> {
    let count = line.points.len();
    let segments = if line.closed { count } else { count.saturating_sub(1) };
    let places = (0..segments).map(|i| {
        let (p, q) = (line.points[i], line.points[(i + 1) % count]);
        let along = q - p;
        let length = along.length_squared();
        let share =
            if length > 0.0 { ((point - p).dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
        ((p + along * share).distance(point), (i, share))
    });
    places.min_by(|a, b| a.0.total_cmp(&b.0))
}

/// The part of a line between two places, the shorter where it is closed.
fn between(line: &Line, start: At, end: At) -> Vec<DVec3> {
    let forwards = walk(line, start, end);
    if !line.closed {
        return forwards.unwrap_or_else(|| walk(line, end, start).unwrap_or_default());
    }
    let length = |way: &[DVec3]| way.windows(2).map(|p| p[0].distance(p[1])).sum::<f64>();
    let ways = [forwards, walk(line, end, start)].into_iter().flatten();
    ways.min_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or_default()
}

/// From one place to another in the line's direction; `None` where an open line ends before.
fn walk(line: &Line, start: At, end: At) -> Option<Vec<DVec3>> {
    let count = line.points.len();
    let at = |(i, share): At| line.points[i].lerp(line.points[(i + 1) % count], share);
    let mut way = vec![at(start)];
    if (start.0, start.1) > (end.0, end.1) || (!line.closed && start.0 > end.0) {
        if !line.closed {
            return None;
        }
        way.extend((start.0 + 1..count).map(|i| line.points[i]));
        way.extend((0..=end.0).map(|i| line.points[i]));
    } else {
        way.extend((start.0 + 1..=end.0).map(|i| line.points[i]));
    }
    way.push(at(end));
    Some(way)
}
