// Hard shadows, first half: what is seen, as the light sees it, into a grid. See shadow.wgsl.

struct Grid {
    low: vec2<f32>,
    cells_per_unit: vec2<f32>,
    size: vec2<i32>,
    farthest: f32,
    // Of all samples, the largest of −x, −y, x, y and depth, as ordered(); 0 for none.
    largest: array<atomic<u32>, 5>,
}

@group(1) @binding(2) var<storage, read_write> grid: Grid;
// 1 + the pixel of the first sample of each.
@group(1) @binding(3) var<storage, read_write> cells: array<atomic<u32>>;

// What grazes the surface more is taken for this: it is hardly lit.
const COSINE_MIN: f32 = 0.1;

// Grows with f, and is never 0.
fn ordered(f: f32) -> u32 {
    let bits = bitcast<u32>(f);
    return select(bits | 0x80000000u, ~bits, (bits >> 31u) == 1u);
}

fn unordered(code: u32) -> f32 {
    return bitcast<f32>(select(~code, code & 0x7fffffffu, (code >> 31u) == 1u));
}

@compute @workgroup_size(8, 8)
fn place(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.area.zw) {
        return;
    }
    let at = frame.area.xy + id.xy;
    let pixel = at.y * frame.size.x + at.x;
    let identity = textureLoad(identities, vec2<i32>(at), 0).x;
    let triangle = triangle_of(identity);
    if triangle == NONE {
        // Pixels of other arenas are placed by their own dispatch.
        if identity == 0u {
            samples[pixel].next = ABSENT;
        }
        return;
    }
    let sample = sample_of(seen_point(triangle, vec2<f32>(at) + 0.5));
    samples[pixel] = sample;
    if sample.next == TURNED {
        atomicStore(&occlusion[pixel], HIDDEN);
    }
}

fn sample_of(seen: Seen) -> Sample {
    let p = frame.light_from_model * vec4(seen.model, 1.0);
    let limit = frame.shadow.z;
    if p.w <= 0.0 || (limit > 0.0 && any(abs(p.xy) > vec2(p.w * limit))) {
        return Sample(0.0, 0.0, 0.0, ABSENT);
    }
    let is_point = frame.light.w > 0.5;
    let towards = select(frame.light.xyz, frame.light.xyz - seen.world, is_point);
    let across = normalize((frame.world_from_model * vec4(seen.across, 0.0)).xyz);
    let incidence = dot(across, normalize(towards));
    // The side that is seen is not the one that is lit. Casters do not tell: what is nearer than the
    // bias does not count.
    let to_eye = select(frame.eye.xyz, frame.eye.xyz - seen.world, frame.eye.w > 0.5);
    if incidence * dot(across, to_eye) <= 0.0 {
        return Sample(0.0, 0.0, 0.0, TURNED);
    }
    let cosine = max(abs(incidence), COSINE_MIN);
    let bias = (max(seen.depth, 0.0) * frame.bias.x + frame.bias.y) / cosine;
    var depth = p.z / p.w - bias;
    if is_point {
        // So far along the ray; never beyond the light.
        let share = clamp(1.0 - bias / length(p.xyw), 1e-6, 1.0);
        depth = p.z / (p.w * share);
    }
    return Sample(p.x / p.w, p.y / p.w, depth, UNBINNED);
}

// A column of 64 pixels each: few enough meet at the same numbers.
@compute @workgroup_size(64)
fn measure(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.area.z || id.y * 64u >= frame.area.w {
        return;
    }
    var largest: array<f32, 5>;
    var is_used = false;
    for (var i = 0; i < 5; i++) {
        largest[i] = -3e38;
    }
    let end = min(id.y * 64u + 64u, frame.area.w);
    for (var y = id.y * 64u; y < end; y++) {
        let sample = samples[(frame.area.y + y) * frame.size.x + frame.area.x + id.x];
        if sample.next == UNBINNED {
            is_used = true;
            largest[0] = max(largest[0], -sample.x);
            largest[1] = max(largest[1], -sample.y);
            largest[2] = max(largest[2], sample.x);
            largest[3] = max(largest[3], sample.y);
            largest[4] = max(largest[4], sample.depth);
        }
    }
    if is_used {
        for (var i = 0; i < 5; i++) {
            atomicMax(&grid.largest[i], ordered(largest[i]));
        }
    }
}

// As many cells as there is room for, as square as that allows.
@compute @workgroup_size(1)
fn lay_out() {
    var largest: array<f32, 5>;
    for (var i = 0; i < 5; i++) {
        largest[i] = unordered(atomicLoad(&grid.largest[i]));
    }
    grid.low = -vec2(largest[0], largest[1]);
    // Without samples nothing is nearer than the farthest.
    grid.farthest = select(-3e38, largest[4], atomicLoad(&grid.largest[4]) != 0u);
    let extent = max(vec2(largest[2], largest[3]) - grid.low, vec2(1e-30));
    let room = f32(arrayLength(&cells));
    let columns = clamp(floor(sqrt(room * clamp(extent.x / extent.y, 1e-6, 1e6))), 1.0, room);
    grid.size = vec2<i32>(vec2(columns, max(floor(room / columns), 1.0)));
    grid.cells_per_unit = vec2<f32>(grid.size) / extent;
}

@compute @workgroup_size(8, 8)
fn bin(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.area.zw) {
        return;
    }
    let at = frame.area.xy + id.xy;
    let pixel = at.y * frame.size.x + at.x;
    let sample = samples[pixel];
    if sample.next != UNBINNED {
        return;
    }
    let place = floor((vec2(sample.x, sample.y) - grid.low) * grid.cells_per_unit);
    let cell = clamp(vec2<i32>(place), vec2(0), grid.size - 1);
    samples[pixel].next = atomicExchange(&cells[cell.y * grid.size.x + cell.x], pixel + 1u);
}
