//! The phase portrait of an orbit.

use std::f64::consts::{PI, TAU};

use super::Arguments;
use crate::picture::{Axis, Panel, Picture};
use crate::report::{number, when};

/// Largest number of drawn states.
const MAX_DRAWN: usize = 1 << 17;

/// Phase and velocity after each impact; of many, those after the first impacts.
#[derive(Default)]
pub(super) struct States {
    drawn: Vec<(f64, f64)>,
    impacts: u64,
}

impl States {
    pub fn add(&mut self, state: (f64, f64)) {
        if self.drawn.len() < MAX_DRAWN {
            self.drawn.push(state);
        }
        self.impacts += 1;
    }
}

/// Phase portrait: the state after each impact, with phases within -pi..pi.
pub(super) fn portrait(arguments: &Arguments, drive_text: &str, states: States) -> Picture {
    let States {
        drawn: mut states,
        impacts,
    } = states;
    for (phase, _) in &mut states {
        if *phase > PI {
            *phase -= TAU;
        }
    }
    let phases = states.iter().map(|state| state.0);
    let velocities = states.iter().map(|state| state.1);
    let phase = "phase t of the drive after the impact";
    let panel = Panel::new(
        Axis::over_values(phase, "rad", phases).in_pi(),
        Axis::over_values("velocity ψ after the impact", "b·ω", velocities),
    )
    .height(460.0);
    let contact = arguments.contact.describe();
    let map = match arguments.restitution {
        Some(r) => format!("{drive_text}, R = {}{contact}; ", number(r, 6)),
        None => String::new(),
    };
    let all_drawn = impacts == states.len() as u64;
    let drawn = when(!all_drawn, || format!(", the first {} drawn", states.len()));
    Picture::new("Phase portrait")
        .caption(format!("{map}{impacts} impacts{drawn}"))
        .panel(panel.markers("impacts", 0, states))
}
