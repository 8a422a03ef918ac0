//! Painting with known answers, and images that are not what they seem.

use std::io::Cursor;

use glam::DVec3;
use image::{DynamicImage, ImageFormat};

use super::decode::{Decoded, Refusal, decode};
use super::filter::byte_from_light;
use super::paint::{NOWHERE, Painter, Surface};
use super::{Texture, Wrap, linear_from_srgb};
use crate::paged::Room;

const PLAIN: Surface = Surface {
    texture: Some(0),
    factor: [1.0; 3],
    texture_from_file: Surface::FROM_UPPER_LEFT,
    wrap: [Wrap::Clamp; 2],
};

/// A flat square of `n` × `n` squares over the whole texture, its faces cut by `cut`.
struct Grid {
    positions: Vec<DVec3>,
    faces: Vec<Vec<u32>>,
}

fn grid(n: u32, cut: impl Fn(u32, [u32; 4]) -> Vec<Vec<u32>>) -> Grid {
    let side = n + 1;
    let step = 1.0 / f64::from(n);
    let at = |i: u32| DVec3::new(f64::from(i % side) * step, f64::from(i / side) * step, 0.0);
    let corner = |x: u32, y: u32| y * side + x;
    let square = |i: u32| {
        let (x, y) = (i % n, i / n);
        cut(i, [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)])
    };
    Grid {
        positions: (0..side * side).map(at).collect(),
        faces: (0..n * n).flat_map(square).collect(),
    }
}

fn triangles(_: u32, [a, b, c, d]: [u32; 4]) -> Vec<Vec<u32>> {
    vec![vec![a, b, c], vec![a, c, d]]
}

fn paint(grid: &Grid, texture: Texture, order: impl Fn(usize) -> usize) -> Vec<[u8; 4]> {
    let room = Room::UNBOUNDED;
    let mut painter = Painter::new(vec![texture], grid.positions.len() as u64, &room).unwrap();
    for position in &grid.positions {
        painter.add_vertex(*position).unwrap();
    }
    for i in 0..grid.faces.len() {
        let face = &grid.faces[order(i)];
        let coordinates = face.iter().map(|vertex| {
            let at = grid.positions[*vertex as usize];
            [at.x as f32, at.y as f32]
        });
        painter.add_face(&PLAIN, face, &coordinates.collect::<Vec<_>>()).unwrap();
    }
    painter.finish();
    (0..grid.positions.len()).map(|vertex| painter.colour(vertex).unwrap()).collect()
}

/// Linear light that grows from left to right, in 256 × 64 texels.
fn ramp() -> Texture {
    let row: Vec<u8> =
        (0..256).flat_map(|x| [byte_from_light((f64::from(x) + 0.5) / 256.0); 3]).collect();
    Texture::new(256, 64, row.repeat(64))
}

#[test]
fn a_ramp_is_the_ramp_at_every_inner_vertex() {
    let n = 16;
    let grid = grid(n, triangles);
    let light = |colour: u8| linear_from_srgb(f64::from(colour) / 255.0);
    let error = |colours: &[[u8; 4]]| {
        let inner = grid.positions.iter().zip(colours);
        let inner = inner.filter(|(p, _)| p.min_element() >= 0.0 && p.x > 0.0 && p.x < 1.0);
        inner.map(|(p, colour)| (light(colour[0]) - p.x).abs()).fold(0.0, f64::max)
    };
    let colours = paint(&grid, ramp(), |i| i);
    // A step of 8 bits is up to 0.009 of light; the borders' vertices are the middle of half a cell.
    assert!(error(&colours) < 0.012, "{}", error(&colours));
    // A texture that lies a cell away is told apart.
    let mut moved = colours.clone();
    moved.rotate_left(1);
    assert!(error(&moved) > 0.05);
}

#[test]
fn faces_may_come_in_any_order_and_be_cut_in_any_way() {
    let texture = || {
        let texels =
            (0..128 * 128u32).flat_map(|i| [(i * 7) as u8, (i >> 5) as u8, (i ^ i >> 7) as u8]);
        Texture::new(128, 128, texels.collect())
    };
    let cut_once = grid(8, triangles);
    let count = cut_once.faces.len();
    let colours = paint(&cut_once, texture(), |i| i);
    assert_eq!(paint(&cut_once, texture(), |i| count - 1 - i), colours);
    assert_eq!(paint(&cut_once, texture(), |i| i * 37 % count), colours);

    // Of one colour a side of the diagonal is as good as the other; corners counted by their number
    // would give vertices of two triangles twice the weight of those of one.
    let half = || {
        let texels = (0..64 * 64).flat_map(|i| if i % 64 < 32 { [255; 3] } else { [0; 3] });
        Texture::new(64, 64, texels.collect())
    };
    let quads = grid(2, |_, square| vec![square.to_vec()]);
    let cut = grid(2, |i, [a, b, c, d]| match i % 2 {
        0 => vec![vec![a, b, c], vec![a, c, d]],
        _ => vec![vec![b, c, d, a]],
    });
    let (whole, mixed) = (paint(&quads, half(), |i| i)[4], paint(&cut, half(), |i| i)[4]);
    // Half white and half black, but for the samples that straddle the border.
    assert!(whole[0].abs_diff(188) <= 2 && mixed[0].abs_diff(188) <= 2, "{whole:?} {mixed:?}");
}

#[test]
fn a_seam_has_the_mean_of_both_its_sides_and_one_colour() {
    // Red left, blue right; two triangles share an edge, whose ends are given twice.
    let texels = (0..64 * 64).flat_map(|i| if i % 64 < 32 { [255, 0, 0] } else { [0, 0, 255] });
    let texture = Texture::new(64, 64, texels.collect());
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let positions = [at(0., 0.), at(1., 0.), at(0., 1.), at(1., 0.), at(0., 1.), at(1., 1.)];
    let mut painter = Painter::new(vec![texture], 6, &Room::UNBOUNDED).unwrap();
    positions.iter().for_each(|position| painter.add_vertex(*position).unwrap());
    let chart = |u: f32| [[u, 0.1], [u + 0.2, 0.1], [u, 0.3]];
    painter.add_face(&PLAIN, &[0, 1, 2], &chart(0.1)).unwrap();
    // The same angles at the edge's ends.
    painter.add_face(&PLAIN, &[5, 4, 3], &chart(0.6)).unwrap();
    painter.finish();
    let colours: Vec<[u8; 4]> = (0..6).map(|v| painter.colour(v).unwrap()).collect();
    assert_eq!(colours[0], [255, 0, 0, 255]);
    assert_eq!(colours[5], [0, 0, 255, 255]);
    assert_eq!(colours[1..5], [[188, 0, 188, 255]; 4]);
    // Each triangle has 12.8² ÷ 2 texels, there are 4 places.
    assert!((painter.texels_a_vertex() - 12.8 * 12.8 / 4.0).abs() < 0.01);
}

#[test]
fn corners_nowhere_paint_nothing() {
    let texture = Texture::new(1, 1, vec![9; 3]);
    let mut painter = Painter::new(vec![texture], 3, &Room::UNBOUNDED).unwrap();
    for x in [0.0, 1.0, 2.0] {
        painter.add_vertex(DVec3::new(x, x * x, 0.0)).unwrap();
    }
    painter.add_face(&PLAIN, &[0, 1, 2], &[[0.0, 0.0], NOWHERE, [1.0, 1.0]]).unwrap();
    painter.add_face(&PLAIN, &[0, 1, 2], &[[0.0, 0.0], [f32::INFINITY, 0.0], [1.0, 1.0]]).unwrap();
    assert_eq!(painter.colour(0).unwrap(), [255; 4]);
    assert_eq!((painter.painted.corners_nowhere, painter.painted.vertices_bare), (6, 1));
    // No area in the texture is still a place.
    painter.add_face(&PLAIN, &[0, 1, 2], &[[0.5, 0.5]; 3]).unwrap();
    assert_eq!(painter.colour(0).unwrap(), [9, 9, 9, 255]);
    painter.add_face(&PLAIN, &[0, 1, 2], &[[f32::MAX, -1e30], [0.0, 0.0], [1e30, 3.0]]).unwrap();
}

const ROOM: u64 = 1 << 20;

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn colour_of(decoded: &Decoded) -> [u8; 3] {
    decoded.texture.mean([glam::DVec2::splat(1.5); 4], [Wrap::Clamp; 2]).map(byte_from_light)
}

#[test]
fn images_of_every_depth_are_read() {
    use image::{GrayImage, Luma, Rgb, RgbImage, Rgba, RgbaImage};
    type Rgb16 = image::ImageBuffer<Rgb<u16>, Vec<u16>>;
    let cases: [(DynamicImage, ImageFormat, u32, [u8; 3]); 6] = [
        (RgbImage::from_pixel(4, 3, Rgb([7, 8, 9])).into(), ImageFormat::Png, 8, [7, 8, 9]),
        (RgbaImage::from_pixel(4, 3, Rgba([7, 8, 9, 0])).into(), ImageFormat::Png, 8, [7, 8, 9]),
        (GrayImage::from_pixel(4, 3, Luma([7])).into(), ImageFormat::Png, 8, [7; 3]),
        (Rgb16::from_pixel(4, 3, Rgb([257, 65535, 128])).into(), ImageFormat::Png, 16, [1, 255, 0]),
        (
            Rgb16::from_pixel(4, 3, Rgb([257, 65535, 128])).into(),
            ImageFormat::Tiff,
            16,
            [1, 255, 0],
        ),
        (GrayImage::from_pixel(4, 3, Luma([200])).into(), ImageFormat::Jpeg, 8, [200; 3]),
    ];
    for (image, format, bits, expected) in cases {
        let decoded = decode(&encoded(&image, format), ROOM).unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!((decoded.size, decoded.bits), ([4, 3], bits), "{format:?}");
        assert_eq!(colour_of(&decoded), expected, "{format:?} of {bits} bits");
    }
}

fn refused(bytes: &[u8], allowed: u64) -> Refusal {
    decode(bytes, allowed).err().expect("a refusal")
}

fn unusable(bytes: &[u8]) -> String {
    match refused(bytes, ROOM) {
        Refusal::Unusable(what) => what,
        Refusal::Memory(needed) => panic!("needs {needed} bytes"),
    }
}

#[test]
fn images_that_are_none_are_refused_by_name() {
    // A frame of four components.
    let mut cmyk = vec![0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xff, 0xc0, 0, 20, 8];
    cmyk.extend([0, 4, 0, 4, 4, 1, 17, 0, 2, 17, 0, 3, 17, 0, 4, 17, 0]);
    assert!(unusable(&cmyk).contains("CMYK"));
    assert!(unusable(b"no image at all").contains("no PNG, JPEG or TIFF"));
    assert!(unusable(b"GIF89a......").contains("Gif"));
    assert!(unusable(b"").contains("no PNG"));
    let light = image::Rgb32FImage::from_pixel(2, 2, image::Rgb([0.5; 3]));
    assert!(unusable(&encoded(&light.into(), ImageFormat::Tiff)).contains("floating-point"));

    let image = DynamicImage::from(image::RgbImage::new(50, 40));
    let png = encoded(&image, ImageFormat::Png);
    for end in 0..png.len() {
        // Cut short anywhere it is refused, or whole but for its end mark.
        let _ = decode(&png[..end], ROOM);
    }
    assert!(unusable(&png[..png.len() / 2]).contains("decoded"));
}

#[test]
fn images_that_would_take_too_much_are_refused_before_they_do() {
    let image = DynamicImage::from(image::RgbImage::new(300, 300));
    for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Tiff] {
        let bytes = encoded(&image, format);
        // 7 bytes a texel, while it is decoded.
        let Refusal::Memory(needed) = refused(&bytes, 300_000) else { panic!("{format:?}") };
        assert!(needed > 300_000, "{format:?}: {needed}");
        assert!(decode(&bytes, 3 << 20).is_ok(), "{format:?}");
    }
    // A header that declares 4 · 10⁹ texels, in less than 100 bytes.
    let mut bomb = encoded(&DynamicImage::from(image::RgbImage::new(1, 1)), ImageFormat::Png);
    bomb[16..24].copy_from_slice(&[0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff]);
    let mut crc = crc_of(&bomb[12..29]).to_be_bytes();
    bomb[29..33].swap_with_slice(&mut crc);
    assert!(matches!(refused(&bomb, ROOM), Refusal::Memory(_)), "{:?}", refused(&bomb, ROOM));
    bomb[16..20].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff]);
    let mut crc = crc_of(&bomb[12..29]).to_be_bytes();
    bomb[29..33].swap_with_slice(&mut crc);
    assert!(unusable(&bomb).contains("65535"), "{}", unusable(&bomb));
}

/// The checksum of PNG chunks.
fn crc_of(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            crc >> 1 ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
        })
    })
}
