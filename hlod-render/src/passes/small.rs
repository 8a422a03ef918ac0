//! Small triangles in compute, the others in fixed function, and both into identity and depth.
//!
//! `small` takes every triangle; what is too large for it, or has to be clipped, goes to a list that
//! `large` draws; `resolve` then lays what `small` found over that, where it is nearer.

use super::chunks::Chunks;
use super::resources::{
    Constants, buffer, compute_pipelines, entry, nearest, pipeline_layout, render_pipeline,
    storage_entry, write_growing,
};
use super::targets::IDENTITY_FORMAT;
use super::{Range, Targets};
use crate::gpu::Gpu;

/// Workgroups among which what is large is divided, and those among which its rows are.
const SPREAD_GROUPS: u32 = 256;
const SPREAD_STRIPES: u32 = 4;

pub(super) struct SmallTriangles {
    small: wgpu::ComputePipeline,
    spread: wgpu::ComputePipeline,
    large: wgpu::RenderPipeline,
    resolve: wgpu::RenderPipeline,
    compute_layout: wgpu::BindGroupLayout,
    list_layout: wgpu::BindGroupLayout,
    /// A word of 64 bits a pixel.
    pixels: wgpu::Buffer,
    chunks: wgpu::Buffer,
    /// Triangles left to fixed function, of each arena: of all arenas together they would not fit into a binding.
    lists: Vec<wgpu::Buffer>,
    /// Indirect draws of these, one for each arena.
    draws: wgpu::Buffer,
}

/// What one frame gives to the passes.
pub(super) struct Work {
    chunks: Chunks,
    /// Of each arena.
    compute: Vec<wgpu::BindGroup>,
    lists: Vec<wgpu::BindGroup>,
    words: wgpu::BindGroup,
}

impl SmallTriangles {
    /// `None` where the adapter lacks 64-bit atomics or they are not wanted.
    pub(super) fn new(
        gpu: &Gpu,
        geometry_layout: &wgpu::BindGroupLayout,
        constants: &Constants,
    ) -> Option<SmallTriangles> {
        if !gpu.small_triangles {
            return None;
        }
        let device = &gpu.device;
        let group_layout = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries };
            device.create_bind_group_layout(&descriptor)
        };
        let compute = wgpu::ShaderStages::COMPUTE;
        let compute_layout = group_layout(
            "small",
            &[
                storage_entry(0, compute, false),
                storage_entry(1, compute, true),
                storage_entry(2, compute, false),
                storage_entry(3, compute, false),
            ],
        );
        // The list of triangles for `large`, the pixels' words for `resolve`.
        let list_layout =
            group_layout("list", &[storage_entry(0, wgpu::ShaderStages::VERTEX_FRAGMENT, true)]);
        let groups = [Some(geometry_layout), Some(&compute_layout)];
        let [small] = compute_pipelines(gpu, &groups, hlod_shaders::SMALL, ["small"], constants);
        let [spread] = compute_pipelines(gpu, &groups, hlod_shaders::SPREAD, ["spread"], constants);
        let layout = pipeline_layout(gpu, "list", &[Some(geometry_layout), Some(&list_layout)]);
        let render =
            |pass| render_pipeline(gpu, &layout, pass, None, IDENTITY_FORMAT, nearest(), constants);
        let usage = wgpu::BufferUsages::STORAGE;
        Some(SmallTriangles {
            small,
            spread,
            large: render(hlod_shaders::LARGE),
            resolve: render(hlod_shaders::RESOLVE),
            compute_layout,
            list_layout,
            pixels: buffer(gpu, "pixels", 8, usage),
            chunks: buffer(gpu, "chunks", 1 << 16, usage),
            lists: Vec::new(),
            draws: buffer(gpu, "large draws", 256, usage | wgpu::BufferUsages::INDIRECT),
        })
    }

    /// Whether pictures of this size can be drawn.
    pub(super) fn fits(&self, gpu: &Gpu, targets: &Targets) -> bool {
        pixel_bytes(targets) <= gpu.device.limits().max_storage_buffer_binding_size
    }

    /// Uploads a frame's chunks; `ranges` come in the order of their uniforms.
    pub(super) fn prepare(
        &mut self,
        gpu: &Gpu,
        uniform_count: usize,
        ranges: &[&Range],
        targets: &Targets,
    ) -> Work {
        let chunks = Chunks::new(uniform_count, ranges);
        let draws = vec![[0, 1, 0, 0u32]; uniform_count];
        write_growing(gpu, &mut self.chunks, bytemuck::cast_slice(&chunks.chunks));
        write_growing(gpu, &mut self.draws, bytemuck::cast_slice(&draws));
        let usage = wgpu::BufferUsages::STORAGE;
        let grow = |target: &mut wgpu::Buffer, label, bytes: u64| {
            if target.size() < bytes {
                *target = buffer(gpu, label, bytes, usage);
            }
        };
        grow(&mut self.pixels, "pixels", pixel_bytes(targets));
        for (i, &triangles) in chunks.triangles.iter().enumerate() {
            let bytes = 4 * u64::from(triangles).next_power_of_two();
            match self.lists.get_mut(i) {
                Some(list) => grow(list, "large triangles", bytes),
                None => self.lists.push(buffer(gpu, "large triangles", bytes, usage)),
            }
        }
        let group = |label, layout, entries: &[wgpu::BindGroupEntry<'_>]| {
            let descriptor = wgpu::BindGroupDescriptor { label: Some(label), layout, entries };
            gpu.device.create_bind_group(&descriptor)
        };
        let compute = |list| {
            let entries = [
                entry(0, &self.pixels),
                entry(1, &self.chunks),
                entry(2, list),
                entry(3, &self.draws),
            ];
            group("small", &self.compute_layout, &entries)
        };
        let lists = &self.lists[..uniform_count];
        Work {
            chunks,
            compute: lists.iter().map(compute).collect(),
            lists: lists
                .iter()
                .map(|list| group("large", &self.list_layout, &[entry(0, list)]))
                .collect(),
            words: group("resolve", &self.list_layout, &[entry(0, &self.pixels)]),
        }
    }

    /// The compute pass; `geometry` has a bind group and its offset for each uniform.
    pub(super) fn rasterise(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        work: &Work,
        geometry: &[(&wgpu::BindGroup, u32)],
        targets: &Targets,
    ) {
        encoder.clear_buffer(&self.pixels, 0, Some(pixel_bytes(targets)));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("small"),
            timestamp_writes: None,
        });
        pass.set_pipeline(&self.small);
        for (uniform, &(bind_group, offset)) in geometry.iter().enumerate() {
            pass.set_bind_group(0, bind_group, &[offset]);
            pass.set_bind_group(1, &work.compute[uniform], &[]);
            work.chunks.dispatch(&mut pass, uniform);
        }
        if targets.window().is_part {
            pass.set_pipeline(&self.spread);
            for (uniform, &(bind_group, offset)) in geometry.iter().enumerate() {
                if work.chunks.counts[uniform] > 0 {
                    pass.set_bind_group(0, bind_group, &[offset]);
                    pass.set_bind_group(1, &work.compute[uniform], &[]);
                    pass.dispatch_workgroups(SPREAD_GROUPS, SPREAD_STRIPES, 1);
                }
            }
        }
    }

    /// What is left, and what was found, into a pass with identity and depth.
    pub(super) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        work: &Work,
        geometry: &[(&wgpu::BindGroup, u32)],
        targets: &Targets,
    ) {
        pass.set_pipeline(&self.large);
        for (i, &(bind_group, offset)) in geometry.iter().enumerate() {
            if work.chunks.counts[i] > 0 && !targets.window().is_part {
                pass.set_bind_group(0, bind_group, &[offset]);
                pass.set_bind_group(1, &work.lists[i], &[]);
                pass.draw_indirect(&self.draws, 16 * i as u64);
            }
        }
        if let Some(&(bind_group, offset)) = geometry.first() {
            pass.set_pipeline(&self.resolve);
            pass.set_bind_group(0, bind_group, &[offset]);
            pass.set_bind_group(1, &work.words, &[]);
            pass.draw(0..3, 0..1);
        }
    }
}

impl Work {
    /// The number of each uniform's first chunk.
    pub(super) fn first_chunks(&self) -> &[u32] {
        &self.chunks.firsts
    }
}

fn pixel_bytes(targets: &Targets) -> u64 {
    8 * u64::from(targets.width()) * u64::from(targets.height())
}
