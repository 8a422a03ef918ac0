//! What is simplified: one node's source as a surface, welded and without detail below resolution.

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use hlod_compress::{Mesh, Scalars};

use crate::certificate::{Look, Surface, largest_angle};
use crate::colour::average_srgba;
use crate::kept::mean_scalars;

/// The source of one node, ready to be simplified and compared with.
pub(super) struct Prepared {
    /// Positions relative to the cell's centre, in lattice steps.
    pub(super) surface: Surface,
    /// Positions in lattice steps.
    pub(super) positions: Vec<[i32; 3]>,
    /// Empty where there are none.
    pub(super) colours: Vec<[u8; 4]>,
    /// Kept numbers; empty where there are none.
    pub(super) scalars: Vec<Weighed>,
    /// The largest angle between a normal of the source, anywhere on it, and the one here, in
    /// radians.
    pub(super) smoothed: f32,
    /// What normals differ by from their neighbours' without meaning anything, in radians.
    pub(super) normal_noise: f32,
}

/// Joins vertices at equal positions whose normals do not face apart, so that the surface hangs
/// together across the cells it was gathered from, and averages normals of vertices whose
/// triangles are all smaller than `resolution`: such detail is below what the node may show.
pub(super) fn prepare(source: &Mesh, centre: DVec3, resolution: f64) -> Prepared {
    let at = |p: &[i32; 3]| DVec3::from_array(p.map(f64::from)) - centre;
    let areas: Vec<DVec3> = source
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| at(&source.positions[v as usize]));
            (b - a).cross(c - a) * 0.5
        })
        .collect();
    let mut vertex_area = vec![0.0f64; source.positions.len()];
    for (t, area) in source.triangles.iter().zip(&areas) {
        t.iter().for_each(|&v| vertex_area[v as usize] += area.length() / 3.0);
    }
    let normals: Vec<Vec3> =
        source.normals.iter().map(|n| Vec3::from_array(n.decode()).normalize_or(Vec3::Z)).collect();

    let groups = group(&source.positions, &normals);
    let count = groups.iter().map(|&g| g as usize + 1).max().unwrap_or(0);
    let mut positions = vec![[0; 3]; count];
    let mut sums = vec![Vec3::ZERO; count];
    for (v, &g) in groups.iter().enumerate() {
        positions[g as usize] = source.positions[v];
        sums[g as usize] += normals[v] * (vertex_area[v] as f32).max(AREA_MIN);
    }
    let mut colours = Vec::new();
    if source.has_colours() {
        let mut members = vec![Vec::new(); count];
        groups.iter().enumerate().for_each(|(v, &g)| members[g as usize].push(v));
        let mean = |m: &Vec<usize>| average_srgba(m.iter().map(|&v| (source.colours[v], 1.0)));
        colours = members.iter().map(mean).collect();
    }
    let scalars = weighed(source, &groups, count, &vertex_area);
    let triangles: Vec<[u32; 3]> =
        source.triangles.iter().map(|t| t.map(|v| groups[v as usize])).collect();
    let welded: Vec<Vec3> = sums.iter().map(|s| s.normalize_or(Vec3::Z)).collect();
    let positions_f: Vec<DVec3> = positions.iter().map(at).collect();

    let fine = fine_vertices(&positions_f, &triangles, resolution);
    let smooth = smooth(&welded, &triangles, &areas, &fine);
    let normal_noise = noise(&smooth, &triangles);
    let smoothed = source
        .triangles
        .iter()
        .map(|t| {
            let before = t.map(|v| normals[v as usize]);
            let after = t.map(|v| smooth[groups[v as usize] as usize]);
            let moved = (0..3).map(|k| before[k].distance(after[k])).fold(0.0, f32::max);
            if moved == 0.0 { 0.0 } else { largest_angle(before, moved) }
        })
        .fold(0.0, f32::max);
    let looks = (0..count)
        .map(|v| Look { normal: smooth[v], colour: colours.get(v).map_or(Vec3::ZERO, unit_colour) })
        .collect();
    let surface = Surface::new(positions_f, looks, triangles);
    Prepared { surface, positions, colours, scalars, smoothed, normal_noise }
}

/// Kept numbers of a vertex, and for how much of the surface they stand.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weighed {
    pub(super) codes: Scalars,
    /// Squared lattice steps.
    pub(super) weight: f64,
}

/// Means over the vertices of each group, by area.
fn weighed(source: &Mesh, groups: &[u32], count: usize, vertex_area: &[f64]) -> Vec<Weighed> {
    if source.scalars.is_empty() {
        return Vec::new();
    }
    let mut members: Vec<Vec<(Scalars, f64)>> = vec![Vec::new(); count];
    for (v, &group) in groups.iter().enumerate() {
        let weight = vertex_area[v].max(AREA_MIN.into());
        members[group as usize].push((source.scalars[v], weight));
    }
    let mean = |members: Vec<(Scalars, f64)>| Weighed {
        codes: mean_scalars(members.iter().copied()),
        weight: members.iter().map(|(_, weight)| weight).sum(),
    };
    members.into_iter().map(mean).collect()
}

/// Vertices of degenerate triangles only count a little: squared lattice steps.
const AREA_MIN: f32 = 1e-3;

/// sRGB from 0 to 1.
pub(super) fn unit_colour(srgba: &[u8; 4]) -> Vec3 {
    Vec3::from_array([srgba[0], srgba[1], srgba[2]].map(|c| f32::from(c) / 255.0))
}

/// Angle between unit vectors in radians, accurate for small ones.
pub(super) fn angle(a: Vec3, b: Vec3) -> f32 {
    2.0 * ((a - b).length() / (a + b).length().max(f32::MIN_POSITIVE)).atan()
}

/// For each vertex the group it is in: of equal position, normals within a right angle of the
/// group's first. Groups are numbered in the order in which they appear.
pub(super) fn group(positions: &[[i32; 3]], normals: &[Vec3]) -> Vec<u32> {
    struct Group {
        normal: Vec3,
        next_at_position: Option<u32>,
    }
    let mut first_at: HashMap<[i32; 3], u32> = HashMap::with_capacity(positions.len());
    let mut groups: Vec<Group> = Vec::with_capacity(positions.len());
    let mut out = Vec::with_capacity(positions.len());
    for (position, &normal) in positions.iter().zip(normals) {
        let mut candidate = first_at.get(position).copied();
        let mut last = None;
        while let Some(g) = candidate {
            if groups[g as usize].normal.dot(normal) > 0.0 {
                break;
            }
            last = candidate;
            candidate = groups[g as usize].next_at_position;
        }
        out.push(candidate.unwrap_or_else(|| {
            let index = groups.len() as u32;
            groups.push(Group { normal, next_at_position: None });
            match last {
                Some(last) => groups[last as usize].next_at_position = Some(index),
                None => {
                    first_at.insert(*position, index);
                }
            }
            index
        }));
    }
    out
}

/// Vertices that touch only triangles with edges below `resolution`.
fn fine_vertices(positions: &[DVec3], triangles: &[[u32; 3]], resolution: f64) -> Vec<bool> {
    let mut fine = vec![true; positions.len()];
    for t in triangles {
        let p = t.map(|v| positions[v as usize]);
        let longest2 = (0..3).map(|i| p[i].distance_squared(p[(i + 1) % 3])).fold(0.0, f64::max);
        if longest2 >= resolution * resolution {
            t.iter().for_each(|&v| fine[v as usize] = false);
        }
    }
    fine
}

/// Averages the fine vertices' normals over the triangles round them, by area.
fn smooth(normals: &[Vec3], triangles: &[[u32; 3]], areas: &[DVec3], fine: &[bool]) -> Vec<Vec3> {
    if !fine.contains(&true) {
        return normals.to_vec();
    }
    let mut sums = vec![Vec3::ZERO; normals.len()];
    let largest = areas.iter().map(|a| a.length()).fold(f64::MIN_POSITIVE, f64::max);
    for (t, area) in triangles.iter().zip(areas) {
        let mean = t.iter().map(|&v| normals[v as usize]).sum::<Vec3>();
        let weight = (area.length() / largest) as f32;
        t.iter().for_each(|&v| sums[v as usize] += mean * weight);
    }
    let one = |v: usize| if fine[v] { sums[v].normalize_or(normals[v]) } else { normals[v] };
    (0..normals.len()).map(one).collect()
}

/// A robust estimate of the noise of normals: the median angle between a vertex' normal and the
/// mean of its neighbours'. On a smooth surface the two agree to second order.
fn noise(normals: &[Vec3], triangles: &[[u32; 3]]) -> f32 {
    let mut sums = vec![Vec3::ZERO; normals.len()];
    for t in triangles {
        for k in 0..3 {
            sums[t[k] as usize] +=
                normals[t[(k + 1) % 3] as usize] + normals[t[(k + 2) % 3] as usize];
        }
    }
    let used = (0..normals.len()).filter(|&v| sums[v] != Vec3::ZERO);
    let mut angles: Vec<f32> =
        used.map(|v| angle(normals[v], sums[v].normalize_or(normals[v]))).collect();
    if angles.is_empty() {
        return 0.0;
    }
    let middle = angles.len() / 2;
    *angles.select_nth_unstable_by(middle, f32::total_cmp).1
}
