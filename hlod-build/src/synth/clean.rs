//! Specks taken out of a gathered tile: a few samples of one sign, alone among the other.
//!
//! Crevices narrower than the grid leave such specks: closed bubbles in the stone, or crumbs
//! in the air, that no scanner would show. A speck is a component of at most [`SPECK`]
//! samples (neighbours along the axes); whether a sample belongs to one depends on the
//! samples within [`HALO`] steps alone, so that all tiles agree about it.

use super::grid::TILE;

/// Most samples of a speck.
const SPECK: usize = 6;
/// How far round a tile samples are needed.
pub const HALO: usize = SPECK;
/// Samples along the edge of a tile with one more and the halo on either side.
pub const WIDE: usize = TILE + 1 + 2 * HALO;

const STRIDES: [usize; 3] = [1, WIDE, WIDE * WIDE];

/// Turn the signs of specks that touch the middle of the block.
pub fn remove_specks(block: &mut [f32]) {
    // The signs, a row in a word.
    let rows: Vec<u32> = block
        .chunks_exact(WIDE)
        .map(|row| row.iter().enumerate().fold(0, |bits, (x, v)| bits | u32::from(*v < 0.0) << x))
        .collect();
    let inner = 1..WIDE - 1;
    let mut specks = Vec::new();
    for z in inner.clone() {
        for y in inner.clone() {
            // Every speck has a sample with no more than two neighbours of its own sign:
            // count those that differ, bit by bit, and look for four or more.
            let n = z * WIDE + y;
            let own = rows[n];
            let differ = [
                own ^ (own << 1),
                own ^ (own >> 1),
                own ^ rows[n - 1],
                own ^ rows[n + 1],
                own ^ rows[n - WIDE],
                own ^ rows[n + WIDE],
            ];
            let (mut ones, mut twos, mut fours) = (0u32, 0u32, 0u32);
            for d in differ {
                let carry = ones & d;
                ones ^= d;
                fours |= twos & carry;
                twos ^= carry;
            }
            let mut lonely = fours & ((1 << (WIDE - 1)) - 2);
            while lonely != 0 {
                let x = lonely.trailing_zeros() as usize;
                lonely &= lonely - 1;
                collect(block, n * WIDE + x, &mut specks);
            }
        }
    }
    specks.sort_unstable();
    specks.dedup();
    for s in specks {
        block[s] = -block[s];
    }
}

/// Add the component of a sample, if it is a speck that ends within the block.
fn collect(block: &[f32], start: usize, specks: &mut Vec<usize>) {
    let mut found = [0; SPECK];
    found[0] = start;
    let (mut count, mut next) = (1, 0);
    while next < count {
        let at = found[next];
        next += 1;
        for stride in STRIDES {
            let along = at / stride % WIDE;
            if along == 0 || along == WIDE - 1 {
                return;
            }
            for neighbour in [at - stride, at + stride] {
                if (block[neighbour] < 0.0) != (block[start] < 0.0)
                    || found[..count].contains(&neighbour)
                {
                    continue;
                }
                if count == SPECK {
                    return;
                }
                found[count] = neighbour;
                count += 1;
            }
        }
    }
    specks.extend(&found[..count]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: usize, y: usize, z: usize) -> usize {
        (z * WIDE + y) * WIDE + x
    }

    #[test]
    fn removes_specks_and_nothing_else() {
        let mut block = vec![1.0f32; WIDE * WIDE * WIDE];
        // Half of the block is solid, with a bubble of one and a bubble of six samples; a
        // bar of seven samples floats outside, and a crumb of two.
        block[..at(0, 0, 14)].fill(-1.0);
        let solid = block.clone();
        block[at(9, 9, 9)] = 1.0;
        for i in 0..6 {
            block[at(10 + i, 20, 8)] = 1.0;
        }
        block[at(11, 12, 20)] = -1.0;
        block[at(11, 13, 20)] = -1.0;
        let mut wanted = solid;
        for i in 0..7 {
            block[at(12 + i, 20, 20)] = -1.0;
            wanted[at(12 + i, 20, 20)] = -1.0;
        }
        remove_specks(&mut block);
        assert!(block == wanted);
    }
}
