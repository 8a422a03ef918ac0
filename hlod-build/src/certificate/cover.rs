//! Shows that a surface lies above all of one triangle, without searching for closest points.
//!
//! The other surface's triangles are projected along the triangle's normal. Starting from some of
//! them, their neighbours are visited across every edge whose projection meets the triangle, so
//! no edge over the triangle has a visited triangle on one side only. Then every point of the
//! triangle is covered the same number of times modulo 2 (the projected chain has no boundary
//! there). If one point is covered an odd number of times, every point has a point of the other
//! surface straight above or below it. How far is a linear function on each projected triangle
//! clipped to the triangle, and so is the difference of two linear fields of normals: both are
//! largest at the clipped polygon's corners.
//!
//! Where the other surface ends over the triangle, or lies too far above it, nothing is shown,
//! and the caller has to try another way.

use glam::{DVec3, Vec3};

use super::pieces::Bound;
use super::surface::{Difference, Look, NONE, Surface};

/// Finds covers of one triangle after another.
pub(super) struct Cover<'a> {
    over: &'a Surface,
    neighbours: &'a [[u32; 3]],
    /// Heights above this are failures.
    pub(super) limit: f64,
    /// Lengths below this may be rounding.
    rounding: f64,
    /// In which search a triangle of the other surface was last visited.
    visited: Vec<u32>,
    search: u32,
    pending: Vec<u32>,
    /// Projected vertices of the other surface, and in which search they were.
    points: Vec<(u32, Point)>,
    /// Triangles that were visited, to count how often a point is covered.
    projected: Vec<[u32; 3]>,
    polygon: Vec<Point>,
    spare: Vec<Point>,
}

/// A point in the frame of the triangle.
#[derive(Debug, Clone, Copy, Default)]
struct Point {
    /// Barycentric coordinates of the projection; inside where none is negative.
    inside: DVec3,
    /// Signed distance from the triangle's plane.
    height: f64,
    /// The other surface's look less that of the triangle's plane, continued linearly.
    normal: DVec3,
    colour: DVec3,
}

impl Point {
    fn between(&self, other: &Point, t: f64) -> Point {
        Point {
            inside: self.inside + (other.inside - self.inside) * t,
            height: self.height + (other.height - self.height) * t,
            normal: self.normal + (other.normal - self.normal) * t,
            colour: self.colour + (other.colour - self.colour) * t,
        }
    }
}

/// The planes of one triangle: barycentric coordinates and height of a point.
struct Frame {
    /// `barycentric[k](p) = gradients[k] · (p − origin) + offsets[k]`.
    gradients: [DVec3; 3],
    offsets: [f64; 3],
    origin: DVec3,
    normal: DVec3,
    looks: [Look; 3],
}

impl Frame {
    fn new(corners: [DVec3; 3], looks: [Look; 3]) -> Option<Frame> {
        let [a, b, c] = corners;
        let cross = (b - a).cross(c - a);
        let area2 = cross.length();
        let longest2 =
            (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        // Heights over needles are mostly rounding.
        if area2.is_nan() || area2 <= 1e-6 * longest2 {
            return None;
        }
        let normal = cross / area2;
        let gradients =
            [normal.cross(c - b) / area2, normal.cross(a - c) / area2, normal.cross(b - a) / area2];
        Some(Frame { gradients, offsets: [1.0, 0.0, 0.0], origin: a, normal, looks })
    }

    fn point(&self, p: DVec3, look: &Look) -> Point {
        let from = p - self.origin;
        let inside = DVec3::from_array(std::array::from_fn(|k| {
            self.gradients[k].dot(from) + self.offsets[k]
        }));
        // Far outside, weights are large and cancel: not a matter for f32.
        let mix = |value: fn(&Look) -> Vec3| -> DVec3 {
            let at = |k: usize| value(&self.looks[k]).as_dvec3() * inside[k];
            value(look).as_dvec3() - (at(0) + at(1) + at(2))
        };
        Point {
            inside,
            height: self.normal.dot(from),
            normal: mix(|look| look.normal),
            colour: mix(|look| look.colour),
        }
    }
}

impl<'a> Cover<'a> {
    /// `neighbours` are those of `over`; `rounding` is the error of a coordinate.
    pub(super) fn new(
        over: &'a Surface,
        neighbours: &'a [[u32; 3]],
        limit: f64,
        rounding: f64,
    ) -> Cover<'a> {
        Cover {
            over,
            neighbours,
            limit,
            rounding,
            visited: vec![0; over.triangles.len()],
            search: 0,
            pending: Vec::new(),
            points: vec![(0, Point::default()); over.positions.len()],
            projected: Vec::new(),
            polygon: Vec::new(),
            spare: Vec::new(),
        }
    }

    /// Bounds the distance from a triangle to the other surface, starting from `seeds`;
    /// `None` where no cover was found. `covered(t)` is told the triangles of the other surface
    /// over it.
    pub(super) fn find(
        &mut self,
        corners: [DVec3; 3],
        looks: [Look; 3],
        seeds: impl Iterator<Item = u32>,
        mut covered: impl FnMut(u32),
    ) -> Option<Bound> {
        let frame = Frame::new(corners, looks)?;
        // In barycentric units: the shortest altitude turns lengths into them.
        let steepest = frame.gradients.iter().map(|g| g.length()).fold(0.0, f64::max);
        let margin = self.rounding * steepest;
        let mut bound = Bound::default();
        self.pending.clear();
        self.projected.clear();
        self.search += 1;
        for seed in seeds {
            self.visit(seed);
        }
        while let Some(t) = self.pending.pop() {
            let vertices = self.over.triangles[t as usize];
            let points = vertices.map(|v| {
                let v = v as usize;
                let (search, point) = &mut self.points[v];
                if *search != self.search {
                    *search = self.search;
                    *point = frame.point(self.over.positions[v], &self.over.looks[v]);
                }
                *point
            });
            let outside = |p: &Point, axis: usize| p.inside[axis] < -margin;
            if (0..3).any(|axis| points.iter().all(|p| outside(p, axis))) {
                continue;
            }
            for k in 0..3 {
                if crosses(&points[k], &points[(k + 1) % 3], margin) {
                    match self.neighbours[t as usize][k] {
                        NONE => return None,
                        neighbour => self.visit(neighbour),
                    }
                }
            }
            self.polygon.clear();
            self.polygon.extend(points);
            (0..3).for_each(|axis| clip(&mut self.polygon, &mut self.spare, axis, margin));
            if self.polygon.is_empty() {
                continue;
            }
            covered(t);
            for p in &self.polygon {
                bound.distance = bound.distance.max(p.height.abs());
                bound.difference = bound.difference.max(Difference {
                    normal: p.normal.length() as f32,
                    colour: p.colour.length() as f32,
                });
            }
            if bound.distance > self.limit {
                return None;
            }
            self.projected.push(vertices);
        }
        // Any point will do; one that lies on a projected edge is no witness.
        const WITNESSES: [DVec3; 3] = [
            DVec3::new(0.341, 0.332, 0.327),
            DVec3::new(0.613, 0.172, 0.215),
            DVec3::new(0.127, 0.241, 0.632),
        ];
        let odd = WITNESSES.iter().find_map(|w| self.count_over(w, margin)).map(|n| n % 2 == 1);
        odd.unwrap_or(false).then_some(bound)
    }

    fn visit(&mut self, t: u32) {
        let mark = &mut self.visited[t as usize];
        if *mark != self.search {
            *mark = self.search;
            self.pending.push(t);
        }
    }

    /// How many projected triangles hold the point; `None` where an edge passes too close to it.
    fn count_over(&self, witness: &DVec3, margin: f64) -> Option<u32> {
        let mut count = 0;
        for vertices in &self.projected {
            // Two barycentric coordinates are an affine frame of the plane.
            let at = |k: usize| self.points[vertices[k % 3] as usize].1.inside - *witness;
            let mut signs = 0;
            for k in 0..3 {
                let (p, q) = (at(k), at(k + 1));
                let side = p.x * q.y - p.y * q.x;
                let length = (p.x - q.x).abs() + (p.y - q.y).abs();
                let near = margin.max(1e-12) * length;
                let between = p.x.min(q.x) <= near
                    && p.x.max(q.x) >= -near
                    && p.y.min(q.y) <= near
                    && p.y.max(q.y) >= -near;
                if side.abs() <= near && between {
                    return None;
                }
                signs += if side > 0.0 { 1 } else { -1 };
            }
            count += u32::from(signs == 3 || signs == -3);
        }
        Some(count)
    }
}

/// Whether a segment's projection may meet the triangle.
fn crosses(p: &Point, q: &Point, margin: f64) -> bool {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for axis in 0..3 {
        let (a, b) = (p.inside[axis] + margin, q.inside[axis] + margin);
        if a < 0.0 && b < 0.0 {
            return false;
        }
        if a < 0.0 {
            from = from.max(a / (a - b));
        } else if b < 0.0 {
            to = to.min(a / (a - b));
        }
    }
    // A little more than rounding could have taken away.
    from <= to + 1e-12
}

/// Keeps what is at least −`margin` in one coordinate; `spare` is room to work in.
fn clip(polygon: &mut Vec<Point>, spare: &mut Vec<Point>, axis: usize, margin: f64) {
    let inside = |p: &Point| p.inside[axis] + margin >= 0.0;
    if polygon.iter().all(inside) {
        return;
    }
    spare.clear();
    for (i, p) in polygon.iter().enumerate() {
        let q = &polygon[(i + 1) % polygon.len()];
        if inside(p) {
            spare.push(*p);
        }
        if inside(p) != inside(q) {
            let (a, b) = (p.inside[axis] + margin, q.inside[axis] + margin);
            spare.push(p.between(q, a / (a - b)));
        }
    }
    std::mem::swap(polygon, spare);
}
