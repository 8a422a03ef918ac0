// Hard shadows with a map, to be compared with those without: see shadow_map.rs. Points are placed as for
// shadow.wgsl.
//
// measure_map: samples → their bounds on the map's plane · fit: bounds → the map's picture, or a uniform one ·
// map_draw: what casts → depths (map_draw.wgsl) · look_up: depths → what is hidden.

struct ShadowMap {
    view: MapView,
    // Visible points up to 60°, and those of them whose texels are too long.
    judged: atomic<u32>,
    denied: atomic<u32>,
    // Of all samples, the largest of −x, −y, x, y in light space; of these on the map's plane; of − and + its
    // third row. As ordered(); 0 for none.
    largest: array<atomic<u32>, 10>,
}

@group(1) @binding(1) var<storage, read_write> samples: array<Sample>;
@group(1) @binding(2) var<storage, read_write> map: ShadowMap;
@group(1) @binding(3) var<storage, read_write> occlusion: array<atomic<u32>>;
@group(1) @binding(4) var depths: texture_depth_2d;

@compute @workgroup_size(64)
fn measure_map(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.area.z || id.y * 64u >= frame.area.w {
        return;
    }
    var largest: array<f32, 10>;
    var is_used = false;
    for (var i = 0; i < 10; i++) {
        largest[i] = -3e38;
    }
    let end = min(id.y * 64u + 64u, frame.area.w);
    for (var y = id.y * 64u; y < end; y++) {
        let sample = samples[number_of(frame.area.xy + vec2(id.x, y))];
        if sample.place == UNBINNED {
            is_used = true;
            let p = map.view.homography * vec3(sample.x, sample.y, 1.0);
            // On rays where it has no place nothing else is looked at.
            let at = select(vec2(0.0), p.xy / p.z, p.z > 0.0);
            let all = array(-sample.x, -sample.y, sample.x, sample.y, -at.x, -at.y, at.x, at.y, -p.z, p.z);
            for (var i = 0; i < 10; i++) {
                largest[i] = max(largest[i], all[i]);
            }
        }
    }
    if is_used {
        for (var i = 0; i < 10; i++) {
            atomicMax(&map.largest[i], ordered(largest[i]));
        }
    }
}

@compute @workgroup_size(1)
fn fit() {
    var largest: array<f32, 10>;
    for (var i = 0; i < 10; i++) {
        largest[i] = unordered(atomicLoad(&map.largest[i]));
    }
    let least = -largest[8];
    let most = largest[9];
    let is_fallback = !(least > 0.0 && most <= map.view.spread_max * least);
    var low = -vec2(largest[4], largest[5]);
    var high = vec2(largest[6], largest[7]);
    if is_fallback {
        map.view.homography = mat3x3(vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));
        low = -vec2(largest[0], largest[1]);
        high = vec2(largest[2], largest[3]);
    }
    if map.view.is_fixed != 0u {
        return;
    }
    map.view.is_fallback = u32(is_fallback);
    map.view.low = low;
    map.view.high = high;
}

fn texels_per_unit() -> vec2<f32> {
    return f32(map.view.size) / max(map.view.high - map.view.low, vec2(1e-30));
}

// The place of a sample on the map, in texels.
fn texel_of(sample: Sample) -> vec2<f32> {
    let p = map.view.homography * vec3(sample.x, sample.y, 1.0);
    return (p.xy / p.z - map.view.low) * texels_per_unit();
}

@compute @workgroup_size(8, 8)
fn look_up(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.area.zw) {
        return;
    }
    let at = frame.area.xy + id.xy;
    let pixel = number_of(at);
    let sample = samples[pixel];
    if sample.place != UNBINNED {
        return;
    }
    let place = texel_of(sample);
    // How texels and light space change together round here, and how long a texel is there.
    let p = map.view.homography * vec3(sample.x, sample.y, 1.0);
    let m = p.xy / p.z;
    let h = map.view.homography;
    let by_x = (h[0].xy - m * h[0].z) / p.z * texels_per_unit();
    let by_y = (h[1].xy - m * h[1].z) / p.z * texels_per_unit();
    let area = max(abs(cross2(by_x, by_y)), 1e-37);
    let texel = max(length(vec2(by_y.y, by_x.y)), length(vec2(by_y.x, by_x.x))) / area;
    // Its length in the world, and the cosine of incidence, which slack has in it: see sample_of().
    let is_point = frame.light.w > 0.5;
    let distance = select(1.0, -1.0 / sample.depth, is_point);
    let reach = distance * length(vec3(sample.x, sample.y, 1.0));
    let slope = select(sample.slack, sample.slack * reach * distance, is_point);
    let sine = sqrt(max(1.0 - 1.0 / (slope * slope), 0.0));
    // (ε + 0.71 texel · tan θ), of which the sample has its own part already.
    let bias = sample.slack * (map.view.error + 0.71 * texel * distance * sine);
    let cell = clamp(vec2<i32>(floor(place)), vec2(0), vec2(map.view.size - 1));
    let depth = textureLoad(depths, cell, 0);
    if light_depth(depth, map.view.reach) < sample.depth - bias && depth > 0.0 {
        atomicStore(&occlusion[pixel], HIDDEN);
    }

    // How long a texel is in pixels, from the samples beside this one.
    if slope > 2.0 || any(id.xy + 1u >= frame.area.zw) {
        return;
    }
    let right = samples[number_of(at + vec2(1u, 0u))];
    let below = samples[number_of(at + vec2(0u, 1u))];
    if right.place != UNBINNED || below.place != UNBINNED {
        return;
    }
    let to_right = texel_of(right) - place;
    let to_below = texel_of(below) - place;
    let determinant = max(abs(cross2(to_right, to_below)), 1e-37);
    let across = length(vec2(to_below.y, to_right.y)) / determinant;
    let down = length(vec2(to_below.x, to_right.x)) / determinant;
    atomicAdd(&map.judged, 1u);
    if max(across, down) > map.view.texel_max {
        atomicAdd(&map.denied, 1u);
    }
}
