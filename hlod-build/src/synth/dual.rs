//! Tables of the dual surface: which edges of a cell belong to which patch.
//!
//! Based on: Gregory Nielson, "Dual Marching Cubes", IEEE Visualization 2004: one vertex for
//! every *patch* that marching cubes would put into a cell, one quad for every grid edge
//! that crosses the surface. Against marching cubes it gives even triangles (as surface
//! nets do), against surface nets it does not pinch where two sheets share a cell. The
//! tables are computed, not copied, from one rule: on an ambiguous face the two inside
//! corners are joined, whichever of its two cells asks.
//!
//! What Nielson leaves: two cells whose common face is ambiguous and which both have *one*
//! patch for its two segments would be joined by the same edge twice (four triangles on
//! it). Wherever the upper cell is like that, whatever the lower one, each segment gets a
//! vertex of its own in the face, which makes the two edges different: the result is always
//! closed and manifold.

/// A cell's corner c lies at (c & 1, c >> 1 & 1, c >> 2). Its edge 4·d + e runs along axis d
/// from corner [`EDGE_CORNERS`]`[4 * d + e][0]`.
pub const EDGE_CORNERS: [[usize; 2]; 12] = [
    [0, 1],
    [2, 3],
    [4, 5],
    [6, 7],
    [0, 2],
    [4, 6],
    [1, 3],
    [5, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
];

/// The other two axes of each, right-handed.
pub const OTHERS: [[usize; 2]; 3] = [[1, 2], [2, 0], [0, 1]];

/// No patch.
pub const NONE: u8 = 255;

/// What one of the 256 sign patterns (bit c set: corner c inside) means.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Patch of each edge, or [`NONE`] where it does not cross.
    pub patch: [u8; 12],
    /// How many patches.
    pub patches: u8,
    /// Bit d: the lower face across axis d is ambiguous and both its segments belong to one
    /// patch.
    pub double: u8,
}

/// The edge of a cell along `axis` at the corner whose other two coordinates are `a`, `b`
/// (in the order of [`OTHERS`]).
pub const fn edge_at(axis: usize, a: usize, b: usize) -> usize {
    4 * axis + a + 2 * b
}

/// The four corners of a face, and the edges between them, in turn.
pub fn face_ring(axis: usize, side: usize) -> ([usize; 4], [usize; 4]) {
    let [a, b] = OTHERS[axis];
    let base = side << axis;
    let corners = [base, base | 1 << a, base | 1 << a | 1 << b, base | 1 << b];
    let edges = std::array::from_fn(|i| {
        let (p, q) = (corners[i], corners[(i + 1) % 4]);
        EDGE_CORNERS
            .iter()
            .position(|e| *e == [p.min(q), p.max(q)])
            .unwrap_or_else(|| unreachable!("faces have edges"))
    });
    (corners, edges)
}

/// All 256 cases.
pub fn cases() -> Vec<Case> {
    (0..256usize).map(case).collect()
}

fn case(signs: usize) -> Case {
    let inside = |corner: usize| signs >> corner & 1 == 1;
    let mut root: [usize; 12] = std::array::from_fn(|e| e);
    fn find(root: &[usize; 12], mut e: usize) -> usize {
        while root[e] != e {
            e = root[e];
        }
        e
    }
    // Join the crossing edges that the segments of the six faces connect.
    let mut ambiguous = Vec::new();
    for axis in 0..3 {
        for side in 0..2 {
            let (corners, edges) = face_ring(axis, side);
            let crossing: Vec<usize> =
                (0..4).filter(|i| inside(corners[*i]) != inside(corners[(i + 1) % 4])).collect();
            let mut pairs = Vec::new();
            if crossing.len() == 2 {
                pairs.push([edges[crossing[0]], edges[crossing[1]]]);
            } else if crossing.len() == 4 {
                // Each segment cuts off one outside corner.
                for i in (0..4).filter(|i| !inside(corners[*i])) {
                    pairs.push([edges[(i + 3) % 4], edges[i]]);
                }
                ambiguous.push((axis, side, [pairs[0][0], pairs[1][0]]));
            }
            for [p, q] in pairs {
                let (p, q) = (find(&root, p), find(&root, q));
                root[p.max(q)] = p.min(q);
            }
        }
    }
    // Number the patches.
    let mut patch = [NONE; 12];
    let mut patches = 0;
    for e in 0..12 {
        if inside(EDGE_CORNERS[e][0]) == inside(EDGE_CORNERS[e][1]) {
            continue;
        }
        let r = find(&root, e);
        if r == e {
            patch[e] = patches;
            patches += 1;
        } else {
            patch[e] = patch[r];
        }
    }
    let mut double = 0;
    for (axis, side, [p, q]) in ambiguous {
        double |= u8::from(side == 0 && patch[p] == patch[q]) << axis;
    }
    Case { patch, patches, double }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_numbered_as_the_lookup_says() {
        for axis in 0..3 {
            let [a, b] = OTHERS[axis];
            for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let from = i << a | j << b;
                assert_eq!(
                    EDGE_CORNERS[edge_at(axis, i, j)],
                    [from, from | 1 << axis],
                    "axis {axis} at {i}, {j}"
                );
            }
        }
    }

    #[test]
    fn patches_are_what_marching_cubes_makes() {
        let cases = cases();
        assert_eq!(cases[0].patches, 0);
        assert_eq!(cases[255].patches, 0);
        assert_eq!(cases[1].patches, 1);
        // Four corners without a common edge: inside corners are joined, outside cut off.
        assert_eq!(cases[0b0110_1001].patches, 4);
        // Every crossing edge lies in two segments, and every patch has at least three.
        for (signs, case) in cases.iter().enumerate() {
            for n in 0..case.patches {
                let edges = case.patch.iter().filter(|p| **p == n).count();
                assert!(edges >= 3, "case {signs}");
            }
        }
    }
}
