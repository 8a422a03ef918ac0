//! Every comparison is fed wrong pictures and must object.

use super::*;

const W: usize = 60;
const H: usize = 40;
const SCALE: Scale = Scale {
    pixel_at_unit_depth: 0.01,
    perspective: false,
    tau_px: 0.5,
    rounding: 0.0,
    margin_px: 1,
    backs_are_holes: true,
};

/// A disc at depth 5 with shades that vary over a few pixels, on an empty background, at `n`
/// samples a pixel; `shift_px` moves the shades to the right, `radius` is the disc's.
fn disc(n: usize, shift_px: f64, radius: f64) -> Layer {
    let (width, height) = (W * n, H * n);
    let mut layer = Layer {
        width,
        height,
        shade: Vec::new(),
        depth: Vec::new(),
        covered: Vec::new(),
        back: vec![false; width * height],
    };
    for y in 0..height {
        for x in 0..width {
            let (px, py) = ((x as f64 + 0.5) / n as f64, (y as f64 + 0.5) / n as f64);
            let inside = (px - 30.0).hypot(py - 20.0) < radius;
            let wave = ((px - shift_px) * 0.5).sin() * ((py * 0.37).cos() + 1.5) / 5.0;
            layer.shade.push(if inside { 0.5 + wave as f32 } else { 0.0 });
            layer.depth.push(if inside { 5.0 } else { f32::INFINITY });
            layer.covered.push(inside);
        }
    }
    layer
}

fn good() -> Layer {
    disc(1, 0.0, 15.0)
}

fn truth() -> Layer {
    disc(SAMPLES as usize, 0.0, 15.0)
}

fn p999(scores: &Scores) -> f64 {
    scores.appearance[0].percentile(0.999).max(scores.appearance[1].percentile(0.999))
}

fn centre() -> usize {
    20 * W + 30
}

#[test]
fn the_right_picture_passes() {
    let scores = score(&good(), &good(), &truth(), &SCALE);
    assert!(scores.holes.is_empty() && scores.overdraw.is_empty());
    assert!(scores.appearance[0].count() > 300);
    // One sample a pixel costs at most the step from a pixel to its neighbours: the floor.
    assert_eq!(scores.appearance[0].percentile(0.999), 0.0);
    assert!(p999(&scores) <= 1.0);
}

#[test]
fn a_shift_by_two_pixels_is_measured_as_such() {
    let scores = score(&disc(1, 2.0, 15.0), &disc(1, 2.0, 15.0), &truth(), &SCALE);
    let worst = p999(&scores);
    assert!((1.0..=4.0).contains(&worst), "{worst}");
}

#[test]
fn a_blur_is_found() {
    let sharp = {
        let mut layer = good();
        // Detail of one pixel, which a blur destroys.
        layer
            .shade
            .iter_mut()
            .enumerate()
            .for_each(|(i, s)| *s *= if i % 2 == 0 { 1.0 } else { 0.6 });
        layer
    };
    let mut fine = truth();
    for y in 0..fine.height {
        for x in 0..fine.width {
            let p = (y / 4) * W + x / 4;
            fine.shade[y * fine.width + x] = sharp.shade[p];
        }
    }
    assert_eq!(p999(&score(&sharp, &sharp, &fine, &SCALE)), 0.0);
    let mut blurred = sharp.clone();
    for y in 1..H - 1 {
        for x in 1..W - 1 {
            let sum: f32 = (0..9).map(|k| sharp.shade[(y + k / 3 - 1) * W + x + k % 3 - 1]).sum();
            blurred.shade[y * W + x] = sum / 9.0;
        }
    }
    assert!(p999(&score(&blurred, &blurred, &fine, &SCALE)) >= 1.0);
}

#[test]
fn flat_grey_and_salt_and_pepper_are_found() {
    let mut grey = good();
    grey.shade.iter_mut().for_each(|s| *s = 0.5);
    assert!(p999(&score(&grey, &grey, &truth(), &SCALE)) >= 2.0);
    let mut noisy = good();
    noisy.shade.iter_mut().step_by(97).for_each(|s| *s = 1.0);
    assert!(p999(&score(&noisy, &noisy, &truth(), &SCALE)) >= 4.0);
}

#[test]
fn holes_of_every_kind_are_counted() {
    let mut gone = good();
    gone.covered[centre()] = false;
    gone.depth[centre()] = f32::INFINITY;
    assert_eq!(score(&gone, &gone, &truth(), &SCALE).holes, [centre()]);

    let mut back = good();
    back.back[centre()] = true;
    // A back with nothing behind it is a crack's inner wall; with a front close behind it is a fold.
    assert_eq!(score(&back, &gone, &truth(), &SCALE).holes, [centre()]);
    let fold = score(&back, &good(), &truth(), &SCALE);
    assert!(fold.holes.is_empty() && fold.folds == [centre()]);
    let mut far = good();
    far.depth[centre()] = 5.0 + 0.03;
    assert_eq!(score(&back, &far, &truth(), &SCALE).holes, [centre()]);
    let open = Scale { backs_are_holes: false, ..SCALE };
    assert!(score(&back, &back, &truth(), &open).holes.is_empty());
    // From within a body the scan shows its back as well, but a crack goes farther.
    let mut within = truth();
    within.back = within.covered.clone();
    assert!(score(&back, &gone, &within, &SCALE).holes.is_empty());
    back.depth[centre()] = 5.0 + 0.03;
    assert_eq!(score(&back, &gone, &within, &SCALE).holes, [centre()]);

    let mut behind = good();
    behind.depth[centre()] = 5.0 + 0.03;
    assert_eq!(score(&behind, &behind, &truth(), &SCALE).holes, [centre()]);
    // From so near that leaves are coarser than pixels it need not be.
    let near = Scale { rounding: 0.02, ..SCALE };
    assert!(score(&behind, &behind, &truth(), &near).holes.is_empty());
    behind.depth[centre()] = 5.0 + 0.04;
    assert_eq!(score(&behind, &behind, &truth(), &near).holes, [centre()]);
    behind.depth[centre()] = 5.0 + 0.01;
    assert!(score(&behind, &behind, &truth(), &SCALE).holes.is_empty());
}

#[test]
fn a_strip_outside_is_overdraw_and_a_rim_of_one_pixel_is_not() {
    assert!(score(&disc(1, 0.0, 15.8), &disc(1, 0.0, 15.8), &truth(), &SCALE).overdraw.is_empty());
    assert!(score(&disc(1, 0.0, 18.0), &disc(1, 0.0, 18.0), &truth(), &SCALE).overdraw.len() > 50);
}

/// A slit that is thinner than a pixel is seen by those pixels whose middles lie in it, and a strip that is wider than
/// what outlines may move by.
#[test]
fn planted_slits_and_strips_are_found() {
    // 0.6 px wide, leaning by one pixel in twenty-five, from top to bottom of the disc.
    let in_slit = |x: f64, y: f64| (x - 28.0 - 0.04 * y).abs() < 0.3;
    let mut slit = good();
    let middles = (0..W * H).filter(|p| in_slit((p % W) as f64 + 0.5, (p / W) as f64 + 0.5));
    let open: Vec<usize> = middles.filter(|&p| slit.covered[p]).collect();
    for &p in &open {
        (slit.covered[p], slit.depth[p]) = (false, f32::INFINITY);
    }
    let found = score(&slit, &slit, &truth(), &SCALE).holes;
    assert!(open.len() > 12 && found.len() + 3 >= open.len(), "{} of {}", found.len(), open.len());

    // 3 px wide along a quarter of the outline, which only closing seams has drawn.
    let mut strip = good();
    let wide = disc(1, 0.0, 18.0);
    let quarter = |p: &usize| p % W >= 30 && p / W >= 20;
    for p in (0..W * H).filter(quarter).filter(|&p| wide.covered[p]) {
        (strip.covered[p], strip.depth[p]) = (true, 5.0);
    }
    assert!(score(&strip, &strip, &truth(), &SCALE).overdraw.len() > 20);
    assert!(pushed_out(&strip, &good()).len() > 20);
    assert!(pushed_out(&good(), &good()).is_empty());
    assert!(pushed_out(&disc(1, 0.0, 15.8), &good()).is_empty());
    // Where three pixels are allowed, because something coarser is drawn meanwhile, it is none.
    let coarse = Scale { margin_px: 4, ..SCALE };
    assert!(score(&strip, &strip, &truth(), &coarse).overdraw.is_empty());
    let deep = score(&slit, &slit, &truth(), &coarse).holes.len();
    assert!(deep > 8 && deep < found.len(), "{deep}: a slit is one in any case");
}

/// Beyond the picture's edge there may be what a pixel there belongs to; one further in is alone.
#[test]
fn what_is_outside_at_the_picture_s_edge_is_not_told() {
    let at = |x: usize| {
        let mut drawn = good();
        let p = 20 * W + x;
        (drawn.covered[p], drawn.depth[p]) = (true, 5.0);
        score(&drawn, &drawn, &truth(), &SCALE).overdraw
    };
    assert!(at(0).is_empty() && at(W - 1).is_empty());
    assert_eq!((at(1), at(W - 2)), (vec![20 * W + 1], vec![20 * W + W - 2]));
}

/// A speck that is smaller than samples are apart, where the drawing has its sample.
#[test]
fn what_only_the_middle_of_a_pixel_shows_is_no_overdraw() {
    let speck = 5 * W + 7;
    let mut drawn = good();
    (drawn.covered[speck], drawn.depth[speck], drawn.shade[speck]) = (true, 5.0, 0.5);
    let overdraw = |middles: &Layer| {
        let reference = Reduced::new(&truth()).with_middles(middles);
        find_seams(&drawn, &drawn, &reference, &SCALE).overdraw
    };
    assert_eq!(overdraw(&good()), [speck]);
    assert!(overdraw(&drawn).is_empty());
    // A back that only this sample shows is the scan's own, and so is a hole.
    let mut other = good();
    (other.back[centre()], other.depth[centre()]) = (true, 9.0);
    other.covered[centre() + 1] = false;
    let reference = Reduced::new(&truth()).with_middles(&other);
    assert!(reference.any_back[centre()] && reference.farthest[centre()] == 9.0);
    assert!(!reference.all_covered[centre() + 1] && reference.any_covered[centre() + 1]);
}

#[test]
fn percentiles_of_known_distances() {
    let mut d = Distances::default();
    (0..999).for_each(|_| d.add(0));
    d.add(8);
    assert_eq!((d.percentile(0.99), d.percentile(0.999), d.percentile(1.0)), (0.0, 0.0, 2.0));
    assert_eq!(Distances::default().percentile(0.5), 0.0);
}

#[test]
fn all_windows_are_those_of_each_pixel() {
    let reference = Reduced::new(&truth());
    for radius in [0, 1, 7, 100] {
        let windows = reference.windows(radius);
        let each = |p: usize| reference.window(p % W, p / W, radius);
        assert!((0..W * H).all(|p| windows[p] == each(p)), "{radius}");
    }
    assert_ne!(reference.windows(1), reference.windows(2));
}
