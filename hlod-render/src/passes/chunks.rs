//! Triangles for compute passes, a workgroup's at a time.

use bytemuck::{Pod, Zeroable};

use super::Range;

/// Triangles of one workgroup.
const CHUNK: u32 = 64;
/// Workgroups in a row of a dispatch, at most.
const ROW: u32 = 32_768;
/// In a chunk's count: whether `cull_backs` holds.
const CULLED: u32 = 1 << 31;
/// In a chunk's count: these are points.
const POINTS: u32 = 1 << 30;

/// See `Chunk` in `small.wgsl` and `shadow.wgsl`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Chunk {
    first: u32,
    count: u32,
    draw: u32,
    error: f32,
    level: u32,
}

/// All chunks of a frame, those of each uniform next to one another.
pub(super) struct Chunks {
    /// What is uploaded: behind the last one is an empty one, and a dispatch may have more
    /// workgroups than there are chunks, to which empty ones are given.
    pub(super) chunks: Vec<Chunk>,
    /// Each uniform's first chunk.
    pub(super) firsts: Vec<u32>,
    /// And how many it has.
    pub(super) counts: Vec<u32>,
    /// And how many triangles.
    pub(super) triangles: Vec<u32>,
}

impl Chunks {
    /// `ranges` come in the order of their uniforms.
    pub(super) fn new(uniform_count: usize, ranges: &[&Range]) -> Chunks {
        let zeros = || vec![0; uniform_count];
        let mut all =
            Chunks { chunks: Vec::new(), firsts: zeros(), counts: zeros(), triangles: zeros() };
        for group in ranges.chunk_by(|a, b| a.uniform == b.uniform) {
            let uniform = group[0].uniform;
            let first = all.chunks.len();
            for range in group {
                let culled = if range.cull_backs { CULLED } else { 0 };
                let marks = culled | if range.points_level.is_some() { POINTS } else { 0 };
                let std::ops::Range { start, end } = range.triangles;
                all.triangles[uniform] += end - start;
                all.chunks.extend((start..end).step_by(CHUNK as usize).map(|first| Chunk {
                    first,
                    count: (end - first).min(CHUNK) | marks,
                    draw: uniform as u32,
                    error: range.error,
                    level: range.points_level.unwrap_or(0),
                }));
            }
            let count = (all.chunks.len() - first) as u32;
            all.firsts[uniform] = first as u32;
            all.counts[uniform] = count;
            let rows = count.div_ceil(ROW);
            let padded = rows * count.div_ceil(rows.max(1));
            all.chunks.resize(first + padded as usize, Chunk::default());
        }
        all.chunks.push(Chunk::default());
        all
    }

    /// One workgroup for each of a uniform's chunks.
    pub(super) fn dispatch(&self, pass: &mut wgpu::ComputePass<'_>, uniform: usize) {
        let count = self.counts[uniform];
        if count > 0 {
            let rows = count.div_ceil(ROW);
            pass.dispatch_workgroups(count.div_ceil(rows), rows, 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_hold_every_triangle_once() {
        let range = |uniform, triangles, cull_backs| Range {
            uniform,
            triangles,
            points_level: (uniform == 2).then_some(1),
            cull_backs,
            error: 0.5,
        };
        let ranges = [range(0, 5..200, true), range(2, 0..64, false), range(2, 100..101, false)];
        let chunks = Chunks::new(3, &ranges.iter().collect::<Vec<_>>());
        assert_eq!((chunks.firsts, chunks.counts), (vec![0, 0, 4], vec![4, 0, 2]));
        assert_eq!(chunks.triangles, [195, 0, 65]);
        let [.., before, last] = chunks.chunks[..] else { panic!() };
        let count = 1 | POINTS;
        let expected = Chunk { first: 100, count, draw: 2, error: 0.5, level: 1 };
        assert_eq!(before, expected);
        assert_eq!(last, Chunk::default());
        assert_eq!(chunks.chunks[3].count, (195 - 3 * 64) | CULLED);
    }
}
