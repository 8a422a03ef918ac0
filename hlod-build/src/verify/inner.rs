//! Samples inner nodes against the original geometry inside their cells.

use std::collections::BTreeMap;

use glam::DVec3;
use hlod_compress::{CellKey, Lattice, Mesh, NodeRecord, RepresentationKind};

use super::RepresentationCheck;
use super::distance::Target;
use super::normals::{Normals, largest_angle};
use crate::progress::Progress;

/// Samples every representation of a node both ways; `meshes` are their decoded pages.
pub(super) fn check(
    node: &NodeRecord,
    meshes: &[Mesh],
    leaves: &BTreeMap<CellKey, Mesh>,
    lattice: &Lattice,
    progress: &dyn Progress,
) -> Vec<RepresentationCheck> {
    let originals: Vec<&Mesh> = leaves
        .iter()
        .filter(|(cell, _)| is_inside(**cell, node.cell))
        .map(|(_, mesh)| mesh)
        .collect();
    let to_original = Target::new(originals.iter().flat_map(|mesh| corners(mesh)));
    let original_normals = Normals::new(originals.iter().copied());
    let mut out = Vec::new();
    for (representation, mesh) in node.representations.iter().zip(meshes) {
        let stored = f64::from(representation.errors.geometric);
        // Lattice steps, in which coordinates are integers.
        let spacing = stored / lattice.step / 4.0;
        let to_mesh = Target::new(corners(mesh));
        let mut largest = Largest::default();
        for original in &originals {
            sample(original, spacing, &to_mesh, &mut largest);
        }
        sample(mesh, spacing, &to_original, &mut largest);
        // Leaves and pages hold normals to 12 bits an axis; the file's own numbers include that.
        let errors = &representation.errors;
        let allowed = errors.normal_deviation_deg[0] + errors.normal_smoothing_deg;
        let reach = stored / lattice.step;
        let normals = Normals::new(std::iter::once(mesh));
        let mut angle = largest_angle(mesh, &to_original, &original_normals, reach, allowed);
        for original in &originals {
            angle = angle.max(largest_angle(original, &to_mesh, &normals, reach, allowed));
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
            normal_allowed_deg: allowed,
            normal_sampled_deg: angle,
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
    /// Largest distance of a sample.
    sampled: f64,
    /// No point is farther than this.
    bound: f64,
}

/// Samples a mesh: its vertices, and each triangle's inside down to pieces with edges of at most
/// `spacing`.
///
/// The distance is 1-Lipschitz: no point of a piece is farther than the farthest of its corners
/// plus the piece's covering radius, longest edge / √3. Pieces in which that cannot exceed the
/// largest sample by more than the finest pieces' covering radius are not looked into: they could
/// change neither result.
fn sample(mesh: &Mesh, spacing: f64, target: &Target, largest: &mut Largest) {
    let positions: Vec<DVec3> =
        mesh.positions.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
    let at_vertices: Vec<f64> = positions.iter().map(|p| target.distance(p.to_array())).collect();
    for &v in mesh.triangles.iter().flatten() {
        largest.sampled = largest.sampled.max(at_vertices[v as usize]);
    }
    let finest = spacing / 3f64.sqrt();
    let mut pending = Vec::new();
    for triangle in &mesh.triangles {
        pending.push(triangle.map(|v| (positions[v as usize], at_vertices[v as usize])));
        while let Some([a, b, c]) = pending.pop() {
            let longest = a.0.distance(b.0).max(b.0.distance(c.0)).max(c.0.distance(a.0));
            let farthest = a.1.max(b.1).max(c.1);
            let reach = farthest + longest / 3f64.sqrt();
            if reach <= largest.sampled + finest || longest <= spacing {
                largest.bound = largest.bound.max(reach);
                continue;
            }
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| {
                let middle = (p.0 + q.0) / 2.0;
                (middle, target.distance(middle.to_array()))
            });
            largest.sampled = largest.sampled.max(ab.1).max(bc.1).max(ca.1);
            pending.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
    }
}
