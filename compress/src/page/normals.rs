//! Normals, predicted from the surface they stand on.
//!
//! All positions and triangles are known before the first normal. A vertex' normal is expected
//! where the triangles round it have theirs (Deering 1995), moved by what the vertices that it was
//! itself predicted from were off by.

use super::values::Signed;
use super::walk::Walked;
use crate::OctNormal;
use crate::entropy::Coder;
use crate::octahedral::SCALE;

/// How normals are expected: chosen for each page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Expectation {
    /// Triangles count by their angle at the vertex, as where builders compute normals, and not by
    /// their area.
    by_angle: bool,
    /// How much of each parent's deviation a vertex shares, in eighths.
    share: u8,
}

impl Expectation {
    const SHARES: u8 = 5;

    fn all() -> impl Iterator<Item = Expectation> {
        let shares = |by_angle| (0..Self::SHARES).map(move |share| Expectation { by_angle, share });
        [false, true].into_iter().flat_map(shares)
    }

    pub(super) fn to_byte(self) -> u8 {
        u8::from(self.by_angle) << 4 | self.share
    }

    pub(super) fn of_byte(byte: u8) -> Option<Expectation> {
        Self::all().find(|e| e.to_byte() == byte)
    }
}

/// Codes all normals of a page; `truth` is in its order.
pub(super) fn code_normals<C: Coder>(
    coder: &mut C,
    walked: &Walked,
    shift: u32,
    expectation: Expectation,
    truth: Option<&[OctNormal]>,
) -> Vec<OctNormal> {
    let mut models: [Signed<4>; 2] = [Signed::new(shift), Signed::new(shift)];
    let mut out = Vec::with_capacity(walked.positions.len());
    let surface = surface_normals(walked, expectation.by_angle);
    each_expected(walked, &surface, expectation.share, |vertex, (lower, expected)| {
        let context = 2 * usize::from(walked.on_border[vertex]);
        let truth = truth.map(|t| t[vertex]);
        let normal = code_normal(coder, &mut models, shift, context, (lower, expected), truth);
        out.push(normal);
        normal
    });
    out
}

/// Codes one normal that is expected at a place of the octahedron.
#[inline(always)]
pub(super) fn code_normal<C: Coder>(
    coder: &mut C,
    models: &mut [Signed<4>; 2],
    shift: u32,
    mut context: usize,
    (lower, expected): (bool, [i32; 2]),
    truth: Option<OctNormal>,
) -> OctNormal {
    let truth = mirrored(truth.unwrap_or_default().0.map(i32::from), lower);
    let mut found = [0; 2];
    for i in 0..2 {
        let residual = truth[i].wrapping_sub(expected[i]);
        let residual = models[i].code(coder, context, residual);
        context += usize::from(residual.unsigned_abs() >> shift > 2);
        found[i] = expected[i].wrapping_add(residual);
    }
    // A damaged page may lead anywhere.
    let found = found.map(|c| c.clamp(-LIMIT, LIMIT));
    OctNormal(mirrored(found, lower).map(|c| c as i16)).canonical()
}

/// The expectation with which normals cost least, and how far off it is in the mean.
pub(super) fn best_expectation(walked: &Walked, truth: &[OctNormal]) -> (Expectation, f64) {
    let surfaces = [false, true].map(|by_angle| surface_normals(walked, by_angle));
    let cost = |expectation: Expectation| {
        let surface = &surfaces[usize::from(expectation.by_angle)];
        let (mut bits, mut sum) = (0.0, 0.0);
        each_expected(walked, surface, expectation.share, |vertex, (lower, expected)| {
            let at = mirrored(truth[vertex].0.map(i32::from), lower);
            for i in 0..2 {
                let off = f64::from((at[i] - expected[i]).abs());
                bits += (1.0 + off).log2();
                sum += off;
            }
            truth[vertex]
        });
        (bits, sum / (2 * truth.len().max(1)) as f64)
    };
    let all = Expectation::all().map(|expectation| (expectation, cost(expectation)));
    let best = all.min_by(|a, b| a.1.0.total_cmp(&b.1.0)).expect("there are ten");
    (best.0, best.1.1)
}

const LIMIT: i32 = SCALE as i32;

/// Calls back with each vertex and where its normal is expected on the octahedron, mirrored if it
/// points down; the callback gives the normal itself, from which later ones are predicted.
fn each_expected(
    walked: &Walked,
    surface: &[[f32; 3]],
    share: u8,
    mut normal_of: impl FnMut(usize, (bool, [i32; 2])) -> OctNormal,
) {
    let weight = f32::from(share) / 8.0;
    let mut off = vec![[0.0; 3]; walked.positions.len()];
    for (vertex, &n) in surface.iter().enumerate() {
        let mut expected = n;
        for parent in walked.parents[vertex] {
            // The first vertex has none.
            if let Some(off) = off.get(parent as usize) {
                (0..3).for_each(|i| expected[i] += weight * off[i]);
            }
        }
        let normal = normal_of(vertex, on_octahedron(expected)).decode();
        off[vertex] = [normal[0] - n[0], normal[1] - n[1], normal[2] - n[2]];
    }
}

/// Unit normals; zero where there is none.
///
/// Nothing but additions, multiplications, divisions and roots, which all machines round alike,
/// [`LANES`] triangles at a time.
fn surface_normals(walked: &Walked, by_angle: bool) -> Vec<[f32; 3]> {
    let mut sums = vec![[0.0; 3]; walked.positions.len()];
    for triangles in walked.triangles.chunks(LANES) {
        let mut sides = [[[0.0; LANES]; 3]; 3];
        for (lane, t) in triangles.iter().enumerate() {
            let at = |k: usize| walked.positions[t[k] as usize];
            let p = [at(0), at(1), at(2)];
            for k in 0..3 {
                for i in 0..3 {
                    sides[k][i][lane] = p[(k + 1) % 3][i].wrapping_sub(p[k][i]) as f32;
                }
            }
        }
        let [u, v, _] = &sides;
        let cross = |j: usize, k: usize| lanes(|l| u[j][l] * v[k][l] - u[k][l] * v[j][l]);
        let normal = [cross(1, 2), cross(2, 0), cross(0, 1)];
        let weights = if by_angle { angles(&sides, &normal) } else { [[1.0; LANES]; 3] };
        for (lane, t) in triangles.iter().enumerate() {
            for (&corner, weight) in t.iter().zip(&weights) {
                let sum: &mut [f32; 3] = &mut sums[corner as usize];
                (0..3).for_each(|i| sum[i] += weight[lane] * normal[i][lane]);
            }
        }
    }
    for sum in &mut sums {
        let length = sum.iter().map(|c| c * c).sum::<f32>().sqrt();
        if length > 0.0 {
            *sum = sum.map(|c| c / length);
        }
    }
    sums
}

/// As many as fill a few vector registers.
const LANES: usize = 8;
type Lanes = [f32; LANES];

#[inline(always)]
fn lanes(f: impl Fn(usize) -> f32) -> Lanes {
    // A loop, and not `from_fn`, is what compilers make vectors of.
    let mut out = [0.0; LANES];
    for (lane, out) in out.iter_mut().enumerate() {
        *out = f(lane);
    }
    out
}

/// Angles at the corners over the length of the normals; zero where that is.
fn angles(sides: &[[Lanes; 3]; 3], normal: &[Lanes; 3]) -> [Lanes; 3] {
    let dot = |a: &[Lanes; 3], b: &[Lanes; 3]| {
        lanes(|l| a[0][l] * b[0][l] + a[1][l] * b[1][l] + a[2][l] * b[2][l])
    };
    let root = |x: Lanes| lanes(|l| x[l].sqrt());
    let size = root(dot(normal, normal));
    let lengths = [0, 1, 2].map(|k| root(dot(&sides[k], &sides[k])));
    [0, 1, 2].map(|k| {
        let last = (k + 2) % 3;
        let across = dot(&sides[k], &sides[last]);
        let cosine = lanes(|l| -across[l] / (lengths[k][l] * lengths[last][l]));
        // acos to 7 × 10⁻⁵ (Abramowitz & Stegun 1964, 4.4.45).
        let c = lanes(|l| cosine[l].abs().min(1.0));
        let series =
            lanes(|l| 1.5707288 + c[l] * (-0.2121144 + c[l] * (0.0742610 + c[l] * -0.0187293)));
        let angle = lanes(|l| (1.0 - c[l]).sqrt() * series[l]);
        let angle =
            lanes(|l| if cosine[l] < 0.0 { std::f32::consts::PI - angle[l] } else { angle[l] });
        lanes(|l| if size[l] > 0.0 { angle[l] / size[l] } else { 0.0 })
    })
}

/// Whether a direction points down, and its place on the octahedron mirrored to point up: so that
/// what is near in direction is near in numbers.
pub(super) fn on_octahedron([x, y, z]: [f32; 3]) -> (bool, [i32; 2]) {
    let sum = x.abs() + y.abs() + z.abs();
    if sum <= 0.0 || !sum.is_finite() {
        return (false, [0, 0]);
    }
    let place = |c: f32| {
        let at = c / sum * SCALE;
        (if at < 0.0 { at - 0.5 } else { at + 0.5 }) as i32
    };
    (z < 0.0, [place(x), place(y)])
}

/// Folds the lower half of the octahedron inside and the upper outside; its own inverse.
fn mirrored([u, v]: [i32; 2], lower: bool) -> [i32; 2] {
    if !lower {
        return [u, v];
    }
    let sign = |c: i32| if c < 0 { -1 } else { 1 };
    [(LIMIT - v.abs()) * sign(u), (LIMIT - u.abs()) * sign(v)]
}
