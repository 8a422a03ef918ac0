//! What lies beside the nodes of a part of a picture.
//!
//! How far a node's strips reach depends on what is drawn beside it ([`crate::seams`]), also where that is not seen in
//! the part itself. So parts draw one ring of nodes more than they show.

use std::collections::{HashMap, HashSet};

use hlod_compress::CellKey;

use crate::seams::cell_beyond;
use crate::skirts::Faces;

/// All cells, of whatever depth, that share a part of a face with one of some cells.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ring {
    /// Cells of equal depth beyond a face of theirs, and which of their own faces that is.
    beyond: HashMap<CellKey, Faces>,
    /// These, and what they lie in.
    holding: HashSet<CellKey>,
}

impl Ring {
    pub(crate) fn round(cells: impl IntoIterator<Item = CellKey>) -> Ring {
        let mut ring = Ring::default();
        for cell in cells {
            for face in 0..6 {
                let Some(beyond) = cell_beyond(cell, face) else { continue };
                *ring.beyond.entry(beyond).or_default() |= 1 << ((face + 3) % 6);
                let mut holding = Some(beyond);
                while let Some(cell) = holding.filter(|&cell| ring.holding.insert(cell)) {
                    holding = cell.parent();
                }
            }
        }
        ring
    }

    /// Whether a cell is one of these, or holds one that is as deep as its neighbour.
    pub(crate) fn has(&self, cell: CellKey) -> bool {
        let lies_at = |above: CellKey, faces: Faces| {
            let finer = cell.depth() - above.depth();
            (0..3).any(|axis| {
                let (here, there) = (cell.index()[axis], above.index()[axis]);
                let (first, last) = (there << finer, ((there + 1) << finer) - 1);
                (here == first && faces & 1 << axis != 0)
                    || (here == last && faces & 8 << axis != 0)
            })
        };
        let mut above = std::iter::successors(Some(cell), |cell| cell.parent());
        self.holding.contains(&cell)
            || above.any(|above| self.beyond.get(&above).is_some_and(|&f| lies_at(above, f)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether cells share a part of a face, or one holds a cell beside the other: told by their extents.
    fn is_beside(cell: CellKey, other: CellKey) -> bool {
        let extent = |cell: CellKey, axis: usize| {
            let edge = 1u32 << (8 - cell.depth());
            [cell.index()[axis] * edge, (cell.index()[axis] + 1) * edge]
        };
        let overlap = (0..3).map(|axis| {
            let ([a, b], [c, d]) = (extent(cell, axis), extent(other, axis));
            b.min(d) as i64 - a.max(c) as i64
        });
        let overlap: Vec<i64> = overlap.collect();
        overlap.iter().filter(|&&o| o > 0).count() == 2 && overlap.iter().all(|&o| o >= 0)
    }

    #[test]
    fn a_ring_has_what_shares_a_face() {
        let deep = CellKey::at(4, [5, 8, 3]);
        let cells = [CellKey::at(2, [1, 2, 3]), deep, CellKey::at(3, [7, 0, 0])];
        let ring = Ring::round(cells);
        let mut counts = [0; 2];
        for depth in 0..6u8 {
            for i in 0..1u32 << (3 * depth.min(5)) {
                let index = [0, 1, 2].map(|axis| i >> (depth as u32 * axis) & ((1 << depth) - 1));
                let cell = CellKey::at(depth, index);
                let beside = cells.iter().any(|&other| is_beside(cell, other));
                // What holds a cell beside one of them is on the way to it.
                let on_the_way = cells.iter().any(|&other| {
                    (0..6).filter_map(|face| cell_beyond(other, face)).any(|beyond| {
                        std::iter::successors(Some(beyond), |c| c.parent()).any(|c| c == cell)
                    })
                });
                assert_eq!(ring.has(cell), beside || on_the_way, "{cell} {beside} {on_the_way}");
                counts[usize::from(beside)] += 1;
            }
        }
        assert!(counts[1] > 500 && counts[0] > 10_000, "{counts:?}");
        assert!(!Ring::default().has(CellKey::ROOT));
    }
}
