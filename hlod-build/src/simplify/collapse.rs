//! Edge collapses on one node's geometry.
//!
//! A collapse merges two neighbours into one vertex at the best place for both quadrics. It is
//! refused where it would lose more than allowed, turn a triangle over, or change how the surface
//! hangs together (link condition, Dey et al. 1999). Which vertices became which is remembered,
//! so that a part that turns out wrong can be taken back: [`Collapser::restore`].
//!
//! Costs are brought up to date only when an edge is about to be collapsed: merging only adds to
//! quadrics, so an old cost is not above the present one, but for rounding to the grid.

use glam::DVec3;

use super::quadric::Quadric;
use super::queue::BucketQueue;
use super::rims::Rims;
use crate::certificate::NONE;

/// Lengths are those of the positions; squared attributes are in the attributes' unit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Vertices are placed on multiples of this, counted from `origin`.
    pub(super) grid: f64,
    pub(super) origin: DVec3,
    /// What attributes may lose; `None` where they do not count.
    pub(super) attributes: Option<AttributeLimits>,
}

impl Limits {
    /// The nearest place on the grid, but for coordinates that are fixed.
    fn rounded(&self, place: DVec3, fixed: [Option<f64>; 3]) -> DVec3 {
        let steps = ((place - self.origin) / self.grid).round();
        let rounded = self.origin + steps * self.grid;
        DVec3::from_array(std::array::from_fn(|i| fixed[i].unwrap_or(rounded[i])))
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct AttributeLimits {
    /// A difference of 1 counts as much as this length when a place is chosen.
    pub(super) length: f64,
    /// Differences below this are noise.
    pub(super) tolerance: f64,
    /// How far away on the surface a lost value may be found again.
    pub(super) reach: f64,
}

/// What a vertex starts as.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex<const K: usize> {
    pub(super) position: DVec3,
    pub(super) attributes: [f64; K],
    /// Coordinates that stay: the vertex lies on such faces of the cell.
    pub(super) fixed: [bool; 3],
    /// Root mean square distance that it may be from the planes it stands for.
    pub(super) allowance: f64,
    /// Which pin it becomes in the end; [`NONE`] where it is free. Pinned, it stays where it is
    /// until it becomes that.
    pub(super) pin: u32,
}

/// What all vertices with the same pin become.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pin<const K: usize> {
    pub(super) place: DVec3,
    pub(super) attributes: [f64; K],
}

const DEAD: [u32; 3] = [NONE; 3];

/// How a vertex lies on the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    Inside,
    /// On an open edge.
    Border,
    /// Where more than two triangles meet at an edge, or neighbours face opposite ways.
    Junction,
}

pub(super) struct Collapser<'a, const K: usize> {
    source: &'a [Vertex<K>],
    source_triangles: &'a [[u32; 3]],
    vertices: Vec<Vertex<K>>,
    pins: Vec<Pin<K>>,
    /// The pin of each source vertex.
    pin_of_source: Vec<u32>,
    /// Pins whose vertices stay where the source has them, because certainty needs them there.
    released: Vec<bool>,
    quadrics: Vec<Quadric<K>>,
    rims: Rims,
    places: Vec<Place>,
    /// How often what a vertex stands for was taken back; each time it may lose less: [`CAUTION`].
    caution: Vec<u8>,
    /// Which vertex a vertex was merged into; itself where none.
    merged_into: Vec<u32>,
    /// Triangles by source triangle, with the vertices that theirs were merged into.
    triangles: Vec<[u32; 3]>,
    /// Corners (3 × triangle + which) of the same vertex, in a ring.
    next_corner: Vec<u32>,
    a_corner: Vec<u32>,
    /// Marks neighbours during one check.
    stamps: Vec<u32>,
    stamp: u32,
}

impl<'a, const K: usize> Collapser<'a, K> {
    pub(super) fn new(source: &'a [Vertex<K>], source_triangles: &'a [[u32; 3]]) -> Self {
        let count = source.len();
        let mut this = Collapser {
            source,
            source_triangles,
            vertices: source.to_vec(),
            pins: Vec::new(),
            pin_of_source: vec![NONE; count],
            released: Vec::new(),
            quadrics: vec![Quadric::default(); count],
            rims: Rims::none_of(count),
            places: vec![Place::Inside; count],
            caution: vec![0; count],
            merged_into: (0..count as u32).collect(),
            triangles: Vec::new(),
            next_corner: Vec::new(),
            a_corner: Vec::new(),
            stamps: vec![0; count],
            stamp: 0,
        };
        this.gather_quadrics(|_| true);
        this.connect();
        this.find_places(|_| true);
        this
    }

    /// Says what becomes of vertices on chains: `pin_of_source` has a pin, or [`NONE`], for each
    /// vertex of the source. What was merged by earlier pins must have the same one now.
    pub(super) fn pin(&mut self, pins: Vec<Pin<K>>, pin_of_source: Vec<u32>) {
        self.released = vec![false; pins.len()];
        self.pins = pins;
        self.pin_of_source = pin_of_source;
        for v in 0..self.source.len() {
            self.pin_vertex(v);
        }
    }

    fn pin_vertex(&mut self, v: usize) {
        let pin = self.pin_of_source[v];
        let vertex = &mut self.vertices[v];
        vertex.pin = pin;
        if pin != NONE {
            vertex.fixed = [true; 3];
            if self.released[pin as usize] {
                vertex.pin = NONE;
            }
        }
    }

    /// Makes everything that is pinned what it is to become, whatever that does to triangles.
    fn settle(&mut self) {
        for t in 0..self.triangles.len() {
            for k in 0..3 {
                let triangle = self.triangles[t];
                if triangle == DEAD {
                    break;
                }
                let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
                let pin = self.vertices[a as usize].pin;
                if pin != NONE && pin == self.vertices[b as usize].pin {
                    self.collapse(a, b, self.pins[pin as usize].place);
                }
            }
        }
        for v in 0..self.source.len() {
            let pin = self.vertices[v].pin;
            if self.merged_into[v] == v as u32 && pin != NONE {
                let Pin { place, attributes } = self.pins[pin as usize];
                self.vertices[v].position = place;
                self.vertices[v].attributes = attributes;
            }
        }
    }

    /// Adds the source's planes and fields to the quadrics of the source vertices chosen.
    fn gather_quadrics(&mut self, chosen: impl Fn(u32) -> bool) {
        for t in self.source_triangles {
            if !t.iter().any(|&v| chosen(v)) {
                continue;
            }
            let [a, b, c] = t.map(|v| &self.source[v as usize]);
            let positions = [a.position, b.position, c.position];
            let attributes = [&a.attributes, &b.attributes, &c.attributes];
            if let Some(quadric) = Quadric::of_triangle(positions, attributes) {
                for &v in t.iter().filter(|&&v| chosen(v)) {
                    self.quadrics[v as usize].add(&quadric);
                }
            }
        }
    }

    /// Triangles and rings of corners from what vertices were merged into.
    fn connect(&mut self) {
        for v in 0..self.merged_into.len() as u32 {
            self.merged_into[v as usize] = self.root(v);
        }
        let merged = &self.merged_into;
        let map = |t: &[u32; 3]| {
            let t = t.map(|v| merged[v as usize]);
            if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] { DEAD } else { t }
        };
        self.triangles = self.source_triangles.iter().map(map).collect();
        self.next_corner = vec![NONE; 3 * self.triangles.len()];
        self.a_corner = vec![NONE; self.source.len()];
        for (corner, &v) in self.triangles.as_flattened().iter().enumerate() {
            if v == NONE {
                continue;
            }
            let first = self.a_corner[v as usize];
            if first == NONE {
                self.a_corner[v as usize] = corner as u32;
                self.next_corner[corner] = corner as u32;
            } else {
                self.next_corner[corner] = self.next_corner[first as usize];
                self.next_corner[first as usize] = corner as u32;
            }
        }
    }

    fn root(&self, mut v: u32) -> u32 {
        while self.merged_into[v as usize] != v {
            v = self.merged_into[v as usize];
        }
        v
    }

    /// Like [`Self::root`], and shortens the way for the next time.
    fn find(&mut self, mut v: u32) -> u32 {
        while self.merged_into[v as usize] != v {
            let next = self.merged_into[v as usize];
            self.merged_into[v as usize] = self.merged_into[next as usize];
            v = self.merged_into[v as usize];
        }
        v
    }

    /// Calls `visit(triangle, corners)` for the living triangles round a vertex, corners beginning
    /// with the vertex itself, and takes dead ones out of its ring.
    fn for_each_round(&mut self, v: u32, mut visit: impl FnMut(u32, [u32; 3])) {
        let start = self.a_corner[v as usize];
        if start == NONE {
            return;
        }
        let mut previous = start;
        let mut living = NONE;
        loop {
            let corner = self.next_corner[previous as usize];
            let triangle = corner / 3;
            let t = self.triangles[triangle as usize];
            let last = corner == start;
            if t == DEAD {
                // `previous` may be the dead start itself, which then drops out as well.
                self.next_corner[previous as usize] = self.next_corner[corner as usize];
                if last {
                    break;
                }
                continue;
            }
            let k = (corner % 3) as usize;
            visit(triangle, [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]);
            living = corner;
            previous = corner;
            if last {
                break;
            }
        }
        self.a_corner[v as usize] = living;
    }

    /// Finds open and non-manifold edges of the chosen vertices, and keeps the open ones where
    /// they are.
    fn find_places(&mut self, chosen: impl Fn(u32) -> bool) {
        let mut round = Vec::new();
        for v in 0..self.source.len() as u32 {
            if self.merged_into[v as usize] != v || !chosen(v) {
                continue;
            }
            self.places[v as usize] = self.place_of(v, &mut round);
            for edge in round.chunk_by(|a, b| a.0 == b.0) {
                if let &[(other, leaving, triangle)] = edge {
                    self.add_border(v, other, leaving, triangle);
                }
            }
        }
    }

    /// How a vertex lies on the surface; `round` is filled with its edges in the order of their
    /// other ends: that end, whether the triangle's direction leaves the vertex, the triangle.
    fn place_of(&mut self, v: u32, round: &mut Vec<(u32, bool, u32)>) -> Place {
        round.clear();
        self.for_each_round(v, |t, [_, next, previous]| {
            round.push((next, true, t));
            round.push((previous, false, t));
        });
        round.sort_unstable();
        let mut place = Place::Inside;
        for edge in round.chunk_by(|a, b| a.0 == b.0) {
            match edge {
                [(_, false, _), (_, true, _)] => {}
                [_] if place == Place::Inside => place = Place::Border,
                [_] => {}
                _ => place = Place::Junction,
            }
        }
        place
    }

    fn add_border(&mut self, v: u32, other: u32, leaving: bool, triangle: u32) {
        let opposite =
            self.triangles[triangle as usize].into_iter().find(|&c| c != v && c != other);
        let at = |v: u32| self.vertices[v as usize].position;
        let (from, to) = if leaving { (v, other) } else { (other, v) };
        if let Some(opposite) = opposite {
            let edge = [at(from), at(to), at(opposite)];
            self.quadrics[v as usize].add_border(edge);
            self.rims.add_edge(v, edge);
        }
    }

    /// Moves vertices to the best places for the planes alone.
    pub(super) fn relax(&mut self, limits: &Limits) {
        for v in 0..self.source.len() as u32 {
            if self.merged_into[v as usize] != v {
                continue;
            }
            let vertex = &self.vertices[v as usize];
            if vertex.position == self.source[v as usize].position {
                continue;
            }
            let fixed = std::array::from_fn(|i| vertex.fixed[i].then_some(vertex.position[i]));
            let quadric = &self.quadrics[v as usize];
            let before = quadric.plane_error(vertex.position);
            let place = quadric.best_place(vertex.position, fixed, 0.0);
            let place = limits.rounded(place, fixed);
            if !place.is_finite() {
                continue;
            }
            if quadric.plane_error(place) < before && self.keeps_facing(v, NONE, place) {
                self.vertices[v as usize].position = place;
                self.vertices[v as usize].attributes =
                    self.quadrics[v as usize].attributes_at(place);
            }
        }
    }

    /// Collapses edges between chosen vertices, cheapest first, as far as `limits` allow.
    pub(super) fn run(&mut self, limits: &Limits, chosen: impl Fn(u32) -> bool) {
        let mut queue = BucketQueue::default();
        // What was refused may become possible when the surroundings have changed.
        loop {
            for t in 0..self.triangles.len() {
                let triangle = self.triangles[t];
                if triangle == DEAD {
                    continue;
                }
                for k in 0..3 {
                    let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
                    // Seen from both sides unless it is open.
                    let once = a < b || self.places[a as usize] != Place::Inside;
                    if once && chosen(a) && chosen(b) {
                        let candidate = self.candidate(a, b, limits);
                        queue.push(BucketQueue::bucket_of(candidate.cost), [a, b]);
                    }
                }
            }
            let mut collapsed = 0;
            let mut tried = 0;
            while let Some((bucket, [a, b])) = queue.pop() {
                let (a, b) = (self.find(a), self.find(b));
                if a == b {
                    continue;
                }
                let candidate = self.candidate(a, b, limits);
                let now = BucketQueue::bucket_of(candidate.cost);
                if now > bucket {
                    queue.push(now, [a, b]);
                    continue;
                }
                tried += 1;
                if self.allows(a, b, &candidate, limits) {
                    // What is pinned stays itself.
                    let pinned = self.vertices[a as usize].fixed == [true; 3];
                    let (a, b) = if pinned { (b, a) } else { (a, b) };
                    self.collapse(a, b, candidate.place);
                    collapsed += 1;
                }
            }
            if collapsed * RETRY_SHARE <= tried {
                break;
            }
        }
        self.settle();
    }

    fn candidate(&self, a: u32, b: u32, limits: &Limits) -> Candidate {
        let [va, vb] = [a, b].map(|v| &self.vertices[v as usize]);
        let quadric = self.quadrics[a as usize].sum(&self.quadrics[b as usize]);
        let middle = (va.position + vb.position) * 0.5;
        let fixed =
            std::array::from_fn(|i| [va, vb].iter().find(|v| v.fixed[i]).map(|v| v.position[i]));
        let length = limits.attributes.map_or(0.0, |l| l.length);
        let reach = va.position.distance(vb.position);
        let same_pin = va.pin != NONE && va.pin == vb.pin;
        let mut place = if same_pin {
            self.pins[va.pin as usize].place
        } else {
            quadric.best_place(middle, fixed, length)
        };
        let off2 = place.distance_squared(middle);
        // Not a number where nothing has an area.
        if !same_pin && (off2.is_nan() || off2 > reach * reach) {
            // The planes hardly meet: anywhere on them is as good.
            place = DVec3::from_array(std::array::from_fn(|i| fixed[i].unwrap_or(middle[i])));
        }
        if !same_pin {
            place = limits.rounded(place, fixed);
        }
        let distance2 = quadric.plane_error(place);
        let attribute2 = if length > 0.0 { quadric.attribute_error(place) } else { 0.0 };
        let error2 = distance2 + length * length * attribute2;
        // The second term orders what is flat: short edges first.
        let cost = quadric.area * (error2 + 1e-6 * reach * reach);
        Candidate { place, cost, distance2, attribute2 }
    }

    fn allows(&mut self, a: u32, b: u32, candidate: &Candidate, limits: &Limits) -> bool {
        let caution = self.caution[a as usize].max(self.caution[b as usize]);
        let share = CAUTION.powi(caution.into());
        let [va, vb] = [a, b].map(|v| &self.vertices[v as usize]);
        if va.pin != NONE && va.pin == vb.pin {
            // It has to be sooner or later: now, if nothing turns over.
            return self.keeps_the_link(a, b)
                && self.keeps_facing(a, b, candidate.place)
                && self.keeps_facing(b, a, candidate.place);
        }
        if candidate.distance2 > (va.allowance.min(vb.allowance) * share).powi(2) {
            return false;
        }
        if self.rims.error(a, b, candidate.place)
            > (RIM_SHARE * va.allowance.min(vb.allowance) * share).powi(2)
        {
            return false;
        }
        // Two vertices that lie on the same plane of a cell's face but at different heights
        // cannot both stay.
        if (0..3).any(|i| va.fixed[i] && vb.fixed[i] && va.position[i] != vb.position[i]) {
            return false;
        }
        if !self.keeps_the_link(a, b) {
            return false;
        }
        if !(self.keeps_facing(a, b, candidate.place) && self.keeps_facing(b, a, candidate.place)) {
            return false;
        }
        match limits.attributes {
            Some(attributes) => {
                let lost = candidate.attribute2.sqrt();
                let rest = lost - attributes.tolerance;
                rest <= 0.0 || rest <= attributes.reach * share * self.slope_round(a, b, candidate)
            }
            None => true,
        }
    }

    /// Whether the surface stays of one piece and two-sided: the neighbours that both have are
    /// the third corners of the triangles at the edge, and no triangle would lie on another.
    fn keeps_the_link(&mut self, a: u32, b: u32) -> bool {
        self.stamp += 2;
        let (of_a, of_both) = (self.stamp - 1, self.stamp);
        let mut stamps = std::mem::take(&mut self.stamps);
        let (mut at_edge, mut around) = (0, 0);
        self.for_each_round(a, |_, [_, p, q]| {
            stamps[p as usize] = of_a;
            stamps[q as usize] = of_a;
            at_edge += u32::from(p == b || q == b);
            around += 1;
        });
        let mut common = 0;
        self.for_each_round(b, |_, corners| {
            around += 1;
            for v in corners {
                if stamps[v as usize] == of_a && v != a && v != b {
                    stamps[v as usize] = of_both;
                    common += 1;
                }
            }
        });
        let mut doubled = [false; 2];
        for (v, other, found) in [(a, b, 0), (b, a, 1)] {
            self.for_each_round(v, |_, [_, p, q]| {
                let both = stamps[p as usize] == of_both && stamps[q as usize] == of_both;
                doubled[found] |= both && p != other && q != other;
            });
        }
        self.stamps = stamps;
        // An inner edge between two borders, or between two places where sheets meet, would pinch
        // the surface; along such a line the edge is itself open or shared by more than two.
        let inside = [a, b].map(|v| self.places[v as usize] == Place::Inside);
        let pinches = !inside[0] && !inside[1] && at_edge == 2;
        // A piece of its own must not vanish.
        let remains = around > 2 * at_edge;
        common == at_edge && at_edge > 0 && remains && !(doubled[0] && doubled[1]) && !pinches
    }

    /// Whether no triangle of `v` without `other` turns over, or becomes a needle, when `v` moves.
    fn keeps_facing(&mut self, v: u32, other: u32, place: DVec3) -> bool {
        let vertices = std::mem::take(&mut self.vertices);
        let mut keeps = true;
        self.for_each_round(v, |_, [_, p, q]| {
            if p == other || q == other || !keeps {
                return;
            }
            let [o, p, q] = [v, p, q].map(|v| vertices[v as usize].position);
            let before = (p - o).cross(q - o);
            let after = (p - place).cross(q - place);
            let (b2, a2) = (before.length_squared(), after.length_squared());
            let dot = before.dot(after);
            let turned = b2 > 0.0 && (dot <= 0.0 || dot * dot < FACING * FACING * b2 * a2);
            let longest2 = (p - place)
                .length_squared()
                .max((q - place).length_squared())
                .max((q - p).length_squared());
            let needle = a2 < NEEDLE * NEEDLE * longest2 * longest2 && a2 < b2;
            keeps = !turned && !needle;
        });
        self.vertices = vertices;
        keeps
    }

    /// How fast attributes change along the surface round the merged vertex: the least, over its
    /// triangles, of the steepest edge.
    fn slope_round(&mut self, a: u32, b: u32, candidate: &Candidate) -> f64 {
        let quadric = self.quadrics[a as usize].sum(&self.quadrics[b as usize]);
        let here = Vertex::<K> {
            position: candidate.place,
            attributes: quadric.attributes_at(candidate.place),
            fixed: [false; 3],
            allowance: 0.0,
            pin: NONE,
        };
        let vertices = std::mem::take(&mut self.vertices);
        let slope = |p: &Vertex<K>, q: &Vertex<K>| {
            let difference: f64 = (0..K).map(|k| (p.attributes[k] - q.attributes[k]).powi(2)).sum();
            (difference / p.position.distance_squared(q.position).max(f64::MIN_POSITIVE)).sqrt()
        };
        let mut least = f64::INFINITY;
        for (v, other) in [(a, b), (b, a)] {
            self.for_each_round(v, |_, [_, p, q]| {
                if p != other && q != other {
                    let [p, q] = [p, q].map(|v| &vertices[v as usize]);
                    let steepest = slope(&here, p).max(slope(&here, q)).max(slope(p, q));
                    least = least.min(steepest);
                }
            });
        }
        self.vertices = vertices;
        if least.is_finite() { least } else { 0.0 }
    }

    /// Merges `a` into `b`.
    fn collapse(&mut self, a: u32, b: u32, place: DVec3) {
        let mut dead = Vec::new();
        let mut moved = Vec::new();
        self.for_each_round(
            a,
            |t, [_, p, q]| {
                if p == b || q == b { dead.push(t) } else { moved.push(t) }
            },
        );
        for t in moved {
            let triangle = &mut self.triangles[t as usize];
            triangle.iter_mut().filter(|v| **v == a).for_each(|v| *v = b);
        }
        for t in dead {
            self.triangles[t as usize] = DEAD;
        }
        let (ring_a, ring_b) = (self.a_corner[a as usize], self.a_corner[b as usize]);
        if ring_b == NONE {
            self.a_corner[b as usize] = ring_a;
        } else if ring_a != NONE {
            // Two rings become one when they exchange successors.
            self.next_corner.swap(ring_a as usize, ring_b as usize);
        }
        self.a_corner[a as usize] = NONE;

        self.merged_into[a as usize] = b;
        let quadric = self.quadrics[a as usize];
        self.quadrics[b as usize].add(&quadric);
        self.rims.merge(a, b);
        let Vertex { fixed, allowance, pin, .. } = self.vertices[a as usize];
        let pinned =
            [a, b].map(|v| self.vertices[v as usize]).into_iter().find(|v| v.fixed == [true; 3]);
        let merged = &mut self.vertices[b as usize];
        merged.position = place;
        merged.attributes = self.quadrics[b as usize].attributes_at(place);
        merged.fixed = std::array::from_fn(|i| merged.fixed[i] || fixed[i]);
        merged.allowance = merged.allowance.min(allowance);
        if merged.pin == NONE {
            merged.pin = pin;
        }
        if let Some(pinned) = pinned {
            merged.attributes = pinned.attributes;
        }
        self.places[b as usize] = self.places[b as usize].max(self.places[a as usize]);
        self.caution[b as usize] = self.caution[b as usize].max(self.caution[a as usize]);
    }

    /// Takes back everything that was merged into the given vertices, which may lose less from now
    /// on. Says which source vertices stand for themselves again.
    ///
    /// With `release`, what is wrong and pinned is never moved again.
    pub(super) fn restore(&mut self, wrong: impl Fn(u32) -> bool, release: bool) -> Vec<bool> {
        let roots: Vec<u32> = (0..self.source.len() as u32).map(|v| self.root(v)).collect();
        let mut wrong: Vec<bool> = (0..self.source.len() as u32).map(wrong).collect();
        let caution: Vec<u8> = roots.iter().map(|&root| self.caution[root as usize]).collect();
        let mut round = Vec::new();
        loop {
            self.merged_into.copy_from_slice(&roots);
            for v in (0..self.source.len()).filter(|&v| wrong[roots[v] as usize]) {
                self.merged_into[v] = v as u32;
            }
            self.connect();
            // What is left merged was merged when its surroundings were, too: without them it may
            // pinch the surface, and is taken back as well.
            let mut pinches = false;
            for v in 0..self.source.len() as u32 {
                let merged = roots[v as usize] == v && !wrong[v as usize];
                if merged && self.places[v as usize] != Place::Junction {
                    let pinched = self.place_of(v, &mut round) == Place::Junction;
                    wrong[v as usize] = pinched;
                    pinches |= pinched;
                }
            }
            if !pinches {
                break;
            }
        }
        let restored: Vec<bool> = roots.iter().map(|&root| wrong[root as usize]).collect();
        if release {
            for v in (0..self.source.len()).filter(|&v| restored[v]) {
                if let Some(released) = self.released.get_mut(self.pin_of_source[v] as usize) {
                    *released = true;
                }
            }
        }
        for v in (0..self.source.len()).filter(|&v| restored[v]) {
            self.caution[v] = caution[v].saturating_add(1);
            self.vertices[v] = self.source[v];
            self.quadrics[v] = Quadric::default();
            self.rims.forget(v as u32);
            self.pin_vertex(v);
        }
        self.gather_quadrics(|v| restored[v as usize]);
        self.find_places(|v| restored[v as usize]);
        // The borders of the others were counted when theirs were.
        for v in 0..self.source.len() as u32 {
            if roots[v as usize] == v && !restored[v as usize] {
                self.places[v as usize] = self.place_of(v, &mut round);
            }
        }
        restored
    }

    /// Which vertex a source vertex has become.
    pub(super) fn vertex_of(&self, source: u32) -> u32 {
        self.root(source)
    }

    /// Vertices, by the numbers of the source's; valid for those that triangles use.
    pub(super) fn vertices(&self) -> &[Vertex<K>] {
        &self.vertices
    }

    pub(super) fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.triangles.iter().copied().filter(|t| *t != DEAD)
    }
}

/// What a collapse would do.
struct Candidate {
    place: DVec3,
    cost: f64,
    distance2: f64,
    attribute2: f64,
}

/// What was wrong may lose this share of what it might have lost before. Much less, and a patch of
/// which one point was over the limit comes back with twice the triangles.
const CAUTION: f64 = 0.8;

/// An open edge may be so much of what a surface may be from where it was: it is an outline from everywhere.
const RIM_SHARE: f64 = 0.5;

/// Another round is worth it while at least one of this many tries succeeded.
const RETRY_SHARE: usize = 20;

/// Cosine of the most that a triangle may turn in one collapse.
const FACING: f64 = 0.2;

/// Double area over squared longest edge, below which a triangle is a needle.
const NEEDLE: f64 = 0.02;
