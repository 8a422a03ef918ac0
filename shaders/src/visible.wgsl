// The point that is seen in a pixel, from the identity of its triangle (Burns & Hunt, The
// Visibility Buffer, JCGT 2013).

const NONE: u32 = 0xffffffffu;

// Occlusion of a point from which nothing of the light is seen.
const HIDDEN: u32 = 65535u;

// The number of a triangle in this arena; NONE where an identity is nothing or in another one.
fn triangle_of(identity: u32) -> u32 {
    let number = (identity & ~BACK) - 1u - frame.size.z;
    return select(number, NONE, identity == 0u || number >= arrayLength(&indices) / 3u);
}

struct Seen {
    // Of the triangle's corners.
    weights: vec3<f32>,
    world: vec3<f32>,
    model: vec3<f32>,
    // Across the triangle, model space, of any length.
    across: vec3<f32>,
    // clip.w of the point.
    depth: f32,
}

fn cross2(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// Barycentric coordinates, correct in perspective, of the point seen at `pixel`.
fn barycentric(p: vec4<f32>, q: vec4<f32>, r: vec4<f32>, pixel: vec2<f32>) -> vec3<f32> {
    let ndc = (pixel / vec2<f32>(frame.size.xy) * 2.0 - 1.0) * vec2(1.0, -1.0);
    // Relative to the pixel first: what remains is small, and so are its rounding errors.
    let a = p.xy - ndc * p.w;
    let b = q.xy - ndc * q.w;
    let c = r.xy - ndc * r.w;
    let areas = vec3(cross2(b, c), cross2(c, a), cross2(a, b));
    let sum = areas.x + areas.y + areas.z;
    if abs(sum) < 1e-30 {
        return vec3(1.0 / 3.0);
    }
    // Seen edge on, rounding can leave the triangle: stay on it.
    let inside = max(areas / sum, vec3(0.0));
    return inside / (inside.x + inside.y + inside.z);
}

// Of a triangle, or of a point, whose weights are those of its one vertex. Of points the side that is
// seen is the front.
fn seen_point(triangle: u32, pixel: vec2<f32>) -> Seen {
    if is_point(triangle) {
        let p = point_of(triangle, 0u);
        let splat = splat_at(p, pixel);
        let axes = view_axes();
        let model = p.centre + axes * splat.offset;
        let world = (frame.world_from_model * vec4(model, 1.0)).xyz;
        return Seen(vec3(1.0, 0.0, 0.0), world, model, axes * splat.normal, p.clip.y);
    }
    let a = position_of(indices[3u * triangle]);
    let b = position_of(indices[3u * triangle + 1u]);
    let c = position_of(indices[3u * triangle + 2u]);
    let p = frame.clip_from_model * vec4(a, 1.0);
    let q = frame.clip_from_model * vec4(b, 1.0);
    let r = frame.clip_from_model * vec4(c, 1.0);
    let w = barycentric(p, q, r, pixel);
    let model = w.x * a + w.y * b + w.z * c;
    let world = (frame.world_from_model * vec4(model, 1.0)).xyz;
    return Seen(w, world, model, cross(b - a, c - a), dot(w, vec3(p.w, q.w, r.w)));
}
