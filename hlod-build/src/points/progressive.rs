//! An order of points of which beginnings cover what all do, with larger balls: at half a node's
//! size on screen a quarter of its points is enough.

use std::f64::consts::SQRT_2;
use std::num::NonZero;

use hlod_compress::{PointPrefix, PointRadius};
use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::Point;
use super::cluster::{groups, middle};

/// How much coarser than all points the beginnings are, shortest first.
const COARSER: [f64; 3] = [2.0 * SQRT_2, 2.0, SQRT_2];
/// A beginning that saves less is not worth having.
const WORTH: f64 = 0.85;
/// Of so many points near one that is left out the best stands for it.
const NEAREST: NonZero<usize> = NonZero::new(6).unwrap();

/// The order of points that are about `spacing` lattice steps apart, and its beginnings.
pub(super) fn progressive(points: &[Point], spacing: f64) -> (Vec<u32>, Vec<PointPrefix>) {
    // From the longest beginning to the shortest, each chosen from the one before.
    let mut chosen: Vec<u32> = (0..points.len() as u32).collect();
    let mut rank = vec![u8::MAX; points.len()];
    let mut beginnings = Vec::new();
    for (i, coarser) in COARSER.iter().enumerate().rev() {
        let subset: Vec<Point> = chosen.iter().map(|&p| points[p as usize]).collect();
        let kept = groups(&subset, spacing * coarser);
        if kept.len() as f64 >= WORTH * chosen.len() as f64 {
            continue;
        }
        chosen = kept.iter().map(|group| chosen[middle(&subset, group) as usize]).collect();
        chosen.iter().for_each(|&p| rank[p as usize] = i as u8);
        beginnings.push(reaches(points, &chosen));
    }
    beginnings.reverse();
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_by_key(|&p| rank[p as usize]);
    let radii = |reaches: Vec<f64>| {
        let count = reaches.iter().filter(|reach| **reach > 0.0).count();
        let of = |p: &u32| PointRadius::at_least(reaches[*p as usize]);
        PointPrefix { radii: order[..count].iter().map(of).collect() }
    };
    let prefixes = beginnings.into_iter().map(radii).collect();
    (order, prefixes)
}

/// Radii with which those chosen hold the balls of all points; 0 for the others.
fn reaches(points: &[Point], chosen: &[u32]) -> Vec<f64> {
    let places: Vec<[f64; 3]> =
        chosen.iter().map(|&p| points[p as usize].at().to_array()).collect();
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(&places);
    let mut out = vec![0.0; points.len()];
    // None is left without a radius, however small its own.
    chosen.iter().for_each(|&p| out[p as usize] = points[p as usize].reach.max(f64::MIN_POSITIVE));
    for (p, point) in points.iter().enumerate() {
        if out[p] > 0.0 {
            continue;
        }
        let near = tree.nearest_n::<SquaredEuclidean>(&point.at().to_array(), NEAREST);
        let needed = |by: u32| points[by as usize].at().distance(point.at()) + point.reach;
        let mut candidates = near.iter().map(|found| chosen[found.item as usize]);
        if !candidates.clone().any(|by| needed(by) <= out[by as usize]) {
            let nearest = candidates.next().expect("something is chosen");
            out[nearest as usize] = needed(nearest);
        }
    }
    out
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
            scalars: hlod_compress::Scalars::default(),
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
        // The second is every other one either way.
        assert_eq!(prefixes[1].radii.len(), 400);
        assert!(prefixes[1].radii.iter().all(|r| r.steps() < 30.0));
        assert!(prefixes[0].radii.len() < 300);
        for prefix in prefixes {
            for p in &points {
                let mut first = order.iter().map(|&q| &points[q as usize]).zip(&prefix.radii);
                let holds = first.any(|(q, r)| q.at().distance(p.at()) + p.reach <= r.steps());
                assert!(holds, "{p:?} is not covered");
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
