//! What identifies a scan, and how finely its leaves are kept.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use glam::DVec3;
use hlod_compress::SourceFile;
use sha2::{Digest, Sha256};

use crate::error::BuildError;
use crate::spill::RecordReader;
use crate::steps::ingest::ScanVertex;

/// Where the precision of the leaves comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// `--precision`.
    Declared,
    /// The scan's coordinates are multiples of it.
    Detected,
    /// A sixteenth of the short edges (tenth percentile) of the scan, or of the short distances between
    /// points of a cloud.
    Estimated,
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

/// The step of the leaves' lattice: as `declared`, or one that suits the scan.
pub(crate) fn choose_step(
    vertices: &Path,
    triangles: &Path,
    declared: Option<f64>,
) -> Result<(f64, Precision), BuildError> {
    if let Some(step) = declared {
        return Ok((step, Precision::Declared));
    }
    let estimated = estimate_step(vertices, triangles)?;
    detected_or(vertices, estimated)
}

/// The same of a point cloud.
pub(crate) fn choose_cloud_step(
    vertices: &Path,
    declared: Option<f64>,
) -> Result<(f64, Precision), BuildError> {
    if let Some(step) = declared {
        return Ok((step, Precision::Declared));
    }
    let estimated = estimate_cloud_step(vertices)?;
    detected_or(vertices, estimated)
}

fn detected_or(vertices: &Path, estimated: f64) -> Result<(f64, Precision), BuildError> {
    let count = RecordReader::<ScanVertex>::open(vertices)?.left();
    let stride = count.div_ceil(POSITION_SAMPLES).max(1);
    let sampled = RecordReader::<ScanVertex>::at(vertices, (0..count).step_by(stride as usize))?;
    let positions: Vec<[f64; 3]> = sampled.iter().map(|v| v.position).collect();
    // A far finer grid is the last decimal of a text, not what was measured.
    Ok(match detect_grid_step(&positions).filter(|step| *step > estimated / 8.0) {
        Some(step) => (step, Precision::Detected),
        None => (estimated, Precision::Estimated),
    })
}

const POSITION_SAMPLES: u64 = 1 << 17;
const EDGE_SAMPLES: u64 = 100_000;

/// The step of which all coordinates are multiples (after an offset), for scans that were
/// quantised when they were made; `None` for others.
fn detect_grid_step(positions: &[[f64; 3]]) -> Option<f64> {
    let mut steps = [0.0; 3];
    for (axis, step) in steps.iter_mut().enumerate() {
        let mut values: Vec<f64> = positions.iter().map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        // Coordinates come as f32 or as decimals of about that precision; if not, as f64, by which a grid
        // shows far from the origin too.
        *step = grid_step_of_sorted(&values, f32::EPSILON.into())
            .or_else(|| grid_step_of_sorted(&values, 4.0 * f64::EPSILON))?;
    }
    let (smallest, largest) =
        steps.iter().fold((f64::INFINITY, 0.0f64), |(lo, hi), &s| (lo.min(s), hi.max(s)));
    // A scanner that quantises does so alike on all axes.
    (largest <= smallest * 1.001).then_some(smallest)
}

/// `noise` is what coordinates are rounded by, relative to the largest.
fn grid_step_of_sorted(values: &[f64], noise: f64) -> Option<f64> {
    let (first, last) = (*values.first()?, *values.last()?);
    let noise = first.abs().max(last.abs()) * noise;
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
fn estimate_step(vertices: &Path, triangles: &Path) -> Result<f64, BuildError> {
    let count = RecordReader::<[u32; 3]>::open(triangles)?.left();
    let stride = count.div_ceil(EDGE_SAMPLES).max(1);
    let sampled = RecordReader::<[u32; 3]>::at(triangles, (0..count).step_by(stride as usize))?;
    // Vertices in the order of the file, so that it is read from front to back.
    let mut wanted: Vec<u64> = sampled.iter().flat_map(|t| [t[0], t[1]]).map(u64::from).collect();
    wanted.sort_unstable();
    wanted.dedup();
    let found = RecordReader::<ScanVertex>::at(vertices, wanted.iter().copied())?;
    let position = |v: u32| {
        let i = wanted.partition_point(|&w| w < u64::from(v));
        DVec3::from_array(found[i].position)
    };
    let mut lengths: Vec<f64> = sampled
        .iter()
        .map(|t| position(t[0]).distance(position(t[1])))
        .filter(|&length| length > 0.0)
        .collect();
    lengths.sort_by(f64::total_cmp);
    Ok(lengths.get(lengths.len() / 10).map_or(1.0, |short| short / 16.0))
}

/// A sixteenth of the tenth percentile of distances to the nearest neighbour, judged from points of a
/// few small boxes of the cloud.
fn estimate_cloud_step(vertices: &Path) -> Result<f64, BuildError> {
    let mut reader = RecordReader::<ScanVertex>::open(vertices)?;
    let count = reader.left();
    let middles = (0..BOXES).map(|i| (2 * i + 1) * count / (2 * BOXES));
    let middles: Vec<DVec3> = RecordReader::<ScanVertex>::at(vertices, middles)?
        .iter()
        .map(|v| DVec3::from_array(v.position))
        .collect();
    // The nearest to each of a few middles: all neighbours of most of them are among them.
    let mut near: Vec<Vec<(f64, DVec3)>> = vec![Vec::new(); middles.len()];
    while reader.left() > 0 {
        for vertex in reader.next(1 << 16)? {
            let position = DVec3::from_array(vertex.position);
            for (middle, near) in middles.iter().zip(&mut near) {
                let distance = position.distance_squared(*middle);
                if near.len() == 2 * BOX_POINTS {
                    near.select_nth_unstable_by(BOX_POINTS, |a, b| a.0.total_cmp(&b.0));
                    near.truncate(BOX_POINTS);
                }
                near.push((distance, position));
            }
        }
    }
    let mut distances = Vec::new();
    for near in &mut near {
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(BOX_POINTS);
        for (i, (_, at)) in near.iter().take(BOX_POINTS / 2).enumerate() {
            let others = near.iter().enumerate().filter(|(k, _)| *k != i);
            let nearest = others.map(|(_, (_, p))| p.distance(*at)).filter(|d| *d > 0.0);
            distances.extend(nearest.min_by(f64::total_cmp));
        }
    }
    distances.sort_by(f64::total_cmp);
    Ok(distances.get(distances.len() / 10).map_or(1.0, |short| short / 16.0))
}

/// Places at which a cloud is judged, and points there.
const BOXES: u64 = 16;
const BOX_POINTS: usize = 256;

#[cfg(test)]
mod tests {
    use super::*;

    fn grid_points(step: f64, offset: f64) -> Vec<[f64; 3]> {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            offset + step * f64::from((state >> 51) as u32)
        };
        let points = (0..20_000).map(|_| DVec3::new(next(), next(), next()));
        // Through f32, as scans come.
        points.map(|p| p.as_vec3().as_dvec3().to_array()).collect()
    }

    #[test]
    fn the_step_of_a_quantised_scan_is_found() {
        for (step, offset) in [(1.0 / 8191.0, -0.3), (0.25, 100.0), (3e-6, 0.01)] {
            let found = detect_grid_step(&grid_points(step, offset)).unwrap();
            assert!((found / step - 1.0).abs() < 1e-4, "{found} for {step}");
        }
        // Far away, in f64: only f64 still tells its multiples apart.
        let (far, step) = (5_412_345.7, 0.0021);
        let moved = |p: &[f64; 3]| p.map(|x| (x * 8191.0).round() * step + far);
        let points: Vec<[f64; 3]> = grid_points(1.0 / 8191.0, 0.0).iter().map(moved).collect();
        let found = detect_grid_step(&points).unwrap();
        assert!((found / step - 1.0).abs() < 1e-8, "{found}");
        let as_f32: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| f64::from(x as f32))).collect();
        let found = detect_grid_step(&as_f32);
        assert!(found.is_none_or(|found| found > 0.1), "{found:?}");
    }

    #[test]
    fn other_scans_have_no_step() {
        let mut points = grid_points(1.0, 0.0);
        for (i, p) in points.iter_mut().enumerate() {
            *p = p.map(|c| c + 0.3 * (i as f64 * 0.7).sin());
        }
        assert_eq!(detect_grid_step(&points), None);
        assert_eq!(detect_grid_step(&[[0.0; 3], [1.0; 3]]), None);
        assert_eq!(detect_grid_step(&[]), None);
    }
}
