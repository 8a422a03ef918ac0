//! Wavefront OBJ: vertices, normals, vertex colours and faces of a text.
//!
//! Two passes, because a face may name vertices that come later, and its corners carry
//! the normals: the first collects `v` and `vn`, the second reads `f`. The whole model
//! is held meanwhile; batches are then cut from it.
//!
//! Objects, groups and materials are passed over: a scan cut into groups is one
//! surface, and each `v` stays one vertex whoever names it. (The usual library for
//! this format splits vertices at group borders and texture seams, which tears the
//! surface apart.) A vertex whose corners name several normals gets their mean.

use std::borrow::Cow;
use std::path::Path;
use std::str::SplitAsciiWhitespace;

use glam::{DVec3, Vec3};

use crate::error::{Place, ScanError, Spot};
use crate::input::{BUFFER_BYTES, Input};
use crate::polygon::{self, CORNERS_MAX};
use crate::report::ScanReport;
use crate::{
    BATCH_ITEMS_MAX, Batch, Opened, ReadBatches, TriangleBatch, VertexBatch, unit_normal,
    unit_to_byte,
};

/// Reads the whole model.
pub(crate) fn open(mut input: Input, report: &mut ScanReport) -> Result<Opened, ScanError> {
    // First pass: what faces can name.
    let mut points = Points::default();
    each_statement(&mut input, |statement| points.read(statement, report))?;
    if points.colours_out_of_range > 0 {
        report.warnings.push(format!(
            "{} vertex colours lie outside 0..1 and were clamped",
            points.colours_out_of_range
        ));
    }

    // Second pass: faces, and with their corners the normals.
    let mut input = Input::open(input.path())?;
    let mut faces = Faces::new(&points);
    each_statement(&mut input, |statement| faces.read(statement, report))?;

    // A file may list normals that no corner names.
    let has_normals = faces.normal_sums.iter().any(|sum| *sum != DVec3::ZERO);
    let mut normals: Vec<Vec3> = Vec::new();
    if has_normals {
        let sums = faces.normal_sums.iter();
        normals.extend(sums.map(|sum| unit_normal(*sum, report)));
    }
    let triangles = faces.triangles;
    let has_colours = points.colours.iter().any(Option::is_some);
    let mut colours = Vec::new();
    if has_colours {
        let white = [255; 4];
        colours.extend(points.colours.iter().map(|colour| colour.unwrap_or(white)));
    }
    Ok(Opened {
        vertices: Some(points.positions.len() as u64),
        faces: Some(report.faces_read),
        has_normals,
        has_colours,
        is_triangle_soup: false,
        body: Box::new(ObjReader {
            vertices: VertexBatch { positions: points.positions, normals, colours },
            triangles,
            vertices_given: 0,
            triangles_given: 0,
            file_bytes: input.file_bytes(),
        }),
    })
}

/// One line, or several joined by a backslash at their ends.
struct Statement<'a> {
    path: &'a Path,
    line: u64,
    keyword: &'a str,
    words: SplitAsciiWhitespace<'a>,
}

impl Statement<'_> {
    fn at(&self) -> Spot {
        Spot::new(self.path, Place::Line(self.line))
    }

    fn malformed(&self, what: impl Into<String>) -> ScanError {
        ScanError::malformed(self.at(), what)
    }

    fn numbers<const N: usize>(&mut self) -> Result<[f64; N], ScanError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            let Some(word) = self.words.next() else {
                let what = format!("`{}` needs {N} numbers", self.keyword);
                return Err(self.malformed(what));
            };
            *number = self.number(word)?;
        }
        Ok(numbers)
    }

    fn number(&self, word: &str) -> Result<f64, ScanError> {
        word.parse().map_err(|_| self.malformed(format!("`{word}` is not a number")))
    }
}

/// Calls `read` for each statement up to the end of the file.
fn each_statement(
    input: &mut Input,
    mut read: impl FnMut(Statement<'_>) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let path = input.path().to_path_buf();
    let mut joined = Vec::new();
    loop {
        let line_number = input.line_number();
        let Some(mut line) = input.line()? else {
            return Ok(());
        };
        // Join continued lines; few files have any.
        joined.clear();
        while let Some(begin) = line.strip_suffix(b"\\") {
            joined.extend_from_slice(begin);
            if joined.len() > BUFFER_BYTES {
                let at = Spot::new(&path, Place::Line(line_number));
                return Err(ScanError::malformed(at, "a continued line does not end"));
            }
            line = input.line()?.unwrap_or_default();
        }
        let text: Cow<'_, str> = if joined.is_empty() {
            String::from_utf8_lossy(line)
        } else {
            joined.extend_from_slice(line);
            String::from_utf8_lossy(&joined)
        };
        let text = text.split('#').next().unwrap_or_default();
        let mut words = text.split_ascii_whitespace();
        if let Some(keyword) = words.next() {
            read(Statement { path: &path, line: line_number, keyword, words })?;
        }
    }
}

/// The first pass.
#[derive(Default)]
struct Points {
    positions: Vec<DVec3>,
    /// One for each position; a file may colour some only.
    colours: Vec<Option<[u8; 4]>>,
    colours_out_of_range: u64,
    /// Of unit length, or zero where unusable.
    normals: Vec<DVec3>,
}

impl Points {
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
                self.normals.push((normal / scale).normalize_or_zero());
                Ok(())
            }
            "f" => Ok(()),
            other => {
                // Once for each keyword: files have few, but a damaged one may have many.
                let name = format!("statement {other}");
                if report.skipped.len() < 32 && !report.skipped.contains(&name) {
                    report.skipped.push(name);
                }
                Ok(())
            }
        }
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
        self.positions.push(position);
        self.colours.push(colour);
        Ok(())
    }
}

/// The second pass.
struct Faces<'a> {
    points: &'a Points,
    /// Sum of the normals of each vertex's corners; empty if the file has no normals.
    normal_sums: Vec<DVec3>,
    /// Vertices and normals before the current line: negative numbers count back
    /// from there.
    positions_seen: usize,
    normals_seen: usize,
    corners: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

impl<'a> Faces<'a> {
    fn new(points: &'a Points) -> Faces<'a> {
        let sums = match points.normals.is_empty() {
            true => 0,
            false => points.positions.len(),
        };
        Faces {
            points,
            normal_sums: vec![DVec3::ZERO; sums],
            positions_seen: 0,
            normals_seen: 0,
            corners: Vec::new(),
            triangles: Vec::new(),
        }
    }

    fn read(
        &mut self,
        mut statement: Statement<'_>,
        report: &mut ScanReport,
    ) -> Result<(), ScanError> {
        match statement.keyword {
            "v" => self.positions_seen += 1,
            "vn" => self.normals_seen += 1,
            "f" => {
                self.corners.clear();
                while let Some(word) = statement.words.next() {
                    self.read_corner(word, &statement, report)?;
                }
                let positions = &self.points.positions;
                let position = |index: u32| positions[index as usize];
                polygon::add_face(&self.corners, position, &mut self.triangles, report);
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
        let normal = parts.nth(1).filter(|part| !part.is_empty());

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
        if let Some(normal) = normal {
            let count = self.points.normals.len();
            let normal = resolve(number(normal)?, self.normals_seen, count).map_err(|_| {
                let what = format!("`{word}` names a normal, but there are only {count}");
                statement.malformed(what)
            })?;
            self.normal_sums[vertex] += self.points.normals[normal];
        }
        Ok(())
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
    vertices: VertexBatch,
    triangles: Vec<[u32; 3]>,
    vertices_given: usize,
    triangles_given: usize,
    file_bytes: u64,
}

impl ReadBatches for ObjReader {
    fn next_batch(&mut self, _report: &mut ScanReport) -> Result<Option<Batch>, ScanError> {
        let positions = batch_of(&self.vertices.positions, self.vertices_given);
        if !positions.is_empty() {
            let batch = VertexBatch {
                positions: positions.to_vec(),
                normals: batch_of(&self.vertices.normals, self.vertices_given).to_vec(),
                colours: batch_of(&self.vertices.colours, self.vertices_given).to_vec(),
            };
            self.vertices_given += batch.positions.len();
            return Ok(Some(Batch::Vertices(batch)));
        }
        let triangles = batch_of(&self.triangles, self.triangles_given).to_vec();
        self.triangles_given += triangles.len();
        if triangles.is_empty() {
            return Ok(None);
        }
        Ok(Some(Batch::Triangles(TriangleBatch { triangles })))
    }

    /// All of it: `open` reads everything.
    fn bytes_read(&self) -> u64 {
        self.file_bytes
    }
}

/// The next items from `begin`; none if the attribute is absent.
fn batch_of<T>(items: &[T], begin: usize) -> &[T] {
    let rest = items.get(begin..).unwrap_or_default();
    &rest[..rest.len().min(BATCH_ITEMS_MAX)]
}
