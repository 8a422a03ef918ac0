//! OBJ: one vertex for each `v`, whatever the groups.

use glam::{DVec3, Vec3};
use hlod_scan::{Place, ScanError, ScanFormat};

use crate::{Files, load_one, read, read_path, refusal, volume};

const CUBE: &str = "# a cube in two groups\nmtllib missing.mtl\no cube\n\
    v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
    g bottom\nusemtl stone\nf 4 3 2 1\ng rest\nf 5/1 6/2 7/3 8/4\nf 1 2 6 5\n\
    f 2 3 7 6\nf -6 -5 -1 -2\nf 4 1 5 8\n";

#[test]
fn groups_share_their_vertices() {
    let whole = read("a.obj", CUBE).expect("a valid file");
    assert_eq!(whole.header.format, ScanFormat::Obj);
    assert_eq!(whole.header.vertices_declared, Some(8));
    assert_eq!((whole.positions.len(), whole.triangles.len()), (8, 12));
    assert!((volume(&whole.positions, &whole.triangles) - 1.0).abs() < 1e-12);
    assert_eq!(whole.report.polygons_triangulated, 6);
    let skipped = ["statement mtllib", "statement o", "statement g", "statement usemtl"];
    assert_eq!(whole.report.skipped, skipped);
    // The same text under no telling name.
    assert_eq!(read("scan.txt", CUBE).expect("by content").triangles.len(), 12);
    let crlf = CUBE.replace('\n', "\r\n");
    assert_eq!(read("a.obj", crlf).expect("CR LF").triangles.len(), 12);
}

/// An independent reader must see the same surface.
#[test]
fn agrees_with_another_reader() {
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let no_materials = |_: &std::path::Path| Ok(Default::default());
    let (models, _) =
        tobj::load_obj_buf(&mut CUBE.as_bytes(), &options, no_materials).expect("a valid file");
    let theirs: f64 = models
        .iter()
        .map(|model| {
            let positions = model.mesh.positions.chunks_exact(3);
            let positions: Vec<DVec3> =
                positions.map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into())).collect();
            let triangles: Vec<[u32; 3]> =
                model.mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
            volume(&positions, &triangles)
        })
        .sum();
    let ours = read("a.obj", CUBE).expect("a valid file");
    assert!((volume(&ours.positions, &ours.triangles) - theirs).abs() < 1e-6);
}

#[test]
fn normals_of_corners_meet_in_their_vertex() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nvn 2 0 0\nvn 0 3 0\nvn nan 0 0\n\
        f 1//1 2//1 3//-1\nf 2/1/2 1/1/2 3\n";
    let files = Files::new();
    let path = files.write("a.obj", text);
    let whole = read_path(&path).expect("a valid file");
    let half = 0.5f32.sqrt();
    let mean = Vec3::new(half, half, 0.0);
    assert!(whole.normals[0].abs_diff_eq(mean, 1e-6), "{}", whole.normals[0]);
    assert!(whole.normals[1].abs_diff_eq(mean, 1e-6));
    // Named with a useless normal, and not named at all.
    assert_eq!(whole.normals[2..], [Vec3::ZERO, Vec3::ZERO]);
    assert_eq!(load_one(path).expect("a valid file").normals[3], Vec3::Z);
}

#[test]
fn colours_weights_and_continued_lines() {
    let text = "v 0 0 0 1 0.5 0\nv 1 0 \\\n0 0 0 1 0.2\nv 0 1 0 1.0\nf 1 \\\n 2 3 # end\n";
    let whole = read("a.obj", text).expect("a valid file");
    assert_eq!(whole.colours, [[255, 128, 0, 255], [0, 0, 255, 51], [255; 4]]);
    assert_eq!(whole.positions[1], DVec3::X);
    assert_eq!(whole.triangles, [[0, 1, 2]]);
    let bytes_not_units = "v 0 0 0 255 0 0\nv 1 0 0 0 0 0\nv 0 1 0 0 0 0\nf 1 2 3\n";
    let whole = read("a.obj", bytes_not_units).expect("a valid file");
    assert!(whole.report.warnings[0].contains("outside 0..1"));
}

#[test]
fn faces_may_name_later_vertices_and_doubles_survive() {
    let text = "f 1 2 3\nv 0.123456789012345 0 0\nv 1 0 0\nv 0 1 0\n";
    let whole = read("a.obj", text).expect("a valid file");
    assert_eq!(whole.positions[0].x, 0.123456789012345);
    assert_eq!(whole.triangles, [[0, 1, 2]]);
}

#[test]
fn wrong_content_is_told_with_its_line() {
    let three = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (line, told) in [
        ("f 1 2 4", "names vertex 3"),
        ("f 1 2 0", "names vertex -1"),
        ("f 1 2 -4", "names vertex -1"),
        ("f 1 2 9223372036854775807", "names vertex"),
        ("f 1 2 -9223372036854775808", "names vertex"),
        ("f 1 2 99999999999999999999", "not a corner"),
        ("f 1 2 x", "not a corner"),
        ("f 1 2 3//6148914691236517205", "names a normal"),
        ("v 1 2", "needs 3 numbers"),
        ("v 1 2 z", "`z` is not a number"),
        ("v 1 2 nan", "vertex 3"),
    ] {
        let (error, message) = refusal("a.obj", format!("{three}{line}\n"));
        assert!(message.contains(told), "{message}");
        assert_eq!(error.at().place, Place::Line(4), "{message}");
    }
    assert!(matches!(refusal("a.obj", three).0, ScanError::PointsOnly { .. }));
    assert!(matches!(refusal("a.obj", "# nothing\n").0, ScanError::NoGeometry { .. }));
    let endless = format!("{three}f 1 2 3\\");
    assert_eq!(read("a.obj", endless).expect("a valid file").triangles.len(), 1);
    let long = format!("# {}\n{three}f 1 2 3\n", "x".repeat(300_000));
    assert!(refusal("a.obj", long).1.contains("longer than"));
}

/// A wavy sheet of quads, more than fits into a small room: faces count backwards and name
/// vertices that come much later.
fn sheet(n: u32) -> String {
    use std::fmt::Write;
    let mut text = String::new();
    let (mut written, at) = (0i64, |i: u32, j: u32| i64::from(i * n + j));
    for i in 0..n {
        // The first row's faces come before its second row's vertices.
        for j in 0..n {
            let (x, y) = (f64::from(i), f64::from(j));
            let z = (0.1 * x).sin() + (0.13 * y).cos();
            let red = f64::from(i % 5) / 4.0;
            writeln!(text, "v {x} {y} {z} {red} 0.5 0\nvn {} {} 1", -z, 0.3 * z).unwrap();
            written += 1;
        }
        for j in 0..n - 1 {
            if i + 1 == n {
                continue;
            }
            let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let word = |v: i64| match v < written && v % 3 == 0 {
                true => format!("{0}//{0}", v - written),
                false => format!("{0}//{0}", v + 1),
            };
            writeln!(text, "f {}", corners.map(word).join(" ")).unwrap();
        }
    }
    text
}

#[test]
fn reads_the_same_in_any_room() {
    let files = Files::new();
    let (path, scratch) = (files.write("a.obj", sheet(180)), files.write("scratch/empty", ""));
    let whole = read_path(&path).expect("a valid file");
    assert_eq!((whole.positions.len(), whole.triangles.len()), (180 * 180, 2 * 179 * 179));
    assert!(whole.header.has_normals && whole.header.has_colours);
    let mut told = Vec::new();
    let mut progress = |bytes: u64| {
        told.push(bytes);
        true
    };
    let folder = scratch.parent().expect("a folder");
    let options = hlod_scan::ReadOptions {
        memory_bytes: 0,
        scratch: folder,
        colour: Default::default(),
        transform: None,
        progress: &mut progress,
        keep: &[],
    };
    let reader = hlod_scan::ScanReader::open_within(&path, options).expect("a valid file");
    let again = crate::read_all(reader).expect("a valid file");
    assert!(again.positions == whole.positions, "positions");
    assert!(again.normals == whole.normals, "normals");
    assert!(again.colours == whole.colours, "colours");
    assert!(again.triangles == whole.triangles, "triangles");
    assert!(told.len() >= 2 && told.is_sorted(), "{told:?}");
    assert_eq!(std::fs::read_dir(folder).expect("a folder").count(), 1, "something was left");
    let options = hlod_scan::ReadOptions {
        memory_bytes: 0,
        scratch: folder,
        colour: Default::default(),
        transform: None,
        progress: &mut |_| false,
        keep: &[],
    };
    let stopped = hlod_scan::ScanReader::open_within(&path, options);
    assert!(matches!(stopped, Err(ScanError::Stopped { .. })));

    // Another reader sees the same triangles, corner by corner, and the same colours.
    let (models, _) = tobj::load_obj(&path, &tobj::LoadOptions::default()).expect("a valid file");
    let theirs = &models[0].mesh;
    // It leaves quads as they are, and numbers vertices as faces first name them.
    assert_eq!(theirs.face_arities.len(), 179 * 179);
    let number = |v: u32| {
        let p = &theirs.positions[3 * v as usize..];
        (p[0] * 180.0 + p[1]) as u32
    };
    let mut quads: Vec<Vec<u32>> = theirs
        .indices
        .chunks(4)
        .map(|quad| sorted(quad.iter().map(|v| number(*v)).collect()))
        .collect();
    let pairs = whole.triangles.chunks(2);
    let mut ours: Vec<Vec<u32>> = pairs.map(|pair| sorted(pair.concat())).collect();
    quads.sort_unstable();
    ours.sort_unstable();
    assert!(quads == ours, "the same quads");
    for (v, colour) in (0..).zip(theirs.vertex_color.chunks(3)) {
        let red = (colour[0] * 255.0).round() as u8;
        assert_eq!(red, whole.colours[number(v) as usize][0]);
    }
}

fn sorted(mut corners: Vec<u32>) -> Vec<u32> {
    corners.sort_unstable();
    corners.dedup();
    corners
}
