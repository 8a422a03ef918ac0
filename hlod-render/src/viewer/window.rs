//! The window: one frame as an outline, and when there is one.
//!
//! At most one frame is under way; a thread waits for the GPU and wakes the window when it is
//! done. Nothing is drawn while nothing changes: a still picture costs nothing.

use std::path::Path;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use glam::DVec2;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::window::{Window, WindowId};

use super::ViewOptions;
use super::gui::{Beside, Gui, Laid, Scene};
use super::input::Input;
use super::light::{Lamp, LightAngles};
use super::navigation::Navigation;

use super::panel;
use super::screen::Screen;
use super::settings::Settings;
use super::stage::Stage;
use super::work::{Work, desk::Wishes};
use crate::error::RenderError;
use crate::framing::Framing;
use crate::gpu::Gpu;
use crate::model::Model;
use crate::scene::Shadow;
use crate::session::{Looks, ShadowName};

/// While parts are on their way and nothing moves, how often to look what has arrived.
const LOADING_INTERVAL: Duration = Duration::from_millis(40);
/// While the window cannot be drawn to, how often to try again.
const UNSEEN_INTERVAL: Duration = Duration::from_millis(250);
/// Narrower windows, in points, begin with the panel hidden.
const PANEL_WINDOW_WIDTH: f64 = 900.0;

/// What wakes the window besides the window system.
#[derive(Debug)]
pub enum Wake {
    /// The frame under way is done.
    FrameDone(Instant),
    /// The scan's own geometry has been read for a tool.
    Answered,
    /// The GPU is gone.
    Failed(String),
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
struct Open {
    watcher: Watcher,
    gui: Gui,
    scene: Scene,
    stage: Stage,
    screen: Screen,
    gpu: Arc<Gpu>,
    window: Arc<Window>,
    input: Input,
    under_way: Option<Frame>,
    /// Something changed while a frame was under way.
    redraw_wanted: bool,
    /// The last frame was drawn at rest and its numbers are shown.
    settled: bool,
    /// Minimised or covered: the last frame could not be drawn. When to try again.
    unseen_until: Option<Instant>,
    last_frame: Instant,
    gui_again: Option<Instant>,
    laid: Option<Laid>,
    leave_at: Option<Instant>,
}

/// A frame on the GPU.
#[derive(Debug, Clone, Copy)]
struct Frame {
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
}

impl ApplicationHandler<Wake> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.open.is_none() {
            self.open =
                self.attempt(event_loop, |app| Open::new(event_loop, &app.options, &app.proxy));
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        self.attempt(event_loop, |app| match &mut app.open {
            Some(open) => open.on_event(&event),
            None => Ok(()),
        });
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, wake: Wake) {
        self.attempt(event_loop, |app| match (wake, &mut app.open) {
            (Wake::FrameDone(when), Some(open)) => {
                open.frame_done(when);
                Ok(())
            }
            (Wake::Answered, Some(open)) => {
                open.want_redraw();
                Ok(())
            }
            (Wake::Failed(why), Some(open)) => Err(open.gpu.error(why)),
            (_, None) => Ok(()),
        });
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // While the connection to the window system is still there.
        if let Some(mut open) = self.open.take()
            && let Err(error) = open.stage.work.close()
        {
            self.error.get_or_insert(error);
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let Some(open) = &mut self.open else { return };
        let now = Instant::now();
        let leaving = open.stage.quit || open.leave_at.is_some_and(|at| now >= at);
        if leaving {
            let closed = open.stage.work.close();
            self.attempt(event_loop, |_| closed);
            let screenshot = self.options.screenshot.clone();
            self.attempt(event_loop, |app| match (&mut app.open, screenshot) {
                (Some(open), Some(file)) => open.save_screenshot(&file),
                _ => Ok(()),
            });
            event_loop.exit();
            return;
        }
        event_loop.set_control_flow(open.schedule(now));
    }
}

impl Open {
    fn new(
        event_loop: &ActiveEventLoop,
        options: &ViewOptions,
        proxy: &EventLoopProxy<Wake>,
    ) -> Result<Open, RenderError> {
        // Open the window and an adapter that can draw in it.
        let name = options.file.file_name().unwrap_or_default().to_string_lossy();
        let attributes = Window::default_attributes()
            .with_title(format!("{name} – hlod-render"))
            .with_inner_size(PhysicalSize::new(options.size.0, options.size.1))
            .with_min_inner_size(PhysicalSize::new(200, 150));
        let window =
            event_loop.create_window(attributes).map_err(|e| RenderError::Window(e.to_string()))?;
        let window = Arc::new(window);
        let display = event_loop.owned_display_handle();
        let (screen, gpu) = Screen::open(display, window.clone(), options.adapter)?;
        let gpu = Arc::new(gpu);

        // Open the model and stand before it.
        let model = Model::open(&gpu, &options.file, options.limits)?;
        options.representation.check(model.header()).map_err(RenderError::Usage)?;
        let (width, height) = screen.size();
        let size = DVec2::new(width.into(), height.into());
        let navigation = Navigation::new(Framing::of(&model), size);
        let points = f64::from(width) / window.scale_factor();
        let settings = Settings {
            error_threshold_px: options.error_threshold_px,
            frame_target_ms: options.frame_target_ms,
            representation: options.representation,
            panel_open: points >= PANEL_WINDOW_WIDTH,
            ..Settings::default()
        };
        let answered = proxy.clone();
        // The window is gone: nobody needs to know.
        let wake = move || drop(answered.send_event(Wake::Answered));
        let session = options.session.as_deref();
        let mut work = Work::open(&options.file, session, model.header(), model.bounds(), wake);
        work.set_metadata(model.metadata());
        let mut settings = settings;
        let begun = work.session().looks;
        settings.set_looks(&Looks {
            shadow: if options.shadow == Shadow::None { begun.shadow } else { ShadowName::Hard },
            ..begun
        });
        if let Some((azimuth, elevation)) = options.light {
            settings.light = Lamp::of_picture(LightAngles::new(azimuth, elevation));
        }
        let mut stage = Stage::new(
            &gpu,
            screen.picture_format().add_srgb_suffix(),
            model,
            navigation,
            settings,
            work,
        );

        if let Some(file) = &options.compare {
            let (limits, format) = (options.limits, screen.picture_format());
            let shown = options.representation;
            stage.show_beside(&gpu, file, limits, shown, format)?;
        }

        // Prepare what is drawn into, and who waits for it.
        let scene = Scene::new(&gpu, screen.picture_format(), width, height);
        let gui = Gui::new(&gpu, &window, screen.format());
        let watcher = Watcher::start(gpu.clone(), proxy.clone());
        let now = Instant::now();
        window.request_redraw();
        Ok(Open {
            watcher,
            gui,
            scene,
            stage,
            screen,
            gpu,
            window,
            input: Input::default(),
            under_way: None,
            redraw_wanted: true,
            settled: false,
            unseen_until: None,
            last_frame: now,
            gui_again: None,
            laid: None,
            leave_at: options.exit_after.map(|after| now + after),
        })
    }

    fn on_event(&mut self, event: &WindowEvent) -> Result<(), RenderError> {
        let now = Instant::now();
        match event {
            WindowEvent::RedrawRequested => return self.redraw(now),
            WindowEvent::CloseRequested => self.stage.quit = true,
            WindowEvent::Resized(size) => {
                self.screen.resize(&self.gpu, *size);
                self.stage.motion.note(now);
                self.unseen_until = None;
                self.want_redraw();
            }
            WindowEvent::Occluded(false) => {
                self.unseen_until = None;
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
        let changed = (!for_panel || always) && self.input.on_event(event, &mut self.stage, now);
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
        self.stage.advance(now);
        let laid = self.lay_out(now);

        // Give the statue what room the panel leaves.
        let targets = &self.scene.targets;
        let size = self.stage.navigation.lens().size.as_uvec2();
        if (targets.width(), targets.height()) != (size.x, size.y) {
            self.scene = Scene::new(&self.gpu, self.screen.picture_format(), size.x, size.y);
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
        let moving = self.stage.motion.is_moving(now);
        let drew_statue = self.stage.draw(&self.gpu, &self.scene, now)?;
        let scenes = (&self.scene, beside(&self.stage));
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

    /// Lays out the panel, and does what was asked for in it.
    fn lay_out(&mut self, now: Instant) -> Laid {
        let readings = self.stage.readings(&self.gpu, now);
        let lens = self.stage.navigation.lens();
        let Stage { settings, work, .. } = &mut self.stage;
        let mut wishes = Wishes::default();
        let before = settings.clone();
        let mut rect = egui::Rect::NOTHING;
        let mut pixels_per_point = 1.0;
        let laid = self.gui.run(&self.gpu, &self.window, |ui| {
            pixels_per_point = ui.pixels_per_point();
            rect = panel::show(ui, settings, &readings, (work, &lens), &mut wishes);
        });
        self.gui_again =
            now.checked_add(laid.again_after).filter(|_| laid.again_after < Duration::MAX);
        self.gui.statue = rect;
        if self.stage.settings != before {
            // As smooth as any other motion.
            self.stage.motion.note(now);
        }
        self.redraw_wanted |= wishes.any();
        self.stage.fulfil(wishes, now);

        let pixels = |v: egui::Vec2| {
            let v = (v * pixels_per_point).round();
            DVec2::new(v.x.into(), v.y.into())
        };
        let limit = f64::from(self.gpu.device.limits().max_texture_dimension_2d);
        self.input.origin = pixels(rect.min.to_vec2());
        self.stage.navigation.resize(pixels(rect.size()).clamp(DVec2::ONE, DVec2::splat(limit)));
        laid
    }

    fn frame_done(&mut self, when: Instant) {
        let Some(frame) = self.under_way.take() else { return };
        if frame.drew_statue {
            let took = when.saturating_duration_since(frame.begun).saturating_sub(frame.waited);
            self.stage.frame_finished(when, took.as_secs_f64() * 1e3, frame.moving);
        }
        if self.redraw_wanted {
            self.window.request_redraw();
        }
    }

    fn want_redraw(&mut self) {
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
        let stage = &self.stage;
        let moving = stage.motion.is_moving(now);
        // After a motion: once more in full, and then once more for its numbers in the panel.
        let rest = if moving { stage.motion.rest_at() } else { (!self.settled).then_some(now) };
        let arriving = stage.is_loading().then(|| self.last_frame + LOADING_INTERVAL);
        let at_once = (self.redraw_wanted || stage.navigation.is_moving()).then_some(now);
        let next =
            [rest, arriving, at_once, stage.recording_due(), stage.work.due(), self.gui_again];
        let next = next.into_iter().flatten().min();
        let next = next.map(|at| self.unseen_until.map_or(at, |until| at.max(until)));
        if next.is_some_and(|at| at <= now) {
            self.gui_again = None;
            self.window.request_redraw();
        }
        match next.filter(|at| *at > now).into_iter().chain(self.leave_at).min() {
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
        let scenes = (&self.scene, beside(&self.stage));
        self.gui.screenshot(&self.gpu, laid, scenes, origin, size, format)?.save(file)
    }
}

/// The second statue's picture, where there is one.
fn beside(stage: &Stage) -> Option<Beside<'_>> {
    let from = stage.swipe_px()? as u32;
    Some(Beside { scene: stage.other.as_ref()?.scene(), from })
}

/// A thread that waits for frames, so that the window does not.
struct Watcher {
    /// `None` only while ending.
    submissions: Option<mpsc::Sender<wgpu::SubmissionIndex>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Watcher {
    fn start(gpu: Arc<Gpu>, proxy: EventLoopProxy<Wake>) -> Watcher {
        let (sender, submissions) = mpsc::channel();
        let thread = std::thread::spawn(move || {
            for submission in submissions {
                let wait =
                    wgpu::PollType::Wait { submission_index: Some(submission), timeout: None };
                let wake = match gpu.device.poll(wait) {
                    Ok(_) => Wake::FrameDone(Instant::now()),
                    Err(error) => Wake::Failed(error.to_string()),
                };
                // The window is gone: nobody needs to know.
                if proxy.send_event(wake).is_err() {
                    return;
                }
            }
        });
        Watcher { submissions: Some(sender), thread: Some(thread) }
    }

    /// Sends [`Wake::FrameDone`] when the submission is done.
    fn watch(&self, submission: wgpu::SubmissionIndex) {
        if let Some(submissions) = &self.submissions {
            // It has ended only where it has told that the GPU failed.
            let _ = submissions.send(submission);
        }
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        self.submissions = None;
        if let Some(thread) = self.thread.take() {
            // Whether it panicked does not matter any more.
            let _ = thread.join();
        }
    }
}
