//! Pages: what a node is drawn with.
//!
//! A page holds triangles, points ([`points`]), or both: a tag, the length of the triangles' page, that
//! page and the points'. Of triangles:
//!
//! ```text
//! tag u8 · flags u8 · grid shift u8 · shift of positions u8 · shift of normals u8 · expectation u8 ·
//! vertices u32 · triangles u32 · lowest corner 3×i32 · extent 3×u32 · shift u8 for each scalar ·
//! bytes of symbols u32 · symbols · plain bits
//! ```
//!
//! Bit 0 of the flags says that there are colours, bits 1 to 3 how many scalars there are.
//!
//! Positions lie on the page's own grid, multiples of 2^shift lattice steps from the lowest corner.
//! Everything is predicted from what was coded before ([`walk`], [`normals`]); what is left is
//! entropy-coded ([`crate::entropy`]). Geometry and attributes come back unchanged, vertices and
//! triangles in another order.

mod cut_border;
mod normals;
mod points;
mod scalars;
mod values;
mod walk;

use crate::bytes::{ByteReader, ByteWriter};
use crate::entropy::{Coder, Decoder, Encoder, SYMBOLS_A_BYTE};
use crate::{FormatError, Mesh, OctNormal, PAGE_BYTES_MAX, Points, SCALARS_MAX};
use normals::{Expectation, best_expectation, code_normals};
use points::{decode_points, encode_points, encoded_point_count};
use values::shift_for;
use walk::{Declared, Truth, Walked, walk};

const TAG_TRIANGLES: u8 = 2;
const TAG_POINTS: u8 = 3;
const TAG_BOTH: u8 = 4;
const FLAG_COLOURS: u8 = 1;
/// Where in the flags the number of scalars begins.
const SCALARS_BIT: u32 = 1;

/// Nothing larger is written or decoded: eight of the largest leaves that can be asked for. With
/// [`PAGE_BYTES_MAX`] it keeps what a page can cost its decoder below a second (`benches/pages.rs`).
const VERTICES_MAX: u32 = 1 << 19;
const TRIANGLES_MAX: u32 = 1 << 20;
/// Residuals have at most so many plain low bits.
const SHIFT_MAX: u32 = 24;

/// What of a page's bytes is what.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PageAccount {
    /// Header, positions, colours and triangles: they share their symbols.
    pub shape: f64,
    /// Normals.
    pub normals: f64,
    /// Kept scalars.
    pub scalars: f64,
}

/// Whether there are colours, and how many scalars.
fn flags(has_colours: bool, scalars: usize) -> u8 {
    (if has_colours { FLAG_COLOURS } else { 0 }) | (scalars as u8) << SCALARS_BIT
}

/// The inverse of [`flags`]; `None` where they cannot be right.
fn of_flags(flags: u8) -> Option<(bool, usize)> {
    let scalars = usize::from(flags >> SCALARS_BIT);
    (scalars <= SCALARS_MAX).then_some((flags & FLAG_COLOURS != 0, scalars))
}

/// Shifts of scalars' residuals.
fn read_shifts(r: &mut ByteReader<'_>, count: usize) -> Result<Vec<u8>, FormatError> {
    let shifts = r.take(count)?.to_vec();
    match shifts.iter().find(|&&shift| u32::from(shift) > SHIFT_MAX) {
        None => Ok(shifts),
        Some(shift) => Err(FormatError::malformed("page", format!("a shift of {shift}"))),
    }
}

/// What a node is drawn with.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PageContent {
    /// Triangles; empty where there are none.
    pub mesh: Mesh,
    /// Points; empty where there are none.
    pub points: Points,
}

/// How much of what a page holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PageCounts {
    /// Vertices of triangles.
    pub vertices: u32,
    /// Triangles.
    pub triangles: u32,
    /// Points.
    pub points: u32,
}

/// Encodes what a node is drawn with; positions of triangles are all multiples of `2^grid_shift` from
/// their lowest corner, and those of points of `2^point_shift`.
///
/// # Errors
/// When there is more than a page may hold.
///
/// # Panics
/// When the content is inconsistent or off the grid: both are the caller's mistakes.
pub fn encode_page(
    content: &PageContent,
    grid_shift: u8,
    point_shift: u8,
) -> Result<Vec<u8>, FormatError> {
    let PageContent { mesh, points } = content;
    let page = if points.is_empty() {
        encode_mesh(mesh, grid_shift)?
    } else if mesh.positions.is_empty() {
        encode_points(points, point_shift)?
    } else {
        let triangles = encode_mesh(mesh, grid_shift)?;
        let points = encode_points(points, point_shift)?;
        let mut w = ByteWriter::default();
        w.u8(TAG_BOTH);
        w.u32(triangles.len() as u32);
        w.put(&triangles);
        w.put(&points);
        w.bytes
    };
    too_large("bytes", page.len(), PAGE_BYTES_MAX)?;
    Ok(page)
}

/// Decodes a page. Its checksum is the caller's business, because the caller has it.
///
/// # Errors
/// On any byte sequence that [`encode_page`] does not write: no panic, and no allocation that
/// the page's declared and limited counts do not explain.
pub fn decode_page(page: &[u8]) -> Result<PageContent, FormatError> {
    let Parts { triangles, points } = parts(page)?;
    Ok(PageContent {
        mesh: triangles.map(decode_mesh).transpose()?.unwrap_or_default(),
        points: points.map(decode_points).transpose()?.unwrap_or_default(),
    })
}

/// What a page declares, without decoding it.
///
/// # Errors
/// When the bytes do not begin like a page.
pub fn encoded_counts(page: &[u8]) -> Result<PageCounts, FormatError> {
    let Parts { triangles, points } = parts(page)?;
    let (vertices, triangles) = triangles.map(mesh_counts).transpose()?.unwrap_or_default();
    let points = points.map(encoded_point_count).transpose()?.unwrap_or_default();
    Ok(PageCounts { vertices, triangles, points })
}

/// The bytes of a page's parts.
struct Parts<'a> {
    triangles: Option<&'a [u8]>,
    points: Option<&'a [u8]>,
}

fn parts(page: &[u8]) -> Result<Parts<'_>, FormatError> {
    too_large("bytes", page.len(), PAGE_BYTES_MAX)?;
    let mut r = ByteReader::new("page", page);
    match r.u8()? {
        TAG_TRIANGLES => Ok(Parts { triangles: Some(page), points: None }),
        TAG_POINTS => Ok(Parts { triangles: None, points: Some(page) }),
        TAG_BOTH => {
            let triangles = r.u32()? as usize;
            let triangles = Some(r.take(triangles)?);
            Ok(Parts { triangles, points: Some(r.take(r.remaining())?) })
        }
        tag => Err(FormatError::malformed("page", format!("unknown kind {tag}"))),
    }
}

/// Positions on a page's grid, and how far they reach.
///
/// # Panics
/// When one is off the grid.
fn on_grid(
    positions: &[[i32; 3]],
    lowest: [i32; 3],
    highest: [i32; 3],
    grid_shift: u8,
) -> (Vec<[i32; 3]>, [u32; 3]) {
    let grid = |p: [i32; 3]| -> [u32; 3] {
        std::array::from_fn(|i| {
            let offset = p[i].abs_diff(lowest[i]);
            assert!(
                offset.trailing_zeros() >= u32::from(grid_shift),
                "position off the page's grid"
            );
            offset >> grid_shift
        })
    };
    (positions.iter().map(|&p| grid(p).map(|c| c as i32)).collect(), grid(highest))
}

fn too_large(unit: &'static str, count: usize, limit: u32) -> Result<(), FormatError> {
    let (count, limit) = (count as u64, u64::from(limit));
    if count > limit {
        return Err(FormatError::TooLarge { what: "page", count, unit, limit });
    }
    Ok(())
}

/// Encodes a mesh whose positions are all multiples of `2^grid_shift` from its lowest corner.
///
/// # Errors
/// When the mesh is larger than a page may be.
///
/// # Panics
/// When the mesh is inconsistent or off the grid: both are the caller's mistakes.
fn encode_mesh(mesh: &Mesh, grid_shift: u8) -> Result<Vec<u8>, FormatError> {
    encode_mesh_with_account(mesh, grid_shift).map(|(page, _)| page)
}

/// A page of triangles, as [`encode_page`] writes it, with what the parts cost in bytes.
///
/// # Errors
/// As [`encode_mesh`].
///
/// # Panics
/// As [`encode_mesh`].
pub fn encode_mesh_with_account(
    mesh: &Mesh,
    grid_shift: u8,
) -> Result<(Vec<u8>, PageAccount), FormatError> {
    if let Err(why) = mesh.validate() {
        panic!("cannot encode an inconsistent mesh: {why}");
    }
    let (lowest, highest) = mesh.bounds().unwrap_or_default();
    let (positions, extent) = on_grid(&mesh.positions, lowest, highest, grid_shift);
    let largest = extent.into_iter().max().unwrap_or(0);
    too_large("vertices", mesh.positions.len(), VERTICES_MAX)?;
    too_large("triangles", mesh.triangles.len(), TRIANGLES_MAX)?;
    too_large("steps along an axis", largest as usize, EXTENT_MAX)?;

    let declared = Declared {
        vertices: mesh.positions.len(),
        triangles: mesh.triangles.len(),
        extent: extent.map(|c| c as i32),
        has_colours: mesh.has_colours(),
        shift: shift_for(mean_edge(mesh, &positions) / 3.0).min(SHIFT_MAX),
    };
    let mut coder = Encoder::default();
    let walked = walk(&mut coder, declared, Some(Truth::new(mesh, &positions)))?;
    let shape = coder.cost_bits();
    let truth: Vec<OctNormal> = walked.sources.iter().map(|&v| mesh.normals[v as usize]).collect();
    let (expectation, mean) = best_expectation(&walked, &truth);
    let normal_shift = shift_for(mean);
    code_normals(&mut coder, &walked, normal_shift, expectation, Some(&truth));
    let before = coder.cost_bits();
    let normals = (before - shape) / 8.0;
    let mut shifts = Vec::new();
    for k in 0..scalars::columns(&mesh.scalars) {
        let truth = scalars::column(&mesh.scalars, &walked.sources, k);
        let shift = scalars::best_shift(&truth, &walked);
        shifts.push(shift);
        scalars::code_scalar(&mut coder, &walked, (truth.len(), shift), Some(&truth));
    }
    let scalars = (coder.cost_bits() - before) / 8.0;
    let (symbols, bits) = coder.finish();

    let mut w = ByteWriter::default();
    w.u8(TAG_TRIANGLES);
    w.u8(flags(mesh.has_colours(), shifts.len()));
    w.u8(grid_shift);
    w.u8(declared.shift as u8);
    w.u8(normal_shift as u8);
    w.u8(expectation.to_byte());
    w.u32(mesh.positions.len() as u32);
    w.u32(mesh.triangles.len() as u32);
    w.vec3_i32(lowest);
    extent.iter().for_each(|&c| w.u32(c));
    w.put(&shifts);
    w.u32(symbols.len() as u32);
    w.put(&symbols);
    w.put(&bits);
    let account = PageAccount { shape: w.bytes.len() as f64 - normals - scalars, normals, scalars };
    Ok((w.bytes, account))
}

/// Positions are i32 on the page's grid.
const EXTENT_MAX: u32 = i32::MAX as u32;

/// Mean length of a triangle's first edge.
fn mean_edge(mesh: &Mesh, positions: &[[i32; 3]]) -> f64 {
    let length = |t: &[u32; 3]| {
        let [a, b] = [t[0], t[1]].map(|v| positions[v as usize].map(f64::from));
        (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
    };
    mesh.triangles.iter().map(length).sum::<f64>() / mesh.triangles.len().max(1) as f64
}

fn mesh_counts(page: &[u8]) -> Result<(u32, u32), FormatError> {
    let mut r = ByteReader::new("page", page);
    let tag = r.u8()?;
    if tag != TAG_TRIANGLES {
        return Err(FormatError::malformed("page", format!("unknown kind {tag}")));
    }
    r.take(5)?;
    Ok((r.u32()?, r.u32()?))
}

/// Decodes a page of triangles.
///
/// # Errors
/// On any byte sequence that [`encode_mesh`] does not write, as [`decode_page`].
fn decode_mesh(page: &[u8]) -> Result<Mesh, FormatError> {
    let bad = |why: String| FormatError::malformed("page", why);
    let (vertices, triangles) = mesh_counts(page)?;
    let mut r = ByteReader::new("page", page);
    r.u8()?;
    let (has_colours, scalar_count) =
        of_flags(r.u8()?).ok_or_else(|| bad("unknown flags".into()))?;
    let [grid_shift, shift, normal_shift, expectation] = [r.u8()?, r.u8()?, r.u8()?, r.u8()?];
    r.take(8)?;
    let lowest = r.vec3_i32()?;
    let extent = [r.u32()?, r.u32()?, r.u32()?];
    if vertices > VERTICES_MAX
        || triangles > TRIANGLES_MAX
        || grid_shift > 30
        || u32::from(shift.max(normal_shift)) > SHIFT_MAX
        || extent.iter().any(|&c| c > EXTENT_MAX)
    {
        return Err(bad(format!(
            "{vertices} vertices, {triangles} triangles, grid 2^{grid_shift}, extent {extent:?}"
        )));
    }
    let expectation = Expectation::of_byte(expectation)
        .ok_or_else(|| bad("normals expected in an unknown way".into()))?;
    let shifts = read_shifts(&mut r, scalar_count)?;
    let symbols = r.u32()? as usize;
    let symbols = r.take(symbols)?;
    let bits = r.take(r.remaining())?;
    // Each triangle and each vertex costs a symbol.
    if u64::from(vertices.max(triangles)) > symbols.len() as u64 * SYMBOLS_A_BYTE {
        let symbols = symbols.len();
        return Err(bad(format!("{triangles} triangles in {symbols} bytes of symbols")));
    }

    let declared = Declared {
        vertices: vertices as usize,
        triangles: triangles as usize,
        extent: extent.map(|c| c as i32),
        has_colours,
        shift: shift.into(),
    };
    let mut coder = Decoder::new(symbols, bits)?;
    let walked = walk(&mut coder, declared, None)?;
    coder.check_left()?;
    let normals = code_normals(&mut coder, &walked, normal_shift.into(), expectation, None);
    let mut scalars = Vec::new();
    for (k, shift) in shifts.into_iter().enumerate() {
        coder.check_left()?;
        let count = walked.positions.len();
        let codes = scalars::code_scalar(&mut coder, &walked, (count, shift), None);
        scalars::add_column(&mut scalars, k, &codes);
    }
    coder.finish()?;

    let Walked { positions, colours, triangles, .. } = walked;
    let mut out = Vec::with_capacity(positions.len());
    for p in positions {
        let mut position = [0; 3];
        for axis in 0..3 {
            let value = (i64::from(p[axis]) << grid_shift) + i64::from(lowest[axis]);
            position[axis] =
                i32::try_from(value).map_err(|_| bad("a position lies off the lattice".into()))?;
        }
        out.push(position);
    }
    let mesh = Mesh { positions: out, normals, colours, scalars, triangles };
    mesh.validate().map_err(bad)?;
    Ok(mesh)
}

#[cfg(test)]
mod tests;
