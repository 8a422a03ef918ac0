//! Bounds the distance from a triangle to a surface, and how its look differs there, by halving.

use glam::DVec3;

use super::surface::{Difference, Foot, Look, Surface};

/// How much a bound may exceed a distance that is attained somewhere.
pub(super) const SLACK: f64 = 1.05;

/// A triangle is looked into no further than this many pieces.
const PIECES_MAX: u32 = 1 << 18;

/// A point of the triangle with the point of the other surface that it is matched with.
#[derive(Clone, Copy)]
pub(super) struct Corner {
    pub(super) position: DVec3,
    pub(super) look: Look,
    pub(super) foot: Foot,
    /// Of the other surface, at the foot.
    pub(super) foot_look: Look,
}

impl Corner {
    pub(super) fn new(position: DVec3, look: Look, foot: Foot, to: &Surface) -> Corner {
        Corner { position, look, foot, foot_look: to.look_at(&foot) }
    }
}

/// What is known of one triangle or of a part of it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Bound {
    /// No point is farther from its match.
    pub(super) distance: f64,
    /// No point looks more different from its match.
    pub(super) difference: Difference,
}

/// The search for bounds of one triangle after another.
pub(super) struct Search<'a> {
    pub(super) to: &'a Surface,
    /// The largest distance found at some point, or the tolerance.
    pub(super) attained: f64,
    /// A point farther than this is a failure.
    pub(super) limit: f64,
    /// Feet up to this distance need not be the closest ones: any are good for a bound.
    pub(super) near: f64,
    pending: Vec<[Corner; 3]>,
}

/// A point over the limit.
pub(super) struct OverLimit;

impl<'a> Search<'a> {
    pub(super) fn new(to: &'a Surface, tolerance: f64, limit: f64, near: f64) -> Search<'a> {
        Search { to, attained: tolerance, limit, near, pending: Vec::new() }
    }

    /// Bounds one triangle; `matched(triangle of the other surface)` is told every match.
    pub(super) fn bound(
        &mut self,
        corners: [Corner; 3],
        mut matched: impl FnMut(u32),
    ) -> Result<Bound, OverLimit> {
        let mut out = Bound::default();
        self.pending.clear();
        self.pending.push(corners);
        let mut pieces = 0;
        while let Some(piece) = self.pending.pop() {
            let highest = piece.iter().map(|c| c.foot.distance).fold(0.0, f64::max);
            // What is not a number is over any limit.
            let over = |c: &Corner| c.foot.distance.is_nan() || c.foot.distance > self.limit;
            if piece.iter().any(over) {
                return Err(OverLimit);
            }
            self.attained = self.attained.max(highest);
            let enough = (self.attained * SLACK).min(self.limit);
            let (longest, edge) = longest_edge(&piece);

            if let Some(bound) = self.to_one_triangle(&piece, enough, &mut matched) {
                out.distance = out.distance.max(bound.distance);
                out.difference = out.difference.max(bound.difference);
                continue;
            }
            let around = highest + longest / 3f64.sqrt();
            // Where the limit leaves no slack above what is attained, halving would never end.
            pieces += 1;
            let crumb = longest < self.attained * 1e-3 || pieces > PIECES_MAX;
            if around <= enough || crumb && around <= self.limit {
                piece.iter().for_each(|c| matched(c.foot.triangle));
                out.distance = out.distance.max(around);
                out.difference = out.difference.max(to_corners(&piece));
                continue;
            }
            if crumb {
                return Err(OverLimit);
            }

            // Halve the longest edge.
            let (a, b, c) = (piece[edge], piece[(edge + 1) % 3], piece[(edge + 2) % 3]);
            let middle = self.between(&a, &b);
            self.pending.push([a, middle, c]);
            self.pending.push([middle, b, c]);
        }
        Ok(out)
    }

    fn between(&self, a: &Corner, b: &Corner) -> Corner {
        let position = (a.position + b.position) * 0.5;
        let look = Look::mix([a.look, b.look, a.look], [0.5, 0.5, 0.0]);
        let mut foot = self.to.foot_on(position, a.foot.triangle);
        if b.foot.triangle != foot.triangle {
            let other = self.to.foot_on(position, b.foot.triangle);
            foot = if other.distance < foot.distance { other } else { foot };
        }
        if foot.distance > 0.5 * self.near && self.near > 0.0 {
            foot = self.to.walk(position, foot);
        }
        if foot.distance > self.near {
            foot = self.to.closest(position, foot.triangle);
        }
        Corner::new(position, look, foot, self.to)
    }

    /// Matches the whole piece with one triangle, if that is near enough.
    fn to_one_triangle(
        &self,
        piece: &[Corner; 3],
        enough: f64,
        matched: &mut impl FnMut(u32),
    ) -> Option<Bound> {
        for candidate in 0..3 {
            let triangle = piece[candidate].foot.triangle;
            if piece[..candidate].iter().any(|c| c.foot.triangle == triangle) {
                continue;
            }
            let mut bound = Bound::default();
            let mut all_near = true;
            for corner in piece {
                let (distance, look) = if corner.foot.triangle == triangle {
                    (corner.foot.distance, corner.foot_look)
                } else {
                    let foot = self.to.foot_on(corner.position, triangle);
                    (foot.distance, self.to.look_at(&foot))
                };
                all_near = distance <= enough;
                if !all_near {
                    break;
                }
                bound.distance = bound.distance.max(distance);
                bound.difference = bound.difference.max(corner.look.difference(&look));
            }
            if all_near {
                matched(triangle);
                return Some(bound);
            }
        }
        None
    }
}

/// Each point matched with the foot of its nearest corner.
fn to_corners(piece: &[Corner; 3]) -> Difference {
    let mut within = Difference::default();
    let mut across = Difference::default();
    for (i, corner) in piece.iter().enumerate() {
        within = within.max(corner.look.difference(&piece[(i + 1) % 3].look));
        across = across.max(corner.look.difference(&corner.foot_look));
    }
    within.plus(across)
}

/// Length of the longest edge, and the corner at which it starts.
fn longest_edge(piece: &[Corner; 3]) -> (f64, usize) {
    let mut best = (-1.0, 0);
    for i in 0..3 {
        let length2 = piece[i].position.distance_squared(piece[(i + 1) % 3].position);
        if length2 > best.0 {
            best = (length2, i);
        }
    }
    (best.0.sqrt(), best.1)
}
