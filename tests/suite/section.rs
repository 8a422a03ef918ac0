//! Plane sections: analytic truth, then whatever surfaces there are.

use std::path::PathBuf;

use glam::DVec3;
use hlod_build::BuildOptions;
use hlod_render::RenderError;
use hlod_render::leaves::Leaves;
use hlod_render::section::{Plane, Section, cut};
use hlod_tests::{built, ply};

use crate::points::ball_cloud;

/// A model that is built of some triangles, in a folder of its own.
struct Model {
    folder: tempfile::TempDir,
    leaves: Leaves,
}

impl Model {
    fn of(ply: &str, change: impl FnOnce(&mut BuildOptions)) -> Model {
        let folder = tempfile::tempdir().unwrap();
        let (scan, file) = (folder.path().join("scan.ply"), folder.path().join("scan.hlod"));
        std::fs::write(&scan, ply).unwrap();
        built(&scan, &file, change);
        Model { leaves: Leaves::open(&file).unwrap(), folder }
    }

    fn file(&self) -> PathBuf {
        self.folder.path().join("scan.hlod")
    }

    fn cut(&self, plane: &Plane) -> Section {
        cut(&self.leaves, plane, None).unwrap()
    }
}

type Triangles = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// A surface of revolution round y: `n` times round, through the points of a closed or an open
/// profile (radius, height), counter-clockwise seen with the axis on the left.
fn turned(profile: &[[f64; 2]], n: u32, closed: bool) -> Triangles {
    let rows = profile.len() as u32;
    let mut vertices = Vec::new();
    for [r, y] in profile {
        for j in 0..n {
            let phi = std::f64::consts::TAU * f64::from(j) / f64::from(n);
            vertices.push([r * phi.sin(), *y, r * phi.cos()]);
        }
    }
    let mut faces = Vec::new();
    for i in 0..if closed { rows } else { rows - 1 } {
        for j in 0..n {
            let at = |i: u32, j: u32| (i % rows) * n + j % n;
            let (a, b, c, d) = (at(i, j), at(i, j + 1), at(i + 1, j), at(i + 1, j + 1));
            faces.push([a, b, c]);
            faces.push([b, d, c]);
        }
    }
    (vertices, faces)
}

/// A torus round y: radii of the ring and of its section.
fn torus(ring: f64, section: f64, n: u32) -> String {
    let profile: Vec<[f64; 2]> = (0..n)
        .map(|i| {
            let angle = std::f64::consts::TAU * f64::from(i) / f64::from(n);
            [ring + section * angle.cos(), section * angle.sin()]
        })
        .collect();
    let (vertices, faces) = turned(&profile, 3 * n, true);
    ply(&vertices, &faces)
}

/// A cube from `low` to `high` on every axis.
fn cube(low: f64, high: f64) -> Triangles {
    let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high } else { low });
    let quads =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let faces = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    ((0..8).map(corner).collect(), faces)
}

fn area(section: &Section) -> f64 {
    let lines = section.lines.iter().filter(|line| line.closed);
    lines
        .map(|line| {
            let points: Vec<_> = line.points.iter().map(|p| section.frame.to_plane(*p)).collect();
            let next = points.iter().cycle().skip(1);
            points.iter().zip(next).map(|(a, b)| 0.5 * a.perp_dot(*b)).sum::<f64>()
        })
        .sum()
}

fn across(axis: usize, offset: f64) -> Plane {
    Plane::across(axis, offset).unwrap()
}

#[test]
fn a_cube_is_cut_in_squares_also_through_its_corners_and_faces() {
    let (vertices, faces) = cube(-1.0, 1.0);
    let model = Model::of(&ply(&vertices, &faces), |o| o.precision = Some(1.0 / 1024.0));
    for axis in 0..3 {
        // Above a face there is nothing, below the opposite one neither; a face in the plane counts
        // as above it.
        for (offset, expected) in [(0.25, 4.0), (0.0, 4.0), (1.0, 4.0), (1.1, 0.0), (-1.0, 0.0)] {
            let section = model.cut(&across(axis, offset));
            assert_eq!(section.lines.len(), usize::from(expected > 0.0), "{axis} at {offset}");
            assert!((area(&section) - expected).abs() < 1e-9, "{axis} at {offset}");
            assert!(section.lines.iter().all(|line| line.closed));
        }
    }
    // The regular hexagon, and the diagonal plane through four corners.
    let hexagon = model.cut(&Plane::at_point(DVec3::ZERO, DVec3::ONE).unwrap());
    assert!((area(&hexagon) - 3.0 * 3f64.sqrt()).abs() < 1e-9);
    let diagonal = model.cut(&Plane::at_point(DVec3::ZERO, DVec3::new(1.0, -1.0, 0.0)).unwrap());
    assert!((area(&diagonal) - 4.0 * 2f64.sqrt()).abs() < 1e-9);
    assert_eq!((diagonal.lines.len(), diagonal.joins), (1, 0));
}

#[test]
fn many_leaves_of_different_depths_are_cut_as_one_surface() {
    let (ring, tube) = (2.0, 0.75);
    let model = Model::of(&torus(ring, tube, 120), |o| o.leaf_triangles = 300);
    let mut random = 7u64;
    let mut next = || {
        random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (random >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    };
    let mut joins = 0;
    for i in 0..400 {
        let normal = DVec3::new(next(), next(), next());
        let plane =
            Plane::at_point(DVec3::new(2.0 * next(), 0.6 * next(), next()), normal).unwrap();
        let section = model.cut(&plane);
        let open = section.lines.iter().filter(|line| !line.closed).count();
        println!(
            "{i} lines {} open {open} joins {} gap {:.3} area {:.4}",
            section.lines.len(),
            section.joins,
            section.widest_gap / model.leaves.header().lattice.step,
            area(&section)
        );
        assert_eq!(open, 0, "{plane:?}");
        assert_eq!(section.contrary, 0.0);
        joins += section.joins;
    }
    assert!(joins > 0, "leaves of equal depth test nothing");
}

#[test]
fn a_torus_has_two_outlines_whose_areas_are_subtracted() {
    let model = Model::of(&torus(2.0, 0.75, 160), |_| {});
    let section = model.cut(&across(1, 0.0));
    assert_eq!(section.lines.len(), 2);
    let expected = std::f64::consts::PI * (2.75f64.powi(2) - 1.25f64.powi(2));
    assert!((area(&section) / expected - 1.0).abs() < 1e-3);
    let across = model.cut(&across(0, 0.0));
    let expected = 2.0 * std::f64::consts::PI * 0.75f64.powi(2);
    assert!((area(&across) / expected - 1.0).abs() < 1e-3, "{}", area(&across));
}

#[test]
fn clouds_are_refused_by_name() {
    let model = Model::of(&ball_cloud(5000), |_| {});
    let refused = cut(&model.leaves, &across(0, 3.0), None);
    assert!(matches!(refused, Err(RenderError::NoSurface { path }) if path == *model.file()));
}
