//! The settings of a board: read, checked, and changed completely or not at all.

use kband::feeder::OutOfRange;
use kband_control::Settings;
use kband_control::wire::{Request, Response};

use kband_scene::refusal::Refusal;

use crate::link::Link;

/// A setting on the board.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardSetting {
    /// Key of the setting.
    pub key: String,
    /// Unit; empty for a pure number.
    pub unit: String,
    /// Present value.
    pub value: f32,
    /// Smallest accepted value.
    pub low: f32,
    /// Largest accepted value.
    pub high: f32,
    /// Default value.
    pub default: f32,
}

impl BoardSetting {
    /// The accepted range with its unit, in words.
    pub fn accepted(&self) -> String {
        let accepted = format!("{}..{} {}", self.low, self.high, self.unit);
        accepted.trim_end().to_string()
    }

    /// Meaning; empty for a key unknown to this version.
    pub fn meaning(&self) -> &'static str {
        let key = Settings::KEYS.iter().find(|key| key.name == self.key);
        key.map_or("", |key| key.meaning.trim())
    }

    /// Rounds a value to f32; refuses one outside the range.
    pub fn accept(&self, value: f64) -> Result<f32, Refusal> {
        // A value that rounds to a bound is within the range.
        let single = value as f32;
        if (self.low..=self.high).contains(&single) {
            return Ok(single);
        }
        let next = format!("give {} a value in this range", self.key);
        Err(Refusal::value(&self.key, value, self.accepted(), next))
    }
}

/// All settings of a board, in the board's order.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardSettings(Vec<BoardSetting>);

impl BoardSettings {
    /// Reads all settings.
    pub fn read(link: &mut Link) -> Result<Self, Refusal> {
        let mut all = Vec::new();
        for number in 0..=u8::MAX {
            let setting = link.request(&Request::Setting(number), |response| match response {
                Response::Setting(setting) => Some(BoardSetting {
                    key: setting.key.into(),
                    unit: setting.unit.into(),
                    value: setting.value,
                    low: setting.low,
                    high: setting.high,
                    default: setting.default,
                }),
                _ => None,
            })?;
            match setting {
                Some(setting) => all.push(setting),
                None => break,
            }
        }
        Ok(Self(all))
    }

    /// All settings, in the board's order.
    pub fn iter(&self) -> std::slice::Iter<'_, BoardSetting> {
        self.0.iter()
    }

    /// The setting of a key; the refusal of an unknown key suggests the most similar one.
    pub fn get(&self, key: &str) -> Result<&BoardSetting, Refusal> {
        if let Some(setting) = self.iter().find(|setting| setting.key == key) {
            return Ok(setting);
        }
        let keys: Vec<&str> = self.iter().map(|setting| &setting.key[..]).collect();
        let nearest = keys.iter().max_by(|a, b| {
            let similarity = |other: &str| strsim::jaro_winkler(other, key);
            similarity(a).total_cmp(&similarity(b))
        });
        let next = match nearest {
            Some(other) => format!("did you mean {other}? kband settings list shows all"),
            None => "check that the board runs kband".into(),
        };
        Err(Refusal::value("key", key, keys.join(", "), next))
    }

    /// The controller's settings with these values, for the keys that this version knows.
    pub fn configured(&self) -> Settings {
        let mut settings = Settings::default();
        for setting in self.iter() {
            // Keys unknown to this version do not affect the checks here.
            let _ = settings.set(&setting.key, setting.value);
        }
        settings
    }

    /// Changes the board's settings to these values: all, or none if one is refused.
    pub fn change(&mut self, link: &mut Link, requested: &[(String, f32)]) -> Result<(), Refusal> {
        let mut after = self.clone();
        let mut changes = Vec::new();
        let mut previous = Vec::new();
        for (key, value) in requested {
            self.get(key)?.accept(f64::from(*value))?;
            for setting in after.0.iter_mut().filter(|setting| setting.key == *key) {
                if setting.value.to_bits() != value.to_bits() {
                    changes.push((&key[..], *value));
                    previous.push((&key[..], setting.value));
                }
                setting.value = *value;
            }
        }
        let settings = after.configured();
        (settings.check()).map_err(|refused| inconsistent(&refused, &settings))?;
        if let Err(refusal) = set_all(link, changes) {
            // Restores the settings changed so far; a further refusal would repeat the first.
            let _ = set_all(link, previous);
            return Err(refusal);
        }
        *self = after;
        Ok(())
    }
}

fn inconsistent(refused: &OutOfRange, settings: &Settings) -> Refusal {
    let (key, value) = (refused.parameter, refused.value as f32);
    if key != "safe_amplitude" {
        let next = "change the other setting first, or both by kband settings import";
        return Refusal::value(key, value, refused.accepted, next);
    }
    // Rounded down, so that the shown value is accepted.
    let largest = (settings.largest_safe_amplitude() * 1e4).floor() / 1e4;
    let frequency = settings.frequency + settings.tracking;
    let limits = format!("by amplitude_limit and acceleration_limit at {frequency} Hz");
    let next = format!("kband settings set safe_amplitude {largest}, or less, first");
    Refusal::value(key, value, format!("0..{largest} mm, {limits}"), next)
}

/// Sets all values. Refused ones are tried again after the others, on which they may depend.
pub fn set_all(link: &mut Link, mut pending: Vec<(&str, f32)>) -> Result<(), Refusal> {
    while !pending.is_empty() {
        let mut refused = Vec::new();
        let mut why = None;
        for (key, value) in &pending {
            if let Err(refusal) = link.command(&Request::Set { key, value: *value }) {
                refused.push((*key, *value));
                why = Some(refusal);
            }
        }
        if refused.len() == pending.len() {
            return why.map_or(Ok(()), Err);
        }
        pending = refused;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frequency_names_the_safe_amplitude_to_set_first() {
        let mut settings = Settings {
            frequency: 300.0,
            ..Settings::default()
        };
        let refused = settings.check().unwrap_err();
        let message = inconsistent(&refused, &settings).to_string();
        for expected in ["0..0.0337 mm", "300 Hz", "set safe_amplitude 0.0337"] {
            assert!(message.contains(expected), "{message}");
        }
        settings.safe_amplitude = 0.0337;
        settings.check().unwrap();
    }

    #[test]
    fn a_value_out_of_range_is_refused_with_the_range() {
        let setting = BoardSetting {
            key: "tangential_restitution".into(),
            unit: String::new(),
            value: 0.3,
            low: 0.0,
            high: 0.99,
            default: 0.3,
        };
        // 0.99 is a bound in single precision, which is above 0.99 in double precision.
        assert_eq!(setting.accept(0.99), Ok(0.99));
        for bad in [-0.1, 1.0, f64::NAN, 1e300] {
            assert!(setting.accept(bad).is_err(), "{bad}");
        }
    }
}
