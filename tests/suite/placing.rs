//! Several scans, each moved to where it stands.

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec3};
use hlod_build::progress::Silent;
use hlod_build::{BuildError, BuildOptions, BuildReport, VerifyOptions, build, verify};
use hlod_scan::Transform;
use hlod_tests::{ball, ply, program};

/// A turn, a move and a size.
fn placing() -> DMat4 {
    DMat4::from_scale_rotation_translation(
        DVec3::splat(1.5),
        glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.7),
        DVec3::new(4.0, -3.0, 10.0),
    )
}

/// Row by row, as the other programs write it.
fn text(matrix: DMat4) -> String {
    let rows = matrix.transpose().to_cols_array_2d();
    rows.iter().map(|[a, b, c, d]| format!("{a} {b} {c} {d} \n")).collect()
}

fn transform(matrix: DMat4) -> Option<Transform> {
    Some(Transform::parse(&text(matrix)).unwrap())
}

/// A closed ball, as positions and faces.
fn whole() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let text = ball(40, 0.02);
    let body = text.split_once("end_header\n").unwrap().1;
    let mut lines = body.lines().map(|line| line.split(' ').collect::<Vec<_>>());
    let vertices = lines.by_ref().take(2 + 39 * 40);
    let vertices = vertices.map(|w| [0, 1, 2].map(|i| w[i].parse().unwrap())).collect();
    (vertices, lines.map(|w| [1, 2, 3].map(|i| w[i].parse().unwrap())).collect())
}

/// Writes the ball's two halves, the second where `away` puts it.
fn halves(folder: &Path, away: DMat4) -> [PathBuf; 2] {
    let (vertices, faces) = whole();
    let (one, other): (Vec<_>, Vec<_>) =
        faces.iter().partition(|t| t.iter().all(|v| vertices[*v as usize][1] >= -0.01));
    let moved: Vec<[f64; 3]> =
        vertices.iter().map(|p| away.transform_point3(DVec3::from(*p)).to_array()).collect();
    let write = |name: &str, vertices: &[[f64; 3]], faces: Vec<[u32; 3]>| {
        let path = folder.join(name);
        std::fs::write(&path, ply(vertices, &faces)).unwrap();
        path
    };
    [write("one.ply", &vertices, one), write("other.ply", &moved, other)]
}

fn build_at(
    inputs: &[PathBuf],
    output: &Path,
    transforms: Vec<Option<Transform>>,
) -> Result<BuildReport, BuildError> {
    // Finer than what 7 decimals of a text round.
    let options =
        BuildOptions { transforms, precision: Some(1e-5), force: true, ..BuildOptions::default() };
    build(inputs, output, &options, &Silent)
}

#[test]
fn halves_meet_where_their_transforms_put_them() {
    let folder = tempfile::tempdir().unwrap();
    let hlod = folder.path().join("ball.hlod");
    let inputs = halves(folder.path(), placing().inverse());
    let transforms = vec![None, transform(placing())];
    let report = build_at(&inputs, &hlod, transforms.clone()).unwrap();
    assert_eq!(report.inputs[0].transform, None);
    assert_eq!(report.inputs[1].transform, transforms[1]);
    let exported = hlod_scan::load(&inputs, &mut |_, _| {}).unwrap();
    assert_eq!(report.triangles_input, exported.triangles.len() as u64);
    let size = |file: &Path| {
        let info = hlod_build::info(file).unwrap();
        DVec3::from(info.bounds_max) - DVec3::from(info.bounds_min)
    };
    // Of the ball, not of two halves far from each other.
    assert!((size(&hlod) - DVec3::splat(2.0)).abs().max_element() < 0.08, "{}", size(&hlod));
    let apart = folder.path().join("apart.hlod");
    build_at(&inputs, &apart, Vec::new()).unwrap();
    assert!(size(&apart).max_element() > 4.0);

    let check = |transforms: Vec<Option<Transform>>| {
        let against =
            VerifyOptions { against: inputs.to_vec(), transforms, ..VerifyOptions::default() };
        verify(&hlod, &against, &Silent).unwrap()
    };
    let verified = check(transforms);
    assert!(!verified.is_refuted(), "{:?}", verified.problems);
    assert!(check(vec![None, None]).is_refuted());
    assert!(
        check(vec![None, transform(placing() * DMat4::from_scale(DVec3::splat(1.001)))])
            .is_refuted()
    );
}

#[test]
fn mirrored_scans_are_turned_round() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let (vertices, faces) = whole();
    std::fs::write(file("a.ply"), ply(&vertices, &faces)).unwrap();
    let mirror = DMat4::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)));
    let report = build_at(&[file("a.ply")], &file("a.hlod"), vec![transform(mirror)]).unwrap();
    assert!(report.closed_oriented, "it faces outwards as before");
    assert!(report.inputs[0].warnings[0].contains("mirrors"));
    // What is mirrored in the file itself, and not turned round there, does not.
    let inside_out: Vec<[f64; 3]> = vertices.iter().map(|[x, y, z]| [-x, *y, *z]).collect();
    std::fs::write(file("b.ply"), ply(&inside_out, &faces)).unwrap();
    assert!(!build_at(&[file("b.ply")], &file("b.hlod"), Vec::new()).unwrap().closed_oriented);
}

#[test]
fn far_from_the_origin_nothing_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let (vertices, faces) = whole();
    std::fs::write(file("a.ply"), ply(&vertices, &faces)).unwrap();
    // As national grids have it, where f32 has steps of half a metre.
    let to = DVec3::new(654_321.25, 5_412_345.5, 312.125);
    let far = transform(DMat4::from_translation(to));
    build_at(&[file("a.ply")], &file("a.hlod"), Vec::new()).unwrap();
    build_at(&[file("a.ply")], &file("far.hlod"), vec![far]).unwrap();
    let leaves = |name: &str| {
        let out = file("leaves.ply");
        let selection = hlod_build::Selection::Leaves;
        let kind = hlod_compress::RepresentationKind::Appearance;
        hlod_build::export(&file(name), &out, selection, kind, true).unwrap();
        hlod_scan::load(&[out], &mut |_, _| {}).unwrap()
    };
    let (near, far) = (leaves("a.hlod"), leaves("far.hlod"));
    assert_eq!(near.positions.len(), far.positions.len());
    let sum = |mesh: &hlod_scan::ScanMesh, minus: DVec3| {
        mesh.positions.iter().map(|p| *p - minus).sum::<DVec3>() / mesh.positions.len() as f64
    };
    let off = (sum(&near, DVec3::ZERO) - sum(&far, to)).length();
    assert!(off < 1e-5, "{off}");
}

const PROJECT: &str = "<!DOCTYPE MeshLabDocument>\n<MeshLabProject>\n <MeshGroup>\n\
    <MLMesh label=\"one\" filename=\"one.ply\" visible=\"1\"><MLMatrix44>\n\
    1 0 0 0 \n0 1 0 0 \n0 0 1 0 \n0 0 0 1 \n</MLMatrix44><RenderingOption>1000</RenderingOption></MLMesh>\n\
    <MLMesh label=\"other\" filename=\"other.ply\"><MLMatrix44>\nMATRIX</MLMatrix44></MLMesh>\n\
    <MLMesh label=\"old\" filename=\"gone.ply\" visible=\"0\"/>\n </MeshGroup>\n <RasterGroup/>\n\
    </MeshLabProject>\n";

#[test]
fn meshlab_projects_are_their_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let inputs = halves(folder.path(), placing().inverse());
    let project = PROJECT.replace("MATRIX", &text(placing()));
    std::fs::write(file("ball.mlp"), &project).unwrap();
    let report = build_at(&[file("ball.mlp")], &file("project.hlod"), Vec::new()).unwrap();
    assert_eq!(report.inputs.len(), 2);
    assert!(report.inputs[0].warnings.iter().any(|w| w.contains("`gone.ply` is hidden")));
    let identity = transform(DMat4::IDENTITY);
    build_at(&inputs, &file("each.hlod"), vec![identity, transform(placing())]).unwrap();
    let bytes = |name: &str| std::fs::read(file(name)).unwrap();
    assert!(bytes("project.hlod") == bytes("each.hlod"));
    let against = VerifyOptions { against: vec![file("ball.mlp")], ..VerifyOptions::default() };
    assert!(!verify(&file("project.hlod"), &against, &Silent).unwrap().is_refuted());

    // What is wrong is said.
    let outside = tempfile::tempdir().unwrap();
    std::fs::copy(file("one.ply"), outside.path().join("one.ply")).unwrap();
    for (wrong, said) in [
        (project.replace("\"one.ply\"", "\"../one.ply\""), "outside the folder"),
        (project.replace("\"one.ply\"", "\"/etc/hostname\""), "outside the folder"),
        (project.replace("\"one.ply\"", "\"two.ply\""), "is not there"),
        (project.replace("\"one.ply\"", "\"\""), "without a file name"),
        (project.replace("1 0 0 0 \n", "0 0 0 0 \n"), "singular"),
        (project.replace("0 0 0 1 \n</", "0 0 1 1 \n</"), "perspective"),
        (project.replace("1 0 0 0 \n", "1 0 0 \n"), "15 numbers"),
        (
            project
                .replace("visible=\"1\"", "visible=\"0\"")
                .replace("other.ply\"", "other.ply\" visible=\"0\""),
            "shows no mesh",
        ),
        (project.replace("</MLMesh>", "</MLMes>"), "not well-formed"),
        (project.replace("label=\"one\"", "label=\"&bomb;\""), "bomb"),
        (project.replace("MeshLabProject", "Other"), "no MeshLab project"),
        (String::from("\u{1}"), "no MeshLab project"),
    ] {
        std::fs::write(file("wrong.mlp"), &wrong).unwrap();
        let error = build_at(&[file("wrong.mlp")], &file("wrong.hlod"), Vec::new());
        let said_instead = error.map_or_else(|e| e.to_string(), |_| "nothing".into());
        assert!(said_instead.contains(said), "{said}: {said_instead}");
        assert!(!file("wrong.hlod").exists());
    }
}

#[test]
fn the_program_takes_a_matrix_for_each_input() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let inputs = halves(folder.path(), placing().inverse());
    std::fs::write(file("other.txt"), text(placing())).unwrap();
    let run = |transforms: &[&str]| {
        let mut command = program("hlod-build");
        command.current_dir(folder.path()).arg("build").args(&inputs);
        command.args(["-o", "ball.hlod", "--force"]);
        transforms.iter().for_each(|name| {
            command.args(["--transform", name]);
        });
        command.output().unwrap()
    };
    let good = run(&["none", "other.txt"]);
    let said = String::from_utf8_lossy(&good.stderr);
    assert!(good.status.success() && said.contains("moved by"), "{said}");
    let few = run(&["other.txt"]);
    assert_eq!(few.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&few.stderr).contains("1 transforms for 2 inputs"));
    std::fs::write(file("flat.txt"), "1 0 0 0 0 0 0 0 0 0 1 0 0 0 0 1").unwrap();
    let flat = run(&["none", "flat.txt"]);
    assert!(!flat.status.success());
    assert!(String::from_utf8_lossy(&flat.stderr).contains("singular"));
}
