//! The steps of a build, each a function of files in the work folder.
//!
//! ```text
//! scans
//!   │ ingest    vertices, triangles                       ingest.rs, weld.rs
//!   │ survey    lattice, normals, where the triangles are survey.rs ┐ join.rs
//!   │ scatter   triangles cut into the subtrees' cells    scatter.rs┘
//!   │ build     each subtree, then each node above        nodes.rs
//!   ▼ assemble  the file                                  assemble.rs
//! ```
//!
//! The journal says which are done (work_folder.rs).

pub(crate) mod assemble;
pub(crate) mod ingest;
mod join;
pub(crate) mod nodes;
mod normals;
mod overlap;
pub(crate) mod plan;
pub(crate) mod scatter;
pub(crate) mod survey;
mod weld;
pub(crate) mod work_folder;

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::BuildError;

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), BuildError> {
    let text = serde_json::to_vec(value).map_err(std::io::Error::from);
    text.and_then(|text| std::fs::write(path, text)).map_err(BuildError::io(path, "write"))
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, BuildError> {
    let text = std::fs::read(path).map_err(BuildError::io(path, "read"))?;
    serde_json::from_slice(&text).map_err(|_| BuildError::Work { path: path.to_owned() })
}
