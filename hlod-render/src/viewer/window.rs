//! The window: one frame as an outline, and when there is one.
//!
//! At most one frame is under way; a thread waits for the GPU and wakes the window when it is
//! done. Nothing is drawn while nothing changes: a still picture costs nothing.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DVec2;
use winit::application::ApplicationHandler;
use winit::event::{ElementState, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::window::{Window, WindowId};

use super::ViewOptions;
use super::entry::{Entry, page};
use super::gui::{Beside, Gui, Laid, Scene};
use super::input::Input;
use super::opening::{Opening, Statue};
use super::panel;
use super::preferences::Preferences;
use super::screen::Screen;
use super::stage::Stage;
use super::watcher::Watcher;
use super::work::{desk::Wishes, overlay::Overlay};
use crate::error::RenderError;
use crate::gpu::Gpu;

/// While parts are on their way and nothing moves, how often to look what has arrived.
const LOADING_INTERVAL: Duration = Duration::from_millis(40);
/// While the window cannot be drawn to, how often to try again.
const UNSEEN_INTERVAL: Duration = Duration::from_millis(250);
/// Devices lost within so short a time are not opened again: something is wrong with them.
const LOST_AGAIN: Duration = Duration::from_secs(10);

/// What wakes the window besides the window system.
#[derive(Debug)]
pub enum Wake {
    /// The frame under way is done.
    FrameDone(Instant),
    /// Something that was being read, chosen or built has something to say.
    Answered,
    /// The GPU is gone.
    Failed(String),
    /// A screen reader asks or answers.
    Access(egui_winit::accesskit_winit::Event),
}

impl From<egui_winit::accesskit_winit::Event> for Wake {
    fn from(event: egui_winit::accesskit_winit::Event) -> Wake {
        Wake::Access(event)
    }
}

/// The program with a window, before and after the window is there.
pub struct App {
    options: ViewOptions,
    proxy: EventLoopProxy<Wake>,
    open: Option<Open>,
    /// Why the program ends early.
    pub error: Option<RenderError>,
}

/// Everything that lives as long as the window. It ends in this order: nobody waits for a GPU, or
/// draws to a window, that is gone.
pub struct Open {
    pub(super) watcher: Watcher,
    pub(super) gui: Gui,
    pub(super) scene: Scene,
    /// The statue; a page to choose one where there is none.
    pub(super) stage: Option<Stage>,
    pub(super) screen: Screen,
    pub(super) gpu: Arc<Gpu>,
    pub(super) window: Arc<Window>,
    pub(super) entry: Entry,
    pub(super) preferences: Preferences,
    pub(super) input: Input,
    pub(super) under_way: Option<Frame>,
    /// Something changed while a frame was under way.
    pub(super) redraw_wanted: bool,
    /// The last frame was drawn at rest and its numbers are shown.
    pub(super) settled: bool,
    /// Minimised or covered: the last frame could not be drawn. When to try again.
    pub(super) unseen_until: Option<Instant>,
    pub(super) last_frame: Instant,
    pub(super) gui_again: Option<Instant>,
    pub(super) laid: Option<Laid>,
    pub(super) leave_at: Option<Instant>,
    /// When to lose the GPU, for tests.
    pub(super) lose_gpu_at: Option<Instant>,
    pub(super) quit: bool,
    /// When the GPU was opened.
    pub(super) begun: Instant,
}

/// A frame on the GPU.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    begun: Instant,
    /// Time spent waiting for the display.
    waited: Duration,
    drew_statue: bool,
    moving: bool,
}

impl App {
    /// Opens its window when the event loop runs.
    pub fn new(options: ViewOptions, proxy: EventLoopProxy<Wake>) -> App {
        App { options, proxy, open: None, error: None }
    }

    fn attempt<T>(
        &mut self,
        event_loop: &ActiveEventLoop,
        work: impl FnOnce(&mut App) -> Result<T, RenderError>,
    ) -> Option<T> {
        match work(self) {
            Ok(value) => Some(value),
            Err(error) => {
                self.error.get_or_insert(error);
                event_loop.exit();
                None
            }
        }
    }

    /// The GPU is gone: everything on it is made anew on the next one, and the viewer stands where they
    /// stood.
    fn begin_again(&mut self, event_loop: &ActiveEventLoop, why: String) {
        self.attempt(event_loop, |app| {
            let Some(open) = app.open.take() else { return Ok(()) };
            if open.begun.elapsed() < LOST_AGAIN {
                return Err(open.gpu.error(why));
            }
            let opening = Opening { event_loop, options: &app.options, proxy: &app.proxy };
            app.open = Some(opening.again(open, &why)?);
            Ok(())
        });
    }

    fn close(&mut self) {
        // While the connection to the window system is still there.
        if let Some(mut open) = self.open.take()
            && let Err(error) = open.close()
        {
            self.error.get_or_insert(error);
        }
    }
}

impl ApplicationHandler<Wake> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.open.is_none() {
            self.open = self.attempt(event_loop, |app| {
                Opening { event_loop, options: &app.options, proxy: &app.proxy }.first()
            });
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(open) = &mut self.open else { return };
        match open.on_event(&event) {
            // The device was lost, or its driver gave up: a new one may do.
            Err(RenderError::Gpu { why, .. }) => self.begin_again(event_loop, why),
            result => drop(self.attempt(event_loop, |_| result)),
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, wake: Wake) {
        let Some(open) = &mut self.open else { return };
        match wake {
            Wake::FrameDone(when) => open.frame_done(when),
            Wake::Answered => open.want_redraw(),
            Wake::Failed(why) => self.begin_again(event_loop, why),
            Wake::Access(event) => {
                open.gui.on_access(event.window_event);
                open.want_redraw();
            }
        }
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        self.close();
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let Some(open) = &mut self.open else { return };
        let now = Instant::now();
        if !open.is_leaving(now) {
            if open.lose_gpu_at.take_if(|at| now >= *at).is_some() {
                open.gpu.device.destroy();
                open.want_redraw();
            }
            let wanted = open.entry.advance(open.stage.is_none());
            if let Some(file) = wanted {
                let opening = Opening { event_loop, options: &self.options, proxy: &self.proxy };
                opening.show(open, Statue::File(&file));
            }
            event_loop.set_control_flow(open.schedule(now));
            return;
        }
        let screenshot = self.options.screenshot.clone();
        self.attempt(event_loop, |app| match (&mut app.open, screenshot) {
            (Some(open), Some(file)) => open.save_screenshot(&file),
            _ => Ok(()),
        });
        self.close();
        event_loop.exit();
    }
}

impl Open {
    fn is_leaving(&self, now: Instant) -> bool {
        let quit = self.quit || self.stage.as_ref().is_some_and(|stage| stage.quit);
        quit || self.leave_at.is_some_and(|at| now >= at)
    }

    /// Saves what has not been saved.
    fn close(&mut self) -> Result<(), RenderError> {
        let saved = self.stage.as_mut().map_or(Ok(()), |stage| stage.work.close());
        saved.and(self.preferences.save())
    }

    fn on_event(&mut self, event: &WindowEvent) -> Result<(), RenderError> {
        let now = Instant::now();
        match event {
            WindowEvent::RedrawRequested => return self.redraw(now),
            WindowEvent::CloseRequested => self.quit = true,
            WindowEvent::Resized(size) => {
                self.screen.resize(&self.gpu, *size);
                if let Some(stage) = &mut self.stage {
                    stage.motion.note(now);
                }
                self.unseen_until = None;
                self.want_redraw();
            }
            WindowEvent::Occluded(false) => {
                self.unseen_until = None;
                self.want_redraw();
            }
            WindowEvent::HoveredFile(_) | WindowEvent::HoveredFileCancelled => {
                self.entry.hover(matches!(event, WindowEvent::HoveredFile(_)));
                self.want_redraw();
            }
            WindowEvent::DroppedFile(path) => {
                self.entry.hover(false);
                self.entry.take(path.clone());
                self.want_redraw();
            }
            _ => {}
        }
        let (for_panel, panel_changed) = self.gui.on_event(&self.window, event);
        if matches!(event, WindowEvent::MouseInput { .. }) && !for_panel {
            self.gui.release_keyboard();
        }
        // What a drag began with belongs to it; the cursor's place and what is let go are always of
        // interest.
        let always = self.input.is_dragging()
            || match event {
                WindowEvent::CursorMoved { .. } | WindowEvent::ModifiersChanged(_) => true,
                WindowEvent::KeyboardInput { event, .. } => event.state == ElementState::Released,
                _ => false,
            };
        let changed = match &mut self.stage {
            Some(stage) if !for_panel || always => self.input.on_event(event, stage, now),
            _ => false,
        };
        if changed || panel_changed {
            self.want_redraw();
        }
        Ok(())
    }

    /// One frame.
    fn redraw(&mut self, now: Instant) -> Result<(), RenderError> {
        if self.under_way.is_some() {
            self.redraw_wanted = true;
            return Ok(());
        }
        self.redraw_wanted = false;

        // Move on and lay out the panel.
        if let Some(stage) = &mut self.stage {
            stage.advance(now);
        }
        let laid = self.lay_out(now);

        // Give the statue what room the panel leaves.
        if let Some(stage) = &self.stage {
            let targets = &self.scene.targets;
            let size = stage.navigation.lens().size.as_uvec2();
            if (targets.width(), targets.height()) != (size.x, size.y) {
                self.scene = Scene::new(&self.gpu, self.screen.picture_format(), size.x, size.y);
            }
        }

        // Draw the statue, then everything onto the screen.
        let before = Instant::now();
        let acquired = self.screen.acquire(&self.gpu)?;
        let waited = before.elapsed();
        let laid = self.laid.insert(laid);
        let Some(texture) = acquired else {
            self.redraw_wanted = true;
            self.unseen_until = Some(now + UNSEEN_INTERVAL);
            return Ok(());
        };
        self.unseen_until = None;
        let origin = self.input.origin.as_uvec2().into();
        let moving = self.stage.as_ref().is_some_and(|stage| stage.motion.is_moving(now));
        let drew_statue = match &mut self.stage {
            Some(stage) => stage.draw(&self.gpu, &self.scene, now)?,
            None => false,
        };
        let scenes = scenes(&self.stage, &self.scene);
        let submission = self.gui.paint(&self.gpu, laid, scenes, origin, &texture.texture);
        self.window.pre_present_notify();
        self.gpu.queue.present(texture);

        // Wait for it elsewhere.
        self.under_way = Some(Frame { begun: now, waited, drew_statue, moving });
        self.settled = !moving && !drew_statue;
        self.last_frame = now;
        self.watcher.watch(submission);
        Ok(())
    }

    /// Lays out the panel, or the page without a statue, and does what was asked for there.
    fn lay_out(&mut self, now: Instant) -> Laid {
        self.gui.set_scale(self.preferences.ui_scale);
        let Some(stage) = &mut self.stage else { return self.lay_out_page(now) };
        let readings = stage.readings(&self.gpu, now);
        let lens = stage.navigation.lens();
        let Stage { settings, work, depth, .. } = stage;
        let depth = depth.latest().filter(|picture| picture.lens == lens);
        let overlay = Overlay { work, lens: &lens, depth };
        let mut wishes = Wishes::default();
        let before = settings.clone();
        let mut rect = egui::Rect::NOTHING;
        let mut pixels_per_point = 1.0;
        let (entry, preferences) = (&mut self.entry, &mut self.preferences);
        let laid = self.gui.run(&self.gpu, &self.window, |ui| {
            pixels_per_point = ui.pixels_per_point();
            rect = panel::show(ui, settings, preferences, &readings, &overlay, &mut wishes);
            page::dialogs(ui, entry, true);
        });
        self.gui_again =
            now.checked_add(laid.again_after).filter(|_| laid.again_after < Duration::MAX);
        self.gui.statue = rect;
        if stage.settings != before {
            // As smooth as any other motion.
            stage.motion.note(now);
        }
        self.preferences.follow(&stage.settings, &before);
        self.input.mapping = self.preferences.mapping;
        self.redraw_wanted |= wishes.any();
        stage.fulfil(wishes, now);
        if std::mem::take(&mut stage.open_wanted) {
            self.entry.choose(&self.window);
        }

        let pixels = |v: egui::Vec2| {
            let v = (v * pixels_per_point).round();
            DVec2::new(v.x.into(), v.y.into())
        };
        let limit = f64::from(self.gpu.device.limits().max_texture_dimension_2d);
        self.input.origin = pixels(rect.min.to_vec2());
        stage.navigation.resize(pixels(rect.size()).clamp(DVec2::ONE, DVec2::splat(limit)));
        laid
    }

    fn lay_out_page(&mut self, now: Instant) -> Laid {
        let mut asked = page::Asked::default();
        let adapter = self.gpu.describe();
        let adapter = (adapter.as_str(), self.gpu.info.device_type == wgpu::DeviceType::Cpu);
        let (entry, recent) = (&mut self.entry, &self.preferences.recent);
        let laid = self.gui.run(&self.gpu, &self.window, |ui| {
            asked = page::start(ui, entry, recent, adapter);
            page::dialogs(ui, entry, false);
        });
        self.gui.statue = egui::Rect::NOTHING;
        self.gui_again =
            now.checked_add(laid.again_after).filter(|_| laid.again_after < Duration::MAX);
        if asked.choose {
            self.entry.choose(&self.window);
        }
        if let Some(path) = asked.forget {
            self.preferences.recent.retain(|known| *known != path);
            self.redraw_wanted = true;
        }
        laid
    }

    fn frame_done(&mut self, when: Instant) {
        let Some(frame) = self.under_way.take() else { return };
        if let Some(stage) = self.stage.as_mut().filter(|_| frame.drew_statue) {
            let took = when.saturating_duration_since(frame.begun).saturating_sub(frame.waited);
            stage.frame_finished(when, took.as_secs_f64() * 1e3, frame.moving);
        }
        if self.redraw_wanted {
            self.window.request_redraw();
        }
    }

    pub(super) fn want_redraw(&mut self) {
        self.redraw_wanted = true;
        self.settled = false;
        if self.under_way.is_none() {
            self.window.request_redraw();
        }
    }

    /// Asks for the next frame if it is due, and says until when nothing is.
    fn schedule(&mut self, now: Instant) -> ControlFlow {
        if self.under_way.is_some() {
            return ControlFlow::Wait;
        }
        let at_once = self.redraw_wanted.then_some(now);
        let mut next = [at_once, self.gui_again].into_iter().flatten().min();
        if let Some(stage) = &self.stage {
            let moving = stage.motion.is_moving(now);
            // After a motion: once more in full, and then once more for its numbers in the panel.
            let rest = if moving { stage.motion.rest_at() } else { (!self.settled).then_some(now) };
            let arriving = stage.is_loading().then(|| self.last_frame + LOADING_INTERVAL);
            let going = stage.navigation.is_moving().then_some(now);
            let due = [next, rest, arriving, going, stage.recording_due(), stage.work.due()];
            next = due.into_iter().flatten().min();
        }
        let next = next.map(|at| self.unseen_until.map_or(at, |until| at.max(until)));
        if next.is_some_and(|at| at <= now) {
            self.gui_again = None;
            self.window.request_redraw();
        }
        let timed = self.leave_at.into_iter().chain(self.lose_gpu_at);
        match next.filter(|at| *at > now).into_iter().chain(timed).min() {
            Some(at) => ControlFlow::WaitUntil(at),
            None => ControlFlow::Wait,
        }
    }

    fn save_screenshot(&mut self, file: &Path) -> Result<(), RenderError> {
        let Some(laid) = &self.laid else {
            return Err(RenderError::Window("nothing was shown yet".into()));
        };
        let (size, format) = (self.screen.size(), self.screen.format());
        let origin = self.input.origin.as_uvec2().into();
        let scenes = scenes(&self.stage, &self.scene);
        self.gui.screenshot(&self.gpu, laid, scenes, origin, size, format)?.save(file)
    }
}

/// What is on the screen besides the panel: the statue's picture, and a second one beside it.
fn scenes<'a>(
    stage: &'a Option<Stage>,
    scene: &'a Scene,
) -> Option<(&'a Scene, Option<Beside<'a>>)> {
    let stage = stage.as_ref()?;
    let beside = stage.swipe_px().zip(stage.other.as_ref());
    Some((scene, beside.map(|(from, other)| Beside { scene: other.scene(), from: from as u32 })))
}
