//! What whoever builds a file declares: units, axes, what levels are drawn with.

/// The unit of the source's coordinates, as declared by whoever built the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Unit {
    /// Nobody said.
    #[default]
    Unknown,
    /// Micrometres.
    Micrometre,
    /// Millimetres.
    Millimetre,
    /// Centimetres.
    Centimetre,
    /// Metres.
    Metre,
    /// Inches.
    Inch,
}

impl Unit {
    pub(crate) const ALL: [(Unit, &'static str); 6] = [
        (Unit::Unknown, "unknown"),
        (Unit::Micrometre, "um"),
        (Unit::Millimetre, "mm"),
        (Unit::Centimetre, "cm"),
        (Unit::Metre, "m"),
        (Unit::Inch, "in"),
    ];

    /// The usual abbreviation, or `unknown`.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

impl std::str::FromStr for Unit {
    type Err = String;
    fn from_str(text: &str) -> Result<Unit, String> {
        let found = Self::ALL.iter().find(|(_, name)| *name == text);
        found.map(|(unit, _)| *unit).ok_or_else(|| "expected mm, cm, m, um, in or unknown".into())
    }
}

/// What levels above the leaves are drawn with, where the scan has triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
#[non_exhaustive]
#[repr(u8)]
pub enum Primitives {
    /// Triangles.
    #[default]
    Triangles = 0,
    /// Triangles, and points where triangles are smaller than a pixel and points cost less.
    Hybrid = 1,
    /// Points.
    Points = 2,
}

impl Primitives {
    pub(crate) const ALL: [(Primitives, &'static str); 3] = [
        (Primitives::Triangles, "triangles"),
        (Primitives::Hybrid, "hybrid"),
        (Primitives::Points, "points"),
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

impl std::str::FromStr for Primitives {
    type Err = String;
    fn from_str(text: &str) -> Result<Primitives, String> {
        let found = Self::ALL.iter().find(|(_, name)| *name == text);
        found
            .map(|(primitives, _)| *primitives)
            .ok_or_else(|| "expected triangles, hybrid or points".into())
    }
}

/// A coordinate axis with a sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SignedAxis {
    /// 0, 1 or 2 for x, y or z.
    pub axis: u8,
    /// Whether it points towards negative coordinates.
    pub negative: bool,
}

impl SignedAxis {
    /// +y, the most common up direction of scans.
    pub const PLUS_Y: SignedAxis = SignedAxis { axis: 1, negative: false };
    /// +z.
    pub const PLUS_Z: SignedAxis = SignedAxis { axis: 2, negative: false };

    /// As a unit vector.
    pub fn direction(self) -> [f64; 3] {
        let mut v = [0.0; 3];
        v[usize::from(self.axis)] = if self.negative { -1.0 } else { 1.0 };
        v
    }
}

impl std::str::FromStr for SignedAxis {
    type Err = String;
    fn from_str(text: &str) -> Result<SignedAxis, String> {
        let (negative, letter) = match text.strip_prefix('-') {
            Some(rest) => (true, rest),
            None => (false, text.strip_prefix('+').unwrap_or(text)),
        };
        let axis = ["x", "y", "z"].iter().position(|l| *l == letter);
        axis.map(|axis| SignedAxis { axis: axis as u8, negative })
            .ok_or_else(|| "expected +x, -x, +y, -y, +z or -z".into())
    }
}

impl std::fmt::Display for SignedAxis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let sign = if self.negative { '-' } else { '+' };
        write!(f, "{sign}{}", ["x", "y", "z"][usize::from(self.axis)])
    }
}
