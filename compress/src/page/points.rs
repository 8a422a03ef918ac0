//! Points: positions as halved boxes, attributes predicted from points coded shortly before.
//!
//! A box with its number of points is halved along its longest side, and the number of points in the
//! lower half is coded (Gandoin & Devillers 2002), until a box holds one point, whose place in it
//! follows in plain bits, or is a single place. The context is along which axes all points went to one
//! side last: a surface is thin. Each part of a progressive order, from one prefix to the next, has
//! boxes of its own. The order in which points come out is that of their positions.
//!
//! ```text
//! tag u8 · flags u8 · grid shift u8 · prefixes u8 · points u32 · lowest corner 3×i32 · extent 3×u32 ·
//! count u32 for each prefix · shift u8 for each scalar · bytes of symbols u32 · symbols · plain bits
//! ```

use super::normals::{code_normal, on_octahedron};
use super::scalars::{self, Expect};
use super::values::Signed;
use super::{EXTENT_MAX, TAG_POINTS, flags, of_flags, read_shifts, too_large};
use crate::bytes::{ByteReader, ByteWriter};
use crate::entropy::{Coder, Decoder, Encoder, Model, SYMBOLS_A_BYTE};
use crate::{FormatError, PointPrefix, PointRadius, Points, mean_code};

/// Nothing larger is written or decoded.
const POINTS_MAX: u32 = 1 << 19;
/// Numbers of points up to here have distributions of their own.
const FEW: u32 = 15;
/// From so many points before a point's attributes are predicted.
const NEIGHBOURS: usize = 8;

/// Encodes points whose positions are all multiples of `2^grid_shift` from their lowest corner. Within
/// the parts of the progressive order they come back in another order.
///
/// # Errors
/// When there are more points than a page may hold.
///
/// # Panics
/// When the points are inconsistent or off the grid: both are the caller's mistakes.
pub(crate) fn encode_points(points: &Points, grid_shift: u8) -> Result<Vec<u8>, FormatError> {
    if let Err(why) = points.validate() {
        panic!("cannot encode inconsistent points: {why}");
    }
    let (lowest, highest) = points.bounds().unwrap_or_default();
    let (positions, extent) = super::on_grid(&points.positions, lowest, highest, grid_shift);
    let largest = extent.into_iter().max().unwrap_or(0);
    too_large("points", points.len(), POINTS_MAX)?;
    too_large("steps along an axis", largest as usize, EXTENT_MAX)?;

    let mut coder = Encoder::default();
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    let declared = Declared {
        ends: ends(points.len(), &points.prefixes),
        extent,
        has_colours: points.has_colours(),
    };
    let truth = Truth { points, positions: &positions, order: &mut order };
    let coded = code(&mut coder, &declared, Some(truth))?;
    let mut shifts = Vec::new();
    for k in 0..scalars::columns(&points.scalars) {
        let truth = scalars::column(&points.scalars, &order, k);
        let shift = scalars::best_shift(&truth, &coded);
        shifts.push(shift);
        scalars::code_scalar(&mut coder, &coded, (truth.len(), shift), Some(&truth));
    }
    let (symbols, bits) = coder.finish();

    let mut w = ByteWriter::default();
    w.u8(TAG_POINTS);
    w.u8(flags(points.has_colours(), shifts.len()));
    w.u8(grid_shift);
    w.u8(points.prefixes.len() as u8);
    w.u32(points.len() as u32);
    w.vec3_i32(lowest);
    extent.iter().for_each(|&c| w.u32(c));
    for prefix in &points.prefixes {
        w.u32(prefix.radii.len() as u32);
    }
    w.put(&shifts);
    w.u32(symbols.len() as u32);
    w.put(&symbols);
    w.put(&bits);
    Ok(w.bytes)
}

/// The number of points that a page of points declares.
pub(super) fn encoded_point_count(page: &[u8]) -> Result<u32, FormatError> {
    let mut r = ByteReader::new("page", page);
    r.take(4)?;
    r.u32()
}

/// Decodes what [`encode_points`] wrote.
///
/// # Errors
/// On anything else: no panic, and no allocation that the page's length does not explain.
pub(crate) fn decode_points(page: &[u8]) -> Result<Points, FormatError> {
    let bad = |why: String| FormatError::malformed("page", why);
    let mut r = ByteReader::new("page", page);
    let tag = r.u8()?;
    let [flags, grid_shift, prefix_count] = [r.u8()?, r.u8()?, r.u8()?];
    let count = r.u32()?;
    let lowest = r.vec3_i32()?;
    let extent = [r.u32()?, r.u32()?, r.u32()?];
    let (has_colours, scalar_count) = of_flags(flags).ok_or_else(|| bad("unknown flags".into()))?;
    if tag != TAG_POINTS
        || grid_shift > 30
        || usize::from(prefix_count) > Points::PREFIXES_MAX
        || count > POINTS_MAX
        || extent.iter().any(|&c| c > EXTENT_MAX)
    {
        return Err(bad(format!("{count} points, grid 2^{grid_shift}, extent {extent:?}")));
    }
    let mut ends = Vec::with_capacity(usize::from(prefix_count) + 1);
    for _ in 0..prefix_count {
        ends.push(r.u32()? as usize);
    }
    ends.push(count as usize);
    if ends[0] == 0 && prefix_count > 0 || ends.windows(2).any(|pair| pair[1] <= pair[0]) {
        return Err(bad("its prefixes do not grow".into()));
    }
    let shifts = read_shifts(&mut r, scalar_count)?;
    let symbols = r.u32()? as usize;
    let symbols = r.take(symbols)?;
    let bits = r.take(r.remaining())?;
    // Each point costs a symbol.
    if u64::from(count) > symbols.len() as u64 * SYMBOLS_A_BYTE {
        return Err(bad(format!("{count} points in {} bytes of symbols", symbols.len())));
    }

    let declared = Declared { ends, extent, has_colours };
    let mut coder = Decoder::new(symbols, bits)?;
    let mut points = code(&mut coder, &declared, None)?;
    for (k, shift) in shifts.into_iter().enumerate() {
        coder.check_left()?;
        let codes = scalars::code_scalar(&mut coder, &points, (points.len(), shift), None);
        scalars::add_column(&mut points.scalars, k, &codes);
    }
    coder.finish()?;
    for position in &mut points.positions {
        for axis in 0..3 {
            let value = (i64::from(position[axis]) << grid_shift) + i64::from(lowest[axis]);
            position[axis] =
                i32::try_from(value).map_err(|_| bad("a position lies off the lattice".into()))?;
        }
    }
    points.validate().map_err(bad)?;
    Ok(points)
}

/// Points on the page's grid: the mean over the last few, the nearer the more.
impl Expect for Points {
    fn expect(&self, before: &[u16], at: usize) -> u16 {
        let here = self.positions[at];
        let last = at.saturating_sub(NEIGHBOURS)..at;
        mean_code(last.map(|k| {
            let there = self.positions[k];
            let along = |i: usize| f64::from(here[i]) - f64::from(there[i]);
            let squared = along(0) * along(0) + along(1) * along(1) + along(2) * along(2);
            (before[k], 1.0 / (squared + 1.0))
        }))
    }
}

/// Where the parts of the progressive order end.
fn ends(count: usize, prefixes: &[PointPrefix]) -> Vec<usize> {
    prefixes.iter().map(|prefix| prefix.radii.len()).chain([count]).collect()
}

struct Declared {
    ends: Vec<usize>,
    extent: [u32; 3],
    has_colours: bool,
}

/// What an encoder knows; `positions` on the page's grid.
struct Truth<'a> {
    points: &'a Points,
    positions: &'a [[i32; 3]],
    order: &'a mut [u32],
}

/// A box still to be divided.
#[derive(Clone, Copy)]
struct Cell {
    low: [u32; 3],
    /// Edges are 2 to these powers.
    bits: [u8; 3],
    first: u32,
    count: u32,
    /// Bit i: along axis i all points went to one side last.
    thin: u8,
}

/// Codes everything; positions come out on the page's grid, in order.
fn code<C: Coder>(
    coder: &mut C,
    declared: &Declared,
    mut truth: Option<Truth<'_>>,
) -> Result<Points, FormatError> {
    let mut out = Points::default();
    let mut halves = Halves::default();
    let mut attributes = Attributes::new();
    let bits = declared.extent.map(|c| (u32::BITS - c.leading_zeros()) as u8);
    let mut first = 0;
    for &end in &declared.ends {
        let count = (end - first) as u32;
        let all = Cell { low: [0; 3], bits, first: first as u32, count, thin: 0 };
        let mut stack = vec![all];
        while let Some(cell) = stack.pop().filter(|cell| cell.count > 0) {
            coder.check_left()?;
            let axis = longest(cell.bits);
            if cell.count > 1 && cell.bits[axis] > 0 {
                let [low, high] = halves.code(coder, cell, axis, &mut truth)?;
                stack.extend([high, low].into_iter().filter(|half| half.count > 0));
            } else {
                place(coder, cell, &truth, &mut out.positions);
            }
        }
        for at in first..end {
            coder.check_left()?;
            attributes.code(coder, &mut out, first, at, declared.has_colours, &truth);
        }
        first = end;
    }
    // Of the beginnings, how much larger than their own their points' radii are.
    for (prefix, &end) in declared.ends.iter().rev().skip(1).rev().enumerate() {
        coder.check_left()?;
        let mut growth = Signed::<1>::new(0);
        let mut radii = Vec::with_capacity(end);
        for at in 0..end {
            let own = i32::from(out.radii[at].0);
            let known = truth.as_ref().map_or(0, |t| {
                i32::from(t.points.prefixes[prefix].radii[t.order[at] as usize].0) - own
            });
            radii.push(PointRadius(own.wrapping_add(growth.code(coder, 0, known)) as u8));
        }
        out.prefixes.push(PointPrefix { radii });
    }
    Ok(out)
}

fn longest(bits: [u8; 3]) -> usize {
    (0..3).rev().max_by_key(|&axis| bits[axis]).unwrap_or(0)
}

/// The positions of a cell that is one place, or holds one point.
fn place<C: Coder>(coder: &mut C, cell: Cell, truth: &Option<Truth<'_>>, out: &mut Vec<[i32; 3]>) {
    let mut position = [0; 3];
    for (axis, at) in position.iter_mut().enumerate() {
        let known = truth.as_ref().map_or(0, |t| {
            t.positions[t.order[cell.first as usize] as usize][axis] as u32 - cell.low[axis]
        });
        *at = (cell.low[axis] + coder.bits(cell.bits[axis].into(), known)) as i32;
    }
    out.extend(std::iter::repeat_n(position, cell.count as usize));
}

/// How points divide between the halves of boxes.
struct Halves {
    /// By number of points and context.
    few: [[Model; 8]; FEW as usize + 1],
    many: [Model; 8],
}

impl Default for Halves {
    fn default() -> Self {
        Halves {
            few: std::array::from_fn(|n| [Model::among((n + 1).min(16)); 8]),
            many: [Model::default(); 8],
        }
    }
}

impl Halves {
    fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        cell: Cell,
        axis: usize,
        truth: &mut Option<Truth<'_>>,
    ) -> Result<[Cell; 2], FormatError> {
        let mut bits = cell.bits;
        bits[axis] -= 1;
        let middle = cell.low[axis] + (1 << bits[axis]);
        let below = truth.as_mut().map_or(0, |t| {
            let range = cell.first as usize..(cell.first + cell.count) as usize;
            // Stable, so that the bytes depend on the order given alone.
            let (low, high): (Vec<u32>, Vec<u32>) = t.order[range.clone()]
                .iter()
                .partition(|&&p| (t.positions[p as usize][axis] as u32) < middle);
            t.order[range.start..range.start + low.len()].copy_from_slice(&low);
            t.order[range.start + low.len()..range.end].copy_from_slice(&high);
            low.len() as u32
        });
        let thin = u32::from(cell.thin);
        // The axis that is halved comes first.
        let context = ((thin >> axis | thin << (3 - axis)) & 7) as usize;
        let below = if cell.count <= FEW {
            coder.symbol(&mut self.few[cell.count as usize][context], below)
        } else {
            // Sixteenths of the number, then what is left.
            let share = cell.count.div_ceil(16).max(1);
            let sixteenth = coder.symbol(&mut self.many[context], (below / share).min(15));
            let rest_bits = if sixteenth < 15 {
                u32::BITS - (share - 1).leading_zeros()
            } else {
                u32::BITS - cell.count.saturating_sub(15 * share).leading_zeros()
            };
            sixteenth * share
                + coder.bits(rest_bits, below.wrapping_sub(sixteenth * share) & mask(rest_bits))
        };
        if below > cell.count {
            let why = format!("{below} of {} points are in a half", cell.count);
            return Err(FormatError::malformed("page", why));
        }
        let one_sided = below == 0 || below == cell.count;
        let thin = cell.thin & !(1 << axis) | u8::from(one_sided) << axis;
        let mut high = cell;
        (high.bits, high.thin) = (bits, thin);
        high.low[axis] = middle;
        (high.first, high.count) = (cell.first + below, cell.count - below);
        let low = Cell { low: cell.low, bits, first: cell.first, count: below, thin };
        Ok([low, high])
    }
}

fn mask(bits: u32) -> u32 {
    ((1u64 << bits) - 1) as u32
}

/// Normals, colours and radii.
struct Attributes {
    normals: [Signed<4>; 2],
    colours: Signed<8>,
    radii: Signed<1>,
}

impl Attributes {
    fn new() -> Attributes {
        Attributes {
            // Points of scans differ by several degrees, steps are a fifth of one.
            normals: [Signed::new(1), Signed::new(1)],
            colours: Signed::new(0),
            radii: Signed::new(0),
        }
    }

    /// Codes those of the point `at`, whose part begins with `first`.
    fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        out: &mut Points,
        first: usize,
        at: usize,
        has_colours: bool,
        truth: &Option<Truth<'_>>,
    ) {
        let source = truth.as_ref().map(|t| (t.points, t.order[at] as usize));
        let expected = Expected::of(out, first, at);
        let normal = source.map(|(points, p)| points.normals[p]);
        let on_octahedron = on_octahedron(expected.normal);
        out.normals.push(code_normal(coder, &mut self.normals, 1, 0, on_octahedron, normal));
        if has_colours {
            let colour = source.map_or([0; 4], |(points, p)| points.colours[p]);
            let mut found = [0; 4];
            // What the first channel is off by, the others mostly are as well.
            let mut first_off = 0;
            for channel in 0..4 {
                let shared = if channel < 3 { first_off } else { 0 };
                let guess = expected.colour[channel] + shared;
                let residual = i32::from(colour[channel]) - guess;
                let residual = self.colours.code(coder, 2 * channel, residual);
                found[channel] = guess.wrapping_add(residual) as u8;
                if channel == 0 {
                    first_off = residual.clamp(-255, 255);
                }
            }
            out.colours.push(found);
        }
        let radius = source.map_or(0, |(points, p)| i32::from(points.radii[p].0));
        let residual = self.radii.code(coder, 0, radius - expected.radius);
        out.radii.push(PointRadius(expected.radius.wrapping_add(residual) as u8));
    }
}

/// What a point's attributes are expected to be.
struct Expected {
    normal: [f32; 3],
    colour: [i32; 4],
    radius: i32,
}

impl Expected {
    /// Means over the last few points, the nearer the more.
    ///
    /// Nothing but additions, multiplications and divisions, which all machines round alike.
    fn of(out: &Points, first: usize, at: usize) -> Expected {
        let here = out.positions[at];
        let mut sum = 0.0;
        let mut normal = [0.0; 3];
        let mut colour = [0.0; 4];
        let mut radius = 0.0;
        for k in first.max(at.saturating_sub(NEIGHBOURS))..at {
            let there = out.positions[k];
            let mut squared = 0.0;
            for axis in 0..3 {
                let along = (here[axis] as f32) - (there[axis] as f32);
                squared += along * along;
            }
            let weight = 1.0 / (squared + 1.0);
            sum += weight;
            let of = out.normals[k].decode();
            (0..3).for_each(|i| normal[i] += weight * of[i]);
            if let Some(of) = out.colours.get(k) {
                (0..4).for_each(|i| colour[i] += weight * f32::from(of[i]));
            }
            radius += weight * f32::from(out.radii[k].0);
        }
        let mean = |total: f32| if sum > 0.0 { (total / sum + 0.5) as i32 } else { 0 };
        Expected { normal, colour: colour.map(mean), radius: mean(radius) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{OctNormal, Scalars};
    use proptest::prelude::*;

    type Point = ([i32; 3], OctNormal, ([u8; 4], Scalars), (PointRadius, Vec<PointRadius>));

    /// What must survive: each part of the order, whatever its own.
    fn canonical(points: &Points) -> Vec<Vec<Point>> {
        let mut first = 0;
        ends(points.len(), &points.prefixes)
            .into_iter()
            .map(|end| {
                let colour = |p: usize| {
                    let scalars = points.scalars.get(p).copied().unwrap_or_default();
                    (points.colours.get(p).copied().unwrap_or_default(), scalars)
                };
                let of_prefixes = |p: usize| {
                    points
                        .prefixes
                        .iter()
                        .filter_map(|prefix| prefix.radii.get(p))
                        .copied()
                        .collect()
                };
                let point = |p| {
                    let radii = (points.radii[p], of_prefixes(p));
                    (points.positions[p], points.normals[p], colour(p), radii)
                };
                let mut part: Vec<Point> = (first..end).map(point).collect();
                part.sort_unstable();
                first = end;
                part
            })
            .collect()
    }

    fn assert_survives(points: &Points, shift: u8) -> Vec<u8> {
        let page = encode_points(points, shift).unwrap();
        let decoded = decode_points(&page).unwrap();
        assert_eq!(canonical(points), canonical(&decoded));
        assert_eq!(points.has_colours(), decoded.has_colours());
        assert_eq!(encoded_point_count(&page).unwrap() as usize, points.len());
        // What comes out goes in again, the same.
        assert_eq!(encode_points(&decoded, shift).unwrap(), page);
        page
    }

    /// A bowl of n × n points.
    fn bowl(n: i32, shift: u8, has_colours: bool) -> Points {
        let mut points = Points::default();
        for y in 0..n {
            for x in 0..n {
                let z = (x * x + y * y) / 40;
                points.positions.push([x << shift, (y << shift) - 77, z << shift]);
                points.normals.push(OctNormal::encode([-x as f32, -y as f32, 20.0]));
                points.radii.push(PointRadius(20 + (x % 3) as u8));
                if has_colours {
                    points.colours.push([x as u8, (x + y) as u8, 200, 255]);
                    points.scalars.push(Scalars([7, (99 * x) as u16, u16::from(y < 3), 0]));
                }
            }
        }
        points
    }

    fn prefix(count: u8) -> PointPrefix {
        PointPrefix { radii: (0..count).map(|i| PointRadius(40 + i % 7)).collect() }
    }

    #[test]
    fn points_survive_coding() {
        for (n, shift, has_colours) in [(0, 0, false), (1, 0, true), (40, 3, true), (9, 20, false)]
        {
            assert_survives(&bowl(n, shift, has_colours), shift);
        }
        let mut points = bowl(30, 2, true);
        points.prefixes = [100u8, 101, 200].map(prefix).to_vec();
        assert_survives(&points, 2);
        // All in one place.
        let mut points = bowl(20, 0, false);
        points.positions.fill([i32::MAX, i32::MIN, 3]);
        assert_survives(&points, 0);
    }

    #[test]
    fn regular_points_cost_little() {
        let points = bowl(100, 0, true);
        let page = assert_survives(&points, 0);
        // 12 + 4 + 4 + 1 + 6 bytes a point as they are.
        assert!(page.len() < points.len() * 27 / 6, "{} B", page.len());
    }

    #[test]
    fn the_comparison_sees_every_difference() {
        let mut points = bowl(5, 0, true);
        points.prefixes = vec![prefix(7)];
        type Change = fn(&mut Points);
        let changes: [Change; 7] = [
            |p| p.prefixes[0].radii[2].0 += 1,
            |p| p.scalars[3].0[1] += 1,
            |p| p.positions[3][0] += 1,
            |p| p.normals[3] = OctNormal::encode([1.0, 0.0, 0.0]),
            |p| p.colours[3][1] ^= 1,
            |p| p.radii[3].0 += 1,
            // From one part into the other.
            |p| p.positions.swap(1, 20),
        ];
        for change in changes {
            let mut changed = points.clone();
            change(&mut changed);
            assert_ne!(canonical(&points), canonical(&changed));
        }
    }

    proptest! {
        #[test]
        fn any_points_survive(
            points in prop::collection::vec(
                (prop::array::uniform3(-999..999i32), prop::array::uniform3(-1.0..1.0f32), any::<[u8; 4]>(), any::<u8>()),
                1..200,
            ),
            has_colours in any::<bool>(),
            cuts in prop::collection::btree_set(1u8..200, 0..4),
            wide in 0u32..=20,
        ) {
            let mut all = Points::default();
            for (position, normal, colour, radius) in points {
                all.positions.push(position.map(|c| c << wide));
                all.normals.push(OctNormal::encode(normal));
                all.radii.push(PointRadius(radius));
                if has_colours {
                    all.colours.push(colour);
                    let number = |a: usize| u16::from(colour[a]) << 8 | u16::from(colour[a + 1]);
                    all.scalars.push(Scalars([number(0), number(1), 0, number(2) >> 12]));
                }
            }
            let count = all.len();
            all.prefixes = cuts.into_iter().filter(|&c| usize::from(c) < count).map(prefix).collect();
            assert_survives(&all, 0);
        }

        #[test]
        fn damaged_pages_end_in_errors_or_valid_points(
            at in 0usize..2_000,
            value in any::<u8>(),
            cut in 0usize..2_000,
        ) {
            let mut points = bowl(12, 1, true);
            points.prefixes = vec![prefix(70)];
            let page = encode_points(&points, 1).unwrap();
            let mut damaged = page.clone();
            let at = at % damaged.len();
            damaged[at] ^= value;
            for bytes in [&damaged[..], &page[..cut % page.len()]] {
                if let Ok(points) = decode_points(bytes) {
                    prop_assert!(points.validate().is_ok());
                }
            }
        }
    }
}
