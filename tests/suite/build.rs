//! What the builder writes is what it read, and says the truth about it.

use std::path::Path;

use hlod_build::progress::Silent;
use hlod_build::{Selection, VerifyOptions, export, info, verify};
use hlod_compress::RepresentationKind;
use hlod_tests::{built, bumpy_ball, scan};

fn against(scan: &Path) -> VerifyOptions {
    VerifyOptions { against: vec![scan.to_owned()], ..VerifyOptions::default() }
}

#[test]
fn a_ball_is_built_verified_and_exported() {
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod, out] = ["ball.ply", "ball.hlod", "out.ply"].map(|n| folder.path().join(n));
    std::fs::write(&ply, bumpy_ball(120)).unwrap();
    let report = built(&ply, &hlod, |o| {
        o.leaf_triangles = 1500;
        o.resolution = 64;
    });
    assert!(report.closed_oriented);

    let info = info(&hlod).unwrap();
    assert_eq!(info.triangles_input, report.triangles_input);
    let parts = info.bytes_leaves
        + info.bytes_appearance_upper
        + info.bytes_geometric_upper
        + info.bytes_skeleton;
    assert_eq!(parts, std::fs::metadata(&hlod).unwrap().len());
    assert!(info.levels.len() >= 3);
    assert_eq!(info.nodes_over_budget, 0);

    let verified = verify(&hlod, &against(&ply), &Silent).unwrap();
    assert!(!verified.is_refuted(), "{:?}", verified.problems);
    assert!(verified.representations_sampled > 2);
    // In parts, as what does not fit into memory is checked: the same distances are found.
    let parts = VerifyOptions { block_triangles: 4_000, memory_bytes: 0, ..against(&ply) };
    let parts = verify(&hlod, &parts, &Silent).unwrap();
    assert!(!parts.is_refuted(), "{:?}", parts.problems);
    for (part, whole) in parts.representations.iter().zip(&verified.representations) {
        assert_eq!((&part.cell, part.kind), (&whole.cell, whole.kind));
        let allowed = whole.independent_bound - whole.sampled;
        assert!((part.sampled - whole.sampled).abs() <= allowed, "{part:?} {whole:?}");
        assert!(part.independent_bound >= whole.sampled, "{part:?} {whole:?}");
    }

    // A share still takes something of every depth.
    let share =
        verify(&hlod, &VerifyOptions { share: 0.01, ..Default::default() }, &Silent).unwrap();
    let depths = |report: &hlod_build::VerifyReport| {
        report.representations.iter().map(|r| r.depth).collect::<std::collections::BTreeSet<_>>()
    };
    assert_eq!(depths(&share), depths(&verified));
    assert!(share.representations_sampled < verified.representations_sampled);

    // The leaves come back as a closed surface with the scan's number of whole triangles or more.
    let report =
        export(&hlod, &out, Selection::Leaves, RepresentationKind::Appearance, false).unwrap();
    let again = hlod_scan::load(std::slice::from_ref(&out), &mut |_, _| {}).unwrap();
    assert_eq!(again.triangles.len() as u64, report.triangles);
    assert!(report.triangles >= info.triangles_input - verified.nodes);
    let coarse =
        export(&hlod, &out, Selection::MaxTriangles(2000), RepresentationKind::Geometric, true)
            .unwrap();
    assert!(coarse.triangles <= 2000 && coarse.error_max > 0.0);
}

#[test]
fn the_same_input_gives_the_same_bytes_whatever_threads_and_memory() {
    let folder = tempfile::tempdir().unwrap();
    let ply = folder.path().join("ball.ply");
    std::fs::write(&ply, bumpy_ball(160)).unwrap();
    let bytes = |threads: usize, memory_mib: u64| {
        let out = folder.path().join(format!("{threads}-{memory_mib}.hlod"));
        let pool = rayon_pool(threads);
        pool.install(|| {
            built(&ply, &out, |o| {
                o.leaf_triangles = 500;
                o.memory_bytes = memory_mib << 20;
            })
        });
        std::fs::read(out).unwrap()
    };
    let first = bytes(1, 4096);
    assert!(first == bytes(3, 4096), "one thread and three write different files");
    // In little memory the model is cut into several subtrees.
    assert!(first == bytes(2, 80), "more and less memory write different files");
}

pub fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

#[test]
fn units_and_places_do_not_matter() {
    let folder = tempfile::tempdir().unwrap();
    let ball = bumpy_ball(80);
    let triangles = |name: &str, scale: f64, offset: f64| {
        let ply = folder.path().join(format!("{name}.ply"));
        let text: String = ball
            .replace("property float", "property double")
            .lines()
            .map(|line| {
                let place = |w: &str| {
                    let value = w.contains('.').then(|| w.parse::<f64>().ok()).flatten()?;
                    Some(format!("{:.9}", value * scale + offset))
                };
                let moved: Option<Vec<String>> = line.split(' ').map(place).collect();
                moved.filter(|m| m.len() == 3).map_or(line.to_owned(), |m| m.join(" ")) + "\n"
            })
            .collect();
        std::fs::write(&ply, text).unwrap();
        let out = folder.path().join(format!("{name}.hlod"));
        built(&ply, &out, |o| o.leaf_triangles = 1000);
        let root = &info(&out).unwrap().levels[0];
        (root.triangles_mean, root.error_max / scale)
    };
    let (count, error) = triangles("as it is", 1.0, 0.0);
    for (name, scale, offset) in [("scaled", 1000.0, 0.0), ("moved", 1.0, 10_000.0)] {
        let (other, other_error) = triangles(name, scale, offset);
        assert!((other / count - 1.0).abs() <= 0.01, "{name}: {other} triangles, {count} unmoved");
        assert!((other_error / error - 1.0).abs() <= 0.05, "{name}: error {other_error}, {error}");
    }
}

#[test]
fn the_bunny_with_its_holes_is_what_it_was() {
    let name = "the_bunny_with_its_holes_is_what_it_was";
    let Some(bunny) = scan(name, "bunny/bun_zipper.ply") else { return };
    let folder = tempfile::tempdir().unwrap();
    let hlod = folder.path().join("bunny.hlod");
    let report = built(&bunny, &hlod, |_| {});
    assert_eq!(report.triangles_input, 69_451);
    assert!(!report.closed_oriented);
    let verified = verify(&hlod, &against(&bunny), &Silent).unwrap();
    assert!(!verified.is_refuted(), "{:?}", verified.problems);
}

/// What readers of scans have to expect is built as it is, within its bounds, and counted.
#[test]
fn odd_surfaces_are_built_and_counted() {
    use std::fmt::Write;
    let folder = tempfile::tempdir().unwrap();
    let [plain, ply, hlod] = ["plain.ply", "odd.ply", "odd.hlod"].map(|n| folder.path().join(n));
    std::fs::write(&plain, bumpy_ball(60)).unwrap();
    let ball = hlod_scan::load(std::slice::from_ref(&plain), &mut |_, _| {}).unwrap();
    let normal = |p: &glam::DVec3| p.normalize_or_zero().to_array();
    let mut vertices: Vec<[[f64; 3]; 2]> =
        ball.positions.iter().map(|p| [p.to_array(), normal(p)]).collect();
    let mut faces = ball.triangles.clone();
    // Normals of no length, which are made up for.
    (100..104).for_each(|v| vertices[v][1] = [0.0; 3]);
    // Single vertices, an inverted triangle, a repeated corner and three times the same sheet.
    vertices.extend([[[0.5; 3], [0.0, 0.0, 1.0]]; 3]);
    faces[3000].reverse();
    faces.push([7, 7, 9]);
    for _ in 0..2 {
        faces.extend_from_within(500..550);
    }
    // A cloud of tetrahedra, each smaller than the error of the upper levels.
    for i in 0..2000u32 {
        let angle = f64::from(i) * 2.4;
        let height = f64::from(i) / 1000.0 - 1.0;
        let round = 1.5 * (1.0 - height * height).sqrt();
        let centre = [round * angle.cos(), 1.5 * height, round * angle.sin()];
        let first = vertices.len() as u32;
        for corner in [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]] {
            vertices.push([std::array::from_fn(|k| centre[k] + 0.003 * corner[k]), corner]);
        }
        let corners = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        faces.extend(corners.map(|t| t.map(|c| first + c)));
    }
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", vertices.len());
    ["x", "y", "z", "nx", "ny", "nz"]
        .iter()
        .for_each(|name| writeln!(text, "property float {name}").unwrap());
    writeln!(text, "element face {}", faces.len()).unwrap();
    text += "property list uchar int vertex_indices\nend_header\n";
    for [[x, y, z], [nx, ny, nz]] in &vertices {
        writeln!(text, "{x} {y} {z} {nx} {ny} {nz}").unwrap();
    }
    faces.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
    std::fs::write(&ply, text).unwrap();

    // One leaf counts everything once.
    let report = built(&ply, &hlod, |o| o.force = true);
    assert_eq!(report.vertices_unused, 3);
    assert_eq!(report.inputs[0].normals_absent, 4);
    assert_eq!(report.inputs[0].degenerate_faces, 1);
    let odd = report.oddities;
    assert_eq!((odd.triangles_duplicate, odd.edges_inverted), (100, 3), "{odd:?}");
    assert_eq!((odd.edges_open, odd.edges_nonmanifold), (0, 0), "{odd:?}");
    assert!(!report.closed_oriented);

    for resolution in [16, 64] {
        built(&ply, &hlod, |o| {
            o.force = true;
            o.leaf_triangles = 1000;
            o.resolution = resolution;
        });
        let verified = verify(&hlod, &against(&ply), &Silent).unwrap();
        assert!(!verified.is_refuted(), "R = {resolution}: {:?}", verified.problems);
        assert!(verified.nodes > 8);
    }
}

/// A file whose stored error is a lie is refuted.
#[test]
fn a_planted_error_that_is_too_small_is_caught() {
    use hlod_compress::{Errors, FileWriter, FormatError, HlodFile};
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod, lie] = ["b.ply", "b.hlod", "lie.hlod"].map(|n| folder.path().join(n));
    std::fs::write(&ply, bumpy_ball(90)).unwrap();
    built(&ply, &hlod, |o| {
        o.leaf_triangles = 1500;
        o.resolution = 32;
    });
    let file = HlodFile::open(&hlod).unwrap();
    let honest = file.read_skeleton().unwrap();
    let write_lie = |change: &dyn Fn(&mut Errors)| {
        let mut nodes = honest.clone();
        change(&mut nodes[0].representations[0].errors);
        let writer = FileWriter::new(file.header().clone(), nodes, None).unwrap();
        let mut bytes = Vec::new();
        let page = |cell, kind| {
            let node = honest.iter().find(|n| n.cell == cell).unwrap();
            file.read_page(node.representations.iter().find(|r| r.kind == kind).unwrap().page)
        };
        writer.write::<FormatError>(&mut bytes, page).unwrap();
        std::fs::write(&lie, bytes).unwrap();
        verify(&lie, &VerifyOptions::default(), &Silent).unwrap()
    };
    let truth = verify(&hlod, &VerifyOptions::default(), &Silent).unwrap();
    assert!(!truth.is_refuted(), "{:?}", truth.problems);
    let root = truth.representations.iter().find(|r| r.depth == 0).unwrap();
    assert_eq!(root.kind, "appearance");

    // Just below what samples find.
    let caught = write_lie(&|errors| errors.geometric = root.sampled as f32 * 0.98);
    assert_eq!(caught.nodes_over_bound, 1, "{:?}", caught.problems);
    // Normals of a ball's coarse copy differ by some degrees, and nothing was smoothed by much.
    let caught = write_lie(&|errors| {
        errors.normal_deviation_deg = [0.1; 3];
        errors.normal_smoothing_deg = 0.0;
    });
    assert_eq!(caught.nodes_over_normal_bound, 1, "{:?}", caught.problems);
    assert_eq!(caught.nodes_over_bound, 0, "{:?}", caught.problems);
}
