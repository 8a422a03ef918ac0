//! Which triangles are neighbours: what makes silhouettes of edges.

use hlod_compress::Mesh;

/// No triangle, or several, across an edge.
pub(crate) const NO_VERTEX: u32 = u32::MAX;

/// For each edge of each triangle, from a corner to the next, the vertex across it in the one other
/// triangle that has it the other way round; [`NO_VERTEX`] where there is none, or several. Vertices
/// that differ in their normals alone do not part a surface.
pub(crate) fn across(mesh: &Mesh) -> Vec<u32> {
    // One number a position: that of the first vertex there.
    let mut by_position: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    by_position.sort_unstable_by_key(|&v| (mesh.positions[v as usize], v));
    let mut place = vec![0; mesh.positions.len()];
    for same in
        by_position.chunk_by(|&a, &b| mesh.positions[a as usize] == mesh.positions[b as usize])
    {
        same.iter().for_each(|&v| place[v as usize] = same[0]);
    }

    // Half-edges by where they begin; there are few at each place, so that lists beat a table.
    let corners = mesh.triangles.as_flattened();
    let next = |h: usize| if h % 3 == 2 { h - 2 } else { h + 1 };
    let from = |h: usize| place[corners[h] as usize] as usize;
    let mut begins = vec![0u32; mesh.positions.len() + 1];
    (0..corners.len()).for_each(|h| begins[from(h) + 1] += 1);
    for v in 1..begins.len() {
        begins[v] += begins[v - 1];
    }
    let mut filled = begins.clone();
    let mut leaving = vec![0u32; corners.len()];
    for h in 0..corners.len() {
        let at = &mut filled[from(h)];
        leaving[*at as usize] = h as u32;
        *at += 1;
    }
    // The one half-edge between two places, if it is one.
    let between = |a: usize, b: usize| {
        let mut found = leaving[begins[a] as usize..begins[a + 1] as usize]
            .iter()
            .map(|&h| h as usize)
            .filter(|&h| from(next(h)) == b);
        found.next().filter(|_| found.next().is_none())
    };
    let across = |h: usize| {
        let (a, b) = (from(h), from(next(h)));
        let twin = between(a, b).and_then(|_| between(b, a));
        twin.map_or(NO_VERTEX, |twin| corners[next(next(twin))])
    };
    (0..corners.len()).map(across).collect()
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
        let mesh = Mesh { positions, normals, triangles, ..Mesh::default() };
        const NO: u32 = NO_VERTEX;
        let expected = [NO, NO, 3, 1, NO, NO, NO, NO, NO, NO, NO, NO];
        assert_eq!(across(&mesh), expected);
    }
}
