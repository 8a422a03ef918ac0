//! glTF 2.0: documents built here, piece by piece.

use glam::{DVec3, Vec3};
use hlod_scan::{ScanError, ScanFormat};

use crate::{Files, Whole, load_one, read, read_path, refusal, volume};

/// Corners of a tetrahedron, its normals, and outward triangles.
const POSITIONS: [[f32; 3]; 4] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
const NORMALS: [[f32; 3]; 4] = [[-1., -1., -1.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
const TRIANGLES: [u16; 12] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];

/// Positions at byte 0, normals at 48, indices at 96, colours at 120.
fn data() -> Vec<u8> {
    let floats = POSITIONS.iter().chain(&NORMALS).flatten();
    let mut bytes: Vec<u8> = floats.flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend(TRIANGLES.iter().flat_map(|index| index.to_le_bytes()));
    bytes.extend([0, 55, 255, 128].repeat(4));
    bytes
}

/// A document over `data`; `nodes` is the text of its node list.
fn document(buffer: &str, nodes: &str) -> String {
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "buffers": [{buffer}], "scene": 0,
        "scenes": [{{"nodes": [0]}}], "nodes": [{nodes}],
        "meshes": [{{"primitives": [{{"mode": 4, "indices": 2,
            "attributes": {{"POSITION": 0, "NORMAL": 1, "COLOR_0": 3, "_X": 0}}}}]}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 48}},
            {{"buffer": 0, "byteOffset": 48, "byteLength": 48}},
            {{"buffer": 0, "byteOffset": 96, "byteLength": 24}},
            {{"buffer": 0, "byteOffset": 120, "byteLength": 16}}],
        "accessors": [
            {{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}},
            {{"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3"}},
            {{"bufferView": 2, "componentType": 5123, "count": 12, "type": "SCALAR"}},
            {{"bufferView": 3, "componentType": 5121, "count": 4, "type": "VEC4",
              "normalized": true}}]}}"#
    )
}

const IN_CHUNK: &str = r#"{"byteLength": 136}"#;

pub fn glb(text: &str, data: &[u8]) -> Vec<u8> {
    let padded = format!("{text}{}", " ".repeat(text.len().next_multiple_of(4) - text.len()));
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    let length = 12 + 8 + padded.len() + 8 + data.len();
    bytes.extend((length as u32).to_le_bytes());
    bytes.extend((padded.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(padded.as_bytes());
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(data);
    bytes
}

pub fn base64(bytes: &[u8]) -> String {
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let mut bits = [0; 3];
        bits[..group.len()].copy_from_slice(group);
        let bits = u32::from_be_bytes([0, bits[0], bits[1], bits[2]]);
        for place in 0..4 {
            let digit = digits[(bits >> (18 - 6 * place)) as usize & 63];
            text.push(if place <= group.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

fn tetrahedron(nodes: &str) -> Whole {
    read("a.glb", glb(&document(IN_CHUNK, nodes), &data())).expect("a valid file")
}

#[test]
fn a_binary_file() {
    let whole = tetrahedron(r#"{"mesh": 0}"#);
    assert_eq!(whole.header.format, ScanFormat::Glb);
    assert_eq!(whole.header.vertices_declared, Some(4));
    assert_eq!(whole.header.faces_declared, Some(4));
    assert_eq!(whole.positions, POSITIONS.map(|p| DVec3::from_array(p.map(f64::from))));
    assert_eq!(whole.triangles[3], [1, 2, 3]);
    assert!(whole.normals[0].abs_diff_eq(Vec3::splat(-(1f32 / 3.).sqrt()), 1e-6));
    // Linear 55/255 is sRGB 128; alpha stays linear.
    assert_eq!(whole.colours, [[0, 128, 255, 128]; 4]);
    assert!((volume(&whole.positions, &whole.triangles) - 1.0 / 6.0).abs() < 1e-9);
}

#[test]
fn buffers_in_uris_and_sibling_files() {
    let files = Files::new();
    let uri = format!("data:application/octet-stream;base64,{}", base64(&data()));
    let buffer = format!(r#"{{"byteLength": 136, "uri": "{uri}"}}"#);
    let whole = read("a.gltf", document(&buffer, r#"{"mesh": 0}"#)).expect("a data URI");
    assert_eq!(whole.header.format, ScanFormat::Gltf);
    assert_eq!(whole.triangles.len(), 4);

    files.write("parts/the data.bin", data());
    let named = |name: &str| {
        let buffer = format!(r#"{{"byteLength": 136, "uri": "{name}"}}"#);
        read_path(&files.write("a.gltf", document(&buffer, r#"{"mesh": 0}"#)))
    };
    assert_eq!(named("parts/the%20data.bin").expect("a sibling").triangles.len(), 4);
    for (name, told) in [
        ("../data.bin", "outside the folder"),
        ("parts/../../data.bin", "outside the folder"),
        ("%2e%2e/data.bin", "outside the folder"),
        ("/etc/hostname", "outside the folder"),
        ("file:///etc/hostname", "outside the folder"),
        ("C:\\\\data.bin", "outside the folder"),
        ("", "outside the folder"),
        ("data.bin", "not there"),
        ("parts", "not a regular file"),
        ("bad%2", "wrong % sequence"),
    ] {
        let message = named(name).expect_err("refused").to_string();
        assert!(message.contains(told), "{name}: {message}");
    }
}

#[cfg(unix)]
#[test]
fn links_do_not_lead_outside() {
    let (files, outside) = (Files::new(), Files::new());
    let secret = outside.write("secret.bin", data());
    let buffer = r#"{"byteLength": 136, "uri": "link.bin"}"#;
    let path = files.write("a.gltf", document(buffer, r#"{"mesh": 0}"#));
    std::os::unix::fs::symlink(secret, path.with_file_name("link.bin")).expect("a link");
    let message = read_path(&path).expect_err("refused").to_string();
    assert!(message.contains("outside the folder"), "{message}");
}

#[test]
fn transforms_instances_and_mirrors() {
    // A parent that moves, a child scaled and turned a quarter round z, a mirrored one.
    let whole = tetrahedron(
        r#"{"children": [1, 2], "translation": [10, 0, 0]},
        {"mesh": 0, "scale": [2, 1, 1], "rotation": [0, 0, 0.70710678, 0.70710678]},
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 0, 1]}"#,
    );
    assert_eq!((whole.positions.len(), whole.triangles.len()), (8, 8));
    // x is doubled, then becomes y.
    assert!(whole.positions[1].abs_diff_eq(DVec3::new(10.0, 2.0, 0.0), 1e-6));
    assert!(whole.positions[2].abs_diff_eq(DVec3::new(9.0, 0.0, 0.0), 1e-6));
    assert_eq!(whole.positions[5], DVec3::new(9.0, 5.0, 0.0));
    // Both face outwards.
    let (first, second) = whole.triangles.split_at(4);
    let centre = DVec3::new(10.0, 0.0, 0.0);
    let moved: Vec<DVec3> = whole.positions.iter().map(|p| *p - centre).collect();
    assert!((volume(&moved, first) - 2.0 / 6.0).abs() < 1e-6);
    assert!((volume(&moved, second) - 1.0 / 6.0).abs() < 1e-6);
    // Normals: the inverse transpose halves x; a mirror turns them with the surface.
    let expected = Vec3::new(1.0, -0.5, -1.0).normalize();
    assert!(whole.normals[0].abs_diff_eq(expected, 1e-6), "{}", whole.normals[0]);
    assert!(whole.normals[5].abs_diff_eq(Vec3::NEG_X, 1e-6));
}

#[test]
fn every_root_is_read_without_a_default_scene() {
    let text = document(IN_CHUNK, r#"{"mesh": 0}, {"children": [2]}, {"mesh": 0}"#);
    let text = text.replace(r#""scene": 0,"#, "");
    let whole = read("a.glb", glb(&text, &data())).expect("a valid file");
    assert_eq!(whole.triangles.len(), 8);
    let scene = glb(&text.replace(r#""buffers""#, r#""scene": 0, "buffers""#), &data());
    assert_eq!(read("a.glb", scene).expect("a valid file").triangles.len(), 4);
}

#[test]
fn cycles_and_second_parents_are_refused() {
    for nodes in [
        r#"{"children": [0], "mesh": 0}"#,
        r#"{"children": [1]}, {"children": [0]}"#,
        r#"{"children": [1, 1]}, {"mesh": 0}"#,
        r#"{"children": [1, 2]}, {"children": [2]}, {"mesh": 0}"#,
    ] {
        let text = document(IN_CHUNK, nodes);
        let (_, message) = refusal("a.glb", glb(&text, &data()));
        assert!(message.contains("ancestor or has two parents"), "{message}");
    }
    let text = document(IN_CHUNK, r#"{"children": [1]}, {"children": [0]}"#);
    let text = text.replace(r#""scene": 0,"#, "");
    assert!(refusal("a.glb", glb(&text, &data())).1.contains("cycle"));
}

#[test]
fn strips_fans_and_what_is_no_surface() {
    let with_modes = |primitives: &str| {
        let text = document(IN_CHUNK, r#"{"mesh": 0}"#);
        let begin = text.find(r#"{"mode""#).expect("a primitive");
        let end = text[begin..].find("}]}]").expect("its end") + begin + 1;
        let text = format!("{}{primitives}{}", &text[..begin], &text[end..]);
        read("a.glb", glb(&text, &data())).expect("a valid file")
    };
    let whole = with_modes(
        r#"{"mode": 5, "attributes": {"POSITION": 0}},
        {"mode": 6, "attributes": {"POSITION": 0}}, {"mode": 0, "attributes": {}},
        {"mode": 1, "attributes": {"POSITION": 0}}"#,
    );
    let expected = [[0, 1, 2], [2, 1, 3], [4, 5, 6], [4, 6, 7]];
    assert_eq!(whole.triangles, expected);
    assert_eq!(whole.report.strips, 2);
    let skipped = ["meshes[0].primitives[2] (Points)", "meshes[0].primitives[3] (Lines)"];
    assert_eq!(whole.report.skipped, skipped);

    // One primitive with normals and colours, one without.
    let whole = with_modes(
        r#"{"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 3}, "indices": 2},
        {"attributes": {"POSITION": 0}, "indices": 2}"#,
    );
    assert_eq!(whole.colours[4], [255; 4]);
    assert_eq!(whole.normals[4], Vec3::ZERO);
    assert!(!whole.header.is_triangle_soup);

    // No indices at all: a soup, of which one whole triangle can be read.
    let whole = with_modes(r#"{"attributes": {"POSITION": 0}}"#);
    assert!(whole.header.is_triangle_soup);
    assert_eq!(whole.triangles, [[0, 1, 2]]);
    assert!(whole.report.warnings[0].contains("no whole triangle"));
}

#[test]
fn strided_normalised_and_sparse_accessors() {
    // Interleaved i16 positions with a stride of 8; the last vertex is replaced.
    let mut bytes = Vec::new();
    for p in [[0i16, 0, 0], [32767, 0, 0], [0, 32767, 0], [9, 9, 9]] {
        bytes.extend(p.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0xaa, 0xbb]);
    }
    bytes.truncate(30);
    bytes.extend([3, 0]);
    bytes.extend([0i16, 0, -32768].iter().flat_map(|x| x.to_le_bytes()));
    let text = format!(
        r#"{{"asset": {{"version": "2.0"}}, "buffers": [{{"byteLength": {}}}],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "nodes": [{{"mesh": 0}}],
        "meshes": [{{"primitives": [{{"mode": 5, "attributes": {{"POSITION": 0}}}}]}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 30, "byteStride": 8}},
            {{"buffer": 0, "byteOffset": 30, "byteLength": 1}},
            {{"buffer": 0, "byteOffset": 32, "byteLength": 6}}],
        "accessors": [{{"bufferView": 0, "componentType": 5122, "normalized": true,
            "count": 4, "type": "VEC3", "sparse": {{"count": 1,
                "indices": {{"bufferView": 1, "componentType": 5121}},
                "values": {{"bufferView": 2}}}}}}]}}"#,
        bytes.len()
    );
    let whole = read("a.glb", glb(&text, &bytes)).expect("a valid file");
    assert_eq!(whole.positions, [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::NEG_Z]);
    bytes[30] = 4;
    assert!(refusal("a.glb", glb(&text, &bytes)).1.contains("too large"));
}

#[test]
fn documents_that_lie_are_refused() {
    let valid = document(IN_CHUNK, r#"{"mesh": 0}"#);
    for (from, to, told) in [
        (r#""count": 4"#, r#""count": 5"#, "room for 4"),
        (r#""count": 4"#, r#""count": 18446744073709551615"#, "room for 4"),
        (r#""byteLength": 48}"#, r#""byteLength": 18446744073709551615}"#, "lie within"),
        (r#""byteOffset": 48"#, r#""byteOffset": 18446744073709551600"#, "lie within"),
        (r#""byteOffset": 120"#, r#""byteOffset": 121"#, "lie within"),
        (r#""byteLength": 136"#, r#""byteLength": 137"#, "137 buffer bytes"),
        (r#""buffer": 0"#, r#""buffer": 7"#, "no such buffer"),
        (r#""bufferView": 0"#, r#""bufferView": 9"#, "no bufferViews[9]"),
        (r#""bufferView": 0, "#, "", "without compression"),
        (r#""indices": 2"#, r#""indices": 99"#, "no such accessor"),
        (r#""indices": 2"#, r#""indices": 0"#, "does not suit"),
        (r#""POSITION": 0, "#, "", "no POSITION"),
        (r#"5126, "count": 4"#, r#"5126, "count": 3"#, "differ in count"),
        ("5126", "5124", "component type is unknown"),
        (r#""mode": 4"#, r#""mode": 44"#, "mode is unknown"),
        (r#""mesh": 0"#, r#""mesh": 1"#, "mesh is not there"),
        (r#""nodes": [0]"#, r#""nodes": [5]"#, "no such node"),
        (r#""scene": 0"#, r#""scene": 5"#, "default scene is not there"),
        (r#""byteLength": 48}"#, r#""byteLength": 48, "byteStride": 0}"#, "stride of 0"),
        (r#""byteLength": 48}"#, r#""byteLength": 48, "byteStride": 255}"#, "stride of 255"),
        (r#""version": "2.0""#, r#""version": "1.0""#, "glTF version 1.0"),
        (r#""asset""#, r#""asse""#, "not valid"),
    ] {
        assert!(valid.contains(from), "{from}");
        let (error, message) = refusal("a.glb", glb(&valid.replacen(from, to, 1), &data()));
        assert!(message.contains(told), "{to}: {message}");
        assert!(!error.is_usage());
    }
    let required = r#"{"extensionsRequired": ["KHR_draco_mesh_compression"], "asset""#;
    let text = valid.replacen(r#"{"asset""#, required, 1);
    let (error, message) = refusal("a.glb", glb(&text, &data()));
    assert!(matches!(error, ScanError::Unsupported { .. }));
    assert!(message.contains("KHR_draco_mesh_compression"), "{message}");

    let mut wrong = data();
    wrong[96] = 4;
    let (error, _) = refusal("a.glb", glb(&valid, &wrong));
    assert!(matches!(error, ScanError::IndexOutOfRange { index: 4, vertices: 4, .. }));
    let mut wrong = data();
    wrong[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
    let (error, _) = refusal("a.glb", glb(&valid, &wrong));
    assert!(matches!(error, ScanError::NotFinite { vertex: 1, .. }));
}

#[test]
fn a_tiny_file_cannot_ask_for_billions_of_instances() {
    // 2,000 nodes of a mesh whose primitive is repeated 3,000 times: no allocation
    // follows from the product.
    let nodes = vec![r#"{"mesh": 0}"#; 2000].join(",");
    let text = document(IN_CHUNK, &nodes).replace(r#""scene": 0,"#, "");
    let begin = text.find(r#"{"mode""#).expect("a primitive");
    let end = text[begin..].find("}]}]").expect("its end") + begin + 1;
    let primitive = &text[begin..end];
    let text = format!("{}{}{}", &text[..begin], vec![primitive; 3000].join(","), &text[end..]);
    let files = Files::new();
    let path = files.write("a.glb", glb(&text, &data()));
    let mut reader = hlod_scan::ScanReader::open(&path).expect("a valid file");
    assert_eq!(reader.header().vertices_declared, Some(24_000_000));
    assert!(reader.next_batch().expect("a batch").is_some());
}

#[test]
fn a_soup_is_welded_with_its_normals() {
    let data: Vec<u8> = TRIANGLES
        .iter()
        .flat_map(|index| POSITIONS[usize::from(*index)])
        .flat_map(f32::to_le_bytes)
        .collect();
    let text = r#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 144}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "bufferViews": [{"buffer": 0, "byteLength": 144}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 12, "type": "VEC3"}]}"#;
    let files = Files::new();
    let mesh = load_one(files.write("a.glb", glb(text, &data))).expect("a valid file");
    assert_eq!(mesh.positions.len(), 4);
    assert!((volume(&mesh.positions, &mesh.triangles) - 1.0 / 6.0).abs() < 1e-9);
}

#[test]
fn containers_that_lie_are_refused() {
    let valid = glb(&document(IN_CHUNK, r#"{"mesh": 0}"#), &data());
    let with = |at: usize, bytes: &[u8]| {
        let mut wrong = valid.clone();
        wrong[at..at + bytes.len()].copy_from_slice(bytes);
        refusal("a.glb", wrong).1
    };
    assert!(with(4, &[1]).contains("glTF version 1"));
    assert!(with(8, &[0xff; 4]).contains("4294967295 bytes"));
    assert!(with(12, &[0xff; 4]).contains("4294967295 bytes of JSON"));
    assert!(with(16, b"BIN\0").contains("not JSON"));
    assert!(refusal("a.glb", "not a container").1.contains("begins with `glTF`"));
    let whole = read("a.glb", [&valid[..], &[0; 5]].concat()).expect("a valid file");
    assert_eq!(whole.report.warnings, ["5 bytes after the end were not read"]);
}

/// A valid binary file for others to damage.
pub(crate) fn sample() -> Vec<u8> {
    glb(&document(IN_CHUNK, r#"{"mesh": 0}"#), &data())
}
