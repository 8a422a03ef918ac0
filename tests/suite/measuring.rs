//! Measuring on the scan's own surface, against shapes whose lengths are known and against the scan
//! itself; and the commands that do it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use hlod_compress::Unit;
use hlod_render::framing::Framing;
use hlod_render::leaves::Leaves;
use hlod_render::measure::{
    Measured, Measurement, MeasurementKind, SurfacePoint, measure, nearest_point,
};
use hlod_render::pick::first_hit;
use hlod_render::session::{
    self, LightFrame, Looks, Note, NoteShape, SavedView, Session, Viewpoint,
};
use hlod_tests::{ball, built, bumpy_ball, ply, program};

/// The sides of the block, in mm.
const SIDES: [f64; 3] = [40.0, 30.0, 2.0];

/// A closed block with n squares along each edge: corners, then faces.
fn block(n: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    let mut faces = Vec::new();
    for axis in 0..3 {
        for high in [false, true] {
            let base = vertices.len() as u32;
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for j in 0..=n {
                for i in 0..=n {
                    let mut p = [0.0; 3];
                    p[axis] = if high { SIDES[axis] } else { 0.0 };
                    p[u] = SIDES[u] * f64::from(i) / f64::from(n);
                    p[v] = SIDES[v] * f64::from(j) / f64::from(n);
                    vertices.push(p);
                }
            }
            for j in 0..n {
                for i in 0..n {
                    let a = base + j * (n + 1) + i;
                    let (b, c, d) = (a + 1, a + n + 1, a + n + 2);
                    let both = if high { [[a, b, d], [a, d, c]] } else { [[a, d, b], [a, c, d]] };
                    faces.extend(both);
                }
            }
        }
    }
    (vertices, faces)
}

/// A built file of many small leaves.
fn file(folder: &Path, name: &str, text: &str) -> PathBuf {
    let (input, output) = (folder.join(format!("{name}.ply")), folder.join(format!("{name}.hlod")));
    std::fs::write(&input, text).unwrap();
    built(&input, &output, |options| {
        options.unit = Unit::Millimetre;
        options.leaf_triangles = 300;
    });
    output
}

fn block_leaves(folder: &Path) -> Leaves {
    let (vertices, faces) = block(24);
    Leaves::open(&file(folder, "block", &ply(&vertices, &faces))).unwrap()
}

fn near(leaves: &Leaves, p: [f64; 3]) -> SurfacePoint {
    nearest_point(leaves, DVec3::from_array(p), 1.0).unwrap().expect("on the surface")
}

/// Whether a result is right within what it says of itself.
fn holds(measured: &Measured, truth: f64) -> bool {
    measured.file_bound.is_some_and(|bound| (measured.value - truth).abs() <= bound)
}

#[test]
fn lengths_and_angles_of_a_block_are_right_within_their_bound() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = block_leaves(folder.path());
    let of = |kind, points: &[[f64; 3]]| {
        let points: Vec<SurfacePoint> = points.iter().map(|p| near(&leaves, *p)).collect();
        measure(&leaves, kind, &points).unwrap()
    };
    let (a, b, c) = ([0.0; 3], [SIDES[0], 0.0, 0.0], [SIDES[0], SIDES[1], 0.0]);
    let distance = of(MeasurementKind::Distance, &[a, c]);
    assert!(holds(&distance, 50.0), "{distance:?}");
    assert!(!holds(&distance, 50.02), "a bound that holds for everything says nothing");
    assert!(distance.delta.unwrap()[1] - 30.0 <= distance.file_bound.unwrap());
    let polyline = of(MeasurementKind::Polyline, &[a, b, c]);
    assert!(holds(&polyline, 70.0), "{polyline:?}");
    let angle = of(MeasurementKind::Angle, &[a, b, c]);
    assert!(holds(&angle, 90.0) && !holds(&angle, 90.1), "{angle:?}");
}

#[test]
fn lengths_along_the_surface_go_over_edges() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = block_leaves(folder.path());
    // From the top to the bottom over the long edge: 5 + 2 + 5.
    let over = [near(&leaves, [20.0, 5.0, 2.0]), near(&leaves, [20.0, 5.0, 0.0])];
    // They face opposite ways: no plane stands upright on both.
    assert!(measure(&leaves, MeasurementKind::SurfaceLength, &over).is_err());
    // Over the edge at z = 2: 5 on the top, 1 on the side.
    let side = [near(&leaves, [20.0, 5.0, 2.0]), near(&leaves, [20.0, 0.0, 1.0])];
    let length = measure(&leaves, MeasurementKind::SurfaceLength, &side).unwrap();
    assert!((length.value - 6.0).abs() < 0.01 && length.file_bound.is_none(), "{length:?}");
    assert!(measure(&leaves, MeasurementKind::Distance, &side).unwrap().value < 5.2);
    // A third of the way round a ball of radius 1, about: it has bumps of 2 %.
    let ball = Leaves::open(&file(folder.path(), "ball", &bumpy_ball(60))).unwrap();
    let quarter = [near(&ball, [1.0, 0.0, 0.0]), near(&ball, [0.0, 1.0, 0.0])];
    let length = measure(&ball, MeasurementKind::SurfaceLength, &quarter).unwrap().value;
    assert!((length / std::f64::consts::FRAC_PI_2 - 1.0).abs() < 0.03, "{length}");
}

#[test]
fn areas_are_those_of_the_side_that_was_drawn_on() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = block_leaves(folder.path());
    let of = |corners: &[[f64; 3]]| {
        let points: Vec<SurfacePoint> = corners.iter().map(|p| near(&leaves, *p)).collect();
        measure(&leaves, MeasurementKind::SurfaceArea, &points)
    };
    // Not along the squares, and with a notch; the other side is 2 mm behind it.
    let shape = [
        [10.3, 5.1, 2.0],
        [30.7, 5.1, 2.0],
        [30.7, 20.2, 2.0],
        [20.0, 10.1, 2.0],
        [10.3, 20.2, 2.0],
    ];
    let area = of(&shape).unwrap();
    let truth = 20.4 * 15.1 - 20.4 * 10.1 / 2.0;
    assert!(
        (area.value / truth - 1.0).abs() < 1e-3 && area.file_bound.is_none(),
        "{area:?} {truth}"
    );
    // The other way round, and begun elsewhere, it is the same.
    let mut turned = shape;
    turned.reverse();
    turned.rotate_left(2);
    assert!((of(&turned).unwrap().value / area.value - 1.0).abs() < 1e-9);

    let bow_tie = [[10.0, 5.0, 2.0], [30.0, 20.0, 2.0], [30.0, 5.0, 2.0], [10.0, 12.0, 2.0]];
    let error = of(&bow_tie).unwrap_err().to_string();
    assert!(error.contains("crosses itself"), "{error}");
    let nothing = [[10.0, 5.0, 2.0], [20.0, 5.0, 2.0], [30.0, 5.0, 2.0]];
    assert!(of(&nothing).unwrap_err().to_string().contains("encloses nothing"));

    // The cap of a ball within a cone of 0.5: 2π(1 − cos 0.5), by a line of 48 corners.
    let ball = Leaves::open(&file(folder.path(), "ball", &ball(90, 0.0))).unwrap();
    let corners = (0..48).map(|i| {
        let phi = std::f64::consts::TAU * f64::from(i) / 48.0;
        let (sin, cos) = 0.5f64.sin_cos();
        near(&ball, [sin * phi.cos(), cos, sin * phi.sin()])
    });
    let corners: Vec<SurfacePoint> = corners.collect();
    let cap = measure(&ball, MeasurementKind::SurfaceArea, &corners).unwrap().value;
    let truth = std::f64::consts::TAU * (1.0 - 0.5f64.cos());
    assert!((cap / truth - 1.0).abs() < 0.005, "{cap} {truth}");
}

/// Vertices and triangles of an ASCII file as [`ply`] writes it.
fn parsed(text: &str) -> Vec<[DVec3; 3]> {
    let body = text.split_once("end_header\n").unwrap().1;
    let rows: Vec<Vec<f64>> =
        body.lines().map(|line| line.split(' ').map(|n| n.parse().unwrap()).collect()).collect();
    let corner = |v: f64| DVec3::from_slice(&rows[v as usize]);
    rows.iter().filter(|r| r.len() == 4).map(|r| [1, 2, 3].map(|k| corner(r[k]))).collect()
}

#[test]
fn places_are_as_far_from_the_scan_as_they_say_at_most() {
    let folder = tempfile::tempdir().unwrap();
    let text = bumpy_ball(40);
    let scan = parsed(&text);
    let leaves = Leaves::open(&file(folder.path(), "ball", &text)).unwrap();
    for k in 0..60 {
        let phase = f64::from(k);
        let towards = DVec3::new(phase.sin(), (1.7 * phase).cos(), (0.3 * phase).sin()).normalize();
        // What a ray meets in the file and in the scan.
        let hit = first_hit(&leaves, 3.0 * towards, -towards).unwrap().expect("the ball is there");
        let met =
            scan.iter().filter_map(|t| meets(3.0 * towards, -towards, *t)).fold(f64::MAX, f64::min);
        // Along a ray that falls in steeply the file's rounding shows a little enlarged.
        assert!((hit.distance - met).abs() <= 2.0 * hit.error, "{k}: {} {met}", hit.distance);
        assert!(hit.normal.dot(towards) > 0.0, "{k}: {}", hit.normal);
        assert!(hit.error > 0.0 && hit.error < 5e-3, "{k}: {}", hit.error);
    }
    let nothing = first_hit(&leaves, DVec3::splat(3.0), DVec3::X).unwrap();
    assert!(nothing.is_none());
}

/// Where a ray passes a triangle's plane inside it.
fn meets(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let normal = (b - a).cross(c - a);
    let t = (a - origin).dot(normal) / direction.dot(normal);
    let p = origin + direction * t;
    let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| (to - from).cross(p - from).dot(normal));
    (t.is_finite() && t >= 0.0 && sides.iter().all(|s| *s >= 0.0)).then_some(t)
}

/// Runs `hlod-render` and gives its exit status, output and messages.
fn render(arguments: &[&str]) -> (i32, String, String) {
    let output = program("hlod-render").args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert!(!err.contains("panicked"), "{err}");
    (output.status.code().expect("not killed"), out, err)
}

#[test]
fn what_a_session_holds_is_measured_again_and_written_for_others() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = block_leaves(folder.path());
    let points = [near(&leaves, [0.0; 3]), near(&leaves, [SIDES[0], 0.0, 0.0])];
    let mut session = Session::new(leaves.path(), leaves.header());
    let result = measure(&leaves, MeasurementKind::Distance, &points).unwrap();
    session.measurements = Arc::new(vec![
        Measurement {
            name: "width, \"front\"".into(),
            kind: MeasurementKind::Distance,
            points: points.to_vec(),
            result: Some(result),
        },
        Measurement {
            name: "edited".into(),
            kind: MeasurementKind::Distance,
            points: points.to_vec(),
            result: Some(Measured { value: 41.0, ..result }),
        },
    ]);
    let region = [[5.0, 5.0, 2.0], [15.0, 5.0, 2.0], [15.0, 15.0, 2.0], [5.0, 15.0, 2.0]];
    session.notes = Arc::new(vec![Note {
        area: None,
        title: "patch".into(),
        text: "worn".into(),
        category: "damage".into(),
        colour: "#d08030".into(),
        shape: NoteShape::Region,
        points: region.iter().map(|p| near(&leaves, *p)).collect(),
    }]);
    let path = folder.path().join("block.hlod.session.json");
    session::save(&session, &path).unwrap();

    let [model, path] = [leaves.path(), &path].map(|p| p.to_str().unwrap().to_owned());
    let csv = folder.path().join("m.csv");
    let measured =
        ["measure", &model, "--session", &path, "--json", "--csv", csv.to_str().unwrap()];
    let (status, json, err) = render(&measured);
    assert_eq!(status, 0, "{err}");
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    let line = &report["measurements"][0];
    assert_eq!(line["value"].as_f64(), Some(result.value));
    assert_eq!(line["file_bound"].as_f64(), result.file_bound);
    assert_eq!((report["unit"].as_str(), report["scanner"].is_null()), (Some("mm"), true));
    let text = std::fs::read_to_string(csv).unwrap();
    let row = format!("\"width, \"\"front\"\"\",distance,{}", result.value);
    assert!(text.contains(&row) && text.contains("not declared"), "{text}");
    let table = render(&["measure", &model, "--session", &path, "--scanner-u", "0.05"]).1;
    assert!(table.contains("0.05 (k = 2, command line)"), "{table}");
    assert!(table.contains("Not as the session has it: edited"), "{table}");

    let annotations = folder.path().join("notes.json");
    let (status, table, err) = render(&[
        "notes",
        &model,
        "--session",
        &path,
        "--annotations",
        annotations.to_str().unwrap(),
    ]);
    assert!(status == 0 && table.contains("100.000 mm²"), "{table}{err}");
    let page: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(annotations).unwrap()).unwrap();
    assert_eq!(page["items"][0]["target"]["selector"][0]["type"], "WktSelector");
}

#[test]
fn what_cannot_be_measured_is_said_clearly() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = block_leaves(folder.path());
    let model = leaves.path().to_str().unwrap();
    let distance = ["measure", model, "--kind", "distance"];
    let with = |more: &[&str]| render(&[&distance[..], more].concat());
    // Too few points, a pick on nothing, a point in the air.
    assert_eq!(with(&["--at", "0,0,0"]).0, 2);
    let (status, _, why) = with(&["--pixel", "0,0", "--pixel", "320,240"]);
    assert!(status == 1 && why.contains("nothing is seen there"), "{why}");
    let (status, _, why) = with(&["--at", "0,0,0", "--at", "0,0,99"]);
    assert!(status == 1 && why.contains("no surface within"), "{why}");
    // Sessions: none, damaged, of another scan.
    let path = folder.path().join("s.json");
    let of_session = || render(&["measure", model, "--session", path.to_str().unwrap()]);
    assert_eq!(of_session().0, 2);
    std::fs::write(&path, "{\"version\": 1, ").unwrap();
    let (status, _, why) = of_session();
    assert!(status == 1 && why.contains("s.json: not a session of version 1"), "{why}");
    let mut other = Session::new(leaves.path(), leaves.header());
    other.model.sources[0].sha256 = "00".repeat(32);
    session::save(&other, &path).unwrap();
    let (status, _, why) = of_session();
    assert!(status == 0 && why.contains("another scan"), "{why}");
}

#[test]
fn a_hundred_thousand_notes_are_read_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = block_leaves(folder.path());
    let mut session = Session::new(leaves.path(), leaves.header());
    let note = Note {
        area: None,
        title: "mark".into(),
        text: "a chisel's".into(),
        category: String::new(),
        colour: "#ffffff".into(),
        shape: NoteShape::Point,
        points: vec![near(&leaves, [1.0, 1.0, 2.0])],
    };
    session.notes = Arc::new(vec![note; 100_000]);
    let path = folder.path().join("s.json");
    session::save(&session, &path).unwrap();
    assert_eq!(session::load(&path).unwrap(), session);
}

#[test]
fn a_saved_view_gives_the_same_picture_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = block_leaves(folder.path());
    let framing = Framing::of_header(leaves.header());
    let camera = framing.fitting([0.3, 0.2, 1.0], 4.0 / 3.0, 35.0);
    let mut session = Session::new(leaves.path(), leaves.header());
    let looks = Looks { light_azimuth_deg: 60.0, light_frame: LightFrame::Object, ..session.looks };
    let viewpoint = Viewpoint::new(&camera);
    session.views = Arc::new(vec![SavedView { name: "the edge".into(), viewpoint, looks }]);
    let path = folder.path().join("s.json");
    session::save(&session, &path).unwrap();
    let model = leaves.path().to_str().unwrap();
    let shot = |name: &str, view: &str, more: &[&str]| {
        let output = folder.path().join(name);
        let arguments = ["--software", "shot", model, "-o", output.to_str().unwrap()];
        let of_session = ["--session", path.to_str().unwrap(), "--view", view];
        (render(&[&arguments[..], &of_session, more].concat()), output)
    };
    let ((status, _, err), first) = shot("a.png", "the edge", &[]);
    assert_eq!(status, 0, "{err}");
    let second = folder.path().join("b.png");
    std::fs::rename(&first, &second).unwrap();
    shot("a.png", "the edge", &[]);
    assert_eq!(std::fs::read(&first).unwrap(), std::fs::read(&second).unwrap());
    // It is the view that was saved, not the usual one.
    let usual = folder.path().join("c.png");
    render(&["--software", "shot", model, "-o", usual.to_str().unwrap()]);
    assert!(image::open(&usual).unwrap() != image::open(&first).unwrap());

    let ((status, _, why), _) = shot("d.png", "the hand", &[]);
    assert!(status == 2 && why.contains("no view “the hand”; there are: the edge"), "{why}");
    let ((status, _, _), _) = shot("d.png", "the edge", &["--light=0,0"]);
    assert_eq!(status, 2, "one light or the other");
}

#[test]
fn a_plate_has_the_section_beside_the_views_at_the_same_scale() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = block_leaves(folder.path());
    let model = leaves.path().to_str().unwrap();
    let output = folder.path().join("plate.png");
    let plate = ["--software", "plate", model, "-o", output.to_str().unwrap()];
    // A pixel is a tenth of a millimetre.
    let at_scale = ["--scale", "1:1", "--dpi", "254", "--views", "front", "--json"];
    let (status, json, err) = render(&[&plate[..], &at_scale, &["--section", "z=1"]].concat());
    assert_eq!(status, 0, "{err}");
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    let at = |i: usize| report["section_at"][i].as_u64().expect("it is on the page") as u32;
    let page = image::open(&output).unwrap().to_rgb8();
    let dark = |x: u32, y: u32| page.get_pixel(x, y).0[0] < 128;
    // Its left and upper sides, its right and lower ones, and nothing in between.
    let (x, y) = (at(0), at(1));
    let near = |lines: [u32; 3], wanted: &dyn Fn(u32) -> bool| lines.iter().any(|l| wanted(*l));
    for (column, is_side) in [(x, true), (x + 200, false), (x + 400, true)] {
        let found = near([column - 1, column, column + 1], &|c| dark(c, y + 150));
        assert_eq!(found, is_side, "column {column}");
    }
    for (row, is_side) in [(y, true), (y + 150, false), (y + 300, true)] {
        let found = near([row - 1, row, row + 1], &|r| dark(x + 100, r));
        assert_eq!(found, is_side, "row {row}");
    }
    let (status, _, why) = render(&[&plate[..], &at_scale, &["--section", "z=99"]].concat());
    assert!(status == 1 && why.contains("meets nothing"), "{why}");
}
