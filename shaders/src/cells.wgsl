// What hard and soft shadows without maps have in common: triangles against samples in cells. See shadow.wgsl.

struct Cells {
    low: vec2<f32>,
    cells_per_unit: vec2<f32>,
    size: vec2<i32>,
    // In a row.
    blocks: i32,
    farthest: f32,
    // Of all samples, the largest of −x, −y, x, y and depth, as ordered(); 0 for none.
    largest: array<u32, 5>,
    // How many cells there may be.
    room: i32,
    // Where the samples of each cell begin, by their numbers, and behind the last where they end; then the largest depth
    // of those of each cell, as ordered(), 0 for none; then of each quarter, of each block, how many samples come
    // before each quarter, and by which depths each is ordered: how much one step is, and where the samples of each begin.
    // Behind all that, samples' numbers, quarter by quarter, the deepest first.
    cell: array<u32>,
}

// Sorted by their cells.
@group(1) @binding(1) var<storage, read_write> samples: array<Sample>;
@group(1) @binding(2) var<storage, read_write> grid: Cells;

// What may cover more cells is divided into tiles.
const CELLS_MAX: i32 = 64;

// The cells round a rectangle on the light's picture; an empty range where there are none.
fn cells_of(low: vec2<f32>, high: vec2<f32>) -> vec4<i32> {
    // Rounding must not move it out of a cell that holds a sample on its edge.
    let edge = vec2<f32>(grid.size);
    let first = floor(clamp((low - grid.low) * grid.cells_per_unit - 0.01, vec2(-1.0), edge));
    let last = floor(clamp((high - grid.low) * grid.cells_per_unit + 0.01, vec2(-1.0), edge));
    if any(last < vec2(0.0)) || any(first >= edge) {
        return vec4(0, 0, -1, -1);
    }
    return vec4(max(vec2<i32>(first), vec2(0)), min(vec2<i32>(last), grid.size - 1));
}

// Of samples, the first, and the one behind the last.
struct Run {
    at: u32,
    end: u32,
}

// Behind the last cell of a row that is in the same quarter of a block.
fn end_in_row(x: i32) -> i32 {
    return (x | (QUARTER - 1)) + 1;
}

// Those of cells of a row, from one on up to `last` or where their quarter ends.
fn run_in_row(cell: vec2<i32>, last: i32) -> Run {
    let number = number_of_cell(cell, grid.blocks);
    return Run(grid.cell[number], grid.cell[number + min(last + 1, end_in_row(cell.x)) - cell.x]);
}

// Those of a quarter of a block that are deeper than so, and some that are not, in the order of depth: by `ordered_sample`.
// Quarters are counted as cells are.
fn run_deeper(quarter: vec2<i32>, least: f32) -> Run {
    let cell = number_of_cell(quarter * QUARTER, grid.blocks);
    let kept = first_of_orders() + (STEPS + 1) * (cell / CELLS_OF_QUARTER);
    let width = bitcast<f32>(grid.cell[kept]);
    // With a margin for rounding.
    let steps = (deepest_of_quarter(quarter) - least) / width * 1.0001 + 0.01;
    let step = i32(clamp(steps, 0.0, f32(STEPS))) + 1;
    let end = select(kept + 1 + min(step, STEPS - 1), cell + CELLS_OF_QUARTER, step >= STEPS);
    return Run(grid.cell[cell], grid.cell[end]);
}

fn ordered_sample(place: u32) -> Sample {
    let first = 1 + NUMBERS_OF_BLOCK * (grid.room / CELLS_OF_BLOCK);
    return samples[grid.cell[first + i32(place)]];
}

fn first_of_orders() -> i32 {
    return 1 + 2 * grid.room + 9 * (grid.room / CELLS_OF_BLOCK);
}

// Less than any depth where there is none.
fn depth_at(place: i32) -> f32 {
    let code = grid.cell[place];
    return select(unordered(code), -3e38, code == 0u);
}

// The largest depth of the samples in a cell; less than any where there are none.
fn deepest_of(cell: vec2<i32>) -> f32 {
    return depth_at(grid.room + 1 + number_of_cell(cell, grid.blocks));
}

// In a quarter.
fn deepest_of_quarter(quarter: vec2<i32>) -> f32 {
    return depth_at(2 * grid.room + 1 + number_of_cell(quarter * QUARTER, grid.blocks) / CELLS_OF_QUARTER);
}

// And in a block.
fn deepest_of_block(block: vec2<i32>) -> f32 {
    let first = 2 * grid.room + 1 + grid.room / CELLS_OF_QUARTER;
    return depth_at(first + block.y * grid.blocks + block.x);
}
