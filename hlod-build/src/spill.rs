//! Files of plain records: what steps of the build hand to one another.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use bytemuck::{AnyBitPattern, NoUninit};

use crate::error::BuildError;

const BUFFER_BYTES: usize = 1 << 17;

/// Appends records to a new file.
pub(crate) struct RecordWriter<T> {
    path: PathBuf,
    out: BufWriter<File>,
    count: u64,
    of: PhantomData<T>,
}

impl<T: NoUninit> RecordWriter<T> {
    pub(crate) fn create(path: &Path) -> Result<RecordWriter<T>, BuildError> {
        let file = File::create(path).map_err(BuildError::io(path, "create"))?;
        let out = BufWriter::with_capacity(BUFFER_BYTES, file);
        Ok(RecordWriter { path: path.to_owned(), out, count: 0, of: PhantomData })
    }

    pub(crate) fn put(&mut self, records: &[T]) -> Result<(), BuildError> {
        let bytes = bytemuck::cast_slice(records);
        self.out.write_all(bytes).map_err(BuildError::io(&self.path, "write"))?;
        self.count += records.len() as u64;
        Ok(())
    }

    /// Writes what is buffered, and says how many records there are.
    pub(crate) fn finish(mut self) -> Result<u64, BuildError> {
        self.out.flush().map_err(BuildError::io(&self.path, "write"))?;
        Ok(self.count)
    }
}

/// Reads records from the beginning of a file to its end.
pub(crate) struct RecordReader<T> {
    path: PathBuf,
    file: BufReader<File>,
    left: u64,
    of: PhantomData<T>,
}

impl<T: AnyBitPattern + NoUninit> RecordReader<T> {
    pub(crate) fn open(path: &Path) -> Result<RecordReader<T>, BuildError> {
        let file = File::open(path).map_err(BuildError::io(path, "open"))?;
        let bytes = file.metadata().map_err(BuildError::io(path, "open"))?.len();
        let file = BufReader::with_capacity(BUFFER_BYTES, file);
        let left = bytes / size_of::<T>() as u64;
        Ok(RecordReader { path: path.to_owned(), file, left, of: PhantomData })
    }

    /// Records not yet read.
    pub(crate) fn left(&self) -> u64 {
        self.left
    }

    /// Up to `count` more records; none at the end.
    pub(crate) fn next(&mut self, count: usize) -> Result<Vec<T>, BuildError> {
        let count = (count as u64).min(self.left) as usize;
        let mut records = vec![T::zeroed(); count];
        let bytes = bytemuck::cast_slice_mut(&mut records);
        self.file.read_exact(bytes).map_err(BuildError::io(&self.path, "read"))?;
        self.left -= count as u64;
        Ok(records)
    }

    /// The records with these numbers, which should ascend.
    pub(crate) fn at(
        path: &Path,
        numbers: impl Iterator<Item = u64>,
    ) -> Result<Vec<T>, BuildError> {
        let reader = RecordReader::<T>::open(path)?;
        let mut file = reader.file;
        let mut out = Vec::new();
        let mut position = 0;
        for number in numbers {
            let wanted = number * size_of::<T>() as u64;
            let mut record = [T::zeroed()];
            // Within the buffer where it can be.
            file.seek_relative(wanted as i64 - position as i64)
                .and_then(|()| file.read_exact(bytemuck::cast_slice_mut(&mut record)))
                .map_err(BuildError::io(path, "read"))?;
            position = wanted + size_of::<T>() as u64;
            out.extend(record);
        }
        Ok(out)
    }

    /// All records of a file.
    pub(crate) fn all(path: &Path) -> Result<Vec<T>, BuildError> {
        let mut reader = RecordReader::open(path)?;
        reader.next(reader.left as usize)
    }
}

/// Adds records to a file, or to a new one in its place.
pub(crate) fn append_records<T: NoUninit>(
    path: &Path,
    records: &[T],
    anew: bool,
) -> Result<(), BuildError> {
    let mut options = File::options();
    if anew {
        options.write(true).create(true).truncate(true);
    } else {
        options.append(true);
    }
    let mut file = options.open(path).map_err(BuildError::io(path, "open"))?;
    file.write_all(bytemuck::cast_slice(records)).map_err(BuildError::io(path, "write"))
}

/// Records that go to one of many files, each of which is opened only to append to it: there may be
/// more than a process may hold open.
pub(crate) struct Buckets<T> {
    paths: Vec<PathBuf>,
    pending: Vec<Vec<T>>,
    counts: Vec<u64>,
    /// Records a bucket holds before they are appended to its file.
    capacity: usize,
}

impl<T: NoUninit> Buckets<T> {
    /// New, empty files of these names; all buffers together take up to `bytes`.
    pub(crate) fn create(paths: Vec<PathBuf>, bytes: usize) -> Result<Buckets<T>, BuildError> {
        for path in &paths {
            File::create(path).map_err(BuildError::io(path, "create"))?;
        }
        let capacity = (bytes / paths.len().max(1) / size_of::<T>()).clamp(64, 1 << 16);
        let pending = paths.iter().map(|_| Vec::new()).collect();
        let counts = vec![0; paths.len()];
        Ok(Buckets { paths, pending, counts, capacity })
    }

    pub(crate) fn put(&mut self, bucket: usize, record: T) -> Result<(), BuildError> {
        self.pending[bucket].push(record);
        if self.pending[bucket].len() >= self.capacity {
            self.append(bucket)?;
        }
        Ok(())
    }

    fn append(&mut self, bucket: usize) -> Result<(), BuildError> {
        append_records(&self.paths[bucket], &self.pending[bucket], false)?;
        self.counts[bucket] += self.pending[bucket].len() as u64;
        self.pending[bucket].clear();
        Ok(())
    }

    /// Writes what is buffered, and says how many records each file has.
    pub(crate) fn finish(mut self) -> Result<Vec<u64>, BuildError> {
        (0..self.paths.len()).try_for_each(|bucket| self.append(bucket))?;
        Ok(self.counts)
    }
}
