//! What passes are made of and bound with: pipelines, layouts, bind groups, attachments and buffers.

use super::targets::DEPTH_FORMAT;
use super::{FrameUniform, UNIFORM_STRIDE};
use crate::arena::Arena;
use crate::gpu::Gpu;

/// What pipelines are compiled with: see `CLIPPED` in `shared.wgsl`.
pub(super) type Constants = [(&'static str, f64); 1];

pub(super) fn constants(is_clipped: bool) -> Constants {
    [("CLIPPED", f64::from(u8::from(is_clipped)))]
}

/// The same where threads share a tile. A processor does eight at a time, and the others of a workgroup after them: each of
/// these would look at the tile again, which takes longer than its samples.
pub(super) fn of_tiles(gpu: &Gpu) -> [(&'static str, f64); 2] {
    let threads = if gpu.is_software() { 8.0 } else { 64.0 };
    [constants(false)[0], ("TILE_THREADS", threads)]
}

pub(super) fn with(constants: &Constants) -> wgpu::PipelineCompilationOptions<'_> {
    wgpu::PipelineCompilationOptions { constants, ..Default::default() }
}

pub(super) fn pipeline_layout(
    gpu: &Gpu,
    label: &str,
    groups: &[Option<&wgpu::BindGroupLayout>],
) -> wgpu::PipelineLayout {
    gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: groups,
        immediate_size: 0,
    })
}

/// Writes depth, reversed, where nothing nearer was drawn.
pub(super) fn nearest() -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH_FORMAT,
        depth_write_enabled: Some(true),
        depth_compare: Some(wgpu::CompareFunction::Greater),
        stencil: Default::default(),
        bias: Default::default(),
    }
}

/// The pipeline of a pass' vertices and fragments.
pub(super) fn render_pipeline(
    gpu: &Gpu,
    layout: &wgpu::PipelineLayout,
    pass: hlod_shaders::Pass,
    cull_mode: Option<wgpu::Face>,
    target: wgpu::TextureFormat,
    depth: wgpu::DepthStencilState,
    constants: &Constants,
) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(pass.name),
        source: wgpu::ShaderSource::Wgsl(pass.source.into()),
    });
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(pass.name),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some(&format!("{}_vertex", pass.name)),
            compilation_options: with(constants),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState { cull_mode, ..Default::default() },
        depth_stencil: Some(depth),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(&format!("{}_fragment", pass.name)),
            compilation_options: with(constants),
            targets: &[Some(target.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Pipelines for some of a pass' entry points.
pub(super) fn compute_pipelines<const N: usize>(
    gpu: &Gpu,
    groups: &[Option<&wgpu::BindGroupLayout>],
    pass: hlod_shaders::Pass,
    entry_points: [&str; N],
    constants: &[(&'static str, f64)],
) -> [wgpu::ComputePipeline; N] {
    let layout = pipeline_layout(gpu, pass.name, groups);
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(pass.name),
        source: wgpu::ShaderSource::Wgsl(pass.source.into()),
    });
    entry_points.map(|entry_point| {
        gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry_point),
            layout: Some(&layout),
            module: &module,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                ..Default::default()
            },
            cache: None,
        })
    })
}

/// A storage buffer of a bind group's layout.
pub(super) fn storage_entry(
    binding: u32,
    visibility: wgpu::ShaderStages,
    read_only: bool,
) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    }
}

pub(super) fn entry(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}

/// Of frame uniforms and arenas: the first group of every pipeline.
pub(super) fn geometry_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let storage = |binding, visibility| storage_entry(binding, visibility, true);
    let every = wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE;
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("geometry"),
        entries: &[
            wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: every,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: true,
                    min_binding_size: std::num::NonZeroU64::new(size_of::<FrameUniform>() as u64),
                },
                count: None,
            },
            storage(1, every),
            storage(2, every),
            storage(3, wgpu::ShaderStages::FRAGMENT),
            storage(4, wgpu::ShaderStages::FRAGMENT),
        ],
    })
}

/// An arena and a uniform, whose place in the buffer is given when it is bound.
pub(super) fn geometry_group(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    uniforms: &wgpu::Buffer,
    arena: &Arena,
) -> wgpu::BindGroup {
    let entries = [
        wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: uniforms,
                offset: 0,
                size: std::num::NonZeroU64::new(size_of::<FrameUniform>() as u64),
            }),
        },
        entry(1, &arena.vertices),
        entry(2, &arena.indices),
        entry(3, &arena.colours),
        entry(4, &arena.scalars),
    ];
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("geometry"),
        layout,
        entries: &entries,
    })
}

/// Groups of arenas with the offsets of their uniforms, which begin at number `first`.
pub(super) fn geometry_from(
    groups: &[wgpu::BindGroup],
    first: usize,
) -> Vec<(&wgpu::BindGroup, u32)> {
    let offset = |i: usize| ((first + i) as u64 * UNIFORM_STRIDE) as u32;
    groups.iter().enumerate().map(|(i, group)| (group, offset(i))).collect()
}

pub(super) fn attachment(
    view: &wgpu::TextureView,
    clear: wgpu::Color,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    Some(wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load: wgpu::LoadOp::Clear(clear), store: wgpu::StoreOp::Store },
    })
}

pub(crate) fn buffer(
    gpu: &Gpu,
    label: &'static str,
    size: u64,
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// Writes to the start of a buffer, replacing it by a larger one where it is too small.
pub(crate) fn write_growing(gpu: &Gpu, target: &mut wgpu::Buffer, bytes: &[u8]) {
    if bytes.is_empty() {
        return;
    }
    if target.size() < bytes.len() as u64 {
        *target = buffer(gpu, "grown", (bytes.len() as u64).next_power_of_two(), target.usage());
    }
    gpu.queue.write_buffer(target, 0, bytes);
}
