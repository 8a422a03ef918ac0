//! Closest points on a set of triangles.
//!
//! A binary bounding-volume hierarchy split at the median centroid, searched nearest child first
//! with the best distance so far as the bound. Closest point on a triangle after Ericson,
//! *Real-Time Collision Detection* (2005), 5.1.5.

use glam::DVec3;

/// An order of triangles for closest-point queries. The triangles themselves stay where they are:
/// a copy would be the largest thing in memory.
pub(crate) struct TriangleBvh {
    nodes: Vec<BvhNode>,
    /// Numbers of triangles in the order of the hierarchy's leaves.
    order: Vec<u32>,
}

/// The triangles of a hierarchy. Lengths are in whatever unit the positions are.
#[derive(Clone, Copy)]
pub(crate) struct Triangles<'a> {
    pub(crate) positions: &'a [DVec3],
    pub(crate) triangles: &'a [[u32; 3]],
}

impl Triangles<'_> {
    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }
}

struct BvhNode {
    min: DVec3,
    max: DVec3,
    /// Leaf: first triangle. Inner node: index of the second child (the first follows directly).
    first: u32,
    /// Number of triangles; 0 for inner nodes.
    count: u32,
}

const LEAF_TRIANGLES: usize = 4;

/// The closest point of a query.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClosestPoint {
    /// Squared distance.
    pub(crate) distance2: f64,
    /// Which triangle.
    pub(crate) triangle: u32,
    /// Barycentric coordinates on it.
    pub(crate) barycentric: [f64; 3],
}

impl TriangleBvh {
    /// # Panics
    /// When there are no triangles: nothing is closest then.
    pub(crate) fn new(of: Triangles<'_>) -> TriangleBvh {
        let count = of.triangles.len();
        assert!(count > 0);
        let centroid = |t: u32| of.corners(t).iter().sum::<DVec3>();
        let centroids: Vec<DVec3> = (0..count as u32).map(centroid).collect();
        let mut order: Vec<u32> = (0..count as u32).collect();
        let mut nodes = Vec::with_capacity(count);
        build(&mut nodes, &mut order, 0, of, &centroids);
        nodes.shrink_to_fit();
        TriangleBvh { nodes, order }
    }

    /// The point of the triangles, those that the hierarchy was made of, that is closest to `p`;
    /// `hint` is a triangle likely to be near.
    pub(crate) fn closest(&self, of: Triangles<'_>, p: DVec3, hint: Option<u32>) -> ClosestPoint {
        let mut best =
            ClosestPoint { distance2: f64::INFINITY, triangle: 0, barycentric: [1.0, 0.0, 0.0] };
        if let Some(triangle) = hint {
            let (distance2, barycentric) = closest_on_triangle(p, &of.corners(triangle));
            best = ClosestPoint { distance2, triangle, barycentric };
        }
        // Depth is logarithmic because splits are at the median.
        let mut stack = [(0u32, 0.0f64); 64];
        stack[0] = (0, box_distance2(p, &self.nodes[0]));
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (index, lower2) = stack[top];
            if lower2 >= best.distance2 {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                for i in node.first..node.first + node.count {
                    let triangle = self.order[i as usize];
                    let (distance2, barycentric) = closest_on_triangle(p, &of.corners(triangle));
                    if distance2 < best.distance2 {
                        best = ClosestPoint { distance2, triangle, barycentric };
                    }
                }
                continue;
            }
            let children = [index + 1, node.first];
            let lower = children.map(|c| box_distance2(p, &self.nodes[c as usize]));
            let near = usize::from(lower[1] < lower[0]);
            for side in [1 - near, near] {
                if lower[side] < best.distance2 {
                    stack[top] = (children[side], lower[side]);
                    top += 1;
                }
            }
        }
        best
    }
}

fn build(
    nodes: &mut Vec<BvhNode>,
    order: &mut [u32],
    first: u32,
    of: Triangles<'_>,
    centroids: &[DVec3],
) {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (mut lo, mut hi) = (min, max);
    for &i in order.iter() {
        for corner in of.corners(i) {
            min = min.min(corner);
            max = max.max(corner);
        }
        lo = lo.min(centroids[i as usize]);
        hi = hi.max(centroids[i as usize]);
    }
    let index = nodes.len();
    nodes.push(BvhNode { min, max, first, count: order.len() as u32 });
    if order.len() <= LEAF_TRIANGLES {
        return;
    }
    let extent = hi - lo;
    let axis = if extent.x >= extent.y && extent.x >= extent.z {
        0
    } else if extent.y >= extent.z {
        1
    } else {
        2
    };
    let middle = order.len() / 2;
    // Equal centroids are ordered by index, so that the tree is the same every time.
    order.select_nth_unstable_by(middle, |&a, &b| {
        let (x, y) = (centroids[a as usize][axis], centroids[b as usize][axis]);
        x.total_cmp(&y).then(a.cmp(&b))
    });
    let (left, right) = order.split_at_mut(middle);
    build(nodes, left, first, of, centroids);
    nodes[index].count = 0;
    nodes[index].first = nodes.len() as u32;
    build(nodes, right, first + middle as u32, of, centroids);
}

#[inline]
fn box_distance2(p: DVec3, node: &BvhNode) -> f64 {
    let outside = (node.min - p).max(p - node.max).max(DVec3::ZERO);
    outside.length_squared()
}

/// Squared distance from `p` to a triangle (a segment or point where degenerate) and the
/// barycentric coordinates of the closest point.
#[inline]
pub(crate) fn closest_on_triangle(p: DVec3, [a, b, c]: &[DVec3; 3]) -> (f64, [f64; 3]) {
    let (ab, ac, ap) = (*b - *a, *c - *a, p - *a);
    let at =
        |u: f64, v: f64, w: f64| ((p - (*a * u + *b * v + *c * w)).length_squared(), [u, v, w]);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return at(1.0, 0.0, 0.0);
    }
    let bp = p - *b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return at(0.0, 1.0, 0.0);
    }
    let vc = d1 * d4 - d3 * d2;
    // Corners that fall together leave such an edge to the others.
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        let v = d1 / (d1 - d3);
        return at(1.0 - v, v, 0.0);
    }
    let cp = p - *c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return at(0.0, 0.0, 1.0);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        let w = d2 / (d2 - d6);
        return at(1.0 - w, 0.0, w);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 && (d4 - d3) + (d5 - d6) > 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return at(0.0, 1.0 - w, w);
    }
    let sum = va + vb + vc;
    if sum <= 0.0 || !sum.is_finite() {
        // A degenerate triangle that fell through: its corners are points of it, so the nearest
        // of them is an upper bound, which is what every caller needs.
        let corners = [at(1.0, 0.0, 0.0), at(0.0, 1.0, 0.0), at(0.0, 0.0, 1.0)];
        return corners.into_iter().min_by(|x, y| x.0.total_cmp(&y.0)).unwrap_or(corners[0]);
    }
    let (v, w) = (vb / sum, vc / sum);
    at(1.0 - v - w, v, w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-10.0..10.0f64).prop_map(DVec3::from_array)
    }

    proptest! {
        /// No point of the triangle, tried on a fine grid, is closer than the claimed one, and
        /// the claimed one is on the triangle.
        #[test]
        fn no_grid_point_is_closer(
            p in vector(),
            t in prop::array::uniform3(vector()),
            same in prop::option::of((0usize..3, 0usize..3)),
        ) {
            // Corners may fall together.
            let mut t = t;
            if let Some((i, j)) = same {
                t[i] = t[j];
            }
            let (distance2, bary) = closest_on_triangle(p, &t);
            prop_assert!(distance2.is_finite());
            prop_assert!(bary.iter().all(|b| *b >= -1e-9));
            prop_assert!((bary.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let (u, v) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                    let q = t[0] * (1.0 - u - v) + t[1] * u + t[2] * v;
                    prop_assert!((p - q).length_squared() >= distance2 - 1e-9);
                }
            }
        }

        #[test]
        fn the_hierarchy_agrees_with_trying_every_triangle(
            p in vector(),
            soup in prop::collection::vec(prop::array::uniform3(vector()), 1..60),
            hint in 0u32..60,
        ) {
            let positions: Vec<DVec3> = soup.iter().flatten().copied().collect();
            let triangles: Vec<[u32; 3]> =
                (0..soup.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            let of = Triangles { positions: &positions, triangles: &triangles };
            let bvh = TriangleBvh::new(of);
            let best = soup.iter().map(|t| closest_on_triangle(p, t).0).fold(f64::INFINITY, f64::min);
            let hint = (hint < soup.len() as u32).then_some(hint);
            let found = bvh.closest(of, p, hint);
            prop_assert_eq!(found.distance2, best);
            prop_assert_eq!(closest_on_triangle(p, &soup[found.triangle as usize]).0, best);
        }
    }
}
