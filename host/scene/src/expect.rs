//! What a scene must come to, written in the scene file before it is run.

use kband_control::{Event, Fault, Limits, State};
use toml::Value;

use super::section::{Section, number};
use crate::refusal::Refusal;

/// The expected outcome of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Expectation {
    pub(crate) state: Option<State>,
    /// The fault, which may be none.
    pub(crate) fault: Option<Option<Fault>>,
    pub(crate) events: Option<Vec<Event>>,
    pub(crate) regime: Option<String>,
    /// Low and high of k, speed (mm/s), share in gear and restitution.
    pub(crate) ranges: [Option<(f64, f64)>; 4],
    pub(crate) limits: Option<Vec<String>>,
    pub(crate) within: Option<f64>,
}

impl Expectation {
    pub(crate) fn read(mut section: Section) -> Result<Self, Refusal> {
        let mut expected = Self::default();
        if let Some(value) = section.take("state") {
            expected.state = Some(named(&section, "state", &value, State::ALL, State::name)?);
        }
        if let Some(value) = section.take("fault") {
            expected.fault = Some(match value.as_str() {
                Some("none") => None,
                _ => Some(named(&section, "fault", &value, Fault::ALL, Fault::name)?),
            });
        }
        if let Some(value) = section.take("events") {
            let Value::Array(list) = &value else {
                return Err(section.refuse("events", &value, "a list of names of events"));
            };
            let event = |item| named(&section, "events", item, Event::ALL, Event::name);
            expected.events = Some(list.iter().map(event).collect::<Result<_, _>>()?);
        }
        if let Some(value) = section.take("regime") {
            let Value::String(words) = &value else {
                return Err(section.refuse("regime", &value, "a regime in words"));
            };
            expected.regime = Some(words.clone());
        }
        if let Some(value) = section.take("limits") {
            let names = &Limits::ALL.map(Limits::name)[..];
            let limit = |item: &Value| {
                let name = item.as_str().filter(|name| names.contains(name));
                name.map(String::from)
            };
            let list = value.as_array();
            let list = list.and_then(|list| list.iter().map(limit).collect::<Option<Vec<_>>>());
            let list = list.ok_or_else(|| {
                section.refuse("limits", &value, &format!("a list of {}", names.join(", ")))
            })?;
            expected.limits = Some(list);
        }
        let keys = ["k", "speed", "in_gear", "restitution"];
        for (key, range) in keys.into_iter().zip(&mut expected.ranges) {
            if let Some(value) = section.take(key) {
                let refused = || section.refuse(key, &value, "[low, high] with low <= high");
                *range = Some(pair(&value).ok_or_else(refused)?);
            }
        }
        if let Some(value) = section.take("within") {
            expected.within = Some(
                number(&value)
                    .filter(|time| *time > 0.0)
                    .ok_or_else(|| section.refuse("within", &value, "a time in s above 0"))?,
            );
        }
        section.finish()?;
        Ok(expected)
    }
}

fn named<T: Copy>(
    section: &Section,
    key: &str,
    value: &Value,
    all: &[T],
    name: impl Fn(T) -> &'static str,
) -> Result<T, Refusal> {
    let found = all.iter().find(|item| value.as_str() == Some(name(**item)));
    found.copied().ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|item| name(*item)).collect();
        section.refuse(key, value, &names.join(", "))
    })
}

fn pair(value: &Value) -> Option<(f64, f64)> {
    let Value::Array(pair) = value else {
        return None;
    };
    match &pair[..] {
        [low, high] => number(low)
            .zip(number(high))
            .filter(|(low, high)| low <= high),
        _ => None,
    }
}
