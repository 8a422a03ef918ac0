//! What can be wrong with bytes that claim to be an `.hlod` file.

/// A file, block or page that cannot be used, with where and why.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// The first bytes are not those of an `.hlod` file.
    #[error("not an .hlod file (its first bytes are not the .hlod signature)")]
    NotHlod,
    /// Written by another version of the format.
    #[error(
        "format version {found:#x} is not readable by this program, which reads up to version {expected}; {}",
        if *found > *expected && *found < 0xffff_0000 { "a newer one may" }
        else { "the file was made before versions were kept, so build it again" }
    )]
    Version {
        /// The version that the file declares.
        found: u32,
        /// The last version that this crate reads.
        expected: u32,
    },
    /// The file ends before something it declares.
    #[error("the file ends at byte {file_bytes}, but {what} needs bytes up to {needed_bytes}")]
    Truncated {
        /// What was being read.
        what: &'static str,
        /// Where the file ends.
        file_bytes: u64,
        /// Where it would have to end at least.
        needed_bytes: u64,
    },
    /// A checksum does not match.
    #[error("{what} at byte {offset} is damaged (checksum {found:08x}, expected {expected:08x})")]
    Checksum {
        /// What was being read.
        what: &'static str,
        /// Where it starts in the file.
        offset: u64,
        /// CRC-32 of what is there.
        found: u32,
        /// CRC-32 that was recorded when it was written.
        expected: u32,
    },
    /// Bytes with a good checksum that still make no sense.
    #[error("{what} is malformed: {why}")]
    Malformed {
        /// What was being read.
        what: &'static str,
        /// What makes no sense about it.
        why: String,
    },
    /// More than a page or block may hold.
    #[error("{what} holds {count} {unit}, more than the {limit} that the format allows")]
    TooLarge {
        /// What was being written or read.
        what: &'static str,
        /// How many there are.
        count: u64,
        /// Of what.
        unit: &'static str,
        /// How many there may be.
        limit: u64,
    },
    /// The operating system refused.
    #[error("{0}")]
    Io(#[from] std::io::Error),
}

impl FormatError {
    pub(crate) fn malformed(what: &'static str, why: impl Into<String>) -> Self {
        FormatError::Malformed { what, why: why.into() }
    }
}
