//! Records of version 3: a fixed list of values in the order of its keys, without their names.

use super::LoadedSettings;
use super::encoding::{COUNT, Words};
use kband_control::Settings;

/// Size of a slot, bytes.
pub const SLOT: usize = 256;
/// First word of a record: hash of the version, the keys and their order.
pub const SCHEMA: u32 = 0x4558_79e3;

/// The keys in the order of their values.
const KEYS: &str = "frequency incline amplitude_ratio phase_lead gravity restitution_low \
        restitution_high scatter tangential_restitution resonance quality gain \
        output_maximum amplitude_limit acceleration_limit safe_amplitude soft_start \
        soft_stop envelope amplitude_error capture_attempts sensitivity sensor_zero \
        converter_reference converter_bits link_timeout tracking second_tone second_gain \
        second_lag third_tone third_gain third_lag track_mass track_length sensor_rest \
        gain_tolerance load_tolerance current_sensitivity current_gain";

/// Decodes a record behind its first word; `None` if a value is not accepted.
pub fn decode(mut words: Words<'_>) -> Option<LoadedSettings> {
    let mut settings = Settings::default();
    let mut added = u64::MAX >> (u64::BITS as usize - COUNT);
    for key in KEYS.split(' ') {
        settings.set(key, words.number()?).ok()?;
        let number = Settings::KEYS.iter().position(|known| known.name == key)?;
        added &= !(1 << number);
    }
    let target = words.target()?;
    Some(LoadedSettings {
        pin: words.pin()?,
        added,
        ..LoadedSettings::whole(settings, target)
    })
}
