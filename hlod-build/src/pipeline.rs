//! The build, as an outline: scan → lattice → leaves → hierarchy → file.

use std::collections::HashMap;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use hlod_compress::{
    AttributeDeclaration, AttributeDomain, AttributeType, BlockRef, CellKey, FileWriter,
    FormatError, Header, Mesh, RepresentationKind, SignedAxis, SourceFile,
};
use hlod_scan::ScanReport;
use serde::Serialize;

use crate::error::BuildError;
use crate::hierarchy::{BuiltNode, build_hierarchy, inner_node_count};
use crate::ingest::{Model, Precision, read_scan};
use crate::output::{Aside, check_output};
use crate::partition::cut_into_leaves;
use crate::progress::{Progress, Unit};
use crate::resources::{Costs, Meter};

/// What a build is asked for.
#[derive(Debug, Clone)]
pub struct BuildOptions {
    /// R: a node may be wrong by its cell's edge divided by this.
    pub resolution: u32,
    /// T: cells with more triangles are split.
    pub leaf_triangles: u32,
    /// Step of the leaves' lattice in the scan's unit; detected or estimated where `None`.
    pub precision: Option<f64>,
    /// The unit of the scan's coordinates.
    pub unit: hlod_compress::Unit,
    /// Which way is up.
    pub up: SignedAxis,
    /// Which way the statue faces.
    pub front: SignedAxis,
    /// Whether an existing output is replaced.
    pub force: bool,
}

impl Default for BuildOptions {
    /// R = 256 and T = 16,384, unit unknown, +y up, front towards +z.
    fn default() -> Self {
        BuildOptions {
            resolution: 256,
            leaf_triangles: 16_384,
            precision: None,
            unit: hlod_compress::Unit::Unknown,
            up: SignedAxis::PLUS_Y,
            front: SignedAxis::PLUS_Z,
            force: false,
        }
    }
}

/// What a build did; the keys are stable.
#[derive(Debug, Serialize)]
pub struct BuildReport {
    /// The file written.
    pub output: PathBuf,
    /// Its length.
    pub bytes_total: u64,
    /// Triangles read.
    pub triangles_input: u64,
    /// Triangles without an area on the lattice, left out.
    pub triangles_degenerate: u64,
    /// Octree nodes.
    pub nodes: u64,
    /// Step of the leaves' lattice in the scan's unit.
    pub precision_step: f64,
    /// Where that step comes from.
    pub precision: Precision,
    /// Whether the surface bounds a volume and faces outwards.
    pub closed_oriented: bool,
    /// Time and memory.
    #[serde(flatten)]
    pub costs: Costs,
    /// What was read, skipped and repaired in each input.
    pub inputs: Vec<ScanReport>,
}

/// Builds `output` from `inputs`.
///
/// Nothing appears under the output's name before it is complete.
///
/// # Errors
/// When an input is not usable, or the output exists, is an input, or cannot be written.
pub fn build(
    inputs: &[PathBuf],
    output: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    if inputs.is_empty() {
        return Err(BuildError::Usage("no input was given".into()));
    }
    check_output(inputs, output, options.force)?;
    let mut meter = Meter::start();

    let scan = read_scan(inputs, progress)?;
    meter.finish_stage("read");

    let triangles_input = scan.mesh.reports.iter().map(triangles_read).sum();
    let (model, sources, reports) = scan.place_on_lattice(options.precision, &inputs[0])?;
    let Model { lattice, mesh, precision, triangles_degenerate, closed_oriented } = model;
    meter.finish_stage("lattice");

    let header = header(options, &mesh, lattice, sources, triangles_input);
    progress.begin("partition", mesh.triangles.len() as u64, Unit::Triangles);
    let leaves = cut_into_leaves(mesh, &lattice, options.leaf_triangles as usize, progress);
    progress.end();
    meter.finish_stage("partition");

    progress.begin("simplify", inner_node_count(&leaves), Unit::Nodes);
    let nodes = build_hierarchy(leaves, &lattice, options.resolution, closed_oriented, progress)
        .map_err(BuildError::format(output))?;
    progress.end();
    meter.finish_stage("simplify");

    let written = write_file(output, header, nodes, progress)?;
    meter.finish_stage("write");

    Ok(BuildReport {
        output: output.to_owned(),
        bytes_total: written.file_bytes,
        triangles_input,
        triangles_degenerate,
        nodes: written.nodes,
        precision_step: lattice.step,
        precision,
        closed_oriented,
        costs: meter.finish(),
        inputs: reports,
    })
}

/// Triangles as the input counts them: faces that the reader already left out included.
fn triangles_read(report: &ScanReport) -> u64 {
    report.triangles + report.degenerate_faces
}

fn header(
    options: &BuildOptions,
    mesh: &Mesh,
    lattice: hlod_compress::Lattice,
    sources: Vec<SourceFile>,
    triangles_input: u64,
) -> Header {
    let attribute = |name: &str, kind| AttributeDeclaration {
        name: name.into(),
        kind,
        domain: AttributeDomain::Vertex,
    };
    let mut attributes = vec![attribute("normal", AttributeType::OctNormal)];
    if mesh.has_colours() {
        attributes.push(attribute("colour", AttributeType::Srgba8));
    }
    let (lo, hi) = mesh.bounds().unwrap_or_default();
    Header {
        unit: options.unit,
        up: options.up,
        front: options.front,
        lattice,
        bounds: [lo, hi],
        sources,
        triangles_input,
        resolution: options.resolution,
        leaf_triangles: options.leaf_triangles,
        attributes,
        // Filled in when the file is laid out.
        nodes: 0,
        skeleton_bytes: 0,
        root_block: BlockRef { offset: 0, block_bytes: 0, crc32: 0 },
        front_bytes: 0,
        file_bytes: 0,
    }
}

/// Lays the file out and writes it aside; it takes its name only when it is on disk.
fn write_file(
    output: &Path,
    header: Header,
    nodes: Vec<BuiltNode>,
    progress: &dyn Progress,
) -> Result<Header, BuildError> {
    let mut records = Vec::with_capacity(nodes.len());
    let mut pages: HashMap<(CellKey, RepresentationKind), Vec<u8>> = HashMap::new();
    for node in nodes {
        for (representation, page) in node.record.representations.iter().zip(node.pages) {
            pages.insert((node.record.cell, representation.kind), page);
        }
        records.push(node.record);
    }
    let writer = FileWriter::new(header, records).map_err(BuildError::format(output))?;
    progress.begin("write", writer.header().file_bytes, Unit::Bytes);

    let aside = Aside::create(output)?;
    let mut out = BufWriter::with_capacity(1 << 20, aside.file());
    writer
        .write(&mut out, |cell, kind| {
            let page = pages.remove(&(cell, kind)).unwrap_or_default();
            progress.advance(page.len() as u64);
            Ok::<_, FormatError>(page)
        })
        .map_err(BuildError::format(output))?;
    out.flush().map_err(BuildError::io(output, "write"))?;
    drop(out);
    aside.commit(output)?;
    progress.end();
    Ok(writer.header().clone())
}
