//! How a long-running library call says where it is.

/// Told by library calls where they are, possibly from several threads at once.
pub trait Progress: Sync {
    /// A stage begins; `total` is what its `advance` calls will add up to.
    fn begin(&self, stage: &'static str, total: u64, unit: Unit);
    /// More of the current stage is done.
    fn advance(&self, count: u64);
    /// The current stage is complete.
    fn end(&self);
    /// Something worth knowing that is no error.
    fn remark(&self, _text: &str) {}
    /// Whether the work is to stop at the next place from which it can go on later.
    fn is_stopped(&self) -> bool {
        false
    }
}

/// What a stage counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Bytes read or written.
    Bytes,
    /// Triangles.
    Triangles,
    /// Points.
    Points,
    /// Octree nodes.
    Nodes,
    /// Parts of the work.
    Steps,
}

/// Says nothing.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: &'static str, _total: u64, _unit: Unit) {}
    fn advance(&self, _count: u64) {}
    fn end(&self) {}
}
