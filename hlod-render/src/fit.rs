//! What fits into the GPU's memory: where a frame asks for more than its budget, τ and τ_c rise until it does not.
//!
//! What a front takes is known before any of it is read: the skeleton has errors and sizes. So how coarse a frame
//! becomes depends on the view and the budget, not on what has come so far, and blocks of the skeleton that are not
//! there yet can only make it coarser.

use std::collections::HashSet;

use crate::casters::select_casters;
use crate::frame::{caster_view, selection, visible_boxes};
use crate::model::Model;
use crate::residency::page_bytes;
use crate::scene::Shot;
use crate::select::{Front, Selection, View, select};
use crate::skeleton::Skeleton;

/// A front, with what must stay beside it, may take so much of the budget: room is lost between pages.
const SHARE: f64 = 0.8;
/// τ rises by the fourth root of two.
const STEPS_PER_OCTAVE: u32 = 4;
/// And a thousand times at most.
const STEPS_MAX: u32 = 10 * STEPS_PER_OCTAVE;

/// By how much the last frame was coarser than was asked.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Fit {
    steps: u32,
}

impl Fit {
    /// What τ and τ_c are multiplied by, so that everything fits; 1 where it does without.
    pub(crate) fn coarsening(&mut self, models: &[Model], shot: &Shot, size: (u32, u32)) -> f64 {
        let has_room = models.iter().all(Model::may_grow);
        if has_room || takes_what_it_needs(selection(shot)) {
            return self.rest();
        }
        self.least(&|factor| {
            let fronts = ideal_fronts(models, &shot.coarser(factor), size);
            models
                .iter()
                .zip(fronts)
                .all(|(model, fronts)| fits(model.skeleton(), &fronts, model.limits().gpu_bytes))
        })
    }

    /// There is room for everything.
    pub(crate) fn rest(&mut self) -> f64 {
        self.steps = 0;
        1.0
    }

    /// The least factor with which it fits, found from the last one: from one frame to the next little changes.
    pub(crate) fn least(&mut self, fits: &dyn Fn(f64) -> bool) -> f64 {
        while self.steps < STEPS_MAX && !fits(factor(self.steps)) {
            self.steps += 1;
        }
        while self.steps > 0 && fits(factor(self.steps - 1)) {
            self.steps -= 1;
        }
        factor(self.steps)
    }
}

/// Whether the leaves are asked for: there is no τ that could rise.
pub(crate) fn takes_what_it_needs(selection: Selection) -> bool {
    selection.error_threshold_px <= 0.0
}

/// Whether fronts of one model are within the share of a budget that they may take.
pub(crate) fn fits(skeleton: &Skeleton, fronts: &[Front], budget_bytes: u64) -> bool {
    bytes(skeleton, fronts) as f64 <= SHARE * budget_bytes as f64
}

fn factor(steps: u32) -> f64 {
    2f64.powf(f64::from(steps) / f64::from(STEPS_PER_OCTAVE))
}

/// For each model what is drawn, and what casts on that, once all of it is here.
fn ideal_fronts(models: &[Model], shot: &Shot, size: (u32, u32)) -> Vec<[Front; 2]> {
    let receivers = |model: &Model| {
        let view = View::of_shot(shot, model.world_from_model(), size);
        select(model.skeleton(), &view, selection(shot), &|_, _| true)
    };
    let receivers: Vec<Front> = models.iter().map(receivers).collect();
    let boxes = if shot.shadow.is_cast() { visible_boxes(models, &receivers) } else { Vec::new() };
    let casters = |model: &Model| match shot.shadow.is_cast() {
        true => {
            let view = caster_view(model, shot, size, &boxes);
            select_casters(model.skeleton(), &view, &|_, _| true)
        }
        false => Front::default(),
    };
    models.iter().zip(receivers).map(|(model, front)| [front, casters(model)]).collect()
}

/// Bytes on the GPU of all pages of some fronts, each counted once.
fn bytes(skeleton: &Skeleton, fronts: &[Front]) -> u64 {
    let drawn = fronts.iter().flat_map(|front| &front.draws);
    let held = fronts.iter().flat_map(|front| &front.held);
    let pages: HashSet<(u32, usize)> =
        drawn.map(|draw| (draw.node, draw.representation)).chain(held.copied()).collect();
    let nodes = skeleton.nodes();
    pages.iter().map(|&(node, r)| page_bytes(&nodes[node as usize], r)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_factor_that_fits_is_found_from_anywhere() {
        let mut fit = Fit::default();
        for needed in [1.0, 1.5, 40.0, 2.0, 1.0, 900.0, 3.0] {
            let found = fit.least(&|factor| factor >= needed);
            let step = factor(1);
            assert!(found >= needed && found < needed * step + 1e-9, "{found} for {needed}");
        }
        assert_eq!(fit.rest(), 1.0);
        assert_eq!(fit.least(&|_| true), 1.0);
        // What never fits ends at the largest.
        assert_eq!(fit.least(&|_| false), factor(STEPS_MAX));
    }
}
