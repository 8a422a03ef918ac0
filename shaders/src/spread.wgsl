// What `small` left, in compute as well: a workgroup for some rows of each triangle or point. Slower than
// fixed function, but a function of nothing but the picture's own coordinates, so that parts of a
// picture that are drawn one by one agree with the whole bit for bit.
//
// Triangles are clipped at the near plane, and in parallel views at the far one, then snapped and
// tested like small ones, with edges of 64 bits.

// Of a triangle that two planes cut, and its corners.
struct Clipped {
    corner: array<vec4<f32>, 5>,
    count: u32,
}

// How far a corner is inside of a plane: the near one, the far one.
fn inside_of(p: vec4<f32>, plane: u32) -> f32 {
    return select(p.z, p.w - p.z, plane == 0u);
}

// Where an edge meets a plane; always from the corner that is inside, so that neighbours that share the
// edge find the same.
fn met(inside: vec4<f32>, outside: vec4<f32>, plane: u32) -> vec4<f32> {
    let a = inside_of(inside, plane);
    let b = inside_of(outside, plane);
    return inside + (outside - inside) * (a / (a - b));
}

fn clipped(a: vec4<f32>, b: vec4<f32>, c: vec4<f32>) -> Clipped {
    var now = Clipped(array<vec4<f32>, 5>(a, b, c, c, c), 3u);
    for (var plane = 0u; plane < 2u; plane++) {
        var next = Clipped(now.corner, 0u);
        for (var i = 0u; i < now.count; i++) {
            let p = now.corner[i];
            let q = now.corner[(i + 1u) % now.count];
            let p_in = inside_of(p, plane) >= 0.0;
            let q_in = inside_of(q, plane) >= 0.0;
            if p_in && next.count < 5u {
                next.corner[next.count] = p;
                next.count++;
            }
            if p_in != q_in && next.count < 5u {
                if p_in {
                    next.corner[next.count] = met(p, q, plane);
                } else {
                    next.corner[next.count] = met(q, p, plane);
                }
                next.count++;
            }
        }
        now = next;
    }
    return now;
}

// Sub-pixels; nothing farther than the largest picture is told apart.
fn snapped(p: vec4<f32>) -> vec2<i32> {
    let scale = vec2(0.5, -0.5) * vec2<f32>(frame.size.xy) * SUBPIXELS;
    let middle = vec2<f32>(frame.size.xy) * 0.5 * SUBPIXELS;
    return vec2<i32>(round(clamp(p.xy / p.w * scale + middle, vec2(-1e9), vec2(1e9))));
}

fn cross2l(a: vec2<i32>, b: vec2<i32>) -> i64 {
    return i64(a.x) * i64(b.y) - i64(a.y) * i64(b.x);
}

fn spread_triangle(
    p: vec4<f32>,
    q: vec4<f32>,
    r: vec4<f32>,
    entry: u32,
    stripe: u32,
    stripes: u32,
    i: u32,
) {
    let pa = snapped(p);
    var pb = snapped(q);
    var pc = snapped(r);
    var area = cross2l(pb - pa, pc - pa);
    let back = area > 0;
    if area == 0 || (back && (entry & CULLED) != 0u) {
        return;
    }
    let depth_a = p.z / p.w;
    var depth_b = q.z / q.w;
    var depth_c = r.z / r.w;
    if !back {
        let corner = pb;
        pb = pc;
        pc = corner;
        let depth = depth_b;
        depth_b = depth_c;
        depth_c = depth;
        area = -area;
    }
    let first = max((min(min(pa, pb), pc) + vec2(127)) >> vec2(8u), window_low());
    let last = min((max(max(pa, pb), pc) - vec2(128)) >> vec2(8u), window_high());
    let identity = select(0u, BACK, back) | (frame.size.z + (entry & NUMBER) + 1u);
    let slope = vec2(depth_b - depth_a, depth_c - depth_a) / f32(area);
    for (var row = first.y + i32(stripe); row <= last.y; row += i32(stripes)) {
        for (var column = first.x + i32(i); column <= last.x; column += 64) {
            let at = vec2(column, row) * 256 + 128;
            let to_a = cross2l(pc - pb, at - pb);
            let to_b = cross2l(pa - pc, at - pc);
            let to_c = area - to_a - to_b;
            if to_a >= 0 && to_b >= 0 && to_c >= 0 {
                let depth = depth_a + dot(vec2(f32(to_b), f32(to_c)), slope);
                if CLIPPED
                    && is_removed(clip_place(vec2(f32(column), f32(row)) + 0.5, depth)) {
                    continue;
                }
                let word = (u64(bitcast<u32>(clamp(depth, 0.0, 1.0))) << 32u) | u64(identity);
                atomicMax(&pixels[word_at(vec2(column, row))], word);
            }
        }
    }
}

fn spread_point(entry: u32, stripe: u32, stripes: u32, i: u32) {
    let number = entry & NUMBER;
    let p = point_of(number, entry >> LEVEL_SHIFT);
    let middle = pixel_of_point(p);
    let first = max(vec2<i32>(ceil(middle - p.extent - 0.5)), window_low());
    let last = min(vec2<i32>(floor(middle + p.extent - 0.5)), window_high());
    for (var row = first.y + i32(stripe); row <= last.y; row += i32(stripes)) {
        for (var column = first.x + i32(i); column <= last.x; column += 64) {
            let splat = splat_at(p, vec2(f32(column), f32(row)) + 0.5);
            if splat.covered {
                if CLIPPED
                    && is_removed(clip_place(vec2(f32(column), f32(row)) + 0.5, splat.depth)) {
                    continue;
                }
                let depth = bitcast<u32>(clamp(splat.depth, 0.0, 1.0));
                let word = (u64(depth) << 32u) | u64(frame.size.z + number + 1u);
                atomicMax(&pixels[word_at(vec2(column, row))], word);
            }
        }
    }
}

const NUMBER: u32 = 0x1fffffffu;

@compute @workgroup_size(64)
fn spread(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) i: u32,
) {
    // All of an arena's chunks say the same.
    let chunk = chunks[min(frame.size.w, arrayLength(&chunks) - 1u)];
    let count = atomicLoad(&draws[4u * chunk.draw]) / 3u;
    for (var n = group.x; n < count; n += groups.x) {
        let entry = large[n];
        let number = entry & NUMBER;
        if is_point(number) {
            spread_point(entry, group.y, groups.y, i);
            continue;
        }
        let a = frame.clip_from_model * vec4(position_of(indices[3u * number]), 1.0);
        let b = frame.clip_from_model * vec4(position_of(indices[3u * number + 1u]), 1.0);
        let c = frame.clip_from_model * vec4(position_of(indices[3u * number + 2u]), 1.0);
        let polygon = clipped(a, b, c);
        for (var k = 2u; k < polygon.count; k++) {
            let q = polygon.corner[k - 1u];
            spread_triangle(polygon.corner[0], q, polygon.corner[k], entry, group.y, groups.y, i);
        }
    }
}
