//! Textures of every format, as colours of vertices.

use std::path::PathBuf;

use hlod_scan::{ColourSource, ColourTaken, ReadOptions, ScanError, ScanReader};
use image::{Rgb, RgbImage};

use crate::{Files, Whole, read_all, read_path};

const RED: [u8; 3] = [255, 0, 0];
const GREEN: [u8; 3] = [0, 200, 0];
const BLUE: [u8; 3] = [0, 0, 90];
const GREY: [u8; 3] = [120; 3];

/// A quarter of each colour: upper left, upper right, lower left, lower right.
fn quarters() -> Vec<u8> {
    let image = RgbImage::from_fn(64, 64, |x, y| {
        Rgb(match (x < 32, y < 32) {
            (true, true) => RED,
            (false, true) => GREEN,
            (true, false) => BLUE,
            (false, false) => GREY,
        })
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).expect("a PNG");
    bytes.into_inner()
}

/// Triangles in the four quarters, with their colours; v runs upwards. No two share a vertex.
const FACES: [([[f32; 2]; 3], [u8; 3]); 4] = [
    ([[0.1, 0.6], [0.4, 0.6], [0.1, 0.9]], RED),
    ([[0.6, 0.6], [0.9, 0.6], [0.6, 0.9]], GREEN),
    ([[0.1, 0.1], [0.4, 0.1], [0.1, 0.4]], BLUE),
    ([[0.6, 0.1], [0.9, 0.1], [0.6, 0.4]], GREY),
];

fn corners() -> impl Iterator<Item = ([f32; 3], [f32; 2])> {
    FACES
        .iter()
        .enumerate()
        .flat_map(|(face, (at, _))| at.iter().map(move |[u, v]| ([*u, *v, face as f32], [*u, *v])))
}

fn expected() -> Vec<[u8; 4]> {
    FACES.iter().flat_map(|(_, [r, g, b])| [[*r, *g, *b, 255]; 3]).collect()
}

fn obj(material: &str) -> String {
    let mut text = format!("mtllib a.mtl\n{material}\n");
    corners().for_each(|([x, y, z], _)| text += &format!("v {x} {y} {z}\n"));
    corners().for_each(|(_, [u, v])| text += &format!("vt {u} {v}\n"));
    for face in 0..4 {
        let [a, b, c] = [1, 2, 3].map(|corner| 3 * face + corner);
        text += &format!("f {a}/{a} {b}/{b} {c}/{c}\n");
    }
    text
}

const MTL: &str = "newmtl stone\nKd 0.5 0.5 0.5\nmap_Kd a.png\nnewmtl paint\nKd 1 0 1\n";

fn obj_in(files: &Files, obj: &str, mtl: &str) -> PathBuf {
    files.write("a.png", quarters());
    files.write("a.mtl", mtl);
    files.write("a.obj", obj)
}

fn ply(coordinates_of: &str, number: Option<i32>) -> String {
    let mut text =
        "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 12\n".to_owned();
    ["x", "y", "z"].iter().for_each(|axis| text += &format!("property float {axis}\n"));
    let of_vertex = coordinates_of.split_whitespace().collect::<Vec<_>>();
    of_vertex.iter().for_each(|name| text += &format!("property float {name}\n"));
    text += "element face 4\nproperty list uchar int vertex_indices\n";
    if of_vertex.is_empty() {
        text += "property list uchar float texcoord\n";
    }
    if number.is_some() {
        text += "property int texnumber\n";
    }
    text += "end_header\n";
    for ([x, y, z], [u, v]) in corners() {
        text += &format!("{x} {y} {z}");
        text += &if of_vertex.is_empty() { "\n".to_owned() } else { format!(" {u} {v}\n") };
    }
    for (face, (at, _)) in FACES.iter().enumerate() {
        text += &format!("3 {} {} {}", 3 * face, 3 * face + 1, 3 * face + 2);
        if of_vertex.is_empty() {
            text += " 6";
            at.iter().flatten().for_each(|x| text += &format!(" {x}"));
        }
        text += &number.map_or(String::new(), |number| format!(" {number}"));
        text += "\n";
    }
    text
}

/// A GLB with the image in its chunk, or a glTF that names it.
fn gltf(image: &str, texture: &str, material: &str) -> Vec<u8> {
    let mut data: Vec<u8> = corners().flat_map(|(at, _)| at).flat_map(f32::to_le_bytes).collect();
    // v runs downwards.
    let downwards = corners().flat_map(|(_, [u, v])| [u, 1.0 - v]);
    data.extend(downwards.flat_map(f32::to_le_bytes));
    let png = quarters();
    data.extend(&png);
    let image = image.replace("VIEW", r#""bufferView": 2, "mimeType": "image/png""#);
    let text = format!(
        r#"{{"asset": {{"version": "2.0"}}, "buffers": [{{"byteLength": {}}}], "scene": 0,
        "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
        "meshes": [{{"primitives": [{{"material": 0,
            "attributes": {{"POSITION": 0, "TEXCOORD_0": 1}}}}]}}],
        "images": [{{{image}}}], "textures": [{{{texture}}}],
        "samplers": [{{"wrapS": 33071, "wrapT": 33648}}],
        "materials": [{{"pbrMetallicRoughness": {{{material}}}}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 144}},
            {{"buffer": 0, "byteOffset": 144, "byteLength": 96}},
            {{"buffer": 0, "byteOffset": 240, "byteLength": {}}}],
        "accessors": [
            {{"bufferView": 0, "componentType": 5126, "count": 12, "type": "VEC3"}},
            {{"bufferView": 1, "componentType": 5126, "count": 12, "type": "VEC2"}}]}}"#,
        data.len(),
        png.len()
    );
    crate::gltf::glb(&text, &data)
}

const BASE: &str = r#""baseColorTexture": {"index": 0}"#;

fn check(whole: &Whole, what: &str) {
    assert!(whole.header.has_colours, "{what}: {:?}", whole.report);
    assert_eq!(whole.colours, expected(), "{what}");
    assert_eq!(whole.report.colours.taken, ColourTaken::Texture, "{what}");
    let texels = whole.report.colours.texels_a_vertex;
    // Four triangles of 19.2² ÷ 2 texels and 12 vertices.
    assert!((texels - 19.2 * 19.2 / 6.0).abs() < 0.01, "{what}: {texels}");
    assert_eq!(whole.report.colours.textures[0].width, 64, "{what}");
}

#[test]
fn every_format_shows_the_right_quarter() {
    let files = Files::new();
    let path = obj_in(&files, &obj("usemtl stone"), MTL);
    check(&read_path(&path).expect("an OBJ"), "OBJ");
    for of in ["texture_u texture_v", "u v", "s t", ""] {
        for number in [None, Some(0)] {
            let path = files.write("a.ply", ply(of, number));
            check(&read_path(&path).expect("a PLY"), &format!("PLY {of} {number:?}"));
        }
    }
    let texture = r#""source": 0, "sampler": 0"#;
    let base64 = crate::gltf::base64(&quarters());
    let data = format!(r#""uri": "data:image/png;base64,{base64}""#);
    for image in ["VIEW", r#""uri": "a.png""#, &data] {
        let path = files.write("a.glb", gltf(image, texture, BASE));
        check(&read_path(&path).expect("a GLB"), image);
    }
}

/// What the files say of their textures is heeded; the same without it is told apart.
#[test]
fn transforms_and_factors_are_applied() {
    let files = Files::new();
    // Moved by half a texture to the right and up: each shows the opposite quarter.
    let moved = MTL.replace("map_Kd", "map_Kd -o 0.5 0.5");
    let opposite: Vec<[u8; 4]> =
        [GREY, BLUE, GREEN, RED].iter().flat_map(|[r, g, b]| [[*r, *g, *b, 255]; 3]).collect();
    let path = obj_in(&files, &obj("usemtl stone"), &moved);
    let whole = read_path(&path).expect("an OBJ");
    assert_eq!(whole.colours, opposite);
    assert!(whole.report.colours.corners_outside > 0);

    let transform = r#""baseColorTexture": {"index": 0, "extensions":
        {"KHR_texture_transform": {"offset": [0.5, -0.5]}}}"#;
    let glb = |material: &str, texture: &str| {
        let path = files.write("a.glb", gltf("VIEW", texture, material));
        read_path(&path).expect("a GLB").colours
    };
    assert_eq!(glb(transform, r#""source": 0"#), opposite);
    // Clamped to the right border and mirrored at the upper one instead.
    let clamped = glb(transform, r#""source": 0, "sampler": 0"#);
    assert_ne!(clamped, opposite);
    assert_eq!(clamped[0][..3], GREEN);
    // A factor of half the light.
    let factor = format!(r#"{BASE}, "baseColorFactor": [0.5, 1, 1, 1]"#);
    assert_eq!(glb(&factor, r#""source": 0"#)[0], [188, 0, 0, 255]);

    // Faces of a material without a texture have its own colour, of an unknown one none.
    let half = obj("usemtl stone").replace("f 7/7", "usemtl paint\nf 7/7");
    let path = obj_in(&files, &half, MTL);
    let whole = read_path(&path).expect("an OBJ");
    assert_eq!(whole.colours[6..], [[255, 0, 255, 255]; 6]);
    let unknown = obj("usemtl stone").replace("f 7/7", "usemtl gone\nf 7/7");
    let whole = read_path(&obj_in(&files, &unknown, MTL)).expect("an OBJ");
    assert_eq!(whole.colours[6..], [[255; 4]; 6]);
    assert!(whole.report.warnings[0].contains("`gone` is in no library"));
}

fn read_within(
    path: &std::path::Path,
    colour: ColourSource,
    bytes: usize,
) -> Result<Whole, ScanError> {
    let scratch = std::env::temp_dir();
    let options = ReadOptions {
        memory_bytes: bytes,
        scratch: &scratch,
        colour,
        transform: None,
        progress: &mut |_| true,
        keep: &[],
    };
    read_all(ScanReader::open_within(path, options)?)
}

#[test]
fn where_colours_come_from_is_chosen_and_said() {
    const ROOM: usize = 1 << 20;
    let files = Files::new();
    let coloured = obj("usemtl stone").replace("v 0.1 0.6 0\n", "v 0.1 0.6 0 0 0 1\n");
    let path = obj_in(&files, &coloured, MTL);
    for (source, first, taken, left_out) in [
        (ColourSource::Auto, Some([0, 0, 255, 255]), ColourTaken::Vertex, Some("textures")),
        (ColourSource::Vertex, Some([0, 0, 255, 255]), ColourTaken::Vertex, Some("textures")),
        (
            ColourSource::Texture,
            Some([255, 0, 0, 255]),
            ColourTaken::Texture,
            Some("colours of vertices"),
        ),
        (ColourSource::None, None, ColourTaken::None, Some("colours of vertices")),
    ] {
        let whole = read_within(&path, source, ROOM).expect("an OBJ");
        assert_eq!(whole.colours.first().copied(), first, "{source}");
        assert_eq!(whole.report.colours.taken, taken, "{source}");
        let said = whole.report.colours.left_out.first().map(String::as_str);
        assert_eq!(said, left_out, "{source}");
        // However little room there is for arrays, it reads the same.
        let little = read_within(&path, source, 200 << 10).expect("an OBJ");
        assert_eq!((little.colours, little.positions), (whole.colours, whole.positions));
    }
    // Without a texture there is none to be taken.
    let path = files.write("plain.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let error = read_within(&path, ColourSource::Texture, ROOM).expect_err("no texture");
    assert!(matches!(error, ScanError::NoTexture { .. }), "{error}");
}

#[test]
fn textures_that_cannot_be_used_are_remarked_upon_or_refused() {
    let files = Files::new();
    let outside = Files::new();
    let secret = outside.write("secret.png", quarters());
    files.write("gif.png", "GIF89a........");
    #[cfg(unix)]
    std::os::unix::fs::symlink(&secret, files.0.path().join("link.png")).expect("a link");
    let absolute = secret.display().to_string();
    let cases = [
        ("map_Kd gone.png", "is not there"),
        ("map_Kd ../a.png", "outside the folder"),
        ("map_Kd sub/../../a.png", "outside the folder"),
        ("map_Kd C:\\scans\\a.png", "outside the folder"),
        (&format!("map_Kd {absolute}"), "outside the folder"),
        #[cfg(unix)]
        ("map_Kd link.png", "link that leads outside"),
        ("map_Kd gif.png", "is of the format Gif"),
        ("map_Kd a.mtl", "is no PNG, JPEG or TIFF"),
        ("map_Kd", "names no file"),
    ];
    for (line, said) in cases {
        let path = obj_in(&files, &obj("usemtl stone"), &format!("newmtl stone\n{line}\n"));
        let whole = read_path(&path).expect("the shape is fine");
        assert!(!whole.header.has_colours && whole.colours.is_empty(), "{line}");
        let warning = whole.report.warnings.join("\n");
        assert!(warning.contains("no colours") && warning.contains(said), "{line}: {warning}");
        let error = read_within(&path, ColourSource::Texture, 1 << 20).expect_err(line);
        assert!(matches!(error, ScanError::Texture { .. }), "{line}: {error}");
        assert!(error.to_string().contains(said), "{line}: {error}");
    }
    // No library, and one that is a picture.
    std::fs::remove_file(files.0.path().join("a.mtl")).expect("it is there");
    let whole = read_path(&files.0.path().join("a.obj")).expect("the shape is fine");
    assert!(whole.report.warnings[0].contains("material library `a.mtl` is not there"));

    // Too large for the memory: refused whatever the source, with what to do.
    let path = obj_in(&files, &obj("usemtl stone"), MTL);
    let error = read_within(&path, ColourSource::Auto, 8 << 10).expect_err("no room");
    assert!(matches!(error, ScanError::TexturesTooLarge { .. }), "{error}");
    assert!(error.to_string().contains("--memory"), "{error}");
    assert!(read_within(&path, ColourSource::None, 8 << 10).is_ok());
}

#[test]
fn coordinates_may_be_wrong() {
    let files = Files::new();
    // Not a number, not there, of no such number: those faces stay white, the others are as before.
    let wrong = obj("usemtl stone").replace("vt 0.1 0.6\n", "vt nan 0.6\n");
    let wrong = wrong.replace("f 4/4 5/5", "f 4 5/99");
    let whole = read_path(&obj_in(&files, &wrong, MTL)).expect("an OBJ");
    assert_eq!(whole.colours[..6], [[255; 4]; 6]);
    assert_eq!(whole.colours[6..], expected()[6..]);
    assert_eq!(whole.report.colours.corners_nowhere, 6);
    assert_eq!(whole.report.colours.vertices_bare, 6);
    // A texture number that is none, and a list of another length.
    let path = files.write("a.ply", ply("", Some(7)));
    assert_eq!(read_path(&path).expect("a PLY").colours, [[255; 4]; 12]);
    let path = files.write("a.ply", ply("", Some(-1)));
    assert_eq!(read_path(&path).expect("a PLY").colours, [[255; 4]; 12]);
    let short = ply("", None).replacen(" 6 0.1 0.6 0.4 0.6 0.1 0.9", " 2 0.1 0.6", 1);
    let whole = read_path(&files.write("a.ply", short)).expect("a PLY");
    assert_eq!(whole.colours[..3], [[255; 4]; 3]);
    assert_eq!(whole.colours[3..], expected()[3..]);
}

#[test]
fn colours_of_vertices_are_srgb_but_linear_in_gltf() {
    let files = Files::new();
    let path = files.write("a.obj", "v 0 0 0 0.5 0.5 0.5\nv 1 0 0 0 0 0\nv 0 1 0 1 1 1\nf 1 2 3\n");
    assert_eq!(read_path(&path).expect("an OBJ").colours[0], [128, 128, 128, 255]);
    let mut ply = "ply\nformat ascii 1.0\nelement vertex 3\n".to_owned();
    ["x", "y", "z", "red", "green", "blue"]
        .iter()
        .for_each(|name| ply += &format!("property float {name}\n"));
    ply += "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    ply += "0 0 0 0.5 0.5 0.5\n1 0 0 0 0 0\n0 1 0 1 1 1\n3 0 1 2\n";
    assert_eq!(
        read_path(&files.write("a.ply", ply)).expect("a PLY").colours[0],
        [128, 128, 128, 255]
    );
    // `gltf.rs` has the same of glTF: half the light is 188.
}
