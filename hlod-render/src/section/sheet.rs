//! A sheet with the sections of some planes on it: what drawings and tables are made from.

use std::path::Path;

use glam::DVec2;
use hlod_compress::{Header, Metadata, Unit};

use super::{Plane, Section};
use crate::error::RenderError;

/// Sections with what must be said about them, for files that leave the program.
#[derive(Debug, Clone)]
pub struct Sheet {
    /// Where the sections come from.
    pub provenance: Provenance,
    /// Unit of all lengths; of the file, or as declared instead.
    pub unit: Unit,
    /// The sections.
    pub layers: Vec<Layer>,
}

/// What a section was made of.
#[derive(Debug, Clone)]
pub struct Provenance {
    /// Name of the file without folders, or its address.
    pub file: String,
    /// Names and SHA-256 of the scans that the file was built from.
    pub scans: Vec<(String, String)>,
    /// Unit that the file declares.
    pub unit_of_file: Unit,
    /// Program and version.
    pub program: String,
    /// What the file's metadata say of the scan: names and values.
    pub about: Vec<(String, String)>,
}

/// One section on a sheet.
#[derive(Debug, Clone)]
pub struct Layer {
    /// As `section-1`, or `section-1-4` where it is the fourth of several in parallel.
    pub name: String,
    /// The section.
    pub section: Section,
    /// Added to coordinates in its plane where it is drawn, in the sheet's unit: planes that are not
    /// parallel lie side by side.
    pub at: DVec2,
}

/// Space between planes that lie side by side, as a part of the wider one.
const SPACE: f64 = 0.1;

impl Sheet {
    /// A sheet of a file's sections, each of `families` sections that are parallel. A `declared`
    /// unit replaces the file's.
    pub fn new(
        path: &Path,
        header: &Header,
        declared: Option<Unit>,
        families: Vec<Vec<Section>>,
    ) -> Sheet {
        let scans = header.sources.iter().map(|s| (s.base_name.clone(), hex(&s.sha256))).collect();
        let file = match path.to_str() {
            Some(address) if address.contains("://") => address.to_owned(),
            _ => path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        };
        let program = concat!("hlod-render ", env!("CARGO_PKG_VERSION")).to_owned();
        let unit_of_file = header.unit;
        let provenance = Provenance { file, scans, unit_of_file, program, about: Vec::new() };
        let unit = declared.unwrap_or(header.unit);
        Sheet { provenance, unit, layers: side_by_side(families) }
    }

    /// The same sheet, which says what is known of the scan besides its shape.
    pub fn about(mut self, metadata: Option<&Metadata>) -> Sheet {
        self.provenance.about = metadata.map(Metadata::lines).unwrap_or_default();
        self
    }

    /// How many millimetres the unit has.
    ///
    /// # Errors
    /// When nobody said what the unit is: a drawing would have to lie.
    pub fn millimetres(&self) -> Result<f64, RenderError> {
        millimetres(self.unit).ok_or_else(|| {
            let file = &self.provenance.file;
            RenderError::Usage(format!(
                "{file}: its unit is unknown, so it cannot be drawn to scale: add --unit mm (or \
                 cm, m, um, in) if you know it, or build the file again with --unit; --csv and \
                 --json need none"
            ))
        })
    }

    /// Smallest and largest coordinates of all that is drawn, in the sheet's unit; `None` where
    /// nothing is.
    pub fn bounds(&self) -> Option<[DVec2; 2]> {
        let bounds = |layer: &Layer| layer.section.bounds().map(|b| b.map(|q| q + layer.at));
        self.layers.iter().filter_map(bounds).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }

    /// What must be known of the sheet wherever it goes, a line each.
    pub fn description(&self) -> Vec<String> {
        let p = &self.provenance;
        let mut lines = vec![format!("Plane sections of {} by {}", p.file, p.program)];
        lines.extend(p.scans.iter().map(|(name, sha256)| format!("Scan {name}, SHA-256 {sha256}")));
        lines.extend(p.about.iter().map(|(name, text)| format!("{name}: {text}")));
        lines.push(match self.unit == p.unit_of_file {
            true => format!("Unit of the scan: {}", self.unit.name()),
            false => {
                let (unit, of_file) = (self.unit.name(), p.unit_of_file.name());
                format!("Unit of the scan: {unit}, as declared for this section; its file says {of_file}")
            }
        });
        lines.extend(self.layers.iter().map(|layer| {
            let Plane { normal: n, offset } = layer.section.plane;
            let unit = self.unit_suffix();
            format!("{}: {} x + {} y + {} z = {}{unit}", layer.name, n.x, n.y, n.z, offset)
        }));
        lines
    }

    /// The unit behind numbers: a space and its abbreviation, or nothing where it is unknown.
    pub fn unit_suffix(&self) -> String {
        match self.unit {
            Unit::Unknown => String::new(),
            unit => format!(" {}", unit.name()),
        }
    }
}

/// Millimetres in a unit, if it is known.
fn millimetres(unit: Unit) -> Option<f64> {
    match unit {
        Unit::Micrometre => Some(1e-3),
        Unit::Millimetre => Some(1.0),
        Unit::Centimetre => Some(10.0),
        Unit::Metre => Some(1e3),
        Unit::Inch => Some(25.4),
        _ => None,
    }
}

/// Sections of one family on top of one another, families from left to right. The first keeps its
/// plane's coordinates; others keep their height, where that is beside the one before.
fn side_by_side(families: Vec<Vec<Section>>) -> Vec<Layer> {
    let mut layers = Vec::new();
    let mut before: Option<[DVec2; 2]> = None;
    for (i, family) in families.into_iter().enumerate() {
        let bounds = family.iter().filter_map(Section::bounds);
        let bounds = bounds.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        let at = match (before, bounds) {
            (Some(before), Some(bounds)) => beside(before, bounds),
            _ => DVec2::ZERO,
        };
        before = bounds.map(|b| b.map(|q| q + at)).or(before);
        let several = family.len() > 1;
        layers.extend(family.into_iter().enumerate().map(|(j, section)| {
            let of_several = if several { format!("-{}", j + 1) } else { String::new() };
            Layer { name: format!("section-{}{of_several}", i + 1), section, at }
        }));
    }
    layers
}

/// How far to move what lies in `bounds`, so that it is to the right of what is `before` it.
fn beside(before: [DVec2; 2], bounds: [DVec2; 2]) -> DVec2 {
    let width = |[min, max]: [DVec2; 2]| max.x - min.x;
    let x = before[1].x + SPACE * width(before).max(width(bounds)) - bounds[0].x;
    let level = bounds[0].y <= before[1].y && before[0].y <= bounds[1].y;
    DVec2::new(x, if level { 0.0 } else { before[0].y - bounds[0].y })
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_lie_side_by_side_at_their_height_or_on_one_line() {
        let (a, b) = (DVec2::new(-1.0, 2.0), DVec2::new(9.0, 6.0));
        let moved = beside([a, b], [DVec2::new(3.0, 0.0), DVec2::new(4.0, 3.0)]);
        assert_eq!(moved, DVec2::new(7.0, 0.0));
        let far = beside([a, b], [DVec2::new(3.0, 700.0), DVec2::new(4.0, 900.0)]);
        assert_eq!(far, DVec2::new(7.0, -698.0));
    }
}
