//! Streaming readers for scans: PLY, OBJ, STL, glTF 2.0, LAS and E57 into batches of vertices
//! and triangles.
//!
//! [`ScanReader`] opens one file and hands out [`Batch`]es in file order; [`load`]
//! reads one or several files as one [`ScanMesh`] in memory.
//!
//! | format | read | memory |
//! |---|---|---|
//! | PLY | ASCII, binary of both byte orders; any element and property | fixed; with faces of four and more corners also 24 bytes a vertex, on disk beyond the room given |
//! | STL | ASCII, binary | fixed |
//! | glTF 2.0 | `.glb`, `.gltf` with sibling files or `data:` URIs | the JSON part, sparse accessors |
//! | LAS, LAZ, E57 | points with colours, behind the features `las` and `e57` | a few batches |
//! | OBJ | vertices, normals, colours, faces | the whole model, on disk beyond the room given |
//! | textures of OBJ, PLY and glTF | PNG, JPEG, TIFF; become colours of vertices | 4 bytes a texel, and 50 bytes a vertex, on disk beyond the room given |
//!
//! Files come from anywhere and are not trusted: a count is compared with the file's
//! size before it is believed, every index is checked, and whatever is wrong is a
//! [`ScanError`] that names file and place.
//!
//! Reading order of the source: `input` (buffer, words, lines), `ply` (the main
//! format), `stl`, `obj`, `gltf`, `texture` (colours
//! from images), then `polygon` (triangulation) and `mesh` (welding,
//! normals).

mod cloud;
mod error;
mod gltf;
mod input;
mod mesh;
mod obj;
mod paged;
mod ply;
mod polygon;
mod project;
mod report;
mod sibling;
mod sniff;
mod stl;
mod texture;
mod transform;

use std::fmt;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

pub use error::{Place, ScanError, Spot};
pub use mesh::{NormalSum, ScanMesh, Weld, angle_weighted_normals, load, weld_exact};
pub use project::{PlacedScan, place_scans};
pub use report::{ScanReport, Station};
pub use texture::{ColourReport, ColourSource, ColourTaken, TextureReport};
pub use transform::Transform;

use input::Input;
use paged::Room;
use transform::Mover;

/// Most properties that can be kept besides shape, normals and colours.
pub const KEEP_MAX: usize = 4;

/// Most vertices or triangles of one batch.
pub const BATCH_ITEMS_MAX: usize = 64 * 1024;

/// Some vertices or some triangles of a scan.
#[derive(Clone, Debug, PartialEq)]
pub enum Batch {
    /// The next vertices; they are numbered through all batches, from 0.
    Vertices(VertexBatch),
    /// The next triangles.
    Triangles(TriangleBatch),
}

/// At most [`BATCH_ITEMS_MAX`] vertices, one array for each attribute.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VertexBatch {
    /// Positions in the file's own coordinates and unit; always finite.
    pub positions: Vec<DVec3>,
    /// Normals of unit length, or zero where the file has none that can be used (zero
    /// length, NaN). Empty if the file has no normals.
    pub normals: Vec<Vec3>,
    /// Red, green, blue in sRGB, then alpha. Empty if the file has no colours.
    pub colours: Vec<[u8; 4]>,
    /// For each property in [`ReadOptions::keep`] its numbers; NaN where the file has none, or not a
    /// finite one.
    pub scalars: Vec<Vec<f64>>,
}

/// At most [`BATCH_ITEMS_MAX`] triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleBatch {
    /// Corners as indices into the file's vertices in order of delivery, each below
    /// the file's vertex count, all three different. In PLY files whose faces come
    /// before the vertices they may name vertices that are delivered later.
    pub triangles: Vec<[u32; 3]>,
}

/// A format read here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ScanFormat {
    /// PLY, numbers as text.
    PlyAscii,
    /// PLY, binary, least significant byte first.
    PlyLittleEndian,
    /// PLY, binary, most significant byte first.
    PlyBigEndian,
    /// Wavefront OBJ.
    Obj,
    /// STL as text.
    StlAscii,
    /// Binary STL.
    StlBinary,
    /// glTF 2.0 as JSON with its buffers elsewhere.
    Gltf,
    /// Binary glTF 2.0.
    Glb,
    /// LAS, or LAZ, which is the same compressed: points.
    Las,
    /// E57: points.
    E57,
}

impl fmt::Display for ScanFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ScanFormat::PlyAscii => "PLY (ASCII)",
            ScanFormat::PlyLittleEndian => "PLY (binary, little endian)",
            ScanFormat::PlyBigEndian => "PLY (binary, big endian)",
            ScanFormat::Obj => "OBJ",
            ScanFormat::StlAscii => "STL (ASCII)",
            ScanFormat::StlBinary => "STL (binary)",
            ScanFormat::Gltf => "glTF 2.0",
            ScanFormat::Glb => "glTF 2.0 (binary)",
            ScanFormat::Las => "LAS",
            ScanFormat::E57 => "E57",
        })
    }
}

/// What is known of a scan before its data is read.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ScanHeader {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: ScanFormat,
    /// Its size.
    pub file_bytes: u64,
    /// Vertices that will be delivered, where the file tells.
    pub vertices_declared: Option<u64>,
    /// Faces in the file, where it tells; not triangles: faces may have more corners.
    pub faces_declared: Option<u64>,
    /// Whether vertex batches have normals.
    pub has_normals: bool,
    /// Whether vertex batches have colours.
    pub has_colours: bool,
    /// Whether the file knows no shared vertices (STL): then there are three vertices
    /// for each triangle, to be welded by equal position.
    pub is_triangle_soup: bool,
    /// Whether the file holds points without triangles, and says so: then there are no triangle
    /// batches.
    pub is_point_cloud: bool,
    /// Names of the numbers that vertices have besides shape, normals and colours, in file order.
    pub scalars: Vec<String>,
}

/// How a scan is read.
pub struct ReadOptions<'a> {
    /// How much memory the reader may take for what it must remember of the file.
    pub memory_bytes: usize,
    /// The folder where it puts the rest meanwhile, in files without names.
    pub scratch: &'a Path,
    /// Where colours are taken from.
    pub colour: ColourSource,
    /// Where the scan stands, if not where it says itself.
    pub transform: Option<Transform>,
    /// Called now and then while the file is opened, which for OBJ takes two passes over all of it;
    /// gets the share of the file's bytes that is done and says whether to go on.
    pub progress: &'a mut dyn FnMut(u64) -> bool,
    /// Vertex properties to be read besides shape, normals and colours, [`KEEP_MAX`] at most, by their
    /// names in the file.
    pub keep: &'a [String],
}

/// One scan file opened for reading; yields batches in file order.
pub struct ScanReader {
    header: ScanHeader,
    report: ScanReport,
    body: Box<dyn ReadBatches>,
    mover: Option<Mover>,
    ended: bool,
    keep_count: usize,
}

impl fmt::Debug for ScanReader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ScanReader")
            .field("header", &self.header)
            .field("report", &self.report)
            .finish_non_exhaustive()
    }
}

/// What each format implements. Vertices and triangles delivered are counted by
/// [`ScanReader`], everything else in the report by the implementation.
trait ReadBatches: Send {
    fn next_batch(&mut self, report: &mut ScanReport) -> Result<Option<Batch>, ScanError>;
    fn bytes_read(&self) -> u64;
}

impl ScanReader {
    /// Opens a scan and reads its header. The format is told by the content first
    /// (magic), by the extension second.
    ///
    /// # Errors
    ///
    /// If the file cannot be opened, is of no format read here, or its header is
    /// wrong: in particular if it declares more than the file can hold.
    pub fn open(path: &Path) -> Result<ScanReader, ScanError> {
        Self::open_in(path, Room::UNBOUNDED, ColourSource::default(), &mut |_| true, &[])
    }

    /// The same with as much memory as is allowed: reads the same, however little it is.
    ///
    /// # Errors
    ///
    /// As [`ScanReader::open`]; if what is set aside cannot be kept on disk; and if the
    /// progress says to stop.
    pub fn open_within(path: &Path, options: ReadOptions<'_>) -> Result<ScanReader, ScanError> {
        let room =
            Room { bytes: options.memory_bytes, scratch: Some(options.scratch.to_path_buf()) };
        let mut reader = Self::open_in(path, room, options.colour, options.progress, options.keep)?;
        if let Some(transform) = &options.transform {
            reader.move_by(transform);
        }
        Ok(reader)
    }

    fn open_in(
        path: &Path,
        room: Room,
        colour: ColourSource,
        progress: &mut dyn FnMut(u64) -> bool,
        keep: &[String],
    ) -> Result<ScanReader, ScanError> {
        let mut input = Input::open(path)?;
        let file_bytes = input.file_bytes();
        let format = sniff::format_of(&mut input)?;
        let mut report = ScanReport::new(path.to_path_buf(), format, file_bytes);
        let opened = match format {
            ScanFormat::PlyAscii | ScanFormat::PlyLittleEndian | ScanFormat::PlyBigEndian => {
                ply::open(input, &room, (colour, keep), &mut report, progress)?
            }
            ScanFormat::Obj => obj::open(input, &room, colour, &mut report, progress)?,
            ScanFormat::Las | ScanFormat::E57 => {
                cloud::open(input, format, (colour, keep), &mut report)?
            }
            ScanFormat::StlAscii => stl::open_ascii(input),
            ScanFormat::StlBinary => stl::open_binary(input, &mut report)?,
            ScanFormat::Gltf | ScanFormat::Glb => {
                gltf::open(input, &room, colour, &mut report, progress)?
            }
        };
        Ok(ScanReader {
            header: ScanHeader {
                path: path.to_path_buf(),
                // The PLY header itself tells which of its three encodings it is.
                format: report.format,
                file_bytes,
                vertices_declared: opened.vertices,
                faces_declared: opened.faces,
                has_normals: opened.has_normals,
                has_colours: opened.has_colours,
                is_triangle_soup: opened.is_triangle_soup,
                is_point_cloud: opened.is_point_cloud,
                scalars: opened.scalars,
            },
            report,
            body: opened.body,
            mover: None,
            ended: false,
            keep_count: keep.len().min(KEEP_MAX),
        })
    }

    /// Has all that is read from now on moved.
    fn move_by(&mut self, transform: &Transform) {
        self.report.transform = Some(*transform);
        if transform.is_mirroring() {
            let warning = "the transform mirrors: triangles are turned round, so that they face outwards as before";
            self.report.warnings.push(warning.to_owned());
        }
        self.mover = Some(Mover::new(transform));
    }

    /// What the file says about itself.
    pub fn header(&self) -> &ScanHeader {
        &self.header
    }

    /// Bytes consumed of the file so far, for progress bars.
    pub fn bytes_read(&self) -> u64 {
        self.body.bytes_read().min(self.header.file_bytes)
    }

    /// The next vertices or triangles, `None` once all were delivered. After an error
    /// there are no more batches.
    ///
    /// # Errors
    ///
    /// If the content is wrong or cut short, and, at the end, if there was no vertex
    /// or no triangle and the file is no point cloud.
    pub fn next_batch(&mut self) -> Result<Option<Batch>, ScanError> {
        if self.ended {
            return Ok(None);
        }
        let mut batch = self.body.next_batch(&mut self.report);
        if let (Ok(Some(moved)), Some(mover)) = (&mut batch, &mut self.mover)
            && let Err(error) = mover.apply(moved, &self.header.path)
        {
            batch = Err(error);
        }
        match &mut batch {
            Ok(Some(Batch::Vertices(batch))) => {
                self.report.vertices += batch.positions.len() as u64;
                // Formats without such properties know nothing of them.
                let none = vec![f64::NAN; batch.positions.len()];
                batch.scalars.resize(self.keep_count, none);
            }
            Ok(Some(Batch::Triangles(batch))) => {
                self.report.triangles += batch.triangles.len() as u64;
            }
            Ok(None) => {
                self.ended = true;
                if let Some(mover) = &self.mover {
                    self.report.stations.iter_mut().for_each(|station| mover.move_station(station));
                }
                self.check_something_was_read()?;
            }
            Err(_) => self.ended = true,
        }
        batch
    }

    /// Counts and remarks; complete only once [`ScanReader::next_batch`] returned
    /// `None`.
    pub fn report(&self) -> &ScanReport {
        &self.report
    }

    fn check_something_was_read(&self) -> Result<(), ScanError> {
        let at = Spot::new(&self.header.path, Place::File);
        let report = &self.report;
        let faces = report.faces_read + report.strips;
        match (report.vertices, report.triangles) {
            (_, 1..) => Ok(()),
            (_, 0) if faces > 0 => Err(ScanError::AllDegenerate { at, faces }),
            (0, 0) => Err(ScanError::NoGeometry { at }),
            (1.., 0) if self.header.is_point_cloud => Ok(()),
            (vertices, 0) => Err(ScanError::PointsOnly { at, vertices }),
        }
    }
}

/// A format's reader after its header: what the header said, and the rest.
struct Opened {
    vertices: Option<u64>,
    faces: Option<u64>,
    has_normals: bool,
    has_colours: bool,
    is_triangle_soup: bool,
    is_point_cloud: bool,
    scalars: Vec<String>,
    body: Box<dyn ReadBatches>,
}

/// A normal as [`VertexBatch`] promises it: of unit length, or zero if `normal` cannot
/// be used, which is then counted.
fn unit_normal(normal: DVec3, report: &mut ScanReport) -> Vec3 {
    let unit = unit_normal_or_zero(normal);
    report.normals_absent += u64::from(unit == Vec3::ZERO);
    unit
}

/// The same, without a report.
fn unit_normal_or_zero(normal: DVec3) -> Vec3 {
    // The longest component first, so that no square overflows or underflows.
    let scale = normal.abs().max_element();
    let unit = (normal / scale).normalize_or_zero();
    if normal.is_finite() { unit.as_vec3() } else { Vec3::ZERO }
}

/// `value` in 0..=1 as an 8-bit number; outside and NaN are clamped.
fn unit_to_byte(value: f64) -> u8 {
    // The cast saturates and maps NaN to 0.
    (value * 255.0).round() as u8
}
