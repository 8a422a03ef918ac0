//! Samples of the field on a regular grid, in tiles, one slab of tiles at a time, and only
//! where the surface passes.
//!
//! The grid is turned against the statue: no face of the plinth is parallel to it, so that
//! no slab holds a whole face (memory stays in proportion to a section's outline), the
//! density of triangles is much the same on all faces, and flat faces do not come out as
//! a suspiciously regular grid. Every sample belongs to one tile and is computed once:
//! whatever a bound may miss, two neighbours never disagree about a sign.

use super::field::{Field, Tape};
use super::lanes::{Lanes, Points, WIDTH};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Samples along a tile's edge.
pub const TILE: usize = 16;
/// Samples of a tile.
pub const CELLS: usize = TILE * TILE * TILE;

/// The turned grid: index (i, j, k) ↔ model coordinates in mm.
pub struct Grid {
    /// Step, mm.
    pub step: f64,
    /// Unit axes of the grid in the model, as columns.
    axes: DMat3,
    /// The model's place of index (0, 0, 0).
    origin: DVec3,
    /// Tiles along each axis; slabs follow the last.
    pub tiles: [usize; 3],
}

/// A box that holds every statue, mm.
const BOUNDS: [[f64; 3]; 2] = [[-224.0, -4.0, -150.0], [224.0, 625.0, 150.0]];

impl Grid {
    /// The grid of a step.
    pub fn new(step: f64) -> Grid {
        // A quaternion without small ratios, normalised.
        let (w, x, y, z) = (0.83f64, 0.27f64, -0.22f64, 0.41f64);
        let n = 1.0 / (w * w + x * x + y * y + z * z);
        let axes = DMat3::from_cols_array(&[
            1.0 - 2.0 * n * (y * y + z * z),
            2.0 * n * (x * y + w * z),
            2.0 * n * (x * z - w * y),
            2.0 * n * (x * y - w * z),
            1.0 - 2.0 * n * (x * x + z * z),
            2.0 * n * (y * z + w * x),
            2.0 * n * (x * z + w * y),
            2.0 * n * (y * z - w * x),
            1.0 - 2.0 * n * (x * x + y * y),
        ]);
        // Project the bounds on the axes; leave a cell free on every side.
        let (low, high) = (DVec3::from(BOUNDS[0]), DVec3::from(BOUNDS[1]));
        let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
        let mut corner = middle;
        let mut tiles = [0; 3];
        for (d, count) in tiles.iter_mut().enumerate() {
            let reach = axes.col(d).abs().dot(half) + 2.0 * step;
            corner -= axes.col(d) * reach;
            *count = (2.0 * reach / (step * TILE as f64)).ceil() as usize;
        }
        Grid { step, axes, origin: corner, tiles }
    }

    /// A place in the grid, in steps, as a point of the model.
    pub fn model_from_grid(&self, p: DVec3) -> DVec3 {
        self.origin + self.axes * (p * self.step)
    }

    /// A direction of the grid in the model.
    pub fn model_from_direction(&self, d: DVec3) -> DVec3 {
        self.axes * d
    }
}

/// One tile that the surface passes.
pub struct Tile {
    /// Place in the slab.
    pub at: [usize; 2],
    /// The field at its samples, x fastest.
    pub samples: Box<[f32]>,
}

/// What a slab's index says about a tile that has no samples.
pub const OUTSIDE: u32 = u32::MAX;
/// As [`OUTSIDE`], for solid stone.
pub const INSIDE: u32 = u32::MAX - 1;

/// One layer of tiles.
pub struct Slab {
    /// For each place: which tile, or [`OUTSIDE`], or [`INSIDE`].
    pub index: Vec<u32>,
    /// The tiles that the surface passes, in a fixed order.
    pub tiles: Vec<Tile>,
}

impl Slab {
    /// Adds tiles of one sign where a neighbour's samples have the other: cells between the two hold
    /// surface. There are none as long as bounds of the field hold; those of reliefs are what is met
    /// in practice, and hundreds of millions of samples meet more.
    pub fn complete(&mut self, above: &Slab, [nx, ny]: [usize; 2]) {
        for y in 0..ny {
            for x in 0..nx {
                let state = self.index[y * nx + x];
                if state != OUTSIDE && state != INSIDE {
                    continue;
                }
                let differs = (1..8usize).any(|part| {
                    let d = [part & 1, part >> 1 & 1, part >> 2];
                    if x + d[0] >= nx || y + d[1] >= ny {
                        return state == INSIDE;
                    }
                    let slab = if d[2] == 1 { above } else { &*self };
                    let neighbour = slab.index[(y + d[1]) * nx + x + d[0]];
                    match slab.tiles.get(neighbour as usize) {
                        Some(tile) => tile.differs(d, state == INSIDE),
                        None => neighbour != state,
                    }
                });
                if differs {
                    let value = if state == INSIDE { -1.0 } else { 1.0 };
                    self.index[y * nx + x] = self.tiles.len() as u32;
                    let samples = vec![value; CELLS].into_boxed_slice();
                    self.tiles.push(Tile { at: [x, y], samples });
                }
            }
        }
    }
}

impl Tile {
    /// Whether a sample next to the neighbour `d` tiles further down has another sign than inside.
    fn differs(&self, d: [usize; 3], inside: bool) -> bool {
        let [xs, ys, zs] = d.map(|d| if d == 1 { 0..1 } else { 0..TILE });
        zs.into_iter().any(|z| {
            ys.clone().any(|y| {
                let row = &self.samples[(z * TILE + y) * TILE..][..TILE];
                row[xs.clone()].iter().any(|value| (*value < 0.0) != inside)
            })
        })
    }
}

/// A square of tiles in a slab as the search leaves it.
enum Found {
    /// All of one sign.
    Uniform([usize; 2], usize, u32),
    /// One tile that may hold surface, and what matters in it.
    Tile([usize; 2], Tape, f32),
}

/// The search for the tiles of a slab that hold surface.
pub struct Search<'a> {
    /// The statue.
    pub field: &'a Field,
    /// The grid.
    pub grid: &'a Grid,
}

impl Search<'_> {
    /// Sample the slab `k`.
    pub fn sample(&self, k: usize) -> Slab {
        self.sample_some(k, |_| true)
    }

    /// Sample those tiles of slab `k` that `wanted` picks by their place.
    pub fn sample_some(&self, k: usize, wanted: impl Fn([usize; 2]) -> bool) -> Slab {
        let [nx, ny, nz] = self.grid.tiles;
        let mut index = vec![OUTSIDE; nx * ny];
        if k >= nz {
            return Slab { index, tiles: Vec::new() };
        }
        let found = self.seek(&self.field.whole(), [0, 0], nx.max(ny).next_power_of_two(), k);
        let mut places = Vec::new();
        for f in found {
            match f {
                Found::Uniform([x, y], size, state) => {
                    for y in y..(y + size).min(ny) {
                        index[y * nx + x..y * nx + (x + size).min(nx)].fill(state);
                    }
                }
                Found::Tile(at, tape, slope) if wanted(at) => {
                    index[at[1] * nx + at[0]] = places.len() as u32;
                    places.push((at, tape, slope));
                }
                Found::Tile(..) => {}
            }
        }
        let tiles = places
            .into_par_iter()
            .map(|(at, tape, slope)| Tile {
                at,
                samples: self.sample_tile([at[0], at[1], k], &tape, slope),
            })
            .collect();
        Slab { index, tiles }
    }

    /// Halve squares of tiles until they hold one sign only or are single.
    fn seek(&self, tape: &[u16], at: [usize; 2], size: usize, k: usize) -> Vec<Found> {
        if at[0] >= self.grid.tiles[0] || at[1] >= self.grid.tiles[1] {
            return Vec::new();
        }
        // The ball round all cells that start in the square.
        let cells = (TILE * size) as f64;
        let middle = DVec3::new(
            (at[0] * TILE) as f64 + cells / 2.0,
            (at[1] * TILE) as f64 + cells / 2.0,
            (k * TILE) as f64 + TILE as f64 / 2.0,
        );
        let radius = (cells * cells * 0.5 + 64.0).sqrt() * self.grid.step * 1.001;
        let center = self.grid.model_from_grid(middle).as_vec3().to_array();
        let mut shorter = Tape::new();
        let (bounds, slope) = self.field.shorten(tape, center, radius as f32, &mut shorter);
        if bounds.low > 0.0 {
            return vec![Found::Uniform(at, size, OUTSIDE)];
        }
        if bounds.high < 0.0 {
            return vec![Found::Uniform(at, size, INSIDE)];
        }
        if size == 1 {
            return vec![Found::Tile(at, shorter, slope)];
        }
        let half = size / 2;
        let quarter = |dx: usize, dy: usize| {
            self.seek(&shorter, [at[0] + dx * half, at[1] + dy * half], half, k)
        };
        let row = |dy: usize| {
            let (mut a, b) = rayon::join(|| quarter(0, dy), || quarter(1, dy));
            a.extend(b);
            a
        };
        let (mut a, b) = rayon::join(|| row(0), || row(1));
        a.extend(b);
        a
    }

    /// Sample one tile: cubes of 4, then of 2 samples a side are skipped where the field is
    /// too large to reach zero in any of their edges.
    fn sample_tile(&self, tile: [usize; 3], tape: &[u16], slope: f32) -> Box<[f32]> {
        let grid = self.grid;
        let corner = tile.map(|t| (t * TILE) as f64);
        let origin = grid.model_from_grid(DVec3::from(corner));
        let step = grid.step;
        // Offsets of the eight members of a cube whose members lie `apart` steps apart.
        let members = |apart: f64| -> [DVec3; WIDTH] {
            std::array::from_fn(|l| {
                let at = DVec3::new((l & 1) as f64, (l >> 1 & 1) as f64, (l >> 2) as f64);
                grid.model_from_direction(at * (apart * step))
            })
        };
        let evaluate = |tape: &[u16], at: DVec3, members: &[DVec3; WIDTH]| -> Lanes {
            let start = origin + grid.model_from_direction(at * step);
            let p: [DVec3; WIDTH] = std::array::from_fn(|l| start + members[l]);
            let pick = |f: fn(&DVec3) -> f64| Lanes(std::array::from_fn(|l| f(&p[l]) as f32));
            self.field.value(tape, Points { x: pick(|p| p.x), y: pick(|p| p.y), z: pick(|p| p.z) })
        };
        let (eight, four, one) = (members(4.0), members(2.0), members(1.0));
        // Farthest sample that shares a grid edge with a cube of `size`, in steps.
        let reach = |size: f64| {
            let half = (size - 1.0) / 2.0;
            ((half + 1.0) * (half + 1.0) + 2.0 * half * half).sqrt()
        };
        // A tape for one cube, where shortening costs less than it saves.
        let shorten = |tape: &[u16], start: DVec3, size: f64, out: &mut Tape| -> f32 {
            let middle = origin + grid.model_from_direction((start + (size - 1.0) / 2.0) * step);
            let radius = (reach(size) * step * 1.001) as f32;
            let center = middle.as_vec3().to_array();
            self.field.shorten(tape, center, radius, out).1
        };
        let bound = |slope: f32, size: f64| (reach(size) * f64::from(slope) * 1.05 * step) as f32;
        let mut samples = vec![0.0f32; CELLS].into_boxed_slice();
        let at = |x: usize, y: usize, z: usize| (z * TILE + y) * TILE + x;
        let part = |l: usize, size: usize| [(l & 1) * size, (l >> 1 & 1) * size, (l >> 2) * size];
        let place = |b: [usize; 3]| DVec3::new(b[0] as f64, b[1] as f64, b[2] as f64);
        let (mut tape8, mut tape4) = (Tape::new(), Tape::new());
        for cube8 in 0..8 {
            let b8 = part(cube8, 8);
            let (mut slope8, mut for8) = (slope, tape);
            if tape.len() > 6 {
                slope8 = shorten(tape, place(b8), 8.0, &mut tape8);
                for8 = &tape8;
            }
            let middles = evaluate(for8, place(b8) + 1.5, &eight);
            for (cube4, middle) in middles.0.into_iter().enumerate() {
                let b4 = part(cube4, 4).plus(b8);
                if middle.abs() > bound(slope8, 4.0) {
                    for z in b4[2]..b4[2] + 4 {
                        for y in b4[1]..b4[1] + 4 {
                            samples[at(b4[0], y, z)..at(b4[0], y, z) + 4].fill(middle);
                        }
                    }
                    continue;
                }
                let (mut slope4, mut for4) = (slope8, for8);
                if for8.len() > 16 {
                    slope4 = shorten(for8, place(b4), 4.0, &mut tape4);
                    for4 = &tape4;
                }
                let middles = evaluate(for4, place(b4) + 0.5, &four);
                for (cube2, middle) in middles.0.into_iter().enumerate() {
                    let b2 = part(cube2, 2).plus(b4);
                    let values = if middle.abs() > bound(slope4, 2.0) {
                        Lanes::splat(middle)
                    } else {
                        evaluate(for4, place(b2), &one)
                    };
                    for (l, value) in values.0.into_iter().enumerate() {
                        let [x, y, z] = part(l, 1).plus(b2);
                        samples[at(x, y, z)] = value;
                    }
                }
            }
        }
        samples
    }
}

/// Adds places.
trait Plus {
    fn plus(self, other: Self) -> Self;
}

impl Plus for [usize; 3] {
    fn plus(self, other: Self) -> Self {
        [self[0] + other[0], self[1] + other[1], self[2] + other[2]]
    }
}
