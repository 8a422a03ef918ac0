//! Shadows: analytic truth on a floor under a ball and a cube, rays against all triangles, lights in
//! awkward places.

use glam::{DVec2, DVec3};
use hlod_render::audit::{AuditOptions, audit};
use hlod_render::camera::{Camera, Projection};
use hlod_render::frame::{FrameStats, Renderer};
use hlod_render::framing::{FOV_Y_DEG, Framing};
use hlod_render::picture::{Canvas, PICTURE_FORMAT};
use hlod_render::scene::{
    BACKGROUND, CASTER_THRESHOLD_PX, EXACT_THRESHOLDS_PX, INTENSITY_STEP, Light, Material, Paint,
    Representation, Shadow, Shot,
};
use hlod_render::{Gpu, Model, ModelLimits};
use hlod_tests::{built, gpu, ply, scan};

pub(super) const SIZE: (u32, u32) = (480, 320);
const RADIUS: f64 = 0.5;
pub(super) const MIDDLE: DVec3 = DVec3::new(0.1, 1.0, -0.05);

pub(super) struct Scene {
    pub(super) gpu: Gpu,
    pub(super) models: [Model; 1],
    _folder: tempfile::TempDir,
}

impl Scene {
    pub(super) fn new(mesh: (Vec<[f64; 3]>, Vec<[u32; 3]>)) -> Scene {
        let folder = tempfile::tempdir().unwrap();
        let [input, output] = ["scene.ply", "scene.hlod"].map(|f| folder.path().join(f));
        std::fs::write(&input, ply(&mesh.0, &mesh.1)).unwrap();
        built(&input, &output, |o| o.leaf_triangles = 2000);
        let gpu = gpu();
        let model = Model::open(&gpu, &output, ModelLimits::default()).unwrap();
        Scene { gpu, models: [model], _folder: folder }
    }

    /// What each pixel shows of the floor and whether it is hidden, and of all pixels the
    /// occlusion; `None` where the background or something else is seen.
    pub(super) fn floor(&mut self, shot: &Shot) -> Vec<Option<(DVec3, bool)>> {
        let (canvas, _) = self.draw(shot);
        let depths = canvas.depths(&self.gpu).unwrap();
        let occlusion = canvas.occlusion(&self.gpu).unwrap();
        let place = |(p, &depth): (usize, &f32)| {
            let place = place(&shot.camera, p, depth)?;
            (place.y.abs() < 1e-4).then_some((place, occlusion[p] > 0))
        };
        depths.iter().enumerate().map(place).collect()
    }

    fn draw(&mut self, shot: &Shot) -> (Canvas, FrameStats) {
        let canvas = Canvas::new(&self.gpu, SIZE.0, SIZE.1).unwrap();
        let mut renderer = Renderer::new(&self.gpu, PICTURE_FORMAT);
        let stats =
            renderer.render_complete(&self.gpu, &mut self.models, shot, &canvas.targets).unwrap();
        (canvas, stats)
    }

    pub(super) fn occlusion(&mut self, shot: &Shot) -> (Vec<u32>, Vec<u32>) {
        let (canvas, _) = self.draw(shot);
        (canvas.occlusion(&self.gpu).unwrap(), canvas.identities(&self.gpu).unwrap())
    }
}

/// The point in a pixel's middle, world space.
fn place(camera: &Camera, pixel: usize, depth: f32) -> Option<DVec3> {
    if depth == 0.0 {
        return None;
    }
    let (x, y) = (pixel % SIZE.0 as usize, pixel / SIZE.0 as usize);
    let size = DVec2::new(SIZE.0.into(), SIZE.1.into());
    let ndc =
        (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) / size * 2.0 - 1.0) * DVec2::new(1.0, -1.0);
    let half = camera.half_extent(size.x / size.y);
    let distance = camera.near / f64::from(depth);
    let [right, up, back] = camera.axes();
    let across = ndc * half * distance;
    Some(camera.eye + right * across.x + up * across.y - back * distance)
}

/// World units of a pixel at a point.
fn pixel_at(camera: &Camera, p: DVec3) -> f64 {
    let distance = (camera.eye - p).dot(camera.axes()[2]);
    2.0 * camera.half_extent(1.0).y * distance / f64::from(SIZE.1)
}

/// A square floor from −2 to 2 at y = 0.
fn floor(n: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let at = |i: u32| 4.0 * f64::from(i) / f64::from(n) - 2.0;
    let vertices = (0..=n).flat_map(|j| (0..=n).map(move |i| [at(i), 0.0, at(j)])).collect();
    let mut faces = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let (a, b) = (j * (n + 1) + i, (j + 1) * (n + 1) + i);
            faces.extend([[a, b, a + 1], [a + 1, b, b + 1]]);
        }
    }
    (vertices, faces)
}

fn add(to: &mut (Vec<[f64; 3]>, Vec<[u32; 3]>), vertices: Vec<[f64; 3]>, faces: Vec<[u32; 3]>) {
    let first = to.0.len() as u32;
    to.0.extend(vertices);
    to.1.extend(faces.into_iter().map(|t| t.map(|v| v + first)));
}

/// A ball over a floor.
pub(super) fn ball() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let n = 160;
    let mut scene = floor(64);
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for i in 0..=n {
        for j in 0..n {
            let theta = std::f64::consts::PI * f64::from(i) / f64::from(n);
            let phi = std::f64::consts::TAU * f64::from(j) / f64::from(n);
            let p = DVec3::new(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos());
            vertices.push((MIDDLE + RADIUS * p).to_array());
            if i < n {
                let (a, b) = (i * n + j, i * n + (j + 1) % n);
                faces.extend([[a, a + n, b], [b, a + n, b + n]]);
            }
        }
    }
    add(&mut scene, vertices, faces);
    scene
}

/// A cube of edge 1 that stands on a floor.
fn cube() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let mut scene = floor(64);
    let corner = |i: u32| [0, 1, 2].map(|a| f64::from(i >> a & 1) - if a == 1 { 0.0 } else { 0.5 });
    let quads =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let faces = quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    add(&mut scene, (0..8).map(corner).collect(), faces);
    scene
}

fn camera(eye: DVec3) -> Camera {
    let projection = Projection::Perspective { fov_y: FOV_Y_DEG.to_radians() };
    Camera { eye, target: DVec3::new(0.0, 0.3, 0.0), up: DVec3::Y, projection, near: 0.05 }
}

pub(super) fn shot(eye: DVec3, light: Light) -> Shot {
    Shot {
        camera: camera(eye),
        light,
        spot: None,
        material: Material::default(),
        enhance: Default::default(),
        background: BACKGROUND,
        representation: Representation::Hybrid,
        paint: Paint::Shaded,
        error_threshold_px: 0.5,
        shadow: Shadow::Hard,
        light_size: 0.0,
        caster_threshold_px: CASTER_THRESHOLD_PX,
        intensity_step: INTENSITY_STEP,
        sample_offset_px: DVec2::ZERO,
        draw_backs: false,
        backs_magenta: false,
        draw_skirts: true,
        mixing: hlod_render::scene::Mixing::None,
        clip: hlod_render::clip::ClipPlanes::default(),
    }
}

pub(super) const EYE: DVec3 = DVec3::new(1.5, 3.0, 4.5);

/// The way from a point to a light, of length 1.
fn towards(light: Light, p: DVec3) -> DVec3 {
    match light {
        Light::Directional(d) => d.normalize(),
        Light::Point(l) => (l - p).normalize(),
    }
}

/// How far the way from a point to the light passes outside the ball; negative inside.
fn beside_ball(light: Light, p: DVec3) -> f64 {
    let offset = MIDDLE - p;
    offset.cross(towards(light, p)).length() - RADIUS
}

/// Pixels where shadow and no shadow are mixed up, farther than `margin` pixels (measured across the
/// light) from the ball's outline; and how many pixels are in its shadow.
pub(super) fn wrong_on_floor(
    floor: &[Option<(DVec3, bool)>],
    shot: &Shot,
    light: Light,
    margin: f64,
) -> [usize; 2] {
    let mut counts = [0; 2];
    for &(p, is_hidden) in floor.iter().flatten() {
        let beside = beside_ball(light, p);
        counts[1] += usize::from(is_hidden);
        let is_clear = beside.abs() > margin * pixel_at(&shot.camera, p) + 3e-4;
        counts[0] += usize::from(is_clear && is_hidden != (beside < 0.0));
    }
    counts
}

#[test]
fn a_ball_s_shadow_lies_where_it_should() {
    let mut scene = Scene::new(ball());
    let lights = [
        Light::Directional(DVec3::new(0.2, 1.0, 0.1)),
        Light::Directional(DVec3::new(-0.9, 0.8, -0.4)),
        Light::Point(DVec3::new(0.4, 4.0, -0.3)),
        Light::Point(DVec3::new(-1.4, 1.9, 0.9)),
        // Close to what casts, far from what receives.
        Light::Point(MIDDLE + DVec3::new(0.05, 0.6, 0.1)),
    ];
    for light in lights {
        for tau_c in [CASTER_THRESHOLD_PX, 4.0] {
            let shot = Shot { caster_threshold_px: tau_c, ..shot(EYE, light) };
            let floor = scene.floor(&shot);
            let [wrong, hidden] = wrong_on_floor(&floor, &shot, light, tau_c);
            assert!(hidden > 1000, "{light:?}: {hidden} pixels in shadow");
            assert_eq!(wrong, 0, "{light:?}, τ_c {tau_c}: of {hidden} in shadow");
            // The comparison itself: a light that is elsewhere by 3°.
            let turned = match light {
                Light::Directional(d) => Light::Directional(d.normalize() + DVec3::X * 0.05),
                Light::Point(l) => Light::Point(l + DVec3::X * 0.05 * l.distance(MIDDLE)),
            };
            assert!(wrong_on_floor(&floor, &shot, turned, tau_c.min(0.5))[0] > 20, "{light:?}");
        }
    }
}

/// Whether the way from a point meets a cube that is larger on all sides by `more`.
fn meets_cube(light: Light, p: DVec3, more: f64) -> bool {
    let low = DVec3::new(-0.5, 0.0, -0.5) - more;
    let high = DVec3::new(0.5, 1.0, 0.5) + more;
    let inverse = towards(light, p).recip();
    let (a, b) = ((low - p) * inverse, (high - p) * inverse);
    let enter = a.min(b).max_element().max(0.0);
    enter < a.max(b).min_element()
}

#[test]
fn a_cube_s_shadow_begins_where_it_stands() {
    let mut scene = Scene::new(cube());
    for light in [
        Light::Directional(DVec3::new(-0.6, 1.0, -0.2)),
        // Nearly along the floor.
        Light::Directional(DVec3::new(-1.0, 0.12, 0.35)),
        Light::Point(DVec3::new(-1.5, 2.5, -1.0)),
    ] {
        let shot = shot(EYE, light);
        let (mut wrong, mut hidden) = (0, 0);
        for (p, is_hidden) in scene.floor(&shot).into_iter().flatten() {
            let margin = CASTER_THRESHOLD_PX * pixel_at(&shot.camera, p) + 1e-4;
            let [surely, perhaps] = [-margin, margin].map(|m| meets_cube(light, p, m));
            hidden += usize::from(is_hidden);
            // What grazes the cube's wall or stands under it is not judged.
            wrong += usize::from(surely == perhaps && is_hidden != surely);
        }
        assert!(hidden > 500, "{light:?}: {hidden}");
        assert_eq!(wrong, 0, "{light:?}: of {hidden} pixels in shadow");
    }
}

/// Pixels in which two pictures' occlusion differs, and those in which anything is seen. A floor that
/// the light lies in is neither lit nor hidden, and not compared.
fn different(scene: &mut Scene, one: &Shot, other: &Shot) -> [usize; 2] {
    let (canvas, _) = scene.draw(one);
    let depths = canvas.depths(&scene.gpu).unwrap();
    let a = canvas.occlusion(&scene.gpu).unwrap();
    let (b, _) = scene.occlusion(other);
    let in_floor = matches!(one.light, Light::Point(l) if l.y == 0.0);
    let mut counts = [0; 2];
    for (p, &depth) in depths.iter().enumerate() {
        let Some(place) = place(&one.camera, p, depth) else { continue };
        let is_compared = !(in_floor && place.y.abs() < 1e-4);
        counts[0] += usize::from(is_compared && a[p] != b[p]);
        counts[1] += 1;
    }
    counts
}

#[test]
fn lights_in_awkward_places_are_as_rays_say() {
    let mut scene = Scene::new(ball());
    let below = DVec3::new(0.3, -1.0, 0.2);
    let eyes = [EYE, DVec3::new(0.6, 0.2, 0.5), MIDDLE];
    let lights = [
        ("inside the ball", Light::Point(MIDDLE)),
        ("at the eye", Light::Point(EYE)),
        ("behind the eye", Light::Point(EYE * 2.0)),
        ("in the eye's plane", Light::Point(EYE + camera(EYE).axes()[0] * 2.0)),
        ("far away", Light::Point(DVec3::new(3e4, 5e4, 1e4))),
        ("below the floor", Light::Point(below)),
        ("amid what is seen", Light::Point(DVec3::new(0.6, 0.3, 0.6))),
        ("parallel from below", Light::Directional(-DVec3::Y)),
        ("along the floor", Light::Directional(DVec3::X)),
        ("behind the picture", Light::Directional(EYE)),
        ("against the eye", Light::Directional(-EYE)),
        ("on the floor", Light::Point(DVec3::new(1.0, 0.0, 1.0))),
        ("on the ball", Light::Point(MIDDLE + DVec3::Y * RADIUS)),
    ];
    for eye in eyes {
        for (name, light) in lights {
            let full = Shot { representation: Representation::Full, ..shot(eye, light) };
            let traced = Shot { shadow: Shadow::Traced, ..full };
            let [wrong, seen] = different(&mut scene, &full, &traced);
            assert!(seen > 5_000, "{name} from {eye}: {seen} pixels");
            // Points that rounding takes to the other side of an edge.
            assert!(wrong <= seen / 1000, "light {name}, eye {eye}: {wrong} of {seen} pixels");
        }
    }
}

#[test]
fn a_light_at_the_eye_hides_nothing_that_is_seen() {
    let mut scene = Scene::new(ball());
    let (occlusion, identities) = scene.occlusion(&shot(EYE, Light::Point(EYE)));
    let seen = identities.iter().filter(|&&id| id != 0).count();
    let hidden = occlusion.iter().filter(|&&o| o > 0).count();
    assert!(seen > 5_000 && hidden * 500 < seen, "{hidden} of {seen} pixels are hidden");
    // And one on the other side of the floor hides everything.
    let (occlusion, identities) = scene.occlusion(&shot(EYE, Light::Point(-EYE)));
    let lit = identities.iter().zip(&occlusion).filter(|(id, o)| **id != 0 && **o == 0).count();
    assert_eq!(lit, 0);
}

#[test]
fn shadows_need_no_optional_feature() {
    let mut scene = Scene::new(ball());
    let shot = shot(EYE, Light::Point(DVec3::new(0.4, 4.0, -0.3)));
    let (with, _) = scene.occlusion(&shot);
    scene.gpu.small_triangles = false;
    let (without, _) = scene.occlusion(&shot);
    let differ = with.iter().zip(&without).filter(|(a, b)| a != b).count();
    // Fixed function may give a pixel on an edge to another triangle.
    assert!(differ < 20, "{differ} pixels");
}

#[test]
fn scans_cast_as_their_every_triangle_does() {
    for name in ["bunny/bun_zipper.ply", "happy_buddha/happy_buddha.ply"] {
        let Some(path) = scan("scans_cast_as_their_every_triangle_does", name) else { continue };
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scan.hlod");
        built(&path, &file, |_| {});
        let gpu = gpu();
        let model = Model::open(&gpu, &file, ModelLimits::default()).unwrap();
        let framing = Framing::of(&model);
        let mut scene = Scene { gpu, models: [model], _folder: folder };
        for direction in [[0.3, 0.2, 1.0], [-1.0, 0.4, -0.3]] {
            let camera = framing.fitting(direction, 1.5, FOV_Y_DEG);
            let light = hlod_render::scene::light_from_angles(&camera, -50.0, 35.0);
            let full = Shot { camera, representation: Representation::Full, ..shot(EYE, light) };
            let traced = Shot { shadow: Shadow::Traced, ..full };
            let [wrong, seen] = different(&mut scene, &full, &traced);
            assert!(seen > 5_000 && wrong <= seen / 500, "{name}: {wrong} of {seen} pixels");
            // Levels of detail differ along edges only: a pixel's width of them.
            let hybrid = Shot { representation: Representation::Hybrid, ..full };
            let traced = Shot { shadow: Shadow::Traced, ..hybrid };
            let [wrong, seen] = different(&mut scene, &hybrid, &traced);
            assert!(wrong <= seen / 50, "{name}: {wrong} of {seen} pixels");
        }
    }
}

/// Occlusion as shares, of pixels in which anything is seen.
fn shares(scene: &mut Scene, shot: &Shot) -> Vec<Option<f64>> {
    let (occlusion, identities) = scene.occlusion(shot);
    let share = |(o, id): (&u32, &u32)| (*id != 0).then_some(f64::from(*o) / 65_535.0);
    occlusion.iter().zip(&identities).map(share).collect()
}

/// Root of the mean square of differences where the truth is a penumbra, and everywhere; and the number
/// of pixels in penumbrae.
fn rmse(drawn: &[Option<f64>], truth: &[Option<f64>]) -> (f64, f64, usize) {
    let both = || drawn.iter().zip(truth).filter_map(|(d, t)| Some(((*d)?, (*t)?)));
    let root = |pairs: &mut dyn Iterator<Item = (f64, f64)>| {
        let (mut sum, mut count) = (0.0, 0);
        for (d, t) in pairs {
            sum += (d - t).powi(2);
            count += 1;
        }
        ((sum / f64::from(count.max(1))).sqrt(), count as usize)
    };
    let (inside, count) = root(&mut both().filter(|(_, t)| *t > 0.0 && *t < 1.0));
    (inside, root(&mut both()).0, count)
}

/// Which pixels show a part of the ball on which light grazes, falling in at more than 60°: shadows may begin there
/// earlier or later by any angle that levels change its surface.
fn grazed(scene: &mut Scene, shot: &Shot) -> Vec<bool> {
    let (canvas, _) = scene.draw(shot);
    let is_grazed = |(pixel, &depth): (usize, &f32)| {
        let Some(place) = place(&shot.camera, pixel, depth) else { return false };
        let normal = (place - MIDDLE) / RADIUS;
        let towards = match shot.light {
            Light::Directional(towards) => towards.normalize(),
            Light::Point(light) => (light - place).normalize(),
        };
        (0.95..1.05).contains(&normal.length()) && normal.normalize().dot(towards) < 0.5
    };
    canvas.depths(&scene.gpu).unwrap().iter().enumerate().map(is_grazed).collect()
}

#[test]
fn a_straight_edge_s_penumbra_is_that_of_a_disc() {
    // A half-plane one unit above the floor, lit from straight above.
    let mut mesh = floor(64);
    let square = [[-2.0, 1.0, -2.0], [-2.0, 1.0, 2.0], [0.0, 1.0, 2.0], [0.0, 1.0, -2.0]];
    add(&mut mesh, square.to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
    let mut scene = Scene::new(mesh);
    let at = |light, light_size| {
        let mut shot = shot(DVec3::new(2.0, 0.8, 0.3), light);
        shot.camera.target = DVec3::ZERO;
        Shot { shadow: Shadow::Soft, light_size, ..shot }
    };
    for (shot, half_width) in [
        (at(Light::Directional(DVec3::Y), 20.0), 10f64.to_radians().tan()),
        // A lamp two units above the edge: its penumbra is half as wide as it is.
        (at(Light::Point(DVec3::new(0.0, 3.0, 0.0)), 0.8), 0.2),
    ] {
        let (canvas, _) = scene.draw(&shot);
        let depths = canvas.depths(&scene.gpu).unwrap();
        let occlusion = canvas.occlusion(&scene.gpu).unwrap();
        let (mut compared, mut worst) = (0, 0.0f64);
        for (p, &depth) in depths.iter().enumerate() {
            let Some(place) = place(&shot.camera, p, depth) else { continue };
            // Far from the occluder's ends.
            if place.y.abs() > 1e-4 || place.z.abs() > 0.8 || place.x.abs() > 1.0 {
                continue;
            }
            let x = (place.x / half_width).clamp(-1.0, 1.0);
            let visible = 0.5 + (x * (1.0 - x * x).sqrt() + x.asin()) / std::f64::consts::PI;
            // τ_c moves the edge.
            let moved = 0.5 * pixel_at(&shot.camera, place) / half_width;
            let error = (1.0 - f64::from(occlusion[p]) / 65_535.0 - visible).abs();
            worst = worst.max(error - 2.0 / std::f64::consts::PI * moved);
            compared += usize::from(x.abs() < 1.0);
        }
        assert!(compared > 2_000, "{compared} pixels in the penumbra");
        assert!(worst <= 2.0 / 255.0, "{worst} at {half_width}");
    }
}

/// However coarse the levels are that a soft light lets cast, no place in a penumbra is lit by more than the step that is
/// allowed more or less than by the finest: so none jumps by more when levels change.
#[test]
fn levels_that_cast_change_penumbrae_by_less_than_the_step() {
    let mut scene = Scene::new(ball());
    for (light, light_size) in [
        (Light::Point(DVec3::new(0.4, 4.0, -0.3)), 1.0),
        (Light::Directional(DVec3::new(0.1, 1.0, -0.1)), 12.0),
    ] {
        // Of what casts nothing is seen: beside what receives a shadow, no step allows any error.
        let mut shot = shot(DVec3::new(0.9, 0.5, 0.9), light);
        shot.camera.target = DVec3::new(0.0, 0.0, 0.03);
        // Only the step lets coarser levels cast, and what is seen stays the same.
        let finest = Shot {
            shadow: Shadow::Soft,
            light_size,
            error_threshold_px: 1e-6,
            caster_threshold_px: 1e-6,
            intensity_step: 0.0,
            ..shot
        };
        let (truth, all) = (shares(&mut scene, &finest), scene.draw(&finest).1.caster_triangles);
        for step in [1.0 / 64.0, 1.0 / 16.0, 1.0 / 4.0] {
            let coarser = Shot { intensity_step: step, ..finest };
            let cast = scene.draw(&coarser).1.caster_triangles;
            let drawn = shares(&mut scene, &coarser);
            let both = drawn.iter().zip(&truth).filter_map(|(d, t)| Some(((*d)?, (*t)?)));
            let worst = both.map(|(d, t)| (d - t).abs()).fold(0.0, f64::max);
            let dark = truth.iter().flatten().filter(|hidden| **hidden > 0.0).count();
            assert!(
                dark > 10_000 && cast < all,
                "{light:?}: {dark} pixels, {cast} of {all} triangles"
            );
            assert!(worst <= step, "{light:?}: {worst} for {step}");
        }
    }
}

#[test]
fn a_light_without_extent_casts_hard_shadows() {
    let mut scene = Scene::new(ball());
    for light in
        [Light::Point(DVec3::new(0.4, 4.0, -0.3)), Light::Directional(DVec3::new(-0.9, 0.8, -0.4))]
    {
        let hard = shot(EYE, light);
        let soft = Shot { shadow: Shadow::Soft, ..hard };
        assert_eq!(different(&mut scene, &hard, &soft)[0], 0);
        // One that is hardly any larger differs by what its penumbra is wide.
        let narrow = Shot { light_size: 1e-3, ..soft };
        let [differ, seen] = different(&mut scene, &hard, &narrow);
        assert!(differ < seen / 50, "{differ} of {seen}");
    }
}

#[test]
fn soft_shadows_are_what_rays_to_the_whole_light_find() {
    let lights = [
        (Light::Point(DVec3::new(0.4, 4.0, -0.3)), [0.1, 0.4, 1.0]),
        (Light::Directional(DVec3::new(-0.9, 0.8, -0.4)), [2.0, 6.0, 12.0]),
        // Amid what is seen: six faces.
        (Light::Point(DVec3::new(-1.0, 1.2, 0.3)), [0.1, 0.2, 0.3]),
    ];
    for (mesh, has_ball) in [(ball(), true), (cube(), false)] {
        let mut scene = Scene::new(mesh);
        for (light, sizes) in lights {
            let left_out = match has_ball {
                true => grazed(&mut scene, &shot(EYE, light)),
                false => vec![false; (SIZE.0 * SIZE.1) as usize],
            };
            for (light_size, most) in sizes.into_iter().zip([0.08, 0.12, 0.2]) {
                let soft = Shot { shadow: Shadow::Soft, light_size, ..shot(EYE, light) };
                let mut of = |shadow| {
                    let all = shares(&mut scene, &Shot { shadow, ..soft });
                    let kept = |(share, out): (_, &bool)| if *out { None } else { share };
                    all.into_iter().zip(&left_out).map(kept).collect::<Vec<Option<f64>>>()
                };
                let [truth, drawn, hard] =
                    [Shadow::Traced, Shadow::Soft, Shadow::Hard].map(&mut of);
                let (inside, everywhere, count) = rmse(&drawn, &truth);
                let of_hard = rmse(&hard, &truth).1;
                let what = format!("{light:?} of {light_size}, {count} pixels");
                assert!(count > 100 && inside <= most, "{inside} inside: {what}");
                assert!(everywhere <= 0.1 * of_hard, "{everywhere}, hard {of_hard}: {what}");
            }
        }
    }
}

/// Six pairs of views and lights, three of each model.
#[test]
fn audits_find_edges_of_shadows_where_rays_do() {
    let folder = tempfile::tempdir().unwrap();
    let ball_on_floor = folder.path().join("ball.ply");
    let mesh = ball();
    std::fs::write(&ball_on_floor, ply(&mesh.0, &mesh.1)).unwrap();
    let bunny = scan("audits_find_edges_of_shadows_where_rays_do", "bunny/bun_zipper.ply");
    for input in [Some(ball_on_floor), bunny].into_iter().flatten() {
        let file = folder.path().join("scene.hlod");
        built(&input, &file, |o| {
            o.leaf_triangles = 4000;
            o.force = true;
        });
        let options = AuditOptions {
            size: (240, 180),
            views: 3,
            path: None,
            light: (-50.0, 35.0),
            varied_lights: None,
            pictures: None,
        };
        let shot = shot(EYE, Light::Directional(DVec3::Y));
        let report = audit(&gpu(), &file, &[input], &shot, &options, &mut |_| {}).unwrap();
        let edge = report.shadow_edge_px.expect("shadows were asked for");
        assert!(edge.deg60.positions > 500, "{edge:?}");
        // What is proven for the default: 0.65 and 1.87 px.
        assert!(edge.deg15.p999 <= 0.65 && edge.deg60.p999 <= 1.65, "{edge:?}");
        assert!(edge.acne_pixels + edge.leak_pixels <= 1, "{edge:?}");
    }
}

/// In two views with a parallel light and a lamp; hard shadows in place of soft ones are the wrong picture that is told
/// from the right one.
#[test]
fn audits_measure_penumbrae_by_rays_to_all_of_the_light() {
    let folder = tempfile::tempdir().unwrap();
    let [input, file] = ["ball.ply", "scene.hlod"].map(|name| folder.path().join(name));
    let mesh = ball();
    std::fs::write(&input, ply(&mesh.0, &mesh.1)).unwrap();
    built(&input, &file, |o| o.leaf_triangles = 4000);
    let options = AuditOptions {
        size: (160, 120),
        views: 2,
        path: None,
        light: (0.0, 0.0),
        varied_lights: Some(0.2),
        pictures: None,
    };
    let (error_threshold_px, caster_threshold_px) = EXACT_THRESHOLDS_PX;
    let shot = Shot {
        shadow: Shadow::Soft,
        error_threshold_px,
        caster_threshold_px,
        ..shot(EYE, Light::Directional(DVec3::Y))
    };
    let report = audit(&gpu(), &file, &[input], &shot, &options, &mut |_| {}).unwrap();
    let penumbra = report.penumbra.expect("soft shadows were asked for");
    println!("{penumbra:?}");
    assert!(penumbra.pixels > 100 && penumbra.pixels_elsewhere > 2000, "{penumbra:?}");
    assert!(penumbra.rmse <= 0.05 && penumbra.rmse <= 0.3 * penumbra.hard_rmse, "{penumbra:?}");
    assert!(penumbra.rmse_everywhere <= 0.6 * penumbra.hard_rmse_everywhere, "{penumbra:?}");
    assert_eq!((report.penumbra_rmse, penumbra.tiles_beyond), (Some(penumbra.rmse), 0));
    assert!(report.shadow_edge_px.is_none(), "soft shadows have no edges");
}

#[test]
fn scans_cast_soft_shadows_as_their_every_triangle_does() {
    for name in ["bunny/bun_zipper.ply", "happy_buddha/happy_buddha.ply"] {
        let test = "scans_cast_soft_shadows_as_their_every_triangle_does";
        let Some(path) = scan(test, name) else { continue };
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scan.hlod");
        built(&path, &file, |_| {});
        let gpu = gpu();
        let model = Model::open(&gpu, &file, ModelLimits::default()).unwrap();
        let framing = Framing::of(&model);
        let mut scene = Scene { gpu, models: [model], _folder: folder };
        // Half as far as fits: penumbrae are some pixels wide.
        let mut camera = framing.fitting([0.3, 0.2, 1.0], 1.5, FOV_Y_DEG);
        camera.eye = camera.eye.midpoint(camera.target);
        camera.near = framing.near(camera.eye);
        // A lamp a statue's height away; sizes in heights.
        let light = Light::Point(framing.point([-0.9, 0.8, 1.0]));
        for (size, most) in [(0.02, 0.08), (0.05, 0.12), (0.1, 0.2)] {
            let light_size = size * framing.height;
            let soft = Shot { camera, shadow: Shadow::Soft, light_size, ..shot(EYE, light) };
            let (error_threshold_px, caster_threshold_px) = EXACT_THRESHOLDS_PX;
            let soft = Shot { error_threshold_px, caster_threshold_px, ..soft };
            let truth = shares(&mut scene, &Shot { shadow: Shadow::Traced, ..soft });
            let drawn = shares(&mut scene, &soft);
            let (inside, everywhere, count) = rmse(&drawn, &truth);
            let hard = shares(&mut scene, &Shot { shadow: Shadow::Hard, ..soft });
            let of_hard = rmse(&hard, &truth).1;
            println!("{name} {size}: {inside:.4} of {count}, {everywhere:.4}, hard {of_hard:.4}");
            assert!(count > 100 && inside <= most, "{name} at {size}: {inside} inside");
            assert!(everywhere <= 0.6 * of_hard, "{name} at {size}: {everywhere}, hard {of_hard}");
        }
    }
}
