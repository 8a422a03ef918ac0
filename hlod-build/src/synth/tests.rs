//! Tests of the whole way from options to a mesh.

use super::field::Field;
use super::grid::{CELLS, Grid, OUTSIDE, Search, TILE};
use super::polygonise::Sink;
use super::relief::Panel;
use super::*;
use glam::DVec3;
use std::convert::Infallible;

#[derive(Default)]
struct Mesh {
    vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Sink for Mesh {
    type Error = Infallible;
    fn vertices(&mut self, vertices: &[[f32; 3]]) -> Result<(), Infallible> {
        self.vertices.extend(vertices);
        Ok(())
    }
    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<(), Infallible> {
        self.triangles.extend(triangles);
        Ok(())
    }
}

impl Mesh {
    fn at(&self, v: u32) -> DVec3 {
        glam::Vec3::from(self.vertices[v as usize]).as_dvec3()
    }
}

fn options(triangles: u64, seed: u64) -> StatueOptions {
    StatueOptions { triangles, seed }
}

fn make(triangles: u64, seed: u64) -> (Mesh, f64) {
    let mut mesh = Mesh::default();
    let Ok(step) = polygonise_statue(&options(triangles, seed), &mut mesh);
    (mesh, step)
}

fn directed_edges(mesh: &Mesh) -> Vec<(u32, u32)> {
    let mut edges: Vec<(u32, u32)> =
        mesh.triangles.iter().flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]).collect();
    edges.sort_unstable();
    edges
}

/// Every directed edge has exactly one opposite.
fn assert_closed(edges: &[(u32, u32)]) {
    assert!(edges.windows(2).all(|w| w[0] != w[1]), "an edge used twice");
    for (a, b) in edges {
        assert!(a != b, "a triangle uses vertex {a} twice");
        assert!(edges.binary_search(&(*b, *a)).is_ok(), "edge {a} → {b} has no opposite");
    }
}

fn components(mesh: &Mesh, edges: &[(u32, u32)]) -> usize {
    let mut parent: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    fn find(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for (a, b) in edges {
        let (a, b) = (find(&mut parent, *a), find(&mut parent, *b));
        parent[a as usize] = b;
    }
    (0..parent.len() as u32).filter(|v| parent[*v as usize] == *v).count()
}

#[test]
fn closed_oriented_and_one_ball() {
    for (triangles, seed) in [(30_000, 1), (30_000, 2), (100_000, 3)] {
        let (mesh, step) = make(triangles, seed);
        let edges = directed_edges(&mesh);
        assert_closed(&edges);
        assert_eq!(components(&mesh, &edges), 1);
        let euler =
            mesh.vertices.len() as i64 - edges.len() as i64 / 2 + mesh.triangles.len() as i64;
        assert_eq!(euler, 2, "{triangles} triangles, seed {seed}");
        // Outwards: the field grows along the normals, and the volume is positive.
        let field = body::statue(seed, step);
        let whole: f64 = mesh
            .triangles
            .iter()
            .map(|t| mesh.at(t[0]).dot(mesh.at(t[1]).cross(mesh.at(t[2]))) / 6.0)
            .sum();
        assert!(whole > 1.5e7, "a volume of {whole} mm³");
        let (mut outward, mut all) = (0, 0);
        for t in mesh.triangles.iter().step_by(37) {
            let [a, b, c] = t.map(|v| mesh.at(v));
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let at = |d: f64| ((a + b + c) / 3.0 + normal * d).as_vec3().to_array();
            all += 1;
            outward += u32::from(field.at(at(0.3 * step)) > field.at(at(-0.3 * step)));
        }
        // In creases deeper than the grid is fine, a normal may miss.
        assert!(outward * 1000 > all * 985, "{outward} of {all} outward");
    }
}

/// Signs at random in one tile meet every ambiguous case; its neighbours are outside, with samples
/// or, as where a bound of the field missed a rim of it, without.
fn random_tile(neighbours_have_samples: bool) -> Mesh {
    let grid = Grid::new(12.0);
    let sample = |k: usize| {
        let mut slab =
            grid::Slab { index: vec![OUTSIDE; grid.tiles[0] * grid.tiles[1]], tiles: Vec::new() };
        for at in (0..9).map(|n| [n % 3, n / 3]).filter(|_| k < 3) {
            let random = k == 1 && at == [1, 1];
            if !random && !neighbours_have_samples {
                continue;
            }
            let sign = |i: u64| {
                if random && noise::hash64(i) & 1 == 0 { -1.0 - (i % 7) as f32 } else { 1.0 }
            };
            slab.index[at[1] * grid.tiles[0] + at[0]] = slab.tiles.len() as u32;
            slab.tiles.push(grid::Tile { at, samples: (0..CELLS as u64).map(sign).collect() });
        }
        slab
    };
    let noise = ScannerNoise { sigma: 0.0, seed: 0 };
    let mut mesh = Mesh::default();
    let Ok(()) = polygonise::polygonise_slabs(&grid, sample, noise, &mut mesh);
    mesh
}

#[test]
fn closed_where_two_sheets_share_cells() {
    let mesh = random_tile(true);
    assert!(mesh.triangles.len() > 5_000);
    assert_closed(&directed_edges(&mesh));
}

#[test]
fn closed_where_a_tile_was_missed() {
    let (mesh, whole) = (random_tile(false), random_tile(true));
    assert_closed(&directed_edges(&mesh));
    assert_eq!(mesh.triangles.len(), whole.triangles.len());
}

#[test]
fn as_many_triangles_as_asked() {
    for triangles in [30_000u64, 100_000, 300_000] {
        let made = make(triangles, 1).0.triangles.len() as f64;
        let off = made / triangles as f64 - 1.0;
        assert!(off.abs() < 0.03, "{made} for {triangles}");
    }
}

#[test]
fn same_bytes_with_any_number_of_threads_and_others_with_another_seed() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = |threads: usize, seed: u64| {
        let out = folder.path().join(format!("{threads}-{seed}.ply"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let report = pool
            .install(|| write_statue(&options(20_000, seed), &out, false, &mut |_, _| {}))
            .unwrap();
        let bytes = std::fs::read(&out).unwrap();
        assert_eq!(bytes.len() as u64, report.file_bytes);
        bytes
    };
    let one = bytes(1, 5);
    assert!(one == bytes(2, 5));
    assert!(one != bytes(2, 6));
}

#[test]
fn ply_says_what_follows() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("statue.ply");
    let mut calls = Vec::new();
    let report = write_statue(&options(20_000, 1), &out, false, &mut |done, all| {
        calls.push((done, all));
    })
    .unwrap();
    let bytes = std::fs::read(&out).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
    assert!(header.contains(&format!("\nelement vertex {}\n", report.vertices)));
    assert!(header.contains(&format!("\nelement face {}\n", report.triangles)));
    let faces = &bytes[end + 12 * report.vertices as usize..];
    assert_eq!(faces.len() as u64, 13 * report.triangles);
    for face in faces.chunks_exact(13) {
        assert_eq!(face[0], 3);
        for index in face[1..].chunks_exact(4) {
            let index = u32::from_le_bytes(index.try_into().unwrap());
            assert!(u64::from(index) < report.vertices);
        }
    }
    // Nothing else stays in the folder, and progress only grows.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert!(calls.windows(2).all(|w| w[0].0 <= w[1].0 || w[1].0 == w[1].1));
}

#[test]
fn refuses_what_it_cannot_do() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("statue.ply");
    let write = |triangles, out: &Path, force| {
        write_statue(&options(triangles, 1), out, force, &mut |_, _| {})
    };
    assert!(matches!(write(9_999, &out, false), Err(SynthError::Triangles(9_999))));
    assert!(matches!(write(2_000_000_000, &out, false), Err(SynthError::Triangles(_))));
    std::fs::write(&out, "mine").unwrap();
    assert!(matches!(write(10_000, &out, false), Err(SynthError::Exists(_))));
    assert_eq!(std::fs::read(&out).unwrap(), b"mine");
    write(10_000, &out, true).unwrap();
    assert!(std::fs::read(&out).unwrap().starts_with(b"ply\n"));
    let nowhere = folder.path().join("no/statue.ply");
    assert!(matches!(write(10_000, &nowhere, false), Err(SynthError::Write { .. })));
}

/// Where a line along z from the front first meets the stone.
fn front(field: &Field, x: f64, y: f64) -> f64 {
    let (mut outside, mut inside) = (Panel::FRONT + 1.0, Panel::FRONT - 3.0);
    for _ in 0..60 {
        let z = 0.5 * (outside + inside);
        if field.at([x as f32, y as f32, z as f32]) > 0.0 {
            outside = z;
        } else {
            inside = z;
        }
    }
    0.5 * (outside + inside)
}

#[test]
fn cuts_are_as_deep_as_described() {
    let field = body::statue(1, 0.5);
    let truth = describe(&options(8_000_000, 1));
    let groove = &truth.groove;
    let [a, b] = groove.ends_mm;
    let (x, y) = (0.5 * (a[0] + b[0]), a[1]);
    assert!((groove.length_mm - 100.0).abs() < 1e-9);
    assert!((front(&field, x, y) - (Panel::FRONT - groove.depth_mm)).abs() < 1e-3);
    let half = groove.width_mm / 2.0;
    let quarter = front(&field, x, y + 0.5 * half);
    assert!((quarter - (Panel::FRONT - 0.5 * groove.depth_mm)).abs() < 1e-3);
    assert!((front(&field, x, y + 1.01 * half) - Panel::FRONT).abs() < 1e-3);
    for letter in &truth.letters {
        let stroke = &letter.strokes_mm[0];
        // Off the middle, where cross strokes might meet it.
        let at = |d: usize| stroke[0][d] + 0.3 * (stroke[1][d] - stroke[0][d]);
        let depth = Panel::FRONT - front(&field, at(0), at(1));
        assert!(
            (depth - letter.depth_mm).abs() < 1e-3,
            "{} is {depth} deep, not {}",
            letter.character,
            letter.depth_mm
        );
    }
    let [p, q] = truth.angle.directions.map(DVec3::from);
    let degrees = p.dot(q).acos().to_degrees();
    assert!((degrees - truth.angle.degrees).abs() < 1e-9);
    let vertex = truth.angle.vertex_mm;
    for d in truth.angle.directions {
        let z = front(&field, vertex[0] + 30.0 * d[0], vertex[1] + 30.0 * d[1]);
        assert!((z - (Panel::FRONT - truth.angle.depth_mm)).abs() < 1e-3);
    }
}

#[test]
fn panel_is_flat_but_for_noise() {
    let (mesh, step) = make(300_000, 1);
    let truth = describe(&options(300_000, 1));
    let mut cuts: Vec<[[f64; 3]; 2]> = vec![truth.groove.ends_mm];
    for d in truth.angle.directions {
        let from = DVec3::from(truth.angle.vertex_mm);
        let end = from + DVec3::from(d) * truth.angle.length_mm;
        cuts.push([from.to_array(), end.to_array()]);
    }
    for letter in &truth.letters {
        for stroke in &letter.strokes_mm {
            cuts.extend(stroke.windows(2).map(|w| [w[0], w[1]]));
        }
    }
    let (mut seen, mut squares) = (0, 0.0);
    for vertex in &mesh.vertices {
        let p = glam::Vec3::from(*vertex).as_dvec3();
        let inside = (0..2)
            .all(|d| p[d] > truth.panel.low_mm[d] + step && p[d] < truth.panel.high_mm[d] - step);
        if !inside || p.z < truth.panel.z_mm - 3.0 {
            continue;
        }
        let apart = |[a, b]: &[[f64; 3]; 2]| {
            let (a, b) = (DVec3::from(*a), DVec3::from(*b));
            let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            (p - a - (b - a) * t).truncate().length()
        };
        if cuts.iter().any(|c| apart(c) < 2.0 + 2.0 * step) {
            continue;
        }
        let off = p.z - truth.panel.z_mm;
        assert!(off.abs() <= truth.noise.max_mm + 1e-4, "{off} mm off");
        squares += off * off;
        seen += 1;
    }
    assert!(seen > 500, "{seen} vertices on the panel");
    let sigma = (squares / f64::from(seen)).sqrt();
    assert!((sigma / truth.noise.sigma_mm - 1.0).abs() < 0.1, "{sigma}");
}

#[test]
fn skipping_space_changes_no_sign() {
    for (step, seed) in [(9.0, 4), (7.0, 5)] {
        let field = body::statue(seed, step);
        let grid = Grid::new(step);
        let search = Search { field: &field, grid: &grid };
        for k in 0..grid.tiles[2] {
            let slab = search.sample(k);
            for (place, state) in slab.index.iter().enumerate() {
                let at = [place % grid.tiles[0], place / grid.tiles[0], k];
                for i in (0..CELLS).step_by(37) {
                    let local = [i % TILE, i / TILE % TILE, i / (TILE * TILE)];
                    let p: [f64; 3] = std::array::from_fn(|d| (at[d] * TILE + local[d]) as f64);
                    let p = grid.model_from_grid(DVec3::from(p)).as_vec3();
                    let known = match slab.tiles.get(*state as usize) {
                        Some(tile) => tile.samples[i],
                        None if *state == OUTSIDE => 1.0,
                        None => -1.0,
                    };
                    let exact = field.at(p.to_array());
                    assert!(
                        (known < 0.0) == (exact < 0.0) || exact.abs() < 1e-3,
                        "{known} for {exact} at {p}"
                    );
                }
            }
        }
    }
}

#[test]
fn description_can_be_written_as_json() {
    let truth = serde_json::to_value(describe(&options(1_000_000, 1))).unwrap();
    assert_eq!(truth["unit"], "mm");
    assert_eq!(truth["letters"].as_array().unwrap().len(), 20);
    assert_eq!(truth["letters"][0]["depth_mm"], 1.0);
    assert_eq!(truth["angle"]["degrees"], 37.5);
}
