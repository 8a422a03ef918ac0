//! Damaged files: cut at every byte, flipped bits, noise. Never a panic.

use hlod_scan::ScanError;
use proptest::prelude::*;

use crate::{Files, read_path, refusal};

/// A small binary PLY with an unknown element, polygons and normals.
fn small_ply() -> Vec<u8> {
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement camera 1\n\
        property list uchar short tags\nelement vertex 4\nproperty double x\nproperty float y\n\
        property float z\nproperty char nx\nproperty char ny\nproperty char nz\nelement face 2\n\
        property list uchar int vertex_indices\nelement tristrips 1\n\
        property list int int vertex_indices\nend_header\n"
        .to_vec();
    bytes.extend([2, 1, 0, 2, 0]);
    for [x, y] in [[0f32, 0.], [1., 0.], [1., 1.], [0., 1.]] {
        bytes.extend(f64::from(x).to_le_bytes());
        bytes.extend(y.to_le_bytes());
        bytes.extend(0f32.to_le_bytes());
        bytes.extend([0, 0, 1]);
    }
    for face in [&[0i32, 1, 2][..], &[0, 1, 2, 3]] {
        bytes.push(face.len() as u8);
        bytes.extend(face.iter().flat_map(|index| index.to_le_bytes()));
    }
    bytes.extend(5i32.to_le_bytes());
    bytes.extend([0i32, 1, 2, -1, 3].iter().flat_map(|index| index.to_le_bytes()));
    bytes
}

const SMALL_OBJ: &str = "v 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3 -1\n";
const SMALL_STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n\
    vertex 0 1 0\nendloop\nendfacet\nendsolid a\n";

#[test]
fn a_binary_ply_cut_anywhere_is_refused() {
    let files = Files::new();
    let whole = small_ply();
    let read = read_path(&files.write("a.ply", &whole)).expect("a valid file");
    assert_eq!(read.triangles.len(), 4);
    for length in 0..whole.len() {
        let error = read_path(&files.write("a.ply", &whole[..length])).expect_err("cut");
        assert!(!error.to_string().is_empty());
    }
}

#[test]
fn what_is_no_scan() {
    let files = Files::new();
    let folder = files.write("folder.ply/inside", "");
    let folder = folder.parent().expect("a folder");
    let missing = read_path(&folder.join("missing.ply")).expect_err("missing");
    assert!(matches!(missing, ScanError::NotFound { .. }) && missing.is_usage());
    let folder = read_path(folder).expect_err("a folder");
    assert!(matches!(folder, ScanError::NotAFile { .. }) && folder.is_usage());
    let (error, _) = refusal("a.ply", "");
    assert!(matches!(error, ScanError::EmptyFile { .. }) && !error.is_usage());
    let (error, message) = refusal("a.docx", "PK\x03\x04 and so on");
    assert!(
        error.is_usage() && message.contains("PLY, OBJ, STL, glTF 2.0, LAS or E57"),
        "{message}"
    );
    for name in ["a.ply", "a.obj", "a.stl", "a.glb", "a.gltf"] {
        let (error, _) = refusal(name, [0x81; 3000]);
        assert!(!error.is_usage());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..Default::default() })]

    #[test]
    fn damaged_files_never_panic(
        which in 0..4usize,
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        keep in any::<prop::sample::Index>(),
        cut in any::<bool>(),
    ) {
        let (name, mut bytes) = match which {
            0 => ("a.ply", small_ply()),
            1 => ("a.obj", SMALL_OBJ.into()),
            2 => ("a.stl", SMALL_STL.into()),
            _ => ("a.glb", crate::gltf::sample()),
        };
        for (index, value) in flips {
            let at = index.index(bytes.len());
            bytes[at] = value;
        }
        if cut {
            bytes.truncate(keep.index(bytes.len()));
        }
        // Either is fine; `read_path` checks what a reader promises on success.
        let _ = read_path(&Files::new().write(name, bytes));
    }

    #[test]
    fn noise_never_panics(
        name in prop::sample::select(vec!["a.ply", "a.obj", "a.stl", "a.glb", "a.gltf", "a"]),
        magic in prop::sample::select(vec!["", "ply\n", "glTF", "solid facet ", "{\"asset\":", "v "]),
        noise in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        let bytes = [magic.as_bytes(), &noise].concat();
        let _ = read_path(&Files::new().write(name, bytes));
    }
}
