//! `hlod-render section`: planes cut a scan, outlines are measured and drawn.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use comfy_table::{CellAlignment, Table, presets};
use glam::DVec3;
use indicatif::ProgressDrawTarget;

use hlod_compress::Unit;
use hlod_render::RenderError;
use hlod_render::files::write_whole;
use hlod_render::leaves::Leaves;
use hlod_render::section::{GRAZING_DEG, JOIN_STEPS, Layer, Plane, Sheet, cut};
use hlod_render::session::{SECTIONS_MAX, SectionPlane};

use super::args::{Cli, JsonArgs, numbers, positive};
use super::outcome::{Failure, Outcome};
use super::work::load_session;
use super::{print, progress_bar};

/// A bar is shown after so long.
const SHOW_BAR_AFTER: Duration = Duration::from_secs(1);

#[derive(Args)]
#[command(after_help = "\
Coordinates and lengths are the scan's own, in its unit. Outlines are those of full resolution, \
with what is solid on the left. Drawings show a plane from the side to which its normal points, with \
the statue's up above; a level plane has the statue's front below. Areas count hollows as negative. \
'off by' is the file's proven error over the sine of the angle between surface and plane, for 95 % \
of the length.")]
pub struct SectionArgs {
    /// The .hlod file, or its address on a web server.
    pub file: PathBuf,
    /// NX,NY,NZ,OFFSET of a plane nx·x + ny·y + nz·z = offset, or x=, y= or z= and where it is.
    #[arg(long, value_name = "PLANE", value_parser = plane, allow_hyphen_values = true)]
    pub plane: Vec<Plane>,
    /// A plane through three points, seen from where they turn counter-clockwise.
    #[arg(long, value_name = "X,Y,Z/X,Y,Z/X,Y,Z", value_parser = through, allow_hyphen_values = true)]
    pub through: Vec<Plane>,
    /// The planes of a session, whether shown or not.
    #[arg(long, value_name = "JSON")]
    pub session: Option<PathBuf>,
    /// As many sections in parallel, from each plane on along its normal.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub parallel: u32,
    /// How far they are apart.
    #[arg(long, value_name = "LENGTH", value_parser = positive)]
    pub spacing: Option<f64>,
    /// The unit, where the file does not know it or is wrong: mm, cm, m, um or in.
    #[arg(long, value_parser = unit)]
    pub unit: Option<Unit>,
    /// Draw to scale in millimetres.
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// Scale of the SVG, as in 1:5.
    #[arg(long, value_name = "1:N", default_value = "1:1", value_parser = scale)]
    pub scale: f64,
    /// Draw for CAD, in the scan's unit, a layer a section.
    #[arg(long, value_name = "FILE")]
    pub dxf: Option<PathBuf>,
    /// Write all points as a table.
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    #[command(flatten)]
    pub json: JsonArgs,
}

pub fn run(cli: &Cli, args: &SectionArgs) -> Outcome {
    let mut planes: Vec<Plane> = args.plane.iter().chain(&args.through).copied().collect();
    if args.session.is_none() {
        check(args, &planes)?;
    }
    let leaves = Leaves::open(&args.file)?;
    if let Some(path) = &args.session {
        let (session, _) = load_session(path, &args.file, leaves.header())?;
        planes.extend(session.sections.iter().map(SectionPlane::plane));
        check(args, &planes)?;
    }
    let sheet = sections(cli, args, &planes, &leaves)?;
    write_drawings(args, &sheet)?;
    print(&args.json, &sheet.report(), || table(&sheet))?;
    if sheet.bounds().is_none() {
        let why = "no plane meets the scan; `hlod-build info` says where it is";
        return Err(Failure::Work(format!("{}: {why}", args.file.display())));
    }
    Ok(())
}

fn check(args: &SectionArgs, planes: &[Plane]) -> Outcome {
    let usage = |why: String| Err(Failure::Usage(format!("section: {why}")));
    if planes.is_empty() || planes.len() > SECTIONS_MAX {
        let count = planes.len();
        return usage(format!(
            "{count} planes: give one to {SECTIONS_MAX} by --plane, --through and --session"
        ));
    }
    match (args.parallel, args.spacing) {
        (1, Some(_)) => return usage("--spacing needs --parallel N".into()),
        (2.., None) => return usage("--parallel needs --spacing LENGTH".into()),
        _ => {}
    }
    let json = args.json.json.iter().flatten();
    let outputs = [&args.svg, &args.dxf, &args.csv].into_iter().flatten().chain(json);
    let outputs: Vec<&PathBuf> = outputs.collect();
    for (i, output) in outputs.iter().enumerate() {
        if outputs[..i].contains(output) || is_same(output, &args.file) {
            return usage(format!("{} would be written over", output.display()));
        }
    }
    Ok(())
}

fn is_same(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    }
}

fn sections(
    cli: &Cli,
    args: &SectionArgs,
    planes: &[Plane],
    leaves: &Leaves,
) -> Result<Sheet, Failure> {
    let total = planes.len() as u64 * u64::from(args.parallel);
    let bar = progress_bar(true, total, "sections");
    let start = Instant::now();
    let mut families = Vec::new();
    for plane in planes {
        let mut family = Vec::new();
        for i in 0..args.parallel {
            let plane = plane.moved(f64::from(i) * args.spacing.unwrap_or(0.0));
            family.push(cut(leaves, &plane, None)?);
            bar.inc(1);
            if !cli.quiet && bar.is_hidden() && start.elapsed() > SHOW_BAR_AFTER {
                bar.set_draw_target(ProgressDrawTarget::stderr());
            }
        }
        families.push(family);
    }
    bar.finish_and_clear();
    let sheet = Sheet::new(&args.file, leaves.header(), args.unit, families);
    Ok(sheet.about(leaves.metadata()?.as_ref()))
}

fn write_drawings(args: &SectionArgs, sheet: &Sheet) -> Result<(), RenderError> {
    // All are made before any is written: a unit that is missing leaves nothing behind.
    let mut files = Vec::new();
    if let Some(path) = &args.svg {
        files.push((path, sheet.to_svg(args.scale)?));
    }
    if let Some(path) = &args.dxf {
        files.push((path, sheet.to_dxf()?));
    }
    if let Some(path) = &args.csv {
        files.push((path, sheet.to_csv()));
    }
    files.iter().try_for_each(|(path, bytes)| write_whole(path, bytes))
}

/// One row a section.
fn table(sheet: &Sheet) -> String {
    let unit = sheet.unit_suffix();
    let square = if unit.is_empty() { String::new() } else { format!("{unit}²") };
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header([
        "section".to_owned(),
        "lines".into(),
        "open".into(),
        format!("length{unit}"),
        format!("area{square}"),
        format!("width × height{unit}"),
        format!("circle, radius ± rms{unit}"),
        format!("off by{unit}"),
    ]);
    for layer in &sheet.layers {
        table.add_row(row(layer));
    }
    for column in 1..8 {
        if let Some(values) = table.column_mut(column) {
            values.set_cell_alignment(CellAlignment::Right);
        }
    }
    let mut text = format!("{} · unit {}\n{table}", sheet.provenance.file, sheet.unit.name());
    for remark in remarks(sheet) {
        text += &format!("\n{remark}");
    }
    text
}

fn row(layer: &Layer) -> Vec<String> {
    let section = &layer.section;
    let Some([min, max]) = section.bounds() else {
        return vec![layer.name.clone(), "misses the scan".into()];
    };
    let measures = section.measures();
    // Of several lines no circle is expected; the longest may be one.
    let circle = section.lines.first().map(|line| line.circle(&section.frame));
    let circle = match circle {
        Some(Ok(circle)) => format!("{} ± {}", short(circle.radius), short(circle.rms)),
        Some(Err(_)) | None => "–".into(),
    };
    let bound = section.trust.outline_bound_95;
    vec![
        layer.name.clone(),
        section.lines.len().to_string(),
        measures.open.to_string(),
        short(measures.length),
        format!("{}{}", short(measures.area), if measures.area_is_whole { "" } else { "*" }),
        format!("{} × {}", short(max.x - min.x), short(max.y - min.y)),
        circle,
        if bound.is_finite() { short(bound) } else { "unknown".into() },
    ]
}

/// What the table's numbers do not say.
fn remarks(sheet: &Sheet) -> Vec<String> {
    let mut remarks = Vec::new();
    let sections = || sheet.layers.iter().map(|layer| &layer.section);
    let whole = |s: &&hlod_render::section::Section| s.measures().area_is_whole;
    if !sections().all(|s| whole(&s)) {
        remarks.push(
            "* of the closed lines alone: others are open, or run against their triangles".into(),
        );
    }
    if sections().any(|s| s.lines.len() > 1) {
        remarks.push("circles are those of the longest line; --json has all".into());
    }
    let grazing = sections().map(|s| s.trust.grazing).fold(0.0, f64::max);
    if grazing > 0.0 {
        remarks.push(format!(
            "up to {:.2} % of a section's length is within {GRAZING_DEG}° of touching the plane: how far off \
             it is cannot be said",
            100.0 * grazing
        ));
    }
    let joins: usize = sections().map(|s| s.joins).sum();
    if joins > 0 {
        let widest = sections().map(|s| s.widest_gap).fold(0.0, f64::max);
        remarks.push(format!(
            "{joins} ends joined where parts of different depth meet ({JOIN_STEPS} steps of the lattice); \
             widest gap {}{}",
            short(widest),
            sheet.unit_suffix()
        ));
    }
    let crowded: usize = sections().map(|s| s.crowded_edges).sum();
    if crowded > 0 {
        remarks.push(format!("lines meet in {crowded} edges of more than two triangles"));
    }
    remarks
}

/// Five digits, for reading.
fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let digits = (4.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.digits$}")
}

pub fn plane(text: &str) -> Result<Plane, String> {
    let plane = match text.split_once('=') {
        Some((axis, offset)) => {
            let axis = ["x", "y", "z"].iter().position(|name| *name == axis.trim());
            let axis = axis.ok_or("expected x=, y= or z= and a number")?;
            let offset = numbers::<1, 1>(offset)?;
            Plane::across(axis, offset[0])
        }
        None => {
            let n = numbers::<4, 4>(text)?;
            Plane::from_equation(DVec3::new(n[0], n[1], n[2]), n[3])
        }
    };
    plane.map_err(|e| e.to_string())
}

fn through(text: &str) -> Result<Plane, String> {
    let points = text.split('/').map(|point| {
        let n = numbers::<3, 3>(point)?;
        Ok(DVec3::new(n[0], n[1], n[2]))
    });
    let points: Vec<DVec3> = points.collect::<Result<_, String>>()?;
    let points: [DVec3; 3] =
        points.try_into().map_err(|_| "expected three points with slashes between them")?;
    Plane::through(points).map_err(|e| e.to_string())
}

fn unit(text: &str) -> Result<Unit, String> {
    match text.parse()? {
        Unit::Unknown => Err("expected mm, cm, m, um or in".into()),
        unit => Ok(unit),
    }
}

fn scale(text: &str) -> Result<f64, String> {
    let reduction = text.strip_prefix("1:").and_then(|n| n.parse::<f64>().ok());
    let reduction = reduction.filter(|n| n.is_finite() && (1e-6..=1e9).contains(n));
    reduction.ok_or_else(|| "expected 1: and how many times smaller, as in 1:5".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_and_scales_are_checked() {
        assert_eq!(plane("x=12.5"), Ok(Plane { normal: DVec3::X, offset: 12.5 }));
        assert_eq!(plane("0,0,-2,3"), Ok(Plane { normal: -DVec3::Z, offset: 1.5 }));
        let three = through("0,0,1/1,0,1/0,1,1").unwrap();
        assert!((three.normal - DVec3::Z).length() < 1e-12 && (three.offset - 1.0).abs() < 1e-12);
        for wrong in ["w=1", "x=", "x=1,2", "0,0,0,1", "1,2,3", "x=NaN", "1,0,0,inf"] {
            assert!(plane(wrong).is_err(), "{wrong}");
        }
        for wrong in ["0,0,0/1,1,1/2,2,2", "0,0,0/1,0,0", "0,0/1,0/0,1", "0,0,0/1,0,0/0,1,0/1,1,1"]
        {
            assert!(through(wrong).is_err(), "{wrong}");
        }
        assert_eq!(scale("1:5"), Ok(5.0));
        assert!(["5", "1:0", "1:-2", "2:1", "1:x", "1:NaN"].iter().all(|s| scale(s).is_err()));
        assert_eq!(unit("cm"), Ok(Unit::Centimetre));
        assert!(unit("unknown").is_err() && unit("ell").is_err());
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [short(0.0), short(1234.5678), short(-0.012345678)],
            ["0", "1234.6", "-0.012346"]
        );
        assert_eq!(short(1.0e7), "10000000");
    }
}
