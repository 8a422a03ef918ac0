//! The octree as far as it is loaded.

use glam::DVec3;
use hlod_compress::{
    BlockRef, CellKey, Children, Lattice, NodeRecord, PageRef, RepresentationKind, SkeletonBlock,
};

/// A node, in model space (source coordinates relative to the root cube's centre).
#[derive(Debug, Clone)]
pub struct Node {
    /// Its cell.
    pub cell: CellKey,
    /// Depth; 0 is the root.
    pub depth: u8,
    /// Index of its parent; the root's is its own.
    pub parent: u32,
    /// Lowest and highest corner of its cell.
    pub cell_box: [DVec3; 2],
    /// Lowest corner of its geometry.
    pub min: DVec3,
    /// Highest corner.
    pub max: DVec3,
    /// Axis and half angle (radians) of a cone that holds all normals, where one exists and backs
    /// can never be seen.
    pub cone: Option<(DVec3, f64)>,
    /// Whether backs can never be seen from outside.
    pub closed_oriented: bool,
    /// The ways in which it can be drawn.
    pub representations: Vec<NodeRepresentation>,
    /// Its children.
    pub children: ChildLink,
}

/// One way in which a node can be drawn.
#[derive(Debug, Clone, Copy)]
pub struct NodeRepresentation {
    /// What it is for.
    pub kind: RepresentationKind,
    /// The error by which it is selected, in the source's unit.
    pub error: f64,
    /// How far its surface may be from the scan's, in the source's unit.
    pub geometric_error: f64,
    /// How far the lines in which it ends on its cell's faces may be from the scan's, in the source's
    /// unit.
    pub border_error: f64,
    /// Triangles in its page.
    pub triangles: u32,
    /// Vertices in its page.
    pub vertices: u32,
    /// Points in its page.
    pub points: u32,
    /// The largest of their radii, in the source's unit.
    pub cover_radius: f64,
    /// Its page.
    pub page: PageRef,
}

/// Where a node's children are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ChildLink {
    /// A leaf.
    None,
    /// Nodes with these indices.
    Nodes {
        /// Index of the first.
        first: u32,
        /// How many.
        count: u32,
    },
    /// In a block that is not loaded.
    Unloaded(BlockRef),
}

/// The nodes of one file that are known so far; node 0 is the root.
#[derive(Debug, Clone)]
pub struct Skeleton {
    lattice: Lattice,
    nodes: Vec<Node>,
}

impl Skeleton {
    /// Begins with the root's block.
    pub fn new(lattice: Lattice, root: &SkeletonBlock) -> Skeleton {
        let mut skeleton = Skeleton { lattice, nodes: Vec::new() };
        skeleton.append(root);
        skeleton
    }

    /// All known nodes.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Bytes in memory.
    pub(crate) fn bytes(&self) -> u64 {
        let representations: usize = self.nodes.iter().map(|n| n.representations.capacity()).sum();
        let bytes = self.nodes.capacity() * size_of::<Node>()
            + representations * size_of::<NodeRepresentation>();
        bytes as u64
    }

    /// Adds the block that holds the children of `parent`; a block that was added before is
    /// ignored.
    pub fn add_children(&mut self, parent: u32, block: &SkeletonBlock) {
        if !matches!(self.nodes[parent as usize].children, ChildLink::Unloaded(_)) {
            return;
        }
        let depth = self.nodes[parent as usize].depth + 1;
        let count = block.nodes.iter().take(8).take_while(|n| n.cell.depth() == depth).count();
        let first = self.append(block);
        self.nodes[parent as usize].children = ChildLink::Nodes { first, count: count as u32 };
        self.be_parent(parent);
    }

    fn append(&mut self, block: &SkeletonBlock) -> u32 {
        let base = self.nodes.len() as u32;
        let nodes: Vec<Node> = block.nodes.iter().map(|n| self.node(n, base)).collect();
        self.nodes.extend(nodes);
        for parent in base..self.nodes.len() as u32 {
            self.be_parent(parent);
        }
        base
    }

    /// Tells a node's children whose they are.
    fn be_parent(&mut self, parent: u32) {
        if let ChildLink::Nodes { first, count } = self.nodes[parent as usize].children {
            let children = self.nodes.iter_mut().skip(first as usize).take(count as usize);
            children.for_each(|child| child.parent = parent);
        }
    }

    fn node(&self, record: &NodeRecord, base: u32) -> Node {
        let half = f64::from(self.lattice.root_units) / 2.0;
        let place =
            |p: [i32; 3]| DVec3::from_array(p.map(|c| (f64::from(c) - half) * self.lattice.step));
        let cone = (record.flags.closed_oriented && record.cone.cosine > 0.0).then(|| {
            let axis = DVec3::from_array(record.cone.axis.decode().map(f64::from)).normalize();
            (axis, f64::from(record.cone.cosine).acos())
        });
        let low = self.lattice.cell_min(record.cell);
        let units = self.lattice.cell_units(record.cell.depth()) as i32;
        Node {
            cell: record.cell,
            cell_box: [place(low), place(low.map(|c| c + units))],
            depth: record.cell.depth(),
            parent: 0,
            min: place(record.bounds[0]),
            max: place(record.bounds[1]),
            cone,
            closed_oriented: record.flags.closed_oriented,
            representations: record
                .representations
                .iter()
                .map(|r| NodeRepresentation {
                    kind: r.kind,
                    error: r.selecting_error().into(),
                    geometric_error: r.errors.geometric.into(),
                    border_error: r.errors.border.into(),
                    triangles: r.triangles,
                    vertices: r.vertices,
                    points: r.points,
                    cover_radius: r.cover_radius.into(),
                    page: r.page,
                })
                .collect(),
            children: match record.children {
                Children::None => ChildLink::None,
                Children::Here(first) => {
                    ChildLink::Nodes { first: base + first, count: record.child_mask.count_ones() }
                }
                Children::Block(block) => ChildLink::Unloaded(block),
            },
        }
    }
}

impl Node {
    /// Index of the representation for `kind`: a leaf's source geometry serves every kind, and of
    /// points there is an appearance alone.
    pub fn representation(&self, kind: RepresentationKind) -> Option<usize> {
        let of = |kind| self.representations.iter().position(|r| r.kind == kind);
        of(kind)
            .or_else(|| of(RepresentationKind::Source))
            .or_else(|| of(RepresentationKind::Appearance))
    }
}
