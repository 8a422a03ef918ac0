//! What can go wrong in a build and in the commands that read its result.

use std::path::{Path, PathBuf};

use hlod_compress::FormatError;
use hlod_scan::ScanError;

/// A failed build or command, with the file it concerns.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// A scan cannot be read.
    #[error(transparent)]
    Scan(#[from] ScanError),
    /// An `.hlod` file cannot be read or written.
    #[error("{path}: {source}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: FormatError,
    },
    /// The operating system refused.
    #[error("{path}: cannot {what}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What was attempted.
        what: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// An input is not what it was when the build began.
    #[error("{0}: has changed while it was read; start again when it is complete")]
    InputChanged(PathBuf),
    /// The output is there already.
    #[error("{0}: exists already; give --force to replace it")]
    OutputExists(PathBuf),
    /// The output would replace an input.
    #[error("{0}: is an input; give another name to -o")]
    OutputIsInput(PathBuf),
    /// Nothing of the input has an area.
    #[error(
        "{path}: all {triangles} triangles are degenerate at the precision of {step} units; give a smaller --precision"
    )]
    NothingLeft {
        /// The first input.
        path: PathBuf,
        /// How many there were.
        triangles: u64,
        /// The lattice's step.
        step: f64,
    },
    /// A scan has only faces without an area.
    #[error("{path}: none of its {faces} faces has three different corners")]
    NoTriangles {
        /// The scan.
        path: PathBuf,
        /// How many faces it has.
        faces: u64,
    },
    /// Points without normals cannot be lit, and there are too few to estimate any.
    #[error(
        "{path}: {lacking} of {points} points have no normal, without which they cannot be lit, and lie in fewer \
         than 16 places, from which none can be estimated"
    )]
    NoNormals {
        /// The first input.
        path: PathBuf,
        /// Points without.
        lacking: u64,
        /// All points.
        points: u64,
    },
    /// Some inputs are point clouds, others have triangles.
    #[error(
        "{path}: {}; build one file from the point clouds and one from the others",
        if *is_cloud { "is a point cloud, which the inputs before are not" }
        else { "has triangles, while the inputs before are point clouds" }
    )]
    MixedInputs {
        /// The first that differs from those before.
        path: PathBuf,
        /// Whether it is a point cloud.
        is_cloud: bool,
    },
    /// The memory allowed does not suffice.
    #[error(
        "{path}: {why}, which takes about {} MiB; --memory allows {} MiB",
        needed_bytes.div_ceil(1 << 20), budget_bytes >> 20
    )]
    Memory {
        /// What is being read or written.
        path: PathBuf,
        /// What takes it.
        why: &'static str,
        /// How much is needed.
        needed_bytes: u64,
        /// How much is allowed.
        budget_bytes: u64,
    },
    /// A node keeps more than a page may hold.
    #[error(
        "{path}: one node would hold {count} {unit}, more than the {limit} that a file may have in one; give a smaller --resolution"
    )]
    NodeTooLarge {
        /// The work folder.
        path: PathBuf,
        /// How many there are.
        count: u64,
        /// Of what.
        unit: &'static str,
        /// How many there may be.
        limit: u64,
    },
    /// A file of the work folder is not what this build wrote.
    #[error("{path}: is damaged; give --resume to make it again")]
    Work {
        /// The file.
        path: PathBuf,
    },
    /// Stopped by the user.
    #[error("stopped; give the same command with --resume to go on ({0} holds what is done)")]
    Stopped(PathBuf),
    /// A program ends before its work does.
    #[error("{0}")]
    Usage(String),
}

impl BuildError {
    /// Whether the command line, not the data, is at fault.
    pub fn is_usage(&self) -> bool {
        match self {
            BuildError::Scan(error) => error.is_usage(),
            BuildError::OutputExists(_) | BuildError::OutputIsInput(_) | BuildError::Usage(_) => {
                true
            }
            _ => false,
        }
    }

    /// Whether a build could go on when it has passed: a full disk, too little memory, a stop.
    pub(crate) fn is_passing(&self) -> bool {
        use BuildError::{Io, Memory, Stopped, Work};
        matches!(self, Io { .. } | Memory { .. } | Stopped(_) | Work { .. })
    }

    pub(crate) fn format(path: &Path) -> impl FnOnce(FormatError) -> BuildError {
        let path = path.to_owned();
        move |source| BuildError::Format { path, source }
    }

    pub(crate) fn io(path: &Path, what: &'static str) -> impl FnOnce(std::io::Error) -> BuildError {
        let path = path.to_owned();
        move |source| BuildError::Io { path, what, source }
    }
}
