//! Image files, written row by row.

use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use tiff::encoder::{TiffEncoder, TiffKind};

use super::provenance::Provenance;
use super::sheet::{Drawn, Progress, Sheet};
use super::strips::Strips;
use crate::error::RenderError;
use crate::files::write_aside;
use crate::gpu::Gpu;
use crate::model::Model;

/// Files of more bytes of pixels are written as BigTIFF: offsets in classic ones have 32 bits.
const CLASSIC_TIFF_MAX: u64 = 3 << 30;
/// Compressed bytes of a PNG that are collected before they are written.
const CHUNK_BYTES: usize = 1 << 18;

/// A kind of image file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Portable Network Graphics (ISO/IEC 15948).
    Png,
    /// TIFF 6.0, and BigTIFF where that is too small; compressed by deflate.
    Tiff,
}

impl Format {
    /// By the end of a file's name; PNG where it has none.
    ///
    /// # Errors
    /// When it is another kind of file, with the reason.
    pub fn of(path: &Path) -> Result<Format, RenderError> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        let refuse = |why: &str| {
            Err(RenderError::Usage(format!("{}: {why}; try .png or .tif", path.display())))
        };
        match extension.as_deref() {
            None | Some("png") => Ok(Format::Png),
            Some("tif" | "tiff") => Ok(Format::Tiff),
            Some("jpg" | "jpeg" | "jfif") => refuse(
                "JPEG is not written: it changes pixels near edges, which a figure with a scale is to \
                 keep, and has no transparency",
            ),
            Some(_) => refuse("pictures are written as PNG or TIFF"),
        }
    }
}

/// Whether a picture may be written to a path, as far as can be known before it is drawn.
///
/// # Errors
/// When it is no PNG or TIFF, is a folder, or lies in none.
pub fn check_output(path: &Path) -> Result<Format, RenderError> {
    let format = Format::of(path)?;
    let refuse = |why: String| Err(RenderError::Usage(format!("{}: {why}", path.display())));
    if path.is_dir() {
        return refuse("it is a folder; name a file".into());
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    match folder {
        Some(folder) if !folder.is_dir() => {
            refuse(format!("there is no folder {}", folder.display()))
        }
        _ => Ok(format),
    }
}

/// Draws a page into a file, aside and then renamed; nothing is left behind where that fails. `dpi` is how
/// many pixels an inch of paper has, where that is known.
///
/// # Errors
/// When the page cannot be drawn or the file not be written.
pub fn save(
    sheet: &Sheet,
    gpu: &Gpu,
    models: &mut [Model],
    path: &Path,
    (provenance, dpi): (&Provenance, Option<f64>),
    progress: &mut Progress<'_>,
) -> Result<Drawn, RenderError> {
    let format = check_output(path)?;
    sheet.check()?;
    let page = Page { sheet, provenance, dpi, path };
    write_aside(path, |out| page.write(gpu, models, format, out, progress))
}

/// What is written where.
struct Page<'a> {
    sheet: &'a Sheet,
    provenance: &'a Provenance,
    dpi: Option<f64>,
    path: &'a Path,
}

impl Page<'_> {
    fn write(
        &self,
        gpu: &Gpu,
        models: &mut [Model],
        format: Format,
        out: &mut BufWriter<File>,
        progress: &mut Progress<'_>,
    ) -> Result<Drawn, RenderError> {
        let bytes = 4 * u64::from(self.sheet.width) * u64::from(self.sheet.height);
        match format {
            Format::Png => self.png(out, gpu, models, progress),
            Format::Tiff if bytes <= CLASSIC_TIFF_MAX => {
                let encoder = TiffEncoder::new(out).map_err(|e| self.tiff_error(&e))?;
                self.tiff(encoder, gpu, models, progress)
            }
            Format::Tiff => {
                let encoder = TiffEncoder::new_big(out).map_err(|e| self.tiff_error(&e))?;
                self.tiff(encoder, gpu, models, progress)
            }
        }
    }

    fn png(
        &self,
        out: &mut impl Write,
        gpu: &Gpu,
        models: &mut [Model],
        progress: &mut Progress<'_>,
    ) -> Result<Drawn, RenderError> {
        let error = |e: png::EncodingError| self.error(e.to_string());
        let mut encoder = png::Encoder::new(out, self.sheet.width, self.sheet.height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        if let Some(dpi) = self.dpi {
            let per_metre = (dpi / 0.0254).round() as u32;
            encoder.set_pixel_dims(Some(png::PixelDimensions {
                xppu: per_metre,
                yppu: per_metre,
                unit: png::Unit::Meter,
            }));
        }
        for (keyword, text) in self.provenance.texts() {
            encoder.add_itxt_chunk(keyword.to_owned(), text).map_err(error)?;
        }
        let mut writer = encoder.write_header().map_err(error)?;
        let mut rows = writer.stream_writer_with_size(CHUNK_BYTES).map_err(error)?;
        let mut take =
            |bytes: &[u8]| rows.write_all(bytes).map_err(RenderError::io(self.path, "write"));
        let drawn = self.sheet.draw(gpu, models, &mut take, progress)?;
        rows.finish().map_err(error)?;
        writer.finish().map_err(error)?;
        Ok(drawn)
    }

    fn tiff<W: Write + Seek, K: TiffKind>(
        &self,
        mut encoder: TiffEncoder<W, K>,
        gpu: &Gpu,
        models: &mut [Model],
        progress: &mut Progress<'_>,
    ) -> Result<Drawn, RenderError> {
        let error = |e: tiff::TiffError| self.tiff_error(&e);
        let (width, height) = (self.sheet.width, self.sheet.height);
        let mut strips = Strips::begin(&mut encoder, width, height).map_err(error)?;
        let mut take = |bytes: &[u8]| strips.take(bytes).map_err(error);
        let drawn = self.sheet.draw(gpu, models, &mut take, progress)?;
        strips.finish(self.dpi, &self.provenance.tiff_texts()).map_err(error)?;
        Ok(drawn)
    }

    fn tiff_error(&self, error: &tiff::TiffError) -> RenderError {
        self.error(error.to_string())
    }

    fn error(&self, why: String) -> RenderError {
        RenderError::Malformed { path: self.path.to_owned(), why: format!("cannot write: {why}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_what_their_names_say_or_refused() {
        let of = |name: &str| Format::of(Path::new(name));
        assert_eq!(of("a.png").unwrap(), Format::Png);
        assert_eq!(of("a").unwrap(), Format::Png);
        assert_eq!(of("a.b.TIF").unwrap(), Format::Tiff);
        let jpeg = of("a.JPG").unwrap_err();
        assert!(jpeg.is_usage() && jpeg.to_string().contains("JPEG"));
        assert!(of("a.webp").is_err());
        let folder = tempfile::tempdir().unwrap();
        assert!(check_output(&folder.path().join("a.png")).is_ok());
        assert!(check_output(&folder.path().join("none/a.png")).unwrap_err().is_usage());
        let named = folder.path().join("b.png");
        std::fs::create_dir(&named).unwrap();
        assert!(check_output(&named).is_err());
    }
}
