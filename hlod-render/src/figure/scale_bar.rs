//! Bars of a round length.

use hlod_compress::Unit;

use super::font::Font;
use super::marks::Mark;
use super::scale::millimetres;
use crate::camera::{Camera, Projection};
use crate::framing::Framing;

/// A bar of a round length: 1, 2 or 5 times a power of ten.
#[derive(Debug, Clone, PartialEq)]
pub struct ScaleBar {
    /// Its length in mm, or in the file's unit where nobody said which that is.
    pub length: f64,
    /// Its length in the picture.
    pub pixels: u32,
    /// `10 cm`, and where that holds if not everywhere.
    pub label: String,
}

impl ScaleBar {
    /// The longest that is no longer than `most_px`, where a pixel shows `pixel` of the file's unit;
    /// `where_it_holds` follows its label. `None` where there is no room for any.
    pub fn new(
        pixel: f64,
        unit: Unit,
        most_px: u32,
        where_it_holds: Option<&str>,
    ) -> Option<ScaleBar> {
        let pixel = pixel * millimetres(unit).unwrap_or(1.0);
        let most = pixel * f64::from(most_px);
        if !(pixel > 0.0 && most.is_finite() && most_px > 0) {
            return None;
        }
        let length = round_below(most);
        let label = match unit {
            Unit::Unknown => format!("{} units", number(length)),
            _ => metric(length),
        };
        let label = match where_it_holds {
            Some(place) => format!("{label} {place}"),
            None => label,
        };
        let pixels = (length / pixel).round().min(f64::from(most_px)) as u32;
        (pixels > 0).then_some(ScaleBar { length, pixels, label })
    }

    /// The bar with its label above, from its lower left corner.
    pub fn marks(&self, font: &Font, (x, y): (i64, i64), text_px: f64, ink: [u8; 3]) -> Vec<Mark> {
        let thick = (text_px / 5.0).round().max(2.0) as u32;
        let label_y = y - i64::from(thick) - (text_px * 1.15) as i64;
        vec![
            Mark::bar(x, y - i64::from(thick), self.pixels, thick, ink),
            font.line(&self.label, (x, label_y), text_px, ink),
        ]
    }
}

/// What a pixel shows at the centre of the bounds, in the file's unit, and how a label says that it
/// holds there alone; in parallel views it holds everywhere.
pub fn bar_for_plane(
    camera: &Camera,
    framing: &Framing,
    height_px: u32,
) -> (f64, Option<&'static str>) {
    let half = camera.half_extent(1.0).y;
    let pixel = 2.0 * half / f64::from(height_px.max(1));
    match camera.projection {
        Projection::Orthographic { .. } => (pixel, None),
        Projection::Perspective { .. } => {
            let depth = (camera.eye - framing.centre).dot(camera.axes()[2]);
            (pixel * depth, Some("at the centre of the bounds"))
        }
    }
}

/// The largest of 1, 2, 5 times a power of ten that is no larger.
fn round_below(most: f64) -> f64 {
    let power = 10f64.powf(most.log10().floor());
    // A bar that has exactly the room it needs must not be lost to rounding.
    let fits = |digit: f64| digit * power <= most * (1.0 + 1e-9);
    [10.0, 5.0, 2.0, 1.0].into_iter().find(|d| fits(*d)).map_or(power / 2.0, |digit| digit * power)
}

/// A length in mm as people say it.
fn metric(length_mm: f64) -> String {
    match length_mm {
        mm if mm >= 999.9 => format!("{} m", number(mm / 1e3)),
        mm if mm >= 9.999 => format!("{} cm", number(mm / 10.0)),
        mm if mm >= 0.999 => format!("{} mm", number(mm)),
        mm => format!("{} µm", number(mm * 1e3)),
    }
}

fn number(value: f64) -> String {
    // Powers of ten are not exact.
    let rounded = format!("{value:.9}");
    rounded.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_round_and_have_the_length_they_say() {
        for (pixel, unit, most, label) in [
            (0.5, Unit::Millimetre, 400, "20 cm"),
            (0.05, Unit::Metre, 399, "10 m"),
            (0.001, Unit::Centimetre, 100, "1 mm"),
            (1e-5, Unit::Millimetre, 999, "5 µm"),
            (0.1, Unit::Inch, 400, "1 m"),
            (0.1, Unit::Unknown, 59, "5 units"),
        ] {
            let bar = ScaleBar::new(pixel, unit, most, None).unwrap();
            assert_eq!(bar.label, label);
            let pixel = pixel * millimetres(unit).unwrap_or(1.0);
            assert!((f64::from(bar.pixels) - bar.length / pixel).abs() <= 0.5);
            // The next longer one would have no room.
            assert!(bar.pixels <= most && bar.pixels * 5 >= 2 * most, "{bar:?}");
        }
        assert_eq!(ScaleBar::new(0.0, Unit::Metre, 100, None), None);
        assert_eq!(ScaleBar::new(f64::NAN, Unit::Metre, 100, None), None);
        assert_eq!(ScaleBar::new(1.0, Unit::Metre, 0, None), None);
    }
}
