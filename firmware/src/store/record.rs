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
use kband_control::{Settings, Target};

use super::encoding::{COUNT, HASHES, PAIR, Words, pairs, put, put_pairs, target_words};
use super::{CONTENT, Condition, Found, version_3};
use crate::recipes;

/// Version of a record's format and meaning; raised when a setting keeps its name and changes its
/// meaning.
const VERSION: u32 = 4;
/// Largest version that a newer firmware may write.
const LAST_VERSION: u32 = 0xffff;
/// Size of a record's content before the settings, bytes.
pub const HEAD: usize = 36;
/// Size of settings, target and PIN, bytes: 61 settings, 16 more than there are.
pub const SIZE: usize = CONTENT - recipes::SIZE;

// `Found::added` has a bit for each setting.
const _: () = assert!(HEAD + PAIR * COUNT <= SIZE && COUNT <= u64::BITS as usize);

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
