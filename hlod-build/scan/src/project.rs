//! What is read as one model: scans, each where it stands, and MeshLab projects of such.
//!
//! A project (`.mlp`, XML) names meshes beside it and their matrices. Meshes that are hidden in it are
//! left out, which is remarked upon: hiding is how MeshLab's users put aside what they do not want.

use std::path::{Path, PathBuf};

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use crate::error::{Place, ScanError, Spot};
use crate::sibling;
use crate::transform::{Transform, read_text};

/// Largest project and most meshes of it.
const PROJECT_BYTES_MAX: u64 = 16 << 20;
const MESHES_MAX: usize = 65_536;

/// A scan and where it stands.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PlacedScan {
    /// The file.
    pub path: PathBuf,
    /// Into the model's coordinates; `None` where they are the scan's own.
    pub transform: Option<Transform>,
    /// What is to be said of the project that names it.
    pub remarks: Vec<String>,
}

/// Scans of `paths`, with the meshes of MeshLab projects in the place of these. `transforms` are empty,
/// or one for each path.
///
/// # Errors
/// If there are as many transforms as paths neither, nor none; if a project cannot be read, is not
/// well-formed, names what is not in its folder, or has no mesh that is shown; and if one is given a
/// transform besides its own.
pub fn place_scans(
    paths: &[PathBuf],
    transforms: &[Option<Transform>],
) -> Result<Vec<PlacedScan>, ScanError> {
    if !transforms.is_empty() && transforms.len() != paths.len() {
        let at = Spot::new(paths.first().map_or(Path::new(""), |path| path), Place::File);
        return Err(ScanError::Transforms {
            at,
            transforms: transforms.len(),
            inputs: paths.len(),
        });
    }
    let mut scans = Vec::new();
    for (i, path) in paths.iter().enumerate() {
        let transform = transforms.get(i).copied().flatten();
        if !is_project(path) {
            scans.push(PlacedScan { path: path.clone(), transform, remarks: Vec::new() });
            continue;
        }
        if transform.is_some() {
            return Err(ScanError::Unsupported {
                at: Spot::new(path, Place::File),
                what: "a transform of a whole MeshLab project".into(),
                advice: "move its meshes in MeshLab, or name them with a transform each",
            });
        }
        scans.extend(read_project(path)?);
    }
    Ok(scans)
}

/// Whether a file is one by its name: as text it has no magic.
fn is_project(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mlp"))
}

/// A mesh being read.
struct Mesh {
    name: String,
    is_visible: bool,
    matrix: Option<String>,
}

fn read_project(path: &Path) -> Result<Vec<PlacedScan>, ScanError> {
    let at = Spot::new(path, Place::File);
    let malformed = |what: String| ScanError::malformed(at.clone(), what);
    let text = read_text(path, PROJECT_BYTES_MAX)?;
    let mut scans = Vec::new();
    let mut hidden = Vec::new();
    for mesh in read_meshes(&text).map_err(malformed)? {
        if !mesh.is_visible {
            hidden.push(format!("mesh `{}` is hidden in the project and left out", mesh.name));
            continue;
        }
        let name = mesh.name.replace('\\', "/");
        let found = sibling::find(path, &name)
            .map_err(|what| malformed(format!("mesh `{}` {what}", mesh.name)))?;
        let transform = mesh
            .matrix
            .map(|text| Transform::parse(&text))
            .transpose()
            .map_err(|what| malformed(format!("the matrix of mesh `{}` {what}", mesh.name)))?;
        scans.push(PlacedScan { path: found, transform, remarks: Vec::new() });
    }
    match scans.first_mut() {
        Some(first) => first.remarks = hidden,
        None => return Err(malformed("the project shows no mesh".into())),
    }
    Ok(scans)
}

fn read_meshes(text: &str) -> Result<Vec<Mesh>, String> {
    let mut reader = Reader::from_str(text);
    let mut meshes: Vec<Mesh> = Vec::new();
    let (mut in_mesh, mut in_matrix, mut is_project) = (false, false, false);
    loop {
        let event = reader.read_event().map_err(|error| {
            format!("is not well-formed at byte {}: {error}", reader.error_position())
        })?;
        match event {
            Event::Eof => break,
            Event::Start(start) | Event::Empty(start)
                if start.name().as_ref() == b"MeshLabProject" =>
            {
                is_project = true;
            }
            Event::Empty(start) if start.name().as_ref() == b"MLMesh" => {
                meshes.push(read_mesh(&start)?);
            }
            Event::Start(start) if start.name().as_ref() == b"MLMesh" => {
                meshes.push(read_mesh(&start)?);
                in_mesh = true;
            }
            Event::End(end) if end.name().as_ref() == b"MLMesh" => in_mesh = false,
            Event::Start(start) if start.name().as_ref() == b"MLMatrix44" => {
                in_matrix = in_mesh;
                // Even an empty one is one.
                if let Some(mesh) = meshes.last_mut().filter(|_| in_matrix) {
                    mesh.matrix = Some(String::new());
                }
            }
            Event::End(end) if end.name().as_ref() == b"MLMatrix44" => in_matrix = false,
            Event::Text(text) if in_matrix => {
                let text = text.decode().map_err(|error| error.to_string())?;
                let matrix = meshes.last_mut().and_then(|mesh| mesh.matrix.as_mut());
                matrix.into_iter().for_each(|matrix| matrix.push_str(&text));
            }
            _ => {}
        }
        if meshes.len() > MESHES_MAX {
            return Err(format!("has more than {MESHES_MAX} meshes"));
        }
    }
    if !is_project {
        return Err("is no MeshLab project (a text with MeshLabProject in it)".into());
    }
    Ok(meshes)
}

fn read_mesh(start: &BytesStart<'_>) -> Result<Mesh, String> {
    let mut mesh = Mesh { name: String::new(), is_visible: true, matrix: None };
    for attribute in start.attributes() {
        let attribute = attribute.map_err(|error| error.to_string())?;
        let value = attribute
            .normalized_value(XmlVersion::Implicit1_0)
            .map_err(|error| error.to_string())?;
        match attribute.key.as_ref() {
            b"filename" => mesh.name = value.into_owned(),
            b"visible" => mesh.is_visible = !matches!(&*value, "0" | "false"),
            _ => {}
        }
    }
    if mesh.name.is_empty() {
        return Err("has a mesh without a file name; save the meshes first".into());
    }
    Ok(mesh)
}
