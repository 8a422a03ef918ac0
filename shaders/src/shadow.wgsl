// Hard shadows without a map: is there a triangle between this visible point and the light? Each
// pixel's point is laid into a grid as the light sees it, and every triangle that casts is tested,
// exactly, against the points in the cells that it may cover (Aila & Laine, Alias-free shadow
// maps, EGSR 2004; Johnson et al., The irregular z-buffer, TOG 2005). There are no texels, so there
// is neither a resolution to choose nor a bias for it.
//
// Light space: (x, y, z, w) with x / w and y / w across the light's picture and z / w growing with
// the distance from the light, linear across a triangle. Parallel light: w = 1, z the distance along
// its rays. A point: w the distance along its axis and z = −1.
//
// samples.wgsl: place: points → samples · measure: their bounds · lay_out: bounds → grid · bin:
// samples → cells · deepen: cells → blocks of them. occlude.wgsl: occlude: triangles against cells · occlude_tiles: what is left of
// large ones.

struct Sample {
    // On the light's picture.
    x: f32,
    y: f32,
    // z / w that is nearer hides it, by what may be wrong of the sample;
    depth: f32,
    // and by so much more for each unit of length that what hides it may be wrong.
    slack: f32,
    // 1 + the pixel of the next sample in its cell; before they are binned UNBINNED, or why it has no
    // place in one: ABSENT, or TURNED away from the light.
    next: u32,
}

const UNBINNED: u32 = 0u;
const TURNED: u32 = 0xfffffffeu;
const ABSENT: u32 = 0xffffffffu;

// Cells along a block's side.
const BLOCK: i32 = 8;

// Grows with f, and is never 0.
fn ordered(f: f32) -> u32 {
    let bits = bitcast<u32>(f);
    return select(bits | 0x80000000u, ~bits, (bits >> 31u) == 1u);
}

fn unordered(code: u32) -> f32 {
    return bitcast<f32>(select(~code, code & 0x7fffffffu, (code >> 31u) == 1u));
}

// How far z / w may be from its place on a triangle by rounding: of a sliver, where weights are
// quotients of small numbers, as far as its corners differ. `across` is on the light's picture.
fn noise_of(low: vec2<f32>, high: vec2<f32>, across: f32, depth_range: f32) -> f32 {
    let far = max(max(abs(low.x), abs(low.y)), max(abs(high.x), abs(high.y)));
    let extent = max(high.x - low.x, high.y - low.y);
    return depth_range * min(4e-7 * far * extent / max(across, 1e-37), 1.0);
}
