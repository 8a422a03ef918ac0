//! What was measured, cut and noted, drawn over the statue's picture.

mod handle;

use std::cell::RefCell;
use std::collections::HashSet;

use egui::{Color32, FontId, Painter, Pos2, Rect, Stroke, Ui, pos2, vec2};
use glam::DVec3;

use super::Work;
use super::desk::Wishes;
use crate::clip::PLANE_COLOURS;
use crate::lens::Lens;
use crate::measure::{Measurement, MeasurementKind, SurfacePoint};
use crate::session::NoteShape;
use crate::viewer::depth::{DepthPicture, DepthView};

const MEASURED: Color32 = Color32::from_rgb(240, 228, 66);
const PICKED: Color32 = Color32::WHITE;
/// Share of its strength that a line has where the statue hides it.
const HIDDEN_STRENGTH: f32 = 0.25;
/// Width and height of the cells of which each has one mark, or one label, in points.
const MARK_CELL: (f32, f32) = (2.0, 2.0);
const LABEL_CELL: (f32, f32) = (24.0, 12.0);
/// Lines are not finer than this on the screen, in points.
const LINE_STEP: f32 = 0.75;

/// What is drawn over a picture, and through what it was taken.
pub struct Overlay<'a> {
    /// What was measured, cut and noted.
    pub work: &'a Work,
    /// How the picture was taken.
    pub lens: &'a Lens,
    /// Its depth, once it is at rest and that is known: then what is hidden is drawn faintly.
    pub depth: Option<&'a DepthPicture>,
}

impl Overlay<'_> {
    /// Draws it into `rect`, where the statue's picture is.
    pub fn draw(&self, ui: &Ui, rect: Rect, wishes: &mut Wishes) {
        let canvas = Canvas {
            painter: ui.painter().with_clip_rect(rect),
            rect,
            lens: *self.lens,
            depth: self.depth.and_then(DepthPicture::read),
            taken: RefCell::default(),
        };
        let work = self.work;
        for (number, outline) in work.outlines.iter().enumerate() {
            let [r, g, b] = PLANE_COLOURS[number.min(PLANE_COLOURS.len() - 1)];
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
            canvas.label(at, &caption(measurement, work), MEASURED);
        }
        if let Some(tool) = &work.tool {
            canvas.marks(&tool.points, PICKED, tool.task.is_closed() && tool.points.len() > 2);
            canvas.crosshair();
        }
        handle::show(ui, &canvas, work, wishes);
    }
}

/// What a measurement says on the picture.
pub fn caption(measurement: &Measurement, work: &Work) -> String {
    let Some(result) = measurement.result else { return measurement.name.clone() };
    let bound = result.file_bound.map_or(String::new(), |b| format!(" ± {b:.3}"));
    let of = measurement.kind.unit(&work.unit);
    let session = work.session();
    let scale = session.scale.as_ref();
    let corrected = scale.and_then(|scale| {
        let corrected = scale.apply(measurement.kind, &result)?;
        let bound = corrected.file_bound.map_or(String::new(), |b| format!(" ± {b:.3}"));
        let of = measurement.kind.unit(&scale.unit);
        Some(format!("; corrected {:.3} {of}{bound}", corrected.value))
    });
    let corrected = corrected.unwrap_or_default();
    match measurement.kind {
        MeasurementKind::Point => {
            let source = measurement.points.first().map_or([0.0; 3], |p| p.position);
            let shown = session.shown_frame();
            let p = shown.map_or(source, |frame| frame.place(source));
            let frame = work.frame_name();
            format!("{:.3}, {:.3}, {:.3} {of}{bound}{frame}", p[0], p[1], p[2])
        }
        MeasurementKind::Angle => format!("{:.2}°{bound}°", result.value),
        MeasurementKind::SurfaceLength | MeasurementKind::SurfaceArea => {
            format!("{:.3} {of} on the surface{corrected}", result.value)
        }
        _ => format!("{:.3} {of}{bound}{corrected}", result.value),
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
    depth: Option<DepthView>,
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

    /// Whether the statue is before a point, as far as that is known.
    fn is_hidden(&self, point: DVec3) -> bool {
        self.depth.as_ref().is_some_and(|depth| depth.hides(point))
    }

    /// A line, without points that are nearer together than a pixel; faint where it is hidden.
    fn line(&self, points: impl Iterator<Item = DVec3> + Clone, closed: bool, colour: Color32) {
        let first = points.clone().next().filter(|_| closed);
        let mut strip: Vec<Pos2> = Vec::new();
        let mut faint = false;
        for point in points.chain(first) {
            let Some(place) = self.screen(point) else {
                self.strip(&mut strip, colour, faint);
                continue;
            };
            if strip.last().is_some_and(|last| last.distance(place) < LINE_STEP) {
                continue;
            }
            strip.push(place);
            let hidden = self.is_hidden(point);
            if hidden != faint {
                // It ends here, and goes on from here.
                self.strip(&mut strip, colour, faint);
                strip.push(place);
                faint = hidden;
            }
        }
        self.strip(&mut strip, colour, faint);
    }

    fn strip(&self, strip: &mut Vec<Pos2>, colour: Color32, faint: bool) {
        let points = std::mem::take(strip);
        let bounds = Rect::from_points(&points);
        if points.len() > 1 && bounds.intersects(self.rect) {
            let colour = if faint { colour.gamma_multiply(HIDDEN_STRENGTH) } else { colour };
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
        for point in points.iter().map(SurfacePoint::place) {
            let Some(place) = self.screen(point) else { continue };
            if self.is_seen(place) && self.is_free(place, MARK_CELL) {
                let strength = if self.is_hidden(point) { HIDDEN_STRENGTH } else { 1.0 };
                let edge = Stroke::new(1.0, Color32::BLACK.gamma_multiply(strength));
                self.painter.circle(place, 3.5, colour.gamma_multiply(strength), edge);
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
