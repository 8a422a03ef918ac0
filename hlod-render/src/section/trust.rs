//! How far the lines of a section can be from the scan's own section.
//!
//! Every point of a leaf is within ε of the scan and every point of the scan within ε of the leaf;
//! this is proven when the file is built. In the plane this says less. Where the surface meets it
//! at an angle φ and is flat as far as ε ÷ sin φ, a surface that lies ε beside it meets the
//! plane ε ÷ sin φ farther on: that is how far a line can be displaced. A surface that only touches
//! the plane can be met anywhere, or nowhere, so that below [`GRAZING_DEG`] nothing is said; how much
//! of the lines is so is.
//!
//! What is not proven: surfaces that bend within ε ÷ sin φ. ε is a tiny part of the scan's own
//! spacing as a rule, and triangles are flat.

use super::crossing::{Crossing, Cutter};

/// Below this angle between surface and plane, in degrees, lines are not bounded: displacements are
/// over eleven times ε.
pub const GRAZING_DEG: f64 = 5.0;

/// What is known of a section's lines.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Trust {
    /// ε: no point of the leaves that were cut is farther from the scan, in the source's unit.
    pub file_bound: f64,
    /// Half of the lines' length is displaced by no more than this, in the source's unit; infinite
    /// where it is not bounded.
    pub outline_bound_50: f64,
    /// The same of 95 % of the length.
    pub outline_bound_95: f64,
    /// Which part of the length is too near to touching for anything to be said, from 0 to 1.
    pub grazing: f64,
}

impl Trust {
    pub(super) fn of(cutter: &Cutter<'_>, crossings: &[Crossing]) -> Trust {
        let grazing = GRAZING_DEG.to_radians().sin();
        let mut pieces: Vec<(f64, f64)> = crossings
            .iter()
            .map(|crossing| {
                let [from, to] = crossing.edges.map(|edge| cutter.point(edge));
                let bounded = crossing.steepness >= grazing;
                let bound =
                    if bounded { crossing.error / crossing.steepness } else { f64::INFINITY };
                (bound, from.distance(to))
            })
            .collect();
        pieces.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let length: f64 = pieces.iter().map(|piece| piece.1).sum();
        let unbounded = pieces.iter().filter(|p| p.0 == f64::INFINITY).map(|p| p.1).sum::<f64>();
        Trust {
            file_bound: crossings.iter().map(|c| c.error).fold(0.0, f64::max),
            outline_bound_50: quantile(&pieces, 0.5 * length),
            outline_bound_95: quantile(&pieces, 0.95 * length),
            grazing: if unbounded > 0.0 { unbounded / length } else { 0.0 },
        }
    }
}

/// The bound that holds of so much of the length.
fn quantile(pieces: &[(f64, f64)], length: f64) -> f64 {
    let mut sum = 0.0;
    let found = pieces.iter().find(|piece| {
        sum += piece.1;
        sum >= length
    });
    found.or(pieces.last()).map_or(0.0, |piece| piece.0)
}
