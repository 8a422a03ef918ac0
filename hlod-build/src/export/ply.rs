//! As PLY: binary, positions as `double` in source coordinates, so that nothing is rounded.

use std::io::{BufWriter, Write};
use std::path::Path;

use super::Exported;
use crate::error::BuildError;
use crate::output::Aside;

/// Writes the file.
pub(super) fn write(exported: &Exported, (output, force): (&Path, bool)) -> Result<(), BuildError> {
    let aside = Aside::create(output)?;
    let mut out = BufWriter::with_capacity(1 << 20, aside.file());
    let written = header(exported, &mut out).and_then(|()| body(exported, &mut out));
    written.and_then(|()| out.flush()).map_err(BuildError::io(output, "write"))?;
    drop(out);
    aside.commit(output, force)
}

/// A name without what would end it in a PLY header: files come from anywhere.
fn property_name(name: &str) -> String {
    name.chars().map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c }).collect()
}

fn header(exported: &Exported, out: &mut impl Write) -> std::io::Result<()> {
    let Exported { mesh, header, .. } = exported;
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "comment {}", exported.displacement())?;
    for line in &exported.about {
        writeln!(out, "comment {line}")?;
    }
    writeln!(out, "element vertex {}", mesh.positions.len())?;
    for axis in ["x", "y", "z"] {
        writeln!(out, "property double {axis}")?;
    }
    for axis in ["nx", "ny", "nz"] {
        writeln!(out, "property float {axis}")?;
    }
    if mesh.has_colours() {
        for channel in ["red", "green", "blue", "alpha"] {
            writeln!(out, "property uchar {channel}")?;
        }
    }
    for (name, _) in header.scalars() {
        writeln!(out, "property double {}", property_name(name))?;
    }
    if !mesh.triangles.is_empty() {
        writeln!(out, "element face {}", mesh.triangles.len())?;
        writeln!(out, "property list uchar int vertex_indices")?;
    }
    writeln!(out, "end_header")
}

fn body(exported: &Exported, out: &mut impl Write) -> std::io::Result<()> {
    let Exported { mesh, header, .. } = exported;
    for v in 0..mesh.positions.len() {
        for value in header.lattice.position(mesh.positions[v]) {
            out.write_all(&value.to_le_bytes())?;
        }
        for value in mesh.normals[v].decode() {
            out.write_all(&value.to_le_bytes())?;
        }
        if let Some(colour) = mesh.colours.get(v) {
            out.write_all(colour)?;
        }
        for (k, (_, range)) in header.scalars().enumerate() {
            let code = mesh.scalars.get(v).map_or(0, |scalars| scalars.0[k]);
            out.write_all(&range.value(code).unwrap_or(f64::NAN).to_le_bytes())?;
        }
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        for index in triangle {
            out.write_all(&index.to_le_bytes())?;
        }
    }
    Ok(())
}
