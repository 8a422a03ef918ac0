//! Colours are stored as sRGB and averaged in linear light.

use hlod_compress::srgb::{linear_from_srgb, srgb_from_linear};

/// The colour a fraction `t` of the way from `a` to `b`, mixed in linear light; alpha is linear.
pub(crate) fn mix_srgba(a: [u8; 4], b: [u8; 4], t: f32) -> [u8; 4] {
    average_srgba([(a, 1.0 - t), (b, t)])
}

/// The weighted mean of colours in linear light; black and transparent for no weight at all.
pub(crate) fn average_srgba(colours: impl IntoIterator<Item = ([u8; 4], f32)>) -> [u8; 4] {
    let mut sum = [0.0; 4];
    let mut weights = 0.0;
    for (colour, weight) in colours {
        for i in 0..3 {
            sum[i] += weight * linear_from_srgb(colour[i]);
        }
        sum[3] += weight * f32::from(colour[3]);
        weights += weight;
    }
    if weights <= 0.0 {
        return [0; 4];
    }
    let [r, g, b, alpha] = sum.map(|s| s / weights);
    [srgb_from_linear(r), srgb_from_linear(g), srgb_from_linear(b), alpha.round() as u8]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_and_white_mix_to_the_grey_of_half_the_light() {
        assert_eq!(mix_srgba([0, 0, 0, 0], [255; 4], 0.5), [188, 188, 188, 128]);
    }
}
