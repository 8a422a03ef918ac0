//! Skirts: what keeps the seams between drawn nodes closed, whatever their depths.
//!
//! The surface in a cell ends on the cell's faces, in lines that are simplified *in* these faces. How
//! far a node's lines are there from the scan's own sections is measured when they are simplified,
//! level upon level, and stored as the node's border error (`deviation` in
//! `hlod-build/src/simplify/chains.rs`): a bound of the two-sided Hausdorff distance within the
//! face. So between two nodes that are drawn side by side, of whatever depths, there is at most a
//! slit in their common face that is as wide as both their border errors together. Every border line
//! carries a strip in the face, into the body, that reaches as far as twice the largest border error
//! of the nodes that are drawn, in pixels or in the model's unit, whichever is less there: it covers the slit.
//!
//! Where one border lies above the other its strip reaches past the other, so that no line of sight
//! gets through; and a strip that goes only inwards moves no outline of a body that is thicker.
//!
//! Where several triangles have an edge that lies in a face, and none of them lies in the face itself, sheets lie on each
//! other there, each with a border: beside them, in another depth, they may be apart. Each carries its strip, so that what
//! is between them is covered from both.
//!
//! Components smaller than the node's budget e/R have no strips: they may vanish as a whole, and a
//! strip would be larger than they are.
//!
//! Nodes of equal depth end in the same vertices, and their strips are hidden behind both. Of two
//! leaves of different depth the finer is cut where the coarser is not, and rounded there: by less
//! than the two steps of the lattice that are added everywhere.
//!
//! A strip needs no vertices of its own: it names those of the border twice, the second time marked
//! to be moved inwards by the vertex shader, which alone knows how far (`shared.wgsl`).

use std::collections::{BTreeMap, HashMap};

use hlod_compress::{CellKey, Lattice, Mesh};

/// Set in an index whose vertex is to be moved inwards, in the face across the axis that the two bits
/// below say.
pub const MOVED: u32 = 1 << 31;
/// Where those two bits are.
pub const AXIS_SHIFT: u32 = 29;
/// Vertices of a buffer have smaller numbers.
pub const VERTICES_MAX: u32 = 1 << AXIS_SHIFT;

/// An edge that runs in a face of the cell.
struct Edge {
    /// Numbers of its vertices in the triangle's direction.
    vertices: [u32; 2],
    axis: u32,
}

/// The edges between two positions in a face, one for each triangle that has it.
#[derive(Default)]
struct Here {
    first: Option<Edge>,
    /// Mostly none.
    others: Vec<Edge>,
    /// Whether any of these triangles lies in the face.
    goes_on: bool,
}

/// Three indices for each triangle of the strips along the borders of a cell's geometry; `budget` is
/// e/R in lattice steps.
pub(crate) fn skirts(mesh: &Mesh, cell: CellKey, lattice: &Lattice, budget: f64) -> Vec<u32> {
    let (min, units) = (lattice.cell_min(cell), lattice.cell_units(cell.depth()));
    // The faces that a vertex lies on: bit `axis` for the lower, `3 + axis` for the upper.
    let faces = |p: [i32; 3]| -> u8 {
        (0..3).fold(0, |bits, i| {
            let offset = p[i].abs_diff(min[i]);
            bits | (u8::from(offset == 0) << i) | (u8::from(offset == units) << (3 + i))
        })
    };
    let faces: Vec<u8> = mesh.positions.iter().map(|p| faces(*p)).collect();
    // By positions: vertices that differ in their normals alone do not part a surface.
    let mut edges: HashMap<[[i32; 3]; 2], Here> = HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let [a, b, c] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
            let common = faces[a as usize] & faces[b as usize];
            if common == 0 {
                continue;
            }
            let [p, q] = [mesh.positions[a as usize], mesh.positions[b as usize]];
            let edge = Edge { vertices: [a, b], axis: common.trailing_zeros() % 3 };
            let goes_on = common & faces[c as usize] != 0;
            let here = edges.entry([p.min(q), p.max(q)]).or_default();
            here.goes_on |= goes_on;
            match &here.first {
                None => here.first = Some(edge),
                Some(_) => here.others.push(edge),
            }
        }
    }
    // A surface that goes on within the face has no border there.
    let borders = edges.into_values().filter(|here| here.others.is_empty() || !here.goes_on);
    let mut borders: Vec<Edge> =
        borders.flat_map(|here| here.first.into_iter().chain(here.others)).collect();
    if !borders.is_empty() {
        let is_small = small_components(mesh, budget);
        borders.retain(|edge| !is_small[edge.vertices[0] as usize]);
    }
    borders.sort_unstable_by_key(|edge| edge.vertices);
    let moved = |v: u32, axis: u32| v | MOVED | axis << AXIS_SHIFT;
    let mut indices = Vec::with_capacity(6 * borders.len());
    // The moved corners at each position: several where vertices there differ in their normals, or
    // where faces meet.
    let mut corners: BTreeMap<[i32; 3], Vec<u32>> = BTreeMap::new();
    for Edge { vertices: [a, b], axis } in borders {
        // Their fronts face out of the cell.
        indices.extend([a, moved(a, axis), b, b, moved(a, axis), moved(b, axis)]);
        for v in [a, b] {
            corners.entry(mesh.positions[v as usize]).or_default().push(moved(v, axis));
        }
    }
    for mut here in corners.into_values() {
        here.sort_unstable();
        here.dedup();
        // Strips that part from one another are joined, from either side.
        for pair in here.windows(2) {
            let top = pair[0] & (VERTICES_MAX - 1);
            indices.extend([top, pair[0], pair[1], top, pair[1], pair[0]]);
        }
    }
    indices
}

/// Whether each vertex is of a component whose bounds have a diagonal of at most `budget`.
fn small_components(mesh: &Mesh, budget: f64) -> Vec<bool> {
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    let count = mesh.positions.len();
    let mut first_at: HashMap<[i32; 3], u32> = HashMap::with_capacity(count);
    let mut parent: Vec<u32> =
        mesh.positions.iter().zip(0..).map(|(p, v)| *first_at.entry(*p).or_insert(v)).collect();
    for t in &mesh.triangles {
        for k in 1..3 {
            let (a, b) = (root(&mut parent, t[0]), root(&mut parent, t[k]));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut bounds = vec![([i32::MAX; 3], [i32::MIN; 3]); count];
    for (v, p) in (0u32..).zip(&mesh.positions) {
        let (lo, hi) = &mut bounds[root(&mut parent, v) as usize];
        *lo = std::array::from_fn(|i| lo[i].min(p[i]));
        *hi = std::array::from_fn(|i| hi[i].max(p[i]));
    }
    let is_small = |v: u32| {
        let (lo, hi) = bounds[root(&mut parent, v) as usize];
        let squares = (0..3).map(|i| (f64::from(hi[i]) - f64::from(lo[i])).powi(2));
        squares.sum::<f64>() <= budget * budget
    };
    (0..count as u32).map(is_small).collect()
}

#[cfg(test)]
mod tests {
    use hlod_compress::OctNormal;

    use super::*;

    #[test]
    fn borders_on_faces_get_strips_and_nothing_else_does() {
        let lattice = Lattice::enclosing([0.0; 3], [64.0; 3], 1.0);
        let cell = CellKey::ROOT.child(0);
        let units = lattice.cell_units(1) as i32;
        // A square in the plane z = 5 across the cell, but open towards a border of its own at
        // y = 9: edges on the faces x = 0, x = units and y = 0, which meet in two corners.
        let positions = vec![[0, 0, 5], [units, 0, 5], [units, 9, 5], [0, 9, 5]];
        let normals = vec![OctNormal::encode([0.0, 0.0, 1.0]); 4];
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let mesh = Mesh { positions, normals, triangles, ..Mesh::default() };
        assert!(skirts(&mesh, cell, &lattice, 2.0 * f64::from(units)).is_empty(), "too small");
        let indices = skirts(&mesh, cell, &lattice, 1.0);
        let moved = |v: u32, axis: u32| v | MOVED | axis << AXIS_SHIFT;
        let of =
            |a: u32, b: u32, axis: u32| [a, moved(a, axis), b, b, moved(a, axis), moved(b, axis)];
        let corner = |v: u32| {
            let [p, q] = [moved(v, 0), moved(v, 1)];
            [v, p, q, v, q, p]
        };
        let expected = [of(0, 1, 1), of(1, 2, 0), of(3, 0, 0), corner(0), corner(1)].concat();
        assert_eq!(indices, expected);
    }

    #[test]
    fn sheets_on_each_other_carry_a_strip_each() {
        let lattice = Lattice::enclosing([0.0; 3], [64.0; 3], 1.0);
        let cell = CellKey::ROOT.child(0);
        // A fold whose two sheets meet in an edge of the face z = 0.
        let corners = [[2, 3, 0], [9, 3, 0], [5, 3, 6], [5, 8, 6]];
        let strips_of = |triangles: &[[u32; 3]], positions: &[[i32; 3]]| {
            let normals = vec![OctNormal::encode([0.0, 1.0, 0.0]); positions.len()];
            let (positions, triangles) = (positions.to_vec(), triangles.to_vec());
            let mesh = Mesh { positions, normals, triangles, ..Mesh::default() };
            skirts(&mesh, cell, &lattice, 0.0).len() / 6
        };
        assert_eq!(strips_of(&[[0, 1, 2]], &corners), 1);
        assert_eq!(strips_of(&[[0, 1, 2], [1, 0, 3]], &corners), 2);
        // The surface goes on within the face, and ends in it twice.
        let corners = [[2, 3, 0], [9, 3, 0], [5, 3, 6], [5, 8, 0]];
        assert_eq!(strips_of(&[[0, 1, 2], [1, 0, 3]], &corners), 2);
    }
}
