//! From collapsed vertices to the mesh that the file will hold.

use glam::{DVec3, Vec3};
use hlod_compress::{Mesh, OctNormal, Scalars};

use super::Budget;
use super::chains::Chains;
use super::collapse::Collapser;
use super::prepare::{Prepared, group, unit_colour};
use crate::certificate::{Look, NONE, Surface};
use crate::colour::average_srgba;
use crate::kept::mean_scalars;

/// A mesh on the node's grid.
pub(super) struct Emitted {
    pub(super) mesh: Mesh,
    /// Which vertex of the mesh each of the source's has become; [`NONE`] where no triangle of
    /// it is left.
    pub(super) became: Vec<u32>,
}

/// Rounds to the grid. What lay on a face of the cell stays on it: neighbours meet there.
/// Vertices that come to lie together are joined.
pub(super) fn emit<const K: usize>(
    collapser: &Collapser<'_, K>,
    (prepared, chains): (&Prepared, &Chains),
    centre: DVec3,
    budget: &Budget,
) -> Emitted {
    let step = f64::from(1u32 << budget.grid_shift);
    let count = prepared.positions.len();
    let mut used = vec![NONE; count];
    let mut kept: Vec<u32> = Vec::new();
    for v in collapser.triangles().flatten() {
        if used[v as usize] == NONE {
            used[v as usize] = kept.len() as u32;
            kept.push(v);
        }
    }
    let vertices = collapser.vertices();
    let positions: Vec<[i32; 3]> = kept
        .iter()
        .map(|&v| {
            let vertex = &vertices[v as usize];
            std::array::from_fn(|i| {
                let offset = vertex.position[i] + centre[i] - f64::from(budget.cell_min[i]);
                let rounded = if vertex.fixed[i] { offset } else { (offset / step).round() * step };
                budget.cell_min[i] + rounded.round().clamp(0.0, budget.cell_units.into()) as i32
            })
        })
        .collect();
    let normal = |v: u32| {
        let a = &vertices[v as usize].attributes;
        Vec3::new(a[0] as f32, a[1] as f32, a[2] as f32).normalize_or(Vec3::Z)
    };
    let normals: Vec<Vec3> = kept.iter().map(|&v| normal(v)).collect();
    let groups = group(&positions, &normals);
    let group_count = groups.iter().map(|&g| g as usize + 1).max().unwrap_or(0);

    let mut mesh = Mesh { positions: vec![[0; 3]; group_count], ..Mesh::default() };
    let mut sums = vec![Vec3::ZERO; group_count];
    let mut members = vec![Vec::new(); if K > 3 { group_count } else { 0 }];
    for (i, &g) in groups.iter().enumerate() {
        mesh.positions[g as usize] = positions[i];
        sums[g as usize] += normals[i];
        if K > 3 {
            let a = &vertices[kept[i] as usize].attributes;
            let byte = |c: f64| (c * 255.0).round().clamp(0.0, 255.0) as u8;
            let alpha = prepared.colours[kept[i] as usize][3];
            members[g as usize].push([byte(a[3]), byte(a[4]), byte(a[5]), alpha]);
        }
    }
    // What neighbouring cells share is not mixed with anything else.
    for (i, &g) in groups.iter().enumerate() {
        if vertices[kept[i] as usize].pin != NONE {
            sums[g as usize] = normals[i];
        }
    }
    mesh.normals =
        sums.iter().map(|n| OctNormal::encode(n.normalize_or(Vec3::Z).to_array())).collect();
    mesh.colours = members.iter().map(|m| average_srgba(m.iter().map(|&c| (c, 1.0)))).collect();
    let pin_of = |v: u32| vertices[v as usize].pin;
    let pins: Vec<(u32, u32)> = kept.iter().zip(&groups).map(|(&v, &g)| (g, pin_of(v))).collect();
    for t in collapser.triangles() {
        let t = t.map(|v| groups[used[v as usize] as usize]);
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        if a != b && b != c && c != a {
            mesh.triangles.push(t);
        }
    }
    let became: Vec<u32> = (0..count as u32)
        .map(|v| match used[collapser.vertex_of(v) as usize] {
            NONE => NONE,
            kept => groups[kept as usize],
        })
        .collect();
    if !prepared.scalars.is_empty() {
        mesh.scalars = scalars(prepared, chains, &became, &pins, group_count);
    }
    Emitted { mesh, became }
}

/// Kept numbers: means over all vertices of the source that became one, by area; of what neighbouring
/// cells share, those of the chain.
fn scalars(
    prepared: &Prepared,
    chains: &Chains,
    became: &[u32],
    pins: &[(u32, u32)],
    count: usize,
) -> Vec<Scalars> {
    let mut members: Vec<Vec<(Scalars, f64)>> = vec![Vec::new(); count];
    for (scalar, &became) in prepared.scalars.iter().zip(became) {
        if became != NONE {
            members[became as usize].push((scalar.codes, scalar.weight));
        }
    }
    let mut out: Vec<Scalars> =
        members.iter().map(|members| mean_scalars(members.iter().copied())).collect();
    for &(vertex, pin) in pins {
        if let Some(pin) = chains.pins.get(pin as usize) {
            out[vertex as usize] = pin.scalars;
        }
    }
    out
}

/// The mesh as it will be decoded, relative to `centre`.
pub(super) fn surface_of(mesh: &Mesh, centre: DVec3) -> Surface {
    let positions =
        mesh.positions.iter().map(|p| DVec3::from_array(p.map(f64::from)) - centre).collect();
    let looks = mesh
        .normals
        .iter()
        .enumerate()
        .map(|(v, n)| Look {
            normal: Vec3::from_array(n.decode()),
            colour: mesh.colours.get(v).map_or(Vec3::ZERO, unit_colour),
        })
        .collect();
    Surface::new(positions, looks, mesh.triangles.clone())
}
