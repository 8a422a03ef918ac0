//! Commands that make figures: shot, plate, turntable, light-dome.

use std::io::Write;
use std::path::Path;

use hlod_compress::{Header, Unit};
use hlod_render::camera::{Camera, Projection};
use hlod_render::figure::plate::{Plate, Side};
use hlod_render::figure::scale::{Scale, millimetres, unit_of};
use hlod_render::figure::{
    Drawn, Font, Provenance, ScaleBar, Series, Sheet, bar_for_plane, check_folder, check_output,
    command_line, extent, fitting, legend, light_dome, orthographic, save, turntable,
};
use hlod_render::framing::Framing;
use hlod_render::leaves::Leaves;
use hlod_render::scene::{Paint, Painted, Shadow, Shot};
use hlod_render::section::{Plane, cut};
use hlod_render::{Gpu, Model, ModelFile, ModelLimits};

use super::args::{self, Cli, DrawArgs, JsonArgs, ShotArgs};
use super::figure_args::{FigureArgs, LightDomeArgs, PlateArgs, TurntableArgs};
use super::work::{load_session, saved_view, session_framing};
use super::{Failure, Outcome, check_representation, print, progress_bar, shot, tables};

/// Of lines of text in a picture whose resolution on paper nobody said: a share of its height.
const TEXT_SHARE: f64 = 1.0 / 36.0;
/// Of lines of text on paper, mm: 10 points.
const TEXT_MM: f64 = 3.5;

/// A model that is open, and what is needed to draw it.
struct Opened {
    gpu: Gpu,
    models: [Model; 1],
    framing: Framing,
    provenance: Provenance,
}

fn open_model(cli: &Cli, file: &Path, draw: &DrawArgs) -> Result<Opened, Failure> {
    let (gpu, file_open) = ModelFile::open_beside(file, ModelLimits::default(), || cli.gpu(draw))?;
    check_representation(draw, file_open.header())?;
    let model = Model::of_file(&gpu, file_open)?;
    let framing = Framing::of(&model);
    let arguments: Vec<_> = std::env::args_os().collect();
    let command = command_line(arguments.iter().map(|a| a.as_os_str()));
    let mut provenance = Provenance::new(file, model.header(), &command);
    if let Some(metadata) = model.metadata()? {
        provenance.add_about(&metadata);
    }
    Ok(Opened { gpu, models: [model], framing, provenance })
}

impl Opened {
    /// Stands as a session says, if one is given.
    fn stand(&mut self, session: Option<&Path>, file: &Path) -> Outcome {
        let Some(path) = session else { return Ok(()) };
        let header = self.models[0].header();
        let (session, _) = load_session(path, file, header)?;
        self.framing = session_framing(&session, file, header)?;
        if let Some(frame) = &session.frame {
            self.provenance.add("stands", &frame.made);
        }
        Ok(())
    }

    /// What went wrong in the background.
    fn problems(&mut self) -> Vec<String> {
        let problems = self.models[0].take_problems();
        for problem in &problems {
            let _ = writeln!(
                std::io::stderr(),
                "hlod-render: {problem}; its ancestor is drawn in its place"
            );
        }
        problems
    }
}

pub fn run_shot(cli: &Cli, args: &ShotArgs) -> Outcome {
    check_output(&args.output)?;
    let mut opened = open_model(cli, &args.file, &args.draw)?;
    let figure = &args.figure;
    let dpi = figure.dpi.or(figure.scale.map(|_| 300.0));
    let unit = unit_of(opened.models[0].header().unit, figure.unit)?;
    let scale = figure.scale.zip(dpi).map(|(reduction, dpi)| Scale { reduction, dpi });
    let view = saved_view(&args.session, &args.file, opened.models[0].header())?;
    if let Some((_, _, framing)) = &view {
        opened.framing = *framing;
    }
    let viewpoint = view.as_ref().map(|(view, ..)| view.viewpoint.camera(&opened.framing));
    let (camera, (width, height)) = shot_camera(args, viewpoint, &opened.framing, scale, unit)?;
    let mut shot = shot(&args.draw, camera, &opened.framing)?;
    let header = opened.models[0].header();
    shot.paint = Paint::of_name(&args.paint, header).map_err(Failure::Usage)?;
    if let Some((view, clip, _)) = &view {
        let lit = view.looks.apply(shot, &opened.framing);
        shot = lit.cut_open(*clip);
        if lit.shadow != shot.shadow {
            let _ = writeln!(
                std::io::stderr(),
                "hlod-render: shadows are not drawn of a statue that is cut open"
            );
        }
    }
    let mut sheet = Sheet::of(&shot, width, height);
    sheet.transparent = figure.transparent;
    sheet.supersampling = args.supersampling;
    sheet.check()?;
    let text_px = text_px(&sheet, scale);
    if scale.is_some() && args.draw.size.is_none() {
        // What is written has its own room below.
        let lines = u32::from(figure.scale_bar) * 2 + u32::from(figure.caption.is_some());
        sheet.height += (f64::from(lines) * 1.3 * text_px) as u32;
    }
    annotate(&mut sheet, figure, text_px, &opened.framing, unit)?;
    let painted = painted(&shot, opened.models[0].header());
    if let Some(painted) = &painted {
        add_legend(&mut sheet, painted, text_px)?;
    }
    sheet.check()?;
    let provenance = &mut opened.provenance;
    if let Some(painted) = &painted {
        let [low, high] = painted.ends();
        let map = painted.map.name();
        provenance.add("colours", &format!("{} from {low} to {high}, {map}", painted.title()));
    }
    if let Some(scale) = scale {
        provenance.add("scale", &format!("{} at {} dpi", scale.name(), scale.dpi));
    }
    provenance.add_shot(&shot, &opened.framing, unit);
    let drawn = save_sheet(cli, &mut opened, &sheet, &args.output, dpi)?;
    let problems = opened.problems();
    let gpu = &opened.gpu;
    let map = match shot.shadow {
        Shadow::Mapped(map) => Some(serde_json::json!({
            "projection": map.projection.name(), "texels": map.size, "maps": drawn.maps.maps,
            "fallbacks": drawn.maps.fallbacks, "denied_share": drawn.maps.denied_share(),
        })),
        _ => None,
    };
    let result = serde_json::json!({
        "output": args.output, "adapter": gpu.describe(), "width": sheet.width, "height": sheet.height,
        "tau_px": shot.error_threshold_px, "triangles": drawn.triangles, "points": drawn.points,
        "nodes": drawn.nodes, "shadow": shot.shadow.name(), "caster_triangles": drawn.caster_triangles,
        "caster_nodes": drawn.caster_nodes, "shadow_map": map, "problems": problems, "parts": drawn.parts,
        "unit": unit.name(), "scale": scale.map(|s| s.name()), "dpi": dpi,
        "pixel_mm": pixel_mm(&shot.camera, height, unit),
    });
    print(&args.json, &result, || tables::shot(&args.output, &drawn, gpu))
}

/// Length of a pixel on the statue in mm; of parallel views in a known unit.
fn pixel_mm(camera: &Camera, height: u32, unit: Unit) -> Option<f64> {
    match camera.projection {
        Projection::Orthographic { height: length } => {
            Some(length / f64::from(height) * millimetres(unit)?)
        }
        Projection::Perspective { .. } => None,
    }
}

/// The camera and the picture's size.
fn shot_camera(
    args: &ShotArgs,
    viewpoint: Option<Camera>,
    framing: &Framing,
    scale: Option<Scale>,
    unit: Unit,
) -> Result<(Camera, (u32, u32)), Failure> {
    let size = args.draw.size();
    let aspect = f64::from(size.0) / f64::from(size.1);
    let camera = match viewpoint {
        Some(camera) => camera,
        None => args::camera(&args.camera, framing, aspect).map_err(Failure::Usage)?,
    };
    if !args.figure.ortho {
        return Ok((camera, size));
    }
    let Some(scale) = scale else { return Ok((fitting(framing, &camera, aspect), size)) };
    let pixel = scale.pixel_in(unit)?;
    let (width, height) = match args.draw.size {
        Some(size) => size,
        None => {
            let px = extent(framing, &camera) / pixel;
            // 4 % and some pixels stay free, and what is written below needs its own room.
            let room = |px: f64| (px * 1.04 + 16.0).ceil().min(f64::from(u32::MAX)) as u32;
            (room(px.x), room(px.y))
        }
    };
    let height_units = f64::from(height) * pixel;
    let mut parallel = orthographic(framing, camera.axes()[2], camera.up, height_units);
    if args.draw.size.is_some() {
        // Where it looks is the middle of the picture.
        let moved = camera.target - parallel.target;
        parallel.eye += moved;
        parallel.target += moved;
    }
    Ok((parallel, (width, height)))
}

/// Height of lines of text.
fn text_px(sheet: &Sheet, scale: Option<Scale>) -> f64 {
    let of_paper = scale.map(|scale| TEXT_MM / scale.pixel_on_paper_mm());
    let text_px = of_paper.unwrap_or((f64::from(sheet.height) * TEXT_SHARE).max(12.0));
    text_px.round().clamp(8.0, 2000.0)
}

/// The number that is painted, if one is.
fn painted(shot: &Shot, header: &Header) -> Option<Painted> {
    match shot.paint {
        Paint::Bound => Some(Painted::bound(header)),
        Paint::Curvature => Some(Painted::curvature(shot.enhance.radius_px)),
        Paint::Scalar(k) => Painted::all(header).into_iter().nth(k.into()),
        _ => None,
    }
}

/// What colours stand for, at the lower right.
fn add_legend(sheet: &mut Sheet, painted: &Painted, text_px: f64) -> Outcome {
    let margin = (text_px * 0.8) as i64;
    let corner = (i64::from(sheet.width) - margin, i64::from(sheet.height) - margin);
    let width = (sheet.width / 3).max(1);
    let marks = legend(painted, &Font::new()?, corner, (width, text_px), ink_and_paper(sheet));
    sheet.marks.extend(marks);
    Ok(())
}

/// Black on what is light, white on what is dark; nobody knows what is behind what is transparent.
fn ink_on(sheet: &Sheet) -> [u8; 3] {
    ink_and_paper(sheet)[0]
}

/// What is written with, and what behind it can be read.
fn ink_and_paper(sheet: &Sheet) -> [[u8; 3]; 2] {
    let (black, white) = ([0; 3], [255; 3]);
    if sheet.transparent {
        return [black, white];
    }
    let is_dark = sheet.paper.iter().map(|c| u32::from(*c)).sum::<u32>() < 384;
    [if is_dark { white } else { black }, sheet.paper]
}

/// Bar and caption at the lower left.
fn annotate(
    sheet: &mut Sheet,
    figure: &FigureArgs,
    text_px: f64,
    framing: &Framing,
    unit: Unit,
) -> Outcome {
    let ink = ink_on(sheet);
    let margin = (text_px * 0.8) as u32;
    let mut y = sheet.height.saturating_sub(margin);
    let font = Font::new()?;
    if let Some(caption) = &figure.caption {
        let room = sheet.width.saturating_sub(2 * margin);
        let text = font.fitted(caption, text_px, room);
        y = y.saturating_sub((text_px * 1.2) as u32);
        sheet.marks.push(font.line(&text, (margin.into(), y.into()), text_px, ink));
    }
    if figure.scale_bar {
        let view = &sheet.views[0];
        let (pixel, place) = bar_for_plane(&view.shot.camera, framing, view.height);
        let bar = ScaleBar::new(pixel, unit, sheet.width / 3, place).ok_or_else(|| {
            Failure::Usage("--scale-bar: the centre of the statue's bounds is not in view".into())
        })?;
        sheet.marks.extend(bar.marks(&font, (margin.into(), y.into()), text_px, ink));
    }
    Ok(())
}

/// Draws a page into a file and shows how far it is.
fn save_sheet(
    cli: &Cli,
    opened: &mut Opened,
    sheet: &Sheet,
    output: &Path,
    dpi: Option<f64>,
) -> Result<Drawn, Failure> {
    let bar = progress_bar(cli.quiet, u64::from(sheet.height), "rows");
    let mut progress = |done: u32, _: u32| bar.set_position(done.into());
    let about = (&opened.provenance, dpi);
    let drawn = save(sheet, &opened.gpu, &mut opened.models, output, about, &mut progress);
    bar.finish_and_clear();
    Ok(drawn?)
}

pub fn run_plate(cli: &Cli, args: &PlateArgs) -> Outcome {
    check_output(&args.output)?;
    let sides =
        Side::parse_list(&args.views).map_err(|e| Failure::Usage(format!("--views: {e}")))?;
    let draw = DrawArgs {
        size: None,
        precision: args::PrecisionArgs {
            tau: args.precision.tau,
            representation: args.precision.representation,
        },
        fixed_function: false,
        shadow: args.shadow,
        light_size: None,
        caster_tau: hlod_render::scene::CASTER_THRESHOLD_PX,
        shadow_step: hlod_render::scene::INTENSITY_STEP,
        shadow_exact: false,
        map: args.map,
        light: vec![-45.0, 30.0],
        spot: None,
        enhance: args.enhance,
    };
    let mut opened = open_model(cli, &args.file, &draw)?;
    opened.stand(args.session.as_deref(), &args.file)?;
    let unit = unit_of(opened.models[0].header().unit, args.unit)?;
    let scale = Scale { reduction: args.scale, dpi: args.dpi };
    let title = args.title.clone().unwrap_or_else(|| opened.provenance.title.clone());
    let supersampling = args.supersampling;
    let transparent = args.transparent;
    let plate = Plate { sides, scale, unit, title, transparent, supersampling };
    let front = opened.framing.fitting([0.0, 0.0, 1.0], 1.0, 35.0);
    let shot = shot(&draw, front, &opened.framing)?;
    let (mut sheet, laid) = plate.lay_out(&opened.framing, &shot)?;
    let mut section_at = None;
    if let Some(plane) = &args.section {
        let section = cut(&Leaves::open(&args.file)?, plane, None)?;
        let name = format!("section {}", plane_name(plane));
        let drawn = (&section, name.as_str());
        section_at = plate.add_section(&mut sheet, &laid, drawn, &opened.framing)?;
        if section_at.is_none() {
            let why = format!("--section: the plane meets nothing of {}", args.file.display());
            return Err(Failure::Work(why));
        }
        opened.provenance.add("section", &plane_name(plane));
    }
    let provenance = &mut opened.provenance;
    let views: Vec<&str> = laid.iter().map(|l| l.side.name()).collect();
    provenance.add("scale", &format!("{} at {} dpi", scale.name(), scale.dpi));
    provenance.add("unit", unit.name());
    provenance.add("views", &format!("{}, in parallel projection", views.join(", ")));
    provenance.add("light", "parallel, from the upper left of each view, 45° to the line of sight");
    provenance.add("shadows", shot.shadow.name());
    provenance.add("representation", shot.representation.name());
    provenance.add("tau", &format!("{} px", shot.error_threshold_px));
    let drawn = save_sheet(cli, &mut opened, &sheet, &args.output, Some(args.dpi))?;
    let problems = opened.problems();
    let placed = |l: &hlod_render::figure::plate::Laid| {
        let v = &l.view;
        serde_json::json!({
            "view": l.side.name(), "x": v.x, "y": v.y, "width": v.width, "height": v.height,
        })
    };
    let views: Vec<_> = laid.iter().map(placed).collect();
    let result = serde_json::json!({
        "output": args.output, "adapter": opened.gpu.describe(), "width": sheet.width,
        "height": sheet.height, "scale": scale.name(), "dpi": args.dpi, "unit": unit.name(),
        "pixel_mm": scale.pixel_mm(), "tau_px": shot.error_threshold_px, "section_at": section_at, "views": views,
        "triangles": drawn.triangles, "points": drawn.points, "nodes": drawn.nodes,
        "parts": drawn.parts, "problems": problems,
    });
    print(&args.json, &result, || tables::plate(&args.output, &sheet, &scale, &opened.gpu))
}

pub fn run_turntable(cli: &Cli, args: &TurntableArgs) -> Outcome {
    check_folder(&args.output)?;
    let mut opened = open_model(cli, &args.file, &args.draw)?;
    opened.stand(args.session.as_deref(), &args.file)?;
    let (width, height) = args.draw.size();
    let aspect = f64::from(width) / f64::from(height);
    let cameras = match args.ortho {
        true => turntable::parallel_cameras,
        false => turntable::cameras,
    };
    let cameras = cameras(&opened.framing, args.frames, args.elevation, aspect);
    let mut shots = Vec::new();
    for camera in cameras {
        shots.push(shot(&args.draw, camera, &opened.framing)?);
    }
    let unit = opened.models[0].header().unit;
    let style = Style { width, height, supersampling: args.supersampling, unit };
    let digits = args.frames.to_string().len().max(3);
    let name = |i: usize| format!("frame-{i:0digits$}.png");
    let change = |sheet: &mut Sheet| sheet.transparent = args.transparent;
    let series = Series::begin(&args.output)?;
    draw_series(cli, &mut opened, &series, &shots, &style, (&name, &change))?;
    series.finish()?;
    finish_series(&mut opened, &args.json, &args.output, &shots, &style)
}

pub fn run_light_dome(cli: &Cli, args: &LightDomeArgs) -> Outcome {
    if args.draw.enhance.enhance > 0.0 || args.draw.spot.is_some() {
        let why = "light-dome: pictures are of Lambert's law and parallel light alone, which --enhance and --spot would \
                   change";
        return Err(Failure::Usage(why.into()));
    }
    check_folder(&args.output)?;
    let mut opened = open_model(cli, &args.file, &args.draw)?;
    let (width, height) = args.draw.size();
    let aspect = f64::from(width) / f64::from(height);
    let mut camera = args::camera(&args.camera, &opened.framing, aspect).map_err(Failure::Usage)?;
    if args.ortho {
        camera = fitting(&opened.framing, &camera, aspect);
    }
    let plain = shot(&args.draw, camera, &opened.framing)?;
    let directions = light_dome::directions(args.lights);
    let under = |d: &glam::DVec3| Shot {
        light: light_dome::light(&camera, *d),
        material: light_dome::material(&plain.material),
        background: glam::Vec3::ZERO,
        ..plain
    };
    let shots: Vec<Shot> = directions.iter().map(under).collect();
    let unit = opened.models[0].header().unit;
    let style = Style { width, height, supersampling: args.supersampling, unit };
    let name = |i: usize| light_dome::picture_name(i as u32);
    let series = Series::begin(&args.output)?;
    draw_series(cli, &mut opened, &series, &shots, &style, (&name, &|_| {}))?;
    series.write("light-dome.lp", &light_dome::list(&directions))?;
    series.finish()?;
    finish_series(&mut opened, &args.json, &args.output, &shots, &style)
}

/// What all pictures of a series have in common.
struct Style {
    width: u32,
    height: u32,
    supersampling: u32,
    unit: Unit,
}

/// Names of pictures by their numbers, and what is to be changed on every page.
type Naming<'a> = (&'a dyn Fn(usize) -> String, &'a dyn Fn(&mut Sheet));

fn draw_series(
    cli: &Cli,
    opened: &mut Opened,
    series: &Series,
    shots: &[Shot],
    style: &Style,
    (name, change): Naming<'_>,
) -> Outcome {
    let bar = progress_bar(cli.quiet, shots.len() as u64, "pictures");
    for (i, shot) in shots.iter().enumerate() {
        let mut sheet = Sheet::of(shot, style.width, style.height);
        sheet.supersampling = style.supersampling;
        change(&mut sheet);
        let mut provenance = opened.provenance.clone();
        provenance.add("picture", &format!("{} of {}", i + 1, shots.len()));
        provenance.add_shot(shot, &opened.framing, style.unit);
        series.save(&name(i), &sheet, &opened.gpu, &mut opened.models, &provenance)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}

fn finish_series(
    opened: &mut Opened,
    json: &JsonArgs,
    output: &Path,
    shots: &[Shot],
    style: &Style,
) -> Outcome {
    let problems = opened.problems();
    let result = serde_json::json!({
        "output": output, "adapter": opened.gpu.describe(), "pictures": shots.len(),
        "width": style.width, "height": style.height, "problems": problems,
    });
    let count = shots.len();
    print(json, &result, || tables::series(output, count, &opened.gpu))
}

/// As the command line has it.
fn plane_name(plane: &Plane) -> String {
    let axes = [("x", plane.normal.x), ("y", plane.normal.y), ("z", plane.normal.z)];
    match axes.iter().find(|(_, along)| *along == 1.0) {
        Some((name, _)) => format!("{name} = {}", plane.offset),
        None => {
            let n = plane.normal;
            format!("{:.4}, {:.4}, {:.4}, {:.4}", n.x, n.y, n.z, plane.offset)
        }
    }
}
