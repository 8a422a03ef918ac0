//! Inputs to begin with: small, good, and of every kind.

use std::io::Cursor;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use hlod_compress::{HlodFile, METADATA_EXAMPLE, RepresentationKind, decode_page, encode_page};
use hlod_render::measure::{Measured, Measurement, MeasurementKind, SurfacePoint};
use hlod_render::session::{Note, NoteShape, SavedView, SectionPlane, Session, Viewpoint};
use image::{DynamicImage, ImageFormat, RgbImage};

use crate::samples::{Sample, SampleFormat};
use crate::{ball, workspace};

/// An OBJ with coordinates on a texture, whose materials are in `textured.mtl`.
pub(super) const TEXTURED_OBJ: &str = "mtllib textured.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";

/// Files as programs of each version wrote them, the small ones.
pub(super) fn containers() -> Vec<Vec<u8>> {
    golden().into_iter().map(|(_, bytes)| bytes).collect()
}

fn golden() -> Vec<(String, Vec<u8>)> {
    let mut out = Vec::new();
    for version in 1..=hlod_compress::FORMAT_VERSION {
        for name in ["triangles", "hybrid", "cloud"] {
            let path = workspace().join(format!("tests/golden/format-{version}/{name}.hlod"));
            if let Ok(bytes) = std::fs::read(path) {
                out.push((name.to_owned(), bytes));
            }
        }
    }
    assert!(!out.is_empty(), "tests/golden holds no files");
    out
}

/// The shortest pages of files of a name, of each kind.
fn pages(of: &str) -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (_, bytes) in golden().into_iter().filter(|(name, _)| name == of) {
        let Some((_temp, file)) = opened(&bytes) else { continue };
        let nodes = file.read_skeleton().expect("a golden file is good");
        use RepresentationKind::{Appearance, Geometric, Source};
        for kind in [Source, Appearance, Geometric] {
            let of_kind = nodes.iter().flat_map(|n| &n.representations).filter(|r| r.kind == kind);
            let mut pages: Vec<_> = of_kind.map(|r| r.page).collect();
            pages.sort_by_key(|page| page.page_bytes);
            let read = |page: &hlod_compress::PageRef| file.read_page(*page).ok();
            out.extend(pages.iter().take(3).filter_map(read));
        }
    }
    out
}

fn opened(bytes: &[u8]) -> Option<(tempfile::NamedTempFile, HlodFile)> {
    let temp = tempfile::NamedTempFile::new().ok()?;
    std::fs::write(temp.path(), bytes).ok()?;
    let file = HlodFile::open(temp.path()).ok()?;
    Some((temp, file))
}

pub(super) fn pages_of_triangles() -> Vec<Vec<u8>> {
    pages("triangles")
}

/// Cut to a few points, and one as it is: a case takes as long as its page has points, and whole roots took
/// most of a campaign's time.
pub(super) fn pages_of_points() -> Vec<Vec<u8>> {
    let whole = pages("cloud");
    let shortest = whole.iter().min_by_key(|page| page.len()).cloned();
    whole.iter().map(|page| cut_to_few_points(page)).chain(shortest).collect()
}

fn cut_to_few_points(page: &[u8]) -> Vec<u8> {
    const POINTS: usize = 60;
    const PREFIXES: [usize; 2] = [6, 20];
    let mut content = decode_page(page).expect("a golden page is good");
    let points = &mut content.points;
    points.positions.truncate(POINTS);
    points.normals.truncate(POINTS);
    points.colours.truncate(POINTS);
    points.scalars.truncate(POINTS);
    points.radii.truncate(POINTS);
    points.prefixes.truncate(PREFIXES.len());
    for (prefix, length) in points.prefixes.iter_mut().zip(PREFIXES) {
        prefix.radii.truncate(length);
    }
    encode_page(&content, 0, 0).expect("a part of a page is no larger")
}

pub(super) fn pages_of_both() -> Vec<Vec<u8>> {
    pages("hybrid")
}

/// Whole headers, and their bodies, which the target puts a checksum before.
pub(super) fn headers() -> Vec<Vec<u8>> {
    let header = |bytes: Vec<u8>| {
        let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        [bytes[20..20 + length].to_vec(), bytes[..20 + length].to_vec()]
    };
    containers().into_iter().flat_map(header).collect()
}

pub(super) fn blocks() -> Vec<Vec<u8>> {
    let root = |bytes: Vec<u8>| {
        let (_temp, file) = opened(&bytes)?;
        let block = file.header().root_block;
        file.read_range("block", block.offset, block.block_bytes).ok()
    };
    containers().into_iter().filter_map(root).collect()
}

pub(super) fn records() -> Vec<Vec<u8>> {
    let first = |bytes: Vec<u8>| {
        let (_temp, file) = opened(&bytes)?;
        let nodes = file.read_skeleton().ok()?;
        Some(nodes.iter().take(3).map(|node| node.to_bytes()).collect::<Vec<_>>())
    };
    containers().into_iter().filter_map(first).flatten().collect()
}

pub(super) fn metadata() -> Vec<Vec<u8>> {
    let short = r#"{"label": {"en": ["A"]}, "processing": [], "digitization": {"accuracy": {"value": 0.1, "unit": "mm", "k": 2, "source": "x"}}}"#;
    vec![METADATA_EXAMPLE.into(), short.into(), "{}".into()]
}

pub(super) fn transforms() -> Vec<Vec<u8>> {
    let texts = [
        "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
        "0,-1,0,12.5;1,0,0,-3e2;0,0,1,0;0,0,0,1",
        "-2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1",
    ];
    texts.map(|text| text.as_bytes().to_vec()).to_vec()
}

fn samples(formats: &[SampleFormat]) -> Vec<Vec<u8>> {
    formats.iter().map(|format| Sample::tetrahedron().file(*format)).collect()
}

pub(super) fn ply() -> Vec<Vec<u8>> {
    let mut out = samples(&[SampleFormat::PlyAscii, SampleFormat::PlyLittle, SampleFormat::PlyBig]);
    out.push(ball(5, 0.1).into_bytes());
    let cloud = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n0 0 0 0 0 1 9 9 9\n1 2 3 1 0 0 255 0 7\n";
    out.push(cloud.into());
    let odd = "ply\nformat binary_little_endian 1.0\ncomment TextureFile none.png\nelement camera 1\nproperty list uchar short tags\nelement vertex 4\nproperty double x\nproperty float y\nproperty float z\nproperty char nx\nproperty char ny\nproperty char nz\nelement face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    let mut odd = odd.as_bytes().to_vec();
    odd.extend([2, 1, 0, 2, 0]);
    for [x, y] in [[0f32, 0.], [1., 0.], [1., 1.], [0., 1.]] {
        odd.extend(f64::from(x).to_le_bytes());
        odd.extend([y.to_le_bytes(), 0f32.to_le_bytes()].concat());
        odd.extend([0, 0, 1]);
    }
    odd.push(4);
    odd.extend([0i32, 1, 2, 3].iter().flat_map(|index| index.to_le_bytes()));
    odd.push(8);
    odd.extend([0f32, 0., 1., 0., 1., 1., 0., 1.].iter().flat_map(|x| x.to_le_bytes()));
    odd.extend(5i32.to_le_bytes());
    odd.extend([0i32, 1, 2, -1, 3].iter().flat_map(|index| index.to_le_bytes()));
    out.push(odd);
    out
}

pub(super) fn obj() -> Vec<Vec<u8>> {
    let mut out = samples(&[SampleFormat::Obj]);
    out.push(TEXTURED_OBJ.into());
    let odd = "# odd\no cube\nv 0 0 0 1 0 0\nv 1 0 \\\n0\nv 1 1 0 1.0\nv 0 1 0\nvn 0 0 1\nvn nan 0 0\ng a\nf 1//1 2//1 3 -1\nf -4/1/2 -3 -2 -1\n";
    out.push(odd.into());
    out
}

pub(super) fn stl() -> Vec<Vec<u8>> {
    samples(&[SampleFormat::StlAscii, SampleFormat::StlBinary])
}

pub(super) fn gltf() -> Vec<Vec<u8>> {
    let mut out = samples(&[SampleFormat::Gltf]);
    let whole = String::from_utf8_lossy(&out[0]).into_owned();
    let node =
        r#""mesh": 0, "scale": [1, 2, 1], "rotation": [0, 0, 0, 1], "translation": [1, 0, 0]"#;
    out.push(whole.replacen(r#""mesh": 0"#, node, 1).into_bytes());
    let sparse = r#""count": 4, "sparse": {"count": 1, "indices": {"bufferView": 1, "componentType": 5125}, "values": {"bufferView": 0}}"#;
    out.push(whole.replacen(r#""count": 4"#, sparse, 1).into_bytes());
    let strip = r#"{"mode": 5, "indices": 1"#;
    out.push(whole.replacen(r#"{"indices": 1"#, strip, 1).into_bytes());
    out
}

pub(super) fn glb() -> Vec<Vec<u8>> {
    samples(&[SampleFormat::Glb])
}

pub(super) fn any_scan() -> Vec<Vec<u8>> {
    samples(&SampleFormat::ALL)
}

/// PNG, JPEG and TIFF.
pub(super) fn images() -> Vec<Vec<u8>> {
    let pixels = RgbImage::from_fn(9, 7, |x, y| image::Rgb([(x * 28) as u8, (y * 36) as u8, 7]));
    let colours = DynamicImage::from(pixels);
    let mut out = Vec::new();
    for picture in [colours.clone(), colours.to_luma8().into(), colours.to_rgba16().into()] {
        for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Tiff] {
            let mut bytes = Cursor::new(Vec::new());
            // JPEG has no 16 bits.
            if picture.write_to(&mut bytes, format).is_ok() {
                out.push(bytes.into_inner());
            }
        }
    }
    out
}

pub(super) fn materials() -> Vec<Vec<u8>> {
    let odd = "# odd\nnewmtl a\nKd 1 0 0\nmap_Kd -s 2 2 1 -clamp on painted.png\nnewmtl m\nmap_Kd painted.png\n";
    vec!["newmtl m\nmap_Kd painted.png\n".into(), odd.into()]
}

pub(super) fn projects() -> Vec<Vec<u8>> {
    let mesh = |matrix: &str| {
        format!(
            "<!DOCTYPE MeshLabDocument>\n<MeshLabProject>\n <MeshGroup>\n  <MLMesh label=\"a\" visible=\"1\" filename=\"a.mlp\">\n   <MLMatrix44>\n{matrix}\n</MLMatrix44>\n  </MLMesh>\n  <MLMesh filename=\"b.ply\" visible=\"0\"/>\n </MeshGroup>\n</MeshLabProject>\n"
        )
    };
    vec![
        mesh("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1").into_bytes(),
        mesh("0 1 0 &#x35;\n1 0 0 0\n0 0 1 0\n0 0 0 1").into_bytes(),
    ]
}

pub(super) fn camera_paths() -> Vec<Vec<u8>> {
    let read = |name| std::fs::read(workspace().join("bench-paths").join(name)).ok();
    ["orbit.json", "approach.json", "sweep.json"].into_iter().filter_map(read).collect()
}

pub(super) fn sessions() -> Vec<Vec<u8>> {
    let containers = containers();
    let (_temp, file) = opened(&containers[0]).expect("a golden file is good");
    let mut session = Session::new(std::path::Path::new("a.hlod"), file.header());
    let text = |session: &Session| serde_json::to_vec(session).expect("a session is JSON");
    let empty = text(&session);
    let point = |x: f64| SurfacePoint {
        position: DVec3::new(x, 0.1, -1.0 / 3.0).to_array(),
        normal: Vec3::Z.to_array().map(f64::from),
        file_bound: 0.01,
        pixel_length: Some(0.2),
    };
    let viewpoint = Viewpoint {
        eye: [0.0, 0.0, 5.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: Some(35.0),
        parallel_height: None,
    };
    let looks = session.looks;
    session.views = Arc::new(vec![SavedView { name: "the hand".into(), viewpoint, looks }]);
    session.measurements = Arc::new(vec![Measurement {
        name: "groove".into(),
        kind: MeasurementKind::Distance,
        points: vec![point(0.0), point(1.5)],
        result: Some(Measured { value: 1.5, file_bound: Some(0.02), delta: Some([1.5, 0.0, 0.0]) }),
    }]);
    session.sections = Arc::new(vec![SectionPlane {
        name: "y = 2".into(),
        normal: [0.0, 1.0, 0.0],
        offset: 2.0,
        shown: true,
        opens: true,
    }]);
    session.notes = Arc::new(vec![Note {
        title: "chip".into(),
        text: "Old.".into(),
        category: String::new(),
        colour: "#d08030".into(),
        shape: NoteShape::Polyline,
        points: vec![point(0.0), point(0.5)],
        area: None,
    }]);
    vec![empty, text(&session)]
}
