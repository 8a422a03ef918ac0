//! A frame's light, as shadows need it.

use glam::{DMat4, DVec3, Vec4};

use crate::light_space::{Face, faces};
use crate::passes::{FaceUniforms, FrameUniform, MapPlan, Targets};
use crate::scene::{Light, Shot};
use crate::select::corners;
use crate::shadow_map::{MapProjection, ShadowMap, homography, picture_of};
use crate::traced::{LIGHT_RAYS, Tracer};

/// The light of one frame.
pub(crate) struct Lit {
    /// World space; light space is relative to it.
    centre: DVec3,
    /// Round what is seen, relative to it.
    points: Vec<DVec3>,
    faces: Vec<Face>,
    /// As [`Shot::light_radius`] has it.
    radius: f64,
    /// What rounding may do to positions, world units.
    rounding: f64,
}

/// An arena that is lit.
pub(crate) struct LitPart {
    pub(crate) uniform: FrameUniform,
    pub(crate) world_from_model: DMat4,
}

/// Of positions in f32, relative to how far they are from where they are counted.
const ROUNDING: f64 = 1e-6;

impl Lit {
    /// For what is seen within some points; they, the centre and the light are in world space.
    pub(crate) fn around(points: &[DVec3], centre: DVec3, shot: &Shot) -> Lit {
        let points: Vec<DVec3> = points.iter().map(|p| p - centre).collect();
        let (light, far) = match shot.light {
            Light::Point(position) => (Light::Point(position - centre), position.distance(centre)),
            directional => (directional, 0.0),
        };
        let reach = points.iter().map(|p| p.length()).fold(0.0, f64::max);
        Lit {
            centre,
            faces: faces(light, shot.camera.axes()[0], &points),
            points,
            radius: shot.light_radius(),
            rounding: ROUNDING * (reach + far),
        }
    }

    /// How shadow maps look at each of the light's faces. Whatever casts lies in `bounds`, world space.
    pub(crate) fn map_plan(
        &self,
        map: ShadowMap,
        bounds: impl Iterator<Item = (DVec3, DVec3)>,
        shot: &Shot,
        targets: &Targets,
    ) -> MapPlan {
        let (width, height) = targets.window().picture();
        let seen = (&shot.camera, f64::from(width) / f64::from(height));
        let of_face = |face| homography(map.projection, face, seen, self.centre, &self.points);
        let placed = bounds.flat_map(|(low, high)| corners(low, high).map(|p| p - self.centre));
        let all: Vec<DVec3> = placed.collect();
        let reach = match shot.light {
            // And a little more, for nodes reach beyond by their errors.
            Light::Directional(_) => 1.5 * all.iter().map(|p| p.length()).fold(0.0, f64::max),
            Light::Point(_) => self.faces.first().map_or(0.0, |face| face.near),
        };
        let homographies = self.faces.iter().map(of_face).collect();
        let picture = |face: &Face| picture_of(face, &all);
        let fixed = (map.projection == MapProjection::Plain)
            .then(|| self.faces.iter().map(picture).collect());
        MapPlan { map, homographies, fixed, reach: reach as f32 }
    }

    /// For each of the light's faces, what shaders know of it and of these arenas.
    pub(crate) fn face_uniforms(&self, parts: &[LitPart]) -> Vec<FaceUniforms> {
        let receiver = |face: &Face, part: &LitPart| {
            let relative = DMat4::from_translation(-self.centre) * part.world_from_model;
            FrameUniform {
                light_from_model: (face.light_from_world * relative).as_mat4(),
                shadow: Vec4::new(1.0, face.near as f32, face.limit as f32, self.radius as f32),
                bias: Vec4::new(self.rounding as f32, 0.0, 0.0, 0.0),
                ..part.uniform
            }
        };
        let caster = |face: &Face, part: &LitPart| {
            let mut uniform = receiver(face, part);
            uniform.bias.z = 1.0;
            uniform
        };
        let of_face = |face: &Face| FaceUniforms {
            receivers: parts.iter().map(|part| receiver(face, part)).collect(),
            casters: parts.iter().map(|part| caster(face, part)).collect(),
        };
        self.faces.iter().map(of_face).collect()
    }

    /// What rays find hidden, for [`crate::passes::DrawnShadow::Traced`].
    pub(crate) fn hidden_by<'a>(
        &'a self,
        tracer: &'a Tracer,
        targets: &'a Targets,
    ) -> impl Fn(usize, &[Option<[f32; 3]>]) -> Vec<u32> + 'a {
        self.hidden_by_rays(tracer, targets, LIGHT_RAYS)
    }

    /// The same with so many rays to a light that is a disc.
    pub(crate) fn hidden_by_rays<'a>(
        &'a self,
        tracer: &'a Tracer,
        targets: &'a Targets,
        rays: u32,
    ) -> impl Fn(usize, &[Option<[f32; 3]>]) -> Vec<u32> + 'a {
        let rays = if self.radius > 0.0 { rays } else { 1 };
        move |face, points| {
            let (window, width) = (targets.window(), targets.width() as usize);
            let number = |i: usize| {
                let (x, y) = (window.x as usize + i % width, window.y as usize + i / width);
                y * window.picture_width as usize + x
            };
            tracer.occlusion(points, &number, rays, &|p, on_disc| {
                self.faces[face].world(p.map(f64::from), on_disc * self.radius)
            })
        }
    }
}
