//! What is odd about a scan, counted in its leaves.

use std::collections::HashSet;

use hlod_compress::Mesh;
use serde::Serialize;

use crate::borders::Cube;

/// What is odd about a scan's triangles: all of it is built as it is. Keys are stable.
///
/// Counted leaf by leaf, after triangles are cut: what lies in several leaves counts in each. Edges
/// on the faces of leaves are cuts, not the scan's, and do not count.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Oddities {
    /// Triangles with the same three corners as another.
    pub triangles_duplicate: u64,
    /// Edges of one triangle: the borders of holes and of open scans.
    pub edges_open: u64,
    /// Edges whose two triangles face opposite ways.
    pub edges_inverted: u64,
    /// Edges of three triangles and more.
    pub edges_nonmanifold: u64,
}

impl Oddities {
    pub(crate) fn of_leaf(mesh: &Mesh, cube: &Cube) -> Oddities {
        let mut out = Oddities::default();
        let mut seen = HashSet::with_capacity(mesh.triangles.len());
        // Each edge's lower end, upper end and whether it runs downwards.
        let mut edges: Vec<([i32; 3], [i32; 3], bool)> = Vec::new();
        for t in &mesh.triangles {
            let corners = t.map(|v| mesh.positions[v as usize]);
            let mut sorted = corners;
            sorted.sort_unstable();
            if !seen.insert(sorted) {
                out.triangles_duplicate += 1;
                continue;
            }
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                if cube.faces(a) & cube.faces(b) == 0 {
                    edges.push((a.min(b), a.max(b), a > b));
                }
            }
        }
        edges.sort_unstable();
        for same in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            match same {
                [_] => out.edges_open += 1,
                [a, b] => out.edges_inverted += u64::from(a.2 == b.2),
                _ => out.edges_nonmanifold += 1,
            }
        }
        out
    }

    pub(crate) fn plus(self, other: Oddities) -> Oddities {
        Oddities {
            triangles_duplicate: self.triangles_duplicate + other.triangles_duplicate,
            edges_open: self.edges_open + other.edges_open,
            edges_inverted: self.edges_inverted + other.edges_inverted,
            edges_nonmanifold: self.edges_nonmanifold + other.edges_nonmanifold,
        }
    }

    /// As an array of plain numbers, and back.
    pub(crate) fn to_array(self) -> [u64; 4] {
        [self.triangles_duplicate, self.edges_open, self.edges_inverted, self.edges_nonmanifold]
    }

    pub(crate) fn from_array(array: [u64; 4]) -> Oddities {
        let [triangles_duplicate, edges_open, edges_inverted, edges_nonmanifold] = array;
        Oddities { triangles_duplicate, edges_open, edges_inverted, edges_nonmanifold }
    }
}

#[cfg(test)]
mod tests {
    use hlod_compress::OctNormal;

    use super::*;

    const CUBE: Cube = Cube { min: [0; 3], units: 100 };

    fn count(triangles: &[[[i32; 3]; 3]]) -> Oddities {
        let mut mesh = Mesh::default();
        for t in triangles {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(t);
            mesh.normals.extend([OctNormal::default(); 3]);
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        Oddities::of_leaf(&mesh, &CUBE)
    }

    #[test]
    fn each_oddity_is_counted_once() {
        let [a, b, c, d, e] = [[9, 9, 9], [20, 9, 9], [9, 20, 9], [9, 9, 20], [30, 30, 30]];
        let closed = [[a, c, b], [a, b, d], [b, c, d], [c, a, d]];
        assert_eq!(count(&closed), Oddities::default());
        let mut open = closed.to_vec();
        open.pop();
        assert_eq!(count(&open), Oddities { edges_open: 3, ..Oddities::default() });
        let mut inverted = closed.to_vec();
        inverted[0].reverse();
        assert_eq!(count(&inverted), Oddities { edges_inverted: 3, ..Oddities::default() });
        let mut fin = closed.to_vec();
        fin.push([a, b, e]);
        let expected = Oddities { edges_nonmanifold: 1, edges_open: 2, ..Oddities::default() };
        assert_eq!(count(&fin), expected);
        let mut twice = closed.to_vec();
        twice.push([c, b, a]);
        assert_eq!(count(&twice), Oddities { triangles_duplicate: 1, ..Oddities::default() });
        // Where a leaf ends, its surface goes on in another.
        assert_eq!(count(&[[[0, 5, 5], [0, 5, 9], [9, 5, 5]]]).edges_open, 2);
    }
}
