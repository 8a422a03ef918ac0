//! Reads the scans once, into files of vertices and triangles.

use std::path::PathBuf;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use hlod_compress::SourceFile;
use hlod_scan::{Batch, ScanFormat, ScanHeader, ScanReader, ScanReport};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::work_folder::WorkFolder;
use crate::error::BuildError;
use crate::ingest::identify;
use crate::progress::{Progress, Unit};
use crate::spill::RecordWriter;

/// Files of this step.
pub(crate) const VERTICES: &str = "vertices";
pub(crate) const TRIANGLES: &str = "triangles";
const ACCOUNT: &str = "ingest.json";

/// A vertex as scanned.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct ScanVertex {
    pub(crate) position: [f64; 3],
    /// Zero where there is none.
    pub(crate) normal: [f32; 3],
    pub(crate) colour: [u8; 4],
}

/// What was read.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Account {
    pub(crate) vertices: u64,
    pub(crate) triangles: u64,
    pub(crate) min: [f64; 3],
    pub(crate) max: [f64; 3],
    pub(crate) has_colours: bool,
    /// Whether some vertex has no normal.
    pub(crate) lacks_normals: bool,
    pub(crate) sources: Vec<Source>,
    pub(crate) reports: Vec<ScanReport>,
}

/// What identifies an input.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Source {
    base_name: String,
    file_bytes: u64,
    sha256: String,
}

/// Does the step unless it is done, and says what was read.
pub(crate) fn ingest(
    folder: &WorkFolder,
    inputs: &[PathBuf],
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Account, BuildError> {
    let account_file = folder.file(ACCOUNT);
    folder.step("ingest", &[VERTICES, TRIANGLES, ACCOUNT], || {
        let (account, identities) = rayon::join(
            || read_all(folder, inputs, memory_bytes, progress),
            || inputs.par_iter().map(|p| identify(p)).collect::<Result<Vec<_>, _>>(),
        );
        let mut account = account?;
        account.sources = identities?.iter().map(Source::of).collect();
        super::write_json(&account_file, &account)
    })?;
    super::read_json(&account_file)
}

impl Source {
    fn of(file: &SourceFile) -> Source {
        let sha256 = file.sha256.iter().map(|byte| format!("{byte:02x}")).collect();
        Source { base_name: file.base_name.clone(), file_bytes: file.file_bytes, sha256 }
    }

    pub(crate) fn to_source_file(&self) -> SourceFile {
        let byte = |i: usize| {
            let digits = self.sha256.get(2 * i..2 * i + 2);
            digits.and_then(|d| u8::from_str_radix(d, 16).ok()).unwrap_or_default()
        };
        SourceFile {
            base_name: self.base_name.clone(),
            file_bytes: self.file_bytes,
            sha256: std::array::from_fn(byte),
        }
    }
}

/// Names vertices by the first of their position.
fn weld(
    positions: &[DVec3],
    mut triangles: Vec<[u32; 3]>,
    first_vertex: u32,
    report: &mut ScanReport,
) -> Vec<[u32; 3]> {
    let weld = hlod_scan::weld_exact(positions);
    report.vertices_welded = (weld.new_from_old.len() - weld.old_from_new.len()) as u64;
    let before = triangles.len();
    triangles.retain_mut(|t| {
        let first = |v: u32| weld.old_from_new[weld.new_from_old[v as usize] as usize];
        *t = t.map(|v| first(v) + first_vertex);
        t[0] != t[1] && t[1] != t[2] && t[2] != t[0]
    });
    let dropped = (before - triangles.len()) as u64;
    report.degenerate_faces += dropped;
    report.triangles -= dropped;
    triangles
}

/// Refuses what could only be read with more memory than there is, before any of it is read.
fn check_memory(header: &ScanHeader, memory_bytes: usize) -> Result<(), BuildError> {
    let (needed, why) = match header.format {
        // Positions, texture coordinates and faces as numbers take about what their digits do.
        ScanFormat::Obj => (header.file_bytes, "an OBJ file is read as a whole"),
        _ if header.is_triangle_soup => {
            // 50 bytes a triangle in STL; a position, its bits and an entry of a table each.
            let triangles = header.file_bytes / 50;
            (triangles * 250, "triangles without shared vertices are joined in memory")
        }
        _ => return Ok(()),
    };
    if needed > memory_bytes as u64 {
        return Err(BuildError::Memory {
            path: header.path.clone(),
            why,
            needed_bytes: needed,
            budget_bytes: memory_bytes as u64,
        });
    }
    Ok(())
}

fn read_all(
    folder: &WorkFolder,
    inputs: &[PathBuf],
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Account, BuildError> {
    let mut bytes_total = 0;
    for path in inputs {
        let metadata = std::fs::metadata(path).map_err(BuildError::io(path, "open"))?;
        bytes_total += metadata.len();
    }
    progress.begin("read", bytes_total, Unit::Bytes);
    let mut account = Account {
        vertices: 0,
        triangles: 0,
        min: [f64::INFINITY; 3],
        max: [f64::NEG_INFINITY; 3],
        has_colours: false,
        lacks_normals: false,
        sources: Vec::new(),
        reports: Vec::new(),
    };
    let mut vertices = RecordWriter::create(&folder.file(VERTICES))?;
    let mut triangles = RecordWriter::create(&folder.file(TRIANGLES))?;
    for path in inputs {
        let mut reader = ScanReader::open(path)?;
        let header = reader.header().clone();
        account.has_colours |= header.has_colours;
        let first_vertex = account.vertices;
        let mut bytes_before = 0;
        check_memory(&header, memory_bytes)?;
        // Positions and triangles of a soup, which have to be in memory together to be welded.
        let mut soup = header.is_triangle_soup.then(|| (Vec::new(), Vec::new()));
        while let Some(batch) = reader.next_batch()? {
            match batch {
                Batch::Vertices(batch) => {
                    let mut records = Vec::with_capacity(batch.positions.len());
                    for (i, p) in batch.positions.iter().enumerate() {
                        // Facets' normals say nothing that positions do not.
                        let normal = match batch.normals.get(i) {
                            Some(normal) if soup.is_none() => normal.to_array(),
                            _ => [0.0; 3],
                        };
                        account.lacks_normals |= normal == [0.0; 3];
                        for axis in 0..3 {
                            account.min[axis] = account.min[axis].min(p[axis]);
                            account.max[axis] = account.max[axis].max(p[axis]);
                        }
                        let colour = batch.colours.get(i).copied().unwrap_or([255; 4]);
                        records.push(ScanVertex { position: p.to_array(), normal, colour });
                    }
                    if let Some((positions, _)) = &mut soup {
                        positions.extend(&batch.positions);
                    }
                    vertices.put(&records)?;
                    account.vertices += records.len() as u64;
                    if account.vertices > u64::from(u32::MAX) {
                        return Err(BuildError::Usage(format!(
                            "{}: the inputs have more than {} vertices together",
                            path.display(),
                            u32::MAX
                        )));
                    }
                }
                Batch::Triangles(batch) => {
                    let shifted =
                        batch.triangles.iter().map(|t| t.map(|v| v + first_vertex as u32));
                    let shifted: Vec<[u32; 3]> = shifted.collect();
                    match &mut soup {
                        Some((_, triangles)) => triangles.extend(&batch.triangles),
                        None => {
                            account.triangles += shifted.len() as u64;
                            triangles.put(&shifted)?;
                        }
                    }
                }
            }
            folder.check_stop(progress)?;
            progress.advance(reader.bytes_read().saturating_sub(bytes_before));
            bytes_before = bytes_before.max(reader.bytes_read());
        }
        let mut report = reader.report().clone();
        if let Some((positions, soup)) = soup {
            let welded = weld(&positions, soup, first_vertex as u32, &mut report);
            account.triangles += welded.len() as u64;
            triangles.put(&welded)?;
        }
        if report.triangles == 0 {
            return Err(BuildError::NoTriangles { path: path.clone(), faces: report.faces_read });
        }
        account.reports.push(report);
    }
    vertices.finish()?;
    triangles.finish()?;
    progress.end();
    Ok(account)
}
