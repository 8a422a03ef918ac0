//! Points in place of triangles.
//!
//! A triangle is divided until each piece is smaller than what a point covers; each piece's middle is
//! a point that stands for it, and these are clustered. A piece lies in the ball of a point where
//! its three corners do: balls are convex. So all of a triangle is covered, by proof, with the radii that
//! are stored (Guthe et al. 2004, section 3.3, where coverage is a matter of spacing).

use std::borrow::Cow;

use glam::DVec3;
use hlod_compress::{Mesh, OctNormal, Primitives, Scalars};

use super::cluster::clustered;
use super::{PIXEL_A_ERROR, Point, SPACING_PX, angle_between};
use crate::borders::Cube;
use crate::colour::average_srgba;
use crate::kept::mean_scalars;
use crate::partition::Vertex;

/// How triangles become points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Choice {
    pub(crate) primitives: Primitives,
    /// What drawing a point costs, in triangles.
    pub(crate) point_cost: f64,
}

/// Only triangles whose corners lie within so many pixels of their middle become points; and perhaps
/// only smaller ones.
const LIMITS_PX: [f64; 4] = [1.0, 0.7, 0.5, 0.35];

/// Some triangles of a mesh, and points for the others; points are `spacing` lattice steps apart.
pub(crate) struct Divided<'a> {
    pub(crate) mesh: Cow<'a, Mesh>,
    pub(crate) points: Vec<Point>,
    pub(crate) spacing: f64,
}

/// Replaces triangles of a node by points where that costs less to draw, or everywhere; `error`
/// is by how much the node is wrong where it is selected, in lattice steps.
pub(crate) fn divide<'a>(mesh: &'a Mesh, error: f64, cube: &Cube, choice: Choice) -> Divided<'a> {
    let pixel = PIXEL_A_ERROR * error;
    let spacing = SPACING_PX * pixel;
    let all = 0..mesh.triangles.len() as u32;
    match choice.primitives {
        Primitives::Hybrid => {
            let sizes: Vec<f64> = all.map(|t| size(mesh, t, cube)).collect();
            // What remains to be drawn, and with which points.
            let mut best = (mesh.triangles.len() as f64, Vec::new(), Vec::new());
            for limit in LIMITS_PX {
                let is_small = |t: &u32| sizes[*t as usize] <= limit * pixel;
                let chosen: Vec<u32> = (0..sizes.len() as u32).filter(is_small).collect();
                let points = cover(mesh, &chosen, spacing);
                let rest = (mesh.triangles.len() - chosen.len()) as f64;
                let cost = rest + choice.point_cost * points.len() as f64;
                if cost < best.0 {
                    best = (cost, chosen, points);
                }
            }
            let (_, chosen, points) = best;
            Divided { mesh: without(mesh, &chosen), points, spacing }
        }
        Primitives::Points => {
            let points = cover(mesh, &all.collect::<Vec<_>>(), spacing);
            Divided { mesh: Cow::Owned(Mesh::default()), points, spacing }
        }
        _ => Divided { mesh: Cow::Borrowed(mesh), points: Vec::new(), spacing },
    }
}

/// How far a triangle's corners are from its middle; infinite where it has an edge in a face of its
/// cell, from which strips hang that close seams.
fn size(mesh: &Mesh, triangle: u32, cube: &Cube) -> f64 {
    let corners = mesh.triangles[triangle as usize].map(|v| mesh.positions[v as usize]);
    let faces = corners.map(|p| cube.faces(p));
    if (0..3).any(|k| faces[k] & faces[(k + 1) % 3] != 0) {
        return f64::INFINITY;
    }
    let corners = corners.map(|p| DVec3::from_array(p.map(f64::from)));
    let middle = corners.iter().sum::<DVec3>() / 3.0;
    corners.iter().map(|p| p.distance(middle)).fold(0.0, f64::max)
}

fn without<'a>(mesh: &'a Mesh, triangles: &[u32]) -> Cow<'a, Mesh> {
    if triangles.is_empty() {
        return Cow::Borrowed(mesh);
    }
    let mut is_kept = vec![true; mesh.triangles.len()];
    triangles.iter().for_each(|&t| is_kept[t as usize] = false);
    let mut out = Mesh::default();
    let mut new_from_old = vec![u32::MAX; mesh.positions.len()];
    for (t, _) in mesh.triangles.iter().zip(is_kept).filter(|(_, is_kept)| *is_kept) {
        let corners = t.map(|v| {
            let new = &mut new_from_old[v as usize];
            if *new == u32::MAX {
                *new = Vertex::of(mesh, v).push_to(&mut out);
            }
            *new
        });
        out.triangles.push(corners);
    }
    Cow::Owned(out)
}

/// What covers some triangles of a mesh, with points about `spacing` lattice steps apart.
///
/// Points lie on the triangles; how far these are from the scan is not counted. Normals deviate by
/// at most `turned` from those that are interpolated anywhere on what a point stands for.
fn cover(mesh: &Mesh, triangles: &[u32], spacing: f64) -> Vec<Point> {
    let mut pieces = Vec::new();
    for &t in triangles {
        let corner = |v: u32| Corner {
            at: DVec3::from_array(mesh.positions[v as usize].map(f64::from)),
            normal: DVec3::from_array(mesh.normals[v as usize].decode().map(f64::from)),
            colour: mesh.colours.get(v as usize).copied().unwrap_or([255; 4]),
            scalars: mesh.scalars.get(v as usize).copied().unwrap_or_default(),
        };
        pieces_of(mesh.triangles[t as usize].map(corner), spacing / 2.0, &mut pieces);
    }
    clustered(&pieces, spacing)
}

#[derive(Clone, Copy)]
struct Corner {
    at: DVec3,
    normal: DVec3,
    colour: [u8; 4],
    scalars: Scalars,
}

impl Corner {
    fn between(a: &Corner, b: &Corner) -> Corner {
        let colour = average_srgba([(a.colour, 0.5), (b.colour, 0.5)]);
        let scalars = mean_scalars([(a.scalars, 1.0), (b.scalars, 1.0)]);
        // Not normalised: interpolation stays linear.
        Corner { at: (a.at + b.at) / 2.0, normal: (a.normal + b.normal) / 2.0, colour, scalars }
    }
}

/// Adds the points of pieces whose corners are all within `reach` of their middle.
fn pieces_of(corners: [Corner; 3], reach: f64, out: &mut Vec<Point>) {
    let [a, b, c] = &corners;
    let middle = (a.at + b.at + c.at) / 3.0;
    let farthest = corners.iter().map(|p| p.at.distance(middle)).fold(0.0, f64::max);
    if farthest <= reach {
        out.push(piece(&corners, middle));
        return;
    }
    // Across the longest side, so that slivers become compact.
    let sides = [b.at.distance(c.at), c.at.distance(a.at), a.at.distance(b.at)];
    let longest = (0..3).max_by(|&i, &j| sides[i].total_cmp(&sides[j])).unwrap_or(0);
    let [apex, p, q] = [longest, (longest + 1) % 3, (longest + 2) % 3].map(|i| corners[i]);
    let m = Corner::between(&p, &q);
    pieces_of([apex, p, m], reach, out);
    pieces_of([apex, m, q], reach, out);
}

fn piece(corners: &[Corner; 3], middle: DVec3) -> Point {
    let sum: DVec3 = corners.iter().map(|p| p.normal).sum();
    let normal = OctNormal::encode(sum.normalize_or_zero().as_vec3().to_array());
    let position = middle.round().as_ivec3().to_array();
    let at = DVec3::from_array(position.map(f64::from));
    let direction = DVec3::from_array(normal.decode().map(f64::from));
    // Interpolated normals lie in the triangle of the corners', and angles to a direction are convex
    // there as far as a right angle.
    let angles = corners.iter().map(|p| angle_between(direction, p.normal.normalize_or_zero()));
    let turned = angles.fold(0.0, f64::max);
    Point {
        position,
        normal,
        colour: average_srgba(corners.map(|p| (p.colour, 1.0))),
        scalars: mean_scalars(corners.map(|p| (p.scalars, 1.0))),
        weight: 1,
        reach: corners.iter().map(|p| p.at.distance(at)).fold(0.0, f64::max),
        moved: at.distance(middle),
        turned: if turned < std::f64::consts::FRAC_PI_2 { turned } else { std::f64::consts::PI },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Any place on any triangle lies in a ball, and the interpolated normal is as near as said.
        #[test]
        fn every_place_is_covered(
            corners in prop::collection::vec(prop::array::uniform3(0..200i32), 3..30),
            spacing in 2.0..60.0f64,
            u in 0.0..1.0f64,
            v in 0.0..1.0f64,
        ) {
            let count = corners.len() as u32 / 3;
            let normal = |i: usize| OctNormal::encode([(i % 3) as f32 - 1.0, (i % 5) as f32 - 2.0, 2.5]);
            let mesh = Mesh {
                normals: (0..corners.len()).map(normal).collect(),
                positions: corners,
                colours: Vec::new(),
                scalars: Vec::new(),
                triangles: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
            };
            let all: Vec<u32> = (0..count).collect();
            let points = cover(&mesh, &all, spacing);
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            for t in &mesh.triangles {
                let weights = [1.0 - u - v, u, v];
                let sum = |of: &dyn Fn(usize) -> DVec3| -> DVec3 {
                    t.iter().zip(weights).map(|(&c, w)| of(c as usize) * w).sum()
                };
                let at = sum(&|c| DVec3::from_array(mesh.positions[c].map(f64::from)));
                let normal = sum(&|c| DVec3::from_array(mesh.normals[c].decode().map(f64::from)));
                let normal = normal.normalize();
                let holds = |p: &&Point| {
                    p.at().distance(at) <= p.reach + 1e-9
                        && angle_between(p.direction(), normal) <= p.turned + 1e-6
                };
                prop_assert!(points.iter().find(holds).is_some(), "{at} of {t:?} is not covered");
            }
        }
    }

    #[test]
    fn points_are_about_as_far_apart_as_asked() {
        let mesh = Mesh {
            positions: vec![[0, 0, 0], [1000, 0, 0], [0, 1000, 0]],
            normals: vec![OctNormal::encode([0.0, 0.0, 1.0]); 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let points = cover(&mesh, &[0], 10.0);
        // 5,000 cells of 10 × 10, and those on the sides.
        assert!((5_000..5_300).contains(&points.len()), "{}", points.len());
        assert!(points.iter().all(|p| p.reach < 15.0 && p.turned < 0.004));
    }
}
