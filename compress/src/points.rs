//! Points that cover a surface: the content of pages where triangles would not pay.

use crate::{OctNormal, Scalars};

/// How far round a point the surface counts as covered by it: a quarter of an octave a step, from a
/// quarter of a lattice step up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PointRadius(pub u8);

/// 2^(i/4), rounded to multiples of 2⁻²⁰.
const QUARTERS: [f64; 4] =
    [1.0, 1_246_974.0 / 1_048_576.0, 1_482_910.0 / 1_048_576.0, 1_763_487.0 / 1_048_576.0];

impl PointRadius {
    /// The smallest radius of at least so many lattice steps; the largest there is where none is.
    pub fn at_least(steps: f64) -> PointRadius {
        let all = (0..=u8::MAX).map(PointRadius);
        let mut low = 0u16;
        let mut high = all.len() as u16 - 1;
        while low < high {
            let middle = (low + high) / 2;
            if PointRadius(middle as u8).steps() >= steps {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        PointRadius(low as u8)
    }

    /// The radius in lattice steps.
    pub fn steps(self) -> f64 {
        let octave = (1u64 << (self.0 / 4)) as f64 / 4.0;
        octave * QUARTERS[usize::from(self.0 % 4)]
    }
}

/// Points from the first on that cover what all do, with larger radii.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PointPrefix {
    /// One for each of them.
    pub radii: Vec<PointRadius>,
}

/// Points on the file's lattice, in progressive order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Points {
    /// Positions in lattice steps.
    pub positions: Vec<[i32; 3]>,
    /// Unit normals.
    pub normals: Vec<OctNormal>,
    /// sRGB and alpha, or empty where the model has no colour.
    pub colours: Vec<[u8; 4]>,
    /// Kept scalars, or empty where none has a value.
    pub scalars: Vec<Scalars>,
    /// What each point covers: a ball round it.
    pub radii: Vec<PointRadius>,
    /// Prefixes that cover, shorter than all, in growing length: at smaller sizes on screen the
    /// rest can be left out.
    pub prefixes: Vec<PointPrefix>,
}

impl Points {
    /// The most prefixes.
    pub const PREFIXES_MAX: usize = 3;

    /// How many there are.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Whether points carry a colour.
    pub fn has_colours(&self) -> bool {
        !self.colours.is_empty()
    }

    /// Says what is inconsistent about the points, if anything is.
    ///
    /// # Errors
    /// A sentence that names the first thing wrong.
    pub fn validate(&self) -> Result<(), String> {
        let count = self.len();
        if self.normals.len() != count || self.radii.len() != count {
            let (normals, radii) = (self.normals.len(), self.radii.len());
            return Err(format!("{normals} normals and {radii} radii for {count} points"));
        }
        if self.has_colours() && self.colours.len() != count {
            return Err(format!("{} colours for {count} points", self.colours.len()));
        }
        if !self.scalars.is_empty() && self.scalars.len() != count {
            return Err(format!("{} scalars for {count} points", self.scalars.len()));
        }
        if let Some(i) = self.normals.iter().position(|n| !n.is_valid()) {
            return Err(format!("normal {i} lies off the octahedron"));
        }
        let mut before = 0;
        for prefix in &self.prefixes {
            if prefix.radii.len() <= before || prefix.radii.len() >= count {
                return Err(format!("a prefix of {} of {count} points", prefix.radii.len()));
            }
            before = prefix.radii.len();
        }
        if self.prefixes.len() > Self::PREFIXES_MAX {
            return Err(format!("{} prefixes", self.prefixes.len()));
        }
        Ok(())
    }

    /// Smallest and largest coordinates in lattice steps, without radii; `None` without points.
    pub fn bounds(&self) -> Option<([i32; 3], [i32; 3])> {
        crate::mesh::bounds_of(&self.positions)
    }

    /// The largest radius in lattice steps; 0 without points.
    pub fn largest_radius_steps(&self) -> f64 {
        self.radii.iter().max().map_or(0.0, |radius| radius.steps())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_are_never_smaller_than_asked() {
        for code in 0..255u8 {
            let (here, next) = (PointRadius(code).steps(), PointRadius(code + 1).steps());
            assert!(next / here > 1.189 && next / here < 1.1893, "{code}");
            assert_eq!(PointRadius::at_least(here), PointRadius(code));
            assert_eq!(PointRadius::at_least(here * 1.0001), PointRadius(code + 1));
        }
        assert_eq!(PointRadius::at_least(0.0), PointRadius(0));
        assert_eq!(PointRadius::at_least(1e30), PointRadius(255));
    }
}
