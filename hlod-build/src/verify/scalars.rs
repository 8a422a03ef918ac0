//! Compares kept numbers of leaves with the input's, vertex by vertex.
//!
//! A leaf's vertex at the place of one or several of the input's must have the numbers of one of them,
//! within half a step; where the input has none, it must have none. What lies on a face of its leaf's
//! cell may have been cut there, and is not compared.

use std::collections::HashMap;

use hlod_compress::{HlodFile, Lattice, NodeRecord, PageContent, ScalarRange, Scalars};
use hlod_scan::{Batch, PlacedScan, VertexBatch};

use super::check_page;
use super::leaves::{each_batch_keeping, round_to, total_bytes};
use crate::error::BuildError;
use crate::progress::{Progress, Unit};

/// What a vertex takes in memory while it waits for the input's.
const VERTEX_BYTES: u64 = 100;
/// However little memory there is, so many vertices are compared at a time.
const VERTICES_MIN: u64 = 20_000;

/// A vertex of a leaf, or several with the same numbers.
struct Waiting {
    scalars: Scalars,
    /// The input has a vertex at this place.
    is_met: bool,
    /// It has these numbers.
    is_right: bool,
}

type Places = HashMap<[i32; 3], Vec<Waiting>>;

/// What came of it.
pub(super) struct Compared {
    /// Vertices whose numbers were compared.
    pub(super) vertices: u64,
    /// A sentence for each leaf with other numbers.
    pub(super) problems: Vec<String>,
}

/// Leaves are taken as many at a time as `memory_bytes` allow, with a pass over the input for each.
pub(super) fn compare(
    file: &HlodFile,
    nodes: &[NodeRecord],
    against: &[PlacedScan],
    memory_bytes: u64,
    progress: &dyn Progress,
) -> Result<Compared, BuildError> {
    let ranges: Vec<(String, ScalarRange)> =
        file.header().scalars().map(|(name, range)| (name.to_owned(), range.clone())).collect();
    let mut out = Compared { vertices: 0, problems: Vec::new() };
    if ranges.is_empty() {
        return Ok(out);
    }
    let vertices_max = (memory_bytes / VERTEX_BYTES).max(VERTICES_MIN);
    let mut batches: Vec<Vec<&NodeRecord>> = vec![Vec::new()];
    let mut held = 0;
    for leaf in nodes.iter().filter(|node| node.is_leaf()) {
        let count = leaf.representations.first().map_or(0, |r| u64::from(r.vertices + r.points));
        if held + count > vertices_max && held > 0 {
            batches.push(Vec::new());
            held = 0;
        }
        batches[..].last_mut().into_iter().for_each(|batch| batch.push(leaf));
        held += count;
    }
    progress.begin("compare values", total_bytes(against)? * batches.len() as u64, Unit::Bytes);
    for batch in &batches {
        compare_batch(file, batch, (against, &ranges), progress, &mut out)?;
    }
    progress.end();
    Ok(out)
}

fn compare_batch(
    file: &HlodFile,
    batch: &[&NodeRecord],
    (against, ranges): (&[PlacedScan], &[(String, ScalarRange)]),
    progress: &dyn Progress,
    out: &mut Compared,
) -> Result<(), BuildError> {
    let lattice = file.header().lattice;
    let mut places = Places::new();
    for leaf in batch {
        // What cannot be read has been said.
        let Some(Ok(content)) = leaf.representations.first().map(|r| check_page(file, leaf, r))
        else {
            continue;
        };
        wait(&mut places, leaf, &content, &lattice);
    }
    let names: Vec<String> = ranges.iter().map(|(name, _)| name.clone()).collect();
    for scan in against {
        each_batch_keeping(scan, &names, progress, &mut |batch| {
            if let Batch::Vertices(batch) = batch {
                meet(&mut places, &batch, &lattice, ranges);
            }
        })?;
    }
    let met = || places.values().flatten().filter(|w| w.is_met);
    out.vertices += met().count() as u64;
    let wrong = met().filter(|w| !w.is_right).count();
    if wrong > 0 {
        let cell = batch[0].cell;
        out.problems.push(format!(
            "{wrong} vertices of leaf {cell} and those after it have other kept values than the input"
        ));
    }
    Ok(())
}

fn wait(places: &mut Places, leaf: &NodeRecord, content: &PageContent, lattice: &Lattice) {
    let low = lattice.cell_min(leaf.cell);
    let edge = lattice.cell_units(leaf.cell.depth()) as i32;
    let inside = |p: &[i32; 3]| (0..3).all(|i| p[i] != low[i] && p[i] != low[i] + edge);
    let PageContent { mesh, points } = content;
    let of = |rows: &[Scalars], i: usize| rows.get(i).copied().unwrap_or_default();
    let of_mesh = mesh.positions.iter().enumerate().map(|(i, p)| (p, of(&mesh.scalars, i)));
    let of_points = points.positions.iter().enumerate().map(|(i, p)| (p, of(&points.scalars, i)));
    for (place, scalars) in of_mesh.chain(of_points).filter(|(p, _)| inside(p)) {
        let here = places.entry(*place).or_default();
        if !here.iter().any(|w| w.scalars == scalars) {
            here.push(Waiting { scalars, is_met: false, is_right: false });
        }
    }
}

fn meet(
    places: &mut Places,
    batch: &VertexBatch,
    lattice: &Lattice,
    ranges: &[(String, ScalarRange)],
) {
    for (i, position) in batch.positions.iter().enumerate() {
        let Some(here) = places.get_mut(&round_to(lattice, position.to_array())) else { continue };
        for waiting in here {
            waiting.is_met = true;
            let agrees = |k: usize| {
                let number = batch.scalars.get(k).map_or(f64::NAN, |column| column[i]);
                agrees(number, waiting.scalars.0[k], &ranges[k].1)
            };
            waiting.is_right |= (0..ranges.len()).all(agrees);
        }
    }
}

/// Whether a code stands for a number as the file says that codes do.
fn agrees(number: f64, code: u16, range: &ScalarRange) -> bool {
    if number.is_nan() || code == 0 {
        return number.is_nan() && code == 0;
    }
    let stored = range.minimum + f64::from(code - 1) * range.step;
    let rounding = 1e-14 * (number.abs() + range.minimum.abs());
    (number - stored).abs() <= 0.5 * range.step * (1.0 + 1e-9) + rounding
}
