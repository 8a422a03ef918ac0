//! Which parts of the octree are built, and each from what.

use std::collections::BTreeSet;

use hlod_compress::CellKey;

use super::scatter::Subtree;

/// The subtrees, and the nodes above them.
pub(crate) struct Plan {
    pub(crate) subtrees: Vec<Subtree>,
    upper: BTreeSet<CellKey>,
}

impl Plan {
    pub(crate) fn new(subtrees: Vec<Subtree>) -> Plan {
        let mut upper = BTreeSet::new();
        for subtree in &subtrees {
            let mut above = subtree.cell().parent();
            while let Some(cell) = above.filter(|&cell| upper.insert(cell)) {
                above = cell.parent();
            }
        }
        Plan { subtrees, upper }
    }

    /// The nodes above the subtrees, those of a depth together, deepest first.
    pub(crate) fn upper_levels(&self) -> Vec<Vec<CellKey>> {
        let cells: Vec<CellKey> = self.upper.iter().copied().collect();
        let levels = cells.chunk_by(|a, b| a.depth() == b.depth());
        levels.rev().map(<[CellKey]>::to_vec).collect()
    }

    /// The topmost cells of all parts, in order.
    pub(crate) fn parts(&self) -> Vec<CellKey> {
        let mut parts: Vec<CellKey> = self.subtrees.iter().map(Subtree::cell).collect();
        parts.extend(&self.upper);
        parts.sort_unstable();
        parts
    }

    /// The parts that a node above the subtrees is made from: those that begin one or two levels
    /// below it.
    pub(crate) fn below(&self, cell: CellKey) -> Vec<CellKey> {
        let is_below = |part: &CellKey| {
            let parent = part.parent();
            parent == Some(cell) || parent.and_then(CellKey::parent) == Some(cell)
        };
        self.parts().into_iter().filter(is_below).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_made_from_what_begins_within_two_levels() {
        let root = CellKey::ROOT;
        let deep = root.child(1).child(2).child(3);
        let subtree = |cell| Subtree::new(cell, 10);
        let plan = Plan::new(vec![subtree(root.child(0)), subtree(deep)]);
        let (one, two) = (root.child(1), root.child(1).child(2));
        assert_eq!(plan.upper_levels(), vec![vec![two], vec![one], vec![root]]);
        assert_eq!(plan.parts(), vec![root, root.child(0), one, two, deep]);
        assert_eq!(plan.below(root), vec![root.child(0), one, two]);
        assert_eq!(plan.below(one), vec![two, deep]);
        assert_eq!(plan.below(two), vec![deep]);
    }
}
