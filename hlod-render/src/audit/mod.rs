//! What is drawn, compared with the scan itself.
//!
//! For each view the scan is drawn at full resolution with 4 × 4 samples a pixel, by the same
//! passes but from its own vertices: neither the builder nor the octree has a part in it. Then
//!
//! - a *hole* is a pixel well inside the reference that shows background or something far behind,
//!   backs of closed surfaces left out: through a crack one sees only what lies beyond;
//! - *overdraw* is a pixel drawn more than a pixel outside the reference;
//! - *appearance distance* is how far one must look in the reference to find a pixel's shade, and
//!   the other way round; the full model at one sample a pixel is scored too: the floor, which is
//!   what sampling alone costs;
//! - *silhouette distance* is between the outlines, at 8 × 8 positions a pixel;
//! - *penumbrae*, where soft shadows are asked for, with rays to all of the light;
//! - *shadow edges*, where hard shadows are asked for (everything above is scored without), are compared at as many positions with those that
//!   rays against the scan's triangles find.

pub mod distance_transform;
pub mod penumbra;
pub mod pixels;
mod reference;
pub mod seams;
pub mod shadows;
pub mod silhouette;

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Serialize;

use crate::camera::{Camera, Projection};
use crate::error::RenderError;
use crate::frame::{FrameStats, Renderer};
use crate::framing::{FOV_Y_DEG, Framing};
use crate::gpu::Gpu;
use crate::model::{Model, ModelLimits};
use crate::path::CameraPath;
use crate::picture::{Canvas, PICTURE_FORMAT, Picture};
use crate::scene::{Light, Shadow, Shot, direction_from_angles, light_from_angles};

use penumbra::{Penumbra, PenumbraScores, compare_penumbrae};
use pixels::{Distances, Layer, SAMPLES, score};
use reference::{Rays, Reference};
use shadows::{ShadowEdge, ShadowScores, compare_shadows};
use silhouette::{Mask, SUBPIXELS};

/// What is compared.
#[derive(Debug, Clone)]
pub struct AuditOptions {
    /// Picture size in pixels.
    pub size: (u32, u32),
    /// Number of views.
    pub views: u32,
    /// Views at equal times along this path; else round the statue at several distances.
    pub path: Option<CameraPath>,
    /// Azimuth and elevation of the light in degrees, relative to each picture.
    pub light: (f64, f64),
    /// In place of that another light in each view, parallel and lamps in turn, all of this diameter in heights of the
    /// statue where they are not points.
    pub varied_lights: Option<f64>,
    /// Where pictures of the worst view go.
    pub pictures: Option<PathBuf>,
}

/// Result of an audit; the keys are stable.
#[derive(Debug, Clone, Serialize)]
pub struct AuditReport {
    /// The file.
    pub file: PathBuf,
    /// Name of the representation.
    pub representation: &'static str,
    /// Adapter, backend and driver.
    pub adapter: String,
    /// τ.
    pub tau_px: f64,
    /// Views compared.
    pub views: u32,
    /// Pixels whose shade was compared.
    pub pixels_compared: u64,
    /// Pixels that show something behind the surface.
    pub hole_pixels: u64,
    /// Pixels that would show a back of a closed surface right in front of a front, were backs
    /// drawn: folds and outlines within the surface.
    pub fold_pixels: u64,
    /// Pixels drawn outside the reference.
    pub overdraw_pixels: u64,
    /// How far shades are from their place.
    pub appearance_distance_px: AppearanceDistance,
    /// How far outlines are from their place.
    pub silhouette_distance_px: SilhouetteDistance,
    /// How far shadows' edges are from their place, where hard shadows were drawn.
    pub shadow_edge_px: Option<ShadowEdge>,
    /// How much of the light is seen wrongly in penumbrae, root of the mean square, where soft shadows were drawn.
    pub penumbra_rmse: Option<f64>,
    /// More of these.
    pub penumbra: Option<Penumbra>,
    /// The same for each view.
    pub per_view: Vec<ViewScore>,
}

/// In pixels; the worse of both directions.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct AppearanceDistance {
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Largest; [`pixels::DISTANCE_MAX_PX`] stands for that or more.
    pub max: f64,
    /// 99.9th percentile of the full model at one sample a pixel.
    pub floor_p999: f64,
}

/// In pixels; the worse of both directions.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct SilhouetteDistance {
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Share of the outlines that was scored; the rest belongs to features that vanish under an
    /// opening or closing by a disc of one pixel.
    pub scored_share: f64,
}

/// One view's scores.
#[derive(Debug, Clone, Serialize)]
pub struct ViewScore {
    /// Eye, source coordinates.
    pub eye: [f64; 3],
    /// Point it looks at.
    pub target: [f64; 3],
    /// Hole pixels.
    pub hole_pixels: u64,
    /// Overdraw pixels.
    pub overdraw_pixels: u64,
    /// Appearance distance, 99.9th percentile, worse direction.
    pub appearance_p999_px: f64,
    /// Silhouette distance, 99.9th percentile, worse direction.
    pub silhouette_p999_px: f64,
}

/// Compares views of `file` with `against`, the scans it was built from; `advance` hears of each
/// finished view.
///
/// # Errors
/// When a file cannot be used or the GPU fails.
pub fn audit(
    gpu: &Gpu,
    file: &Path,
    against: &[PathBuf],
    shot_template: &Shot,
    options: &AuditOptions,
    advance: &mut dyn FnMut(u32),
) -> Result<AuditReport, RenderError> {
    let mut models = [Model::open(gpu, file, ModelLimits::default())?];
    let with_shadows = shot_template.shadow != Shadow::None;
    let is_soft = shot_template.shadow == Shadow::Soft;
    let mut reference = Reference::load(gpu, against, &models[0], with_shadows)?;
    let closed_oriented = reference.closed_oriented;
    let framing = Framing::of(&models[0]);
    let cameras = cameras(&framing, file, options.path.as_ref(), options.views, options.size)?;
    let mut renderer = Renderer::new(gpu, PICTURE_FORMAT);

    let mut test = [Distances::default(), Distances::default()];
    let mut floor = [Distances::default(), Distances::default()];
    let mut outlines = [silhouette::Scores::default(), silhouette::Scores::default()];
    let mut shadows = ShadowScores::default();
    let mut penumbrae = PenumbraScores::default();
    let mut per_view: Vec<ViewScore> = Vec::new();
    let (mut holes, mut folds, mut overdraw, mut compared) = (0, 0, 0, 0);
    let (mut worst, mut worst_penumbra) = (-1.0, -1.0);
    for (i, camera) in cameras.iter().enumerate() {
        let light = light_from_angles(camera, options.light.0, options.light.1);
        let in_shadow = Shot { camera: *camera, light, ..*shot_template };
        let in_shadow = match options.varied_lights {
            Some(size) => varied_light(in_shadow, &framing, i as u32, size),
            None => in_shadow,
        };
        let shot = Shot { shadow: Shadow::None, ..in_shadow };

        // Draw: as the user sees it, and the reference at 4 × 4 and at one sample a pixel.
        let (width, height) = options.size;
        let with_backs = Shot { draw_backs: true, ..shot };
        let mut draw_layer = |source: &mut Source<'_>, shot: &Shot, n: u32| {
            draw_layer(gpu, &mut renderer, source, shot, (width, height), n)
        };
        let mut source = Source::Models(&mut models);
        let drawn = draw_layer(&mut source, &with_backs, 1)?;
        let culled = draw_layer(&mut source, &Shot { draw_backs: false, ..shot }, 1)?.layer;
        let mut source = Source::Reference(&mut reference);
        let truth = draw_layer(&mut source, &with_backs, SAMPLES)?;
        let once = draw_layer(&mut source, &with_backs, 1)?;

        let half_extent = camera.half_extent(f64::from(width) / f64::from(height));
        let pixel_at_unit_depth = 2.0 * half_extent.y / f64::from(height);
        let perspective = matches!(camera.projection, Projection::Perspective { .. });
        let scale = pixels::Scale {
            pixel_at_unit_depth,
            perspective,
            tau_px: shot.error_threshold_px,
            rounding: models[0].leaf_rounding(),
            margin_px: 1,
            backs_are_holes: closed_oriented,
        };
        let scores = score(&drawn.layer, &culled, &truth.layer, &scale);
        let floor_scores = score(&once.layer, &once.layer, &truth.layer, &scale);

        // Outlines at 8 × 8 positions a pixel.
        let fine = (width * SUBPIXELS, height * SUBPIXELS);
        let drawn_mask =
            draw_mask(gpu, &mut renderer, &mut Source::Models(&mut models), &with_backs, fine)?;
        let truth_mask = draw_mask(gpu, &mut renderer, &mut source, &with_backs, fine)?;
        let view_outlines = silhouette::compare(&drawn_mask, &truth_mask);

        if with_shadows {
            let is_smooth = pixels::smooth(&truth.layer, &scale);
            let mut models = Source::Models(&mut models);
            let sources = [&mut models, &mut source];
            let (size, smooth) = (options.size, &is_smooth);
            if is_soft {
                let seed = i as u64;
                let (of_view, panels) =
                    compare_penumbrae(gpu, &mut renderer, sources, &in_shadow, size, smooth, seed)?;
                penumbrae.merge(&of_view);
                if let Some(folder) =
                    options.pictures.as_ref().filter(|_| of_view.rmse() > worst_penumbra)
                {
                    worst_penumbra = of_view.rmse();
                    std::fs::create_dir_all(folder).map_err(RenderError::io(folder, "create"))?;
                    panels.save(&folder.join("penumbra.png"))?;
                }
            } else {
                let of_view =
                    compare_shadows(gpu, &mut renderer, sources, &in_shadow, size, smooth)?;
                shadows.merge(&of_view);
            }
        }

        let p999 = |d: &[Distances; 2]| d[0].percentile(0.999).max(d[1].percentile(0.999));
        let silhouette_p999_px =
            view_outlines[0].percentile(0.999).max(view_outlines[1].percentile(0.999));
        per_view.push(ViewScore {
            eye: camera.eye.to_array(),
            target: camera.target.to_array(),
            hole_pixels: scores.holes.len() as u64,
            overdraw_pixels: scores.overdraw.len() as u64,
            appearance_p999_px: p999(&scores.appearance),
            silhouette_p999_px,
        });
        let badness =
            1e6 * (scores.holes.len() + scores.overdraw.len()) as f64 + p999(&scores.appearance);
        if let Some(folder) = options.pictures.as_ref().filter(|_| badness > worst) {
            worst = badness;
            save_pictures(folder, &drawn.picture, &truth.picture, &scores)?;
        }
        holes += scores.holes.len() as u64;
        folds += scores.folds.len() as u64;
        overdraw += scores.overdraw.len() as u64;
        compared += scores.appearance[0].count();
        for side in 0..2 {
            test[side].merge(&scores.appearance[side]);
            floor[side].merge(&floor_scores.appearance[side]);
            outlines[side].merge(&view_outlines[side]);
        }
        advance(i as u32);
    }

    let worse = |d: &[Distances; 2], share: f64| d[0].percentile(share).max(d[1].percentile(share));
    let worse_outline =
        |share: f64| outlines[0].percentile(share).max(outlines[1].percentile(share));
    Ok(AuditReport {
        file: file.to_owned(),
        representation: shot_template.representation.name(),
        adapter: gpu.describe(),
        tau_px: shot_template.error_threshold_px,
        views: cameras.len() as u32,
        pixels_compared: compared,
        hole_pixels: holes,
        fold_pixels: folds,
        overdraw_pixels: overdraw,
        appearance_distance_px: AppearanceDistance {
            p99: worse(&test, 0.99),
            p999: worse(&test, 0.999),
            max: worse(&test, 1.0),
            floor_p999: worse(&floor, 0.999),
        },
        silhouette_distance_px: SilhouetteDistance {
            p99: worse_outline(0.99),
            p999: worse_outline(0.999),
            scored_share: silhouette::scored_share(&outlines),
        },
        shadow_edge_px: (with_shadows && !is_soft).then(|| shadows.report()),
        penumbra_rmse: is_soft.then(|| penumbrae.report().rmse),
        penumbra: is_soft.then(|| penumbrae.report()),
        per_view,
    })
}

/// The light of one of many views: from azimuths and elevations that do not repeat, seen from the camera, in turn parallel
/// and a lamp one and a half heights from the statue's middle. Parallel light is as wide as the lamp would be.
fn varied_light(shot: Shot, framing: &Framing, view: u32, size: f64) -> Shot {
    const DISTANCE_HEIGHTS: f64 = 1.5;
    let n = f64::from(view) + 0.5;
    // Multiples of the golden ratio and of the square root of two, which leave no gaps.
    let azimuth = 160.0 * (n * 0.618_033_988_749_895).fract() - 80.0;
    let elevation = 5.0 + 65.0 * (n * std::f64::consts::SQRT_2).fract();
    let towards = direction_from_angles(shot.camera.axes(), azimuth, elevation);
    let distance = DISTANCE_HEIGHTS * framing.height;
    match view % 2 {
        0 => {
            let light_size = 2.0 * (size / 2.0 / DISTANCE_HEIGHTS).atan().to_degrees();
            Shot { light: Light::Directional(towards), light_size, ..shot }
        }
        _ => {
            let light = Light::Point(framing.centre + towards * distance);
            Shot { light, light_size: size * framing.height, ..shot }
        }
    }
}

/// Views along the path, or round the statue on a spiral (Fibonacci sphere) from far to near.
fn cameras(
    framing: &Framing,
    file: &Path,
    path: Option<&CameraPath>,
    views: u32,
    size: (u32, u32),
) -> Result<Vec<Camera>, RenderError> {
    let aspect = f64::from(size.0) / f64::from(size.1);
    if let Some(path) = path {
        let placed = path.place(*framing, file)?;
        let share = |i: u32| f64::from(i) / f64::from((views - 1).max(1));
        return Ok((0..views).map(|i| placed.camera_at(share(i) * path.duration_secs)).collect());
    }
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    Ok((0..views)
        .map(|i| {
            let n = f64::from(views);
            let y = 0.8 - 1.6 * (f64::from(i) + 0.5) / n;
            let angle = golden * f64::from(i);
            let radius = (1.0 - y * y).sqrt();
            let mut camera =
                framing.fitting([radius * angle.sin(), y, radius * angle.cos()], aspect, FOV_Y_DEG);
            // Every third view is the whole figure, the others come two and four times nearer.
            let nearer = [1.0, 0.5, 0.25][i as usize % 3];
            let offset: DVec3 = (camera.eye - camera.target) * nearer;
            camera.eye = camera.target + offset;
            camera.near = framing.near(camera.eye);
            camera
        })
        .collect())
}

enum Source<'a> {
    Models(&'a mut [Model]),
    Reference(&'a mut Reference),
}

impl Source<'_> {
    /// How many rays are traced from which pixels of the reference.
    fn set_rays(&mut self, rays: Rays) {
        if let Source::Reference(reference) = self {
            reference.rays = Some(rays);
        }
    }
}

/// What is read back of one drawing.
struct Drawing {
    layer: Layer,
    picture: Picture,
    /// As [`Canvas::identities`].
    identities: Vec<u32>,
    stats: FrameStats,
}

/// Draws at `n` × `n` samples a pixel, unfiltered.
fn draw_layer(
    gpu: &Gpu,
    renderer: &mut Renderer,
    source: &mut Source<'_>,
    shot: &Shot,
    (width, height): (u32, u32),
    n: u32,
) -> Result<Drawing, RenderError> {
    let canvas = Canvas::new(gpu, width * n, height * n)?;
    // The front is the user's, whatever the number of samples.
    let shot = shot.finer(n);
    let stats = draw(gpu, renderer, source, &shot, &canvas)?;
    let picture = canvas.picture(gpu)?;
    let identities = canvas.identities(gpu)?;
    let near = shot.camera.near;
    let range = 4.0 * shot.camera.eye.distance(shot.camera.target);
    let depths = canvas.depths(gpu)?.into_iter().map(|z| match shot.camera.projection {
        Projection::Perspective { .. } => (near / f64::from(z)) as f32,
        // Inverts Camera::clip_from_view.
        Projection::Orthographic { .. } => {
            ((0.5 - f64::from(z)) * 2.0 * range + range / 4.0) as f32
        }
    });
    let layer = Layer::new(width * n, height * n, &picture.rgba, &identities, depths.collect());
    Ok(Drawing { layer, picture, identities, stats })
}

fn draw_mask(
    gpu: &Gpu,
    renderer: &mut Renderer,
    source: &mut Source<'_>,
    shot: &Shot,
    (width, height): (u32, u32),
) -> Result<Mask, RenderError> {
    let canvas = Canvas::new(gpu, width, height)?;
    draw(gpu, renderer, source, &shot.finer(SUBPIXELS), &canvas)?;
    let covered = canvas.identities(gpu)?.into_iter().map(|id| id != 0).collect();
    Ok(Mask { width: width as usize, height: height as usize, covered })
}

fn draw(
    gpu: &Gpu,
    renderer: &mut Renderer,
    source: &mut Source<'_>,
    shot: &Shot,
    canvas: &Canvas,
) -> Result<FrameStats, RenderError> {
    match source {
        Source::Models(models) => {
            let stats = renderer.render_complete(gpu, models, shot, &canvas.targets)?;
            if let Some(problem) = models.iter_mut().find_map(|m| m.take_problems().pop()) {
                return Err(gpu.error(format!("a part of the file is damaged: {problem}")));
            }
            Ok(stats)
        }
        Source::Reference(reference) => {
            reference.draw(gpu, renderer, shot, &canvas.targets)?;
            Ok(FrameStats::default())
        }
    }
}

/// The picture, the reference, and where they differ: holes red, overdraw blue, distance grey.
fn save_pictures(
    folder: &Path,
    drawn: &Picture,
    truth: &Picture,
    scores: &pixels::Scores,
) -> Result<(), RenderError> {
    std::fs::create_dir_all(folder).map_err(RenderError::io(folder, "create"))?;
    drawn.save(&folder.join("drawn.png"))?;
    truth.reduced(SAMPLES).save(&folder.join("reference.png"))?;
    let mut rgba: Vec<u8> = scores
        .distance_px
        .iter()
        .flat_map(|&d| {
            let grey = (d * 60.0).min(255.0) as u8;
            [grey, grey, grey, 255]
        })
        .collect();
    for (pixels, colour) in
        [(&scores.holes, [255, 0, 0, 255]), (&scores.overdraw, [0, 80, 255, 255])]
    {
        for &p in pixels {
            rgba[4 * p..4 * p + 4].copy_from_slice(&colour);
        }
    }
    Picture { width: drawn.width, height: drawn.height, rgba }.save(&folder.join("difference.png"))
}
