//! Fills small openings inside a cell: what closing seams leaves, and holes of the scan that the node
//! is too coarse to show.
//!
//! An opening is a closed loop of open edges. It is triangulated so that the worst triangle strays
//! as little as possible from the loop (dynamic programming as by Barequet & Sharir, *Filling gaps
//! in the boundary of a polyhedron*, 1995, with this measure in place of the area), and filled where
//! that keeps every new triangle within what it may carry.
//!
//! What a new triangle carries: its points are no farther from a side that is an edge of the loop
//! than its third corner is, as distance to a segment is convex. Where two or all sides are such
//! edges, bisectors part it among them, and the farthest point, where bisectors meet or meet the
//! third side, is twice the area ÷ the length of these sides away. No point is farther from a
//! corner than the longest side ÷ √3. The surface beside the loop is as wrong as
//! its triangles say. Normals are linear between the corners, so that of a point and that of its
//! match, both combinations of the corners', differ by no more than two of the corners' do.

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use hlod_compress::Mesh;

use crate::borders::{Borders, Cube, OpenEdge};
use crate::certificate::{Carried, Deviation, largest_angle};
use crate::simplify::Source;
use crate::union::Union;

/// Loops of more edges are the scan's own borders.
const LOOP_MAX: usize = 48;

/// Fills the openings of a node's geometry, as far as no triangle comes to carry more than `limit`
/// lattice steps. Borders on the cell's own faces stay as they are.
pub(crate) fn fill_gathered(source: &mut Source, limit: f64, cube: &Cube) {
    for (edges, tear, triangles) in openings(&source.mesh, cube) {
        let beside = edges.iter().map(|e| source.carried[e.triangle as usize]);
        let beside = beside.fold(Deviation::default(), |worst, carried| {
            worst.max(carried.forward).max(carried.backward)
        });
        let carried: Vec<Deviation> = triangles
            .iter()
            .map(|&t| beside.then(Deviation { distance: tear.cost(t), angle: tear.angle(t) }))
            .collect();
        if carried.iter().all(|c| c.distance <= limit) {
            tear.fill(&triangles, &mut source.mesh);
            let both = |deviation| Carried { forward: deviation, backward: deviation };
            source.carried.extend(carried.into_iter().map(both));
        }
    }
}

/// Fills the openings of a simplified mesh whose triangles stray no more than `limit` lattice steps
/// from the loop; its certificate is yet to come.
pub(crate) fn fill_simplified(mesh: &mut Mesh, limit: f64, cube: &Cube) {
    for (_, tear, triangles) in openings(mesh, cube) {
        if triangles.iter().all(|&t| tear.cost(t) <= limit) {
            tear.fill(&triangles, mesh);
        }
    }
}

/// Loops round openings, with what would fill them.
fn openings(mesh: &Mesh, cube: &Cube) -> Vec<(Vec<OpenEdge>, Tear, Vec<[usize; 3]>)> {
    let borders = Borders::of(mesh, cube);
    let loops = loops(mesh, &borders);
    if loops.is_empty() {
        return Vec::new();
    }
    let mut pieces = Pieces::of(mesh, &borders);
    let with_filling = |edges: Vec<OpenEdge>| {
        // The outside of a small piece is a loop, too; what filled it would be the piece's back.
        if pieces.triangles_with(edges[0].ends[0]) <= 2 * edges.len() {
            return None;
        }
        let tear = Tear::of(mesh, &edges);
        let triangles = tear.triangulate()?;
        Some((edges, tear, triangles))
    };
    loops.into_iter().filter_map(with_filling).collect()
}

/// Connected pieces of a mesh, by the numbers of positions.
struct Pieces {
    union: Union,
    /// Triangles of each piece, by its root.
    triangles: Vec<usize>,
}

impl Pieces {
    fn of(mesh: &Mesh, borders: &Borders) -> Pieces {
        let count = borders.positions.len();
        let mut pieces = Pieces { union: Union::new(count), triangles: vec![0; count] };
        let at = |t: &[u32; 3]| t.map(|v| borders.position_of[v as usize]);
        for [a, b, c] in mesh.triangles.iter().map(at) {
            pieces.union.join(a, b);
            pieces.union.join(b, c);
        }
        for [a, ..] in mesh.triangles.iter().map(at) {
            let root = pieces.union.root(a);
            pieces.triangles[root as usize] += 1;
        }
        pieces
    }

    fn triangles_with(&mut self, p: u32) -> usize {
        self.triangles[self.union.root(p) as usize]
    }
}

/// Closed loops of open edges in which no position comes twice, each edge followed by the one that
/// begins where it ends.
fn loops(mesh: &Mesh, borders: &Borders) -> Vec<Vec<OpenEdge>> {
    let inside: Vec<&OpenEdge> =
        borders.edges.iter().filter(|e| borders.faces_of(e) == 0).collect();
    // Edges by where they begin; more than one begins where loops touch.
    let mut from: HashMap<u32, Vec<usize>> = HashMap::new();
    for (i, edge) in inside.iter().enumerate() {
        from.entry(edge.ends[0]).or_default().push(i);
    }
    let mut is_used = vec![false; inside.len()];
    let mut out = Vec::new();
    for first in 0..inside.len() {
        // The path from here; where it comes back to itself a loop is taken off its end.
        let mut path: Vec<usize> = Vec::new();
        let mut place_of: HashMap<u32, usize> = HashMap::new();
        let mut next = Some(first).filter(|&i| !is_used[i]);
        while let Some(edge) = next {
            is_used[edge] = true;
            place_of.insert(inside[edge].ends[0], path.len());
            path.push(edge);
            let end = inside[edge].ends[1];
            if let Some(&place) = place_of.get(&end) {
                let taken = path.split_off(place);
                taken.iter().for_each(|&i| {
                    place_of.remove(&inside[i].ends[0]);
                });
                if (3..=LOOP_MAX).contains(&taken.len()) {
                    out.push(taken.into_iter().map(|i| *inside[i]).collect());
                }
            }
            let on = from.get(&end).into_iter().flatten().copied().filter(|&i| !is_used[i]);
            // Where openings touch, on round the one that this edge borders.
            let turn = |&i: &usize| turn(mesh, borders, inside[edge], inside[i].ends[1]);
            next = on.min_by(|a, b| turn(a).total_cmp(&turn(b)));
        }
    }
    out
}

/// The angle, in radians, through the opening beside an edge, from the edge to the one that leads from
/// its end to `to`.
fn turn(mesh: &Mesh, borders: &Borders, edge: &OpenEdge, to: u32) -> f64 {
    let at = |p: u32| DVec3::from_array(borders.positions[p as usize].map(f64::from));
    let [from, here] = edge.ends;
    let corner = mesh.triangles[edge.triangle as usize][(usize::from(edge.k) + 1) % 3];
    let normal = Vec3::from_array(mesh.normals[corner as usize].decode()).as_dvec3();
    // The surface is on the edge's left, the opening on the left of who looks back.
    let (back, on) = (at(from) - at(here), at(to) - at(here));
    let angle = normal.dot(back.cross(on)).atan2(back.dot(on) - normal.dot(back) * normal.dot(on));
    if angle <= 0.0 { angle + std::f64::consts::TAU } else { angle }
}

/// An opening: its corners in the order in which a triangle that fills it has them.
struct Tear {
    vertices: Vec<u32>,
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
}

impl Tear {
    fn of(mesh: &Mesh, edges: &[OpenEdge]) -> Tear {
        // Against the direction of the triangles beside it.
        let corner = |e: &OpenEdge| mesh.triangles[e.triangle as usize][usize::from(e.k)];
        let vertices: Vec<u32> = edges.iter().rev().map(corner).collect();
        let position = |&v: &u32| DVec3::from_array(mesh.positions[v as usize].map(f64::from));
        let normal = |&v: &u32| Vec3::from_array(mesh.normals[v as usize].decode());
        Tear {
            positions: vertices.iter().map(position).collect(),
            normals: vertices.iter().map(normal).collect(),
            vertices,
        }
    }

    fn fill(&self, triangles: &[[usize; 3]], mesh: &mut Mesh) {
        mesh.triangles.extend(triangles.iter().map(|t| t.map(|i| self.vertices[i])));
    }

    /// How far points of a triangle may be from the loop, in lattice steps; infinite for one without
    /// an area.
    fn cost(&self, [i, j, k]: [usize; 3]) -> f64 {
        let n = self.vertices.len();
        let p = [i, j, k].map(|i| self.positions[i]);
        let double_area = (p[1] - p[0]).cross(p[2] - p[0]).length();
        if double_area == 0.0 {
            return f64::INFINITY;
        }
        let sides: [f64; 3] = std::array::from_fn(|s| p[s].distance(p[(s + 1) % 3]));
        let is_border = [(i, j), (j, k), (k, i)].map(|(a, b)| (a + 1) % n == b);
        // From the side s, the third corner; from a segment, not its line.
        let height = |s: usize| {
            let (along, away) = (p[(s + 1) % 3] - p[s], p[(s + 2) % 3] - p[s]);
            let t = (away.dot(along) / along.length_squared()).clamp(0.0, 1.0);
            (away - along * t).length()
        };
        let is_acute = |c: usize| (p[(c + 1) % 3] - p[c]).dot(p[(c + 2) % 3] - p[c]) >= 0.0;
        let borders = || (0..3).filter(|&s| is_border[s]);
        let by_height = borders().map(height).fold(f64::INFINITY, f64::min);
        let length: f64 = borders().map(|s| sides[s]).sum();
        let by_area = match borders().count() {
            3 => double_area / length,
            // The third side is opposite the corner that both have; its own corners must not be
            // obtuse, or feet of perpendiculars fall beside the borders.
            2 if (0..3).all(|s| is_border[s] || is_acute(s) && is_acute((s + 1) % 3)) => {
                double_area / length
            }
            _ => f64::INFINITY,
        };
        let longest = sides.into_iter().fold(0.0, f64::max);
        by_height.min(by_area).min(longest / 3f64.sqrt()) * ROUNDED_UP
    }

    fn angle(&self, triangle: [usize; 3]) -> f32 {
        let [a, b, c] = triangle.map(|i| self.normals[i]);
        let apart = a.distance(b).max(b.distance(c)).max(c.distance(a));
        largest_angle([a, b, c], apart)
    }

    /// The triangulation whose largest cost is smallest; none where every one has a triangle without
    /// an area.
    fn triangulate(&self) -> Option<Vec<[usize; 3]>> {
        let n = self.vertices.len();
        // Of the corners from i to k: the largest cost, and the third corner of the triangle on i–k.
        let mut best = vec![(0.0f64, 0usize); n * n];
        for width in 2..n {
            for i in 0..n - width {
                let k = i + width;
                best[i * n + k] = (i + 1..k)
                    .map(|j| {
                        let parts = best[i * n + j].0.max(best[j * n + k].0);
                        (parts.max(self.cost([i, j, k])), j)
                    })
                    .min_by(|x, y| x.0.total_cmp(&y.0))
                    .unwrap_or((f64::INFINITY, i));
            }
        }
        let mut out = Vec::with_capacity(n - 2);
        let mut open = vec![(0, n - 1)];
        while let Some((i, k)) = open.pop() {
            if k > i + 1 {
                let j = best[i * n + k].1;
                out.push([i, j, k]);
                open.extend([(i, j), (j, k)]);
            }
        }
        best[n - 1].0.is_finite().then_some(out)
    }
}

/// Coordinates are integers below 2³¹, distances are right to a few units in the last place.
const ROUNDED_UP: f64 = 1.0 + 1e-9;

#[cfg(test)]
mod tests {
    use hlod_compress::OctNormal;

    use super::*;

    const CUBE: Cube = Cube { min: [0; 3], units: 4000 };

    /// A sheet of `n` × `n` squares of 100 steps without some of them, well inside the cube.
    fn sheet(n: u32, without: &[[u32; 2]]) -> Source {
        let mut mesh = Mesh::default();
        for y in 0..=n {
            for x in 0..=n {
                mesh.positions.push([500 + 100 * x as i32, 500 + 100 * y as i32, 700]);
                mesh.normals.push(OctNormal::encode([0.0, 0.0, 1.0]));
            }
        }
        let at = |x: u32, y: u32| y * (n + 1) + x;
        for y in 0..n {
            for x in 0..n {
                if !without.contains(&[x, y]) {
                    mesh.triangles.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
                    mesh.triangles.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
                }
            }
        }
        let carried = vec![Carried::default(); mesh.triangles.len()];
        Source { mesh, carried, ..Source::default() }
    }

    fn open(source: &Source) -> usize {
        Borders::of(&source.mesh, &CUBE).edges.len()
    }

    #[test]
    fn small_openings_are_filled_and_the_border_stays() {
        let mut source = sheet(14, &[[3, 3], [8, 8], [9, 8], [9, 9]]);
        let (whole, before) = (sheet(14, &[]), source.mesh.triangles.len());
        assert_eq!(open(&source), 14 * 4 + 4 + 8);
        // A square of 100 steps falls into halves with two sides of its loop: 50 steps.
        fill_gathered(&mut source, 60.0, &CUBE);
        assert_eq!(open(&source), 14 * 4 + 8);
        fill_gathered(&mut source, 85.0, &CUBE);
        assert_eq!(open(&source), 14 * 4);
        assert_eq!(source.mesh.triangles.len(), whole.mesh.triangles.len());
        let area_of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| source.mesh.positions[v as usize]);
            let cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            f64::from(cross) / 2.0
        };
        let area: f64 = source.mesh.triangles.iter().map(area_of).sum();
        assert_eq!(area, 1400.0 * 1400.0, "filled once, facing as the sheet does");
        for carried in &source.carried[before..] {
            assert!(carried.backward.distance > 49.0 && carried.backward.distance <= 85.0);
            assert!(carried.backward.angle < 1e-3);
        }
    }

    #[test]
    fn what_would_carry_too_much_stays_open() {
        let mut source = sheet(6, &[[2, 2]]);
        let before = source.mesh.triangles.len();
        fill_gathered(&mut source, 40.0, &CUBE);
        assert_eq!(source.mesh.triangles.len(), before);
        source.carried.iter_mut().for_each(|c| c.backward.distance = 30.0);
        fill_gathered(&mut source, 70.0, &CUBE);
        assert_eq!(source.mesh.triangles.len(), before);
        fill_gathered(&mut source, 90.0, &CUBE);
        assert_eq!(source.mesh.triangles.len(), before + 2);
    }

    /// No point of a triangle is farther from its borders than its cost says, as samples see it.
    #[test]
    fn costs_hold_for_triangles_of_every_shape() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64 * 100.0
        };
        let mut tightest = f64::INFINITY;
        for round in 0..3000 {
            // A triangle is all of its loop; of a longer loop it has one or two edges, or none.
            let n = 3 + round % 4;
            let positions: Vec<DVec3> =
                (0..n).map(|_| DVec3::new(random(), random(), 0.02 * random())).collect();
            let normals = vec![Vec3::Z; n];
            let tear = Tear { vertices: (0..n as u32).collect(), positions, normals };
            let triangle = if n == 6 { [0, 2, 4] } else { [0, 1, 2] };
            let borders: Vec<[usize; 2]> = (0..3)
                .map(|s| [triangle[s], triangle[(s + 1) % 3]])
                .filter(|[a, b]| (a + 1) % n == *b)
                .collect();
            let corners = triangle.map(|i| tear.positions[i]);
            let mut farthest = 0.0f64;
            for (u, v) in (0..=40).flat_map(|u| (0..=40 - u).map(move |v| (u, v))) {
                let w = [u, v, 40 - u - v].map(|w| f64::from(w) / 40.0);
                let q = corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
                let to_corner = corners.iter().map(|c| c.distance(q)).fold(f64::INFINITY, f64::min);
                let to_border = borders.iter().map(|&[a, b]| {
                    let (a, b) = (tear.positions[a], tear.positions[b]);
                    let t = ((q - a).dot(b - a) / a.distance_squared(b)).clamp(0.0, 1.0);
                    q.distance(a.lerp(b, t))
                });
                farthest = farthest.max(to_border.fold(to_corner, f64::min));
            }
            let cost = tear.cost(triangle);
            assert!(farthest <= cost, "{farthest} beyond {cost}: {:?}", tear.positions);
            tightest = tightest.min(cost / farthest);
        }
        assert!(tightest < 1.1, "{tightest}");
    }

    #[test]
    fn openings_that_touch_in_a_corner_are_two() {
        let mut source = sheet(6, &[[2, 2], [3, 3]]);
        fill_gathered(&mut source, 90.0, &CUBE);
        assert_eq!(open(&source), 6 * 4);
        assert_eq!(source.mesh.triangles.len(), sheet(6, &[]).mesh.triangles.len());
    }

    /// The outside of a small piece is a loop, too, but no opening.
    #[test]
    fn pieces_get_no_backs() {
        let mut source = sheet(2, &[[0, 1], [1, 0], [1, 1]]);
        let before = source.mesh.clone();
        fill_gathered(&mut source, 1000.0, &CUBE);
        assert_eq!(source.mesh, before);
    }

    /// A slit is long, but none of its points is far from its sides.
    #[test]
    fn slits_cost_what_they_are_wide() {
        let mut source = sheet(8, &[]);
        // The row of vertices at y = 4 is doubled: the upper squares go down by 2 less.
        let first = source.mesh.positions.len() as u32;
        for x in 1..8u32 {
            let v = (4 * 9 + x) as usize;
            let [px, py, pz] = source.mesh.positions[v];
            source.mesh.positions.push([px, py + 2, pz]);
            source.mesh.normals.push(source.mesh.normals[v]);
        }
        for t in source.mesh.triangles.iter_mut().filter(|t| t.iter().max() > Some(&(5 * 9 - 1))) {
            *t = t.map(|v| if (37..44).contains(&v) { first + v - 37 } else { v });
        }
        assert_eq!(open(&source), 8 * 4 + 16);
        let before = source.mesh.triangles.len();
        fill_gathered(&mut source, 2.1, &CUBE);
        assert_eq!(open(&source), 8 * 4);
        assert!(source.carried[before..].iter().all(|c| c.backward.distance <= 2.1));
    }
}
