//! Loose ends that belong together although their edges differ.
//!
//! Where a leaf meets finer ones, an edge of its border is one edge on its side and several on
//! theirs, cut at faces that it does not have (T-junctions). Each of these cut points was rounded to
//! the lattice, along the one axis that its two faces leave free: by half a step. Pieces that are
//! cut again add another half each time, so the fine edges stay within a step or two of the coarse
//! one, and the plane meets both, an odd number of times between the same two ends. The points
//! where it does are not farther apart than the edges are, over the sine of the angle at which they
//! meet the plane. Ends are joined only where they can be such a pair.

use glam::DVec3;

use super::crossing::{Cutter, Edge};

/// How far two edges may be apart to be the same border, in lattice steps: half a step for
/// rounding at each of four cuts.
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
    /// Where.
    pub(super) point: DVec3,
}

/// What becomes of loose ends: pairs of their numbers with the gap between them, in the source's
/// unit. Those next to each other are joined first, those whose directions agree before all others.
pub(super) fn join(cutter: &Cutter<'_>, step: f64, loose: &[LooseEnd]) -> Vec<(usize, usize, f64)> {
    let mut borders: Vec<Border> =
        loose.iter().map(|end| Border::of(cutter, JOIN_STEPS * step, end)).collect();
    let Some(axis) = widest_axis(loose) else { return Vec::new() };
    borders.sort_by(|a, b| a.point[axis].total_cmp(&b.point[axis]).then_with(|| a.end.cmp(&b.end)));
    // Ends with a long reach look for those with a short one, on both sides.
    let mut pairs = Vec::new();
    for (i, border) in borders.iter().enumerate() {
        let near = |other: &&Border| (other.point[axis] - border.point[axis]).abs() <= border.reach;
        let before = borders[..i].iter().rev().take(NEIGHBOURS).take_while(near);
        let behind = borders[i + 1..].iter().take(NEIGHBOURS).take_while(near);
        for other in before.chain(behind).filter(|other| border.belongs(other)) {
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

/// A loose end with what its edge says about ends that could be the same border's.
struct Border {
    end: usize,
    point: DVec3,
    /// The edge's first end and its unit direction.
    start: DVec3,
    direction: DVec3,
    length: f64,
    /// How far two edges may be apart.
    apart: f64,
    /// How far from the point the edge is that near to the plane.
    reach: f64,
}

impl Border {
    fn of(cutter: &Cutter<'_>, apart: f64, end: &LooseEnd) -> Border {
        let [start, stop] = end.edge.map(|p| cutter.place(p));
        let length = start.distance(stop);
        let rise = (cutter.height(end.edge[1]) - cutter.height(end.edge[0])).abs();
        let reach = (apart * length / rise).min(length).max(apart);
        let direction = (stop - start) / length.max(f64::MIN_POSITIVE);
        Border { end: end.end, point: end.point, start, direction, length, apart, reach }
    }

    /// Whether another end can be in a piece of this one's edge, or both in pieces of one edge.
    fn belongs(&self, other: &Border) -> bool {
        if other.end == self.end ^ 1 || other.length > self.length {
            return false;
        }
        let along = (other.point - self.start).dot(self.direction);
        let foot = self.start + self.direction * along.clamp(-self.apart, self.length + self.apart);
        foot.distance(other.point) <= self.apart && self.point.distance(other.point) <= self.reach
    }
}

/// The axis along which ends are spread most; `None` without any.
fn widest_axis(loose: &[LooseEnd]) -> Option<usize> {
    let first = loose.first()?.point;
    let (min, max) = loose
        .iter()
        .fold((first, first), |(min, max), end| (min.min(end.point), max.max(end.point)));
    Some((max - min).max_position())
}
