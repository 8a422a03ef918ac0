//! Tries to refute the bound of normals.
//!
//! The file says that every point of either surface has some point of the other within ε whose
//! normal differs by at most α. For a sample, triangles within ε are looked at: no normal on one
//! of them is nearer to the sample's than the angle to their mean less the widest angle from the
//! mean to a corner. Where even that exceeds α for all of them, the bound is wrong.

use glam::{DVec3, Vec3};
use hlod_compress::Mesh;

use super::distance::Target;

/// The normals of a surface, triangle by triangle as in its [`Target`].
pub(super) struct Normals {
    /// Mean direction, and the widest angle to a corner's, in degrees.
    cones: Vec<(Vec3, f32)>,
}

impl Normals {
    pub(super) fn new<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> Normals {
        let cone = |mesh: &Mesh, t: &[u32; 3]| {
            let corners = t.map(|v| Vec3::from_array(mesh.normals[v as usize].decode()));
            let mean = (corners[0] + corners[1] + corners[2]).normalize_or_zero();
            let widest = if mean == Vec3::ZERO {
                180.0
            } else {
                corners.iter().map(|n| n.angle_between(mean).to_degrees()).fold(0.0, f32::max)
            };
            (mean, widest)
        };
        let cones = meshes.flat_map(|m| m.triangles.iter().map(move |t| cone(m, t))).collect();
        Normals { cones }
    }

    /// No normal of the triangle is nearer to `normal` than this, in degrees.
    fn at_least(&self, triangle: usize, normal: Vec3) -> f32 {
        let (mean, widest) = self.cones[triangle];
        if widest >= 180.0 { 0.0 } else { normal.angle_between(mean).to_degrees() - widest }
    }
}

/// The largest angle, in degrees, that some sample of `mesh` surely has to all normals within
/// `reach` on the other surface. Vertices and centres of triangles are sampled; `enough` is the
/// angle that is allowed, below which no sample is looked into further.
pub(super) fn largest_angle(
    mesh: &Mesh,
    target: &Target,
    normals: &Normals,
    reach: f64,
    enough: f32,
) -> f32 {
    let mut largest = 0.0f32;
    if enough >= 180.0 {
        return largest;
    }
    let mut sample = |p: DVec3, normal: Vec3| {
        let mut least = f32::INFINITY;
        target.within(p.to_array(), reach, |t| {
            least = least.min(normals.at_least(t, normal));
            least <= enough
        });
        // Nothing at all within reach is for the distances to refute.
        if least.is_finite() {
            largest = largest.max(least);
        }
    };
    let at = |v: u32| {
        let p = DVec3::from_array(mesh.positions[v as usize].map(f64::from));
        (p, Vec3::from_array(mesh.normals[v as usize].decode()))
    };
    for t in &mesh.triangles {
        let corners = t.map(at);
        corners.iter().for_each(|&(p, n)| sample(p, n));
        let (p, n) = corners.iter().fold((DVec3::ZERO, Vec3::ZERO), |s, c| (s.0 + c.0, s.1 + c.1));
        if let Some(n) = n.try_normalize() {
            sample(p / 3.0, n);
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use hlod_compress::OctNormal;

    fn triangle(normal: [f32; 3]) -> Mesh {
        Mesh {
            positions: vec![[0, 0, 0], [90, 0, 0], [0, 90, 0]],
            normals: vec![OctNormal::encode(normal); 3],
            colours: Vec::new(),
            scalars: Vec::new(),
            triangles: vec![[0, 1, 2]],
        }
    }

    #[test]
    fn a_known_angle_is_found_and_one_that_is_out_of_reach_is_not() {
        let (sin, cos) = 30f32.to_radians().sin_cos();
        let (flat, tilted) = (triangle([0.0, 0.0, 1.0]), triangle([sin, 0.0, cos]));
        let corners = |m: &Mesh| m.triangles[0].map(|v| m.positions[v as usize].map(f64::from));
        let target = Target::new([corners(&tilted)].into_iter());
        let normals = Normals::new([&tilted].into_iter());
        let angle = largest_angle(&flat, &target, &normals, 1.0, 10.0);
        assert!((angle - 30.0).abs() < 0.2, "{angle}");
        // Within what is allowed, the search stops early.
        assert!(largest_angle(&flat, &target, &normals, 1.0, 31.0) <= 31.0);
        let mut far = flat;
        far.positions.iter_mut().for_each(|p| p[2] += 50);
        assert_eq!(largest_angle(&far, &target, &normals, 1.0, 10.0), 0.0);
    }
}
