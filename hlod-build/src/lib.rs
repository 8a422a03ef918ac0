//! From a scan to one `.hlod` file.
//!
//! ```text
//! scan.ply .obj .stl .glb
//!   │ ingest       all inputs as one mesh on the file's lattice
//!   │ partition    octree cells, triangles cut at cell faces
//!   │ hierarchy    bottom-up: gather two levels below, simplify, certify, encode
//!   ▼ pipeline     lay out, write aside, rename
//! ```
//!
//! [`build`] is the outline; [`info`], [`export`] and [`verify`] read the result, [`compare`] measures
//! any mesh against another.

mod borders;
mod certificate;
mod colour;
mod compare;
mod cone;
mod error;
mod export;
mod hierarchy;
mod info;
mod ingest;
mod output;
mod partition;
mod pipeline;
pub mod progress;
mod resources;
mod seams;
mod simplify;
pub mod synth;
mod triangle_bvh;
mod verify;

pub use compare::{CompareReport, Direction, NormalDeviation, compare};
pub use error::BuildError;
pub use export::{ExportReport, Selection, export};
pub use info::{Info, Level, SourceInfo, info};
pub use ingest::Precision;
pub use pipeline::{BuildOptions, BuildReport, build};
pub use resources::{Costs, StageCost};
pub use verify::{PROBLEMS_MAX, RepresentationCheck, VerifyReport, verify};
