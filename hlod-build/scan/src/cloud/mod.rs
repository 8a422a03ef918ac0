//! Point clouds of other formats than PLY, read by libraries: LAS and LAZ (`las`), E57 (`e57`).
//!
//! Both libraries are asked for some points at a time, on a thread of their own: E57's lends its
//! readers, and a panic on a damaged file is an error here, not the program's end. Which are compiled
//! in is said by the features of the same names.

#[cfg(feature = "e57")]
mod e57;
#[cfg(feature = "las")]
mod las;

#[cfg(any(feature = "las", feature = "e57"))]
mod threaded;

use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::report::ScanReport;
use crate::texture::ColourSource;
use crate::{KEEP_MAX, Opened, ScanFormat};

/// Opens a cloud of a format told by its magic.
pub(crate) fn open(
    input: Input,
    format: ScanFormat,
    (colour, keep): (ColourSource, &[String]),
    report: &mut ScanReport,
) -> Result<Opened, ScanError> {
    let wanted = (colour, &keep[..keep.len().min(KEEP_MAX)]);
    if colour == ColourSource::Texture {
        return Err(ScanError::NoTexture { at: Spot::new(input.path(), Place::File) });
    }
    match format {
        #[cfg(feature = "las")]
        ScanFormat::Las => las::open(input.path(), input.file_bytes(), wanted, report),
        #[cfg(feature = "e57")]
        ScanFormat::E57 => e57::open(input.path(), input.file_bytes(), wanted, report),
        _ => {
            let _ = (report, wanted);
            Err(ScanError::Unsupported {
                at: Spot::new(input.path(), Place::File),
                what: format!("{format}, which this program was built without,"),
                advice: "build it with the feature of that name, or convert the cloud to PLY",
            })
        }
    }
}
