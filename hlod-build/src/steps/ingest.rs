//! Reads the scans once, into files of vertices and triangles.

use bytemuck::{Pod, Zeroable};
use hlod_compress::SourceFile;
use hlod_scan::{Batch, ColourSource, PlacedScan, ReadOptions, ScanError, ScanReader, ScanReport};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::overlap::overlap;
use super::weld::Soup;
use super::work_folder::WorkFolder;
use crate::error::BuildError;
use crate::ingest::identify;
use crate::progress::{Progress, Unit};
use crate::spill::RecordWriter;

/// Files of this step.
pub(crate) const VERTICES: &str = "vertices";
pub(crate) const TRIANGLES: &str = "triangles";
const SOUP: &str = "soup";
pub(crate) const ACCOUNT: &str = "ingest.json";

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
    /// Vertices without a normal.
    pub(crate) normals_lacking: u64,
    /// Whether these are point clouds: then vertices are all there is.
    pub(crate) is_cloud: bool,
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
    scans: &[PlacedScan],
    colour: ColourSource,
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Account, BuildError> {
    let account_file = folder.file(ACCOUNT);
    folder.step("ingest", &[VERTICES, TRIANGLES, ACCOUNT], || {
        let (account, identities) = rayon::join(
            || read_all(folder, scans, colour, memory_bytes, progress),
            || scans.par_iter().map(|scan| identify(&scan.path)).collect::<Result<Vec<_>, _>>(),
        );
        let mut account = account?;
        account.sources = identities?.iter().map(Source::of).collect();
        folder.check_inputs(scans)?;
        super::write_json(&account_file, &account)
    })?;
    read_account(folder)
}

/// What a step that is done has read.
pub(crate) fn read_account(folder: &WorkFolder) -> Result<Account, BuildError> {
    super::read_json(&folder.file(ACCOUNT))
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

fn read_all(
    folder: &WorkFolder,
    scans: &[PlacedScan],
    colour: ColourSource,
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Account, BuildError> {
    let mut bytes_total = 0;
    for PlacedScan { path, .. } in scans {
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
        normals_lacking: 0,
        is_cloud: false,
        sources: Vec::new(),
        reports: Vec::new(),
    };
    let mut vertices = RecordWriter::create(&folder.file(VERTICES))?;
    let mut triangles = RecordWriter::create(&folder.file(TRIANGLES))?;
    for (number, scan) in scans.iter().enumerate() {
        let path = &scan.path;
        let mut bytes_before = 0;
        let mut advance = |bytes: u64| {
            progress.advance(bytes.saturating_sub(bytes_before));
            bytes_before = bytes_before.max(bytes);
        };
        let mut while_opening = |bytes: u64| {
            advance(bytes);
            !progress.is_stopped()
        };
        let scratch = folder.file("");
        let within = ReadOptions {
            memory_bytes,
            scratch: &scratch,
            colour,
            transform: scan.transform,
            progress: &mut while_opening,
        };
        let mut reader = match ScanReader::open_within(path, within) {
            Err(ScanError::Stopped { .. }) => return Err(BuildError::Stopped(scratch)),
            opened => opened?,
        };
        let header = reader.header().clone();
        account.has_colours |= header.has_colours;
        if number > 0 && account.is_cloud != header.is_point_cloud {
            return Err(BuildError::MixedInputs {
                path: path.clone(),
                is_cloud: header.is_point_cloud,
            });
        }
        account.is_cloud = header.is_point_cloud;
        let first_vertex = account.vertices;
        // Three vertices in the 50 bytes that a triangle takes in STL, where nothing is declared.
        let vertices_max = header.vertices_declared.unwrap_or(header.file_bytes / 50 * 3);
        let begin = || Soup::begin(&folder.file(SOUP), vertices_max, memory_bytes);
        let mut soup = header.is_triangle_soup.then(begin).transpose()?;
        let read = |emit: &mut dyn FnMut((Batch, u64)) -> Result<(), BuildError>| {
            while let Some(batch) = reader.next_batch()? {
                emit((batch, reader.bytes_read()))?;
            }
            Ok(reader.report().clone())
        };
        let take = |(batch, bytes_read)| {
            match batch {
                Batch::Vertices(batch) => {
                    let mut records = Vec::with_capacity(batch.positions.len());
                    for (i, p) in batch.positions.iter().enumerate() {
                        // Facets' normals say nothing that positions do not.
                        let normal = match batch.normals.get(i) {
                            Some(normal) if soup.is_none() => normal.to_array(),
                            _ => [0.0; 3],
                        };
                        account.normals_lacking += u64::from(normal == [0.0; 3]);
                        for axis in 0..3 {
                            account.min[axis] = account.min[axis].min(p[axis]);
                            account.max[axis] = account.max[axis].max(p[axis]);
                        }
                        let colour = batch.colours.get(i).copied().unwrap_or([255; 4]);
                        records.push(ScanVertex { position: p.to_array(), normal, colour });
                    }
                    if let Some(soup) = &mut soup {
                        soup.add_vertices(&batch.positions)?;
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
                        Some(soup) => soup.add_triangles(&batch.triangles)?,
                        None => {
                            account.triangles += shifted.len() as u64;
                            triangles.put(&shifted)?;
                        }
                    }
                }
            }
            advance(bytes_read);
            folder.check_stop(progress)
        };
        let mut report = overlap(read, take)?;
        if let Some(soup) = soup {
            let welded = soup.finish(first_vertex as u32, &mut triangles)?;
            account.triangles += welded.triangles;
            report.vertices_welded = welded.vertices;
            report.degenerate_faces += welded.degenerate;
            report.triangles -= welded.degenerate;
        }
        if report.triangles == 0 && !account.is_cloud {
            return Err(BuildError::NoTriangles { path: path.clone(), faces: report.faces_read });
        }
        report.warnings.extend(scan.remarks.iter().cloned());
        account.reports.push(report);
    }
    if account.is_cloud && account.normals_lacking > 0 {
        let path = scans[0].path.clone();
        let (lacking, points) = (account.normals_lacking, account.vertices);
        return Err(BuildError::NoNormals { path, lacking, points });
    }
    vertices.finish()?;
    triangles.finish()?;
    progress.end();
    Ok(account)
}
