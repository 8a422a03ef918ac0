//! Brings triangles and their corners together when neither fits into memory.
//!
//! Vertices are taken in windows that fit. Triangles whose corners lie in one window — nearly all
//! of a scan's — are served when it is loaded; of the others each corner is asked for at its window
//! and answered into a file for a range of triangles, where the three meet again. Everything is
//! read and written in order, however the corners are scattered.

use std::path::Path;

use bytemuck::{Pod, Zeroable};

use super::overlap::overlap;
use crate::error::BuildError;
use crate::spill::{Buckets, RecordReader};

/// A triangle whose corners lie in one window.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Local {
    index: u64,
    corners: [u32; 3],
    padding: u32,
}

/// A corner that is asked for.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Request {
    /// 3 × triangle + corner.
    slot: u64,
    vertex: u64,
}

/// A triangle with its corners.
#[derive(Clone, Copy)]
pub(crate) struct Joined<V> {
    /// Its number in the file of triangles.
    pub(crate) index: u64,
    /// Numbers of its vertices.
    pub(crate) vertices: [u32; 3],
    pub(crate) corners: [V; 3],
}

/// What a join hands over.
pub(crate) enum Event<V> {
    /// The triangles that follow have their corners among these vertices.
    Window {
        first: u64,
        count: usize,
    },
    /// The corners of those that follow are anywhere.
    Rest,
    Triangles(Vec<Joined<V>>),
}

/// Triangles handed over at once.
const BATCH: usize = 1 << 16;

/// Hands out every triangle once, in batches, while the next are being read, in an order that depends on `memory_bytes`. Gives the
/// number of vertices that no triangle has.
///
/// `scratch` is a folder for files that are gone when this returns.
pub(crate) fn join<V: Pod + Send + Sync>(
    vertices: &Path,
    triangles: &Path,
    scratch: &Path,
    memory_bytes: usize,
    consume: impl FnMut(Event<V>) -> Result<(), BuildError>,
) -> Result<u64, BuildError> {
    overlap(|emit| emit_all(vertices, triangles, scratch, memory_bytes, emit), consume)
}

fn emit_all<V: Pod>(
    vertices: &Path,
    triangles: &Path,
    scratch: &Path,
    memory_bytes: usize,
    consume: &mut dyn FnMut(Event<V>) -> Result<(), BuildError>,
) -> Result<u64, BuildError> {
    let vertex_count = RecordReader::<V>::open(vertices)?.left() as usize;
    // Half for the window, half for what goes to and from files.
    let window = (memory_bytes / 2 / size_of::<V>()).max(1024);
    if vertex_count <= window {
        let all: Vec<V> = RecordReader::all(vertices)?;
        let mut reader = RecordReader::<[u32; 3]>::open(triangles)?;
        let mut index = 0;
        let mut is_used = vec![false; vertex_count];
        consume(Event::Window { first: 0, count: vertex_count })?;
        while reader.left() > 0 {
            let batch = reader.next(BATCH)?;
            batch.as_flattened().iter().for_each(|&v| is_used[v as usize] = true);
            let joined = batch.iter().enumerate().map(|(i, t)| Joined {
                index: index + i as u64,
                vertices: *t,
                corners: t.map(|v| all[v as usize]),
            });
            consume(Event::Triangles(joined.collect()))?;
            index += batch.len() as u64;
        }
        return Ok(unused(&is_used));
    }
    std::fs::create_dir_all(scratch).map_err(BuildError::io(scratch, "create"))?;
    let unused = join_in_windows(vertices, triangles, scratch, window, memory_bytes / 2, consume)?;
    std::fs::remove_dir_all(scratch).map_err(BuildError::io(scratch, "remove"))?;
    Ok(unused)
}

fn unused(is_used: &[bool]) -> u64 {
    is_used.iter().filter(|used| !**used).count() as u64
}

fn join_in_windows<V: Pod>(
    vertices: &Path,
    triangles: &Path,
    scratch: &Path,
    window: usize,
    buffer_bytes: usize,
    consume: &mut dyn FnMut(Event<V>) -> Result<(), BuildError>,
) -> Result<u64, BuildError> {
    let mut vertex_reader = RecordReader::<V>::open(vertices)?;
    let windows = (vertex_reader.left() as usize).div_ceil(window);
    let mut reader = RecordReader::<[u32; 3]>::open(triangles)?;
    let triangle_count = reader.left() as usize;
    // A range's answers fit where a window does: three corners and their numbers a triangle.
    let range = (window / 6).max(1024);
    let ranges = triangle_count.div_ceil(range);
    let names = |what: &str, count: usize| {
        (0..count).map(|i| scratch.join(format!("{what}-{i}"))).collect::<Vec<_>>()
    };
    let (local_files, request_files) = (names("local", windows), names("request", windows));
    let (answer_files, corner_files) = (names("answer", ranges), names("corner", ranges));

    let mut locals = Buckets::create(local_files.clone(), buffer_bytes / 2)?;
    let mut requests = Buckets::create(request_files.clone(), buffer_bytes / 2)?;
    let mut index = 0u64;
    while reader.left() > 0 {
        for corners in reader.next(BATCH)? {
            let window_of = corners.map(|v| v as usize / window);
            if window_of[0] == window_of[1] && window_of[1] == window_of[2] {
                locals.put(window_of[0], Local { index, corners, padding: 0 })?;
            } else {
                for k in 0..3 {
                    let slot = 3 * index + k as u64;
                    requests.put(window_of[k], Request { slot, vertex: corners[k].into() })?;
                }
            }
            index += 1;
        }
    }
    locals.finish()?;
    requests.finish()?;

    let mut answers = Buckets::<V>::create(answer_files.clone(), buffer_bytes / 2)?;
    let mut corners = Buckets::<Request>::create(corner_files.clone(), buffer_bytes / 2)?;
    let mut vertices_unused = 0;
    for w in 0..windows {
        let loaded = vertex_reader.next(window)?;
        let mut is_used = vec![false; loaded.len()];
        let at = |v: usize| loaded[v - w * window];
        consume(Event::Window { first: (w * window) as u64, count: loaded.len() })?;
        let mut reader = RecordReader::<Local>::open(&local_files[w])?;
        while reader.left() > 0 {
            let joined = reader.next(BATCH)?.into_iter().map(|local| Joined {
                index: local.index,
                vertices: local.corners,
                corners: local.corners.map(|v| {
                    is_used[v as usize - w * window] = true;
                    at(v as usize)
                }),
            });
            consume(Event::Triangles(joined.collect()))?;
        }
        remove(&local_files[w])?;
        let mut reader = RecordReader::<Request>::open(&request_files[w])?;
        while reader.left() > 0 {
            for request in reader.next(BATCH)? {
                let r = (request.slot / 3) as usize / range;
                is_used[request.vertex as usize - w * window] = true;
                answers.put(r, at(request.vertex as usize))?;
                corners.put(r, request)?;
            }
        }
        remove(&request_files[w])?;
        vertices_unused += unused(&is_used);
    }
    answers.finish()?;
    corners.finish()?;
    consume(Event::Rest)?;
    for r in 0..ranges {
        let mut together: Vec<(Request, V)> = RecordReader::<Request>::all(&corner_files[r])?
            .into_iter()
            .zip(RecordReader::<V>::all(&answer_files[r])?)
            .collect();
        remove(&corner_files[r])?;
        remove(&answer_files[r])?;
        together.sort_unstable_by_key(|(request, _)| request.slot);
        for batch in together.chunks(3 * BATCH) {
            let joined = batch.chunks_exact(3).map(|t| Joined {
                index: t[0].0.slot / 3,
                vertices: std::array::from_fn(|k| t[k].0.vertex as u32),
                corners: std::array::from_fn(|k| t[k].1),
            });
            consume(Event::Triangles(joined.collect()))?;
        }
    }
    Ok(vertices_unused)
}

fn remove(path: &Path) -> Result<(), BuildError> {
    std::fs::remove_file(path).map_err(BuildError::io(path, "remove"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spill::RecordWriter;

    /// Random triangles over more vertices than a window holds: each comes once, with its corners.
    #[test]
    fn every_triangle_meets_its_corners_in_any_memory() {
        let folder = tempfile::tempdir().unwrap();
        let (vertices, triangles) = (folder.path().join("v"), folder.path().join("t"));
        let count = 20_000u32;
        let mut writer = RecordWriter::<u64>::create(&vertices).unwrap();
        writer.put(&(0..u64::from(count)).map(|v| v * v + 7).collect::<Vec<_>>()).unwrap();
        writer.finish().unwrap();
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as u32 % count
        };
        // A third of them are local.
        let list: Vec<[u32; 3]> = (0..30_000)
            .map(|i| if i % 3 == 0 { [i % count; 3] } else { [random(), random(), random()] })
            .collect();
        let mut writer = RecordWriter::<[u32; 3]>::create(&triangles).unwrap();
        writer.put(&list).unwrap();
        writer.finish().unwrap();
        let mut used = vec![false; count as usize];
        list.as_flattened().iter().for_each(|&v| used[v as usize] = true);
        for memory in [1, 100_000, 1 << 24] {
            let mut seen = vec![false; list.len()];
            let left =
                join::<u64>(&vertices, &triangles, &folder.path().join("s"), memory, |event| {
                    let Event::Triangles(batch) = event else { return Ok(()) };
                    for joined in batch {
                        let i = joined.index as usize;
                        assert!(!std::mem::replace(&mut seen[i], true));
                        assert_eq!(joined.vertices, list[i]);
                        assert_eq!(joined.corners, list[i].map(|v| u64::from(v).pow(2) + 7));
                    }
                    Ok(())
                })
                .unwrap();
            assert!(seen.iter().all(|&s| s), "memory {memory}");
            assert!(left > 0 && left == unused(&used), "memory {memory}: {left} unused");
        }
    }
}
