//! Wavefront OBJ: vertices, normals, vertex colours and faces of a text.
//!
//! Two passes, because a face may name vertices that come later, and its corners carry
//! the normals: the first collects `v` and `vn`, the second reads `f`. The whole model
//! is held meanwhile, on disk where memory does not hold it; batches are then cut from it.
//!
//! Textures (`vt`, `mtllib`, `usemtl`, read in `material`) are averaged into colours of vertices in the
//! second pass, where these have none of their own.
//!
//! Objects and groups are passed over: a scan cut into groups is one
//! surface, and each `v` stays one vertex whoever names it. (The usual library for
//! this format splits vertices at group borders and texture seams, which tears the
//! surface apart.) A vertex whose corners name several normals gets their mean.

mod material;
mod painting;
mod statement;

use std::io;
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::paged::{Paged, Room};
use crate::polygon::{self, CORNERS_MAX};
use crate::report::ScanReport;
use crate::texture::{self, ColourSource, NOWHERE, Painter};
use crate::{
    BATCH_ITEMS_MAX, Batch, Opened, ReadBatches, TriangleBatch, VertexBatch, unit_normal,
    unit_to_byte,
};

use material::{Materials, Names, rest_of};
use painting::Painting;
use statement::{Statement, each_statement};

/// Reads the whole model.
pub(crate) fn open(
    mut input: Input,
    room: &Room,
    colour: ColourSource,
    report: &mut ScanReport,
    progress: &mut dyn FnMut(u64) -> bool,
) -> Result<Opened, ScanError> {
    // Half is for textures; arrays are positions, colours, normals and coordinates of the first
    // pass, sums and triangles of the second, and four of the painter.
    let (all, room) = (room, room.part(20));
    // First pass: what faces can name.
    let mut points = Points::new(&room);
    let mut halfway = |bytes: u64| progress(bytes / 2);
    each_statement(&mut input, &mut halfway, |statement| points.read(statement, report))?;
    if points.colours_out_of_range > 0 {
        report.warnings.push(format!(
            "{} vertex colours lie outside 0..1 and were clamped",
            points.colours_out_of_range
        ));
    }
    let at = Spot::new(input.path(), Place::File);
    let materials = points.choose_colours(colour, &all.part(2), &at, report)?;

    // Second pass: faces, and with their corners the normals.
    let mut input = Input::open(input.path())?;
    let half = input.file_bytes() / 2;
    let mut faces = Faces::new(points, materials, &room, input.path())?;
    let mut second_half = |bytes: u64| progress(half + bytes / 2);
    each_statement(&mut input, &mut second_half, |statement| faces.read(statement, report))?;

    faces.account(report);
    let Faces { points, normal_sums, has_normals, triangles, painting, .. } = faces;
    let painter = painting.map(|painting| painting.painter);
    Ok(Opened {
        vertices: Some(points.positions.len() as u64),
        faces: Some(report.faces_read),
        has_normals,
        has_colours: points.has_colours || painter.is_some(),
        is_triangle_soup: false,
        is_point_cloud: false,
        scalars: Vec::new(),
        body: Box::new(ObjReader {
            path: input.path().to_path_buf(),
            points,
            normal_sums,
            has_normals,
            triangles,
            painter,
            vertices_given: 0,
            triangles_given: 0,
            file_bytes: input.file_bytes(),
        }),
    })
}

/// The first pass.
struct Points {
    positions: Paged<DVec3>,
    /// One for each position, white where the file colours others only.
    colours: Paged<[u8; 4]>,
    has_colours: bool,
    colours_out_of_range: u64,
    /// Of unit length, or zero where unusable.
    normals: Paged<DVec3>,
    /// Texture coordinates, and what else is needed of textures.
    coordinates: Paged<[f32; 2]>,
    names: Names,
}

impl Points {
    fn new(room: &Room) -> Points {
        Points {
            positions: Paged::new(room),
            colours: Paged::new(room),
            has_colours: false,
            colours_out_of_range: 0,
            normals: Paged::new(room),
            coordinates: Paged::new(room),
            names: Names::default(),
        }
    }

    fn read(
        &mut self,
        mut statement: Statement<'_>,
        report: &mut ScanReport,
    ) -> Result<(), ScanError> {
        match statement.keyword {
            "v" => self.read_vertex(statement),
            "vn" => {
                let normal = DVec3::from_array(statement.numbers()?);
                let scale = normal.abs().max_element();
                let unit = (normal / scale).normalize_or_zero();
                self.normals.push(unit).map_err(|e| ScanError::scratch(statement.path, e))
            }
            "f" => Ok(()),
            other => {
                self.read_of_textures(&statement)?;
                // Once for each keyword: files have few, but a damaged one may have many.
                let name = format!("statement {other}");
                if report.skipped.len() < 32 && !report.skipped.contains(&name) {
                    report.skipped.push(name);
                }
                Ok(())
            }
        }
    }

    /// `vt u`, `vt u v`, `vt u v w`, and the names of materials.
    fn read_of_textures(&mut self, statement: &Statement<'_>) -> Result<(), ScanError> {
        if statement.keyword != "vt" {
            self.names.read(statement);
            return Ok(());
        }
        let mut words = statement.words.clone();
        // What is no number is of no use, but no reason to refuse the shape.
        let mut next = || words.next().map_or(Ok(0.0), str::parse::<f32>);
        let coordinates = next().and_then(|u| Ok([u, next()?])).unwrap_or(NOWHERE);
        self.coordinates.push(coordinates).map_err(|e| ScanError::scratch(statement.path, e))
    }

    /// `v x y z`, `v x y z w`, `v x y z r g b` or `v x y z r g b a`.
    fn read_vertex(&mut self, mut statement: Statement<'_>) -> Result<(), ScanError> {
        let vertex = self.positions.len() as u64;
        let position = DVec3::from_array(statement.numbers()?);
        if !position.is_finite() {
            let at = statement.at();
            return Err(ScanError::NotFinite { at, vertex });
        }
        if vertex == u64::from(u32::MAX) {
            return Err(ScanError::TooManyVertices { at: statement.at(), vertices: vertex + 1 });
        }
        let mut rest = [1.0; 4];
        let mut rest_count = 0;
        while let Some(word) = statement.words.next().filter(|_| rest_count < 4) {
            rest[rest_count] = statement.number(word)?;
            rest_count += 1;
        }
        let colour = (rest_count >= 3).then(|| rest.map(unit_to_byte));
        if colour.is_some() && rest.iter().any(|value| !(0.0..=1.0).contains(value)) {
            self.colours_out_of_range += 1;
        }
        self.has_colours |= colour.is_some();
        self.positions
            .push(position)
            .and_then(|()| self.colours.push(colour.unwrap_or([255; 4])))
            .map_err(|error| ScanError::scratch(statement.path, error))
    }
}

/// The second pass.
struct Faces {
    points: Points,
    /// Sum of the normals of each vertex's corners; empty if the file has no normals.
    normal_sums: Paged<DVec3>,
    /// Whether any corner names one that is of use.
    has_normals: bool,
    /// Vertices and normals before the current line: negative numbers count back
    /// from there.
    positions_seen: usize,
    normals_seen: usize,
    coordinates_seen: usize,
    corners: Vec<u32>,
    /// Of the current line.
    of_line: Vec<[u32; 3]>,
    triangles: Paged<[u32; 3]>,
    painting: Option<Painting>,
}

impl Faces {
    fn new(
        mut points: Points,
        materials: Option<Materials>,
        room: &Room,
        path: &Path,
    ) -> Result<Faces, ScanError> {
        let painting = materials.map(|materials| Painting::new(materials, &mut points, room));
        let painting = painting.transpose().map_err(|e| ScanError::scratch(path, e))?;
        let mut normal_sums = Paged::new(room);
        if points.normals.len() > 0 {
            for _ in 0..points.positions.len() {
                normal_sums.push(DVec3::ZERO).map_err(|error| ScanError::scratch(path, error))?;
            }
        }
        Ok(Faces {
            points,
            normal_sums,
            has_normals: false,
            positions_seen: 0,
            normals_seen: 0,
            coordinates_seen: 0,
            corners: Vec::new(),
            of_line: Vec::new(),
            triangles: Paged::new(room),
            painting,
        })
    }

    fn read(
        &mut self,
        mut statement: Statement<'_>,
        report: &mut ScanReport,
    ) -> Result<(), ScanError> {
        match statement.keyword {
            "v" => self.positions_seen += 1,
            "vn" => self.normals_seen += 1,
            "vt" => self.coordinates_seen += 1,
            "usemtl" => {
                if let Some(painting) = &mut self.painting {
                    let known = painting.surfaces.get(&rest_of(&statement));
                    painting.current = known.cloned().unwrap_or(Painting::PLAIN);
                }
            }
            "f" => {
                self.corners.clear();
                if let Some(painting) = &mut self.painting {
                    painting.coordinates.clear();
                }
                while let Some(word) = statement.words.next() {
                    self.read_corner(word, &statement, report)?;
                }
                self.of_line.clear();
                let positions = &mut self.points.positions;
                let position = |index: u32| positions.get(index as usize);
                polygon::add_face(&self.corners, position, &mut self.of_line, report)
                    .and_then(|()| self.of_line.iter().try_for_each(|t| self.triangles.push(*t)))
                    .and_then(|()| match &mut self.painting {
                        Some(Painting { painter, current, coordinates, .. }) => {
                            painter.add_face(current, &self.corners, coordinates)
                        }
                        None => Ok(()),
                    })
                    .map_err(|error| ScanError::scratch(statement.path, error))?;
            }
            _ => {}
        }
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn read_corner(
        &mut self,
        word: &str,
        statement: &Statement<'_>,
        report: &ScanReport,
    ) -> Result<(), ScanError> {
        if self.corners.len() == CORNERS_MAX {
            return Err(ScanError::Unsupported {
                at: statement.at(),
                what: format!("a face of more than {CORNERS_MAX} corners"),
                advice: "cut it into triangles first",
            });
        }
        let number = |part: &str| -> Result<i64, ScanError> {
            part.parse()
                .map_err(|_| statement.malformed(format!("`{word}` is not a corner of a face")))
        };
        let mut parts = word.split('/');
        let vertex = number(parts.next().unwrap_or_default())?;
        let coordinates = parts.next().filter(|part| !part.is_empty());
        let normal = parts.next().filter(|part| !part.is_empty());

        let count = self.points.positions.len();
        let vertex = resolve(vertex, self.positions_seen, count).map_err(|index| {
            ScanError::IndexOutOfRange {
                at: statement.at(),
                face: report.faces_read,
                index,
                vertices: count as u64,
            }
        })?;
        self.corners.push(vertex as u32);
        if let Some(painting) = &mut self.painting {
            let count = self.points.coordinates.len();
            // Numbers of coordinates that are not there leave the corner without.
            let place = coordinates
                .and_then(|number| number.parse().ok())
                .and_then(|number| resolve(number, self.coordinates_seen, count).ok());
            let at = match place {
                Some(place) => self.points.coordinates.get(place),
                None => Ok(NOWHERE),
            };
            let at = at.map_err(|error| ScanError::scratch(statement.path, error))?;
            painting.coordinates.push(at);
        }
        if let Some(normal) = normal {
            let count = self.points.normals.len();
            let normal = resolve(number(normal)?, self.normals_seen, count).map_err(|_| {
                let what = format!("`{word}` names a normal, but there are only {count}");
                statement.malformed(what)
            })?;
            let set_aside = |error| ScanError::scratch(statement.path, error);
            let sum = self.normal_sums.at(vertex).map_err(set_aside)?;
            *sum += self.points.normals.get(normal).map_err(set_aside)?;
            self.has_normals |= *sum != DVec3::ZERO;
        }
        Ok(())
    }
}

impl Faces {
    /// All faces were read.
    fn account(&mut self, report: &mut ScanReport) {
        if let Some(painting) = &mut self.painting {
            painting.painter.finish();
            texture::account(&painting.painter, report);
        }
    }
}

/// The index, from 0, of the number `written` in a face: from 1, or backwards from the
/// `seen` items before it. If out of range, the would-be index.
fn resolve(written: i64, seen: usize, count: usize) -> Result<usize, i64> {
    let index = match written {
        1.. => written - 1,
        0 => -1,
        // No file has 2⁶³ lines.
        _ => (seen as i64).saturating_add(written),
    };
    usize::try_from(index).ok().filter(|index| *index < count).ok_or(index)
}

/// Hands out what `open` has read.
struct ObjReader {
    path: PathBuf,
    points: Points,
    normal_sums: Paged<DVec3>,
    has_normals: bool,
    triangles: Paged<[u32; 3]>,
    painter: Option<Painter>,
    vertices_given: usize,
    triangles_given: usize,
    file_bytes: u64,
}

impl ObjReader {
    fn next(&mut self, report: &mut ScanReport) -> io::Result<Option<Batch>> {
        let begin = self.vertices_given;
        let end = self.points.positions.len().min(begin + BATCH_ITEMS_MAX);
        if begin < end {
            let mut batch = VertexBatch::default();
            for v in begin..end {
                batch.positions.push(self.points.positions.get(v)?);
                if self.has_normals {
                    batch.normals.push(unit_normal(self.normal_sums.get(v)?, report));
                }
                if let Some(painter) = &mut self.painter {
                    batch.colours.push(painter.colour(v)?);
                } else if self.points.has_colours {
                    batch.colours.push(self.points.colours.get(v)?);
                }
            }
            self.vertices_given = end;
            if let Some(painter) = &self.painter {
                texture::account(painter, report);
            }
            return Ok(Some(Batch::Vertices(batch)));
        }
        let begin = self.triangles_given;
        let end = self.triangles.len().min(begin + BATCH_ITEMS_MAX);
        let triangles: io::Result<Vec<[u32; 3]>> =
            (begin..end).map(|t| self.triangles.get(t)).collect();
        self.triangles_given = end;
        Ok((begin < end).then_some(Batch::Triangles(TriangleBatch { triangles: triangles? })))
    }
}

impl ReadBatches for ObjReader {
    fn next_batch(&mut self, report: &mut ScanReport) -> Result<Option<Batch>, ScanError> {
        self.next(report).map_err(|error| ScanError::scratch(&self.path, error))
    }

    /// All of it: `open` reads everything.
    fn bytes_read(&self) -> u64 {
        self.file_bytes
    }
}
