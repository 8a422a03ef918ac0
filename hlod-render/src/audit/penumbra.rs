//! How much of a light is hidden, compared with rays from the scan to all of it.
//!
//! First a few rays from every pixel tell where penumbrae are; then 1,024 are traced from 4,096 pixels by chance there and
//! as many elsewhere. Both are weighted by how many pixels they stand for. As with the edges of hard shadows, pixels on
//! which light falls in at up to 60° count: where it grazes, how much of it is below a facet's own plane is decided by how
//! coordinates are rounded, and next to nothing of it is seen.

use serde::Serialize;

use super::reference::Rays;
use super::shadows::cosines;
use super::{Source, draw};
use crate::error::RenderError;
use crate::frame::Renderer;
use crate::gpu::Gpu;
use crate::picture::{Canvas, Picture};
use crate::scene::{Shadow, Shot};
use crate::traced::HIDDEN;

/// Rays from each pixel that tell whether it is in a penumbra.
const PROBE_RAYS: u32 = 16;
/// Rays from each pixel that is compared.
const RAYS: u32 = 1024;
/// Angle of incidence up to which pixels count.
const ANGLE_MAX_DEG: f64 = 60.0;
/// Pixels of either kind.
const PIXELS: usize = 4096;

/// Roots of the mean squares by which visible shares of the light are wrong, 0 to 1.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Penumbra {
    /// Where the truth is a penumbra, of pixels up to 60° of incidence, as all of these.
    pub rmse: f64,
    /// Wherever the surface is seen.
    pub rmse_everywhere: f64,
    /// The same of hard shadows by a light in its middle.
    pub hard_rmse: f64,
    /// The same, wherever the surface is seen.
    pub hard_rmse_everywhere: f64,
    /// Pixels compared in penumbrae.
    pub pixels: u64,
    /// Pixels compared elsewhere.
    pub pixels_elsewhere: u64,
    /// Parts of what casts for which lists had no room.
    pub tiles_beyond: u32,
}

/// Sums of squares, of soft shadows and of hard ones.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    count: u64,
    squares: [f64; 2],
}

impl Sum {
    fn add(&mut self, [soft, hard, truth]: [f64; 3]) {
        self.count += 1;
        self.squares[0] += (soft - truth).powi(2);
        self.squares[1] += (hard - truth).powi(2);
    }

    fn merge(&mut self, other: &Sum) {
        self.count += other.count;
        self.squares = [0, 1].map(|i| self.squares[i] + other.squares[i]);
    }

    fn mean(&self, i: usize) -> f64 {
        self.squares[i] / self.count.max(1) as f64
    }
}

/// Of any number of views.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PenumbraScores {
    /// Where the truth is a penumbra.
    inside: Sum,
    /// Pixels that the probe found in penumbrae, and elsewhere: sums, and how many pixels they stand for.
    strata: [(Sum, u64); 2],
    tiles_beyond: u32,
}

impl PenumbraScores {
    pub(super) fn merge(&mut self, other: &PenumbraScores) {
        self.inside.merge(&other.inside);
        for (mine, others) in self.strata.iter_mut().zip(&other.strata) {
            mine.0.merge(&others.0);
            mine.1 += others.1;
        }
        self.tiles_beyond = other.tiles_beyond;
    }

    /// The root of the mean square where the truth is a penumbra.
    pub(super) fn rmse(&self) -> f64 {
        self.inside.mean(0).sqrt()
    }

    pub(super) fn report(&self) -> Penumbra {
        let all: u64 = self.strata.iter().map(|(_, stands_for)| stands_for).sum();
        let everywhere = |i: usize| {
            let weighted = |(sum, stands_for): &(Sum, u64)| sum.mean(i) * *stands_for as f64;
            (self.strata.iter().map(weighted).sum::<f64>() / all.max(1) as f64).sqrt()
        };
        let compared = self.strata[0].0.count + self.strata[1].0.count;
        Penumbra {
            rmse: self.rmse(),
            rmse_everywhere: everywhere(0),
            hard_rmse: self.inside.mean(1).sqrt(),
            hard_rmse_everywhere: everywhere(1),
            pixels: self.inside.count,
            pixels_elsewhere: compared - self.inside.count,
            tiles_beyond: self.tiles_beyond,
        }
    }
}

/// Compares soft shadows, and hard ones, with what rays find from the reference. `is_smooth` says which pixels have neither
/// an outline nor a jump of depth near them, `seed` which of them are compared. The picture has four parts, as of
/// [`panels`].
pub(super) fn compare_penumbrae(
    gpu: &Gpu,
    renderer: &mut Renderer,
    [drawn, truth]: [&mut Source<'_>; 2],
    shot: &Shot,
    size: (u32, u32),
    is_smooth: &[bool],
    seed: u64,
) -> Result<(PenumbraScores, Picture), RenderError> {
    let canvas = Canvas::new(gpu, size.0, size.1)?;
    let cosines = cosines(gpu, renderer, truth, shot, &canvas)?;
    let mut hidden = |source: &mut Source<'_>, shot: &Shot| {
        draw(gpu, renderer, source, shot, &canvas)?;
        let share = |h: u32| f64::from(h) / f64::from(HIDDEN);
        let hidden: Vec<f64> = canvas.occlusion(gpu)?.into_iter().map(share).collect();
        Ok::<_, RenderError>((hidden, canvas.identities(gpu)?))
    };
    let (soft, seen) = hidden(drawn, shot)?;
    let (hard, _) = hidden(drawn, &Shot { shadow: Shadow::Hard, ..*shot })?;

    // Probe, choose, and trace what was chosen.
    let traced = Shot { shadow: Shadow::Traced, ..*shot };
    let mut rays_of = |rays, chosen: Vec<bool>| {
        truth.set_rays(Rays { rays, chosen });
        hidden(truth, &traced)
    };
    let least = ANGLE_MAX_DEG.to_radians().cos() as f32;
    let is_usable = |p: usize| is_smooth[p] && seen[p] != 0 && cosines[p] >= least;
    let usable: Vec<bool> = (0..seen.len()).map(is_usable).collect();
    let (probe, _) = rays_of(PROBE_RAYS, usable.clone())?;
    let kinds = [true, false].map(|in_penumbra| {
        let is_kind = |p: &usize| usable[*p] && (probe[*p] > 0.0 && probe[*p] < 1.0) == in_penumbra;
        (0..usable.len()).filter(is_kind).collect::<Vec<usize>>()
    });
    let chosen = kinds.each_ref().map(|pixels| choose(pixels, PIXELS, seed));
    let mut is_chosen = vec![false; usable.len()];
    chosen.iter().flatten().for_each(|&p| is_chosen[p] = true);
    let (exact, _) = rays_of(RAYS, is_chosen.clone())?;

    let mut scores =
        PenumbraScores { tiles_beyond: renderer.shadow_tiles_beyond(gpu)?, ..Default::default() };
    for ((stratum, pixels), all) in scores.strata.iter_mut().zip(&chosen).zip(&kinds) {
        stratum.1 = all.len() as u64;
        for &p in pixels {
            let values = [soft[p], hard[p], exact[p]];
            stratum.0.add(values);
            if exact[p] > 0.0 && exact[p] < 1.0 {
                scores.inside.add(values);
            }
        }
    }
    let truth: Vec<f64> =
        (0..usable.len()).map(|p| if is_chosen[p] { exact[p] } else { probe[p] }).collect();
    let kind = |p: usize| match (is_chosen[p], usable[p]) {
        (true, _) => Kind::Compared,
        (false, true) => Kind::Seen,
        (false, false) => Kind::LeftOut,
    };
    let kinds: Vec<Kind> = (0..usable.len()).map(kind).collect();
    Ok((scores, panels(size, [&soft, &hard, &truth], &kinds)))
}

/// What became of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Background, beside an outline, or light grazes it.
    LeftOut,
    /// Only a few rays were traced from it.
    Seen,
    Compared,
}

/// Side by side: soft shadows, hard ones, rays, each as the share of the light that is seen, and where soft ones are too dark
/// (red) or too bright (blue), white by half of the light; shares are hidden ones, 0 to 1.
fn panels(
    (width, height): (u32, u32),
    [soft, hard, truth]: [&[f64]; 3],
    kinds: &[Kind],
) -> Picture {
    const LEFT_OUT: [u8; 3] = [40, 44, 60];
    let level = |share: f64| (255.0 * share.clamp(0.0, 1.0)).round() as u8;
    let colour = |panel: usize, p: usize| -> [u8; 3] {
        match (panel, kinds[p]) {
            (2 | 3, Kind::LeftOut) => LEFT_OUT,
            (0..=2, _) => [level(1.0 - [soft, hard, truth][panel][p]); 3],
            (_, Kind::Seen | Kind::LeftOut) => [0; 3],
            (_, Kind::Compared) => {
                let more = soft[p] - truth[p];
                let strong = level(2.0 * more.abs());
                let rest = level(4.0 * more.abs() - 1.0);
                if more > 0.0 { [strong, rest, rest] } else { [rest, rest, strong] }
            }
        }
    };
    let row = |y: u32| {
        (0..4).flat_map(move |panel| (0..width).map(move |x| (panel, (y * width + x) as usize)))
    };
    let rgba = (0..height)
        .flat_map(row)
        .flat_map(|(panel, p)| {
            let [r, g, b] = colour(panel, p);
            [r, g, b, 255]
        })
        .collect();
    Picture { width: 4 * width, height, rgba }
}

/// So many of them by chance, each at most once (a linear congruential walk over a power of two; Hull & Dobell 1962).
fn choose(pixels: &[usize], count: usize, seed: u64) -> Vec<usize> {
    let period = pixels.len().max(1).next_power_of_two() as u64;
    let next =
        |at: u64| (at.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(2 * seed + 1)) % period;
    let walk = std::iter::successors(Some(seed % period), |&at| Some(next(at)));
    walk.take(period as usize)
        .filter_map(|at| pixels.get(at as usize).copied())
        .take(count)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_chosen_once_each_and_from_everywhere() {
        let pixels: Vec<usize> = (0..1000).map(|p| 3 * p).collect();
        for seed in 0..20 {
            let mut all = choose(&pixels, 5000, seed);
            assert_eq!(all.len(), 1000);
            all.sort_unstable();
            assert_eq!(all, pixels);
            let some = choose(&pixels, 200, seed);
            assert_eq!(some.len(), 200);
            let upper = some.iter().filter(|&&p| p >= 1500).count();
            assert!((60..=140).contains(&upper), "{upper} of 200 with {seed}");
        }
        assert!(choose(&[], 5, 1).is_empty());
    }

    #[test]
    fn what_is_too_dark_is_red_and_what_is_too_bright_blue() {
        use Kind::{Compared, LeftOut, Seen};
        let kinds = [Compared, Compared, Seen, LeftOut];
        let picture =
            panels((2, 2), [&[0.8, 0.2, 1.0, 0.0], &[1.0; 4], &[0.5, 0.5, 1.0, 0.0]], &kinds);
        assert_eq!((picture.width, picture.height), (8, 2));
        let at = |x: usize, y: usize| {
            let p = 4 * (y * 8 + x);
            [picture.rgba[p], picture.rgba[p + 1], picture.rgba[p + 2]]
        };
        assert_eq!([at(0, 0), at(1, 0), at(0, 1)], [[51; 3], [204; 3], [0; 3]]);
        assert_eq!([at(2, 0), at(4, 0)], [[0; 3], [128; 3]]);
        let [dark, bright] = [at(6, 0), at(7, 0)];
        assert!(dark[0] > 150 && dark[2] < 60 && bright[2] > 150 && bright[0] < 60);
        // Of what was not compared nothing is said.
        assert_eq!(at(6, 1), [0; 3]);
        assert_ne!(at(7, 1), [0; 3]);
    }

    #[test]
    fn strata_count_by_what_they_stand_for_and_wrong_shadows_are_told() {
        // A tenth of the pixels is in the penumbra, where soft ones are off by 0.1 and hard ones by 0.5.
        let strata = [(Sum::default(), 100), (Sum::default(), 900)];
        let mut scores = PenumbraScores { strata, ..PenumbraScores::default() };
        for _ in 0..50 {
            scores.strata[0].0.add([0.6, 1.0, 0.5]);
            scores.inside.add([0.6, 1.0, 0.5]);
            scores.strata[1].0.add([1.0, 1.0, 1.0]);
        }
        let report = scores.report();
        assert!((report.rmse - 0.1).abs() < 1e-12 && (report.hard_rmse - 0.5).abs() < 1e-12);
        assert!((report.rmse_everywhere - 0.1 * 0.1f64.sqrt()).abs() < 1e-12, "{report:?}");
        assert!((report.hard_rmse_everywhere - 0.5 * 0.1f64.sqrt()).abs() < 1e-12, "{report:?}");
        assert_eq!((report.pixels, report.pixels_elsewhere), (50, 50));
        // Views add up.
        let mut twice = scores;
        twice.merge(&scores);
        assert!((twice.report().rmse_everywhere - report.rmse_everywhere).abs() < 1e-12);
    }
}
