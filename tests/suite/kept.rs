//! Numbers of a scan's vertices that are kept: from a PLY property to the file and out of it again.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use hlod_build::progress::Silent;
use hlod_build::{KeptScalar, Selection, VerifyOptions, VerifyReport, export, info, verify};
use hlod_compress::{
    CellKey, HlodFile, PageContent, RepresentationKind, ScalarRange, Scalars, decode_page,
};
use hlod_render::colour_map::{NO_VALUE, viridis};
use hlod_render::figure::{Sheet, orthographic};
use hlod_render::framing::Framing;
use hlod_render::scene::{Paint, Representation, Shot};
use hlod_render::{Model, ModelLimits};
use hlod_scan::{Batch, ColourSource, ReadOptions, ScanReader};
use hlod_tests::{bumpy_ball, program};

use crate::build::rayon_pool;
use crate::points::ball_cloud;

/// A number that is linear in the position, so that what is interpolated is known everywhere.
pub fn height(p: DVec3) -> f64 {
    7.0 + 100.0 * p.y + 30.0 * p.x
}
/// Length of its gradient.
const GRADIENT: f64 = 104.403_065_089_105_5;
/// Where nobody measured it.
pub fn is_hole(p: DVec3) -> bool {
    p.z > 0.7
}
/// Where what was cut may be nearer to one vertex than to another that has none.
fn is_beside_hole(p: DVec3) -> bool {
    (p.z - 0.7).abs() < 0.1
}
/// A whole number that jumps.
fn label(p: DVec3) -> f64 {
    if p.x > 0.1 { 200.0 } else { 3.0 }
}

/// The same ASCII PLY with numbers for each vertex, whose coordinates come first.
pub fn with_numbers(ply: &str) -> String {
    let (header, body) = ply.split_once("end_header\n").unwrap();
    let properties = "property double height\nproperty uchar label\n";
    let header = match header.split_once("element face") {
        Some((before, after)) => format!("{before}{properties}element face{after}"),
        None => format!("{header}{properties}"),
    };
    let mut out = header + "end_header\n";
    for line in body.lines() {
        let words: Vec<f64> = line.split(' ').map(|w| w.parse().unwrap()).collect();
        // Faces begin with their number of corners.
        if words.len() == 4 && words[0] == 3.0 {
            out += &format!("{line}\n");
            continue;
        }
        let p = DVec3::new(words[0], words[1], words[2]);
        let height = if is_hole(p) { f64::NAN } else { height(p) };
        out += &format!("{line} {height} {}\n", label(p));
    }
    out
}

pub fn keep(names: &[&str]) -> Vec<KeptScalar> {
    names.iter().map(|name| name.parse().unwrap()).collect()
}

struct Built {
    folder: tempfile::TempDir,
    scan: PathBuf,
    file: PathBuf,
}

fn built(ply: &str, names: &[&str]) -> Built {
    let folder = tempfile::tempdir().unwrap();
    let [scan, file] = ["scan.ply", "scan.hlod"].map(|name| folder.path().join(name));
    std::fs::write(&scan, with_numbers(ply)).unwrap();
    hlod_tests::built(&scan, &file, |o| {
        o.leaf_triangles = 700;
        o.resolution = 32;
        o.keep = keep(names);
    });
    Built { folder, scan, file }
}

/// Every place of a node's page with its numbers.
type Row = (DVec3, Scalars);

fn rows(file: &HlodFile, page: &PageContent) -> Vec<Row> {
    let lattice = file.header().lattice;
    let place = |p: &[i32; 3]| DVec3::from_array(lattice.position(*p));
    let of = |all: &[Scalars], i: usize| all.get(i).copied().unwrap_or_default();
    let PageContent { mesh, points } = page;
    let of_mesh = mesh.positions.iter().enumerate().map(|(i, p)| (place(p), of(&mesh.scalars, i)));
    let of_points = points.positions.iter().enumerate();
    of_mesh.chain(of_points.map(|(i, p)| (place(p), of(&points.scalars, i)))).collect()
}

/// All pages: cell, whether it is a leaf, how far it may be wrong, rows.
fn pages(path: &Path) -> Vec<(CellKey, RepresentationKind, f64, Vec<Row>)> {
    let file = HlodFile::open(path).unwrap();
    let mut out = Vec::new();
    for node in file.read_skeleton().unwrap() {
        for r in &node.representations {
            let page = decode_page(&file.read_page(r.page).unwrap()).unwrap();
            let rows = rows(&file, &page);
            out.push((node.cell, r.kind, f64::from(r.errors.geometric), rows));
        }
    }
    out
}

fn range(path: &Path, k: usize) -> ScalarRange {
    HlodFile::open(path).unwrap().header().scalars().nth(k).unwrap().1.clone()
}

fn against(file: &Path, scan: &Path) -> VerifyReport {
    let options = VerifyOptions { against: vec![scan.to_owned()], ..Default::default() };
    verify(file, &options, &Silent).unwrap()
}

/// Full resolution has the scan's numbers to half a step, and what was cut those between: as far as a place
/// is rounded, and by another half.
#[test]
fn leaves_have_the_scans_numbers() {
    let b = built(&bumpy_ball(80), &["height", "label"]);
    let (heights, labels) = (range(&b.file, 0), range(&b.file, 1));
    assert_eq!((labels.step, labels.minimum, labels.maximum()), (1.0, 3.0, 200.0));
    let step = HlodFile::open(&b.file).unwrap().header().lattice.step;
    let slack = heights.step + GRADIENT * 2.0 * step;
    assert!(slack < 0.6, "{slack}");
    let (mut known, mut off) = (0, 0);
    for (_, kind, _, rows) in pages(&b.file) {
        if kind != RepresentationKind::Source {
            continue;
        }
        for (p, scalars) in rows {
            if let Some(found) = heights.value(scalars.0[0]).filter(|_| !is_beside_hole(p)) {
                known += 1;
                assert!((found - height(p)).abs() <= slack, "{found} at {p}");
                // The comparison would see other places' numbers.
                off += usize::from((found - height(p + DVec3::splat(0.01))).abs() > slack);
            }
            let of_scan = [3.0, 200.0].contains(&labels.value(scalars.0[1]).unwrap());
            assert!(of_scan || (p.x - 0.1).abs() < 0.2, "{p}");
        }
    }
    assert!(known > 5_000 && off > known / 2, "{known} {off}");
    let verified = against(&b.file, &b.scan);
    assert!(!verified.is_refuted(), "{:?}", verified.problems);
    assert!(verified.values_compared > 5_000, "{}", verified.values_compared);
}

/// `verify` finds one number that is not the scan's, and one where there should be none.
#[test]
fn other_numbers_are_refuted() {
    let b = built(&bumpy_ball(40), &["height", "label"]);
    let text = std::fs::read_to_string(&b.scan).unwrap();
    let (header, body) = text.split_once("end_header\n").unwrap();
    let changed = |change: &dyn Fn(&mut Vec<String>)| {
        let lines: Vec<String> = body
            .lines()
            .enumerate()
            .map(|(i, line)| {
                let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
                if i == 700 {
                    change(&mut words);
                }
                words.join(" ")
            })
            .collect();
        let other = b.folder.path().join("other.ply");
        std::fs::write(&other, format!("{header}end_header\n{}\n", lines.join("\n"))).unwrap();
        against(&b.file, &other)
    };
    assert!(!changed(&|_| ()).is_refuted());
    let step = range(&b.file, 0).step;
    let moved = |by: f64| {
        move |w: &mut Vec<String>| {
            w[3] = format!("{}", w[3].parse::<f64>().unwrap() + by);
        }
    };
    assert!(changed(&moved(1.1 * step)).is_refuted());
    assert!(changed(&|w| w[3] = "nan".into()).is_refuted());
    assert!(changed(&|w| w[4] = "77".into()).is_refuted());
}

/// What one leaf has at one place.
type Side = (CellKey, Vec<Scalars>);

/// Where two leaves of a depth meet they have the same numbers, bit for bit.
#[test]
fn both_sides_of_a_cut_have_the_same_numbers() {
    let b = built(&bumpy_ball(80), &["height", "label"]);
    let mut at: HashMap<([u64; 3], u8), Vec<Side>> = HashMap::new();
    for (cell, kind, _, rows) in pages(&b.file) {
        if kind == RepresentationKind::Source {
            for (p, scalars) in rows {
                let sides = at.entry((p.to_array().map(f64::to_bits), cell.depth())).or_default();
                match sides.iter_mut().find(|side| side.0 == cell) {
                    Some(side) => side.1.push(scalars),
                    None => sides.push((cell, vec![scalars])),
                }
            }
        }
    }
    let (mut shared, mut equal) = (0, 0);
    let step = HlodFile::open(&b.file).unwrap().header().lattice.step;
    let codes = 1 + (GRADIENT * 2.0 * step / range(&b.file, 0).step) as u16;
    for sides in at.values_mut().filter(|sides| sides.len() > 1) {
        // Several edges can be cut at one place.
        sides.iter_mut().for_each(|(_, scalars)| scalars.sort_unstable());
        for (_, scalars) in &sides[1..] {
            let first = &sides[0].1;
            shared += 1;
            equal += usize::from(scalars == first);
            // Of several edges that are cut within a step, slivers that rounding makes vanish take some
            // with them: what is left is as near in value as in place.
            let near = |s: &Scalars| s.0[0].abs_diff(first[0].0[0]) <= codes;
            assert!(scalars.iter().all(near), "{scalars:?} {first:?}");
        }
    }
    eprintln!("{equal} of {shared} equal, others within {codes} codes");
    assert!(shared > 200 && equal > shared * 98 / 100, "{equal} of {shared} places");
}

/// Levels above have means: never beyond the scan's numbers, and of a number that is linear in the place what
/// lies within a few errors of it. Where nothing was measured there is nothing, but for a margin.
#[test]
fn upper_levels_have_means_of_what_they_stand_for() {
    for primitives in [hlod_compress::Primitives::Triangles, hlod_compress::Primitives::Points] {
        let folder = tempfile::tempdir().unwrap();
        let [scan, file] = ["scan.ply", "scan.hlod"].map(|name| folder.path().join(name));
        std::fs::write(&scan, with_numbers(&bumpy_ball(120))).unwrap();
        hlod_tests::built(&scan, &file, |o| {
            (o.leaf_triangles, o.resolution, o.primitives) = (700, 32, primitives);
            o.keep = keep(&["height"]);
        });
        let heights = range(&file, 0);
        let (mut known, mut in_hole, mut outside, mut lost) = (0, 0, 0, 0);
        let mut farthest = 0.0f64;
        for (_, kind, error, rows) in pages(&file) {
            if kind != RepresentationKind::Appearance {
                continue;
            }
            for (p, scalars) in rows {
                let margin = 40.0 * error;
                match heights.value(scalars.0[0]) {
                    Some(found) => {
                        known += 1;
                        farthest = farthest.max((found - height(p)).abs() / GRADIENT / error);
                        in_hole += usize::from(p.z > 0.7 + margin);
                    }
                    None => {
                        outside += usize::from(p.z < 0.7 - margin);
                        lost += 1;
                    }
                }
            }
        }
        eprintln!("{primitives:?} {known} known, {lost} not, up to {farthest:.2} errors away");
        assert!(known > 1_000 && lost > 50, "{known} {lost}");
        assert_eq!((in_hole, outside), (0, 0));
        assert!(farthest < 40.0, "{farthest} errors");
    }
}

/// Full resolution has the triangles that it has without; only where numbers differ at one place are there
/// more vertices.
#[test]
fn keeping_changes_no_shape() {
    let kept = built(&bumpy_ball(60), &["height", "label"]);
    let plain = built(&bumpy_ball(60), &[]);
    let triangles = |path: &Path| -> Vec<(CellKey, Vec<[[i32; 3]; 3]>)> {
        let file = HlodFile::open(path).unwrap();
        let leaves = file.read_skeleton().unwrap().into_iter().filter(|node| node.is_leaf());
        let of_leaf = |node: hlod_compress::NodeRecord| {
            let page = file.read_page(node.representations[0].page).unwrap();
            let mesh = decode_page(&page).unwrap().mesh;
            let corners = |t: &[u32; 3]| {
                let mut corners = t.map(|v| mesh.positions[v as usize]);
                let first = (0..3).min_by_key(|&k| corners[k]).unwrap();
                corners.rotate_left(first);
                corners
            };
            let mut all: Vec<_> = mesh.triangles.iter().map(corners).collect();
            all.sort_unstable();
            (node.cell, all)
        };
        leaves.map(of_leaf).collect()
    };
    assert!(triangles(&kept.file) == triangles(&plain.file));
    let levels = |path: &Path| info(path).unwrap().levels;
    for (a, b) in levels(&kept.file).iter().zip(levels(&plain.file)) {
        assert!((a.triangles_mean / b.triangles_mean - 1.0).abs() < 0.01, "{a:?} {b:?}");
        assert!((a.error_max / b.error_max.max(1e-30) - 1.0).abs() < 0.2 || b.error_max == 0.0);
    }
    let version = |b: &Built| HlodFile::open(&b.file).unwrap().header().format_version();
    assert_eq!((version(&kept), version(&plain)), (3, 1));
}

#[test]
fn the_same_bytes_whatever_memory_and_threads() {
    let folder = tempfile::tempdir().unwrap();
    let scan = folder.path().join("scan.ply");
    for (name, ply) in [("ball", bumpy_ball(160)), ("cloud", ball_cloud(30_000))] {
        std::fs::write(&scan, with_numbers(&ply)).unwrap();
        let bytes = |threads: usize, memory_mib: u64| {
            let file = folder.path().join(format!("{name}-{threads}-{memory_mib}.hlod"));
            rayon_pool(threads).install(|| {
                hlod_tests::built(&scan, &file, |o| {
                    (o.leaf_triangles, o.memory_bytes) = (500, memory_mib << 20);
                    o.keep = keep(&["label", "height"]);
                })
            });
            std::fs::read(file).unwrap()
        };
        let first = bytes(1, 4096);
        assert!(first == bytes(3, 4096), "{name}: one thread and three write different files");
        assert!(first == bytes(2, 80), "{name}: more and less memory write different files");
    }
}

/// A square of 2 × 2 in the plane z = 0, whose number is 10 · x, and none beyond y = 0.5.
fn square(n: i32) -> String {
    let mut vertices = String::new();
    let mut faces = String::new();
    let place = |i: i32| 2.0 * f64::from(i) / f64::from(n) - 1.0;
    for y in 0..=n {
        for x in 0..=n {
            let value = if place(y) > 0.5 { f64::NAN } else { 10.0 * place(x) };
            vertices += &format!("{} {} 0 {value}\n", place(x), place(y));
            if x < n && y < n {
                let v = y * (n + 1) + x;
                faces += &format!(
                    "3 {v} {} {}\n3 {} {} {}\n",
                    v + 1,
                    v + n + 1,
                    v + 1,
                    v + n + 2,
                    v + n + 1
                );
            }
        }
    }
    format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float speed\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n{vertices}{faces}",
        (n + 1) * (n + 1),
        2 * n * n
    )
}

/// What is seen of a plane from straight ahead has the legend's colours, pixel by pixel, at every level.
#[test]
fn pictures_have_the_colours_of_the_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let [scan, file] = ["scan.ply", "scan.hlod"].map(|name| folder.path().join(name));
    std::fs::write(&scan, square(60)).unwrap();
    hlod_tests::built(&scan, &file, |o| {
        (o.leaf_triangles, o.resolution) = (600, 32);
        o.keep = keep(&["speed=m/s"]);
    });
    let gpu = hlod_tests::gpu();
    for (representation, slack) in [(Representation::Full, 0.3), (Representation::Hybrid, 0.8)] {
        let model = Model::open(&gpu, &file, ModelLimits::default()).unwrap();
        let framing = Framing::of(&model);
        let paint = Paint::of_name("speed", model.header()).unwrap();
        let camera = orthographic(&framing, DVec3::Z, DVec3::Y, 2.0);
        let shot = Shot { camera, paint, ..crate::pictures::shot(&framing, representation) };
        const N: u32 = 200;
        let mut sheet = Sheet::of(&shot, N, N);
        let picture = sheet.picture(&gpu, &mut [model]).unwrap();
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(N) * 2.0 - 1.0;
        let (mut wrong, mut shifted, mut grey) = (0, 0, 0);
        for y in 2..N - 2 {
            for x in 2..N - 2 {
                let pixel = &picture.rgba[4 * (y * N + x) as usize..][..3];
                let up = -at(y);
                let is_colour = |value: f64| {
                    let near = |t: f64| {
                        let colour = viridis(((value + t) / 20.0 + 0.5) as f32);
                        (0..3).all(|i| pixel[i].abs_diff(colour[i]) <= 4)
                    };
                    [-slack, -slack / 2.0, 0.0, slack / 2.0, slack].into_iter().any(near)
                };
                if up > 0.6 {
                    grey += usize::from(pixel == NO_VALUE);
                } else if up < 0.4 {
                    wrong += usize::from(!is_colour(10.0 * at(x)));
                    shifted += usize::from(!is_colour(10.0 * at(x) + 4.0 * slack));
                }
            }
        }
        let pixels = ((N - 4) * (N - 4)) as usize;
        assert!(wrong < pixels / 100, "{representation:?}: {wrong} of {pixels}");
        assert!(shifted > pixels / 2, "{representation:?}: {shifted} of {pixels}");
        assert!(grey > pixels / 6, "{representation:?}: {grey} of {pixels}");
        // Parts have what the whole has.
        sheet.part_px = Some(37);
        let model = Model::open(&gpu, &file, ModelLimits::default()).unwrap();
        assert!(sheet.picture(&gpu, &mut [model]).unwrap().rgba == picture.rgba);
    }
}

#[test]
fn shots_have_a_legend_and_refuse_other_names() {
    let b = built(&bumpy_ball(40), &["height=mm", "label"]);
    let shot = |paint: &str, output: &str| {
        let mut command = program("hlod-render");
        command.current_dir(b.folder.path()).args(["--software", "-q", "shot"]).arg(&b.file);
        command.args(["--size", "300x200", "--paint", paint, "-o", output]).output().unwrap()
    };
    let output = shot("height", "a.png");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(shot("value:label", "b.png").status.success());
    let png = std::fs::File::open(b.folder.path().join("a.png")).unwrap();
    let mut reader = png::Decoder::new(std::io::BufReader::new(png)).read_info().unwrap();
    let texts = reader.info().utf8_text.clone();
    let description = texts.iter().find(|t| t.keyword == "Description").unwrap();
    assert!(description.get_text().unwrap().contains("colours: height, mm from -98"));
    let mut rgba = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut rgba).unwrap();
    // The ends of the legend's bar are the ends of the map.
    let has = |colour: [u8; 3]| rgba.chunks_exact(4).any(|p| p[..3] == colour);
    assert!(has(viridis(0.005)) && has(viridis(0.995)));
    let output = shot("bound", "d.png");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let png = std::fs::File::open(b.folder.path().join("d.png")).unwrap();
    let reader = png::Decoder::new(std::io::BufReader::new(png)).read_info().unwrap();
    let texts = reader.info().utf8_text.clone();
    let description = texts.iter().find(|t| t.keyword == "Description").unwrap();
    assert!(description.get_text().unwrap().contains("colours: bound"), "{description:?}");
    let output = shot("quality", "c.png");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains(
            "this file has shaded, depth, borders, normals, bound, kinds, edges, curvature, height, label"
        ),
        "{said}"
    );
}

fn read_back(path: &Path, name: &str) -> Vec<Row2> {
    let keep = [name.to_owned()];
    let folder = std::env::temp_dir();
    let options = ReadOptions {
        memory_bytes: 1 << 20,
        scratch: &folder,
        colour: ColourSource::Auto,
        transform: None,
        progress: &mut |_| true,
        keep: &keep,
    };
    let mut reader = ScanReader::open_within(path, options).unwrap();
    let mut out = Vec::new();
    while let Some(batch) = reader.next_batch().unwrap() {
        if let Batch::Vertices(batch) = batch {
            out.extend(batch.positions.into_iter().zip(batch.scalars[0].clone()));
        }
    }
    out
}
type Row2 = (DVec3, f64);

#[test]
fn exports_have_them_as_properties_again() {
    for ply in [bumpy_ball(60), ball_cloud(3_000)] {
        let b = built(&ply, &["height=0.5 mm"]);
        let out = b.folder.path().join("out.ply");
        let kind = RepresentationKind::Appearance;
        export(&b.file, &out, Selection::Leaves, kind, false).unwrap();
        let found = read_back(&out, "height");
        let slack = 0.5 + GRADIENT * 2.0 * HlodFile::open(&b.file).unwrap().header().lattice.step;
        assert!(slack < 1.5, "{slack}");
        let known = found.iter().filter(|row| !row.1.is_nan() && !is_beside_hole(row.0));
        assert!(known.clone().count() > 2_000);
        assert!(known.clone().all(|(p, value)| (value - height(*p)).abs() <= slack));
        assert!(!known.clone().all(|(p, value)| (value - height(*p + 0.02)).abs() <= slack));
        let holes = found.iter().filter(|row| row.1.is_nan()).count();
        assert!(holes > 100, "{holes}");
    }
}

#[test]
fn clouds_keep_theirs() {
    let b = built(&ball_cloud(20_000), &["height", "label"]);
    let verified = against(&b.file, &b.scan);
    assert!(!verified.is_refuted(), "{:?}", verified.problems);
    assert!(verified.values_compared > 19_000, "{}", verified.values_compared);
    let heights = range(&b.file, 0);
    for (_, _, _, rows) in pages(&b.file) {
        for (p, scalars) in rows {
            let found = heights.value(scalars.0[0]);
            // The cloud lies about x = 3: nothing of it is in the hole but by its z.
            assert!(found.is_some() || p.z > 0.4, "{p}");
        }
    }
}

#[test]
fn info_lists_them_and_wrong_names_are_refused() {
    let b = built(&bumpy_ball(30), &["height=0.25mm", "label"]);
    let found = info(&b.file).unwrap().scalars;
    assert_eq!((found[0].name.as_str(), found[0].unit.as_str()), ("height", "mm"));
    assert_eq!((found[0].step, found[0].precision), (0.25, 0.125));
    assert_eq!((found[1].minimum, found[1].maximum), (Some(3.0), Some(200.0)));
    let table = program("hlod-build").arg("info").arg(&b.file).output().unwrap();
    let table = String::from_utf8(table.stdout).unwrap();
    assert!(table.contains("label 3 to 200, to ± 0.5"), "{table}");

    let out = b.folder.path().join("x.hlod");
    for (keep, status, says) in [
        (&["quality"][..], 2, "scan.ply has height, label"),
        (&["height", "height"], 2, "given twice"),
        (&["a", "b", "c", "d", "e"], 2, "at most 4"),
        (&["height=1e-9"], 2, "the finest step for height is 0.00"),
        (&["=3"], 2, "expected NAME"),
        (&["x"], 2, "--keep x"),
    ] {
        let mut build = program("hlod-build");
        build.arg("build").arg(&b.scan).arg("-o").arg(&out);
        for name in keep {
            build.args(["--keep", name]);
        }
        let output = build.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(status), "{keep:?}: {said}");
        assert!(said.contains(says), "{keep:?}: {said}");
        assert_eq!(std::fs::read_dir(b.folder.path()).unwrap().count(), 2, "nothing is left");
    }
    // What is there and was not asked for is named.
    let output = program("hlod-build").arg("build").arg(&b.scan).arg("-o").arg(&out).output();
    let said = String::from_utf8_lossy(&output.unwrap().stderr).into_owned();
    assert!(said.contains("not used: property vertex.height, property vertex.label"), "{said}");
}
