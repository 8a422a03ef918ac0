use glam::{DVec3, Vec3};
use proptest::prelude::*;

use super::*;
use crate::triangle_bvh::closest_on_triangle;

impl Certificate {
    /// No point of either surface is farther from the other, where nothing is over the limit.
    fn distance(&self) -> f64 {
        let all = self.forward.iter().chain(&self.backward).flatten();
        all.map(|b| b.deviation.distance).fold(0.0, f64::max)
    }
}

/// Triangles with their own normals at every corner.
fn surface(triangles: &[[DVec3; 3]]) -> Surface {
    let look = |t: &[DVec3; 3]| {
        let normal = (t[1] - t[0]).cross(t[2] - t[0]).normalize_or(DVec3::Z).as_vec3();
        Look { normal, colour: Vec3::ZERO }
    };
    let positions = triangles.as_flattened().to_vec();
    let looks = triangles.iter().flat_map(|t| [look(t); 3]).collect();
    let indices = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Surface::new(positions, looks, indices)
}

/// A grid of `n × n` squares over [0, 8]², each of two triangles, with shared vertices.
fn sheet(n: u32, height: impl Fn(f64, f64) -> f64, normal: impl Fn(f64, f64) -> Vec3) -> Surface {
    let mut positions = Vec::new();
    let mut looks = Vec::new();
    let mut triangles = Vec::new();
    for y in 0..=n {
        for x in 0..=n {
            let [u, v] = [x, y].map(|c| 8.0 * f64::from(c) / f64::from(n));
            positions.push(DVec3::new(u, v, height(u, v)));
            looks.push(Look { normal: normal(u, v), colour: Vec3::ZERO });
            if x < n && y < n {
                let a = y * (n + 1) + x;
                triangles.push([a, a + 1, a + n + 2]);
                triangles.push([a, a + n + 2, a + n + 1]);
            }
        }
    }
    Surface::new(positions, looks, triangles)
}

fn flat(n: u32, z: f64) -> Surface {
    sheet(n, |_, _| z, |_, _| Vec3::Z)
}

fn compare(source: &Surface, simplified: &Surface, tolerance: f64, limit: f64) -> Certificate {
    let neighbours = source.neighbours();
    let became = vec![NONE; source.positions.len()];
    let pair = Pair { source, neighbours: &neighbours, carried: &[], simplified, became: &became };
    certify(&pair, Ask { tolerance, limit, least: 0.0, near: tolerance }, Known::default())
}

/// Below this, distances are not told apart.
const TOLERANCE: f64 = 0.02;

fn bound(source: &Surface, simplified: &Surface) -> f64 {
    let certificate = compare(source, simplified, TOLERANCE, f64::INFINITY);
    assert!(certificate.holds());
    certificate.distance()
}

#[test]
fn parallel_sheets_are_as_far_apart_as_they_are() {
    for (fine, coarse) in [(8, 1), (1, 8), (7, 3)] {
        let distance = bound(&flat(fine, 0.0), &flat(coarse, 3.0));
        assert!((3.0..=3.0 * SLACK).contains(&distance), "{distance}");
        assert!(bound(&flat(fine, 0.0), &flat(coarse, 0.0)) < TOLERANCE * SLACK);
    }
}

#[test]
fn both_directions_count() {
    // A small piece of the sheet is close to the sheet, but not the other way round: the far
    // corner is nearest to the middle of the hypotenuse.
    let piece = surface(&[[DVec3::ZERO, DVec3::X, DVec3::Y]]);
    let whole = flat(1, 0.0);
    let expected = (7.5f64 * 7.5 * 2.0).sqrt();
    for (source, simplified) in [(&piece, &whole), (&whole, &piece)] {
        let distance = bound(source, simplified);
        assert!((expected..=expected * SLACK).contains(&distance), "{distance} {expected}");
    }
}

/// The maximum lies inside a triangle, where neither corners nor middles of edges see it.
#[test]
fn a_maximum_between_the_vertices_is_found() {
    let long = [DVec3::new(-9.0, 0.0, 0.0), DVec3::new(9.0, 0.0, 0.0), DVec3::new(0.0, 0.1, 0.0)];
    let spike =
        |x: f64| [DVec3::new(x, -1.0, 0.0), DVec3::new(x, 1.0, 0.0), DVec3::new(x, 0.0, 0.5)];
    let (long, spikes) = (surface(&[long]), surface(&[spike(-9.0), spike(9.0)]));
    for (source, simplified) in [(&long, &spikes), (&spikes, &long)] {
        let distance = bound(source, simplified);
        assert!((9.0..=9.0 * SLACK).contains(&distance), "{distance}");
    }
}

#[test]
fn what_is_over_the_limit_is_named() {
    // A peak over one inner vertex of the fine sheet.
    let peak = |x: f64, y: f64| if (x, y) == (4.0, 4.0) { 2.0 } else { 0.0 };
    let source = sheet(8, peak, |_, _| Vec3::Z);
    let simplified = flat(1, 0.0);
    let found = compare(&source, &simplified, 0.1, 1.0);
    let at_peak = |t: u32| source.corners(t).iter().any(|p| p.z > 0.0);
    assert_eq!(found.lost.len(), 6);
    assert!(found.lost.iter().all(|&t| at_peak(t)));
    assert!(compare(&source, &simplified, 0.1, 2.1).holds());
    // The other way round it is the coarse surface that has what the fine one has not.
    let found = compare(&simplified, &source, 0.1, 1.0);
    assert_eq!(found.invented.len(), 6);
    assert!(found.invented.iter().all(|&t| at_peak(t)));
}

#[test]
fn a_hole_in_the_source_is_not_covered() {
    let whole = flat(8, 0.0);
    let mut triangles = whole.triangles.clone();
    // The middle square, of edge 1: its centre is half an edge from what is left.
    triangles.retain(|t| {
        let centre: DVec3 = t.iter().map(|&v| whole.positions[v as usize]).sum::<DVec3>() / 3.0;
        !(4.0..5.0).contains(&centre.x) || !(4.0..5.0).contains(&centre.y)
    });
    let holed = Surface::new(whole.positions.clone(), whole.looks.clone(), triangles);
    let distance = bound(&holed, &flat(1, 0.0));
    assert!((0.5..0.5 * SLACK).contains(&distance), "{distance}");
}

/// A fold covers the triangle three times: an odd number, and the highest layer counts.
#[test]
fn a_fold_counts_with_its_highest_layer() {
    // Over x in 0..8: up to x = 5 at height 0, back to x = 3 at height 1, on at height 2.
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let line = [(0.0, 0.0), (5.0, 0.0), (3.0, 1.0), (5.0, 2.0), (8.0, 0.0)];
    let positions: Vec<DVec3> =
        line.iter().flat_map(|&(x, z)| [at(x, 0.0, z), at(x, 8.0, z)]).collect();
    let looks = vec![Look { normal: Vec3::Z, colour: Vec3::ZERO }; positions.len()];
    let triangles = (0..4).flat_map(|i| {
        let a = 2 * i;
        [[a, a + 2, a + 3], [a, a + 3, a + 1]]
    });
    let folded = Surface::new(positions, looks, triangles.collect());
    let distance = bound(&folded, &flat(1, 0.0));
    assert!((2.0..=2.0 * SLACK).contains(&distance), "{distance}");
}

#[test]
fn angles_between_normals_are_bounded() {
    let tilted = |degrees: f32| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        sheet(8, |_, _| 0.5, move |_, _| Vec3::new(sin, 0.0, cos))
    };
    for degrees in [0.0f32, 1.0, 20.0, 60.0] {
        let found = compare(&tilted(degrees), &flat(1, 0.0), 0.1, 1.0);
        let largest = found
            .forward
            .iter()
            .chain(&found.backward)
            .map(|b| b.expect("within the limit").deviation.angle.to_degrees())
            .fold(0.0, f32::max);
        // sin α ≤ |difference| = 2 sin(α / 2): a bound, tight for small angles.
        assert!(largest >= degrees - 1e-3, "{largest} {degrees}");
        assert!(degrees > 30.0 || largest < degrees * 1.05 + 0.01, "{largest} {degrees}");
    }
    // Opposite normals have no bound but the whole half turn.
    let found = compare(&tilted(180.0), &flat(1, 0.0), 0.1, 1.0);
    let angle = found.forward[0].expect("within the limit").deviation.angle;
    assert_eq!(angle, std::f32::consts::PI);
}

#[test]
fn deviations_of_matches_add_up() {
    let source = flat(4, 0.0);
    let simplified = flat(1, 0.25);
    let neighbours = source.neighbours();
    let became = vec![NONE; source.positions.len()];
    let one = Deviation { distance: 1.0, angle: 0.1 };
    let carried: Vec<Carried> = (0..source.triangles.len())
        .map(|t| if t == 5 { Carried { forward: one, backward: one } } else { Carried::default() })
        .collect();
    let pair = Pair {
        source: &source,
        neighbours: &neighbours,
        carried: &carried,
        simplified: &simplified,
        became: &became,
    };
    let ask = Ask { tolerance: 1e-6, limit: 2.0, least: 0.0, near: 0.8 };
    let found = certify(&pair, ask, Known::default()).carried(&carried);
    let touched: Vec<bool> = found.iter().map(|c| c.backward.distance > 1.0).collect();
    assert!(touched.contains(&true), "what the source carries reaches the triangle over it");
    for c in &found {
        for d in [c.forward, c.backward] {
            assert!((d.distance - 0.25).abs() < 0.02 || (d.distance - 1.25).abs() < 0.02);
        }
    }
    // The sum is what is limited, unless the step alone is within what is allowed in any case.
    let found = certify(&pair, Ask { limit: 1.2, ..ask }, Known::default());
    assert_eq!(found.lost, [5]);
    assert_eq!(found.invented.len(), 1);
    assert!(certify(&pair, Ask { limit: 1.2, least: 0.3, ..ask }, Known::default()).holds());
}

#[test]
fn what_has_not_changed_is_known() {
    let source = sheet(8, |x, y| 0.1 * (x * y).sin(), |_, _| Vec3::Z);
    let old = flat(4, 0.0);
    let first = compare(&source, &old, 0.05, 0.2);
    assert!(first.holds());
    // One corner moves: its two triangles are new.
    let mut positions = old.positions.clone();
    positions[0].z = 0.05;
    let new = Surface::new(positions, old.looks.clone(), old.triangles.clone());
    let known = first.still_known(&old, &new);
    assert_eq!(known.backward.iter().filter(|b| b.is_none()).count(), 2);
    let unknown = known.forward.iter().filter(|b| b.is_none()).count();
    assert!((8..40).contains(&unknown), "{unknown}");
    let neighbours = source.neighbours();
    let became = vec![NONE; source.positions.len()];
    let pair = Pair {
        source: &source,
        neighbours: &neighbours,
        carried: &[],
        simplified: &new,
        became: &became,
    };
    let again = certify(&pair, Ask { tolerance: 0.05, limit: 0.2, least: 0.0, near: 0.16 }, known);
    let fresh = compare(&source, &new, 0.05, 0.2);
    assert!(again.holds() && fresh.holds());
    assert!((again.distance() - fresh.distance()).abs() <= 0.05 * fresh.distance());
}

fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
    let point = || prop::array::uniform3(-100.0..100.0f64).prop_map(DVec3::from_array);
    (point(), point(), point()).prop_map(|(a, b, c)| [a, b, c])
}

/// Distance from a point to any of some triangles.
fn distance(p: DVec3, triangles: &[[DVec3; 3]]) -> f64 {
    triangles.iter().map(|t| closest_on_triangle(p, t).0).fold(f64::INFINITY, f64::min).sqrt()
}

fn samples(t: &[DVec3; 3]) -> impl Iterator<Item = DVec3> {
    const N: u32 = 24;
    let t = *t;
    (0..=N).flat_map(move |i| {
        (0..=N - i).map(move |j| {
            let [u, v] = [i, j].map(|c| f64::from(c) / f64::from(N));
            t[0] * (1.0 - u - v) + t[1] * u + t[2] * v
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// No sampled point exceeds the bound, and the bound is not far above the samples.
    #[test]
    fn samples_never_exceed_the_bound(
        a in prop::collection::vec(triangle(), 1..8),
        b in prop::collection::vec(triangle(), 1..8),
    ) {
        let bound = bound(&surface(&a), &surface(&b));
        let sampled = [(&a, &b), (&b, &a)]
            .into_iter()
            .flat_map(|(from, to)| from.iter().flat_map(samples).map(|p| distance(p, to)))
            .fold(0.0, f64::max);
        prop_assert!(sampled <= bound, "sampled {sampled}, bound {bound}");
        // Samples on a grid of 1/24 miss at most the grid's covering radius.
        prop_assert!(bound <= SLACK * (sampled + 350.0 / 24.0), "sampled {sampled}, bound {bound}");
    }

    /// The same on connected sheets, where the cover does the work; normals as well: every
    /// sampled point has some point of the other surface that is near enough and alike enough.
    #[test]
    fn rough_sheets_keep_their_bounds(
        heights in prop::collection::vec(-0.5..0.5f64, 81),
        tilts in prop::collection::vec(-0.4..0.4f32, 81),
        coarse in 1u32..5,
    ) {
        let index = |x: f64, y: f64| (y.round() * 9.0 + x.round()) as usize;
        let source = sheet(
            8,
            |x, y| heights[index(x, y)],
            |x, y| Vec3::new(tilts[index(x, y)], 0.0, 1.0).normalize(),
        );
        let simplified = flat(coarse, 0.1);
        let found = compare(&source, &simplified, TOLERANCE, f64::INFINITY);
        let reach = found.distance();
        let angle = found
            .forward
            .iter()
            .chain(&found.backward)
            .flatten()
            .map(|b| b.deviation.angle)
            .fold(0.0, f32::max);
        for (from, to) in [(&source, &simplified), (&simplified, &source)] {
            let triangles: Vec<[DVec3; 3]> =
                (0..to.triangles.len() as u32).map(|t| to.corners(t)).collect();
            for t in 0..from.triangles.len() as u32 {
                for p in samples(&from.corners(t)).step_by(17) {
                    prop_assert!(distance(p, &triangles) <= reach);
                    let foot = from.foot_on(p, t);
                    let normal = from.look_at(&foot).normal;
                    let alike = (0..to.triangles.len() as u32).any(|other| {
                        samples(&to.corners(other)).any(|q| {
                            let look = to.look_at(&to.foot_on(q, other)).normal;
                            // The samples' spacing is allowed for.
                            q.distance(p) <= reach + 0.5 && normal.angle_between(look) <= angle + 0.1
                        })
                    });
                    prop_assert!(alike, "{p} {normal} {angle} {reach}");
                }
            }
        }
    }
}
