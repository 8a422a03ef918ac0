//! Octree cells: depth and Morton code.

use crate::FormatError;

/// Depth of the deepest cell that a key can name (3 × 20 bits of Morton code).
pub const MAX_DEPTH: u8 = 20;

/// An octree cell: the `index`-th cube of edge `root_edge / 2^depth` along each axis.
///
/// Ordered by depth, then Morton code, which is the order of nodes in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellKey {
    depth: u8,
    morton: u64,
}

impl CellKey {
    /// The cell that holds the whole model.
    pub const ROOT: CellKey = CellKey { depth: 0, morton: 0 };

    /// Depth below the root, which has depth 0.
    pub fn depth(self) -> u8 {
        self.depth
    }

    /// Interleaved index bits, x lowest.
    pub fn morton(self) -> u64 {
        self.morton
    }

    /// The child in `octant` (bit 0: upper half along x, bit 1: y, bit 2: z).
    ///
    /// # Panics
    /// When the cell is at [`MAX_DEPTH`] or `octant` is not below 8.
    pub fn child(self, octant: u8) -> CellKey {
        assert!(self.depth < MAX_DEPTH && octant < 8, "no child {octant} at depth {}", self.depth);
        CellKey { depth: self.depth + 1, morton: self.morton << 3 | u64::from(octant) }
    }

    /// The cell that this one is a child of; `None` for the root.
    pub fn parent(self) -> Option<CellKey> {
        (self.depth > 0).then(|| CellKey { depth: self.depth - 1, morton: self.morton >> 3 })
    }

    /// Which child of its parent the cell is.
    pub fn octant(self) -> u8 {
        (self.morton & 7) as u8
    }

    /// Position among the `2^depth` cells along each axis.
    pub fn index(self) -> [u32; 3] {
        let mut index = [0; 3];
        for level in 0..u32::from(self.depth) {
            for (axis, value) in index.iter_mut().enumerate() {
                *value |= ((self.morton >> (3 * level + axis as u32) & 1) as u32) << level;
            }
        }
        index
    }

    /// The cell of a depth at a position among the `2^depth` along each axis.
    ///
    /// # Panics
    /// When `depth` is above [`MAX_DEPTH`] or the position outside the root.
    pub fn at(depth: u8, index: [u32; 3]) -> CellKey {
        assert!(depth <= MAX_DEPTH && index.iter().all(|i| i >> depth == 0), "{index:?}");
        let bit = |level: u32, axis: u32| {
            u64::from(index[axis as usize] >> level & 1) << (3 * level + axis)
        };
        let bits = (0..u32::from(depth)).flat_map(|level| (0..3).map(move |axis| bit(level, axis)));
        CellKey { depth, morton: bits.sum() }
    }

    /// Checks a key read from a file.
    ///
    /// # Errors
    /// When there is no such cell.
    pub fn from_parts(depth: u8, morton: u64) -> Result<CellKey, FormatError> {
        if depth > MAX_DEPTH || morton >> (3 * u32::from(depth)) != 0 {
            return Err(FormatError::malformed(
                "skeleton block",
                format!("no cell {morton:#x} at depth {depth}"),
            ));
        }
        Ok(CellKey { depth, morton })
    }
}

impl std::fmt::Display for CellKey {
    /// Depth and octal path from the root, as in `3:0/7/1`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:", self.depth)?;
        for level in (0..self.depth).rev() {
            write!(
                f,
                "{}{}",
                self.morton >> (3 * u32::from(level)) & 7,
                if level > 0 { "/" } else { "" }
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_follows_octants() {
        let cell = CellKey::ROOT.child(0b101).child(0b010);
        assert_eq!(cell.index(), [0b10, 0b01, 0b10]);
        assert_eq!(CellKey::at(2, cell.index()), cell);
        assert_eq!(cell.parent(), Some(CellKey::ROOT.child(5)));
        assert_eq!(cell.octant(), 2);
        assert_eq!(cell.to_string(), "2:5/2");
    }

    #[test]
    fn keys_from_files_are_checked() {
        assert!(CellKey::from_parts(1, 7).is_ok());
        assert!(CellKey::from_parts(1, 8).is_err());
        assert!(CellKey::from_parts(MAX_DEPTH + 1, 0).is_err());
    }
}
