//! An upper bound of the two-sided Hausdorff distance between two triangle meshes.
//!
//! Based on: Guthe, Borodin & Klein, *Fast and accurate Hausdorff distance calculation between
//! meshes* (2005), and Tang, Lee & Kim, *Interactive Hausdorff distance computation for general
//! polygonal models* (2009). Deviation: bounds come from convexity instead of regions.
//!
//! # Why the bound holds
//!
//! One-sided, from A to B: for each triangle of A a number is found that no point of it exceeds.
//! - The distance to *one* triangle of B is a convex function, because that triangle is a convex
//!   set. A convex function on a triangle is largest at a corner. So with `t` any triangle of B,
//!   `max over corners p of d(p, t)` bounds `d(·, B) ≤ d(·, t)` on the whole triangle.
//! - The distance to B is 1-Lipschitz. So `max over corners d(p, B)` plus the largest distance
//!   from a point of the triangle to its nearest corner (at most longest edge / √3 for any
//!   triangle) bounds it too.
//!
//! A piece whose bound exceeds what is already known to be attained is halved at its longest
//! edge until one of the two bounds is within [`SLACK`] of an attained distance. The result
//! therefore exceeds the true maximum by at most that factor.
//!
//! Floating point: coordinates are integers below 2³¹, so differences are exact in f64 and each
//! computed squared distance is off by a relative 10⁻¹⁴ of the coordinates' squared differences;
//! [`ROUNDING`], relative to the extent, is far above that and is added to the result.

use glam::DVec3;

use crate::triangle_bvh::TriangleBvh;

/// How much the bound may exceed an attained distance.
const SLACK: f64 = 1.05;

/// Relative to the extent of both meshes together.
const ROUNDING: f64 = 1e-9;

/// An indexed mesh in f64, prepared for distances to it.
pub(crate) struct Surface {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) bvh: TriangleBvh,
}

impl Surface {
    /// # Panics
    /// When there are no triangles.
    pub(crate) fn new(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Surface {
        let corners: Vec<[DVec3; 3]> =
            triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect();
        Surface { positions, triangles, bvh: TriangleBvh::new(&corners) }
    }
}

/// Where a vertex of one surface meets the other.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Foot {
    pub(crate) distance: f64,
    pub(crate) triangle: u32,
    pub(crate) barycentric: [f64; 3],
}

/// The closest points on `to` of all vertices that triangles of `from` use; the rest keep an
/// infinite distance.
pub(crate) fn feet(from: &Surface, to: &Surface) -> Vec<Foot> {
    let none = Foot { distance: f64::INFINITY, triangle: 0, barycentric: [1.0, 0.0, 0.0] };
    let mut feet = vec![none; from.positions.len()];
    let mut hint = None;
    for &v in from.triangles.iter().flatten() {
        if feet[v as usize].distance.is_infinite() {
            let found = to.bvh.closest(from.positions[v as usize], hint);
            hint = Some(found.triangle);
            feet[v as usize] = Foot {
                distance: found.distance2.sqrt(),
                triangle: found.triangle,
                barycentric: found.barycentric,
            };
        }
    }
    feet
}

/// What [`one_sided_bound`] found.
#[derive(Debug, Clone)]
pub(crate) struct OneSided {
    /// No point of `from` is farther from `to` than this.
    pub(crate) bound: f64,
    /// Triangles of `from` with a point that is farther than the limit, and the triangle of `to`
    /// that is closest to that point.
    pub(crate) over_limit: Vec<(u32, u32)>,
}

/// Bounds the distance from `from` to `to`; `feet` are those of `from` on `to`.
///
/// Distances below `tolerance` are not told apart: the bound may be that large although the
/// truth is smaller. Triangles that exceed `limit` are listed and looked into no further, so the
/// bound is loose when there are any.
pub(crate) fn one_sided_bound(
    from: &Surface,
    to: &Surface,
    feet: &[Foot],
    tolerance: f64,
    limit: f64,
) -> OneSided {
    let used = from.triangles.iter().flatten();
    let highest = used.map(|&v| feet[v as usize].distance).fold(0.0, f64::max);
    let extent = extent(&from.positions).max(extent(&to.positions));
    let attained = highest.min(limit).max(tolerance).max(extent * ROUNDING);
    let mut search = Search { to, attained, limit, bound: highest };
    let mut over_limit = Vec::new();
    for (i, &triangle) in from.triangles.iter().enumerate() {
        let corners = triangle.map(|v| {
            let foot = feet[v as usize];
            Corner {
                position: from.positions[v as usize],
                distance: foot.distance,
                triangle: foot.triangle,
            }
        });
        if let Some(nearest) = search.visit(corners) {
            over_limit.push((i as u32, nearest));
        }
    }
    OneSided { bound: search.bound + extent * ROUNDING, over_limit }
}

fn extent(positions: &[DVec3]) -> f64 {
    let min = positions.iter().fold(DVec3::INFINITY, |a, &p| a.min(p));
    let max = positions.iter().fold(DVec3::NEG_INFINITY, |a, &p| a.max(p));
    if positions.is_empty() { 0.0 } else { (max - min).max_element() }
}

#[derive(Clone, Copy)]
struct Corner {
    position: DVec3,
    distance: f64,
    triangle: u32,
}

struct Search<'a> {
    to: &'a Surface,
    /// The largest distance found at some point, or the tolerance; at most the limit.
    attained: f64,
    limit: f64,
    /// No point visited so far exceeds it.
    bound: f64,
}

impl Search<'_> {
    /// Takes one triangle into the bound; returns the triangle closest to a point over the limit,
    /// if there is one.
    fn visit(&mut self, corners: [Corner; 3]) -> Option<u32> {
        let mut pending = vec![corners];
        while let Some(piece) = pending.pop() {
            let highest = piece.iter().map(|c| c.distance).fold(0.0, f64::max);
            let (longest, edge) = longest_edge(&piece);
            if highest > self.limit {
                let over = piece.iter().find(|c| c.distance > self.limit);
                for rest in pending.iter().chain([&piece]) {
                    let highest = rest.iter().map(|c| c.distance).fold(0.0, f64::max);
                    self.bound = self.bound.max(highest + longest_edge(rest).0 / 3f64.sqrt());
                }
                return over.map(|c| c.triangle);
            }
            self.attained = self.attained.max(highest);
            let enough = (self.attained * SLACK).min(self.limit.max(highest));

            // The Lipschitz bound first: it costs nothing.
            let mut upper = highest + longest / 3f64.sqrt();
            if upper > enough {
                for candidate in 0..3 {
                    upper = upper.min(self.largest_distance_to(&piece, piece[candidate].triangle));
                    if upper <= enough {
                        break;
                    }
                }
            }
            // Where the limit leaves no slack above what is attained, halving would never end.
            if upper <= enough || longest < self.attained * 1e-3 {
                self.bound = self.bound.max(upper);
                continue;
            }

            // Halve the longest edge; the new point may raise what is attained.
            let (a, b, c) = (piece[edge], piece[(edge + 1) % 3], piece[(edge + 2) % 3]);
            let position = (a.position + b.position) * 0.5;
            let found = self.to.bvh.closest(position, Some(a.triangle));
            let middle =
                Corner { position, distance: found.distance2.sqrt(), triangle: found.triangle };
            pending.push([a, middle, c]);
            pending.push([middle, b, c]);
        }
        None
    }

    /// From any point of the piece to one triangle: attained at a corner, by convexity.
    fn largest_distance_to(&self, piece: &[Corner; 3], triangle: u32) -> f64 {
        let distance = |c: &Corner| {
            if c.triangle == triangle {
                c.distance
            } else {
                self.to.bvh.distance2_to(c.position, triangle).sqrt()
            }
        };
        piece.iter().map(distance).fold(0.0, f64::max)
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn two_sided(a: &Surface, b: &Surface) -> f64 {
        let tolerance = 1e-6;
        one_sided_bound(a, b, &feet(a, b), tolerance, f64::INFINITY)
            .bound
            .max(one_sided_bound(b, a, &feet(b, a), tolerance, f64::INFINITY).bound)
    }

    fn square(z: f64) -> Surface {
        let positions = [[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]]
            .map(|[x, y]| DVec3::new(x, y, z))
            .to_vec();
        Surface::new(positions, vec![[0, 1, 2], [0, 2, 3]])
    }

    #[test]
    fn parallel_squares_are_as_far_apart_as_they_are() {
        let distance = two_sided(&square(0.0), &square(3.0));
        assert!((3.0..=3.0 * SLACK).contains(&distance), "{distance}");
        assert!(two_sided(&square(0.0), &square(0.0)) < 2e-6);
    }

    #[test]
    fn the_direction_matters() {
        // A small piece of the square is close to the square, but not the other way round.
        let whole = square(0.0);
        let piece = Surface::new(
            vec![DVec3::ZERO, DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.0, 1.0, 0.0)],
            vec![[0, 1, 2]],
        );
        let to_whole =
            one_sided_bound(&piece, &whole, &feet(&piece, &whole), 1e-6, f64::INFINITY).bound;
        let to_piece =
            one_sided_bound(&whole, &piece, &feet(&whole, &piece), 1e-6, f64::INFINITY).bound;
        assert!(to_whole < 2e-6);
        // The far corner (8, 8) is nearest to the middle of the hypotenuse.
        let expected = (7.5f64 * 7.5 * 2.0).sqrt();
        assert!((expected..=expected * SLACK).contains(&to_piece), "{to_piece} {expected}");
    }

    /// The maximum lies inside a triangle, where neither corners nor edge midpoints see it.
    #[test]
    fn a_maximum_between_the_vertices_is_found() {
        let a = Surface::new(
            vec![DVec3::new(-9.0, 0.0, 0.0), DVec3::new(9.0, 0.0, 0.0), DVec3::new(0.0, 0.1, 0.0)],
            vec![[0, 1, 2]],
        );
        let spike =
            |x: f64| [DVec3::new(x, -1.0, 0.0), DVec3::new(x, 1.0, 0.0), DVec3::new(x, 0.0, 0.5)];
        let positions: Vec<DVec3> = [spike(-9.0), spike(9.0)].concat();
        let b = Surface::new(positions, vec![[0, 1, 2], [3, 4, 5]]);
        let bound = one_sided_bound(&a, &b, &feet(&a, &b), 1e-6, f64::INFINITY).bound;
        assert!((9.0..=9.0 * SLACK).contains(&bound), "{bound}");
    }

    #[test]
    fn triangles_over_the_limit_are_named() {
        let mut bent = square(0.0);
        bent.positions[2].z = 5.0;
        let bent = Surface::new(bent.positions, bent.triangles);
        let flat = square(0.0);
        let found = one_sided_bound(&bent, &flat, &feet(&bent, &flat), 1e-6, 2.0);
        assert_eq!(found.over_limit.iter().map(|f| f.0).collect::<Vec<_>>(), [0, 1]);
        assert!(found.bound >= 5.0);
        let found = one_sided_bound(&bent, &flat, &feet(&bent, &flat), 1e-6, 6.0);
        assert!(found.over_limit.is_empty() && found.bound < 5.0 * SLACK);
    }

    proptest! {
        /// No sampled point exceeds the bound, and the bound is not far above the samples.
        #[test]
        fn samples_never_exceed_the_bound(
            a in prop::collection::vec(prop::array::uniform3(-100.0..100.0f64), 3..20),
            b in prop::collection::vec(prop::array::uniform3(-100.0..100.0f64), 3..20),
        ) {
            let surface = |points: &[[f64; 3]]| {
                let n = points.len() as u32;
                let positions = points.iter().map(|&p| DVec3::from_array(p)).collect();
                Surface::new(positions, (0..n - 2).map(|i| [i, i + 1, i + 2]).collect())
            };
            let (a, b) = (surface(&a), surface(&b));
            let bound = one_sided_bound(&a, &b, &feet(&a, &b), 1e-6, f64::INFINITY).bound;
            let mut sampled: f64 = 0.0;
            for t in &a.triangles {
                let t = t.map(|v| a.positions[v as usize]);
                for i in 0..=24 {
                    for j in 0..=24 - i {
                        let (u, v) = (f64::from(i) / 24.0, f64::from(j) / 24.0);
                        let p = t[0] * (1.0 - u - v) + t[1] * u + t[2] * v;
                        sampled = sampled.max(b.bvh.closest(p, None).distance2.sqrt());
                    }
                }
            }
            prop_assert!(sampled <= bound, "sampled {sampled}, bound {bound}");
            // Samples on a grid of 1/24 miss at most the grid's covering radius.
            prop_assert!(bound <= SLACK * (sampled + 350.0 / 24.0));
        }
    }
}
