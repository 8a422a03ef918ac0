//! Hard shadows with maps, to be compared with those without: see `map.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec2};

use super::resources::{
    buffer, compute_pipelines, constants, entry, storage_entry, with, write_growing,
};
use super::shadow::LightFace;
use super::targets::DEPTH_FORMAT;
use super::{Range, Rectangle, Targets};
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::shadow_map::{MapCount, MapProjection, ShadowMap, TEXEL_MAX_PX};

/// See `ShadowMap` in `map.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct MapState {
    /// Columns of three.
    homography: [[f32; 4]; 3],
    size: i32,
    error: f32,
    spread_max: f32,
    texel_max: f32,
    low: [f32; 2],
    high: [f32; 2],
    reach: f32,
    is_fallback: u32,
    is_fixed: u32,
    _room: u32,
    judged: u32,
    denied: u32,
    largest: [u32; 10],
}

/// Texels across the line of sight may differ by as much from the nearest visible point to the farthest.
const SPREAD_MAX: f32 = 64.0;
/// Pixels of a workgroup's side.
const SIDE: u32 = 8;
/// Pixels that `measure_map` has in a column, and columns of a workgroup.
const COLUMN: u32 = 64;

/// Pipelines, made when maps are first drawn, and what they are bound with.
pub(super) struct ShadowMaps {
    measure: wgpu::ComputePipeline,
    fit: wgpu::ComputePipeline,
    look_up: wgpu::ComputePipeline,
    draw_culled: wgpu::RenderPipeline,
    draw_two_sided: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    draw_layout: wgpu::BindGroupLayout,
    depths: wgpu::TextureView,
    indirect: wgpu::Buffer,
    /// Of the last frame, for each face of the light; and whether there is nothing but a uniform map for it.
    states: Vec<(wgpu::Buffer, bool)>,
}

/// What a frame draws maps with.
pub(crate) struct MapPlan {
    pub(crate) map: ShadowMap,
    /// One for each face; see [`crate::shadow_map::homography`].
    pub(crate) homographies: Vec<Option<DMat3>>,
    /// What the picture of each face shows; where that is not fitted to what is visible.
    pub(crate) fixed: Option<Vec<[DVec2; 2]>>,
    /// Of parallel light how far anything is from the middle of light space; of lamps the least distance at which
    /// anything casts.
    pub(crate) reach: f32,
}

/// What one frame gives to the passes.
pub(super) struct MapWork {
    /// To measure, fit and look up; to draw. For each face.
    groups: Vec<[wgpu::BindGroup; 2]>,
    /// Uniform, whether backs are dropped, and how many draws there are of both.
    draws: Vec<(usize, bool, u32)>,
    area: Rectangle,
}

impl ShadowMaps {
    pub(super) fn new(gpu: &Gpu, geometry_layout: &wgpu::BindGroupLayout) -> ShadowMaps {
        let device = &gpu.device;
        let compute = wgpu::ShaderStages::COMPUTE;
        let storage = |binding| storage_entry(binding, compute, false);
        let depths = wgpu::BindGroupLayoutEntry {
            binding: 4,
            visibility: compute,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Depth,
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        };
        let group_layout = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries };
            device.create_bind_group_layout(&descriptor)
        };
        let layout = group_layout("map", &[storage(1), storage(2), storage(3), depths]);
        let both = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let draw_layout = group_layout("map draw", &[storage_entry(0, both, true)]);
        let groups = [Some(geometry_layout), Some(&layout)];
        let names = ["measure_map", "fit", "look_up"];
        let [measure, fit, look_up] =
            compute_pipelines(gpu, &groups, hlod_shaders::MAP, names, &constants(false));
        let pass = hlod_shaders::MAP_DRAW;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(pass.name),
            source: wgpu::ShaderSource::Wgsl(pass.source.into()),
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(pass.name),
            bind_group_layouts: &[Some(geometry_layout), Some(&draw_layout)],
            immediate_size: 0,
        });
        let draw = |cull_mode| {
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(pass.name),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("map_draw_vertex"),
                    compilation_options: with(&constants(false)),
                    buffers: &[],
                },
                // Its rows go downwards, which turns triangles over.
                primitive: wgpu::PrimitiveState {
                    cull_mode,
                    front_face: wgpu::FrontFace::Cw,
                    ..Default::default()
                },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH_FORMAT,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(wgpu::CompareFunction::Greater),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some("map_draw_fragment"),
                    compilation_options: with(&constants(false)),
                    targets: &[],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        ShadowMaps {
            measure,
            fit,
            look_up,
            draw_culled: draw(Some(wgpu::Face::Back)),
            draw_two_sided: draw(None),
            layout,
            draw_layout,
            depths: depths_of(gpu, 1),
            indirect: buffer(gpu, "map draws", 1024 * 16, wgpu::BufferUsages::INDIRECT),
            states: Vec::new(),
        }
    }

    /// `samples` are those of shadows without maps. `casting` comes in the order of uniforms
    /// and whether backs are dropped.
    pub(super) fn prepare(
        &mut self,
        gpu: &Gpu,
        samples: &wgpu::Buffer,
        plan: &MapPlan,
        casting: &[&Range],
        targets: &Targets,
        area: Rectangle,
    ) -> MapWork {
        if self.depths.texture().width() != plan.map.size {
            self.depths = depths_of(gpu, plan.map.size);
        }
        let indirect: Vec<[u32; 4]> = casting
            .iter()
            .map(|r| [3 * (r.triangles.end - r.triangles.start), 1, 3 * r.triangles.start, 0])
            .collect();
        write_growing(gpu, &mut self.indirect, bytemuck::cast_slice(&indirect));
        let alike = |a: &&Range, b: &&Range| (a.uniform, a.cull_backs) == (b.uniform, b.cull_backs);
        let draws = casting
            .chunk_by(alike)
            .map(|group| (group[0].uniform, group[0].cull_backs, group.len() as u32))
            .collect();
        let error = casting.iter().map(|r| r.error).fold(0.0, f32::max);
        let is_uniform =
            matches!(plan.map.projection, MapProjection::Plain | MapProjection::Uniform);
        self.states.clear();
        let mut groups = Vec::new();
        for (face, homography) in plan.homographies.iter().enumerate() {
            let fixed = plan.fixed.as_ref().map(|fixed| fixed[face]);
            let state = MapState::new(homography.as_ref(), fixed, plan, error);
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let buffer = buffer(gpu, "map state", size_of::<MapState>() as u64, usage);
            gpu.queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&state));
            let group = |label, layout, entries: &[wgpu::BindGroupEntry<'_>]| {
                let descriptor = wgpu::BindGroupDescriptor { label: Some(label), layout, entries };
                gpu.device.create_bind_group(&descriptor)
            };
            let depths = wgpu::BindGroupEntry {
                binding: 4,
                resource: wgpu::BindingResource::TextureView(&self.depths),
            };
            let looked_up =
                [entry(1, samples), entry(2, &buffer), entry(3, targets.occlusion(gpu)), depths];
            let drawn = [entry(0, &buffer)];
            groups.push([
                group("map", &self.layout, &looked_up),
                group("map draw", &self.draw_layout, &drawn),
            ]);
            self.states.push((buffer, homography.is_none() && !is_uniform));
        }
        MapWork { groups, draws, area }
    }

    /// After samples were placed.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        work: &MapWork,
        number: usize,
        face: &LightFace<'_>,
    ) {
        let Some(&(first, first_offset)) = face.casters.first() else { return };
        let Rectangle { width, height, .. } = work.area;
        let [looked_up, drawn] = &work.groups[number];
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_bind_group(0, first, &[first_offset]);
            pass.set_bind_group(1, looked_up, &[]);
            pass.set_pipeline(&self.measure);
            pass.dispatch_workgroups(width.div_ceil(COLUMN), height.div_ceil(COLUMN), 1);
            pass.set_pipeline(&self.fit);
            pass.dispatch_workgroups(1, 1, 1);
        }
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("map"),
                color_attachments: &[],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &self.depths,
                    depth_ops: Some(wgpu::Operations {
                        load: wgpu::LoadOp::Clear(0.0),
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            pass.set_bind_group(1, drawn, &[]);
            let mut at = 0;
            for &(uniform, cull_backs, count) in &work.draws {
                let (bind_group, offset) = face.casters[uniform];
                pass.set_pipeline(match cull_backs {
                    true => &self.draw_culled,
                    false => &self.draw_two_sided,
                });
                pass.set_bind_group(0, bind_group, &[offset]);
                pass.multi_draw_indirect(&self.indirect, at * 16, count);
                at += u64::from(count);
            }
        }
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_bind_group(0, first, &[first_offset]);
        pass.set_bind_group(1, looked_up, &[]);
        pass.set_pipeline(&self.look_up);
        pass.dispatch_workgroups(width.div_ceil(SIDE), height.div_ceil(SIDE), 1);
    }

    /// What came of the last frame's maps; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub(super) fn count(&self, gpu: &Gpu) -> Result<MapCount, RenderError> {
        let mut count = MapCount::default();
        for (state, is_fallback) in &self.states {
            let bytes = gpu.read_buffer(state, size_of::<MapState>() as u64)?;
            let state: MapState = bytemuck::pod_read_unaligned(&bytes);
            // Faces on which nothing is seen have no map.
            let is_used = state.largest[0] != 0;
            count.maps += u32::from(is_used);
            count.fallbacks += u32::from(is_used && (*is_fallback || state.is_fallback != 0));
            count.judged += u64::from(state.judged);
            count.denied += u64::from(state.denied);
        }
        Ok(count)
    }
}

impl MapState {
    fn new(
        homography: Option<&DMat3>,
        fixed: Option<[DVec2; 2]>,
        plan: &MapPlan,
        error: f32,
    ) -> MapState {
        let [low, high] = fixed.unwrap_or_default().map(|corner| corner.as_vec2().to_array());
        let columns = homography.unwrap_or(&DMat3::IDENTITY).to_cols_array_2d();
        MapState {
            homography: columns.map(|[x, y, z]| [x as f32, y as f32, z as f32, 0.0]),
            size: plan.map.size as i32,
            error,
            spread_max: SPREAD_MAX,
            texel_max: TEXEL_MAX_PX,
            reach: plan.reach,
            is_fixed: u32::from(fixed.is_some()),
            low,
            high,
            ..MapState::zeroed()
        }
    }
}

fn depths_of(gpu: &Gpu, size: u32) -> wgpu::TextureView {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
    gpu.texture("map", (size, size), DEPTH_FORMAT, usage, &[]).create_view(&Default::default())
}
