//! The window, on a virtual X display: what it shows, that it can be moved about in, and that it
//! closes.

#![cfg(feature = "viewer")]

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use glam::DVec2;
use hlod_render::framing::{FOV_Y_DEG, Framing, NAMED_VIEWS};
use hlod_render::leaves::Leaves;
use hlod_render::lens::Lens;
use hlod_render::path::CameraPath;
use hlod_render::pick::first_hit;
use hlod_render::picture::{Picture, take};
use hlod_render::scene::{
    BACKGROUND, CASTER_THRESHOLD_PX, INTENSITY_STEP, Material, Paint, Representation, Shadow, Shot,
    light_from_angles,
};
use hlod_render::session::load as load_session;
use hlod_render::{AdapterChoice, Gpu, Model, ModelLimits};

const WIDTH: u32 = 800;
const HEIGHT: u32 = 600;
/// Generous: debug builds on busy machines without a GPU.
const PATIENCE: Duration = Duration::from_secs(120);
/// Share of pixels that may differ between pictures that should be the same: turning there and
/// back rounds.
const ROUNDING: f64 = 0.002;
/// Share of pixels that differ at least where something moved.
const MOVED: f64 = 0.02;

#[test]
fn the_window_shows_the_statue_moves_returns_and_closes() {
    let Some(mut v) = Viewing::begin(&[]) else { return };
    let first = v.first.clone();

    // The statue's pixels are those of a picture taken without a window.
    assert_alike(&first, &offscreen(&v.file), "the first picture and the one without a window");

    // A drag with the left button turns; Home returns.
    v.display.drag("1", (400, 300), (520, 240));
    assert!(differing(&first, &v.settled()) > MOVED, "the drag turned nothing");
    v.key("Home");
    assert_alike(&first, &v.settled(), "the first picture and the one after Home");

    // A drag with the right button moves; F shows everything again.
    v.display.drag("3", (400, 300), (600, 420));
    assert!(differing(&first, &v.settled()) > MOVED, "the drag moved nothing");
    v.key("f");
    assert_alike(&first, &v.settled(), "the first picture and the one after F");

    // The wheel approaches.
    v.display.xdotool(&["mousemove", "400", "300", "click", "--repeat", "4", "4"]);
    assert!(differing(&first, &v.settled()) > MOVED, "the wheel did nothing");

    // R begins to record a path, R again writes it.
    v.key("r");
    v.display.drag("1", (400, 300), (300, 320));
    v.key("r");
    v.settled();
    let path = CameraPath::load(&v.folder.path().join("ball-path-001.json"));
    assert!(path.as_ref().is_ok_and(|path| path.keys.len() >= 2), "{path:?}");
    v.quit();
}

#[test]
fn the_window_takes_a_picture_of_itself_and_leaves() {
    if let Some(why) = missing() {
        return skip(&why);
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = ball(folder.path());
    let display = Display::start();
    let png = folder.path().join("window.png");
    let png_name = png.to_string_lossy();
    let more = ["--exit-after", "8", "--screenshot", &png_name];
    let mut program = display.view(&file, folder.path(), &more);
    let status = wait(&mut program);
    assert!(status.success(), "{status}");
    assert_alike(&load(&png), &offscreen(&file), "the window's picture and the expected one");
}

/// Everything that a hand does on the statue: the cube that says where one is, picking with a tool, a plane through
/// three points that is dragged by its handle, undoing, and the session that it all becomes.
#[test]
fn the_window_measures_cuts_and_keeps_what_was_done() {
    let Some(mut v) = Viewing::begin(&[]) else { return };

    // The front of the cube leads to the same view as its key.
    v.key("1");
    let front = v.settled();
    assert!(differing(&v.first, &front) > MOVED, "the front is another view");
    v.key("Home");
    v.settled();
    v.display.click((32, 49));
    v.display.away();
    assert_alike(&front, &v.settled(), "the front by its key and by the cube");

    // A distance between two places, which are those that rays through the pixels meet.
    let places = [(330, 260), (470, 330)];
    v.key("m");
    places.iter().for_each(|place| v.display.click(*place));
    // A plane through three, and its handle dragged to the right.
    v.key("x");
    [(400, 200), (420, 300), (400, 400)].iter().for_each(|place| v.display.click(*place));
    v.settled();
    let session = v.session();
    let saved = || load_session(&session).expect("the session can be read");
    let before = v.display.until(&mut v.program, || saved().sections.first().cloned());
    let leaves = Leaves::open(&v.file).expect("the file opens");
    let framing = Framing::of_header(leaves.header());
    let aspect = f64::from(WIDTH) / f64::from(HEIGHT);
    let camera = framing.fitting(NAMED_VIEWS[0].1, aspect, FOV_Y_DEG);
    let lens = Lens { camera, size: DVec2::new(WIDTH.into(), HEIGHT.into()) };
    let plane = before.plane();
    let handle = framing.centre - plane.normal * plane.distance(framing.centre);
    let handle = lens.pixel_of(handle).expect("it is before the eye").as_ivec2();
    v.display.drag("1", (handle.x, handle.y), (handle.x + 60, handle.y));
    let moved = v.display.until(&mut v.program, || {
        saved().sections.first().filter(|section| section.offset != before.offset).cloned()
    });
    // The handle is where the hand went; perspective bends the way there a little.
    let now = framing.centre - plane.normal * moved.plane().distance(framing.centre);
    let went = lens.pixel_of(now).expect("it is before the eye").as_ivec2() - handle;
    assert!((went.x - 60).abs() <= 9, "{went}");
    assert_eq!(moved.normal, before.normal);

    // Undone it is where it was.
    v.key("ctrl+z");
    v.display.until(&mut v.program, || {
        saved().sections.first().filter(|section| section.offset == before.offset).cloned()
    });
    v.quit();

    let measured = saved().measurements.first().cloned().expect("it was measured");
    for (point, (x, y)) in measured.points.iter().zip(places) {
        // A pixel has its middle half a pixel on; clicks are at its corner.
        let (origin, direction) = lens.ray(DVec2::new(x.into(), y.into()));
        let hit = first_hit(&leaves, origin, direction).expect("leaves are read");
        let off = hit.expect("the ball is there").position.distance(point.place());
        let pixel = point.pixel_length.expect("it was clicked");
        assert!(off < 1.5 * pixel, "{off} at {x}, {y}, where a pixel is {pixel}");
    }
    let value = measured.result.expect("it was worked out").value;
    let between = measured.points[0].place().distance(measured.points[1].place());
    assert!((value - between).abs() < 1e-9);
}

/// A minimised window and one of hardly any pixels have nothing to draw into. (No window of X is 0 × 0.)
#[test]
fn a_window_that_vanishes_comes_back() {
    let Some(mut v) = Viewing::begin(&[]) else { return };
    let window = v.window.clone();
    let [width, height] = [WIDTH, HEIGHT].map(|n| n.to_string());
    let away: [&[&str]; 2] = [&["windowunmap", &window], &["windowsize", &window, "1", "1"]];
    let back: [&[&str]; 2] = [&["windowmap", &window], &["windowsize", &window, &width, &height]];
    for (away, back) in away.iter().zip(back) {
        v.display.xdotool(away);
        std::thread::sleep(Duration::from_secs(2));
        assert!(differing(&v.first, &v.display.grab()) > MOVED, "{away:?} hid nothing");
        v.display.xdotool(back);
        assert_alike(&v.settled(), &v.first, "the picture before and after");
    }
    v.quit();
}

/// What was done so far can be gone on with, but not for ever where the next one is lost soon.
#[test]
fn a_lost_gpu_is_opened_again_in_the_window() {
    let begin = Instant::now();
    let Some(mut v) = Viewing::begin(&["--lose-gpu-after", "20"]) else { return };
    v.key("1");
    let front = v.settled();
    v.key("m");
    [(330, 260), (470, 330)].iter().for_each(|place| v.display.click(*place));
    v.key("Escape");
    v.display.away();
    std::thread::sleep(Duration::from_secs(35).saturating_sub(begin.elapsed()));
    let again = v.settled();
    // The measurement is drawn upon it, and the reason stands before it.
    let share = differing(&front, &again);
    assert!(share > 0.0005 && share < 0.2, "{share} of the pixels differ");
    v.display.until(&mut v.program, || {
        let session = load_session(&v.file.with_extension("hlod.session.json")).ok()?;
        (session.measurements.len() == 1).then_some(())
    });
    v.key("ctrl+z");
    let session = v.session();
    v.display.until(&mut v.program, || {
        load_session(&session).ok().filter(|session| session.measurements.is_empty())
    });
    v.quit();

    let mut program = v.display.view(&v.file, v.folder.path(), &["--lose-gpu-after", "3"]);
    let status = wait(&mut program);
    assert_eq!(status.code(), Some(1), "{status}");
}

/// The window cannot stay; what was done with it does.
#[test]
fn a_display_that_goes_away_takes_nothing_with_it() {
    let Some(mut v) = Viewing::begin(&[]) else { return };
    v.key("m");
    [(330, 260), (470, 330)].iter().for_each(|place| v.display.click(*place));
    let session = v.session();
    v.display.until(&mut v.program, || {
        load_session(&session).ok().filter(|session| session.measurements.len() == 1)
    });
    v.display.server.kill().expect("the display can be ended");
    let status = wait(&mut v.program);
    assert!(!status.success(), "{status}");
    assert_eq!(v.measurements(), 1);

    // And without one, it is said what is missing.
    let mut command = Command::new(env!("CARGO_BIN_EXE_hlod-render"));
    command.arg("view").arg(&v.file).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    let output = command.output().expect("the program runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("DISPLAY"), "{said}");
}

/// The program with a window on a ball, on a display of its own.
struct Viewing {
    folder: tempfile::TempDir,
    file: PathBuf,
    display: Display,
    program: Child,
    window: String,
    /// What it shows at first, with the cursor out of the way.
    first: Picture,
}

impl Viewing {
    /// `None` where this machine lacks something, which is said.
    fn begin(more: &[&str]) -> Option<Viewing> {
        if let Some(why) = missing() {
            skip(&why);
            return None;
        }
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = ball(folder.path());
        let display = Display::start();
        let mut program = display.view(&file, folder.path(), more);
        let window = display.window_of(&mut program);
        display.away();
        let first = display.settled(&mut program);
        Some(Viewing { folder, file, display, program, window, first })
    }

    fn session(&self) -> PathBuf {
        self.file.with_extension("hlod.session.json")
    }

    fn measurements(&self) -> usize {
        load_session(&self.session()).map_or(0, |session| session.measurements.len())
    }

    fn key(&self, key: &str) {
        self.display.key(&self.window, key);
    }

    fn settled(&mut self) -> Picture {
        self.display.settled(&mut self.program)
    }

    fn quit(&mut self) {
        self.key("ctrl+q");
        let status = wait(&mut self.program);
        assert!(status.success(), "{status}");
    }
}

/// What this machine lacks, if anything.
fn missing() -> Option<String> {
    for (tool, argument) in [("Xvfb", "-help"), ("xdotool", "version"), ("import", "-version")] {
        let mut command = Command::new(tool);
        if command.arg(argument).stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
            return Some(format!("{tool} is not installed"));
        }
    }
    Gpu::headless(AdapterChoice::Software).err().map(|e| e.to_string())
}

fn skip(why: &str) {
    println!("SKIPPED: window: {why}");
    if let Some(log) = std::env::var_os("HLOD_SKIP_LOG") {
        let opened = std::fs::OpenOptions::new().create(true).append(true).open(log);
        let written = opened.and_then(|mut log| writeln!(log, "window: {why}"));
        written.expect("HLOD_SKIP_LOG names a file that can be written");
    }
}

/// A ball with bumps that are nowhere alike, some way from the origin, as an `.hlod` file.
fn ball(folder: &Path) -> PathBuf {
    const RINGS: u32 = 96;
    const SECTORS: u32 = 192;
    let (mut vertices, mut faces) = (String::new(), String::new());
    for (ring, sector) in (0..=RINGS).flat_map(|r| (0..SECTORS).map(move |s| (r, s))) {
        let polar = f64::from(ring) / f64::from(RINGS) * std::f64::consts::PI;
        let turn = f64::from(sector) / f64::from(SECTORS) * std::f64::consts::TAU;
        let bump = 0.08 * (5.0 * turn).sin() * (3.0 * polar).sin() + 0.1 * turn.cos();
        let radius = 100.0 * (1.0 + bump * polar.sin());
        let direction = [polar.sin() * turn.sin(), polar.cos(), polar.sin() * turn.cos()];
        let [x, y, z] = direction.map(|c| c * radius);
        vertices += &format!("{:.3} {:.3} {:.3}\n", x + 3000.0, y, z - 5000.0);
        if ring < RINGS {
            let next = (sector + 1) % SECTORS;
            let (above, below) = (ring * SECTORS, (ring + 1) * SECTORS);
            let [a, b, c, d] = [above + sector, above + next, below + sector, below + next];
            faces += &format!("3 {a} {c} {d}\n3 {a} {d} {b}\n");
        }
    }
    let ply = folder.join("ball.ply");
    let header = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (RINGS + 1) * SECTORS,
        2 * RINGS * SECTORS
    );
    std::fs::write(&ply, header + &vertices + &faces).expect("the scan is written");
    let output = folder.join("ball.hlod");
    let options = hlod_build::BuildOptions::default();
    hlod_build::build(&[ply], &output, &options, &hlod_build::progress::Silent)
        .expect("the ball can be built");
    output
}

/// The first picture, by the library alone.
fn offscreen(file: &Path) -> Picture {
    let gpu = Gpu::headless(AdapterChoice::Software).expect("checked before");
    let mut models = [Model::open(&gpu, file, ModelLimits::default()).expect("the file opens")];
    let (_, direction) = NAMED_VIEWS[6];
    let aspect = f64::from(WIDTH) / f64::from(HEIGHT);
    let camera = Framing::of(&models[0]).fitting(direction, aspect, FOV_Y_DEG);
    let shot = Shot {
        camera,
        light: light_from_angles(&camera, -45.0, 40.0),
        spot: None,
        material: Material::default(),
        enhance: Default::default(),
        background: BACKGROUND,
        representation: Representation::Hybrid,
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
    };
    take(&gpu, &mut models, &shot, WIDTH, HEIGHT, 1).expect("the picture is taken").0
}

/// Share of pixels that differ visibly. The upper corners hold the cube and buttons, not the statue.
fn differing(a: &Picture, b: &Picture) -> f64 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let pixels = a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4)).enumerate();
    let different = pixels.filter(|(i, (p, q))| {
        let (x, y) = (*i as u32 % WIDTH, *i as u32 / WIDTH);
        let is_statue = (x < WIDTH - 90 || y > 40) && (x > 90 || y > 90);
        is_statue && (0..3).any(|c| p[c].abs_diff(q[c]) > 2)
    });
    different.count() as f64 / f64::from(WIDTH * HEIGHT)
}

fn assert_alike(a: &Picture, b: &Picture, what: &str) {
    let share = differing(a, b);
    if share > ROUNDING {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let saved = [(a, "window-a.png"), (b, "window-b.png")].map(|(picture, name)| {
            let file = folder.join(name);
            picture.save(&file).map(|()| file)
        });
        panic!("{what}: {:.2} % of the pixels differ; see {saved:?}", share * 100.0);
    }
}

fn load(png: &Path) -> Picture {
    let image = image::open(png).expect("a picture").to_rgba8();
    Picture { width: image.width(), height: image.height(), rgba: image.into_raw() }
}

fn wait(program: &mut Child) -> ExitStatus {
    let begin = Instant::now();
    loop {
        if let Some(status) = program.try_wait().expect("the program can be waited for") {
            return status;
        }
        if begin.elapsed() > PATIENCE {
            // Best effort: the test has failed anyway.
            drop(program.kill());
            panic!("the window did not close");
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Servers that start at the same time have been seen to choose the same number.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// A virtual X display; it ends with the test, and with it every program on it.
struct Display {
    server: Child,
    _turn: MutexGuard<'static, ()>,
    name: String,
    screenshots: tempfile::TempDir,
}

impl Drop for Display {
    fn drop(&mut self) {
        // It may have ended by itself.
        drop(self.server.kill());
        drop(self.server.wait());
    }
}

impl Display {
    /// The server chooses a free number and says which; it is waited for until it answers.
    fn start() -> Display {
        // Another test's failure does not matter here.
        let turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let size = format!("{WIDTH}x{HEIGHT}x24");
        let mut server = Command::new("Xvfb")
            // Without -noreset the server starts over whenever its last client leaves (here the
            // question whether it answers), and turns away who knocks meanwhile.
            .args(["-displayfd", "1", "-screen", "0", &size, "-nolisten", "tcp", "-noreset"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts");
        let mut number = String::new();
        let stdout = server.stdout.take().expect("it is piped");
        BufReader::new(stdout).read_line(&mut number).expect("Xvfb says its number");
        let name = format!(":{}", number.trim());
        assert!(name.len() > 1, "Xvfb named no display: {:?}", server.wait());
        let screenshots = tempfile::tempdir().expect("a temporary folder");
        let display = Display { server, _turn: turn, name, screenshots };
        let begin = Instant::now();
        while !display.answers() {
            assert!(begin.elapsed() < PATIENCE, "{} does not answer", display.name);
            std::thread::sleep(Duration::from_millis(50));
        }
        display
    }

    fn answers(&self) -> bool {
        let mut ask = Command::new("xdotool");
        ask.arg("getdisplaygeometry").env("DISPLAY", &self.name);
        let status = ask.stdout(Stdio::null()).stderr(Stdio::null()).status();
        status.is_ok_and(|status| status.success())
    }

    fn view(&self, file: &Path, folder: &Path, more: &[&str]) -> Child {
        let size = format!("{WIDTH}x{HEIGHT}");
        Command::new(env!("CARGO_BIN_EXE_hlod-render"))
            .args(["--software", "view"])
            .arg(file)
            .args(["--size", &size, "--tau", "0.5", "--light", "-45,40"])
            .args(more)
            .current_dir(folder)
            .env("DISPLAY", &self.name)
            .env_remove("WAYLAND_DISPLAY")
            .spawn()
            .expect("the program starts")
    }

    fn window_of(&self, program: &mut Child) -> String {
        let pid = program.id().to_string();
        let begin = Instant::now();
        while begin.elapsed() < PATIENCE {
            if let Some(status) = program.try_wait().expect("the program can be waited for") {
                panic!("the program ended before it had a window: {status}");
            }
            let found = Command::new("xdotool")
                .args(["search", "--onlyvisible", "--pid", &pid])
                .env("DISPLAY", &self.name)
                .stderr(Stdio::null())
                .output()
                .expect("xdotool runs");
            if let Some(window) = String::from_utf8_lossy(&found.stdout).lines().last() {
                return window.to_owned();
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        panic!("no window appeared");
    }

    fn xdotool(&self, arguments: &[&str]) {
        let status = Command::new("xdotool").args(arguments).env("DISPLAY", &self.name).status();
        assert!(status.is_ok_and(|s| s.success()), "xdotool {arguments:?}");
    }

    /// The cursor where nothing is below it.
    fn away(&self) {
        self.xdotool(&["mousemove", "20", "580"]);
    }

    fn key(&self, window: &str, key: &str) {
        // Without a window manager, nothing has the keyboard by itself.
        self.xdotool(&["windowfocus", "--sync", window, "key", key]);
    }

    /// Moves there and clicks, and waits until that has been answered for.
    fn click(&self, (x, y): (i32, i32)) {
        self.xdotool(&["mousemove", &x.to_string(), &y.to_string(), "click", "1"]);
        // Two clicks within less are a double click.
        std::thread::sleep(Duration::from_millis(1200));
    }

    /// Waits until something is there.
    fn until<T>(&self, program: &mut Child, found: impl Fn() -> Option<T>) -> T {
        let begin = Instant::now();
        while begin.elapsed() < PATIENCE {
            let ended = program.try_wait().expect("the program can be waited for");
            assert!(ended.is_none(), "the program ended by itself: {ended:?}");
            if let Some(found) = found() {
                return found;
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("window-never.png");
        panic!("it never came; see {file:?}, {:?}", self.grab().save(&file));
    }

    fn drag(&self, button: &str, from: (i32, i32), to: (i32, i32)) {
        const STEPS: i32 = 8;
        for step in 0..=STEPS {
            let x = from.0 + (to.0 - from.0) * step / STEPS;
            let y = from.1 + (to.1 - from.1) * step / STEPS;
            self.xdotool(&["mousemove", &x.to_string(), &y.to_string()]);
            if step == 0 {
                self.xdotool(&["mousedown", button]);
            }
            std::thread::sleep(Duration::from_millis(60));
        }
        self.xdotool(&["mouseup", button]);
    }

    fn grab(&self) -> Picture {
        let file = self.screenshots.path().join("screen.png");
        let mut import = Command::new("import");
        import.args(["-window", "root"]).arg(&file).env("DISPLAY", &self.name);
        assert!(import.status().is_ok_and(|s| s.success()), "import");
        load(&file)
    }

    /// What the display shows once it has stopped changing.
    fn settled(&self, program: &mut Child) -> Picture {
        const ALIKE: u32 = 3;
        let begin = Instant::now();
        let mut last: Option<Picture> = None;
        let mut alike = 0;
        while begin.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(400));
            let ended = program.try_wait().expect("the program can be waited for");
            assert!(ended.is_none(), "the program ended by itself: {ended:?}");
            let picture = self.grab();
            // Before the first frame, all is black.
            let shown = picture.rgba.chunks_exact(4).any(|p| p[0] > 40);
            alike = if shown && last.as_ref() == Some(&picture) { alike + 1 } else { 0 };
            if alike == ALIKE {
                return picture;
            }
            last = Some(picture);
        }
        panic!("the window never came to rest");
    }
}
