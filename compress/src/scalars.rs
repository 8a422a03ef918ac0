//! Kept scalars: numbers that a scan has at its vertices besides shape and colour.
//!
//! A number is stored as a code of 16 bits: 0 where nobody measured one, else
//! minimum + (code − 1) · step, as the attribute's declaration says.

use bytemuck::{Pod, Zeroable};

use crate::FormatError;
use crate::bytes::{ByteReader, ByteWriter};

/// A file keeps no more scalars.
pub const SCALARS_MAX: usize = 4;

/// The codes of one vertex, in the order of their declarations; 0 where there is no value, and beyond
/// the last declaration.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
#[repr(C)]
pub struct Scalars(pub [u16; SCALARS_MAX]);

impl Scalars {
    /// Whether no value is known.
    pub fn is_unknown(&self) -> bool {
        *self == Scalars::default()
    }
}

/// How codes stand for numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct ScalarRange {
    /// The least number: code 1.
    pub minimum: f64,
    /// From one code to the next; values of the scan are off by half of it at most, and where the scan's
    /// values are multiples of it not at all.
    pub step: f64,
    /// The highest code in use; 0 where the scan has no value at all.
    pub codes: u16,
    /// What numbers are in, in the words of whoever built the file; empty where nobody said.
    pub unit: String,
}

impl ScalarRange {
    /// Units are no longer, in bytes.
    pub const UNIT_BYTES_MAX: usize = 32;

    /// For numbers from `minimum` to `maximum`, of which none are known where these are `None`. The step
    /// is the one `declared`; else 1 where all are whole numbers and few enough, and as fine as codes
    /// allow otherwise.
    ///
    /// # Errors
    /// When a declared step is too fine for the codes there are, with the finest that is not.
    pub fn new(
        bounds: Option<[f64; 2]>,
        are_whole: bool,
        declared: Option<f64>,
        unit: String,
    ) -> Result<ScalarRange, f64> {
        let Some([minimum, maximum]) = bounds else {
            return Ok(ScalarRange { minimum: 0.0, step: declared.unwrap_or(1.0), codes: 0, unit });
        };
        const CODES: f64 = 65_534.0;
        // Halves first: the span of any two finite numbers is then finite.
        let finest = (maximum / 2.0 - minimum / 2.0) / CODES * 2.0;
        let step = match declared {
            Some(step) if step < finest => return Err(finest),
            Some(step) => step,
            None if are_whole && finest <= 1.0 => 1.0,
            None if finest > 0.0 => finest,
            None => 1.0,
        };
        let mut range = ScalarRange { minimum, step, codes: u16::MAX, unit };
        range.codes = range.code(maximum);
        Ok(range)
    }

    /// The code of a number; of what is not one, that of no value.
    pub fn code(&self, value: f64) -> u16 {
        if !value.is_finite() || self.codes == 0 {
            return 0;
        }
        let steps = (value / 2.0 - self.minimum / 2.0) / self.step * 2.0;
        1 + steps.round().clamp(0.0, f64::from(self.codes - 1)) as u16
    }

    /// The number of a code, `None` where it is none.
    pub fn value(&self, code: u16) -> Option<f64> {
        (code > 0).then(|| self.minimum + f64::from(code - 1) * self.step)
    }

    /// The largest number; the least one where there is no value.
    pub fn maximum(&self) -> f64 {
        self.value(self.codes).unwrap_or(self.minimum)
    }

    pub(crate) fn write(&self, w: &mut ByteWriter) {
        w.f64(self.minimum);
        w.f64(self.step);
        w.u16(self.codes);
        w.string(&self.unit);
    }

    pub(crate) fn read(r: &mut ByteReader<'_>) -> Result<ScalarRange, FormatError> {
        let range =
            ScalarRange { minimum: r.f64()?, step: r.f64()?, codes: r.u16()?, unit: r.string()? };
        let is_range = range.minimum.is_finite()
            && range.step > 0.0
            && range.step.is_finite()
            && range.maximum().is_finite()
            && range.unit.len() <= Self::UNIT_BYTES_MAX;
        if is_range {
            Ok(range)
        } else {
            Err(FormatError::malformed("header", "no range of numbers"))
        }
    }
}

/// The mean of codes by weight, of those that are known; no value where none is.
///
/// Weights are positive; sums are taken in the order given.
pub fn mean_code(codes: impl IntoIterator<Item = (u16, f64)>) -> u16 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (code, weight) in codes {
        if code > 0 {
            sum += f64::from(code) * weight;
            weights += weight;
        }
    }
    if weights > 0.0 { (sum / weights).round().clamp(1.0, 65_535.0) as u16 } else { 0 }
}

/// What lies between two codes, so far from the first to the second: of two numbers the number there, to the
/// nearest code; of a number and none, whichever is nearer, the number in the middle.
pub fn code_between(a: u16, b: u16, t: f64) -> u16 {
    match (a, b) {
        (0, 0) => 0,
        (known, 0) => {
            if t <= 0.5 {
                known
            } else {
                0
            }
        }
        (0, known) => {
            if t >= 0.5 {
                known
            } else {
                0
            }
        }
        (a, b) => (f64::from(a) + t * (f64::from(b) - f64::from(a))).round() as u16,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn range(bounds: [f64; 2], are_whole: bool, declared: Option<f64>) -> ScalarRange {
        ScalarRange::new(Some(bounds), are_whole, declared, String::new()).unwrap()
    }

    #[test]
    fn whole_numbers_are_exact_where_there_are_codes_for_them() {
        let bytes = range([0.0, 255.0], true, None);
        assert_eq!((bytes.step, bytes.codes, bytes.maximum()), (1.0, 256, 255.0));
        assert!((0..=255).all(|v| bytes.value(bytes.code(v.into())) == Some(v.into())));
        let words = range([-3.0, 65_531.0], true, None);
        assert_eq!((words.step, words.codes), (1.0, u16::MAX));
        let more = range([0.0, 65_535.0], true, None);
        assert!(more.step > 1.0);
    }

    #[test]
    fn what_is_no_number_has_no_value() {
        let range = range([-2.0, 5.0], false, None);
        for none in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(range.code(none), 0);
        }
        assert_eq!(range.value(0), None);
        let nothing = ScalarRange::new(None, false, None, String::new()).unwrap();
        assert_eq!((nothing.code(3.0), nothing.maximum()), (0, 0.0));
        let same = super::ScalarRange::new(Some([7.5; 2]), false, None, String::new()).unwrap();
        assert_eq!((same.code(7.5), same.codes, same.maximum()), (1, 1, 7.5));
    }

    #[test]
    fn steps_that_are_too_fine_are_refused_with_the_finest_there_is() {
        let new = |step| ScalarRange::new(Some([0.0, 65.534]), false, Some(step), String::new());
        assert_eq!(new(0.002).unwrap().codes, 32_768);
        let finest = new(0.0009).unwrap_err();
        assert!((finest - 0.001).abs() < 1e-9 && new(finest).is_ok());
    }

    #[test]
    fn between_a_number_and_none_is_the_nearer() {
        assert_eq!((code_between(9, 0, 0.5), code_between(9, 0, 0.6)), (9, 0));
        assert_eq!((code_between(0, 9, 0.5), code_between(0, 9, 0.4)), (9, 0));
        assert_eq!((code_between(0, 0, 0.3), code_between(10, 20, 0.25)), (0, 13));
        assert_eq!(mean_code([(0, 5.0), (10, 1.0), (20, 3.0)]), 18);
        assert_eq!((mean_code([(0, 1.0)]), mean_code([])), (0, 0));
    }

    proptest! {
        /// No number of the range comes back more than half a step away.
        #[test]
        fn numbers_come_back_within_half_a_step(
            a in -1e30..1e30f64,
            b in -1e30..1e30f64,
            t in 0.0..=1.0f64,
        ) {
            let range = range([a.min(b), a.max(b)], false, None);
            let value = (a + t * (b - a)).clamp(a.min(b), a.max(b));
            let back = range.value(range.code(value)).unwrap();
            let rounding = 1e-15 * a.abs().max(b.abs());
            prop_assert!((back - value).abs() <= range.step / 2.0 + 4.0 * rounding);
        }
    }
}
