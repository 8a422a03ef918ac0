//! The panel without a window: its buttons, fields and sliders are found by the names that screen readers have for them,
//! and pressed.

use std::sync::Arc;
use std::time::Instant;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec3;

use super::*;
use crate::gpu::{AdapterChoice, Gpu};
use crate::measure::{Measured, Measurement, MeasurementKind, SurfacePoint};
use crate::model::{Model, ModelLimits};
use crate::session::{Note, NoteShape, ScaleCorrection, SectionPlane, Session};
use crate::viewer::work::Change;
use crate::viewer::work::tool::{Standing, Task};

/// What the panel is shown of, and what it asked for.
struct Shown {
    settings: Settings,
    preferences: Preferences,
    readings: Readings,
    work: Work,
    actions: Vec<Action>,
    /// What it takes up, and what there is, in points.
    widths: [f32; 2],
    _folder: tempfile::TempDir,
}

/// A tetrahedron's panel.
fn panel() -> Harness<'static, Shown> {
    let folder = tempfile::tempdir().unwrap();
    let [scan, file] = ["scan.ply", "scan.hlod"].map(|name| folder.path().join(name));
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
               element face 4\nproperty list uchar int vertex_indices\nend_header\n\
               0 0 0\n10 0 0\n0 20 0\n0 0 5\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
    std::fs::write(&scan, ply).unwrap();
    let options = hlod_build::BuildOptions::default();
    hlod_build::build(&[scan], &file, &options, &hlod_build::progress::Silent).unwrap();
    let gpu = Gpu::headless(AdapterChoice::Software).unwrap();
    let model = Model::open(&gpu, &file, ModelLimits::default()).unwrap();
    let shown = Shown {
        settings: Settings::default(),
        preferences: Preferences::default(),
        readings: Readings {
            scalars: Painted::all(model.header()),
            diagonal: 23.0,
            ..Readings::default()
        },
        work: Work::open(&file, None, &model, || {}),
        actions: Vec::new(),
        widths: [0.0; 2],
        _folder: folder,
    };
    let contents = |ui: &mut Ui, shown: &mut Shown| {
        let mut wishes = Wishes::default();
        let room = ui.available_width();
        let Shown { settings, preferences, readings, work, actions, .. } = shown;
        contents(ui, (settings, preferences), readings, work, &mut wishes);
        shown.widths = [ui.min_rect().width(), room];
        actions.append(&mut wishes.actions);
        for change in wishes.changes {
            work.change(change, Instant::now());
        }
    };
    // As high as all of it: nothing has to be scrolled to.
    Harness::builder().with_size(egui::vec2(WIDTH, 2400.0)).build_ui_state(contents, shown)
}

fn surface_point(x: f64) -> SurfacePoint {
    SurfacePoint {
        position: [x, 0.0, 0.0],
        normal: [0.0, 1.0, 0.0],
        file_bound: 0.001,
        pixel_length: None,
    }
}

#[test]
fn nothing_is_wider_than_the_panel() {
    let mut panel = panel();
    panel.run();
    let unit = hlod_compress::Unit::Unknown;
    let full = move |session: &mut Session| {
        let scale = ScaleCorrection::new([0.0, 10.0].map(surface_point), unit).unwrap();
        session.scale = Some(ScaleCorrection { known_length: 123_456.789, ..scale });
        let section = |i: u32, opens| SectionPlane {
            name: format!("Section {i} through the left shoulder and the plinth"),
            normal: [1.0, 0.0, 0.0],
            offset: 123_456.789,
            shown: true,
            opens,
        };
        session.sections = Arc::new(vec![section(1, true), section(12, false), section(13, false)]);
        let value = Measured {
            value: 123_456.789,
            file_bound: Some(0.123),
            delta: Some([-123_456.789; 3]),
        };
        let results = MeasurementKind::ALL.map(|kind| Measurement {
            name: "from the left brow to the chin 123".to_owned(),
            kind,
            points: [0.0, 3.0, 10.0].map(surface_point).to_vec(),
            result: Some(value),
        });
        session.measurements = Arc::new(results.to_vec());
        let note = Note {
            title: "a crack that runs from the brow to the left ear".to_owned(),
            text: "It was there in 1903 already.".to_owned(),
            category: "damage".to_owned(),
            colour: "#d55e00".to_owned(),
            shape: NoteShape::Point,
            points: vec![surface_point(1.0)],
            area: None,
        };
        session.notes = Arc::new(vec![note]);
    };
    let edit = Box::new(full);
    panel.state_mut().work.change(Change { what: "all", gradual: false, edit }, Instant::now());
    let widths = |panel: &mut Harness<'_, Shown>| {
        panel.run();
        panel.state().widths
    };
    let [taken, room] = widths(&mut panel);
    assert!(taken <= room + 0.5, "{taken} of {room} points");
    for light in ["lamp", "spot"] {
        press(&mut panel, light);
        let [taken, room] = panel.state().widths;
        assert!(taken <= room + 0.5, "{light}: {taken} of {room} points");
    }
    for paint in Paint::ALL {
        panel.state_mut().settings.paint = paint;
        let [taken, room] = widths(&mut panel);
        assert!(taken <= room + 0.5, "{paint:?}: {taken} of {room} points");
    }
}

fn press(panel: &mut Harness<'_, Shown>, name: &str) {
    panel.get_by_label(name).click();
    panel.run();
}

#[test]
fn every_tool_is_found_by_name_and_taken_in_hand() {
    let mut panel = panel();
    panel.run();
    for task in Task::ALL {
        panel.state_mut().actions.clear();
        // A point is measured, noted and a kind of primitive elsewhere: its first name is the tool's.
        let found = panel.query_all_by_label(task.name()).next();
        found.unwrap_or_else(|| panic!("no tool is named {}", task.name())).click();
        panel.run();
        assert_eq!(panel.state().actions, [Action::Tool(task)], "{}", task.name());
    }
}

#[test]
fn axes_are_chosen_undone_and_shown_in_words() {
    let mut panel = panel();
    panel.run();
    assert!(panel.query_by_label("up +y, front +z, as the file says").is_some());
    // The first row is up, the second front.
    panel.get_all_by_label("−z").next().unwrap().click();
    panel.run();
    let frame = panel.state().work.session().frame.clone().expect("it stands otherwise");
    assert_eq!(frame.axes()[1], DVec3::NEG_Z);
    // What was its front cannot be any more: it is what was up.
    assert_eq!(frame.axes()[2], DVec3::Y);
    assert!(panel.query_by_label("up −z, front y").is_some());
    press(&mut panel, "its own coordinates");
    assert!(panel.state().work.session().shown_frame().is_none());
    press(&mut panel, "as the file says");
    assert!(panel.state().work.session().frame.is_none());
    press(&mut panel, "Undo");
    assert_eq!(panel.state().actions, [Action::Undo]);
    assert!(panel.state_mut().work.step(false));
    panel.run();
    assert!(panel.query_by_label("up −z, front y").is_some());
}

#[test]
fn a_known_length_is_typed_and_taken_back() {
    let mut panel = panel();
    panel.run();
    let unit = hlod_compress::Unit::Unknown;
    let scale = ScaleCorrection::new([0.0, 10.0].map(surface_point), unit).unwrap();
    let edit = Box::new(move |session: &mut Session| session.scale = Some(scale));
    panel
        .state_mut()
        .work
        .change(Change { what: "known length", gradual: false, edit }, Instant::now());
    panel.run();
    assert!(panel.query_by_label("× 1.000000").is_some());
    let field = panel.get_by_role_and_label(egui::accesskit::Role::SpinButton, "known");
    field.click();
    panel.run();
    // Everything in a field that is clicked is selected.
    panel.get_by_role_and_label(egui::accesskit::Role::SpinButton, "known").type_text("12.5");
    panel.key_press(egui::Key::Enter);
    panel.run();
    let scale = panel.state().work.session().scale.clone().unwrap();
    assert_eq!((scale.known_length, scale.factor()), (12.5, 1.25));
    assert!(panel.query_by_label("× 1.250000").is_some());
}

#[test]
fn light_is_parallel_a_lamp_or_a_spot() {
    let mut panel = panel();
    panel.run();
    assert!(panel.query_by_label("away").is_none());
    press(&mut panel, "spot");
    let light = panel.state().settings.light;
    assert_eq!((light.distance, light.spot_deg), (Some(23.0), Some(30.0)));
    assert!(panel.query_all_by_label_contains("cone").next().is_some());
    press(&mut panel, "lamp");
    let light = panel.state().settings.light;
    assert_eq!((light.distance, light.spot_deg), (Some(23.0), None));
    press(&mut panel, "parallel");
    assert_eq!(panel.state().settings.light.distance, None);
}

#[test]
fn paints_and_relief_go_together() {
    let mut panel = panel();
    panel.run();
    press(&mut panel, "curvature");
    assert_eq!(panel.state().settings.paint, Paint::Curvature);
    press(&mut panel, "bound");
    assert_eq!(panel.state().settings.paint, Paint::Bound);
    press(&mut panel, "shaded");
    panel.state_mut().settings.enhance.strength = 0.5;
    panel.run();
    let looks = panel.state().settings.looks();
    assert_eq!((looks.enhance, looks.enhance_radius_px), (0.5, 4.0));
}

/// Tools that are taken in the panel are the ones that the keys take.
#[test]
fn the_tools_hints_say_what_to_click() {
    let mut panel = panel();
    panel.run();
    for (task, points) in [
        (Task::Stand(Standing::Ground), "point 1 of 3"),
        (Task::Scale, "point 1 of 2"),
        (Task::Measure(MeasurementKind::Angle), "point 1 of 3"),
    ] {
        panel.state_mut().work.take_tool(task);
        let tool = panel.state().work.tool.as_ref().expect("in hand");
        assert!(tool.hint().contains(points), "{}", tool.hint());
        panel.state_mut().work.take_tool(task);
        assert!(panel.state().work.tool.is_none(), "taken twice it is put away");
    }
}
