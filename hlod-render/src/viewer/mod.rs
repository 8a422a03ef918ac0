//! The window (feature `viewer`).
//!
//! ```text
//! opening     how the window comes to be, and statues into it; entry: files chosen, dropped, built
//!   ▼ window  the system's window, and when to draw
//!   │ input       events → what the stage does    bindings, mapping, touch: what keys, buttons, fingers do
//!   ▼ stage       the model, where the viewer stands, what was set
//!   │ navigation  how a viewer moves
//!   │ work        the session: what is measured, cut and noted
//!   │ other       a second statue beside the first
//!   │ light       where light comes from
//!   │ pace        τ while moving, frame times
//!   │ depth       what is under the cursor, read back without waiting
//!   │ recording   camera paths for benchmarks
//!   ▼ gui         the picture and the panel on the screen, which painter draws
//! ```
//!
//! `preferences` survive the window. Only `opening`, `entry`, `window`, `input`, `bindings`, `gui`, `panel`, `painter`
//! and `screen` know that there is one.

mod about;
mod bindings;
mod compass;
mod depth;
mod entry;
mod gui;
mod input;
mod legend;
mod light;
mod mapping;
mod navigation;
mod opening;
mod other;
mod pace;
mod painter;
mod panel;
mod preferences;
mod recording;
mod screen;
mod settings;
mod stage;
mod touch;
mod watcher;
mod window;
mod work;

use std::path::PathBuf;
use std::time::Duration;

use winit::event_loop::{ControlFlow, EventLoop};

use crate::error::RenderError;
use crate::gpu::AdapterChoice;
use crate::model::ModelLimits;
use crate::scene::{Representation, Shadow};
use crate::source::Source;

/// What a window shows to begin with.
#[derive(Debug, Clone)]
pub struct ViewOptions {
    /// The `.hlod` file; a page to choose one where there is none.
    pub file: Option<PathBuf>,
    /// Memory and reading.
    pub limits: ModelLimits,
    /// τ at rest in pixels; as it was set last where there is none, which goes for the next as well.
    pub error_threshold_px: Option<f64>,
    /// What a frame may take while moving, in milliseconds.
    pub frame_target_ms: Option<f64>,
    /// Which hierarchy.
    pub representation: Representation,
    /// Azimuth and elevation of the light in degrees relative to the picture; those of the session where
    /// there are none.
    pub light: Option<(f64, f64)>,
    /// What shadows are drawn; those of the session where there are none.
    pub shadow: Shadow,
    /// A second file, shown beside the first on the right of a line.
    pub compare: Option<PathBuf>,
    /// Where the session is kept; beside the file where that is not said.
    pub session: Option<PathBuf>,
    /// Size of the window's content in pixels of the screen.
    pub size: (u32, u32),
    /// What draws.
    pub adapter: AdapterChoice,
    /// Leave after this time (tests and demonstrations).
    pub exit_after: Option<Duration>,
    /// Lose the GPU after this time, as drivers do (tests).
    pub lose_gpu_after: Option<Duration>,
    /// Write what the window shows to this PNG when leaving.
    pub screenshot: Option<PathBuf>,
}

/// Opens a window and returns when it is closed.
///
/// # Errors
/// When there is no window system or graphics adapter, the file cannot be shown, or the
/// screenshot cannot be written.
pub fn run(options: ViewOptions) -> Result<(), RenderError> {
    // A file that is none is refused before a window flashes up.
    for file in [&options.file, &options.compare].into_iter().flatten() {
        Source::open(file, 0, None)?;
    }

    let cannot = |e: winit::error::EventLoopError| RenderError::Window(e.to_string());
    let event_loop = EventLoop::<window::Wake>::with_user_event().build().map_err(cannot)?;
    event_loop.set_control_flow(ControlFlow::Wait);
    let mut app = window::App::new(options, event_loop.create_proxy());
    event_loop.run_app(&mut app).map_err(cannot)?;
    app.error.map_or(Ok(()), Err)
}
