//! The scan itself, on the GPU, from its own vertices.

use std::collections::HashMap;
use std::path::PathBuf;

use glam::{DMat4, DVec3};
use hlod_compress::OctNormal;

use crate::arena::{Arena, ArenaSize, Slot};
use crate::error::RenderError;
use crate::frame::Renderer;
use crate::gpu::Gpu;
use crate::lit::{Lit, LitPart};
use crate::loader::{GpuMesh, GpuVertex, model_origin};
use crate::model::Model;
use crate::passes::{Drawn, DrawnShadow, FrameUniform, Hidden, Range, Rectangle, Targets};
use crate::scene::{Shadow, Shot};
use crate::select::corners;
use crate::traced::Tracer;

/// All triangles of the inputs, in a few arenas.
pub(super) struct Reference {
    arenas: Vec<Arena>,
    slots: Vec<Slot>,
    arena_triangles: u32,
    world_from_model: DMat4,
    has_colours: bool,
    /// Rays against the same triangles, where shadows are audited.
    tracer: Option<Tracer>,
    /// Corners of the bounds, world space.
    corners: Vec<DVec3>,
    /// How many rays tell what is hidden of a light that is a disc, and from where.
    pub(super) rays: Option<Rays>,
    /// Whether the file's own flag says that backs can never be seen.
    pub(super) closed_oriented: bool,
}

/// Rays to a light that is a disc.
#[derive(Debug, Clone)]
pub(super) struct Rays {
    /// From each pixel.
    pub(super) rays: u32,
    /// The pixels; from others nothing is hidden.
    pub(super) chosen: Vec<bool>,
}

/// Triangles copied at once.
const CHUNK_TRIANGLES: usize = 1 << 20;

impl Reference {
    pub(super) fn load(
        gpu: &Gpu,
        inputs: &[PathBuf],
        model: &Model,
        with_shadows: bool,
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
                    let normal = OctNormal::encode(scan.normals[v].to_array());
                    let position = (scan.positions[v] - origin).as_vec3().to_array();
                    mesh.vertices.push(GpuVertex::new(position, normal));
                    mesh.colours.extend(scan.colours.get(v));
                    mesh.vertices.len() as u32 - 1
                });
                mesh.indices.push(index);
            }
            let found = arenas.iter_mut().enumerate().find_map(|(i, a)| a.insert(gpu, &mesh, i));
            let slot = match found {
                Some(slot) => slot,
                None => {
                    let arena = Arena::new(gpu, size);
                    let mut arena = arena.ok_or_else(|| gpu.error("no memory for the scan"))?;
                    let slot = arena.insert(gpu, &mesh, arenas.len());
                    arenas.push(arena);
                    slot.ok_or_else(|| gpu.error("a part of the scan is larger than a buffer"))?
                }
            };
            slots.push(slot);
        }
        let place = |v: u32| scan.positions[v as usize] - origin;
        let tracer = with_shadows.then(|| Tracer::of(scan.triangles.iter().map(|t| t.map(place))));
        let (low, high) = model.bounds();
        Ok(Reference {
            tracer,
            rays: None,
            corners: corners(low, high).to_vec(),
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
                let uniform = crate::uniform::uniform(
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
            .map(|s| Range {
                uniform: s.arena,
                triangles: s.triangles(),
                points_level: None,
                cull_backs: false,
                error: 0.0,
            })
            .collect();
        let area = Rectangle::all(targets);
        let Some(tracer) = self.tracer.as_ref().filter(|_| shot.shadow != Shadow::None) else {
            let drawn = Drawn { ranges: &ranges, parts: &[], area, shadow: DrawnShadow::None };
            return renderer.draw_ranges(gpu, &uniforms, &drawn, shot, targets);
        };
        let centre = self.world_from_model.transform_point3(DVec3::ZERO);
        let lit = Lit::around(&self.corners, centre, shot);
        let part = |uniform: &FrameUniform| LitPart {
            uniform: *uniform,
            world_from_model: self.world_from_model,
        };
        let parts: Vec<LitPart> = uniforms.iter().map(|(uniform, _)| part(uniform)).collect();
        let faces = lit.face_uniforms(&parts);
        let usual = lit.hidden_by(tracer, targets);
        let of_chosen = self.rays.as_ref().map(|rays| {
            let hidden = lit.hidden_by_rays(tracer, targets, rays.rays);
            move |face: usize, points: &[Option<[f32; 3]>]| {
                let chosen = |(p, chosen): (&Option<[f32; 3]>, &bool)| p.filter(|_| *chosen);
                let points: Vec<_> = points.iter().zip(&rays.chosen).map(chosen).collect();
                hidden(face, &points)
            }
        });
        let hidden: &Hidden<'_> = match &of_chosen {
            Some(hidden) => hidden,
            None => &usual,
        };
        let shadow = DrawnShadow::Traced { faces: &faces, hidden };
        let drawn = Drawn { ranges: &ranges, parts: &[], area, shadow };
        renderer.draw_ranges(gpu, &uniforms, &drawn, shot, targets)
    }
}
