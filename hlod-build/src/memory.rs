//! How a build divides the memory that it may use.

use std::path::Path;

use crate::error::BuildError;
use crate::hierarchy::NODE_BYTES_A_TRIANGLE;

/// While one has only its last nodes left, the other keeps the remaining threads busy.
pub(crate) const SUBTREES_AT_A_TIME: usize = 2;

/// How the memory allowed is used.
pub(crate) struct Memory {
    /// For bringing triangles and vertices together.
    pub(crate) join_bytes: usize,
    /// Triangles of a subtree.
    pub(crate) subtree_triangles: u64,
    /// For the nodes being simplified at a time.
    pub(crate) nodes_bytes: u64,
}

impl Memory {
    /// The program, its threads' stacks and what the allocator keeps.
    const FIXED_BYTES: u64 = 48 << 20;
    /// A subtree's triangles while they are cut into leaves, and its leaves and pages afterwards.
    const SUBTREE_BYTES_A_TRIANGLE: u64 = 200;
    /// More would only make progress coarser and leave threads idle at the end.
    const SUBTREE_TRIANGLES_MAX: u64 = 1_000_000;
    /// A cell as full as this is surely split, however its triangles are cut.
    const SUBTREE_LEAVES_MIN: u64 = 8;
    /// As many full leaves as a node usually gathers.
    const NODE_LEAVES: u64 = 16;
    /// The allocator keeps a part of what was freed.
    const KEPT_SHARE: u64 = 12;

    /// What the whole build has to be allowed so that bringing together gets `join_bytes`.
    pub(crate) fn budget_of(join_bytes: u64) -> u64 {
        let all = join_bytes.saturating_mul(2).saturating_add(Self::FIXED_BYTES);
        (all / (Self::KEPT_SHARE - 1)).saturating_mul(Self::KEPT_SHARE)
    }

    /// # Errors
    /// When one node of full leaves would not fit; `path` is what the error names.
    pub(crate) fn share(
        budget_bytes: u64,
        leaf_triangles: u32,
        path: &Path,
    ) -> Result<Memory, BuildError> {
        let all = budget_bytes - budget_bytes / Self::KEPT_SHARE;
        let leaf = u64::from(leaf_triangles);
        let at_a_time = SUBTREES_AT_A_TIME as u64 * Self::SUBTREE_BYTES_A_TRIANGLE;
        let subtree_triangles = (all / 8 / at_a_time)
            .min(Self::SUBTREE_TRIANGLES_MAX)
            .max(Self::SUBTREE_LEAVES_MIN * leaf);
        let taken = Self::FIXED_BYTES + subtree_triangles * at_a_time;
        let node = Self::NODE_LEAVES * leaf * NODE_BYTES_A_TRIANGLE;
        if all < taken + node {
            return Err(BuildError::Memory {
                path: path.to_owned(),
                why: "leaves of so many triangles have to be simplified together",
                needed_bytes: (taken + node) * Self::KEPT_SHARE / (Self::KEPT_SHARE - 1),
                budget_bytes,
            });
        }
        Ok(Memory {
            join_bytes: usize::try_from((all - Self::FIXED_BYTES) / 2).unwrap_or(usize::MAX),
            subtree_triangles,
            nodes_bytes: all - taken,
        })
    }
}
