//! Where the geometry of one cell ends: edges that only one triangle has, and those on the cell's faces that several have
//! while the surface does not go on within the face. There sheets lie on each other, which end on the face each for
//! itself: the cell beside has what belongs to both, and need not have them on each other.

use std::collections::HashMap;

use hlod_compress::Mesh;

/// The cube that a node's geometry lies in, in lattice steps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cube {
    pub(crate) min: [i32; 3],
    pub(crate) units: u32,
}

impl Cube {
    /// The faces that a position lies on: bit `axis` for the lower, `3 + axis` for the upper.
    pub(crate) fn faces(&self, p: [i32; 3]) -> u8 {
        (0..3).fold(0, |bits, i| {
            let offset = p[i].abs_diff(self.min[i]);
            bits | (u8::from(offset == 0) << i) | (u8::from(offset == self.units) << (3 + i))
        })
    }
}

/// An edge in which a surface ends, from corner `k` of a triangle, the first that has it, to corner `k + 1`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OpenEdge {
    pub(crate) triangle: u32,
    pub(crate) k: u8,
    /// Numbers of the positions of its ends.
    pub(crate) ends: [u32; 2],
}

/// The open edges of a mesh, by positions: vertices that differ in their normals alone do not part a
/// surface.
pub(crate) struct Borders {
    pub(crate) edges: Vec<OpenEdge>,
    /// Number of each vertex' position.
    pub(crate) position_of: Vec<u32>,
    pub(crate) positions: Vec<[i32; 3]>,
    /// [`Cube::faces`] of each position.
    pub(crate) faces: Vec<u8>,
}

impl Borders {
    pub(crate) fn of(mesh: &Mesh, cube: &Cube) -> Borders {
        let mut number_of: HashMap<[i32; 3], u32> = HashMap::with_capacity(mesh.positions.len());
        let mut positions = Vec::new();
        let position_of: Vec<u32> = mesh
            .positions
            .iter()
            .map(|p| {
                *number_of.entry(*p).or_insert_with(|| {
                    positions.push(*p);
                    positions.len() as u32 - 1
                })
            })
            .collect();
        let faces: Vec<u8> = positions.iter().map(|p| cube.faces(*p)).collect();
        let mut edges = Vec::with_capacity(3 * mesh.triangles.len());
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let at = triangle.map(|v| position_of[v as usize]);
            for k in 0..3 {
                let ends = [at[k], at[(k + 1) % 3]];
                edges.push(OpenEdge { triangle: t as u32, k: k as u8, ends });
            }
        }
        let undirected = |e: &OpenEdge| [e.ends[0].min(e.ends[1]), e.ends[0].max(e.ends[1])];
        edges.sort_unstable_by_key(|e| (undirected(e), e.triangle, e.k));
        let common = |e: &OpenEdge| faces[e.ends[0] as usize] & faces[e.ends[1] as usize];
        let is_in_face = |e: &OpenEdge| {
            let third = mesh.triangles[e.triangle as usize][(usize::from(e.k) + 2) % 3];
            common(e) & faces[position_of[third as usize] as usize] != 0
        };
        let edges = edges
            .chunk_by(|a, b| undirected(a) == undirected(b))
            .filter_map(|same| match same {
                [edge] => Some(*edge),
                [edge, ..] if common(edge) != 0 && !same.iter().any(is_in_face) => Some(*edge),
                _ => None,
            })
            .collect();
        Borders { edges, position_of, positions, faces }
    }

    /// The faces of the cube that an edge lies on.
    pub(crate) fn faces_of(&self, edge: &OpenEdge) -> u8 {
        self.faces[edge.ends[0] as usize] & self.faces[edge.ends[1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ends of the open edges of triangles in a cube of 10 steps.
    fn open(triangles: &[[[i32; 3]; 3]]) -> Vec<[[i32; 3]; 2]> {
        let positions: Vec<[i32; 3]> = triangles.as_flattened().to_vec();
        let normals = vec![hlod_compress::OctNormal::encode([0.0, 0.0, 1.0]); positions.len()];
        let triangles =
            (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let mesh = Mesh { positions, normals, triangles, ..Mesh::default() };
        let borders = Borders::of(&mesh, &Cube { min: [0; 3], units: 10 });
        borders.edges.iter().map(|e| e.ends.map(|p| borders.positions[p as usize])).collect()
    }

    #[test]
    fn sheets_on_each_other_end_on_a_face_and_what_goes_on_does_not() {
        let (a, b, up, down) = ([2, 0, 3], [6, 0, 3], [4, 5, 5], [4, 5, 1]);
        let on_face = [a, b];
        assert!(open(&[[a, b, up]]).contains(&on_face));
        // A fold that touches the face, and one sheet twice.
        assert!(open(&[[a, b, up], [b, a, down]]).contains(&on_face));
        assert_eq!(open(&[[a, b, up], [a, b, up]]), [on_face]);
        // A surface that goes on in the face.
        let in_face = [4, 0, 8];
        assert!(!open(&[[a, b, up], [b, a, in_face]]).contains(&on_face));
        // Well inside, what two triangles have is no border.
        let [a, b, up, down] = [a, b, up, down].map(|[x, y, z]| [x, y + 2, z]);
        assert!(!open(&[[a, b, up], [b, a, down]]).contains(&[a, b]));
    }
}
