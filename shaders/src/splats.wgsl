// Visible surface, points in fixed function: as `surface`, with a triangle round each point.

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat, either) number: u32,
}

struct Drawn {
    @location(0) identity: u32,
    @builtin(frag_depth) depth: f32,
}

@vertex
fn splats_vertex(@builtin(vertex_index) corner: u32) -> Fragment {
    let number = corner / 3u;
    return Fragment(corner_round_point(point_of(number, 0u), corner % 3u), number);
}

@fragment
fn splats_fragment(in: Fragment) -> Drawn {
    let splat = splat_at(point_of(in.number, 0u), in_picture(in.clip.xy));
    let place = clip_place(in_picture(in.clip.xy), splat.depth);
    if !splat.covered || (CLIPPED && is_removed(place)) {
        discard;
    }
    return Drawn(frame.size.z + in.number + 1u, clamp(splat.depth, 0.0, 1.0));
}
