//! Inputs changed at random, for everything that reads what comes from outside.
//!
//! [`TARGETS`] are functions from bytes, which must neither panic, nor take long, nor take much
//! memory. They are run three ways: a few seconds by `cargo test` ([`Campaign::run`] with fixed seeds),
//! as long as one likes by `cargo xtask fuzz`, both with the generator in `mutate`; and by libFuzzer in
//! `fuzz`, which needs a nightly compiler.

mod campaign;
pub mod memory;
mod mutate;
mod seeds;
mod targets;

pub use campaign::{Campaign, Extent, Finding, Tally};
pub use mutate::Mutator;
pub use targets::{TARGETS, Target, target};
