//! What goes wrong while a statue is shown: files that change, pages that are damaged, adapters that give
//! up, cameras that are nowhere.

use std::path::{Path, PathBuf};

use glam::DVec3;
use hlod_compress::HlodFile;
use hlod_render::framing::Framing;
use hlod_render::picture::{Canvas, PICTURE_FORMAT, Picture, take};
use hlod_render::scene::{Representation, Shot};
use hlod_render::{Gpu, Model, ModelLimits, RenderError, frame::FrameStats, frame::Renderer};
use hlod_tests::{built, bumpy_ball, gpu, program};

use crate::pictures::shot;

struct Setting {
    folder: tempfile::TempDir,
    hlod: PathBuf,
    gpu: Gpu,
}

impl Setting {
    fn new() -> Setting {
        let folder = tempfile::tempdir().unwrap();
        let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|name| folder.path().join(name));
        std::fs::write(&ply, bumpy_ball(100)).unwrap();
        built(&ply, &hlod, |o| o.leaf_triangles = 1500);
        Setting { folder, hlod, gpu: gpu() }
    }

    /// Keeps nothing in memory that was read.
    fn open(&self) -> Model {
        let limits = ModelLimits { host_bytes: 0, ..ModelLimits::default() };
        Model::open(&self.gpu, &self.hlod, limits).unwrap()
    }

    fn take(&self, model: &mut [Model]) -> (Picture, FrameStats) {
        let shot = shot(&Framing::of(&model[0]), Representation::Full);
        take(&self.gpu, model, &shot, 96, 96, 1).unwrap()
    }
}

/// Pixels that are not the background.
fn covered(picture: &Picture) -> usize {
    let background = picture.rgba[..4].to_vec();
    picture.rgba.chunks_exact(4).filter(|pixel| *pixel != background).count()
}

/// Whatever happens to the file, what is there of it is drawn, and the reason is said.
#[test]
fn files_that_change_while_open_are_drawn_as_far_as_they_are_known() {
    let s = Setting::new();
    let whole = covered(&s.take(&mut [s.open()]).0);
    let bytes = std::fs::read(&s.hlod).unwrap();
    let write = |path: &Path, content: &[u8]| {
        let mut file = std::fs::File::options().write(true).open(path).unwrap();
        std::io::Write::write_all(&mut file, content).unwrap();
        file.set_len(content.len() as u64).unwrap();
    };
    let front = HlodFile::open(&s.hlod).unwrap().header().front_bytes as usize;
    let zeros = [&bytes[..front], &vec![0; bytes.len() - front]].concat();
    let noise: Vec<u8> = bytes.iter().map(|byte| byte ^ 0x55).collect();
    for (what, content) in [("cut", &bytes[..front]), ("zeros", &zeros), ("noise", &noise)] {
        let mut models = [s.open()];
        write(&s.hlod, content);
        let (picture, stats) = s.take(&mut models);
        let share = covered(&picture) as f64 / whole as f64;
        assert!((0.9..1.1).contains(&share), "{what}: {share} of the statue is drawn");
        assert!(stats.missing_parts > 0, "{what}");
        let problems = models[0].take_problems();
        assert!(!problems.is_empty(), "{what}: nothing is said");
        assert!(problems.iter().all(|p| p.contains("ball.hlod")), "{what}: {problems:?}");
        write(&s.hlod, &bytes);
    }
    // Another file by its name: this one goes on as it was.
    let mut models = [s.open()];
    let other = s.folder.path().join("other");
    std::fs::write(&other, b"something else").unwrap();
    if cfg!(unix) {
        std::fs::rename(&other, &s.hlod).unwrap();
        let (picture, stats) = s.take(&mut models);
        assert_eq!((covered(&picture), stats.missing_parts), (whole, 0));
        assert!(models[0].take_problems().is_empty());
    }
    // Unharmed, nothing is said: otherwise the above would show nothing.
    std::fs::write(&s.hlod, &bytes).unwrap();
    let mut models = [s.open()];
    let (_, stats) = s.take(&mut models);
    assert_eq!(stats.missing_parts, 0);
    assert!(models[0].take_problems().is_empty());
}

#[test]
fn without_memory_for_geometry_less_is_drawn_and_said() {
    let s = Setting::new();
    let whole = covered(&s.take(&mut [s.open()]).0);
    // Room for a small part of it, for little more than the root, and for nothing.
    for mib in [3, 1] {
        let gpu = Gpu::headless(hlod_render::AdapterChoice::Software).unwrap();
        gpu.pretend_geometry_bytes(mib << 20);
        let mut models = [Model::open(&gpu, &s.hlod, ModelLimits::default()).unwrap()];
        let view = shot(&Framing::of(&models[0]), Representation::Full);
        let (picture, stats) = take(&gpu, &mut models, &view, 96, 96, 1).unwrap();
        let share = covered(&picture) as f64 / whole as f64;
        assert!((0.9..1.1).contains(&share), "{mib} MiB: {share} of the statue is drawn");
        assert!(models[0].resident_bytes() <= mib << 20);
        let problems = models[0].take_problems();
        if stats.missing_parts > 0 {
            assert_eq!(problems.len(), 1, "{problems:?}");
            assert!(problems[0].contains("memory"), "{problems:?}");
        }
        // The smallest is too small.
        assert!(mib > 1 || stats.missing_parts > 0, "{mib} MiB: everything fits");
    }
    let gpu = Gpu::headless(hlod_render::AdapterChoice::Software).unwrap();
    gpu.pretend_geometry_bytes(1000);
    let error = Model::open(&gpu, &s.hlod, ModelLimits::default()).err().unwrap();
    assert!(error.to_string().contains("no memory left"), "{error}");
}

#[test]
fn a_lost_device_is_an_error_and_another_goes_on() {
    let s = Setting::new();
    let (expected, _) = s.take(&mut [s.open()]);
    let mut models = [s.open()];
    let view = shot(&Framing::of(&models[0]), Representation::Full);
    let canvas = Canvas::new(&s.gpu, 64, 64).unwrap();
    let mut renderer = Renderer::new(&s.gpu, PICTURE_FORMAT);
    renderer.render(&s.gpu, &mut models, &view, &canvas.targets).unwrap();
    s.gpu.check().unwrap();
    s.gpu.device.destroy();
    // It is lost when what was under way is done: a frame or two may not know of it.
    let mut frames = (0..200).map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(10));
        renderer.render(&s.gpu, &mut models, &view, &canvas.targets).map(drop)
    });
    let drawn = frames.find(Result::is_err).unwrap_or(Ok(()));
    let read = canvas.picture(&s.gpu).map(drop);
    for (what, result) in [("drawn", drawn), ("read", read)] {
        assert!(matches!(result, Err(RenderError::Gpu { .. })), "{what}: {result:?}");
    }
    assert!(
        Model::open(&s.gpu, &s.hlod, ModelLimits::default()).is_err() || s.gpu.check().is_err()
    );
    let again = Setting { gpu: gpu(), ..s };
    assert!(again.take(&mut [again.open()]).0 == expected);
}

#[test]
fn pictures_of_no_size_and_of_too_much_are_refused() {
    let gpu = gpu();
    for (width, height) in [(0, 0), (0, 5), (5, 0), (u32::MAX, 1), (1, u32::MAX)] {
        let refused = Canvas::new(&gpu, width, height).err().unwrap();
        assert!(matches!(refused, RenderError::Usage(_)), "{width}×{height}: {refused}");
    }
    gpu.check().unwrap();
}

/// Inside the stone, far beyond the stars, on the target, and where there are no numbers.
#[test]
fn cameras_anywhere_draw_something_or_nothing() {
    let s = Setting::new();
    let mut models = [s.open()];
    let framing = Framing::of(&models[0]);
    let usual = shot(&framing, Representation::Hybrid);
    let canvas = Canvas::new(&s.gpu, 48, 48).unwrap();
    let mut renderer = Renderer::new(&s.gpu, PICTURE_FORMAT);
    let mut draw = |what: &str, change: &dyn Fn(&mut Shot)| {
        let mut shot = usual;
        change(&mut shot);
        let stats = renderer.render(&s.gpu, &mut models, &shot, &canvas.targets);
        let picture = canvas.picture(&s.gpu);
        assert!(picture.is_ok(), "{what}: {:?}", picture.err());
        stats.unwrap_or_else(|error| panic!("{what}: {error}"));
    };
    let eyes: [(&str, DVec3); 8] = [
        ("inside", DVec3::splat(0.01)),
        ("on the surface", DVec3::Z),
        ("far", DVec3::splat(1e30)),
        ("farther", DVec3::splat(1e300)),
        ("as far as there are numbers", DVec3::splat(f64::MAX)),
        ("at infinity", DVec3::splat(f64::INFINITY)),
        ("nowhere", DVec3::NAN),
        ("on the target", usual.camera.target),
    ];
    for (what, eye) in eyes {
        draw(what, &|shot| shot.camera.eye = eye);
        draw(&format!("towards {what}"), &|shot| shot.camera.target = eye);
    }
    for threshold in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300] {
        draw("a threshold", &|shot| shot.error_threshold_px = threshold);
    }
    s.gpu.check().unwrap();
    // And as usual after all that.
    let (picture, stats) = s.take(&mut models);
    assert!(covered(&picture) > 1000 && stats.missing_parts == 0);
}

/// What to install is said.
#[cfg(target_os = "linux")]
#[test]
fn without_an_adapter_the_package_is_named() {
    let s = Setting::new();
    let mut shot = program("hlod-render");
    shot.arg("shot").arg(&s.hlod).arg("-o").arg(s.folder.path().join("none.png"));
    let nowhere = s.folder.path().join("no-driver.json");
    for variable in ["VK_ICD_FILENAMES", "VK_DRIVER_FILES"] {
        shot.env(variable, &nowhere);
    }
    let ended = hlod_tests::ended::ended(&mut shot);
    assert_eq!(ended.status, Some(1), "{}", ended.said);
    assert!(ended.said.contains("apt install mesa-vulkan-drivers"), "{}", ended.said);
    assert!(!s.folder.path().join("none.png").exists());
}

/// Views that no camera has are refused when a session is read.
#[test]
fn sessions_with_views_from_nowhere_are_refused() {
    let s = Setting::new();
    let header = HlodFile::open(&s.hlod).unwrap().header().clone();
    let session = hlod_render::session::Session::new(&s.hlod, &header);
    let text = serde_json::to_string(&session).unwrap();
    let path = s.folder.path().join("s.json");
    let view = |eye: &str, fov: &str| {
        let looks = &serde_json::to_string(&session.looks).unwrap();
        let view = format!(
            r#"{{"name": "a", "viewpoint": {{"eye": [{eye}], "target": [0, 0, 0], "up": [0, 1, 0], "fov_y_deg": {fov}}}, "looks": {looks}}}"#
        );
        let text = text.replace(r#""views":[]"#, &format!(r#""views":[{view}]"#));
        std::fs::write(&path, text).unwrap();
        hlod_render::session::load(&path).map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(view("0, 0, 5", "35"), Ok(()));
    for (eye, fov) in [
        ("0, 0, 0", "35"),
        ("0, 5, 0", "35"),
        ("1e999, 0, 0", "35"),
        ("NaN, 0, 0", "35"),
        ("null, 0, 0", "35"),
        ("0, 0, 5", "0"),
        ("0, 0, 5", "-35"),
        ("0, 0, 5", "1e300"),
    ] {
        assert!(view(eye, fov).is_err(), "{eye}, {fov}");
    }
}
