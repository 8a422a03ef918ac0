// Visible surface: identity and depth. Draws are ranges of 3 × triangle, so that the vertex
// number alone says which triangle and which corner this is, whatever node it belongs to.

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat, either) triangle: u32,
}

@vertex
fn surface_vertex(@builtin(vertex_index) corner: u32) -> Fragment {
    let position = position_of(indices[corner]);
    return Fragment(in_window(frame.clip_from_model * vec4(position, 1.0)), corner / 3u);
}

@fragment
fn surface_fragment(in: Fragment, @builtin(front_facing) front: bool) -> @location(0) u32 {
    if CLIPPED && is_removed(clip_place(in_picture(in.clip.xy), in.clip.z)) {
        discard;
    }
    let identity = frame.size.z + in.triangle + 1u;
    return select(identity | BACK, identity, front);
}
