//! The octree of levels of detail, from the leaves up.
//!
//! A node gathers the simplified geometry two levels below (Guthe et al. 2004, section 3) — a
//! child that is a leaf gives its own — and simplifies what that adds to. What each
//! triangle is known to be wrong by travels with it: a level adds its own step.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use hlod_compress::{
    BoundStatus, CellKey, Children, Errors, FormatError, Lattice, Mesh, NodeFlags, NodeRecord,
    NormalCone, PageRef, Representation, RepresentationKind, encode_mesh,
};
use rayon::prelude::*;

use crate::borders::Cube;
use crate::certificate::Carried;
use crate::cone::ConeBuilder;
use crate::partition::{Leaf, Vertex};
use crate::progress::Progress;
use crate::seams::close_seams;
use crate::simplify::{Both, Budget, Simplified, Source, simplify};

/// A node with its pages' bytes, ready to be laid out.
pub struct BuiltNode {
    /// The record; page offsets and places of children are not known yet.
    pub record: NodeRecord,
    /// One page for each of the record's representations.
    pub pages: Vec<Vec<u8>>,
}

/// Simplified geometry that levels above still need.
type Level = HashMap<CellKey, Source>;

/// Number of inner nodes above these leaves.
pub fn inner_node_count(leaves: &[Leaf]) -> u64 {
    ancestors(leaves).len() as u64
}

fn ancestors(leaves: &[Leaf]) -> BTreeSet<CellKey> {
    let mut cells = BTreeSet::new();
    for leaf in leaves {
        let mut cell = leaf.cell.parent();
        while let Some(inner) = cell.filter(|&c| cells.insert(c)) {
            cell = inner.parent();
        }
    }
    cells
}

/// Simplifies bottom-up and encodes every node.
///
/// # Errors
/// When a node is larger than a page may be.
pub fn build_hierarchy(
    leaves: Vec<Leaf>,
    lattice: &Lattice,
    resolution: u32,
    closed_oriented: bool,
    progress: &dyn Progress,
) -> Result<Vec<BuiltNode>, FormatError> {
    let inner = ancestors(&leaves);
    let flags = NodeFlags { closed_oriented };

    let mut built: Vec<BuiltNode> = leaves
        .par_iter()
        .map(|leaf| encode_leaf(leaf, flags))
        .collect::<Result<_, FormatError>>()?;
    let leaves: HashMap<CellKey, Mesh> = leaves.into_iter().map(|l| (l.cell, l.mesh)).collect();
    // Cones and bounds of everything below, which a node's own must hold.
    let mut summaries: BTreeMap<CellKey, (ConeBuilder, [[i32; 3]; 2])> = built
        .iter()
        .map(|node| {
            let mesh = &leaves[&node.record.cell];
            (node.record.cell, (ConeBuilder::of_mesh(mesh), node.record.bounds))
        })
        .collect();

    let deepest = inner.iter().map(|c| c.depth()).max();
    // The two levels below the current one.
    let mut below: [Level; 2] = Default::default();
    for depth in (0..=deepest.unwrap_or(0)).rev() {
        let cells: Vec<CellKey> = inner.iter().copied().filter(|c| c.depth() == depth).collect();
        // All nodes of a depth are independent of one another.
        let results: Vec<[(Source, Representation, Vec<u8>); 2]> = cells
            .par_iter()
            .map(|&cell| {
                let mut source = gather(cell, &inner, &leaves, &below[1]);
                // Where two pieces meet, both may be wrong, and cutting rounded by up to a step.
                let width = 2.0 * source.distance() + 2.0;
                let cube =
                    Cube { min: lattice.cell_min(cell), units: lattice.cell_units(cell.depth()) };
                close_seams(&mut source, width, &cube);
                let budget = budget(cell, lattice, resolution, &source);
                let Both { appearance, geometric } = simplify(&source, &budget);
                let encode = |kind, simplified| encode_inner(kind, simplified, lattice, &budget);
                let out = [
                    encode(RepresentationKind::Appearance, appearance)?,
                    encode(RepresentationKind::Geometric, geometric)?,
                ];
                progress.advance(1);
                Ok(out)
            })
            .collect::<Result<_, FormatError>>()?;

        let mut level = Level::default();
        for (cell, both) in cells.into_iter().zip(results) {
            let mut pages = Vec::new();
            let mut representations = Vec::new();
            let mut summary: Option<(ConeBuilder, [[i32; 3]; 2])> = None;
            for octant in 0..8 {
                if let Some((cone, bounds)) = summaries.get(&cell.child(octant)) {
                    merge(&mut summary, cone.clone(), *bounds);
                }
            }
            for (source, representation, page) in both {
                if let Some((lo, hi)) = source.mesh.bounds() {
                    merge(&mut summary, ConeBuilder::of_mesh(&source.mesh), [lo, hi]);
                }
                representations.push(representation);
                pages.push(page);
                // The appearance is what levels above are made of.
                level.entry(cell).or_insert(source);
            }
            let (cone, bounds) = summary.expect("an inner node has children");
            let record = record(cell, flags, bounds, cone.finish(), representations);
            summaries.insert(cell, (cone, bounds));
            built.push(BuiltNode { record, pages });
        }
        let [one, _] = below;
        below = [level, one];
    }
    Ok(built)
}

fn merge(
    summary: &mut Option<(ConeBuilder, [[i32; 3]; 2])>,
    cone: ConeBuilder,
    bounds: [[i32; 3]; 2],
) {
    match summary {
        None => *summary = Some((cone, bounds)),
        Some((all, [lo, hi])) => {
            all.merge(&cone);
            for i in 0..3 {
                lo[i] = lo[i].min(bounds[0][i]);
                hi[i] = hi[i].max(bounds[1][i]);
            }
        }
    }
}

/// The error budget, edge ÷ resolution, less what the source already lost.
fn budget(cell: CellKey, lattice: &Lattice, resolution: u32, source: &Source) -> Budget {
    let cell_units = lattice.cell_units(cell.depth());
    let whole = f64::from(cell_units) / f64::from(resolution);
    // The largest step ≤ ε/8, and no larger than what still contains the cell's faces.
    let grid_shift = (whole / 8.0).log2().floor().max(0.0) as u8;
    Budget {
        whole,
        distance: Budget::left_by_most(whole, source),
        grid_shift: grid_shift.min(lattice.depth_max - cell.depth()),
        cell_min: lattice.cell_min(cell),
        cell_units,
    }
}

/// Geometry two levels below; vertices that are equal in every attribute are joined.
fn gather(
    cell: CellKey,
    inner: &BTreeSet<CellKey>,
    leaves: &HashMap<CellKey, Mesh>,
    two_below: &Level,
) -> Source {
    let mut out = Source::default();
    let mut index_of: HashMap<Vertex, u32> = HashMap::new();
    let mut add = |mesh: &Mesh, from: Option<&Source>| {
        let joined = &mut out.mesh;
        let new_from_old: Vec<u32> = (0..mesh.positions.len() as u32)
            .map(|v| {
                let vertex = Vertex::of(mesh, v);
                *index_of.entry(vertex).or_insert_with(|| vertex.push_to(joined))
            })
            .collect();
        joined.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| new_from_old[v as usize])));
        if let Some(from) = from {
            out.carried.extend(&from.carried);
            out.smoothing = out.smoothing.max(from.smoothing);
        }
        // Leaves are the original: they carry nothing.
        out.carried.resize(joined.triangles.len(), Carried::default());
    };
    for octant in 0..8 {
        let child = cell.child(octant);
        if let Some(mesh) = leaves.get(&child) {
            add(mesh, None);
        } else if inner.contains(&child) {
            for octant in 0..8 {
                let grandchild = child.child(octant);
                if let Some(mesh) = leaves.get(&grandchild) {
                    add(mesh, None);
                } else if let Some(source) = two_below.get(&grandchild) {
                    add(&source.mesh, Some(source));
                }
            }
        }
    }
    out
}

fn encode_leaf(leaf: &Leaf, flags: NodeFlags) -> Result<BuiltNode, FormatError> {
    let page = encode_mesh(&leaf.mesh, 0)?;
    let representation =
        representation(RepresentationKind::Source, Errors::NONE, &leaf.mesh, &page);
    let (lo, hi) = leaf.mesh.bounds().expect("a leaf is never empty");
    let cone = ConeBuilder::of_mesh(&leaf.mesh).finish();
    let record = record(leaf.cell, flags, [lo, hi], cone, vec![representation]);
    Ok(BuiltNode { record, pages: vec![page] })
}

fn encode_inner(
    kind: RepresentationKind,
    simplified: Simplified,
    lattice: &Lattice,
    budget: &Budget,
) -> Result<(Source, Representation, Vec<u8>), FormatError> {
    let Simplified { mesh, carried, distance, normal_deviation, smoothing, visual } = simplified;
    // Corners on the cell's faces stay on the finest grid they came from.
    let page = encode_mesh(&mesh, grid_of(&mesh, budget.grid_shift))?;
    // An error far below the budget selects nothing differently, but checking it by samples at a
    // quarter of it would take for ever.
    let error = distance.max(budget.whole / 8.0);
    let errors = Errors {
        geometric: round_up(error * lattice.step),
        geometric_status: BoundStatus::Proven,
        visual: round_up(visual.max(error) * lattice.step),
        normal_deviation_deg: normal_deviation.map(degrees_up),
        normal_smoothing_deg: degrees_up(smoothing),
    };
    let representation = representation(kind, errors, &mesh, &page);
    Ok((Source { mesh, carried, smoothing }, representation, page))
}

/// The coarsest grid, up to `2^wanted`, that holds every position relative to the lowest.
fn grid_of(mesh: &Mesh, wanted: u8) -> u8 {
    let Some((lowest, _)) = mesh.bounds() else { return wanted };
    let offsets = mesh.positions.iter().flat_map(|p| (0..3).map(move |i| p[i].abs_diff(lowest[i])));
    let bits = offsets.fold(0, |all, offset| all | offset);
    bits.trailing_zeros().min(u32::from(wanted)) as u8
}

/// Degrees of an angle in radians, not less.
#[inline(never)]
fn degrees_up(radians: f32) -> f32 {
    round_up(f64::from(radians).to_degrees()).min(180.0)
}

/// A bound survives the way to f32.
fn round_up(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) < value { nearest.next_up() } else { nearest }
}

fn representation(
    kind: RepresentationKind,
    errors: Errors,
    mesh: &Mesh,
    page: &[u8],
) -> Representation {
    Representation {
        kind,
        errors,
        vertices: mesh.positions.len() as u32,
        triangles: mesh.triangles.len() as u32,
        points: 0,
        page: PageRef::of_bytes(page),
    }
}

fn record(
    cell: CellKey,
    flags: NodeFlags,
    bounds: [[i32; 3]; 2],
    cone: NormalCone,
    representations: Vec<Representation>,
) -> NodeRecord {
    // Child masks and places are found when the file is laid out.
    NodeRecord {
        cell,
        child_mask: 0,
        flags,
        bounds,
        cone,
        representations,
        children: Children::None,
    }
}
