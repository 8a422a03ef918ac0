//! The octree of levels of detail, from the leaves up.
//!
//! A node gathers the simplified geometry two levels below (Guthe et al. 2004, section 3) — a
//! child that is a leaf gives its own — and simplifies what that adds to. Its error is the
//! largest error of what was gathered plus the distance that this step added.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use hlod_compress::{
    BoundStatus, CellKey, Children, Errors, FormatError, Lattice, Mesh, NodeFlags, NodeRecord,
    NormalCone, PageRef, Representation, RepresentationKind, encode_mesh,
};
use rayon::prelude::*;

use crate::cone::ConeBuilder;
use crate::partition::{Leaf, Vertex};
use crate::progress::Progress;
use crate::simplify::{Budget, Simplified, simplify};

/// A node with its pages' bytes, ready to be laid out.
pub struct BuiltNode {
    /// The record; page offsets and places of children are not known yet.
    pub record: NodeRecord,
    /// One page for each of the record's representations.
    pub pages: Vec<Vec<u8>>,
}

/// Geometry that levels above still need.
struct Kept {
    mesh: Mesh,
    /// Bound against the original, in lattice steps.
    error: f64,
}

type Level = HashMap<CellKey, Kept>;

const KINDS: [RepresentationKind; 2] =
    [RepresentationKind::Appearance, RepresentationKind::Geometric];

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
    // The two levels below the current one, for each kind.
    let mut below: [[Level; 2]; 2] = Default::default();
    for depth in (0..=deepest.unwrap_or(0)).rev() {
        let cells: Vec<CellKey> = inner.iter().copied().filter(|c| c.depth() == depth).collect();
        let jobs: Vec<(CellKey, usize)> =
            cells.iter().flat_map(|&cell| [(cell, 0), (cell, 1)]).collect();

        // All nodes of a depth are independent of one another.
        let results: Vec<(Kept, Representation, Vec<u8>)> = jobs
            .par_iter()
            .map(|&(cell, kind)| {
                let (source, source_error) = gather(cell, &inner, &leaves, &below[kind][1]);
                let budget = budget(cell, lattice, resolution, source_error);
                let simplified = simplify(&source, KINDS[kind], &budget);
                let out = encode_inner(KINDS[kind], simplified, source_error, lattice, &budget);
                progress.advance(1);
                out
            })
            .collect::<Result<_, FormatError>>()?;

        let mut level: [Level; 2] = Default::default();
        let mut results = results.into_iter();
        for cell in cells {
            let mut pages = Vec::new();
            let mut representations = Vec::new();
            let mut summary: Option<(ConeBuilder, [[i32; 3]; 2])> = None;
            for octant in 0..8 {
                if let Some((cone, bounds)) = summaries.get(&cell.child(octant)) {
                    merge(&mut summary, cone.clone(), *bounds);
                }
            }
            for (level, (kept, representation, page)) in level.iter_mut().zip(results.by_ref()) {
                if let Some((lo, hi)) = kept.mesh.bounds() {
                    merge(&mut summary, ConeBuilder::of_mesh(&kept.mesh), [lo, hi]);
                }
                level.insert(cell, kept);
                representations.push(representation);
                pages.push(page);
            }
            let (cone, bounds) = summary.expect("an inner node has children");
            let record = record(cell, flags, bounds, cone.finish(), representations);
            summaries.insert(cell, (cone, bounds));
            built.push(BuiltNode { record, pages });
        }
        for (below, level) in below.iter_mut().zip(level) {
            let [one, two] = std::mem::take(below);
            drop(two);
            *below = [level, one];
        }
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

/// The error budget e/R of DESIGN.md 3.2 less what the source already lost.
fn budget(cell: CellKey, lattice: &Lattice, resolution: u32, source_error: f64) -> Budget {
    let cell_units = lattice.cell_units(cell.depth());
    let whole = f64::from(cell_units) / f64::from(resolution);
    // The largest step ≤ ε/8, and no larger than what still contains the cell's faces.
    let grid_shift = (whole / 8.0).log2().floor().max(0.0) as u8;
    Budget {
        whole,
        distance: (whole - source_error).max(0.25 * whole),
        grid_shift: grid_shift.min(lattice.depth_max - cell.depth()),
        cell_min: lattice.cell_min(cell),
        cell_units,
    }
}

/// Geometry two levels below with its error: vertices that are equal in every attribute are
/// joined, so that simplification crosses the faces between the cells.
fn gather(
    cell: CellKey,
    inner: &BTreeSet<CellKey>,
    leaves: &HashMap<CellKey, Mesh>,
    two_below: &Level,
) -> (Mesh, f64) {
    let mut out = Mesh::default();
    let mut index_of: HashMap<Vertex, u32> = HashMap::new();
    let mut error = 0.0f64;
    let mut add = |mesh: &Mesh| {
        let new_from_old: Vec<u32> = (0..mesh.positions.len() as u32)
            .map(|v| {
                let vertex = Vertex::of(mesh, v);
                *index_of.entry(vertex).or_insert_with(|| vertex.push_to(&mut out))
            })
            .collect();
        out.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| new_from_old[v as usize])));
    };
    for octant in 0..8 {
        let child = cell.child(octant);
        if let Some(mesh) = leaves.get(&child) {
            add(mesh);
        } else if inner.contains(&child) {
            for octant in 0..8 {
                let grandchild = child.child(octant);
                if let Some(mesh) = leaves.get(&grandchild) {
                    add(mesh);
                } else if let Some(kept) = two_below.get(&grandchild) {
                    add(&kept.mesh);
                    error = error.max(kept.error);
                }
            }
        }
    }
    (out, error)
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
    source_error: f64,
    lattice: &Lattice,
    budget: &Budget,
) -> Result<(Kept, Representation, Vec<u8>), FormatError> {
    let Simplified { mesh, distance, normal_deviation_deg } = simplified;
    // Corners on the cell's faces stay on the finest grid they came from.
    let page = encode_mesh(&mesh, grid_of(&mesh, budget.grid_shift))?;
    // An error far below the budget selects nothing differently, but checking it by samples at a
    // quarter of it would take for ever.
    let error = (source_error + distance).max(budget.whole / 8.0);
    let errors = Errors {
        geometric: round_up(error * lattice.step),
        geometric_status: BoundStatus::Measured,
        normal_deviation_deg,
    };
    let representation = representation(kind, errors, &mesh, &page);
    Ok((Kept { mesh, error }, representation, page))
}

/// The coarsest grid, up to `2^wanted`, that holds every position relative to the lowest.
fn grid_of(mesh: &Mesh, wanted: u8) -> u8 {
    let Some((lowest, _)) = mesh.bounds() else { return wanted };
    let offsets = mesh.positions.iter().flat_map(|p| (0..3).map(move |i| p[i].abs_diff(lowest[i])));
    let bits = offsets.fold(0, |all, offset| all | offset);
    bits.trailing_zeros().min(u32::from(wanted)) as u8
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
