//! Normals of points that have none: estimated from their neighbours.
//!
//! A normal is across the plane that fits a point's nearest neighbours (H. Hoppe et al., *Surface
//! reconstruction from unorganized points*, 1992, section 3.2). Which of its two sides is out is told by
//! where the scanner stood, where the cloud knows; otherwise neighbours agree along a minimum
//! spanning tree of differences of normals (section 3.3), and each connected part then faces away from
//! its middle, as bodies do, or, where it is flat, along the axis that it faces most.
//!
//! All points are in memory at a time.

use std::num::NonZero;
use std::path::Path;

use glam::{DMat3, DVec3};
use hlod_scan::Station;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::ingest::{ScanVertex, VERTICES};
use super::work_folder::WorkFolder;
use crate::error::BuildError;
use crate::progress::{Progress, Unit};
use crate::spill::{RecordReader, RecordWriter};

/// Points that a plane is fitted to, the point itself included.
pub(crate) const NEIGHBOURS: usize = 16;
/// Of these the nearest ones are asked which side is out.
const LINKS: usize = 8;
/// Memory that a point takes: places, tree, normals and links.
const BYTES_A_POINT: u64 = 270;
/// Parts are flat where facing away from the middle is right for so little more than it is wrong.
const FLAT_SHARE: f64 = 0.02;

/// Estimates the normals of all points without one, in the file of vertices. Gives how many there are,
/// and whether scanners told which side is out.
pub(crate) fn estimate(
    folder: &WorkFolder,
    path: &Path,
    stations: &[Station],
    memory_bytes: usize,
    progress: &dyn Progress,
) -> Result<(u64, bool), BuildError> {
    let file = folder.file(VERTICES);
    let count = RecordReader::<ScanVertex>::open(&file)?.left();
    let needed_bytes = count.saturating_mul(BYTES_A_POINT);
    if needed_bytes > memory_bytes as u64 {
        return Err(BuildError::Memory {
            path: path.to_owned(),
            why: "points have no normals, and estimating these needs all points at a time (give more, or \
                  compute normals first, in CloudCompare by Edit > Normals > Compute)",
            needed_bytes: crate::memory::Memory::budget_of(needed_bytes),
            budget_bytes: crate::memory::Memory::budget_of(memory_bytes as u64),
        });
    }
    progress.begin("normals", count, Unit::Points);
    let vertices = RecordReader::<ScanVertex>::all(&file)?;
    folder.check_stop(progress)?;
    let (places, place_of) = places(&vertices);
    if places.len() < NEIGHBOURS {
        let lacking = vertices.iter().filter(|v| v.normal == [0.0; 3]).count() as u64;
        return Err(BuildError::NoNormals { path: path.to_owned(), lacking, points: count });
    }
    let mut known = vec![[0.0f32; 3]; places.len()];
    let mut seen_from = vec![None; places.len()];
    let mut station = stations.iter().peekable();
    let mut current = None;
    for (i, vertex) in vertices.iter().enumerate() {
        while let Some(next) = station.next_if(|next| next.first_vertex <= i as u64) {
            current = next.position;
        }
        let place = place_of[i] as usize;
        if vertex.normal != [0.0; 3] {
            known[place] = vertex.normal;
        }
        seen_from[place] = seen_from[place].or(current);
    }
    drop(vertices);
    let mut normals = fit(&places, progress);
    let by_scanner = seen_from.iter().all(Option::is_some);
    if by_scanner {
        towards(&mut normals, &places, &seen_from);
    } else {
        drop(seen_from);
        agree(&mut normals, &places, &known);
    }
    folder.check_stop(progress)?;
    let estimated = write(folder, &place_of, &normals)?;
    progress.end();
    Ok((estimated, by_scanner))
}

/// Different positions, sorted, and which one each vertex has.
fn places(vertices: &[ScanVertex]) -> (Vec<[f64; 3]>, Vec<u32>) {
    let order = |a: &[f64; 3], b: &[f64; 3]| {
        let axes = a.iter().zip(b).map(|(a, b)| a.total_cmp(b));
        axes.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
    };
    // Adding zero turns −0 into 0.
    let position = |v: &ScanVertex| v.position.map(|x| x + 0.0);
    let mut places: Vec<[f64; 3]> = vertices.iter().map(position).collect();
    places.par_sort_unstable_by(order);
    places.dedup();
    let place_of = vertices.par_iter().map(|v| {
        let found = places.binary_search_by(|place| order(place, &position(v)));
        found.unwrap_or_default() as u32
    });
    let place_of = place_of.collect();
    (places, place_of)
}

/// Across the plane of the neighbours, either way.
fn fit(places: &[[f64; 3]], progress: &dyn Progress) -> Vec<DVec3> {
    const WANTED: NonZero<usize> = NonZero::new(NEIGHBOURS).unwrap();
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(places);
    let fit_one = |place: &[f64; 3]| {
        let found = tree.nearest_n::<SquaredEuclidean>(place, WANTED);
        let near = found.iter().map(|near| DVec3::from_array(places[near.item as usize]));
        // Relative to the point: far from the origin the products would cancel.
        let near: Vec<DVec3> = near.map(|p| p - DVec3::from_array(*place)).collect();
        normal_of(&near)
    };
    let chunks = places.par_chunks(1 << 14).map(|chunk| {
        progress.advance(chunk.len() as u64);
        chunk.iter().map(fit_one).collect::<Vec<DVec3>>()
    });
    chunks.collect::<Vec<_>>().concat()
}

/// The direction in which points spread least; +z for points that are all in one place.
fn normal_of(points: &[DVec3]) -> DVec3 {
    let middle = points.iter().sum::<DVec3>() / points.len() as f64;
    let scale = points.iter().map(|p| (*p - middle).abs().max_element()).fold(0.0, f64::max);
    if scale == 0.0 {
        return DVec3::Z;
    }
    let spread = points.iter().fold(DMat3::ZERO, |sum, p| {
        let p = (*p - middle) / scale;
        sum + DMat3::from_cols(p * p.x, p * p.y, p * p.z)
    });
    least_eigenvector(spread)
}

/// Of a symmetric matrix, by rotations that take out one element after the other (C. G. J. Jacobi
/// 1846).
fn least_eigenvector(matrix: DMat3) -> DVec3 {
    let mut a = matrix.to_cols_array_2d();
    let mut vectors = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q].abs() <= f64::MIN_POSITIVE {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in a.iter_mut().chain(&mut vectors) {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            let (row_p, row_q) = (a[p], a[q]);
            a[p] = std::array::from_fn(|k| c * row_p[k] - s * row_q[k]);
            a[q] = std::array::from_fn(|k| s * row_p[k] + c * row_q[k]);
        }
    }
    let least = (0..3).min_by(|i, j| a[*i][*i].total_cmp(&a[*j][*j])).unwrap_or(2);
    DVec3::from_array([0, 1, 2].map(|row: usize| vectors[row][least])).normalize_or(DVec3::Z)
}

/// Each normal towards where its point was seen from.
fn towards(normals: &mut [DVec3], places: &[[f64; 3]], seen_from: &[Option<[f64; 3]>]) {
    for ((normal, place), from) in normals.iter_mut().zip(places).zip(seen_from) {
        let to_scanner = from.map(|from| DVec3::from_array(from) - DVec3::from_array(*place));
        if to_scanner.is_some_and(|to| normal.dot(to) < 0.0) {
            *normal = -*normal;
        }
    }
}

/// Neighbours that agree least surely are asked last.
fn links(places: &[[f64; 3]], normals: &[DVec3]) -> Vec<[u32; 3]> {
    const WANTED: NonZero<usize> = NonZero::new(LINKS + 1).unwrap();
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(places);
    let of_one = |(i, place): (usize, &[f64; 3])| -> Vec<[u32; 3]> {
        let found = tree.nearest_n::<SquaredEuclidean>(place, WANTED);
        let others = found.iter().map(|near| near.item as usize).filter(|other| *other != i);
        let link = |other: usize| {
            let unsure = 1.0 - normals[i].dot(normals[other]).abs();
            [(unsure * f64::from(1 << 30)) as u32, i.min(other) as u32, i.max(other) as u32]
        };
        others.map(link).collect()
    };
    let mut links: Vec<[u32; 3]> = places.par_iter().enumerate().flat_map_iter(of_one).collect();
    links.par_sort_unstable();
    links.dedup();
    links
}

/// Turns normals so that neighbours agree and parts face outwards, or as those that are `known`.
fn agree(normals: &mut [DVec3], places: &[[f64; 3]], known: &[[f32; 3]]) {
    let mut parts = Parts::new(places.len());
    for [_, a, b] in links(places, normals) {
        let differ = normals[a as usize].dot(normals[b as usize]) < 0.0;
        parts.join(a, b, differ);
    }
    let (mut sums, mut counts) = (vec![DVec3::ZERO; places.len()], vec![0u32; places.len()]);
    let mut root_of = vec![0u32; places.len()];
    for (i, place) in places.iter().enumerate() {
        let (root, is_turned) = parts.find(i as u32);
        root_of[i] = root;
        if is_turned {
            normals[i] = -normals[i];
        }
        sums[root as usize] += DVec3::from_array(*place);
        counts[root as usize] += 1;
    }
    let mut votes = vec![Vote::default(); places.len()];
    for (i, place) in places.iter().enumerate() {
        let root = root_of[i] as usize;
        let off = DVec3::from_array(*place) - sums[root] / f64::from(counts[root]);
        votes[root].add(normals[i], off, DVec3::from_array(known[i].map(f64::from)));
    }
    for (normal, root) in normals.iter_mut().zip(root_of) {
        if votes[root as usize].is_inwards() {
            *normal = -*normal;
        }
    }
}

/// Which way a connected part faces.
#[derive(Clone, Copy, Default)]
struct Vote {
    outwards: f64,
    most: f64,
    facing: DVec3,
    as_known: f64,
}

impl Vote {
    fn add(&mut self, normal: DVec3, off: DVec3, known: DVec3) {
        self.outwards += normal.dot(off);
        self.most += off.length();
        self.facing += normal;
        self.as_known += normal.dot(known);
    }

    fn is_inwards(&self) -> bool {
        if self.as_known != 0.0 {
            return self.as_known < 0.0;
        }
        if self.outwards.abs() > FLAT_SHARE * self.most {
            return self.outwards < 0.0;
        }
        self.facing[self.facing.abs().max_position()] < 0.0
    }
}

/// Joined sets that know whether a member's normal is turned against its root's.
struct Parts {
    parent: Vec<u32>,
    is_turned: Vec<bool>,
}

impl Parts {
    fn new(count: usize) -> Parts {
        Parts { parent: (0..count as u32).collect(), is_turned: vec![false; count] }
    }

    /// The root of a member, and whether it is turned against that. Halves the way there.
    fn find(&mut self, mut i: u32) -> (u32, bool) {
        let mut is_turned = false;
        loop {
            let parent = self.parent[i as usize];
            if parent == i {
                return (i, is_turned);
            }
            let above = self.parent[parent as usize];
            if above != parent {
                let turn = self.is_turned[i as usize] ^ self.is_turned[parent as usize];
                self.parent[i as usize] = above;
                self.is_turned[i as usize] = turn;
            }
            is_turned ^= self.is_turned[i as usize];
            i = self.parent[i as usize];
        }
    }

    /// Joins two sets where they are two; the lower root stays.
    fn join(&mut self, a: u32, b: u32, differ: bool) {
        let ((a, a_turned), (b, b_turned)) = (self.find(a), self.find(b));
        if a != b {
            let (root, other) = (a.min(b), a.max(b));
            self.parent[other as usize] = root;
            self.is_turned[other as usize] = a_turned ^ b_turned ^ differ;
        }
    }
}

/// Writes the vertices again, with normals for those without.
fn write(folder: &WorkFolder, place_of: &[u32], normals: &[DVec3]) -> Result<u64, BuildError> {
    let (file, aside) = (folder.file(VERTICES), folder.file("vertices.part"));
    let mut reader = RecordReader::<ScanVertex>::open(&file)?;
    let mut writer = RecordWriter::create(&aside)?;
    let (mut done, mut estimated) = (0, 0);
    while reader.left() > 0 {
        let mut batch = reader.next(1 << 16)?;
        for (vertex, place) in batch.iter_mut().zip(&place_of[done..]) {
            if vertex.normal == [0.0; 3] {
                vertex.normal = normals[*place as usize].as_vec3().to_array();
                estimated += 1;
            }
        }
        done += batch.len();
        writer.put(&batch)?;
    }
    writer.finish()?;
    std::fs::rename(&aside, &file).map_err(BuildError::io(&file, "replace"))?;
    Ok(estimated)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    fn ball(count: usize, radius: f64, middle: DVec3) -> Vec<[f64; 3]> {
        // A golden spiral.
        let at = |i: usize| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let turn = 2.399_963_229_728_653 * i as f64;
            let r = (1.0 - z * z).sqrt();
            (middle + radius * DVec3::new(r * turn.cos(), r * turn.sin(), z)).to_array()
        };
        (0..count).map(at).collect()
    }

    /// The cosine of the worst normal with what it should be.
    fn worst(normals: &[DVec3], expected: impl Fn(usize) -> DVec3) -> f64 {
        normals.iter().enumerate().map(|(i, n)| n.dot(expected(i))).fold(1.0, f64::min)
    }

    #[test]
    fn balls_face_outwards_wherever_they_are() {
        // As national grids have it.
        let far = DVec3::new(654_321.25, 5_412_345.5, 312.125);
        let mut places = ball(5000, 1.0, far);
        places.extend(ball(3000, 0.5, far + DVec3::X * 4.0));
        let known = vec![[0.0; 3]; places.len()];
        let mut normals = fit(&places, &Silent);
        let out = |i: usize| {
            let middle = if i < 5000 { far } else { far + DVec3::X * 4.0 };
            (DVec3::from_array(places[i]) - middle).normalize()
        };
        assert!(worst(&normals, out) < 0.0, "some face inwards as they are fitted");
        agree(&mut normals, &places, &known);
        assert!(worst(&normals, out) > 0.99, "{}", worst(&normals, out));
        // Known ones turn their whole part, and no other.
        let mut known = known;
        known[7] = (-out(7)).as_vec3().to_array();
        agree(&mut normals, &places, &known);
        assert!(worst(&normals[..5000], |i| -out(i)) > 0.99);
        assert!(worst(&normals[5000..], |i| out(5000 + i)) > 0.99);
        // A scanner inside sees the inside.
        let seen = vec![Some(far.to_array()); places.len()];
        towards(&mut normals, &places, &seen);
        assert!(worst(&normals[..5000], |i| -out(i)) > 0.99);
    }

    #[test]
    fn flat_ground_faces_up() {
        let places: Vec<[f64; 3]> = (0..900)
            .map(|i| [f64::from(i % 30), f64::from(i / 30), 0.05 * (f64::from(i) * 0.7).sin()])
            .collect();
        let mut normals = fit(&places, &Silent);
        agree(&mut normals, &places, &vec![[0.0; 3]; 900]);
        assert!(worst(&normals, |_| DVec3::Z) > 0.98, "{}", worst(&normals, |_| DVec3::Z));
    }

    #[test]
    fn eigenvectors_are_those_of_known_matrices() {
        let turn = DMat3::from_rotation_y(0.3) * DMat3::from_rotation_x(1.1);
        let spread = turn * DMat3::from_diagonal(DVec3::new(3.0, 0.2, 1.0)) * turn.transpose();
        assert!(least_eigenvector(spread).dot(turn.y_axis).abs() > 1.0 - 1e-12);
        assert!(normal_of(&[DVec3::ONE; 4]) == DVec3::Z);
        // Of points in a line any direction across it is as good.
        let line: Vec<DVec3> = (0..9).map(|i| DVec3::new(f64::from(i), 0.0, 0.0)).collect();
        assert!(normal_of(&line).dot(DVec3::X).abs() < 1e-9);
    }
}
