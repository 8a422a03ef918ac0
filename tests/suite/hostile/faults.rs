//! Builds on failing hardware, without permissions, and while the clock jumps.
//!
//! `faults.c` beside this file makes system calls of the program fail. Whatever fails and when: no
//! wrong file has the output's name, the message names the file and the system's reason, and a
//! build comes to the same bytes afterwards.

use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::{Path, PathBuf};
use std::process::Command;

use hlod_tests::ended::{Ended, ended};
use hlod_tests::skip;

use crate::restart::{Model, command, wait_for_steps, work};

/// What fails: calls of a kind that concern files of a path, from one of them on.
#[derive(Debug, Clone, Copy)]
struct Fault {
    kind: &'static str,
    path: &'static str,
    /// Counted from 1.
    at: u64,
    stays: bool,
}

/// The compiled shim.
struct Shim {
    _folder: tempfile::TempDir,
    library: PathBuf,
}

impl Shim {
    /// None, and visibly so, without a C compiler.
    fn new(test: &str) -> Option<Shim> {
        let folder = tempfile::tempdir().unwrap();
        let library = folder.path().join("faults.so");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("suite/hostile/faults.c");
        let mut cc = Command::new("cc");
        cc.args(["-shared", "-fPIC", "-O1", "-o"]).arg(&library).arg(source).arg("-ldl");
        match cc.output() {
            Ok(output) if output.status.success() => Some(Shim { _folder: folder, library }),
            Ok(output) => {
                panic!("faults.c does not compile: {}", String::from_utf8_lossy(&output.stderr))
            }
            Err(error) => {
                skip(test, &format!("cc: {error}"));
                None
            }
        }
    }

    fn run(&self, mut build: Command, fault: Fault) -> Ended {
        build.env("LD_PRELOAD", &self.library).env("HLOD_FAULT", fault.kind);
        build.env("HLOD_FAULT_PATH", fault.path).env("HLOD_FAULT_AT", fault.at.to_string());
        ended(build.env("HLOD_FAULT_STAYS", u8::from(fault.stays).to_string()))
    }
}

/// Builds that meet the fault at the first call, the second, fourth, eighth … until one meets none. Gives how
/// often one failed.
fn fails_and_goes_on(model: &Model, shim: &Shim, fault: Fault, names: &str) -> u32 {
    let output = model.path("faulty.hlod");
    let (mut at, mut failed) = (1, 0);
    loop {
        let fault = Fault { at, ..fault };
        let ended = shim.run(command(&model.scan, &output, &[]), fault);
        if ended.status == Some(0) {
            assert!(std::fs::read(&output).unwrap() == model.bytes, "{fault:?}");
            std::fs::remove_file(&output).unwrap();
            return failed;
        }
        assert_eq!(ended.objection(), None, "{fault:?}");
        assert!(!output.exists(), "{fault:?}: something has the output's name");
        assert_says(&ended, names, "Input/output error", &format!("{fault:?}"));
        assert_no_rests(model, &output, &format!("{fault:?}"));
        model.finish(&output, &format!("after {fault:?}"));
        std::fs::remove_file(&output).unwrap();
        failed += 1;
        at *= 2;
    }
}

fn assert_says(ended: &Ended, name: &str, reason: &str, what: &str) {
    assert!(ended.said.contains(name) && ended.said.contains(reason), "{what}: {}", ended.said);
}

/// Nothing but the work folder, with which a build goes on, is left beside the output.
fn assert_no_rests(model: &Model, output: &Path, what: &str) {
    let left = std::fs::read_dir(model.folder.path()).unwrap().map(|entry| entry.unwrap().path());
    let known = [model.scan.clone(), work(output), model.path("whole.hlod")];
    let left: Vec<_> = left.filter(|path| !known.contains(path)).collect();
    assert!(left.is_empty(), "{what}: left {left:?}");
}

#[test]
fn reading_that_fails_at_any_place_ends_the_build_and_it_goes_on_later() {
    let test = "reading_that_fails_at_any_place_ends_the_build_and_it_goes_on_later";
    let Some(shim) = Shim::new(test) else { return };
    let model = Model::new(60);
    for stays in [true, false] {
        let scan = Fault { kind: "read", path: "ball.ply", at: 1, stays };
        assert!(fails_and_goes_on(&model, &shim, scan, "ball.ply") >= 2);
        let work = Fault { path: "faulty.hlod.work/", ..scan };
        assert!(fails_and_goes_on(&model, &shim, work, "faulty.hlod") >= 5);
    }
}

#[test]
fn writing_that_fails_at_any_place_ends_the_build_and_it_goes_on_later() {
    let test = "writing_that_fails_at_any_place_ends_the_build_and_it_goes_on_later";
    let Some(shim) = Shim::new(test) else { return };
    let model = Model::new(60);
    for stays in [true, false] {
        for kind in ["write", "sync"] {
            let work = Fault { kind, path: "faulty.hlod.work/", at: 1, stays };
            assert!(fails_and_goes_on(&model, &shim, work, "faulty.hlod") >= 5);
            // What becomes the output, before it has its name.
            let aside = Fault { path: "/.hlod-build-", ..work };
            assert!(fails_and_goes_on(&model, &shim, aside, "faulty.hlod") >= 1);
        }
    }
}

#[test]
fn an_output_that_cannot_get_its_name_leaves_what_has_it() {
    let test = "an_output_that_cannot_get_its_name_leaves_what_has_it";
    let Some(shim) = Shim::new(test) else { return };
    let model = Model::new(60);
    let output = model.path("faulty.hlod");
    let rename = Fault { kind: "rename", path: "", at: 1, stays: true };
    for before in [None, Some("precious")] {
        before.into_iter().for_each(|text| std::fs::write(&output, text).unwrap());
        let more: &[&str] = if before.is_some() { &["--force"] } else { &[] };
        let ended = shim.run(command(&model.scan, &output, more), rename);
        if ended.status == Some(99) {
            skip(test, ended.said.trim());
            return;
        }
        assert_eq!(ended.objection(), None);
        assert_says(&ended, "faulty.hlod", "Input/output error", test);
        assert_eq!(std::fs::read_to_string(&output).ok().as_deref(), before);
        let _ = std::fs::remove_file(&output);
        assert_no_rests(&model, &output, test);
        model.finish(&output, test);
        std::fs::remove_file(&output).unwrap();
    }
    // Nor does a write that fails spoil what is to be replaced.
    std::fs::write(&output, "precious").unwrap();
    let write = Fault { kind: "write", path: "/.hlod-build-", ..rename };
    let ended = shim.run(command(&model.scan, &output, &["--force"]), write);
    assert_eq!(ended.objection(), None);
    assert_eq!(std::fs::read_to_string(&output).unwrap(), "precious");
}

#[test]
fn a_clock_that_jumps_changes_nothing() {
    let Some(shim) = Shim::new("a_clock_that_jumps_changes_nothing") else { return };
    let model = Model::new(100);
    let output = model.path("faulty.hlod");
    let clock = Fault { kind: "clock", path: "", at: 1, stays: true };
    let report = model.path("report.json");
    let json = format!("--report={}", report.display());
    for more in [&[][..], &["--progress=json"], &[&json]] {
        let ended = shim.run(command(&model.scan, &output, more), clock);
        assert_eq!((ended.status, ended.disorder()), (Some(0), None), "{more:?}: {}", ended.said);
        assert!(std::fs::read(&output).unwrap() == model.bytes, "{more:?}");
        std::fs::remove_file(&output).unwrap();
    }
    // The shim does what it says: by this clock the build took at least an hour.
    let report = std::fs::read(report).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    assert!(report["wall_secs"].as_f64().is_some_and(|secs| secs > 3000.0), "{report}");
}

/// A user who may do nothing in particular.
const NOBODY: u32 = 65_534;

fn is_root() -> bool {
    std::fs::metadata("/proc/self").unwrap().uid() == 0
}

/// The program as it runs for [`NOBODY`]; for whoever runs the tests where that is not root, whom
/// permissions do not hold back.
fn as_nobody(build: &Command) -> Command {
    if !is_root() {
        let mut plain = Command::new(build.get_program());
        plain.args(build.get_args());
        return plain;
    }
    let mut command = Command::new("setpriv");
    let id = NOBODY.to_string();
    command.args(["--reuid", &id, "--regid", &id, "--clear-groups"]);
    command.arg(build.get_program()).args(build.get_args());
    command
}

fn permit(path: &Path, mode: u32) {
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
}

/// A model that belongs to [`NOBODY`]; none, and visibly so, where the program cannot be run by others.
fn model_of_nobody(test: &str, rings: u32) -> Option<Model> {
    let model = Model::new(rings);
    if is_root() {
        for path in [model.folder.path(), &model.scan] {
            chown(path, Some(NOBODY), Some(NOBODY)).unwrap();
        }
    }
    let output = model.path("probe.hlod");
    let probe = as_nobody(&command(&model.scan, &output, &[])).output();
    let good = probe.as_ref().is_ok_and(|output| output.status.success());
    if !good {
        skip(test, &format!("nobody else can run the program: {probe:?}"));
        return None;
    }
    assert!(std::fs::read(&output).unwrap() == model.bytes);
    std::fs::remove_file(&output).unwrap();
    Some(model)
}

#[test]
fn without_permissions_a_build_ends_and_leaves_nothing() {
    let test = "without_permissions_a_build_ends_and_leaves_nothing";
    let Some(model) = model_of_nobody(test, 30) else { return };
    let output = model.path("out.hlod");
    let build = |more: &[&str]| ended(&mut as_nobody(&command(&model.scan, &output, more)));
    let refused = |what: &str, names: &str, ended: Ended| {
        assert_eq!(ended.objection(), None, "{what}");
        assert_says(&ended, names, "Permission denied", what);
        assert_no_rests(&model, &output, what);
        assert!(!work(&output).exists(), "{what}: a work folder is left");
    };

    permit(&model.scan, 0);
    refused("a scan that may not be read", "ball.ply", build(&[]));
    permit(&model.scan, 0o644);

    permit(model.folder.path(), 0o555);
    refused("a folder that may not be written", "out.hlod", build(&[]));
    permit(model.folder.path(), 0o755);

    // A work folder elsewhere, which belongs to someone else.
    let scratch = tempfile::tempdir().unwrap();
    permit(scratch.path(), 0o555);
    let elsewhere = scratch.path().join("work");
    std::fs::create_dir(&elsewhere).unwrap();
    permit(&elsewhere, 0o555);
    let in_it = ["--work-dir", elsewhere.to_str().unwrap()];
    refused("a work folder that may not be written", "work", build(&in_it));

    // One that may be used and not removed: the output is good, and what is left is said.
    permit(&elsewhere, 0o777);
    let ended = build(&in_it);
    assert_eq!((ended.status, ended.disorder()), (Some(0), None), "{}", ended.said);
    assert!(std::fs::read(&output).unwrap() == model.bytes);
    assert_eq!(std::fs::read_dir(&elsewhere).unwrap().count(), 0);
    permit(scratch.path(), 0o755);
}

#[test]
fn a_work_folder_that_becomes_unwritable_ends_the_build_and_it_goes_on_later() {
    let test = "a_work_folder_that_becomes_unwritable_ends_the_build_and_it_goes_on_later";
    let Some(model) = model_of_nobody(test, 170) else { return };
    let output = model.path("out.hlod");
    let mut build = as_nobody(&command(&model.scan, &output, &[]));
    let stderr = std::process::Stdio::piped();
    let mut child = build.stderr(stderr).stdout(std::process::Stdio::null()).spawn().unwrap();
    assert!(wait_for_steps(&output, &mut child, 4), "it was faster than this test");
    permit(&work(&output), 0o555);
    let ended = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert!(said.contains("out.hlod.work") && said.contains("Permission denied"), "{said}");
    assert!(!output.exists() && !said.contains("panicked"), "{said}");
    // Whoever goes on meanwhile is refused as well, and nothing is lost by that.
    let resumed = as_nobody(&command(&model.scan, &output, &["--resume"])).output().unwrap();
    assert_eq!(resumed.status.code(), Some(1), "{resumed:?}");
    permit(&work(&output), 0o755);
    let resumed = as_nobody(&command(&model.scan, &output, &["--resume"])).output().unwrap();
    assert!(resumed.status.success(), "{resumed:?}");
    assert!(std::fs::read(&output).unwrap() == model.bytes);
    assert!(!work(&output).exists());
}
