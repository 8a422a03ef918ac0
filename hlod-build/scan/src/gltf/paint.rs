//! Base colours of a document's materials, averaged into colours of its vertices.
//!
//! A reader of its own goes over the scene before the one that delivers it, in the same order.

use ::gltf::json;
use json::accessor::Type;
use json::material::PbrMetallicRoughness;
use json::mesh::Semantic;
use json::texture::WrappingMode;
use json::validation::Checked;

use super::GltfReader;
use super::accessor::{Accessor, Scale};
use super::buffers::{self, Buffers};
use super::scene::Part;
use crate::error::{ScanError, Spot};
use crate::paged::{Paged, Room};
use crate::report::ScanReport;
use crate::texture::{self, ColourSource, NOWHERE, Painter, Refusal, Surface, Texture, Wrap};
use crate::{BATCH_ITEMS_MAX, Batch};

/// What a part is painted with, and its texture coordinates.
struct Coat {
    surface: Surface,
    coordinates: Option<Accessor>,
}

/// Whether any part shows a texture.
pub(super) fn has_textures(root: &json::Root, parts: &[Part]) -> bool {
    parts.iter().any(|part| texture_info(root, part).is_some())
}

/// Goes over the scene of `reader` and paints its vertices. `None` if a texture cannot be used and
/// need not be.
pub(super) fn paint(
    root: &json::Root,
    reader: &mut GltfReader,
    source: ColourSource,
    room: &Room,
    at: &Spot,
    report: &mut ScanReport,
    progress: &mut dyn FnMut(u64) -> bool,
) -> Result<Option<Painter>, ScanError> {
    let mut images = Vec::new();
    for part in &reader.scene.parts {
        if let Some((_, image)) = texture_info(root, part)
            && !images.contains(&image)
        {
            images.push(image);
        }
    }
    let Some(textures) = load(root, &mut reader.buffers, &images, source, room, at, report)? else {
        return Ok(None);
    };
    let mut coats = Vec::new();
    for part in &reader.scene.parts {
        coats.push(coat(root, &mut reader.buffers, part, &images)?);
    }

    let set_aside = |error| ScanError::scratch(&at.path, error);
    let room = room.part(20);
    let vertices = reader.vertices();
    let mut painter = Painter::new(textures, vertices, &room).map_err(set_aside)?;
    let mut of_vertices = Paged::new(&room);
    let mut items = Vec::new();
    // What it counts is counted again when it is delivered.
    let mut uncounted = ScanReport::new(at.path.clone(), report.format, 0);
    while let Some((part, batch)) = reader.step(&mut uncounted)? {
        if !progress(0) {
            return Err(ScanError::Stopped { at: at.clone() });
        }
        let coat = &coats[part];
        match batch {
            Batch::Vertices(batch) => {
                items.clear();
                let count = batch.positions.len();
                if let Some(coordinates) = &coat.coordinates {
                    let begin = reader.vertices_read - count as u64;
                    coordinates.read(&mut reader.buffers, begin, BATCH_ITEMS_MAX, &mut items)?;
                }
                for (i, position) in batch.positions.into_iter().enumerate() {
                    let coordinates = match items.get(i) {
                        Some([u, v, ..]) => [*u as f32, *v as f32],
                        None => NOWHERE,
                    };
                    painter
                        .add_vertex(position)
                        .and_then(|()| of_vertices.push(coordinates))
                        .map_err(set_aside)?;
                }
            }
            Batch::Triangles(batch) => {
                for triangle in batch.triangles {
                    let mut coordinates = [NOWHERE; 3];
                    for (at, vertex) in coordinates.iter_mut().zip(triangle) {
                        *at = of_vertices.get(vertex as usize).map_err(set_aside)?;
                    }
                    painter.add_face(&coat.surface, &triangle, &coordinates).map_err(set_aside)?;
                }
            }
        }
    }
    painter.finish();
    texture::account(&painter, report);
    Ok(Some(painter))
}

fn material<'a>(root: &'a json::Root, part: &Part) -> Option<&'a PbrMetallicRoughness> {
    let (mesh, primitive) = part.primitive;
    let material = root.meshes.get(mesh)?.primitives.get(primitive)?.material?;
    Some(&root.materials.get(material.value())?.pbr_metallic_roughness)
}

/// The base colour texture of a part and the number of its image.
fn texture_info<'a>(root: &'a json::Root, part: &Part) -> Option<(&'a json::texture::Info, usize)> {
    let info = material(root, part)?.base_color_texture.as_ref()?;
    // A number of no image is left to be told when it is loaded.
    let image = root.textures.get(info.index.value()).map_or(usize::MAX, |t| t.source.value());
    Some((info, image))
}

fn load(
    root: &json::Root,
    buffers: &mut Buffers,
    images: &[usize],
    source: ColourSource,
    room: &Room,
    at: &Spot,
    report: &mut ScanReport,
) -> Result<Option<Vec<Texture>>, ScanError> {
    let name = |index: &usize| {
        let uri = root.images.get(*index).and_then(|image| image.uri.clone());
        uri.filter(|uri| !uri.starts_with("data:")).unwrap_or_else(|| match index {
            // Of a texture in a format of some extension alone.
            &usize::MAX | 0xffff_ffff => "of a material".to_owned(),
            index => format!("images[{index}]"),
        })
    };
    let mut fetch = |number: usize, _: &str, allowed| -> Result<Vec<u8>, Refusal> {
        let Some(image) = images.get(number).and_then(|index| root.images.get(*index)) else {
            return Err(Refusal::Unusable("has no PNG or JPEG image; export it as one".into()));
        };
        let text = |error: ScanError| Refusal::Unusable(format!("cannot be read: {error}"));
        match (&image.uri, image.buffer_view) {
            (Some(uri), _) if uri.starts_with("data:") => buffers::decode_data_uri(uri)
                .ok_or_else(|| Refusal::Unusable("is no valid base64".into())),
            (Some(uri), _) => match buffers::decode_percent(uri) {
                Some(name) => texture::fetch_sibling(&at.path, &name, allowed),
                None => Err(Refusal::Unusable("has a wrong % sequence in its name".into())),
            },
            (None, Some(view)) => buffers
                .read_view(root, view.value(), allowed)
                .map_err(text)?
                .ok_or(Refusal::Memory(allowed.saturating_add(1))),
            (None, None) => Err(Refusal::Unusable("has no content".into())),
        }
    };
    let names = images.iter().map(name).collect();
    texture::load(names, &mut fetch, source, &room.part(2), at, report)
}

fn coat(
    root: &json::Root,
    buffers: &mut Buffers,
    part: &Part,
    images: &[usize],
) -> Result<Coat, ScanError> {
    let mut surface = Surface {
        texture: None,
        factor: [1.0; 3],
        texture_from_file: Surface::FROM_UPPER_LEFT,
        wrap: [Wrap::Repeat; 2],
    };
    let Some(material) = material(root, part) else {
        return Ok(Coat { surface, coordinates: None });
    };
    let [r, g, b, _] = material.base_color_factor.0.map(f64::from);
    surface.factor = [r, g, b];
    let Some((info, image)) = texture_info(root, part) else {
        return Ok(Coat { surface, coordinates: None });
    };
    surface.texture = images.iter().position(|other| *other == image);
    let mut set = info.tex_coord;
    let transform = info.extensions.as_ref().and_then(|all| all.texture_transform.as_ref());
    if let Some(transform) = transform {
        set = transform.tex_coord.unwrap_or(set);
        let [x, y] = transform.offset.0.map(f64::from);
        let [s, t] = transform.scale.0.map(f64::from);
        let (sin, cos) = f64::from(transform.rotation.0).sin_cos();
        surface.texture_from_file = [[cos * s, sin * t, x], [-sin * s, cos * t, y]];
    }
    let sampler = root.textures.get(info.index.value()).and_then(|texture| texture.sampler);
    if let Some(sampler) = sampler.and_then(|sampler| root.samplers.get(sampler.value())) {
        surface.wrap = [&sampler.wrap_s, &sampler.wrap_t].map(|mode| match mode {
            Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
            Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
            _ => Wrap::Repeat,
        });
    }
    let (mesh, primitive) = part.primitive;
    let attributes = &root.meshes[mesh].primitives[primitive].attributes;
    let coordinates = attributes
        .get(&Checked::Valid(Semantic::TexCoords(set)))
        .map(|index| Accessor::open(root, buffers, index.value(), &[Type::Vec2], Scale::AsDeclared))
        .transpose()?;
    // Of another length they belong to other vertices.
    let coordinates = coordinates.filter(|of| of.count == part.positions.count);
    Ok(Coat { surface, coordinates })
}
