//! E57 (ASTM E2807): the points of all its scans, each moved by its pose.
//!
//! Points that are marked as invalid, or of which only the direction is known, are passed over. Where a
//! scan has a pose, that is where the scanner stood: normals can then be turned towards it.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use e57::{CartesianCoordinate, E57Reader, PointCloud};
use glam::DVec3;

use super::threaded::{Part, Sender, report_left_out, start};
use crate::error::{Place, ScanError, Spot};
use crate::report::ScanReport;
use crate::texture::ColourSource;
use crate::{BATCH_ITEMS_MAX, Opened, VertexBatch, unit_to_byte};

type Reader = E57Reader<BufReader<File>>;

/// Reads the table of contents and begins with the points.
pub(super) fn open(
    path: &Path,
    file_bytes: u64,
    (colour, keep): (ColourSource, &[String]),
    report: &mut ScanReport,
) -> Result<Opened, ScanError> {
    let at = Spot::new(path, Place::File);
    let opened = std::panic::catch_unwind(|| E57Reader::from_file(path)).map_err(|_| {
        ScanError::malformed(at.clone(), "is no E57 file that can be read: it is damaged")
    })?;
    let reader = opened.map_err(|error| malformed(&at, &error))?;
    let clouds = reader.pointclouds();
    let points = clouds.iter().fold(0u64, |sum, cloud| sum.saturating_add(cloud.records));
    if points > u64::from(u32::MAX) {
        return Err(ScanError::TooManyVertices { at, vertices: points });
    }
    let in_file = clouds.iter().any(PointCloud::has_color);
    if in_file && !colour.takes_vertex_colours() {
        report.colours.left_out.push("colours of points".to_owned());
    }
    let has_colours = in_file && colour.takes_vertex_colours();
    let images = reader.images().len();
    if images > 0 {
        report.skipped.push(format!("{images} pictures"));
    }
    let has_intensity = clouds.iter().any(PointCloud::has_intensity);
    let names: Vec<String> = has_intensity.then(|| INTENSITY.to_owned()).into_iter().collect();
    report_left_out(&names, keep, report);
    let wanted = Wanted { has_colours, keep: keep.iter().map(|name| name == INTENSITY).collect() };
    let read = move |sender: &Sender| {
        let mut progress = (0, points.max(1));
        let mut reader = reader;
        for cloud in &clouds {
            if !read_scan(&mut reader, cloud, &wanted, &mut progress, &at, sender)? {
                break;
            }
        }
        Ok(())
    };
    Ok(start(path, file_bytes, (has_colours, names), report, read))
}

/// The one number of points that can be kept.
const INTENSITY: &str = "intensity";

/// What is read of each point.
struct Wanted {
    has_colours: bool,
    /// Whether each number to be kept is the intensity; others this format has not.
    keep: Vec<bool>,
}

impl Wanted {
    fn part(&self, share: f64) -> Part {
        let scalars = vec![Vec::new(); self.keep.len()];
        Part::new(VertexBatch { scalars, ..VertexBatch::default() }, share)
    }
}

fn malformed(at: &Spot, error: &e57::Error) -> ScanError {
    ScanError::malformed(at.clone(), format!("is no E57 file that can be read: {error}"))
}

/// Sends the points of one scan; `false` if nobody wants more.
fn read_scan(
    reader: &mut Reader,
    cloud: &PointCloud,
    wanted: &Wanted,
    (done, points): &mut (u64, u64),
    at: &Spot,
    sender: &Sender,
) -> Result<bool, ScanError> {
    let stood = cloud.transform.as_ref().map(|pose| {
        let at = &pose.translation;
        [at.x, at.y, at.z]
    });
    let share = |done: u64| done as f64 / *points as f64;
    let mut part = wanted.part(share(*done));
    part.station = Some(stood);
    let mut found = reader.pointcloud_simple(cloud).map_err(|error| malformed(at, &error))?;
    // Each scan's own limits would make the same surface differ between scans.
    found.normalize_intensity(false);
    for point in found {
        let point = point.map_err(|error| malformed(at, &error))?;
        *done += 1;
        let CartesianCoordinate::Valid { x, y, z } = point.cartesian else {
            part.invalid += 1;
            continue;
        };
        let position = DVec3::new(x, y, z);
        if !position.is_finite() {
            return Err(ScanError::NotFinite { at: at.clone(), vertex: *done - 1 });
        }
        part.batch.positions.push(position);
        if wanted.has_colours {
            part.batch.colours.push(point.color.map_or([255; 4], |c| {
                let [r, g, b] = [c.red, c.green, c.blue].map(|x| unit_to_byte(x.into()));
                [r, g, b, 255]
            }));
        }
        for (column, is_intensity) in part.batch.scalars.iter_mut().zip(&wanted.keep) {
            let number = point.intensity.filter(|_| *is_intensity);
            column.push(number.map_or(f64::NAN, f64::from));
        }
        if part.batch.positions.len() == BATCH_ITEMS_MAX {
            part.share = share(*done);
            let full = std::mem::replace(&mut part, wanted.part(0.0));
            if !sender.send(full) {
                return Ok(false);
            }
        }
    }
    part.share = share(*done);
    Ok(sender.send(part))
}
