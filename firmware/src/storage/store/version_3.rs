//! Records of version 3: a fixed list of values in the order of its keys, without their names.

use kband_control::Settings;

use super::encoding::{HASHES, Words, hash};
use super::{Condition, LoadedSettings};

/// Size of a slot, bytes.
pub const SLOT: usize = 256;
/// First word of a record: hash of the version, the keys and their order.
pub const SCHEMA: u32 = 0x4558_79e3;

/// The keys in the order of their values.
const NAMES: &str = "frequency incline amplitude_ratio phase_lead gravity restitution_low \
        restitution_high scatter tangential_restitution resonance quality gain \
        output_maximum amplitude_limit acceleration_limit safe_amplitude soft_start \
        soft_stop envelope amplitude_error capture_attempts sensitivity sensor_zero \
        converter_reference converter_bits link_timeout tracking second_tone second_gain \
        second_lag third_tone third_gain third_lag track_mass track_length sensor_rest \
        gain_tolerance load_tolerance current_sensitivity current_gain";

const KEYS: [u16; 40] = {
    let (mut hashes, mut key, mut names) = ([0; 40], 0, NAMES.as_bytes());
    let mut end = 0;
    while end <= names.len() {
        if end == names.len() || names[end] == b' ' {
            let (name, rest) = names.split_at(end);
            hashes[key] = hash(name);
            (key, end) = (key + 1, 0);
            names = match rest {
                [_, rest @ ..] => rest,
                [] => break,
            };
        } else {
            end += 1;
        }
    }
    hashes
};

/// Decodes a record behind its first word; `None` if a value is not accepted.
pub fn decode(mut words: Words<'_>) -> Option<LoadedSettings> {
    let mut settings = Settings::default();
    let mut added = u64::MAX >> (u64::BITS as usize - HASHES.len());
    for hash in KEYS {
        let value = words.number()?;
        let number = HASHES.iter().position(|stored_hash| *stored_hash == hash)?;
        settings.set(Settings::KEYS.get(number)?.name, value).ok()?;
        added &= !(1 << number);
    }
    Some(LoadedSettings {
        settings,
        target: words.target()?,
        pin: words.pin()?,
        condition: Condition::Whole,
        added,
    })
}
