//! Measuring on the scan's own surface.
//!
//! Beside each result stand two numbers that are never added up: `file_bound`, how far the result
//! can be from the one that the scan file itself would give — proven, because no vertex of a leaf
//! is farther from the scan's surface than the file's rounding — and the scanner's uncertainty as
//! someone declared it ([`crate::session::ScannerUncertainty`]), which says how far the scan file
//! may be from the statue.
//!
//! A point that was picked is a place on the file's surface, and within its `file_bound` ε there
//! is one of the scan's. A distance between two such points then differs by no more than
//! ε₁ + ε₂ (triangle inequality), a polyline by the sum over its legs, and the direction from one to
//! the other by no more than asin((ε₁ + ε₂) ÷ distance), which bounds angles. Lengths and areas *along*
//! the surface have no such bound: a surface within ε can be arbitrarily much larger. They are
//! labelled so.

mod area;
mod nearest;
mod path;
#[cfg(test)]
mod tests;

use glam::DVec3;
use serde::{Deserialize, Serialize};

pub use area::{Enclosed, enclosed_area};
pub use nearest::nearest_point;
pub use path::surface_path;

use crate::error::RenderError;
use crate::leaves::Leaves;
use crate::pick::Hit;

/// A place on the scan's surface, in source coordinates and the source's unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfacePoint {
    /// Where it is.
    pub position: [f64; 3],
    /// Which way the surface faces there; of length 1.
    pub normal: [f64; 3],
    /// How far the scan's surface may be from it.
    pub file_bound: f64,
    /// What a pixel stood for when it was clicked; of points that were typed, none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel_length: Option<f64>,
}

/// Something that was measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measurement {
    /// Its name.
    pub name: String,
    /// What was measured.
    pub kind: MeasurementKind,
    /// Between which points.
    pub points: Vec<SurfacePoint>,
    /// What came of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub result: Option<Measured>,
}

/// What can be measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeasurementKind {
    /// Where a point is.
    Point,
    /// The straight line between two points.
    Distance,
    /// Straight lines from point to point.
    Polyline,
    /// At the second of three points.
    Angle,
    /// Along the surface from point to point.
    SurfaceLength,
    /// Of the surface inside a closed line.
    SurfaceArea,
}

/// A result.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// In the source's unit, its square, or degrees.
    pub value: f64,
    /// How far that may be from what the scan file itself gives; of lengths and areas along the surface
    /// nothing is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file_bound: Option<f64>,
    /// From the first point to the last along the axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delta: Option<[f64; 3]>,
}

impl MeasurementKind {
    /// All of them.
    pub const ALL: [MeasurementKind; 6] = [
        MeasurementKind::Point,
        MeasurementKind::Distance,
        MeasurementKind::Polyline,
        MeasurementKind::Angle,
        MeasurementKind::SurfaceLength,
        MeasurementKind::SurfaceArea,
    ];

    /// Its name on command lines and in files.
    pub fn name(self) -> &'static str {
        match self {
            MeasurementKind::Point => "point",
            MeasurementKind::Distance => "distance",
            MeasurementKind::Polyline => "polyline",
            MeasurementKind::Angle => "angle",
            MeasurementKind::SurfaceLength => "surface-length",
            MeasurementKind::SurfaceArea => "surface-area",
        }
    }

    /// The fewest and the most points that it is measured between.
    pub fn points(self) -> (usize, usize) {
        match self {
            MeasurementKind::Point => (1, 1),
            MeasurementKind::Distance => (2, 2),
            MeasurementKind::Angle => (3, 3),
            MeasurementKind::Polyline | MeasurementKind::SurfaceLength => (2, usize::MAX),
            MeasurementKind::SurfaceArea => (3, usize::MAX),
        }
    }

    /// What its value is in, where lengths are in `unit`.
    pub fn unit(self, unit: &str) -> String {
        match self {
            MeasurementKind::Angle => "°".to_owned(),
            MeasurementKind::SurfaceArea => format!("{unit}²"),
            _ => unit.to_owned(),
        }
    }
}

impl SurfacePoint {
    /// What a ray met, where a pixel stands for so much.
    pub fn of_hit(hit: &Hit, pixel_length: Option<f64>) -> SurfacePoint {
        SurfacePoint {
            position: hit.position.to_array(),
            normal: hit.normal.to_array(),
            file_bound: hit.error,
            pixel_length,
        }
    }

    /// Its position.
    pub fn place(&self) -> DVec3 {
        DVec3::from_array(self.position)
    }

    /// Says what is wrong with a point that was read, if anything is.
    ///
    /// # Errors
    /// A sentence.
    pub fn validate(&self) -> Result<(), String> {
        let numbers = self.position.iter().chain(&self.normal);
        if !numbers.chain([&self.file_bound]).all(|v| v.is_finite() && v.abs() < 1e12) {
            return Err("a coordinate is not a number or too large".into());
        }
        if self.file_bound < 0.0 || self.pixel_length.is_some_and(|v| !(v > 0.0 && v < 1e12)) {
            return Err("`file_bound` and `pixel_length` must be positive".into());
        }
        Ok(())
    }
}

impl Measurement {
    /// Says what is wrong with a measurement that was read, if anything is.
    ///
    /// # Errors
    /// A sentence.
    pub fn validate(&self) -> Result<(), String> {
        crate::session::text(&self.name)?;
        let (least, most) = self.kind.points();
        let count = self.points.len();
        if !(least..=most.min(crate::session::COUNT_MAX)).contains(&count) {
            return Err(format!("{}: not between {count} points", self.kind.name()));
        }
        let result = self.result.map(|r| [Some(r.value), r.file_bound]);
        if result.is_some_and(|r| r.iter().flatten().any(|v| !v.is_finite())) {
            return Err("`result` is not a number".into());
        }
        self.points.iter().try_for_each(SurfacePoint::validate)
    }
}

/// Measures what lies between points that were picked. Lengths and areas along the surface read the
/// leaves that they need, and wait for them.
///
/// # Errors
/// When there are too few points, the file cannot be read, points are not on one surface, or a line that
/// is to enclose an area crosses itself.
pub fn measure(
    leaves: &Leaves,
    kind: MeasurementKind,
    points: &[SurfacePoint],
) -> Result<Measured, RenderError> {
    let (least, most) = kind.points();
    if !(least..=most).contains(&points.len()) {
        let why = format!("{}: not between {} points", kind.name(), points.len());
        return Err(RenderError::Usage(why));
    }
    let (first, last) = (points[0], points[points.len() - 1]);
    let delta = Some((last.place() - first.place()).to_array());
    Ok(match kind {
        MeasurementKind::Point => {
            Measured { value: 0.0, file_bound: Some(first.file_bound), delta: None }
        }
        MeasurementKind::Distance | MeasurementKind::Polyline => {
            let (value, bound) = polyline(points);
            Measured { value, file_bound: Some(bound), delta }
        }
        MeasurementKind::Angle => angle(points[0], points[1], points[2])?,
        MeasurementKind::SurfaceLength => {
            let mut value = 0.0;
            for leg in points.windows(2) {
                let line = surface_path(leaves, &leg[0], &leg[1])?;
                value += line.windows(2).map(|p| p[0].distance(p[1])).sum::<f64>();
            }
            Measured { value, file_bound: None, delta }
        }
        MeasurementKind::SurfaceArea => {
            let value = enclosed_area(leaves, points)?.area;
            Measured { value, file_bound: None, delta: None }
        }
    })
}

/// Length of straight lines from point to point, and how far it may be wrong.
fn polyline(points: &[SurfacePoint]) -> (f64, f64) {
    let legs = points.windows(2);
    legs.fold((0.0, 0.0), |(length, bound), leg| {
        let more = leg[0].place().distance(leg[1].place());
        (length + more, bound + leg[0].file_bound + leg[1].file_bound)
    })
}

/// The angle at `vertex`, in degrees.
fn angle(a: SurfacePoint, vertex: SurfacePoint, b: SurfacePoint) -> Result<Measured, RenderError> {
    let arms = [a, b].map(|end| (end.place() - vertex.place(), end.file_bound + vertex.file_bound));
    if arms.iter().any(|(arm, _)| arm.length() == 0.0) {
        return Err(RenderError::Usage("angle: two of its points are the same".into()));
    }
    let turned: f64 = arms.iter().map(|(arm, e)| (e / arm.length()).min(1.0).asin()).sum();
    // Where a point may be anywhere round the vertex, so may be the direction to it.
    let lost = arms.iter().any(|(arm, e)| *e >= arm.length());
    let bound = if lost { 180.0 } else { turned.to_degrees().min(180.0) };
    let [u, v] = arms.map(|(arm, _)| arm.normalize());
    // Kahan's formula: as exact for small angles as for right ones.
    let value = 2.0 * (u - v).length().atan2((u + v).length());
    Ok(Measured { value: value.to_degrees(), file_bound: Some(bound), delta: None })
}
