//! The records of a PLY file, turned into batches.

use std::io;
use std::path::Path;

use glam::DVec3;

use super::header::{Element, PropertyType, ScalarType};
use super::values::{self, Values};
use super::{ALPHA, COLOUR, Columns, CornerList, NAMED_COUNT, NORMAL, Plan, Role, SLOT_COUNT};
use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::paged::{Paged, Room};
use crate::polygon::{self, CORNERS_MAX, Strip};
use crate::report::ScanReport;
use crate::texture::{self, ColourSource, Painter};
use crate::{
    BATCH_ITEMS_MAX, Batch, ReadBatches, ScanFormat, TriangleBatch, VertexBatch, unit_normal,
    unit_to_byte,
};

/// Largest vertex record that is read as one piece; others go number by number.
const RECORD_BYTES_MAX: u64 = 4096;

/// Reads one element after the other.
pub(crate) struct PlyReader {
    plans: Vec<Plan>,
    /// The element being read.
    plan: usize,
    body: Body,
    /// Has the colours of vertices where these come from textures.
    painter: Option<Painter>,
}

/// Where the reader stands, and what it must remember from record to record.
struct Body {
    values: Values,
    /// The next record of the element.
    record: u64,
    vertex_count: u32,
    /// The list of strips that the last batch ended in.
    strips: Option<StripList>,
    corners: Vec<u32>,
    /// Every vertex of the file, read by a second pass when the first polygon of more
    /// than three corners is met: which diagonals lie inside it depends on them.
    /// Scans of triangles, the huge ones among them, never pay for this.
    positions: Option<Paged<DVec3>>,
    /// For these.
    room: Room,
}

impl PlyReader {
    pub(crate) fn new(
        input: Input,
        format: ScanFormat,
        plans: Vec<Plan>,
        vertex_count: u32,
        room: Room,
        painter: Option<Painter>,
    ) -> PlyReader {
        let body = Body {
            values: Values::new(input, format),
            record: 0,
            vertex_count,
            strips: None,
            corners: Vec::new(),
            positions: None,
            room,
        };
        PlyReader { plans, plan: 0, body, painter }
    }
}

impl ReadBatches for PlyReader {
    fn next_batch(&mut self, report: &mut ScanReport) -> Result<Option<Batch>, ScanError> {
        while let Some(plan) = self.plans.get(self.plan) {
            if self.body.record == plan.element.count {
                self.plan += 1;
                self.body.record = 0;
                continue;
            }
            let first = self.body.record;
            if let Some(mut batch) = self.body.read(plan, report)? {
                if let (Batch::Vertices(batch), Some(painter)) = (&mut batch, &mut self.painter) {
                    let vertices = first as usize..self.body.record as usize;
                    let colours = vertices.map(|vertex| painter.colour(vertex));
                    batch.colours = colours.collect::<io::Result<_>>().map_err(|error| {
                        ScanError::scratch(self.body.values.input.path(), error)
                    })?;
                    texture::account(painter, report);
                }
                return Ok(Some(batch));
            }
        }
        self.body.warn_of_surplus(report)?;
        Ok(None)
    }

    fn bytes_read(&self) -> u64 {
        self.body.values.input.offset()
    }
}

impl Body {
    /// Reads some records of an element; `None` if they yield nothing.
    fn read(&mut self, plan: &Plan, report: &mut ScanReport) -> Result<Option<Batch>, ScanError> {
        let element = &plan.element;
        self.values.begin_element(&element.name);
        let triangles = match &plan.role {
            Role::Vertices(columns) => {
                let record = &mut self.record;
                let batch = read_vertices(&mut self.values, element, columns, record, report)?;
                return Ok(Some(Batch::Vertices(batch)));
            }
            Role::Faces(list) => self.read_faces(element, *list, report)?,
            Role::Strips(list) => self.read_strips(element, *list, report)?,
            Role::Skipped => {
                skip_element(&mut self.values, element)?;
                self.record = element.count;
                return Ok(None);
            }
        };
        let is_some = !triangles.is_empty();
        Ok(is_some.then_some(Batch::Triangles(TriangleBatch { triangles })))
    }

    fn read_faces(
        &mut self,
        element: &Element,
        list: CornerList,
        report: &mut ScanReport,
    ) -> Result<Vec<[u32; 3]>, ScanError> {
        let mut triangles = Vec::new();
        // The last polygon of a batch must fit, too.
        while self.record < element.count && triangles.len() + CORNERS_MAX <= BATCH_ITEMS_MAX {
            self.values.begin_record(self.record);
            for (index, property) in element.properties.iter().enumerate() {
                if index == list.property {
                    let range = (self.record, self.vertex_count);
                    read_corners(&mut self.values, list, range, &mut self.corners)?;
                } else {
                    self.values.skip(property.of)?;
                }
            }
            if self.corners.len() > 3 && self.positions.is_none() {
                let path = self.values.input.path();
                self.positions = Some(read_positions(path, self.vertex_count, &self.room)?);
            }
            let positions = &mut self.positions;
            let position = |index: u32| match positions {
                Some(positions) => positions.get(index as usize),
                // A triangle's corners are not asked for.
                None => Ok(DVec3::ZERO),
            };
            polygon::add_face(&self.corners, position, &mut triangles, report)
                .map_err(|error| ScanError::scratch(self.values.input.path(), error))?;
            self.record += 1;
        }
        Ok(triangles)
    }

    fn read_strips(
        &mut self,
        element: &Element,
        list: CornerList,
        report: &mut ScanReport,
    ) -> Result<Vec<[u32; 3]>, ScanError> {
        let mut triangles = Vec::new();
        while self.record < element.count && triangles.len() < BATCH_ITEMS_MAX {
            self.values.begin_record(self.record);
            let strips = match &mut self.strips {
                Some(strips) => strips,
                none => {
                    skip_all(&mut self.values, element, 0..list.property)?;
                    let entries_left = self.values.list_length(list.count, list.item)?;
                    none.insert(StripList { entries_left, strip: Strip::default() })
                }
            };
            let range = (self.record, self.vertex_count);
            strips.read(&mut self.values, list.item, range, &mut triangles, report)?;
            if strips.entries_left == 0 {
                self.strips = None;
                let rest = list.property + 1..element.properties.len();
                skip_all(&mut self.values, element, rest)?;
                self.record += 1;
            }
        }
        Ok(triangles)
    }

    fn warn_of_surplus(&mut self, report: &mut ScanReport) -> Result<(), ScanError> {
        if self.values.is_text() {
            self.values.input.skip_white_space()?;
        }
        let surplus = self.values.input.remaining_bytes();
        if surplus > 0 {
            let warning = format!("{surplus} bytes after the last element were not read");
            report.warnings.push(warning);
        }
        Ok(())
    }
}

/// The next batch of vertices; moves `record` on.
fn read_vertices(
    values: &mut Values,
    element: &Element,
    columns: &Columns,
    record: &mut u64,
    report: &mut ScanReport,
) -> Result<VertexBatch, ScanError> {
    let count = (element.count - *record).min(BATCH_ITEMS_MAX as u64) as usize;
    let mut batch = VertexBatch {
        positions: Vec::with_capacity(count),
        normals: Vec::with_capacity(if columns.has_normals { count } else { 0 }),
        colours: Vec::with_capacity(if columns.has_colours { count } else { 0 }),
        scalars: vec![Vec::with_capacity(count); columns.kept.len()],
    };
    let fixed = fixed_columns(values, element, columns);
    let mut numbers = [0.0; SLOT_COUNT];
    for _ in 0..count {
        values.begin_record(*record);
        let at_byte = values.input.offset();
        match &fixed {
            Some(fixed) => fixed.read(values, &mut numbers)?,
            None => {
                for (property, slot) in element.properties.iter().zip(&columns.slots) {
                    match (property.of, slot) {
                        (PropertyType::Scalar(scalar), Some(slot)) => {
                            numbers[*slot] = values.scalar(scalar)?;
                        }
                        (other, _) => values.skip(other)?,
                    }
                }
            }
        }
        let position = DVec3::new(numbers[0], numbers[1], numbers[2]);
        if !position.is_finite() {
            let at = match values.is_text() {
                true => values.at(),
                false => Spot::new(values.input.path(), Place::Byte(at_byte)),
            };
            let vertex = *record;
            return Err(ScanError::NotFinite { at, vertex });
        }
        batch.positions.push(position);
        if columns.has_normals {
            let normal = DVec3::from_slice(&numbers[NORMAL]);
            batch.normals.push(unit_normal(normal, report));
        }
        if columns.has_colours {
            let scaled =
                |i: usize| unit_to_byte(numbers[COLOUR.start + i] * columns.colour_scales[i]);
            let alpha = match columns.has_alpha {
                true => scaled(ALPHA - COLOUR.start),
                false => 255,
            };
            batch.colours.push([scaled(0), scaled(1), scaled(2), alpha]);
        }
        for (k, (column, is_there)) in batch.scalars.iter_mut().zip(&columns.kept).enumerate() {
            let number = numbers[NAMED_COUNT + k];
            column.push(if *is_there && number.is_finite() { number } else { f64::NAN });
        }
        *record += 1;
    }
    Ok(batch)
}

/// Vertex records of one size, read a record at a time.
struct FixedColumns {
    record_bytes: usize,
    /// Byte offset, type and slot of each number that is used.
    columns: Vec<(usize, ScalarType, usize)>,
}

/// `None` for texts, for records with lists and for very long ones.
fn fixed_columns(values: &Values, element: &Element, columns: &Columns) -> Option<FixedColumns> {
    let record_bytes = element.record_bytes()?;
    if values.is_text() || record_bytes > RECORD_BYTES_MAX {
        return None;
    }
    let mut offset = 0;
    let mut fixed = Vec::new();
    for (property, slot) in element.properties.iter().zip(&columns.slots) {
        let PropertyType::Scalar(scalar) = property.of else {
            return None;
        };
        fixed.extend(slot.map(|slot| (offset, scalar, slot)));
        offset += scalar.bytes();
    }
    Some(FixedColumns { record_bytes: record_bytes as usize, columns: fixed })
}

impl FixedColumns {
    fn read(&self, values: &mut Values, numbers: &mut [f64; SLOT_COUNT]) -> Result<(), ScanError> {
        let is_big_endian = values.is_big_endian();
        let Some(record) = values.input.take(self.record_bytes)? else {
            return Err(values.truncated());
        };
        for (offset, scalar, slot) in &self.columns {
            let bytes = &record[*offset..*offset + scalar.bytes()];
            numbers[*slot] = values::decode(*scalar, bytes, is_big_endian);
        }
        Ok(())
    }
}

/// Reads the corners of one face; `range` is its number and the vertex count.
pub(super) fn read_corners(
    values: &mut Values,
    list: CornerList,
    range: (u64, u32),
    corners: &mut Vec<u32>,
) -> Result<(), ScanError> {
    let length = values.list_length(list.count, list.item)?;
    if length > CORNERS_MAX as u64 {
        return Err(ScanError::Unsupported {
            at: values.at(),
            what: format!("a face of {length} corners (the most are {CORNERS_MAX})"),
            advice: "cut it into triangles first",
        });
    }
    corners.clear();
    for _ in 0..length {
        let index = values.scalar(list.item)?;
        corners.push(checked_index(values, index, range)?);
    }
    Ok(())
}

fn checked_index(
    values: &Values,
    index: f64,
    (face, vertex_count): (u64, u32),
) -> Result<u32, ScanError> {
    if index >= 0.0 && index < f64::from(vertex_count) && index.fract() == 0.0 {
        return Ok(index as u32);
    }
    if index.fract() != 0.0 {
        return Err(values.malformed(&format!("{index} is not a vertex index")));
    }
    Err(ScanError::IndexOutOfRange {
        at: values.at(),
        face,
        index: index as i64,
        vertices: vertex_count.into(),
    })
}

/// A list of strips being read; −1 begins a new strip within it.
struct StripList {
    entries_left: u64,
    strip: Strip,
}

impl StripList {
    /// Reads until the list or the batch ends. The list may be as long as the file:
    /// it is never held.
    fn read(
        &mut self,
        values: &mut Values,
        item: ScalarType,
        range: (u64, u32),
        triangles: &mut Vec<[u32; 3]>,
        report: &mut ScanReport,
    ) -> Result<(), ScanError> {
        while self.entries_left > 0 && triangles.len() < BATCH_ITEMS_MAX {
            let index = values.scalar(item)?;
            self.entries_left -= 1;
            // As an unsigned number −1 is the largest.
            let is_unsigned = item == ScalarType::U32;
            if index == -1.0 || is_unsigned && index == f64::from(u32::MAX) {
                self.strip.restart();
            } else {
                let corner = checked_index(values, index, range)?;
                triangles.extend(self.strip.add(corner, report));
            }
        }
        Ok(())
    }
}

fn skip_all(
    values: &mut Values,
    element: &Element,
    properties: std::ops::Range<usize>,
) -> Result<(), ScanError> {
    for property in &element.properties[properties] {
        values.skip(property.of)?;
    }
    Ok(())
}

pub(super) fn skip_element(values: &mut Values, element: &Element) -> Result<(), ScanError> {
    // Records of one size are passed over in one step; so are those of none, of which
    // a header may declare any number.
    if let Some(record_bytes) = element.record_bytes()
        && (!values.is_text() || record_bytes == 0)
    {
        return match values.input.skip(element.count.saturating_mul(record_bytes))? {
            true => Ok(()),
            false => Err(values.truncated()),
        };
    }
    for record in 0..element.count {
        values.begin_record(record);
        skip_all(values, element, 0..element.properties.len())?;
    }
    Ok(())
}

/// Every vertex position of a file, by a pass of its own.
fn read_positions(path: &Path, vertex_count: u32, room: &Room) -> Result<Paged<DVec3>, ScanError> {
    let mut input = Input::open(path)?;
    let header = super::header::read(&mut input)?;
    let mut values = Values::new(input, header.format);
    let at = Spot::new(path, Place::File);
    // The counts of this second pass belong to nobody.
    let mut report = ScanReport::new(path.to_path_buf(), header.format, 0);
    let mut positions = Paged::new(room);
    for element in header.elements {
        values.begin_element(&element.name);
        let plan = super::plan(element, &at, (ColourSource::None, &[]))?;
        let Role::Vertices(columns) = &plan.role else {
            skip_element(&mut values, &plan.element)?;
            continue;
        };
        let mut record = 0;
        while record < plan.element.count {
            let batch =
                read_vertices(&mut values, &plan.element, columns, &mut record, &mut report)?;
            for position in batch.positions {
                positions.push(position).map_err(|error| ScanError::scratch(path, error))?;
            }
        }
        break;
    }
    if positions.len() != vertex_count as usize {
        let what = "the file changed while it was read; wait until it is complete";
        return Err(ScanError::malformed(at, what));
    }
    Ok(positions)
}
