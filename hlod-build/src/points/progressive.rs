//! An order of points of which beginnings cover what all do, with larger balls: at half a node's
//! size on screen a quarter of its points is enough.

use std::num::NonZero;

use hlod_compress::PointPrefix;
use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::Point;
use super::cluster::{groups, middle};

/// How much coarser than all points the beginnings are, shortest first.
const COARSER: [f64; 2] = [2.0, std::f64::consts::SQRT_2];
/// A beginning that saves less is not worth having.
const WORTH: f64 = 0.85;
/// Of so many points near one that is left out the best stands for it.
const NEAREST: NonZero<usize> = NonZero::new(6).unwrap();

/// The order of points that are about `spacing` lattice steps apart, and its beginnings.
pub(super) fn progressive(points: &[Point], spacing: f64) -> (Vec<u32>, Vec<PointPrefix>) {
    // From the longest beginning to the shortest, each chosen from the one before.
    let mut chosen: Vec<u32> = (0..points.len() as u32).collect();
    let mut rank = vec![u8::MAX; points.len()];
    let mut prefixes = Vec::new();
    for (i, coarser) in COARSER.iter().enumerate().rev() {
        let subset: Vec<Point> = chosen.iter().map(|&p| points[p as usize]).collect();
        let kept = groups(&subset, spacing * coarser);
        if kept.len() as f64 > WORTH * chosen.len() as f64 {
            continue;
        }
        chosen = kept.iter().map(|group| chosen[middle(&subset, group) as usize]).collect();
        chosen.iter().for_each(|&p| rank[p as usize] = i as u8);
        let radius_added = added(points, &chosen).ceil() as u32;
        prefixes.push(PointPrefix { count: chosen.len() as u32, radius_added });
    }
    prefixes.reverse();
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_by_key(|&p| rank[p as usize]);
    (order, prefixes)
}

/// How much larger the balls of those chosen have to be to hold those of all others.
fn added(points: &[Point], chosen: &[u32]) -> f64 {
    let places: Vec<[f64; 3]> = chosen.iter().map(|&p| points[p as usize].at().to_array()).collect();
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(&places);
    let needed = |p: &Point| {
        let near = tree.nearest_n::<SquaredEuclidean>(&p.at().to_array(), NEAREST);
        let by = near.iter().map(|found| {
            let by = &points[chosen[found.item as usize] as usize];
            by.at().distance(p.at()) + p.reach - by.reach
        });
        by.fold(f64::INFINITY, f64::min)
    };
    points.iter().map(needed).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use hlod_compress::OctNormal;

    use super::*;

    fn plane(n: i32) -> Vec<Point> {
        let point = |i: i32| Point {
            position: [10 * (i % n), 10 * (i / n), 0],
            normal: OctNormal::encode([0.0, 0.0, 1.0]),
            colour: [255; 4],
            weight: 1,
            reach: 8.0,
            moved: 0.0,
            turned: 0.0,
        };
        (0..n * n).map(point).collect()
    }

    #[test]
    fn beginnings_cover_what_all_points_do() {
        let points = plane(40);
        let (order, prefixes) = progressive(&points, 10.0);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..1600));
        // Every second one either way, and every second one.
        assert_eq!(prefixes[0].count, 400);
        assert!(prefixes[0].radius_added <= 20, "{prefixes:?}");
        assert!(prefixes.len() == 1 || prefixes[1].count <= 1200, "{prefixes:?}");
        for prefix in prefixes {
            let first: Vec<Point> =
                order[..prefix.count as usize].iter().map(|&p| points[p as usize]).collect();
            for p in &points {
                let holds = |q: &Point| {
                    q.at().distance(p.at()) + p.reach <= q.reach + f64::from(prefix.radius_added)
                };
                assert!(first.iter().any(holds), "{p:?} is not covered");
            }
        }
    }

    #[test]
    fn few_points_have_no_beginnings() {
        let (order, prefixes) = progressive(&plane(1), 10.0);
        assert_eq!((order.len(), prefixes.len()), (1, 0));
        assert_eq!(progressive(&[], 10.0), (Vec::new(), Vec::new()));
    }
}
