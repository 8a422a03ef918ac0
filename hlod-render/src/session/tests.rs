use std::path::Path;
use std::time::{Duration, Instant};

use hlod_compress::FormatError;

use super::*;
use crate::RenderError;
use crate::camera::Projection;
use crate::framing::Framing;
use crate::measure::{Measured, MeasurementKind};

fn untouched() -> Session {
    let source = |name: &str, hash: &str| SourceIdentity {
        name: name.into(),
        bytes: 12,
        sha256: hash.into(),
    };
    Session {
        version: VERSION,
        model: ModelIdentity {
            file: "a.hlod".into(),
            unit: "mm".into(),
            sources: vec![source("a.ply", "00ff")],
        },
        scanner: None,
        frame: None,
        scale: None,
        looks: Looks::default(),
        views: Arc::default(),
        measurements: Arc::default(),
        sections: Arc::default(),
        notes: Arc::default(),
    }
}

fn point(x: f64) -> SurfacePoint {
    SurfacePoint {
        position: [x, 0.1, -1.0 / 3.0],
        normal: [0.0, 0.0, 1.0],
        file_bound: 0.01,
        pixel_length: Some(0.2),
    }
}

fn worked_on() -> Session {
    let mut session = untouched();
    session.scanner =
        Some(ScannerUncertainty { expanded: 0.05, k: 2.0, source: "certificate 12".into() });
    let viewpoint = Viewpoint {
        eye: [0.0, 0.0, 5.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: Some(35.0),
        parallel_height: None,
    };
    session.frame = Some(ObjectFrame::of_axes(DVec3::Z, -DVec3::Y).unwrap());
    session.scale = Some(ScaleCorrection {
        points: [point(0.0), point(1.5)],
        known_length: 1.6,
        unit: "cm".into(),
        source: "calliper".into(),
    });
    let looks = Looks { light_azimuth_deg: -80.25, enhance: 0.25, ..Looks::default() };
    session.views = Arc::new(vec![SavedView { name: "the “hand”\n".into(), viewpoint, looks }]);
    session.measurements = Arc::new(vec![Measurement {
        name: "groove".into(),
        kind: MeasurementKind::Distance,
        points: vec![point(0.0), point(1.5)],
        result: Some(Measured { value: 1.5, file_bound: Some(0.02), delta: Some([1.5, 0.0, 0.0]) }),
    }]);
    session.sections = Arc::new(vec![SectionPlane {
        name: "base".into(),
        normal: [0.0, 1.0, 0.0],
        offset: 12.5,
        shown: true,
        opens: true,
    }]);
    session.notes = Arc::new(vec![Note {
        title: "crack".into(),
        text: "from the left".into(),
        category: "damage".into(),
        colour: "#d08030".into(),
        shape: NoteShape::Region,
        points: vec![point(0.0), point(1.0), point(2.0)],
        area: Some(2.5),
    }]);
    session
}

#[test]
fn what_is_saved_is_what_is_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hlod.session.json");
    let session = worked_on();
    save(&session, &path).unwrap();
    assert_eq!(load(&path).unwrap(), session);
    // The same bytes every time, and nothing left aside.
    let bytes = std::fs::read(&path).unwrap();
    save(&session, &path).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert_ne!(load(&path).unwrap(), untouched());
}

#[test]
fn a_session_that_cannot_be_saved_leaves_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hlod.session.json");
    save(&worked_on(), &path).unwrap();
    // A folder where the file would be put aside.
    std::fs::create_dir(folder.path().join("a.hlod.session.json.part")).unwrap();
    assert!(matches!(save(&untouched(), &path), Err(RenderError::Io { .. })));
    assert_eq!(load(&path).unwrap(), worked_on());
}

#[test]
fn every_truncation_and_every_wrong_value_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.json");
    let text = serde_json::to_string(&worked_on()).unwrap();
    for end in 0..text.len() {
        std::fs::write(&path, &text.as_bytes()[..end]).unwrap();
        assert!(load(&path).is_err(), "{end} bytes");
    }
    let wrong = [
        ("\"version\":1", "\"version\":2", "version 2"),
        ("\"views\":", "\"veiws\":", "veiws"),
        ("\"k\":2.0", "\"k\":0.0", "scanner"),
        ("\"eye\":[0.0,0.0,5.0]", "\"eye\":[0.0,0.0,0.0]", "views[0]: the eye"),
        ("\"eye\":[0.0,0.0,5.0]", "\"eye\":[0.0,1e300,5.0]", "views[0]: a coordinate"),
        ("\"up\":[0.0,1.0,0.0]", "\"up\":[0.0,0.0,2.0]", "views[0]: `up`"),
        ("\"fov_y_deg\":35.0", "\"fov_y_deg\":350.0", "views[0]: one of"),
        ("\"kind\":\"distance\"", "\"kind\":\"angle\"", "measurements[0]: angle"),
        (
            "\"normal\":[0.0,1.0,0.0],\"offset\"",
            "\"normal\":[0.0,2.0,0.0],\"offset\"",
            "sections[0]",
        ),
        ("#d08030", "#d0803", "notes[0]: `colour`"),
        ("\"shape\":\"region\"", "\"shape\":\"circle\"", "circle"),
        ("\"ambient\":", "\"ambient\":7,\"x\":", "x"),
    ];
    for (right, wrong, named) in wrong {
        assert!(text.contains(right), "{right}");
        std::fs::write(&path, text.replacen(right, wrong, 1)).unwrap();
        let error = load(&path).expect_err(wrong).to_string();
        assert!(error.contains(named) && error.contains("s.json"), "{wrong}: {error}");
    }
    let four = serde_json::to_string(&*worked_on().sections).unwrap();
    let one = four.trim_matches(|c| c == '[' || c == ']');
    let four = text.replacen(&four, &format!("[{}]", [one; 4].join(",")), 1);
    std::fs::write(&path, four).unwrap();
    assert!(load(&path).unwrap_err().to_string().contains("4 sections: at most 3"));
    let twice = text.replacen("\"views\":[", &format!("\"views\":[{},", view_text(&text)), 1);
    std::fs::write(&path, twice).unwrap();
    assert!(load(&path).unwrap_err().to_string().contains("views[1]: there is another view"));
}

/// The only view of a session, as it stands in the file.
fn view_text(text: &str) -> String {
    let value: serde_json::Value = serde_json::from_str(text).unwrap();
    value["views"][0].to_string()
}

#[test]
fn a_session_of_another_scan_says_so_and_one_of_another_build_does_not() {
    let (ours, mut theirs) = (untouched().model, untouched().model);
    theirs.file = "b.hlod".into();
    theirs.sources[0].sha256 = "00FF".into();
    assert_eq!(ours.mismatch(&theirs), None);
    theirs.unit = "m".into();
    assert!(ours.mismatch(&theirs).unwrap().contains("in mm, the file's in m"));
    theirs.sources[0].sha256 = "00fe".into();
    assert!(ours.mismatch(&theirs).unwrap().contains("another scan (a.ply)"));
}

#[test]
fn steps_are_undone_and_done_again() {
    let mut history = History::new(untouched());
    let at = Instant::now();
    let rename = |name: &'static str| move |s: &mut Session| s.model.file = name.into();
    assert!(!history.edit("rename", rename("a.hlod")), "the same is no step");
    assert!(history.undoable().is_none() && !history.undo());
    history.edit("rename", rename("b"));
    history.edit("rename", rename("c"));
    assert!(history.undo());
    assert_eq!(history.session().model.file, "b");
    assert_eq!((history.undoable(), history.redoable()), (Some("rename"), Some("rename")));
    assert!(history.redo());
    assert_eq!(history.session().model.file, "c");
    assert!(history.undo() && history.undo() && !history.undo());
    assert_eq!(history.session(), &untouched());
    // A new step ends what could be done again.
    history.edit("rename", rename("d"));
    assert!(!history.redo());

    // A slider is one step; after a pause another.
    for k in 1..=5u64 {
        let light = |s: &mut Session| s.looks.light_azimuth_deg = k as f64;
        history.adjust("light", at + Duration::from_millis(100 * k), light);
    }
    let light = |s: &mut Session| s.looks.light_azimuth_deg = 90.0;
    history.adjust("light", at + Duration::from_secs(9), light);
    history.undo();
    assert_eq!(history.session().looks.light_azimuth_deg, 5.0);
    history.undo();
    assert_eq!(history.session().looks.light_azimuth_deg, -45.0);
    assert_eq!(history.session().model.file, "d");
}

#[test]
fn sessions_lie_beside_files_where_they_can() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("Köpfe 1.hlod");
    let place = place_of(&model).unwrap();
    assert_eq!(place.path, folder.path().join("Köpfe 1.hlod.session.json"));
    assert!(!place.exists);
    save(&untouched(), &place.path).unwrap();
    assert!(place_of(&model).unwrap().exists);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no probe stays");
}

#[test]
fn a_saver_saves_within_seconds_and_at_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.json");
    let start = Instant::now();
    let mut saver = Saver::new(path.clone(), untouched());
    assert!(saver.note(&untouched(), start).is_none() && saver.due().is_none());
    assert!(saver.note(&worked_on(), start).is_none());
    assert!(saver.due().unwrap() <= start + Duration::from_secs(5));
    assert!(!path.exists());
    saver.note(&worked_on(), start + Duration::from_secs(4));
    assert!(saver.due().is_none());
    saver.finish(&untouched()).unwrap();
    assert_eq!(load(&path).unwrap(), untouched());

    let nowhere = Saver::new(folder.path().join("none/s.json"), untouched());
    assert!(matches!(nowhere.finish(&worked_on()), Err(RenderError::Io { .. })));
    // What was never touched leaves no file.
    let saver = Saver::new(folder.path().join("other.json"), untouched());
    saver.finish(&untouched()).unwrap();
    assert!(!folder.path().join("other.json").exists());
}

#[test]
fn notes_become_annotations() {
    let mut session = worked_on();
    let mut notes = session.notes.to_vec();
    notes.push(Note { shape: NoteShape::Point, points: vec![point(7.0)], ..notes[0].clone() });
    notes.push(Note {
        shape: NoteShape::Polyline,
        text: String::new(),
        category: String::new(),
        ..notes[0].clone()
    });
    session.notes = Arc::new(notes);
    let page = annotations::annotation_page(&session, "a.hlod");
    assert_eq!(page["type"], "AnnotationPage");
    let selector = |i: usize| &page["items"][i]["target"]["selector"][0];
    let ring = selector(0)["value"].as_str().unwrap();
    assert!(
        ring.starts_with("POLYGON Z ((0 0.1 -0.3")
            && ring.ends_with(", 0 0.1 -0.3333333333333333))")
    );
    assert_eq!(selector(1)["type"], "PointSelector");
    assert_eq!(selector(1)["x"], 7.0);
    assert!(selector(2)["value"].as_str().unwrap().starts_with("LINESTRING Z ("));
    assert_eq!(page["items"][2]["body"][0]["value"], "crack");
    assert_eq!(page["items"][0]["body"][1]["purpose"], "tagging");
}

#[test]
fn viewpoints_and_cameras_go_there_and_back() {
    let bounds = (DVec3::splat(-1.0), DVec3::ONE);
    let framing = Framing::new(bounds, DVec3::Y, DVec3::Z);
    for direction in [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.6, 0.2, 0.7]] {
        let mut camera = framing.fitting(direction, 1.5, 35.0);
        for parallel in [false, true] {
            if parallel {
                camera.projection = Projection::Orthographic { height: 2.5 };
                camera.near = 0.0;
            }
            let back = Viewpoint::new(&camera).camera(&framing);
            assert!(back.eye.distance(camera.eye) < 1e-12);
            for (a, b) in back.axes().iter().zip(camera.axes()) {
                assert!(a.distance(b) < 1e-12, "{direction:?}");
            }
            assert!(Viewpoint::new(&camera).validate().is_ok());
        }
    }
}

#[test]
fn a_missing_session_is_an_io_error_with_its_name() {
    let error = load(Path::new("/no/such/session.json")).unwrap_err();
    assert!(error.to_string().contains("/no/such/session.json"), "{error}");
    assert!(!matches!(error, RenderError::Format { source: FormatError::Io(_), .. }));
}

#[test]
fn two_windows_on_one_session_lose_nothing_of_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hlod.session.json");
    save(&untouched(), &path).unwrap();
    let of = |name: &str| {
        let mut session = worked_on();
        Arc::make_mut(&mut session.notes)[0].title = name.into();
        session
    };
    let first = Saver::new(path.clone(), untouched());
    let mut second = Saver::new(path.clone(), untouched());
    let mut third = Saver::new(path.clone(), untouched());
    first.finish(&of("first")).unwrap();
    // The second finds it changed, says so, and goes on in another file, in which it remains.
    let start = Instant::now();
    second.note(&of("second"), start);
    second.note(&of("second"), start + Duration::from_secs(4));
    let told = std::iter::repeat_with(|| {
        std::thread::sleep(Duration::from_millis(10));
        second.note(&of("second"), start + Duration::from_secs(4))
    });
    let told = told.take(1000).flatten().next().expect("it says so").to_string();
    assert!(
        told.contains("written by another window") && told.contains("session.2.json"),
        "{told}"
    );
    let other = folder.path().join("a.hlod.session.2.json");
    assert_eq!(second.path(), other);
    second.finish(&of("second again")).unwrap();
    // The third finds both, at the end.
    third.note(&of("third"), start);
    let told = third.finish(&of("third")).unwrap_err().to_string();
    assert!(told.contains("session.3.json"), "{told}");
    let titles = ["", "2.", "3."].map(|n| {
        load(&folder.path().join(format!("a.hlod.session.{n}json"))).unwrap().notes[0].title.clone()
    });
    assert_eq!(titles, ["first", "second again", "third"]);
    // A file that was removed meanwhile is nobody's.
    let saver = Saver::new(path.clone(), load(&path).unwrap());
    std::fs::remove_file(&path).unwrap();
    saver.finish(&of("fourth")).unwrap();
    assert_eq!(load(&path).unwrap(), of("fourth"));
}
