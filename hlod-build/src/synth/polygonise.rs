//! Slabs of samples → vertices and triangles, in constant memory.
//!
//! Few slabs are alive at a time: the samples of this one, the last and the next, and the
//! vertices that the last left for the faces that reach back into it. Within a slab, tiles are
//! worked on in parallel; their results are put down in the order of the slab's tiles, so
//! that the bytes depend on nothing but the options.

use super::cells::{Cells, Layer};
use super::clean::{HALO, WIDE, remove_specks};
use super::dual;
use super::grid::{CELLS, Grid, INSIDE, OUTSIDE, Search, Slab, TILE};
use super::noise::hash64;
use rayon::prelude::*;

/// Where vertices and triangles go.
pub trait Sink {
    /// What can go wrong there.
    type Error;
    /// Take vertices, mm.
    fn vertices(&mut self, vertices: &[[f32; 3]]) -> Result<(), Self::Error>;
    /// Take triangles, outward oriented.
    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<(), Self::Error>;
}

/// Scanner noise: every vertex moves along the surface's normal by a bounded amount that
/// depends on its grid cell and the seed alone.
#[derive(Clone, Copy, Debug)]
pub struct ScannerNoise {
    /// Standard deviation, mm. No vertex moves more than [`NOISE_MAX_SIGMAS`] of these.
    pub sigma: f64,
    /// Seed.
    pub seed: u64,
}

/// Largest noise over its standard deviation: four uniform numbers are added.
pub const NOISE_MAX_SIGMAS: f64 = 3.464_101_615_137_754_6;

impl ScannerNoise {
    /// The way of vertex `n` of a cell along its normal, mm.
    pub fn shift(&self, cell: [usize; 3], n: u64) -> f64 {
        let place = (cell[0] as u64) << 42 ^ (cell[1] as u64) << 21 ^ cell[2] as u64;
        let h = hash64(hash64(place ^ self.seed.rotate_left(17)) ^ n);
        let sum: u64 = (0..4).map(|i| h >> (16 * i) & 0xffff).sum();
        // Four uniforms in ±1 have variance 4/3; the sum's range is ±4.
        let uniform = (2 * sum) as f64 / 65535.0 - 4.0;
        uniform * 0.25 * NOISE_MAX_SIGMAS * self.sigma
    }
}

/// Samples along a tile's edge with the next tile's first.
pub const SIDE: usize = TILE + 1;

/// Turn the field on a grid into triangles.
pub fn polygonise<S: Sink>(
    search: &Search<'_>,
    noise: ScannerNoise,
    sink: &mut S,
) -> Result<(), S::Error> {
    polygonise_slabs(search.grid, |k| search.sample(k), noise, sink)
}

/// Turn slabs of samples into triangles, whoever samples them.
pub fn polygonise_slabs<S: Sink>(
    grid: &Grid,
    sample: impl Fn(usize) -> Slab,
    noise: ScannerNoise,
    sink: &mut S,
) -> Result<(), S::Error> {
    let cells = Cells { grid, noise, cases: dual::cases() };
    let slabs = grid.tiles[2];
    let mut below = Layer::default();
    let mut under = sample(slabs);
    let mut slab = sample(0);
    let mut vertex_count = 0u32;
    for k in 0..slabs {
        let above = sample(k + 1);
        slab.complete(&above, [grid.tiles[0], grid.tiles[1]]);
        // Find the cells that hold surface, place their vertices, and number them in order.
        let (patterns, meshes) = slab
            .tiles
            .par_iter()
            .map(|tile| {
                let block = gather(grid, tile.at, [&under, &slab, &above]);
                let patterns = patterns(&block);
                let mesh = cells.place([tile.at[0], tile.at[1], k], &block, &patterns);
                (patterns, mesh)
            })
            .unzip();
        let mut layer = Layer { index: slab.index.clone(), patterns, meshes };
        for mesh in &mut layer.meshes {
            mesh.base = vertex_count;
            vertex_count += mesh.vertices.len() as u32;
            sink.vertices(&mesh.vertices)?;
        }
        // Join them across the grid edges that cross the surface.
        let triangles: Vec<Vec<[u32; 3]>> = slab
            .tiles
            .par_iter()
            .enumerate()
            .map(|(n, tile)| cells.join(n, tile.at, &layer, &below))
            .collect();
        for t in &triangles {
            sink.triangles(t)?;
        }
        below = layer;
        under = std::mem::replace(&mut slab, above);
    }
    Ok(())
}

/// A tile's samples with one more on each upper side, free of specks.
fn gather(grid: &Grid, at: [usize; 2], slabs: [&Slab; 3]) -> Vec<f32> {
    let [nx, ny, _] = grid.tiles;
    let mut wide = vec![0.0f32; WIDE * WIDE * WIDE];
    // What of the neighbour below, of the tile, and of the neighbour above is needed: where
    // it goes, and where it begins there.
    let spans = [(0..HALO, TILE - HALO), (HALO..HALO + TILE, 0), (HALO + TILE..WIDE, 0)];
    for part in 0..27usize {
        let d = [part % 3, part / 3 % 3, part / 9];
        let (x, y) = ((at[0] + d[0]).wrapping_sub(1), (at[1] + d[1]).wrapping_sub(1));
        let from = slabs[d[2]];
        let state = if x < nx && y < ny { from.index[y * nx + x] } else { OUTSIDE };
        let samples = from.tiles.get(state as usize).map(|t| &t.samples);
        let constant = if state == INSIDE { -1.0 } else { 1.0 };
        let [(to_x, from_x), (to_y, from_y), (to_z, from_z)] = d.map(|d| spans[d].clone());
        for (z, fz) in to_z.zip(from_z..) {
            for (y, fy) in to_y.clone().zip(from_y..) {
                let to = (z * WIDE + y) * WIDE;
                let row = &mut wide[to..to + WIDE][to_x.clone()];
                match samples {
                    None => row.fill(constant),
                    Some(s) => {
                        let start = (fz * TILE + fy) * TILE + from_x;
                        row.copy_from_slice(&s[start..start + row.len()]);
                    }
                }
            }
        }
    }
    remove_specks(&mut wide);
    let mut block = Vec::with_capacity(SIDE * SIDE * SIDE);
    for z in HALO..HALO + SIDE {
        for y in HALO..HALO + SIDE {
            let row = (z * WIDE + y) * WIDE + HALO;
            block.extend_from_slice(&wide[row..row + SIDE]);
        }
    }
    block
}

/// The sign pattern of each cell of a gathered tile.
fn patterns(block: &[f32]) -> Vec<u8> {
    // Along a row, a cell's upper corners are the next cell's lower ones.
    let mut patterns = Vec::with_capacity(CELLS);
    for z in 0..TILE {
        for y in 0..TILE {
            let row = |dy: usize, dz: usize| &block[((z + dz) * SIDE + y + dy) * SIDE..][..SIDE];
            let rows = [row(0, 0), row(1, 0), row(0, 1), row(1, 1)];
            let column =
                |x: usize| (0..4).fold(0u8, |bits, r| bits | u8::from(rows[r][x] < 0.0) << (2 * r));
            let mut lower = column(0);
            for x in 1..SIDE {
                let upper = column(x);
                patterns.push(lower | upper << 1);
                lower = upper;
            }
        }
    }
    patterns
}
