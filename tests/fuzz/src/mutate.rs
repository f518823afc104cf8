//! Mutation of inputs, determined by a seed.

use kband::arithmetic::Noise;

/// Generator of inputs near those of a corpus.
#[derive(Clone, Debug)]
pub struct Mutator<'a> {
    corpus: &'a [Vec<u8>],
    tokens: Vec<&'a [u8]>,
    noise: Noise,
}

/// Numbers at the limits of integer widths and lengths.
const EDGES: [&[u8]; 8] = [
    &[0],
    &[0xff],
    &[0x7f, 0xff, 0xff, 0xff],
    &[0xff, 0xff, 0xff, 0x7f],
    &[0, 0, 0x80, 0x7f],
    &[0, 0, 0xc0, 0x7f],
    b"1e39",
    b"-nan",
];
/// Largest number of bytes of an input.
const MAX_INPUT_BYTES: usize = 1 << 16;

impl<'a> Mutator<'a> {
    /// Inputs of `seed` near those of `corpus`, with `words`, separated by `|`, in some of them.
    pub fn new(corpus: &'a [Vec<u8>], words: &'a str, seed: u64) -> Self {
        let tokens = words.split('|').map(str::as_bytes);
        Self {
            corpus,
            tokens: tokens.filter(|word| !word.is_empty()).collect(),
            noise: Noise::new(seed),
        }
    }

    fn below(&mut self, count: usize) -> usize {
        self.noise.bits() as usize % count.max(1)
    }

    fn one(&mut self) -> &'a [u8] {
        let corpus = self.corpus;
        match corpus.len() {
            0 => &[],
            count => &corpus[self.below(count)],
        }
    }

    fn stretch(&mut self, input: &'a [u8]) -> &'a [u8] {
        let from = self.below(input.len() + 1);
        let max = (input.len() - from).min(64);
        &input[from..from + self.below(max + 1)]
    }

    /// The next input.
    pub fn make(&mut self) -> Vec<u8> {
        let mut input = self.one().to_vec();
        // Mostly one or two changes, because small differences reach more code.
        let max = self.below(6) + 1;
        for _ in 0..=self.below(max) {
            let at = self.below(input.len() + 1);
            let piece: &[u8] = match self.below(8) {
                0 if at < input.len() => {
                    input[at] ^= 1 << self.below(8);
                    continue;
                }
                1 if at < input.len() => {
                    input[at] = match input[at] {
                        // Another digit preserves a valid number.
                        b'0'..=b'9' => b'0' + self.below(10) as u8,
                        _ => self.noise.bits() as u8,
                    };
                    continue;
                }
                2 => {
                    let max = (input.len() - at).min(32);
                    input.drain(at..at + self.below(max + 1));
                    continue;
                }
                3 if self.below(8) == 0 => {
                    input.truncate(at);
                    continue;
                }
                4 => EDGES[self.below(EDGES.len())],
                5 if !self.tokens.is_empty() => {
                    let word = self.below(self.tokens.len());
                    self.tokens[word]
                }
                _ => {
                    let other = self.one();
                    self.stretch(other)
                }
            };
            // Half of the insertions replace existing bytes.
            let end = match self.below(2) {
                0 => at,
                _ => (at + piece.len()).min(input.len()),
            };
            input.splice(at..end, piece.iter().copied());
        }
        input.truncate(MAX_INPUT_BYTES);
        input
    }
}
