//! `hlod-render simulate`: what policies of loading would have shown.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use hlod_compress::RepresentationKind;
use hlod_render::casters::Casting;
use hlod_render::framing::{FOV_Y_DEG, Framing};
use hlod_render::path::CameraPath;
use hlod_render::scene::{CASTER_THRESHOLD_PX, INTENSITY_STEP, light_radius};
use hlod_render::select::Selection;
use hlod_render::simulate::{Policy, SimulatedShadows, SimulationOptions, simulate};
use hlod_render::source::open_local;

use super::args::{
    Cli, JsonArgs, Numbers, bytes, light, light_size, not_negative, numbers, positive, size,
};
use super::outcome::{Failure, Outcome};
use super::{print, progress_bar, tables};

#[derive(Args)]
pub struct SimulateArgs {
    /// The .hlod file.
    pub file: PathBuf,
    /// A camera path: one of bench-paths/*.json, or one recorded in the window (R).
    #[arg(long)]
    pub path: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size)]
    pub size: (u32, u32),
    /// Largest error on the screen in pixels (τ).
    #[arg(long, value_name = "PX", default_value_t = 0.5, value_parser = positive)]
    pub tau: f64,
    /// What the link brings in a second.
    #[arg(long, value_name = "BYTES/s", default_value = "50MB/s", value_parser = bytes)]
    pub bandwidth: u64,
    /// Milliseconds from asking to the first byte.
    #[arg(long, value_name = "MS", default_value_t = 1.0, value_parser = not_negative)]
    pub latency: f64,
    /// At most so much geometry is kept.
    #[arg(long, value_name = "BYTES", default_value = "128MB", value_parser = bytes)]
    pub cache: u64,
    /// Frames a second.
    #[arg(long, value_name = "FPS", default_value_t = 30.0, value_parser = positive)]
    pub frame_rate: f64,
    /// Shadows: none, hard, or soft, for which what casts them is loaded as well.
    #[arg(long, value_enum, default_value = "none")]
    pub shadow: SimulatedShadowArg,
    /// AZIMUTH,ELEVATION of parallel light in degrees, relative to the statue's front: 0,0 comes from
    /// there, positive from the right and from above; or RIGHT,UP,FRONT of a lamp.
    #[arg(long, value_name = "LIGHT", default_value = "-45,40", value_parser = numbers::<2, 3>, allow_hyphen_values = true)]
    pub light: Numbers,
    /// The light turns round the statue, so many degrees a second.
    #[arg(long, value_name = "DEG/s", default_value_t = 0.0, value_parser = turn, allow_hyphen_values = true)]
    pub light_turn: f64,
    /// Diameter of the light, where shadows are soft: of a lamp in statue heights, of parallel light the
    /// angle in degrees under which it is seen [default: 0.05 or 3].
    #[arg(long, value_name = "SIZE", value_parser = not_negative)]
    pub light_size: Option<f64>,
    /// Largest shift of a shadow's edge by what casts it, in pixels (τ_c).
    #[arg(long, value_name = "PX", default_value_t = CASTER_THRESHOLD_PX, value_parser = positive)]
    pub caster_tau: f64,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SimulatedShadowArg {
    None,
    Hard,
    Soft,
}

fn turn(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.abs() <= 3600.0 => Ok(value),
        _ => Err("expected -3600 to 3600 degrees a second".into()),
    }
}

pub fn run(cli: &Cli, args: &SimulateArgs) -> Outcome {
    let path = CameraPath::load(&args.path)?;
    let frames = path.duration_secs * args.frame_rate;
    if frames > 1e6 {
        return Err(Failure::Usage(format!("simulate: {frames:.0} frames are too many")));
    }
    let options = SimulationOptions {
        bytes_per_sec: args.bandwidth as f64,
        latency_secs: args.latency / 1e3,
        cache_bytes: args.cache,
        frames_per_sec: args.frame_rate,
        size: args.size,
        selection: Selection { kind: RepresentationKind::Appearance, error_threshold_px: args.tau },
        shadows: shadows(args)?,
    };
    let policies = Policy::all(options.shadows.is_some()).len();
    let bar = progress_bar(cli.quiet, policies as u64, "policies");
    let report = simulate(&args.file, &path, &options, &mut || bar.inc(1))?;
    bar.finish_and_clear();
    print(&args.json, &report, || tables::simulation(&report))
}

fn shadows(args: &SimulateArgs) -> Result<Option<SimulatedShadows>, Failure> {
    if args.shadow == SimulatedShadowArg::None {
        return Ok(None);
    }
    let framing = Framing::of_header(open_local(&args.file)?.header());
    let front = framing.fitting([0.0, 0.0, 1.0], 1.0, FOV_Y_DEG);
    let light = light(&args.light, &front, &framing);
    let light_radius = match args.shadow {
        SimulatedShadowArg::Soft => {
            light_radius(light, light_size(true, args.light_size, light, &framing))
        }
        SimulatedShadowArg::Hard | SimulatedShadowArg::None => 0.0,
    };
    let casting = Casting {
        light,
        light_radius,
        threshold_px: args.caster_tau,
        intensity_step: INTENSITY_STEP,
    };
    Ok(Some(SimulatedShadows { casting, turn_deg_per_sec: args.light_turn }))
}
