//! How far the points of a cloud are apart, and so how large they have to be to look like a surface.

use std::num::NonZero;

use glam::DVec3;
use hlod_compress::OctNormal;
use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::borders::Cube;

/// So many neighbours lie round a point.
const NEIGHBOURS: usize = 6;
/// The distance to the farthest of them is that of points on a grid along its diagonals, or of the next
/// but one where points are at random: balls of this share of it leave no gaps on either.
const SHARE: f64 = 0.75;

/// A radius for each point in lattice steps: so large that balls round points of a surface that was
/// sampled about evenly leave no gaps. An estimate: between points nothing is known.
///
/// Only what is in the cell is looked at. Where neighbours would lie beyond its faces fewer of them are
/// asked for.
pub(super) fn radii(points: &[([i32; 3], OctNormal)], cube: &Cube) -> Vec<f64> {
    let mut places: Vec<[i32; 3]> = points.iter().map(|(p, _)| *p).collect();
    places.sort_unstable();
    places.dedup();
    let places: Vec<[f64; 3]> = places.iter().map(|p| p.map(f64::from)).collect();
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(&places);
    const WANTED: NonZero<usize> = NonZero::new(NEIGHBOURS + 1).unwrap();
    let radius = |(position, normal): &([i32; 3], OctNormal)| {
        let at = position.map(f64::from);
        let near = tree.nearest_n::<SquaredEuclidean>(&at, WANTED);
        // The first is the point itself.
        let distances: Vec<f64> = near.iter().skip(1).map(|found| found.distance.sqrt()).collect();
        let Some(&farthest) = distances.last() else { return 1.0 };
        let normal = DVec3::from_array(normal.decode().map(f64::from));
        let inside = share_inside(*position, farthest, normal, cube);
        let wanted = (inside * distances.len() as f64).round().max(2.0) as usize;
        (SHARE * distances[wanted.min(distances.len()) - 1]).max(1.0)
    };
    points.iter().map(radius).collect()
}

/// How much of a disc round a point is inside the cell, about.
fn share_inside(position: [i32; 3], radius: f64, normal: DVec3, cube: &Cube) -> f64 {
    let mut share = 1.0;
    for axis in 0..3 {
        // A disc in the face's plane does not reach across it.
        let across = radius * (1.0 - normal[axis] * normal[axis]).max(0.0).sqrt();
        let low = f64::from(position[axis].abs_diff(cube.min[axis]));
        let gap = low.min(f64::from(cube.units) - low).max(0.0);
        if gap < across {
            share *= 0.5 + 0.5 * gap / across;
        }
    }
    share
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balls_on_a_grid_leave_no_gaps_and_are_no_larger_at_the_faces() {
        let (n, step) = (40, 10);
        let up = OctNormal::encode([0.0, 0.0, 1.0]);
        let points: Vec<([i32; 3], OctNormal)> =
            (0..n * n).map(|i| ([step * (i % n) + 5, step * (i / n) + 5, 99], up)).collect();
        let cube = Cube { min: [0; 3], units: (n * step) as u32 };
        let radii = radii(&points, &cube);
        for (radius, (p, _)) in radii.iter().zip(&points) {
            // The middle of four is √½ of a step away.
            assert!((7.1..=11.0).contains(radius), "{radius} at {p:?}");
        }
    }

    #[test]
    fn a_lonely_point_and_many_in_one_place_have_a_size() {
        let up = OctNormal::encode([0.0, 0.0, 1.0]);
        let cube = Cube { min: [0; 3], units: 100 };
        assert_eq!(radii(&[([3, 3, 3], up)], &cube), [1.0]);
        assert_eq!(radii(&[([3, 3, 3], up); 50], &cube), [1.0; 50]);
        assert_eq!(radii(&[], &cube), [0.0; 0]);
    }
}
