//! Simplifies the lines in which the surface meets the faces of a cell.
//!
//! Two cells that share a face cut the same surface with it and get the same chains of edges. Each
//! simplifies them on its own, as a function of nothing but the chain: so both end in the same
//! vertices, with the same normals, and when they are gathered the seam is closed already.
//!
//! A chain runs between anchors — its ends, branches, and where it meets an edge of the cell — which
//! stay. In between, some vertices are kept, rounded to the node's grid, and every other becomes
//! the nearest of these along the chain. Of all choices that keep the chain within a share of the
//! budget of its segments, the one with the fewest vertices is taken and of those the one with
//! the least squares (shortest path; Imai & Iri 1988, *Polygonal approximations of a curve*).

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use hlod_compress::{Mesh, Scalars};

use super::Budget;
use super::prepare::{angle, unit_colour};
use crate::borders::{Borders, Cube};
use crate::kept::mean_scalars;
use crate::partition::Vertex;

/// Chains are kept within this share of the budget.
const CHAIN_SHARE: f64 = 0.5;

/// A segment passes over fewer vertices than this.
const SEGMENT_MAX: usize = 64;

/// After so many longer segments in a row have failed, no longer one is tried.
const FAILURES_MAX: usize = 8;

/// What all vertices of one part of a chain become.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pin {
    /// In lattice steps.
    pub(super) place: [i32; 3],
    pub(super) normal: Vec3,
    /// sRGB from 0 to 1.
    pub(super) colour: Vec3,
    /// Kept numbers.
    pub(super) scalars: Scalars,
}

/// Chains of one node, simplified.
#[derive(Debug, Default)]
pub(super) struct Chains {
    pub(super) pins: Vec<Pin>,
    /// Of each position on a chain, its pin in the appearance and in the geometric
    /// representation.
    pub(super) pin_of: HashMap<[i32; 3], [u32; 2]>,
    /// The chains' positions, in order.
    lines: Vec<Vec<[i32; 3]>>,
}

impl Chains {
    /// How far the chains are, both ways, from what they become when each of their positions goes
    /// where `place_of` says; `gone` where one goes nowhere. In lattice steps.
    pub(super) fn deviation(
        &self,
        place_of: impl Fn([i32; 3]) -> Option<[i32; 3]>,
        gone: f64,
    ) -> f64 {
        let mut largest = 0.0f64;
        for line in &self.lines {
            let places: Option<Vec<[i32; 3]>> = line.iter().map(|&p| place_of(p)).collect();
            largest = largest.max(places.map_or(gone, |places| deviation(line, &places)));
        }
        largest
    }
}

/// A bound of the two-sided Hausdorff distance between a polyline and what it becomes when its
/// vertices go to `places`, in lattice steps.
///
/// Vertices that go to one place leave one, the *home*, that is nearest to it. Between two homes the
/// line's vertices have a distance to the segment between the two places; the line in between is no
/// farther, because that distance is convex. Every point of the segment lies square to some point
/// in between, which is no farther either, or beyond the square of a home, and then no farther
/// from it than its place is.
fn deviation(line: &[[i32; 3]], places: &[[i32; 3]]) -> f64 {
    let at = |p: &[i32; 3]| DVec3::from_array(p.map(f64::from));
    let mut homes: Vec<usize> = Vec::new();
    let mut first = 0;
    for group in places.chunk_by(|a, b| a == b) {
        let distance = |k: &usize| at(&line[*k]).distance_squared(at(&group[0]));
        let members = first..first + group.len();
        homes.extend(members.clone().min_by(|a, b| distance(a).total_cmp(&distance(b))));
        first = members.end;
    }
    let to_place = |k: usize, home: usize| at(&line[k]).distance(at(&places[home]));
    let mut largest = homes.iter().map(|&home| to_place(home, home)).fold(0.0, f64::max);
    let (&begin, &end) = (homes.first().unwrap_or(&0), homes.last().unwrap_or(&0));
    for k in 0..begin {
        largest = largest.max(to_place(k, begin));
    }
    for k in end..line.len() {
        largest = largest.max(to_place(k, end));
    }
    for pair in homes.windows(2) {
        let [from, to] = [pair[0], pair[1]].map(|home| at(&places[home]));
        let along = to - from;
        for p in &line[pair[0]..=pair[1]] {
            let t = ((at(p) - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            largest = largest.max(at(p).distance(from + along * t));
        }
    }
    largest
}

/// How far normals may part on a chain.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shading {
    /// This many times the chain's own noise does not count; nor does less than `step` (radians).
    pub(super) noise: f32,
    pub(super) step: f32,
    /// A lost normal may be found again this far along the chain.
    pub(super) reach: f64,
}

/// Simplifies the chains on the faces of the node's cell.
pub(super) fn simplify_chains(mesh: &Mesh, budget: &Budget, shading: &Shading) -> Chains {
    let cube = Cube { min: budget.cell_min, units: budget.cell_units };
    let borders = Borders::of(mesh, &cube);
    let on_faces: Vec<_> = borders.edges.iter().filter(|e| borders.faces_of(e) != 0).collect();
    if on_faces.is_empty() {
        return Chains::default();
    }
    let vertices = chain_vertices(mesh, &borders);
    let mut chains = Chains::default();
    for face in 0..6u8 {
        let ends = on_faces.iter().filter(|e| borders.faces_of(e) >> face & 1 == 1).map(|e| e.ends);
        for chain in walk(ends, &borders) {
            let chain: Vec<&ChainVertex> = chain.iter().map(|p| &vertices[p]).collect();
            simplify_chain(&chain, budget, shading, &mut chains);
        }
    }
    chains
}

struct ChainVertex {
    position: [i32; 3],
    normal: Vec3,
    colour: Vec3,
    scalars: Scalars,
}

impl ChainVertex {
    fn at(&self) -> DVec3 {
        DVec3::from_array(self.position.map(f64::from))
    }
}

/// What both cells know of the positions of open edges: means of all the different vertices there.
fn chain_vertices(mesh: &Mesh, borders: &Borders) -> HashMap<u32, ChainVertex> {
    let mut members: HashMap<u32, Vec<Vertex>> =
        borders.edges.iter().flat_map(|e| e.ends).map(|p| (p, Vec::new())).collect();
    for (v, position) in borders.position_of.iter().enumerate() {
        if let Some(members) = members.get_mut(position) {
            members.push(Vertex::of(mesh, v as u32));
        }
    }
    let mean = |(position, mut members): (u32, Vec<Vertex>)| {
        members.sort_unstable();
        members.dedup();
        let scalars = mean_scalars(members.iter().filter_map(|v| Some((v.scalars?, 1.0))));
        // Shape and shading are what they would be without kept numbers.
        members.dedup_by_key(|v| Vertex { scalars: None, ..*v });
        let normal = members.iter().map(|v| Vec3::from_array(v.normal.decode())).sum::<Vec3>();
        let colour =
            members.iter().filter_map(|v| v.colour.as_ref().map(unit_colour)).sum::<Vec3>();
        let vertex = ChainVertex {
            position: borders.positions[position as usize],
            normal: normal.normalize_or(Vec3::Z),
            colour: colour / members.len() as f32,
            scalars,
        };
        (position, vertex)
    };
    members.into_iter().map(mean).collect()
}

/// Chains of positions from anchor to anchor, each in the direction in which it is smaller.
fn walk(edges: impl Iterator<Item = [u32; 2]>, borders: &Borders) -> Vec<Vec<u32>> {
    let mut neighbours: HashMap<u32, Vec<u32>> = HashMap::new();
    for [a, b] in edges {
        neighbours.entry(a).or_default().push(b);
        neighbours.entry(b).or_default().push(a);
    }
    let position = |p: u32| borders.positions[p as usize];
    let mut starts: Vec<u32> = neighbours.keys().copied().collect();
    starts.sort_unstable_by_key(|&p| position(p));
    let is_anchor =
        |p: u32| neighbours[&p].len() != 2 || borders.faces[p as usize].count_ones() > 1;
    let mut done: std::collections::HashSet<[u32; 2]> = Default::default();
    let mut out = Vec::new();
    let mut follow = |start: u32, next: u32, is_anchor: &dyn Fn(u32) -> bool| {
        if !done.insert([start, next]) {
            return None;
        }
        let mut chain = vec![start, next];
        loop {
            let (before, at) = (chain[chain.len() - 2], chain[chain.len() - 1]);
            if is_anchor(at) {
                done.insert([at, before]);
                return Some(chain);
            }
            let on = neighbours[&at].iter().find(|&&n| n != before);
            // Both edges lead back: two edges between the same two positions.
            let on = *on.unwrap_or(&before);
            done.insert([at, before]);
            done.insert([at, on]);
            chain.push(on);
        }
    };
    for &start in starts.iter().filter(|&&p| is_anchor(p)) {
        for &next in &neighbours[&start] {
            out.extend(follow(start, next, &is_anchor));
        }
    }
    // Loops: the smallest position and the one farthest from it are their anchors.
    let mut in_chain: std::collections::HashSet<u32> = out.iter().flatten().copied().collect();
    for &start in &starts {
        if in_chain.contains(&start) {
            continue;
        }
        let Some(whole) = follow(start, neighbours[&start][0], &|p| p == start) else { continue };
        in_chain.extend(&whole);
        let from = position(start);
        let apart2 = |p: u32| -> i64 {
            (0..3).map(|i| (i64::from(position(p)[i]) - i64::from(from[i])).pow(2)).sum()
        };
        let farthest = (1..whole.len() - 1)
            .max_by_key(|&i| (apart2(whole[i]), std::cmp::Reverse(position(whole[i]))));
        let Some(farthest) = farthest else { continue };
        out.push(whole[..=farthest].to_vec());
        out.push(whole[farthest..].to_vec());
    }
    for chain in &mut out {
        let forward = chain.iter().map(|&p| position(p));
        if forward.clone().rev().lt(forward) {
            chain.reverse();
        }
    }
    out
}

/// Finds what is kept of one chain and what everything on it becomes.
fn simplify_chain(chain: &[&ChainVertex], budget: &Budget, shading: &Shading, out: &mut Chains) {
    let last = chain.len() - 1;
    out.lines.push(chain.iter().map(|v| v.position).collect());
    let points: Vec<DVec3> = chain.iter().map(|v| v.at()).collect();
    let rounded: Vec<[i32; 3]> = chain.iter().map(|v| budget.on_grid(v.position)).collect();
    let quarter = budget.cell_units / 4;
    // Finer cells cut the chain where coarser ones do not: what lies on their faces is not kept, so
    // that it does not matter which of them exist on which side.
    let faces = Cube { min: budget.cell_min, units: budget.cell_units };
    let own = faces.faces(chain[0].position) & faces.faces(chain[last].position);
    let is_cut = |v: &ChainVertex| {
        quarter > 1
            && (0..3).any(|i| {
                own >> i & 1 == 0
                    && own >> (i + 3) & 1 == 0
                    && v.position[i].abs_diff(budget.cell_min[i]).is_multiple_of(quarter)
            })
    };
    let candidates: Vec<usize> =
        (0..=last).filter(|&k| k == 0 || k == last || !is_cut(chain[k])).collect();
    let fit =
        Fit { chain, points: &points, rounded: &rounded, tolerance: CHAIN_SHARE * budget.whole };
    let noise = shading_noise(chain);
    let tolerance = (shading.noise * noise).max(shading.step);
    let appearance = fit.fewest(&candidates, Some((tolerance, shading.reach)));
    let geometric = fit.fewest(&appearance, None);

    let along: Vec<f64> = std::iter::once(0.0)
        .chain(points.windows(2).scan(0.0, |sum, pair| {
            *sum += pair[0].distance(pair[1]);
            Some(*sum)
        }))
        .collect();
    // Anchors are on other chains, too.
    let pin_of_kept: HashMap<usize, u32> = appearance
        .iter()
        .map(|&k| {
            let anchor = k == 0 || k == last;
            let known = out.pin_of.get(&chain[k].position).map(|pins| pins[0]);
            let pin = known.unwrap_or_else(|| {
                let [normal, colour] = if anchor {
                    [chain[k].normal, chain[k].colour]
                } else {
                    smoothed(chain, &along, k, budget.whole)
                };
                let scalars = scalars_along(chain, &along, k, budget.whole);
                let scalars = if anchor { chain[k].scalars } else { scalars };
                out.pins.push(Pin { place: rounded[k], normal, colour, scalars });
                out.pins.len() as u32 - 1
            });
            (k, pin)
        })
        .collect();
    let nearest = |kept: &[usize], k: usize| {
        let after = kept.partition_point(|&i| i < k).min(kept.len() - 1);
        let before = after.saturating_sub(usize::from(kept[after] != k));
        let (before, after) = (kept[before], kept[after]);
        if along[k] - along[before] <= along[after] - along[k] { before } else { after }
    };
    for (k, vertex) in chain.iter().enumerate() {
        let kept = nearest(&appearance, k);
        let coarser = nearest(&geometric, kept);
        let pins = [pin_of_kept[&kept], pin_of_kept[&coarser]];
        out.pin_of.entry(vertex.position).or_insert(pins);
    }
}

/// Normal and colour at a vertex, averaged along the chain over what is below resolution.
fn smoothed(chain: &[&ChainVertex], along: &[f64], k: usize, resolution: f64) -> [Vec3; 2] {
    let mut sums = [Vec3::ZERO; 2];
    let mut total = 0.0;
    let mut add = |i: usize| {
        // Half the length of the edges on both sides.
        let stands_for = 0.5 * (along[(i + 1).min(along.len() - 1)] - along[i.saturating_sub(1)]);
        let weight = ((1.0 - (along[i] - along[k]).abs() / resolution) * stands_for) as f32;
        if weight > 0.0 {
            sums[0] += chain[i].normal * weight;
            sums[1] += chain[i].colour * weight;
            total += weight;
        }
        weight > 0.0
    };
    if !add(k) {
        return [chain[k].normal, chain[k].colour];
    }
    (0..k).rev().take_while(|&i| add(i)).for_each(drop);
    (k + 1..chain.len()).take_while(|&i| add(i)).for_each(drop);
    [sums[0].normalize_or(chain[k].normal), sums[1] / total]
}

/// Kept numbers at a vertex, averaged in the same way.
fn scalars_along(chain: &[&ChainVertex], along: &[f64], k: usize, resolution: f64) -> Scalars {
    let weight = |i: usize| {
        let stands_for = along[(i + 1).min(along.len() - 1)] - along[i.saturating_sub(1)];
        (1.0 - (along[i] - along[k]).abs() / resolution) * stands_for
    };
    let is_near = |i: &usize| weight(*i) > 0.0;
    if !is_near(&k) {
        return chain[k].scalars;
    }
    let before = (0..k).rev().take_while(is_near);
    let all = before.chain((k..chain.len()).take_while(is_near));
    mean_scalars(all.map(|i| (chain[i].scalars, weight(i))))
}

/// The median angle between a normal and the mean of those beside it.
fn shading_noise(chain: &[&ChainVertex]) -> f32 {
    let mut angles: Vec<f32> = chain
        .windows(3)
        .map(|w| angle(w[1].normal, (w[0].normal + w[2].normal).normalize_or(w[1].normal)))
        .collect();
    if angles.is_empty() {
        return 0.0;
    }
    let middle = angles.len() / 2;
    *angles.select_nth_unstable_by(middle, f32::total_cmp).1
}

struct Fit<'a> {
    chain: &'a [&'a ChainVertex],
    points: &'a [DVec3],
    rounded: &'a [[i32; 3]],
    tolerance: f64,
}

impl Fit<'_> {
    /// The fewest candidates, first and last among them, whose segments are near enough.
    /// `shading` is a tolerance in radians, and how far along a lost normal may be found again.
    fn fewest(&self, candidates: &[usize], shading: Option<(f32, f64)>) -> Vec<usize> {
        #[derive(Clone, Copy)]
        struct Best {
            segments: u32,
            squares: f64,
            from: usize,
        }
        let nothing = Best { segments: u32::MAX, squares: 0.0, from: 0 };
        let mut best = vec![nothing; candidates.len()];
        best[0].segments = 0;
        for i in 0..candidates.len() - 1 {
            let mut failures = 0;
            for j in i + 1..candidates.len() {
                let squares = self.squares(candidates[i], candidates[j], shading);
                // The next candidate can always be reached.
                let squares = squares.or((j == i + 1).then_some(0.0));
                failures = if squares.is_some() { 0 } else { failures + 1 };
                if failures > FAILURES_MAX || candidates[j] - candidates[i] > SEGMENT_MAX {
                    break;
                }
                let Some(squares) = squares else { continue };
                let (segments, squares) = (best[i].segments + 1, best[i].squares + squares);
                let known = &mut best[j];
                if segments < known.segments
                    || segments == known.segments && squares < known.squares
                {
                    *known = Best { segments, squares, from: i };
                }
            }
        }
        let mut kept = vec![candidates.len() - 1];
        while let Some(&last) = kept.last().filter(|&&last| last > 0) {
            kept.push(best[last].from);
        }
        kept.iter().rev().map(|&i| candidates[i]).collect()
    }

    /// Sum of the squared distances from a segment; `None` where one is too large.
    fn squares(&self, i: usize, j: usize, shading: Option<(f32, f64)>) -> Option<f64> {
        let [from, to] = [i, j].map(|k| DVec3::from_array(self.rounded[k].map(f64::from)));
        let along = to - from;
        let length2 = along.length_squared();
        let [n, m] = [i, j].map(|k| self.chain[k].normal);
        let slope = angle(n, m) / (length2.sqrt() as f32).max(f32::MIN_POSITIVE);
        let mut sum = 0.0;
        for k in i + 1..j {
            let t = ((self.points[k] - from).dot(along) / length2.max(f64::MIN_POSITIVE))
                .clamp(0.0, 1.0);
            let distance2 = self.points[k].distance_squared(from + along * t);
            if distance2 > self.tolerance * self.tolerance {
                return None;
            }
            if let Some((tolerance, reach)) = shading {
                let lost = angle(self.chain[k].normal, n.lerp(m, t as f32).normalize_or(n));
                if lost > tolerance && f64::from(lost - tolerance) > reach * f64::from(slope) {
                    return None;
                }
            }
            sum += distance2;
        }
        Some(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both ways, by samples.
    fn sampled(line: &[[i32; 3]], places: &[[i32; 3]]) -> f64 {
        let at = |p: &[i32; 3]| DVec3::from_array(p.map(f64::from));
        let samples = |line: &[[i32; 3]]| -> Vec<DVec3> {
            let pairs = line.windows(2);
            pairs
                .flat_map(|w| (0..=50).map(move |i| at(&w[0]).lerp(at(&w[1]), f64::from(i) / 50.0)))
                .collect()
        };
        let to_line = |p: DVec3, line: &[[i32; 3]]| {
            let segment = |w: &[[i32; 3]]| {
                let (a, b) = (at(&w[0]), at(&w[1]));
                let along = b - a;
                let t = ((p - a).dot(along) / along.length_squared().max(1e-9)).clamp(0.0, 1.0);
                p.distance(a + along * t)
            };
            line.windows(2).map(segment).fold(f64::INFINITY, f64::min)
        };
        let forward = samples(line).into_iter().map(|p| to_line(p, places));
        let backward = samples(places).into_iter().map(|p| to_line(p, line));
        forward.chain(backward).fold(0.0, f64::max)
    }

    #[test]
    fn deviations_are_bounds_and_close_ones() {
        // A bend that is cut off by 30, the corner going to the nearer end.
        let line = [[0, 0, 0], [100, 30, 0], [300, 0, 0]];
        let places = [[0, 0, 0], [0, 0, 0], [300, 0, 0]];
        assert_eq!(deviation(&line, &places), 30.0);
        assert_eq!(deviation(&line, &line), 0.0);
        assert_eq!(deviation(&line, &[[0, 4, 0], [100, 34, 0], [300, 4, 0]]), 4.0);
        // Everything in one place.
        assert_eq!(deviation(&line, &[[0, 0, 0]; 3]), 300.0);
        let mut state = 7u32;
        let mut random = |n: i32| {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            (state >> 16) as i32 % n
        };
        for _ in 0..200 {
            let line: Vec<[i32; 3]> =
                (0..12).map(|i| [100 * i + random(90), random(200), 0]).collect();
            // Runs of random lengths go to one of their vertices, moved a little.
            let mut places = Vec::new();
            while places.len() < line.len() {
                let run = (1 + random(4) as usize).min(line.len() - places.len());
                let home = line[places.len() + random(run as i32) as usize];
                let place = [home[0] + random(9), home[1] + random(9), 0];
                places.extend(std::iter::repeat_n(place, run));
            }
            let (bound, found) = (deviation(&line, &places), sampled(&line, &places));
            assert!(bound >= found - 1e-9, "{line:?} {places:?}: {bound} < {found}");
        }
    }
}
