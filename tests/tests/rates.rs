//! The board's image at drive frequencies from 25 to 500 Hz: it holds the desk's amplitude.
//!
//! It keeps its deadlines, counted in cycles on the emulated chip.

use kband_control::wire::{Request, Response};
use kband_control::{Event, Shape, State, Target, UpperTone};
use kband_plant::{ClosedLoop, Scene};
use kband_tests::chip::kind::Kind;
use kband_tests::chip::{LINK, MILLISECOND, SAMPLE};
use kband_tests::images::feeder;
use kband_tests::rig::{Act, Rig, chip_of};

/// Cycles of the core between two samples.
const DEADLINE: u64 = 8400;
/// Cycles in which a byte comes at 115200 baud.
const BYTE: u64 = 14_583;

/// A machine of a frequency, with its resonance there and a target k.
fn machine(frequency: f32, k: f32) -> Scene {
    let mut scene = Scene::default();
    scene.settings.frequency = frequency;
    scene.settings.resonance = frequency;
    scene.drive.resonance = frequency;
    // Within the acceleration limit at any of these frequencies.
    scene.settings.safe_amplitude = 0.005;
    scene.target = Target::K(k);
    scene
}

/// Amplitude in mm of the desk.
fn desk(scene: &Scene) -> f64 {
    let mut desk = ClosedLoop::build(scene).unwrap();
    let cycles = (4.0 * scene.settings.frequency) as usize;
    let last = (0..cycles).map(|_| desk.cycle().report).last().unwrap();
    assert_eq!(last.state, State::Holding);
    f64::from(last.amplitude) * 1e3
}

/// A board with these settings and the scene's target, enabled at a time in s, after some halves of
/// a second.
fn board(scene: &Scene, told: &[(&str, f32)], enabled: f64, halves: i32) -> Rig {
    let mut rig = Rig::with(chip_of(Kind::Stm32f405, &feeder()), scene);
    rig.chip.power_on();
    rig.run(0.3);
    for &(key, value) in told {
        rig.request_done(&Request::Set { key, value });
    }
    rig.request_done(&Request::Target(scene.target));
    rig.request_done(&Request::Save);
    // The desk keeps sending: a silent one would bring the safe amplitude.
    rig.at(enabled, Act::Enable(true));
    for half in 1..=halves {
        if half == 6 {
            rig.chip.forget_handlers();
        }
        rig.run(f64::from(half) * 0.5);
        rig.request_done(&Request::Alive);
    }
    rig
}

fn holds(frequency: f32, k: f32) {
    let scene = machine(frequency, k);
    let settings = &scene.settings;
    let told = [
        ("safe_amplitude", settings.safe_amplitude),
        ("frequency", settings.frequency),
        ("resonance", settings.resonance),
    ];
    let (mut rig, desk) = (board(&scene, &told, 2.0, 12), desk(&scene));
    let held = rig.amplitude();
    let sampling = rig.chip.handler(SAMPLE);
    for (name, exception, deadline) in [
        ("the port", LINK, BYTE),
        ("the clock", MILLISECOND, 20 * DEADLINE),
    ] {
        let handler = rig.chip.handler(exception);
        assert!(handler.longest < deadline, "{name}: {handler:?}");
    }
    assert!((held / desk - 1.0).abs() < 0.02, "{held} {desk}");
    assert!(sampling.longest < DEADLINE, "{sampling:?}");
    // Samples arrived at their rate; the answer that starts the count may take 5 ms.
    assert!(sampling.count > 19_990 * 7 / 2 - 100, "{sampling:?}");
    assert_eq!(rig.resets().len(), 1);
    rig.act(&Act::Enable(false));
    rig.run(8.0);
    let missed = rig.request(&Request::SelfTest, |response| match response {
        Response::SelfTest(test) => Some((test.missed, test.set_up.sample, test.set_up.control)),
        _ => None,
    });
    let (missed, sample, control) = missed.expect("it is at rest");
    // New settings take effect at rest.
    assert!(u64::from(sample) < DEADLINE, "{sample}");
    let cycle = f64::from(DEADLINE as u32) * 20_000.0 / f64::from(frequency);
    assert!(f64::from(control) < 0.5 * cycle, "{control} of {cycle}");
    // A save takes up to 8 ms at rest, in which the control cannot run.
    let saving = (0.008 * frequency) as u32;
    assert!(missed <= saving, "{missed} cycles came late");
}

#[test]
fn the_image_holds_25_hz() {
    holds(25.0, 0.82);
}

#[test]
fn the_image_holds_100_hz() {
    holds(100.0, 0.41);
}

#[test]
fn the_image_holds_500_hz() {
    holds(500.0, 0.41);
}

/// A drive that allows a second tone and responds twice as strongly as configured.
#[test]
fn the_image_holds_a_second_tone_and_reports_wrong_settings() {
    let wanted = UpperTone::new(0.15, 2.356);
    let mut scene = machine(50.0, 0.35);
    scene.target = Target::Tones {
        k: 0.35,
        shape: Shape::of_two(wanted),
    };
    scene.settings.second_tone = 0.25;
    scene.drive.second_gain = 0.5;
    let told = [("second_tone", 0.25), ("second_gain", 0.25)];
    let mut rig = board(&scene, &told, 1.0, 16);
    let (amplitude, made) = rig.chip.board.world.bench.tones();
    let normal = f64::from(scene.settings.gravity) * 3_f64.to_radians().cos();
    let held = normal / (f64::from(amplitude) * (std::f64::consts::TAU * 50.0).powi(2));
    // As at the desk: the bridge's mean over a sample is its duty to 1/8400.
    assert!((held / 0.35 - 1.0).abs() < 0.02, "{held}");
    let made = made.second;
    assert!((made.ratio - wanted.ratio).abs() < 0.003, "{made:?}");
    assert!((made.phase - wanted.phase).abs() < 0.03, "{made:?}");
    let (unlike, events) = (Event::SecondToneUnlike.number(), rig.events());
    let mut numbers = events.iter().map(|record| record.event);
    assert!(numbers.any(|number| number == unlike), "{events:?}");
    // Without the enable input the second tone stops with the first.
    rig.act(&Act::Enable(false));
    rig.run(11.0);
    assert!(rig.amplitude() < 1e-3, "{}", rig.amplitude());
}
