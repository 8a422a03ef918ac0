//! Exact Euclidean distances to a set of pixels.
//!
//! Based on: Felzenszwalb & Huttenlocher, *Distance Transforms of Sampled Functions*, Theory of
//! Computing 8 (2012): lower envelopes of parabolas, rows first, then columns.

use rayon::prelude::*;

/// Squared distance from each pixel to the nearest one for which `is_member` holds, row by row;
/// infinite where there is none.
pub fn squared_distances(
    width: usize,
    height: usize,
    is_member: impl Fn(usize) -> bool + Sync,
) -> Vec<f32> {
    if width == 0 || height == 0 {
        return Vec::new();
    }
    // Along rows the nearest member is found by two sweeps.
    let mut rows = vec![f32::INFINITY; width * height];
    rows.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let mut sweep = |order: &mut dyn Iterator<Item = usize>| {
            let mut last = f32::INFINITY;
            for x in order {
                last = if is_member(y * width + x) { 0.0 } else { last + 1.0 };
                row[x] = row[x].min(last * last);
            }
        };
        sweep(&mut (0..width));
        sweep(&mut (0..width).rev());
    });
    // Columns are gathered, enveloped and stored as rows of the transpose.
    let mut columns = vec![0.0f32; width * height];
    columns.par_chunks_mut(height).enumerate().for_each_init(
        || (Vec::new(), Vec::new()),
        |(vertices, bounds), (x, column)| {
            let value = |y: usize| rows[y * width + x];
            envelope(height, value, vertices, bounds, column);
        },
    );
    let mut out = rows;
    out.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        row.iter_mut().enumerate().for_each(|(x, d)| *d = columns[x * height + y]);
    });
    out
}

/// out[y] = min over q of (y − q)² + f(q).
fn envelope(
    count: usize,
    f: impl Fn(usize) -> f32,
    vertices: &mut Vec<usize>,
    bounds: &mut Vec<f32>,
    out: &mut [f32],
) {
    vertices.clear();
    bounds.clear();
    for q in (0..count).filter(|&q| f(q).is_finite()) {
        loop {
            let Some(&last) = vertices.last() else {
                vertices.push(q);
                bounds.push(f32::NEG_INFINITY);
                break;
            };
            let (qf, lf) = (q as f32, last as f32);
            let crossing = ((f(q) + qf * qf) - (f(last) + lf * lf)) / (2.0 * (qf - lf));
            if crossing <= bounds[bounds.len() - 1] {
                vertices.pop();
                bounds.pop();
            } else {
                vertices.push(q);
                bounds.push(crossing);
                break;
            }
        }
    }
    if vertices.is_empty() {
        out.fill(f32::INFINITY);
        return;
    }
    let mut k = 0;
    for (y, slot) in out.iter_mut().enumerate() {
        while k + 1 < vertices.len() && bounds[k + 1] < y as f32 {
            k += 1;
        }
        let offset = y as f32 - vertices[k] as f32;
        *slot = offset * offset + f(vertices[k]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_trying_every_member() {
        let (width, height) = (37, 23);
        for seed in 0..20u64 {
            let mut state = seed;
            let members: Vec<bool> = (0..width * height)
                .map(|_| {
                    state =
                        state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    (state >> 33) % (5 + 20 * seed) == 0
                })
                .collect();
            let found = squared_distances(width, height, |p| members[p]);
            for (p, &distance) in found.iter().enumerate() {
                let brute = (0..width * height)
                    .filter(|&m| members[m])
                    .map(|m| {
                        let dx = (m % width) as f32 - (p % width) as f32;
                        let dy = (m / width) as f32 - (p / width) as f32;
                        dx * dx + dy * dy
                    })
                    .fold(f32::INFINITY, f32::min);
                assert_eq!(distance, brute, "pixel {p}, seed {seed}");
            }
        }
        assert!(squared_distances(0, 0, |_| true).is_empty());
        assert!(squared_distances(3, 1, |_| false).iter().all(|d| d.is_infinite()));
    }
}
