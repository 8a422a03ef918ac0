//! The GPU passes: the surface (identity and depth), in compute where triangles are small; what is
//! hidden from the light; shade.

mod chunks;
mod clock;
mod drawn;
mod explain;
mod map;
mod relief;
mod resources;
mod sets;
mod shade;
mod shadow;
mod small;
mod soft;
mod surface;
mod targets;

use crate::arena::Arena;
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::scene::Shot;
use crate::shadow_map::MapCount;
use clock::StageClock;
pub(crate) use drawn::{Drawn, DrawnShadow, FaceUniforms, Hidden};
pub use drawn::{FrameUniform, Range};
use drawn::{RangePipeline, UNIFORM_STRIDE};
pub(crate) use explain::DrawnPart;
pub(crate) use map::MapPlan;
use map::{MapWork, ShadowMaps};
pub(crate) use resources::{buffer, write_growing};
use resources::{constants, geometry_from, geometry_group, geometry_layout};
pub(crate) use sets::PassSets;
use shade::Shade;
use shadow::{DrawnRange, HardShadows, How, LightFace};
use small::SmallTriangles;
use soft::{SoftShadows, SoftWork};
use surface::Surface;
pub use targets::{Rectangle, Targets, Window};

/// Pipelines and what they are bound with.
pub(crate) struct Passes {
    small: Option<SmallTriangles>,
    surface: Surface,
    shadow: HardShadows,
    soft: SoftShadows,
    /// Made when it is first needed.
    maps: Option<ShadowMaps>,
    shade: Shade,
    geometry_layout: wgpu::BindGroupLayout,
    uniforms: wgpu::Buffer,
    clock: StageClock,
}

/// What one frame gives to the passes of shadows.
struct ShadowWork {
    hard: shadow::Work,
    soft: Option<SoftWork>,
    map: Option<MapWork>,
}

impl Passes {
    /// Compiles them; `is_clipped` for statues that are cut open, of which others draw everything.
    pub(crate) fn new(gpu: &Gpu, output: wgpu::TextureFormat, is_clipped: bool) -> Passes {
        let constants = constants(is_clipped);
        let geometry_layout = geometry_layout(gpu);
        Passes {
            surface: Surface::new(gpu, &geometry_layout, &constants),
            shade: Shade::new(gpu, &geometry_layout, output, constants),
            uniforms: buffer(gpu, "uniforms", 16 * UNIFORM_STRIDE, wgpu::BufferUsages::UNIFORM),
            small: SmallTriangles::new(gpu, &geometry_layout, &constants),
            shadow: HardShadows::new(gpu, &geometry_layout),
            soft: SoftShadows::new(gpu, &geometry_layout),
            maps: None,
            geometry_layout,
            clock: StageClock::new(gpu),
        }
    }

    /// See [`StageClock::read`].
    pub(crate) fn stage_times(&self, gpu: &Gpu) -> Result<Vec<(&'static str, f64)>, RenderError> {
        self.clock.read(gpu)
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
        let ranges = drawn.sorted_ranges();
        let small_work = self.prepare_small(gpu, uniforms.len(), &ranges, targets);
        let shadow_work = self.prepare_shadows(gpu, uniforms, &ranges, drawn, targets)?;
        let small_chunks = small_work.as_ref().map_or(&[][..], |work| work.first_chunks());
        let caster_chunks = shadow_work.as_ref().map_or(&[][..], |work| work.hard.first_chunks());
        self.upload(gpu, &all_uniforms(uniforms, drawn, small_chunks, caster_chunks));
        self.surface.prepare(gpu, &ranges);
        let groups: Vec<wgpu::BindGroup> = uniforms
            .iter()
            .map(|(_, arena)| geometry_group(gpu, &self.geometry_layout, &self.uniforms, arena))
            .collect();
        let geometry = geometry_from(&groups, 0);
        let faces = light_faces(&groups, drawn.shadow.faces().len());

        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.clock.begin(&mut encoder);
        let small = self.small.as_ref().zip(small_work.as_ref());
        if let Some((small, work)) = small {
            small.rasterise(&mut encoder, work, &geometry, targets);
            self.clock.mark(&mut encoder, "small triangles");
        }
        let depth = targets.depth().create_view(&Default::default());
        let into = (&depth, drawn.area, targets);
        self.surface.encode(&mut encoder, small, &ranges, &geometry, into);
        self.clock.mark(&mut encoder, "surface");
        if let Some(work) = &shadow_work {
            encoder = self.encode_shadows(gpu, encoder, work, &drawn.shadow, &faces, targets)?;
        }
        self.shade.encode(gpu, &mut encoder, &geometry, drawn, shot, (&depth, targets));
        self.clock.mark(&mut encoder, "shade");
        self.clock.end(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// `None` where small triangles are not told apart.
    fn prepare_small(
        &mut self,
        gpu: &Gpu,
        uniform_count: usize,
        ranges: &[&Range],
        targets: &Targets,
    ) -> Option<small::Work> {
        let small = self.small.as_mut().filter(|small| small.fits(gpu, targets))?;
        Some(small.prepare(gpu, uniform_count, ranges, targets))
    }

    /// Uploads what shadows are drawn with, where there are any; `ranges` are those on which they fall.
    ///
    /// # Errors
    /// When the picture is too large for shadows.
    fn prepare_shadows(
        &mut self,
        gpu: &Gpu,
        uniforms: &[(FrameUniform, &Arena)],
        ranges: &[&Range],
        drawn: &Drawn<'_>,
        targets: &Targets,
    ) -> Result<Option<ShadowWork>, RenderError> {
        if matches!(drawn.shadow, DrawnShadow::None) {
            return Ok(None);
        }
        check_shadows(gpu, targets)?;
        let area = drawn.area;
        let casters = drawn.shadow.casters();
        let mut receivers: Vec<DrawnRange> = ranges
            .iter()
            .map(|r| DrawnRange {
                first: uniforms[r.uniform].0.size[2] + r.triangles.start,
                error: r.error,
            })
            .collect();
        receivers.sort_by_key(|range| range.first);
        let hard = self.shadow.prepare(gpu, uniforms.len(), &casters, &receivers, targets, area);
        let (shared, cells) = self.shadow.shared(&hard);
        let soft = match drawn.shadow {
            DrawnShadow::Cast { is_soft: true, .. } => {
                let arenas: Vec<&Arena> = uniforms.iter().map(|(_, arena)| *arena).collect();
                Some(self.soft.prepare(gpu, shared, cells, &arenas, targets, area))
            }
            _ => None,
        };
        let map = match drawn.shadow {
            DrawnShadow::Cast { map: Some(plan), .. } => {
                let new = || ShadowMaps::new(gpu, &self.geometry_layout);
                let maps = self.maps.get_or_insert_with(new);
                Some(maps.prepare(gpu, self.shadow.samples(), plan, &casters, targets, area))
            }
            _ => None,
        };
        Ok(Some(ShadowWork { hard, soft, map }))
    }

    fn upload(&mut self, gpu: &Gpu, uniforms: &[FrameUniform]) {
        let mut bytes = vec![0u8; uniforms.len() * UNIFORM_STRIDE as usize];
        for (uniform, place) in uniforms.iter().zip(bytes.chunks_exact_mut(UNIFORM_STRIDE as usize))
        {
            place[..size_of::<FrameUniform>()].copy_from_slice(bytemuck::bytes_of(uniform));
        }
        write_growing(gpu, &mut self.uniforms, &bytes);
    }

    /// Finds what is hidden from the light. Where it is traced, what was encoded is submitted first; the encoder
    /// returned is the one to go on with.
    ///
    /// # Errors
    /// When the device is lost while shadows are traced.
    fn encode_shadows(
        &self,
        gpu: &Gpu,
        mut encoder: wgpu::CommandEncoder,
        work: &ShadowWork,
        shadow: &DrawnShadow<'_>,
        faces: &[LightFace<'_>],
        targets: &Targets,
    ) -> Result<wgpu::CommandEncoder, RenderError> {
        match shadow {
            DrawnShadow::None => {}
            DrawnShadow::Cast { .. } => {
                let how = match (&work.soft, self.maps.as_ref().zip(work.map.as_ref())) {
                    (Some(soft), _) => How::Soft(&self.soft, soft),
                    (None, Some((maps, map_work))) => How::Map(maps, map_work),
                    (None, None) => How::Exact,
                };
                let clock = &self.clock;
                self.shadow.encode(gpu, &mut encoder, &work.hard, how, faces, (targets, clock));
            }
            DrawnShadow::Traced { hidden, .. } => {
                gpu.queue.submit([encoder.finish()]);
                self.shadow.trace(gpu, &work.hard, faces, *hidden, targets)?;
                encoder = gpu.device.create_command_encoder(&Default::default());
            }
        }
        Ok(encoder)
    }
}

/// The frame's uniforms, then each face's: of what shadows fall on, of what casts. `small` and `casters` are the
/// numbers of each arena's first chunk, where there are chunks.
fn all_uniforms(
    uniforms: &[(FrameUniform, &Arena)],
    drawn: &Drawn<'_>,
    small: &[u32],
    casters: &[u32],
) -> Vec<FrameUniform> {
    let mut all: Vec<FrameUniform> = uniforms.iter().map(|(uniform, _)| *uniform).collect();
    for (uniform, &first) in all.iter_mut().zip(small) {
        uniform.size[3] = first;
    }
    for face in drawn.shadow.faces() {
        all.extend(&face.receivers);
        all.extend(face.casters.iter().zip(casters).map(|(uniform, &first)| {
            let [width, height, identity, _] = uniform.size;
            FrameUniform { size: [width, height, identity, first], ..*uniform }
        }));
    }
    let area = drawn.area;
    for uniform in &mut all {
        uniform.area = [area.x, area.y, area.width, area.height];
    }
    all
}

/// What the light's faces are bound with; their uniforms lie as [`all_uniforms`] has them.
fn light_faces(groups: &[wgpu::BindGroup], face_count: usize) -> Vec<LightFace<'_>> {
    (0..face_count)
        .map(|f| LightFace {
            receivers: geometry_from(groups, (1 + 2 * f) * groups.len()),
            casters: geometry_from(groups, (2 + 2 * f) * groups.len()),
        })
        .collect()
}

/// Whether there is room for shadows on pictures of this size.
///
/// # Errors
/// When there are more pixels than one binding holds samples of.
pub fn check_shadows(gpu: &Gpu, targets: &Targets) -> Result<(), RenderError> {
    HardShadows::check(gpu, targets)
}
