//! Real scans, with the counts that are known of them. They are no part of the
//! project: where they are absent, the tests say so and pass.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use hlod_scan::{ScanFormat, load};

use crate::{Whole, read_path, volume};

fn scan(name: &str) -> Option<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let path = data.join(name);
    if !path.exists() {
        eprintln!("SKIPPED: no scan {}", path.display());
        return None;
    }
    Some(path)
}

fn read(name: &str, vertices: usize, triangles: usize) -> Option<Whole> {
    let path = scan(name)?;
    let begin = Instant::now();
    let whole = read_path(&path).expect("a valid scan");
    eprintln!("{name}: {:.0} ms", begin.elapsed().as_secs_f64() * 1e3);
    assert_eq!(whole.positions.len(), vertices, "{name}");
    assert_eq!(whole.triangles.len(), triangles, "{name}");
    assert!(whole.report.warnings.is_empty(), "{:?}", whole.report.warnings);
    Some(whole)
}

#[test]
fn happy_buddha() {
    let Some(whole) = read("happy_buddha/happy_buddha.ply", 543_628, 1_087_716 - 48) else {
        return;
    };
    // 48 of the published triangles repeat a corner.
    assert_eq!(whole.report.faces_read, 1_087_716);
    assert_eq!(whole.report.degenerate_faces, 48);
    assert_eq!(whole.header.format, ScanFormat::PlyLittleEndian);
    // Its quantised normals have a few zeros among them.
    assert_eq!(whole.report.normals_absent, 8);
    // Right columns, right winding: stored and computed normals point the same way,
    // within 60 degrees, but for a few folds.
    let computed = hlod_scan::angle_weighted_normals(&whole.positions, &whole.triangles);
    let pairs = whole.normals.iter().zip(&computed);
    let near = pairs.filter(|(a, b)| a.dot(**b) > 0.5).count();
    assert!(near as f64 > 0.99 * computed.len() as f64, "{near}");
}

#[test]
fn dragon_and_bunny() {
    read("dragon/dragon_vrip_res2.ply", 100_250, 202_520);
    if let Some(whole) = read("bunny/bun_zipper.ply", 35_947, 69_451) {
        let skipped = ["property vertex.confidence", "property vertex.intensity"];
        assert_eq!(whole.report.skipped, skipped);
    }
}

/// One strip with restarts. Closed and consistently wound: every directed edge occurs
/// once, and its reverse once.
#[test]
fn igea() {
    let Some(whole) = read("igea/igea_tristrips.ply", 134_345, 268_686) else {
        return;
    };
    let edges = || {
        let triangles = whole.triangles.iter();
        triangles.flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)])
    };
    let distinct: HashSet<(u32, u32)> = edges().collect();
    assert_eq!(distinct.len(), 3 * whole.triangles.len());
    assert!(edges().all(|(a, b)| distinct.contains(&(b, a))));
    assert!(volume(&whole.positions, &whole.triangles) > 0.0, "inside out");
}

#[test]
fn lato_as_one_model() {
    let names = ["lato000", "lato180", "lato270", "lato315"];
    let counts = [86_766, 84_635, 118_779, 120_995];
    let paths: Option<Vec<PathBuf>> =
        names.iter().map(|name| scan(&format!("lato/{name}.ply"))).collect();
    let Some(paths) = paths else { return };
    let mesh = load(&paths, &mut |_, _| {}).expect("valid scans");
    assert_eq!(mesh.triangles.len(), counts.iter().sum::<usize>());
    assert!(mesh.normals_computed && mesh.colours.is_empty());
    for (report, count) in mesh.reports.iter().zip(counts) {
        assert_eq!(report.triangles, count as u64);
        assert_eq!(report.skipped[0], "element camera");
    }
}

#[test]
fn laurana_has_colours() {
    let Some(whole) = read("laurana/laurana50k.ply", 27_861, 49_954) else {
        return;
    };
    assert!(whole.header.has_colours);
    assert!(whole.colours.iter().all(|[r, g, b, _]| r == g && g == b), "grey");
}

#[test]
fn the_lion_is_points_only() {
    let Some(path) = scan("lion_takanawa/lion_takanawa_points.ply") else {
        return;
    };
    let lion = read_path(&path).expect("a point cloud");
    assert!(lion.header.is_point_cloud && lion.header.has_normals && lion.header.has_colours);
    assert_eq!(lion.positions.len(), 272_768);
    assert!(lion.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
}
