//! Finding Vulkan drivers without Vulkan.
//!
//! A driver makes itself known by a JSON manifest. Where they lie: Khronos Group,
//! *Architecture of the Vulkan Loader Interfaces*, "Driver Discovery on Linux".

use std::path::{Path, PathBuf};

use super::Machine;

/// Whether pictures can be drawn: by a GPU's driver with a GPU, or by a software driver.
pub fn has_driver(machine: &Machine) -> bool {
    let manifests = manifests(machine);
    manifests.iter().any(|manifest| is_software(manifest) || machine.has_gpu())
}

/// Mesa's lavapipe, and SwiftShader.
fn is_software(manifest: &Path) -> bool {
    let name = manifest.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with("lvp_icd") || name.contains("swiftshader")
}

/// The manifests that the loader would read.
fn manifests(machine: &Machine) -> Vec<PathBuf> {
    // These variables take the place of all folders. They list manifests or folders of them.
    for variable in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        let listed = machine.folders(variable);
        if !listed.is_empty() {
            return listed.iter().flat_map(|path| manifests_at(machine, path)).collect();
        }
    }
    let folders = search_path(machine);
    folders.iter().flat_map(|folder| manifests_at(machine, &folder.join("vulkan/icd.d"))).collect()
}

/// Configuration, then data; of the user, then of the system.
fn search_path(machine: &Machine) -> Vec<PathBuf> {
    let folders = |variable: &str, usual: &[&str]| match machine.folders(variable) {
        none if none.is_empty() => usual.iter().map(PathBuf::from).collect(),
        folders => folders,
    };
    let home = machine.variable("HOME").map(PathBuf::from).unwrap_or_default();
    let mut path = vec![home.join(".config"), home.join(".local/share"), "/etc".into()];
    path.extend(folders("XDG_CONFIG_HOME", &[]));
    path.extend(folders("XDG_CONFIG_DIRS", &["/etc/xdg"]));
    path.extend(folders("XDG_DATA_HOME", &[]));
    path.extend(folders("XDG_DATA_DIRS", &["/usr/local/share", "/usr/share"]));
    path
}

fn manifests_at(machine: &Machine, path: &Path) -> Vec<PathBuf> {
    if machine.is_file(path) {
        return vec![path.to_owned()];
    }
    let names = machine.names(path).into_iter().filter(|name| name.ends_with(".json"));
    names.map(|name| path.join(name)).collect()
}

#[cfg(all(test, unix))]
mod tests {
    use super::super::machine::tests::Mock;
    use super::*;

    const LAVAPIPE: &str = "/usr/share/vulkan/icd.d/lvp_icd.x86_64.json";
    const INTEL: &str = "/usr/share/vulkan/icd.d/intel_icd.x86_64.json";
    const NVIDIA: &str = "/etc/vulkan/icd.d/nvidia_icd.json";
    const NVIDIA_DEVICE: &str = "/dev/nvidia0";
    const RENDER_DEVICE: &str = "/dev/dri/renderD128";

    fn driver(files: &[&str], variables: &[(&str, &str)]) -> bool {
        has_driver(&Mock::new(files, variables).0)
    }

    #[test]
    fn a_gpu_driver_counts_with_a_gpu() {
        assert!(driver(&[NVIDIA, NVIDIA_DEVICE], &[]));
        assert!(driver(&[INTEL, RENDER_DEVICE], &[]));
        assert!(!driver(&[INTEL, NVIDIA], &[]));
        assert!(!driver(&[NVIDIA_DEVICE, RENDER_DEVICE], &[]));
    }

    #[test]
    fn a_software_driver_counts_anywhere() {
        assert!(driver(&[LAVAPIPE], &[]));
        assert!(driver(&["/data/vulkan/icd.d/lvp_icd.json"], &[("XDG_DATA_DIRS", "/x:/data")]));
        assert!(driver(
            &["/home/a/.local/share/vulkan/icd.d/lvp_icd.json"],
            &[("HOME", "/home/a")]
        ));
        assert!(!driver(&["/usr/share/vulkan/icd.d/lvp_icd.json.old"], &[]));
    }

    #[test]
    fn named_drivers_hide_all_others() {
        let named = |path| [("VK_DRIVER_FILES", path)];
        assert!(!driver(&[LAVAPIPE], &named("/gone.json")));
        assert!(driver(&["/opt/lvp_icd.json"], &named("/gone.json:/opt/lvp_icd.json")));
        assert!(driver(&["/opt/lvp_icd.json"], &named("/opt")));
        assert!(driver(&[LAVAPIPE], &[("VK_DRIVER_FILES", ""), ("VK_ICD_FILENAMES", LAVAPIPE)]));
    }
}
