//! The GPU passes: the surface (identity and depth), in compute where triangles are small; what is
//! hidden from the light; shade.

mod chunks;
mod explain;
mod map;
mod relief;
mod sets;
mod shadow;
mod small;
mod soft;
mod targets;

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec4};

use crate::arena::Arena;
use crate::clip::PLANES_MAX;
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::scene::Shot;
use crate::shadow_map::MapCount;
pub(crate) use explain::DrawnPart;
use explain::Explain;
pub(crate) use map::MapPlan;
use map::ShadowMaps;
use relief::{Relief, ReliefLayout};
pub(crate) use sets::PassSets;
use shadow::{DrawnRange, HardShadows, How, LightFace};
use small::SmallTriangles;
use soft::SoftShadows;
use targets::{DEPTH_FORMAT, IDENTITY_FORMAT, relief_texture};
pub use targets::{Rectangle, Targets, Window};

/// What shaders know of a frame, once for each arena; see `Frame` in `shared.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct FrameUniform {
    /// Model space → clip space.
    pub clip_from_model: Mat4,
    /// Model space → world space relative to the model's centre.
    pub world_from_model: Mat4,
    /// Eye (w = 1) or direction towards it (w = 0).
    pub eye: Vec4,
    /// Light (w = 1) or direction towards it (w = 0).
    pub light: Vec4,
    /// Linear albedo and highlight.
    pub material: Vec4,
    /// Reach of skirts for each unit of depth, what is added, and what the former is at most; model space.
    pub skirt: Vec4,
    /// Ambient share; colours; backs magenta; backs lit like fronts.
    pub shading: Vec4,
    /// Model space → light space.
    pub light_from_model: Mat4,
    /// Whether occlusion is known; of a light's face: least w, largest tangent or 0.
    pub shadow: Vec4,
    /// What rounding may do to positions, world space; whether parts of a picture must agree; nothing;
    /// whether cut faces are painted.
    pub bias: Vec4,
    /// Points: model lengths of clip.x, of clip.y, and of clip.w or, in parallel views, clip.z; and of a
    /// lattice step.
    pub points: Vec4,
    /// 1 + which kept number is painted, or 0; the code that is 0 on the map, and what it rises by from one code
    /// to the next.
    pub scalar: Vec4,
    /// How much contrast follows the bends of the surface; within how many pixels; whether they are painted.
    pub relief: Vec4,
    /// Direction towards a lamp that shines within a cone, and the cosine at its side: see [`crate::scene::Spot`].
    pub spot: Vec4,
    /// The part of the picture in which anything is seen: first pixel, width, height.
    pub area: [u32; 4],
    /// Width, height, number of the arena's first triangle, and of its first chunk.
    pub size: [u32; 4],
    /// The part of the picture that is drawn: its first pixel, its width and height.
    pub window: [u32; 4],
    /// Planes that cut the statue open: see [`crate::clip`].
    pub clip: [Vec4; PLANES_MAX],
    /// Linear light of their cut faces.
    pub clip_colours: [Vec4; PLANES_MAX],
}

/// Uniforms lie this far apart in their buffer: a multiple of 256 is what every adapter allows.
const UNIFORM_STRIDE: u64 = 512;

/// A range of an arena's triangles to draw.
#[derive(Debug, Clone)]
pub struct Range {
    /// Which uniform, and so which arena.
    pub uniform: usize,
    /// Triangles of the arena, or points, which are counted like them.
    pub triangles: std::ops::Range<u32>,
    /// Of points, which of their radii they have: see [`crate::loader::PointPrefix`].
    pub points_level: Option<u32>,
    /// Whether backs can be left to the rasteriser to drop.
    pub cull_backs: bool,
    /// How far they may be from the scan's, world units; for shadows.
    pub error: f32,
}

/// Which pipeline of fixed function draws a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum RangePipeline {
    TwoSided,
    Culled,
    Splats,
}

impl Range {
    fn pipeline(&self) -> RangePipeline {
        match (self.points_level, self.cull_backs) {
            (Some(_), _) => RangePipeline::Splats,
            (None, true) => RangePipeline::Culled,
            (None, false) => RangePipeline::TwoSided,
        }
    }
}

/// What a frame draws.
pub(crate) struct Drawn<'a> {
    pub(crate) ranges: &'a [Range],
    /// The nodes that they are of, where pictures are to explain them.
    pub(crate) parts: &'a [DrawnPart],
    /// Nothing is seen outside.
    pub(crate) area: Rectangle,
    pub(crate) shadow: DrawnShadow<'a>,
}

/// What a frame's shadows are drawn with.
pub(crate) enum DrawnShadow<'a> {
    None,
    /// Ranges to cast, by the numbers of the receivers' uniforms, and the light's faces.
    Cast {
        ranges: &'a [Range],
        faces: &'a [FaceUniforms],
        /// Of a light that is a disc.
        is_soft: bool,
        /// With maps.
        map: Option<&'a MapPlan>,
    },
    /// For each of the light's faces, what is hidden of points in light space; `None` for pixels
    /// without one.
    Traced {
        faces: &'a [FaceUniforms],
        hidden: &'a Hidden<'a>,
    },
}

/// From a face's number and a point for each pixel, to occlusion in 65535ths.
pub(crate) type Hidden<'a> = dyn Fn(usize, &[Option<[f32; 3]>]) -> Vec<u32> + 'a;

/// What differs from a frame's uniforms where the light looks at the scene.
pub(crate) struct FaceUniforms {
    /// To place points: one for each of the frame's.
    pub(crate) receivers: Vec<FrameUniform>,
    /// To draw what casts.
    pub(crate) casters: Vec<FrameUniform>,
}

/// Pipelines and what they are bound with.
pub(crate) struct Passes {
    surface_culled: wgpu::RenderPipeline,
    surface_two_sided: wgpu::RenderPipeline,
    splats: wgpu::RenderPipeline,
    shade: wgpu::RenderPipeline,
    /// Made when it is first needed.
    relief: Option<Relief>,
    explain: Explain,
    small: Option<SmallTriangles>,
    shadow: HardShadows,
    soft: SoftShadows,
    /// Made when it is first needed.
    maps: Option<ShadowMaps>,
    /// Stands in for occlusion where there are no shadows.
    unoccluded: wgpu::Buffer,
    /// Stands in for directions where relief is not looked at.
    no_relief: wgpu::TextureView,
    shade_layout: wgpu::PipelineLayout,
    where_drawn: wgpu::DepthStencilState,
    output: wgpu::TextureFormat,
    constants: Constants,
    geometry_layout: wgpu::BindGroupLayout,
    identity_layout: wgpu::BindGroupLayout,
    uniforms: wgpu::Buffer,
    indirect: wgpu::Buffer,
}

impl Passes {
    /// Compiles them; `is_clipped` for statues that are cut open, of which others draw everything.
    pub(crate) fn new(gpu: &Gpu, output: wgpu::TextureFormat, is_clipped: bool) -> Passes {
        let constants = constants(is_clipped);
        let device = &gpu.device;
        let storage = |binding, visibility| storage_entry(binding, visibility, true);
        let both = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let every = both | wgpu::ShaderStages::COMPUTE;
        let geometry_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("geometry"),
            entries: &[
                wgpu::BindGroupLayoutEntry {
                    binding: 0,
                    visibility: every,
                    ty: wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Uniform,
                        has_dynamic_offset: true,
                        min_binding_size: std::num::NonZeroU64::new(
                            size_of::<FrameUniform>() as u64
                        ),
                    },
                    count: None,
                },
                storage(1, every),
                storage(2, every),
                storage(3, wgpu::ShaderStages::FRAGMENT),
                storage(4, wgpu::ShaderStages::FRAGMENT),
            ],
        });
        let identity_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("identity"),
            entries: &[
                wgpu::BindGroupLayoutEntry {
                    binding: 0,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Texture {
                        sample_type: wgpu::TextureSampleType::Uint,
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: false,
                    },
                    count: None,
                },
                storage(1, wgpu::ShaderStages::FRAGMENT),
                wgpu::BindGroupLayoutEntry {
                    binding: 2,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Texture {
                        sample_type: wgpu::TextureSampleType::Float { filterable: false },
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: false,
                    },
                    count: None,
                },
            ],
        });
        let layout = |label, groups: &[Option<&wgpu::BindGroupLayout>]| {
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: groups,
                immediate_size: 0,
            })
        };
        let surface_layout = layout("surface", &[Some(&geometry_layout)]);
        let shade_layout = layout("shade", &[Some(&geometry_layout), Some(&identity_layout)]);

        // The surface writes depth; shading draws at infinity and passes only where something is
        // nearer, so that no shader runs for the background.
        let nearest = wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        };
        let where_drawn = wgpu::DepthStencilState {
            depth_write_enabled: Some(false),
            depth_compare: Some(wgpu::CompareFunction::Less),
            ..nearest.clone()
        };
        let pipeline = |pass: hlod_shaders::Pass, layout, cull_mode, target, depth| {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(pass.name),
                source: wgpu::ShaderSource::Wgsl(pass.source.into()),
            });
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(pass.name),
                layout: Some(layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(&format!("{}_vertex", pass.name)),
                    compilation_options: with(&constants),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState { cull_mode, ..Default::default() },
                depth_stencil: Some(depth),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(&format!("{}_fragment", pass.name)),
                    compilation_options: with(&constants),
                    targets: &[Some(wgpu::ColorTargetState {
                        format: target,
                        blend: None,
                        write_mask: wgpu::ColorWrites::ALL,
                    })],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let surface = |cull| {
            pipeline(hlod_shaders::SURFACE, &surface_layout, cull, IDENTITY_FORMAT, nearest.clone())
        };
        Passes {
            surface_culled: surface(Some(wgpu::Face::Back)),
            surface_two_sided: surface(None),
            splats: pipeline(
                hlod_shaders::SPLATS,
                &surface_layout,
                None,
                IDENTITY_FORMAT,
                nearest.clone(),
            ),
            explain: Explain::new(gpu, &geometry_layout, output, where_drawn.clone()),
            shade: pipeline(hlod_shaders::SHADE, &shade_layout, None, output, where_drawn.clone()),
            relief: None,
            no_relief: relief_texture(gpu, (1, 1)),
            uniforms: buffer(gpu, "uniforms", 16 * UNIFORM_STRIDE, wgpu::BufferUsages::UNIFORM),
            indirect: buffer(gpu, "draws", 1024 * 16, wgpu::BufferUsages::INDIRECT),
            small: SmallTriangles::new(gpu, &geometry_layout, &constants),
            shadow: HardShadows::new(gpu, &geometry_layout),
            soft: SoftShadows::new(gpu, &geometry_layout),
            maps: None,
            unoccluded: buffer(gpu, "unoccluded", 4, wgpu::BufferUsages::STORAGE),
            geometry_layout,
            identity_layout,
            shade_layout,
            where_drawn,
            output,
            constants,
        }
    }

    /// What came of the last frame's shadow maps; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub(crate) fn map_count(&self, gpu: &Gpu) -> Result<MapCount, RenderError> {
        self.maps.as_ref().map_or(Ok(MapCount::default()), |maps| maps.count(gpu))
    }

    /// Parts of what casts shadows for which there was no room in a list, of all frames: they are done where they are
    /// found, by one thread each. Waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub(crate) fn tiles_beyond(&self, gpu: &Gpu) -> Result<u32, RenderError> {
        Ok(self.shadow.tiles_beyond(gpu)? + self.soft.tiles_beyond(gpu)?)
    }

    /// Whether points can have other radii in one frame than in another.
    pub(crate) fn can_choose_points(&self, gpu: &Gpu, targets: &Targets) -> bool {
        self.small.as_ref().is_some_and(|small| small.fits(gpu, targets))
    }

    /// Submits one frame: all ranges into identity and depth, shadows, then one shading draw an arena.
    /// Nothing outside `area` is drawn.
    ///
    /// # Errors
    /// When the picture is too large for shadows, or the device is lost while they are traced.
    pub(crate) fn encode(
        &mut self,
        gpu: &Gpu,
        uniforms: &[(FrameUniform, &Arena)],
        drawn: &Drawn<'_>,
        shot: &Shot,
        targets: &Targets,
    ) -> Result<(), RenderError> {
        let device = &gpu.device;
        let area = drawn.area;
        let mut ranges: Vec<&Range> = drawn.ranges.iter().collect();
        ranges.sort_by_key(|r| (r.uniform, r.pipeline(), r.triangles.start));
        let mut small = self.small.as_mut().filter(|small| small.fits(gpu, targets));
        let work = small.as_mut().map(|small| small.prepare(gpu, uniforms.len(), &ranges, targets));
        let faces: &[FaceUniforms] = match drawn.shadow {
            DrawnShadow::None => &[],
            DrawnShadow::Cast { faces, .. } | DrawnShadow::Traced { faces, .. } => faces,
        };
        let mut casting: Vec<&Range> = match drawn.shadow {
            DrawnShadow::Cast { ranges, .. } => ranges.iter().collect(),
            _ => Vec::new(),
        };
        casting.sort_by_key(|r| (r.uniform, r.cull_backs, r.triangles.start));
        let shadow_work = match drawn.shadow {
            DrawnShadow::None => None,
            DrawnShadow::Cast { .. } | DrawnShadow::Traced { .. } => {
                check_shadows(gpu, targets)?;
                let mut drawn: Vec<DrawnRange> = ranges
                    .iter()
                    .map(|r| DrawnRange {
                        first: uniforms[r.uniform].0.size[2] + r.triangles.start,
                        error: r.error,
                    })
                    .collect();
                drawn.sort_by_key(|range| range.first);
                Some(self.shadow.prepare(gpu, uniforms.len(), &casting, &drawn, targets, area))
            }
        };

        let soft_work = match (&drawn.shadow, &shadow_work) {
            (DrawnShadow::Cast { is_soft: true, .. }, Some(work)) => {
                let arenas: Vec<&Arena> = uniforms.iter().map(|(_, arena)| *arena).collect();
                let (buffers, cells) = self.shadow.shared(work);
                Some(self.soft.prepare(gpu, buffers, cells, &arenas, targets, area))
            }
            _ => None,
        };

        let map_work = match (&drawn.shadow, &shadow_work) {
            (DrawnShadow::Cast { map: Some(plan), .. }, Some(work)) => {
                let new = || ShadowMaps::new(gpu, &self.geometry_layout);
                let ([samples, _], _) = self.shadow.shared(work);
                let maps = self.maps.get_or_insert_with(new);
                Some(maps.prepare(gpu, samples, plan, &casting, targets, area))
            }
            _ => None,
        };

        // Upload the uniforms: the frame's, then each face's, and the draws.
        let mut all: Vec<FrameUniform> = uniforms.iter().map(|(uniform, _)| *uniform).collect();
        if let Some(work) = &work {
            for (uniform, first) in all.iter_mut().zip(work.first_chunks()) {
                uniform.size[3] = *first;
            }
        }
        for face in faces {
            all.extend(&face.receivers);
            let first_chunks = shadow_work.iter().flat_map(|work| work.first_chunks());
            all.extend(face.casters.iter().zip(first_chunks).map(|(uniform, &first)| {
                let [width, height, identity, _] = uniform.size;
                FrameUniform { size: [width, height, identity, first], ..*uniform }
            }));
        }
        for uniform in &mut all {
            uniform.area = [area.x, area.y, area.width, area.height];
        }
        let mut bytes = vec![0u8; all.len() * UNIFORM_STRIDE as usize];
        for (uniform, place) in all.iter().zip(bytes.chunks_exact_mut(UNIFORM_STRIDE as usize)) {
            place[..size_of::<FrameUniform>()].copy_from_slice(bytemuck::bytes_of(uniform));
        }
        write_growing(gpu, &mut self.uniforms, &bytes);
        let draws: Vec<[u32; 4]> = ranges
            .iter()
            .map(|r| [3 * (r.triangles.end - r.triangles.start), 1, 3 * r.triangles.start, 0])
            .collect();
        write_growing(gpu, &mut self.indirect, bytemuck::cast_slice(&draws));
        let bind_groups: Vec<wgpu::BindGroup> = {
            let of_arena =
                |arena| geometry_group(gpu, &self.geometry_layout, &self.uniforms, arena);
            uniforms.iter().map(|(_, arena)| of_arena(*arena)).collect()
        };
        // The same arenas with the uniforms that begin at a number.
        let geometry = |first: usize| -> Vec<(&wgpu::BindGroup, u32)> {
            let offset = |i: usize| ((first + i) as u64 * UNIFORM_STRIDE) as u32;
            bind_groups.iter().enumerate().map(|(i, group)| (group, offset(i))).collect()
        };
        let light_faces: Vec<LightFace<'_>> = (0..faces.len())
            .map(|f| LightFace {
                receivers: geometry((1 + 2 * f) * uniforms.len()),
                casters: geometry((2 + 2 * f) * uniforms.len()),
            })
            .collect();
        let geometry = geometry(0);

        let mut encoder = device.create_command_encoder(&Default::default());
        let small = small.map(|small| &*small).zip(work.as_ref());
        if let Some((small, work)) = small {
            small.rasterise(&mut encoder, work, &geometry, targets);
        }
        let depth_view = targets.depth().create_view(&Default::default());
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("surface"),
                color_attachments: &[attachment(targets.identity_view(), wgpu::Color::TRANSPARENT)],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &depth_view,
                    depth_ops: Some(wgpu::Operations {
                        load: wgpu::LoadOp::Clear(0.0),
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            pass.set_scissor_rect(area.x, area.y, area.width, area.height);
            if let Some((small, work)) = small {
                small.draw(&mut pass, work, &geometry, targets);
            }
            let mut first = 0;
            let to_fixed = if small.is_some() { &[] } else { ranges.as_slice() };
            for group in
                to_fixed.chunk_by(|a, b| (a.uniform, a.pipeline()) == (b.uniform, b.pipeline()))
            {
                let uniform = group[0].uniform;
                pass.set_pipeline(match group[0].pipeline() {
                    RangePipeline::TwoSided => &self.surface_two_sided,
                    RangePipeline::Culled => &self.surface_culled,
                    RangePipeline::Splats => &self.splats,
                });
                let (bind_group, offset) = geometry[uniform];
                pass.set_bind_group(0, bind_group, &[offset]);
                pass.multi_draw_indirect(&self.indirect, first * 16, group.len() as u32);
                first += group.len() as u64;
            }
        }
        match (&drawn.shadow, &shadow_work) {
            (DrawnShadow::Cast { .. }, Some(work)) => {
                let how = match (&soft_work, self.maps.as_ref().zip(map_work.as_ref())) {
                    (Some(soft), _) => How::Soft(&self.soft, soft),
                    (None, Some((maps, map_work))) => How::Map(maps, map_work),
                    (None, None) => How::Exact,
                };
                self.shadow.encode(gpu, &mut encoder, work, how, &light_faces, targets);
            }
            (DrawnShadow::Traced { hidden, .. }, Some(work)) => {
                gpu.queue.submit([encoder.finish()]);
                self.shadow.trace(gpu, work, &light_faces, *hidden, targets)?;
                encoder = device.create_command_encoder(&Default::default());
            }
            _ => {}
        }
        if shot.sees_relief() && self.relief.is_none() {
            let made_with = ReliefLayout {
                layout: &self.shade_layout,
                depth: self.where_drawn.clone(),
                output: self.output,
                constants: &self.constants,
            };
            self.relief = Some(Relief::new(gpu, &made_with));
        }
        let relief = self.relief.as_ref().filter(|_| shot.sees_relief());
        let occlusion = match drawn.shadow {
            DrawnShadow::None => &self.unoccluded,
            _ => targets.occlusion(gpu),
        };
        let seen = |directions: &wgpu::TextureView| {
            let texture = |view| wgpu::BindingResource::TextureView(view);
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("identity"),
                layout: &self.identity_layout,
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: texture(targets.identity_view()) },
                    entry(1, occlusion),
                    wgpu::BindGroupEntry { binding: 2, resource: texture(directions) },
                ],
            })
        };
        let unread = seen(&self.no_relief);
        let shaded = relief.map_or_else(|| unread.clone(), |_| seen(targets.relief(gpu)));
        if let Some(relief) = relief {
            relief.encode(gpu, &mut encoder, &unread, &geometry, (&depth_view, area, targets));
        }
        let explains = explain::explains(shot.paint);
        let is_explained = explains && !drawn.parts.is_empty();
        let explained =
            is_explained.then(|| self.explain.parts(gpu, drawn.parts, targets.identity_view()));
        {
            let clear = background(shot, targets);
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("shade"),
                color_attachments: &[attachment(&targets.colour, clear)],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &depth_view,
                    depth_ops: None,
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            pass.set_scissor_rect(area.x, area.y, area.width, area.height);
            match &explained {
                None => {
                    pass.set_pipeline(relief.map_or(&self.shade, |relief| &relief.shade));
                    pass.set_bind_group(1, &shaded, &[]);
                }
                Some(parts) => self.explain.begin(&mut pass, parts, shot.paint),
            }
            for &(bind_group, offset) in &geometry {
                pass.set_bind_group(0, bind_group, &[offset]);
                pass.draw(0..3, 0..1);
            }
        }
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }
}

/// What is where nothing is drawn.
fn background(shot: &Shot, targets: &Targets) -> wgpu::Color {
    if targets.window().transparent {
        return wgpu::Color::TRANSPARENT;
    }
    let [r, g, b] = shot.background.to_array().map(f64::from);
    wgpu::Color { r, g, b, a: 1.0 }
}

/// An arena and a uniform, whose place in the buffer is given when it is bound.
fn geometry_group(
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

/// Whether there is room for shadows on pictures of this size.
///
/// # Errors
/// When there are more pixels than one binding holds samples of.
pub fn check_shadows(gpu: &Gpu, targets: &Targets) -> Result<(), RenderError> {
    HardShadows::check(gpu, targets)
}

/// A storage buffer of a bind group's layout.
fn storage_entry(
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

/// Pipelines for some of a pass' entry points.
/// What pipelines are compiled with: see `CLIPPED` in `shared.wgsl`.
type Constants = [(&'static str, f64); 1];

fn constants(is_clipped: bool) -> Constants {
    [("CLIPPED", f64::from(u8::from(is_clipped)))]
}

fn with(constants: &Constants) -> wgpu::PipelineCompilationOptions<'_> {
    wgpu::PipelineCompilationOptions { constants, ..Default::default() }
}

fn compute_pipelines<const N: usize>(
    gpu: &Gpu,
    groups: &[Option<&wgpu::BindGroupLayout>],
    pass: hlod_shaders::Pass,
    entry_points: [&str; N],
    constants: &Constants,
) -> [wgpu::ComputePipeline; N] {
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(pass.name),
        bind_group_layouts: groups,
        immediate_size: 0,
    });
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
            compilation_options: with(constants),
            cache: None,
        })
    })
}

fn entry(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}

fn attachment(
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
