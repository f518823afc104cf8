//! The settings of a board: read, checked and changed together or not at all.

use kband::feeder::OutOfRange;
use kband_control::Settings;
use kband_control::wire::{Request, Response};

use kband_scene::refusal::Refusal;

use crate::link::Link;

/// A setting as the board has it.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardSetting {
    /// Its key.
    pub key: String,
    /// Its unit; empty for a pure number.
    pub unit: String,
    /// Its value.
    pub value: f32,
    /// Smallest accepted value.
    pub low: f32,
    /// Largest accepted value.
    pub high: f32,
    /// Value on first start.
    pub default: f32,
}

impl BoardSetting {
    /// What is accepted, with the unit.
    pub fn accepted(&self) -> String {
        format!("{}..{} {}", self.low, self.high, self.unit)
            .trim_end()
            .to_string()
    }

    /// What it is; empty for a key that this desk does not know.
    pub fn meaning(&self) -> &'static str {
        let known = Settings::KEYS.iter().find(|known| known.name == self.key);
        known.map_or("", |known| known.meaning.trim())
    }

    /// A value for it, refused outside its range.
    pub fn accept(&self, value: f64) -> Result<f32, Refusal> {
        // What rounds to a bound is the bound.
        let single = value as f32;
        if (self.low..=self.high).contains(&single) {
            return Ok(single);
        }
        Err(Refusal::value(
            &self.key,
            value,
            self.accepted(),
            format!("give {} a value in this range", self.key),
        ))
    }
}

/// Every setting of a board, in the board's order.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardSettings(Vec<BoardSetting>);

impl BoardSettings {
    /// Reads them all.
    pub fn read(link: &mut Link) -> Result<Self, Refusal> {
        let mut all = Vec::new();
        for number in 0..=u8::MAX {
            let setting = link.ask(&Request::Setting(number), |response| match response {
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

    /// One after the other.
    pub fn iter(&self) -> std::slice::Iter<'_, BoardSetting> {
        self.0.iter()
    }

    /// The setting of a key; an unknown one is refused with the key that comes closest.
    pub fn get(&self, key: &str) -> Result<&BoardSetting, Refusal> {
        if let Some(setting) = self.iter().find(|setting| setting.key == key) {
            return Ok(setting);
        }
        let nearest = self.iter().max_by(|a, b| {
            let near = |setting: &BoardSetting| strsim::jaro_winkler(&setting.key, key);
            near(a).total_cmp(&near(b))
        });
        let next = match nearest {
            Some(setting) => format!(
                "did you mean {}? kband settings list shows all",
                setting.key
            ),
            None => "check that the board runs kband".into(),
        };
        let keys: Vec<&str> = self.iter().map(|setting| &setting.key[..]).collect();
        Err(Refusal::value("key", key, keys.join(", "), next))
    }

    /// The controller's settings with these values, as far as this desk knows them.
    pub fn known(&self) -> Settings {
        let mut settings = Settings::default();
        for setting in self.iter() {
            // A key that this desk does not know has no part in what is checked here.
            let _ = settings.set(&setting.key, setting.value);
        }
        settings
    }

    /// Changes the board's settings to these values, all of them or, where one is refused, none.
    pub fn change(&mut self, link: &mut Link, wanted: &[(String, f32)]) -> Result<(), Refusal> {
        let mut after = self.clone();
        let mut changes = Vec::new();
        let mut back = Vec::new();
        for (key, value) in wanted {
            self.get(key)?.accept(f64::from(*value))?;
            for setting in after.0.iter_mut().filter(|setting| setting.key == *key) {
                if setting.value.to_bits() != value.to_bits() {
                    changes.push((&key[..], *value));
                    back.push((&key[..], setting.value));
                }
                setting.value = *value;
            }
        }
        let settings = after.known();
        (settings.check()).map_err(|refused| not_together(&refused, &settings))?;
        if let Err(refusal) = tell(link, changes) {
            // What was taken already is given back; a refusal of that would say the same again.
            let _ = tell(link, back);
            return Err(refusal);
        }
        *self = after;
        Ok(())
    }
}

/// The refusal of settings that do not go together.
fn not_together(refused: &OutOfRange, settings: &Settings) -> Refusal {
    let refusal = Refusal::value(
        refused.parameter,
        refused.value as f32,
        refused.accepted,
        "change the other setting first, or both by kband settings import",
    );
    if refused.parameter != "safe_amplitude" {
        return refusal;
    }
    // Rounded down: what is shown is accepted.
    let largest = (settings.largest_safe_amplitude() * 1e4).floor() / 1e4;
    let frequency = settings.frequency + settings.tracking;
    refusal
        .accepting(format!(
            "0..{largest} mm, by amplitude_limit and acceleration_limit at {frequency} Hz"
        ))
        .then(format!(
            "kband settings set safe_amplitude {largest}, or less, first"
        ))
}

/// Sets each of them; those that need another one first get their turn again.
pub fn tell(link: &mut Link, mut left: Vec<(&str, f32)>) -> Result<(), Refusal> {
    while !left.is_empty() {
        let mut refused = Vec::new();
        let mut why = None;
        for (key, value) in &left {
            if let Err(refusal) = link.tell(&Request::Set { key, value: *value }) {
                refused.push((*key, *value));
                why = Some(refusal);
            }
        }
        if refused.len() == left.len() {
            return why.map_or(Ok(()), Err);
        }
        left = refused;
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
        let message = not_together(&refused, &settings).to_string();
        for said in ["0..0.0337 mm", "300 Hz", "set safe_amplitude 0.0337"] {
            assert!(message.contains(said), "{message}");
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
        // 0.99 is a bound in single precision and larger than it in double precision.
        assert_eq!(setting.accept(0.99), Ok(0.99));
        for bad in [-0.1, 1.0, f64::NAN, 1e300] {
            assert!(setting.accept(bad).is_err(), "{bad}");
        }
    }
}
