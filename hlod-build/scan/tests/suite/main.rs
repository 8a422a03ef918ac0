//! Tests of the readers: tiny files with known answers, random meshes, damaged files
//! and real scans.

mod damaged;
mod gltf;
mod mesh;
mod obj;
mod ply;
mod random;
mod scans;
mod stl;
mod texture;

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use hlod_scan::{
    BATCH_ITEMS_MAX, Batch, ScanError, ScanHeader, ScanMesh, ScanReader, ScanReport, load,
};
use tempfile::TempDir;

/// A folder for the files of one test.
struct Files(TempDir);

impl Files {
    fn new() -> Files {
        Files(tempfile::tempdir().expect("a folder for temporary files"))
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
        std::fs::write(&path, bytes).expect("a temporary file");
        path
    }
}

/// Everything that one reader delivered.
#[derive(Debug)]
struct Whole {
    header: ScanHeader,
    report: ScanReport,
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
    colours: Vec<[u8; 4]>,
    triangles: Vec<[u32; 3]>,
}

/// Reads a file to its end and checks what every reader promises.
fn read_path(path: &Path) -> Result<Whole, ScanError> {
    read_all(ScanReader::open(path)?)
}

fn read_all(mut reader: ScanReader) -> Result<Whole, ScanError> {
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    let (mut colours, mut triangles) = (Vec::new(), Vec::new());
    let mut bytes_before = 0;
    while let Some(batch) = reader.next_batch()? {
        assert!(reader.bytes_read() >= bytes_before, "progress runs back");
        bytes_before = reader.bytes_read();
        match batch {
            Batch::Vertices(batch) => {
                let count = batch.positions.len();
                assert!((1..=BATCH_ITEMS_MAX).contains(&count));
                let has = |flag: bool| if flag { count } else { 0 };
                assert_eq!(batch.normals.len(), has(reader.header().has_normals));
                assert_eq!(batch.colours.len(), has(reader.header().has_colours));
                positions.extend(batch.positions);
                normals.extend(batch.normals);
                colours.extend(batch.colours);
            }
            Batch::Triangles(batch) => {
                assert!((1..=BATCH_ITEMS_MAX).contains(&batch.triangles.len()));
                triangles.extend(batch.triangles);
            }
        }
    }
    assert!(reader.next_batch()?.is_none(), "the end stays the end");
    let header = reader.header().clone();
    let report = reader.report().clone();
    assert!(reader.bytes_read() <= header.file_bytes);
    assert_eq!(report.vertices, positions.len() as u64);
    assert_eq!(report.triangles, triangles.len() as u64);
    assert!(positions.iter().all(|p| p.is_finite()));
    for normal in &normals {
        assert!(*normal == Vec3::ZERO || normal.is_normalized(), "{normal}");
    }
    for [a, b, c] in triangles.iter().copied() {
        assert!(a != b && b != c && c != a);
        assert!([a, b, c].iter().all(|i| (*i as usize) < positions.len()));
    }
    Ok(Whole { header, report, positions, normals, colours, triangles })
}

/// Writes a file and reads it.
fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<Whole, ScanError> {
    let files = Files::new();
    read_path(&files.write(name, bytes))
}

/// Reads a file that must be refused; gives the error and its text without the folder.
fn refusal(name: &str, bytes: impl AsRef<[u8]>) -> (ScanError, String) {
    let error = read(name, bytes).expect_err("the file is wrong");
    let text = error.to_string();
    assert!(text.contains(name), "no file name in: {text}");
    (error, text)
}

fn load_one(path: PathBuf) -> Result<ScanMesh, ScanError> {
    load(&[path], &mut |_, _| {})
}

/// Six times the volume enclosed: tells at once whether all triangles face outwards.
fn volume(positions: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let six = triangles.iter().map(|triangle| {
        let [a, b, c] = triangle.map(|index| positions[index as usize]);
        a.dot(b.cross(c))
    });
    six.sum::<f64>() / 6.0
}
