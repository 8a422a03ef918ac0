//! Why a report could not be made.

use std::path::{Path, PathBuf};

/// Why a report could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A program could not be started.
    #[error("cannot start {program}: {source}; build it first (`cargo build --release`)")]
    Start {
        /// Which.
        program: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A program ended badly.
    #[error("{command}: {status}\n{said}")]
    Failed {
        /// As it was started.
        command: String,
        /// How it ended.
        status: std::process::ExitStatus,
        /// Its last lines.
        said: String,
    },
    /// What a program printed, or what was kept of it, is not what was expected.
    #[error("{what}: {why}")]
    Unexpected {
        /// The command, or the file.
        what: String,
        /// What is wrong with it.
        why: String,
    },
    /// A file could not be read or written.
    #[error("cannot {action} {path}: {source}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl ReportError {
    pub(super) fn io(
        path: &Path,
        action: &'static str,
    ) -> impl FnOnce(std::io::Error) -> ReportError {
        let path = path.to_owned();
        move |source| ReportError::Io { action, path, source }
    }

    pub(super) fn unexpected(what: impl ToString, why: impl ToString) -> ReportError {
        ReportError::Unexpected { what: what.to_string(), why: why.to_string() }
    }
}
