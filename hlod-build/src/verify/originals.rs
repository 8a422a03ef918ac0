//! The original geometry under a node, a part at a time.
//!
//! A node near the root stands for all of a scan, which need not fit into memory. It is checked
//! in *blocks*: cells that hold few enough triangles. A block's own leaves are sampled against the
//! node's mesh, and the part of the mesh that lies there against every leaf within its reach.

use std::collections::BTreeMap;

use hlod_compress::{
    CellKey, HlodFile, Lattice, Mesh, NodeRecord, PageContent, Representation, decode_page,
};

/// A file's leaves, found by cell and by bounds, read when they are asked for.
pub(super) struct Originals<'a> {
    file: &'a HlodFile,
    nodes: BTreeMap<CellKey, &'a NodeRecord>,
    /// Triangles of all leaves in a node's cell.
    triangles_below: BTreeMap<CellKey, u64>,
    /// Leaves of a block have no more triangles than this, unless one leaf has more.
    block_triangles: u64,
}

impl<'a> Originals<'a> {
    pub(super) fn new(
        file: &'a HlodFile,
        nodes: &'a [NodeRecord],
        block_triangles: u64,
    ) -> Originals<'a> {
        let mut triangles_below: BTreeMap<CellKey, u64> = BTreeMap::new();
        for leaf in nodes.iter().filter(|node| node.is_leaf()) {
            let primitives = |r: &Representation| u64::from(r.triangles) + u64::from(r.points);
            let triangles = leaf.representations.first().map_or(0, primitives);
            let mut cell = Some(leaf.cell);
            while let Some(at) = cell {
                *triangles_below.entry(at).or_default() += triangles;
                cell = at.parent();
            }
        }
        let nodes = nodes.iter().map(|node| (node.cell, node)).collect();
        Originals { file, nodes, triangles_below, block_triangles }
    }

    pub(super) fn lattice(&self) -> &Lattice {
        &self.file.header().lattice
    }

    /// Triangles, of a point cloud points, of all leaves in a cell.
    pub(super) fn triangles_below(&self, cell: CellKey) -> u64 {
        self.triangles_below.get(&cell).copied().unwrap_or(0)
    }

    /// The cells into which a node's is divided, in order.
    pub(super) fn blocks(&self, cell: CellKey) -> Vec<CellKey> {
        if self.is_block(cell) {
            return vec![cell];
        }
        self.children(cell).flat_map(|child| self.blocks(child)).collect()
    }

    /// Which of a node's blocks stands for what lies round a point: the one it is in, or, where
    /// there is no geometry, one beside it.
    pub(super) fn block_at(&self, cell: CellKey, p: [f64; 3]) -> CellKey {
        if self.is_block(cell) {
            return cell;
        }
        let distance = |child: CellKey| {
            let (low, edge) = self.bounds_of_cell(child);
            let out = |i: usize| (low[i] - p[i]).max(p[i] - low[i] - edge).max(0.0);
            out(0) + out(1) + out(2)
        };
        match self.children(cell).min_by(|a, b| distance(*a).total_cmp(&distance(*b))) {
            Some(child) => self.block_at(child, p),
            None => cell,
        }
    }

    fn is_block(&self, cell: CellKey) -> bool {
        let is_leaf = self.nodes.get(&cell).is_none_or(|node| node.is_leaf());
        is_leaf || self.triangles_below(cell) <= self.block_triangles
    }

    /// Reads the leaves in a cell.
    pub(super) fn within_cell(&self, cell: CellKey) -> Result<Vec<Mesh>, String> {
        let mut out = Vec::new();
        self.collect(cell, &|_| true, &mut out)?;
        Ok(out)
    }

    /// Reads the leaves in a cell whose bounds meet a box, in lattice steps.
    pub(super) fn within_box(
        &self,
        cell: CellKey,
        [low, high]: [[f64; 3]; 2],
    ) -> Result<Vec<Mesh>, String> {
        let meets = |node: &NodeRecord| {
            let [lo, hi] = node.bounds.map(|corner| corner.map(f64::from));
            (0..3).all(|i| lo[i] <= high[i] && low[i] <= hi[i])
        };
        let mut out = Vec::new();
        self.collect(cell, &meets, &mut out)?;
        Ok(out)
    }

    fn collect(
        &self,
        cell: CellKey,
        is_wanted: &dyn Fn(&NodeRecord) -> bool,
        out: &mut Vec<Mesh>,
    ) -> Result<(), String> {
        let Some(node) = self.nodes.get(&cell).filter(|node| is_wanted(node)) else {
            return Ok(());
        };
        if !node.is_leaf() {
            return self.children(cell).try_for_each(|child| self.collect(child, is_wanted, out));
        }
        out.push(self.read(node)?.mesh);
        Ok(())
    }

    /// The leaves in a cell, to be read one by one.
    pub(super) fn leaves(&self, cell: CellKey) -> Vec<&'a NodeRecord> {
        match self.nodes.get(&cell) {
            Some(node) if node.is_leaf() => vec![node],
            Some(_) => self.children(cell).flat_map(|child| self.leaves(child)).collect(),
            None => Vec::new(),
        }
    }

    /// What a leaf holds.
    pub(super) fn read(&self, leaf: &NodeRecord) -> Result<PageContent, String> {
        let Some(representation) = leaf.representations.first() else {
            return Ok(PageContent::default());
        };
        let page = self.file.read_page(representation.page);
        let content = page.and_then(|bytes| decode_page(&bytes));
        content.map_err(|error| format!("leaf {}: {error}", leaf.cell))
    }

    fn children(&self, cell: CellKey) -> impl Iterator<Item = CellKey> + '_ {
        let mask = self.nodes.get(&cell).map_or(0, |node| node.child_mask);
        (0..8).filter(move |octant| mask >> octant & 1 == 1).map(move |octant| cell.child(octant))
    }

    fn bounds_of_cell(&self, cell: CellKey) -> ([f64; 3], f64) {
        let lattice = self.lattice();
        (lattice.cell_min(cell).map(f64::from), f64::from(lattice.cell_units(cell.depth())))
    }
}
