//! LAS and LAZ (ASPRS): positions and colours of points, and what else is measured of them.
//!
//! Positions are whole numbers times a scale plus an offset, in f64. Points that are withheld are
//! passed over; everything else is the survey's to decide, noise classes too.

use std::path::Path;

use glam::DVec3;
use las::{Point, PointData, Reader};

use super::threaded::{Part, Sender, report_left_out, start};
use crate::error::{Place, ScanError, Spot};
use crate::report::ScanReport;
use crate::texture::ColourSource;
use crate::{BATCH_ITEMS_MAX, Opened, VertexBatch};

/// A number of each point that can be kept.
type Number = fn(&Point) -> f64;

/// By the names that LAS files' readers use.
const NUMBERS: [(&str, Number); 8] = [
    ("intensity", |p| p.intensity.into()),
    ("classification", |p| u8::from(p.classification).into()),
    ("return_number", |p| p.return_number.into()),
    ("number_of_returns", |p| p.number_of_returns.into()),
    ("scan_angle", |p| p.scan_angle.into()),
    ("user_data", |p| p.user_data.into()),
    ("point_source_id", |p| p.point_source_id.into()),
    ("gps_time", |p| p.gps_time.unwrap_or(f64::NAN)),
];

/// Reads the header and begins with the points.
pub(super) fn open(
    path: &Path,
    file_bytes: u64,
    (colour, keep): (ColourSource, &[String]),
    report: &mut ScanReport,
) -> Result<Opened, ScanError> {
    let at = Spot::new(path, Place::File);
    let malformed = |error: las::Error| {
        ScanError::malformed(at.clone(), format!("is no LAS file that can be read: {error}"))
    };
    // A header may be damaged so that its reader gives up.
    let opened = std::panic::catch_unwind(|| Reader::from_path(path)).map_err(|_| {
        ScanError::malformed(at.clone(), "is no LAS file that can be read: its header is damaged")
    })?;
    let reader = opened.map_err(malformed)?;
    let header = reader.header();
    let points = header.number_of_points();
    let record_bytes = u64::from(header.point_format().len());
    let possible = file_bytes / record_bytes.max(1);
    if !header.point_format().is_compressed && points > possible {
        return Err(ScanError::CountTooLarge {
            at,
            what: "points".into(),
            declared: points,
            possible,
        });
    }
    let in_file = header.point_format().has_color;
    if in_file && !colour.takes_vertex_colours() {
        report.colours.left_out.push("colours of points".to_owned());
    }
    let has_colours = in_file && colour.takes_vertex_colours();
    let names: Vec<String> = NUMBERS.iter().map(|(name, _)| (*name).to_owned()).collect();
    report_left_out(&names, keep, report);
    let keep = keep
        .iter()
        .map(|name| NUMBERS.iter().find(|(known, _)| known == name).map(|(_, number)| *number))
        .collect();
    // The library's reader stays on the thread where it was opened.
    drop(reader);
    let wanted = Wanted { points, has_colours, keep };
    let read = move |sender: &Sender| read(&wanted, &at, sender);
    Ok(start(path, file_bytes, (has_colours, names), report, read))
}

/// What is read of each point.
struct Wanted {
    points: u64,
    has_colours: bool,
    /// Numbers to be kept; of those that LAS has not, none.
    keep: Vec<Option<Number>>,
}

/// Points a batch at a time.
struct Batches<'a> {
    reader: Reader,
    at: &'a Spot,
    points: u64,
    done: u64,
}

impl Batches<'_> {
    fn open(at: &Spot, points: u64) -> Result<Batches<'_>, ScanError> {
        let reader = Reader::from_path(&at.path).map_err(|error| unreadable(at, &error))?;
        Ok(Batches { reader, at, points, done: 0 })
    }

    fn next(&mut self) -> Result<Option<PointData>, ScanError> {
        let count = (self.points - self.done).min(BATCH_ITEMS_MAX as u64);
        if count == 0 {
            return Ok(None);
        }
        let read = self.reader.read_points(count);
        let data = read.map_err(|error| unreadable(self.at, &error))?;
        if data.is_empty() {
            let what = format!("point {} of {}", self.done, self.points);
            return Err(ScanError::Truncated { at: self.at.clone(), what });
        }
        self.done += data.len() as u64;
        Ok(Some(data))
    }
}

fn unreadable(at: &Spot, error: &las::Error) -> ScanError {
    ScanError::malformed(at.clone(), format!("its points cannot be read: {error}"))
}

/// Colours should fill 16 bits; many writers fill 8. The first one above 255 tells, so that
/// only files of 8 bits are read to their end for this.
fn colours_fill_8_bits(points: u64, at: &Spot) -> Result<bool, ScanError> {
    let mut batches = Batches::open(at, points)?;
    while let Some(data) = batches.next()? {
        for point in data.points() {
            let colour = point.map_err(|error| unreadable(at, &error))?.color;
            if colour.is_some_and(|c| [c.red, c.green, c.blue].iter().any(|value| *value > 255)) {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

fn read(wanted: &Wanted, at: &Spot, sender: &Sender) -> Result<(), ScanError> {
    let Wanted { points, has_colours, ref keep } = *wanted;
    let is_8_bit = has_colours && colours_fill_8_bits(points, at)?;
    let divisor = if is_8_bit { 1 } else { 257 };
    let byte =
        |value: u16| u8::try_from((u32::from(value) + divisor / 2) / divisor).unwrap_or(u8::MAX);
    let mut remark = is_8_bit
        .then(|| "colours fill 8 of their 16 bits and are taken as 8-bit numbers".to_owned());
    let mut batches = Batches::open(at, points)?;
    while let Some(data) = batches.next()? {
        let first = batches.done - data.len() as u64;
        let mut part = Part::new(VertexBatch::default(), batches.done as f64 / points as f64);
        part.remark = remark.take();
        part.batch.scalars = vec![Vec::with_capacity(data.len()); keep.len()];
        for (vertex, point) in (first..).zip(data.points()) {
            let point = point.map_err(|error| unreadable(at, &error))?;
            let position = DVec3::new(point.x, point.y, point.z);
            if !position.is_finite() {
                return Err(ScanError::NotFinite { at: at.clone(), vertex });
            }
            if point.is_withheld {
                part.invalid += 1;
                continue;
            }
            part.batch.positions.push(position);
            if has_colours {
                let colour = point.color.map_or([0; 3], |c| [c.red, c.green, c.blue]);
                let [r, g, b] = colour.map(byte);
                part.batch.colours.push([r, g, b, 255]);
            }
            for (column, number) in part.batch.scalars.iter_mut().zip(keep) {
                column.push(number.map_or(f64::NAN, |number| number(&point)));
            }
        }
        if !sender.send(part) {
            return Ok(());
        }
    }
    Ok(())
}
