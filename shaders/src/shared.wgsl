// Declarations that several passes share. Spaces: model = source coordinates relative to the
// centre of the root cube; world = models placed beside one another; clip = wgpu's, depth
// reversed (1 at the near plane, 0 at infinity).

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
    // x, y: size of the picture in pixels; z: number of the arena's first triangle.
    size: vec4<u32>,
}

struct Vertex {
    // Model space.
    x: f32,
    y: f32,
    z: f32,
    // Two 16-bit components on the octahedron, −2047 to 2047.
    normal: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> vertices: array<Vertex>;
// Three for each triangle, counted from the arena's first vertex.
@group(0) @binding(2) var<storage, read> indices: array<u32>;

// A pixel's identity: 0 where nothing is drawn, else 1 + the number of the triangle among all
// arenas, with the highest bit set where its back is seen.
const BACK: u32 = 0x80000000u;

fn position_of(vertex: u32) -> vec3<f32> {
    let v = vertices[vertex];
    return vec3(v.x, v.y, v.z);
}
