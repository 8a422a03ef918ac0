//! What is exported is what is in the file, for readers that are not ours too, and can be built again.

use std::path::{Path, PathBuf};

use glam::{DMat4, DVec3};
use hlod_build::progress::Silent;
use hlod_build::synth::{StatueOptions, write_statue};
use hlod_build::{BuildError, BuildOptions, ExportReport, Selection, build, export};
use hlod_compress::srgb::srgb_from_linear;
use hlod_compress::{HlodFile, Lattice, Metadata, RepresentationKind};
use hlod_scan::{Batch, ScanReader};
use hlod_tests::scan;

use crate::kept::with_numbers;

/// Where rounding to `f32` shows.
const FAR: DVec3 = DVec3::new(654_321.2, 5_412_345.7, 312.1);

struct Files(tempfile::TempDir);

impl Files {
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

fn files() -> Files {
    Files(tempfile::tempdir().unwrap())
}

fn leaves(hlod: &Path, output: &Path) -> Result<ExportReport, BuildError> {
    export(hlod, output, Selection::Leaves, RepresentationKind::Appearance, true)
}

fn built(input: &Path, output: &Path, change: impl FnOnce(&mut BuildOptions)) {
    let mut options = BuildOptions { force: true, ..BuildOptions::default() };
    change(&mut options);
    build(&[input.to_owned()], output, &options, &Silent).unwrap();
}

/// A vertex: position in steps of a lattice, bits of the normal, colour.
type Vertex = ([i64; 3], [u32; 3], Option<[u8; 4]>);

/// All triangles by their corners, which begin with the least, in order; without triangles, all points. Positions
/// lie on the lattice but for the rounding of coordinates.
fn geometry(path: &Path, lattice: &Lattice) -> Vec<[Vertex; 3]> {
    let steps = |p: DVec3| {
        let steps = (p - DVec3::from_array(lattice.origin)) / lattice.step;
        let off = (steps - steps.round()).abs().max_element();
        assert!(off < 1e-3, "{p} is {off} steps off the lattice");
        steps.round().to_array().map(|x| x as i64)
    };
    let mut reader = ScanReader::open(path).unwrap();
    let (mut vertices, mut out) = (Vec::<Vertex>::new(), Vec::new());
    let is_cloud = reader.header().is_point_cloud;
    while let Some(batch) = reader.next_batch().unwrap() {
        match batch {
            Batch::Vertices(batch) => {
                let position = |i: usize| steps(batch.positions[i]);
                let normal = |i: usize| batch.normals[i].to_array().map(|x| (x + 0.0).to_bits());
                let colour = |i: usize| batch.colours.get(i).copied();
                vertices.extend(
                    (0..batch.positions.len()).map(|i| (position(i), normal(i), colour(i))),
                );
            }
            Batch::Triangles(batch) => out.extend(batch.triangles.iter().map(|triangle| {
                let mut corners = triangle.map(|v| vertices[v as usize]);
                let least = (0..3).min_by_key(|k| corners[*k]).unwrap();
                corners.rotate_left(least);
                corners
            })),
        }
    }
    if is_cloud {
        out.extend(vertices.iter().map(|v| [*v; 3]));
    }
    out.sort_unstable();
    out
}

/// Of leaves that were exported and built again nothing moves, appears or goes.
fn comes_back(files: &Files, hlod: &Path, what: &str) {
    let [first, second] = ["first.ply", "second.ply"].map(|name| files.path(name));
    leaves(hlod, &first).unwrap();
    let again = files.path("again.hlod");
    built(&first, &again, |_| ());
    leaves(&again, &second).unwrap();
    let lattice = HlodFile::open(hlod).unwrap().header().lattice;
    let (before, after) = (geometry(&first, &lattice), geometry(&second, &lattice));
    assert_eq!(before.len(), after.len(), "{what}");
    assert!(before == after, "{what}: leaves differ");
    // What is compared tells one step of one corner from none.
    let mut other = after;
    let last = other.last_mut().unwrap();
    last[2].0[0] += 1;
    assert!(before != other);
}

#[test]
fn leaves_come_back_when_they_are_built_again() {
    let files = files();
    let statue = files.path("statue.ply");
    write_statue(&StatueOptions { triangles: 150_000, seed: 1 }, &statue, true, &mut |_, _| {})
        .unwrap();
    let hlod = files.path("statue.hlod");
    built(&statue, &hlod, |_| ());
    comes_back(&files, &hlod, "statue");
    // Coordinates that fill their digits, and a lattice that the file does not have by itself.
    let far = files.path("far.ply");
    std::fs::write(&far, coloured_ball(FAR)).unwrap();
    let hlod = files.path("far.hlod");
    built(&far, &hlod, |options| options.leaf_triangles = 1000);
    comes_back(&files, &hlod, "far away");
    for name in ["bunny/bun_zipper.ply", "igea/igea_tristrips.ply"] {
        let Some(path) = scan("exports::leaves_come_back_when_they_are_built_again", name) else {
            return;
        };
        let hlod = files.path("scan.hlod");
        built(&path, &hlod, |_| ());
        comes_back(&files, &hlod, name);
    }
}

/// A ball of radius 1 at `centre` whose colours tell where they are.
fn coloured_ball(centre: DVec3) -> String {
    let text = hlod_tests::ball(40, 0.0);
    let (header, body) = text.split_once("end_header\n").unwrap();
    let colours = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let (before, after) = header.split_once("element face").unwrap();
    let mut out = format!("{before}{colours}element face{after}end_header\n");
    out = out.replace("property float", "property double");
    for line in body.lines() {
        let words: Vec<f64> = line.split(' ').map(|w| w.parse().unwrap()).collect();
        if words.len() == 4 && words[0] == 3.0 {
            out += &format!("{line}\n");
            continue;
        }
        let p = DVec3::new(words[0], words[1], words[2]);
        let [r, g, b] = colour_at(p);
        let p = p + centre;
        out += &format!("{} {} {} {r} {g} {b}\n", p.x, p.y, p.z);
    }
    out
}

fn colour_at(p: DVec3) -> [u8; 3] {
    p.to_array().map(|x| (127.5 * (x.clamp(-1.0, 1.0) + 1.0)) as u8)
}

/// What the library for glTF finds, in the scene's frame.
struct Scene {
    positions: Vec<DVec3>,
    colours: Vec<[u8; 4]>,
    triangles: usize,
    points: usize,
    document: gltf::Document,
}

fn scene(path: &Path) -> Scene {
    let gltf = gltf::Gltf::open(path).unwrap();
    let blob = gltf.blob.as_deref().unwrap();
    let mut frame = DMat4::IDENTITY;
    let mut node = gltf.default_scene().unwrap().nodes().next().unwrap();
    loop {
        let own = node.transform().matrix().map(|column| column.map(f64::from));
        frame *= DMat4::from_cols_array_2d(&own);
        match node.children().next() {
            Some(child) => node = child,
            None => break,
        }
    }
    let (mut positions, mut colours, mut triangles, mut points) = (Vec::new(), Vec::new(), 0, 0);
    for primitive in node.mesh().unwrap().primitives() {
        let reader = primitive.reader(|_| Some(blob));
        let found = reader.read_positions().unwrap();
        positions =
            found.map(|p| frame.transform_point3(glam::Vec3::from_array(p).as_dvec3())).collect();
        for (n, _) in reader.read_normals().unwrap().zip(&positions) {
            assert!((glam::Vec3::from_array(n).length() - 1.0).abs() < 1e-5);
        }
        colours = reader.read_colors(0).map_or(Vec::new(), |colours| {
            let srgb = |[r, g, b, a]: [f32; 4]| {
                let [r, g, b] = [r, g, b].map(srgb_from_linear);
                [r, g, b, (255.0 * a).round() as u8]
            };
            colours.into_rgba_f32().map(srgb).collect()
        });
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        assert!(indices.iter().all(|i| (*i as usize) < positions.len()));
        match primitive.mode() {
            gltf::mesh::Mode::Triangles => triangles += indices.len() / 3,
            gltf::mesh::Mode::Points => points += indices.len(),
            other => panic!("{other:?}"),
        }
    }
    Scene { positions, colours, triangles, points, document: gltf.document }
}

/// Positions and colours of an exported PLY, in its order, which is the GLB's.
fn vertices(path: &Path) -> (Vec<DVec3>, Vec<[u8; 4]>) {
    let mut reader = ScanReader::open(path).unwrap();
    let (mut positions, mut colours) = (Vec::new(), Vec::new());
    while let Some(Batch::Vertices(batch)) = reader.next_batch().unwrap() {
        positions.extend(batch.positions);
        colours.extend(batch.colours);
    }
    (positions, colours)
}

#[test]
fn glb_has_the_same_vertices_in_metres_with_y_up() {
    let files = files();
    std::fs::write(files.path("ball.ply"), coloured_ball(FAR)).unwrap();
    let hlod = files.path("ball.hlod");
    built(&files.path("ball.ply"), &hlod, |options| {
        options.unit = "mm".parse().unwrap();
        options.up = "+z".parse().unwrap();
        options.front = "-y".parse().unwrap();
        options.leaf_triangles = 1000;
    });
    let [exact, glb] = ["out.ply", "out.glb"].map(|name| files.path(name));
    let in_ply = leaves(&hlod, &exact).unwrap();
    let in_glb = leaves(&hlod, &glb).unwrap();
    assert_eq!((in_ply.triangles, in_ply.rounding_max), (in_glb.triangles, 0.0));
    let (positions, colours) = vertices(&exact);
    let scene = scene(&glb);
    assert_eq!((scene.triangles as u64, scene.points), (in_glb.triangles, 0));
    assert_eq!(scene.colours, colours);
    assert_eq!(scene.positions.len(), positions.len());
    // +z is up and -y in front, so that +x stays to the right.
    let turned = |p: DVec3| DVec3::new(p.x, p.z, -p.y) * 1e-3;
    // Matrices of glTF libraries are of 32 bits, a millimetre in metres among them.
    let off = |frame: &dyn Fn(DVec3) -> DVec3| {
        let pairs = scene.positions.iter().zip(&positions);
        let scale = 1e-3 / f64::from(1e-3f32);
        pairs.map(|(a, b)| (*a * scale).distance(frame(*b))).fold(0.0, f64::max)
    };
    assert!(in_glb.rounding_max > 0.0 && in_glb.rounding_max < 1e-6, "{in_glb:?}");
    assert!(off(&turned) <= 1e-3 * in_glb.rounding_max + 1e-12, "{}", off(&turned));
    assert!(off(&|p| p * 1e-3) > 1.0, "not turned");
}

#[test]
fn glb_of_points_and_of_upper_levels_and_what_has_no_place_in_it() {
    let files = files();
    std::fs::write(files.path("ball.ply"), with_numbers(&hlod_tests::ball(60, 0.0))).unwrap();
    let hlod = files.path("ball.hlod");
    built(&files.path("ball.ply"), &hlod, |options| {
        options.keep = vec!["height".parse().unwrap()];
        options.leaf_triangles = 500;
        options.metadata = Some(Metadata::parse(METADATA.as_bytes()).unwrap());
    });
    let [exact, glb] = ["out.ply", "out.glb"].map(|name| files.path(name));
    let kind = RepresentationKind::Geometric;
    for selection in [Selection::Depth(0), Selection::Depth(1), Selection::MaxTriangles(2000)] {
        let in_ply = export(&hlod, &exact, selection, kind, true).unwrap();
        let in_glb = export(&hlod, &glb, selection, kind, true).unwrap();
        assert_eq!((in_ply.vertices, in_ply.left_out.len()), (in_glb.vertices, 0));
        assert_eq!(in_glb.left_out, ["height"]);
        let scene = scene(&glb);
        assert_eq!(scene.triangles as u64, in_glb.triangles);
        let (positions, _) = vertices(&exact);
        let pairs = scene.positions.iter().zip(&positions);
        let off = pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(off <= in_glb.rounding_max + 1e-9, "{off} {in_glb:?}");
        // Whose it is goes with it.
        let asset = scene.document.into_json().asset;
        assert!(asset.copyright.is_some_and(|text| text.contains("Museum of Casts")));
    }
    let header = String::from_utf8_lossy(&std::fs::read(&exact).unwrap()).into_owned();
    assert!(header.contains("comment holder: Museum of Casts\n"), "{header:.400}");

    // Points alone, and a name that says no format.
    let cloud = crate::points::ball_cloud(4_000);
    std::fs::write(files.path("cloud.ply"), cloud).unwrap();
    built(&files.path("cloud.ply"), &hlod, |_| ());
    let report = leaves(&hlod, &glb).unwrap();
    let scene = scene(&glb);
    assert_eq!((scene.triangles, scene.points as u64), (0, report.vertices));
    let error = leaves(&hlod, &files.path("out.obj")).unwrap_err().to_string();
    assert!(error.contains(".ply or .glb") && !files.path("out.obj").exists(), "{error}");
}

const METADATA: &str =
    r#"{ "label": { "en": ["Ball"] }, "holder": { "en": ["Museum of Casts"] } }"#;

/// Our reader takes what our writer makes, in metres.
#[test]
fn a_glb_is_built_again_within_its_rounding() {
    let files = files();
    std::fs::write(files.path("ball.ply"), hlod_tests::ball(12, 0.0)).unwrap();
    let [hlod, again] = ["a.hlod", "b.hlod"].map(|name| files.path(name));
    built(&files.path("ball.ply"), &hlod, |_| ());
    let report = leaves(&hlod, &files.path("out.glb")).unwrap();
    built(&files.path("out.glb"), &again, |_| ());
    let [before, after] = [&hlod, &again].map(|file| hlod_build::info(file).unwrap());
    assert_eq!(before.triangles_input, report.triangles);
    assert_eq!(before.triangles_input, after.triangles_input);
    let steps = before.precision_step + after.precision_step + report.rounding_max;
    for (a, b) in before.bounds_min.iter().zip(after.bounds_min) {
        assert!((a - b).abs() <= steps, "{before:?} {after:?}");
    }
}
