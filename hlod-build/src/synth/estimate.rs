//! Which grid step gives a wished number of triangles.

use super::body;
use super::dual::OTHERS;
use super::grid::{Grid, Search, TILE};

/// Nominal surface of the statue, mm², for the first guess and for the scanner's noise.
const NOMINAL_AREA: f64 = 780_000.0;
/// How many tiles the two rounds of counting look at: at least, at most, and the share of
/// all in between. The error is about 1/√ of it.
const SAMPLE_TILES: [(f64, f64, f64); 2] = [(300.0, 600.0, 0.02), (1_500.0, 9_000.0, 0.16)];
/// How many slabs a count looks at, at least.
const SAMPLE_SLABS: usize = 40;

/// The step for a number of triangles if the statue were bare: a surface that lies at all
/// angles to the grid crosses 1.5 edges per square of it, each of which makes two triangles.
pub fn nominal_step(triangles: u64) -> f64 {
    (3.0 * NOMINAL_AREA / triangles as f64).sqrt()
}

/// The step that gives `triangles` to about one per cent.
pub fn step_for(triangles: u64, seed: u64) -> f64 {
    let wish = triangles as f64;
    let mut step = nominal_step(triangles);
    // The count depends on the step a little beyond its square: finer steps show finer
    // marks. Two rounds settle that.
    for sample in SAMPLE_TILES {
        let count = count(step, seed, sample);
        step *= (count / wish).sqrt();
    }
    step
}

/// Triangles at a step, from every so many slabs and every so many of their tiles.
fn count(step: f64, seed: u64, (least, most, share): (f64, f64, f64)) -> f64 {
    let grid = Grid::new(step);
    let field = body::statue(seed, step);
    let search = Search { field: &field, grid: &grid };
    // Tiles that hold surface: roughly 1.6 for each tile's face of it.
    let edge = step * TILE as f64;
    let tiles = 1.6 * NOMINAL_AREA / (edge * edge);
    let thin = (tiles / (tiles * share).clamp(least, most)).max(1.0);
    let slab_step = (thin as usize).min(grid.tiles[2] / SAMPLE_SLABS).max(1);
    let tile_step = (thin / slab_step as f64).round().max(1.0) as usize;
    let mut edges = 0u64;
    for k in (slab_step / 2..grid.tiles[2]).step_by(slab_step) {
        let slab = search.sample_some(k, |[x, y]| (x + 3 * y + k) % tile_step == 0);
        edges += slab.tiles.iter().map(|t| crossing_edges(&t.samples)).sum::<u64>();
    }
    // Of the edges along an axis that start in a tile, one in sixteen leaves it.
    let share = (TILE - 1) as f64 / TILE as f64;
    2.0 * edges as f64 / share * (slab_step * tile_step) as f64
}

/// Edges within a tile that cross the surface.
fn crossing_edges(samples: &[f32]) -> u64 {
    let stride = [1, TILE, TILE * TILE];
    let mut edges = 0;
    for axis in 0..3 {
        let [a, b] = OTHERS[axis];
        for i in 0..TILE - 1 {
            for j in 0..TILE {
                for k in 0..TILE {
                    let at = i * stride[axis] + j * stride[a] + k * stride[b];
                    let crosses = (samples[at] < 0.0) != (samples[at + stride[axis]] < 0.0);
                    edges += u64::from(crosses);
                }
            }
        }
    }
    edges
}
