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

/// Lines whose condition is known for a whole draw: see `Frame` in `shared.wgsl`.
fn uniform_branches(source: &str) -> Vec<&str> {
    let signs = ["if frame.", "if all(frame.", "&& frame.", "|| frame.", "if perspective()"];
    source.lines().filter(|line| signs.iter().any(|sign| line.contains(sign))).collect()
}

#[test]
fn shaders_do_not_branch_on_what_is_the_same_for_a_whole_draw() {
    assert_eq!(
        uniform_branches("  if frame.shadow.x > 0.5 {\n  if a & (frame.size.x > 1u) {").len(),
        1
    );
    for entry in std::fs::read_dir(workspace().join("shaders/src")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "wgsl") {
            let source = std::fs::read_to_string(&path).unwrap();
            assert_eq!(uniform_branches(&source), [""; 0], "in {}", path.display());
        }
    }
}
