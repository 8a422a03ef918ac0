//! What is shown and how, without the window: the model, where the viewer stands, what was set.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::{DVec2, DVec3};

use super::bindings::Action;
use super::depth::DepthReader;
use super::gui::Scene;
use super::light::{PRESETS, Raking};
use super::navigation::{Drag, Navigation};
use super::other::Other;
use super::pace::{FrameClock, Motion, TauController};
use super::panel::{Raised, Readings};
use super::recording::{Recording, save_new};
use super::settings::Settings;
use super::work::{Change, Work, desk::Wishes};
use crate::error::RenderError;
use crate::frame::{FrameStats, Renderer};
use crate::framing::Framing;
use crate::gpu::Gpu;
use crate::lamp::Lamp;
use crate::model::{Model, ModelLimits};
use crate::passes::check_shadows;
use crate::scene::{Painted, Representation, Shadow, Shot};
use crate::session::{LightFrame, Session, Viewpoint};

/// More problems than anyone reads.
const PROBLEMS_MAX: usize = 100;
/// A point that was under the cursor still is, if it is seen within so many pixels.
const SAME_PLACE_PX: f64 = 4.0;

/// What does not lie on a GPU, and so survives one.
pub struct Kept {
    /// The `.hlod` file.
    pub file: PathBuf,
    /// Where the viewer stands.
    pub navigation: Navigation,
    /// What was set.
    pub settings: Settings,
    /// What is measured, cut and noted.
    pub work: Work,
}

/// One statue in one window.
pub struct Stage {
    models: [Model; 1],
    renderer: Renderer,
    /// What is measured, cut and noted.
    pub work: Work,
    /// A second statue, if there is one.
    pub other: Option<Other>,
    /// Where the viewer stands.
    pub navigation: Navigation,
    /// What was set.
    pub settings: Settings,
    /// When something moved last.
    pub motion: Motion,
    /// Whether the window should be closed.
    pub quit: bool,
    /// Whether another file is to be chosen.
    pub open_wanted: bool,
    tau: TauController,
    clock: FrameClock,
    /// The depth of the last picture at rest.
    pub depth: DepthReader,
    /// A drag began before the depth under the cursor was known: the pixel to ask for.
    anchor_wanted: Option<DVec2>,
    /// The last point that was known to be under the cursor, and where the cursor was.
    anchor_known: Option<(DVec2, DVec3)>,
    recording: Option<Recording>,
    recorded: Option<String>,
    drawn: Option<(Shot, DVec2)>,
    stats: FrameStats,
    problems: Vec<String>,
    advanced: Option<Instant>,
    /// Whether the session's axes were taken over once, so that others are news.
    follows_framing: bool,
}

impl Stage {
    /// Shows a model in pictures of a format that encodes linear light.
    pub fn new(
        gpu: &Gpu,
        output: wgpu::TextureFormat,
        model: Model,
        navigation: Navigation,
        settings: Settings,
        work: Work,
    ) -> Stage {
        Stage {
            models: [model],
            renderer: Renderer::new(gpu, output),
            work,
            other: None,
            navigation,
            settings,
            motion: Motion::default(),
            quit: false,
            open_wanted: false,
            tau: TauController::default(),
            clock: FrameClock::default(),
            depth: DepthReader::default(),
            anchor_wanted: None,
            anchor_known: None,
            recording: None,
            recorded: None,
            drawn: None,
            stats: FrameStats::default(),
            problems: Vec::new(),
            advanced: None,
            follows_framing: false,
        }
    }

    /// What of it can be shown again on another GPU; a second statue cannot.
    pub fn keep(self) -> Kept {
        let file = self.models[0].path().to_owned();
        Kept { file, navigation: self.navigation, settings: self.settings, work: self.work }
    }

    /// Lets time pass until `now`.
    pub fn advance(&mut self, now: Instant) {
        self.work.advance(now);
        self.follow_framing(now);
        if let Some(hit) = self.work.take_rake() {
            self.settings.raking = Some(Raking::new(hit.normal, &self.navigation.camera()));
            self.aim_raking(now);
        }
        self.problems.extend(self.work.take_problems());
        self.problems.truncate(PROBLEMS_MAX);
        if self.navigation.is_moving() {
            // After a pause, the first step is that of a usual frame.
            let secs =
                self.advanced.map_or(0.016, |t| now.saturating_duration_since(t).as_secs_f64());
            self.navigation.advance(secs.min(0.25));
            self.motion.note(now);
            self.advanced = Some(now);
        } else {
            self.advanced = None;
        }
        let (eye, target) = self.navigation.viewpoint();
        if let Some(recording) = &mut self.recording {
            recording.sample(now, &Framing::of(&self.models[0]), eye, target);
        }
    }

    /// Draws the statue if it looks different from the last time or parts of it have been on
    /// their way. Returns whether it did.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn draw(&mut self, gpu: &Gpu, scene: &Scene, now: Instant) -> Result<bool, RenderError> {
        self.take_depth();
        let moving = self.motion.is_moving(now);
        let lens = self.navigation.lens();
        if self.settings.shadow != Shadow::None {
            // A window may be larger than the adapter has room for: the statue stays.
            if let Err(problem) = check_shadows(gpu, &scene.targets) {
                self.settings.shadow = Shadow::None;
                self.problems.insert(0, format!("no shadows: {problem}"));
            }
        }
        let shot =
            self.settings.shot(lens.camera, self.navigation.framing(), self.tau.factor(moving));
        let shot = shot.cut_open(self.work.session().clip_planes());
        let same = self.drawn == Some((shot, lens.size));
        let draw = !same || self.models.iter().any(Model::is_loading);
        if draw {
            self.stats = self.renderer.render(gpu, &mut self.models, &shot, &scene.targets)?;
            self.drawn = Some((shot, lens.size));
            self.problems.extend(self.models[0].take_problems());
            self.problems.truncate(PROBLEMS_MAX);
        }
        let mut drew = draw;
        if let Some(other) = &mut self.other {
            drew |= other.draw(gpu, &shot, lens.size)?;
            self.problems.extend(other.take_problems());
            self.problems.truncate(PROBLEMS_MAX);
        }
        // Ask for the depth where the next gesture may begin, or one waits for it.
        let wanted = !moving || self.anchor_wanted.is_some() || self.navigation.is_flying();
        if wanted && (!self.depth.covers(&lens) || (draw && !moving)) {
            self.depth.copy(gpu, &scene.targets, lens);
        }
        Ok(drew)
    }

    /// The statue stands as the session says.
    fn follow_framing(&mut self, now: Instant) {
        let framing = self.work.framing();
        let is_first = !std::mem::replace(&mut self.follows_framing, true);
        if framing == *self.navigation.framing() {
            return;
        }
        let has_turned = framing.axes != self.navigation.framing().axes;
        self.navigation.set_framing(framing);
        match (has_turned, is_first) {
            (true, true) => self.navigation.home(),
            // What someone says of its axes is seen best from its front.
            (true, false) => self.navigation.named_view(0),
            (false, _) => {}
        }
        self.motion.note(now);
    }

    /// A frame has been finished that drew the statue.
    pub fn frame_finished(&mut self, now: Instant, frame_ms: f64, moving: bool) {
        self.clock.frame(now, frame_ms, moving);
        if moving {
            self.tau.moved(frame_ms, self.settings.frame_target_ms);
        }
    }

    /// Whether parts are on their way.
    pub fn is_loading(&self) -> bool {
        self.models.iter().any(Model::is_loading)
            || self.other.as_ref().is_some_and(Other::is_loading)
    }

    /// When the next key of a recording is due.
    pub fn recording_due(&self) -> Option<Instant> {
        self.recording.as_ref().and_then(Recording::due)
    }

    /// The surface's point under a pixel of the picture, where it is known without waiting.
    pub fn point_under(&mut self, pixel: DVec2) -> Option<DVec3> {
        self.take_depth();
        let lens = self.navigation.lens();
        if let Some(picture) = self.depth.latest().filter(|picture| picture.lens == lens) {
            let point = picture.depth_at(pixel).map(|depth| lens.point_at(pixel, depth));
            self.anchor_known = point.map(|point| (pixel, point));
            return point;
        }
        // Still the point of a moment ago, as in a row of zooms?
        let (_, point) = self.anchor_known.filter(|(at, _)| at.distance(pixel) < SAME_PLACE_PX)?;
        let seen = lens.pixel_of(point)?;
        (seen.distance(pixel) < SAME_PLACE_PX).then_some(point)
    }

    /// Begins a drag at a pixel.
    pub fn begin_drag(&mut self, drag: Drag, pixel: DVec2, now: Instant) {
        let anchor = self.point_under(pixel);
        let unknown = anchor.is_none() && drag != Drag::Look;
        let stale = self.depth.latest().is_none_or(|p| p.lens != self.navigation.lens());
        self.anchor_wanted = (unknown && stale).then_some(pixel);
        self.navigation.begin(drag, pixel, anchor);
        self.motion.note(now);
    }

    /// The cursor was dragged to a pixel.
    pub fn drag_to(&mut self, pixel: DVec2, now: Instant) {
        if self.navigation.drag() == Some(Drag::Pan) && self.anchor_wanted.is_some() {
            self.anchor_wanted = Some(pixel);
        }
        self.navigation.drag_to(pixel);
        self.motion.note(now);
    }

    /// The drag is over.
    pub fn end_drag(&mut self) {
        self.anchor_wanted = None;
        self.navigation.end();
    }

    /// Approaches what is under a pixel by notches.
    pub fn zoom(&mut self, pixel: DVec2, steps: f64, now: Instant) {
        let anchor = self.point_under(pixel);
        self.navigation.zoom(pixel, anchor, steps);
        self.motion.note(now);
    }

    /// Brings what is under a pixel to the middle.
    pub fn centre(&mut self, pixel: DVec2, now: Instant) {
        if let Some(point) = self.point_under(pixel) {
            self.navigation.centre(point);
            self.motion.note(now);
        }
    }

    /// Does what a key or a button asks for.
    pub fn act(&mut self, action: Action, now: Instant) {
        let middle = self.navigation.lens().size / 2.0;
        match action {
            Action::Fit => self.navigation.fit(),
            Action::Home => self.navigation.home(),
            Action::NamedView(number) => self.navigation.named_view(number),
            Action::ToggleParallel => self.navigation.toggle_parallel(),
            Action::ToggleFlying => self.navigation.toggle_flying(),
            Action::ToggleRecording => self.toggle_recording(now),
            Action::LightPreset(number) => {
                if let Some((_, light)) = PRESETS.get(number) {
                    self.settings.light = Lamp {
                        distance: self.settings.light.distance,
                        spot_deg: self.settings.light.spot_deg,
                        ..Lamp::of_picture(*light)
                    };
                    self.settings.raking = None;
                }
            }
            Action::ToggleShadows => {
                let shadow = &mut self.settings.shadow;
                *shadow = if *shadow == Shadow::None { Shadow::Hard } else { Shadow::None };
            }
            Action::Turn(right, up) => self.navigation.turn(right.into(), up.into()),
            Action::Zoom(steps) => self.zoom(middle, steps.into(), now),
            Action::Rake => self.rake(middle),
            Action::SweepLight(steps) => {
                self.settings.raking = self.settings.raking.map(|r| r.swept(steps.into()));
                self.aim_raking(now);
            }
            Action::Tool(task) => self.work.take_tool(task),
            Action::FinishTool => self.work.finish_tool(),
            Action::TakeBack => {
                if let Some(tool) = &mut self.work.tool {
                    tool.points.pop();
                }
            }
            Action::PickMiddle => {
                self.pick(middle);
            }
            Action::SaveView => {
                let viewpoint = Viewpoint::new(&self.navigation.camera());
                self.work.save_view(viewpoint);
            }
            Action::Undo | Action::Redo => {
                if self.work.step(action == Action::Redo) {
                    self.settings.set_looks(&self.work.session().looks);
                    self.motion.note(now);
                }
            }
            Action::TogglePanel => self.settings.panel_open = !self.settings.panel_open,
            Action::ToggleHelp => self.settings.help_open = !self.settings.help_open,
            Action::Leave => {
                if self.settings.help_open {
                    self.settings.help_open = false;
                } else if self.work.tool.take().is_some() {
                } else if self.navigation.is_flying() {
                    self.navigation.toggle_flying();
                }
            }
            Action::DismissProblem => {
                if !self.problems.is_empty() {
                    self.problems.remove(0);
                }
            }
            Action::Open => self.open_wanted = true,
            Action::Quit => self.quit = true,
        }
        if matches!(action, Action::Turn(..)) || self.navigation.is_moving() {
            self.motion.note(now);
        }
    }

    /// Does what was asked for in the panel, and keeps what was set there.
    pub fn fulfil(&mut self, wishes: Wishes, now: Instant) {
        if let Some(view) = wishes.go_to.and_then(|i| self.work.session().views.get(i).cloned()) {
            self.navigation.go_to(&view.viewpoint);
            self.settings.set_looks(&view.looks);
            self.motion.note(now);
        }
        if let Some(plane) = wishes.section {
            self.work.add_section(plane);
        }
        if wishes.draw_sections {
            self.work.draw_sections();
        }
        for change in wishes.changes {
            self.work.change(change, now);
        }
        for action in wishes.actions {
            self.act(action, now);
        }
        if let Some(frame) = wishes.light_frame {
            let (camera, framing) = (self.navigation.camera(), self.navigation.framing());
            self.settings.light = self.settings.light.relative_to(frame, &camera, framing);
            self.settings.raking = None;
        }
        if wishes.raking_changed {
            self.aim_raking(now);
        }
        let looks = self.settings.looks();
        if looks != self.work.session().looks {
            let edit = Box::new(move |session: &mut Session| session.looks = looks);
            self.work.change(Change { what: "light and looks", gradual: true, edit }, now);
        }
    }

    /// Asks which way the surface faces at a pixel, for a light that rakes it.
    pub fn rake(&mut self, pixel: DVec2) {
        self.work.ask_rake(self.navigation.lens(), pixel);
    }

    /// Turns the light by a drag of so many shares of the picture's smaller side.
    pub fn drag_light(&mut self, right: f64, down: f64, now: Instant) {
        let (camera, framing) = (self.navigation.camera(), self.navigation.framing());
        self.settings.light = self.settings.light.dragged(right, down, &camera, framing);
        self.settings.raking = None;
        self.motion.note(now);
    }

    /// The light is where the raking one should be. It stays there when the viewer turns.
    fn aim_raking(&mut self, now: Instant) {
        let Some(raking) = self.settings.raking else { return };
        let (camera, framing) = (self.navigation.camera(), self.navigation.framing());
        let frame = LightFrame::Object;
        self.settings.light =
            self.settings.light.towards(raking.direction(), frame, &camera, framing);
        self.motion.note(now);
    }

    /// A pixel was clicked: with a tool in hand, asks what is there. Returns whether there is one.
    pub fn pick(&mut self, pixel: DVec2) -> bool {
        let has_tool = self.work.tool.is_some();
        if has_tool {
            self.work.pick(self.navigation.lens(), pixel);
        }
        has_tool
    }

    /// Shows a second statue beside the first.
    ///
    /// # Errors
    /// When it cannot be shown.
    pub fn show_beside(
        &mut self,
        gpu: &Gpu,
        file: &Path,
        limits: ModelLimits,
        representation: Representation,
        format: wgpu::TextureFormat,
    ) -> Result<(), RenderError> {
        let first = &self.models[0];
        self.other = Some(Other::open(gpu, file, limits, representation, format, first)?);
        Ok(())
    }

    /// Where the line between two statues is, in pixels from the left of the picture.
    pub fn swipe_px(&self) -> Option<f64> {
        let width = self.navigation.lens().size.x;
        self.other.as_ref().map(|_| (self.settings.swipe * width).round().clamp(0.0, width))
    }

    /// What the panel shows.
    pub fn readings(&self, gpu: &Gpu, now: Instant) -> Readings {
        let shown =
            self.drawn.map_or(self.settings.error_threshold_px, |(s, _)| s.error_threshold_px);
        Readings {
            adapter: gpu.describe(),
            is_cloud: self.models[0].is_cloud(),
            scalars: Painted::all(self.models[0].header()),
            bound: Painted::bound(self.models[0].header()),
            software: gpu.info.device_type == wgpu::DeviceType::Cpu,
            stats: self.stats,
            frame_ms: self.clock.last_ms(),
            frames_per_sec: self.clock.frames_per_sec(),
            error_threshold_px: shown * self.stats.coarsening,
            raised: match shown > self.settings.error_threshold_px * 1.001 {
                _ if self.stats.coarsening > 1.0 => Some(Raised::Memory),
                true => Some(Raised::Moving),
                false => None,
            },
            loading: self.is_loading(),
            other: self.other.as_ref().map(|other| {
                let moved = if other.is_moved { ", about its own middle" } else { "" };
                (format!("{}{moved}", other.name), self.settings.swipe)
            }),
            tool: self.work.tool.as_ref().map(|tool| tool.hint()),
            reading: self.work.is_busy(),
            link_problem: self.models[0].link_problem().map(str::to_owned),
            resident_bytes: self.models[0].resident_bytes(),
            bytes_read: self.models[0].bytes_read(),
            diagonal: {
                let (low, high) = self.models[0].bounds();
                (high - low).length()
            },
            cut_open: !self.work.session().clip_planes().is_none(),
            parallel: self.navigation.is_parallel(),
            flying: self.navigation.is_flying(),
            recording_secs: self.recording.as_ref().map(|r| r.secs(now)),
            recorded: self.recorded.clone(),
            problem: self.problems.first().map(|p| (p.clone(), self.problems.len())),
        }
    }

    /// A depth that has arrived serves the gesture that waits for it, and flying.
    fn take_depth(&mut self) {
        if !self.depth.poll() {
            return;
        }
        let Some(picture) = self.depth.latest() else { return };
        if let Some(pixel) = self.anchor_wanted.take()
            && let Some(depth) = picture.depth_at(pixel)
        {
            self.navigation.set_anchor(picture.lens.point_at(pixel, depth));
        }
        let middle = picture.lens.size / 2.0;
        if let Some(depth) = picture.depth_at(middle) {
            let point = picture.lens.point_at(middle, depth);
            self.navigation.surface_ahead(self.navigation.lens().depth_of(point));
        }
    }

    fn toggle_recording(&mut self, now: Instant) {
        let (eye, target) = self.navigation.viewpoint();
        // Paths are played again by programs that know the file and no session.
        let framing = Framing::of(&self.models[0]);
        let Some(recording) = self.recording.take() else {
            self.recording = Some(Recording::begin(now, &framing, eye, target));
            self.recorded = None;
            return;
        };
        let stem = self.models[0].path().file_stem().unwrap_or_default().to_string_lossy();
        let name = format!("{stem}-path");
        let saved = recording
            .finish(&name, &framing, self.navigation.fov_y())
            .ok_or_else(|| RenderError::Usage("the recording was too short".into()))
            .and_then(|path| save_new(Path::new(""), &name, path));
        match saved {
            Ok(file) => self.recorded = Some(format!("saved {}", absolute(&file).display())),
            Err(error) => self.problems.insert(0, format!("camera path: {error}")),
        }
    }
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}
