//! How far strips reach: as far as the lines in which two nodes end are apart.
//!
//! Where the line of one node and that of the node beside it are not the same there is a slit between them, in their
//! common face. Every point of it lies between the two lines. Builds bound how far either line is from the scan's own
//! section, so that no two points that belong together are farther apart than both bounds, the *slit's bound*; but
//! mostly they are much nearer, and a strip that reaches farther than it must can be seen from behind a range map, and
//! past its rim.
//!
//! So the distance from the vertices of either line to the other line is measured, at most the slit's bound. Between
//! two consecutive vertices' feet on the other line a line is no farther than at one of them, because the distance to a
//! segment is convex, and where the other line bends in between it has a vertex there, whose distance counts as
//! well. An edge's strip therefore reaches four times the largest distance of all vertices, of either line, that are no farther
//! from the edge than the slit's bound: four times, because it hangs in the direction of the surface's normals, which may
//! lean by up to 75° from the shortest way; and two steps of the lattice more, since both lines are rounded. (Of normals
//! that lean more nothing is known but what `audit --seams` finds.) What has no line opposite, because the node beside has given up a part that is smaller than its error, is as far as the
//! bound. Whatever was measured, no strip reaches farther than four times the larger of the two lines' bounds, and the steps.
//!
//! Where nothing is drawn beside a node, since it is not seen or shows only backs, its own bound is what its line may be off.
//!
//! What is measured depends on the two nodes alone, so it is the same in each part of a picture that shows them. It
//! is kept with the geometry as long as both are drawn side by side, and is measured by all cores.

use std::collections::HashMap;
use std::sync::Arc;

use bytemuck::cast_slice;
use hlod_compress::{CellKey, Lattice};
use rayon::prelude::*;

use crate::loader::{CODE_BITS, GpuVertex};
use crate::select::Draw;
use crate::skeleton::Skeleton;
use crate::skirts::{FaceLines, within_face};

mod slit;

use slit::{Square, holds, widths};

/// Strips lean by no more than has this cosine's inverse from the shortest way across a slit.
const LEANING: f64 = 4.0;

/// How many times the larger bound of two lines a strip reaches at most, besides the lattice's steps; codes round up.
pub(crate) const REACH_MAX: f64 = LEANING * std::f64::consts::SQRT_2;

/// How far strips reach at most, where borders are off by at most `border_error` and the lattice's steps are so long.
/// Lengths in any one unit.
pub(crate) fn reach_most(border_error: f64, step: f64) -> f64 {
    REACH_MAX * (border_error + step)
}

/// What is drawn, and so what strips must close.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drawn {
    /// What is seen.
    Receivers,
    /// What casts shadows on it.
    Casters,
}

/// A node, and one of its representations.
pub(crate) type Key = (u32, usize);

/// What lies beyond a face of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Beside {
    face: usize,
    other: Key,
}

/// What the strips of a resident node hang from, and how far they reach.
#[derive(Debug, Clone, Default)]
pub(crate) struct Seams {
    lines: Arc<[FaceLines; 6]>,
    /// Lower corners, as they are on the GPU.
    corners: Vec<GpuVertex>,
    /// How far the lines may be from the scan's, lattice steps.
    border: f64,
    /// What is beside where it is a receiver and a caster, once it was.
    beside: [Option<Vec<Beside>>; 2],
    /// Towards each of these.
    slits: Vec<Slit>,
}

/// What a node's strips must close towards one other.
#[derive(Debug, Clone)]
pub(crate) struct Slit {
    towards: Beside,
    /// The part of the face that both have.
    square: Square,
    /// How far the strip of each edge in the face reaches, lattice steps.
    reaches: Box<[f32]>,
}

impl Seams {
    /// Of a node whose lines may be so many lattice steps from the scan's.
    pub(crate) fn new(lines: Arc<[FaceLines; 6]>, corners: &[GpuVertex], border: f64) -> Seams {
        Seams { lines, corners: corners.to_vec(), border, ..Seams::default() }
    }

    /// Whether strips reach as far as they must with these neighbours.
    pub(crate) fn closes(&self, beside: &[Beside], drawn: Drawn) -> bool {
        self.corners.is_empty() || self.beside[drawn as usize].as_deref() == Some(beside)
    }

    fn slit(&self, towards: &Beside) -> Option<&Slit> {
        self.slits.iter().find(|slit| slit.towards == *towards)
    }

    pub(crate) fn learn(&mut self, slit: Slit) {
        if self.slit(&slit.towards).is_none() {
            self.slits.push(slit);
        }
    }

    /// Makes strips as long as these neighbours ask for, of which all is known; the corners' bytes if any of them changes.
    pub(crate) fn close(&mut self, beside: &[Beside], drawn: Drawn) -> Option<&[u8]> {
        let codes = self.codes(beside);
        self.beside[drawn as usize] = Some(beside.to_vec());
        let is_used = |b: &Beside| self.beside.iter().flatten().any(|all| all.contains(b));
        self.slits.retain(|slit| is_used(&slit.towards));
        let mut changed = false;
        for (corner, code) in self.corners.iter_mut().zip(codes) {
            let word = &mut corner.normal[drawn as usize];
            let now = *word & !0 << CODE_BITS | i16::from(code);
            changed |= std::mem::replace(word, now) != now;
        }
        changed.then(|| cast_slice(&self.corners))
    }

    /// A code for how far each corner is moved.
    fn codes(&self, beside: &[Beside]) -> impl Iterator<Item = u8> + use<> {
        let alone = (LEANING * (self.border + 1.0)) as f32;
        let mut of_corners = vec![0.0f32; self.corners.len()];
        let slits: Vec<&Slit> = beside.iter().filter_map(|b| self.slit(b)).collect();
        for (face, lines) in self.lines.iter().enumerate() {
            let here = || slits.iter().filter(|slit| slit.towards.face == face);
            let is_covered =
                |point: u32| here().any(|slit| holds(&slit.square, lines.points[point as usize]));
            for (k, edge) in lines.edges.iter().enumerate() {
                let least = if edge.points.iter().all(|&p| is_covered(p)) { 0.0 } else { alone };
                let reach = here().map(|slit| slit.reaches[k]).fold(least, f32::max);
                for corner in edge.corners {
                    let of_corner = &mut of_corners[corner as usize];
                    *of_corner = of_corner.max(reach);
                }
            }
        }
        of_corners.into_iter().map(|reach| code_of_reach(reach.into()))
    }
}

/// What is drawn beyond each open face of each node, whatever its depth.
pub(crate) fn beside(draws: &[Draw], skeleton: &Skeleton) -> Vec<Vec<Beside>> {
    let cell_of = |draw: &Draw| skeleton.nodes()[draw.node as usize].cell;
    let key_of = |draw: &Draw| (draw.node, draw.representation);
    let drawn: HashMap<CellKey, usize> =
        draws.iter().enumerate().map(|(i, draw)| (cell_of(draw), i)).collect();
    let mut out: Vec<Vec<Beside>> = draws.iter().map(|_| Vec::new()).collect();
    for (i, draw) in draws.iter().enumerate() {
        let cell = cell_of(draw);
        for face in (0..6).filter(|face| draw.open_faces & 1 << face != 0) {
            let Some(beyond) = cell_beyond(cell, face) else { continue };
            let covering = std::iter::successors(Some(beyond), |cell| cell.parent());
            let Some(&k) = covering.filter_map(|cell| drawn.get(&cell)).next() else {
                continue;
            };
            out[i].push(Beside { face, other: key_of(&draws[k]) });
            if cell_of(&draws[k]).depth() < cell.depth() {
                out[k].push(Beside { face: (face + 3) % 6, other: key_of(draw) });
            }
        }
    }
    out
}

/// The cell of the same depth beyond a face; none outside of the root.
pub(crate) fn cell_beyond(cell: CellKey, face: usize) -> Option<CellKey> {
    let mut index = cell.index();
    let along = &mut index[face % 3];
    *along = if face < 3 { along.checked_sub(1)? } else { *along + 1 };
    (*along >> cell.depth() == 0).then(|| CellKey::at(cell.depth(), index))
}

/// Measures, for both sides, what is not known of the slits between nodes and what is beside them; `seams_of` knows what
/// is resident.
pub(crate) fn measure<'a>(
    changed: impl Iterator<Item = (Key, &'a [Beside])>,
    skeleton: &Skeleton,
    lattice: &Lattice,
    seams_of: &(dyn Fn(Key) -> Option<&'a Seams> + Sync),
) -> Vec<(Key, Slit)> {
    let pairs = changed.flat_map(|(key, beside)| beside.iter().map(move |b| (key, *b)));
    // Named from the side of the lesser key.
    let mut pairs: Vec<(Key, usize, Key)> = pairs
        .map(|(key, Beside { face, other })| match key < other {
            true => (key, face, other),
            false => (other, (face + 3) % 6, key),
        })
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    let cell_of = |key: Key| skeleton.nodes()[key.0 as usize].cell;
    let square_of = |cell: CellKey, face: usize| -> Square {
        let (low, units) = (lattice.cell_min(cell), lattice.cell_units(cell.depth()) as i32);
        [within_face(low, face), within_face(low.map(|c| c + units), face)]
    };
    let between = |(here, face, there): (Key, usize, Key)| -> Option<[(Key, Slit); 2]> {
        let (a, b) = (seams_of(here)?, seams_of(there)?);
        let beyond = (face + 3) % 6;
        let towards = [Beside { face, other: there }, Beside { face: beyond, other: here }];
        if a.slit(&towards[0]).is_some() && b.slit(&towards[1]).is_some() {
            return None;
        }
        let finer = std::cmp::max_by_key(cell_of(here), cell_of(there), |cell| cell.depth());
        let square = square_of(finer, face);
        let most = LEANING * (a.border.max(b.border) + 1.0);
        let bound = a.border + b.border + 2.0;
        let widths = widths([&a.lines[face], &b.lines[beyond]], &square, bound);
        let reaches = widths.map(|widths| {
            widths.iter().map(|width| (LEANING * width + 2.0).min(most) as f32).collect()
        });
        let [of_a, of_b] = reaches;
        Some([
            (here, Slit { towards: towards[0], square, reaches: of_a }),
            (there, Slit { towards: towards[1], square, reaches: of_b }),
        ])
    };
    pairs.into_par_iter().filter_map(between).flatten_iter().collect()
}

/// The least code that stands for so many lattice steps or more: code c stands for 2^((c + 1) / 2), 0 for none.
fn code_of_reach(steps: f64) -> u8 {
    if steps <= 0.0 {
        return 0;
    }
    (2.0 * steps.log2() - 1.0).ceil().clamp(1.0, f64::from((1 << CODE_BITS) - 1)) as u8
}

#[cfg(test)]
mod tests {
    use hlod_compress::{NormalCone, RepresentationKind};

    use super::slit::tests::line;
    use super::*;
    use crate::select::tests::tree_of;
    use crate::skirts::ALL_FACES;

    #[test]
    fn codes_stand_for_no_less_and_hardly_more() {
        assert_eq!((code_of_reach(0.0), code_of_reach(1.0), code_of_reach(2.0)), (0, 1, 1));
        for i in 0..2000 {
            let steps = 2.0 * 1.01f64.powi(i);
            let stands_for = 2f64.powf((f64::from(code_of_reach(steps)) + 1.0) / 2.0);
            assert!(stands_for >= steps * (1.0 - 1e-12), "{steps} {stands_for}");
            assert!(stands_for <= steps * 1.415, "{steps} {stands_for}");
        }
    }

    /// All octants but the last one, whose children are drawn.
    fn mixed_front(skeleton: &Skeleton) -> Vec<Draw> {
        let child = |octant| CellKey::ROOT.child(octant);
        let mut cells: Vec<CellKey> = (0..7).map(child).collect();
        cells.extend((0..8).map(|octant| child(7).child(octant)));
        let draw = |cell: &CellKey| {
            let node = skeleton.nodes().iter().position(|node| node.cell == *cell);
            Draw {
                node: node.expect("it is there") as u32,
                representation: 0,
                error_px: 0.0,
                area_px: 0.0,
                open_faces: ALL_FACES,
            }
        };
        cells.iter().map(draw).collect()
    }

    #[test]
    fn what_lies_beside_is_found_at_all_depths() {
        let skeleton = tree_of(2, NormalCone::ALL, RepresentationKind::Appearance);
        let draws = mixed_front(&skeleton);
        // By the numbers of draws.
        let found = |draws: &[Draw]| -> Vec<Vec<(usize, usize)>> {
            let number = |key: Key| draws.iter().position(|d| (d.node, d.representation) == key);
            let mut found: Vec<Vec<_>> = beside(draws, &skeleton)
                .iter()
                .map(|all| all.iter().map(|b| (b.face, number(b.other).unwrap())).collect())
                .collect();
            found.iter_mut().for_each(|all| all.sort_unstable());
            found
        };
        let all = found(&draws);
        assert_eq!(all[0], [(3, 1), (4, 2), (5, 4)]);
        // Octant 3 is below the four lower children of octant 7.
        assert_eq!(all[3], [(0, 2), (1, 1), (5, 7), (5, 8), (5, 9), (5, 10)]);
        assert_eq!(all[7], [(0, 6), (1, 5), (2, 3), (3, 8), (4, 9), (5, 11)]);
        // What is closed is not looked across.
        let mut closed = draws.clone();
        closed[0].open_faces &= !8;
        assert_eq!(found(&closed)[0], [(4, 2), (5, 4)]);
    }

    #[test]
    fn strips_are_measured_when_neighbours_change() {
        let skeleton = tree_of(2, NormalCone::ALL, RepresentationKind::Appearance);
        let draws = mixed_front(&skeleton);
        let lattice = crate::select::tests::lattice();
        // Octants 0 and 1 end in a line across their common face, with a bump of 3 steps in one of them.
        let middle = lattice.cell_units(1) as i32 / 2;
        let normal = [5 << CODE_BITS, -7 << CODE_BITS];
        let seams = |face: usize, bump: i32| {
            let at = |v: i32, bump: i32| [middle + bump, middle - 8 + v];
            let mut lines: [FaceLines; 6] = Default::default();
            lines[face] = line(vec![at(0, 0), at(8, bump), at(16, 0)]);
            Seams::new(Arc::new(lines), &[GpuVertex { position: [0.0; 3], normal }; 3], 40.0)
        };
        let mut all = [seams(3, 0), seams(0, 3)];
        let number = |key: Key| draws.iter().take(2).position(|draw| draw.node == key.0);
        // What is measured, how many strips change, and whether the GPU hears of them.
        let close = |all: &mut [Seams; 2], draws: &[Draw], drawn: Drawn| {
            let all_beside = beside(draws, &skeleton);
            let changed = (0..2).filter(|&k| !all[k].closes(&all_beside[k], drawn));
            let changed: Vec<(Key, &[Beside])> =
                changed.map(|k| ((draws[k].node, 0), &all_beside[k][..])).collect();
            let seams_of = |key: Key| number(key).map(|k| &all[k]);
            let slits = measure(changed.iter().copied(), &skeleton, &lattice, &seams_of);
            let measured = slits.len();
            slits.into_iter().for_each(|(key, slit)| all[number(key).unwrap()].learn(slit));
            let told = changed
                .iter()
                .filter(|(key, beside)| all[number(*key).unwrap()].close(beside, drawn).is_some());
            (measured, changed.len(), told.count())
        };
        assert_eq!(close(&mut all, &draws, Drawn::Receivers), (2, 2, 2));
        // What is known is not measured again, and has to be told only of what is drawn otherwise.
        assert_eq!(close(&mut all, &draws, Drawn::Receivers), (0, 0, 0));
        assert_eq!(close(&mut all, &draws, Drawn::Casters), (0, 2, 2));
        // Another front, in which nothing is beside; then the first again.
        let mut alone = draws.clone();
        alone[0].open_faces &= !8;
        alone[1].open_faces &= !1;
        assert_eq!(close(&mut all, &alone, Drawn::Casters), (0, 2, 2));
        for seams in &all {
            for corner in &seams.corners {
                assert_eq!(corner.normal.map(|n| n >> CODE_BITS), [5, -7]);
                let lengths = corner.normal.map(|n| {
                    let code = n & ((1 << CODE_BITS) - 1);
                    2f64.powf((f64::from(code) + 1.0) / 2.0)
                });
                // Four times three steps, and two for rounding; alone, four times its own node's bound and a step. Codes
                // are up to half an octave more.
                for (length, least) in lengths.into_iter().zip([14.0, 164.0]) {
                    assert!((least..=least * 1.415).contains(&length), "{length} {least}");
                }
            }
        }
        assert_eq!(close(&mut all, &draws, Drawn::Casters), (0, 2, 2));
        let codes = all[0].corners[0].normal.map(|n| n & 63);
        assert_eq!(codes[0], codes[1]);
        // What nobody asks for any more is forgotten.
        close(&mut all, &alone, Drawn::Casters);
        close(&mut all, &alone, Drawn::Receivers);
        assert!(all.iter().all(|seams| seams.slits.is_empty()));
    }
}
