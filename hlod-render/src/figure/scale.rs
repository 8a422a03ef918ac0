//! How long a pixel is: on paper, and on the statue.

use hlod_compress::Unit;

use crate::error::RenderError;

/// Millimetres in an inch.
const INCH_MM: f64 = 25.4;

/// A drawing's scale and the resolution at which it is to be printed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// How many times the statue is larger than its picture on paper.
    pub reduction: f64,
    /// Pixels in an inch of paper.
    pub dpi: f64,
}

impl Scale {
    /// Length of a pixel's side on paper in mm.
    pub fn pixel_on_paper_mm(&self) -> f64 {
        INCH_MM / self.dpi
    }

    /// Length of a pixel's side on the statue in mm.
    pub fn pixel_mm(&self) -> f64 {
        self.pixel_on_paper_mm() * self.reduction
    }

    /// The same in the statue's unit.
    ///
    /// # Errors
    /// When nobody said what the unit is.
    pub fn pixel_in(&self, unit: Unit) -> Result<f64, RenderError> {
        let unit_mm = millimetres(unit).ok_or_else(|| {
            let why = "--scale needs the length of the file's unit, and the file does not say which it \
                       is; name it with --unit mm, cm, m, um or in";
            RenderError::Usage(why.into())
        })?;
        Ok(self.pixel_mm() / unit_mm)
    }

    /// As it is written: `1 : 5`, or `2 : 1` where the picture is larger than the statue.
    pub fn name(&self) -> String {
        match self.reduction >= 1.0 {
            true => format!("1 : {}", rounded(self.reduction)),
            false => format!("{} : 1", rounded(1.0 / self.reduction)),
        }
    }
}

/// At most four digits after the point, and no noughts at the end.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// How many millimetres a unit is; `None` where nobody said which it is.
pub fn millimetres(unit: Unit) -> Option<f64> {
    match unit {
        Unit::Micrometre => Some(1e-3),
        Unit::Millimetre => Some(1.0),
        Unit::Centimetre => Some(10.0),
        Unit::Metre => Some(1000.0),
        Unit::Inch => Some(INCH_MM),
        _ => None,
    }
}

/// How large a statue is, in words: `size` is its width, height and depth in `unit`. A unit that nobody declared is
/// not given a name.
pub fn size_in_words([width, height, depth]: [f64; 3], unit: Unit) -> String {
    let largest = width.max(height).max(depth);
    let Some(mm) = millimetres(unit) else {
        let [width, height, depth] = [width, height, depth].map(|x| digits(x, largest));
        return format!("{height} tall, {width} wide, {depth} deep in a unit that nobody declared");
    };
    // In what one would say of things as large as this.
    let (name, in_mm) = match largest * mm {
        mm if mm >= 1000.0 => ("m", 1000.0),
        mm if mm >= 100.0 => ("cm", 10.0),
        _ => ("mm", 1.0),
    };
    let [width, height, depth] =
        [width, height, depth].map(|x| digits(x * mm / in_mm, largest * mm / in_mm));
    format!(
        "{height} {name} tall, {width} {name} wide, {depth} {name} deep; coordinates are taken as {}",
        unit.name()
    )
}

/// As many digits after the point as give the largest of some lengths three digits.
fn digits(value: f64, largest: f64) -> String {
    let before = if largest > 0.0 { largest.log10().floor() } else { 0.0 };
    let after = (2.0 - before).clamp(0.0, 12.0) as usize;
    format!("{value:.after$}")
}

/// The unit of a file: what its header says, or what is declared where that says nothing.
///
/// # Errors
/// When both say something else.
pub fn unit_of(header: Unit, declared: Option<Unit>) -> Result<Unit, RenderError> {
    match (header, declared) {
        (known, None) => Ok(known),
        (Unit::Unknown, Some(declared)) => Ok(declared),
        (known, Some(declared)) if known == declared => Ok(known),
        (known, Some(declared)) => Err(RenderError::Usage(format!(
            "--unit {}: the file says that its unit is {}",
            declared.name(),
            known.name()
        ))),
    }
}

/// Reads `1:5`, the picture's length before the statue's: how many times the statue is larger.
///
/// # Errors
/// What was expected.
pub fn parse_reduction(text: &str) -> Result<f64, String> {
    let part = |part: &str| part.trim().parse::<f64>().ok().filter(|v| *v > 0.0 && v.is_finite());
    let parsed =
        text.split_once(':').and_then(|(paper, statue)| Some(part(statue)? / part(paper)?));
    match parsed {
        Some(reduction) if (1e-6..=1e9).contains(&reduction) => Ok(reduction),
        _ => Err("expected a scale such as 1:5".into()),
    }
}

/// Reads pixels in an inch.
///
/// # Errors
/// What was expected.
pub fn parse_dpi(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(dpi) if (1.0..=100_000.0).contains(&dpi) => Ok(dpi),
        _ => Err("expected 1 to 100000 pixels in an inch".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_said_in_units_that_suit_them_or_in_none() {
        let said = size_in_words([389.4, 1843.2, 240.2], Unit::Millimetre);
        assert_eq!(said, "1.84 m tall, 0.39 m wide, 0.24 m deep; coordinates are taken as mm");
        let said = size_in_words([0.02, 0.0155, 0.0121], Unit::Metre);
        assert_eq!(said, "15.5 mm tall, 20.0 mm wide, 12.1 mm deep; coordinates are taken as m");
        let said = size_in_words([0.156, 0.154, 0.121], Unit::Unknown);
        assert_eq!(said, "0.154 tall, 0.156 wide, 0.121 deep in a unit that nobody declared");
        assert!(size_in_words([0.0; 3], Unit::Unknown).starts_with("0.00 tall"));
    }

    #[test]
    fn a_pixel_is_as_long_as_scale_and_resolution_say() {
        let scale = Scale { reduction: parse_reduction("1:5").unwrap(), dpi: 254.0 };
        assert!((scale.pixel_mm() - 0.5).abs() < 1e-12);
        assert!((scale.pixel_in(Unit::Metre).unwrap() - 0.0005).abs() < 1e-15);
        assert_eq!(scale.name(), "1 : 5");
        let twice = Scale { reduction: parse_reduction("2:1").unwrap(), dpi: 254.0 };
        assert!((twice.pixel_in(Unit::Millimetre).unwrap() - 0.05).abs() < 1e-12);
        assert_eq!(twice.name(), "2 : 1");
    }

    #[test]
    fn what_is_no_scale_is_refused() {
        for text in ["0:5", "1:0", "5", "1:-2", "1:inf", "a:b", "1:1e30", ""] {
            assert!(parse_reduction(text).is_err(), "{text}");
        }
        assert!(["0", "-3", "NaN", "1e9"].iter().all(|text| parse_dpi(text).is_err()));
        let scale = Scale { reduction: 1.0, dpi: 300.0 };
        assert!(scale.pixel_in(Unit::Unknown).unwrap_err().is_usage());
        assert!(unit_of(Unit::Metre, Some(Unit::Inch)).is_err());
        assert_eq!(unit_of(Unit::Unknown, Some(Unit::Inch)).unwrap(), Unit::Inch);
    }
}
