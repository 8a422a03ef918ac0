//! Hashes and gradient noise.
//!
//! Based on: Ken Perlin, "Improving Noise", SIGGRAPH 2002 (lattice gradients, quintic
//! fade). Here the gradients are taken from a cube and the lattice is hashed with additions
//! and shifts instead of a table, so that eight points run in step.

use super::lanes::{Lanes, Points, WIDTH};

const STEP: [u32; 3] = [0x9e37_79b1, 0x85eb_ca6b, 0xc2b2_ae35];

/// A well mixed 64-bit hash (the finaliser of Steele, Lea & Flood, "Fast splittable
/// pseudorandom number generators", 2014).
pub fn hash64(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A stream of numbers that depends on a seed alone.
pub struct Stream(u64);

impl Stream {
    /// The stream of `seed`, a different one for every `purpose`.
    pub fn new(seed: u64, purpose: u64) -> Stream {
        Stream(hash64(seed ^ hash64(purpose)))
    }

    /// Uniform in 0 .. 1.
    pub fn unit(&mut self) -> f64 {
        self.0 = hash64(self.0);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in −1 .. 1.
    pub fn signed(&mut self) -> f64 {
        self.unit() * 2.0 - 1.0
    }
}

#[inline]
fn mix(mut h: u32) -> u32 {
    h ^= h >> 15;
    h = h.wrapping_add(h << 9);
    h ^= h >> 11;
    h = h.wrapping_add(h << 5);
    h ^ (h >> 13)
}

/// Seven bits of a hash as −0.5 .. 0.5.
#[inline]
fn centred(bits: u32) -> f32 {
    f32::from_bits(0x3f80_0000 | (bits & 0x7f) << 16) - 1.5
}

/// One number in 0 .. 1 for each integer that `row` rounds to.
#[inline]
pub fn row_hash(row: Lanes, seed: u32) -> Lanes {
    let bits = row.round_bits();
    let mut out = [0.0; WIDTH];
    for (o, b) in out.iter_mut().zip(bits) {
        *o = centred(mix(b.wrapping_mul(STEP[0]).wrapping_add(seed))) + 0.5;
    }
    Lanes(out)
}

#[inline]
fn fade(t: Lanes) -> Lanes {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// Gradient noise of period-free lattice spacing 1: mean 0, about −0.6 .. 0.6 (never
/// beyond ±0.75), smooth to the second derivative, slope below 2.
#[inline]
pub fn noise(p: Points, seed: u32) -> Lanes {
    // Find the lattice cell. Rounding p − ½ to the nearest is a floor, but for ties, where
    // both neighbours give the same value.
    let cell = |v: Lanes| {
        let shifted = v - 0.5;
        (v - shifted.round(), shifted.round_bits())
    };
    let (fx, ix) = cell(p.x);
    let (fy, iy) = cell(p.y);
    let (fz, iz) = cell(p.z);
    let mut base = [0u32; WIDTH];
    for l in 0..WIDTH {
        base[l] = ix[l]
            .wrapping_mul(STEP[0])
            .wrapping_add(iy[l].wrapping_mul(STEP[1]))
            .wrapping_add(iz[l].wrapping_mul(STEP[2]))
            .wrapping_add(seed);
    }
    // Project the offset on each corner's gradient.
    let corner = |dx: u32, dy: u32, dz: u32| {
        let add = dx
            .wrapping_mul(STEP[0])
            .wrapping_add(dy.wrapping_mul(STEP[1]))
            .wrapping_add(dz.wrapping_mul(STEP[2]));
        let mut out = [0.0; WIDTH];
        for l in 0..WIDTH {
            let h = mix(base[l].wrapping_add(add));
            out[l] = centred(h) * (fx.0[l] - dx as f32)
                + centred(h >> 8) * (fy.0[l] - dy as f32)
                + centred(h >> 16) * (fz.0[l] - dz as f32);
        }
        Lanes(out)
    };
    let lerp = |a: Lanes, b: Lanes, t: Lanes| a + (b - a) * t;
    let (u, v, w) = (fade(fx), fade(fy), fade(fz));
    let y0 = lerp(
        lerp(corner(0, 0, 0), corner(1, 0, 0), u),
        lerp(corner(0, 1, 0), corner(1, 1, 0), u),
        v,
    );
    let y1 = lerp(
        lerp(corner(0, 0, 1), corner(1, 0, 1), u),
        lerp(corner(0, 1, 1), corner(1, 1, 1), u),
        v,
    );
    lerp(y0, y1, w)
}
