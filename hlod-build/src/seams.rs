//! Closes the seams between the pieces that a node is gathered from.
//!
//! Cells are simplified apart, so their borders part by as much as both may be wrong: two chains of
//! open edges run side by side. They become one chain, through the vertices of both: vertices
//! that lie together are merged, every other is put into the edge that it lies beside. After that
//! simplification crosses the seam as if it had never been there.
//!
//! What this changes is known exactly and added to what triangles carry: a triangle's points are
//! matched by their barycentric coordinates, so none is farther from its match than the farthest of
//! its corners moved; an edge that is bent to a vertex moves its points by no more than the vertex
//! is from the edge. Normals, linear in the same coordinates, change by no more than the corners'.
//!
//! Vertex–vertex and vertex–edge contractions of Borodin et al., *Generalized pair contractions*
//! (2003), done before simplification instead of in its course.

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use hlod_compress::{Mesh, OctNormal};

use crate::borders::{Borders, Cube, OpenEdge};
use crate::certificate::{Carried, Deviation, largest_angle};
use crate::partition::Vertex;
use crate::simplify::Source;

/// Passes over what is still open. Each puts vertices into one edge of a triangle at most.
const PASSES: u32 = 4;

/// Vertices are merged when they are this much farther apart than the one is from the other's
/// edges, or closer than this share of the width: else both stay, with an edge between them.
const TOGETHER: f64 = 1.5;
const TOGETHER_SHARE: f64 = 0.25;

/// Closes seams narrower than `width` inside the cell, as far as no triangle comes to carry more
/// than `limit` (both in lattice steps). Borders on the cell's own faces stay as they are, but for
/// where seams end on them.
pub(crate) fn close_seams(source: &mut Source, width: f64, limit: f64, cube: &Cube) {
    for pass in 0..PASSES {
        let seams = Seams::of(&source.mesh, cube);
        if seams.borders.edges.is_empty() {
            return;
        }
        let near = seams.near_pairs(&source.mesh, width);
        let changed = if pass == 0 {
            merge_vertices(source, &seams, &near, width, limit)
                | split_edges(source, &seams, &near, limit)
        } else {
            split_edges(source, &seams, &near, limit)
        };
        if !changed {
            return;
        }
    }
}

/// A vertex of an open edge, beside another open edge.
#[derive(Clone, Copy)]
struct Near {
    /// Its position's number.
    position: u32,
    /// A vertex there.
    vertex: u32,
    /// Index of the edge.
    edge: u32,
    /// Where on the edge, from 0 to 1, the nearest point is, and how far.
    along: f64,
    distance: f64,
}

/// The open edges of a cell on faces between the pieces that it is gathered from.
struct Seams {
    borders: Borders,
    /// On which such face each position is, along each axis: a count of quarters of the cell's edge,
    /// or [`NO_FACE`].
    faces: Vec<[u8; 3]>,
}

const NO_FACE: u8 = u8::MAX;

impl Seams {
    fn of(mesh: &Mesh, cube: &Cube) -> Seams {
        let mut borders = Borders::of(mesh, cube);
        // Pieces are children and grandchildren; lattices end above where those do.
        let quarter = (cube.units / 4).max(1);
        let face_of = |p: &[i32; 3]| {
            std::array::from_fn(|i| {
                let offset = p[i].abs_diff(cube.min[i]);
                let inside = offset > 0 && offset < cube.units;
                if inside && offset.is_multiple_of(quarter) {
                    (offset / quarter) as u8
                } else {
                    NO_FACE
                }
            })
        };
        let faces: Vec<[u8; 3]> = borders.positions.iter().map(face_of).collect();
        borders.edges.retain(|e| {
            let [a, b] = e.ends.map(|p| faces[p as usize]);
            share_a_face(a, b)
        });
        Seams { borders, faces }
    }

    fn at(&self, position: u32) -> DVec3 {
        DVec3::from_array(self.borders.positions[position as usize].map(f64::from))
    }

    /// Every vertex of an open edge with every other open edge that is nearer than `width`, runs
    /// the other way and faces the same way.
    fn near_pairs(&self, mesh: &Mesh, width: f64) -> Vec<Near> {
        // Pieces of edges in a grid whose cells are as wide as an edge is long, so that a piece is
        // in few of them.
        let length = |e: &OpenEdge| self.at(e.ends[0]).distance(self.at(e.ends[1]));
        let mean =
            self.borders.edges.iter().map(length).sum::<f64>() / self.borders.edges.len() as f64;
        let spacing = mean.max(2.0 * width).max(1.0);
        let key = |p: DVec3| (p / spacing).floor().as_i64vec3();
        let mut grid: HashMap<glam::I64Vec3, Vec<u32>> = HashMap::new();
        for (i, edge) in self.borders.edges.iter().enumerate() {
            let [a, b] = edge.ends.map(|p| self.at(p));
            let pieces = (a.distance(b) / spacing).ceil().max(1.0);
            for piece in 0..pieces as u64 {
                let ends =
                    [a.lerp(b, piece as f64 / pieces), a.lerp(b, (piece + 1) as f64 / pieces)];
                let lo = key(ends[0].min(ends[1]) - width);
                let hi = key(ends[0].max(ends[1]) + width);
                for z in lo.z..=hi.z {
                    for y in lo.y..=hi.y {
                        for x in lo.x..=hi.x {
                            let cell = grid.entry(glam::I64Vec3::new(x, y, z)).or_default();
                            if cell.last() != Some(&(i as u32)) {
                                cell.push(i as u32);
                            }
                        }
                    }
                }
            }
        }
        let normal = |v: u32| Vec3::from_array(mesh.normals[v as usize].decode());
        let mut out = Vec::new();
        for own in &self.borders.edges {
            let corners = mesh.triangles[own.triangle as usize];
            let direction = self.at(own.ends[1]) - self.at(own.ends[0]);
            for end in 0..2 {
                let (position, vertex) = (own.ends[end], corners[(usize::from(own.k) + end) % 3]);
                let p = self.at(position);
                for &i in grid.get(&key(p)).into_iter().flatten() {
                    let edge = &self.borders.edges[i as usize];
                    let [a, b] = edge.ends.map(|p| self.at(p));
                    let triangle = mesh.triangles[edge.triangle as usize];
                    let on_it = edge.ends.iter().all(|&end| {
                        share_a_face(self.faces[end as usize], self.faces[position as usize])
                    });
                    if !on_it
                        || triangle
                            .iter()
                            .any(|&v| self.borders.position_of[v as usize] == position)
                        || (b - a).dot(direction) >= 0.0
                    {
                        continue;
                    }
                    let along = ((p - a).dot(b - a) / a.distance_squared(b)).clamp(0.0, 1.0);
                    let distance = p.distance(a.lerp(b, along));
                    let faces = normal(triangle[usize::from(edge.k)]).dot(normal(vertex)) > 0.0;
                    if distance <= width && faces {
                        out.push(Near { position, vertex, edge: i, along, distance });
                    }
                }
            }
        }
        // The nearest edge of each position first; a position is the end of two open edges.
        out.sort_by(|x, y| {
            let key = |n: &Near| (n.position, n.edge, n.vertex);
            x.position
                .cmp(&y.position)
                .then(x.distance.total_cmp(&y.distance))
                .then(key(x).cmp(&key(y)))
        });
        out.dedup_by_key(|n| (n.position, n.edge));
        out
    }
}

fn share_a_face(a: [u8; 3], b: [u8; 3]) -> bool {
    (0..3).any(|i| a[i] != NO_FACE && a[i] == b[i])
}

/// Merges positions that lie together; says whether there were any.
fn merge_vertices(
    source: &mut Source,
    seams: &Seams,
    near: &[Near],
    width: f64,
    limit: f64,
) -> bool {
    // Of two, the one stays that is less wrong; leaves' are not wrong at all.
    let mut wrong = vec![0.0f64; seams.borders.positions.len()];
    for (triangle, carried) in source.mesh.triangles.iter().zip(&source.carried) {
        for &v in triangle {
            let at = &mut wrong[seams.borders.position_of[v as usize] as usize];
            *at = at.max(carried.forward.distance).max(carried.backward.distance);
        }
    }
    let mut pairs: Vec<(f64, u32, u32)> = Vec::new();
    for n in near {
        for end in seams.borders.edges[n.edge as usize].ends {
            let apart = seams.at(n.position).distance(seams.at(end));
            let together = apart <= width
                && (apart <= TOGETHER * n.distance || apart <= TOGETHER_SHARE * width);
            // What is where faces meet stays there: the seams of several pieces end in it.
            if together
                && seams.faces[end as usize] == seams.faces[n.position as usize]
                && seams.borders.faces[end as usize] == seams.borders.faces[n.position as usize]
            {
                let mut pair = [n.position, end];
                pair.sort_by(|&x, &y| {
                    wrong[x as usize].total_cmp(&wrong[y as usize]).then(x.cmp(&y))
                });
                pairs.push((apart, pair[0], pair[1]));
            }
        }
    }
    pairs.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    // A position moves once, to one that does not move.
    let mut moved_to: Vec<u32> = (0..seams.borders.positions.len() as u32).collect();
    let mut stays = vec![false; seams.borders.positions.len()];
    for (_, keep, moved) in pairs {
        let keep = moved_to[keep as usize];
        let apart = seams.at(keep).distance(seams.at(moved));
        let near = apart <= width && wrong[moved as usize] + apart <= limit;
        if moved_to[moved as usize] == moved && !stays[moved as usize] && keep != moved && near {
            moved_to[moved as usize] = keep;
            stays[keep as usize] = true;
        }
    }
    // No triangle may lose its area.
    for triangle in &source.mesh.triangles {
        let at = triangle.map(|v| seams.borders.position_of[v as usize]);
        let to = at.map(|p| moved_to[p as usize]);
        if to[0] == to[1] || to[1] == to[2] || to[2] == to[0] {
            at.iter().for_each(|&p| moved_to[p as usize] = p);
        }
    }
    let on_own_face =
        (0u32..).zip(&moved_to).filter(|(p, _)| seams.borders.faces[*p as usize] != 0);
    let moves = on_own_face.map(|(p, &to)| seams.at(p).distance(seams.at(to)));
    source.border += moves.fold(0.0, f64::max);
    let mut changed = false;
    for (triangle, carried) in source.mesh.triangles.iter().zip(&mut source.carried) {
        let apart = |p: u32| seams.at(p).distance(seams.at(moved_to[p as usize]));
        let moved = triangle
            .iter()
            .map(|&v| apart(seams.borders.position_of[v as usize]))
            .fold(0.0, f64::max);
        if moved > 0.0 {
            add(carried, Deviation { distance: moved * ROUNDED_UP, angle: 0.0 });
            changed = true;
        }
    }
    for (v, position) in source.mesh.positions.iter_mut().enumerate() {
        let to = moved_to[seams.borders.position_of[v] as usize];
        *position = seams.borders.positions[to as usize];
    }
    changed
}

/// Puts each vertex into the nearest edge that it lies beside; says whether there were any.
fn split_edges(source: &mut Source, seams: &Seams, near: &[Near], limit: f64) -> bool {
    // Where vertices have moved, the edges and distances are no longer these.
    let as_before = |position: u32, vertex: u32, mesh: &Mesh| {
        mesh.positions[vertex as usize] == seams.borders.positions[position as usize]
    };
    let mut into: Vec<(u32, Near)> = Vec::new();
    let mut last = u32::MAX;
    for n in near.iter().filter(|n| n.along > 0.0 && n.along < 1.0) {
        let edge = &seams.borders.edges[n.edge as usize];
        let corners = source.mesh.triangles[edge.triangle as usize];
        let k = usize::from(edge.k);
        let still = as_before(n.position, n.vertex, &source.mesh)
            && as_before(edge.ends[0], corners[k], &source.mesh)
            && as_before(edge.ends[1], corners[(k + 1) % 3], &source.mesh);
        if still && n.position != last {
            last = n.position;
            into.push((edge.triangle, *n));
        }
    }
    // One edge of each triangle at a time, the one with the lowest number.
    into.sort_by(|(s, x), (t, y)| {
        s.cmp(t)
            .then(x.edge.cmp(&y.edge))
            .then(x.along.total_cmp(&y.along))
            .then(x.position.cmp(&y.position))
    });
    let mut changed = false;
    for of_triangle in into.chunk_by(|x, y| x.0 == y.0) {
        let edge = seams.borders.edges[of_triangle[0].1.edge as usize];
        let on_edge =
            of_triangle.iter().map(|(_, n)| *n).take_while(|n| n.edge == of_triangle[0].1.edge);
        changed |= split(source, &edge, on_edge, limit);
    }
    changed
}

/// Replaces a triangle by a fan of as many as its edge gets pieces.
fn split(
    source: &mut Source,
    edge: &OpenEdge,
    inserted: impl Iterator<Item = Near>,
    limit: f64,
) -> bool {
    let t = edge.triangle as usize;
    let (mesh, k) = (&mut source.mesh, usize::from(edge.k));
    let corners = mesh.triangles[t];
    let [a, b, apex] = [corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]];
    let at = |mesh: &Mesh, v: u32| DVec3::from_array(mesh.positions[v as usize].map(f64::from));
    let normal = |mesh: &Mesh, v: u32| Vec3::from_array(mesh.normals[v as usize].decode());
    let facing = (at(mesh, b) - at(mesh, a)).cross(at(mesh, apex) - at(mesh, a));
    let mut chain = vec![a];
    let mut deviation = Deviation::default();
    let Carried { forward, backward } = source.carried[t];
    let left = limit - forward.distance.max(backward.distance);
    for n in inserted.filter(|n| n.distance <= left) {
        let last = chain[chain.len() - 1];
        // A piece that turned over, or had no area, would not close anything.
        let p = at(mesh, n.vertex);
        let piece = |from: DVec3, to: DVec3| (to - from).cross(at(mesh, apex) - from);
        let pieces = [piece(at(mesh, last), p), piece(p, at(mesh, b))];
        if pieces.iter().any(|piece| piece.dot(facing) <= 0.0) {
            continue;
        }
        let along = n.along as f32;
        let before = normal(mesh, a).lerp(normal(mesh, b), along);
        let mut vertex = Vertex::of(mesh, n.vertex);
        if normal(mesh, n.vertex).dot(before) <= 0.0 {
            vertex.normal = OctNormal::encode(before.normalize_or(Vec3::Z).to_array());
        }
        let after = Vec3::from_array(vertex.normal.decode());
        let angle = largest_angle(
            [normal(mesh, a), normal(mesh, b), normal(mesh, apex)],
            after.distance(before),
        );
        deviation = deviation.max(Deviation { distance: n.distance * ROUNDED_UP, angle });
        chain.push(vertex.push_to(mesh));
    }
    if chain.len() == 1 {
        return false;
    }
    chain.push(b);
    let mut carried = source.carried[t];
    add(&mut carried, deviation);
    mesh.triangles[t] = [chain[0], chain[1], apex];
    source.carried[t] = carried;
    for pair in chain[1..].windows(2) {
        mesh.triangles.push([pair[0], pair[1], apex]);
        source.carried.push(carried);
    }
    true
}

/// Coordinates are integers below 2³¹, distances are right to a few units in the last place.
const ROUNDED_UP: f64 = 1.0 + 1e-9;

fn add(carried: &mut Carried, more: Deviation) {
    carried.forward = carried.forward.then(more);
    carried.backward = carried.backward.then(more);
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUBE: Cube = Cube { min: [0; 3], units: 4000 };

    /// A sheet from x = `from` to `to`, whose border at `to` (or `from`, when turned) is a chain of
    /// points (y, z).
    fn strip(x: [i32; 2], chain: &[[i32; 2]], turned: bool) -> Mesh {
        let mut mesh = Mesh::default();
        let far = if turned { x[1] } else { x[0] };
        let near = if turned { x[0] } else { x[1] };
        let (first, last) = (chain[0], chain[chain.len() - 1]);
        mesh.positions.push([far, (first[0] + last[0]) / 2, first[1]]);
        mesh.positions.extend(chain.iter().map(|&[y, z]| [near, y, z]));
        mesh.normals = vec![OctNormal::encode([0.0, 0.0, 1.0]); mesh.positions.len()];
        for k in 1..chain.len() as u32 {
            mesh.triangles.push(if turned { [0, k + 1, k] } else { [0, k, k + 1] });
        }
        mesh
    }

    fn together(parts: [Mesh; 2]) -> Source {
        let mut out = Source::default();
        for part in parts {
            let first = out.mesh.positions.len() as u32;
            out.mesh.positions.extend(&part.positions);
            out.mesh.normals.extend(&part.normals);
            out.mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|v| v + first)));
        }
        out.carried = vec![Carried::default(); out.mesh.triangles.len()];
        out
    }

    /// Open edges at x = 1000, where the strips of these tests meet.
    fn open(source: &Source) -> usize {
        let borders = Borders::of(&source.mesh, &CUBE);
        let at_seam = |p: u32| borders.positions[p as usize][0] == 1000;
        borders.edges.iter().filter(|e| e.ends.iter().all(|&p| at_seam(p))).count()
    }

    fn worst(source: &Source) -> f64 {
        source
            .carried
            .iter()
            .map(|c| c.forward.distance.max(c.backward.distance))
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_vertex_is_put_into_the_edge_that_it_lies_beside() {
        let coarse = strip([0, 1000], &[[0, 100], [2000, 100]], false);
        let fine = strip([1000, 2000], &[[0, 100], [700, 103], [1500, 98], [2000, 100]], true);
        let mut source = together([coarse, fine]);
        assert_eq!(open(&source), 4);
        close_seams(&mut source, 5.0, 100.0, &CUBE);
        assert_eq!(open(&source), 0);
        assert_eq!(source.mesh.triangles.len(), 6);
        // The coarse triangle was bent by three steps, the fine ones not at all.
        assert!((worst(&source) - 3.0).abs() < 1e-6, "{}", worst(&source));
        assert!(source.carried[1..4].iter().all(|c| *c == Carried::default()));
    }

    /// Where triangles carry too much already, the seam stays open.
    #[test]
    fn nothing_comes_to_carry_more_than_the_limit() {
        let coarse = strip([0, 1000], &[[0, 100], [2000, 100]], false);
        let fine = strip([1000, 2000], &[[0, 104], [700, 103], [2000, 100]], true);
        let mut source = together([coarse, fine]);
        for carried in &mut source.carried {
            carried.forward.distance = 8.0;
        }
        for limit in [9.0, 11.5, 16.0] {
            close_seams(&mut source, 10.0, limit, &CUBE);
            assert!(worst(&source) <= limit + 1e-6, "{} over {limit}", worst(&source));
        }
        assert_eq!(open(&source), 0);
    }

    #[test]
    fn vertices_that_lie_together_become_one() {
        let one = strip([0, 1000], &[[0, 100], [900, 110], [2000, 100]], false);
        let other = strip([1000, 2000], &[[0, 104], [902, 107], [2000, 100]], true);
        let mut source = together([one, other]);
        close_seams(&mut source, 10.0, 100.0, &CUBE);
        assert_eq!(open(&source), 0);
        assert_eq!(source.mesh.triangles.len(), 4);
        assert!((worst(&source) - 4.0).abs() < 1e-6, "{}", worst(&source));
    }

    #[test]
    fn what_is_apart_or_faces_another_way_stays_apart() {
        let one = || strip([0, 1000], &[[0, 100], [2000, 100]], false);
        let lower = strip([1000, 2000], &[[0, 80], [1000, 80], [2000, 80]], true);
        let mut source = together([one(), lower]);
        close_seams(&mut source, 15.0, 100.0, &CUBE);
        assert_eq!((open(&source), worst(&source)), (3, 0.0));
        // The other face of a thin wall: it ends here, too, but runs the same way.
        let mut back = strip([0, 1000], &[[0, 98], [1000, 98], [2000, 98]], false);
        back.normals.fill(OctNormal::encode([0.0, 0.0, -1.0]));
        back.triangles.iter_mut().for_each(|t| t.reverse());
        let mut source = together([one(), back]);
        close_seams(&mut source, 15.0, 100.0, &CUBE);
        assert_eq!((open(&source), worst(&source)), (3, 0.0));
    }

    /// The neighbouring cell closes its own seams: what lies on a face must stay as it is.
    #[test]
    fn borders_on_faces_of_the_cell_are_left_alone() {
        let coarse = strip([0, 1000], &[[0, 100], [2000, 100]], false);
        let fine = strip([1000, 2000], &[[0, 100], [700, 103], [2000, 100]], true);
        let mut source = together([coarse, fine]);
        let before = source.mesh.clone();
        close_seams(&mut source, 5.0, 100.0, &Cube { min: [1000, 0, 0], units: 4000 });
        assert_eq!(source.mesh, before);
    }
}
