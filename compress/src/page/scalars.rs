//! Kept scalars of a page, one after the other, when all positions are known.
//!
//! Whether there is a value is a symbol, with whether one was expected as context. A value is expected
//! where its neighbours have theirs; what it is off by is coded like other numbers.

use super::values::{Signed, shift_for};
use super::{SHIFT_MAX, walk::Walked};
use crate::entropy::{Coder, Model};
use crate::scalars::mean_code;
use crate::{SCALARS_MAX, Scalars};

/// How many scalars have a value somewhere.
pub(super) fn columns(scalars: &[Scalars]) -> usize {
    let used =
        scalars.iter().fold([0; SCALARS_MAX], |all, s| std::array::from_fn(|k| all[k] | s.0[k]));
    used.iter().rposition(|&any| any != 0).map_or(0, |last| last + 1)
}

/// One scalar of all vertices, in the page's order.
pub(super) fn column(scalars: &[Scalars], order: &[u32], k: usize) -> Vec<u16> {
    order.iter().map(|&v| scalars[v as usize].0[k]).collect()
}

/// Adds a scalar to all vertices.
pub(super) fn add_column(out: &mut Vec<Scalars>, k: usize, codes: &[u16]) {
    out.resize(codes.len(), Scalars::default());
    out.iter_mut().zip(codes).for_each(|(scalars, &code)| scalars.0[k] = code);
}

/// What is expected of a vertex, from those before it.
pub(super) trait Expect {
    /// Of the vertex `at`, where `before` are those before it; 0 where no value is.
    fn expect(&self, before: &[u16], at: usize) -> u16;
}

/// Vertices of triangles: the mean of the two that they were predicted from.
impl Expect for Walked {
    fn expect(&self, before: &[u16], at: usize) -> u16 {
        let parents = self.parents[at].map(|v| before.get(v as usize).copied().unwrap_or(0));
        mean_code(parents.map(|code| (code, 1.0)))
    }
}

/// The plain bits with which residuals cost least.
pub(super) fn best_shift(truth: &[u16], expected: &impl Expect) -> u8 {
    let residuals = truth
        .iter()
        .enumerate()
        .filter(|(_, code)| **code > 0)
        .map(|(at, &code)| f64::from(code.abs_diff(expected.expect(&truth[..at], at))));
    let (count, sum) = residuals.fold((0.0f64, 0.0), |(count, sum), r| (count + 1.0, sum + r));
    shift_for(sum / count.max(1.0)).min(SHIFT_MAX) as u8
}

/// Codes one scalar of `count` vertices; `truth` is in the page's order.
pub(super) fn code_scalar<C: Coder>(
    coder: &mut C,
    expected: &impl Expect,
    (count, shift): (usize, u8),
    truth: Option<&[u16]>,
) -> Vec<u16> {
    let mut known = [Model::among(2); 2];
    let mut residuals = Signed::<2>::new(shift.into());
    let mut out = Vec::with_capacity(count);
    for at in 0..count {
        let guess = expected.expect(&out, at);
        let code = truth.map_or(0, |t| t[at]);
        let context = usize::from(guess > 0);
        // Damaged pages may find more than two symbols.
        let has_value = coder.symbol(&mut known[context], u32::from(code > 0)) == 1;
        let found = match has_value {
            true => {
                let residual = i32::from(code) - i32::from(guess);
                let residual = residuals.code(coder, context, residual);
                i32::from(guess).wrapping_add(residual).clamp(1, 65_535) as u16
            }
            false => 0,
        };
        out.push(found);
    }
    out
}
