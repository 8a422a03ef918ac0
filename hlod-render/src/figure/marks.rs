//! What is laid over a drawn page: bars and letters.

use hlod_compress::srgb::{linear_from_srgb, srgb_from_linear};

/// A rectangle of ink.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mark {
    /// Left side in pixels of the page; what lies outside is left out.
    pub x: i64,
    /// Upper side.
    pub y: i64,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How much of each pixel is covered, row by row; `None` for all of all.
    pub coverage: Option<Vec<u8>>,
    /// Colour, sRGB.
    pub ink: [u8; 3],
}

impl Mark {
    /// A full rectangle.
    pub fn bar(x: i64, y: i64, width: u32, height: u32, ink: [u8; 3]) -> Mark {
        Mark { x, y, width, height, coverage: None, ink }
    }

    fn covers(&self, column: u32, row: u32) -> u8 {
        let at = row as usize * self.width as usize + column as usize;
        self.coverage.as_ref().map_or(255, |all| all.get(at).copied().unwrap_or(0))
    }

    /// Lays it over some rows of a page, from `first_row` on: four bytes a pixel, alpha not multiplied in.
    pub fn draw(&self, rows: &mut [u8], page_width: u32, first_row: u32) {
        let count = rows.len() / (4 * page_width as usize).max(1);
        for row in 0..self.height {
            let y = self.y + i64::from(row) - i64::from(first_row);
            if y < 0 || y >= count as i64 {
                continue;
            }
            for column in 0..self.width {
                let x = self.x + i64::from(column);
                if x < 0 || x >= i64::from(page_width) {
                    continue;
                }
                let at = 4 * (y as usize * page_width as usize + x as usize);
                over(&mut rows[at..at + 4], self.ink, self.covers(column, row));
            }
        }
    }
}

/// Ink over a pixel, in linear light.
fn over(pixel: &mut [u8], ink: [u8; 3], coverage: u8) {
    if coverage == 0 {
        return;
    }
    let share = f32::from(coverage) / 255.0;
    let below = f32::from(pixel[3]) / 255.0 * (1.0 - share);
    let alpha = share + below;
    for (value, ink) in pixel.iter_mut().zip(ink) {
        let mixed = linear_from_srgb(ink) * share + linear_from_srgb(*value) * below;
        *value = srgb_from_linear(mixed / alpha);
    }
    pixel[3] = (alpha * 255.0).round() as u8;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_cover_their_pixels_in_whatever_rows_they_are_drawn() {
        let mark = Mark::bar(1, 1, 2, 2, [255, 0, 0]);
        let page = || vec![0u8; 4 * 4 * 4];
        let mut whole = page();
        mark.draw(&mut whole, 4, 0);
        let red = whole.chunks_exact(4).filter(|p| *p == [255, 0, 0, 255]).count();
        assert_eq!((red, whole.iter().filter(|v| **v != 0).count()), (4, 8));
        let mut parts = page();
        let (upper, lower) = parts.split_at_mut(32);
        mark.draw(upper, 4, 0);
        mark.draw(lower, 4, 2);
        assert_eq!(parts, whole);
    }

    #[test]
    fn half_covered_pixels_are_half_as_light_and_keep_colours_pure_on_nothing() {
        let mut pixel = [0, 0, 0, 255];
        over(&mut pixel, [255; 3], 128);
        assert!((linear_from_srgb(pixel[0]) - 0.5).abs() < 0.01);
        let mut nothing = [0, 0, 0, 0];
        over(&mut nothing, [255, 255, 255], 64);
        assert_eq!(nothing, [255, 255, 255, 64]);
    }
}
