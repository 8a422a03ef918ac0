//! From scan files to one indexed mesh on the lattice.

use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use glam::DVec3;
use hlod_compress::{Lattice, Mesh, OctNormal, SourceFile};
use hlod_scan::{ScanMesh, ScanReport};
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::error::BuildError;
use crate::progress::{Progress, Unit};

/// A scan in memory, in its own coordinates.
pub struct Scan {
    /// Vertices and triangles of all inputs together.
    pub mesh: ScanMesh,
    /// What identifies the inputs.
    pub sources: Vec<SourceFile>,
}

/// A scan on the lattice of the file to be written.
pub struct Model {
    /// The lattice.
    pub lattice: Lattice,
    /// All triangles with an area, on the lattice.
    pub mesh: Mesh,
    /// Where the lattice's step comes from.
    pub precision: Precision,
    /// Triangles without an area on the lattice, left out.
    pub triangles_degenerate: u64,
    /// Whether the surface bounds a volume and faces outwards.
    pub closed_oriented: bool,
}

/// Where the precision of the leaves comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// `--precision`.
    Declared,
    /// The scan's coordinates are multiples of it.
    Detected,
    /// A sixteenth of the short edges (tenth percentile) of the scan.
    Estimated,
}

/// Reads all inputs as one model.
///
/// # Errors
/// When an input cannot be read or is not a usable scan.
pub fn read_scan(inputs: &[PathBuf], progress: &dyn Progress) -> Result<Scan, BuildError> {
    let total = |path: &PathBuf| std::fs::metadata(path).map_or(0, |m| m.len());
    progress.begin("read", inputs.iter().map(total).sum(), Unit::Bytes);
    let mut reported = 0;
    let mesh = hlod_scan::load(inputs, &mut |done, _total| {
        progress.advance(done.saturating_sub(reported));
        reported = reported.max(done);
    })?;
    progress.end();
    let sources = inputs.par_iter().map(|p| identify(p)).collect::<Result<_, _>>()?;
    Ok(Scan { mesh, sources })
}

/// Name, size and SHA-256 of an input.
pub(crate) fn identify(path: &Path) -> Result<SourceFile, BuildError> {
    let mut file = File::open(path).map_err(BuildError::io(path, "open"))?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 18];
    let mut file_bytes = 0;
    loop {
        let count = file.read(&mut buffer).map_err(BuildError::io(path, "read"))?;
        if count == 0 {
            break;
        }
        hash.update(&buffer[..count]);
        file_bytes += count as u64;
    }
    let base_name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(SourceFile { base_name, file_bytes, sha256: hash.finalize().into() })
}

impl Scan {
    /// Rounds the scan to a lattice of `declared` steps, or one that suits it.
    ///
    /// # Errors
    /// When no triangle keeps an area.
    pub fn place_on_lattice(
        self,
        declared: Option<f64>,
        input: &Path,
    ) -> Result<(Model, Vec<SourceFile>, Vec<ScanReport>), BuildError> {
        let Scan { mesh: scan, sources } = self;
        let (step, precision) = match declared {
            Some(step) => (step, Precision::Declared),
            None => {
                let estimated = estimate_step(&scan);
                // A far finer grid is the last decimal of a text, not what was measured.
                match detect_grid_step(&scan.positions).filter(|step| *step > estimated / 8.0) {
                    Some(step) => (step, Precision::Detected),
                    None => (estimated, Precision::Estimated),
                }
            }
        };
        let min = scan.positions.iter().fold(DVec3::INFINITY, |a, &p| a.min(p));
        let max = scan.positions.iter().fold(DVec3::NEG_INFINITY, |a, &p| a.max(p));
        let lattice = Lattice::enclosing(min.to_array(), max.to_array(), step);

        let positions: Vec<[i32; 3]> =
            scan.positions.par_iter().map(|p| lattice.quantise(p.to_array())).collect();
        let has_area = |t: &&[u32; 3]| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            a != b && b != c && c != a
        };
        let triangles: Vec<[u32; 3]> = scan.triangles.iter().filter(has_area).copied().collect();
        let triangles_degenerate = (scan.triangles.len() - triangles.len()) as u64;
        if triangles.is_empty() {
            let (path, triangles) = (input.to_owned(), scan.triangles.len() as u64);
            return Err(BuildError::NothingLeft { path, triangles, step: lattice.step });
        }
        let normals = scan.normals.par_iter().map(|n| OctNormal::encode(n.to_array())).collect();
        let mesh = Mesh { positions, normals, colours: scan.colours, triangles };
        let closed_oriented = bounds_a_volume(&mesh);
        let model = Model { lattice, mesh, precision, triangles_degenerate, closed_oriented };
        Ok((model, sources, scan.reports))
    }
}

/// The step of which all coordinates are multiples (after an offset), for scans that were
/// quantised when they were made; `None` for others.
fn detect_grid_step(positions: &[DVec3]) -> Option<f64> {
    const SAMPLES: usize = 1 << 17;
    let stride = positions.len().div_ceil(SAMPLES).max(1);
    let mut steps = [0.0; 3];
    for (axis, step) in steps.iter_mut().enumerate() {
        let mut values: Vec<f64> = positions.iter().step_by(stride).map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        *step = grid_step_of_sorted(&values)?;
    }
    let (smallest, largest) =
        steps.iter().fold((f64::INFINITY, 0.0f64), |(lo, hi), &s| (lo.min(s), hi.max(s)));
    // A scanner that quantises does so alike on all axes.
    (largest <= smallest * 1.001).then_some(smallest)
}

fn grid_step_of_sorted(values: &[f64]) -> Option<f64> {
    let (first, last) = (*values.first()?, *values.last()?);
    // Coordinates come as f32, or as decimals of about that precision.
    let noise = first.abs().max(last.abs()) * f64::from(f32::EPSILON);
    let distinct = values.windows(2).map(|w| w[1] - w[0]).filter(|&gap| gap > 2.0 * noise);
    let mut step = distinct.fold(f64::INFINITY, f64::min);
    if !step.is_finite() || step < 32.0 * noise {
        return None;
    }
    // Grow outwards from the first value, refining the step by ever longer distances.
    let mut multiples = 0u64;
    for &value in values {
        let distance = value - first;
        let multiple = (distance / step).round();
        if (distance - multiple * step).abs() > 0.1 * step {
            return None;
        }
        if multiple >= 1.0 {
            multiples += 1;
            step = distance / multiple;
        }
    }
    // A handful of coordinates (a cube's) would pass by chance.
    (multiples > 1000).then_some(step)
}

/// A sixteenth of the tenth percentile of edge lengths: far below what a scanner resolves.
fn estimate_step(scan: &ScanMesh) -> f64 {
    const SAMPLES: usize = 100_000;
    let stride = scan.triangles.len().div_ceil(SAMPLES).max(1);
    let mut lengths: Vec<f64> = scan
        .triangles
        .iter()
        .step_by(stride)
        .map(|t| scan.positions[t[0] as usize].distance(scan.positions[t[1] as usize]))
        .filter(|&length| length > 0.0)
        .collect();
    lengths.sort_by(f64::total_cmp);
    lengths.get(lengths.len() / 10).map_or(1.0, |short| short / 16.0)
}

/// Whether every directed edge has as many opposites, position by position, and the volume
/// inside is positive: then nobody outside ever sees a back.
fn bounds_a_volume(mesh: &Mesh) -> bool {
    let mut id_of: HashMap<[i32; 3], u32> = HashMap::with_capacity(mesh.positions.len());
    let ids: Vec<u32> = mesh
        .positions
        .iter()
        .map(|&p| {
            let next = id_of.len() as u32;
            *id_of.entry(p).or_insert(next)
        })
        .collect();
    let mut edges: Vec<(u32, u32, bool)> = mesh
        .triangles
        .iter()
        .flat_map(|t| {
            let t = t.map(|v| ids[v as usize]);
            [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]
        })
        .map(|(a, b)| (a.min(b), a.max(b), a < b))
        .collect();
    edges.par_sort_unstable();
    let closed = edges
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .all(|edge| 2 * edge.iter().filter(|e| e.2).count() == edge.len());
    let volume: f64 = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| DVec3::from_array(mesh.positions[v as usize].map(f64::from)));
            a.dot(b.cross(c))
        })
        .sum();
    closed && volume > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid_points(step: f64, offset: f64) -> Vec<DVec3> {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            offset + step * f64::from((state >> 51) as u32)
        };
        let points = (0..20_000).map(|_| DVec3::new(next(), next(), next()));
        // Through f32, as scans come.
        points.map(|p| p.as_vec3().as_dvec3()).collect()
    }

    #[test]
    fn the_step_of_a_quantised_scan_is_found() {
        for (step, offset) in [(1.0 / 8191.0, -0.3), (0.25, 100.0), (3e-6, 0.01)] {
            let found = detect_grid_step(&grid_points(step, offset)).unwrap();
            assert!((found / step - 1.0).abs() < 1e-4, "{found} for {step}");
        }
    }

    #[test]
    fn other_scans_have_no_step() {
        let mut points = grid_points(1.0, 0.0);
        points.iter_mut().enumerate().for_each(|(i, p)| *p += 0.3 * (i as f64 * 0.7).sin());
        assert_eq!(detect_grid_step(&points), None);
        assert_eq!(detect_grid_step(&[DVec3::ZERO, DVec3::ONE]), None);
        assert_eq!(detect_grid_step(&[]), None);
    }

    fn tetrahedron(flip: bool) -> Mesh {
        let mut triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        if flip {
            triangles.iter_mut().for_each(|t| t.swap(0, 1));
        }
        Mesh {
            positions: vec![[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]],
            normals: vec![OctNormal::default(); 4],
            colours: Vec::new(),
            triangles,
        }
    }

    #[test]
    fn only_closed_outward_surfaces_bound_a_volume() {
        assert!(bounds_a_volume(&tetrahedron(false)));
        assert!(!bounds_a_volume(&tetrahedron(true)));
        let mut open = tetrahedron(false);
        open.triangles.pop();
        assert!(!bounds_a_volume(&open));
        let mut inconsistent = tetrahedron(false);
        inconsistent.triangles[1].swap(0, 1);
        assert!(!bounds_a_volume(&inconsistent));
    }
}
