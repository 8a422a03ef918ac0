//! Joins equal vertices of a triangle soup, of which there may be more than memory holds.
//!
//! Positions are sorted into files by a hash; within one, equal positions find the first vertex that
//! has them. The answers go to files by the vertex that asked, and are read in order. What comes
//! out does not depend on how many files there are.

use std::path::{Path, PathBuf};

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use rayon::prelude::*;

use crate::error::BuildError;
use crate::spill::{Buckets, RecordReader, RecordWriter};

/// A vertex of the soup at a place. Ordered by place, then number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct Placed {
    /// The bits of its coordinates.
    place: [u64; 3],
    vertex: u64,
}

/// A vertex and the first at its place.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Answer {
    vertex: u64,
    first: u64,
}

/// What welding did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Welded {
    /// Triangles with three different corners.
    pub(crate) triangles: u64,
    /// The others, left out.
    pub(crate) degenerate: u64,
    /// Vertices that were not the first of their place.
    pub(crate) vertices: u64,
}

/// A soup being read: the three vertices of a triangle follow on one another, and triangles come in
/// the order of their vertices.
pub(crate) struct Soup {
    scratch: PathBuf,
    triangles: RecordWriter<[u32; 3]>,
    by_place: Buckets<Placed>,
    files: Vec<PathBuf>,
    vertices: u64,
    memory_bytes: usize,
}

impl Soup {
    /// Begins a soup of about `vertices` vertices; `scratch` is a folder for files that are gone when
    /// it ends.
    pub(crate) fn begin(
        scratch: &Path,
        vertices: u64,
        memory_bytes: usize,
    ) -> Result<Soup, BuildError> {
        std::fs::create_dir_all(scratch).map_err(BuildError::io(scratch, "create"))?;
        let bytes = vertices * size_of::<Placed>() as u64;
        // One file's records are sorted at a time, in half of the memory.
        let count = (bytes / (memory_bytes as u64 / 4).max(1 << 16)) as usize + 1;
        let files: Vec<PathBuf> = (0..count).map(|i| scratch.join(format!("place-{i}"))).collect();
        let by_place = Buckets::create(files.clone(), memory_bytes / 4)?;
        let triangles = RecordWriter::create(&scratch.join(TRIANGLES))?;
        let scratch = scratch.to_owned();
        Ok(Soup { scratch, triangles, by_place, files, vertices: 0, memory_bytes })
    }

    pub(crate) fn add_triangles(&mut self, triangles: &[[u32; 3]]) -> Result<(), BuildError> {
        self.triangles.put(triangles)
    }

    pub(crate) fn add_vertices(&mut self, positions: &[DVec3]) -> Result<(), BuildError> {
        for position in positions {
            // Adding zero turns −0 into 0 and changes nothing else.
            let place = position.to_array().map(|x| (x + 0.0).to_bits());
            let bucket = (spread(place) % self.files.len() as u64) as usize;
            self.by_place.put(bucket, Placed { place, vertex: self.vertices })?;
            self.vertices += 1;
        }
        Ok(())
    }

    /// Writes the triangles; vertices are numbered from `first_vertex`.
    pub(crate) fn finish(
        self,
        first_vertex: u32,
        triangles: &mut RecordWriter<[u32; 3]>,
    ) -> Result<Welded, BuildError> {
        let Soup { scratch, triangles: soup, by_place, files, vertices, memory_bytes } = self;
        soup.finish()?;
        by_place.finish()?;
        let range = (memory_bytes / 4 / size_of::<Answer>()).max(1024);
        let ranges = (vertices as usize).div_ceil(range);
        let names: Vec<PathBuf> =
            (0..ranges).map(|i| scratch.join(format!("answer-{i}"))).collect();
        let mut answers = Buckets::<Answer>::create(names.clone(), memory_bytes / 4)?;
        let mut welded = Welded::default();
        for file in &files {
            let mut placed: Vec<Placed> = RecordReader::all(file)?;
            std::fs::remove_file(file).map_err(BuildError::io(file, "remove"))?;
            placed.par_sort_unstable();
            for same in placed.chunk_by(|a, b| a.place == b.place) {
                let first = same[0].vertex;
                welded.vertices += same.len() as u64 - 1;
                for &Placed { vertex, .. } in same {
                    answers.put(vertex as usize / range, Answer { vertex, first })?;
                }
            }
        }
        answers.finish()?;
        let mut soup = RecordReader::<[u32; 3]>::open(&scratch.join(TRIANGLES))?;
        let mut waiting: Vec<[u32; 3]> = Vec::new();
        let mut first: Vec<u32> = Vec::new();
        for (r, file) in names.iter().enumerate() {
            // A triangle's vertices lie in one range or in two that follow on one another.
            let before = std::mem::replace(&mut first, vec![0u32; range]);
            let mut reader = RecordReader::<Answer>::open(file)?;
            while reader.left() > 0 {
                for answer in reader.next(1 << 14)? {
                    first[answer.vertex as usize - r * range] = answer.first as u32 + first_vertex;
                }
            }
            std::fs::remove_file(file).map_err(BuildError::io(file, "remove"))?;
            let first_of = |v: u32| match (v as usize).checked_sub(r * range) {
                Some(place) => first[place],
                None => before[v as usize + range - r * range],
            };
            let end = (r + 1) * range;
            loop {
                if waiting.is_empty() {
                    waiting = soup.next(1 << 14)?;
                }
                let is_here = |t: &[u32; 3]| t.iter().all(|&v| (v as usize) < end);
                let here = waiting.iter().take_while(|t| is_here(t)).count();
                if here == 0 {
                    break;
                }
                let corners = waiting.drain(..here).map(|t| t.map(first_of));
                let kept: Vec<[u32; 3]> =
                    corners.filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]).collect();
                welded.triangles += kept.len() as u64;
                welded.degenerate += (here - kept.len()) as u64;
                triangles.put(&kept)?;
            }
        }
        std::fs::remove_dir_all(&scratch).map_err(BuildError::io(&scratch, "remove"))?;
        Ok(welded)
    }
}

/// The soup's own triangles.
const TRIANGLES: &str = "triangles";

/// A number for a place, alike on all machines (the finaliser of MurmurHash3, A. Appleby 2011).
fn spread(place: [u64; 3]) -> u64 {
    place.iter().fold(0, |hash: u64, bits| {
        let mut h = hash.rotate_left(21) ^ bits;
        h = (h ^ (h >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
        h = (h ^ (h >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
        h ^ (h >> 33)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles with corners on a small grid, so that nearly all places are shared and some triangles
    /// lose a corner: as welding in memory has it.
    #[test]
    fn a_soup_welds_alike_in_any_memory() {
        let folder = tempfile::tempdir().unwrap();
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 33) % 12) as f64 - 6.0
        };
        let positions: Vec<DVec3> =
            (0..30_000).map(|_| DVec3::new(random(), random() * -0.0, random())).collect();
        let weld = hlod_scan::weld_exact(&positions);
        let first = |v: usize| weld.old_from_new[weld.new_from_old[v] as usize] + 7;
        // Now and then a vertex belongs to none, and corners change places.
        let corners = |t: u32| [3 * t + t / 3000, 3 * t + t / 3000 + 1, 3 * t + t / 3000 + 2];
        let triangles: Vec<[u32; 3]> = (0..9_990).map(corners).map(|[a, b, c]| [a, c, b]).collect();
        let expected: Vec<[u32; 3]> = triangles
            .iter()
            .map(|t| t.map(|v| first(v as usize)))
            .filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
            .collect();
        for memory in [1, 50_000, 1 << 24] {
            let scratch = folder.path().join("scratch");
            let out = folder.path().join("triangles");
            let mut soup = Soup::begin(&scratch, positions.len() as u64, memory).unwrap();
            positions.chunks(1000).for_each(|batch| soup.add_vertices(batch).unwrap());
            triangles.chunks(700).for_each(|batch| soup.add_triangles(batch).unwrap());
            let mut writer = RecordWriter::create(&out).unwrap();
            let welded = soup.finish(7, &mut writer).unwrap();
            writer.finish().unwrap();
            assert!(RecordReader::<[u32; 3]>::all(&out).unwrap() == expected, "memory {memory}");
            let dropped = triangles.len() as u64 - expected.len() as u64;
            assert!(dropped > 0 && welded.degenerate == dropped);
            assert_eq!(welded.triangles, expected.len() as u64);
            assert_eq!(welded.vertices, (positions.len() - weld.old_from_new.len()) as u64);
            assert!(!scratch.exists());
        }
    }
}
