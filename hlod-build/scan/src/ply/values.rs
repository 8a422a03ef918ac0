//! Numbers of a PLY file, one after the other, whatever their encoding.
//!
//! Every type of the format fits a `f64` exactly, so that one number type serves all.
//! A text number is first rounded to the type that its property declares: the same
//! scan then reads the same from all three encodings.

use super::header::{PropertyType, ScalarType};
use crate::ScanFormat;
use crate::error::{ScanError, Spot};
use crate::input::Input;

/// Where the data of a PLY file is read from.
pub(crate) struct Values {
    pub(crate) input: Input,
    format: ScanFormat,
    /// What is being read, for messages: number and element name.
    record: u64,
    element: String,
}

impl Values {
    pub(crate) fn new(input: Input, format: ScanFormat) -> Values {
        Values { input, format, record: 0, element: String::new() }
    }

    pub(crate) fn is_text(&self) -> bool {
        self.format == ScanFormat::PlyAscii
    }

    pub(crate) fn is_big_endian(&self) -> bool {
        self.format == ScanFormat::PlyBigEndian
    }

    /// Says which element is read next, for messages.
    pub(crate) fn begin_element(&mut self, name: &str) {
        name.clone_into(&mut self.element);
    }

    /// Says which record is read next, for messages.
    pub(crate) fn begin_record(&mut self, record: u64) {
        self.record = record;
    }

    /// The current line or byte.
    pub(crate) fn at(&self) -> Spot {
        if self.is_text() { self.input.at_line() } else { self.input.at_byte() }
    }

    #[cold]
    pub(crate) fn truncated(&self) -> ScanError {
        ScanError::Truncated {
            at: self.at(),
            what: format!("record {} of `{}`", self.record, self.element),
        }
    }

    #[cold]
    pub(crate) fn malformed(&self, what: &str) -> ScanError {
        let (record, element) = (self.record, &self.element);
        ScanError::malformed(self.at(), format!("record {record} of `{element}`: {what}"))
    }

    /// The next number.
    pub(crate) fn scalar(&mut self, scalar: ScalarType) -> Result<f64, ScanError> {
        if self.is_text() {
            return self.text_scalar(scalar);
        }
        let is_big_endian = self.is_big_endian();
        match self.input.take(scalar.bytes())? {
            Some(bytes) => Ok(decode(scalar, bytes, is_big_endian)),
            None => Err(self.truncated()),
        }
    }

    fn text_scalar(&mut self, scalar: ScalarType) -> Result<f64, ScanError> {
        let Some(word) = self.input.word()? else {
            return Err(self.truncated());
        };
        if let Some(value) = parse(scalar, word) {
            return Ok(value);
        }
        let what = format!("`{}` is not a number", String::from_utf8_lossy(word));
        Err(self.malformed(&what))
    }

    /// Passes over one number.
    fn skip_scalars(&mut self, scalar: ScalarType, count: u64) -> Result<(), ScanError> {
        if self.is_text() {
            for _ in 0..count {
                if self.input.word()?.is_none() {
                    return Err(self.truncated());
                }
            }
            return Ok(());
        }
        let bytes = count.saturating_mul(scalar.bytes() as u64);
        if self.input.skip(bytes)? { Ok(()) } else { Err(self.truncated()) }
    }

    /// Passes over one property.
    pub(crate) fn skip(&mut self, property: PropertyType) -> Result<(), ScanError> {
        match property {
            PropertyType::Scalar(scalar) => self.skip_scalars(scalar, 1),
            PropertyType::List { count, item } => {
                let length = self.list_length(count, item)?;
                self.skip_scalars(item, length)
            }
        }
    }

    /// The length of a list, compared with what the file can still hold.
    pub(crate) fn list_length(
        &mut self,
        count: ScalarType,
        item: ScalarType,
    ) -> Result<u64, ScanError> {
        let length = self.scalar(count)?;
        if length < 0.0 || length.fract() != 0.0 {
            return Err(self.malformed(&format!("a list cannot have {length} entries")));
        }
        let length = length as u64;
        let (item_bytes, spare_bytes) = match self.is_text() {
            true => (2, 1),
            false => (item.bytes() as u64, 0),
        };
        let possible = (self.input.remaining_bytes() + spare_bytes) / item_bytes;
        if length > possible {
            return Err(ScanError::CountTooLarge {
                at: self.at(),
                what: format!("list entries in record {} of `{}`", self.record, self.element),
                declared: length,
                possible,
            });
        }
        Ok(length)
    }
}

/// A number from the bytes of a binary file; `bytes` has the type's size.
#[inline]
pub(crate) fn decode(scalar: ScalarType, bytes: &[u8], is_big_endian: bool) -> f64 {
    match scalar {
        ScalarType::I8 => f64::from(i8::from_le_bytes(ordered(bytes, is_big_endian))),
        ScalarType::U8 => f64::from(u8::from_le_bytes(ordered(bytes, is_big_endian))),
        ScalarType::I16 => f64::from(i16::from_le_bytes(ordered(bytes, is_big_endian))),
        ScalarType::U16 => f64::from(u16::from_le_bytes(ordered(bytes, is_big_endian))),
        ScalarType::I32 => f64::from(i32::from_le_bytes(ordered(bytes, is_big_endian))),
        ScalarType::U32 => f64::from(u32::from_le_bytes(ordered(bytes, is_big_endian))),
        ScalarType::F32 => f64::from(f32::from_le_bytes(ordered(bytes, is_big_endian))),
        ScalarType::F64 => f64::from_le_bytes(ordered(bytes, is_big_endian)),
    }
}

/// The first `N` bytes, least significant first.
#[inline]
fn ordered<const N: usize>(bytes: &[u8], is_big_endian: bool) -> [u8; N] {
    debug_assert_eq!(bytes.len(), N);
    let mut ordered = bytes.first_chunk().copied().unwrap_or([0; N]);
    if is_big_endian {
        ordered.reverse();
    }
    ordered
}

/// A number from a word of a text.
fn parse(scalar: ScalarType, word: &[u8]) -> Option<f64> {
    match scalar {
        ScalarType::F32 => std::str::from_utf8(word).ok()?.parse::<f32>().ok().map(f64::from),
        ScalarType::F64 => std::str::from_utf8(word).ok()?.parse().ok(),
        // Some writers give whole numbers a decimal point.
        _ => parse_digits(word).or_else(|| std::str::from_utf8(word).ok()?.parse().ok()),
    }
}

/// A plain whole number of up to nine digits, the usual index.
fn parse_digits(word: &[u8]) -> Option<f64> {
    if word.is_empty() || word.len() > 9 {
        return None;
    }
    let mut value = 0u32;
    for byte in word {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            return None;
        }
        value = value * 10 + u32::from(digit);
    }
    Some(f64::from(value))
}
