//! glTF 2.0, binary (`.glb`) and as JSON (`.gltf`): the triangles of its scene.
//!
//! Node transforms are applied, in f64; a mesh that stands at several nodes is
//! delivered several times. Materials, textures, skins and morph targets are passed
//! over.
//!
//! `buffers` finds the bytes, `accessor` decodes arrays, `scene` flattens the node
//! tree; this module reads the container and hands out batches.

mod accessor;
mod buffers;
mod scene;

use ::gltf::json;
use glam::{DMat3, DMat4, DVec3, Vec3};

use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::polygon::{self, Strip};
use crate::report::ScanReport;
use crate::{
    BATCH_ITEMS_MAX, Batch, Opened, ReadBatches, ScanFormat, TriangleBatch, VertexBatch,
    unit_normal, unit_to_byte,
};

use accessor::Accessor;
use buffers::Buffers;
use scene::{Scene, Shape};

/// Largest JSON part. Parsed it takes many times its size.
const JSON_BYTES_MAX: u64 = 512 * 1024 * 1024;

/// Required extensions that leave triangles as they are, or that are done here.
const EXTENSIONS_FINE: [&str; 7] = [
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_texture_basisu",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_animation_pointer",
    "KHR_xmp_json_ld",
];

/// Corners read at once: whole triangles of a list, at most a batch of a strip.
const READ_CORNERS_MAX: usize = BATCH_ITEMS_MAX / 3 * 3;

/// Reads the document and flattens its scene.
pub(crate) fn open(mut input: Input, report: &mut ScanReport) -> Result<Opened, ScanError> {
    let (text, chunk) = match report.format {
        ScanFormat::Glb => read_container(&mut input, report)?,
        _ => (read_text(&mut input, None)?, None),
    };
    let root = parse(&text, &input)?;
    drop(text);
    check_extensions(&root, &input)?;

    let mut buffers = Buffers::new(input.path(), &root, chunk);
    let scene = scene::flatten(&root, &mut buffers, report)?;
    let parts = || {
        let ranges = scene.instances.iter().map(|instance| instance.parts.clone());
        ranges.flatten().map(|part| &scene.parts[part])
    };
    // Sums of hostile counts may not fit; saturated they are refused just as well.
    let vertices = parts().fold(0u64, |sum, part| sum.saturating_add(part.positions.count));
    if vertices > u64::from(u32::MAX) {
        let at = Spot::new(input.path(), Place::File);
        return Err(ScanError::TooManyVertices { at, vertices });
    }
    let faces = parts().fold(0u64, |sum, part| {
        let corners = part.corner_count();
        sum.saturating_add(match part.shape {
            Shape::List => corners / 3,
            Shape::Strip | Shape::Fan => corners.saturating_sub(2),
        })
    });
    let is_soup = |part: &scene::Part| part.shape == Shape::List && part.indices.is_none();
    Ok(Opened {
        vertices: Some(vertices),
        faces: Some(faces),
        has_normals: parts().any(|part| part.normals.is_some()),
        has_colours: parts().any(|part| part.colours.is_some()),
        is_triangle_soup: vertices > 0 && parts().all(is_soup),
        is_point_cloud: false,
        scalars: Vec::new(),
        body: Box::new(GltfReader {
            has_normals: parts().any(|part| part.normals.is_some()),
            has_colours: parts().any(|part| part.colours.is_some()),
            items_total: parts()
                .map(|part| part.positions.count as f64 + part.corner_count() as f64)
                .sum(),
            items_read: 0.0,
            file_bytes: input.file_bytes(),
            scene,
            buffers,
            instance: 0,
            part: 0,
            first_vertex: 0,
            vertices_read: 0,
            corners_read: 0,
            strip: Strip::default(),
            fan: [0; 2],
        }),
    })
}

/// Text of the JSON chunk, and begin and size of the binary chunk.
type Container = (Vec<u8>, Option<(u64, u64)>);

/// Reads the chunks of a `.glb` file.
fn read_container(input: &mut Input, report: &mut ScanReport) -> Result<Container, ScanError> {
    let [magic, version, length] = read_words(input)?;
    if magic != u32::from_le_bytes(*b"glTF") {
        let what = "a binary glTF file begins with `glTF`, this one does not";
        return Err(ScanError::malformed(input.at_byte(), what));
    }
    if version != 2 {
        return Err(ScanError::Unsupported {
            at: input.at_byte(),
            what: format!("glTF version {version}"),
            advice: "export as glTF 2.0",
        });
    }
    let file_bytes = input.file_bytes();
    if u64::from(length) > file_bytes {
        return Err(ScanError::CountTooLarge {
            at: input.at_byte(),
            what: "bytes".to_owned(),
            declared: length.into(),
            possible: file_bytes,
        });
    }
    if u64::from(length) < file_bytes {
        let surplus = file_bytes - u64::from(length);
        let warning = format!("{surplus} bytes after the end were not read");
        report.warnings.push(warning);
    }

    let [json_bytes, kind] = read_words(input)?;
    if kind != u32::from_le_bytes(*b"JSON") {
        let what = "the first chunk is not JSON";
        return Err(ScanError::malformed(input.at_byte(), what));
    }
    let text = read_text(input, Some(json_bytes.into()))?;
    if input.offset() >= u64::from(length) {
        return Ok((text, None));
    }
    let [bin_bytes, kind] = read_words(input)?;
    if kind != u32::from_le_bytes(*b"BIN\0") {
        return Ok((text, None));
    }
    if u64::from(bin_bytes) > input.remaining_bytes() {
        return Err(ScanError::CountTooLarge {
            at: input.at_byte(),
            what: "bytes of the binary chunk".to_owned(),
            declared: bin_bytes.into(),
            possible: input.remaining_bytes(),
        });
    }
    Ok((text, Some((input.offset(), bin_bytes.into()))))
}

fn read_words<const N: usize>(input: &mut Input) -> Result<[u32; N], ScanError> {
    let mut words = [0; N];
    for word in &mut words {
        *word = match input.take(4)? {
            Some(bytes) => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            None => {
                let what = "the chunks of a binary glTF file".to_owned();
                let at = input.at_byte();
                return Err(ScanError::Truncated { at, what });
            }
        };
    }
    Ok(words)
}

/// Reads `length` bytes, or the rest of the file.
fn read_text(input: &mut Input, length: Option<u64>) -> Result<Vec<u8>, ScanError> {
    let possible = input.remaining_bytes();
    let length = length.unwrap_or(possible);
    if length > possible {
        return Err(ScanError::CountTooLarge {
            at: input.at_byte(),
            what: "bytes of JSON".to_owned(),
            declared: length,
            possible,
        });
    }
    if length > JSON_BYTES_MAX {
        return Err(ScanError::Unsupported {
            at: input.at_byte(),
            what: format!("a JSON part of {length} bytes"),
            advice: "export as .glb, whose data is not JSON",
        });
    }
    let mut text = Vec::with_capacity(length as usize);
    while (text.len() as u64) < length {
        let bytes = input.peek(1)?;
        let count = bytes.len().min(length as usize - text.len());
        if count == 0 {
            let what = "the JSON part".to_owned();
            let at = input.at_byte();
            return Err(ScanError::Truncated { at, what });
        }
        text.extend_from_slice(&bytes[..count]);
        input.consume(count);
    }
    Ok(text)
}

fn parse(text: &[u8], input: &Input) -> Result<json::Root, ScanError> {
    let root = json::Root::from_slice(text).map_err(|error| {
        // In a .glb lines do not count from the begin of the file.
        let place = Place::Item(format!("JSON line {}", error.line()));
        let what = format!("the glTF document is not valid: {error}");
        ScanError::malformed(Spot::new(input.path(), place), what)
    })?;
    if !root.asset.version.starts_with("2.") {
        return Err(ScanError::Unsupported {
            at: Spot::new(input.path(), Place::Item("asset".to_owned())),
            what: format!("glTF version {}", root.asset.version),
            advice: "export as glTF 2.0",
        });
    }
    Ok(root)
}

fn check_extensions(root: &json::Root, input: &Input) -> Result<(), ScanError> {
    let is_fine =
        |name: &String| name.starts_with("KHR_materials_") || EXTENSIONS_FINE.contains(&&**name);
    match root.extensions_required.iter().find(|name| !is_fine(name)) {
        None => Ok(()),
        Some(name) => Err(ScanError::Unsupported {
            at: Spot::new(input.path(), Place::Item("extensionsRequired".to_owned())),
            what: format!("the extension {name}, which this file requires,"),
            advice: "export without it",
        }),
    }
}

struct GltfReader {
    scene: Scene,
    buffers: Buffers,
    has_normals: bool,
    has_colours: bool,
    /// Vertices and corners, for the progress: data lies anywhere, even in other files.
    items_total: f64,
    items_read: f64,
    file_bytes: u64,
    /// The instance being read, which of its parts, that one's first vertex, and how
    /// far it is read.
    instance: usize,
    part: usize,
    first_vertex: u64,
    vertices_read: u64,
    corners_read: u64,
    strip: Strip,
    /// The hub of a fan and the corner before.
    fan: [u32; 2],
}

impl ReadBatches for GltfReader {
    fn next_batch(&mut self, report: &mut ScanReport) -> Result<Option<Batch>, ScanError> {
        while let Some(instance) = self.scene.instances.get(self.instance) {
            let Some(part) = instance.parts.clone().nth(self.part) else {
                self.instance += 1;
                self.part = 0;
                continue;
            };
            let world_from_part = instance.world_from_mesh;
            let vertex_count = self.scene.parts[part].positions.count;
            let corner_count = self.scene.parts[part].corner_count();
            if self.vertices_read < vertex_count {
                return self.read_vertices(part, world_from_part, report).map(Some);
            }
            if self.corners_read < corner_count {
                let triangles = self.read_triangles(part, world_from_part, report)?;
                if !triangles.is_empty() {
                    return Ok(Some(Batch::Triangles(TriangleBatch { triangles })));
                }
                continue;
            }
            self.part += 1;
            self.first_vertex += vertex_count;
            self.vertices_read = 0;
            self.corners_read = 0;
            self.strip.restart();
        }
        Ok(None)
    }

    fn bytes_read(&self) -> u64 {
        let share = self.items_read / self.items_total.max(1.0);
        (share * self.file_bytes as f64) as u64
    }
}

impl GltfReader {
    fn read_vertices(
        &mut self,
        part: usize,
        world_from_part: DMat4,
        report: &mut ScanReport,
    ) -> Result<Batch, ScanError> {
        let part = &self.scene.parts[part];
        let buffers = &mut self.buffers;
        let begin = self.vertices_read;
        let mut batch = VertexBatch::default();
        let mut items = Vec::new();

        part.positions.read(buffers, begin, BATCH_ITEMS_MAX, &mut items)?;
        let count = items.len();
        for (vertex, [x, y, z, _]) in (self.first_vertex + begin..).zip(&items) {
            let position = DVec3::new(*x, *y, *z);
            let position = world_from_part.transform_point3(position);
            if !position.is_finite() {
                let at = buffers.at(part.positions.item.clone());
                return Err(ScanError::NotFinite { at, vertex });
            }
            batch.positions.push(position);
        }

        if let Some(normals) = &part.normals {
            let to_world = normal_matrix(DMat3::from_mat4(world_from_part));
            normals.read(buffers, begin, BATCH_ITEMS_MAX, &mut items)?;
            batch.normals.extend(
                items
                    .iter()
                    .map(|[x, y, z, _]| unit_normal(to_world * DVec3::new(*x, *y, *z), report)),
            );
        } else if self.has_normals {
            batch.normals.resize(count, Vec3::ZERO);
            report.normals_absent += count as u64;
        }

        if let Some(colours) = &part.colours {
            let has_alpha = colours.component_count == 4;
            colours.read(buffers, begin, BATCH_ITEMS_MAX, &mut items)?;
            batch.colours.extend(items.iter().map(|[r, g, b, a]| {
                let [r, g, b] = [*r, *g, *b].map(|linear| unit_to_byte(srgb_from_linear(linear)));
                [r, g, b, if has_alpha { unit_to_byte(*a) } else { 255 }]
            }));
        } else if self.has_colours {
            batch.colours.resize(count, [255; 4]);
        }
        self.vertices_read += count as u64;
        self.items_read += count as f64;
        Ok(Batch::Vertices(batch))
    }

    fn read_triangles(
        &mut self,
        part: usize,
        world_from_part: DMat4,
        report: &mut ScanReport,
    ) -> Result<Vec<[u32; 3]>, ScanError> {
        let part = &self.scene.parts[part];
        let begin = self.corners_read;
        let corners = match &part.indices {
            Some(indices) => {
                let at = |buffers: &Buffers| buffers.at(indices.item.clone());
                read_indices(indices, &mut self.buffers, begin, part.positions.count).map_err(
                    |error| match error {
                        IndexError::Read(error) => error,
                        IndexError::OutOfRange(corner, index) => ScanError::IndexOutOfRange {
                            at: at(&self.buffers),
                            face: corner / 3,
                            index: index as i64,
                            vertices: part.positions.count,
                        },
                    },
                )?
            }
            None => {
                let end = part.positions.count.min(begin + READ_CORNERS_MAX as u64);
                (begin..end).map(|corner| corner as u32).collect()
            }
        };
        self.corners_read += corners.len() as u64;
        self.items_read += corners.len() as f64;

        let mut triangles = Vec::new();
        match part.shape {
            Shape::List => {
                for corners in corners.chunks_exact(3) {
                    let corners = [corners[0], corners[1], corners[2]];
                    report.faces_read += 1;
                    if polygon::repeats_corner(corners) {
                        report.degenerate_faces += 1;
                    } else {
                        triangles.push(corners);
                    }
                }
            }
            Shape::Strip => {
                for corner in corners {
                    triangles.extend(self.strip.add(corner, report));
                }
            }
            Shape::Fan => {
                for (place, corner) in (begin..).zip(corners) {
                    let [hub, before] = self.fan;
                    self.fan[1] = corner;
                    match place {
                        0 => {
                            report.strips += 1;
                            self.fan[0] = corner;
                        }
                        1 => {}
                        _ if polygon::repeats_corner([hub, before, corner]) => {
                            report.strip_stitches += 1;
                        }
                        _ => triangles.push([hub, before, corner]),
                    }
                }
            }
        }
        // A mirroring transform turns triangles inside out; turn them back.
        let is_mirrored = world_from_part.determinant() < 0.0;
        let first = self.first_vertex as u32;
        for triangle in &mut triangles {
            *triangle = triangle.map(|corner| first + corner);
            if is_mirrored {
                triangle.swap(1, 2);
            }
        }
        Ok(triangles)
    }
}

enum IndexError {
    Read(ScanError),
    /// Number of the corner, and its index.
    OutOfRange(u64, f64),
}

fn read_indices(
    indices: &Accessor,
    buffers: &mut Buffers,
    begin: u64,
    vertex_count: u64,
) -> Result<Vec<u32>, IndexError> {
    let mut items = Vec::new();
    indices.read(buffers, begin, READ_CORNERS_MAX, &mut items).map_err(IndexError::Read)?;
    let numbered = (begin..).zip(items);
    numbered
        .map(|(corner, [index, ..])| {
            // A list of floats or of negative numbers has no right to be here either.
            let is_index = index >= 0.0 && index < vertex_count as f64 && index.fract() == 0.0;
            is_index.then_some(index as u32).ok_or(IndexError::OutOfRange(corner, index))
        })
        .collect()
}

/// Inverse transpose, up to a positive factor: normals are made unit length anyway,
/// and the cofactors exist even where the inverse does not.
fn normal_matrix(m: DMat3) -> DMat3 {
    let cofactors = DMat3::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    );
    cofactors * if m.determinant() < 0.0 { -1.0 } else { 1.0 }
}

/// The transfer function of IEC 61966-2-1.
fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.0031308 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}
