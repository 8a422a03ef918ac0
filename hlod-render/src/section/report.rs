//! Everything about a sheet of sections, for programs.

use glam::{DVec2, DVec3};
use serde::Serialize;

use super::circle::{Circle, NoCircle};
use super::sheet::{Layer, Sheet};
use super::{Line, Section};

/// A sheet as it is written to JSON. Lengths are in `unit`, areas in its square.
#[derive(Debug, Serialize)]
pub struct SheetReport {
    /// Name of the file, or its address.
    pub file: String,
    /// The scans that it was built from.
    pub scans: Vec<ScanReport>,
    /// Program and version.
    pub program: String,
    /// Unit of all lengths.
    pub unit: &'static str,
    /// Unit that the file declares.
    pub unit_of_file: &'static str,
    /// The sections.
    pub sections: Vec<SectionReport>,
}

/// A scan that the file was built from.
#[derive(Debug, Serialize)]
pub struct ScanReport {
    /// Its name without folders.
    pub name: String,
    /// Its checksum, hexadecimal.
    pub sha256: String,
}

/// One section. Two coordinates are those of its plane: `frame_u` times the first and `frame_v` times
/// the second from `frame_origin` on.
#[derive(Debug, Serialize)]
pub struct SectionReport {
    /// Name of the layer in drawings and tables.
    pub layer: String,
    /// Unit normal of the plane.
    pub normal: [f64; 3],
    /// Distance of the plane from the origin along the normal.
    pub offset: f64,
    /// Where coordinates in the plane count from.
    pub frame_origin: [f64; 3],
    /// Unit vector to the right.
    pub frame_u: [f64; 3],
    /// Unit vector up.
    pub frame_v: [f64; 3],
    /// Added to coordinates of the plane in drawings.
    pub drawn_at: [f64; 2],
    /// Closed lines.
    pub closed: usize,
    /// Lines that end.
    pub open: usize,
    /// Length of all lines.
    pub length: f64,
    /// What closed lines enclose, less hollows.
    pub area: f64,
    /// False where lines are open or run against their triangles: then `area` is not all.
    pub area_is_whole: bool,
    /// Smallest and largest coordinates in the plane.
    pub bounds: Option<[[f64; 2]; 2]>,
    /// The circle that all lines fit best.
    #[serde(flatten)]
    pub circle: CircleReport,
    /// No point of the file's surface here is farther from the scan: ε.
    pub file_bound: f64,
    /// Half of the length is displaced by no more; null where nothing is known.
    pub outline_bound_50: Option<f64>,
    /// The same of 95 % of the length.
    pub outline_bound_95: Option<f64>,
    /// Part of the length along which the surface is within 5° of the plane.
    pub grazing_share: f64,
    /// Ends that were joined where leaves of different depth meet.
    pub joins: usize,
    /// The widest gap that was closed so.
    pub widest_gap: f64,
    /// Where lines meet.
    pub edges_of_more_than_two_triangles: usize,
    /// Length along which lines run against their triangles.
    pub contrary: f64,
    /// Leaves that were read.
    pub leaves_read: usize,
    /// Triangles that the plane crosses.
    pub triangles_cut: usize,
    /// The lines, the longest first.
    pub lines: Vec<LineReport>,
}

/// One line.
#[derive(Debug, Serialize)]
pub struct LineReport {
    /// Whether the last point is joined to the first.
    pub closed: bool,
    /// Its length.
    pub length: f64,
    /// What it encloses, negative for a hollow; 0 where it is open.
    pub area: f64,
    /// The circle that it fits best.
    #[serde(flatten)]
    pub circle: CircleReport,
    /// Source coordinates.
    pub points: Vec<[f64; 3]>,
}

/// A circle or why there is none.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CircleReport {
    /// See [`Circle`].
    Circle {
        /// In the plane.
        centre: [f64; 2],
        /// Its radius.
        radius: f64,
        /// Root of the mean square of distances from it.
        rms: f64,
        /// The largest distance.
        largest: f64,
    },
    /// Why there is none.
    NoCircle(String),
}

impl Sheet {
    /// Everything there is to say.
    pub fn report(&self) -> SheetReport {
        let p = &self.provenance;
        let scan = |(name, sha256): &(String, String)| {
            let (name, sha256) = (name.clone(), sha256.clone());
            ScanReport { name, sha256 }
        };
        SheetReport {
            file: p.file.clone(),
            scans: p.scans.iter().map(scan).collect(),
            program: p.program.clone(),
            unit: self.unit.name(),
            unit_of_file: p.unit_of_file.name(),
            sections: self.layers.iter().map(section).collect(),
        }
    }
}

fn section(layer: &Layer) -> SectionReport {
    let Section { plane, frame, lines, trust, .. } = &layer.section;
    let measures = layer.section.measures();
    let bound = |value: f64| value.is_finite().then_some(value);
    SectionReport {
        layer: layer.name.clone(),
        normal: plane.normal.to_array(),
        offset: plane.offset,
        frame_origin: frame.origin.to_array(),
        frame_u: frame.u.to_array(),
        frame_v: frame.v.to_array(),
        drawn_at: layer.at.to_array(),
        closed: measures.closed,
        open: measures.open,
        length: measures.length,
        area: measures.area,
        area_is_whole: measures.area_is_whole,
        bounds: measures.bounds.map(|b| b.map(|q: DVec2| q.to_array())),
        circle: CircleReport::of(measures.circle),
        file_bound: trust.file_bound,
        outline_bound_50: bound(trust.outline_bound_50),
        outline_bound_95: bound(trust.outline_bound_95),
        grazing_share: trust.grazing,
        joins: layer.section.joins,
        widest_gap: layer.section.widest_gap,
        edges_of_more_than_two_triangles: layer.section.crowded_edges,
        contrary: layer.section.contrary,
        leaves_read: layer.section.leaves,
        triangles_cut: layer.section.triangles,
        lines: lines.iter().map(|l| line(l, &layer.section)).collect(),
    }
}

fn line(line: &Line, section: &Section) -> LineReport {
    LineReport {
        closed: line.closed,
        length: line.length(),
        area: line.area(&section.frame),
        circle: CircleReport::of(line.circle(&section.frame)),
        points: line.points.iter().map(DVec3::to_array).collect(),
    }
}

impl CircleReport {
    fn of(circle: Result<Circle, NoCircle>) -> CircleReport {
        match circle {
            Ok(Circle { centre, radius, rms, largest }) => {
                CircleReport::Circle { centre: centre.to_array(), radius, rms, largest }
            }
            Err(why) => CircleReport::NoCircle(why.to_string()),
        }
    }
}
