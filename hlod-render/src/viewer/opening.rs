//! How the window comes to be, and statues into it.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec2;
use winit::dpi::PhysicalSize;
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::window::Window;

use super::ViewOptions;
use super::entry::Entry;
use super::gui::{Gui, Scene};
use super::input::Input;
use super::navigation::Navigation;
use super::preferences::Preferences;
use super::screen::Screen;
use super::settings::Settings;
use super::stage::{Kept, Stage};
use super::watcher::Watcher;
use super::window::{Open, Wake};
use super::work::Work;
use crate::error::RenderError;
use crate::framing::Framing;
use crate::gpu::Gpu;
use crate::lamp::{Lamp, LightAngles};
use crate::model::{Model, ModelLimits};
use crate::model_file::ModelFile;
use crate::scene::Shadow;
use crate::session::{Looks, ShadowName};
use crate::source::Source;

/// Narrower windows, in points, begin with the panel hidden.
const PANEL_WINDOW_WIDTH: f64 = 900.0;

/// What is to be shown.
pub enum Statue<'a> {
    /// The one that the command line names, with what it says besides.
    Named(Box<ModelFile>),
    /// One that was chosen in the window.
    File(&'a Path),
    /// The one that was shown before the GPU was lost.
    Kept(Box<Kept>),
}

/// What a window is opened with.
pub struct Opening<'a> {
    /// Of the window system.
    pub event_loop: &'a ActiveEventLoop,
    /// As the command line has them.
    pub options: &'a ViewOptions,
    /// Wakes the window.
    pub proxy: &'a EventLoopProxy<Wake>,
}

impl Opening<'_> {
    /// The window as the program begins.
    ///
    /// # Errors
    /// When there is no adapter, or the statue that the command line names cannot be shown.
    pub fn first(&self) -> Result<Open, RenderError> {
        let (preferences, problem) = Preferences::load();
        let mut entry = Entry::new(self.wake());
        if let Some(problem) = problem {
            entry.report(problem.to_string());
        }
        // A server's first answers take as long as a window does.
        let limits = self.limits_of_named();
        std::thread::scope(|scope| {
            let file = self.options.file.as_ref();
            let file = file.map(|file| scope.spawn(move || ModelFile::open(file, limits)));
            let (window, screen, gpu) = self.window()?;
            let gui = Gui::new(&gpu, &window, screen.format(), self.event_loop, self.proxy);
            window.set_visible(true);
            let mut open = self.assemble(window, screen, gpu, gui, entry, preferences);
            if let Some(file) = file {
                let file = file.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
                let path = file.path().to_owned();
                let stage = self.stage(&open, Statue::Named(Box::new(file)))?;
                self.install(&mut open, stage, &path);
            }
            Ok(open)
        })
    }

    fn window(&self) -> Result<(Arc<Window>, Screen, Arc<Gpu>), RenderError> {
        let size = self.options.size;
        // Screen readers are told of the window before it is seen.
        let attributes = Window::default_attributes()
            .with_title("hlod-render")
            .with_inner_size(PhysicalSize::new(size.0, size.1))
            .with_min_inner_size(PhysicalSize::new(200, 150))
            .with_visible(false);
        let window = self
            .event_loop
            .create_window(attributes)
            .map_err(|e| RenderError::Window(e.to_string()))?;
        let window = Arc::new(window);
        let (screen, gpu) = self.screen(&window)?;
        Ok((window, screen, gpu))
    }

    /// Two statues that are compared share the memory.
    fn limits_of_named(&self) -> ModelLimits {
        match self.options.compare {
            Some(_) => self.options.limits.shared_by(2),
            None => self.options.limits,
        }
    }

    /// The window as it was before its GPU was lost, on another or the same.
    ///
    /// # Errors
    /// When there is none any more.
    pub fn again(&self, open: Open, why: &str) -> Result<Open, RenderError> {
        let Open { mut gui, stage, window, entry, preferences, leave_at, .. } = open;
        // What was on the lost one ends here, before there is another for this window.
        let kept = stage.map(Stage::keep);
        let (screen, gpu) = self.screen(&window)?;
        gui.renew(&gpu, screen.format());
        let mut open = self.assemble(window, screen, gpu, gui, entry, preferences);
        (open.leave_at, open.lose_gpu_at) = (leave_at, None);
        if let Some(kept) = kept {
            self.show(&mut open, Statue::Kept(Box::new(kept)));
        }
        open.entry.report(format!("the GPU was lost ({why}) and has been opened again"));
        Ok(open)
    }

    /// Shows a statue in the place of what was there; says in the window why it cannot.
    pub fn show(&self, open: &mut Open, statue: Statue<'_>) {
        if let Statue::File(file) = statue {
            // A file that is none changes nothing.
            if let Err(error) = Source::open(file, 0, None) {
                open.entry.report(error.to_string());
                return open.want_redraw();
            }
        }
        if let Some(Err(error)) = open.stage.as_mut().map(|before| before.work.close()) {
            open.entry.report(error.to_string());
            return open.want_redraw();
        }
        // Two statues at once may be more than the GPU has room for.
        open.stage = None;
        let file = match &statue {
            Statue::Named(file) => file.path().to_owned(),
            Statue::File(file) => file.to_path_buf(),
            Statue::Kept(kept) => kept.file.clone(),
        };
        match self.stage(open, statue) {
            Ok(stage) => self.install(open, stage, &file),
            Err(error) => open.entry.report(error.to_string()),
        }
        open.want_redraw();
    }

    fn wake(&self) -> impl Fn() + Send + Sync + 'static {
        let proxy = self.proxy.clone();
        // The window is gone: nobody needs to know.
        move || drop(proxy.send_event(Wake::Answered))
    }

    fn screen(&self, window: &Arc<Window>) -> Result<(Screen, Arc<Gpu>), RenderError> {
        let display = self.event_loop.owned_display_handle();
        let (screen, gpu) = Screen::open(display, window.clone(), self.options.adapter)?;
        Ok((screen, Arc::new(gpu)))
    }

    fn assemble(
        &self,
        window: Arc<Window>,
        screen: Screen,
        gpu: Arc<Gpu>,
        gui: Gui,
        entry: Entry,
        preferences: Preferences,
    ) -> Open {
        let now = Instant::now();
        let (width, height) = screen.size();
        let scene = Scene::new(&gpu, screen.picture_format(), width, height);
        let watcher = Watcher::start(gpu.clone(), self.proxy.clone());
        window.request_redraw();
        Open {
            watcher,
            gui,
            scene,
            stage: None,
            screen,
            gpu,
            window,
            entry,
            input: Input::new(preferences.mapping),
            preferences,
            under_way: None,
            redraw_wanted: true,
            settled: false,
            unseen_until: None,
            last_frame: now,
            gui_again: None,
            laid: None,
            leave_at: self.options.exit_after.map(|after| now + after),
            lose_gpu_at: self.options.lose_gpu_after.map(|after| now + after),
            quit: false,
            begun: now,
        }
    }

    fn install(&self, open: &mut Open, stage: Stage, file: &Path) {
        let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
        open.window.set_title(&format!("{name} – hlod-render"));
        open.stage = Some(stage);
        open.settled = false;
        open.preferences.note_opened(file);
        // So that a window opened meanwhile has it, too.
        if let Err(error) = open.preferences.save() {
            open.entry.report(error.to_string());
        }
    }

    /// A statue on the window's GPU, and where the viewer stands before it.
    fn stage(&self, open: &Open, statue: Statue<'_>) -> Result<Stage, RenderError> {
        let options = self.options;
        let (file, session, is_named, kept) = match statue {
            Statue::Named(file) => (*file, options.session.as_deref(), true, None),
            Statue::File(file) => (ModelFile::open(file, options.limits)?, None, false, None),
            Statue::Kept(kept) => {
                (ModelFile::open(&kept.file, options.limits)?, None, false, Some(kept))
            }
        };
        options.representation.check(file.header()).map_err(RenderError::Usage)?;
        let path = file.path().to_owned();
        let model = Model::of_file(&open.gpu, file)?;
        let output = open.screen.picture_format().add_srgb_suffix();
        if let Some(kept) = kept {
            let Kept { navigation, settings, work, .. } = *kept;
            return Ok(Stage::new(&open.gpu, output, model, navigation, settings, work));
        }
        let (width, height) = open.screen.size();
        let size = DVec2::new(width.into(), height.into());
        let navigation = Navigation::new(Framing::of(&model), size);
        let work = Work::open(&path, session, &model, self.wake());
        let points = f64::from(width) / open.window.scale_factor();
        let settings = self.settings(&open.preferences, points, work.session().looks, is_named);
        let mut stage = Stage::new(&open.gpu, output, model, navigation, settings, work);
        if let Some(file) = options.compare.as_ref().filter(|_| is_named) {
            let (format, limits) = (open.screen.picture_format(), self.limits_of_named());
            stage.show_beside(&open.gpu, file, limits, options.representation, format)?;
        }
        Ok(stage)
    }

    /// What was set: by the command line, else by the person once, else as usual.
    fn settings(
        &self,
        preferences: &Preferences,
        width_points: f64,
        looks: Looks,
        is_named: bool,
    ) -> Settings {
        let options = self.options;
        let usual = Settings::default();
        let mut settings = Settings {
            error_threshold_px: options
                .error_threshold_px
                .or(preferences.error_threshold_px)
                .unwrap_or(usual.error_threshold_px),
            frame_target_ms: options
                .frame_target_ms
                .or(preferences.frame_target_ms)
                .unwrap_or(usual.frame_target_ms),
            representation: options.representation,
            panel_open: preferences.panel_open.unwrap_or(width_points >= PANEL_WINDOW_WIDTH),
            ..usual
        };
        let shadow = match options.shadow {
            Shadow::None => looks.shadow,
            _ if is_named => ShadowName::Hard,
            _ => looks.shadow,
        };
        settings.set_looks(&Looks { shadow, ..looks });
        if let (Some((azimuth, elevation)), true) = (options.light, is_named) {
            settings.light = Lamp::of_picture(LightAngles::new(azimuth, elevation));
        }
        settings
    }
}
