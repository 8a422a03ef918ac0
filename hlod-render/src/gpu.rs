//! The adapter, and reading pictures back from it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use crate::error::RenderError;

/// A device with what the renderer needs.
pub struct Gpu {
    /// The logical device.
    pub device: wgpu::Device,
    /// Its only queue.
    pub queue: wgpu::Queue,
    /// What it is.
    pub info: wgpu::AdapterInfo,
    /// Whether small triangles are rasterised in compute, which takes 64-bit atomics: where the
    /// adapter has them, unless this is set to false before a renderer is made.
    pub small_triangles: bool,
    /// Whether it was opened to take the time of a frame's stages.
    pub(crate) is_timed: bool,
    /// What first went wrong with the device, if anything has: nothing after it can be trusted.
    trouble: Arc<Mutex<Option<String>>>,
    /// Bytes of geometry that the adapter is taken to have left.
    geometry_left: AtomicU64,
}

/// Which adapter to use.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// A real GPU where there is one, else a software rasteriser.
    #[default]
    Best,
    /// The software rasteriser (tests).
    Software,
}

fn headless_adapter(choice: AdapterChoice) -> Result<wgpu::Adapter, RenderError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        force_fallback_adapter: choice == AdapterChoice::Software,
        compatible_surface: None,
        ..Default::default()
    }))
    .map_err(|e| RenderError::NoAdapter(e.to_string()))
}

impl Gpu {
    /// Opens an adapter without a window.
    ///
    /// # Errors
    /// When there is none, or it lacks something.
    pub fn headless(choice: AdapterChoice) -> Result<Gpu, RenderError> {
        Gpu::open(&headless_adapter(choice)?)
    }

    /// The same, with no binding larger than so many bytes. For tests of what happens where much is drawn.
    #[doc(hidden)]
    pub fn headless_binding(choice: AdapterChoice, bytes: u64) -> Result<Gpu, RenderError> {
        Gpu::with(&headless_adapter(choice)?, bytes, false)
    }

    /// The same, to take the time of a frame's stages ([`crate::frame::Renderer::stage_times`]), which itself takes a
    /// little.
    ///
    /// # Errors
    /// Also when the adapter has no clock for stages.
    pub fn headless_timed(choice: AdapterChoice) -> Result<Gpu, RenderError> {
        Gpu::with(&headless_adapter(choice)?, u64::MAX, true)
    }

    /// Opens an adapter that was chosen elsewhere (for a window).
    ///
    /// # Errors
    /// When it lacks something.
    pub fn open(adapter: &wgpu::Adapter) -> Result<Gpu, RenderError> {
        Gpu::with(adapter, u64::MAX, false)
    }

    fn with(adapter: &wgpu::Adapter, bytes: u64, is_timed: bool) -> Result<Gpu, RenderError> {
        let info = adapter.get_info();
        let supported = adapter.limits();
        // Geometry lies in storage buffers as large as the adapter allows.
        let limits = wgpu::Limits {
            max_storage_buffer_binding_size: supported.max_storage_buffer_binding_size.min(bytes),
            max_buffer_size: supported.max_buffer_size,
            max_texture_dimension_2d: supported.max_texture_dimension_2d,
            ..wgpu::Limits::default()
        };
        let atomics = wgpu::Features::SHADER_INT64 | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX;
        let small_triangles = adapter.features().contains(atomics);
        let clock = wgpu::Features::TIMESTAMP_QUERY
            | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS
            | wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES;
        if is_timed && !adapter.features().contains(clock) {
            let why = "it has no clock for the stages of a frame".to_string();
            return Err(RenderError::Gpu { adapter: info.name, why });
        }
        let mut required_features = wgpu::Features::empty();
        required_features.set(atomics, small_triangles);
        required_features.set(clock, is_timed);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("hlod-render"),
            required_features,
            required_limits: limits,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| RenderError::Gpu { adapter: info.name.clone(), why: e.to_string() })?;
        let trouble = Arc::new(Mutex::new(None));
        let (of_errors, of_loss) = (trouble.clone(), trouble.clone());
        // Left alone, wgpu would end the process.
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            note(&of_errors, error.to_string());
        }));
        device.set_device_lost_callback(move |reason, why| {
            // Drivers need not say why.
            let why = if why.is_empty() { why } else { format!(": {why}") };
            note(&of_loss, format!("its device was lost ({reason:?}){why}"));
        });
        let geometry_left = AtomicU64::new(u64::MAX);
        Ok(Gpu { device, queue, info, small_triangles, is_timed, trouble, geometry_left })
    }

    /// That nothing has gone wrong with the device so far: a driver that failed, a GPU that was taken away,
    /// memory that was refused.
    ///
    /// # Errors
    /// What first went wrong, from then on.
    pub fn check(&self) -> Result<(), RenderError> {
        // Of a lost device one is told on asking.
        let polled = self.device.poll(wgpu::PollType::Poll);
        let trouble = self.trouble.lock().ok().and_then(|trouble| trouble.clone());
        let trouble = trouble.or_else(|| polled.err().map(|error| error.to_string()));
        trouble.map_or(Ok(()), |why| Err(self.error(why)))
    }

    /// From now on the adapter is taken to have room for so many bytes of geometry more. For tests of what
    /// happens without.
    #[doc(hidden)]
    pub fn pretend_geometry_bytes(&self, bytes: u64) {
        self.geometry_left.store(bytes, Ordering::SeqCst);
    }

    /// Runs `make`, which makes buffers of so many bytes for geometry; none where there is no memory for
    /// them.
    pub(crate) fn with_room<T>(&self, bytes: u64, make: impl FnOnce() -> T) -> Option<T> {
        let take = |left: u64| if left == u64::MAX { Some(left) } else { left.checked_sub(bytes) };
        self.geometry_left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, take).ok()?;
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let made = make();
        pollster::block_on(scope.pop()).is_none().then_some(made)
    }

    /// Whether processors draw.
    pub(crate) fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// Name, kind and driver, as in `llvmpipe (Cpu, Vulkan, Mesa 22.3.6)`.
    pub fn describe(&self) -> String {
        let i = &self.info;
        format!("{} ({:?}, {}, {})", i.name, i.device_type, i.backend, i.driver_info)
    }

    /// Waits until everything submitted has been done.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn wait(&self) -> Result<(), RenderError> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map(drop)
            .map_err(|e| self.error(e.to_string()))?;
        self.check()
    }

    pub(crate) fn error(&self, why: impl Into<String>) -> RenderError {
        RenderError::Gpu { adapter: self.info.name.clone(), why: why.into() }
    }

    /// A flat texture of one sample a pixel; width and height must be at least 1 and within the
    /// adapter's limits. `view_formats` are those besides `format` in which it may be seen.
    pub(crate) fn texture(
        &self,
        label: &str,
        (width, height): (u32, u32),
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
        view_formats: &[wgpu::TextureFormat],
    ) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats,
        })
    }

    /// Copies a texture of four bytes a pixel to memory, row by row from the top.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read_texture(
        &self,
        texture: &wgpu::Texture,
        aspect: wgpu::TextureAspect,
    ) -> Result<Vec<u8>, RenderError> {
        let (width, height) = (texture.width(), texture.height());
        let row = width * 4;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: u64::from(padded) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: wgpu::Origin3d::ZERO,
                aspect,
            },
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(padded),
                    rows_per_image: None,
                },
            },
            texture.size(),
        );
        self.queue.submit([encoder.finish()]);
        let mapped = self.map(&buffer)?;
        let mut out = Vec::with_capacity((row * height) as usize);
        for line in mapped.chunks_exact(padded as usize) {
            out.extend_from_slice(&line[..row as usize]);
        }
        Ok(out)
    }

    /// Copies the first bytes of a buffer to memory.
    ///
    /// # Errors
    /// When the device is lost.
    pub(crate) fn read_buffer(
        &self,
        source: &wgpu::Buffer,
        bytes: u64,
    ) -> Result<Vec<u8>, RenderError> {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: bytes,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(source, 0, &buffer, 0, bytes);
        self.queue.submit([encoder.finish()]);
        Ok(self.map(&buffer)?.to_vec())
    }

    fn map(&self, buffer: &wgpu::Buffer) -> Result<wgpu::BufferView, RenderError> {
        buffer.map_async(wgpu::MapMode::Read, .., |_| {});
        self.wait()?;
        buffer.get_mapped_range(..).map_err(|e| self.error(e.to_string()))
    }
}

/// Keeps what went wrong first: the rest mostly follows from it.
fn note(trouble: &Mutex<Option<String>>, what: String) {
    if let Ok(mut trouble) = trouble.lock() {
        trouble.get_or_insert(what);
    }
}
