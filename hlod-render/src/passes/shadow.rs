//! Hard shadows, exact at every pixel: see `shadow.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::chunks::Chunks;
use super::clock::StageClock;
use super::map::{MapWork, ShadowMaps};
use super::resources::{
    buffer, compute_pipelines, constants, entry, of_tiles, storage_entry, write_growing,
};
use super::soft::{SoftShadows, SoftWork};
use super::{Hidden, Range, Rectangle, Targets};
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::traced::HIDDEN;

/// See `Sample` in `shadow.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Sample {
    position: [f32; 3],
    slack: f32,
    place: u32,
}

/// See `samples.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct DrawnRange {
    /// Number of its first triangle among all arenas.
    pub(super) first: u32,
    pub(super) error: f32,
}

const ABSENT: u32 = u32::MAX;
const TURNED: u32 = u32::MAX - 1;
const SAMPLE_BYTES: u64 = size_of::<Sample>() as u64;
/// Bytes of `Cells` before its cells.
const GRID_BYTES: u64 = 56;
/// Bytes of a tile, and how many there is room for; what is beyond is done where it is found.
const TILE_BYTES: u64 = 80;
const TILES: u64 = 1 << 15;
/// Workgroups that share the tiles.
const TILE_GROUPS: u32 = 256;
/// Workgroups in a row, at most.
const ROW: u32 = 32_768;
/// Pixels of a workgroup's side.
const SIDE: u32 = 8;
/// Pixels that `measure` has in a column, and columns of a workgroup.
const COLUMN: u32 = 64;
/// Cells of a block, and numbers that a grid has of them: see `samples.wgsl`.
const BLOCK_CELLS: u64 = 64;
const BLOCK_NUMBERS: u64 = 173;
const BLOCKS_MIN: u64 = 1 << 6;

pub(super) struct HardShadows {
    place: wgpu::ComputePipeline,
    measure: wgpu::ComputePipeline,
    lay_out: wgpu::ComputePipeline,
    bin: wgpu::ComputePipeline,
    sum_up: wgpu::ComputePipeline,
    scan: wgpu::ComputePipeline,
    number: wgpu::ComputePipeline,
    sort: wgpu::ComputePipeline,
    order: wgpu::ComputePipeline,
    occlude: wgpu::ComputePipeline,
    occlude_tiles: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// Pixel by pixel, and cell by cell.
    samples: wgpu::Buffer,
    sorted: wgpu::Buffer,
    cells: wgpu::Buffer,
    tiles: wgpu::Buffer,
    chunks: wgpu::Buffer,
    drawn: wgpu::Buffer,
}

/// One picture as the light sees the scene: the uniforms of the receivers, then those of the
/// casters, as bind groups with offsets.
pub(super) struct LightFace<'a> {
    pub(super) receivers: Vec<(&'a wgpu::BindGroup, u32)>,
    pub(super) casters: Vec<(&'a wgpu::BindGroup, u32)>,
}

/// How what is hidden from the light is found.
#[derive(Clone, Copy)]
pub(super) enum How<'a> {
    /// Every triangle against every point that it may hide.
    Exact,
    /// And how much of the light, of one that is a disc.
    Soft(&'a SoftShadows, &'a SoftWork),
    /// With a map.
    Map(&'a ShadowMaps, &'a MapWork),
}

/// What one frame gives to the passes.
pub(super) struct Work {
    pub(super) chunks: Chunks,
    /// For what makes samples, and for what hides them.
    placing: wgpu::BindGroup,
    hiding: wgpu::BindGroup,
    area: Rectangle,
    cell_bytes: u64,
    /// Of these, what begins as zeros.
    counted_bytes: u64,
    blocks_most: u32,
}

impl HardShadows {
    pub(super) fn new(gpu: &Gpu, geometry_layout: &wgpu::BindGroupLayout) -> HardShadows {
        let device = &gpu.device;
        let compute = wgpu::ShaderStages::COMPUTE;
        let storage = |binding, read_only| storage_entry(binding, compute, read_only);
        let identities = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Uint,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shadow"),
            entries: &[
                wgpu::BindGroupLayoutEntry {
                    binding: 0,
                    visibility: compute,
                    ty: identities,
                    count: None,
                },
                storage(1, false),
                storage(2, false),
                storage(3, false),
                storage(4, true),
                storage(5, false),
                storage(6, true),
            ],
        });
        let groups = [Some(geometry_layout), Some(&layout)];
        let names =
            ["place", "measure", "lay_out", "bin", "sum_up", "scan", "number", "sort", "order"];
        let [place, measure, lay_out, bin, sum_up, scan, number, sort, order] =
            compute_pipelines(gpu, &groups, hlod_shaders::SAMPLES, names, &of_tiles(gpu));
        let names = ["occlude", "occlude_tiles"];
        let [occlude, occlude_tiles] =
            compute_pipelines(gpu, &groups, hlod_shaders::OCCLUDE, names, &constants(false));
        let usage = wgpu::BufferUsages::STORAGE;
        HardShadows {
            place,
            measure,
            lay_out,
            bin,
            sum_up,
            scan,
            number,
            sort,
            order,
            occlude,
            occlude_tiles,
            layout,
            samples: buffer(gpu, "samples", SAMPLE_BYTES, usage | wgpu::BufferUsages::COPY_SRC),
            sorted: buffer(gpu, "sorted samples", SAMPLE_BYTES, usage),
            cells: buffer(gpu, "cells", GRID_BYTES, usage),
            tiles: buffer(
                gpu,
                "tiles",
                TILE_BYTES * (TILES + 1),
                usage | wgpu::BufferUsages::COPY_SRC,
            ),
            chunks: buffer(gpu, "caster chunks", 1 << 16, usage),
            drawn: buffer(gpu, "drawn ranges", 1 << 12, usage),
        }
    }

    /// Parts of large triangles for which there was no room, of all frames.
    ///
    /// # Errors
    /// When the device is lost.
    pub(super) fn tiles_beyond(&self, gpu: &Gpu) -> Result<u32, RenderError> {
        tiles_beyond(gpu, &self.tiles)
    }

    /// # Errors
    /// When there are more pixels than one binding holds samples of.
    pub(super) fn check(gpu: &Gpu, targets: &Targets) -> Result<(), RenderError> {
        let most = gpu.device.limits().max_storage_buffer_binding_size / SAMPLE_BYTES;
        let pixels = u64::from(targets.width()) * u64::from(targets.height());
        if pixels > most {
            return Err(RenderError::Usage(format!(
                "a picture of {pixels} samples: this adapter has room for shadows on {most}; \
                 choose a smaller picture or less supersampling"
            )));
        }
        Ok(())
    }

    /// Uploads a frame's chunks; `ranges` of casters come in the order of their uniforms, `drawn` in
    /// that of their first triangles.
    pub(super) fn prepare(
        &mut self,
        gpu: &Gpu,
        uniform_count: usize,
        ranges: &[&Range],
        drawn: &[DrawnRange],
        targets: &Targets,
        area: Rectangle,
    ) -> Work {
        let chunks = Chunks::new(uniform_count, ranges);
        write_growing(gpu, &mut self.chunks, bytemuck::cast_slice(&chunks.chunks));
        // What lies behind them in the buffer begins after everything.
        let room = self.drawn.size() as usize / size_of::<DrawnRange>();
        let mut filled = drawn.to_vec();
        let last = DrawnRange { first: u32::MAX, error: 0.0 };
        filled.resize(drawn.len().next_power_of_two().max(room), last);
        write_growing(gpu, &mut self.drawn, bytemuck::cast_slice(&filled));
        let pixels = u64::from(targets.width()) * u64::from(targets.height());
        // About two samples a cell where half of the area is covered: fewer cells hold more samples to
        // test, more are more to look into.
        let cells = u64::from(area.width) * u64::from(area.height) / 4;
        let blocks_most = cells.div_ceil(BLOCK_CELLS).max(BLOCKS_MIN);
        let counted_bytes = GRID_BYTES + 4 * (BLOCK_NUMBERS * blocks_most + 1);
        // And a number for each sample.
        let cell_bytes = counted_bytes + 4 * u64::from(area.width) * u64::from(area.height);
        for (target, bytes) in [
            (&mut self.samples, SAMPLE_BYTES * pixels),
            (&mut self.sorted, SAMPLE_BYTES * pixels),
            (&mut self.cells, cell_bytes),
        ] {
            if target.size() < bytes {
                *target = buffer(gpu, "shadow", bytes, target.usage());
            }
        }
        let cells = wgpu::BufferBinding {
            buffer: &self.cells,
            offset: 0,
            size: std::num::NonZeroU64::new(cell_bytes),
        };
        // What makes samples sorts them as well; what hides them finds them sorted.
        let group = |samples, tiles_or_sorted| {
            let entries = [
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(targets.identity_view()),
                },
                entry(1, samples),
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::Buffer(cells.clone()),
                },
                entry(3, targets.occlusion(gpu)),
                entry(4, &self.chunks),
                entry(5, tiles_or_sorted),
                entry(6, &self.drawn),
            ];
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("shadow"),
                layout: &self.layout,
                entries: &entries,
            })
        };
        let placing = group(&self.samples, &self.sorted);
        let hiding = group(&self.sorted, &self.tiles);
        Work {
            chunks,
            placing,
            hiding,
            area,
            cell_bytes,
            counted_bytes,
            blocks_most: blocks_most as u32,
        }
    }

    /// Samples pixel by pixel.
    pub(super) fn samples(&self) -> &wgpu::Buffer {
        &self.samples
    }

    /// What [`super::soft`] needs of these: sorted samples and chunks, and cells.
    pub(super) fn shared(&self, work: &Work) -> ([&wgpu::Buffer; 2], wgpu::BufferBinding<'_>) {
        let size = std::num::NonZeroU64::new(work.cell_bytes);
        let cells = wgpu::BufferBinding { buffer: &self.cells, offset: 0, size };
        ([&self.sorted, &self.chunks], cells)
    }

    /// Finds which visible points are hidden, for every face of the light, or how much of it is.
    pub(super) fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        work: &Work,
        how: How<'_>,
        faces: &[LightFace<'_>],
        (targets, clock): (&Targets, &StageClock),
    ) {
        encoder.clear_buffer(targets.occlusion(gpu), 0, None);
        let Rectangle { width, height, .. } = work.area;
        let (columns, rows) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
        for (number, face) in faces.iter().enumerate() {
            if let How::Soft(shadows, _) = how {
                shadows.begin_face(encoder);
            }
            if !matches!(how, How::Map(..)) {
                encoder.clear_buffer(&self.cells, 0, Some(work.counted_bytes));
                // Their number, not that of those beyond.
                encoder.clear_buffer(&self.tiles, 0, Some(4));
            }
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("shadow"),
                timestamp_writes: None,
            });
            pass.set_bind_group(1, &work.placing, &[]);
            pass.set_pipeline(&self.place);
            for &(bind_group, offset) in &face.receivers {
                pass.set_bind_group(0, bind_group, &[offset]);
                pass.dispatch_workgroups(columns, rows, 1);
            }
            let Some(&(bind_group, offset)) = face.casters.first() else { continue };
            if let How::Map(shadows, map_work) = how {
                drop(pass);
                shadows.encode(encoder, map_work, number, face);
                clock.mark(encoder, "shadow map");
                continue;
            }
            pass.set_bind_group(0, bind_group, &[offset]);
            pass.set_pipeline(&self.measure);
            pass.dispatch_workgroups(width.div_ceil(COLUMN), height.div_ceil(COLUMN), 1);
            pass.set_pipeline(&self.lay_out);
            pass.dispatch_workgroups(1, 1, 1);
            pass.set_pipeline(&self.bin);
            pass.dispatch_workgroups(columns, rows, 1);
            pass.set_pipeline(&self.sum_up);
            pass.dispatch_workgroups(work.blocks_most.div_ceil(64), 1, 1);
            pass.set_pipeline(&self.scan);
            pass.dispatch_workgroups(1, 1, 1);
            pass.set_pipeline(&self.number);
            pass.dispatch_workgroups((4 * work.blocks_most).div_ceil(64), 1, 1);
            pass.set_pipeline(&self.sort);
            pass.dispatch_workgroups(columns, rows, 1);
            if let How::Soft(shadows, soft_work) = how {
                let quarters = 4 * work.blocks_most;
                let rows = quarters.div_ceil(ROW);
                pass.set_pipeline(&self.order);
                pass.dispatch_workgroups(quarters.div_ceil(rows), rows, 1);
                clock.mark_within(&mut pass, "samples");
                shadows.encode(&mut pass, work, soft_work, face, clock);
                continue;
            }
            clock.mark_within(&mut pass, "samples");
            pass.set_bind_group(1, &work.hiding, &[]);
            pass.set_pipeline(&self.occlude);
            for (uniform, &(bind_group, offset)) in face.casters.iter().enumerate() {
                pass.set_bind_group(0, bind_group, &[offset]);
                work.chunks.dispatch(&mut pass, uniform);
            }
            clock.mark_within(&mut pass, "casters");
            pass.set_pipeline(&self.occlude_tiles);
            pass.dispatch_workgroups(TILE_GROUPS, 1, 1);
            clock.mark_within(&mut pass, "large casters");
        }
    }
}

impl HardShadows {
    /// The same, but `hidden` says what is; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub(super) fn trace(
        &self,
        gpu: &Gpu,
        work: &Work,
        faces: &[LightFace<'_>],
        hidden: &Hidden<'_>,
        targets: &Targets,
    ) -> Result<(), RenderError> {
        let Rectangle { width, height, .. } = work.area;
        let (columns, rows) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
        let pixels = targets.width() as usize * targets.height() as usize;
        let mut occlusion = vec![0u32; pixels];
        // Where nothing is seen no sample is placed.
        let none = vec![Sample { position: [0.0; 3], slack: 0.0, place: ABSENT }; pixels];
        for (f, face) in faces.iter().enumerate() {
            gpu.queue.write_buffer(&self.samples, 0, bytemuck::cast_slice(&none));
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            {
                let mut pass = encoder.begin_compute_pass(&Default::default());
                pass.set_bind_group(1, &work.placing, &[]);
                pass.set_pipeline(&self.place);
                for &(bind_group, offset) in &face.receivers {
                    pass.set_bind_group(0, bind_group, &[offset]);
                    pass.dispatch_workgroups(columns, rows, 1);
                }
            }
            gpu.queue.submit([encoder.finish()]);
            let bytes = gpu.read_buffer(&self.samples, SAMPLE_BYTES * pixels as u64)?;
            let samples: Vec<Sample> = bytemuck::pod_collect_to_vec(&bytes);
            let placed: Vec<Option<[f32; 3]>> =
                samples.iter().map(|s| (s.place < TURNED).then_some(s.position)).collect();
            for ((sum, part), sample) in occlusion.iter_mut().zip(hidden(f, &placed)).zip(&samples)
            {
                let turned = if sample.place == TURNED { HIDDEN } else { 0 };
                *sum = (*sum).max(part).max(turned);
            }
        }
        gpu.queue.write_buffer(targets.occlusion(gpu), 0, bytemuck::cast_slice(&occlusion));
        Ok(())
    }
}

impl Work {
    /// The number of each uniform's first chunk.
    pub(super) fn first_chunks(&self) -> &[u32] {
        &self.chunks.firsts
    }
}

/// The second number of `Tiles` in `occlude.wgsl` and `soften.wgsl`.
pub(super) fn tiles_beyond(gpu: &Gpu, tiles: &wgpu::Buffer) -> Result<u32, RenderError> {
    let bytes = gpu.read_buffer(tiles, 8)?;
    let [_, beyond]: [u32; 2] = bytemuck::pod_read_unaligned(&bytes);
    Ok(beyond)
}
