//! How statues come into the window: by a dialog, a drop, a name typed, or one opened before; and how a
//! scan becomes a file that can be shown.
//!
//! ```text
//! page      what a window without a statue shows; dialogs over either
//!   │ builder   the program that builds, its progress and its end
//!   ▼ Entry     what is wanted: the window opens it
//! ```

mod builder;
pub mod page;

use std::path::{Path, PathBuf};
use std::sync::{Arc, mpsc};

use self::builder::{Build, Order, Outcome};
use crate::source::is_address;

/// Extensions of what can be built, as dialogs filter by them.
const SCANS: [&str; 9] = ["ply", "obj", "stl", "glb", "gltf", "las", "laz", "e57", "mlp"];

/// What a file is to this program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// An `.hlod` file.
    Statue,
    /// Something that may become one.
    Scan,
}

/// What is being opened or built.
pub struct Entry {
    /// A dialog of the system, and where its answer comes.
    chooser: Option<mpsc::Receiver<Option<PathBuf>>>,
    /// A scan that may be built, if the person wants it.
    offered: Option<Order>,
    build: Option<Build>,
    /// What a build that has ended left behind: a file, and how it is told.
    built: Option<PathBuf>,
    /// To be opened at the next opportunity.
    wanted: Option<PathBuf>,
    typed: String,
    problem: Option<String>,
    is_hovered: bool,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Entry {
    /// `wake` is called when a dialog or a build has something to say.
    pub fn new(wake: impl Fn() + Send + Sync + 'static) -> Entry {
        Entry {
            chooser: None,
            offered: None,
            build: None,
            built: None,
            wanted: None,
            typed: String::new(),
            problem: None,
            is_hovered: false,
            wake: Arc::new(wake),
        }
    }

    /// A file or an address was dropped, chosen or typed: a statue is opened, a scan offered to be built.
    pub fn take(&mut self, path: PathBuf) {
        self.problem = None;
        match kind_of(&path) {
            Ok(Kind::Statue) => self.wanted = Some(path),
            Ok(Kind::Scan) if self.build.is_some() => {
                self.problem = Some("one scan is built at a time: wait or stop it".into());
            }
            Ok(Kind::Scan) => self.offered = Some(Order::new(path)),
            Err(error) => self.problem = Some(format!("{}: {error}", path.display())),
        }
    }

    /// A file is being dragged over the window, or no longer.
    pub fn hover(&mut self, is_hovered: bool) {
        self.is_hovered = is_hovered;
    }

    /// Something could not be opened.
    pub fn report(&mut self, problem: String) {
        self.problem = Some(problem);
    }

    /// Shows the system's dialog. It does not hold up the window.
    pub fn choose(&mut self, window: &winit::window::Window) {
        if self.chooser.is_some() {
            return;
        }
        let mut all = vec!["hlod"];
        all.extend(SCANS);
        let dialog = rfd::AsyncFileDialog::new()
            .set_title("Open a statue, or a scan to be built")
            .add_filter("Statues and scans", &all)
            .add_filter("Statues", &["hlod"])
            .add_filter("Scans", &SCANS)
            .add_filter("All files", &["*"])
            .set_parent(window)
            .pick_file();
        let (answer, chooser) = mpsc::channel();
        let wake = self.wake.clone();
        std::thread::spawn(move || {
            let chosen = pollster::block_on(dialog).map(|file| file.path().to_owned());
            // The window has been closed: nobody needs to know.
            let _ = answer.send(chosen);
            wake();
        });
        self.chooser = Some(chooser);
    }

    /// Takes in what has happened since, and hands out what is to be opened. `is_empty`: nothing is shown
    /// yet, and what was built is opened as soon as it is there.
    pub fn advance(&mut self, is_empty: bool) -> Option<PathBuf> {
        if let Some(chooser) = &self.chooser {
            match chooser.try_recv() {
                Err(mpsc::TryRecvError::Empty) => {}
                answer => {
                    self.chooser = None;
                    if let Ok(Some(path)) = answer {
                        self.take(path);
                    }
                }
            }
        }
        if let Some(outcome) = self.build.as_mut().and_then(Build::advance) {
            self.build = None;
            match outcome {
                Outcome::Built(file) if is_empty => self.wanted = Some(file),
                Outcome::Built(file) => self.built = Some(file),
                Outcome::Stopped => {}
                Outcome::Failed(why) => self.problem = Some(why),
            }
        }
        self.wanted.take()
    }

    fn start(&mut self, order: Order) {
        match Build::start(order, builder::builder(), self.wake.clone()) {
            Ok(build) => self.build = Some(build),
            Err(error) => self.problem = Some(error.to_string()),
        }
    }
}

/// By its first bytes; what is no statue may be a scan, which the program that builds knows better.
fn kind_of(path: &Path) -> std::io::Result<Kind> {
    use std::io::Read;
    if is_address(path) {
        return Ok(Kind::Statue);
    }
    if path.is_dir() {
        return Err(std::io::Error::other("this is a folder"));
    }
    let mut start = Vec::new();
    std::fs::File::open(path)?.take(8).read_to_end(&mut start)?;
    let named = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("hlod"));
    // A damaged statue is told as such, not offered to be built.
    Ok(if named || start.starts_with(b"HLOD") { Kind::Statue } else { Kind::Scan })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statues_are_opened_and_scans_offered() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let mut entry = Entry::new(|| {});
        for (path, opens) in [
            (write("a.hlod", b"damaged"), true),
            (write("b", b"HLOD\r\n\x1a\n..."), true),
            ("https://example.org/c".into(), true),
            (write("d.ply", b"ply\n"), false),
        ] {
            entry.take(path.clone());
            assert_eq!(entry.advance(true), opens.then(|| path.clone()), "{}", path.display());
            assert_eq!(entry.offered.take().is_some(), !opens);
            assert_eq!(entry.problem, None);
        }
        for path in [folder.path().to_owned(), folder.path().join("nothing.ply")] {
            entry.take(path);
            assert!(entry.problem.take().is_some() && entry.advance(true).is_none());
        }
    }
}
