//! Holes, overdraw and appearance distance, on plain arrays.

/// Samples along each side of a reference pixel.
pub const SAMPLES: u32 = 4;

/// Distances are looked for no farther than this.
pub const DISTANCE_MAX_PX: f64 = 16.0;

/// Shades closer than this are the same: two steps of 8 bits.
const SHADE_TOLERANCE: f32 = 2.0 / 255.0;

/// A depth range over three pixels that no surface within 79° of facing the eye has.
const JUMP_PX: f64 = 16.0;

/// What one drawing shows at each sample.
#[derive(Debug, Clone)]
pub struct Layer {
    /// Samples in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// sRGB luma, 0 to 1.
    pub shade: Vec<f32>,
    /// Distance along the line of sight; infinite where nothing is drawn.
    pub depth: Vec<f32>,
    /// Whether anything is drawn.
    pub covered: Vec<bool>,
    /// Whether it is a back.
    pub back: Vec<bool>,
}

impl Layer {
    /// From what the renderer reads back.
    pub fn new(width: u32, height: u32, rgba: &[u8], identities: &[u32], depth: Vec<f32>) -> Layer {
        let luma = |p: &[u8]| {
            (0.2126 * f32::from(p[0]) + 0.7152 * f32::from(p[1]) + 0.0722 * f32::from(p[2])) / 255.0
        };
        Layer {
            width: width as usize,
            height: height as usize,
            shade: rgba.chunks_exact(4).map(luma).collect(),
            depth,
            covered: identities.iter().map(|&id| id != 0).collect(),
            back: identities.iter().map(|&id| id >> 31 == 1).collect(),
        }
    }
}

/// What pixels mean in world units, and what counts as a hole.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Size of a pixel at depth 1 (perspective) or at any depth.
    pub pixel_at_unit_depth: f64,
    /// Whether pixels grow with depth.
    pub perspective: bool,
    /// τ of the drawing, or by how much it is coarser where something is not loaded.
    pub tau_px: f64,
    /// By how much even the finest level may be off, world units: from very near that is more than τ.
    pub rounding: f64,
    /// Pixels by which outlines may be off.
    pub margin_px: usize,
    /// Whether the surface is closed and its backs are never drawn for users.
    pub backs_are_holes: bool,
}

impl Scale {
    fn pixel(&self, depth: f32) -> f64 {
        if self.perspective {
            self.pixel_at_unit_depth * f64::from(depth)
        } else {
            self.pixel_at_unit_depth
        }
    }
}

/// A histogram of distances in quarter pixels.
#[derive(Debug, Clone, Default)]
pub struct Distances {
    counts: Vec<u64>,
}

impl Distances {
    fn add(&mut self, quarters: usize) {
        if self.counts.len() <= quarters {
            self.counts.resize(quarters + 1, 0);
        }
        self.counts[quarters] += 1;
    }

    /// Adds another histogram.
    pub fn merge(&mut self, other: &Distances) {
        if self.counts.len() < other.counts.len() {
            self.counts.resize(other.counts.len(), 0);
        }
        self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
    }

    /// Number of distances.
    pub fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// The smallest distance in pixels that `share` of all do not exceed.
    pub fn percentile(&self, share: f64) -> f64 {
        let wanted = (share * self.count() as f64).ceil() as u64;
        let mut sum = 0;
        for (quarters, count) in self.counts.iter().enumerate() {
            sum += count;
            if sum >= wanted {
                return quarters as f64 / f64::from(SAMPLES);
            }
        }
        0.0
    }
}

/// One view's scores.
#[derive(Debug, Clone, Default)]
pub struct Scores {
    /// Indices of hole pixels.
    pub holes: Vec<usize>,
    /// Indices of pixels that show a back with a front right behind it.
    pub folds: Vec<usize>,
    /// Indices of overdraw pixels.
    pub overdraw: Vec<usize>,
    /// From the drawing to the reference, and from the reference to the drawing.
    pub appearance: [Distances; 2],
    /// The larger of both for each pixel; 0 where none was measured.
    pub distance_px: Vec<f32>,
}

/// Compares a drawing of one sample a pixel with a reference of 4 × 4; `culled` is the same drawing
/// without the backs of closed surfaces, as users see it.
///
/// # Panics
/// When the reference is not four times as large.
pub fn score(drawn: &Layer, culled: &Layer, truth: &Layer, scale: &Scale) -> Scores {
    let n = SAMPLES as usize;
    assert!(truth.width == n * drawn.width && truth.height == n * drawn.height);
    let reference = Reduced::new(truth);
    let (width, height) = (drawn.width, drawn.height);
    let seams = find_seams(drawn, culled, &reference, scale);
    let mut scores = Scores {
        holes: seams.holes,
        folds: seams.folds,
        overdraw: seams.overdraw,
        distance_px: vec![0.0; width * height],
        ..Scores::default()
    };
    for y in 0..height {
        for x in 0..width {
            let p = y * width + x;
            let wide = reference.window(x, y, 2);
            let scored =
                wide.all_covered && !reference.jumps_within(x, y, 2, scale) && drawn.covered[p];
            if scored {
                let forward = forward_distance(drawn.shade[p], truth, x, y);
                let backward = backward_distance(reference.mean_shade[p], drawn, x, y);
                scores.appearance[0].add(forward);
                scores.appearance[1].add(backward);
                scores.distance_px[p] = forward.max(backward) as f32 / n as f32;
            }
        }
    }
    scores
}

/// Indices of pixels where a drawing is open, or sticks out.
#[derive(Debug, Clone, Default)]
pub(super) struct Seams {
    pub(super) holes: Vec<usize>,
    /// For each hole, the depth from which on anything lies behind the surface that is to be there.
    pub(super) behind: Vec<f32>,
    pub(super) folds: Vec<usize>,
    pub(super) overdraw: Vec<usize>,
}

/// Finds holes and overdraw; see [`score`].
pub(super) fn find_seams(
    drawn: &Layer,
    culled: &Layer,
    reference: &Reduced,
    scale: &Scale,
) -> Seams {
    let (width, height) = (drawn.width, drawn.height);
    assert_eq!((width, height), (reference.width, reference.height));
    let mut seams = Seams::default();
    let rings = reference.windows(scale.margin_px);
    for y in 0..height {
        for x in 0..width {
            let p = y * width + x;
            let ring = rings[p];
            // At the picture's edge it may belong to what lies beyond.
            let outside = drawn.covered[p] && !ring.any_covered;
            if outside && reference.holds(x, y, scale.margin_px) {
                seams.overdraw.push(p);
            }
            // From within a body backs are what there is to be seen.
            let shows_back = scale.backs_are_holes && drawn.back[p] && !ring.any_back;
            // Whether the surface jumps takes longest, and is asked of few.
            let is_hole = ring.all_covered
                && is_hole(if shows_back { culled } else { drawn }, p, &ring, scale)
                && reference.holds(x, y, scale.margin_px)
                && !reference.jumps_within(x, y, scale.margin_px - 1, scale);
            if is_hole {
                seams.holes.push(p);
                seams.behind.push(behind(&ring, scale) as f32);
            } else if shows_back {
                seams.folds.push(p);
            }
        }
    }
    seams
}

/// Pixels that one drawing covers and another one does not within a pixel: by so much closing seams
/// may move an outline, and no more.
pub(super) fn pushed_out(closed: &Layer, open: &Layer) -> Vec<usize> {
    let (width, height) = (closed.width, closed.height);
    assert_eq!((width, height), (open.width, open.height));
    let near = |p: usize| {
        let (x, y) = (p % width, p / width);
        let square = |c: usize, end: usize| c.saturating_sub(1)..=(c + 1).min(end - 1);
        square(y, height).any(|wy| square(x, width).any(|wx| open.covered[wy * width + wx]))
    };
    (0..width * height).filter(|&p| closed.covered[p] && !near(p)).collect()
}

/// Pixels of a reference of 4 × 4 samples with neither background nor a jump of depth within two
/// pixels.
pub fn smooth(truth: &Layer, scale: &Scale) -> Vec<bool> {
    let reference = Reduced::new(truth);
    let n = SAMPLES as usize;
    let (width, height) = (truth.width / n, truth.height / n);
    let is_smooth = |p: usize| {
        let (x, y) = (p % width, p / width);
        reference.window(x, y, 2).all_covered && !reference.jumps_within(x, y, 2, scale)
    };
    (0..width * height).map(is_smooth).collect()
}

fn is_hole(drawn: &Layer, p: usize, ring: &Window, scale: &Scale) -> bool {
    if !drawn.covered[p] {
        return true;
    }
    // Through a crack in a closed surface there is nothing but what lies beyond. (A back alone does
    // not tell: a fold of the surface, and every outline of it within one, shows some before a front.)
    f64::from(drawn.depth[p]) > behind(ring, scale)
}

/// The depth from which on something does not belong to the surface in a window. ε_drawn covers at most τ pixels, or is
/// the leaves' own; one pixel more for the pixel itself. The window's own depth range takes the surface's slope into account.
fn behind(ring: &Window, scale: &Scale) -> f64 {
    let pixel = scale.pixel(ring.farthest);
    let tolerance = ((scale.tau_px * pixel).max(scale.rounding) + pixel) * 1.2;
    f64::from(ring.farthest) + tolerance
}

/// In quarter pixels: the smallest widening of the pixel's own square in which the reference has
/// this shade.
fn forward_distance(shade: f32, truth: &Layer, x: usize, y: usize) -> usize {
    let n = SAMPLES as usize;
    let most = (DISTANCE_MAX_PX * f64::from(SAMPLES)) as usize;
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for k in 0..most {
        let (x0, x1) = ((n * x) as isize - k as isize, (n * x + n - 1 + k) as isize);
        let (y0, y1) = ((n * y) as isize - k as isize, (n * y + n - 1 + k) as isize);
        let mut take = |sx: isize, sy: isize| {
            if sx >= 0 && sy >= 0 && (sx as usize) < truth.width && (sy as usize) < truth.height {
                let s = truth.shade[sy as usize * truth.width + sx as usize];
                low = low.min(s);
                high = high.max(s);
            }
        };
        if k == 0 {
            (y0..=y1).for_each(|sy| (x0..=x1).for_each(|sx| take(sx, sy)));
        } else {
            // Only the new rim.
            (x0..=x1).for_each(|sx| {
                take(sx, y0);
                take(sx, y1);
            });
            (y0 + 1..y1).for_each(|sy| {
                take(x0, sy);
                take(x1, sy);
            });
        }
        if shade + SHADE_TOLERANCE >= low && shade - SHADE_TOLERANCE <= high {
            return k;
        }
    }
    most
}

/// In quarter pixels: the smallest square of drawn pixels whose shades span this one.
fn backward_distance(shade: f32, drawn: &Layer, x: usize, y: usize) -> usize {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for r in 0..DISTANCE_MAX_PX as usize {
        let (x0, x1) = (x.saturating_sub(r), (x + r).min(drawn.width - 1));
        let (y0, y1) = (y.saturating_sub(r), (y + r).min(drawn.height - 1));
        for sy in y0..=y1 {
            let rim = sy + r == y || sy == y + r;
            for sx in x0..=x1 {
                if rim || sx + r == x || sx == x + r {
                    let s = drawn.shade[sy * drawn.width + sx];
                    low = low.min(s);
                    high = high.max(s);
                }
            }
        }
        if shade + SHADE_TOLERANCE >= low && shade - SHADE_TOLERANCE <= high {
            return r * SAMPLES as usize;
        }
    }
    (DISTANCE_MAX_PX * f64::from(SAMPLES)) as usize
}

/// The reference, summed up for each pixel.
pub(super) struct Reduced {
    width: usize,
    height: usize,
    all_covered: Vec<bool>,
    any_covered: Vec<bool>,
    any_back: Vec<bool>,
    nearest: Vec<f32>,
    farthest: Vec<f32>,
    mean_shade: Vec<f32>,
}

/// A square of pixels of the reference; pixels beyond the picture's edge are left out.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Window {
    all_covered: bool,
    any_covered: bool,
    any_back: bool,
    nearest: f32,
    farthest: f32,
}

impl Window {
    const EMPTY: Window = Window {
        all_covered: true,
        any_covered: false,
        any_back: false,
        nearest: f32::INFINITY,
        farthest: 0.0,
    };

    fn and(self, other: Window) -> Window {
        Window {
            all_covered: self.all_covered && other.all_covered,
            any_covered: self.any_covered || other.any_covered,
            any_back: self.any_back || other.any_back,
            nearest: self.nearest.min(other.nearest),
            farthest: self.farthest.max(other.farthest),
        }
    }
}

/// The positions within `radius` of one, of so many.
fn around(at: usize, radius: usize, count: usize) -> std::ops::RangeInclusive<usize> {
    at.saturating_sub(radius)..=(at + radius).min(count - 1)
}

impl Reduced {
    pub(super) fn new(truth: &Layer) -> Reduced {
        let n = SAMPLES as usize;
        let (width, height) = (truth.width / n, truth.height / n);
        let count = width * height;
        let mut out = Reduced {
            width,
            height,
            all_covered: vec![true; count],
            any_covered: vec![false; count],
            any_back: vec![false; count],
            nearest: vec![f32::INFINITY; count],
            farthest: vec![0.0; count],
            mean_shade: vec![0.0; count],
        };
        for y in 0..truth.height {
            for x in 0..truth.width {
                let (s, p) = (y * truth.width + x, (y / n) * width + x / n);
                out.all_covered[p] &= truth.covered[s];
                out.any_covered[p] |= truth.covered[s];
                out.any_back[p] |= truth.back[s];
                out.nearest[p] = out.nearest[p].min(truth.depth[s]);
                if truth.covered[s] {
                    out.farthest[p] = out.farthest[p].max(truth.depth[s]);
                }
                // The mean of light, not of its encoding.
                out.mean_shade[p] += truth.shade[s].powf(2.2) / (n * n) as f32;
            }
        }
        out.mean_shade.iter_mut().for_each(|s| *s = s.powf(1.0 / 2.2));
        out
    }

    /// With one sample more, in the middle of each pixel, where the drawing has its own: what is thinner than samples are
    /// apart may lie on that one alone.
    pub(super) fn with_middles(mut self, middles: &Layer) -> Reduced {
        assert_eq!((self.width, self.height), (middles.width, middles.height));
        for p in 0..self.width * self.height {
            self.all_covered[p] &= middles.covered[p];
            self.any_covered[p] |= middles.covered[p];
            self.any_back[p] |= middles.back[p];
            self.nearest[p] = self.nearest[p].min(middles.depth[p]);
            if middles.covered[p] {
                self.farthest[p] = self.farthest[p].max(middles.depth[p]);
            }
        }
        self
    }

    /// Whether all of a square is in the picture: what lies beyond may jump in depth, and is not known.
    fn holds(&self, x: usize, y: usize, radius: usize) -> bool {
        let inside = |c: usize, end: usize| c >= radius && c + radius < end;
        inside(x, self.width) && inside(y, self.height)
    }

    fn pixel(&self, p: usize) -> Window {
        Window {
            all_covered: self.all_covered[p],
            any_covered: self.any_covered[p],
            any_back: self.any_back[p],
            nearest: self.nearest[p],
            farthest: self.farthest[p],
        }
    }

    fn window(&self, x: usize, y: usize, radius: usize) -> Window {
        around(y, radius, self.height)
            .flat_map(|wy| around(x, radius, self.width).map(move |wx| wy * self.width + wx))
            .fold(Window::EMPTY, |all, p| all.and(self.pixel(p)))
    }

    /// All of them, row by row: first along rows, then across, as radii may be large.
    fn windows(&self, radius: usize) -> Vec<Window> {
        let (width, height) = (self.width, self.height);
        let fold = |of: &dyn Fn(usize) -> Window, at, count| {
            around(at, radius, count).fold(Window::EMPTY, |all, i| all.and(of(i)))
        };
        let along = |p: usize| fold(&|wx| self.pixel(p - p % width + wx), p % width, width);
        let rows: Vec<Window> = (0..width * height).map(along).collect();
        let across = |p: usize| fold(&|wy| rows[wy * width + p % width], p / width, height);
        (0..width * height).map(across).collect()
    }

    /// Whether the surface jumps in depth within three pixels.
    fn jumps(&self, window: &Window, scale: &Scale) -> bool {
        f64::from(window.farthest - window.nearest) > JUMP_PX * scale.pixel(window.nearest)
    }

    fn jumps_within(&self, x: usize, y: usize, radius: usize, scale: &Scale) -> bool {
        let columns = around(x, radius, self.width);
        around(y, radius, self.height)
            .any(|wy| columns.clone().any(|wx| self.jumps(&self.window(wx, wy, 1), scale)))
    }
}

#[cfg(test)]
mod tests;
