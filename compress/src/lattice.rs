//! The one integer lattice on which every position of a file lies.

use crate::{CellKey, FormatError, MAX_DEPTH};

/// Positions are integers `p`; the model-unit position is `origin + step · p`.
///
/// The root cube spans `0..=root_units` on every axis. `root_units` is divisible by
/// `2^depth_max`, so the faces of every cell down to that depth are lattice planes, and every
/// sub-grid `2^k` with `k ≤ depth_max − depth` contains the faces of the cells of that depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// Lattice point (0, 0, 0) in the source's coordinates and unit.
    pub origin: [f64; 3],
    /// Edge of a lattice cell in the source's unit: the leaves' precision.
    pub step: f64,
    /// Edge of the root cube in steps, at most 2³⁰.
    pub root_units: u32,
    /// Deepest level whose cells have integer faces.
    pub depth_max: u8,
}

impl Lattice {
    /// The most steps along an edge of the root cube.
    pub const ROOT_UNITS_MAX: u32 = 1 << 30;

    /// The lattice of a model with bounds `min..=max` and at least the precision `step`, whose
    /// root cube is the smallest that has integer cell faces.
    ///
    /// The step is enlarged where 2³⁰ steps would not span the model.
    ///
    /// # Panics
    /// When bounds are not finite or `step` is not positive.
    pub fn enclosing(min: [f64; 3], max: [f64; 3], step: f64) -> Lattice {
        assert!(step > 0.0 && step.is_finite() && (0..3).all(|i| min[i] <= max[i]));
        let extent = (0..3).map(|i| max[i] - min[i]).fold(0.0, f64::max);
        let step = step.max(extent / f64::from(Self::ROOT_UNITS_MAX / 2));
        let units = (extent / step).ceil().max(1.0) as u32 + 1;
        // Rounding up to a multiple of 2^depth_max may waste at most 1/64 of the edge.
        let depth_max = ((32 - units.leading_zeros()) as u8).saturating_sub(7).min(MAX_DEPTH);
        let root_units = units.next_multiple_of(1 << depth_max);
        // The slack goes to both sides evenly, in whole steps, so that a quantised scan whose
        // minimum lies on its own grid stays on it.
        let origin = std::array::from_fn(|i| {
            let used = ((max[i] - min[i]) / step).ceil();
            min[i] - step * ((f64::from(root_units) - used) / 2.0).floor()
        });
        Lattice { origin, step, root_units, depth_max }
    }

    /// The nearest lattice point, clamped to the root cube.
    pub fn quantise(&self, position: [f64; 3]) -> [i32; 3] {
        std::array::from_fn(|i| {
            let units = ((position[i] - self.origin[i]) / self.step).round();
            units.clamp(0.0, f64::from(self.root_units)) as i32
        })
    }

    /// A lattice point in the source's coordinates.
    pub fn position(&self, units: [i32; 3]) -> [f64; 3] {
        std::array::from_fn(|i| self.origin[i] + self.step * f64::from(units[i]))
    }

    /// Edge of the cells of a depth in steps.
    pub fn cell_units(&self, depth: u8) -> u32 {
        self.root_units >> depth
    }

    /// Edge of the cells of a depth in the source's unit.
    pub fn cell_edge(&self, depth: u8) -> f64 {
        f64::from(self.cell_units(depth)) * self.step
    }

    /// Lowest corner of a cell in steps.
    pub fn cell_min(&self, cell: CellKey) -> [i32; 3] {
        cell.index().map(|index| (index * self.cell_units(cell.depth())) as i32)
    }

    pub(crate) fn validate(&self) -> Result<(), FormatError> {
        let bad = |why: &str| Err(FormatError::malformed("header", why));
        if !(self.step > 0.0 && self.step.is_finite() && self.origin.iter().all(|x| x.is_finite()))
        {
            return bad("the lattice is not finite");
        }
        if self.depth_max > MAX_DEPTH
            || self.root_units == 0
            || self.root_units > Self::ROOT_UNITS_MAX
        {
            return bad("the lattice has no valid size");
        }
        if !self.root_units.is_multiple_of(1 << self.depth_max) {
            return bad("the lattice does not contain its cells' faces");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_quantised_scan_keeps_its_grid() {
        let step = 1.0 / 8191.0;
        let lattice = Lattice::enclosing([0.0, 3.0 * step, 0.0], [1.0, 0.5, 7.0 * step], step);
        for k in [0, 1, 17, 8191] {
            let x = f64::from(k) * step;
            assert!((lattice.position(lattice.quantise([x; 3]))[0] - x).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn the_root_cube_holds_the_model(
            min in prop::array::uniform3(-1e6..1e6f64),
            size in prop::array::uniform3(0.0..1e5f64),
            step in 1e-6..10.0f64,
        ) {
            let max = std::array::from_fn(|i| min[i] + size[i]);
            let lattice = Lattice::enclosing(min, max, step);
            lattice.validate().unwrap();
            for corner in [min, max] {
                let back = lattice.position(lattice.quantise(corner));
                for i in 0..3 {
                    prop_assert!((back[i] - corner[i]).abs() <= lattice.step * 0.500001 + 1e-9);
                }
            }
            let extent = size.iter().fold(0.0, |a: f64, &b| a.max(b));
            prop_assert!(lattice.cell_edge(0) <= (extent / lattice.step + 2.0) * (1.0 + 1.0 / 63.0) * lattice.step + lattice.step);
        }
    }
}
