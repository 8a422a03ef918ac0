//! What the sculptor did to the surface: drapery folds, chisel marks, and the grain of the
//! stone. Each is a height that is added to the distance field (negative = cut away).

use super::lanes::{Lanes, Points};
use super::noise::{noise, row_hash};
use glam::DVec3;

/// The smooth, dressed panel on the plinth's front: nothing here ever touches it.
pub struct Panel;

impl Panel {
    /// The plane's z, mm.
    pub const FRONT: f64 = 120.0;
    /// The panel's middle, x and y, mm.
    pub const MIDDLE: [f64; 2] = [0.0, 70.0];
    /// Half its width and height, mm.
    pub const HALF: [f64; 2] = [136.0, 58.0];
    /// Over this way, mm, marks grow from nothing to their full depth outside it.
    const RAMP: f32 = 4.0;

    /// Whether nothing within `radius` of `p` touches the panel.
    pub fn keeps_clear(p: DVec3, radius: f64) -> bool {
        let x = (p.x - Self::MIDDLE[0]).abs() - Self::HALF[0];
        let y = (p.y - Self::MIDDLE[1]).abs() - Self::HALF[1];
        p.z < Self::FRONT - radius || x.max(y) > radius
    }

    /// 0 on the panel, 1 from [`Panel::RAMP`] beyond its border.
    fn distance_factor(p: Points) -> Lanes {
        let x = (p.x - Self::MIDDLE[0] as f32).abs() - Self::HALF[0] as f32;
        let y = (p.y - Self::MIDDLE[1] as f32).abs() - Self::HALF[1] as f32;
        // Behind the panel lies solid stone; in front of it nothing.
        let z = -p.z + (Self::FRONT as f32 - 8.0);
        (x.max(y).max(z) * (1.0 / Self::RAMP)).clamp(0.0, 1.0)
    }
}

/// One kind of relief.
#[derive(Clone, Debug)]
pub enum Relief {
    /// Folds that hang between two points of the shoulders.
    Folds {
        /// Where the folds gather (x, y).
        gather: [[f32; 2]; 2],
        /// Folds in a half turn of the angle under which both points are seen.
        count: f32,
        /// Height from valley to ridge, mm.
        height: f32,
        /// Seed.
        seed: u32,
    },
    /// Short gouges of the chisel, in rows, in patches.
    Chisel {
        /// Depth of the deepest gouges, mm.
        depth: f32,
        /// Distance of rows, mm.
        pitch: f32,
        /// Length of a gouge, mm.
        stroke: f32,
        /// How much of the surface carries marks: 0 hardly any, 1 all of it.
        cover: f32,
        /// Seed.
        seed: u32,
    },
    /// Grain: octaves of noise, each (wavelength, amplitude) in mm.
    Grain {
        /// The octaves, coarse to fine.
        octaves: Vec<[f32; 2]>,
        /// Seed.
        seed: u32,
    },
}

/// Two sets of directions (across, along) for chisel rows.
const ROWS: [[[f32; 3]; 2]; 2] =
    [[[0.62, 0.66, 0.42], [-0.66, 0.70, -0.28]], [[-0.55, 0.62, 0.56], [0.72, 0.66, -0.20]]];

impl Relief {
    /// Largest amount by which it can move the field, mm.
    pub fn amount(&self) -> f32 {
        match self {
            Relief::Folds { height, .. } => 0.75 * height,
            Relief::Chisel { depth, .. } => 1.3 * depth,
            Relief::Grain { octaves, .. } => octaves.iter().map(|o| 0.75 * o[1]).sum(),
        }
    }

    /// Largest change per mm of way that is met in practice.
    pub fn slope(&self) -> f32 {
        match self {
            Relief::Folds { .. } => 1.3,
            Relief::Chisel { depth, pitch, .. } => 5.0 * depth / pitch,
            Relief::Grain { octaves, .. } => octaves.iter().map(|o| 1.6 * o[1] / o[0]).sum(),
        }
    }

    /// Height above the plain surface.
    #[inline]
    pub fn height(&self, p: Points) -> Lanes {
        match self {
            Relief::Folds { gather, count, height, seed } => {
                folds(p, *gather, *count, *height, *seed)
            }
            Relief::Chisel { depth, pitch, stroke, cover, seed } => {
                let patch = noise(p.scaled(1.0 / 34.0), *seed);
                let bend = noise(p.scaled(1.0 / 15.0), seed ^ 0x51ed) * 1.1;
                let edge = 0.22 - 0.5 * cover;
                let first = gouges(p, 0, *pitch, *stroke, bend, *seed)
                    * patch.smoothstep(edge - 0.1, edge + 0.1);
                let second = gouges(p, 1, *pitch * 1.17, *stroke, bend, *seed)
                    * (-patch).smoothstep(edge - 0.1, edge + 0.1);
                (first + second) * -*depth * Panel::distance_factor(p)
            }
            Relief::Grain { octaves, seed } => {
                let mut sum = Lanes::splat(0.0);
                for (i, o) in octaves.iter().enumerate() {
                    let n = noise(p.scaled(1.0 / o[0]), seed.wrapping_add(i as u32 * 77));
                    sum = sum + n * o[1];
                }
                sum * Panel::distance_factor(p)
            }
        }
    }
}

/// Rows of gouges, 0 … 1 deep: a parabola across each row, so that ridges stay sharp, and
/// hollow boats along it, each row beginning elsewhere.
#[inline]
fn gouges(p: Points, set: usize, pitch: f32, stroke: f32, bend: Lanes, seed: u32) -> Lanes {
    let t = p.dot(ROWS[set][0]) * (1.0 / pitch) + bend;
    let row = t.round();
    let u = t - row;
    let shift = row_hash(row, seed.wrapping_add(set as u32));
    let v = p.dot(ROWS[set][1]) * (1.0 / stroke) + shift * 7.3;
    let v = v - v.round();
    let boat = -(v * v) * 4.0 + 1.0;
    let boat = -((-boat + 1.0) * (-boat + 1.0)) + 1.0;
    (-(u * u) * 4.0 + 1.0) * boat * (shift * 0.5 + 0.5)
}

/// Folds between two gathering points: the curves from which both are seen under one angle
/// are arcs of circles through both, like hanging cloth.
#[inline]
fn folds(p: Points, gather: [[f32; 2]; 2], count: f32, height: f32, seed: u32) -> Lanes {
    // The angle under which the two points are seen.
    let (ax, ay) = (-p.x + gather[0][0], -p.y + gather[0][1]);
    let (bx, by) = (-p.x + gather[1][0], -p.y + gather[1][1]);
    let cross = ax * by - ay * bx;
    let dot = ax * bx + ay * by;
    let angle = dot.angle_to(cross) * (1.0 / std::f32::consts::PI);
    // Number the folds, wandering a little, and let each ridge lean over its valley.
    let wander = noise(p.scaled(1.0 / 62.0), seed) * 0.9;
    let t = angle * count + wander;
    let row = t.round();
    let u = t - row;
    let ridge = -(u * u) * 4.0 + 1.0;
    let lean = u + ridge * 0.2;
    let ridge = -(lean * lean) * 4.0 + 1.0;
    let tall = row_hash(row, seed) * 0.55 + 0.45;
    // Small folds ride on the large ones, here and there.
    let fine = noise(p.scaled(1.0 / 41.0), seed ^ 0x77);
    let s = angle * (count * 2.6) + wander * 2.1 + fine * 0.8;
    let s = s - s.round();
    let small = (-(s * s) * 4.0 + 1.0) * fine.smoothstep(-0.05, 0.3) * 0.3;
    // Where the cloth is gathered, folds are as low as they are narrow.
    let da = (ax * ax + ay * ay).sqrt();
    let db = (bx * bx + by * by).sqrt();
    let near = da.min(db);
    let room = (near * (1.0 / 85.0)).clamp(0.0, 1.0) * near.smoothstep(5.0, 34.0);
    // Along the line between the points the angle jumps; above it the cloth lies flatter.
    let smooth = (-angle.abs() + 1.0).smoothstep(0.02, 0.14);
    let smooth = smooth * angle.if_negative(Lanes::splat(1.0), Lanes::splat(0.22));
    (ridge * tall + small - 0.55) * room * smooth * height
}
