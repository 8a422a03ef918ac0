// The viewer's panel: textured triangles whose colours are sRGB values with premultiplied alpha.
// No uniforms: branches on them make some software drivers compile the shader anew every frame.

@group(0) @binding(0) var atlas: texture_2d<f32>;
@group(0) @binding(1) var atlas_sampler: sampler;

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) colour: vec4<f32>,
}

@vertex
fn panel_vertex(
    @location(0) clip: vec2<f32>,
    @location(1) uv: vec2<f32>,
    @location(2) colour: vec4<f32>,
) -> Corner {
    return Corner(vec4(clip, 0.0, 1.0), uv, colour);
}

// For targets that take encoded values as they are.
@fragment
fn panel_fragment(in: Corner) -> @location(0) vec4<f32> {
    return in.colour * textureSample(atlas, atlas_sampler, in.uv);
}

// For targets that encode what they are given.
@fragment
fn panel_fragment_linear(in: Corner) -> @location(0) vec4<f32> {
    let colour = in.colour * textureSample(atlas, atlas_sampler, in.uv);
    let high = pow((colour.rgb + 0.055) / 1.055, vec3(2.4));
    return vec4(select(high, colour.rgb / 12.92, colour.rgb <= vec3(0.04045)), colour.a);
}
