//! Samples inner nodes against the original geometry inside their cells.

use std::collections::BTreeMap;

use glam::DVec3;
use hlod_compress::{CellKey, HlodFile, Mesh, NodeRecord, PageContent, RepresentationKind};
use rayon::prelude::*;

use super::distance::Target;
use super::normals::{Normals, largest_angle};
use super::originals::Originals;
use super::{RepresentationCheck, check_page};
use crate::progress::Progress;

/// Samples every representation of a node both ways.
///
/// # Errors
/// A sentence, when a page cannot be read.
pub(super) fn check(
    file: &HlodFile,
    node: &NodeRecord,
    originals: &Originals<'_>,
    progress: &dyn Progress,
) -> Result<Vec<RepresentationCheck>, String> {
    let views: Vec<Stored> = node
        .representations
        .iter()
        .map(|r| Ok(Stored::new(node.cell, r, check_page(file, node, r)?, originals)))
        .collect::<Result<_, String>>()?;
    let blocks = originals.blocks(node.cell);
    // Findings of blocks are combined by their largest, in which order makes no difference.
    let found: Vec<Vec<Found>> = blocks
        .into_par_iter()
        .map(|block| {
            let found = check_block(node.cell, block, &views, originals);
            progress.advance(originals.triangles_below(block));
            found
        })
        .collect::<Result<_, String>>()?;

    let step = originals.lattice().step;
    let check = |(i, (view, r)): (usize, (&Stored, &hlod_compress::Representation))| {
        let largest = |of: fn(&Found) -> f64| found.iter().map(|f| of(&f[i])).fold(0.0, f64::max);
        RepresentationCheck {
            cell: node.cell.to_string(),
            depth: node.cell.depth(),
            kind: match r.kind {
                RepresentationKind::Appearance => "appearance",
                RepresentationKind::Geometric => "geometric",
                _ => "source",
            },
            stored: f64::from(r.errors.geometric),
            sampled: largest(|f| f.distance.sampled) * step,
            independent_bound: largest(|f| f.distance.bound) * step,
            normal_allowed_deg: view.normal_allowed_deg,
            normal_sampled_deg: found.iter().map(|f| f[i].normal_deg).fold(0.0, f32::max),
            points_uncovered: 0,
        }
    };
    Ok(views.iter().zip(&node.representations).enumerate().map(check).collect())
}

/// A representation as the file holds it.
struct Stored {
    surface: Target,
    normals: Normals,
    /// Its triangles by the block that they are checked in.
    parts: BTreeMap<CellKey, Mesh>,
    /// The stored error, in lattice steps.
    error: f64,
    /// Leaves and pages hold normals to 10 bits an axis; the file's own numbers include that.
    normal_allowed_deg: f32,
}

impl Stored {
    fn new(
        cell: CellKey,
        representation: &hlod_compress::Representation,
        content: PageContent,
        originals: &Originals<'_>,
    ) -> Stored {
        // Points are samples as they are, and what they stand for lies in their balls.
        let PageContent { mut mesh, points } = content;
        let triangles = mesh.triangles.len();
        let balls = points.positions.iter().zip(&points.radii);
        let balls = balls.map(|(p, radius)| (p.map(f64::from), radius.steps()));
        let surface = Target::with_balls(corners(&mesh), balls);
        for (position, normal) in points.positions.iter().zip(&points.normals) {
            let v = mesh.positions.len() as u32;
            mesh.positions.push(*position);
            mesh.normals.push(*normal);
            mesh.triangles.push([v; 3]);
        }
        debug_assert_eq!(mesh.triangles.len(), triangles + points.len());
        let mut by_block: BTreeMap<CellKey, Vec<[u32; 3]>> = BTreeMap::new();
        for t in &mesh.triangles {
            let corners = t.map(|v| mesh.positions[v as usize].map(f64::from));
            let centre = std::array::from_fn(|i| corners.iter().map(|c| c[i]).sum::<f64>() / 3.0);
            by_block.entry(originals.block_at(cell, centre)).or_default().push(*t);
        }
        let errors = &representation.errors;
        Stored {
            surface,
            normals: Normals::new(std::iter::once(&mesh)),
            parts: by_block.into_iter().map(|(block, t)| (block, part(&mesh, &t))).collect(),
            error: f64::from(errors.geometric) / originals.lattice().step,
            normal_allowed_deg: errors.normal_deviation_deg[0] + errors.normal_smoothing_deg,
        }
    }
}

/// Some triangles of a mesh and the vertices that they need.
fn part(mesh: &Mesh, triangles: &[[u32; 3]]) -> Mesh {
    let mut out = Mesh::default();
    let mut numbers: BTreeMap<u32, u32> = BTreeMap::new();
    let mut number = |v: u32, out: &mut Mesh| {
        *numbers.entry(v).or_insert_with(|| {
            out.positions.push(mesh.positions[v as usize]);
            out.normals.push(mesh.normals[v as usize]);
            out.positions.len() as u32 - 1
        })
    };
    for t in triangles {
        let corners = t.map(|v| number(v, &mut out));
        out.triangles.push(corners);
    }
    out
}

/// What was found of one representation.
struct Found {
    distance: Largest,
    normal_deg: f32,
}

/// Samples the leaves of a block against every representation, and of each the part that lies in
/// the block against all leaves within its error.
///
/// No leaf farther than that is read: a sample of the part that is within its stored error of the
/// original has its exact distance, one that is not is refuted by a distance that may be too large.
fn check_block(
    cell: CellKey,
    block: CellKey,
    views: &[Stored],
    originals: &Originals<'_>,
) -> Result<Vec<Found>, String> {
    let leaves = originals.within_cell(block)?;
    // One search serves all representations: what it needs of the original is nearly the same.
    let parts = views.iter().filter_map(|view| Some((view.parts.get(&block)?, view.error)));
    let reached =
        parts.map(|(part, reach)| grown_bounds(part, reach)).reduce(|[lo, hi], [a, b]| {
            [
                std::array::from_fn(|i| f64::min(lo[i], a[i])),
                std::array::from_fn(|i| f64::max(hi[i], b[i])),
            ]
        });
    let near = reached.map_or(Ok(Vec::new()), |bounds| originals.within_box(cell, bounds))?;
    let to_original = Target::new(near.iter().flat_map(corners));
    let normals = Normals::new(near.iter());
    let check = |view: &Stored| {
        let (reach, allowed) = (view.error, view.normal_allowed_deg);
        let spacing = reach / 4.0;
        let mut distance = Largest::default();
        let mut normal_deg = 0.0f32;
        for leaf in &leaves {
            sample(leaf, spacing, &view.surface, &mut distance);
            let angle = largest_angle(leaf, &view.surface, &view.normals, reach, allowed);
            normal_deg = normal_deg.max(angle);
        }
        if let Some(part) = view.parts.get(&block) {
            sample(part, spacing, &to_original, &mut distance);
            let angle = largest_angle(part, &to_original, &normals, reach, allowed);
            normal_deg = normal_deg.max(angle);
        }
        Found { distance, normal_deg }
    };
    Ok(views.iter().map(check).collect())
}

fn grown_bounds(mesh: &Mesh, by: f64) -> [[f64; 3]; 2] {
    let at = |i: usize| mesh.positions.iter().map(move |p| f64::from(p[i]));
    [
        std::array::from_fn(|i| at(i).fold(f64::INFINITY, f64::min) - by),
        std::array::from_fn(|i| at(i).fold(f64::NEG_INFINITY, f64::max) + by),
    ]
}

fn corners(mesh: &Mesh) -> impl Iterator<Item = [[f64; 3]; 3]> + '_ {
    mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize].map(f64::from)))
}

#[derive(Default)]
struct Largest {
    /// Largest distance of a sample.
    sampled: f64,
    /// No point is farther than this.
    bound: f64,
}

impl Largest {
    /// How finely to sample where the stored error asks for `spacing`: unchanged as long as no sample
    /// exceeds that error, which is four times as large.
    fn spacing(&self, spacing: f64) -> f64 {
        spacing.max(self.sampled / 4.0)
    }
}

/// Pieces of triangles that are divided in one call of [`sample`], besides [`PIECES_A_TRIANGLE`]: far more
/// than honest files need, and seconds.
const PIECES_MAX: u64 = 1 << 22;
const PIECES_A_TRIANGLE: u64 = 64;

/// Samples a mesh: its vertices, and each triangle's inside down to pieces with edges of at most
/// `spacing`.
///
/// The distance is 1-Lipschitz: no point of a piece is farther than the farthest of its corners
/// plus the piece's covering radius, longest edge / √3. Pieces in which that cannot exceed the
/// largest sample by more than the finest pieces' covering radius are not looked into: they could
/// change neither result. The same goes for *clusters* of triangles of about that size, by the
/// distance of their middle and their radius; the farthest come first.
///
/// Where a sample already refutes the stored error, which may be 0 in a file that lies, `spacing` grows
/// with the largest sample: by how much the file is wrong need not be found to a millionth. And no more
/// than [`PIECES_MAX`] pieces, and some for each triangle, are looked into: what lies flat on the original
/// with an error of 0 would never end.
fn sample(mesh: &Mesh, spacing: f64, target: &Target, largest: &mut Largest) {
    let mut pieces_left = PIECES_MAX + PIECES_A_TRIANGLE * mesh.triangles.len() as u64;
    let positions: Vec<DVec3> =
        mesh.positions.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
    let mut clusters: Vec<(f64, Cluster)> = clusters(mesh, &positions, spacing)
        .into_iter()
        .map(|cluster| (target.distance(cluster.middle.to_array()) + cluster.radius, cluster))
        .collect();
    clusters.sort_by(|(x, a), (y, b)| y.total_cmp(x).then(a.triangles.cmp(&b.triangles)));
    let mut at_vertices = vec![f64::NAN; positions.len()];
    let mut pending = Vec::new();
    for (reach, cluster) in clusters {
        if reach <= largest.sampled + largest.spacing(spacing) / 3f64.sqrt() {
            largest.bound = largest.bound.max(reach);
            continue;
        }
        for &t in &cluster.triangles {
            let corners = mesh.triangles[t as usize].map(|v| {
                let known = &mut at_vertices[v as usize];
                if known.is_nan() {
                    *known = target.distance(positions[v as usize].to_array());
                }
                largest.sampled = largest.sampled.max(*known);
                (positions[v as usize], *known)
            });
            pending.push(corners);
            while let Some([a, b, c]) = pending.pop() {
                let longest = a.0.distance(b.0).max(b.0.distance(c.0)).max(c.0.distance(a.0));
                let farthest = a.1.max(b.1).max(c.1);
                let reach = farthest + longest / 3f64.sqrt();
                let spacing = largest.spacing(spacing);
                let is_fine = reach <= largest.sampled + spacing / 3f64.sqrt();
                if is_fine || longest <= spacing || pieces_left == 0 {
                    largest.bound = largest.bound.max(reach);
                    continue;
                }
                pieces_left -= 1;
                let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| {
                    let middle = (p.0 + q.0) / 2.0;
                    (middle, target.distance(middle.to_array()))
                });
                largest.sampled = largest.sampled.max(ab.1).max(bc.1).max(ca.1);
                pending.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
        }
    }
}

/// Triangles that lie together.
struct Cluster {
    triangles: Vec<u32>,
    middle: DVec3,
    /// No corner is farther from the middle.
    radius: f64,
}

/// Triangles by the cube, of this edge, that their first corner lies in.
fn clusters(mesh: &Mesh, positions: &[DVec3], edge: f64) -> Vec<Cluster> {
    let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    let edge = edge.max(1.0);
    for (t, triangle) in (0u32..).zip(&mesh.triangles) {
        let p = positions[triangle[0] as usize];
        cells.entry((p / edge).to_array().map(|c| c.floor() as i64)).or_default().push(t);
    }
    let cluster = |triangles: Vec<u32>| {
        let corners = || {
            let all = triangles.iter().flat_map(|&t| mesh.triangles[t as usize]);
            all.map(|v| positions[v as usize])
        };
        let low = corners().fold(DVec3::INFINITY, DVec3::min);
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
        let middle = (low + high) / 2.0;
        let radius = corners().map(|p| p.distance(middle)).fold(0.0, f64::max);
        Cluster { triangles, middle, radius }
    };
    cells.into_values().map(cluster).collect()
}
