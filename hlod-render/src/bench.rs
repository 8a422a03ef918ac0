//! Frame rates along a recorded path.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::error::RenderError;
use crate::frame::Renderer;
use crate::framing::Framing;
use crate::gpu::Gpu;
use crate::model::{Model, ModelLimits};
use crate::path::CameraPath;
use crate::picture::{Canvas, PICTURE_FORMAT};
use crate::scene::Shot;
use crate::source::open_local;
use crate::system::drop_file_cache;

/// What is measured.
#[derive(Debug, Clone)]
pub struct BenchOptions {
    /// Picture size in pixels.
    pub size: (u32, u32),
    /// Frames along the whole path.
    pub frames: u32,
    /// Starts with nothing but the root and an empty file cache; frames then begin at the path's
    /// own pace. Otherwise everything the path needs is loaded first and frames follow one
    /// another at once.
    pub cold: bool,
    /// Limits on memory and reading.
    pub limits: ModelLimits,
}

/// A benchmark record; the keys are stable.
#[derive(Debug, Clone, Serialize)]
pub struct BenchReport {
    /// The file.
    pub file: PathBuf,
    /// Name of the path.
    pub path: String,
    /// Name of the representation.
    pub representation: &'static str,
    /// Adapter, backend and driver.
    pub adapter: String,
    /// Whether small triangles were rasterised in compute.
    pub small_triangles: bool,
    /// Version of this program.
    pub version: &'static str,
    /// Operating system, architecture and number of processors.
    pub machine: String,
    /// How to repeat it.
    pub command: Vec<String>,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// τ.
    pub tau_px: f64,
    /// Whether it started cold.
    pub cold: bool,
    /// Frames measured.
    pub frames: u32,
    /// Frames ÷ time spent drawing them.
    pub fps_mean: f64,
    /// Time of a frame, from asking for it to the GPU's having finished it.
    pub frame_ms: Percentiles,
    /// Mean triangles and points of a frame.
    pub primitives_mean: f64,
    /// What shadows were drawn.
    pub shadow: &'static str,
    /// Mean triangles that cast shadows.
    pub caster_primitives_mean: f64,
    /// Parts of what casts shadows for which lists had no room, of all frames.
    pub shadow_tiles_beyond: u32,
    /// Parts that were to cast shadows and were not here, summed over frames.
    pub missing_casters: u64,
    /// Frames that lacked any.
    pub frames_missing_casters: u32,
    /// Mean points ÷ pixels covered by points; 0 without points.
    pub points_per_covered_pixel: f64,
    /// Frames in which nothing could be drawn.
    pub stalled_frames: u32,
    /// Frames that drew something coarser than τ.
    pub frames_over_tau: u32,
    /// Mean over frames of the area-weighted max(1, ρ/τ).
    pub tau_ratio_mean: f64,
    /// Frames that drew something coarser than 2τ, after the path's first two seconds.
    pub frames_over_2tau: u32,
    /// Frames that were drawn coarser than asked for because it did not fit into the GPU's memory.
    pub frames_coarsened: u32,
    /// Bytes read while measuring.
    pub bytes_read: u64,
    /// Of pages that were drawn after they were read.
    pub bytes_drawn: u64,
    /// Most bytes of geometry on the GPU.
    pub resident_bytes_max: u64,
    /// Mean milliseconds of a frame's stages: what the processor does before the GPU begins (`choose`), then each by the
    /// GPU's clock, in order. Empty unless the GPU was opened to take them.
    pub stages_ms: Vec<StageTime>,
    /// Each frame's time, for plots.
    pub frame_times_ms: Vec<f64>,
}

/// How long a stage took in the mean.
#[derive(Debug, Clone, Serialize)]
pub struct StageTime {
    /// Its name.
    pub stage: &'static str,
    /// Milliseconds a frame.
    pub ms: f64,
}

/// Of frame times in milliseconds.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

/// Measures frames along a path; `advance` hears of each finished one.
///
/// # Errors
/// When the file or the path cannot be used, or the GPU fails.
pub fn bench(
    gpu: &Gpu,
    file: &Path,
    path: &CameraPath,
    shot_template: &Shot,
    options: &BenchOptions,
    advance: &mut dyn FnMut(u32),
) -> Result<BenchReport, RenderError> {
    let (width, height) = options.size;
    let canvas = Canvas::new(gpu, width, height)?;
    let mut renderer = Renderer::new(gpu, PICTURE_FORMAT);
    open_local(file)?;
    if options.cold {
        drop_file_cache(file)?;
    }
    // What is warm has all it needs: reading ahead would only take time from drawing.
    let prefetch = options.limits.prefetch && options.cold;
    let mut models = [Model::open(gpu, file, ModelLimits { prefetch, ..options.limits })?];
    let placed = path.place(Framing::of(&models[0]), file)?;
    let shot_at = |frame: u32| {
        let share = f64::from(frame) / f64::from((options.frames - 1).max(1));
        Shot { camera: placed.camera_at(share * path.duration_secs), ..*shot_template }
    };
    if options.cold {
        drop_file_cache(file)?;
    } else {
        // Load what the path needs, as far as memory allows.
        for frame in 0..options.frames {
            renderer.render_complete(gpu, &mut models, &shot_at(frame), &canvas.targets)?;
        }
        gpu.wait()?;
    }

    let bytes_before = models[0].bytes_read();
    let drawn_before = models[0].drawn_bytes();
    let mut times = Vec::new();
    let mut report = BenchReport {
        file: file.to_owned(),
        path: path.name.clone(),
        representation: shot_template.representation.name(),
        adapter: gpu.describe(),
        small_triangles: gpu.small_triangles,
        version: env!("CARGO_PKG_VERSION"),
        machine: machine(),
        command: std::env::args().collect(),
        width,
        height,
        tau_px: shot_template.error_threshold_px,
        cold: options.cold,
        frames: options.frames,
        fps_mean: 0.0,
        frame_ms: Percentiles { p50: 0.0, p95: 0.0, p99: 0.0, max: 0.0 },
        primitives_mean: 0.0,
        shadow: shot_template.shadow.name(),
        caster_primitives_mean: 0.0,
        shadow_tiles_beyond: 0,
        missing_casters: 0,
        frames_missing_casters: 0,
        points_per_covered_pixel: 0.0,
        stalled_frames: 0,
        frames_over_tau: 0,
        tau_ratio_mean: 0.0,
        frames_over_2tau: 0,
        frames_coarsened: 0,
        bytes_read: 0,
        bytes_drawn: 0,
        resident_bytes_max: 0,
        stages_ms: Vec::new(),
        frame_times_ms: Vec::new(),
    };
    let (mut points, mut covered) = (0, 0);
    let begin = Instant::now();
    for frame in 0..options.frames {
        if options.cold {
            let share = f64::from(frame) / f64::from(options.frames);
            let due = begin + Duration::from_secs_f64(share * path.duration_secs);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        let start = Instant::now();
        let stats = renderer.render(gpu, &mut models, &shot_at(frame), &canvas.targets)?;
        let submitted = start.elapsed();
        gpu.wait()?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
        if gpu.is_timed {
            let mut stages = vec![("choose", submitted.as_secs_f64() * 1e3)];
            stages.extend(renderer.stage_times(gpu)?);
            add_stages(&mut report.stages_ms, &stages, options.frames);
        }

        report.primitives_mean +=
            (stats.triangles + stats.points) as f64 / f64::from(options.frames);
        report.caster_primitives_mean += stats.caster_triangles as f64 / f64::from(options.frames);
        report.missing_casters += stats.missing_casters as u64;
        report.frames_missing_casters += u32::from(stats.missing_casters > 0);
        report.tau_ratio_mean += stats.tau_ratio / f64::from(options.frames);
        report.frames_over_tau += u32::from(stats.tau_ratio_max > 1.0);
        let secs = f64::from(frame) / f64::from(options.frames) * path.duration_secs;
        report.frames_over_2tau += u32::from(secs > 2.0 && stats.tau_ratio_max > 2.0);
        report.frames_coarsened += u32::from(stats.coarsening > 1.0);
        // A front that wants something and draws nothing leaves the picture empty.
        report.stalled_frames += u32::from(stats.nodes == 0 && stats.missing_parts > 0);
        report.resident_bytes_max = report.resident_bytes_max.max(models[0].resident_bytes());
        advance(frame);
        if stats.points > 0 && frame % options.frames.div_ceil(COVERAGE_FRAMES).max(1) == 0 {
            points += stats.points;
            covered += covered_by_points(gpu, &models[0], &canvas)?;
        }
    }
    if covered > 0 {
        report.points_per_covered_pixel = points as f64 / covered as f64;
    }
    report.shadow_tiles_beyond = renderer.shadow_tiles_beyond(gpu)?;
    report.bytes_read = models[0].bytes_read() - bytes_before;
    report.bytes_drawn = models[0].drawn_bytes() - drawn_before;
    report.fps_mean = f64::from(options.frames) / times.iter().sum::<f64>() * 1e3;
    report.frame_times_ms = times.clone();
    report.frame_ms = percentiles(&mut times);
    if let Some(problem) = models[0].take_problems().first() {
        return Err(gpu.error(format!("a part of the file is damaged: {problem}")));
    }
    Ok(report)
}

fn add_stages(means: &mut Vec<StageTime>, stages: &[(&'static str, f64)], frames: u32) {
    for &(stage, ms) in stages {
        let ms = ms / f64::from(frames);
        match means.iter_mut().find(|mean| mean.stage == stage) {
            Some(mean) => mean.ms += ms,
            None => means.push(StageTime { stage, ms }),
        }
    }
}

/// In so many frames the pixels that points cover are counted, between the frames' times.
const COVERAGE_FRAMES: u32 = 16;

fn covered_by_points(gpu: &Gpu, model: &Model, canvas: &Canvas) -> Result<u64, RenderError> {
    let bytes = gpu.read_texture(canvas.targets.identity(), wgpu::TextureAspect::All)?;
    let identities = bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let points = model.point_identities();
    let is_point = |identity: u32| {
        let after = points.partition_point(|range| range.start <= identity);
        after > 0 && points[after - 1].contains(&identity)
    };
    Ok(identities.filter(|&identity| is_point(identity & !(1 << 31))).count() as u64)
}

/// # Panics
/// When there are no times.
fn percentiles(times: &mut [f64]) -> Percentiles {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
    Percentiles { p50: at(0.5), p95: at(0.95), p99: at(0.99), max: at(1.0) }
}

fn machine() -> String {
    let processors = std::thread::available_parallelism().map_or(0, |n| n.get());
    format!("{} {}, {processors} processors", std::env::consts::OS, std::env::consts::ARCH)
}

impl BenchReport {
    /// Frame times as an SVG plot.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn plot(&self, path: &Path) -> Result<(), RenderError> {
        let failed = |e: &dyn std::fmt::Display| RenderError::Malformed {
            path: path.to_owned(),
            why: format!("cannot write the plot: {e}"),
        };
        self.draw_plot(path).map_err(|e| failed(&e))
    }

    fn draw_plot(&self, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
        use plotters::prelude::*;
        let area = SVGBackend::new(path, (900, 360)).into_drawing_area();
        area.fill(&WHITE)?;
        let top = self.frame_ms.max * 1.1;
        let caption = format!(
            "{} · {} · {} · τ = {} px · {}×{} · {}",
            self.file.file_name().unwrap_or_default().to_string_lossy(),
            self.path,
            self.representation,
            self.tau_px,
            self.width,
            self.height,
            self.adapter
        );
        let mut chart = ChartBuilder::on(&area)
            .caption(caption, ("sans-serif", 14))
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(52)
            .build_cartesian_2d(0.0..f64::from(self.frames.max(1)), 0.0..top)?;
        chart
            .configure_mesh()
            .x_desc("frame")
            .y_desc("milliseconds")
            .light_line_style(WHITE)
            .draw()?;
        let points = self.frame_times_ms.iter().enumerate().map(|(i, &ms)| (i as f64, ms));
        chart.draw_series(LineSeries::new(points, &BLUE))?;
        let median = [(0.0, self.frame_ms.p50), (f64::from(self.frames), self.frame_ms.p50)];
        chart.draw_series(LineSeries::new(median, &BLACK.mix(0.4)))?;
        area.present()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_of_known_times() {
        let p = percentiles(&mut (0..=100).rev().map(f64::from).collect::<Vec<_>>());
        assert_eq!((p.p50, p.p95, p.p99, p.max), (50.0, 95.0, 99.0, 100.0));
        assert_eq!(percentiles(&mut [3.0]).p99, 3.0);
    }
}
