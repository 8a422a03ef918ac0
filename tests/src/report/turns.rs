//! Commands that take turns: what one round of them saw of the machine, all of them saw.

use serde_json::Value;

use super::error::ReportError;
use super::programs::{Line, Programs, number};

/// Rounds of everything whose ratios are stated.
pub(super) const ROUNDS: usize = 5;

/// What `hlod-render bench` measured in one round, or the medians of several.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Frames {
    /// Frames a second in the mean.
    pub(super) fps: f64,
    /// Of the slowest frame.
    pub(super) fps_min: f64,
    /// The median frame's milliseconds.
    pub(super) ms: f64,
    /// Primitives drawn a frame.
    pub(super) primitives: f64,
    /// Each frame's milliseconds along the path.
    pub(super) times_ms: Vec<f64>,
}

impl Frames {
    fn of(printed: &Value) -> Result<Frames, ReportError> {
        let times = printed.get("frame_times_ms").and_then(Value::as_array);
        let times = times.ok_or_else(|| ReportError::unexpected("bench", "no frame_times_ms"))?;
        Ok(Frames {
            fps: number(printed, "fps_mean")?,
            fps_min: 1e3 / number(printed, "frame_ms.max")?,
            ms: number(printed, "frame_ms.p50")?,
            primitives: number(printed, "primitives_mean")?,
            times_ms: times.iter().filter_map(Value::as_f64).collect(),
        })
    }

    fn median(rounds: &[Frames]) -> Frames {
        let of = |get: &dyn Fn(&Frames) -> f64| median(rounds.iter().map(get).collect());
        let frames = rounds.iter().map(|r| r.times_ms.len()).min().unwrap_or(0);
        Frames {
            fps: of(&|r| r.fps),
            fps_min: of(&|r| r.fps_min),
            ms: of(&|r| r.ms),
            primitives: of(&|r| r.primitives),
            times_ms: (0..frames).map(|i| of(&|r| r.times_ms[i])).collect(),
        }
    }
}

/// What came of commands that took turns.
pub(super) struct Turns {
    rounds: Vec<Vec<Frames>>,
}

impl Turns {
    /// Runs benchmarks one after the other, [`ROUNDS`] times.
    pub(super) fn take(programs: &Programs, lines: &[Line]) -> Result<Turns, ReportError> {
        let round = |i| programs.round(lines, i)?.iter().map(Frames::of).collect();
        let rounds = (0..ROUNDS).map(round).collect::<Result<_, ReportError>>()?;
        Ok(Turns { rounds })
    }

    /// Medians of one command's rounds.
    pub(super) fn frames(&self, command: usize) -> Frames {
        let rounds: Vec<Frames> = self.rounds.iter().map(|round| round[command].clone()).collect();
        Frames::median(&rounds)
    }

    /// How many times as many frames a second `a` draws as `b`: the median of rounds' ratios of median
    /// frames.
    pub(super) fn ratio(&self, a: usize, b: usize) -> f64 {
        median(self.rounds.iter().map(|round| round[b].ms / round[a].ms).collect())
    }

    /// The same of the places along the path that `b`, which has fewer frames, shares with `a`; NaN where its number of
    /// frames does not divide the other, so that they are elsewhere.
    pub(super) fn ratio_at_shared(&self, a: usize, b: usize) -> f64 {
        let ratio = |round: &Vec<Frames>| {
            let (all, few) = (&round[a].times_ms, &round[b].times_ms);
            if few.is_empty() || all.len() % few.len() != 0 {
                return f64::NAN;
            }
            let shared = all.iter().step_by(all.len() / few.len());
            median(few.clone()) / median(shared.copied().collect())
        };
        median(self.rounds.iter().map(ratio).collect())
    }
}

/// The middle of numbers; NaN of none.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match (values.len(), values.len() / 2) {
        (0, _) => f64::NAN,
        (n, half) if n % 2 == 1 => values[half],
        (_, half) => (values[half - 1] + values[half]) / 2.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(ms: f64) -> Frames {
        Frames { fps: 1e3 / ms, fps_min: 5.0, ms, primitives: 7.0, times_ms: vec![ms, 2.0 * ms] }
    }

    #[test]
    fn medians_and_ratios_are_of_rounds() {
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(vec![4.0, 1.0]), 2.5);
        // The machine slows down to a half in the third round: the ratio stays.
        let round = |slow: f64| vec![frames(10.0 * slow), frames(20.0 * slow)];
        let turns = Turns { rounds: vec![round(1.0), round(1.1), round(2.0)] };
        assert_eq!(turns.ratio(0, 1), 2.0);
        assert!((turns.frames(1).ms - 22.0).abs() < 1e-9);
        assert_eq!(turns.frames(0).times_ms, [11.0, 22.0]);
    }

    #[test]
    fn ratios_of_fewer_frames_are_of_those_places_alone() {
        // Every other frame is slow, and those are the ones that the other command has.
        let of = |times_ms: &[f64]| Frames { times_ms: times_ms.to_vec(), ..frames(7.0) };
        let turns = |few: &[f64]| Turns {
            rounds: vec![vec![of(&[50.0, 1.0, 50.0, 1.0, 50.0, 1.0]), of(few)]],
        };
        assert_eq!(turns(&[100.0, 200.0, 150.0]).ratio_at_shared(0, 1), 3.0);
        assert!(turns(&[100.0; 4]).ratio_at_shared(0, 1).is_nan());
        assert!(turns(&[]).ratio_at_shared(0, 1).is_nan());
    }
}
