//! Scans that fall into many small components become coarse all the same.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::fmt::Write as _;

use hlod_build::progress::Silent;
use hlod_build::{VerifyOptions, verify};
use hlod_compress::{HlodFile, RepresentationKind};
use hlod_tests::built;

const TETRAHEDRA: usize = 20_000;
const EDGE: f64 = 0.004;

/// Numbers from 0 to 1 (a linear congruential generator, Knuth's constants).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Middles of tetrahedra in a ball of radius 1, and the scan of them as an ASCII PLY.
fn scattered() -> (Vec<[f64; 3]>, String) {
    let mut random = Random(1);
    let mut middles = Vec::new();
    while middles.len() < TETRAHEDRA {
        let p = [0; 3].map(|_| 2.0 * random.next() - 1.0);
        if p.iter().map(|c| c * c).sum::<f64>() <= 1.0 {
            middles.push(p);
        }
    }
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        4 * middles.len(),
        4 * middles.len()
    );
    for p in &middles {
        // Turned by a random angle about one axis after the other.
        let turns = [0; 3].map(|_| (std::f64::consts::TAU * random.next()).sin_cos());
        for corner in [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]] {
            let mut q: [f64; 3] = corner;
            for (axis, (sin, cos)) in turns.iter().enumerate() {
                let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
                (q[i], q[j]) = (cos * q[i] - sin * q[j], sin * q[i] + cos * q[j]);
            }
            let q: [f64; 3] = std::array::from_fn(|i| p[i] + q[i] * EDGE / 8f64.sqrt());
            writeln!(text, "{:.7} {:.7} {:.7}", q[0], q[1], q[2]).unwrap();
        }
    }
    for first in (0..middles.len()).map(|i| 4 * i) {
        for t in [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]] {
            writeln!(text, "3 {} {} {}", first + t[0], first + t[1], first + t[2]).unwrap();
        }
    }
    (middles, text)
}

/// How many balls of a radius round given points cover them all, the one that covers most of what
/// is left taken first.
fn greedy_cover(points: &[[f64; 3]], radius: f64) -> usize {
    let cell = |p: &[f64; 3]| p.map(|c| (c / radius).floor() as i64);
    let mut grid: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    points.iter().enumerate().for_each(|(i, p)| grid.entry(cell(p)).or_default().push(i));
    let near = |p: &[f64; 3]| -> Vec<usize> {
        let at = cell(p);
        let around = (0..27).map(|n| [at[0] + n / 9 - 1, at[1] + n / 3 % 3 - 1, at[2] + n % 3 - 1]);
        let others = around.filter_map(|cell| grid.get(&cell)).flatten().copied();
        let distance2 = |q: &[f64; 3]| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>();
        others.filter(|&other| distance2(&points[other]) <= radius * radius).collect()
    };
    let covers: Vec<Vec<usize>> = points.iter().map(near).collect();
    let mut is_covered = vec![false; points.len()];
    let mut heap: BinaryHeap<(usize, Reverse<usize>)> =
        covers.iter().enumerate().map(|(i, c)| (c.len(), Reverse(i))).collect();
    let mut count = 0;
    while let Some((expected, Reverse(i))) = heap.pop() {
        let gain = covers[i].iter().filter(|&&other| !is_covered[other]).count();
        if gain == expected {
            count += 1;
            covers[i].iter().for_each(|&other| is_covered[other] = true);
        } else if gain > 0 {
            heap.push((gain, Reverse(i)));
        }
    }
    count
}

#[test]
fn the_greedy_cover_is_one() {
    let line: Vec<[f64; 3]> = (0..9).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    assert_eq!(greedy_cover(&line, 1.0), 3);
    assert_eq!(greedy_cover(&line, 0.5), 9);
    assert_eq!(greedy_cover(&line, 9.0), 1);
}

/// Wherever a node's error exceeds their edges, tetrahedra become no more triangles than 1.5 times
/// the balls of that radius that cover them.
#[test]
fn scattered_tetrahedra_become_hardly_more_than_a_cover_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod] = ["t.ply", "t.hlod"].map(|name| folder.path().join(name));
    let (middles, text) = scattered();
    std::fs::write(&ply, text).unwrap();
    built(&ply, &hlod, |o| {
        o.resolution = 16;
        o.leaf_triangles = 300;
    });
    let options = VerifyOptions { share: 0.3, against: vec![ply], ..VerifyOptions::default() };
    let verified = verify(&hlod, &options, &Silent).unwrap();
    assert!(!verified.is_refuted(), "{:?}", verified.problems);

    let file = HlodFile::open(&hlod).unwrap();
    let lattice = file.header().lattice;
    let nodes = file.read_skeleton().unwrap();
    let depths = nodes.iter().map(|node| node.cell.depth()).max().unwrap();
    let mut compared = 0;
    for depth in 0..depths {
        let inner: Vec<_> =
            nodes.iter().filter(|n| n.cell.depth() == depth && !n.is_leaf()).collect();
        let budget = lattice.cell_edge(depth) / 16.0;
        if inner.is_empty() || budget <= EDGE {
            continue;
        }
        // Those in the cells of these nodes.
        let units = lattice.cell_units(depth);
        let cells: std::collections::HashSet<[u32; 3]> =
            inner.iter().map(|n| n.cell.index()).collect();
        let inside: Vec<[f64; 3]> = middles
            .iter()
            .filter(|p| cells.contains(&lattice.quantise(**p).map(|c| c as u32 / units)))
            .copied()
            .collect();
        let cover = greedy_cover(&inside, budget);
        for kind in [RepresentationKind::Appearance, RepresentationKind::Geometric] {
            let triangles: usize =
                inner.iter().map(|n| n.representation(kind).unwrap().triangles as usize).sum();
            let ratio = triangles as f64 / cover as f64;
            println!("depth {depth}: {kind:?}: {triangles} triangles, cover {cover}: {ratio:.2}");
            assert!(ratio <= 1.5, "depth {depth}: {triangles} triangles, cover {cover}");
            compared += 1;
        }
    }
    assert!(compared >= 6);
}
