// Visible surface, small triangles and points: one thread each, which loops over the few pixels that the
// triangle may cover and leaves depth and identity in one 64-bit word a pixel; the largest wins.
// Set-up in fixed function costs the same for a triangle of one pixel as for one of a thousand
// (Laine & Karras, High-performance software rasterization on GPUs, HPG 2011; Karis, Nanite,
// SIGGRAPH 2021).
//
// Corners are snapped to 1/256 pixel and edges tested in integers, exactly, edges included: no
// pixel's centre between two triangles that share an edge is missed by both. For points see points.wgsl.

struct Chunk {
    // Triangles of the arena.
    first: u32,
    count: u32,
    // To which draw triangles go that are left to fixed function.
    draw: u32,
    // See shadow.wgsl.
    error: f32,
    // Which radii points have.
    level: u32,
}

@group(1) @binding(0) var<storage, read_write> pixels: array<atomic<u64>>;
// size.w of the frame says where this arena's begin; the last one is followed by an empty one.
@group(1) @binding(1) var<storage, read> chunks: array<Chunk>;
// What is left, of this arena.
@group(1) @binding(2) var<storage, read_write> large: array<u32>;
// Four numbers a draw, the first of which counts corners.
@group(1) @binding(3) var<storage, read_write> draws: array<atomic<u32>>;

// In a chunk's count and in the list: whether backs are not drawn.
const CULLED: u32 = 0x80000000u;
// In a chunk's count: whether these are points.
const POINTS: u32 = 0x40000000u;
const COUNT: u32 = 0x3fffffffu;
// Where the list says which radii a point has.
const LEVEL_SHIFT: u32 = 29u;
// Points of more pixels from the middle are fixed function's.
const POINT_EXTENT_MAX: f32 = 24.0;
const SUBPIXELS: f32 = 256.0;
// Larger triangles, in sub-pixels, are fixed function's: its edges would overflow here, too.
const EXTENT_MAX: f32 = 8192.0;
// The same at the picture's sides, and where what is larger goes to `spread`, which is slow. Twice its square is still an
// i32.
const EXTENT_MAX_LEAVING: f32 = 24000.0;

// First and last pixel of the part of the picture that is drawn.
fn window_low() -> vec2<i32> {
    return vec2<i32>(frame.window.xy);
}

fn window_high() -> vec2<i32> {
    return vec2<i32>(frame.window.xy + frame.window.zw) - 1;
}

// Where the word of one of the picture's pixels is.
fn word_at(pixel: vec2<i32>) -> u32 {
    return number_of(vec2<u32>(pixel - window_low()));
}

fn cross2i(a: vec2<i32>, b: vec2<i32>) -> i32 {
    return a.x * b.y - a.y * b.x;
}

@compute @workgroup_size(64)
fn small(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) i: u32,
) {
    let chunk = chunks[min(frame.size.w + group.x + group.y * groups.x, arrayLength(&chunks) - 1u)];
    if i >= (chunk.count & COUNT) {
        return;
    }
    if (chunk.count & POINTS) != 0u {
        small_point(chunk, chunk.first + i);
    } else {
        small_triangle(chunk, chunk.first + i);
    }
}

fn small_point(chunk: Chunk, number: u32) {
    let p = point_of(number, chunk.level);
    if p.clip.y <= 0.0 || p.clip.x > p.clip.y {
        return;
    }
    let middle = pixel_of_point(p);
    let size = vec2<f32>(frame.size.xy);
    if any(middle < vec2(-p.extent)) || any(middle > size + p.extent) {
        return;
    }
    if p.extent > POINT_EXTENT_MAX {
        let slot = atomicAdd(&draws[4u * chunk.draw], 3u) / 3u;
        large[slot] = number | (chunk.level << LEVEL_SHIFT);
        return;
    }
    let first = max(vec2<i32>(ceil(middle - p.extent - 0.5)), window_low());
    let last = min(vec2<i32>(floor(middle + p.extent - 0.5)), window_high());
    for (var row = first.y; row <= last.y; row++) {
        for (var column = first.x; column <= last.x; column++) {
            let splat = splat_at(p, vec2(f32(column), f32(row)) + 0.5);
            if splat.covered {
                if CLIPPED && is_removed(clip_place(vec2(f32(column), f32(row)) + 0.5, splat.depth)) {
                    continue;
                }
                let identity = frame.size.z + number + 1u;
                let depth = bitcast<u32>(clamp(splat.depth, 0.0, 1.0));
                let word = (u64(depth) << 32u) | u64(identity);
                atomicMax(&pixels[word_at(vec2(column, row))], word);
            }
        }
    }
}

fn small_triangle(chunk: Chunk, triangle: u32) {
    let culled = (chunk.count & CULLED) != 0u;
    let a = frame.clip_from_model * vec4(position_of(indices[3u * triangle]), 1.0);
    let b = frame.clip_from_model * vec4(position_of(indices[3u * triangle + 1u]), 1.0);
    let c = frame.clip_from_model * vec4(position_of(indices[3u * triangle + 2u]), 1.0);
    // Beyond one side of the picture with all corners, whatever their depths.
    let x = vec3(a.x, b.x, c.x);
    let y = vec3(a.y, b.y, c.y);
    let w = vec3(a.w, b.w, c.w);
    let z = vec3(a.z, b.z, c.z);
    if all(x > w) || all(x < -w) || all(y > w) || all(y < -w) || all(z > w) {
        return;
    }
    // What has to be clipped is fixed function's.
    var to_fixed = any(z > w) || any(z < vec3(0.0)) || any(w <= vec3(0.0));
    let scale = vec2(0.5, -0.5) * vec2<f32>(frame.size.xy) * SUBPIXELS;
    let middle = vec2<f32>(frame.size.xy) * 0.5 * SUBPIXELS;
    let fa = a.xy / a.w * scale + middle;
    let fb = b.xy / b.w * scale + middle;
    let fc = c.xy / c.w * scale + middle;
    let low = min(min(fa, fb), fc);
    let high = max(max(fa, fb), fc);
    // At the picture's sides fixed function may clip, and round where an edge leaves the picture: the edge of the triangle
    // beside, which was not, is then a little elsewhere.
    let leaves = any(low < vec2(0.0)) || any(high > vec2<f32>(frame.size.xy) * SUBPIXELS);
    let extent_max = select(EXTENT_MAX, EXTENT_MAX_LEAVING, (frame.bias.y > 0.5) | leaves);
    // Beside the part of the picture that is drawn; the ends of what is clipped are elsewhere.
    let beside = any(high < vec2<f32>(window_low()) * SUBPIXELS)
        || any(low > vec2<f32>(window_high() + 1) * SUBPIXELS);
    if beside && !to_fixed {
        return;
    }
    to_fixed = to_fixed || !all(high - low < vec2(extent_max - 2.0));
    if to_fixed {
        let slot = atomicAdd(&draws[4u * chunk.draw], 3u) / 3u;
        large[slot] = triangle | (chunk.count & CULLED);
        return;
    }
    let pa = vec2<i32>(round(fa));
    var pb = vec2<i32>(round(fb));
    var pc = vec2<i32>(round(fc));
    var area = cross2i(pb - pa, pc - pa);
    // Rows run downwards: fronts turn the other way than in clip space.
    let back = area > 0;
    if area == 0 || (back && culled) {
        return;
    }
    var depth_b = z.y / w.y;
    var depth_c = z.z / w.z;
    let depth_a = z.x / w.x;
    if !back {
        let p = pb;
        pb = pc;
        pc = p;
        let depth = depth_b;
        depth_b = depth_c;
        depth_c = depth;
        area = -area;
    }
    // Pixels whose centres lie within the bounds.
    let first = max((min(min(pa, pb), pc) + vec2(127)) >> vec2(8u), window_low());
    let last = min((max(max(pa, pb), pc) - vec2(128)) >> vec2(8u), window_high());
    let identity = select(0u, BACK, back) | (frame.size.z + triangle + 1u);
    let slope = vec2(depth_b - depth_a, depth_c - depth_a) / f32(area);
    for (var row = first.y; row <= last.y; row++) {
        for (var column = first.x; column <= last.x; column++) {
            let p = vec2(column, row) * 256 + 128;
            let to_a = cross2i(pc - pb, p - pb);
            let to_b = cross2i(pa - pc, p - pc);
            let to_c = area - to_a - to_b;
            if to_a >= 0 && to_b >= 0 && to_c >= 0 {
                let depth = depth_a + dot(vec2(f32(to_b), f32(to_c)), slope);
                if CLIPPED
                    && is_removed(clip_place(vec2(f32(column), f32(row)) + 0.5, depth)) {
                    continue;
                }
                let word = (u64(bitcast<u32>(max(depth, 0.0))) << 32u) | u64(identity);
                atomicMax(&pixels[word_at(vec2(column, row))], word);
            }
        }
    }
}
