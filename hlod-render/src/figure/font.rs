//! Letters.

use ab_glyph::{Font as _, FontRef, PxScale, ScaleFont, point};

use super::marks::Mark;
use crate::error::RenderError;

/// The typeface of labels: Ubuntu Light, which the program carries, so that figures look the same
/// everywhere.
pub struct Font {
    face: FontRef<'static>,
}

impl Font {
    /// # Errors
    /// When the typeface that was compiled in cannot be read.
    pub fn new() -> Result<Font, RenderError> {
        let face = FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT)
            .map_err(|e| RenderError::Usage(format!("the program's own typeface: {e}")))?;
        Ok(Font { face })
    }

    /// Width of a line in pixels.
    pub fn width(&self, text: &str, height_px: f64) -> u32 {
        let font = self.face.as_scaled(PxScale::from(height_px as f32));
        let advance: f32 = text.chars().map(|c| font.h_advance(font.glyph_id(c))).sum();
        advance.ceil() as u32
    }

    /// The text, or as much of it as a width has room for and `…`.
    pub fn fitted(&self, text: &str, height_px: f64, width: u32) -> String {
        let mut kept: Vec<char> = text.chars().filter(|c| !c.is_control()).collect();
        let all: String = kept.iter().collect();
        if self.width(&all, height_px) <= width {
            return all;
        }
        while kept.pop().is_some() {
            let shorter = kept.iter().collect::<String>() + "…";
            if self.width(&shorter, height_px) <= width {
                return shorter;
            }
        }
        String::new()
    }

    /// A line of text, `height_px` from the lowest descender to the highest ascender, whose upper left
    /// corner is at `x`, `y`.
    pub fn line(&self, text: &str, (x, y): (i64, i64), height_px: f64, ink: [u8; 3]) -> Mark {
        let font = self.face.as_scaled(PxScale::from(height_px as f32));
        // Letters may reach a little beyond their own widths.
        let (width, height) = (self.width(text, height_px) + 2, height_px.ceil() as u32 + 1);
        let mut coverage = vec![0u8; width as usize * height as usize];
        let mut at = 1.0;
        for letter in text.chars() {
            let id = font.glyph_id(letter);
            let glyph = id.with_scale_and_position(font.scale(), point(at, font.ascent()));
            at += font.h_advance(id);
            let Some(outline) = font.outline_glyph(glyph) else { continue };
            let bounds = outline.px_bounds();
            outline.draw(|column, row, share| {
                let px = bounds.min.x as i64 + i64::from(column);
                let py = bounds.min.y as i64 + i64::from(row);
                if (0..i64::from(width)).contains(&px) && (0..i64::from(height)).contains(&py) {
                    let place = &mut coverage[py as usize * width as usize + px as usize];
                    let share = (share.clamp(0.0, 1.0) * 255.0).round() as u8;
                    *place = place.saturating_add(share);
                }
            });
        }
        Mark { x: x - 1, y, width, height, coverage: Some(coverage), ink }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_there_and_as_wide_as_is_said() {
        let font = Font::new().unwrap();
        let line = font.line("10 cm", (5, 7), 40.0, [0; 3]);
        let ink: u64 = line.coverage.as_ref().unwrap().iter().map(|c| u64::from(*c)).sum();
        assert!(ink > 255 * 100 && line.width <= font.width("10 cm", 40.0) + 2);
        let none = font.line("  ", (0, 0), 40.0, [0; 3]);
        assert!(none.coverage.unwrap().iter().all(|c| *c == 0));
        // Twice as high is twice as wide.
        let (small, large) = (font.width("Statue", 20.0), font.width("Statue", 40.0));
        assert!(large.abs_diff(2 * small) <= 2);
        // What has no letter is drawn all the same.
        assert!(font.width("\u{13000}", 20.0) > 0);
    }

    #[test]
    fn what_has_no_room_is_cut() {
        let font = Font::new().unwrap();
        let width = font.width("a long na", 20.0);
        let cut = font.fitted("a long name\u{7}", 20.0, width);
        assert!(cut.ends_with('…') && cut.starts_with("a lo") && font.width(&cut, 20.0) <= width);
        assert_eq!(font.fitted("a", 20.0, 1000), "a");
        assert_eq!(font.fitted("abc", 20.0, 0), "");
    }
}
