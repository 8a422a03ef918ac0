//! `synth statue`: a bust on an inscribed plinth, made by rule, as demonstration sample,
//! load for tests of scale, and truth for tests that measure.
//!
//! In order of use: [`StatueOptions`] → a field (`body`, `head`, `inscription` put solids of
//! `shape` and marks of `relief` on a tape, `field`, that evaluates eight points at a time,
//! `lanes`, `noise`) → a grid step (`estimate`) → samples near the surface (`grid`) →
//! vertices and triangles (`polygonise`, `clean`, `cells`, `dual`) → a PLY file (`ply_writer`).
//! [`describe()`] tells what is known about the statue without making it.
//!
//! The same options give the same bytes on every machine and with any number of threads.

mod body;
mod cells;
mod clean;
mod describe;
mod dual;
mod estimate;
mod field;
mod grid;
mod head;
mod inscription;
mod lanes;
mod noise;
mod ply_writer;
mod polygonise;
mod relief;
mod shape;
#[cfg(test)]
mod tests;

pub use describe::{
    AngleDescription, GrooveDescription, NoiseDescription, PanelDescription, PlinthDescription,
    StatueDescription, describe,
};
pub use inscription::Letter;

use grid::{Grid, Search};
use ply_writer::PlyWriter;
use polygonise::{ScannerNoise, Sink, polygonise};
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};

/// Fewest triangles a statue can have.
pub const MIN_TRIANGLES: u64 = 10_000;
/// Most triangles: their vertices still have 31-bit indices.
pub const MAX_TRIANGLES: u64 = 1_100_000_000;

/// What statue to make.
#[derive(Clone, Copy, Debug)]
pub struct StatueOptions {
    /// How many triangles it should have; what comes out differs by a per cent or two.
    pub triangles: u64,
    /// Shifts locks of hair, folds, marks, chips and noise.
    pub seed: u64,
}

/// What was made.
#[derive(Clone, Debug, Serialize)]
pub struct StatueReport {
    /// Triangles in the file.
    pub triangles: u64,
    /// Vertices in the file.
    pub vertices: u64,
    /// Step of the sampling grid, mm.
    pub spacing_mm: f64,
    /// Size of the file.
    pub file_bytes: u64,
    /// Most disk space taken on the way: the file and the triangles set aside.
    pub peak_disk_bytes: u64,
    /// Smallest and largest coordinates, mm.
    pub bounds_mm: [[f32; 3]; 2],
    /// Standard deviation of the scanner's noise, mm.
    pub noise_sigma_mm: f64,
}

/// Why a statue was not made. Nothing is left under the output's name.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// Too few or too many triangles.
    #[error("cannot make a statue of {0} triangles: ask for {MIN_TRIANGLES} to {MAX_TRIANGLES}")]
    Triangles(u64),
    /// The output is there already.
    #[error("{} exists: choose another name, or give --force to replace it", .0.display())]
    Exists(PathBuf),
    /// The disk is full.
    #[error("{}: the disk is full: about {need_bytes} bytes are needed there while writing", path.display())]
    DiskFull {
        /// The output.
        path: PathBuf,
        /// What it takes at most, about.
        need_bytes: u64,
    },
    /// Writing failed.
    #[error("cannot write {}: {source}: check that its folder exists and may be written to", path.display())]
    Write {
        /// The output.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// Make a statue and write it to `out`, as binary little-endian PLY without normals (as
/// scans are). `progress` gets triangles (done, expected).
pub fn write_statue(
    options: &StatueOptions,
    out: &Path,
    force: bool,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<StatueReport, SynthError> {
    // Check what can be checked before any work.
    if !(MIN_TRIANGLES..=MAX_TRIANGLES).contains(&options.triangles) {
        return Err(SynthError::Triangles(options.triangles));
    }
    if out.exists() && !force {
        return Err(SynthError::Exists(out.to_owned()));
    }
    let failed = |source: io::Error| match source.kind() {
        io::ErrorKind::AlreadyExists => SynthError::Exists(out.to_owned()),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            SynthError::DiskFull { path: out.to_owned(), need_bytes: 31 * options.triangles }
        }
        _ => SynthError::Write { path: out.to_owned(), source },
    };
    let comment = format!(
        "hlod-build synth statue, {} triangles asked, seed {}, unit mm, +y up, front +z",
        options.triangles, options.seed
    );
    let mut sink = Counted {
        writer: PlyWriter::create(out, &comment).map_err(failed)?,
        wish: options.triangles,
        progress,
    };
    (sink.progress)(0, options.triangles);
    let step = polygonise_statue(options, &mut sink).map_err(failed)?;
    // Put the file together.
    let written = sink.writer.finish(out, force).map_err(failed)?;
    progress(written.triangles, written.triangles);
    Ok(StatueReport {
        triangles: written.triangles,
        vertices: written.vertices,
        spacing_mm: step,
        file_bytes: written.file_bytes,
        peak_disk_bytes: written.peak_disk_bytes,
        bounds_mm: written.bounds,
        noise_sigma_mm: describe::noise_sigma(options.triangles),
    })
}

/// Find the grid, and run through it. Gives its step, mm.
fn polygonise_statue<S: Sink>(options: &StatueOptions, sink: &mut S) -> Result<f64, S::Error> {
    let step = estimate::step_for(options.triangles, options.seed);
    let search = Search { field: &body::statue(options.seed, step), grid: &Grid::new(step) };
    let noise =
        ScannerNoise { sigma: describe::noise_sigma(options.triangles), seed: options.seed };
    polygonise(&search, noise, sink)?;
    Ok(step)
}

/// Passes everything on and tells how far it is.
struct Counted<'a> {
    writer: PlyWriter,
    wish: u64,
    progress: &'a mut dyn FnMut(u64, u64),
}

impl Sink for Counted<'_> {
    type Error = io::Error;

    fn vertices(&mut self, vertices: &[[f32; 3]]) -> io::Result<()> {
        self.writer.vertices(vertices)
    }

    fn triangles(&mut self, triangles: &[[u32; 3]]) -> io::Result<()> {
        self.writer.triangles(triangles)?;
        (self.progress)(self.writer.triangle_count().min(self.wish), self.wish);
        Ok(())
    }
}
