//! The bytes of a record: settings, target and PIN.
//!
//! A record names each setting by a hash of its key. A key that the record lacks gets its default:
//! the default of a key that is added must not change what the drive does. A key that this firmware
//! does not know is of a newer one: the record stays as it is, and the drive stays off.
//!
//! | bytes | content |
//! |---|---|
//! | 4 | version of the record |
//! | 8 | kind and number of the target |
//! | 16 | ratio and phase of the target's upper tones |
//! | 4 | the PIN, 0 for none |
//! | 4 | number of settings |
//! | 6 each | hash of a key, and its value |
//!
//! The recipes ([`crate::recipes`]) are at the record's end.

use kband_control::wire::Pin;
use kband_control::{Settings, Shape, Target, UpperTone};

use super::{CONTENT, Condition, Found, version_3};
use crate::recipes;

/// Version of a record's format and meaning; raised when a setting keeps its name and changes its
/// meaning.
const VERSION: u32 = 4;
/// Largest version that a newer firmware may write.
const LAST_VERSION: u32 = 0xffff;
/// Size of a record's content before the settings, bytes.
pub const HEAD: usize = 36;
/// Size of a setting, bytes.
pub const PAIR: usize = 6;
/// Number of settings.
pub const COUNT: usize = Settings::KEYS.len();
/// Size of settings, target and PIN, bytes: 61 settings, 16 more than there are.
pub const SIZE: usize = CONTENT - recipes::SIZE;

// `Found::added` has a bit for each setting.
const _: () = assert!(HEAD + PAIR * COUNT <= SIZE && COUNT <= u64::BITS as usize);

/// Hash of a setting's key: FNV-1a of 32 bits, folded to 16.
pub const fn hash(key: &str) -> u16 {
    let name = key.as_bytes();
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
        hashes[key] = hash(Settings::KEYS[key].name);
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
}

pub fn put(content: &mut [u8], words: impl IntoIterator<Item = u32>) {
    for (room, word) in content.chunks_exact_mut(4).zip(words) {
        room.copy_from_slice(&word.to_le_bytes());
    }
}

/// Encodes settings, target and PIN at the begin of a record.
pub fn encode_settings(
    content: &mut [u8; CONTENT],
    settings: &Settings,
    target: Target,
    pin: Option<Pin>,
) {
    let (own, _) = content.split_at_mut(SIZE);
    own.fill(0);
    let (head, pairs) = own.split_at_mut(HEAD);
    let words = [VERSION]
        .into_iter()
        .chain(target_words(target))
        .chain([pin.map_or(0, Pin::number), COUNT as u32]);
    put(head, words);
    put_pairs(pairs, HASHES.into_iter().zip(settings.values()));
}

/// Writes hashes of keys with their values.
pub fn put_pairs(room: &mut [u8], pairs: impl IntoIterator<Item = (u16, f32)>) {
    let (rooms, _) = room.as_chunks_mut::<PAIR>();
    for (room, (hash, value)) in rooms.iter_mut().zip(pairs) {
        let [low, high] = hash.to_le_bytes();
        let [a, b, c, d] = value.to_le_bytes();
        *room = [low, high, a, b, c, d];
    }
}

/// Reads `count` hashes with their values; `None` where there are fewer.
pub fn pairs(bytes: &[u8], count: usize) -> Option<impl Iterator<Item = (u16, f32)>> {
    let (pairs, _) = bytes.as_chunks::<PAIR>();
    let pairs = pairs.get(..count)?.iter();
    Some(pairs.map(|[low, high, value @ ..]| {
        (
            u16::from_le_bytes([*low, *high]),
            f32::from_le_bytes(*value),
        )
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
        Target::Flow(flow) => (8, flow.to_bits()),
        Target::Gear { order } => (6, u32::from(order)),
        Target::Tones { k, shape } => {
            tones = shape;
            (7, k.to_bits())
        }
    };
    let tones = tones.tones();
    let tones = tones.map(|tone| [tone.ratio.to_bits(), tone.phase.to_bits()]);
    [kind, number]
        .into_iter()
        .chain(tones.into_iter().flatten())
}

impl Words<'_> {
    /// The target; `None` where this firmware has none of its kind.
    pub fn target(&mut self) -> Option<Target> {
        let (kind, number) = (self.next()?, self.next()?);
        let mut tone = || Some(UpperTone::new(self.number()?, self.number()?));
        let shape = Shape::new(tone()?, tone()?);
        Some(match kind {
            0 => Target::Locked {
                order: u8::try_from(number).ok()?,
            },
            1 => Target::Chaotic,
            2 => Target::K(f32::from_bits(number)),
            3 => Target::Amplitude(f32::from_bits(number)),
            4 => Target::Speed(f32::from_bits(number)),
            5 => Target::Identify,
            8 => Target::Flow(f32::from_bits(number)),
            6 => Target::Gear {
                order: u8::try_from(number).ok()?,
            },
            7 => Target::Tones {
                k: f32::from_bits(number),
                shape,
            },
            _ => return None,
        })
    }

    /// The PIN, where one is set; the outer `None` for a number that is no PIN.
    pub fn pin(&mut self) -> Option<Option<Pin>> {
        match self.next()? {
            0 => Some(None),
            number => Pin::from_number(number).map(Some),
        }
    }
}

/// Whether a record has recipes behind its settings, where this firmware has them.
pub fn has_recipes(content: &[u8; CONTENT]) -> bool {
    Words(content).next() == Some(VERSION)
}

/// Decodes a record.
///
/// # Errors
/// The record is of a newer firmware, or its settings are not accepted.
pub fn decode_settings(content: &[u8; CONTENT]) -> Result<Found, Condition> {
    let mut words = Words(&content[..SIZE]);
    let found = match words.next() {
        Some(VERSION) => decode_pairs(words)?,
        Some(version_3::SCHEMA) => version_3::decode(words).ok_or(Condition::Lost)?,
        Some(newer) if (VERSION..=LAST_VERSION).contains(&newer) => return Err(Condition::Newer),
        _ => return Err(Condition::Lost),
    };
    found.settings.check().map_err(|_| Condition::Lost)?;
    Ok(found)
}

/// Decodes a record behind its version.
fn decode_pairs(mut words: Words<'_>) -> Result<Found, Condition> {
    let target = words.target().ok_or(Condition::Newer)?;
    let pin = words.pin().ok_or(Condition::Lost)?;
    let count = words.next().ok_or(Condition::Lost)? as usize;
    let mut settings = Settings::default();
    let mut added = u64::MAX >> (u64::BITS as usize - COUNT);
    for (hash, value) in pairs(words.0, count).ok_or(Condition::Lost)? {
        let known = HASHES.iter().position(|known| *known == hash);
        let number = known.ok_or(Condition::Newer)?;
        let key = Settings::KEYS.get(number).ok_or(Condition::Newer)?;
        settings.set(key.name, value).map_err(|_| Condition::Lost)?;
        added &= !(1 << number);
    }
    Ok(Found {
        settings,
        target,
        pin,
        condition: Condition::Whole,
        added,
    })
}
