//! Colours for numbers: viridis, whose steps look equally large, also to those who see fewer colours and in
//! print without any (Smith & van der Walt, *A Better Default Colormap for Matplotlib*, SciPy 2015; CC0).
//!
//! As polynomials of the sixth degree, with coefficients of M. Zucker (2019, `shadertoy.com/view/WlfXRN`, CC0),
//! which are never farther than 4 of 255 from the table; `shaders/src/shade.wgsl` has the same.

use hlod_compress::Header;

/// Coefficients of 1, t, t², … for red, green and blue.
const COEFFICIENTS: [[f32; 3]; 7] = [
    [0.277_727_33, 0.005_407_34, 0.334_099_8],
    [0.105_093_04, 1.404_613_5, 1.384_590_2],
    [-0.330_861_83, 0.214_847_56, 0.095_095_16],
    [-4.634_230_5, -5.799_101, -19.332_44],
    [6.228_27, 14.179_933, 56.690_55],
    [4.776_385, -13.745_145, -65.353_03],
    [-5.435_456, 4.645_852_6, 26.312_435],
];

/// Which colours stand for numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColourMap {
    /// [`viridis`], from the least to the largest.
    #[default]
    Viridis,
    /// [`bend_colour`], to both sides of nothing.
    Bend,
}

impl ColourMap {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            ColourMap::Viridis => "viridis",
            ColourMap::Bend => "blue, white, orange",
        }
    }

    /// sRGB of a place between the least number, 0, and the largest, 1.
    pub fn colour(self, t: f32) -> [u8; 3] {
        match self {
            ColourMap::Viridis => viridis(t),
            ColourMap::Bend => bend_colour(2.0 * t - 1.0),
        }
    }
}

/// By how much, in degrees, the surface turns within the radius where colours of bends are strongest;
/// `TURN_MAX` in `shaders/src/shade.wgsl`.
pub const TURN_MAX_DEG: f64 = 15.0;

/// sRGB of a bend, −1 where it is hollow to 1 where it bulges: blue, white and orange, which few confuse;
/// `shaders/src/shade.wgsl` has the same.
pub fn bend_colour(bend: f32) -> [u8; 3] {
    let bend = bend.clamp(-1.0, 1.0);
    let end: [f32; 3] = if bend < 0.0 { [0.13, 0.40, 0.67] } else { [0.70, 0.35, 0.02] };
    end.map(|end| ((0.97 + (end - 0.97) * bend.abs()) * 255.0).round() as u8)
}

/// sRGB where there is no value: grey, which the map has nowhere.
pub const NO_VALUE: [u8; 3] = [122, 122, 122];

/// sRGB of a number's place between the least, 0, and the largest, 1.
pub fn viridis(t: f32) -> [u8; 3] {
    let t = t.clamp(0.0, 1.0);
    std::array::from_fn(|i| {
        let value = COEFFICIENTS.iter().rev().fold(0.0, |sum, c| sum * t + c[i]);
        (value.clamp(0.0, 1.0) * 255.0).round() as u8
    })
}

/// The bounds, in the source's unit, between which colours of bounds tell them apart: the leaves' precision and what
/// a root may err. The same for every picture of a file.
pub fn bounds_shown(header: &Header) -> [f64; 2] {
    let step = header.lattice.step;
    let root = step * f64::from(header.lattice.root_units) / f64::from(header.resolution.max(1));
    [step, root.max(step)]
}

/// sRGB of a bound on a surface's distance from the scan, in the unit of `bounds`: equal steps for equal ratios. The
/// scan itself, which errs by nothing, is grey.
pub fn bound_colour(bound: f64, [least, most]: [f64; 2]) -> [u8; 3] {
    if bound <= 0.0 {
        return NO_VALUE;
    }
    let place = (bound / least).ln() / (most / least).max(1.0 + 1e-9).ln();
    viridis(place as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hlod_compress::srgb::linear_from_srgb;

    #[test]
    fn bounds_have_equal_steps_for_equal_ratios() {
        let of = |bound| bound_colour(bound, [0.01, 1.0]);
        assert_eq!((of(0.0), of(0.01), of(1.0)), (NO_VALUE, viridis(0.0), viridis(1.0)));
        assert_eq!((of(0.1), of(1e-9)), (viridis(0.5), viridis(0.0)));
        assert_ne!(of(0.1), of(0.2));
        // A file of one level has nothing between.
        assert_eq!(bound_colour(0.5, [1.0, 1.0]), viridis(0.0));
    }

    /// Against the table, and a map with red and blue exchanged is told apart.
    #[test]
    fn it_is_viridis() {
        let farthest = |map: &dyn Fn(f32) -> [u8; 3]| {
            let apart = |i: usize| {
                let table: [u8; 3] = colorous::VIRIDIS.eval_rational(i, 256).into_array();
                std::array::from_fn::<u8, 3, _>(|c| map(i as f32 / 255.0)[c].abs_diff(table[c]))
            };
            (0..256).flat_map(apart).max().unwrap()
        };
        assert!(farthest(&viridis) <= 4);
        let exchanged = |t: f32| {
            let [r, g, b] = viridis(t);
            [b, g, r]
        };
        assert!(farthest(&exchanged) > 50);
        assert_eq!((viridis(-1.0), viridis(2.0)), (viridis(0.0), viridis(1.0)));
    }

    /// Lightness grows from end to end: the order is seen without colours.
    #[test]
    fn more_is_lighter() {
        let lightness = |t: f32| {
            let [r, g, b] = viridis(t).map(linear_from_srgb);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        for i in 0..64 {
            let (here, next) = (i as f32 / 64.0, (i + 1) as f32 / 64.0);
            assert!(lightness(next) > lightness(here), "{here}");
        }
    }
}
