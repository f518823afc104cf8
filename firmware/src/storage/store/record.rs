//! The bytes of a record: settings, target, PIN and the public key of updates.
//!
//! A record identifies each setting by a hash of its key. A missing key gets its default, so the
//! default of a new key must not change the drive's behaviour. With a key unknown to this firmware,
//! the record stays unchanged, and the drive stays off.
//!
//! | bytes | content |
//! |---|---|
//! | 4 | version of the record |
//! | 8 | kind and number of the target |
//! | 16 | ratio and phase of the target's upper tones |
//! | 4 | the PIN, 0 for none |
//! | 4 | number of pairs |
//! | 6 each | hash of a key, and its value |
//!
//! The public key of updates takes eight separate pairs, each with four of its bytes.
//!
//! The recipes ([`crate::storage::recipes`]) are at the record's end.

use super::encoding::{COUNT, HASHES, PAIR, Words, hash, pairs, put, put_pairs, target_words};
use super::{CONTENT, Condition, LoadedSettings};
use crate::storage::recipes;
use kband_control::wire::Pin;
use kband_control::{Settings, Target};

/// Version of a record's format and meaning; raised when a setting changes its meaning.
const VERSION: u32 = 4;
/// Largest version that a newer firmware may write.
const LAST_VERSION: u32 = 0xffff;
/// Size of a record's content before the settings, bytes.
pub const HEAD: usize = 36;
/// Size of settings, target, PIN and key, bytes: 61 pairs, 8 more than there are.
pub const SIZE: usize = CONTENT - recipes::SIZE;
/// Hashes of the names of the public key's words; a record has all or none.
pub const KEY_HASHES: [u16; 8] = {
    let (mut hashes, mut word, mut name) = ([0; 8], 0, *b"update_key_0");
    while word < hashes.len() {
        hashes[word] = hash(&name);
        (word, name[11]) = (word + 1, name[11] + 1);
    }
    hashes
};

const _: () = assert!(HEAD + PAIR * (COUNT + KEY_HASHES.len()) <= SIZE);
// `LoadedSettings::added` has a bit for each setting.
const _: () = assert!(COUNT <= u64::BITS as usize);

/// Encodes settings, target, PIN and public key of updates at the start of a record.
pub fn encode_settings(
    content: &mut [u8; CONTENT],
    settings: &Settings,
    target: Target,
    pin: Option<Pin>,
    key: Option<[u8; 32]>,
) {
    let (record_bytes, _) = content.split_at_mut(SIZE);
    record_bytes.fill(0);
    let (head, pairs) = record_bytes.split_at_mut(HEAD);
    let words = [VERSION]
        .into_iter()
        .chain(target_words(target))
        .chain([pin.map_or(0, Pin::number)]);
    let count = COUNT + key.map_or(0, |_| KEY_HASHES.len());
    let key = key.unwrap_or_default();
    let (key, _) = key.as_chunks();
    let key = key.iter().copied().map(f32::from_le_bytes);
    put(head, words.chain([count as u32]));
    let values = HASHES.into_iter().zip(settings.values());
    let values = values.chain(KEY_HASHES.into_iter().zip(key));
    put_pairs(pairs, values.take(count));
}

/// The public key of updates in a record. It also reads records of a newer firmware, so that the
/// board can be updated to it.
pub fn key(content: &[u8; CONTENT]) -> Option<[u8; 32]> {
    let mut words = Words(&content[HEAD - 4..SIZE]);
    let count = words.next()? as usize;
    let mut key = [0; 32];
    let (key_words, _) = key.as_chunks_mut();
    let mut remaining = key_words.len();
    for (hash, value) in pairs(words.0, count)? {
        if let Some(word) = KEY_HASHES.iter().position(|known| *known == hash) {
            key_words[word] = value.to_le_bytes();
            remaining = remaining.checked_sub(1)?;
        }
    }
    (remaining == 0).then_some(key)
}

/// Whether a record has recipes behind its settings, at the place that this firmware uses.
pub fn has_recipes(content: &[u8; CONTENT]) -> bool {
    Words(content).next() == Some(VERSION)
}

/// Decodes a record.
///
/// # Errors
/// The record is of a newer firmware, or its settings are not accepted.
pub fn decode_settings(content: &[u8; CONTENT]) -> Result<LoadedSettings, Condition> {
    let mut words = Words(&content[..SIZE]);
    let decoded = match words.next() {
        Some(VERSION) => decode_pairs(words)?,
        Some(newer) if (VERSION..=LAST_VERSION).contains(&newer) => return Err(Condition::Newer),
        _ => return Err(Condition::Lost),
    };
    decoded.settings.check().map_err(|_| Condition::Lost)?;
    Ok(decoded)
}

/// Decodes a record behind its version.
fn decode_pairs(mut words: Words<'_>) -> Result<LoadedSettings, Condition> {
    let target = words.target().ok_or(Condition::Newer)?;
    let pin = words.pin().ok_or(Condition::Lost)?;
    let count = words.next().ok_or(Condition::Lost)? as usize;
    let mut settings = Settings::default();
    let mut added = u64::MAX >> (u64::BITS as usize - COUNT);
    for (hash, value) in pairs(words.0, count).ok_or(Condition::Lost)? {
        if KEY_HASHES.contains(&hash) {
            continue;
        }
        let index = HASHES.iter().position(|known| *known == hash);
        let number = index.ok_or(Condition::Newer)?;
        let key = Settings::KEYS.get(number).ok_or(Condition::Newer)?;
        settings.set(key.name, value).map_err(|_| Condition::Lost)?;
        added &= !(1 << number);
    }
    Ok(LoadedSettings {
        pin,
        added,
        ..LoadedSettings::whole(settings, target)
    })
}
