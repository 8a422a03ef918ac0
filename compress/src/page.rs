//! Pages of triangles.
//!
//! First form of the codec, to be replaced before the format freezes: vertices in the order in
//! which triangles first use them; positions on the page's sub-grid relative to its lowest
//! corner, normals and colours through meshoptimizer's vertex codec, triangles through its index
//! codec (Kapoulkine 2016–2026), everything together through zstd.
//!
//! ```text
//! tag u8 · flags u8 · grid shift u8 · bytes a coordinate u8 · vertices u32 · triangles u32
//! lowest corner 3×i32 · lengths of 4 streams u32 · zstd frame of the streams
//! ```

use crate::bytes::{ByteReader, ByteWriter};
use crate::{FormatError, Mesh, OctNormal};

const TAG_TRIANGLES: u8 = 1;
const FLAG_COLOURS: u8 = 1;
const HEADER_BYTES: usize = 4 + 8 + 12 + 16;

/// Nothing larger is written or decoded.
const VERTICES_MAX: u32 = 1 << 22;
const TRIANGLES_MAX: u32 = 1 << 23;

/// Encodes a mesh whose positions are all multiples of `2^grid_shift`.
///
/// Triangles and vertices come back in another order, corners possibly rotated; geometry and
/// attributes come back unchanged.
///
/// # Errors
/// When the mesh is larger than a page may be.
///
/// # Panics
/// When the mesh is inconsistent or off the grid: both are the caller's mistakes.
pub fn encode_mesh(mesh: &Mesh, grid_shift: u8) -> Result<Vec<u8>, FormatError> {
    if let Err(why) = mesh.validate() {
        panic!("cannot encode an inconsistent mesh: {why}");
    }
    for (unit, count, limit) in [
        ("vertices", mesh.positions.len(), VERTICES_MAX),
        ("triangles", mesh.triangles.len(), TRIANGLES_MAX),
    ] {
        if count as u64 > u64::from(limit) {
            let (count, limit) = (count as u64, u64::from(limit));
            return Err(FormatError::TooLarge { what: "page", count, unit, limit });
        }
    }

    // Order triangles for locality and vertices by first use: both codecs predict from what
    // came just before.
    let indices: &[u32] = bytemuck::cast_slice(&mesh.triangles);
    let indices = if indices.is_empty() {
        Vec::new()
    } else {
        meshopt::optimize_vertex_cache(indices, mesh.positions.len())
    };
    const UNSEEN: u32 = u32::MAX;
    let mut new_from_old = vec![UNSEEN; mesh.positions.len()];
    let mut old_from_new = Vec::with_capacity(mesh.positions.len());
    let used = indices.iter().copied().chain(0..mesh.positions.len() as u32);
    for old in used {
        if new_from_old[old as usize] == UNSEEN {
            new_from_old[old as usize] = old_from_new.len() as u32;
            old_from_new.push(old as usize);
        }
    }
    let indices: Vec<u32> = indices.iter().map(|&old| new_from_old[old as usize]).collect();

    // Place the positions on the page's own grid.
    let (lowest, highest) = mesh.bounds().unwrap_or_default();
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
    let wide = grid(highest).iter().any(|&c| c > u32::from(u16::MAX));
    let positions = if wide {
        let values: Vec<[u32; 3]> = old_from_new.iter().map(|&v| grid(mesh.positions[v])).collect();
        encode_vertices(&values)?
    } else {
        let values: Vec<[u16; 4]> = old_from_new
            .iter()
            .map(|&v| {
                let [x, y, z] = grid(mesh.positions[v]).map(|c| c as u16);
                [x, y, z, 0]
            })
            .collect();
        encode_vertices(&values)?
    };
    let normals: Vec<OctNormal> = old_from_new.iter().map(|&v| mesh.normals[v]).collect();
    let normals = encode_vertices(&normals)?;
    let colours = if mesh.has_colours() {
        let values: Vec<[u8; 4]> = old_from_new.iter().map(|&v| mesh.colours[v]).collect();
        encode_vertices(&values)?
    } else {
        Vec::new()
    };
    let triangles = if indices.is_empty() {
        Vec::new()
    } else {
        meshopt::encode_index_buffer(&indices, mesh.positions.len()).map_err(codec_error)?
    };

    let mut w = ByteWriter::default();
    w.u8(TAG_TRIANGLES);
    w.u8(if mesh.has_colours() { FLAG_COLOURS } else { 0 });
    w.u8(grid_shift);
    w.u8(if wide { 4 } else { 2 });
    w.u32(mesh.positions.len() as u32);
    w.u32(mesh.triangles.len() as u32);
    w.vec3_i32(lowest);
    let streams = [positions, normals, colours, triangles];
    for stream in &streams {
        w.u32(stream.len() as u32);
    }
    w.put(&zstd::bulk::compress(&streams.concat(), ZSTD_LEVEL)?);
    Ok(w.bytes)
}

/// Higher levels gain below 1 % on these streams.
const ZSTD_LEVEL: i32 = 9;

fn encode_vertices<T: bytemuck::NoUninit>(values: &[T]) -> Result<Vec<u8>, FormatError> {
    if values.is_empty() {
        return Ok(Vec::new());
    }
    meshopt::encode_vertex_buffer(values).map_err(codec_error)
}

fn decode_vertices<T: bytemuck::AnyBitPattern + Default>(
    bytes: &[u8],
    count: usize,
) -> Result<Vec<T>, FormatError> {
    if count == 0 {
        return Ok(Vec::new());
    }
    meshopt::decode_vertex_buffer(bytes, count).map_err(codec_error)
}

fn codec_error(error: meshopt::Error) -> FormatError {
    FormatError::malformed("page", format!("a stream cannot be decoded ({error})"))
}

/// Numbers of vertices and triangles that a page declares, without decoding it.
///
/// # Errors
/// When the bytes do not begin like a page of triangles.
pub fn encoded_mesh_counts(page: &[u8]) -> Result<(u32, u32), FormatError> {
    let mut r = ByteReader::new("page", page);
    let tag = r.u8()?;
    if tag != TAG_TRIANGLES {
        return Err(FormatError::malformed("page", format!("unknown kind {tag}")));
    }
    r.take(3)?;
    Ok((r.u32()?, r.u32()?))
}

/// Decodes a page of triangles. Its checksum is the caller's business, because the caller has it.
///
/// # Errors
/// On any byte sequence that [`encode_mesh`] does not write: no panic, and no allocation that
/// the page's declared and limited counts do not explain.
pub fn decode_mesh(page: &[u8]) -> Result<Mesh, FormatError> {
    let bad = |why: String| FormatError::malformed("page", why);
    let (vertices, triangles) = encoded_mesh_counts(page)?;
    let mut r = ByteReader::new("page", page);
    let flags = r.take(2)?[1];
    let grid_shift = r.u8()?;
    let coordinate_bytes = r.u8()?;
    r.take(8)?;
    if vertices > VERTICES_MAX
        || triangles > TRIANGLES_MAX
        || grid_shift > 30
        || flags & !FLAG_COLOURS != 0
        || !matches!(coordinate_bytes, 2 | 4)
    {
        return Err(bad(format!(
            "{vertices} vertices, {triangles} triangles, grid 2^{grid_shift}, {coordinate_bytes} bytes a coordinate"
        )));
    }
    let lowest = r.vec3_i32()?;
    let lengths = [r.u32()?, r.u32()?, r.u32()?, r.u32()?].map(|l| l as usize);
    let (vertices, triangles) = (vertices as usize, triangles as usize);

    // The streams together cannot be longer than what their codecs make of that many items at
    // the worst: raw data plus headers.
    let streams_bytes = lengths.iter().fold(0usize, |sum, &l| sum.saturating_add(l));
    let ceiling = 4096 + vertices * (12 + 4 + 4) * 2 + triangles * 3 * 6;
    if streams_bytes > ceiling {
        return Err(bad(format!(
            "streams of {streams_bytes} bytes for {vertices} vertices and {triangles} triangles"
        )));
    }
    let compressed = r.take(r.remaining())?;
    let streams = zstd::bulk::decompress(compressed, streams_bytes)
        .map_err(|error| bad(format!("its streams cannot be decompressed ({error})")))?;
    if streams.len() != streams_bytes {
        return Err(bad("its streams have other lengths than declared".into()));
    }
    let mut rest = streams.as_slice();
    let mut next = |length: usize| {
        let (head, tail) = rest.split_at(length);
        rest = tail;
        head
    };
    let [positions, normals, colours, indices] = lengths.map(&mut next);

    // Decode, checking that positions stay on the lattice.
    let offsets: Vec<[u32; 3]> = if coordinate_bytes == 4 {
        decode_vertices(positions, vertices)?
    } else {
        let values: Vec<[u16; 4]> = decode_vertices(positions, vertices)?;
        values.into_iter().map(|[x, y, z, _]| [x, y, z].map(u32::from)).collect()
    };
    let mut out = Vec::with_capacity(vertices);
    for offset in offsets {
        let mut position = [0; 3];
        for axis in 0..3 {
            let value = (u64::from(offset[axis]) << grid_shift) as i64 + i64::from(lowest[axis]);
            position[axis] =
                i32::try_from(value).map_err(|_| bad("a position lies off the lattice".into()))?;
        }
        out.push(position);
    }
    let triangles: Vec<[u32; 3]> = if triangles == 0 {
        Vec::new()
    } else {
        let mut indices: Vec<u32> =
            meshopt::decode_index_buffer(indices, triangles * 3).map_err(codec_error)?;
        indices.chunks_exact_mut(3).map(|t| [t[0], t[1], t[2]]).collect()
    };
    let mesh = Mesh {
        positions: out,
        normals: decode_vertices(normals, vertices)?,
        colours: if flags & FLAG_COLOURS != 0 {
            decode_vertices(colours, vertices)?
        } else {
            Vec::new()
        },
        triangles,
    };
    mesh.validate().map_err(bad)?;
    Ok(mesh)
}

const _: () = assert!(HEADER_BYTES == 40 && std::mem::size_of::<OctNormal>() == 4);

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type Corner = ([i32; 3], OctNormal, [u8; 4]);

    /// Geometry as a sorted list of triangles with their corners' values, rotated to a canonical
    /// first corner: what must survive coding whatever the order.
    fn canonical(mesh: &Mesh) -> Vec<[Corner; 3]> {
        let corner = |v: u32| {
            let v = v as usize;
            (mesh.positions[v], mesh.normals[v], mesh.colours.get(v).copied().unwrap_or_default())
        };
        let mut out: Vec<_> = mesh
            .triangles
            .iter()
            .map(|t| {
                let mut t = t.map(corner);
                let first = (0..3).min_by_key(|&i| t[i]).unwrap_or(0);
                t.rotate_left(first);
                t
            })
            .collect();
        out.sort();
        out
    }

    fn grid_mesh(n: i32, shift: u8, colours: bool) -> Mesh {
        let mut mesh = Mesh::default();
        for y in 0..n {
            for x in 0..n {
                mesh.positions.push([x << shift, y << shift, ((x * y) % 7) << shift]);
                mesh.normals.push(OctNormal::encode([x as f32, y as f32, 1.0]));
                if colours {
                    mesh.colours.push([x as u8, y as u8, 7, 255]);
                }
            }
        }
        for y in 0..n - 1 {
            for x in 0..n - 1 {
                let v = (y * n + x) as u32;
                let n = n as u32;
                mesh.triangles.push([v, v + 1, v + n]);
                mesh.triangles.push([v + 1, v + n + 1, v + n]);
            }
        }
        mesh
    }

    #[test]
    fn meshes_survive_coding() {
        for (n, shift, colours) in [(2, 0, false), (40, 3, true), (9, 20, false)] {
            let mesh = grid_mesh(n, shift, colours);
            let decoded = decode_mesh(&encode_mesh(&mesh, shift).unwrap()).unwrap();
            assert_eq!(canonical(&mesh), canonical(&decoded));
        }
        let empty = Mesh::default();
        assert_eq!(decode_mesh(&encode_mesh(&empty, 0).unwrap()).unwrap(), empty);
    }

    #[test]
    fn every_truncation_is_an_error() {
        let page = encode_mesh(&grid_mesh(6, 1, true), 1).unwrap();
        for length in 0..page.len() {
            assert!(
                decode_mesh(&page[..length]).is_err(),
                "cut to {length} of {} bytes",
                page.len()
            );
        }
    }

    proptest! {
        #[test]
        fn damaged_pages_never_panic(at in 0usize..600, value in any::<u8>(), cut in 0usize..600) {
            let mut page = encode_mesh(&grid_mesh(8, 0, true), 0).unwrap();
            let at = at % page.len();
            page[at] = value;
            page.truncate(page.len() - cut % page.len());
            if let Ok(mesh) = decode_mesh(&page) {
                prop_assert!(mesh.validate().is_ok());
            }
        }

        #[test]
        fn arbitrary_bytes_never_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            if let Some(tag) = bytes.first_mut() {
                *tag = TAG_TRIANGLES;
            }
            let _ = decode_mesh(&bytes);
        }
    }
}
