//! Connectivity: a cut-border machine (Gumhold & Straßer 1998).
//!
//! Triangles are visited one across an edge of those before. The border between what was visited
//! and what was not is a set of loops of *gates*, directed edges as the next triangle has them; a
//! gate's symbol says what lies across it. Gates wait in a queue, and one that was begun is
//! turned round its first vertex until that is surrounded (Touma & Gotsman 1998), which keeps loops
//! round and rarely splits them.
//!
//! Anything can be coded: edges of more than two triangles or of two that disagree about their
//! direction are gates with nothing across, and what touches itself is met again as a vertex that
//! is known already. Two loops that meet so are joined, one that meets itself is split, in two:
//! the same exchange of links.

use std::collections::{HashMap, VecDeque};

/// What lies across a gate v→b, as a symbol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Across {
    /// A triangle with a vertex that was not met before.
    New = 0,
    /// A triangle with the gate before this one in its loop.
    Before = 1,
    /// A triangle with the gate behind this one in its loop.
    Behind = 2,
    /// A triangle with both.
    Both = 3,
    /// Nothing, or nothing that was not visited.
    Nothing = 4,
    /// A triangle with a vertex that was met before.
    Known = 5,
}

impl Across {
    pub(super) const COUNT: usize = 6;

    /// `None` beyond the symbols in use.
    pub(super) fn of_symbol(symbol: u32) -> Option<Across> {
        use Across::*;
        [New, Before, Behind, Both, Nothing, Known].get(symbol as usize).copied()
    }
}

pub(super) const NONE: u32 = u32::MAX;

/// What became of a gate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    /// Its symbol is still to come.
    Open,
    /// Nothing lies across. It stays in its loop.
    Shut,
    /// It was passed and is in no loop any more.
    Passed,
}

/// A directed edge of the border.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gate {
    /// Where it begins; it ends where the next begins.
    pub(super) start: u32,
    /// Where it ends.
    pub(super) end: u32,
    /// The third vertex of the visited triangle behind it.
    pub(super) opposite: u32,
    /// Its loop.
    pub(super) before: u32,
    pub(super) behind: u32,
    pub(super) state: State,
    /// Encoders: the visited triangle's half-edge, 3 × triangle + corner.
    pub(super) half_edge: u32,
}

/// The border and what waits on it.
#[derive(Default)]
pub(super) struct Border {
    pub(super) gates: Vec<Gate>,
    waiting: VecDeque<u32>,
    /// Some gate that begins at each vertex, if one does.
    gate_at: Vec<u32>,
}

impl Border {
    pub(super) fn with_capacity(vertices: usize) -> Border {
        Border {
            gates: Vec::with_capacity(vertices * 4),
            waiting: VecDeque::new(),
            gate_at: Vec::with_capacity(vertices),
        }
    }

    /// The next gate whose symbol is still to come.
    pub(super) fn next(&mut self) -> Option<u32> {
        while let Some(gate) = self.waiting.pop_front() {
            if self.gates[gate as usize].state == State::Open {
                return Some(gate);
            }
        }
        None
    }

    fn add(&mut self, start: u32, end: u32, opposite: u32, half_edge: u32) -> u32 {
        let gate = self.gates.len() as u32;
        let loose = Gate {
            start,
            end,
            opposite,
            before: gate,
            behind: gate,
            state: State::Open,
            half_edge,
        };
        self.gates.push(loose);
        let start = start as usize;
        if start >= self.gate_at.len() {
            self.gate_at.resize(start + 1, NONE);
        }
        self.gate_at[start] = gate;
        gate
    }

    fn link(&mut self, before: u32, behind: u32) {
        self.gates[before as usize].behind = behind;
        self.gates[behind as usize].before = before;
    }

    /// The gates round a triangle that nothing leads to. `half_edges` are those of its edges
    /// a→b, b→c, c→a.
    pub(super) fn begin(&mut self, [a, b, c]: [u32; 3], half_edges: [u32; 3]) {
        // Seen from outside the triangle its edges run the other way.
        let ba = self.add(b, a, c, half_edges[0]);
        let ac = self.add(a, c, b, half_edges[2]);
        let cb = self.add(c, b, a, half_edges[1]);
        for (before, behind) in [(ba, ac), (ac, cb), (cb, ba)] {
            self.link(before, behind);
            self.waiting.push_back(before);
        }
    }

    /// Nothing lies across: the gate stays in its loop, shut.
    pub(super) fn shut(&mut self, gate: u32) {
        self.gates[gate as usize].state = State::Shut;
    }

    fn pass(&mut self, gate: u32) {
        self.gates[gate as usize].state = State::Passed;
    }

    /// A gate that begins at a vertex, if any is known to be in a loop.
    pub(super) fn at(&self, vertex: u32) -> Option<u32> {
        let gate = *self.gate_at.get(vertex as usize)?;
        (gate != NONE && self.gates[gate as usize].state != State::Passed).then_some(gate)
    }

    /// The gate so many before another in its loop, or behind it.
    pub(super) fn along(&self, mut gate: u32, steps: u32, behind: bool) -> u32 {
        for _ in 0..steps {
            let g = &self.gates[gate as usize];
            gate = if behind { g.behind } else { g.before };
        }
        gate
    }

    /// A triangle with a third vertex lies across, at which the gate `met` begins if the vertex is
    /// on the border. Gives the gate to go on with.
    pub(super) fn widen(
        &mut self,
        gate: u32,
        third: u32,
        met: Option<u32>,
        half_edges: [u32; 2],
    ) -> u32 {
        let Gate { start, end, before, behind, .. } = self.gates[gate as usize];
        let first = self.add(start, third, end, half_edges[1]);
        let second = self.add(third, end, start, half_edges[0]);
        self.pass(gate);
        self.link(before, first);
        if let Some(met) = met.filter(|&met| met != gate) {
            let met_before = self.gates[met as usize].before;
            self.link(first, met);
            self.link(met_before, second);
        } else {
            self.link(first, second);
        }
        self.link(second, behind);
        self.waiting.push_back(second);
        first
    }

    /// A triangle with the gate before lies across. Turning ends: the start is surrounded.
    pub(super) fn close_before(&mut self, gate: u32, half_edges: [u32; 2]) {
        let Gate { start, end, before, behind, .. } = self.gates[gate as usize];
        let Gate { start: third, before: far, .. } = self.gates[before as usize];
        let new = self.add(third, end, start, half_edges[0]);
        self.pass(gate);
        self.pass(before);
        self.link(if far == gate { behind } else { far }, new);
        self.link(new, behind);
        self.waiting.push_back(new);
    }

    /// A triangle with the gate behind lies across. Gives the gate to go on with.
    pub(super) fn close_behind(&mut self, gate: u32, half_edges: [u32; 2]) -> u32 {
        let Gate { start, end, before, behind, .. } = self.gates[gate as usize];
        let Gate { end: third, behind: far, .. } = self.gates[behind as usize];
        let new = self.add(start, third, end, half_edges[1]);
        self.pass(gate);
        self.pass(behind);
        self.link(before, new);
        self.link(new, if far == gate { before } else { far });
        new
    }

    /// A triangle with both neighbours lies across.
    pub(super) fn close_both(&mut self, gate: u32) {
        let Gate { before, behind, .. } = self.gates[gate as usize];
        for closed in [gate, before, behind] {
            self.pass(closed);
        }
    }
}

/// Which half-edges belong together. Half-edge 3 × triangle + corner runs from that corner to the
/// next.
pub(super) struct Twins(Vec<u32>);

pub(super) fn next_corner(half_edge: u32) -> u32 {
    if half_edge % 3 == 2 { half_edge - 2 } else { half_edge + 1 }
}

impl Twins {
    /// Twins are two half-edges that run opposite ways between the same vertices, where no third
    /// does.
    pub(super) fn of(triangles: &[[u32; 3]]) -> Twins {
        let corners = triangles.as_flattened();
        let ends = |half_edge: u32| {
            (corners[half_edge as usize], corners[next_corner(half_edge) as usize])
        };
        const SEVERAL: u32 = NONE - 1;
        let mut between: HashMap<(u32, u32), u32> = HashMap::with_capacity(corners.len());
        for half_edge in 0..corners.len() as u32 {
            between.entry(ends(half_edge)).and_modify(|e| *e = SEVERAL).or_insert(half_edge);
        }
        let single = |ends| between.get(&ends).copied().filter(|&e| e != SEVERAL);
        let twin = |half_edge: u32| {
            let (a, b) = ends(half_edge);
            single((a, b)).and(single((b, a))).filter(|_| a != b).unwrap_or(NONE)
        };
        Twins((0..corners.len() as u32).map(twin).collect())
    }

    pub(super) fn of_half_edge(&self, half_edge: u32) -> u32 {
        self.0[half_edge as usize]
    }
}
