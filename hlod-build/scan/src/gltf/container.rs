//! The container of a glTF document and its JSON part.

use ::gltf::json;

use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::report::ScanReport;

/// Largest JSON part. Parsed it takes many times its size.
const JSON_BYTES_MAX: u64 = 512 * 1024 * 1024;

/// Required extensions that leave triangles as they are, or that are done here.
const EXTENSIONS_FINE: [&str; 7] = [
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_texture_basisu",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_animation_pointer",
    "KHR_xmp_json_ld",
];

/// Text of the JSON chunk, and begin and size of the binary chunk.
pub(super) type Container = (Vec<u8>, Option<(u64, u64)>);

/// Reads the chunks of a `.glb` file.
pub(super) fn read_container(
    input: &mut Input,
    report: &mut ScanReport,
) -> Result<Container, ScanError> {
    let [magic, version, length] = read_words(input)?;
    if magic != u32::from_le_bytes(*b"glTF") {
        let what = "a binary glTF file begins with `glTF`, this one does not";
        return Err(ScanError::malformed(input.at_byte(), what));
    }
    if version != 2 {
        return Err(ScanError::Unsupported {
            at: input.at_byte(),
            what: format!("glTF version {version}"),
            advice: "export as glTF 2.0",
        });
    }
    let file_bytes = input.file_bytes();
    if u64::from(length) > file_bytes {
        return Err(ScanError::CountTooLarge {
            at: input.at_byte(),
            what: "bytes".to_owned(),
            declared: length.into(),
            possible: file_bytes,
        });
    }
    if u64::from(length) < file_bytes {
        let surplus = file_bytes - u64::from(length);
        let warning = format!("{surplus} bytes after the end were not read");
        report.warnings.push(warning);
    }

    let [json_bytes, kind] = read_words(input)?;
    if kind != u32::from_le_bytes(*b"JSON") {
        let what = "the first chunk is not JSON";
        return Err(ScanError::malformed(input.at_byte(), what));
    }
    let text = read_text(input, Some(json_bytes.into()))?;
    if input.offset() >= u64::from(length) {
        return Ok((text, None));
    }
    let [bin_bytes, kind] = read_words(input)?;
    if kind != u32::from_le_bytes(*b"BIN\0") {
        return Ok((text, None));
    }
    if u64::from(bin_bytes) > input.remaining_bytes() {
        return Err(ScanError::CountTooLarge {
            at: input.at_byte(),
            what: "bytes of the binary chunk".to_owned(),
            declared: bin_bytes.into(),
            possible: input.remaining_bytes(),
        });
    }
    Ok((text, Some((input.offset(), bin_bytes.into()))))
}

fn read_words<const N: usize>(input: &mut Input) -> Result<[u32; N], ScanError> {
    let mut words = [0; N];
    for word in &mut words {
        *word = match input.take(4)? {
            Some(bytes) => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            None => {
                let what = "the chunks of a binary glTF file".to_owned();
                let at = input.at_byte();
                return Err(ScanError::Truncated { at, what });
            }
        };
    }
    Ok(words)
}

/// Reads `length` bytes, or the rest of the file.
pub(super) fn read_text(input: &mut Input, length: Option<u64>) -> Result<Vec<u8>, ScanError> {
    let possible = input.remaining_bytes();
    let length = length.unwrap_or(possible);
    if length > possible {
        return Err(ScanError::CountTooLarge {
            at: input.at_byte(),
            what: "bytes of JSON".to_owned(),
            declared: length,
            possible,
        });
    }
    if length > JSON_BYTES_MAX {
        return Err(ScanError::Unsupported {
            at: input.at_byte(),
            what: format!("a JSON part of {length} bytes"),
            advice: "export as .glb, whose data is not JSON",
        });
    }
    let mut text = Vec::with_capacity(length as usize);
    while (text.len() as u64) < length {
        let bytes = input.peek(1)?;
        let count = bytes.len().min(length as usize - text.len());
        if count == 0 {
            let what = "the JSON part".to_owned();
            let at = input.at_byte();
            return Err(ScanError::Truncated { at, what });
        }
        text.extend_from_slice(&bytes[..count]);
        input.consume(count);
    }
    Ok(text)
}

pub(super) fn parse(text: &[u8], input: &Input) -> Result<json::Root, ScanError> {
    let root = json::Root::from_slice(text).map_err(|error| {
        // In a .glb lines do not count from the begin of the file.
        let place = Place::Item(format!("JSON line {}", error.line()));
        let what = format!("the glTF document is not valid: {error}");
        ScanError::malformed(Spot::new(input.path(), place), what)
    })?;
    if !root.asset.version.starts_with("2.") {
        return Err(ScanError::Unsupported {
            at: Spot::new(input.path(), Place::Item("asset".to_owned())),
            what: format!("glTF version {}", root.asset.version),
            advice: "export as glTF 2.0",
        });
    }
    Ok(root)
}

pub(super) fn check_extensions(root: &json::Root, input: &Input) -> Result<(), ScanError> {
    let is_fine =
        |name: &String| name.starts_with("KHR_materials_") || EXTENSIONS_FINE.contains(&&**name);
    match root.extensions_required.iter().find(|name| !is_fine(name)) {
        None => Ok(()),
        Some(name) => Err(ScanError::Unsupported {
            at: Spot::new(input.path(), Place::Item("extensionsRequired".to_owned())),
            what: format!("the extension {name}, which this file requires,"),
            advice: "export without it",
        }),
    }
}
