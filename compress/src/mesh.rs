//! The content of a page of triangles.

use crate::{OctNormal, Scalars};

/// Indexed triangles on the file's lattice; the content of one node's page.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Mesh {
    /// Positions in lattice steps, one a vertex.
    pub positions: Vec<[i32; 3]>,
    /// Unit normals, one a vertex.
    pub normals: Vec<OctNormal>,
    /// sRGB and alpha, one a vertex, or empty where the model has no colour.
    pub colours: Vec<[u8; 4]>,
    /// Kept scalars, one a vertex, or empty where none has a value.
    pub scalars: Vec<Scalars>,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Whether vertices carry a colour.
    pub fn has_colours(&self) -> bool {
        !self.colours.is_empty()
    }

    /// Says what is inconsistent about the mesh, if anything is.
    ///
    /// # Errors
    /// A sentence that names the first thing wrong.
    pub fn validate(&self) -> Result<(), String> {
        let vertex_count = self.positions.len();
        if self.normals.len() != vertex_count {
            return Err(format!("{} normals for {vertex_count} vertices", self.normals.len()));
        }
        if self.has_colours() && self.colours.len() != vertex_count {
            return Err(format!("{} colours for {vertex_count} vertices", self.colours.len()));
        }
        if !self.scalars.is_empty() && self.scalars.len() != vertex_count {
            return Err(format!("{} scalars for {vertex_count} vertices", self.scalars.len()));
        }
        if let Some(i) = self.normals.iter().position(|n| !n.is_valid()) {
            return Err(format!("normal {i} lies off the octahedron"));
        }
        match self.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= vertex_count)) {
            Some(i) => {
                Err(format!("triangle {i} uses a vertex beyond the {vertex_count} there are"))
            }
            None => Ok(()),
        }
    }

    /// Smallest and largest coordinates in lattice steps; `None` for a mesh without vertices.
    pub fn bounds(&self) -> Option<([i32; 3], [i32; 3])> {
        bounds_of(&self.positions)
    }
}

pub(crate) fn bounds_of(positions: &[[i32; 3]]) -> Option<([i32; 3], [i32; 3])> {
    let first = *positions.first()?;
    Some(positions.iter().fold((first, first), |(lo, hi), p| {
        (std::array::from_fn(|i| lo[i].min(p[i])), std::array::from_fn(|i| hi[i].max(p[i])))
    }))
}
