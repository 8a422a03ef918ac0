//! The programs as users meet them: bad input ends in an error with the right exit status, soon,
//! and with nothing under the output's name.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use hlod_tests::{bumpy_ball, program};

fn build(input: &Path, output: &Path) -> Output {
    program("hlod-build").arg("build").arg(input).arg("-o").arg(output).output().unwrap()
}

/// The exit status, after checking that it was an orderly one with a message.
fn failure(output: &Output) -> i32 {
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(!message.contains("panicked"), "{message}");
    assert!(message.contains("hlod-"), "no message: {message}");
    output.status.code().expect("not killed by a signal")
}

const HEADER: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

#[test]
fn bad_scans_end_in_an_error_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let ball = bumpy_ball(20);
    let with = |body: &str| format!("{HEADER}{body}");
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("empty", Vec::new()),
        ("truncated", ball.as_bytes()[..ball.len() / 2].to_vec()),
        ("garbage", (0..4000u32).map(|i| (i.wrapping_mul(2654435761) >> 13) as u8).collect()),
        ("nan", with("nan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").into_bytes()),
        ("infinite", with("inf 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").into_bytes()),
        ("index", with("0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n").into_bytes()),
        ("no faces", with("0 0 0\n1 0 0\n0 1 0\n").replace("face 1", "face 0").into_bytes()),
        ("degenerate", with("0 0 0\n1 0 0\n0 1 0\n3 0 0 1\n").into_bytes()),
        ("flat to a point", with("1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n").into_bytes()),
        ("huge count", HEADER.replace("vertex 3", "vertex 4000000000").into_bytes()),
    ];
    for (name, bytes) in cases {
        let [input, output] = ["in.ply", "out.hlod"].map(|f| folder.path().join(f));
        std::fs::write(&input, bytes).unwrap();
        let start = std::time::Instant::now();
        let status = failure(&build(&input, &output));
        assert!(status == 1 || status == 2, "{name}: status {status}");
        assert!(start.elapsed().as_secs() < 10, "{name} took {:?}", start.elapsed());
        let left: Vec<PathBuf> =
            std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(left, [input], "{name} left something behind");
    }
    assert_eq!(failure(&build(Path::new("/no/such/scan.ply"), &folder.path().join("o.hlod"))), 2);
}

#[test]
fn outputs_are_not_overwritten_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let [input, output] = ["in.ply", "out.hlod"].map(|f| folder.path().join(f));
    std::fs::write(&input, bumpy_ball(12)).unwrap();
    std::fs::write(&output, "precious").unwrap();
    assert_eq!(failure(&build(&input, &output)), 2);
    assert_eq!(std::fs::read_to_string(&output).unwrap(), "precious");
    // The input itself, even with --force; a folder that is not there.
    let mut forced = program("hlod-build");
    forced.arg("build").arg(&input).arg("-o").arg(&input).arg("--force");
    assert_eq!(failure(&forced.output().unwrap()), 2);
    assert!(std::fs::read_to_string(&input).unwrap().starts_with("ply"));
    assert_eq!(failure(&build(&input, &folder.path().join("none/out.hlod"))), 1);
}

#[test]
fn damaged_files_are_refused_by_both_programs() {
    let folder = tempfile::tempdir().unwrap();
    let [input, hlod, bad] = ["in.ply", "good.hlod", "bad.hlod"].map(|f| folder.path().join(f));
    std::fs::write(&input, bumpy_ball(30)).unwrap();
    assert!(build(&input, &hlod).status.success());
    let good = std::fs::read(&hlod).unwrap();
    let flipped = |at: usize| {
        let mut bytes = good.clone();
        bytes[at] ^= 1;
        bytes
    };
    let cases = [
        Vec::new(),
        good[..good.len() - 1].to_vec(),
        good[..50].to_vec(),
        flipped(30),
        input_bytes(&input),
    ];
    for (i, bytes) in cases.into_iter().enumerate() {
        std::fs::write(&bad, bytes).unwrap();
        let info = program("hlod-build").arg("info").arg(&bad).output().unwrap();
        assert_eq!(failure(&info), 1, "case {i}");
        let png = folder.path().join("bad.png");
        let shot = program("hlod-render")
            .args(["--software", "shot"])
            .arg(&bad)
            .arg("-o")
            .arg(&png)
            .output()
            .unwrap();
        assert_eq!(failure(&shot), 1, "case {i}");
        assert!(!png.exists());
    }
    // Verify says what is wrong and exits with 3.
    std::fs::write(&bad, flipped(good.len() - 3)).unwrap();
    let verify = program("hlod-build").arg("verify").arg(&bad).output().unwrap();
    assert_eq!(verify.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&verify.stdout).contains("REFUTED"));
}

fn input_bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

#[test]
fn json_has_the_promised_keys() {
    let folder = tempfile::tempdir().unwrap();
    let [input, hlod] = ["in.ply", "out.hlod"].map(|f| folder.path().join(f));
    std::fs::write(&input, bumpy_ball(30)).unwrap();
    let json = |command: &mut Command| -> serde_json::Value {
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let has = |value: &serde_json::Value, keys: &str| {
        for key in keys.split_whitespace() {
            assert!(value.get(key).is_some(), "no {key}");
        }
    };
    let built =
        json(program("hlod-build").args(["build", "--json"]).arg(&input).arg("-o").arg(&hlod));
    has(&built, "wall_secs cpu_secs peak_rss_bytes peak_anonymous_bytes stages");
    let info = json(program("hlod-build").args(["info", "--json"]).arg(&hlod));
    has(
        &info,
        "triangles_input bytes_total bytes_leaves bytes_appearance_upper bytes_geometric_upper bytes_skeleton levels",
    );
    has(
        &info["levels"][0],
        "depth nodes triangles_mean points_mean triangles_geometric_mean error_max",
    );
    let verified = json(program("hlod-build").args(["verify", "--json"]).arg(&hlod));
    has(&verified, "nodes nodes_over_bound tightness_median tightness_p95 independent_ratio_max");
    let path = hlod_tests::workspace().join("bench-paths/orbit.json");
    let mut bench = program("hlod-render");
    bench.args(["--software", "bench", "--json", "--frames", "3", "--size", "64x48", "--path"]);
    let benched = json(bench.arg(path).arg(&hlod));
    has(
        &benched,
        "adapter width height tau_px frames fps_mean frame_ms primitives_mean points_per_covered_pixel stalled_frames frames_over_tau tau_ratio_mean bytes_read resident_bytes_max",
    );
    has(&benched["frame_ms"], "p50 p95 p99 max");
    let mut audit = program("hlod-render");
    audit.args(["--software", "audit", "--json", "--views", "1", "--size", "64x48", "--against"]);
    let audited = json(audit.arg(&input).arg("--").arg(&hlod));
    has(
        &audited,
        "views hole_pixels overdraw_pixels appearance_distance_px silhouette_distance_px",
    );
    has(&audited["appearance_distance_px"], "p99 p999 max floor_p999");
}
