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
    // 1 + the pixel of the first sample of each; then the largest depth of the samples of each, as ordered(), 0 for
    // none; then that of each block of cells.
    cell: array<u32>,
}

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

// The largest depth of the samples in a cell; less than any where there are none.
fn deepest_of(cell: vec2<i32>) -> f32 {
    let code = grid.cell[grid.size.x * (grid.size.y + cell.y) + cell.x];
    return select(unordered(code), -3e38, code == 0u);
}

// And in a block.
fn deepest_of_block(block: vec2<i32>) -> f32 {
    let code = grid.cell[2 * grid.size.x * grid.size.y + block.y * grid.blocks + block.x];
    return select(unordered(code), -3e38, code == 0u);
}
