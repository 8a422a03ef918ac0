//! Every byte of an `.hlod` file.
//!
//! ```text
//! header · root skeleton block · root pages · other skeleton blocks · pages in depth, then Morton order · metadata
//! └──────────── the first read: a covering picture ──────────┘
//! ```
//!
//! The crate knows neither threads nor windows nor the GPU. Writing goes through
//! [`FileWriter`]; reading is a set of functions from byte slices to owned values
//! ([`Header::parse`], [`SkeletonBlock::parse`], [`decode_page`]), so that local files, HTTP
//! ranges and tests share them, plus [`HlodFile`], which applies them to a file on disk.
//!
//! Everything read is untrusted: lengths are checked before anything is allocated, checksums
//! before anything is decoded, indices before anything is handed out.

mod bytes;
mod cell;
mod container;
mod declared;
mod entropy;
mod error;
mod header;
mod lattice;
mod mesh;
mod metadata;
mod octahedral;
mod page;
mod points;
mod pread;
mod scalars;
mod skeleton;
pub mod srgb;

pub use cell::{CellKey, MAX_DEPTH};
pub use container::{FileWriter, HlodFile};
pub use declared::{Primitives, SignedAxis, Unit};
pub use error::FormatError;
pub use header::{
    AttributeDeclaration, AttributeDomain, AttributeType, FORMAT_VERSION, HEADER_BYTES_MAX, Header,
    PageRef, SourceFile,
};
pub use lattice::Lattice;
pub use mesh::Mesh;
pub use metadata::{
    Accuracy, METADATA_BYTES_MAX, METADATA_EXAMPLE, METADATA_SCHEMA, Metadata, MetadataRef,
};
pub use octahedral::OctNormal;
pub use page::{
    PageAccount, PageContent, PageCounts, decode_page, encode_mesh_with_account, encode_page,
    encoded_counts,
};
pub use points::{PointPrefix, PointRadius, Points};
pub use scalars::{SCALARS_MAX, ScalarRange, Scalars, code_between, mean_code};
pub use skeleton::{
    BLOCK_BYTES_MAX, BlockRef, BoundStatus, Children, Errors, NodeFlags, NodeRecord, NormalCone,
    PAGE_BYTES_MAX, Representation, RepresentationKind, SkeletonBlock,
};
