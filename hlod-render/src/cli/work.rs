//! Work on a statue that a session holds: measuring, notes, views.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use comfy_table::{CellAlignment, Table, presets};
use glam::{DVec2, DVec3};
use hlod_compress::Header;
use hlod_render::clip::ClipPlanes;
use hlod_render::extents::extents;
use hlod_render::framing::Framing;
use hlod_render::leaves::Leaves;
use hlod_render::lens::Lens;
use hlod_render::measure::{
    Measured, Measurement, MeasurementKind, SurfacePoint, measure, nearest_point,
};
use hlod_render::pick::first_hit;
use hlod_render::session::annotations::annotation_page;
use hlod_render::session::{
    self, Corrected, ModelIdentity, ObjectFrame, SavedView, ScaleCorrection, ScannerUncertainty,
    Session,
};
use serde::Serialize;

use super::args::{self, JsonArgs, Numbers};
use super::{Failure, Outcome, print, write_file};

/// A session and one of its views.
#[derive(Args)]
pub struct SessionArgs {
    /// What was saved of the work on this statue in the window: NAME.hlod.session.json.
    #[arg(long, value_name = "JSON", requires = "view")]
    pub session: Option<PathBuf>,
    /// One of its views: camera, light and looks, in place of --camera, --light and so on.
    #[arg(long, value_name = "NAME", requires = "session", conflicts_with_all = ["camera", "light", "light_size", "shadow", "spot", "paint", "enhance", "enhance_radius"])]
    pub view: Option<String>,
}

#[derive(Args)]
pub struct MeasureArgs {
    /// The .hlod file, or its address on a web server.
    pub file: PathBuf,
    /// Measure everything in this session anew.
    #[arg(long, value_name = "JSON", conflicts_with = "kind", required_unless_present = "kind")]
    pub session: Option<PathBuf>,
    /// What to measure between the points.
    #[arg(long, value_enum)]
    pub kind: Option<KindArg>,
    /// A point in the scan's coordinates; the nearest place of its surface is taken.
    #[arg(long, value_name = "X,Y,Z", value_parser = args::numbers::<3, 3>, allow_hyphen_values = true, requires = "kind")]
    pub at: Vec<Numbers>,
    /// How far from a point its surface may be, in the scan's unit [default: a hundredth of the scan's
    /// diagonal].
    #[arg(long, value_name = "LENGTH", value_parser = args::positive)]
    pub reach: Option<f64>,
    /// What is seen at a pixel of the picture that --camera and --size give, counted from the upper
    /// left corner.
    #[arg(long, value_name = "X,Y", value_parser = args::numbers::<2, 2>, conflicts_with = "at", requires = "kind")]
    pub pixel: Vec<Numbers>,
    /// As for pictures: front, …, or RIGHT,UP,FRONT:RIGHT,UP,FRONT.
    #[arg(long, default_value = "three-quarter", allow_hyphen_values = true)]
    pub camera: String,
    /// Size of the picture in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = args::size)]
    pub size: (u32, u32),
    /// The scanner's expanded uncertainty of a length in the scan's unit, as declared: it is shown beside
    /// results [default: what the session declares, else the file's metadata].
    #[arg(long, value_name = "LENGTH", value_parser = args::positive)]
    pub scanner_u: Option<f64>,
    /// Its coverage factor.
    #[arg(long, value_name = "K", default_value_t = 2.0, value_parser = args::positive)]
    pub scanner_k: f64,
    /// Who declares it.
    #[arg(long, value_name = "TEXT", default_value = "command line")]
    pub scanner_source: String,
    /// In which frame coordinates and differences are shown: the scan's, or the statue's own, where a
    /// session says how it stands [default: as the session has it]. JSON has both.
    #[arg(long, value_enum, requires = "session")]
    pub coordinates: Option<CoordinatesArg>,
    /// Write a table that other programs read.
    #[arg(long, value_name = "CSV")]
    pub csv: Option<PathBuf>,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub enum CoordinatesArg {
    /// As the scan has them.
    Source,
    /// To the statue's right, upwards and to its front.
    Object,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum KindArg {
    /// Where a point is.
    Point,
    /// The straight line between two points.
    Distance,
    /// Straight lines from point to point.
    Polyline,
    /// At the second of three points.
    Angle,
    /// Along the surface from point to point, in upright planes; no bound is known of it.
    SurfaceLength,
    /// Of the surface inside a closed line; no bound is known of it.
    SurfaceArea,
}

impl KindArg {
    fn kind(self) -> MeasurementKind {
        match self {
            KindArg::Point => MeasurementKind::Point,
            KindArg::Distance => MeasurementKind::Distance,
            KindArg::Polyline => MeasurementKind::Polyline,
            KindArg::Angle => MeasurementKind::Angle,
            KindArg::SurfaceLength => MeasurementKind::SurfaceLength,
            KindArg::SurfaceArea => MeasurementKind::SurfaceArea,
        }
    }
}

#[derive(Args)]
pub struct NotesArgs {
    /// The .hlod file, or its address on a web server.
    pub file: PathBuf,
    /// The session that holds them.
    #[arg(long, value_name = "JSON")]
    pub session: PathBuf,
    /// Write them as W3C Web Annotations, with the targets of the IIIF Presentation 4 draft.
    #[arg(long, value_name = "JSON")]
    pub annotations: Option<PathBuf>,
    /// What annotations are about: an address at which others find the model [default: the file's name].
    #[arg(long, value_name = "ADDRESS", requires = "annotations")]
    pub target: Option<String>,
    #[command(flatten)]
    pub json: JsonArgs,
}

/// The keys of `measure --json`: they may become more.
#[derive(Serialize)]
struct MeasureReport {
    file: String,
    unit: String,
    scanner: Option<ScannerUncertainty>,
    /// The statue's own frame, and whether the table is in it.
    object_frame: Option<ObjectFrame>,
    scale_correction: Option<ScaleCorrection>,
    remarks: Vec<String>,
    measurements: Vec<MeasuredLine>,
}

impl MeasureReport {
    /// In which the table's coordinates are, where that is not the scan's frame.
    fn shown_frame(&self) -> Option<&ObjectFrame> {
        self.object_frame.as_ref().filter(|frame| frame.shown)
    }
}

#[derive(Serialize)]
struct MeasuredLine {
    name: String,
    kind: MeasurementKind,
    unit: String,
    /// None where it could not be measured again, which `failure` explains.
    #[serde(flatten)]
    measured: Option<Measured>,
    failure: Option<String>,
    /// By the session's known length, in its unit.
    corrected: Option<Corrected>,
    corrected_unit: Option<String>,
    /// What the session had stored.
    value_stored: Option<f64>,
    points: Vec<SurfacePoint>,
    /// The same points in the statue's own frame.
    object_positions: Option<Vec<[f64; 3]>>,
    /// How far points that were typed are from the surface.
    moved: Option<Vec<f64>>,
}

/// Reads a session, and says what does not fit.
pub fn load_session(
    path: &Path,
    file: &Path,
    header: &Header,
) -> Result<(Session, Vec<String>), Failure> {
    let session = session::load(path)?;
    let mismatch = session.model.mismatch(&ModelIdentity::new(file, header));
    let remarks: Vec<String> =
        mismatch.into_iter().map(|why| format!("{}: {why}", path.display())).collect();
    for remark in &remarks {
        let _ = writeln!(std::io::stderr(), "hlod-render: {remark}");
    }
    Ok((session, remarks))
}

/// A saved view of a session, the planes that cut the statue open there, and how it stands.
pub fn saved_view(
    args: &SessionArgs,
    file: &Path,
    header: &Header,
) -> Result<Option<(SavedView, ClipPlanes, Framing)>, Failure> {
    let (Some(path), Some(name)) = (&args.session, &args.view) else { return Ok(None) };
    let (session, _) = load_session(path, file, header)?;
    let view = session.view(name).cloned().ok_or_else(|| {
        let names: Vec<&str> = session.views.iter().map(|view| view.name.as_str()).collect();
        let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        Failure::Usage(format!("{}: no view “{name}”; there are: {names}", path.display()))
    })?;
    let framing = session_framing(&session, file, header)?;
    Ok(Some((view, session.clip_planes(), framing)))
}

/// How a statue stands by what a session says.
pub fn session_framing(
    session: &Session,
    file: &Path,
    header: &Header,
) -> Result<Framing, Failure> {
    let axes = session.frame.as_ref().map(ObjectFrame::axes);
    let reached = axes.map(|axes| extents(&Leaves::open(file)?, axes)).transpose()?;
    Ok(session.framing(header, reached))
}

pub fn run_measure(args: &MeasureArgs) -> Outcome {
    let leaves = Leaves::open(&args.file)?;
    let header = leaves.header();
    let mut report = MeasureReport {
        file: args.file.display().to_string(),
        unit: header.unit.name().to_owned(),
        scanner: None,
        object_frame: None,
        scale_correction: None,
        remarks: Vec::new(),
        measurements: Vec::new(),
    };
    match (&args.session, args.kind) {
        (Some(path), _) => {
            let (session, remarks) = load_session(path, &args.file, header)?;
            let again = session.measurements.iter().map(|m| measured_again(&leaves, m, &session));
            report.measurements = again.collect();
            report.remarks = remarks;
            report.object_frame = framed(&session, args, path)?;
            report.scanner = session.scanner;
            report.scale_correction = session.scale;
        }
        (None, Some(kind)) => report.measurements.push(measured_now(&leaves, kind.kind(), args)?),
        (None, None) => unreachable!("the parser lets through one or the other"),
    }
    if let Some(expanded) = args.scanner_u {
        let source = args.scanner_source.clone();
        report.scanner = Some(ScannerUncertainty { expanded, k: args.scanner_k, source });
    }
    if report.scanner.is_none() {
        declared_by_file(&leaves, &mut report)?;
    }
    if let Some(path) = &args.csv {
        write_file(path, &csv(&report)?)?;
    }
    print(&args.json, &report, || table(&report))?;
    let failed = report.measurements.iter().filter(|m| m.failure.is_some()).count();
    if failed > 0 {
        let all = report.measurements.len();
        return Err(Failure::Work(format!("{failed} of {all} could not be measured")));
    }
    Ok(())
}

/// What the file's metadata say, where nobody else said anything.
fn declared_by_file(leaves: &Leaves, report: &mut MeasureReport) -> Outcome {
    let Some(metadata) = leaves.metadata()? else { return Ok(()) };
    report.scanner = ScannerUncertainty::of_file(&metadata, leaves.header().unit);
    if let (None, Some(accuracy)) = (&report.scanner, metadata.accuracy()) {
        let remark = format!(
            "{}: its metadata declare an accuracy of {} {}, but not which unit its lengths have: not used",
            report.file,
            accuracy.value,
            accuracy.unit.name()
        );
        let _ = writeln!(std::io::stderr(), "hlod-render: {remark}");
        report.remarks.push(remark);
    }
    Ok(())
}

/// The statue's own frame, shown or not as it was asked for.
fn framed(
    session: &Session,
    args: &MeasureArgs,
    path: &Path,
) -> Result<Option<ObjectFrame>, Failure> {
    let wanted = args.coordinates.map(|wanted| wanted == CoordinatesArg::Object);
    match (session.frame.clone(), wanted) {
        (None, Some(true)) => Err(Failure::Usage(format!(
            "--coordinates object: {} does not say how the statue stands; set it in the window, under “How \
             it stands”",
            path.display()
        ))),
        (frame, None) => Ok(frame),
        (frame, Some(shown)) => Ok(frame.map(|frame| ObjectFrame { shown, ..frame })),
    }
}

fn measured_again(leaves: &Leaves, measurement: &Measurement, session: &Session) -> MeasuredLine {
    let now = measure(leaves, measurement.kind, &measurement.points);
    let scale = session.scale.as_ref();
    let placed = |frame: &ObjectFrame| -> Vec<[f64; 3]> {
        measurement.points.iter().map(|p| frame.place(p.position)).collect()
    };
    MeasuredLine {
        corrected: scale.zip(now.as_ref().ok()).and_then(|(s, now)| s.apply(measurement.kind, now)),
        corrected_unit: scale.map(|scale| measurement.kind.unit(&scale.unit)),
        object_positions: session.frame.as_ref().map(placed),
        name: measurement.name.clone(),
        kind: measurement.kind,
        unit: measurement.kind.unit(leaves.header().unit.name()),
        measured: now.as_ref().ok().copied(),
        failure: now.err().map(|e| e.to_string()),
        value_stored: measurement.result.map(|r| r.value),
        points: measurement.points.clone(),
        moved: None,
    }
}

fn measured_now(
    leaves: &Leaves,
    kind: MeasurementKind,
    args: &MeasureArgs,
) -> Result<MeasuredLine, Failure> {
    let framing = Framing::of_header(leaves.header());
    let mut moved = None;
    let points: Vec<SurfacePoint> = if args.pixel.is_empty() {
        let reach = args.reach.unwrap_or(0.01 * (framing.bounds.1 - framing.bounds.0).length());
        let unit = leaves.header().unit.name();
        let found = args.at.iter().map(|n| {
            let to = DVec3::new(n[0], n[1], n[2]);
            nearest_point(leaves, to, reach)?.ok_or_else(|| {
                let why = format!("--at {to}: no surface within {reach:.4} {unit} (--reach)");
                Failure::Work(why)
            })
        });
        let found = found.collect::<Result<Vec<_>, _>>()?;
        let typed = args.at.iter().map(|n| DVec3::new(n[0], n[1], n[2]));
        moved = Some(found.iter().zip(typed).map(|(p, to)| p.place().distance(to)).collect());
        found
    } else {
        let (width, height) = args.size;
        let aspect = f64::from(width) / f64::from(height);
        let camera = args::camera(&args.camera, &framing, aspect).map_err(Failure::Usage)?;
        let lens = Lens { camera, size: DVec2::new(width.into(), height.into()) };
        let found = args.pixel.iter().map(|n| {
            let pixel = DVec2::new(n[0], n[1]);
            let (origin, direction) = lens.ray(pixel);
            let hit = first_hit(leaves, origin, direction)?
                .ok_or_else(|| Failure::Work(format!("--pixel {pixel}: nothing is seen there")))?;
            let pixel_length = lens.pixel_length(lens.depth_of(hit.position));
            Ok(SurfacePoint::of_hit(&hit, Some(pixel_length)))
        });
        found.collect::<Result<Vec<_>, Failure>>()?
    };
    Ok(MeasuredLine {
        name: kind.name().to_owned(),
        kind,
        unit: kind.unit(leaves.header().unit.name()),
        measured: Some(measure(leaves, kind, &points)?),
        failure: None,
        corrected: None,
        corrected_unit: None,
        object_positions: None,
        value_stored: None,
        points,
        moved,
    })
}

fn table(report: &MeasureReport) -> String {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header([
        "name",
        "what",
        "value",
        "",
        "± file_bound",
        "± scanner_U",
        "Δx, Δy, Δz",
        "a pixel was",
    ]);
    let frame = report.shown_frame();
    for line in &report.measurements {
        let number = |value: f64| format!("{value:.4}");
        let measured = line.measured.as_ref();
        let value = match (line.kind, measured, line.points.first()) {
            (MeasurementKind::Point, Some(_), Some(p)) => {
                frame.map_or(p.position, |f| f.place(p.position)).map(number).join(", ")
            }
            (_, Some(m), _) => number(m.value),
            _ => line.failure.clone().unwrap_or_default(),
        };
        let bound = match measured.map(|m| m.file_bound) {
            Some(Some(bound)) => number(bound),
            Some(None) => "none: along the surface".to_owned(),
            None => String::new(),
        };
        let pixel = line.points.iter().filter_map(|p| p.pixel_length).fold(0.0, f64::max);
        table.add_row([
            line.name.clone(),
            line.kind.name().to_owned(),
            value,
            line.unit.clone(),
            bound,
            scanner(report, line.kind),
            measured
                .and_then(|m| m.delta)
                .map_or(String::new(), |d| frame.map_or(d, |f| f.vector(d)).map(number).join(", ")),
            if pixel > 0.0 { number(pixel) } else { String::new() },
        ]);
    }
    if let Some(values) = table.column_mut(2) {
        values.set_cell_alignment(CellAlignment::Right);
    }
    let differing = report.measurements.iter().filter(|line| {
        let (now, then) = (line.measured.map(|m| m.value), line.value_stored);
        now.zip(then).is_some_and(|(now, then)| (now - then).abs() > 1e-9 * now.abs().max(1e-9))
    });
    let names: Vec<&str> = differing.map(|line| line.name.as_str()).collect();
    let differing = match names[..] {
        [] => String::new(),
        _ => format!("\nNot as the session has it: {}", names.join(", ")),
    };
    let unit = match report.unit.as_str() {
        "unknown" => "the file's own unit, which nobody declared",
        unit => unit,
    };
    let frame = match &report.object_frame {
        None => String::new(),
        Some(frame) if frame.shown => {
            format!("\nCoordinates are the statue's own ({}): right, up, front.", frame.made)
        }
        Some(_) => "\nCoordinates are the scan's, not the statue's own.".to_owned(),
    };
    format!(
        "{} · lengths in {unit} · bounds are against the scan file, never the statue\n{table}{frame}{}{differing}",
        report.file,
        corrected_table(report)
    )
}

/// Lengths by a known one, where somebody declared it.
fn corrected_table(report: &MeasureReport) -> String {
    let Some(scale) = &report.scale_correction else { return String::new() };
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(["name", "corrected", "", "± file_bound"]);
    let number = |value: f64| format!("{value:.4}");
    for line in &report.measurements {
        let Some(corrected) = &line.corrected else { continue };
        table.add_row([
            line.name.clone(),
            number(corrected.value),
            line.corrected_unit.clone().unwrap_or_default(),
            corrected.file_bound.map_or("none: along the surface".to_owned(), number),
        ]);
    }
    let source = if scale.source.is_empty() { "nobody named" } else { &scale.source };
    format!(
        "\nBy a known length of {} {} between two points ({source}), × {:.6}; what it is off by is not in the bounds:\n\
         {table}",
        scale.known_length,
        scale.unit,
        scale.factor()
    )
}

/// What was declared, where it is about lengths.
fn scanner(report: &MeasureReport, kind: MeasurementKind) -> String {
    match (&report.scanner, kind) {
        (Some(u), MeasurementKind::Point | MeasurementKind::Distance) => {
            format!("{} (k = {}, {})", u.expanded, u.k, u.source)
        }
        (Some(_), _) => "declared for single lengths".to_owned(),
        (None, _) => "not declared".to_owned(),
    }
}

fn csv(report: &MeasureReport) -> Result<String, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::Work(format!("cannot write CSV: {e}"));
    let mut out = csv::Writer::from_writer(Vec::new());
    let head = [
        "name",
        "kind",
        "value",
        "unit",
        "file_bound",
        "scanner_U",
        "scanner_k",
        "scanner_source",
        "dx",
        "dy",
        "dz",
        "pixel_length_max",
        "points",
        "coordinates",
        "corrected_value",
        "corrected_unit",
        "corrected_file_bound",
    ];
    out.write_record(head).map_err(|e| failed(&e))?;
    for line in &report.measurements {
        let optional = |value: Option<f64>| value.map_or(String::new(), |v| v.to_string());
        let measured = line.measured.as_ref();
        let frame = report.shown_frame();
        let delta = measured.and_then(|m| m.delta).map(|d| frame.map_or(d, |f| f.vector(d)));
        let place = |p: &SurfacePoint| frame.map_or(p.position, |f| f.place(p.position));
        let scanner = report.scanner.as_ref();
        let points: Vec<String> =
            line.points.iter().map(|p| place(p).map(|v| v.to_string()).join(" ")).collect();
        let record = [
            line.name.clone(),
            line.kind.name().to_owned(),
            optional(measured.map(|m| m.value)),
            line.unit.clone(),
            optional(measured.and_then(|m| m.file_bound)),
            optional(scanner.map(|u| u.expanded)),
            optional(scanner.map(|u| u.k)),
            scanner.map_or("not declared".to_owned(), |u| u.source.clone()),
            optional(delta.map(|d| d[0])),
            optional(delta.map(|d| d[1])),
            optional(delta.map(|d| d[2])),
            optional(line.points.iter().filter_map(|p| p.pixel_length).reduce(f64::max)),
            points.join("; "),
            frame.map_or("source", |_| "object").to_owned(),
            optional(line.corrected.map(|c| c.value)),
            line.corrected.and(line.corrected_unit.clone()).unwrap_or_default(),
            optional(line.corrected.and_then(|c| c.file_bound)),
        ];
        out.write_record(record).map_err(|e| failed(&e))?;
    }
    let bytes = out.into_inner().map_err(|e| failed(&e))?;
    String::from_utf8(bytes).map_err(|e| failed(&e))
}

pub fn run_notes(args: &NotesArgs) -> Outcome {
    let leaves = Leaves::open(&args.file)?;
    let (session, remarks) = load_session(&args.session, &args.file, leaves.header())?;
    if let Some(path) = &args.annotations {
        let target = args.target.as_deref().unwrap_or(&session.model.file);
        write_file(path, &(super::to_json(&annotation_page(&session, target))? + "\n"))?;
    }
    let areas: Vec<Option<f64>> = session
        .notes
        .iter()
        .map(|note| {
            let closed = note.shape == session::NoteShape::Region;
            closed.then(|| measure(&leaves, MeasurementKind::SurfaceArea, &note.points).ok())?
        })
        .map(|measured| measured.map(|m| m.value))
        .collect();
    let unit = leaves.header().unit.name();
    let notes: Vec<_> = session.notes.iter().zip(&areas).collect();
    let json: Vec<_> = notes
        .iter()
        .map(|(note, area)| serde_json::json!({ "note": note, "surface_area": area }))
        .collect();
    let result = serde_json::json!({
        "file": args.file, "unit": unit, "remarks": remarks, "notes": json,
    });
    print(&args.json, &result, || {
        let mut table = Table::new();
        table.load_style(presets::UTF8_FULL_CONDENSED);
        table.set_header(["title", "category", "marks", "first point", "surface inside", "text"]);
        for (note, area) in &notes {
            let first = note.points.first().map_or([0.0; 3], |p| p.position);
            table.add_row([
                note.title.clone(),
                note.category.clone(),
                format!("{:?}", note.shape).to_lowercase(),
                first.map(|v| format!("{v:.3}")).join(", "),
                area.map_or(String::new(), |a| format!("{a:.3} {unit}²")),
                note.text.clone(),
            ]);
        }
        format!("{} notes on {}\n{table}", notes.len(), args.file.display())
    })
}
