//! What is run on inputs, and what must hold of what it takes for good.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use hlod_compress::{
    BlockRef, FORMAT_VERSION, Header, HlodFile, Metadata, NodeRecord, SkeletonBlock, decode_page,
    encode_page,
};
use hlod_render::path::CameraPath;
use hlod_scan::{Batch, ColourSource, ReadOptions, ScanReader, Transform, place_scans};

use super::memory::CEILING_BYTES;
use super::seeds;

/// What readers of scans are allowed, in bytes.
const ALLOWED_BYTES: usize = 64 << 20;
/// What images may take: before it knows what it is allowed, the TIFF decoder takes up to 256 MiB.
const IMAGE_BYTES: usize = ALLOWED_BYTES + (256 << 20);

/// Something that reads what comes from outside.
pub struct Target {
    /// Its name on command lines.
    pub name: &'static str,
    /// Runs it on an input; says whether it was taken for good. Panics where a promise is broken.
    pub run: fn(&[u8]) -> bool,
    /// Inputs to begin with.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Whether it decodes bytes in memory, and so is to be run ten times as often as what reads files.
    pub is_decoder: bool,
    /// What a case may hold, in bytes; where files are read, twice what the reader is allowed.
    pub bytes_max: usize,
}

/// All of them.
pub static TARGETS: [Target; 20] = [
    decoder("page-triangles", page, seeds::pages_of_triangles),
    decoder("page-points", page, seeds::pages_of_points),
    decoder("page-both", page, seeds::pages_of_both),
    decoder("header", header, seeds::headers),
    decoder("block", block, seeds::blocks),
    decoder("record", record, seeds::records),
    decoder("metadata", metadata, seeds::metadata),
    decoder("transform", transform, seeds::transforms),
    parser("container", container, seeds::containers),
    parser("ply", |bytes| scan("a.ply", bytes), seeds::ply),
    parser("obj", |bytes| scan("a.obj", bytes), seeds::obj),
    parser("stl", |bytes| scan("a.stl", bytes), seeds::stl),
    parser("gltf", |bytes| scan("a.gltf", bytes), seeds::gltf),
    parser("glb", |bytes| scan("a.glb", bytes), seeds::glb),
    parser("sniff", |bytes| scan("a", bytes), seeds::any_scan),
    Target { bytes_max: IMAGE_BYTES, ..parser("texture", texture, seeds::images) },
    parser("material", material, seeds::materials),
    parser("project", project, seeds::projects),
    parser("camera-path", camera_path, seeds::camera_paths),
    parser("session", session, seeds::sessions),
];

const fn decoder(
    name: &'static str,
    run: fn(&[u8]) -> bool,
    seeds: fn() -> Vec<Vec<u8>>,
) -> Target {
    Target { name, run, seeds, is_decoder: true, bytes_max: CEILING_BYTES }
}

const fn parser(name: &'static str, run: fn(&[u8]) -> bool, seeds: fn() -> Vec<Vec<u8>>) -> Target {
    Target { name, run, seeds, is_decoder: false, bytes_max: 2 * ALLOWED_BYTES }
}

/// The target of a name.
///
/// # Panics
/// When there is none.
pub fn target(name: &str) -> &'static Target {
    let found = TARGETS.iter().find(|target| target.name == name);
    found.unwrap_or_else(|| panic!("there is no target {name}"))
}

/// A page that holds more vertices, triangles and points is not coded again: a few kilobytes may declare
/// four million vertices, which decode in a second and take several to encode.
const CODED_AGAIN_MAX: usize = 1 << 18;

/// What a page holds can be coded again and comes back as it was.
fn page(bytes: &[u8]) -> bool {
    let Ok(content) = decode_page(bytes) else { return false };
    content.mesh.validate().expect("a mesh that was decoded is consistent");
    let mesh = &content.mesh;
    if mesh.positions.len().max(mesh.triangles.len()).max(content.points.len()) > CODED_AGAIN_MAX {
        return true;
    }
    if let Ok(page) = encode_page(&content, 0, 0) {
        let again = decode_page(&page).expect("what was encoded can be decoded");
        assert_eq!(again.mesh.triangles.len(), content.mesh.triangles.len());
        assert_eq!(again.mesh.bounds(), content.mesh.bounds());
        assert_eq!(again.points.len(), content.points.len());
        assert_eq!(again.points.bounds(), content.points.bounds());
    }
    true
}

/// As it is, and as the body behind a valid checksum.
fn header(bytes: &[u8]) -> bool {
    let with_checksum = |version| Header::parse(&Header::with_prefix(version, bytes)).is_ok();
    Header::parse(bytes).is_ok() | (1..=FORMAT_VERSION).any(with_checksum)
}

/// With a valid checksum.
fn block(bytes: &[u8]) -> bool {
    let crc32 = crc32fast::hash(bytes);
    let block = BlockRef { offset: 0, block_bytes: bytes.len() as u32, crc32 };
    let Ok(block) = SkeletonBlock::parse(bytes, block) else { return false };
    block.validate().expect("what was parsed is valid");
    true
}

fn record(bytes: &[u8]) -> bool {
    let Ok(record) = NodeRecord::parse(bytes) else { return false };
    NodeRecord::parse(&record.to_bytes()).expect("what was written can be read");
    true
}

fn metadata(bytes: &[u8]) -> bool {
    let Ok(metadata) = Metadata::parse(bytes) else { return false };
    let lines = metadata.lines();
    let holds_control = |text: &String| text.chars().any(char::is_control);
    assert!(!lines.iter().any(|(name, value)| holds_control(name) || holds_control(value)));
    metadata.unknown_keys();
    if let Some(accuracy) = metadata.accuracy() {
        assert!(accuracy.value.is_finite() && accuracy.k.is_finite());
    }
    true
}

fn transform(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let Ok(transform) = Transform::parse(&text) else { return false };
    assert!(transform.rows().as_flattened().iter().all(|number| number.is_finite()));
    transform.is_mirroring();
    true
}

/// A file, its skeleton, and every page of it.
fn container(bytes: &[u8]) -> bool {
    with_file("a.hlod", bytes, |path| {
        let Ok(file) = HlodFile::open(path) else { return false };
        let _ = file.read_metadata();
        let Ok(nodes) = file.read_skeleton() else { return false };
        for r in nodes.iter().flat_map(|node| &node.representations) {
            let _ = file.read_page(r.page).map(|page| decode_page(&page));
        }
        true
    })
}

/// Read to its end, with and without little memory.
fn scan(name: &str, bytes: &[u8]) -> bool {
    with_file(name, bytes, |path| {
        let whole = read(path, ALLOWED_BYTES, ColourSource::Auto);
        let paged = read(path, 1 << 16, ColourSource::Auto);
        assert_eq!(whole, paged, "memory decides what is read");
        whole.is_some()
    })
}

/// Numbers of vertices and triangles.
fn read(path: &Path, memory_bytes: usize, colour: ColourSource) -> Option<(u64, u64)> {
    let folder = path.parent().expect("a file is in a folder");
    let options = ReadOptions {
        memory_bytes,
        scratch: folder,
        colour,
        transform: None,
        progress: &mut |_| true,
        keep: &[],
    };
    let mut reader = ScanReader::open_within(path, options).ok()?;
    let (mut vertices, mut highest) = (0, None);
    let mut triangles = 0;
    while let Some(batch) = reader.next_batch().ok()? {
        match batch {
            Batch::Vertices(batch) => {
                assert!(batch.positions.iter().all(|p| p.is_finite()));
                assert!(batch.normals.iter().all(|n| n.is_finite()));
                let of = |count: usize| count == 0 || count == batch.positions.len();
                assert!(of(batch.normals.len()) && of(batch.colours.len()));
                vertices += batch.positions.len() as u64;
            }
            Batch::Triangles(batch) => {
                assert!(batch.triangles.iter().all(|[a, b, c]| a != b && b != c && c != a));
                highest = highest.max(batch.triangles.as_flattened().iter().max().copied());
                triangles += batch.triangles.len() as u64;
            }
        }
    }
    assert!(highest.is_none_or(|highest| u64::from(highest) < vertices));
    Some((vertices, triangles))
}

/// An image that a scan needs for its colours.
fn texture(bytes: &[u8]) -> bool {
    let folder = folder("textured");
    let scan = folder.join("textured.obj");
    if !scan.exists() {
        let _ = std::fs::write(folder.join("textured.mtl"), "newmtl m\nmap_Kd textured.img\n");
        let _ = std::fs::write(&scan, seeds::TEXTURED_OBJ);
    }
    with_file("textured/textured.img", bytes, |_| {
        read(&scan, ALLOWED_BYTES, ColourSource::Texture).is_some()
    })
}

/// A list of materials beside a scan.
fn material(bytes: &[u8]) -> bool {
    let folder = folder("painted");
    let scan = folder.join("painted.obj");
    if !scan.exists() {
        let _ = std::fs::write(&scan, seeds::TEXTURED_OBJ.replace("textured", "painted"));
        let _ = std::fs::write(folder.join("painted.png"), &seeds::images()[0]);
    }
    with_file("painted/painted.mtl", bytes, |_| {
        read(&scan, ALLOWED_BYTES, ColourSource::Texture).is_some()
    })
}

fn project(bytes: &[u8]) -> bool {
    with_file("a.mlp", bytes, |path| place_scans(&[path.to_owned()], &[]).is_ok())
}

fn camera_path(bytes: &[u8]) -> bool {
    with_file("path.json", bytes, |path| {
        let Ok(path) = CameraPath::load(path) else { return false };
        path.validate().expect("what was loaded is valid");
        true
    })
}

/// What was read can be written and read again.
fn session(bytes: &[u8]) -> bool {
    with_file("session.json", bytes, |path| {
        let Ok(session) = hlod_render::session::load(path) else { return false };
        hlod_render::session::save(&session, path).expect("it can be written");
        let again = hlod_render::session::load(path).expect("what was written can be read");
        assert!(again == session, "it comes back as another");
        true
    })
}

/// A folder in one of this thread's own, in memory where the system has files there.
fn folder(name: &str) -> PathBuf {
    thread_local! {
        static FOLDER: RefCell<Option<tempfile::TempDir>> = const { RefCell::new(None) };
    }
    FOLDER.with_borrow_mut(|folder| {
        let folder = folder.get_or_insert_with(|| {
            let in_memory = Path::new("/dev/shm");
            let made = if in_memory.is_dir() {
                tempfile::tempdir_in(in_memory)
            } else {
                tempfile::tempdir()
            };
            made.expect("there is room for a folder")
        });
        let path = folder.path().join(name);
        std::fs::create_dir_all(&path).expect("there is room for a folder");
        path
    })
}

fn with_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path) -> bool) -> bool {
    let path = folder("").join(name);
    std::fs::write(&path, bytes).expect("there is room for a small file");
    read(&path)
}
