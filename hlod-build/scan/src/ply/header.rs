//! The header of a PLY file: which elements follow, with which properties, encoded how.
//!
//! Based on: Greg Turk, *The PLY Polygon File Format*, 1994, and the type names with
//! sizes (`float32`) that came later.

use crate::ScanFormat;
use crate::error::ScanError;
use crate::input::Input;

/// Longest header. Real ones have a few hundred bytes; texts without an end do not
/// deserve to be searched for one.
const HEADER_BYTES_MAX: u64 = 1024 * 1024;

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl ScalarType {
    fn from_name(name: &str) -> Option<ScalarType> {
        Some(match name {
            "char" | "int8" => ScalarType::I8,
            "uchar" | "uint8" => ScalarType::U8,
            "short" | "int16" => ScalarType::I16,
            "ushort" | "uint16" => ScalarType::U16,
            "int" | "int32" => ScalarType::I32,
            "uint" | "uint32" => ScalarType::U32,
            "float" | "float32" => ScalarType::F32,
            "double" | "float64" => ScalarType::F64,
            _ => return None,
        })
    }

    /// Size in a binary file.
    pub(crate) fn bytes(self) -> usize {
        match self {
            ScalarType::I8 | ScalarType::U8 => 1,
            ScalarType::I16 | ScalarType::U16 => 2,
            ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
            ScalarType::F64 => 8,
        }
    }

    pub(crate) fn is_float(self) -> bool {
        matches!(self, ScalarType::F32 | ScalarType::F64)
    }
}

/// One number, or a list with its own length in front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PropertyType {
    Scalar(ScalarType),
    List { count: ScalarType, item: ScalarType },
}

#[derive(Clone, Debug)]
pub(crate) struct Property {
    pub(crate) name: String,
    pub(crate) of: PropertyType,
}

/// A table of `count` records, each with these properties in this order.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    pub(crate) name: String,
    pub(crate) count: u64,
    pub(crate) properties: Vec<Property>,
}

impl Element {
    /// Size of one record in a binary file, `None` if it has lists.
    pub(crate) fn record_bytes(&self) -> Option<u64> {
        let sizes = self.properties.iter().map(|property| match property.of {
            PropertyType::Scalar(scalar) => Some(scalar.bytes() as u64),
            PropertyType::List { .. } => None,
        });
        sizes.sum()
    }

    /// The least that one record needs: in a text a digit and a separator for each
    /// number, and a list may be empty, but it has a count.
    fn record_bytes_min(&self, is_text: bool) -> u64 {
        let sizes = self.properties.iter().map(|property| match property.of {
            _ if is_text => 2,
            PropertyType::Scalar(scalar) => scalar.bytes() as u64,
            PropertyType::List { count, .. } => count.bytes() as u64,
        });
        sizes.sum()
    }
}

/// Elements in file order, and the encoding of what follows.
#[derive(Clone, Debug)]
pub(crate) struct Header {
    pub(crate) format: ScanFormat,
    pub(crate) elements: Vec<Element>,
    /// Names in comments, as MeshLab writes them.
    pub(crate) texture_files: Vec<String>,
}

/// Reads the header; `input` then stands at the first byte of data.
pub(crate) fn read(input: &mut Input) -> Result<Header, ScanError> {
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut texture_files = Vec::new();
    let mut is_first = true;
    loop {
        let at = input.at_line();
        let malformed = |what: String| ScanError::malformed(at.clone(), what);
        if input.offset() > HEADER_BYTES_MAX {
            return Err(malformed("the PLY header has no `end_header`".to_owned()));
        }
        let Some(line) = input.line()? else {
            let what = "the PLY header".to_owned();
            return Err(ScanError::Truncated { at, what });
        };
        // Comments may be in any encoding; keywords and names are ASCII in practice.
        let line = String::from_utf8_lossy(line).into_owned();
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        if std::mem::take(&mut is_first) {
            if words != ["ply"] {
                return Err(malformed(
                    "a PLY file begins with the line `ply`, this one does not; \
                     check whether the extension is right"
                        .to_owned(),
                ));
            }
            continue;
        }
        match *words.as_slice() {
            ["comment", "TextureFile", first, ..] => {
                // Names may have spaces.
                let begin = line.find("TextureFile").map_or(0, |at| at + "TextureFile".len());
                let name = line.get(begin..).map_or(first, str::trim);
                texture_files.push(name.replace('\\', "/"));
            }
            [] | ["comment" | "obj_info", ..] => {}
            ["end_header"] => break,
            ["format", encoding, "1.0"] => {
                format = Some(match encoding {
                    "ascii" => ScanFormat::PlyAscii,
                    "binary_little_endian" => ScanFormat::PlyLittleEndian,
                    "binary_big_endian" => ScanFormat::PlyBigEndian,
                    _ => return Err(malformed(format!("unknown PLY encoding `{encoding}`"))),
                });
            }
            ["element", name, count] => {
                let count = count
                    .parse()
                    .map_err(|_| malformed(format!("`{count}` is not a count of `{name}`")))?;
                if elements.iter().any(|element| element.name == name) {
                    return Err(malformed(format!("element `{name}` is declared twice")));
                }
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", ref rest @ ..] => {
                let property = parse_property(rest)
                    .ok_or_else(|| malformed(format!("`{line}` declares no PLY property")))?;
                let Some(element) = elements.last_mut() else {
                    return Err(malformed("a property stands before any element".to_owned()));
                };
                let is_known = |known: &Property| known.name == property.name;
                if element.properties.iter().any(is_known) {
                    let what = format!("property `{}` is declared twice", property.name);
                    return Err(malformed(what));
                }
                element.properties.push(property);
            }
            _ => return Err(malformed(format!("`{line}` is no line of a PLY header"))),
        }
    }
    let Some(format) = format else {
        let what = "the PLY header has no `format` line";
        return Err(ScanError::malformed(input.at_line(), what));
    };
    let header = Header { format, elements, texture_files };
    check_counts(&header, input)?;
    Ok(header)
}

fn parse_property(words: &[&str]) -> Option<Property> {
    let (of, name) = match *words {
        ["list", count, item, name] => {
            let count = ScalarType::from_name(count).filter(|count| !count.is_float())?;
            let item = ScalarType::from_name(item)?;
            (PropertyType::List { count, item }, name)
        }
        [scalar, name] => (PropertyType::Scalar(ScalarType::from_name(scalar)?), name),
        _ => return None,
    };
    Some(Property { name: name.to_owned(), of })
}

/// Refuses counts that the rest of the file cannot hold.
fn check_counts(header: &Header, input: &Input) -> Result<(), ScanError> {
    let is_text = header.format == ScanFormat::PlyAscii;
    // The last number of a text needs no separator.
    let mut room_bytes = input.remaining_bytes() + u64::from(is_text);
    for element in &header.elements {
        let record_bytes = element.record_bytes_min(is_text);
        let possible = room_bytes.checked_div(record_bytes).unwrap_or(u64::MAX);
        if element.count > possible {
            return Err(ScanError::CountTooLarge {
                at: input.at_byte(),
                what: format!("records of `{}`", element.name),
                declared: element.count,
                possible,
            });
        }
        room_bytes -= element.count.saturating_mul(record_bytes);
    }
    Ok(())
}
