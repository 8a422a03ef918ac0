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
// samples.wgsl: place: points → samples · measure: their bounds · lay_out: bounds → grid · bin: how many samples cells
// have · sum_up, scan, number: where those of each begin · sort: samples cell by cell · order: the deepest first. occlude.wgsl: occlude: triangles
// against cells · occlude_tiles: what is left of large ones.

struct Sample {
    // On the light's picture.
    x: f32,
    y: f32,
    // z / w that is nearer hides it, by what may be wrong of the sample;
    depth: f32,
    // and by so much more for each unit of length that what hides it may be wrong.
    slack: f32,
    // Pixel by pixel: 1 + the number of its cell; before they are binned UNBINNED, or why it has no place in one: ABSENT,
    // or TURNED away from the light. Sorted by cells: its pixel.
    place: u32,
}

const UNBINNED: u32 = 0u;
const TURNED: u32 = 0xfffffffeu;
const ABSENT: u32 = 0xffffffffu;

// Cells along the side of a block, and of its quarters.
const BLOCK: i32 = 8;
const QUARTER: i32 = 4;
const CELLS_OF_BLOCK: i32 = 64;
const CELLS_OF_QUARTER: i32 = 16;

// Numbers that are kept of a block: of its 64 cells where they begin and how deep they are, how deep it is and its quarters
// are, how many samples come before these, and STEPS + 1 more for their order.
const NUMBERS_OF_BLOCK: i32 = 173;
// By depth, samples of a quarter are told apart by so many steps.
const STEPS: i32 = 8;

// Cells are numbered block by block, of a block quarter by quarter: what is near each other lies near each other.
fn number_of_cell(cell: vec2<i32>, blocks_in_row: i32) -> i32 {
    let block = cell / BLOCK;
    let within = cell % BLOCK;
    let quarter = within / QUARTER;
    let last = within % QUARTER;
    return (block.y * blocks_in_row + block.x) * CELLS_OF_BLOCK
        + (quarter.y * 2 + quarter.x) * CELLS_OF_QUARTER
        + last.y * QUARTER + last.x;
}

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
