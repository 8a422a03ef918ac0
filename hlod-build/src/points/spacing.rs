//! How far the points of a cloud are apart, and so how large they have to be to look like a surface.

use std::num::NonZero;

use glam::DVec3;
use hlod_compress::OctNormal;
use kiddo::{ImmutableKdTree, SquaredEuclidean};

/// So many of the nearest points are looked at, besides the point itself.
const NEIGHBOURS: usize = 16;
/// Directions in the surface, in each of which the nearest neighbour counts.
const SECTORS: usize = 6;
/// Three points that are equally far apart leave no gap with balls of 1/√3 of that, points on a grid
/// with 1/√2 of its step.
const SHARE: f64 = 0.6;
/// No ball is larger than so many times the median of its cell.
const MOST: f64 = 3.0;

/// A radius for each point in lattice steps: so large that balls round points of a surface that was
/// sampled about evenly leave no gaps. An estimate: between points nothing is known.
///
/// Round each point the surface is divided into sectors, and the farthest of the nearest neighbours
/// in each is what has to be met half-way. Where there are none the surface ends, or the cell.
pub(super) fn radii(points: &[([i32; 3], OctNormal)]) -> Vec<f64> {
    let mut places: Vec<[i32; 3]> = points.iter().map(|(p, _)| *p).collect();
    places.sort_unstable();
    places.dedup();
    let places: Vec<[f64; 3]> = places.iter().map(|p| p.map(f64::from)).collect();
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(&places);
    const WANTED: NonZero<usize> = NonZero::new(NEIGHBOURS + 1).unwrap();
    let radius = |(position, normal): &([i32; 3], OctNormal)| {
        let at = DVec3::from_array(position.map(f64::from));
        let normal = DVec3::from_array(normal.decode().map(f64::from));
        let (u, v) = normal.any_orthonormal_pair();
        let mut nearest = [f64::INFINITY; SECTORS];
        // From the nearest on; the first is the point itself.
        for found in tree.nearest_n::<SquaredEuclidean>(&at.to_array(), WANTED).iter().skip(1) {
            let to = DVec3::from_array(places[found.item as usize]) - at;
            let turn = to.dot(v).atan2(to.dot(u)) / std::f64::consts::TAU + 0.5;
            let sector = ((turn * SECTORS as f64) as usize).min(SECTORS - 1);
            nearest[sector] = nearest[sector].min(found.distance.sqrt());
        }
        let farthest = nearest.into_iter().filter(|d| d.is_finite()).fold(0.0, f64::max);
        (SHARE * farthest).max(1.0)
    };
    let mut radii: Vec<f64> = points.iter().map(radius).collect();
    let mut sorted = radii.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    // What lies far from everything else is no surface.
    let most = sorted.get(sorted.len() / 2).map_or(0.0, |median| MOST * median);
    radii.iter_mut().for_each(|radius| *radius = radius.min(most));
    radii
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balls_on_a_grid_leave_no_gaps_and_are_no_larger_at_its_sides() {
        let (n, step) = (40, 10);
        let up = OctNormal::encode([0.0, 0.0, 1.0]);
        let points: Vec<([i32; 3], OctNormal)> =
            (0..n * n).map(|i| ([step * (i % n) + 5, step * (i / n) + 5, 99], up)).collect();
        let radii = radii(&points);
        for (radius, (p, _)) in radii.iter().zip(&points) {
            // The middle of four is √½ of a step away; at the sides it is for others to reach it.
            let at_side = p[0].min(p[1]) == 5 || p[0].max(p[1]) == step * n - 5;
            let least = if at_side { 6.0 } else { 7.1 };
            assert!((least..=9.0).contains(radius), "{radius} at {p:?}");
        }
    }

    #[test]
    fn a_lonely_point_and_many_in_one_place_have_a_size() {
        let up = OctNormal::encode([0.0, 0.0, 1.0]);
        assert_eq!(radii(&[([3, 3, 3], up)]), [1.0]);
        assert_eq!(radii(&[([3, 3, 3], up); 50]), [1.0; 50]);
        assert_eq!(radii(&[]), [0.0; 0]);
    }
}
