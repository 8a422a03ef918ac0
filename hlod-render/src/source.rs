//! Where a file's bytes come from: a disk or a web server.
//!
//! Of a server nothing is asked but ranges of one file (RFC 9110, section 14), which any static web
//! server gives. What was read is kept in memory, and of servers on disk as well.

use std::collections::{BTreeMap, HashMap};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use hlod_compress::{BlockRef, FormatError, Header, HlodFile, Metadata, PageRef, SkeletonBlock};

use crate::error::RenderError;
use crate::system::cache_home;

mod disk_cache;
mod http;

use http::HttpFile;

/// Opens a file whose leaves are needed, all of them or some at once.
///
/// # Errors
/// When it is on a server, or cannot be used.
pub fn open_local(path: &Path) -> Result<HlodFile, RenderError> {
    if is_address(path) {
        let path = path.display();
        return Err(RenderError::Usage(format!("{path}: this needs the file itself: download it")));
    }
    HlodFile::open(path).map_err(RenderError::format(path))
}

/// A file that parts are read from, by any number of threads.
pub struct Source {
    bytes: Bytes,
    /// Of a server's file, the first bytes, which came with its header: the root's block, and mostly the root.
    front: Mutex<Vec<u8>>,
    kept: Mutex<Kept>,
}

/// Where a part is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Extent {
    /// What it is, for messages.
    pub(crate) what: &'static str,
    pub(crate) offset: u64,
    pub(crate) count: u32,
}

impl Extent {
    pub(crate) fn end(&self) -> u64 {
        self.offset.saturating_add(self.count.into())
    }
}

enum Bytes {
    Disk(Box<HlodFile>),
    Server(Box<HttpFile>),
}

/// Whether a path is the address of a file on a server.
pub fn is_address(path: &Path) -> bool {
    path.to_str().is_some_and(|p| p.starts_with("http://") || p.starts_with("https://"))
}

impl Source {
    /// Opens a file, or one on a server where the path is its address; keeps at most so many bytes of
    /// it in memory, and what a server sent in a folder, if there is one.
    ///
    /// # Errors
    /// When it cannot be read, is not an `.hlod` file, or the server gives no ranges.
    pub fn open(path: &Path, keep_bytes: u64, cache: Option<&Path>) -> Result<Source, RenderError> {
        let format = RenderError::format(path);
        let (bytes, front) = match path.to_str() {
            Some(address) if is_address(path) => {
                let (file, front) = HttpFile::open(address, cache).map_err(format)?;
                (Bytes::Server(Box::new(file)), front)
            }
            _ => (Bytes::Disk(Box::new(HlodFile::open(path).map_err(format)?)), Vec::new()),
        };
        Ok(Source { bytes, front: Mutex::new(front), kept: Mutex::new(Kept::new(keep_bytes)) })
    }

    /// So much of what may be kept is taken by what was made of the file otherwise.
    pub(crate) fn reserve(&self, bytes: u64) {
        if let Ok(mut kept) = self.kept.lock() {
            kept.reserve(bytes);
        }
    }

    /// The file's header.
    pub fn header(&self) -> &Header {
        match &self.bytes {
            Bytes::Disk(file) => file.header(),
            Bytes::Server(file) => file.header(),
        }
    }

    /// Whether it is on a server.
    pub(crate) fn is_remote(&self) -> bool {
        matches!(self.bytes, Bytes::Server(_))
    }

    /// How many reads should be under way: on a server they wait for each other's answers.
    pub fn readers(&self) -> usize {
        match self.bytes {
            Bytes::Disk(_) => 2,
            Bytes::Server(_) => 6,
        }
    }

    /// Reads bytes that must lie within the file; and how many had to be read for it, which are none
    /// where they were kept.
    ///
    /// # Errors
    /// When they do not, or reading fails.
    pub fn read(
        &self,
        what: &'static str,
        offset: u64,
        count: u32,
    ) -> Result<(Vec<u8>, u64), FormatError> {
        if let Some(bytes) = self.kept(offset, count) {
            return Ok((bytes, 0));
        }
        let bytes = self.read_range(what, offset, count)?;
        self.keep(offset, &bytes);
        Ok((bytes, u64::from(count)))
    }

    /// Reads parts that follow each other in the file, each as [`Source::read`] does, but what was not kept at once: of a
    /// server each read is a question.
    pub(crate) fn read_run(&self, run: &[Extent]) -> Vec<Result<(Vec<u8>, u64), FormatError>> {
        debug_assert!(run.windows(2).all(|w| w[0].end() == w[1].offset));
        let mut results = Vec::with_capacity(run.len());
        let mut missing: Vec<Extent> = Vec::new();
        for part in run {
            match self.kept(part.offset, part.count) {
                None => missing.push(*part),
                Some(bytes) => {
                    results.extend(self.read_missing(&std::mem::take(&mut missing)));
                    results.push(Ok((bytes, 0)));
                }
            }
        }
        results.extend(self.read_missing(&missing));
        results
    }

    fn read_missing(&self, run: &[Extent]) -> Vec<Result<(Vec<u8>, u64), FormatError>> {
        let whole = run.iter().try_fold(0u32, |sum, part| sum.checked_add(part.count));
        let (Some(whole), true) = (whole, run.len() > 1) else {
            return run.iter().map(|part| self.read(part.what, part.offset, part.count)).collect();
        };
        match self.read_range(run[0].what, run[0].offset, whole) {
            Ok(all) => {
                let part = |part: &Extent| {
                    let from = (part.offset - run[0].offset) as usize;
                    let bytes = all[from..from + part.count as usize].to_vec();
                    self.keep(part.offset, &bytes);
                    Ok((bytes, u64::from(part.count)))
                };
                run.iter().map(part).collect()
            }
            // A link that is gone is gone for all of them.
            Err(FormatError::Io(error)) if error.kind() == ErrorKind::NotConnected => {
                let (kind, why) = (error.kind(), error.to_string());
                let again = || FormatError::Io(std::io::Error::new(kind, why.clone()));
                run.iter().map(|_| Err(again())).collect()
            }
            // What is wrong of one need not be of others.
            Err(_) => {
                run.iter().map(|part| self.read(part.what, part.offset, part.count)).collect()
            }
        }
    }

    fn read_range(
        &self,
        what: &'static str,
        offset: u64,
        count: u32,
    ) -> Result<Vec<u8>, FormatError> {
        match &self.bytes {
            Bytes::Disk(file) => file.read_range(what, offset, count),
            Bytes::Server(file) => file.read_range(what, offset, count),
        }
    }

    /// What is in memory, or of a server came first or is on disk.
    fn kept(&self, offset: u64, count: u32) -> Option<Vec<u8>> {
        if let Some(bytes) = self.kept.lock().ok().and_then(|mut kept| kept.get(offset, count)) {
            return Some(bytes);
        }
        let Bytes::Server(file) = &self.bytes else { return None };
        let of_front = |front: &Vec<u8>| {
            let from = usize::try_from(offset).ok()?;
            front.get(from..from.checked_add(count as usize)?).map(<[u8]>::to_vec)
        };
        let in_front = self.front.lock().ok().and_then(|front| of_front(&front));
        in_front.or_else(|| file.kept(offset, count))
    }

    fn keep(&self, offset: u64, bytes: &[u8]) {
        if let Ok(mut kept) = self.kept.lock() {
            kept.put(offset, bytes);
        }
        if let Bytes::Server(file) = &self.bytes {
            file.keep(offset, bytes);
        }
    }

    /// Reads and checks a skeleton block.
    ///
    /// # Errors
    /// When it cannot be read or is damaged.
    pub fn read_block(&self, block: BlockRef) -> Result<SkeletonBlock, FormatError> {
        let (bytes, _) = self.read("skeleton block", block.offset, block.block_bytes)?;
        SkeletonBlock::parse(&bytes, block).inspect_err(|_| self.forget(block.offset))
    }

    /// Reads and checks what is known of the scan besides its shape.
    ///
    /// # Errors
    /// When it cannot be read or is damaged.
    pub fn read_metadata(&self) -> Result<Option<Metadata>, FormatError> {
        let Some(metadata) = self.header().metadata else { return Ok(None) };
        let (text, _) = self.read("metadata", metadata.offset, metadata.text_bytes)?;
        metadata.parse(&text).map(Some).inspect_err(|_| self.forget(metadata.offset))
    }

    /// Reads and checks a page.
    ///
    /// # Errors
    /// When it cannot be read or is damaged.
    pub fn read_page(&self, page: PageRef) -> Result<Vec<u8>, FormatError> {
        let (bytes, _) = self.read("page", page.offset, page.page_bytes)?;
        page.check(&bytes).inspect_err(|_| self.forget(page.offset))?;
        Ok(bytes)
    }

    /// What is wrong is not kept.
    pub fn forget(&self, offset: u64) {
        if let Ok(mut kept) = self.kept.lock() {
            kept.remove(offset);
        }
        if let Ok(mut front) = self.front.lock()
            && offset < front.len() as u64
        {
            front.clear();
        }
        if let Bytes::Server(file) = &self.bytes {
            file.forget(offset);
        }
    }
}

/// Parts of the file in memory, as they are in it; those used the longest ago make room.
struct Kept {
    limit: u64,
    /// Of the limit, taken otherwise.
    reserved: u64,
    bytes: u64,
    /// By offset, with when they were used last.
    parts: HashMap<u64, (Vec<u8>, u64)>,
    /// Offsets by when they were used last.
    used: BTreeMap<u64, u64>,
    uses: u64,
}

impl Kept {
    fn new(limit: u64) -> Kept {
        Kept { limit, reserved: 0, bytes: 0, parts: HashMap::new(), used: BTreeMap::new(), uses: 0 }
    }

    fn get(&mut self, offset: u64, count: u32) -> Option<Vec<u8>> {
        let (bytes, used) = self.parts.get_mut(&offset).filter(|p| p.0.len() == count as usize)?;
        self.uses += 1;
        self.used.remove(used);
        *used = self.uses;
        self.used.insert(self.uses, offset);
        Some(bytes.clone())
    }

    fn put(&mut self, offset: u64, bytes: &[u8]) {
        let length = bytes.len() as u64;
        if length > self.room() {
            return;
        }
        self.remove(offset);
        self.shrink_to(self.room() - length);
        self.uses += 1;
        self.bytes += length;
        self.parts.insert(offset, (bytes.to_vec(), self.uses));
        self.used.insert(self.uses, offset);
    }

    fn room(&self) -> u64 {
        self.limit.saturating_sub(self.reserved)
    }

    fn reserve(&mut self, bytes: u64) {
        self.reserved = bytes;
        self.shrink_to(self.room());
    }

    fn shrink_to(&mut self, most_bytes: u64) {
        while self.bytes > most_bytes {
            let Some((_, oldest)) = self.used.pop_first() else { return };
            if let Some((bytes, _)) = self.parts.remove(&oldest) {
                self.bytes -= bytes.len() as u64;
            }
        }
    }

    fn remove(&mut self, offset: u64) {
        if let Some((bytes, used)) = self.parts.remove(&offset) {
            self.bytes -= bytes.len() as u64;
            self.used.remove(&used);
        }
    }
}

/// The folder for what servers sent: `HLOD_CACHE_DIR`, or `hlod` in the user's cache folder. `None`
/// where there is none, and where the variable is empty.
pub fn cache_folder() -> Option<PathBuf> {
    if let Some(chosen) = std::env::var_os("HLOD_CACHE_DIR") {
        return (!chosen.is_empty()).then(|| chosen.into());
    }
    cache_home().map(|folder| folder.join("hlod"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// What is kept is what was put, within the limit, and the last used is among it.
        #[test]
        fn memory_keeps_to_its_limit(parts in prop::collection::vec((0u64..20, 1usize..40), 1..200)) {
            let mut kept = Kept::new(100);
            for (offset, length) in parts {
                let bytes = vec![offset as u8; length];
                if kept.get(offset, length as u32).is_none() {
                    kept.put(offset, &bytes);
                }
                prop_assert_eq!(kept.get(offset, length as u32), Some(bytes));
                let sum: usize = kept.parts.values().map(|p| p.0.len()).sum();
                prop_assert!(sum <= 100 && sum as u64 == kept.bytes);
                prop_assert_eq!(kept.used.len(), kept.parts.len());
            }
            // What is made of the file takes its share, or more than there is.
            for reserved in [60, 1000, 0] {
                kept.reserve(reserved);
                let sum: usize = kept.parts.values().map(|p| p.0.len()).sum();
                prop_assert!(sum as u64 + reserved.min(100) <= 100 && sum as u64 == kept.bytes);
            }
            kept.put(7, &[7; 100]);
            prop_assert_eq!(kept.get(7, 100), Some(vec![7; 100]));
        }
    }
}
