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
        if let Some(state) = expected.state
            && last.state != state
        {
            unmet.push(format!(
                "state: expected {}, came to {}",
                state.name(),
                last.state.name()
            ));
        }
        if expected.fault_given && last.fault != expected.fault {
            let name = |fault: Option<Fault>| fault.map_or("none", Fault::name);
            unmet.push(format!(
                "fault: expected {}, came to {}",
                name(expected.fault),
                name(last.fault)
            ));
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
            let (came, wanted) = (self.limits().join(", "), limits.join(", "));
            if came != wanted {
                unmet.push(format!("limits: expected [{wanted}], came to [{came}]"));
            }
        }
        if let Some(regime) = &expected.regime
            && self.regime() != *regime
        {
            unmet.push(format!(
                "regime: expected {regime}, came to {}",
                self.regime()
            ));
        }
        for (name, range, value) in [
            ("k", expected.k, self.k()),
            ("speed in mm/s", expected.speed, self.speed() * 1e3),
            (
                "share of time in gear",
                expected.in_gear,
                self.in_gear().unwrap_or(f64::NAN),
            ),
            (
                "restitution identified",
                expected.restitution,
                self.identified()
                    .map_or(f64::NAN, |found| f64::from(found.restitution)),
            ),
        ] {
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
