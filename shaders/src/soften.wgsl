// Soft shadows: how much of a light that is a disc is hidden from each sample.
//
// Seen from a sample, what faces the light and lies before it covers a part of the disc. The part's
// area is a sum over its outline (Green): every edge, as far as it lies within the disc, adds the
// triangle that it makes with the disc's middle less the sector, and the middle itself, where it is
// covered, adds the whole disc. Edges between two triangles that both face the light cancel and are
// left out: what remains are silhouettes, for which this is what penumbra quads and wedges compute
// (Arvo & Westerholm, Penumbra quads, 2004; Assarsson & Akenine-Möller, A geometry-based soft
// shadow volume algorithm, SIGGRAPH 2003), and open borders. What lies behind one another in two
// layers is counted twice, up to all of the light; which edges are silhouettes is decided from the
// light's middle.
//
// (x / w, y / w, z / w) is projected from a sample as the world is: lines stay lines. A point (q, d)
// that is nearer than a sample (s, e) is seen at (q − s) / (size · (e − d)) on the disc of radius 1.
//
// The part of the disc that is below the horizon of the surface itself is hidden from the start
// (samples.wgsl): there rays enter the body at the sample, and leave it beyond its silhouette.
//
// What faces away from the light is summed apart, and the larger sum holds: of bodies both are the
// same, open surfaces have one of them in each place.
//
// The discs of point clouds overlap by design, and would count as often as they do. So they are not summed: each hides
// those of 64 places on the light that it lies before, a bit for each (after Schwarz & Stamminger, Bitmask soft shadows,
// EUROGRAPHICS 2007, who have them for the texels of a map), and a place is hidden once, by whatever number of them.
//
// soften: triangles and their edges · soften_tiles: what is left of large ones · settle: sums →
// occlusion.

// A part of the cells that a triangle or an edge may cover.
struct Tile {
    a: vec4<f32>,
    b: vec4<f32>,
    c: vec4<f32>,
    // First and last cell.
    cells: vec4<i32>,
    // A triangle, an edge from a to b, or a disc within a triangle.
    kind: u32,
    // Which way the triangle faces.
    facing: f32,
    error: f32,
    noise: f32,
}

struct Tiles {
    count: atomic<u32>,
    // Of all frames, those for which there was no room; they are done where they are found.
    beyond: atomic<u32>,
    tile: array<Tile>,
}

// Four a pixel: two sums, of what faces the light and of what does not, in 65535ths of the disc; and the places of the light
// that discs hide.
@group(1) @binding(3) var<storage, read_write> sums: array<atomic<i32>>;
@group(1) @binding(5) var<storage, read_write> tiles: Tiles;
// For each edge of a triangle, from a corner to the next, the vertex across it.
@group(2) @binding(0) var<storage, read> across: array<u32>;

const NO_VERTEX: u32 = 0xffffffffu;
const TRIANGLE: u32 = 0u;
const EDGE: u32 = 1u;
const DISC: u32 = 2u;
const PI: f32 = 3.14159265;

fn in_light_space(index: u32) -> vec4<f32> {
    let v = vertices[index & VERTEX];
    return frame.light_from_model * vec4(v.x, v.y, v.z, 1.0);
}

fn comes_before(a: vec4<f32>, b: vec4<f32>) -> bool {
    return a.x < b.x || (a.x == b.x && (a.y < b.y || (a.y == b.y && (a.z < b.z || (a.z == b.z && a.w < b.w)))));
}

// Positive where a triangle faces the light. Rounded the same whichever corner comes first: a triangle that is seen edge on
// and its neighbours have to agree whether there is an edge between them, or an outline has a gap.
fn facing_of(p: vec4<f32>, q: vec4<f32>, r: vec4<f32>) -> f32 {
    var a = p;
    var b = q;
    var c = r;
    var turned = 1.0;
    if comes_before(b, a) {
        let other = a;
        a = b;
        b = other;
        turned = -turned;
    }
    if comes_before(c, b) {
        let other = b;
        b = c;
        c = other;
        turned = -turned;
    }
    if comes_before(b, a) {
        let other = a;
        a = b;
        b = other;
        turned = -turned;
    }
    return turned * dot(a.xyw, cross(b.xyw - a.xyw, c.xyw - a.xyw));
}

// Where a tile's triangle, edge or disc lies on the light's picture.
struct Outline {
    low: vec2<f32>,
    high: vec2<f32>,
    nearest: f32,
    // Across an edge, of length 1; else 0.
    normal: vec2<f32>,
    start: vec2<f32>,
    // How far beyond it may hide a part of the light, for each unit of depth that it is nearer.
    spread: f32,
}

fn outline_of(tile: Tile) -> Outline {
    let is_edge = tile.kind == EDGE;
    let a = tile.a;
    let b = tile.b;
    let c = tile.c;
    let spread = select(frame.shadow.w, 0.0, tile.kind == TRIANGLE);
    // What is cut may be anywhere.
    if min(min(a.w, b.w), select(c.w, a.w, is_edge)) < frame.shadow.y {
        return Outline(vec2(-1e30), vec2(1e30), -3e38, vec2(0.0), vec2(0.0), spread);
    }
    let p = a.xyz / a.w;
    let q = b.xyz / b.w;
    let r = select(c.xyz / c.w, p, is_edge);
    let along = q.xy - p.xy;
    let length = length(along);
    let normal = select(vec2(0.0), vec2(along.y, -along.x) / length, is_edge && length > 0.0);
    let low = min(min(p, q), r);
    return Outline(low.xy, max(max(p.xy, q.xy), r.xy), low.z, normal, p.xy, spread);
}

// No sample in a rectangle of the light's picture is reached unless it is deeper than this. With a margin for rounding.
fn least_depth(outline: Outline, low: vec2<f32>, high: vec2<f32>) -> f32 {
    let beside = max(outline.low - high, low - outline.high);
    let half = (high - low) / 2.0;
    let from_edge = abs(dot(outline.normal, low + half - outline.start)) - dot(abs(outline.normal), half);
    let away = max(length(max(beside, vec2(0.0))), from_edge);
    return outline.nearest - 2e-7 * abs(outline.nearest) + away / max(1.001 * outline.spread, 1e-30);
}

// Adds to the samples of a rectangle of cells.
fn add(first: vec2<i32>, last: vec2<i32>, tile: Tile) {
    let nearest = outline_of(tile).nearest;
    // Nothing behind it where it may cover four cells at most: most of what is lit is left here.
    if all(last - first < vec2(2)) {
        let behind = max(
            max(deepest_of(first), deepest_of(vec2(last.x, first.y))),
            max(deepest_of(vec2(first.x, last.y)), deepest_of(last)),
        );
        if behind <= nearest {
            return;
        }
    }
    var at = first;
    var run = run_in_row(at, last.x);
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
        add_to(samples[run.at], tile);
        run.at++;
    }
}

fn add_to(seen: Sample, tile: Tile) {
    var sample = seen;
    sample.depth -= sample.slack * tile.error;
    if tile.kind == DISC {
        sample.depth -= tile.noise;
        let hidden = places_hidden(sample, tile);
        if hidden.x != 0u {
            atomicOr(&sums[4u * sample.place + 2u], bitcast<i32>(hidden.x));
        }
        if hidden.y != 0u {
            atomicOr(&sums[4u * sample.place + 3u], bitcast<i32>(hidden.y));
        }
        return;
    }
    var part = 0.0;
    if tile.kind == EDGE {
        part = tile.facing * part_of_edge(sample, tile.a, tile.b);
    } else if covers(sample, tile) {
        part = 1.0;
    }
    if part != 0.0 {
        let sum = 4u * sample.place + select(1u, 0u, tile.facing > 0.0);
        atomicAdd(&sums[sum], i32(round(part * f32(HIDDEN))));
    }
}

// Whether a triangle hides the disc's middle.
fn covers(sample: Sample, t: Tile) -> bool {
    let q = vec2(sample.x, sample.y);
    let pa = t.a.xy - q * t.a.w;
    let pb = t.b.xy - q * t.b.w;
    let pc = t.c.xy - q * t.c.w;
    let weights = vec3(cross2(pa, pb), cross2(pb, pc), cross2(pc, pa));
    if !(all(weights >= vec3(0.0)) || all(weights <= vec3(0.0))) {
        return false;
    }
    let w = dot(weights, vec3(t.c.w, t.a.w, t.b.w));
    let sum = weights.x + weights.y + weights.z;
    return w * sum > 0.0 && dot(weights, vec3(t.c.z, t.a.z, t.b.z)) / w < sample.depth - t.noise;
}

// From a sample: across the light's picture, and how far towards the light, so that xy / z is a place on the light's disc of
// radius 1.
fn seen_from(sample: Sample, p: vec4<f32>) -> vec3<f32> {
    let q = vec2(sample.x, sample.y);
    return vec3(p.xy - q * p.w, frame.shadow.w * (sample.depth * p.w - p.z));
}

// Which of 64 places on the light's disc, on a spiral (Vogel 1979), a point's disc hides from a sample: those to which a
// ray meets the triangle round it within the circle.
fn places_hidden(sample: Sample, t: Tile) -> vec2<u32> {
    let a = seen_from(sample, t.a);
    let b = seen_from(sample, t.b);
    let c = seen_from(sample, t.c);
    let farthest = max(max(a.z, b.z), c.z);
    if farthest <= 0.0 {
        return vec2(0u);
    }
    // Beside the light, all of it.
    if min(min(a.z, b.z), c.z) > 0.0 {
        let low = min(min(a.xy / a.z, b.xy / b.z), c.xy / c.z);
        let high = max(max(a.xy / a.z, b.xy / b.z), c.xy / c.z);
        if any(low > vec2(1.0)) || any(high < vec2(-1.0)) {
            return vec2(0u);
        }
    }
    // A ray to (v, 1) has weights of the corners that are linear in v.
    let of_a = cross(b, c);
    let of_b = cross(c, a);
    let of_c = cross(a, b);
    let depths = vec3(a.z, b.z, c.z);
    var hidden = vec2(0u);
    var direction = vec2(1.0, 0.0);
    for (var k = 0u; k < 64u; k++) {
        let v = vec3(direction * sqrt((f32(k) + 0.5) / 64.0), 1.0);
        // By the golden angle.
        direction = vec2(
            -0.73736888 * direction.x - 0.67549029 * direction.y,
            0.67549029 * direction.x - 0.73736888 * direction.y,
        );
        let weights = vec3(dot(of_a, v), dot(of_b, v), dot(of_c, v));
        let sum = weights.x + weights.y + weights.z;
        let is_met = (dot(weights, weights.yzx) >= DISC_PRODUCT * sum * sum) & (dot(weights, depths) * sum > 0.0);
        let bit = select(0u, 1u << (k & 31u), is_met);
        hidden |= select(vec2(0u, bit), vec2(bit, 0u), k < 32u);
    }
    return hidden;
}

// Triangle less sector, as a share of the disc.
fn part_of_edge(sample: Sample, a4: vec4<f32>, b4: vec4<f32>) -> f32 {
    let q = vec2(sample.x, sample.y);
    // The same product as `covers` has: its sign says on which side the middle is.
    let side = cross2(a4.xy - q * a4.w, b4.xy - q * b4.w);
    // The disc is a cone from the sample, x² + y² ≤ z² with z > 0, which is convex: one part of the
    // edge lies in it. Not divided by w, nor by z before that is known: near the light and beside
    // the sample they are 0.
    let p = vec3(a4.xy - q * a4.w, frame.shadow.w * (sample.depth * a4.w - a4.z));
    let d = vec3(b4.xy - q * b4.w, frame.shadow.w * (sample.depth * b4.w - b4.z)) - p;
    if max(p.z, p.z + d.z) <= 0.0 {
        return 0.0;
    }
    // Where x² + y² − z² = 0: a t² + 2 b t + c.
    let a = dot(d.xy, d.xy) - d.z * d.z;
    let b = dot(p.xy, d.xy) - p.z * d.z;
    let c = dot(p.xy, p.xy) - p.z * p.z;
    let discriminant = b * b - a * c;
    var t0 = 0.0;
    var t1 = 1.0;
    if discriminant < 0.0 {
        // It stays on one side of the cone.
        if c > 0.0 {
            return 0.0;
        }
    } else {
        let root = -(b + select(-1.0, 1.0, b >= 0.0) * sqrt(discriminant));
        let r0 = root / a;
        let r1 = c / root;
        let low = min(r0, r1);
        let high = max(r0, r1);
        if a > 0.0 {
            t0 = max(low, 0.0);
            t1 = min(high, 1.0);
        } else if d.z > 0.0 {
            // Steeper than the cone: it enters and stays.
            t0 = max(select(high, r1, a == 0.0), 0.0);
        } else {
            t1 = min(select(low, r1, a == 0.0), 1.0);
        }
    }
    // Also where the numbers above were none.
    if !(t0 < t1) {
        return 0.0;
    }
    let at0 = p + t0 * d;
    let at1 = p + t1 * d;
    if min(at0.z, at1.z) <= 0.0 {
        return 0.0;
    }
    let u = at0.xy / at0.z;
    let v = at1.xy / at1.z;
    let angle = atan2(abs(cross2(u, v)), dot(u, v));
    return (0.5 * cross2(u, v) - 0.5 * select(-angle, angle, side >= 0.0)) / PI;
}

fn add_or_divide(tile: Tile) {
    let extent = tile.cells.zw - tile.cells.xy + 1;
    if any(extent <= vec2(0)) {
        return;
    }
    // Few of a workgroup's edges are silhouettes, and have many cells: those are shared out, or its other threads would wait.
    if tile.kind != EDGE && extent.x <= CELLS_MAX && extent.y <= CELLS_MAX && extent.x * extent.y <= CELLS_MAX {
        add(tile.cells.xy, tile.cells.zw, tile);
        return;
    }
    // By whole blocks, as far as anything in them is reached.
    let outline = outline_of(tile);
    let size = 1.0 / grid.cells_per_unit;
    let first = tile.cells.xy / BLOCK;
    let last = tile.cells.zw / BLOCK;
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            let block = vec2(x, y);
            let low = grid.low + size * (vec2<f32>(block * BLOCK) - 0.02);
            if deepest_of_block(block) <= least_depth(outline, low, low + size * (f32(BLOCK) + 0.04)) {
                continue;
            }
            let slot = atomicAdd(&tiles.count, 1u);
            var part = tile;
            part.cells = vec4(
                max(block * BLOCK, tile.cells.xy),
                min(block * BLOCK + BLOCK - 1, tile.cells.zw),
            );
            if slot < arrayLength(&tiles.tile) {
                tiles.tile[slot] = part;
            } else {
                atomicAdd(&tiles.beyond, 1u);
                add(part.cells.xy, part.cells.zw, part);
            }
        }
    }
}

// The part of an edge that is not too near to the light, in projected coordinates with w = 1;
// w = 0 where there is none.
fn cut(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    let near = frame.shadow.y;
    if a.w >= near {
        return a;
    }
    if b.w < near {
        return vec4(0.0);
    }
    return mix(a, b, (near - a.w) / (b.w - a.w));
}

@compute @workgroup_size(64)
fn soften(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) i: u32,
) {
    let chunk = chunks[min(frame.size.w + group.x + group.y * groups.x, arrayLength(&chunks) - 1u)];
    if i >= (chunk.count & COUNT) {
        return;
    }
    let triangle = chunk.first + i;
    var corner: array<u32, 3>;
    var p: array<vec4<f32>, 3>;
    let is_disc = is_point(triangle);
    for (var k = 0u; k < 3u; k++) {
        corner[k] = indices[3u * triangle + k];
        // Skirts would count as layers of their own; the slits that they close hide next to nothing.
        if !is_disc && (corner[k] & MOVED) != 0u {
            return;
        }
        p[k] = frame.light_from_model * vec4(corner_of(triangle, k), 1.0);
    }
    let determinant = facing_of(p[0], p[1], p[2]);
    if determinant == 0.0 || ((chunk.count & CULLED) != 0u && determinant < 0.0) {
        return;
    }
    let facing = sign(determinant);
    var tile: Tile;
    tile.a = p[0];
    tile.b = p[1];
    tile.c = p[2];
    tile.facing = facing;
    tile.error = chunk.error;
    tile.kind = select(TRIANGLE, DISC, is_disc);

    var low = vec2(1e30);
    var high = vec2(-1e30);
    var nearest = 1e30;
    for (var k = 0; k < 3; k++) {
        let a = cut(p[k], p[(k + 1) % 3]);
        let b = cut(p[(k + 1) % 3], p[k]);
        if a.w > 0.0 {
            low = min(low, min(a.xy / a.w, b.xy / b.w));
            high = max(high, max(a.xy / a.w, b.xy / b.w));
            nearest = min(nearest, min(a.z / a.w, b.z / b.w));
        }
    }
    if nearest >= grid.farthest {
        return;
    }
    let at = array(p[0].xyz / p[0].w, p[1].xyz / p[1].w, p[2].xyz / p[2].w);
    if min(min(p[0].w, p[1].w), p[2].w) >= frame.shadow.y {
        let across = abs(cross2(at[1].xy - at[0].xy, at[2].xy - at[0].xy));
        tile.noise = noise_of(low, high, across, max(max(at[0].z, at[1].z), at[2].z) - nearest);
    }
    // A triangle hides the light's middle, a disc any part of it.
    let beside = select(0.0, frame.shadow.w * (grid.farthest - nearest), is_disc);
    tile.cells = cells_of(low - beside, high + beside);
    add_or_divide(tile);
    if is_disc {
        return;
    }

    for (var k = 0u; k < 3u; k++) {
        let next = (k + 1u) % 3u;
        let other = across[3u * triangle + k];
        if other != NO_VERTEX {
            // The neighbour has the edge the other way round.
            let c = in_light_space(other);
            if facing_of(p[next], p[k], c) * facing > 0.0 {
                continue;
            }
        }
        let a = cut(p[k], p[next]);
        let b = cut(p[next], p[k]);
        if a.w == 0.0 {
            continue;
        }
        // Its outline against the light comes from the triangle's own way round.
        tile.kind = EDGE;
        tile.a = a;
        tile.b = b;
        let reach = frame.shadow.w * (grid.farthest - min(a.z / a.w, b.z / b.w));
        tile.cells = cells_of(
            min(a.xy / a.w, b.xy / b.w) - reach,
            max(a.xy / a.w, b.xy / b.w) + reach,
        );
        add_or_divide(tile);
    }
}

// How many threads share a tile: as many as work in step. Each of them looks at all of the tile first.
override TILE_THREADS: u32 = 64;

@compute @workgroup_size(TILE_THREADS)
fn soften_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) i: u32,
) {
    let count = min(atomicLoad(&tiles.count), arrayLength(&tiles.tile));
    for (var t = group.x; t < count; t += groups.x) {
        let tile = tiles.tile[t];
        let outline = outline_of(tile);
        let size = 1.0 / grid.cells_per_unit;
        // What lies beside the tile's cells in a quarter of theirs is not reached, or has its part as well.
        let first = tile.cells.xy / QUARTER;
        let last = tile.cells.zw / QUARTER;
        for (var y = first.y; y <= last.y; y++) {
            for (var x = first.x; x <= last.x; x++) {
                let quarter = vec2(x, y);
                let low = grid.low + size * (vec2<f32>(quarter * QUARTER) - 0.02);
                let least = least_depth(outline, low, low + size * (f32(QUARTER) + 0.04));
                if deepest_of_quarter(quarter) <= least {
                    continue;
                }
                let run = run_deeper(quarter, least);
                for (var s = run.at + i; s < run.end; s += TILE_THREADS) {
                    add_to(ordered_sample(s), tile);
                }
            }
        }
    }
}
