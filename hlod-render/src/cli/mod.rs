//! The program: raw flags → validated options → library calls → pictures, tables or JSON.

pub mod args;
mod figure;
mod figure_args;
mod outcome;
pub mod section;
pub mod simulate;
mod tables;
mod work;

use std::io::Write;
use std::path::Path;

use hlod_compress::Header;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

use hlod_render::audit::seams::{SeamOptions, audit_seams};
use hlod_render::audit::{AuditOptions, audit};
use hlod_render::bench::{BenchOptions, bench};
use hlod_render::camera::Camera;
use hlod_render::framing::{FOV_Y_DEG, Framing};
use hlod_render::path::CameraPath;
use hlod_render::scene::{BACKGROUND, EXACT_THRESHOLDS_PX, Material, Paint, Shot};
use hlod_render::{Gpu, Model, ModelLimits};

use args::{AuditArgs, BenchArgs, Cli, Command, DrawArgs, JsonArgs};
pub use outcome::Failure;
use outcome::Outcome;

pub fn run(cli: &Cli) -> Outcome {
    match &cli.command {
        #[cfg(feature = "viewer")]
        Command::View(args) => run_view(cli, args),
        #[cfg(not(feature = "viewer"))]
        Command::View { .. } => Err(hlod_render::RenderError::Usage(
            "this program was built without its window: build it with --features viewer".into(),
        )
        .into()),
        Command::Shot(args) => figure::run_shot(cli, args),
        Command::Plate(args) => figure::run_plate(cli, args),
        Command::Turntable(args) => figure::run_turntable(cli, args),
        Command::LightDome(args) => figure::run_light_dome(cli, args),
        Command::Bench(args) => run_bench(cli, args),
        Command::Measure(args) => work::run_measure(args),
        Command::Notes(args) => work::run_notes(args),
        Command::Simulate(args) => simulate::run(cli, args),
        Command::Audit(args) => run_audit(cli, args),
        Command::Section(args) => section::run(cli, args),
    }
}

#[cfg(feature = "viewer")]
fn run_view(cli: &Cli, args: &args::ViewArgs) -> Outcome {
    use hlod_render::scene::Shadow;
    use hlod_render::viewer::{ViewOptions, run};
    let light = args.light.as_ref().map(|light| (light[0], light[1]));
    run(ViewOptions {
        file: args.file.clone(),
        limits: args.memory.limits(),
        error_threshold_px: args.tau,
        frame_target_ms: args.frame_time,
        representation: args.representation.representation(),
        light,
        session: args.session.clone(),
        compare: args.compare.clone(),
        shadow: if args.shadow { Shadow::Hard } else { Shadow::None },
        size: args.size,
        adapter: cli.adapter(),
        exit_after: args.exit_after.map(std::time::Duration::from_secs_f64),
        lose_gpu_after: args.lose_gpu_after.map(std::time::Duration::from_secs_f64),
        screenshot: args.screenshot.clone(),
    })?;
    Ok(())
}

fn run_bench(cli: &Cli, args: &BenchArgs) -> Outcome {
    let gpu = if args.stages { cli.timed_gpu(&args.draw)? } else { cli.gpu(&args.draw)? };
    let path = CameraPath::load(&args.path)?;
    let options = BenchOptions {
        size: args.draw.size(),
        frames: args.frames,
        cold: args.cold,
        limits: args.memory.limits(),
    };
    let framing = Framing::of(&open(&gpu, &args.file, &args.draw)?);
    let camera = framing.fitting([0.0, 0.0, 1.0], 1.0, FOV_Y_DEG);
    let bar = progress_bar(cli.quiet, u64::from(args.frames), "frames");
    let shot = shot(&args.draw, camera, &framing)?;
    let report = bench(&gpu, &args.file, &path, &shot, &options, &mut |_| bar.inc(1))?;
    bar.finish_and_clear();
    if let Some(plot) = &args.plot {
        report.plot(plot)?;
    }
    print(&args.json, &report, || tables::bench(&report))
}

fn run_audit(cli: &Cli, args: &AuditArgs) -> Outcome {
    let gpu = cli.gpu(&args.draw)?;
    let framing = Framing::of(&open(&gpu, &args.file, &args.draw)?);
    let camera = framing.fitting([0.0, 0.0, 1.0], 1.0, FOV_Y_DEG);
    let [azimuth, elevation] = args.draw.light[..] else {
        return Err(Failure::Usage("audit: --light takes AZIMUTH,ELEVATION".into()));
    };
    let path = args.path.as_deref().map(CameraPath::load).transpose()?;
    if !args.seams.is_empty() {
        let options = SeamOptions {
            size: args.draw.size(),
            views: args.views,
            path,
            thresholds_px: args.seams.clone(),
            seed: args.seed,
            pictures: args.pictures.clone(),
        };
        let bar = progress_bar(cli.quiet, u64::from(args.views), "views");
        let shot = shot(&args.draw, camera, &framing)?;
        let mut advance = |_| bar.inc(1);
        let report = audit_seams(&gpu, &args.file, &args.against, &shot, &options, &mut advance)?;
        bar.finish_and_clear();
        return print(&args.json, &report, || tables::seams(&report));
    }
    let options = AuditOptions {
        size: args.draw.size(),
        views: args.views,
        path,
        light: (azimuth, elevation),
        varied_lights: args.vary_light.then(|| args.draw.light_size.unwrap_or(0.05)),
        pictures: args.pictures.clone(),
    };
    let bar = progress_bar(cli.quiet, u64::from(args.views), "views");
    let shot = shot(&args.draw, camera, &framing)?;
    let report = audit(&gpu, &args.file, &args.against, &shot, &options, &mut |_| bar.inc(1))?;
    bar.finish_and_clear();
    print(&args.json, &report, || tables::audit(&report))
}

/// A model of which what is asked for can be drawn.
fn open(gpu: &Gpu, file: &Path, draw: &DrawArgs) -> Result<Model, Failure> {
    let model = Model::open(gpu, file, ModelLimits::default())?;
    check_representation(draw, model.header())?;
    Ok(model)
}

fn check_representation(draw: &DrawArgs, header: &Header) -> Outcome {
    draw.precision.representation.representation().check(header).map_err(Failure::Usage)
}

fn shot(draw: &DrawArgs, camera: Camera, framing: &Framing) -> Result<Shot, Failure> {
    let (tau, caster_tau) = match draw.shadow_exact {
        true => EXACT_THRESHOLDS_PX,
        false => (draw.precision.tau, draw.caster_tau),
    };
    let light = args::light(&draw.light, &camera, framing);
    Ok(Shot {
        camera,
        light,
        spot: args::spot(draw, light, framing).map_err(Failure::Usage)?,
        material: Material::default(),
        enhance: draw.enhance.enhance(),
        background: BACKGROUND,
        representation: draw.precision.representation.representation(),
        paint: Paint::Shaded,
        error_threshold_px: tau,
        shadow: draw.shadow(),
        light_size: args::light_size(
            matches!(draw.shadow, args::ShadowArg::Soft),
            draw.light_size,
            light,
            framing,
        ),
        caster_threshold_px: caster_tau,
        intensity_step: draw.shadow_step,
        sample_offset_px: glam::DVec2::ZERO,
        draw_backs: false,
        backs_magenta: false,
        draw_skirts: true,
        mixing: hlod_render::scene::Mixing::None,
        clip: hlod_render::clip::ClipPlanes::default(),
    })
}

/// A bar on stderr; hidden where that is no terminal, or when quiet.
fn progress_bar(quiet: bool, total: u64, what: &str) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let template = format!("{{bar:32.cyan/dim}} {{pos}}/{{len}} {what}  {{eta}} left");
    let style =
        ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::with_draw_target(Some(total), target).with_style(style)
}

/// JSON where it was asked for, else a table.
fn print(json: &JsonArgs, result: &impl Serialize, table: impl Fn() -> String) -> Outcome {
    match &json.json {
        Some(Some(path)) => {
            write_file(path, &(to_json(result)? + "\n"))?;
            print_line(&table())
        }
        Some(None) => print_line(&to_json(result)?),
        None => print_line(&table()),
    }
}

fn to_json(result: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string_pretty(result)
        .map_err(|e| Failure::Work(format!("cannot write JSON: {e}")))
}

fn write_file(path: &Path, text: &str) -> Outcome {
    if !path.exists() || path.is_file() {
        return Ok(hlod_render::files::write_whole(path, text.as_bytes())?);
    }
    // A terminal, a pipe.
    std::fs::write(path, text)
        .map_err(|e| Failure::Work(format!("{}: cannot write: {e}", path.display())))
}

fn print_line(text: &str) -> Outcome {
    match writeln!(std::io::stdout().lock(), "{text}") {
        // Whoever reads has seen enough.
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        other => other.map_err(|e| Failure::Work(format!("cannot write to standard output: {e}"))),
    }
}
