//! Recipes: the target and the settings of one kind of parts, for a change of parts.

use crate::{Settings, Target};
use kband::feeder::OutOfRange;
use serde::{Deserialize, Serialize};

/// Largest length of a recipe's name, bytes.
const NAME_BYTES: usize = 14;
const VALUES: usize = 8;

/// Name of a recipe: 1 to 14 printable characters of ASCII.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "[u8; NAME_BYTES]", into = "[u8; NAME_BYTES]")]
pub struct RecipeName([u8; NAME_BYTES]);

impl RecipeName {
    /// Accepted names, in words.
    pub const ACCEPTED: &'static str = "1 to 14 printable characters of ASCII";

    /// The name with this text; `None` if the text is not accepted.
    pub fn parse(text: &str) -> Option<Self> {
        let mut name = [0; NAME_BYTES];
        name.get_mut(..text.len())?.copy_from_slice(text.as_bytes());
        Self::try_from(name).ok()
    }

    /// Its text.
    pub fn text(&self) -> &str {
        let text = core::str::from_utf8(&self.0).unwrap_or_default();
        text.trim_end_matches('\0')
    }
}

impl From<RecipeName> for [u8; NAME_BYTES] {
    fn from(name: RecipeName) -> Self {
        name.0
    }
}

impl TryFrom<[u8; NAME_BYTES]> for RecipeName {
    type Error = &'static str;

    fn try_from(bytes: [u8; NAME_BYTES]) -> Result<Self, Self::Error> {
        let end = bytes.iter().position(|byte| *byte == 0);
        let (text, rest) = bytes.split_at(end.unwrap_or(NAME_BYTES));
        let printable = text.iter().all(|byte| (b' '..=b'~').contains(byte));
        let is_valid = !text.is_empty() && printable && rest.iter().all(|byte| *byte == 0);
        is_valid.then_some(Self(bytes)).ok_or(Self::ACCEPTED)
    }
}

/// Target and settings of one kind of parts. A recipe has no settings of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recipe {
    /// The target, with its upper tones.
    pub target: Target,
    /// Values of the settings [`Recipe::KEYS`], in their order.
    pub values: [f32; VALUES],
}

impl Recipe {
    /// Number of recipes that a board stores, numbered from 1.
    pub const COUNT: u8 = 7;

    /// Keys of the settings that belong to the parts.
    pub const KEYS: [&'static str; VALUES] = [
        "restitution_low",
        "restitution_high",
        "scatter",
        "tangential_restitution",
        "soft_start",
        "soft_stop",
        "part_length",
        "contact",
    ];

    /// The recipe of this target and of these settings.
    pub fn of(target: Target, settings: &Settings) -> Self {
        Self {
            target,
            values: Self::KEYS.map(|key| settings.get(key).unwrap_or_default()),
        }
    }

    /// The settings of a machine with this recipe.
    ///
    /// # Errors
    /// A value is out of range, alone or together with the machine's settings.
    #[inline(never)]
    pub fn applied_to(&self, settings: &Settings) -> Result<Settings, OutOfRange> {
        let mut settings = *settings;
        for (key, value) in Self::KEYS.into_iter().zip(self.values) {
            settings.set(key, value)?;
        }
        settings.check()?;
        Ok(settings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_printable_ascii_of_at_most_14_characters() {
        for valid in ["M3", "caps 0.5 mm ~!", "12345678901234"] {
            assert_eq!(RecipeName::parse(valid).unwrap().text(), valid);
        }
        for invalid in ["", "123456789012345", "M3\n", "caf\u{e9}", "a\0b"] {
            assert_eq!(RecipeName::parse(invalid), None, "{invalid:?}");
        }
    }

    #[test]
    fn a_recipe_changes_the_settings_of_the_parts_alone() {
        let machine = Settings {
            frequency: 60.0,
            gain: 2.0,
            scatter: 0.1,
            ..Settings::default()
        };
        let parts = Settings {
            frequency: 55.0,
            restitution_low: 0.5,
            restitution_high: 0.6,
            scatter: 0.02,
            soft_start: 1.5,
            part_length: 12.0,
            contact: 0.4,
            ..Settings::default()
        };
        let recipe = Recipe::of(Target::K(0.4), &parts);
        let applied = recipe.applied_to(&machine).unwrap();
        for key in Settings::KEYS {
            let of_parts = Recipe::KEYS.contains(&key.name);
            let source = if of_parts { &parts } else { &machine };
            assert_eq!(applied.get(key.name), source.get(key.name), "{}", key.name);
        }
        // A contact of 1.2 ms is 7.2 % of a cycle at the machine's 60 Hz.
        for (index, value, parameter) in [
            (0, 0.7, "restitution_high"),
            (7, 1.2, "contact"),
            (5, 0.0, "soft_stop"),
        ] {
            let mut other = recipe;
            other.values[index] = value;
            let refused = other.applied_to(&machine).unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
    }
}
