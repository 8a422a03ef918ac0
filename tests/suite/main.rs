//! Tests that need more than one crate.

mod build;
mod clip;
mod clouds;
mod documents;
mod dust;
mod exports;
mod figures;
mod format;
mod hostile;
mod kept;
mod licences;
mod measuring;
mod metadata;
mod network;
mod paints;
mod pictures;
mod placing;
mod points;
mod programs;
mod restart;
mod section;
mod shadow_maps;
mod shadows;
mod standing;
mod streaming;
mod textures;
