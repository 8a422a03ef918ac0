//! The folder in which a build keeps what it has done, so that it can go on after a stop.
//!
//! A step writes its files and then one line of the journal, with their lengths and checksums. A
//! step without a line has not been done, whatever files there are. The first line says what is
//! built from what: another build, or changed inputs, are refused.

use std::collections::{HashMap, HashSet};
use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use hlod_scan::{ColourSource, PlacedScan, Transform};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::BuildError;
use crate::kept::KeptScalar;
use crate::progress::Progress;

const JOURNAL: &str = "journal";
const LOCK: &str = "lock";

/// What the names of a build's files and folders begin with.
const OWN: [&str; 15] = [
    JOURNAL,
    LOCK,
    "vertices",
    "triangles",
    "ingest.json",
    "scalars",
    "soup",
    "placed",
    "sums",
    "survey",
    "plan.json",
    "scatter-join",
    "cell-",
    "nodes-",
    "pages-",
];

/// An input as it was when the build began.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct InputStamp {
    path: PathBuf,
    bytes: u64,
    modified_nanos: u128,
    transform: Option<Transform>,
}

impl InputStamp {
    pub(crate) fn of(scan: &PlacedScan) -> Result<InputStamp, BuildError> {
        let path = &scan.path;
        // Of what is no file, as a pipe, the reader says it best; nothing else may open it.
        let found = std::fs::metadata(path).and_then(|metadata| match metadata.is_file() {
            true => Ok(metadata),
            false => Err(std::io::ErrorKind::InvalidInput.into()),
        });
        let metadata = found.map_err(|error| match hlod_scan::ScanReader::open(path) {
            Err(said) => BuildError::Scan(said),
            Ok(_) => BuildError::io(path, "open")(error),
        })?;
        let modified = metadata.modified().map_err(BuildError::io(path, "open"))?;
        let since = modified.duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        let path = path.canonicalize().map_err(BuildError::io(path, "open"))?;
        let transform = scan.transform;
        Ok(InputStamp { path, bytes: metadata.len(), modified_nanos: since.as_nanos(), transform })
    }
}

/// What a build is: everything that its steps depend on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Identity {
    pub(crate) program: String,
    pub(crate) options: StepOptions,
    pub(crate) inputs: Vec<InputStamp>,
}

/// What steps depend on besides their files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct StepOptions {
    pub(crate) resolution: u32,
    pub(crate) leaf_triangles: u32,
    pub(crate) precision: Option<f64>,
    pub(crate) colour: ColourSource,
    pub(crate) normal_noise: f32,
    pub(crate) primitives: String,
    pub(crate) point_cost: f32,
    pub(crate) keep: Vec<KeptScalar>,
}

impl std::fmt::Display for StepOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let StepOptions {
            resolution,
            leaf_triangles,
            precision,
            colour,
            normal_noise,
            primitives,
            point_cost,
            keep,
        } = self;
        write!(f, "resolution {resolution}, leaf triangles {leaf_triangles}, colour {colour}, ")?;
        write!(
            f,
            "normal noise {normal_noise}, {primitives}, point cost {point_cost}, precision "
        )?;
        match precision {
            Some(step) => write!(f, "{step}"),
            None => f.write_str("found"),
        }?;
        keep.iter().try_for_each(|kept| write!(f, ", keep {kept}"))
    }
}

/// The program whose work folders these are.
pub(crate) const PROGRAM: &str = concat!("hlod-build ", env!("CARGO_PKG_VERSION"));

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Line {
    Done {
        step: String,
        files: Vec<FileStamp>,
    },
    /// These files were needed no more.
    Discarded {
        names: Vec<String>,
    },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct FileStamp {
    name: String,
    bytes: u64,
    crc32: u32,
}

/// An open work folder, locked against other builds.
pub(crate) struct WorkFolder {
    path: PathBuf,
    journal: std::sync::Mutex<OpenJournal>,
    /// Steps that are done.
    done: HashSet<String>,
    /// Files that were removed because nothing needed them.
    discarded: HashSet<String>,
    identity: Identity,
    /// How steps that are done have left their files.
    stamps: HashMap<String, FileStamp>,
    _lock: File,
}

impl WorkFolder {
    /// Starts a build in a folder that does not exist yet, or is empty.
    ///
    /// # Errors
    /// When the folder holds an unfinished build or anything else.
    pub(crate) fn start(path: &Path, identity: &Identity) -> Result<WorkFolder, BuildError> {
        std::fs::create_dir_all(path).map_err(BuildError::io(path, "create"))?;
        let mut names = std::fs::read_dir(path).map_err(BuildError::io(path, "read"))?;
        // What a build leaves that ended before its first line was written is nothing.
        let begun = has_begun(path);
        let foreign = names.any(|entry| {
            entry.is_ok_and(|e| e.file_name() != LOCK && (begun || e.file_name() != JOURNAL))
        });
        if foreign {
            return Err(BuildError::Usage(format!(
                "{}: holds an unfinished build or other files; give --resume to go on with it, or remove it",
                path.display()
            )));
        }
        let lock = lock(path, Lock::Alone)?;
        let journal = path.join(JOURNAL);
        let mut file = File::create(&journal).map_err(BuildError::io(&journal, "create"))?;
        if let Err(error) = append(&mut file, identity, &journal) {
            // The next build takes what cannot be removed for nothing.
            let _ = [&journal, &path.join(LOCK)].map(std::fs::remove_file);
            let _ = std::fs::remove_dir(path);
            return Err(error);
        }
        Ok(WorkFolder {
            path: path.to_owned(),
            journal: OpenJournal::of(file),
            done: HashSet::new(),
            discarded: HashSet::new(),
            stamps: HashMap::new(),
            identity: identity.clone(),
            _lock: lock,
        })
    }

    /// Goes on with a build; steps whose files are not as they were written count as not done.
    ///
    /// # Errors
    /// When there is no build, or it is of other inputs or with other options.
    pub(crate) fn resume(
        path: &Path,
        identity: &Identity,
        remark: &mut dyn FnMut(String),
    ) -> Result<WorkFolder, BuildError> {
        let journal = path.join(JOURNAL);
        if !has_begun(path) {
            return Err(BuildError::Usage(format!(
                "{}: holds no unfinished build; leave --resume away to start one",
                path.display()
            )));
        }
        let lock = lock(path, Lock::Alone)?;
        let Journal { identity: before, whole, mut done, discarded } = Journal::read(path, remark)?;
        before.check(identity, path)?;
        done.retain(|_, files| {
            let needed = files.iter().filter(|stamp| !discarded.contains(&stamp.name));
            let wrong = needed.clone().find(|stamp| !stamp.holds(path));
            if let Some(wrong) = wrong {
                remark(format!("{} is not as it was written: it is made again", wrong.name));
            }
            wrong.is_none()
        });
        let file = File::options().append(true).open(&journal);
        let mut file = file.map_err(BuildError::io(&journal, "open"))?;
        file.set_len(whole as u64).map_err(BuildError::io(&journal, "write"))?;
        file.flush().map_err(BuildError::io(&journal, "write"))?;
        let stamps = done.values().flatten().map(|s| (s.name.clone(), s.clone())).collect();
        Ok(WorkFolder {
            path: path.to_owned(),
            journal: OpenJournal::of(file),
            done: done.into_keys().collect(),
            discarded,
            identity: before,
            stamps,
            _lock: lock,
        })
    }

    /// Opens the folder of a build to do some of its steps, beside others that do the same. What is
    /// in the folder is not looked at: [`WorkFolder::holds`] does that.
    ///
    /// # Errors
    /// When there is no build, or one goes on in the folder.
    pub(crate) fn attend(path: &Path) -> Result<WorkFolder, BuildError> {
        let lock = lock(path, Lock::Shared)?;
        let Journal { identity: before, done, discarded, .. } = Journal::read(path, &mut |_| ())?;
        let journal = path.join(JOURNAL);
        let file = File::options().append(true).open(&journal);
        let stamps = done.values().flatten().map(|s| (s.name.clone(), s.clone())).collect();
        Ok(WorkFolder {
            path: path.to_owned(),
            journal: OpenJournal::of(file.map_err(BuildError::io(&journal, "open"))?),
            done: done.into_keys().collect(),
            discarded,
            identity: before,
            stamps,
            _lock: lock,
        })
    }

    /// Whether a file is as a step has written it.
    pub(crate) fn holds(&self, name: &str) -> bool {
        self.stamps.get(name).is_some_and(|stamp| stamp.holds(&self.path))
    }

    /// Forgets that a step was done.
    pub(crate) fn forget(&mut self, step: &str) {
        self.done.remove(step);
    }

    /// That the inputs are still what they were when the build began: what was read of a file that is
    /// being written is of no moment.
    ///
    /// # Errors
    /// When one is another, or gone.
    pub(crate) fn check_inputs(&self, scans: &[PlacedScan]) -> Result<(), BuildError> {
        for (scan, before) in scans.iter().zip(&self.identity.inputs) {
            if InputStamp::of(scan)? != *before {
                return Err(BuildError::InputChanged(scan.path.clone()));
            }
        }
        Ok(())
    }

    /// What is built from what.
    pub(crate) fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The path of a file in the folder.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Whether any step has been done, in this run or before.
    pub(crate) fn has_steps(&self) -> bool {
        let journal = self.journal.lock().unwrap_or_else(|e| e.into_inner());
        let header = serde_json::to_vec(&self.identity).map_or(0, |text| text.len() as u64 + 1);
        journal.file.metadata().is_ok_and(|m| m.len() > header)
    }

    pub(crate) fn is_done(&self, step: &str) -> bool {
        self.done.contains(step)
    }

    /// # Errors
    /// When the user wants the build to stop.
    pub(crate) fn check_stop(&self, progress: &dyn Progress) -> Result<(), BuildError> {
        if progress.is_stopped() { Err(BuildError::Stopped(self.path.clone())) } else { Ok(()) }
    }

    pub(crate) fn is_discarded(&self, name: &str) -> bool {
        self.discarded.contains(name)
    }

    /// Forgets all steps.
    pub(crate) fn begin_again(&mut self) -> Result<(), BuildError> {
        let path = self.file(JOURNAL);
        let mut file = File::create(&path).map_err(BuildError::io(&path, "create"))?;
        append(&mut file, &self.identity, &path)?;
        self.journal = OpenJournal::of(file);
        self.done.clear();
        self.discarded.clear();
        Ok(())
    }

    /// Does a step unless it is done: `work` writes the files named.
    pub(crate) fn step(
        &self,
        step: &str,
        files: &[&str],
        work: impl FnOnce() -> Result<(), BuildError>,
    ) -> Result<(), BuildError> {
        if self.is_done(step) {
            return Ok(());
        }
        work()?;
        self.finish_step(step, files)
    }

    /// Writes down that a step is done. Its files are on disk before the journal says so.
    pub(crate) fn finish_step(&self, step: &str, files: &[&str]) -> Result<(), BuildError> {
        let files = files.par_iter().map(|name| FileStamp::of(&self.path, name));
        let line = Line::Done { step: step.to_owned(), files: files.collect::<Result<_, _>>()? };
        let mut journal = self.journal.lock().unwrap_or_else(|e| e.into_inner());
        journal.append(&line, &self.path.join(JOURNAL))
    }

    /// Removes files that no step needs any more.
    pub(crate) fn discard(&self, names: &[&str]) -> Result<(), BuildError> {
        let line = Line::Discarded { names: names.iter().map(|n| (*n).to_owned()).collect() };
        let mut journal = self.journal.lock().unwrap_or_else(|e| e.into_inner());
        journal.append(&line, &self.path.join(JOURNAL))?;
        for name in names {
            let path = self.file(name);
            match std::fs::remove_file(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    return Err(BuildError::io(&path, "remove")(error));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Removes what builds write here, and the folder unless something else is in it.
    pub(crate) fn remove(self) -> Result<(), BuildError> {
        let entries = std::fs::read_dir(&self.path).map_err(BuildError::io(&self.path, "read"))?;
        for entry in entries {
            let entry = entry.map_err(BuildError::io(&self.path, "read"))?;
            let path = entry.path();
            if OWN.iter().any(|own| entry.file_name().to_string_lossy().starts_with(own)) {
                let removed = match path.is_dir() {
                    true => std::fs::remove_dir_all(&path),
                    false => std::fs::remove_file(&path),
                };
                removed.map_err(BuildError::io(&path, "remove"))?;
            }
        }
        match std::fs::remove_dir(&self.path) {
            Err(error) if error.kind() != std::io::ErrorKind::DirectoryNotEmpty => {
                Err(BuildError::io(&self.path, "remove")(error))
            }
            _ => Ok(()),
        }
    }
}

impl Identity {
    fn check(&self, now: &Identity, path: &Path) -> Result<(), BuildError> {
        let refuse = |why: String| {
            Err(BuildError::Usage(format!(
                "{}: {why}; remove the folder to start again",
                path.display()
            )))
        };
        if self.program != now.program {
            return refuse(format!("was begun by {}, this is {}", self.program, now.program));
        }
        if self.options != now.options {
            return refuse(format!(
                "was begun with other options ({}, now {})",
                self.options, now.options
            ));
        }
        if self.inputs.len() != now.inputs.len() {
            return refuse("was begun with other inputs".into());
        }
        for (before, now) in self.inputs.iter().zip(&now.inputs) {
            if before != now {
                return refuse(format!("{} has changed since", now.path.display()));
            }
        }
        Ok(())
    }
}

impl FileStamp {
    fn of(folder: &Path, name: &str) -> Result<FileStamp, BuildError> {
        let path = folder.join(name);
        let file = File::open(&path).map_err(BuildError::io(&path, "open"))?;
        file.sync_all().map_err(BuildError::io(&path, "write"))?;
        let (bytes, crc32) = checksum(file).map_err(BuildError::io(&path, "read"))?;
        Ok(FileStamp { name: name.to_owned(), bytes, crc32 })
    }

    fn holds(&self, folder: &Path) -> bool {
        let Ok(file) = File::open(folder.join(&self.name)) else { return false };
        file.metadata().is_ok_and(|m| m.len() == self.bytes)
            && checksum(file).is_ok_and(|found| found == (self.bytes, self.crc32))
    }
}

fn checksum(mut file: File) -> std::io::Result<(u64, u32)> {
    let mut hasher = crc32fast::Hasher::new();
    let mut buffer = vec![0; 1 << 18];
    let mut bytes = 0;
    loop {
        let count = file.read(&mut buffer)?;
        if count == 0 {
            return Ok((bytes, hasher.finalize()));
        }
        hasher.update(&buffer[..count]);
        bytes += count as u64;
    }
}

/// Whether there is a journal with a line, which is written before anything else. One that cannot be read
/// counts as well, so that reading it again says why.
fn has_begun(folder: &Path) -> bool {
    match std::fs::read(folder.join(JOURNAL)) {
        Ok(text) => text.contains(&b'\n'),
        Err(error) => error.kind() != std::io::ErrorKind::NotFound,
    }
}

/// A journal that lines are added to.
struct OpenJournal {
    file: File,
    /// Why a line was not written whole. What followed would be part of it, and lost: so nothing follows.
    torn: Option<std::io::ErrorKind>,
}

impl OpenJournal {
    fn of(file: File) -> std::sync::Mutex<OpenJournal> {
        OpenJournal { file, torn: None }.into()
    }

    fn append(&mut self, line: &impl Serialize, path: &Path) -> Result<(), BuildError> {
        if let Some(kind) = self.torn {
            return Err(BuildError::io(path, "write")(kind.into()));
        }
        let added = append(&mut self.file, line, path);
        if let Err(BuildError::Io { source, .. }) = &added {
            self.torn = Some(source.kind());
        }
        added
    }
}

fn append(file: &mut File, line: &impl Serialize, path: &Path) -> Result<(), BuildError> {
    let mut text = serde_json::to_vec(line)
        .map_err(std::io::Error::from)
        .map_err(BuildError::io(path, "write"))?;
    text.push(b'\n');
    file.write_all(&text).and_then(|()| file.sync_data()).map_err(BuildError::io(path, "write"))
}

/// What a journal says.
struct Journal {
    identity: Identity,
    /// Its length in bytes without a line that a stop cut short.
    whole: usize,
    /// The steps that are done, and their files.
    done: HashMap<String, Vec<FileStamp>>,
    discarded: HashSet<String>,
}

impl Journal {
    fn read(folder: &Path, remark: &mut dyn FnMut(String)) -> Result<Journal, BuildError> {
        let path = folder.join(JOURNAL);
        let text = std::fs::read(&path).map_err(BuildError::io(&path, "read"))?;
        let whole = text.iter().rposition(|&b| b == b'\n').map_or(0, |end| end + 1);
        let mut lines = text[..whole].split_inclusive(|&b| b == b'\n');
        let identity: Option<Identity> =
            lines.next().and_then(|line| serde_json::from_slice(line).ok());
        let Some(identity) = identity else {
            return Err(BuildError::Usage(format!(
                "{}: is not the journal of a build; remove the folder and start again",
                path.display()
            )));
        };
        let mut done: HashMap<String, Vec<FileStamp>> = HashMap::new();
        let mut discarded = HashSet::new();
        for line in lines {
            match serde_json::from_slice(line) {
                Ok(Line::Done { step, files }) => drop(done.insert(step, files)),
                Ok(Line::Discarded { names }) => discarded.extend(names),
                Err(_) => remark("a line of the journal cannot be read".into()),
            }
        }
        Ok(Journal { identity, whole, done, discarded })
    }
}

/// Whether others may work in the folder at the same time.
enum Lock {
    Alone,
    Shared,
}

/// Held as long as the file is open; the system lets go of it when the process ends, however it
/// does.
fn lock(folder: &Path, kind: Lock) -> Result<File, BuildError> {
    let path = folder.join(LOCK);
    let file = File::create(&path).map_err(BuildError::io(&path, "create"))?;
    let locked = match kind {
        Lock::Alone => file.try_lock(),
        Lock::Shared => file.try_lock_shared(),
    };
    match locked {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(BuildError::Usage(format!(
            "{}: another build works in this folder; wait for it, or give --work-dir another",
            folder.display()
        ))),
        Err(TryLockError::Error(error)) => Err(BuildError::io(&path, "lock")(error)),
    }
}
