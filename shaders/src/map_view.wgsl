// How one face's shadow map looks at the scene: see map.wgsl.

struct MapView {
    // Light space's (x, y, w) → the map's plane; keeps what turns to the left turning to the left.
    homography: mat3x3<f32>,
    // Texels of a side.
    size: i32,
    // How far what casts may be from the scan's, world space.
    error: f32,
    // By how much its third row may differ between visible points.
    spread_max: f32,
    // Longest texel in pixels that is not denied.
    texel_max: f32,
    // What of its plane the picture shows.
    low: vec2<f32>,
    high: vec2<f32>,
    // Of parallel light, how far anything is from the middle of light space; of lamps how near to them casts.
    reach: f32,
    // 1 where it had to be uniform.
    is_fallback: u32,
    // 1 where it is not fitted to what is visible.
    is_fixed: u32,
}

// Depth in the map: 1 is near, 0 is nothing. Of lamps it is the nearest distance that casts ÷ the distance, so that
// it has the precision of f32 at every distance.
fn map_depth(z: f32, w: f32, reach: f32) -> f32 {
    return select(0.5 - 0.5 * z / reach, reach / w, frame.light.w > 0.5);
}

// The same in light space: z / w.
fn light_depth(depth: f32, reach: f32) -> f32 {
    return select((1.0 - 2.0 * depth) * reach, -depth / reach, frame.light.w > 0.5);
}
