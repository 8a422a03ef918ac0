//! Lays the file out and writes it, page by page, from what the steps before have left.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use hlod_compress::{CellKey, FileWriter, FormatError, Header, Metadata, RepresentationKind};

use super::nodes::{Names, read_records};
use super::work_folder::WorkFolder;
use crate::error::BuildError;
use crate::oddities::Oddities;
use crate::output::Aside;
use crate::progress::{Progress, Unit};

/// Writes `output`, which takes its name only when it is on disk. Gives its header and what is odd
/// about the scan.
pub(crate) fn assemble(
    folder: &WorkFolder,
    parts: &[CellKey],
    (header, metadata): (Header, Option<&Metadata>),
    (output, force): (&Path, bool),
    progress: &dyn Progress,
) -> Result<(Header, Oddities), BuildError> {
    let mut records = Vec::new();
    let mut oddities = Oddities::default();
    // Where each page is: which part, its place there.
    let mut places: HashMap<(CellKey, RepresentationKind), (usize, u64, usize)> = HashMap::new();
    for (part, &cell) in parts.iter().enumerate() {
        let (of_part, odd) = read_records(&folder.file(&Names::of(cell).nodes))?;
        oddities = oddities.plus(odd);
        for record in of_part {
            for r in &record.representations {
                let place = (part, r.page.offset, r.page.page_bytes as usize);
                places.insert((record.cell, r.kind), place);
            }
            records.push(record);
        }
    }
    let writer = FileWriter::new(header, records, metadata).map_err(BuildError::format(output))?;
    progress.begin("write", writer.header().file_bytes, Unit::Bytes);
    let aside = Aside::create(output)?;
    let mut out = BufWriter::with_capacity(1 << 20, aside.file());
    let mut open: Option<(usize, File)> = None;
    let page = |cell: CellKey, kind| -> Result<Vec<u8>, PageError> {
        let Some(&(part, offset, page_bytes)) = places.get(&(cell, kind)) else {
            return Ok(Vec::new());
        };
        let path = folder.file(&Names::of(parts[part]).pages);
        let mut file = match open.take() {
            Some((of, file)) if of == part => file,
            _ => File::open(&path).map_err(BuildError::io(&path, "open"))?,
        };
        let mut bytes = vec![0; page_bytes];
        file.seek(SeekFrom::Start(offset))
            .and_then(|_| file.read_exact(&mut bytes))
            .map_err(BuildError::io(&path, "read"))?;
        open = Some((part, file));
        progress.advance(bytes.len() as u64);
        Ok(bytes)
    };
    writer.write(&mut out, page).map_err(|error| match error {
        PageError::Format(FormatError::Io(error)) => BuildError::io(output, "write")(error),
        PageError::Format(error) => BuildError::format(output)(error),
        PageError::Build(error) => error,
    })?;
    out.flush().map_err(BuildError::io(output, "write"))?;
    drop(out);
    aside.commit(output, force)?;
    progress.end();
    Ok((writer.header().clone(), oddities))
}

/// What can go wrong while pages are copied: with the output, or with what they come from.
enum PageError {
    Format(FormatError),
    Build(BuildError),
}

impl From<FormatError> for PageError {
    fn from(error: FormatError) -> PageError {
        PageError::Format(error)
    }
}

impl From<BuildError> for PageError {
    fn from(error: BuildError) -> PageError {
        PageError::Build(error)
    }
}
