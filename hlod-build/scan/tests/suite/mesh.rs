//! Loading several files as one, welding, computed normals.

use glam::{DVec3, Vec3};
use hlod_scan::{ScanError, angle_weighted_normals, load, weld_exact};

use crate::Files;

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\n\
    property double z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    9 9 9 0 0 0 1 0 0 0 1 0\n3 1 2 3\n";
const OBJ: &str = "v 0 0 1 1 0 0\nv 1 0 1 0 1 0\nv 0 1 1 0 0 1\nvn 0 0 -1\nf 1//1 2//1 3//1\n";
const STL: &str = "solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 2\nvertex 1 0 2\n\
    vertex 0 1 2\nendloop\nendfacet\nfacet normal 0 0 0\nouter loop\nvertex 1 0 2\n\
    vertex 1 1 2\nvertex 0 1 2\nendloop\nendfacet\nendsolid\n";

#[test]
fn several_files_make_one_model() {
    let files = Files::new();
    let paths = [files.write("a.ply", PLY), files.write("b.obj", OBJ), files.write("c.stl", STL)];
    let mut calls = Vec::new();
    let mesh = load(&paths, &mut |done, total| calls.push((done, total))).expect("valid files");

    assert_eq!(mesh.positions.len(), 4 + 3 + 4);
    assert_eq!(mesh.triangles, [[1, 2, 3], [4, 5, 6], [7, 8, 9], [8, 10, 9]]);
    assert_eq!(mesh.reports.len(), 3);
    assert_eq!(mesh.reports[2].vertices_welded, 2);
    // Normals of the PLY and STL files are computed, those of the OBJ file kept; the
    // lone vertex gets some unit vector.
    assert!(mesh.normals_computed);
    assert_eq!(mesh.normals[..4], [Vec3::Z; 4]);
    assert_eq!(mesh.normals[4..7], [Vec3::NEG_Z; 3]);
    assert_eq!(mesh.normals[7..], [Vec3::Z; 4]);
    // Colours of the OBJ file, opaque white before and after.
    assert_eq!(mesh.colours.len(), mesh.positions.len());
    assert_eq!(mesh.colours[3..6], [[255; 4], [255, 0, 0, 255], [0, 255, 0, 255]]);
    assert_eq!(mesh.colours[7..], [[255; 4]; 4]);

    let total = (PLY.len() + OBJ.len() + STL.len()) as u64;
    assert!(calls.is_sorted() && calls.iter().all(|call| call.1 == total));
    assert_eq!(calls.last(), Some(&(total, total)));
}

#[test]
fn nothing_and_missing_are_usage() {
    let none = load(&[], &mut |_, _| {}).expect_err("no input");
    assert!(matches!(none, ScanError::NoInput { .. }) && none.is_usage());
    let files = Files::new();
    let paths = [files.write("a.ply", PLY), "/no/such/scan.ply".into()];
    let error = load(&paths, &mut |_, _| panic!("nothing may be read")).expect_err("missing");
    assert!(error.is_usage());
}

#[test]
fn welding_merges_equal_bits_only() {
    let tiny = f64::from_bits(1);
    let weld = weld_exact(&[
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::ZERO,
        DVec3::new(1.0, -0.0, 0.0),
        DVec3::new(1.0, tiny, 0.0),
        DVec3::new(-0.0, -0.0, -0.0),
    ]);
    assert_eq!(weld.old_from_new, [0, 1, 3]);
    assert_eq!(weld.new_from_old, [0, 1, 0, 2, 1]);
}

#[test]
fn normals_do_not_depend_on_the_triangulation() {
    // A cube whose faces are each cut one way or the other: a corner's normal is its
    // diagonal all the same. Weighting by area or by count would fail here.
    let corners: Vec<DVec3> = (0..8)
        .map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)))
        .collect();
    let quads =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for cuts in 0..64u32 {
        let mut triangles = Vec::new();
        for (face, [a, b, c, d]) in quads.into_iter().enumerate() {
            if cuts >> face & 1 == 0 {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[b, c, d], [b, d, a]]);
            }
        }
        let normals = angle_weighted_normals(&corners, &triangles);
        for (corner, normal) in corners.iter().zip(&normals) {
            let expected = (*corner - 0.5).normalize().as_vec3();
            assert!(normal.abs_diff_eq(expected, 1e-6), "{normal} at {corner}");
        }
    }
}

#[test]
fn normals_are_unit_whatever_the_size() {
    for size in [1e-300, 1e-30, 1.0, 1e30, 1e300] {
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| p * size);
        // The last vertex is in a triangle without area only.
        let normals = angle_weighted_normals(&positions, &[[0, 1, 2], [3, 3, 3]]);
        assert_eq!(normals, [Vec3::Z; 4], "size {size}");
    }
    let opposite =
        angle_weighted_normals(&[DVec3::ZERO, DVec3::X, DVec3::Y], &[[0, 1, 2], [0, 2, 1]]);
    assert_eq!(opposite, [Vec3::Z; 3]);
}
