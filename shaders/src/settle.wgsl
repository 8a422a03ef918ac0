// Soft shadows, last step: sums of covered parts into occlusion. See soften.wgsl.

@group(1) @binding(0) var<storage, read_write> occlusion: array<u32>;
@group(1) @binding(1) var<storage, read> sums: array<i32>;

const HIDDEN: i32 = 65535;

@compute @workgroup_size(8, 8)
fn settle(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.area.zw) {
        return;
    }
    let at = frame.area.xy + id.xy;
    let pixel = number_of(at);
    let summed = clamp(max(sums[4u * pixel], sums[4u * pixel + 1u]), 0, HIDDEN);
    let places = countOneBits(u32(sums[4u * pixel + 2u])) + countOneBits(u32(sums[4u * pixel + 3u]));
    // Surfaces and points hide parts of the light that have nothing to do with each other.
    let covered = summed + (HIDDEN - summed) * i32(places) / 64;
    // Of points that are turned away from the light all of it is hidden already.
    occlusion[pixel] = max(occlusion[pixel], u32(covered));
}
