//! Many points become few: one for each cell of a grid, and side that it faces.

use glam::DVec3;
use hlod_compress::OctNormal;

use super::{Point, angle_between};
use crate::colour::average_srgba;
use crate::kept::mean_scalars;

/// Groups of points that share a cell of a grid with cells of `edge` lattice steps and face about
/// the same way, as indices; groups and what is in them come in a fixed order.
pub(super) fn groups(points: &[Point], edge: f64) -> Vec<Vec<u32>> {
    // Front and back of something thin are not one surface.
    let key = |p: &Point| -> ([i64; 3], u8) {
        let direction = p.direction();
        let axis = direction.abs().max_position() as u8;
        let side = 2 * axis + u8::from(direction[usize::from(axis)] < 0.0);
        (p.position.map(|c| (f64::from(c) / edge).floor() as i64), side)
    };
    let mut keyed: Vec<(([i64; 3], u8), u32)> = points.iter().map(key).zip(0..).collect();
    keyed.sort_unstable();
    keyed.chunk_by(|a, b| a.0 == b.0).map(|group| group.iter().map(|(_, p)| *p).collect()).collect()
}

/// The member of a group that is nearest to its middle.
pub(super) fn middle(points: &[Point], group: &[u32]) -> u32 {
    let weight = |p: u32| f64::from(points[p as usize].weight);
    let total: f64 = group.iter().map(|&p| weight(p)).sum();
    let mean: DVec3 = group.iter().map(|&p| points[p as usize].at() * weight(p)).sum();
    let mean = mean / total;
    let distance = |p: u32| points[p as usize].at().distance_squared(mean);
    let nearest = group.iter().copied().min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    nearest.expect("no group is empty")
}

/// One point for each group: at the place of one of its members, with the mean of their normals and
/// colours, and a ball that holds all of theirs.
pub(super) fn clustered(points: &[Point], edge: f64) -> Vec<Point> {
    let one = |group: Vec<u32>| {
        if let [single] = group[..] {
            return points[single as usize];
        }
        let members = || group.iter().map(|&p| &points[p as usize]);
        let chosen = points[middle(points, &group) as usize];
        let sum: DVec3 = members().map(|p| p.direction() * f64::from(p.weight)).sum();
        let normal = match sum.try_normalize() {
            Some(mean) => OctNormal::encode(mean.as_vec3().to_array()),
            None => chosen.normal,
        };
        let direction = Point { normal, ..chosen }.direction();
        let reach = members().map(|p| chosen.at().distance(p.at()) + p.reach).fold(0.0, f64::max);
        let turned = members().map(|p| angle_between(direction, p.direction()) + p.turned);
        let weight = members().fold(0u32, |sum, p| sum.saturating_add(p.weight));
        Point {
            normal,
            colour: average_srgba(members().map(|p| (p.colour, p.weight as f32))),
            scalars: mean_scalars(members().map(|p| (p.scalars, p.weight.into()))),
            weight,
            reach,
            turned: turned.fold(0.0, f64::max),
            ..chosen
        }
    };
    groups(points, edge).into_iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hlod_compress::Scalars;
    use proptest::prelude::*;

    pub(crate) fn point(position: [i32; 3], normal: [f32; 3], reach: f64) -> Point {
        let normal = OctNormal::encode(normal);
        let (colour, scalars) = ([255; 4], Scalars::default());
        Point { position, normal, colour, scalars, weight: 1, reach, moved: 0.0, turned: 0.0 }
    }

    #[test]
    fn a_thin_sheet_keeps_its_two_sides() {
        let both =
            [point([1, 1, 1], [0.0, 0.0, 1.0], 1.0), point([2, 1, 1], [0.0, 0.0, -1.0], 1.0)];
        assert_eq!(clustered(&both, 100.0).len(), 2);
        let same = [both[0], point([2, 1, 1], [0.1, 0.0, 1.0], 1.0)];
        let one = clustered(&same, 100.0);
        assert_eq!(one.len(), 1);
        assert_eq!((one[0].weight, one[0].reach), (2, 2.0));
        assert!(one[0].turned > 0.04 && one[0].turned < 0.06, "{}", one[0].turned);
    }

    proptest! {
        #[test]
        fn balls_and_angles_hold_those_of_what_was_joined(
            given in prop::collection::vec(
                (prop::array::uniform3(-500..500i32), prop::array::uniform3(-1.0..1.0f32), 0.0..20.0f64),
                1..60,
            ),
            edge in 1.0..400.0f64,
        ) {
            let points: Vec<Point> = given.into_iter().map(|(p, n, r)| point(p, n, r)).collect();
            let few = clustered(&points, edge);
            prop_assert!(few.len() <= points.len());
            prop_assert_eq!(few.iter().map(|p| p.weight).sum::<u32>() as usize, points.len());
            for p in &points {
                let holds = few.iter().any(|q| {
                    q.at().distance(p.at()) + p.reach <= q.reach + 1e-9
                        && angle_between(q.direction(), p.direction()) <= q.turned + 1e-6
                });
                prop_assert!(holds, "{p:?} in {few:?}");
            }
        }
    }
}
