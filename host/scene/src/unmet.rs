//! What came of a scene against what it expects.

use kband_control::{Event, Fault};

use super::outcome::Outcome;

impl Outcome {
    /// What of the scene's expectation did not come, a line each; `None` where the scene expects
    /// nothing.
    pub fn unmet(&self) -> Option<Vec<String>> {
        let expected = self.file().expectation.as_ref()?;
        let mut unmet = Vec::new();
        let last = self.last();
        if let Some(state) = expected.state {
            unmet.extend(differs("state", state.name(), last.state.name()));
        }
        if let Some(fault) = expected.fault {
            let [wanted, came] = [fault, last.fault].map(|f| f.map_or("none", Fault::name));
            unmet.extend(differs("fault", wanted, came));
        }
        if let Some(events) = &expected.events {
            let names = |events: &mut dyn Iterator<Item = Event>| {
                events.map(Event::name).collect::<Vec<_>>().join(", ")
            };
            let came = names(&mut self.events().map(|happened| happened.event));
            let wanted = names(&mut events.iter().copied());
            if came != wanted {
                unmet.push(format!("events: expected {wanted}; came {came}"));
            }
        }
        if let Some(limits) = &expected.limits {
            let [wanted, came] = [limits.join(", "), self.limits().join(", ")];
            unmet.extend(differs(
                "limits",
                &format!("[{wanted}]"),
                &format!("[{came}]"),
            ));
        }
        if let Some(regime) = &expected.regime {
            unmet.extend(differs("regime", regime, &self.regime()));
        }
        let identified = self.identified();
        let restitution = identified.map_or(f64::NAN, |found| f64::from(found.restitution));
        let values = [
            ("k", self.k()),
            ("speed in mm/s", self.speed() * 1e3),
            ("share of time in gear", self.in_gear().unwrap_or(f64::NAN)),
            ("restitution identified", restitution),
        ];
        for ((name, value), range) in values.into_iter().zip(expected.ranges) {
            if let Some((low, high)) = range
                && !(low..=high).contains(&value)
            {
                unmet.push(format!(
                    "{name}: expected {low}..{high}, came to {value:.4}"
                ));
            }
        }
        if let (Some(within), Some(state)) = (expected.within, expected.state) {
            match self.reached(state) {
                Some(time) if time <= within => {}
                Some(time) => unmet.push(format!(
                    "{} within {within} s: came at {time:.2} s",
                    state.name()
                )),
                None => unmet.push(format!("{} within {within} s: never came", state.name())),
            }
        }
        Some(unmet)
    }
}

/// What came instead of what was expected.
fn differs(what: &str, wanted: &str, came: &str) -> Option<String> {
    (wanted != came).then(|| format!("{what}: expected {wanted}, came to {came}"))
}
