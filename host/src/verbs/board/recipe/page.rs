//! Recipes as a TOML file for export and import.

use clap::ValueEnum;
use kband_control::{Recipe, RecipeName, Settings, Shape, Target, UpperTone};
use kband_scene::{at_line, toml_number as real};

use super::super::target::Kind;
use crate::refusal::{Refusal, Result};

const NEXT: &str = "correct this line; kband recipe export shows a whole file";

/// A recipe of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Its number, from 1.
    pub number: u8,
    /// Its name.
    pub name: RecipeName,
    /// Its content.
    pub recipe: Recipe,
    /// Its place in the file, such as `recipe 1`.
    place: String,
}

impl Entry {
    /// The refusal, for a key of this recipe.
    pub fn at(&self, key: &str, refusal: Refusal) -> Refusal {
        refusal.of_key(format!("{}.{key}", self.place))
    }

    /// The recipes of a text; a refusal names the line and the accepted values.
    pub fn parse(text: &str) -> Result<Vec<Self>> {
        let table = kband_scene::toml_table(text, NEXT)?;
        let tables = match table.get("recipe") {
            Some(toml::Value::Array(tables)) => tables.as_slice(),
            _ => &[],
        };
        let last = text.lines().count();
        let stated = table.get("recipes").and_then(toml::Value::as_integer);
        if stated != i64::try_from(tables.len()).ok() || tables.is_empty() {
            let refusal = Refusal::value(
                format!("line {last}: number of recipes before the end of the file"),
                tables.len(),
                stated.map_or("the number in recipes = N".into(), |stated| {
                    stated.to_string()
                }),
                "export the file anew, or correct recipes = N",
            );
            return Err(refusal);
        }
        let mut entries: Vec<Self> = Vec::new();
        for (n, item) in (1..).zip(tables) {
            let item = Item(format!("recipe {n}"), item);
            let entry = Self::from_toml(&item).and_then(|entry| {
                if entries.iter().any(|other| other.number == entry.number) {
                    return Err(item.refused("number", entry.number, "each number once"));
                }
                Ok(entry)
            });
            entries.push(entry.map_err(|refusal| at_line(refusal, text))?);
        }
        Ok(entries)
    }

    fn from_toml(item: &Item<'_>) -> Result<Self> {
        let numbers = format!("a whole number from 1 to {}", Recipe::COUNT);
        let number = item.value("number", &numbers, |value| {
            let number = u8::try_from(value.as_integer()?).ok()?;
            (1..=Recipe::COUNT).contains(&number).then_some(number)
        })?;
        let name = item.value("name", RecipeName::ACCEPTED, |value| {
            RecipeName::parse(value.as_str()?)
        })?;
        let mut recipe = Recipe::of(target(item)?, &Settings::default());
        for (place, key) in recipe.values.iter_mut().zip(Recipe::KEYS) {
            let setting = Settings::KEYS.iter().find(|setting| setting.name == key);
            let accepted = setting.map_or("", |setting| setting.accepted);
            // Files of older versions lack it.
            if ["part_length", "contact"].contains(&key) && item.1.get(key).is_none() {
                continue;
            }
            *place = item.value(key, accepted, |value| {
                let number = real(value)? as f32;
                Settings::default().set(key, number).ok()?;
                Some(number)
            })?;
        }
        let own_keys = "number name target value second_tone third_tone".split(' ');
        let known: Vec<&str> = own_keys.chain(Recipe::KEYS).collect();
        for (key, _) in item.1.as_table().into_iter().flatten() {
            if !known.contains(&&key[..]) {
                return Err(item.refused(key, "a key of no recipe", known.join(", ")));
            }
        }
        Ok(Self {
            number,
            name,
            recipe,
            place: item.0.clone(),
        })
    }
}

/// A recipe of a file: its place, such as `recipe 1`, and its table.
struct Item<'a>(String, &'a toml::Value);

impl Item<'_> {
    fn refused(
        &self,
        key: &str,
        value: impl std::fmt::Display,
        accepted: impl Into<String>,
    ) -> Refusal {
        Refusal::value(key, value, accepted, NEXT).of_key(format!("{}.{key}", self.0))
    }

    /// The value of a key; a missing or invalid one is refused.
    fn value<T>(
        &self,
        key: &str,
        accepted: &str,
        read: impl FnOnce(&toml::Value) -> Option<T>,
    ) -> Result<T> {
        let raw = self.1.get(key);
        raw.and_then(read).ok_or_else(|| {
            let stated = raw.map_or("nothing".to_string(), ToString::to_string);
            self.refused(key, stated.replace('\n', " "), accepted)
        })
    }
}

/// The target of a recipe: word and number as for `kband target`, or upper tones.
fn target(item: &Item<'_>) -> Result<Target> {
    let names = Kind::value_variants().iter().filter_map(|kind| {
        let value = kind.to_possible_value()?;
        Some(value.get_name().to_string())
    });
    let accepted: Vec<String> = names.chain(["tones".to_string()]).collect();
    let word = item.value("target", &accepted.join(", "), |value| {
        let word = value.as_str()?;
        accepted.iter().find(|name| *name == word).cloned()
    })?;
    let number = (item.1.get("value")).map(|_| item.value("value", "a number", real));
    let number = number.transpose()?;
    if word != "tones" {
        let kind = Kind::from_str(&word, false).map_err(|why| Refusal::new(why, NEXT))?;
        let refused = |refusal: Refusal| refusal.of_key(format!("{}.value", item.0));
        return kind.target(number).map_err(refused);
    }
    let tone = |key: &str| {
        item.value(key, "[ratio 0..0.5, phase in rad]", |value| {
            let [ratio, phase] = &value.as_array()?[..] else {
                return None;
            };
            let (ratio, phase) = (real(ratio)?, real(phase)?);
            let sound = (0.0..=0.5).contains(&ratio) && (phase as f32).is_finite();
            sound.then(|| UpperTone::new(ratio as f32, phase as f32))
        })
    };
    let k = number.filter(|k| (*k as f32).is_finite());
    let k = k.ok_or_else(|| item.refused("value", "no number", "k of the first tone"))?;
    Ok(Target::Tones {
        k: k as f32,
        shape: Shape::new(tone("second_tone")?, tone("third_tone")?),
    })
}

fn target_lines(target: Target) -> String {
    let tone = |tone: UpperTone| format!("[{:?}, {:?}]", tone.ratio, tone.phase);
    match target {
        Target::Gear { order } => format!("target = \"gear\"\nvalue = {order}\n"),
        Target::Locked { order } => format!("target = \"order\"\nvalue = {order}\n"),
        Target::K(k) => format!("target = \"k\"\nvalue = {k:?}\n"),
        Target::Amplitude(b) => format!("target = \"mm\"\nvalue = {b:?}\n"),
        Target::Speed(speed) => format!("target = \"mm/s\"\nvalue = {speed:?}\n"),
        Target::Flow(flow) => format!("target = \"g/s\"\nvalue = {flow:?}\n"),
        Target::PartsPerMinute(rate) => format!("target = \"parts/min\"\nvalue = {rate:?}\n"),
        Target::Chaotic => "target = \"chaos\"\n".into(),
        Target::Identify => "target = \"identify\"\n".into(),
        Target::Tones { k, shape } => format!(
            "target = \"tones\"\nvalue = {k:?}\nsecond_tone = {}\nthird_tone = {}\n",
            tone(shape.second),
            tone(shape.third)
        ),
    }
}

/// The recipes as a file.
pub fn export(recipes: &[(u8, RecipeName, Recipe)], image: &str) -> String {
    let mut text = format!(
        "# Recipes of a board with kband {image}.\n\
         # kband recipe import FILE.toml saves them on a board; its other recipes stay.\n\n\
         recipes = {}\n",
        recipes.len()
    );
    for (number, name, recipe) in recipes {
        let quoted = toml::Value::from(name.text());
        text += &format!("\n[[recipe]]\nnumber = {number}\nname = {quoted}\n");
        text += &target_lines(recipe.target);
        // Keys that older files lack come first, so that a cut file lacks a required one.
        for (key, value) in Recipe::KEYS.iter().zip(recipe.values).rev() {
            let setting = Settings::KEYS.iter().find(|setting| setting.name == *key);
            let accepted = setting.map_or("", |setting| setting.accepted);
            let assigned = format!("{key} = {value:?}");
            text += &format!("{assigned:<32} # {}\n", accepted.trim_end());
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recipes() -> Vec<(u8, RecipeName, Recipe)> {
        let targets = [
            Target::Gear { order: 2 },
            Target::Locked { order: 1 },
            Target::K(0.41),
            Target::Amplitude(0.23),
            Target::Speed(-12.5),
            Target::Chaotic,
            Target::Tones {
                k: 0.35,
                shape: Shape::new(UpperTone::new(0.15, 2.356), UpperTone::new(0.0, 0.0)),
            },
        ];
        let settings = Settings {
            contact: 0.4,
            scatter: 0.07,
            ..Settings::default()
        };
        let recipe = |(number, target)| {
            let name = RecipeName::parse(&format!("parts \"{number}\"")).unwrap();
            (number, name, Recipe::of(target, &settings))
        };
        (1..).zip(targets).map(recipe).collect()
    }

    /// tests/wrong_inputs.txt has the refusals of single values.
    #[test]
    fn exported_recipes_are_imported_unchanged() {
        let text = export(&recipes(), "0.1.0");
        let read = Entry::parse(&text).unwrap().into_iter();
        let read = read.map(|entry| (entry.number, entry.name, entry.recipe));
        assert_eq!(read.collect::<Vec<_>>(), recipes());
    }

    #[test]
    fn a_file_that_is_cut_at_any_byte_is_refused() {
        let text = export(&recipes(), "0.1.0");
        // After the last value there is only a comment.
        let end = text.rfind('#').unwrap();
        for length in 0..end {
            let Err(refusal) = Entry::parse(&text[..length]) else {
                // The last number lost digits.
                let last_line = text[..length].trim_end().lines().last().unwrap_or_default();
                assert!(last_line.starts_with("restitution_low = 0"), "{last_line}");
                continue;
            };
            assert!(refusal.to_string().contains("line "), "{length}: {refusal}");
        }
    }
}
