//! Laying out and writing a file, and reading one from disk.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::Write;
use std::path::Path;

use crate::pread::read_exact_at;
use crate::{
    BLOCK_BYTES_MAX, BlockRef, CellKey, Children, FormatError, HEADER_BYTES_MAX, Header, Metadata,
    NodeRecord, PageRef, RepresentationKind, SkeletonBlock,
};

/// A file about to be written: everything but the pages' bytes.
///
/// The layout is fixed before the first byte is written, so a file is written front to back,
/// pages are asked for one at a time, and nothing but the skeleton is held in memory.
pub struct FileWriter {
    header: Header,
    blocks: Vec<SkeletonBlock>,
    page_order: Vec<(CellKey, RepresentationKind, PageRef)>,
    metadata: Vec<u8>,
}

impl FileWriter {
    /// Lays out a file.
    ///
    /// Of `nodes`, in any order, the pages' lengths and checksums must be filled in; page
    /// offsets, child masks and places of children are found here, as are the header's counts,
    /// sizes and references. `metadata` come last: nothing that is drawn waits for them.
    ///
    /// # Errors
    /// When a node's parent is missing, two nodes share a cell, or nothing was given.
    pub fn new(
        mut header: Header,
        nodes: Vec<NodeRecord>,
        metadata: Option<&Metadata>,
    ) -> Result<FileWriter, FormatError> {
        let bad = |why: String| FormatError::malformed("octree", why);
        header.nodes = nodes.len() as u64;
        header.metadata = metadata.map(Metadata::reference);
        let mut by_cell = BTreeMap::new();
        for node in nodes {
            let cell = node.cell;
            if by_cell.insert(cell, node).is_some() {
                return Err(bad(format!("cell {cell} was given twice")));
            }
        }
        let mut masks: BTreeMap<CellKey, u8> = BTreeMap::new();
        for cell in by_cell.keys() {
            if let Some(parent) = cell.parent() {
                if !by_cell.contains_key(&parent) {
                    return Err(bad(format!("cell {cell} has no parent")));
                }
                *masks.entry(parent).or_default() |= 1 << cell.octant();
            }
        }
        for (cell, node) in &mut by_cell {
            node.child_mask = masks.get(cell).copied().unwrap_or(0);
        }
        if !by_cell.contains_key(&CellKey::ROOT) {
            return Err(bad("there is no root".into()));
        }

        let (mut blocks, links) = partition_into_blocks(&mut by_cell);

        // Fix all offsets: front part (header, root block, root pages), blocks, pages.
        let block_bytes: Vec<u64> = blocks.iter().map(block_bytes).collect();
        header.skeleton_bytes = block_bytes.iter().sum();
        let header_bytes = header.to_bytes().len() as u64;
        if header_bytes > HEADER_BYTES_MAX as u64 {
            let limit = HEADER_BYTES_MAX as u64;
            return Err(FormatError::TooLarge {
                what: "header",
                count: header_bytes,
                unit: "bytes",
                limit,
            });
        }
        let mut order: Vec<(CellKey, RepresentationKind)> = blocks
            .iter()
            .flat_map(|b| &b.nodes)
            .flat_map(|n| n.representations.iter().map(|r| (n.cell, r.kind)))
            .collect();
        order.sort_by_key(|&(cell, kind)| (cell.depth(), kind, cell));
        let mut pages: BTreeMap<(CellKey, RepresentationKind), &mut PageRef> = blocks
            .iter_mut()
            .flat_map(|b| &mut b.nodes)
            .flat_map(|n| {
                let cell = n.cell;
                n.representations.iter_mut().map(move |r| ((cell, r.kind), &mut r.page))
            })
            .collect();
        let mut offset = header_bytes + block_bytes[0];
        let mut page_order = Vec::with_capacity(order.len());
        let mut place = |key: (CellKey, RepresentationKind), offset: &mut u64| {
            if let Some(page) = pages.get_mut(&key) {
                page.offset = *offset;
                *offset += u64::from(page.page_bytes);
                page_order.push((key.0, key.1, **page));
            }
        };
        let (root, rest): (Vec<_>, Vec<_>) =
            order.iter().partition(|(cell, _)| *cell == CellKey::ROOT);
        for &key in root {
            place(key, &mut offset);
        }
        header.front_bytes = offset;
        let mut block_offsets = vec![header_bytes];
        for bytes in &block_bytes[1..] {
            block_offsets.push(offset);
            offset += bytes;
        }
        for &key in rest {
            place(key, &mut offset);
        }
        if let Some(metadata) = &mut header.metadata {
            metadata.offset = offset;
            offset += u64::from(metadata.text_bytes);
        }
        header.file_bytes = offset;

        // A block holds the checksums of those it refers to, which always come behind it.
        let mut refs: Vec<Option<BlockRef>> = vec![None; blocks.len()];
        for i in (0..blocks.len()).rev() {
            for &(node, target) in &links[i] {
                let target = refs[target].expect("referenced blocks come behind");
                blocks[i].nodes[node].children = Children::Block(target);
            }
            refs[i] = Some(BlockRef {
                offset: block_offsets[i],
                block_bytes: block_bytes[i] as u32,
                crc32: crc32fast::hash(&blocks[i].to_bytes()),
            });
        }
        header.root_block = refs[0].expect("the first block was just placed");
        let metadata = metadata.map_or(Vec::new(), |m| m.text().as_bytes().to_vec());
        Ok(FileWriter { header, blocks, page_order, metadata })
    }

    /// The header as it will be written.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Writes the file, front to back; `page` hands out the bytes of one page, whose length
    /// and checksum must be those that were declared.
    ///
    /// # Errors
    /// When `page` or `out` fail, or a page is not the one that was declared.
    pub fn write<E: From<FormatError>>(
        &self,
        out: &mut dyn Write,
        mut page: impl FnMut(CellKey, RepresentationKind) -> Result<Vec<u8>, E>,
    ) -> Result<(), E> {
        let mut write = |bytes: &[u8]| out.write_all(bytes).map_err(FormatError::from);
        write(&self.header.to_bytes())?;
        write(&self.blocks[0].to_bytes())?;
        let root_pages = self.page_order.iter().filter(|p| p.0 == CellKey::ROOT).count();
        for (i, &(cell, kind, declared)) in self.page_order.iter().enumerate() {
            if i == root_pages {
                for block in &self.blocks[1..] {
                    write(&block.to_bytes())?;
                }
            }
            let bytes = page(cell, kind)?;
            if bytes.len() as u64 != u64::from(declared.page_bytes)
                || crc32fast::hash(&bytes) != declared.crc32
            {
                let why = format!("the page of node {cell} is not the one that was declared");
                return Err(FormatError::malformed("page", why).into());
            }
            write(&bytes)?;
        }
        Ok(write(&self.metadata)?)
    }
}

fn block_bytes(block: &SkeletonBlock) -> u64 {
    let nodes = block.nodes.iter();
    let records = nodes.map(|n| NodeRecord::record_bytes(n.representations.len(), n.is_leaf()));
    (SkeletonBlock::PREFIX_BYTES + records.sum::<usize>()) as u64
}

/// Fills blocks breadth first; children that do not fit start a block of their own.
/// `.1[i]` holds a pair (node of block i, index of the block with that node's children).
fn partition_into_blocks(
    by_cell: &mut BTreeMap<CellKey, NodeRecord>,
) -> (Vec<SkeletonBlock>, Vec<Vec<(usize, usize)>>) {
    let group =
        |by_cell: &mut BTreeMap<CellKey, NodeRecord>, parent: &NodeRecord| -> Vec<NodeRecord> {
            let octants = (0..8).filter(|o| parent.child_mask >> o & 1 == 1);
            octants.filter_map(|o| by_cell.remove(&parent.cell.child(o))).collect()
        };
    let bytes_of = |nodes: &[NodeRecord]| -> usize {
        nodes.iter().map(|n| NodeRecord::record_bytes(n.representations.len(), n.is_leaf())).sum()
    };
    let mut blocks = Vec::new();
    let mut links: Vec<Vec<(usize, usize)>> = Vec::new();
    // Groups of siblings that start a block, with the block and node that refer to them.
    let mut starts = VecDeque::new();
    let root = by_cell.remove(&CellKey::ROOT).into_iter().collect::<Vec<_>>();
    starts.push_back((root, None));
    while let Some((first, referrer)) = starts.pop_front() {
        let block_index = blocks.len();
        links.push(Vec::new());
        if let Some((block, node)) = referrer {
            let links: &mut Vec<Vec<(usize, usize)>> = &mut links;
            links[block as usize].push((node, block_index));
        }
        let mut bytes = SkeletonBlock::PREFIX_BYTES + bytes_of(&first);
        let mut nodes = first;
        let mut next = 0;
        while next < nodes.len() {
            let children = group(by_cell, &nodes[next]);
            if !children.is_empty() {
                let more = bytes_of(&children);
                if bytes + more <= BLOCK_BYTES_MAX {
                    bytes += more;
                    nodes[next].children = Children::Here(nodes.len() as u32);
                    nodes.extend(children);
                } else {
                    starts.push_back((children, Some((block_index as u32, next))));
                }
            } else {
                nodes[next].children = Children::None;
            }
            next += 1;
        }
        blocks.push(SkeletonBlock { nodes });
    }
    (blocks, links)
}

/// An `.hlod` file on disk, read when asked; for tools, which may wait. (The renderer does not:
/// it reads in the background.)
#[derive(Debug)]
pub struct HlodFile {
    file: File,
    header: Header,
}

impl HlodFile {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// When it cannot be opened, is not an `.hlod` file of this version, or is shorter than its
    /// header says.
    pub fn open(path: &Path) -> Result<HlodFile, FormatError> {
        let file = File::open(path)?;
        let file_bytes = file.metadata()?.len();
        let mut start = vec![0; file_bytes.min(HEADER_BYTES_MAX as u64) as usize];
        read_exact_at(&file, &mut start, 0)?;
        let header = Header::parse(&start)?;
        if file_bytes < header.file_bytes {
            let (what, needed_bytes) = ("the file", header.file_bytes);
            return Err(FormatError::Truncated { what, file_bytes, needed_bytes });
        }
        Ok(HlodFile { file, header })
    }

    /// The file's header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Reads bytes that must lie within the file.
    ///
    /// # Errors
    /// When they do not, or reading fails.
    pub fn read_range(
        &self,
        what: &'static str,
        offset: u64,
        count: u32,
    ) -> Result<Vec<u8>, FormatError> {
        self.header.check_range(what, offset, count)?;
        let mut bytes = vec![0; count as usize];
        read_exact_at(&self.file, &mut bytes, offset)?;
        Ok(bytes)
    }

    /// Reads and checks one skeleton block.
    ///
    /// # Errors
    /// When it is out of bounds, damaged or malformed.
    pub fn read_block(&self, block: BlockRef) -> Result<SkeletonBlock, FormatError> {
        let bytes = self.read_range("skeleton block", block.offset, block.block_bytes)?;
        SkeletonBlock::parse(&bytes, block)
    }

    /// Reads one page and checks its checksum; decoding it is a separate step.
    ///
    /// # Errors
    /// When it is out of bounds or damaged.
    pub fn read_page(&self, page: PageRef) -> Result<Vec<u8>, FormatError> {
        let bytes = self.read_range("page", page.offset, page.page_bytes)?;
        page.check(&bytes)?;
        Ok(bytes)
    }

    /// Reads what is known of the scan besides its shape.
    ///
    /// # Errors
    /// When it is damaged, or not what it should be.
    pub fn read_metadata(&self) -> Result<Option<Metadata>, FormatError> {
        let Some(metadata) = self.header.metadata else { return Ok(None) };
        let text = self.read_range("metadata", metadata.offset, metadata.text_bytes)?;
        metadata.parse(&text).map(Some)
    }

    /// Reads the whole skeleton: all nodes in depth, then Morton order.
    ///
    /// # Errors
    /// When any block is damaged, or the blocks do not make one tree of the declared size.
    pub fn read_skeleton(&self) -> Result<Vec<NodeRecord>, FormatError> {
        let mut nodes = Vec::new();
        let mut pending = vec![(self.header.root_block, None::<NodeRecord>)];
        while let Some((block_ref, parent)) = pending.pop() {
            let block = self.read_block(block_ref)?;
            match &parent {
                Some(parent) => block.check_is_child_block_of(parent)?,
                None if block.nodes[0].cell != CellKey::ROOT => {
                    return Err(FormatError::malformed(
                        "skeleton block",
                        "it does not begin with the root",
                    ));
                }
                None => {}
            }
            for node in &block.nodes {
                if let Children::Block(child) = node.children {
                    pending.push((child, Some(node.clone())));
                }
            }
            nodes.extend(block.nodes);
            // Blocks that refer to one another in a circle would never end.
            if nodes.len() as u64 > self.header.nodes {
                break;
            }
        }
        if nodes.len() as u64 != self.header.nodes {
            let why = format!("{} nodes declared, others found", self.header.nodes);
            return Err(FormatError::malformed("octree", why));
        }
        nodes.sort_by_key(|n| n.cell);
        Ok(nodes)
    }
}

impl PageRef {
    /// Compares a page's bytes with its checksum.
    ///
    /// # Errors
    /// When they differ.
    pub fn check(&self, bytes: &[u8]) -> Result<(), FormatError> {
        let found = crc32fast::hash(bytes);
        if found == self.crc32 {
            return Ok(());
        }
        Err(FormatError::Checksum {
            what: "page",
            offset: self.offset,
            found,
            expected: self.crc32,
        })
    }

    /// Of bytes about to be written; the offset is filled in by [`FileWriter::new`].
    pub fn of_bytes(bytes: &[u8]) -> PageRef {
        PageRef { offset: 0, page_bytes: bytes.len() as u32, crc32: crc32fast::hash(bytes) }
    }
}

#[cfg(test)]
mod tests;
