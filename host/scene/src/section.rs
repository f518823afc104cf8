//! One table of a scene file, key by key.

use std::ops::RangeInclusive;

use kband_control::Settings;
use toml::{Table, Value};

use super::fields::{Field, belongs};
use crate::refusal::Refusal;

/// The number that a value of TOML is, whole or not.
pub fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(number) => Some(*number),
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    }
}

/// One table of a scene file; what is left when it is finished is unknown.
#[derive(Clone, Debug)]
pub(crate) struct Section {
    name: String,
    table: Table,
    known: Vec<&'static str>,
}

impl Section {
    pub fn new(name: &str, table: Table) -> Self {
        Self {
            name: name.into(),
            table,
            known: Vec::new(),
        }
    }

    /// Requested keys so far, each once.
    pub fn names(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        for &key in &self.known {
            if !names.contains(&key) {
                names.push(key);
            }
        }
        names
    }

    pub fn path(&self, key: &str) -> String {
        match (self.name.is_empty(), key.is_empty()) {
            (true, _) => key.to_string(),
            (_, true) => format!("[{}]", self.name),
            _ => format!("{}.{key}", self.name),
        }
    }

    pub fn has(&mut self, key: &'static str) -> bool {
        self.known.push(key);
        self.table.contains_key(key)
    }

    pub fn take(&mut self, key: &'static str) -> Option<Value> {
        self.known.push(key);
        self.table.remove(key)
    }

    pub fn refuse(&self, key: &str, value: &Value, accepted: &str) -> Refusal {
        let shown = match value {
            Value::Float(number) => number.to_string(),
            other => other.to_string().trim().replace('\n', " "),
        };
        Refusal::value(
            self.path(key),
            shown,
            accepted,
            format!("change {} in the scene", self.path(key)),
        )
        .of_key(self.path(key))
    }

    /// The refusal of a key that is left and was surely meant to be this one, if there is any.
    pub fn misspelt(&self, key: &str, accepted: &str) -> Option<Refusal> {
        let near = |left: &&String| alike(key, left) && !self.known.contains(&left.as_str());
        let left = self.table.keys().find(near)?;
        let meant = format!("{} = {accepted}", self.shown(key));
        Some(self.unknown(left, meant, &format!("; did you mean {key}?")))
    }

    pub fn missing(&self, key: &str, accepted: &str) -> Refusal {
        self.misspelt(key, accepted).unwrap_or_else(|| {
            Refusal::value(
                self.path(key),
                "(missing)",
                accepted,
                format!(
                    "add {} to the scene; kband simulate --print-scene shows a whole one",
                    self.path(key)
                ),
            )
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

    /// The number that a value is, within its range.
    pub fn within(
        &self,
        key: &str,
        value: &Value,
        range: RangeInclusive<f32>,
        accepted: &str,
    ) -> Result<f32, Refusal> {
        number(value)
            .map(|number| number as f32)
            .filter(|number| range.contains(number))
            .ok_or_else(|| self.refuse(key, value, accepted))
    }

    /// A number that may be left out.
    pub fn field(&mut self, field: &Field, slot: &mut f32) -> Result<(), Refusal> {
        if self.has(field.key) {
            let [low, high] = field.range;
            *slot = self.number(field.key, low..=high, &field.accepted())?;
        }
        Ok(())
    }

    /// A setting of the controller, with the range that the controller gives it.
    pub fn setting(
        &mut self,
        settings: &mut Settings,
        name: &'static str,
        required: bool,
    ) -> Result<(), Refusal> {
        let Some(key) = Settings::KEYS.iter().find(|key| key.name == name) else {
            return Ok(());
        };
        let Some(value) = self.take(key.name) else {
            return if required {
                Err(self.missing(key.name, key.accepted))
            } else {
                Ok(())
            };
        };
        let refused = || self.refuse(key.name, &value, key.accepted);
        let number = number(&value).ok_or_else(refused)?;
        settings.set(key.name, number as f32).map_err(|_| refused())
    }

    /// One number or `[low, high]`, within 0..1.
    pub fn interval(&mut self, key: &'static str) -> Result<(f32, f32), Refusal> {
        let accepted = "one number or [low, high] with 0 <= low <= high <= 1";
        let value = self.take(key).ok_or_else(|| self.missing(key, accepted))?;
        let pair = match &value {
            Value::Array(pair) if pair.len() == 2 => number(&pair[0]).zip(number(&pair[1])),
            single => number(single).map(|r| (r, r)),
        };
        match pair {
            Some((low, high)) if 0.0 <= low && low <= high && high <= 1.0 => {
                Ok((low as f32, high as f32))
            }
            Some((low, high)) if low > high => Err(self.refuse(
                key,
                &value,
                &format!("{accepted}: this interval is reversed"),
            )),
            _ => Err(self.refuse(key, &value, accepted)),
        }
    }

    pub fn optional(&mut self, key: &'static str) -> Result<Option<Self>, Refusal> {
        match self.take(key) {
            None => Ok(None),
            Some(Value::Table(table)) => Ok(Some(Self {
                name: self.path(key),
                table,
                known: Vec::new(),
            })),
            Some(other) => Err(self.refuse(key, &other, "a table")),
        }
    }

    pub fn section(&mut self, key: &'static str) -> Result<Self, Refusal> {
        self.optional(key)?
            .ok_or_else(|| self.missing(key, "a table of this name"))
    }

    pub fn finish(&self) -> Result<(), Refusal> {
        let Some(key) = self.table.keys().next() else {
            return Ok(());
        };
        let near = self.known.iter().find(|known| alike(known, key));
        let elsewhere = || belongs(key).filter(|name| *name != self.name);
        let hint = match (near, elsewhere()) {
            (Some(known), _) => format!("; did you mean {known}?"),
            (None, Some(name)) => format!("; it is a key of [{name}]"),
            (None, None) => String::new(),
        };
        Err(self.unknown(key, self.names().join(", "), &hint))
    }

    fn unknown(&self, key: &str, accepted: String, hint: &str) -> Refusal {
        let shown = self.shown(key);
        Refusal::value(
            &shown,
            "(unknown key)",
            accepted,
            format!("remove or correct {shown}{hint}"),
        )
        .of_key(self.path(key))
    }

    /// A key as it is written: a table in brackets.
    fn shown(&self, key: &str) -> String {
        match self.table.get(key) {
            Some(Value::Table(_)) => format!("[{}]", self.path(key)),
            _ => self.path(key),
        }
    }
}

/// The line of a scene's text on which a key stands, counted from 1; tables in a row are
/// `disturbance 1`, `disturbance 2`.
pub(crate) fn line_of(text: &str, key: &str) -> Option<usize> {
    let whole = toml::de::DeTable::parse(text).ok()?;
    let mut table = whole.get_ref();
    let mut at = None;
    for name in key.trim_matches(['[', ']']).split('.') {
        let (name, n) = match name.split_once(' ') {
            Some((name, n)) => (name, n.parse::<usize>().ok()),
            None => (name, None),
        };
        let found = table.iter().find(|(key, _)| key.get_ref() == name);
        let Some((key, value)) = found else { break };
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

/// Whether two keys differ by at most two letters changed, added or left out, and are not as short
/// as that.
fn alike(a: &str, b: &str) -> bool {
    if a.len().min(b.len()) < 4 {
        return false;
    }
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut corner = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let cost = (corner + usize::from(x != y)).min(row[j].min(row[j + 1]) + 1);
            corner = row[j + 1];
            row[j + 1] = cost;
        }
    }
    row[b.len()] <= 2
}
