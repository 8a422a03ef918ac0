//! Distances to triangles, by a library's hierarchy and a method of its own.

use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::Bvh;
use bvh::point_query::PointDistance;
use nalgebra::{Point3, Vector3};

/// Triangles to which distances can be asked for.
pub(super) struct Target {
    triangles: Vec<Triangle>,
    bvh: Bvh<f64, 3>,
}

impl Target {
    pub(super) fn new(corners: impl Iterator<Item = [[f64; 3]; 3]>) -> Target {
        let mut triangles: Vec<Triangle> =
            corners.map(|t| Triangle { corners: t.map(Point3::from), node: 0 }).collect();
        let bvh = Bvh::build(&mut triangles);
        Target { triangles, bvh }
    }

    /// Distance to the nearest triangle; infinite where there is none.
    pub(super) fn distance(&self, p: [f64; 3]) -> f64 {
        self.bvh.nearest_to(p.into(), &self.triangles).map_or(f64::INFINITY, |(_, d)| d)
    }
}

struct Triangle {
    corners: [Point3<f64>; 3],
    node: usize,
}

impl Bounded<f64, 3> for Triangle {
    fn aabb(&self) -> Aabb<f64, 3> {
        let [a, b, c] = &self.corners;
        Aabb::empty().grow(a).grow(b).grow(c)
    }
}

impl BHShape<f64, 3> for Triangle {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }
    fn bh_node_index(&self) -> usize {
        self.node
    }
}

impl PointDistance<f64, 3> for Triangle {
    /// To the plane where the foot of the perpendicular lies inside all three edges, else to the
    /// nearest edge.
    fn distance_squared(&self, p: Point3<f64>) -> f64 {
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(&(c - a));
        let area2 = normal.norm_squared();
        let inside =
            |from: Point3<f64>, to: Point3<f64>| normal.dot(&(to - from).cross(&(p - from))) >= 0.0;
        if area2 > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
            let height = normal.dot(&(p - a));
            return height * height / area2;
        }
        to_segment(p, a, b).min(to_segment(p, b, c)).min(to_segment(p, c, a))
    }
}

fn to_segment(p: Point3<f64>, a: Point3<f64>, b: Point3<f64>) -> f64 {
    let along: Vector3<f64> = b - a;
    let length2 = along.norm_squared();
    let t = if length2 > 0.0 { ((p - a).dot(&along) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (p - (a + along * t)).norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_to_a_known_triangle() {
        let target = Target::new(
            [[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]], [[50.0, 0.0, 0.0]; 3]]
                .into_iter(),
        );
        for (p, expected) in [
            ([1.0, 1.0, 3.0], 3.0),
            ([-3.0, 0.0, 4.0], 5.0),
            ([2.0, -2.0, 0.0], 2.0),
            ([4.0, 4.0, 0.0], 8.0f64.sqrt()),
            ([50.0, 1.0, 0.0], 1.0),
        ] {
            assert!((target.distance(p) - expected).abs() < 1e-12, "{p:?}");
        }
    }
}
