//! What is drawn: analytic truth on a ball, audits against the scan.

use glam::DVec3;
use hlod_render::audit::{AuditOptions, audit};
use hlod_render::framing::{FOV_Y_DEG, Framing};
use hlod_render::picture::{Canvas, PICTURE_FORMAT, take};
use hlod_render::scene::{
    BACKGROUND, CASTER_THRESHOLD_PX, INTENSITY_STEP, Light, Material, Paint, Representation,
    Shadow, Shot, light_from_angles,
};
use hlod_render::{AdapterChoice, Gpu, Model, ModelLimits, frame::Renderer};
use hlod_tests::{built, bumpy_ball, gpu, scan};

struct Ball {
    gpu: Gpu,
    models: [Model; 1],
    framing: Framing,
    folder: tempfile::TempDir,
}

fn ball(n: u32) -> Ball {
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|f| folder.path().join(f));
    std::fs::write(&ply, bumpy_ball(n)).unwrap();
    built(&ply, &hlod, |o| o.leaf_triangles = 1500);
    let gpu = gpu();
    let model = Model::open(&gpu, &hlod, ModelLimits::default()).unwrap();
    let framing = Framing::of(&model);
    Ball { gpu, models: [model], framing, folder }
}

pub fn shot(framing: &Framing, representation: Representation) -> Shot {
    let camera = framing.fitting([0.0, 0.0, 1.0], 1.0, FOV_Y_DEG);
    Shot {
        camera,
        light: light_from_angles(&camera, -45.0, 30.0),
        spot: None,
        material: Material::default(),
        enhance: Default::default(),
        background: BACKGROUND,
        representation,
        paint: Paint::Shaded,
        error_threshold_px: 0.5,
        shadow: Shadow::None,
        light_size: 0.0,
        caster_threshold_px: CASTER_THRESHOLD_PX,
        intensity_step: INTENSITY_STEP,
        sample_offset_px: glam::DVec2::ZERO,
        draw_backs: false,
        backs_magenta: false,
        draw_skirts: true,
        mixing: hlod_render::scene::Mixing::None,
        clip: hlod_render::clip::ClipPlanes::default(),
    }
}

#[test]
fn a_ball_is_round_lit_from_the_light_and_covers_what_it_should() {
    let mut b = ball(100);
    let size = 200;
    for representation in [Representation::Hybrid, Representation::Geometric, Representation::Full]
    {
        let shot = shot(&b.framing, representation);
        let (picture, stats) = take(&b.gpu, &mut b.models, &shot, size, size, 1).unwrap();
        assert!(stats.triangles > 0 && stats.tau_ratio_max <= 1.0);
        let luma = |x: u32, y: u32| u32::from(picture.rgba[4 * (y * size + x) as usize + 1]);
        // Light comes from the upper left: brighter there than on the opposite side.
        assert!(luma(60, 70) > luma(140, 130) + 60, "{} {}", luma(60, 70), luma(140, 130));
        // A sphere of radius 1 at distance d covers a disc of tangent 1/√(d² − 1).
        let distance = shot.camera.eye.distance(b.framing.centre);
        let radius =
            1.0 / (distance * distance - 1.0).sqrt() / (FOV_Y_DEG.to_radians() / 2.0).tan();
        let expected = std::f64::consts::PI * (radius * f64::from(size) / 2.0).powi(2);
        let canvas = Canvas::new(&b.gpu, size, size).unwrap();
        let mut renderer = Renderer::new(&b.gpu, PICTURE_FORMAT);
        renderer.render_complete(&b.gpu, &mut b.models, &shot, &canvas.targets).unwrap();
        let covered = canvas.identities(&b.gpu).unwrap().iter().filter(|&&id| id != 0).count();
        // Bumps of 2 % of the radius change the area by less than 4 %.
        assert!((covered as f64 / expected - 1.0).abs() < 0.04, "{covered} of {expected}");
    }
}

#[test]
fn shading_is_lambert_where_it_should_be() {
    let mut b = ball(100);
    let mut shot = shot(&b.framing, Representation::Full);
    shot.material = Material { albedo: glam::Vec3::ONE, highlight: 0.0, ambient: 0.0 };
    // Light from the eye: the middle faces it, the brightness falls with the cosine.
    shot.light = Light::Directional(DVec3::Z);
    let size = 256;
    let (picture, _) = take(&b.gpu, &mut b.models, &shot, size, size, 1).unwrap();
    let linear = |x: u32, y: u32| {
        hlod_compress::srgb::linear_from_srgb(picture.rgba[4 * (y * size + x) as usize])
    };
    assert!(linear(128, 128) > 0.95, "{}", linear(128, 128));
    // Halfway to the rim (by the sine) the cosine is 0.866; bumps tilt normals by up to 10°.
    let distance = shot.camera.eye.distance(b.framing.centre);
    let tangent = (FOV_Y_DEG.to_radians() / 2.0).tan();
    let (sin, cos) = (0.5, 0.75f64.sqrt());
    let x = 128.0 * (1.0 + sin / (distance - cos) / tangent);
    assert!((f64::from(linear(x as u32, 128)) - cos).abs() < 0.12, "{}", linear(x as u32, 128));
}

#[test]
fn cold_frames_never_wait_and_fill_up() {
    let mut b = ball(140);
    let shot = shot(&b.framing, Representation::Full);
    let canvas = Canvas::new(&b.gpu, 128, 128).unwrap();
    let mut renderer = Renderer::new(&b.gpu, PICTURE_FORMAT);
    // The root is there from the start; everything else arrives while frames go on.
    let first = renderer.render(&b.gpu, &mut b.models, &shot, &canvas.targets).unwrap();
    assert_eq!(first.nodes, 1);
    assert!(first.missing_parts > 0);
    let mut last = first;
    for _ in 0..2000 {
        last = renderer.render(&b.gpu, &mut b.models, &shot, &canvas.targets).unwrap();
        if last.missing_parts == 0 {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert_eq!(last.missing_parts, 0);
    assert!(last.nodes > 4 && last.triangles > first.triangles);
}

/// What each pixel shows and how deep.
fn layers(b: &mut Ball, renderer: &mut Renderer, shot: &Shot) -> (Vec<u32>, Vec<f32>) {
    let canvas = Canvas::new(&b.gpu, 320, 200).unwrap();
    renderer.render_complete(&b.gpu, &mut b.models, shot, &canvas.targets).unwrap();
    (canvas.identities(&b.gpu).unwrap(), canvas.depths(&b.gpu).unwrap())
}

/// From far away, where triangles are smaller than pixels, to so near that some reach behind the
/// eye; and without the optional feature of the adapter.
#[test]
fn compute_and_fixed_function_show_the_same() {
    let mut b = ball(100);
    assert!(b.gpu.small_triangles, "the software adapter has 64-bit atomics");
    let mut in_compute = Renderer::new(&b.gpu, PICTURE_FORMAT);
    b.gpu.small_triangles = false;
    let mut in_fixed_function = Renderer::new(&b.gpu, PICTURE_FORMAT);
    for (distance, draw_backs) in [(12.0, false), (3.0, false), (1.3, true), (1.02, false)] {
        let mut shot = shot(&b.framing, Representation::Full);
        let middle = shot.camera.target;
        shot.camera.eye = middle + DVec3::new(0.1, 0.2, 0.97).normalize() * distance;
        shot.camera.near = 0.01;
        shot.draw_backs = draw_backs;
        let (small, depths) = layers(&mut b, &mut in_compute, &shot);
        let (fixed, fixed_depths) = layers(&mut b, &mut in_fixed_function, &shot);
        let drawn = fixed.iter().filter(|&&id| id != 0).count();
        assert!(drawn > 300, "{drawn} pixels at {distance}");
        // Both snap corners to 1/256 pixel, but not alike: centres near an edge may change sides.
        let differ = (0..fixed.len()).filter(|&p| small[p] != fixed[p]).count();
        assert!(differ <= 2 + drawn / 50, "{differ} of {drawn} pixels at {distance}");
        let outline = (0..fixed.len()).filter(|&p| (small[p] == 0) != (fixed[p] == 0)).count();
        assert!(outline <= 2 + drawn / 1000, "{outline} of {drawn} pixels at {distance}");
        let deep = |p: &usize| (depths[*p] - fixed_depths[*p]).abs() > 1e-3 * fixed_depths[*p];
        let deep = (0..fixed.len()).filter(|&p| small[p] == fixed[p]).filter(deep).count();
        assert_eq!(deep, 0, "depths at {distance}");
    }
}

/// Some triangles are drawn in compute and some in fixed function, which clips those that leave the picture: no pixel is
/// missed between them.
#[test]
fn nothing_shows_between_compute_and_fixed_function() {
    let mut b = ball(100);
    let mut renderer = Renderer::new(&b.gpu, PICTURE_FORMAT);
    let mut open = Vec::new();
    for i in 0..120 {
        // So near that the ball fills the picture, and triangles are some 15 to 60 pixels large.
        let (turn, height) = (2.4 * f64::from(i), 0.9 - 1.8 * (f64::from(i) + 0.5) / 120.0);
        let across = (1.0 - height * height).sqrt();
        let towards = DVec3::new(across * turn.sin(), height, across * turn.cos());
        let mut shot = shot(&b.framing, Representation::Full);
        shot.camera.eye = shot.camera.target + towards * (1.35 + 0.004 * f64::from(i));
        shot.camera.near = 0.01;
        let (identities, _) = layers(&mut b, &mut renderer, &shot);
        let empty = (0..identities.len()).filter(|&p| identities[p] == 0);
        open.extend(empty.map(|p| (i, p % 320, p / 320)));
    }
    assert!(open.is_empty(), "view, pixel: {open:?}");
}

/// More triangles than one binding could list: each arena has its own list.
#[test]
fn any_number_of_triangles_is_drawn() {
    const BINDING_BYTES: u64 = 1 << 19;
    let mut b = ball(300);
    let mut shot = shot(&b.framing, Representation::Full);
    shot.draw_backs = true;
    let mut renderer = Renderer::new(&b.gpu, PICTURE_FORMAT);
    let (_, depths) = layers(&mut b, &mut renderer, &shot);
    b.gpu = Gpu::headless_binding(AdapterChoice::Software, BINDING_BYTES).unwrap();
    let file = b.folder.path().join("ball.hlod");
    b.models = [Model::open(&b.gpu, &file, ModelLimits::default()).unwrap()];
    let mut renderer = Renderer::new(&b.gpu, PICTURE_FORMAT);
    let (_, in_small_bindings) = layers(&mut b, &mut renderer, &shot);
    let canvas = Canvas::new(&b.gpu, 64, 64).unwrap();
    let stats = renderer.render_complete(&b.gpu, &mut b.models, &shot, &canvas.targets).unwrap();
    assert!(4 * stats.triangles > BINDING_BYTES, "{}", stats.triangles);
    assert!(depths.iter().any(|depth| *depth > 0.0) && depths == in_small_bindings);
}

/// The stages of a frame add up to less than the frame, and only a device opened for it tells them.
#[test]
fn stages_of_a_frame_are_timed_where_that_was_asked_for() {
    let mut b = ball(60);
    let stages_of = |b: &mut Ball, shot: &Shot| -> (Vec<&str>, f64) {
        b.models =
            [Model::open(&b.gpu, &b.folder.path().join("ball.hlod"), ModelLimits::default())
                .unwrap()];
        let canvas = Canvas::new(&b.gpu, 96, 96).unwrap();
        let mut renderer = Renderer::new(&b.gpu, PICTURE_FORMAT);
        let begin = std::time::Instant::now();
        renderer.render_complete(&b.gpu, &mut b.models, shot, &canvas.targets).unwrap();
        b.gpu.wait().unwrap();
        let whole_ms = begin.elapsed().as_secs_f64() * 1e3;
        let stages = renderer.stage_times(&b.gpu).unwrap();
        let sum = stages.iter().map(|(_, ms)| ms).sum::<f64>();
        assert!(sum < whole_ms, "{stages:?} in {whole_ms} ms");
        (stages.iter().map(|(stage, _)| *stage).collect(), sum)
    };
    let mut shot = shot(&b.framing, Representation::Hybrid);
    assert_eq!(stages_of(&mut b, &shot), (Vec::new(), 0.0));
    b.gpu = Gpu::headless_timed(AdapterChoice::Software).unwrap();
    let surface = ["small triangles", "surface", "shade"];
    let (names, sum) = stages_of(&mut b, &shot);
    assert_eq!(names, surface);
    assert!(sum > 0.0);
    shot.shadow = Shadow::Hard;
    let hard = ["small triangles", "surface", "samples", "casters", "large casters", "shade"];
    assert_eq!(stages_of(&mut b, &shot).0, hard);
    shot.shadow = Shadow::Soft;
    shot.light_size = 3.0f64.to_radians();
    let soft =
        ["small triangles", "surface", "samples", "casters", "large casters", "settle", "shade"];
    assert_eq!(stages_of(&mut b, &shot).0, soft);
}

/// From so near that triangles of some ten pixels, which are drawn in compute, lie beside such of fifty, which are not: what
/// they share is missed by neither.
#[test]
fn nothing_shows_through_between_small_and_large_triangles() {
    let mut b = ball(60);
    let mut renderer = Renderer::new(&b.gpu, PICTURE_FORMAT);
    let mut shot = shot(&b.framing, Representation::Full);
    shot.camera.near = 1e-3;
    let (mut holes, mut large) = (0, 0);
    for i in 0..60u32 {
        // On a spiral; the ball covers the whole picture.
        let (y, angle) = (0.9 - 0.03 * f64::from(i), 2.4 * f64::from(i));
        let out =
            DVec3::new((1.0 - y * y).sqrt() * angle.sin(), y, (1.0 - y * y).sqrt() * angle.cos());
        shot.camera.eye = b.framing.centre + 1.15 * out;
        shot.camera.target = b.framing.centre;
        shot.camera.up = out.any_orthonormal_vector();
        let (identities, _) = layers(&mut b, &mut renderer, &shot);
        holes += identities.iter().filter(|&&id| id == 0).count();
        let mut areas: Vec<u32> = identities;
        areas.sort_unstable();
        large += areas.chunk_by(|a, b| a == b).filter(|same| same.len() > 300).count();
    }
    assert_eq!(holes, 0, "pixels through which the ball's inside is seen");
    assert!(large > 100, "{large} triangles are large");
}

/// A ball that is coarse enough for its levels of detail to part visibly.
pub(super) fn coarse_ball(folder: &std::path::Path, resolution: u32) -> [std::path::PathBuf; 2] {
    let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|f| folder.join(f));
    std::fs::write(&ply, bumpy_ball(140)).unwrap();
    built(&ply, &hlod, |o| {
        o.leaf_triangles = 700;
        o.resolution = resolution;
    });
    [ply, hlod]
}

/// Colours follow the depths that are drawn, and lines the faces of cells.
#[test]
fn pictures_explain_levels_and_borders() {
    let folder = tempfile::tempdir().unwrap();
    let [_, hlod] = coarse_ball(folder.path(), 24);
    let gpu = gpu();
    let mut models = [Model::open(&gpu, &hlod, ModelLimits::default()).unwrap()];
    let framing = Framing::of(&models[0]);
    let (size, plain) = (200, shot(&framing, Representation::Hybrid));
    let mut painted = |paint, error_threshold_px| {
        let shot = Shot { paint, error_threshold_px, ..plain };
        let (picture, stats) = take(&gpu, &mut models, &shot, size, size, 1).unwrap();
        (picture, stats.nodes)
    };
    // Hue alone: brightness says how the surface lies.
    let hues = |picture: &hlod_render::picture::Picture| {
        let mut hues: Vec<[u8; 3]> = Vec::new();
        for pixel in picture.rgba.chunks_exact(4) {
            let most = pixel[..3].iter().copied().max().unwrap();
            if most > 100 {
                hues.push([0, 1, 2].map(|i| (u32::from(pixel[i]) * 8 / u32::from(most)) as u8));
            }
        }
        hues.sort_unstable();
        let counted: Vec<usize> = hues.chunk_by(|a, b| a == b).map(<[_]>::len).collect();
        counted.into_iter().filter(|&count| count > 400).count()
    };
    let black = |picture: &hlod_render::picture::Picture| {
        picture.rgba.chunks_exact(4).filter(|p| p[..3] == [0, 0, 0]).count()
    };
    // So coarse that the root will do: one colour, and no lines but those of skirts, of which a
    // closed root has none.
    let (depth, nodes) = painted(Paint::Depth, 100.0);
    assert_eq!((nodes, hues(&depth)), (1, 1));
    assert_eq!(black(&painted(Paint::Borders, 100.0).0), 0);
    // Of a mixed front the depths can be told apart, and the cells' faces are seen as lines.
    let (depth, nodes) = painted(Paint::Depth, 0.5);
    assert!(nodes > 8);
    assert!((1..=4).contains(&hues(&depth)), "{}", hues(&depth));
    let lines = black(&painted(Paint::Borders, 0.5).0);
    assert!((200..8000).contains(&lines), "{lines}");
    // The finest level has a colour of its own.
    let shown = |picture: &hlod_render::picture::Picture| {
        picture.rgba[4 * (100 * 200 + 60)..][..3].to_vec()
    };
    assert_ne!(shown(&painted(Paint::Depth, 100.0).0), shown(&painted(Paint::Depth, 0.1).0));
}

#[test]
fn a_damaged_page_is_drawn_by_its_ancestor_and_reported_once() {
    let b = ball(120);
    let hlod = b.folder.path().join("ball.hlod");
    let mut bytes = std::fs::read(&hlod).unwrap();
    // The last page belongs to a leaf.
    let at = bytes.len() - 10;
    bytes[at] ^= 0xff;
    std::fs::write(&hlod, bytes).unwrap();
    let mut models = [Model::open(&b.gpu, &hlod, ModelLimits::default()).unwrap()];
    let mut covered = 0;
    for direction in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]] {
        let mut shot = shot(&b.framing, Representation::Full);
        shot.camera = b.framing.fitting(direction, 1.0, FOV_Y_DEG);
        let (picture, stats) = take(&b.gpu, &mut models, &shot, 100, 100, 1).unwrap();
        assert!(stats.nodes > 0);
        let middle = &picture.rgba[4 * (50 * 100 + 50)..][..3];
        covered += u32::from(middle.iter().any(|&c| c > 70));
    }
    assert!(covered >= 3, "the ball is drawn from all sides");
    assert_eq!(models[0].take_problems().len(), 1);
}

fn audit_of(b: &Ball, representation: Representation) -> hlod_render::audit::AuditReport {
    let options = AuditOptions {
        size: (160, 120),
        views: 3,
        path: None,
        light: (-45.0, 30.0),
        varied_lights: None,
        pictures: None,
    };
    let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|f| b.folder.path().join(f));
    let shot = shot(&b.framing, representation);
    audit(&b.gpu, &hlod, &[ply], &shot, &options, &mut |_| {}).unwrap()
}

#[test]
fn the_full_model_is_the_scan_and_levels_of_detail_are_near_it() {
    let b = ball(140);
    let full = audit_of(&b, Representation::Full);
    assert_eq!((full.hole_pixels, full.overdraw_pixels), (0, 0));
    let floor = full.appearance_distance_px.floor_p999;
    assert!(full.appearance_distance_px.p999 <= floor + 0.5, "{full:?}");
    assert!(full.silhouette_distance_px.p999 <= 0.25);
    let hybrid = audit_of(&b, Representation::Hybrid);
    assert!(hybrid.pixels_compared > 5000);
    assert_eq!(hybrid.overdraw_pixels, 0);
    assert!(hybrid.silhouette_distance_px.p999 <= 1.0, "{hybrid:?}");
}

#[test]
fn the_bunny_is_drawn_where_it_is() {
    let Some(bunny) = scan("the_bunny_is_drawn_where_it_is", "bunny/bun_zipper.ply") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let hlod = folder.path().join("bunny.hlod");
    built(&bunny, &hlod, |_| {});
    let gpu = gpu();
    let framing = Framing::of(&Model::open(&gpu, &hlod, ModelLimits::default()).unwrap());
    let options = AuditOptions {
        size: (160, 120),
        views: 3,
        path: None,
        light: (-45.0, 40.0),
        varied_lights: None,
        pictures: None,
    };
    let shot = shot(&framing, Representation::Hybrid);
    let report = audit(&gpu, &hlod, &[bunny], &shot, &options, &mut |_| {}).unwrap();
    assert_eq!(report.overdraw_pixels, 0);
    assert!(report.silhouette_distance_px.p99 <= 1.0, "{report:?}");
}
