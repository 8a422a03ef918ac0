//! From crossings of single triangles to lines.
//!
//! Each crossing has two ends, and each end one partner at most: lines are the cycles and paths of
//! this relation, so they end whatever the surface is like. Which ends are partners is decided edge
//! by edge: the two that meet in an edge of two triangles, around an edge of more of them those
//! between which there is solid, and of those left over the ones that [`super::join`] finds. Crossings
//! are sorted first, so that the order in which leaves were read leaves no trace.

use std::collections::HashMap;

use glam::DVec3;

use super::crossing::{Crossing, Cutter, Edge};
use super::join::{LooseEnd, join};
use super::plane::Frame;

/// Lines, and what had to be done for them.
pub(super) struct Chains {
    /// Points of each line and whether it is closed; in no particular order yet, of no particular
    /// direction where triangles of both faces meet.
    pub(super) lines: Vec<(Vec<DVec3>, bool)>,
    /// Ends that were joined across a gap, and the widest gap.
    pub(super) joins: usize,
    pub(super) widest_gap: f64,
    /// Edges of more than two triangles that the plane crosses.
    pub(super) crowded_edges: usize,
    /// Length along which lines run against their triangles.
    pub(super) contrary: f64,
}

/// Joins the crossings of a surface to lines. `step` is the lattice's, in the source's unit.
pub(super) fn chain(
    cutter: &Cutter<'_>,
    frame: &Frame,
    step: f64,
    crossings: &mut [Crossing],
) -> Chains {
    crossings.sort_by(|a, b| {
        let values = |c: &Crossing| (c.steepness, c.error);
        a.edges
            .cmp(&b.edges)
            .then_with(|| values(a).0.total_cmp(&values(b).0))
            .then_with(|| values(a).1.total_cmp(&values(b).1))
    });
    let points: Vec<[DVec3; 2]> =
        crossings.iter().map(|c| c.edges.map(|edge| cutter.point(edge))).collect();
    let (mut partners, crowded_edges) = meet_in_edges(crossings, &points, frame);

    let loose: Vec<LooseEnd> = (0..partners.len())
        .filter(|&end| partners[end].is_none())
        .map(|end| LooseEnd {
            end,
            edge: crossings[end / 2].edges[end % 2],
            cell_units: crossings[end / 2].cell_units,
            point: points[end / 2][end % 2],
        })
        .collect();
    let joined = join(cutter, step, &loose);
    for &(a, b, _) in &joined {
        (partners[a], partners[b]) = (Some(b), Some(a));
    }

    let mut chains = Chains {
        lines: Vec::new(),
        joins: joined.len(),
        widest_gap: joined.iter().map(|join| join.2).fold(0.0, f64::max),
        crowded_edges,
        contrary: 0.0,
    };
    let mut visited = vec![false; crossings.len()];
    // Open lines from their ends first, so that what is left is closed.
    let open = (0..partners.len()).filter(|&end| partners[end].is_none());
    for end in open.chain((0..crossings.len()).map(|i| 2 * i)) {
        if !visited[end / 2] {
            chains.follow(end, &partners, &points, &mut visited);
        }
    }
    chains
}

impl Chains {
    /// Follows a line from one end of a crossing.
    fn follow(
        &mut self,
        first: usize,
        partners: &[Option<usize>],
        points: &[[DVec3; 2]],
        visited: &mut [bool],
    ) {
        let mut line: Vec<DVec3> = Vec::new();
        let (mut along, mut against) = (0.0, 0.0);
        let mut next = Some(first);
        while let Some(end) = next
            && !visited[end / 2]
        {
            visited[end / 2] = true;
            let ways = points[end / 2];
            let (from, to) = (ways[end % 2], ways[1 - end % 2]);
            let length = from.distance(to);
            if end % 2 == 0 {
                along += length
            } else {
                against += length
            }
            for point in [from, to] {
                if line.last() != Some(&point) {
                    line.push(point);
                }
            }
            next = partners[end ^ 1];
        }
        let closed = next.is_some();
        if closed && line.len() > 1 && line.first() == line.last() {
            line.pop();
        }
        // Where the plane only touches the surface there is a line of one point.
        if line.len() < 2 {
            return;
        }
        if against > along {
            line.reverse();
        }
        self.contrary += against.min(along);
        self.lines.push((line, closed));
    }
}

/// The partner of each end in the edge that it is in, and how many edges have more than two ends.
fn meet_in_edges(
    crossings: &[Crossing],
    points: &[[DVec3; 2]],
    frame: &Frame,
) -> (Vec<Option<usize>>, usize) {
    let mut ends_of: HashMap<Edge, Vec<usize>> = HashMap::with_capacity(crossings.len());
    for end in 0..2 * crossings.len() {
        ends_of.entry(crossings[end / 2].edges[end % 2]).or_default().push(end);
    }
    let mut partners = vec![None; 2 * crossings.len()];
    let mut crowded = 0;
    for mut ends in ends_of.into_values() {
        if ends.len() > 2 {
            crowded += 1;
            let angle = |end: usize| {
                let [from, to] = points[end / 2].map(|p| frame.to_plane(p));
                let leaving = if end.is_multiple_of(2) { to - from } else { from - to };
                leaving.y.atan2(leaving.x)
            };
            ends.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)).then(a.cmp(&b)));
            pair_across_solid(&mut ends, &mut partners);
        }
        // Two are left, or some of a surface whose triangles face either way.
        for pair in ends.chunks_exact(2) {
            (partners[pair[0]], partners[pair[1]]) = (Some(pair[1]), Some(pair[0]));
        }
    }
    (partners, crowded)
}

/// Pairs ends, in counter-clockwise order round their edge, with solid between them: lines that
/// begin there have it to the left of them, those that end there to the right as seen from the edge.
/// As brackets are paired, so that lines touch in the edge but do not cross. Leaves the rest.
fn pair_across_solid(ends: &mut Vec<usize>, partners: &mut [Option<usize>]) {
    let mut begun: Vec<usize> = Vec::new();
    // Twice round: a pair may lie across the direction that counting starts from.
    for (i, end) in ends.iter().chain(ends.iter()).copied().enumerate() {
        if partners[end].is_some() {
            continue;
        }
        if end.is_multiple_of(2) {
            if i < ends.len() {
                begun.push(end);
            }
        } else if let Some(beginning) = begun.pop() {
            (partners[beginning], partners[end]) = (Some(end), Some(beginning));
        }
    }
    ends.retain(|&end| partners[end].is_none());
}
