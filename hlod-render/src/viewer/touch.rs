//! Fingers: one turns, two move along and zoom, a tap picks, two taps centre.

use glam::DVec2;
use winit::event::{Touch, TouchPhase};

/// A finger that goes no farther taps, in pixels.
const TAP_PX: f64 = 12.0;

/// What fingers ask for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Asked {
    /// One finger begins to turn here.
    Turn(DVec2),
    /// Two fingers take hold here, between them.
    Hold(DVec2),
    /// What was begun goes on here; and by how much two fingers have come apart since.
    Go(DVec2, f64),
    /// A finger tapped here.
    Tap(DVec2),
    /// The last finger of a gesture was lifted, or one of two: what was begun has ended.
    End,
}

/// The fingers on the screen.
#[derive(Debug, Default)]
pub struct Touches {
    fingers: Vec<(u64, DVec2)>,
    /// The only finger so far, where it came down and has stayed.
    tap: Option<DVec2>,
}

impl Touches {
    /// Takes in an event; places are relative to the statue's picture, in pixels.
    pub fn take(&mut self, touch: &Touch, place: DVec2) -> Option<Asked> {
        match touch.phase {
            TouchPhase::Started => {
                self.fingers.retain(|(id, _)| *id != touch.id);
                self.fingers.push((touch.id, place));
                self.tap = (self.fingers.len() == 1).then_some(place);
                (self.fingers.len() == 2).then(|| Asked::Hold(self.middle()))
            }
            TouchPhase::Moved => {
                let spread = self.spread();
                let finger = self.fingers.iter_mut().find(|(id, _)| *id == touch.id)?;
                finger.1 = place;
                match self.fingers.len() {
                    1 => match self.tap {
                        Some(from) if from.distance(place) <= TAP_PX => None,
                        Some(from) => {
                            self.tap = None;
                            Some(Asked::Turn(from))
                        }
                        None => Some(Asked::Go(place, 1.0)),
                    },
                    2 => {
                        let ratio = self.spread() / spread.max(1.0);
                        Some(Asked::Go(self.middle(), ratio.clamp(0.2, 5.0)))
                    }
                    // More fingers are none of ours.
                    _ => None,
                }
            }
            TouchPhase::Ended | TouchPhase::Cancelled => {
                let known = self.fingers.iter().any(|(id, _)| *id == touch.id);
                self.fingers.retain(|(id, _)| *id != touch.id);
                // A finger that stays behind does not go on turning.
                let tap = self.tap.take().filter(|_| touch.phase == TouchPhase::Ended);
                known.then(|| tap.map_or(Asked::End, Asked::Tap))
            }
        }
    }

    fn middle(&self) -> DVec2 {
        let sum: DVec2 = self.fingers.iter().map(|(_, at)| *at).sum();
        sum / self.fingers.len().max(1) as f64
    }

    /// How far two fingers are apart.
    fn spread(&self) -> f64 {
        match self.fingers.as_slice() {
            [(_, a), (_, b)] => a.distance(*b).max(1.0),
            _ => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use winit::event::DeviceId;

    use super::*;

    fn touch(id: u64, phase: TouchPhase) -> Touch {
        let location = winit::dpi::PhysicalPosition::new(0.0, 0.0);
        Touch { device_id: DeviceId::dummy(), phase, location, force: None, id }
    }

    #[test]
    fn one_finger_turns_or_taps() {
        let mut touches = Touches::default();
        let at = |x: f64| DVec2::new(x, 50.0);
        assert_eq!(touches.take(&touch(1, TouchPhase::Started), at(10.0)), None);
        assert_eq!(touches.take(&touch(1, TouchPhase::Moved), at(14.0)), None);
        assert_eq!(
            touches.take(&touch(1, TouchPhase::Ended), at(14.0)),
            Some(Asked::Tap(at(10.0)))
        );
        assert_eq!(touches.take(&touch(2, TouchPhase::Started), at(10.0)), None);
        assert_eq!(
            touches.take(&touch(2, TouchPhase::Moved), at(40.0)),
            Some(Asked::Turn(at(10.0)))
        );
        assert_eq!(
            touches.take(&touch(2, TouchPhase::Moved), at(60.0)),
            Some(Asked::Go(at(60.0), 1.0))
        );
        assert_eq!(touches.take(&touch(2, TouchPhase::Ended), at(60.0)), Some(Asked::End));
        // Of a finger that nobody saw come.
        assert_eq!(touches.take(&touch(3, TouchPhase::Moved), at(60.0)), None);
        assert_eq!(touches.take(&touch(3, TouchPhase::Ended), at(60.0)), None);
    }

    #[test]
    fn two_fingers_hold_and_zoom_and_leave_nothing_behind() {
        let mut touches = Touches::default();
        let at = |x: f64| DVec2::new(x, 50.0);
        touches.take(&touch(1, TouchPhase::Started), at(100.0));
        assert_eq!(
            touches.take(&touch(2, TouchPhase::Started), at(200.0)),
            Some(Asked::Hold(at(150.0)))
        );
        let apart = touches.take(&touch(2, TouchPhase::Moved), at(300.0));
        assert_eq!(apart, Some(Asked::Go(at(200.0), 2.0)));
        assert_eq!(touches.take(&touch(1, TouchPhase::Ended), at(100.0)), Some(Asked::End));
        assert_eq!(touches.take(&touch(2, TouchPhase::Cancelled), at(300.0)), Some(Asked::End));
        assert_eq!(touches.take(&touch(2, TouchPhase::Ended), at(300.0)), None);
    }
}
