//! One level of detail as a file for other programs: PLY or binary glTF.

mod glb;
mod ply;

use std::collections::{BTreeMap, BinaryHeap, HashMap};
use std::path::Path;

use hlod_compress::{
    CellKey, Header, HlodFile, Mesh, NodeRecord, PageContent, Representation, RepresentationKind,
    Scalars, decode_page,
};
use serde::Serialize;

use crate::error::BuildError;
use crate::output::check_output;
use crate::partition::Vertex;

/// Which nodes are exported; together they always cover the model once.
#[derive(Debug, Clone, Copy)]
pub enum Selection {
    /// Nodes of this depth, and leaves above it.
    Depth(u8),
    /// The coarsest nodes with at most this error, in the source's unit.
    Error(f64),
    /// As fine as this number of triangles, or points, allows: the node with the largest error is refined
    /// first. The root even if it has more.
    MaxTriangles(u64),
    /// The scan's own geometry.
    Leaves,
}

/// What was exported; the keys are stable.
#[derive(Debug, Serialize)]
pub struct ExportReport {
    /// Vertices written; points are vertices without triangles.
    pub vertices: u64,
    /// Triangles written.
    pub triangles: u64,
    /// Octree nodes they come from.
    pub nodes: u64,
    /// Largest geometric error among them, in the source's unit.
    pub error_max: f64,
    /// How far rounding to the output's `f32` moved vertices at most besides, in the source's unit; 0 for PLY.
    pub rounding_max: f64,
    /// Kept numbers that the output's format has no place for.
    pub left_out: Vec<String>,
}

/// What goes into an output.
struct Exported {
    /// Vertices that are equal in all they have are one; points are vertices without triangles.
    mesh: Mesh,
    header: Header,
    /// Largest geometric error among the nodes, in the source's unit.
    error_max: f64,
    /// Whose it is, line by line, where someone said it.
    about: Vec<String>,
}

impl Exported {
    /// How far from the scan's surface this is, in words.
    fn displacement(&self) -> String {
        let unit = self.header.unit.name();
        let step = self.header.lattice.step;
        format!("within {} of the scan file, leaves within {step} (unit: {unit})", self.error_max)
    }
}

/// Formats by the names' ends.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Ply,
    Glb,
}

impl Format {
    fn of(output: &Path) -> Result<Format, BuildError> {
        let end = output.extension().and_then(|end| end.to_str()).map(str::to_lowercase);
        match end.as_deref() {
            Some("ply") => Ok(Format::Ply),
            Some("glb") => Ok(Format::Glb),
            _ => Err(BuildError::Usage(format!(
                "{}: exports are .ply or .glb; name the output so",
                output.display()
            ))),
        }
    }
}

/// Writes part of `path` to `output`, whose name's end says the format. PLY: binary, positions as `double` in
/// source coordinates, normals, colours where there are any, kept numbers as `double`, NaN where there is
/// none. GLB: in metres where the unit is declared, +y up and +z to the front, positions as `f32` about
/// their middle, normals, linear colours.
///
/// # Errors
/// When the file is damaged, the output's name tells no format, or the output exists (without `force`) or cannot
/// be written.
pub fn export(
    path: &Path,
    output: &Path,
    selection: Selection,
    kind: RepresentationKind,
    force: bool,
) -> Result<ExportReport, BuildError> {
    let format = Format::of(output)?;
    check_output(&[path.to_owned()], output, force)?;
    let file = HlodFile::open(path).map_err(BuildError::format(path))?;
    let nodes = file.read_skeleton().map_err(BuildError::format(path))?;
    let nodes: BTreeMap<CellKey, NodeRecord> = nodes.into_iter().map(|n| (n.cell, n)).collect();
    let front = front(&nodes, selection, kind);
    let exported = collect(&file, path, front.iter().map(|cell| &nodes[cell]), kind)?;
    let target = (output, force);
    let (rounding_max, left_out) = match format {
        Format::Ply => (ply::write(&exported, target).map(|()| 0.0)?, Vec::new()),
        Format::Glb => {
            let left_out = exported.header.scalars().map(|(name, _)| name.to_owned()).collect();
            (glb::write(&exported, target)?, left_out)
        }
    };
    Ok(ExportReport {
        vertices: exported.mesh.positions.len() as u64,
        triangles: exported.mesh.triangles.len() as u64,
        nodes: front.len() as u64,
        error_max: exported.error_max,
        rounding_max,
        left_out,
    })
}

/// Reads the pages of nodes and welds them: neighbours share their borders.
fn collect<'a>(
    file: &HlodFile,
    path: &Path,
    nodes: impl Iterator<Item = &'a NodeRecord>,
    kind: RepresentationKind,
) -> Result<Exported, BuildError> {
    let mut mesh = Mesh::default();
    let mut index_of: HashMap<Vertex, u32> = HashMap::new();
    let mut error_max = 0.0f64;
    let header = file.header().clone();
    let keeps_numbers = header.scalars().next().is_some();
    for node in nodes {
        let Some(representation) = node.representation(kind) else { continue };
        let page = file.read_page(representation.page).map_err(BuildError::format(path))?;
        let PageContent { mesh: mut part, mut points } =
            decode_page(&page).map_err(BuildError::format(path))?;
        if keeps_numbers {
            // Pages without any value say nothing of them.
            part.scalars.resize(part.positions.len(), Scalars::default());
            points.scalars.resize(points.positions.len(), Scalars::default());
        }
        mesh.scalars.extend(points.scalars);
        mesh.positions.extend(points.positions);
        mesh.normals.extend(points.normals);
        mesh.colours.extend(points.colours);
        let new_from_old: Vec<u32> = (0..part.positions.len() as u32)
            .map(|v| {
                let vertex = Vertex::of(&part, v);
                *index_of.entry(vertex).or_insert_with(|| vertex.push_to(&mut mesh))
            })
            .collect();
        mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|v| new_from_old[v as usize])));
        error_max = error_max.max(f64::from(representation.errors.geometric));
    }
    let metadata = file.read_metadata().map_err(BuildError::format(path))?;
    let said = metadata.map(|metadata| metadata.lines()).unwrap_or_default();
    let is_whose = |name: &str| ["title", "holder", "credit", "rights"].contains(&name);
    let about = said.into_iter().filter(|(name, _)| is_whose(name));
    let about = about.map(|(name, text)| format!("{name}: {text}")).collect();
    Ok(Exported { mesh, header, error_max, about })
}

/// The cells to export, in order.
fn front(
    nodes: &BTreeMap<CellKey, NodeRecord>,
    selection: Selection,
    kind: RepresentationKind,
) -> Vec<CellKey> {
    let error = |n: &NodeRecord| n.representation(kind).map_or(0.0, |r| r.errors.geometric);
    let primitives = |r: &Representation| u64::from(r.triangles) + u64::from(r.points);
    let triangles = |n: &NodeRecord| n.representation(kind).map_or(0, primitives);
    let children = |n: &NodeRecord| -> Vec<&NodeRecord> {
        let octants = (0..8).filter(|o| n.child_mask >> o & 1 == 1);
        octants.filter_map(|o| nodes.get(&n.cell.child(o))).collect()
    };
    let root = &nodes[&CellKey::ROOT];
    let mut out = Vec::new();
    if let Selection::MaxTriangles(limit) = selection {
        // Errors are finite and not negative, so their bits order like they do.
        let key = |n: &NodeRecord| (error(n).to_bits(), n.cell);
        let mut heap = BinaryHeap::from([key(root)]);
        let mut total = triangles(root);
        while let Some((_, cell)) = heap.pop() {
            let node = &nodes[&cell];
            let finer =
                total - triangles(node) + children(node).iter().map(|c| triangles(c)).sum::<u64>();
            if node.is_leaf() || finer > limit {
                out.push(cell);
            } else {
                total = finer;
                heap.extend(children(node).into_iter().map(key));
            }
        }
    } else {
        let mut pending = vec![root];
        while let Some(node) = pending.pop() {
            let enough = match selection {
                Selection::Depth(depth) => node.cell.depth() >= depth,
                Selection::Error(limit) => f64::from(error(node)) <= limit,
                Selection::Leaves | Selection::MaxTriangles(_) => false,
            };
            if node.is_leaf() || enough {
                out.push(node.cell);
            } else {
                pending.extend(children(node));
            }
        }
    }
    out.sort();
    out
}
