//! Proves how far a simplified surface is from its source, and how differently it looks.
//!
//! # What is proven
//!
//! For every point of either surface there is some point of the other within `distance` whose
//! normal differs by at most the angle that goes with it. The first part is a bound of the
//! two-sided Hausdorff distance. Nearest points are not asked for: their normals jump at folds.
//!
//! # Why it holds
//!
//! A triangle is matched with the other surface piece by piece; each piece in one of three ways.
//! - *One triangle* ([`pieces`]). Let `f_i` be points of one triangle of the other surface, one for
//!   each corner `c_i`. Match `Σ λ_i c_i` with `Σ λ_i f_i`, which lies on that triangle because it is
//!   convex. The difference is `Σ λ_i (c_i − f_i)`, no longer than the longest of its terms. The
//!   same holds for normals, which are linear on both pieces.
//! - *Nearest corner* ([`pieces`]). Any point of a triangle is within its longest edge / √3 of a
//!   corner; match it with that corner's foot. Distances add, and so do differences of normals.
//! - *Straight above* ([`cover`]). The other surface is shown to cover the triangle in projection;
//!   heights and differences of normals are linear on the clipped pieces.
//!
//! An angle follows from a difference `δ` of two vectors, of which one is at least `m` long: its
//! sine is at most `δ / m`. `m` is the least of `n_i · n̄` over the triangle's normals, for any unit
//! vector `n̄`, because a projection is linear and no longer than the vector.
//!
//! Rounding: coordinates are integers below 2³¹ relative to the cell's centre, or halved edges of
//! such triangles; computed distances are right to about 10⁻¹² of the largest coordinate.
//! [`ROUNDING`], relative to it, is far above that, is taken off the limit and added to the result.
//! Looks are f32; [`LOOK_ROUNDING`] is added to differences.
//!
//! Based on Guthe, Borodin & Klein, *Fast and accurate Hausdorff distance calculation between
//! meshes* (2005) and Cohen et al., *Appearance-preserving simplification* (1998), who bound
//! deviations by a mapping; the cover by parity is ours.

mod cover;
mod pieces;
mod surface;

use std::cell::Cell;
use std::collections::HashMap;

pub(crate) use surface::{Look, NONE, Surface};

use cover::Cover;
use glam::{DVec3, Vec3};
use pieces::{Bound, Corner, OverLimit, SLACK, Search};
use surface::{Difference, Foot};

/// Relative to the largest coordinate of both surfaces.
const ROUNDING: f64 = 1e-9;

/// f32 interpolation of numbers up to 1, at each of some forty halvings.
const LOOK_ROUNDING: f32 = 1e-5;

/// How often a triangle is matched again, more closely, because its matches carry too much.
const CLOSER_LOOKS: u32 = 3;

/// What is asked of a comparison, in the unit of the positions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ask {
    /// Distances below this are not told apart.
    pub(crate) tolerance: f64,
    /// What a triangle carries and its distance together may not exceed this…
    pub(crate) limit: f64,
    /// …but a distance up to this is no failure however much is carried.
    pub(crate) least: f64,
    /// Near points are good enough up to this distance; beyond it the nearest are looked for.
    pub(crate) near: f64,
}

/// How far a triangle may be from the original, and how differently it may look.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Deviation {
    /// Every point has its match within this.
    pub(crate) distance: f64,
    /// Normals of matches differ by at most this, in radians.
    pub(crate) angle: f32,
}

impl Deviation {
    pub(crate) fn max(self, other: Deviation) -> Deviation {
        // Written out: with f64::max and f32::max side by side, LLVM 22.1 crashes.
        let distance = if other.distance > self.distance { other.distance } else { self.distance };
        let angle = if other.angle > self.angle { other.angle } else { self.angle };
        Deviation { distance, angle }
    }

    /// Of a match of a match: both add.
    pub(crate) fn then(self, next: Deviation) -> Deviation {
        Deviation { distance: self.distance + next.distance, angle: self.angle + next.angle }
    }
}

/// What is known of one triangle against the original, both ways.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Carried {
    /// Of all points of the original that were matched with this triangle.
    pub(crate) forward: Deviation,
    /// Of all points of this triangle.
    pub(crate) backward: Deviation,
}

/// What was found for one triangle of either surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TriangleBound {
    /// Against its matches.
    pub(crate) deviation: Deviation,
    /// Colours of matches differ by at most this.
    pub(crate) colour: f32,
    /// How fast normals change along the steepest edge of the triangles matched, the least of
    /// them; radians a unit of length. Of the simplified surface only.
    pub(crate) normal_slope: f32,
    /// The same of colours.
    pub(crate) colour_slope: f32,
    /// The largest backward deviation that the source's triangles it was matched with carry. Of
    /// the simplified surface only.
    pub(crate) carried: Deviation,
}

/// The comparison of two surfaces.
#[derive(Debug, Default)]
pub(crate) struct Certificate {
    /// Per triangle of the source; `None` where a point is over the limit.
    pub(crate) forward: Vec<Option<TriangleBound>>,
    /// Per triangle of the simplified surface.
    pub(crate) backward: Vec<Option<TriangleBound>>,
    /// Triangles of the source over the limit.
    pub(crate) lost: Vec<u32>,
    /// Triangles of the simplified surface over the limit.
    pub(crate) invented: Vec<u32>,
    /// Triangles of the simplified surface that each of the source's is matched with: those of
    /// triangle t begin at `match_starts[t]`.
    matches: Vec<u32>,
    match_starts: Vec<u32>,
}

/// What an earlier certificate says of a simplified surface that has changed in places.
#[derive(Debug, Default)]
pub(crate) struct Known {
    forward: Vec<Option<TriangleBound>>,
    matches: Vec<Vec<u32>>,
    backward: Vec<Option<TriangleBound>>,
}

impl Certificate {
    /// What the simplified surface's triangles carry, when the source's carry `source`.
    pub(crate) fn carried(&self, source: &[Carried]) -> Vec<Carried> {
        let mut out: Vec<Carried> = self
            .backward
            .iter()
            .map(|b| b.map_or(Deviation::default(), |b| b.carried.then(b.deviation)))
            .map(|backward| Carried { backward, ..Carried::default() })
            .collect();
        for (t, bound) in self.forward.iter().enumerate() {
            let Some(bound) = bound else { continue };
            let before = source.get(t).map_or(Deviation::default(), |c| c.forward);
            let now = before.then(bound.deviation);
            let range = self.match_starts[t] as usize..self.match_starts[t + 1] as usize;
            for &matched in &self.matches[range] {
                let forward = &mut out[matched as usize].forward;
                *forward = forward.max(now);
            }
        }
        out
    }

    pub(crate) fn holds(&self) -> bool {
        self.lost.is_empty() && self.invented.is_empty()
    }

    /// What still holds when `old`, which this is about, has become `new`: a match of triangles
    /// of which neither changed.
    pub(crate) fn still_known(&self, old: &Surface, new: &Surface) -> Known {
        let key = |surface: &Surface, t: usize| {
            surface.triangles[t].map(|v| {
                let (p, look) = (surface.positions[v as usize], surface.looks[v as usize]);
                let look = [look.normal.to_array(), look.colour.to_array()];
                (p.to_array().map(f64::to_bits), look.map(|l| l.map(f32::to_bits)))
            })
        };
        let index: HashMap<_, u32> =
            (0..new.triangles.len()).map(|t| (key(new, t), t as u32)).collect();
        let new_from_old: Vec<Option<u32>> =
            (0..old.triangles.len()).map(|t| index.get(&key(old, t)).copied()).collect();
        let mut known = Known { backward: vec![None; new.triangles.len()], ..Known::default() };
        for (bound, new) in self.backward.iter().zip(&new_from_old) {
            if let Some(new) = new {
                known.backward[*new as usize] = *bound;
            }
        }
        for (t, bound) in self.forward.iter().enumerate() {
            let range = self.match_starts[t] as usize..self.match_starts[t + 1] as usize;
            let matches: Option<Vec<u32>> =
                self.matches[range].iter().map(|&m| new_from_old[m as usize]).collect();
            known.forward.push(bound.filter(|_| matches.is_some()));
            known.matches.push(matches.unwrap_or_default());
        }
        known
    }
}

/// What is compared.
#[derive(Clone, Copy)]
pub(crate) struct Pair<'a> {
    pub(crate) source: &'a Surface,
    /// [`Surface::neighbours`] of the source.
    pub(crate) neighbours: &'a [[u32; 3]],
    pub(crate) simplified: &'a Surface,
    /// What the source's triangles carry; empty where it is the original.
    pub(crate) carried: &'a [Carried],
    /// The vertex of `simplified` near each vertex of `source`, or [`NONE`].
    pub(crate) became: &'a [u32],
}

/// Compares two surfaces that both have triangles; what is `known` is taken over.
pub(crate) fn certify(pair: &Pair<'_>, ask: Ask, known: Known) -> Certificate {
    let Pair { source, neighbours, simplified, .. } = *pair;
    let rounding = ROUNDING * source.largest_coordinate().max(simplified.largest_coordinate());
    let limit = ask.limit - 2.0 * rounding;
    let near = ask.near.min(limit);
    let room = |carried: f64| (limit - carried).max(ask.least - 2.0 * rounding);
    let tolerance = ask.tolerance.max(2.0 * rounding);
    let slopes: Vec<[f32; 2]> =
        (0..simplified.triangles.len() as u32).map(|t| slopes(simplified, t)).collect();
    let is_known = |t: usize| known.forward.get(t).is_some_and(Option::is_some);
    let feet = feet(pair, tolerance, near, is_known);
    // Vertices whose triangles are all known have no foot.
    let found = feet.iter().filter(|f| f.triangle != NONE).map(|f| f.distance);
    let attained = found.filter(|d| *d <= limit).fold(0.0, f64::max);
    let earlier = known.forward.iter().chain(&known.backward).flatten();
    let attained =
        earlier.map(|b| b.deviation.distance / SLACK).fold(attained, f64::max).max(tolerance);

    let mut out = Certificate { match_starts: vec![0], ..Certificate::default() };
    let mut search = Search::new(simplified, attained, limit, near);
    // A triangle of the source near each of the simplified surface.
    let mut near_source = vec![NONE; simplified.triangles.len()];
    let mut last_match = vec![NONE; simplified.triangles.len()];
    for (t, triangle) in source.triangles.iter().enumerate() {
        if is_known(t) {
            out.matches.extend(&known.matches[t]);
            out.forward.push(known.forward[t]);
            known.matches[t].iter().for_each(|&m| near_source[m as usize] = t as u32);
        } else {
            search.limit = room(pair.carried.get(t).map_or(0.0, |c| c.forward.distance));
            search.near = near.min(search.limit);
            let corners = triangle.map(|v| {
                let v = v as usize;
                let mut foot = feet[v];
                if foot.distance > search.near {
                    foot = simplified.closest(source.positions[v], foot.triangle);
                }
                Corner::new(source.positions[v], source.looks[v], foot, simplified)
            });
            let mut least = [f32::INFINITY; 2];
            let found = search.bound(corners, |matched| {
                near_source[matched as usize] = t as u32;
                if last_match[matched as usize] != t as u32 {
                    last_match[matched as usize] = t as u32;
                    out.matches.push(matched);
                }
                least = std::array::from_fn(|i| least[i].min(slopes[matched as usize][i]));
            });
            out.forward.push(match found {
                Ok(bound) => Some(finish(&bound, source, t as u32, least, rounding)),
                Err(OverLimit) => {
                    out.lost.push(t as u32);
                    None
                }
            });
        }
        out.match_starts.push(out.matches.len() as u32);
    }

    let over = VerticesOver::new(&feet, simplified.triangles.len());
    // Heights are no less than distances: where they would loosen the bound, look closer.
    let mut cover = Cover::new(source, neighbours, limit, rounding);
    let mut search = Search::new(source, search.attained, limit, 0.0);
    for t in 0..simplified.triangles.len() as u32 {
        if let Some(bound) = known.backward.get(t as usize).copied().flatten() {
            out.backward.push(Some(bound));
            continue;
        }
        let near = near_source[t as usize];
        let carried = Cell::new(Deviation::default());
        let matched = |t: u32| {
            if let Some(source) = pair.carried.get(t as usize) {
                carried.set(carried.get().max(source.backward));
            }
        };
        // How far it may be depends on what it is matched with: where that carries too much for
        // what was found, look closer.
        let mut allowed = limit;
        let mut found = None;
        for _ in 0..CLOSER_LOOKS {
            carried.set(Deviation::default());
            cover.limit = (search.attained * SLACK).min(allowed);
            search.limit = allowed;
            let seeds = over.of(t).iter().filter_map(|&v| source.star(v).first().copied());
            let seeds = seeds.chain((near != NONE).then_some(near));
            let (corners, looks) = (simplified.corners(t), simplified.corner_looks(t));
            let bound = cover.find(corners, looks, seeds, matched).or_else(|| {
                bound_in_parts(corners, looks, source, &mut cover, &mut search, matched)
            });
            let Some(bound) = bound else { break };
            let room = room(carried.get().distance);
            if bound.distance <= room {
                found = Some(bound);
                break;
            }
            if room >= allowed {
                break;
            }
            allowed = room;
        }
        let slopes = slopes[t as usize];
        out.backward.push(found.map(|bound| TriangleBound {
            carried: carried.get(),
            ..finish(&bound, simplified, t, slopes, rounding)
        }));
        if found.is_none() {
            out.invented.push(t);
        }
    }
    out
}

/// Bounds a triangle of which the source does not cover all, at its border for example: covers what
/// can be covered in halves of halves, and searches for the rest.
fn bound_in_parts(
    corners: [DVec3; 3],
    looks: [Look; 3],
    source: &Surface,
    cover: &mut Cover<'_>,
    search: &mut Search<'_>,
    matched: impl Fn(u32) + Copy,
) -> Option<Bound> {
    let mut out = Bound::default();
    let mut pending = vec![(corners, looks, 0)];
    let mut hint = NONE;
    while let Some((corners, looks, depth)) = pending.pop() {
        let [a, b, c] = corners;
        hint = source.closest((a + b + c) / 3.0, hint).triangle;
        let mut found = cover.find(corners, looks, std::iter::once(hint), matched);
        if found.is_none() && depth < PARTS_DEPTH {
            let middles: [DVec3; 3] =
                std::array::from_fn(|k| (corners[k] + corners[(k + 1) % 3]) * 0.5);
            let middle_looks: [Look; 3] = std::array::from_fn(|k| {
                Look::mix([looks[k], looks[(k + 1) % 3], looks[k]], [0.5, 0.5, 0.0])
            });
            pending.push((middles, middle_looks, depth + 1));
            for k in 0..3 {
                let before = (k + 2) % 3;
                let part = [corners[k], middles[k], middles[before]];
                let part_looks = [looks[k], middle_looks[k], middle_looks[before]];
                pending.push((part, part_looks, depth + 1));
            }
            continue;
        }
        if found.is_none() {
            let corners = std::array::from_fn(|k| {
                Corner::new(corners[k], looks[k], source.closest(corners[k], hint), source)
            });
            found = search.bound(corners, matched).ok();
        }
        let found = found?;
        out.distance = out.distance.max(found.distance);
        out.difference = out.difference.max(found.difference);
    }
    Some(out)
}

/// How often a triangle is quartered before points are searched for one by one.
const PARTS_DEPTH: u32 = 1;

/// The source's vertices by the simplified triangle that their foot lies on.
struct VerticesOver {
    starts: Vec<u32>,
    vertices: Vec<u32>,
}

impl VerticesOver {
    fn new(feet: &[Foot], triangle_count: usize) -> VerticesOver {
        let used = || (0..feet.len()).filter(|&v| feet[v].triangle != NONE);
        let mut starts = vec![0u32; triangle_count + 1];
        used().for_each(|v| starts[feet[v].triangle as usize + 1] += 1);
        (0..triangle_count).for_each(|t| starts[t + 1] += starts[t]);
        let mut vertices = vec![0u32; starts[triangle_count] as usize];
        let mut next = starts.clone();
        for v in used() {
            let at = &mut next[feet[v].triangle as usize];
            vertices[*at as usize] = v as u32;
            *at += 1;
        }
        VerticesOver { starts, vertices }
    }

    fn of(&self, t: u32) -> &[u32] {
        &self.vertices[self.starts[t as usize] as usize..self.starts[t as usize + 1] as usize]
    }
}

/// Near points on the simplified surface, of the vertices whose triangles are not yet known.
fn feet(pair: &Pair<'_>, tolerance: f64, near: f64, is_known: impl Fn(usize) -> bool) -> Vec<Foot> {
    let Pair { source, simplified, became, .. } = *pair;
    let mut feet = vec![Foot::NOWHERE; source.positions.len()];
    let mut last = NONE;
    let unknown = source.triangles.iter().enumerate().filter(|(t, _)| !is_known(*t));
    for &v in unknown.flat_map(|(_, triangle)| triangle) {
        let foot = &mut feet[v as usize];
        if foot.triangle != NONE {
            last = foot.triangle;
            continue;
        }
        let p = source.positions[v as usize];
        let good = |foot: &Foot| {
            let normal = source.looks[v as usize].normal;
            foot.distance <= tolerance && simplified.look_at(foot).normal.dot(normal) > 0.0
        };
        let inside = |foot: &Foot| foot.barycentric.iter().all(|&b| b > 0.0);
        // Neighbours often have their feet on the same triangle.
        if last != NONE {
            *foot = simplified.foot_on(p, last);
        }
        if !(foot.triangle != NONE && inside(foot) && good(foot)) {
            if became[v as usize] != NONE {
                for &t in simplified.star(became[v as usize]) {
                    let other = simplified.foot_on(p, t);
                    if other.distance < foot.distance {
                        *foot = other;
                        if inside(foot) && good(foot) {
                            break;
                        }
                    }
                }
            }
            if foot.triangle != NONE && !inside(foot) && !good(foot) {
                *foot = simplified.walk(p, *foot);
            }
            if foot.triangle == NONE || foot.distance > near {
                *foot = simplified.closest(p, foot.triangle);
            }
        }
        last = foot.triangle;
    }
    feet
}

/// How fast normals and colours change along the steepest edge.
fn slopes(surface: &Surface, triangle: u32) -> [f32; 2] {
    let (positions, looks) = (surface.corners(triangle), surface.corner_looks(triangle));
    let mut out = [0.0f32; 2];
    for i in 0..3 {
        let j = (i + 1) % 3;
        let length = positions[i].distance(positions[j]) as f32;
        let Difference { normal, colour } = looks[i].difference(&looks[j]);
        if length > 0.0 {
            out = [out[0].max(normal / length), out[1].max(colour / length)];
        }
    }
    out
}

fn finish(
    bound: &Bound,
    from: &Surface,
    triangle: u32,
    [normal_slope, colour_slope]: [f32; 2],
    rounding: f64,
) -> TriangleBound {
    let normals = from.corner_looks(triangle).map(|l| l.normal);
    let angle = largest_angle(normals, bound.difference.normal);
    TriangleBound {
        deviation: Deviation { distance: bound.distance + 2.0 * rounding, angle },
        carried: Deviation::default(),
        colour: bound.difference.colour + LOOK_ROUNDING,
        normal_slope,
        colour_slope,
    }
}

/// The largest angle, in radians, between a normal of a triangle and a vector that differs from
/// it by at most `difference`.
pub(crate) fn largest_angle(normals: [Vec3; 3], difference: f32) -> f32 {
    let mean = (normals[0] + normals[1] + normals[2]).normalize_or_zero();
    let shortest = normals.iter().map(|n| n.dot(mean)).fold(1.0, f32::min) - LOOK_ROUNDING;
    let difference = difference + LOOK_ROUNDING;
    if difference < shortest { (difference / shortest).asin() } else { std::f32::consts::PI }
}

#[cfg(test)]
mod tests;
