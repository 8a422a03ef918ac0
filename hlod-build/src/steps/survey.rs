//! Chooses the lattice, completes normals, places vertices, and plans the subtrees.

use std::hash::{DefaultHasher, Hash, Hasher};

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use hlod_compress::{CellKey, Lattice, OctNormal, SCALARS_MAX, Scalars};
use hlod_scan::NormalSum;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::ingest::{Account, SCALARS, ScanVertex, TRIANGLES, VERTICES};
use super::join::{Event, Joined, join};
use super::work_folder::WorkFolder;
use crate::error::BuildError;
use crate::ingest::{Precision, choose_cloud_step, choose_step};
use crate::points::cloud::octant_of;
use crate::progress::{Progress, Unit};
use crate::spill::{Buckets, RecordReader, RecordWriter};

pub(crate) const PLACED: &str = "placed";
pub(crate) const SURVEY: &str = "survey.json";
const SUMS: &str = "sums";

/// A vertex on the lattice.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct PlacedVertex {
    pub(crate) position: [i32; 3],
    pub(crate) normal: OctNormal,
    pub(crate) colour: [u8; 4],
    /// Kept numbers as codes.
    pub(crate) scalars: Scalars,
}

/// What the whole model is like.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Survey {
    pub(crate) origin: [f64; 3],
    pub(crate) step: f64,
    pub(crate) root_units: u32,
    pub(crate) depth_max: u8,
    pub(crate) precision: Precision,
    /// Of what is on the lattice.
    pub(crate) bounds: [[i32; 3]; 2],
    pub(crate) triangles_degenerate: u64,
    pub(crate) closed_oriented: bool,
    pub(crate) vertices_unused: u64,
    /// Cells too full for one subtree, by depth and Morton code: their children may be subtrees.
    pub(crate) split: Vec<(u8, u64)>,
}

impl Survey {
    pub(crate) fn lattice(&self) -> Lattice {
        let Survey { origin, step, root_units, depth_max, .. } = *self;
        Lattice { origin, step, root_units, depth_max }
    }
}

/// Does the step unless it is done.
pub(crate) fn survey(
    folder: &WorkFolder,
    account: &Account,
    precision: Option<f64>,
    subtree_triangles: u64,
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Survey, BuildError> {
    let survey_file = folder.file(SURVEY);
    folder.step("survey", &[PLACED, SURVEY], || {
        let survey = if account.is_cloud {
            take_cloud(folder, account, precision, subtree_triangles, progress)?
        } else {
            take(folder, account, precision, subtree_triangles, memory_bytes, progress)?
        };
        super::write_json(&survey_file, &survey)
    })?;
    read_survey(folder)
}

/// What a step that is done has found.
pub(crate) fn read_survey(folder: &WorkFolder) -> Result<Survey, BuildError> {
    super::read_json(&folder.file(SURVEY))
}

/// Depth of the grid in which triangles are counted.
const COUNT_DEPTH: u8 = 7;

fn take(
    folder: &WorkFolder,
    account: &Account,
    precision: Option<f64>,
    subtree_triangles: u64,
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Survey, BuildError> {
    let (vertices, triangles) = (folder.file(VERTICES), folder.file(TRIANGLES));
    let (step, precision) = choose_step(&vertices, &triangles, precision)?;
    let lattice = Lattice::enclosing(account.min, account.max, step);
    let depth = COUNT_DEPTH.min(lattice.depth_max);

    progress.begin("survey", account.triangles, Unit::Triangles);
    let mut counts = vec![0u32; 1 << (3 * depth)];
    let mut totals = Totals::default();
    let mut sums = Sums::create(folder, account, memory_bytes)?;
    let vertices_unused = join::<ScanVertex>(
        &vertices,
        &triangles,
        &folder.file("survey-join"),
        memory_bytes,
        |event| {
            let batch = match event {
                Event::Window { first, count } => return sums.begin_window(first, count),
                Event::Rest => return sums.begin_rest(),
                Event::Triangles(batch) => batch,
            };
            folder.check_stop(progress)?;
            progress.advance(batch.len() as u64);
            let placed: Vec<[[i32; 3]; 3]> =
                batch.par_iter().map(|t| t.corners.map(|v| lattice.quantise(v.position))).collect();
            totals = placed
                .par_iter()
                .map(Totals::of)
                .reduce(Totals::default, Totals::plus)
                .plus(totals);
            for t in &placed {
                let centre: [u32; 3] = std::array::from_fn(|i| {
                    let sum: i64 = t.iter().map(|p| i64::from(p[i])).sum();
                    ((sum / 3) as u32 / lattice.cell_units(depth)).min((1 << depth) - 1)
                });
                let count = &mut counts[CellKey::at(depth, centre).morton() as usize];
                *count = count.saturating_add(1);
            }
            sums.add(&batch)
        },
    )?;
    if totals.degenerate == account.triangles {
        return Err(BuildError::NothingLeft {
            path: account.reports.first().map(|r| r.path.clone()).unwrap_or_default(),
            triangles: account.triangles,
            step: lattice.step,
        });
    }
    let bounds = place_vertices(folder, account, &lattice, sums)?;
    progress.end();
    Ok(Survey {
        origin: lattice.origin,
        step: lattice.step,
        root_units: lattice.root_units,
        depth_max: lattice.depth_max,
        precision,
        bounds,
        triangles_degenerate: totals.degenerate,
        closed_oriented: totals.bounds_a_volume(),
        vertices_unused,
        split: plan(counts, depth, subtree_triangles),
    })
}

/// The same of a point cloud.
fn take_cloud(
    folder: &WorkFolder,
    account: &Account,
    precision: Option<f64>,
    subtree_points: u64,
    progress: &dyn Progress,
) -> Result<Survey, BuildError> {
    let (step, precision) = choose_cloud_step(&folder.file(VERTICES), precision)?;
    let lattice = Lattice::enclosing(account.min, account.max, step);
    let depth = COUNT_DEPTH.min(lattice.depth_max);
    progress.begin("survey", account.vertices, Unit::Points);
    let sums = Sums::create(folder, account, 0)?;
    let bounds = place_vertices(folder, account, &lattice, sums)?;
    let mut counts = vec![0u32; 1 << (3 * depth)];
    let mut reader = RecordReader::<PlacedVertex>::open(&folder.file(PLACED))?;
    while reader.left() > 0 {
        folder.check_stop(progress)?;
        let batch = reader.next(1 << 16)?;
        for vertex in &batch {
            let cell = (0..depth).fold(CellKey::ROOT, |cell, _| {
                cell.child(octant_of(vertex.position, cell, &lattice))
            });
            let count = &mut counts[cell.morton() as usize];
            *count = count.saturating_add(1);
        }
        progress.advance(batch.len() as u64);
    }
    progress.end();
    Ok(Survey {
        origin: lattice.origin,
        step: lattice.step,
        root_units: lattice.root_units,
        depth_max: lattice.depth_max,
        precision,
        bounds,
        triangles_degenerate: 0,
        closed_oriented: false,
        vertices_unused: 0,
        split: plan(counts, depth, subtree_points),
    })
}

/// Cells with more triangles than a subtree may have.
fn plan(mut counts: Vec<u32>, depth: u8, subtree_triangles: u64) -> Vec<(u8, u64)> {
    let mut split = Vec::new();
    for depth in (0..=depth).rev() {
        // At the finest depth it is not known where to split: the scatter goes on from there.
        let cells =
            (0u64..).zip(&counts).filter(|(_, count)| u64::from(**count) > subtree_triangles);
        split.extend(cells.map(|(morton, _)| (depth, morton)));
        let sum = |eight: &[u32]| eight.iter().fold(0u32, |sum, &count| sum.saturating_add(count));
        counts = counts.chunks(8).map(sum).collect();
    }
    split.sort_unstable();
    split
}

/// Sums over all triangles that do not depend on their order.
#[derive(Debug, Clone, Copy, Default)]
struct Totals {
    degenerate: u64,
    /// Every directed edge counts with a hash of its ends, its opposite against it: zero where each
    /// edge has as many opposites, and by chance once in 2⁶⁴ otherwise.
    edges: u64,
    /// Six times the volume inside.
    volume: i128,
}

impl Totals {
    fn of(t: &[[i32; 3]; 3]) -> Totals {
        let [a, b, c] = *t;
        if a == b || b == c || c == a {
            return Totals { degenerate: 1, ..Totals::default() };
        }
        let edge = |a: [i32; 3], b: [i32; 3]| {
            let mut hasher = DefaultHasher::new();
            (a.min(b), a.max(b)).hash(&mut hasher);
            if a < b { hasher.finish() } else { hasher.finish().wrapping_neg() }
        };
        let edges = edge(a, b).wrapping_add(edge(b, c)).wrapping_add(edge(c, a));
        let [a, b, c] = [a, b, c].map(|p| p.map(i128::from));
        let cross = |i: usize, j: usize| b[i] * c[j] - b[j] * c[i];
        let volume = a[0] * cross(1, 2) + a[1] * cross(2, 0) + a[2] * cross(0, 1);
        Totals { degenerate: 0, edges, volume }
    }

    fn plus(self, other: Totals) -> Totals {
        Totals {
            degenerate: self.degenerate + other.degenerate,
            edges: self.edges.wrapping_add(other.edges),
            volume: self.volume + other.volume,
        }
    }

    /// Whether nobody outside ever sees a back.
    fn bounds_a_volume(&self) -> bool {
        self.edges == 0 && self.volume > 0
    }
}

/// Part of a vertex' normal, from a triangle that does not lie in one window.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Part {
    vertex: u64,
    sum: [i64; 3],
}

/// Sums of the normals of all vertices, one window of them in memory at a time.
struct Sums {
    /// Nothing to do: all normals are there.
    needed: bool,
    file: std::path::PathBuf,
    writer: Option<RecordWriter<[i64; 3]>>,
    first: u64,
    window: Vec<NormalSum>,
    window_size: usize,
    parts: Option<(Vec<std::path::PathBuf>, Buckets<Part>)>,
    folder: std::path::PathBuf,
    vertices: u64,
    buffer_bytes: usize,
}

impl Sums {
    fn create(
        folder: &WorkFolder,
        account: &Account,
        memory_bytes: usize,
    ) -> Result<Sums, BuildError> {
        let file = folder.file(SUMS);
        let writer =
            (account.normals_lacking > 0).then(|| RecordWriter::create(&file)).transpose()?;
        Ok(Sums {
            needed: account.normals_lacking > 0,
            file,
            writer,
            first: 0,
            window: Vec::new(),
            window_size: 1,
            parts: None,
            folder: folder.file("survey-parts"),
            vertices: account.vertices,
            buffer_bytes: memory_bytes / 4,
        })
    }

    fn begin_window(&mut self, first: u64, count: usize) -> Result<(), BuildError> {
        if self.needed {
            self.flush()?;
            self.first = first;
            self.window_size = self.window_size.max(count);
            self.window = vec![NormalSum::default(); count];
        }
        Ok(())
    }

    fn begin_rest(&mut self) -> Result<(), BuildError> {
        if self.needed {
            self.flush()?;
            std::fs::create_dir_all(&self.folder)
                .map_err(BuildError::io(&self.folder, "create"))?;
            let count = (self.vertices as usize).div_ceil(self.window_size);
            let names: Vec<_> = (0..count).map(|i| self.folder.join(i.to_string())).collect();
            self.parts = Some((names.clone(), Buckets::create(names, self.buffer_bytes)?));
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), BuildError> {
        let sums: Vec<[i64; 3]> = std::mem::take(&mut self.window).iter().map(|s| s.0).collect();
        self.writer.as_mut().map_or(Ok(()), |writer| writer.put(&sums))
    }

    fn add(&mut self, batch: &[Joined<ScanVertex>]) -> Result<(), BuildError> {
        if !self.needed {
            return Ok(());
        }
        let corners = |t: &Joined<ScanVertex>| {
            NormalSum::of_corners(t.corners.map(|v| DVec3::from_array(v.position)))
        };
        let sums: Vec<[NormalSum; 3]> = batch.par_iter().map(corners).collect();
        for (t, sums) in batch.iter().zip(sums) {
            for (&vertex, sum) in t.vertices.iter().zip(sums) {
                match &mut self.parts {
                    None => self.window[(u64::from(vertex) - self.first) as usize].add(sum),
                    Some((_, parts)) => {
                        let part = Part { vertex: vertex.into(), sum: sum.0 };
                        parts.put(vertex as usize / self.window_size, part)?;
                    }
                }
            }
        }
        Ok(())
    }
}

/// Writes all vertices as they will be; gives their bounds.
fn place_vertices(
    folder: &WorkFolder,
    account: &Account,
    lattice: &Lattice,
    mut sums: Sums,
) -> Result<[[i32; 3]; 2], BuildError> {
    sums.flush()?;
    sums.writer.take().map(RecordWriter::finish).transpose()?;
    let parts = match sums.parts.take() {
        Some((names, buckets)) => {
            buckets.finish()?;
            names
        }
        None => Vec::new(),
    };
    let mut sum_reader =
        sums.needed.then(|| RecordReader::<[i64; 3]>::open(&sums.file)).transpose()?;
    let mut reader = RecordReader::<ScanVertex>::open(&folder.file(VERTICES))?;
    let ranges = account.ranges()?;
    let mut scalar_reader = match ranges.is_empty() {
        true => None,
        false => Some(RecordReader::<[f64; SCALARS_MAX]>::open(&folder.file(SCALARS))?),
    };
    let mut writer = RecordWriter::<PlacedVertex>::create(&folder.file(PLACED))?;
    let window = if sums.needed { sums.window_size } else { 1 << 16 };
    let mut bounds = [[i32::MAX; 3], [i32::MIN; 3]];
    let mut first = 0usize;
    while reader.left() > 0 {
        let mut computed = match &mut sum_reader {
            Some(reader) => reader.next(window)?,
            None => Vec::new(),
        };
        if let Some(parts) = parts.get(first / window) {
            let mut reader = RecordReader::<Part>::open(parts)?;
            while reader.left() > 0 {
                for part in reader.next(1 << 14)? {
                    let mut sum = NormalSum(computed[part.vertex as usize - first]);
                    sum.add(NormalSum(part.sum));
                    computed[part.vertex as usize - first] = sum.0;
                }
            }
        }
        let end = first + window.min(reader.left() as usize);
        while first < end {
            let batch = reader.next((end - first).min(1 << 16))?;
            let at = first % window;
            let numbers = match &mut scalar_reader {
                Some(reader) => reader.next(batch.len())?,
                None => Vec::new(),
            };
            let codes = |i: usize| {
                let mut codes = Scalars::default();
                for (k, range) in ranges.iter().enumerate() {
                    codes.0[k] = numbers.get(i).map_or(0, |numbers| range.code(numbers[k]));
                }
                codes
            };
            let place = |(i, v): (usize, &ScanVertex)| {
                let normal = if v.normal == [0.0; 3] {
                    NormalSum(computed[at + i]).normal().to_array()
                } else {
                    v.normal
                };
                PlacedVertex {
                    position: lattice.quantise(v.position),
                    normal: OctNormal::encode(normal),
                    colour: v.colour,
                    scalars: codes(i),
                }
            };
            let placed: Vec<PlacedVertex> = batch.par_iter().enumerate().map(place).collect();
            for v in &placed {
                let [lo, hi] = bounds;
                bounds = [
                    std::array::from_fn(|i| lo[i].min(v.position[i])),
                    std::array::from_fn(|i| hi[i].max(v.position[i])),
                ];
            }
            writer.put(&placed)?;
            first += placed.len();
        }
    }
    let written = writer.finish()?;
    debug_assert_eq!(written, account.vertices);
    if sums.needed {
        std::fs::remove_file(&sums.file).map_err(BuildError::io(&sums.file, "remove"))?;
    }
    if !parts.is_empty() {
        std::fs::remove_dir_all(&sums.folder).map_err(BuildError::io(&sums.folder, "remove"))?;
    }
    Ok(bounds)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron(flip: bool) -> Vec<[[i32; 3]; 3]> {
        let corners = [[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]];
        let mut triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        if flip {
            triangles.iter_mut().for_each(|t| t.swap(0, 1));
        }
        triangles.into_iter().map(|t| t.map(|v: usize| corners[v])).collect()
    }

    fn total(triangles: &[[[i32; 3]; 3]]) -> Totals {
        triangles.iter().map(Totals::of).fold(Totals::default(), Totals::plus)
    }

    #[test]
    fn only_closed_outward_surfaces_bound_a_volume() {
        assert!(total(&tetrahedron(false)).bounds_a_volume());
        assert_eq!(total(&tetrahedron(false)).volume, 729);
        assert!(!total(&tetrahedron(true)).bounds_a_volume());
        let mut open = tetrahedron(false);
        open.pop();
        assert!(!total(&open).bounds_a_volume());
        let mut inconsistent = tetrahedron(false);
        inconsistent[1].swap(0, 1);
        assert!(!total(&inconsistent).bounds_a_volume());
        // A needle without an area changes nothing and is counted.
        let mut more = tetrahedron(false);
        more.push([[1, 1, 1], [2, 2, 2], [1, 1, 1]]);
        assert!(total(&more).bounds_a_volume());
        assert_eq!(total(&more).degenerate, 1);
    }

    #[test]
    fn full_cells_and_what_holds_them_are_split() {
        let mut counts = vec![0; 64];
        counts[9] = 70;
        counts[10] = 40;
        counts[40] = 5;
        assert_eq!(plan(counts.clone(), 2, 100), [(0, 0), (1, 1)]);
        assert_eq!(plan(counts.clone(), 2, 50), [(0, 0), (1, 1), (2, 9)]);
        assert!(plan(counts, 2, 1000).is_empty());
    }
}
