//! Which format a file is in: told by its content first, by its extension second.

use crate::ScanFormat;
use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::stl;

/// How much of the file's begin is looked at.
const HEAD_BYTES: usize = 4096;

/// The format, by the first rule that fits. PLY's encoding is settled by its header;
/// here every PLY file counts as ASCII.
pub(crate) fn format_of(input: &mut Input) -> Result<ScanFormat, ScanError> {
    let at = Spot::new(input.path(), Place::File);
    let file_bytes = input.file_bytes();
    let extension = input
        .path()
        .extension()
        .map(|extension| extension.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default();
    let peeked = input.peek(HEAD_BYTES)?;
    let head = &peeked[..peeked.len().min(HEAD_BYTES)];

    let is_text = !head.contains(&0);
    let is_stl_size = stl::count_of_head(head)
        .is_some_and(|count| count > 0 && stl::bytes_of_count(count) == file_bytes);
    // STL's keywords may be in either case.
    let lower = head.to_ascii_lowercase();
    let is_solid = is_text && lower.trim_ascii_start().starts_with(b"solid");
    let contains = |word: &[u8]| lower.windows(word.len()).any(|window| window == word);

    // Magic. A binary STL may begin with "solid", but its size gives it away.
    if head.starts_with(b"ply\n") || head.starts_with(b"ply\r") {
        return Ok(ScanFormat::PlyAscii);
    }
    if head.starts_with(b"glTF") {
        return Ok(ScanFormat::Glb);
    }
    if head.starts_with(b"LASF") {
        return Ok(ScanFormat::Las);
    }
    if head.starts_with(b"ASTM-E57") {
        return Ok(ScanFormat::E57);
    }
    if is_stl_size {
        return Ok(ScanFormat::StlBinary);
    }
    if is_solid && (contains(b"facet") || contains(b"endsolid")) {
        return Ok(ScanFormat::StlAscii);
    }
    if is_text
        && head.trim_ascii_start().starts_with(b"{")
        && (extension == "gltf" || contains(b"\"asset\""))
    {
        return Ok(ScanFormat::Gltf);
    }

    // Extension: a wrong or missing magic is then told by the reader of that format.
    match extension.as_str() {
        "ply" => Ok(ScanFormat::PlyAscii),
        "glb" => Ok(ScanFormat::Glb),
        "gltf" => Ok(ScanFormat::Gltf),
        "obj" => Ok(ScanFormat::Obj),
        "las" | "laz" => Ok(ScanFormat::Las),
        "e57" => Ok(ScanFormat::E57),
        "ptx" | "pts" => Err(ScanError::Unsupported {
            at,
            what: format!(
                "{}, a text of points whose columns differ from writer to writer,",
                extension.to_uppercase()
            ),
            advice: "save it as E57 or PLY, in CloudCompare by File > Save",
        }),
        "stl" if is_solid => Ok(ScanFormat::StlAscii),
        "stl" => Ok(ScanFormat::StlBinary),
        // OBJ has no magic; take a text whose first statement is one of OBJ's.
        _ if is_text && begins_as_obj(head) => Ok(ScanFormat::Obj),
        _ => Err(ScanError::UnknownFormat { at }),
    }
}

fn begins_as_obj(head: &[u8]) -> bool {
    head.split(|byte| *byte == b'\n')
        .map(|line| line.trim_ascii())
        .find(|line| !line.is_empty() && !line.starts_with(b"#"))
        .and_then(|line| line.split(|byte| byte.is_ascii_whitespace()).next())
        .is_some_and(|word| matches!(word, b"v" | b"vn" | b"vt" | b"o" | b"g" | b"mtllib"))
}
