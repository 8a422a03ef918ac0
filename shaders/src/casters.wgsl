// What hard and soft shadows have in common: triangles in chunks against samples in cells. See
// shadow.wgsl.

struct Cells {
    low: vec2<f32>,
    cells_per_unit: vec2<f32>,
    size: vec2<i32>,
    // In a row.
    blocks: i32,
    farthest: f32,
    // Of all samples, the largest of −x, −y, x, y and depth, as ordered(); 0 for none.
    largest: array<u32, 5>,
    // 1 + the pixel of the first sample of each; then, for blocks of cells, the largest depth of
    // their samples, as ordered().
    cell: array<u32>,
}

struct Chunk {
    first: u32,
    count: u32,
    draw: u32,
    large: u32,
    // How far the triangles may be from the scan's, world space.
    error: f32,
    level: u32,
}

@group(1) @binding(1) var<storage, read_write> samples: array<Sample>;
@group(1) @binding(2) var<storage, read_write> grid: Cells;
@group(1) @binding(4) var<storage, read> chunks: array<Chunk>;

// In a chunk's count: only what faces the light casts.
const CULLED: u32 = 0x80000000u;
// In a chunk's count: points.
const COUNT: u32 = 0x3fffffffu;
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

// One corner of what casts, model space: of a triangle, or of an equilateral one round a point's disc,
// whose corners are two radii from the middle.
fn corner_of(number: u32, corner: u32) -> vec3<f32> {
    if !is_point(number) {
        return position_of(indices[3u * number + corner]);
    }
    let v = vertices[indices[3u * number] & VERTEX];
    let normal = octahedral(v.normal);
    let radius = radius_of(number, 0u);
    // Right-handed with the normal, so that its front is where that points.
    let u = normalize(select(cross(normal, vec3(0.0, 0.0, 1.0)), cross(normal, vec3(1.0, 0.0, 0.0)), abs(normal.z) > 0.8));
    let w = cross(normal, u);
    let turn = f32(corner) * 2.0943951;
    return vec3(v.x, v.y, v.z) + 2.0 * radius * (cos(turn) * u + sin(turn) * w);
}

// Of its weights, summing to 1, the least sum of products at which a triangle is met: inside the circle
// in an equilateral one for points.
fn least_product(number: u32) -> f32 {
    return select(0.0, 0.25, is_point(number));
}
