//! What goes wrong round a build: disks, inputs, outputs. The output is right, or not there.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use hlod_build::progress::{Progress, Silent, Unit};
use hlod_build::{BuildError, BuildOptions, build};
use hlod_tests::ended::ended;
use hlod_tests::{bumpy_ball, program};

use crate::restart::{Model, command, start, wait_for_steps, work};

/// Runs the build where no file may be longer than so many KiB: writes beyond fail as on a full disk.
#[cfg(unix)]
fn limited(model: &Model, output: &Path, kib: u64, resume: bool) -> hlod_tests::ended::Ended {
    let plain = command(&model.scan, output, if resume { &["--resume"] } else { &[] });
    let mut shell = std::process::Command::new("bash");
    // Without the trap, the system ends whoever writes too much.
    shell.args(["-c", r#"trap "" XFSZ; ulimit -f "$0"; exec "$@""#]).arg(kib.to_string());
    ended(shell.arg(plain.get_program()).args(plain.get_args()))
}

#[cfg(unix)]
#[test]
fn a_disk_that_is_full_at_any_length_ends_the_build_and_it_goes_on_later() {
    let model = Model::new(60);
    let output = model.path("full.hlod");
    let (mut failed, mut kib, mut resumed) = (0, 1, 0);
    loop {
        let limited = limited(&model, &output, kib, false);
        if limited.status == Some(0) {
            break;
        }
        assert_eq!(limited.objection(), None, "{kib} KiB");
        assert!(!output.exists(), "{kib} KiB: something has the output's name");
        failed += 1;
        // What is done stays done, and the rest gives the same bytes; else it begins anew.
        resumed += u32::from(work(&output).exists());
        model.finish(&output, &format!("after {kib} KiB"));
        std::fs::remove_file(&output).unwrap();
        kib = (kib + 1).max(kib * 5 / 4);
    }
    assert!(failed > 10 && resumed > 2, "{failed} failed, {resumed} of them went on");
    assert!(std::fs::read(&output).unwrap() == model.bytes);
    std::fs::remove_file(&output).unwrap();
    // Nor does going on twice with too little spoil anything.
    let half = kib / 2;
    limited_twice(&model, &output, half);
    model.finish(&output, "twice");
}

#[cfg(unix)]
fn limited_twice(model: &Model, output: &Path, kib: u64) {
    for resume in [false, true] {
        let ended = limited(model, output, kib, resume);
        assert_eq!(ended.objection(), None, "{kib} KiB");
        assert!(!output.exists());
    }
}

/// A file system of so many bytes, where this user may make one.
#[cfg(target_os = "linux")]
#[test]
fn a_file_system_that_is_full_ends_the_build() {
    let model = Model::new(60);
    let mut refused = 0;
    for kib in [64, 400, 1_500, 3_000, 6_000, 60_000] {
        let disk = model.path("disk");
        let _ = std::fs::create_dir(&disk);
        let output = disk.join("full.hlod");
        let plain = command(&model.scan, &output, &[]);
        let mut shell = std::process::Command::new("unshare");
        let script = r#"mount -t tmpfs -o size="$0"k none "$1" || exit 99; target="$1"; shift; "$@"
            status=$?; ls "$target"; exit $status"#;
        shell.args(["-rm", "sh", "-c", script]).arg(kib.to_string()).arg(&disk);
        let ended = ended(shell.arg(plain.get_program()).args(plain.get_args()));
        if matches!(ended.status, None | Some(99)) || ended.said.contains("unshare") {
            hlod_tests::skip("a_file_system_that_is_full_ends_the_build", ended.said.trim());
            return;
        }
        let has_output = ended.told.lines().any(|name| name == "full.hlod");
        assert_eq!(ended.status == Some(0), has_output, "{kib} KiB: {ended:?}");
        if !has_output {
            assert_eq!(ended.objection(), None, "{kib} KiB");
            assert!(ended.said.contains("full.hlod"), "{kib} KiB: {}", ended.said);
            refused += 1;
        }
    }
    assert!((1..6).contains(&refused), "{refused} of 6 were too small");
}

#[test]
fn killed_after_each_step_a_build_goes_on_to_the_same_bytes() {
    let model = Model::new(170);
    let mut kills = 0;
    // After each ninth line of the journal: the steps between are of the same kinds.
    for lines in (1..).step_by(9) {
        let output = model.path(&format!("{lines}.hlod"));
        let mut child = start(&model, &output);
        let came = wait_for_steps(&output, &mut child, lines);
        let _ = child.kill();
        child.wait().unwrap();
        if !came || output.exists() {
            break;
        }
        model.finish(&output, &format!("killed after line {lines}"));
        std::fs::remove_file(&output).unwrap();
        kills += 1;
    }
    assert!(kills >= 2, "only {kills} steps");
}

type Change = fn(&Path);

/// Changes a scan while it is read.
struct Meddler {
    scan: PathBuf,
    change: Change,
    is_done: AtomicBool,
}

impl Progress for Meddler {
    fn begin(&self, stage: &'static str, _total: u64, _unit: Unit) {
        if stage == "read" && !self.is_done.swap(true, Ordering::SeqCst) {
            (self.change)(&self.scan);
        }
    }
    fn advance(&self, _count: u64) {}
    fn end(&self) {}
}

#[test]
fn a_scan_that_changes_while_it_is_read_is_refused_by_name() {
    let ball = bumpy_ball(20);
    let longer = |path: &Path| std::fs::write(path, bumpy_ball(24)).unwrap();
    let touched = |path: &Path| {
        let file = std::fs::File::options().append(true).open(path).unwrap();
        file.set_modified(std::time::SystemTime::UNIX_EPOCH).unwrap();
    };
    let cut = |path: &Path| {
        let file = std::fs::File::options().write(true).open(path).unwrap();
        file.set_len(500).unwrap();
    };
    let gone = |path: &Path| std::fs::remove_file(path).unwrap();
    let nothing = |_: &Path| ();
    let cases: [(&str, Change); 5] = [
        ("longer", longer),
        ("touched", touched),
        ("cut", cut),
        ("gone", gone),
        ("nothing", nothing),
    ];
    for (what, change) in cases {
        let folder = tempfile::tempdir().unwrap();
        let [scan, output] = ["ball.ply", "out.hlod"].map(|name| folder.path().join(name));
        std::fs::write(&scan, &ball).unwrap();
        let meddler = Meddler { scan: scan.clone(), change, is_done: false.into() };
        let result =
            build(std::slice::from_ref(&scan), &output, &BuildOptions::default(), &meddler);
        assert_eq!(output.exists(), what == "nothing", "{what}");
        match (what, result) {
            ("nothing", result) => assert!(result.is_ok()),
            ("longer" | "touched", Err(BuildError::InputChanged(path))) => assert_eq!(path, scan),
            ("cut" | "gone", Err(error)) => {
                assert!(error.to_string().contains("ball.ply"), "{what}: {error}");
            }
            (_, result) => panic!("{what}: {result:?}"),
        }
        assert!(!work(&output).exists(), "{what}: the work folder is left");
    }
}

/// The work folder is taken away meanwhile.
#[test]
fn a_work_folder_that_goes_away_is_said() {
    let model = Model::new(120);
    let output = model.path("away.hlod");
    let mut child = start(&model, &output);
    assert!(wait_for_steps(&output, &mut child, 4), "it was faster than this test");
    let _ = std::fs::rename(work(&output), model.path("elsewhere"));
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(1), "{ended:?}");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(said.contains("away.hlod") && !said.contains("panicked"), "{said}");
    assert!(!output.exists());
}

#[cfg(unix)]
#[test]
fn inputs_and_outputs_of_other_kinds_are_refused() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("ball.ply"), bumpy_ball(12)).unwrap();
    std::fs::write(at("precious"), "precious").unwrap();
    std::fs::create_dir(at("folder")).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
    symlink(at("nowhere"), at("dangling")).unwrap();
    symlink(at("loop"), at("loop")).unwrap();
    symlink(at("precious"), at("link")).unwrap();
    symlink(at("ball.ply"), at("to-input")).unwrap();
    let before = std::fs::read_dir(folder.path()).unwrap().count();
    let build = |input: &Path, output: &Path, more: &[&str]| {
        ended(program("hlod-build").arg("build").arg(input).arg("-o").arg(output).args(more))
    };
    for output in ["folder", "pipe", "dangling", "loop", "to-input", "/dev/full", "/dev/null"] {
        for more in [&[][..], &["--force"]] {
            let ended = build(&at("ball.ply"), &at(output), more);
            assert_eq!(ended.objection(), None, "-o {output} {more:?}");
        }
    }
    assert_eq!(build(&at("ball.ply"), &at("link"), &[]).objection(), None);
    for input in ["folder", "pipe", "dangling", "loop", "/dev/zero", "/dev/null", "/proc/self/mem"]
    {
        assert_eq!(build(&at(input), &at("out.hlod"), &[]).objection(), None, "{input}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before, "something is left");
    assert_eq!(std::fs::read_to_string(at("precious")).unwrap(), "precious");
    assert!(std::fs::symlink_metadata("/dev/full").unwrap().file_type() != file_type(&at("link")));

    // Pictures and reports neither replace devices nor wait for pipes.
    let hlod = at("good.hlod");
    assert_eq!(build(&at("ball.ply"), &hlod, &[]).status, Some(0));
    for output in ["folder", "pipe", "dangling", "/dev/full"] {
        let mut shot = program("hlod-render");
        shot.args(["--software", "shot"]).arg(&hlod).args(["--size", "16x16", "-o"]);
        assert_eq!(ended(shot.arg(at(output))).objection(), None, "shot -o {output}");
    }
    assert!(!Path::new("/dev/full").is_file(), "the device was replaced");
    let report = format!("--json={}", at("link").display());
    let info = ended(program("hlod-build").arg("info").arg(&hlod).arg(report));
    assert_eq!(info.status, Some(0), "{}", info.said);
    assert!(std::fs::symlink_metadata(at("link")).unwrap().is_symlink(), "the link was replaced");
    let full = ended(program("hlod-build").arg("info").arg(&hlod).arg("--json=/dev/full"));
    assert_eq!(full.objection(), None);
}

#[cfg(unix)]
fn file_type(path: &Path) -> std::fs::FileType {
    std::fs::symlink_metadata(path).unwrap().file_type()
}

/// Two builds with work folders of their own and the same output: one gets the name, the other says so.
#[test]
fn of_two_builds_into_one_output_the_second_is_refused() {
    let model = Model::new(100);
    let output = model.path("both.hlod");
    let spawn = |name: &str| {
        let mut command = command(&model.scan, &output, &["--work-dir"]);
        command.arg(model.path(name)).stderr(std::process::Stdio::piped());
        command.stdout(std::process::Stdio::null()).spawn().unwrap()
    };
    let ended = ["a", "b"].map(spawn).map(|child| child.wait_with_output().unwrap());
    let good = ended.iter().filter(|output| output.status.success()).count();
    assert_eq!(good, 1, "{ended:?}");
    let refused = ended.iter().find(|output| !output.status.success()).unwrap();
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(said.contains("exists already"), "{said}");
    assert!(std::fs::read(&output).unwrap() == model.bytes);
    // With --force the last one wins, and is whole.
    let forced = BuildOptions { force: true, leaf_triangles: 300, ..BuildOptions::default() };
    build(std::slice::from_ref(&model.scan), &output, &forced, &Silent).unwrap();
    assert!(std::fs::read(&output).unwrap() == model.bytes);
}

/// Where even the message cannot be written, the exit status still tells.
#[cfg(target_os = "linux")]
#[test]
fn programs_that_cannot_speak_keep_their_exit_status() {
    for name in ["hlod-build", "hlod-render"] {
        let deaf = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let command = if name == "hlod-build" { "info" } else { "measure" };
        let run = || {
            let mut run = program(name);
            run.args([command, "/no/such/file.hlod"]);
            run
        };
        let status = run().stderr(deaf).status().unwrap();
        assert_eq!(status.code(), ended(&mut run()).status, "{name}");
    }
}

/// The file's format has a ceiling, so that no page keeps who decodes it for long.
#[test]
fn a_node_of_more_than_a_page_may_hold_ends_the_build_and_says_what_to_change() {
    const POINTS: u32 = (1 << 19) + 1;
    let folder = tempfile::tempdir().unwrap();
    let [scan, output] = ["a.ply", "a.hlod"].map(|name| folder.path().join(name));
    let mut ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\nproperty float x\nproperty float y\n\
         property float z\nproperty float nx\nproperty float ny\nproperty float nz\nend_header\n"
    )
    .into_bytes();
    for i in 0..POINTS {
        for value in [(i % 1024) as f32, (i / 1024) as f32, 0.0, 0.0, 0.0, 1.0] {
            ply.extend(value.to_le_bytes());
        }
    }
    std::fs::write(&scan, ply).unwrap();
    // More than the command line allows.
    let options = BuildOptions {
        leaf_triangles: 2 * POINTS,
        memory_bytes: 64 << 30,
        ..BuildOptions::default()
    };
    let error = build(std::slice::from_ref(&scan), &output, &options, &Silent).unwrap_err();
    assert!(matches!(error, BuildError::NodeTooLarge { unit: "points", .. }), "{error}");
    assert!(error.to_string().contains("--resolution"), "{error}");
    assert!(!output.exists());
}
