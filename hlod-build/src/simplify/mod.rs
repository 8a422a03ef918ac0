//! Simplifies the geometry of one node, for appearance and for shape alone.
//!
//! ```text
//! source ─ prepare ─▶ welded, sub-resolution normals smoothed
//!   │ dust         components below the budget are thinned out
//!   │ collapse     quadrics propose, heeding normals       ┐
//!   │ emit         rounded to the node's grid              │ again for what fails,
//!   │ certify      distance and normals, both ways         │ with less freedom
//!   ▼ restore      what is not within the budget ──────────┘
//! appearance ─ collapse on, shape alone ─▶ … ─▶ geometric
//! ```
//!
//! Quadrics are mean squares: on statues their proposals exceed the budget in a few places of a
//! node. Only these are taken back and done again; certifying once instead of at each collapse is
//! what makes certainty affordable.

mod chains;
mod collapse;
mod dust;
mod emit;
#[cfg(feature = "bench")]
pub mod hot;
mod prepare;
mod quadric;
mod queue;
mod rims;

use std::collections::HashMap;

use glam::DVec3;
use hlod_compress::Mesh;

use crate::borders::Cube;
use crate::certificate::{Ask, Carried, Certificate, Deviation, NONE, Pair, Surface, certify};
use crate::tears::fill_simplified;
use chains::{Chains, Shading, simplify_chains};
use collapse::{AttributeLimits, Collapser, Limits, Pin, Vertex};
use dust::{Dust, Speck};
use emit::{Emitted, emit, surface_of};
use prepare::{Prepared, prepare};

/// What a node may lose. Lengths in lattice steps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Budget {
    /// The cell's edge divided by the resolution.
    pub(crate) whole: f64,
    /// What most of the source leaves of it for this step's distance.
    pub(crate) distance: f64,
    /// Differences of normals below this many times their noise do not count.
    pub(crate) normal_noise: f32,
    /// Positions are rounded to multiples of `2^grid_shift`.
    pub(crate) grid_shift: u8,
    /// Lowest corner of the cell.
    pub(crate) cell_min: [i32; 3],
    /// Edge of the cell.
    pub(crate) cell_units: u32,
    /// Whether the surface bounds a volume.
    pub(crate) is_closed: bool,
}

impl Budget {
    /// The nearest place on the node's grid; what is on a face of the cell stays on it. Cells that
    /// share a face round alike.
    fn on_grid(&self, p: [i32; 3]) -> [i32; 3] {
        let step = 1i64 << self.grid_shift;
        std::array::from_fn(|i| {
            let offset = i64::from(p[i]) - i64::from(self.cell_min[i]);
            (i64::from(self.cell_min[i]) + (offset + step / 2) / step * step) as i32
        })
    }

    /// Largest distance to a triangle of the source that carries so much already.
    fn left(&self, carried: f64) -> f64 {
        (self.whole - carried).max(LEAST_SHARE * self.whole)
    }

    /// The same, for most of a source.
    pub(crate) fn left_by_most(whole: f64, source: &Source) -> f64 {
        let mut carried: Vec<f64> = source.distances().collect();
        if carried.is_empty() {
            return whole;
        }
        let at = (MOST * (carried.len() - 1) as f64) as usize;
        let most = *carried.select_nth_unstable_by(at, f64::total_cmp).1;
        (whole - most).max(LEAST_SHARE * whole)
    }
}

/// This share of the budget is always left: what carries more becomes worse than the budget.
pub(crate) const LEAST_SHARE: f64 = 0.25;

/// The share of a source's triangles that are most of it.
const MOST: f64 = 0.9;

/// Geometry of a node, gathered from below. Lengths in lattice steps.
#[derive(Debug, Default)]
pub(crate) struct Source {
    pub(crate) mesh: Mesh,
    /// What each triangle carries against the original; empty where all of it is the original.
    pub(crate) carried: Vec<Carried>,
    /// What normals were smoothed by so far, at most; radians.
    pub(crate) smoothing: f32,
    /// How far the lines in which it ends on faces of cells are from the original's sections with
    /// them.
    pub(crate) border: f64,
}

impl Source {
    /// Bound of the two-sided Hausdorff distance to the original.
    pub(crate) fn distance(&self) -> f64 {
        self.distances().fold(0.0, f64::max)
    }

    /// The same of each triangle.
    fn distances(&self) -> impl Iterator<Item = f64> + '_ {
        self.carried.iter().map(|c| c.forward.distance.max(c.backward.distance))
    }
}

/// A simplified mesh against the original inside the cell. Lengths in lattice steps, angles in
/// radians.
#[derive(Debug)]
pub(crate) struct Simplified {
    pub(crate) mesh: Mesh,
    pub(crate) carried: Vec<Carried>,
    /// Bound of the two-sided Hausdorff distance.
    pub(crate) distance: f64,
    /// Normals of matches differ by no more: anywhere on either surface, and over 99 and 90 % of
    /// this one's area.
    pub(crate) normal_deviation: [f32; 3],
    /// The original's normals were smoothed by no more before they were compared.
    pub(crate) smoothing: f32,
    /// How far the lines in which it ends on the cell's faces are, within the faces, from the
    /// original's.
    pub(crate) border: f64,
    /// Estimate: how far away what is seen of the source is found again.
    pub(crate) visual: f64,
}

/// Both representations of a node.
#[derive(Debug)]
pub(crate) struct Both {
    pub(crate) appearance: Simplified,
    pub(crate) geometric: Simplified,
    /// Whether components that bounded a volume became single triangles.
    pub(crate) is_opened: bool,
}

/// Root mean square distance at which quadrics stop, as a share of the budget.
const QUADRIC_SHARE: f64 = 0.5;

/// How often what fails is taken back before its last state is taken, with the error that it has.
const ROUNDS: u32 = 16;

/// Simplifies `source` within `budget`.
///
/// # Panics
/// When `source` has no triangles.
pub(crate) fn simplify(source: &Source, budget: &Budget) -> Both {
    if source.mesh.has_colours() { run::<6>(source, budget) } else { run::<3>(source, budget) }
}

/// `K` attributes: three of the normal, then three of the colour.
fn run<const K: usize>(source: &Source, budget: &Budget) -> Both {
    let centre = DVec3::from_array(budget.cell_min.map(f64::from))
        + DVec3::splat(f64::from(budget.cell_units) * 0.5);
    let prepared = prepare(&source.mesh, centre, budget.whole);
    let neighbours = prepared.surface.neighbours();
    let mut vertices: Vec<Vertex<K>> =
        (0..prepared.positions.len()).map(|v| start(&prepared, v, budget)).collect();
    for (triangle, carried) in prepared.surface.triangles.iter().zip(source.distances()) {
        let allowance = QUADRIC_SHARE * budget.left(carried);
        for &v in triangle {
            let vertex = &mut vertices[v as usize];
            vertex.allowance = vertex.allowance.min(allowance);
        }
    }
    let dust = Dust::of(&prepared, source, budget);
    let larger = dust.larger(&prepared.surface.triangles);
    let mut collapser = Collapser::new(&vertices, &larger);

    let tolerance = (budget.normal_noise * prepared.normal_noise).max(NORMAL_STEP);
    let attributes = AttributeLimits {
        length: NORMAL_LENGTH * budget.distance,
        tolerance: tolerance.into(),
        reach: REACH * budget.distance,
    };
    let limits = Limits {
        grid: f64::from(1u32 << budget.grid_shift),
        origin: DVec3::from_array(budget.cell_min.map(f64::from)) - centre,
        attributes: Some(attributes),
    };
    let shading =
        Shading { noise: budget.normal_noise, step: NORMAL_STEP, reach: attributes.reach };
    let chains = simplify_chains(&source.mesh, budget, &shading);
    let pins: Vec<Pin<K>> = chains.pins.iter().map(|pin| pin_at(pin, centre)).collect();
    let pin_of = |geometric: bool| -> Vec<u32> {
        let pin =
            |p: &[i32; 3]| chains.pin_of.get(p).map_or(NONE, |pins| pins[usize::from(geometric)]);
        prepared.positions.iter().map(pin).collect()
    };
    let step = Step {
        source,
        chains: &chains,
        prepared: &prepared,
        dust: &dust,
        neighbours: &neighbours,
        centre,
        budget,
        tolerance,
    };
    collapser.pin(pins.clone(), pin_of(false));
    let appearance = refine(&mut collapser, &limits, &step);
    let limits = Limits { attributes: None, ..limits };
    collapser.pin(pins, pin_of(true));
    collapser.relax(&limits);
    let geometric = refine(&mut collapser, &limits, &step);
    Both { appearance, geometric, is_opened: dust.opens() }
}

/// What both representations of a node are made from and compared with.
struct Step<'a> {
    source: &'a Source,
    prepared: &'a Prepared,
    chains: &'a Chains,
    dust: &'a Dust,
    neighbours: &'a [[u32; 3]],
    /// Of the cell, in lattice steps.
    centre: DVec3,
    budget: &'a Budget,
    /// Differences of normals below this are noise; radians.
    tolerance: f32,
}

/// Lost normals may be found again this many budgets away, as quadrics see it: with it, and with
/// twice the noise of normals, pictures of statues differ from full resolution by less than a pixel; see
/// bench-paths/NOTES.md.
const REACH: f64 = 3.0;

/// ε_vis is taken over this share of the source's area. Each triangle's part in it comes from
/// bounds, of angles as of distances, and is several times what pictures show: with larger shares
/// flat faces with a little noise would always be drawn at full resolution.
const VISUAL_SHARE: f64 = 0.8;

/// Colours that differ by less, of 1, look the same.
const COLOUR_STEP: f32 = 2.0 / 255.0;

/// A normal that turns by one radian counts as much as a vertex that moves by this much of the
/// budget.
const NORMAL_LENGTH: f64 = 4.0;

/// One step of an 8-bit shade: 0.225°.
const NORMAL_STEP: f32 = 0.225 * std::f32::consts::PI / 180.0;

fn start<const K: usize>(prepared: &Prepared, v: usize, budget: &Budget) -> Vertex<K> {
    let look = &prepared.surface.looks[v];
    let values = [look.normal.to_array(), look.colour.to_array()];
    Vertex {
        position: prepared.surface.positions[v],
        attributes: std::array::from_fn(|k| f64::from(values.as_flattened()[k])),
        fixed: std::array::from_fn(|i| {
            let offset = prepared.positions[v][i].abs_diff(budget.cell_min[i]);
            offset == 0 || offset == budget.cell_units
        }),
        allowance: QUADRIC_SHARE * budget.whole,
        pin: NONE,
    }
}

fn pin_at<const K: usize>(pin: &chains::Pin, centre: DVec3) -> Pin<K> {
    let values = [pin.normal.to_array(), pin.colour.to_array()];
    Pin {
        place: DVec3::from_array(pin.place.map(f64::from)) - centre,
        attributes: std::array::from_fn(|k| f64::from(values.as_flattened()[k])),
    }
}

/// Collapses as far as the limits allow, and takes back what the certificate refuses.
fn refine<const K: usize>(
    collapser: &mut Collapser<'_, K>,
    limits: &Limits,
    step: &Step<'_>,
) -> Simplified {
    let Step { prepared, budget, centre, .. } = *step;
    collapser.run(limits, |_| true);
    let mut dust = step.dust.clone();
    // Triangles of the source that rounding would lose.
    let mut specks: Vec<u32> = Vec::new();
    let mut earlier: Option<(Certificate, Surface)> = None;
    for round in 0.. {
        let Emitted { mut mesh, became } = emit(collapser, (prepared, step.chains), centre, budget);
        for &t in &specks {
            Speck::of_triangle(prepared, t).add_to(&mut mesh, budget, false);
        }
        // Openings that collapses and rounding left are filled as far as what fills them can be within the budget; the
        // certificate has to find that it is.
        let cube = Cube { min: budget.cell_min, units: budget.cell_units };
        fill_simplified(&mut mesh, budget.whole, &cube);
        dust.add_to(&mut mesh, prepared, budget);
        if mesh.triangles.is_empty() {
            // Rounding left nothing.
            specks = (0..prepared.surface.triangles.len() as u32).collect();
            continue;
        }
        let limit = if round < ROUNDS { budget.whole } else { f64::INFINITY };
        let ask = Ask {
            tolerance: TOLERANCE * budget.distance,
            limit,
            least: LEAST_SHARE * budget.whole,
            near: NEAR * budget.distance,
        };
        let simplified = surface_of(&mesh, centre);
        let known = earlier.map(|(c, old)| c.still_known(&old, &simplified)).unwrap_or_default();
        let pair = Pair {
            source: &prepared.surface,
            neighbours: step.neighbours,
            carried: &step.source.carried,
            simplified: &simplified,
            became: &became,
        };
        let certificate = certify(&pair, ask, known);
        if certificate.holds() {
            return finish(mesh, &became, &certificate, step, &dust);
        }
        dust.take_back(&certificate.lost);
        if round >= SPECK_ROUND {
            specks.extend(certificate.lost.iter().filter(|&&t| !dust.is_dust(t)));
            specks.sort_unstable();
            specks.dedup();
        }
        let wrong = wrong_vertices(collapser, &certificate, &pair);
        let restored = collapser.restore(|v| wrong[v as usize], round >= RELEASE_ROUND);
        collapser.run(limits, |v| restored[v as usize]);
        earlier = Some((certificate, simplified));
    }
    unreachable!("the last round returns")
}

/// Marks the vertices, by their numbers in the source, at places that are over the limit.
fn wrong_vertices<const K: usize>(
    collapser: &Collapser<'_, K>,
    certificate: &Certificate,
    pair: &Pair<'_>,
) -> Vec<bool> {
    let mut wrong = vec![false; pair.became.len()];
    let mut simplified_wrong = vec![false; pair.simplified.positions.len()];
    for &lost in &certificate.lost {
        for &v in &pair.source.triangles[lost as usize] {
            wrong[collapser.vertex_of(v) as usize] = true;
        }
    }
    for &invented in &certificate.invented {
        let corners = pair.simplified.triangles[invented as usize];
        corners.iter().for_each(|&v| simplified_wrong[v as usize] = true);
    }
    for (v, &became) in pair.became.iter().enumerate() {
        wrong[v] |= became != NONE && simplified_wrong[became as usize];
    }
    wrong
}

/// From this round on, vertices on chains that are still wrong are taken back to the source's, so
/// that the neighbouring cell's differ.
const RELEASE_ROUND: u32 = 8;

/// From this round on, what is still lost has been rounded away: pieces by themselves that are
/// smaller than the grid.
const SPECK_ROUND: u32 = 4;

/// Distances below this share of the budget are not told apart: doing so would cost most of the
/// time and gain little.
const TOLERANCE: f64 = 0.5;

/// Beyond this share of the budget it matters which point is nearest.
const NEAR: f64 = 0.8;

/// What the step did, added to what the source already carried.
fn finish(
    mesh: Mesh,
    became: &[u32],
    certificate: &Certificate,
    step: &Step<'_>,
    dust: &Dust,
) -> Simplified {
    let Step { prepared, source, chains, budget, tolerance, .. } = *step;
    let places = prepared.positions.iter().zip(became).filter(|(_, became)| **became != NONE);
    let place_of: HashMap<[i32; 3], [i32; 3]> = places
        .filter(|(p, _)| chains.pin_of.contains_key(*p))
        .map(|(p, &became)| (*p, mesh.positions[became as usize]))
        .collect();
    let moved = chains.deviation(|p| place_of.get(&p).copied(), budget.whole);
    let carried = certificate.carried(&source.carried);
    let both = |c: &Carried| c.forward.max(c.backward);
    let worst = carried.iter().map(both).fold(Deviation::default(), Deviation::max);
    let areas: Vec<f64> =
        mesh.triangles.iter().map(|t| area(t.map(|v| mesh.positions[v as usize]))).collect();
    let angles = carried.iter().map(|c| f64::from(c.backward.angle)).zip(areas).collect();
    let [p99, p90] = quantiles(angles, [0.99, 0.9]);
    Simplified {
        distance: worst.distance,
        normal_deviation: [worst.angle, p99 as f32, p90 as f32],
        smoothing: source.smoothing + prepared.smoothed,
        border: source.border + moved,
        visual: visual(certificate, prepared, dust, tolerance),
        carried,
        mesh,
    }
}

/// The paper's ε_vis of this step: how far away, on the surface or off it, what is seen of the
/// source is found again, over [`VISUAL_SHARE`] of its area.
///
/// The closest point's normal differs by some angle from the source's; at the rate at which
/// normals change on the simplified triangle, the right one is found angle ÷ rate further.
/// Differences below `tolerance` (radians) are noise. Of components smaller than the node's error no
/// shading can be told, only where they are.
fn visual(certificate: &Certificate, prepared: &Prepared, dust: &Dust, tolerance: f32) -> f64 {
    let distances = certificate.forward.iter().enumerate().filter_map(|(t, bound)| {
        let bound = bound.as_ref()?;
        let walk = |difference: f32, tolerance: f32, slope: f32| {
            let rest = difference - tolerance;
            if rest <= 0.0 { 0.0 } else { f64::from(rest / slope.max(f32::MIN_POSITIVE)) }
        };
        let (normal, colour) = if dust.is_dust(t as u32) {
            (0.0, 0.0)
        } else {
            (
                walk(bound.deviation.angle, tolerance, bound.normal_slope),
                walk(bound.colour, COLOUR_STEP, bound.colour_slope),
            )
        };
        let all = [bound.deviation.distance, normal, colour].map(|d| d * d).iter().sum::<f64>();
        let [a, b, c] = prepared.surface.corners(t as u32);
        Some((all.sqrt(), (b - a).cross(c - a).length()))
    });
    let [seen] = quantiles(distances.collect(), [VISUAL_SHARE]);
    seen
}

/// Area of a triangle.
fn area(corners: [[i32; 3]; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| DVec3::from_array(p.map(f64::from)));
    (b - a).cross(c - a).length() * 0.5
}

/// The values that given shares of the weight do not exceed.
fn quantiles<const N: usize>(mut weighted: Vec<(f64, f64)>, shares: [f64; N]) -> [f64; N] {
    weighted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = weighted.iter().map(|w| w.1).sum();
    shares.map(|share| {
        let mut sum = 0.0;
        let found = weighted.iter().find(|(_, weight)| {
            sum += weight;
            sum >= share * total * (1.0 - 1e-12)
        });
        found.or(weighted.last()).map_or(0.0, |w| w.0)
    })
}

#[cfg(test)]
mod tests;
