//! How wide the slit between the lines of two nodes is, in their common face. All in lattice steps.

use glam::DVec2;

use crate::skirts::FaceLines;

/// A part of a face: lowest and highest corner, both within.
pub(super) type Square = [[i32; 2]; 2];

pub(super) fn holds([low, high]: &Square, p: [i32; 2]) -> bool {
    (0..2).all(|k| (low[k]..=high[k]).contains(&p[k]))
}

/// For each edge of either node's lines how wide the slit is there. Where both have to do with each other is a square, and
/// they are no farther apart than `bound`.
pub(super) fn widths(both: [&FaceLines; 2], square: &Square, bound: f64) -> [Vec<f64>; 2] {
    let mut widths = both.map(|lines| vec![0.0; lines.edges.len()]);
    let [a, b] = both;
    if a.edges.is_empty() && b.edges.is_empty() {
        return widths;
    }
    let distances = [distances(a, b, square, bound), distances(b, a, square, bound)];
    for (own, widths) in both.iter().zip(&mut widths) {
        for (edge, width) in own.edges.iter().zip(widths) {
            let ends = edge.points.map(|p| own.points[p as usize]);
            for (lines, distances) in both.iter().zip(&distances) {
                for_each_near(lines, &ends, bound, |k| {
                    if distances[k] > *width && distance(lines.points[k], &ends) <= bound {
                        *width = distances[k];
                    }
                });
            }
        }
    }
    widths
}

/// How far each point of lines in the square is from other lines; at most `bound`, and 0 outside.
fn distances(lines: &FaceLines, others: &FaceLines, square: &Square, bound: f64) -> Vec<f64> {
    let far = |p: &[i32; 2]| if holds(square, *p) { bound } else { 0.0 };
    let mut distances: Vec<f64> = lines.points.iter().map(far).collect();
    for edge in &others.edges {
        let ends = edge.points.map(|p| others.points[p as usize]);
        for_each_near(lines, &ends, bound, |k| {
            if distances[k] > 0.0 {
                distances[k] = distances[k].min(distance(lines.points[k], &ends));
            }
        });
    }
    distances
}

/// Numbers of the points that may be within `bound` of a segment.
fn for_each_near(
    lines: &FaceLines,
    ends: &[[i32; 2]; 2],
    bound: f64,
    mut visit: impl FnMut(usize),
) {
    let reach = bound.ceil() as i32;
    let [first, second] = [0, 1].map(|k| {
        let (a, b) = (ends[0][k], ends[1][k]);
        [a.min(b).saturating_sub(reach), a.max(b).saturating_add(reach)]
    });
    let (points, across) = (&lines.points, &lines.across);
    let begin = points.partition_point(|p| p[0] < first[0]);
    let end = points.partition_point(|p| p[0] <= first[1]);
    // Whichever way there are fewer: lines may run along either.
    let begin_across = across.partition_point(|&k| points[k as usize][1] < second[0]);
    let end_across = across.partition_point(|&k| points[k as usize][1] <= second[1]);
    let is_in = |c: i32, range: [i32; 2]| (range[0]..=range[1]).contains(&c);
    if end - begin <= end_across - begin_across {
        (begin..end).filter(|&k| is_in(points[k][1], second)).for_each(visit);
    } else {
        let found = across[begin_across..end_across].iter().map(|&k| k as usize);
        found.filter(|&k| is_in(points[k][0], first)).for_each(&mut visit);
    }
}

/// From a point to a segment.
fn distance(p: [i32; 2], ends: &[[i32; 2]; 2]) -> f64 {
    let at = |p: [i32; 2]| DVec2::new(p[0].into(), p[1].into());
    let (from, along) = (at(ends[0]), at(ends[1]) - at(ends[0]));
    let length2 = along.length_squared();
    let t = if length2 > 0.0 { ((at(p) - from).dot(along) / length2).clamp(0.0, 1.0) } else { 0.0 };
    at(p).distance(from + along * t)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::seams::LEANING;
    use crate::skirts::LineEdge;

    const ALL: Square = [[i32::MIN; 2], [i32::MAX; 2]];

    /// A line through these points, with a corner below each.
    pub(in crate::seams) fn line(mut points: Vec<[i32; 2]>) -> FaceLines {
        let in_order = points.clone();
        points.sort_unstable();
        let number = |p: &[i32; 2]| points.partition_point(|q| q < p) as u32;
        let edges = in_order.windows(2).map(|pair| {
            let points = [number(&pair[0]), number(&pair[1])];
            LineEdge { points, corners: points }
        });
        let edges = edges.collect();
        FaceLines::new(points, edges)
    }

    /// Of the first line alone.
    fn widths_of(own: &FaceLines, other: &FaceLines, square: &Square, bound: f64) -> Vec<f64> {
        let [of_own, of_other] = widths([own, other], square, bound);
        let turned = widths([other, own], square, bound);
        assert_eq!((&of_own, &of_other), (&turned[1], &turned[0]));
        of_own
    }

    #[test]
    fn distances_are_to_the_nearest_point_of_a_segment() {
        let ends = [[0, 0], [10, 0]];
        assert_eq!(distance([5, 3], &ends), 3.0);
        assert_eq!(distance([13, 4], &ends), 5.0);
        assert_eq!(distance([-3, -4], &ends), 5.0);
        assert_eq!(distance([3, 4], &[[0, 0]; 2]), 5.0);
    }

    /// A bump of one line counts for the edges near it, of either line, and for no others.
    #[test]
    fn slits_are_as_wide_as_lines_are_apart() {
        let straight = line((0..=20).map(|i| [10 * i, 0]).collect());
        let bumpy = line(vec![[0, 0], [90, 0], [100, 6], [110, 0], [200, 0]]);
        let of_straight = widths_of(&straight, &bumpy, &ALL, 12.0);
        // The bump's top is 6 from the vertex below it.
        let foot = 10.0 * 6.0 / 136f64.sqrt();
        for (k, width) in of_straight.iter().enumerate() {
            let expected = match k {
                // Within 12 of these are the top and the vertex below it, which is nearer to the bump's sides.
                8..=11 => 6.0,
                _ => 0.0,
            };
            assert_eq!(*width, expected, "edge {k}");
        }
        let of_bumpy = widths_of(&bumpy, &straight, &ALL, 12.0);
        assert_eq!(of_bumpy, [6.0; 4]);
        assert!((distances(&straight, &bumpy, &ALL, 12.0)[10] - foot).abs() < 1e-9);
        // Seen from a part of the face in which the bump does not lie, there is none.
        assert_eq!(widths_of(&bumpy, &straight, &[[0, -50], [80, 50]], 12.0), [0.0; 4]);
    }

    #[test]
    fn what_has_no_line_opposite_is_as_far_as_the_bound() {
        let here = line((0..=20).map(|i| [10 * i, 0]).collect());
        let half = line((0..=10).map(|i| [10 * i, 0]).collect());
        let widths = widths_of(&here, &half, &ALL, 5.0);
        assert_eq!((widths[8], widths[12]), (0.0, 5.0));
        let nothing = FaceLines::default();
        assert_eq!(widths_of(&here, &nothing, &ALL, 5.0), [5.0; 20]);
        assert!(widths_of(&nothing, &here, &ALL, 5.0).is_empty());
    }

    /// A stream of numbers from 0 to 1 (SplitMix64).
    fn random(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            (z >> 40) as f64 / (1u64 << 24) as f64
        }
    }

    /// The height of a line above a place; it goes only forwards.
    fn height(line: &FaceLines, u: f64, of: impl Fn(u32) -> f64) -> f64 {
        let at = |p: u32| f64::from(line.points[p as usize][0]);
        let edge = line.edges.iter().find(|e| u <= at(e.points[1])).expect("it is there");
        let [a, b] = edge.points;
        let t = (u - at(a)) / (at(b) - at(a));
        of(a) + (of(b) - of(a)) * t
    }

    /// Draws pairs of lines that are simplified from one, with vertices at different places, and looks between them: what
    /// share of places in the slit no strip covers, where those of the upper line hang downwards and reach so many times
    /// as far.
    fn uncovered(seed: u64, times: f64) -> f64 {
        let mut random = random(seed);
        let (mut all, mut open) = (0u32, 0u32);
        for _ in 0..60 {
            let phase = 6.0 * random();
            let curve = |u: f64| 40.0 * (u / 60.0 + phase).sin() + 12.0 * (u / 17.0).sin();
            // Deviations of up to 6 across, at vertices 8 to 50 apart.
            let mut simplified = || {
                let (mut u, mut points) = (0.0, Vec::new());
                while u < 1000.0 {
                    points.push([u as i32, (curve(u) + 12.0 * random() - 6.0) as i32]);
                    u += 8.0 + 42.0 * random();
                }
                points.push([1000, curve(1000.0) as i32]);
                line(points)
            };
            let pair = [simplified(), simplified()];
            // Their true distance; builds would know no more than a bound.
            let of = |l: &FaceLines, u: f64| height(l, u, |p| l.points[p as usize][1].into());
            let bound = (0..1000)
                .map(|u| (of(&pair[0], u.into()) - of(&pair[1], u.into())).abs())
                .fold(0.0, f64::max);
            let reaches = [0, 1].map(|side: usize| {
                let (own, other) = (&pair[side], &pair[1 - side]);
                let mut of_corner = vec![0.0f64; own.points.len()];
                for (edge, width) in own.edges.iter().zip(widths_of(own, other, &ALL, bound)) {
                    for corner in edge.corners {
                        let here = &mut of_corner[corner as usize];
                        *here = here.max(times * (LEANING * width + 2.0));
                    }
                }
                of_corner
            });
            for u in (0..2000).map(|i| 0.5 * f64::from(i)) {
                let heights = [of(&pair[0], u), of(&pair[1], u)];
                let upper = usize::from(heights[1] > heights[0]);
                let reach = height(&pair[upper], u, |p| reaches[upper][p as usize]);
                all += 1;
                open += u32::from(reach < heights[upper] - heights[1 - upper]);
            }
        }
        f64::from(open) / f64::from(all)
    }

    #[test]
    fn strips_cover_what_is_between_lines() {
        assert_eq!(uncovered(1, 1.0), 0.0);
        assert_eq!(uncovered(2, 1.0), 0.0);
        // Shorter ones would not.
        assert!(uncovered(1, 0.1) > 0.01);
    }
}
