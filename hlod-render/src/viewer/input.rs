//! From the window's events to what the stage does.

use std::collections::HashSet;
use std::time::{Duration, Instant};

use glam::{DVec2, DVec3};
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::{KeyCode, ModifiersState, PhysicalKey};

use super::bindings::{Action, action_of};
use super::mapping::{Gesture, Mapping};
use super::navigation::{Drag, FlyInput};
use super::stage::Stage;
use super::touch::{Asked, Touches};

/// Two presses within this time are a double click …
const DOUBLE_CLICK: Duration = Duration::from_millis(400);
/// … if the cursor moved less than this, in pixels.
const DOUBLE_CLICK_PX: f64 = 6.0;
/// The line between two statues is taken this near to it, in pixels.
const SWIPE_PX: f64 = 7.0;
/// A press and a release no farther apart than this are a click, in pixels.
const CLICK_PX: f64 = 4.0;
/// Pixels that a touchpad scrolls for one notch of a wheel.
const SCROLL_PX: f64 = 50.0;
/// Pixels that a cursor goes for one notch of a wheel, where a drag zooms.
const ZOOM_DRAG_PX: f64 = 16.0;
/// Notches that a pinch to twice the size is worth.
const PINCH_STEPS: f64 = 4.3;

/// What is held down, and where the cursor is.
#[derive(Debug, Default)]
pub struct Input {
    /// Relative to the statue's picture, in pixels.
    cursor: DVec2,
    /// Upper left corner of the statue's picture in the window, in pixels.
    pub origin: DVec2,
    modifiers: ModifiersState,
    held: Option<MouseButton>,
    /// Which button does what.
    pub mapping: Mapping,
    turning_light: bool,
    /// A drag zooms to where it began.
    zooming: Option<DVec2>,
    touches: Touches,
    /// The line between two statues is being dragged.
    swiping: bool,
    last_press: Option<(Instant, DVec2)>,
    /// The left button went down here and the cursor has stayed: what may become a click.
    click: Option<DVec2>,
    fly_keys: HashSet<KeyCode>,
}

impl Input {
    /// Nothing is held down.
    pub fn new(mapping: Mapping) -> Input {
        Input { mapping, ..Input::default() }
    }

    /// Handles an event that the panel left. Returns whether the picture may have changed.
    pub fn on_event(&mut self, event: &WindowEvent, stage: &mut Stage, now: Instant) -> bool {
        match event {
            WindowEvent::ModifiersChanged(modifiers) => {
                self.modifiers = modifiers.state();
                self.fly(stage)
            }
            WindowEvent::CursorMoved { position, .. } => {
                self.moved(DVec2::new(position.x, position.y) - self.origin, stage, now)
            }
            WindowEvent::MouseInput { state: ElementState::Pressed, button, .. } => {
                self.pressed(*button, stage, now)
            }
            WindowEvent::MouseInput { state: ElementState::Released, button, .. } => {
                let clicked = self.held == Some(*button)
                    && *button == MouseButton::Left
                    && self.click.take().is_some_and(|place| stage.pick(place));
                if self.held == Some(*button) {
                    self.release(stage);
                }
                clicked
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let steps = match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(*y),
                    MouseScrollDelta::PixelDelta(offset) => offset.y / SCROLL_PX,
                };
                stage.zoom(self.cursor, steps, now);
                true
            }
            WindowEvent::PinchGesture { delta, .. } => {
                stage.zoom(self.cursor, delta * PINCH_STEPS, now);
                true
            }
            WindowEvent::Touch(touch) => {
                let place = DVec2::new(touch.location.x, touch.location.y) - self.origin;
                let Some(asked) = self.touches.take(touch, place) else { return false };
                self.touched(asked, stage, now);
                true
            }
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => {
                self.key(event, stage, now)
            }
            WindowEvent::Focused(false) => {
                self.release(stage);
                self.fly_keys.clear();
                self.fly(stage)
            }
            _ => false,
        }
    }

    /// Whether a drag is under way: it keeps the cursor, even over the panel.
    pub fn is_dragging(&self) -> bool {
        self.held.is_some()
    }

    fn moved(&mut self, cursor: DVec2, stage: &mut Stage, now: Instant) -> bool {
        let moved = cursor - std::mem::replace(&mut self.cursor, cursor);
        if self.held.is_none() || moved == DVec2::ZERO {
            return false;
        }
        if self.click.is_some_and(|place| place.distance(cursor) > CLICK_PX) {
            self.click = None;
        }
        if self.swiping {
            let width = stage.navigation.lens().size.x;
            stage.settings.swipe = (cursor.x / width).clamp(0.0, 1.0);
        } else if let Some(at) = self.zooming {
            stage.zoom(at, -moved.y / ZOOM_DRAG_PX, now);
        } else if self.turning_light {
            let share = moved / stage.navigation.lens().size.min_element();
            stage.drag_light(share.x, share.y, now);
        } else {
            stage.drag_to(cursor, now);
        }
        true
    }

    fn touched(&mut self, asked: Asked, stage: &mut Stage, now: Instant) {
        match asked {
            Asked::Turn(at) => stage.begin_drag(Drag::Orbit, at, now),
            Asked::Hold(at) => stage.begin_drag(Drag::Pan, at, now),
            Asked::Go(at, ratio) => {
                stage.drag_to(at, now);
                if ratio != 1.0 {
                    stage.zoom(at, ratio.log2() * PINCH_STEPS, now);
                    // The point between the fingers is another one now.
                    stage.begin_drag(Drag::Pan, at, now);
                }
            }
            Asked::Tap(at) => {
                self.cursor = at;
                if self.is_double(now) {
                    stage.centre(at, now);
                } else {
                    stage.pick(at);
                }
            }
            Asked::End => stage.end_drag(),
        }
    }

    fn pressed(&mut self, button: MouseButton, stage: &mut Stage, now: Instant) -> bool {
        // A second button does not disturb a drag.
        if self.held.is_some() {
            return false;
        }
        let flying = stage.navigation.is_flying();
        let left = button == MouseButton::Left;
        let on_line = |line: f64| (line - self.cursor.x).abs() < SWIPE_PX;
        if left && stage.swipe_px().is_some_and(on_line) {
            (self.swiping, self.held) = (true, Some(button));
            return true;
        }
        if left && self.is_double(now) {
            match stage.work.tool {
                Some(_) => stage.work.finish_tool(),
                None => stage.centre(self.cursor, now),
            }
            return true;
        }
        let Some(gesture) = self.mapping.gesture(button, self.modifiers, flying) else {
            // A click picks, whether or not a drag would do something.
            self.click = left.then_some(self.cursor);
            self.held = left.then_some(button);
            return left;
        };
        match gesture {
            Gesture::Move(drag) => stage.begin_drag(drag, self.cursor, now),
            Gesture::Zoom => self.zooming = Some(self.cursor),
            Gesture::Light => self.turning_light = true,
        }
        let plain = left && !self.modifiers.control_key() && !self.modifiers.shift_key();
        self.click = plain.then_some(self.cursor);
        self.held = Some(button);
        true
    }

    /// Notes a press of the left button; true where it makes a double click.
    fn is_double(&mut self, now: Instant) -> bool {
        let double = self.last_press.is_some_and(|(when, place)| {
            now.saturating_duration_since(when) < DOUBLE_CLICK
                && place.distance(self.cursor) < DOUBLE_CLICK_PX
        });
        self.last_press = (!double).then_some((now, self.cursor));
        double
    }

    fn release(&mut self, stage: &mut Stage) {
        self.held = None;
        self.turning_light = false;
        self.zooming = None;
        self.swiping = false;
        stage.end_drag();
    }

    fn key(&mut self, event: &KeyEvent, stage: &mut Stage, now: Instant) -> bool {
        let pressed = event.state == ElementState::Pressed;
        if let PhysicalKey::Code(code) = event.physical_key
            && FLY_KEYS.iter().any(|(key, _)| *key == code)
        {
            let changed =
                if pressed { self.fly_keys.insert(code) } else { self.fly_keys.remove(&code) };
            if changed && self.fly(stage) {
                return true;
            }
        }
        if !pressed {
            return false;
        }
        let Some(action) = action_of(event, self.modifiers) else { return false };
        match action {
            // Where the cursor is, not in the middle as from the panel.
            Action::Rake => stage.rake(self.cursor),
            _ => stage.act(action, now),
        }
        true
    }

    /// Tells the stage which way the keys fly. Returns whether it flies.
    fn fly(&self, stage: &mut Stage) -> bool {
        let held = FLY_KEYS.iter().filter(|(key, _)| self.fly_keys.contains(key));
        let direction = held.map(|(_, direction)| *direction).sum();
        let fast = self.modifiers.shift_key();
        // With Ctrl, letters are commands.
        let direction = if self.modifiers.control_key() { DVec3::ZERO } else { direction };
        stage.navigation.set_fly_input(FlyInput { direction, fast });
        stage.navigation.is_flying() && direction != DVec3::ZERO
    }
}

/// Places on the keyboard, whatever the layout: right, up, ahead.
const FLY_KEYS: [(KeyCode, DVec3); 6] = [
    (KeyCode::KeyW, DVec3::Z),
    (KeyCode::KeyS, DVec3::NEG_Z),
    (KeyCode::KeyD, DVec3::X),
    (KeyCode::KeyA, DVec3::NEG_X),
    (KeyCode::KeyE, DVec3::Y),
    (KeyCode::KeyQ, DVec3::NEG_Y),
];
