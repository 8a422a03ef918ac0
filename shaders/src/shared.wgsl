// Declarations that several passes share. Spaces: model = source coordinates relative to the
// centre of the root cube; world = models placed beside one another; clip = wgpu's, depth
// reversed (1 at the near plane, 0 at infinity).

// Where a shader branches on nothing but these numbers, software rasterisers (Mesa 22.3) compile it anew while
// they change, which is in every frame, and keep what they compiled: memory without end. So they are chosen by with
// `select`, or by `&` with something that differs between pixels: of `&&` the second half would again be a branch.
// `branches.rs` looks for what was overlooked.
struct Frame {
    clip_from_model: mat4x4<f32>,
    world_from_model: mat4x4<f32>,
    // xyz: eye in world space; w: 0 for orthographic views, where the eye is a direction.
    eye: vec4<f32>,
    // xyz: light in world space, a position (w = 1) or the direction towards it (w = 0).
    light: vec4<f32>,
    // rgb: linear light of the material; a: strength of the highlight.
    material: vec4<f32>,
    // x: ambient share; y: 1 where vertices carry colours; z: 1 to paint backs magenta;
    // w: 1 where backs are drawn like fronts.
    shading: vec4<f32>,
    // Model space → light space: see shadow.wgsl.
    light_from_model: mat4x4<f32>,
    // x: 1 where occlusion is known. Of the light's face: y: least w that is drawn; z: largest
    // |x| / w and |y| / w, 0 for no limit; w: radius of the disc, or of parallel light its tangent.
    shadow: vec4<f32>,
    // x: what rounding may do to positions, world space; y: 1 where parts of a picture must agree; z: 1 where what is
    // drawn casts shadows; w: 1 where planes that cut the statue open show cut faces.
    bias: vec4<f32>,
    // Points: model lengths of clip.x, of clip.y, and of clip.w (in parallel views of clip.z), and of a
    // lattice step.
    points: vec4<f32>,
    // x: 1 + which kept number is painted, 0 for none; y: the code that is 0 on the map, z: by how much of
    // it each further code is; w: 1 where directions are painted.
    scalar: vec4<f32>,
    // x: how much contrast follows the bends of the surface, 0 to 1; y: within how many pixels; z: 1 where they are
    // painted.
    relief: vec4<f32>,
    // xyz: the way back to a lamp that shines within a cone, world space; w: the cosine at the cone's side, −2 of
    // lights that shine everywhere.
    spot: vec4<f32>,
    // The part of the picture in which anything is seen: its first pixel, its width and height.
    area: vec4<u32>,
    // x, y: size of the picture in pixels; z: number of the arena's first triangle; w: of its
    // first chunk.
    size: vec4<u32>,
    // The part of the picture that is drawn: its first pixel, its width and height.
    window: vec4<u32>,
    // Planes that cut the statue open: nothing is drawn where one of them · (ndc.xy, depth, 1) > 0.
    clip: array<vec4<f32>, 3>,
    // Linear light of their cut faces.
    clip_colours: array<vec4<f32>, 3>,
}

struct Vertex {
    // Model space.
    x: f32,
    y: f32,
    z: f32,
    // Two components on the octahedron, −511 to 511, in the upper ten bits of each half. Below them two codes of a skirt's
    // lower corner: how far it is moved where it is drawn, and where it casts shadows.
    normal: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> vertices: array<Vertex>;
// Three for each triangle, counted from the arena's first vertex. Marked ones are the lower
// corners of skirts, which are moved into the surface within a face of their cell. Points have three as
// well: their vertex, marked, twice, and their radii, a byte each.
@group(0) @binding(2) var<storage, read> indices: array<u32>;

// A pixel's identity: 0 where nothing is drawn, else 1 + the number of the triangle among all
// arenas, with the highest bit set where its back is seen.
const BACK: u32 = 0x80000000u;

const MOVED: u32 = 0x80000000u;
const VERTEX: u32 = 0x1fffffffu;
const POINT: u32 = 0xe0000000u;

// Radius of the point with this number, model space: a quarter of an octave a step from a quarter of a
// lattice step up, and rounding.
fn radius_of(number: u32, level: u32) -> f32 {
    let code = (indices[3u * number + 2u] >> (8u * level)) & 255u;
    return exp2(f32(code) * 0.25 - 2.0) * frame.points.w * 1.00001;
}

// Whether what has this number, and is counted with the triangles, is a point.
fn is_point(number: u32) -> bool {
    return (indices[3u * number] & POINT) == POINT;
}

fn octahedral(code: u32) -> vec3<f32> {
    let xy = vec2(f32(i32(code << 16u) >> 22u), f32(i32(code) >> 22u)) / 511.0;
    let z = 1.0 - abs(xy.x) - abs(xy.y);
    let folded = (1.0 - abs(xy.yx)) * select(vec2(-1.0), vec2(1.0), xy >= vec2(0.0));
    return normalize(vec3(select(folded, xy, z >= 0.0), z));
}

// How far a skirt's lower corner is moved, model space: a half octave a code from two lattice steps up.
fn reach_of(normal: u32) -> f32 {
    let code = select(normal, normal >> 16u, frame.bias.z > 0.5) & 63u;
    return select(exp2(0.5 * f32(code) + 0.5) * frame.points.w, 0.0, code == 0u);
}

// Model space, of an index as `indices` has it.
fn position_of(index: u32) -> vec3<f32> {
    let v = vertices[index & VERTEX];
    let position = vec3(v.x, v.y, v.z);
    if (index & MOVED) == 0u {
        return position;
    }
    let normal = octahedral(v.normal);
    let axis = (index >> 29u) & 3u;
    let inward = -select(normal, vec3(0.0), vec3(0u, 1u, 2u) == vec3(axis));
    let inward_length = length(inward);
    // Where the surface runs along the face there is no inside within it.
    let direction = select(-normal, inward / inward_length, inward_length > 0.05);
    return position + direction * reach_of(v.normal);
}

// Pixels are counted in the picture, words and samples in the part of it that is drawn: whatever is
// computed of a pixel is the same, bit for bit, in whichever part it lies.
fn in_picture(pixel: vec2<f32>) -> vec2<f32> {
    return pixel + vec2<f32>(frame.window.xy);
}

// The number of a pixel of the part that is drawn.
fn number_of(pixel: vec2<u32>) -> u32 {
    return pixel.y * frame.window.z + pixel.x;
}

// From clip space of the picture to that of the part, for fixed function.
fn in_window(clip: vec4<f32>) -> vec4<f32> {
    let whole = vec2<f32>(frame.size.xy);
    let part = vec2<f32>(frame.window.zw);
    let middle = (whole - 2.0 * vec2<f32>(frame.window.xy)) / part - 1.0;
    let moved = vec4(clip.xy * whole / part + vec2(middle.x, -middle.y) * clip.w, clip.zw);
    return select(moved, clip, all(frame.window.zw == frame.size.xy));
}

// Whether planes cut the statue open. Known when pipelines are made: a branch in the innermost loop costs
// half as much again as all of it.
override CLIPPED: bool = false;

// A pixel's place as planes are tested against it.
fn clip_place(pixel: vec2<f32>, depth: f32) -> vec4<f32> {
    let ndc = (pixel / vec2<f32>(frame.size.xy) * 2.0 - 1.0) * vec2(1.0, -1.0);
    return vec4(ndc, depth, 1.0);
}

// The plane through which a line of sight comes from what is removed to a place: the last of several;
// 3 where it was never removed.
fn entered_plane(place: vec4<f32>) -> u32 {
    var entered = 3u;
    // Depth is reversed: less is farther.
    var farthest = 3.4e38;
    for (var i = 0u; i < 3u; i++) {
        let plane = frame.clip[i];
        let depth = -(dot(plane.xy, place.xy) + plane.w) / plane.z;
        if (plane.z > 0.0) & (depth >= place.z) & (depth <= 1.0) & (depth < farthest) {
            farthest = depth;
            entered = i;
        }
    }
    return entered;
}

// Whether a place of the surface is not drawn.
fn is_removed(place: vec4<f32>) -> bool {
    return dot(frame.clip[0], place) > 0.0
        || dot(frame.clip[1], place) > 0.0
        || dot(frame.clip[2], place) > 0.0;
}

// Whether what has this number is a triangle of a skirt.
fn is_of_skirt(number: u32) -> bool {
    let any_moved = indices[3u * number] | indices[3u * number + 1u] | indices[3u * number + 2u];
    return (any_moved & MOVED) != 0u && !is_point(number);
}
