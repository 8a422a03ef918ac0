//! Image files into textures. They come from anywhere: what they declare is looked at before
//! anything is set aside for it.

use std::io::Cursor;

use image::{
    ColorType, DynamicImage, ExtendedColorType, ImageDecoder, ImageFormat, ImageReader, Limits,
};

use super::filter::Texture;

/// Widest and highest texture, in texels.
const SIDE_MAX: u32 = 65_535;

/// Why there is no texture.
#[derive(Debug)]
pub(crate) enum Refusal {
    /// There is something wrong with the image, or it is of a kind that is not read.
    Unusable(String),
    /// It would take so many bytes while it is decoded, which are not allowed.
    Memory(u64),
}

/// A decoded image.
pub(super) struct Decoded {
    pub(super) texture: Texture,
    /// Width and height in texels.
    pub(super) size: [u32; 2],
    /// Bits of a component in the file.
    pub(super) bits: u32,
    /// Whether colours are declared in another space than sRGB, as which they are taken.
    pub(super) has_other_profile: bool,
}

/// Decodes a PNG, JPEG or TIFF image within `allowed` bytes, those of `encoded` included.
///
/// Damaged images make decoders panic: a JPEG did, found by random changes.
pub(super) fn decode(encoded: &[u8], allowed: u64) -> Result<Decoded, Refusal> {
    std::panic::catch_unwind(|| decoded(encoded, allowed)).unwrap_or_else(|_| {
        Err(Refusal::Unusable("cannot be decoded: it is damaged; save it anew".to_owned()))
    })
}

fn decoded(encoded: &[u8], allowed: u64) -> Result<Decoded, Refusal> {
    let unusable = |what: &str| Refusal::Unusable(what.to_owned());
    let mut reader = ImageReader::new(Cursor::new(encoded))
        .with_guessed_format()
        .map_err(|error| Refusal::Unusable(error.to_string()))?;
    match reader.format() {
        Some(ImageFormat::Jpeg) if jpeg_components(encoded).is_some_and(|count| count > 3) => {
            return Err(unusable(
                "is a CMYK image, whose colours depend on a printer; convert it to RGB",
            ));
        }
        Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::Tiff) => {}
        Some(other) => {
            let what = format!("is of the format {other:?}; convert it to PNG, JPEG or TIFF");
            return Err(Refusal::Unusable(what));
        }
        None => return Err(unusable("is no PNG, JPEG or TIFF image; convert it to one of these")),
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(SIDE_MAX);
    limits.max_image_height = Some(SIDE_MAX);
    limits.max_alloc = Some(allowed);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(|error| refusal(&error, allowed))?;

    let size = <[u32; 2]>::from(decoder.dimensions());
    if size.contains(&0) || size.iter().any(|side| *side > SIDE_MAX) {
        let [width, height] = size;
        let what = format!(
            "has {width} × {height} texels, where 1 to {SIDE_MAX} in width and height are read; \
             scale it down"
        );
        return Err(Refusal::Unusable(what));
    }
    if matches!(decoder.original_color_type(), ExtendedColorType::Cmyk8 | ExtendedColorType::Cmyk16)
    {
        return Err(unusable(
            "is a CMYK image, whose colours depend on a printer; convert it to RGB",
        ));
    }
    let colour = decoder.color_type();
    if matches!(colour, ColorType::Rgb32F | ColorType::Rgba32F) {
        return Err(unusable(
            "holds floating-point light, not colours; convert it to 8 or 16 bits",
        ));
    }
    let [width, height] = size.map(u64::from);
    // JPEG is copied once more while it is decoded.
    let needed = decoder.total_bytes().saturating_add(2 * encoded.len() as u64);
    let needed = needed.saturating_add(Texture::bytes(width, height));
    if needed > allowed {
        return Err(Refusal::Memory(needed));
    }
    let profile = decoder.icc_profile().ok().flatten();
    let texels = if colour == ColorType::Rgb8 {
        let mut texels = vec![0; decoder.total_bytes() as usize];
        decoder.read_image(&mut texels).map_err(|error| refusal(&error, needed))?;
        texels
    } else {
        let image = DynamicImage::from_decoder(decoder).map_err(|error| refusal(&error, needed))?;
        image.into_rgb8().into_raw()
    };
    Ok(Decoded {
        texture: Texture::new(width as usize, height as usize, texels),
        size,
        bits: if colour.bytes_per_pixel() > colour.channel_count() { 16 } else { 8 },
        has_other_profile: profile.is_some_and(|profile| !names_srgb(&profile)),
    })
}

fn refusal(error: &image::ImageError, needed: u64) -> Refusal {
    use image::error::LimitErrorKind;
    match error {
        image::ImageError::Limits(limit)
            if matches!(limit.kind(), LimitErrorKind::InsufficientMemory) =>
        {
            // It asked for more than all of it.
            Refusal::Memory(needed.saturating_add(1))
        }
        image::ImageError::Limits(limit)
            if matches!(limit.kind(), LimitErrorKind::DimensionError) =>
        {
            Refusal::Unusable(format!(
                "has more than {SIDE_MAX} texels in width or height; scale it down"
            ))
        }
        other => Refusal::Unusable(format!("cannot be decoded: {other}")),
    }
}

/// Whether a colour profile is one of sRGB, by the name in it (as text of one or of two bytes).
fn names_srgb(profile: &[u8]) -> bool {
    let holds = |name: &[u8]| profile.windows(name.len()).any(|window| window == name);
    holds(b"sRGB") || holds(b"s\0R\0G\0B")
}

/// Components of a JPEG image, as its frame header says; 4 are CMYK.
fn jpeg_components(bytes: &[u8]) -> Option<u8> {
    let mut at = 2;
    loop {
        // Markers may be padded by any number of 0xff.
        while *bytes.get(at)? == 0xff {
            at += 1;
        }
        let marker = bytes[at];
        let length = usize::from(u16::from_be_bytes([*bytes.get(at + 1)?, *bytes.get(at + 2)?]));
        match marker {
            // Frames: all of 0xc0 to 0xcf but those for tables.
            0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => {
                return bytes.get(at + 8).copied();
            }
            0xda | 0xd9 => return None,
            _ => at += 1 + length,
        }
    }
}
