//! Tries to refute what a file says about itself.
//!
//! Shares no geometry code with the builder: its own cutting, a grid instead of a hierarchy, its own
//! point–triangle distance by another method, sampling instead of bounds.
//!
//! - Every block and page is read, checked and decoded; counts, cells and bounds are compared.
//! - Leaves are compared with the input, cut at the leaves' cells.
//! - Inner nodes are sampled both ways at a spacing of at most a quarter of their error. No
//!   sample may be farther than the stored error; the largest sample plus the covering radius of
//!   the samples is `independent_bound`, an upper bound that owes nothing to the builder.
//!
//! Leaves are read when they are needed and not kept, so that files larger than memory can be
//! checked.

pub(crate) mod distance;
mod inner;
mod leaves;
mod normals;
mod originals;
mod points;
mod scalars;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use hlod_compress::{
    CellKey, FormatError, HlodFile, NodeRecord, PageContent, PageCounts, Representation,
    decode_page,
};
use hlod_scan::{Transform, place_scans};
use rayon::prelude::*;
use serde::Serialize;

use originals::Originals;

use crate::error::BuildError;
use crate::progress::{Progress, Unit};

/// What a verification found; the keys are stable.
#[derive(Debug, Serialize)]
pub struct VerifyReport {
    /// Nodes in the file.
    pub nodes: u64,
    /// Representations of inner nodes that were sampled.
    pub representations_sampled: u64,
    /// Representations of which a sample is farther from the original than the stored error.
    pub nodes_over_bound: u64,
    /// Representations of which a sample's normal is farther from all normals within the stored
    /// error than the stored deviation.
    pub nodes_over_normal_bound: u64,
    /// Points of a point cloud that lie in no ball of a node that stands for them.
    pub points_uncovered: u64,
    /// Median of stored error ÷ largest sample, over representations with an error.
    pub tightness_median: f64,
    /// 95th percentile of the same.
    pub tightness_p95: f64,
    /// Largest independent bound ÷ stored error.
    pub independent_ratio_max: f64,
    /// Whether leaves were compared with the input (`--against`).
    pub leaves_compared: bool,
    /// Leaves whose geometry is not the input's.
    pub leaves_differ: u64,
    /// Vertices of leaves whose kept numbers were compared with the input's.
    pub values_compared: u64,
    /// What is wrong, one sentence each; at most [`PROBLEMS_MAX`].
    pub problems: Vec<String>,
    /// Per representation, for tables and plots.
    pub representations: Vec<RepresentationCheck>,
}

/// No more problems than this are put into words.
pub const PROBLEMS_MAX: usize = 50;

/// Rounding of angles between f32 vectors, in degrees.
const ANGLE_SLACK: f32 = 0.05;

impl VerifyReport {
    /// Whether anything the file says turned out to be wrong.
    pub fn is_refuted(&self) -> bool {
        self.nodes_over_bound > 0
            || self.nodes_over_normal_bound > 0
            || self.leaves_differ > 0
            || self.points_uncovered > 0
            || !self.problems.is_empty()
    }
}

/// The check of one representation of an inner node.
#[derive(Debug, Clone, Serialize)]
pub struct RepresentationCheck {
    /// Cell, as depth and octal path.
    pub cell: String,
    /// Depth of the node.
    pub depth: u8,
    /// `appearance`, `geometric` or `points`.
    pub kind: &'static str,
    /// Stored error in the source's unit.
    pub stored: f64,
    /// Largest sampled distance.
    pub sampled: f64,
    /// Largest sampled distance plus covering radius.
    pub independent_bound: f64,
    /// Stored deviation of normals and of their smoothing, together, in degrees.
    pub normal_allowed_deg: f32,
    /// A deviation that some sample has at least. Samples are looked into no further than is
    /// needed to see that they do not exceed what is allowed.
    pub normal_sampled_deg: f32,
    /// Points of the scan that none of its points' balls holds.
    pub points_uncovered: u64,
}

/// What is checked, and with how much memory.
#[derive(Debug, Clone)]
pub struct VerifyOptions {
    /// The scans that the file was built from: leaves are compared with them too.
    pub against: Vec<PathBuf>,
    /// Where each of them stands, as when it was built from them; empty where all stand where they say
    /// themselves.
    pub transforms: Vec<Option<Transform>>,
    /// Of the inner nodes of each depth this share, from 0 to 1, is sampled, evenly spread, at
    /// least one.
    pub share: f64,
    /// How much memory the comparison of leaves may take; it needs 12 bytes for each vertex of the
    /// scans, whatever this says, and passes over the scans more often where it is less.
    pub memory_bytes: u64,
    /// Nodes that stand for more triangles than this are sampled in parts of at most as many, each
    /// by one thread, at some 250 bytes a triangle.
    pub block_triangles: u64,
}

impl Default for VerifyOptions {
    fn default() -> VerifyOptions {
        VerifyOptions {
            against: Vec::new(),
            transforms: Vec::new(),
            share: 1.0,
            memory_bytes: 4 << 30,
            block_triangles: 400_000,
        }
    }
}

/// Checks a file.
///
/// # Errors
/// When the file or an input cannot be read at all. Whatever is wrong inside the file is in the
/// report.
pub fn verify(
    path: &Path,
    options: &VerifyOptions,
    progress: &dyn Progress,
) -> Result<VerifyReport, BuildError> {
    let file = HlodFile::open(path).map_err(BuildError::format(path))?;
    let nodes = file.read_skeleton().map_err(BuildError::format(path))?;

    progress.begin("decode", nodes.len() as u64, Unit::Nodes);
    let mut problems: Vec<String> = nodes
        .par_iter()
        .filter_map(|node| {
            let pages = node.representations.iter();
            let problem = pages.map(|r| check_page(&file, node, r)).find_map(Result::err);
            progress.advance(1);
            problem
        })
        .collect();
    progress.end();
    check_monotone(&nodes, &mut problems);

    let is_cloud = file.header().points_input > 0;
    let (mut leaves_differ, mut values_compared) = (0, 0);
    if !options.against.is_empty() {
        let scans = place_scans(&options.against, &options.transforms)?;
        let differing = if is_cloud {
            points::compare(&file, &nodes, &scans, progress)?
        } else {
            leaves::compare(&file, &nodes, &scans, options.memory_bytes, progress)?
        };
        leaves_differ = differing.len() as u64;
        problems.extend(differing);
        let memory_bytes = options.memory_bytes;
        let values = scalars::compare(&file, &nodes, &scans, memory_bytes, progress)?;
        values_compared = values.vertices;
        problems.extend(values.problems);
    }

    let originals = Originals::new(&file, &nodes, options.block_triangles);
    let sampled = choose(&nodes, options.share);
    let sampled: Vec<&NodeRecord> =
        nodes.iter().filter(|node| sampled.contains(&node.cell)).collect();
    let triangles = sampled.iter().map(|node| originals.triangles_below(node.cell)).sum();
    let (unit, check) = if is_cloud {
        (Unit::Points, points::check as Check)
    } else {
        (Unit::Triangles, inner::check as Check)
    };
    progress.begin("sample", triangles, unit);
    let found: Vec<Result<Vec<RepresentationCheck>, String>> =
        sampled.par_iter().map(|node| check(&file, node, &originals, progress)).collect();
    progress.end();
    let mut checks = Vec::new();
    for found in found {
        match found {
            Ok(found) => checks.extend(found),
            // Said above already: the page that could not be read.
            Err(problem) if problems.is_empty() => problems.push(problem),
            Err(_) => {}
        }
    }

    let over = checks.iter().filter(|c| c.sampled > c.stored);
    let nodes_over_bound = over.clone().count() as u64;
    problems.extend(over.map(|c| {
        format!(
            "node {} ({}): a sample is {} from the original, stored error {}",
            c.cell, c.kind, c.sampled, c.stored
        )
    }));
    let over = checks.iter().filter(|c| c.normal_sampled_deg > c.normal_allowed_deg + ANGLE_SLACK);
    let nodes_over_normal_bound = over.clone().count() as u64;
    problems.extend(over.map(|c| {
        format!(
            "node {} ({}): a normal is {}° from all within reach, stored deviation {}°",
            c.cell, c.kind, c.normal_sampled_deg, c.normal_allowed_deg
        )
    }));
    problems.extend(checks.iter().filter(|c| c.points_uncovered > 0).map(|c| {
        format!("node {}: {} points of the scan lie in no ball", c.cell, c.points_uncovered)
    }));
    problems.truncate(PROBLEMS_MAX);
    let mut tightness: Vec<f64> =
        checks.iter().filter(|c| c.sampled > 0.0).map(|c| c.stored / c.sampled).collect();
    tightness.sort_by(f64::total_cmp);
    let percentile = |p: f64| {
        let at = ((tightness.len() as f64 - 1.0) * p).round() as usize;
        tightness.get(at).copied().unwrap_or(1.0)
    };
    let ratio = |c: &RepresentationCheck| {
        if c.stored > 0.0 { c.independent_bound / c.stored } else { 1.0 }
    };
    Ok(VerifyReport {
        nodes: nodes.len() as u64,
        representations_sampled: checks.len() as u64,
        nodes_over_bound,
        nodes_over_normal_bound,
        points_uncovered: checks.iter().map(|c| c.points_uncovered).sum(),
        tightness_median: percentile(0.5),
        tightness_p95: percentile(0.95),
        independent_ratio_max: checks.iter().map(ratio).fold(0.0, f64::max),
        leaves_compared: !options.against.is_empty(),
        leaves_differ,
        values_compared,
        problems,
        representations: checks,
    })
}

/// Checks one inner node.
type Check = fn(
    &HlodFile,
    &NodeRecord,
    &Originals<'_>,
    &dyn Progress,
) -> Result<Vec<RepresentationCheck>, String>;

/// A share of the inner nodes of each depth, evenly spread over their order.
fn choose(nodes: &[NodeRecord], share: f64) -> BTreeSet<CellKey> {
    let mut by_depth: BTreeMap<u8, Vec<CellKey>> = BTreeMap::new();
    for node in nodes.iter().filter(|node| !node.is_leaf()) {
        by_depth.entry(node.cell.depth()).or_default().push(node.cell);
    }
    let mut chosen = BTreeSet::new();
    for cells in by_depth.values_mut() {
        cells.sort_unstable();
        let count = ((cells.len() as f64 * share).ceil() as usize).clamp(1, cells.len());
        chosen.extend((0..count).map(|i| cells[i * cells.len() / count]));
    }
    chosen
}

/// Reads and decodes one page and compares it with the node's record.
fn check_page(
    file: &HlodFile,
    node: &NodeRecord,
    r: &Representation,
) -> Result<PageContent, String> {
    let cell = node.cell;
    let read = || -> Result<PageContent, FormatError> { decode_page(&file.read_page(r.page)?) };
    let content = read().map_err(|error| format!("node {cell}: {error}"))?;
    let PageContent { mesh, points } = &content;
    let found = PageCounts {
        vertices: mesh.positions.len() as u32,
        triangles: mesh.triangles.len() as u32,
        points: points.len() as u32,
    };
    if found != (PageCounts { vertices: r.vertices, triangles: r.triangles, points: r.points }) {
        return Err(format!("node {cell}: its page holds other counts than its record"));
    }
    for (k, (name, range)) in file.header().scalars().enumerate() {
        if mesh.scalars.iter().chain(&points.scalars).any(|s| s.0[k] > range.codes) {
            return Err(format!("node {cell}: a value of {name} lies beyond its range"));
        }
    }
    let lattice = file.header().lattice;
    if points.largest_radius_steps() * lattice.step > f64::from(r.cover_radius) * (1.0 + 1e-6) {
        return Err(format!("node {cell}: a point is larger than its record says"));
    }
    let (lo, edge) = (lattice.cell_min(cell), lattice.cell_units(cell.depth()) as i32);
    // Points are moved by rounding, out of their cell as well.
    let margin = (f64::from(r.errors.geometric) / lattice.step).ceil() as i32;
    let margins = mesh.positions.iter().map(|p| (p, 0));
    for (p, margin) in margins.chain(points.positions.iter().map(|p| (p, margin))) {
        if (0..3).any(|i| p[i] < lo[i] - margin || p[i] > lo[i] + edge + margin) {
            return Err(format!("node {cell}: position {p:?} lies outside its cell"));
        }
        if (0..3).any(|i| p[i] < node.bounds[0][i] || p[i] > node.bounds[1][i]) {
            return Err(format!("node {cell}: position {p:?} lies outside its bounds"));
        }
    }
    Ok(content)
}

/// A parent's bounds must hold its children's.
fn check_monotone(nodes: &[NodeRecord], problems: &mut Vec<String>) {
    let by_cell: BTreeMap<CellKey, &NodeRecord> = nodes.iter().map(|n| (n.cell, n)).collect();
    for node in nodes {
        let Some(parent) = node.cell.parent().and_then(|p| by_cell.get(&p)) else { continue };
        let inside = (0..3).all(|i| {
            node.bounds[0][i] >= parent.bounds[0][i] && node.bounds[1][i] <= parent.bounds[1][i]
        });
        if !inside {
            problems.push(format!("node {}: its bounds exceed its parent's", node.cell));
        }
    }
}
