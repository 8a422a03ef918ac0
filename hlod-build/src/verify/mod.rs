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

pub(crate) mod distance;
mod inner;
mod leaves;
mod normals;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use hlod_compress::{
    CellKey, FormatError, HlodFile, Mesh, NodeRecord, Representation, decode_mesh,
};
use rayon::prelude::*;
use serde::Serialize;

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
    /// `appearance` or `geometric`.
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
}

/// Checks a file, against its inputs where they are given. Of the inner nodes of each depth a
/// `share` from 0 to 1 is sampled, evenly spread, at least one.
///
/// # Errors
/// When the file or an input cannot be read at all. Whatever is wrong inside the file is in the
/// report.
pub fn verify(
    path: &Path,
    against: &[PathBuf],
    share: f64,
    progress: &dyn Progress,
) -> Result<VerifyReport, BuildError> {
    let file = HlodFile::open(path).map_err(BuildError::format(path))?;
    let nodes = file.read_skeleton().map_err(BuildError::format(path))?;
    let sampled = choose(&nodes, share);
    let mut problems = Vec::new();

    // Decode everything once; leaves stay for what follows.
    progress.begin("decode", nodes.len() as u64, Unit::Nodes);
    let decoded: Vec<Result<Vec<Mesh>, String>> = nodes
        .par_iter()
        .map(|node| {
            let meshes = node.representations.iter().map(|r| check_page(&file, node, r));
            progress.advance(1);
            meshes.collect()
        })
        .collect();
    progress.end();
    let mut leaves: BTreeMap<CellKey, Mesh> = BTreeMap::new();
    let mut inner: Vec<(&NodeRecord, Vec<Mesh>)> = Vec::new();
    for (node, meshes) in nodes.iter().zip(decoded) {
        match meshes {
            Ok(mut meshes) if node.is_leaf() => {
                leaves.insert(node.cell, meshes.swap_remove(0));
            }
            Ok(meshes) if sampled.contains(&node.cell) => inner.push((node, meshes)),
            Ok(_) => {}
            Err(problem) => problems.push(problem),
        }
    }
    check_monotone(&nodes, &mut problems);

    let mut leaves_differ = 0;
    if !against.is_empty() {
        let differing = leaves::compare(&file, &leaves, against, progress)?;
        leaves_differ = differing.len() as u64;
        problems.extend(differing);
    }

    progress.begin("sample", inner.iter().map(|(_, m)| m.len() as u64).sum(), Unit::Nodes);
    let checks: Vec<RepresentationCheck> = inner
        .par_iter()
        .flat_map_iter(|(node, meshes)| {
            inner::check(node, meshes, &leaves, &file.header().lattice, progress)
        })
        .collect();
    progress.end();

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
        tightness_median: percentile(0.5),
        tightness_p95: percentile(0.95),
        independent_ratio_max: checks.iter().map(ratio).fold(0.0, f64::max),
        leaves_compared: !against.is_empty(),
        leaves_differ,
        problems,
        representations: checks,
    })
}

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
fn check_page(file: &HlodFile, node: &NodeRecord, r: &Representation) -> Result<Mesh, String> {
    let cell = node.cell;
    let read = || -> Result<Mesh, FormatError> { decode_mesh(&file.read_page(r.page)?) };
    let mesh = read().map_err(|error| format!("node {cell}: {error}"))?;
    if (mesh.positions.len(), mesh.triangles.len()) != (r.vertices as usize, r.triangles as usize) {
        return Err(format!("node {cell}: its page holds other counts than its record"));
    }
    let lattice = file.header().lattice;
    let (lo, edge) = (lattice.cell_min(cell), lattice.cell_units(cell.depth()) as i32);
    for p in &mesh.positions {
        if (0..3).any(|i| p[i] < lo[i] || p[i] > lo[i] + edge) {
            return Err(format!("node {cell}: position {p:?} lies outside its cell"));
        }
        if (0..3).any(|i| p[i] < node.bounds[0][i] || p[i] > node.bounds[1][i]) {
            return Err(format!("node {cell}: position {p:?} lies outside its bounds"));
        }
    }
    Ok(mesh)
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
