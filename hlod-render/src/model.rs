//! A file that is shown: its skeleton, what of it is resident, and what is on the way.

use std::collections::{HashMap, HashSet, VecDeque};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat4, DVec3};
use hlod_compress::{FormatError, Header, Metadata};

use crate::arena::{Arena, ArenaSize, Slot};
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::loader::{Completion, GpuMesh, Loaded, Loader, SourceLoader, model_origin};
use crate::model_file::ModelFile;
use crate::need::Plan;
use crate::residency::{DueTimes, Refused, due_times, requests, victim};
use crate::seams::{self, Beside, Drawn, Key, Seams};
use crate::select::{Front, Wanted, page_ticket, parse_ticket};
use crate::skeleton::{ChildLink, Skeleton};
use crate::source::Source;

/// Limits under which a model is shown.
#[derive(Debug, Clone, Copy)]
pub struct ModelLimits {
    /// Most bytes of geometry on the GPU, but for a first buffer of up to 9 MB. Where a frame asks for more it is drawn
    /// coarser; pictures that must be complete ([`crate::frame::Renderer::render_complete`]), and full resolution, take
    /// more.
    pub gpu_bytes: u64,
    /// Most bytes that the skeleton and what is kept of the file, as it was read, take in memory. Of the skeleton what
    /// was seen once stays: less than 1 KB a node, of which a statue of 1.25·10⁸ triangles has 38,637.
    pub host_bytes: u64,
    /// Most bytes copied to the GPU in one frame, so that none takes long.
    pub upload_bytes_per_frame: u64,
    /// Limit on reading, for measurements.
    pub read_bytes_per_sec: Option<f64>,
    /// Whether parts are loaded before they are wanted.
    pub prefetch: bool,
    /// Whether what servers send is kept on disk until next time.
    pub keep_on_disk: bool,
}

/// How much of the GPU's memory may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Room {
    /// [`ModelLimits::gpu_bytes`].
    Budget,
    /// More, where what must be drawn does not fit.
    AsNeeded,
}

/// After so many frames in which there was no room for it, a page is left out.
const TRIES_MAX: u32 = 4;

impl ModelLimits {
    /// What each of so many models may have, so that together they keep to these.
    pub fn shared_by(self, models: u64) -> ModelLimits {
        ModelLimits {
            gpu_bytes: self.gpu_bytes / models.max(1),
            host_bytes: self.host_bytes / models.max(1),
            ..self
        }
    }
}

impl Default for ModelLimits {
    /// 1 GiB on the GPU, 256 MiB in memory, 8 MiB a frame, reading ahead, as fast as the disk.
    fn default() -> Self {
        ModelLimits {
            gpu_bytes: 1 << 30,
            host_bytes: 256 << 20,
            upload_bytes_per_frame: 8 << 20,
            read_bytes_per_sec: None,
            prefetch: true,
            keep_on_disk: true,
        }
    }
}

/// One model of a scene.
pub struct Model {
    path: PathBuf,
    header: Header,
    source: Arc<Source>,
    skeleton: Skeleton,
    world_from_model: DMat4,
    limits: ModelLimits,
    loader: Box<dyn Loader>,
    arena_size: ArenaSize,
    arenas: Vec<Arena>,
    slots: HashMap<(u32, usize), Resident>,
    /// Decoded and not copied to the GPU yet.
    waiting: VecDeque<((u32, usize), GpuMesh)>,
    frame: u64,
    plan: Plan,
    /// When pages will be wanted.
    due: DueTimes,
    /// Of pages that were drawn at least once: bytes in the file.
    drawn_bytes: u64,
    /// Parts that turned out to be damaged: not asked for again.
    damaged: HashSet<u64>,
    problems: Vec<String>,
    /// Parts for which the GPU had no memory, until something makes room.
    unplaced: HashSet<u64>,
    /// For how many frames pages have been waiting for room.
    tries: HashMap<(u32, usize), u32>,
    /// What was read ahead in vain.
    refused: Refused,
    /// Why nothing comes at present.
    link_problem: Option<String>,
    bytes_read: u64,
}

struct Resident {
    slot: Slot,
    seams: Seams,
    last_used: u64,
    was_drawn: bool,
}

impl Model {
    /// Opens a file, or one on a web server by its address, and loads its root, so that there is always something to draw.
    ///
    /// # Errors
    /// When the file is not an `.hlod` file or its front part is damaged.
    pub fn open(gpu: &Gpu, path: &Path, limits: ModelLimits) -> Result<Model, RenderError> {
        Model::of_file(gpu, ModelFile::open(path, limits)?)
    }

    /// Shows a file that was opened before.
    ///
    /// # Errors
    /// When the GPU has no room for its root.
    pub fn of_file(gpu: &Gpu, file: ModelFile) -> Result<Model, RenderError> {
        let ModelFile { path, source, skeleton, root, limits, bytes_read } = file;
        let header = source.header().clone();
        let loader = SourceLoader::new(source.clone(), limits.read_bytes_per_sec);

        // Arenas are no larger than the whole model needs.
        let nodes = skeleton.nodes().iter();
        let known: (u64, u64) = nodes
            .flat_map(|n| &n.representations)
            .map(|r| (u64::from(r.vertices), u64::from(r.triangles), u64::from(r.points)))
            .fold((0, 0), |sum, (v, t, p)| (sum.0 + v + p, sum.1 + t + p));
        let (vertices, primitives) = if header.nodes as usize > skeleton.nodes().len() {
            (u64::MAX / 4, u64::MAX / 4)
        } else {
            known
        };
        let arena_size = ArenaSize::for_model(gpu, vertices, primitives, header.has_colours())
            .with_scalars(header.scalars().next().is_some())
            .within(limits.gpu_bytes);

        let mut model = Model {
            path,
            world_from_model: DMat4::from_translation(model_origin(&header.lattice)),
            header,
            source,
            skeleton,
            limits,
            loader: Box::new(loader),
            arena_size,
            arenas: Vec::new(),
            slots: HashMap::new(),
            waiting: VecDeque::new(),
            frame: 0,
            plan: Plan::default(),
            due: DueTimes::new(),
            drawn_bytes: 0,
            damaged: HashSet::new(),
            unplaced: HashSet::new(),
            tries: HashMap::new(),
            refused: Refused::default(),
            problems: Vec::new(),
            link_problem: None,
            bytes_read,
        };
        for (i, mesh) in root.iter().enumerate() {
            model.upload(gpu, (0, i), mesh, Room::AsNeeded)?;
        }
        Ok(model)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the file says about itself.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// What is known of the scan besides its shape; reads it, and waits for that.
    ///
    /// # Errors
    /// When it cannot be read or is damaged.
    pub fn metadata(&self) -> Result<Option<Metadata>, RenderError> {
        self.source.read_metadata().map_err(RenderError::format(&self.path))
    }

    /// The nodes known so far.
    pub fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    /// Model space → world space. World space is the source's coordinates.
    pub fn world_from_model(&self) -> DMat4 {
        self.world_from_model
    }

    /// Whether it was made from a point cloud.
    pub fn is_cloud(&self) -> bool {
        self.header.points_input > 0
    }

    /// Whether its surface encloses a volume, everywhere.
    pub fn is_closed(&self) -> bool {
        self.skeleton.nodes().first().is_some_and(|root| root.closed_oriented)
    }

    /// How far the leaves may be from the scan, world units: corners are rounded by √3/2 of a lattice step, and where cells cut
    /// triangles their lines by a whole one.
    pub(crate) fn leaf_rounding(&self) -> f64 {
        self.header.lattice.step
    }

    /// Bounds of all geometry in world space.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let place = |p| DVec3::from_array(self.header.lattice.position(p));
        (place(self.header.bounds[0]), place(self.header.bounds[1]))
    }

    /// What went wrong in the background, once each; the caller shows it.
    pub fn take_problems(&mut self) -> Vec<String> {
        std::mem::take(&mut self.problems)
    }

    /// Why nothing comes from the server at present; asking goes on.
    pub fn link_problem(&self) -> Option<&str> {
        self.link_problem.as_deref()
    }

    /// Bytes read from the file so far.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read
    }

    /// Of these, bytes of pages that were drawn since they were read.
    pub fn drawn_bytes(&self) -> u64 {
        self.drawn_bytes
    }

    /// Bytes of geometry that are resident on the GPU.
    pub fn resident_bytes(&self) -> u64 {
        self.slots.values().map(|r| r.slot.bytes()).sum()
    }

    /// Bytes of the GPU's buffers for it.
    pub fn reserved_bytes(&self) -> u64 {
        self.arenas.len() as u64 * self.arena_size.bytes()
    }

    /// Whether anything is being read or waits for its copy to the GPU.
    pub fn is_loading(&self) -> bool {
        self.loader.in_flight() > 0 || !self.waiting.is_empty()
    }

    /// Whether a node's representation can be drawn now.
    pub fn is_resident(&self, node: u32, representation: usize) -> bool {
        self.slots.contains_key(&(node, representation))
    }

    pub(crate) fn arenas(&self) -> &[Arena] {
        &self.arenas
    }

    pub(crate) fn arena_size(&self) -> ArenaSize {
        self.arena_size
    }

    pub(crate) fn slot(&self, node: u32, representation: usize) -> Option<&Slot> {
        self.slots.get(&(node, representation)).map(|r| &r.slot)
    }

    /// Identities of the points that are resident, in order, where this is the first model.
    pub fn point_identities(&self) -> Vec<std::ops::Range<u32>> {
        let of = |resident: &Resident| {
            let first = resident.slot.arena as u32 * self.arena_size.triangles + 1;
            let points = resident.slot.points();
            first + points.start..first + points.end
        };
        let mut all: Vec<_> = self.slots.values().map(of).filter(|r| !r.is_empty()).collect();
        all.sort_unstable_by_key(|range| range.start);
        all
    }

    /// Identities of the primitives that are resident, in order, and the node that they are of, where this is the first
    /// model.
    pub(crate) fn node_identities(&self) -> Vec<(std::ops::Range<u32>, u32)> {
        let of = |(&(node, _), resident): (&(u32, usize), &Resident)| {
            let first = resident.slot.arena as u32 * self.arena_size.triangles + 1;
            let primitives = &resident.slot.primitives;
            (first + primitives.start..first + primitives.end, node)
        };
        let mut all: Vec<_> = self.slots.iter().map(of).collect();
        all.sort_unstable_by_key(|(range, _)| range.start);
        all
    }

    /// Takes what was loaded since the last frame: blocks at once, geometry as far as this
    /// frame's share allows.
    ///
    /// # Errors
    /// When the GPU has no memory for what must be drawn.
    pub(crate) fn receive(&mut self, gpu: &Gpu, room: Room) -> Result<(), RenderError> {
        self.take_completions();
        self.upload_waiting(gpu, self.limits.upload_bytes_per_frame, room)
    }

    /// The same for pictures that must come out the same every time: geometry is copied when all that was
    /// asked for is here, in the file's order, so that it does not matter what came first.
    ///
    /// # Errors
    /// When the GPU has no memory for what must be drawn.
    pub(crate) fn receive_in_order(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        self.take_completions();
        if self.loader.in_flight() > 0 {
            return Ok(());
        }
        let nodes = self.skeleton.nodes();
        let place = |(node, r): (u32, usize)| nodes[node as usize].representations[r].page.offset;
        self.waiting.make_contiguous().sort_by_key(|(key, _)| place(*key));
        self.upload_waiting(gpu, u64::MAX, Room::AsNeeded)
    }

    fn take_completions(&mut self) {
        self.frame += 1;
        let mut skeleton_grew = false;
        for Completion { ticket, result, bytes_read } in self.loader.poll() {
            self.bytes_read += bytes_read;
            let (node, representation) = parse_ticket(ticket);
            if bytes_read > 0 {
                self.link_problem = None;
            }
            match (result, representation) {
                (Ok(Loaded::Block(block)), None) => {
                    self.skeleton.add_children(node, &block);
                    skeleton_grew = true;
                }
                (Ok(Loaded::Mesh(mesh)), Some(r)) => self.waiting.push_back(((node, r), *mesh)),
                (Ok(_), _) => {}
                (Err(FormatError::Io(error)), _) if error.kind() == ErrorKind::NotConnected => {
                    // It is asked for again as long as it is wanted.
                    if self.link_problem.is_none() {
                        self.problems.push(format!("{}: {error}", self.path.display()));
                    }
                    self.link_problem = Some(error.to_string());
                }
                (Err(error), _) => {
                    // Its ancestor is drawn in its place from now on.
                    if self.damaged.insert(ticket) {
                        self.problems.push(format!("{}: {error}", self.path.display()));
                    }
                }
            }
        }
        if skeleton_grew {
            // It stays, so that less is kept of what was read.
            self.source.reserve(self.skeleton.bytes());
        }
    }

    fn upload_waiting(
        &mut self,
        gpu: &Gpu,
        most_bytes: u64,
        room: Room,
    ) -> Result<(), RenderError> {
        let mut copied = 0;
        let mut again = Vec::new();
        while copied < most_bytes {
            let Some((key, mesh)) = self.waiting.pop_front() else { break };
            copied += (mesh.vertices.len() * 16 + mesh.indices.len() * 4) as u64;
            if self.slots.contains_key(&key) || self.upload(gpu, key, &mesh, room)? {
                self.tries.remove(&key);
                continue;
            }
            // What the last frame drew and this one does not makes room in the next.
            let tries = self.tries.entry(key).or_default();
            *tries += 1;
            if *tries < TRIES_MAX {
                again.push((key, mesh));
            } else {
                self.tries.remove(&key);
                self.unplaced.insert(page_ticket(key.0, key.1));
            }
        }
        self.waiting.extend(again);
        Ok(())
    }

    /// Whether anything is to be loaded before it is wanted.
    pub(crate) fn reads_ahead(&self) -> bool {
        self.limits.prefetch
    }

    /// As it was opened, less what the GPU has no memory for.
    pub(crate) fn limits(&self) -> &ModelLimits {
        &self.limits
    }

    /// Bytes that may be planned for: some room is lost between pages.
    pub(crate) fn room_bytes(&self) -> u64 {
        self.limits.gpu_bytes / 10 * 9
    }

    /// What will be wanted soon: it is asked for and kept from now on.
    pub(crate) fn expect(&mut self, plan: Plan) {
        self.plan = plan;
    }

    /// Asks for what fronts lack, and notes what they use.
    pub fn request(&mut self, fronts: &[Option<&Front>]) {
        let fronts: Vec<&Front> = fronts.iter().copied().flatten().collect();
        for draw in fronts.iter().flat_map(|front| &front.draws) {
            let key = (draw.node, draw.representation);
            if let Some(resident) = self.slots.get_mut(&key) {
                resident.last_used = self.frame;
                if !std::mem::replace(&mut resident.was_drawn, true) {
                    let node = &self.skeleton.nodes()[draw.node as usize];
                    let page = node.representations[draw.representation].page;
                    self.drawn_bytes += u64::from(page.page_bytes);
                }
            }
        }
        for key in fronts.iter().flat_map(|front| &front.held) {
            if let Some(resident) = self.slots.get_mut(key) {
                resident.last_used = self.frame;
            }
        }
        let waiting: HashSet<u64> =
            self.waiting.iter().map(|((node, r), _)| page_ticket(*node, *r)).collect();
        let mut wanted: Vec<&Wanted> = fronts.iter().flat_map(|front| &front.wanted).collect();
        // What is wanted now may be anywhere in the plan, and must not make room for what is not.
        self.due = due_times(&self.plan);
        for wanted in &wanted {
            if let (node, Some(r)) = parse_ticket(wanted.ticket) {
                self.due.insert((node, r), -1.0);
            }
        }
        let has = |ticket: u64| {
            let resident = match parse_ticket(ticket) {
                (node, Some(r)) => self.slots.contains_key(&(node, r)),
                (node, None) => {
                    let link = self.skeleton.nodes()[node as usize].children;
                    !matches!(link, ChildLink::Unloaded(_))
                }
            };
            let is_hopeless = self.damaged.contains(&ticket) || self.unplaced.contains(&ticket);
            resident || waiting.contains(&ticket) || is_hopeless
        };
        let due_of = |page| self.due.get(&page).copied().unwrap_or(f64::INFINITY);
        let allows = |page| self.refused.allows(page, due_of(page), self.frame);
        self.loader.submit(requests(&mut wanted, &self.plan, &self.skeleton, &has, &allows));
    }

    /// Makes strips as long as the seams between these nodes ask for.
    pub(crate) fn close_seams(&mut self, gpu: &Gpu, front: &Front, drawn: Drawn) {
        let all_beside = seams::beside(&front.draws, &self.skeleton);
        let keys = front.draws.iter().map(|draw| (draw.node, draw.representation));
        let mut changed: Vec<(Key, &[Beside])> =
            keys.zip(all_beside.iter().map(Vec::as_slice)).collect();
        let slots = &self.slots;
        let seams_of = |key: Key| slots.get(&key).map(|resident| &resident.seams);
        changed.retain(|(key, beside)| seams_of(*key).is_some_and(|s| !s.closes(beside, drawn)));
        if changed.is_empty() {
            return;
        }
        let pairs = changed.iter().copied();
        let lattice = &self.header.lattice;
        for (key, slit) in seams::measure(pairs, &self.skeleton, lattice, &seams_of) {
            if let Some(resident) = self.slots.get_mut(&key) {
                resident.seams.learn(slit);
            }
        }
        for (key, beside) in changed {
            let Some(Resident { slot, seams, .. }) = self.slots.get_mut(&key) else { continue };
            if let Some(corners) = seams.close(beside, drawn) {
                self.arenas[slot.arena].write_corners(gpu, slot, corners);
            }
        }
    }

    /// Whether there is memory for another buffer.
    pub(crate) fn may_grow(&self) -> bool {
        (self.arenas.len() as u64 + 1) * self.arena_size.bytes() <= self.limits.gpu_bytes
    }

    /// Finds room for a mesh: in an arena, in a new one within the budget, or where something is that
    /// will be wanted later. What was read ahead and finds no room is dropped; false where that was wanted now.
    fn upload(
        &mut self,
        gpu: &Gpu,
        key: (u32, usize),
        mesh: &GpuMesh,
        room: Room,
    ) -> Result<bool, RenderError> {
        let for_secs = self.due.get(&key).copied().unwrap_or(-1.0);
        loop {
            for (i, arena) in self.arenas.iter_mut().enumerate() {
                if let Some(slot) = arena.insert(gpu, mesh, i) {
                    let corners = &mesh.vertices[mesh.corners.clone()];
                    let r = &self.skeleton.nodes()[key.0 as usize].representations[key.1];
                    let border = r.border_error / self.header.lattice.step;
                    let seams = Seams::new(mesh.lines.clone(), corners, border);
                    let resident =
                        Resident { slot, seams, last_used: self.frame, was_drawn: false };
                    self.slots.insert(key, resident);
                    self.refused.forget(key);
                    return Ok(true);
                }
            }
            if !self.arenas.is_empty() && !self.may_grow() {
                if self.evict_for(for_secs) {
                    continue;
                }
                if for_secs >= 0.0 {
                    self.refused.note(key, for_secs, self.frame);
                    return Ok(true);
                }
                if room == Room::Budget {
                    return Ok(false);
                }
            }
            let fits = mesh.vertices.len() as u32 <= self.arena_size.vertices
                && (mesh.indices.len() / 3 + mesh.radii.len()) as u32 <= self.arena_size.triangles;
            if !fits {
                return Err(gpu.error(format!("node {} is larger than a buffer may be", key.0)));
            }
            match Arena::new(gpu, self.arena_size) {
                Some(arena) => self.arenas.push(arena),
                // Smaller, but all of one size: identities are counted by it.
                None if self.arenas.is_empty() => {
                    let smaller = self.arena_size.halved();
                    self.arena_size = smaller.ok_or_else(|| gpu.error("it has no memory left"))?;
                }
                None => {
                    self.make_do();
                    if !self.evict_for(for_secs) {
                        self.unplaced.insert(page_ticket(key.0, key.1));
                        return Ok(true);
                    }
                }
            }
        }
    }

    /// The GPU has no more memory: the budget is what there is, which is said once.
    fn make_do(&mut self) {
        let bytes = self.arenas.len() as u64 * self.arena_size.bytes();
        if bytes < self.limits.gpu_bytes {
            self.problems.push(format!(
                "{}: the GPU has memory for {} MiB of it only: parts are drawn coarser",
                self.path.display(),
                bytes >> 20
            ));
            self.limits.gpu_bytes = bytes;
        }
    }

    /// False where nothing makes room for what is wanted in so many seconds.
    fn evict_for(&mut self, for_secs: f64) -> bool {
        let resident = self.slots.iter().map(|(key, r)| (*key, r.last_used));
        let victim = victim(resident, self.frame, &self.due, for_secs);
        let Some(resident) = victim.and_then(|key| self.slots.remove(&key)) else { return false };
        let arena = resident.slot.arena;
        self.arenas[arena].remove(resident.slot);
        self.unplaced.clear();
        true
    }

    /// Whether the whole skeleton is loaded (tests and tools).
    pub fn skeleton_is_complete(&self) -> bool {
        self.skeleton.nodes().iter().all(|n| !matches!(n.children, ChildLink::Unloaded(_)))
    }
}
