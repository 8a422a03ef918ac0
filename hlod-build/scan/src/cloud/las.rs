//! LAS and LAZ (ASPRS): positions and colours of points.
//!
//! Positions are whole numbers times a scale plus an offset, in f64. Points that are withheld are
//! passed over; everything else is the survey's to decide, noise classes too.

use std::path::Path;

use glam::DVec3;
use las::Reader;

use super::threaded::{Part, Sender, start};
use crate::error::{Place, ScanError, Spot};
use crate::report::ScanReport;
use crate::texture::ColourSource;
use crate::{BATCH_ITEMS_MAX, Opened, VertexBatch};

/// Reads the header and begins with the points.
pub(super) fn open(
    path: &Path,
    file_bytes: u64,
    colour: ColourSource,
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
    // The library's reader stays on the thread where it was opened.
    drop(reader);
    let read = move |sender: &Sender| read(points, has_colours, &at, sender);
    Ok(start(path, file_bytes, has_colours, report, read))
}

fn read(points: u64, has_colours: bool, at: &Spot, sender: &Sender) -> Result<(), ScanError> {
    let malformed = |error: las::Error| {
        ScanError::malformed(at.clone(), format!("its points cannot be read: {error}"))
    };
    let mut reader = Reader::from_path(&at.path).map_err(malformed)?;
    let mut done = 0u64;
    // Colours should fill 16 bits; many writers fill 8. Which it is shows at the begin.
    let mut divisor = None;
    while done < points {
        let wanted = (points - done).min(BATCH_ITEMS_MAX as u64);
        let data = reader.read_points(wanted).map_err(malformed)?;
        if data.is_empty() {
            let what = format!("point {done} of {points}");
            return Err(ScanError::Truncated { at: at.clone(), what });
        }
        let mut part = Part::new(VertexBatch::default(), 0.0);
        let mut colours = Vec::new();
        for point in data.points() {
            let point = point.map_err(malformed)?;
            let position = DVec3::new(point.x, point.y, point.z);
            if !position.is_finite() {
                return Err(ScanError::NotFinite { at: at.clone(), vertex: done });
            }
            done += 1;
            if point.is_withheld {
                part.invalid += 1;
                continue;
            }
            part.batch.positions.push(position);
            if has_colours {
                colours.push(point.color.map_or([0; 3], |c| [c.red, c.green, c.blue]));
            }
        }
        if has_colours && divisor.is_none() {
            let is_8_bit = colours.iter().flatten().all(|value| *value <= 255);
            divisor = Some(if is_8_bit { 1 } else { 257 });
            if is_8_bit {
                let remark = "colours fill 8 of their 16 bits and are taken as 8-bit numbers";
                part.remark = Some(remark.into());
            }
        }
        let divisor = divisor.unwrap_or(257);
        let byte = |value: u16| {
            u8::try_from((u32::from(value) + divisor / 2) / divisor).unwrap_or(u8::MAX)
        };
        let rgba = |[r, g, b]: [u16; 3]| [byte(r), byte(g), byte(b), 255];
        part.batch.colours = colours.into_iter().map(rgba).collect();
        part.share = done as f64 / points as f64;
        if !sender.send(part) {
            return Ok(());
        }
    }
    Ok(())
}
