//! How far a statue reaches along directions that are not those of its bounds.

use glam::DVec3;

use crate::error::RenderError;
use crate::leaves::{LeafRef, Leaves};

/// The least and the most along each direction, of all vertices or points of the leaves: exactly. Only leaves whose
/// bounds reach beyond what was found are read, a few of thousands.
///
/// # Errors
/// When the file cannot be read or is damaged.
pub fn extents(leaves: &Leaves, directions: [DVec3; 3]) -> Result<[[f64; 2]; 3], RenderError> {
    let all = leaves.within(|_, _| true)?;
    let mut found = [[0.0; 2]; 3];
    for (extent, direction) in found.iter_mut().zip(directions) {
        *extent = [-most(leaves, &all, -direction)?, most(leaves, &all, direction)?];
    }
    Ok(found)
}

/// The most along one direction.
fn most(leaves: &Leaves, all: &[LeafRef], direction: DVec3) -> Result<f64, RenderError> {
    let reach = |leaf: &LeafRef| (leaf.min * direction).max(leaf.max * direction).element_sum();
    let mut farthest: Vec<(f64, &LeafRef)> = all.iter().map(|leaf| (reach(leaf), leaf)).collect();
    farthest.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut most = f64::NEG_INFINITY;
    for (reach, leaf) in farthest {
        if reach <= most {
            break;
        }
        let read = leaves.load(leaf)?;
        let content = &read.content;
        let positions = content.mesh.positions.iter().chain(&content.points.positions);
        most = positions.map(|p| leaves.place(*p).dot(direction)).fold(most, f64::max);
    }
    Ok(most)
}
