//! Vertices of cells, and the triangles between them.

use super::dual::{Case, EDGE_CORNERS, NONE, OTHERS, edge_at, face_ring};
use super::grid::{CELLS, Grid, TILE};
use super::polygonise::{SIDE, ScannerNoise};
use glam::DVec3;

/// A tile's vertices.
pub struct Mesh {
    /// For each cell with surface, the place of its first vertex in `vertices`.
    first: Vec<u16>,
    /// The vertices, mm.
    pub vertices: Vec<[f32; 3]>,
    /// Index of `vertices[0]` in the file.
    pub base: u32,
}

/// A slab's cells.
#[derive(Default)]
pub struct Layer {
    /// Which tile lies where, as in the slab.
    pub index: Vec<u32>,
    /// The sign pattern of each cell of each tile.
    pub patterns: Vec<Vec<u8>>,
    /// The vertices of each tile.
    pub meshes: Vec<Mesh>,
}

/// What all cells share.
pub struct Cells<'a> {
    /// The grid.
    pub grid: &'a Grid,
    /// The scanner's noise.
    pub noise: ScannerNoise,
    /// Tables of the dual surface.
    pub cases: Vec<Case>,
}

/// A cell: its layer, its tile there, and its place in the tile.
#[derive(Clone, Copy)]
struct Place<'l> {
    layer: &'l Layer,
    tile: usize,
    cell: usize,
}

impl<'l> Place<'l> {
    fn pattern(&self) -> u8 {
        self.layer.patterns[self.tile][self.cell]
    }

    fn vertex(&self, n: u32) -> (u32, [f32; 3]) {
        let mesh = &self.layer.meshes[self.tile];
        let local = u32::from(mesh.first[self.cell]) + n;
        (mesh.base + local, mesh.vertices[local as usize])
    }
}

/// The layers within a tile's reach.
struct Around<'l> {
    nx: usize,
    at: [usize; 2],
    tile: usize,
    layer: &'l Layer,
    below: &'l Layer,
}

impl<'l> Around<'l> {
    /// The cell at `local` of the tile, or, where a coordinate is −1, of its neighbour.
    ///
    /// A tile without samples has one sign in all its cells (see the search's ball), so the
    /// cells round a crossing edge are always there.
    #[inline]
    fn cell(&self, local: [i32; 3]) -> Place<'l> {
        let wrapped = local.map(|v| (v & (TILE as i32 - 1)) as usize);
        let cell = (wrapped[2] * TILE + wrapped[1]) * TILE + wrapped[0];
        let layer = if local[2] < 0 { self.below } else { self.layer };
        let mut tile = self.tile;
        if (local[0] | local[1] | local[2]) < 0 {
            let x = self.at[0] - usize::from(local[0] < 0);
            let y = self.at[1] - usize::from(local[1] < 0);
            tile = layer.index[y * self.nx + x] as usize;
            assert!(
                tile < layer.patterns.len(),
                "the surface leaves the tiles that were found to hold it"
            );
        }
        Place { layer, tile, cell }
    }
}

/// Offset of corner `c` of the cell at `local` in a gathered tile.
#[inline]
fn block_place(local: [usize; 3], c: usize) -> usize {
    let (x, y, z) = (c & 1, c >> 1 & 1, c >> 2);
    ((local[2] + z) * SIDE + local[1] + y) * SIDE + local[0] + x
}

fn corner_at(c: usize) -> DVec3 {
    DVec3::new((c & 1) as f64, (c >> 1 & 1) as f64, (c >> 2) as f64)
}

/// Where edge `e` crosses the surface, in the cell's coordinates.
#[inline]
fn crossing(corners: &[f32; 8], e: usize) -> DVec3 {
    let [p, q] = EDGE_CORNERS[e];
    let (a, b) = (f64::from(corners[p]), f64::from(corners[q]));
    let t = a / (a - b);
    let mut at = corner_at(p);
    at[e / 4] = t;
    at
}

fn local_of(cell: usize) -> [usize; 3] {
    [cell % TILE, cell / TILE % TILE, cell / (TILE * TILE)]
}

/// The two segments of an ambiguous lower face: the outside corner that each cuts off, and
/// the two edges that it joins.
fn face_segments(pattern: u8, axis: usize) -> impl Iterator<Item = (usize, [usize; 2])> {
    let (corners, edges) = face_ring(axis, 0);
    (0..4)
        .filter(move |i| pattern >> corners[*i] & 1 == 0)
        .map(move |i| (corners[i], [edges[(i + 3) % 4], edges[i]]))
}

impl Cells<'_> {
    /// One vertex for each patch of each cell, at the mean of where its edges cross, and
    /// two for each lower face that needs them.
    pub fn place(&self, at: [usize; 3], block: &[f32], patterns: &[u8]) -> Mesh {
        let mut vertices = Vec::with_capacity(640);
        let mut first = vec![0u16; CELLS];
        for (c, pattern) in patterns.iter().enumerate() {
            if matches!(pattern, 0 | 255) {
                continue;
            }
            first[c] = vertices.len() as u16;
            let local = local_of(c);
            let case = &self.cases[usize::from(*pattern)];
            let corners: [f32; 8] = std::array::from_fn(|i| block[block_place(local, i)]);
            let cell: [usize; 3] = std::array::from_fn(|d| at[d] * TILE + local[d]);
            let normal = self.normal(&corners);
            let mut sums = [(DVec3::ZERO, 0.0); 4];
            for (e, patch) in case.patch.iter().enumerate() {
                if *patch != NONE {
                    let sum = &mut sums[usize::from(*patch)];
                    sum.0 += crossing(&corners, e);
                    sum.1 += 1.0;
                }
            }
            for (patch, (sum, count)) in sums[..usize::from(case.patches)].iter().enumerate() {
                vertices.push(self.vertex(cell, sum / count, normal, patch));
            }
            for axis in 0..3 {
                if case.double >> axis & 1 == 1 {
                    for (n, (_, [p, q])) in face_segments(*pattern, axis).enumerate() {
                        let middle = (crossing(&corners, p) + crossing(&corners, q)) * 0.5;
                        vertices.push(self.vertex(cell, middle, normal, 4 + 2 * axis + n));
                    }
                }
            }
        }
        Mesh { first, vertices, base: 0 }
    }

    /// The triangles round every crossing edge that starts at a sample of the tile.
    pub fn join(&self, tile: usize, at: [usize; 2], layer: &Layer, below: &Layer) -> Vec<[u32; 3]> {
        let around = self.around(tile, at, layer, below);
        let mut triangles = Vec::with_capacity(2 * layer.meshes[tile].vertices.len());
        let mut ring = Vec::with_capacity(8);
        for (c, pattern) in layer.patterns[tile].iter().enumerate() {
            if matches!(pattern, 0 | 255) {
                continue;
            }
            let local = local_of(c).map(|v| v as i32);
            let inside = pattern & 1 == 1;
            for axis in 0..3 {
                if (pattern >> (1 << axis) & 1 == 1) == inside {
                    continue;
                }
                let inserted = self.ring(&around, local, axis, inside, &mut ring);
                fan(&ring, inserted, inside, &mut triangles);
            }
        }
        triangles
    }

    /// The vertices round the edge along `axis` at the lower corner of the cell at `local`,
    /// anticlockwise seen from its upper end. Gives the place of one that
    /// belongs to a face, if there is any.
    fn ring(
        &self,
        around: &Around<'_>,
        local: [i32; 3],
        axis: usize,
        inside: bool,
        ring: &mut Vec<(u32, [f32; 3])>,
    ) -> Option<usize> {
        // The four cells, by how far each lies back along the other two axes, and the axis
        // of the face that leads to the next.
        const TURN: [([i32; 2], usize); 4] = [([1, 1], 0), ([0, 1], 1), ([0, 0], 0), ([1, 0], 1)];
        let [a, b] = OTHERS[axis];
        let mut inserted = None;
        ring.clear();
        let places: [Place<'_>; 4] = std::array::from_fn(|i| {
            let ([back_a, back_b], _) = TURN[i];
            let mut l = local;
            l[a] -= back_a;
            l[b] -= back_b;
            around.cell(l)
        });
        for i in 0..4 {
            let ([back_a, back_b], lead) = TURN[i];
            let place = &places[i];
            let pattern = place.pattern();
            let case = &self.cases[usize::from(pattern)];
            let edge = edge_at(axis, back_a as usize, back_b as usize);
            ring.push(place.vertex(u32::from(case.patch[edge])));
            // The face to the next cell: upwards in the first half of the turn.
            let next = &places[(i + 1) % 4];
            let (across, along) = ([a, b][lead], [b, a][lead]);
            let high = if i < 2 { next } else { place };
            let pattern = high.pattern();
            let double = self.cases[usize::from(pattern)].double;
            if double >> across & 1 == 0 {
                continue;
            }
            inserted = Some(ring.len());
            // Of its two segments, the one round this edge's outside end.
            let back_along = [back_b, back_a][lead] as usize;
            let outside = usize::from(inside) << axis | back_along << along;
            let before = 2 * (double & ((1 << across) - 1)).count_ones();
            let nth = face_segments(pattern, across)
                .position(|(corner, _)| corner == outside)
                .unwrap_or_else(|| unreachable!("an edge of the face has an outside end"));
            let patches = u32::from(self.cases[usize::from(pattern)].patches);
            ring.push(high.vertex(patches + before + nth as u32));
        }
        inserted
    }

    fn around<'l>(
        &self,
        tile: usize,
        at: [usize; 2],
        layer: &'l Layer,
        below: &'l Layer,
    ) -> Around<'l> {
        Around { nx: self.grid.tiles[0], at, tile, layer, below }
    }

    /// The field's direction of growth in a cell, in the grid's axes.
    fn normal(&self, corners: &[f32; 8]) -> DVec3 {
        let along = |axis: usize| -> f64 {
            (0..8)
                .filter(|c| c >> axis & 1 == 0)
                .map(|c| f64::from(corners[c | 1 << axis]) - f64::from(corners[c]))
                .sum()
        };
        DVec3::new(along(0), along(1), along(2)).normalize_or_zero()
    }

    fn vertex(&self, cell: [usize; 3], inner: DVec3, normal: DVec3, n: usize) -> [f32; 3] {
        let at = DVec3::new(cell[0] as f64, cell[1] as f64, cell[2] as f64) + inner;
        let shift = normal * self.noise.shift(cell, n as u64);
        (self.grid.model_from_grid(at) + self.grid.model_from_direction(shift)).as_vec3().to_array()
    }
}

/// Triangles of a ring, turned outwards: the ring runs anticlockwise about the edge, whose
/// lower end is `inside` or not. A quad is split along its shorter diagonal, a longer ring
/// from a vertex that belongs to a face: no other ring has its diagonals.
fn fan(
    ring: &[(u32, [f32; 3])],
    inserted: Option<usize>,
    inside: bool,
    triangles: &mut Vec<[u32; 3]>,
) {
    let apart = |p: usize, q: usize| {
        (0..3).map(|d| (ring[p].1[d] - ring[q].1[d]) * (ring[p].1[d] - ring[q].1[d])).sum::<f32>()
    };
    let start = inserted.unwrap_or_else(|| usize::from(apart(1, 3) < apart(0, 2)));
    let at = |i: usize| ring[(start + i) % ring.len()].0;
    for i in 1..ring.len() - 1 {
        triangles.push(if inside { [at(0), at(i), at(i + 1)] } else { [at(0), at(i + 1), at(i)] });
    }
}
