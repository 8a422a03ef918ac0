//! The octree without its geometry, in blocks that are loaded like pages.
//!
//! A block holds a forest: the eight or fewer children of one node and as many of their
//! descendants as fit in [`BLOCK_BYTES_MAX`], breadth first. All children of a node lie next to
//! one another, either in the node's own block or at the start of another.

use crate::bytes::{ByteReader, ByteWriter};
use crate::{CellKey, FormatError, OctNormal, PageRef};

/// No block is longer.
pub const BLOCK_BYTES_MAX: usize = 64 * 1024;

/// No page is longer, in bytes: hundreds of times what pages of scans take, and decoded within a second.
pub const PAGE_BYTES_MAX: u32 = 1 << 25;

/// Where a skeleton block lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockRef {
    /// First byte in the file.
    pub offset: u64,
    /// Length in bytes, at most [`BLOCK_BYTES_MAX`].
    pub block_bytes: u32,
    /// CRC-32 of those bytes.
    pub crc32: u32,
}

impl BlockRef {
    pub(crate) const BYTES: usize = 16;

    pub(crate) fn write(&self, w: &mut ByteWriter) {
        w.u64(self.offset);
        w.u32(self.block_bytes);
        w.u32(self.crc32);
    }

    pub(crate) fn read(r: &mut ByteReader<'_>) -> Result<BlockRef, FormatError> {
        let block = BlockRef { offset: r.u64()?, block_bytes: r.u32()?, crc32: r.u32()? };
        if block.block_bytes as usize > BLOCK_BYTES_MAX {
            let why = format!("a block of {} bytes", block.block_bytes);
            return Err(FormatError::malformed("skeleton block", why));
        }
        Ok(block)
    }

    /// First byte behind the block.
    pub(crate) fn end(&self) -> u64 {
        self.offset.saturating_add(u64::from(self.block_bytes))
    }
}

/// What a representation is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
#[repr(u8)]
pub enum RepresentationKind {
    /// The scan's own geometry (leaves): serves every purpose.
    Source = 1,
    /// Simplified so that shape and shading stay (receivers).
    Appearance = 2,
    /// Simplified so that shape stays (casters, comparison).
    Geometric = 3,
}

/// How far an error can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
#[repr(u8)]
pub enum BoundStatus {
    /// Sampled or estimated after simplification: the truth may be larger.
    Measured = 1,
    /// A bound that holds for what the file stores.
    Proven = 2,
}

/// Errors of a representation against the original geometry inside the cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Two-sided Hausdorff distance ε_geo, in the source's unit.
    pub geometric: f32,
    /// What `geometric` is worth.
    pub geometric_status: BoundStatus,
    /// ε_vis, in the source's unit: how far from its place what is seen of the original is found
    /// on this representation. An estimate, never below `geometric`.
    pub visual: f32,
    /// Deviation of normals in degrees. For every point of either surface there is a point of the
    /// other within `geometric` whose normal differs by no more than the first; for 99 and 90 % of
    /// this surface's area by no more than the others. As trustworthy as `geometric`, against the
    /// original's normals after smoothing.
    pub normal_deviation_deg: [f32; 3],
    /// The original's normals were smoothed by no more than this, in degrees: detail below the
    /// resolution of the level at which it was lost, and vertices at one place joined.
    pub normal_smoothing_deg: f32,
    /// On the faces of its cell the surface ends in lines: how far these are, within the faces,
    /// from the original's sections with them, in the source's unit. As trustworthy as
    /// `geometric`.
    pub border: f32,
}

impl Errors {
    /// Of geometry that is the original.
    pub const NONE: Errors = Errors {
        geometric: 0.0,
        geometric_status: BoundStatus::Proven,
        visual: 0.0,
        normal_deviation_deg: [0.0; 3],
        normal_smoothing_deg: 0.0,
        border: 0.0,
    };

    const BYTES: usize = 4 + 1 + 4 + 12 + 4 + 4;
}

/// One way in which a node can be drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Representation {
    /// What it is for.
    pub kind: RepresentationKind,
    /// How far it is from the original.
    pub errors: Errors,
    /// Vertices in the page.
    pub vertices: u32,
    /// Triangles in the page.
    pub triangles: u32,
    /// Points in the page.
    pub points: u32,
    /// The largest of the radii at which the points cover, in the source's unit; 0 without points.
    pub cover_radius: f32,
    /// The page.
    pub page: PageRef,
}

impl Representation {
    /// The error by which a node is selected, in the source's unit: shape alone for geometric
    /// representations, what is seen for all others.
    pub fn selecting_error(&self) -> f32 {
        match self.kind {
            RepresentationKind::Geometric => self.errors.geometric,
            _ => self.errors.geometric.max(self.errors.visual),
        }
    }

    const BYTES: usize = 1 + Errors::BYTES + 16 + 16;
}

/// Properties of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NodeFlags {
    /// The surface that passes through the cell is closed and faces outwards, so that its back
    /// can never be seen.
    pub closed_oriented: bool,
}

/// A cone that holds every normal of a node's stored and original triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalCone {
    /// The cone's axis.
    pub axis: OctNormal,
    /// Cosine of the half angle between axis and the farthest normal; −1 where no cone culls.
    pub cosine: f32,
}

impl NormalCone {
    /// Holds every direction.
    pub const ALL: NormalCone = NormalCone { axis: OctNormal([0, 0]), cosine: -1.0 };
}

/// Where a node's children are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Children {
    /// The node is a leaf.
    None,
    /// They start at this index of the same block.
    Here(u32),
    /// They are the first nodes of another block.
    Block(BlockRef),
}

/// One node of the octree.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeRecord {
    /// Its cell.
    pub cell: CellKey,
    /// Bit i is set where octant i holds geometry.
    pub child_mask: u8,
    /// Properties.
    pub flags: NodeFlags,
    /// Tight bounds of all of the node's geometry, original and simplified, in lattice steps.
    pub bounds: [[i32; 3]; 2],
    /// All its normals.
    pub cone: NormalCone,
    /// The ways in which it can be drawn.
    pub representations: Vec<Representation>,
    /// Where its children are.
    pub children: Children,
}

impl NodeRecord {
    /// Whether the node has no children.
    pub fn is_leaf(&self) -> bool {
        self.child_mask == 0
    }

    /// The representation for `kind`: a leaf's source geometry serves every kind, and of points there
    /// is an appearance alone.
    pub fn representation(&self, kind: RepresentationKind) -> Option<&Representation> {
        let of = |kind| self.representations.iter().find(|r| r.kind == kind);
        of(kind)
            .or_else(|| of(RepresentationKind::Source))
            .or_else(|| of(RepresentationKind::Appearance))
    }

    pub(crate) fn record_bytes(representations: usize, is_leaf: bool) -> usize {
        // cell, mask, flags, bounds, cone, number of representations, place of the children
        let children = if is_leaf { 0 } else { 1 + BlockRef::BYTES };
        9 + 2 + 24 + 8 + 1 + representations * Representation::BYTES + children
    }

    /// The record by itself, as blocks hold it.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut w = ByteWriter::default();
        self.write(&mut w);
        w.bytes
    }

    /// Reads what [`Self::to_bytes`] wrote.
    ///
    /// # Errors
    /// When the bytes are not a record.
    pub fn parse(bytes: &[u8]) -> Result<NodeRecord, FormatError> {
        let mut r = ByteReader::new("node record", bytes);
        let record = NodeRecord::read(&mut r)?;
        if r.remaining() > 0 {
            return Err(FormatError::malformed("node record", "bytes are left over"));
        }
        Ok(record)
    }

    fn write(&self, w: &mut ByteWriter) {
        w.u8(self.cell.depth());
        w.u64(self.cell.morton());
        w.u8(self.child_mask);
        w.u8(u8::from(self.flags.closed_oriented));
        w.vec3_i32(self.bounds[0]);
        w.vec3_i32(self.bounds[1]);
        w.put(bytemuck::bytes_of(&self.cone.axis));
        w.f32(self.cone.cosine);
        w.u8(self.representations.len() as u8);
        for r in &self.representations {
            w.u8(r.kind as u8);
            w.f32(r.errors.geometric);
            w.u8(r.errors.geometric_status as u8);
            w.f32(r.errors.visual);
            for angle in r.errors.normal_deviation_deg {
                w.f32(angle);
            }
            w.f32(r.errors.normal_smoothing_deg);
            w.f32(r.errors.border);
            w.u32(r.vertices);
            w.u32(r.triangles);
            w.u32(r.points);
            w.f32(r.cover_radius);
            w.u64(r.page.offset);
            w.u32(r.page.page_bytes);
            w.u32(r.page.crc32);
        }
        match self.children {
            Children::None => {}
            Children::Here(first) => {
                w.u8(0);
                w.u32(first);
                w.put(&[0; BlockRef::BYTES - 4]);
            }
            Children::Block(block) => {
                w.u8(1);
                block.write(w);
            }
        }
    }

    fn read(r: &mut ByteReader<'_>) -> Result<NodeRecord, FormatError> {
        let bad = |why: &str| Err(FormatError::malformed("skeleton block", why));
        let cell = CellKey::from_parts(r.u8()?, r.u64()?)?;
        let child_mask = r.u8()?;
        let flags = NodeFlags { closed_oriented: r.u8()? & 1 == 1 };
        let bounds = [r.vec3_i32()?, r.vec3_i32()?];
        if (0..3).any(|i| bounds[0][i] > bounds[1][i]) {
            return bad("a node's bounds are inside out");
        }
        let axis = OctNormal([r.u16()? as i16, r.u16()? as i16]);
        let cosine = r.f32()?;
        if !axis.is_valid() || !(-1.0..=1.0).contains(&cosine) {
            return bad("a normal cone is not one");
        }
        let mut representations = Vec::new();
        for _ in 0..r.u8()? {
            representations.push(Self::read_representation(r)?);
        }
        let children = if child_mask == 0 {
            Children::None
        } else if r.u8()? == 0 {
            let first = r.u32()?;
            r.take(BlockRef::BYTES - 4)?;
            Children::Here(first)
        } else {
            Children::Block(BlockRef::read(r)?)
        };
        Ok(NodeRecord {
            cell,
            child_mask,
            flags,
            bounds,
            cone: NormalCone { axis, cosine },
            representations,
            children,
        })
    }

    fn read_representation(r: &mut ByteReader<'_>) -> Result<Representation, FormatError> {
        let bad = |why: &str| Err(FormatError::malformed("skeleton block", why));
        let kind = match r.u8()? {
            1 => RepresentationKind::Source,
            2 => RepresentationKind::Appearance,
            3 => RepresentationKind::Geometric,
            _ => return bad("unknown kind of representation"),
        };
        let geometric = r.f32()?;
        let geometric_status = match r.u8()? {
            1 => BoundStatus::Measured,
            2 => BoundStatus::Proven,
            _ => return bad("unknown kind of bound"),
        };
        let visual = r.f32()?;
        let normal_deviation_deg = [r.f32()?, r.f32()?, r.f32()?];
        let normal_smoothing_deg = r.f32()?;
        let border = r.f32()?;
        let is_length = |length: f32| length >= 0.0 && length.is_finite();
        let mut angles = normal_deviation_deg.iter().chain([&normal_smoothing_deg]);
        if ![geometric, visual, border].into_iter().all(is_length)
            || angles.any(|a| !(0.0..=180.0).contains(a))
        {
            return bad("an error is not a length or an angle");
        }
        let (vertices, triangles, points) = (r.u32()?, r.u32()?, r.u32()?);
        let cover_radius = r.f32()?;
        if !is_length(cover_radius) {
            return bad("a radius is not a length");
        }
        let page = PageRef { offset: r.u64()?, page_bytes: r.u32()?, crc32: r.u32()? };
        if page.page_bytes > PAGE_BYTES_MAX {
            return bad("a page is longer than any can be");
        }
        Ok(Representation {
            kind,
            errors: Errors {
                geometric,
                geometric_status,
                visual,
                normal_deviation_deg,
                normal_smoothing_deg,
                border,
            },
            vertices,
            triangles,
            points,
            cover_radius,
            page,
        })
    }
}

/// A block of nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct SkeletonBlock {
    /// The nodes; the first ones are siblings, the children of the node that refers to the
    /// block (or the root).
    pub nodes: Vec<NodeRecord>,
}

impl SkeletonBlock {
    pub(crate) const PREFIX_BYTES: usize = 4;

    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut w = ByteWriter::default();
        w.u32(self.nodes.len() as u32);
        for node in &self.nodes {
            node.write(&mut w);
        }
        w.bytes
    }

    /// Reads a block after checking its checksum, and checks that every reference inside it
    /// leads to the child it names.
    ///
    /// # Errors
    /// When the bytes are damaged or contradict themselves.
    pub fn parse(bytes: &[u8], block: BlockRef) -> Result<SkeletonBlock, FormatError> {
        let found = crc32fast::hash(bytes);
        if found != block.crc32 {
            let (what, offset, expected) = ("skeleton block", block.offset, block.crc32);
            return Err(FormatError::Checksum { what, offset, found, expected });
        }
        let mut r = ByteReader::new("skeleton block", bytes);
        let count = r.u32()? as usize;
        if count * NodeRecord::record_bytes(0, true) > r.remaining() {
            return Err(FormatError::malformed(
                "skeleton block",
                format!("{count} nodes do not fit"),
            ));
        }
        let nodes = (0..count).map(|_| NodeRecord::read(&mut r)).collect::<Result<Vec<_>, _>>()?;
        r.finish()?;
        let block = SkeletonBlock { nodes };
        block.validate().map_err(|why| FormatError::malformed("skeleton block", why))?;
        Ok(block)
    }

    /// Says what is inconsistent about the block, if anything is.
    ///
    /// # Errors
    /// A sentence that names the first thing wrong.
    pub fn validate(&self) -> Result<(), String> {
        if self.nodes.is_empty() {
            return Err("it holds no node".into());
        }
        for (i, node) in self.nodes.iter().enumerate() {
            if node.representations.is_empty() {
                return Err(format!("node {} has nothing to draw", node.cell));
            }
            let Children::Here(first) = node.children else { continue };
            // Children come behind their parent, so that no walk can run in a circle.
            if first as usize <= i {
                return Err(format!("the children of node {} lie before it", node.cell));
            }
            let octants = (0..8).filter(|o| node.child_mask >> o & 1 == 1);
            for (k, octant) in octants.enumerate() {
                let child = self.nodes.get(first as usize + k);
                if node.cell.depth() >= crate::MAX_DEPTH
                    || child.map(|c| c.cell) != Some(node.cell.child(octant))
                {
                    return Err(format!(
                        "child {octant} of node {} is not where it should be",
                        node.cell
                    ));
                }
            }
        }
        Ok(())
    }

    /// Checks that the block's first nodes are the children of `parent`.
    ///
    /// # Errors
    /// When they are others.
    pub fn check_is_child_block_of(&self, parent: &NodeRecord) -> Result<(), FormatError> {
        let octants = (0..8u8).filter(|o| parent.child_mask >> o & 1 == 1);
        let fits = parent.cell.depth() < crate::MAX_DEPTH
            && octants.enumerate().all(|(k, octant)| {
                self.nodes.get(k).map(|n| n.cell) == Some(parent.cell.child(octant))
            });
        if fits {
            Ok(())
        } else {
            let why = format!("it does not hold the children of node {}", parent.cell);
            Err(FormatError::malformed("skeleton block", why))
        }
    }
}
