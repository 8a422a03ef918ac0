//! A section as a line drawing on a page.

use glam::DVec2;

use super::marks::Mark;
use crate::section::Section;

/// A section's lines in ink, `width_px` wide, where a pixel is `pixel` long in the section's unit. The
/// mark's left upper corner is where the section's bounds begin, less the line's own width; second is
/// how many pixels that is. `None` where the plane met nothing.
pub fn outline(section: &Section, pixel: f64, width_px: f64, ink: [u8; 3]) -> Option<(Mark, u32)> {
    let [low, high] = section.bounds()?;
    let round = width_px.ceil() as u32 + 1;
    let size = ((high - low) / pixel).ceil();
    let (width, height) = (size.x as u32 + 2 * round + 1, size.y as u32 + 2 * round + 1);
    let mut coverage = vec![0u8; width as usize * height as usize];
    // Rows count downwards from the upper edge.
    let place = |q: DVec2| DVec2::new(q.x - low.x, high.y - q.y) / pixel + f64::from(round);
    for line in &section.lines {
        let points: Vec<DVec2> =
            line.points.iter().map(|p| place(section.frame.to_plane(*p))).collect();
        let count = if line.closed { points.len() } else { points.len().saturating_sub(1) };
        for i in 0..count {
            let ends = [points[i], points[(i + 1) % points.len()]];
            stroke(&mut coverage, width, height, ends, width_px / 2.0);
        }
    }
    let mark = Mark { x: 0, y: 0, width, height, coverage: Some(coverage), ink };
    Some((mark, round))
}

/// Covers the pixels along a segment: all of those within `half` of it, and less the farther they are
/// within the next pixel.
fn stroke(coverage: &mut [u8], width: u32, height: u32, [a, b]: [DVec2; 2], half: f64) {
    let reach = DVec2::splat(half + 1.0);
    let (low, high) = ((a.min(b) - reach).max(DVec2::ZERO), a.max(b) + reach);
    let along = b - a;
    for y in low.y as u32..(high.y.max(0.0) as u32 + 1).min(height) {
        for x in low.x as u32..(high.x.max(0.0) as u32 + 1).min(width) {
            let from = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - a;
            let length = along.length_squared();
            let share = if length > 0.0 { (from.dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
            let apart = (from - along * share).length();
            let covered = (255.0 * (half + 0.5 - apart).clamp(0.0, 1.0)) as u8;
            let at = &mut coverage[(y * width + x) as usize];
            *at = (*at).max(covered);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stroke_is_as_wide_as_it_should_be_and_where_it_should_be() {
        let (width, height) = (40, 20);
        let mut coverage = vec![0u8; width * height];
        let ends = [DVec2::new(5.0, 10.0), DVec2::new(35.0, 10.0)];
        stroke(&mut coverage, width as u32, height as u32, ends, 1.5);
        // Across it the ink adds up to its width.
        for x in 8..32 {
            let across: f64 = (0..height).map(|y| f64::from(coverage[y * width + x]) / 255.0).sum();
            assert!((across - 3.0).abs() < 0.05, "{across}");
        }
        assert_eq!(coverage[10 * width + 1], 0);
        assert_eq!(coverage[2 * width + 20], 0);
        // Beyond the edges nothing is written, and nothing fails.
        stroke(&mut coverage, 40, 20, [DVec2::new(-9.0, -9.0), DVec2::new(90.0, 60.0)], 1.0);
    }
}
