//! Cones that hold all normals of a node's triangles.

use glam::DVec3;
use hlod_compress::{Mesh, NormalCone, OctNormal};

/// Collects directions and finds a cone that holds them all.
///
/// Only which bins of a coarse direction grid are hit is kept, so merging children costs the same
/// at every level, and a bin's corners stand for whatever fell into it.
#[derive(Debug, Clone)]
pub(crate) struct ConeBuilder {
    /// Bit b is set where some normal lies in direction bin b.
    bins: [u64; BINS / 64],
}

/// Bins along each edge of a face of the direction cube.
const SIDE: usize = 16;
const BINS: usize = 6 * SIDE * SIDE;

impl ConeBuilder {
    /// Of no directions.
    pub(crate) fn nothing() -> ConeBuilder {
        ConeBuilder { bins: [0; BINS / 64] }
    }

    pub(crate) fn of_mesh(mesh: &Mesh) -> ConeBuilder {
        let mut cone = ConeBuilder::nothing();
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
            let normal = (b - a).cross(c - a);
            if normal != DVec3::ZERO {
                let bin = bin_of(normal);
                cone.bins[bin / 64] |= 1 << (bin % 64);
            }
        }
        cone
    }

    /// What is kept of the normals, to be stored.
    pub(crate) fn bins(&self) -> &[u64; BINS / 64] {
        &self.bins
    }

    pub(crate) fn from_bins(bins: [u64; BINS / 64]) -> ConeBuilder {
        ConeBuilder { bins }
    }

    pub(crate) fn merge(&mut self, other: &ConeBuilder) {
        self.bins.iter_mut().zip(other.bins).for_each(|(a, b)| *a |= b);
    }

    /// The cone round the mean of the bins' directions that holds all corners of all set bins.
    pub(crate) fn finish(&self) -> NormalCone {
        let set = || (0..BINS).filter(|b| self.bins[b / 64] >> (b % 64) & 1 == 1);
        let mean: DVec3 = set().map(|b| bin_corners(b).into_iter().sum::<DVec3>()).sum();
        let axis = OctNormal::encode(mean.normalize_or_zero().as_vec3().to_array());
        let direction = DVec3::from_array(axis.decode().map(f64::from)).normalize_or_zero();
        // A bin is a spherical quadrilateral smaller than a hemisphere: it lies inside a cone
        // (of less than 90°) that holds its corners.
        let cosine =
            set().flat_map(bin_corners).map(|corner| corner.dot(direction)).fold(1.0, f64::min);
        if cosine <= 1e-5 || mean == DVec3::ZERO {
            return NormalCone::ALL;
        }
        // 1e-5 covers the f32 rounding of whoever decodes the axis.
        NormalCone { axis, cosine: cosine as f32 - 1e-5 }
    }
}

/// Bins are squares on the faces of the cube [−1, 1]³.
fn bin_of(direction: DVec3) -> usize {
    let a = direction.abs();
    let axis = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    let major = direction[axis];
    let cell = |value: f64| {
        let t = (value / major.abs() + 1.0) / 2.0 * SIDE as f64;
        (t as usize).min(SIDE - 1)
    };
    let face = 2 * axis + usize::from(major < 0.0);
    (face * SIDE + cell(direction[(axis + 1) % 3])) * SIDE + cell(direction[(axis + 2) % 3])
}

fn bin_corners(bin: usize) -> [DVec3; 4] {
    let (face, u, v) = (bin / (SIDE * SIDE), bin / SIDE % SIDE, bin % SIDE);
    let (axis, sign) = (face / 2, if face % 2 == 1 { -1.0 } else { 1.0 });
    [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(du, dv)| {
        let mut d = DVec3::ZERO;
        d[axis] = sign;
        d[(axis + 1) % 3] = (u + du) as f64 / SIDE as f64 * 2.0 - 1.0;
        d[(axis + 2) % 3] = (v + dv) as f64 / SIDE as f64 * 2.0 - 1.0;
        d.normalize()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_cone_holds_every_triangle_normal(
            positions in prop::collection::vec(prop::array::uniform3(0..1000i32), 3..12),
        ) {
            let n = positions.len() as u32;
            let mesh = Mesh {
                normals: vec![OctNormal::default(); positions.len()],
                positions,
                colours: Vec::new(),
                scalars: Vec::new(),
                triangles: (0..n - 2).map(|i| [i, i + 1, i + 2]).collect(),
            };
            let cone = ConeBuilder::of_mesh(&mesh).finish();
            let axis = DVec3::from_array(cone.axis.decode().map(f64::from));
            for t in &mesh.triangles {
                let [a, b, c] = t.map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
                if let Some(normal) = (b - a).cross(c - a).try_normalize() {
                    prop_assert!(cone.cosine == -1.0 || normal.dot(axis) >= f64::from(cone.cosine) - 1e-6);
                }
            }
        }
    }

    #[test]
    fn opposite_normals_have_no_cone() {
        let mesh = Mesh {
            positions: vec![[0, 0, 0], [9, 0, 0], [0, 9, 0]],
            normals: vec![OctNormal::default(); 3],
            colours: Vec::new(),
            scalars: Vec::new(),
            triangles: vec![[0, 1, 2], [0, 2, 1]],
        };
        assert_eq!(ConeBuilder::of_mesh(&mesh).finish(), NormalCone::ALL);
    }
}
