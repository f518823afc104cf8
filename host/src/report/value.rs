//! The values of a table, and the conversion of numbers to text, CSV and JSON.

use std::borrow::Cow;

use serde_json::Value as Json;

#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    Number(f64),
    Single(f32),
    Count(u64),
    Text(Cow<'static, str>),
    Flag(bool),
    Missing,
}

macro_rules! values {
    ($($kind:ty, $value:ident => $made:expr;)*) => {
        $(impl From<$kind> for Value {
            fn from($value: $kind) -> Self {
                $made
            }
        })*
    };
}

values! {
    f64, value => Self::Number(value);
    f32, value => Self::Single(value);
    u64, count => Self::Count(count);
    usize, count => Self::Count(count as u64);
    u32, count => Self::Count(count.into());
    bool, flag => Self::Flag(flag);
    &'static str, text => Self::Text(text.into());
    String, text => Self::Text(text.into());
}

impl<T: Into<Value>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

impl Value {
    pub(super) fn read(&self, digits: usize) -> String {
        match self {
            Self::Number(value) => number(*value, digits),
            Self::Single(value) => number(shortest(*value), digits),
            Self::Count(value) => value.to_string(),
            Self::Text(text) => text.to_string(),
            Self::Flag(yes) => if *yes { "yes" } else { "no" }.into(),
            Self::Missing => "-".into(),
        }
    }

    fn add_csv(&self, line: &mut String) {
        match self {
            Self::Number(value) if !value.is_finite() => {}
            Self::Single(value) if !value.is_finite() => {}
            Self::Number(value) => add_shortest(line, *value),
            Self::Single(value) => add_shortest(line, *value),
            Self::Text(text) if text.contains([',', '"', '\n']) => {
                *line += &format!("\"{}\"", text.replace('"', "\"\""));
            }
            Self::Text(text) => *line += text,
            Self::Flag(yes) => *line += if *yes { "true" } else { "false" },
            Self::Missing => {}
            Self::Count(count) => *line += &count.to_string(),
        }
    }

    /// Appends the text of [`Value::json`].
    pub(super) fn add_json(&self, line: &mut String) {
        match self {
            Self::Number(value) if value.is_finite() => {
                *line += zmij::Buffer::new().format_finite(*value);
            }
            other => *line += &other.json().to_string(),
        }
    }

    pub(crate) fn json(&self) -> Json {
        match self {
            Self::Number(value) => (*value).into(),
            Self::Single(value) => shortest(*value).into(),
            Self::Count(value) => (*value).into(),
            Self::Text(text) => (**text).into(),
            Self::Flag(yes) => (*yes).into(),
            Self::Missing => Json::Null,
        }
    }
}

/// Result of `make` if `condition` holds, else the default.
pub fn when<T: Default>(condition: bool, make: impl FnOnce() -> T) -> T {
    if condition { make() } else { T::default() }
}

pub fn finite<T: Copy + Into<f64>>(value: T) -> Option<T> {
    value.into().is_finite().then_some(value)
}

/// Different items in the order of their first occurrence, with their counts.
pub fn counted<T: PartialEq>(items: impl IntoIterator<Item = T>) -> Vec<(T, usize)> {
    let mut counts: Vec<(T, usize)> = Vec::new();
    for item in items {
        match counts.iter_mut().find(|(entry, _)| *entry == item) {
            Some((_, count)) => *count += 1,
            None => counts.push((item, 1)),
        }
    }
    counts
}

/// `value` with this many significant digits. Trailing zeros are dropped. An exponent is used below
/// 1e-5, and from 1e6 for integers longer than the digits.
pub fn number(value: impl Into<f64>, digits: usize) -> String {
    let value = value.into();
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let scientific = format!("{value:.*e}", digits.saturating_sub(1));
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let mantissa = match mantissa.contains('.') {
        true => mantissa.trim_end_matches('0').trim_end_matches('.'),
        false => mantissa,
    };
    if !(-5..(digits as i32).max(6)).contains(&exponent) {
        return format!("{mantissa}e{exponent}");
    }
    // The point moves by `exponent` places.
    let sign = if value < 0.0 { "-" } else { "" };
    let mut written = mantissa.trim_start_matches('-').replacen('.', "", 1);
    match usize::try_from(exponent) {
        Ok(places) if written.len() > places + 1 => written.insert(places + 1, '.'),
        Ok(places) => written = format!("{written:0<0$}", places + 1),
        Err(_) => written.insert_str(0, &"0.0000"[..(1 - exponent) as usize]),
    }
    sign.to_string() + &written
}

pub fn numbers<T: Into<f64>, const N: usize>(values: [T; N], digits: usize) -> [String; N] {
    values.map(|value| number(value, digits))
}

/// `low..high` with this many significant digits, or one number if both are equal.
pub fn span(low: f64, high: f64, digits: usize) -> String {
    if low == high {
        number(low, digits)
    } else {
        format!("{}..{}", number(low, digits), number(high, digits))
    }
}

/// Appends the values, separated by commas.
pub fn add_csv(line: &mut String, row: &[Value]) {
    for (n, value) in row.iter().enumerate() {
        if n > 0 {
            line.push(',');
        }
        value.add_csv(line);
    }
}

/// Appends the fewest digits that give back the same number.
fn add_shortest(text: &mut String, value: impl zmij::Float) {
    let mut buffer = zmij::Buffer::new();
    let digits = buffer.format(value);
    // `strip_suffix` calls a function to compare: a CSV of impacts takes 1.2 times as long.
    *text += match digits.as_bytes() {
        [.., b'.', b'0'] => &digits[..digits.len() - 2],
        _ => digits,
    };
}

/// The f64 with the same shortest digits as the f32: 0.18, not 0.18000000715.
pub fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shortest_digits_read_back_to_the_same_bits() {
        let written = |value: f64| {
            let mut text = String::new();
            add_shortest(&mut text, value);
            text
        };
        for value in [0.1, -1.0 / 3.0, 6.02e23, 123456.789, 5e-324, f64::MAX] {
            let read: f64 = written(value).parse().unwrap();
            assert_eq!(read.to_bits(), f64::to_bits(value));
        }
        for text in ["0.1", "-0", "12", "2e-7", "123456.789"] {
            assert_eq!(written(text.parse().unwrap()), text);
        }
    }

    #[test]
    fn numbers_have_significant_digits() {
        assert_eq!(number(1234567.0, 3), "1.23e6");
        assert_eq!(number(0.3930521675, 6), "0.393052");
        assert_eq!(number(9.9999999, 3), "10");
        assert_eq!(number(129.6, 2), "130");
        assert_eq!(number(2e-7, 6), "2e-7");
        assert_eq!(number(-0.0123, 3), "-0.0123");
    }

    #[test]
    fn single_floats_print_as_typed() {
        for value in [0.18_f32, 50.0, 9.806_65, 1e-3, -60.0, 1e-7] {
            assert_eq!(shortest(value).to_string(), value.to_string());
            assert_eq!(shortest(value) as f32, value);
        }
    }
}
