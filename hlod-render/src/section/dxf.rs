//! Drawings for CAD, as DXF in the scan's own unit.
//!
//! Format: Autodesk, *DXF Reference* (R2000, AC1015): `$INSUNITS` says what the unit is, each section
//! is a layer, each line an LWPOLYLINE with coordinates of the plane.

use dxf::entities::{Entity, EntityType, LwPolyline};
use dxf::enums::{AcadVersion, Units};
use dxf::{Drawing, LwPolylineVertex};
use hlod_compress::Unit;

use super::Line;
use super::sheet::{Layer, Sheet};
use crate::error::RenderError;

/// Colours of layers by their number in the AutoCAD colour index: that which stands out from the
/// background, red and blue.
const COLOURS: [u8; 3] = [7, 1, 5];

impl Sheet {
    /// The drawing as a DXF file, in natural size. The same bytes each time.
    ///
    /// # Errors
    /// When the unit is unknown.
    pub fn to_dxf(&self) -> Result<Vec<u8>, RenderError> {
        self.millimetres()?;
        let mut drawing = Drawing::new();
        let header = &mut drawing.header;
        header.version = AcadVersion::R2000;
        header.default_drawing_units = match self.unit {
            Unit::Micrometre => Units::Microns,
            Unit::Millimetre => Units::Millimeters,
            Unit::Centimetre => Units::Centimeters,
            Unit::Metre => Units::Meters,
            Unit::Inch => Units::Inches,
            _ => Units::Unitless,
        };
        // What would differ from one run to the next.
        header.creation_date = Default::default();
        header.creation_date_universal = Default::default();
        header.update_date = Default::default();
        header.update_date_universal = Default::default();
        header.fingerprint_guid = Default::default();
        header.version_guid = Default::default();
        for (i, layer) in self.layers.iter().enumerate() {
            let color = dxf::Color::from_index(COLOURS[i % COLOURS.len()]);
            let name = layer.name.clone();
            drawing.add_layer(dxf::tables::Layer { name, color, ..Default::default() });
            for line in &layer.section.lines {
                let mut entity = Entity::new(EntityType::LwPolyline(polyline(layer, line)));
                entity.common.layer.clone_from(&layer.name);
                drawing.add_entity(entity);
            }
        }
        let mut bytes = Vec::new();
        drawing
            .save(&mut bytes)
            .map_err(|e| RenderError::Drawing { what: "DXF", why: e.to_string() })?;
        Ok(bytes)
    }
}

fn polyline(layer: &Layer, line: &Line) -> LwPolyline {
    let mut polyline = LwPolyline::default();
    polyline.set_is_closed(line.closed);
    polyline.vertices = line
        .points
        .iter()
        .map(|p| layer.section.frame.to_plane(*p) + layer.at)
        .map(|q| LwPolylineVertex { x: q.x, y: q.y, ..Default::default() })
        .collect();
    polyline
}
