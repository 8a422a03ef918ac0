//! How far a mesh is from a reference, by samples: the figures that papers and tools report.
//!
//! Uses the same independent distances as [`crate::verify`], nothing of the builder. After
//! Cignoni, Rocchini & Scopigno, *Metro: measuring error on simplified surfaces* (1998):
//! vertices, edges and faces are sampled, both ways.

use std::path::Path;

use glam::{DVec3, Vec3};
use hlod_scan::ScanMesh;
use rayon::prelude::*;
use serde::Serialize;

use crate::error::BuildError;
use crate::progress::{Progress, Unit};
use crate::verify::distance::Target;

/// Distances in the unit of the files, angles in degrees; the keys are stable.
#[derive(Debug, Serialize)]
pub struct CompareReport {
    /// Triangles of the reference.
    pub triangles_reference: u64,
    /// Triangles of the other mesh.
    pub triangles: u64,
    /// Diagonal of the reference's bounding box.
    pub diagonal: f64,
    /// From the reference to the mesh.
    pub forward: Direction,
    /// From the mesh to the reference.
    pub backward: Direction,
    /// The larger of the two largest distances: a lower bound of the Hausdorff distance.
    pub hausdorff: f64,
    /// The larger of the two root mean squares.
    pub rms: f64,
    /// Angle between face normals at samples of the mesh and the nearest points of the
    /// reference: mean and 95th percentile over the mesh's area.
    pub face_normal_deg: NormalDeviation,
    /// The same of the reference's vertex normals, interpolated, against the mesh's: what shading
    /// shows.
    pub shading_normal_deg: NormalDeviation,
}

/// Distances in one direction.
#[derive(Debug, Serialize)]
pub struct Direction {
    /// Largest.
    pub max: f64,
    /// Root mean square over area.
    pub rms: f64,
}

/// Angles in degrees.
#[derive(Debug, Serialize)]
pub struct NormalDeviation {
    /// Mean.
    pub mean: f64,
    /// 95th percentile.
    pub p95: f64,
}

/// Compares `mesh` with `reference`: `samples` points on faces, chosen by area and the same
/// every time, and all vertices and middles of edges.
///
/// # Errors
/// When a file cannot be read or has no triangles.
pub fn compare(
    reference: &Path,
    mesh: &Path,
    samples: u32,
    progress: &dyn Progress,
) -> Result<CompareReport, BuildError> {
    progress.begin("compare", 4, Unit::Steps);
    let load = |path: &Path| hlod_scan::load(&[path.to_owned()], &mut |_, _| {});
    let (reference, mesh) = (load(reference)?, load(mesh)?);
    let [to_reference, to_mesh] = [&reference, &mesh].map(target);
    progress.advance(1);
    let forward = points(&reference, samples);
    let backward = points(&mesh, samples);
    progress.advance(1);
    let (forward_distances, mut shading) = measure(&forward, &mesh, &to_mesh, shading_angle);
    progress.advance(1);
    let (backward_distances, mut faces) = measure(&backward, &reference, &to_reference, face_angle);
    progress.advance(1);
    progress.end();
    let (forward, backward) =
        (direction(&forward, &forward_distances), direction(&backward, &backward_distances));
    let bounds = reference
        .positions
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    Ok(CompareReport {
        triangles_reference: reference.triangles.len() as u64,
        triangles: mesh.triangles.len() as u64,
        diagonal: (bounds.1 - bounds.0).length(),
        hausdorff: forward.max.max(backward.max),
        rms: forward.rms.max(backward.rms),
        forward,
        backward,
        face_normal_deg: deviation(&mut faces),
        shading_normal_deg: deviation(&mut shading),
    })
}

fn target(mesh: &ScanMesh) -> Target {
    let corners = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize].to_array());
    Target::new(mesh.triangles.iter().map(corners))
}

/// A point on a surface.
struct Sample {
    position: DVec3,
    face_normal: Vec3,
    shading_normal: Vec3,
    /// Whether it was chosen by area: only these count in means.
    by_area: bool,
}

fn face_normal(mesh: &ScanMesh, triangle: usize) -> Vec3 {
    let [a, b, c] = mesh.triangles[triangle].map(|v| mesh.positions[v as usize]);
    (b - a).cross(c - a).normalize_or_zero().as_vec3()
}

fn points(mesh: &ScanMesh, samples: u32) -> Vec<Sample> {
    let areas: Vec<f64> = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            (b - a).cross(c - a).length() * 0.5
        })
        .collect();
    let step = areas.iter().sum::<f64>() / f64::from(samples.max(1));
    let mut out = Vec::new();
    // Evenly along the sum of areas; inside a triangle by the golden ratio's plastic relatives
    // (Roberts 2018, R₂ sequence).
    let (mut sum, mut next, mut number) = (0.0, step * 0.5, 0u32);
    for (t, (corners, area)) in mesh.triangles.iter().zip(&areas).enumerate() {
        let normal = face_normal(mesh, t);
        let positions = corners.map(|v| mesh.positions[v as usize]);
        let normals = corners.map(|v| mesh.normals[v as usize]);
        let mut add = |weights: [f64; 3], by_area: bool| {
            let position = (0..3).map(|k| positions[k] * weights[k]).sum();
            let shading: Vec3 = (0..3).map(|k| normals[k] * weights[k] as f32).sum();
            let shading_normal = shading.normalize_or(normal);
            out.push(Sample { position, face_normal: normal, shading_normal, by_area });
        };
        sum += area;
        while next <= sum && step > 0.0 {
            number += 1;
            let [u, v] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2]
                .map(|r| (0.5 + r * f64::from(number)).fract());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            add([1.0 - u - v, u, v], true);
            next += step;
        }
        // Each corner once a triangle: vertices come up several times, which does no harm.
        for k in 0..3 {
            let corner = std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
            let middle = std::array::from_fn(|i| if i == k { 0.0 } else { 0.5 });
            add(corner, false);
            add(middle, false);
        }
    }
    out
}

/// Distances of samples from a mesh, and angles of those chosen by area that have one.
fn measure(
    samples: &[Sample],
    mesh: &ScanMesh,
    target: &Target,
    angle: fn(&Sample, &ScanMesh, usize) -> f32,
) -> (Vec<f64>, Vec<f32>) {
    let found: Vec<(f64, Option<f32>)> = samples
        .par_iter()
        .map(|sample| {
            let (distance, triangle) = target.nearest(sample.position.to_array());
            (distance, sample.by_area.then(|| angle(sample, mesh, triangle)))
        })
        .collect();
    // The nearest triangle may be degenerate: it has no normal to compare with.
    let angles = found.iter().filter_map(|f| f.1).filter(|angle| !angle.is_nan());
    (found.iter().map(|f| f.0).collect(), angles.collect())
}

fn face_angle(sample: &Sample, mesh: &ScanMesh, triangle: usize) -> f32 {
    sample.face_normal.angle_between(face_normal(mesh, triangle)).to_degrees()
}

fn shading_angle(sample: &Sample, mesh: &ScanMesh, triangle: usize) -> f32 {
    let corners = mesh.triangles[triangle].map(|v| mesh.positions[v as usize]);
    let weights = barycentric(sample.position, corners);
    let normal: Vec3 = mesh.triangles[triangle]
        .iter()
        .zip(weights)
        .map(|(&v, w)| mesh.normals[v as usize] * w as f32)
        .sum();
    let angle = sample.shading_normal.angle_between(normal.normalize_or(sample.shading_normal));
    angle.to_degrees()
}

/// Of the projection into the triangle's plane, clamped to the triangle.
fn barycentric(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let normal = (b - a).cross(c - a);
    let area2 = normal.length_squared();
    if area2 == 0.0 {
        return [1.0 / 3.0; 3];
    }
    let weight = |q: DVec3, r: DVec3| (normal.dot((r - q).cross(p - q)) / area2).max(0.0);
    let weights = [weight(b, c), weight(c, a), weight(a, b)];
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

fn direction(samples: &[Sample], distances: &[f64]) -> Direction {
    let by_area = samples.iter().zip(distances).filter(|(s, _)| s.by_area);
    let (sum, count) = by_area.fold((0.0, 0u64), |(sum, n), (_, d)| (sum + d * d, n + 1));
    Direction {
        max: distances.iter().copied().fold(0.0, f64::max),
        rms: (sum / count.max(1) as f64).sqrt(),
    }
}

fn deviation(angles: &mut [f32]) -> NormalDeviation {
    angles.sort_by(f32::total_cmp);
    let at = ((angles.len() as f64 - 1.0) * 0.95).round().max(0.0) as usize;
    NormalDeviation {
        mean: angles.iter().map(|&a| f64::from(a)).sum::<f64>() / angles.len().max(1) as f64,
        p95: angles.get(at).map_or(0.0, |&a| f64::from(a)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    fn write(folder: &Path, name: &str, height: f64, tilt: f64) -> std::path::PathBuf {
        let path = folder.join(name);
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
             property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
             0 0 {height}\n4 0 {height}\n4 4 {top}\n0 4 {top}\n3 0 1 2\n3 0 2 3\n",
            top = height + tilt
        );
        std::fs::write(&path, text).expect("the folder can be written to");
        path
    }

    #[test]
    fn known_offsets_and_angles_are_found() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let flat = write(folder.path(), "flat.ply", 0.0, 0.0);
        let above = write(folder.path(), "above.ply", 0.5, 0.0);
        let tilted = write(folder.path(), "tilted.ply", 0.0, 4.0 * 10f64.to_radians().tan());
        let of = |mesh: &Path| compare(&flat, mesh, 1000, &Silent).expect("both are meshes");
        let report = of(&above);
        assert!((report.hausdorff - 0.5).abs() < 1e-6 && (report.rms - 0.5).abs() < 1e-6);
        assert!(report.face_normal_deg.p95 < 1e-3);
        let report = of(&tilted);
        // Backward, straight down; a mean of squares along the slope.
        let top = 4.0 * 10f64.to_radians().tan();
        assert!((report.backward.max - top).abs() < 1e-5, "{report:?}");
        assert!((report.backward.rms - top / 3f64.sqrt()).abs() < 0.02 * top, "{report:?}");
        assert!((report.face_normal_deg.mean - 10.0).abs() < 0.01, "{report:?}");
        assert!((report.shading_normal_deg.mean - 10.0).abs() < 0.01, "{report:?}");
        let report = of(&flat);
        assert!(report.hausdorff < 1e-9 && report.face_normal_deg.mean < 1e-3);
    }
}
