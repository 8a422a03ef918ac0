//! Harness of the workspace's tests: scans, small models, the software adapter, running programs.

pub mod ended;
pub mod fuzz;
pub mod report;
pub mod samples;
pub mod soak;

use std::io::Write;
use std::path::{Path, PathBuf};

use hlod_build::progress::Silent;
use hlod_build::{BuildOptions, BuildReport, build};
use hlod_render::{AdapterChoice, Gpu};

/// The workspace's root.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A real scan in the folder of test data beside the checkout; where it is not there the test
/// that asks is skipped, visibly.
pub fn scan(test: &str, name: &str) -> Option<PathBuf> {
    let path = workspace().join("../shared/data").join(name);
    if path.is_file() {
        return Some(path);
    }
    skip(test, &format!("no scan {name}"));
    None
}

/// Notes that a test could not run: on standard error, and in the file named by `HLOD_SKIP_LOG`.
pub fn skip(test: &str, why: &str) {
    eprintln!("SKIPPED: {test}: {why}");
    if let Some(log) = std::env::var_os("HLOD_SKIP_LOG") {
        let file = std::fs::OpenOptions::new().create(true).append(true).open(log);
        if let Ok(mut file) = file {
            let _ = writeln!(file, "{test}: {why}");
        }
    }
}

/// The software adapter: the same pictures everywhere.
///
/// # Panics
/// When there is none: `cargo xtask test` installs it.
pub fn gpu() -> Gpu {
    Gpu::headless(AdapterChoice::Software).expect("tests draw with the software adapter")
}

/// A program of this workspace, built beside the tests.
///
/// # Panics
/// When it was not.
pub fn program(name: &str) -> std::process::Command {
    let mut folder = std::env::current_exe().expect("a test is a file");
    folder.pop();
    if folder.ends_with("deps") {
        folder.pop();
    }
    let path = folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    assert!(path.exists(), "{} is missing: run `cargo build --workspace` first", path.display());
    std::process::Command::new(path)
}

/// Builds a file, with the options changed by `change`.
///
/// # Panics
/// When the build fails.
pub fn built(input: &Path, output: &Path, change: impl FnOnce(&mut BuildOptions)) -> BuildReport {
    let mut options = BuildOptions::default();
    change(&mut options);
    build(&[input.to_owned()], output, &options, &Silent).expect("the build succeeds")
}

/// A closed ball of radius 1 with gentle bumps, about `2 · n²` triangles, as an ASCII PLY.
pub fn bumpy_ball(n: u32) -> String {
    ball(n, 0.02)
}

/// The same with bumps so high; 0 for a smooth ball.
pub fn ball(n: u32, bumps: f64) -> String {
    let mut vertices = vec![[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]];
    let ring = |i: u32, j: u32| 2 + (i - 1) * n + j % n;
    for i in 1..n {
        for j in 0..n {
            let theta = std::f64::consts::PI * f64::from(i) / f64::from(n);
            let phi = std::f64::consts::TAU * f64::from(j) / f64::from(n);
            let r = 1.0 + bumps * (9.0 * phi).sin() * (7.0 * theta).sin();
            vertices.push([
                r * theta.sin() * phi.sin(),
                r * theta.cos(),
                r * theta.sin() * phi.cos(),
            ]);
        }
    }
    let mut faces = Vec::new();
    for j in 0..n {
        faces.push([0, ring(1, j), ring(1, j + 1)]);
        faces.push([1, ring(n - 1, j + 1), ring(n - 1, j)]);
        for i in 1..n - 1 {
            let (a, b) = (ring(i, j), ring(i, j + 1));
            let (c, d) = (ring(i + 1, j), ring(i + 1, j + 1));
            faces.push([a, c, b]);
            faces.push([b, c, d]);
        }
    }
    ply(&vertices, &faces)
}

/// A mesh as an ASCII PLY.
pub fn ply(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> String {
    let mut out = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        faces.len()
    );
    for [x, y, z] in vertices {
        out += &format!("{x:.7} {y:.7} {z:.7}\n");
    }
    for [a, b, c] in faces {
        out += &format!("3 {a} {b} {c}\n");
    }
    out
}
