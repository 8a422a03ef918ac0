//! What is known about the statue beforehand: the truth for tests that measure.

use super::StatueOptions;
use super::body::{PLINTH, PLINTH_ROUND};
use super::estimate::nominal_step;
use super::inscription::{self, ANGLE, ANGLE_DEGREES, ANGLE_DIRECTION, GROOVE, Letter};
use super::polygonise::NOISE_MAX_SIGMAS;
use super::relief::Panel;
use serde::Serialize;

/// The statue's measures. Lengths in mm, model coordinates: y up, the front towards +z, the
/// origin below the middle of the plinth's underside.
#[derive(Clone, Debug, Serialize)]
pub struct StatueDescription {
    /// `mm`.
    pub unit: &'static str,
    /// `+y`.
    pub up: &'static str,
    /// `+z`.
    pub front: &'static str,
    /// Seed.
    pub seed: u64,
    /// Triangles asked for.
    pub triangles: u64,
    /// Width, height, depth, to a few mm.
    pub size_mm: [f64; 3],
    /// The plinth.
    pub plinth: PlinthDescription,
    /// The dressed panel on the plinth's front: no marks but the cuts listed here.
    pub panel: PanelDescription,
    /// The straight groove.
    pub groove: GrooveDescription,
    /// Two straight cuts that meet.
    pub angle: AngleDescription,
    /// The inscription, in reading order.
    pub letters: Vec<Letter>,
    /// The scanner's noise, along the surface's normal, on every vertex.
    pub noise: NoiseDescription,
}

/// The plinth: a box. Its faces carry chisel marks that only cut in, except the panel.
#[derive(Clone, Debug, Serialize)]
pub struct PlinthDescription {
    /// Corner of smallest coordinates.
    pub low_mm: [f64; 3],
    /// Corner of largest coordinates.
    pub high_mm: [f64; 3],
    /// Radius of the edges.
    pub edge_radius_mm: f64,
}

/// The panel: a rectangle of the plane z = `z_mm`.
#[derive(Clone, Debug, Serialize)]
pub struct PanelDescription {
    /// The plane.
    pub z_mm: f64,
    /// Left, bottom.
    pub low_mm: [f64; 2],
    /// Right, top.
    pub high_mm: [f64; 2],
}

/// A straight V-groove with conical ends.
#[derive(Clone, Debug, Serialize)]
pub struct GrooveDescription {
    /// Ends of the bottom line, in the panel's plane.
    pub ends_mm: [[f64; 3]; 2],
    /// Length of the bottom line.
    pub length_mm: f64,
    /// Depth of the bottom below the plane.
    pub depth_mm: f64,
    /// Width at the plane.
    pub width_mm: f64,
    /// The section, as (across, height) from rim over bottom to rim.
    pub profile_mm: [[f64; 2]; 3],
}

/// Two V-cuts with a common end.
#[derive(Clone, Debug, Serialize)]
pub struct AngleDescription {
    /// Where they meet, in the panel's plane.
    pub vertex_mm: [f64; 3],
    /// Unit directions of both.
    pub directions: [[f64; 3]; 2],
    /// Length of both.
    pub length_mm: f64,
    /// The angle between them.
    pub degrees: f64,
    /// Depth of the cuts.
    pub depth_mm: f64,
    /// Width of the cuts at the plane.
    pub width_mm: f64,
}

/// Scanner noise.
#[derive(Clone, Debug, Serialize)]
pub struct NoiseDescription {
    /// Standard deviation.
    pub sigma_mm: f64,
    /// No vertex is moved farther.
    pub max_mm: f64,
}

/// Standard deviation of the noise: that of a good scanner, less where samples are so close
/// that it would turn triangles over.
pub fn noise_sigma(triangles: u64) -> f64 {
    (0.07 * nominal_step(triangles)).min(0.015)
}

/// The truth about a statue.
pub fn describe(options: &StatueOptions) -> StatueDescription {
    let on_panel = |p: [f64; 2]| [p[0], p[1], Panel::FRONT];
    let ([a, b], groove_depth, groove_width) = GROOVE;
    let (vertex, length, angle_depth, angle_width) = ANGLE;
    let sigma = noise_sigma(options.triangles);
    let corner = |sign: f64| {
        [Panel::MIDDLE[0] + sign * Panel::HALF[0], Panel::MIDDLE[1] + sign * Panel::HALF[1]]
    };
    StatueDescription {
        unit: "mm",
        up: "+y",
        front: "+z",
        seed: options.seed,
        triangles: options.triangles,
        size_mm: super::body::SIZE,
        plinth: PlinthDescription {
            low_mm: PLINTH[0],
            high_mm: PLINTH[1],
            edge_radius_mm: PLINTH_ROUND,
        },
        panel: PanelDescription { z_mm: Panel::FRONT, low_mm: corner(-1.0), high_mm: corner(1.0) },
        groove: GrooveDescription {
            ends_mm: [on_panel(a), on_panel(b)],
            length_mm: ((b[0] - a[0]).powi(2) + (b[1] - a[1]).powi(2)).sqrt(),
            depth_mm: groove_depth,
            width_mm: groove_width,
            profile_mm: [
                [-groove_width / 2.0, 0.0],
                [0.0, -groove_depth],
                [groove_width / 2.0, 0.0],
            ],
        },
        angle: AngleDescription {
            vertex_mm: on_panel(vertex),
            directions: [[1.0, 0.0, 0.0], [ANGLE_DIRECTION[0], ANGLE_DIRECTION[1], 0.0]],
            length_mm: length,
            degrees: ANGLE_DEGREES,
            depth_mm: angle_depth,
            width_mm: angle_width,
        },
        letters: inscription::letters(),
        noise: NoiseDescription { sigma_mm: sigma, max_mm: NOISE_MAX_SIGMAS * sigma },
    }
}
