//! `.hlod` → pixels.
//!
//! ```text
//! model     skeleton, resident geometry, requests (loader → arena); begins with model_file, the file and its root
//!   │ select    which nodes are drawn
//!   │ casters   and which cast shadows on them
//!   │ passes    identity and depth, what is hidden from the light, shading
//!   ▼ frame     the outline; picture, figure, bench and audit are what it is for
//!
//! leaves    the scan's own geometry, past levels and GPU
//!   │ pick, measure, section
//!   ▼ session   what was found, as a file
//! ```

mod arena;
pub mod audit;
pub mod bench;
pub mod camera;
pub mod casters;
pub mod clip;
pub mod colour_map;
mod edges;
mod error;
pub mod extents;
pub mod figure;
pub mod files;
mod fit;
pub mod frame;
pub mod framing;
mod gpu;
pub mod lamp;
pub mod leaves;
pub mod lens;
mod light_space;
mod lit;
pub mod loader;
pub mod measure;
mod model;
mod model_file;
pub mod need;
pub mod passes;
pub mod path;
pub mod pick;
pub mod picture;
mod prefetch;
pub mod residency;
mod ring;
pub mod scene;
mod seams;
pub mod section;
mod seen;
pub mod select;
pub mod session;
pub mod shadow_map;
pub mod simulate;
pub mod skeleton;
pub mod skirts;
pub mod source;
pub mod survey;
mod system;
mod traced;
mod uniform;
#[cfg(feature = "viewer")]
pub mod viewer;

pub use error::RenderError;
pub use gpu::{AdapterChoice, Gpu};
pub use model::{Model, ModelLimits};
pub use model_file::ModelFile;
