//! Checks files made from point clouds.
//!
//! - Leaves hold the input's points, no more and no fewer, with their colours, and their normals
//!   where the input has these.
//! - Every point of an inner node lies within its stored error of a point of the scan.
//! - Every point of the scan lies in the ball of a point of the node, of all of them and of each
//!   beginning that is said to cover, and one of these balls' normals is within the stored deviation.

use std::collections::{BTreeMap, HashMap, HashSet};

use hlod_compress::{CellKey, HlodFile, Lattice, NodeRecord, OctNormal, Points};
use hlod_scan::{Batch, PlacedScan};

use super::leaves::{each_batch, round_to, total_bytes};
use super::originals::Originals;
use super::{RepresentationCheck, check_page};
use crate::error::BuildError;
use crate::progress::{Progress, Unit};

/// A sentence for each leaf that does not hold the input's points inside its cell.
pub(super) fn compare(
    file: &HlodFile,
    nodes: &[NodeRecord],
    against: &[PlacedScan],
    progress: &dyn Progress,
) -> Result<Vec<String>, BuildError> {
    let lattice = file.header().lattice;
    let inner: HashSet<CellKey> =
        nodes.iter().filter(|node| !node.is_leaf()).map(|node| node.cell).collect();
    let mut expected: BTreeMap<CellKey, Sum> = BTreeMap::new();
    // Those of the file were estimated then.
    let mut lacks_normals = false;
    progress.begin("compare leaves", total_bytes(against)?, Unit::Bytes);
    for scan in against {
        each_batch(scan, progress, &mut |batch| {
            let Batch::Vertices(batch) = batch else { return };
            for (i, p) in batch.positions.iter().enumerate() {
                let position = round_to(&lattice, p.to_array());
                let normal = batch.normals.get(i).map_or([0.0; 3], |n| n.to_array());
                lacks_normals |= normal == [0.0; 3];
                let colour = batch.colours.get(i).copied().unwrap_or([255; 4]);
                let colour = if file.header().has_colours() { colour } else { [0; 4] };
                let cell = cell_of(position, &inner, &lattice);
                expected.entry(cell).or_default().add(position, OctNormal::encode(normal), colour);
            }
        })?;
    }
    progress.end();
    let mut out = Vec::new();
    for leaf in nodes.iter().filter(|node| node.is_leaf()) {
        let mut found = Sum::default();
        // Pages that cannot be read are said elsewhere.
        let Some(Ok(content)) = leaf.representations.first().map(|r| check_page(file, leaf, r))
        else {
            continue;
        };
        let points = &content.points;
        for i in 0..points.len() {
            let colour = points.colours.get(i).copied().unwrap_or_default();
            found.add(points.positions[i], points.normals[i], colour);
        }
        let wanted = expected.remove(&leaf.cell).unwrap_or_default();
        if found.count != wanted.count {
            let (found, wanted) = (found.count, wanted.count);
            out.push(format!("leaf {}: {found} points, the input has {wanted} there", leaf.cell));
        } else if found.places != wanted.places || !lacks_normals && found != wanted {
            out.push(format!("leaf {}: its points are not the input's", leaf.cell));
        }
    }
    out.extend(
        expected
            .into_iter()
            .map(|(cell, sum)| format!("{} points of the input lie in no leaf: {cell}", sum.count)),
    );
    Ok(out)
}

/// What does not depend on the order of points: equal for other points by chance once in 2⁶⁴.
#[derive(Default, PartialEq)]
struct Sum {
    count: u64,
    /// Of positions and colours.
    places: u64,
    /// With normals.
    all: u64,
}

impl Sum {
    fn add(&mut self, position: [i32; 3], normal: OctNormal, colour: [u8; 4]) {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        (position, colour).hash(&mut hasher);
        self.count += 1;
        self.places = self.places.wrapping_add(hasher.finish());
        normal.hash(&mut hasher);
        self.all = self.all.wrapping_add(hasher.finish());
    }
}

/// The leaf's cell in which a position lies; what is on a plane between cells belongs below it.
fn cell_of(position: [i32; 3], inner: &HashSet<CellKey>, lattice: &Lattice) -> CellKey {
    let mut cell = CellKey::ROOT;
    while inner.contains(&cell) {
        let child_edge = lattice.cell_units(cell.depth() + 1) as i32;
        let low = lattice.cell_min(cell);
        let upper = |axis: usize| position[axis] - low[axis] > child_edge;
        cell = cell.child((0..3).map(|axis| u8::from(upper(axis)) << axis).sum());
    }
    cell
}

/// Checks an inner node of points.
///
/// # Errors
/// A sentence, when a page cannot be read.
pub(super) fn check(
    file: &HlodFile,
    node: &NodeRecord,
    originals: &Originals<'_>,
    progress: &dyn Progress,
) -> Result<Vec<RepresentationCheck>, String> {
    let step = originals.lattice().step;
    let mut out = Vec::new();
    for r in &node.representations {
        let points = check_page(file, node, r)?.points;
        let error = f64::from(r.errors.geometric) / step;
        let allowed_deg = r.errors.normal_deviation_deg[0];
        let balls = Balls::new(&points);
        let mut nearest = vec![f64::INFINITY; points.len()];
        let (mut uncovered, mut worst_deg) = (0, 0.0f32);
        for leaf in originals.leaves(node.cell) {
            let scan = originals.read(leaf)?.points;
            for i in 0..scan.len() {
                let found = balls.cover(scan.positions[i], scan.normals[i]);
                uncovered += u64::from(!found.is_covered);
                worst_deg = worst_deg.max(found.least_deg);
            }
            near_points(&scan, error, &points, &mut nearest);
            progress.advance(scan.len() as u64);
        }
        let sampled = nearest.iter().copied().fold(0.0, f64::max) * step;
        out.push(RepresentationCheck {
            cell: node.cell.to_string(),
            depth: node.cell.depth(),
            kind: "points",
            stored: f64::from(r.errors.geometric),
            sampled,
            // All points were looked at, not samples of them.
            independent_bound: sampled,
            normal_allowed_deg: allowed_deg,
            normal_sampled_deg: worst_deg,
            points_uncovered: uncovered,
        });
    }
    Ok(out)
}

/// Balls round points, found by what they may hold.
struct Balls<'a> {
    points: &'a Points,
    /// At least as wide as the largest ball of the shortest beginning.
    edge: f64,
    cells: HashMap<[i64; 3], Vec<u32>>,
}

struct Cover {
    /// By all balls, and by those of every beginning.
    is_covered: bool,
    /// Least angle between the point's normal and that of a ball that holds it.
    least_deg: f32,
}

impl<'a> Balls<'a> {
    fn new(points: &'a Points) -> Balls<'a> {
        let in_prefixes = points.prefixes.iter().flat_map(|prefix| &prefix.radii);
        let largest = in_prefixes.chain(&points.radii).max().map_or(0.0, |r| r.steps());
        let edge = largest + 1.0;
        let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (i, p) in (0u32..).zip(&points.positions) {
            cells.entry(cell(*p, edge)).or_default().push(i);
        }
        Balls { points, edge, cells }
    }

    fn cover(&self, position: [i32; 3], normal: OctNormal) -> Cover {
        // Rounding of distances.
        const SLACK: f64 = 1e-6;
        let points = self.points;
        let direction = normal.decode().map(f64::from);
        let mut in_all = false;
        let mut in_beginning = vec![false; points.prefixes.len()];
        let mut largest_cosine = -1.0f64;
        for key in neighbours(cell(position, self.edge)) {
            for &i in self.cells.get(&key).into_iter().flatten() {
                let k = i as usize;
                let distance = distance(position, points.positions[k]);
                if distance <= points.radii[k].steps() + SLACK {
                    in_all = true;
                    let other = points.normals[k].decode().map(f64::from);
                    let cosine = (0..3).map(|axis| direction[axis] * other[axis]).sum();
                    largest_cosine = largest_cosine.max(cosine);
                }
                for (covered, prefix) in in_beginning.iter_mut().zip(&points.prefixes) {
                    let radius = prefix.radii.get(k).map(|radius| radius.steps());
                    *covered |= radius.is_some_and(|radius| distance <= radius + SLACK);
                }
            }
        }
        Cover {
            is_covered: in_all && in_beginning.iter().all(|&covered| covered),
            least_deg: if in_all {
                largest_cosine.min(1.0).acos().to_degrees() as f32
            } else {
                0.0
            },
        }
    }
}

/// Lowers the distance of each stored point to the nearest point of a scan, which is exact where it
/// is at most `reach`, and never too small.
fn near_points(scan: &Points, reach: f64, stored: &Points, nearest: &mut [f64]) {
    let edge = reach + 1.0;
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for (i, p) in (0u32..).zip(&scan.positions) {
        cells.entry(cell(*p, edge)).or_default().push(i);
    }
    for (nearest, &at) in nearest.iter_mut().zip(&stored.positions) {
        for key in neighbours(cell(at, edge)) {
            for &i in cells.get(&key).into_iter().flatten() {
                *nearest = nearest.min(distance(at, scan.positions[i as usize]));
            }
        }
    }
}

fn cell(position: [i32; 3], edge: f64) -> [i64; 3] {
    position.map(|c| (f64::from(c) / edge).floor() as i64)
}

fn neighbours([x, y, z]: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    (0..27).map(move |i| [x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1])
}

fn distance(a: [i32; 3], b: [i32; 3]) -> f64 {
    (0..3).map(|i| (f64::from(a[i]) - f64::from(b[i])).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use hlod_compress::{PointPrefix, PointRadius};

    use super::*;

    fn row() -> Points {
        let up = OctNormal::encode([0.0, 0.0, 1.0]);
        Points {
            positions: vec![[0, 0, 0], [20, 0, 0], [10, 0, 0]],
            normals: vec![up; 3],
            colours: Vec::new(),
            scalars: Vec::new(),
            radii: vec![PointRadius::at_least(5.0); 3],
            prefixes: vec![PointPrefix { radii: vec![PointRadius::at_least(10.0); 2] }],
        }
    }

    #[test]
    fn what_no_ball_holds_is_seen() {
        let up = OctNormal::encode([0.0, 0.0, 1.0]);
        let points = row();
        let balls = Balls::new(&points);
        assert!(balls.cover([4, 0, 0], up).is_covered);
        assert!(balls.cover([10, 0, 0], up).is_covered);
        assert!(!balls.cover([10, 6, 0], up).is_covered, "outside every ball");
        let mut short = row();
        short.prefixes[0].radii = vec![PointRadius::at_least(8.0); 2];
        assert!(
            !Balls::new(&short).cover([10, 0, 0], up).is_covered,
            "the beginning leaves it out"
        );
        assert!(balls.cover([4, 0, 0], OctNormal::encode([0.0, 1.0, 0.0])).least_deg > 89.0);
    }

    #[test]
    fn stored_points_far_from_the_scan_are_seen() {
        let points = row();
        let mut moved = row();
        moved.positions[1] = [20, 3, 0];
        let mut nearest = vec![f64::INFINITY; 3];
        near_points(&points, 4.0, &moved, &mut nearest);
        assert_eq!(nearest, [0.0, 3.0, 0.0]);
        let mut nearest = vec![f64::INFINITY; 3];
        near_points(&points, 1.0, &moved, &mut nearest);
        assert!(nearest[1] > 1.0);
    }
}
