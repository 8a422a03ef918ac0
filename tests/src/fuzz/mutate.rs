//! Changes bytes at random, the same way for the same seed.

/// A generator of pseudo-random changes (xorshift64*, Vigna 2016).
pub struct Mutator(u64);

/// Longest input that is made; what is wrong with long files is wrong with short ones.
const BYTES_MAX: usize = 1 << 16;

/// Numbers at which something ends: of bytes, of counts, of what fits into memory.
const NUMBERS: [&str; 20] = [
    "0",
    "1",
    "-1",
    "2",
    "3",
    "4",
    "7",
    "127",
    "128",
    "255",
    "256",
    "65535",
    "65536",
    "2147483647",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "1e308",
    "-1e-320",
    "NaN",
];

impl Mutator {
    /// Begins with a seed.
    pub fn new(seed: u64) -> Mutator {
        Mutator(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// A number below `count`, which is not 0.
    pub fn below(&mut self, count: usize) -> usize {
        (self.next() >> 32) as usize % count.max(1)
    }

    /// `bytes`, changed in one to eight ways; `other` is what pieces are taken from.
    pub fn changed(&mut self, bytes: &[u8], other: &[u8]) -> Vec<u8> {
        let mut out = bytes.to_vec();
        for _ in 0..1 << self.below(4) {
            self.change(&mut out, other);
        }
        out.truncate(BYTES_MAX);
        out
    }

    fn change(&mut self, out: &mut Vec<u8>, other: &[u8]) {
        match self.below(11) {
            // One bit, one byte.
            0 | 1 => {
                let (at, bit) = (self.below(out.len()), self.below(8));
                out.get_mut(at).into_iter().for_each(|byte| *byte ^= 1 << bit);
            }
            2 => {
                let (at, value) = (self.below(out.len()), self.next() as u8);
                out.get_mut(at).into_iter().for_each(|byte| *byte = value);
            }
            // Cut short, or a piece left out.
            3 => out.truncate(self.below(out.len() + 1)),
            4 => {
                let range = self.range(out.len());
                out.drain(range);
            }
            // A piece twice, or of another input.
            5 => {
                let piece = out[self.range(out.len())].to_vec();
                self.insert(out, &piece);
            }
            6 | 7 => {
                let piece = other[self.range(other.len())].to_vec();
                if self.below(2) == 0 {
                    self.insert(out, &piece);
                } else {
                    let at = self.below(out.len() + 1);
                    out.truncate(at);
                    out.extend(piece);
                }
            }
            // A number, in bytes or in digits.
            8 | 9 => self.exchange_binary(out),
            _ => self.exchange_text(out),
        }
    }

    /// Some range of so many bytes, mostly a short one.
    fn range(&mut self, bytes: usize) -> std::ops::Range<usize> {
        let begin = self.below(bytes + 1);
        let longest = (bytes - begin).min(1 << self.below(14));
        begin..begin + self.below(longest + 1)
    }

    fn insert(&mut self, out: &mut Vec<u8>, piece: &[u8]) {
        let at = self.below(out.len() + 1);
        out.splice(at..at, piece.iter().copied());
    }

    /// Two, four or eight bytes become those of a number at which something ends.
    fn exchange_binary(&mut self, out: &mut [u8]) {
        let width = 2 << self.below(3);
        let value: u64 = match self.below(5) {
            0 => self.next() >> self.below(64),
            1 => (1u64 << self.below(64)).wrapping_sub(self.below(3) as u64),
            2 => u64::from([f32::NAN, f32::INFINITY, f32::MAX, -0.0][self.below(4)].to_bits()),
            3 => [f64::NAN, f64::INFINITY, f64::MAX, -0.0][self.below(4)].to_bits(),
            _ => u64::MAX,
        };
        if out.len() >= width {
            let at = self.below(out.len() - width + 1);
            let is_big = self.below(4) == 0;
            let bytes = if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
            let from = if is_big { 8 - width } else { 0 };
            out[at..at + width].copy_from_slice(&bytes[from..from + width]);
        }
    }

    /// A number in a text becomes another.
    fn exchange_text(&mut self, out: &mut Vec<u8>) {
        let start = self.below(out.len());
        let Some(begin) = out[start..].iter().position(u8::is_ascii_digit) else { return };
        let begin = start + begin;
        let is_part = |c: &u8| c.is_ascii_digit() || b".-+eE".contains(c);
        let length = out[begin..].iter().position(|c| !is_part(c)).unwrap_or(out.len() - begin);
        let number = NUMBERS[self.below(NUMBERS.len())].bytes();
        out.splice(begin..begin + length, number);
    }
}
