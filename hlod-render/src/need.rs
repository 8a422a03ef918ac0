//! How soon parts will be wanted: the motion needed before, as a time.
//!
//! The eye moves and turns no faster than a [`Pace`]. A node is drawn once the frustum meets its
//! box, its parent is too coarse and it is fine enough itself. Each of these is a distance in view
//! space that has to change its sign: of the box' corners from a plane of the frustum, or of the
//! nearest corner from the depth at which an error covers τ pixels.
//!
//! After t seconds the eye is within s·t of where its velocity v brings it, turned by some angle of at
//! most φ = ω·t. What is d along a direction and l across it is, along the turned direction, between
//! d·cos φ − l·sin φ and d·cos φ + l·sin φ: turned straight away from it or towards it. That holds for
//! corners as for v·t, and s·t comes on top. So times are lower bounds, whatever path the eye takes
//! within its pace: nothing is wanted earlier.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashSet};
use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec3, DVec4};
use hlod_compress::{BlockRef, RepresentationKind};

use crate::camera::Camera;
use crate::scene::Light;
use crate::select::{Selection, View, corners};
use crate::skeleton::{ChildLink, Node, Skeleton};

/// Nothing is planned for later.
const FARTHEST_SECS: f64 = 8.0;

/// How the eye moves and turns: on as it did, and otherwise by no more than something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// How it moved lately: view space, world units a second.
    pub velocity: DVec3,
    /// By how much it may move otherwise: world units a second.
    pub spread: f64,
    /// Radians a second at most.
    pub turn: f64,
}

impl Pace {
    /// Where the eye can have got to within some time.
    pub(crate) fn reach(&self, secs: f64) -> Reach {
        let turn = (self.turn * secs).min(PI);
        let (sin, cos) = turn.sin_cos();
        let spread = self.spread * secs;
        Reach { turn, sin, cos, secs, spread, moved: self.velocity.length() * secs + spread }
    }
}

/// A view and how fast it may change.
#[derive(Debug, Clone)]
pub struct Need<'a> {
    view: &'a View,
    selection: Selection,
    pace: Pace,
    /// View space: inside where dot(normal, p) + offset ≥ 0.
    planes: [DVec4; 5],
    /// Of the picture's corner, off the axis.
    corner_angle: f64,
}

/// When something will be wanted, at the earliest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Due<T> {
    /// From now.
    pub secs: f64,
    /// What.
    pub what: T,
}

/// What will be wanted soonest.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// Nodes and their representations, the soonest first.
    pub pages: Vec<Due<(u32, usize)>>,
    /// Nodes whose children's block is not loaded.
    pub blocks: Vec<Due<(u32, BlockRef)>>,
}

impl<'a> Need<'a> {
    /// For a view that is selected for in some way.
    pub fn new(view: &'a View, selection: Selection, pace: Pace) -> Need<'a> {
        let half = view.half_extent;
        let planes = if view.perspective {
            let side = |x: f64, y: f64, z: f64| DVec3::new(x, y, z).normalize().extend(0.0);
            [
                side(1.0, 0.0, -half.x),
                side(-1.0, 0.0, -half.x),
                side(0.0, 1.0, -half.y),
                side(0.0, -1.0, -half.y),
                DVec4::new(0.0, 0.0, -1.0, -view.near),
            ]
        } else {
            [
                DVec4::new(1.0, 0.0, 0.0, half.x),
                DVec4::new(-1.0, 0.0, 0.0, half.x),
                DVec4::new(0.0, 1.0, 0.0, half.y),
                DVec4::new(0.0, -1.0, 0.0, half.y),
                // Everything: depth does not count.
                DVec4::W,
            ]
        };
        Need { view, selection, pace, planes, corner_angle: half.length().atan() }
    }

    /// Earliest time at which something may be the case that stays so once it is; infinite where that
    /// is farther off than anyone plans.
    fn earliest(&self, may_be: impl Fn(Reach) -> bool) -> f64 {
        let at = |secs: f64| may_be(self.pace.reach(secs));
        if at(0.0) {
            return 0.0;
        }
        let (mut not_yet, mut maybe) = (0.0, FARTHEST_SECS);
        if !at(maybe) {
            return f64::INFINITY;
        }
        // To eight milliseconds; the earlier end, so that it is a bound.
        for _ in 0..10 {
            let middle = (not_yet + maybe) / 2.0;
            if at(middle) { maybe = middle } else { not_yet = middle }
        }
        not_yet
    }

    /// When the box may be seen, when the node's error may exceed τ, and when it may no longer.
    fn times(&self, node: &Node, error: f64) -> Times {
        let corners =
            corners(node.min, node.max).map(|c| self.view.view_from_model.transform_point3(c));
        // Corners and how fast they come towards the eye's plane, along a direction.
        let parts = |direction: DVec3| {
            (corners.map(|c| Parts::of(c, direction)), Parts::of(-self.pace.velocity, direction))
        };
        let inside = self.planes.map(|plane| (parts(plane.truncate()), plane.w));
        let seen = self.earliest(|reach| {
            // Not all corners are outside of one plane.
            let meets = |((parts, drift), offset): &(([Parts; 8], Parts), f64)| {
                let offset = offset + reach.most_moved(drift);
                parts.iter().any(|p| reach.most(p) + offset >= 0.0)
            };
            inside.iter().all(meets) && self.may_face(node, reach)
        });

        let error = error * self.view.scale;
        let tau = self.selection.error_threshold_px;
        if tau <= 0.0 {
            return Times { seen, coarse: 0.0, fine: f64::INFINITY };
        }
        let pixels = error * self.view.pixels;
        if !self.view.perspective {
            let coarse = if pixels > tau { 0.0 } else { f64::INFINITY };
            let fine = if pixels > tau { f64::INFINITY } else { 0.0 };
            return Times { seen, coarse, fine };
        }
        // ρ grows with the angle of the corner that is farthest off the axis, up to the picture's own.
        let (depths, drift) = parts(DVec3::NEG_Z);
        let widest = depths.iter().map(|p| p.angle).fold(0.0, f64::max);
        let shortest = depths.iter().map(|p| p.length).fold(f64::INFINITY, f64::min);
        let turned = |reach: Reach| reach.turn + (reach.moved / shortest).min(1.0).asin();
        let stretch = |angle: f64| 1.0 / angle.clamp(0.0, self.corner_angle).cos();
        // Nothing is measured nearer than the near plane.
        let coarse = if error + pixels * stretch(self.corner_angle) / tau < self.view.near {
            f64::INFINITY
        } else {
            self.earliest(|reach| {
                let moved = reach.least_moved(&drift);
                let too_near = error + pixels * stretch(widest + turned(reach)) / tau;
                depths.iter().any(|p| reach.least(p) + moved <= too_near)
            })
        };
        let fine = if error + pixels / tau <= self.view.near {
            0.0
        } else {
            self.earliest(|reach| {
                let moved = reach.most_moved(&drift);
                let far_enough = error + pixels * stretch(widest - turned(reach)) / tau;
                depths.iter().all(|p| reach.most(p) + moved >= far_enough)
            })
        };
        Times { seen, coarse, fine }
    }

    /// Whether the eye may get to see anything of a node but backs: as [`View::sees_only_backs`], whose
    /// angles moving can change by so much. Turning on the spot changes none of them.
    fn may_face(&self, node: &Node, reach: Reach) -> bool {
        let Some((axis, half_angle)) = node.cone else { return true };
        let view = self.view;
        if !view.perspective {
            let angle = axis.dot(-view.eye).clamp(-1.0, 1.0).acos();
            return angle + half_angle + reach.turn >= FRAC_PI_2 - 1e-6;
        }
        let centre = (node.min + node.max) / 2.0;
        let radius = (node.max - node.min).length() / 2.0;
        let (away, moved) = (centre - view.eye, reach.moved / view.scale);
        let distance = away.length();
        if distance - moved <= radius {
            return true;
        }
        let angle = (axis.dot(away) / distance).clamp(-1.0, 1.0).acos();
        let spread = (radius / (distance - moved)).asin() + (moved / distance).min(1.0).asin();
        angle + half_angle + spread >= FRAC_PI_2 - 1e-6
    }

    /// What will be wanted within `horizon_secs`, as long as the pages fit into `bytes`; `bytes_of` says
    /// what a page takes.
    pub fn plan(
        &self,
        skeleton: &Skeleton,
        horizon_secs: f64,
        bytes: u64,
        bytes_of: BytesOf<'_>,
    ) -> Plan {
        plan_by(self, skeleton, horizon_secs, Budget { bytes, bytes_of })
    }
}

/// What a representation of a node takes, in bytes.
pub type BytesOf<'a> = &'a dyn Fn(&Node, usize) -> u64;

/// How much may be planned for.
#[derive(Clone, Copy)]
pub(crate) struct Budget<'a> {
    pub(crate) bytes: u64,
    pub(crate) bytes_of: BytesOf<'a>,
}

/// When nodes of a front may be wanted.
pub(crate) trait Timing {
    /// Which hierarchy.
    fn kind(&self) -> RepresentationKind;
    /// Lower bounds for a node, no parent of which may be refined before `from_secs`.
    fn times(&self, node: &Node, error: f64, from_secs: f64) -> Times;
}

impl Timing for Need<'_> {
    fn kind(&self) -> RepresentationKind {
        self.selection.kind
    }

    fn times(&self, node: &Node, error: f64, _: f64) -> Times {
        Need::times(self, node, error)
    }
}

/// Follows the octree downwards, the soonest first.
pub(crate) fn plan_by(
    timing: &dyn Timing,
    skeleton: &Skeleton,
    horizon_secs: f64,
    budget: Budget<'_>,
) -> Plan {
    let mut plan = Plan::default();
    let mut left = budget.bytes;
    let mut soonest = BinaryHeap::from([Soon(Due { secs: 0.0, what: Step::Visit(0) })]);
    while let Some(Soon(due)) = soonest.pop() {
        if due.secs > horizon_secs {
            break;
        }
        match due.what {
            Step::Page(node, representation) => {
                let size = (budget.bytes_of)(&skeleton.nodes()[node as usize], representation);
                let Some(rest) = left.checked_sub(size) else { break };
                left = rest;
                plan.pages.push(Due { secs: due.secs, what: (node, representation) });
            }
            Step::Block(node, block) => {
                plan.blocks.push(Due { secs: due.secs, what: (node, block) });
            }
            Step::Visit(index) => {
                let node = &skeleton.nodes()[index as usize];
                let Some(r) = node.representation(timing.kind()) else { continue };
                let times = timing.times(node, node.representations[r].error, due.secs);
                let seen = due.secs.max(times.seen);
                let is_leaf = node.children == ChildLink::None;
                let fine = if is_leaf { 0.0 } else { times.fine };
                let page = Step::Page(index, r);
                soonest.push(Soon(Due { secs: seen.max(fine), what: page }));
                let refined = seen.max(times.coarse);
                match node.children {
                    ChildLink::None => {}
                    ChildLink::Nodes { first, count } => soonest.extend(
                        (first..first + count)
                            .map(|c| Soon(Due { secs: refined, what: Step::Visit(c) })),
                    ),
                    ChildLink::Unloaded(block) => {
                        soonest.push(Soon(Due { secs: refined, what: Step::Block(index, block) }))
                    }
                }
            }
        }
    }
    plan
}

impl Plan {
    /// The same, but for no later than `secs`.
    pub fn until(mut self, secs: f64) -> Plan {
        self.pages.retain(|due| due.secs <= secs);
        self.blocks.retain(|due| due.secs <= secs);
        self
    }

    /// The same with the ancestors of each page, due when it is, as far as all of them fit: where a part comes late they
    /// are drawn in its place. Those of a branch that comes into view are not there of themselves, and what stands in
    /// for it would be an ancestor of all that is seen.
    pub(crate) fn with_ancestors(
        self,
        kind: RepresentationKind,
        skeleton: &Skeleton,
        budget: Budget<'_>,
    ) -> Plan {
        let nodes = skeleton.nodes();
        let (mut planned, mut left) = (HashSet::new(), budget.bytes);
        let mut pages = Vec::with_capacity(self.pages.len());
        'pages: for due in self.pages {
            // From the page upwards, as far as there is anything new.
            let mut chain = vec![due.what];
            let mut node = due.what.0;
            while node != 0 {
                node = nodes[node as usize].parent;
                let Some(r) = nodes[node as usize].representation(kind) else { break };
                if planned.contains(&(node, r)) {
                    break;
                }
                chain.push((node, r));
            }
            for what in chain.into_iter().rev().filter(|&what| planned.insert(what)) {
                let size = (budget.bytes_of)(&nodes[what.0 as usize], what.1);
                let Some(rest) = left.checked_sub(size) else { break 'pages };
                left = rest;
                pages.push(Due { secs: due.secs, what });
            }
        }
        Plan { pages, blocks: self.blocks }
    }

    /// The same, but all of it so much later.
    pub(crate) fn later_by(mut self, secs: f64) -> Plan {
        self.pages.iter_mut().for_each(|due| due.secs += secs);
        self.blocks.iter_mut().for_each(|due| due.secs += secs);
        self
    }

    /// Both, the soonest first and each page once, as long as the pages fit.
    pub(crate) fn merged(self, other: Plan, skeleton: &Skeleton, budget: Budget<'_>) -> Plan {
        let mut pages = self.pages;
        pages.extend(other.pages);
        // Stable: of what is due at once the first plan's comes first.
        pages.sort_by(|a, b| a.secs.total_cmp(&b.secs));
        let (mut kept, mut left) = (HashSet::new(), budget.bytes);
        let fits = |due: &Due<(u32, usize)>| {
            let (node, r) = due.what;
            let size = (budget.bytes_of)(&skeleton.nodes()[node as usize], r);
            left = left.checked_sub(if kept.insert(due.what) { size } else { 0 })?;
            Some(*due)
        };
        let mut pages: Vec<_> = pages.iter().map_while(fits).collect();
        let mut seen = HashSet::new();
        pages.retain(|due| seen.insert(due.what));
        let mut blocks = self.blocks;
        blocks.extend(other.blocks);
        blocks.sort_by(|a, b| a.secs.total_cmp(&b.secs));
        let mut seen = HashSet::new();
        blocks.retain(|due| seen.insert(due.what.0));
        Plan { pages, blocks }
    }
}

/// A corner's distance along a direction and across it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Parts {
    along: f64,
    across: f64,
    length: f64,
    /// From the direction to the corner.
    angle: f64,
}

impl Parts {
    /// `direction` is of length 1.
    pub(crate) fn of(corner: DVec3, direction: DVec3) -> Parts {
        let (along, length) = (corner.dot(direction), corner.length());
        let across = (length * length - along * along).max(0.0).sqrt();
        Parts { along, across, length, angle: across.atan2(along) }
    }
}

/// Where the eye can have got to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reach {
    pub(crate) secs: f64,
    turn: f64,
    sin: f64,
    cos: f64,
    /// How far from where its velocity brings it.
    pub(crate) spread: f64,
    /// How far from where it is.
    moved: f64,
}

impl Reach {
    /// Where it is.
    pub(crate) const HERE: Reach =
        Reach { secs: 0.0, turn: 0.0, sin: 0.0, cos: 1.0, spread: 0.0, moved: 0.0 };

    pub(crate) fn is_here(&self) -> bool {
        *self == Reach::HERE
    }

    /// Most that something can be along the turned direction.
    pub(crate) fn most(&self, p: &Parts) -> f64 {
        let turned = p.along * self.cos + p.across * self.sin;
        if self.turn >= p.angle { p.length } else { turned }
    }

    /// Least that it can be.
    pub(crate) fn least(&self, p: &Parts) -> f64 {
        let turned = p.along * self.cos - p.across * self.sin;
        if self.turn >= PI - p.angle { -p.length } else { turned }
    }

    /// Most that moving adds to it, now or at any time before: who goes on passes what he came to, but
    /// what may have been the case stays so.
    pub(crate) fn most_moved(&self, drift: &Parts) -> f64 {
        self.most(drift).max(0.0) * self.secs + self.spread
    }

    /// Least that it adds, now or at any time before.
    pub(crate) fn least_moved(&self, drift: &Parts) -> f64 {
        self.least(drift).min(0.0) * self.secs - self.spread
    }
}

/// Lower bounds, in seconds from now.
pub(crate) struct Times {
    /// Until anything of a node matters.
    pub(crate) seen: f64,
    /// Until it is too coarse.
    pub(crate) coarse: f64,
    /// Until it is fine enough.
    pub(crate) fine: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Visit(u32),
    Page(u32, usize),
    Block(u32, BlockRef),
}

impl Step {
    fn node(&self) -> u32 {
        match *self {
            Step::Visit(node) | Step::Page(node, _) | Step::Block(node, _) => node,
        }
    }
}

/// Orders by time, the soonest as the greatest; then by node, so that plans do not depend on chance.
#[derive(PartialEq)]
struct Soon(Due<Step>);

impl Eq for Soon {}

impl PartialOrd for Soon {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Soon {
    fn cmp(&self, other: &Self) -> Ordering {
        let (a, b) = (&self.0, &other.0);
        b.secs.total_cmp(&a.secs).then(b.what.node().cmp(&a.what.node()))
    }
}

/// Finds the pace of an eye from where it was.
#[derive(Debug, Clone, Default)]
pub struct PaceTracker {
    /// Time, eye and directions of what was seen lately.
    seen: Vec<(f64, Camera)>,
}

/// Motions of so long ago still count.
const REMEMBERED_SECS: f64 = 1.0;
/// Velocities are taken over so long: single frames are timed badly.
const STEP_SECS: f64 = 0.1;
/// The eye may turn so much faster than it did.
const MARGIN: f64 = 1.5;
/// What a hand does when it begins: 20° a second.
const TURN_LEAST: f64 = PI / 9.0;
/// A statue's height in ten seconds.
const SPREAD_LEAST_HEIGHTS: f64 = 0.1;

impl PaceTracker {
    /// A camera at a time in seconds; `height` is that of the statue, in world units. Gives how the eye
    /// may go on: as it does, by as much otherwise as it did otherwise within the last second.
    pub fn note(&mut self, secs: f64, camera: &Camera, height: f64) -> Pace {
        self.seen.retain(|(t, _)| *t < secs && secs - t <= REMEMBERED_SECS);
        self.seen.push((secs, *camera));
        let mut turn = TURN_LEAST;
        // World space, the newest last.
        let mut velocities: Vec<DVec3> = Vec::new();
        for (i, (t, later)) in self.seen.iter().enumerate() {
            let earlier = self.seen[..i].iter().rev().find(|(s, _)| t - s >= STEP_SECS);
            let Some((s, earlier)) = earlier else { continue };
            velocities.push((later.eye - earlier.eye) / (t - s));
            let axes = later.axes().into_iter().zip(earlier.axes());
            let angle = axes.map(|(a, b)| a.angle_between(b)).fold(0.0, f64::max);
            turn = turn.max(MARGIN * angle / (t - s));
        }
        let velocity = velocities.last().copied().unwrap_or_default();
        let otherwise = velocities.iter().map(|v| v.distance(velocity)).fold(0.0, f64::max);
        let spread = (height * SPREAD_LEAST_HEIGHTS).max(otherwise).max(velocity.length() / 4.0);
        let [right, up, back] = camera.axes();
        let velocity = DVec3::new(velocity.dot(right), velocity.dot(up), velocity.dot(back));
        Pace { velocity, spread, turn }
    }
}

/// Finds how fast a light may move from where it was.
#[derive(Debug, Clone, Default)]
pub struct LightTracker {
    seen: Vec<(f64, Light)>,
}

impl LightTracker {
    /// A light at a time in seconds; `height` is that of the statue, in world units. Gives how fast it may
    /// go on, any way: half again as fast as within the last second, or as a hand begins that turns it round the
    /// statue. World units a second; of parallel light, radians a second.
    pub fn note(&mut self, secs: f64, light: &Light, height: f64) -> f64 {
        let is_parallel = matches!(light, Light::Directional(_));
        self.seen.retain(|(t, before)| {
            let same = matches!(before, Light::Directional(_)) == is_parallel;
            same && *t < secs && secs - t <= REMEMBERED_SECS
        });
        self.seen.push((secs, *light));
        let moved = |a: &Light, b: &Light| match (a, b) {
            (Light::Directional(a), Light::Directional(b)) => a.angle_between(*b),
            (Light::Point(a), Light::Point(b)) => a.distance(*b),
            _ => 0.0,
        };
        let mut speed = if is_parallel { TURN_LEAST } else { TURN_LEAST * height };
        for (i, (t, later)) in self.seen.iter().enumerate() {
            let earlier = self.seen[..i].iter().rev().find(|(s, _)| t - s >= STEP_SECS);
            let Some((s, earlier)) = earlier else { continue };
            speed = speed.max(MARGIN * moved(later, earlier) / (t - s));
        }
        speed
    }
}

#[cfg(test)]
mod tests;
