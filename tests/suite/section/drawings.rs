//! What leaves the program: drawings, tables and the command, read back by others.

use std::path::Path;

use glam::{DVec2, DVec3};
use hlod_compress::Unit;
use hlod_render::leaves::Leaves;
use hlod_render::section::{Plane, Section, Sheet};
use hlod_tests::{ply, program};

use super::{Model, across, cube, torus};

/// Total length of each layer's lines, as some file has them.
type Lengths = Vec<(String, f64)>;

fn lengths(sheet: &Sheet, per_unit: f64) -> Lengths {
    let length = |section: &Section| section.measures().length * per_unit;
    sheet.layers.iter().map(|layer| (layer.name.clone(), length(&layer.section))).collect()
}

fn agree(a: &Lengths, b: &Lengths, tolerance: f64) -> bool {
    let near = |(x, y): (&(String, f64), &(String, f64))| {
        x.0 == y.0 && (x.1 - y.1).abs() <= tolerance * y.1.abs()
    };
    a.len() == b.len() && a.iter().zip(b).all(near)
}

/// What another reader finds in an SVG file: its size in mm and lengths in mm.
fn read_svg(bytes: &[u8]) -> (DVec2, Lengths) {
    use usvg::tiny_skia_path::PathSegment;
    let tree = usvg::Tree::from_data(bytes, &usvg::Options::default()).unwrap();
    // CSS pixels, 96 an inch.
    let mm = 25.4 / 96.0;
    let size = DVec2::new(f64::from(tree.size().width()), f64::from(tree.size().height())) * mm;
    let mut found = Lengths::new();
    let mut pending: Vec<&usvg::Group> = vec![tree.root()];
    while let Some(group) = pending.pop() {
        let mut length = 0.0;
        for node in group.children() {
            match node {
                usvg::Node::Group(group) => pending.push(group),
                usvg::Node::Path(path) => {
                    let data = path.data().clone().transform(path.abs_transform()).unwrap();
                    let (mut start, mut last) = (DVec2::ZERO, DVec2::ZERO);
                    for segment in data.segments() {
                        let to = match segment {
                            PathSegment::MoveTo(p) => {
                                last = DVec2::new(f64::from(p.x), f64::from(p.y));
                                start = last;
                                start
                            }
                            PathSegment::LineTo(p) => DVec2::new(f64::from(p.x), f64::from(p.y)),
                            PathSegment::Close => start,
                            curve => panic!("{curve:?} in an outline"),
                        };
                        length += last.distance(to) * mm;
                        last = to;
                    }
                }
                _ => panic!("an image or a text"),
            }
        }
        if !group.id().is_empty() {
            found.push((group.id().to_owned(), length));
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    (size, found)
}

/// What the crate that also wrote it reads in a DXF file: the unit and lengths in it.
fn read_dxf(bytes: &[u8]) -> (dxf::enums::Units, Lengths) {
    let drawing = dxf::Drawing::load(&mut std::io::Cursor::new(bytes)).unwrap();
    let mut found: Lengths = drawing.layers().map(|layer| (layer.name.clone(), 0.0)).collect();
    found.retain(|layer| layer.0.starts_with("section"));
    for entity in drawing.entities() {
        let dxf::entities::EntityType::LwPolyline(line) = &entity.specific else {
            panic!("not a polyline");
        };
        let mut points: Vec<DVec2> = line.vertices.iter().map(|v| DVec2::new(v.x, v.y)).collect();
        if line.is_closed() {
            points.push(points[0]);
        }
        let length: f64 = points.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        found.iter_mut().filter(|l| l.0 == entity.common.layer).for_each(|l| l.1 += length);
    }
    (drawing.header.default_drawing_units, found)
}

fn read_csv(bytes: &[u8]) -> Lengths {
    let text = std::str::from_utf8(bytes).unwrap();
    let rows = text.lines().skip(1).map(|row| row.split(',').collect::<Vec<_>>());
    let mut lines: Vec<(String, String, bool, Vec<DVec3>)> = Vec::new();
    for row in rows {
        let value = |i: usize| row[i].parse::<f64>().unwrap();
        let p = DVec3::new(value(4), value(5), value(6));
        match lines.last_mut().filter(|line| line.0 == row[0] && line.1 == row[1]) {
            Some(line) => line.3.push(p),
            None => lines.push((row[0].into(), row[1].into(), row[2] == "true", vec![p])),
        }
    }
    let mut found = Lengths::new();
    for (layer, _, closed, mut points) in lines {
        if closed {
            points.push(points[0]);
        }
        let length: f64 = points.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        match found.last_mut().filter(|last| last.0 == layer) {
            Some(last) => last.1 += length,
            None => found.push((layer, length)),
        }
    }
    found
}

/// Two planes, the first of them three times, of a torus in centimetres, whose name needs escaping.
fn sheet(model: &Model, declared: Option<Unit>) -> Sheet {
    let planes = [0.0, 0.2, 0.4].map(|y| model.cut(&across(1, y)));
    let families = vec![planes.to_vec(), vec![model.cut(&across(0, 1.0))]];
    Sheet::new(Path::new("/scans/a <b> & \"c\".hlod"), model.leaves.header(), declared, families)
}

#[test]
fn drawings_have_the_lengths_that_were_measured() {
    let model = Model::of(&torus(2.0, 0.75, 60), |o| o.unit = Unit::Centimetre);
    let sheet = sheet(&model, None);
    let names: Vec<&str> = sheet.layers.iter().map(|layer| layer.name.as_str()).collect();
    assert_eq!(names, ["section-1-1", "section-1-2", "section-1-3", "section-2"]);

    let svg = sheet.to_svg(1.0).unwrap();
    let (size, found) = read_svg(&svg);
    assert!(agree(&found, &lengths(&sheet, 10.0), 1e-4), "{found:?}");
    assert!(!agree(&found, &lengths(&sheet, 10.01), 1e-4));
    assert!(!agree(&found[1..].to_vec(), &lengths(&sheet, 10.0), 1e-4));
    // 55 mm wide, then a tenth of it, then 2 √(2.75² − 1) cm; 5 mm of margin.
    let width = 55.0 * 1.1 + 20.0 * (2.75f64.powi(2) - 1.0).sqrt() + 10.0;
    assert!((size - DVec2::new(width, 65.0)).abs().max_element() < 0.1, "{size}");
    let reduced = sheet.to_svg(5.0).unwrap();
    assert!(agree(&read_svg(&reduced).1, &lengths(&sheet, 2.0), 1e-4));
    let text = String::from_utf8(svg).unwrap();
    assert!(text.contains("a &lt;b&gt; &amp; ") && !text.contains("/scans"), "{}", &text[..600]);

    let dxf = sheet.to_dxf().unwrap();
    let (unit, found) = read_dxf(&dxf);
    assert_eq!(unit, dxf::enums::Units::Centimeters);
    assert!(agree(&found, &lengths(&sheet, 1.0), 1e-9), "{found:?}");
    assert_eq!(dxf, sheet.to_dxf().unwrap(), "the same bytes each time");

    let csv = sheet.to_csv();
    assert!(csv.starts_with(b"section,line,closed,point,x_cm,y_cm,z_cm,u_cm,v_cm\r\n"));
    assert!(agree(&read_csv(&csv), &lengths(&sheet, 1.0), 1e-12));
    // One point moved is found.
    let text = String::from_utf8(csv).unwrap();
    let row = text.lines().nth(7).unwrap();
    let moved = text.replacen(row, &row.replacen("0.", "0.3", 1), 1);
    assert!(!agree(&read_csv(moved.as_bytes()), &lengths(&sheet, 1.0), 1e-12));

    let report = serde_json::to_value(sheet.report()).unwrap();
    assert_eq!((&report["unit"], &report["sections"][1]["closed"]), (&"cm".into(), &2.into()));
    let first = &report["sections"][0]["lines"][0];
    assert_eq!(
        first["points"].as_array().unwrap().len(),
        sheet.layers[0].section.lines[0].points.len()
    );
    assert!(
        (first["circle"]["radius"].as_f64().unwrap() - 2.75).abs() < 0.01,
        "{}",
        first["circle"]
    );
}

#[test]
fn right_and_up_in_drawings_are_right_and_up_of_the_statue() {
    // A cube that reaches farther right, up and to the front than left, down and back.
    let (mut vertices, faces) = cube(-1.0, 1.0);
    for (i, far) in [(0, 1.5), (1, 2.0), (2, 3.0)] {
        vertices.iter_mut().filter(|v| v[i] > 0.0).for_each(|v| v[i] = far);
    }
    let model = Model::of(&ply(&vertices, &faces), |o| o.precision = Some(1.0 / 1024.0));
    let near = |a: DVec2, x: f64, y: f64| a.distance(DVec2::new(x, y)) < 1e-3;
    for (plane, low, high) in [
        // From the front: x to the right, y up. From behind: x to the left.
        (across(2, 0.5), [-1.0, -1.0], [1.5, 2.0]),
        (Plane::from_equation(-DVec3::Z, -0.5).unwrap(), [-1.5, -1.0], [1.0, 2.0]),
        // From the statue's left (+x) its front is on the left.
        (across(0, 0.5), [-3.0, -1.0], [1.0, 2.0]),
        // From above the front is below, from beneath above.
        (across(1, 0.5), [-1.0, -3.0], [1.5, 1.0]),
        (Plane::from_equation(-DVec3::Y, -0.5).unwrap(), [-1.0, -1.0], [1.5, 3.0]),
    ] {
        let section = model.cut(&plane);
        let [min, max] = section.bounds().unwrap();
        assert!(near(min, low[0], low[1]) && near(max, high[0], high[1]), "{min} {max}");
        assert!(section.measures().area > 0.0);
        let p = section.lines[0].points[1];
        assert!(section.frame.to_space(section.frame.to_plane(p)).distance(p) < 1e-12);
    }
}

#[test]
fn what_has_no_unit_is_not_drawn_to_scale() {
    let model = Model::of(&torus(2.0, 0.75, 20), |_| {});
    let unknown = sheet(&model, None);
    for refused in [unknown.to_svg(1.0), unknown.to_dxf()] {
        let message = refused.unwrap_err().to_string();
        assert!(message.contains("--unit mm"), "{message}");
    }
    assert!(unknown.to_csv().starts_with(b"section,line,closed,point,x,y,z,u,v\r\n"));
    let declared = sheet(&model, Some(Unit::Inch));
    let text = String::from_utf8(declared.to_svg(1.0).unwrap()).unwrap();
    assert!(text.contains("as declared for this section; its file says unknown"), "{text:.900}");
    assert!(agree(&read_svg(text.as_bytes()).1, &lengths(&declared, 25.4), 1e-4));
}

#[test]
fn the_command_writes_drawings_and_says_what_misses() {
    let model = Model::of(&torus(2.0, 0.75, 40), |o| o.unit = Unit::Millimetre);
    let run = |arguments: &[&str]| {
        let mut command = program("hlod-render");
        let output = command.arg("section").arg(model.file()).args(arguments).output().unwrap();
        let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
        (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
    };
    let file = |name: &str| model.folder.path().join(name).display().to_string();
    let (svg, json) = (file("out.svg"), format!("--json={}", file("out.json")));
    let planes = ["--plane", "y=0", "--through", "0,0,0/0,1,0/0,0,1"];
    let (status, table, _) = run(&[&planes[..], &["--svg", &svg, &json]].concat());
    assert_eq!(status, 0);
    assert!(table.contains("section-1") && table.contains("section-2"), "{table}");
    assert_eq!(read_svg(&std::fs::read(&svg).unwrap()).1.len(), 2);
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(file("out.json")).unwrap()).unwrap();
    assert_eq!(report["sections"].as_array().unwrap().len(), 2);

    let (status, table, why) = run(&["--plane", "y=1", "--plane", "y=0.5"]);
    assert!(status == 0 && table.contains("misses the scan"), "{table}{why}");
    let (status, _, why) = run(&["--plane", "y=1"]);
    assert!(status == 1 && why.contains("no plane meets the scan"), "{why}");
    let into_input = model.file().display().to_string();
    for wrong in [
        &[][..],
        &["--plane", "q=1"],
        &["--plane", "y=0", "--parallel", "3"],
        &["--plane", "y=0", "--spacing", "3"],
        &["--plane", "x=1", "--plane", "x=1", "--plane", "x=1", "--plane", "x=1"],
        &["--plane", "y=0", "--svg", &into_input],
        &["--plane", "y=0", "--svg", &svg, "--scale", "5"],
    ] {
        let (status, _, why) = run(wrong);
        assert!(status == 2 && !why.contains("panicked"), "{wrong:?}: {why}");
    }
    assert!(Leaves::open(&model.file()).is_ok(), "the input is still there");
    let left: Vec<_> = std::fs::read_dir(model.folder.path()).unwrap().flatten().collect();
    assert!(left.iter().all(|entry| !entry.file_name().to_string_lossy().ends_with(".part")));
}
