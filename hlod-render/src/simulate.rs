//! What a policy of loading would have shown along a camera path: no GPU, and a link of known
//! bandwidth and latency instead of a disk.
//!
//! The front ([`crate::select`]), what will be wanted ([`crate::need`]) and what is asked for and makes
//! room ([`crate::residency`]) are those that draw pictures. Time passes in frames, decoding and
//! copying take none.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::DMat4;
use hlod_compress::{FormatError, HlodFile};
use serde::Serialize;

use crate::arena::ArenaSize;
use crate::camera::Camera;
use crate::error::RenderError;
use crate::framing::Framing;
use crate::loader::{Part, Ticket, model_origin};
use crate::need::{Need, PaceTracker, Plan};
use crate::path::CameraPath;
use crate::residency::{DueTimes, HORIZON_SECS, Page, due_times, requests, victim};
use crate::select::{Front, Selection, View, Wanted, parse_ticket, select};
use crate::skeleton::{ChildLink, Node, Skeleton};
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
}

impl Policy {
    /// All of them.
    pub const ALL: [Policy; 4] =
        [Policy::KeepNothing, Policy::Lru, Policy::Extrapolate, Policy::Due];

    /// For tables.
    pub fn name(self) -> &'static str {
        match self {
            Policy::KeepNothing => "keep nothing",
            Policy::Lru => "least recently used",
            Policy::Extrapolate => "extrapolated view",
            Policy::Due => "earliest due (as drawn)",
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
    /// Read over the link, skeleton included.
    pub bytes_read: u64,
    /// Of pages that were drawn after they were read.
    pub bytes_drawn: u64,
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
    let cameras: Vec<Camera> = (0..frames)
        .map(|i| placed.camera_at((f64::from(i) / options.frames_per_sec).min(path.duration_secs)))
        .collect();
    let height = (framing.bounds.1 - framing.bounds.0).length();
    let mut policies = Vec::new();
    for policy in Policy::ALL {
        let run = Run::new(&opened, options, policy, height).and_then(|run| run.follow(&cameras));
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
    /// What is on its way, and when it arrives.
    coming: Vec<(f64, Ticket, Part)>,
    link_free_at: f64,
    due: DueTimes,
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
            coming: Vec::new(),
            link_free_at: 0.0,
            due: DueTimes::new(),
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

    fn follow(mut self, cameras: &[Camera]) -> Result<PolicyReport, FormatError> {
        const START_SECS: f64 = 2.0;
        let mut tracker = PaceTracker::default();
        let mut report = PolicyReport {
            policy: self.policy,
            frames: cameras.len() as u32,
            stalled_frames: 0,
            tau_ratio_mean: 0.0,
            frames_over_2tau: 0,
            frames_after_start: 0,
            bytes_read: 0,
            bytes_drawn: 0,
        };
        for (i, camera) in cameras.iter().enumerate() {
            let now = i as f64 / self.options.frames_per_sec;
            self.frame += 1;
            self.receive(now)?;
            let view = self.view(camera);
            let front = self.front(&view);
            let plan = match self.policy {
                Policy::Due => {
                    let pace = tracker.note(now, camera, self.statue_height);
                    let need = Need::new(&view, self.options.selection, pace);
                    let bytes = self.options.cache_bytes / 10 * 9;
                    need.plan(&self.skeleton, HORIZON_SECS, bytes, &page_bytes)
                }
                _ => Plan::default(),
            };
            let later = match self.policy {
                Policy::Extrapolate => Some(self.front(&self.view(&extrapolated(
                    cameras,
                    i,
                    self.options.frames_per_sec,
                )))),
                _ => None,
            };
            self.note_drawn(&front);
            if self.policy == Policy::KeepNothing {
                self.drop_all_but(&front, &view);
            }
            self.ask(now, &front, later.as_ref(), &plan);

            let (ratio, worst) = coarseness(&front, self.options.selection.error_threshold_px);
            report.tau_ratio_mean += ratio / cameras.len() as f64;
            if front.draws.is_empty() && !front.wanted.is_empty() {
                report.stalled_frames += 1;
            }
            if now > START_SECS {
                report.frames_after_start += 1;
                report.frames_over_2tau += u32::from(worst > 2.0);
            }
        }
        report.bytes_read = self.bytes_read;
        report.bytes_drawn = self.bytes_drawn;
        Ok(report)
    }

    fn view(&self, camera: &Camera) -> View {
        let (width, height) = self.options.size;
        View::new(camera, self.world_from_model, width, height)
    }

    fn front(&self, view: &View) -> Front {
        let is_resident = |node, r| self.kept.contains_key(&(node, r));
        select(&self.skeleton, view, self.options.selection, &is_resident)
    }

    fn note_drawn(&mut self, front: &Front) {
        for draw in &front.draws {
            let page = (draw.node, draw.representation);
            let Some(kept) = self.kept.get_mut(&page) else { continue };
            kept.last_used = self.frame;
            if !std::mem::replace(&mut kept.was_drawn, true) {
                let of = &self.skeleton.nodes()[draw.node as usize];
                let bytes = of.representations[draw.representation].page.page_bytes;
                self.bytes_drawn += u64::from(bytes);
            }
        }
    }

    /// Keeps what is drawn, and what will be drawn from here when all of it has arrived.
    fn drop_all_but(&mut self, front: &Front, view: &View) {
        let complete = select(&self.skeleton, view, self.options.selection, &|_, _| true);
        let draws = front.draws.iter().chain(&complete.draws);
        let needed: HashSet<Page> = draws.map(|draw| (draw.node, draw.representation)).collect();
        self.kept.retain(|page, _| page.0 == 0 || needed.contains(page));
        self.kept_bytes = self.kept.values().map(|kept| kept.bytes).sum();
    }

    /// Gives the link what is most urgent.
    fn ask(&mut self, now: f64, front: &Front, later: Option<&Front>, plan: &Plan) {
        self.due = due_times(plan);
        let mut wanted: Vec<&Wanted> = front.wanted.iter().collect();
        for wanted in &wanted {
            if let (node, Some(r)) = parse_ticket(wanted.ticket) {
                self.due.insert((node, r), -1.0);
            }
        }
        let on_its_way: HashSet<Ticket> = self.coming.iter().map(|c| c.1).collect();
        let has = |ticket: Ticket| {
            let here = match parse_ticket(ticket) {
                (node, Some(r)) => self.kept.contains_key(&(node, r)),
                (node, None) => {
                    let link = self.skeleton.nodes()[node as usize].children;
                    !matches!(link, ChildLink::Unloaded(_))
                }
            };
            here || on_its_way.contains(&ticket)
        };
        let mut list = requests(&mut wanted, plan, &self.skeleton, &has);
        if let Some(later) = later {
            let mut wanted: Vec<&Wanted> = later.wanted.iter().collect();
            list.extend(requests(&mut wanted, &Plan::default(), &self.skeleton, &has));
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
                None if for_secs >= 0.0 => return,
                // What is drawn has to be there.
                None => break,
            }
        }
        self.kept_bytes += bytes;
        let kept = Kept { bytes, last_used: self.frame, was_drawn: false };
        if let Some(before) = self.kept.insert(page, kept) {
            self.kept_bytes -= before.bytes;
        }
    }
}

fn page_bytes(node: &Node, representation: usize) -> u64 {
    let r = &node.representations[representation];
    ArenaSize::bytes_of(r.vertices.into(), r.triangles.into(), r.points.into())
}

/// The camera half a second later, if eye and target go on as in the last tenth of a second.
fn extrapolated(cameras: &[Camera], frame: usize, frames_per_sec: f64) -> Camera {
    let back = frame.min((0.1 * frames_per_sec).round().max(1.0) as usize);
    let (now, before) = (&cameras[frame], &cameras[frame - back]);
    let share = if back > 0 { 0.5 * frames_per_sec / back as f64 } else { 0.0 };
    let target = now.target + (now.target - before.target) * share;
    let eye = now.eye + (now.eye - before.eye) * share;
    if eye.distance(target) > 0.0 { Camera { eye, target, ..*now } } else { *now }
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
