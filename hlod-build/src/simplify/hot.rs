//! The hot loops of a build, for `benches/hot.rs` alone: nothing here is part of the API.

use glam::DVec3;
use hlod_compress::{Mesh, OctNormal};

use super::{Budget, LEAST_SHARE, NEAR, Source, simplify, surface_of};
use crate::certificate::{Ask, Carried, Known, NONE, Pair, certify};
use crate::partition::cut;

/// Edge of the cell, lattice steps.
const CELL: u32 = 1 << 16;

/// A node of a waved sheet, and what became of it.
pub struct Node {
    source: Source,
    budget: Budget,
    simplified: Mesh,
}

impl Node {
    /// A sheet of 2 n² triangles, simplified.
    pub fn waves(n: u32) -> Node {
        let mesh = waves(n);
        let carried = vec![Carried::default(); mesh.triangles.len()];
        let source = Source { mesh, carried, ..Source::default() };
        let distance = f64::from(CELL) / 256.0;
        let budget = Budget {
            whole: distance,
            distance,
            normal_noise: 2.0,
            grid_shift: 2,
            cell_min: [0; 3],
            cell_units: CELL,
            is_closed: false,
        };
        let simplified = simplify(&source, &budget).geometric.mesh;
        Node { source, budget, simplified }
    }

    /// Triangles of the source.
    pub fn triangles(&self) -> usize {
        self.source.mesh.triangles.len()
    }

    /// Collapses, certificates and what is taken back; triangles of both representations.
    pub fn simplify(&self) -> usize {
        let both = simplify(&self.source, &self.budget);
        both.appearance.mesh.triangles.len() + both.geometric.mesh.triangles.len()
    }

    /// One certificate of the geometric representation, of which nothing is known before; whether it holds.
    pub fn certify(&self) -> bool {
        let centre = DVec3::splat(f64::from(CELL) / 2.0);
        let [source, simplified] =
            [&self.source.mesh, &self.simplified].map(|mesh| surface_of(mesh, centre));
        let became = vec![NONE; source.positions.len()];
        let neighbours = source.neighbours();
        let pair = Pair {
            source: &source,
            neighbours: &neighbours,
            simplified: &simplified,
            carried: &self.source.carried,
            became: &became,
        };
        let whole = self.budget.whole;
        let ask = Ask {
            tolerance: whole / 64.0,
            limit: whole,
            least: LEAST_SHARE * whole,
            near: NEAR * whole,
        };
        certify(&pair, ask, Known::default()).holds()
    }

    /// Cuts the source through the middle; triangles of both halves.
    pub fn cut(&self) -> usize {
        let (low, high) = cut(&self.source.mesh, 0, (CELL / 2) as i32);
        low.triangles.len() + high.triangles.len()
    }
}

fn waves(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for y in 0..=n {
        for x in 0..=n {
            let [u, v] = [x, y].map(|c| f64::from(c) / f64::from(n));
            let place = |c: f64| 6_000 + (c * 50_000.0).round() as i32;
            let (height, slope) =
                (2_000.0 * (9.0 * u).sin(), 18_000.0 / 50_000.0 * (9.0 * u).cos());
            mesh.positions.push([place(u), place(v), 30_000 + height.round() as i32]);
            mesh.normals.push(OctNormal::encode([-slope as f32, 0.0, 1.0]));
            if x < n && y < n {
                let a = y * (n + 1) + x;
                mesh.triangles.push([a, a + 1, a + n + 2]);
                mesh.triangles.push([a, a + n + 2, a + n + 1]);
            }
        }
    }
    mesh
}
