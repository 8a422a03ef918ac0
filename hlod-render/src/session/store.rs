//! Where sessions are kept, and keeping them without losing anything.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use super::Session;
use crate::error::RenderError;
use crate::files::write_aside;
use crate::source::is_address;
use crate::system::{data_home, folder_in};

/// Larger files are no sessions.
const FILE_BYTES_MAX: u64 = 1 << 30;
/// A change is in the file after no more than this, and the time that writing takes.
const SAVE_WITHIN: Duration = Duration::from_secs(3);

/// Reads and checks a session.
///
/// # Errors
/// When the file cannot be read or is no session of this version.
pub fn load(path: &Path) -> Result<Session, RenderError> {
    let malformed = |why: String| RenderError::Malformed { path: path.to_owned(), why };
    let file = std::fs::File::open(path).map_err(RenderError::io(path, "open"))?;
    let mut bytes = Vec::new();
    file.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes).map_err(RenderError::io(path, "read"))?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(malformed("more than 1 GiB is no session".into()));
    }
    let session: Session = serde_json::from_slice(&bytes)
        .map_err(|e| malformed(format!("not a session of version {}: {e}", super::VERSION)))?;
    session.validate().map_err(malformed)?;
    Ok(session)
}

/// Writes a session aside, and renames it when it is on the disk.
///
/// # Errors
/// When it cannot be written; what was there before then still is.
pub fn save(session: &Session, path: &Path) -> Result<(), RenderError> {
    write_aside(path, |out| {
        let failed = RenderError::io(path, "save the session");
        serde_json::to_writer_pretty(&mut *out, session)
            .map_err(std::io::Error::from)
            .and_then(|()| out.write_all(b"\n"))
            .map_err(failed)
    })
}

/// Where a session of a file is kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionFile {
    /// The session's file.
    pub path: PathBuf,
    /// Whether it is there.
    pub exists: bool,
}

/// Where the session of a file is kept: beside it as `NAME.hlod.session.json`; of a file on a server,
/// or in a folder where nothing can be written, in the user's data folder.
///
/// # Errors
/// When there is no place for it.
pub fn place_of(model: &Path) -> Result<SessionFile, RenderError> {
    let mut name = model.file_name().unwrap_or(model.as_os_str()).to_owned();
    name.push(".session.json");
    if !is_address(model) {
        let beside = model.with_file_name(&name);
        let folder = beside.parent().filter(|p| !p.as_os_str().is_empty());
        if can_write(&beside, folder.unwrap_or(Path::new("."))) {
            return Ok(SessionFile { exists: beside.exists(), path: beside });
        }
    }
    let folder = sessions_folder().ok_or_else(|| {
        RenderError::Usage("no folder for sessions: set HLOD_DATA_DIR, or HOME".into())
    })?;
    std::fs::create_dir_all(&folder).map_err(RenderError::io(&folder, "create"))?;
    // Files of the same name in different folders have different sessions.
    let whole = std::path::absolute(model).unwrap_or_else(|_| model.to_owned());
    let whole = if is_address(model) { model.to_owned() } else { whole };
    let number = crc32fast::hash(whole.as_os_str().as_encoded_bytes());
    let path = folder.join(format!("{number:08x}-{}", name.to_string_lossy()));
    Ok(SessionFile { exists: path.exists(), path })
}

/// A name beside a file that none has: `NAME.2.json` and so on.
pub fn free_beside(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let names = (2..u32::MAX).map(|n| path.with_file_name(format!("{stem}.{n}.json")));
    names.into_iter().find(|name| !name.exists()).unwrap_or_else(|| path.to_owned())
}

/// Whether a file in a folder could be written: asked by doing it, under a name of its own.
fn can_write(file: &Path, folder: &Path) -> bool {
    let is_read_only = |p: &Path| p.metadata().is_ok_and(|m| m.permissions().readonly());
    !is_read_only(file) && tempfile_in(folder).is_ok()
}

fn tempfile_in(folder: &Path) -> std::io::Result<()> {
    let probe = folder.join(format!(".hlod-session-{}", std::process::id()));
    std::fs::OpenOptions::new().write(true).create_new(true).open(&probe)?;
    std::fs::remove_file(&probe)
}

/// `HLOD_DATA_DIR`, or `hlod` in the user's data folder.
pub fn user_folder() -> Option<PathBuf> {
    if let Some(chosen) = folder_in("HLOD_DATA_DIR") {
        return Some(chosen);
    }
    data_home().map(|folder| folder.join("hlod"))
}

/// Where sessions are kept that cannot be beside their files.
fn sessions_folder() -> Option<PathBuf> {
    // A folder that was chosen for sessions has them in itself.
    let chosen = std::env::var_os("HLOD_DATA_DIR").is_some_and(|v| !v.is_empty());
    user_folder().map(|folder| if chosen { folder } else { folder.join("sessions") })
}

/// What a session's file held when this program read or wrote it last: its checksum and length, none where there was no
/// file. Another program, or another window, may have written it since.
fn held(path: &Path) -> Option<(u32, u64)> {
    let bytes = std::fs::read(path).ok()?;
    Some((crc32fast::hash(&bytes), bytes.len() as u64))
}

/// Where a session was saved, and what is worth knowing of that.
struct Saved {
    path: PathBuf,
    remark: Option<RenderError>,
}

/// Writes a session, unless someone else has written its file since: then theirs stays, and ours has another name.
fn save_ours(
    session: &Session,
    path: &Path,
    known: &mut Option<(u32, u64)>,
) -> Result<Saved, RenderError> {
    let now = held(path);
    let is_theirs = now.is_some() && now != *known;
    let to = if is_theirs { free_beside(path) } else { path.to_owned() };
    save(session, &to)?;
    *known = held(&to);
    let remark = is_theirs.then(|| {
        RenderError::Usage(format!(
            "{} was written by another window or program: it stays as it is, and what is done here is kept in {}",
            path.display(),
            to.display()
        ))
    });
    Ok(Saved { path: to, remark })
}

/// Saves sessions on a thread of its own, so that no frame waits for a disk.
pub struct Saver {
    path: PathBuf,
    jobs: Option<mpsc::Sender<Session>>,
    results: mpsc::Receiver<Result<Saved, RenderError>>,
    thread: Option<std::thread::JoinHandle<()>>,
    changed: Option<Instant>,
    saved: Session,
}

impl Saver {
    /// Keeps `saved`, which is what the file holds or an untouched session, in `path`.
    pub fn new(path: PathBuf, saved: Session) -> Saver {
        let (jobs, received) = mpsc::channel::<Session>();
        let (done, results) = mpsc::channel();
        let mut to = path.clone();
        let mut known = held(&path);
        let thread = std::thread::spawn(move || {
            while let Ok(mut session) = received.recv() {
                // Only the latest counts.
                while let Ok(later) = received.try_recv() {
                    session = later;
                }
                let saved = save_ours(&session, &to, &mut known);
                if let Ok(saved) = &saved {
                    to.clone_from(&saved.path);
                }
                if done.send(saved).is_err() {
                    break;
                }
            }
        });
        Saver { path, jobs: Some(jobs), results, thread: Some(thread), changed: None, saved }
    }

    /// Where it is kept.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The session is now this; saves it when it has been another for a while. Returns what went
    /// wrong with saving before, and tries again after the next change; also that its file is another now.
    pub fn note(&mut self, session: &Session, now: Instant) -> Option<RenderError> {
        if *session != self.saved {
            let since = *self.changed.get_or_insert(now);
            if now.duration_since(since) >= SAVE_WITHIN {
                self.hand_over(session);
            }
        } else {
            self.changed = None;
        }
        while let Ok(result) = self.results.try_recv() {
            let saved = match result {
                Ok(saved) => saved,
                Err(error) => return Some(error),
            };
            self.path = saved.path;
            if saved.remark.is_some() {
                return saved.remark;
            }
        }
        None
    }

    /// When [`Saver::note`] must be called again at the latest.
    pub fn due(&self) -> Option<Instant> {
        self.changed.map(|since| since + SAVE_WITHIN)
    }

    /// Saves what has not been, and waits for it.
    ///
    /// # Errors
    /// When it cannot be written, or is in another file than before because someone else had written that one.
    pub fn finish(mut self, session: &Session) -> Result<(), RenderError> {
        if *session != self.saved {
            self.hand_over(session);
        }
        drop(self.jobs.take());
        if let Some(thread) = self.thread.take() {
            // It does nothing that panics; the results tell what happened.
            let _ = thread.join();
        }
        std::iter::from_fn(|| self.results.try_recv().ok())
            .try_for_each(|result| result.and_then(|saved| saved.remark.map_or(Ok(()), Err)))
    }

    fn hand_over(&mut self, session: &Session) {
        if let Some(jobs) = &self.jobs {
            // The thread ends with this value only.
            let _ = jobs.send(session.clone());
        }
        self.saved = session.clone();
        self.changed = None;
    }
}
