//! Tests of the controller against the state table, on random walks.

use super::ideal;
use crate::signal_path::DetectedImpact;
use crate::testing::{lot, with};
use crate::{Controller, Inputs, Settings, StartCause, State, TRANSITIONS, Target};
use kband::arithmetic::{Noise, Phase};
use std::collections::BTreeSet;

fn one_in(random: &mut Noise, count: u32) -> bool {
    random.bits().is_multiple_of(count)
}

/// A controller whose plans are ready, and the phase at which its lock is detected.
fn ready(target: Target) -> (Controller, Phase) {
    let settings = Settings {
        capture_attempts: 1.0,
        link_timeout: 0.5,
        amplitude_limit: 0.9,
        ..lot(0.199, 0.201)
    };
    let mut controller = Controller::build(&settings, target, StartCause::Ordinary).unwrap();
    while controller.plan_step() {}
    let phase = controller.selection.lock().unwrap().phase;
    (controller, phase)
}

#[test]
fn the_table_is_what_the_controller_does() {
    let bases = [ready(Target::Locked { order: 1 }), ready(Target::Chaotic)];
    let targets = [
        Target::K(0.5),
        Target::Amplitude(0.2),
        // Above the hard limit.
        Target::K(0.06),
        // No lock has this speed.
        Target::Speed(40.0),
    ];
    // Random walks of this seed make even the rarest change, from lost to limiting.
    let mut random = Noise::new(5);
    let mut actual = BTreeSet::new();
    for walk in 0..1500 {
        let (mut controller, phase) = bases[walk % 2].clone();
        // Walks with few disturbances reach many states; those with many visit the edges.
        let period = [400, 100, 30][walk / 2 % 3];
        let mut inputs = Inputs::default();
        let (mut impact_kind, mut disturbance) = (0, 0);
        let mut state = State::Off;
        for _ in 0..1500 {
            // Half a second, 25 cycles, acknowledges a fault.
            let withdrawn = if state == State::Fault { 80 } else { 10 };
            if one_in(&mut random, if inputs.enable { period } else { withdrawn }) {
                inputs.enable = !inputs.enable;
            }
            inputs.over_temperature = one_in(&mut random, 5 * period);
            inputs.stack_low = one_in(&mut random, 5 * period);
            inputs.over_current = one_in(&mut random, 20 * period);
            let heard = if inputs.link_heard { 5 * period } else { 150 };
            if one_in(&mut random, heard) {
                inputs.link_heard = !inputs.link_heard;
            }
            if one_in(&mut random, period) {
                let target = targets[random.bits() as usize % targets.len()];
                controller.set_target(target).unwrap();
            }
            controller.plan_step();
            if one_in(&mut random, 60) {
                impact_kind = random.bits() % 3;
            }
            if one_in(&mut random, if disturbance == 0 { period } else { 8 }) {
                disturbance = random.bits() % 6;
            }
            let mut cycle = with(ideal(&controller), |it| it.noise = 0.15);
            if impact_kind > 0 {
                let turn = if impact_kind == 1 { 0 } else { 1 << 31 };
                let _ = cycle.impacts.push(DetectedImpact {
                    phase: phase + Phase::from_bits(turn),
                    strength: 5.0,
                });
            }
            match disturbance {
                1 => cycle.high = cycle.low,
                2 => cycle.saturated = 10,
                3 => (cycle.in_phase, cycle.quadrature) = (cycle.quadrature, 0.0),
                4 => cycle.quadrature = 0.0,
                5 => cycle.quadrature *= 20.0,
                _ => {}
            }
            let report = controller.cycle(&cycle, &inputs);
            if report.state != state {
                actual.insert((state.number(), report.state.number()));
                state = report.state;
            }
        }
    }
    let drawn: BTreeSet<_> = TRANSITIONS
        .iter()
        .map(|transition| (transition.from.number(), transition.to.number()))
        .collect();
    assert_eq!(drawn.len(), TRANSITIONS.len());
    let name = |&(from, to): &(u8, u8)| {
        let name = |number: u8| State::ALL[usize::from(number)].name();
        std::format!("{} to {}", name(from), name(to))
    };
    let missing: std::vec::Vec<_> = actual.difference(&drawn).map(name).collect();
    let never: std::vec::Vec<_> = drawn.difference(&actual).map(name).collect();
    assert!(missing.is_empty(), "not in the table: {missing:?}");
    assert!(never.is_empty(), "in the table and never made: {never:?}");
}
