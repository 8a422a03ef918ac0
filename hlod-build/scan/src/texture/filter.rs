//! A texture and its smaller versions, averaged over what a corner of a face stands for.
//!
//! A pyramid of half the size each (L. Williams, *Pyramidal parametrics*, 1983), averaged in linear
//! light. A footprint is sampled along both its sides on the level whose texels are about as wide as
//! the samples are apart, so that a long and narrow one does not reach over its borders into what
//! lies beside it in the atlas.

use glam::DVec2;

/// What lies outside 0..1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wrap {
    /// The texture again.
    Repeat,
    /// The texture again, every other time turned round.
    Mirror,
    /// Its border.
    Clamp,
}

/// Most samples across a footprint and along it.
const SAMPLES_ACROSS: f64 = 4.0;
const SAMPLES_ALONG: usize = 16;

/// A decoded texture: red, green, blue in sRGB, rows from the top.
pub(crate) struct Texture {
    levels: Vec<Level>,
    /// Linear light of the 256 values.
    light: Box<[f32; 256]>,
}

struct Level {
    width: usize,
    height: usize,
    texels: Vec<u8>,
}

impl Texture {
    /// Of `width` × `height` × 3 bytes; neither is 0.
    pub(crate) fn new(width: usize, height: usize, texels: Vec<u8>) -> Texture {
        debug_assert_eq!(texels.len(), width * height * 3);
        let mut light = Box::new([0.0; 256]);
        for (value, linear) in (0u8..=255).zip(light.iter_mut()) {
            *linear = linear_from_srgb(f64::from(value) / 255.0) as f32;
        }
        let mut levels = vec![Level { width, height, texels }];
        while let Some(last) = levels.last().filter(|last| last.width.max(last.height) > 1) {
            levels.push(last.halved(&light));
        }
        Texture { levels, light }
    }

    /// Bytes that a texture of this size takes, the smaller versions included.
    pub(crate) fn bytes(width: u64, height: u64) -> u64 {
        // Each level has a quarter of the one before; odd sizes are rounded.
        width.saturating_mul(height).saturating_mul(4).saturating_add(3 * (width + height))
    }

    /// Width and height in texels.
    pub(crate) fn size(&self) -> DVec2 {
        DVec2::new(self.levels[0].width as f64, self.levels[0].height as f64)
    }

    /// Mean of the texture over a quadrilateral, in linear light; its corners, one after the other
    /// round it, are in texels from the upper left.
    pub(crate) fn mean(&self, quad: [DVec2; 4], wrap: [Wrap; 2]) -> [f64; 3] {
        let [a, b, c, d] = quad;
        let sides = [a.distance(b).max(d.distance(c)), a.distance(d).max(b.distance(c))];
        let (narrow, wide) = (sides[0].min(sides[1]), sides[0].max(sides[1]));
        let texel = (narrow / SAMPLES_ACROSS).max(wide / SAMPLES_ALONG as f64).max(1.0);
        // The cast saturates, and makes 0 of NaN.
        let level = (texel.log2().ceil() as usize).min(self.levels.len() - 1);
        let spacing = (level as f64).exp2();
        let counts = sides.map(|side| ((side / spacing).ceil() as usize).clamp(1, SAMPLES_ALONG));

        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for i in 0..counts[0] {
            let s = (i as f64 + 0.5) / counts[0] as f64;
            for j in 0..counts[1] {
                let t = (j as f64 + 0.5) / counts[1] as f64;
                let (near, far) = (a.lerp(b, s), d.lerp(c, s));
                // What a step of s and t covers there: less towards the narrow end.
                let covered = (b - a).lerp(c - d, t).perp_dot(far - near).abs();
                // Without an area there is still a place.
                let weight = covered.max(f64::MIN_POSITIVE);
                let light = self.sample(level, near.lerp(far, t), wrap);
                for channel in 0..3 {
                    sum[channel] += weight * light[channel];
                }
                weights += weight;
            }
        }
        sum.map(|sum| sum / weights)
    }

    /// Linear light between the four texels round a point, which is in texels of the first level.
    fn sample(&self, level: usize, at: DVec2, wrap: [Wrap; 2]) -> [f64; 3] {
        let full = self.size();
        let level = &self.levels[level];
        let size = [level.width, level.height];
        let mut places = [[0; 2]; 2];
        let mut shares = [[0.0; 2]; 2];
        for axis in 0..2 {
            let x = at[axis] * (size[axis] as f64 / full[axis]) - 0.5;
            let low = x.floor();
            shares[axis] = [1.0 - (x - low), x - low];
            // The casts saturate.
            let low = low as i64;
            places[axis] =
                [low, low.saturating_add(1)].map(|place| wrapped(place, size[axis], wrap[axis]));
        }
        let mut sum = [0.0; 3];
        for (row, row_share) in places[1].into_iter().zip(shares[1]) {
            for (column, share) in places[0].into_iter().zip(shares[0]) {
                let first = 3 * (row * level.width + column);
                for (sum, value) in sum.iter_mut().zip(&level.texels[first..first + 3]) {
                    *sum += row_share * share * f64::from(self.light[usize::from(*value)]);
                }
            }
        }
        sum
    }
}

/// The texel that stands at a place inside or outside.
fn wrapped(place: i64, size: usize, wrap: Wrap) -> usize {
    let size = size as i64;
    let within = match wrap {
        Wrap::Repeat => place.rem_euclid(size),
        Wrap::Mirror => {
            let place = place.rem_euclid(2 * size);
            place.min(2 * size - 1 - place)
        }
        Wrap::Clamp => place.clamp(0, size - 1),
    };
    within as usize
}

impl Level {
    /// Half as wide and high, rounded down; each texel is the mean of what it covers.
    fn halved(&self, light: &[f32; 256]) -> Level {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let columns = shares(self.width, width);
        let rows = shares(self.height, height);
        let mut texels = Vec::with_capacity(width * height * 3);
        for (first_row, row_shares) in &rows {
            for (first_column, column_shares) in &columns {
                let mut sum = [0.0f32; 3];
                for (row, row_share) in (*first_row..).zip(row_shares) {
                    for (column, share) in (*first_column..).zip(column_shares) {
                        let first = 3 * (row * self.width + column);
                        for (sum, value) in sum.iter_mut().zip(&self.texels[first..first + 3]) {
                            *sum += row_share * share * light[usize::from(*value)];
                        }
                    }
                }
                texels.extend(sum.map(|light| byte_from_light(light.into())));
            }
        }
        Level { width, height, texels }
    }
}

/// For each of `to` equal parts of a line of `from` texels the first one it touches, and how much of
/// the part that and the following ones are.
fn shares(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let part = from as f64 / to as f64;
    let shares_of = |i: usize| {
        let (begin, end) = (i as f64 * part, (i as f64 + 1.0) * part);
        let first = (begin.floor() as usize).min(from - 1);
        let last = (end.ceil() as usize).clamp(first + 1, from);
        let share = |texel: usize| {
            let texel = texel as f64;
            ((end.min(texel + 1.0) - begin.max(texel)).max(0.0) / part) as f32
        };
        (first, (first..last).map(share).collect())
    };
    (0..to).map(shares_of).collect()
}

/// The transfer function of IEC 61966-2-1, both 0..1.
pub(crate) fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.0031308 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Its inverse.
pub(crate) fn linear_from_srgb(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The nearest 8-bit value in sRGB.
pub(crate) fn byte_from_light(linear: f64) -> u8 {
    crate::unit_to_byte(srgb_from_linear(linear))
}

#[cfg(test)]
mod tests {
    use super::*;

    const REPEAT: [Wrap; 2] = [Wrap::Repeat; 2];

    fn grey(width: usize, height: usize, value: impl Fn(usize, usize) -> u8) -> Texture {
        let texels = (0..width * height).flat_map(|i| [value(i % width, i / width); 3]);
        Texture::new(width, height, texels.collect())
    }

    fn square(x: f64, y: f64, side: f64) -> [DVec2; 4] {
        [(x, y), (x + side, y), (x + side, y + side), (x, y + side)].map(DVec2::from)
    }

    #[test]
    fn one_colour_stays_that_colour() {
        for size in [(1, 1), (5, 3), (64, 64), (1, 130)] {
            let texture = grey(size.0, size.1, |_, _| 77);
            for side in [0.0, 0.3, 5.0, 1000.0] {
                let light = texture.mean(square(-3.0, 1.7, side), REPEAT);
                assert_eq!(light.map(byte_from_light), [77; 3], "{size:?}, {side}");
            }
        }
    }

    #[test]
    fn black_and_white_squares_become_the_grey_of_half_the_light() {
        let texture = grey(256, 256, |x, y| if (x + y) % 2 == 0 { 255 } else { 0 });
        let [mean, ..] = texture.mean(square(10.0, 20.0, 64.0), REPEAT);
        assert!((mean - 0.5).abs() < 0.01, "{mean}");
        // The mean of the numbers instead of the light would be 0.21.
        assert_eq!(byte_from_light(mean), 188);
        // A footprint within one of them is that one.
        let [mean, ..] = texture.mean(square(10.5, 20.5, 0.0), REPEAT);
        assert!(mean > 0.999, "{mean}");
    }

    #[test]
    fn a_ramp_of_light_has_the_light_of_its_middle() {
        // As exact as 8 bits are.
        let texture = grey(512, 16, |x, _| byte_from_light((x as f64 + 0.5) / 512.0));
        for (x, side) in [(100.0, 3.0), (200.0, 30.0), (64.0, 11.0)] {
            let quad = [(x, 4.0), (x + side, 4.0), (x + side, 8.0), (x, 8.0)].map(DVec2::from);
            let [mean, ..] = texture.mean(quad, REPEAT);
            let middle = (x + side / 2.0) / 512.0;
            assert!((mean - middle).abs() < 0.004, "{mean} for {middle}");
        }
        // Of a triangle whose one side is the left one it is not the middle of its box.
        let triangle = [(100.0, 0.0), (220.0, 8.0), (220.0, 8.0), (100.0, 16.0)].map(DVec2::from);
        let [mean, ..] = texture.mean(triangle, [Wrap::Clamp; 2]);
        assert!((mean - 140.0 / 512.0).abs() < 0.01, "{mean}");
    }

    #[test]
    fn narrow_footprints_do_not_reach_over_their_borders() {
        // White, 4 texels high, between black.
        let texture = grey(256, 256, |_, y| if (100..104).contains(&y) { 255 } else { 0 });
        let quad = [(20.0, 101.0), (60.0, 101.0), (60.0, 103.0), (20.0, 103.0)].map(DVec2::from);
        let [mean, ..] = texture.mean(quad, REPEAT);
        // 40 texels long: one sample on the level that suits the length alone would be half black.
        assert!(mean > 0.8, "{mean}");
    }

    #[test]
    fn outside_is_what_wrapping_says() {
        let texture = grey(4, 1, |x, _| [0, 60, 120, 180][x]);
        let at = |x: f64, wrap| {
            byte_from_light(texture.mean([DVec2::new(x, 0.5); 4], [wrap, Wrap::Clamp])[0])
        };
        assert_eq!([-0.5, 4.5, 6.5].map(|x| at(x, Wrap::Repeat)), [180, 0, 120]);
        assert_eq!([-0.5, 4.5, 6.5].map(|x| at(x, Wrap::Mirror)), [0, 180, 60]);
        assert_eq!([-0.5, 4.5, 6.5].map(|x| at(x, Wrap::Clamp)), [0, 180, 180]);
        for wild in [1e300, -1e300, f64::MAX] {
            at(wild, Wrap::Repeat);
        }
    }

    #[test]
    fn halves_of_odd_sizes_lose_no_light() {
        let texture = grey(7, 5, |x, y| if (x, y) == (6, 4) { 255 } else { 0 });
        let whole = texture.levels.last().unwrap();
        assert_eq!((whole.width, whole.height), (1, 1));
        let light = linear_from_srgb(f64::from(whole.texels[0]) / 255.0);
        assert!((light - 1.0 / 35.0).abs() < 0.003, "{light}");
    }
}
