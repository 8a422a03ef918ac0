//! What may cast soon: the motion of eye and light that is needed before a caster's page is wanted, as a
//! time.
//!
//! Which receivers may be drawn by some time is known from their own plan ([`crate::need`]). Round each
//! of them lies a box, and what of it can be in the picture by then, from wherever the eye can have
//! got to, is what may receive; the light is somewhere within what it may have moved. A caster's page may be
//! wanted once it may be on the way between the two, its parent too coarse, and it fine enough itself:
//! the same tests as for a frame, of larger boxes ([`super::CasterView`]).
//!
//! Time is cut into slices; a page is due when the first slice begins by the end of which it may be
//! wanted. So times are lower bounds, as far as the octree is loaded.

use std::f64::consts::FRAC_PI_2;

use glam::DMat4;
use hlod_compress::RepresentationKind;

use super::{CasterView, Casting, Motion, Receiver};
use crate::camera::Camera;
use crate::need::{Budget, BytesOf, Due, Pace, Plan, Times, Timing, plan_by};
use crate::scene::Light;
use crate::select::Measure;
use crate::skeleton::{Node, Skeleton};

/// Ends of the slices of time that are looked at. What would be due later than the last but one is not
/// asked for: see [`crate::residency::CASTERS_LATER_SECS`].
pub const SLICE_ENDS: [f64; 4] = [0.0, 0.02, 0.04, 0.06];

/// A picture with shadows, and how fast it may change.
#[derive(Debug, Clone, Copy)]
pub struct Outlook<'a> {
    /// The light.
    pub casting: Casting,
    /// The camera.
    pub camera: &'a Camera,
    /// Width and height of the picture in pixels.
    pub size: (u32, u32),
    /// Of the eye.
    pub pace: Pace,
    /// How fast the light may move: world units a second; of parallel light, radians a second.
    pub light_speed: f64,
}

/// Receivers of one model, and when they may be drawn: those of their plan.
pub fn receivers_of(
    plan: &Plan,
    skeleton: &Skeleton,
    world_from_model: &DMat4,
) -> Vec<Due<Receiver>> {
    let of = |due: &Due<(u32, usize)>| {
        let node = &skeleton.nodes()[due.what.0 as usize];
        Due { secs: due.secs, what: Receiver::of(node, world_from_model) }
    };
    plan.pages.iter().map(of).collect()
}

/// Casters of one model within the coming slices of time.
pub struct CastersAhead {
    slices: Vec<Slice>,
}

struct Slice {
    from_secs: f64,
    to_secs: f64,
    view: CasterView,
}

impl CastersAhead {
    /// For receivers of any model; `ends` are the slices' ends in ascending order.
    pub fn new(
        outlook: &Outlook<'_>,
        receivers: &[Due<Receiver>],
        world_from_model: DMat4,
        ends: &[f64],
    ) -> CastersAhead {
        let Outlook { casting, camera, size, pace, light_speed } = outlook;
        let mut slices: Vec<Slice> = Vec::new();
        for &to_secs in ends {
            let by_then = receivers.iter().filter(|due| due.secs <= to_secs).map(|due| due.what);
            let by_then: Vec<Receiver> = by_then.collect();
            let light = match casting.light {
                Light::Point(_) => light_speed * to_secs,
                // How far apart unit vectors are by then.
                Light::Directional(_) => 2.0 * (light_speed * to_secs / 2.0).min(FRAC_PI_2).sin(),
            };
            let motion = Motion { eye: pace.reach(to_secs), velocity: pace.velocity, light };
            let view =
                CasterView::within(motion, casting, camera, *size, &by_then, world_from_model);
            let from_secs = slices.last().map_or(0.0, |before| before.to_secs);
            slices.push(Slice { from_secs, to_secs, view });
        }
        CastersAhead { slices }
    }

    /// What may be wanted, the soonest first, as long as the pages fit into `bytes`; `bytes_of` says what
    /// a page takes.
    pub fn plan(&self, skeleton: &Skeleton, bytes: u64, bytes_of: BytesOf<'_>) -> Plan {
        let last = self.slices.last().map_or(0.0, |slice| slice.from_secs);
        plan_by(self, skeleton, last, Budget { bytes, bytes_of })
    }
}

impl Timing for CastersAhead {
    fn kind(&self) -> RepresentationKind {
        RepresentationKind::Geometric
    }

    fn times(&self, node: &Node, error: f64, from_secs: f64) -> Times {
        // Whatever is the case in a slice is so in the later ones.
        let first = |from: usize, may_be: &dyn Fn(&CasterView) -> bool| {
            let slices = self.slices.iter().enumerate().skip(from);
            slices
                .filter(|(_, s)| s.from_secs >= from_secs)
                .find(|(_, s)| may_be(&s.view))
                .map(|(i, _)| i)
        };
        let due = |slice: Option<usize>| slice.map_or(f64::INFINITY, |i| self.slices[i].from_secs);
        let Some(seen) = first(0, &|view| view.is_relevant(node)) else {
            let never = f64::INFINITY;
            return Times { seen: never, coarse: never, fine: never };
        };
        let coarse = first(seen, &|view| {
            view.threshold_px() <= 0.0 || view.shift_px(error, node)[1] > view.threshold_px()
        });
        let fine = first(seen, &|view| {
            view.threshold_px() > 0.0 && view.shift_px(error, node)[0] <= view.threshold_px()
        });
        Times { seen: due(Some(seen)), coarse: due(coarse), fine: due(fine) }
    }
}

#[cfg(test)]
mod tests;
