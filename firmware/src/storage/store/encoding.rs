//! Binary encoding of a record's parts: 32-bit words, and pairs of a setting's key hash and value.
//!
//! Words and values are little endian, values IEEE single precision. The hash of a key is FNV-1a
//! (Fowler, Noll and Vo 1991), folded to 16 bits.

use kband_control::wire::Pin;
use kband_control::{Settings, Shape, Target, UpperTone};

/// Size of a setting, bytes.
pub const PAIR: usize = 6;
pub const COUNT: usize = Settings::KEYS.len();

/// Hash of a setting's key: FNV-1a of 32 bits, folded to 16.
pub const fn hash(name: &[u8]) -> u16 {
    let mut sum = 0x811c_9dc5_u32;
    let mut at = 0;
    while at < name.len() {
        sum = (sum ^ name[at] as u32).wrapping_mul(0x0100_0193);
        at += 1;
    }
    (sum >> 16 ^ sum) as u16
}

/// Hashes of the keys, in the order of [`Settings::KEYS`].
pub const HASHES: [u16; COUNT] = {
    let mut hashes = [0; COUNT];
    let mut key = 0;
    while key < COUNT {
        hashes[key] = hash(Settings::KEYS[key].name.as_bytes());
        key += 1;
    }
    hashes
};

/// Reads a record in words of four bytes, little endian.
pub struct Words<'a>(pub &'a [u8]);

impl Words<'_> {
    pub fn next(&mut self) -> Option<u32> {
        let (word, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(u32::from_le_bytes(*word))
    }

    pub fn number(&mut self) -> Option<f32> {
        self.next().map(f32::from_bits)
    }

    /// The target; `None` for a kind unknown to this firmware.
    pub fn target(&mut self) -> Option<Target> {
        let (kind, number) = (self.next()?, self.next()?);
        let mut tone = || Some(UpperTone::new(self.number()?, self.number()?));
        let shape = Shape::new(tone()?, tone()?);
        let (order, value) = (u8::try_from(number).ok(), f32::from_bits(number));
        Some(match kind {
            0 => Target::Locked { order: order? },
            1 => Target::Chaotic,
            2 => Target::K(value),
            3 => Target::Amplitude(value),
            4 => Target::Speed(value),
            5 => Target::Identify,
            6 => Target::Gear { order: order? },
            7 => Target::Tones { k: value, shape },
            8 => Target::Flow(value),
            9 => Target::PartsPerMinute(value),
            _ => return None,
        })
    }

    /// The PIN, if one is set; the outer `None` for a number that is not a PIN.
    pub fn pin(&mut self) -> Option<Option<Pin>> {
        match self.next()? {
            0 => Some(None),
            number => Pin::from_number(number).map(Some),
        }
    }
}

pub fn put(content: &mut [u8], words: impl IntoIterator<Item = u32>) {
    for (slot, word) in content.chunks_exact_mut(4).zip(words) {
        slot.copy_from_slice(&word.to_le_bytes());
    }
}

/// Writes hashes of keys with their values.
pub fn put_pairs(content: &mut [u8], pairs: impl IntoIterator<Item = (u16, f32)>) {
    let (slots, _) = content.as_chunks_mut::<PAIR>();
    for (slot, (hash, value)) in slots.iter_mut().zip(pairs) {
        let [low, high] = hash.to_le_bytes();
        let [a, b, c, d] = value.to_le_bytes();
        *slot = [low, high, a, b, c, d];
    }
}

/// Reads `count` hashes with their values; `None` if there are fewer.
pub fn pairs(bytes: &[u8], count: usize) -> Option<impl Iterator<Item = (u16, f32)>> {
    let (pairs, _) = bytes.as_chunks::<PAIR>();
    let pairs = pairs.get(..count)?.iter();
    Some(pairs.map(|[low, high, value @ ..]| {
        let hash = u16::from_le_bytes([*low, *high]);
        (hash, f32::from_le_bytes(*value))
    }))
}

/// Kind, number and upper tones of a target.
pub fn target_words(target: Target) -> impl Iterator<Item = u32> {
    let mut tones = Shape::SINE;
    let (kind, number) = match target {
        Target::Locked { order } => (0, u32::from(order)),
        Target::Chaotic => (1, 0),
        Target::K(k) => (2, k.to_bits()),
        Target::Amplitude(amplitude) => (3, amplitude.to_bits()),
        Target::Speed(speed) => (4, speed.to_bits()),
        Target::Identify => (5, 0),
        Target::Gear { order } => (6, u32::from(order)),
        Target::Tones { k, shape } => {
            tones = shape;
            (7, k.to_bits())
        }
        Target::Flow(flow) => (8, flow.to_bits()),
        Target::PartsPerMinute(rate) => (9, rate.to_bits()),
    };
    let tones = tones.tones();
    let tones = tones.map(|tone| [tone.ratio.to_bits(), tone.phase.to_bits()]);
    ([kind, number].into_iter()).chain(tones.into_iter().flatten())
}
