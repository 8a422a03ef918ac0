//! The window's surface: what the window system shows.

use std::sync::Arc;

use winit::dpi::PhysicalSize;
use winit::event_loop::OwnedDisplayHandle;
use winit::window::Window;

use crate::error::RenderError;
use crate::gpu::{AdapterChoice, Gpu};

/// A window's surface and how it is configured.
pub struct Screen {
    instance: wgpu::Instance,
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
}

impl Screen {
    /// Opens an adapter that can show something in the window.
    ///
    /// # Errors
    /// When there is none.
    pub fn open(
        display: OwnedDisplayHandle,
        window: Arc<Window>,
        choice: AdapterChoice,
    ) -> Result<(Screen, Gpu), RenderError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_with_display_handle(
            Box::new(display),
        ));
        let surface = instance
            .create_surface(window.clone())
            .map_err(|e| RenderError::Window(e.to_string()))?;
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            force_fallback_adapter: choice == AdapterChoice::Software,
            compatible_surface: Some(&surface),
            ..Default::default()
        }))
        .map_err(|e| RenderError::NoAdapter(e.to_string()))?;
        let gpu = Gpu::open(&adapter)?;

        let capabilities = surface.get_capabilities(&adapter);
        let PhysicalSize { width, height } = window.inner_size();
        let config = wgpu::SurfaceConfiguration {
            // The picture is copied in, the panel drawn.
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_DST,
            format: preferred_format(&capabilities.formats)
                .filter(|_| capabilities.usages.contains(wgpu::TextureUsages::COPY_DST))
                .ok_or_else(|| gpu.error("cannot show eight-bit pictures in this window"))?,
            color_space: wgpu::SurfaceColorSpace::Auto,
            width: width.max(1),
            height: height.max(1),
            // Waits for the display where it can, so that nothing tears.
            present_mode: wgpu::PresentMode::AutoVsync,
            desired_maximum_frame_latency: 2,
            alpha_mode: wgpu::CompositeAlphaMode::Auto,
            view_formats: Vec::new(),
        };
        surface.configure(&gpu.device, &config);
        Ok((Screen { instance, window, surface, config }, gpu))
    }

    /// Format of what is shown.
    pub fn format(&self) -> wgpu::TextureFormat {
        self.config.format
    }

    /// Format of textures that can be copied to the screen and seen as sRGB.
    pub fn picture_format(&self) -> wgpu::TextureFormat {
        self.config.format.remove_srgb_suffix()
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.config.width, self.config.height)
    }

    /// Follows the window's size; a minimised window (0 × 0) keeps what it had.
    pub fn resize(&mut self, gpu: &Gpu, size: PhysicalSize<u32>) {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        let (width, height) = (size.width.min(limit), size.height.min(limit));
        if width > 0 && height > 0 && (width, height) != self.size() {
            (self.config.width, self.config.height) = (width, height);
            self.surface.configure(&gpu.device, &self.config);
        }
    }

    /// The texture to draw the next frame into; `None` where nobody would see it.
    ///
    /// # Errors
    /// When the surface cannot be had back.
    pub fn acquire(&mut self, gpu: &Gpu) -> Result<Option<wgpu::SurfaceTexture>, RenderError> {
        use wgpu::CurrentSurfaceTexture as Current;
        // A minimised window has no pixels, and a surface of its size cannot be configured.
        let size = self.window.inner_size();
        if size.width == 0 || size.height == 0 {
            return Ok(None);
        }
        // A surface that has changed is configured anew, a lost one replaced: once, then next time.
        for _ in 0..2 {
            match self.surface.get_current_texture() {
                Current::Success(texture) | Current::Suboptimal(texture) => {
                    return Ok(Some(texture));
                }
                Current::Timeout | Current::Occluded => return Ok(None),
                Current::Outdated => {}
                Current::Lost => {
                    self.surface = self
                        .instance
                        .create_surface(self.window.clone())
                        .map_err(|e| RenderError::Window(e.to_string()))?;
                }
                Current::Validation => {
                    // Of a device that is lost that is the reason to be said.
                    gpu.check()?;
                    return Err(gpu.error("the window's surface is invalid"));
                }
            }
            self.surface.configure(&gpu.device, &self.config);
        }
        Ok(None)
    }
}

/// The panel is mixed with the picture as it is encoded, so formats that do not decode come first.
/// Others have no encoded twin that the picture could be copied from.
fn preferred_format(formats: &[wgpu::TextureFormat]) -> Option<wgpu::TextureFormat> {
    use wgpu::TextureFormat::{Bgra8Unorm, Bgra8UnormSrgb, Rgba8Unorm, Rgba8UnormSrgb};
    [Bgra8Unorm, Rgba8Unorm, Bgra8UnormSrgb, Rgba8UnormSrgb]
        .into_iter()
        .find(|format| formats.contains(format))
}
