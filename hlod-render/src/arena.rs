//! Geometry on the GPU: a few large buffers, divided into the nodes' ranges.

use std::ops::Range;

use hlod_compress::Scalars;
use range_alloc::RangeAllocator;

use crate::edges::NO_VERTEX;
use crate::gpu::Gpu;
use crate::loader::{GpuMesh, PointPrefix};
use crate::skirts::{Borders, Faces, SkirtGroup, VERTICES_MAX};

/// Set in an index of a point, which none of a triangle or a skirt has: see `shared.wgsl`.
const POINT: u32 = 7 << 29;

/// Vertices and triangles of many nodes in one set of buffers.
pub(crate) struct Arena {
    pub(crate) vertices: wgpu::Buffer,
    pub(crate) indices: wgpu::Buffer,
    /// For each index the vertex across the edge that begins there: see [`crate::edges`]. Only of what
    /// casts shadows.
    pub(crate) across: wgpu::Buffer,
    /// One RGBA8 a vertex; a single entry where the model has no colours.
    pub(crate) colours: wgpu::Buffer,
    /// Codes of kept numbers, 16 bits each; a single entry where the model has none.
    pub(crate) scalars: wgpu::Buffer,
    free_vertices: RangeAllocator<u32>,
    free_triangles: RangeAllocator<u32>,
}

/// How large arenas are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ArenaSize {
    pub(crate) vertices: u32,
    pub(crate) triangles: u32,
    pub(crate) has_colours: bool,
    pub(crate) has_scalars: bool,
}

const VERTEX_BYTES: u64 = 16;
const TRIANGLE_BYTES: u64 = 12;
const EDGE_BYTES: u64 = 12;
const COLOUR_BYTES: u64 = 4;
const SCALARS_BYTES: u64 = size_of::<Scalars>() as u64;
/// Bytes of one buffer at most.
const BUFFER_BYTES_MAX: u64 = 128 << 20;
// An index of a skirt says more than a vertex' number.
const _: () = assert!(BUFFER_BYTES_MAX / VERTEX_BYTES < VERTICES_MAX as u64);

impl ArenaSize {
    /// For a model of so many vertices, and triangles and points, in all, within what one binding may
    /// hold.
    pub(crate) fn for_model(
        gpu: &Gpu,
        vertices: u64,
        primitives: u64,
        has_colours: bool,
    ) -> ArenaSize {
        let binding = gpu.device.limits().max_storage_buffer_binding_size.min(BUFFER_BYTES_MAX);
        // Half again for ranges that do not fit exactly.
        let fit = |count: u64, bytes: u64| (count + count / 2 + 1024).min(binding / bytes) as u32;
        ArenaSize {
            vertices: fit(vertices, VERTEX_BYTES),
            triangles: fit(primitives, TRIANGLE_BYTES),
            has_colours,
            has_scalars: false,
        }
    }

    /// With room for kept numbers, where the model has any.
    pub(crate) fn with_scalars(self, has_scalars: bool) -> ArenaSize {
        ArenaSize { has_scalars, ..self }
    }

    /// Smaller, where two would not fit into so many bytes; but never so small that usual pages do
    /// not fit.
    pub(crate) fn within(self, bytes: u64) -> ArenaSize {
        const VERTICES_LEAST: u32 = 1 << 17;
        let share = (bytes as f64 / 2.0 / self.bytes() as f64).min(1.0);
        let fit =
            |count: u32, least: u32| ((f64::from(count) * share) as u32).max(least.min(count));
        ArenaSize {
            vertices: fit(self.vertices, VERTICES_LEAST),
            triangles: fit(self.triangles, 2 * VERTICES_LEAST),
            ..self
        }
    }

    /// Bytes that a page takes, about: skirts add to it, and their corners.
    pub(crate) fn bytes_of(vertices: u64, triangles: u64, points: u64) -> u64 {
        let skirts = triangles / 8;
        let primitives = triangles + skirts + points;
        (vertices + skirts / 2 + points) * VERTEX_BYTES + primitives * (TRIANGLE_BYTES + EDGE_BYTES)
    }

    /// Half as large; none where usual pages would not fit any more.
    pub(crate) fn halved(self) -> Option<ArenaSize> {
        const VERTICES_LEAST: u32 = 1 << 12;
        let half = ArenaSize { vertices: self.vertices / 2, triangles: self.triangles / 2, ..self };
        (half.vertices >= VERTICES_LEAST).then_some(half)
    }

    pub(crate) fn bytes(&self) -> u64 {
        let colours = if self.has_colours { COLOUR_BYTES } else { 0 };
        let scalars = if self.has_scalars { SCALARS_BYTES } else { 0 };
        u64::from(self.vertices) * (VERTEX_BYTES + colours + scalars)
            + u64::from(self.triangles) * (TRIANGLE_BYTES + EDGE_BYTES)
    }
}

/// A node's place in an arena.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Slot {
    pub(crate) arena: usize,
    pub(crate) vertices: Range<u32>,
    /// Of these, the first lower corner of skirts.
    pub(crate) first_corner: u32,
    /// Triangles, then skirts, then points, which are counted like them.
    pub(crate) primitives: Range<u32>,
    /// What skirts there are, in their order.
    pub(crate) skirts: Vec<SkirtGroup>,
    /// What the triangles end in on each face of the cell.
    pub(crate) borders: Borders,
    /// The first point.
    pub(crate) first_point: u32,
    /// How many points cover: see [`GpuMesh::prefixes`].
    pub(crate) prefixes: Vec<PointPrefix>,
}

impl Slot {
    /// Bytes on the GPU.
    pub(crate) fn bytes(&self) -> u64 {
        u64::from(self.vertices.end - self.vertices.start) * VERTEX_BYTES
            + u64::from(self.primitives.end - self.primitives.start) * (TRIANGLE_BYTES + EDGE_BYTES)
    }

    /// Triangles, and all skirts.
    pub(crate) fn triangles(&self) -> Range<u32> {
        self.primitives.start..self.first_point
    }

    /// Triangles, and the skirts that are needed where these faces are open: as few ranges as there may be.
    pub(crate) fn triangles_and_skirts(&self, open: Faces) -> Vec<Range<u32>> {
        let count: u32 = self.skirts.iter().map(|group| group.triangles).sum();
        let mut at = self.first_point - count;
        let triangles = self.primitives.start..at;
        let mut ranges: Vec<Range<u32>> = std::iter::once(triangles).collect();
        for group in &self.skirts {
            let range = at..at + group.triangles;
            at = range.end;
            if group.faces & !open != 0 {
                continue;
            }
            match ranges.last_mut().filter(|last| last.end == range.start) {
                Some(last) => last.end = range.end,
                None => ranges.push(range),
            }
        }
        ranges.retain(|range| !range.is_empty());
        ranges
    }

    pub(crate) fn points(&self) -> Range<u32> {
        let count = self.prefixes.last().map_or(0, |all| all.count);
        self.first_point..self.first_point + count
    }
}

impl Arena {
    /// `None` where the adapter has no memory for it.
    pub(crate) fn new(gpu: &Gpu, size: ArenaSize) -> Option<Arena> {
        gpu.with_room(size.bytes(), || Arena::made(gpu, size))
    }

    fn made(gpu: &Gpu, size: ArenaSize) -> Arena {
        let buffer = |label, bytes: u64| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let coloured = if size.has_colours { u64::from(size.vertices) } else { 1 };
        let numbered = if size.has_scalars { u64::from(size.vertices) } else { 1 };
        Arena {
            vertices: buffer("vertices", u64::from(size.vertices) * VERTEX_BYTES),
            indices: buffer("indices", u64::from(size.triangles) * TRIANGLE_BYTES),
            across: buffer("edges", u64::from(size.triangles) * EDGE_BYTES),
            colours: buffer("colours", coloured * COLOUR_BYTES),
            scalars: buffer("kept numbers", numbered * SCALARS_BYTES),
            free_vertices: RangeAllocator::new(0..size.vertices),
            free_triangles: RangeAllocator::new(0..size.triangles),
        }
    }

    /// Copies a mesh into free ranges; `None` where there are none large enough.
    pub(crate) fn insert(&mut self, gpu: &Gpu, mesh: &GpuMesh, arena: usize) -> Option<Slot> {
        let triangle_count = (mesh.indices.len() / 3) as u32;
        let primitive_count = triangle_count + mesh.radii.len() as u32;
        // The allocator does not hand out empty ranges.
        let vertices =
            self.free_vertices.allocate_range((mesh.vertices.len() as u32).max(1)).ok()?;
        let Ok(triangles) = self.free_triangles.allocate_range(primitive_count.max(1)) else {
            self.free_vertices.free_range(vertices);
            return None;
        };
        let mut indices: Vec<u32> = mesh.indices.iter().map(|i| i + vertices.start).collect();
        // Vertices of points are the last ones.
        let first_of_points = vertices.start + (mesh.vertices.len() - mesh.radii.len()) as u32;
        for (vertex, radius) in (first_of_points..).zip(&mesh.radii) {
            indices.extend([vertex | POINT, vertex | POINT, *radius]);
        }
        let at = |start: u32, bytes: u64| u64::from(start) * bytes;
        let write = |buffer, offset, bytes: &[u8]| gpu.queue.write_buffer(buffer, offset, bytes);
        write(
            &self.vertices,
            at(vertices.start, VERTEX_BYTES),
            bytemuck::cast_slice(&mesh.vertices),
        );
        write(&self.indices, at(triangles.start, TRIANGLE_BYTES), bytemuck::cast_slice(&indices));
        if !mesh.across.is_empty() {
            let moved = |v: &u32| if *v == NO_VERTEX { *v } else { v + vertices.start };
            let across: Vec<u32> = mesh.across.iter().map(moved).collect();
            write(&self.across, at(triangles.start, EDGE_BYTES), bytemuck::cast_slice(&across));
        }
        if !mesh.colours.is_empty() {
            let colours = bytemuck::cast_slice(&mesh.colours);
            write(&self.colours, at(vertices.start, COLOUR_BYTES), colours);
        }
        if !mesh.scalars.is_empty() {
            let scalars = bytemuck::cast_slice(&mesh.scalars);
            write(&self.scalars, at(vertices.start, SCALARS_BYTES), scalars);
        }
        let primitives = triangles.start..triangles.start + primitive_count.max(1);
        // An empty page has a triangle that is never drawn.
        let first_point = match primitive_count {
            0 => primitives.start,
            _ => primitives.start + triangle_count,
        };
        Some(Slot {
            arena,
            first_corner: vertices.start + mesh.corners.start as u32,
            vertices,
            primitives,
            skirts: mesh.skirts.clone(),
            borders: mesh.borders,
            first_point,
            prefixes: mesh.prefixes.clone(),
        })
    }

    /// Writes the vertices of a slot's skirts anew.
    pub(crate) fn write_corners(&self, gpu: &Gpu, slot: &Slot, corners: &[u8]) {
        let offset = u64::from(slot.first_corner) * VERTEX_BYTES;
        gpu.queue.write_buffer(&self.vertices, offset, corners);
    }

    pub(crate) fn remove(&mut self, slot: Slot) {
        self.free_vertices.free_range(slot.vertices);
        self.free_triangles.free_range(slot.primitives);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skirts_of_closed_faces_are_left_out() {
        let group = |faces, triangles| SkirtGroup { faces, triangles };
        let slot = Slot {
            arena: 0,
            vertices: 0..50,
            first_corner: 40,
            primitives: 100..200,
            skirts: vec![group(1, 10), group(3, 2), group(2, 20), group(32, 4)],
            borders: [0; 6],
            first_point: 190,
            prefixes: Vec::new(),
        };
        let drawn = |open| -> Vec<(u32, u32)> {
            slot.triangles_and_skirts(open).iter().map(|range| (range.start, range.end)).collect()
        };
        assert_eq!(drawn(0), [(100, 154)]);
        assert_eq!(drawn(1), [(100, 164)]);
        // What joins the strips of two faces hangs from both.
        assert_eq!(drawn(2), [(100, 154), (166, 186)]);
        assert_eq!(drawn(2 | 32), [(100, 154), (166, 190)]);
        assert_eq!(drawn(63), [(100, 190)]);
        let empty = Slot { skirts: Vec::new(), primitives: 7..8, first_point: 7, ..slot };
        assert!(empty.triangles_and_skirts(63).is_empty());
    }
}
