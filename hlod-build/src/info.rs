//! What is in a file, level by level.

use std::collections::BTreeMap;
use std::path::Path;

use hlod_compress::{BoundStatus, HlodFile, Metadata, NodeRecord, RepresentationKind, ScalarRange};
use serde::Serialize;

use crate::error::BuildError;

/// Contents of an `.hlod` file; the keys are stable.
#[derive(Debug, Serialize)]
pub struct Info {
    /// Format version.
    pub format_version: u32,
    /// Unit of lengths, or `unknown`.
    pub unit: &'static str,
    /// Which source axis points up.
    pub up: String,
    /// Which source axis points to the front.
    pub front: String,
    /// Lowest corner of all geometry, in source coordinates.
    pub bounds_min: [f64; 3],
    /// Highest corner.
    pub bounds_max: [f64; 3],
    /// Distance between the positions that leaves can have: their precision.
    pub precision_step: f64,
    /// Build option R.
    pub resolution: u32,
    /// Build option T.
    pub leaf_triangles: u32,
    /// Differences of normals below this many times their noise did not count as shading.
    pub normal_noise: f32,
    /// What levels above the leaves are drawn with: `triangles`, `hybrid` or `points`.
    pub representation: &'static str,
    /// What drawing a point was taken to cost, in triangles.
    pub point_cost: f32,
    /// Attributes of vertices.
    pub attributes: Vec<String>,
    /// Numbers of the scan's vertices that were kept.
    pub scalars: Vec<ScalarInfo>,
    /// What is known of the scan besides its shape, as it was given; null where nothing is.
    pub metadata: Option<serde_json::Value>,
    /// The same for people: names and values of the keys that are known.
    pub about: Vec<(String, String)>,
    /// The inputs: base name, bytes, SHA-256.
    pub sources: Vec<SourceInfo>,
    /// Triangles read from the inputs.
    pub triangles_input: u64,
    /// Points read, where the scan is a point cloud.
    pub points_input: u64,
    /// Octree nodes.
    pub nodes: u64,
    /// Whether every node is marked as closed and outward facing.
    pub closed_oriented: bool,
    /// How far errors can be trusted: `measured` or `proven`.
    pub error_status: &'static str,
    /// Length of the file: the sum of the five parts.
    pub bytes_total: u64,
    /// Pages of leaves.
    pub bytes_leaves: u64,
    /// Appearance pages above the leaves.
    pub bytes_appearance_upper: u64,
    /// Geometric pages above the leaves.
    pub bytes_geometric_upper: u64,
    /// Header and skeleton.
    pub bytes_skeleton: u64,
    /// What is known of the scan besides its shape.
    pub bytes_metadata: u64,
    /// Nodes with an error above their budget, the cell's edge ÷ R.
    pub nodes_over_budget: u64,
    /// One a depth.
    pub levels: Vec<Level>,
}

/// A number of the scan's vertices that was kept.
#[derive(Debug, Serialize)]
pub struct ScalarInfo {
    /// Its name in the scan.
    pub name: String,
    /// What it is in; empty where nobody said.
    pub unit: String,
    /// The least value; null where no vertex has any.
    pub minimum: Option<f64>,
    /// The largest.
    pub maximum: Option<f64>,
    /// How far values of leaves may be from the scan's: half of `step`.
    pub precision: f64,
    /// From one value that can be stored to the next.
    pub step: f64,
}

impl ScalarInfo {
    fn of((name, range): (&str, &ScalarRange)) -> ScalarInfo {
        ScalarInfo {
            name: name.to_owned(),
            unit: range.unit.clone(),
            minimum: range.value(1.min(range.codes)),
            maximum: range.value(range.codes),
            precision: range.step / 2.0,
            step: range.step,
        }
    }
}

/// An input file.
#[derive(Debug, Serialize)]
pub struct SourceInfo {
    /// Name without folders.
    pub base_name: String,
    /// Size.
    pub file_bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

/// One depth of the octree.
#[derive(Debug, Default, Serialize)]
pub struct Level {
    /// Depth; the root has 0.
    pub depth: u8,
    /// Nodes, leaves included.
    pub nodes: u64,
    /// Leaves among them.
    pub leaves: u64,
    /// Mean triangles of a node for receivers.
    pub triangles_mean: f64,
    /// Mean points of a node for receivers.
    pub points_mean: f64,
    /// Largest radius at which points cover, in the source's unit.
    pub cover_radius_max: f64,
    /// Mean triangles of a node for casters.
    pub triangles_geometric_mean: f64,
    /// Largest geometric error for receivers, in the source's unit.
    pub error_max: f64,
    /// Largest estimate of how far what is seen is from its place, for receivers, in the source's
    /// unit.
    pub visual_error_max: f64,
    /// Largest distance, for receivers, of the lines in which nodes end on the faces of their cells
    /// from the scan's sections with them, in the source's unit.
    pub border_error_max: f64,
    /// Deviation of normals for receivers, in degrees: over all, 99 and 90 % of a node's area,
    /// mean over nodes.
    pub normal_deviation_deg_mean: [f64; 3],
}

/// Reads what is in a file.
///
/// # Errors
/// When the file cannot be read or is damaged.
pub fn info(path: &Path) -> Result<Info, BuildError> {
    let file = HlodFile::open(path).map_err(BuildError::format(path))?;
    let nodes = file.read_skeleton().map_err(BuildError::format(path))?;
    let metadata = file.read_metadata().map_err(BuildError::format(path))?;
    let header = file.header();
    let metadata_bytes = header.metadata.map_or(0, |m| u64::from(m.text_bytes));

    let [mut leaves, mut appearance, mut geometric] = [0; 3];
    let mut proven = true;
    for representation in nodes.iter().flat_map(|n| &n.representations) {
        let bytes = u64::from(representation.page.page_bytes);
        match representation.kind {
            RepresentationKind::Source => leaves += bytes,
            RepresentationKind::Appearance => appearance += bytes,
            _ => geometric += bytes,
        }
        proven &= representation.errors.geometric_status == BoundStatus::Proven;
    }
    let is_over = |node: &&NodeRecord| {
        let budget = header.lattice.cell_edge(node.cell.depth()) / f64::from(header.resolution);
        let errors = node.representations.iter().map(|r| f64::from(r.errors.geometric));
        errors.fold(0.0, f64::max) > budget * (1.0 + 1e-5)
    };
    Ok(Info {
        nodes_over_budget: nodes.iter().filter(is_over).count() as u64,
        format_version: header.format_version(),
        unit: header.unit.name(),
        up: header.up.to_string(),
        front: header.front.to_string(),
        bounds_min: header.lattice.position(header.bounds[0]),
        bounds_max: header.lattice.position(header.bounds[1]),
        precision_step: header.lattice.step,
        resolution: header.resolution,
        leaf_triangles: header.leaf_triangles,
        normal_noise: header.normal_noise,
        representation: header.primitives.name(),
        point_cost: header.point_cost,
        attributes: header.attributes.iter().map(|a| a.name.clone()).collect(),
        scalars: header.scalars().map(ScalarInfo::of).collect(),
        metadata: metadata.as_ref().map(Metadata::value),
        about: metadata.as_ref().map(Metadata::lines).unwrap_or_default(),
        sources: header
            .sources
            .iter()
            .map(|s| SourceInfo {
                base_name: s.base_name.clone(),
                file_bytes: s.file_bytes,
                sha256: s.sha256.iter().map(|b| format!("{b:02x}")).collect(),
            })
            .collect(),
        triangles_input: header.triangles_input,
        points_input: header.points_input,
        nodes: header.nodes,
        closed_oriented: nodes.iter().all(|n| n.flags.closed_oriented),
        error_status: if proven { "proven" } else { "measured" },
        bytes_total: header.file_bytes,
        bytes_leaves: leaves,
        bytes_appearance_upper: appearance,
        bytes_geometric_upper: geometric,
        bytes_skeleton: header.file_bytes - leaves - appearance - geometric - metadata_bytes,
        bytes_metadata: metadata_bytes,
        levels: levels(&nodes),
    })
}

fn levels(nodes: &[NodeRecord]) -> Vec<Level> {
    let mut levels: BTreeMap<u8, Level> = BTreeMap::new();
    for node in nodes {
        let depth = node.cell.depth();
        let level = levels.entry(depth).or_insert_with(|| Level { depth, ..Level::default() });
        level.nodes += 1;
        level.leaves += u64::from(node.is_leaf());
        if let Some(r) = node.representation(RepresentationKind::Appearance) {
            level.triangles_mean += f64::from(r.triangles);
            level.points_mean += f64::from(r.points);
            level.cover_radius_max = level.cover_radius_max.max(f64::from(r.cover_radius));
            level.error_max = level.error_max.max(f64::from(r.errors.geometric));
            level.border_error_max = level.border_error_max.max(f64::from(r.errors.border));
            level.visual_error_max = level.visual_error_max.max(f64::from(r.errors.visual));
            for (sum, angle) in
                level.normal_deviation_deg_mean.iter_mut().zip(r.errors.normal_deviation_deg)
            {
                *sum += f64::from(angle);
            }
        }
        if let Some(r) = node.representation(RepresentationKind::Geometric) {
            level.triangles_geometric_mean += f64::from(r.triangles);
        }
    }
    for level in levels.values_mut() {
        let count = level.nodes as f64;
        level.triangles_mean /= count;
        level.points_mean /= count;
        level.triangles_geometric_mean /= count;
        level.normal_deviation_deg_mean = level.normal_deviation_deg_mean.map(|sum| sum / count);
    }
    levels.into_values().collect()
}
