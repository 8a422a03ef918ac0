// What casts, in chunks of triangles.

struct Chunk {
    first: u32,
    count: u32,
    draw: u32,
    // How far the triangles may be from the scan's, world space.
    error: f32,
    level: u32,
}

@group(1) @binding(4) var<storage, read> chunks: array<Chunk>;

// In a chunk's count: only what faces the light casts.
const CULLED: u32 = 0x80000000u;
// In a chunk's count: points.
const COUNT: u32 = 0x3fffffffu;

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

const DISC_PRODUCT: f32 = 0.25;

// Of its weights, summing to 1, the least sum of products at which a triangle is met: inside the circle
// in an equilateral one for points.
fn least_product(number: u32) -> f32 {
    return select(0.0, DISC_PRODUCT, is_point(number));
}
