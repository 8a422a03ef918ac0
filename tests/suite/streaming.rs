//! What is loaded when, without a GPU where none is needed, and files that change under our feet.

use std::path::{Path, PathBuf};

use glam::DVec3;
use hlod_compress::RepresentationKind;
use hlod_render::casters::Casting;
use hlod_render::frame::Renderer;
use hlod_render::framing::Framing;
use hlod_render::path::{CameraPath, Key};
use hlod_render::picture::{Canvas, PICTURE_FORMAT, take};
use hlod_render::scene::{INTENSITY_STEP, Light, Representation, Shadow};
use hlod_render::select::Selection;
use hlod_render::simulate::{
    Policy, PolicyReport, SimulatedShadows, SimulationOptions, SimulationReport, simulate,
};
use hlod_render::{Model, ModelLimits};
use hlod_tests::{built, bumpy_ball, gpu};

use crate::pictures::shot;

fn ball(folder: &Path) -> PathBuf {
    let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|f| folder.join(f));
    std::fs::write(&ply, bumpy_ball(220)).unwrap();
    built(&ply, &hlod, |o| {
        o.leaf_triangles = 800;
        o.resolution = 32;
    });
    hlod
}

fn recorded(path: &str) -> CameraPath {
    let paths = Path::new(env!("CARGO_MANIFEST_DIR")).join("../bench-paths");
    CameraPath::load(&paths.join(path)).unwrap()
}

fn slow_link(cache_bytes: u64) -> SimulationOptions {
    SimulationOptions {
        bytes_per_sec: 3e5,
        latency_secs: 0.02,
        cache_bytes,
        frames_per_sec: 20.0,
        size: (640, 480),
        selection: Selection { kind: RepresentationKind::Appearance, error_threshold_px: 1.0 },
        shadows: None,
    }
}

fn simulated(hlod: &Path, path: &str, cache_bytes: u64) -> SimulationReport {
    simulate(hlod, &recorded(path), &slow_link(cache_bytes), &mut || {}).unwrap()
}

fn report_of(report: &SimulationReport, policy: Policy) -> &PolicyReport {
    report.policies.iter().find(|p| p.policy == policy).unwrap()
}

/// Reading ahead helps where views change, costs no more than it may, and nothing depends on chance.
#[test]
fn reading_ahead_helps() {
    let folder = tempfile::tempdir().unwrap();
    let hlod = ball(folder.path());
    let mut coarse = [0; 4];
    for path in ["orbit.json", "approach.json", "sweep.json"] {
        let report = simulated(&hlod, path, 3_000_000);
        for (p, sum) in report.policies.iter().zip(&mut coarse) {
            assert_eq!(p.stalled_frames, 0, "{path}: {p:?}");
            assert!(p.bytes_drawn <= p.bytes_read && p.tau_ratio_mean >= 1.0, "{path}: {p:?}");
            *sum += p.frames_over_2tau;
        }
        let again = simulated(&hlod, path, 3_000_000);
        assert_eq!(report.policies, again.policies, "{path}");
    }
    let of = |policy| coarse[Policy::all(false).iter().position(|&p| p == policy).unwrap()];
    println!("frames over 2τ: {coarse:?}");
    assert!(of(Policy::Due) < of(Policy::Lru) && of(Policy::Lru) < of(Policy::KeepNothing));
}

/// What does not fit is drawn coarser, by as much as that takes, whatever makes room.
#[test]
fn a_small_memory_is_kept_by_drawing_coarser() {
    let folder = tempfile::tempdir().unwrap();
    let hlod = ball(folder.path());
    for path in ["orbit.json", "approach.json", "sweep.json"] {
        let coarsened = [300_000, 1_000_000, 100_000_000].map(|cache_bytes| {
            let fast = SimulationOptions { bytes_per_sec: 1e8, ..slow_link(cache_bytes) };
            let report = simulate(&hlod, &recorded(path), &fast, &mut || {}).unwrap();
            let due = report_of(&report, Policy::Due);
            println!("{path}, {cache_bytes} bytes: {due:?}");
            assert!(due.kept_bytes_max <= cache_bytes, "{path}: {due:?}");
            assert_eq!(due.stalled_frames, 0, "{path}: {due:?}");
            due.frames_coarsened
        });
        assert!(coarsened[0] > 0 && coarsened[0] >= coarsened[1], "{path}: {coarsened:?}");
        assert_eq!(coarsened[2], 0, "{path}");
    }
}

/// With room for everything and a link that is quicker than a frame, nothing is ever missing.
#[test]
fn a_fast_link_shows_everything() {
    let folder = tempfile::tempdir().unwrap();
    let hlod = ball(folder.path());
    let path = recorded("orbit.json");
    let fast = SimulationOptions { bytes_per_sec: 1e9, latency_secs: 0.0, ..slow_link(1 << 30) };
    let report = simulate(&hlod, &path, &fast, &mut || {}).unwrap();
    // What is asked for when it is wanted comes a frame late even so.
    assert!(report_of(&report, Policy::Lru).frames_over_2tau > 10, "{report:?}");
    assert_eq!(report_of(&report, Policy::Due).frames_over_2tau, 0, "{report:?}");
    assert!(report.policies.iter().all(|p| p.casters.is_none()));

    let shadows = turning(Light::Directional(DVec3::new(-1.0, 0.7, 0.7)), 40.0);
    let options = SimulationOptions { shadows: Some(shadows), ..fast };
    let report = simulate(&hlod, &path, &options, &mut || {}).unwrap();
    let casters = |policy| report_of(&report, policy).casters.unwrap();
    assert!(casters(Policy::KeepNothing).frames_missing_casters > 0, "{report:?}");
    assert_eq!(casters(Policy::Due).frames_missing_casters, 0, "{report:?}");
    assert_eq!(casters(Policy::Due).frames_over_2tau, 0, "{report:?}");
}

fn turning(light: Light, turn_deg_per_sec: f64) -> SimulatedShadows {
    let casting =
        Casting { light, light_radius: 0.0, threshold_px: 0.5, intensity_step: INTENSITY_STEP };
    SimulatedShadows { casting, turn_deg_per_sec }
}

/// In light that turns, over a slow link: fewer shadows are coarse where what casts them is read ahead.
#[test]
fn reading_casters_ahead_helps() {
    let folder = tempfile::tempdir().unwrap();
    let hlod = ball(folder.path());
    // Enough for all of it: this is of the link, not of what makes room.
    let cache_bytes = 100_000_000;
    let lights = [
        Light::Directional(DVec3::new(-0.68, 0.26, 0.68)),
        Light::Point(DVec3::new(-1.53, 0.51, 1.53)),
    ];
    for light in lights {
        let (mut ahead, mut when_lacking) = ((0, 0), (0, 0));
        for path in ["approach.json", "sweep.json"] {
            let options =
                SimulationOptions { shadows: Some(turning(light, 30.0)), ..slow_link(cache_bytes) };
            let report = simulate(&hlod, &recorded(path), &options, &mut || {}).unwrap();
            let sum = |of: &mut (u32, u32), policy| {
                let report = report_of(&report, policy);
                of.0 += report.casters.unwrap().frames_over_2tau;
                of.1 += report.casters.unwrap().frames_missing_casters;
            };
            sum(&mut ahead, Policy::Due);
            sum(&mut when_lacking, Policy::DueReceivers);
            let again = simulate(&hlod, &recorded(path), &options, &mut || {}).unwrap();
            assert_eq!(report.policies, again.policies, "{path}");
        }
        println!(
            "{light:?}: frames over 2τ_c, and that lacked casters: {ahead:?}, {when_lacking:?}"
        );
        assert!(ahead.0 < when_lacking.0 && ahead.1 < when_lacking.1, "{ahead:?} {when_lacking:?}");
    }
}

/// What moves keeps to the memory that it was given, and is as coarse as that takes; a picture is complete.
#[test]
fn the_budget_of_the_gpu_is_kept_by_drawing_coarser() {
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|f| folder.path().join(f));
    std::fs::write(&ply, bumpy_ball(460)).unwrap();
    built(&ply, &hlod, |o| o.resolution = 128);
    let gpu = gpu();
    let limits = ModelLimits { gpu_bytes: 9_000_000, ..ModelLimits::default() };
    let mut models = [Model::open(&gpu, &hlod, limits).unwrap()];
    let mut renderer = Renderer::new(&gpu, PICTURE_FORMAT);
    let canvas = Canvas::new(&gpu, 160, 120).unwrap();
    let framing = Framing::of(&models[0]);
    // From the front and from behind, so that one makes room for the other; in the light, and with what casts shadows.
    for (tau, shadow, side) in [
        (0.02, Shadow::None, 1.0),
        (0.02, Shadow::None, -1.0),
        (0.05, Shadow::Hard, 1.0),
        (1.0, Shadow::Hard, -1.0),
    ] {
        let mut view = shot(&framing, Representation::Hybrid);
        view.camera = framing.fitting([0.3 * side, 0.2, side], 4.0 / 3.0, 40.0);
        view.light = Light::Directional(DVec3::new(-1.0, 0.7, 0.7 * side));
        (view.error_threshold_px, view.caster_threshold_px) = (tau, tau);
        view.shadow = shadow;
        let mut frames = 0;
        let stats = loop {
            let stats = renderer.render(&gpu, &mut models, &view, &canvas.targets).unwrap();
            assert!(models[0].reserved_bytes() <= 9_000_000, "τ = {tau}, {shadow:?}, {side}");
            frames += 1;
            assert!(frames < 20_000, "it never came to rest: {stats:?}");
            if frames > 3 && !models[0].is_loading() {
                break stats;
            }
        };
        println!("τ = {tau}, {shadow:?}, {side}: {frames} frames, {stats:?}");
        assert_eq!(stats.missing_parts, 0, "τ = {tau}, {shadow:?}, {side}");
        assert_eq!(stats.coarsening > 1.0, tau < 0.5, "τ = {tau}, {shadow:?}, {side}: {stats:?}");
        assert!(stats.tau_ratio_max <= stats.coarsening.max(1.0) + 1e-9, "{stats:?}");
        // A level finer has up to four times as many, each of 35 bytes.
        assert!(tau > 0.5 || 4 * 35 * stats.triangles > 7_000_000, "too coarse: {stats:?}");

        let complete = renderer.render_complete(&gpu, &mut models, &view, &canvas.targets).unwrap();
        assert!(complete.tau_ratio_max <= 1.0 && complete.coarsening == 1.0, "{complete:?}");
        // Its memory is not given back.
        models = [Model::open(&gpu, &hlod, limits).unwrap()];
    }
    // All leaves, where no τ could rise.
    let mut view = shot(&framing, Representation::Hybrid);
    view.error_threshold_px = 0.0;
    let mut frames = 0;
    let stats = loop {
        let stats = renderer.render(&gpu, &mut models, &view, &canvas.targets).unwrap();
        frames += 1;
        assert!(frames < 20_000, "it never came to rest: {stats:?}");
        if frames > 3 && !models[0].is_loading() {
            break stats;
        }
    };
    assert_eq!((stats.missing_parts, stats.coarsening), (0, 1.0), "{stats:?}");
    assert!(models[0].take_problems().is_empty());
}

/// A budget with no room for all that may soon be wanted: who stands still does not read it over and over.
#[test]
fn at_the_edge_of_the_budget_nothing_is_read_over_and_over() {
    let folder = tempfile::tempdir().unwrap();
    let hlod = ball(folder.path());
    let still = |duration_secs: f64| {
        let key = |at_secs| Key {
            at_secs,
            eye: [0.1, 0.2, 0.9],
            target: [0.0; 3],
            eye_anchored: 0.0,
            target_anchored: 0.0,
        };
        CameraPath {
            version: 1,
            name: "still".into(),
            purpose: "to stand still".into(),
            duration_secs,
            peak_speed_heights_per_sec: 0.0,
            fov_y_deg: 35.0,
            anchor: None,
            keys: vec![key(0.0), key(duration_secs)],
        }
    };
    let shadows = Some(turning(Light::Directional(DVec3::new(-1.0, 0.4, 0.4)), 0.0));
    for cache_bytes in [400_000, 800_000, 1_600_000, 3_000_000] {
        let options = SimulationOptions { shadows, ..slow_link(cache_bytes) };
        let read = |secs: f64| {
            let report = simulate(&hlod, &still(secs), &options, &mut || {}).unwrap();
            report_of(&report, Policy::Due).bytes_read
        };
        let (first, later) = (read(10.0), read(40.0));
        println!("{cache_bytes} bytes kept: {first} read in 10 s, {later} in 40 s");
        // As much again would be read every few seconds.
        assert!(later - first < first, "{cache_bytes}: {first}, {later}");
    }
}

/// A file that is cut while it is shown: what is there stays, the reason is told.
#[test]
fn a_file_cut_while_open_is_told_and_the_picture_stays() {
    let folder = tempfile::tempdir().unwrap();
    let hlod = ball(folder.path());
    let gpu = gpu();
    let mut models = [Model::open(&gpu, &hlod, ModelLimits::default()).unwrap()];
    let file = std::fs::OpenOptions::new().write(true).open(&hlod).unwrap();
    file.set_len(20_000).unwrap();
    let shot = shot(&Framing::of(&models[0]), Representation::Full);
    let (_, stats) = take(&gpu, &mut models, &shot, 100, 100, 1).unwrap();
    assert!(stats.nodes > 0 && stats.missing_parts > 0, "{stats:?}");
    assert!(!models[0].take_problems().is_empty());
}

/// What is drawn fits, although all of it together would not.
#[test]
fn memory_on_the_gpu_keeps_to_its_limit() {
    let folder = tempfile::tempdir().unwrap();
    let hlod = ball(folder.path());
    let gpu = gpu();
    let everything = {
        let mut models = [Model::open(&gpu, &hlod, ModelLimits::default()).unwrap()];
        let shot = shot(&Framing::of(&models[0]), Representation::Full);
        take(&gpu, &mut models, &shot, 100, 100, 1).unwrap();
        models[0].resident_bytes()
    };
    let limits = ModelLimits { gpu_bytes: everything / 2, ..ModelLimits::default() };
    let mut models = [Model::open(&gpu, &hlod, limits).unwrap()];
    let framing = Framing::of(&models[0]);
    for step in 0..12 {
        let angle = f64::from(step) * 0.5;
        let mut shot = shot(&framing, Representation::Hybrid);
        // Close by, going round.
        let direction = glam::DVec3::new(angle.sin(), 0.0, angle.cos());
        shot.camera.eye = shot.camera.target + direction * framing.height * 0.62;
        let (_, stats) = take(&gpu, &mut models, &shot, 200, 200, 1).unwrap();
        assert!(stats.nodes > 1, "{stats:?}");
        let resident = models[0].resident_bytes();
        assert!(resident <= limits.gpu_bytes, "step {step}: {resident} of {}", limits.gpu_bytes);
    }
}
