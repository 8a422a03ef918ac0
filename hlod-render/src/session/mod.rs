//! A session: what someone saw, measured, cut and noted on one statue, in a file that people and
//! programs can read.
//!
//! JSON, UTF-8, version [`VERSION`]. Positions and lengths are in source coordinates and the
//! source's unit, so that a session serves every file built from the same scan; angles are in
//! degrees. Unknown keys are refused by name rather than lost when the file is written again.
//! The types below, with what is said of them, are the format's documentation.

pub mod annotations;
mod history;
mod object_frame;
mod store;
#[cfg(test)]
mod tests;
mod view;

use std::sync::Arc;

use glam::DVec3;
use hlod_compress::{Header, Metadata, Unit};
use serde::{Deserialize, Serialize};

pub use history::History;
pub use object_frame::{Corrected, ObjectFrame, ScaleCorrection};
pub use store::{Saver, SessionFile, free_beside, load, place_of, save, user_folder};
pub use view::{LightFrame, Looks, PaintName, SavedView, ShadowName, Viewpoint};

use crate::clip::{ClipPlanes, PLANES_MAX};
use crate::figure::scale::millimetres;
use crate::framing::Framing;
use crate::measure::{Measurement, SurfacePoint};
use crate::section::Plane;

/// Version of the format.
pub const VERSION: u32 = 1;
/// More of anything is taken for damage.
pub const COUNT_MAX: usize = 1_000_000;
/// Planes that cut the statue at the same time.
pub const SECTIONS_MAX: usize = PLANES_MAX;
/// Longer texts are taken for damage.
const TEXT_BYTES_MAX: usize = 1 << 20;

/// Everything that is kept of the work on one statue. Lists are shared, so that a copy, as undoing
/// needs one a step, costs next to nothing.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Session {
    /// [`VERSION`].
    pub version: u32,
    /// The statue.
    pub model: ModelIdentity,
    /// How well the scanner measured, where someone declared it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scanner: Option<ScannerUncertainty>,
    /// How the statue stands, where that is not as the file says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<ObjectFrame>,
    /// How long its lengths are, where someone knows better than the scan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<ScaleCorrection>,
    /// How the statue is lit and drawn.
    pub looks: Looks,
    /// Bookmarks.
    #[serde(default)]
    pub views: Arc<Vec<SavedView>>,
    /// What was measured.
    #[serde(default)]
    pub measurements: Arc<Vec<Measurement>>,
    /// Planes that cut the statue.
    #[serde(default)]
    pub sections: Arc<Vec<SectionPlane>>,
    /// What was written about places.
    #[serde(default)]
    pub notes: Arc<Vec<Note>>,
}

/// What a session was made with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelIdentity {
    /// Name of the `.hlod` file, without its folder.
    pub file: String,
    /// Unit of all coordinates; `unknown` where nobody declared one.
    pub unit: String,
    /// The scan's files; their hashes decide whether a session fits.
    pub sources: Vec<SourceIdentity>,
}

/// One file of a scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceIdentity {
    /// Its name, without its folder.
    pub name: String,
    /// Its length.
    pub bytes: u64,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
}

/// An expanded uncertainty after the *Guide to the expression of uncertainty in measurement* (JCGM
/// 100:2008, section 6), as someone declared it: it is shown beside results and never added to them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScannerUncertainty {
    /// U of a length, in the source's unit.
    pub expanded: f64,
    /// The coverage factor.
    pub k: f64,
    /// Who says so: a calibration certificate, a data sheet.
    pub source: String,
}

impl ScannerUncertainty {
    /// What a file's metadata declare, in the unit of its lengths; none where that is unknown, because a
    /// number that might be of another unit is worse than none.
    pub fn of_file(metadata: &Metadata, unit: Unit) -> Option<ScannerUncertainty> {
        let accuracy = metadata.accuracy()?;
        let expanded = match accuracy.unit == unit {
            true => accuracy.value,
            false => accuracy.value * millimetres(accuracy.unit)? / millimetres(unit)?,
        };
        let source = format!("{} (metadata of the file)", accuracy.source);
        Some(ScannerUncertainty { expanded, k: accuracy.k, source })
    }
}

/// A plane that cuts the statue: all points p with normal · p = offset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SectionPlane {
    /// Its name.
    pub name: String,
    /// Of length 1.
    pub normal: [f64; 3],
    /// In the source's unit.
    pub offset: f64,
    /// Whether its outline is shown.
    pub shown: bool,
    /// Whether the statue is cut open: what lies where the normal points is not drawn.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub opens: bool,
}

/// Something written about a place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Note {
    /// What it is called.
    pub title: String,
    /// What it says.
    #[serde(default)]
    pub text: String,
    /// What kind of thing it is about, in the user's words.
    #[serde(default)]
    pub category: String,
    /// sRGB, as `#rrggbb`.
    pub colour: String,
    /// What it marks.
    pub shape: NoteShape,
    /// One point, or a line's corners on the surface.
    pub points: Vec<SurfacePoint>,
    /// Of a region, the area along the surface, in the source's unit squared, as it was when it was marked;
    /// there is no proven bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub area: Option<f64>,
}

/// What a note marks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NoteShape {
    /// A place.
    Point,
    /// A line along the surface.
    Polyline,
    /// What a closed line encloses.
    Region,
}

impl NoteShape {
    /// The fewest points that it has.
    pub fn points_min(self) -> usize {
        match self {
            NoteShape::Point => 1,
            NoteShape::Polyline => 2,
            NoteShape::Region => 3,
        }
    }
}

/// Lists that are shared are equal without being looked at: this is asked every frame.
impl PartialEq for Session {
    fn eq(&self, other: &Session) -> bool {
        fn same<T: PartialEq>(a: &Arc<Vec<T>>, b: &Arc<Vec<T>>) -> bool {
            Arc::ptr_eq(a, b) || a == b
        }
        let Session { version, model, scanner, frame, scale, looks, .. } = self;
        let Session { views, measurements, sections, notes, .. } = self;
        *version == other.version
            && *model == other.model
            && *scanner == other.scanner
            && *frame == other.frame
            && *scale == other.scale
            && *looks == other.looks
            && same(views, &other.views)
            && same(measurements, &other.measurements)
            && same(sections, &other.sections)
            && same(notes, &other.notes)
    }
}

impl Session {
    /// Of a statue that nobody worked on.
    pub fn new(file: &std::path::Path, header: &Header) -> Session {
        Session {
            version: VERSION,
            model: ModelIdentity::new(file, header),
            scanner: None,
            frame: None,
            scale: None,
            looks: Looks::default(),
            views: Arc::default(),
            measurements: Arc::default(),
            sections: Arc::default(),
            notes: Arc::default(),
        }
    }

    /// Says what is wrong with a session that was read, if anything is.
    ///
    /// # Errors
    /// A sentence that names the first thing wrong and where it is.
    pub fn validate(&self) -> Result<(), String> {
        if self.version != VERSION {
            return Err(format!("version {}: this program reads version {VERSION}", self.version));
        }
        let counts = [
            ("views", self.views.len()),
            ("measurements", self.measurements.len()),
            ("sections", self.sections.len()),
            ("notes", self.notes.len()),
        ];
        if let Some((what, count)) = counts.iter().find(|(_, count)| *count > COUNT_MAX) {
            return Err(format!("{count} {what}: at most {COUNT_MAX} are read"));
        }
        if let Some(u) = &self.scanner
            && !(u.expanded >= 0.0 && u.expanded.is_finite() && u.k > 0.0 && u.k.is_finite())
        {
            return Err("scanner: `expanded` must not be negative, and `k` positive".into());
        }
        if let Some(frame) = &self.frame {
            frame.validate().map_err(|why| format!("frame: {why}"))?;
        }
        if let Some(scale) = &self.scale {
            scale.validate().map_err(|why| format!("scale: {why}"))?;
        }
        if self.sections.len() > SECTIONS_MAX {
            let count = self.sections.len();
            return Err(format!("{count} sections: at most {SECTIONS_MAX} at a time"));
        }
        self.looks.validate().map_err(|why| format!("looks: {why}"))?;
        let mut names = std::collections::HashSet::new();
        for (i, view) in self.views.iter().enumerate() {
            let at = |why: String| format!("views[{i}]: {why}");
            if !names.insert(&view.name) {
                return Err(at(format!("there is another view called “{}”", view.name)));
            }
            text(&view.name).map_err(at)?;
            view.viewpoint.validate().map_err(at)?;
            view.looks.validate().map_err(at)?;
        }
        for (i, measurement) in self.measurements.iter().enumerate() {
            measurement.validate().map_err(|why| format!("measurements[{i}]: {why}"))?;
        }
        for (i, section) in self.sections.iter().enumerate() {
            section.validate().map_err(|why| format!("sections[{i}]: {why}"))?;
        }
        for (i, note) in self.notes.iter().enumerate() {
            note.validate().map_err(|why| format!("notes[{i}]: {why}"))?;
        }
        Ok(())
    }

    /// The planes that cut the statue open.
    pub fn clip_planes(&self) -> ClipPlanes {
        ClipPlanes::new(self.sections.iter().map(|s| s.opens.then(|| s.plane())))
    }

    /// Where the statue stands: as the session says, else as the file does. `extents` are how far it reaches along its
    /// own axes, where that is known.
    pub fn framing(&self, header: &Header, extents: Option<[[f64; 2]; 3]>) -> Framing {
        let of_file = Framing::of_header(header);
        let turned = self.frame.as_ref().map(|frame| of_file.turned(frame.axes(), extents));
        turned.unwrap_or(of_file)
    }

    /// The frame in which coordinates are shown, where that is not the scan's.
    pub fn shown_frame(&self) -> Option<&ObjectFrame> {
        self.frame.as_ref().filter(|frame| frame.shown)
    }

    /// A view by its name.
    pub fn view(&self, name: &str) -> Option<&SavedView> {
        self.views.iter().find(|view| view.name == name)
    }

    /// A name that no view has yet.
    pub fn free_view_name(&self) -> String {
        let mut number = self.views.len() + 1;
        while self.view(&format!("View {number}")).is_some() {
            number += 1;
        }
        format!("View {number}")
    }
}

impl ModelIdentity {
    /// Of a file and its header.
    pub fn new(file: &std::path::Path, header: &Header) -> ModelIdentity {
        let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
        let sources = header.sources.iter().map(|source| SourceIdentity {
            name: source.base_name.clone(),
            bytes: source.file_bytes,
            sha256: source.sha256.iter().map(|byte| format!("{byte:02x}")).collect(),
        });
        ModelIdentity {
            file: name.into_owned(),
            unit: header.unit.name().to_owned(),
            sources: sources.collect(),
        }
    }

    /// Why a session of `self` does not fit a file, if it does not: its coordinates would mean other
    /// places. The name of the file does not matter, nor how it was built.
    pub fn mismatch(&self, file: &ModelIdentity) -> Option<String> {
        let hashes = |model: &ModelIdentity| -> Vec<String> {
            model.sources.iter().map(|source| source.sha256.to_lowercase()).collect()
        };
        if hashes(self) != hashes(file) {
            let names: Vec<&str> = self.sources.iter().map(|s| s.name.as_str()).collect();
            return Some(format!(
                "this session is of another scan ({}): its places may be wrong here",
                names.join(", ")
            ));
        }
        (self.unit != file.unit).then(|| {
            format!(
                "this session's lengths are in {}, the file's in {}: they are taken as they are",
                self.unit, file.unit
            )
        })
    }
}

impl SectionPlane {
    /// The plane itself.
    pub fn plane(&self) -> Plane {
        Plane { normal: DVec3::from_array(self.normal), offset: self.offset }
    }

    fn validate(&self) -> Result<(), String> {
        text(&self.name)?;
        let normal = DVec3::from_array(self.normal);
        if !normal.is_finite() || (normal.length() - 1.0).abs() > 1e-6 {
            return Err("`normal` must be of length 1".into());
        }
        if self.offset.is_finite() { Ok(()) } else { Err("`offset` is not a number".into()) }
    }
}

impl Note {
    fn validate(&self) -> Result<(), String> {
        [&self.title, &self.text, &self.category].iter().try_for_each(|t| text(t))?;
        self.colour_rgb().ok_or("`colour` must be like #d08030")?;
        if self.points.len() < self.shape.points_min() {
            return Err(format!("{} points are too few", self.points.len()));
        }
        if self.points.len() > COUNT_MAX {
            return Err(format!("{} points are too many", self.points.len()));
        }
        if self.area.is_some_and(|area| !(area >= 0.0 && area.is_finite())) {
            return Err("`area` must not be negative".into());
        }
        self.points.iter().try_for_each(SurfacePoint::validate)
    }

    /// Its colour, if it is one.
    pub fn colour_rgb(&self) -> Option<[u8; 3]> {
        let digits = self.colour.strip_prefix('#').filter(|d| d.len() == 6 && d.is_ascii())?;
        let part = |i: usize| u8::from_str_radix(&digits[2 * i..2 * i + 2], 16).ok();
        Some([part(0)?, part(1)?, part(2)?])
    }
}

/// Texts are of any content, but not of any length.
pub(crate) fn text(text: &str) -> Result<(), String> {
    if text.len() > TEXT_BYTES_MAX {
        return Err(format!("a text of {} bytes is too long", text.len()));
    }
    Ok(())
}
