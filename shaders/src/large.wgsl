// Visible surface, triangles and points that `small` left, by a list.

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    // The list's entry.
    @location(0) @interpolate(flat, either) entry: u32,
}

struct Drawn {
    @location(0) identity: u32,
    @builtin(frag_depth) depth: f32,
}

@group(1) @binding(0) var<storage, read> list: array<u32>;

const CULLED: u32 = 0x80000000u;

@vertex
fn large_vertex(@builtin(vertex_index) corner: u32) -> Fragment {
    let entry = list[corner / 3u];
    let number = entry & ~CULLED;
    if is_point(number) {
        return Fragment(corner_round_point(point_of(number, 0u), corner % 3u), entry);
    }
    let index = indices[3u * number + corner % 3u];
    return Fragment(frame.clip_from_model * vec4(position_of(index), 1.0), entry);
}

@fragment
fn large_fragment(in: Fragment, @builtin(front_facing) front: bool) -> Drawn {
    let number = in.entry & ~CULLED;
    let identity = frame.size.z + number + 1u;
    if is_point(number) {
        let splat = splat_at(point_of(number, 0u), in.clip.xy);
        if !splat.covered {
            discard;
        }
        return Drawn(identity, clamp(splat.depth, 0.0, 1.0));
    }
    if !front && (in.entry & CULLED) != 0u {
        discard;
    }
    return Drawn(select(identity | BACK, identity, front), in.clip.z);
}
