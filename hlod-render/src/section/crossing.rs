//! Where single triangles meet the plane.
//!
//! A vertex is above or below, never on the plane: distance 0 counts as above (symbolic
//! perturbation; Edelsbrunner & Mücke 1990). So a triangle is crossed in two edges or none, and no
//! vertex or edge in the plane needs a case. The side of a vertex is a function of its lattice
//! position alone and a crossing point one of its edge alone, so that triangles which share an edge
//! agree, in whichever leaves they are.

use glam::DVec3;
use hlod_compress::Mesh;

use super::plane::Plane;
use crate::leaves::{Leaf, Leaves};

/// An edge of the scan by its ends on the lattice, the smaller first.
pub(super) type Edge = [[i32; 3]; 2];

/// What one triangle leaves in the plane: a way from one of its edges to another, with what is
/// solid on the left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Crossing {
    /// Edge that it begins in, and that it ends in.
    pub(super) edges: [Edge; 2],
    /// Sine of the angle between the triangle and the plane.
    pub(super) steepness: f64,
    /// How far the triangle's leaf can be from the scan, in the source's unit.
    pub(super) error: f64,
    /// Edge of the leaf's cell in lattice steps.
    pub(super) cell_units: u32,
}

/// A plane on a file's lattice.
#[derive(Clone, Copy)]
pub(super) struct Cutter<'a> {
    leaves: &'a Leaves,
    plane: &'a Plane,
    /// Only triangles whose bounds meet this box are cut.
    within: Option<(DVec3, DVec3)>,
}

/// A triangle that is narrower than this many steps says little by its normal: rounding of cut
/// points turns it.
const NARROW_STEPS: f64 = 4.0;

impl<'a> Cutter<'a> {
    pub(super) fn new(
        leaves: &'a Leaves,
        plane: &'a Plane,
        within: Option<(DVec3, DVec3)>,
    ) -> Cutter<'a> {
        Cutter { leaves, plane, within }
    }

    /// Signed distance of a lattice position from the plane.
    pub(super) fn height(&self, position: [i32; 3]) -> f64 {
        self.plane.distance(self.leaves.place(position))
    }

    /// A lattice position in source coordinates.
    pub(super) fn place(&self, position: [i32; 3]) -> DVec3 {
        self.leaves.place(position)
    }

    /// Where an edge whose ends are on different sides meets the plane.
    pub(super) fn point(&self, [p, q]: Edge) -> DVec3 {
        let (above, below) = (self.height(p), self.height(q));
        let t = (above / (above - below)).clamp(0.0, 1.0);
        let (p, q) = (self.leaves.place(p), self.leaves.place(q));
        // At its ends an edge is met in its ends, exactly.
        if t == 1.0 { q } else { p + (q - p) * t }
    }

    /// What the plane cuts of a leaf's triangles.
    pub(super) fn cut(&self, leaf: &Leaf) -> Vec<Crossing> {
        let mesh = &leaf.content.mesh;
        let above: Vec<bool> = mesh.positions.iter().map(|&p| self.height(p) >= 0.0).collect();
        let cell_units = self.leaves.header().lattice.cell_units(leaf.at.cell.depth());
        let mut crossings = Vec::new();
        for t in &mesh.triangles {
            let sides = t.map(|v| above[v as usize]);
            if sides == [true; 3] || sides == [false; 3] || !self.is_wanted(mesh, t) {
                continue;
            }
            let corners = t.map(|v| mesh.positions[v as usize]);
            // Once round, counter-clockwise seen from outside: what is solid is on the left of the
            // way from where the border goes down to where it comes up again.
            let edge = |from: bool| {
                let found = (0..3).find(|&i| sides[i] == from && sides[(i + 1) % 3] != from);
                found.map(|i| edge(corners[i], corners[(i + 1) % 3]))
            };
            if let (Some(down), Some(up)) = (edge(true), edge(false)) {
                let (steepness, error) = (self.steepness(mesh, t), leaf.at.error);
                crossings.push(Crossing { edges: [down, up], steepness, error, cell_units });
            }
        }
        crossings
    }

    fn is_wanted(&self, mesh: &Mesh, triangle: &[u32; 3]) -> bool {
        let Some((min, max)) = self.within else { return true };
        let [a, b, c] = triangle.map(|v| self.leaves.place(mesh.positions[v as usize]));
        a.min(b).min(c).cmple(max).all() && a.max(b).max(c).cmpge(min).all()
    }

    /// Sine of the angle between a triangle and the plane.
    fn steepness(&self, mesh: &Mesh, triangle: &[u32; 3]) -> f64 {
        let [a, b, c] = triangle.map(|v| self.leaves.place(mesh.positions[v as usize]));
        let area = (b - a).cross(c - a);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let step = self.leaves.header().lattice.step;
        let normal = if area.length() > NARROW_STEPS * step * longest {
            area
        } else {
            let normal = |v: u32| mesh.normals.get(v as usize).map(|n| n.decode());
            let normals = triangle.map(|v| normal(v).unwrap_or_default().map(f64::from));
            normals.into_iter().map(DVec3::from_array).sum()
        };
        self.plane.normal.cross(normal.normalize_or_zero()).length().min(1.0)
    }
}

fn edge(a: [i32; 3], b: [i32; 3]) -> Edge {
    if a < b { [a, b] } else { [b, a] }
}
