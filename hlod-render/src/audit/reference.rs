//! The scan itself, on the GPU, from its own vertices.

use std::collections::HashMap;
use std::path::PathBuf;

use glam::DMat4;
use hlod_compress::OctNormal;

use crate::arena::{Arena, ArenaSize, Slot};
use crate::error::RenderError;
use crate::frame::Renderer;
use crate::gpu::Gpu;
use crate::loader::{GpuMesh, GpuVertex, model_origin};
use crate::model::Model;
use crate::passes::{Range, Rectangle, Targets};
use crate::scene::Shot;

/// All triangles of the inputs, in a few arenas.
pub(super) struct Reference {
    arenas: Vec<Arena>,
    slots: Vec<Slot>,
    arena_triangles: u32,
    world_from_model: DMat4,
    has_colours: bool,
    /// Whether the file's own flag says that backs can never be seen.
    pub(super) closed_oriented: bool,
}

/// Triangles copied at once.
const CHUNK_TRIANGLES: usize = 1 << 20;

impl Reference {
    pub(super) fn load(
        gpu: &Gpu,
        inputs: &[PathBuf],
        model: &Model,
    ) -> Result<Reference, RenderError> {
        let scan = hlod_scan::load(inputs, &mut |_, _| {})?;
        let origin = model_origin(&model.header().lattice);
        let has_colours = !scan.colours.is_empty();
        let size = ArenaSize::for_model(
            gpu,
            2 * scan.positions.len() as u64,
            scan.triangles.len() as u64,
            has_colours,
        );
        let (mut arenas, mut slots): (Vec<Arena>, Vec<Slot>) = (Vec::new(), Vec::new());
        for triangles in scan.triangles.chunks(CHUNK_TRIANGLES) {
            let mut mesh = GpuMesh::default();
            let mut index_of: HashMap<u32, u32> = HashMap::new();
            for &v in triangles.iter().flatten() {
                let index = *index_of.entry(v).or_insert_with(|| {
                    let v = v as usize;
                    mesh.vertices.push(GpuVertex {
                        position: (scan.positions[v] - origin).as_vec3().to_array(),
                        normal: OctNormal::encode(scan.normals[v].to_array()).0,
                    });
                    mesh.colours.extend(scan.colours.get(v));
                    mesh.vertices.len() as u32 - 1
                });
                mesh.indices.push(index);
            }
            let found = arenas.iter_mut().enumerate().find_map(|(i, a)| a.insert(gpu, &mesh, i));
            let slot = match found {
                Some(slot) => slot,
                None => {
                    let mut arena = Arena::new(gpu, size);
                    let slot = arena.insert(gpu, &mesh, arenas.len());
                    arenas.push(arena);
                    slot.ok_or_else(|| gpu.error("a part of the scan is larger than a buffer"))?
                }
            };
            slots.push(slot);
        }
        Ok(Reference {
            arenas,
            slots,
            arena_triangles: size.triangles,
            world_from_model: model.world_from_model(),
            has_colours,
            closed_oriented: model.skeleton().nodes()[0].closed_oriented,
        })
    }

    pub(super) fn draw(
        &self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        shot: &Shot,
        targets: &Targets,
    ) -> Result<(), RenderError> {
        let uniforms: Vec<_> = self
            .arenas
            .iter()
            .enumerate()
            .map(|(i, arena)| {
                let first = i as u32 * self.arena_triangles;
                let uniform = crate::frame::uniform(
                    self.world_from_model,
                    self.has_colours,
                    shot,
                    targets,
                    first,
                );
                (uniform, arena)
            })
            .collect();
        let ranges: Vec<Range> = self
            .slots
            .iter()
            .map(|s| Range { uniform: s.arena, triangles: s.triangles.clone(), cull_backs: false })
            .collect();
        renderer.draw_ranges(gpu, &uniforms, &ranges, Rectangle::all(targets), shot, targets)
    }
}
