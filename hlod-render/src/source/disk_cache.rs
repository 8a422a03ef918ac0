//! What servers sent, kept on disk until next time.
//!
//! A folder for each version of each file, a file for each range, named by its offset and ended by a
//! checksum. Whatever goes wrong here costs another request and nothing else.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// All folders together, when one is opened.
const BYTES_MAX: u64 = 2 << 30;
const CHECKSUM_BYTES: usize = 4;

/// One version of one file.
pub(super) struct DiskCache {
    folder: PathBuf,
}

impl DiskCache {
    /// In a folder for all of them, for what a name stands for; `None` where nothing can be kept.
    pub(super) fn open(all: &Path, name: &str) -> Option<DiskCache> {
        make_room(all);
        // Two checksums: a name is no secret, and a collision would be seen by the pages' own.
        let hash =
            (crc32fast::hash(name.as_bytes()), crc32fast::hash(name.to_uppercase().as_bytes()));
        let folder = all.join(format!("{:08x}{:08x}", hash.0, hash.1));
        fs::create_dir_all(&folder).ok()?;
        Some(DiskCache { folder })
    }

    fn file(&self, offset: u64) -> PathBuf {
        self.folder.join(format!("{offset:x}"))
    }

    pub(super) fn get(&self, offset: u64, count: u32) -> Option<Vec<u8>> {
        let mut bytes = fs::read(self.file(offset)).ok()?;
        let checksum = bytes.split_off(bytes.len().checked_sub(CHECKSUM_BYTES)?);
        let is_whole =
            bytes.len() == count as usize && checksum == crc32fast::hash(&bytes).to_le_bytes();
        is_whole.then_some(bytes)
    }

    pub(super) fn put(&self, offset: u64, bytes: &[u8]) {
        // Aside and renamed, so that nobody reads half a file; errors only mean asking again.
        let write = || -> std::io::Result<()> {
            let aside = self.folder.join(format!("{offset:x}.{}", std::process::id()));
            let mut file = fs::File::create(&aside)?;
            file.write_all(bytes)?;
            file.write_all(&crc32fast::hash(bytes).to_le_bytes())?;
            drop(file);
            fs::rename(aside, self.file(offset))
        };
        let _ = write();
    }

    pub(super) fn forget(&self, offset: u64) {
        let _ = fs::remove_file(self.file(offset));
    }
}

/// Removes what was kept of the files that were opened the longest ago, until the rest is small enough.
/// Nothing is touched whose name this cache would not give: the folder may be anybody's.
fn make_room(all: &Path) {
    let is_ours = |name: &std::ffi::OsStr, digits: std::ops::RangeInclusive<usize>| {
        name.to_str().is_some_and(|name| {
            digits.contains(&name.len()) && name.bytes().all(|c| c.is_ascii_hexdigit())
        })
    };
    let Ok(folders) = fs::read_dir(all) else { return };
    let mut found = Vec::new();
    for folder in folders.flatten().filter(|f| is_ours(&f.file_name(), 16..=16)) {
        let files: Vec<(PathBuf, u64)> = fs::read_dir(folder.path())
            .into_iter()
            .flatten()
            .flatten()
            .filter(|file| is_ours(&file.file_name(), 1..=16))
            .filter_map(|file| Some((file.path(), file.metadata().ok()?.len())))
            .collect();
        let changed = folder.metadata().and_then(|m| m.modified());
        found.push((changed.unwrap_or(SystemTime::UNIX_EPOCH), folder.path(), files));
    }
    found.sort_by_key(|(changed, ..)| *changed);
    let mut sum: u64 = found.iter().flat_map(|f| &f.2).map(|f| f.1).sum();
    for (_, folder, files) in found {
        for (file, bytes) in files {
            if sum <= BYTES_MAX {
                return;
            }
            if fs::remove_file(file).is_ok() {
                sum -= bytes;
            }
        }
        // Only if nothing else is in it.
        let _ = fs::remove_dir(folder);
    }
}
