//! Samples inner nodes against the original geometry inside their cells.

use std::collections::BTreeMap;

use hlod_compress::{CellKey, Lattice, Mesh, NodeRecord, RepresentationKind};

use super::RepresentationCheck;
use super::distance::Target;
use crate::progress::Progress;

/// Samples every representation of a node both ways; `meshes` are their decoded pages.
pub(super) fn check(
    node: &NodeRecord,
    meshes: &[Mesh],
    leaves: &BTreeMap<CellKey, Mesh>,
    lattice: &Lattice,
    progress: &dyn Progress,
) -> Vec<RepresentationCheck> {
    let original: Vec<[[f64; 3]; 3]> = leaves
        .iter()
        .filter(|(cell, _)| is_inside(**cell, node.cell))
        .flat_map(|(_, mesh)| corners(mesh))
        .collect();
    let to_original = Target::new(original.iter().copied());
    let mut out = Vec::new();
    for (representation, mesh) in node.representations.iter().zip(meshes) {
        let stored = f64::from(representation.errors.geometric);
        // Lattice steps, in which coordinates are integers.
        let spacing = stored / lattice.step / 4.0;
        let to_mesh = Target::new(corners(mesh));
        let mut largest = Largest::default();
        for (triangles, target) in
            [(original.clone(), &to_mesh), (corners(mesh).collect(), &to_original)]
        {
            for triangle in triangles {
                sample(&triangle, spacing, target, &mut largest);
            }
        }
        out.push(RepresentationCheck {
            cell: node.cell.to_string(),
            depth: node.cell.depth(),
            kind: match representation.kind {
                RepresentationKind::Appearance => "appearance",
                RepresentationKind::Geometric => "geometric",
                _ => "source",
            },
            stored,
            sampled: largest.sampled * lattice.step,
            independent_bound: largest.bound * lattice.step,
        });
        progress.advance(1);
    }
    out
}

fn is_inside(cell: CellKey, outer: CellKey) -> bool {
    let mut cell = cell;
    while cell.depth() > outer.depth() {
        match cell.parent() {
            Some(parent) => cell = parent,
            None => return false,
        }
    }
    cell == outer
}

fn corners(mesh: &Mesh) -> impl Iterator<Item = [[f64; 3]; 3]> + '_ {
    mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize].map(f64::from)))
}

#[derive(Default)]
struct Largest {
    sampled: f64,
    bound: f64,
}

/// Samples a triangle on a barycentric grid whose cells have edges of at most `spacing`.
fn sample(t: &[[f64; 3]; 3], spacing: f64, target: &Target, largest: &mut Largest) {
    let length = |a: usize, b: usize| -> f64 {
        (0..3).map(|i| (t[a][i] - t[b][i]).powi(2)).sum::<f64>().sqrt()
    };
    let longest = length(0, 1).max(length(1, 2)).max(length(2, 0));
    let count = (longest / spacing).ceil().max(1.0) as u32;
    let n = f64::from(count);
    // The grid's cells are copies of the triangle: no point of one is farther than its longest
    // edge / √3 from the nearest corner.
    let covering_radius = longest / n / 3f64.sqrt();
    for i in 0..=count {
        for j in 0..=count - i {
            let (u, v) = (f64::from(i) / n, f64::from(j) / n);
            let p = std::array::from_fn(|k| t[0][k] * (1.0 - u - v) + t[1][k] * u + t[2][k] * v);
            let distance = target.distance(p);
            largest.sampled = largest.sampled.max(distance);
            largest.bound = largest.bound.max(distance + covering_radius);
        }
    }
}
