// Hard shadows, second half: what lies between the samples and the light. See shadow.wgsl.

// An 8 × 8 part of the cells that a large triangle may cover.
struct Tile {
    a: vec4<f32>,
    b: vec4<f32>,
    c: vec4<f32>,
    // First and last cell.
    cells: vec4<i32>,
    error: f32,
    noise: f32,
    least: f32,
}

struct Tiles {
    count: atomic<u32>,
    // Of all frames, those for which there was no room; they are done where they are found.
    beyond: atomic<u32>,
    tile: array<Tile>,
}

@group(1) @binding(3) var<storage, read_write> occlusion: array<atomic<u32>>;
@group(1) @binding(5) var<storage, read_write> tiles: Tiles;

const TILE: i32 = 8;

// Hides the samples in a rectangle of cells that lie behind the triangle.
fn hide(
    first: vec2<i32>,
    last: vec2<i32>,
    a: vec4<f32>,
    b: vec4<f32>,
    c: vec4<f32>,
    error: f32,
    noise: f32,
    least: f32,
) {
    var at = first;
    var run = run_in_row(at, last.x);
    // One loop over cells and what is in them: neighbouring threads have different ones to do.
    loop {
        if run.at == run.end {
            at.x = end_in_row(at.x);
            if at.x > last.x {
                at = vec2(first.x, at.y + 1);
                if at.y > last.y {
                    break;
                }
            }
            run = run_in_row(at, last.x);
            continue;
        }
        let number = run.at;
        run.at++;
        // Relative to the sample. Edges that two triangles share come out with opposite signs, so
        // that no sample between them is missed by both.
        let q = vec2(samples[number].x, samples[number].y);
        let pa = a.xy - q * a.w;
        let pb = b.xy - q * b.w;
        let pc = c.xy - q * c.w;
        let weights = vec3(cross2(pb, pc), cross2(pc, pa), cross2(pa, pb));
        if !(all(weights >= vec3(0.0)) || all(weights <= vec3(0.0))) {
            continue;
        }
        let w = dot(weights, vec3(a.w, b.w, c.w));
        let sum = weights.x + weights.y + weights.z;
        if least > 0.0 && dot(weights, weights.yzx) < least * sum * sum {
            continue;
        }
        let sample = samples[number];
        // On the light's side that the sample is on, too.
        if w * sum > 0.0 && dot(weights, vec3(a.z, b.z, c.z)) / w < sample.depth - sample.slack * error - noise {
            atomicStore(&occlusion[sample.place], HIDDEN);
        }
    }
}

@compute @workgroup_size(64)
fn occlude(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) i: u32,
) {
    let chunk = chunks[min(frame.size.w + group.x + group.y * groups.x, arrayLength(&chunks) - 1u)];
    if i >= (chunk.count & COUNT) {
        return;
    }
    let triangle = chunk.first + i;
    let a = frame.light_from_model * vec4(corner_of(triangle, 0u), 1.0);
    let b = frame.light_from_model * vec4(corner_of(triangle, 1u), 1.0);
    let c = frame.light_from_model * vec4(corner_of(triangle, 2u), 1.0);
    let least = least_product(triangle);
    let facing = dot(a.xyw, cross(b.xyw, c.xyw));
    if (chunk.count & CULLED) != 0u && facing <= 0.0 {
        return;
    }
    // Its bounds on the light's picture, and how near it comes.
    let near = frame.shadow.y;
    var low = min(min(a.xy / a.w, b.xy / b.w), c.xy / c.w);
    var high = max(max(a.xy / a.w, b.xy / b.w), c.xy / c.w);
    var nearest = min(min(a.z / a.w, b.z / b.w), c.z / c.w);
    let farthest = max(max(a.z / a.w, b.z / b.w), c.z / c.w);
    let across = abs(cross2(b.xy / b.w - a.xy / a.w, c.xy / c.w - a.xy / a.w));
    var noise = noise_of(low, high, across, farthest - nearest);
    if min(min(a.w, b.w), c.w) < near {
        // What is too near to the light or behind it is cut off.
        if max(max(a.w, b.w), c.w) < near {
            return;
        }
        noise = 0.0;
        low = vec2(1e30);
        high = vec2(-1e30);
        nearest = 1e30;
        var corners = array(a, b, c);
        for (var k = 0; k < 3; k++) {
            let p = corners[k];
            let q = corners[(k + 1) % 3];
            if p.w >= near {
                low = min(low, p.xy / p.w);
                high = max(high, p.xy / p.w);
                nearest = min(nearest, p.z / p.w);
            }
            if (p.w >= near) != (q.w >= near) {
                let cut = mix(p, q, (near - p.w) / (q.w - p.w));
                low = min(low, cut.xy / near);
                high = max(high, cut.xy / near);
                nearest = min(nearest, cut.z / near);
            }
        }
    }
    if nearest >= grid.farthest {
        return;
    }
    let range = cells_of(low, high);
    let start = range.xy;
    let to = range.zw;
    let extent = to - start + 1;
    if any(extent <= vec2(0)) {
        return;
    }
    // Nothing behind it where it may cover four cells at most: most of what is lit is left here.
    if all(extent <= vec2(2)) {
        let behind = max(
            max(deepest_of(start), deepest_of(vec2(to.x, start.y))),
            max(deepest_of(vec2(start.x, to.y)), deepest_of(to)),
        );
        if behind <= nearest {
            return;
        }
    }
    if extent.x * extent.y > CELLS_MAX || extent.x > CELLS_MAX || extent.y > CELLS_MAX {
        for (var y = start.y; y <= to.y; y += TILE) {
            for (var x = start.x; x <= to.x; x += TILE) {
                let slot = atomicAdd(&tiles.count, 1u);
                let end = min(vec2(x, y) + TILE - 1, to);
                if slot < arrayLength(&tiles.tile) {
                    tiles.tile[slot] = Tile(a, b, c, vec4(x, y, end), chunk.error, noise, least);
                } else {
                    atomicAdd(&tiles.beyond, 1u);
                    hide(vec2(x, y), end, a, b, c, chunk.error, noise, least);
                }
            }
        }
        return;
    }
    hide(start, to, a, b, c, chunk.error, noise, least);
}

@compute @workgroup_size(64)
fn occlude_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) i: u32,
) {
    let count = min(atomicLoad(&tiles.count), arrayLength(&tiles.tile));
    for (var t = group.x; t < count; t += groups.x) {
        let tile = tiles.tile[t];
        let x = tile.cells.x + i32(i) % TILE;
        let y = tile.cells.y + i32(i) / TILE;
        if x <= tile.cells.z && y <= tile.cells.w {
            hide(vec2(x, y), vec2(x, y), tile.a, tile.b, tile.c, tile.error, tile.noise, tile.least);
        }
    }
}
