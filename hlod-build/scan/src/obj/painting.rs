//! Where the colours of an OBJ file come from, and what its faces are painted with.

use std::collections::HashMap;
use std::io;

use super::Points;
use super::material::{self, Materials};
use crate::error::{ScanError, Spot};
use crate::paged::Room;
use crate::report::ScanReport;
use crate::texture::{ColourSource, ColourTaken, Painter, Surface, Wrap};

impl Points {
    /// Decides where colours come from, and loads textures if from these.
    pub(super) fn choose_colours(
        &mut self,
        source: ColourSource,
        room: &Room,
        at: &Spot,
        report: &mut ScanReport,
    ) -> Result<Option<Materials>, ScanError> {
        let has_textures = self.coordinates.len() > 0 && !self.names.libraries.is_empty();
        let takes_textures = source.takes_textures(self.has_colours);
        if self.has_colours && !source.takes_vertex_colours() {
            report.colours.left_out.push("colours of vertices".to_owned());
        }
        self.has_colours &= source.takes_vertex_colours();
        if self.has_colours {
            report.colours.taken = ColourTaken::Vertex;
        }
        if has_textures && !takes_textures {
            report.colours.left_out.push("textures".to_owned());
        }
        let materials = match has_textures && takes_textures {
            true => material::load(&self.names, source, room, at, report)?,
            false => None,
        };
        if materials.is_some() {
            let used = ["statement vt", "statement mtllib", "statement usemtl"];
            report.skipped.retain(|name| !used.contains(&name.as_str()));
        } else if source == ColourSource::Texture {
            return Err(ScanError::NoTexture { at: at.clone() });
        }
        Ok(materials)
    }
}

/// What faces are painted with.
pub(super) struct Painting {
    pub(super) painter: Painter,
    pub(super) surfaces: HashMap<String, Surface>,
    /// Of the faces that follow.
    pub(super) current: Surface,
    /// Of the corners of the current line.
    pub(super) coordinates: Vec<[f32; 2]>,
}

impl Painting {
    pub(super) const PLAIN: Surface = Surface {
        texture: None,
        factor: [1.0; 3],
        texture_from_file: Surface::FROM_LOWER_LEFT,
        wrap: [Wrap::Repeat; 2],
    };

    pub(super) fn new(
        materials: Materials,
        points: &mut Points,
        room: &Room,
    ) -> io::Result<Painting> {
        let Materials { textures, surfaces } = materials;
        let vertices = points.positions.len();
        let mut painter = Painter::new(textures, vertices as u64, room)?;
        for vertex in 0..vertices {
            painter.add_vertex(points.positions.get(vertex)?)?;
        }
        Ok(Painting { painter, surfaces, current: Self::PLAIN, coordinates: Vec::new() })
    }
}
