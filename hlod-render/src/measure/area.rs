//! How much surface a closed line encloses.
//!
//! Seen along the line's mean normal, the line is a polygon; what of the surface lies behind that
//! polygon and hangs together with the line's own points is what it encloses. So the back of a statue
//! does not count with its front, and what bulges or is undercut inside counts in full.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use super::SurfacePoint;
use super::nearest::closest_on_triangle;
use crate::error::RenderError;
use crate::leaves::Leaves;

/// Lines with more corners are refused: whether they cross themselves is looked for pair by pair.
const CORNERS_MAX: usize = 10_000;

/// What a closed line encloses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Enclosed {
    /// Of the surface, in the source's unit squared.
    pub area: f64,
    /// Of the polygon itself, as seen along its normal.
    pub flat_area: f64,
    /// Triangles of the scan, whole and cut.
    pub triangles: usize,
}

/// The area of the surface inside the closed line through `points`. Reads the leaves behind it.
///
/// # Errors
/// When the file cannot be read or holds points, the line crosses itself or encloses nothing, or its
/// points are not on the surface.
pub fn enclosed_area(leaves: &Leaves, points: &[SurfacePoint]) -> Result<Enclosed, RenderError> {
    if leaves.header().points_input > 0 {
        return Err(usage("surface-area: a point cloud has no surface".into()));
    }
    let outline = Outline::new(points).map_err(usage)?;
    let patch = Patch::gather(leaves, &outline)?;
    let tolerance = |p: &SurfacePoint| 2.0 * p.file_bound + 4.0 * leaves.header().lattice.step;
    let seeds: Vec<(DVec3, f64)> = points.iter().map(|p| (p.place(), tolerance(p))).collect();
    patch.enclosed(&seeds, &outline).ok_or_else(|| {
        usage("surface-area: the line's points are not on the surface that it encloses".into())
    })
}

fn usage(why: String) -> RenderError {
    RenderError::Usage(why)
}

/// A closed line as seen along its normal.
struct Outline {
    /// To the right and upwards as seen against the normal, and the normal.
    axes: [DVec3; 3],
    /// A point that heights and places are counted from.
    origin: DVec3,
    corners: Vec<DVec2>,
    /// The same area in triangles.
    pieces: Vec<[DVec2; 3]>,
    low: DVec2,
    high: DVec2,
    /// Along the normal, beyond which nothing counts.
    heights: (f64, f64),
    flat_area: f64,
}

impl Outline {
    fn new(points: &[SurfacePoint]) -> Result<Outline, String> {
        if points.len() > CORNERS_MAX {
            return Err(format!("surface-area: more than {CORNERS_MAX} corners"));
        }
        let places: Vec<DVec3> = points.iter().map(SurfacePoint::place).collect();
        let origin = places[0];
        let next = |i: usize| places[(i + 1) % places.len()];
        let newell: DVec3 =
            (0..places.len()).map(|i| (places[i] - origin).cross(next(i) - origin)).sum();
        let nothing =
            "surface-area: the line encloses nothing, or as much to the left as to the right";
        let mut normal = newell.try_normalize().ok_or(nothing)?;
        if points.iter().map(|p| DVec3::from_array(p.normal)).sum::<DVec3>().dot(normal) < 0.0 {
            normal = -normal;
        }
        let right = normal.any_orthonormal_vector();
        let axes = [right, normal.cross(right), normal];
        let flat = |p: DVec3| DVec2::new((p - origin).dot(axes[0]), (p - origin).dot(axes[1]));
        let mut corners: Vec<DVec2> = places.iter().map(|p| flat(*p)).collect();
        corners.dedup();
        if corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        if let Some((i, j)) = crossing(&corners) {
            return Err(format!(
                "surface-area: the line crosses itself: its sides {} and {} meet",
                i + 1,
                j + 1
            ));
        }
        let pieces = triangulated(&corners);
        let flat_area: f64 =
            pieces.iter().map(|[a, b, c]| (b - a).perp_dot(c - a).abs() / 2.0).sum();
        let fold = |pick: fn(DVec2, DVec2) -> DVec2| corners.iter().copied().reduce(pick);
        let (low, high) = (fold(DVec2::min).ok_or(nothing)?, fold(DVec2::max).ok_or(nothing)?);
        let size = (high - low).length();
        if flat_area.is_nan() || flat_area <= 1e-9 * size * size {
            return Err(nothing.into());
        }
        let heights = places.iter().map(|p| (p - origin).dot(normal));
        let (lowest, highest) =
            heights.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        // A dent or a boss is not deeper than its line is wide.
        let heights = (lowest - size, highest + size);
        Ok(Outline { axes, origin, corners, pieces, low, high, heights, flat_area })
    }

    fn flat(&self, p: DVec3) -> DVec2 {
        let from = p - self.origin;
        DVec2::new(from.dot(self.axes[0]), from.dot(self.axes[1]))
    }

    fn height(&self, p: DVec3) -> f64 {
        (p - self.origin).dot(self.axes[2])
    }

    /// Whether a box may hold something of what is behind the polygon.
    fn meets_box(&self, min: DVec3, max: DVec3) -> bool {
        let (centre, half) = ((min + max) / 2.0, (max - min) / 2.0);
        let reach = self.axes.map(|axis| half.dot(axis.abs()));
        let (flat, height) = (self.flat(centre), self.height(centre));
        let reach_flat = DVec2::new(reach[0], reach[1]);
        (flat + reach_flat).cmpge(self.low).all()
            && (flat - reach_flat).cmple(self.high).all()
            && height + reach[2] >= self.heights.0
            && height - reach[2] <= self.heights.1
    }

    /// Whether a point lies within the polygon: an odd number of sides lie to its right.
    fn holds(&self, p: DVec2) -> bool {
        let count = self.corners.len();
        (0..count).fold(false, |inside, i| {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % count]);
            let passes =
                (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x);
            inside != passes
        })
    }

    fn crosses(&self, p: DVec2, q: DVec2) -> bool {
        let count = self.corners.len();
        (0..count).any(|i| segments_meet(p, q, self.corners[i], self.corners[(i + 1) % count]))
    }

    /// The area of what of a triangle lies behind the polygon.
    fn clipped_area(&self, corners: [DVec3; 3]) -> f64 {
        let flat = corners.map(|c| self.flat(c));
        let (low, high) = (flat[0].min(flat[1]).min(flat[2]), flat[0].max(flat[1]).max(flat[2]));
        if low.cmpgt(self.high).any() || high.cmplt(self.low).any() {
            return 0.0;
        }
        self.pieces.iter().map(|piece| self.area_in(corners, piece, low, high)).sum()
    }

    fn area_in(&self, corners: [DVec3; 3], piece: &[DVec2; 3], low: DVec2, high: DVec2) -> f64 {
        let [a, b, c] = *piece;
        if low.cmpgt(a.max(b).max(c)).any() || high.cmplt(a.min(b).min(c)).any() {
            return 0.0;
        }
        // Sutherland & Hodgman 1974, in space: triangles on edge keep their area.
        let turn = (b - a).perp_dot(c - a).signum();
        let mut polygon = corners.to_vec();
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let side = |p: DVec3| turn * (to - from).perp_dot(self.flat(p) - from);
            let mut kept = Vec::with_capacity(polygon.len() + 1);
            for i in 0..polygon.len() {
                let (p, q) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                let (at_p, at_q) = (side(p), side(q));
                if at_p >= 0.0 {
                    kept.push(p);
                }
                if (at_p >= 0.0) != (at_q >= 0.0) {
                    kept.push(p.lerp(q, at_p / (at_p - at_q)));
                }
            }
            polygon = kept;
            if polygon.len() < 3 {
                return 0.0;
            }
        }
        let sum: DVec3 =
            polygon[1..].windows(2).map(|p| (p[0] - polygon[0]).cross(p[1] - polygon[0])).sum();
        sum.length() / 2.0
    }
}

/// The first two sides of a polygon that meet where they should not.
fn crossing(corners: &[DVec2]) -> Option<(usize, usize)> {
    let count = corners.len();
    let side = |i: usize| (corners[i], corners[(i + 1) % count]);
    for i in 0..count {
        for j in i + 2..count {
            // The last side and the first share a corner.
            if (i == 0 && j == count - 1) || !meets(side(i), side(j)) {
                continue;
            }
            return Some((i, j));
        }
    }
    None
}

fn meets((a, b): (DVec2, DVec2), (c, d): (DVec2, DVec2)) -> bool {
    segments_meet(a, b, c, d)
}

fn segments_meet(a: DVec2, b: DVec2, c: DVec2, d: DVec2) -> bool {
    let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
    let (c_side, d_side) = (side(a, b, c), side(a, b, d));
    let (a_side, b_side) = (side(c, d, a), side(c, d, b));
    if c_side == 0.0 && d_side == 0.0 {
        // On one line: they meet where their boxes do.
        return a.min(b).cmple(c.max(d)).all() && c.min(d).cmple(a.max(b)).all();
    }
    (c_side >= 0.0) != (d_side >= 0.0) && (a_side >= 0.0) != (b_side >= 0.0)
}

/// A simple polygon in triangles.
fn triangulated(corners: &[DVec2]) -> Vec<[DVec2; 3]> {
    let mut indices: Vec<u32> = Vec::new();
    earcut::Earcut::new().earcut(corners.iter().map(|c| c.to_array()), &[], &mut indices);
    indices.chunks_exact(3).map(|t| [0, 1, 2].map(|k| corners[t[k] as usize])).collect()
}

/// The scan's triangles that lie at least partly behind a polygon.
struct Patch {
    triangles: Vec<[DVec3; 3]>,
    areas: Vec<f64>,
    /// Which triangles hang together: each leads to another of its part, or to itself.
    parents: Vec<usize>,
}

impl Patch {
    fn gather(leaves: &Leaves, outline: &Outline) -> Result<Patch, RenderError> {
        let mut patch = Patch { triangles: Vec::new(), areas: Vec::new(), parents: Vec::new() };
        let mut at_vertex: HashMap<[i32; 3], usize> = HashMap::new();
        let mut at_edge: HashMap<[[i32; 3]; 2], usize> = HashMap::new();
        for leaf in leaves.within(|min, max| outline.meets_box(min, max))? {
            let leaf = leaves.load(&leaf)?;
            let mesh = &leaf.content.mesh;
            for t in &mesh.triangles {
                let keys = t.map(|v| mesh.positions[v as usize]);
                let corners = keys.map(|key| leaves.place(key));
                let heights = corners.map(|c| outline.height(c));
                let beyond = heights.iter().all(|h| *h < outline.heights.0)
                    || heights.iter().all(|h| *h > outline.heights.1);
                let area = if beyond { 0.0 } else { outline.clipped_area(corners) };
                if area <= 0.0 {
                    continue;
                }
                let number = patch.push(corners, area);
                // Only what they share behind the polygon joins triangles.
                let flat = corners.map(|c| outline.flat(c));
                for i in 0..3 {
                    if outline.holds(flat[i]) {
                        let first = *at_vertex.entry(keys[i]).or_insert(number);
                        patch.join(first, number);
                    }
                    let j = (i + 1) % 3;
                    if outline.crosses(flat[i], flat[j]) {
                        let edge = [keys[i].min(keys[j]), keys[i].max(keys[j])];
                        let first = *at_edge.entry(edge).or_insert(number);
                        patch.join(first, number);
                    }
                }
            }
        }
        Ok(patch)
    }

    fn push(&mut self, corners: [DVec3; 3], area: f64) -> usize {
        self.triangles.push(corners);
        self.areas.push(area);
        self.parents.push(self.parents.len());
        self.parents.len() - 1
    }

    fn root(&mut self, mut i: usize) -> usize {
        while self.parents[i] != i {
            self.parents[i] = self.parents[self.parents[i]];
            i = self.parents[i];
        }
        i
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b)] = a.min(b);
    }

    /// What hangs together with any of the seeds, which are places and how far off they may be.
    fn enclosed(mut self, seeds: &[(DVec3, f64)], outline: &Outline) -> Option<Enclosed> {
        let mut wanted = vec![false; self.triangles.len()];
        for i in 0..self.triangles.len() {
            let [a, b, c] = self.triangles[i];
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let on_it = |(p, far): &(DVec3, f64)| {
                p.distance(p.clamp(low, high)) <= *far
                    && closest_on_triangle(*p, [a, b, c]).distance(*p) <= *far
            };
            if seeds.iter().any(on_it) {
                let root = self.root(i);
                wanted[root] = true;
            }
        }
        let mut enclosed = Enclosed { area: 0.0, flat_area: outline.flat_area, triangles: 0 };
        for i in 0..self.triangles.len() {
            let root = self.root(i);
            if wanted[root] {
                enclosed.area += self.areas[i];
                enclosed.triangles += 1;
            }
        }
        (enclosed.triangles > 0).then_some(enclosed)
    }
}
