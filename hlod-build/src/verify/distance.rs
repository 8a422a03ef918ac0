//! Distances to triangles, by a uniform grid and a formula of their own.
//!
//! The builder uses a bounding-volume hierarchy and Ericson's regions; here nothing is shared with
//! it, so that a mistake there cannot hide itself here.

use std::collections::HashMap;
use std::sync::OnceLock;

use glam::DVec3;

/// Searches by shells of grid cells go no farther before they go on in a coarser grid.
const SHELLS_MAX: i32 = 8;

/// The same for shells in which nothing was found.
const EMPTY_SHELLS_MAX: i32 = 2;

/// A coarser grid's cells are so many times larger.
const COARSER: f64 = 4.0;

/// Triangles, and balls, to which distances can be asked for.
pub(crate) struct Target {
    /// Balls are triangles of one place, and come last.
    triangles: Vec<[DVec3; 3]>,
    /// Of the balls.
    radii: Vec<f64>,
    /// Their bounds.
    boxes: Vec<(DVec3, DVec3)>,
    low: DVec3,
    extent: f64,
    /// From cells of a triangle's size to a handful of cells, with the edge of a cell. Coarser ones
    /// are made when they are needed: on surfaces they hardly are.
    grids: Vec<(f64, OnceLock<Grid>)>,
}

/// Which triangles lie in which cubes.
struct Grid {
    /// Edge of a cell.
    size: f64,
    /// Cells along the longest extent: no search goes farther beyond the grid than to reach it.
    cells: i64,
    /// Where each occupied cell's triangles lie in `entries`.
    ranges: HashMap<[i32; 3], (u32, u32)>,
    entries: Vec<u32>,
}

impl Target {
    pub(crate) fn new(corners: impl Iterator<Item = [[f64; 3]; 3]>) -> Target {
        Target::with_balls(corners, std::iter::empty())
    }

    /// Triangles, and balls by their middles and radii, numbered after the triangles.
    pub(super) fn with_balls(
        corners: impl Iterator<Item = [[f64; 3]; 3]>,
        balls: impl Iterator<Item = ([f64; 3], f64)>,
    ) -> Target {
        let mut triangles: Vec<[DVec3; 3]> = corners.map(|t| t.map(DVec3::from_array)).collect();
        let bounds = |t: &[DVec3; 3]| (t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]));
        let mut boxes: Vec<(DVec3, DVec3)> = triangles.iter().map(bounds).collect();
        let mut radii = Vec::new();
        for (middle, radius) in balls {
            let middle = DVec3::from_array(middle);
            triangles.push([middle; 3]);
            boxes.push((middle - radius, middle + radius));
            radii.push(radius);
        }
        let (mut low, mut high, mut sum) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0);
        for &(lo, hi) in &boxes {
            low = low.min(lo);
            high = high.max(hi);
            sum += (hi - lo).max_element();
        }
        if triangles.is_empty() {
            (low, high) = (DVec3::ZERO, DVec3::ZERO);
        }
        let extent = (high - low).max_element();
        // About a triangle's size, and never so small that a cell's number overflows.
        let mean = sum / triangles.len().max(1) as f64;
        let mut size = mean.max(extent / 1e6).max(f64::MIN_POSITIVE);
        let mut grids = vec![(size, OnceLock::new())];
        // Scattered pieces are many cells apart.
        while extent > f64::from(SHELLS_MAX) * size {
            size *= COARSER;
            grids.push((size, OnceLock::new()));
        }
        Target { triangles, radii, boxes, low, extent, grids }
    }

    fn grid<'a>(&'a self, (size, grid): &'a (f64, OnceLock<Grid>)) -> &'a Grid {
        grid.get_or_init(|| Grid::new(&self.boxes, self.low, self.extent, *size))
    }

    /// Distance to the nearest triangle; infinite where there is none.
    pub(super) fn distance(&self, p: [f64; 3]) -> f64 {
        self.nearest(p).0
    }

    /// Distance to the nearest triangle, and which it is; infinite, and 0, where there is none.
    pub(crate) fn nearest(&self, p: [f64; 3]) -> (f64, usize) {
        if self.triangles.is_empty() {
            return (f64::INFINITY, 0);
        }
        let p = DVec3::from_array(p);
        let mut best = (f64::INFINITY, 0);
        for grid in &self.grids {
            let grid = self.grid(grid);
            let centre = cell(p, self.low, grid.size);
            // From far outside, shells begin where the grid does.
            let outside =
                centre.iter().map(|&c| (-i64::from(c)).max(i64::from(c) - grid.cells)).max();
            let first = outside.unwrap_or(0).max(0).min(i64::from(SHELLS_MAX)) as i32;
            for radius in first..SHELLS_MAX {
                self.shell(grid, p, centre, radius, &mut best);
                // What lies beyond this shell is at least so far away.
                let beyond = f64::from(radius) * grid.size;
                if best.0 <= beyond * beyond {
                    return (best.0.sqrt(), best.1);
                }
                // Shells grow with the square of their radius: through empty space in large steps.
                if best.0 == f64::INFINITY && radius - first >= EMPTY_SHELLS_MAX {
                    break;
                }
            }
        }
        // From far away.
        (0..self.triangles.len()).for_each(|t| self.try_triangle(p, t, &mut best));
        (best.0.sqrt(), best.1)
    }

    /// Calls `visit(triangle)` for the triangles within `radius` of a point, some of them several
    /// times, until it answers that it has seen enough.
    pub(super) fn within(&self, p: [f64; 3], radius: f64, mut visit: impl FnMut(usize) -> bool) {
        let p = DVec3::from_array(p);
        // The finest grid in which the search is a few cells wide.
        let is_coarse = |(size, _): &&(f64, OnceLock<Grid>)| radius <= 4.0 * size;
        let Some(grid) = self.grids.iter().find(is_coarse).or(self.grids.last()) else { return };
        let grid = self.grid(grid);
        let (a, b) = (cell(p - radius, self.low, grid.size), cell(p + radius, self.low, grid.size));
        let clamp = |c: i32| i64::from(c).clamp(-1, grid.cells) as i32;
        for x in clamp(a[0])..=clamp(b[0]) {
            for y in clamp(a[1])..=clamp(b[1]) {
                for z in clamp(a[2])..=clamp(b[2]) {
                    for &t in grid.at([x, y, z]) {
                        let near = self.distance2(p, t as usize) <= radius * radius;
                        if near && visit(t as usize) {
                            return;
                        }
                    }
                }
            }
        }
    }

    /// Improves `best` by the triangles of all cells at Chebyshev distance `radius`.
    fn shell(
        &self,
        grid: &Grid,
        p: DVec3,
        [cx, cy, cz]: [i32; 3],
        radius: i32,
        best: &mut (f64, usize),
    ) {
        for x in cx - radius..=cx + radius {
            for y in cy - radius..=cy + radius {
                let rim = (x - cx).abs() == radius || (y - cy).abs() == radius;
                let step = if rim { 1 } else { (2 * radius).max(1) };
                for z in (cz - radius..=cz + radius).step_by(step as usize) {
                    let low = self.low + DVec3::new(x.into(), y.into(), z.into()) * grid.size;
                    if box_distance2(p, low, low + grid.size) >= best.0 {
                        continue;
                    }
                    for &triangle in grid.at([x, y, z]) {
                        self.try_triangle(p, triangle as usize, best);
                    }
                }
            }
        }
    }

    fn distance2(&self, p: DVec3, triangle: usize) -> f64 {
        let first_ball = self.triangles.len() - self.radii.len();
        match triangle.checked_sub(first_ball) {
            None => distance2(p, &self.triangles[triangle]),
            Some(ball) => {
                let outside = p.distance(self.triangles[triangle][0]) - self.radii[ball];
                outside.max(0.0).powi(2)
            }
        }
    }

    fn try_triangle(&self, p: DVec3, triangle: usize, best: &mut (f64, usize)) {
        let (lo, hi) = self.boxes[triangle];
        if box_distance2(p, lo, hi) < best.0 {
            let distance2 = self.distance2(p, triangle);
            if distance2 < best.0 {
                *best = (distance2, triangle);
            }
        }
    }
}

impl Grid {
    fn new(boxes: &[(DVec3, DVec3)], origin: DVec3, extent: f64, size: f64) -> Grid {
        let mut pairs: Vec<([i32; 3], u32)> = Vec::new();
        for (i, &(lo, hi)) in boxes.iter().enumerate() {
            let (a, b) = (cell(lo, origin, size), cell(hi, origin, size));
            for x in a[0]..=b[0] {
                for y in a[1]..=b[1] {
                    pairs.extend((a[2]..=b[2]).map(|z| ([x, y, z], i as u32)));
                }
            }
        }
        pairs.sort_unstable();
        let mut ranges = HashMap::new();
        let mut start = 0;
        for group in pairs.chunk_by(|a, b| a.0 == b.0) {
            let end = start + group.len() as u32;
            ranges.insert(group[0].0, (start, end));
            start = end;
        }
        let entries = pairs.into_iter().map(|(_, triangle)| triangle).collect();
        Grid { size, cells: (extent / size) as i64 + 2, ranges, entries }
    }

    fn at(&self, cell: [i32; 3]) -> &[u32] {
        let range = self.ranges.get(&cell);
        range.map_or(&[], |&(start, end)| &self.entries[start as usize..end as usize])
    }
}

fn box_distance2(p: DVec3, low: DVec3, high: DVec3) -> f64 {
    (low - p).max(p - high).max(DVec3::ZERO).length_squared()
}

fn cell(p: DVec3, low: DVec3, size: f64) -> [i32; 3] {
    ((p - low) / size).to_array().map(|c| c.floor().clamp(-1e9, 1e9) as i32)
}

/// To the plane where the foot of the perpendicular lies inside all three edges, else to the
/// nearest edge.
fn distance2(p: DVec3, &[a, b, c]: &[DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let area2 = normal.length_squared();
    let inside = |from: DVec3, to: DVec3| normal.dot((to - from).cross(p - from)) >= 0.0;
    if area2 > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
        let height = normal.dot(p - a);
        return height * height / area2;
    }
    let to_segment = |a: DVec3, b: DVec3| {
        let along = b - a;
        let length2 = along.length_squared();
        let t = if length2 > 0.0 { ((p - a).dot(along) / length2).clamp(0.0, 1.0) } else { 0.0 };
        (p - (a + along * t)).length_squared()
    };
    to_segment(a, b).min(to_segment(b, c)).min(to_segment(c, a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn distances_to_a_known_triangle() {
        let target = Target::new(
            [[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]], [[50.0, 0.0, 0.0]; 3]]
                .into_iter(),
        );
        for (p, expected) in [
            ([1.0, 1.0, 3.0], 3.0),
            ([-3.0, 0.0, 4.0], 5.0),
            ([2.0, -2.0, 0.0], 2.0),
            ([4.0, 4.0, 0.0], 8.0f64.sqrt()),
            ([50.0, 1.0, 0.0], 1.0),
            ([50.0, 0.0, 9000.0], 9000.0),
        ] {
            assert!((target.distance(p) - expected).abs() < 1e-9, "{p:?}");
        }
        assert_eq!(Target::new(std::iter::empty()).distance([0.0; 3]), f64::INFINITY);
    }

    fn point(range: f64) -> impl Strategy<Value = [f64; 3]> {
        prop::array::uniform3(-range..range)
    }

    proptest! {
        #[test]
        fn the_grid_agrees_with_trying_every_triangle(
            p in point(30.0),
            soup in prop::collection::vec(prop::array::uniform3(point(10.0)), 1..40),
        ) {
            let found = Target::new(soup.iter().copied()).distance(p);
            let brute = soup
                .iter()
                .map(|t| distance2(DVec3::from_array(p), &t.map(DVec3::from_array)).sqrt())
                .fold(f64::INFINITY, f64::min);
            prop_assert_eq!(found, brute);
        }
    }
}
