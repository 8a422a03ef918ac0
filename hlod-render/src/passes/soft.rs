//! Soft shadows: see `soften.wgsl`.

use super::clock::StageClock;
use super::resources::{buffer, compute_pipelines, constants, entry, of_tiles, storage_entry};
use super::shadow::{LightFace, Work, tiles_beyond};
use super::{Rectangle, Targets};
use crate::arena::Arena;
use crate::error::RenderError;
use crate::gpu::Gpu;

/// Bytes of a tile in `soften.wgsl`, and how many there is room for; what is beyond is done where it
/// is found.
const TILE_BYTES: u64 = 80;
const TILES: u64 = 1 << 19;
/// Workgroups that share the tiles.
const TILE_GROUPS: u32 = 1024;
/// Two sums and two words of bits a pixel.
const SUM_BYTES: u64 = 16;
/// Pixels of a workgroup's side.
const SIDE: u32 = 8;

pub(super) struct SoftShadows {
    soften: wgpu::ComputePipeline,
    soften_tiles: wgpu::ComputePipeline,
    settle: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    edge_layout: wgpu::BindGroupLayout,
    settle_layout: wgpu::BindGroupLayout,
    sums: wgpu::Buffer,
    tiles: wgpu::Buffer,
}

/// What one frame gives to the passes.
pub(super) struct SoftWork {
    soften: wgpu::BindGroup,
    settle: wgpu::BindGroup,
    /// Of each uniform's arena.
    edges: Vec<wgpu::BindGroup>,
    area: Rectangle,
}

impl SoftShadows {
    pub(super) fn new(gpu: &Gpu, geometry_layout: &wgpu::BindGroupLayout) -> SoftShadows {
        let device = &gpu.device;
        let compute = wgpu::ShaderStages::COMPUTE;
        let storage = |binding, read_only| storage_entry(binding, compute, read_only);
        let group_layout = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries };
            device.create_bind_group_layout(&descriptor)
        };
        let layout = group_layout(
            "soften",
            &[
                storage(1, false),
                storage(2, false),
                storage(3, false),
                storage(4, true),
                storage(5, false),
            ],
        );
        let edge_layout = group_layout("edges", &[storage(0, true)]);
        let settle_layout = group_layout("settle", &[storage(0, false), storage(1, true)]);
        let groups = [Some(geometry_layout), Some(&layout), Some(&edge_layout)];
        let [soften, soften_tiles] = compute_pipelines(
            gpu,
            &groups,
            hlod_shaders::SOFTEN,
            ["soften", "soften_tiles"],
            &of_tiles(gpu),
        );
        let groups = [Some(geometry_layout), Some(&settle_layout)];
        let [settle] =
            compute_pipelines(gpu, &groups, hlod_shaders::SETTLE, ["settle"], &constants(false));
        let usage = wgpu::BufferUsages::STORAGE;
        SoftShadows {
            soften,
            soften_tiles,
            settle,
            layout,
            edge_layout,
            settle_layout,
            sums: buffer(gpu, "sums", SUM_BYTES, usage),
            // Grows when it is first used.
            tiles: buffer(gpu, "soft tiles", TILE_BYTES, usage | wgpu::BufferUsages::COPY_SRC),
        }
    }

    /// `samples`, `cells` and `chunks` are what hard shadows are drawn with.
    pub(super) fn prepare(
        &mut self,
        gpu: &Gpu,
        [samples, chunks]: [&wgpu::Buffer; 2],
        cells: wgpu::BufferBinding<'_>,
        arenas: &[&Arena],
        targets: &Targets,
        area: Rectangle,
    ) -> SoftWork {
        let pixels = u64::from(targets.width()) * u64::from(targets.height());
        let needed =
            [(&mut self.sums, SUM_BYTES * pixels), (&mut self.tiles, TILE_BYTES * (TILES + 1))];
        for (target, bytes) in needed {
            if target.size() < bytes {
                *target = buffer(gpu, "soft shadows", bytes, target.usage());
            }
        }
        let group = |label, layout, entries: &[wgpu::BindGroupEntry<'_>]| {
            let descriptor = wgpu::BindGroupDescriptor { label: Some(label), layout, entries };
            gpu.device.create_bind_group(&descriptor)
        };
        let soften = [
            entry(1, samples),
            wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::Buffer(cells) },
            entry(3, &self.sums),
            entry(4, chunks),
            entry(5, &self.tiles),
        ];
        let settle = [entry(0, targets.occlusion(gpu)), entry(1, &self.sums)];
        let edges = |arena: &&Arena| group("edges", &self.edge_layout, &[entry(0, &arena.across)]);
        SoftWork {
            soften: group("soften", &self.layout, &soften),
            settle: group("settle", &self.settle_layout, &settle),
            edges: arenas.iter().map(edges).collect(),
            area,
        }
    }

    /// Parts for which there was no room, of all frames.
    ///
    /// # Errors
    /// When the device is lost.
    pub(super) fn tiles_beyond(&self, gpu: &Gpu) -> Result<u32, RenderError> {
        tiles_beyond(gpu, &self.tiles)
    }

    /// Sums are of one face of the light.
    pub(super) fn begin_face(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.clear_buffer(&self.sums, 0, None);
        // Their number, not that of those beyond.
        encoder.clear_buffer(&self.tiles, 0, Some(4));
    }

    /// After samples were binned.
    pub(super) fn encode(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        work: &Work,
        soft: &SoftWork,
        face: &LightFace<'_>,
        clock: &StageClock,
    ) {
        let Some(&(first, first_offset)) = face.casters.first() else { return };
        pass.set_bind_group(1, &soft.soften, &[]);
        pass.set_pipeline(&self.soften);
        for (uniform, &(bind_group, offset)) in face.casters.iter().enumerate() {
            pass.set_bind_group(0, bind_group, &[offset]);
            pass.set_bind_group(2, &soft.edges[uniform], &[]);
            work.chunks.dispatch(pass, uniform);
        }
        clock.mark_within(pass, "casters");
        pass.set_pipeline(&self.soften_tiles);
        pass.dispatch_workgroups(TILE_GROUPS, 1, 1);
        clock.mark_within(pass, "large casters");
        pass.set_pipeline(&self.settle);
        pass.set_bind_group(0, first, &[first_offset]);
        pass.set_bind_group(1, &soft.settle, &[]);
        pass.dispatch_workgroups(
            soft.area.width.div_ceil(SIDE),
            soft.area.height.div_ceil(SIDE),
            1,
        );
        clock.mark_within(pass, "settle");
    }
}
