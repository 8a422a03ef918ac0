//! What was measured, cut and noted, drawn over the statue's picture.

use std::cell::RefCell;
use std::collections::HashSet;

use egui::{Color32, FontId, Painter, Pos2, Rect, Stroke, pos2, vec2};
use glam::DVec3;

use super::{SECTION_COLOURS, Work};
use crate::lens::Lens;
use crate::measure::{Measurement, MeasurementKind, SurfacePoint};
use crate::session::NoteShape;

const MEASURED: Color32 = Color32::from_rgb(240, 228, 66);
const PICKED: Color32 = Color32::WHITE;
/// Width and height of the cells of which each has one mark, or one label, in points.
const MARK_CELL: (f32, f32) = (2.0, 2.0);
const LABEL_CELL: (f32, f32) = (24.0, 12.0);
/// Lines are not finer than this on the screen, in points.
const LINE_STEP: f32 = 0.75;

/// Draws it into `rect`, where the statue's picture is.
pub fn draw(painter: &Painter, rect: Rect, lens: &Lens, work: &Work) {
    let painter = painter.with_clip_rect(rect);
    let canvas = Canvas { painter, rect, lens: *lens, taken: RefCell::default() };
    for (number, outline) in work.outlines.iter().enumerate() {
        let [r, g, b] = SECTION_COLOURS[number.min(SECTION_COLOURS.len() - 1)];
        let Some(section) = outline.as_ref().and_then(|o| o.section.as_ref()) else { continue };
        for line in &section.0.lines {
            canvas.line(line.points.iter().copied(), line.closed, Color32::from_rgb(r, g, b));
        }
    }
    for note in work.session().notes.iter() {
        let [r, g, b] = note.colour_rgb().unwrap_or([255; 3]);
        let colour = Color32::from_rgb(r, g, b);
        canvas.marks(&note.points, colour, note.shape == NoteShape::Region);
        canvas.label(centre(&note.points), &note.title, colour);
    }
    for measurement in work.session().measurements.iter() {
        let closed = measurement.kind == MeasurementKind::SurfaceArea;
        canvas.marks(&measurement.points, MEASURED, closed);
        let at = match (measurement.kind, &measurement.points[..]) {
            (MeasurementKind::Angle, [_, vertex, _]) => vertex.place(),
            (_, points) => centre(points),
        };
        canvas.label(at, &caption(measurement, &work.unit), MEASURED);
    }
    if let Some(tool) = &work.tool {
        canvas.marks(&tool.points, PICKED, tool.task.is_closed() && tool.points.len() > 2);
        canvas.crosshair();
    }
}

/// What a measurement says on the picture.
pub fn caption(measurement: &Measurement, unit: &str) -> String {
    let Some(result) = measurement.result else { return measurement.name.clone() };
    let bound = result.file_bound.map_or(String::new(), |b| format!(" ± {b:.3}"));
    let of = measurement.kind.unit(unit);
    match measurement.kind {
        MeasurementKind::Point => {
            let p = measurement.points.first().map_or([0.0; 3], |p| p.position);
            format!("{:.3}, {:.3}, {:.3} {of}{bound}", p[0], p[1], p[2])
        }
        MeasurementKind::Angle => format!("{:.2}°{bound}°", result.value),
        MeasurementKind::SurfaceLength | MeasurementKind::SurfaceArea => {
            format!("{:.3} {of} on the surface", result.value)
        }
        _ => format!("{:.3} {of}{bound}", result.value),
    }
}

fn centre(points: &[SurfacePoint]) -> DVec3 {
    let sum: DVec3 = points.iter().map(SurfacePoint::place).sum();
    sum / points.len().max(1) as f64
}

struct Canvas {
    painter: Painter,
    rect: Rect,
    lens: Lens,
    /// Places that have a mark or a label: where there are thousands, those beneath are not drawn.
    taken: RefCell<HashSet<(i32, i32)>>,
}

impl Canvas {
    /// Where a point is on the screen; `None` behind the eye.
    fn screen(&self, point: DVec3) -> Option<Pos2> {
        let pixel = self.lens.pixel_of(point)?;
        let share = pixel / self.lens.size;
        let (width, height) = (f64::from(self.rect.width()), f64::from(self.rect.height()));
        // Far beyond the screen is as good as anywhere there.
        let place = |share: f64, size: f64| (share * size).clamp(-1e5, 1e5) as f32;
        Some(self.rect.min + vec2(place(share.x, width), place(share.y, height)))
    }

    /// Whether a place was free, which then is taken. Places are cells of this size; cells of different
    /// sizes do not disturb each other.
    fn is_free(&self, place: Pos2, (width, height): (f32, f32)) -> bool {
        let cell = ((place.x / width) as i32, (place.y / height) as i32);
        // Sizes are told apart by where they are counted from.
        let cell = (cell.0 + 100_000 * width as i32, cell.1);
        self.taken.borrow_mut().insert(cell)
    }

    fn is_seen(&self, place: Pos2) -> bool {
        self.rect.expand(20.0).contains(place)
    }

    /// A line, without points that are nearer together than a pixel.
    fn line(&self, points: impl Iterator<Item = DVec3>, closed: bool, colour: Color32) {
        let mut strip: Vec<Pos2> = Vec::new();
        let mut first = None;
        for point in points {
            let Some(place) = self.screen(point) else {
                self.strip(&mut strip, colour);
                continue;
            };
            first.get_or_insert(place);
            if strip.last().is_none_or(|last| last.distance(place) >= LINE_STEP) {
                strip.push(place);
            }
        }
        if closed {
            strip.extend(first);
        }
        self.strip(&mut strip, colour);
    }

    fn strip(&self, strip: &mut Vec<Pos2>, colour: Color32) {
        let points = std::mem::take(strip);
        let bounds = Rect::from_points(&points);
        if points.len() > 1 && bounds.intersects(self.rect) {
            self.painter.add(egui::Shape::line(points, Stroke::new(1.5, colour)));
        }
    }

    /// Points and the straight lines between them.
    fn marks(&self, points: &[SurfacePoint], colour: Color32, closed: bool) {
        if points.len() > 1 {
            // Dark beside light: it is seen on marble and on shadows.
            let places = || points.iter().map(SurfacePoint::place);
            self.line(places(), closed, colour);
        }
        for place in points.iter().filter_map(|p| self.screen(p.place())) {
            if self.is_seen(place) && self.is_free(place, MARK_CELL) {
                self.painter.circle(place, 3.5, colour, Stroke::new(1.0, Color32::BLACK));
            }
        }
    }

    fn label(&self, at: DVec3, text: &str, colour: Color32) {
        let place = self.screen(at);
        let Some(place) = place.filter(|p| self.is_seen(*p) && self.is_free(*p, LABEL_CELL)) else {
            return;
        };
        let font = FontId::proportional(13.0);
        let galley = self.painter.layout_no_wrap(text.to_owned(), font, colour);
        let at = place + vec2(8.0, -galley.size().y - 4.0);
        let behind = Rect::from_min_size(at, galley.size()).expand(3.0);
        self.painter.rect_filled(behind, 2.0, Color32::from_black_alpha(190));
        self.painter.galley(at, galley, colour);
    }

    /// The middle of the picture, which Space picks.
    fn crosshair(&self) {
        let centre = self.rect.center();
        for (dark, width) in [(Color32::BLACK, 3.0), (Color32::WHITE, 1.0)] {
            for (x, y) in [(6.0, 0.0), (0.0, 6.0)] {
                let ends = [pos2(centre.x - x, centre.y - y), pos2(centre.x + x, centre.y + y)];
                self.painter.line_segment(ends, Stroke::new(width, dark));
            }
        }
    }
}
