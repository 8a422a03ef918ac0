//! Reads the scans once, into files of vertices and triangles.

use bytemuck::{Pod, Zeroable};
use hlod_compress::{SCALARS_MAX, ScalarRange, SourceFile};
use hlod_scan::{
    Batch, ColourSource, PlacedScan, ReadOptions, ScanError, ScanHeader, ScanReader, ScanReport,
    Station, VertexBatch,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::normals::{NEIGHBOURS, estimate};
use super::overlap::overlap;
use super::weld::Soup;
use super::work_folder::WorkFolder;
use crate::error::BuildError;
use crate::ingest::identify;
use crate::kept::{KeptScalar, ScalarAccount};
use crate::progress::{Progress, Unit};
use crate::spill::RecordWriter;

/// Files of this step.
pub(crate) const VERTICES: &str = "vertices";
pub(crate) const TRIANGLES: &str = "triangles";
const SOUP: &str = "soup";
pub(crate) const ACCOUNT: &str = "ingest.json";
/// Numbers that are kept, of vertices; there is no such file where none are.
pub(crate) const SCALARS: &str = "scalars";

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
    /// Numbers that are kept.
    pub(crate) scalars: Vec<ScalarAccount>,
    /// Vertices without a normal.
    pub(crate) normals_lacking: u64,
    /// Of points, those that were estimated.
    #[serde(default)]
    pub(crate) normals_estimated: u64,
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
    (colour, keep): (ColourSource, &[KeptScalar]),
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<Account, BuildError> {
    let account_file = folder.file(ACCOUNT);
    let files = [VERTICES, TRIANGLES, ACCOUNT, SCALARS];
    let files = if keep.is_empty() { &files[..3] } else { &files };
    folder.step("ingest", files, || {
        let (account, identities) = rayon::join(
            || read_all(folder, scans, (colour, keep), memory_bytes, progress),
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
    (colour, keep): (ColourSource, &[KeptScalar]),
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
        scalars: keep.iter().map(ScalarAccount::new).collect(),
        normals_lacking: 0,
        normals_estimated: 0,
        is_cloud: false,
        sources: Vec::new(),
        reports: Vec::new(),
    };
    let mut vertices = RecordWriter::create(&folder.file(VERTICES))?;
    let mut triangles = RecordWriter::create(&folder.file(TRIANGLES))?;
    let scalars = (!keep.is_empty()).then(|| RecordWriter::create(&folder.file(SCALARS)));
    let mut scalars = scalars.transpose()?;
    let names: Vec<String> = keep.iter().map(|kept| kept.name.clone()).collect();
    let mut stations = Vec::new();
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
            keep: &names,
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
        let lacking = note_scalars(&mut account, &header, number + 1 == scans.len())?;
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
                    if let Some(scalars) = &mut scalars {
                        scalars.put(&account.take_scalars(&batch))?;
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
        report.warnings.extend(lacking);
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
        stations.extend(stations_of(&report, first_vertex));
        report.warnings.extend(scan.remarks.iter().cloned());
        account.reports.push(report);
    }
    vertices.finish()?;
    triangles.finish()?;
    scalars.map(RecordWriter::finish).transpose()?;
    // What cannot be is said before the long steps.
    account.ranges()?;
    progress.end();
    if account.is_cloud && account.normals_lacking > 0 {
        let path = &scans[0].path;
        let (count, by_scanner) = estimate(folder, path, &stations, memory_bytes, progress)?;
        account.normals_estimated = count;
        let sides = if by_scanner { "towards the scanners" } else { "alike, and outwards" };
        account.reports[0].warnings.push(format!(
            "{count} points have no normals: these are estimated from {NEIGHBOURS} neighbours each and turned {sides}"
        ));
    }
    Ok(account)
}

/// Notes which numbers an input has; says which it lacks, and refuses what none has.
fn note_scalars(
    account: &mut Account,
    header: &ScanHeader,
    is_last: bool,
) -> Result<Vec<String>, BuildError> {
    let mut lacking = Vec::new();
    for scalar in &mut account.scalars {
        let name = &scalar.kept.name;
        if header.scalars.contains(name) {
            scalar.is_there = true;
        } else {
            lacking.push(format!("has no {name}: not known of its vertices"));
        }
    }
    match account.scalars.iter().find(|scalar| is_last && !scalar.is_there) {
        None => Ok(lacking),
        Some(scalar) => {
            let there = match &header.scalars[..] {
                [] => "no numbers besides shape and colour".to_owned(),
                names => names.join(", "),
            };
            let (path, kept) = (header.path.display(), &scalar.kept);
            Err(BuildError::Usage(format!("--keep {kept}: {path} has {there}")))
        }
    }
}

impl Account {
    /// Counts a batch's numbers; gives them as records.
    fn take_scalars(&mut self, batch: &VertexBatch) -> Vec<[f64; SCALARS_MAX]> {
        let mut records = vec![[f64::NAN; SCALARS_MAX]; batch.positions.len()];
        for (k, (account, column)) in self.scalars.iter_mut().zip(&batch.scalars).enumerate() {
            for (record, &value) in records.iter_mut().zip(column) {
                account.add(value);
                record[k] = value;
            }
        }
        records
    }

    /// How codes stand for the numbers that are kept.
    pub(crate) fn ranges(&self) -> Result<Vec<ScalarRange>, BuildError> {
        self.scalars.iter().map(ScalarAccount::range).collect()
    }
}

/// Where the scans of an input were taken from, by the number of their first vertex among all.
fn stations_of(report: &ScanReport, first_vertex: u64) -> Vec<Station> {
    if report.stations.is_empty() {
        return vec![Station { first_vertex, position: None }];
    }
    let shifted = report
        .stations
        .iter()
        .map(|station| Station { first_vertex: first_vertex + station.first_vertex, ..*station });
    shifted.collect()
}
