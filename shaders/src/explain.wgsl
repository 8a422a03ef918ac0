// Instead of shading: which level of detail is seen in each pixel, how far it may be from the scan or what it is made
// of, where nodes end, or every triangle's edges.

struct Part {
    // The cell, model space, and the number of the node's first triangle among all arenas.
    low: vec3<f32>,
    first: u32,
    high: vec3<f32>,
    // Depth in the octree.
    depth: u32,
    // What stands for its bound, linear light.
    bound_colour: vec3<f32>,
    // 1 where it is the scan itself.
    is_leaf: u32,
}

@group(1) @binding(0) var identities: texture_2d<u32>;
// In the order of their first triangles.
@group(1) @binding(1) var<storage, read> parts: array<Part>;

// Pixels from the middle of a border's line to its side.
const HALF_LINE: f32 = 0.9;
const HALF_EDGE: f32 = 0.5;
const LINE: vec3<f32> = vec3(0.0, 0.0, 0.0);
const PAPER: vec3<f32> = vec3(0.7);
const SKIRT: vec3<f32> = vec3(1.0, 0.25, 0.0);

@vertex
fn explain_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    let p = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(p * 4.0 - 1.0, 0.0, 1.0);
}

// The last part that begins at or before a triangle.
fn part_of(triangle: u32) -> Part {
    var low = 0u;
    var high = arrayLength(&parts);
    while high - low > 1u {
        let middle = (low + high) / 2u;
        if parts[middle].first <= triangle {
            low = middle;
        } else {
            high = middle;
        }
    }
    return parts[low];
}

// Eight colours that can be told apart, from the root's on, then again (after Okabe & Ito 2008,
// linear light).
fn colour_of(depth: u32) -> vec3<f32> {
    switch depth % 8u {
        case 0u: { return vec3(0.60, 0.60, 0.60); }
        case 1u: { return vec3(0.79, 0.35, 0.00); }
        case 2u: { return vec3(0.09, 0.46, 0.81); }
        case 3u: { return vec3(0.00, 0.34, 0.17); }
        case 4u: { return vec3(0.87, 0.77, 0.05); }
        case 5u: { return vec3(0.00, 0.17, 0.44); }
        case 6u: { return vec3(0.66, 0.11, 0.00); }
        default: { return vec3(0.60, 0.19, 0.39); }
    }
}

fn pixel_of(corner: vec3<f32>) -> vec2<f32> {
    let clip = frame.clip_from_model * vec4(corner, 1.0);
    return (clip.xy / clip.w * vec2(0.5, -0.5) + 0.5) * vec2<f32>(frame.size.xy);
}

fn distance_to_line(p: vec2<f32>, a: vec2<f32>, b: vec2<f32>) -> f32 {
    let along = b - a;
    let t = clamp(dot(p - a, along) / max(dot(along, along), 1e-20), 0.0, 1.0);
    return distance(p, a + t * along);
}

@fragment
fn depth_fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    return explained(pixel.xy, DEPTH);
}

@fragment
fn borders_fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    return explained(pixel.xy, BORDERS);
}

@fragment
fn bound_fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    return explained(pixel.xy, BOUND);
}

@fragment
fn kinds_fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    return explained(pixel.xy, KINDS);
}

@fragment
fn edges_fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    return explained(pixel.xy, EDGES);
}

const DEPTH: u32 = 0u;
const BORDERS: u32 = 1u;
const BOUND: u32 = 2u;
const KINDS: u32 = 3u;
const EDGES: u32 = 4u;

// What a whole primitive is painted with.
fn paint_of(part: Part, of_point: bool, paint: u32) -> vec3<f32> {
    switch paint {
        case BORDERS, EDGES: { return mix(PAPER, colour_of(part.depth), 0.25); }
        case BOUND: { return part.bound_colour; }
        case KINDS: {
            // Of Okabe and Ito's colours, too.
            let level = select(vec3(0.09, 0.46, 0.81), vec3(0.79, 0.35, 0.0), of_point);
            return select(level, vec3(0.6), part.is_leaf == 1u);
        }
        default: { return colour_of(part.depth); }
    }
}

fn explained(pixel: vec2<f32>, paint: u32) -> vec4<f32> {
    let identity = textureLoad(identities, vec2<i32>(pixel), 0).x;
    let triangle = (identity & ~BACK) - 1u;
    let number = triangle - frame.size.z;
    // Triangles of other arenas are painted by their own draw.
    if identity == 0u || number >= arrayLength(&indices) / 3u {
        discard;
    }
    let part = part_of(triangle);

    if is_point(number) {
        // Points have no borders that could be drawn.
        let v = vertices[indices[3u * number] & VERTEX];
        let n = normalize((frame.world_from_model * vec4(octahedral(v.normal), 0.0)).xyz);
        let at = (frame.world_from_model * vec4(v.x, v.y, v.z, 1.0)).xyz;
        let to_eye = normalize(select(frame.eye.xyz, frame.eye.xyz - at, frame.eye.w > 0.5));
        let facing = 0.35 + 0.65 * abs(dot(n, to_eye));
        return vec4(paint_of(part, true, paint) * facing, 1.0);
    }

    var corner: array<vec3<f32>, 3>;
    var on_low: array<vec3<bool>, 3>;
    var on_high: array<vec3<bool>, 3>;
    var is_skirt = false;
    let near = 1e-6 * (part.high - part.low);
    for (var i = 0u; i < 3u; i++) {
        let index = indices[3u * number + i];
        is_skirt = is_skirt || (index & MOVED) != 0u;
        corner[i] = position_of(index);
        on_low[i] = abs(corner[i] - part.low) <= max(near, abs(part.low) * 1e-6);
        on_high[i] = abs(corner[i] - part.high) <= max(near, abs(part.high) * 1e-6);
    }
    let across = cross(corner[1] - corner[0], corner[2] - corner[0]);
    let n = normalize((frame.world_from_model * vec4(across, 0.0)).xyz);
    let middle = (frame.world_from_model * vec4((corner[0] + corner[1] + corner[2]) / 3.0, 1.0)).xyz;
    let to_eye = normalize(select(frame.eye.xyz, frame.eye.xyz - middle, frame.eye.w > 0.5));
    let facing = 0.35 + 0.65 * abs(dot(n, to_eye));
    let plain = vec4(paint_of(part, false, paint) * facing, 1.0);
    if paint == EDGES {
        var nearest = HALF_EDGE + 1.0;
        for (var i = 0u; i < 3u; i++) {
            let from_edge = distance_to_line(in_picture(pixel), pixel_of(corner[i]), pixel_of(corner[(i + 1u) % 3u]));
            nearest = min(nearest, from_edge);
        }
        return mix(vec4(LINE, 1.0), plain, saturate(nearest - HALF_EDGE + 0.5));
    }
    if paint != BORDERS {
        return plain;
    }
    if is_skirt {
        return vec4(SKIRT, 1.0);
    }
    for (var i = 0u; i < 3u; i++) {
        let j = (i + 1u) % 3u;
        let in_face = any(on_low[i] & on_low[j]) || any(on_high[i] & on_high[j]);
        if in_face && distance_to_line(in_picture(pixel), pixel_of(corner[i]), pixel_of(corner[j])) < HALF_LINE {
            return vec4(LINE, 1.0);
        }
    }
    return plain;
}
