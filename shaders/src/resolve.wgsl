// What `small` left of each pixel, into identity and depth, where it is nearer than what is there.

// Identity, then depth.
@group(1) @binding(0) var<storage, read> words: array<vec2<u32>>;

struct Resolved {
    @location(0) identity: u32,
    @builtin(frag_depth) depth: f32,
}

@vertex
fn resolve_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    let p = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(p * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn resolve_fragment(@builtin(position) pixel: vec4<f32>) -> Resolved {
    let word = words[number_of(vec2<u32>(pixel.xy))];
    if word.x == 0u {
        discard;
    }
    return Resolved(word.x, bitcast<f32>(word.y));
}
