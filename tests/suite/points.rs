//! Points: clouds as scans, and points in place of triangles.

use std::path::{Path, PathBuf};

use glam::DVec3;
use hlod_build::progress::Silent;
use hlod_build::{
    BuildError, BuildOptions, Selection, VerifyOptions, build, export, info, list_steps, prepare,
    run_step, verify,
};
use hlod_compress::{Primitives, RepresentationKind};
use hlod_render::audit::{AuditOptions, audit};
use hlod_render::camera::{Camera, Projection};
use hlod_render::framing::Framing;
use hlod_render::picture::{Canvas, PICTURE_FORMAT, take};
use hlod_render::scene::{Light, Representation, Shadow, Shot};
use hlod_render::{Gpu, Model, ModelLimits, frame::Renderer};
use hlod_tests::{built, bumpy_ball, gpu, scan};

use crate::build::rayon_pool;
use crate::pictures::shot;

/// A ball of radius 1 round (3, 0, 0): points on a spiral, with normals and colours.
pub fn ball_cloud(count: u32) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n\
         property float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    );
    for i in 0..count {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let turn = f64::from(i) * 2.399_963_229_728_653;
        let r = (1.0 - z * z).sqrt();
        let (x, y) = (r * turn.cos(), r * turn.sin());
        let red = if x > 0.0 { 200 } else { 40 };
        text += &format!("{:.6} {y:.6} {z:.6} {x:.5} {y:.5} {z:.5} {red} 90 60\n", x + 3.0);
    }
    text
}

struct Files {
    folder: tempfile::TempDir,
}

impl Files {
    fn new() -> Files {
        Files { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).unwrap();
        path
    }
}

/// Small leaves, so that there are many nodes.
fn small(o: &mut BuildOptions) {
    o.leaf_triangles = 1500;
    o.resolution = 128;
}

fn against(path: &Path) -> VerifyOptions {
    VerifyOptions { against: vec![path.to_owned()], ..VerifyOptions::default() }
}

#[test]
fn a_cloud_is_built_verified_and_exported() {
    let files = Files::new();
    let ply = files.write("ball.ply", &ball_cloud(40_000));
    let hlod = files.path("ball.hlod");
    let report = built(&ply, &hlod, small);
    assert_eq!((report.points_input, report.triangles_input), (40_000, 0));
    let info = info(&hlod).unwrap();
    assert_eq!((info.points_input, info.nodes_over_budget), (40_000, 0));
    assert!(info.levels.len() >= 3 && !info.closed_oriented);
    assert!(info.attributes.contains(&"colour".to_owned()));
    assert!(info.levels.iter().all(|level| level.triangles_mean == 0.0 && level.points_mean > 0.0));
    // Levels are coarser, and cover with larger balls.
    let radii: Vec<f64> = info.levels.iter().map(|level| level.cover_radius_max).collect();
    assert!(radii.windows(2).all(|pair| pair[0] >= pair[1]), "{radii:?}");

    let verified = verify(&hlod, &against(&ply), &Silent).unwrap();
    assert!(!verified.is_refuted(), "{:?}", verified.problems);
    assert!(verified.representations_sampled > 2);

    // All points come back.
    let out = files.path("out.ply");
    let kind = RepresentationKind::Appearance;
    let exported = export(&hlod, &out, Selection::Leaves, kind, false).unwrap();
    assert_eq!((exported.vertices, exported.triangles), (40_000, 0));
    let again = files.path("again.hlod");
    assert_eq!(built(&out, &again, small).points_input, 40_000);
}

#[test]
fn another_cloud_is_told_from_the_one_that_was_built() {
    let files = Files::new();
    let ply = files.write("ball.ply", &ball_cloud(5_000));
    let hlod = files.path("ball.hlod");
    built(&ply, &hlod, small);
    let text = ball_cloud(5_000);
    let rows: Vec<&str> = text.lines().collect();
    // A colour, a normal, a place; a point less.
    let changed = |from: &str, to: &str| {
        let mut rows: Vec<String> = rows.iter().map(|row| (*row).to_owned()).collect();
        let row = rows.last_mut().unwrap();
        assert!(row.contains(from), "{row}");
        *row = row.replace(from, to);
        rows.join("\n") + "\n"
    };
    let last = rows[rows.len() - 1];
    let x = last.split(' ').next().unwrap();
    let others = [
        changed(" 90 60", " 91 60"),
        changed(last.split(' ').nth(5).unwrap(), "0.5"),
        changed(x, &format!("{:.6}", x.parse::<f64>().unwrap() + 0.02)),
        text.replace("vertex 5000", "vertex 4999")
            .trim_end()
            .rsplit_once('\n')
            .unwrap()
            .0
            .to_owned()
            + "\n",
    ];
    for other in others {
        let other = files.write("other.ply", &other);
        let verified = verify(&hlod, &against(&other), &Silent).unwrap();
        assert!(verified.is_refuted() && verified.leaves_differ > 0);
    }
}

#[test]
fn the_same_cloud_gives_the_same_bytes_whatever_threads_and_memory() {
    let files = Files::new();
    let ply = files.write("ball.ply", &ball_cloud(30_000));
    let bytes = |threads: usize, memory_mib: u64| {
        let out = files.path(&format!("{threads}-{memory_mib}.hlod"));
        rayon_pool(threads).install(|| {
            built(&ply, &out, |o| {
                o.leaf_triangles = 500;
                o.memory_bytes = memory_mib << 20;
            })
        });
        std::fs::read(out).unwrap()
    };
    let expected = bytes(1, 4096);
    assert_eq!(bytes(3, 4096), expected);
    assert_eq!(bytes(2, 100), expected);
}

#[test]
fn a_cloud_built_step_by_step_has_the_same_bytes() {
    let files = Files::new();
    let ply = files.write("ball.ply", &ball_cloud(40_000));
    let [at_once, in_steps] = ["once.hlod", "steps.hlod"].map(|name| files.path(name));
    // Little memory, so that there are several subtrees.
    let options = BuildOptions {
        leaf_triangles: 200,
        resolution: 64,
        memory_bytes: 96 << 20,
        ..BuildOptions::default()
    };
    let inputs = [ply];
    build(&inputs, &at_once, &options, &Silent).unwrap();
    let folder = prepare(&inputs, &in_steps, &options, &Silent).unwrap();
    let steps = list_steps(&folder).unwrap();
    assert!(steps.len() > 1, "{steps:?}");
    let points: u64 = steps.iter().filter_map(|step| step.triangles).sum();
    assert_eq!(points, 40_000);
    for step in &steps {
        run_step(&folder, &step.name, options.memory_bytes, &Silent).unwrap();
    }
    let resumed = BuildOptions { resume: true, ..options };
    build(&inputs, &in_steps, &resumed, &Silent).unwrap();
    assert!(std::fs::read(at_once).unwrap() == std::fs::read(in_steps).unwrap());
}

#[test]
fn clouds_that_cannot_be_used_are_refused_by_name() {
    let files = Files::new();
    let cloud = files.write("cloud.ply", &ball_cloud(100));
    let mesh = files.write("mesh.ply", &bumpy_ball(10));
    let bare = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
                property float z\nend_header\n0 0 0 1 1 1\n";
    let bare = files.write("bare.ply", bare);
    let refused = |inputs: &[&PathBuf]| {
        let inputs: Vec<PathBuf> = inputs.iter().map(|input| (*input).clone()).collect();
        let out = files.path("out.hlod");
        let error = build(&inputs, &out, &BuildOptions::default(), &Silent).unwrap_err();
        assert!(!out.exists() && !files.path("out.hlod.work").exists());
        error
    };
    assert!(matches!(refused(&[&bare]), BuildError::NoNormals { lacking: 2, points: 2, .. }));
    assert!(matches!(refused(&[&mesh, &cloud]), BuildError::MixedInputs { is_cloud: true, .. }));
    assert!(matches!(refused(&[&cloud, &mesh]), BuildError::MixedInputs { is_cloud: false, .. }));
    // One point is a cloud.
    let one = files.write("one.ply", &ball_cloud(1));
    built(&one, &files.path("one.hlod"), |_| {});
}

/// The model of a file, and what frames it.
fn opened(gpu: &Gpu, file: &Path) -> ([Model; 1], Framing) {
    let model = Model::open(gpu, file, ModelLimits::default()).unwrap();
    let framing = Framing::of(&model);
    ([model], framing)
}

/// Distance in pixels from each pixel's centre to the outline of a ball, positive inside; parallel
/// projection along −z.
fn inside_px(camera: &Camera, size: u32, centre: DVec3, x: u32, y: u32) -> f64 {
    let Projection::Orthographic { height } = camera.projection else { panic!("a parallel view") };
    let pixel = height / f64::from(size);
    let [right, up, _] = camera.axes();
    let middle = f64::from(size) / 2.0;
    let at = camera.target + right * ((f64::from(x) + 0.5 - middle) * pixel)
        - up * ((f64::from(y) + 0.5 - middle) * pixel);
    let off = at - centre;
    let off = DVec3::new(off.dot(right), off.dot(up), 0.0).length();
    (1.0 - off) / pixel
}

/// Wherever the ball is seen, at any size, something is drawn, and nothing where it is not.
#[test]
fn points_cover_a_ball_at_any_size_and_nothing_else() {
    let files = Files::new();
    let ply = files.write("ball.ply", &ball_cloud(120_000));
    let hlod = files.path("ball.hlod");
    built(&ply, &hlod, small);
    for small_triangles in [true, false] {
        let mut gpu = gpu();
        gpu.small_triangles &= small_triangles;
        let (mut models, framing) = opened(&gpu, &hlod);
        let mut renderer = Renderer::new(&gpu, PICTURE_FORMAT);
        let size = 240;
        let canvas = Canvas::new(&gpu, size, size).unwrap();
        let mut counts = Vec::new();
        for zoom in [0.15, 0.3, 0.42, 0.6, 1.0, 2.0] {
            let mut shot = shot(&framing, Representation::Hybrid);
            shot.camera.target = DVec3::new(3.0, 0.0, 0.0);
            shot.camera.eye = shot.camera.target + DVec3::Z * 5.0;
            shot.camera.projection = Projection::Orthographic { height: 2.2 / zoom };
            let stats =
                renderer.render_complete(&gpu, &mut models, &shot, &canvas.targets).unwrap();
            let identities = canvas.identities(&gpu).unwrap();
            assert!(stats.points > 0 && stats.triangles == 0);
            counts.push(stats.points);
            for y in 0..size {
                for x in 0..size {
                    let inside = inside_px(&shot.camera, size, DVec3::new(3.0, 0.0, 0.0), x, y);
                    let is_drawn = identities[(y * size + x) as usize] != 0;
                    if inside > 1.5 {
                        assert!(is_drawn, "a hole at {x}, {y}, zoom {zoom}, {small_triangles}");
                    }
                    // Balls are seen beyond the outline by their radius.
                    if inside < -3.0 {
                        assert!(!is_drawn, "too fat at {x}, {y}, zoom {zoom}, {small_triangles}");
                    }
                }
            }
        }
        // Fewer where it is smaller.
        assert!(counts[0] * 2 < counts[4], "{counts:?}");
    }
}

/// The same ball as triangles is lit alike.
#[test]
fn points_look_like_the_surface_they_were_taken_from() {
    let files = Files::new();
    let mesh = files.write("mesh.ply", &bumpy_ball(160));
    let [as_mesh, leaves, as_cloud] =
        ["mesh.hlod", "leaves.ply", "cloud.hlod"].map(|name| files.path(name));
    built(&mesh, &as_mesh, small);
    export(&as_mesh, &leaves, Selection::Leaves, RepresentationKind::Appearance, false).unwrap();
    let cloud = without_faces(&leaves, &files.path("cloud.ply"));
    built(&cloud, &as_cloud, small);
    let gpu = gpu();
    let size = 160;
    let picture = |file: &Path| {
        let (mut models, framing) = opened(&gpu, file);
        let shot = shot(&framing, Representation::Hybrid);
        take(&gpu, &mut models, &shot, size, size, 2).unwrap().0.rgba
    };
    let (a, b) = (picture(&as_mesh), picture(&as_cloud));
    let off = |a: &[u8], b: &[u8]| (0..3).map(|i| a[i].abs_diff(b[i])).max().unwrap_or(0);
    let far = a.chunks(4).zip(b.chunks(4)).filter(|(a, b)| off(a, b) > 24).count();
    // Outlines differ, by what balls add to them.
    assert!(far < (size * size / 40) as usize, "{far} pixels are lit otherwise");
    let dark: Vec<u8> = a.iter().map(|c| c / 2).collect();
    let far = dark.chunks(4).zip(b.chunks(4)).filter(|(a, b)| off(a, b) > 24).count();
    assert!(far > (size * size / 40) as usize, "the comparison sees nothing");
}

/// An exported mesh's vertices as a cloud.
fn without_faces(mesh: &Path, cloud: &Path) -> PathBuf {
    let bytes = std::fs::read(mesh).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let of = |name: &str| -> usize {
        let rest = header.split(name).nth(1).unwrap();
        rest.split_whitespace().next().unwrap().parse().unwrap()
    };
    let vertices = of("element vertex");
    // Three doubles and three floats.
    let kept = &bytes[end..end + vertices * 36];
    let header = header.split("element face").next().unwrap().to_owned() + "end_header\n";
    std::fs::write(cloud, [header.as_bytes(), kept].concat()).unwrap();
    cloud.to_owned()
}

#[test]
fn clouds_cast_the_shadows_that_rays_find() {
    let files = Files::new();
    // A ball over a floor.
    let mut text = ball_cloud(30_000);
    let floor: Vec<String> = (0..40_000)
        .map(|i| {
            let (x, z) = (f64::from(i % 200) * 0.025 + 0.5, f64::from(i / 200) * 0.025 - 2.5);
            format!("{x:.6} -1.2 {z:.6} 0 1 0 120 120 120\n")
        })
        .collect();
    text = text.replace("vertex 30000", "vertex 70000") + &floor.concat();
    let ply = files.write("scene.ply", &text);
    let hlod = files.path("scene.hlod");
    built(&ply, &hlod, small);
    let gpu = gpu();
    let (mut models, framing) = opened(&gpu, &hlod);
    let size = 200;
    let mut picture = |shadow: Shadow, light: Light| {
        let mut shot = Shot { shadow, light, ..shot(&framing, Representation::Hybrid) };
        shot.camera.eye = shot.camera.target + DVec3::new(0.0, 4.0, 6.0);
        take(&gpu, &mut models, &shot, size, size, 1).unwrap().0.rgba
    };
    let parallel = Light::Directional(DVec3::new(-0.5, 1.0, 0.3));
    let lamp = Light::Point(DVec3::new(1.5, 3.0, 1.0));
    let differ = |a: &[u8], b: &[u8]| {
        a.chunks(4).zip(b.chunks(4)).filter(|(a, b)| a[1].abs_diff(b[1]) > 12).count()
    };
    for light in [parallel, lamp] {
        let [none, hard, traced] =
            [Shadow::None, Shadow::Hard, Shadow::Traced].map(|shadow| picture(shadow, light));
        // Rays meet squares as large as the discs, so that edges differ by a part of a pixel or two.
        let (shadow, wrong) = (differ(&none, &traced), differ(&hard, &traced));
        assert!(shadow > 1_500, "{shadow} pixels are in the shadow");
        assert!(wrong * 12 < shadow, "{wrong} of {shadow} differ");
    }
    // Soft ones, of discs that overlap: as much of the light is hidden as rays to all of it find.
    for (light, light_size) in [(parallel, 4.0), (parallel, 12.0), (lamp, 0.3)] {
        let mut shares = |shadow: Shadow| {
            let mut shot =
                Shot { shadow, light, light_size, ..shot(&framing, Representation::Hybrid) };
            shot.camera.eye = shot.camera.target + DVec3::new(0.0, 4.0, 6.0);
            let canvas = Canvas::new(&gpu, size, size).unwrap();
            let mut renderer = Renderer::new(&gpu, PICTURE_FORMAT);
            renderer.render_complete(&gpu, &mut models, &shot, &canvas.targets).unwrap();
            let seen: Vec<bool> =
                canvas.identities(&gpu).unwrap().iter().map(|&id| id != 0).collect();
            let hidden = canvas.occlusion(&gpu).unwrap();
            let share = |(h, seen): (&u32, &bool)| seen.then_some(f64::from(*h) / 65_535.0);
            hidden.iter().zip(&seen).map(share).collect::<Vec<_>>()
        };
        let [soft, hard, traced] = [Shadow::Soft, Shadow::Hard, Shadow::Traced].map(&mut shares);
        let root = |drawn: &[Option<f64>]| {
            let pairs = drawn.iter().zip(&traced).filter_map(|(d, t)| Some(((*d)?, (*t)?)));
            let inside: Vec<f64> =
                pairs.filter(|(_, t)| *t > 0.0 && *t < 1.0).map(|(d, t)| (d - t).powi(2)).collect();
            ((inside.iter().sum::<f64>() / inside.len() as f64).sqrt(), inside.len())
        };
        let ((of_soft, count), (of_hard, _)) = (root(&soft), root(&hard));
        println!("{light:?} of {light_size}: {of_soft:.3} of {count} pixels, hard {of_hard:.3}");
        assert!(count > 300, "{count} pixels in the penumbra");
        assert!(
            of_soft <= 0.05 && of_soft <= 0.3 * of_hard,
            "{of_soft}, hard {of_hard}: {light_size}"
        );
    }
}

#[test]
fn triangles_become_points_that_cover_them() {
    let files = Files::new();
    let ply = files.write("ball.ply", &bumpy_ball(150));
    let gpu = gpu();
    for primitives in [Primitives::Hybrid, Primitives::Points] {
        let hlod = files.path(primitives.name());
        built(&ply, &hlod, |o| {
            small(o);
            o.primitives = primitives;
            // Cheap enough to be chosen.
            o.point_cost = 0.2;
        });
        let info = info(&hlod).unwrap();
        assert_eq!((info.representation, info.nodes_over_budget), (primitives.name(), 0));
        let points: f64 = info.levels.iter().map(|level| level.points_mean).sum();
        assert!(points > 30.0, "{primitives:?}: {points}");
        let root = &info.levels[0];
        assert_eq!(root.triangles_mean > 0.0, primitives == Primitives::Hybrid);
        assert!(root.triangles_geometric_mean > 0.0);
        let verified = verify(&hlod, &against(&ply), &Silent).unwrap();
        assert!(!verified.is_refuted(), "{primitives:?}: {:?}", verified.problems);

        let (mut models, framing) = opened(&gpu, &hlod);
        let far = Shot { error_threshold_px: 1.0, ..shot(&framing, Representation::Hybrid) };
        let (_, stats) = take(&gpu, &mut models, &far, 200, 200, 1).unwrap();
        assert!(stats.points > 0, "{primitives:?}: {stats:?}");
        let wrong = match primitives {
            Primitives::Hybrid => Representation::Points,
            _ => Representation::Triangles,
        };
        assert!(wrong.check(models[0].header()).is_err());
        let options = AuditOptions {
            size: (160, 120),
            views: 3,
            path: None,
            light: (-45.0, 30.0),
            varied_lights: None,
            pictures: None,
        };
        let report =
            audit(&gpu, &hlod, std::slice::from_ref(&ply), &far, &options, &mut |_| {}).unwrap();
        assert_eq!((report.hole_pixels, report.overdraw_pixels), (0, 0), "{primitives:?}");
    }
}

#[test]
fn the_lion_is_built_and_verified() {
    let Some(ply) = scan("points::the_lion", "lion_takanawa/lion_takanawa_points.ply") else {
        return;
    };
    let files = Files::new();
    let hlod = files.path("lion.hlod");
    let report = built(&ply, &hlod, |_| {});
    assert_eq!(report.points_input, 272_768);
    let verified = verify(&hlod, &against(&ply), &Silent).unwrap();
    assert!(!verified.is_refuted(), "{:?}", verified.problems);
    // 27 bytes a point as scanned.
    assert!(report.bytes_total < 27 * 272_768 * 2 / 3, "{} bytes", report.bytes_total);
    let gpu = gpu();
    let (mut models, framing) = opened(&gpu, &hlod);
    let mut renderer = Renderer::new(&gpu, PICTURE_FORMAT);
    let canvas = Canvas::new(&gpu, 200, 200).unwrap();
    let shot = shot(&framing, Representation::Points);
    shot.representation.check(models[0].header()).unwrap();
    let stats = renderer.render_complete(&gpu, &mut models, &shot, &canvas.targets).unwrap();
    assert!(stats.points > 10_000 && stats.tau_ratio_max <= 1.0);
}
