//! Quadrics: what a vertex must not lose when it is merged with a neighbour.
//!
//! Planes after Garland & Heckbert, *Surface simplification using quadric error metrics* (1997),
//! weighted by area, so that an error divided by the area is a mean square distance. Attributes
//! after Hoppe, *New quadric metric for simplifying meshes with appearance attributes* (1999):
//! each triangle has, for each attribute, a linear field; what is lost is the squared difference
//! from those fields. Deviation: both are kept apart, so that one sequence of collapses can first
//! heed the attributes and then go on without them.

use glam::{DMat3, DVec3};

/// A symmetric 3 × 3 matrix: xx, xy, xz, yy, yz, zz.
type Symmetric = [f64; 6];

fn outer(v: DVec3, weight: f64) -> Symmetric {
    let w = v * weight;
    [w.x * v.x, w.x * v.y, w.x * v.z, w.y * v.y, w.y * v.z, w.z * v.z]
}

fn times(m: &Symmetric, v: DVec3) -> DVec3 {
    DVec3::new(
        m[0] * v.x + m[1] * v.y + m[2] * v.z,
        m[1] * v.x + m[3] * v.y + m[4] * v.z,
        m[2] * v.x + m[4] * v.y + m[5] * v.z,
    )
}

fn add(to: &mut Symmetric, m: &Symmetric) {
    to.iter_mut().zip(m).for_each(|(a, b)| *a += b);
}

/// `pᵀ A p + 2 bᵀ p + c`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Form {
    a: Symmetric,
    b: DVec3,
    c: f64,
}

impl Form {
    /// The squared value of the linear function `g · p + d`, weighted.
    pub(super) fn add_squared(&mut self, g: DVec3, d: f64, weight: f64) {
        add(&mut self.a, &outer(g, weight));
        self.b += g * (d * weight);
        self.c += d * d * weight;
    }

    pub(super) fn add(&mut self, other: &Form) {
        add(&mut self.a, &other.a);
        self.b += other.b;
        self.c += other.c;
    }

    pub(super) fn at(&self, p: DVec3) -> f64 {
        p.dot(times(&self.a, p) + 2.0 * self.b) + self.c
    }
}

/// What the surroundings of one vertex look like: their planes and the linear fields of their
/// `K` attributes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quadric<const K: usize> {
    /// Area of the surface that this stands for.
    pub(super) area: f64,
    planes: Form,
    /// Sum over attributes of the squared fields.
    fields: Form,
    /// Sum of the fields' gradients.
    gradients: [DVec3; K],
    /// Sum of the fields' constants.
    constants: [f64; K],
}

impl<const K: usize> Default for Quadric<K> {
    fn default() -> Self {
        Quadric {
            area: 0.0,
            planes: Form::default(),
            fields: Form::default(),
            gradients: [DVec3::ZERO; K],
            constants: [0.0; K],
        }
    }
}

/// The normal of the plane through an edge, `p` to `q`, that is upright on its triangle.
pub(super) fn upright([p, q, opposite]: [DVec3; 3]) -> DVec3 {
    let along = q - p;
    along.cross((opposite - p).cross(along)).normalize_or_zero()
}

/// Pulls a place that the planes leave free towards the middle of the edge; relative to area.
const PULL: f64 = 1e-3;

impl<const K: usize> Quadric<K> {
    /// A third of a triangle, for each of its corners; `None` where it has no area.
    pub(super) fn of_triangle(p: [DVec3; 3], attributes: [&[f64; K]; 3]) -> Option<Quadric<K>> {
        let cross = (p[1] - p[0]).cross(p[2] - p[0]);
        let length = cross.length();
        let normal = cross / length;
        if !normal.is_finite() {
            return None;
        }
        let weight = length / 6.0;
        let mut q = Quadric { area: weight, ..Quadric::default() };
        q.planes.add_squared(normal, -normal.dot(p[0]), weight);
        // Gradients of the barycentric coordinates.
        let g1 = (p[2] - p[0]).cross(normal) / length;
        let g2 = normal.cross(p[1] - p[0]) / length;
        for k in 0..K {
            let [s0, s1, s2] = attributes.map(|a| a[k]);
            let gradient = g1 * (s1 - s0) + g2 * (s2 - s0);
            let constant = s0 - gradient.dot(p[0]);
            q.fields.add_squared(gradient, constant, weight);
            q.gradients[k] = gradient * weight;
            q.constants[k] = constant * weight;
        }
        Some(q)
    }

    /// Keeps an open edge where it is: the plane through it, upright on its triangle.
    pub(super) fn add_border(&mut self, edge: [DVec3; 3]) {
        let [p, q, _] = edge;
        let normal = upright(edge);
        self.planes.add_squared(normal, -normal.dot(p), 0.5 * p.distance_squared(q));
    }

    pub(super) fn add(&mut self, other: &Quadric<K>) {
        self.area += other.area;
        self.planes.add(&other.planes);
        self.fields.add(&other.fields);
        for k in 0..K {
            self.gradients[k] += other.gradients[k];
            self.constants[k] += other.constants[k];
        }
    }

    /// Both together.
    pub(super) fn sum(&self, other: &Quadric<K>) -> Quadric<K> {
        let form = |a: &Form, b: &Form| Form {
            a: std::array::from_fn(|i| a.a[i] + b.a[i]),
            b: a.b + b.b,
            c: a.c + b.c,
        };
        Quadric {
            area: self.area + other.area,
            planes: form(&self.planes, &other.planes),
            fields: form(&self.fields, &other.fields),
            gradients: std::array::from_fn(|k| self.gradients[k] + other.gradients[k]),
            constants: std::array::from_fn(|k| self.constants[k] + other.constants[k]),
        }
    }

    /// The place with the least error, near `middle`: the square of `attribute_length` is what a
    /// squared unit of the attributes counts. Coordinates in `fixed` are kept.
    pub(super) fn best_place(
        &self,
        middle: DVec3,
        fixed: [Option<f64>; 3],
        attribute_length: f64,
    ) -> DVec3 {
        let mut a = self.planes.a;
        let mut gradient = times(&self.planes.a, middle) + self.planes.b;
        if attribute_length > 0.0 && self.area > 0.0 {
            let weight = attribute_length * attribute_length;
            let mut fields = self.fields.a;
            let mut slope = times(&self.fields.a, middle) + self.fields.b;
            for k in 0..K {
                let g = self.gradients[k];
                add(&mut fields, &outer(g, -1.0 / self.area));
                slope -= g * ((g.dot(middle) + self.constants[k]) / self.area);
            }
            add(&mut a, &fields.map(|v| v * weight));
            gradient += slope * weight;
        }
        let pull = PULL * self.area.max(f64::MIN_POSITIVE);
        let mut matrix =
            [[a[0] + pull, a[1], a[2]], [a[1], a[3] + pull, a[4]], [a[2], a[4], a[5] + pull]];
        let mut right = (-gradient).to_array();
        for axis in 0..3 {
            let Some(value) = fixed[axis] else { continue };
            let shift = value - middle[axis];
            for row in 0..3 {
                right[row] -= matrix[row][axis] * shift;
                matrix[row][axis] = 0.0;
                matrix[axis][row] = 0.0;
            }
            // Any scale will do; the area keeps the matrix well conditioned.
            matrix[axis][axis] = pull;
            right[axis] = pull * shift;
        }
        let matrix = DMat3::from_cols_array_2d(&matrix);
        let place = middle + matrix.inverse() * DVec3::from_array(right);
        DVec3::from_array(std::array::from_fn(|i| fixed[i].unwrap_or(place[i])))
    }

    /// Mean square distance of the place from the planes.
    pub(super) fn plane_error(&self, place: DVec3) -> f64 {
        self.planes.at(place).max(0.0) / self.area.max(f64::MIN_POSITIVE)
    }

    /// The attributes that fit best at a place.
    pub(super) fn attributes_at(&self, place: DVec3) -> [f64; K] {
        std::array::from_fn(|k| {
            (self.gradients[k].dot(place) + self.constants[k]) / self.area.max(f64::MIN_POSITIVE)
        })
    }

    /// Mean square difference of those attributes from the fields.
    pub(super) fn attribute_error(&self, place: DVec3) -> f64 {
        let explained: f64 = self.attributes_at(place).iter().map(|s| s * s).sum();
        (self.fields.at(place) / self.area.max(f64::MIN_POSITIVE) - explained).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FREE: [Option<f64>; 3] = [None; 3];

    fn corner(of: [DVec3; 3], to: [f64; 3]) -> Quadric<1> {
        Quadric::of_triangle(of, [&[to[0]], &[to[1]], &[to[2]]]).expect("it has an area")
    }

    /// Three faces of a cube meet at one point; errors are known squared distances.
    #[test]
    fn the_best_place_for_three_faces_is_their_corner() {
        let at = |i: usize| DVec3::new(1.0, 2.0, 3.0) + 4.0 * DVec3::AXES[i];
        let origin = DVec3::new(1.0, 2.0, 3.0);
        let mut q = Quadric::default();
        for [i, j] in [[0, 1], [1, 2], [2, 0]] {
            q.add(&corner([origin, at(i), at(j)], [0.0; 3]));
        }
        let place = q.best_place(DVec3::new(2.0, 2.0, 2.0), FREE, 0.0);
        assert!(place.distance(origin) < 0.01, "{place}");
        assert!(q.plane_error(origin) < 1e-12);
        // One unit off one of three equal faces.
        assert!((q.plane_error(origin + DVec3::X) - 1.0 / 3.0).abs() < 1e-9);
        let fixed = q.best_place(DVec3::ZERO, [None, Some(7.0), None], 0.0);
        assert_eq!(fixed.y, 7.0);
    }

    #[test]
    fn a_linear_field_is_reproduced_and_a_step_is_an_error() {
        let p = |x: f64, y: f64| DVec3::new(x, y, 5.0);
        let field = |p: DVec3| 3.0 * p.x - 2.0 * p.y + 1.0;
        let one = [p(0.0, 0.0), p(2.0, 0.0), p(0.0, 2.0)];
        let two = [p(2.0, 0.0), p(2.0, 2.0), p(0.0, 2.0)];
        let mut q = corner(one, one.map(field));
        q.add(&corner(two, two.map(field)));
        let place = p(0.7, 1.3);
        assert!((q.attributes_at(place)[0] - field(place)).abs() < 1e-9);
        assert!(q.attribute_error(place) < 1e-9);
        let mut step = corner(one, [0.0; 3]);
        step.add(&corner(two, [1.0; 3]));
        assert!((step.attributes_at(place)[0] - 0.5).abs() < 1e-9);
        assert!((step.attribute_error(place) - 0.25).abs() < 1e-9);
    }
}
