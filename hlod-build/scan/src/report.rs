//! What was read, counted: the account that a reader gives of one file.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::ScanFormat;
use crate::texture::ColourReport;
use crate::transform::Transform;

/// Counts and remarks about one file, complete once its last batch was read.
///
/// Keys may be added; they are never renamed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ScanReport {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: ScanFormat,
    /// Its size, without any files that it refers to.
    pub file_bytes: u64,
    /// Vertices delivered.
    pub vertices: u64,
    /// Triangles delivered.
    pub triangles: u64,
    /// Face records read, whatever their number of corners; strips are counted apart.
    pub faces_read: u64,
    /// Of these, faces of four and more corners, which were cut into triangles.
    pub polygons_triangulated: u64,
    /// Triangle strips (and fans) read.
    pub strips: u64,
    /// Faces dropped because they have fewer than three different corners.
    pub degenerate_faces: u64,
    /// Triangles of strips dropped because they repeat a corner. Writers put them
    /// there on purpose, to turn a corner or to jump.
    pub strip_stitches: u64,
    /// Vertices of a file with normals whose own normal is zero or not a number.
    pub normals_absent: u64,
    /// Points passed over because their scan says that they are none.
    #[serde(default)]
    pub points_invalid: u64,
    /// Where the scans of a cloud were taken from, in their order.
    #[serde(default)]
    pub stations: Vec<Station>,
    /// Vertices merged because their positions are equal ([`load`](crate::load) only).
    pub vertices_welded: u64,
    /// Where it was told to stand; positions and normals delivered are moved by it.
    #[serde(default)]
    pub transform: Option<Transform>,
    /// Where colours come from.
    #[serde(default)]
    pub colours: ColourReport,
    /// Elements, properties and primitives passed over, by name, in file order.
    pub skipped: Vec<String>,
    /// What is odd about the file, but no reason to refuse it.
    pub warnings: Vec<String>,
}

/// One scan of a cloud of several.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Station {
    /// Its points begin here; they end where those of the next one begin.
    pub first_vertex: u64,
    /// Where the scanner stood, in the coordinates of what is delivered; `None` if that is unknown.
    pub position: Option<[f64; 3]>,
}

impl ScanReport {
    pub(crate) fn new(path: PathBuf, format: ScanFormat, file_bytes: u64) -> ScanReport {
        ScanReport {
            path,
            format,
            file_bytes,
            vertices: 0,
            triangles: 0,
            faces_read: 0,
            polygons_triangulated: 0,
            strips: 0,
            degenerate_faces: 0,
            strip_stitches: 0,
            normals_absent: 0,
            transform: None,
            colours: ColourReport::default(),
            points_invalid: 0,
            stations: Vec::new(),
            vertices_welded: 0,
            skipped: Vec::new(),
            warnings: Vec::new(),
        }
    }
}
