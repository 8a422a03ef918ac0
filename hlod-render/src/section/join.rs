//! Loose ends that belong together although their edges differ.
//!
//! Where a leaf meets finer ones, an edge in their common face is one edge on its side and several on
//! theirs, cut at faces that it does not have (T-junctions). Each of these cut points was rounded to
//! the lattice, along the one axis that its two faces leave free: by half a step. Pieces that are
//! cut again add another half each time, so the fine edges stay within a step or two of the coarse
//! one, and the plane meets both sides, an odd number of times between the same two ends. The points
//! where it does are not farther apart than the edges are, over the sine of the angle at which they
//! meet the plane. Ends are joined only where they can be such a pair: both edges lie in one
//! face of both cells, and the shorter along the longer one. A scan's own borders hardly ever do.

use glam::DVec3;

use super::crossing::{Cutter, Edge};

/// How far two edges may be apart to be pieces of one, in lattice steps: half a step for the rounding
/// at each of four cuts.
pub const JOIN_STEPS: f64 = 2.0;

/// How many of its neighbours along the sweep an end looks at: in what is not adversarial two ends
/// share a place.
const NEIGHBOURS: usize = 512;

/// A loose end.
#[derive(Debug, Clone, Copy)]
pub(super) struct LooseEnd {
    /// Its number, as [`super::chain`] counts.
    pub(super) end: usize,
    /// The edge that it is in.
    pub(super) edge: Edge,
    /// Edge of its leaf's cell, in lattice steps.
    pub(super) cell_units: u32,
    /// Where.
    pub(super) point: DVec3,
}

/// What becomes of loose ends: pairs of their numbers with the gap between them, in the source's
/// unit. Those next to each other are joined first, those whose directions agree before all others.
pub(super) fn join(cutter: &Cutter<'_>, step: f64, loose: &[LooseEnd]) -> Vec<(usize, usize, f64)> {
    let mut borders: Vec<Border> =
        loose.iter().filter_map(|end| Border::of(cutter, JOIN_STEPS * step, end)).collect();
    let Some(axis) = widest_axis(&borders) else { return Vec::new() };
    borders.sort_by(|a, b| a.point[axis].total_cmp(&b.point[axis]).then_with(|| a.end.cmp(&b.end)));
    // Ends with a long reach look for those with a short one, on both sides.
    let mut pairs = Vec::new();
    for (i, border) in borders.iter().enumerate() {
        let near = |other: &&Border| (other.point[axis] - border.point[axis]).abs() <= border.reach;
        let before = borders[..i].iter().rev().take(NEIGHBOURS).take_while(near);
        let behind = borders[i + 1..].iter().take(NEIGHBOURS).take_while(near);
        for other in before.chain(behind).filter(|other| border.has_along(other)) {
            let agree = border.end % 2 != other.end % 2;
            let (a, b) = (border.end.min(other.end), border.end.max(other.end));
            pairs.push((!agree, border.point.distance(other.point), a, b));
        }
    }
    pairs.sort_by(|x, y| {
        x.0.cmp(&y.0).then(x.1.total_cmp(&y.1)).then_with(|| (x.2, x.3).cmp(&(y.2, y.3)))
    });
    let mut taken = std::collections::HashSet::new();
    let mut joined = Vec::new();
    for (_, gap, a, b) in pairs {
        if !taken.contains(&a) && !taken.contains(&b) {
            taken.extend([a, b]);
            joined.push((a, b, gap));
        }
    }
    joined
}

/// A loose end in a face of its cell, with what its edge says about others that could be the same
/// edge's.
struct Border {
    end: usize,
    point: DVec3,
    /// The faces that the edge lies in: where they are on each axis, in lattice steps.
    faces: [Option<i32>; 3],
    /// The edge's ends, its length and its direction.
    ends: [DVec3; 2],
    length: f64,
    direction: DVec3,
    /// How far two edges may be apart.
    apart: f64,
    /// How far from the point the edge is that near to the plane.
    reach: f64,
}

impl Border {
    /// `None` where the edge is in no face of the cell.
    fn of(cutter: &Cutter<'_>, apart: f64, end: &LooseEnd) -> Option<Border> {
        let [p, q] = end.edge;
        let units = i64::from(end.cell_units.max(1));
        let is_face = |axis: usize| p[axis] == q[axis] && i64::from(p[axis]) % units == 0;
        let faces = [0, 1, 2].map(|axis| is_face(axis).then_some(p[axis]));
        if faces == [None; 3] {
            return None;
        }
        let ends = end.edge.map(|p| cutter.place(p));
        let length = ends[0].distance(ends[1]);
        let rise = (cutter.height(q) - cutter.height(p)).abs();
        let reach = (apart * length / rise).min(length).max(apart);
        let direction = (ends[1] - ends[0]) / length.max(f64::MIN_POSITIVE);
        let (end, point) = (end.end, end.point);
        Some(Border { end, point, faces, ends, length, direction, apart, reach })
    }

    /// Whether another end's edge can be a piece of this one's, or both pieces of one edge.
    fn has_along(&self, other: &Border) -> bool {
        let in_one_face =
            (0..3).any(|i| self.faces[i].is_some() && self.faces[i] == other.faces[i]);
        if !in_one_face || other.end == self.end ^ 1 || other.length > self.length {
            return false;
        }
        // The other piece may go on where this one ends.
        let beyond = other.length + self.apart;
        let is_along = |p: DVec3| {
            let along = (p - self.ends[0]).dot(self.direction);
            let foot = self.ends[0] + self.direction * along.clamp(-beyond, self.length + beyond);
            foot.distance(p) <= self.apart
        };
        other.ends.into_iter().all(is_along) && self.point.distance(other.point) <= self.reach
    }
}

/// The axis along which ends are spread most; `None` without any.
fn widest_axis(borders: &[Border]) -> Option<usize> {
    let first = borders.first()?.point;
    let (min, max) =
        borders.iter().fold((first, first), |(min, max), b| (min.min(b.point), max.max(b.point)));
    Some((max - min).max_position())
}
