//! What a frame is drawn into, and which part of a picture that is.

use super::resources::buffer;
use crate::gpu::Gpu;

/// A part of a picture, in pixels from its upper left corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rectangle {
    /// Left side.
    pub x: u32,
    /// Upper side.
    pub y: u32,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Rectangle {
    /// All of it.
    pub fn all(targets: &Targets) -> Rectangle {
        Rectangle { x: 0, y: 0, width: targets.width(), height: targets.height() }
    }
}

/// Where what is drawn lies in the picture that it is a part of. Levels, light and skirts are those of
/// the whole picture, and pixels of a part equal those of the whole bit for bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Pixels in a row of the whole picture.
    pub picture_width: u32,
    /// Its rows.
    pub picture_height: u32,
    /// Left side of the part.
    pub x: u32,
    /// Its upper side.
    pub y: u32,
    /// Whether parts must agree: everything is then rasterised in compute, where the adapter can.
    pub is_part: bool,
    /// Whether what nothing is drawn on is transparent instead of the background.
    pub transparent: bool,
}

impl Window {
    /// A picture in one piece.
    pub fn whole(width: u32, height: u32) -> Window {
        let (picture_width, picture_height) = (width, height);
        Window { picture_width, picture_height, x: 0, y: 0, is_part: false, transparent: false }
    }

    /// Width and height of the whole picture.
    pub fn picture(&self) -> (u32, u32) {
        (self.picture_width, self.picture_height)
    }
}

/// Directions and depths as [`Targets::relief`] has them.
pub(super) const RELIEF_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// Textures that a frame is drawn into.
pub struct Targets {
    identity: wgpu::Texture,
    depth: wgpu::Texture,
    /// The picture.
    pub colour: wgpu::TextureView,
    window: Window,
    identity_view: wgpu::TextureView,
    /// A number a pixel; made when shadows are first drawn.
    occlusion: std::sync::OnceLock<wgpu::Buffer>,
    /// Made when relief is first looked at.
    relief: std::sync::OnceLock<wgpu::TextureView>,
}

pub(super) const IDENTITY_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

impl Targets {
    /// Identity and depth for pictures of `colour`, which has this size.
    pub fn new(gpu: &Gpu, colour: wgpu::TextureView, width: u32, height: u32) -> Targets {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC;
        let texture = |label, format| gpu.texture(label, (width, height), format, usage, &[]);
        let identity = texture("identity", IDENTITY_FORMAT);
        Targets {
            identity_view: identity.create_view(&Default::default()),
            identity,
            depth: texture("depth", DEPTH_FORMAT),
            colour,
            window: Window::whole(width, height),
            occlusion: std::sync::OnceLock::new(),
            relief: std::sync::OnceLock::new(),
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.identity.width()
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.identity.height()
    }

    /// Which part of which picture this is.
    pub fn window(&self) -> Window {
        self.window
    }

    /// Shows another part from now on.
    pub(crate) fn show(&mut self, window: Window) {
        self.window = window;
    }

    /// Identity of the triangle seen in each pixel: 0 for none, bit 31 for its back.
    pub fn identity(&self) -> &wgpu::Texture {
        &self.identity
    }

    pub(crate) fn identity_view(&self) -> &wgpu::TextureView {
        &self.identity_view
    }

    /// How much of the light is hidden from each pixel's point, in 65535ths, row by row; unknown
    /// before shadows were drawn and where no point is.
    pub(crate) fn occlusion(&self, gpu: &Gpu) -> &wgpu::Buffer {
        self.occlusion.get_or_init(|| {
            let bytes = 4 * u64::from(self.width()) * u64::from(self.height());
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            buffer(gpu, "occlusion", bytes, usage)
        })
    }

    /// Of each pixel the direction of its surface as the eye sees it, and its depth.
    pub(super) fn relief(&self, gpu: &Gpu) -> &wgpu::TextureView {
        self.relief.get_or_init(|| relief_texture(gpu, (self.width(), self.height())))
    }

    /// Reversed depth, f32.
    pub fn depth(&self) -> &wgpu::Texture {
        &self.depth
    }
}

/// A texture for directions and depths.
pub(super) fn relief_texture(gpu: &Gpu, size: (u32, u32)) -> wgpu::TextureView {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
    gpu.texture("relief", size, RELIEF_FORMAT, usage, &[]).create_view(&Default::default())
}
