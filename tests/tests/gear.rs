//! Target gear in closed loop: parts that scatter, by the plant's true motion.

use std::f64::consts::TAU;

use kband::arithmetic::Phase;
use kband::control::{Settings, Target};
use kband::plant::{Change, DriveModel, EnvelopeLoop, Scene};
use kband::regime::gear::GearWatch;

/// A scene of one part whose restitution scatters, as the controller is told.
fn scene(restitution: f32, scatter: f32, second_tone: f32) -> Scene {
    let settings = Settings {
        restitution_low: restitution,
        restitution_high: restitution,
        scatter,
        second_tone,
        ..Settings::default()
    };
    Scene {
        settings,
        target: Target::Gear { order: 1 },
        drive: DriveModel {
            second_gain: settings.second_gain,
            second_lag: settings.second_lag,
            ..DriveModel::default()
        },
        parts: std::iter::once(restitution).collect(),
        scatter: std::iter::once(scatter).collect(),
        ..Scene::default()
    }
}

/// The share of time in gear of the part over some cycles.
fn share(closed: &mut EnvelopeLoop, cycles: u32) -> f64 {
    let mut watch = GearWatch::build(1).unwrap();
    let (mut begun, mut now) = (None, 0.0);
    for _ in 0..cycles {
        closed.advance();
        for strike in closed.strikes() {
            let landed = strike.time as f64 / Phase::TURN * TAU;
            let flight = f64::from(strike.flight) * TAU;
            if begun.is_none() {
                begun = Some(landed);
                watch.begin(landed);
            }
            if strike.rested {
                watch.rested(landed - flight);
            }
            watch.landed(landed, flight);
            now = landed;
        }
    }
    watch.share(now).share()
}

/// R goes from 0.25 to 0.4 in ten minutes, where the best k goes from 0.42 to 0.51 and what was best at first holds nothing
/// at last. A minute's share errs by 0.03 (some 70 losses).
#[test]
fn a_lot_that_drifts_is_followed_and_stays_in_gear() {
    const MINUTES: u32 = 10;
    for (second_tone, least) in [(0.0, 0.6), (0.15, 0.95)] {
        let mut closed = EnvelopeLoop::build(&scene(0.25, 0.05, second_tone)).unwrap();
        let first = {
            share(&mut closed, 500);
            closed.controller().gear().unwrap()
        };
        let mut lowest = 1.0_f64;
        for minute in 0..MINUTES {
            let mut sum = 0.0;
            for part in 0..6_u8 {
                let passed = (minute as f32 + f32::from(part) / 6.0) / MINUTES as f32;
                closed.apply(Change::Restitution(0.25 + 0.15 * passed));
                sum += share(&mut closed, 500) / 6.0;
            }
            println!("minute {minute}: {sum:.3}");
            lowest = lowest.min(sum);
        }
        let last = closed.controller().gear().unwrap();
        println!("e {second_tone}: lowest share of a minute {lowest}, {first:?} to {last:?}");
        assert!(lowest > least, "{second_tone}: {lowest} {first:?} {last:?}");
        assert!(
            second_tone > 0.0 || last.k > first.k + 0.05,
            "{first:?} {last:?}"
        );
    }
}

/// The drive is told that it answers at twice its frequency eight times as strongly as it does.
#[test]
fn without_the_second_tone_that_was_told_the_plan_is_that_of_one() {
    let mut scene = scene(0.3, 0.05, 0.15);
    scene.drive.second_gain = scene.settings.second_gain / 8.0;
    let mut closed = EnvelopeLoop::build(&scene).unwrap();
    share(&mut closed, 1500);
    let plan = closed.controller().gear().unwrap();
    assert_eq!(plan.tones[0][0], 0.0, "{plan:?}");
    assert!(plan.settled && (0.4..0.48).contains(&plan.k), "{plan:?}");
    // Two minutes: some 140 losses, whose outages of 4.4 periods scatter as much: 0.02.
    let share = share(&mut closed, 6000);
    assert!(share > 0.74, "{share}");
}
