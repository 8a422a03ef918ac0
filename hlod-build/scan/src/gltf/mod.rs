//! glTF 2.0, binary (`.glb`) and as JSON (`.gltf`): the triangles of its scene.
//!
//! Node transforms are applied, in f64; a mesh that stands at several nodes is
//! delivered several times. The base colours of materials become colours of vertices (`paint`);
//! what else they say, skins and morph targets are passed over.
//!
//! `buffers` finds the bytes, `accessor` decodes arrays, `scene` flattens the node
//! tree; this module reads the container and hands out batches.

mod accessor;
mod buffers;
mod container;
mod paint;
mod scene;

use ::gltf::json;
use glam::{DMat3, DMat4, DVec3, Vec3};

use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::paged::Room;
use crate::polygon::{self, Strip};
use crate::report::ScanReport;
use crate::texture::{self, ColourSource, ColourTaken, Painter, srgb_from_linear};
use crate::transform::normal_matrix;
use crate::{
    BATCH_ITEMS_MAX, Batch, Opened, ReadBatches, ScanFormat, TriangleBatch, VertexBatch,
    unit_normal, unit_to_byte,
};

use accessor::Accessor;
use buffers::Buffers;
use container::{check_extensions, parse, read_container, read_text};
use scene::{Scene, Shape};

/// Corners read at once: whole triangles of a list, at most a batch of a strip.
const READ_CORNERS_MAX: usize = BATCH_ITEMS_MAX / 3 * 3;

/// Reads the document and flattens its scene.
pub(crate) fn open(
    mut input: Input,
    room: &Room,
    colour: ColourSource,
    report: &mut ScanReport,
    progress: &mut dyn FnMut(u64) -> bool,
) -> Result<Opened, ScanError> {
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
    let (has_normals, is_triangle_soup) =
        (parts().any(|part| part.normals.is_some()), vertices > 0 && parts().all(is_soup));
    let in_vertices = parts().any(|part| part.colours.is_some());
    let items_total =
        parts().map(|part| part.positions.count as f64 + part.corner_count() as f64).sum();
    let mut reader = GltfReader {
        has_normals,
        has_colours: in_vertices && colour.takes_vertex_colours(),
        items_total,
        file_bytes: input.file_bytes(),
        scene,
        buffers,
        painter: None,
        items_read: 0.0,
        instance: 0,
        part: 0,
        first_vertex: 0,
        vertices_read: 0,
        corners_read: 0,
        strip: Strip::default(),
        fan: [0; 2],
    };
    reader.choose_colours(&root, (in_vertices, colour), room, report, progress)?;
    Ok(Opened {
        vertices: Some(vertices),
        faces: Some(faces),
        has_normals,
        has_colours: reader.has_colours,
        is_triangle_soup,
        is_point_cloud: false,
        scalars: Vec::new(),
        body: Box::new(reader),
    })
}

struct GltfReader {
    scene: Scene,
    buffers: Buffers,
    has_normals: bool,
    has_colours: bool,
    /// Has the colours of vertices where these come from textures.
    painter: Option<Painter>,
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
        Ok(self.step(report)?.map(|(_, batch)| batch))
    }

    fn bytes_read(&self) -> u64 {
        let share = self.items_read / self.items_total.max(1.0);
        (share * self.file_bytes as f64) as u64
    }
}

impl GltfReader {
    /// Paints the vertices where colours come from textures, and says where they come from.
    fn choose_colours(
        &mut self,
        root: &json::Root,
        (in_vertices, source): (bool, ColourSource),
        room: &Room,
        report: &mut ScanReport,
        progress: &mut dyn FnMut(u64) -> bool,
    ) -> Result<(), ScanError> {
        let at = self.buffers.at_file();
        if self.has_colours {
            report.colours.taken = ColourTaken::Vertex;
        } else if in_vertices {
            report.colours.left_out.push("colours of vertices".to_owned());
        }
        let has_textures = paint::has_textures(root, &self.scene.parts);
        let takes_textures = source.takes_textures(self.has_colours);
        if has_textures && takes_textures {
            self.painter = paint::paint(root, self, source, room, &at, report, progress)?;
            self.has_colours |= self.painter.is_some();
            self.rewind();
        } else if has_textures {
            report.colours.left_out.push("textures".to_owned());
        }
        match source == ColourSource::Texture && self.painter.is_none() {
            true => Err(ScanError::NoTexture { at }),
            false => Ok(()),
        }
    }

    /// Vertices of all instances.
    fn vertices(&self) -> u64 {
        let parts = self.scene.instances.iter().flat_map(|instance| instance.parts.clone());
        parts.map(|part| self.scene.parts[part].positions.count).sum()
    }

    /// Begins again.
    fn rewind(&mut self) {
        (self.instance, self.part, self.first_vertex) = (0, 0, 0);
        (self.vertices_read, self.corners_read, self.items_read) = (0, 0, 0.0);
        self.strip.restart();
    }

    /// The next batch and the number of its part in the scene.
    fn step(&mut self, report: &mut ScanReport) -> Result<Option<(usize, Batch)>, ScanError> {
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
                let batch = self.read_vertices(part, world_from_part, report)?;
                return Ok(Some((part, batch)));
            }
            if self.corners_read < corner_count {
                let triangles = self.read_triangles(part, world_from_part, report)?;
                if !triangles.is_empty() {
                    return Ok(Some((part, Batch::Triangles(TriangleBatch { triangles }))));
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

        let first = (self.first_vertex + begin) as usize;
        if let Some(painter) = &mut self.painter {
            let colours = (first..first + count).map(|vertex| painter.colour(vertex));
            let colours: std::io::Result<_> = colours.collect();
            batch.colours = colours.map_err(|error| ScanError::scratch(buffers.path(), error))?;
            texture::account(painter, report);
        } else if let Some(colours) = part.colours.as_ref().filter(|_| self.has_colours) {
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
