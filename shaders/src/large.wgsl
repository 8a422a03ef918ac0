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
// Of points, which radii they have; numbers are smaller.
const LEVEL_SHIFT: u32 = 29u;
const NUMBER: u32 = 0x1fffffffu;

const SUBPIXELS: f32 = 256.0;

// A corner where `small` snaps it to. Fixed function snaps to as fine a grid, but rounds what it computed otherwise: where
// a triangle of its meets one of `small`, a pixel's centre between the two could be missed by both.
fn on_grid(p: vec4<f32>) -> vec4<f32> {
    let scale = vec2(0.5, -0.5) * vec2<f32>(frame.size.xy) * SUBPIXELS;
    let middle = vec2<f32>(frame.size.xy) * 0.5 * SUBPIXELS;
    let place = p.xy / p.w * scale + middle;
    let moved = vec4((round(place) - middle) / scale * p.w, p.zw);
    // Far outside or behind the eye nothing of `small` meets it.
    return select(p, moved, p.w > 0.0 && all(abs(place) < vec2(4194304.0)));
}

@vertex
fn large_vertex(@builtin(vertex_index) corner: u32) -> Fragment {
    let entry = list[corner / 3u];
    let number = entry & NUMBER;
    if is_point(number) {
        return Fragment(corner_round_point(point_of(number, entry >> LEVEL_SHIFT), corner % 3u), entry);
    }
    let index = indices[3u * number + corner % 3u];
    return Fragment(in_window(on_grid(frame.clip_from_model * vec4(position_of(index), 1.0))), entry);
}

@fragment
fn large_fragment(in: Fragment, @builtin(front_facing) front: bool) -> Drawn {
    let number = in.entry & NUMBER;
    let identity = frame.size.z + number + 1u;
    if is_point(number) {
        let splat = splat_at(point_of(number, in.entry >> LEVEL_SHIFT), in_picture(in.clip.xy));
        let place = clip_place(in_picture(in.clip.xy), splat.depth);
        if !splat.covered || (CLIPPED && is_removed(place)) {
            discard;
        }
        return Drawn(identity, clamp(splat.depth, 0.0, 1.0));
    }
    let place = clip_place(in_picture(in.clip.xy), in.clip.z);
    let removed = CLIPPED && is_removed(place);
    if removed || (!front && (in.entry & CULLED) != 0u) {
        discard;
    }
    return Drawn(select(identity | BACK, identity, front), in.clip.z);
}
