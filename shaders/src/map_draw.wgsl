// What casts, into a shadow map: see map.wgsl.

@group(1) @binding(0) var<storage, read> map: MapView;

struct Corner {
    @builtin(position) clip: vec4<f32>,
    // z and w of light space.
    @location(0) depth: vec2<f32>,
    // Weights of the first two corners.
    @location(1) weights: vec2<f32>,
    @location(2) @interpolate(flat, either) least: f32,
}

@vertex
fn map_draw_vertex(@builtin(vertex_index) number: u32) -> Corner {
    let corner = number % 3u;
    let p = frame.light_from_model * vec4(corner_of(number / 3u, corner), 1.0);
    let m = map.homography * p.xyw;
    let middle = (map.low + map.high) / 2.0;
    let half = max((map.high - map.low) / 2.0, vec2(1e-30));
    let weights = vec2(f32(corner == 0u), f32(corner == 1u));
    // Nothing is cut off by its depth: see the fragment.
    let clip = vec4((m.xy - middle * m.z) / half * vec2(1.0, -1.0), 0.5 * m.z, m.z);
    return Corner(clip, p.zw, weights, least_product(number / 3u));
}

@fragment
fn map_draw_fragment(in: Corner) -> @builtin(frag_depth) f32 {
    let weights = vec3(in.weights, 1.0 - in.weights.x - in.weights.y);
    // Outside of a point's disc; behind the light or too near to it.
    if dot(weights, weights.yzx) < in.least || in.depth.y < frame.shadow.y {
        discard;
    }
    return clamp(map_depth(in.depth.x, in.depth.y, map.reach), 1e-30, 1.0);
}
