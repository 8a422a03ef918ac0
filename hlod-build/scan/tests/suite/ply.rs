//! PLY: each feature by a file small enough to read.

use glam::{DVec3, Vec3};
use hlod_scan::{Place, ScanError, ScanFormat};

use crate::{Files, load_one, read, read_path, refusal, volume};

const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\n\
    property float x\nproperty float y\nproperty float z\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

#[test]
fn an_ascii_triangle() {
    let whole = read("a.ply", TRIANGLE).expect("a valid file");
    assert_eq!(whole.header.format, ScanFormat::PlyAscii);
    assert_eq!(whole.header.vertices_declared, Some(3));
    assert_eq!(whole.header.faces_declared, Some(1));
    assert!(!whole.header.has_normals && !whole.header.is_triangle_soup);
    assert_eq!(whole.positions, [DVec3::ZERO, DVec3::X, DVec3::Y]);
    assert_eq!(whole.triangles, [[0, 1, 2]]);
    assert!(whole.report.warnings.is_empty() && whole.report.skipped.is_empty());
}

#[test]
fn windows_line_ends_blank_lines_and_a_missing_last_one() {
    let crlf = TRIANGLE.replace('\n', "\r\n");
    assert_eq!(read("a.ply", crlf).expect("CR LF").triangles, [[0, 1, 2]]);
    assert_eq!(read("a.ply", TRIANGLE.trim_end()).expect("cut").triangles.len(), 1);
    let airy = TRIANGLE.replace("1 0 0\n", "\n\n 1\t0 \n 0\n\n");
    assert_eq!(read("a.ply", airy).expect("airy").positions[1], DVec3::X);
}

#[test]
fn content_decides_before_the_extension() {
    let whole = read("a.stl", TRIANGLE).expect("a PLY by its magic");
    assert_eq!(whole.header.format, ScanFormat::PlyAscii);
}

#[test]
fn doubles_keep_their_digits_and_floats_are_floats() {
    let text = TRIANGLE.replace("1 0 0\n", "123456.789012345 0.1 0\n");
    let text = text.replace("property float x", "property double x");
    let position = read("a.ply", text).expect("a valid file").positions[1];
    assert_eq!(position, DVec3::new(123456.789012345, f64::from(0.1f32), 0.0));
}

#[test]
fn unknown_elements_and_properties_are_named() {
    let text = "ply\nformat ascii 1.0\ncomment one\nobj_info two\nelement camera 2\n\
        property float view_px\nproperty list uchar int tags\nelement vertex 3\n\
        property float confidence\nproperty float x\nproperty list uchar float spin\n\
        property float y\nproperty float z\nproperty float nx\nelement nothing 99999999999\n\
        element face 1\nproperty uchar flags\nproperty list uint8 uint32 vertex_index\n\
        property list uchar float texcoord\nend_header\n\
        1.5 2 7 8 2.5 0\n\
        0.5 0 2 1 1 0 0 9\n0.5 1 0 0 0 9\n0.5 0 1 3.5 1 0 9\n\
        4 3 2 1 0 2 0.5 0.5\n";
    let whole = read("a.ply", text).expect("a valid file");
    assert_eq!(whole.positions, [DVec3::ZERO, DVec3::X, DVec3::Y]);
    assert_eq!(whole.triangles, [[2, 1, 0]]);
    assert_eq!(
        whole.report.skipped,
        [
            "element camera",
            "property vertex.confidence",
            "property vertex.spin",
            "property vertex.nx",
            "element nothing",
            "property face.flags",
            "property face.texcoord",
        ]
    );
}

#[test]
fn normals_are_made_unit_and_useless_ones_are_absent() {
    let text = TRIANGLE
        .replace(
            "property float z\n",
            "property float z\nproperty float nx\nproperty float ny\nproperty double nz\n",
        )
        .replace("0 0 0\n1 0 0\n0 1 0\n", "0 0 0 0 3 4\n1 0 0 0 0 0\n0 1 0 nan 0 1\n");
    let files = Files::new();
    let path = files.write("a.ply", text);
    let whole = read_path(&path).expect("a valid file");
    assert_eq!(whole.normals, [Vec3::new(0.0, 0.6, 0.8), Vec3::ZERO, Vec3::ZERO]);
    assert_eq!(whole.report.normals_absent, 2);
    // `load` computes what is absent, and only that.
    let mesh = load_one(path).expect("a valid file");
    assert_eq!(mesh.normals, [Vec3::new(0.0, 0.6, 0.8), Vec3::Z, Vec3::Z]);
    assert!(!mesh.normals_computed);
}

#[test]
fn colours_of_every_type() {
    let coloured = |of: &str, prefix: &str, alpha: &str, values: [&str; 3]| {
        let mut properties = String::from("property float z\n");
        for name in ["red", "green", "blue"] {
            properties += &format!("property {of} {prefix}{name}\n");
        }
        properties += alpha;
        let [a, b, c] = values;
        let vertices = format!("0 0 0 {a}\n1 0 0 {b}\n0 1 0 {c}\n");
        let text = TRIANGLE
            .replace("property float z\n", &properties)
            .replace("0 0 0\n1 0 0\n0 1 0\n", &vertices);
        read("a.ply", text).expect("a valid file").colours
    };
    let expected = [[0, 128, 255, 255], [1, 2, 3, 255], [255, 0, 0, 255]];
    assert_eq!(coloured("uchar", "", "", ["0 128 255", "1 2 3", "255 0 0"]), expected);
    assert_eq!(
        coloured("ushort", "diffuse_", "", ["0 32896 65535", "257 514 771", "65535 0 0"]),
        expected
    );
    assert_eq!(
        coloured("float", "", "", ["0 0.502 1", "0.0039 0.0078 0.0118", "7 -1 nan"]),
        expected
    );
    let alpha = "property uchar alpha\n";
    assert_eq!(
        coloured("uchar", "", alpha, ["0 128 255 7", "1 2 3 0", "255 0 0 255"]),
        [[0, 128, 255, 7], [1, 2, 3, 0], [255, 0, 0, 255]]
    );
}

#[test]
fn faces_may_come_before_vertices() {
    let text = "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_index\n\
        element vertex 4\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
        3 0 1 2\n4 0 1 2 3\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
    let files = Files::new();
    let mesh = load_one(files.write("a.ply", text)).expect("a valid file");
    assert_eq!(mesh.triangles.len(), 3);
    assert_eq!(mesh.reports[0].polygons_triangulated, 1);
    assert_eq!(mesh.normals, [Vec3::Z; 4]);
    let (error, _) = refusal("a.ply", text.replace("4 0 1 2 3", "4 0 1 2 4"));
    assert!(matches!(error, ScanError::IndexOutOfRange { face: 1, index: 4, vertices: 4, .. }));
}

#[test]
fn polygons_are_cut_inside() {
    // A cube of quads, and on top an arrow with a dent of seven corners.
    let cube = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n\
        property float z\nelement face 7\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1\n\
        4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n2 0 1\n";
    let whole = read("a.ply", cube).expect("a valid file");
    assert_eq!(whole.triangles.len(), 12);
    assert!((volume(&whole.positions, &whole.triangles) - 1.0).abs() < 1e-12);
    assert_eq!(whole.report.faces_read, 7);
    assert_eq!(whole.report.polygons_triangulated, 6);
    assert_eq!(whole.report.degenerate_faces, 1);
}

/// Binary with strips: the winding of every other triangle alternates, a restart
/// begins anew, stitches vanish.
#[test]
fn strips_alternate_and_restart() {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 5\nproperty short x\n\
        property int8 y\nproperty uint16 z\nelement tristrips 2\nproperty uchar before\n\
        property list int int vertex_indices\nproperty double after\nend_header\n"
        .to_vec();
    for [x, y, z] in [[-300i16, 0, 0], [1, -1, 1], [2, 2, 60], [3, 3, 3], [4, 4, 4]] {
        bytes.extend(x.to_be_bytes());
        bytes.push(y as u8);
        bytes.extend((z as u16).to_be_bytes());
    }
    for strip in [&[0, 1, 2, 3, -1, 1, 2, 3, -1, -1, 4, 3][..], &[0, 1, 1, 2, 3]] {
        bytes.push(9);
        bytes.extend((strip.len() as i32).to_be_bytes());
        bytes.extend(strip.iter().flat_map(|index: &i32| index.to_be_bytes()));
        bytes.extend(1.5f64.to_be_bytes());
    }
    let whole = read("a.ply", &bytes).expect("a valid file");
    assert_eq!(whole.header.format, ScanFormat::PlyBigEndian);
    assert_eq!(whole.positions[0], DVec3::new(-300.0, 0.0, 0.0));
    assert_eq!(whole.positions[2], DVec3::new(2.0, 2.0, 60.0));
    // The last strip: 0 1 1 and 1 1 2 are stitches; 1 2 3 is the third, as written.
    assert_eq!(whole.triangles, [[0, 1, 2], [2, 1, 3], [1, 2, 3], [1, 2, 3]]);
    assert_eq!((whole.report.strips, whole.report.strip_stitches), (4, 2));
    let skipped = ["property tristrips.before", "property tristrips.after"];
    assert_eq!(whole.report.skipped, skipped);
}

#[test]
fn a_strip_is_streamed_over_batches() {
    let count = 200_000u32;
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\n\
         property float y\nproperty float z\nelement tristrips 1\n\
         property list uint uint vertex_indices\nend_header\n"
    )
    .into_bytes();
    for i in 0..count {
        for value in [i as f32, (i % 2) as f32, 0.0] {
            bytes.extend(value.to_le_bytes());
        }
    }
    bytes.extend((count + 1).to_le_bytes());
    bytes.extend(u32::MAX.to_le_bytes());
    bytes.extend((0..count).flat_map(u32::to_le_bytes));
    let whole = read("a.ply", &bytes).expect("a valid file");
    assert_eq!(whole.triangles.len(), count as usize - 2);
    let all = whole.triangles.iter().zip(0u32..);
    for (triangle, i) in all {
        let expected = match i % 2 {
            0 => [i, i + 1, i + 2],
            _ => [i + 1, i, i + 2],
        };
        assert_eq!(*triangle, expected);
    }
}

#[test]
fn what_follows_the_last_element_is_a_warning() {
    let whole = read("a.ply", format!("{TRIANGLE} \n\n")).expect("white space");
    assert!(whole.report.warnings.is_empty());
    let whole = read("a.ply", format!("{TRIANGLE}surplus")).expect("a valid file");
    assert_eq!(whole.report.warnings, ["7 bytes after the last element were not read"]);
}

#[test]
fn wrong_content_is_told_with_its_place() {
    let line = |text: &str| {
        let (error, message) = refusal("a.ply", text);
        (error.at().place.clone(), message)
    };
    let (place, message) = line(&TRIANGLE.replace("1 0 0", "1 zero 0"));
    assert_eq!(place, Place::Line(11));
    assert!(message.contains("`zero`"), "{message}");

    for number in ["nan", "inf", "-inf", "1e39"] {
        let text = TRIANGLE.replace("1 0 0", &format!("1 {number} 0"));
        let (error, _) = refusal("a.ply", text);
        assert!(matches!(error, ScanError::NotFinite { vertex: 1, .. }), "{error}");
        assert_eq!(error.at().place, Place::Line(11));
    }
    for index in [-1, 3, 2_000_000_000] {
        let text = TRIANGLE.replace("3 0 1 2", &format!("3 0 1 {index}"));
        let (error, message) = refusal("a.ply", text);
        assert!(matches!(error, ScanError::IndexOutOfRange { face: 0, .. }), "{message}");
        assert_eq!(error.at().place, Place::Line(13));
        assert!(message.contains("0 to 2"), "{message}");
    }
    let (place, _) = line(&TRIANGLE.replace("3 0 1 2", "3 0 1 1.5"));
    assert_eq!(place, Place::Line(13));
    let (_, message) = line(&TRIANGLE.replace("3 0 1 2", "-3 0 1 2"));
    assert!(message.contains("cannot have -3 entries"), "{message}");
}

#[test]
fn wrong_headers_are_refused() {
    for (from, to, told) in [
        ("format ascii 1.0", "format ascii 2.0", "no line of a PLY header"),
        ("format ascii 1.0", "format morse 1.0", "`morse`"),
        ("format ascii 1.0", "comment none", "no `format`"),
        ("property float y", "property float x", "declared twice"),
        ("property float y", "property quad y", "declares no PLY property"),
        ("property float y\n", "", "no number property `y`"),
        ("element face", "element vertex", "declared twice"),
        ("element vertex 3", "element vertex -3", "not a count"),
        ("element vertex 3\n", "", "before any element"),
        ("list uchar int", "list float int", "declares no PLY property"),
        ("end_header\n", "end of header\n", "no line of a PLY header"),
        ("ply\n", "plyx\n", "begins with the line `ply`"),
    ] {
        let (error, message) = refusal("a.ply", TRIANGLE.replacen(from, to, 1));
        assert!(message.contains(told), "{message}");
        assert!(!error.is_usage());
    }
    let endless = format!("ply\nformat ascii 1.0\n{}", "comment x\n".repeat(200_000));
    assert!(refusal("a.ply", endless).1.contains("no `end_header`"));
}

#[test]
fn impossible_counts_are_refused_before_anything_is_read() {
    let (error, message) = refusal("a.ply", TRIANGLE.replace("vertex 3", "vertex 4000000000000"));
    assert!(
        matches!(error, ScanError::CountTooLarge { declared: 4_000_000_000_000, possible: 4, .. }),
        "{message}"
    );
    let (error, _) = refusal("a.ply", TRIANGLE.replace("face 1", "face 18446744073709551615"));
    assert!(matches!(error, ScanError::CountTooLarge { declared: u64::MAX, .. }));

    // A list length is a count like any other.
    let binary = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n\
        property float y\nproperty float z\nelement tristrips 1\n\
        property list uint int vertex_indices\nend_header\n\
        \0\0\0\0\0\0\0\0\0\0\0\0\xff\xff\xff\xff\0\0\0\0";
    let (error, message) = refusal("a.ply", binary);
    assert!(
        matches!(error, ScanError::CountTooLarge { declared: 0xffff_ffff, possible: 1, .. }),
        "{message}"
    );
}

#[test]
fn a_face_of_very_many_corners_is_refused() {
    let corners = vec!["0"; 5000].join(" ");
    let text =
        TRIANGLE.replace("list uchar", "list int").replace("3 0 1 2", &format!("5000 {corners}"));
    let (error, _) = refusal("a.ply", text);
    assert!(matches!(error, ScanError::Unsupported { .. }), "{error}");
}

#[test]
fn points_nothing_and_slivers() {
    let points = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
        property float z\nend_header\n0 0 0 1 1 1\n";
    let cloud = read("a.ply", points).expect("a point cloud");
    assert!(cloud.header.is_point_cloud && cloud.triangles.is_empty());
    assert_eq!(cloud.positions, [DVec3::ZERO, DVec3::ONE]);
    // An element of faces without a face is no surface either.
    let faces = "element face 0\nproperty list uchar int vertex_indices\nend_header";
    let cloud = read("a.ply", points.replace("end_header", faces)).expect("a point cloud");
    assert!(cloud.header.is_point_cloud);
    // Where a mesh is needed it is told at once.
    let error = load_one(Files::new().write("a.ply", points)).expect_err("no mesh");
    assert!(matches!(error, ScanError::PointsOnly { vertices: 2, .. }), "{error}");

    let nothing = "ply\nformat ascii 1.0\nend_header\n";
    assert!(matches!(refusal("a.ply", nothing).0, ScanError::NoGeometry { .. }));
    let degenerate = TRIANGLE.replace("3 0 1 2", "3 0 1 1");
    let (error, _) = refusal("a.ply", degenerate);
    assert!(matches!(error, ScanError::AllDegenerate { faces: 1, .. }));
    let faces_only = "ply\nformat ascii 1.0\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n3 0 1 2\n";
    assert!(matches!(refusal("a.ply", faces_only).0, ScanError::IndexOutOfRange { .. }));
}

/// Numbers that vertices have besides shape come as they are in every encoding and of every type; what is no
/// number, and what a file does not have, is NaN.
#[test]
fn properties_that_are_asked_for_are_kept() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty uchar label\n\
        property float y\nproperty double quality\nproperty float z\nproperty short depth\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 200 0 0.1 0 -7\n1 3 0 nan 0 8\n0 4 1 inf 0 9\n3 0 1 2\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    std::fs::write(&path, text).unwrap();
    let read = |keep: &[&str]| {
        let keep: Vec<String> = keep.iter().map(|name| name.to_string()).collect();
        let progress = &mut |_| true;
        let scratch = folder.path();
        let options = hlod_scan::ReadOptions {
            memory_bytes: 0,
            scratch,
            colour: hlod_scan::ColourSource::Auto,
            transform: None,
            progress,
            keep: &keep,
        };
        let mut reader = hlod_scan::ScanReader::open_within(&path, options).unwrap();
        assert_eq!(reader.header().scalars, ["label", "quality", "depth"]);
        let hlod_scan::Batch::Vertices(batch) = reader.next_batch().unwrap().unwrap() else {
            panic!("vertices come first");
        };
        while reader.next_batch().unwrap().is_some() {}
        (batch.scalars, reader.report().skipped.clone())
    };
    let (scalars, skipped) = read(&["quality", "none", "label"]);
    assert_eq!((scalars[0][0], scalars[2].as_slice()), (0.1, &[200.0, 3.0, 4.0][..]));
    assert!(scalars[0][1].is_nan() && scalars[0][2].is_nan());
    assert!(scalars[1].iter().all(|v| v.is_nan()) && scalars[1].len() == 3);
    assert_eq!(skipped, ["property vertex.depth"]);
    let (scalars, skipped) = read(&[]);
    assert!(scalars.is_empty() && skipped.len() == 3);
}
