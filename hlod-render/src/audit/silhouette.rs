//! Distances between outlines.

use super::distance_transform::squared_distances;

/// Positions along each side of a pixel.
pub const SUBPIXELS: u32 = 8;

/// What is covered, at [`SUBPIXELS`] positions a pixel.
#[derive(Debug, Clone)]
pub struct Mask {
    /// Positions in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Whether something is drawn there.
    pub covered: Vec<bool>,
}

/// Distances from the scored positions of one outline to another.
#[derive(Debug, Clone, Default)]
pub struct Scores {
    distances_px: Vec<f32>,
    /// Positions that were not scored.
    unscored: u64,
}

impl Scores {
    /// Adds another view's.
    pub fn merge(&mut self, other: &Scores) {
        self.distances_px.extend_from_slice(&other.distances_px);
        self.unscored += other.unscored;
    }

    /// Number of positions that were scored.
    pub fn count(&self) -> u64 {
        self.distances_px.len() as u64
    }

    /// The smallest distance in pixels that `share` of all do not exceed; 0 where none was scored.
    pub fn percentile(&self, share: f64) -> f64 {
        let mut sorted = self.distances_px.clone();
        sorted.sort_by(f32::total_cmp);
        let at = ((share * sorted.len() as f64).ceil() as usize).max(1) - 1;
        sorted.get(at).or(sorted.last()).map_or(0.0, |&d| f64::from(d))
    }
}

/// Share of all outline positions that was scored.
pub fn scored_share(scores: &[Scores; 2]) -> f64 {
    let scored: u64 = scores.iter().map(|s| s.distances_px.len() as u64).sum();
    let unscored: u64 = scores.iter().map(|s| s.unscored).sum();
    if scored + unscored == 0 { 1.0 } else { scored as f64 / (scored + unscored) as f64 }
}

/// From the drawing's outline to the reference's, and back.
pub fn compare(drawn: &Mask, truth: &Mask) -> [Scores; 2] {
    let [scores] = compare_where(drawn, truth, [&|_, _| true]);
    scores
}

/// Whether the outline at a position (column, row) belongs to a class.
pub type Class<'a> = &'a dyn Fn(usize, usize) -> bool;

/// The same for the positions of some classes. The nearest position of the other outline may belong
/// to any.
pub fn compare_where<const N: usize>(
    drawn: &Mask,
    truth: &Mask,
    classes: [Class<'_>; N],
) -> [[Scores; 2]; N] {
    // Only where something is: most of a picture is background.
    let Some(crop) = Crop::around(&[drawn, truth]) else {
        return std::array::from_fn(|_| Default::default());
    };
    let (drawn, truth) = (crop.of(drawn), crop.of(truth));
    let outlines = [&drawn, &truth].map(outline);
    let [to_drawn, to_truth] = [&outlines[0], &outlines[1]]
        .map(|outline| squared_distances(crop.width(), crop.height(), |p| outline[p]));
    let unstable = [&drawn, &truth].map(unstable);
    classes.map(|class| {
        let class =
            |p: usize| class(crop.x.start + p % crop.width(), crop.y.start + p / crop.width());
        [
            collect(&unstable[0], &outlines[0], &to_truth, &class),
            collect(&unstable[1], &outlines[1], &to_drawn, &class),
        ]
    })
}

fn collect(
    unstable: &[bool],
    outline: &[bool],
    to_other: &[f32],
    class: &dyn Fn(usize) -> bool,
) -> Scores {
    let mut scores = Scores::default();
    for p in (0..outline.len()).filter(|&p| outline[p] && class(p)) {
        if unstable[p] {
            scores.unscored += 1;
        } else {
            scores.distances_px.push(to_other[p].sqrt() / SUBPIXELS as f32);
        }
    }
    scores
}

/// Covered positions with an uncovered neighbour. The picture's own edge is no outline.
fn outline(mask: &Mask) -> Vec<bool> {
    let (w, h) = (mask.width, mask.height);
    (0..w * h)
        .map(|p| {
            let (x, y) = (p % w, p / w);
            mask.covered[p]
                && (x > 0 && !mask.covered[p - 1]
                    || x + 1 < w && !mask.covered[p + 1]
                    || y > 0 && !mask.covered[p - w]
                    || y + 1 < h && !mask.covered[p + w])
        })
        .collect()
}

/// Positions within a pixel of a feature that an opening or closing by a disc of one pixel
/// removes.
fn unstable(mask: &Mask) -> Vec<bool> {
    let radius = SUBPIXELS as f32;
    // Positions are at their cells' centres: a disc fits if no outside centre is nearer.
    let grown = |inside: &[bool], by: f32| -> Vec<bool> {
        let distances = squared_distances(mask.width, mask.height, |p| inside[p]);
        distances.iter().map(|d| *d <= by * by).collect()
    };
    let shrunk = |inside: &[bool], by: f32| -> Vec<bool> {
        let distances = squared_distances(mask.width, mask.height, |p| !inside[p]);
        distances.iter().map(|d| *d > by * by).collect()
    };
    let opened = grown(&shrunk(&mask.covered, radius), radius);
    let closed = shrunk(&grown(&mask.covered, radius), radius);
    let outside = |inside: &[bool]| -> Vec<bool> { inside.iter().map(|i| !i).collect() };
    // Rounding to positions changes single ones along every curved outline: those touch what
    // stays. A slit or a pinhole does not, however thin.
    let removed = |before: &[bool], after: &[bool]| -> Vec<bool> {
        let near_what_stays = grown(after, 1.5);
        (0..before.len()).map(|p| before[p] && !near_what_stays[p]).collect()
    };
    let thorns = removed(&mask.covered, &opened);
    let slits = removed(&outside(&mask.covered), &outside(&closed));
    let deep: Vec<bool> = thorns.iter().zip(&slits).map(|(thorn, slit)| *thorn || *slit).collect();
    grown(&deep, radius)
}

/// A rectangle of positions.
struct Crop {
    x: std::ops::Range<usize>,
    y: std::ops::Range<usize>,
}

impl Crop {
    fn around(masks: &[&Mask]) -> Option<Crop> {
        let (w, h) = (masks[0].width, masks[0].height);
        let margin = 4 * SUBPIXELS as usize;
        let any = |p: usize| masks.iter().any(|m| m.covered[p]);
        let y0 = (0..h).find(|y| (0..w).any(|x| any(y * w + x)))?;
        let y1 = (0..h).rfind(|y| (0..w).any(|x| any(y * w + x)))?;
        let (mut x0, mut x1) = (w, 0);
        for y in y0..=y1 {
            x0 = x0.min((0..w).find(|x| any(y * w + x)).unwrap_or(w));
            x1 = x1.max((0..w).rfind(|x| any(y * w + x)).unwrap_or(0));
        }
        Some(Crop {
            x: x0.saturating_sub(margin)..(x1 + margin + 1).min(w),
            y: y0.saturating_sub(margin)..(y1 + margin + 1).min(h),
        })
    }

    fn width(&self) -> usize {
        self.x.len()
    }

    fn height(&self) -> usize {
        self.y.len()
    }

    fn of(&self, mask: &Mask) -> Mask {
        let rows = self.y.clone().flat_map(|y| &mask.covered[y * mask.width..][self.x.clone()]);
        Mask { width: self.width(), height: self.height(), covered: rows.copied().collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(inside: impl Fn(f64, f64) -> bool) -> Mask {
        let (width, height) = (60 * 8, 40 * 8);
        let at = |i: usize| (i as f64 + 0.5) / 8.0;
        let covered = (0..width * height).map(|p| inside(at(p % width), at(p / width))).collect();
        Mask { width, height, covered }
    }

    fn disc(x: f64, y: f64, radius: f64) -> Mask {
        mask(|px, py| (px - x).hypot(py - y) < radius)
    }

    fn worst(drawn: &Mask, truth: &Mask) -> f64 {
        let scores = compare(drawn, truth);
        assert!(scored_share(&scores) > 0.95, "share {}", scored_share(&scores));
        scores[0].percentile(0.999).max(scores[1].percentile(0.999))
    }

    #[test]
    fn equal_outlines_have_no_distance_and_moved_ones_have_theirs() {
        let truth = disc(30.0, 20.0, 12.0);
        assert_eq!(worst(&truth, &truth), 0.0);
        for shift in [0.5, 2.0] {
            let found = worst(&disc(30.0 + shift, 20.0, 12.0), &truth);
            assert!((found - shift).abs() < 0.2, "{found} for {shift}");
            let found = worst(&disc(30.0, 20.0, 12.0 + shift), &truth);
            assert!((found - shift).abs() < 0.2, "{found} for {shift}");
        }
    }

    #[test]
    fn a_bite_is_seen_from_the_other_side() {
        let truth = disc(30.0, 20.0, 12.0);
        let bitten =
            mask(|x, y| (x - 30.0).hypot(y - 20.0) < 12.0 && (x - 42.0).hypot(y - 20.0) > 4.0);
        assert!(worst(&bitten, &truth) > 1.5);
    }

    #[test]
    fn slits_thinner_than_a_pixel_are_counted_and_not_scored() {
        let truth = disc(30.0, 20.0, 12.0);
        let slit = mask(|x, y| (x - 30.0).hypot(y - 20.0) < 12.0 && !(29.8..30.4).contains(&x));
        let scores = compare(&slit, &truth);
        assert!(scores[0].unscored > 100);
        assert!(scores[0].percentile(0.999) < 0.5);
        let wide = mask(|x, y| (x - 30.0).hypot(y - 20.0) < 12.0 && !(28.5..31.5).contains(&x));
        assert!(compare(&wide, &truth)[0].percentile(0.99) > 2.0);
    }

    #[test]
    fn cracks_and_hairs_of_single_positions_are_not_scored_in_any_direction() {
        let truth = disc(30.0, 20.0, 12.0);
        for (turn, width) in [0.0, 0.3, 0.8, 1.3].into_iter().zip([0.13, 0.2, 0.3, 0.16]) {
            let (sin, cos) = f64::sin_cos(turn);
            let on_line = |x: f64, y: f64| {
                ((x - 30.0) * cos + (y - 20.0) * sin).abs() < width / 2.0
                    && ((y - 20.0) * cos - (x - 30.0) * sin).abs() < 18.0
            };
            let inside = |x: f64, y: f64| (x - 30.0).hypot(y - 20.0) < 12.0;
            for mask in [
                mask(|x, y| inside(x, y) && !on_line(x, y)),
                mask(|x, y| inside(x, y) || on_line(x, y)),
            ] {
                let scores = compare(&mask, &truth);
                assert!(scores[0].unscored > 50, "{turn}: {}", scores[0].unscored);
                // At the mouth, what is left of a feature may round off by a little.
                assert!(scores[0].percentile(1.0) < 0.7, "{turn}: {}", scores[0].percentile(1.0));
                assert_eq!(scores[1].unscored, 0);
                assert!(scores[1].percentile(1.0) < 0.7);
            }
        }
    }

    #[test]
    fn empty_pictures_have_no_outline() {
        let empty = mask(|_, _| false);
        assert_eq!(scored_share(&compare(&empty, &empty)), 1.0);
        assert!(compare(&empty, &disc(30.0, 20.0, 12.0))[1].percentile(0.5).is_infinite());
    }
}
