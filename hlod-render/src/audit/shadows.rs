//! Distances between the edges of shadows, and pixels that are dark or lit for no reason.

use glam::{DVec2, Vec3};
use serde::Serialize;

use super::distance_transform::squared_distances;
use super::silhouette::{Mask, SUBPIXELS, Scores, compare_where, scored_share};
use super::{Source, draw};
use crate::error::RenderError;
use crate::frame::Renderer;
use crate::gpu::Gpu;
use crate::passes::check_shadows;
use crate::picture::Canvas;
use crate::scene::{Material, Shadow, Shot};
use crate::shadow_map::MapCount;
use hlod_compress::srgb::linear_from_srgb;

/// Angles of incidence up to which edges are scored, degrees.
const ANGLES_DEG: [f64; 2] = [15.0, 60.0];
/// A pixel is dark for no reason where nothing hidden is so near, and the same for light.
const REASON_PX: f32 = 3.0;

/// How far edges of shadows are from their place.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ShadowEdge {
    /// Up to 15° of incidence.
    pub deg15: EdgeDistance,
    /// Up to 60°.
    pub deg60: EdgeDistance,
    /// Pixels up to 60° that are hidden although nothing hidden is within three pixels (acne).
    pub acne_pixels: u64,
    /// The same of pixels that are lit.
    pub leak_pixels: u64,
    /// Pixels up to 60° that were looked at.
    pub pixels: u64,
    /// Shadow maps, where there were any: in all views.
    pub maps: Option<Maps>,
}

/// What came of shadow maps.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Maps {
    /// How many.
    pub maps: u32,
    /// Of them, those that were uniform though something else was asked for.
    pub fallbacks: u32,
    /// Share of the pixels up to 60° on which a texel is longer than [`crate::shadow_map::TEXEL_MAX_PX`].
    pub denied_share: f64,
}

/// In pixels; the worse of both directions.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct EdgeDistance {
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Share of the edges that was scored; the rest belongs to features that vanish under an
    /// opening or closing by a disc of one pixel.
    pub scored_share: f64,
    /// Length of the edges that were scored, in eighths of a pixel.
    pub positions: u64,
}

/// Of any number of views.
#[derive(Debug, Clone, Default)]
pub(super) struct ShadowScores {
    edges: [[Scores; 2]; 2],
    acne: u64,
    leaks: u64,
    pixels: u64,
    maps: MapCount,
}

impl ShadowScores {
    pub(super) fn merge(&mut self, other: &ShadowScores) {
        for (mine, others) in self.edges.iter_mut().zip(&other.edges) {
            mine.iter_mut().zip(others).for_each(|(a, b)| a.merge(b));
        }
        self.maps.add(other.maps);
        self.acne += other.acne;
        self.leaks += other.leaks;
        self.pixels += other.pixels;
    }

    pub(super) fn report(&self) -> ShadowEdge {
        let distance = |scores: &[Scores; 2]| {
            let worse = |share: f64| scores[0].percentile(share).max(scores[1].percentile(share));
            EdgeDistance {
                p99: worse(0.99),
                p999: worse(0.999),
                scored_share: scored_share(scores),
                positions: scores[0].count() + scores[1].count(),
            }
        };
        ShadowEdge {
            deg15: distance(&self.edges[0]),
            deg60: distance(&self.edges[1]),
            acne_pixels: self.acne,
            leak_pixels: self.leaks,
            pixels: self.pixels,
            maps: (self.maps.maps > 0).then(|| Maps {
                maps: self.maps.maps,
                fallbacks: self.maps.fallbacks,
                denied_share: self.maps.denied_share(),
            }),
        }
    }
}

/// Compares the shadows of a drawing with those that rays find on the reference. `is_smooth` says
/// which pixels have neither an outline nor a jump of depth near them.
pub(super) fn compare_shadows(
    gpu: &Gpu,
    renderer: &mut Renderer,
    [drawn, truth]: [&mut Source<'_>; 2],
    shot: &Shot,
    size: (u32, u32),
    is_smooth: &[bool],
) -> Result<ShadowScores, RenderError> {
    // Edges of shadows have a place where the light is a point: rays heed its size, hard shadows do not.
    let shot = &Shot { light_size: 0.0, ..*shot };
    let canvas = Canvas::new(gpu, size.0, size.1)?;
    let cosines = cosines(gpu, renderer, truth, shot, &canvas)?;
    let drawn = hidden(gpu, renderer, drawn, shot, &canvas, 1)?;
    let maps = match shot.shadow {
        // Those of the last of the pictures.
        Shadow::Mapped(_) => renderer.map_count(gpu)?,
        _ => MapCount::default(),
    };
    let truth = truly_hidden(gpu, renderer, truth, shot, size)?;
    Ok(ShadowScores { maps, ..score(&drawn, &truth, &cosines, is_smooth) })
}

/// What is hidden from the light, at [`SUBPIXELS`] positions a pixel, by pictures of `n` × `n` samples a pixel: each has its
/// samples elsewhere, so that the front and the casters are those of one frame.
fn hidden(
    gpu: &Gpu,
    renderer: &mut Renderer,
    source: &mut Source<'_>,
    shot: &Shot,
    canvas: &Canvas,
    n: u32,
) -> Result<Mask, RenderError> {
    let shot = shot.finer(n);
    let places = (SUBPIXELS / n) as usize;
    let (width, height) = (canvas.targets.width() as usize, canvas.targets.height() as usize);
    let mut mask = Mask {
        width: width * places,
        height: height * places,
        covered: vec![false; width * height * places * places],
    };
    for j in 0..places {
        for i in 0..places {
            let place = |k: usize| (k as f64 + 0.5) / places as f64 - 0.5;
            let sample_offset_px = DVec2::new(place(i), place(j));
            draw(gpu, renderer, source, &Shot { sample_offset_px, ..shot }, canvas)?;
            let occlusion = canvas.occlusion(gpu)?;
            let identities = canvas.identities(gpu)?;
            for (p, (&hidden, &identity)) in occlusion.iter().zip(&identities).enumerate() {
                let (x, y) = (p % width * places + i, p / width * places + j);
                mask.covered[y * mask.width + x] = identity != 0 && hidden > 0;
            }
        }
    }
    Ok(mask)
}

/// What rays find hidden at the same positions. The reference is the same however large a picture is, so these are as few
/// as there is room for.
fn truly_hidden(
    gpu: &Gpu,
    renderer: &mut Renderer,
    source: &mut Source<'_>,
    shot: &Shot,
    (width, height): (u32, u32),
) -> Result<Mask, RenderError> {
    let traced = Shot { shadow: Shadow::Traced, ..*shot };
    let mut n = SUBPIXELS;
    let canvas = loop {
        let canvas = Canvas::new(gpu, width * n, height * n)?;
        match check_shadows(gpu, &canvas.targets) {
            Err(_) if n > 1 => n /= 2,
            result => break result.map(|()| canvas)?,
        }
    };
    hidden(gpu, renderer, source, &traced, &canvas, n)
}

/// Cosine of the angle of incidence in each pixel.
pub(super) fn cosines(
    gpu: &Gpu,
    renderer: &mut Renderer,
    truth: &mut Source<'_>,
    shot: &Shot,
    canvas: &Canvas,
) -> Result<Vec<f32>, RenderError> {
    let white = Material { albedo: Vec3::ONE, highlight: 0.0, ambient: 0.0 };
    let shot = Shot { material: white, background: Vec3::ZERO, shadow: Shadow::None, ..*shot };
    draw(gpu, renderer, truth, &shot, canvas)?;
    Ok(canvas.picture(gpu)?.rgba.chunks_exact(4).map(|p| linear_from_srgb(p[1])).collect())
}

/// On plain arrays; `cosines` and `is_smooth` have a value a pixel.
fn score(drawn: &Mask, truth: &Mask, cosines: &[f32], is_smooth: &[bool]) -> ShadowScores {
    let n = SUBPIXELS as usize;
    let width = drawn.width / n;
    let within = |angle_deg: f64| {
        let least = angle_deg.to_radians().cos() as f32;
        move |x: usize, y: usize| {
            let p = y / n * width + x / n;
            is_smooth[p] && cosines[p] >= least
        }
    };
    let [narrow, wide] = ANGLES_DEG.map(within);
    let edges = compare_where(drawn, truth, [&narrow, &wide]);

    // Without a reason: at the pixel's middle, where no shadow's edge is near.
    let far = |of: bool| {
        let squared = squared_distances(truth.width, truth.height, |p| truth.covered[p] == of);
        move |p: usize| squared[p] > (REASON_PX * SUBPIXELS as f32).powi(2)
    };
    let (far_from_hidden, far_from_lit) = (far(true), far(false));
    let mut scores = ShadowScores { edges, ..ShadowScores::default() };
    for y in (n / 2..drawn.height).step_by(n) {
        for x in (n / 2..drawn.width).step_by(n) {
            if wide(x, y) {
                let p = y * drawn.width + x;
                scores.pixels += 1;
                scores.acne += u64::from(drawn.covered[p] && far_from_hidden(p));
                scores.leaks += u64::from(!drawn.covered[p] && far_from_lit(p));
            }
        }
    }
    scores
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (40, 30);

    fn mask(hidden: impl Fn(f64, f64) -> bool) -> Mask {
        let (width, height) = (SIZE.0 * 8, SIZE.1 * 8);
        let at = |i: usize| (i as f64 + 0.5) / 8.0;
        let covered = (0..width * height).map(|p| hidden(at(p % width), at(p / width))).collect();
        Mask { width, height, covered }
    }

    fn compared(drawn: &Mask, truth: &Mask) -> ShadowEdge {
        let pixels = SIZE.0 * SIZE.1;
        // The right half is lit at 30°.
        let cosines: Vec<f32> =
            (0..pixels).map(|p| if p % SIZE.0 < SIZE.0 / 2 { 1.0 } else { 0.866 }).collect();
        score(drawn, truth, &cosines, &vec![true; pixels]).report()
    }

    #[test]
    fn shifted_edges_are_as_far_as_they_were_shifted() {
        let truth = mask(|x, y| y < 15.0 + 0.1 * x);
        let same = compared(&truth, &truth);
        assert_eq!((same.deg15.p999, same.deg60.p999), (0.0, 0.0));
        assert!(same.deg15.positions > 200 && same.deg60.positions > 600);
        // By a pixel to the left, by three to the right.
        let shifted = mask(|x, y| y < 15.0 + 0.1 * x + if x < 20.0 { 1.0 } else { 3.0 });
        let far = compared(&shifted, &truth);
        assert!((0.8..1.3).contains(&far.deg15.p99), "{far:?}");
        assert!((2.6..3.3).contains(&far.deg60.p999), "{far:?}");
        assert_eq!((far.acne_pixels, far.leak_pixels), (0, 0));
    }

    #[test]
    fn spots_in_the_light_are_acne_and_spots_in_the_shadow_leaks() {
        let truth = mask(|_, y| y < 15.0);
        let spotted = mask(|x, y| {
            let spot = |cx: f64, cy: f64| (x - cx).hypot(y - cy) < 0.6;
            (y < 15.0 && !spot(10.5, 7.5)) || spot(30.5, 22.5) || spot(12.5, 22.5)
        });
        let found = compared(&spotted, &truth);
        assert_eq!((found.acne_pixels, found.leak_pixels), (2, 1));
        assert_eq!(found.pixels, 40 * 30);
        let grey = compared(&mask(|_, _| true), &truth);
        assert!(grey.acne_pixels > 300);
    }
}
