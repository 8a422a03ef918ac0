//! Ground truth for shadows: rays against the scan's own triangles, on the processor.

use glam::{DVec2, DVec3, Vec3A};
use hlod_compress::{PageContent, RepresentationKind, decode_page};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::Ray;
use obvhs::{Boundable, BvhBuildParams};
use rayon::prelude::*;

use crate::error::RenderError;
use crate::model::Model;
use crate::source::open_local;

/// Occlusion of a point from which nothing of the light is seen; `HIDDEN` in `visible.wgsl`.
pub const HIDDEN: u32 = 65_535;

/// A hierarchy of boxes takes about 150 bytes a triangle: 50 million are 7.5 GB.
const TRIANGLES_MAX: u64 = 50_000_000;

/// All triangles of some models' leaves, and squares for their points, relative to the first one's centre.
pub struct Tracer {
    bvh: Bvh2,
    /// In the order of the hierarchy.
    triangles: Vec<Corners>,
}

/// From points in light space and on the light's disc to the first one's place, the way to the second,
/// and how many times that leads there.
type WayToLight<'a> = dyn Fn(&[f32; 3], DVec2) -> (DVec3, DVec3, f64) + Sync + 'a;

/// Rays to a light that is a disc.
pub(crate) const LIGHT_RAYS: u32 = 256;

/// A triangle; boxes of the hierarchy are in f32, and rounded outwards.
#[derive(Clone, Copy)]
struct Corners([DVec3; 3]);

/// Boxes grow by this share of their coordinates, so that rounding loses no ray.
const ROUNDING: f32 = 4.0 * f32::EPSILON;

impl Boundable for Corners {
    fn aabb(&self) -> Aabb {
        let [a, b, c] = self.0.map(|p| p.as_vec3a());
        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
        let slack = Vec3A::splat(ROUNDING * min.abs().max(max.abs()).max_element());
        Aabb::new(min - slack, max + slack)
    }
}

impl Tracer {
    /// Reads all leaves.
    ///
    /// # Errors
    /// When a file is damaged, or there are too many triangles to hold.
    pub fn load(models: &[Model]) -> Result<Tracer, RenderError> {
        let centre = models
            .first()
            .map_or(DVec3::ZERO, |m| m.world_from_model().transform_point3(DVec3::ZERO));
        let in_model = |m: &Model| m.header().triangles_input + 2 * m.header().points_input;
        let count: u64 = models.iter().map(in_model).sum();
        if count > TRIANGLES_MAX {
            return Err(RenderError::Usage(format!(
                "rays are traced against all {count} triangles: no more than {TRIANGLES_MAX} fit; \
                 try --shadow hard"
            )));
        }
        let mut triangles = Vec::new();
        for model in models {
            let format = RenderError::format(model.path());
            let file = open_local(model.path())?;
            let lattice = file.header().lattice;
            // Where this model is placed, were it not at its own coordinates.
            let own = DVec3::from_array(lattice.origin)
                + DVec3::splat(f64::from(lattice.root_units) / 2.0 * lattice.step);
            let nodes = file.read_skeleton().map_err(&format)?;
            for node in nodes.iter().filter(|n| n.is_leaf()) {
                let Some(source) = node.representation(RepresentationKind::Source) else {
                    continue;
                };
                let page = file.read_page(source.page).map_err(&format)?;
                let PageContent { mesh, points } = decode_page(&page).map_err(&format)?;
                let place = |p: [i32; 3]| {
                    let source = DVec3::from_array(lattice.position(p));
                    model.world_from_model().transform_point3(source - own) - centre
                };
                let corner = |v: u32| place(mesh.positions[v as usize]);
                triangles.extend(mesh.triangles.iter().map(|t| Corners(t.map(corner))));
                let scale = model.world_from_model().x_axis.truncate().length() * lattice.step;
                for i in 0..points.len() {
                    let normal = DVec3::from_array(points.normals[i].decode().map(f64::from));
                    let normal = model.world_from_model().transform_vector3(normal).normalize();
                    let radius = points.radii[i].steps() * scale;
                    triangles.extend(square(place(points.positions[i]), normal, radius));
                }
            }
        }
        Ok(Tracer::new(triangles))
    }

    /// Of triangles relative to the centre.
    pub(crate) fn of(triangles: impl Iterator<Item = [DVec3; 3]>) -> Tracer {
        Tracer::new(triangles.map(Corners).collect())
    }

    fn new(triangles: Vec<Corners>) -> Tracer {
        let mut time = Default::default();
        let bvh = build_bvh2(&triangles, BvhBuildParams::medium_build(), &mut time);
        let triangles = bvh.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        Tracer { bvh, triangles }
    }

    /// Whether anything lies on the way from a point, relative to the centre: that far along it.
    pub fn is_hidden(&self, point: DVec3, way: DVec3, length: f64) -> bool {
        let ray = Ray::new(point.as_vec3a(), way.as_vec3a(), 0.0, length as f32);
        !self.bvh.ray_traverse_miss(ray, |_, i| match meets(point, way, &self.triangles[i].0) {
            Some(t) if t < length => t as f32,
            _ => f32::INFINITY,
        })
    }

    /// For each point how much is hidden of a light; `way` gives its place, the way to a point of the
    /// light's disc of radius 1, and how many times that leads there. `rays` is 1 for a light without
    /// extent; otherwise they lie on a spiral (Vogel 1979) that is turned from
    /// point to point by their `number`, which is the same in whatever part of a picture they are seen.
    pub(crate) fn occlusion(
        &self,
        points: &[Option<[f32; 3]>],
        number: &(dyn Fn(usize) -> usize + Sync),
        rays: u32,
        way: &WayToLight<'_>,
    ) -> Vec<u32> {
        const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
        let one = |(i, point): (usize, &Option<[f32; 3]>)| {
            let Some(point) = point else { return 0 };
            let turn = (number(i) as f64 * 0.618_033_988_749_895).fract() * std::f64::consts::TAU;
            let hidden = (0..rays).filter(|&k| {
                let radius = ((f64::from(k) + 0.5) / f64::from(rays)).sqrt();
                let on_disc = DVec2::from_angle(f64::from(k) * GOLDEN_ANGLE + turn) * radius;
                let on_disc = if rays == 1 { DVec2::ZERO } else { on_disc };
                let (place, way, length) = way(point, on_disc);
                self.is_hidden(place, way, length)
            });
            (hidden.count() as u32 * HIDDEN).div_ceil(rays)
        };
        points.par_iter().enumerate().map(one).collect()
    }
}

/// A square as large as the disc that a point is drawn as.
fn square(centre: DVec3, normal: DVec3, radius: f64) -> [Corners; 2] {
    let half = radius * std::f64::consts::PI.sqrt() / 2.0;
    let (u, v) = normal.any_orthonormal_pair();
    let corner = |a: f64, b: f64| centre + half * (a * u + b * v);
    let [p, q, r, s] = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    [Corners([p, q, r]), Corners([p, r, s])]
}

/// How far along the way a triangle lies, in multiples of it. Edges that two triangles share come out
/// with opposite signs, so that no ray passes between them.
fn meets(origin: DVec3, way: DVec3, corners: &[DVec3; 3]) -> Option<f64> {
    let [a, b, c] = corners.map(|p| p - origin);
    let weights = [b.cross(c), c.cross(a), a.cross(b)].map(|n| n.dot(way));
    let inside = weights.iter().all(|w| *w >= 0.0) || weights.iter().all(|w| *w <= 0.0);
    let sum: f64 = weights.iter().sum();
    if !inside || sum == 0.0 {
        return None;
    }
    let point = (a * weights[0] + b * weights[1] + c * weights[2]) / sum;
    let t = point.dot(way) / way.length_squared();
    (t > 0.0).then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_meet_what_is_in_their_way_and_nothing_else() {
        // A square at z = 1 of two triangles, seen from below.
        let p = |x: f64, y: f64| DVec3::new(x, y, 1.0);
        let tracer = Tracer::new(vec![
            Corners([p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0)]),
            Corners([p(0.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)]),
        ]);
        let up = |x: f64, y: f64, z: f64| tracer.is_hidden(DVec3::new(x, y, z), DVec3::Z, 10.0);
        assert!(up(0.25, 0.5, 0.0) && up(0.9, 0.1, -3.0));
        // On the edge that both share.
        assert!((1..100).all(|i| up(f64::from(i) / 100.0, f64::from(i) / 100.0, 0.0)));
        assert!(!up(1.1, 0.5, 0.0) && !up(0.5, 0.5, 1.5), "beside, above");
        // A light between the point and the square.
        assert!(!tracer.is_hidden(DVec3::new(0.5, 0.2, 0.0), DVec3::Z, 0.9));
        assert!(tracer.is_hidden(DVec3::new(0.5, 0.2, 0.0), DVec3::Z * 2.0, 0.9));
    }
}
