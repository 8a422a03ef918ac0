//! What a window without a statue shows, and the dialogs about scans.

use std::path::{Path, PathBuf};

use egui::{Align2, Button, Color32, ComboBox, Grid, ProgressBar, RichText, TextEdit, Ui};
use hlod_compress::{SignedAxis, Unit};

use super::Entry;
use super::builder::Order;
use crate::source::is_address;

const WIDTH: f32 = 460.0;
const SMALL: f32 = 11.5;
const PROBLEM: Color32 = Color32::from_rgb(255, 180, 90);
const AXES: [&str; 6] = ["+x", "-x", "+y", "-y", "+z", "-z"];
const UNITS: [(Unit, &str); 6] = [
    (Unit::Unknown, "not known"),
    (Unit::Micrometre, "micrometres"),
    (Unit::Millimetre, "millimetres"),
    (Unit::Centimetre, "centimetres"),
    (Unit::Metre, "metres"),
    (Unit::Inch, "inches"),
];

/// What is asked for on the page.
#[derive(Debug, Default)]
pub struct Asked {
    /// The system's dialog.
    pub choose: bool,
    /// Forget one of the files opened before.
    pub forget: Option<PathBuf>,
}

/// The page before there is a statue. `adapter` is what draws, and whether that is no GPU.
pub fn start(ui: &mut Ui, entry: &mut Entry, recent: &[PathBuf], adapter: (&str, bool)) -> Asked {
    let mut asked = Asked::default();
    if ui.input_mut(|i| i.consume_key(egui::Modifiers::COMMAND, egui::Key::O)) {
        asked.choose = true;
    }
    egui::CentralPanel::default().show(ui, |ui| {
        egui::ScrollArea::vertical().show(ui, |ui| {
            let margin = ((ui.available_width() - WIDTH) / 2.0).max(8.0);
            let height = ui.available_height();
            ui.add_space((height * 0.14).min(120.0));
            ui.horizontal_top(|ui| {
                ui.add_space(margin);
                ui.vertical(|ui| {
                    ui.set_width(WIDTH.min(ui.available_width() - 8.0));
                    ui.heading("Open a statue");
                    ui.add_space(8.0);
                    names(ui, entry, &mut asked);
                    ui.add_space(4.0);
                    let text = "or drop an .hlod file here, or a scan to be built: PLY, OBJ, STL, glTF, LAS, \
                                E57, projects of MeshLab.";
                    ui.label(RichText::new(text).size(SMALL));
                    problem(ui, entry);
                    opened_before(ui, entry, recent, &mut asked);
                    ui.add_space(20.0);
                    ui.label(RichText::new(format!("drawn by {}", adapter.0)).size(SMALL));
                    if adapter.1 {
                        let text = "No GPU: drawn by the processor, which is slower.";
                        ui.label(RichText::new(text).size(SMALL).color(PROBLEM));
                    }
                });
            });
        });
    });
    asked
}

fn names(ui: &mut Ui, entry: &mut Entry, asked: &mut Asked) {
    ui.horizontal(|ui| {
        let waiting = entry.chooser.is_some();
        let open = ui.add_enabled(!waiting, Button::new("Choose a file…"));
        asked.choose |= open.on_hover_text("Ctrl+O").clicked();
        let field = TextEdit::singleline(&mut entry.typed)
            .hint_text("a file's path, or https://…")
            .desired_width(ui.available_width() - 70.0);
        let field = ui.add(field);
        let entered = field.lost_focus() && ui.input(|i| i.key_pressed(egui::Key::Enter));
        if ui.button("Open").clicked() || entered {
            let path = entry.typed.trim();
            if !path.is_empty() {
                let path = PathBuf::from(path);
                entry.take(path);
            }
        }
    });
}

fn problem(ui: &mut Ui, entry: &Entry) {
    if let Some(problem) = &entry.problem {
        ui.add_space(8.0);
        ui.add(egui::Label::new(RichText::new(problem).color(PROBLEM)).wrap());
    }
}

fn opened_before(ui: &mut Ui, entry: &mut Entry, recent: &[PathBuf], asked: &mut Asked) {
    if recent.is_empty() {
        return;
    }
    ui.add_space(18.0);
    ui.label(RichText::new("Opened before").strong());
    for path in recent {
        let is_there = is_address(path) || path.is_file();
        ui.horizontal(|ui| {
            if ui.small_button("×").on_hover_text("take it off this list").clicked() {
                asked.forget = Some(path.clone());
            }
            let button = ui.add_enabled(is_there, Button::new(name_of(path)).frame(false));
            if button.on_disabled_hover_text("not there now").clicked() {
                entry.take(path.clone());
            }
            let folder = path.parent().unwrap_or(Path::new("")).display().to_string();
            let folder = RichText::new(folder).size(SMALL).color(Color32::GRAY);
            ui.add(egui::Label::new(folder).truncate());
        });
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).display().to_string()
}

/// What is to be said of scans over whatever the window shows: an offer to build one, how far that is, what
/// came of it.
pub fn dialogs(ui: &Ui, entry: &mut Entry, has_statue: bool) {
    if entry.is_hovered {
        drop_hint(ui);
    }
    offer(ui, entry);
    progress(ui, entry);
    if !has_statue {
        return;
    }
    if let Some(file) = entry.built.clone() {
        dialog("Built").show(ui, |ui| {
            ui.label(format!("{} is ready.", name_of(&file)));
            ui.horizontal(|ui| {
                let opened = ui.button("Open it").clicked();
                if opened {
                    entry.wanted = Some(file);
                }
                if ui.button("Later").clicked() || opened {
                    entry.built = None;
                }
            });
        });
    }
    // The page has its own place for it.
    if let Some(text) = entry.problem.clone() {
        dialog("Please note").show(ui, |ui| {
            ui.set_max_width(WIDTH);
            ui.add(egui::Label::new(RichText::new(text).color(PROBLEM)).wrap());
            if ui.button("Close").clicked() {
                entry.problem = None;
            }
        });
    }
}

fn dialog(title: &str) -> egui::Window<'_> {
    egui::Window::new(title)
        .anchor(Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .collapsible(false)
        .resizable(false)
}

fn drop_hint(ui: &Ui) {
    let painter = ui
        .ctx()
        .layer_painter(egui::LayerId::new(egui::Order::Foreground, egui::Id::unique("drop")));
    let rect = ui.ctx().content_rect();
    painter.rect_filled(rect, 0.0, Color32::from_black_alpha(150));
    let font = egui::FontId::proportional(22.0);
    painter.text(rect.center(), Align2::CENTER_CENTER, "Drop to open", font, Color32::WHITE);
}

/// Offers to build a scan.
fn offer(ui: &Ui, entry: &mut Entry) {
    let Some(mut order) = entry.offered.take() else { return };
    let mut answer = None;
    dialog("Build this scan?").show(ui, |ui| {
        ui.set_max_width(WIDTH);
        ui.label(format!(
            "{} is a scan. It is read once and written as levels of detail to a file beside it; the scan \
             stays as it is.",
            name_of(&order.scan)
        ));
        ui.add_space(6.0);
        declare(ui, &mut order);
        ui.add_space(6.0);
        let problem = order.problem();
        if let Some(problem) = &problem {
            ui.label(RichText::new(problem).color(PROBLEM));
        }
        ui.horizontal(|ui| {
            let build = ui.add_enabled(problem.is_none(), Button::new("Build"));
            if build.clicked() {
                answer = Some(true);
            }
            if ui.button("Cancel").clicked() {
                answer = Some(false);
            }
            if order.output.exists() && ui.button("Open what is there").clicked() {
                entry.wanted = Some(order.output.clone());
                answer = Some(false);
            }
        });
    });
    match answer {
        None => entry.offered = Some(order),
        Some(true) => entry.start(order),
        Some(false) => {}
    }
}

/// What files of scans do not say.
fn declare(ui: &mut Ui, order: &mut Order) {
    Grid::new("order").num_columns(2).show(ui, |ui| {
        let writes = ui.label("writes");
        let mut output = order.output.display().to_string();
        let field = ui.add(TextEdit::singleline(&mut output).desired_width(340.0));
        if field.labelled_by(writes.id).changed() {
            order.output = output.into();
        }
        ui.end_row();
        let unit = ui.label("unit");
        let name = |unit: Unit| UNITS.iter().find(|(u, _)| *u == unit).map_or("", |(_, name)| name);
        let units = ComboBox::from_id_salt("unit").selected_text(name(order.unit));
        let units = units.show_ui(ui, |ui| {
            for (unit, name) in UNITS {
                ui.selectable_value(&mut order.unit, unit, name);
            }
        });
        units.response.labelled_by(unit.id);
        ui.end_row();
        axis(ui, "up", &mut order.up);
        axis(ui, "front", &mut order.front);
    });
}

fn axis(ui: &mut Ui, name: &str, axis: &mut SignedAxis) {
    ui.label(name);
    ui.horizontal(|ui| {
        for choice in AXES.iter().filter_map(|text| text.parse::<SignedAxis>().ok()) {
            ui.selectable_value(axis, choice, choice.to_string());
        }
    });
    ui.end_row();
}

/// How far a build is.
fn progress(ui: &Ui, entry: &mut Entry) {
    let Some(build) = &mut entry.build else { return };
    let at = egui::vec2(12.0, -12.0);
    let window = egui::Window::new(format!("Building {}", name_of(&build.order.scan)))
        .anchor(Align2::LEFT_BOTTOM, at)
        .collapsible(true)
        .resizable(false);
    window.show(ui, |ui| {
        ui.set_max_width(320.0);
        let reached = &build.reached;
        let share = reached.done as f32 / reached.total.max(1) as f32;
        let bar = ProgressBar::new(share.min(1.0)).desired_width(300.0);
        ui.add(bar.text(&reached.stage));
        let count = match reached.total {
            0 => String::new(),
            total => format!("{} of {total} {}", reached.done, reached.unit),
        };
        ui.label(RichText::new(count).size(SMALL));
        if let Some(remark) = build.remark() {
            ui.add(egui::Label::new(RichText::new(remark).size(SMALL)).wrap());
        }
        let text = if build.is_stopping() { "stopping…" } else { "Stop" };
        let stop = ui.add_enabled(!build.is_stopping(), Button::new(text));
        let hover = "nothing is written; built again with the same choices it goes on from here";
        if stop.on_hover_text(hover).clicked() {
            build.stop();
        }
    });
}
