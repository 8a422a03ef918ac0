//! Points: what is drawn where a scan has no triangles, or where these would be smaller than a pixel.
//!
//! A point stands for a ball: what it was made from lies within. So wherever balls are drawn as
//! large as they are, what they were made from is covered.
//!
//! - [`cloud`]: the nodes of a scan that is a point cloud;
//! - [`spacing`]: how large the balls of a scan's own points have to be;
//! - [`cover`]: points in place of triangles;
//! - [`cluster`]: many points become few;
//! - [`progressive`]: an order of which beginnings cover as well.

pub(crate) mod cloud;
mod cluster;
pub(crate) mod cover;
mod progressive;
mod spacing;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use hlod_compress::{OctNormal, PointRadius, Points, Scalars};

/// The pixels for which a node's points are made are so many times as large as its selecting error:
/// it is drawn while that covers half a pixel (τ_build).
pub(crate) const PIXEL_A_ERROR: f64 = 2.0;

/// Points are at most so many pixels apart: neighbouring balls meet at little more than the pixel's
/// own size.
pub(crate) const SPACING_PX: f64 = 0.7;

/// One point and what it stands for.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Point {
    /// Lattice steps.
    pub(crate) position: [i32; 3],
    pub(crate) normal: OctNormal,
    /// White where the model has no colours.
    pub(crate) colour: [u8; 4],
    /// How many points of the scan, or triangles' pieces.
    pub(crate) weight: u32,
    /// Kept numbers as codes.
    pub(crate) scalars: Scalars,
    /// Radius of the ball, lattice steps.
    pub(crate) reach: f64,
    /// How far it is from the nearest point of the scan, at most.
    pub(crate) moved: f64,
    /// How much normals of what it stands for differ from its own, at most; radians.
    pub(crate) turned: f64,
}

impl Point {
    pub(crate) fn at(&self) -> DVec3 {
        DVec3::from_array(self.position.map(f64::from))
    }

    pub(crate) fn direction(&self) -> DVec3 {
        DVec3::from_array(self.normal.decode().map(f64::from))
    }
}

/// Angle between two directions, radians.
pub(crate) fn angle_between(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// Moves points to the nearest multiples of 2^`shift`.
pub(crate) fn round(points: &mut [Point], shift: u8) {
    let half = if shift > 0 { 1i32 << (shift - 1) } else { 0 };
    for point in points {
        let before = point.at();
        point.position = point.position.map(|c| (c + half) >> shift << shift);
        let by = point.at().distance(before);
        point.moved += by;
        point.reach += by;
    }
}

/// Points as pages hold them, in progressive order.
pub(crate) fn to_page(points: &[Point], spacing: f64, has_colours: bool) -> Points {
    let (order, prefixes) = progressive::progressive(points, spacing);
    let ordered = || order.iter().map(|&p| &points[p as usize]);
    let mut scalars: Vec<Scalars> = ordered().map(|p| p.scalars).collect();
    if scalars.iter().all(Scalars::is_unknown) {
        scalars.clear();
    }
    Points {
        scalars,
        positions: ordered().map(|p| p.position).collect(),
        normals: ordered().map(|p| p.normal).collect(),
        colours: ordered().map(|p| p.colour).filter(|_| has_colours).collect(),
        radii: ordered().map(|p| PointRadius::at_least(p.reach)).collect(),
        prefixes,
    }
}
