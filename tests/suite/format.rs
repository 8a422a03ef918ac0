//! Files of every version stay readable, and say what they said.
//!
//! `tests/golden/format-N` holds small files as programs of version N wrote them, and what is in them.

use std::path::{Path, PathBuf};

use hlod_build::{VerifyOptions, info, progress::Silent, verify};
use hlod_compress::{
    FORMAT_VERSION, HlodFile, METADATA_EXAMPLE, Metadata, PageContent, Primitives, decode_page,
};
use hlod_render::picture::take;
use hlod_render::scene::Representation;
use hlod_render::{Model, ModelLimits, framing::Framing};
use hlod_tests::{built, bumpy_ball, gpu, workspace};

use crate::kept::{keep, with_numbers};
use crate::pictures::shot;
use crate::points::ball_cloud;

const NAME: &str = "every_version_stays_readable";

fn golden() -> PathBuf {
    workspace().join("tests/golden")
}

/// What a file holds, a line a page: its node, numbers, and a checksum of everything decoded.
fn contents(path: &Path) -> String {
    let file = HlodFile::open(path).unwrap();
    let mut out = String::new();
    for node in file.read_skeleton().unwrap() {
        for r in &node.representations {
            let PageContent { mesh, points } =
                decode_page(&file.read_page(r.page).unwrap()).unwrap();
            let mut hash = crc32fast::Hasher::new();
            for place in mesh.positions.iter().chain(&points.positions) {
                place.iter().for_each(|c| hash.update(&c.to_le_bytes()));
            }
            for normal in mesh.normals.iter().chain(&points.normals) {
                normal.0.iter().for_each(|c| hash.update(&c.to_le_bytes()));
            }
            mesh.colours.iter().chain(&points.colours).for_each(|c| hash.update(c));
            for code in mesh.scalars.iter().chain(&points.scalars).flat_map(|s| s.0) {
                hash.update(&code.to_le_bytes());
            }
            for corner in mesh.triangles.as_flattened() {
                hash.update(&corner.to_le_bytes());
            }
            let of_prefixes = points.prefixes.iter().flat_map(|prefix| &prefix.radii);
            points.radii.iter().chain(of_prefixes).for_each(|radius| hash.update(&[radius.0]));
            out += &format!(
                "{} {:?} {} {} {} {:08x}\n",
                node.cell,
                r.kind,
                mesh.positions.len(),
                mesh.triangles.len(),
                points.len(),
                hash.finalize()
            );
        }
    }
    for (name, range) in file.header().scalars() {
        let (low, high, unit) = (range.minimum, range.maximum(), &range.unit);
        out += &format!("scalar {name} {low} {high} {} {unit}\n", range.step);
    }
    if let Some(metadata) = file.read_metadata().unwrap() {
        let hash = crc32fast::hash(metadata.text().as_bytes());
        out += &format!("metadata {} {hash:08x}\n", metadata.text().len());
    }
    out
}

/// The same ASCII PLY with a colour for each vertex.
fn coloured(ply: &str) -> String {
    let (header, body) = ply.split_once("end_header\n").unwrap();
    let channels = "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face";
    let mut out = header.replace("element face", channels) + "end_header\n";
    for (i, line) in body.lines().enumerate() {
        // Faces begin with their number of corners.
        let is_face = line.starts_with("3 ");
        let colour = if is_face { String::new() } else { format!(" {} 90 {}", i % 256, i / 16) };
        out += &format!("{line}{colour}\n");
    }
    out
}

/// Files of the version that is written now, and what is in them; never over older ones.
fn write_golden(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let mesh = scratch.path().join("ball.ply");
    std::fs::write(&mesh, with_numbers(&coloured(&bumpy_ball(36)))).unwrap();
    let fine = scratch.path().join("fine.ply");
    std::fs::write(&fine, with_numbers(&coloured(&bumpy_ball(64)))).unwrap();
    let cloud = scratch.path().join("cloud.ply");
    std::fs::write(&cloud, with_numbers(&ball_cloud(2_000))).unwrap();
    for (name, scan, primitives) in [
        ("triangles", &mesh, Primitives::Triangles),
        ("hybrid", &fine, Primitives::Hybrid),
        ("cloud", &cloud, Primitives::Triangles),
    ] {
        let path = folder.join(format!("{name}.hlod"));
        assert!(!path.exists(), "{} stays as it is", path.display());
        built(scan, &path, |o| {
            o.leaf_triangles = 400;
            o.resolution = if primitives == Primitives::Hybrid { 16 } else { 64 };
            o.primitives = primitives;
            o.point_cost = 0.01;
            o.keep = keep(&["height=mm", "label"]);
            o.metadata = Some(Metadata::parse(METADATA_EXAMPLE.as_bytes()).unwrap());
        });
        assert_eq!(HlodFile::open(&path).unwrap().header().format_version(), FORMAT_VERSION);
        let both = |line: &str| !line.contains(" 0 ") && line.contains("Appearance");
        let has_both = contents(&path).lines().any(both);
        assert_eq!(has_both, primitives == Primitives::Hybrid, "{name}:\n{}", contents(&path));
        std::fs::write(path.with_extension("txt"), contents(&path)).unwrap();
    }
}

#[test]
fn every_version_stays_readable() {
    let current = golden().join(format!("format-{FORMAT_VERSION}"));
    if std::env::var("HLOD_BLESS").is_ok_and(|name| NAME.contains(&name)) {
        write_golden(&current);
    }
    assert!(current.is_dir(), "{} is missing: `./x bless {NAME}`", current.display());
    let gpu = gpu();
    for version in 1..=FORMAT_VERSION {
        let folder = golden().join(format!("format-{version}"));
        let mut files = 0;
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "hlod") {
                continue;
            }
            files += 1;
            let expected = std::fs::read_to_string(path.with_extension("txt")).unwrap();
            let found = contents(&path);
            assert!(found == expected, "{} holds other things:\n{found}", path.display());
            assert!(info(&path).unwrap().nodes > 1);
            let verified = verify(&path, &VerifyOptions::default(), &Silent).unwrap();
            assert!(!verified.is_refuted(), "{}: {:?}", path.display(), verified.problems);
            let model = Model::open(&gpu, &path, ModelLimits::default()).unwrap();
            let shot = shot(&Framing::of(&model), Representation::Hybrid);
            let (_, stats) = take(&gpu, &mut [model], &shot, 64, 64, 1).unwrap();
            assert!(stats.triangles + stats.points > 100, "{}: {stats:?}", path.display());
        }
        assert_eq!(files, 3, "in {}", folder.display());
    }
}
