//! The panel's toolkit, and putting the statue's picture and the panel on the screen together.
//!
//! The renderer writes linear light into a texture that encodes it as sRGB; the encoded values of
//! the same texture are copied to the screen, and the panel is drawn beside them. So the statue's
//! pixels in the window are those of a picture taken without one. (Drawing the picture as one
//! large rectangle of the toolkit takes 40 ms a frame on a software rasteriser, copying it 2.)

use std::time::Duration;

use egui::epaint::ClippedPrimitive;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::window::Window;

use super::painter::Painter;
use super::window::Wake;
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::passes::Targets;
use crate::picture::Picture;
use egui_winit::accesskit_winit::WindowEvent as Access;

/// A texture for the statue's picture.
pub struct Scene {
    /// What the renderer draws into.
    pub targets: Targets,
    texture: wgpu::Texture,
}

/// A second picture of the same size, shown to the right of a line.
#[derive(Clone, Copy)]
pub struct Beside<'a> {
    /// The picture.
    pub scene: &'a Scene,
    /// Pixels from the left to the line.
    pub from: u32,
}

impl Scene {
    /// For a screen of this format. Width and height must be at least 1 and within the adapter's
    /// limits.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat, width: u32, height: u32) -> Scene {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let srgb = [format.add_srgb_suffix()];
        let texture = gpu.texture("statue", (width, height), format, usage, &srgb);
        let linear = texture.create_view(&wgpu::TextureViewDescriptor {
            format: Some(format.add_srgb_suffix()),
            usage: Some(wgpu::TextureUsages::RENDER_ATTACHMENT),
            ..Default::default()
        });
        Scene { targets: Targets::new(gpu, linear, width, height), texture }
    }
}

/// A laid out frame of the toolkit.
pub struct Laid {
    primitives: Vec<ClippedPrimitive>,
    pixels_per_point: f32,
    /// When the toolkit wants to be drawn again.
    pub again_after: Duration,
}

/// The toolkit.
pub struct Gui {
    context: egui::Context,
    state: egui_winit::State,
    painter: Painter,
    /// Textures that the last frame laid out was the last to use.
    expired: Vec<egui::TextureId>,
    /// Width and height of textures at most.
    side: usize,
    /// In points.
    cursor: Option<egui::Pos2>,
    /// Where the statue's picture is, in points.
    pub statue: egui::Rect,
}

impl Gui {
    /// `format` is that of the screen. The window must not have been seen yet, for screen readers' sake.
    pub fn new(
        gpu: &Gpu,
        window: &Window,
        format: wgpu::TextureFormat,
        event_loop: &ActiveEventLoop,
        proxy: &EventLoopProxy<Wake>,
    ) -> Gui {
        let context = egui::Context::default();
        // Grey surroundings do not tint what is looked at; text stands out from them.
        context.set_theme(egui::Theme::Dark);
        let mut visuals = egui::Visuals::dark();
        visuals.widgets.noninteractive.fg_stroke.color = egui::Color32::from_gray(205);
        visuals.widgets.inactive.fg_stroke.color = egui::Color32::from_gray(225);
        context.set_visuals(visuals);
        let side = gpu.device.limits().max_texture_dimension_2d as usize;
        let mut state = egui_winit::State::new(
            context.clone(),
            egui::ViewportId::ROOT,
            window,
            Some(window.scale_factor() as f32),
            None,
            Some(side),
        );
        state.init_accesskit(event_loop, window, proxy.clone());
        Gui {
            context,
            state,
            painter: Painter::new(gpu, format),
            expired: Vec::new(),
            side,
            cursor: None,
            statue: egui::Rect::EVERYTHING,
        }
    }

    /// Goes on with another GPU than before.
    pub fn renew(&mut self, gpu: &Gpu, format: wgpu::TextureFormat) {
        self.painter = Painter::new(gpu, format);
        self.expired.clear();
        // Letters are uploaded once; with another limit of textures' size they are again.
        let side = gpu.device.limits().max_texture_dimension_2d as usize;
        self.side = if self.side == side { side - 1 } else { side };
        self.state.set_max_texture_side(self.side);
    }

    /// How large letters are, relative to what the system asks for.
    pub fn set_scale(&self, scale: f32) {
        self.context.set_zoom_factor(scale);
    }

    /// What a screen reader asks or does.
    pub fn on_access(&mut self, event: Access) {
        match event {
            Access::InitialTreeRequested => self.context.enable_accesskit(),
            Access::ActionRequested(request) => self.state.on_accesskit_action_request(request),
            Access::AccessibilityDeactivated => self.context.disable_accesskit(),
        }
    }

    /// Hands an event over. Says whether it was meant for the panel alone, and whether the panel
    /// may look different now.
    pub fn on_event(&mut self, window: &Window, event: &WindowEvent) -> (bool, bool) {
        let was_over_panel = self.is_over_panel();
        if let WindowEvent::CursorMoved { position, .. } = event {
            let pixels = egui::pos2(position.x as f32, position.y as f32);
            self.cursor = Some(pixels / egui_winit::pixels_per_point(&self.context, window));
        }
        if let WindowEvent::Touch(touch) = event {
            let pixels = egui::pos2(touch.location.x as f32, touch.location.y as f32);
            self.cursor = Some(pixels / egui_winit::pixels_per_point(&self.context, window));
        }
        let response = self.state.on_window_event(window, event);
        // The toolkit judges by the cursor of its last frame, which may be long ago.
        let over_panel = self.is_over_panel() || self.context.egui_is_using_pointer();
        match event {
            // A cursor that moves over the statue changes nothing in the panel.
            WindowEvent::CursorMoved { .. } => (false, over_panel || was_over_panel),
            WindowEvent::MouseInput { .. }
            | WindowEvent::Touch(_)
            | WindowEvent::MouseWheel { .. }
            | WindowEvent::PinchGesture { .. } => (over_panel, response.repaint),
            _ => (response.consumed, response.repaint),
        }
    }

    /// Whether the cursor is over anything but the statue.
    fn is_over_panel(&self) -> bool {
        self.cursor.is_some_and(|cursor| {
            let layer = self.context.layer_id_at(cursor);
            !self.statue.contains(cursor)
                || layer.is_some_and(|layer| layer.order != egui::Order::Background)
        })
    }

    /// Takes the keyboard from whatever field of the panel has it.
    pub fn release_keyboard(&self) {
        self.context.memory_mut(|memory| {
            if let Some(id) = memory.focused() {
                memory.surrender_focus(id);
            }
        });
    }

    /// Lays the frame out and uploads the textures that it brings.
    pub fn run(&mut self, gpu: &Gpu, window: &Window, contents: impl FnMut(&mut egui::Ui)) -> Laid {
        let input = self.state.take_egui_input(window);
        let mut output = self.context.run_ui(input, contents);
        self.state.handle_platform_output(window, output.platform_output);
        let again_after = output
            .viewport_output
            .get(&egui::ViewportId::ROOT)
            .map_or(Duration::MAX, |viewport| viewport.repaint_delay);

        // The frame before is not painted again; this one may be, with what it was the last to use.
        for id in self.expired.drain(..) {
            self.painter.free_texture(id);
        }
        let textures = &mut output.textures_delta;
        for (id, deltas) in textures.set.drain() {
            for delta in &deltas {
                self.painter.update_texture(gpu, id, delta);
            }
        }
        self.expired.extend(textures.free.drain());

        Laid {
            primitives: self.context.tessellate(output.shapes, output.pixels_per_point),
            pixels_per_point: output.pixels_per_point,
            again_after,
        }
    }

    /// Puts the statue's picture, if there is one, and the panel onto `target`, and submits it. The upper left
    /// corner of the picture comes to `origin`.
    pub fn paint(
        &mut self,
        gpu: &Gpu,
        laid: &Laid,
        scenes: Option<(&Scene, Option<Beside<'_>>)>,
        origin: (u32, u32),
        target: &wgpu::Texture,
    ) -> wgpu::SubmissionIndex {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        if let Some((scene, beside)) = scenes {
            copy(&mut encoder, scene, beside, origin, target);
        }
        self.painter.paint(gpu, &mut encoder, &laid.primitives, laid.pixels_per_point, target);
        gpu.queue.submit([encoder.finish()])
    }

    /// The same frame as a picture of a window of this size and format. Waits for it.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn screenshot(
        &mut self,
        gpu: &Gpu,
        laid: &Laid,
        scenes: Option<(&Scene, Option<Beside<'_>>)>,
        origin: (u32, u32),
        (width, height): (u32, u32),
        format: wgpu::TextureFormat,
    ) -> Result<Picture, RenderError> {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::COPY_SRC
            | wgpu::TextureUsages::COPY_DST;
        let texture = gpu.texture("screenshot", (width, height), format, usage, &[]);
        self.paint(gpu, laid, scenes, origin, &texture);
        let mut rgba = gpu.read_texture(&texture, wgpu::TextureAspect::All)?;
        let blue_first = matches!(format.remove_srgb_suffix(), wgpu::TextureFormat::Bgra8Unorm);
        for pixel in rgba.chunks_exact_mut(4) {
            if blue_first {
                pixel.swap(0, 2);
            }
            pixel[3] = 255;
        }
        Ok(Picture { width, height, rgba })
    }
}

/// The statue's picture, and a second one to the right of a line.
fn copy(
    encoder: &mut wgpu::CommandEncoder,
    scene: &Scene,
    beside: Option<Beside<'_>>,
    origin: (u32, u32),
    target: &wgpu::Texture,
) {
    // While a window shrinks, the picture may be larger than what it is shown in.
    let size = wgpu::Extent3d {
        width: scene.texture.width().min(target.width().saturating_sub(origin.0)),
        height: scene.texture.height().min(target.height().saturating_sub(origin.1)),
        depth_or_array_layers: 1,
    };
    let mut to = target.as_image_copy();
    (to.origin.x, to.origin.y) = origin;
    encoder.copy_texture_to_texture(scene.texture.as_image_copy(), to, size);
    if let Some(Beside { scene, from }) = beside {
        let rest = |there: u32| there.saturating_sub(from).min(size.width.saturating_sub(from));
        let width = rest(scene.texture.width());
        let height = size.height.min(scene.texture.height());
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let mut of = scene.texture.as_image_copy();
        of.origin.x = from;
        to.origin.x += from;
        if width > 0 && height > 0 {
            encoder.copy_texture_to_texture(of, to, size);
        }
    }
}
