//! The command line as typed, and as validated options.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use glam::DVec3;

use super::section::SectionArgs;
use super::simulate::SimulateArgs;
use super::work::{MeasureArgs, NotesArgs, SessionArgs};
use hlod_render::camera::Camera;
use hlod_render::framing::{FOV_Y_DEG, Framing, NAMED_VIEWS};
use hlod_render::scene::{
    CASTER_THRESHOLD_PX, Enhance, INTENSITY_STEP, Light, Representation, Shadow, Spot,
};
use hlod_render::shadow_map::{MapProjection, ShadowMap};
use hlod_render::{AdapterChoice, Gpu, ModelLimits, RenderError};

use super::figure_args::{FigureArgs, LightDomeArgs, PlateArgs, TurntableArgs};

/// Show .hlod files, measure on them, make figures; and check how fast and how truthful all that is.
#[derive(Parser)]
#[command(name = "hlod-render", version, max_term_width = 100)]
#[command(after_help = "\
Lengths in --camera and --light are statue heights, counted from the centre of its bounds along \
right, up and front.\n\n\
Exit status: 0 good, 1 the work failed, 2 wrong usage, 3 checked and refuted.")]
pub struct Cli {
    /// No progress bars and no remarks.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Draw with the software rasteriser even where there is a GPU.
    #[arg(long, global = true)]
    pub software: bool,
    #[command(subcommand)]
    pub command: Command,
}

impl Cli {
    /// The GPU as it was asked for.
    pub fn gpu(&self, draw: &DrawArgs) -> Result<Gpu, RenderError> {
        Ok(passes_of(Gpu::headless(self.adapter())?, draw))
    }

    /// The same, to take the time of a frame's stages.
    pub fn timed_gpu(&self, draw: &DrawArgs) -> Result<Gpu, RenderError> {
        Ok(passes_of(Gpu::headless_timed(self.adapter())?, draw))
    }

    pub fn adapter(&self) -> AdapterChoice {
        if self.software { AdapterChoice::Software } else { AdapterChoice::Best }
    }
}

fn passes_of(mut gpu: Gpu, draw: &DrawArgs) -> Gpu {
    gpu.small_triangles &= !draw.fixed_function;
    gpu
}

#[derive(Subcommand)]
pub enum Command {
    /// Open a window on a statue; F1 there shows what keys and the mouse do.
    #[cfg(feature = "viewer")]
    View(ViewArgs),
    /// Says that this program has no window.
    #[cfg(not(feature = "viewer"))]
    #[command(hide = true, disable_help_flag = true)]
    View {
        /// Whatever follows.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
        rest: Vec<std::ffi::OsString>,
    },
    /// Write a picture to a PNG or TIFF file, of any size, and to scale if that is asked for.
    Shot(ShotArgs),
    /// Lay out views at one scale on a page: front, left, back, right and top, as drawings are.
    Plate(PlateArgs),
    /// Write pictures from all round to a folder.
    Turntable(TurntableArgs),
    /// Write pictures of one view under many lights to a folder, with their list (.lp), for relighting
    /// and photometric stereo.
    LightDome(LightDomeArgs),
    /// Measure on the scan's own surface: between given points, or all that a session holds.
    Measure(MeasureArgs),
    /// Cut a statue with planes: outlines, their measures, drawings to scale.
    Section(SectionArgs),
    /// List the notes of a session, or write them for other programs.
    Notes(NotesArgs),
    /// Measure frame rates along a recorded camera path.
    Bench(BenchArgs),
    /// Compare policies of loading along a camera path, without drawing: a link of a given bandwidth
    /// and latency, and what would have been seen.
    Simulate(SimulateArgs),
    /// Compare what is drawn with the scan itself, pixel by pixel.
    Audit(AuditArgs),
}

/// Where machine-readable results go.
#[derive(Args)]
pub struct JsonArgs {
    /// Print the result as JSON, or write it to FILE.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    pub json: Option<Option<PathBuf>>,
}

impl DrawArgs {
    /// The picture's size where nothing else decides it.
    pub fn size(&self) -> (u32, u32) {
        self.size.unwrap_or((640, 480))
    }
}

/// How precisely statues are drawn.
#[derive(Args)]
pub struct PrecisionArgs {
    /// Largest error on the screen in pixels (τ): smaller is finer and slower.
    #[arg(long, value_name = "PX", default_value_t = 0.5, value_parser = positive)]
    pub tau: f64,
    /// What is drawn of the file.
    #[arg(long, value_enum, default_value = "hybrid")]
    pub representation: RepresentationArg,
}

/// What every picture needs.
#[derive(Args)]
pub struct DrawArgs {
    /// Picture size in pixels [default: 640x480; with --scale as large as the statue needs].
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<(u32, u32)>,
    #[command(flatten)]
    pub precision: PrecisionArgs,
    /// Leave small triangles to the adapter's rasteriser, too, instead of compute.
    #[arg(long)]
    pub fixed_function: bool,
    /// Shadows: none, hard, soft, or traced, which is either by rays against every triangle of the
    /// scan.
    #[arg(long, value_enum, default_value = "none")]
    pub shadow: ShadowArg,
    /// Diameter of the light, where shadows are soft or traced: of a lamp in statue heights, of
    /// parallel light the angle in degrees under which it is seen [default: soft 0.05 or 3, traced 0].
    #[arg(long, value_name = "SIZE", value_parser = not_negative)]
    pub light_size: Option<f64>,
    /// Largest shift of a shadow's edge by what casts it, in pixels (τ_c).
    #[arg(long, value_name = "PX", default_value_t = CASTER_THRESHOLD_PX, value_parser = positive)]
    pub caster_tau: f64,
    /// Largest step of a soft shadow's brightness by what casts it, 0 to 0.5 of the light (γ).
    #[arg(long, value_name = "SHARE", default_value_t = INTENSITY_STEP, value_parser = half_share)]
    pub shadow_step: f64,
    /// Shadows' edges within a pixel up to 60° of incidence: the same as --tau 0.25 --caster-tau 0.25.
    #[arg(long, conflicts_with_all = ["tau", "caster_tau"])]
    pub shadow_exact: bool,
    #[command(flatten)]
    pub map: MapArgs,
    /// AZIMUTH,ELEVATION of parallel light in degrees, relative to the picture: 0,0 comes from the
    /// eye, positive from the right and from above; or RIGHT,UP,FRONT of a lamp (not for audits).
    #[arg(long, value_name = "LIGHT", default_value = "-45,40", value_parser = numbers::<2, 3>, allow_hyphen_values = true)]
    pub light: Numbers,
    /// The lamp of --light RIGHT,UP,FRONT shines within a cone so many degrees wide, aimed at the middle of the
    /// statue or at RIGHT,UP,FRONT.
    #[arg(long, value_name = "DEG[,R,U,F]", value_parser = spot_numbers, allow_hyphen_values = true)]
    pub spot: Option<Numbers>,
    #[command(flatten)]
    pub enhance: EnhanceArgs,
}

/// Contrast that follows relief.
#[derive(Args, Clone, Copy)]
pub struct EnhanceArgs {
    /// Contrast that follows relief, 0 to 1, in whatever light: what bulges is brighter, what is hollow
    /// darker, so that worn inscriptions can be read.
    #[arg(long, value_name = "STRENGTH", default_value_t = 0.0, value_parser = share)]
    pub enhance: f32,
    /// Within how many pixels relief is looked for, 1 to 32: about half as wide as a stroke is in the
    /// picture. Also of --paint curvature.
    #[arg(long, value_name = "PX", default_value_t = 4.0, value_parser = enhance_radius)]
    pub enhance_radius: f32,
}

impl EnhanceArgs {
    pub fn enhance(&self) -> Enhance {
        Enhance { strength: self.enhance, radius_px: self.enhance_radius }
    }
}

fn share(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(value) if (0.0..=1.0).contains(&value) => Ok(value),
        _ => Err("expected 0 to 1".into()),
    }
}

fn half_share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (0.0..=0.5).contains(&value) => Ok(value),
        _ => Err("expected 0 to 0.5".into()),
    }
}

fn enhance_radius(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(value) if (1.0..=Enhance::RADIUS_MAX_PX).contains(&value) => Ok(value),
        _ => Err(format!("expected 1 to {} pixels", Enhance::RADIUS_MAX_PX)),
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub enum ShadowArg {
    None,
    Hard,
    Soft,
    /// Hard ones with a shadow map, as other programs draw them: to compare with.
    Map,
    Traced,
}

impl DrawArgs {
    pub fn shadow(&self) -> Shadow {
        match self.shadow {
            ShadowArg::None => Shadow::None,
            ShadowArg::Hard => Shadow::Hard,
            ShadowArg::Soft => Shadow::Soft,
            ShadowArg::Map => Shadow::Mapped(ShadowMap {
                projection: self.map.map_projection.projection(),
                size: self.map.map_size,
            }),
            ShadowArg::Traced => Shadow::Traced,
        }
    }
}

/// The map of --shadow map.
#[derive(Args, Clone, Copy)]
pub struct MapArgs {
    /// How the map of --shadow map looks at the scene.
    #[arg(long, value_name = "HOW", value_enum, default_value = "perspective")]
    pub map_projection: MapProjectionArg,
    /// Texels of a side of the map of --shadow map, 16 to 4096.
    #[arg(long, value_name = "TEXELS", default_value_t = 2048, value_parser = map_size())]
    pub map_size: u32,
}

fn map_size() -> clap::builder::RangedI64ValueParser<u32> {
    clap::value_parser!(u32).range(16..=i64::from(ShadowMap::SIZE_MAX))
}

#[derive(Clone, Copy, ValueEnum)]
pub enum MapProjectionArg {
    /// As the light looks, at everything: what most programs have.
    Plain,
    /// As the light looks, at what is visible; as the others do.
    Uniform,
    /// Light-space perspective (Wimmer et al. 2004).
    LightSpace,
    /// Perspective (Stamminger & Drettakis 2002).
    Perspective,
}

impl MapProjectionArg {
    fn projection(self) -> MapProjection {
        match self {
            MapProjectionArg::Plain => MapProjection::Plain,
            MapProjectionArg::Uniform => MapProjection::Uniform,
            MapProjectionArg::LightSpace => MapProjection::LightSpace,
            MapProjectionArg::Perspective => MapProjection::Perspective,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub enum RepresentationArg {
    /// Levels of detail as the file has them: triangles, points, or both.
    Hybrid,
    /// The same of a file without points; one with points is refused.
    Triangles,
    /// Levels of detail that were simplified by shape alone.
    Geometric,
    /// The same of a file whose levels are points, or of a point cloud; others are refused.
    Points,
    /// The scan's own geometry, however far: slow, and what everything is compared with.
    Full,
}

impl RepresentationArg {
    pub fn representation(self) -> Representation {
        match self {
            RepresentationArg::Hybrid => Representation::Hybrid,
            RepresentationArg::Triangles => Representation::Triangles,
            RepresentationArg::Points => Representation::Points,
            RepresentationArg::Geometric => Representation::Geometric,
            RepresentationArg::Full => Representation::Full,
        }
    }
}

#[derive(Args)]
#[cfg(feature = "viewer")]
pub struct ViewArgs {
    /// The .hlod file, or its address on a web server, as in https://example.org/statue.hlod; without one
    /// the window begins with a page to choose it, or to build a scan.
    pub file: Option<PathBuf>,
    /// Size of the window in pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = size)]
    pub size: (u32, u32),
    /// Largest error on the screen in pixels (τ): smaller is finer and slower [default: as it was set in
    /// the window last, or 1].
    #[arg(long, value_name = "PX", value_parser = positive)]
    pub tau: Option<f64>,
    /// What is drawn of the file.
    #[arg(long, value_enum, default_value = "hybrid")]
    pub representation: RepresentationArg,
    /// AZIMUTH,ELEVATION of the light in degrees, relative to the picture: 0,0 comes from the eye,
    /// positive from the right and from above. It can be turned in the window [default: that of the
    /// session, or -45,45].
    #[arg(long, value_name = "LIGHT", value_parser = numbers::<2, 2>, allow_hyphen_values = true)]
    pub light: Option<Numbers>,
    /// A second .hlod file, seen with the same camera in the same light to the right of a line that can be
    /// dragged; tools work on the first.
    #[arg(long, value_name = "FILE", requires = "file")]
    pub compare: Option<PathBuf>,
    /// Where views, measurements, sections and notes are kept [default: FILE.session.json beside the
    /// file, or in the user's data folder].
    #[arg(long, value_name = "JSON", requires = "file")]
    pub session: Option<PathBuf>,
    /// What a frame may take while moving, in milliseconds: τ is raised up to four times to keep to
    /// it, and restored at rest [default: as it was set in the window last, or 66].
    #[arg(long, value_name = "MS", value_parser = positive)]
    pub frame_time: Option<f64>,
    /// Begin with shadows; H in the window shows and hides them.
    #[arg(long)]
    pub shadow: bool,
    #[command(flatten)]
    pub memory: MemoryArgs,
    /// Leave after so many seconds.
    #[arg(long, value_name = "SECS", value_parser = positive)]
    pub exit_after: Option<f64>,
    /// Lose the GPU after so many seconds, once, as drivers do.
    #[arg(long, value_name = "SECS", value_parser = positive, hide = true)]
    pub lose_gpu_after: Option<f64>,
    /// Write what the window shows to a PNG when leaving.
    #[arg(long, value_name = "PNG")]
    pub screenshot: Option<PathBuf>,
}

#[derive(Args)]
pub struct MemoryArgs {
    /// At most so much geometry is kept on the GPU, as in 512MiB or 2GB, but never less than 9 MB: what moves is drawn
    /// coarser where it needs more; single pictures, full resolution and τ = 0 take what they need.
    #[arg(long, value_name = "BYTES", default_value = "1GiB", value_parser = bytes)]
    pub gpu_memory: u64,
    /// At most so much of the file is kept in memory as it was read.
    #[arg(long, value_name = "BYTES", default_value = "256MiB", value_parser = bytes)]
    pub host_memory: u64,
    /// Reading is limited to so much a second, as in 50MB/s.
    #[arg(long, value_name = "BYTES/s", value_parser = bytes)]
    pub io_limit: Option<u64>,
    /// Read nothing before it is wanted.
    #[arg(long)]
    pub no_prefetch: bool,
}

impl MemoryArgs {
    pub fn limits(&self) -> ModelLimits {
        ModelLimits {
            gpu_bytes: self.gpu_memory,
            host_bytes: self.host_memory,
            read_bytes_per_sec: self.io_limit.map(|b| b as f64),
            prefetch: !self.no_prefetch,
            ..ModelLimits::default()
        }
    }
}

#[derive(Args)]
pub struct ShotArgs {
    /// The .hlod file, or its address on a web server.
    pub file: PathBuf,
    /// The PNG or TIFF file (.tif) to write; an existing one is replaced.
    #[arg(long, short)]
    pub output: PathBuf,
    /// front, back, left, right, top, bottom, three-quarter; or RIGHT,UP,FRONT of the eye and,
    /// after a colon, of the point it looks at, as in 0.1,0.3,1:0,0.25,0.
    #[arg(long, default_value = "three-quarter", allow_hyphen_values = true)]
    pub camera: String,
    #[command(flatten)]
    pub draw: DrawArgs,
    /// What pixels are painted with: shaded, the surface in its light; depth, of the level of detail
    /// that is seen; borders, lines where nodes end with the skirts between them; normals; bound, how far
    /// what is drawn may be from the scan; kinds of primitives; edges of triangles; curvature, hollows blue
    /// and bulges orange; or a number that the file keeps, by its name, with a legend.
    #[arg(long, value_name = "PAINT", default_value = "shaded")]
    pub paint: String,
    /// Average N × N samples a pixel, for smooth edges.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub supersampling: u32,
    #[command(flatten)]
    pub session: SessionArgs,
    #[command(flatten)]
    pub figure: FigureArgs,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Args)]
pub struct BenchArgs {
    /// The .hlod file.
    pub file: PathBuf,
    /// A camera path: one of bench-paths/*.json, or one recorded in the window (R).
    #[arg(long)]
    pub path: PathBuf,
    #[command(flatten)]
    pub draw: DrawArgs,
    /// Frames along the path.
    #[arg(long, default_value_t = 120, value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub frames: u32,
    /// Begin with nothing loaded and nothing in the file cache, at the path's own pace.
    #[arg(long)]
    pub cold: bool,
    #[command(flatten)]
    pub memory: MemoryArgs,
    /// Plot frame times to an SVG file.
    #[arg(long, value_name = "SVG")]
    pub plot: Option<PathBuf>,
    /// Take the time of each stage of a frame, too, by the GPU's clock.
    #[arg(long)]
    pub stages: bool,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Args)]
pub struct AuditArgs {
    /// The .hlod file.
    pub file: PathBuf,
    /// The scans it was built from.
    #[arg(long, num_args = 1.., required = true, value_name = "INPUT")]
    pub against: Vec<PathBuf>,
    /// Views along this camera path instead of round the statue.
    #[arg(long)]
    pub path: Option<PathBuf>,
    /// How many views.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub views: u32,
    /// Look at seams alone, at each of these τ (0.5,1,4 unless given): as asked for, with mixed depths, and with one
    /// node in eight not loaded, for which ancestors stand.
    #[arg(long, value_name = "PX,…", num_args = 0..=1, value_delimiter = ',', default_missing_value = "0.5,1,4",
        value_parser = positive, conflicts_with = "tau")]
    pub seams: Vec<f64>,
    /// Another light in each view, parallel and lamps in turn; --light-size is then in heights of the statue.
    #[arg(long, conflicts_with_all = ["light", "seams"])]
    pub vary_light: bool,
    /// Which nodes mixed fronts are made of.
    #[arg(long, default_value_t = 1, requires = "seams")]
    pub seed: u64,
    #[command(flatten)]
    pub draw: DrawArgs,
    /// Write pictures of the worst view to this folder; with soft shadows also penumbra.png: soft, hard, rays, and where soft
    /// ones are too dark (red) or too bright (blue).
    #[arg(long, value_name = "FOLDER")]
    pub pictures: Option<PathBuf>,
    #[command(flatten)]
    pub json: JsonArgs,
}

pub fn size(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match parsed {
        Some((w, h)) if (1..=65_536).contains(&w) && (1..=65_536).contains(&h) => Ok((w, h)),
        _ => Err("expected a size such as 1920x1080".into()),
    }
}

pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("expected a positive number".into()),
    }
}

pub fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value >= 0.0 && value.is_finite() => Ok(value),
        _ => Err("expected a number that is not negative".into()),
    }
}

/// The light's size as a [`hlod_render::scene::Shot`] has it.
pub fn light_size(is_soft: bool, given: Option<f64>, light: Light, framing: &Framing) -> f64 {
    match light {
        Light::Point(_) => given.unwrap_or(if is_soft { 0.05 } else { 0.0 }) * framing.height,
        Light::Directional(_) => given.unwrap_or(if is_soft { 3.0 } else { 0.0 }),
    }
}

/// A number of bytes with an optional unit and an optional `/s`.
pub fn bytes(text: &str) -> Result<u64, String> {
    let text = text.strip_suffix("/s").unwrap_or(text);
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match &text[digits.len()..] {
        "" | "B" => 1.0,
        "kB" | "KB" => 1e3,
        "MB" => 1e6,
        "GB" => 1e9,
        "KiB" => 1024.0,
        "MiB" => 1024.0 * 1024.0,
        "GiB" => 1024.0 * 1024.0 * 1024.0,
        _ => return Err("expected bytes such as 512MiB or 50MB".into()),
    };
    match digits.parse::<f64>() {
        Ok(value) if value > 0.0 && value * factor < 1e18 => Ok((value * factor) as u64),
        _ => Err("expected bytes such as 512MiB or 50MB".into()),
    }
}

/// Some finite numbers with commas between them.
pub type Numbers = Vec<f64>;

pub fn numbers<const LEAST: usize, const MOST: usize>(text: &str) -> Result<Numbers, String> {
    let parsed: Option<Numbers> =
        text.split(',').map(|n| n.trim().parse::<f64>().ok().filter(|v| v.is_finite())).collect();
    parsed.filter(|n| (LEAST..=MOST).contains(&n.len())).ok_or_else(|| {
        let count = if LEAST == MOST { LEAST.to_string() } else { format!("{LEAST} to {MOST}") };
        format!("expected {count} numbers with commas between them")
    })
}

fn spot_numbers(text: &str) -> Result<Numbers, String> {
    let given = numbers::<1, 4>(text)?;
    match given[..] {
        [angle] | [angle, _, _, _] if (1.0..=180.0).contains(&angle) => Ok(given),
        _ => {
            Err("expected 1 to 180 degrees, as in 30, or with a place, as in 30,0,-0.3,0.2".into())
        }
    }
}

/// The cone that `--spot` names.
///
/// # Errors
/// When the light is no lamp, or is where it is aimed at.
pub fn spot(draw: &DrawArgs, light: Light, framing: &Framing) -> Result<Option<Spot>, String> {
    let Some(given) = &draw.spot else { return Ok(None) };
    let Light::Point(lamp) = light else {
        return Err("--spot needs a lamp: --light RIGHT,UP,FRONT".into());
    };
    let at = match given[..] {
        [_, right, up, front] => framing.point([right, up, front]),
        _ => framing.centre,
    };
    let towards = (at - lamp).try_normalize().ok_or("--spot: the lamp is where it is aimed at")?;
    Ok(Some(Spot { towards, angle_deg: given[0] }))
}

/// The camera that `--camera` names.
pub fn camera(text: &str, framing: &Framing, aspect: f64) -> Result<Camera, String> {
    if let Some((_, direction)) = NAMED_VIEWS.iter().find(|(name, _)| *name == text) {
        return Ok(framing.fitting(*direction, aspect, FOV_Y_DEG));
    }
    let (eye, target) = text.split_once(':').unwrap_or((text, "0,0,0"));
    let point = |text: &str| -> Result<DVec3, String> {
        let n =
            numbers::<3, 3>(text).map_err(|e| format!("--camera {text}: {e}, or a named view"))?;
        Ok(framing.point([n[0], n[1], n[2]]))
    };
    let (eye, target) = (point(eye)?, point(target)?);
    if eye == target {
        return Err("--camera: the eye is where it looks".into());
    }
    Ok(framing.camera(eye, target, FOV_Y_DEG))
}

/// The light that `--light` names, for a picture taken by `camera`.
pub fn light(numbers: &[f64], camera: &Camera, framing: &Framing) -> Light {
    match *numbers {
        [azimuth, elevation] => hlod_render::scene::light_from_angles(camera, azimuth, elevation),
        [right, up, front] => Light::Point(framing.point([right, up, front])),
        _ => unreachable!("the parser lets through two or three numbers"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn sizes_bytes_and_numbers_are_checked() {
        assert_eq!(size("640x480"), Ok((640, 480)));
        assert!(["640", "0x1", "640x", "axb", "-1x5"].iter().all(|s| size(s).is_err()));
        assert_eq!(bytes("50MB/s"), Ok(50_000_000));
        assert_eq!(bytes("1.5KiB"), Ok(1536));
        assert!(["", "MB", "5XB", "-3MB"].iter().all(|s| bytes(s).is_err()));
        assert_eq!(numbers::<2, 3>("1, -2"), Ok(vec![1.0, -2.0]));
        assert!(["1", "1,2,3,4", "1,NaN", "a,b"].iter().all(|s| numbers::<2, 3>(s).is_err()));
    }
}
