//! Comparison of a scene's result with its expectation.

use kband_control::{Event, Fault};

use super::outcome::Outcome;

impl Outcome {
    /// Unmet expectations of the scene, one in each line; `None` for a scene without an
    /// expectation.
    pub fn unmet(&self) -> Option<Vec<String>> {
        let expectation = self.file().expectation.as_ref()?;
        let mut unmet = Vec::new();
        let last = self.last();
        if let Some(state) = expectation.state {
            unmet.extend(mismatch("state", state.name(), last.state.name()));
        }
        if let Some(fault) = expectation.fault {
            let [expected, actual] = [fault, last.fault].map(|f| f.map_or("none", Fault::name));
            unmet.extend(mismatch("fault", expected, actual));
        }
        if let Some(events) = &expectation.events {
            let names = |events: &mut dyn Iterator<Item = Event>| {
                events.map(Event::name).collect::<Vec<_>>().join(", ")
            };
            let actual = names(&mut self.events().map(|timed| timed.event));
            let expected = names(&mut events.iter().copied());
            if actual != expected {
                unmet.push(format!("events: expected {expected}; came {actual}"));
            }
        }
        if let Some(limits) = &expectation.limits {
            let [expected, actual] = [limits.join(", "), self.limits().join(", ")];
            let [expected, actual] = [expected, actual].map(|names| format!("[{names}]"));
            unmet.extend(mismatch("limits", &expected, &actual));
        }
        if let Some(regime) = &expectation.regime {
            unmet.extend(mismatch("regime", regime, &self.regime()));
        }
        let identified = self.identified();
        let restitution = identified.map_or(f64::NAN, |result| f64::from(result.restitution));
        let values = [
            ("k", self.k()),
            ("speed in mm/s", self.speed() * 1e3),
            ("share of time in gear", self.in_gear().unwrap_or(f64::NAN)),
            ("restitution identified", restitution),
        ];
        for ((name, value), range) in values.into_iter().zip(expectation.ranges) {
            if let Some((low, high)) = range
                && !(low..=high).contains(&value)
            {
                let expected = format!("{low}..{high}");
                unmet.extend(mismatch(name, &expected, &format!("{value:.4}")));
            }
        }
        if let (Some(within), Some(state)) = (expectation.within, expectation.state) {
            let expected = format!("{} within {within} s", state.name());
            match self.reached(state) {
                Some(time) if time <= within => {}
                Some(time) => unmet.push(format!("{expected}: came at {time:.2} s")),
                None => unmet.push(format!("{expected}: never came")),
            }
        }
        Some(unmet)
    }
}

fn mismatch(what: &str, expected: &str, actual: &str) -> Option<String> {
    (expected != actual).then(|| format!("{what}: expected {expected}, came to {actual}"))
}
