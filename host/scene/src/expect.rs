//! Expected result of a scene, from its file.

use kband_control::{Event, Fault, Limits, State};
use toml::Value;

use super::section::{Section, number, pair};
use crate::refusal::Refusal;

/// Expected result of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Expectation {
    pub(crate) state: Option<State>,
    /// Expected fault; `Some(None)` requires that there is none.
    pub(crate) fault: Option<Option<Fault>>,
    pub(crate) events: Option<Vec<Event>>,
    pub(crate) regime: Option<String>,
    /// Lower and upper bounds of k, speed (mm/s), share in gear and restitution.
    pub(crate) ranges: [Option<(f64, f64)>; 4],
    pub(crate) limits: Option<Vec<&'static str>>,
    pub(crate) within: Option<f64>,
}

impl Expectation {
    pub(crate) fn read(mut section: Section) -> Result<Self, Refusal> {
        let mut expected = Self::default();
        if let Some(value) = section.take("state") {
            expected.state = Some(section.choice("state", &value, State::ALL, State::name)?);
        }
        if let Some(value) = section.take("fault") {
            expected.fault = Some(match value.as_str() {
                Some("none") => None,
                _ => Some(section.choice("fault", &value, Fault::ALL, Fault::name)?),
            });
        }
        if let Some(value) = section.take("events") {
            let refused = || section.refuse("events", &value, "a list of names of events");
            let list = value.as_array().ok_or_else(refused)?.iter();
            let event = |item| section.choice("events", item, Event::ALL, Event::name);
            expected.events = Some(list.map(event).collect::<Result<_, _>>()?);
        }
        if let Some(value) = section.take("regime") {
            let refused = || section.refuse("regime", &value, "a regime in words");
            expected.regime = Some(value.as_str().ok_or_else(refused)?.into());
        }
        if let Some(value) = section.take("limits") {
            let names = Limits::ALL.map(Limits::name);
            let accepted = format!("a list of {}", names.join(", "));
            let limit = |item: &Value| names.into_iter().find(|name| item.as_str() == Some(name));
            let list = value.as_array();
            let list = list.and_then(|list| list.iter().map(limit).collect());
            let refused = || section.refuse("limits", &value, &accepted);
            expected.limits = Some(list.ok_or_else(refused)?);
        }
        let keys = ["k", "speed", "in_gear", "restitution"];
        for (key, range) in keys.into_iter().zip(&mut expected.ranges) {
            if let Some(value) = section.take(key) {
                let refused = || section.refuse(key, &value, "[low, high] with low <= high");
                let ordered = pair(&value).filter(|(low, high)| value.is_array() && low <= high);
                *range = Some(ordered.ok_or_else(refused)?);
            }
        }
        if let Some(value) = section.take("within") {
            let refused = || section.refuse("within", &value, "a time in s above 0");
            let time = number(&value).filter(|time| *time > 0.0);
            expected.within = Some(time.ok_or_else(refused)?);
        }
        section.finish()?;
        Ok(expected)
    }
}
