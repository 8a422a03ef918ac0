//! As binary glTF 2.0 (Khronos), for programs and web pages that show models.
//!
//! glTF is in metres, with +y up and +z to the front, and its positions are `f32`. Vertices therefore stay in
//! the scan's unit and axes, relative to a place near their middle that `f32` holds exactly, and two nodes
//! above the mesh bring them to where they are: the outer one turns and scales, the inner one moves. What
//! rounding moves is reported. glTF has no number for "no value", so that kept numbers are not written.

use std::borrow::Cow;
use std::io::BufWriter;
use std::path::Path;

use glam::DVec3;
use gltf::binary::{Glb, Header as GlbHeader};
use hlod_compress::srgb::linear_from_srgb;
use hlod_compress::{Header, Mesh, Unit};
use serde_json::{Value, json};

use super::Exported;
use crate::error::BuildError;
use crate::output::Aside;

/// glTF's numbers for types of components, targets of buffers and modes of primitives.
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;
const ARRAY: u32 = 34962;
const INDICES: u32 = 34963;
const POINTS: u32 = 0;
const TRIANGLES: u32 = 4;

/// The document beside the binary part may take this much; lengths are `u32`.
const JSON_BYTES_MAX: u64 = 1 << 20;

/// Bytes of a vertex: position and normal, and a colour.
const VERTEX_BYTES: u64 = 24;
const COLOUR_BYTES: u64 = 8;

/// Writes the file. Gives how far rounding to `f32` moved a vertex at most, in the scan's unit.
pub(super) fn write(
    exported: &Exported,
    (output, force): (&Path, bool),
) -> Result<f64, BuildError> {
    let mesh = &exported.mesh;
    check_size(mesh, output)?;
    let mut binary = Binary::default();
    let centre = middle(exported);
    let (attributes, rounding) = vertices(exported, centre, &mut binary);
    let mut primitives = Vec::new();
    if !mesh.triangles.is_empty() {
        let indices = binary.indices(mesh.triangles.as_flattened());
        primitives
            .push(json!({ "attributes": attributes, "indices": indices, "mode": TRIANGLES, "material": 0 }));
    }
    let single = single_points(mesh);
    if !single.is_empty() {
        let indices = binary.indices(&single);
        primitives.push(
            json!({ "attributes": attributes, "indices": indices, "mode": POINTS, "material": 0 }),
        );
    }
    let document = document(exported, centre, &primitives, &binary);
    let json = document.to_string().into_bytes();
    // The writer counts: twelve bytes of the file's head, eight before each part.
    let length = 12 + 8 + json.len().next_multiple_of(4) + 8 + binary.bytes.len();
    let length = u32::try_from(length).map_err(|_| too_large(output, length as u64))?;
    let glb = Glb {
        header: GlbHeader { magic: *b"glTF", version: 2, length },
        json: Cow::Owned(json),
        bin: Some(Cow::Owned(binary.bytes)),
    };
    let aside = Aside::create(output)?;
    let mut out = BufWriter::with_capacity(1 << 20, aside.file());
    let failed = |e: gltf::Error| BuildError::io(output, "write")(std::io::Error::other(e));
    glb.to_writer(&mut out).map_err(failed)?;
    out.into_inner().map_err(|e| BuildError::io(output, "write")(e.into_error()))?;
    aside.commit(output, force)?;
    Ok(rounding)
}

fn check_size(mesh: &Mesh, output: &Path) -> Result<(), BuildError> {
    let colour = if mesh.has_colours() { COLOUR_BYTES } else { 0 };
    let vertices = mesh.positions.len() as u64 * (VERTEX_BYTES + colour);
    // A vertex without a triangle takes an index of its own.
    let indices = 4 * (3 * mesh.triangles.len() + mesh.positions.len()) as u64;
    let bytes = vertices + indices + JSON_BYTES_MAX;
    if bytes > u64::from(u32::MAX) { Err(too_large(output, bytes)) } else { Ok(()) }
}

fn too_large(output: &Path, bytes: u64) -> BuildError {
    BuildError::Usage(format!(
        "{}: would be {:.1} GB, and GLB files end at 4.3 GB; export a coarser level (--error, \
         --max-triangles) or PLY",
        output.display(),
        bytes as f64 * 1e-9
    ))
}

/// Accessors, views and the bytes that they lie in.
#[derive(Default)]
struct Binary {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Binary {
    /// Appends one array; gives its accessor's number. Every component type here keeps the
    /// next array aligned to four bytes.
    fn push(&mut self, bytes: &[u8], target: u32, mut accessor: Value) -> usize {
        self.views.push(json!({
            "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len(), "target": target
        }));
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.bytes.extend_from_slice(bytes);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn indices(&mut self, indices: &[u32]) -> usize {
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let accessor = json!({ "componentType": U32, "count": indices.len(), "type": "SCALAR" });
        self.push(&bytes, INDICES, accessor)
    }
}

/// A place near the middle of all vertices, in source coordinates, that is the same in `f32`.
fn middle(exported: &Exported) -> DVec3 {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for position in &exported.mesh.positions {
        let p = DVec3::from_array(exported.header.lattice.position(*position));
        (low, high) = (low.min(p), high.max(p));
    }
    if low.is_finite() { ((low + high) / 2.0).as_vec3().as_dvec3() } else { DVec3::ZERO }
}

/// Appends what vertices have; gives glTF's names for it, and what rounding moved.
fn vertices(exported: &Exported, centre: DVec3, binary: &mut Binary) -> (Value, f64) {
    let Exported { mesh, header, .. } = exported;
    let count = mesh.positions.len();
    let (mut low, mut high) = (glam::Vec3::INFINITY, glam::Vec3::NEG_INFINITY);
    let mut rounding = 0.0f64;
    let mut bytes = Vec::with_capacity(count * 12);
    for position in &mesh.positions {
        let exact = DVec3::from_array(header.lattice.position(*position)) - centre;
        let rounded = exact.as_vec3();
        rounding = rounding.max(rounded.as_dvec3().distance(exact));
        (low, high) = (low.min(rounded), high.max(rounded));
        bytes.extend(rounded.to_array().iter().flat_map(|x| x.to_le_bytes()));
    }
    let accessor = json!({
        "componentType": F32, "count": count, "type": "VEC3", "min": low.to_array(), "max": high.to_array()
    });
    let mut attributes = json!({ "POSITION": binary.push(&bytes, ARRAY, accessor) });

    let normals = mesh.normals.iter().flat_map(|n| n.decode()).flat_map(f32::to_le_bytes);
    let accessor = json!({ "componentType": F32, "count": count, "type": "VEC3" });
    attributes["NORMAL"] = json!(binary.push(&normals.collect::<Vec<u8>>(), ARRAY, accessor));

    if mesh.has_colours() {
        // Colours of vertices are linear in glTF; 16 bits tell all 256 steps of sRGB apart.
        let code = |linear: f32| (linear * f32::from(u16::MAX)).round() as u16;
        let rgba = |[r, g, b, a]: &[u8; 4]| {
            [
                code(linear_from_srgb(*r)),
                code(linear_from_srgb(*g)),
                code(linear_from_srgb(*b)),
                257 * u16::from(*a),
            ]
        };
        let colours = mesh.colours.iter().flat_map(rgba).flat_map(u16::to_le_bytes);
        let accessor =
            json!({ "componentType": U16, "normalized": true, "count": count, "type": "VEC4" });
        attributes["COLOR_0"] = json!(binary.push(&colours.collect::<Vec<u8>>(), ARRAY, accessor));
    }
    (attributes, rounding)
}

/// Vertices that no triangle has: points.
fn single_points(mesh: &Mesh) -> Vec<u32> {
    let mut is_single = vec![true; mesh.positions.len()];
    for &vertex in mesh.triangles.as_flattened() {
        is_single[vertex as usize] = false;
    }
    (0..).zip(is_single).filter(|(_, single)| *single).map(|(v, _)| v).collect()
}

fn document(exported: &Exported, centre: DVec3, primitives: &[Value], binary: &Binary) -> Value {
    let mut asset = json!({
        "version": "2.0",
        "generator": concat!("hlod-build ", env!("CARGO_PKG_VERSION")),
        "extras": { "displacement": exported.displacement(), "unit": exported.header.unit.name() },
    });
    if !exported.about.is_empty() {
        asset["copyright"] = json!(exported.about.join("; "));
    }
    json!({
        "asset": asset,
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [
            { "name": "metres, +y up, +z to the front", "matrix": frame(&exported.header), "children": [1] },
            { "translation": centre.as_vec3().to_array(), "mesh": 0 },
        ],
        "meshes": [{ "primitives": primitives }],
        // Scans of open surfaces are looked at from both sides.
        "materials": [{
            "doubleSided": true,
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 0.8 },
        }],
        "accessors": binary.accessors,
        "bufferViews": binary.views,
        "buffers": [{ "byteLength": binary.bytes.len() }],
    })
}

/// From the scan's axes and unit to glTF's, column by column. A unit that nobody declared stays as it is.
fn frame(header: &Header) -> [f64; 16] {
    let metres = match header.unit {
        Unit::Micrometre => 1e-6,
        Unit::Millimetre => 1e-3,
        Unit::Centimetre => 1e-2,
        Unit::Inch => 0.0254,
        _ => 1.0,
    };
    let up = DVec3::from_array(header.up.direction());
    let front = DVec3::from_array(header.front.direction());
    // Rows of the rotation are glTF's axes in the scan's.
    let rows = [up.cross(front), up, front];
    let mut matrix = [0.0; 16];
    for column in 0..3 {
        for (row, axis) in rows.iter().enumerate() {
            matrix[4 * column + row] = metres * axis[column];
        }
    }
    matrix[15] = 1.0;
    // JSON has a minus zero, which only makes readers wonder.
    matrix.map(|x| x + 0.0)
}
