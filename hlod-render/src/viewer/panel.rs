//! The panel beside the statue: settings, recording, statistics; the help and problems.

use egui::{Align2, Color32, FontId, Grid, RichText, Slider, Ui};

use super::bindings::{Action, HELP};
use super::compass;
use super::legend;
use super::light::{PRESETS, RAKING_DEG};
use super::mapping::Mapping;
use super::preferences::{Preferences, UI_SCALES};
use super::settings::Settings;
use super::work::{Work, desk, desk::Wishes, overlay::Overlay};
use crate::frame::FrameStats;
use crate::framing::NAMED_VIEWS;
use crate::lamp::Lamp;
use crate::scene::{Enhance, Material, Paint, Painted, Representation, Shadow};
use crate::session::LightFrame;

/// Width of the panel in points.
const WIDTH: f32 = 250.0;

/// Why τ is larger than was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Raised {
    /// To keep moving smoothly.
    Moving,
    /// What is in view does not fit into the GPU's memory otherwise.
    Memory,
}

/// What the panel shows and cannot change.
#[derive(Debug, Clone, Default)]
pub struct Readings {
    /// The adapter's name and kind.
    pub adapter: String,
    /// Whether the statue is a point cloud.
    pub is_cloud: bool,
    /// Numbers that the file keeps.
    pub scalars: Vec<Painted>,
    /// What colours of bounds stand for.
    pub bound: Painted,
    /// Whether that is no GPU.
    pub software: bool,
    /// What the last frame drew.
    pub stats: FrameStats,
    /// Time that it took.
    pub frame_ms: Option<f64>,
    /// During the last motion.
    pub frames_per_sec: Option<f64>,
    /// τ of the last frame in pixels.
    pub error_threshold_px: f64,
    /// Why that is more than was chosen.
    pub raised: Option<Raised>,
    /// Whether something is being read.
    pub loading: bool,
    /// Why nothing comes from the server at present.
    pub link_problem: Option<String>,
    /// Bytes of geometry on the GPU.
    pub resident_bytes: u64,
    /// Bytes read from the file.
    pub bytes_read: u64,
    /// From corner to corner of the statue's bounds.
    pub diagonal: f64,
    /// Whether planes cut the statue open.
    pub cut_open: bool,
    /// Whether rays are parallel.
    pub parallel: bool,
    /// The second statue's name, and where the line before it is: share of the picture's width.
    pub other: Option<(String, f64)>,
    /// What to do with the tool in hand.
    pub tool: Option<String>,
    /// Whether the scan's own geometry is being read for a tool.
    pub reading: bool,
    /// Whether keys fly.
    pub flying: bool,
    /// Seconds recorded so far.
    pub recording_secs: Option<f64>,
    /// Where the last path was written.
    pub recorded: Option<String>,
    /// The oldest problem, and how many there are.
    pub problem: Option<(String, usize)>,
}

/// Lays everything out round the statue's picture, and says where that belongs, in points.
pub fn show(
    ui: &mut Ui,
    settings: &mut Settings,
    preferences: &mut Preferences,
    readings: &Readings,
    overlay: &Overlay<'_>,
    wishes: &mut Wishes,
) -> egui::Rect {
    if settings.panel_open {
        egui::Panel::right("panel").exact_size(WIDTH).resizable(false).show(ui, |ui| {
            egui::ScrollArea::vertical().show(ui, |ui| {
                contents(ui, (settings, preferences), readings, overlay.work, wishes)
            });
        });
    }
    if let Some((problem, count)) = &readings.problem {
        egui::Panel::bottom("problems").resizable(false).show(ui, |ui| {
            ui.horizontal(|ui| {
                if ui.button("Dismiss").clicked() {
                    wishes.actions.push(Action::DismissProblem);
                }
                let more =
                    if *count > 1 { format!(" (and {} more)", count - 1) } else { String::new() };
                ui.add(
                    egui::Label::new(RichText::new(format!("{problem}{more}")).color(WARNING))
                        .wrap(),
                );
            });
        });
    }
    let rect = whole_pixels(ui.available_rect_before_wrap(), ui.pixels_per_point());
    if settings.marks_shown {
        overlay.draw(ui, rect, wishes);
    }
    if let Some((name, swipe)) = &readings.other {
        swipe_line(ui, rect, name, *swipe as f32);
    }
    status_line(ui, rect, readings);
    let curvature = Painted::curvature(settings.enhance.radius_px);
    legend::draw(ui, rect, settings.paint, &readings.scalars, [&readings.bound, &curvature]);
    let axes = overlay.work.framing().axes;
    compass::show(ui, rect, axes, &overlay.lens.camera, &mut wishes.actions);
    corner_buttons(ui, rect, settings, &mut wishes.actions);
    if settings.help_open {
        help(ui, preferences.mapping, &mut wishes.actions);
    }
    rect
}

const WARNING: Color32 = Color32::from_rgb(255, 180, 90);

/// The largest rectangle of whole pixels, so that a texel of the picture is a pixel.
fn whole_pixels(rect: egui::Rect, pixels_per_point: f32) -> egui::Rect {
    let round = |v: egui::Pos2| (v.to_vec2() * pixels_per_point).round() / pixels_per_point;
    egui::Rect::from_min_max(round(rect.min).to_pos2(), round(rect.max).to_pos2())
}

fn contents(
    ui: &mut Ui,
    (settings, preferences): (&mut Settings, &mut Preferences),
    readings: &Readings,
    work: &Work,
    wishes: &mut Wishes,
) {
    ui.spacing_mut().slider_width = 100.0;
    desk::steps(ui, work, wishes);
    super::about::show(ui, work.metadata());
    section(ui, "View", |ui| views(ui, readings, &mut wishes.actions));
    section(ui, "Saved views", |ui| desk::views(ui, work, wishes));
    section(ui, "How it stands", |ui| desk::standing(ui, work, wishes));
    section(ui, "Precision", |ui| precision(ui, settings, readings));
    section(ui, "Light", |ui| light(ui, settings, readings, wishes));
    section(ui, "Looks", |ui| looks(ui, settings, readings));
    section(ui, "Measure", |ui| desk::measurements(ui, work, wishes));
    section(ui, "Sections", |ui| desk::sections(ui, work, wishes));
    section(ui, "Notes", |ui| desk::notes(ui, work, wishes));
    section(ui, "Camera path", |ui| recording(ui, readings, &mut wishes.actions));
    section(ui, "Window", |ui| window(ui, preferences, &mut wishes.actions));
    section(ui, "Statistics", |ui| statistics(ui, readings));
}

fn section(ui: &mut Ui, title: &str, add: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(RichText::new(title).strong()).default_open(true).show(ui, add);
}

fn views(ui: &mut Ui, readings: &Readings, actions: &mut Vec<Action>) {
    ui.horizontal_wrapped(|ui| {
        if ui.button("Fit").on_hover_text("the whole statue, from the same side (F)").clicked() {
            actions.push(Action::Fit);
        }
        for (number, (name, _)) in NAMED_VIEWS.iter().enumerate() {
            if ui.button(*name).clicked() {
                actions.push(Action::NamedView(number));
            }
        }
    });
    ui.horizontal(|ui| {
        let (mut parallel, mut flying) = (readings.parallel, readings.flying);
        if ui.checkbox(&mut parallel, "parallel rays").clicked() {
            actions.push(Action::ToggleParallel);
        }
        if ui.checkbox(&mut flying, "fly").clicked() {
            actions.push(Action::ToggleFlying);
        }
    });
}

fn precision(ui: &mut Ui, settings: &mut Settings, readings: &Readings) {
    let tau = Slider::new(&mut settings.error_threshold_px, 0.1..=8.0)
        .logarithmic(true)
        // What the command line asked for stays.
        .clamping(egui::SliderClamping::Edits);
    let full = settings.representation == Representation::Full;
    ui.add_enabled(!full, tau.max_decimals(2).suffix(" px").text("τ"))
        .on_hover_text("the largest error on the screen: smaller is finer and slower");
    let target = Slider::new(&mut settings.frame_target_ms, 10.0..=500.0)
        .logarithmic(true)
        .clamping(egui::SliderClamping::Edits);
    ui.add_enabled(!full, target.max_decimals(0).suffix(" ms").text("moving"))
        .on_hover_text("what a frame may take while moving: τ is raised to keep to it");
    ui.horizontal_wrapped(|ui| {
        use Representation::{Full, Geometric, Hybrid};
        for representation in [Hybrid, Geometric, Full] {
            // Points have one hierarchy.
            if representation == Geometric && readings.is_cloud {
                continue;
            }
            ui.selectable_value(
                &mut settings.representation,
                representation,
                representation.name(),
            );
        }
    });
    if full {
        ui.label(RichText::new("The scan's own geometry, however far: slow.").size(11.5));
    }
}

fn light(ui: &mut Ui, settings: &mut Settings, readings: &Readings, wishes: &mut Wishes) {
    let light = &mut settings.light;
    let angles = &mut light.angles;
    let turned = ui.add(angle(&mut angles.azimuth_deg, 180.0).text("azimuth")).changed()
        | ui.add(angle(&mut angles.elevation_deg, 90.0).text("elevation")).changed();
    ui.horizontal(|ui| {
        ui.label("relative to the");
        for (frame, name) in [(LightFrame::Picture, "picture"), (LightFrame::Object, "statue")] {
            if ui.selectable_label(light.frame == frame, name).clicked() {
                wishes.light_frame = Some(frame);
            }
        }
    });
    ui.horizontal_wrapped(|ui| {
        for (number, (name, preset)) in PRESETS.iter().enumerate() {
            let of_preset = Lamp::of_picture(*preset);
            let is_it = (light.angles, light.frame) == (of_preset.angles, of_preset.frame);
            if ui.selectable_label(is_it, *name).clicked() {
                wishes.actions.push(Action::LightPreset(number));
            }
        }
    });
    if turned {
        settings.raking = None;
    }
    raking(ui, settings, wishes);
    lamp(ui, &mut settings.light, readings.diagonal);
    ui.horizontal(|ui| {
        ui.label("shadows");
        for shadow in [Shadow::None, Shadow::Hard, Shadow::Soft] {
            ui.selectable_value(&mut settings.shadow, shadow, shadow.name())
                .on_hover_text("of the statue on itself (H)");
        }
    });
    if readings.cut_open && settings.shadow != Shadow::None {
        ui.label(RichText::new("none while the statue is cut open").size(11.5));
    }
    let is_soft = settings.shadow == Shadow::Soft;
    let size = Slider::new(&mut settings.light_size_deg, 0.0..=20.0).suffix("°").max_decimals(1);
    ui.add_enabled(is_soft, size.text("wide"))
        .on_hover_text("the angle under which the light is seen; 0 casts hard shadows");
}

/// Whether the light is parallel, a lamp, or a lamp that shines within a cone.
fn lamp(ui: &mut Ui, light: &mut Lamp, diagonal: f64) {
    let kinds = [("parallel", false, false), ("lamp", true, false), ("spot", true, true)];
    let now = (light.distance.is_some(), light.distance.and(light.spot_deg).is_some());
    ui.horizontal(|ui| {
        for (name, is_lamp, is_spot) in kinds {
            if ui.selectable_label(now == (is_lamp, is_spot), name).clicked() {
                // As far as the statue is large, until someone says better.
                light.distance = is_lamp.then(|| light.distance.unwrap_or(diagonal));
                light.spot_deg = is_spot.then(|| light.spot_deg.unwrap_or(30.0));
            }
        }
    });
    if let Some(distance) = &mut light.distance {
        let far = Slider::new(distance, 0.01 * diagonal..=10.0 * diagonal).logarithmic(true);
        ui.add(far.clamping(egui::SliderClamping::Edits).max_decimals(3).text("away"))
            .on_hover_text(
                "from the middle of the picture, or of the statue where it is relative to that",
            );
        if let Some(spot_deg) = &mut light.spot_deg {
            ui.add(Slider::new(spot_deg, 1.0..=180.0).suffix("°").max_decimals(0).text("cone"))
                .on_hover_text("how wide it shines; it is aimed at that middle");
        }
    }
}

/// Light that rakes one place of the surface.
fn raking(ui: &mut Ui, settings: &mut Settings, wishes: &mut Wishes) {
    let Some(raking) = &mut settings.raking else {
        let hover = "from the side over the surface in the middle; I: under the cursor";
        if ui.button("Rake the surface").on_hover_text(hover).clicked() {
            wishes.actions.push(Action::Rake);
        }
        return;
    };
    let over = Slider::new(&mut raking.elevation_deg, RAKING_DEG)
        .suffix("°")
        .max_decimals(0)
        .clamping(egui::SliderClamping::Edits);
    wishes.raking_changed |= ui.add(over.text("over the surface")).changed();
    let round = Slider::new(&mut raking.azimuth_deg, 0.0..=360.0)
        .suffix("°")
        .max_decimals(0)
        .clamping(egui::SliderClamping::Edits);
    wishes.raking_changed |= ui
        .add(round.text("round it"))
        .on_hover_text("comma and full stop turn it by 10°")
        .changed();
}

fn angle(value: &mut f64, most: f64) -> Slider<'_> {
    // Values between whole degrees stay until someone moves them.
    Slider::new(value, -most..=most)
        .suffix("°")
        .max_decimals(0)
        .step_by(1.0)
        .clamping(egui::SliderClamping::Edits)
}

/// What a paint shows, in a few words.
fn explained(paint: Paint) -> &'static str {
    match paint {
        Paint::Shaded => "the surface in its light",
        Paint::Depth => "a colour for each level of detail",
        Paint::Borders => "where nodes of the octree end, and what closes the seams between them",
        Paint::Normals => "directions: red, green and blue for x, y and z",
        Paint::Bound => "how far what is drawn may be from the scan, as proven",
        Paint::Kinds => "the scan itself grey, coarser triangles blue, points orange",
        Paint::Edges => "every triangle's edges; with --tau 0 or near by those of the scan",
        Paint::Curvature => "how the surface bends: hollows blue, bulges orange",
        Paint::Scalar(_) => "a number that was kept with the scan",
    }
}

fn looks(ui: &mut Ui, settings: &mut Settings, readings: &Readings) {
    ui.horizontal_wrapped(|ui| {
        for paint in Paint::ALL {
            ui.selectable_value(&mut settings.paint, paint, paint.name())
                .on_hover_text(explained(paint));
        }
    });
    legend::choose(ui, &mut settings.paint, &readings.scalars);
    let is_shaded = settings.paint == Paint::Shaded;
    let bends = is_shaded || settings.paint == Paint::Curvature;
    let Enhance { strength, radius_px } = &mut settings.enhance;
    let enhance = Slider::new(strength, 0.0..=1.0).max_decimals(2).text("relief");
    ui.add_enabled(is_shaded, enhance)
        .on_hover_text("bulges brighter and hollows darker, so that worn inscriptions can be read");
    let radius = Slider::new(radius_px, 1.0..=Enhance::RADIUS_MAX_PX)
        .logarithmic(true)
        .max_decimals(1)
        .suffix(" px")
        .clamping(egui::SliderClamping::Edits);
    ui.add_enabled(bends && (!is_shaded || *strength > 0.0), radius.text("wide"))
        .on_hover_text("relief is looked for within so many pixels: half a stroke's width");
    let Material { ambient, highlight, .. } = &mut settings.material;
    ui.add(Slider::new(ambient, 0.0..=0.6).max_decimals(2).text("ambient"));
    ui.add(Slider::new(highlight, 0.0..=0.5).max_decimals(2).text("highlight"));
    ui.horizontal(|ui| {
        ui.color_edit_button_rgb(&mut settings.background);
        ui.label("background");
        ui.checkbox(&mut settings.marks_shown, "marks")
            .on_hover_text("what was measured, cut and noted, over the picture");
    });
}

/// What goes for every statue.
fn window(ui: &mut Ui, preferences: &mut Preferences, actions: &mut Vec<Action>) {
    if ui.button("Open…").on_hover_text("another statue, or a scan to be built (Ctrl+O)").clicked()
    {
        actions.push(Action::Open);
    }
    ui.label("the mouse as in");
    ui.horizontal_wrapped(|ui| {
        for mapping in Mapping::ALL {
            let lines: Vec<String> =
                mapping.help().iter().map(|(keys, does)| format!("{keys}: {does}")).collect();
            ui.selectable_value(&mut preferences.mapping, mapping, mapping.name())
                .on_hover_text(lines.join("\n"));
        }
    });
    ui.horizontal(|ui| {
        ui.label("letters");
        // Not a slider: it would move away under the cursor.
        for (text, factor) in [("smaller", 1.0 / 1.1), ("larger", 1.1)] {
            if ui.button(text).clicked() {
                let scale = preferences.ui_scale * factor;
                preferences.ui_scale = scale.clamp(*UI_SCALES.start(), *UI_SCALES.end());
            }
        }
        ui.label(format!("{:.0} %", preferences.ui_scale * 100.0));
    });
}

fn recording(ui: &mut Ui, readings: &Readings, actions: &mut Vec<Action>) {
    let label = match readings.recording_secs {
        Some(secs) => format!("Stop and save ({secs:.0} s)"),
        None => "Record".to_owned(),
    };
    if ui.button(label).on_hover_text("for hlod-render bench --path (R)").clicked() {
        actions.push(Action::ToggleRecording);
    }
    if let Some(recorded) = &readings.recorded {
        ui.label(RichText::new(recorded).size(11.5));
    }
}

fn statistics(ui: &mut Ui, readings: &Readings) {
    let stats = &readings.stats;
    let number = |value: Option<f64>| value.map_or("–".to_owned(), |v| format!("{v:.1}"));
    let megabytes = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
    let raised = match readings.raised {
        Some(Raised::Moving) => " (moving)",
        Some(Raised::Memory) => " (no more memory)",
        None => "",
    };
    let missing = match (stats.missing_parts, readings.loading) {
        (0, false) => "none".to_owned(),
        (0, true) => "loading…".to_owned(),
        (parts, true) => format!("{parts}, loading…"),
        (parts, false) => parts.to_string(),
    };
    let rows = [
        ("frames/s", number(readings.frames_per_sec)),
        ("frame", format!("{} ms", number(readings.frame_ms))),
        ("τ on screen", format!("{:.2} px{raised}", readings.error_threshold_px)),
        ("triangles", grouped(stats.triangles)),
        ("points", grouped(stats.points)),
        ("nodes", grouped(stats.nodes as u64)),
        ("missing parts", missing),
        ("on the GPU", megabytes(readings.resident_bytes)),
        ("read", megabytes(readings.bytes_read)),
    ];
    Grid::new("statistics").num_columns(2).show(ui, |ui| {
        for (name, value) in rows {
            ui.label(name);
            ui.label(RichText::new(value).monospace());
            ui.end_row();
        }
    });
    ui.label(RichText::new(&readings.adapter).size(11.5));
    if readings.software {
        let remark = "No GPU: drawn by the processor, which is slower.";
        ui.label(RichText::new(remark).size(11.5).color(WARNING));
    }
}

/// Digits in groups of three.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{2009}');
        }
        out.push(digit);
    }
    out
}

/// A line over the picture's lower left corner, for what is going on now.
fn status_line(ui: &Ui, rect: egui::Rect, readings: &Readings) {
    let mut parts = Vec::new();
    if let Some(secs) = readings.recording_secs {
        parts.push(format!("recording {secs:.0} s (R saves)"));
    }
    parts.extend(readings.tool.clone());
    if readings.reading {
        parts.push("reading the scan…".to_owned());
    }
    if readings.flying {
        parts.push("flying (V ends)".to_owned());
    }
    if let Some(problem) = &readings.link_problem {
        parts.push(format!("{problem}; trying again…"));
    } else if readings.loading {
        parts.push("loading…".to_owned());
    }
    if parts.is_empty() {
        return;
    }
    let font = FontId::proportional(13.0);
    let text = ui.painter().layout_no_wrap(parts.join("   "), font, Color32::LIGHT_GRAY);
    let at = rect.left_bottom() + egui::vec2(8.0, -6.0 - text.size().y);
    // Statues are light.
    let behind = egui::Rect::from_min_size(at, text.size()).expand(3.0);
    ui.painter().rect_filled(behind, 2.0, Color32::from_black_alpha(170));
    ui.painter().galley(at, text, Color32::LIGHT_GRAY);
}

/// The line between two statues, and which is on its right.
fn swipe_line(ui: &Ui, rect: egui::Rect, name: &str, swipe: f32) {
    let x = rect.left() + swipe * rect.width();
    for (width, colour) in [(3.0, Color32::BLACK), (1.0, Color32::WHITE)] {
        ui.painter().vline(x, rect.y_range(), egui::Stroke::new(width, colour));
    }
    let font = FontId::proportional(13.0);
    let text = ui.painter().layout_no_wrap(format!("{name} »"), font, Color32::LIGHT_GRAY);
    let at = egui::pos2(x + 8.0, rect.top() + 8.0);
    let behind = egui::Rect::from_min_size(at, text.size()).expand(3.0);
    ui.painter().rect_filled(behind, 2.0, Color32::from_black_alpha(170));
    ui.painter().galley(at, text, Color32::LIGHT_GRAY);
}

fn corner_buttons(ui: &Ui, rect: egui::Rect, settings: &Settings, actions: &mut Vec<Action>) {
    let at = rect.right_top() + egui::vec2(-6.0, 6.0);
    egui::Area::new(egui::Id::unique("corner")).pivot(Align2::RIGHT_TOP).fixed_pos(at).show(
        ui,
        |ui| {
            ui.horizontal(|ui| {
                if ui.small_button("?").on_hover_text("help (F1)").clicked() {
                    actions.push(Action::ToggleHelp);
                }
                let arrow = if settings.panel_open { "»" } else { "«" };
                if ui.small_button(arrow).on_hover_text("panel (N)").clicked() {
                    actions.push(Action::TogglePanel);
                }
            });
        },
    );
}

fn help(ui: &Ui, mapping: Mapping, actions: &mut Vec<Action>) {
    let mut open = true;
    egui::Window::new("Help")
        .anchor(Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .collapsible(false)
        .resizable(false)
        .open(&mut open)
        .show(ui, |ui| {
            Grid::new("help").num_columns(2).striped(true).show(ui, |ui| {
                for (keys, does) in mapping.help().iter().chain(&HELP) {
                    ui.label(RichText::new(*keys).strong());
                    ui.label(*does);
                    ui.end_row();
                }
            });
        });
    if !open {
        actions.push(Action::ToggleHelp);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped_by_three() {
        assert_eq!(grouped(7), "7");
        assert_eq!(grouped(1234567), "1\u{2009}234\u{2009}567");
    }

    #[test]
    fn the_picture_lies_on_whole_pixels() {
        let rect = egui::Rect::from_min_max(egui::pos2(0.3, 0.0), egui::pos2(333.4, 200.2));
        let whole = whole_pixels(rect, 1.5);
        for v in [whole.min.x, whole.max.x, whole.max.y] {
            assert!((v * 1.5 - (v * 1.5).round()).abs() < 1e-3, "{v}");
        }
    }
}

#[cfg(test)]
mod by_name;
