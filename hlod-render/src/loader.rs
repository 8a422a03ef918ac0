//! Reading and decoding in the background.
//!
//! [`Loader`] is all that the renderer knows: requests are submitted, completions polled, nothing
//! waits. [`SourceLoader`] is the implementation with threads, for files on disks and servers; others (a
//! browser) need only these calls and [`decode`].

use std::collections::{HashSet, VecDeque};
use std::ops::Range;
use std::sync::mpsc;
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use bytemuck::{Pod, Zeroable};
use hlod_compress::{
    BlockRef, CellKey, FormatError, Header, Lattice, OctNormal, PageContent, PageRef, PointRadius,
    Points, RepresentationKind, Scalars, SkeletonBlock, decode_page,
};

use crate::edges::across;
use crate::skirts::{Borders, FaceLines, SkirtGroup, Skirts, skirts};
use crate::source::{Extent, Source};

/// What a request is for, as its submitter knows it.
pub type Ticket = u64;

/// A part of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Part {
    /// A skeleton block.
    Block(BlockRef),
    /// A page, the cell of its node, and what it is for.
    Page(PageRef, CellKey, RepresentationKind),
}

impl Part {
    /// Where it is.
    pub(crate) fn extent(&self) -> Extent {
        let (what, offset, count) = match self {
            Part::Block(b) => ("skeleton block", b.offset, b.block_bytes),
            Part::Page(p, ..) => ("page", p.offset, p.page_bytes),
        };
        Extent { what, offset, count }
    }

    /// Length in the file.
    pub fn file_bytes(&self) -> u64 {
        match self {
            Part::Block(block) => u64::from(block.block_bytes),
            Part::Page(page, ..) => u64::from(page.page_bytes),
        }
    }
}

/// A part, ready for use.
#[derive(Debug)]
pub enum Loaded {
    /// A skeleton block.
    Block(SkeletonBlock),
    /// A page's geometry.
    Mesh(Box<GpuMesh>),
}

/// One finished request.
#[derive(Debug)]
pub struct Completion {
    /// Which.
    pub ticket: Ticket,
    /// What came of it.
    pub result: Result<Loaded, FormatError>,
    /// Bytes read from the file for it.
    pub bytes_read: u64,
}

/// Reads parts of one file without making anyone wait.
pub trait Loader {
    /// Asks for parts; the most urgent first. Each call states everything that is wanted: parts
    /// submitted earlier and not begun are dropped, parts begun are not begun again.
    fn submit(&mut self, wanted: Vec<(Ticket, Part)>);
    /// Everything finished since the last call.
    fn poll(&mut self) -> Vec<Completion>;
    /// Requests that are not completed yet.
    fn in_flight(&self) -> usize;
}

/// A vertex as shaders see it.
#[derive(Debug, Clone, Copy, Pod, Zeroable, PartialEq)]
#[repr(C)]
pub struct GpuVertex {
    /// Model space: source coordinates relative to the root cube's centre.
    pub position: [f32; 3],
    /// Octahedral, above [`CODE_BITS`] bits that are a skirt's: how far its lower corner is moved, where it is drawn as
    /// a receiver and as a caster.
    pub normal: [i16; 2],
}

/// Lowest bits of a normal's numbers that are not of the normal.
pub const CODE_BITS: u32 = 6;

impl GpuVertex {
    /// Of no skirt.
    pub fn new(position: [f32; 3], normal: OctNormal) -> GpuVertex {
        GpuVertex { position, normal: normal.0.map(|n| n << CODE_BITS) }
    }
}

/// A page's geometry as shaders see it.
#[derive(Debug, Clone, Default)]
pub struct GpuMesh {
    /// Vertices: those of triangles, copies of some that are lower corners of skirts, and points.
    pub vertices: Vec<GpuVertex>,
    /// Which of them are these copies.
    pub corners: Range<usize>,
    /// The lines that skirts hang from, face by face.
    pub lines: Arc<[FaceLines; 6]>,
    /// sRGB and alpha, or empty.
    pub colours: Vec<[u8; 4]>,
    /// Kept numbers, or empty.
    pub scalars: Vec<Scalars>,
    /// Three a triangle, counted from the mesh's first vertex; of skirts with the marks of
    /// [`crate::skirts`], which are the last ones.
    pub indices: Vec<u32>,
    /// What skirts there are, in their order.
    pub skirts: Vec<SkirtGroup>,
    /// What the triangles end in on each face of the cell.
    pub borders: Borders,
    /// Of what casts shadows, the vertex across each edge: see `edges.rs`. Skirts have none.
    pub across: Vec<u32>,
    /// Radii of the points, as shaders read them: a byte for each of `prefixes`, the last one lowest.
    /// Their vertices are the last ones, in progressive order.
    pub radii: Vec<u32>,
    /// How many of the points cover, fewest first; the last are all of them.
    pub prefixes: Vec<PointPrefix>,
}

/// So many points from the first on cover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointPrefix {
    /// Points.
    pub count: u32,
    /// The byte of their radii.
    pub level: u32,
    /// Their mean radius, model space.
    pub radius: f64,
}

/// Centre of the root cube in source coordinates: the origin of model space.
pub fn model_origin(lattice: &Lattice) -> glam::DVec3 {
    let half = f64::from(lattice.root_units) / 2.0;
    glam::DVec3::from_array(lattice.origin) + glam::DVec3::splat(half * lattice.step)
}

/// Turns a part's bytes into what it is for.
///
/// # Errors
/// When the bytes are damaged.
pub fn decode(part: &Part, bytes: &[u8], header: &Header) -> Result<Loaded, FormatError> {
    let lattice = &header.lattice;
    match part {
        Part::Block(block) => SkeletonBlock::parse(bytes, *block).map(Loaded::Block),
        Part::Page(page, cell, kind) => {
            page.check(bytes)?;
            let PageContent { mesh, points } = decode_page(bytes)?;
            let half = f64::from(lattice.root_units) / 2.0;
            let vertex = |(position, normal): (&[i32; 3], &OctNormal)| {
                let place = position.map(|c| ((f64::from(c) - half) * lattice.step) as f32);
                GpuVertex::new(place, *normal)
            };
            let mut indices = mesh.triangles.as_flattened().to_vec();
            let budget =
                f64::from(lattice.cell_units(cell.depth())) / f64::from(header.resolution.max(1));
            // Where there are points parts of a component are small that is large.
            let small = if points.is_empty() { budget } else { 0.0 };
            let skirts = skirts(&mesh, *cell, lattice, small);
            let Skirts { indices: of_skirts, groups, borders, corners, lines } = skirts;
            indices.extend(of_skirts);
            let mut vertices: Vec<GpuVertex> =
                mesh.positions.iter().zip(&mesh.normals).map(vertex).collect();
            vertices.extend(copies(&vertices, &corners));
            let corners_at = mesh.positions.len()..vertices.len();
            vertices.extend(points.positions.iter().zip(&points.normals).map(vertex));
            // Casters are of the geometric hierarchy, and leaves of every one.
            let across = match kind {
                RepresentationKind::Appearance => Vec::new(),
                _ => across(&mesh),
            };
            let mut colours = mesh.colours;
            colours.extend(copies(&colours, &corners));
            colours.extend(&points.colours);
            let mut scalars = mesh.scalars;
            if header.scalars().next().is_some() {
                // Pages without any value say nothing of them; their place may have been another's.
                scalars.resize(mesh.positions.len(), Scalars::default());
                scalars.extend(copies(&scalars, &corners));
                scalars.extend(&points.scalars);
                scalars.resize(vertices.len(), Scalars::default());
            }
            let (radii, prefixes) = radii(&points, lattice.step);
            Ok(Loaded::Mesh(Box::new(GpuMesh {
                vertices,
                corners: corners_at,
                lines: Arc::new(lines),
                colours,
                scalars,
                indices,
                skirts: groups,
                borders,
                across,
                radii,
                prefixes,
            })))
        }
    }
}

/// What the corners of skirts have of the vertices that they are copies of.
fn copies<T: Copy>(of_vertices: &[T], corners: &[u32]) -> Vec<T> {
    corners.iter().filter_map(|&v| of_vertices.get(v as usize).copied()).collect()
}

/// What shaders know of points' radii.
fn radii(points: &Points, step: f64) -> (Vec<u32>, Vec<PointPrefix>) {
    let mut packed: Vec<u32> = points.radii.iter().map(|r| u32::from(r.0)).collect();
    let mean = |radii: &[PointRadius]| {
        radii.iter().map(|r| r.steps()).sum::<f64>() / radii.len().max(1) as f64 * step
    };
    let count = points.len() as u32;
    let mut prefixes = vec![PointPrefix { count, level: 0, radius: mean(&points.radii) }];
    for (level, prefix) in (1..).zip(points.prefixes.iter().rev()) {
        for (packed, radius) in packed.iter_mut().zip(&prefix.radii) {
            *packed |= u32::from(radius.0) << (8 * level);
        }
        let (count, radius) = (prefix.radii.len() as u32, mean(&prefix.radii));
        prefixes.push(PointPrefix { count, level, radius });
    }
    prefixes.reverse();
    (packed, prefixes)
}

/// Reads a file on worker threads, each with its own reads.
pub struct SourceLoader {
    shared: Arc<Shared>,
    completions: mpsc::Receiver<Completion>,
}

struct Shared {
    source: Arc<Source>,
    state: Mutex<State>,
    wake: Condvar,
}

struct State {
    /// Most urgent last.
    wanted: Vec<(Ticket, Part)>,
    /// Read, to be decoded by whoever is free.
    read: VecDeque<Bytes>,
    /// Begun and not polled yet.
    begun: HashSet<Ticket>,
    closing: bool,
    bandwidth: Option<Bandwidth>,
    /// What may be read at once besides a single part.
    run_bytes: u64,
}

/// A part as it is in the file, and how much of it was read just now.
struct Bytes {
    ticket: Ticket,
    part: Part,
    read: Result<(Vec<u8>, u64), FormatError>,
}

/// Of a server, parts that follow each other in the file, as children do, are asked for at once up to so many bytes: pages
/// are some 10 KB. Disks bring them as fast one by one, and then both threads have some to decode.
const RUN_BYTES_MAX: u64 = 64 << 10;
/// No more than it brought lately within this time: over a slow link every part comes when it can, and what is asked for
/// can still change.
const RUN_SECS: f64 = 0.05;
/// Looked for among so many of the most urgent ones.
const RUN_AMONG: usize = 32;

/// Takes the most urgent part, and what can be read with it, in the file's order.
fn take_run(wanted: &mut Vec<(Ticket, Part)>, most_bytes: u64) -> Vec<(Ticket, Part)> {
    let Some(first) = wanted.pop() else { return Vec::new() };
    let (mut begin, mut end) = (first.1.extent().offset, first.1.extent().end());
    let mut run = VecDeque::from([first]);
    loop {
        let from = wanted.len().saturating_sub(RUN_AMONG);
        let joins = |(_, part): &(Ticket, Part)| {
            let extent = part.extent();
            let fits = end - begin + u64::from(extent.count) <= most_bytes;
            fits && (extent.offset == end || extent.end() == begin)
        };
        // The most urgent last.
        let Some(i) = wanted[from..].iter().rposition(joins) else { return run.into() };
        let next = wanted.remove(from + i);
        let extent = next.1.extent();
        if extent.offset == end {
            end = extent.end();
            run.push_back(next);
        } else {
            begin = extent.offset;
            run.push_front(next);
        }
    }
}

/// A limit on reading, for measurements of slow disks and networks.
struct Bandwidth {
    bytes_per_sec: f64,
    /// When the next read may begin.
    free_at: Instant,
}

impl SourceLoader {
    /// Starts as many threads as the source has readers; `bytes_per_sec` limits reading.
    pub fn new(source: Arc<Source>, bytes_per_sec: Option<f64>) -> SourceLoader {
        let bandwidth =
            bytes_per_sec.map(|bytes_per_sec| Bandwidth { bytes_per_sec, free_at: Instant::now() });
        let state = State {
            wanted: Vec::new(),
            read: VecDeque::new(),
            begun: HashSet::new(),
            closing: false,
            bandwidth,
            run_bytes: if source.is_remote() { RUN_BYTES_MAX } else { 0 },
        };
        let readers = source.readers();
        let shared = Arc::new(Shared { source, state: Mutex::new(state), wake: Condvar::new() });
        let (sender, completions) = mpsc::channel();
        for _ in 0..readers {
            let (shared, sender) = (shared.clone(), sender.clone());
            std::thread::spawn(move || work(&shared, &sender));
        }
        SourceLoader { shared, completions }
    }
}

/// What a thread has to do.
enum Work {
    Decode(Bytes),
    /// At this time.
    Read(Vec<(Ticket, Part)>, Instant),
}

/// Waits for work; `None` at the end.
fn next_work(shared: &Shared) -> Option<Work> {
    let mut state = shared.state.lock().ok()?;
    loop {
        if state.closing {
            return None;
        }
        if let Some(bytes) = state.read.pop_front() {
            return Some(Work::Decode(bytes));
        }
        let most_bytes = state.run_bytes;
        let run = take_run(&mut state.wanted, most_bytes);
        if !run.is_empty() {
            state.begun.extend(run.iter().map(|(ticket, _)| *ticket));
            let bytes: u64 = run.iter().map(|(_, part)| part.file_bytes()).sum();
            let now = Instant::now();
            // Its turn at the disk.
            let begin = state.bandwidth.as_mut().map_or(now, |limit| {
                let secs = bytes as f64 / limit.bytes_per_sec;
                limit.free_at = limit.free_at.max(now) + Duration::from_secs_f64(secs);
                limit.free_at
            });
            return Some(Work::Read(run, begin));
        }
        state = shared.wake.wait(state).ok()?;
    }
}

fn work(shared: &Shared, completions: &mpsc::Sender<Completion>) {
    while let Some(work) = next_work(shared) {
        match work {
            Work::Read(run, begin) => {
                let asked = Instant::now();
                std::thread::sleep(begin.saturating_duration_since(asked));
                let extents: Vec<Extent> = run.iter().map(|(_, part)| part.extent()).collect();
                let read = shared.source.read_run(&extents);
                let of = |((ticket, part), read)| Bytes { ticket, part, read };
                let bytes: u64 = read.iter().flatten().map(|(_, bytes_read)| *bytes_read).sum();
                let Ok(mut state) = shared.state.lock() else { return };
                if bytes > 0 && shared.source.is_remote() {
                    let bytes_per_sec = bytes as f64 / asked.elapsed().as_secs_f64().max(1e-6);
                    state.run_bytes = ((bytes_per_sec * RUN_SECS) as u64).min(RUN_BYTES_MAX);
                }
                state.read.extend(run.into_iter().zip(read).map(of));
                drop(state);
                shared.wake.notify_all();
            }
            Work::Decode(Bytes { ticket, part, read }) => {
                let bytes_read = read.as_ref().map_or(0, |(_, bytes_read)| *bytes_read);
                let result = read.and_then(|(bytes, _)| {
                    let decoded = decode(&part, &bytes, shared.source.header());
                    decoded.inspect_err(|_| shared.source.forget(part.extent().offset))
                });
                if completions.send(Completion { ticket, result, bytes_read }).is_err() {
                    return;
                }
            }
        }
    }
}

impl Loader for SourceLoader {
    fn submit(&mut self, mut wanted: Vec<(Ticket, Part)>) {
        wanted.reverse();
        if let Ok(mut state) = self.shared.state.lock() {
            wanted.retain(|(ticket, _)| !state.begun.contains(ticket));
            state.wanted = wanted;
        }
        self.shared.wake.notify_all();
    }

    fn poll(&mut self) -> Vec<Completion> {
        let completions: Vec<Completion> = self.completions.try_iter().collect();
        if let Ok(mut state) = self.shared.state.lock() {
            for completion in &completions {
                state.begun.remove(&completion.ticket);
            }
        }
        completions
    }

    fn in_flight(&self) -> usize {
        self.shared.state.lock().map_or(0, |state| state.begun.len() + state.wanted.len())
    }
}

impl Drop for SourceLoader {
    fn drop(&mut self) {
        if let Ok(mut state) = self.shared.state.lock() {
            state.closing = true;
        }
        self.shared.wake.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A page that is read and nothing else.
    fn page(offset: u64, page_bytes: u32) -> Part {
        let page = PageRef { offset, page_bytes, crc32: 0 };
        Part::Page(page, CellKey::ROOT, RepresentationKind::Appearance)
    }

    #[test]
    fn what_follows_each_other_is_read_at_once() {
        // The most urgent last.
        let sizes = [(900, 50), (100, 100), (200, 300), (50, 50), (700, 1), (500, 200), (0, 50)];
        let mut wanted: Vec<(Ticket, Part)> = (0..)
            .zip(sizes)
            .map(|(ticket, (offset, count))| (ticket, page(offset, count)))
            .collect();
        let mut tickets =
            || take_run(&mut wanted, RUN_BYTES_MAX).iter().map(|(ticket, _)| *ticket).collect();
        let runs: [Vec<Ticket>; 3] = [tickets(), tickets(), tickets()];
        assert_eq!(runs, [vec![6, 3, 1, 2, 5, 4], vec![0], vec![]]);
    }

    proptest! {
        /// Nothing is lost or read twice, runs follow each other without gaps, are no larger than they may be, and begin
        /// with what is most urgent.
        #[test]
        fn runs_are_of_what_was_asked_for(
            pages in prop::collection::vec((1u32..40_000, any::<bool>(), any::<u64>()), 1..80),
            most_bytes in 0..RUN_BYTES_MAX,
        ) {
            let mut offset = 0;
            let mut parts: Vec<(u64, Part)> = Vec::new();
            for (count, is_wanted, urgency) in pages {
                if is_wanted {
                    parts.push((urgency, page(offset, count)));
                }
                offset += u64::from(count);
            }
            parts.sort_by_key(|(urgency, _)| *urgency);
            let mut wanted: Vec<(Ticket, Part)> =
                (0..).zip(parts.iter().map(|(_, part)| *part)).collect();
            let mut seen = HashSet::new();
            while let Some((urgent, _)) = wanted.last().copied() {
                let run = take_run(&mut wanted, most_bytes);
                prop_assert!(run.iter().any(|(ticket, _)| *ticket == urgent));
                prop_assert!(run.iter().all(|(ticket, _)| seen.insert(*ticket)));
                let extents: Vec<Extent> = run.iter().map(|(_, part)| part.extent()).collect();
                prop_assert!(extents.windows(2).all(|w| w[0].end() == w[1].offset));
                let bytes: u64 = run.iter().map(|(_, part)| part.file_bytes()).sum();
                prop_assert!(run.len() == 1 || bytes <= most_bytes);
            }
            prop_assert_eq!(seen.len(), parts.len());
        }
    }
}
