//! Tests that need more than one crate.

mod build;
mod documents;
mod dust;
mod format;
mod network;
mod pictures;
mod points;
mod programs;
mod restart;
mod shadows;
mod streaming;
