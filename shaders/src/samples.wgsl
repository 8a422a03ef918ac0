// Shadows, first half: what is seen, as the light sees it, into a grid. See shadow.wgsl.

struct Cells {
    low: vec2<f32>,
    cells_per_unit: vec2<f32>,
    size: vec2<i32>,
    // In a row.
    blocks: i32,
    farthest: f32,
    // Of all samples, the largest of −x, −y, x, y and depth, as ordered(); 0 for none.
    largest: array<atomic<u32>, 5>,
    // How many cells there may be.
    room: i32,
    // Where the samples of each cell begin, by their numbers, and behind the last where they end; then the largest depth
    // of those of each cell, as ordered(), 0 for none; then of each quarter, of each block, how many samples come
    // before each quarter, and by which depths each is ordered: how much one step is, and where the samples of each begin.
    // Behind all that, samples' numbers, quarter by quarter, the deepest first.
    cell: array<atomic<u32>>,
}

@group(1) @binding(0) var identities: texture_2d<u32>;
@group(1) @binding(1) var<storage, read_write> samples: array<Sample>;
@group(1) @binding(2) var<storage, read_write> grid: Cells;
@group(1) @binding(3) var<storage, read_write> occlusion: array<atomic<u32>>;
@group(1) @binding(5) var<storage, read_write> sorted: array<Sample>;

struct DrawnRange {
    // Number of its first triangle among all arenas.
    first: u32,
    error: f32,
}

// In the order of their first triangles.
@group(1) @binding(6) var<storage, read> drawn: array<DrawnRange>;

// What grazes the surface more is taken for this: it is hardly lit.
const COSINE_MIN: f32 = 0.1;

@compute @workgroup_size(8, 8)
fn place(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.area.zw) {
        return;
    }
    let at = frame.area.xy + id.xy;
    let pixel = number_of(at);
    let identity = textureLoad(identities, vec2<i32>(at), 0).x;
    let triangle = triangle_of(identity);
    if triangle == NONE {
        // Pixels of other arenas are placed by their own dispatch.
        if identity == 0u {
            samples[pixel].place = ABSENT;
        }
        return;
    }
    // Not by its depth: where corners are snapped to parts of a pixel that lies beside the triangle.
    let seen = seen_point(triangle, in_picture(vec2<f32>(at) + 0.5));
    var is_back = (identity & BACK) != 0u;
    var across = seen.across;
    var error = error_of((identity & ~BACK) - 1u);
    let corners = vec3(indices[3u * triangle], indices[3u * triangle + 1u], indices[3u * triangle + 2u]);
    if !is_point(triangle) && any((corners & vec3(MOVED)) != vec3(0u)) {
        // A skirt stands for the surface that it hangs from, which is as far above as it reaches.
        across = octahedral(vertices[corners.x & VERTEX].normal);
        let to_eye = select(frame.eye.xyz, frame.eye.xyz - seen.world, frame.eye.w > 0.5);
        is_back = dot((frame.world_from_model * vec4(across, 0.0)).xyz, to_eye) < 0.0;
        error += skirt_reach(corners) * length(frame.world_from_model[0].xyz);
    }
    let normal = normal_in_light_space(select(across, -across, is_back));
    let sample = sample_of(seen.model, normal, error);
    samples[pixel] = sample;
    if sample.place == TURNED {
        atomicStore(&occlusion[pixel], HIDDEN);
    } else if (sample.place == UNBINNED) & (frame.shadow.w > 0.0) {
        atomicStore(&occlusion[pixel], u32(below_horizon(seen.model, normal) * f32(HIDDEN)));
    }
}

// How far a triangle of a skirt reaches at most, model space.
fn skirt_reach(corners: vec3<u32>) -> f32 {
    var reach = 0.0;
    for (var k = 0u; k < 3u; k++) {
        if (corners[k] & MOVED) != 0u {
            reach = max(reach, reach_of(vertices[corners[k] & VERTEX].normal));
        }
    }
    return reach;
}

// In the light's axes: across its picture and away from it.
fn normal_in_light_space(across: vec3<f32>) -> vec3<f32> {
    let turned = frame.light_from_model * vec4(across, 0.0);
    return normalize(vec3(turned.xy, select(turned.z, turned.w, frame.light.w > 0.5)));
}

// From the light to a point of light space, in the same axes.
fn ray_to(p: vec4<f32>) -> vec3<f32> {
    return select(vec3(0.0, 0.0, 1.0), p.xyw, frame.light.w > 0.5);
}

// How much of the light's disc is below the surface that is seen: what hides it there is the body
// itself, and begins at the point.
fn below_horizon(point: vec3<f32>, normal: vec3<f32>) -> f32 {
    let ray = ray_to(frame.light_from_model * vec4(point, 1.0));
    let x = clamp(-dot(normal, ray) / max(frame.shadow.w * length(normal.xy), 1e-30), -1.0, 1.0);
    return 0.5 - (x * sqrt(1.0 - x * x) + asin(x)) / 3.14159265;
}

// Of a point that is seen (model space), the normal of the side that is seen, and how far the point may
// be from the scan.
fn sample_of(point: vec3<f32>, normal: vec3<f32>, error: f32) -> Sample {
    let p = frame.light_from_model * vec4(point, 1.0);
    let limit = frame.shadow.z;
    if p.w <= 0.0 || ((limit > 0.0) & any(abs(p.xy) > vec2(p.w * limit))) {
        return Sample(0.0, 0.0, 0.0, 0.0, ABSENT);
    }
    let is_point = frame.light.w > 0.5;
    let incidence = -dot(normal, normalize(ray_to(p)));
    // The side that is seen is not the one that is lit. Casters do not tell: what is nearer than the
    // bias does not count.
    if incidence <= 0.0 {
        return Sample(0.0, 0.0, 0.0, 0.0, TURNED);
    }
    // What is seen and what casts are different surfaces: along the ray they may be this far apart.
    let slope = 1.0 / max(incidence, COSINE_MIN);
    let bias = (error + frame.bias.x) * slope;
    let parallel = Sample(p.x, p.y, p.z - bias, slope, UNBINNED);
    // So far along the ray; never beyond the light.
    let reach = length(p.xyw);
    let share = clamp(1.0 - bias / reach, 1e-6, 1.0);
    let depth = p.z / (p.w * share);
    let spread = Sample(p.x / p.w, p.y / p.w, depth, -depth * slope / (reach * share), UNBINNED);
    return Sample(
        select(parallel.x, spread.x, is_point),
        select(parallel.y, spread.y, is_point),
        select(parallel.depth, spread.depth, is_point),
        select(parallel.slack, spread.slack, is_point),
        UNBINNED,
    );
}

// How far a triangle among all arenas may be from the scan's, world space.
fn error_of(triangle: u32) -> f32 {
    var low = 0u;
    var high = arrayLength(&drawn);
    while high - low > 1u {
        let middle = (low + high) / 2u;
        if drawn[middle].first <= triangle {
            low = middle;
        } else {
            high = middle;
        }
    }
    return drawn[low].error;
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
        let sample = samples[number_of(frame.area.xy + vec2(id.x, y))];
        if sample.place == UNBINNED {
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
    // By whole blocks.
    let numbers = arrayLength(&grid.cell) - 1u - frame.area.z * frame.area.w;
    let room = f32(numbers / u32(NUMBERS_OF_BLOCK));
    let columns = clamp(floor(sqrt(room * clamp(extent.x / extent.y, 1e-6, 1e6))), 1.0, room);
    let blocks = vec2<i32>(vec2(columns, max(floor(room / columns), 1.0)));
    grid.room = i32(room) * CELLS_OF_BLOCK;
    grid.size = blocks * BLOCK;
    grid.blocks = blocks.x;
    grid.cells_per_unit = vec2<f32>(grid.size) / extent;
}

@compute @workgroup_size(8, 8)
fn bin(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.area.zw) {
        return;
    }
    let at = frame.area.xy + id.xy;
    let pixel = number_of(at);
    let sample = samples[pixel];
    if sample.place != UNBINNED {
        return;
    }
    let place = floor((vec2(sample.x, sample.y) - grid.low) * grid.cells_per_unit);
    let cell = number_of_cell(clamp(vec2<i32>(place), vec2(0), grid.size - 1), grid.blocks);
    samples[pixel].place = u32(cell) + 1u;
    atomicAdd(&grid.cell[cell + 1], 1u);
    atomicMax(&grid.cell[grid.room + 1 + cell], ordered(sample.depth));
}

fn first_of_quarters() -> i32 {
    return 2 * grid.room + 1;
}

fn first_of_blocks() -> i32 {
    return first_of_quarters() + grid.room / CELLS_OF_QUARTER;
}

// How many samples come before each quarter.
fn first_of_befores() -> i32 {
    return first_of_blocks() + grid.room / CELLS_OF_BLOCK;
}

fn first_of_orders() -> i32 {
    return first_of_befores() + grid.room / CELLS_OF_QUARTER;
}

fn first_ordered() -> i32 {
    return first_of_orders() + (STEPS + 1) * grid.room / CELLS_OF_QUARTER;
}

fn block_count() -> i32 {
    return grid.blocks * (grid.size.y / BLOCK);
}

// Of each block, by a thread: the largest depths, and how many samples its quarters have.
@compute @workgroup_size(64)
fn sum_up(@builtin(global_invocation_id) id: vec3<u32>) {
    let block = i32(id.x);
    if block >= block_count() {
        return;
    }
    var deepest_of_all = 0u;
    for (var quarter = 4 * block; quarter < 4 * block + 4; quarter++) {
        var deepest = 0u;
        var count = 0u;
        for (var i = 0; i < CELLS_OF_QUARTER; i++) {
            let cell = quarter * CELLS_OF_QUARTER + i;
            count += atomicLoad(&grid.cell[cell + 1]);
            deepest = max(deepest, atomicLoad(&grid.cell[grid.room + 1 + cell]));
        }
        atomicStore(&grid.cell[first_of_quarters() + quarter], deepest);
        atomicStore(&grid.cell[first_of_befores() + quarter], count);
        deepest_of_all = max(deepest_of_all, deepest);
    }
    atomicStore(&grid.cell[first_of_blocks() + block], deepest_of_all);
}

const SCANNERS: u32 = 256u;

var<workgroup> sums: array<u32, SCANNERS>;

// From how many samples quarters have to how many come before: each thread has a share of them.
@compute @workgroup_size(SCANNERS)
fn scan(@builtin(local_invocation_index) i: u32) {
    let count = 4 * block_count();
    let share = (count + i32(SCANNERS) - 1) / i32(SCANNERS);
    let first = first_of_befores() + min(i32(i) * share, count);
    let end = first_of_befores() + min((i32(i) + 1) * share, count);
    var sum = 0u;
    for (var q = first; q < end; q++) {
        sum += atomicLoad(&grid.cell[q]);
    }
    sums[i] = sum;
    workgroupBarrier();
    var before = 0u;
    for (var k = 0u; k < i; k++) {
        before += sums[k];
    }
    for (var q = first; q < end; q++) {
        let here = atomicLoad(&grid.cell[q]);
        atomicStore(&grid.cell[q], before);
        before += here;
    }
}

// Where the samples of each cell begin, of a quarter's by a thread: kept with the next cell, whose beginning it is when they
// are sorted.
@compute @workgroup_size(64)
fn number(@builtin(global_invocation_id) id: vec3<u32>) {
    let quarter = i32(id.x);
    if quarter >= 4 * block_count() {
        return;
    }
    var before = atomicLoad(&grid.cell[first_of_befores() + quarter]);
    for (var i = 1; i <= CELLS_OF_QUARTER; i++) {
        let cell = quarter * CELLS_OF_QUARTER + i;
        let here = atomicLoad(&grid.cell[cell]);
        atomicStore(&grid.cell[cell], before);
        before += here;
    }
}

@compute @workgroup_size(8, 8)
fn sort(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.area.zw) {
        return;
    }
    let pixel = number_of(frame.area.xy + id.xy);
    let sample = samples[pixel];
    if (sample.place == UNBINNED) | (sample.place >= TURNED) {
        return;
    }
    let slot = atomicAdd(&grid.cell[sample.place], 1u);
    sorted[slot] = Sample(sample.x, sample.y, sample.depth, sample.slack, pixel);
}

// Threads that order a quarter's samples.
override TILE_THREADS: u32 = 64;

var<workgroup> shallowest: atomic<u32>;
// Of each step, how many there are, then where the next one goes.
var<workgroup> step_at: array<atomic<u32>, STEPS>;

// Numbers of a quarter's samples by steps of depth, by a workgroup: what an edge reaches are the deepest.
@compute @workgroup_size(TILE_THREADS)
fn order(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) i: u32,
) {
    let number = i32(group.x + group.y * groups.x);
    let is_used = number < 4 * block_count();
    let quarter = select(0, number, is_used);
    let first = atomicLoad(&grid.cell[quarter * CELLS_OF_QUARTER]);
    let end = select(first, atomicLoad(&grid.cell[(quarter + 1) * CELLS_OF_QUARTER]), is_used);
    if i == 0u {
        atomicStore(&shallowest, 0xffffffffu);
    }
    workgroupBarrier();
    for (var s = first + i; s < end; s += TILE_THREADS) {
        atomicMin(&shallowest, ordered(sorted[s].depth));
    }
    workgroupBarrier();
    let deepest = unordered(atomicLoad(&grid.cell[first_of_quarters() + quarter]));
    let width = max((deepest - unordered(atomicLoad(&shallowest))) / f32(STEPS), 1e-30);
    for (var s = first + i; s < end; s += TILE_THREADS) {
        atomicAdd(&step_at[step_of(deepest - sorted[s].depth, width)], 1u);
    }
    workgroupBarrier();
    if i == 0u {
        let kept = first_of_orders() + (STEPS + 1) * quarter;
        if is_used {
            atomicStore(&grid.cell[kept], bitcast<u32>(width));
        }
        var before = first;
        for (var step = 0; step < STEPS; step++) {
            let count = atomicLoad(&step_at[step]);
            atomicStore(&step_at[step], before);
            if is_used {
                atomicStore(&grid.cell[kept + 1 + step], before);
            }
            before += count;
        }
    }
    workgroupBarrier();
    for (var s = first + i; s < end; s += TILE_THREADS) {
        let slot = atomicAdd(&step_at[step_of(deepest - sorted[s].depth, width)], 1u);
        atomicStore(&grid.cell[first_ordered() + i32(slot)], s);
    }
}

fn step_of(above: f32, width: f32) -> i32 {
    return i32(clamp(above / width, 0.0, f32(STEPS - 1)));
}
