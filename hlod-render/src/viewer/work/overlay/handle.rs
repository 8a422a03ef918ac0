//! Handles by which planes are dragged along their normals.

use std::sync::Arc;

use egui::{Area, Color32, Id, Order, Pos2, Sense, Stroke, Ui, Vec2};
use glam::DVec3;

use super::{Canvas, Work};
use crate::clip::PLANE_COLOURS;
use crate::viewer::work::desk::Wishes;

/// Width and height of what can be taken hold of, in points.
const SIZE: f32 = 22.0;
/// Length of the arrow along the normal, in points.
const ARROW: f32 = 34.0;
/// Planes that are seen almost from above are moved by dragging up and down: below so many points on the
/// screen for an arrow's length along the normal.
const STEEP: f32 = 4.0;

/// Shows a handle for each plane whose outline is shown, and asks for what is dragged.
pub(super) fn show(ui: &Ui, canvas: &Canvas, work: &Work, wishes: &mut Wishes) {
    for (i, section) in work.session().sections.iter().enumerate().filter(|(_, s)| s.shown) {
        let plane = section.plane();
        let centre = (work.bounds.0 + work.bounds.1) / 2.0;
        let at = centre - plane.normal * plane.distance(centre);
        let Some(place) = canvas.screen(at).filter(|place| canvas.rect.contains(*place)) else {
            continue;
        };
        // As long in the world as an arrow is on the screen, where that is seen from the side.
        let length = canvas.world_length(at) * f64::from(ARROW);
        let Some(tip) = canvas.screen(at + plane.normal * length) else { continue };
        let [r, g, b] = PLANE_COLOURS[i.min(PLANE_COLOURS.len() - 1)];
        let id = Id::unique(("plane", i));
        let response = Area::new(id)
            .order(Order::Middle)
            .fixed_pos(place - Vec2::splat(SIZE / 2.0))
            .show(ui.ctx(), |ui| ui.allocate_response(Vec2::splat(SIZE), Sense::drag()))
            .inner
            .on_hover_text(format!("{}: drag to move it", section.name));
        // Where frames are slow the hand may have moved on before it let go.
        let dragged = response.dragged() || response.drag_stopped();
        let held = response.hovered() || dragged;
        draw(ui, place, tip, Color32::from_rgb(r, g, b), held);
        // From where it was taken hold of, not from frame to frame: none is laid out while the cursor moves
        // over the statue, and the first would have all of that way.
        if response.drag_started()
            && let Some(from) = ui.input(|input| input.pointer.press_origin())
        {
            let grab = Grab { offset: section.offset, arrow: tip - place, length, from };
            ui.data_mut(|data| data.insert_temp(id, grab));
        }
        let grab = ui.data(|data| data.get_temp::<Grab>(id)).filter(|_| dragged);
        if let (Some(grab), Some(to)) = (grab, ui.input(|input| input.pointer.latest_pos())) {
            let offset = grab.offset + along(to - grab.from, grab.arrow) * grab.length;
            if offset != section.offset {
                wishes.adjust("move section", move |s| {
                    Arc::make_mut(&mut s.sections)[i].offset = offset;
                });
            }
        }
    }
}

/// How a plane was when it was taken hold of.
#[derive(Clone, Copy)]
struct Grab {
    offset: f64,
    /// On the screen.
    arrow: Vec2,
    /// The same in the world.
    length: f64,
    /// Where the hand was.
    from: Pos2,
}

/// How far along an arrow a drag goes, as a share of its length.
fn along(dragged: Vec2, arrow: Vec2) -> f64 {
    if arrow.length() < STEEP {
        return f64::from(-dragged.y / ARROW);
    }
    f64::from(dragged.dot(arrow) / arrow.length_sq())
}

fn draw(ui: &Ui, place: Pos2, tip: Pos2, colour: Color32, held: bool) {
    let painter = ui.painter();
    let arrow = tip - place;
    for (width, colour) in [(4.5, Color32::BLACK), (2.5, colour)] {
        painter.line_segment([place, tip], Stroke::new(width, colour));
        if arrow.length() > STEEP {
            let (ahead, side) = (arrow.normalized() * 7.0, arrow.normalized().rot90() * 4.5);
            for side in [side, -side] {
                painter.line_segment([tip, tip - ahead + side], Stroke::new(width, colour));
            }
        }
    }
    let radius = if held { 7.5 } else { 6.0 };
    painter.circle(place, radius, colour, Stroke::new(1.5, Color32::BLACK));
}

impl Canvas {
    /// World length of a point of the screen at a place.
    fn world_length(&self, at: DVec3) -> f64 {
        let pixels_per_point = self.lens.size.y / f64::from(self.rect.height().max(1.0));
        self.lens.pixel_length(self.lens.depth_of(at)) * pixels_per_point
    }
}

#[cfg(test)]
mod tests {
    use egui::vec2;

    use super::*;

    #[test]
    fn drags_count_along_the_arrow_and_up_where_it_points_at_the_eye() {
        let arrow = vec2(30.0, 0.0);
        assert_eq!(along(vec2(15.0, 99.0), arrow), 0.5);
        assert_eq!(along(vec2(-30.0, 5.0), arrow), -1.0);
        assert_eq!(along(vec2(0.0, -ARROW), vec2(0.5, 0.5)), 1.0);
    }
}
