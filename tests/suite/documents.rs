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
    // `Frame` in shared.wgsl: three matrices, fifteen vectors of floats, three of integers.
    assert_eq!(size_of::<hlod_render::passes::FrameUniform>(), 3 * 64 + 15 * 16 + 3 * 16);
    assert_eq!(size_of::<hlod_render::loader::GpuVertex>(), 16);
}
