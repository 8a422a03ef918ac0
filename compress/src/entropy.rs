//! Entropy coding of pages: adaptive distributions of 16 symbols, coded by interleaved rANS
//! (Duda 2013; Giesen, *Interleaved entropy coders*, 2014), beside a stream of plain bits.
//!
//! A codec is written once, against [`Coder`]: the [`Encoder`] is told each value and hands it
//! back, the [`Decoder`] finds it in the bytes. So the two cannot disagree about order, contexts
//! or predictions.

use crate::FormatError;

/// Probabilities are multiples of 2⁻¹⁵.
const SCALE_BITS: u32 = 15;
const SCALE: u32 = 1 << SCALE_BITS;
/// Symbols of one distribution.
pub(crate) const SYMBOLS: usize = 16;
/// States are at least this large between symbols; smaller ones take in 16 bits.
const STATE_MIN: u32 = 1 << 16;
/// Symbols take turns between states, so that one's arithmetic overlaps with the other's.
const STATES: usize = 2;

/// Least probability of a symbol: every symbol can always be coded, and none costs nothing.
const LEAST: usize = 4;
/// So no byte codes more symbols: 8 ÷ −log₂(1 − 15·4 ÷ 2¹⁵), rounded up. Pages that declare more
/// than their bytes can say are refused before anything is allocated for them.
pub(crate) const SYMBOLS_A_BYTE: u64 = 3_200;

/// An adaptive distribution of 16 symbols.
///
/// `below[s]` is the summed probability of the symbols before s.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub(crate) struct Model {
    below: [i16; SYMBOLS],
    seen: u16,
}

impl Default for Model {
    fn default() -> Self {
        Model::among(SYMBOLS)
    }
}

/// What was expected counts like so many symbols seen.
const EXPECTING: u16 = 12;

/// How far a distribution moves towards what was seen: by 2⁻ʳ, for the first, second, … symbol.
/// Quickly at first, since pages are small.
const RATES: [u8; 256] = {
    let mut rates = [7; 256];
    let mut n = 0;
    while n < 255 {
        rates[n] = match n {
            0 => 1,
            1 | 2 => 2,
            3..=9 => 3,
            10..=25 => 4,
            26..=80 => 5,
            _ => 6,
        };
        n += 1;
    }
    rates
};

/// Where distributions move: `TARGETS[s][i]` is `below[i]` when only s occurs.
const TARGETS: [[i16; SYMBOLS]; SYMBOLS] = {
    let mut targets = [[0; SYMBOLS]; SYMBOLS];
    let mut s = 0;
    while s < SYMBOLS {
        let mut i = 0;
        while i < SYMBOLS {
            let above = if i > s { SCALE as usize - LEAST * SYMBOLS } else { 0 };
            targets[s][i] = (above + LEAST * i) as i16;
            i += 1;
        }
        s += 1;
    }
    targets
};

impl Model {
    /// The first `count` symbols alike, the rest all but impossible.
    pub(crate) fn among(count: usize) -> Model {
        let share = (SCALE as usize - LEAST * SYMBOLS) / count;
        Model { below: std::array::from_fn(|i| (LEAST * i + share * i.min(count)) as i16), seen: 0 }
    }

    /// Symbols about as often as the weights say, which sum to 1,000.
    pub(crate) const fn expecting(weights: [u16; SYMBOLS]) -> Model {
        let mut below = [0; SYMBOLS];
        let mut sum = 0;
        let mut i = 0;
        while i < SYMBOLS {
            below[i] = (LEAST * i + sum * (SCALE as usize - LEAST * SYMBOLS) / 1000) as i16;
            sum += weights[i] as usize;
            i += 1;
        }
        Model { below, seen: EXPECTING }
    }

    #[inline(always)]
    fn range(&self, symbol: usize) -> (u32, u32) {
        let below = self.below[symbol] as u32;
        let end = if symbol + 1 < SYMBOLS { self.below[symbol + 1] as u32 } else { SCALE };
        (below, end - below)
    }

    /// The symbol whose range holds a value below 2¹⁵.
    #[inline(always)]
    fn find(&self, value: u32) -> usize {
        let value = value as i16;
        // All sixteen at once: compilers make a few vector instructions of it.
        let at_or_below: i16 = self.below.iter().map(|&b| i16::from(b <= value)).sum();
        at_or_below as usize - 1
    }

    #[inline(always)]
    fn adapt(&mut self, symbol: usize) {
        let rate = RATES[usize::from(self.seen).min(RATES.len() - 1)];
        self.seen = self.seen.saturating_add(1);
        for (below, target) in self.below.iter_mut().zip(&TARGETS[symbol]) {
            *below += (target - *below) >> rate;
        }
    }
}

/// One direction of coding.
pub(crate) trait Coder {
    /// Whether values are told (true) or found (false).
    const ENCODES: bool;
    /// A symbol of 0..16; `value` is looked at by encoders only.
    fn symbol(&mut self, model: &mut Model, value: u32) -> u32;
    /// `count` ≤ 32 plain bits; `value` is looked at by encoders only.
    fn bits(&mut self, count: u32, value: u32) -> u32;
    /// To be asked once for each thing of which a page may declare millions.
    ///
    /// # Errors
    /// Decoders: when more has been read than there is, so that what is still to come is made up.
    fn check_left(&self) -> Result<(), FormatError>;
}

/// Notes what is coded; [`Encoder::finish`] makes bytes of it.
#[derive(Default)]
pub(crate) struct Encoder {
    /// Start and length of each symbol's range.
    ranges: Vec<(u16, u16)>,
    bits: Vec<u8>,
    held: u64,
    held_bits: u32,
}

impl Coder for Encoder {
    const ENCODES: bool = true;

    fn symbol(&mut self, model: &mut Model, value: u32) -> u32 {
        let (start, length) = model.range(value as usize);
        self.ranges.push((start as u16, length as u16));
        model.adapt(value as usize);
        value
    }

    fn bits(&mut self, count: u32, value: u32) -> u32 {
        debug_assert!(count <= 32 && u64::from(value) >> count == 0);
        self.held |= u64::from(value) << self.held_bits;
        self.held_bits += count;
        while self.held_bits >= 8 {
            self.bits.push(self.held as u8);
            self.held >>= 8;
            self.held_bits -= 8;
        }
        value
    }

    fn check_left(&self) -> Result<(), FormatError> {
        Ok(())
    }
}

impl Encoder {
    /// What the symbols and plain bits so far cost, for accounts of what costs what.
    pub(crate) fn cost_bits(&self) -> f64 {
        let symbols: f64 =
            self.ranges.iter().map(|r| f64::from(SCALE_BITS) - f64::from(r.1).log2()).sum();
        symbols + (self.bits.len() * 8) as f64 + f64::from(self.held_bits)
    }

    /// States, then words, in the order in which a decoder wants them; and the plain bits.
    pub(crate) fn finish(mut self) -> (Vec<u8>, Vec<u8>) {
        if self.held_bits > 0 {
            self.bits.push(self.held as u8);
        }
        // A decoder undoes the last symbol first.
        let mut states = [STATE_MIN; STATES];
        let mut words: Vec<u16> = Vec::with_capacity(self.ranges.len() / 2);
        for (i, &(start, length)) in self.ranges.iter().enumerate().rev() {
            let state = &mut states[i % STATES];
            let (start, length) = (u32::from(start), u32::from(length));
            if u64::from(*state) >= u64::from(length) << (32 - SCALE_BITS) {
                words.push(*state as u16);
                *state >>= 16;
            }
            *state = ((*state / length) << SCALE_BITS) + *state % length + start;
        }
        let mut symbols = Vec::with_capacity(words.len() * 2 + 4 * STATES);
        states.iter().for_each(|state| symbols.extend(state.to_le_bytes()));
        words.iter().rev().for_each(|word| symbols.extend(word.to_le_bytes()));
        (symbols, self.bits)
    }
}

/// Finds what an [`Encoder`] was told. Reading past the end gives nothing in particular, and
/// [`Coder::check_left`] and [`Decoder::finish`] an error.
pub(crate) struct Decoder {
    /// The state whose turn it is comes first.
    states: [u32; STATES],
    /// Both streams are followed by zeros, so that reading needs no branch.
    words: Vec<u8>,
    next_word: usize,
    bits: Vec<u8>,
    next_bit: usize,
}

/// Zeros behind a stream.
const PADDING: usize = 8;

fn padded(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len() + PADDING);
    out.extend_from_slice(bytes);
    out.resize(bytes.len() + PADDING, 0);
    out
}

impl Decoder {
    pub(crate) fn new(symbols: &[u8], bits: &[u8]) -> Result<Decoder, FormatError> {
        let Some((states, words)) = symbols.split_first_chunk::<{ 4 * STATES }>() else {
            return Err(FormatError::malformed("page", "its symbols are cut off".to_owned()));
        };
        let states =
            std::array::from_fn(|i| u32::from_le_bytes([0, 1, 2, 3].map(|k| states[4 * i + k])));
        let (words, bits) = (padded(words), padded(bits));
        Ok(Decoder { states, words, next_word: 0, bits, next_bit: 0 })
    }

    /// # Errors
    /// When the bytes were not used up exactly, as all that an encoder writes are.
    pub(crate) fn finish(self) -> Result<(), FormatError> {
        let exact = self.next_word == self.words.len() - PADDING
            && self.next_bit.div_ceil(8) == self.bits.len() - PADDING
            && self.states == [STATE_MIN; STATES];
        if exact {
            return Ok(());
        }
        Err(FormatError::malformed("page", "its streams do not end with its mesh".to_owned()))
    }
}

impl Coder for Decoder {
    const ENCODES: bool = false;

    #[inline(always)]
    fn symbol(&mut self, model: &mut Model, _: u32) -> u32 {
        let [state, other] = self.states;
        let value = state & (SCALE - 1);
        let symbol = model.find(value);
        let (start, length) = model.range(symbol);
        // Cannot overflow: length < 2¹⁵, and value lies within the range.
        let state = length * (state >> SCALE_BITS) + value - start;
        let word = self.words.get(self.next_word..self.next_word + 2);
        let word = word.map_or(0, |w| u32::from(u16::from_le_bytes([w[0], w[1]])));
        let takes = state < STATE_MIN;
        self.next_word += 2 * usize::from(takes);
        self.states = [other, if takes { state << 16 | word } else { state }];
        model.adapt(symbol);
        symbol as u32
    }

    #[inline(always)]
    fn bits(&mut self, count: u32, _: u32) -> u32 {
        let at = self.next_bit / 8;
        let held = match self.bits.get(at..at + 8) {
            Some(&[a, b, c, d, e, f, g, h]) => u64::from_le_bytes([a, b, c, d, e, f, g, h]),
            _ => 0,
        };
        let value = held >> (self.next_bit % 8) & ((1 << count) - 1);
        self.next_bit += count as usize;
        value as u32
    }

    #[inline(always)]
    fn check_left(&self) -> Result<(), FormatError> {
        let is_over = self.next_word > self.words.len() - PADDING
            || self.next_bit > 8 * (self.bits.len() - PADDING);
        if is_over { Err(cut_off()) } else { Ok(()) }
    }
}

#[cold]
fn cut_off() -> FormatError {
    FormatError::malformed("page", "its streams end before its content".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Codes symbols with two models in turn, and each symbol's value in as many plain bits.
    fn all<C: Coder>(coder: &mut C, values: &[u32]) -> Vec<u32> {
        let mut models = [Model::default(), Model::among(16)];
        let mut out = Vec::new();
        for (i, &value) in values.iter().enumerate() {
            let found = coder.symbol(&mut models[i % 2], value);
            assert_eq!(coder.bits(found, (1 << value) - 1), (1 << found) - 1);
            out.push(found);
        }
        out
    }

    fn coded(values: &[u32]) -> (Vec<u8>, Vec<u8>) {
        let mut encoder = Encoder::default();
        all(&mut encoder, values);
        encoder.finish()
    }

    proptest! {
        #[test]
        fn what_was_told_is_found(values in prop::collection::vec(0u32..16, 0..300)) {
            let (symbols, bits) = coded(&values);
            let mut decoder = Decoder::new(&symbols, &bits).unwrap();
            prop_assert_eq!(all(&mut decoder, &values), values);
            prop_assert!(decoder.finish().is_ok());
        }

        #[test]
        fn what_is_left_over_or_cut_off_is_an_error(values in prop::collection::vec(0u32..16, 1..99)) {
            let (symbols, bits) = coded(&values);
            let mut decoder = Decoder::new(&symbols, &bits).unwrap();
            let mut models = [Model::default(), Model::among(16)];
            for i in 0..values.len() - 1 {
                let found = decoder.symbol(&mut models[i % 2], 0);
                decoder.bits(found, 0);
            }
            prop_assert!(decoder.finish().is_err());
            let mut longer = symbols.clone();
            longer.extend([0, 0]);
            let mut decoder = Decoder::new(&longer, &bits).unwrap();
            all(&mut decoder, &values);
            prop_assert!(decoder.finish().is_err());
        }
    }

    /// Nothing is amiss while a decoder reads what there is, and soon after it has read more.
    #[test]
    fn reading_on_past_the_end_is_noticed() {
        let values: Vec<u32> = (0..400).map(|i| i * 7 % 16).collect();
        let (symbols, bits) = coded(&values);
        for (symbols, bits) in
            [(&symbols[..], &bits[..]), (&symbols, &bits[..9]), (&symbols[..99], &bits)]
        {
            let mut decoder = Decoder::new(symbols, bits).unwrap();
            let mut models = [Model::default(), Model::among(16)];
            let mut ends_after = None;
            for i in 0..2 * values.len() {
                if decoder.check_left().is_err() {
                    ends_after = ends_after.or(Some(i));
                }
                let found = decoder.symbol(&mut models[i % 2], 0);
                decoder.bits(found, 0);
            }
            let is_whole = symbols.len() > 99 && bits.len() > 9;
            let expected = if is_whole { 401..500 } else { 1..400 };
            assert!(
                ends_after.is_some_and(|n| expected.contains(&n)),
                "{ends_after:?}, {expected:?}"
            );
        }
    }

    /// Symbols of known probabilities cost what Shannon says, and a little for learning them.
    #[test]
    fn symbols_cost_their_entropy() {
        let mut random = 1u32;
        let mut halvings = || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 8 | 1 << 15).trailing_zeros()
        };
        // Symbol s has a probability of 2⁻⁽ˢ⁺¹⁾: two bits of entropy.
        let values: Vec<u32> = (0..50_000).map(|_| halvings()).collect();
        let mut encoder = Encoder::default();
        let mut model = Model::default();
        for &value in &values {
            encoder.symbol(&mut model, value);
        }
        let expected = encoder.cost_bits();
        let bits = 8.0 * encoder.finish().0.len() as f64;
        let each = bits / values.len() as f64;
        assert!((2.0..2.05).contains(&each), "{each} bits a symbol");
        assert!((bits - expected).abs() < 0.002 * bits, "{bits} bits, accounted {expected}");
    }

    /// What [`SYMBOLS_A_BYTE`] promises, for the cheapest symbols there can be.
    #[test]
    fn no_symbol_is_free() {
        let mut encoder = Encoder::default();
        let mut model = Model::default();
        const COUNT: u64 = 1_000_000;
        for _ in 0..COUNT {
            encoder.symbol(&mut model, 7);
        }
        let bytes = encoder.finish().0.len() as u64;
        assert!(COUNT < bytes * SYMBOLS_A_BYTE, "{bytes} bytes");
        assert!(COUNT > bytes * SYMBOLS_A_BYTE / 4, "{bytes} bytes: the bound says little");
    }

    #[test]
    fn every_symbol_keeps_a_range() {
        for symbol in 0..SYMBOLS {
            let mut model = Model::expecting([0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1000]);
            (0..10_000).for_each(|_| model.adapt(symbol));
            for s in 0..SYMBOLS {
                let (start, length) = model.range(s);
                assert!(length >= LEAST as u32 && start + length <= SCALE, "{s}: {start} {length}");
                assert_eq!((model.find(start), model.find(start + length - 1)), (s, s));
            }
        }
    }
}
