//! Colours of vertices where the file has textures.
//!
//! `decode` reads image files, `filter` averages textures, `paint` collects what each vertex stands
//! for. This module loads the textures that a file names and accounts for them.

mod decode;
mod filter;
mod paint;

use std::fmt;
use std::io::Read;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{ScanError, Spot};
use crate::paged::Room;
use crate::report::ScanReport;
use crate::sibling;

pub(crate) use decode::Refusal;
pub(crate) use filter::{Texture, Wrap, linear_from_srgb, srgb_from_linear};
pub(crate) use paint::{NOWHERE, Painter, Surface};

/// Where the colours of vertices are taken from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColourSource {
    /// From vertices where the file has colours there, else from its textures; none where these
    /// cannot be used, which is remarked upon.
    #[default]
    Auto,
    /// From vertices alone.
    Vertex,
    /// From textures alone; what cannot be used is an error.
    Texture,
    /// There are to be none.
    None,
}

impl fmt::Display for ColourSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ColourSource::Auto => "auto",
            ColourSource::Vertex => "vertex",
            ColourSource::Texture => "texture",
            ColourSource::None => "none",
        })
    }
}

impl std::str::FromStr for ColourSource {
    type Err = String;

    fn from_str(text: &str) -> Result<ColourSource, String> {
        use ColourSource::{Auto, None, Texture, Vertex};
        let mut all = [Auto, Vertex, Texture, None].into_iter();
        all.find(|source| source.to_string() == text)
            .ok_or_else(|| "expected auto, vertex, texture or none".to_owned())
    }
}

impl ColourSource {
    /// Whether colours that vertices have are used.
    pub(crate) fn takes_vertex_colours(self) -> bool {
        matches!(self, ColourSource::Auto | ColourSource::Vertex)
    }

    /// Whether textures are used, given whether vertices have colours.
    pub(crate) fn takes_textures(self, has_vertex_colours: bool) -> bool {
        match self {
            ColourSource::Auto => !has_vertex_colours,
            ColourSource::Texture => true,
            ColourSource::Vertex | ColourSource::None => false,
        }
    }
}

/// Where the colours of a scan come from; keys are stable.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ColourReport {
    /// `vertex`, `texture`, or `none`.
    pub taken: ColourTaken,
    /// What the file has besides, which was not taken.
    pub left_out: Vec<String>,
    /// The textures taken.
    pub textures: Vec<TextureReport>,
    /// How many texels a vertex stands for, in the mean over the model: colours of vertices are so
    /// much coarser than the texture.
    pub texels_a_vertex: f64,
    /// Corners of faces without coordinates in their texture.
    pub corners_nowhere: u64,
    /// Corners of faces outside their texture, which goes on there as the file says.
    pub corners_outside: u64,
    /// Vertices that got no colour and are white.
    pub vertices_bare: u64,
}

/// What colours were taken from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColourTaken {
    /// There are none.
    #[default]
    None,
    /// The file's vertices.
    Vertex,
    /// Its textures.
    Texture,
}

/// One texture; keys are stable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct TextureReport {
    /// As the file names it.
    pub name: String,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Bits of a component; 16 are rounded to 8.
    pub bits: u32,
}

/// What textures may take where memory is not bounded.
const UNBOUNDED_BYTES: u64 = 4 << 30;

/// Gets the bytes of an image, at most so many, by its number and name.
pub(crate) type Fetch<'a> = dyn FnMut(usize, &str, u64) -> Result<Vec<u8>, Refusal> + 'a;

/// Loads the images of the scan at `at` within `room`, in their order. `None` if one of them cannot
/// be used and `source` leaves it open: then the scan has no colours, which is remarked upon.
///
/// # Errors
/// If one of them cannot be used and has to be; if they do not fit into memory.
pub(crate) fn load(
    names: Vec<String>,
    fetch: &mut Fetch<'_>,
    source: ColourSource,
    room: &Room,
    at: &Spot,
    report: &mut ScanReport,
) -> Result<Option<Vec<Texture>>, ScanError> {
    // Where nobody said how much: no image of a few bytes takes all there is.
    let allowed = if room.scratch.is_some() { room.bytes as u64 } else { UNBOUNDED_BYTES };
    let (mut textures, mut reports) = (Vec::new(), Vec::new());
    let mut kept_bytes = 0u64;
    for (number, name) in names.into_iter().enumerate() {
        let left = allowed.saturating_sub(kept_bytes);
        let decoded = fetch(number, &name, left).and_then(|encoded| decode::decode(&encoded, left));
        match decoded {
            Ok(decoded) => {
                let [width, height] = decoded.size;
                kept_bytes += Texture::bytes(width.into(), height.into());
                if decoded.has_other_profile {
                    report.warnings.push(format!(
                        "texture `{name}` has a colour profile, which is not used: its colours \
                         are taken as sRGB"
                    ));
                }
                reports.push(TextureReport { name, width, height, bits: decoded.bits });
                textures.push(decoded.texture);
            }
            Err(Refusal::Memory(needed)) => {
                let needed_bytes = kept_bytes.saturating_add(needed);
                return Err(ScanError::TexturesTooLarge {
                    at: at.clone(),
                    name,
                    needed_bytes,
                    allowed_bytes: allowed,
                });
            }
            Err(Refusal::Unusable(what)) if source == ColourSource::Texture => {
                return Err(ScanError::Texture { at: at.clone(), name, what });
            }
            Err(Refusal::Unusable(what)) => {
                report.warnings.push(format!("no colours: texture `{name}` {what}"));
                report.colours.left_out.push(format!("texture `{name}`"));
                return Ok(None);
            }
        }
    }
    report.colours.textures = reports;
    Ok(Some(textures))
}

/// The bytes of an image that lies beside the scan.
pub(crate) fn fetch_sibling(document: &Path, name: &str, allowed: u64) -> Result<Vec<u8>, Refusal> {
    let (file, bytes) = sibling::open(document, name).map_err(Refusal::Unusable)?;
    if bytes > allowed {
        return Err(Refusal::Memory(bytes));
    }
    let mut encoded = Vec::new();
    file.take(bytes)
        .read_to_end(&mut encoded)
        .map_err(|error| Refusal::Unusable(format!("cannot be read: {error}")))?;
    Ok(encoded)
}

/// Enters what a painter has done.
pub(crate) fn account(painter: &Painter, report: &mut ScanReport) {
    let colours = &mut report.colours;
    colours.taken = ColourTaken::Texture;
    colours.texels_a_vertex = painter.texels_a_vertex();
    colours.corners_nowhere = painter.painted.corners_nowhere;
    colours.corners_outside = painter.painted.corners_outside;
    colours.vertices_bare = painter.painted.vertices_bare;
}

#[cfg(test)]
mod tests;
