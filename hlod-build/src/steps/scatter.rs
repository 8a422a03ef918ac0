//! Cuts the scan's triangles into the cells of the subtrees, or sorts its points into them.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::PathBuf;

use bytemuck::{Pod, Zeroable};
use hlod_compress::{CellKey, Lattice, Mesh};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::ingest::{Account, TRIANGLES};
use super::join::{Event, join};
use super::survey::{PLACED, PlacedVertex, Survey};
use super::work_folder::WorkFolder;
use crate::error::BuildError;
use crate::partition::{Vertex, octants};
use crate::points::cloud::octant_of;
use crate::progress::{Progress, Unit};
use crate::spill::{RecordReader, append_records};

pub(crate) const PLAN: &str = "plan.json";

/// A piece of a triangle of the scan.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct CutTriangle {
    /// Number of the triangle that it was cut from. Pieces of one triangle come in a fixed order.
    pub(crate) triangle: u64,
    pub(crate) corners: [PlacedVertex; 3],
    padding: u32,
}

/// A point of the scan.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct PlacedPoint {
    /// Its number in the scan.
    pub(crate) index: u64,
    pub(crate) vertex: PlacedVertex,
    padding: u32,
}

/// A subtree to be built.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Subtree {
    depth: u8,
    morton: u64,
    /// Of a point cloud, points.
    pub(crate) triangles: u64,
}

impl Subtree {
    pub(crate) fn new(cell: CellKey, triangles: u64) -> Subtree {
        Subtree { depth: cell.depth(), morton: cell.morton(), triangles }
    }

    pub(crate) fn cell(&self) -> CellKey {
        CellKey::from_parts(self.depth, self.morton).expect("it was written from a cell")
    }

    /// The file of its triangles.
    pub(crate) fn file(&self) -> String {
        file_of(self.cell())
    }
}

fn file_of(cell: CellKey) -> String {
    format!("cell-{}-{}", cell.depth(), cell.morton())
}

/// Does the step unless it is done; subtrees come in the order of their cells.
pub(crate) fn scatter(
    folder: &WorkFolder,
    survey: &Survey,
    account: &Account,
    subtree_triangles: u64,
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Vec<Subtree>, BuildError> {
    let plan_file = folder.file(PLAN);
    if !folder.is_done("scatter") {
        let counts = if account.is_cloud {
            progress.begin("partition", account.vertices, Unit::Points);
            sort_all(folder, survey, memory_bytes, progress)?
        } else {
            progress.begin("partition", account.triangles, Unit::Triangles);
            cut_all(folder, survey, memory_bytes, progress)?
        };
        let lattice = survey.lattice();
        let split: SplitFile = if account.is_cloud { split_points } else { split_triangles };
        let counts = split_full(folder, &lattice, counts, subtree_triangles, memory_bytes, split)?;
        let subtrees = counts.into_iter().map(|(cell, triangles)| Subtree::new(cell, triangles));
        let subtrees: Vec<Subtree> = subtrees.collect();
        super::write_json(&plan_file, &subtrees)?;
        let files: Vec<String> = subtrees.iter().map(Subtree::file).collect();
        let files: Vec<&str> =
            files.iter().map(String::as_str).chain(std::iter::once(PLAN)).collect();
        folder.finish_step("scatter", &files)?;
        progress.end();
    }
    read_plan(folder)
}

/// The subtrees of a step that is done.
pub(crate) fn read_plan(folder: &WorkFolder) -> Result<Vec<Subtree>, BuildError> {
    super::read_json(&folder.file(PLAN))
}

/// How many pieces each cell has.
type Counts = BTreeMap<CellKey, u64>;

fn cells_to_split(folder: &WorkFolder, survey: &Survey) -> Result<HashSet<CellKey>, BuildError> {
    let split = survey.split.iter().map(|&(depth, morton)| CellKey::from_parts(depth, morton));
    split.collect::<Result<HashSet<_>, _>>().map_err(BuildError::format(&folder.file(PLAN)))
}

fn sort_all(
    folder: &WorkFolder,
    survey: &Survey,
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Counts, BuildError> {
    let (lattice, split) = (survey.lattice(), cells_to_split(folder, survey)?);
    let mut cells = Cells::new(folder, memory_bytes / 4);
    let mut reader = RecordReader::<PlacedVertex>::open(&folder.file(PLACED))?;
    let mut index = 0;
    while reader.left() > 0 {
        folder.check_stop(progress)?;
        let batch = reader.next(1 << 16)?;
        progress.advance(batch.len() as u64);
        for vertex in batch {
            let point = PlacedPoint { index, vertex, padding: 0 };
            cells.put(cell_of(&point, CellKey::ROOT, &split, &lattice), point)?;
            index += 1;
        }
    }
    cells.finish()
}

/// The cell that is not split in which a point lies.
fn cell_of(
    point: &PlacedPoint,
    mut cell: CellKey,
    split: &HashSet<CellKey>,
    lattice: &Lattice,
) -> CellKey {
    while split.contains(&cell) && cell.depth() < lattice.depth_max {
        cell = cell.child(octant_of(point.vertex.position, cell, lattice));
    }
    cell
}

fn cut_all(
    folder: &WorkFolder,
    survey: &Survey,
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Counts, BuildError> {
    let (lattice, split) = (survey.lattice(), cells_to_split(folder, survey)?);
    let mut cells = Cells::new(folder, memory_bytes / 4);
    let (placed, triangles) = (folder.file(PLACED), folder.file(TRIANGLES));
    join::<PlacedVertex>(
        &placed,
        &triangles,
        &folder.file("scatter-join"),
        memory_bytes / 2,
        |event| {
            let Event::Triangles(batch) = event else { return Ok(()) };
            folder.check_stop(progress)?;
            progress.advance(batch.len() as u64);
            let cut: Vec<Vec<(CellKey, CutTriangle)>> = batch
                .par_chunks(1 << 10)
                .map(|chunk| {
                    let mut out = Vec::with_capacity(chunk.len() + chunk.len() / 8);
                    for t in chunk {
                        let whole =
                            CutTriangle { triangle: t.index, corners: t.corners, padding: 0 };
                        route(whole, CellKey::ROOT, &split, &lattice, &mut out);
                    }
                    out
                })
                .collect();
            cut.into_iter().flatten().try_for_each(|(cell, piece)| cells.put(cell, piece))
        },
    )?;
    cells.finish()
}

/// Divides what is in the file of a cell among its octants.
type SplitFile =
    fn(&WorkFolder, CellKey, &Lattice, usize) -> Result<BTreeMap<CellKey, u64>, BuildError>;

/// Splits cells that are still too full, where the scan is very dense.
fn split_full(
    folder: &WorkFolder,
    lattice: &Lattice,
    mut counts: Counts,
    subtree_triangles: u64,
    memory_bytes: usize,
    split: SplitFile,
) -> Result<Counts, BuildError> {
    loop {
        let fullest = counts.iter().find(|(cell, count)| {
            **count > 2 * subtree_triangles && cell.depth() < lattice.depth_max
        });
        let Some((&cell, _)) = fullest else { return Ok(counts) };
        counts.remove(&cell);
        counts.extend(split(folder, cell, lattice, memory_bytes)?);
        let path = folder.file(&file_of(cell));
        std::fs::remove_file(&path).map_err(BuildError::io(&path, "remove"))?;
    }
}

fn split_triangles(
    folder: &WorkFolder,
    cell: CellKey,
    lattice: &Lattice,
    memory_bytes: usize,
) -> Result<Counts, BuildError> {
    let split = HashSet::from([cell]);
    split_records(folder, cell, memory_bytes, |piece, out| route(piece, cell, &split, lattice, out))
}

fn split_points(
    folder: &WorkFolder,
    cell: CellKey,
    lattice: &Lattice,
    memory_bytes: usize,
) -> Result<Counts, BuildError> {
    let split = HashSet::from([cell]);
    split_records(folder, cell, memory_bytes, |point, out: &mut Vec<(CellKey, PlacedPoint)>| {
        out.push((cell_of(&point, cell, &split, lattice), point));
    })
}

/// Puts what `divide` makes of each record of a cell's file into the files of other cells.
fn split_records<T: Pod + Send + Sync>(
    folder: &WorkFolder,
    cell: CellKey,
    memory_bytes: usize,
    divide: impl Fn(T, &mut Vec<(CellKey, T)>),
) -> Result<Counts, BuildError> {
    let mut cells = Cells::new(folder, memory_bytes / 4);
    let mut reader = RecordReader::<T>::open(&folder.file(&file_of(cell)))?;
    let mut out = Vec::new();
    while reader.left() > 0 {
        reader.next(1 << 14)?.into_iter().for_each(|record| divide(record, &mut out));
        out.drain(..).try_for_each(|(cell, piece)| cells.put(cell, piece))?;
    }
    cells.finish()
}

/// Cuts a triangle until every piece lies in one cell that is not split. Triangles without an area
/// are left out.
fn route(
    whole: CutTriangle,
    mut cell: CellKey,
    split: &HashSet<CellKey>,
    lattice: &Lattice,
    out: &mut Vec<(CellKey, CutTriangle)>,
) {
    let positions = whole.corners.map(|v| v.position);
    if positions[0] == positions[1] || positions[1] == positions[2] || positions[2] == positions[0]
    {
        return;
    }
    while split.contains(&cell) && cell.depth() < lattice.depth_max {
        let half = (lattice.cell_units(cell.depth()) / 2) as i32;
        let centre = lattice.cell_min(cell).map(|c| c + half);
        let mut octant = 0;
        for (axis, &plane) in centre.iter().enumerate() {
            // As [`cut`] decides: what lies in the plane goes below.
            if positions.iter().all(|p| p[axis] <= plane) {
            } else if positions.iter().all(|p| p[axis] >= plane) {
                octant |= 1 << axis;
            } else {
                return route_pieces(&whole, cell, split, lattice, out);
            }
        }
        cell = cell.child(octant);
    }
    out.push((cell, whole));
}

/// The same for a triangle that has to be cut.
fn route_pieces(
    whole: &CutTriangle,
    cell: CellKey,
    split: &HashSet<CellKey>,
    lattice: &Lattice,
    out: &mut Vec<(CellKey, CutTriangle)>,
) {
    let mut mesh = Mesh::default();
    for v in whole.corners {
        let (colour, scalars) = (Some(v.colour), Some(v.scalars));
        Vertex { position: v.position, normal: v.normal, colour, scalars }.push_to(&mut mesh);
    }
    mesh.triangles.push([0, 1, 2]);
    for (octant, part) in octants(mesh, lattice, cell) {
        for t in &part.triangles {
            let corners = t.map(|v| PlacedVertex {
                position: part.positions[v as usize],
                normal: part.normals[v as usize],
                colour: part.colours[v as usize],
                scalars: part.scalars[v as usize],
            });
            let piece = CutTriangle { corners, ..*whole };
            route(piece, cell.child(octant), split, lattice, out);
        }
    }
}

/// Files of cells that turn up as triangles or points come.
struct Cells<'a, T> {
    folder: &'a WorkFolder,
    pending: HashMap<CellKey, Vec<T>>,
    counts: BTreeMap<CellKey, u64>,
    pending_count: usize,
    pending_max: usize,
}

impl<'a, T: Pod + Send + Sync> Cells<'a, T> {
    fn new(folder: &'a WorkFolder, bytes: usize) -> Self {
        Cells {
            folder,
            pending: HashMap::new(),
            counts: BTreeMap::new(),
            pending_count: 0,
            // Vectors grow by doubling.
            pending_max: (bytes / size_of::<T>() / 2).max(1),
        }
    }

    fn put(&mut self, cell: CellKey, piece: T) -> Result<(), BuildError> {
        self.pending.entry(cell).or_default().push(piece);
        self.pending_count += 1;
        if self.pending_count >= self.pending_max { self.append() } else { Ok(()) }
    }

    fn append(&mut self) -> Result<(), BuildError> {
        // A file each, so that all threads can write.
        let pending: Vec<(CellKey, Vec<T>)> = self.pending.drain().collect();
        pending.par_iter().try_for_each(|(cell, pieces)| {
            let path: PathBuf = self.folder.file(&file_of(*cell));
            // A file of that name may be left of a run that was stopped.
            append_records(&path, pieces, !self.counts.contains_key(cell))
        })?;
        for (cell, pieces) in pending {
            *self.counts.entry(cell).or_default() += pieces.len() as u64;
        }
        self.pending_count = 0;
        Ok(())
    }

    fn finish(mut self) -> Result<BTreeMap<CellKey, u64>, BuildError> {
        self.append()?;
        Ok(self.counts)
    }
}
