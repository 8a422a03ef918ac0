//! Two triangle meshes that are compared, and what is prepared for that.

use std::cell::OnceCell;

use glam::{DVec3, Vec3};

use crate::triangle_bvh::{TriangleBvh, Triangles, closest_on_triangle};

/// What a point of a surface looks like.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Look {
    /// Unit at vertices, interpolated linearly between them and not normalised there.
    pub(crate) normal: Vec3,
    /// sRGB from 0 to 1; black where there is no colour.
    pub(crate) colour: Vec3,
}

impl Look {
    pub(crate) fn mix(looks: [Look; 3], weights: [f64; 3]) -> Look {
        let [u, v, w] = weights.map(|w| w as f32);
        let [a, b, c] = looks;
        Look {
            normal: a.normal * u + b.normal * v + c.normal * w,
            colour: a.colour * u + b.colour * v + c.colour * w,
        }
    }

    pub(crate) fn difference(&self, other: &Look) -> Difference {
        Difference {
            normal: self.normal.distance(other.normal),
            colour: self.colour.distance(other.colour),
        }
    }
}

/// Lengths of the differences between two looks.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Difference {
    pub(crate) normal: f32,
    pub(crate) colour: f32,
}

impl Difference {
    pub(crate) fn max(self, other: Difference) -> Difference {
        Difference { normal: self.normal.max(other.normal), colour: self.colour.max(other.colour) }
    }

    pub(crate) fn plus(self, other: Difference) -> Difference {
        Difference { normal: self.normal + other.normal, colour: self.colour + other.colour }
    }
}

/// No triangle, no neighbour.
pub(crate) const NONE: u32 = u32::MAX;

/// An indexed mesh prepared for comparing it with another.
pub(crate) struct Surface {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) looks: Vec<Look>,
    pub(crate) triangles: Vec<[u32; 3]>,
    bvh: OnceCell<TriangleBvh>,
    /// Triangles round vertex v: `stars[star_starts[v]..star_starts[v + 1]]`.
    star_starts: Vec<u32>,
    stars: Vec<u32>,
}

impl Surface {
    pub(crate) fn new(
        positions: Vec<DVec3>,
        looks: Vec<Look>,
        triangles: Vec<[u32; 3]>,
    ) -> Surface {
        let mut star_starts = vec![0u32; positions.len() + 1];
        for &v in triangles.as_flattened() {
            star_starts[v as usize + 1] += 1;
        }
        for v in 0..positions.len() {
            star_starts[v + 1] += star_starts[v];
        }
        let mut stars = vec![0; 3 * triangles.len()];
        let mut next = star_starts.clone();
        for (t, triangle) in triangles.iter().enumerate() {
            for &v in triangle {
                stars[next[v as usize] as usize] = t as u32;
                next[v as usize] += 1;
            }
        }
        Surface { positions, looks, triangles, bvh: OnceCell::new(), star_starts, stars }
    }

    pub(crate) fn star(&self, v: u32) -> &[u32] {
        let range = self.star_starts[v as usize]..self.star_starts[v as usize + 1];
        &self.stars[range.start as usize..range.end as usize]
    }

    pub(crate) fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    pub(crate) fn corner_looks(&self, triangle: u32) -> [Look; 3] {
        self.triangles[triangle as usize].map(|v| self.looks[v as usize])
    }

    /// The largest coordinate, which rounding is relative to.
    pub(crate) fn largest_coordinate(&self) -> f64 {
        self.positions.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max)
    }

    /// The triangle on the other side of each edge (of corners k and k + 1); [`NONE`] where the
    /// edge is open, shared by more than two triangles, or its triangles face opposite ways.
    pub(crate) fn neighbours(&self) -> Vec<[u32; 3]> {
        let mut out = vec![[NONE; 3]; self.triangles.len()];
        for (t, triangle) in self.triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
                let mut found = NONE;
                let (of_a, of_b) = (self.star(a), self.star(b));
                // One of the two may be the tip of a fan of thousands.
                let shorter = if of_a.len() <= of_b.len() { of_a } else { of_b };
                for &other in shorter.iter().filter(|&&other| other != t as u32) {
                    let corners = self.triangles[other as usize];
                    let Some(at) = corners.iter().position(|&v| v == a) else { continue };
                    let same = corners[(at + 1) % 3] == b;
                    let opposite = corners[(at + 2) % 3] == b;
                    if same || opposite && found != NONE {
                        found = NONE;
                        break;
                    }
                    if opposite {
                        found = other;
                    }
                }
                out[t][k] = found;
            }
        }
        out
    }

    /// The closest point; `hint` is a triangle likely to be near.
    ///
    /// # Panics
    /// When there are no triangles.
    pub(crate) fn closest(&self, p: DVec3, hint: u32) -> Foot {
        let of = Triangles { positions: &self.positions, triangles: &self.triangles };
        let bvh = self.bvh.get_or_init(|| TriangleBvh::new(of));
        let found = bvh.closest(of, p, (hint != NONE).then_some(hint));
        Foot {
            distance: found.distance2.sqrt(),
            triangle: found.triangle,
            barycentric: found.barycentric,
        }
    }

    /// A near point: the closest of the triangles round about `start`, from there to the closest
    /// of those round about the best, and so on while that helps.
    pub(crate) fn walk(&self, p: DVec3, start: Foot) -> Foot {
        let mut best = start;
        loop {
            let from = best.triangle;
            for &v in &self.triangles[from as usize] {
                best = self.nearest_of_star(p, v, best);
            }
            if best.triangle == from {
                return best;
            }
        }
    }

    /// The better of `best` and the closest point on the triangles round a vertex.
    pub(crate) fn nearest_of_star(&self, p: DVec3, v: u32, mut best: Foot) -> Foot {
        for &t in self.star(v) {
            if t != best.triangle {
                let foot = self.foot_on(p, t);
                if foot.distance < best.distance {
                    best = foot;
                }
            }
        }
        best
    }

    pub(crate) fn foot_on(&self, p: DVec3, triangle: u32) -> Foot {
        let (distance2, barycentric) = closest_on_triangle(p, &self.corners(triangle));
        Foot { distance: distance2.sqrt(), triangle, barycentric }
    }

    pub(crate) fn look_at(&self, foot: &Foot) -> Look {
        Look::mix(self.corner_looks(foot.triangle), foot.barycentric)
    }
}

/// A point of a surface, seen from a point elsewhere.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Foot {
    pub(crate) distance: f64,
    pub(crate) triangle: u32,
    pub(crate) barycentric: [f64; 3],
}

impl Foot {
    /// Nothing found yet.
    pub(crate) const NOWHERE: Foot =
        Foot { distance: f64::INFINITY, triangle: NONE, barycentric: [1.0, 0.0, 0.0] };
}
