//! What colours say of numbers: a bar with its ends.

use super::font::Font;
use super::marks::Mark;
use crate::colour_map::NO_VALUE;
use crate::scene::Painted;

/// A bar of so many pixels with all colours, its ends and what is painted, from its lower right corner.
pub fn legend(
    painted: &Painted,
    font: &Font,
    (right, bottom): (i64, i64),
    (width, text_px): (u32, f64),
    [ink, paper]: [[u8; 3]; 2],
) -> Vec<Mark> {
    let line = (text_px * 1.2) as i64;
    let left = right - i64::from(width);
    let thick = (text_px * 0.6).round().max(3.0) as u32;
    let bar_y = bottom - line - i64::from(thick);
    // The statue may be behind, in any colour.
    let margin = line / 4;
    let around = 2 * margin as u32;
    let height = 2 * line as u32 + thick + around;
    let behind = (left - margin, bar_y - line - margin);
    let mut marks = vec![Mark::bar(behind.0, behind.1, width + around, height, paper)];
    marks.extend((0..width).map(|i| {
        let t = (i as f32 + 0.5) / width as f32;
        Mark::bar(left + i64::from(i), bar_y, 1, thick, painted.map.colour(t))
    }));
    let title = font.fitted(&painted.title(), text_px, width);
    marks.push(font.line(&title, (left, bar_y - line), text_px, ink));
    let [low, high] = painted.ends();
    let high_x = right - i64::from(font.width(&high, text_px));
    let below = bottom - line;
    marks.push(font.line(&low, (left, below), text_px, ink));
    marks.push(font.line(&high, (high_x, below), text_px, ink));
    let square_x = left + i64::from(font.width(&low, text_px)) + line / 2;
    let words_x = square_x + i64::from(thick) + line / 4;
    let end = words_x + i64::from(font.width(painted.grey, text_px));
    if !painted.grey.is_empty() && end + line / 2 < high_x {
        let y = below + (text_px * 0.35) as i64;
        marks.push(Mark::bar(square_x, y, thick, thick, NO_VALUE));
        marks.push(font.line(painted.grey, (words_x, below), text_px, ink));
    }
    marks
}
