//! The machine as far as it is looked at: its files and the environment.

use std::collections::BTreeMap;
use std::env::{self, consts::ARCH};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

pub struct Machine {
    /// `/`, or a folder that plays its part in a test.
    root: PathBuf,
    variables: BTreeMap<OsString, OsString>,
}

impl Machine {
    /// The machine that we run on.
    pub fn this() -> Machine {
        Machine { root: "/".into(), variables: env::vars_os().collect() }
    }

    /// Whether a window can be opened. Windows and macOS have a display that they do not
    /// tell of in the environment.
    pub fn has_display(&self) -> bool {
        cfg!(any(windows, target_os = "macos"))
            || ["WAYLAND_DISPLAY", "DISPLAY"].iter().any(|name| self.variable(name).is_some())
    }

    /// Whether there is a device that a GPU's driver could drive. A driver's files alone do
    /// not tell: distributions install those of all makers.
    pub fn has_gpu(&self) -> bool {
        let devices = |folder: &str, prefix: &str| {
            let names = self.names(Path::new(folder));
            names.iter().any(|name| {
                let unit = name.strip_prefix(prefix);
                unit.is_some_and(|unit| unit.starts_with(|c: char| c.is_ascii_digit()))
            })
        };
        // Those of most drivers; NVIDIA's own; Windows' under WSL.
        devices("/dev/dri", "renderD") || devices("/dev", "nvidia") || self.is_file("/dev/dxg")
    }

    /// Whether the dynamic linker would find this library.
    pub fn has_library(&self, name: &str) -> bool {
        let mut folders = self.folders("LD_LIBRARY_PATH");
        for folder in ["/usr/local/lib", "/usr/lib", "/lib"] {
            let folder = Path::new(folder);
            folders.push(folder.to_owned());
            folders.push(folder.with_file_name("lib64"));
            // Debian keeps each architecture's libraries apart: lib/x86_64-linux-gnu.
            let of_our_architecture = |name: &String| name.starts_with(&format!("{ARCH}-linux-"));
            let names = self.names(folder).into_iter().filter(of_our_architecture);
            folders.extend(names.map(|name| folder.join(name)));
        }
        folders.iter().any(|folder| self.is_file(folder.join(name)))
    }

    pub fn has_program(&self, name: &str) -> bool {
        self.folders("PATH").iter().any(|folder| self.is_file(folder.join(name)))
    }

    /// A variable that is set and not empty.
    pub fn variable(&self, name: &str) -> Option<&OsString> {
        self.variables.get(&OsString::from(name)).filter(|value| !value.is_empty())
    }

    /// The paths in a variable such as `PATH`; none where it is not set.
    pub fn folders(&self, variable: &str) -> Vec<PathBuf> {
        self.variable(variable).map(|value| env::split_paths(value).collect()).unwrap_or_default()
    }

    /// The names in a folder; none where it cannot be read.
    pub fn names(&self, folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(self.place(folder)).into_iter().flatten().flatten();
        entries.filter_map(|entry| entry.file_name().into_string().ok()).collect()
    }

    /// Whether something other than a folder lies there, a link followed.
    pub fn is_file(&self, path: impl AsRef<Path>) -> bool {
        fs::metadata(self.place(path.as_ref())).is_ok_and(|metadata| !metadata.is_dir())
    }

    fn place(&self, path: &Path) -> PathBuf {
        self.root.join(path.strip_prefix("/").unwrap_or(path))
    }
}

#[cfg(all(test, unix))]
pub mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    /// A machine of empty files in a temporary folder.
    pub struct Mock(pub Machine);

    impl Mock {
        pub fn new(files: &[&str], variables: &[(&str, &str)]) -> Mock {
            static COUNT: AtomicU32 = AtomicU32::new(0);
            let count = COUNT.fetch_add(1, Ordering::Relaxed);
            let root = env::temp_dir().join(format!("xtask-{}-{count}", std::process::id()));
            fs::create_dir(&root).unwrap();
            let variables = variables.iter().map(|(name, value)| (name.into(), value.into()));
            let machine = Machine { root, variables: variables.collect() };
            for file in files {
                let place = machine.place(Path::new(file));
                fs::create_dir_all(place.parent().unwrap()).unwrap();
                fs::write(place, "").unwrap();
            }
            Mock(machine)
        }
    }

    impl Drop for Mock {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0.root);
        }
    }

    #[test]
    fn libraries_where_distributions_keep_them() {
        for folder in ["usr/lib", "lib64", &format!("usr/lib/{ARCH}-linux-gnu"), "opt/lib"] {
            let library = format!("/{folder}/libX11.so.6");
            let mock = Mock::new(&[&library], &[("LD_LIBRARY_PATH", "/usr/x:/opt/lib")]);
            assert!(mock.0.has_library("libX11.so.6"), "{library}");
            assert!(!mock.0.has_library("libXi.so.6"));
        }
        let other = Mock::new(&["/usr/lib/vax-linux-gnu/libX11.so.6"], &[]);
        assert!(!other.0.has_library("libX11.so.6"));
    }

    #[test]
    fn programs_in_the_path_only() {
        let mock = Mock::new(&["/usr/bin/Xvfb", "/opt/import"], &[("PATH", "/bin:/usr/bin")]);
        assert!(mock.0.has_program("Xvfb"));
        assert!(!mock.0.has_program("import"));
    }

    #[test]
    fn gpus_by_their_devices() {
        let has_gpu = |file| Mock::new(&[file], &[]).0.has_gpu();
        assert!(has_gpu("/dev/dri/renderD128"));
        assert!(has_gpu("/dev/nvidia0"));
        assert!(has_gpu("/dev/dxg"));
        // A display without a renderer, and a driver's switchboard without a card.
        assert!(!has_gpu("/dev/dri/card0"));
        assert!(!has_gpu("/dev/nvidiactl"));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn displays_by_the_environment() {
        let has_display = |variables| Mock::new(&[], variables).0.has_display();
        assert!(has_display(&[("DISPLAY", ":0")]));
        assert!(has_display(&[("WAYLAND_DISPLAY", "wayland-0")]));
        assert!(!has_display(&[("DISPLAY", "")]));
    }
}
