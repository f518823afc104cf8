//! Recipes as a TOML file for export and import.

use clap::ValueEnum;
use kband_control::{Recipe, RecipeName, Settings, Shape, Target, UpperTone};
use kband_scene::toml_number as real;

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
    /// Keys and the numbers of their lines; the first is the line of the recipe itself.
    lines: Vec<(String, usize)>,
}

impl Entry {
    /// Number of the line that gives a key, or that begins the recipe.
    pub fn line(&self, key: &str) -> usize {
        line(&self.lines, key)
    }

    /// The recipes of a text; a refusal names the line and the accepted values.
    pub fn parse(text: &str) -> Result<Vec<Self>> {
        let table = kband_scene::toml_table(text, NEXT)?;
        let lines = lines(text);
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
        for (item, lines) in tables.iter().zip(lines) {
            let entry = Self::from_toml(item, lines)?;
            if entries.iter().any(|other| other.number == entry.number) {
                let number = entry.number;
                return Err(refused(&entry.lines, "number", number, "each number once"));
            }
            entries.push(entry);
        }
        Ok(entries)
    }

    fn from_toml(item: &toml::Value, lines: Vec<(String, usize)>) -> Result<Self> {
        let numbers = format!("a whole number from 1 to {}", Recipe::COUNT);
        let number = value(item, &lines, "number", &numbers, |value| {
            let number = u8::try_from(value.as_integer()?).ok()?;
            (1..=Recipe::COUNT).contains(&number).then_some(number)
        })?;
        let name = value(item, &lines, "name", RecipeName::ACCEPTED, |value| {
            RecipeName::parse(value.as_str()?)
        })?;
        let mut recipe = Recipe::of(target(item, &lines)?, &Settings::default());
        for (place, key) in recipe.values.iter_mut().zip(Recipe::KEYS) {
            let setting = Settings::KEYS.iter().find(|setting| setting.name == key);
            let accepted = setting.map_or("", |setting| setting.accepted);
            // Files of older versions lack it.
            if ["part_length", "contact"].contains(&key) && item.get(key).is_none() {
                continue;
            }
            *place = value(item, &lines, key, accepted, |value| {
                let number = real(value)? as f32;
                Settings::default().set(key, number).ok()?;
                Some(number)
            })?;
        }
        let own_keys = "number name target value second_tone third_tone".split(' ');
        let known: Vec<&str> = own_keys.chain(Recipe::KEYS).collect();
        for (key, _) in item.as_table().into_iter().flatten() {
            if !known.contains(&&key[..]) {
                return Err(refused(&lines, key, "a key of no recipe", known.join(", ")));
            }
        }
        Ok(Self {
            number,
            name,
            recipe,
            lines,
        })
    }
}

fn line(lines: &[(String, usize)], key: &str) -> usize {
    let entry = lines.iter().find(|(name, _)| name == key);
    entry.or(lines.first()).map_or(1, |(_, line)| *line)
}

fn refused(
    lines: &[(String, usize)],
    key: &str,
    value: impl std::fmt::Display,
    accepted: impl Into<String>,
) -> Refusal {
    Refusal::value(key, value, accepted, NEXT).at(format!("line {}", line(lines, key)))
}

/// The value of a key; a missing or invalid one is refused with its line.
fn value<T>(
    item: &toml::Value,
    lines: &[(String, usize)],
    key: &str,
    accepted: &str,
    read: impl FnOnce(&toml::Value) -> Option<T>,
) -> Result<T> {
    let raw = item.get(key);
    raw.and_then(read).ok_or_else(|| {
        let stated = raw.map_or("nothing".to_string(), ToString::to_string);
        refused(lines, key, stated.replace('\n', " "), accepted)
    })
}

/// The target of a recipe: word and number as for `kband target`, or upper tones.
fn target(item: &toml::Value, lines: &[(String, usize)]) -> Result<Target> {
    let names = Kind::value_variants().iter().filter_map(|kind| {
        let value = kind.to_possible_value()?;
        Some(value.get_name().to_string())
    });
    let accepted: Vec<String> = names.chain(["tones".to_string()]).collect();
    let word = value(item, lines, "target", &accepted.join(", "), |value| {
        let word = value.as_str()?;
        accepted.iter().find(|name| *name == word).cloned()
    })?;
    let number = (item.get("value")).map(|_| value(item, lines, "value", "a number", real));
    let number = number.transpose()?;
    if word != "tones" {
        let kind = Kind::from_str(&word, false).map_err(|why| Refusal::new(why, NEXT))?;
        let at = format!("line {}", line(lines, "value"));
        return kind.target(number).map_err(|refusal| refusal.at(at));
    }
    let tone = |key: &str| {
        value(item, lines, key, "[ratio 0..0.5, phase in rad]", |value| {
            let [ratio, phase] = &value.as_array()?[..] else {
                return None;
            };
            let (ratio, phase) = (real(ratio)?, real(phase)?);
            let sound = (0.0..=0.5).contains(&ratio) && (phase as f32).is_finite();
            sound.then(|| UpperTone::new(ratio as f32, phase as f32))
        })
    };
    let k = number.filter(|k| (*k as f32).is_finite());
    let k = k.ok_or_else(|| refused(lines, "value", "no number", "k of the first tone"))?;
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

/// Line numbers for each recipe of a text: its own, then those of its keys.
fn lines(text: &str) -> Vec<Vec<(String, usize)>> {
    let mut all: Vec<Vec<(String, usize)>> = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim_start();
        if line.starts_with("[[recipe]]") {
            all.push(vec![(String::new(), number)]);
        } else if let (Some(lines), Some((key, _))) = (all.last_mut(), line.split_once('=')) {
            lines.push((key.trim().to_string(), number));
        }
    }
    all
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
