//! The depth of the picture, read back without waiting.
//!
//! wgpu copies depth textures only as a whole, so one copy of a picture at rest answers every
//! question about what is under the cursor until the view moves on. The copy stays mapped; a
//! question reads a few texels of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use glam::{DVec2, DVec3};

use crate::gpu::Gpu;
use crate::lens::Lens;
use crate::passes::Targets;

/// How far round the cursor a surface is looked for where it lies on the background, in pixels.
const SEARCH_PX: i64 = 3;
/// What is no farther behind the surface than so many pixels are long is on it.
const NEAR_SURFACE_PX: f64 = 4.0;

/// Copies of the depth of pictures.
#[derive(Default)]
pub struct DepthReader {
    latest: Option<DepthPicture>,
    pending: Option<(DepthPicture, Arc<AtomicU8>)>,
}

const PENDING: u8 = 0;
const MAPPED: u8 = 1;
const FAILED: u8 = 2;

/// One copy.
pub struct DepthPicture {
    buffer: wgpu::Buffer,
    /// Bytes from one row to the next.
    row_bytes: u64,
    /// How the picture was taken.
    pub lens: Lens,
}

impl DepthReader {
    /// Copies the depth of the picture that was drawn last through `lens`. Does nothing while
    /// an earlier copy is still on its way.
    pub fn copy(&mut self, gpu: &Gpu, targets: &Targets, lens: Lens) {
        self.poll();
        if self.pending.is_some() {
            return;
        }
        let row_bytes = (targets.width() * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("depth read back"),
            size: u64::from(row_bytes) * u64::from(targets.height()),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                texture: targets.depth(),
                mip_level: 0,
                origin: wgpu::Origin3d::ZERO,
                aspect: wgpu::TextureAspect::DepthOnly,
            },
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row_bytes),
                    rows_per_image: None,
                },
            },
            targets.depth().size(),
        );
        gpu.queue.submit([encoder.finish()]);
        let state = Arc::new(AtomicU8::new(PENDING));
        let told = state.clone();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            told.store(if result.is_ok() { MAPPED } else { FAILED }, Ordering::Release);
        });
        self.pending = Some((DepthPicture { buffer, row_bytes: row_bytes.into(), lens }, state));
    }

    /// Takes a copy that has arrived; true where there is a new one.
    pub fn poll(&mut self) -> bool {
        let state = self.pending.as_ref().map(|(_, state)| state.load(Ordering::Acquire));
        if state.is_none_or(|state| state == PENDING) {
            return false;
        }
        match self.pending.take() {
            Some((picture, _)) if state == Some(MAPPED) => {
                self.latest = Some(picture);
                true
            }
            _ => false,
        }
    }

    /// The newest copy.
    pub fn latest(&self) -> Option<&DepthPicture> {
        self.latest.as_ref()
    }

    /// Whether the newest copy, or the one on its way, shows this view.
    pub fn covers(&self, lens: &Lens) -> bool {
        let pending = self.pending.as_ref().map(|(picture, _)| picture);
        self.latest.iter().chain(pending).any(|picture| picture.lens == *lens)
    }
}

impl DepthPicture {
    /// Depth of the surface at a pixel, or of the nearest one a few pixels round it, along the
    /// line of sight in world units.
    pub fn depth_at(&self, pixel: DVec2) -> Option<f64> {
        let (x, y) = (pixel.x.floor() as i64, pixel.y.floor() as i64);
        let mut nearest: Option<(i64, f64)> = None;
        for dy in -SEARCH_PX..=SEARCH_PX {
            for dx in -SEARCH_PX..=SEARCH_PX {
                let away = dx * dx + dy * dy;
                if nearest.is_none_or(|(least, _)| away < least)
                    && let Some(depth) = self.texel(x + dx, y + dy)
                {
                    nearest = Some((away, depth));
                }
            }
        }
        nearest.map(|(_, depth)| depth)
    }

    /// All of it at once, for many questions.
    pub fn read(&self) -> Option<DepthView> {
        Some(DepthView {
            bytes: self.buffer.get_mapped_range(..).ok()?,
            row_bytes: self.row_bytes as usize,
            lens: self.lens,
        })
    }

    fn texel(&self, x: i64, y: i64) -> Option<f64> {
        let (width, height) = (self.lens.size.x as i64, self.lens.size.y as i64);
        if x < 0 || y < 0 || x >= width || y >= height {
            return None;
        }
        // Ranges of mapped buffers begin at multiples of eight.
        let at = y as u64 * self.row_bytes + (x as u64 / 2) * 8;
        let mapped = self.buffer.get_mapped_range(at..at + 8).ok()?;
        let bytes: [u8; 8] = mapped[..].try_into().ok()?;
        let [a, b]: [f32; 2] = bytemuck::cast(bytes);
        self.lens.depth_from_buffer(f64::from(if x % 2 == 0 { a } else { b }))
    }
}

/// The depth of a picture while it is being read.
pub struct DepthView {
    bytes: wgpu::BufferView,
    row_bytes: usize,
    lens: Lens,
}

impl DepthView {
    /// Whether the surface hides a point. What is nearer than a few pixels' length behind it is not
    /// hidden: the surface is shown with an error, and marks are on it.
    pub fn hides(&self, point: DVec3) -> bool {
        let Some(pixel) = self.lens.pixel_of(point) else { return false };
        let depth = self.lens.depth_of(point);
        let slack = NEAR_SURFACE_PX * self.lens.pixel_length(depth);
        let (x, y) = (pixel.x.floor() as i64, pixel.y.floor() as i64);
        // Of its neighbourhood the farthest: on outlines and steep slopes a pixel decides little.
        let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
        around.into_iter().all(|(x, y)| {
            self.buffer_at(x, y).is_some_and(|value| {
                self.lens.depth_from_buffer(value).is_some_and(|surface| surface + slack < depth)
            })
        })
    }

    fn buffer_at(&self, x: i64, y: i64) -> Option<f64> {
        let (width, height) = (self.lens.size.x as i64, self.lens.size.y as i64);
        if x < 0 || y < 0 || x >= width || y >= height {
            return None;
        }
        let at = y as usize * self.row_bytes + x as usize * 4;
        let bytes = self.bytes.get(at..at + 4)?;
        Some(f64::from(f32::from_le_bytes(bytes.try_into().ok()?)))
    }
}
