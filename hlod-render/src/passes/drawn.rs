//! What a frame hands to the passes: uniforms, ranges of triangles, and what its shadows are drawn with.

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec4};

use super::{DrawnPart, MapPlan, Rectangle};
use crate::clip::PLANES_MAX;

/// What shaders know of a frame, once for each arena; see `Frame` in `shared.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct FrameUniform {
    /// Model space → clip space.
    pub clip_from_model: Mat4,
    /// Model space → world space relative to the model's centre.
    pub world_from_model: Mat4,
    /// Eye (w = 1) or direction towards it (w = 0).
    pub eye: Vec4,
    /// Light (w = 1) or direction towards it (w = 0).
    pub light: Vec4,
    /// Linear albedo and highlight.
    pub material: Vec4,
    /// Ambient share; colours; backs magenta; backs lit like fronts.
    pub shading: Vec4,
    /// Model space → light space.
    pub light_from_model: Mat4,
    /// Whether occlusion is known; of a light's face: least w, largest tangent or 0.
    pub shadow: Vec4,
    /// What rounding may do to positions, world space; whether parts of a picture must agree; whether what is drawn casts
    /// shadows; whether cut faces are painted.
    pub bias: Vec4,
    /// Points: model lengths of clip.x, of clip.y, and of clip.w or, in parallel views, clip.z; and of a
    /// lattice step.
    pub points: Vec4,
    /// 1 + which kept number is painted, or 0; the code that is 0 on the map, and what it rises by from one code
    /// to the next.
    pub scalar: Vec4,
    /// How much contrast follows the bends of the surface; within how many pixels; whether they are painted.
    pub relief: Vec4,
    /// Direction towards a lamp that shines within a cone, and the cosine at its side: see [`crate::scene::Spot`].
    pub spot: Vec4,
    /// The part of the picture in which anything is seen: first pixel, width, height.
    pub area: [u32; 4],
    /// Width, height, number of the arena's first triangle, and of its first chunk.
    pub size: [u32; 4],
    /// The part of the picture that is drawn: its first pixel, its width and height.
    pub window: [u32; 4],
    /// Planes that cut the statue open: see [`crate::clip`].
    pub clip: [Vec4; PLANES_MAX],
    /// Linear light of their cut faces.
    pub clip_colours: [Vec4; PLANES_MAX],
}

/// Uniforms lie this far apart in their buffer: a multiple of 256 is what every adapter allows.
pub(super) const UNIFORM_STRIDE: u64 = 512;

/// A range of an arena's triangles to draw.
#[derive(Debug, Clone)]
pub struct Range {
    /// Which uniform, and so which arena.
    pub uniform: usize,
    /// Triangles of the arena, or points, which are counted like them.
    pub triangles: std::ops::Range<u32>,
    /// Of points, which of their radii they have: see [`crate::loader::PointPrefix`].
    pub points_level: Option<u32>,
    /// Whether backs can be left to the rasteriser to drop.
    pub cull_backs: bool,
    /// How far they may be from the scan's, world units; for shadows.
    pub error: f32,
}

/// Which pipeline of fixed function draws a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum RangePipeline {
    TwoSided,
    Culled,
    Splats,
}

impl Range {
    pub(super) fn pipeline(&self) -> RangePipeline {
        match (self.points_level, self.cull_backs) {
            (Some(_), _) => RangePipeline::Splats,
            (None, true) => RangePipeline::Culled,
            (None, false) => RangePipeline::TwoSided,
        }
    }
}

/// What a frame draws.
pub(crate) struct Drawn<'a> {
    pub(crate) ranges: &'a [Range],
    /// The nodes that they are of, where pictures are to explain them.
    pub(crate) parts: &'a [DrawnPart],
    /// Nothing is seen outside.
    pub(crate) area: Rectangle,
    pub(crate) shadow: DrawnShadow<'a>,
}

impl<'a> Drawn<'a> {
    /// The ranges in the order in which they are drawn: one pipeline's next to one another.
    pub(super) fn sorted_ranges(&self) -> Vec<&'a Range> {
        let mut ranges: Vec<&Range> = self.ranges.iter().collect();
        ranges.sort_by_key(|r| (r.uniform, r.pipeline(), r.triangles.start));
        ranges
    }
}

/// What a frame's shadows are drawn with.
pub(crate) enum DrawnShadow<'a> {
    None,
    /// Ranges to cast, by the numbers of the receivers' uniforms, and the light's faces.
    Cast {
        ranges: &'a [Range],
        faces: &'a [FaceUniforms],
        /// Of a light that is a disc.
        is_soft: bool,
        /// With maps.
        map: Option<&'a MapPlan>,
    },
    /// For each of the light's faces, what is hidden of points in light space; `None` for pixels
    /// without one.
    Traced {
        faces: &'a [FaceUniforms],
        hidden: &'a Hidden<'a>,
    },
}

impl<'a> DrawnShadow<'a> {
    /// The light's faces.
    pub(super) fn faces(&self) -> &'a [FaceUniforms] {
        match *self {
            DrawnShadow::None => &[],
            DrawnShadow::Cast { faces, .. } | DrawnShadow::Traced { faces, .. } => faces,
        }
    }

    /// What casts, in the order in which it is drawn.
    pub(super) fn casters(&self) -> Vec<&'a Range> {
        let DrawnShadow::Cast { ranges, .. } = *self else { return Vec::new() };
        let mut casters: Vec<&Range> = ranges.iter().collect();
        casters.sort_by_key(|r| (r.uniform, r.cull_backs, r.triangles.start));
        casters
    }
}

/// From a face's number and a point for each pixel, to occlusion in 65535ths.
pub(crate) type Hidden<'a> = dyn Fn(usize, &[Option<[f32; 3]>]) -> Vec<u32> + 'a;

/// What differs from a frame's uniforms where the light looks at the scene.
pub(crate) struct FaceUniforms {
    /// To place points: one for each of the frame's.
    pub(crate) receivers: Vec<FrameUniform>,
    /// To draw what casts.
    pub(crate) casters: Vec<FrameUniform>,
}
