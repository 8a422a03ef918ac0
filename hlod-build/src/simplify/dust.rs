//! Components of the surface that are smaller than what the node may be wrong by.
//!
//! Collapsing edges cannot make a tetrahedron less than a tetrahedron. A component that lies within
//! the budget of others vanishes; of the rest, few are chosen so that each lies within the budget
//! of a chosen one, and a chosen one becomes a single triangle at its middle. This replaces the
//! paper's generalized pair contractions (section 3.1, after Borodin et al. 2002), which merge two
//! components at a time and meet the same end: many of them as one primitive.
//!
//! What is chosen here is a proposal. The certificate judges its triangles like all others, and
//! what it refuses comes back: first as a triangle of its own, then whole.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use glam::{DVec3, Vec3};
use hlod_compress::{Mesh, OctNormal, Scalars};

use super::prepare::Prepared;
use super::{Budget, Source};
use crate::certificate::{NONE, Surface};
use crate::colour::average_srgba;
use crate::kept::mean_scalars;
use crate::union::Union;

/// Components larger than this, in budgets, are left to collapses.
const LARGEST: f64 = 1.25;

/// What lies within this share of its budget from larger surface vanishes.
const BESIDE: f64 = 0.5;

/// Of a crowd of components at one place no more than this are compared with each.
const COMPARED_MAX: usize = 512;

/// Where there are more triangles of larger surface than this for each single triangle, singles get
/// a back, so that the surface stays closed.
const SURFACE_PER_SINGLE: usize = 10;

/// The small components of a node's source and what becomes of them.
#[derive(Debug, Clone, Default)]
pub(super) struct Dust {
    components: Vec<Component>,
    /// The component of each triangle of the source, or [`NONE`]; empty where there is no dust.
    of_triangle: Vec<u32>,
    /// Whether single triangles get a back.
    has_backs: bool,
}

#[derive(Debug, Clone)]
struct Component {
    /// Of the source.
    triangles: Vec<u32>,
    /// The middle of its bounds, relative to the cell's centre.
    middle: DVec3,
    becomes: Becomes,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Becomes {
    Nothing,
    OneTriangle,
    Itself,
}

impl Dust {
    /// Finds small components and chooses what becomes of them.
    pub(super) fn of(prepared: &Prepared, source: &Source, budget: &Budget) -> Dust {
        let mut dust = Dust::find(prepared, budget);
        if dust.components.is_empty() {
            return Dust::default();
        }
        let room = |t: u32| {
            let carried = source.carried.get(t as usize).map_or(0.0, |c| c.forward.distance);
            budget.left(carried)
        };
        // Rounding moves the one triangle's corners by as much.
        let grid = f64::from(1u32 << budget.grid_shift);
        let farthest = |from: DVec3, component: &Component| {
            let over = |&t: &u32| {
                let corners = prepared.surface.corners(t);
                corners.iter().map(|p| p.distance(from)).fold(0.0, f64::max) - room(t)
            };
            component.triangles.iter().map(over).fold(f64::NEG_INFINITY, f64::max) + grid
        };
        dust.components.retain(|c| farthest(c.middle, c) <= 0.0);
        dust.number(prepared.surface.triangles.len());
        dust.beside_surface(&prepared.surface, &room);
        dust.choose(budget.whole, &farthest);
        let singles = dust.components.iter().filter(|c| c.becomes == Becomes::OneTriangle).count();
        let larger = dust.of_triangle.iter().filter(|&&c| c == NONE).count();
        dust.has_backs = budget.is_closed && larger > SURFACE_PER_SINGLE * singles;
        dust
    }

    /// Whether what was closed no longer is.
    pub(super) fn opens(&self) -> bool {
        !self.has_backs && self.components.iter().any(|c| c.becomes == Becomes::OneTriangle)
    }

    pub(super) fn is_dust(&self, triangle: u32) -> bool {
        self.of_triangle.get(triangle as usize).is_some_and(|&c| c != NONE)
    }

    /// The triangles that are no dust.
    pub(super) fn larger(&self, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
        let all = (0..).zip(triangles);
        all.filter(|(t, _)| !self.is_dust(*t)).map(|(_, triangle)| *triangle).collect()
    }

    /// Gives back a little more of what the certificate has lost.
    pub(super) fn take_back(&mut self, lost: &[u32]) {
        let mut components: Vec<u32> = lost
            .iter()
            .filter(|&&t| self.is_dust(t))
            .map(|&t| self.of_triangle[t as usize])
            .collect();
        components.sort_unstable();
        components.dedup();
        for c in components {
            let becomes = &mut self.components[c as usize].becomes;
            *becomes = match becomes {
                Becomes::Nothing => Becomes::OneTriangle,
                Becomes::OneTriangle | Becomes::Itself => Becomes::Itself,
            };
        }
    }

    /// Adds what is left of the dust, on the node's grid.
    pub(super) fn add_to(&self, mesh: &mut Mesh, prepared: &Prepared, budget: &Budget) {
        for component in &self.components {
            match component.becomes {
                Becomes::Nothing => {}
                Becomes::OneTriangle => {
                    let speck = component.as_one(prepared);
                    speck.add_to(mesh, budget, self.has_backs);
                }
                Becomes::Itself => {
                    for &t in &component.triangles {
                        Speck::of_triangle(prepared, t).add_to(mesh, budget, false);
                    }
                }
            }
        }
    }

    /// All components that are small and touch no face of the cell: what is cut there goes on
    /// in the next cell.
    fn find(prepared: &Prepared, budget: &Budget) -> Dust {
        let surface = &prepared.surface;
        let count = surface.positions.len();
        let mut union = Union::new(count);
        let mut first_at: HashMap<[i32; 3], u32> = HashMap::with_capacity(count);
        for (v, p) in (0u32..).zip(&prepared.positions) {
            let first = *first_at.entry(*p).or_insert(v);
            union.join(first, v);
        }
        for t in &surface.triangles {
            union.join(t[0], t[1]);
            union.join(t[1], t[2]);
        }
        let mut bounds = vec![(DVec3::INFINITY, DVec3::NEG_INFINITY); count];
        for t in &surface.triangles {
            let root = union.root(t[0]) as usize;
            for &v in t {
                let p = surface.positions[v as usize];
                bounds[root] = (bounds[root].0.min(p), bounds[root].1.max(p));
            }
        }
        let half = f64::from(budget.cell_units) * 0.5;
        let is_small = |(low, high): (DVec3, DVec3)| {
            let inside = low.min_element() > -half && high.max_element() < half;
            inside && low.distance(high) <= LARGEST * budget.whole
        };
        let mut component_of: HashMap<u32, usize> = HashMap::new();
        let mut components: Vec<Component> = Vec::new();
        for (t, triangle) in (0u32..).zip(&surface.triangles) {
            let root = union.root(triangle[0]);
            let (low, high) = bounds[root as usize];
            if !is_small((low, high)) {
                continue;
            }
            let next = components.len();
            let c = *component_of.entry(root).or_insert(next);
            if c == next {
                let middle = (low + high) * 0.5;
                components.push(Component {
                    triangles: Vec::new(),
                    middle,
                    becomes: Becomes::OneTriangle,
                });
            }
            components[c].triangles.push(t);
        }
        Dust { components, ..Dust::default() }
    }

    fn number(&mut self, triangles: usize) {
        self.of_triangle = vec![NONE; triangles];
        for (c, component) in (0u32..).zip(&self.components) {
            component.triangles.iter().for_each(|&t| self.of_triangle[t as usize] = c);
        }
    }

    /// What lies close to larger surface vanishes there.
    fn beside_surface(&mut self, surface: &Surface, room: &impl Fn(u32) -> f64) {
        let larger = self.larger(&surface.triangles);
        if larger.is_empty() || self.components.is_empty() {
            return;
        }
        let larger = Surface::new(surface.positions.clone(), surface.looks.clone(), larger);
        for component in &mut self.components {
            let is_beside = component.triangles.iter().all(|&t| {
                let mut corners = surface.corners(t).into_iter();
                corners.all(|p| larger.closest(p, NONE).distance <= BESIDE * room(t))
            });
            if is_beside {
                component.becomes = Becomes::Nothing;
            }
        }
    }

    /// Chooses components until every one lies within its budget of a chosen one: always the one
    /// that covers most of what is left.
    fn choose(&mut self, reach: f64, farthest: &impl Fn(DVec3, &Component) -> f64) {
        let components = &self.components;
        let waiting: Vec<u32> = (0u32..)
            .zip(components)
            .filter(|(_, c)| c.becomes == Becomes::OneTriangle)
            .map(|(c, _)| c)
            .collect();
        let cell = |p: DVec3| (p / reach).floor().to_array().map(|c| c as i64);
        let mut grid: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for &c in &waiting {
            grid.entry(cell(components[c as usize].middle)).or_default().push(c);
        }
        let covered_by = |c: u32| -> Vec<u32> {
            let middle = components[c as usize].middle;
            let [x, y, z] = cell(middle);
            let near = (0..27).map(|i| [x + i / 9 - 1, y + i / 3 % 3 - 1, z + i % 3 - 1]);
            let others = near.filter_map(|at| grid.get(&at)).flatten().copied();
            let others = others.take(COMPARED_MAX);
            let mut covered: Vec<u32> = others
                .filter(|&other| farthest(middle, &components[other as usize]) <= 0.0)
                .collect();
            // Beyond the crowd that was compared it still covers itself.
            if !covered.contains(&c) {
                covered.push(c);
            }
            covered
        };
        let covers: HashMap<u32, Vec<u32>> = waiting.iter().map(|&c| (c, covered_by(c))).collect();
        let mut is_covered = vec![false; components.len()];
        let mut heap: BinaryHeap<(usize, Reverse<u32>)> =
            waiting.iter().map(|&c| (covers[&c].len(), Reverse(c))).collect();
        let mut chosen = vec![false; components.len()];
        while let Some((expected, Reverse(c))) = heap.pop() {
            // Gains only shrink: one that is still what it was is the largest.
            let gain = covers[&c].iter().filter(|&&other| !is_covered[other as usize]).count();
            if gain == 0 {
                continue;
            }
            if gain < expected {
                heap.push((gain, Reverse(c)));
                continue;
            }
            chosen[c as usize] = true;
            covers[&c].iter().for_each(|&other| is_covered[other as usize] = true);
        }
        for c in waiting {
            if !chosen[c as usize] {
                self.components[c as usize].becomes = Becomes::Nothing;
            }
        }
    }
}

impl Component {
    /// Its largest triangle, moved to its middle, with its mean look.
    fn as_one(&self, prepared: &Prepared) -> Speck {
        let surface = &prepared.surface;
        let cross = |t: u32| {
            let [a, b, c] = surface.corners(t);
            (b - a).cross(c - a)
        };
        let size = |t: u32| cross(t).length_squared();
        let largest =
            self.triangles.iter().copied().reduce(|a, b| if size(b) > size(a) { b } else { a });
        let largest = largest.unwrap_or_default();
        let corners = surface.corners(largest);
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let mut mean = DVec3::ZERO;
        for &t in &self.triangles {
            let normals = surface.corner_looks(t).map(|look| look.normal.as_dvec3());
            mean += (normals[0] + normals[1] + normals[2]) * cross(t).length();
        }
        // A closed component's normals cancel out: the triangle's own then is as good as any.
        let whole: f64 = self.triangles.iter().map(|&t| cross(t).length()).sum();
        let own = cross(largest).normalize_or(DVec3::Z);
        let normal = if mean.length() > whole { mean.normalize() } else { own };
        let vertices = self.triangles.iter().flat_map(|&t| surface.triangles[t as usize]);
        let colours = vertices.filter_map(|v| prepared.colours.get(v as usize));
        let colour =
            (!prepared.colours.is_empty()).then(|| [average_srgba(colours.map(|&c| (c, 1.0))); 3]);
        let vertices = self.triangles.iter().flat_map(|&t| surface.triangles[t as usize]);
        let members = vertices.filter_map(|v| prepared.scalars.get(v as usize));
        let scalars = (!prepared.scalars.is_empty())
            .then(|| [mean_scalars(members.map(|scalar| (scalar.codes, scalar.weight))); 3]);
        let move_by = if self.triangles.len() > 1 { self.middle - centre } else { DVec3::ZERO };
        Speck {
            corners: corners.map(|p| p + move_by),
            normals: [normal.as_vec3(); 3],
            colours: colour,
            scalars,
        }
    }
}

/// A triangle that is added to a mesh by itself.
pub(super) struct Speck {
    /// Relative to the cell's centre.
    corners: [DVec3; 3],
    normals: [Vec3; 3],
    colours: Option<[[u8; 4]; 3]>,
    scalars: Option<[Scalars; 3]>,
}

impl Speck {
    pub(super) fn of_triangle(prepared: &Prepared, triangle: u32) -> Speck {
        let vertices = prepared.surface.triangles[triangle as usize];
        let colours = vertices.map(|v| prepared.colours.get(v as usize).copied());
        let scalars = vertices.map(|v| prepared.scalars.get(v as usize).map(|s| s.codes));
        Speck {
            corners: prepared.surface.corners(triangle),
            normals: prepared.surface.corner_looks(triangle).map(|look| look.normal),
            colours: match colours {
                [Some(a), Some(b), Some(c)] => Some([a, b, c]),
                _ => None,
            },
            scalars: match scalars {
                [Some(a), Some(b), Some(c)] => Some([a, b, c]),
                _ => None,
            },
        }
    }

    /// Adds it with its corners rounded to the grid, one step apart where they would fall together.
    pub(super) fn add_to(&self, mesh: &mut Mesh, budget: &Budget, has_back: bool) {
        let step = 1i32 << budget.grid_shift;
        let units = budget.cell_units as i32;
        let half = f64::from(budget.cell_units) * 0.5;
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(c - a);
        let mut corners = self.corners.map(|p| {
            std::array::from_fn::<i32, 3, _>(|i| {
                let offset = (p[i] + half).round().clamp(0.0, f64::from(units)) as i32;
                let inside = offset > 0 && offset < units;
                let rounded = (offset + step / 2) / step * step;
                budget.cell_min[i] + if inside { rounded.min(units) } else { offset }
            })
        });
        // The corner itself and the next places on the grid, inside the cell.
        let around = |p: [i32; 3]| {
            (0..27).map(move |n| [n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1]).map(move |d: [i32; 3]| {
                std::array::from_fn::<i32, 3, _>(|i| {
                    let (low, high) = (budget.cell_min[i], budget.cell_min[i] + units);
                    (p[i] + d[i] * step).clamp(low, high)
                })
            })
        };
        let area = |corners: &[[i32; 3]; 3]| {
            let [a, b, c] = corners.map(|p| DVec3::from_array(p.map(f64::from)));
            (b - a).cross(c - a)
        };
        if area(&corners) == DVec3::ZERO {
            let place = |p: [i32; 3]| {
                DVec3::from_array(std::array::from_fn(|i| f64::from(p[i] - budget.cell_min[i])))
                    - DVec3::splat(half)
            };
            let moved = |p: [i32; 3], from: DVec3| place(p).distance_squared(from);
            // Of the ways to have an area and to face as it does, the one that moves least.
            let choices = around(corners[1])
                .flat_map(|p| around(corners[2]).map(move |q| [p, q]))
                .map(|[p, q]| ([p, q], area(&[corners[0], p, q])))
                .filter(|(_, cross)| *cross != DVec3::ZERO)
                .map(|(pq, cross)| {
                    let faces = cross.normalize().dot(normal) >= 0.5 * normal.length();
                    (pq, (!faces, moved(pq[0], b) + moved(pq[1], c)))
                });
            let least = choices.min_by(|(_, x), (_, y)| x.0.cmp(&y.0).then(x.1.total_cmp(&y.1)));
            if let Some(([p, q], _)) = least {
                corners = [corners[0], p, q];
            }
        }
        let mut add = |normals: [Vec3; 3], order: [usize; 3]| {
            let first = mesh.positions.len() as u32;
            for k in order {
                mesh.positions.push(corners[k]);
                mesh.normals.push(OctNormal::encode(normals[k].to_array()));
                mesh.colours.extend(self.colours.map(|colours| colours[k]));
                mesh.scalars.extend(self.scalars.map(|scalars| scalars[k]));
            }
            mesh.triangles.push([first, first + 1, first + 2]);
        };
        add(self.normals, [0, 1, 2]);
        if has_back {
            add(self.normals.map(|n| -n), [0, 2, 1]);
        }
    }
}
