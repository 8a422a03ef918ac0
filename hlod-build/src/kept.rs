//! Numbers of the scan's vertices that are kept besides shape, normals and colours (`build --keep`).
//!
//! They are made codes of 16 bits before anything is cut ([`ScalarRange`]), so that from then on equal is
//! equal: a cut point's value is a function of the edge alone, as its place is. Nothing is simplified
//! less for them. A vertex of a coarser level has the mean of the values, by area, of those that it
//! stands for, and none where none of those has one: within the scan's least and largest, and not bounded
//! otherwise.

use hlod_compress::{SCALARS_MAX, ScalarRange, Scalars, mean_code};
use serde::{Deserialize, Serialize};

use crate::error::BuildError;

/// A property to be kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KeptScalar {
    /// Its name in the scan, and in the file.
    pub name: String,
    /// How finely its numbers are kept; as finely as can be where `None`, which is exactly for up to
    /// 65,534 whole ones.
    pub step: Option<f64>,
    /// What they are in; empty where nobody said.
    pub unit: String,
}

/// Reads NAME, NAME=STEP, NAME=UNIT or NAME=STEP UNIT, with or without the space.
impl std::str::FromStr for KeptScalar {
    type Err = String;
    fn from_str(text: &str) -> Result<KeptScalar, String> {
        let (name, rest) = text.split_once('=').unwrap_or((text, ""));
        let name = name.trim();
        if name.is_empty() || name.len() > 64 || name.chars().any(char::is_control) {
            return Err("expected NAME, NAME=STEP, NAME=UNIT or NAME=STEP UNIT".into());
        }
        let rest = rest.trim();
        // The longest beginning that is a number: an inch is no exponent.
        let ends = rest.char_indices().map(|(i, _)| i).chain([rest.len()]).rev();
        let number = |end: usize| rest[..end].parse::<f64>().ok().filter(|v| v.is_finite());
        let begins = rest.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c));
        let found = ends.filter(|_| begins).find_map(|end| Some((number(end)?, end)));
        let (step, unit) = match found {
            Some((step, _)) if step <= 0.0 => return Err("a step must be positive".into()),
            Some((step, end)) => (Some(step), rest[end..].trim()),
            None => (None, rest),
        };
        if unit.len() > ScalarRange::UNIT_BYTES_MAX || unit.chars().any(char::is_control) {
            return Err(format!("a unit of more than {} bytes", ScalarRange::UNIT_BYTES_MAX));
        }
        Ok(KeptScalar { name: name.to_owned(), step, unit: unit.to_owned() })
    }
}

impl std::fmt::Display for KeptScalar {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let KeptScalar { name, step, unit } = self;
        match step {
            Some(step) => write!(f, "{name}={step}{unit}"),
            None if unit.is_empty() => f.write_str(name),
            None => write!(f, "{name}={unit}"),
        }
    }
}

/// The means of all numbers that are known, by weight.
pub(crate) fn mean_scalars(all: impl IntoIterator<Item = (Scalars, f64)> + Clone) -> Scalars {
    let mean = |k: usize| mean_code(all.clone().into_iter().map(|(s, weight)| (s.0[k], weight)));
    Scalars(std::array::from_fn(mean))
}

/// Refuses what cannot be kept, before any work.
pub(crate) fn check(keep: &[KeptScalar]) -> Result<(), BuildError> {
    if keep.len() > SCALARS_MAX {
        let why = format!("--keep: at most {SCALARS_MAX} properties are kept, not {}", keep.len());
        return Err(BuildError::Usage(why));
    }
    let mut names: Vec<&str> = keep.iter().map(|k| k.name.as_str()).collect();
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(BuildError::Usage(format!("--keep {}: is given twice", pair[0]))),
        None => Ok(()),
    }
}

/// What the scan's vertices have of one property.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct ScalarAccount {
    pub(crate) kept: KeptScalar,
    /// The least and the largest number, where there is any.
    bounds: Option<[f64; 2]>,
    are_whole: bool,
    /// Vertices without.
    pub(crate) lacking: u64,
    /// Whether an input has it.
    pub(crate) is_there: bool,
}

impl ScalarAccount {
    pub(crate) fn new(kept: &KeptScalar) -> ScalarAccount {
        let kept = kept.clone();
        ScalarAccount { kept, bounds: None, are_whole: true, lacking: 0, is_there: false }
    }

    pub(crate) fn add(&mut self, value: f64) {
        if value.is_nan() {
            self.lacking += 1;
            return;
        }
        let [low, high] = self.bounds.unwrap_or([value; 2]);
        self.bounds = Some([low.min(value), high.max(value)]);
        self.are_whole &= value.fract() == 0.0;
    }

    /// How codes stand for its numbers.
    pub(crate) fn range(&self) -> Result<ScalarRange, BuildError> {
        let KeptScalar { name, step, unit } = &self.kept;
        ScalarRange::new(self.bounds, self.are_whole, *step, unit.clone()).map_err(|finest| {
            let [low, high] = self.bounds.unwrap_or_default();
            BuildError::Usage(format!(
                "--keep {}: from {low} to {high} the finest step for {name} is {finest}",
                self.kept
            ))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_steps_and_units_are_read() {
        let read = |text: &str| text.parse::<KeptScalar>().map(|k| (k.name, k.step, k.unit));
        let good = |name: &str, step, unit: &str| Ok((name.into(), step, unit.into()));
        assert_eq!(read("quality"), good("quality", None, ""));
        assert_eq!(read("quality=0.01"), good("quality", Some(0.01), ""));
        assert_eq!(read("depth=1e-3 mm"), good("depth", Some(1e-3), "mm"));
        assert_eq!(read("depth=2e"), good("depth", Some(2.0), "e"));
        assert_eq!(read("depth=mm"), good("depth", None, "mm"));
        assert_eq!(read("t=inch"), good("t", None, "inch"));
        for wrong in ["", "=3", "a=0", "a=-1mm", "a\u{7}b"] {
            assert!(read(wrong).is_err(), "{wrong:?}");
        }
        assert!(read(&format!("a={}", "µ".repeat(17))).is_err());
        for text in ["a", "a=0.5", "a=0.5mm", "a=mm"] {
            assert_eq!(text.parse::<KeptScalar>().unwrap().to_string(), text);
        }
    }
}
