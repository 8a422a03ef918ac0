//! Polygons into triangles.
//!
//! A quad is cut along the shorter of its valid diagonals; larger polygons lose one
//! ear after the other (based on: G. H. Meisters, *Polygons have ears*, 1975). A fan
//! would do for convex polygons only: in a concave one its triangles leave the
//! polygon and overlap. Polygons of scans are slightly warped, so that "inside" is
//! decided in the plane across their area vector. One that crosses itself has no
//! right answer; it still yields corners − 2 triangles.

use std::io;

use glam::{DVec2, DVec3};

use crate::report::ScanReport;

/// Most corners of one polygon. Cutting ears takes up to the cube of their number, so
/// a damaged count must not grow into hours of work; at this one it is a second.
pub(crate) const CORNERS_MAX: usize = 1024;

/// Triangulates one face of a file and counts it in the report.
pub(crate) fn add_face(
    corners: &[u32],
    position: impl FnMut(u32) -> io::Result<DVec3>,
    triangles: &mut Vec<[u32; 3]>,
    report: &mut ScanReport,
) -> io::Result<()> {
    let before = triangles.len();
    triangulate(corners, position, triangles)?;
    report.faces_read += 1;
    report.polygons_triangulated += u64::from(corners.len() > 3);
    report.degenerate_faces += u64::from(triangles.len() == before);
    Ok(())
}

/// Appends the triangles of the polygon `corners`, wound as it is; `position` of a
/// corner's index is only asked for polygons of four and more corners.
///
/// Corners that repeat their predecessor are dropped first; so is every triangle that
/// repeats an index. Nothing is appended if fewer than three corners are left.
fn triangulate(
    corners: &[u32],
    mut position: impl FnMut(u32) -> io::Result<DVec3>,
    triangles: &mut Vec<[u32; 3]>,
) -> io::Result<()> {
    let mut push = |triangle: [u32; 3]| {
        if !repeats_corner(triangle) {
            triangles.push(triangle);
        }
    };
    // Nearly every face of a scan is a triangle: no detours for it.
    if let [a, b, c] = *corners {
        push([a, b, c]);
        return Ok(());
    }
    let mut ring = corners.to_vec();
    ring.dedup();
    while ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
    }
    match *ring.as_slice() {
        [] | [_] | [_, _] => {}
        [a, b, c] => push([a, b, c]),
        [a, b, c, d] => {
            let positions = [position(a)?, position(b)?, position(c)?, position(d)?];
            cut_quad([a, b, c, d], positions).into_iter().for_each(push);
        }
        _ => {
            let positions = ring.iter().map(|index| position(*index));
            let positions: Vec<DVec3> = positions.collect::<io::Result<_>>()?;
            cut_ears(&flatten(&positions), |corners| {
                push(corners.map(|corner| ring[corner]));
            });
        }
    }
    Ok(())
}

/// Whether two corners are the same vertex.
pub(crate) fn repeats_corner([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}

/// A triangle strip being read: after two corners, each further one makes a triangle
/// with the two before it. Every other triangle is wound the other way, so that its
/// first two corners change places.
#[derive(Default)]
pub(crate) struct Strip {
    /// The two corners before, and how many there are of them.
    window: [u32; 2],
    held: u8,
    is_odd: bool,
}

impl Strip {
    /// Takes the next corner; gives the triangle that it completes.
    pub(crate) fn add(&mut self, corner: u32, report: &mut ScanReport) -> Option<[u32; 3]> {
        let [a, b] = self.window;
        self.window = [b, corner];
        if self.held < 2 {
            report.strips += u64::from(self.held == 0);
            self.held += 1;
            return None;
        }
        let triangle = match self.is_odd {
            true => [b, a, corner],
            false => [a, b, corner],
        };
        self.is_odd = !self.is_odd;
        if repeats_corner(triangle) {
            report.strip_stitches += 1;
            return None;
        }
        Some(triangle)
    }

    /// Begins a new strip, whose first triangle is wound as written again.
    pub(crate) fn restart(&mut self) {
        *self = Strip::default();
    }
}

/// A diagonal is valid if both triangles face the way the quad does; a concave quad
/// has only one such.
fn cut_quad([a, b, c, d]: [u32; 4], p: [DVec3; 4]) -> [[u32; 3]; 2] {
    let along_ac = [[a, b, c], [a, c, d]];
    let along_bd = [[b, c, d], [b, d, a]];
    let area = (p[2] - p[0]).cross(p[3] - p[1]);
    let faces_along =
        |i: usize, j: usize, k: usize| (p[j] - p[i]).cross(p[k] - p[i]).dot(area) > 0.0;
    let ac_valid = faces_along(0, 1, 2) && faces_along(0, 2, 3);
    let bd_valid = faces_along(1, 2, 3) && faces_along(1, 3, 0);
    let ac_shorter = p[0].distance_squared(p[2]) <= p[1].distance_squared(p[3]);
    match (ac_valid, bd_valid) {
        (true, false) => along_ac,
        (false, true) => along_bd,
        _ if ac_shorter => along_ac,
        _ => along_bd,
    }
}

/// Drops the axis along which the polygon's area vector (Newell's) is longest, such
/// that the flat polygon runs counter-clockwise.
fn flatten(positions: &[DVec3]) -> Vec<DVec2> {
    // Relative to one corner: far from the origin the products would cancel.
    let origin = positions[0];
    let next = positions.iter().cycle().skip(1);
    let area: DVec3 =
        positions.iter().zip(next).map(|(p, q)| (*p - origin).cross(*q - origin)).sum();
    let axis = area.abs().max_position();
    let forward = area[axis] >= 0.0;
    positions
        .iter()
        .map(|position| {
            let p = *position - origin;
            let (u, v) = match axis {
                0 => (p.y, p.z),
                1 => (p.z, p.x),
                _ => (p.x, p.y),
            };
            if forward { DVec2::new(u, v) } else { DVec2::new(v, u) }
        })
        .collect()
}

/// Cuts ears off a counter-clockwise polygon until a triangle is left; calls `push`
/// with each triangle's corner numbers.
fn cut_ears(points: &[DVec2], mut push: impl FnMut([usize; 3])) {
    let mut ring: Vec<usize> = (0..points.len()).collect();
    let mut start = 0;
    while ring.len() > 3 {
        let count = ring.len();
        // Begin where the last ear was: neighbouring corners become ears next. If a
        // polygon that crosses itself has no ear, take a convex corner, or any.
        let candidates = || (0..count).map(|step| (start + step) % count);
        let ear = candidates()
            .find(|i| is_ear(points, &ring, *i))
            .or_else(|| candidates().find(|i| turn(points, around(&ring, *i)) > 0.0))
            .unwrap_or(start % count);
        push(around(&ring, ear));
        ring.remove(ear);
        start = ear;
    }
    push([ring[0], ring[1], ring[2]]);
}

/// The corner at place `i` of the ring between its neighbours.
fn around(ring: &[usize], i: usize) -> [usize; 3] {
    let count = ring.len();
    [ring[(i + count - 1) % count], ring[i], ring[(i + 1) % count]]
}

/// Twice the signed area of a triangle; positive if it turns left.
fn turn(points: &[DVec2], [a, b, c]: [usize; 3]) -> f64 {
    (points[b] - points[a]).perp_dot(points[c] - points[a])
}

/// A corner is an ear if it is convex and no other corner lies in its triangle.
fn is_ear(points: &[DVec2], ring: &[usize], i: usize) -> bool {
    let triangle @ [a, b, c] = around(ring, i);
    if turn(points, triangle) <= 0.0 {
        return false;
    }
    let tip = [points[a], points[b], points[c]];
    ring.iter().all(|other| {
        // A vertex visited twice (a polygon with a hole joined by a slit) is no obstacle.
        tip.contains(&points[*other])
            || turn(points, [a, b, *other]) < 0.0
            || turn(points, [b, c, *other]) < 0.0
            || turn(points, [c, a, *other]) < 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_of(points: &[DVec3], triangles: &[[u32; 3]]) -> (f64, f64) {
        let areas = triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| points[i as usize]);
            (b - a).cross(c - a).z / 2.0
        });
        areas.fold((0.0, f64::INFINITY), |(sum, least), a| (sum + a, least.min(a)))
    }

    fn cut(points: &[DVec3]) -> Vec<[u32; 3]> {
        let corners: Vec<u32> = (0..points.len() as u32).collect();
        let mut triangles = Vec::new();
        triangulate(&corners, |i| Ok(points[i as usize]), &mut triangles).unwrap();
        triangles
    }

    fn flat(points: &[(f64, f64)]) -> Vec<DVec3> {
        points.iter().map(|p| DVec3::new(p.0, p.1, 0.0)).collect()
    }

    #[test]
    fn a_dart_is_cut_at_its_dent() {
        // Corner 2 is the dent, so that only the diagonal 0–2 stays inside.
        let dart = flat(&[(0.0, 0.0), (4.0, -1.0), (1.0, 0.0), (4.0, 1.0)]);
        for turned in 0..4 {
            let mut points = dart.clone();
            points.rotate_left(turned);
            let (sum, least) = area_of(&points, &cut(&points));
            assert!((sum - 1.0).abs() < 1e-12 && least > 0.0, "turned {turned}");
        }
    }

    #[test]
    fn a_convex_quad_is_cut_along_its_shorter_diagonal() {
        let points = flat(&[(-5.0, 0.0), (0.0, -1.0), (5.0, 0.0), (0.0, 1.0)]);
        assert_eq!(cut(&points), [[1, 2, 3], [1, 3, 0]]);
    }

    #[test]
    fn combs_keep_their_area_in_every_plane() {
        // A comb of many teeth: a fan of it would overlap.
        let mut comb = Vec::new();
        for tooth in 0..40 {
            let x = f64::from(tooth);
            comb.extend([(x, 0.0), (x + 0.5, 10.0)]);
        }
        comb.extend([(40.0, 0.0), (40.0, 11.0), (0.0, 11.0)]);
        // Counter-clockwise along the teeth, then back along the top.
        let points = flat(&comb);
        let triangles = cut(&points);
        assert_eq!(triangles.len(), points.len() - 2);
        let (sum, least) = area_of(&points, &triangles);
        assert!((sum - (440.0 - 200.0)).abs() < 1e-9, "area {sum}");
        assert!(least > 0.0);

        // Mapped into the other coordinate planes and mirrored the cuts stay valid.
        for shuffle in [
            |p: DVec3| DVec3::new(p.z, p.x, p.y),
            |p: DVec3| DVec3::new(p.y, p.z, p.x),
            |p: DVec3| DVec3::new(p.y, p.x, p.z) + 1e6,
        ] {
            let moved: Vec<DVec3> = points.iter().map(|p| shuffle(*p)).collect();
            let total: f64 = cut(&moved)
                .iter()
                .map(|t| {
                    let [a, b, c] = t.map(|i| moved[i as usize]);
                    (b - a).cross(c - a).length() / 2.0
                })
                .sum();
            assert!((total - 240.0).abs() < 1e-3, "area {total}");
        }
    }

    #[test]
    fn repeated_corners_vanish_and_knots_end() {
        let points = flat(&[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]);
        let mut triangles = Vec::new();
        triangulate(&[0, 0, 1, 1, 0], |i| Ok(points[i as usize]), &mut triangles).unwrap();
        assert!(triangles.is_empty());
        triangulate(&[0, 1, 1, 2, 0], |i| Ok(points[i as usize]), &mut triangles).unwrap();
        assert_eq!(triangles, [[0, 1, 2]]);
        // A five-pointed star that crosses itself, and five times the same point.
        let star: Vec<DVec3> = (0..5)
            .map(|i| f64::from(i * 2) * std::f64::consts::TAU / 5.0)
            .map(|angle| DVec3::new(angle.cos(), angle.sin(), 0.0))
            .collect();
        assert_eq!(cut(&star).len(), 3);
        assert_eq!(cut(&[DVec3::ONE; 5]).len(), 3);
    }
}
