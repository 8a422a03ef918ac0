//! One walk over a mesh that codes triangles, positions and colours together.
//!
//! Positions are predicted from the triangle behind the gate, and what lies across a gate from
//! the angles at its ends: each helps the other, which is why they share a walk.

use super::cut_border::{Across, Border, Gate, NONE, State, Twins, next_corner};
use super::values::Signed;
use crate::entropy::{Coder, Model};
use crate::{FormatError, Mesh};

/// What encoders know beforehand.
pub(super) struct Truth<'a> {
    mesh: &'a Mesh,
    /// Positions on the page's grid, from its lowest corner.
    positions: &'a [[i32; 3]],
    twins: Twins,
    visited: Vec<bool>,
    /// Of each vertex of the mesh, its number in the page.
    met: Vec<u32>,
    /// The first triangle that may not have been visited.
    first_unvisited: usize,
    /// The first vertex that may not have been met, when all triangles have been visited.
    first_unmet: usize,
}

impl<'a> Truth<'a> {
    pub(super) fn new(mesh: &'a Mesh, positions: &'a [[i32; 3]]) -> Truth<'a> {
        Truth {
            mesh,
            positions,
            twins: Twins::of(&mesh.triangles),
            visited: vec![false; mesh.triangles.len()],
            met: vec![NONE; mesh.positions.len()],
            first_unvisited: 0,
            first_unmet: 0,
        }
    }

    /// A vertex that no triangle uses, once all triangles have been visited.
    fn unmet(&mut self) -> Option<u32> {
        // From where the last one was: searched from the start each time, a page of nothing but
        // these would take the square of their number.
        let unmet = self.met[self.first_unmet..].iter().position(|&m| m == NONE)?;
        self.first_unmet += unmet;
        Some(self.first_unmet as u32)
    }

    fn corner(&self, half_edge: u32) -> u32 {
        self.mesh.triangles.as_flattened()[half_edge as usize]
    }
}

/// What a page declares before its streams.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Declared {
    pub(super) vertices: usize,
    pub(super) triangles: usize,
    /// Highest coordinates on the page's grid; the lowest are 0.
    pub(super) extent: [i32; 3],
    pub(super) has_colours: bool,
    /// For residuals of positions.
    pub(super) shift: u32,
}

/// What came of a walk: the mesh in the page's order, on the page's grid.
#[derive(Debug, Default)]
pub(super) struct Walked {
    pub(super) positions: Vec<[i32; 3]>,
    pub(super) colours: Vec<[u8; 4]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// The two vertices each was predicted from.
    pub(super) parents: Vec<[u32; 2]>,
    /// Which of the page's bounds a vertex lies on: see [`face`].
    faces: Vec<u8>,
    /// Whether a vertex has edges with nothing across.
    pub(super) on_border: Vec<bool>,
    /// Encoders: the mesh's vertex of each of the page's.
    pub(super) sources: Vec<u32>,
}

/// Distributions of everything that is coded.
struct Models {
    across: Vec<Model>,
    met: Model,
    first_known: Model,
    /// Along the surface, again, and across it. Contexts: how far off the ones before were, for vertices
    /// within the page's bounds and on them.
    residual: [Signed<6>; 3],
    on_bounds: [Model; 9],
    start: Signed<3>,
    colour: Signed<8>,
}

struct Walk<'a, 'c, C> {
    coder: &'c mut C,
    declared: Declared,
    truth: Option<Truth<'a>>,
    border: Border,
    models: Models,
    out: Walked,
}

/// Walks over a mesh.
///
/// # Errors
/// Decoders: when the streams do not make a mesh of the declared size.
pub(super) fn walk<C: Coder>(
    coder: &mut C,
    declared: Declared,
    truth: Option<Truth<'_>>,
) -> Result<Walked, FormatError> {
    debug_assert_eq!(C::ENCODES, truth.is_some());
    let Declared { vertices, triangles, shift, .. } = declared;
    let mut walk = Walk {
        coder,
        declared,
        truth,
        border: Border::with_capacity(vertices),
        models: Models {
            across: vec![Model::among(Across::COUNT); ACROSS_CONTEXTS],
            met: Model::default(),
            first_known: Model::among(2),
            residual: [Signed::new(shift), Signed::new(shift), Signed::new(shift)],
            on_bounds: [Model::among(7); 9],
            start: Signed::new(shift),
            colour: Signed::new(0),
        },
        out: Walked {
            positions: Vec::with_capacity(vertices),
            colours: Vec::with_capacity(if declared.has_colours { vertices } else { 0 }),
            triangles: Vec::with_capacity(triangles),
            parents: Vec::with_capacity(vertices),
            faces: Vec::with_capacity(vertices),
            on_border: Vec::with_capacity(vertices),
            sources: Vec::new(),
        },
    };
    while walk.out.triangles.len() < triangles {
        walk.begin()?;
        while let Some(gate) = walk.border.next() {
            walk.turn(gate)?;
        }
    }
    // Vertices that no triangle uses.
    while walk.out.positions.len() < vertices {
        let source = walk.truth.as_mut().and_then(Truth::unmet);
        walk.start_vertex(source.unwrap_or(NONE), 0)?;
    }
    Ok(walk.out)
}

fn bad(why: &str) -> FormatError {
    FormatError::malformed("page", why.to_owned())
}

impl<C: Coder> Walk<'_, '_, C> {
    /// A triangle that nothing visited leads to.
    fn begin(&mut self) -> Result<(), FormatError> {
        let mut triangle = 0;
        let mut corners = [NONE; 3];
        if let Some(truth) = &mut self.truth {
            while truth.visited[truth.first_unvisited] {
                truth.first_unvisited += 1;
            }
            triangle = truth.first_unvisited as u32;
            corners = truth.mesh.triangles[truth.first_unvisited];
            truth.visited[truth.first_unvisited] = true;
        }
        let mut new = [0; 3];
        for (corner, source) in corners.into_iter().enumerate() {
            let met = self.truth.as_ref().map_or(NONE, |t| t.met[source as usize]);
            let known = self.coder.symbol(&mut self.models.first_known, u32::from(met != NONE));
            new[corner] = match known {
                0 => self.start_vertex(source, corner)?,
                1 => self.known_vertex(met)?,
                _ => return Err(bad("a vertex is neither known nor new")),
            };
        }
        self.border.begin(new, [0, 1, 2].map(|corner| 3 * triangle + corner));
        self.out.triangles.push(new);
        Ok(())
    }

    /// A vertex without a triangle to predict it from; `corner` says how far from the one before
    /// it may be.
    fn start_vertex(&mut self, source: u32, corner: usize) -> Result<u32, FormatError> {
        let last = self.out.positions.len().wrapping_sub(1) as u32;
        let predicted = self.out.positions.last().copied().unwrap_or_default();
        let truth = self.truth.as_ref().map(|t| t.positions[source as usize]);
        let mut position = [0; 3];
        for axis in 0..3 {
            let residual = truth.map_or(0, |p| p[axis].wrapping_sub(predicted[axis]));
            let residual = self.models.start.code(self.coder, corner, residual);
            position[axis] = predicted[axis].wrapping_add(residual);
        }
        self.add_vertex(source, position, [last, last])
    }

    fn add_vertex(
        &mut self,
        source: u32,
        position: [i32; 3],
        parents: [u32; 2],
    ) -> Result<u32, FormatError> {
        let new = self.out.positions.len();
        if !C::ENCODES && new >= self.declared.vertices {
            return Err(bad("it has more vertices than declared"));
        }
        self.coder.check_left()?;
        if self.declared.has_colours {
            let predicted = parents.map(|v| self.out.colours.get(v as usize).copied());
            let predicted = predicted.map(Option::unwrap_or_default);
            let truth = self.truth.as_ref().map(|t| t.mesh.colours[source as usize]);
            let colour = self.colour(predicted, truth.unwrap_or_default());
            self.out.colours.push(colour);
        }
        self.out.positions.push(position);
        self.out.parents.push(parents);
        self.out.faces.push(face(position, self.declared.extent));
        self.out.on_border.push(false);
        if let Some(truth) = &mut self.truth {
            truth.met[source as usize] = new as u32;
            self.out.sources.push(source);
        }
        Ok(new as u32)
    }

    /// Green as it differs from its neighbours', the others as they differ from that difference:
    /// lightness changes more than hue.
    fn colour(&mut self, [a, b]: [[u8; 4]; 2], truth: [u8; 4]) -> [u8; 4] {
        let mut out = [0; 4];
        let mut lightness = 0i32;
        let mut context = 0;
        for channel in [1, 0, 2, 3] {
            let mean = (i32::from(a[channel]) + i32::from(b[channel])) >> 1;
            let predicted = if channel == 3 { mean } else { mean + lightness };
            // Modulo 256, so that no residual leaves the range.
            let residual = (i32::from(truth[channel]) - predicted) as i8;
            let residual =
                self.models.colour.code(self.coder, 2 * channel + context, residual.into());
            out[channel] = (predicted.wrapping_add(residual)) as u8;
            if channel == 1 {
                lightness = i32::from(residual as i8);
                context = usize::from(residual.unsigned_abs() > 3);
            }
        }
        out
    }

    /// Which of the vertices there are.
    fn known_vertex(&mut self, met: u32) -> Result<u32, FormatError> {
        let count = self.out.positions.len() as u32;
        let bits = count.checked_ilog2().map_or(0, |log| log + 1);
        let vertex = self.coder.bits(bits, met);
        if vertex < count { Ok(vertex) } else { Err(bad("a triangle uses a vertex to come")) }
    }

    /// Which of the vertices of triangles there are, and a gate that begins there: mostly a few
    /// gates along the loop, where what is left of it is small.
    fn met_vertex(&mut self, gate: u32, source: u32) -> Result<(u32, Option<u32>), FormatError> {
        const STEPS: u32 = 7;
        let met = self.truth.as_ref().map_or(NONE, |t| t.met[source as usize]);
        // What its neighbours in the loop lead to is no vertex met but theirs.
        let at = |walk: &Self, place: u32| match place.checked_sub(STEPS) {
            None => walk.border.along(gate, 2 + place, false),
            Some(steps) => walk.border.along(gate, 3 + steps, true),
        };
        let starts_there = |steps: u32| self.border.gates[at(self, steps) as usize].start == met;
        let place = if C::ENCODES {
            (0..2 * STEPS).find(|&s| starts_there(s)).unwrap_or(2 * STEPS)
        } else {
            0
        };
        let place = self.coder.symbol(&mut self.models.met, place);
        if place < 2 * STEPS {
            let at = at(self, place);
            return Ok((self.border.gates[at as usize].start, Some(at)));
        }
        let vertex = self.known_vertex(met)?;
        Ok((vertex, self.border.at(vertex)))
    }

    /// Turns a gate round its first vertex until there is nothing across.
    fn turn(&mut self, mut gate: u32) -> Result<(), FormatError> {
        loop {
            let g = self.border.gates[gate as usize];
            let around = self.around(&g);
            let (across, sides) = self.truth_across(&g);
            let model = &mut self.models.across[around.context];
            let Some(across) = Across::of_symbol(self.coder.symbol(model, across as u32)) else {
                return Err(bad("an unknown symbol"));
            };
            if across == Across::Nothing {
                self.border.shut(gate);
                self.out.on_border[g.start as usize] = true;
                self.out.on_border[g.end as usize] = true;
                return Ok(());
            }
            if !C::ENCODES && self.out.triangles.len() == self.declared.triangles {
                return Err(bad("it has more triangles than declared"));
            }
            self.coder.check_left()?;
            let half_edges =
                sides.map_or([0; 2], |h| [next_corner(h), next_corner(next_corner(h))]);
            let source = match &self.truth {
                Some(truth) => truth.corner(half_edges[1]),
                None => NONE,
            };
            if let (Some(truth), Some(side)) = (&mut self.truth, sides) {
                truth.visited[side as usize / 3] = true;
            }
            let closes = |open: bool| if open { Ok(()) } else { Err(bad("a closed gate is used")) };
            let (third, next) = match across {
                Across::New => {
                    let position = self.position(&g, &around, source)?;
                    let third = self.add_vertex(source, position, [g.start, g.end])?;
                    (third, Some(self.border.widen(gate, third, None, half_edges)))
                }
                Across::Known => {
                    let (third, met) = self.met_vertex(gate, source)?;
                    (third, Some(self.border.widen(gate, third, met, half_edges)))
                }
                Across::Before => {
                    closes(around.before.is_some())?;
                    self.border.close_before(gate, half_edges);
                    (self.border.gates[g.before as usize].start, None)
                }
                Across::Behind => {
                    closes(around.behind.is_some())?;
                    let next = self.border.close_behind(gate, half_edges);
                    (self.border.gates[g.behind as usize].end, Some(next))
                }
                Across::Both => {
                    closes(around.before.is_some() && around.behind.is_some())?;
                    self.border.close_both(gate);
                    (self.border.gates[g.before as usize].start, None)
                }
                Across::Nothing => return Ok(()),
            };
            self.out.triangles.push([g.start, g.end, third]);
            let Some(next) = next else { return Ok(()) };
            gate = next;
        }
    }

    /// Encoders: what lies across, and the half-edge of that triangle which is the gate.
    fn truth_across(&self, gate: &Gate) -> (Across, Option<u32>) {
        let Some(truth) = &self.truth else { return (Across::Nothing, None) };
        let side = truth.twins.of_half_edge(gate.half_edge);
        if side == NONE || truth.visited[side as usize / 3] {
            return (Across::Nothing, None);
        }
        let joins = |neighbour: u32, edge: u32| {
            let neighbour = &self.border.gates[neighbour as usize];
            neighbour.state == State::Open && truth.twins.of_half_edge(neighbour.half_edge) == edge
        };
        let to_third = next_corner(side);
        let to_start = next_corner(to_third);
        let across = match (joins(gate.before, to_start), joins(gate.behind, to_third)) {
            (true, true) => Across::Both,
            (true, false) => Across::Before,
            (false, true) => Across::Behind,
            (false, false) if truth.met[truth.corner(to_start) as usize] == NONE => Across::New,
            (false, false) => Across::Known,
        };
        (across, Some(side))
    }

    fn at(&self, vertex: u32) -> [i32; 3] {
        self.out.positions[vertex as usize]
    }

    /// The border near a gate.
    #[inline(always)]
    fn around(&self, gate: &Gate) -> Around {
        let (start, end, opposite) =
            (self.at(gate.start), self.at(gate.end), self.at(gate.opposite));
        let along = sub(end, start);
        let normal = cross(sub(opposite, start), along);
        let before = &self.border.gates[gate.before as usize];
        let before = (before.state == State::Open).then_some(before.start);
        let behind = &self.border.gates[gate.behind as usize];
        let behind = (behind.state == State::Open).then_some(behind.end);
        let left = before.map_or(0, |v| gap(along, sub(self.at(v), start), normal));
        let right = behind.map_or(0, |v| gap(sub(self.at(v), end), sub(start, end), normal));
        Around { context: left * GAPS + right, before, behind, normal }
    }

    /// The position of a new vertex across a gate.
    fn position(
        &mut self,
        gate: &Gate,
        around: &Around,
        source: u32,
    ) -> Result<[i32; 3], FormatError> {
        let (start, end, opposite) =
            (self.at(gate.start), self.at(gate.end), self.at(gate.opposite));
        let extent = self.declared.extent;
        // A parallelogram (Touma & Gotsman 1998).
        let along = |i: usize| {
            let sum = i64::from(start[i]) + i64::from(end[i]) - i64::from(opposite[i]);
            sum.clamp(0, i64::from(extent[i])) as i32
        };
        let predicted = [along(0), along(1), along(2)];
        let truth = self.truth.as_ref().map(|t| t.positions[source as usize]);

        // What lies on the page's bounds was cut there: one coordinate costs nothing.
        let faces = [gate.start, gate.end].map(|v| self.out.faces[v as usize]);
        let context = match faces {
            [0, 0] => 0,
            [face, 0] | [0, face] => 1 + usize::from(face),
            _ => 1,
        };
        let truth_face = truth.map_or(0, |p| u32::from(face(p, extent)));
        let on = self.coder.symbol(&mut self.models.on_bounds[context], truth_face) as usize;
        if on > 6 {
            return Err(bad("an unknown symbol"));
        }
        let fixed = (on > 0).then(|| (on - 1) / 2);
        let fixed_at = fixed.map_or(0, |axis| if on % 2 == 1 { 0 } else { extent[axis] });

        // Along the surface first; how far it leads out of its plane is known then.
        let normal = around.normal;
        let size = [normal[0].abs(), normal[1].abs(), normal[2].abs()];
        let across = if size[0] > size[1] && size[0] > size[2] {
            0
        } else if size[1] > size[2] {
            1
        } else {
            2
        };
        let mut position = predicted;
        let mut moved = 0.0;
        let context = 3 * usize::from(fixed.is_some());
        let mut magnitude = 0;
        for (k, axis) in [(across + 1) % 3, (across + 2) % 3, across].into_iter().enumerate() {
            let mut from = i64::from(predicted[axis]);
            if k == 2 && size[across] > 0.0 {
                from += nearest(-moved / normal[across]);
                from = from.clamp(0, i64::from(extent[axis]));
            }
            let from = from as i32;
            if fixed == Some(axis) {
                position[axis] = fixed_at;
            } else {
                let residual = truth.map_or(0, |p| p[axis].wrapping_sub(from));
                let context = context
                    + match magnitude {
                        0..4 => 0,
                        4..12 => 1,
                        _ => 2,
                    };
                let residual = self.models.residual[k].code(self.coder, context, residual);
                magnitude = magnitude.max(residual.unsigned_abs() >> self.declared.shift);
                position[axis] = from.wrapping_add(residual);
            }
            moved += normal[axis] * position[axis].wrapping_sub(predicted[axis]) as f32;
        }
        Ok(position)
    }
}

/// 0, or 1 and 2 for the bounds at low and high x, 3 and 4 for y, 5 and 6 for z: the first of them that
/// a position lies on.
#[inline(always)]
fn face(p: [i32; 3], extent: [i32; 3]) -> u8 {
    let mut face = 0;
    for i in [2, 1, 0] {
        let low = 2 * i as u8 + 1;
        face = if p[i] == extent[i] { low + 1 } else { face };
        face = if p[i] == 0 { low } else { face };
    }
    face
}

/// The border near a gate.
struct Around {
    /// For what lies across.
    context: usize,
    /// Where the gate before begins and the gate behind ends, where these are open.
    before: Option<u32>,
    behind: Option<u32>,
    /// Of the triangle behind the gate, not unit.
    normal: [f32; 3],
}

/// Classes of angles between a gate and its neighbour: closed, below 45, 70, 95, 125, 165°, more.
const GAPS: usize = 7;
const ACROSS_CONTEXTS: usize = GAPS * GAPS;

/// The class of the angle from one direction to another, counter-clockwise round the normal.
#[inline(always)]
fn gap(u: [f32; 3], w: [f32; 3], normal: [f32; 3]) -> usize {
    let cosine = dot(u, w);
    // cos² with its sign against the limits: no root, no division, and no branch.
    let signed = cosine * cosine.abs();
    let squares = dot(u, u) * dot(w, w);
    let class = 1
        + usize::from(signed <= 0.5 * squares)
        + usize::from(signed <= 0.117 * squares)
        + usize::from(signed <= -0.0076 * squares)
        + usize::from(signed <= -0.329 * squares);
    // Turned beyond a straight angle.
    if dot(cross(u, w), normal) < 0.0 { 6 } else { class }
}

/// The nearest whole number, as every machine finds it; far numbers become some near one.
fn nearest(x: f32) -> i64 {
    // A number of this size has no fractional bits left.
    const ROUND: f32 = (3u32 << 22) as f32;
    if x.abs() < (1u32 << 22) as f32 { ((x + ROUND) - ROUND) as i64 } else { 0 }
}

fn sub(a: [i32; 3], b: [i32; 3]) -> [f32; 3] {
    // Wraps where a damaged page leads far away.
    let along = |i: usize| a[i].wrapping_sub(b[i]) as f32;
    [along(0), along(1), along(2)]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
