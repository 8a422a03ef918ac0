//! What a whole picture wants, found before any of its parts is drawn.
//!
//! Parts of a picture ask for nothing but what they show, so that their sum may be larger than any
//! memory. How far skirts reach at most, from where casters count and how light is laid out depends on all that
//! is seen: it is found once, from the octree alone, and holds for every part.

use glam::DVec2;

use crate::casters::{Receiver, select_casters};
use crate::error::RenderError;
use crate::frame::{caster_view, selection, visible_boxes};
use crate::gpu::Gpu;
use crate::loader::Part;
use crate::model::Model;
use crate::passes::Targets;
use crate::scene::{Shadow, Shot};
use crate::seams::{REACH_MAX, reach_most};
use crate::select::{Front, View, select};

/// What holds for all parts of one picture.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    pub(crate) receivers: Vec<Whole>,
    pub(crate) casters: Vec<Whole>,
    pub(crate) boxes: Vec<Receiver>,
    /// Triangles that the whole picture shows.
    pub triangles: u64,
    /// Points that it shows at most.
    pub points: u64,
    /// Nodes that it shows.
    pub nodes: u64,
    /// Triangles and points that cast shadows on these.
    pub caster_triangles: u64,
    /// Nodes that do.
    pub caster_nodes: u64,
}

/// What all of a front has in common.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Whole {
    border_error: f64,
    /// How far what is drawn of a node may lie outside its box.
    pub(crate) beyond_px: f64,
}

impl Whole {
    fn of(front: &Front, beyond_px: f64) -> Whole {
        Whole { border_error: front.border_error, beyond_px }
    }

    /// How far skirts reach at most, where a step of the lattice is so long.
    pub(crate) fn skirt_reach(&self, step: f64) -> f64 {
        reach_most(self.border_error, step)
    }
}

impl Survey {
    /// Finds what a picture of this size wants, as if all of it were resident. Reads the octree as far
    /// as it is seen, and no page.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn new(
        gpu: &Gpu,
        models: &mut [Model],
        shot: &Shot,
        size: (u32, u32),
    ) -> Result<Survey, RenderError> {
        loop {
            for model in models.iter_mut() {
                model.receive_in_order(gpu)?;
            }
            let receivers: Vec<Front> = models.iter().map(|m| ideal(m, shot, size)).collect();
            let mut boxes = Vec::new();
            if shot.shadow != Shadow::None {
                boxes = visible_boxes(models, &receivers);
            }
            let casts = shot.shadow.is_cast();
            let casting = models.iter().filter(|_| casts).map(|m| {
                select_casters(m.skeleton(), &caster_view(m, shot, size, &boxes), &|_, _| true)
            });
            let casters: Vec<Front> = casting.collect();
            let missing = |f: &Front| f.wanted.iter().any(|w| matches!(w.part, Part::Block(_)));
            let complete = !receivers.iter().chain(&casters).any(missing);
            for (m, model) in models.iter_mut().enumerate() {
                model.request(&[Some(&receivers[m]), casters.get(m)]);
            }
            if complete || !models.iter().any(Model::is_loading) {
                return Ok(Survey::of(models, shot, size, &receivers, &casters, boxes));
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }

    fn of(
        models: &[Model],
        shot: &Shot,
        (width, height): (u32, u32),
        receivers: &[Front],
        casters: &[Front],
        boxes: Vec<Receiver>,
    ) -> Survey {
        let mut all = Survey { boxes, ..Survey::default() };
        let whole = |(model, front): (&Model, &Front)| {
            let view = View::of_shot(shot, model.world_from_model(), (width, height));
            let mut beyond_px = REACH_MAX * front.border_px;
            for draw in &front.draws {
                let node = &model.skeleton().nodes()[draw.node as usize];
                let r = &node.representations[draw.representation];
                all.triangles += u64::from(r.triangles);
                all.points += u64::from(r.points);
                if r.points > 0 {
                    let radius = r.cover_radius + r.geometric_error;
                    beyond_px = beyond_px.max(view.error_px(2.0 * radius, node.min, node.max));
                }
            }
            Whole::of(front, beyond_px.min(f64::from(height)) + 2.0)
        };
        let wholes = models.iter().zip(receivers).map(whole).collect();
        all.receivers = wholes;
        all.casters = casters.iter().map(|front| Whole::of(front, 0.0)).collect();
        all.nodes = receivers.iter().map(|front| front.draws.len() as u64).sum();
        all.caster_nodes = casters.iter().map(|front| front.draws.len() as u64).sum();
        for (model, draw) in
            models.iter().zip(casters).flat_map(|(m, f)| f.draws.iter().map(move |d| (m, d)))
        {
            let node = &model.skeleton().nodes()[draw.node as usize];
            let r = &node.representations[draw.representation];
            all.caster_triangles += u64::from(r.triangles) + u64::from(r.points);
        }
        all
    }

    /// A view that sees what may be in the part that targets show, of one model.
    pub(crate) fn narrowed(&self, view: View, targets: &Targets, model: usize) -> View {
        let window = targets.window();
        let picture = DVec2::new(window.picture_width.into(), window.picture_height.into());
        let first = DVec2::new(window.x.into(), window.y.into());
        let size = DVec2::new(targets.width().into(), targets.height().into());
        let beyond = DVec2::splat(self.receivers[model].beyond_px);
        let (low, high) = (first - beyond, first + size + beyond);
        // Rows run downwards.
        let ndc = |p: DVec2| (p / picture * 2.0 - 1.0) * DVec2::new(1.0, -1.0);
        let (a, b) = (ndc(low), ndc(high));
        view.narrowed(a.min(b), a.max(b))
    }
}

/// What would be drawn of a model if all of it were resident.
fn ideal(model: &Model, shot: &Shot, (width, height): (u32, u32)) -> Front {
    let view = View::of_shot(shot, model.world_from_model(), (width, height));
    select(model.skeleton(), &view, selection(shot), &|_, _| true)
}
