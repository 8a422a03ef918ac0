//! The bytes that a glTF document speaks of: the binary chunk, files, `data:` URIs.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use ::gltf::json;

use crate::error::{Place, ScanError, Spot};
use crate::sibling;

/// All buffers of a document, each opened when it is first needed.
pub(super) struct Buffers {
    /// The document's file.
    path: PathBuf,
    /// Begin and size of the binary chunk.
    chunk: Option<(u64, u64)>,
    sources: Vec<Option<Source>>,
    /// Replaced items that sparse accessors may still hold in memory: many accessors
    /// can name the same bytes, so that the file's size is no limit to their sum.
    pub(super) sparse_items_left: u64,
}

/// Some 160 MB; replacing a few items is what sparse accessors are for.
const SPARSE_ITEMS_MAX: u64 = 4 * 1024 * 1024;

enum Source {
    File { file: File, begin: u64 },
    Memory(Vec<u8>),
}

impl Buffers {
    pub(super) fn new(path: &Path, root: &json::Root, chunk: Option<(u64, u64)>) -> Buffers {
        Buffers {
            path: path.to_path_buf(),
            chunk,
            sources: root.buffers.iter().map(|_| None).collect(),
            sparse_items_left: SPARSE_ITEMS_MAX,
        }
    }

    /// The document's file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// The same, as a place for a message.
    pub(super) fn at_file(&self) -> Spot {
        Spot::new(&self.path, Place::File)
    }

    pub(super) fn at(&self, item: impl Into<String>) -> Spot {
        Spot::new(&self.path, Place::Item(item.into()))
    }

    /// Makes sure that buffer `index` is there and as long as it says; gives its
    /// length.
    pub(super) fn open(&mut self, root: &json::Root, index: usize) -> Result<u64, ScanError> {
        let at = self.at(format!("buffers[{index}]"));
        let Some(buffer) = root.buffers.get(index) else {
            return Err(ScanError::malformed(at, "there is no such buffer"));
        };
        let declared = buffer.byte_length.0;
        if let Some(Some(_)) = self.sources.get(index) {
            return Ok(declared);
        }
        let (source, available) = match (&buffer.uri, self.chunk) {
            (None, Some((begin, bytes))) if index == 0 => {
                let file = File::open(&self.path).map_err(|e| ScanError::from_io(at.clone(), e))?;
                (Source::File { file, begin }, bytes)
            }
            (None, _) => {
                let what = "the buffer has no data: neither a `uri` nor a binary chunk";
                return Err(ScanError::malformed(at, what));
            }
            (Some(uri), _) if uri.starts_with("data:") => {
                let data = decode_data_uri(uri).ok_or_else(|| {
                    ScanError::malformed(at.clone(), "the `data:` URI is not valid base64")
                })?;
                let bytes = data.len() as u64;
                (Source::Memory(data), bytes)
            }
            (Some(uri), _) => {
                let (file, bytes) = open_sibling(&self.path, uri, &at)?;
                (Source::File { file, begin: 0 }, bytes)
            }
        };
        if declared > available {
            return Err(ScanError::CountTooLarge {
                at,
                what: "buffer bytes".to_owned(),
                declared,
                possible: available,
            });
        }
        self.sources[index] = Some(source);
        Ok(declared)
    }

    /// The bytes of a view; `None` if they are more than `allowed`.
    pub(super) fn read_view(
        &mut self,
        root: &json::Root,
        index: usize,
        allowed: u64,
    ) -> Result<Option<Vec<u8>>, ScanError> {
        let at = self.at(format!("bufferViews[{index}]"));
        let Some(view) = root.buffer_views.get(index) else {
            return Err(ScanError::malformed(at, "there is no such view"));
        };
        let buffer = view.buffer.value();
        let buffer_bytes = self.open(root, buffer)?;
        let (begin, bytes) = (view.byte_offset.unwrap_or_default().0, view.byte_length.0);
        if begin.checked_add(bytes).is_none_or(|end| end > buffer_bytes) {
            let what = format!("it does not lie within buffers[{buffer}]");
            return Err(ScanError::malformed(at, what));
        }
        if bytes > allowed {
            return Ok(None);
        }
        let mut out = vec![0; bytes as usize];
        self.read(buffer, begin, &mut out)?;
        Ok(Some(out))
    }

    /// Fills `out` from byte `offset` of an open buffer.
    pub(super) fn read(
        &mut self,
        index: usize,
        offset: u64,
        out: &mut [u8],
    ) -> Result<(), ScanError> {
        let at = Spot::new(&self.path, Place::Item(format!("buffers[{index}]")));
        let truncated =
            || ScanError::Truncated { at: at.clone(), what: format!("buffers[{index}]") };
        match self.sources.get_mut(index) {
            Some(Some(Source::File { file, begin })) => {
                let read =
                    file.seek(SeekFrom::Start(*begin + offset)).and_then(|_| file.read_exact(out));
                match read {
                    Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => Err(truncated()),
                    other => other.map_err(|e| ScanError::from_io(at.clone(), e)),
                }
            }
            Some(Some(Source::Memory(data))) => {
                let begin = usize::try_from(offset).unwrap_or(usize::MAX);
                let end = begin.saturating_add(out.len());
                let bytes = data.get(begin..end).ok_or_else(truncated)?;
                out.copy_from_slice(bytes);
                Ok(())
            }
            _ => Err(truncated()),
        }
    }
}

/// Opens the file that `uri` names beside (or in a folder beside) the document.
fn open_sibling(document: &Path, uri: &str, at: &Spot) -> Result<(File, u64), ScanError> {
    let opened = match decode_percent(uri) {
        Some(name) => sibling::open(document, &name),
        None => Err("has a wrong % sequence in its name".into()),
    };
    opened.map_err(|what| ScanError::malformed(at.clone(), format!("buffer file `{uri}` {what}")))
}

/// Replaces %20 and the like. `None` if a sequence is cut short or no UTF-8 results.
pub(super) fn decode_percent(uri: &str) -> Option<String> {
    let mut decoded = Vec::with_capacity(uri.len());
    let mut bytes = uri.bytes();
    while let Some(byte) = bytes.next() {
        if byte == b'%' {
            let digit = |byte: u8| char::from(byte).to_digit(16);
            let high = bytes.next().and_then(digit)?;
            let low = bytes.next().and_then(digit)?;
            decoded.push((high * 16 + low) as u8);
        } else {
            decoded.push(byte);
        }
    }
    String::from_utf8(decoded).ok()
}

/// The content of a `data:…;base64,…` URI.
pub(super) fn decode_data_uri(uri: &str) -> Option<Vec<u8>> {
    let (head, text) = uri.split_once(',')?;
    head.ends_with(";base64").then_some(())?;
    let text = text.trim_end_matches('=').as_bytes();
    let mut decoded = Vec::with_capacity(text.len() / 4 * 3 + 2);
    for group in text.chunks(4) {
        // Up to four digits of six bits, left-aligned in 24 bits.
        let mut bits = 0u32;
        for (place, byte) in group.iter().enumerate() {
            let digit = match byte {
                b'A'..=b'Z' => byte - b'A',
                b'a'..=b'z' => byte - b'a' + 26,
                b'0'..=b'9' => byte - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                _ => return None,
            };
            bits |= u32::from(digit) << (18 - 6 * place);
        }
        let [_, bytes @ ..] = bits.to_be_bytes();
        // One digit alone holds no byte.
        let whole = (group.len() * 6) / 8;
        if whole == 0 {
            return None;
        }
        decoded.extend_from_slice(&bytes[..whole]);
    }
    Some(decoded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_every_length() {
        let decode = |text: &str| decode_data_uri(&format!("data:x/y;base64,{text}"));
        assert_eq!(decode("").as_deref(), Some(&b""[..]));
        assert_eq!(decode("TQ==").as_deref(), Some(&b"M"[..]));
        assert_eq!(decode("TWE=").as_deref(), Some(&b"Ma"[..]));
        assert_eq!(decode("TWFu").as_deref(), Some(&b"Man"[..]));
        assert_eq!(decode("TWFuTQ").as_deref(), Some(&b"ManM"[..]));
        assert_eq!(decode("T"), None);
        assert_eq!(decode("T$E="), None);
        assert_eq!(decode_data_uri("data:text/plain,hello"), None);
    }

    #[test]
    fn percent_sequences() {
        assert_eq!(decode_percent("a%20b%2Ebin").as_deref(), Some("a b.bin"));
        assert_eq!(decode_percent("a%2"), None);
        assert_eq!(decode_percent("%FF"), None);
    }
}
