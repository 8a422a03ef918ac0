//! Whole numbers as symbols and plain bits.

use crate::entropy::{Coder, Model};

/// Numbers that are small more often than large: buckets of half an octave as symbols, what is
/// left of the magnitude and the sign as plain bits.
///
/// Which distribution a number is coded with is its context, below `CONTEXTS`.
pub(super) struct Signed<const CONTEXTS: usize> {
    buckets: [Model; CONTEXTS],
    /// So many low bits of magnitudes are plain.
    shift: u32,
}

/// Magnitudes from here on are coded with their length.
const LONG: usize = 15;
const LONG_FROM: u32 = 256;

/// How often buckets occur, in thousandths: an average over pages of scans, from which distributions
/// start.
const EXPECTED: [u16; 16] = [80, 105, 80, 65, 105, 85, 120, 85, 130, 60, 55, 17, 8, 2, 2, 1];

/// First magnitude and plain bits of each bucket but the last.
const BUCKETS: [(u32, u32); LONG] = [
    (0, 0),
    (1, 0),
    (2, 0),
    (3, 0),
    (4, 1),
    (6, 1),
    (8, 2),
    (12, 2),
    (16, 3),
    (24, 3),
    (32, 4),
    (48, 4),
    (64, 5),
    (96, 5),
    (128, 7),
];

fn bucket_of(magnitude: u32) -> usize {
    match magnitude {
        0..4 => magnitude as usize,
        4..LONG_FROM => {
            let octave = magnitude.ilog2();
            let upper_half = magnitude >> (octave - 1) & 1;
            ((2 * octave + upper_half) as usize).min(LONG - 1)
        }
        _ => LONG,
    }
}

/// The plain bits for numbers of about this mean magnitude.
pub(super) fn shift_for(mean: f64) -> u32 {
    // Buckets tell well apart what is below 64.
    (mean / 12.0).max(1.0).log2().floor() as u32
}

impl<const CONTEXTS: usize> Signed<CONTEXTS> {
    pub(super) fn new(shift: u32) -> Self {
        Signed { buckets: [Model::expecting(EXPECTED); CONTEXTS], shift }
    }

    #[inline(always)]
    pub(super) fn code<C: Coder>(&mut self, coder: &mut C, context: usize, value: i32) -> i32 {
        let magnitude = value.unsigned_abs();
        let bucket = bucket_of(magnitude >> self.shift);
        let bucket = coder.symbol(&mut self.buckets[context], bucket as u32) as usize;
        // What is left of the magnitude, and the sign, are read at once and without a branch, which
        // could not be predicted.
        let Some(&(first, extra)) = BUCKETS.get(bucket) else { return long(coder, value) };
        let rest_bits = extra + self.shift;
        let sign_bits = u32::from(bucket as u32 + self.shift > 0);
        let rest = magnitude.wrapping_sub(first << self.shift) << sign_bits | u32::from(value < 0);
        let rest = coder.bits(rest_bits + sign_bits, rest);
        let magnitude = (first << self.shift) + (rest >> sign_bits);
        let minus = (rest & sign_bits) as i32;
        (magnitude as i32 ^ -minus).wrapping_add(minus)
    }
}

/// A number with its length.
#[cold]
fn long<C: Coder>(coder: &mut C, value: i32) -> i32 {
    let magnitude = value.unsigned_abs();
    let length = coder.bits(5, magnitude.checked_ilog2().unwrap_or(0)) + 1;
    let magnitude = coder.bits(length, magnitude);
    let negative = coder.bits(1, u32::from(value < 0)) != 0;
    if negative { (magnitude as i32).wrapping_neg() } else { magnitude as i32 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entropy::{Decoder, Encoder};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_survive(
            mut values in prop::collection::vec((any::<i32>(), 0u32..32), 0..99),
            shift in 0u32..=24,
        ) {
            values.extend([i32::MIN, i32::MAX, 0, -1, 1].map(|v| (v, 0)));
            // Small ones as often as large.
            let values: Vec<i32> = values.iter().map(|(v, by)| v >> by).collect();
            let mut encoder = Encoder::default();
            let mut numbers = Signed::<1>::new(shift);
            for &value in &values {
                prop_assert_eq!(numbers.code(&mut encoder, 0, value), value);
            }
            let (symbols, bits) = encoder.finish();
            let mut decoder = Decoder::new(&symbols, &bits).unwrap();
            let mut numbers = Signed::<1>::new(shift);
            for &value in &values {
                prop_assert_eq!(numbers.code(&mut decoder, 0, 0), value);
            }
            prop_assert!(decoder.finish().is_ok());
        }
    }

    #[test]
    fn buckets_follow_each_other() {
        for magnitude in 0..LONG_FROM {
            let (first, extra) = BUCKETS[bucket_of(magnitude)];
            assert!((first..first + (1 << extra)).contains(&magnitude), "{magnitude}");
        }
        assert_eq!(bucket_of(LONG_FROM), LONG);
    }
}
