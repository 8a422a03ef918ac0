//! What can go wrong in showing a file.

use std::path::{Path, PathBuf};

use hlod_compress::FormatError;

/// A failed command, with the file it concerns.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// An `.hlod` file cannot be used.
    #[error("{path}: {source}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: FormatError,
    },
    /// A scan to compare with cannot be read.
    #[error(transparent)]
    Scan(#[from] hlod_scan::ScanError),
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
    /// A camera path or another text is not what it should be.
    #[error("{path}: {why}")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// A picture cannot be written.
    #[error("{path}: cannot write the picture: {source}")]
    Image {
        /// The file.
        path: PathBuf,
        /// The encoder's reason.
        source: image::ImageError,
    },
    /// There is nothing to draw with.
    #[error(
        "no graphics adapter: {0}; on Debian and Ubuntu `apt install mesa-vulkan-drivers libvulkan1` provides a software one"
    )]
    NoAdapter(String),
    /// There is nothing to show it in.
    #[error("cannot open a window: {0}")]
    Window(String),
    /// The adapter cannot do what was asked for.
    #[error("{adapter}: {why}")]
    Gpu {
        /// The adapter's name.
        adapter: String,
        /// What went wrong.
        why: String,
    },
    /// A section of a point cloud was asked for.
    #[error(
        "{path}: a point cloud has no surface to cut: make triangles of it first (Poisson reconstruction, as in MeshLab or CloudCompare), and build a file from these"
    )]
    NoSurface {
        /// The file.
        path: PathBuf,
    },
    /// A drawing cannot be made.
    #[error("cannot make {what}: {why}")]
    Drawing {
        /// What kind of file.
        what: &'static str,
        /// The reason.
        why: String,
    },
    /// The command line asks for something that is not there.
    #[error("{0}")]
    Usage(String),
}

impl RenderError {
    /// Whether the command line, not the data, is at fault.
    pub fn is_usage(&self) -> bool {
        match self {
            RenderError::Usage(_) => true,
            RenderError::Scan(error) => error.is_usage(),
            RenderError::Format { source: FormatError::Io(error), .. }
            | RenderError::Io { source: error, .. } => error.kind() == std::io::ErrorKind::NotFound,
            _ => false,
        }
    }

    pub(crate) fn format(path: &Path) -> impl Fn(FormatError) -> RenderError {
        let path = path.to_owned();
        move |source| RenderError::Format { path: path.clone(), source }
    }

    pub(crate) fn io(
        path: &Path,
        what: &'static str,
    ) -> impl FnOnce(std::io::Error) -> RenderError {
        let path = path.to_owned();
        move |source| RenderError::Io { path, what, source }
    }
}
