//! STL: text and binary, and how they are told apart.

use glam::DVec3;
use hlod_scan::{Place, ScanError, ScanFormat};

use crate::{Files, load_one, read, refusal, volume};

/// A tetrahedron, facing outwards.
const FACETS: [[[f32; 3]; 3]; 4] = {
    let [o, x, y, z] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    [[o, y, x], [o, x, z], [o, z, y], [x, y, z]]
};

/// Written by a library that shares no code with the reader.
fn binary() -> Vec<u8> {
    let facets = FACETS.map(|corners| stl_io::Triangle {
        normal: stl_io::Normal::new([0.0; 3]),
        vertices: corners.map(stl_io::Vertex::new),
    });
    let mut bytes = Vec::new();
    stl_io::write_stl(&mut bytes, facets.iter()).expect("writing to memory");
    bytes
}

fn text() -> String {
    let mut text = String::from("solid a name of words\n");
    for facet in FACETS {
        text += " facet normal nan 0 0\n  outer loop\n";
        for [x, y, z] in facet {
            text += &format!("   vertex {x:e} {y} {z}\n");
        }
        text += "  endloop\n endfacet\n";
    }
    text + "endsolid a name of words\n"
}

#[test]
fn both_kinds_read_the_same() {
    for (bytes, format) in [
        (binary(), ScanFormat::StlBinary),
        (text().into_bytes(), ScanFormat::StlAscii),
        (text().to_uppercase().into_bytes(), ScanFormat::StlAscii),
    ] {
        let whole = read("a.stl", &bytes).expect("a valid file");
        assert_eq!(whole.header.format, format);
        assert!(whole.header.is_triangle_soup);
        assert_eq!(whole.triangles.len(), 4);
        assert_eq!(whole.positions.len(), 12);
        assert!((volume(&whole.positions, &whole.triangles) - 1.0 / 6.0).abs() < 1e-12);
        assert!(whole.report.warnings.is_empty(), "{:?}", whole.report.warnings);

        let files = Files::new();
        let mesh = load_one(files.write("a.stl", &bytes)).expect("a valid file");
        assert_eq!(mesh.positions, [DVec3::ZERO, DVec3::Y, DVec3::X, DVec3::Z]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 1], [2, 1, 3]]);
        assert_eq!(mesh.reports[0].vertices_welded, 8);
        assert!(mesh.normals_computed);
    }
}

#[test]
fn a_binary_file_may_begin_with_solid() {
    let mut bytes = binary();
    bytes[..80].fill(b' ');
    bytes[..12].copy_from_slice(b"solid facet ");
    let whole = read("a.stl", &bytes).expect("a valid file");
    assert_eq!(whole.header.format, ScanFormat::StlBinary);
    // Even without the extension its size tells.
    assert_eq!(read("scan", &bytes).expect("by size").triangles.len(), 4);
}

#[test]
fn a_binary_file_cut_short_is_refused_and_surplus_is_a_warning() {
    let mut bytes = binary();
    let (error, _) = refusal("a.stl", &bytes[..bytes.len() - 1]);
    assert!(matches!(error, ScanError::CountTooLarge { declared: 4, possible: 3, .. }));
    assert!(matches!(refusal("a.stl", &bytes[..83]).0, ScanError::Truncated { .. }));
    bytes.extend([0; 9]);
    let whole = read("a.stl", &bytes).expect("a valid file");
    assert_eq!(whole.report.warnings, ["9 bytes after the last facet were not read"]);
}

#[test]
fn infinite_corners_and_slivers() {
    let mut bytes = binary();
    // Facet 1, corner 2, y.
    let at = 84 + 50 + 12 + 2 * 12 + 4;
    bytes[at..at + 4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    let (error, _) = refusal("a.stl", &bytes);
    assert!(matches!(error, ScanError::NotFinite { vertex: 5, .. }));
    assert_eq!(error.at().place, Place::Byte(at as u64 - 4));

    let sliver = text().replacen("vertex 0e0 1 0", "vertex 0e0 -0 0", 1);
    let whole = read("a.stl", sliver).expect("a valid file");
    assert_eq!(whole.report.degenerate_faces, 1);
    assert_eq!((whole.triangles.len(), whole.positions.len()), (3, 9));
}

#[test]
fn wrong_texts() {
    let (error, message) = refusal("a.stl", text().replacen("endloop", "vertex", 1));
    assert!(message.contains("expected `endloop`, found `vertex`"), "{message}");
    assert_eq!(error.at().place, Place::Line(7));
    let (_, message) = refusal("a.stl", text().replacen("0e0", "o", 1));
    assert!(message.contains("`o` is not a number"), "{message}");
    let text = text();
    let cut = text.find("endfacet").expect("a facet");
    assert!(matches!(refusal("a.stl", &text[..cut]).0, ScanError::Truncated { .. }));
    let open = text.rfind("endsolid").expect("an end");
    let whole = read("a.stl", &text[..open]).expect("a valid file");
    assert!(whole.report.warnings[0].contains("without `endsolid`"));
    let (error, _) = refusal("a.stl", "solid nothing\nendsolid nothing\n");
    assert!(matches!(error, ScanError::NoGeometry { .. }));
}

#[test]
fn many_facets_come_in_several_batches() {
    let mut bytes = vec![0; 80];
    let count = 50_000u32;
    bytes.extend(count.to_le_bytes());
    for i in 0..count {
        let i = i as f32;
        for value in [0., 0., 1., i, 0., 0., i + 1., 0., 0., i, 1., 0.] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend([0, 0]);
    }
    let whole = read("a.stl", &bytes).expect("a valid file");
    assert_eq!(whole.triangles.len(), count as usize);
    assert_eq!(whole.triangles.last(), Some(&[149_997, 149_998, 149_999]));
    assert_eq!(whole.positions[149_998], DVec3::new(50_000.0, 0.0, 0.0));
}
