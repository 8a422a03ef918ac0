//! What can be done, and by which key: one table for the keyboard and for the help.

use crate::measure::MeasurementKind;
use crate::session::NoteShape;
use crate::viewer::work::tool::Task;
use winit::event::KeyEvent;
use winit::keyboard::{Key, KeyCode, ModifiersState, NamedKey, PhysicalKey};

/// Something that a key or a button of the panel does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// Shows the whole statue from the same side.
    Fit,
    /// Goes back to the first view.
    Home,
    /// One of [`crate::framing::NAMED_VIEWS`].
    NamedView(usize),
    /// Perspective or parallel rays.
    ToggleParallel,
    /// Turning or flying.
    ToggleFlying,
    /// Begins recording a path, or ends and saves it.
    ToggleRecording,
    /// One of [`super::light::PRESETS`].
    LightPreset(usize),
    /// Hard shadows or none.
    ToggleShadows,
    /// Turns by steps to the right and upwards.
    Turn(i8, i8),
    /// Approaches (positive) or recedes.
    Zoom(i8),
    /// Shows or hides the panel.
    TogglePanel,
    /// Shows or hides the help.
    ToggleHelp,
    /// Leaves what was entered last: help, a tool, flying.
    Leave,
    /// Light that rakes the surface under the cursor, or in the middle.
    Rake,
    /// Turns a raking light by steps.
    SweepLight(i8),
    /// Takes a tool in hand, or puts it away.
    Tool(Task),
    /// Ends what the tool makes of several points.
    FinishTool,
    /// Takes back the last point picked.
    TakeBack,
    /// Picks what is in the middle of the picture.
    PickMiddle,
    /// Bookmarks the view.
    SaveView,
    /// Takes the last step back.
    Undo,
    /// Does it again.
    Redo,
    /// Takes the first problem off the list.
    DismissProblem,
    /// Chooses another file.
    Open,
    /// Closes the window.
    Quit,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Pressed {
    /// The character that the layout gives, lower case.
    Character(&'static str),
    Named(NamedKey),
    /// A place on the keyboard, whatever the layout.
    Place(KeyCode),
}

/// A key and what it does.
#[derive(Debug, Clone, Copy)]
struct Binding {
    pressed: Pressed,
    control: bool,
    /// Only looked at together with Ctrl: without it Shift gives other characters.
    shift: bool,
    action: Action,
}

const fn plain(pressed: Pressed, action: Action) -> Binding {
    Binding { pressed, control: false, shift: false, action }
}

const fn character(character: &'static str, action: Action) -> Binding {
    plain(Pressed::Character(character), action)
}

const fn named(key: NamedKey, action: Action) -> Binding {
    plain(Pressed::Named(key), action)
}

const fn control(character: &'static str, shift: bool, action: Action) -> Binding {
    Binding { pressed: Pressed::Character(character), control: true, shift, action }
}

const BINDINGS: [Binding; 51] = [
    character("f", Action::Fit),
    named(NamedKey::Home, Action::Home),
    plain(Pressed::Place(KeyCode::Digit1), Action::NamedView(0)),
    plain(Pressed::Place(KeyCode::Digit2), Action::NamedView(1)),
    plain(Pressed::Place(KeyCode::Digit3), Action::NamedView(2)),
    plain(Pressed::Place(KeyCode::Digit4), Action::NamedView(3)),
    plain(Pressed::Place(KeyCode::Digit5), Action::NamedView(4)),
    plain(Pressed::Place(KeyCode::Digit6), Action::NamedView(5)),
    plain(Pressed::Place(KeyCode::Digit0), Action::NamedView(6)),
    plain(Pressed::Place(KeyCode::Numpad1), Action::NamedView(0)),
    plain(Pressed::Place(KeyCode::Numpad2), Action::NamedView(1)),
    plain(Pressed::Place(KeyCode::Numpad3), Action::NamedView(2)),
    plain(Pressed::Place(KeyCode::Numpad4), Action::NamedView(3)),
    plain(Pressed::Place(KeyCode::Numpad5), Action::NamedView(4)),
    plain(Pressed::Place(KeyCode::Numpad6), Action::NamedView(5)),
    plain(Pressed::Place(KeyCode::Numpad0), Action::NamedView(6)),
    character("p", Action::ToggleParallel),
    character("v", Action::ToggleFlying),
    character("r", Action::ToggleRecording),
    character("l", Action::LightPreset(0)),
    character("h", Action::ToggleShadows),
    named(NamedKey::ArrowRight, Action::Turn(1, 0)),
    named(NamedKey::ArrowLeft, Action::Turn(-1, 0)),
    named(NamedKey::ArrowUp, Action::Turn(0, 1)),
    named(NamedKey::ArrowDown, Action::Turn(0, -1)),
    character("+", Action::Zoom(1)),
    // The same key without Shift on many layouts.
    character("=", Action::Zoom(1)),
    character("-", Action::Zoom(-1)),
    character("n", Action::TogglePanel),
    named(NamedKey::F1, Action::ToggleHelp),
    character("?", Action::ToggleHelp),
    named(NamedKey::Escape, Action::Leave),
    character("i", Action::Rake),
    character(",", Action::SweepLight(1)),
    character(".", Action::SweepLight(-1)),
    control("o", false, Action::Open),
    control("q", false, Action::Quit),
    control("z", false, Action::Undo),
    control("z", true, Action::Redo),
    control("y", false, Action::Redo),
    character("b", Action::SaveView),
    character("m", Action::Tool(Task::Measure(MeasurementKind::Distance))),
    character("o", Action::Tool(Task::Measure(MeasurementKind::Polyline))),
    character("g", Action::Tool(Task::Measure(MeasurementKind::Angle))),
    character("u", Action::Tool(Task::Measure(MeasurementKind::SurfaceLength))),
    character("k", Action::Tool(Task::Measure(MeasurementKind::SurfaceArea))),
    character("j", Action::Tool(Task::Note(NoteShape::Point))),
    character("x", Action::Tool(Task::Section)),
    named(NamedKey::Enter, Action::FinishTool),
    named(NamedKey::Backspace, Action::TakeBack),
    named(NamedKey::Space, Action::PickMiddle),
];

/// What a key does when it is pressed.
pub fn action_of(event: &KeyEvent, modifiers: ModifiersState) -> Option<Action> {
    let action = find(&event.logical_key, event.physical_key, modifiers)?;
    // Held down, only what goes in steps repeats.
    let steps = matches!(action, Action::Turn(..) | Action::Zoom(_) | Action::SweepLight(_));
    (!event.repeat || steps).then_some(action)
}

fn find(key: &Key, place: PhysicalKey, modifiers: ModifiersState) -> Option<Action> {
    let is_pressed = |pressed: &Pressed| match pressed {
        Pressed::Character(wanted) => {
            matches!(key, Key::Character(given) if given.to_lowercase() == *wanted)
        }
        Pressed::Named(wanted) => matches!(key, Key::Named(given) if given == wanted),
        Pressed::Place(wanted) => place == PhysicalKey::Code(*wanted),
    };
    BINDINGS
        .iter()
        .find(|b| {
            b.control == modifiers.control_key()
                && (!b.control || b.shift == modifiers.shift_key())
                && is_pressed(&b.pressed)
        })
        .map(|b| b.action)
}

/// Every key and gesture but drags, which [`super::mapping::Mapping::help`] has, and what it does, in the help's
/// order.
pub const HELP: [(&str, &str); 32] = [
    ("Wheel, pinch, + and −", "approach the point under the cursor, recede"),
    ("Double click", "bring a point to the middle"),
    ("Ctrl + Shift + left drag", "turn the light"),
    ("L", "light from the upper left at 45°"),
    ("I, then comma and full stop", "light raking the surface under the cursor, round it"),
    ("H", "shadows or none"),
    ("F", "the whole statue, from the same side"),
    ("Home", "the first view"),
    ("1, 2, 3, 4", "front, back, left, right"),
    ("5, 6", "top, bottom"),
    ("0", "three-quarter view"),
    ("Arrows", "turn by 5°"),
    ("P", "perspective or parallel rays"),
    ("V", "fly, or stop flying"),
    ("   W, A, S, D", "   ahead, left, back, right"),
    ("   Q, E", "   down, up"),
    ("   Shift", "   four times as fast"),
    ("   Left drag", "   look round"),
    ("R", "record a camera path; again: save it"),
    ("B", "save this view"),
    ("M, O, G", "measure a distance, a polyline, an angle"),
    ("U, K", "measure along the surface, an area of it"),
    ("J, X", "write a note, cut through three points"),
    ("   Click, Space", "   pick a point, the one in the middle"),
    ("   Enter, double click", "   end a line"),
    ("   Backspace, Esc", "   take a point back, leave"),
    ("Ctrl + Z, Ctrl + Y", "undo, redo"),
    ("N", "show or hide the panel"),
    ("F1, ?", "show or hide this help"),
    ("Ctrl + O", "open another statue, or build a scan"),
    ("One finger, two", "turn, move along and zoom; tap to pick"),
    ("Ctrl + Q", "close the window"),
];

#[cfg(test)]
mod tests {
    use winit::keyboard::NativeKeyCode;

    use super::*;

    #[test]
    fn no_key_does_two_things() {
        for (i, a) in BINDINGS.iter().enumerate() {
            let same = |b: &&Binding| {
                b.pressed == a.pressed && b.control == a.control && b.shift == a.shift
            };
            assert!(!BINDINGS[..i].iter().any(|b| same(&b)), "{a:?}");
        }
    }

    #[test]
    fn letters_count_by_layout_digits_by_place_and_control_separately() {
        let nowhere = PhysicalKey::Unidentified(NativeKeyCode::Unidentified);
        let letter = |c: &str| Key::Character(c.into());
        let none = ModifiersState::empty();
        assert_eq!(find(&letter("F"), nowhere, none), Some(Action::Fit));
        assert_eq!(find(&letter("?"), nowhere, ModifiersState::SHIFT), Some(Action::ToggleHelp));
        assert_eq!(find(&letter("q"), nowhere, none), None);
        assert_eq!(find(&letter("q"), nowhere, ModifiersState::CONTROL), Some(Action::Quit));
        let both = ModifiersState::CONTROL.union(ModifiersState::SHIFT);
        assert_eq!(find(&letter("z"), nowhere, ModifiersState::CONTROL), Some(Action::Undo));
        assert_eq!(find(&letter("Z"), nowhere, both), Some(Action::Redo));
        let digit = PhysicalKey::Code(KeyCode::Digit5);
        assert_eq!(find(&letter("("), digit, none), Some(Action::NamedView(4)));
        assert_eq!(find(&Key::Named(NamedKey::F1), nowhere, none), Some(Action::ToggleHelp));
    }
}
