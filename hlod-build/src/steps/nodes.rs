//! Nodes of a part of the octree: subtrees from the scan's triangles, nodes above from those below,
//! and the two files in which either is kept.
//!
//! `pages-…` holds pages one after the other. `nodes-…` holds what is odd about the scan there, a
//! table of the pieces that levels above gather, the pieces, and the records, whose pages' offsets
//! count in the other file.

use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use bytemuck::{Pod, Zeroable};
use hlod_compress::{CellKey, FormatError, Mesh, NodeRecord, OctNormal};
use rayon::prelude::*;

use super::scatter::{CutTriangle, PlacedPoint, Subtree};
use super::work_folder::WorkFolder;
use crate::borders::Cube;
use crate::certificate::{Carried, Deviation};
use crate::cone::ConeBuilder;
use crate::error::BuildError;
use crate::hierarchy::{
    BuiltNode, NodeError, Piece, Pieces, Setting, build_inner, build_leaf, build_subtree,
};
use crate::oddities::Oddities;
use crate::partition::{Leaf, Vertex, cut_into_leaves};
use crate::points::{Point, cloud};
use crate::simplify::Source;
use crate::spill::RecordReader;
use crate::system::give_back_memory;

/// Names of the step for a cell and of its files.
pub(crate) struct Names {
    pub(crate) step: String,
    pub(crate) nodes: String,
    pub(crate) pages: String,
}

impl Names {
    /// Of the part whose topmost node is `cell`.
    pub(crate) fn of(cell: CellKey) -> Names {
        let name = |what: &str| format!("{what}-{}-{}", cell.depth(), cell.morton());
        Names { step: name("build"), nodes: name("nodes"), pages: name("pages") }
    }
}

/// Builds a subtree and writes it.
pub(crate) fn build_subtree_step(
    folder: &WorkFolder,
    subtree: &Subtree,
    leaf_triangles: usize,
    setting: &Setting<'_>,
) -> Result<(), BuildError> {
    let cell = subtree.cell();
    let names = Names::of(cell);
    folder.step(&names.step, &[&names.nodes, &names.pages], || {
        let path = folder.file(&subtree.file());
        let (leaves, oddities) = if setting.is_cloud {
            (cloud_leaves(cell, &path, leaf_triangles, setting), Oddities::default())
        } else {
            surface_leaves(cell, load(&path, setting)?, leaf_triangles, setting)
        };
        let leaves = leaves.map_err(|error| said(error, folder))?;
        let (nodes, pieces) = build_subtree(cell, leaves, subtree.triangles, setting)
            .map_err(|error| said(error, folder))?;
        write(folder, &names, nodes, &pieces, oddities)
    })
}

type Leaves = Result<Vec<(BuiltNode, Piece)>, NodeError>;

/// The leaves of a subtree, and what is odd about its triangles.
fn surface_leaves(
    cell: CellKey,
    mesh: Mesh,
    leaf_triangles: usize,
    setting: &Setting<'_>,
) -> (Leaves, Oddities) {
    let leaves = cut_into_leaves(cell, mesh, &setting.lattice, leaf_triangles);
    let of_leaf = |leaf: &Leaf| {
        let lattice = &setting.lattice;
        let units = lattice.cell_units(leaf.cell.depth());
        Oddities::of_leaf(&leaf.mesh, &Cube { min: lattice.cell_min(leaf.cell), units })
    };
    let oddities = leaves.par_iter().map(of_leaf).reduce(Oddities::default, Oddities::plus);
    (leaves.into_par_iter().map(|leaf| build_leaf(leaf, setting)).collect(), oddities)
}

/// The leaves of a subtree of a point cloud.
fn cloud_leaves(cell: CellKey, path: &Path, leaf_points: usize, setting: &Setting<'_>) -> Leaves {
    let points = load_points(path).map_err(NodeError::Build)?;
    let leaves = cloud::split_into_leaves(cell, points, &setting.lattice, leaf_points);
    leaves.into_par_iter().map(|leaf| cloud::build_leaf(leaf, setting)).collect()
}

/// Builds one node from what is below and writes it.
pub(crate) fn build_upper_step(
    folder: &WorkFolder,
    cell: CellKey,
    parts: &[CellKey],
    setting: &Setting<'_>,
) -> Result<(), BuildError> {
    let names = Names::of(cell);
    folder.step(&names.step, &[&names.nodes, &names.pages], || {
        let files = parts.iter().map(|&part| folder.file(&Names::of(part).nodes));
        let files: Vec<PathBuf> = files.collect();
        // What will be gathered: leaves a level below, everything two levels below.
        let (mut gathered, mut loaded) = (0, 0);
        let deepest = cell.depth() + 2;
        for file in &files {
            for row in PartFile::open(file)?.table {
                let deep = row.depth == u64::from(deepest);
                let is_used = deep || row.is_leaf != 0 && row.depth < u64::from(deepest);
                gathered += if is_used { row.triangles } else { 0 };
                loaded += if row.depth <= u64::from(deepest) { row.triangles } else { 0 };
            }
        }
        let needed = setting.node_bytes(gathered) + loaded * PIECE_BYTES_A_TRIANGLE;
        let _admitted = setting.admit(needed).map_err(|error| said(error, folder))?;
        let mut pieces = Pieces::new();
        for file in &files {
            PartFile::open(file)?.pieces(deepest, &mut pieces)?;
        }
        let (node, piece) =
            build_inner(cell, &pieces, setting).map_err(|error| said(error, folder))?;
        drop(pieces);
        let pieces = Pieces::from([(cell, piece)]);
        write(folder, &names, vec![node], &pieces, Oddities::default())
    })
}

/// Of a piece in memory; of a point it is less.
const PIECE_BYTES_A_TRIANGLE: u64 = 60;

fn said(error: NodeError, folder: &WorkFolder) -> BuildError {
    match error {
        NodeError::Format(FormatError::TooLarge { count, unit, limit, .. }) => {
            BuildError::NodeTooLarge { path: folder.file(""), count, unit, limit }
        }
        NodeError::Format(error) => BuildError::format(&folder.file(""))(error),
        NodeError::Memory { needed_bytes, budget_bytes } => BuildError::Memory {
            path: folder.file(""),
            why: "one node has to be simplified as a whole",
            needed_bytes,
            budget_bytes,
        },
        NodeError::Build(error) => error,
        NodeError::Stopped => BuildError::Stopped(folder.file("")),
    }
}

/// A cell's triangles in the order of the scan, equal vertices joined.
fn load(path: &Path, setting: &Setting<'_>) -> Result<Mesh, BuildError> {
    let mut pieces: Vec<CutTriangle> = RecordReader::all(path)?;
    // Stable: pieces of one triangle keep their order.
    pieces.sort_by_key(|piece| piece.triangle);
    let mut mesh = Mesh::default();
    let mut index_of = std::collections::HashMap::with_capacity(pieces.len());
    for piece in pieces {
        let triangle = piece.corners.map(|v| {
            let colour = setting.has_colours.then_some(v.colour);
            let scalars = setting.has_scalars.then_some(v.scalars);
            let vertex = Vertex { position: v.position, normal: v.normal, colour, scalars };
            *index_of.entry(vertex).or_insert_with(|| vertex.push_to(&mut mesh))
        });
        mesh.triangles.push(triangle);
    }
    Ok(mesh)
}

/// A cell's points in the order of the scan.
fn load_points(path: &Path) -> Result<Vec<Point>, BuildError> {
    let mut placed: Vec<PlacedPoint> = RecordReader::all(path)?;
    placed.sort_unstable_by_key(|point| point.index);
    let point = |PlacedPoint { vertex, .. }: PlacedPoint| Point {
        position: vertex.position,
        normal: vertex.normal,
        colour: vertex.colour,
        weight: 1,
        scalars: vertex.scalars,
        reach: 0.0,
        moved: 0.0,
        turned: 0.0,
    };
    Ok(placed.into_iter().map(point).collect())
}

fn write(
    folder: &WorkFolder,
    names: &Names,
    nodes: Vec<BuiltNode>,
    pieces: &Pieces,
    oddities: Oddities,
) -> Result<(), BuildError> {
    let path = folder.file(&names.pages);
    let file = std::fs::File::create(&path).map_err(BuildError::io(&path, "create"))?;
    let mut pages = std::io::BufWriter::new(file);
    let mut offset = 0;
    let mut records = Writer::default();
    records.count(nodes.len());
    for BuiltNode { mut record, pages: of_node } in nodes {
        for (representation, page) in record.representations.iter_mut().zip(of_node) {
            representation.page.offset = offset;
            offset += page.len() as u64;
            pages.write_all(&page).map_err(BuildError::io(&path, "write"))?;
        }
        records.array(&record.to_bytes());
    }
    pages.flush().map_err(BuildError::io(&path, "write"))?;
    let blobs: Vec<Vec<u8>> = pieces
        .values()
        .map(|piece| {
            let mut blob = Writer::default();
            blob.piece(piece);
            blob.0
        })
        .collect();
    let mut out = Writer::default();
    let row = |((cell, piece), blob): ((&CellKey, &Piece), &Vec<u8>)| Row {
        depth: cell.depth().into(),
        morton: cell.morton(),
        is_leaf: piece.is_leaf.into(),
        triangles: piece.primitives() as u64,
        bytes: blob.len() as u64,
    };
    out.0.extend_from_slice(bytemuck::bytes_of(&oddities.to_array()));
    out.array(&pieces.iter().zip(&blobs).map(row).collect::<Vec<_>>());
    blobs.iter().for_each(|blob| out.0.extend_from_slice(blob));
    out.0.extend_from_slice(&records.0);
    let path = folder.file(&names.nodes);
    std::fs::write(&path, out.0).map_err(BuildError::io(&path, "write"))?;
    give_back_memory();
    Ok(())
}

/// What the table says of a piece; pieces follow in the same order, then the records.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Row {
    depth: u64,
    morton: u64,
    is_leaf: u64,
    /// Or points.
    triangles: u64,
    bytes: u64,
}

/// A part's file, open behind its table.
struct PartFile<'a> {
    path: &'a Path,
    file: std::fs::File,
    oddities: Oddities,
    table: Vec<Row>,
}

impl PartFile<'_> {
    fn open(path: &Path) -> Result<PartFile<'_>, BuildError> {
        let mut file = std::fs::File::open(path).map_err(BuildError::io(path, "open"))?;
        let (mut oddities, mut count) = ([0u64; 4], [0; 8]);
        file.read_exact(bytemuck::bytes_of_mut(&mut oddities))
            .and_then(|()| file.read_exact(&mut count))
            .map_err(BuildError::io(path, "read"))?;
        // A subtree has nine pieces at most: its root and the root's children.
        let count = u64::from_le_bytes(count);
        if count > 9 {
            return Err(BuildError::Work { path: path.to_owned() });
        }
        let mut table = vec![Row::zeroed(); count as usize];
        let bytes = bytemuck::cast_slice_mut(&mut table);
        file.read_exact(bytes).map_err(BuildError::io(path, "read"))?;
        Ok(PartFile { path, file, oddities: Oddities::from_array(oddities), table })
    }

    /// The pieces down to a depth.
    fn pieces(mut self, deepest: u8, into: &mut Pieces) -> Result<(), BuildError> {
        for row in &self.table {
            if row.depth > u64::from(deepest) {
                let skipped = self.file.seek(SeekFrom::Current(row.bytes as i64));
                skipped.map_err(BuildError::io(self.path, "read"))?;
                continue;
            }
            let mut bytes = Vec::new();
            let mut of_piece = (&self.file).take(row.bytes);
            of_piece.read_to_end(&mut bytes).map_err(BuildError::io(self.path, "read"))?;
            let cell = CellKey::from_parts(row.depth as u8, row.morton)
                .map_err(BuildError::format(self.path))?;
            let mut reader = Reader { rest: &bytes, path: self.path };
            into.insert(cell, reader.piece(row.is_leaf != 0)?);
        }
        Ok(())
    }
}

/// The records of a part, and what is odd in it.
pub(crate) fn read_records(path: &Path) -> Result<(Vec<NodeRecord>, Oddities), BuildError> {
    let PartFile { mut file, table, oddities, .. } = PartFile::open(path)?;
    let pieces: u64 = table.iter().map(|row| row.bytes).sum();
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Current(pieces as i64))
        .and_then(|_| file.read_to_end(&mut bytes))
        .map_err(BuildError::io(path, "read"))?;
    let mut reader = Reader { rest: &bytes, path };
    Ok((reader.records()?, oddities))
}

/// Arrays of plain numbers, each with its length in front.
#[derive(Default)]
struct Writer(Vec<u8>);

impl Writer {
    fn count(&mut self, count: usize) {
        self.0.extend((count as u64).to_le_bytes());
    }

    fn array<T: bytemuck::NoUninit>(&mut self, values: &[T]) {
        self.count(values.len());
        self.0.extend_from_slice(bytemuck::cast_slice(values));
    }

    fn piece(&mut self, piece: &Piece) {
        let Piece { source, points, cone, bounds, is_leaf: _ } = piece;
        let Source { mesh, carried, smoothing, border } = source;
        self.array(&[*smoothing]);
        self.array(&[*border]);
        self.array(cone.bins());
        self.array(bounds);
        self.array(&mesh.positions);
        self.array(&mesh.normals);
        self.array(&mesh.colours);
        self.array(&mesh.scalars);
        self.array(&mesh.triangles);
        let numbers = |d: Deviation| [d.distance, f64::from(d.angle)];
        let carried: Vec<[[f64; 2]; 2]> =
            carried.iter().map(|c| [numbers(c.forward), numbers(c.backward)]).collect();
        self.array(&carried);
        self.array(points);
    }
}

struct Reader<'a> {
    rest: &'a [u8],
    path: &'a Path,
}

impl Reader<'_> {
    fn damaged(&self) -> BuildError {
        BuildError::Work { path: self.path.to_owned() }
    }

    fn take(&mut self, count: usize) -> Result<&[u8], BuildError> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or_else(|| self.damaged())?;
        self.rest = rest;
        Ok(taken)
    }

    fn count(&mut self) -> Result<usize, BuildError> {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(self.take(8)?);
        usize::try_from(u64::from_le_bytes(bytes)).map_err(|_| self.damaged())
    }

    fn array<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
        &mut self,
    ) -> Result<Vec<T>, BuildError> {
        let count = self.count()?;
        let bytes = count.checked_mul(size_of::<T>()).ok_or_else(|| self.damaged())?;
        let bytes = self.take(bytes)?;
        let mut out = vec![T::zeroed(); count];
        bytemuck::cast_slice_mut(&mut out).copy_from_slice(bytes);
        Ok(out)
    }

    fn one<T: bytemuck::AnyBitPattern + bytemuck::NoUninit, const N: usize>(
        &mut self,
    ) -> Result<[T; N], BuildError> {
        let all = self.array::<T>()?;
        <[T; N]>::try_from(all).map_err(|_| self.damaged())
    }

    fn records(&mut self) -> Result<Vec<NodeRecord>, BuildError> {
        let count = self.count()?;
        (0..count)
            .map(|_| {
                let bytes = self.array::<u8>()?;
                NodeRecord::parse(&bytes).map_err(BuildError::format(self.path))
            })
            .collect()
    }

    fn piece(&mut self, is_leaf: bool) -> Result<Piece, BuildError> {
        let [smoothing] = self.one::<f32, 1>()?;
        let [border] = self.one::<f64, 1>()?;
        let cone = ConeBuilder::from_bins(self.one()?);
        let bounds = self.one::<[i32; 3], 2>()?;
        let mesh = Mesh {
            positions: self.array()?,
            normals: self.array::<OctNormal>()?,
            colours: self.array()?,
            scalars: self.array()?,
            triangles: self.array()?,
        };
        mesh.validate().map_err(|_| self.damaged())?;
        let deviation = |[distance, angle]: [f64; 2]| Deviation { distance, angle: angle as f32 };
        let carried = self.array::<[[f64; 2]; 2]>()?.into_iter().map(|[forward, backward]| {
            Carried { forward: deviation(forward), backward: deviation(backward) }
        });
        let source = Source { mesh, carried: carried.collect(), smoothing, border };
        Ok(Piece { source, points: self.array()?, is_leaf, cone, bounds })
    }
}
