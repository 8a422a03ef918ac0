//! What is loaded when, without a GPU where none is needed, and files that change under our feet.

use std::path::{Path, PathBuf};

use hlod_compress::RepresentationKind;
use hlod_render::framing::Framing;
use hlod_render::path::CameraPath;
use hlod_render::picture::take;
use hlod_render::scene::Representation;
use hlod_render::select::Selection;
use hlod_render::simulate::{Policy, SimulationOptions, SimulationReport, simulate};
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

fn simulated(hlod: &Path, path: &str, cache_bytes: u64) -> SimulationReport {
    let paths = Path::new(env!("CARGO_MANIFEST_DIR")).join("../bench-paths");
    let path = CameraPath::load(&paths.join(path)).unwrap();
    let options = SimulationOptions {
        bytes_per_sec: 3e5,
        latency_secs: 0.02,
        cache_bytes,
        frames_per_sec: 20.0,
        size: (640, 480),
        selection: Selection { kind: RepresentationKind::Appearance, error_threshold_px: 1.0 },
    };
    simulate(hlod, &path, &options, &mut || {}).unwrap()
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
    let of = |policy| coarse[Policy::ALL.iter().position(|&p| p == policy).unwrap()];
    println!("frames over 2τ: {coarse:?}");
    assert!(of(Policy::Due) < of(Policy::Lru) && of(Policy::Lru) < of(Policy::KeepNothing));
}

/// With room for everything and a link that is quicker than a frame, nothing is ever missing.
#[test]
fn a_fast_link_shows_everything() {
    let folder = tempfile::tempdir().unwrap();
    let hlod = ball(folder.path());
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../bench-paths/orbit.json");
    let path = CameraPath::load(&path).unwrap();
    let options = SimulationOptions {
        bytes_per_sec: 1e9,
        latency_secs: 0.0,
        cache_bytes: 1 << 30,
        frames_per_sec: 20.0,
        size: (640, 480),
        selection: Selection { kind: RepresentationKind::Appearance, error_threshold_px: 1.0 },
    };
    let report = simulate(&hlod, &path, &options, &mut || {}).unwrap();
    let of = |policy| report.policies.iter().find(|p| p.policy == policy).unwrap();
    // What is asked for when it is wanted comes a frame late even so.
    assert!(of(Policy::Lru).frames_over_2tau > 10, "{report:?}");
    assert_eq!(of(Policy::Due).frames_over_2tau, 0, "{report:?}");
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
