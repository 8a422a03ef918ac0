//! Pictures that explain themselves: levels of detail, bounds or kinds of primitives by colour, where nodes end, or
//! every triangle's edges.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use hlod_compress::RepresentationKind;
use hlod_compress::srgb::linear_from_srgb;

use super::resources::{buffer, entry, write_growing};
use crate::colour_map::bound_colour;
use crate::gpu::Gpu;
use crate::scene::Paint;
use crate::skeleton::{Node, NodeRepresentation};

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
    /// What stands for its bound, linear light.
    bound_colour: Vec3,
    /// Whether it is the scan itself, 0 or 1.
    is_leaf: u32,
}

impl DrawnPart {
    /// `bounds` are those of the file, see [`crate::colour_map::bounds_shown`].
    pub(crate) fn new(
        node: &Node,
        representation: &NodeRepresentation,
        first: u32,
        bounds: [f64; 2],
    ) -> DrawnPart {
        let [low, high] = node.cell_box.map(|corner| corner.as_vec3());
        let is_leaf = representation.kind == RepresentationKind::Source;
        let srgb = bound_colour(representation.geometric_error, bounds);
        DrawnPart {
            low,
            first,
            high,
            depth: node.depth.into(),
            bound_colour: Vec3::from_array(srgb.map(linear_from_srgb)),
            is_leaf: is_leaf.into(),
        }
    }
}

/// What is painted instead of shading, and by what.
const EXPLAINING: [(Paint, &str); 5] = [
    (Paint::Depth, "depth_fragment"),
    (Paint::Borders, "borders_fragment"),
    (Paint::Bound, "bound_fragment"),
    (Paint::Kinds, "kinds_fragment"),
    (Paint::Edges, "edges_fragment"),
];

/// Whether a paint stands in for shading.
pub(super) fn explains(paint: Paint) -> bool {
    EXPLAINING.iter().any(|(explaining, _)| *explaining == paint)
}

/// The pass that stands in for shading.
pub(super) struct Explain {
    /// One for each of [`EXPLAINING`].
    pipelines: [wgpu::RenderPipeline; 5],
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
            pipelines: EXPLAINING.map(|(_, fragment)| pipeline(fragment)),
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
        let number = EXPLAINING.iter().position(|(explaining, _)| *explaining == paint);
        debug_assert!(number.is_some(), "{paint:?} is shaded");
        pass.set_pipeline(&self.pipelines[number.unwrap_or(0)]);
        pass.set_bind_group(1, parts, &[]);
    }
}
