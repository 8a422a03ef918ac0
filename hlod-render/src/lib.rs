//! `.hlod` → pixels.
//!
//! ```text
//! model     skeleton, resident geometry, requests (loader → arena)
//!   │ select    which nodes are drawn
//!   │ passes    identity and depth, then shading
//!   ▼ frame     the outline; picture, bench and audit are what it is for
//! ```

mod arena;
pub mod audit;
pub mod bench;
pub mod camera;
mod error;
pub mod frame;
pub mod framing;
mod gpu;
pub mod loader;
mod model;
pub mod passes;
pub mod path;
pub mod pick;
pub mod picture;
pub mod scene;
pub mod select;
pub mod skeleton;
pub mod skirts;
#[cfg(feature = "viewer")]
pub mod viewer;

pub use error::RenderError;
pub use gpu::{AdapterChoice, Gpu};
pub use model::{Model, ModelLimits};
