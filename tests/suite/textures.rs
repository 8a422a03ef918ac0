//! Pictures of textured scans: colours of vertices against the texture itself.

use std::path::Path;

use glam::DVec3;
use hlod_build::{BuildOptions, build, progress::Silent};
use hlod_compress::srgb::{linear_from_srgb, srgb_from_linear};
use hlod_render::camera::Projection;
use hlod_render::framing::Framing;
use hlod_render::picture::take;
use hlod_render::scene::{Light, Material, Representation};
use hlod_render::{Model, ModelLimits};
use hlod_tests::{built, gpu};
use image::{Rgb, RgbImage};

use crate::pictures::shot;

/// Pixels of the picture and squares of the surface along a side; texels of a pixel.
const SIDE: u32 = 160;
const TEXELS: u32 = 4;

/// What a photograph of stone has: features of all sizes, the small ones weak, grain of a texel, and
/// edges.
fn stone() -> RgbImage {
    let mut state = 1u32;
    RgbImage::from_fn(SIDE * TEXELS, SIDE * TEXELS, |x, y| {
        let (u, v) =
            (f64::from(x) / f64::from(SIDE * TEXELS), f64::from(y) / f64::from(SIDE * TEXELS));
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let grain = f64::from(state >> 16) / 65536.0 - 0.5;
        let waves: f64 = (1..6)
            .map(|octave| {
                let f = f64::from(1 << octave) * std::f64::consts::TAU;
                ((f * u).sin() * (f * (v + 0.3 * u)).cos()) / f64::from(octave)
            })
            .sum();
        let edge = if (6.0 * (u - v)).rem_euclid(1.0) < 0.5 { 25.0 } else { 0.0 };
        let value = 120.0 + 35.0 * waves + 24.0 * grain + edge;
        Rgb([value, 0.8 * value, 0.6 * value + 20.0 * u].map(|x| x.round() as u8))
    })
}

/// A square of side 2 in z = 0, of `SIDE`² squares, with coordinates that show all of the texture.
fn surface(folder: &Path, name: &str, colour: Option<&dyn Fn(u32, u32) -> [u8; 3]>) {
    let mut text = match colour {
        None => "mtllib stone.mtl\nusemtl stone\n".to_owned(),
        Some(_) => String::new(),
    };
    let side = SIDE + 1;
    for i in 0..side * side {
        let (column, row) = (i % side, i / side);
        let [x, y] = [column, row].map(|at| f64::from(at) / f64::from(SIDE));
        let [px, py] = [2.0 * x - 1.0, 2.0 * y - 1.0];
        text += &match colour {
            None => format!("v {px} {py} 0\nvt {x} {y}\n"),
            Some(colour) => {
                let [r, g, b] = colour(column, row).map(|c| f64::from(c) / 255.0);
                format!("v {px} {py} 0 {r} {g} {b}\n")
            }
        };
    }
    for i in 0..SIDE * SIDE {
        let first = i / SIDE * side + i % SIDE + 1;
        let [a, b, c, d] = [first, first + 1, first + side + 1, first + side];
        text += &format!("f {a}/{a} {b}/{b} {c}/{c}\nf {a}/{a} {c}/{c} {d}/{d}\n");
    }
    std::fs::write(folder.join("stone.mtl"), "newmtl stone\nmap_Kd stone.png\n").unwrap();
    std::fs::write(folder.join(name), &text).unwrap();
}

/// Its picture, lit so that each pixel is as bright as the surface.
fn picture(file: &Path) -> RgbImage {
    let gpu = gpu();
    let mut models = [Model::open(&gpu, file, ModelLimits::default()).unwrap()];
    let mut shot = shot(&Framing::of(&models[0]), Representation::Full);
    shot.material = Material { albedo: glam::Vec3::ONE, highlight: 0.0, ambient: 0.0 };
    shot.light = Light::Directional(DVec3::Z);
    shot.camera.target = DVec3::ZERO;
    shot.camera.eye = DVec3::new(0.0, 0.0, 10.0);
    shot.camera.projection = Projection::Orthographic { height: 2.0 };
    let (picture, _) = take(&gpu, &mut models, &shot, SIDE, SIDE, 4).unwrap();
    let rgb = picture.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]);
    RgbImage::from_raw(SIDE, SIDE, rgb.collect()).unwrap()
}

/// The texture, of each pixel the mean light.
fn filtered(texture: &RgbImage) -> RgbImage {
    RgbImage::from_fn(SIDE, SIDE, |x, y| {
        let texels = (0..TEXELS * TEXELS)
            .map(|i| texture.get_pixel(x * TEXELS + i % TEXELS, y * TEXELS + i / TEXELS));
        let mut light = [0.0; 3];
        for texel in texels {
            (0..3).for_each(|c| light[c] += linear_from_srgb(texel[c]));
        }
        Rgb(light.map(|sum| srgb_from_linear(sum / (TEXELS * TEXELS) as f32)))
    })
}

/// Mean difference of a colour's component, in steps of 1/255, without the outermost pixels, where
/// a vertex has the surface on one side only.
fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    let inner = |i: u32| (2..SIDE - 2).contains(&i);
    let pairs = a.enumerate_pixels().filter(|(x, y, _)| inner(*x) && inner(*y));
    let all: Vec<f64> = pairs
        .flat_map(|(x, y, p)| {
            let q = b.get_pixel(x, y);
            (0..3).map(|c| f64::from(p[c].abs_diff(q[c]))).collect::<Vec<_>>()
        })
        .collect();
    all.iter().sum::<f64>() / all.len() as f64
}

/// At the distance where a vertex is a pixel, colours of vertices are the texture's.
#[test]
fn a_picture_of_vertices_is_one_of_the_texture() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let texture = stone();
    texture.save(file("stone.png")).unwrap();
    surface(folder.path(), "stone.obj", None);
    let report = built(&file("stone.obj"), &file("stone.hlod"), |_| {});
    let texels = report.inputs[0].colours.texels_a_vertex;
    // 16 a square; there are a few more vertices than squares.
    assert!((15.0..16.0).contains(&texels), "{texels}");
    let expected = filtered(&texture);
    let painted = picture(&file("stone.hlod"));
    let off = difference(&painted, &expected);
    eprintln!("mean difference {off:.2} / 255");
    assert!(off <= 2.0, "{off}");

    // One texel for each vertex instead of all that it stands for is told apart, and so are
    // textures that are upside down or lie a few pixels away.
    let texel = |column: u32, row: u32| {
        let last = SIDE * TEXELS - 1;
        texture.get_pixel((column * TEXELS).min(last), last - (row * TEXELS).min(last)).0
    };
    surface(folder.path(), "texel.obj", Some(&texel));
    built(&file("texel.obj"), &file("texel.hlod"), |_| {});
    let of_texels = difference(&picture(&file("texel.hlod")), &expected);
    assert!(of_texels > 2.5, "{of_texels} by texels, {off} by means");
    assert!(difference(&image::imageops::flip_vertical(&painted), &expected) > 10.0);
    let mut moved = RgbImage::new(SIDE, SIDE);
    image::imageops::replace(&mut moved, &painted, 3, 0);
    assert!(difference(&moved, &expected) > 2.5);
}

/// The same bytes whatever the memory and however many threads; without colours where there are to
/// be none.
#[test]
fn textured_builds_do_not_depend_on_memory_or_threads() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    stone().save(file("stone.png")).unwrap();
    surface(folder.path(), "stone.obj", None);
    let bytes = |memory: u64, threads: usize| {
        let options = BuildOptions {
            memory_bytes: memory,
            leaf_triangles: 1000,
            force: true,
            ..BuildOptions::default()
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| build(&[file("stone.obj")], &file("a.hlod"), &options, &Silent)).unwrap();
        std::fs::read(file("a.hlod")).unwrap()
    };
    let usual = bytes(4 << 30, 2);
    assert_eq!(bytes(150 << 20, 1), usual);
}
