//! Tests of the controller on an ideal drive: targets, searches, refusals, bad readings, states.

use super::*;
use crate::drive::absolute;
use crate::signal_path::DetectedImpact;
use crate::testing::{lot, with};
use crate::{Fault, Limits, State, TRANSITIONS, UPPER};
use kband::arithmetic::Noise;
use kband::regime::classify::Regime;
use std::collections::BTreeSet;

#[test]
fn regimes_are_detected_after_the_cycle_counter_wraps() {
    let target = Target::Locked { order: 1 };
    let mut controller = build(&Settings::default(), target);
    controller.count = u32::MAX - 150;
    let inputs = enabled();
    let mut cycle = ideal(&controller);
    let impact = DetectedImpact {
        phase: Phase::from_radians(0.445),
        strength: 5.0,
    };
    let mut run_cycles = |silent: bool| {
        cycle.impacts = (!silent).then_some(impact).into_iter().collect();
        let mut report = Report::default();
        for _ in 0..120 {
            report = controller.cycle(&cycle, &inputs);
            cycle.quadrature = -ideal_amplitude(&controller) * controller.scale.angular_squared;
        }
        (report.cycle, report.regime.map(|verdict| verdict.regime))
    };
    let locked = Some(Regime::Locked { order: 1 });
    assert_eq!(run_cycles(false), (u32::MAX - 30, locked));
    assert_eq!(run_cycles(false), (89, locked));
    assert_eq!(run_cycles(true), (209, Some(Regime::Rest)));
}

fn build(settings: &Settings, target: Target) -> Controller {
    Controller::build(settings, target, StartCause::Ordinary).unwrap()
}

fn planned(settings: &Settings, target: Target) -> Controller {
    let mut controller = build(settings, target);
    while !controller.is_setpoint_found() {
        controller.plan_step();
    }
    controller
}

/// A controller at a target with an ideal drive, and their reports.
fn driven(target: Target) -> (Controller, Report) {
    let mut controller = build(&lot(0.199, 0.201), target);
    let report = follow_for(60, &mut controller, true);
    (controller, report)
}

/// Amplitude of the next cycle of an ideal drive, in m.
fn ideal_amplitude(controller: &Controller) -> f32 {
    let [next, running, _] = controller.predicted_envelopes;
    0.5 * controller.scale.full_amplitude * absolute(next + running)
}

fn ideal(controller: &Controller) -> Cycle {
    Cycle {
        samples: 400,
        quadrature: -ideal_amplitude(controller) * controller.scale.angular_squared,
        low: 1500,
        high: 2500,
        ..Cycle::default()
    }
}

fn enabled() -> Inputs {
    with(Inputs::default(), |it| it.enable = true)
}

fn follow(controller: &mut Controller, enable: bool) -> Report {
    let inputs = with(Inputs::default(), |it| it.enable = enable);
    let report = controller.cycle(&ideal(controller), &inputs);
    controller.plan_step();
    report
}

fn follow_for(cycles: u32, controller: &mut Controller, enable: bool) -> Report {
    let reports = (0..cycles).map(|_| follow(controller, enable));
    reports.last().unwrap()
}

/// While the bridge is held open the output is 0; released, the drive starts again from rest.
#[test]
fn a_drive_that_is_held_off_stops_without_a_ramp() {
    let (mut controller, held) = driven(Target::K(0.5));
    assert!(held.command.amplitude > 0.1);
    let cycle = |controller: &mut Controller, held_off: bool| {
        let inputs = with(enabled(), |it| {
            (it.held_off, it.chatters) = (held_off, held_off)
        });
        controller.cycle(&ideal(controller), &inputs)
    };
    let first = cycle(&mut controller, true);
    let actual = (first.state, first.command.amplitude);
    assert_eq!(actual, (State::Stopping, 0.0));
    assert!((first.events.iter()).any(|event| event == Event::EnableChatters));
    let mut ended = false;
    for _ in 0..200 {
        let report = cycle(&mut controller, true);
        assert_eq!((report.fault, report.command.amplitude), (None, 0.0));
        ended |= report.state == State::Off;
    }
    assert!(ended);
    assert_eq!(cycle(&mut controller, false).state, State::Starting);
}

#[test]
fn a_stop_without_rest_ends_after_four_soft_stops() {
    let (mut controller, _) = driven(Target::K(0.5));
    let swinging = ideal(&controller);
    let stopping = (0..500)
        .map(|_| controller.cycle(&swinging, &Inputs::default()).state)
        .take_while(|state| *state == State::Stopping);
    // 4 times 0.4 s at 50 Hz.
    assert_eq!(stopping.count(), 81);
}

/// Any field of a cycle may be NaN, or too large. From that cycle on the output is off, with fault
/// 13, and the report has no NaN. After the acknowledgement the drive starts as before.
#[test]
fn nan_reading_stops_the_drive_and_is_forgotten() {
    type Corrupt = fn(&mut Cycle, f32);
    let corruptions: [Corrupt; 7] = [
        |cycle, bad| cycle.in_phase = bad,
        |cycle, bad| cycle.quadrature = bad,
        |cycle, bad| cycle.upper[1][0] = bad,
        |cycle, bad| cycle.mean = bad,
        |cycle, bad| cycle.noise = bad,
        |cycle, bad| cycle.blanked = bad,
        |cycle, bad| cycle.current = bad,
    ];
    for track_mass in [0.0, 10.0] {
        for corrupt in corruptions {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
                let settings = with(Settings::default(), |it| it.second_tone = 0.1);
                let settings = with(settings, |it| it.track_mass = track_mass);
                let mut controller = build(&settings, Target::K(0.5));
                let held = follow_for(60, &mut controller, true);
                assert!(held.command.amplitude > 0.1 && controller.is_ready());
                let mut cycle = ideal(&controller);
                corrupt(&mut cycle, bad);
                let mut report = controller.cycle(&cycle, &enabled());
                for _ in 0..10 {
                    assert_eq!(report.fault, Some(Fault::ControlLate));
                    assert_eq!(report.command.amplitude, 0.0);
                    assert_eq!(report.command.overtones, [[0.0; 2]; UPPER]);
                    assert!(report.amplitude.is_finite() && report.lead.is_finite());
                    assert!(!report.k.is_nan() && report.shape.second.ratio.is_finite());
                    report = follow(&mut controller, true);
                }
                follow_for(40, &mut controller, false);
                let report = follow_for(60, &mut controller, true);
                assert_eq!(report.fault, None);
                assert_eq!(report.amplitude, held.amplitude);
            }
        }
    }
}

/// Settings of a drive that makes 0.19 mm at most at 50 Hz.
fn weak() -> Settings {
    with(Settings::default(), |it| it.gain = 0.2)
}

#[test]
fn a_target_beyond_the_output_is_refused_and_the_old_one_kept() {
    let held = Target::Amplitude(0.18);
    let mut controller = build(&weak(), held);
    assert_eq!(controller.no_setpoint(), None);
    let shape = Shape::SINE;
    for (target, parameter) in [
        (Target::Amplitude(0.191), "target amplitude"),
        (Target::K(0.4), "target k"),
        (Target::Tones { k: 0.4, shape }, "target k"),
        (Target::Locked { order: 1 }, "target locked order"),
        (Target::Chaotic, "target chaotic, order of its lock"),
    ] {
        let refused = controller.set_target(target).unwrap_err();
        assert_eq!(refused.parameter, parameter);
        assert!(refused.accepted.contains("output_maximum"), "{refused}");
        assert_eq!(controller.target(), held);
        assert!(controller.setpoint() > 0.17e-3);
        // A controller that begins with this target moves nothing.
        let mut begun = build(&weak(), target);
        let why = begun.no_setpoint();
        assert!(matches!(why, Some(NoSetpoint::Output { .. })), "{why:?}");
        for _ in 0..200 {
            let report = begun.cycle(&Cycle::default(), &enabled());
            assert_eq!(report.command.amplitude, 0.0, "{:?}", report.state);
        }
        assert!(begun.report().limits.contains(Limits::NO_SETPOINT));
    }
    for target in [Target::Amplitude(0.189), Target::K(0.55), Target::Identify] {
        controller.set_target(target).unwrap();
        assert_eq!(controller.target(), target);
    }
    // Identification begins at 0.114 mm.
    let weaker = with(weak(), |it| it.gain = 0.11);
    let mut controller = build(&weaker, Target::Amplitude(0.0));
    assert!(controller.set_target(Target::Identify).is_err());
    // A hard limit holds the amplitude, and the limit is reported.
    let limited = with(weak(), |it| it.amplitude_limit = 0.15);
    let mut controller = build(&limited, Target::Amplitude(0.0));
    controller.set_target(Target::K(0.4)).unwrap();
    let report = follow_for(60, &mut controller, true);
    assert_eq!(report.limits, Limits::AMPLITUDE);
}

#[test]
fn off_the_resonance_the_output_reaches_less() {
    let detuned = with(Settings::default(), |it| it.resonance = 47.0);
    let at = |settings: &Settings, b| build(settings, Target::Amplitude(b)).no_setpoint();
    assert_eq!(at(&Settings::default(), 0.94), None);
    let Some(NoSetpoint::Output { needed, reach }) = at(&detuned, 0.94) else {
        panic!("0.94 mm 3 Hz beside the resonance");
    };
    // The response of a resonance of quality 25 at 50/47 of it is 0.289 of the one at resonance.
    assert!((needed - 0.94).abs() < 1e-5 && (reach / (0.95 * 0.289) - 1.0).abs() < 0.01);
    assert_eq!(at(&detuned, 0.99 * reach), None);
    assert!(at(&detuned, 1.01 * reach).is_some());
}

#[test]
fn without_an_amplitude_no_resonance_is_sought() {
    let settings = with(Settings::default(), |it| it.tracking = 2.0);
    for (amplitude, sweeps) in [(0.0, false), (0.2, true)] {
        let mut controller = build(&settings, Target::Amplitude(amplitude));
        follow_for(3, &mut controller, true);
        assert_eq!(controller.resonance.is_sweeping(), sweeps, "{amplitude}");
    }
}

#[test]
fn unreachable_speed_is_reported_after_the_search() {
    let (strong, _) = driven(Target::Speed(88.0));
    let b = strong.setpoint() * 1e3;
    assert!(b > 0.1, "{b}");
    let settings = with(Settings::default(), |it| it.gain = b);
    let mut controller = planned(&settings, Target::Speed(88.0));
    let why = controller.no_setpoint();
    assert!(matches!(why, Some(NoSetpoint::Output { .. })), "{why:?}");
    let report = controller.cycle(&Cycle::default(), &Inputs::default());
    assert!(report.events.iter().any(|event| event == Event::NoSetpoint));
}

#[test]
fn parts_a_minute_are_a_speed_over_the_length_of_a_part() {
    let undisturbed = driven(Target::Speed(180.0)).0;
    let settings = with(*undisturbed.settings(), |it| it.part_length = 12.0);
    // 900 parts of 12 mm in 60 s.
    let controller = planned(&settings, Target::PartsPerMinute(900.0));
    assert_eq!(controller.order(), undisturbed.order());
    assert_eq!(controller.setpoint(), undisturbed.setpoint());
}

#[test]
fn the_amplitude_stays_while_the_lock_for_a_speed_is_sought() {
    let (mut controller, before) = driven(Target::K(0.5));
    assert_eq!(before.state, State::Holding);
    controller.set_target(Target::Speed(180.0)).unwrap();
    for _ in 0..7 {
        let report = follow(&mut controller, true);
        assert!(!controller.is_setpoint_found());
        assert_eq!(report.state, State::Starting);
        assert_eq!(report.reference, before.reference);
        assert_eq!(report.setpoint, 0.0);
    }
    follow(&mut controller, true);
    let (other, _) = driven(Target::Speed(180.0));
    assert!(controller.is_setpoint_found() && controller.order() == Some(2));
    assert_eq!(controller.setpoint(), other.setpoint());
    assert_eq!(controller.kicks_search(), other.kicks_search());
    assert!(follow(&mut controller, true).reference > before.reference);
}

#[test]
fn a_recipe_gives_the_setpoint_of_its_own_parts() {
    let machine = with(Settings::default(), |it| {
        (it.second_tone, it.track_mass) = (0.1, 5.0)
    });
    let parts = Settings {
        restitution_low: 0.48,
        restitution_high: 0.52,
        scatter: 0.02,
        soft_start: 1.5,
        soft_stop: 0.7,
        contact: 0.4,
        ..machine
    };
    let target = Target::Gear { order: 1 };
    let planned = |mut controller: Controller| {
        while controller.plan_step() {}
        let settings = *controller.settings();
        (controller.setpoint(), settings, controller.tones)
    };
    let mut used = build(&machine, Target::K(0.5));
    used.use_recipe(&Recipe::of(target, &parts)).unwrap();
    assert_eq!(planned(used.clone()), planned(build(&parts, target)));
    assert_ne!(planned(used.clone()).0, planned(build(&machine, target)).0);
    // Back to the previous parts.
    used.use_recipe(&Recipe::of(target, &machine)).unwrap();
    assert_eq!(planned(used.clone()), planned(build(&machine, target)));
    // A refused recipe changes nothing.
    let mut far = Recipe::of(Target::Amplitude(1.01), &machine);
    let refused = used.check_recipe(&far).unwrap_err();
    assert_eq!(refused.parameter, "target amplitude");
    far.values[2] = 0.4;
    assert!(used.use_recipe(&far).is_err());
    assert_eq!(planned(used), planned(build(&machine, target)));
}

fn one_in(random: &mut Noise, count: u32) -> bool {
    random.bits().is_multiple_of(count)
}

/// A controller whose plans are ready, and the phase at which its lock is detected.
fn ready(target: Target) -> (Controller, Phase) {
    let settings = with(lot(0.199, 0.201), |it| {
        (it.capture_attempts, it.link_timeout, it.amplitude_limit) = (1.0, 0.5, 0.9);
    });
    let mut controller = build(&settings, target);
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
                actual.insert((state.name(), report.state.name()));
                state = report.state;
            }
        }
    }
    let drawn = TRANSITIONS.map(|transition| (transition.from.name(), transition.to.name()));
    let drawn = BTreeSet::from(drawn);
    assert_eq!(drawn.len(), TRANSITIONS.len());
    let differing: std::vec::Vec<_> = actual.symmetric_difference(&drawn).collect();
    assert!(differing.is_empty(), "made or in the table: {differing:?}");
}
