//! Pictures without a window.

use std::path::Path;

use hlod_compress::srgb::{linear_from_srgb, srgb_from_linear};
use image::ImageEncoder;

use crate::error::RenderError;
use crate::files::write_aside;
use crate::frame::{FrameStats, Renderer};
use crate::gpu::Gpu;
use crate::model::Model;
use crate::passes::Targets;
use crate::scene::Shot;

/// Format of pictures: sRGB, so that shaders write linear light.
pub const PICTURE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// An RGBA picture, sRGB, row by row from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Four bytes a pixel.
    pub rgba: Vec<u8>,
}

/// A texture to draw into and its companions.
pub struct Canvas {
    texture: wgpu::Texture,
    /// What a renderer draws into.
    pub targets: Targets,
}

impl Canvas {
    /// # Errors
    /// When the adapter cannot make textures of this size.
    pub fn new(gpu: &Gpu, width: u32, height: u32) -> Result<Canvas, RenderError> {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if width == 0 || height == 0 || width > limit || height > limit {
            return Err(RenderError::Usage(format!(
                "a picture of {width}×{height} pixels: this adapter makes 1 to {limit} a side"
            )));
        }
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let texture = gpu.texture("picture", (width, height), PICTURE_FORMAT, usage, &[]);
        let view = texture.create_view(&Default::default());
        Ok(Canvas { targets: Targets::new(gpu, view, width, height), texture })
    }

    /// Reads the picture back.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn picture(&self, gpu: &Gpu) -> Result<Picture, RenderError> {
        let rgba = gpu.read_texture(&self.texture, wgpu::TextureAspect::All)?;
        Ok(Picture { width: self.texture.width(), height: self.texture.height(), rgba })
    }

    /// Identity of the triangle seen in each pixel: 0 for none, bit 31 for its back.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn identities(&self, gpu: &Gpu) -> Result<Vec<u32>, RenderError> {
        let bytes = gpu.read_texture(self.targets.identity(), wgpu::TextureAspect::All)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    /// How much of the light is hidden from what each pixel shows, in 65535ths; 0 where nothing is
    /// drawn. Of the last frame with shadows.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn occlusion(&self, gpu: &Gpu) -> Result<Vec<u32>, RenderError> {
        let pixels = u64::from(self.texture.width()) * u64::from(self.texture.height());
        let bytes = gpu.read_buffer(self.targets.occlusion(gpu), 4 * pixels)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    /// Reversed depth of each pixel; 0 where nothing is drawn.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn depths(&self, gpu: &Gpu) -> Result<Vec<f32>, RenderError> {
        let bytes = gpu.read_texture(self.targets.depth(), wgpu::TextureAspect::DepthOnly)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }
}

/// Draws one complete picture at `supersampling` times its size and averages it down in linear
/// light.
///
/// # Errors
/// When the GPU fails or the picture is too large for it.
pub fn take(
    gpu: &Gpu,
    models: &mut [Model],
    shot: &Shot,
    width: u32,
    height: u32,
    supersampling: u32,
) -> Result<(Picture, FrameStats), RenderError> {
    let n = supersampling.max(1);
    let canvas = Canvas::new(gpu, width.saturating_mul(n), height.saturating_mul(n))?;
    let mut renderer = Renderer::new(gpu, PICTURE_FORMAT);
    // The picture's own pixels decide what is fine enough.
    let shot = shot.finer(n);
    let stats = renderer.render_complete(gpu, models, &shot, &canvas.targets)?;
    Ok((canvas.picture(gpu)?.reduced(n), stats))
}

impl Picture {
    /// Averages blocks of n × n pixels in linear light; the size must be divisible by n. Colours count by
    /// their alpha, so that what is transparent leaves no fringe.
    pub fn reduced(&self, n: u32) -> Picture {
        if n == 1 {
            return self.clone();
        }
        let linear: Vec<f32> = (0..=255u8).map(linear_from_srgb).collect();
        let (width, height) = (self.width / n, self.height / n);
        let mut rgba = Vec::with_capacity((width * height * 4) as usize);
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0.0f32; 4];
                for dy in 0..n {
                    let start = (((y * n + dy) * self.width + x * n) * 4) as usize;
                    for pixel in self.rgba[start..start + 4 * n as usize].chunks_exact(4) {
                        let alpha = f32::from(pixel[3]);
                        (0..3).for_each(|i| sum[i] += linear[usize::from(pixel[i])] * alpha);
                        sum[3] += alpha;
                    }
                }
                let count = (n * n) as f32;
                rgba.extend((0..3).map(|i| srgb_from_linear(sum[i] / sum[3].max(1.0))));
                rgba.push((sum[3] / count).round() as u8);
            }
        }
        Picture { width, height, rgba }
    }

    /// Writes a PNG, aside and then renamed.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), RenderError> {
        write_aside(path, |out| {
            let (width, height) = (self.width, self.height);
            image::codecs::png::PngEncoder::new(out)
                .write_image(&self.rgba, width, height, image::ExtendedColorType::Rgba8)
                .map_err(|source| RenderError::Image { path: path.to_owned(), source })
        })
    }
}
