//! Rims: the open edges that vertices stand for, and how far from them a place is.
//!
//! In a [`Quadric`](super::quadric::Quadric) open edges count as well, but the more surface a vertex stands for, the less:
//! of an edge that was simplified together with what is beside it nothing would be known in the end. So each vertex sums
//! its own apart, by length.

use glam::DVec3;

use super::quadric::{Form, upright};
use crate::certificate::NONE;

/// Open edges that one vertex stands for.
#[derive(Debug, Clone, Copy, Default)]
struct Rim {
    length: f64,
    planes: Form,
}

impl Rim {
    fn add(&mut self, other: &Rim) {
        self.length += other.length;
        self.planes.add(&other.planes);
    }

    /// Mean square distance of the place from the edges' planes.
    fn error(&self, place: DVec3) -> f64 {
        self.planes.at(place).max(0.0) / self.length.max(f64::MIN_POSITIVE)
    }
}

/// The rims of all vertices of a node.
#[derive(Debug)]
pub(super) struct Rims {
    /// Which of `rims` a vertex has; [`NONE`] where it is on no open edge.
    rim_of: Vec<u32>,
    rims: Vec<Rim>,
}

impl Rims {
    /// So many vertices, none of which is on an open edge.
    pub(super) fn none_of(vertices: usize) -> Rims {
        Rims { rim_of: vec![NONE; vertices], rims: Vec::new() }
    }

    /// Half of an open edge, for one of its ends; with the third corner of its triangle.
    pub(super) fn add_edge(&mut self, v: u32, edge: [DVec3; 3]) {
        let rim = &mut self.rim_of[v as usize];
        if *rim == NONE {
            *rim = self.rims.len() as u32;
            self.rims.push(Rim::default());
        }
        let rim = &mut self.rims[*rim as usize];
        let [p, q, _] = edge;
        let weight = 0.5 * p.distance(q);
        let normal = upright(edge);
        rim.length += weight;
        rim.planes.add_squared(normal, -normal.dot(p), weight);
    }

    /// Gives `b` what `a` stands for, too.
    pub(super) fn merge(&mut self, a: u32, b: u32) {
        let (of_a, of_b) = (self.rim_of[a as usize], self.rim_of[b as usize]);
        self.rim_of[a as usize] = NONE;
        if of_b == NONE {
            self.rim_of[b as usize] = of_a;
        } else if of_a != NONE {
            let rim = self.rims[of_a as usize];
            self.rims[of_b as usize].add(&rim);
        }
    }

    /// Takes a vertex off all open edges.
    pub(super) fn forget(&mut self, v: u32) {
        self.rim_of[v as usize] = NONE;
    }

    /// Mean square distance, in the surface, of a place from the open edges that two vertices stand for; 0 if they stand for
    /// none.
    pub(super) fn error(&self, a: u32, b: u32, place: DVec3) -> f64 {
        match [a, b].map(|v| self.rims.get(self.rim_of[v as usize] as usize)) {
            [Some(a), Some(b)] => {
                let mut both = *a;
                both.add(b);
                both.error(place)
            }
            [Some(rim), None] | [None, Some(rim)] => rim.error(place),
            [None, None] => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Edges along a square's lower and left side, whose surface is in the plane z = 0.
    #[test]
    fn a_place_is_as_far_as_the_edges_planes_are_whoever_stands_for_them() {
        let (origin, right, up) = (DVec3::ZERO, DVec3::X * 2.0, DVec3::Y * 2.0);
        let mut rims = Rims::none_of(4);
        rims.add_edge(0, [origin, right, up]);
        rims.add_edge(1, [up, origin, right]);
        // Off the lower edge by 1 and off the left one by 3; where it is above the surface does not count.
        let place = DVec3::new(3.0, 1.0, 7.0);
        assert_eq!([rims.error(0, 2, place), rims.error(3, 1, place)], [1.0, 9.0]);
        assert_eq!([rims.error(0, 1, place), rims.error(2, 3, place)], [5.0, 0.0]);
        rims.merge(0, 2);
        assert_eq!([rims.error(2, 3, place), rims.error(0, 3, place)], [1.0, 0.0]);
        rims.merge(1, 2);
        assert_eq!(rims.error(2, 3, place), 5.0);
        rims.forget(2);
        assert_eq!(rims.error(2, 3, place), 0.0);
    }
}
