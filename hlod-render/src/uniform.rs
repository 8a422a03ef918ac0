//! What shaders are told of a frame.

use glam::{DMat4, DVec2, Mat4, Vec4};
use hlod_compress::Header;

use crate::passes::{FrameUniform, Targets};
use crate::scene::{Light, Paint, Shadow, Shot, Spot};

/// What shaders know of a frame and one arena of a model.
pub(crate) fn uniform(
    world_from_model: DMat4,
    has_colours: bool,
    shot: &Shot,
    targets: &Targets,
    first_identity: u32,
) -> FrameUniform {
    let window = targets.window();
    let (width, height) = window.picture();
    let aspect = f64::from(width) / f64::from(height);
    // Shading happens relative to the model's centre: f32 would not do far from the origin.
    let centre = world_from_model.transform_point3(glam::DVec3::ZERO);
    let relative = DMat4::from_translation(-centre) * world_from_model;
    let parallel = matches!(shot.camera.projection, crate::camera::Projection::Orthographic { .. });
    let eye = if parallel {
        shot.camera.axes()[2].as_vec3().extend(0.0)
    } else {
        (shot.camera.eye - centre).as_vec3().extend(1.0)
    };
    let light = match shot.light {
        Light::Directional(direction) => direction.normalize_or_zero().as_vec3().extend(0.0),
        Light::Point(position) => (position - centre).as_vec3().extend(1.0),
    };
    let flag = |on: bool| f32::from(u8::from(on));
    // Samples move one way, the picture the other.
    let offset = shot.sample_offset_px * DVec2::new(-2.0, 2.0)
        / DVec2::new(f64::from(width), f64::from(height));
    let clip_from_model = shot.camera.clip_from_model(world_from_model, aspect, offset);
    let clip = shot.clip.uniform(&clip_from_model, &world_from_model);
    FrameUniform {
        clip_from_model,
        world_from_model: relative.as_mat4(),
        eye,
        light,
        material: shot.material.albedo.extend(shot.material.highlight),
        light_from_model: Mat4::IDENTITY,
        shadow: Vec4::new(flag(shot.shadow != Shadow::None), 0.0, 0.0, 0.0),
        bias: Vec4::new(0.0, flag(window.is_part), 0.0, 0.0),
        points: points_uniform(&clip_from_model, parallel, 0.0),
        scalar: Vec4::ZERO,
        relief: Vec4::new(
            shot.enhance.strength,
            shot.enhance.radius_px,
            flag(shot.paint == Paint::Curvature),
            0.0,
        ),
        shading: Vec4::new(shot.material.ambient, flag(has_colours), flag(shot.backs_magenta), 1.0),
        spot: Spot::uniform(shot.spot),
        // Known when all that is seen is.
        area: [0; 4],
        size: [width, height, first_identity, 0],
        window: [window.x, window.y, targets.width(), targets.height()],
        clip: clip.planes,
        clip_colours: clip.colours,
    }
}

/// Which number is painted, and how its codes become 0 to 1, or that directions are: see `Frame` in `shared.wgsl`.
pub(crate) fn scalar(paint: Paint, header: &Header) -> Vec4 {
    if paint == Paint::Normals {
        return Vec4::new(0.0, 0.0, 0.0, 1.0);
    }
    let Paint::Scalar(k) = paint else { return Vec4::ZERO };
    let Some((_, range)) = header.scalars().nth(k.into()) else { return Vec4::ZERO };
    // Of equal numbers the colour is that of the least.
    let steps = range.codes.saturating_sub(1).max(1);
    Vec4::new(1.0 + f32::from(k), 1.0, 1.0 / f32::from(steps), 0.0)
}

/// Model lengths of a unit of clip.x, of clip.y, and of clip.w or, in parallel views, clip.z; and of a
/// lattice step.
pub(crate) fn points_uniform(clip_from_model: &Mat4, parallel: bool, step: f32) -> Vec4 {
    let row = |i: usize| 1.0 / clip_from_model.row(i).truncate().length();
    Vec4::new(row(0), row(1), row(if parallel { 2 } else { 3 }), step)
}
