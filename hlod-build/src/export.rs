//! One level of detail as a PLY file, for other programs.

use std::collections::{BTreeMap, BinaryHeap, HashMap};
use std::io::{BufWriter, Write};
use std::path::Path;

use hlod_compress::{
    CellKey, HlodFile, Mesh, NodeRecord, PageContent, Representation, RepresentationKind, Scalars,
    decode_page,
};
use serde::Serialize;

use crate::error::BuildError;
use crate::output::{Aside, check_output};
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
}

/// Writes part of `path` to the PLY file `output`: binary, positions as `double` in source
/// coordinates, normals, colours where there are any, kept numbers as `double`, NaN where there is none.
///
/// # Errors
/// When the file is damaged, or the output exists (without `force`) or cannot be written.
pub fn export(
    path: &Path,
    output: &Path,
    selection: Selection,
    kind: RepresentationKind,
    force: bool,
) -> Result<ExportReport, BuildError> {
    check_output(&[path.to_owned()], output, force)?;
    let file = HlodFile::open(path).map_err(BuildError::format(path))?;
    let nodes = file.read_skeleton().map_err(BuildError::format(path))?;
    let nodes: BTreeMap<CellKey, NodeRecord> = nodes.into_iter().map(|n| (n.cell, n)).collect();
    let front = front(&nodes, selection, kind);

    // Join vertices that are equal in every attribute: neighbours share their borders.
    let mut mesh = Mesh::default();
    let mut index_of: HashMap<Vertex, u32> = HashMap::new();
    let mut error_max = 0.0f64;
    for cell in &front {
        let Some(representation) = nodes[cell].representation(kind) else { continue };
        let page = file.read_page(representation.page).map_err(BuildError::format(path))?;
        let PageContent { mesh: mut part, mut points } =
            decode_page(&page).map_err(BuildError::format(path))?;
        if file.header().scalars().next().is_some() {
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

    write_ply(&mesh, &file, (output, force), error_max)?;
    Ok(ExportReport {
        vertices: mesh.positions.len() as u64,
        triangles: mesh.triangles.len() as u64,
        nodes: front.len() as u64,
        error_max,
    })
}

/// A name without what would end it in a PLY header: files come from anywhere.
fn property_name(name: &str) -> String {
    name.chars().map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c }).collect()
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

fn write_ply(
    mesh: &Mesh,
    file: &HlodFile,
    (output, force): (&Path, bool),
    error_max: f64,
) -> Result<(), BuildError> {
    let aside = Aside::create(output)?;
    let mut out = BufWriter::with_capacity(1 << 20, aside.file());
    let lattice = file.header().lattice;
    let write = |out: &mut BufWriter<&std::fs::File>| -> std::io::Result<()> {
        writeln!(out, "ply\nformat binary_little_endian 1.0")?;
        writeln!(
            out,
            "comment within {error_max} {} of the scan file, leaves within {}",
            file.header().unit.name(),
            lattice.step
        )?;
        writeln!(out, "element vertex {}", mesh.positions.len())?;
        for axis in ["x", "y", "z"] {
            writeln!(out, "property double {axis}")?;
        }
        for axis in ["nx", "ny", "nz"] {
            writeln!(out, "property float {axis}")?;
        }
        if mesh.has_colours() {
            for channel in ["red", "green", "blue", "alpha"] {
                writeln!(out, "property uchar {channel}")?;
            }
        }
        for (name, _) in file.header().scalars() {
            writeln!(out, "property double {}", property_name(name))?;
        }
        if !mesh.triangles.is_empty() {
            writeln!(out, "element face {}", mesh.triangles.len())?;
            writeln!(out, "property list uchar int vertex_indices")?;
        }
        writeln!(out, "end_header")?;
        for v in 0..mesh.positions.len() {
            for value in lattice.position(mesh.positions[v]) {
                out.write_all(&value.to_le_bytes())?;
            }
            for value in mesh.normals[v].decode() {
                out.write_all(&value.to_le_bytes())?;
            }
            if let Some(colour) = mesh.colours.get(v) {
                out.write_all(colour)?;
            }
            for (k, (_, range)) in file.header().scalars().enumerate() {
                let code = mesh.scalars.get(v).map_or(0, |scalars| scalars.0[k]);
                out.write_all(&range.value(code).unwrap_or(f64::NAN).to_le_bytes())?;
            }
        }
        for triangle in &mesh.triangles {
            out.write_all(&[3])?;
            for index in triangle {
                out.write_all(&index.to_le_bytes())?;
            }
        }
        out.flush()
    };
    write(&mut out).map_err(BuildError::io(output, "write"))?;
    drop(out);
    aside.commit(output, force)
}
