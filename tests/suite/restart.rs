//! Builds that are stopped, killed or interfered with: they go on to the same bytes, or say why not.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use hlod_tests::{bumpy_ball, program};

/// A scan, and what an uninterrupted build makes of it.
pub(crate) struct Model {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) scan: PathBuf,
    pub(crate) bytes: Vec<u8>,
    took: Duration,
}

impl Model {
    pub(crate) fn new(rings: u32) -> Model {
        let folder = tempfile::tempdir().unwrap();
        let scan = folder.path().join("ball.ply");
        std::fs::write(&scan, bumpy_ball(rings)).unwrap();
        let whole = folder.path().join("whole.hlod");
        let start = Instant::now();
        let output = command(&scan, &whole, &[]).output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        let bytes = std::fs::read(&whole).unwrap();
        Model { folder, scan, bytes, took: start.elapsed() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Goes on with a build that was stopped; starts it where it had not begun.
    pub(crate) fn finish(&self, output: &Path, what: &str) {
        let mut resumed = command(&self.scan, output, &["--resume"]).output().unwrap();
        if said(&resumed).contains("no unfinished build") {
            resumed = command(&self.scan, output, &["--force"]).output().unwrap();
        }
        assert!(resumed.status.success(), "{what}: {}", said(&resumed));
        assert!(std::fs::read(output).unwrap() == self.bytes, "{what}: other bytes");
        assert!(!work(output).exists(), "{what}: the work folder is left");
    }
}

/// Small leaves and little memory: a dozen subtrees and levels above them.
pub(crate) fn command(scan: &Path, output: &Path, more: &[&str]) -> Command {
    let mut command = program("hlod-build");
    command.arg("build").arg(scan).arg("-o").arg(output);
    command.args(["--leaf-triangles", "300", "--memory", "96MiB"]).args(more);
    command
}

pub(crate) fn work(output: &Path) -> PathBuf {
    PathBuf::from(format!("{}.work", output.display()))
}

pub(crate) fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub(crate) fn start(model: &Model, output: &Path) -> Child {
    command(&model.scan, output, &[]).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap()
}

/// Waits until the journal has so many lines; says whether it came to that.
pub(crate) fn wait_for_steps(output: &Path, child: &mut Child, lines: usize) -> bool {
    let journal = work(output).join("journal");
    loop {
        let text = std::fs::read(&journal).unwrap_or_default();
        if text.iter().filter(|&&b| b == b'\n').count() >= lines {
            return true;
        }
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn killed_at_any_moment_a_build_goes_on_to_the_same_bytes() {
    let model = Model::new(100);
    let mut state = 20_041_122u64;
    let mut unfinished = 0;
    for round in 0..20 {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let moment = model.took.mul_f64((state >> 40) as f64 / (1u64 << 24) as f64);
        let output = model.path(&format!("{round}.hlod"));
        let mut child = start(&model, &output);
        std::thread::sleep(moment);
        child.kill().unwrap();
        child.wait().unwrap();
        unfinished += usize::from(!output.exists());
        if !output.exists() {
            model.finish(&output, &format!("killed after {moment:?}"));
        }
        std::fs::remove_file(&output).unwrap();
    }
    assert!(unfinished >= 10, "only {unfinished} of 20 builds were killed in time");
}

#[cfg(unix)]
#[test]
fn control_c_leaves_what_is_done_and_says_so() {
    let model = Model::new(170);
    let output = model.path("stopped.hlod");
    let mut child = start(&model, &output);
    assert!(wait_for_steps(&output, &mut child, 6), "it was faster than this test");
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(1), "{}", said(&ended));
    assert!(said(&ended).contains("--resume"), "{}", said(&ended));
    model.finish(&output, "stopped");
}

#[test]
fn what_was_tampered_with_is_made_again() {
    let model = Model::new(170);
    let output = model.path("tampered.hlod");
    for kind in ["nodes-", "pages-", "cell-", "survey.json", "plan.json"] {
        let mut child = start(&model, &output);
        assert!(wait_for_steps(&output, &mut child, 9), "it was faster than this test");
        child.kill().unwrap();
        child.wait().unwrap();
        let journal = std::fs::read_to_string(work(&output).join("journal")).unwrap();
        // A file that the journal vouches for.
        let entry = std::fs::read_dir(work(&output)).unwrap().map(|e| e.unwrap()).find(|e| {
            let name = e.file_name().to_string_lossy().into_owned();
            name.starts_with(kind) && journal.contains(&format!("\"{name}\""))
        });
        let path = entry.unwrap_or_else(|| panic!("no file {kind}")).path();
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&path, bytes).unwrap();
        model.finish(&output, kind);
        std::fs::remove_file(&output).unwrap();
    }
    // A line that a crash cut short, and a file that is gone.
    let mut child = start(&model, &output);
    assert!(wait_for_steps(&output, &mut child, 9), "it was faster than this test");
    child.kill().unwrap();
    child.wait().unwrap();
    let journal = work(&output).join("journal");
    let mut text = std::fs::read(&journal).unwrap();
    text.truncate(text.len() - 7);
    std::fs::write(&journal, text).unwrap();
    let mut entries = std::fs::read_dir(work(&output)).unwrap().map(|e| e.unwrap().path());
    let gone = entries.find(|p| p.to_string_lossy().contains("/nodes-")).unwrap();
    std::fs::remove_file(gone).unwrap();
    model.finish(&output, "cut short");
}

#[test]
fn other_builds_and_changed_inputs_are_refused() {
    let model = Model::new(170);
    let output = model.path("refused.hlod");
    let mut child = start(&model, &output);
    assert!(wait_for_steps(&output, &mut child, 2), "it was faster than this test");
    let second = command(&model.scan, &output, &["--resume"]).output().unwrap();
    assert_eq!(second.status.code(), Some(2));
    assert!(said(&second).contains("another build works in this folder"), "{}", said(&second));
    child.kill().unwrap();
    child.wait().unwrap();

    let again = command(&model.scan, &output, &[]).output().unwrap();
    assert_eq!(again.status.code(), Some(2));
    assert!(said(&again).contains("--resume"), "{}", said(&again));
    let other =
        command(&model.scan, &output, &["--resume", "--resolution", "99"]).output().unwrap();
    assert!(said(&other).contains("other options"), "{}", said(&other));
    let text = std::fs::read(&model.scan).unwrap();
    std::fs::write(&model.scan, &text).unwrap();
    let changed = command(&model.scan, &output, &["--resume"]).output().unwrap();
    assert_eq!(changed.status.code(), Some(2));
    assert!(said(&changed).contains("has changed since"), "{}", said(&changed));
    std::fs::remove_dir_all(work(&output)).unwrap();
    let nothing = command(&model.scan, &output, &["--resume"]).output().unwrap();
    assert_eq!(nothing.status.code(), Some(2));
    assert!(said(&nothing).contains("no unfinished build"), "{}", said(&nothing));
    // The folder of something else is not touched.
    std::fs::create_dir(work(&output)).unwrap();
    std::fs::write(work(&output).join("thesis.txt"), "precious").unwrap();
    let foreign = command(&model.scan, &output, &["--force"]).output().unwrap();
    assert_eq!(foreign.status.code(), Some(2), "{}", said(&foreign));
    assert_eq!(std::fs::read(work(&output).join("thesis.txt")).unwrap(), b"precious");
    assert_eq!(std::fs::read_dir(work(&output)).unwrap().count(), 1, "something was added");
}

/// The system refuses more than what was allowed, and the file is the same as with plenty.
#[cfg(target_os = "linux")]
/// Steps done by processes of their own, some of them in a folder that holds nothing but what they
/// need, make the same file.
#[test]
fn steps_done_one_by_one_and_elsewhere_give_the_same_bytes() {
    let model = Model::new(200);
    let output = model.path("steps.hlod");
    let prepared = command(&model.scan, &output, &["--prepare", "--quiet"]).output().unwrap();
    assert!(prepared.status.success(), "{}", said(&prepared));
    let home = work(&output);
    let step = |folder: &Path, names: &[&str]| {
        let mut command = program("hlod-build");
        command.arg("step").arg(folder).args(names).args(["--json", "--memory", "96MiB"]);
        command.output().unwrap()
    };
    let list = || -> Vec<serde_json::Value> {
        let output = step(&home, &[]);
        assert!(output.status.success(), "{}", said(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let all = list();
    assert!(all.len() > 5, "{all:?}");
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    let names = |step: &serde_json::Value, key: &str| -> Vec<String> {
        step[key].as_array().unwrap().iter().map(text).collect()
    };

    // What is not there yet is said, as is what does not exist.
    let early = step(&home, &[&text(&all.last().unwrap()["name"])]);
    assert_eq!(early.status.code(), Some(2));
    assert!(said(&early).contains("needs nodes-"), "{}", said(&early));
    assert!(said(&step(&home, &["build-9-9"])).contains("has no step build-9-9"));

    let away = model.path("away");
    for (i, description) in all.iter().enumerate() {
        let name = text(&description["name"]);
        let journal = std::fs::read_to_string(home.join("journal")).unwrap();
        let is_away = i % 2 == 1;
        if is_away {
            std::fs::create_dir(&away).unwrap();
            for file in names(description, "needs").iter().map(String::as_str).chain(["journal"]) {
                std::fs::copy(home.join(file), away.join(file)).unwrap();
            }
        }
        let done = step(if is_away { &away } else { &home }, &[&name]);
        assert!(done.status.success(), "{name}: {}", said(&done));
        if is_away {
            for file in names(description, "makes") {
                std::fs::copy(away.join(&file), home.join(&file)).unwrap();
            }
            let longer = std::fs::read_to_string(away.join("journal")).unwrap();
            assert!(longer.len() > journal.len());
            std::fs::copy(away.join("journal"), home.join("journal")).unwrap();
            std::fs::remove_dir_all(&away).unwrap();
        }
    }
    assert!(list().iter().all(|step| step["done"] == true));
    model.finish(&output, "steps");

    // What was changed in between is noticed.
    let output = model.path("tampered.hlod");
    let home = work(&output);
    let prepared = command(&model.scan, &output, &["--prepare", "--quiet"]).output().unwrap();
    assert!(prepared.status.success(), "{}", said(&prepared));
    let cell = names(&all[0], "needs").into_iter().find(|f| f.starts_with("cell-")).unwrap();
    let mut bytes = std::fs::read(home.join(&cell)).unwrap();
    bytes[100] ^= 1;
    std::fs::write(home.join(&cell), bytes).unwrap();
    let refused = step(&home, &[&text(&all[0]["name"])]);
    assert!(said(&refused).contains(&cell), "{}", said(&refused));
    model.finish(&output, "tampered");
}

#[test]
fn memory_stays_within_what_is_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let [scan, little, plenty] =
        ["ball.ply", "little.hlod", "plenty.hlod"].map(|name| folder.path().join(name));
    std::fs::write(&scan, bumpy_ball(450)).unwrap();
    let build = |output: &Path, memory: &str| {
        let mut command = program("hlod-build");
        command.arg("build").arg(&scan).arg("-o").arg(output);
        command.args(["--leaf-triangles", "4096", "--memory", memory]);
        command
    };
    let command = build(&little, "160MiB");
    let mut limited = Command::new("sh");
    let kib = 160 * 1024;
    limited.arg("-c").arg(format!("ulimit -d {kib}; exec \"$@\"")).arg("sh");
    let output = limited.arg(command.get_program()).args(command.get_args()).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert!(build(&plenty, "4GiB").status().unwrap().success());
    assert!(std::fs::read(little).unwrap() == std::fs::read(plenty).unwrap(), "other bytes");

    let output = build(&folder.path().join("none.hlod"), "20MiB").output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("which takes about"), "{}", said(&output));
}

/// A disk that is full in the middle: what is done stays, and the build goes on once there is room.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_and_survived() {
    let model = Model::new(170);
    let output = model.path("full.hlod");
    // No file may grow beyond 1.5 MB: less than the vertices take.
    let command = command(&model.scan, &output, &[]);
    let mut limited = Command::new("sh");
    limited.arg("-c").arg("trap '' XFSZ; ulimit -f 2000; exec \"$@\"").arg("sh");
    let failed = limited.arg(command.get_program()).args(command.get_args()).output().unwrap();
    assert_eq!(failed.status.code(), Some(1), "{}", said(&failed));
    assert!(said(&failed).contains("cannot write"), "{}", said(&failed));
    assert!(!output.exists());
    model.finish(&output, "full disk");
}
