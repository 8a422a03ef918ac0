//! STL, binary and as text: a list of facets, three own vertices each.
//!
//! The format knows no shared vertices, so that the result is a triangle soup to be
//! welded by equal position. Facet normals are passed over: they are often zero, and
//! the corners say the same. Records are decoded here rather than by a library
//! because the ones at hand read everything at once and name no place in errors.

use glam::DVec3;

use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::report::ScanReport;
use crate::{BATCH_ITEMS_MAX, Batch, Opened, ReadBatches, TriangleBatch, VertexBatch};

/// Free text at the begin of a binary file.
const TITLE_BYTES: usize = 80;
/// Title and facet count.
const HEAD_BYTES: usize = TITLE_BYTES + 4;
/// Normal, three corners of three f32, and two bytes of no fixed meaning.
const FACET_BYTES: usize = 50;
/// Facets of one batch; each has three vertices.
const BATCH_FACETS_MAX: usize = BATCH_ITEMS_MAX / 3;

/// The facet count of a binary file, if `head` is long enough to have one.
pub(crate) fn count_of_head(head: &[u8]) -> Option<u32> {
    let count = head.get(TITLE_BYTES..HEAD_BYTES)?.try_into().ok()?;
    Some(u32::from_le_bytes(count))
}

/// Size of a binary file of `count` facets.
pub(crate) fn bytes_of_count(count: u32) -> u64 {
    HEAD_BYTES as u64 + FACET_BYTES as u64 * u64::from(count)
}

/// Opens a binary file and compares its facet count with its size.
pub(crate) fn open_binary(mut input: Input, report: &mut ScanReport) -> Result<Opened, ScanError> {
    let Some(count) = input.take(HEAD_BYTES)?.and_then(count_of_head) else {
        let at = Spot::new(input.path(), Place::Byte(input.file_bytes()));
        let what = "the head of a binary STL file".to_owned();
        return Err(ScanError::Truncated { at, what });
    };
    let possible = input.remaining_bytes() / FACET_BYTES as u64;
    if u64::from(count) > possible {
        return Err(ScanError::CountTooLarge {
            at: input.at_byte(),
            what: "facets".to_owned(),
            declared: count.into(),
            possible,
        });
    }
    let surplus = input.file_bytes() - bytes_of_count(count);
    if surplus > 0 {
        let warning = format!("{surplus} bytes after the last facet were not read");
        report.warnings.push(warning);
    }
    let facets = Facets::Binary { left: count };
    Ok(opened(input, facets, Some(count.into())))
}

/// Opens a text.
pub(crate) fn open_ascii(input: Input) -> Opened {
    opened(input, Facets::Ascii { inside: None }, None)
}

fn opened(input: Input, facets: Facets, faces: Option<u64>) -> Opened {
    Opened {
        // Degenerate facets are dropped together with their vertices.
        vertices: None,
        faces,
        has_normals: false,
        has_colours: false,
        is_triangle_soup: true,
        is_point_cloud: false,
        scalars: Vec::new(),
        body: Box::new(StlReader { input, facets, vertices: 0, pending: None }),
    }
}

struct StlReader {
    input: Input,
    facets: Facets,
    /// Vertices delivered.
    vertices: u32,
    /// Triangles of the vertex batch delivered last.
    pending: Option<TriangleBatch>,
}

/// Where the reader stands.
enum Facets {
    Binary {
        left: u32,
    },
    Ascii {
        /// Whether a `solid` is open; `None` before the first.
        inside: Option<bool>,
    },
}

impl ReadBatches for StlReader {
    fn next_batch(&mut self, report: &mut ScanReport) -> Result<Option<Batch>, ScanError> {
        if let Some(triangles) = self.pending.take() {
            return Ok(Some(Batch::Triangles(triangles)));
        }
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        while triangles.len() < BATCH_FACETS_MAX {
            let facet = match &mut self.facets {
                Facets::Binary { left } => binary_facet(&mut self.input, left, report)?,
                Facets::Ascii { inside } => ascii_facet(&mut self.input, inside, report)?,
            };
            let Some([a, b, c]) = facet else { break };
            report.faces_read += 1;
            // Welding by position would make two corners one.
            if a == b || b == c || c == a {
                report.degenerate_faces += 1;
                continue;
            }
            let first = self.vertices;
            let Some(next) = first.checked_add(3) else {
                return Err(ScanError::TooManyVertices {
                    at: self.input.at_byte(),
                    vertices: u64::from(first) + 3,
                });
            };
            positions.extend([a, b, c]);
            triangles.push([first, first + 1, first + 2]);
            self.vertices = next;
        }
        if triangles.is_empty() {
            return Ok(None);
        }
        self.pending = Some(TriangleBatch { triangles });
        Ok(Some(Batch::Vertices(VertexBatch { positions, ..VertexBatch::default() })))
    }

    fn bytes_read(&self) -> u64 {
        self.input.offset()
    }
}

fn binary_facet(
    input: &mut Input,
    left: &mut u32,
    report: &ScanReport,
) -> Result<Option<[DVec3; 3]>, ScanError> {
    if *left == 0 {
        return Ok(None);
    }
    let at = input.offset();
    let Some(record) = input.take(FACET_BYTES)? else {
        return Err(ScanError::Truncated {
            at: input.at_byte(),
            what: format!("facet {}", report.faces_read),
        });
    };
    // Twelve bytes of normal, then nine numbers.
    let mut numbers = record[12..48]
        .chunks_exact(4)
        .map(|bytes| f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])));
    let mut number = || numbers.next().unwrap_or(f64::NAN);
    let mut corners = [DVec3::ZERO; 3];
    for (corner, position) in corners.iter_mut().enumerate() {
        *position = DVec3::new(number(), number(), number());
        if !position.is_finite() {
            let place = Place::Byte(at + 12 + 12 * corner as u64);
            return Err(ScanError::NotFinite {
                at: Spot::new(input.path(), place),
                vertex: report.faces_read * 3 + corner as u64,
            });
        }
    }
    *left -= 1;
    Ok(Some(corners))
}

/// Reads up to the end of the next facet, or of the file.
fn ascii_facet(
    input: &mut Input,
    inside: &mut Option<bool>,
    report: &mut ScanReport,
) -> Result<Option<[DVec3; 3]>, ScanError> {
    loop {
        let keyword = input.word()?.map(<[u8]>::to_ascii_lowercase);
        match (keyword.as_deref(), *inside) {
            (None, _) => {
                if *inside != Some(false) {
                    let warning = "the text ends without `endsolid`; it may have been cut short";
                    report.warnings.push(warning.to_owned());
                }
                return Ok(None);
            }
            (Some(b"solid"), None | Some(false)) => {
                // The name may be any text, even none.
                input.line()?;
                *inside = Some(true);
            }
            (Some(b"endsolid"), Some(true)) => {
                input.line()?;
                *inside = Some(false);
            }
            (Some(b"facet"), Some(true)) => break,
            (Some(other), _) => {
                let expected = match inside {
                    Some(true) => "`facet` or `endsolid`",
                    _ => "`solid`",
                };
                let found = String::from_utf8_lossy(other);
                let what = format!("expected {expected}, found `{found}`");
                return Err(ScanError::malformed(input.at_line(), what));
            }
        }
    }
    expect(input, "normal", report)?;
    for _ in 0..3 {
        // Some writers put `nan` here; the normal is not used.
        next_word(input, report)?;
    }
    expect(input, "outer", report)?;
    expect(input, "loop", report)?;
    let mut corners = [DVec3::ZERO; 3];
    for (corner, position) in corners.iter_mut().enumerate() {
        expect(input, "vertex", report)?;
        *position =
            DVec3::new(number(input, report)?, number(input, report)?, number(input, report)?);
        if !position.is_finite() {
            return Err(ScanError::NotFinite {
                at: input.at_line(),
                vertex: report.faces_read * 3 + corner as u64,
            });
        }
    }
    expect(input, "endloop", report)?;
    expect(input, "endfacet", report)?;
    Ok(Some(corners))
}

fn next_word(input: &mut Input, report: &ScanReport) -> Result<String, ScanError> {
    match input.word()? {
        Some(word) => Ok(String::from_utf8_lossy(word).into_owned()),
        None => Err(ScanError::Truncated {
            at: input.at_line(),
            what: format!("facet {}", report.faces_read),
        }),
    }
}

fn expect(input: &mut Input, keyword: &str, report: &ScanReport) -> Result<(), ScanError> {
    let found = next_word(input, report)?;
    if found.eq_ignore_ascii_case(keyword) {
        return Ok(());
    }
    let what = format!("expected `{keyword}`, found `{found}`");
    Err(ScanError::malformed(input.at_line(), what))
}

fn number(input: &mut Input, report: &ScanReport) -> Result<f64, ScanError> {
    let word = next_word(input, report)?;
    word.parse()
        .map_err(|_| ScanError::malformed(input.at_line(), format!("`{word}` is not a number")))
}
