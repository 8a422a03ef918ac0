//! A cube that turns with the statue and says which side is seen; a click on a side goes there.

use egui::{Align2, Area, Color32, FontId, Id, Order, Pos2, Rect, Sense, Shape, Stroke, Ui, Vec2};
use glam::DVec3;

use super::bindings::Action;
use crate::camera::Camera;
use crate::framing::NAMED_VIEWS;

/// Width and height of what it takes, in points.
const SIZE: f32 = 76.0;
/// Half an edge of it, so that no corner leaves that.
const HALF: f32 = SIZE / 2.0 / 1.75;
/// A side that is seen more from the side than this has no name on it.
const NAMED_FROM: f64 = 0.4;
/// Sides of a cube among [`NAMED_VIEWS`].
const SIDES: usize = 6;

/// A side that is seen.
#[derive(Debug, Clone, PartialEq)]
struct Side {
    /// In [`NAMED_VIEWS`].
    view: usize,
    /// On the screen, in half edges from the middle, to the right and downwards; in order round it.
    corners: [[f64; 2]; 4],
    /// Cosine of the angle under which it is seen.
    facing: f64,
}

/// The sides that are seen of a cube with these axes (right, up, front), as a camera sees directions.
fn sides(axes: [DVec3; 3], camera: &Camera) -> Vec<Side> {
    let [right, up, back] = camera.axes();
    let on_screen = |v: DVec3| [v.dot(right), -v.dot(up)];
    let side = |view: usize| {
        let [x, y, z] = NAMED_VIEWS[view].1;
        let outwards = axes[0] * x + axes[1] * y + axes[2] * z;
        let facing = outwards.dot(back);
        // Two axes of the cube that lie in the side.
        let along = axes.into_iter().filter(|axis| axis.dot(outwards).abs() < 0.5);
        let along: Vec<DVec3> = along.collect();
        let corner = |a: f64, b: f64| on_screen(outwards + along[0] * a + along[1] * b);
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        Side { view, corners, facing }
    };
    (0..SIDES).map(side).filter(|side| side.facing > 1e-6).collect()
}

impl Side {
    /// Whether a place is within it.
    fn holds(&self, [x, y]: [f64; 2]) -> bool {
        let turns = (0..4).map(|i| {
            let ([ax, ay], [bx, by]) = (self.corners[i], self.corners[(i + 1) % 4]);
            (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        });
        let turns: Vec<f64> = turns.collect();
        turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0)
    }

    fn middle(&self) -> [f64; 2] {
        [0, 1].map(|k| self.corners.iter().map(|c| c[k]).sum::<f64>() / 4.0)
    }
}

/// Shows it at the upper left of the statue's picture.
pub fn show(ui: &Ui, picture: Rect, axes: [DVec3; 3], camera: &Camera, actions: &mut Vec<Action>) {
    if picture.width() < 4.0 * SIZE || picture.height() < 4.0 * SIZE {
        return;
    }
    let at = picture.min + Vec2::splat(8.0);
    let response = Area::new(Id::unique("compass"))
        .order(Order::Middle)
        .fixed_pos(at)
        .show(ui.ctx(), |ui| ui.allocate_response(Vec2::splat(SIZE), Sense::click()))
        .inner;
    let centre = at + Vec2::splat(SIZE / 2.0);
    let place = |[x, y]: [f64; 2]| -> Pos2 { centre + Vec2::new(x as f32, y as f32) * HALF };
    let sides = sides(axes, camera);
    let pointed = response.hover_pos().map(|p| (p - centre) / HALF);
    let pointed = pointed.map(|v| [f64::from(v.x), f64::from(v.y)]);
    let under = sides.iter().find(|side| pointed.is_some_and(|p| side.holds(p)));
    let painter = ui.ctx().layer_painter(response.layer_id);
    for side in &sides {
        let held = under == Some(side);
        let grey = (60.0 + 90.0 * side.facing) as u8;
        let fill = if held { Color32::from_rgb(86, 140, 190) } else { Color32::from_gray(grey) };
        let corners = side.corners.map(place).to_vec();
        painter.add(Shape::convex_polygon(corners, fill, Stroke::new(1.0, Color32::from_gray(25))));
        if side.facing > NAMED_FROM {
            let (name, _) = NAMED_VIEWS[side.view];
            let font = FontId::proportional(9.5);
            let ink = Color32::WHITE;
            painter.text(place(side.middle()), Align2::CENTER_CENTER, name, font, ink);
        }
    }
    let Some(side) = under else { return };
    let (name, _) = NAMED_VIEWS[side.view];
    let clicked = response.clicked();
    response.on_hover_text(format!("see its {name} ({})", side.view + 1));
    if clicked {
        actions.push(Action::NamedView(side.view));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framing::{FOV_Y_DEG, Framing};

    fn framing(up: DVec3, front: DVec3) -> Framing {
        Framing::new((DVec3::new(-1.0, 0.0, -3.0), DVec3::new(5.0, 12.0, 1.0)), up, front)
    }

    /// From each named view the side of that name is seen, in the middle; of the opposite one nothing.
    #[test]
    fn what_is_seen_is_what_the_view_is_called() {
        for (up, front) in [(DVec3::Y, DVec3::Z), (DVec3::Z, -DVec3::Y), (-DVec3::X, DVec3::Y)] {
            let f = framing(up, front);
            for (number, (name, direction)) in NAMED_VIEWS.iter().enumerate().take(SIDES) {
                let camera = f.fitting(*direction, 1.0, FOV_Y_DEG);
                let seen = sides(f.axes, &camera);
                assert_eq!(seen.len(), 1, "{name}: {seen:?}");
                assert_eq!(seen[0].view, number, "{name}");
                assert!(seen[0].holds([0.0, 0.0]) && !seen[0].holds([1.2, 0.0]));
            }
            let camera = f.fitting(NAMED_VIEWS[6].1, 1.0, FOV_Y_DEG);
            let seen: Vec<usize> = sides(f.axes, &camera).iter().map(|s| s.view).collect();
            assert_eq!(seen, [0, 3, 4], "front, right and top");
        }
    }

    /// The right side is on the right of the front, the top above it, and each place is on one side.
    #[test]
    fn sides_lie_as_on_a_cube() {
        let f = framing(DVec3::Y, DVec3::Z);
        let seen = sides(f.axes, &f.fitting(NAMED_VIEWS[6].1, 1.0, FOV_Y_DEG));
        let middle = |view: usize| seen.iter().find(|s| s.view == view).unwrap().middle();
        let (front, right, top) = (middle(0), middle(3), middle(4));
        assert!(right[0] > front[0], "{right:?} {front:?}");
        assert!(top[1] < front[1], "{top:?} {front:?}");
        for side in &seen {
            let holding: Vec<usize> =
                seen.iter().filter(|s| s.holds(side.middle())).map(|s| s.view).collect();
            assert_eq!(holding, [side.view]);
            let reach = side.corners.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs()));
            assert!(reach * f64::from(HALF) < f64::from(SIZE) / 2.0, "{reach}");
        }
    }
}
