//! Pictures that explain themselves: levels of detail by colour, or where nodes end.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{buffer, entry, write_growing};
use crate::gpu::Gpu;
use crate::scene::Paint;
use crate::skeleton::Node;

/// A node that is drawn; see `Part` in `explain.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct DrawnPart {
    /// Lowest corner of its cell, model space.
    low: Vec3,
    /// Number of its first triangle among all arenas.
    first: u32,
    high: Vec3,
    depth: u32,
}

impl DrawnPart {
    pub(crate) fn new(node: &Node, first: u32) -> DrawnPart {
        let [low, high] = node.cell_box.map(|corner| corner.as_vec3());
        DrawnPart { low, first, high, depth: node.depth.into() }
    }
}

/// The pass that stands in for shading.
pub(super) struct Explain {
    depth: wgpu::RenderPipeline,
    borders: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    parts: wgpu::Buffer,
}

impl Explain {
    pub(super) fn new(
        gpu: &Gpu,
        geometry: &wgpu::BindGroupLayout,
        output: wgpu::TextureFormat,
        depth: wgpu::DepthStencilState,
    ) -> Explain {
        let device = &gpu.device;
        let binding = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("explain"),
            entries: &[
                binding(
                    0,
                    wgpu::BindingType::Texture {
                        sample_type: wgpu::TextureSampleType::Uint,
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: false,
                    },
                ),
                binding(
                    1,
                    wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Storage { read_only: true },
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                ),
            ],
        });
        let pass = hlod_shaders::EXPLAIN;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(pass.name),
            source: wgpu::ShaderSource::Wgsl(pass.source.into()),
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(pass.name),
            bind_group_layouts: &[Some(geometry), Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = |fragment| {
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(pass.name),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("explain_vertex"),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                primitive: Default::default(),
                depth_stencil: Some(depth.clone()),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(fragment),
                    compilation_options: Default::default(),
                    targets: &[Some(output.into())],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        Explain {
            depth: pipeline("depth_fragment"),
            borders: pipeline("borders_fragment"),
            parts: buffer(gpu, "parts", 1 << 10, wgpu::BufferUsages::STORAGE),
            layout,
        }
    }

    /// Uploads the nodes drawn, of which there is at least one, for the identities of a picture.
    pub(super) fn parts(
        &mut self,
        gpu: &Gpu,
        parts: &[DrawnPart],
        identities: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        let mut sorted = parts.to_vec();
        sorted.sort_by_key(|part| part.first);
        // What lies behind them in the buffer begins after everything.
        let last = DrawnPart { first: u32::MAX, ..DrawnPart::zeroed() };
        let room = self.parts.size() as usize / size_of::<DrawnPart>();
        let fill = sorted.len().next_power_of_two().max(room);
        sorted.resize(fill, last);
        write_growing(gpu, &mut self.parts, bytemuck::cast_slice(&sorted));
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("explain"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(identities),
                },
                entry(1, &self.parts),
            ],
        })
    }

    /// What draws paint with from here on.
    pub(super) fn begin(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        parts: &wgpu::BindGroup,
        paint: Paint,
    ) {
        pass.set_pipeline(if paint == Paint::Depth { &self.depth } else { &self.borders });
        pass.set_bind_group(1, parts, &[]);
    }
}
