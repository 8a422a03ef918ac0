//! Whole scans in memory: loading, welding, normals.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};

use crate::error::{Place, ScanError, Spot};
use crate::report::ScanReport;
use crate::{Batch, ScanReader, place_scans, polygon};

/// One or several scans as one indexed mesh.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct ScanMesh {
    /// Positions in the coordinates and unit of the files.
    pub positions: Vec<DVec3>,
    /// One for each position, of unit length: from the file or computed.
    pub normals: Vec<Vec3>,
    /// Red, green, blue in sRGB, then alpha; empty if no input has colours. Vertices
    /// of inputs without colours are then opaque white.
    pub colours: Vec<[u8; 4]>,
    /// Corners as indices into `positions`.
    pub triangles: Vec<[u32; 3]>,
    /// Whether some input has no normals at all, so that its normals were computed.
    pub normals_computed: bool,
    /// One for each input, in the order given.
    pub reports: Vec<ScanReport>,
}

/// Reads `paths` as one model: their vertices and triangles one after the other, in
/// the coordinates that each file has, or where a MeshLab project puts them. Triangle soups are welded ([`weld_exact`]), each
/// by itself. Normals that a file lacks are computed ([`angle_weighted_normals`]).
///
/// `progress` is called with bytes done and bytes in total, at least once at the end.
///
/// # Errors
///
/// If `paths` is empty, if a file cannot be read, or if all vertices together are more
/// than a 32-bit index can name.
pub fn load(paths: &[PathBuf], progress: &mut dyn FnMut(u64, u64)) -> Result<ScanMesh, ScanError> {
    if paths.is_empty() {
        let at = Spot::new(Path::new("(no file)"), Place::File);
        return Err(ScanError::NoInput { at });
    }
    let scans = place_scans(paths, &[])?;
    // A missing file is told before the others are read; sizes serve the progress.
    let mut bytes_total = 0;
    for scan in &scans {
        let metadata = std::fs::metadata(&scan.path);
        let at = Spot::new(&scan.path, Place::File);
        bytes_total += metadata.map_err(|e| ScanError::from_io(at, e))?.len();
    }

    let mut mesh = ScanMesh::default();
    let mut bytes_before = 0;
    for scan in &scans {
        let mut reader = ScanReader::open(&scan.path)?;
        if let Some(transform) = &scan.transform {
            reader.move_by(transform);
        }
        append(&mut mesh, &mut reader, &mut |bytes| {
            progress((bytes_before + bytes).min(bytes_total), bytes_total);
        })?;
        bytes_before += reader.header().file_bytes;
    }
    complete_normals(&mut mesh);
    progress(bytes_total, bytes_total);
    Ok(mesh)
}

/// Reads one file to its end and adds it. Normals that it lacks are left zero.
fn append(
    mesh: &mut ScanMesh,
    reader: &mut ScanReader,
    progress: &mut dyn FnMut(u64),
) -> Result<(), ScanError> {
    let header = reader.header().clone();
    if header.is_point_cloud {
        // Told at once, not after gigabytes of points.
        let vertices = header.vertices_declared.unwrap_or_default();
        return Err(ScanError::PointsOnly { at: Spot::new(&header.path, Place::File), vertices });
    }
    let first_vertex = mesh.positions.len();
    let first_triangle = mesh.triangles.len();
    if header.has_colours {
        mesh.colours.resize(first_vertex, [255; 4]);
    }
    // Triangles may come before their vertices: keep the file's numbers until the end.
    while let Some(batch) = reader.next_batch()? {
        match batch {
            Batch::Vertices(batch) => {
                mesh.positions.extend(batch.positions);
                mesh.normals.extend(batch.normals);
                mesh.colours.extend(batch.colours);
                if mesh.positions.len() > u32::MAX as usize {
                    return Err(ScanError::TooManyVertices {
                        at: Spot::new(&header.path, Place::File),
                        vertices: mesh.positions.len() as u64,
                    });
                }
            }
            Batch::Triangles(batch) => mesh.triangles.extend(batch.triangles),
        }
        progress(reader.bytes_read());
    }
    mesh.normals.resize(mesh.positions.len(), Vec3::ZERO);
    if !mesh.colours.is_empty() {
        mesh.colours.resize(mesh.positions.len(), [255; 4]);
    }
    mesh.normals_computed |= !header.has_normals;

    let mut report = reader.report().clone();
    if header.is_triangle_soup {
        weld_soup(mesh, first_vertex, first_triangle, &mut report);
    }
    for triangle in &mut mesh.triangles[first_triangle..] {
        // Below the vertex count, which fits u32.
        *triangle = triangle.map(|corner| corner + first_vertex as u32);
    }
    mesh.reports.push(report);
    if mesh.triangles.len() == first_triangle {
        return Err(ScanError::AllDegenerate {
            at: Spot::new(&header.path, Place::File),
            faces: reader.report().faces_read,
        });
    }
    Ok(())
}

/// Welds the vertices from `first_vertex` on; their triangles still count from there.
/// Merged vertices take the first one's colour.
fn weld_soup(
    mesh: &mut ScanMesh,
    first_vertex: usize,
    first_triangle: usize,
    report: &mut ScanReport,
) {
    let weld = weld_exact(&mesh.positions[first_vertex..]);
    report.vertices_welded = (weld.new_from_old.len() - weld.old_from_new.len()) as u64;

    // A kept vertex never moves up, so that nothing is overwritten before it is read.
    for (new, old) in weld.old_from_new.iter().enumerate() {
        let (new, old) = (first_vertex + new, first_vertex + *old as usize);
        mesh.positions[new] = mesh.positions[old];
        // Facets' normals say nothing that positions do not: better ones are computed.
        mesh.normals[new] = Vec3::ZERO;
        if !mesh.colours.is_empty() {
            mesh.colours[new] = mesh.colours[old];
        }
    }
    let vertex_count = first_vertex + weld.old_from_new.len();
    mesh.positions.truncate(vertex_count);
    mesh.normals.truncate(vertex_count);
    mesh.colours.truncate(vertex_count);
    for triangle in &mut mesh.triangles[first_triangle..] {
        *triangle = triangle.map(|old| weld.new_from_old[old as usize]);
    }

    // Count what welding made degenerate; readers have dropped most of it before.
    let welded = mesh.triangles.split_off(first_triangle);
    let before = welded.len();
    let kept = welded.into_iter().filter(|t| !polygon::repeats_corner(*t));
    mesh.triangles.extend(kept);
    let dropped = (before - (mesh.triangles.len() - first_triangle)) as u64;
    report.degenerate_faces += dropped;
    report.triangles -= dropped;
}

/// Which vertices became one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Weld {
    /// For each new vertex the first old one of its position; ascending.
    pub old_from_new: Vec<u32>,
    /// For each old vertex its new number.
    pub new_from_old: Vec<u32>,
}

/// Merges vertices of equal position. Equal means the same bits, except that −0 is 0:
/// nearly equal points of a scan are different points. New vertices keep the order in
/// which their positions first occur, so that the result depends on the input only.
///
/// # Panics
///
/// If there are more positions than a 32-bit index can name.
pub fn weld_exact(positions: &[DVec3]) -> Weld {
    assert!(positions.len() <= u32::MAX as usize, "too many vertices");
    let mut old_from_new = Vec::new();
    let mut new_from_position = HashMap::new();
    let new_from_old = (0u32..)
        .zip(positions)
        .map(|(old, position)| {
            // Adding zero turns −0 into 0 and changes nothing else.
            let key = position.to_array().map(|x| (x + 0.0).to_bits());
            *new_from_position.entry(key).or_insert_with(|| {
                old_from_new.push(old);
                old_from_new.len() as u32 - 1
            })
        })
        .collect();
    Weld { old_from_new, new_from_old }
}

/// Computes unit normals where they are zero.
fn complete_normals(mesh: &mut ScanMesh) {
    if mesh.normals.iter().all(|normal| *normal != Vec3::ZERO) {
        return;
    }
    let computed = angle_weighted_normals(&mesh.positions, &mesh.triangles);
    for (normal, computed) in mesh.normals.iter_mut().zip(computed) {
        if *normal == Vec3::ZERO {
            *normal = computed;
        }
    }
}

/// Unit vertex normals: the mean of the normals of the triangles round a vertex, each
/// weighted by the angle that it spans there (based on: Thürmer and Wüthrich,
/// *Computing vertex normals from polygonal facets*, 1998). The result does not depend
/// on how a flat part is cut into triangles.
///
/// Where there is no such mean (no triangle, only triangles without area, or normals
/// that cancel) the normal is +z: it must have unit length, and any direction is as
/// good.
///
/// # Panics
///
/// If a triangle names a vertex that is not there.
pub fn angle_weighted_normals(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut sums = vec![NormalSum::default(); positions.len()];
    for triangle in triangles {
        let added = NormalSum::of_corners(triangle.map(|index| positions[index as usize]));
        for corner in 0..3 {
            sums[triangle[corner] as usize].add(added[corner]);
        }
    }
    sums.into_iter().map(|sum| sum.normal()).collect()
}

/// A sum of weighted normals in steps of 2⁻⁴⁰: the order in which they are added does not matter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NormalSum(pub [i64; 3]);

impl NormalSum {
    const SCALE: f64 = (1u64 << 40) as f64;

    /// What a triangle adds at each of its corners; nothing where it has no area.
    pub fn of_corners([a, b, c]: [DVec3; 3]) -> [NormalSum; 3] {
        let directions = [direction(b - a), direction(c - b), direction(a - c)];
        let normal = directions[0].cross(directions[1]).normalize_or_zero();
        std::array::from_fn(|corner| {
            if normal == DVec3::ZERO {
                return NormalSum::default();
            }
            let (to_next, from_last) = (directions[corner], directions[(corner + 2) % 3]);
            // atan2 stays exact for slivers, where acos of the cosine does not.
            let sine = to_next.cross(from_last).length();
            let angle = sine.atan2(-to_next.dot(from_last));
            NormalSum((normal * (angle * Self::SCALE)).to_array().map(|x| x.round() as i64))
        })
    }

    /// Adds another sum; wraps round, so that no input can stop a build.
    pub fn add(&mut self, other: NormalSum) {
        for (a, b) in self.0.iter_mut().zip(other.0) {
            *a = a.wrapping_add(b);
        }
    }

    /// The unit normal; +z where there is none.
    pub fn normal(&self) -> Vec3 {
        DVec3::from_array(self.0.map(|x| x as f64)).try_normalize().unwrap_or(DVec3::Z).as_vec3()
    }
}

/// Unit vector, zero for zero; its squares neither overflow nor underflow.
fn direction(side: DVec3) -> DVec3 {
    (side / side.abs().max_element()).normalize_or_zero()
}
