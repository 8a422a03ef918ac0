//! Plane sections: analytic truth, then whatever surfaces there are.

mod drawings;

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

use glam::DVec3;
use hlod_build::BuildOptions;
use hlod_build::synth::{StatueOptions, describe, write_statue};
use hlod_compress::Unit;
use hlod_render::RenderError;
use hlod_render::leaves::Leaves;
use hlod_render::section::{Plane, Section, cut};
use hlod_tests::{built, ply, scan};

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
            let phi = TAU * f64::from(j) / f64::from(n);
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
            let angle = TAU * f64::from(i) / f64::from(n);
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
    section.measures().area
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
    let mut next = random(7);
    let mut joins = 0;
    for _ in 0..200 {
        let normal = DVec3::new(next(), next(), next());
        let plane =
            Plane::at_point(DVec3::new(2.0 * next(), 0.6 * next(), next()), normal).unwrap();
        let section = model.cut(&plane);
        let open = section.lines.iter().filter(|line| !line.closed).count();
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
    let expected = PI * (2.75f64.powi(2) - 1.25f64.powi(2));
    assert!((area(&section) / expected - 1.0).abs() < 1e-3);
    let across = model.cut(&across(0, 0.0));
    let expected = 2.0 * PI * 0.75f64.powi(2);
    assert!((area(&across) / expected - 1.0).abs() < 1e-3, "{}", area(&across));
}

/// Numbers from −1 to 1, always the same.
fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    }
}

/// A ball of radius 1, as `2 · n²` triangles with their corners on it.
fn ball(n: u32) -> String {
    let profile: Vec<[f64; 2]> = (0..=n)
        .map(|i| PI * (f64::from(i) / f64::from(n) - 0.5))
        .map(|angle| [angle.cos().max(0.0), angle.sin()])
        .collect();
    let (vertices, faces) = turned(&profile, 2 * n, false);
    ply(&vertices, &faces)
}

/// That a section of the ball covers what it must and not what it must not: the discs in balls
/// that are smaller and larger by what the triangles can be off.
fn is_disc(section: &Section, sagitta: f64) -> bool {
    let error = section.trust.file_bound;
    let disc = |radius: f64| PI * (radius.powi(2) - section.plane.offset.powi(2)).max(0.0);
    let area = section.measures().area;
    disc(1.0 - sagitta - error) <= area && area <= disc(1.0 + error)
}

#[test]
fn a_ball_is_cut_in_discs_wherever_it_is_cut() {
    let n = 150;
    let model = Model::of(&ball(n), |o| o.leaf_triangles = 400);
    let mut next = random(11);
    // Edges are chords of half a degree's multiples; triangles' middles lie deeper, by both.
    let sagitta = 2.0 * (1.0 - (PI / f64::from(n) / 2.0).cos()) * 1.5;
    for _ in 0..200 {
        let normal = DVec3::new(next(), next(), next());
        let plane = Plane::from_equation(normal, next() * normal.length() * 0.98).unwrap();
        let section = model.cut(&plane);
        assert_eq!((section.lines.len(), section.measures().open), (1, 0), "{plane:?}");
        assert!(section.measures().area_is_whole && is_disc(&section, sagitta), "{plane:?}");
        // A tenth of the largest disc more or less is noticed.
        let elsewhere = Plane { offset: (plane.offset.powi(2) + 0.1).sqrt(), ..plane };
        assert!(!is_disc(&Section { plane: elsewhere, ..section.clone() }, sagitta));
        // The circle is that of the disc.
        let radius = (1.0 - plane.offset.powi(2)).sqrt();
        let circle = section.measures().circle.unwrap();
        assert!((circle.radius - radius).abs() < 2.0 * sagitta / radius, "{circle:?}");
        assert!(circle.centre.length() < 2.0 * sagitta / radius, "{circle:?}");
        // Where the plane is steep, bounds are near to ε; else larger.
        let trust = section.trust;
        let expected = trust.file_bound / radius;
        assert!((trust.outline_bound_50 / expected - 1.0).abs() < 0.2 || radius < 0.3, "{trust:?}");
        assert!(trust.outline_bound_50 <= trust.outline_bound_95);
    }
    let touching = model.cut(&across(1, 0.999)).trust;
    assert!(touching.grazing > 0.9 && touching.outline_bound_95.is_infinite(), "{touching:?}");
}

#[test]
fn sections_do_not_depend_on_who_reads_first() {
    let model = Model::of(&torus(2.0, 0.75, 60), |o| o.leaf_triangles = 200);
    let plane = Plane::at_point(DVec3::new(0.1, 0.2, 0.0), DVec3::new(1.0, 2.0, 0.3)).unwrap();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let first = one.install(|| model.cut(&plane));
    let again = Leaves::open(&model.file()).unwrap();
    // Other leaves are in memory when this one asks.
    cut(&again, &across(2, 0.3), None).unwrap();
    assert_eq!(first, cut(&again, &plane, None).unwrap());
    assert_ne!(first.lines, model.cut(&plane.moved(1e-3)).lines);
    let lengths: Vec<f64> = first.lines.iter().map(|line| line.length()).collect();
    assert!(lengths.is_sorted_by(|a, b| a >= b));
    for line in &first.lines {
        let least = line.points.iter().map(|p| p.x).fold(f64::INFINITY, f64::min);
        assert_eq!(line.points[0].x, least);
    }
}

#[test]
fn an_open_sheet_has_open_lines_that_end_at_its_border() {
    // A tube without ends, cut along its axis in two lines and across in one.
    let (vertices, faces) = turned(&[[1.0, -2.0], [1.0, 0.0], [1.0, 2.0]], 90, false);
    let model = Model::of(&ply(&vertices, &faces), |_| {});
    let along = model.cut(&across(0, 0.1));
    let measures = along.measures();
    assert_eq!((measures.open, measures.closed, measures.area), (2, 0, 0.0));
    assert!(!measures.area_is_whole && (measures.length - 8.0).abs() < 1e-3);
    for line in &along.lines {
        let ends = [line.points[0].y, line.points[line.points.len() - 1].y].map(f64::abs);
        assert!(ends.iter().all(|y| (y - 2.0).abs() < 1e-3), "{ends:?}");
    }
    assert!(model.cut(&across(1, 0.3)).measures().area_is_whole);
    // Restricted to a half there is one, which goes on to the end of its triangles.
    let half = (DVec3::new(-2.0, -3.0, 0.5), DVec3::new(2.0, 3.0, 2.0));
    let half = cut(&model.leaves, &across(0, 0.1), Some(half)).unwrap();
    assert_eq!((half.lines.len(), half.lines[0].points[0].z > 0.5), (1, true));
}

#[test]
fn surfaces_that_are_none_are_cut_all_the_same() {
    // Five half-planes that meet in the z axis, as a fan of triangles.
    let mut vertices = vec![[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let mut faces = Vec::new();
    for i in 0..5 {
        let angle = TAU * f64::from(i) / 5.0;
        vertices.push([angle.cos(), angle.sin(), 0.5]);
        faces.push([0, 1, 2 + i]);
    }
    let fan = Model::of(&ply(&vertices, &faces), |o| o.precision = Some(1.0 / 4096.0));
    let section = fan.cut(&across(2, 0.5));
    assert_eq!((section.crowded_edges, section.lines.len()), (1, 3));
    assert!((section.measures().length - 5.0).abs() < 1e-3);
    assert!(section.measures().open == 3 && section.contrary > 0.9);

    // Triangles anywhere, facing anywhere.
    let mut next = random(3);
    let vertices: Vec<[f64; 3]> = (0..6000).map(|_| [next(), next(), next()]).collect();
    let any = |next: &mut dyn FnMut() -> f64| ((next() + 1.0) * 2999.0) as u32;
    let faces: Vec<[u32; 3]> = (0..4000).map(|_| [0; 3].map(|_| any(&mut next))).collect();
    let soup = Model::of(&ply(&vertices, &faces), |o| o.leaf_triangles = 1000);
    for axis in 0..3 {
        let section = soup.cut(&across(axis, 0.01));
        let triangles: f64 = section.measures().length;
        assert!(triangles > 100.0 && section.lines.len() > 100, "{triangles}");
        let points = section.lines.iter().flat_map(|line| &line.points);
        assert!(points.clone().all(|p| (p[axis] - 0.01).abs() < 1e-9));
        assert!(section.lines.iter().all(|l| l.points.windows(2).all(|p| p[0] != p[1])));
    }
}

#[test]
fn planes_that_are_none_and_clouds_are_refused() {
    let cloud = Model::of(&ball_cloud(5000), |_| {});
    let refused = cut(&cloud.leaves, &across(0, 3.0), None);
    assert!(matches!(refused, Err(RenderError::NoSurface { path }) if path == *cloud.file()));
    let model = Model::of(&torus(2.0, 0.75, 20), |_| {});
    for (normal, offset) in [(DVec3::ZERO, 1.0), (DVec3::NAN, 0.0), (DVec3::X, f64::NAN)] {
        let plane = Plane { normal, offset };
        assert!(matches!(cut(&model.leaves, &plane, None), Err(RenderError::Usage(_))));
        assert!(Plane::from_equation(normal, offset).is_err());
    }
    assert!(Plane::through([DVec3::X, DVec3::Y, 0.5 * (DVec3::X + DVec3::Y)]).is_err());
    let missed = model.cut(&across(1, 5.0));
    assert_eq!((missed.lines.len(), missed.measures().bounds), (0, None));
}

#[test]
fn a_statues_plinth_is_the_rectangle_that_it_was_carved_as() {
    let folder = tempfile::tempdir().unwrap();
    let [ply, file] = ["statue.ply", "statue.hlod"].map(|name| folder.path().join(name));
    let options = StatueOptions { triangles: 100_000, seed: 1 };
    write_statue(&options, &ply, false, &mut |_, _| {}).unwrap();
    built(&ply, &file, |o| o.unit = Unit::Millimetre);
    let leaves = Leaves::open(&file).unwrap();
    let truth = describe(&options);
    let (low, high) = (truth.plinth.low_mm, truth.plinth.high_mm);

    // Below all cuts in the panel, and well above the plinth's lower edge.
    let section = cut(&leaves, &across(1, 18.0), None).unwrap();
    assert_eq!((section.lines.len(), section.measures().open), (1, 0));
    let tolerance = truth.noise.max_mm + section.trust.file_bound;
    // Marks and chips only cut in.
    let points = &section.lines[0].points;
    let outside = |p: &DVec3| {
        (0..3).map(|i| (low[i] - p[i]).max(p[i] - high[i])).fold(f64::NEG_INFINITY, f64::max)
    };
    let farthest = points.iter().map(outside).fold(f64::NEG_INFINITY, f64::max);
    assert!(farthest <= tolerance, "{farthest}");
    // The panel is plane but for noise; what is beside it is not.
    let panel = &truth.panel;
    let inset = 8.0;
    let is_panel =
        |p: &&DVec3| p.z > 0.0 && p.x > panel.low_mm[0] + inset && p.x < panel.high_mm[0] - inset;
    let on_panel: Vec<&DVec3> = points.iter().filter(is_panel).collect();
    let off = |z: f64| on_panel.iter().map(|p| (p.z - z).abs()).fold(0.0, f64::max);
    assert!(on_panel.len() > 20 && off(panel.z_mm) <= tolerance, "{}", off(panel.z_mm));
    assert!(off(panel.z_mm + 2.0 * tolerance) > tolerance);
    // Chisel marks are half a millimetre deep at most.
    let whole = 300.0 * 240.0 - (4.0 - PI) * truth.plinth.edge_radius_mm.powi(2);
    let measures = section.measures();
    assert!(measures.area_is_whole && measures.area < whole + 1080.0 * tolerance);
    assert!(measures.area > whole - 1080.0 * (0.5 + tolerance), "{}", measures.area);
}

#[test]
fn a_closed_scan_has_no_open_lines() {
    let Some(igea) = scan("a_closed_scan_has_no_open_lines", "igea/igea_tristrips.ply") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("igea.hlod");
    built(&igea, &file, |o| o.leaf_triangles = 3000);
    let leaves = Leaves::open(&file).unwrap();
    let header = leaves.header();
    let [low, high] = header.bounds.map(|p| leaves.place(p));
    let mut next = random(5);
    let mut joins = 0;
    for _ in 0..60 {
        let t = DVec3::new(next(), next(), next()) * 0.15 + 0.5;
        let normal = DVec3::new(next(), next(), next());
        let plane = Plane::at_point(low + (high - low) * t, normal).unwrap();
        let section = cut(&leaves, &plane, None).unwrap();
        assert!(!section.lines.is_empty() && section.measures().area_is_whole, "{plane:?}");
        joins += section.joins;
    }
    assert!(joins > 0);
}
