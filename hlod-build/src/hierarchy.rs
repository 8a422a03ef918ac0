//! The octree of levels of detail, from the leaves up.
//!
//! A node gathers the simplified geometry two levels below (Guthe et al. 2004, section 3) — a
//! child that is a leaf gives its own — and simplifies what that adds to. What each
//! triangle is known to be wrong by travels with it: a level adds its own step.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::atomic::{AtomicU64, Ordering};

use hlod_compress::{
    BoundStatus, CellKey, Children, Errors, FormatError, Lattice, MAX_DEPTH, Mesh, NodeFlags,
    NodeRecord, NormalCone, PageContent, PageRef, Primitives, Representation, RepresentationKind,
    encode_page,
};
use rayon::prelude::*;

use crate::borders::Cube;
use crate::certificate::Carried;
use crate::cone::ConeBuilder;
use crate::error::BuildError;
use crate::gate::{Admitted, Gate, TooMuch};
use crate::partition::{Leaf, Vertex};
use crate::points::cover::{Choice, Divided, divide};
use crate::points::{Point, cloud, round, to_page};
use crate::progress::Progress;
use crate::seams::close_seams;
use crate::simplify::{Both, Budget, LEAST_SHARE, Simplified, Source, simplify};
use crate::tears::fill_gathered;

/// A node with its pages' bytes, ready to be laid out.
pub(crate) struct BuiltNode {
    /// The record; page offsets and places of children are not known yet.
    pub(crate) record: NodeRecord,
    /// One page for each of the record's representations.
    pub(crate) pages: Vec<Vec<u8>>,
}

/// What levels above need of a node.
pub(crate) struct Piece {
    /// Its appearance; of a leaf the original.
    pub(crate) source: Source,
    /// The same of a point cloud.
    pub(crate) points: Vec<Point>,
    pub(crate) is_leaf: bool,
    /// Normals and bounds of it and of everything below.
    pub(crate) cone: ConeBuilder,
    pub(crate) bounds: [[i32; 3]; 2],
}

impl Piece {
    /// Triangles, or points.
    pub(crate) fn primitives(&self) -> usize {
        self.source.mesh.triangles.len() + self.points.len()
    }
}

/// Pieces by their cells.
pub(crate) type Pieces = BTreeMap<CellKey, Piece>;

/// What all nodes of a model have in common.
pub(crate) struct Setting<'a> {
    pub(crate) lattice: Lattice,
    pub(crate) resolution: u32,
    pub(crate) normal_noise: f32,
    pub(crate) closed_oriented: bool,
    /// Whether the scan is a point cloud.
    pub(crate) is_cloud: bool,
    /// Where triangles become points.
    pub(crate) choice: Choice,
    pub(crate) has_colours: bool,
    /// Whether vertices have numbers that are kept.
    pub(crate) has_scalars: bool,
    /// Keeps nodes that are worked on at a time within memory.
    pub(crate) gate: &'a Gate,
    pub(crate) progress: &'a dyn Progress,
}

impl Setting<'_> {
    /// What a node takes that gathers so many triangles, or points.
    pub(crate) fn node_bytes(&self, primitives: u64) -> u64 {
        let each = if self.is_cloud { NODE_BYTES_A_POINT } else { NODE_BYTES_A_TRIANGLE };
        primitives * each
    }

    /// Waits until there is memory for a node; not to be called by who has been admitted.
    pub(crate) fn admit(&self, bytes: u64) -> Result<Admitted<'_>, NodeError> {
        self.gate.enter(bytes).map_err(|TooMuch { needed_bytes, budget_bytes }| NodeError::Memory {
            needed_bytes,
            budget_bytes,
        })
    }
}

/// Builds the nodes of a subtree of so many triangles, or points, above its leaves, and says what is
/// needed higher up: the pieces of `root` and of its children.
///
/// # Errors
/// When a node is larger than a page or memory may be, or the build was stopped.
pub(crate) fn build_subtree(
    root: CellKey,
    leaves: Vec<(BuiltNode, Piece)>,
    triangles: u64,
    setting: &Setting<'_>,
) -> Result<(Vec<BuiltNode>, Pieces), NodeError> {
    let mut inner = BTreeSet::new();
    for leaf in leaves.iter().map(|(node, _)| node.record.cell) {
        let mut cell = (leaf != root).then(|| leaf.parent()).flatten();
        while let Some(above) = cell.filter(|&c| inner.insert(c) && c != root) {
            cell = above.parent();
        }
    }
    let advance = Shares::new(setting.progress, triangles, inner.len() as u64 + 1);
    let mut nodes = Vec::with_capacity(leaves.len() + inner.len());
    let mut pieces = Pieces::new();
    let mut keep = |built: Vec<(BuiltNode, Piece)>, pieces: &mut Pieces| {
        for (node, piece) in built {
            pieces.insert(node.record.cell, piece);
            nodes.push(node);
        }
    };
    keep(leaves, &mut pieces);
    let deepest = inner.iter().map(|c| c.depth()).max();
    for depth in (root.depth()..=deepest.unwrap_or(0)).rev() {
        let cells: Vec<CellKey> = inner.iter().copied().filter(|c| c.depth() == depth).collect();
        // All nodes of a depth are independent of one another.
        let built = cells.par_iter().map(|&cell| {
            let primitives: usize = gathered(cell, &pieces).map(Piece::primitives).sum();
            let _admitted = setting.admit(setting.node_bytes(primitives as u64))?;
            let built = build_inner(cell, &pieces, setting);
            advance.one();
            built
        });
        keep(built.collect::<Result<Vec<_>, NodeError>>()?, &mut pieces);
        // Nothing above gathers what is deeper.
        pieces.retain(|cell, _| cell.depth() <= depth + 1);
    }
    advance.one();
    Ok((nodes, pieces))
}

/// Progress in equal shares of a whole.
struct Shares<'a> {
    progress: &'a dyn Progress,
    whole: u64,
    count: u64,
    done: AtomicU64,
}

impl<'a> Shares<'a> {
    fn new(progress: &'a dyn Progress, whole: u64, count: u64) -> Shares<'a> {
        Shares { progress, whole, count, done: AtomicU64::new(0) }
    }

    fn one(&self) {
        let before = self.done.fetch_add(1, Ordering::Relaxed);
        let up_to =
            |done: u64| (u128::from(self.whole) * u128::from(done) / u128::from(self.count)) as u64;
        self.progress.advance(up_to(before + 1) - up_to(before));
    }
}

/// Why a node cannot be built.
#[derive(Debug)]
pub(crate) enum NodeError {
    Format(FormatError),
    /// Of a file that it is made from.
    Build(BuildError),
    /// More memory is needed for one node than there is for all.
    Memory {
        needed_bytes: u64,
        budget_bytes: u64,
    },
    Stopped,
}

impl From<FormatError> for NodeError {
    fn from(error: FormatError) -> NodeError {
        NodeError::Format(error)
    }
}

/// Points that stand for triangles lie on grids finer than these by so many halvings,
const POINT_SHIFT: u8 = 3;
/// so that rounding takes no more than this of the budget: half the diagonal of 2⁻³ · 2⁻³ of it.
const POINT_ROUNDING: f64 = 0.0136;
/// They are rounded to the lattice before, by at most half its diagonal.
const LATTICE_ROUNDING: f64 = 0.867;

/// Where triangles are cut, the surface's lines on the faces of cells are so far from the scan's, in
/// lattice steps: their vertices are rounded.
const CUT_ROUNDING: f64 = 1.0;

/// # Errors
/// When the leaf is larger than a page may be.
pub(crate) fn build_leaf(
    leaf: Leaf,
    setting: &Setting<'_>,
) -> Result<(BuiltNode, Piece), NodeError> {
    let content = PageContent { mesh: leaf.mesh, ..PageContent::default() };
    let page = encode_page(&content, 0, 0)?;
    let kind = RepresentationKind::Source;
    let representation = representation(kind, Errors::NONE, &content, &page, setting.lattice.step);
    let mesh = content.mesh;
    let (lo, hi) = mesh.bounds().expect("a leaf is never empty");
    let cone = ConeBuilder::of_mesh(&mesh);
    let record =
        record(leaf.cell, setting.closed_oriented, [lo, hi], cone.finish(), vec![representation]);
    let source = Source { mesh, border: CUT_ROUNDING, ..Source::default() };
    let piece = Piece { source, points: Vec::new(), is_leaf: true, cone, bounds: [lo, hi] };
    Ok((BuiltNode { record, pages: vec![page] }, piece))
}

/// Gathers a node from the two levels below, which `pieces` holds, and simplifies it. The caller
/// has been admitted with [`NODE_BYTES_A_TRIANGLE`].
///
/// # Errors
/// As [`build_subtree`].
pub(crate) fn build_inner(
    cell: CellKey,
    pieces: &Pieces,
    setting: &Setting<'_>,
) -> Result<(BuiltNode, Piece), NodeError> {
    if setting.progress.is_stopped() {
        return Err(NodeError::Stopped);
    }
    if setting.is_cloud {
        return cloud::build_inner(cell, pieces, setting);
    }
    let lattice = &setting.lattice;
    let mut source = gather(cell, pieces);
    let cube = Cube { min: lattice.cell_min(cell), units: lattice.cell_units(cell.depth()) };
    let whole = f64::from(cube.units) / f64::from(setting.resolution);
    // Where two pieces meet, both may be wrong, and cutting rounded by up to a step. What is left
    // of the budget everywhere must be enough for the least that a step may do.
    let width = 2.0 * source.distance() + 2.0;
    let limit = (1.0 - LEAST_SHARE) * whole;
    close_seams(&mut source, width, limit, &cube);
    fill_gathered(&mut source, limit, &cube);
    let budget = budget(cell, setting, &source);
    let Both { appearance, geometric, is_opened } = simplify(&source, &budget);
    drop(source);

    let mut summary: Option<(ConeBuilder, [[i32; 3]; 2])> = None;
    for octant in 0..8 {
        if let Some(piece) = pieces.get(&cell.child(octant)) {
            merge(&mut summary, piece.cone.clone(), piece.bounds);
        }
    }
    let mut of_kind = |kind, simplified, choice| -> Result<_, NodeError> {
        let encoded = encode_inner(kind, simplified, lattice, &budget, choice)?;
        if let Some((lo, hi)) = encoded.0.mesh.bounds() {
            // What is drawn of a point reaches round it.
            let margin = (f64::from(encoded.1.cover_radius) / lattice.step).ceil() as i32;
            let bounds = [lo.map(|c| c - margin), hi.map(|c| c + margin)];
            merge(&mut summary, ConeBuilder::of_mesh(&encoded.0.mesh), bounds);
        }
        Ok(encoded)
    };
    let appearance = of_kind(RepresentationKind::Appearance, appearance, setting.choice)?;
    let triangles = Choice { primitives: Primitives::Triangles, ..setting.choice };
    let geometric = of_kind(RepresentationKind::Geometric, geometric, triangles)?;
    let (cone, bounds) = summary.expect("an inner node has children");
    let representations = vec![appearance.1, geometric.1];
    let is_closed = setting.closed_oriented && !is_opened;
    let record = record(cell, is_closed, bounds, cone.finish(), representations);
    // The appearance is what levels above are made of.
    let piece = Piece { source: appearance.0, points: Vec::new(), is_leaf: false, cone, bounds };
    Ok((BuiltNode { record, pages: vec![appearance.2, geometric.2] }, piece))
}

/// What simplifying a node takes, source and results included, for each triangle gathered, as
/// measured on nodes of 0.3 to 0.4 million.
pub(crate) const NODE_BYTES_A_TRIANGLE: u64 = 750;
/// The same for each point: itself, its key, those that are kept and their search tree.
const NODE_BYTES_A_POINT: u64 = 300;

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
fn budget(cell: CellKey, setting: &Setting<'_>, source: &Source) -> Budget {
    let lattice = &setting.lattice;
    let cell_units = lattice.cell_units(cell.depth());
    let whole = f64::from(cell_units) / f64::from(setting.resolution);
    // Points are rounded, away from what they stand for.
    let has_points = setting.choice.primitives != Primitives::Triangles;
    let whole = if has_points {
        (whole * (1.0 - POINT_ROUNDING) - LATTICE_ROUNDING).max(whole / 2.0)
    } else {
        whole
    };
    // The largest step ≤ ε/8, and no larger than what still contains the cell's faces.
    let grid_shift = (whole / 8.0).log2().floor().max(0.0) as u8;
    Budget {
        whole,
        distance: Budget::left_by_most(whole, source),
        normal_noise: setting.normal_noise,
        grid_shift: grid_shift.min(lattice.depth_max - cell.depth()),
        cell_min: lattice.cell_min(cell),
        cell_units,
        is_closed: setting.closed_oriented,
    }
}

/// The pieces that a node is made of, in the order of their cells: children that are leaves,
/// grandchildren otherwise.
pub(crate) fn gathered(cell: CellKey, pieces: &Pieces) -> impl Iterator<Item = &Piece> {
    (0..8).map(move |octant| cell.child(octant)).flat_map(move |child| {
        let leaf = pieces.get(&child).filter(|piece| piece.is_leaf);
        let deeper = leaf.is_none() && child.depth() < MAX_DEPTH;
        let grandchildren = (0..if deeper { 8 } else { 0 }).map(move |octant| child.child(octant));
        leaf.into_iter().chain(grandchildren.filter_map(move |cell| pieces.get(&cell)))
    })
}

/// Geometry two levels below; vertices that are equal in every attribute are joined.
fn gather(cell: CellKey, pieces: &Pieces) -> Source {
    let mut out = Source::default();
    let mut index_of: HashMap<Vertex, u32> = HashMap::new();
    for piece in gathered(cell, pieces) {
        let Source { mesh, carried, smoothing, border } = &piece.source;
        let joined = &mut out.mesh;
        let new_from_old: Vec<u32> = (0..mesh.positions.len() as u32)
            .map(|v| {
                let vertex = Vertex::of(mesh, v);
                *index_of.entry(vertex).or_insert_with(|| vertex.push_to(joined))
            })
            .collect();
        joined.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| new_from_old[v as usize])));
        out.carried.extend(carried);
        out.smoothing = out.smoothing.max(*smoothing);
        out.border = out.border.max(*border);
        // Leaves are the original: they carry nothing.
        out.carried.resize(joined.triangles.len(), Carried::default());
    }
    out
}

fn encode_inner(
    kind: RepresentationKind,
    simplified: Simplified,
    lattice: &Lattice,
    budget: &Budget,
    choice: Choice,
) -> Result<(Source, Representation, Vec<u8>), FormatError> {
    let Simplified { mesh, carried, distance, normal_deviation, smoothing, visual, border } =
        simplified;
    // Corners on the cell's faces stay on the finest grid they came from.
    let grid_shift = grid_of(&mesh, budget.grid_shift);
    // An error far below the budget selects nothing differently, but checking it by samples at a
    // quarter of it would take for ever.
    let error = distance.max(budget.whole / 8.0);
    let cube = Cube { min: budget.cell_min, units: budget.cell_units };
    let Divided { mesh: rest, mut points, spacing } =
        divide(&mesh, visual.max(error), &cube, choice);
    let point_shift = grid_shift.saturating_sub(POINT_SHIFT);
    round(&mut points, point_shift);
    // Points lie on the simplified triangles.
    let error = error + points.iter().map(|p| p.moved).fold(0.0, f64::max);
    let turned = points.iter().map(|p| p.turned).fold(0.0, f64::max) as f32;
    let content = PageContent {
        mesh: rest.into_owned(),
        points: to_page(&points, spacing, mesh.has_colours()),
    };
    let page = encode_page(&content, grid_shift, point_shift)?;
    let errors = Errors {
        geometric: round_up(error * lattice.step),
        geometric_status: BoundStatus::Proven,
        visual: round_up(visual.max(error) * lattice.step),
        normal_deviation_deg: normal_deviation.map(|angle| degrees_up(angle + turned)),
        normal_smoothing_deg: degrees_up(smoothing),
        border: round_up(border * lattice.step),
    };
    let representation = representation(kind, errors, &content, &page, lattice.step);
    Ok((Source { mesh, carried, smoothing, border }, representation, page))
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
pub(crate) fn degrees_up(radians: f32) -> f32 {
    round_up(f64::from(radians).to_degrees()).min(180.0)
}

/// A bound survives the way to f32.
pub(crate) fn round_up(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) < value { nearest.next_up() } else { nearest }
}

pub(crate) fn representation(
    kind: RepresentationKind,
    errors: Errors,
    content: &PageContent,
    page: &[u8],
    step: f64,
) -> Representation {
    let PageContent { mesh, points } = content;
    Representation {
        kind,
        errors,
        vertices: mesh.positions.len() as u32,
        triangles: mesh.triangles.len() as u32,
        points: points.len() as u32,
        cover_radius: round_up(points.largest_radius_steps() * step),
        page: PageRef::of_bytes(page),
    }
}

pub(crate) fn record(
    cell: CellKey,
    closed_oriented: bool,
    bounds: [[i32; 3]; 2],
    cone: NormalCone,
    representations: Vec<Representation>,
) -> NodeRecord {
    // Child masks and places are found when the file is laid out.
    NodeRecord {
        cell,
        child_mask: 0,
        flags: NodeFlags { closed_oriented },
        bounds,
        cone,
        representations,
        children: Children::None,
    }
}
