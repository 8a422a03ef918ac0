// Visible surface, triangles that `small` left: as `surface`, by a list.

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    // The list's entry.
    @location(0) @interpolate(flat, either) entry: u32,
}

@group(1) @binding(0) var<storage, read> list: array<u32>;

const CULLED: u32 = 0x80000000u;

@vertex
fn large_vertex(@builtin(vertex_index) corner: u32) -> Fragment {
    let entry = list[corner / 3u];
    let index = indices[3u * (entry & ~CULLED) + corner % 3u];
    return Fragment(frame.clip_from_model * vec4(position_of(index), 1.0), entry);
}

@fragment
fn large_fragment(in: Fragment, @builtin(front_facing) front: bool) -> @location(0) u32 {
    if !front && (in.entry & CULLED) != 0u {
        discard;
    }
    let identity = frame.size.z + (in.entry & ~CULLED) + 1u;
    return select(identity | BACK, identity, front);
}
