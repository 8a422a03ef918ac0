//! Eight `f32` at a time: the statue's field is evaluated for eight points together, which
//! the compiler turns into vector instructions of any width.
//!
//! Only `+ − × ÷ √`, comparisons and integer operations are used, all of which IEEE 754 and
//! Rust define to the last bit: every machine computes the same statue. Rounding, cosine
//! and arc tangent are written here for that reason.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// How many points are evaluated together.
pub const WIDTH: usize = 8;

/// Eight numbers (or another count, where that is said).
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub struct Lanes<const N: usize = WIDTH>(pub [f32; N]);

/// Adding and subtracting 1.5·2²³ rounds to the nearest integer (ties to even) for
/// |x| < 2²², and leaves that integer in the low bits of the sum.
const ROUND: f32 = 12_582_912.0;

macro_rules! operator {
    ($name:ident, $method:ident, $op:tt) => {
        impl<const N: usize> $name for Lanes<N> {
            type Output = Lanes<N>;
            #[inline(always)]
            fn $method(self, other: Lanes<N>) -> Lanes<N> {
                self.zip(other, |a, b| a $op b)
            }
        }
        impl<const N: usize> $name<f32> for Lanes<N> {
            type Output = Lanes<N>;
            #[inline(always)]
            fn $method(self, other: f32) -> Lanes<N> {
                self.map(|a| a $op other)
            }
        }
    };
}
operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl<const N: usize> Neg for Lanes<N> {
    type Output = Lanes<N>;
    #[inline(always)]
    fn neg(self) -> Lanes<N> {
        self.map(|a| -a)
    }
}

impl<const N: usize> Lanes<N> {
    /// The same number eight times.
    #[inline(always)]
    pub fn splat(value: f32) -> Lanes<N> {
        Lanes([value; N])
    }

    #[inline(always)]
    fn map(self, f: impl Fn(f32) -> f32) -> Lanes<N> {
        let mut out = [0.0; N];
        for (o, a) in out.iter_mut().zip(self.0) {
            *o = f(a);
        }
        Lanes(out)
    }

    #[inline(always)]
    fn zip(self, other: Lanes<N>, f: impl Fn(f32, f32) -> f32) -> Lanes<N> {
        let mut out = [0.0; N];
        for (o, (a, b)) in out.iter_mut().zip(self.0.into_iter().zip(other.0)) {
            *o = f(a, b);
        }
        Lanes(out)
    }

    /// The smaller of the two. Written as a comparison: that is one instruction, while
    /// `f32::min` also looks after NaN, of which there are none here.
    #[inline(always)]
    pub fn min(self, other: Lanes<N>) -> Lanes<N> {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    /// The larger of the two.
    #[inline(always)]
    pub fn max(self, other: Lanes<N>) -> Lanes<N> {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    /// Limited to `low ..= high`.
    #[inline(always)]
    pub fn clamp(self, low: f32, high: f32) -> Lanes<N> {
        self.max(Lanes::splat(low)).min(Lanes::splat(high))
    }

    /// Without sign.
    #[inline(always)]
    pub fn abs(self) -> Lanes<N> {
        self.map(f32::abs)
    }

    /// Square root.
    #[inline(always)]
    pub fn sqrt(self) -> Lanes<N> {
        self.map(f32::sqrt)
    }

    /// The nearest integer.
    #[inline(always)]
    pub fn round(self) -> Lanes<N> {
        self.map(|a| (a + ROUND) - ROUND)
    }

    /// The bits of the nearest integer, biased by a constant: good for hashing only.
    #[inline(always)]
    pub fn round_bits(self) -> [u32; N] {
        (self + ROUND).0.map(f32::to_bits)
    }

    /// 0 at `low`, 1 at `high`, smooth between.
    #[inline(always)]
    pub fn smoothstep(self, low: f32, high: f32) -> Lanes<N> {
        let t = ((self - low) * (1.0 / (high - low))).clamp(0.0, 1.0);
        t * t * (-(t + t) + 3.0)
    }

    /// Where `self < 0` then `yes`, else `no`.
    #[inline(always)]
    pub fn if_negative(self, yes: Lanes<N>, no: Lanes<N>) -> Lanes<N> {
        let mut out = no.0;
        for (o, (s, y)) in out.iter_mut().zip(self.0.into_iter().zip(yes.0)) {
            *o = if s < 0.0 { y } else { *o };
        }
        Lanes(out)
    }

    /// cos(2π·self), to about 1e-3: two parabolas, bent once (enough for ornament).
    #[inline(always)]
    pub fn cos_turns(self) -> Lanes<N> {
        let u = self + 0.25;
        let u = u - u.round();
        let s = -(u * u.abs()) * 16.0 + u * 8.0;
        s * (s.abs() * 0.225 + 0.775)
    }

    /// The angle of (x = `self`, y) in radians, −π ..= π, to about 1e-4.
    ///
    /// Polynomial after C. Hastings, "Approximations for Digital Computers", 1955.
    #[inline(always)]
    pub fn angle_to(self, y: Lanes<N>) -> Lanes<N> {
        let x = self;
        let (ax, ay) = (x.abs(), y.abs());
        let q = ax.min(ay) / ax.max(ay).max(Lanes::splat(1e-9));
        let s = q * q;
        let a = (((s * 0.020_835_1 - 0.085_133) * s + 0.180_141) * s - 0.330_299_5) * s + 0.999_866;
        let a = a * q;
        let a = (ax - ay).if_negative(-a + std::f32::consts::FRAC_PI_2, a);
        let a = x.if_negative(-a + std::f32::consts::PI, a);
        y.if_negative(-a, a)
    }
}

/// Eight points (or vectors), in mm.
#[derive(Clone, Copy, Debug)]
pub struct Points<const N: usize = WIDTH> {
    /// x, to the right of someone who faces the statue.
    pub x: Lanes<N>,
    /// y, up.
    pub y: Lanes<N>,
    /// z, towards someone who faces the statue.
    pub z: Lanes<N>,
}

impl<const N: usize> Points<N> {
    /// The same point eight times.
    pub fn splat(p: [f32; 3]) -> Points<N> {
        Points { x: Lanes::splat(p[0]), y: Lanes::splat(p[1]), z: Lanes::splat(p[2]) }
    }

    /// The points relative to `origin`.
    #[inline(always)]
    pub fn from(self, origin: [f32; 3]) -> Points<N> {
        Points { x: self.x - origin[0], y: self.y - origin[1], z: self.z - origin[2] }
    }

    /// The points less `amount` of one vector each.
    #[inline(always)]
    pub fn less(self, v: [f32; 3], amount: Lanes<N>) -> Points<N> {
        Points { x: self.x - amount * v[0], y: self.y - amount * v[1], z: self.z - amount * v[2] }
    }

    /// Scaled about the origin.
    #[inline(always)]
    pub fn scaled(self, s: f32) -> Points<N> {
        Points { x: self.x * s, y: self.y * s, z: self.z * s }
    }

    /// Inner product with one vector.
    #[inline(always)]
    pub fn dot(self, v: [f32; 3]) -> Lanes<N> {
        self.x * v[0] + self.y * v[1] + self.z * v[2]
    }

    /// Length.
    #[inline(always)]
    pub fn length(self) -> Lanes<N> {
        (self.x * self.x + self.y * self.y + self.z * self.z).sqrt()
    }
}

/// Smooth minimum: the exact minimum wherever the two differ by `k` or more, so that a
/// part that is farther than that can be left out without a trace. Never larger than the
/// minimum, by at most `k/4`.
///
/// Based on: Inigo Quilez, "Smooth minimum", 2013 (the quadratic one).
#[inline(always)]
pub fn smooth_min<const N: usize>(a: Lanes<N>, b: Lanes<N>, k: f32) -> Lanes<N> {
    let h = (-(a - b).abs() + k).max(Lanes::splat(0.0));
    a.min(b) - h * h * (0.25 / k)
}

/// Smooth maximum, the mirror image of [`smooth_min`].
#[inline(always)]
pub fn smooth_max<const N: usize>(a: Lanes<N>, b: Lanes<N>, k: f32) -> Lanes<N> {
    let h = (-(a - b).abs() + k).max(Lanes::splat(0.0));
    a.max(b) + h * h * (0.25 / k)
}
