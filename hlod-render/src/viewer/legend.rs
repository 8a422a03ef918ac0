//! What colours say of numbers, in the window.

use egui::{Color32, FontId, Ui, pos2, vec2};

use crate::colour_map::NO_VALUE;
use crate::scene::{Paint, Painted};

const WIDTH: f32 = 200.0;
const HEIGHT: f32 = 10.0;
const STEPS: usize = 100;

/// Lets one of the file's numbers be chosen.
pub fn choose(ui: &mut Ui, paint: &mut Paint, scalars: &[Painted]) {
    if scalars.is_empty() {
        return;
    }
    ui.horizontal_wrapped(|ui| {
        ui.label("colour by");
        for (k, painted) in (0u8..).zip(scalars) {
            let hover = format!("{} to {}", painted.ends()[0], painted.ends()[1]);
            ui.selectable_value(paint, Paint::Scalar(k), &painted.name).on_hover_text(hover);
        }
    });
}

/// The legend at the lower right of the statue's picture.
pub fn draw(
    ui: &Ui,
    rect: egui::Rect,
    paint: Paint,
    scalars: &[Painted],
    [bound, curvature]: [&Painted; 2],
) {
    let painted = match paint {
        Paint::Bound => Some(bound),
        Paint::Curvature => Some(curvature),
        Paint::Scalar(k) => scalars.get(usize::from(k)),
        _ => None,
    };
    let Some(painted) = painted else { return };
    let painter = ui.painter().with_clip_rect(rect);
    let font = FontId::proportional(12.0);
    let text =
        |text: &str| painter.layout_no_wrap(text.to_owned(), font.clone(), Color32::LIGHT_GRAY);
    let (title, [low, high]) = (text(&painted.title()), painted.ends().map(|end| text(&end)));
    let none = text(painted.grey);
    let line = title.size().y;
    let size = vec2(WIDTH, HEIGHT + 2.0 * line + 8.0);
    // The buttons are in the corner above.
    let at = rect.right_bottom() - size - vec2(14.0, 12.0);
    let behind = egui::Rect::from_min_size(at, size).expand(5.0);
    painter.rect_filled(behind, 2.0, Color32::from_black_alpha(170));
    let bar = at + vec2(0.0, line + 3.0);
    for i in 0..STEPS {
        let [r, g, b] = painted.map.colour((i as f32 + 0.5) / STEPS as f32);
        let step = WIDTH / STEPS as f32;
        let from = bar + vec2(step * i as f32, 0.0);
        let rect = egui::Rect::from_min_size(from, vec2(step + 0.5, HEIGHT));
        painter.rect_filled(rect, 0.0, Color32::from_rgb(r, g, b));
    }
    let below = bar.y + HEIGHT + 3.0;
    let low_width = low.size().x;
    let high_at = pos2(at.x + WIDTH - high.size().x, below);
    let [r, g, b] = NO_VALUE;
    let square = pos2(at.x + low_width + 14.0, below + 3.0);
    if !painted.grey.is_empty() && square.x + 16.0 + none.size().x < high_at.x {
        let square = egui::Rect::from_min_size(square, vec2(9.0, 9.0));
        painter.rect_filled(square, 0.0, Color32::from_rgb(r, g, b));
        painter.galley(pos2(square.right() + 4.0, below), none, Color32::LIGHT_GRAY);
    }
    painter.galley(at, title, Color32::LIGHT_GRAY);
    painter.galley(pos2(at.x, below), low, Color32::LIGHT_GRAY);
    painter.galley(high_at, high, Color32::LIGHT_GRAY);
}
