//! Where a picture is taken from, and in what light: what a bookmark keeps.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::camera::{Camera, Projection};
use crate::framing::Framing;
use crate::lamp::{Lamp, LightAngles};
use crate::scene::{BACKGROUND, Enhance, Material, Paint, Shadow, Shot};

/// Light and looks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Looks {
    /// What the light's angles are relative to.
    #[serde(default)]
    pub light_frame: LightFrame,
    /// Where light comes from: 0 from the front, positive from the right.
    pub light_azimuth_deg: f64,
    /// Positive from above.
    pub light_elevation_deg: f64,
    /// Of a lamp, how far it is from the middle of the picture, or of the statue where its angles are relative to that,
    /// in the source's unit; parallel light has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lamp_distance: Option<f64>,
    /// How wide the cone is in which a lamp shines, aimed at the same middle; without it, it shines everywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spot_deg: Option<f64>,
    /// Angle under which the light is seen, for soft shadows.
    pub light_size_deg: f64,
    /// What shadows are drawn.
    pub shadow: ShadowName,
    /// What pixels are painted with.
    pub paint: PaintName,
    /// Light from everywhere, 0 to 1.
    pub ambient: f32,
    /// Strength of the highlight, 0 to 1.
    pub highlight: f32,
    /// Linear light of the background.
    pub background: [f32; 3],
    /// Contrast that follows the relief of the surface, 0 to 1.
    #[serde(default, skip_serializing_if = "is_nothing")]
    pub enhance: f32,
    /// Within how many pixels, 1 to 32.
    #[serde(default = "usual_radius", skip_serializing_if = "is_usual_radius")]
    pub enhance_radius_px: f32,
}

fn is_nothing(strength: &f32) -> bool {
    *strength == 0.0
}

fn usual_radius() -> f32 {
    Enhance::default().radius_px
}

fn is_usual_radius(radius_px: &f32) -> bool {
    *radius_px == usual_radius()
}

/// What the angles of a light are relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LightFrame {
    /// The picture: its right, up, and the eye. The light turns with the viewer.
    #[default]
    Picture,
    /// The statue: its right, up and front. The light stays where it is.
    Object,
}

/// [`Shadow`] in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "they are those of Shadow")]
pub enum ShadowName {
    None,
    Hard,
    Soft,
    Traced,
}

/// [`Paint`] in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "they are those of Paint")]
pub enum PaintName {
    Shaded,
    Depth,
    Borders,
    Normals,
    Bound,
    Kinds,
    Edges,
    Curvature,
    /// The first of the numbers that the file keeps.
    #[serde(rename = "value-1")]
    Value1,
    #[serde(rename = "value-2")]
    Value2,
    #[serde(rename = "value-3")]
    Value3,
    #[serde(rename = "value-4")]
    Value4,
}

/// A bookmark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedView {
    /// Its name; no two views of a session have the same.
    pub name: String,
    /// From where.
    pub viewpoint: Viewpoint,
    /// In what light.
    pub looks: Looks,
}

/// Where a picture is taken from, in source coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Viewpoint {
    /// The eye.
    pub eye: [f64; 3],
    /// A point straight ahead, at the distance of what is looked at.
    pub target: [f64; 3],
    /// What is upwards in the picture.
    pub up: [f64; 3],
    /// Vertical field of view of a perspective.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fov_y_deg: Option<f64>,
    /// Height of the picture of parallel rays, in the source's unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parallel_height: Option<f64>,
}

impl Default for Looks {
    fn default() -> Self {
        let material = Material::default();
        Looks {
            light_frame: LightFrame::Picture,
            light_azimuth_deg: -45.0,
            light_elevation_deg: 45.0,
            lamp_distance: None,
            spot_deg: None,
            light_size_deg: 3.0,
            shadow: ShadowName::None,
            paint: PaintName::Shaded,
            ambient: material.ambient,
            highlight: material.highlight,
            background: BACKGROUND.to_array(),
            enhance: 0.0,
            enhance_radius_px: usual_radius(),
        }
    }
}

impl Looks {
    /// Contrast that follows relief.
    pub fn enhancement(&self) -> Enhance {
        Enhance { strength: self.enhance, radius_px: self.enhance_radius_px }
    }

    /// A picture with its camera as it is, in this light and with these looks.
    pub fn apply(&self, shot: Shot, framing: &Framing) -> Shot {
        let material =
            Material { ambient: self.ambient, highlight: self.highlight, ..shot.material };
        let lamp = self.lamp();
        Shot {
            light: lamp.light(&shot.camera, framing),
            spot: lamp.spot(&shot.camera, framing),
            light_size: lamp.size(self.light_size_deg),
            shadow: self.shadow.into(),
            paint: self.paint.into(),
            background: Vec3::from_array(self.background),
            material,
            enhance: self.enhancement(),
            ..shot
        }
    }

    /// The light, which a camera gives a place.
    pub fn lamp(&self) -> Lamp {
        Lamp {
            angles: LightAngles::new(self.light_azimuth_deg, self.light_elevation_deg),
            frame: self.light_frame,
            distance: self.lamp_distance,
            spot_deg: self.spot_deg,
        }
    }

    pub(super) fn validate(&self) -> Result<(), String> {
        let shares = [self.ambient, self.highlight, self.enhance];
        let known =
            [self.light_azimuth_deg, self.light_elevation_deg].iter().all(|v| v.is_finite())
                && (0.0..=180.0).contains(&self.light_size_deg)
                && self.lamp_distance.is_none_or(|d| d > 0.0 && d < 1e12)
                && self.spot_deg.is_none_or(|deg| (1.0..=180.0).contains(&deg))
                && (1.0..=Enhance::RADIUS_MAX_PX).contains(&self.enhance_radius_px)
                && shares.iter().chain(&self.background).all(|v| (0.0..=1.0).contains(v));
        if known { Ok(()) } else { Err("a value is not a number or out of its range".into()) }
    }
}

impl LightFrame {
    /// Unit vectors right, up and front.
    pub fn axes(self, camera: &Camera, framing: &Framing) -> [DVec3; 3] {
        match self {
            LightFrame::Picture => camera.axes(),
            LightFrame::Object => framing.axes,
        }
    }
}

impl Viewpoint {
    /// Of a camera.
    pub fn new(camera: &Camera) -> Viewpoint {
        let (fov_y_deg, parallel_height) = match camera.projection {
            Projection::Perspective { fov_y } => (Some(fov_y.to_degrees()), None),
            Projection::Orthographic { height } => (None, Some(height)),
        };
        Viewpoint {
            eye: camera.eye.to_array(),
            target: camera.target.to_array(),
            up: camera.axes()[1].to_array(),
            fov_y_deg,
            parallel_height,
        }
    }

    /// The camera, before a statue.
    pub fn camera(&self, framing: &Framing) -> Camera {
        let [eye, target, up] = [self.eye, self.target, self.up].map(DVec3::from_array);
        match self.parallel_height {
            Some(height) => {
                let projection = Projection::Orthographic { height };
                Camera { eye, target, up, projection, near: 0.0 }
            }
            None => {
                let fov_y = self.fov_y_deg.unwrap_or(crate::framing::FOV_Y_DEG).to_radians();
                let projection = Projection::Perspective { fov_y };
                Camera { eye, target, up, projection, near: framing.near(eye) }
            }
        }
    }

    pub(super) fn validate(&self) -> Result<(), String> {
        let vectors = [self.eye, self.target, self.up];
        if !vectors.iter().flatten().all(|v| v.is_finite() && v.abs() < 1e12) {
            return Err("a coordinate is not a number or too large".into());
        }
        let [eye, target, up] = vectors.map(DVec3::from_array);
        let ahead = (target - eye).try_normalize().ok_or("the eye is where it looks")?;
        if up.try_normalize().is_none_or(|up| up.cross(ahead).length() < 1e-6) {
            return Err("`up` must not be along the line of sight".into());
        }
        match (self.fov_y_deg, self.parallel_height) {
            (Some(fov), None) if (0.1..=170.0).contains(&fov) => Ok(()),
            (None, Some(height)) if height > 0.0 && height < 1e12 => Ok(()),
            _ => Err("one of `fov_y_deg` (0.1 to 170) and `parallel_height` must be there".into()),
        }
    }
}

impl From<Shadow> for ShadowName {
    fn from(shadow: Shadow) -> Self {
        match shadow {
            Shadow::None => ShadowName::None,
            // Maps are drawn for comparison alone; sessions keep what they stand for.
            Shadow::Hard | Shadow::Mapped(_) => ShadowName::Hard,
            Shadow::Soft => ShadowName::Soft,
            Shadow::Traced => ShadowName::Traced,
        }
    }
}

impl From<ShadowName> for Shadow {
    fn from(name: ShadowName) -> Self {
        match name {
            ShadowName::None => Shadow::None,
            ShadowName::Hard => Shadow::Hard,
            ShadowName::Soft => Shadow::Soft,
            ShadowName::Traced => Shadow::Traced,
        }
    }
}

impl From<Paint> for PaintName {
    fn from(paint: Paint) -> Self {
        match paint {
            Paint::Shaded => PaintName::Shaded,
            Paint::Depth => PaintName::Depth,
            Paint::Borders => PaintName::Borders,
            Paint::Normals => PaintName::Normals,
            Paint::Bound => PaintName::Bound,
            Paint::Kinds => PaintName::Kinds,
            Paint::Edges => PaintName::Edges,
            Paint::Curvature => PaintName::Curvature,
            Paint::Scalar(0) => PaintName::Value1,
            Paint::Scalar(1) => PaintName::Value2,
            Paint::Scalar(2) => PaintName::Value3,
            Paint::Scalar(_) => PaintName::Value4,
        }
    }
}

impl From<PaintName> for Paint {
    fn from(name: PaintName) -> Self {
        match name {
            PaintName::Shaded => Paint::Shaded,
            PaintName::Depth => Paint::Depth,
            PaintName::Borders => Paint::Borders,
            PaintName::Normals => Paint::Normals,
            PaintName::Bound => Paint::Bound,
            PaintName::Kinds => Paint::Kinds,
            PaintName::Edges => Paint::Edges,
            PaintName::Curvature => Paint::Curvature,
            PaintName::Value1 => Paint::Scalar(0),
            PaintName::Value2 => Paint::Scalar(1),
            PaintName::Value3 => Paint::Scalar(2),
            PaintName::Value4 => Paint::Scalar(3),
        }
    }
}
