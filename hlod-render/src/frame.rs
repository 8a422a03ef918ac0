//! One frame, as an outline: receive → select receivers → select casters → request → surface →
//! shadow → shade.

use std::time::Duration;

use glam::DVec3;

use crate::arena::{Arena, Slot};
use crate::casters::{CasterView, Casting, Receiver, select_casters};
use crate::clip::check_clip;
use crate::colour_map::bounds_shown;
use crate::error::RenderError;
use crate::fit::{Fit, takes_what_it_needs};
use crate::gpu::Gpu;
use crate::lit::{Lit, LitPart};
use crate::loader::{Part, PointPrefix};
use crate::model::{Model, Room};
use crate::passes::{
    Drawn, DrawnPart, DrawnShadow, FaceUniforms, FrameUniform, PassSets, Range, Targets,
};
use crate::prefetch::Prefetch;
use crate::ring::Ring;
use crate::scene::{Light, Representation, Shadow, Shot};
use crate::seams::{self, REACH_MAX};
use crate::seen::Seen;
use crate::select::{Front, Selection, View, select};
use crate::shadow_map::MapCount;
use crate::skeleton::{ChildLink, Node, Skeleton};
use crate::skirts::find_open_faces;
use crate::survey::Survey;
use crate::traced::Tracer;
use crate::uniform::{scalar, uniform};

/// What a frame drew, for statistics and benchmark records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameStats {
    /// Triangles handed to the rasteriser.
    pub triangles: u64,
    /// Points drawn.
    pub points: u64,
    /// Nodes drawn.
    pub nodes: usize,
    /// Different depths that they are of.
    pub depths: usize,
    /// Triangles and points that cast shadows.
    pub caster_triangles: u64,
    /// Nodes that do.
    pub caster_nodes: usize,
    /// Nodes that were wanted and whose ancestors were drawn instead, or cast shadows instead.
    pub missing_parts: usize,
    /// Of these, those that were to cast shadows.
    pub missing_casters: usize,
    /// Mean of max(1, ρ/τ) over drawn nodes, weighted by their size on screen.
    pub tau_ratio: f64,
    /// Largest ρ/τ of a drawn node.
    pub tau_ratio_max: f64,
    /// How many times coarser than asked for everything is, so that it fits into the GPU's memory; 1 where it does as it
    /// is, and in pictures that are to be complete.
    pub coarsening: f64,
}

impl Default for FrameStats {
    /// Of a frame that draws nothing.
    fn default() -> Self {
        FrameStats {
            triangles: 0,
            points: 0,
            nodes: 0,
            depths: 0,
            caster_triangles: 0,
            caster_nodes: 0,
            missing_parts: 0,
            missing_casters: 0,
            tau_ratio: 0.0,
            tau_ratio_max: 0.0,
            coarsening: 1.0,
        }
    }
}

/// What a frame draws of each model.
#[derive(Default)]
struct Fronts {
    receivers: Vec<Front>,
    /// Empty where no shadows are cast.
    casters: Vec<Front>,
    /// Of what may be seen, by which light is laid out.
    boxes: Vec<Receiver>,
    /// Of parts, what will be drawn when all of it is here.
    kept: Vec<Front>,
    kept_casters: Vec<Front>,
    /// Of parts, how far what is drawn may lie outside its boxes.
    beyond_px: Vec<f64>,
}

/// Draws models.
pub struct Renderer {
    passes: PassSets,
    prefetch: Prefetch,
    fit: Fit,
    /// What rays are traced against, once any were, and what it was made of.
    tracer: Option<(Vec<std::path::PathBuf>, Tracer)>,
}

impl Renderer {
    /// Compiles the passes; `output` is the format of the pictures.
    pub fn new(gpu: &Gpu, output: wgpu::TextureFormat) -> Renderer {
        Renderer {
            passes: PassSets::new(gpu, output),
            prefetch: Prefetch::default(),
            fit: Fit::default(),
            tracer: None,
        }
    }

    /// Draws one frame with what is resident and asks for what is missing. Never waits.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn render(
        &mut self,
        gpu: &Gpu,
        models: &mut [Model],
        shot: &Shot,
        targets: &Targets,
    ) -> Result<FrameStats, RenderError> {
        let size = targets.window().picture();
        let coarsening = self.fit.coarsening(models, shot, size);
        let fitting = &shot.coarser(coarsening);
        self.prefetch.plan(models, fitting, size);
        let fronts = update(gpu, models, fitting, targets, Arrivals::AsTheyCome)?;
        self.draw(gpu, models, &fronts, fitting, targets)?;
        let can_choose = self.passes.whole().can_choose_points(gpu, targets);
        Ok(FrameStats { coarsening, ..stats(models, &fronts, shot, targets, can_choose) })
    }

    /// Draws one frame after loading everything it wants; the same picture every time.
    ///
    /// # Errors
    /// When the GPU fails, or a part that is needed is damaged.
    pub fn render_complete(
        &mut self,
        gpu: &Gpu,
        models: &mut [Model],
        shot: &Shot,
        targets: &Targets,
    ) -> Result<FrameStats, RenderError> {
        loop {
            let fronts = update(gpu, models, shot, targets, Arrivals::InOrder(None))?;
            let mut all = fronts.receivers.iter().chain(&fronts.casters);
            if all.all(|f| f.wanted.is_empty()) || !models.iter().any(Model::is_loading) {
                self.draw(gpu, models, &fronts, shot, targets)?;
                let can_choose = self.passes.whole().can_choose_points(gpu, targets);
                return Ok(stats(models, &fronts, shot, targets, can_choose));
            }
            std::thread::yield_now();
        }
    }

    /// Draws a part of a picture after loading everything it wants: bit for bit what the whole picture
    /// has there. Adapters without 64-bit atomics may differ by roundings at edges.
    ///
    /// # Errors
    /// When the GPU fails, or a part that is needed is damaged.
    pub fn render_part(
        &mut self,
        gpu: &Gpu,
        models: &mut [Model],
        shot: &Shot,
        targets: &Targets,
        survey: &Survey,
    ) -> Result<FrameStats, RenderError> {
        loop {
            let fronts = update(gpu, models, shot, targets, Arrivals::InOrder(Some(survey)))?;
            let mut all = fronts.receivers.iter().chain(&fronts.casters);
            if all.all(|f| f.wanted.is_empty()) || !models.iter().any(Model::is_loading) {
                self.draw(gpu, models, &fronts, shot, targets)?;
                let can_choose = self.passes.whole().can_choose_points(gpu, targets);
                return Ok(stats(models, &fronts, shot, targets, can_choose));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn draw(
        &mut self,
        gpu: &Gpu,
        models: &[Model],
        fronts: &Fronts,
        shot: &Shot,
        targets: &Targets,
    ) -> Result<(), RenderError> {
        let mut ranges = Vec::new();
        let mut casting = Vec::new();
        let mut parts = Vec::new();
        let mut uniforms = Vec::new();
        // For each uniform, which model it is of.
        let mut model_of = Vec::new();
        let mut first_identity = 0;
        let mut seen = Seen::nothing(targets);
        let can_choose = self.passes.whole().can_choose_points(gpu, targets);
        for (m, (model, front)) in models.iter().zip(&fronts.receivers).enumerate() {
            for (arena, buffers) in model.arenas().iter().enumerate() {
                let has_colours = model.header().has_colours();
                let world_from_model = model.world_from_model();
                let mut uniform =
                    uniform(world_from_model, has_colours, shot, targets, first_identity);
                let step = model.header().lattice.step;
                let scale = world_from_model.x_axis.truncate().length();
                let error = |node: &Node, representation: usize| {
                    (node.representations[representation].geometric_error * scale) as f32
                };
                // Where nothing is between points their discs' planes are.
                let point_error = |node: &Node, representation: usize| {
                    let r = &node.representations[representation];
                    ((r.geometric_error + r.cover_radius) * scale) as f32
                };
                let view = View::of_shot(shot, world_from_model, targets.window().picture());
                uniform.points.w = step as f32;
                uniform.scalar = scalar(shot.paint, model.header());
                // Open scans have no inside.
                uniform.bias.w = f32::from(u8::from(model.is_closed() && !shot.clip.is_none()));
                uniforms.push((uniform, buffers));
                model_of.push(m);
                let index = uniforms.len() - 1;
                let bounds = bounds_shown(model.header());
                let margin_px = (REACH_MAX * front.border_px)
                    .max(fronts.beyond_px.get(m).copied().unwrap_or(0.0));
                for draw in &front.draws {
                    let Some(slot) = model.slot(draw.node, draw.representation) else { continue };
                    if slot.arena == arena {
                        let node = &model.skeleton().nodes()[draw.node as usize];
                        seen.add(&uniform.clip_from_model, node.min, node.max, margin_px);
                        let cull_backs = node.closed_oriented
                            && !shot.draw_backs
                            && !shot.backs_magenta
                            && shot.clip.is_none();
                        let open = if shot.draw_skirts { draw.open_faces } else { 0 };
                        for triangles in slot.triangles_and_skirts(open) {
                            ranges.push(Range {
                                uniform: index,
                                triangles,
                                points_level: None,
                                cull_backs,
                                error: error(node, draw.representation),
                            });
                        }
                        if let Some((points, level)) = points_of(slot, node, &view, can_choose) {
                            ranges.push(Range {
                                uniform: index,
                                triangles: points,
                                points_level: Some(level),
                                // One normal does not tell where all that it stands for faces.
                                cull_backs: false,
                                error: point_error(node, draw.representation),
                            });
                        }
                        let first = first_identity + slot.primitives.start;
                        let drawn = &node.representations[draw.representation];
                        parts.push(DrawnPart::new(node, drawn, first, bounds));
                    }
                }
                for draw in fronts.casters.get(m).iter().flat_map(|front| &front.draws) {
                    let Some(slot) = model.slot(draw.node, draw.representation) else { continue };
                    if slot.arena == arena {
                        // A ray to a light outside leaves every closed body that it meets through
                        // a triangle that faces the light: the others need not cast. Where it
                        // enters may be nearer than the bias.
                        let node = &model.skeleton().nodes()[draw.node as usize];
                        let cull_backs = node.closed_oriented
                            && is_outside(model, shot.light, shot.light_radius());
                        let points = slot.points();
                        let error = error(node, draw.representation);
                        for triangles in slot.triangles_and_skirts(draw.open_faces) {
                            let points_level = None;
                            casting.push(Range {
                                uniform: index,
                                triangles,
                                points_level,
                                cull_backs,
                                error,
                            });
                        }
                        if !points.is_empty() {
                            casting.push(Range {
                                uniform: index,
                                triangles: points,
                                points_level: Some(0),
                                cull_backs: false,
                                error: point_error(node, draw.representation),
                            });
                        }
                    }
                }
                first_identity += model.arena_size().triangles;
            }
        }

        let lit = (shot.shadow != Shadow::None).then(|| lit(models, &fronts.boxes, shot));
        let faces = lit.iter().flat_map(|lit| {
            let placed = model_of.iter().map(|&m: &usize| models[m].world_from_model());
            let parts: Vec<LitPart> = uniforms
                .iter()
                .zip(placed)
                .map(|((uniform, _), world_from_model)| LitPart {
                    uniform: *uniform,
                    world_from_model,
                })
                .collect();
            lit.face_uniforms(&parts)
        });
        let faces: Vec<FaceUniforms> = faces.collect();
        let tracer = match (shot.shadow, &lit) {
            (Shadow::Traced, Some(lit)) => Some((tracer(&mut self.tracer, models)?, lit)),
            _ => None,
        };
        let hidden = tracer.map(|(tracer, lit)| lit.hidden_by(tracer, targets));
        let map_plan = match (shot.shadow, &lit) {
            (Shadow::Mapped(map), Some(lit)) => {
                let bounds = models.iter().map(Model::bounds);
                Some(lit.map_plan(map, bounds, shot, targets))
            }
            _ => None,
        };
        let shadow = match (&hidden, shot.shadow) {
            (Some(hidden), _) => DrawnShadow::Traced { faces: &faces, hidden },
            (None, Shadow::None) => DrawnShadow::None,
            (None, _) => DrawnShadow::Cast {
                ranges: &casting,
                faces: &faces,
                is_soft: shot.light_radius() > 0.0,
                map: map_plan.as_ref(),
            },
        };
        let drawn = Drawn { ranges: &ranges, parts: &parts, area: seen.rectangle(), shadow };
        self.passes.of(gpu, shot).encode(gpu, &uniforms, &drawn, shot, targets)?;
        gpu.check()
    }

    /// What came of the shadow maps of the last frame that had any; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn map_count(&self, gpu: &Gpu) -> Result<MapCount, RenderError> {
        self.passes.whole().map_count(gpu)
    }

    /// Milliseconds of each stage of the last frame of nothing cut open by the GPU's clock, in order; none unless the device
    /// was opened with [`Gpu::headless_timed`]. Waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn stage_times(&self, gpu: &Gpu) -> Result<Vec<(&'static str, f64)>, RenderError> {
        self.passes.whole().stage_times(gpu)
    }

    /// Parts of what cast shadows for which there was no room in a list, of all frames so far: they take longer, and are
    /// not lost. Waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn shadow_tiles_beyond(&self, gpu: &Gpu) -> Result<u32, RenderError> {
        self.passes.whole().tiles_beyond(gpu)
    }

    /// Draws given ranges of given arenas; a frame's last step, and all of it for the reference of
    /// audits.
    pub(crate) fn draw_ranges(
        &mut self,
        gpu: &Gpu,
        uniforms: &[(FrameUniform, &Arena)],
        drawn: &Drawn<'_>,
        shot: &Shot,
        targets: &Targets,
    ) -> Result<(), RenderError> {
        self.passes.of(gpu, shot).encode(gpu, uniforms, drawn, shot, targets)?;
        gpu.check()
    }
}

/// The light of one frame.
fn lit(models: &[Model], boxes: &[Receiver], shot: &Shot) -> Lit {
    let centre =
        models.first().map_or(DVec3::ZERO, |m| m.world_from_model().transform_point3(DVec3::ZERO));
    let points: Vec<DVec3> = boxes.iter().flat_map(|receiver| *receiver.corners()).collect();
    Lit::around(&points, centre, shot)
}

/// Whether a light is outside a model's bounds.
fn is_outside(model: &Model, light: Light, radius: f64) -> bool {
    let (low, high) = model.bounds();
    let (low, high) = (low - radius, high + radius);
    match light {
        Light::Directional(_) => true,
        Light::Point(p) => p.cmplt(low).any() || p.cmpgt(high).any(),
    }
}

/// What rays are traced against: the leaves of these models, loaded when it is first needed.
fn tracer<'a>(
    kept: &'a mut Option<(Vec<std::path::PathBuf>, Tracer)>,
    models: &[Model],
) -> Result<&'a Tracer, RenderError> {
    let files: Vec<_> = models.iter().map(|model| model.path().to_owned()).collect();
    let (of, tracer) = match kept.take().filter(|(of, _)| *of == files) {
        Some(known) => known,
        None => (files, Tracer::load(models)?),
    };
    Ok(&kept.insert((of, tracer)).1)
}

/// What is asked of the receivers' front.
pub(crate) fn selection(shot: &Shot) -> Selection {
    let full = shot.representation == Representation::Full;
    Selection {
        kind: shot.representation.kind(),
        error_threshold_px: if full { 0.0 } else { shot.error_threshold_px },
    }
}

/// In which order what was read comes to the GPU. Where two triangles are equally near, at an edge that they share, that
/// which came first is drawn.
#[derive(Clone, Copy)]
enum Arrivals<'a> {
    /// Now what is here.
    AsTheyCome,
    /// All that was asked for, in the file's order; of a part of a picture, what is known of all of it.
    InOrder(Option<&'a Survey>),
}

/// What lies beside what a front draws.
fn ring_round(front: &Front, skeleton: &Skeleton) -> Ring {
    Ring::round(front.draws.iter().map(|draw| skeleton.nodes()[draw.node as usize].cell))
}

/// Receive → select → close seams → request, for every model.
fn update(
    gpu: &Gpu,
    models: &mut [Model],
    shot: &Shot,
    targets: &Targets,
    arrivals: Arrivals<'_>,
) -> Result<Fronts, RenderError> {
    check_clip(shot)?;
    let survey = match arrivals {
        Arrivals::AsTheyCome => None,
        Arrivals::InOrder(survey) => survey,
    };
    let (width, height) = targets.window().picture();
    let selection = selection(shot);
    let mut fronts = Fronts::default();
    // Of parts, what they show themselves.
    let mut shown = Vec::new();
    for (m, model) in models.iter_mut().enumerate() {
        let mut view = View::of_shot(shot, model.world_from_model(), (width, height));
        match arrivals {
            // Full resolution is drawn whatever it takes.
            Arrivals::AsTheyCome => match takes_what_it_needs(selection) {
                true => model.receive(gpu, Room::AsNeeded)?,
                false => model.receive(gpu, Room::Budget)?,
            },
            Arrivals::InOrder(_) => model.receive_in_order(gpu)?,
        }
        if let Some(survey) = survey {
            view = survey.narrowed(view, targets, m);
            let of_part = select(model.skeleton(), &view, selection, &|_, _| true);
            view = view.with_ring(ring_round(&of_part, model.skeleton()));
            shown.push(of_part);
            // What is here and cannot be drawn before the rest is must not make room for it.
            let kept = select(model.skeleton(), &view, selection, &|_, _| true);
            fronts.kept.push(Front { wanted: Vec::new(), ..kept });
        }
        let is_resident = |n, r| model.is_resident(n, r);
        let mut front = select(model.skeleton(), &view, selection, &is_resident);
        let borders = |n, r| model.slot(n, r).map(|slot| slot.borders);
        find_open_faces(&mut front.draws, model.skeleton(), &borders);
        model.close_seams(gpu, &front, seams::Drawn::Receivers);
        fronts.receivers.push(front);
    }
    if shot.shadow != Shadow::None {
        let shown = if survey.is_some() { &shown } else { &fronts.receivers };
        fronts.boxes = visible_boxes(models, shown);
    }
    if shot.shadow.is_cast() {
        let whole = survey.map_or(&fronts.boxes, |survey| &survey.boxes);
        for (m, model) in models.iter_mut().enumerate() {
            let mut view = caster_view(model, shot, (width, height), whole);
            if let Some(survey) = survey {
                let part = caster_view(model, shot, (width, height), &fronts.boxes);
                let reach = survey.casters[m].skirt_reach(model.header().lattice.step);
                view = view.near(part, reach);
                let casting = select_casters(model.skeleton(), &view, &|_, _| true);
                view = view.with_ring(ring_round(&casting, model.skeleton()));
            }
            let is_resident = |n, r| model.is_resident(n, r);
            let mut front = select_casters(model.skeleton(), &view, &is_resident);
            if survey.is_some() {
                let kept = select_casters(model.skeleton(), &view, &|_, _| true);
                fronts.kept_casters.push(Front { wanted: Vec::new(), ..kept });
            }
            let borders = |n, r| model.slot(n, r).map(|slot| slot.borders);
            find_open_faces(&mut front.draws, model.skeleton(), &borders);
            model.close_seams(gpu, &front, seams::Drawn::Casters);
            fronts.casters.push(front);
        }
    }
    for (m, model) in models.iter_mut().enumerate() {
        let kept = [fronts.kept.get(m), fronts.kept_casters.get(m)];
        model.request(&[Some(&fronts.receivers[m]), fronts.casters.get(m), kept[0], kept[1]]);
    }
    if let Some(survey) = survey {
        fronts.beyond_px = survey.receivers.iter().map(|whole| whole.beyond_px).collect();
        fronts.boxes.clone_from(&survey.boxes);
    }
    Ok(fronts)
}

/// Which parts of a model may cast on what is in these boxes.
pub(crate) fn caster_view(
    model: &Model,
    shot: &Shot,
    size: (u32, u32),
    boxes: &[Receiver],
) -> CasterView {
    CasterView::new(&Casting::of_shot(shot), &shot.camera, size, boxes, model.world_from_model())
}

/// Boxes of the nodes that are drawn.
pub(crate) fn visible_boxes(models: &[Model], fronts: &[Front]) -> Vec<Receiver> {
    let of_model = |(model, front): (&Model, &Front)| -> Vec<Receiver> {
        let (nodes, placed) = (model.skeleton().nodes(), model.world_from_model());
        let drawn = front.draws.iter().map(|draw| &nodes[draw.node as usize]);
        drawn.map(|node| Receiver::of(node, &placed)).collect()
    };
    models.iter().zip(fronts).flat_map(of_model).collect()
}

/// As few points as show no gaps: the fewest of which the larger radii are not seen.
fn points_of(
    slot: &Slot,
    node: &Node,
    view: &View,
    can_choose: bool,
) -> Option<(std::ops::Range<u32>, u32)> {
    let all = slot.prefixes.last().filter(|all| all.count > 0)?;
    let is_enough = |prefix: &&PointPrefix| {
        view.error_px(prefix.radius, node.min, node.max) <= PREFIX_RADIUS_PX
    };
    let chosen = slot.prefixes.iter().filter(|_| can_choose).find(is_enough).unwrap_or(all);
    Some((slot.first_point..slot.first_point + chosen.count, chosen.level))
}

/// Where points are left out the others are so large in the mean at most, from middle to side.
const PREFIX_RADIUS_PX: f64 = 1.0;

fn stats(
    models: &[Model],
    fronts: &Fronts,
    shot: &Shot,
    targets: &Targets,
    can_choose: bool,
) -> FrameStats {
    let view = |m: &Model| View::of_shot(shot, m.world_from_model(), targets.window().picture());
    let views: Vec<View> = models.iter().map(view).collect();
    let mut stats = FrameStats { tau_ratio: 0.0, ..FrameStats::default() };
    let mut weights = 0.0;
    let tau = shot.error_threshold_px.max(1e-9);
    let mut depths = 0u64;
    for (m, (model, front)) in models.iter().zip(&fronts.receivers).enumerate() {
        stats.nodes += front.draws.len();
        stats.missing_parts += front
            .wanted
            .iter()
            .filter(|w| matches!(w.part, Part::Page(..) | Part::Block(_)))
            .count();
        for draw in &front.draws {
            let node = &model.skeleton().nodes()[draw.node as usize];
            depths |= 1 << node.depth.min(63);
            if let Some(slot) = model.slot(draw.node, draw.representation) {
                let ranges = slot.triangles_and_skirts(draw.open_faces);
                stats.triangles += ranges.iter().map(|range| range.len() as u64).sum::<u64>();
                let points = points_of(slot, node, &views[m], can_choose);
                stats.points += points.map_or(0, |(points, _)| points.len() as u64);
            }
            // A leaf is as fine as it gets.
            let ratio = if node.children == ChildLink::None { 0.0 } else { draw.error_px / tau };
            let ratio = ratio.min(1e6);
            stats.tau_ratio += ratio.max(1.0) * draw.area_px;
            stats.tau_ratio_max = stats.tau_ratio_max.max(ratio);
            weights += draw.area_px;
        }
    }
    for (model, front) in models.iter().zip(&fronts.casters) {
        stats.caster_nodes += front.draws.len();
        stats.missing_parts += front.wanted.len();
        stats.missing_casters += front.wanted.len();
        for draw in &front.draws {
            if let Some(slot) = model.slot(draw.node, draw.representation) {
                let ranges = slot.triangles_and_skirts(draw.open_faces);
                stats.caster_triangles +=
                    ranges.iter().map(|range| range.len() as u64).sum::<u64>()
                        + slot.points().len() as u64;
            }
        }
    }
    stats.depths = depths.count_ones() as usize;
    stats.tau_ratio = if weights > 0.0 { stats.tau_ratio / weights } else { 1.0 };
    stats
}
