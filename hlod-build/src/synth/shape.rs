//! The solids that the statue is put together from, as signed distances in mm (negative
//! inside). Ellipsoids are distances to first order only; everything else is a lower bound.
//!
//! Based on: Inigo Quilez, "Distance functions", 2008 (ellipsoid, box, round cone).

use super::lanes::{Lanes, Points, smooth_max};
use glam::{DMat3, DVec3};

/// One solid.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Ellipsoid with three unit axes and the reciprocals of its radii.
    Ellipsoid {
        /// Centre.
        center: [f32; 3],
        /// Unit axes.
        axes: [[f32; 3]; 3],
        /// One over each radius.
        inverse: [f32; 3],
    },
    /// Cone with round ends.
    Cone {
        /// First end.
        a: [f32; 3],
        /// From the first end to the second.
        ba: [f32; 3],
        /// One over the squared length.
        inverse: f32,
        /// Radius at the first end, and how much it grows to the second.
        radius: [f32; 2],
    },
    /// A ridge on some ground: a height over the ground's plane, so that nothing is hollow
    /// under it, with strands along it. It ends `depth` below its axis.
    Ridge {
        /// First end.
        a: [f32; 3],
        /// From the first end to the second.
        ba: [f32; 3],
        /// One over the squared length.
        inverse: f32,
        /// Half the width at the first end, and how much it grows to the second.
        radius: [f32; 2],
        /// Unit vector out of the ground.
        normal: [f32; 3],
        /// How far it reaches into the ground, mm.
        depth: f32,
        /// Unit vector across, along the ground.
        side: [f32; 3],
        /// Depth of the grooves between strands, as a part of the half width.
        groove: f32,
    },
    /// A ball with a flat cut: what lies beyond `normal · (p − center) > offset`.
    Lid {
        /// Centre of the ball.
        center: [f32; 3],
        /// Radius of the ball.
        radius: f32,
        /// Unit normal of the cut, into what stays.
        normal: [f32; 3],
        /// Where the cut lies.
        offset: f32,
    },
    /// Axis-parallel box with rounded edges.
    Box {
        /// Centre.
        center: [f32; 3],
        /// Half the size.
        half: [f32; 3],
        /// Radius of the edges.
        round: f32,
    },
    /// Upright cylinder on the statue's axis with rounded rims.
    Cylinder {
        /// Middle of the axis.
        center: [f32; 3],
        /// Radius.
        radius: f32,
        /// Half the height.
        half: f32,
        /// Radius of the rims.
        round: f32,
    },
    /// Upright ring.
    Torus {
        /// Centre.
        center: [f32; 3],
        /// Radius of the ring and of its section.
        radius: [f32; 2],
    },
}

fn single(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

impl Shape {
    /// Ellipsoid with radii along the columns of `axes`.
    pub fn ellipsoid(center: DVec3, axes: DMat3, radii: DVec3) -> Shape {
        Shape::Ellipsoid {
            center: single(center),
            axes: [single(axes.x_axis), single(axes.y_axis), single(axes.z_axis)],
            inverse: single(1.0 / radii),
        }
    }

    /// Cone with round ends.
    pub fn cone(a: DVec3, b: DVec3, radius_a: f64, radius_b: f64) -> Shape {
        let ba = b - a;
        Shape::Cone {
            a: single(a),
            ba: single(ba),
            inverse: (1.0 / ba.length_squared().max(1e-9)) as f32,
            radius: [radius_a as f32, (radius_b - radius_a) as f32],
        }
    }

    /// Ridge on a ground of this normal, reaching `depth` into it.
    pub fn ridge(
        a: DVec3,
        b: DVec3,
        radius: [f64; 2],
        (normal, depth): (DVec3, f64),
        groove: f64,
    ) -> Shape {
        let ba = b - a;
        Shape::Ridge {
            a: single(a),
            ba: single(ba),
            inverse: (1.0 / ba.length_squared().max(1e-9)) as f32,
            radius: [radius[0] as f32, (radius[1] - radius[0]) as f32],
            normal: single(normal),
            depth: depth as f32,
            side: single(normal.cross(ba).normalize_or_zero()),
            groove: groove as f32,
        }
    }

    /// By how much the distance may change per mm of a short way.
    pub fn slope(&self) -> f32 {
        match self {
            Shape::Ellipsoid { .. } => 1.35,
            Shape::Cone { .. } => 1.25,
            Shape::Ridge { .. } => 1.9,
            _ => 1.0,
        }
    }

    /// By how much the distance may change over a long way, mm.
    pub fn change(&self, way: f32) -> f32 {
        match self {
            // Strands are steep, but go no deeper than the groove.
            Shape::Ridge { radius, groove, .. } => {
                let deep = groove * radius[0].max(radius[0] + radius[1]);
                (1.3 * way + deep).min(self.slope() * way)
            }
            _ => self.slope() * way,
        }
    }

    /// A bound from below for the distance at one point that costs next to nothing, or one
    /// that says nothing: from the ball round a cone or a ridge, of which there are many.
    pub fn at_least(&self, p: [f32; 3]) -> f32 {
        let (a, ba, radius, depth) = match self {
            Shape::Cone { a, ba, radius, .. } => (a, ba, radius, 0.0),
            Shape::Ridge { a, ba, radius, depth, .. } => (a, ba, radius, *depth),
            _ => return f32::MIN,
        };
        let (mut apart, mut length) = (0.0, 0.0);
        for d in 0..3 {
            let q = p[d] - a[d] - 0.5 * ba[d];
            apart += q * q;
            length += ba[d] * ba[d];
        }
        let reach = 0.5 * length.sqrt() + radius[0].max(radius[0] + radius[1]) + depth;
        // A ridge's flanks lean, so that its distance grows less than the way.
        0.85 * (apart.sqrt() - reach)
    }

    /// Signed distance.
    #[inline]
    pub fn distance<const N: usize>(&self, p: Points<N>) -> Lanes<N> {
        match self {
            Shape::Ellipsoid { center, axes, inverse } => {
                let q = p.from(*center);
                let (x, y, z) = (
                    q.dot(axes[0]) * inverse[0],
                    q.dot(axes[1]) * inverse[1],
                    q.dot(axes[2]) * inverse[2],
                );
                let k0 = (x * x + y * y + z * z + 1e-12).sqrt();
                let (x, y, z) = (x * inverse[0], y * inverse[1], z * inverse[2]);
                let k1 = (x * x + y * y + z * z + 1e-12).sqrt();
                k0 * (k0 - 1.0) / k1
            }
            Shape::Cone { a, ba, inverse, radius } => {
                let q = p.from(*a);
                let h = (q.dot(*ba) * *inverse).clamp(0.0, 1.0);
                q.less(*ba, h).length() - (h * radius[1] + radius[0])
            }
            Shape::Ridge { a, ba, inverse, radius, normal, depth, side, groove } => {
                let q = p.from(*a);
                let h = (q.dot(*ba) * *inverse).clamp(0.0, 1.0);
                let r = q.less(*ba, h);
                let up = r.dot(*normal);
                // Across the ridge a parabola, and a steep plane beyond.
                let flat = r.less(*normal, up).length();
                let width = h * radius[1] + radius[0];
                let t = flat / width;
                let one = t.min(Lanes::splat(1.0));
                let top = (-(one * one) + 1.0) * 1.15 - (t - one) * 2.3;
                // Three strands: grooves where the skin has turned a third to each side.
                let across = (r.dot(*side) / width).clamp(-1.1, 1.1);
                let wave = (across * 1.5).cos_turns() - 1.0;
                let top = top + wave * (-one + 1.15) * (0.8 * groove);
                let steep = one * 2.3;
                let d = (up - top * width) / (steep * steep + 1.0).sqrt();
                d.max(-up - *depth)
            }
            Shape::Lid { center, radius, normal, offset } => {
                let q = p.from(*center);
                smooth_max(q.length() - *radius, -(q.dot(*normal) - *offset), 1.2)
            }
            Shape::Box { center, half, round } => {
                let q = p.from(*center);
                let zero = Lanes::splat(0.0);
                let (x, y, z) = (
                    q.x.abs() - (half[0] - round),
                    q.y.abs() - (half[1] - round),
                    q.z.abs() - (half[2] - round),
                );
                let outside = Points { x: x.max(zero), y: y.max(zero), z: z.max(zero) };
                outside.length() + x.max(y).max(z).min(zero) - *round
            }
            Shape::Cylinder { center, radius, half, round } => {
                let q = p.from(*center);
                let zero = Lanes::splat(0.0);
                let x = (q.x * q.x + q.z * q.z).sqrt() - (radius - round);
                let y = q.y.abs() - (half - round);
                let (ox, oy) = (x.max(zero), y.max(zero));
                (ox * ox + oy * oy).sqrt() + x.max(y).min(zero) - *round
            }
            Shape::Torus { center, radius } => {
                let q = p.from(*center);
                let x = (q.x * q.x + q.z * q.z).sqrt() - radius[0];
                (x * x + q.y * q.y).sqrt() - radius[1]
            }
        }
    }
}
