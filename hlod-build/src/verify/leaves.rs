//! Compares leaves with the input, triangle by triangle.
//!
//! An input triangle that lies inside one leaf's cell must be there, corner for corner, once,
//! after rounding to the lattice. One that crosses cell faces must be there in pieces: the part
//! of it inside each cell (Sutherland–Hodgman clipping, in f64) and the leaf's remaining
//! triangles must have the same area, and those must lie on it, within the rounding of cut
//! points.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use hlod_compress::{CellKey, HlodFile, Lattice, MAX_DEPTH, Mesh, NodeRecord};
use hlod_scan::{Batch, ColourSource, PlacedScan, ReadOptions, ScanReader};
use rayon::prelude::*;

use super::check_page;
use super::distance::Target;
use crate::error::BuildError;
use crate::progress::{Progress, Unit};

/// One step of rounding moves a point by at most √3/2; a cut point is rounded after the edge's
/// own ends were. In lattice steps.
const ROUNDING_STEPS: f64 = 1.8;

/// What a reader may keep in memory of a file whose format it must remember.
const READER_BYTES: usize = 64 << 20;

type Corners = [[i32; 3]; 3];

/// However little memory there is, so many triangles of leaves are compared at a time.
const TRIANGLES_MIN: u64 = 20_000;

/// What a triangle of the input may take in memory while it waits for its leaf's, with the leaf's.
const TRIANGLE_BYTES: u64 = 160;

/// A sentence for each leaf that is not the input's geometry inside its cell.
///
/// Leaves are taken as many at a time as `memory_bytes` allow, with a pass over the input's
/// triangles for each; the input's vertices stay, at 12 bytes each.
pub(super) fn compare(
    file: &HlodFile,
    nodes: &[NodeRecord],
    against: &[PlacedScan],
    memory_bytes: u64,
    progress: &dyn Progress,
) -> Result<Vec<String>, BuildError> {
    let lattice = file.header().lattice;
    let mut leaves: Vec<&NodeRecord> = nodes.iter().filter(|node| node.is_leaf()).collect();
    let inner: HashSet<CellKey> =
        nodes.iter().filter(|node| !node.is_leaf()).map(|node| node.cell).collect();
    // Neighbours together, so that most triangles need not be taken far down in most batches.
    let place = |c: CellKey| c.morton() << (3 * u32::from(MAX_DEPTH - c.depth()));
    leaves.sort_by_key(|leaf| place(leaf.cell));

    let bytes: u64 = total_bytes(against)?;
    progress.begin("input's vertices", bytes, Unit::Bytes);
    let vertices = Vertices::read(against, &lattice, progress)?;
    progress.end();

    let room = memory_bytes.saturating_sub(12 * vertices.positions.len() as u64);
    let triangles_max = (room / TRIANGLE_BYTES).max(TRIANGLES_MIN);
    let mut out = Vec::new();
    let mut batch = BTreeMap::new();
    let mut triangles = 0;
    let mut batches: Vec<BTreeMap<CellKey, &NodeRecord>> = Vec::new();
    for leaf in leaves {
        let count = leaf.representations.first().map_or(0, |r| u64::from(r.triangles));
        if triangles + count > triangles_max && !batch.is_empty() {
            batches.push(std::mem::take(&mut batch));
            triangles = 0;
        }
        batch.insert(leaf.cell, leaf);
        triangles += count;
    }
    batches.push(batch);

    progress.begin("compare leaves", bytes * batches.len() as u64, Unit::Bytes);
    for (number, batch) in batches.iter().enumerate() {
        // Cells without a leaf have no batch of their own: the first one sees to them.
        let skipped: HashSet<CellKey> = match number {
            0 => batches[1..].iter().flat_map(|later| later.keys()).copied().collect(),
            _ => HashSet::new(),
        };
        let mut asked: HashSet<CellKey> = HashSet::new();
        for leaf in batch.keys() {
            let mut cell = Some(*leaf);
            while let Some(at) = cell.filter(|at| asked.insert(*at)) {
                cell = at.parent();
            }
        }
        let is_asked = |cell: &CellKey| match number {
            0 => !skipped.contains(cell),
            _ => asked.contains(cell),
        };
        let mut expected: BTreeMap<CellKey, Expected> = BTreeMap::new();
        vertices.each_triangle(against, progress, &mut |t| {
            if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
                distribute(CellKey::ROOT, &t, &lattice, &inner, &is_asked, &mut expected);
            }
        })?;
        let mut asked: BTreeSet<CellKey> = batch.keys().copied().collect();
        asked.extend(expected.keys());
        let asked: Vec<CellKey> = asked.into_iter().collect();
        let sentences: Vec<Option<String>> = asked
            .par_iter()
            .map(|cell| {
                let nothing = Expected::default();
                let mesh = match batch.get(cell) {
                    Some(leaf) => check_page(file, leaf, leaf.representations.first()?).ok()?.mesh,
                    None => Mesh::default(),
                };
                let why = difference(&mesh, expected.get(cell).unwrap_or(&nothing))?;
                Some(format!("leaf {cell}: {why}"))
            })
            .collect();
        out.extend(sentences.into_iter().flatten());
    }
    progress.end();
    Ok(out)
}

pub(super) fn total_bytes(scans: &[PlacedScan]) -> Result<u64, BuildError> {
    let size = |scan: &PlacedScan| {
        let path = &scan.path;
        std::fs::metadata(path).map(|m| m.len()).map_err(BuildError::io(path, "read"))
    };
    scans.iter().map(size).sum()
}

/// The input's vertices on the lattice, file after file.
struct Vertices {
    positions: Vec<[i32; 3]>,
    /// Where each file's begin.
    first: Vec<usize>,
}

impl Vertices {
    fn read(
        scans: &[PlacedScan],
        lattice: &Lattice,
        progress: &dyn Progress,
    ) -> Result<Vertices, BuildError> {
        let mut out = Vertices { positions: Vec::new(), first: Vec::new() };
        for scan in scans {
            out.first.push(out.positions.len());
            each_batch(scan, progress, &mut |batch| {
                if let Batch::Vertices(batch) = batch {
                    let rounded = batch.positions.iter().map(|p| round_to(lattice, p.to_array()));
                    out.positions.extend(rounded);
                }
            })?;
        }
        Ok(out)
    }

    /// Calls `visit` for every triangle of the input.
    fn each_triangle(
        &self,
        scans: &[PlacedScan],
        progress: &dyn Progress,
        visit: &mut dyn FnMut(Corners),
    ) -> Result<(), BuildError> {
        for (scan, first) in scans.iter().zip(&self.first) {
            each_batch(scan, progress, &mut |batch| {
                if let Batch::Triangles(batch) = batch {
                    for t in batch.triangles {
                        // Readers check indices; the file may have changed since its vertices
                        // were read.
                        let corner = |v: u32| self.positions.get(first + v as usize).copied();
                        if let [Some(a), Some(b), Some(c)] = t.map(corner) {
                            visit([a, b, c]);
                        }
                    }
                }
            })?;
        }
        Ok(())
    }
}

pub(super) fn each_batch(
    scan: &PlacedScan,
    progress: &dyn Progress,
    visit: &mut dyn FnMut(Batch),
) -> Result<(), BuildError> {
    each_batch_keeping(scan, &[], progress, visit)
}

/// The same with some properties of vertices.
pub(super) fn each_batch_keeping(
    scan: &PlacedScan,
    keep: &[String],
    progress: &dyn Progress,
    visit: &mut dyn FnMut(Batch),
) -> Result<(), BuildError> {
    let scratch = std::env::temp_dir();
    let options = ReadOptions {
        memory_bytes: READER_BYTES,
        scratch: &scratch,
        // Of surfaces only positions are compared, and clouds have no textures.
        colour: ColourSource::Vertex,
        transform: scan.transform,
        progress: &mut |_| !progress.is_stopped(),
        keep,
    };
    let mut reader = ScanReader::open_within(&scan.path, options)?;
    let mut done = 0;
    while let Some(batch) = reader.next_batch()? {
        visit(batch);
        progress.advance(reader.bytes_read() - done);
        done = reader.bytes_read();
    }
    Ok(())
}

pub(super) fn round_to(lattice: &Lattice, p: [f64; 3]) -> [i32; 3] {
    std::array::from_fn(|i| ((p[i] - lattice.origin[i]) / lattice.step).round() as i32)
}

/// What the input says a leaf holds.
#[derive(Default)]
struct Expected {
    whole: HashMap<Corners, i64>,
    crossing: Vec<[[f64; 3]; 3]>,
    crossing_area: f64,
    /// How much the crossing area may be off: its pieces' outlines times the rounding.
    area_slack: f64,
}

fn distribute(
    cell: CellKey,
    t: &Corners,
    lattice: &Lattice,
    inner: &HashSet<CellKey>,
    is_asked: &dyn Fn(&CellKey) -> bool,
    expected: &mut BTreeMap<CellKey, Expected>,
) {
    if !is_asked(&cell) {
        return;
    }
    let lo = lattice.cell_min(cell);
    let edge = lattice.cell_units(cell.depth()) as i32;
    let outside =
        (0..3).any(|i| t.iter().all(|p| p[i] < lo[i]) || t.iter().all(|p| p[i] > lo[i] + edge));
    if outside {
        return;
    }
    if inner.contains(&cell) {
        for octant in 0..8 {
            distribute(cell.child(octant), t, lattice, inner, is_asked, expected);
        }
        return;
    }
    // Lying in a face belongs to the cell below it.
    let in_low_face = (0..3).any(|i| lo[i] > 0 && t.iter().all(|p| p[i] == lo[i]));
    if in_low_face {
        return;
    }
    let inside = t.iter().all(|p| (0..3).all(|i| p[i] >= lo[i] && p[i] <= lo[i] + edge));
    if inside {
        *expected.entry(cell).or_default().whole.entry(canonical(*t)).or_default() += 1;
        return;
    }
    let polygon = clip(t, lo, edge);
    let (area, outline) = area_and_outline(&polygon);
    let touches_only = area <= 1e-9 && outline <= ROUNDING_STEPS;
    if polygon.len() >= 3 && !touches_only {
        let entry = expected.entry(cell).or_default();
        entry.crossing.push(t.map(|p| p.map(f64::from)));
        entry.crossing_area += area;
        entry.area_slack += outline * ROUNDING_STEPS / 2.0 + 1.0;
    }
}

fn canonical(mut t: Corners) -> Corners {
    let first = (0..3).min_by_key(|&i| t[i]).unwrap_or(0);
    t.rotate_left(first);
    t
}

fn clip(t: &Corners, lo: [i32; 3], edge: i32) -> Vec<[f64; 3]> {
    let mut polygon: Vec<[f64; 3]> = t.iter().map(|p| p.map(f64::from)).collect();
    for axis in 0..3 {
        for (plane, sign) in [(f64::from(lo[axis]), 1.0), (f64::from(lo[axis] + edge), -1.0)] {
            let mut out = Vec::new();
            for i in 0..polygon.len() {
                let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                let (da, db) = (sign * (a[axis] - plane), sign * (b[axis] - plane));
                if da >= 0.0 {
                    out.push(a);
                }
                if da * db < 0.0 {
                    let s = da / (da - db);
                    out.push(std::array::from_fn(|k| a[k] + s * (b[k] - a[k])));
                }
            }
            polygon = out;
        }
    }
    polygon
}

fn area_and_outline(polygon: &[[f64; 3]]) -> (f64, f64) {
    let sub = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| a[i] - b[i]) };
    let norm = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
    let cross = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
    };
    let mut doubled = [0.0; 3];
    let mut outline = 0.0;
    for i in 0..polygon.len() {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        outline += norm(sub(b, a));
        let piece = cross(sub(a, polygon[0]), sub(b, polygon[0]));
        (0..3).for_each(|k| doubled[k] += piece[k]);
    }
    (norm(doubled) / 2.0, outline)
}

fn difference(mesh: &Mesh, expected: &Expected) -> Option<String> {
    let mut whole = expected.whole.clone();
    let mut pieces: Vec<[[f64; 3]; 3]> = Vec::new();
    for t in &mesh.triangles {
        let t = canonical(t.map(|v| mesh.positions[v as usize]));
        match whole.get_mut(&t) {
            Some(count) if *count > 0 => *count -= 1,
            _ => pieces.push(t.map(|p| p.map(f64::from))),
        }
    }
    let missing: i64 = whole.values().sum();
    if missing > 0 {
        return Some(format!("{missing} triangles of the input are missing"));
    }
    let on_input = Target::new(expected.crossing.iter().copied());
    for piece in &pieces {
        let middle = std::array::from_fn(|k| (piece[0][k] + piece[1][k] + piece[2][k]) / 3.0);
        let farthest =
            piece.iter().chain([&middle]).map(|p| on_input.distance(*p)).fold(0.0, f64::max);
        if farthest > ROUNDING_STEPS {
            return Some(format!("triangle {piece:?} is not in the input ({farthest} steps away)"));
        }
    }
    let area: f64 = pieces.iter().map(|p| area_and_outline(p).0).sum();
    if (area - expected.crossing_area).abs() > expected.area_slack {
        let (found, wanted) = (area, expected.crossing_area);
        return Some(format!(
            "cut triangles have an area of {found}, the input's {wanted} (square steps)"
        ));
    }
    None
}

#[cfg(test)]
mod tests {
    use hlod_compress::OctNormal;

    use super::*;

    fn mesh(triangles: &[Corners]) -> Mesh {
        Mesh {
            positions: triangles.concat(),
            normals: vec![OctNormal::default(); 3 * triangles.len()],
            colours: Vec::new(),
            scalars: Vec::new(),
            triangles: (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        }
    }

    const T: Corners = [[10, 10, 0], [50, 10, 0], [10, 60, 9]];

    fn expect(whole: &[Corners], crossing: &[Corners]) -> Expected {
        let mut e = Expected::default();
        for t in whole {
            *e.whole.entry(canonical(*t)).or_default() += 1;
        }
        for t in crossing {
            let t = t.map(|p| p.map(f64::from));
            e.crossing_area += area_and_outline(&t).0;
            e.area_slack += area_and_outline(&t).1;
            e.crossing.push(t);
        }
        e
    }

    #[test]
    fn equal_leaves_pass_and_every_planted_change_is_caught() {
        let rotated = [T[1], T[2], T[0]];
        assert_eq!(difference(&mesh(&[rotated]), &expect(&[T], &[])), None);
        assert_eq!(difference(&mesh(&[T]), &expect(&[], &[T])), None);
        // Missing, doubled, turned over, moved by two steps, invented.
        assert!(difference(&mesh(&[]), &expect(&[T], &[])).is_some());
        assert!(difference(&mesh(&[]), &expect(&[], &[T])).is_some());
        assert!(difference(&mesh(&[T, T]), &expect(&[T], &[])).is_some());
        assert!(difference(&mesh(&[[T[0], T[2], T[1]]]), &expect(&[T], &[])).is_some());
        let moved = T.map(|p| [p[0], p[1], p[2] + 2]);
        assert!(difference(&mesh(&[moved]), &expect(&[T], &[])).is_some());
        assert!(difference(&mesh(&[moved]), &expect(&[], &[T])).is_some());
    }
}
