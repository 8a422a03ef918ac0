//! The statue as a signed-distance-like field: a tape of operations that is shortened for
//! every region to what matters there.
//!
//! Based on: Matthew Keeter, "Massively parallel rendering of complex closed-form implicit
//! surfaces", SIGGRAPH 2020 (tapes specialised by interval arithmetic). Intervals here come
//! from a value in the middle of a ball and the slope of each operation, and the tape is a
//! flat list of parts, each a chain of solids, blended in order.

use super::lanes::{Lanes, Points, smooth_max, smooth_min};
use super::relief::{Panel, Relief};
use super::shape::Shape;

/// One step of the tape. `part` is the value of the part under construction, `whole` that
/// of the parts before.
#[derive(Clone, Debug)]
pub enum Op {
    /// Start a new, empty part.
    Begin,
    /// Add a solid to the part, rounding the joint over `f32` mm.
    Add(Shape, f32),
    /// Carve a solid out of the part.
    Carve(Shape, f32),
    /// Keep only what lies inside a solid.
    Keep(Shape, f32),
    /// Add a relief to the part's surface.
    Relief(Relief),
    /// Cut a V into the plinth's front.
    Incise(Cut),
    /// Add the finished part to the whole.
    End(f32),
    /// Add a relief to everything so far.
    Finish(Relief),
}

/// A straight V-cut in the plane z = [`Panel::FRONT`], with conical ends.
#[derive(Clone, Copy, Debug)]
pub struct Cut {
    /// First end of the bottom line, x and y, mm.
    pub a: [f32; 2],
    /// Second end.
    pub b: [f32; 2],
    /// Depth of the bottom below the plane, mm.
    pub depth: f32,
    /// Half the width at the plane, mm.
    pub half_width: f32,
}

impl Cut {
    /// Signed distance to the flanks of the cut, positive in the air.
    #[inline]
    fn distance<const N: usize>(&self, p: Points<N>) -> Lanes<N> {
        let ba = [self.b[0] - self.a[0], self.b[1] - self.a[1]];
        let inverse = 1.0 / (ba[0] * ba[0] + ba[1] * ba[1]);
        let (x, y) = (p.x - self.a[0], p.y - self.a[1]);
        let h = ((x * ba[0] + y * ba[1]) * inverse).clamp(0.0, 1.0);
        let (x, y) = (x - h * ba[0], y - h * ba[1]);
        let aside = (x * x + y * y).sqrt();
        let steep = self.depth / self.half_width;
        let bottom = p.z - (Panel::FRONT as f32 - self.depth);
        (bottom - aside * steep) * (1.0 / (1.0 + steep * steep).sqrt())
    }
}

/// Bounds of the field's value in a ball.
#[derive(Clone, Copy, Debug)]
pub struct Interval {
    /// Nowhere less.
    pub low: f32,
    /// Nowhere more.
    pub high: f32,
}

const NOTHING: Interval = Interval { low: FAR, high: FAR };
/// A distance beyond all others, mm.
const FAR: f32 = 1e6;

/// Which operations matter in some region.
pub type Tape = Vec<u16>;

/// The statue.
pub struct Field {
    ops: Vec<Op>,
}

impl Field {
    /// The field of a list of operations.
    pub fn new(ops: Vec<Op>) -> Field {
        assert!(ops.len() < usize::from(u16::MAX));
        Field { ops }
    }

    /// All operations.
    pub fn whole(&self) -> Tape {
        (0..self.ops.len() as u16).collect()
    }

    /// The field at eight points, by a tape that is valid there.
    pub fn value(&self, tape: &[u16], p: Points) -> Lanes {
        let mut whole = Lanes::splat(FAR);
        let mut part = Lanes::splat(FAR);
        for &i in tape {
            match &self.ops[usize::from(i)] {
                Op::Begin => part = Lanes::splat(FAR),
                Op::Add(s, k) => part = smooth_min(part, s.distance(p), *k),
                Op::Carve(s, k) => part = smooth_max(part, -s.distance(p), *k),
                Op::Keep(s, k) => part = smooth_max(part, s.distance(p), *k),
                Op::Relief(r) => part = part - r.height(p),
                Op::Incise(cut) => part = part.max(cut.distance(p)),
                Op::End(k) => whole = smooth_min(whole, part, *k),
                Op::Finish(r) => whole = whole - r.height(p),
            }
        }
        whole
    }

    /// The field at one point, by the whole tape.
    #[cfg(test)]
    pub fn at(&self, p: [f32; 3]) -> f32 {
        self.value(&self.whole(), Points::splat(p)).0[0]
    }

    /// Shorten `tape` to what matters within `radius` of `center`. Gives the bounds of the
    /// field there and its largest slope.
    pub fn shorten(
        &self,
        tape: &[u16],
        center: [f32; 3],
        radius: f32,
        out: &mut Tape,
    ) -> (Interval, f32) {
        let p = Points::<1>::splat(center);
        out.clear();
        let (mut whole, mut part) = (NOTHING, NOTHING);
        let (mut whole_slope, mut part_slope) = (0.0f32, 0.0f32);
        let mut start = 0;
        for &i in tape {
            let op = &self.ops[usize::from(i)];
            let around = |shape: &Shape| {
                let (d, way) = (shape.distance(p).0[0], shape.change(radius));
                Interval { low: d - way, high: d + way }
            };
            match op {
                Op::Begin => {
                    start = out.len();
                    (part, part_slope) = (NOTHING, 0.0);
                }
                Op::Add(s, k) => {
                    if s.at_least(center) - s.change(radius) >= part.high + k {
                        continue;
                    }
                    let d = around(s);
                    if d.low >= part.high + k {
                        continue;
                    }
                    if part.low >= d.high + k {
                        out.truncate(start + 1);
                        (part, part_slope) = (d, s.slope());
                    } else {
                        part_slope = part_slope.max(s.slope());
                        part.low = part.low.min(d.low) - 0.25 * k;
                        part.high = part.high.min(d.high);
                    }
                }
                Op::Carve(s, k) | Op::Keep(s, k) => {
                    let mut d = around(s);
                    if matches!(op, Op::Carve(..)) {
                        d = Interval { low: -d.high, high: -d.low };
                    }
                    if d.high + k <= part.low {
                        continue;
                    }
                    part_slope = part_slope.max(s.slope());
                    part.low = part.low.max(d.low);
                    part.high = part.high.max(d.high) + 0.25 * k;
                }
                Op::Relief(r) => {
                    part_slope += r.slope();
                    part.low -= r.amount();
                    part.high += r.amount();
                }
                Op::Incise(cut) => {
                    let d = cut.distance(p).0[0];
                    if d + radius <= part.low {
                        continue;
                    }
                    part.low = part.low.max(d - radius);
                    part.high = part.high.max(d + radius);
                }
                Op::End(k) => {
                    if part.low >= whole.high + k {
                        out.truncate(start);
                        continue;
                    }
                    if whole.low >= part.high + k {
                        out.drain(..start);
                        (whole, whole_slope) = (part, part_slope);
                    } else {
                        whole_slope = whole_slope.max(part_slope);
                        whole.low = whole.low.min(part.low) - 0.25 * k;
                        whole.high = whole.high.min(part.high);
                    }
                }
                Op::Finish(r) => {
                    whole_slope += r.slope();
                    whole.low -= r.amount();
                    whole.high += r.amount();
                }
            }
            out.push(i);
        }
        (whole, whole_slope)
    }
}
