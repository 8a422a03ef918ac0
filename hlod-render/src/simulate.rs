//! What a policy of loading would have shown along a camera path: no GPU, and a link of known
//! bandwidth and latency instead of a disk.
//!
//! The front ([`crate::select`]), what fits into memory (`fit.rs`), what will be wanted ([`crate::need`]) and what is
//! asked for and makes room ([`crate::residency`]) are those that draw pictures. Time passes in frames, decoding and
//! copying take none. With shadows what casts them is loaded as well, in light that turns round the statue
//! or stays.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::{DMat4, DQuat, DVec3};
use hlod_compress::{FormatError, HlodFile};
use serde::Serialize;

use crate::camera::Camera;
use crate::casters::ahead::Outlook;
use crate::casters::{CasterView, Casting, Receiver, select_casters};
use crate::error::RenderError;
use crate::fit::{Fit, fits, takes_what_it_needs};
use crate::framing::Framing;
use crate::loader::{Part, Ticket, model_origin};
use crate::need::{Budget, LightTracker, Need, Pace, PaceTracker, Plan};
use crate::path::CameraPath;
use crate::prefetch::{Shown, plans};
use crate::residency::{
    DueTimes, Page, Refused, due_times, horizon_secs, page_bytes, requests, victim,
};
use crate::scene::Light;
use crate::select::{Draw, Front, Selection, View, Wanted, parse_ticket, select};
use crate::skeleton::{ChildLink, Skeleton};
use crate::source::open_local;

/// What is asked for before it is wanted, and what makes room.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Policy {
    /// Nothing ahead; what the view does not need is dropped.
    KeepNothing,
    /// Nothing ahead; what was drawn the longest ago makes room.
    Lru,
    /// What the view in half a second would draw if it went on as it does; the same makes room.
    Extrapolate,
    /// What motion within the pace can make wanted; what is wanted last makes room.
    Due,
    /// The same, but nothing ahead of what casts shadows. Only with shadows.
    DueReceivers,
}

impl Policy {
    /// All of them that differ without shadows, and one more that does with them.
    pub fn all(with_shadows: bool) -> &'static [Policy] {
        const ALL: [Policy; 5] = [
            Policy::KeepNothing,
            Policy::Lru,
            Policy::Extrapolate,
            Policy::Due,
            Policy::DueReceivers,
        ];
        if with_shadows { &ALL } else { &ALL[..4] }
    }

    /// For tables.
    pub fn name(self) -> &'static str {
        match self {
            Policy::KeepNothing => "keep nothing",
            Policy::Lru => "least recently used",
            Policy::Extrapolate => "extrapolated view",
            Policy::Due => "earliest due (as drawn)",
            Policy::DueReceivers => "earliest due, no casters",
        }
    }
}

/// A link, a cache and a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulationOptions {
    /// Of the link.
    pub bytes_per_sec: f64,
    /// From asking to the first byte.
    pub latency_secs: f64,
    /// Bytes of geometry that are kept, as on the GPU.
    pub cache_bytes: u64,
    /// Frames a second.
    pub frames_per_sec: f64,
    /// Size of the picture.
    pub size: (u32, u32),
    /// What is asked of the front.
    pub selection: Selection,
    /// Whether anything casts shadows.
    pub shadows: Option<SimulatedShadows>,
}

/// A light that turns round the statue's upright axis, or stays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedShadows {
    /// The light as the path begins.
    pub casting: Casting,
    /// How fast it turns, to the right as seen from above.
    pub turn_deg_per_sec: f64,
}

impl SimulatedShadows {
    /// The light at a moment.
    fn at(&self, secs: f64, framing: &Framing) -> Casting {
        let angle = (self.turn_deg_per_sec * secs).to_radians();
        let turn = DQuat::from_axis_angle(framing.axes[1], angle);
        let light = match self.casting.light {
            Light::Directional(towards) => Light::Directional(turn * towards),
            Light::Point(place) => Light::Point(framing.centre + turn * (place - framing.centre)),
        };
        Casting { light, ..self.casting }
    }
}

/// What one policy showed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PolicyReport {
    /// Which.
    pub policy: Policy,
    /// Frames along the path.
    pub frames: u32,
    /// Frames in which something that is seen could not be drawn at all.
    pub stalled_frames: u32,
    /// Mean over frames of max(1, ρ/τ), weighted by nodes' size on screen.
    pub tau_ratio_mean: f64,
    /// Frames after the first two seconds in which anything was coarser than 2τ.
    pub frames_over_2tau: u32,
    /// Frames after the first two seconds.
    pub frames_after_start: u32,
    /// Frames that were coarser because what was asked for does not fit into memory.
    pub frames_coarsened: u32,
    /// Most geometry that was kept, in bytes.
    pub kept_bytes_max: u64,
    /// Read over the link, skeleton included.
    pub bytes_read: u64,
    /// Of pages that were drawn, or cast shadows, after they were read.
    pub bytes_drawn: u64,
    /// What cast shadows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub casters: Option<CasterReport>,
}

/// What one policy showed of shadows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct CasterReport {
    /// Parts that were to cast shadows and were not here, summed over frames.
    pub missing_casters: u64,
    /// Frames after the first two seconds that lacked any.
    pub frames_missing_casters: u32,
    /// Frames after the first two seconds in which anything cast shadows that was coarser than 2τ_c.
    pub frames_over_2tau: u32,
}

/// A simulation's result.
#[derive(Debug, Clone, Serialize)]
pub struct SimulationReport {
    /// The file.
    pub file: PathBuf,
    /// Name of the path.
    pub path: String,
    /// τ in pixels.
    pub tau_px: f64,
    /// Of the link.
    pub bytes_per_sec: f64,
    /// Of the link.
    pub latency_secs: f64,
    /// Kept at most.
    pub cache_bytes: u64,
    /// Time is divided so.
    pub frames_per_sec: f64,
    /// τ_c in pixels, where anything casts shadows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub caster_tau_px: Option<f64>,
    /// How fast the light turns, where anything casts shadows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_turn_deg_per_sec: Option<f64>,
    /// One row each.
    pub policies: Vec<PolicyReport>,
}

/// Follows a path with every policy; `advance` hears of each finished one.
///
/// # Errors
/// When the file or the path cannot be used.
pub fn simulate(
    file: &Path,
    path: &CameraPath,
    options: &SimulationOptions,
    advance: &mut dyn FnMut(),
) -> Result<SimulationReport, RenderError> {
    let format = RenderError::format(file);
    let opened = open_local(file)?;
    let framing = Framing::of_header(opened.header());
    let placed = path.place(framing, file)?;
    let frames = (path.duration_secs * options.frames_per_sec).ceil().max(1.0) as u32 + 1;
    let moments: Vec<Moment> = (0..frames)
        .map(|i| {
            let secs = (f64::from(i) / options.frames_per_sec).min(path.duration_secs);
            let casting = options.shadows.map(|shadows| shadows.at(secs, &framing));
            Moment { camera: placed.camera_at(secs), selection: options.selection, casting }
        })
        .collect();
    let height = (framing.bounds.1 - framing.bounds.0).length();
    let mut policies = Vec::new();
    for &policy in Policy::all(options.shadows.is_some()) {
        let run = Run::new(&opened, options, policy, height).and_then(|run| run.follow(&moments));
        policies.push(run.map_err(&format)?);
        advance();
    }
    Ok(SimulationReport {
        file: file.to_owned(),
        path: path.name.clone(),
        tau_px: options.selection.error_threshold_px,
        bytes_per_sec: options.bytes_per_sec,
        latency_secs: options.latency_secs,
        cache_bytes: options.cache_bytes,
        frames_per_sec: options.frames_per_sec,
        caster_tau_px: options.shadows.map(|shadows| shadows.casting.threshold_px),
        light_turn_deg_per_sec: options.shadows.map(|shadows| shadows.turn_deg_per_sec),
        policies,
    })
}

/// A page that is kept.
struct Kept {
    bytes: u64,
    last_used: u64,
    was_drawn: bool,
}

/// One policy on its way.
struct Run<'a> {
    file: &'a HlodFile,
    options: &'a SimulationOptions,
    policy: Policy,
    statue_height: f64,
    world_from_model: DMat4,
    skeleton: Skeleton,
    kept: HashMap<Page, Kept>,
    kept_bytes: u64,
    /// Here, but there was no room yet.
    waiting: Vec<Page>,
    /// What is on its way, and when it arrives.
    coming: Vec<(f64, Ticket, Part)>,
    link_free_at: f64,
    due: DueTimes,
    refused: Refused,
    fit: Fit,
    frame: u64,
    bytes_read: u64,
    bytes_drawn: u64,
}

/// Requests that are not answered yet: enough to hide the latency.
const IN_FLIGHT_MAX: usize = 64;
/// A link is given no more than it brings in this time, so that plans can change.
const AHEAD_SECS: f64 = 0.1;

impl<'a> Run<'a> {
    fn new(
        file: &'a HlodFile,
        options: &'a SimulationOptions,
        policy: Policy,
        statue_height: f64,
    ) -> Result<Run<'a>, FormatError> {
        let header = file.header();
        let block = file.read_block(header.root_block)?;
        let skeleton = Skeleton::new(header.lattice, &block);
        let mut run = Run {
            file,
            options,
            policy,
            statue_height,
            world_from_model: DMat4::from_translation(model_origin(&header.lattice)),
            skeleton,
            kept: HashMap::new(),
            kept_bytes: 0,
            waiting: Vec::new(),
            coming: Vec::new(),
            link_free_at: 0.0,
            due: DueTimes::new(),
            refused: Refused::default(),
            fit: Fit::default(),
            frame: 0,
            bytes_read: header.front_bytes,
            bytes_drawn: 0,
        };
        // The front of the file is read before the first frame.
        for r in 0..run.skeleton.nodes()[0].representations.len() {
            run.keep((0, r));
        }
        Ok(run)
    }

    fn follow(mut self, moments: &[Moment]) -> Result<PolicyReport, FormatError> {
        const START_SECS: f64 = 2.0;
        let (mut eye, mut lamp) = (PaceTracker::default(), LightTracker::default());
        let mut report = PolicyReport {
            policy: self.policy,
            frames: moments.len() as u32,
            stalled_frames: 0,
            tau_ratio_mean: 0.0,
            frames_over_2tau: 0,
            frames_after_start: 0,
            frames_coarsened: 0,
            kept_bytes_max: 0,
            bytes_read: 0,
            bytes_drawn: 0,
            casters: self.options.shadows.map(|_| CasterReport::default()),
        };
        for (i, moment) in moments.iter().enumerate() {
            let now = i as f64 / self.options.frames_per_sec;
            self.frame += 1;
            self.receive(now)?;
            let coarsening = self.coarsening(moment);
            report.frames_coarsened += u32::from(coarsening > 1.0);
            let asked_casting = moment.casting;
            let moment = &moment.coarser(coarsening);
            let fronts = self.fronts(moment, false);
            let plan = match self.policy {
                Policy::Due | Policy::DueReceivers => {
                    let pace = eye.note(now, &moment.camera, self.statue_height);
                    let light = moment.casting.map(|casting| casting.light);
                    let height = self.statue_height;
                    let speed = light.map_or(0.0, |light| lamp.note(now, &light, height));
                    self.plan(moment, pace, speed)
                }
                _ => Plan::default(),
            };
            let later = match self.policy {
                Policy::Extrapolate => {
                    let later = extrapolated(moments, i, self.options.frames_per_sec);
                    let later = later.coarser(coarsening);
                    Some(self.fronts(&later, false))
                }
                _ => None,
            };
            self.note_drawn(&fronts);
            if self.policy == Policy::KeepNothing {
                self.drop_all_but(&fronts, moment);
            }
            report.kept_bytes_max = report.kept_bytes_max.max(self.kept_bytes);
            self.ask(now, &fronts, later.as_ref(), &plan);

            let tau = self.options.selection.error_threshold_px;
            let (ratio, worst) = coarseness(&fronts.receivers, tau);
            report.tau_ratio_mean += ratio / moments.len() as f64;
            if fronts.receivers.draws.is_empty() && !fronts.receivers.wanted.is_empty() {
                report.stalled_frames += 1;
            }
            let started = now > START_SECS;
            if started {
                report.frames_after_start += 1;
                report.frames_over_2tau += u32::from(worst > 2.0);
            }
            if let (Some(of), Some(casting), Some(front)) =
                (&mut report.casters, asked_casting, &fronts.casters)
            {
                let (_, worst) = coarseness(front, casting.threshold_px);
                of.missing_casters += front.wanted.len() as u64;
                of.frames_missing_casters += u32::from(started && !front.wanted.is_empty());
                of.frames_over_2tau += u32::from(started && worst > 2.0);
            }
        }
        report.bytes_read = self.bytes_read;
        report.bytes_drawn = self.bytes_drawn;
        Ok(report)
    }

    /// By how much a frame is coarser than asked, so that it fits into memory.
    fn coarsening(&mut self, moment: &Moment) -> f64 {
        let budget_bytes = self.options.cache_bytes;
        let mut fit = self.fit;
        let fits_at = |factor: f64| {
            let fronts = self.fronts(&moment.coarser(factor), true);
            let fronts: Vec<Front> =
                [Some(fronts.receivers), fronts.casters].into_iter().flatten().collect();
            fits(&self.skeleton, &fronts, budget_bytes)
        };
        let factor = match takes_what_it_needs(moment.selection) {
            true => fit.rest(),
            false => fit.least(&fits_at),
        };
        self.fit = fit;
        factor
    }

    fn view(&self, camera: &Camera) -> View {
        let (width, height) = self.options.size;
        View::new(camera, self.world_from_model, width, height)
    }

    /// What is drawn and what casts shadows on it; or what would, if everything were here.
    fn fronts(&self, moment: &Moment, complete: bool) -> Fronts {
        let is_resident = |node, r| complete || self.kept.contains_key(&(node, r));
        let view = self.view(&moment.camera);
        let receivers = select(&self.skeleton, &view, moment.selection, &is_resident);
        let casters = moment.casting.map(|casting| {
            let box_of = |draw: &Draw| {
                Receiver::of(&self.skeleton.nodes()[draw.node as usize], &self.world_from_model)
            };
            let boxes: Vec<_> = receivers.draws.iter().map(box_of).collect();
            let (camera, size) = (&moment.camera, self.options.size);
            let view = CasterView::new(&casting, camera, size, &boxes, self.world_from_model);
            select_casters(&self.skeleton, &view, &is_resident)
        });
        Fronts { receivers, casters }
    }

    /// What will be wanted soon, as the renderer finds it.
    fn plan(&self, moment: &Moment, pace: Pace, light_speed: f64) -> Plan {
        let view = self.view(&moment.camera);
        let room_bytes = self.options.cache_bytes / 10 * 9;
        let shown = Shown {
            skeleton: &self.skeleton,
            world_from_model: self.world_from_model,
            need: Need::new(&view, moment.selection, pace),
            budget: Budget { bytes: room_bytes, bytes_of: &page_bytes },
        };
        let (camera, size) = (&moment.camera, self.options.size);
        let outlook = |casting| Outlook { casting, camera, size, pace, light_speed };
        let ahead = self.policy == Policy::Due;
        let horizon = horizon_secs(1.0 / self.options.frames_per_sec);
        let outlook = moment.casting.filter(|_| ahead).map(outlook);
        plans(&[shown], outlook.as_ref(), horizon).pop().unwrap_or_default()
    }

    fn note_drawn(&mut self, fronts: &Fronts) {
        for draw in fronts.draws() {
            let page = (draw.node, draw.representation);
            let Some(kept) = self.kept.get_mut(&page) else { continue };
            kept.last_used = self.frame;
            if !std::mem::replace(&mut kept.was_drawn, true) {
                let of = &self.skeleton.nodes()[draw.node as usize];
                let bytes = of.representations[draw.representation].page.page_bytes;
                self.bytes_drawn += u64::from(bytes);
            }
        }
        for page in fronts.held() {
            if let Some(kept) = self.kept.get_mut(page) {
                kept.last_used = self.frame;
            }
        }
    }

    /// Keeps what is drawn, and what will be drawn from here when all of it has arrived.
    fn drop_all_but(&mut self, fronts: &Fronts, moment: &Moment) {
        let complete = self.fronts(moment, true);
        let draws = fronts.draws().chain(complete.draws());
        let needed: HashSet<Page> = draws.map(|draw| (draw.node, draw.representation)).collect();
        self.kept.retain(|page, _| page.0 == 0 || needed.contains(page));
        self.kept_bytes = self.kept.values().map(|kept| kept.bytes).sum();
    }

    /// Gives the link what is most urgent.
    fn ask(&mut self, now: f64, fronts: &Fronts, later: Option<&Fronts>, plan: &Plan) {
        self.due = due_times(plan);
        let mut wanted: Vec<&Wanted> = fronts.wanted().collect();
        for wanted in &wanted {
            if let (node, Some(r)) = parse_ticket(wanted.ticket) {
                self.due.insert((node, r), -1.0);
            }
        }
        let on_its_way: HashSet<Ticket> = self.coming.iter().map(|c| c.1).collect();
        let has = |ticket: Ticket| {
            let here = match parse_ticket(ticket) {
                (node, Some(r)) => {
                    self.kept.contains_key(&(node, r)) || self.waiting.contains(&(node, r))
                }
                (node, None) => {
                    let link = self.skeleton.nodes()[node as usize].children;
                    !matches!(link, ChildLink::Unloaded(_))
                }
            };
            here || on_its_way.contains(&ticket)
        };
        let due_of = |page| self.due.get(&page).copied().unwrap_or(f64::INFINITY);
        let allows = |page| self.refused.allows(page, due_of(page), self.frame);
        let mut list = requests(&mut wanted, plan, &self.skeleton, &has, &allows);
        if let Some(later) = later {
            let mut wanted: Vec<&Wanted> = later.wanted().collect();
            list.extend(requests(&mut wanted, &Plan::default(), &self.skeleton, &has, &allows));
        }
        for (ticket, part) in list {
            if self.coming.len() >= IN_FLIGHT_MAX || self.link_free_at > now + AHEAD_SECS {
                break;
            }
            if self.coming.iter().any(|c| c.1 == ticket) {
                continue;
            }
            let secs = part.file_bytes() as f64 / self.options.bytes_per_sec;
            self.link_free_at = self.link_free_at.max(now) + secs;
            self.coming.push((self.link_free_at + self.options.latency_secs, ticket, part));
        }
    }

    /// Takes what has arrived.
    fn receive(&mut self, now: f64) -> Result<(), FormatError> {
        let (arrived, coming) =
            std::mem::take(&mut self.coming).into_iter().partition(|c: &(f64, _, _)| c.0 <= now);
        self.coming = coming;
        let arrived: Vec<(f64, Ticket, Part)> = arrived;
        std::mem::take(&mut self.waiting).into_iter().for_each(|page| self.keep(page));
        for (_, ticket, part) in arrived {
            self.bytes_read += part.file_bytes();
            match (part, parse_ticket(ticket)) {
                (Part::Block(block), (node, _)) => {
                    let block = self.file.read_block(block)?;
                    self.skeleton.add_children(node, &block);
                }
                (Part::Page(..), (node, Some(r))) => self.keep((node, r)),
                (Part::Page(..), _) => {}
            }
        }
        Ok(())
    }

    /// Finds room for a page; what was read ahead and finds none is dropped.
    fn keep(&mut self, page: Page) {
        let bytes = page_bytes(&self.skeleton.nodes()[page.0 as usize], page.1);
        let for_secs = self.due.get(&page).copied().unwrap_or(-1.0);
        while self.kept_bytes + bytes > self.options.cache_bytes {
            let kept = self.kept.iter().map(|(page, kept)| (*page, kept.last_used));
            match victim(kept, self.frame, &self.due, for_secs) {
                Some(victim) => {
                    let kept = self.kept.remove(&victim);
                    self.kept_bytes -= kept.map_or(0, |kept| kept.bytes);
                }
                // There is always something to draw.
                None if page.0 == 0 => break,
                None if for_secs >= 0.0 => return self.refused.note(page, for_secs, self.frame),
                // What this frame draws may make room in the next.
                None => return self.waiting.push(page),
            }
        }
        self.kept_bytes += bytes;
        let kept = Kept { bytes, last_used: self.frame, was_drawn: false };
        self.refused.forget(page);
        if let Some(before) = self.kept.insert(page, kept) {
            self.kept_bytes -= before.bytes;
        }
    }
}

/// What a frame is of.
#[derive(Debug, Clone, Copy)]
struct Moment {
    camera: Camera,
    selection: Selection,
    casting: Option<Casting>,
}

impl Moment {
    fn coarser(&self, factor: f64) -> Moment {
        Moment {
            selection: self.selection.coarser(factor),
            casting: self.casting.map(|casting| casting.coarser(factor)),
            ..*self
        }
    }
}

/// What a frame draws.
struct Fronts {
    receivers: Front,
    casters: Option<Front>,
}

impl Fronts {
    fn draws(&self) -> impl Iterator<Item = &Draw> {
        let casters = self.casters.iter().flat_map(|front| &front.draws);
        self.receivers.draws.iter().chain(casters)
    }

    fn held(&self) -> impl Iterator<Item = &Page> {
        let casters = self.casters.iter().flat_map(|front| &front.held);
        self.receivers.held.iter().chain(casters)
    }

    fn wanted(&self) -> impl Iterator<Item = &Wanted> {
        let casters = self.casters.iter().flat_map(|front| &front.wanted);
        self.receivers.wanted.iter().chain(casters)
    }
}

/// Camera and light half a second later, if they go on as in the last tenth of a second.
fn extrapolated(moments: &[Moment], frame: usize, frames_per_sec: f64) -> Moment {
    let back = frame.min((0.1 * frames_per_sec).round().max(1.0) as usize);
    let (now, before) = (&moments[frame], &moments[frame - back]);
    let share = if back > 0 { 0.5 * frames_per_sec / back as f64 } else { 0.0 };
    let on = |now: DVec3, before: DVec3| now + (now - before) * share;
    let target = on(now.camera.target, before.camera.target);
    let eye = on(now.camera.eye, before.camera.eye);
    let camera = match eye.distance(target) > 0.0 {
        true => Camera { eye, target, ..now.camera },
        false => now.camera,
    };
    let casting = now.casting.zip(before.casting).map(|(now, before)| {
        let light = match (now.light, before.light) {
            (Light::Directional(now), Light::Directional(before)) => {
                Light::Directional(on(now, before))
            }
            (Light::Point(now), Light::Point(before)) => Light::Point(on(now, before)),
            (light, _) => light,
        };
        Casting { light, ..now }
    });
    Moment { camera, casting, ..*now }
}

/// Mean of max(1, ρ/τ) by size on screen, and the largest.
pub(crate) fn coarseness(front: &Front, tau: f64) -> (f64, f64) {
    let (mut sum, mut weight, mut worst) = (0.0, 0.0, 1.0f64);
    for draw in &front.draws {
        // What the eye is in covers any number of pixels; τ is in pixels of the picture.
        let ratio = if tau > 0.0 { (draw.error_px / tau).clamp(1.0, 1e3) } else { 1.0 };
        let area = draw.area_px.min(1e9);
        sum += ratio * area;
        weight += area;
        worst = worst.max(ratio);
    }
    (if weight > 0.0 { sum / weight } else { 1.0 }, worst)
}
