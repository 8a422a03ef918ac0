//! Documents and recorded paths say the truth.

use hlod_render::path::CameraPath;
use hlod_tests::workspace;

#[test]
fn every_path_in_the_architecture_page_exists() {
    let text = std::fs::read_to_string(workspace().join("ARCHITECTURE.md")).unwrap();
    let mut checked = 0;
    for quoted in text.split('`').skip(1).step_by(2) {
        let is_path = quoted.contains('/') && !quoted.contains([' ', '*', '<', '$', '÷']);
        if is_path {
            assert!(workspace().join(quoted).exists(), "ARCHITECTURE.md names {quoted}");
            checked += 1;
        }
    }
    assert!(checked > 10, "only {checked} paths found");
}

#[test]
fn every_recorded_path_is_valid() {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(workspace().join("bench-paths")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "json") {
            names.push(CameraPath::load(&path).unwrap().name);
        }
    }
    names.sort();
    assert_eq!(names, ["approach", "orbit", "sweep"]);
}

#[test]
fn shader_structures_are_as_large_as_those_of_rust() {
    // `Frame` in shared.wgsl: three matrices, sixteen vectors of floats, three of integers.
    assert_eq!(size_of::<hlod_render::passes::FrameUniform>(), 3 * 64 + 16 * 16 + 3 * 16);
    assert_eq!(size_of::<hlod_render::loader::GpuVertex>(), 16);
}

/// Files that may name what one system alone has: one a crate.
const SYSTEMS: [&str; 3] =
    ["compress/src/pread.rs", "hlod-build/src/system.rs", "hlod-render/src/system.rs"];

/// Whether a source names what one system alone has.
fn names_a_system(source: &str) -> bool {
    ["std::os::", "rustix::", "libc::", "target_os"].iter().any(|name| source.contains(name))
}

#[test]
fn what_systems_do_in_their_own_ways_is_in_one_file_a_crate() {
    let mut found = Vec::new();
    let mut pending: Vec<_> =
        ["compress/src", "hlod-build/src", "hlod-build/scan/src", "hlod-render/src", "shaders/src"]
            .map(|folder| workspace().join(folder))
            .into();
    let mut checked = 0;
    while let Some(path) = pending.pop() {
        if path.is_dir() {
            pending.extend(std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        } else if path.extension().is_some_and(|e| e == "rs") {
            checked += 1;
            if names_a_system(&std::fs::read_to_string(&path).unwrap()) {
                found.push(path.strip_prefix(workspace()).unwrap().display().to_string());
            }
        }
    }
    found.sort();
    assert_eq!(found, SYSTEMS, "of {checked} files");
    assert!(checked > 150 && !names_a_system("use std::fs::File;"));
}
