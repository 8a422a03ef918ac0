//! The scan's own geometry, wherever it is asked for: what measuring, cutting and picking read.
//!
//! Only leaves are ever given out, never a level that is shown. Of the octree only the blocks are
//! read that a question leads to, and decoded leaves are kept up to a limit, so that the next
//! question about the same place is answered at once. Any number of threads may ask.

use std::collections::{HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;
use hlod_compress::{
    BlockRef, CellKey, Children, FormatError, Header, Metadata, NodeRecord, PageContent, PageRef,
    RepresentationKind, SkeletonBlock, decode_page,
};

use crate::error::RenderError;
use crate::source::{Source, cache_folder};

/// Bytes of the file that are kept as they were read.
const KEEP_BYTES: u64 = 32 << 20;
/// Triangles and points of decoded leaves that are kept: about 100 MB.
const KEEP_PRIMITIVES: usize = 3_000_000;

/// The leaves of one file, on a disk or a server.
pub struct Leaves {
    path: PathBuf,
    source: Source,
    blocks: Mutex<HashMap<u64, Arc<SkeletonBlock>>>,
    decoded: Mutex<Decoded>,
}

/// Where a leaf is, before it is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafRef {
    /// Its cell.
    pub cell: CellKey,
    /// Lowest corner of its geometry, source coordinates.
    pub min: DVec3,
    /// Highest corner.
    pub max: DVec3,
    /// No point of the leaf is farther from the scan, and none of the scan from it: rounding to the
    /// file's lattice included. In the source's unit; proven.
    pub error: f64,
    /// How many triangles it has.
    pub triangles: u32,
    page: PageRef,
}

/// A leaf that was read.
pub struct Leaf {
    /// Where it is.
    pub at: LeafRef,
    /// Its triangles or points, on the file's lattice ([`Header::lattice`]).
    pub content: PageContent,
}

impl Leaves {
    /// Opens a file, or one on a server where the path is its address.
    ///
    /// # Errors
    /// When it cannot be read, or is not an `.hlod` file.
    pub fn open(path: &Path) -> Result<Leaves, RenderError> {
        let source = Source::open(path, KEEP_BYTES, cache_folder().as_deref())?;
        Ok(Leaves {
            path: path.to_owned(),
            source,
            blocks: Mutex::default(),
            decoded: Mutex::new(Decoded::new(KEEP_PRIMITIVES)),
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its header.
    pub fn header(&self) -> &Header {
        self.source.header()
    }

    /// What is known of the scan besides its shape.
    ///
    /// # Errors
    /// When it cannot be read or is damaged.
    pub fn metadata(&self) -> Result<Option<Metadata>, RenderError> {
        self.source.read_metadata().map_err(RenderError::format(&self.path))
    }

    /// A lattice position in source coordinates.
    pub fn place(&self, position: [i32; 3]) -> DVec3 {
        DVec3::from_array(self.header().lattice.position(position))
    }

    /// The leaves in boxes that are `wanted`, which is asked about the bounds of whole branches
    /// first: it must hold of a box if it holds of any part. In the order of the octree.
    ///
    /// # Errors
    /// When the octree cannot be read or is damaged.
    pub fn within(
        &self,
        wanted: impl Fn(DVec3, DVec3) -> bool,
    ) -> Result<Vec<LeafRef>, RenderError> {
        self.find(&wanted).map_err(RenderError::format(&self.path))
    }

    fn find(&self, wanted: &dyn Fn(DVec3, DVec3) -> bool) -> Result<Vec<LeafRef>, FormatError> {
        let root = self.block(self.header().root_block, None)?;
        let mut leaves = Vec::new();
        // Children come behind their parents in a block; a block is entered by one node alone, and
        // no more often than there are nodes.
        let mut pending = vec![(root, 0usize)];
        let mut visited = 0;
        let step = self.header().lattice.step;
        while let Some((block, index)) = pending.pop() {
            visited += 1;
            if visited > self.header().nodes {
                let why = "its blocks lead back to one another".to_owned();
                return Err(FormatError::Malformed { what: "octree", why });
            }
            let node = &block.nodes[index];
            let [min, max] = node.bounds.map(|corner| self.place(corner));
            if !wanted(min, max) {
                continue;
            }
            let children = node.child_mask.count_ones() as usize;
            match node.children {
                _ if node.is_leaf() => leaves.extend(leaf_ref(node, min, max, step)),
                Children::None => {}
                Children::Here(first) => {
                    let first = first as usize;
                    pending.extend((first..first + children).rev().map(|i| (block.clone(), i)));
                }
                Children::Block(child) => {
                    let child = self.block(child, Some(node))?;
                    pending.extend((0..children).rev().map(|i| (child.clone(), i)));
                }
            }
        }
        Ok(leaves)
    }

    /// Reads a leaf.
    ///
    /// # Errors
    /// When it cannot be read or is damaged.
    pub fn load(&self, leaf: &LeafRef) -> Result<Arc<Leaf>, RenderError> {
        if let Some(known) = lock(&self.decoded).get(leaf.page.offset) {
            return Ok(known);
        }
        let read = || decode_page(&self.source.read_page(leaf.page)?);
        let content = read().map_err(RenderError::format(&self.path))?;
        let leaf = Arc::new(Leaf { at: *leaf, content });
        lock(&self.decoded).put(&leaf);
        Ok(leaf)
    }

    fn block(
        &self,
        block: BlockRef,
        parent: Option<&NodeRecord>,
    ) -> Result<Arc<SkeletonBlock>, FormatError> {
        if let Some(known) = lock(&self.blocks).get(&block.offset) {
            return Ok(known.clone());
        }
        let read = Arc::new(self.source.read_block(block)?);
        match parent {
            Some(parent) => read.check_is_child_block_of(parent)?,
            None if read.nodes[0].cell != CellKey::ROOT => {
                let why = "it does not begin with the root".to_owned();
                return Err(FormatError::Malformed { what: "skeleton block", why });
            }
            None => {}
        }
        lock(&self.blocks).insert(block.offset, read.clone());
        Ok(read)
    }
}

fn leaf_ref(node: &NodeRecord, min: DVec3, max: DVec3, step: f64) -> Option<LeafRef> {
    let source = node.representation(RepresentationKind::Source)?;
    // Rounding moves a vertex by half a step an axis, and what lies between vertices no farther.
    let error = f64::from(source.errors.geometric) + 0.5 * 3f64.sqrt() * step;
    let (triangles, page) = (source.triangles, source.page);
    Some(LeafRef { cell: node.cell, min, max, error, triangles, page })
}

/// What a thread that panicked left is whole: values are put and taken at once.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Decoded leaves by their page; those read first make room.
struct Decoded {
    leaves: HashMap<u64, Arc<Leaf>>,
    order: VecDeque<u64>,
    primitives: usize,
    limit: usize,
}

impl Decoded {
    fn new(limit: usize) -> Decoded {
        Decoded { leaves: HashMap::new(), order: VecDeque::new(), primitives: 0, limit }
    }

    fn get(&self, page: u64) -> Option<Arc<Leaf>> {
        self.leaves.get(&page).cloned()
    }

    fn put(&mut self, leaf: &Arc<Leaf>) {
        let page = leaf.at.page.offset;
        if self.leaves.insert(page, leaf.clone()).is_some() {
            return;
        }
        self.order.push_back(page);
        self.primitives += leaf.primitives();
        while self.primitives > self.limit && self.order.len() > 1 {
            let oldest = self.order.pop_front().and_then(|page| self.leaves.remove(&page));
            self.primitives -= oldest.map_or(0, |leaf| leaf.primitives());
        }
    }
}

impl Leaf {
    fn primitives(&self) -> usize {
        self.content.mesh.triangles.len() + self.content.points.len()
    }
}
