//! Plane sections of a scan, at full resolution whatever is shown.
//!
//! ```text
//! plane     the plane, and how drawings lie in it
//!   │ crossing  single triangles of the leaves that it meets
//!   │ chain     from edge to edge, by exact positions
//!   │ join      where leaves of different depth meet
//!   ▼ cut       lines, longest first
//! trust     how far a line can be from the scan's own section
//! measure   lengths, areas, circles of best fit
//! sheet     several sections with what must be said about them
//!   ▼ svg, dxf, csv, report
//! ```

mod chain;
mod circle;
mod crossing;
mod csv;
mod dxf;
mod join;
mod measure;
mod plane;
mod report;
mod sheet;
mod svg;
mod trust;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::RenderError;
use crate::leaves::{LeafRef, Leaves};

use chain::{Chains, chain};
pub use circle::{Circle, NoCircle};
use crossing::{Crossing, Cutter};
pub use join::JOIN_STEPS;
pub use measure::Measures;
pub use plane::{Frame, Plane};
pub use report::{CircleReport, LineReport, ScanReport, SectionReport, SheetReport};
pub use sheet::{Layer, Provenance, Sheet};
pub use trust::{GRAZING_DEG, Trust};

/// Where a plane meets a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    /// The plane.
    pub plane: Plane,
    /// Axes of a drawing of it.
    pub frame: Frame,
    /// The lines, the longest first; the same ones in the same order however leaves are read.
    pub lines: Vec<Line>,
    /// How far they can be from the scan's own section.
    pub trust: Trust,
    /// How many ends were joined where leaves of different depth meet.
    pub joins: usize,
    /// The widest gap that was closed so, in the source's unit.
    pub widest_gap: f64,
    /// How many edges of more than two triangles the plane crosses. Lines meet there.
    pub crowded_edges: usize,
    /// Length of the lines, in the source's unit, whose triangles face the other way than those of
    /// most of their line. Where there is any, areas say little.
    pub contrary: f64,
    /// Leaves that were read.
    pub leaves: usize,
    /// Triangles that the plane crosses.
    pub triangles: usize,
}

/// One line of a section. Seen against the plane's normal what is solid is on its left, so
/// that outer outlines run counter-clockwise and hollows clockwise.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// At least two, no two that follow one another are the same. Of a closed line the last is joined
    /// to the first, which is not repeated, and is the smallest by x, y and z.
    pub points: Vec<DVec3>,
    /// Whether it returns to its start. Lines that do not end where the scan has a hole or an end.
    pub closed: bool,
}

/// Cuts the scan's own geometry. A vertex on the plane counts as above it: where a face lies in the
/// plane, the section is that just below the plane.
///
/// `within` restricts it to triangles whose bounds meet a box in source coordinates; they are cut
/// as a whole, so that lines go on to the end of the last triangle.
///
/// # Errors
/// When the file cannot be read or is damaged, is a point cloud, or the plane is none.
pub fn cut(
    leaves: &Leaves,
    plane: &Plane,
    within: Option<(DVec3, DVec3)>,
) -> Result<Section, RenderError> {
    let plane = plane.checked()?;
    let header = leaves.header();
    if header.points_input > 0 {
        let path = leaves.path().to_owned();
        return Err(RenderError::NoSurface { path });
    }
    let step = header.lattice.step;
    let wanted = leaves.within(|min, max| {
        // The bounds are those of what was rounded; a step more costs nothing.
        plane.meets(min, max, step)
            && within.is_none_or(|(low, high)| min.cmple(high).all() && max.cmpge(low).all())
    })?;
    let cutter = Cutter::new(leaves, &plane, within);
    let cut = |leaf: &LeafRef| Ok(cutter.cut(&*leaves.load(leaf)?));
    let parts: Vec<Vec<Crossing>> =
        wanted.par_iter().map(cut).collect::<Result<_, RenderError>>()?;
    let mut crossings: Vec<Crossing> = parts.into_iter().flatten().collect();

    let frame = plane.frame(header);
    let Chains { lines, joins, widest_gap, crowded_edges, contrary } =
        chain(&cutter, &frame, step, &mut crossings);
    Ok(Section {
        plane,
        frame,
        lines: in_order(lines),
        trust: Trust::of(&cutter, &crossings),
        joins,
        widest_gap,
        crowded_edges,
        contrary,
        leaves: wanted.len(),
        triangles: crossings.len(),
    })
}

/// Lines with their canonical starts, the longest first.
fn in_order(lines: Vec<(Vec<DVec3>, bool)>) -> Vec<Line> {
    let line = |(mut points, closed): (Vec<DVec3>, bool)| {
        if closed {
            let order = |i: &usize, j: &usize| {
                // A line may pass its smallest point twice.
                let from = |&i: &usize| points[i..].iter().chain(&points[..i]);
                from(i)
                    .zip(from(j))
                    .map(|(a, b)| by_coordinates(a, b))
                    .find(|o| o.is_ne())
                    .unwrap_or(std::cmp::Ordering::Equal)
            };
            let start = (0..points.len()).min_by(order).unwrap_or(0);
            points.rotate_left(start);
        }
        Line { points, closed }
    };
    let mut lines: Vec<(f64, Line)> =
        lines.into_iter().map(line).map(|line| (line.length(), line)).collect();
    lines.sort_by(|(a, x), (b, y)| {
        let points = || {
            let pairs = x.points.iter().zip(&y.points);
            pairs.map(|(p, q)| by_coordinates(p, q)).find(|o| o.is_ne())
        };
        b.total_cmp(a).then_with(|| points().unwrap_or(std::cmp::Ordering::Equal))
    });
    lines.into_iter().map(|(_, line)| line).collect()
}

fn by_coordinates(a: &DVec3, b: &DVec3) -> std::cmp::Ordering {
    (0..3).map(|i| a[i].total_cmp(&b[i])).find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
}
