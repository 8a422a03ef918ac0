//! Textures of a PLY file: which it names, and two passes over it for what its faces show of them.
//!
//! Files are named by comments (`comment TextureFile NAME`, as MeshLab writes them). Coordinates stand
//! at the corners of faces (`texcoord`, with `texnumber` where there are several files) or at vertices
//! (`texture_u texture_v`, `u v` or `s t`); v runs upwards, and textures repeat.

use std::io;

use glam::DVec3;

use super::body::{read_corners, skip_element};
use super::header::{self, Element, PropertyType};
use super::values::Values;
use super::{Plan, Role};
use crate::BATCH_ITEMS_MAX;
use crate::error::{ScanError, Spot};
use crate::input::Input;
use crate::paged::{Paged, Room};
use crate::polygon::CORNERS_MAX;
use crate::report::ScanReport;
use crate::texture::{self, ColourSource, NOWHERE, Painter, Surface, Wrap};

/// Most files of one scan.
const TEXTURES_MAX: usize = 4096;

/// Names of the two coordinates of a vertex.
const VERTEX_COORDINATES: [[&str; 2]; 3] = [["texture_u", "texture_v"], ["u", "v"], ["s", "t"]];

/// Where the coordinates are.
pub(super) struct Layout {
    /// In vertices.
    of_vertex: Option<[usize; 2]>,
    /// In faces: a list, and the number of the texture.
    of_face: Option<usize>,
    texture_number: Option<usize>,
}

impl Layout {
    /// `None` where there are no coordinates, or no faces that could have them.
    pub(super) fn find(plans: &[Plan]) -> Option<Layout> {
        let place = |element: &Element, name: &str, is_list: bool| {
            let mut properties = element.properties.iter();
            properties.position(|property| {
                property.name == name && is_list == matches!(property.of, PropertyType::List { .. })
            })
        };
        if plans.iter().any(|plan| matches!(plan.role, Role::Strips(_)) && plan.element.count > 0) {
            return None;
        }
        let mut vertices = plans.iter().filter(|plan| matches!(plan.role, Role::Vertices(_)));
        let vertices = &vertices.next()?.element;
        let mut faces = plans.iter().filter(|plan| matches!(plan.role, Role::Faces(_)));
        let faces = &faces.next()?.element;
        let of_vertex = VERTEX_COORDINATES
            .iter()
            .find_map(|[u, v]| Some([place(vertices, u, false)?, place(vertices, v, false)?]));
        let of_face = place(faces, "texcoord", true);
        let texture_number = place(faces, "texnumber", false);
        (of_vertex.is_some() || of_face.is_some()).then_some(Layout {
            of_vertex,
            of_face,
            texture_number,
        })
    }

    /// The properties that are used, as the report names those that are not.
    fn names(&self, plans: &[Plan]) -> Vec<String> {
        let mut names = Vec::new();
        for plan in plans {
            let used: Vec<usize> = match (&plan.role, self.of_face) {
                (Role::Faces(_), _) => {
                    self.of_face.into_iter().chain(self.texture_number).collect()
                }
                (Role::Vertices(_), None) => self.of_vertex.into_iter().flatten().collect(),
                _ => Vec::new(),
            };
            let element = &plan.element;
            names.extend(
                used.iter()
                    .map(|i| format!("property {}.{}", element.name, element.properties[*i].name)),
            );
        }
        names
    }
}

/// What the passes over a file need.
pub(super) struct Pass<'a> {
    pub(super) at: Spot,
    pub(super) plans: &'a [Plan],
    pub(super) layout: Layout,
    pub(super) vertex_count: u32,
    pub(super) room: &'a Room,
    pub(super) source: ColourSource,
}

impl Pass<'_> {
    /// Loads `files` and paints the vertices of all faces. `None` if a texture cannot be used and
    /// need not be.
    pub(super) fn paint(
        &self,
        mut files: Vec<String>,
        report: &mut ScanReport,
        progress: &mut dyn FnMut(u64) -> bool,
    ) -> Result<Option<Painter>, ScanError> {
        files.truncate(TEXTURES_MAX);
        let surfaces: Vec<Surface> = (0..files.len()).map(surface).collect();
        let path = &self.at.path;
        let mut fetch = |_, name: &str, allowed| texture::fetch_sibling(path, name, allowed);
        let room = self.room.part(2);
        let textures = texture::load(files, &mut fetch, self.source, &room, &self.at, report)?;
        let Some(textures) = textures else {
            return Ok(None);
        };
        let set_aside = |error| ScanError::scratch(path, error);
        let room = self.room.part(20);
        let mut painter =
            Painter::new(textures, self.vertex_count.into(), &room).map_err(set_aside)?;
        let mut of_vertices = Paged::new(&room);

        // Faces may come before vertices: a pass for each.
        let is_vertices = |role: &Role| matches!(role, Role::Vertices(_));
        self.each_record(is_vertices, progress, &mut |values, plan, _| {
            let (position, coordinates) = self.read_vertex(values, plan)?;
            if !position.is_finite() {
                // Told by the reader itself.
                return Ok(());
            }
            painter
                .add_vertex(position)
                .and_then(|()| of_vertices.push(coordinates))
                .map_err(set_aside)
        })?;
        let mut face = Face::default();
        let is_faces = |role: &Role| matches!(role, Role::Faces(_));
        self.each_record(is_faces, progress, &mut |values, plan, record| {
            self.read_face(values, plan, record, &mut face)?;
            face.complete(&mut of_vertices).map_err(set_aside)?;
            // A number of no texture leaves the face white.
            let surface = surfaces.get(face.texture).unwrap_or(&WHITE);
            if face.corners.iter().all(|corner| (*corner as usize) < of_vertices.len()) {
                painter.add_face(surface, &face.corners, &face.coordinates).map_err(set_aside)?;
            }
            Ok(())
        })?;
        painter.finish();
        let used = self.layout.names(self.plans);
        report.skipped.retain(|name| !used.contains(name));
        texture::account(&painter, report);
        Ok(Some(painter))
    }

    /// Calls `visit` at the begin of each record of the elements wanted.
    fn each_record(
        &self,
        is_wanted: impl Fn(&Role) -> bool,
        progress: &mut dyn FnMut(u64) -> bool,
        visit: &mut dyn FnMut(&mut Values, &Plan, u64) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        let mut input = Input::open(&self.at.path)?;
        let header = header::read(&mut input)?;
        let mut values = Values::new(input, header.format);
        for plan in self.plans {
            values.begin_element(&plan.element.name);
            if !is_wanted(&plan.role) {
                skip_element(&mut values, &plan.element)?;
                continue;
            }
            for record in 0..plan.element.count {
                if record % BATCH_ITEMS_MAX as u64 == 0 && !progress(0) {
                    return Err(ScanError::Stopped { at: self.at.clone() });
                }
                values.begin_record(record);
                visit(&mut values, plan, record)?;
            }
        }
        Ok(())
    }

    fn read_vertex(
        &self,
        values: &mut Values,
        plan: &Plan,
    ) -> Result<(DVec3, [f32; 2]), ScanError> {
        let Role::Vertices(columns) = &plan.role else {
            return Ok((DVec3::ZERO, NOWHERE));
        };
        let mut position = DVec3::ZERO;
        let mut coordinates = NOWHERE;
        for (index, property) in plan.element.properties.iter().enumerate() {
            let axis = columns.slots[index].filter(|slot| super::POSITION.contains(slot));
            let of_texture =
                self.layout.of_vertex.and_then(|of| of.iter().position(|i| *i == index));
            match (property.of, axis, of_texture) {
                (PropertyType::Scalar(scalar), Some(axis), _) => {
                    position[axis] = values.scalar(scalar)?;
                }
                (PropertyType::Scalar(scalar), _, Some(place)) => {
                    coordinates[place] = values.scalar(scalar)? as f32;
                }
                (other, ..) => values.skip(other)?,
            }
        }
        Ok((position, coordinates))
    }

    fn read_face(
        &self,
        values: &mut Values,
        plan: &Plan,
        record: u64,
        face: &mut Face,
    ) -> Result<(), ScanError> {
        let Role::Faces(list) = plan.role else {
            return Ok(());
        };
        face.texture = 0;
        face.coordinates.clear();
        for (index, property) in plan.element.properties.iter().enumerate() {
            if index == list.property {
                read_corners(values, list, (record, self.vertex_count), &mut face.corners)?;
                continue;
            }
            match property.of {
                PropertyType::List { count, item } if Some(index) == self.layout.of_face => {
                    let length = values.list_length(count, item)?;
                    face.numbers.clear();
                    for place in 0..length {
                        let number = values.scalar(item)?;
                        if place < 3 * CORNERS_MAX as u64 {
                            face.numbers.push(number as f32);
                        }
                    }
                }
                PropertyType::Scalar(scalar) if Some(index) == self.layout.texture_number => {
                    let number = values.scalar(scalar)?;
                    // −1 is what some write for faces without a texture.
                    face.texture = if number >= 0.0 { number as usize } else { usize::MAX };
                }
                other => values.skip(other)?,
            }
        }
        Ok(())
    }
}

/// A face being read.
#[derive(Default)]
struct Face {
    corners: Vec<u32>,
    /// As in the file: two of each corner, or three.
    numbers: Vec<f32>,
    coordinates: Vec<[f32; 2]>,
    texture: usize,
}

impl Face {
    /// Brings a corner's coordinates together, from the face where it has them, else from vertices.
    fn complete(&mut self, of_vertices: &mut Paged<[f32; 2]>) -> io::Result<()> {
        self.coordinates.clear();
        let numbers = std::mem::take(&mut self.numbers);
        let each = numbers.len() / self.corners.len().max(1);
        let is_whole = numbers.len() == each * self.corners.len();
        for (place, corner) in self.corners.iter().enumerate() {
            let corner = *corner as usize;
            self.coordinates.push(match each {
                2 | 3 if is_whole => [numbers[each * place], numbers[each * place + 1]],
                0 if corner < of_vertices.len() => of_vertices.get(corner)?,
                _ => NOWHERE,
            });
        }
        self.numbers = numbers;
        Ok(())
    }
}

/// What a face with no texture shows.
const WHITE: Surface = Surface {
    texture: None,
    factor: [1.0; 3],
    texture_from_file: Surface::FROM_LOWER_LEFT,
    wrap: [Wrap::Repeat; 2],
};

fn surface(texture: usize) -> Surface {
    Surface { texture: Some(texture), ..WHITE }
}
