//! Results for people.

use std::path::Path;

use comfy_table::{CellAlignment, Table, presets};
use hlod_build::synth::StatueReport;
use hlod_build::{
    BuildReport, CompareReport, ExportReport, Info, MetadataReport, StageCost, StepDescription,
    VerifyReport,
};
use hlod_scan::{ColourReport, ColourTaken, ScanReport};

/// A borderless table whose first column is text and whose others are numbers.
fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header(header.to_vec());
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// 12,345,678
fn grouped(value: u64) -> String {
    let digits = value.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

fn megabytes(bytes: u64) -> String {
    format!("{:.2} MB", bytes as f64 / 1e6)
}

/// Four significant digits.
fn length(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 12);
    format!("{value:.*}", digits as usize)
}

fn with_unit(text: String, unit: &str) -> String {
    if unit == "unknown" { format!("{text} (unit unknown)") } else { format!("{text} {unit}") }
}

pub fn build(report: &BuildReport) -> String {
    let costs = &report.costs;
    let mut stages = table(&["stage", "wall s", "cpu s", "memory", "read", "written"]);
    let seconds = |secs: f64| format!("{secs:.2}");
    for stage in &costs.stages {
        stages.add_row([
            stage.name.to_owned(),
            seconds(stage.wall_secs),
            seconds(stage.cpu_secs),
            megabytes(stage.peak_anonymous_bytes),
            megabytes(stage.bytes_read),
            megabytes(stage.bytes_written),
        ]);
    }
    let sum = |of: fn(&StageCost) -> u64| megabytes(costs.stages.iter().map(of).sum());
    stages.add_row([
        "all".to_owned(),
        seconds(costs.wall_secs),
        seconds(costs.cpu_secs),
        megabytes(costs.peak_anonymous_bytes),
        sum(|s| s.bytes_read),
        sum(|s| s.bytes_written),
    ]);
    let odd = odd(report).map_or(String::new(), |odd| format!("\nodd: {odd}"));
    let (count, one, many) = primitives(report.triangles_input, report.points_input);
    let rate = count as f64 / costs.cpu_secs.max(1e-9) / 1e3;
    format!(
        "{}: {} in {} nodes, {:.2} bytes a {one}\n{stages}\n{} {many}, {rate:.0} K a CPU second{odd}",
        report.output.display(),
        megabytes(report.bytes_total),
        report.nodes,
        report.bytes_total as f64 / count.max(1) as f64,
        grouped(count),
    )
}

/// How many there are of what a scan consists of, and what one and many of them are called.
fn primitives(triangles: u64, points: u64) -> (u64, &'static str, &'static str) {
    if points > 0 { (points, "point", "points") } else { (triangles, "triangle", "triangles") }
}

/// What is odd about the scans, in words; nothing where nothing is.
fn odd(report: &BuildReport) -> Option<String> {
    let odd = &report.oddities;
    let no_normal: u64 = report.inputs.iter().map(|input| input.normals_absent).sum();
    let counts = [
        (report.vertices_unused, "vertices of no triangle"),
        (no_normal, "normals of no length"),
        (report.triangles_degenerate, "triangles without an area"),
        (odd.triangles_duplicate, "duplicate triangles"),
        (odd.edges_open, "open edges"),
        (odd.edges_inverted, "edges between opposite orientations"),
        (odd.edges_nonmanifold, "edges of three and more triangles"),
    ];
    let found = counts.iter().filter(|(count, _)| *count > 0);
    let said: Vec<String> =
        found.map(|(count, what)| format!("{} {what}", grouped(*count))).collect();
    (!said.is_empty()).then(|| said.join(", "))
}

/// What a reader skipped or repaired, in words.
pub fn input_remarks(report: &ScanReport) -> Vec<String> {
    let mut out = Vec::new();
    if !report.skipped.is_empty() {
        out.push(format!("not used: {}", report.skipped.join(", ")));
    }
    if let Some(transform) = &report.transform {
        out.push(format!("moved by {transform}"));
    }
    out.extend(colour_remarks(&report.colours));
    if report.degenerate_faces > 0 {
        out.push(format!("{} degenerate faces left out", grouped(report.degenerate_faces)));
    }
    out.extend(report.warnings.iter().cloned());
    out
}

/// Where colours come from, where there was a choice, and how much coarser than their texture they are.
fn colour_remarks(colours: &ColourReport) -> Vec<String> {
    let mut out = Vec::new();
    if colours.taken == ColourTaken::Texture {
        let sizes: Vec<String> = colours
            .textures
            .iter()
            .map(|t| {
                format!("{} ({} × {})", t.name, grouped(t.width.into()), grouped(t.height.into()))
            })
            .collect();
        out.push(format!(
            "colours are the mean of textures round each vertex, which stands for {:.1} texels: {}",
            colours.texels_a_vertex,
            sizes.join(", ")
        ));
    }
    if !colours.left_out.is_empty() {
        out.push(format!("colours not taken: {}", colours.left_out.join(", ")));
    }
    let counts = [
        (colours.corners_nowhere, "corners of faces have no place in their texture"),
        (
            colours.corners_outside,
            "corners of faces lie outside their texture, which goes on there",
        ),
        (colours.vertices_bare, "vertices have no colour and are white"),
    ];
    let found = counts.iter().filter(|(count, _)| *count > 0);
    out.extend(found.map(|(count, what)| format!("{} {what}", grouped(*count))));
    out
}

pub fn info(info: &Info) -> String {
    let (count, one, many) = primitives(info.triangles_input, info.points_input);
    let mut parts = table(&["part", "bytes", &format!("a {one}")]);
    for (name, bytes) in [
        ("leaves", info.bytes_leaves),
        ("appearance, upper", info.bytes_appearance_upper),
        ("geometric, upper", info.bytes_geometric_upper),
        ("header, skeleton", info.bytes_skeleton),
        ("metadata", info.bytes_metadata),
        ("file", info.bytes_total),
    ] {
        if (name, bytes) == ("metadata", 0) {
            continue;
        }
        parts.add_row([
            name,
            &grouped(bytes),
            &format!("{:.3}", bytes as f64 / count.max(1) as f64),
        ]);
    }
    let has_points = info.levels.iter().any(|level| level.points_mean > 0.0);
    // What a point cloud has none of, or only files with points have.
    let columns: [(&str, bool); 12] = [
        ("depth", true),
        ("nodes", true),
        ("leaves", true),
        ("triangles", info.points_input == 0),
        ("points", true),
        ("geometric", info.points_input == 0),
        ("error", true),
        ("seen", true),
        ("covers", has_points),
        ("border", info.points_input == 0),
        ("normals 99 %", true),
        ("90 %", true),
    ];
    let shown = |cells: [String; 12]| -> Vec<String> {
        cells.into_iter().zip(columns).filter(|(_, (_, is_shown))| *is_shown).map(|c| c.0).collect()
    };
    let names: Vec<&str> = columns.iter().filter(|c| c.1).map(|c| c.0).collect();
    let mut levels = table(&names);
    for level in &info.levels {
        levels.add_row(shown([
            level.depth.to_string(),
            grouped(level.nodes),
            grouped(level.leaves),
            format!("{:.0}", level.triangles_mean),
            format!("{:.0}", level.points_mean),
            format!("{:.0}", level.triangles_geometric_mean),
            length(level.error_max),
            length(level.visual_error_max),
            length(level.cover_radius_max),
            length(level.border_error_max),
            format!("{:.1}°", level.normal_deviation_deg_mean[1]),
            format!("{:.1}°", level.normal_deviation_deg_mean[2]),
        ]));
    }
    let legend = if info.points_input > 0 {
        "(points and normals: means a node; errors: the largest of a depth, in the scan's unit. Proven: each\n\
         point of a node lies within the error of a point of the scan, each point of the scan within the\n\
         radius at which a point of the node covers, and normals deviate by no more. What lies between\n\
         the scan's points is not known: how large they are drawn is estimated from their neighbours)"
    } else {
        "(triangles, points and normals: means a node; errors, of shape, of what is seen and of\n\
         borders between nodes, and radii at which points cover: the largest of a depth, in the scan's unit)"
    };
    let size: Vec<String> =
        (0..3).map(|i| length(info.bounds_max[i] - info.bounds_min[i])).collect();
    let sources: Vec<String> = info
        .sources
        .iter()
        .map(|s| {
            format!("{} ({}, SHA-256 {}…)", s.base_name, megabytes(s.file_bytes), &s.sha256[..12])
        })
        .collect();
    let about = about(&info.about);
    format!(
        "{about}from         {}\nsize         {}, up {}, front {}\nprecision    {}\n\
         {many:<12} {} read, {} nodes, R = {}, T = {}{}\nattributes   {}\nsurface      {}\n\
         errors       {} against the scan file; {}\n\n{parts}\n\n{levels}\n{legend}\n\
         (levels of detail for looking and measuring, not an archive: keep the scan)",
        sources.join("\n             "),
        with_unit(size.join(" × "), info.unit),
        info.up,
        info.front,
        with_unit(length(info.precision_step), info.unit),
        grouped(count),
        grouped(info.nodes),
        info.resolution,
        info.leaf_triangles,
        match info.points_input {
            0 => format!(", {} × noise, {}", info.normal_noise, info.representation),
            _ => String::new(),
        },
        attributes(info),
        if info.points_input > 0 {
            "none: a point cloud"
        } else if info.closed_oriented {
            "closed, facing outwards"
        } else {
            "open or not consistently oriented"
        },
        info.error_status,
        match info.nodes_over_budget {
            0 => "all within their budget".to_owned(),
            count => format!("{} nodes over their budget", grouped(count)),
        },
    )
}

/// Names of attributes; numbers that were kept with their ranges, a line each.
fn attributes(info: &Info) -> String {
    let is_number = |name: &&String| info.scalars.iter().any(|s| s.name == **name);
    let others = info.attributes.iter().filter(|name| !is_number(name)).cloned();
    let mut out = others.collect::<Vec<_>>().join(", ");
    for scalar in &info.scalars {
        let unit = if scalar.unit.is_empty() { String::new() } else { format!(" {}", scalar.unit) };
        out += &match (scalar.minimum, scalar.maximum) {
            (Some(low), Some(high)) => {
                let (name, off) = (&scalar.name, scalar.precision);
                format!("\n             {name} {low} to {high}{unit}, to ± {off}")
            }
            _ => format!("\n             {} without any value", scalar.name),
        };
    }
    out
}

/// Names and texts, a line each, and an empty line.
fn about(lines: &[(String, String)]) -> String {
    let widest = lines.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0).max(12);
    let mut out: String =
        lines.iter().map(|(name, text)| format!("{name:<widest$} {text}\n")).collect();
    if !out.is_empty() {
        out.push('\n');
    }
    out
}

pub fn metadata(report: &MetadataReport) -> String {
    let unknown = match &report.unknown_keys[..] {
        [] => "every key is known".to_owned(),
        keys => format!("kept, though nothing is known of it: {}", keys.join(", ")),
    };
    format!("{}{unknown}", about(&report.lines))
}

pub fn steps(steps: &[StepDescription]) -> String {
    let mut table = table(&["step", "triangles", "reads", "writes", "state"]);
    for step in steps {
        let state = match (step.done, step.ready) {
            (true, _) => "done",
            (false, true) => "ready",
            (false, false) => "waits",
        };
        let files = step.needs.iter().filter(|name| !name.ends_with(".json")).count();
        table.add_row([
            step.name.clone(),
            step.triangles.map(grouped).unwrap_or_default(),
            format!("{files} files"),
            step.makes.join(" "),
            state.to_owned(),
        ]);
    }
    table.to_string()
}

pub fn prepared(all: &[StepDescription], folder: &Path) -> String {
    let subtrees = all.iter().filter(|step| step.triangles.is_some()).count();
    format!(
        "{}: {} subtrees and {} nodes above them are left to build; `hlod-build step` lists and does \
         them, `build --resume` finishes",
        folder.display(),
        subtrees,
        all.len() - subtrees
    )
}

pub fn verify(report: &VerifyReport) -> String {
    let mut summary = table(&["check", "result"]);
    for (name, value) in [
        ("nodes", grouped(report.nodes)),
        ("representations sampled", grouped(report.representations_sampled)),
        ("over their stored error", grouped(report.nodes_over_bound)),
        ("over their stored deviation of normals", grouped(report.nodes_over_normal_bound)),
        ("stored ÷ sampled, median", format!("{:.3}", report.tightness_median)),
        ("stored ÷ sampled, 95 %", format!("{:.3}", report.tightness_p95)),
        ("independent bound ÷ stored, max", format!("{:.3}", report.independent_ratio_max)),
        (
            "leaves that differ from the input",
            if report.leaves_compared {
                grouped(report.leaves_differ)
            } else {
                "not compared".into()
            },
        ),
    ] {
        summary.add_row([name, &value]);
    }
    if report.values_compared > 0 {
        summary.add_row(["vertices' values compared", &grouped(report.values_compared)]);
    }
    let verdict = if report.is_refuted() { "REFUTED" } else { "nothing refuted" };
    let problems: String = report.problems.iter().map(|p| format!("\n- {p}")).collect();
    format!("{summary}\n{verdict}{problems}")
}

pub fn compare(report: &CompareReport) -> String {
    let relative = |value: f64| format!("{:.4} %", 100.0 * value / report.diagonal);
    let mut distances = table(&["distance", "largest", "of diagonal", "RMS", "of diagonal"]);
    for (name, d) in
        [("reference to mesh", &report.forward), ("mesh to reference", &report.backward)]
    {
        let cells = [length(d.max), relative(d.max), length(d.rms), relative(d.rms)];
        distances.add_row([name, &cells[0], &cells[1], &cells[2], &cells[3]]);
    }
    let mut normals = table(&["normals", "mean", "95 %"]);
    for (name, d) in
        [("of faces", &report.face_normal_deg), ("as shaded", &report.shading_normal_deg)]
    {
        normals.add_row([name, &format!("{:.2}°", d.mean), &format!("{:.2}°", d.p95)]);
    }
    format!(
        "{} triangles against {}, diagonal {}\n{distances}\n{normals}",
        grouped(report.triangles),
        grouped(report.triangles_reference),
        length(report.diagonal),
    )
}

pub fn export(report: &ExportReport, output: &Path) -> String {
    let mut text = format!(
        "{}: {} vertices, {} triangles from {} nodes, error at most {}",
        output.display(),
        grouped(report.vertices),
        grouped(report.triangles),
        grouped(report.nodes),
        length(report.error_max),
    );
    if report.rounding_max > 0.0 {
        text +=
            &format!(", and {} by rounding to the format's numbers", length(report.rounding_max));
    }
    for name in &report.left_out {
        text += &format!("\nnot written: {name}, for which this format has no place (PLY has one)");
    }
    text
}

pub fn synth(report: &StatueReport, output: &Path) -> String {
    format!(
        "{}: {} triangles, {} vertices, {}, spacing {} mm, noise σ {} mm",
        output.display(),
        grouped(report.triangles),
        grouped(report.vertices),
        megabytes(report.file_bytes),
        length(report.spacing_mm),
        length(report.noise_sigma_mm),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_for_people() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(1_087_716), "1,087,716");
        assert_eq!(length(0.000_123_456), "0.0001235");
        assert_eq!(length(156.44), "156.4");
        assert_eq!(with_unit("3".into(), "unknown"), "3 (unit unknown)");
    }
}
