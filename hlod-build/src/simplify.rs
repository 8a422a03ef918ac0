//! Simplifies the geometry of one node and measures what that did to it.
//!
//! meshoptimizer's quadrics (Garland & Heckbert 1997, Hoppe 1999 for attributes; Kapoulkine
//! 2016–2026) propose. Their own error under-states the Hausdorff distance several times over,
//! so it is never stored: [`crate::hausdorff`] bounds what came out, after rounding to the grid,
//! and where the budget was exceeded the vertices are locked and the proposal is repeated.

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use hlod_compress::{Mesh, OctNormal, RepresentationKind};
use meshopt::SimplifyVertex;

use crate::colour::average_srgba;
use crate::hausdorff::{Foot, Surface, feet, one_sided_bound};

/// What a node may lose. Lengths in lattice steps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Budget {
    /// The cell's edge divided by the resolution.
    pub(crate) whole: f64,
    /// Largest two-sided distance to the source that is aimed at.
    pub(crate) distance: f64,
    /// Positions are rounded to multiples of `2^grid_shift`.
    pub(crate) grid_shift: u8,
    /// Lowest corner of the cell.
    pub(crate) cell_min: [i32; 3],
    /// Edge of the cell.
    pub(crate) cell_units: u32,
}

/// A simplified mesh and its measured distance to what it was made from, in lattice steps.
#[derive(Debug)]
pub(crate) struct Simplified {
    pub(crate) mesh: Mesh,
    /// Bound of the two-sided Hausdorff distance to the source of this step.
    pub(crate) distance: f64,
    /// Angle between normals in degrees, over 100, 99 and 90 % of the source's area, sampled at
    /// the source's vertices.
    pub(crate) normal_deviation_deg: [f32; 3],
}

/// Target of the quadrics as a fraction of the budget: their errors are mean distances, about
/// half of the largest on statues.
const TARGET: f64 = 0.5;

/// How many rings of triangles round a place that exceeded the budget keep their vertices, from
/// one attempt to the next. A whole pass through the node costs more than a few kept triangles.
const LOCKED_RINGS: [u32; 3] = [2, 4, 8];

/// Simplifies `source` within `budget`.
///
/// Where the proposal exceeds the budget, the vertices round about are locked and the node is
/// simplified again. The last attempt is taken even where it still exceeds the budget, with the
/// distance that it has.
///
/// # Panics
/// When `source` has no triangles.
pub(crate) fn simplify(source: &Mesh, kind: RepresentationKind, budget: &Budget) -> Simplified {
    let origin = DVec3::from_array(budget.cell_min.map(f64::from));
    let reference = surface_of(source, origin);
    let mut locks = vec![SimplifyVertex::None; source.positions.len()];
    let mut rings = LOCKED_RINGS.iter();
    loop {
        let mesh = propose(source, kind, &locks, budget);
        let next_rings = rings.next();
        let limit = if next_rings.is_some() { budget.distance } else { f64::INFINITY };
        let (simplified, over_limit) = measure(source, &reference, mesh, origin, budget, limit);
        let Some(&rings) = next_rings.filter(|_| !over_limit.is_empty()) else {
            return simplified;
        };
        lock_round(&source.triangles, &over_limit, rings, &mut locks);
    }
}

/// Locks the vertices of some triangles and of `rings` rings of triangles round them.
fn lock_round(triangles: &[[u32; 3]], centres: &[u32], rings: u32, locks: &mut [SimplifyVertex]) {
    let mut near = vec![false; locks.len()];
    let mark = |triangle: &[u32; 3], near: &mut Vec<bool>| {
        triangle.iter().for_each(|&v| near[v as usize] = true);
    };
    centres.iter().for_each(|&t| mark(&triangles[t as usize], &mut near));
    for _ in 0..rings {
        let before = near.clone();
        for triangle in triangles {
            if triangle.iter().any(|&v| before[v as usize]) {
                mark(triangle, &mut near);
            }
        }
    }
    for (lock, near) in locks.iter_mut().zip(near) {
        if near {
            *lock = SimplifyVertex::Lock;
        }
    }
}

/// Positions relative to `origin`, which differences of integers below 2³¹ make exact.
pub(crate) fn surface_of(mesh: &Mesh, origin: DVec3) -> Surface {
    let positions =
        mesh.positions.iter().map(|p| DVec3::from_array(p.map(f64::from)) - origin).collect();
    Surface::new(positions, mesh.triangles.clone())
}

/// One run of the quadrics, welded and rounded to the grid.
fn propose(
    source: &Mesh,
    kind: RepresentationKind,
    locks: &[SimplifyVertex],
    budget: &Budget,
) -> Mesh {
    let target = TARGET * budget.distance;
    // The simplifier's f32 sees the cell as a unit cube.
    let scale = 1.0 / f64::from(budget.cell_units);
    let mut positions: Vec<[f32; 3]> = source
        .positions
        .iter()
        .map(|p| std::array::from_fn(|i| (f64::from(p[i] - budget.cell_min[i]) * scale) as f32))
        .collect();
    // A normal that turns by one radian counts as much as a vertex that moves by this much.
    let normal_weight = match kind {
        RepresentationKind::Appearance => (8.0 * target * scale) as f32,
        _ => (1e-3 * target * scale) as f32,
    };
    let mut attributes: Vec<f32> = source.normals.iter().flat_map(|n| n.decode()).collect();
    let mut indices: Vec<u32> = source.triangles.iter().flatten().copied().collect();
    let count = meshopt::simplify_with_update(
        &mut indices,
        &mut positions,
        &mut attributes,
        &[normal_weight; 3],
        3 * size_of::<f32>(),
        Some(locks),
        0,
        (target * scale) as f32,
        meshopt::SimplifyOptions::ErrorAbsolute,
        None,
    );
    indices.truncate(count);

    // Round to the grid. What lay on a face of the cell stays on it: neighbours meet there.
    let step = 1i64 << budget.grid_shift;
    let round = |v: usize| -> [i32; 3] {
        std::array::from_fn(|i| {
            let offset = source.positions[v][i] - budget.cell_min[i];
            if offset == 0 || offset as u32 == budget.cell_units {
                return source.positions[v][i];
            }
            let units = f64::from(positions[v][i]) / scale;
            let rounded = ((units / step as f64).round() as i64 * step)
                .clamp(0, i64::from(budget.cell_units));
            budget.cell_min[i] + rounded as i32
        })
    };
    weld(&indices, source, round, &attributes)
}

/// The triangles `indices` with vertices at equal rounded positions merged, unless their normals
/// face apart, and triangles that lost their area removed.
fn weld(
    indices: &[u32],
    source: &Mesh,
    round: impl Fn(usize) -> [i32; 3],
    attributes: &[f32],
) -> Mesh {
    struct Group {
        normal: Vec3,
        members: Vec<u32>,
        next_at_position: Option<u32>,
    }
    const UNSEEN: u32 = u32::MAX;
    let mut first_at: HashMap<[i32; 3], u32> = HashMap::new();
    let mut groups: Vec<Group> = Vec::new();
    let mut positions = Vec::new();
    let mut group_of = vec![UNSEEN; source.positions.len()];
    for &vertex in indices {
        let v = vertex as usize;
        if group_of[v] != UNSEEN {
            continue;
        }
        let position = round(v);
        let normal = Vec3::from_slice(&attributes[3 * v..3 * v + 3]).normalize_or(Vec3::Z);
        let mut candidate = first_at.get(&position).copied();
        let mut last = None;
        while let Some(g) = candidate {
            if groups[g as usize].normal.dot(normal) > 0.0 {
                break;
            }
            last = candidate;
            candidate = groups[g as usize].next_at_position;
        }
        let index = candidate.unwrap_or_else(|| {
            let index = groups.len() as u32;
            positions.push(position);
            groups.push(Group { normal: Vec3::ZERO, members: Vec::new(), next_at_position: None });
            match last {
                Some(last) => groups[last as usize].next_at_position = Some(index),
                None => {
                    first_at.insert(position, index);
                }
            }
            index
        });
        let group = &mut groups[index as usize];
        group.normal += normal;
        group.members.push(vertex);
        group_of[v] = index;
    }

    let mut out = Mesh {
        normals: groups.iter().map(|g| OctNormal::encode(g.normal.to_array())).collect(),
        positions,
        ..Mesh::default()
    };
    if source.has_colours() {
        let mean =
            |g: &Group| average_srgba(g.members.iter().map(|&v| (source.colours[v as usize], 1.0)));
        out.colours = groups.iter().map(mean).collect();
    }
    for triangle in indices.chunks_exact(3) {
        let triangle = [triangle[0], triangle[1], triangle[2]].map(|v| group_of[v as usize]);
        let [a, b, c] = triangle.map(|v| out.positions[v as usize]);
        if a != b && b != c && c != a {
            out.triangles.push(triangle);
        }
    }
    out
}

/// Bounds the distance between the source and its simplified mesh, and samples normals. Second,
/// the triangles of the source at which `limit` is exceeded.
fn measure(
    source: &Mesh,
    reference: &Surface,
    mesh: Mesh,
    origin: DVec3,
    budget: &Budget,
    limit: f64,
) -> (Simplified, Vec<u32>) {
    if mesh.triangles.is_empty() {
        // Nothing survived: as far from the source as the cell is wide.
        let distance = f64::from(budget.cell_units) * 3f64.sqrt();
        let all = (0..source.triangles.len() as u32).collect();
        return (Simplified { mesh, distance, normal_deviation_deg: [180.0; 3] }, all);
    }
    let simplified = surface_of(&mesh, origin);
    let tolerance = TOLERANCE * budget.distance;
    let to_simplified = feet(reference, &simplified);
    let forward = one_sided_bound(reference, &simplified, &to_simplified, tolerance, limit);
    let to_reference = feet(&simplified, reference);
    let backward = one_sided_bound(&simplified, reference, &to_reference, tolerance, limit);
    let distance = forward.bound.max(backward.bound);
    let lost = forward.over_limit.iter().map(|&(source_triangle, _)| source_triangle);
    let invented = backward.over_limit.iter().map(|&(_, source_triangle)| source_triangle);
    let over_limit = lost.chain(invented).collect();
    let normal_deviation_deg = normal_deviation(source, reference, &mesh, &to_simplified);
    (Simplified { mesh, distance, normal_deviation_deg }, over_limit)
}

/// Distances below this fraction of the budget are not told apart: doing so would cost most of
/// the time and gain little.
const TOLERANCE: f64 = 0.5;

/// Angles between each source vertex' normal and the simplified normal interpolated at its foot:
/// over all, 99 % and 90 % of the source's area, in degrees.
fn normal_deviation(source: &Mesh, reference: &Surface, mesh: &Mesh, feet: &[Foot]) -> [f32; 3] {
    let mut area = vec![0.0f64; source.positions.len()];
    for t in &source.triangles {
        let [a, b, c] = t.map(|v| reference.positions[v as usize]);
        let third = (b - a).cross(c - a).length() / 6.0;
        t.iter().for_each(|&v| area[v as usize] += third);
    }
    let mut samples: Vec<(f32, f64)> = feet
        .iter()
        .enumerate()
        .filter(|(_, foot)| foot.distance.is_finite())
        .map(|(v, foot)| {
            let corners = mesh.triangles[foot.triangle as usize];
            let normal: Vec3 = corners
                .iter()
                .zip(foot.barycentric)
                .map(|(&c, w)| Vec3::from_array(mesh.normals[c as usize].decode()) * w as f32)
                .sum();
            let truth = Vec3::from_array(source.normals[v].decode());
            (truth.angle_between(normal.normalize_or(Vec3::Z)).to_degrees(), area[v])
        })
        .collect();
    samples.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = samples.iter().map(|s| s.1).sum();
    [1.0, 0.99, 0.9].map(|share| {
        let mut sum = 0.0;
        let found = samples.iter().find(|(_, area)| {
            sum += area;
            sum >= share * total * (1.0 - 1e-12)
        });
        found.or(samples.last()).map_or(0.0, |s| s.0)
    })
}
