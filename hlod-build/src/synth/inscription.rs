//! What is cut into the panel: two lines of capitals, a straight groove, and two lines that
//! meet at an angle. One table serves the field and the description.

use super::field::Cut;
use super::relief::Panel;
use serde::Serialize;
use std::f64::consts::FRAC_1_SQRT_2;

/// Width of a V-cut at the plane over its depth: an included angle of 120°.
pub const WIDTH_PER_DEPTH: f64 = 3.464_101_615_137_754_6;

/// Depth of each letter in hundredths of a millimetre, in reading order.
const DEPTHS: [u32; 18] = [100, 95, 90, 85, 80, 75, 70, 65, 60, 55, 50, 45, 40, 35, 30, 25, 20, 10];

/// The lines: text, height of letters, y of the baseline, mm. A dot parts words.
const LINES: [(&str, f64, f64); 2] = [("FORMA·MANET", 24.0, 92.0), ("IN·LAPIDE", 20.0, 60.0)];

/// Depth of the dots between words, mm.
const DOT_DEPTH: f64 = 0.5;

/// The straight groove: both ends, depth and width, mm.
pub const GROOVE: ([[f64; 2]; 2], f64, f64) = ([[-124.0, 34.0], [-24.0, 34.0]], 0.8, 2.4);

/// The angle: vertex, length of its sides, depth, width, mm; its first side runs along +x.
pub const ANGLE: ([f64; 2], f64, f64, f64) = ([40.0, 24.0], 50.0, 0.5, 1.5);
/// The angle in degrees, and the direction of its second side.
pub const ANGLE_DEGREES: f64 = 37.5;
/// Cosine and sine of [`ANGLE_DEGREES`].
pub const ANGLE_DIRECTION: [f64; 2] = [0.793_353_340_291_235_2, 0.608_761_429_008_720_6];

/// One letter as it is cut.
#[derive(Clone, Debug, Serialize)]
pub struct Letter {
    /// The letter; `·` is the dot between words.
    pub character: char,
    /// Left end of its baseline, mm.
    pub baseline_mm: [f64; 3],
    /// Height of capitals, mm (the middle of strokes).
    pub height_mm: f64,
    /// Depth of the V below the panel, mm.
    pub depth_mm: f64,
    /// Width of the V at the panel, mm.
    pub width_mm: f64,
    /// Strokes as polylines in the panel's plane, mm.
    pub strokes_mm: Vec<Vec<[f64; 3]>>,
}

/// Strokes of a capital in units of its height, and its width. Curves are chords of arcs.
fn glyph(character: char) -> (f64, Vec<Vec<[f64; 2]>>) {
    // Eight chords a half circle bulging to the right, from the upper end to the lower.
    let bow = |x: f64, bottom: f64, top: f64, reach: f64| -> Vec<[f64; 2]> {
        const HALF_TURN: [[f64; 2]; 9] = [
            [0.0, 1.0],
            [0.382_683_432, 0.923_879_533],
            [FRAC_1_SQRT_2, FRAC_1_SQRT_2],
            [0.923_879_533, 0.382_683_432],
            [1.0, 0.0],
            [0.923_879_533, -0.382_683_432],
            [FRAC_1_SQRT_2, -FRAC_1_SQRT_2],
            [0.382_683_432, -0.923_879_533],
            [0.0, -1.0],
        ];
        let (middle, half) = ((bottom + top) / 2.0, (top - bottom) / 2.0);
        HALF_TURN.iter().map(|[c, s]| [x + reach * c, middle + half * s]).collect()
    };
    let stem = || vec![[0.0, 0.0], [0.0, 1.0]];
    match character {
        'A' => (
            0.86,
            vec![vec![[0.0, 0.0], [0.43, 1.0], [0.86, 0.0]], vec![[0.155, 0.36], [0.705, 0.36]]],
        ),
        'D' => {
            let mut curve = vec![[0.0, 1.0]];
            curve.extend(bow(0.28, 0.0, 1.0, 0.5));
            curve.push([0.0, 0.0]);
            (0.78, vec![stem(), curve])
        }
        'E' => (
            0.52,
            vec![
                vec![[0.52, 1.0], [0.0, 1.0], [0.0, 0.0], [0.52, 0.0]],
                vec![[0.0, 0.52], [0.44, 0.52]],
            ],
        ),
        'F' => {
            (0.5, vec![vec![[0.5, 1.0], [0.0, 1.0], [0.0, 0.0]], vec![[0.0, 0.52], [0.42, 0.52]]])
        }
        'I' => (0.0, vec![stem()]),
        'L' => (0.5, vec![vec![[0.0, 1.0], [0.0, 0.0], [0.5, 0.0]]]),
        'M' => (0.98, vec![vec![[0.0, 0.0], [0.14, 1.0], [0.49, 0.1], [0.84, 1.0], [0.98, 0.0]]]),
        'N' => (0.8, vec![vec![[0.0, 0.0], [0.0, 1.0], [0.8, 0.0], [0.8, 1.0]]]),
        'O' => {
            let mut ring = bow(0.49, 0.0, 1.0, 0.49);
            let mut left = bow(0.49, 1.0, 0.0, -0.49);
            ring.append(&mut left.split_off(1));
            (0.98, vec![ring])
        }
        'P' | 'R' => {
            let mut curve = vec![[0.0, 1.0]];
            curve.extend(bow(0.26, 0.48, 1.0, 0.27));
            curve.push([0.0, 0.48]);
            let mut strokes = vec![stem(), curve];
            if character == 'R' {
                strokes.push(vec![[0.26, 0.48], [0.62, 0.0]]);
            }
            (if character == 'R' { 0.62 } else { 0.53 }, strokes)
        }
        'T' => (0.66, vec![vec![[0.0, 1.0], [0.66, 1.0]], vec![[0.33, 1.0], [0.33, 0.0]]]),
        '·' => (0.06, vec![vec![[0.0, 0.5], [0.06, 0.5]]]),
        other => unreachable!("no glyph for {other:?}"),
    }
}

/// All letters and dots, in reading order.
pub fn letters() -> Vec<Letter> {
    let mut depths = DEPTHS.iter();
    let mut letters = Vec::new();
    for (text, height, baseline) in LINES {
        // Centre the line; space letters by a quarter of their height.
        let gap = 0.27 * height;
        let width: f64 = text.chars().map(|c| glyph(c).0 * height + gap).sum::<f64>() - gap;
        let mut x = -width / 2.0;
        for character in text.chars() {
            let (advance, strokes) = glyph(character);
            let depth = match character {
                '·' => DOT_DEPTH,
                _ => depths.next().map_or(DOT_DEPTH, |d| f64::from(*d) / 100.0),
            };
            let place = |p: &[f64; 2]| [x + p[0] * height, baseline + p[1] * height, Panel::FRONT];
            letters.push(Letter {
                character,
                baseline_mm: [x, baseline, Panel::FRONT],
                height_mm: height,
                depth_mm: depth,
                width_mm: depth * WIDTH_PER_DEPTH,
                strokes_mm: strokes.iter().map(|s| s.iter().map(place).collect()).collect(),
            });
            x += advance * height + gap;
        }
    }
    letters
}

/// Every straight cut of the panel.
pub fn cuts() -> impl Iterator<Item = Cut> {
    let cut = |a: [f64; 2], b: [f64; 2], depth: f64, width: f64| Cut {
        a: a.map(|v| v as f32),
        b: b.map(|v| v as f32),
        depth: depth as f32,
        half_width: (width / 2.0) as f32,
    };
    let mut all = Vec::new();
    for letter in letters() {
        for stroke in &letter.strokes_mm {
            for w in stroke.windows(2) {
                let flat = |p: [f64; 3]| [p[0], p[1]];
                all.push(cut(flat(w[0]), flat(w[1]), letter.depth_mm, letter.width_mm));
            }
        }
    }
    let ([a, b], depth, width) = GROOVE;
    all.push(cut(a, b, depth, width));
    let (vertex, length, depth, width) = ANGLE;
    for direction in [[1.0, 0.0], ANGLE_DIRECTION] {
        let end = [vertex[0] + length * direction[0], vertex[1] + length * direction[1]];
        all.push(cut(vertex, end, depth, width));
    }
    all.into_iter()
}
