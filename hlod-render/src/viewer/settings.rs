//! What a viewer can set, apart from where they stand.

use glam::Vec3;

use super::light::{Raking, UPPER_LEFT};
use super::pace::FRAME_TARGET_MS;
use crate::camera::Camera;
use crate::framing::Framing;
use crate::lamp::Lamp;
use crate::scene::{BACKGROUND, Enhance, Material, Paint, Representation, Shadow, Shot};
use crate::session::Looks;

/// Looks and precision.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// τ at rest, in pixels of the screen.
    pub error_threshold_px: f64,
    /// What a frame may take while moving, in milliseconds: τ is raised to keep to it.
    pub frame_target_ms: f64,
    /// Which hierarchy.
    pub representation: Representation,
    /// What pixels are painted with.
    pub paint: Paint,
    /// Where light comes from.
    pub light: Lamp,
    /// Where that rakes a place of the surface.
    pub raking: Option<Raking>,
    /// What shadows are drawn.
    pub shadow: Shadow,
    /// Angle in degrees under which the light is seen, for soft ones.
    pub light_size_deg: f64,
    /// How surfaces look.
    pub material: Material,
    /// Contrast that follows relief.
    pub enhance: Enhance,
    /// Linear light of the background.
    pub background: [f32; 3],
    /// Whether the panel is shown.
    pub panel_open: bool,
    /// Where the line between two statues is: share of the picture's width.
    pub swipe: f64,
    /// Whether the help is shown.
    pub help_open: bool,
    /// Whether what was measured, cut and noted is drawn over the picture.
    pub marks_shown: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            error_threshold_px: 1.0,
            frame_target_ms: FRAME_TARGET_MS,
            representation: Representation::default(),
            paint: Paint::default(),
            light: Lamp::of_picture(UPPER_LEFT),
            raking: None,
            shadow: Shadow::None,
            light_size_deg: 3.0,
            material: Material::default(),
            enhance: Enhance::default(),
            background: BACKGROUND.to_array(),
            panel_open: true,
            swipe: 0.5,
            help_open: false,
            marks_shown: true,
        }
    }
}

impl Settings {
    /// What of them a session keeps.
    pub fn looks(&self) -> Looks {
        Looks {
            light_frame: self.light.frame,
            light_azimuth_deg: self.light.angles.azimuth_deg,
            light_elevation_deg: self.light.angles.elevation_deg,
            lamp_distance: self.light.distance,
            spot_deg: self.light.spot_deg,
            light_size_deg: self.light_size_deg,
            shadow: self.shadow.into(),
            paint: self.paint.into(),
            ambient: self.material.ambient,
            highlight: self.material.highlight,
            background: self.background,
            enhance: self.enhance.strength,
            enhance_radius_px: self.enhance.radius_px,
        }
    }

    /// Takes over what a session kept.
    pub fn set_looks(&mut self, looks: &Looks) {
        self.light = looks.lamp();
        self.raking = None;
        self.light_size_deg = looks.light_size_deg;
        self.shadow = looks.shadow.into();
        self.paint = looks.paint.into();
        self.material.ambient = looks.ambient;
        self.material.highlight = looks.highlight;
        self.background = looks.background;
        self.enhance = looks.enhancement();
    }

    /// The picture that `camera` takes of a statue, with τ multiplied by `tau_factor`.
    pub fn shot(&self, camera: Camera, framing: &Framing, tau_factor: f64) -> Shot {
        Shot {
            camera,
            light: self.light.light(&camera, framing),
            spot: self.light.spot(&camera, framing),
            material: self.material,
            enhance: self.enhance,
            background: Vec3::from_array(self.background),
            representation: self.representation,
            paint: self.paint,
            error_threshold_px: self.error_threshold_px * tau_factor,
            shadow: self.shadow,
            light_size: self.light.size(self.light_size_deg),
            // Shadows' edges are as fine as the surface.
            caster_threshold_px: self.error_threshold_px * tau_factor,
            intensity_step: crate::scene::INTENSITY_STEP,
            sample_offset_px: glam::DVec2::ZERO,
            draw_backs: false,
            backs_magenta: false,
            draw_skirts: true,
            mixing: crate::scene::Mixing::None,
            clip: crate::clip::ClipPlanes::default(),
        }
    }
}
