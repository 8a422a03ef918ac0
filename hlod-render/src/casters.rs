//! The casters' front: which nodes cast shadows on what is seen, and how fine they must be (Guthe et
//! al. 2004, section 6.1, made conservative).
//!
//! Round each visible node, as far as it is in the picture, lies a box along the world's axes. What hides
//! none of it from the light lies outside all that is between the box and the light, which is tested exactly:
//! on the way to the light a box shrinks to a point (to parallel light it only moves), and casters' boxes are
//! met somewhere on it or nowhere. That is the same wherever a light is, in the box or far from it. A caster
//! that is wrong by ε moves its shadow's edge by at most ε · (distance from the light to the receiver) ÷
//! (distance from the light to the caster), so it may be wrong by
//!
//! ```text
//! ε_c = a · d_l,min ÷ D_max        parallel light: ε_c = a
//! ```
//!
//! with a the length that τ_c pixels show at the nearest point of the visible node, d_l,min the least
//! distance from the light to the caster's box, D_max the largest to a corner of the visible node's. A light
//! of diameter s blurs what is far from what it falls on, and where nothing may be lit otherwise than
//! by γ, another γ · s · d_p ÷ (d_l,max + d_p) is allowed, with d_p the least distance from the caster's
//! box to the other (of parallel light, s its angle in radians, γ · s · d_p). The
//! paper has the receivers' *stored* error in place of a, which would ask for leaves wherever leaves
//! are seen.
//!
//! All of this only becomes more where boxes are larger, nearer to the eye, and the light's place is known
//! less well. So the same functions say what may cast within some time, whatever eye and light do
//! meanwhile ([`ahead`]): a frame is the case of no time.
//!
//! The paper has one box for all visible nodes of a depth. Near a large statue the leaves' box reaches from the eye to
//! the end of the picture, and all that hides any of it from the light is asked for as finely as before the
//! eye. With one for each node, those of a part of the octree are passed over together where nothing of it is
//! met ([`Cluster`]).

pub mod ahead;

use std::collections::BTreeMap;

use glam::{DMat4, DVec2, DVec3};
use hlod_compress::{CellKey, RepresentationKind};

use crate::camera::{Camera, Projection};
use crate::need::{Parts, Reach};
use crate::ring::Ring;
use crate::scene::{Light, Representation, Shot};
use crate::select::{Front, Measure, corners, find_front};
use crate::skeleton::{Node, Skeleton};

/// A light, and how exactly it casts shadows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Casting {
    /// Where it is.
    pub light: Light,
    /// As [`Shot::light_radius`] has it.
    pub light_radius: f64,
    /// τ_c; 0 asks for the leaves.
    pub threshold_px: f64,
    /// γ.
    pub intensity_step: f64,
}

impl Casting {
    /// Of casters that are so many times coarser.
    pub(crate) fn coarser(&self, factor: f64) -> Casting {
        Casting { threshold_px: self.threshold_px * factor, ..*self }
    }

    /// Of a picture.
    pub fn of_shot(shot: &Shot) -> Casting {
        let full = shot.representation == Representation::Full;
        Casting {
            light: shot.light,
            light_radius: shot.light_radius(),
            threshold_px: if full { 0.0 } else { shot.caster_threshold_px },
            intensity_step: shot.intensity_step,
        }
    }
}

/// How eye and light can have moved.
#[derive(Debug, Clone, Copy)]
struct Motion {
    /// Where the eye can have got to.
    eye: Reach,
    /// How it goes on: view space, world units a second.
    velocity: DVec3,
    /// How far the light can be from where it is; of parallel light, of its unit direction.
    light: f64,
}

impl Motion {
    const NONE: Motion = Motion { eye: Reach::HERE, velocity: DVec3::ZERO, light: 0.0 };
}

/// A visible node, which shadows may fall on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Receiver {
    cluster: CellKey,
    corners: [DVec3; 8],
}

/// How many levels above its nodes a cluster's cell lies.
const CLUSTER_LEVELS: usize = 2;

impl Receiver {
    /// A node of a model that is placed so.
    pub fn of(node: &Node, world_from_model: &DMat4) -> Receiver {
        let above = std::iter::successors(Some(node.cell), |cell| cell.parent());
        let cluster = above.take(CLUSTER_LEVELS + 1).last().unwrap_or(node.cell);
        let place = |p| world_from_model.transform_point3(p);
        Receiver { cluster, corners: corners(node.min, node.max).map(place) }
    }

    /// Corners of its box, world space.
    pub fn corners(&self) -> &[DVec3; 8] {
        &self.corners
    }
}

/// Where a visible node is.
#[derive(Debug, Clone)]
struct Place {
    /// World space, lowest and highest corner.
    bounds: [DVec3; 2],
    /// Depth of the nearest corner, at least and at most.
    nearest: [f64; 2],
    /// Depth of the farthest corner at most.
    farthest: f64,
}

/// Which parts of one model may cast on what is seen.
#[derive(Debug, Clone)]
pub struct CasterView {
    world_from_model: DMat4,
    scale: f64,
    casting: Casting,
    /// See [`Motion::light`].
    light_moved: f64,
    /// Where any part of the light may be, lowest and highest corner; of parallel light, of what leads
    /// to it.
    source: [DVec3; 2],
    clusters: Vec<Cluster>,
    /// Pixels that a unit of length shows at the nearest point of all.
    pixels_most: f64,
    /// Nothing else is relevant than what may cast on these, too, or lies within this length (world units) of what may:
    /// those of a part of the picture.
    near: Option<(Vec<Cluster>, f64)>,
    /// And what is beside that.
    ring: Ring,
}

/// Visible nodes below one cell: what hides nothing of their box from the light hides none of them.
#[derive(Debug, Clone)]
struct Cluster {
    /// World space, lowest and highest corner of what of them is in the picture.
    bounds: [DVec3; 2],
    frusta: Vec<Frustum>,
}

/// What may hide one visible node from the light.
#[derive(Debug, Clone)]
struct Frustum {
    /// World space, lowest and highest corner of what of the node is in the picture.
    bounds: [DVec3; 2],
    /// Pixels that a unit of length shows at the node's nearest point, at least and at most.
    pixels: [f64; 2],
    /// Largest distance from the light to the box, at least and at most; parallel light: 1.
    reach: [f64; 2],
}

impl CasterView {
    /// For the nodes drawn of any model.
    pub fn new(
        casting: &Casting,
        camera: &Camera,
        size: (u32, u32),
        receivers: &[Receiver],
        world_from_model: DMat4,
    ) -> CasterView {
        CasterView::within(Motion::NONE, casting, camera, size, receivers, world_from_model)
    }

    /// For all views that motion can have led to from this one, with any of these receivers.
    fn within(
        motion: Motion,
        casting: &Casting,
        camera: &Camera,
        (width, height): (u32, u32),
        receivers: &[Receiver],
        world_from_model: DMat4,
    ) -> CasterView {
        let lens = MovedLens::new(camera, f64::from(width) / f64::from(height), motion);
        let light = casting.light;
        let frustum = |receiver: &Receiver| {
            let place = lens.place(&receiver.corners);
            let [low, high] = lens.in_picture(&place)?;
            let pixels = |depth: f64| {
                let depth = if lens.perspective { depth.max(camera.near) } else { 1.0 };
                f64::from(height) / (2.0 * lens.half.y * depth)
            };
            let reach = match light {
                Light::Directional(_) => [1.0, 1.0],
                Light::Point(light) => {
                    let [near, far] = distances(light, &[low, high]);
                    [(near - motion.light).max(0.0), far + motion.light]
                }
            };
            let [nearest, not_farther] = place.nearest;
            let pixels = [pixels(not_farther), pixels(nearest)];
            Some(Frustum { bounds: [low, high], pixels, reach })
        };
        let mut clusters: BTreeMap<CellKey, Cluster> = BTreeMap::new();
        let mut pixels_most = 0.0f64;
        for receiver in receivers {
            if let Some(frustum) = frustum(receiver) {
                pixels_most = pixels_most.max(frustum.pixels[1]);
                clusters.entry(receiver.cluster).or_insert(Cluster::EMPTY).add(frustum);
            }
        }
        let middle = match light {
            Light::Directional(towards) => towards.normalize_or(DVec3::Y),
            Light::Point(light) => light,
        };
        // No ray to any part of the light is farther than its radius from one to the middle.
        let around = DVec3::splat(casting.light_radius + motion.light);
        CasterView {
            world_from_model,
            scale: world_from_model.x_axis.truncate().length(),
            casting: *casting,
            light_moved: motion.light,
            source: [middle - around, middle + around],
            clusters: clusters.into_values().collect(),
            pixels_most,
            near: None,
            ring: Ring::default(),
        }
    }

    /// The same, but leaves out what cannot cast on what the other view is of, even by strips that reach so far (model
    /// units) out of their nodes.
    pub(crate) fn near(self, part: CasterView, reach: f64) -> CasterView {
        CasterView { near: Some((part.clusters, reach * self.scale)), ..self }
    }

    /// The same, but has also what is in the ring.
    pub(crate) fn with_ring(self, ring: Ring) -> CasterView {
        CasterView { ring, ..self }
    }

    /// A node's box in world space; models are not turned, so that it is no larger than needed.
    fn box_of(&self, node: &Node) -> [DVec3; 2] {
        let corners =
            corners(node.min, node.max).map(|p| self.world_from_model.transform_point3(p));
        corners.iter().fold([corners[0]; 2], |[low, high], p| [low.min(*p), high.max(*p)])
    }

    /// Frusta that may hold a node, given by its box.
    fn holding<'a>(
        &self,
        clusters: &'a [Cluster],
        node: [DVec3; 2],
    ) -> impl Iterator<Item = &'a Frustum> {
        let (source, light) = (self.source, self.casting.light);
        let is_parallel = matches!(light, Light::Directional(_));
        let meets = move |bounds| meets_on_the_way(bounds, &source, is_parallel, &node);
        let met = clusters.iter().filter(move |cluster| meets(&cluster.bounds));
        met.flat_map(|cluster| &cluster.frusta).filter(move |frustum| meets(&frustum.bounds))
    }

    /// Pixels by which a shadow's edge moves for a length (model units) within a node, at least and at
    /// most; 0 where nothing of it casts.
    fn shift_px(&self, error: f64, node: &Node) -> [f64; 2] {
        if error == 0.0 {
            return [0.0; 2];
        }
        let Casting { light, light_radius, threshold_px, intensity_step } = self.casting;
        let bounds = self.box_of(node);
        let [low, high] = bounds;
        let (nearest, farthest) = match light {
            Light::Directional(_) => ([1.0; 2], [0.0; 2]),
            Light::Point(light) => {
                let [near, far] = distances(light, &bounds);
                let moved = |d: f64| [(d - self.light_moved).max(0.0), d + self.light_moved];
                (moved(near), moved(far))
            }
        };
        let blur = |apart: f64, farthest: f64| {
            let width = 2.0 * light_radius * apart / STEEPEST;
            match light {
                Light::Directional(_) => width,
                Light::Point(_) if apart > 0.0 => width / (farthest + apart),
                Light::Point(_) => 0.0,
            }
        };
        // In pixels of shift, as if there were no blur: τ_c is what remains.
        let shift = |allowed: f64| match threshold_px > 0.0 {
            true => threshold_px * error * self.scale / allowed,
            false => f64::INFINITY,
        };
        let of_receiver = |f: &Frustum| {
            let [from, to] = f.bounds;
            let apart = (from - high).max(low - to).max(DVec3::ZERO).length();
            let least = threshold_px * nearest[0] / (f.pixels[1] * f.reach[1])
                + intensity_step * blur(apart, farthest[1]);
            let apart_most = (high - from).abs().max((to - low).abs()).length();
            let most = match f.pixels[0] * f.reach[0] {
                0.0 => f64::INFINITY,
                pixels => {
                    threshold_px * nearest[1] / pixels
                        + intensity_step * blur(apart_most, farthest[0])
                }
            };
            [shift(most), shift(least)]
        };
        let relevant = self.holding(&self.clusters, bounds);
        let any = relevant.map(of_receiver).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        any.unwrap_or([0.0; 2])
    }
}

/// A step of light times the width of a penumbra is how far an outline may move if light falls off evenly across it, as Guthe
/// et al. (2004) take it. The covered part of a disc changes by the outline's length in it times how far that moves: for a
/// straight edge through the middle 4/π times as much as evenly, for convex outlines, whose length is at most the disc's own,
/// 4 times.
const STEEPEST: f64 = 4.0;

/// The least and the largest distance from a point to a box.
fn distances(point: DVec3, [low, high]: &[DVec3; 2]) -> [f64; 2] {
    let farthest = (point - *low).abs().max((*high - point).abs());
    [point.distance(point.clamp(*low, *high)), farthest.length()]
}

/// Whether a box meets another one on that one's way to the light, on which it shrinks to the light's own
/// box, or moves along any of its directions. After a share s of the way each of its sides is at
/// `(1 − s) · side + s · light`, or at `side + s · direction`: each side of the other box bounds s, and the
/// boxes meet where something is left of it.
fn meets_on_the_way(
    receivers: &[DVec3; 2],
    source: &[DVec3; 2],
    is_parallel: bool,
    other: &[DVec3; 2],
) -> bool {
    let (mut first, mut last) = (0.0f64, if is_parallel { f64::INFINITY } else { 1.0 });
    for axis in 0..3 {
        // Forwards for the lower side, backwards for the upper one: at + s · speed ≤ end.
        for (side, sign) in [(0, 1.0), (1, -1.0)] {
            let (at, end) = (sign * receivers[side][axis], sign * other[1 - side][axis]);
            let towards = sign * source[side][axis];
            let speed = if is_parallel { towards } else { towards - at };
            // What rounding may do to either.
            let room = end - at + 1e-12 * (end.abs() + at.abs() + speed.abs());
            if speed > 0.0 {
                last = last.min(room / speed);
            } else if speed < 0.0 {
                first = first.max(room / speed);
            } else if room < 0.0 {
                return false;
            }
        }
    }
    first <= last
}

impl Cluster {
    const EMPTY: Cluster =
        Cluster { bounds: [DVec3::INFINITY, DVec3::NEG_INFINITY], frusta: Vec::new() };

    fn add(&mut self, frustum: Frustum) {
        let ([low, high], [from, to]) = (&mut self.bounds, frustum.bounds);
        (*low, *high) = (low.min(from), high.max(to));
        self.frusta.push(frustum);
    }
}

/// A camera that may have moved.
struct MovedLens {
    eye: DVec3,
    /// Right, up and backwards.
    axes: [DVec3; 3],
    half: DVec2,
    perspective: bool,
    near: f64,
    motion: Motion,
    /// How going on brings things towards the eye's plane.
    drift: Parts,
}

impl MovedLens {
    fn new(camera: &Camera, aspect: f64, motion: Motion) -> MovedLens {
        MovedLens {
            eye: camera.eye,
            axes: camera.axes(),
            half: camera.half_extent(aspect),
            perspective: matches!(camera.projection, Projection::Perspective { .. }),
            near: camera.near,
            motion,
            drift: Parts::of(-motion.velocity, DVec3::NEG_Z),
        }
    }

    /// The least and the largest depth that a point in world space may have.
    fn depths(&self, point: DVec3) -> [f64; 2] {
        let away = point - self.eye;
        let reach = &self.motion.eye;
        if reach.is_here() {
            return [-away.dot(self.axes[2]); 2];
        }
        let parts =
            Parts::of(DVec3::from_array(self.axes.map(|axis| away.dot(axis))), DVec3::NEG_Z);
        [
            reach.least(&parts) + reach.least_moved(&self.drift),
            reach.most(&parts) + reach.most_moved(&self.drift),
        ]
    }

    fn place(&self, corners: &[DVec3; 8]) -> Place {
        let depths = corners.map(|p| self.depths(p));
        let [low, high] = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        Place {
            bounds: [
                corners.iter().fold(low, |a, p| a.min(*p)),
                corners.iter().fold(high, |a, p| a.max(*p)),
            ],
            nearest: [0, 1].map(|i| depths.iter().fold(f64::INFINITY, |all, d| all.min(d[i]))),
            farthest: depths.iter().fold(f64::NEG_INFINITY, |all, d| all.max(d[1])),
        }
    }

    /// The box, world space, of what of a node is in the picture; `None` where nothing is.
    fn in_picture(&self, place: &Place) -> Option<[DVec3; 2]> {
        let (mut nearest, farthest) = (place.nearest[0], place.farthest);
        if self.perspective {
            nearest = nearest.max(self.near);
            if farthest < nearest {
                return None;
            }
        }
        // What is seen between two depths is the hull of eight points, and stays it however it turns.
        let hull: [DVec3; 8] = std::array::from_fn(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let depth = if i >> 2 & 1 == 1 { farthest } else { nearest };
            let sides = self.half * if self.perspective { depth } else { 1.0 };
            DVec3::new(sign(0) * sides.x, sign(1) * sides.y, -depth)
        });
        let reach = &self.motion.eye;
        let Motion { velocity, .. } = self.motion;
        let [mut low, mut high] = place.bounds;
        for axis in 0..3 {
            let direction = DVec3::from_array(self.axes.map(|a| a[axis]));
            let parts = hull.map(|p| Parts::of(p, direction));
            let least = parts.iter().map(|p| reach.least(p)).fold(f64::INFINITY, f64::min);
            let most = parts.iter().map(|p| reach.most(p)).fold(f64::NEG_INFINITY, f64::max);
            let gone = velocity.dot(direction) * reach.secs;
            let eye = self.eye[axis];
            let rounding = 1e-12 * (eye.abs() + least.abs() + most.abs());
            let spread = reach.spread + rounding;
            low[axis] = low[axis].max(eye + least + gone.min(0.0) - spread);
            high[axis] = high[axis].min(eye + most + gone.max(0.0) + spread);
        }
        low.cmple(high).all().then_some([low, high])
    }
}

impl Measure for CasterView {
    fn kind(&self) -> RepresentationKind {
        RepresentationKind::Geometric
    }

    fn is_relevant(&self, node: &Node) -> bool {
        let bounds = self.box_of(node);
        let may_hold = |clusters: &[Cluster], reach: f64| {
            let wider = [bounds[0] - reach, bounds[1] + reach];
            self.holding(clusters, wider).next().is_some()
        };
        let is_near = |(clusters, reach): &(Vec<Cluster>, f64)| may_hold(clusters, *reach);
        may_hold(&self.clusters, 0.0)
            && (self.near.as_ref().is_none_or(is_near) || self.ring.has(node.cell))
    }

    /// Pixels by which a shadow's edge moves at most.
    fn error_px(&self, error: f64, node: &Node) -> f64 {
        self.shift_px(error, node)[1]
    }

    fn threshold_px(&self) -> f64 {
        self.casting.threshold_px
    }

    fn area_px(&self, node: &Node) -> f64 {
        ((node.max - node.min).length() / 2.0 * self.scale * self.pixels_most).powi(2)
    }
}

/// Finds what of one model casts on what is seen.
pub fn select_casters(
    skeleton: &Skeleton,
    view: &CasterView,
    is_resident: &dyn Fn(u32, usize) -> bool,
) -> Front {
    find_front(skeleton, view, is_resident)
}

#[cfg(test)]
pub(crate) mod tests;
