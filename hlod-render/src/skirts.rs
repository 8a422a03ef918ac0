//! Skirts: what keeps the seams between drawn nodes closed, whatever their depths.
//!
//! The surface in a cell ends on the cell's faces, in lines that are simplified *in* these faces. So between two nodes
//! that are drawn side by side, of whatever depths, there is at most a slit in their common face, between the lines in
//! which either ends. Every border line carries a strip in the face, into the body, that reaches past the other node's
//! line: how far is measured between the two nodes that are drawn ([`crate::seams`]).
//!
//! Where one border lies above the other its strip reaches past the other, so that no line of sight
//! gets through; and a strip that goes only inwards moves no outline of a body that is thicker.
//!
//! Where several triangles have an edge that lies in a face, and none of them lies in the face itself, sheets lie on each
//! other there, each with a border: beside them, in another depth, they may be apart. Each carries its strip, so that what
//! is between them is covered from both.
//!
//! Components smaller than the node's budget e/R have no strips: they may vanish as a whole, and a
//! strip would be larger than they are.
//!
//! Nodes of equal depth mostly end in the same lines, edge for edge: then there is no slit, and neither
//! carries its strip in that face ([`find_open_faces`]).
//!
//! A strip's lower corners are copies of the border's vertices that say how far they are to be moved, and are named in
//! indices that say in which face; the vertex shader moves them inwards (`shared.wgsl`).

use std::collections::{BTreeMap, HashMap};

use hlod_compress::{CellKey, Lattice, Mesh};

use crate::select::Draw;
use crate::skeleton::Skeleton;

/// Set in an index whose vertex is to be moved inwards, in the face across the axis that the two bits
/// below say.
pub const MOVED: u32 = 1 << 31;
/// Where those two bits are.
pub const AXIS_SHIFT: u32 = 29;
/// Vertices of a buffer have smaller numbers.
pub const VERTICES_MAX: u32 = 1 << AXIS_SHIFT;

/// Faces of a cell, a bit each: `axis` for the lower one across it, `3 + axis` for the upper.
pub type Faces = u8;
/// All of them.
pub const ALL_FACES: Faces = 0x3f;

/// The strips along the borders of one cell's geometry.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Skirts {
    /// Three for each triangle, those of a group next to one another.
    pub indices: Vec<u32>,
    /// Groups in the order of their triangles.
    pub groups: Vec<SkirtGroup>,
    /// What the geometry ends in on each face.
    pub borders: Borders,
    /// Of which vertex each lower corner is a copy. Indices name it by its number here after the vertices.
    pub corners: Vec<u32>,
    /// The lines that strips hang from, face by face.
    pub lines: [FaceLines; 6],
}

/// The lines that strips hang from in one face of a cell, and in its other faces that they also run in.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FaceLines {
    /// Places on the lattice, across the face's axis, in ascending order.
    pub points: Vec<[i32; 2]>,
    /// Their numbers, by their second coordinate.
    pub across: Vec<u32>,
    /// Between two of them each.
    pub edges: Vec<LineEdge>,
}

impl FaceLines {
    /// Of points in ascending order.
    pub fn new(points: Vec<[i32; 2]>, edges: Vec<LineEdge>) -> FaceLines {
        let mut across: Vec<u32> = (0..points.len() as u32).collect();
        across.sort_unstable_by_key(|&k| points[k as usize][1]);
        FaceLines { points, across, edges }
    }
}

/// A part of a line that a strip hangs from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineEdge {
    /// Numbers of its ends among the face's points.
    pub points: [u32; 2],
    /// Numbers of the strip's lower corners below them.
    pub corners: [u32; 2],
}

/// A place of the lattice as seen across a face.
pub(crate) fn within_face(p: [i32; 3], face: usize) -> [i32; 2] {
    let axis = face % 3;
    [p[(axis + 1) % 3], p[(axis + 2) % 3]]
}

/// Triangles of strips that are needed where all of these faces are open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SkirtGroup {
    /// Which: one for strips, two where they are joined.
    pub faces: Faces,
    /// How many.
    pub triangles: u32,
}

/// For each face a sum over the border edges on it, by their ends' places on the lattice: two cells whose sums are equal
/// end in the same edges, but for one chance in 2⁶⁴.
pub type Borders = [u64; 6];

/// Which faces of what is drawn may have slits: all but those beyond which a node of the same depth is drawn that ends in
/// the same edges. `borders_of` knows those of each node and representation that is resident.
pub fn find_open_faces(
    draws: &mut [Draw],
    skeleton: &Skeleton,
    borders_of: &dyn Fn(u32, usize) -> Option<Borders>,
) {
    let cell_of = |draw: &Draw| skeleton.nodes()[draw.node as usize].cell;
    let drawn: HashMap<CellKey, usize> =
        draws.iter().enumerate().map(|(i, draw)| (cell_of(draw), i)).collect();
    let borders: Vec<Option<Borders>> =
        draws.iter().map(|draw| borders_of(draw.node, draw.representation)).collect();
    for i in 0..draws.len() {
        let cell = cell_of(&draws[i]);
        for axis in 0..3 {
            let mut index = cell.index();
            index[axis] += 1;
            if index[axis] >> cell.depth() != 0 {
                continue;
            }
            let beyond = drawn.get(&CellKey::at(cell.depth(), index));
            let Some((&beyond, here)) = beyond.zip(borders[i]) else { continue };
            if borders[beyond].is_some_and(|there| there[axis] == here[3 + axis]) {
                draws[i].open_faces &= !(1 << (3 + axis));
                draws[beyond].open_faces &= !(1 << axis);
            }
        }
    }
}

/// An edge that runs in a face of the cell.
struct Edge {
    /// Numbers of its vertices in the triangle's direction.
    vertices: [u32; 2],
    /// The face's bit: the lowest, where it runs in two.
    face: u32,
}

impl Edge {
    fn axis(&self) -> u32 {
        self.face % 3
    }
}

/// The edges between two positions in a face, one for each triangle that has it.
#[derive(Default)]
struct Here {
    first: Option<Edge>,
    /// Mostly none.
    others: Vec<Edge>,
    /// Whether any of these triangles lies in the face.
    goes_on: bool,
}

/// The strips along the borders of a cell's geometry; `budget` is e/R in lattice steps.
pub(crate) fn skirts(mesh: &Mesh, cell: CellKey, lattice: &Lattice, budget: f64) -> Skirts {
    let (min, units) = (lattice.cell_min(cell), lattice.cell_units(cell.depth()));
    let faces = |p: [i32; 3]| -> Faces {
        (0..3).fold(0, |bits, i| {
            let offset = p[i].abs_diff(min[i]);
            bits | (u8::from(offset == 0) << i) | (u8::from(offset == units) << (3 + i))
        })
    };
    let faces: Vec<Faces> = mesh.positions.iter().map(|p| faces(*p)).collect();
    // By positions: vertices that differ in their normals alone do not part a surface.
    let mut edges: HashMap<[[i32; 3]; 2], Here> = HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let [a, b, c] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
            let common = faces[a as usize] & faces[b as usize];
            if common == 0 {
                continue;
            }
            let [p, q] = [mesh.positions[a as usize], mesh.positions[b as usize]];
            let edge = Edge { vertices: [a, b], face: common.trailing_zeros() };
            let goes_on = common & faces[c as usize] != 0;
            let here = edges.entry([p.min(q), p.max(q)]).or_default();
            here.goes_on |= goes_on;
            match &here.first {
                None => here.first = Some(edge),
                Some(_) => here.others.push(edge),
            }
        }
    }
    // A surface that goes on within the face has no border there.
    let borders = edges.into_values().filter(|here| here.others.is_empty() || !here.goes_on);
    let mut edges: Vec<Edge> =
        borders.flat_map(|here| here.first.into_iter().chain(here.others)).collect();
    let mut out = Skirts::default();
    for edge in &edges {
        let ends = edge.vertices.map(|v| mesh.positions[v as usize]);
        let common = edge.vertices.map(|v| faces[v as usize]);
        for face in (0..6).filter(|face| common[0] & common[1] & 1 << face != 0) {
            out.borders[face] = out.borders[face].wrapping_add(edge_code(ends));
        }
    }
    if !edges.is_empty() {
        let is_small = small_components(mesh, budget);
        edges.retain(|edge| !is_small[edge.vertices[0] as usize]);
    }
    edges.sort_unstable_by_key(|edge| edge.vertices);
    let on_both = |edge: &Edge| faces[edge.vertices[0] as usize] & faces[edge.vertices[1] as usize];
    let moved = |v: u32, axis: u32| v | MOVED | axis << AXIS_SHIFT;
    let mut groups: BTreeMap<Faces, Vec<u32>> = BTreeMap::new();
    // The moved corners at each position: several where vertices there differ in their normals, or
    // where faces meet.
    let mut at: BTreeMap<[i32; 3], Vec<(u32, Faces)>> = BTreeMap::new();
    for edge in &edges {
        let ([a, b], axis, face) = (edge.vertices, edge.axis(), 1 << edge.face);
        // Their fronts face out of the cell.
        let strip = [a, moved(a, axis), b, b, moved(a, axis), moved(b, axis)];
        groups.entry(face).or_default().extend(strip);
        for v in [a, b] {
            at.entry(mesh.positions[v as usize]).or_default().push((moved(v, axis), face));
        }
    }
    let mut corners: Vec<u32> = Vec::new();
    for mut here in at.into_values() {
        here.sort_unstable();
        here.dedup();
        corners.extend(here.iter().map(|(corner, _)| corner));
        // Strips that part from one another are joined, from either side.
        for pair in here.windows(2) {
            let [(p, of_p), (q, of_q)] = [pair[0], pair[1]];
            let top = p & (VERTICES_MAX - 1);
            groups.entry(of_p | of_q).or_default().extend([top, p, q, top, q, p]);
        }
    }
    corners.sort_unstable();
    corners.dedup();
    let number = |corner: u32| corners.partition_point(|&other| other < corner) as u32;
    let first = mesh.positions.len() as u32;
    for (faces, indices) in groups {
        out.groups.push(SkirtGroup { faces, triangles: indices.len() as u32 / 3 });
        out.indices.extend(indices.iter().map(|&index| match index & MOVED {
            0 => index,
            _ => (first + number(index)) | (index & !(VERTICES_MAX - 1)),
        }));
    }
    for (face, lines) in out.lines.iter_mut().enumerate() {
        let here: Vec<&Edge> = edges.iter().filter(|e| on_both(e) & 1 << face != 0).collect();
        let place = |v: u32| within_face(mesh.positions[v as usize], face);
        let mut points: Vec<[i32; 2]> =
            here.iter().flat_map(|edge| edge.vertices.map(place)).collect();
        points.sort_unstable();
        points.dedup();
        let point = |v: u32| points.partition_point(|p| *p < place(v)) as u32;
        let edge = |edge: &&Edge| LineEdge {
            points: edge.vertices.map(point),
            corners: edge.vertices.map(|v| number(moved(v, edge.axis()))),
        };
        let edges = here.iter().map(edge).collect();
        *lines = FaceLines::new(points, edges);
    }
    out.corners = corners.iter().map(|corner| corner & (VERTICES_MAX - 1)).collect();
    out
}

/// A number for an edge, whichever end comes first; spread over all of 64 bits, so that sums of different edges differ.
fn edge_code([p, q]: [[i32; 3]; 2]) -> u64 {
    let ends = [p.min(q), p.max(q)];
    // As SplitMix64 spreads numbers (Steele, Lea & Flood, Fast splittable pseudorandom number generators, 2014).
    ends.as_flattened().iter().fold(0x9e37_79b9_7f4a_7c15, |code: u64, &c| {
        let mut z = (code ^ u64::from(c as u32)).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    })
}

/// Whether each vertex is of a component whose bounds have a diagonal of at most `budget`.
fn small_components(mesh: &Mesh, budget: f64) -> Vec<bool> {
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    let count = mesh.positions.len();
    let mut first_at: HashMap<[i32; 3], u32> = HashMap::with_capacity(count);
    let mut parent: Vec<u32> =
        mesh.positions.iter().zip(0..).map(|(p, v)| *first_at.entry(*p).or_insert(v)).collect();
    for t in &mesh.triangles {
        for k in 1..3 {
            let (a, b) = (root(&mut parent, t[0]), root(&mut parent, t[k]));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut bounds = vec![([i32::MAX; 3], [i32::MIN; 3]); count];
    for (v, p) in (0u32..).zip(&mesh.positions) {
        let (lo, hi) = &mut bounds[root(&mut parent, v) as usize];
        *lo = std::array::from_fn(|i| lo[i].min(p[i]));
        *hi = std::array::from_fn(|i| hi[i].max(p[i]));
    }
    let is_small = |v: u32| {
        let (lo, hi) = bounds[root(&mut parent, v) as usize];
        let squares = (0..3).map(|i| (f64::from(hi[i]) - f64::from(lo[i])).powi(2));
        squares.sum::<f64>() <= budget * budget
    };
    (0..count as u32).map(is_small).collect()
}

#[cfg(test)]
mod tests {
    use hlod_compress::OctNormal;

    use super::*;

    #[test]
    fn borders_on_faces_get_strips_and_nothing_else_does() {
        let lattice = Lattice::enclosing([0.0; 3], [64.0; 3], 1.0);
        let cell = CellKey::ROOT.child(0);
        let units = lattice.cell_units(1) as i32;
        // A square in the plane z = 5 across the cell, but open towards a border of its own at
        // y = 9: edges on the faces x = 0, x = units and y = 0, which meet in two corners.
        let positions = vec![[0, 0, 5], [units, 0, 5], [units, 9, 5], [0, 9, 5]];
        let normals = vec![OctNormal::encode([0.0, 0.0, 1.0]); 4];
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let mesh = Mesh { positions, normals, triangles, ..Mesh::default() };
        let none = skirts(&mesh, cell, &lattice, 2.0 * f64::from(units));
        assert!(none.indices.is_empty() && none.groups.is_empty(), "too small");
        let Skirts { indices, groups, borders, corners, lines } =
            skirts(&mesh, cell, &lattice, 1.0);
        assert_eq!(none.borders, borders, "whether there are strips does not matter");
        let expected = [(1, 2), (2, 2), (1 | 2, 2), (8, 2), (2 | 8, 2)];
        assert_eq!(groups.iter().map(|g| (g.faces, g.triangles)).collect::<Vec<_>>(), expected);
        assert_eq!(borders.map(|sum| sum != 0), [true, true, false, true, false, false]);
        // Copies come after the vertices, those of the faces across x first.
        assert_eq!(corners, [0, 1, 2, 3, 0, 1]);
        let moved = |v: u32, axis: u32| (4 + v + 4 * axis) | MOVED | axis << AXIS_SHIFT;
        let of =
            |a: u32, b: u32, axis: u32| [a, moved(a, axis), b, b, moved(a, axis), moved(b, axis)];
        let corner = |v: u32| {
            let [p, q] = [moved(v, 0), moved(v, 1)];
            [v, p, q, v, q, p]
        };
        let expected = [of(3, 0, 0), of(0, 1, 1), corner(0), of(1, 2, 0), corner(1)].concat();
        assert_eq!(indices, expected);
        // Across x places are y and z, across y they are z and x.
        let line =
            |points: [[i32; 2]; 2], edge: LineEdge| FaceLines::new(points.to_vec(), vec![edge]);
        let edge = |points, corners| LineEdge { points, corners };
        assert_eq!(lines[0], line([[0, 5], [9, 5]], edge([1, 0], [3, 0])));
        assert_eq!(lines[1], line([[5, 0], [5, units]], edge([0, 1], [4, 5])));
        assert_eq!(lines[3], line([[0, 5], [9, 5]], edge([0, 1], [1, 2])));
        assert!([2, 4, 5].iter().all(|&face| lines[face] == FaceLines::default()));
    }

    #[test]
    fn sheets_on_each_other_carry_a_strip_each() {
        let lattice = Lattice::enclosing([0.0; 3], [64.0; 3], 1.0);
        let cell = CellKey::ROOT.child(0);
        // A fold whose two sheets meet in an edge of the face z = 0.
        let corners = [[2, 3, 0], [9, 3, 0], [5, 3, 6], [5, 8, 6]];
        let strips_of = |triangles: &[[u32; 3]], positions: &[[i32; 3]]| {
            let normals = vec![OctNormal::encode([0.0, 1.0, 0.0]); positions.len()];
            let (positions, triangles) = (positions.to_vec(), triangles.to_vec());
            let mesh = Mesh { positions, normals, triangles, ..Mesh::default() };
            skirts(&mesh, cell, &lattice, 0.0).indices.len() / 6
        };
        assert_eq!(strips_of(&[[0, 1, 2]], &corners), 1);
        assert_eq!(strips_of(&[[0, 1, 2], [1, 0, 3]], &corners), 2);
        // The surface goes on within the face, and ends in it twice.
        let corners = [[2, 3, 0], [9, 3, 0], [5, 3, 6], [5, 8, 0]];
        assert_eq!(strips_of(&[[0, 1, 2], [1, 0, 3]], &corners), 2);
    }

    /// What two cells end in is told from both sides, and only the same edges are the same.
    #[test]
    fn cells_beside_each_other_have_the_same_sums() {
        let lattice = Lattice::enclosing([0.0; 3], [64.0; 3], 1.0);
        let cells = [CellKey::ROOT.child(0), CellKey::ROOT.child(1)];
        let x = lattice.cell_units(1) as i32;
        // Triangles on either side of the face across x, the other way round and in another order.
        let sums = |cell: CellKey, triangles: &[[[i32; 3]; 3]]| {
            let positions = triangles.as_flattened().to_vec();
            let normals = vec![OctNormal::encode([0.0, 0.0, 1.0]); positions.len()];
            let triangles =
                (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            let mesh = Mesh { positions, normals, triangles, ..Mesh::default() };
            skirts(&mesh, cell, &lattice, 0.0).borders
        };
        let (p, q, r) = ([x, 4, 5], [x, 9, 5], [x, 9, 12]);
        let (low, high) = ([x - 7, 6, 5], [x + 3, 6, 5]);
        let here = sums(cells[0], &[[q, p, low], [r, q, low]]);
        let there = sums(cells[1], &[[q, r, high], [p, q, high]]);
        assert_eq!(here[3], there[0]);
        assert_ne!(here[3], 0);
        assert_eq!((here[0], there[3]), (0, 0));
        // One edge instead of two, one edge twice, and one that ends elsewhere.
        for other in [vec![[p, r, high]], vec![[p, q, high], [p, q, high], [q, r, high]]] {
            assert_ne!(here[3], sums(cells[1], &other)[0]);
        }
        let moved = [x, 9, 6];
        assert_ne!(here[3], sums(cells[1], &[[p, moved, high], [moved, r, high]])[0]);
    }

    #[test]
    fn faces_are_open_but_towards_what_ends_alike() {
        use hlod_compress::{NormalCone, RepresentationKind};

        use crate::select::tests::tree_of;

        let skeleton = tree_of(2, NormalCone::ALL, RepresentationKind::Appearance);
        let node_at = |cell: CellKey| {
            skeleton.nodes().iter().position(|node| node.cell == cell).expect("it is there") as u32
        };
        let child = |octant| CellKey::ROOT.child(octant);
        // All octants but the last one, whose children are drawn.
        let mut cells: Vec<CellKey> = (0..7).map(child).collect();
        cells.extend((0..8).map(|octant| child(7).child(octant)));
        let draw = |cell: &CellKey| Draw {
            node: node_at(*cell),
            representation: 0,
            error_px: 0.0,
            area_px: 0.0,
            open_faces: ALL_FACES,
        };
        let open = |differs: Option<CellKey>, unknown: Option<CellKey>| -> Vec<Faces> {
            let borders = |node: u32, _| {
                let cell = skeleton.nodes()[node as usize].cell;
                let face = |face: usize| {
                    let mut index = cell.index().map(u64::from);
                    index[face % 3] += u64::from(face >= 3);
                    1 + (u64::from(cell.depth()) << 40)
                        + ((face as u64 % 3) << 32)
                        + (index[0] << 20)
                        + (index[1] << 10)
                        + index[2]
                };
                let mut borders: Borders = std::array::from_fn(face);
                if differs == Some(cell) {
                    borders[3] += 7;
                }
                (unknown != Some(cell)).then_some(borders)
            };
            let mut draws: Vec<Draw> = cells.iter().map(draw).collect();
            find_open_faces(&mut draws, &skeleton, &borders);
            draws.iter().map(|draw| draw.open_faces).collect()
        };
        // Octant 0 ends beside 1, 2 and 4; octant 6 beside 2 and 4, and beside smaller ones of 7.
        let all = open(None, None);
        assert_eq!((all[0], all[6]), (0b000_111, 0b111_001));
        // Among those of 7, the first ends beside three of them, and below beside larger cells.
        assert_eq!((all[7], all[14]), (0b000_111, 0b111_000));
        // What differs is open on both sides, and nothing else is.
        let other = open(Some(child(0)), None);
        assert_eq!((other[0], other[1]), (all[0] | 8, all[1] | 1));
        assert_eq!(other[2..], all[2..]);
        let unknown = open(None, Some(child(0)));
        assert_eq!(unknown[0], ALL_FACES);
        assert_eq!(unknown[1], all[1] | 1);
    }
}
