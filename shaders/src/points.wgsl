// Points: each stands for a ball, and what it was made from lies within. Small ones are drawn as balls,
// so that wherever a line of sight meets what they stand for a point is drawn; where balls would be wide
// enough to show, discs in the surface are.

// Wider than so many pixels, points are discs.
const DISC_FROM: f32 = 2.0;
// No picture is larger.
const PICTURE_MAX: f32 = 65536.0;

struct Point {
    // Model space.
    centre: vec3<f32>,
    radius: f32,
    // Right, up and away from the eye, in model space's unit; in parallel views z counts from the point.
    view: vec3<f32>,
    // The same axes.
    normal: vec3<f32>,
    // Pixels.
    extent: f32,
    // clip.z and clip.w.
    clip: vec2<f32>,
}

// Not for `if`: see `Frame`.
fn perspective() -> bool {
    return frame.eye.w > 0.5;
}

// The axes of `view` in model space.
fn view_axes() -> mat3x3<f32> {
    let m = frame.clip_from_model;
    let towards = select(
        -vec3(m[0].z, m[1].z, m[2].z),
        vec3(m[0].w, m[1].w, m[2].w),
        perspective(),
    );
    return mat3x3<f32>(
        vec3(m[0].x, m[1].x, m[2].x) * frame.points.x,
        vec3(m[0].y, m[1].y, m[2].y) * frame.points.y,
        towards * frame.points.z,
    );
}

fn point_of(number: u32, level: u32) -> Point {
    let v = vertices[indices[3u * number] & VERTEX];
    let centre = vec3(v.x, v.y, v.z);
    let radius = radius_of(number, level);
    let clip = frame.clip_from_model * vec4(centre, 1.0);
    let depth = select(0.0, clip.w * frame.points.z, perspective());
    let view = vec3(clip.xy * frame.points.xy, depth);
    let normal = transpose(view_axes()) * octahedral(v.normal);
    // As far from the middle as the ball is seen at most: lines of sight spread.
    let across = select(1.0, depth, perspective());
    let near = max(across - select(0.0, radius, perspective()), 1e-20);
    let stretch = 1.0 + select(0.0, dot(view.xy, view.xy) / (across * across), perspective());
    let pixels = 0.5 * f32(frame.size.y) / frame.points.y * select(1.0, frame.points.z, perspective());
    let extent = min(pixels * radius * stretch / near, PICTURE_MAX);
    return Point(centre, radius, view, normal, extent, clip.zw);
}

struct Splat {
    covered: bool,
    // Reversed, as in the depth buffer.
    depth: f32,
    // From the point's centre to what is seen, axes of `view`.
    offset: vec3<f32>,
    // Of the side that is seen; the same axes.
    normal: vec3<f32>,
}

// What a line of sight through a pixel's place meets of a point.
fn splat_at(p: Point, pixel: vec2<f32>) -> Splat {
    let ndc = (pixel / vec2<f32>(frame.size.xy) * 2.0 - 1.0) * vec2(1.0, -1.0);
    // From the point's centre to where the line of sight is at its depth.
    let through = vec3(ndc * frame.points.xy / frame.points.z, 1.0);
    let direction = select(vec3(0.0, 0.0, 1.0), through, perspective());
    let beside = select(
        vec3(ndc * frame.points.xy - p.view.xy, 0.0),
        vec3(through.xy * p.view.z - p.view.xy, 0.0),
        perspective(),
    );
    // Where it meets the surface's plane; never farther than the ball allows.
    let facing = dot(p.normal, direction);
    let met = -dot(p.normal, beside) / select(facing, 1e-6, abs(facing) < 1e-6);
    let along = clamp(met, -p.radius, p.radius);
    let offset = beside + along * direction;
    let passing = dot(beside, beside) - pow(dot(beside, direction), 2.0) / dot(direction, direction);
    let is_disc = p.extent > DISC_FROM;
    let apart = select(passing, dot(beside + met * direction, beside + met * direction), is_disc);
    let limit = p.radius * p.radius;
    // Between points that overlap the nearer middle wins.
    let depth_along = along + 0.5 * p.radius * clamp(passing / limit, 0.0, 1.0);
    let depth = select(
        p.clip.x - depth_along / frame.points.z,
        p.clip.x / (p.clip.y + depth_along / frame.points.z),
        perspective(),
    );
    // Normals of scanned points are not exact: where one that grazes the line of sight turns away
    // from the eye, another sign would be another light. Mirrored, it hardly moves.
    let sight = normalize(direction);
    let normal = p.normal - 2.0 * max(dot(p.normal, sight), 0.0) * sight;
    return Splat(apart <= limit, depth, offset, normal);
}

// Where the middle of a point is in the picture, in pixels.
fn pixel_of_point(p: Point) -> vec2<f32> {
    let size = vec2<f32>(frame.size.xy);
    let ndc = p.view.xy / frame.points.xy * select(1.0, frame.points.z / p.view.z, perspective());
    return (ndc * vec2(0.5, -0.5) + 0.5) * size;
}

// One of three corners of a triangle that holds all that a point may cover, clip space.
fn corner_round_point(p: Point, corner: u32) -> vec4<f32> {
    if p.clip.y <= 0.0 || p.clip.x > p.clip.y {
        // Behind the eye, or nearer than the near plane: nowhere.
        return vec4(2.0, 2.0, 0.5, 1.0);
    }
    let at = vec2(f32(corner == 1u), f32(corner == 2u)) * 4.0 - 1.0;
    let pixel = pixel_of_point(p) + at * (p.extent + 1.0);
    let ndc = (pixel / vec2<f32>(frame.size.xy) * 2.0 - 1.0) * vec2(1.0, -1.0);
    return in_window(vec4(ndc, 0.5, 1.0));
}
