//! Drawings to scale, as SVG: a millimetre of the drawing is a user unit of the file.
//!
//! Format: W3C, *Scalable Vector Graphics (SVG) 1.1 (Second Edition)*, 2011, sections 5, 7 and 8.

use glam::DVec2;
use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};

use super::Line;
use super::sheet::{Layer, Sheet};
use crate::error::RenderError;

/// White space around the drawing in millimetres on paper.
const MARGIN_MM: f64 = 5.0;
/// Width of lines in millimetres on paper: the thinnest of ISO 128-2 (2020).
const HAIRLINE_MM: &str = "0.13";
/// Colours of planes that are not parallel, one after another.
const COLOURS: [&str; 3] = ["#000000", "#b2182b", "#2166ac"];
/// A drawing is no wider and no higher, in millimetres: programs that show it must be able to.
const PAPER_MM_MAX: f64 = 1e6;

impl Sheet {
    /// The drawing as an SVG file, 1 : `reduction`.
    ///
    /// # Errors
    /// When the unit is unknown or the drawing larger than a kilometre.
    pub fn to_svg(&self, reduction: f64) -> Result<Vec<u8>, RenderError> {
        let paper_mm = self.millimetres()? / reduction;
        let [min, max] = self.bounds().unwrap_or_default().map(|q| q * paper_mm);
        let size = max - min + 2.0 * MARGIN_MM;
        if !size.is_finite() || size.max_element() > PAPER_MM_MAX {
            return Err(RenderError::Usage(format!(
                "a drawing of {:.0} × {:.0} mm is too large: reduce it by --scale 1:N",
                size.x, size.y
            )));
        }
        let page = Page { paper_mm, left: min.x - MARGIN_MM, top: max.y + MARGIN_MM };
        let write = |writer: &mut Writer<Vec<u8>>| self.write(writer, &page, size, reduction);
        let mut writer = Writer::new_with_indent(Vec::new(), b' ', 1);
        // Into memory nothing fails to be written.
        write(&mut writer).map_err(|e| RenderError::Drawing { what: "SVG", why: e.to_string() })?;
        let mut bytes = writer.into_inner();
        bytes.push(b'\n');
        Ok(bytes)
    }

    fn write(
        &self,
        writer: &mut Writer<Vec<u8>>,
        page: &Page,
        size: DVec2,
        reduction: f64,
    ) -> std::io::Result<()> {
        let [width, height] = [size.x, size.y].map(number);
        let (width_mm, height_mm) = (format!("{width}mm"), format!("{height}mm"));
        let view = format!("0 0 {width} {height}");
        let mut about = self.description();
        about.push(format!("Scale 1:{}, in millimetres", number(reduction)));
        writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
        let svg = writer.create_element("svg").with_attributes([
            ("xmlns", "http://www.w3.org/2000/svg"),
            ("version", "1.1"),
            ("width", width_mm.as_str()),
            ("height", height_mm.as_str()),
            ("viewBox", view.as_str()),
        ]);
        svg.write_inner_content(|writer| {
            let title = format!("Sections of {}", self.provenance.file);
            writer.create_element("title").write_text_content(BytesText::new(&title))?;
            let about = about.join("\n");
            writer.create_element("desc").write_text_content(BytesText::new(&about))?;
            for (layer, colour) in self.layers.iter().zip(self.colours()) {
                page.write_layer(writer, layer, colour)?;
            }
            Ok(())
        })?;
        Ok(())
    }

    /// The colour of each layer.
    fn colours(&self) -> impl Iterator<Item = &'static str> {
        let mut planes = 0;
        let mut last = None;
        self.layers.iter().map(move |layer| {
            let normal = layer.section.plane.normal;
            if last.is_some_and(|last| last != normal) {
                planes += 1;
            }
            last = Some(normal);
            COLOURS[planes % COLOURS.len()]
        })
    }
}

/// Where coordinates lie on paper.
struct Page {
    /// Millimetres of paper in the sheet's unit.
    paper_mm: f64,
    left: f64,
    /// Up is positive on the sheet and negative in the file.
    top: f64,
}

impl Page {
    fn write_layer(
        &self,
        writer: &mut Writer<Vec<u8>>,
        layer: &Layer,
        colour: &str,
    ) -> std::io::Result<()> {
        let group = writer.create_element("g").with_attributes([
            ("id", layer.name.as_str()),
            ("fill", "none"),
            ("stroke", colour),
            ("stroke-width", HAIRLINE_MM),
            ("stroke-linejoin", "round"),
        ]);
        group.write_inner_content(|writer| {
            for line in &layer.section.lines {
                let path = self.path(layer, line);
                writer.create_element("path").with_attribute(("d", path.as_str())).write_empty()?;
            }
            Ok(())
        })?;
        Ok(())
    }

    fn path(&self, layer: &Layer, line: &Line) -> String {
        let points = line.points.iter().map(|p| layer.section.frame.to_plane(*p) + layer.at);
        let mut path = String::new();
        for (i, q) in points.enumerate() {
            let q = q * self.paper_mm;
            path += if i == 0 { "M" } else { "L" };
            path += &format!("{},{}", number(q.x - self.left), number(self.top - q.y));
        }
        if line.closed {
            path.push('Z');
        }
        path
    }
}

/// A number of millimetres to the nanometre, without zeros that say nothing.
fn number(value: f64) -> String {
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}
