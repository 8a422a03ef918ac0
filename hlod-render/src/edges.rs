//! Which triangles are neighbours: what makes silhouettes of edges.

use std::collections::HashMap;

use hlod_compress::Mesh;

/// No triangle, or several, across an edge.
pub(crate) const NO_VERTEX: u32 = u32::MAX;

/// For each edge of each triangle, from a corner to the next, the vertex across it in the one other
/// triangle that has it the other way round; [`NO_VERTEX`] where there is none, or several. Vertices
/// that differ in their normals alone do not part a surface.
pub(crate) fn across(mesh: &Mesh) -> Vec<u32> {
    // One number a position.
    let mut first_at: HashMap<[i32; 3], u32> = HashMap::with_capacity(mesh.positions.len());
    let place: Vec<u32> =
        mesh.positions.iter().zip(0..).map(|(p, v)| *first_at.entry(*p).or_insert(v)).collect();
    const SEVERAL: u32 = NO_VERTEX - 1;
    let mut opposite: HashMap<[u32; 2], u32> = HashMap::with_capacity(3 * mesh.triangles.len());
    let edges = |t: &[u32; 3]| {
        let t = *t;
        (0..3).map(move |k| ([t[k], t[(k + 1) % 3]], t[(k + 2) % 3]))
    };
    for t in &mesh.triangles {
        for (edge, other) in edges(t) {
            let key = edge.map(|v| place[v as usize]);
            opposite.entry(key).and_modify(|o| *o = SEVERAL).or_insert(other);
        }
    }
    let mut out = Vec::with_capacity(3 * mesh.triangles.len());
    for t in &mesh.triangles {
        for (edge, _) in edges(t) {
            let [a, b] = edge.map(|v| place[v as usize]);
            let alone = opposite.get(&[a, b]) != Some(&SEVERAL);
            let other = opposite.get(&[b, a]).copied().filter(|&o| alone && o != SEVERAL);
            out.push(other.unwrap_or(NO_VERTEX));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use hlod_compress::OctNormal;

    use super::*;

    #[test]
    fn neighbours_are_found_across_edges_whatever_their_normals() {
        // A square of two triangles, with a vertex that both have for themselves; a third triangle
        // on the edge from 0 to 1.
        let positions =
            vec![[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0], [0, 0, 0], [4, -9, 0], [4, 0, 9]];
        let triangles = vec![[0, 1, 2], [4, 2, 3], [1, 0, 5], [1, 4, 6]];
        let normals = vec![OctNormal::encode([0.0, 0.0, 1.0]); 7];
        let mesh = Mesh { positions, normals, colours: Vec::new(), triangles };
        const NO: u32 = NO_VERTEX;
        let expected = [NO, NO, 3, 1, NO, NO, NO, NO, NO, NO, NO, NO];
        assert_eq!(across(&mesh), expected);
    }
}
