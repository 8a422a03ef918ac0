//! How a statue stands, where that is not as the scanner's axes lie; and lengths by a known one. A block that lies
//! askew far from the origin is set upright, and must then be what a block is that was scanned upright.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use hlod_compress::Unit;
use hlod_render::extents::extents;
use hlod_render::leaves::Leaves;
use hlod_render::measure::{Measurement, MeasurementKind, SurfacePoint, nearest_point};
use hlod_render::session::{
    self, Looks, ObjectFrame, SavedView, ScaleCorrection, Session, Viewpoint,
};
use hlod_tests::{built, ply, program};

/// The block's sides, mm.
const SIDES: [f64; 3] = [40.0, 30.0, 12.0];
const SQUARES: u32 = 16;

/// Where a place of the block is in the scan.
fn askew(p: [f64; 3]) -> DVec3 {
    let turn = DMat3::from_rotation_x(-1.3) * DMat3::from_rotation_y(0.4);
    turn * DVec3::from_array(p) + DVec3::new(900.0, -400.0, 150.0)
}

/// The block's file, its places moved by a function.
fn block(folder: &Path, name: &str, place: impl Fn([f64; 3]) -> DVec3) -> PathBuf {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (axis, high) in (0..3).flat_map(|axis| [(axis, false), (axis, true)]) {
        let base = vertices.len() as u32;
        let side = SQUARES + 1;
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (j, i) in (0..side).flat_map(|j| (0..side).map(move |i| (j, i))) {
            let mut p = [0.0; 3];
            p[axis] = if high { SIDES[axis] } else { 0.0 };
            p[u] = SIDES[u] * f64::from(i) / f64::from(SQUARES);
            p[v] = SIDES[v] * f64::from(j) / f64::from(SQUARES);
            vertices.push(place(p).to_array());
        }
        for (j, i) in (0..SQUARES).flat_map(|j| (0..SQUARES).map(move |i| (j, i))) {
            let a = base + j * side + i;
            let (b, c, d) = (a + 1, a + side, a + side + 1);
            let two = if high { [[a, b, d], [a, d, c]] } else { [[a, d, b], [a, c, d]] };
            faces.extend(two);
        }
    }
    let (input, output) = (folder.join(format!("{name}.ply")), folder.join(format!("{name}.hlod")));
    std::fs::write(&input, ply(&vertices, &faces)).unwrap();
    built(&input, &output, |options| {
        options.unit = Unit::Millimetre;
        options.leaf_triangles = 300;
    });
    output
}

fn near(leaves: &Leaves, p: [f64; 3]) -> SurfacePoint {
    nearest_point(leaves, askew(p), 1.0).unwrap().expect("on the surface")
}

/// A session that sets the block upright by three of its corners.
fn upright(leaves: &Leaves) -> Session {
    let corners = [[0.0; 3], [0.0, SIDES[1], 0.0], [0.0, 0.0, SIDES[2]]];
    let mut session = Session::new(leaves.path(), leaves.header());
    let frame = ObjectFrame::through(corners.map(|c| near(leaves, c).place())).unwrap();
    session.frame = Some(frame);
    session
}

fn render(arguments: &[&str]) -> (i32, String, String) {
    let output = program("hlod-render").args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().expect("not killed"), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_block_that_was_set_upright_is_as_large_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = Leaves::open(&block(folder.path(), "askew", askew)).unwrap();
    let session = upright(&leaves);
    let axes = session.frame.as_ref().unwrap().axes();
    let reached = extents(&leaves, axes).unwrap();
    // Rounding to the file's lattice, and what that tilts the axes by.
    let tolerance = 4.0 * leaves.header().lattice.step;
    for (axis, [least, most]) in reached.into_iter().enumerate() {
        assert!((most - least - SIDES[axis]).abs() < tolerance, "{axis}: {}", most - least);
    }
    let framing = session.framing(leaves.header(), Some(reached));
    let middle = askew(SIDES.map(|side| side / 2.0));
    assert!(framing.centre.distance(middle) < tolerance, "{}", framing.centre);
    // By the bounds alone it would be larger.
    assert!(session.framing(leaves.header(), None).size()[2] > 1.5 * SIDES[2]);
}

#[test]
fn plates_of_a_block_set_upright_are_those_of_one_scanned_upright() {
    let folder = tempfile::tempdir().unwrap();
    let file = block(folder.path(), "askew", askew);
    let plain = block(folder.path(), "plain", DVec3::from_array);
    let session = folder.path().join("s.json");
    session::save(&upright(&Leaves::open(&file).unwrap()), &session).unwrap();
    let sizes = |file: &Path, more: &[&str]| -> Vec<[u64; 2]> {
        let output = folder.path().join("plate.png");
        let arguments = [
            "--software",
            "plate",
            file.to_str().unwrap(),
            "-o",
            output.to_str().unwrap(),
            "--scale",
            "1:1",
            "--dpi",
            "127",
            "--views",
            "front,right,top",
            "--json",
        ];
        let (status, json, err) = render(&[&arguments[..], more].concat());
        assert_eq!(status, 0, "{err}");
        let report: serde_json::Value = serde_json::from_str(&json).unwrap();
        let views = report["views"].as_array().unwrap();
        let side = |view: &serde_json::Value, name: &str| view[name].as_u64().unwrap();
        views.iter().map(|v| [side(v, "width"), side(v, "height")]).collect()
    };
    let wanted = sizes(&plain, &[]);
    let found = sizes(&file, &["--session", session.to_str().unwrap()]);
    let off = |found: &[[u64; 2]]| {
        let sides = found.iter().flatten().zip(wanted.iter().flatten());
        sides.map(|(a, b)| a.abs_diff(*b)).max().unwrap()
    };
    assert!(off(&found) <= 1, "{found:?} for {wanted:?}");
    assert!(off(&sizes(&file, &[])) > 20, "without the session it lies askew");
}

#[test]
fn measurements_are_shown_in_either_frame_and_corrected_beside() {
    let folder = tempfile::tempdir().unwrap();
    let leaves = Leaves::open(&block(folder.path(), "askew", askew)).unwrap();
    let mut session = upright(&leaves);
    let far = near(&leaves, [SIDES[0], SIDES[1], 0.0]);
    let points = [near(&leaves, [0.0, SIDES[1], 0.0]), far];
    let of = |name: &str, kind, points: &[SurfacePoint]| Measurement {
        name: name.into(),
        kind,
        points: points.to_vec(),
        result: None,
    };
    session.measurements = Arc::new(vec![
        of("corner", MeasurementKind::Point, &points[1..]),
        of("width", MeasurementKind::Distance, &points),
    ]);
    let mut scale = ScaleCorrection::new(points, Unit::Millimetre).unwrap();
    (scale.known_length, scale.source) = (4.04, "calliper".into());
    scale.unit = "cm".into();
    session.scale = Some(scale);
    let path = folder.path().join("s.json");
    session::save(&session, &path).unwrap();
    let [model, path] = [leaves.path(), &path].map(|p| p.to_str().unwrap().to_owned());
    let csv = folder.path().join("m.csv");
    let measure = |more: &[&str]| {
        let arguments = ["measure", &model, "--session", &path, "--csv", csv.to_str().unwrap()];
        let (status, out, err) = render(&[&arguments[..], more].concat());
        assert_eq!(status, 0, "{err}");
        (out, std::fs::read_to_string(&csv).unwrap())
    };
    let close = |found: &[f64], wanted: [f64; 3]| {
        found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 8.0 * leaves.header().lattice.step)
    };
    let numbers =
        |text: &str| -> Vec<f64> { text.split(' ').map(|v| v.parse().unwrap()).collect() };
    // What is written of the first measurement, in a column.
    let column = |csv: &str, row: usize, name: &str| -> String {
        let mut reader = csv::Reader::from_reader(csv.as_bytes());
        let at = reader.headers().unwrap().iter().position(|h| h == name).expect(name);
        reader.records().nth(row).unwrap().unwrap()[at].to_owned()
    };

    let (table, object) = measure(&[]);
    assert!(table.contains("the statue's own (through three points)"), "{table}");
    assert!(table.contains("known length of 4.04 cm") && table.contains("calliper"), "{table}");
    assert_eq!(column(&object, 0, "coordinates"), "object");
    let corner = [SIDES[0], SIDES[1], 0.0];
    assert!(close(&numbers(&column(&object, 0, "points")), corner), "{object}");
    let delta = ["dx", "dy", "dz"].map(|name| column(&object, 1, name).parse().unwrap());
    assert!(close(&delta, [SIDES[0], 0.0, 0.0]), "{delta:?}");
    let corrected: f64 = column(&object, 1, "corrected_value").parse().unwrap();
    assert!((corrected - 4.04).abs() < 1e-9 && column(&object, 1, "corrected_unit") == "cm");
    assert_eq!(column(&object, 0, "corrected_value"), "", "places are not corrected");

    let (table, source) = measure(&["--coordinates", "source"]);
    assert!(table.contains("the scan's, not the statue's own"), "{table}");
    assert_eq!(column(&source, 0, "coordinates"), "source");
    assert!(close(&numbers(&column(&source, 0, "points")), askew(corner).to_array()), "{source}");

    let (json, _) = measure(&["--json"]);
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    let placed = &report["measurements"][0];
    let of_array = |v: &serde_json::Value| -> Vec<f64> {
        v.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    assert!(close(&of_array(&placed["object_positions"][0]), corner));
    assert!(close(&of_array(&placed["points"][0]["position"]), askew(corner).to_array()));

    // Without how it stands there is nothing to show coordinates in.
    session.frame = None;
    session::save(&session, Path::new(&path)).unwrap();
    let arguments = ["measure", &model, "--session", &path, "--coordinates", "object"];
    let (status, _, why) = render(&arguments);
    assert!(status == 2 && why.contains("does not say how the statue stands"), "{why}");
}

/// Lights that are relative to the statue turn with what someone says of it.
#[test]
fn a_light_of_the_statue_comes_from_its_own_front() {
    let folder = tempfile::tempdir().unwrap();
    let file = block(folder.path(), "askew", askew);
    let leaves = Leaves::open(&file).unwrap();
    let mut session = upright(&leaves);
    let frame = session.frame.clone().unwrap();
    let looks = Looks {
        light_frame: session::LightFrame::Object,
        light_azimuth_deg: 0.0,
        light_elevation_deg: 0.0,
        ambient: 0.0,
        highlight: 0.0,
        ..session.looks
    };
    let camera = session.framing(leaves.header(), None).fitting([0.0, 0.0, 1.0], 1.0, 35.0);
    let viewpoint = Viewpoint::new(&camera);
    session.views = Arc::new(vec![SavedView { name: "front".into(), viewpoint, looks }]);
    let brightness = |frame: Option<ObjectFrame>| {
        session.frame = frame;
        let path = folder.path().join("s.json");
        session::save(&session, &path).unwrap();
        let output = folder.path().join("front.png");
        let (status, _, err) = render(&[
            "--software",
            "shot",
            file.to_str().unwrap(),
            "-o",
            output.to_str().unwrap(),
            "--size",
            "100x100",
            "--session",
            path.to_str().unwrap(),
            "--view",
            "front",
        ]);
        assert_eq!(status, 0, "{err}");
        image::open(&output).unwrap().to_rgb8().get_pixel(50, 50).0[1]
    };
    let mut brightness = brightness;
    let lit = brightness(Some(frame));
    // Along the scan's own front it comes from elsewhere.
    let askew = brightness(None);
    assert!(lit > 200, "{lit}");
    assert!(askew < lit - 20, "{askew} {lit}");
}
