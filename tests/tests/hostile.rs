//! No sample, input, setting or target makes the controller panic or exceed the drive's limits.
//!
//! Fixed seeds, with overflow checks.

use kband_control::{
    AdcCode, Controller, PLAN_SLICES, Report, Settings, Signal, StartCause, State, Target,
};
use kband_plant::{Bench, Scene};
use kband_tests::states::Random;

/// A whole number below `count`.
fn below(random: &mut Random, count: u64) -> usize {
    (random.bits() % count) as usize
}

/// A number that often breaks code, or one of the range.
fn number(random: &mut Random, low: f32, high: f32) -> f32 {
    match below(random, 12) {
        0 => low,
        1 => high,
        2 => [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            -0.0,
            f32::MIN_POSITIVE,
            f32::MAX,
        ][below(random, 6)],
        3 => f32::from_bits(below(random, 1 << 32) as u32),
        4 | 5 => low + (high - low) * random.between(0.0, 1.0).powi(4) as f32,
        _ => low + (high - low) * random.between(0.0, 1.0) as f32,
    }
}

/// Settings with random values; refused ones keep their old value.
fn settings(random: &mut Random) -> Settings {
    let mut settings = Settings::default();
    for key in Settings::KEYS {
        if below(random, 6) == 0 {
            let value = number(random, key.low, key.high);
            // A refused value is part of the test.
            let _ = settings.set(key.name, value);
        }
    }
    settings
}

fn target(random: &mut Random) -> Target {
    match below(random, 6) {
        5 => Target::Gear {
            order: below(random, 12) as u8,
        },
        0 => Target::Locked {
            order: below(random, 12) as u8,
        },
        1 => Target::Chaotic,
        2 => Target::K(number(random, 0.02, 2.0)),
        3 => Target::Amplitude(number(random, 0.0, 1.0)),
        _ => Target::Speed(number(random, -300.0, 300.0)),
    }
}

/// Disturbance between the converter and the controller.
#[derive(Clone, Copy)]
enum Between {
    Nothing,
    Anything,
    Spikes,
    Ends,
    Held(u16),
}

impl Between {
    fn draw(random: &mut Random) -> Self {
        match below(random, 8) {
            0 => Self::Anything,
            1 => Self::Ends,
            2 => Self::Held(random.bits() as u16),
            3 | 4 => Self::Spikes,
            _ => Self::Nothing,
        }
    }

    fn pass(self, random: &mut Random, code: AdcCode) -> AdcCode {
        let anything = random.bits() as u16;
        match self {
            Self::Nothing => code,
            Self::Anything => AdcCode(anything),
            Self::Spikes if anything < 300 => AdcCode(random.bits() as u16),
            Self::Spikes => code,
            Self::Ends => AdcCode([0, 4095, u16::MAX][usize::from(anything) % 3]),
            Self::Held(held) => AdcCode(held),
        }
    }
}

/// Limits of every report, whatever the inputs.
fn check(report: &Report, settings: &Settings) {
    let command = report.command;
    assert!(
        (0.0..=settings.output_maximum).contains(&command.amplitude),
        "{report:?}"
    );
    assert!(command.step > 0, "{report:?}");
    if matches!(report.state, State::Off | State::Fault) {
        assert!(command.amplitude == 0.0 && command.immediate, "{report:?}");
    }
    assert_eq!(
        report.state == State::Fault,
        report.fault.is_some(),
        "{report:?}"
    );
    for value in [
        report.amplitude,
        report.lead,
        report.reference,
        report.setpoint,
        report.rate,
    ] {
        assert!(value.is_finite(), "{report:?}");
    }
    for value in [
        report.phase,
        report.concentration,
        report.confidence,
        report.frequency,
    ] {
        assert!(value.is_finite(), "{report:?}");
    }
    assert!(!report.k.is_nan(), "{report:?}");
}

#[test]
fn no_sample_setting_input_or_target_makes_the_controller_panic() {
    let mut random = Random::new(1);
    let (mut refused, mut samples) = (0, 0_u32);
    let mut cycles = [0_u32; State::ALL.len()];
    for round in 0..900 {
        // In every third round the start is normal, so that the controller gets far.
        let tame = round % 3 == 0;
        let mut scene = Scene::default();
        if !tame {
            scene.settings = settings(&mut random);
            scene.target = target(&mut random);
            scene.start = [StartCause::Ordinary, StartCause::Reset, StartCause::Refused]
                [below(&mut random, 3)];
        }
        let (Ok(mut signal), Ok(mut controller), Ok(mut bench)) = (
            Signal::build(&scene.settings),
            Controller::build(&scene.settings, scene.target, scene.start),
            Bench::build(&scene),
        ) else {
            refused += 1;
            continue;
        };
        let mut inputs = bench.inputs();
        let mut between = Between::Nothing;
        let mut fault = false;
        let often = if tame { 300 } else { 30 };
        for _ in 0..if tame { 80_000 } else { 8_000 } {
            samples += 1;
            let code = between.pass(&mut random, bench.sample());
            let before = signal.phase();
            let sampled = signal.sample(code);
            assert!((-1.0..=1.0).contains(&sampled.output), "{sampled:?}");
            bench.hold(sampled.output, (signal.phase() - before).bits());
            if !sampled.wrapped {
                continue;
            }
            bench.forget_strikes();
            if below(&mut random, often) == 0 {
                // A target out of range is refused.
                let _ = controller.set_target(target(&mut random));
            }
            let patience = if matches!(between, Between::Nothing) {
                often
            } else {
                5
            };
            if below(&mut random, patience) == 0 {
                between = Between::draw(&mut random);
            }
            // Half a second without enable acknowledges a fault.
            let patience = match (inputs.enable, fault) {
                (true, _) => often,
                (false, true) => 100,
                (false, false) => 3,
            };
            inputs.enable ^= below(&mut random, patience) == 0;
            inputs.over_temperature = below(&mut random, 1000) == 0;
            inputs.stack_low = below(&mut random, 1000) == 0;
            inputs.link_heard = below(&mut random, 3) == 0;
            let report = controller.cycle(signal.cycle(), &inputs);
            check(&report, &scene.settings);
            fault = report.fault.is_some();
            cycles[usize::from(report.state.number())] += 1;
            signal.command(report.command);
            for _ in 0..PLAN_SLICES {
                if !controller.plan_step() {
                    break;
                }
            }
        }
    }
    println!("{samples} samples, {refused} rounds refused, cycles in each state: {cycles:?}");
    assert!(refused < 500, "{refused}");
    // Faults, stops and starts at least: the other states depend on the parts.
    let often = [
        State::Off,
        State::Starting,
        State::Holding,
        State::Fault,
        State::Stopping,
    ];
    assert!(
        often
            .iter()
            .all(|&state| cycles[usize::from(state.number())] > 200),
        "{cycles:?}"
    );
}
