//! Cuts the model at cell faces into the leaves of the octree.
//!
//! A triangle that crosses a face is cut there. A cut point is a pure function of the edge's two
//! end points in canonical order, and every cell is cut by the same planes in the same order
//! (parents before children, x before y before z), so both sides of a face own bit-equal points
//! and triangles that shared an edge still share its pieces.

use std::collections::HashMap;

use hlod_compress::{CellKey, Lattice, Mesh, OctNormal, Scalars, code_between};
use rayon::prelude::*;

use crate::colour::mix_srgba;

/// A leaf of the octree: the scan's own geometry inside one cell.
#[derive(Debug, Clone)]
pub(crate) struct Leaf {
    /// Its cell.
    pub(crate) cell: CellKey,
    /// Its geometry; never empty.
    pub(crate) mesh: Mesh,
}

/// Splits `cell`, of which `mesh` is the geometry, until each cell holds at most `leaf_triangles`
/// triangles; leaves come in depth-first order of their cells.
pub(crate) fn cut_into_leaves(
    cell: CellKey,
    mesh: Mesh,
    lattice: &Lattice,
    leaf_triangles: usize,
) -> Vec<Leaf> {
    if mesh.triangles.is_empty() {
        return Vec::new();
    }
    if mesh.triangles.len() <= leaf_triangles || cell.depth() == lattice.depth_max {
        return vec![Leaf { cell, mesh: joined(&mesh) }];
    }
    octants(mesh, lattice, cell)
        .into_par_iter()
        .flat_map_iter(|(octant, part)| {
            cut_into_leaves(cell.child(octant), part, lattice, leaf_triangles)
        })
        .collect()
}

/// The parts of a cell's geometry in its eight octants.
pub(crate) fn octants(mesh: Mesh, lattice: &Lattice, cell: CellKey) -> Vec<(u8, Mesh)> {
    let half = (lattice.cell_units(cell.depth()) / 2) as i32;
    let centre = lattice.cell_min(cell).map(|c| c + half);
    let mut parts = vec![mesh];
    for (axis, &plane) in centre.iter().enumerate() {
        // Low parts before high parts on the later axes too: index bit `axis` is the half.
        let (low, high): (Vec<_>, Vec<_>) = parts.iter().map(|part| cut(part, axis, plane)).unzip();
        parts = low.into_iter().chain(high).collect();
    }
    (0..).zip(parts).collect()
}

/// The same triangles with vertices that are equal in every attribute joined, numbered as
/// triangles first use them: however the triangles came here, their leaf has the same bytes.
fn joined(mesh: &Mesh) -> Mesh {
    let mut out = Mesh::default();
    let mut index_of: HashMap<Vertex, u32> = HashMap::with_capacity(mesh.positions.len());
    for t in &mesh.triangles {
        let t = t.map(|v| {
            let vertex = Vertex::of(mesh, v);
            *index_of.entry(vertex).or_insert_with(|| vertex.push_to(&mut out))
        });
        out.triangles.push(t);
    }
    out
}

/// Parts of `mesh` below and above `plane` on `axis`; triangles in the plane go below.
pub(crate) fn cut(mesh: &Mesh, axis: usize, plane: i32) -> (Mesh, Mesh) {
    let mut sides = [Side::new(mesh), Side::new(mesh)];
    let mut cut_points: HashMap<(u32, u32), Corner> = HashMap::new();
    let side_of = |v: u32| (mesh.positions[v as usize][axis] - plane).signum();
    for &triangle in &mesh.triangles {
        let signs = triangle.map(side_of);
        if signs.iter().all(|&s| s <= 0) || signs.iter().all(|&s| s >= 0) {
            let high = signs.iter().any(|&s| s > 0);
            sides[usize::from(high)].add(triangle.map(Corner::Old));
            continue;
        }
        // Walk round the triangle; each side collects its polygon of three or four corners.
        let mut polygons: [Vec<Corner>; 2] = Default::default();
        for i in 0..3 {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            let (sign_a, sign_b) = (signs[i], signs[(i + 1) % 3]);
            if sign_a <= 0 {
                polygons[0].push(Corner::Old(a));
            }
            if sign_a >= 0 {
                polygons[1].push(Corner::Old(a));
            }
            if sign_a * sign_b < 0 {
                let next = Corner::Cut(cut_points.len());
                let corner = *cut_points.entry((a.min(b), a.max(b))).or_insert(next);
                if let (Corner::Cut(index), true) = (corner, corner == next) {
                    let point = cut_point(Vertex::of(mesh, a), Vertex::of(mesh, b), axis, plane);
                    for side in &mut sides {
                        side.cut_points.push((point, u32::MAX));
                        debug_assert_eq!(side.cut_points.len(), index + 1);
                    }
                }
                polygons.iter_mut().for_each(|p| p.push(corner));
            }
        }
        for (side, polygon) in sides.iter_mut().zip(&polygons) {
            for i in 2..polygon.len() {
                side.add([polygon[0], polygon[i - 1], polygon[i]]);
            }
        }
    }
    let [low, high] = sides.map(|side| side.out);
    (low, high)
}

/// A corner of a piece: a vertex of the mesh that is cut, or a cut point.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Corner {
    Old(u32),
    Cut(usize),
}

/// One side of a cut under construction.
struct Side<'a> {
    mesh: &'a Mesh,
    new_from_old: Vec<u32>,
    /// Each cut point and its index in `out`, if it has one yet.
    cut_points: Vec<(Vertex, u32)>,
    out: Mesh,
}

impl<'a> Side<'a> {
    fn new(mesh: &'a Mesh) -> Self {
        let new_from_old = vec![u32::MAX; mesh.positions.len()];
        Side { mesh, new_from_old, cut_points: Vec::new(), out: Mesh::default() }
    }

    fn add(&mut self, corners: [Corner; 3]) {
        let position = |c| match c {
            Corner::Old(v) => self.mesh.positions[v as usize],
            Corner::Cut(i) => self.cut_points[i].0.position,
        };
        let [a, b, c] = corners.map(position);
        // Rounding to the lattice can make a thin piece vanish.
        if a == b || b == c || c == a {
            return;
        }
        let triangle = corners.map(|corner| match corner {
            Corner::Old(v) => {
                if self.new_from_old[v as usize] == u32::MAX {
                    self.new_from_old[v as usize] = Vertex::of(self.mesh, v).push_to(&mut self.out);
                }
                self.new_from_old[v as usize]
            }
            Corner::Cut(i) => {
                let (vertex, index) = &mut self.cut_points[i];
                if *index == u32::MAX {
                    *index = vertex.push_to(&mut self.out);
                }
                *index
            }
        });
        self.out.triangles.push(triangle);
    }
}

/// A vertex with all its attributes; the derived order is the canonical one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Vertex {
    pub(crate) position: [i32; 3],
    pub(crate) normal: OctNormal,
    pub(crate) colour: Option<[u8; 4]>,
    pub(crate) scalars: Option<Scalars>,
}

impl Vertex {
    pub(crate) fn of(mesh: &Mesh, vertex: u32) -> Vertex {
        let v = vertex as usize;
        Vertex {
            position: mesh.positions[v],
            normal: mesh.normals[v],
            colour: mesh.colours.get(v).copied(),
            scalars: mesh.scalars.get(v).copied(),
        }
    }

    pub(crate) fn push_to(self, mesh: &mut Mesh) -> u32 {
        mesh.positions.push(self.position);
        mesh.normals.push(self.normal);
        mesh.colours.extend(self.colour);
        mesh.scalars.extend(self.scalars);
        mesh.positions.len() as u32 - 1
    }
}

/// Where the edge a–b crosses the plane, rounded to the lattice; symmetric in a and b.
fn cut_point(a: Vertex, b: Vertex, axis: usize, plane: i32) -> Vertex {
    let (a, b) = if a <= b { (a, b) } else { (b, a) };
    let along = |i: usize| f64::from(b.position[i]) - f64::from(a.position[i]);
    let t = (f64::from(plane) - f64::from(a.position[axis])) / along(axis);
    let mut position: [i32; 3] =
        std::array::from_fn(|i| (f64::from(a.position[i]) + t * along(i)).round() as i32);
    position[axis] = plane;
    let (from, to) = (a.normal.decode(), b.normal.decode());
    let scalars = a
        .scalars
        .zip(b.scalars)
        .map(|(a, b)| Scalars(std::array::from_fn(|k| code_between(a.0[k], b.0[k], t))));
    let t = t as f32;
    let normal = OctNormal::encode(std::array::from_fn(|i| from[i] + t * (to[i] - from[i])));
    let colour = a.colour.zip(b.colour).map(|(a, b)| mix_srgba(a, b, t));
    Vertex { position, normal, colour, scalars }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use proptest::prelude::*;

    /// A closed, coarse sphere of about `n²` triangles in a cube of `units`.
    fn sphere(n: u32, units: i32) -> Mesh {
        let mut mesh = Mesh::default();
        let point = |i: u32, j: u32| {
            let (theta, phi) = (
                std::f64::consts::PI * f64::from(i) / f64::from(n),
                std::f64::consts::TAU * f64::from(j % n) / f64::from(n),
            );
            [theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()]
        };
        let mut index = BTreeMap::new();
        for i in 0..n {
            for j in 0..n {
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| {
                    let d = point(i, j);
                    let r = f64::from(units) / 2.0;
                    let p = d.map(|c| (r + 0.97 * r * c).round() as i32);
                    *index.entry(p).or_insert_with(|| {
                        mesh.positions.push(p);
                        mesh.normals.push(OctNormal::encode(d.map(|c| c as f32)));
                        mesh.positions.len() as u32 - 1
                    })
                });
                for t in [[0, 2, 1], [0, 3, 2]] {
                    let t = t.map(|k| corners[k]);
                    if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
                        mesh.triangles.push(t);
                    }
                }
            }
        }
        mesh
    }

    /// Twice the vector area; zero for a closed surface, whatever it is cut into.
    fn vector_area(mesh: &Mesh) -> [i128; 3] {
        let mut sum = [0i128; 3];
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize].map(i128::from));
            for (i, sum) in sum.iter_mut().enumerate() {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                *sum += (b[j] - a[j]) * (c[k] - a[k]) - (b[k] - a[k]) * (c[j] - a[j]);
            }
        }
        sum
    }

    /// Every edge that is not on a cell face has exactly one opposite; the pieces on the two
    /// sides of a face match bit for bit when both cells have the same depth.
    #[test]
    fn leaves_of_a_closed_surface_close_it() {
        let lattice = Lattice::enclosing([0.0; 3], [4096.0; 3], 1.0);
        let model = sphere(60, 4096);
        let leaves = cut_into_leaves(CellKey::ROOT, model.clone(), &lattice, 600);
        assert!(leaves.len() > 10);
        let mut edges: BTreeMap<([i32; 3], [i32; 3]), i32> = BTreeMap::new();
        let mut sum = [0i128; 3];
        for leaf in &leaves {
            assert!(leaf.mesh.triangles.len() <= 600);
            leaf.mesh.validate().unwrap();
            let lo = lattice.cell_min(leaf.cell);
            let edge = lattice.cell_units(leaf.cell.depth()) as i32;
            for p in &leaf.mesh.positions {
                assert!(
                    (0..3).all(|i| p[i] >= lo[i] && p[i] <= lo[i] + edge),
                    "{p:?} outside {}",
                    leaf.cell
                );
            }
            let area = vector_area(&leaf.mesh);
            (0..3).for_each(|i| sum[i] += area[i]);
            for t in &leaf.mesh.triangles {
                let t = t.map(|v| leaf.mesh.positions[v as usize]);
                for i in 0..3 {
                    *edges.entry((t[i], t[(i + 1) % 3])).or_default() += 1;
                }
            }
        }
        // All leaves here have the same depth or meet conformingly, so the cut surface is closed.
        let depths: Vec<u8> = leaves.iter().map(|l| l.cell.depth()).collect();
        if depths.iter().all(|&d| d == depths[0]) {
            assert_eq!(sum, [0; 3]);
            for (&(a, b), &count) in &edges {
                assert_eq!(edges.get(&(b, a)), Some(&count), "edge {a:?} {b:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn cutting_keeps_area_and_both_sides_share_the_cut(
            corners in prop::array::uniform3(prop::array::uniform3(0..1000i32)),
            axis in 0usize..3,
            plane in 1..999i32,
        ) {
            let mesh = Mesh {
                positions: corners.to_vec(),
                normals: vec![OctNormal::default(); 3],
                triangles: vec![[0, 1, 2]],
                ..Mesh::default()
            };
            let (low, high) = cut(&mesh, axis, plane);
            prop_assert!(low.positions.iter().all(|p| p[axis] <= plane));
            prop_assert!(high.positions.iter().all(|p| p[axis] >= plane));
            let (whole, a, b) = (vector_area(&mesh), vector_area(&low), vector_area(&high));
            // Rounding moves two points by at most half a step on each axis.
            for i in 0..3 {
                prop_assert!((whole[i] - a[i] - b[i]).abs() <= 6000, "{whole:?} {a:?} {b:?}");
            }
            let on_plane = |m: &Mesh| {
                let mut v: Vec<_> = m.positions.iter().filter(|p| p[axis] == plane && !corners.contains(p)).copied().collect();
                v.sort();
                v
            };
            if !low.triangles.is_empty() && !high.triangles.is_empty() {
                prop_assert!(on_plane(&low).iter().all(|p| on_plane(&high).contains(p)) || on_plane(&high).iter().all(|p| on_plane(&low).contains(p)));
            }
        }

        #[test]
        fn cut_points_do_not_depend_on_the_direction(
            a in prop::array::uniform3(0..1_000_000i32),
            b in prop::array::uniform3(0..1_000_000i32),
        ) {
            let vertex = |p: [i32; 3]| Vertex {
                position: p,
                normal: OctNormal::encode(p.map(|c| c as f32 - 5e5)),
                scalars: Some(Scalars([p[1] as u16, (p[2] % 3) as u16, 0, 9])),
                colour: Some(p.map(|c| c as u8).map(|c| c ^ 3).into_iter().chain([255]).collect::<Vec<_>>().try_into().unwrap()),
            };
            prop_assume!(a[0] != b[0]);
            let plane = (a[0] + b[0]) / 2;
            prop_assert_eq!(cut_point(vertex(a), vertex(b), 0, plane), cut_point(vertex(b), vertex(a), 0, plane));
        }
    }
}
