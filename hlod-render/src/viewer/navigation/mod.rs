//! How a viewer moves: a pure state machine, without a window.
//!
//! Gestures hold on to an *anchor*, a point of the surface under the cursor. Where it is not known
//! (the background, or a depth that is still on its way), the depth of what was looked at last
//! takes its place. Whatever happens, the statue stays within reach: distances have limits, the
//! view stays upright and [`Navigation::fit`] always returns.

mod pose;
#[cfg(test)]
mod tests;

use glam::{DVec2, DVec3};

pub use pose::Pose;

use crate::camera::{Camera, Projection};
use crate::framing::{FOV_Y_DEG, Framing, NAMED_VIEWS};
use crate::lens::Lens;
use crate::session::Viewpoint;

/// What a drag does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drag {
    /// Turns round the anchor.
    Orbit,
    /// Keeps the anchor under the cursor.
    Pan,
    /// Looks round from where the eye is.
    Look,
}

/// Which flying keys are down: 1, 0 or −1 along each direction of the view.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FlyInput {
    /// To the right, upwards, ahead.
    pub direction: DVec3,
    /// Four times as fast.
    pub fast: bool,
}

#[derive(Debug, Clone, Copy)]
struct Gesture {
    drag: Drag,
    cursor: DVec2,
    anchor: DVec3,
}

#[derive(Debug, Clone, Copy)]
struct Transition {
    from: Pose,
    to: Pose,
    /// 0 at the beginning, 1 at the end.
    share: f64,
}

/// Duration of the way to another view.
const TRANSITION_SECS: f64 = 0.25;
/// One notch of the wheel changes distances by this ratio.
const ZOOM_PER_STEP: f64 = 0.85;
/// Nearest distance in statue heights: beyond five times the nearest near plane.
const DISTANCE_MIN: f64 = 5e-4;
/// Furthest eye from the centre in diagonals of the bounds.
const REACH: f64 = 20.0;
/// Degrees that an arrow key turns.
const KEY_TURN_DEG: f64 = 5.0;

/// The view and how it is being moved.
#[derive(Debug, Clone)]
pub struct Navigation {
    framing: Framing,
    fov_y: f64,
    size: DVec2,
    pose: Pose,
    home: Pose,
    /// The view fits the statue to the picture, whatever the picture's size: nobody has moved.
    fits: bool,
    parallel: bool,
    flying: bool,
    fly: FlyInput,
    gesture: Option<Gesture>,
    transition: Option<Transition>,
}

impl Navigation {
    /// Begins at the three-quarter view. `size` is that of the picture in pixels.
    pub fn new(framing: Framing, size: DVec2) -> Navigation {
        let fov_y = FOV_Y_DEG.to_radians();
        let size = size.max(DVec2::ONE);
        let (_, direction) = NAMED_VIEWS[6];
        let first = framing.fitting(direction, size.x / size.y, FOV_Y_DEG);
        let pose = Pose::from_camera(&first, &framing);
        Navigation {
            framing,
            fov_y,
            size,
            pose,
            home: pose,
            fits: true,
            parallel: false,
            flying: false,
            fly: FlyInput::default(),
            gesture: None,
            transition: None,
        }
    }

    /// The picture's size has changed. A statue that just filled it still does.
    pub fn resize(&mut self, size: DVec2) {
        let size = size.max(DVec2::ONE);
        if size != self.size {
            self.size = size;
            self.keep_fitting();
        }
    }

    /// The camera of the next frame.
    pub fn camera(&self) -> Camera {
        let [_, up, back] = self.pose.axes(&self.framing);
        let target = self.pose.focus;
        if self.parallel {
            // The eye of a parallel view stands clear of the statue: depth reaches four times its
            // distance either way.
            let (min, max) = self.framing.bounds;
            let clear =
                self.pose.distance.max((max - min).length() + target.distance(self.framing.centre));
            let height = 2.0 * self.pose.distance * (self.fov_y / 2.0).tan();
            let projection = Projection::Orthographic { height };
            return Camera { eye: target + back * clear, target, up, projection, near: 0.0 };
        }
        let eye = self.pose.eye(&self.framing);
        let projection = Projection::Perspective { fov_y: self.fov_y };
        Camera { eye, target, up, projection, near: self.framing.near(eye) }
    }

    /// The camera and the size of its picture.
    pub fn lens(&self) -> Lens {
        Lens { camera: self.camera(), size: self.size }
    }

    /// Eye and target of the perspective view, also while rays are parallel.
    pub fn viewpoint(&self) -> (DVec3, DVec3) {
        (self.pose.eye(&self.framing), self.pose.focus)
    }

    /// What the statue's coordinates are relative to.
    pub fn framing(&self) -> &Framing {
        &self.framing
    }

    /// Vertical field of view in radians.
    pub fn fov_y(&self) -> f64 {
        self.fov_y
    }

    /// Whether rays are parallel.
    pub fn is_parallel(&self) -> bool {
        self.parallel
    }

    /// Whether keys fly.
    pub fn is_flying(&self) -> bool {
        self.flying
    }

    /// Whether the next frame differs although nothing is pressed or dragged anew.
    pub fn is_moving(&self) -> bool {
        self.transition.is_some() || (self.flying && self.fly.direction != DVec3::ZERO)
    }

    /// The drag that is under way.
    pub fn drag(&self) -> Option<Drag> {
        self.gesture.map(|g| g.drag)
    }

    /// Begins a drag at `cursor`, with the surface's point under it where that is known.
    pub fn begin(&mut self, drag: Drag, cursor: DVec2, anchor: Option<DVec3>) {
        self.moved_by_hand();
        let at_focus = match drag {
            Drag::Pan => self.lens().point_at(cursor, self.focus_depth()),
            _ => self.pose.focus,
        };
        self.gesture = Some(Gesture { drag, cursor, anchor: anchor.unwrap_or(at_focus) });
        if let Some(anchor) = anchor {
            self.look_at_depth_of(anchor);
        }
    }

    /// The point under the cursor has become known while dragging.
    pub fn set_anchor(&mut self, anchor: DVec3) {
        if let Some(gesture) = &mut self.gesture {
            gesture.anchor = anchor;
            self.look_at_depth_of(anchor);
        }
    }

    /// The cursor has moved.
    pub fn drag_to(&mut self, cursor: DVec2) {
        let Some(gesture) = &mut self.gesture else { return };
        let Gesture { drag, anchor, .. } = *gesture;
        let moved = cursor - std::mem::replace(&mut gesture.cursor, cursor);
        // Across the picture's smaller side is half a turn.
        let turn = moved * std::f64::consts::PI / self.size.min_element();
        match drag {
            Drag::Orbit => {
                self.pose = self.pose.turned_about(anchor, -turn.x, turn.y, &self.framing);
            }
            Drag::Look => {
                let eye = self.pose.eye(&self.framing);
                let turn = turn * 0.5;
                self.pose = self.pose.turned_about(eye, -turn.x, turn.y, &self.framing);
            }
            Drag::Pan => {
                let lens = self.lens();
                let depth = lens.depth_of(anchor).max(self.distance_min());
                self.pose.focus += anchor - lens.point_at(cursor, depth);
            }
        }
        self.keep_within_reach();
    }

    /// The button has been released.
    pub fn end(&mut self) {
        self.gesture = None;
    }

    /// Approaches the point under the cursor (positive) or recedes from it, by notches.
    pub fn zoom(&mut self, cursor: DVec2, anchor: Option<DVec3>, steps: f64) {
        self.moved_by_hand();
        if let Some(anchor) = anchor {
            self.look_at_depth_of(anchor);
        }
        let lens = self.lens();
        let anchor = anchor.unwrap_or_else(|| lens.point_at(cursor, self.focus_depth()));
        let distance = if self.parallel { self.pose.distance } else { lens.depth_of(anchor) };
        let distance = distance.max(self.distance_min());
        let factor = ZOOM_PER_STEP
            .powf(steps.clamp(-20.0, 20.0))
            .clamp(self.distance_min() / distance, (self.reach() / distance).max(1.0));
        self.pose.focus = anchor + (self.pose.focus - anchor) * factor;
        self.pose.distance *= factor;
        self.keep_within_reach();
    }

    /// Brings a point to the picture's middle, at the distance it has.
    pub fn centre(&mut self, point: DVec3) {
        self.look_at_depth_of(point);
        let to = Pose { focus: point, ..self.pose };
        self.go(to, false);
    }

    /// The statue stands otherwise than before, or is known to be of another size. The eye stays where it is; what is
    /// upright now is what the statue says.
    pub fn set_framing(&mut self, framing: Framing) {
        let (eye, target) = self.viewpoint();
        let has_turned = framing.axes != self.framing.axes;
        self.framing = framing;
        let aspect = self.size.x / self.size.y;
        let (_, direction) = NAMED_VIEWS[6];
        let first = framing.fitting(direction, aspect, self.fov_y.to_degrees());
        self.home = Pose::from_camera(&first, &framing);
        if has_turned {
            let camera = framing.camera(eye, target, self.fov_y.to_degrees());
            self.pose = Pose::from_camera(&camera, &framing);
            self.transition = None;
            self.gesture = None;
        }
        self.keep_fitting();
    }

    /// Stands where a session's viewpoint says, upright.
    pub fn go_to(&mut self, viewpoint: &Viewpoint) {
        let camera = viewpoint.camera(&self.framing);
        let mut pose = Pose::from_camera(&camera, &self.framing);
        self.flying = false;
        self.parallel = matches!(camera.projection, Projection::Orthographic { .. });
        match camera.projection {
            Projection::Perspective { fov_y } => self.fov_y = fov_y,
            Projection::Orthographic { height } => {
                pose.distance = height / (2.0 * (self.fov_y / 2.0).tan());
            }
        }
        self.go(pose, false);
    }

    /// Shows the whole statue from the same side.
    pub fn fit(&mut self) {
        self.flying = false;
        self.go(self.pose, true);
    }

    /// Goes back to the first view.
    pub fn home(&mut self) {
        self.flying = false;
        self.go(self.home, true);
    }

    /// Goes to the named view of this number in [`NAMED_VIEWS`].
    pub fn named_view(&mut self, number: usize) {
        let Some((_, direction)) = NAMED_VIEWS.get(number) else { return };
        self.flying = false;
        let aspect = self.size.x / self.size.y;
        let camera = self.framing.fitting(*direction, aspect, self.fov_y.to_degrees());
        let pose = Pose::from_camera(&camera, &self.framing);
        self.go(pose, true);
    }

    /// Turns by steps of arrow keys: to the right and upwards.
    pub fn turn(&mut self, right: f64, up: f64) {
        self.moved_by_hand();
        let step = KEY_TURN_DEG.to_radians();
        let focus = self.pose.focus;
        self.pose = self.pose.turned_about(focus, right * step, up * step, &self.framing);
    }

    /// Between perspective and parallel rays; what is looked at keeps its size.
    pub fn toggle_parallel(&mut self) {
        self.parallel = !self.parallel;
        self.flying = false;
        self.keep_fitting();
    }

    /// Between turning round the statue and flying.
    pub fn toggle_flying(&mut self) {
        self.flying = !self.flying;
        if self.parallel {
            self.toggle_parallel();
            self.flying = true;
        }
        self.fly = FlyInput::default();
        self.gesture = None;
    }

    /// Which flying keys are down.
    pub fn set_fly_input(&mut self, fly: FlyInput) {
        self.fly = fly;
    }

    /// The depth of the surface in the middle of the picture: while flying, speed follows it.
    pub fn surface_ahead(&mut self, depth: f64) {
        if self.flying && !self.parallel {
            let distance = depth.clamp(self.distance_min(), self.reach());
            self.pose = self.pose.with_distance(distance, &self.framing);
        }
    }

    /// Lets time pass: transitions and flying.
    pub fn advance(&mut self, secs: f64) {
        if let Some(transition) = &mut self.transition {
            transition.share = (transition.share + secs / TRANSITION_SECS).min(1.0);
            let Transition { from, to, share } = *transition;
            // Begins and ends gently.
            self.pose = from.towards(to, share * share * (3.0 - 2.0 * share));
            if share >= 1.0 {
                self.pose = to;
                self.transition = None;
            }
        }
        if self.flying && self.fly.direction != DVec3::ZERO {
            self.fits = false;
            let [right, up, back] = self.pose.axes(&self.framing);
            let d = self.fly.direction.normalize_or_zero();
            // The distance to what is ahead in a second, never more than a second's worth at once.
            let length = self.pose.distance * secs.min(1.0) * if self.fly.fast { 4.0 } else { 1.0 };
            self.pose.focus += (right * d.x + up * d.y - back * d.z) * length;
            self.keep_within_reach();
        }
    }

    /// Begins the way to a pose, brought to the distance at which the statue fits the picture.
    fn go(&mut self, to: Pose, fits: bool) {
        let to = if fits { self.fitted(to) } else { to };
        self.fits = fits;
        self.gesture = None;
        self.transition = Some(Transition { from: self.pose, to, share: 0.0 });
    }

    /// The same view, at the distance at which the whole statue is seen with a margin of 4 %.
    fn fitted(&self, pose: Pose) -> Pose {
        let [right, up, back] = pose.axes(&self.framing);
        let tangent = (self.fov_y / 2.0).tan();
        let distances = self.framing.corners.map(|corner| {
            let offset = corner - self.framing.centre;
            let across = offset.dot(right).abs() * self.size.y / self.size.x;
            // What is nearer looks larger, except by parallel rays.
            let nearer = if self.parallel { 0.0 } else { offset.dot(back) };
            across.max(offset.dot(up).abs()) / tangent * 1.04 + nearer
        });
        let distance = distances.into_iter().fold(self.distance_min(), f64::max);
        Pose { focus: self.framing.centre, distance, ..pose }
    }

    fn keep_fitting(&mut self) {
        if self.fits {
            let pose = self.transition.take().map_or(self.pose, |t| t.to);
            self.pose = self.fitted(pose);
        }
    }

    fn moved_by_hand(&mut self) {
        self.transition = None;
        self.fits = false;
    }

    /// Depth of the focus as the current lens counts it.
    fn focus_depth(&self) -> f64 {
        self.lens().depth_of(self.pose.focus)
    }

    /// What is looked at is as far as this point. Parallel views have no use for it: their
    /// distance is their scale.
    fn look_at_depth_of(&mut self, point: DVec3) {
        if !self.parallel {
            let depth = self.lens().depth_of(point);
            let depth = depth.clamp(self.distance_min(), self.reach());
            self.pose = self.pose.with_distance(depth, &self.framing);
        }
    }

    fn keep_within_reach(&mut self) {
        let distance = self.pose.distance.clamp(self.distance_min(), self.reach());
        self.pose = self.pose.with_distance(distance, &self.framing);
        let eye = self.pose.eye(&self.framing);
        let offset = eye - self.framing.centre;
        if offset.length() > self.reach() {
            let eye = self.framing.centre + offset.normalize() * self.reach();
            self.pose = self.pose.with_eye(eye, &self.framing);
        }
    }

    fn distance_min(&self) -> f64 {
        DISTANCE_MIN * self.framing.height
    }

    /// Largest distance of the eye from the centre.
    fn reach(&self) -> f64 {
        let (min, max) = self.framing.bounds;
        REACH * (max - min).length().max(self.framing.height)
    }
}
