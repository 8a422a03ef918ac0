//! Keeping the window usable on slow machines: τ rises while moving and is restored at rest,
//! and frames are timed.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// What a frame may take while moving, unless chosen otherwise: fifteen a second.
pub const FRAME_TARGET_MS: f64 = 66.0;
/// A frame that takes less than this share of the target lets the next ones become finer again; so
/// that the two do not alternate, it is far below.
const FAST: f64 = 0.5;
/// τ rises at most so much.
const FACTOR_MAX: f64 = 4.0;
/// The view rests when nothing has moved it for so long.
const REST_AFTER: Duration = Duration::from_millis(200);

/// How much τ is raised while moving.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TauController {
    /// Remembered between motions, so that the second one starts where the first one ended.
    factor: f64,
}

impl Default for TauController {
    fn default() -> Self {
        TauController { factor: 1.0 }
    }
}

impl TauController {
    /// By what the chosen τ is multiplied in the next frame.
    pub fn factor(&self, moving: bool) -> f64 {
        if moving { self.factor } else { 1.0 }
    }

    /// Learns from a frame that was drawn while moving, and what it should have taken at most.
    pub fn moved(&mut self, frame_ms: f64, target_ms: f64) {
        if frame_ms > target_ms {
            // In proportion, but not all at once: one frame may be slow for other reasons.
            self.factor *= (frame_ms / target_ms).clamp(1.05, 1.5);
        } else if frame_ms < FAST * target_ms {
            self.factor *= 0.9;
        }
        self.factor = self.factor.clamp(1.0, FACTOR_MAX);
    }
}

/// When something moved last.
#[derive(Debug, Clone, Copy, Default)]
pub struct Motion {
    last: Option<Instant>,
}

impl Motion {
    /// Something moved.
    pub fn note(&mut self, now: Instant) {
        self.last = Some(now);
    }

    /// Whether that is so recent that more is to be expected.
    pub fn is_moving(&self, now: Instant) -> bool {
        self.rest_at().is_some_and(|rest| now < rest)
    }

    /// When the view will rest, if nothing moves it until then.
    pub fn rest_at(&self) -> Option<Instant> {
        self.last.map(|last| last + REST_AFTER)
    }
}

/// Times of the last frames.
#[derive(Debug, Default)]
pub struct FrameClock {
    frame_ms: Option<f64>,
    /// Newest last.
    finished: VecDeque<Instant>,
}

impl FrameClock {
    const FRAMES_KEPT: usize = 20;
    /// Longer pauses lie between motions, not between frames.
    const PAUSE: Duration = Duration::from_millis(1500);

    /// A frame was finished that took so long. Only those of motions count for their rate.
    pub fn frame(&mut self, now: Instant, frame_ms: f64, moving: bool) {
        self.frame_ms = Some(frame_ms);
        if !moving {
            return;
        }
        if self
            .finished
            .back()
            .is_some_and(|last| now.saturating_duration_since(*last) > Self::PAUSE)
        {
            self.finished.clear();
        }
        self.finished.push_back(now);
        while self.finished.len() > Self::FRAMES_KEPT {
            self.finished.pop_front();
        }
    }

    /// Time that the last frame took.
    pub fn last_ms(&self) -> Option<f64> {
        self.frame_ms
    }

    /// Frames a second during the last motion.
    pub fn frames_per_sec(&self) -> Option<f64> {
        let (first, last) = (self.finished.front()?, self.finished.back()?);
        let secs = last.saturating_duration_since(*first).as_secs_f64();
        (secs > 0.0).then(|| (self.finished.len() - 1) as f64 / secs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tau_rises_while_slow_up_to_four_times_and_only_while_moving() {
        let mut controller = TauController::default();
        controller.moved(100.0, FRAME_TARGET_MS);
        assert!(controller.factor(true) > 1.3);
        for _ in 0..20 {
            controller.moved(500.0, FRAME_TARGET_MS);
        }
        assert_eq!(controller.factor(true), 4.0);
        assert_eq!(controller.factor(false), 1.0);
    }

    #[test]
    fn tau_stays_within_the_band_and_falls_when_fast() {
        let mut controller = TauController::default();
        controller.moved(130.0, FRAME_TARGET_MS);
        let raised = controller.factor(true);
        controller.moved(50.0, FRAME_TARGET_MS);
        assert_eq!(controller.factor(true), raised);
        for _ in 0..20 {
            controller.moved(10.0, FRAME_TARGET_MS);
        }
        assert_eq!(controller.factor(true), 1.0);
    }

    #[test]
    fn a_machine_whose_time_falls_with_tau_settles() {
        // 200 ms at τ; time falls with the power 1.5 of the factor.
        let mut controller = TauController::default();
        for _ in 0..30 {
            controller.moved(200.0 / controller.factor(true).powf(1.5), FRAME_TARGET_MS);
        }
        let settled = controller.factor(true);
        controller.moved(200.0 / settled.powf(1.5), FRAME_TARGET_MS);
        assert_eq!(controller.factor(true), settled);
        assert!((1.5..=3.5).contains(&settled), "{settled}");
    }

    #[test]
    fn the_target_decides_what_is_slow() {
        for (target_ms, is_raised) in [(33.0, true), (66.0, false), (200.0, false)] {
            let mut controller = TauController::default();
            controller.moved(50.0, target_ms);
            assert_eq!(controller.factor(true) > 1.0, is_raised, "{target_ms}");
        }
    }

    #[test]
    fn motion_ends_and_frames_are_counted_within_one_motion() {
        let begin = Instant::now();
        let at = |ms| begin + Duration::from_millis(ms);
        let mut motion = Motion::default();
        assert!(!motion.is_moving(begin));
        motion.note(begin);
        assert!(motion.is_moving(at(100)) && !motion.is_moving(at(300)));

        let mut clock = FrameClock::default();
        clock.frame(at(0), 20.0, true);
        clock.frame(at(5_000), 20.0, true);
        clock.frame(at(5_050), 30.0, true);
        clock.frame(at(5_100), 40.0, true);
        assert_eq!(clock.last_ms(), Some(40.0));
        assert!(clock.frames_per_sec().is_some_and(|f| (f - 20.0).abs() < 1e-9));
    }
}
