//! Pixels of a TIFF file, strip by strip. The `tiff` crate compresses only what it is given at once: here it
//! writes tags and directories, and strips are compressed before (TIFF 6.0, sections 7 and 14; Adobe
//! Photoshop TIFF technical notes, 2002, for deflate).

use std::io::{Seek, Write};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use tiff::TiffResult;
use tiff::encoder::{DirectoryEncoder, Rational, TiffEncoder, TiffKind};
use tiff::tags::{
    CompressionMethod, ExtraSamples, PhotometricInterpretation, Predictor, ResolutionUnit, Tag,
};

/// Rows of a strip: readers decode one at a time.
const STRIP_ROWS: u32 = 64;

/// An image of eight bits for each of red, green, blue and alpha, which is not multiplied in.
pub(super) struct Strips<'a, W: Write + Seek, K: TiffKind> {
    directory: DirectoryEncoder<'a, W, K>,
    width: u32,
    height: u32,
    /// Rows that are not a strip yet.
    pending: Vec<u8>,
    offsets: Vec<K::OffsetType>,
    lengths: Vec<K::OffsetType>,
}

impl<'a, W: Write + Seek, K: TiffKind> Strips<'a, W, K> {
    pub(super) fn begin(
        encoder: &'a mut TiffEncoder<W, K>,
        width: u32,
        height: u32,
    ) -> TiffResult<Strips<'a, W, K>> {
        let directory = encoder.image_directory()?;
        let (offsets, lengths) = (Vec::new(), Vec::new());
        Ok(Strips { directory, width, height, pending: Vec::new(), offsets, lengths })
    }

    fn row_bytes(&self) -> usize {
        4 * self.width as usize
    }

    /// Adds rows.
    pub(super) fn take(&mut self, rows: &[u8]) -> TiffResult<()> {
        self.pending.extend_from_slice(rows);
        let strip = self.row_bytes() * STRIP_ROWS as usize;
        let mut done = 0;
        while self.pending.len() - done >= strip {
            self.write_strip(done..done + strip)?;
            done += strip;
        }
        self.pending.drain(..done);
        Ok(())
    }

    fn write_strip(&mut self, range: std::ops::Range<usize>) -> TiffResult<()> {
        let row_bytes = self.row_bytes();
        let mut differences = self.pending[range].to_vec();
        differences.chunks_exact_mut(row_bytes).for_each(difference);
        let mut deflate = ZlibEncoder::new(Vec::new(), Compression::default());
        deflate.write_all(&differences)?;
        let bytes = deflate.finish()?;
        let offset = self.directory.write_data(&bytes[..])?;
        self.offsets.push(K::convert_offset(offset)?);
        self.lengths.push(K::convert_offset(bytes.len() as u64)?);
        Ok(())
    }

    /// Writes the last rows and all that is to be known; `dpi` is how many pixels an inch has.
    pub(super) fn finish(mut self, dpi: Option<f64>, texts: &[(Tag, String)]) -> TiffResult<()> {
        if !self.pending.is_empty() {
            self.write_strip(0..self.pending.len())?;
        }
        let d = &mut self.directory;
        d.write_tag(Tag::ImageWidth, self.width)?;
        d.write_tag(Tag::ImageLength, self.height)?;
        d.write_tag(Tag::BitsPerSample, &[8u16; 4][..])?;
        d.write_tag(Tag::SamplesPerPixel, 4u16)?;
        d.write_tag(Tag::Compression, CompressionMethod::Deflate.to_u16())?;
        d.write_tag(Tag::Predictor, Predictor::Horizontal.to_u16())?;
        d.write_tag(Tag::PhotometricInterpretation, PhotometricInterpretation::RGB.to_u16())?;
        d.write_tag(Tag::ExtraSamples, &[ExtraSamples::UnassociatedAlpha.to_u16()][..])?;
        d.write_tag(Tag::RowsPerStrip, STRIP_ROWS.min(self.height))?;
        d.write_tag(Tag::StripOffsets, K::convert_slice(&self.offsets))?;
        d.write_tag(Tag::StripByteCounts, K::convert_slice(&self.lengths))?;
        if let Some(dpi) = dpi {
            let resolution = Rational { n: (dpi * 1000.0).round() as u32, d: 1000 };
            d.write_tag(Tag::XResolution, resolution.clone())?;
            d.write_tag(Tag::YResolution, resolution)?;
            d.write_tag(Tag::ResolutionUnit, ResolutionUnit::Inch.to_u16())?;
        }
        for (tag, text) in texts {
            d.write_tag(*tag, text.as_str())?;
        }
        self.directory.finish()
    }
}

/// Replaces each pixel of a row by its difference to the one before, which compresses better.
fn difference(row: &mut [u8]) {
    for i in (4..row.len()).rev() {
        row[i] = row[i].wrapping_sub(row[i - 4]);
    }
}
