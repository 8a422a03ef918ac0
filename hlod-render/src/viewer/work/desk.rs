//! The panel's part for the work on the statue: views, tools, results, sections, notes.

use std::sync::Arc;

use egui::{Button, DragValue, RichText, Slider, TextEdit, Ui};
use glam::DVec3;

use super::overlay::caption;
use super::tool::Task;
use super::{Change, Work};
use crate::clip::PLANE_COLOURS;
use crate::section::{Measures, Plane};
use crate::session::{LightFrame, Note, ObjectFrame, SECTIONS_MAX, ScannerUncertainty, Session};
use crate::viewer::bindings::Action;

/// Height of a list before it scrolls, in points.
const LIST_HEIGHT: f32 = 150.0;
const SMALL: f32 = 11.5;

/// What the panel asks for.
#[derive(Default)]
pub struct Wishes {
    /// Keys could have asked for it, too.
    pub actions: Vec<Action>,
    /// Steps that change the session.
    pub changes: Vec<Change>,
    /// Goes to this view.
    pub go_to: Option<usize>,
    /// Adds this plane.
    pub section: Option<Plane>,
    /// The light's angles are to be relative to this, without moving it.
    pub light_frame: Option<LightFrame>,
    /// A raking light is to be elsewhere.
    pub raking_changed: bool,
    /// Writes drawings of the sections.
    pub draw_sections: bool,
}

impl Wishes {
    /// Whether anything is asked for.
    pub fn any(&self) -> bool {
        !(self.actions.is_empty() && self.changes.is_empty())
            || self.go_to.is_some()
            || self.section.is_some()
            || self.draw_sections
            || self.light_frame.is_some()
            || self.raking_changed
    }

    fn change(&mut self, what: &'static str, edit: impl FnOnce(&mut Session) + 'static) {
        self.changes.push(Change { what, gradual: false, edit: Box::new(edit) });
    }

    /// A step that is part of one motion, as a slider's.
    pub fn adjust(&mut self, what: &'static str, edit: impl FnOnce(&mut Session) + 'static) {
        self.changes.push(Change { what, gradual: true, edit: Box::new(edit) });
    }
}

/// Undo, redo, and where the session is kept.
pub fn steps(ui: &mut Ui, work: &Work, wishes: &mut Wishes) {
    ui.horizontal(|ui| {
        let steps = [
            ("Undo", work.history.undoable(), Action::Undo),
            ("Redo", work.history.redoable(), Action::Redo),
        ];
        for (name, what, action) in steps {
            let button = ui.add_enabled(what.is_some(), Button::new(name));
            let hover = what.unwrap_or("nothing");
            if button.on_hover_text(format!("{} {hover}", name.to_lowercase())).clicked() {
                wishes.actions.push(action);
            }
        }
    });
    ui.label(RichText::new(work.size_text()).size(SMALL));
    let (text, hover) = match work.session_path() {
        Some(path) => {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            (format!("kept in {name}"), path.display().to_string())
        }
        None => ("not kept anywhere".to_owned(), String::new()),
    };
    ui.label(RichText::new(text).size(SMALL)).on_hover_text(hover);
}

/// Bookmarks.
pub fn views(ui: &mut Ui, work: &Work, wishes: &mut Wishes) {
    if ui.button("Save this view").on_hover_text("camera, light and looks (B)").clicked() {
        wishes.actions.push(Action::SaveView);
    }
    let views = work.session().views.clone();
    rows(ui, "views", views.len(), |ui, i| {
        if ui.button("Go").clicked() {
            wishes.go_to = Some(i);
        }
        let mut name = views[i].name.clone();
        if ui.add(TextEdit::singleline(&mut name).desired_width(130.0)).changed()
            && !views.iter().any(|view| view.name == name)
        {
            wishes.adjust("view's name", move |s| Arc::make_mut(&mut s.views)[i].name = name);
        }
        if remove(ui) {
            wishes.change("remove view", move |s| drop(Arc::make_mut(&mut s.views).remove(i)));
        }
    });
}

/// Tools and what they found.
pub fn measurements(ui: &mut Ui, work: &Work, wishes: &mut Wishes) {
    tools(ui, work, wishes, |task| matches!(task, Task::Measure(_)));
    let measurements = work.session().measurements.clone();
    rows(ui, "measurements", measurements.len(), |ui, i| {
        if remove(ui) {
            wishes.change("remove measurement", move |s| {
                drop(Arc::make_mut(&mut s.measurements).remove(i));
            });
        }
        let measurement = &measurements[i];
        let text = RichText::new(caption(measurement, work)).monospace().size(SMALL);
        let mut hover = format!("{}\n{}", measurement.name, caption(measurement, work));
        if let Some(delta) = measurement.result.and_then(|r| r.delta) {
            let [x, y, z] = work.session().shown_frame().map_or(delta, |f| f.vector(delta));
            hover += &format!("\nΔ {x:.4}, {y:.4}, {z:.4}{}", work.frame_name());
        }
        if let Some(pixel) =
            measurement.points.iter().filter_map(|p| p.pixel_length).reduce(f64::max)
        {
            hover += &format!("\na pixel was {pixel:.4} {} when it was clicked", work.unit);
        }
        ui.add(egui::Label::new(text).truncate()).on_hover_text(hover);
    });
    let scanner = match &work.scanner() {
        Some(u) => format!("scanner: U = {} (k = {}), {}", u.expanded, u.k, u.source),
        None => "scanner's uncertainty: not declared".to_owned(),
    };
    let hover = "± is how far the scan file itself may be; the scanner's own is never added";
    let title = RichText::new(scanner).size(SMALL);
    let open = egui::CollapsingHeader::new(title).id_salt("scanner").default_open(false);
    open.show(ui, |ui| declared(ui, work, wishes)).header_response.on_hover_text(hover);
}

/// How the statue stands, and how long its lengths are.
pub fn standing(ui: &mut Ui, work: &Work, wishes: &mut Wishes) {
    let frame = work.session().frame.as_ref();
    let made = frame.map_or_else(|| work.file_axes(), |frame| frame.made.clone());
    ui.label(RichText::new(made).size(SMALL));
    tools(ui, work, wishes, |task| matches!(task, Task::Stand(_)));
    let [_, up, front] = work.framing().axes;
    for (name, now, is_up) in [("up", up, true), ("front", front, false)] {
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 3.0;
            ui.label(name);
            for (axis_name, axis) in AXES {
                let is_it = now.dot(axis) > 1.0 - 1e-9;
                let button = ui.selectable_label(is_it, axis_name);
                let hover = format!(
                    "the scan's {axis_name} axis points {}",
                    if is_up { "up" } else { "to the front" }
                );
                if button.on_hover_text(hover).clicked() {
                    let wanted = match is_up {
                        true => ObjectFrame::of_axes(axis, clear_of(axis, [front, up])),
                        false => ObjectFrame::of_axes(clear_of(axis, [up, front]), axis),
                    };
                    if let Ok(frame) = wanted {
                        wishes.change("statue's axes", move |s| s.frame = Some(frame));
                    }
                }
            }
        });
    }
    if let Some(frame) = frame {
        ui.horizontal_wrapped(|ui| {
            let mut shown = frame.shown;
            let hover =
                "from the origin of these axes: x right, y up, z front; files keep the scan's";
            if ui.checkbox(&mut shown, "its own coordinates").on_hover_text(hover).changed() {
                wishes.change("coordinates", move |s| {
                    if let Some(frame) = &mut s.frame {
                        frame.shown = shown;
                    }
                });
            }
            if ui.small_button("as the file says").clicked() {
                wishes.change("statue's axes", |s| s.frame = None);
            }
        });
    }
    scale(ui, work, wishes);
}

/// The scan's axes, both ways.
const AXES: [(&str, DVec3); 6] = [
    ("x", DVec3::X),
    ("−x", DVec3::NEG_X),
    ("y", DVec3::Y),
    ("−y", DVec3::NEG_Y),
    ("z", DVec3::Z),
    ("−z", DVec3::NEG_Z),
];

/// The first direction that is not along an axis.
fn clear_of(axis: DVec3, wanted: [DVec3; 2]) -> DVec3 {
    let clear = wanted.into_iter().find(|d| d.dot(axis).abs() < 0.9);
    clear.unwrap_or_else(|| axis.any_orthonormal_vector())
}

/// A length that is known, and what follows from it.
fn scale(ui: &mut Ui, work: &Work, wishes: &mut Wishes) {
    tools(ui, work, wishes, |task| task == Task::Scale);
    let Some(before) = &work.session().scale else { return };
    let mut scale = before.clone();
    ui.horizontal_wrapped(|ui| {
        let name = ui.label(RichText::new("known").size(SMALL));
        let speed = scale.known_length / 1000.0;
        ui.add(
            DragValue::new(&mut scale.known_length).speed(speed).range(1e-6..=1e9).max_decimals(4),
        )
        .labelled_by(name.id)
        .on_hover_text(format!(
            "the scan has {:.4} {}",
            scale.measured_length(),
            work.unit
        ));
        egui::ComboBox::from_id_salt("unit of the known length")
            .selected_text(scale.unit.clone())
            .width(40.0)
            .show_ui(ui, |ui| {
                for unit in ["um", "mm", "cm", "m", "in"] {
                    ui.selectable_value(&mut scale.unit, unit.to_owned(), unit);
                }
            })
            .response
            .labelled_by(name.id);
        ui.label(RichText::new(format!("× {:.6}", scale.factor())).size(SMALL))
            .on_hover_text("what lengths of the scan are multiplied by: results show both");
        if remove(ui) {
            wishes.change("take known length back", |s| s.scale = None);
        }
    });
    let field = TextEdit::singleline(&mut scale.source);
    ui.add(field.hint_text("who measured it, and how").desired_width(190.0));
    if scale != *before {
        wishes.adjust("known length", move |s| {
            // Taken back in the same frame it stays so.
            if s.scale.is_some() {
                s.scale = Some(scale);
            }
        });
    }
}

/// Declares the scanner's uncertainty, or takes that back.
fn declared(ui: &mut Ui, work: &Work, wishes: &mut Wishes) {
    let before = work.session().scanner.clone();
    let Some(mut scanner) = before.clone() else {
        if ui.button("Declare it").clicked() {
            let usual = ScannerUncertainty { expanded: 0.05, k: 2.0, source: String::new() };
            // Where the file says it, that is what is changed.
            let scanner = work.scanner().unwrap_or(usual);
            wishes.change("declare uncertainty", move |s| s.scanner = Some(scanner));
        }
        return;
    };
    ui.horizontal(|ui| {
        ui.label("U");
        ui.add(DragValue::new(&mut scanner.expanded).speed(0.001).range(0.0..=1e6).max_decimals(6));
        ui.label(format!("{}, k", work.unit));
        ui.add(DragValue::new(&mut scanner.k).speed(0.01).range(0.1..=10.0));
        if remove(ui) {
            wishes.change("take uncertainty back", |s| s.scanner = None);
        }
    });
    let field = TextEdit::singleline(&mut scanner.source);
    ui.add(field.hint_text("who says so").desired_width(190.0));
    if before.as_ref() != Some(&scanner) {
        wishes.adjust("uncertainty", move |s| s.scanner = Some(scanner));
    }
}

/// Planes that cut the statue.
pub fn sections(ui: &mut Ui, work: &Work, wishes: &mut Wishes) {
    let sections = work.session().sections.clone();
    let (low, high) = work.bounds;
    ui.horizontal_wrapped(|ui| {
        ui.label("across");
        for (name, axis) in [("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z)] {
            let room = sections.len() < SECTIONS_MAX;
            if ui.add_enabled(room, Button::new(name)).clicked() {
                let offset = axis.dot((low + high) / 2.0);
                wishes.section = Some(Plane { normal: axis, offset });
            }
        }
    });
    tools(ui, work, wishes, |task| task == Task::Section);
    for (i, section) in sections.iter().enumerate() {
        let [r, g, b] = PLANE_COLOURS[i.min(SECTIONS_MAX - 1)];
        let name = ui.horizontal_wrapped(|ui| {
            let mut shown = section.shown;
            let name = RichText::new(&section.name).color(egui::Color32::from_rgb(r, g, b));
            let name = ui.checkbox(&mut shown, name).on_hover_text("show its outline");
            if name.changed() {
                wishes.change("show section", move |s| {
                    Arc::make_mut(&mut s.sections)[i].shown = shown
                });
            }
            let mut opens = section.opens;
            let hover = "without what is on the other side";
            if ui.checkbox(&mut opens, "cut open").on_hover_text(hover).changed() {
                wishes.change("cut open", move |s| Arc::make_mut(&mut s.sections)[i].opens = opens);
            }
            if ui.small_button("turn").on_hover_text("the plane's sides change places").clicked() {
                wishes.change("turn section", move |s| {
                    let section = &mut Arc::make_mut(&mut s.sections)[i];
                    section.normal = section.normal.map(|n| -n);
                    section.offset = -section.offset;
                });
            }
            if remove(ui) {
                wishes.change("remove section", move |s| {
                    drop(Arc::make_mut(&mut s.sections).remove(i))
                });
            }
            name.id
        });
        let name = name.inner;
        let normal = DVec3::from_array(section.normal);
        let reach = (high - low).dot(normal.abs()) / 2.0;
        let middle = normal.dot((low + high) / 2.0);
        let mut offset = section.offset;
        ui.horizontal_wrapped(|ui| {
            let slider =
                Slider::new(&mut offset, middle - reach..=middle + reach).show_value(false);
            let slid = ui.add(slider).labelled_by(name).changed();
            let typed = DragValue::new(&mut offset).speed(reach / 500.0).max_decimals(3);
            if slid | ui.add(typed).labelled_by(name).changed() {
                wishes.adjust("move section", move |s| {
                    Arc::make_mut(&mut s.sections)[i].offset = offset
                });
            }
            ui.label(&work.unit);
        });
        let text = match work.outlines.get(i).and_then(Option::as_ref).map(|o| o.section.as_ref()) {
            Some(Some((_, measures))) => outline_text(measures, &work.unit),
            Some(None) => "cutting…".to_owned(),
            None => String::new(),
        };
        ui.label(RichText::new(text).size(SMALL));
    }
    if !sections.is_empty()
        && ui
            .button("Save drawings 1:1")
            .on_hover_text("SVG in mm, DXF, beside the session")
            .clicked()
    {
        wishes.draw_sections = true;
    }
    if let Some(saved) = &work.saved {
        ui.label(RichText::new(saved).size(SMALL));
    }
}

fn outline_text(measures: &Measures, unit: &str) -> String {
    if measures.bounds.is_none() {
        return "the plane meets nothing".into();
    }
    let Measures { closed, open, length, area, .. } = measures;
    let lines =
        if *open > 0 { format!("{closed} closed, {open} open") } else { format!("{closed}") };
    let part = if measures.area_is_whole { "" } else { " of closed lines" };
    format!("lines: {lines}\nlength {length:.3} {unit}\narea{part} {area:.3} {unit}²")
}

/// What was written about places.
pub fn notes(ui: &mut Ui, work: &Work, wishes: &mut Wishes) {
    tools(ui, work, wishes, |task| matches!(task, Task::Note(_)));
    let notes = work.session().notes.clone();
    rows(ui, "notes", notes.len(), |ui, i| {
        ui.vertical(|ui| note(ui, &notes[i], i, &work.unit, wishes));
    });
}

fn note(ui: &mut Ui, note: &Note, i: usize, unit: &str, wishes: &mut Wishes) {
    ui.horizontal(|ui| {
        let mut colour = note.colour_rgb().unwrap_or([255; 3]);
        if ui.color_edit_button_srgb(&mut colour).changed() {
            let [r, g, b] = colour;
            let colour = format!("#{r:02x}{g:02x}{b:02x}");
            wishes.adjust("note's colour", move |s| Arc::make_mut(&mut s.notes)[i].colour = colour);
        }
        let mut title = note.title.clone();
        let field = TextEdit::singleline(&mut title).hint_text("title").desired_width(120.0);
        if ui.add(field).changed() {
            wishes.adjust("note's title", move |s| Arc::make_mut(&mut s.notes)[i].title = title);
        }
        if remove(ui) {
            wishes.change("remove note", move |s| drop(Arc::make_mut(&mut s.notes).remove(i)));
        }
    });
    if let Some(area) = note.area {
        ui.label(RichText::new(format!("{area:.3} {unit}² along the surface")).size(SMALL));
    }
    let mut category = note.category.clone();
    let field = TextEdit::singleline(&mut category).hint_text("category").desired_width(190.0);
    if ui.add(field).changed() {
        wishes
            .adjust("note's category", move |s| Arc::make_mut(&mut s.notes)[i].category = category);
    }
    let mut text = note.text.clone();
    let field =
        TextEdit::multiline(&mut text).hint_text("text").desired_rows(2).desired_width(190.0);
    if ui.add(field).changed() {
        wishes.adjust("note's text", move |s| Arc::make_mut(&mut s.notes)[i].text = text);
    }
}

fn tools(ui: &mut Ui, work: &Work, wishes: &mut Wishes, wanted: impl Fn(Task) -> bool) {
    let in_hand = work.tool.as_ref().map(|tool| tool.task);
    ui.horizontal_wrapped(|ui| {
        for task in Task::ALL.into_iter().filter(|task| wanted(*task)) {
            let label = ui.selectable_label(in_hand == Some(task), task.name());
            let label = match task.explained() {
                "" => label,
                words => label.on_hover_text(words),
            };
            if label.clicked() {
                wishes.actions.push(Action::Tool(task));
            }
        }
    });
}

/// A list that scrolls when it is long. Only rows that are seen are laid out.
fn rows(ui: &mut Ui, id: &str, count: usize, mut row: impl FnMut(&mut Ui, usize)) {
    /// Beyond this, rows must be of equal height, so that only those seen are laid out.
    const FEW: usize = 100;
    let area = egui::ScrollArea::vertical().id_salt(id).max_height(LIST_HEIGHT);
    let mut one = |ui: &mut Ui, i: usize| {
        ui.push_id((id, i), |ui| ui.horizontal(|ui| row(ui, i)));
    };
    if count <= FEW {
        area.show(ui, |ui| (0..count).for_each(|i| one(ui, i)));
    } else {
        let height = ui.spacing().interact_size.y * if id == "notes" { 4.5 } else { 1.0 };
        area.show_rows(ui, height, count, |ui, seen| seen.for_each(|i| one(ui, i)));
    }
}

fn remove(ui: &mut Ui) -> bool {
    ui.small_button("×").on_hover_text("remove").clicked()
}
