//! Figures: parts equal the whole, lengths are what they should be, files say what they are.

use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;

use glam::{DVec3, Mat3, Vec3};
use hlod_build::synth::StatueOptions;
use hlod_compress::srgb::linear_from_srgb;
use hlod_render::figure::plate::{Plate, Side};
use hlod_render::figure::scale::Scale;
use hlod_render::figure::{Sheet, light_dome, orthographic};
use hlod_render::framing::Framing;
use hlod_render::picture::{Picture, take};
use hlod_render::scene::{Light, Paint, Representation, Shadow, Shot, light_from_angles};
use hlod_render::{Gpu, Model, ModelLimits};
use hlod_tests::{ball, built, bumpy_ball, gpu, ply, program};

use crate::pictures::shot;
use crate::points::ball_cloud;

struct Scene {
    gpu: Gpu,
    models: [Model; 1],
    framing: Framing,
    _folder: tempfile::TempDir,
}

fn scene(ply: &str, leaf_triangles: u32) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let [scan, file] = ["scan.ply", "scan.hlod"].map(|f| folder.path().join(f));
    std::fs::write(&scan, ply).unwrap();
    built(&scan, &file, |o| o.leaf_triangles = leaf_triangles);
    let gpu = gpu();
    let model = Model::open(&gpu, &file, ModelLimits::default()).unwrap();
    let framing = Framing::of(&model);
    Scene { gpu, models: [model], framing, _folder: folder }
}

/// A statue of few triangles as a file, with its unit, made once.
fn statue() -> &'static Path {
    static FILE: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, file) = FILE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let [scan, file] = ["statue.ply", "statue.hlod"].map(|f| folder.path().join(f));
        let synth = program("hlod-build")
            .args(["synth", "statue", "--triangles", "60K", "--quiet", "-o"])
            .arg(&scan)
            .output()
            .unwrap();
        assert!(synth.status.success(), "{}", String::from_utf8_lossy(&synth.stderr));
        built(&scan, &file, |o| o.unit = hlod_compress::Unit::Millimetre);
        (folder, file)
    });
    file
}

fn render(folder: &Path, arguments: &[&str]) -> Output {
    program("hlod-render")
        .current_dir(folder)
        .args(["--software", "-q"])
        .args(arguments)
        .output()
        .unwrap()
}

fn pictures_of(s: &mut Scene, shot: &Shot, n: u32, part_px: Option<u32>) -> Picture {
    let mut sheet = Sheet::of(shot, 150, 110);
    (sheet.supersampling, sheet.part_px) = (n, part_px);
    sheet.picture(&s.gpu, &mut s.models).unwrap()
}

fn different(a: &Picture, b: &Picture) -> usize {
    let pairs = a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4));
    pairs.filter(|(a, b)| a != b).count()
}

/// One picture, moved by a pixel to the right.
fn shifted(picture: &Picture) -> Picture {
    let mut rgba = picture.rgba.clone();
    rgba.rotate_right(4);
    Picture { rgba, ..*picture }
}

#[test]
fn parts_are_what_the_whole_picture_has_there() {
    let mut s = scene(&bumpy_ball(60), 700);
    let plain = shot(&s.framing, Representation::Hybrid);
    let near =
        s.framing.camera(s.framing.point([0.1, 0.2, 0.75]), s.framing.point([0.0, 0.1, 0.0]), 60.0);
    let parallel = orthographic(&s.framing, DVec3::new(0.3, 0.4, 1.0), DVec3::Y, 1.7);
    let lamp = Light::Point(s.framing.point([0.9, 0.4, 0.8]));
    for camera in [plain.camera, near, parallel] {
        for (shadow, light_size) in
            [(Shadow::None, 0.0), (Shadow::Hard, 0.0), (Shadow::Soft, 5.0), (Shadow::Traced, 3.0)]
        {
            for light in [plain.light, lamp] {
                if shadow == Shadow::None && light == lamp {
                    continue;
                }
                let tau = if camera == near { 3.0 } else { 1.0 };
                let shot =
                    Shot { camera, shadow, light_size, light, error_threshold_px: tau, ..plain };
                let whole = pictures_of(&mut s, &shot, 1, None);
                let parts = pictures_of(&mut s, &shot, 1, Some(37));
                let what = format!("{:?} {shadow:?} {light:?}", camera.projection);
                assert_eq!(different(&whole, &parts), 0, "{what}");
                assert!(different(&whole, &shifted(&parts)) > 300, "{what}");
            }
        }
    }
    for paint in [Paint::Depth, Paint::Borders] {
        let shot = Shot { paint, ..plain };
        let whole = pictures_of(&mut s, &shot, 1, None);
        assert_eq!(different(&whole, &pictures_of(&mut s, &shot, 1, Some(37))), 0);
    }
    let whole = pictures_of(&mut s, &plain, 3, None);
    assert_eq!(different(&whole, &pictures_of(&mut s, &plain, 3, Some(29))), 0, "supersampled");
    // Other light is another picture: the comparison would see it.
    let other = Shot { light: lamp, ..plain };
    assert!(different(&whole, &pictures_of(&mut s, &other, 3, None)) > 300);
}

#[test]
fn parts_agree_whatever_was_read_first() {
    let gpu = gpu();
    let drawn = |part_px: Option<u32>| {
        let model = Model::open(&gpu, statue(), ModelLimits::default()).unwrap();
        let framing = Framing::of(&model);
        // Faces of cells are seen edge on, and with them what two nodes share.
        let camera = orthographic(&framing, framing.axes[2], DVec3::Y, 1.05 * framing.height);
        let light = light_from_angles(&camera, -60.0, 40.0);
        let plain = shot(&framing, Representation::Hybrid);
        let shot = Shot { camera, light, shadow: Shadow::Hard, ..plain };
        let mut sheet = Sheet::of(&shot, 260, 400);
        sheet.part_px = part_px;
        sheet.picture(&gpu, &mut [model]).unwrap()
    };
    let whole = drawn(None);
    for part_px in [None, Some(123), Some(64)] {
        assert_eq!(different(&whole, &drawn(part_px)), 0, "{part_px:?}");
    }
    assert!(different(&whole, &shifted(&whole)) > 10_000);
}

#[test]
fn parts_of_clouds_agree_where_points_reach_into_the_next() {
    let mut s = scene(&ball_cloud(6000), 500);
    let plain = shot(&s.framing, Representation::Points);
    // So near that points are wide discs.
    let eye = s.framing.point([0.1, 0.1, 0.9]);
    let near = s.framing.camera(eye, s.framing.centre, 40.0);
    for camera in [plain.camera, near] {
        for shadow in [Shadow::None, Shadow::Hard] {
            let shot = Shot { camera, shadow, ..plain };
            let whole = pictures_of(&mut s, &shot, 1, None);
            let parts = pictures_of(&mut s, &shot, 1, Some(23));
            assert_eq!(different(&whole, &parts), 0, "{shadow:?}");
            assert!(different(&whole, &shifted(&parts)) > 300);
        }
    }
}

#[test]
fn figures_show_what_pictures_in_one_piece_show() {
    let mut s = scene(&bumpy_ball(60), 700);
    let shot = shot(&s.framing, Representation::Hybrid);
    let (picture, _) = take(&s.gpu, &mut s.models, &shot, 150, 110, 1).unwrap();
    // Large triangles are rasterised by other means: roundings at edges.
    let figure = pictures_of(&mut s, &shot, 1, Some(64));
    assert!(different(&picture, &figure) < 20, "{}", different(&picture, &figure));
    // From inside, where triangles are as large as the picture and are cut by the near plane.
    let inside = s.framing.camera(s.framing.point([0.0, 0.0, 0.47]), s.framing.centre, 90.0);
    let shot = Shot { camera: inside, error_threshold_px: 200.0, ..shot };
    let (picture, _) = take(&s.gpu, &mut s.models, &shot, 150, 110, 1).unwrap();
    let figure = pictures_of(&mut s, &shot, 1, Some(64));
    assert!(different(&picture, &figure) < 60, "{}", different(&picture, &figure));
}

#[test]
fn triangles_larger_than_parts_are_the_same_in_each() {
    let corner = |i: u32| [0, 1, 2].map(|axis| f64::from(i >> axis & 1));
    let faces = [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4]];
    // Without one side, so that the others are seen from within.
    let more = [[2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6]];
    let cube = ply(&[0, 1, 2, 3, 4, 5, 6, 7].map(corner), &[&faces[..], &more].concat());
    let mut s = scene(&cube, 1000);
    let plain = shot(&s.framing, Representation::Hybrid);
    // Before it, inside it, and so near a side that the near plane cuts it.
    for (eye, target) in [
        ([0.9, 0.7, 1.2], [0.0; 3]),
        ([0.3, -0.2, 0.4], [-0.5, 0.1, -0.5]),
        ([0.0, 0.5002, 0.1], [0.5, 0.4, 0.5]),
    ] {
        let camera = s.framing.camera(s.framing.point(eye), s.framing.point(target), 70.0);
        let shot = Shot { camera, shadow: Shadow::Hard, ..plain };
        let whole = pictures_of(&mut s, &shot, 2, None);
        let parts = pictures_of(&mut s, &shot, 2, Some(31));
        assert_eq!(different(&whole, &parts), 0, "{eye:?}");
        let (fixed, _) = take(&s.gpu, &mut s.models, &shot, 150, 110, 2).unwrap();
        let roundings = different(&whole, &fixed);
        assert!(roundings < 150, "{eye:?}: {roundings}");
        assert!(different(&shifted(&whole), &fixed) > 2 * roundings + 100, "{eye:?}");
    }
}

#[test]
fn nothing_is_transparent_and_edges_have_no_fringe() {
    let mut s = scene(&bumpy_ball(60), 4000);
    let mut shot = shot(&s.framing, Representation::Hybrid);
    shot.material.ambient = 1.0;
    shot.material.highlight = 0.0;
    let mut sheet = Sheet::of(&shot, 120, 120);
    (sheet.supersampling, sheet.transparent) = (4, true);
    let picture = sheet.picture(&s.gpu, &mut s.models).unwrap();
    let pixels: Vec<&[u8]> = picture.rgba.chunks_exact(4).collect();
    assert_eq!(pixels[0], [0; 4]);
    assert_eq!(pixels[60 * 120 + 60][3], 255);
    let edges: Vec<_> = pixels.iter().filter(|p| (1..255).contains(&p[3])).collect();
    assert!(edges.len() > 100);
    // Ambient light alone is 0.6 to 1 of the albedo: whatever their alpha, edges are not darker.
    let least = linear_from_srgb(pixels[60 * 120 + 60][1]) * 0.5;
    assert!(edges.iter().all(|p| linear_from_srgb(p[1]) > least));
    // On a black background that is averaged in they are.
    shot.background = Vec3::ZERO;
    let mut sheet = Sheet::of(&shot, 120, 120);
    sheet.supersampling = 4;
    let opaque = sheet.picture(&s.gpu, &mut s.models).unwrap();
    let at = pixels.iter().position(|p| (20..90).contains(&p[3])).unwrap();
    assert!(linear_from_srgb(opaque.rgba[4 * at + 1]) < least);
}

/// First and last column of a row where anything is drawn.
fn span(picture: &Picture, row: u32) -> Option<(u32, u32)> {
    let is_drawn = |x: u32| picture.rgba[4 * (row * picture.width + x) as usize + 3] > 127;
    let mut drawn = (0..picture.width).filter(|x| is_drawn(*x));
    let first = drawn.next()?;
    Some((first, drawn.next_back().unwrap_or(first)))
}

#[test]
fn a_plate_is_to_scale() {
    let gpu = gpu();
    let model = Model::open(&gpu, statue(), ModelLimits::default()).unwrap();
    let framing = Framing::of(&model);
    let mut models = [model];
    let truth = hlod_build::synth::describe(&StatueOptions { triangles: 60_000, seed: 1 }).plinth;
    let scale = Scale { reduction: 10.0, dpi: 127.0 };
    let plate = Plate {
        sides: Side::ALL.map(|(side, _)| side).to_vec(),
        scale,
        unit: hlod_compress::Unit::Millimetre,
        title: "statue".into(),
        transparent: true,
        supersampling: 1,
    };
    let template = shot(&framing, Representation::Full);
    let (mut sheet, laid) = plate.lay_out(&framing, &template).unwrap();
    sheet.marks.clear();
    let page = sheet.picture(&gpu, &mut models).unwrap();
    let pixel = scale.pixel_mm();
    assert!((pixel - 2.0).abs() < 1e-12);
    let view = |side: Side| laid.iter().find(|l| l.side == side).unwrap().view;
    let bottom = |side: Side| view(side).y + view(side).height;
    for (side, axis) in [(Side::Front, 0), (Side::Back, 0), (Side::Left, 2), (Side::Right, 2)] {
        let v = view(side);
        let crop: Vec<u8> = (0..v.height)
            .flat_map(|y| {
                let at = 4 * ((v.y + y) * page.width + v.x) as usize;
                page.rgba[at..at + 4 * v.width as usize].to_vec()
            })
            .collect();
        let crop = Picture { width: v.width, height: v.height, rgba: crop };
        // Half way up the plinth.
        let middle_mm = (truth.low_mm[1] + truth.high_mm[1]) / 2.0;
        let above = (middle_mm - framing.bounds.0.y) / pixel;
        let centre = f64::from(v.height) / 2.0;
        let half = (framing.bounds.1.y - framing.bounds.0.y) / pixel / 2.0;
        let row = (centre + half - above) as u32;
        let (first, last) = span(&crop, row).unwrap();
        let length = f64::from(last - first + 1);
        let expected = (truth.high_mm[axis] - truth.low_mm[axis]) / pixel;
        assert!((length - expected).abs() <= 1.0, "{side:?}: {length} px for {expected}");
        // At another scale it would not be.
        assert!((length - expected * 1.02).abs() > 1.0);
        assert_eq!(bottom(side), bottom(Side::Front), "one base line");
    }
    let (front, top, left) = (view(Side::Front), view(Side::Top), view(Side::Left));
    assert_eq!((top.x, top.width), (front.x, front.width), "above the front");
    assert!(top.y + top.height < front.y && left.x + left.width < front.x);
    // The front is below in the top view: the plinth's panel side is as far from the middle as it is.
    let low = laid.iter().find(|l| l.side == Side::Top).unwrap().view.shot.camera.axes()[1];
    assert_eq!(low, -framing.axes[2]);
}

#[test]
fn photometric_stereo_finds_the_normals_of_a_ball() {
    // Fine enough that facets' own normals are the ball's.
    let mut s = scene(&ball(120, 0.0), 20_000);
    let camera = orthographic(&s.framing, DVec3::Z, DVec3::Y, 2.2);
    let plain = Shot { camera, ..shot(&s.framing, Representation::Full) };
    let directions = light_dome::directions(24);
    let size = 80u32;
    let pictures: Vec<Picture> = directions
        .iter()
        .map(|d| {
            let light = light_dome::light(&camera, *d);
            let material = light_dome::material(&plain.material);
            let shot = Shot { light, material, background: Vec3::ZERO, ..plain };
            Sheet::of(&shot, size, size).picture(&s.gpu, &mut s.models).unwrap()
        })
        .collect();
    let error = |lights: &[DVec3], power: f32| {
        let mut worst = 0.0f32;
        for y in 0..size {
            for x in 0..size {
                let at = |v: u32| (f64::from(v) + 0.5) / f64::from(size) * 2.2 - 1.1;
                let (nx, ny) = (at(x), -at(y));
                // Where more than a few lights are seen and rims do not mix.
                if nx * nx + ny * ny > 0.8 {
                    continue;
                }
                let truth = DVec3::new(nx, ny, (1.0 - nx * nx - ny * ny).sqrt()).as_vec3();
                let found = normal(lights, &pictures, (4 * (y * size + x) + 1) as usize, power);
                worst = worst.max(truth.angle_between(found).to_degrees());
            }
        }
        worst
    };
    let degrees = error(&directions, 1.0);
    assert!(degrees < 1.5, "{degrees}°");
    // Lights in another order, and light that is not linear, are found out.
    let wrong: Vec<DVec3> = directions.iter().rev().copied().collect();
    assert!(error(&wrong, 1.0) > 10.0);
    assert!(error(&directions, 1.0 / 2.2) > 3.0);
}

/// By least squares over the lights that a point sees (Woodham 1980).
fn normal(lights: &[DVec3], pictures: &[Picture], at: usize, power: f32) -> Vec3 {
    let (mut sum, mut right) = (Mat3::ZERO, Vec3::ZERO);
    for (light, picture) in lights.iter().zip(pictures) {
        let value = linear_from_srgb(picture.rgba[at]);
        if value > 0.02 {
            let l = light.as_vec3();
            sum += Mat3::from_cols(l * l.x, l * l.y, l * l.z);
            right += l * value.powf(power);
        }
    }
    (sum.inverse() * right).normalize()
}

#[test]
fn files_say_what_they_are_and_are_the_same_twice() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let file = statue().to_str().unwrap();
    let common = ["--scale", "1:20", "--dpi", "200", "--tau", "2", file];
    let mut commands: Vec<(&str, Vec<&str>)> = vec![
        ("a.png", ["shot", "--ortho", "--scale-bar", "--camera", "front", "-o", "a.png"].into()),
        ("a.tif", ["shot", "--ortho", "--transparent", "--shadow", "hard", "-o", "a.tif"].into()),
        ("plate.png", ["plate", "-o", "plate.png", "--views", "front,top"].into()),
    ];
    for (name, arguments) in &mut commands {
        arguments.extend(common);
        let mut found = Vec::new();
        for folder in &folders {
            let done = render(folder.path(), arguments);
            assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
            found.push(std::fs::read(folder.path().join(&**name)).unwrap());
            assert_eq!(
                std::fs::read_dir(folder.path()).unwrap().count(),
                1,
                "nothing else is left"
            );
            std::fs::remove_file(folder.path().join(&**name)).unwrap();
        }
        assert!(found[0] == found[1], "{name} differs from itself");
        match name.ends_with(".png") {
            true => check_png(&found[0]),
            false => check_tiff(&found[0]),
        }
    }
}

fn check_png(bytes: &[u8]) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut rgba = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut rgba).unwrap();
    let info = reader.info();
    let dims = info.pixel_dims.unwrap();
    assert_eq!((dims.xppu, dims.yppu, dims.unit), (7874, 7874, png::Unit::Meter));
    assert_eq!(info.srgb, Some(png::SrgbRenderingIntent::Perceptual));
    let text = |keyword: &str| {
        let found = info.utf8_text.iter().find(|t| t.keyword == keyword).unwrap();
        found.get_text().unwrap()
    };
    assert_eq!(text("Title"), "statue.hlod");
    assert!(text("Software").starts_with("hlod-render "));
    assert!(text("Source").starts_with("statue.ply, ") && text("Source").contains("SHA-256 "));
    let description = text("Description");
    for line in ["scale: 1 : 20 at 200 dpi", "unit: mm", "light: ", "shadows: none", "tau: 2 px"] {
        assert!(description.contains(line), "{line} in {description}");
    }
    let command = text("Comment");
    assert!(command.starts_with("hlod-render --software "), "{command}");
    assert!(command.contains(" statue.hlod") && !command.contains('/'), "{command}");
}

fn check_tiff(bytes: &[u8]) {
    use tiff::tags::Tag;
    let mut reader = tiff::decoder::Decoder::new(std::io::Cursor::new(bytes)).unwrap();
    let (width, height) = reader.dimensions().unwrap();
    assert_eq!(reader.colortype().unwrap(), tiff::ColorType::RGBA(8));
    assert_eq!(reader.get_tag_u32(Tag::ResolutionUnit).unwrap(), 2, "inches");
    assert_eq!(reader.get_tag_u32_vec(Tag::XResolution).unwrap(), [200_000, 1000]);
    assert_eq!(reader.get_tag_u32(Tag::ExtraSamples).unwrap(), 2, "alpha is not multiplied in");
    let text = reader.get_tag_ascii_string(Tag::ImageDescription).unwrap();
    assert!(text.contains("SHA-256 ") && text.contains("scale: 1 : 20"), "{text}");
    let tiff::decoder::DecodingResult::U8(rgba) = reader.read_image().unwrap() else { panic!() };
    assert_eq!(rgba.len(), 4 * width as usize * height as usize);
    assert_eq!(rgba[..4], [0; 4]);
    assert!(rgba.chunks_exact(4).filter(|p| p[3] == 255).count() > 1000);
}

#[test]
fn what_cannot_be_is_refused_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let file = statue().to_str().unwrap();
    let units = folder.path().join("units.hlod");
    let scan = folder.path().join("units.ply");
    std::fs::write(&scan, bumpy_ball(12)).unwrap();
    built(&scan, &units, |_| {});
    std::fs::remove_file(&scan).unwrap();
    std::fs::create_dir(folder.path().join("full")).unwrap();
    std::fs::write(folder.path().join("full/a"), "").unwrap();
    let count = || std::fs::read_dir(folder.path()).unwrap().count();
    let before = count();
    for (arguments, expected) in [
        (vec!["shot", file, "-o", "a.jpg"], "JPEG"),
        (vec!["shot", file, "-o", "a.bmp"], "PNG or TIFF"),
        (vec!["shot", file, "-o", "none/a.png"], "no folder"),
        (vec!["shot", file, "-o", "a.png", "--scale", "1:5"], "--ortho"),
        (vec!["shot", file, "-o", "a.png", "--ortho", "--scale", "1:0"], "scale such as"),
        (vec!["shot", file, "-o", "a.png", "--dpi", "0"], "pixels in an inch"),
        (vec!["shot", file, "-o", "a.png", "--size", "1000000000x1"], "size"),
        (vec!["shot", file, "-o", "a.png", "--ortho", "--scale", "100:1"], "pixels"),
        (vec!["shot", file, "-o", "a.png", "--ortho", "--scale", "1000000:1"], "pixels"),
        (vec!["shot", file, "-o", "a.png", "--unit", "m"], "unit is mm"),
        (vec!["shot", "units.hlod", "-o", "a.png", "--ortho", "--scale", "1:1"], "--unit mm"),
        (vec!["plate", "units.hlod", "-o", "a.png", "--scale", "1:1"], "--unit mm"),
        (vec!["plate", file, "-o", "a.png", "--scale", "1000:1"], "pixels"),
        (vec!["plate", file, "-o", "a.png", "--scale", "1:5", "--views", "front,front"], "twice"),
        (vec!["plate", file, "-o", "a.png", "--scale", "1:5", "--views", "side"], "expected some"),
        (vec!["turntable", file, "-o", "full"], "already"),
        (vec!["turntable", file, "-o", "none/all"], "no folder"),
        (vec!["turntable", file, "-o", "all", "--frames", "0"], "0"),
        (vec!["light-dome", file, "-o", "all", "--lights", "0"], "0"),
        (vec!["light-dome", file, "-o", "all", "--camera", "x"], "--camera"),
    ] {
        let done = render(folder.path(), &arguments);
        let said = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(expected), "{arguments:?}: {said}");
        assert_eq!(count(), before, "{arguments:?}");
    }
}

#[test]
fn series_fill_their_folders() {
    let folder = tempfile::tempdir().unwrap();
    let file = statue().to_str().unwrap();
    let style = ["--size", "60x80", "--tau", "4"];
    let turntable = ["turntable", file, "-o", "turn", "--frames", "4"];
    let done = render(folder.path(), &[&turntable[..], &style].concat());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let dome = ["light-dome", file, "-o", "dome", "--lights", "5"];
    let done = render(folder.path(), &[&dome[..], &style].concat());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    for (name, count) in [("turn", 4), ("dome", 6)] {
        assert_eq!(std::fs::read_dir(folder.path().join(name)).unwrap().count(), count);
    }
    let list = std::fs::read_to_string(folder.path().join("dome/light-dome.lp")).unwrap();
    let mut lines = list.lines();
    assert_eq!(lines.next(), Some("5"));
    for line in lines {
        let words: Vec<&str> = line.split(' ').collect();
        let picture = image::open(folder.path().join("dome").join(words[0])).unwrap();
        assert_eq!((picture.width(), picture.height()), (60, 80));
        let d: Vec<f64> = words[1..].iter().map(|w| w.parse().unwrap()).collect();
        assert!((DVec3::new(d[0], d[1], d[2]).length() - 1.0).abs() < 1e-6);
    }
    let turned = |i: u32| {
        let name = format!("turn/frame-{i:03}.png");
        image::open(folder.path().join(name)).unwrap().to_rgba8().into_raw()
    };
    assert_ne!(turned(0), turned(1));
}
