//! Nodes of a scan that is a point cloud.
//!
//! Leaves hold the scan's own points. A node gathers the points two levels below, as nodes of triangles
//! do, and keeps one for each cell of a grid that is as wide as seven tenths of a pixel at the size at
//! which it is drawn. What it keeps are points of the scan, so no distance to a surface has to be
//! estimated; how far they stand for others is known (Rusinkiewicz & Levoy, *QSplat*, 2000, with
//! bounds that are kept instead of spheres that are nested).

use hlod_compress::{
    BoundStatus, CellKey, Errors, Lattice, NormalCone, PageContent, RepresentationKind, encode_page,
};

use super::cluster::clustered;
use super::spacing::radii;
use super::{PIXEL_A_ERROR, Point, SPACING_PX, round, to_page};
use crate::cone::ConeBuilder;
use crate::hierarchy::{
    BuiltNode, NodeError, Piece, Pieces, Setting, degrees_up, gathered, record, representation,
    round_up,
};
use crate::simplify::Source;

/// The points of a leaf, in the order of the scan.
pub(crate) struct CloudLeaf {
    /// Its cell.
    pub(crate) cell: CellKey,
    /// Never empty; radii are not known yet.
    pub(crate) points: Vec<Point>,
}

/// Which octant of a cell a position lies in: what lies on the planes between goes below, as where
/// triangles are cut.
pub(crate) fn octant_of(position: [i32; 3], cell: CellKey, lattice: &Lattice) -> u8 {
    let half = (lattice.cell_units(cell.depth()) / 2) as i32;
    let centre = lattice.cell_min(cell).map(|c| c + half);
    (0..3).fold(0, |octant, axis| octant | u8::from(position[axis] > centre[axis]) << axis)
}

/// Splits `cell` until each part holds at most `leaf_points` points.
pub(crate) fn split_into_leaves(
    cell: CellKey,
    points: Vec<Point>,
    lattice: &Lattice,
    leaf_points: usize,
) -> Vec<CloudLeaf> {
    if points.is_empty() {
        return Vec::new();
    }
    if points.len() <= leaf_points || cell.depth() == lattice.depth_max {
        return vec![CloudLeaf { cell, points }];
    }
    let mut parts: [Vec<Point>; 8] = Default::default();
    for point in points {
        parts[usize::from(octant_of(point.position, cell, lattice))].push(point);
    }
    (0..8u8)
        .zip(parts)
        .flat_map(|(octant, part)| {
            split_into_leaves(cell.child(octant), part, lattice, leaf_points)
        })
        .collect()
}

/// # Errors
/// When the leaf is larger than a page may be.
pub(crate) fn build_leaf(
    leaf: CloudLeaf,
    setting: &Setting<'_>,
) -> Result<(BuiltNode, Piece), NodeError> {
    let CloudLeaf { cell, mut points } = leaf;
    let places: Vec<_> = points.iter().map(|p| (p.position, p.normal)).collect();
    for (point, radius) in points.iter_mut().zip(radii(&places)) {
        point.reach = radius;
    }
    let mut sorted: Vec<f64> = points.iter().map(|p| p.reach).collect();
    sorted.sort_by(f64::total_cmp);
    // Balls of neighbours on a grid reach the middle between four of them.
    let spacing = sorted[sorted.len() / 2] * std::f64::consts::SQRT_2;
    let kind = RepresentationKind::Source;
    let kept = Kept { points, spacing, grid_shift: 0, errors: Errors::NONE };
    node(cell, kind, kept, None, setting)
}

/// # Errors
/// When the node is larger than a page may be.
pub(crate) fn build_inner(
    cell: CellKey,
    pieces: &Pieces,
    setting: &Setting<'_>,
) -> Result<(BuiltNode, Piece), NodeError> {
    let lattice = &setting.lattice;
    let all: Vec<Point> = gathered(cell, pieces).flat_map(|piece| &piece.points).copied().collect();
    let budget = f64::from(lattice.cell_units(cell.depth())) / f64::from(setting.resolution);
    let spacing = SPACING_PX * PIXEL_A_ERROR * budget;
    let mut points = clustered(&all, spacing);
    drop(all);
    // Far below what is seen, and no finer: positions take most of a page.
    let grid_shift = (budget / 2.0).log2().floor().max(0.0) as u8;
    round(&mut points, grid_shift);

    let step = lattice.step;
    let moved = points.iter().map(|p| p.moved).fold(0.0, f64::max);
    let errors = Errors {
        geometric: round_up(moved * step),
        geometric_status: BoundStatus::Proven,
        visual: round_up(budget.max(moved) * step),
        normal_deviation_deg: deviations(&points).map(|angle| degrees_up(angle as f32)),
        normal_smoothing_deg: 0.0,
        border: 0.0,
    };
    let below = (0..8).filter_map(|octant| pieces.get(&cell.child(octant))).map(|p| p.bounds);
    let below = below.reduce(union);
    let kind = RepresentationKind::Appearance;
    node(cell, kind, Kept { points, spacing, grid_shift, errors }, below, setting)
}

/// Angles by which normals of all, of 99 and of 90 % of the scan's points differ at most; radians.
fn deviations(points: &[Point]) -> [f64; 3] {
    let mut sorted: Vec<(f64, u64)> = points.iter().map(|p| (p.turned, p.weight.into())).collect();
    sorted.sort_by(|a, b| b.0.total_cmp(&a.0));
    let total: u64 = sorted.iter().map(|(_, weight)| weight).sum();
    [0.0, 0.01, 0.1].map(|share| {
        let mut left = (share * total as f64) as u64;
        let within = sorted.iter().find(|(_, weight)| {
            let is_left_out = *weight <= left;
            left = left.saturating_sub(*weight);
            !is_left_out
        });
        within.map_or(0.0, |(angle, _)| *angle)
    })
}

fn union(a: [[i32; 3]; 2], b: [[i32; 3]; 2]) -> [[i32; 3]; 2] {
    [std::array::from_fn(|i| a[0][i].min(b[0][i])), std::array::from_fn(|i| a[1][i].max(b[1][i]))]
}

/// What a node keeps of the points that it stands for.
struct Kept {
    points: Vec<Point>,
    /// About how far they are apart, lattice steps.
    spacing: f64,
    /// Positions are multiples of 2 to this power.
    grid_shift: u8,
    errors: Errors,
}

/// What leaves and inner nodes have in common; `below` are the bounds of what is below.
fn node(
    cell: CellKey,
    kind: RepresentationKind,
    kept: Kept,
    below: Option<[[i32; 3]; 2]>,
    setting: &Setting<'_>,
) -> Result<(BuiltNode, Piece), NodeError> {
    let Kept { points, spacing, grid_shift, errors } = kept;
    let page_points = to_page(&points, spacing, setting.has_colours);
    let content = PageContent { points: page_points, ..PageContent::default() };
    let page = encode_page(&content, 0, grid_shift)?;
    let representation = representation(kind, errors, &content, &page, setting.lattice.step);
    // What is drawn of a point reaches round it.
    let margin = content.points.largest_radius_steps().ceil() as i32;
    let (lo, hi) = content.points.bounds().expect("no node is empty");
    let mut bounds = [lo.map(|c| c - margin), hi.map(|c| c + margin)];
    if let Some(below) = below {
        bounds = union(bounds, below);
    }
    let record = record(cell, false, bounds, NormalCone::ALL, vec![representation]);
    let is_leaf = kind == RepresentationKind::Source;
    let (source, cone) = (Source::default(), ConeBuilder::nothing());
    let piece = Piece { source, points, is_leaf, cone, bounds };
    Ok((BuiltNode { record, pages: vec![page] }, piece))
}
