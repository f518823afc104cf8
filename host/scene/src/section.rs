//! One table of a scene file, key by key.

use std::ops::RangeInclusive;

use kband_control::Settings;
use toml::{Table, Value};

use super::fields::{Field, section_with};
use crate::refusal::Refusal;

/// Value of a TOML number, integer or float.
pub fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(number) => Some(*number),
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    }
}

/// The numbers of a TOML array of two; one number counts twice.
pub(crate) fn pair(value: &Value) -> Option<(f64, f64)> {
    match value.as_array().map(Vec::as_slice) {
        None => number(value).map(|one| (one, one)),
        Some([low, high]) => number(low).zip(number(high)),
        Some(_) => None,
    }
}

/// Key of older scenes without effect.
const REMOVED_KEY: &str = "drive.output_minimum";

/// One table of a scene file; keys that remain at the end are unknown.
pub(crate) struct Section {
    name: String,
    table: Table,
    /// The keys used so far, each once.
    pub requested: Vec<&'static str>,
}

impl Section {
    pub fn new(name: &str, table: Table) -> Self {
        Self {
            name: name.into(),
            table,
            requested: Vec::new(),
        }
    }

    pub fn path(&self, key: &str) -> String {
        match (self.name.is_empty(), key.is_empty()) {
            (true, _) => key.to_string(),
            (_, true) => format!("[{}]", self.name),
            _ => format!("{}.{key}", self.name),
        }
    }

    pub fn has(&mut self, key: &'static str) -> bool {
        if !self.requested.contains(&key) {
            self.requested.push(key);
        }
        self.table.contains_key(key)
    }

    pub fn take(&mut self, key: &'static str) -> Option<Value> {
        self.has(key);
        self.table.remove(key)
    }

    /// The value with this name.
    pub fn choice<T: Copy>(
        &self,
        key: &str,
        value: &Value,
        all: &[T],
        name: impl Fn(T) -> &'static str,
    ) -> Result<T, Refusal> {
        let choice = all.iter().find(|item| value.as_str() == Some(name(**item)));
        choice.copied().ok_or_else(|| {
            let names: Vec<&str> = all.iter().map(|item| name(*item)).collect();
            self.refuse(key, value, &names.join(", "))
        })
    }

    pub fn refuse(&self, key: &str, value: &Value, accepted: &str) -> Refusal {
        let text = match value {
            Value::Float(number) => number.to_string(),
            other => other.to_string().trim().replace('\n', " "),
        };
        let path = self.path(key);
        let next = format!("change {path} in the scene");
        Refusal::value(&path, text, accepted, next).of_key(&path)
    }

    /// The refusal of a remaining key as a misspelling of this one; `None` if none is similar.
    pub fn misspelt(&self, key: &str, accepted: &str) -> Option<Refusal> {
        let is_candidate =
            |left: &&String| is_similar(key, left) && !self.requested.contains(&left.as_str());
        let left = self.table.keys().find(is_candidate)?;
        let meant = format!("{} = {accepted}", self.notation(key));
        Some(self.unknown(left, meant, &format!("; did you mean {key}?")))
    }

    pub fn missing(&self, key: &str, accepted: &str) -> Refusal {
        self.misspelt(key, accepted).unwrap_or_else(|| {
            let path = self.path(key);
            let all = "kband simulate --print-scene shows a whole one";
            let next = format!("add {path} to the scene; {all}");
            Refusal::value(path, "(missing)", accepted, next)
        })
    }

    pub fn number(
        &mut self,
        key: &'static str,
        range: RangeInclusive<f32>,
        accepted: &str,
    ) -> Result<f32, Refusal> {
        let value = self.take(key).ok_or_else(|| self.missing(key, accepted))?;
        self.within(key, &value, range, accepted)
    }

    /// A number within its range.
    pub fn within(
        &self,
        key: &str,
        value: &Value,
        range: RangeInclusive<f32>,
        accepted: &str,
    ) -> Result<f32, Refusal> {
        let number = number(value).map(|number| number as f32);
        let number = number.filter(|number| range.contains(number));
        number.ok_or_else(|| self.refuse(key, value, accepted))
    }

    /// Reads an optional number.
    pub fn field(&mut self, field: &Field, slot: &mut f32) -> Result<(), Refusal> {
        if self.has(field.key) {
            let [low, high] = field.range;
            *slot = self.number(field.key, low..=high, &field.accepted())?;
        }
        Ok(())
    }

    /// Reads a setting of the controller, within the controller's range.
    pub fn setting(
        &mut self,
        settings: &mut Settings,
        name: &'static str,
        required: bool,
    ) -> Result<(), Refusal> {
        let Some(key) = Settings::KEYS.iter().find(|key| key.name == name) else {
            return Ok(());
        };
        let value = match self.take(key.name) {
            Some(value) => value,
            None if required => return Err(self.missing(key.name, key.accepted)),
            None => return Ok(()),
        };
        let refused = || self.refuse(key.name, &value, key.accepted);
        let number = number(&value).ok_or_else(refused)?;
        settings.set(key.name, number as f32).map_err(|_| refused())
    }

    /// One number or `[low, high]`, within 0..1.
    pub fn interval(&mut self, key: &'static str) -> Result<(f32, f32), Refusal> {
        let accepted = "one number or [low, high] with 0 <= low <= high <= 1";
        let value = self.take(key).ok_or_else(|| self.missing(key, accepted))?;
        match pair(&value) {
            Some((low, high)) if 0.0 <= low && low <= high && high <= 1.0 => {
                Ok((low as f32, high as f32))
            }
            Some((low, high)) if low > high => {
                let accepted = format!("{accepted}: this interval is reversed");
                Err(self.refuse(key, &value, &accepted))
            }
            _ => Err(self.refuse(key, &value, accepted)),
        }
    }

    pub fn optional(&mut self, key: &'static str) -> Result<Option<Self>, Refusal> {
        match self.take(key) {
            None => Ok(None),
            Some(Value::Table(table)) => Ok(Some(Self::new(&self.path(key), table))),
            Some(other) => Err(self.refuse(key, &other, "a table")),
        }
    }

    pub fn section(&mut self, key: &'static str) -> Result<Self, Refusal> {
        self.optional(key)?
            .ok_or_else(|| self.missing(key, "a table of this name"))
    }

    pub fn finish(&self) -> Result<(), Refusal> {
        let Some(key) = self.table.keys().find(|key| self.path(key) != REMOVED_KEY) else {
            return Ok(());
        };
        let mut requested = self.requested.iter();
        let similar = requested.find(|requested| is_similar(requested, key));
        let elsewhere = section_with(key).filter(|name| *name != self.name);
        let hint = match (similar, elsewhere) {
            (Some(requested), _) => format!("; did you mean {requested}?"),
            (None, Some(name)) => format!("; it is a key of [{name}]"),
            (None, None) => String::new(),
        };
        Err(self.unknown(key, self.requested.join(", "), &hint))
    }

    fn unknown(&self, key: &str, accepted: String, hint: &str) -> Refusal {
        let name = self.notation(key);
        let next = format!("remove or correct {name}{hint}");
        let refusal = Refusal::value(&name, "(unknown key)", accepted, next);
        refusal.of_key(self.path(key))
    }

    /// A key in the notation of the file: a table has brackets.
    fn notation(&self, key: &str) -> String {
        match self.table.get(key) {
            Some(Value::Table(_)) => format!("[{}]", self.path(key)),
            _ => self.path(key),
        }
    }
}

/// Line of a key in a scene's text, from 1; a table of an array is `disturbance 1`.
pub(crate) fn line_of(text: &str, key: &str) -> Option<usize> {
    let whole = toml::de::DeTable::parse(text).ok()?;
    let mut table = whole.get_ref();
    let mut at = None;
    for name in key.trim_matches(['[', ']']).split('.') {
        let (name, n) = match name.split_once(' ') {
            Some((name, n)) => (name, n.parse::<usize>().ok()),
            None => (name, None),
        };
        let entry = table.iter().find(|(key, _)| key.get_ref() == name);
        let Some((key, value)) = entry else { break };
        at = Some(key.span().start);
        match (value.get_ref(), n) {
            (toml::de::DeValue::Table(inner), _) => table = inner,
            (toml::de::DeValue::Array(tables), Some(n)) => {
                let value = tables.get(n.checked_sub(1)?)?;
                at = Some(value.span().start);
                let toml::de::DeValue::Table(inner) = value.get_ref() else {
                    break;
                };
                table = inner;
            }
            _ => break,
        }
    }
    let before = text.get(..at?)?;
    Some(before.matches('\n').count() + 1)
}

/// Whether two keys of at least four letters have an edit distance (Levenshtein) of at most 2.
fn is_similar(a: &str, b: &str) -> bool {
    a.len().min(b.len()) >= 4 && strsim::levenshtein(a, b) <= 2
}
