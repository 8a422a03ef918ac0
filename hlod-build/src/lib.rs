//! From a scan to one `.hlod` file.
//!
//! ```text
//! scan.ply .obj .stl .glb
//!   │ steps/ingest   vertices and triangles, as files
//!   │ steps/survey   the lattice, normals, a plan of subtrees
//!   │ steps/scatter  triangles cut into the subtrees' cells
//!   │ steps/nodes    leaves (partition) and levels above (hierarchy): gather, simplify, certify;
//!   │                of point clouds both are in points
//!   ▼ steps/assemble lay out, write aside, rename
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
mod gate;
mod hierarchy;
mod info;
mod ingest;
mod kept;
mod memory;
mod metadata;
mod oddities;
mod output;
mod partition;
mod pipeline;
mod points;
pub mod progress;
mod resources;
mod seams;
mod simplify;
mod single_step;
mod spill;
mod steps;
pub mod synth;
mod system;
mod tears;
mod triangle_bvh;
mod union;
mod verify;

pub use compare::{CompareReport, Direction, NormalDeviation, compare};
pub use error::BuildError;
pub use export::{ExportReport, Selection, export};
#[cfg(feature = "bench")]
#[doc(hidden)]
pub use simplify::hot;

pub use info::{Info, Level, ScalarInfo, SourceInfo, info};
pub use ingest::Precision;
pub use kept::KeptScalar;
pub use metadata::{MetadataReport, read_metadata};
pub use oddities::Oddities;
pub use output::write_whole;
pub use pipeline::{BuildOptions, BuildReport, build, prepare};
pub use resources::{Costs, StageCost};
pub use single_step::{StepDescription, list_steps, run_step};
pub use verify::{PROBLEMS_MAX, RepresentationCheck, VerifyOptions, VerifyReport, verify};
