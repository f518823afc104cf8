//! Axes of a sweep: keys of a scene, with values.

use toml::{Table, Value};

use crate::refusal::Refusal;

#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// The key with its tables, such as `drive.gain` or `disturbance.1.at`.
    pub key: String,
    pub values: Vec<f64>,
}

impl Axes {
    /// Parses `key=a..b:n` or `key=a`; the error states the accepted form.
    pub fn parse(text: &str) -> Result<Self, String> {
        let accepted = "KEY=VALUE or KEY=LOW..HIGH:COUNT with a COUNT of 1..100000";
        Self::read(text).ok_or_else(|| format!("{accepted}, such as drive.gain=0.5..1.5:11"))
    }

    fn read(text: &str) -> Option<Self> {
        let (key, range) = text.split_once('=')?;
        let number = |text: &str| {
            let number: f64 = text.trim().parse().ok()?;
            number.is_finite().then_some(number)
        };
        let values = match range.split_once("..") {
            None => vec![number(range)?],
            Some((low, rest)) => {
                let (high, count) = rest.rsplit_once(':')?;
                let (low, high) = (number(low)?, number(high)?);
                let count: usize = count.trim().parse().ok()?;
                if !(1..=100_000).contains(&count) {
                    return None;
                }
                let step = (high - low) / (count.max(2) - 1) as f64;
                let value = |n: usize| match n {
                    0 => low,
                    // The typed value, because a rounded one may be out of range.
                    _ if n + 1 == count => high,
                    _ => low + step * n as f64,
                };
                (0..count).map(value).collect()
            }
        };
        let key = key.trim();
        (!key.is_empty()).then(|| Self {
            key: key.into(),
            values,
        })
    }
}

/// Sets a key of a scene's table, and creates missing tables on its path.
pub(super) fn set(table: &mut Table, key: &str, value: f64) -> Result<(), Refusal> {
    let unknown = |part: &str| {
        let accepted =
            "a numeric key of the scene with its tables, such as drive.gain or disturbance.1.at";
        let next = format!("correct {part}; docs/scenes.md lists every key");
        Refusal::value("--sweep", key, accepted, next)
    };
    let mut parts: Vec<&str> = key.split('.').collect();
    let last = parts.pop().unwrap_or_default();
    let within = parts.last().copied();
    let mut inner = table;
    let mut parts = parts.into_iter();
    while let Some(part) = parts.next() {
        let entry = inner.entry(part);
        inner = match entry.or_insert_with(|| Value::Table(Table::new())) {
            Value::Table(table) => table,
            Value::Array(list) => {
                // The next part is the number of a table in the list, from 1.
                let number = parts.next().ok_or_else(|| unknown(last))?;
                let index = number.parse::<usize>().ok().and_then(|n| n.checked_sub(1));
                match index.and_then(|index| list.get_mut(index)) {
                    Some(Value::Table(table)) => table,
                    _ => return Err(unknown(number)),
                }
            }
            _ => return Err(unknown(part)),
        };
    }
    set_number(inner, within, last, value).ok_or_else(|| unknown(last))
}

/// Sets a number at a key; `None` if the key is a table.
fn set_number(table: &mut Table, within: Option<&str>, key: &str, value: f64) -> Option<()> {
    if matches!(table.get(key), Some(Value::Table(_))) {
        return None;
    }
    if within == Some("target") {
        // A target has only one of several keys.
        table.clear();
    }
    let value = match key {
        "seed" | "locked" | "count" if value.fract() == 0.0 => Value::Integer(value as i64),
        _ => Value::Float(value),
    };
    table.insert(key.into(), value);
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_a_range_are_the_typed_ones() {
        let axes = Axes::parse("part.restitution=0.1..0.7:7").unwrap();
        assert_eq!(axes.key, "part.restitution");
        assert_eq!((axes.values[0], axes.values[6]), (0.1, 0.7));
        assert_eq!(Axes::parse("seed=3").unwrap().values, [3.0]);
        assert_eq!(Axes::parse("seed=3..9:1").unwrap().values, [3.0]);
    }
}
