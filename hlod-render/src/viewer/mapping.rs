//! Which button of the mouse does what, for people who come from other programs.

use serde::{Deserialize, Serialize};
use winit::event::MouseButton;
use winit::keyboard::ModifiersState;

use super::navigation::Drag;

/// What a drag with a button does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gesture {
    /// Turns or moves the viewer.
    Move(Drag),
    /// Approaches while the cursor goes up, recedes while it goes down.
    Zoom,
    /// Turns the light.
    Light,
}

/// A program's way of using the mouse. In each the wheel zooms, a double click centres, and
/// Ctrl + Shift + left drag turns the light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mapping {
    /// Left turns, right and middle move along.
    #[default]
    Usual,
    /// Left turns, with Ctrl it moves along, with Shift it zooms; middle moves along.
    Meshlab,
    /// Left turns, right moves along, middle zooms.
    Cloudcompare,
    /// Middle turns, with Shift it moves along, with Ctrl it zooms.
    Blender,
}

impl Mapping {
    /// All of them.
    pub const ALL: [Mapping; 4] =
        [Mapping::Usual, Mapping::Meshlab, Mapping::Cloudcompare, Mapping::Blender];

    /// As the panel shows it.
    pub fn name(self) -> &'static str {
        match self {
            Mapping::Usual => "usual",
            Mapping::Meshlab => "MeshLab",
            Mapping::Cloudcompare => "CloudCompare",
            Mapping::Blender => "Blender",
        }
    }

    /// What a drag does; while `flying`, the left button looks round.
    pub fn gesture(
        self,
        button: MouseButton,
        modifiers: ModifiersState,
        flying: bool,
    ) -> Option<Gesture> {
        use MouseButton::{Left, Middle, Right};
        let (control, shift) = (modifiers.control_key(), modifiers.shift_key());
        let (turn, along) = (Gesture::Move(Drag::Orbit), Gesture::Move(Drag::Pan));
        if button == Left && control && shift {
            return Some(Gesture::Light);
        }
        if button == Left && flying {
            return Some(Gesture::Move(Drag::Look));
        }
        match (self, button) {
            (Mapping::Usual, Left) => Some(if shift { along } else { turn }),
            (Mapping::Usual, Right | Middle) => Some(along),
            (Mapping::Meshlab, Left) if control => Some(along),
            (Mapping::Meshlab, Left) if shift => Some(Gesture::Zoom),
            (Mapping::Meshlab | Mapping::Cloudcompare, Left) => Some(turn),
            (Mapping::Meshlab, Middle) => Some(along),
            (Mapping::Cloudcompare, Middle) => Some(Gesture::Zoom),
            (Mapping::Meshlab | Mapping::Cloudcompare, Right) => Some(along),
            (Mapping::Blender, Middle) if shift => Some(along),
            (Mapping::Blender, Middle) if control => Some(Gesture::Zoom),
            (Mapping::Blender, Middle) => Some(turn),
            _ => None,
        }
    }

    /// The help's lines about dragging.
    pub fn help(self) -> &'static [(&'static str, &'static str)] {
        const TURN: &str = "turn round the point under the cursor";
        const ALONG: &str = "move the point under the cursor along";
        const ZOOM: &str = "approach (upwards) or recede";
        match self {
            Mapping::Usual => {
                &[("Left drag", TURN), ("Right or middle drag, Shift + left drag", ALONG)]
            }
            Mapping::Meshlab => &[
                ("Left drag", TURN),
                ("Ctrl + left drag, middle or right drag", ALONG),
                ("Shift + left drag", ZOOM),
            ],
            Mapping::Cloudcompare => {
                &[("Left drag", TURN), ("Right drag", ALONG), ("Middle drag", ZOOM)]
            }
            Mapping::Blender => &[
                ("Middle drag", TURN),
                ("Shift + middle drag", ALONG),
                ("Ctrl + middle drag", ZOOM),
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whoever chooses a program's way can turn, move along and zoom, and always reach the light.
    #[test]
    fn every_mapping_reaches_everything() {
        let modifiers = [
            ModifiersState::empty(),
            ModifiersState::SHIFT,
            ModifiersState::CONTROL,
            ModifiersState::CONTROL.union(ModifiersState::SHIFT),
        ];
        for mapping in Mapping::ALL {
            let mut reached = Vec::new();
            for button in [MouseButton::Left, MouseButton::Middle, MouseButton::Right] {
                reached.extend(modifiers.iter().filter_map(|m| mapping.gesture(button, *m, false)));
                assert!(mapping.gesture(button, modifiers[0], true) != Some(Gesture::Light));
            }
            for wanted in [Gesture::Move(Drag::Orbit), Gesture::Move(Drag::Pan), Gesture::Light] {
                assert!(reached.contains(&wanted), "{mapping:?} has no {wanted:?}");
            }
            // The help says of zooming what there is of it.
            let zooms = mapping.help().iter().any(|(_, does)| does.starts_with("approach"));
            assert_eq!(reached.contains(&Gesture::Zoom), zooms, "{mapping:?}");
        }
    }
}
