//! What can go wrong while reading a scan, told so that the user can act on it.
//!
//! Every variant carries a [`Spot`]: the file, and the byte, line or JSON item in
//! it. A message says what was wrong, then, where something can be done, what.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why a scan could not be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ScanError {
    /// No file of this name.
    #[error("{at}: there is no such file; check the name and the folder")]
    NotFound {
        /// Which file.
        at: Spot,
    },

    /// A folder, pipe or device instead of a file.
    #[error("{at}: not a regular file; name the scan file itself")]
    NotAFile {
        /// Which file.
        at: Spot,
    },

    /// `load` was given no file at all.
    #[error("{at}: no input file was named; name at least one")]
    NoInput {
        /// Names no file.
        at: Spot,
    },

    /// Neither content nor extension is that of a format read here.
    #[error(
        "{at}: neither the content nor the extension is PLY, OBJ, STL, glTF 2.0, LAS or E57; \
         convert the scan to one of these (binary PLY keeps most)"
    )]
    UnknownFormat {
        /// Which file.
        at: Spot,
    },

    /// A texture that has to be used cannot be.
    #[error("{at}: texture `{name}` {what}, or give --colour none")]
    Texture {
        /// The scan.
        at: Spot,
        /// As the scan names it.
        name: String,
        /// Why not, and what can be done.
        what: String,
    },

    /// Colours are to be taken from textures, and there are none.
    #[error(
        "{at}: has no texture, from which --colour texture takes colours; give --colour vertex or none"
    )]
    NoTexture {
        /// The scan.
        at: Spot,
    },

    /// Transforms were given for some inputs only.
    #[error(
        "{at}: {transforms} transforms for {inputs} inputs; give one for each, `none` where there is none"
    )]
    Transforms {
        /// The first input.
        at: Spot,
        /// How many were given.
        transforms: usize,
        /// For how many inputs.
        inputs: usize,
    },

    /// Textures take more memory than is allowed.
    #[error(
        "{at}: its textures up to `{name}` take {} MiB, where {} MiB of --memory are for them; give \
         --memory {} MiB, scale them down, or give --colour none",
        needed_bytes.div_ceil(1 << 20), allowed_bytes >> 20, needed_bytes.div_ceil(1 << 20) * 5 + 64
    )]
    TexturesTooLarge {
        /// The scan.
        at: Spot,
        /// The texture that does not fit.
        name: String,
        /// What those before and this one take.
        needed_bytes: u64,
        /// What they may take.
        allowed_bytes: u64,
    },

    /// Zero bytes long.
    #[error("{at}: the file is empty; copy or export it again")]
    EmptyFile {
        /// Which file.
        at: Spot,
    },

    /// The operating system refused to open or read.
    #[error("{at}: cannot be read: {source}")]
    Io {
        /// Where reading failed.
        at: Spot,
        /// The system's reason.
        source: io::Error,
    },

    /// What had to be set aside while reading cannot be written or read back.
    #[error("{at}: what is set aside while reading it cannot be kept on disk: {source}")]
    Scratch {
        /// The scan.
        at: Spot,
        /// The system's reason.
        source: io::Error,
    },

    /// The caller's progress said to stop.
    #[error("{at}: reading was stopped")]
    Stopped {
        /// The scan.
        at: Spot,
    },

    /// The file breaks the rules of its format.
    #[error("{at}: {what}")]
    Malformed {
        /// Where.
        at: Spot,
        /// Which rule, and what was found instead.
        what: String,
    },

    /// The file keeps the rules, but uses something not read here.
    #[error("{at}: {what} is not supported; {advice}")]
    Unsupported {
        /// Where.
        at: Spot,
        /// The thing used, by its name.
        what: String,
        /// What to do instead.
        advice: &'static str,
    },

    /// The file ends before its content does.
    #[error("{at}: the file ends inside {what}; it was cut short, copy or export it again")]
    Truncated {
        /// Where the data ends.
        at: Spot,
        /// What was being read.
        what: String,
    },

    /// A declared count cannot fit the file. Found before anything is allocated.
    #[error(
        "{at}: {declared} {what} are declared, but the file has room for {possible} at most; \
         it was cut short or its header is damaged, copy or export it again"
    )]
    CountTooLarge {
        /// Where the data that the count speaks of begins.
        at: Spot,
        /// What is counted.
        what: String,
        /// The count declared.
        declared: u64,
        /// The largest count that the file's size allows.
        possible: u64,
    },

    /// More vertices than a 32-bit index can name.
    #[error(
        "{at}: {vertices} vertices are more than a model may have ({}); split the scan",
        u32::MAX
    )]
    TooManyVertices {
        /// Where.
        at: Spot,
        /// How many there are, at least.
        vertices: u64,
    },

    /// A coordinate is NaN or infinite.
    #[error("{at}: vertex {vertex} (from 0) has a coordinate that is not a finite number")]
    NotFinite {
        /// Where.
        at: Spot,
        /// Number of the vertex in the file, from 0.
        vertex: u64,
    },

    /// A face names a vertex that is not there.
    #[error(
        "{at}: face {face} (from 0) names vertex {index}, but the vertices are numbered \
         0 to {}",
        .vertices.saturating_sub(1)
    )]
    IndexOutOfRange {
        /// Where.
        at: Spot,
        /// Number of the face, strip or triangle in the file, from 0.
        face: u64,
        /// The index, from 0.
        index: i64,
        /// How many vertices there are.
        vertices: u64,
    },

    /// Vertices without triangles where triangles are needed.
    #[error(
        "{at}: {vertices} vertices but no faces, where triangles are needed; hlod-build makes levels of \
         detail of point clouds, from PLY files with normals"
    )]
    PointsOnly {
        /// Which file.
        at: Spot,
        /// How many vertices.
        vertices: u64,
    },

    /// Neither vertices nor triangles.
    #[error("{at}: the file is well-formed but holds no vertices")]
    NoGeometry {
        /// Which file.
        at: Spot,
    },

    /// Every face repeats a corner, so that no triangle is left.
    #[error("{at}: none of the {faces} faces has three different corners; nothing is left")]
    AllDegenerate {
        /// Which file.
        at: Spot,
        /// How many faces were read.
        faces: u64,
    },
}

impl ScanError {
    /// Whether the request was wrong (no such file, a folder, a format not read
    /// here) rather than the content of a scan.
    pub fn is_usage(&self) -> bool {
        matches!(
            self,
            ScanError::NotFound { .. }
                | ScanError::NotAFile { .. }
                | ScanError::NoInput { .. }
                | ScanError::UnknownFormat { .. }
                | ScanError::Transforms { .. }
        )
    }

    /// The file and the place in it.
    pub fn at(&self) -> &Spot {
        match self {
            ScanError::NotFound { at }
            | ScanError::NotAFile { at }
            | ScanError::NoInput { at }
            | ScanError::UnknownFormat { at }
            | ScanError::Texture { at, .. }
            | ScanError::NoTexture { at }
            | ScanError::Transforms { at, .. }
            | ScanError::TexturesTooLarge { at, .. }
            | ScanError::EmptyFile { at }
            | ScanError::Io { at, .. }
            | ScanError::Scratch { at, .. }
            | ScanError::Stopped { at }
            | ScanError::Malformed { at, .. }
            | ScanError::Unsupported { at, .. }
            | ScanError::Truncated { at, .. }
            | ScanError::CountTooLarge { at, .. }
            | ScanError::TooManyVertices { at, .. }
            | ScanError::NotFinite { at, .. }
            | ScanError::IndexOutOfRange { at, .. }
            | ScanError::PointsOnly { at, .. }
            | ScanError::NoGeometry { at }
            | ScanError::AllDegenerate { at, .. } => at,
        }
    }

    /// A [`ScanError::Malformed`], the most common kind.
    pub(crate) fn malformed(at: Spot, what: impl Into<String>) -> ScanError {
        ScanError::Malformed { at, what: what.into() }
    }

    /// Of what is set aside while reading.
    pub(crate) fn scratch(path: &Path, source: io::Error) -> ScanError {
        ScanError::Scratch { at: Spot::new(path, Place::File), source }
    }

    /// An error of the operating system, with the two that mean wrong usage apart.
    pub(crate) fn from_io(at: Spot, source: io::Error) -> ScanError {
        match source.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => ScanError::NotFound { at },
            io::ErrorKind::IsADirectory => ScanError::NotAFile { at },
            _ => ScanError::Io { at, source },
        }
    }
}

/// A place in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Spot {
    /// The file.
    pub path: PathBuf,
    /// Where in it.
    pub place: Place,
}

impl Spot {
    /// `place` in the file `path`.
    pub fn new(path: &Path, place: Place) -> Spot {
        Spot { path: path.to_path_buf(), place }
    }
}

impl fmt::Display for Spot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = self.path.display();
        match &self.place {
            Place::File => write!(f, "{path}"),
            Place::Byte(byte) => write!(f, "{path}, byte {byte}"),
            Place::Line(line) => write!(f, "{path}, line {line}"),
            Place::Item(item) => write!(f, "{path}, {item}"),
        }
    }
}

/// Where in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// Byte offset from its begin.
    Byte(u64),
    /// Line of a text, from 1.
    Line(u64),
    /// Part of a glTF document, such as `accessors[3]`.
    Item(String),
}
