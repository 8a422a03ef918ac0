//! Results for people.

use std::fmt::Write as _;
use std::path::Path;

use comfy_table::{CellAlignment, Table, presets};
use hlod_render::Gpu;
use hlod_render::audit::AuditReport;
use hlod_render::audit::seams::SeamReport;
use hlod_render::audit::shadows::EdgeDistance;
use hlod_render::bench::BenchReport;
use hlod_render::figure::scale::Scale;
use hlod_render::figure::{Drawn, Sheet};
use hlod_render::shadow_map::{MapCount, TEXEL_MAX_PX};
use hlod_render::simulate::SimulationReport;

fn table(rows: &[(&str, String)]) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    for (name, value) in rows {
        table.add_row([*name, value.as_str()]);
    }
    if let Some(values) = table.column_mut(1) {
        values.set_cell_alignment(CellAlignment::Right);
    }
    table.to_string()
}

pub fn shot(output: &Path, stats: &Drawn, gpu: &Gpu) -> String {
    let primitives = match (stats.triangles, stats.points) {
        (triangles, 0) => format!("{triangles} triangles"),
        (0, points) => format!("{points} points"),
        (triangles, points) => format!("{triangles} triangles and {points} points"),
    };
    let (nodes, adapter) = (stats.nodes, gpu.describe());
    let maps = match stats.maps {
        MapCount { maps: 0, .. } => String::new(),
        MapCount { maps, fallbacks, .. } => format!(
            "; {maps} shadow {}{}, texels longer than {TEXEL_MAX_PX} px on {:.1} % of what is seen up to 60°",
            if maps == 1 { "map" } else { "maps" },
            if fallbacks > 0 {
                format!(", {fallbacks} of them uniform instead")
            } else {
                String::new()
            },
            100.0 * stats.maps.denied_share()
        ),
    };
    format!("{}: {primitives} of {nodes} nodes, drawn by {adapter}{maps}", output.display())
}

pub fn plate(output: &Path, sheet: &Sheet, scale: &Scale, gpu: &Gpu) -> String {
    let mm = |px: u32| f64::from(px) * scale.pixel_on_paper_mm();
    format!(
        "{}: {} at {} dpi, {:.0} × {:.0} mm of paper, {} × {} pixels, drawn by {}",
        output.display(),
        scale.name(),
        scale.dpi,
        mm(sheet.width),
        mm(sheet.height),
        sheet.width,
        sheet.height,
        gpu.describe()
    )
}

pub fn series(output: &Path, count: usize, gpu: &Gpu) -> String {
    format!("{}: {count} pictures, drawn by {}", output.display(), gpu.describe())
}

pub fn bench(r: &BenchReport) -> String {
    let ms = |value: f64| format!("{value:.2} ms");
    let mut rows = vec![
        ("frames a second", format!("{:.1}", r.fps_mean)),
        ("frame, median", ms(r.frame_ms.p50)),
        ("frame, 95 %", ms(r.frame_ms.p95)),
        ("frame, 99 %", ms(r.frame_ms.p99)),
        ("frame, largest", ms(r.frame_ms.max)),
        ("primitives a frame", format!("{:.0}", r.primitives_mean)),
        ("… that cast shadows", format!("{:.0}", r.caster_primitives_mean)),
        ("… parts without room", r.shadow_tiles_beyond.to_string()),
        ("frames that lacked some of these", r.frames_missing_casters.to_string()),
        ("points a pixel they cover", format!("{:.2}", r.points_per_covered_pixel)),
        ("stalled frames", r.stalled_frames.to_string()),
        ("frames coarser than τ", r.frames_over_tau.to_string()),
        ("τ drawn ÷ τ", format!("{:.3}", r.tau_ratio_mean)),
        ("frames coarser than 2τ, after 2 s", r.frames_over_2tau.to_string()),
        ("frames coarser for want of memory", r.frames_coarsened.to_string()),
        ("read", format!("{:.2} MB", r.bytes_read as f64 / 1e6)),
        ("… and drawn", format!("{:.2} MB", r.bytes_drawn as f64 / 1e6)),
        ("on the GPU, most", format!("{:.2} MB", r.resident_bytes_max as f64 / 1e6)),
    ];
    rows.extend(r.stages_ms.iter().map(|stage| (stage.stage, ms(stage.ms))));
    format!(
        "{} · {} · {} · {}×{} · τ = {} px · {} frames{}\n{}\n{}",
        r.file.display(),
        r.path,
        r.representation,
        r.width,
        r.height,
        r.tau_px,
        r.frames,
        if r.cold { " · cold" } else { "" },
        r.adapter,
        table(&rows)
    )
}

pub fn simulation(r: &SimulationReport) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    let mut header =
        vec!["policy", "stalled", "τ drawn ÷ τ", "over 2τ", "no memory", "read", "of it drawn"];
    if r.caster_tau_px.is_some() {
        header.extend(["casters over 2τ_c", "casters missing"]);
    }
    let columns = header.len();
    table.set_header(header);
    for p in &r.policies {
        let share = |frames: u32| {
            format!("{:.1} %", 100.0 * f64::from(frames) / f64::from(p.frames_after_start.max(1)))
        };
        let mut row = vec![
            p.policy.name().to_string(),
            p.stalled_frames.to_string(),
            format!("{:.3}", p.tau_ratio_mean),
            share(p.frames_over_2tau),
            format!("{:.1} %", 100.0 * f64::from(p.frames_coarsened) / f64::from(p.frames.max(1))),
            format!("{:.1} MB", p.bytes_read as f64 / 1e6),
            format!("{:.0} %", 100.0 * p.bytes_drawn as f64 / p.bytes_read.max(1) as f64),
        ];
        if let Some(casters) = p.casters {
            row.extend([share(casters.frames_over_2tau), share(casters.frames_missing_casters)]);
        }
        table.add_row(row);
    }
    for column in 1..columns {
        if let Some(values) = table.column_mut(column) {
            values.set_cell_alignment(CellAlignment::Right);
        }
    }
    let shadows = match (r.caster_tau_px, r.light_turn_deg_per_sec) {
        (Some(tau), Some(turn)) => format!(" · τ_c = {tau} px, light turns {turn}° a second"),
        _ => String::new(),
    };
    format!(
        "{} · {} · τ = {} px{shadows} · {:.1} MB/s, {:.0} ms, {:.0} MB kept, {} frames a second\n{}\n\
         over 2τ, over 2τ_c, missing: frames after the first two seconds in which anything was that\n\
         no memory: frames that were coarser because what was asked for takes more than is kept",
        r.file.display(),
        r.path,
        r.tau_px,
        r.bytes_per_sec / 1e6,
        r.latency_secs * 1e3,
        r.cache_bytes as f64 / 1e6,
        r.frames_per_sec,
        table
    )
}

pub fn audit(r: &AuditReport) -> String {
    let px = |value: f64| format!("{value:.3} px");
    let a = &r.appearance_distance_px;
    let s = &r.silhouette_distance_px;
    let rows = [
        ("views", r.views.to_string()),
        ("pixels compared", r.pixels_compared.to_string()),
        ("hole pixels", r.hole_pixels.to_string()),
        ("overdraw pixels", r.overdraw_pixels.to_string()),
        ("appearance distance, 99 %", px(a.p99)),
        ("appearance distance, 99.9 %", px(a.p999)),
        ("appearance distance, largest", px(a.max)),
        ("… of the full model, 99.9 %", px(a.floor_p999)),
        ("silhouette distance, 99 %", px(s.p99)),
        ("silhouette distance, 99.9 %", px(s.p999)),
        ("silhouette scored", format!("{:.1} %", 100.0 * s.scored_share)),
    ];
    let mut rows = rows.to_vec();
    if let Some(maps) = r.shadow_edge_px.as_ref().and_then(|edge| edge.maps) {
        rows.extend([
            ("shadow maps", format!("{}, {} uniform instead", maps.maps, maps.fallbacks)),
            ("… texels too long", format!("{:.1} % of pixels", 100.0 * maps.denied_share)),
        ]);
    }
    if let Some(penumbra) = &r.penumbra {
        let of_hard = |soft: f64, hard: f64| format!("{soft:.3} (hard {hard:.3})");
        rows.extend([
            ("penumbrae, RMSE", of_hard(penumbra.rmse, penumbra.hard_rmse)),
            ("… everywhere", of_hard(penumbra.rmse_everywhere, penumbra.hard_rmse_everywhere)),
            (
                "… pixels in them, elsewhere",
                format!("{}, {}", penumbra.pixels, penumbra.pixels_elsewhere),
            ),
        ]);
    }
    if let Some(edge) = &r.shadow_edge_px {
        let share = |d: &EdgeDistance| format!("{:.1} %", 100.0 * d.scored_share);
        rows.extend([
            ("shadow edges to 15°, 99.9 %", px(edge.deg15.p999)),
            ("… scored", share(&edge.deg15)),
            ("shadow edges to 60°, 99.9 %", px(edge.deg60.p999)),
            ("… scored", share(&edge.deg60)),
            ("dark for no reason", format!("{} of {} pixels", edge.acne_pixels, edge.pixels)),
            ("lit for no reason", format!("{} of {} pixels", edge.leak_pixels, edge.pixels)),
        ]);
    }
    format!(
        "{} · {} · τ = {} px\n{}\n{}",
        r.file.display(),
        r.representation,
        r.tau_px,
        r.adapter,
        table(&rows)
    )
}

pub fn seams(r: &SeamReport) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header([
        "τ",
        "front",
        "nodes",
        "depths",
        "holes",
        "at seams",
        "overdraw",
        "pushed out",
        "views",
    ]);
    for row in &r.fronts {
        table.add_row([
            format!("{} px", row.tau_px),
            row.front.to_string(),
            format!("{:.0}", row.nodes_mean),
            format!("{:.1}", row.depths_mean),
            row.hole_pixels.to_string(),
            row.holes_at_seams.to_string(),
            row.overdraw_pixels.to_string(),
            row.pushed_out_pixels.to_string(),
            row.views_with_any.to_string(),
        ]);
    }
    for column in 2..9 {
        if let Some(values) = table.column_mut(column) {
            values.set_cell_alignment(CellAlignment::Right);
        }
    }
    const LISTED: usize = 10;
    let mut list = String::new();
    for hole in r.holes.iter().take(LISTED) {
        let [x, y] = hole.pixel;
        let place = if hole.at_seam { "between nodes" } else { "within a node" };
        let _ = write!(
            list,
            "\nhole: view {}, {} px, {}: pixel {x},{y} shows {}, {place}",
            hole.view, hole.tau_px, hole.front, hole.shows
        );
    }
    for place in r.outside.iter().take(LISTED) {
        let [x, y] = place.pixel;
        let (view, tau_px, front, kind) = (place.view, place.tau_px, place.front, place.kind);
        let _ = write!(list, "\n{kind}: view {view}, {tau_px} px, {front}: pixel {x},{y}");
    }
    if r.holes.len().max(r.outside.len()) > LISTED {
        list += "\n(more of them with --json)";
    }
    format!(
        "{} · {} · {} views · seed {}\n{}\n{}\n\
         at seams: holes near which several nodes are drawn, others are a node's own\n\
         pushed out: pixels that what closes seams covers alone, more than a pixel from the rest; views: with any of \
         these{list}",
        r.file.display(),
        r.representation,
        r.views,
        r.seed,
        r.adapter,
        table
    )
}
