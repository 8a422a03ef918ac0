//! Paints that explain: each pixel's colour is what the scan, or the proof, says of the point that is seen there.

use std::path::Path;

use glam::DVec3;
use hlod_compress::srgb::linear_from_srgb;
use hlod_render::camera::{Camera, Projection};
use hlod_render::colour_map::{NO_VALUE, TURN_MAX_DEG, bend_colour, bound_colour, bounds_shown};
use hlod_render::figure::Sheet;
use hlod_render::framing::{FOV_Y_DEG, Framing};
use hlod_render::picture::{Picture, take};
use hlod_render::scene::{Light, Paint, Representation, Shot, Spot};
use hlod_render::{Gpu, Model, ModelLimits};
use hlod_tests::{ball, built, gpu, ply};

use crate::pictures::shot;

const SIZE: u32 = 200;

struct Scene {
    gpu: Gpu,
    models: [Model; 1],
    shot: Shot,
    _folder: tempfile::TempDir,
}

fn scene(ply: &str) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let [scan, hlod] = ["scan.ply", "scan.hlod"].map(|f| folder.path().join(f));
    std::fs::write(&scan, ply).unwrap();
    built(&scan, &hlod, |o| o.leaf_triangles = 3000);
    let gpu = gpu();
    let models = [Model::open(&gpu, Path::new(&hlod), ModelLimits::default()).unwrap()];
    let shot = shot(&Framing::of(&models[0]), Representation::Hybrid);
    Scene { gpu, models, shot, _folder: folder }
}

impl Scene {
    fn picture(&mut self, change: impl FnOnce(&mut Shot)) -> Picture {
        let mut shot = self.shot;
        change(&mut shot);
        take(&self.gpu, &mut self.models, &shot, SIZE, SIZE, 1).unwrap().0
    }

    /// Where the ray through a pixel's middle meets the ball of radius 1 at the origin.
    fn on_ball(&self, x: u32, y: u32) -> Option<DVec3> {
        let camera = &self.shot.camera;
        let forward = (camera.target - camera.eye).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let half = (FOV_Y_DEG.to_radians() / 2.0).tan();
        let at = |v: u32| (f64::from(v) + 0.5) / f64::from(SIZE) * 2.0 - 1.0;
        let up = right.cross(forward);
        let ray = (forward + half * (right * at(x) - up * at(y))).normalize();
        let middle = -camera.eye.dot(ray);
        let under = middle * middle - camera.eye.length_squared() + 1.0;
        (under > 0.0).then(|| camera.eye + ray * (middle - under.sqrt()))
    }
}

fn pixel(picture: &Picture, x: u32, y: u32) -> [u8; 3] {
    let at = 4 * (y * picture.width + x) as usize;
    [picture.rgba[at], picture.rgba[at + 1], picture.rgba[at + 2]]
}

/// The largest difference between pixels and what is expected of points of the ball that face the eye.
fn farthest(s: &Scene, picture: &Picture, expected: impl Fn(DVec3) -> [f64; 3]) -> f64 {
    let mut farthest = 0.0f64;
    let mut seen = 0;
    for (x, y) in (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y))) {
        let Some(p) = s.on_ball(x, y).filter(|p| p.z > 0.35) else { continue };
        seen += 1;
        for (found, wanted) in pixel(picture, x, y).into_iter().zip(expected(p)) {
            farthest = farthest.max((f64::from(found) - wanted).abs());
        }
    }
    assert!(seen > 5_000, "{seen} pixels");
    farthest
}

#[test]
fn normals_are_those_of_the_ball() {
    let mut s = scene(&ball(120, 0.0));
    for representation in [Representation::Full, Representation::Hybrid] {
        let picture = s.picture(|shot| {
            shot.paint = Paint::Normals;
            shot.representation = representation;
        });
        let colour = |n: DVec3| (n + 1.0).to_array().map(|x| x * 127.5);
        let off = farthest(&s, &picture, colour);
        assert!(off < 6.0, "{representation:?}: {off} of 255");
        // x and y exchanged is told apart.
        assert!(farthest(&s, &picture, |n| colour(DVec3::new(n.y, n.x, n.z))) > 60.0);
    }
}

/// How far colours are from shades of one, of 1: all that are neither dark nor background.
fn off_hue(picture: &Picture, background: [u8; 3], srgb: [u8; 3]) -> f32 {
    let wanted = srgb.map(linear_from_srgb);
    let largest = |c: [f32; 3]| c.into_iter().fold(1e-6, f32::max);
    let mut off = 0.0f32;
    for found in picture.rgba.chunks_exact(4).map(|p| [p[0], p[1], p[2]]) {
        let linear = found.map(linear_from_srgb);
        if found == background || largest(linear) < 0.1 {
            continue;
        }
        for k in 0..3 {
            off = off.max((linear[k] / largest(linear) - wanted[k] / largest(wanted)).abs());
        }
    }
    off
}

#[test]
fn bounds_and_kinds_are_those_of_what_is_drawn() {
    let mut s = scene(&ball(120, 0.0));
    let background = pixel(&s.picture(|_| ()), 0, 0);
    let bounds = bounds_shown(s.models[0].header());
    let root = &s.models[0].skeleton().nodes()[0];
    let appearance = root.representations.iter().find(|r| r.kind as u8 == 2).unwrap();
    let of_root = bound_colour(appearance.geometric_error, bounds);
    let coarse = |paint| {
        move |shot: &mut Shot| {
            shot.paint = paint;
            shot.error_threshold_px = 1000.0;
        }
    };
    let full = |paint| {
        move |shot: &mut Shot| {
            shot.paint = paint;
            shot.representation = Representation::Full;
        }
    };
    let (blue, orange) = ([0.09, 0.46, 0.81], [0.79, 0.35, 0.0]);
    let srgb = |linear: [f32; 3]| linear.map(hlod_compress::srgb::srgb_from_linear);
    let cases = [
        ("bound, root", s.picture(coarse(Paint::Bound)), of_root),
        ("bound, leaves", s.picture(full(Paint::Bound)), NO_VALUE),
        ("kinds, root", s.picture(coarse(Paint::Kinds)), srgb(blue)),
        ("kinds, leaves", s.picture(full(Paint::Kinds)), NO_VALUE),
    ];
    for (name, picture, colour) in &cases {
        let off = off_hue(picture, background, *colour);
        assert!(off < 0.04, "{name}: {off}");
        assert!(off_hue(picture, background, srgb(orange)) > 0.2, "{name}");
    }
}

#[test]
fn edges_are_where_triangles_end() {
    let square = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    let mut s = scene(&ply(&square, &[[0, 1, 2], [0, 2, 3]]));
    let picture = s.picture(|shot| shot.paint = Paint::Edges);
    // The diagonal is from the lower left to the upper right, through the middle of the picture.
    let dark = |x: u32, y: u32| pixel(&picture, x, y).iter().all(|c| *c < 90);
    for along in [-30i32, -10, 0, 10, 30] {
        let at = |off: i32| ((100 + along + off) as u32, (99 - along) as u32);
        let (x, y) = at(0);
        assert!(dark(x, y), "{along}");
        for off in [-6, 6] {
            let (x, y) = at(off);
            assert!(!dark(x, y), "{along} {off}");
        }
    }
}

/// A height field over a square of 2 × 2 that faces the eye.
fn field(height: impl Fn(f64, f64) -> f64) -> String {
    const N: u32 = 80;
    let at = |i: u32| f64::from(i) / f64::from(N) * 2.0 - 1.0;
    let side = 0..=N;
    let points = side.clone().flat_map(|j| side.clone().map(move |i| (at(i), at(j))));
    let points: Vec<[f64; 3]> = points.map(|(x, y)| [x, y, height(x, y)]).collect();
    let corner = |i: u32, j: u32| j * (N + 1) + i;
    let cells = (0..N).flat_map(|j| (0..N).map(move |i| (i, j)));
    let faces = cells.flat_map(|(i, j)| {
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    ply(&points, &faces.collect::<Vec<_>>())
}

/// Looks straight at a field by parallel rays, so that a pixel is equally long everywhere.
fn from_above(shot: &mut Shot) {
    let projection = Projection::Orthographic { height: 2.4 };
    shot.camera = Camera {
        eye: DVec3::new(0.0, 0.0, 5.0),
        target: DVec3::ZERO,
        up: DVec3::Y,
        projection,
        near: 0.0,
    };
    shot.representation = Representation::Full;
}

/// How far a pixel's hue is from a bend's, of 1.
fn off_bend(found: [u8; 3], bend: f32) -> f32 {
    let [found, wanted] = [found, bend_colour(bend)].map(|srgb| {
        let linear = srgb.map(linear_from_srgb);
        linear.map(|c| c / linear.into_iter().fold(1e-6, f32::max))
    });
    (0..3).map(|k| (found[k] - wanted[k]).abs()).fold(0.0, f32::max)
}

#[test]
fn bends_are_those_of_balls_and_bowls_whatever_their_place_in_the_picture() {
    const RADIUS: f64 = 3.0;
    let radius_px = 12.0;
    // Of a ball: radius of the neighbourhood over radius of the ball.
    let pixel_side = 2.4 / f64::from(SIZE);
    let turn = radius_px * pixel_side / RADIUS / TURN_MAX_DEG.to_radians();
    for sign in [1.0, -1.0] {
        let ball = |x: f64, y: f64| sign * (RADIUS * RADIUS - x * x - y * y).sqrt();
        let mut s = scene(&field(ball));
        let picture = s.picture(|shot| {
            from_above(shot);
            shot.paint = Paint::Curvature;
            shot.enhance.radius_px = radius_px as f32;
        });
        let wanted = (sign * turn) as f32;
        assert!((0.1..0.5).contains(&wanted.abs()), "{wanted}");
        let middle = (40..160).step_by(10);
        for (x, y) in middle.clone().flat_map(|y| middle.clone().map(move |x| (x, y))) {
            let found = pixel(&picture, x, y);
            let off = off_bend(found, wanted);
            assert!(off < 0.05, "{sign} at {x}, {y}: {found:?}, {off}");
            assert!(off_bend(found, -wanted) > 0.1, "the other way round");
            assert!(off_bend(found, 2.0 * wanted) > 0.1, "twice as much");
        }
    }
}

/// A groove in a plane: its bottom darker, its edges brighter, and the plane as it was, to a step.
#[test]
fn relief_is_enhanced_where_it_is_and_nowhere_else() {
    let groove = |x: f64, _: f64| -0.02 * (-(x / 0.05).powi(2)).exp();
    let mut s = scene(&field(groove));
    let mut take = |strength: f32, size: u32| {
        let mut shot = s.shot;
        from_above(&mut shot);
        shot.light = Light::Directional(DVec3::Z);
        shot.enhance.strength = strength;
        let mut sheet = Sheet::of(&shot, SIZE, SIZE);
        sheet.part_px = Some(size);
        sheet.picture(&s.gpu, &mut s.models).unwrap()
    };
    let (plain, enhanced) = (take(0.0, SIZE), take(0.7, SIZE));
    let light = |picture: &Picture, x: u32| i32::from(pixel(picture, x, 100)[1]);
    let change = |x: u32| light(&enhanced, x) - light(&plain, x);
    // The groove is 8 pixels wide.
    assert!(change(100) < -15, "its bottom: {}", change(100));
    assert!(change(93).max(change(92)) > 5, "its edge: {} {}", change(93), change(92));
    for x in [30, 50, 70, 130, 160] {
        assert!(change(x).abs() <= 1, "the plane at {x}: {}", change(x));
    }
    // Pixels near sides of parts ask those of other parts.
    assert_eq!(take(0.7, 37).rgba, enhanced.rgba, "in parts");
    assert_ne!(take(0.6, 37).rgba, enhanced.rgba, "with less");
}

/// A lamp before a plane: within its cone the plane is as bright as without one, beyond it dark, and between it falls
/// off.
#[test]
fn a_spot_shines_within_its_cone_alone() {
    let mut s = scene(&field(|_, _| 0.0));
    let (away, angle_deg) = (2.0f64, 36.0f64);
    let mut take = |spot: Option<Spot>| {
        s.picture(|shot| {
            from_above(shot);
            shot.light = Light::Point(DVec3::new(0.1, 0.0, away));
            shot.spot = spot;
            shot.material.ambient = 0.0;
            shot.material.highlight = 0.0;
        })
    };
    let everywhere = take(None);
    let cone = take(Some(Spot { towards: -DVec3::Z, angle_deg }));
    let elsewhere =
        take(Some(Spot { towards: DVec3::new(-0.3, 0.0, -0.9).normalize(), angle_deg }));
    let side = away * (angle_deg / 2.0).to_radians().tan();
    let mut seen = [0; 3];
    for (x, y) in (20..180).flat_map(|y| (20..180).map(move |x| (x, y))) {
        let at = |v: u32| (f64::from(v) + 0.5) / f64::from(SIZE) * 2.4 - 1.2;
        let from_axis = (at(x) - 0.1).hypot(at(y));
        let (with, without) = (pixel(&cone, x, y), pixel(&everywhere, x, y));
        if from_axis < 0.88 * side {
            assert_eq!(with, without, "{x}, {y}");
            seen[0] += 1;
        } else if from_axis > 1.01 * side {
            assert_eq!(with, [0; 3], "{x}, {y}");
            seen[1] += 1;
        } else if with != without && with != [0; 3] {
            seen[2] += 1;
        }
    }
    assert!(seen.iter().all(|count| *count > 200), "{seen:?}");
    assert_ne!(cone.rgba, elsewhere.rgba, "where it is aimed at matters");
}
