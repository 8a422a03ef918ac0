//! What is lit how, and seen from where.

use glam::{DVec2, DVec3, Vec3};
use hlod_compress::{Header, Primitives, RepresentationKind, ScalarRange};

use crate::camera::Camera;
use crate::clip::ClipPlanes;
use crate::colour_map::{ColourMap, TURN_MAX_DEG, bounds_shown};
use crate::shadow_map::ShadowMap;
use crate::skeleton::Node;

/// Where light comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Light {
    /// Parallel light; the direction towards its source, world space.
    Directional(DVec3),
    /// A point in world space. Its strength does not fall off with distance.
    Point(DVec3),
}

/// A lamp that shines within a cone alone. Its shadows are those of a lamp that shines everywhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Where it is aimed at, from the lamp; of length 1, world space.
    pub towards: DVec3,
    /// How wide the cone is from side to side, in degrees; its last tenth falls off.
    pub angle_deg: f64,
}

impl Spot {
    /// What shaders know: the way back to the lamp, and the cosine at the cone's side; of no spot, less than any.
    pub(crate) fn uniform(spot: Option<Spot>) -> glam::Vec4 {
        let Some(spot) = spot else { return glam::Vec4::new(0.0, 0.0, 0.0, -2.0) };
        let cosine = (spot.angle_deg.clamp(0.1, 359.0) / 2.0).to_radians().cos();
        (-spot.towards).as_vec3().extend(cosine as f32)
    }
}

/// How surfaces look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Linear light; used where the model has no colours.
    pub albedo: Vec3,
    /// Strength of the highlight.
    pub highlight: f32,
    /// Share of the light that comes from everywhere.
    pub ambient: f32,
}

impl Default for Material {
    /// Light stone.
    fn default() -> Self {
        Material { albedo: Vec3::new(0.72, 0.69, 0.63), highlight: 0.06, ambient: 0.12 }
    }
}

/// Which hierarchy is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Representation {
    /// What the file holds for receivers.
    #[default]
    Hybrid,
    /// The same where the file was built without points.
    Triangles,
    /// The same where it was built of points.
    Points,
    /// Simplified by shape alone.
    Geometric,
    /// The scan's own geometry, whatever the distance: the reference.
    Full,
}

impl Representation {
    /// Which pages are drawn. `Full` differs by its threshold of 0, which asks for the leaves; the
    /// appearance hierarchy stands in while they are loading.
    pub fn kind(self) -> RepresentationKind {
        match self {
            Representation::Geometric => RepresentationKind::Geometric,
            _ => RepresentationKind::Appearance,
        }
    }

    /// Whether a file holds it: which primitives its levels are of is decided when it is built.
    ///
    /// # Errors
    /// A sentence that says what the file holds, and how to build one that holds this.
    pub fn check(self, header: &Header) -> Result<(), String> {
        let built = match header.points_input {
            0 => header.primitives,
            _ => Primitives::Points,
        };
        let fits = match self {
            Representation::Triangles => built == Primitives::Triangles,
            Representation::Points => built == Primitives::Points,
            Representation::Geometric => header.points_input == 0,
            Representation::Hybrid | Representation::Full => true,
        };
        if fits {
            return Ok(());
        }
        let advice = match header.points_input {
            0 => format!("; build it again with --representation {}", self.name()),
            _ => ": it was made from a point cloud".to_owned(),
        };
        Err(format!(
            "--representation {}: the file's levels are {}{advice}",
            self.name(),
            built.name()
        ))
    }

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Representation::Hybrid => "hybrid",
            Representation::Triangles => "triangles",
            Representation::Points => "points",
            Representation::Geometric => "geometric",
            Representation::Full => "full",
        }
    }
}

/// What pixels are painted with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Paint {
    /// The surface in its light.
    #[default]
    Shaded,
    /// A colour for each level of detail.
    Depth,
    /// Lines where nodes end, and the skirts that close the seams between them.
    Borders,
    /// The direction of the surface as a colour, in the frame of the model: x, y and z of -1 to 1 are red, green
    /// and blue of 0 to 255.
    Normals,
    /// How far what is drawn may be from the scan, by the proof of its node: see
    /// [`bound_colour`](crate::colour_map::bound_colour).
    Bound,
    /// The scan's own triangles or points grey, triangles of coarser levels blue, their points orange.
    Kinds,
    /// The edges of every triangle that is drawn.
    Edges,
    /// How the surface bends within [`Enhance::radius_px`]: hollows blue, bulges orange, see
    /// [`bend_colour`](crate::colour_map::bend_colour).
    Curvature,
    /// A colour for each number that was kept with the scan: the file's first one, or another. Files without it
    /// are shaded.
    Scalar(u8),
}

impl Paint {
    /// All that every file has.
    pub const ALL: [Paint; 8] = [
        Paint::Shaded,
        Paint::Depth,
        Paint::Borders,
        Paint::Normals,
        Paint::Bound,
        Paint::Kinds,
        Paint::Edges,
        Paint::Curvature,
    ];

    /// Of a name on the command line: one of [`Paint::ALL`], or of the numbers that the file keeps, which
    /// can be told apart by `value:` before them.
    ///
    /// # Errors
    /// What was expected.
    pub fn of_name(name: &str, header: &Header) -> Result<Paint, String> {
        let scalars: Vec<&str> = header.scalars().map(|(name, _)| name).collect();
        let of_value = name.strip_prefix("value:");
        let usual = Paint::ALL.into_iter().find(|p| p.name() == name && of_value.is_none());
        let wanted = of_value.unwrap_or(name);
        let kept = || scalars.iter().position(|scalar| *scalar == wanted);
        usual.or_else(|| kept().map(|k| Paint::Scalar(k as u8))).ok_or_else(|| {
            let usual = Paint::ALL.iter().map(|p| p.name());
            let all: Vec<&str> = usual.chain(scalars.iter().copied()).collect();
            format!("--paint {name}: this file has {}", all.join(", "))
        })
    }

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Paint::Shaded => "shaded",
            Paint::Depth => "depth",
            Paint::Borders => "borders",
            Paint::Normals => "normals",
            Paint::Bound => "bound",
            Paint::Kinds => "kinds",
            Paint::Edges => "edges",
            Paint::Curvature => "curvature",
            Paint::Scalar(_) => "value",
        }
    }
}

/// Contrast that follows the relief of the surface, so that worn inscriptions can be read: what bulges is brighter,
/// what is hollow darker, in whatever light. As the surface is seen, so that relief of any size shows from the distance
/// from which it is a few pixels wide (after Vergne et al., *Radiance Scaling*, I3D 2010; theirs scales what is
/// reflected about a mean, which leaves a hollow in full light as it is; ours multiplies the odds of light, which stays
/// between none and all of it).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Enhance {
    /// 0 for none, up to 1.
    pub strength: f32,
    /// Within how many pixels of the picture bends are looked for, 1 to [`Enhance::RADIUS_MAX_PX`].
    pub radius_px: f32,
}

impl Enhance {
    /// The largest radius: more would be of shapes that light shows better.
    pub const RADIUS_MAX_PX: f32 = 32.0;
}

impl Default for Enhance {
    /// None.
    fn default() -> Self {
        Enhance { strength: 0.0, radius_px: 4.0 }
    }
}

/// A number that was kept with the scan, and what its colours stand for.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Painted {
    /// Its name in the scan, without what would break lines.
    pub name: String,
    /// What it is in; empty where nobody said.
    pub unit: String,
    /// The least and the largest value; `None` where no vertex has any.
    pub bounds: Option<[f64; 2]>,
    /// What grey stands for; empty where nothing is grey.
    pub grey: &'static str,
    /// Which colours stand for them.
    pub map: ColourMap,
}

impl Painted {
    /// What [`Paint::Bound`] shows of a file.
    pub fn bound(header: &Header) -> Painted {
        Painted {
            name: "bound, equal steps for equal ratios".to_owned(),
            unit: header.unit.name().to_owned(),
            bounds: Some(bounds_shown(header)),
            grey: "the scan itself",
            map: ColourMap::Viridis,
        }
    }

    /// What [`Paint::Curvature`] shows within so many pixels.
    pub fn curvature(radius_px: f32) -> Painted {
        let most = 2.0 * TURN_MAX_DEG;
        Painted {
            name: format!("turn within {} px, bulges above 0", 2.0 * radius_px),
            unit: "°".to_owned(),
            bounds: Some([-most, most]),
            grey: "",
            map: ColourMap::Bend,
        }
    }

    /// Those of a file, in order.
    pub fn all(header: &Header) -> Vec<Painted> {
        let printable = |text: &str| -> String {
            text.chars().map(|c| if c.is_control() { '?' } else { c }).collect()
        };
        let painted = |(name, range): (&str, &ScalarRange)| Painted {
            name: printable(name),
            unit: printable(&range.unit),
            bounds: range.value(1.min(range.codes)).zip(range.value(range.codes)).map(|b| b.into()),
            grey: "no value",
            map: ColourMap::Viridis,
        };
        header.scalars().map(painted).collect()
    }

    /// Name and unit.
    pub fn title(&self) -> String {
        match self.unit.as_str() {
            "" => self.name.clone(),
            unit => format!("{}, {unit}", self.name),
        }
    }

    /// The least and the largest value, to four digits of what lies between them.
    pub fn ends(&self) -> [String; 2] {
        let Some([low, high]) = self.bounds else { return ["–".into(), "–".into()] };
        let span = (high - low).max(f64::MIN_POSITIVE);
        let digits = (3 - span.log10().floor() as i32).clamp(0, 12) as usize;
        [low, high].map(|value| {
            let text = format!("{value:.digits$}");
            match text.contains('.') {
                true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
                false => text,
            }
        })
    }
}

/// What shadows are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shadow {
    /// None: light goes through everything.
    #[default]
    None,
    /// Of a light without extent, from the casters' front.
    Hard,
    /// Of a light that is a disc, [`Shot::light_size`] wide; of size 0 they are the hard ones.
    Soft,
    /// Hard ones with a map, as other programs draw them: for comparison.
    Mapped(ShadowMap),
    /// The same from the scan's own triangles, by rays: slow, and what the others are compared with.
    Traced,
}

impl Shadow {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Shadow::None => "none",
            Shadow::Hard => "hard",
            Shadow::Soft => "soft",
            Shadow::Mapped(_) => "map",
            Shadow::Traced => "traced",
        }
    }

    /// Whether levels of detail cast it, not the scan's own triangles.
    pub(crate) fn is_cast(self) -> bool {
        matches!(self, Shadow::Hard | Shadow::Soft | Shadow::Mapped(_))
    }
}

/// τ_c unless said otherwise: how many pixels casters may move a shadow's edge. With τ_r = 0.5 edges are
/// wrong by at most (τ_c + τ_r sin θ) ÷ cos θ pixels at an angle of incidence of θ: 0.65 at 15°, 1.87
/// at 60°; measured, 0.28 and 0.56 at most (99.9 %, `bench-paths/NOTES.md`).
pub const CASTER_THRESHOLD_PX: f64 = 0.5;

/// γ unless said otherwise.
pub const INTENSITY_STEP: f64 = 1.0 / 64.0;

/// τ and τ_c with which that is below a pixel up to 60°: 0.93.
pub const EXACT_THRESHOLDS_PX: (f64, f64) = (0.25, 0.25);

/// How a front is made to differ from what the view asks for, so that audits see seams of all kinds. Which nodes are
/// concerned follows from their cells and the seed alone.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Mixing {
    /// Not at all.
    #[default]
    None,
    /// Half of the nodes that are fine enough are divided all the same, and so are half of what comes of that: neighbours
    /// differ by any number of depths.
    Finer {
        /// Which ones.
        seed: u64,
    },
    /// One node in eight counts as not loaded, so that ancestors stand for it and for what is beside it, as in a cache that
    /// fills.
    HalfLoaded {
        /// Which ones.
        seed: u64,
    },
}

impl Mixing {
    /// One of so many nodes is lacking. It takes its brothers with it: what lacks one of its children is drawn itself.
    const LACKING: u64 = 8;

    /// Whether a node that is fine enough is divided.
    pub(crate) fn divides(self, node: &Node) -> bool {
        matches!(self, Mixing::Finer { seed } if chance(seed, node) & 1 == 0)
    }

    /// Whether a node counts as not loaded; the root always is.
    pub(crate) fn lacks(self, node: &Node) -> bool {
        matches!(self, Mixing::HalfLoaded { seed } if node.depth > 0 && chance(seed, node).is_multiple_of(Mixing::LACKING))
    }
}

/// A number by chance for each cell (SplitMix64; Steele, Lea & Flood 2014).
fn chance(seed: u64, node: &Node) -> u64 {
    let middle = (node.cell_box[0] + node.cell_box[1]).to_array();
    let places = middle.into_iter().map(f64::to_bits).chain([u64::from(node.depth), seed]);
    places.fold(seed, |state, place| {
        let mut z = (state ^ place).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    })
}

/// Everything one picture depends on besides the models.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// From where.
    pub camera: Camera,
    /// Light.
    pub light: Light,
    /// Where a lamp shines within a cone alone.
    pub spot: Option<Spot>,
    /// Looks.
    pub material: Material,
    /// Contrast that follows relief.
    pub enhance: Enhance,
    /// Linear light of the background.
    pub background: Vec3,
    /// Which hierarchy.
    pub representation: Representation,
    /// What pixels are painted with.
    pub paint: Paint,
    /// τ in pixels.
    pub error_threshold_px: f64,
    /// What shadows are drawn.
    pub shadow: Shadow,
    /// Diameter of the light where shadows are soft or traced: of a point in world units, of parallel
    /// light the angle in degrees under which it is seen.
    pub light_size: f64,
    /// τ_c in pixels: see [`crate::casters`].
    pub caster_threshold_px: f64,
    /// γ: how much of a light that is a disc may be hidden or not, in the penumbra, by what casters are wrong by.
    pub intensity_step: f64,
    /// Where in each pixel its sample is, from the middle to the right and downwards; in pixels.
    pub sample_offset_px: DVec2,
    /// Draws backs even where they can never be seen, so that cracks show (audits).
    pub draw_backs: bool,
    /// Paints backs magenta, and draws them everywhere.
    pub backs_magenta: bool,
    /// Draws what closes seams between nodes; audits also look at pictures without.
    pub draw_skirts: bool,
    /// How the front differs from what the view asks for (audits).
    pub mixing: Mixing,
    /// Planes that cut the statue open. Shadows cannot be drawn then: see [`crate::clip::check_clip`].
    pub clip: ClipPlanes,
}

impl Shot {
    /// Radius of the light as shadows have it: of parallel light the tangent of its angle; 0 where
    /// shadows are hard.
    pub fn light_radius(&self) -> f64 {
        match self.shadow {
            Shadow::None | Shadow::Hard | Shadow::Mapped(_) => 0.0,
            Shadow::Soft | Shadow::Traced => light_radius(self.light, self.light_size),
        }
    }

    /// Whether shading looks at how the surface bends: then each pixel depends on those round it, see
    /// [`Shot::reach_px`].
    pub(crate) fn sees_relief(&self) -> bool {
        self.paint == Paint::Curvature
            || (self.paint == Paint::Shaded && self.enhance.strength > 0.0)
    }

    /// How far pixels are that one depends on.
    pub fn reach_px(&self) -> u32 {
        match self.sees_relief() {
            true => self.enhance.radius_px.ceil() as u32 + 1,
            false => 0,
        }
    }

    /// The same of a statue that is cut open; without shadows, which are not drawn then.
    pub fn cut_open(&self, clip: ClipPlanes) -> Shot {
        let shadow = if clip.is_none() { self.shadow } else { Shadow::None };
        Shot { clip, shadow, ..*self }
    }

    /// The same with levels that are so many times as coarse.
    pub(crate) fn coarser(&self, factor: f64) -> Shot {
        Shot {
            error_threshold_px: self.error_threshold_px * factor,
            caster_threshold_px: self.caster_threshold_px * factor,
            ..*self
        }
    }

    /// For a picture of n × n samples a pixel: the pixels decide what is fine enough.
    pub fn finer(&self, n: u32) -> Shot {
        let n = f64::from(n);
        Shot {
            error_threshold_px: self.error_threshold_px * n,
            caster_threshold_px: self.caster_threshold_px * n,
            enhance: Enhance { radius_px: self.enhance.radius_px * n as f32, ..self.enhance },
            ..*self
        }
    }
}

/// Radius of a light of some size, which is a diameter in world units or an angle in degrees: of parallel
/// light the tangent of half that angle.
pub fn light_radius(light: Light, size: f64) -> f64 {
    match light {
        Light::Point(_) => size / 2.0,
        Light::Directional(_) => (size.min(170.0) / 2.0).to_radians().tan(),
    }
}

/// Parallel light by its azimuth and elevation in degrees relative to a picture: 0, 0 comes from
/// the eye, positive from the right and from above.
pub fn light_from_angles(camera: &Camera, azimuth_deg: f64, elevation_deg: f64) -> Light {
    Light::Directional(direction_from_angles(camera.axes(), azimuth_deg, elevation_deg))
}

/// The unit vector at an azimuth and an elevation in degrees, of unit vectors right, up and front:
/// 0, 0 is front, positive is to the right and upwards.
pub fn direction_from_angles(axes: [DVec3; 3], azimuth_deg: f64, elevation_deg: f64) -> DVec3 {
    let [right, up, front] = axes;
    let (sin_a, cos_a) = azimuth_deg.to_radians().sin_cos();
    let (sin_e, cos_e) = elevation_deg.to_radians().sin_cos();
    right * (sin_a * cos_e) + up * sin_e + front * (cos_a * cos_e)
}

/// Azimuth and elevation in degrees of a unit vector: the inverse of [`direction_from_angles`].
pub fn angles_from_direction(axes: [DVec3; 3], direction: DVec3) -> (f64, f64) {
    let [right, up, front] = axes.map(|axis| axis.dot(direction));
    (right.atan2(front).to_degrees(), up.clamp(-1.0, 1.0).asin().to_degrees())
}

/// Linear light of the usual background: a neutral dark grey.
pub const BACKGROUND: Vec3 = Vec3::splat(0.045);
