//! Tests of the controller against the state table, on random walks.

use super::ideal;
use crate::signal_path::DetectedImpact;
use crate::testing::with;
use crate::{Controller, Inputs, Settings, StartCause, State, TRANSITIONS, Target};
use kband::arithmetic::Phase;
use std::collections::BTreeSet;

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn one_in(&mut self, count: u64) -> bool {
        self.next().is_multiple_of(count)
    }
}

/// A controller whose plans are ready, and the phase at which its lock is detected.
fn ready(target: Target) -> (Controller, Phase) {
    let settings = Settings {
        restitution_low: 0.199,
        restitution_high: 0.201,
        capture_attempts: 1.0,
        link_timeout: 0.5,
        amplitude_limit: 0.9,
        ..Settings::default()
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
    let mut random = Random(1);
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
            if random.one_in(if inputs.enable { period } else { withdrawn }) {
                inputs.enable = !inputs.enable;
            }
            inputs.over_temperature = random.one_in(5 * period);
            inputs.stack_low = random.one_in(5 * period);
            inputs.over_current = random.one_in(20 * period);
            if random.one_in(if inputs.link_heard { 5 * period } else { 150 }) {
                inputs.link_heard = !inputs.link_heard;
            }
            if random.one_in(period) {
                let target = targets[random.next() as usize % targets.len()];
                controller.set_target(target).unwrap();
            }
            controller.plan_step();
            if random.one_in(60) {
                impact_kind = random.next() % 3;
            }
            if random.one_in(if disturbance == 0 { period } else { 8 }) {
                disturbance = random.next() % 6;
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
