//! The board's image at drive frequencies from 25 to 500 Hz: it holds the same amplitude as the
//! desk.
//!
//! It meets its deadlines, counted in cycles on the emulated chip.

use kband_control::{Event, Shape, State, Target, UpperTone};
use kband_plant::Scene;
use kband_tests::chip::kind::Kind;
use kband_tests::chip::{DEADLINE, SAMPLE};
use kband_tests::desk_amplitude;
use kband_tests::hazards::Hazard;
use kband_tests::rig::{Act, Rig};

/// A machine with this frequency as its resonance, and a target k.
fn machine(frequency: f32, k: f32) -> Scene {
    let mut scene = Scene::default();
    (scene.settings.frequency, scene.settings.resonance) = (frequency, frequency);
    scene.drive.resonance = frequency;
    // Within the acceleration limit at each of these frequencies.
    scene.settings.safe_amplitude = 0.005;
    scene.target = Target::K(k);
    scene
}

/// A board with this scene, enabled at 2 s, at `until` s. The desk keeps sending, because a silent
/// link would select the safe amplitude. The handlers' times are from 3 s on.
fn board(scene: &Scene, until: f64) -> Rig {
    let mut hazard = Hazard::new("rates", scene.settings.frequency, scene.target);
    hazard.scene = scene.clone();
    let mut rig = hazard.commissioned(Kind::Stm32f405);
    rig.keep_link_alive(rig.time(), until);
    rig.at(2.0, Act::Enable(true)).run(3.0);
    rig.chip.forget_handlers();
    rig.run(until);
    rig
}

fn check_gear(frequency: f32, k: f32) {
    let scene = machine(frequency, k);
    let mut rig = board(&scene, 6.0);
    let desk = desk_amplitude(&scene, (4.0 * frequency) as usize, State::Holding);
    let held = rig.amplitude();
    let sampling = rig.chip.handler(SAMPLE);
    assert!((held / desk - 1.0).abs() < 0.02, "{held} {desk}");
    assert!(sampling.longest < DEADLINE, "{sampling:?}");
    assert!(sampling.count > 19_990 * 3 - 100, "{sampling:?}");
    assert_eq!(rig.resets().len(), 1);
    rig.act(&Act::Enable(false));
    rig.run_for(2.0);
    let test = rig.self_test();
    let (missed, sample, control) = (test.missed, test.set_up.sample, test.set_up.control);
    // New settings take effect at rest.
    assert!(u64::from(sample) < DEADLINE, "{sample}");
    let cycle = f64::from(DEADLINE as u32) * 20_000.0 / f64::from(frequency);
    assert!(f64::from(control) < 0.5 * cycle, "{control} of {cycle}");
    // A save at rest takes up to 8 ms, during which the control cannot run.
    let saving = (0.008 * frequency) as u32;
    assert!(missed <= saving, "{missed} cycles came late");
}

#[test]
fn the_image_holds_25_to_500_hz() {
    check_gear(25.0, 0.82);
    check_gear(100.0, 0.41);
    check_gear(500.0, 0.41);
}

/// A drive that allows a second tone and responds to it twice as strongly as configured.
#[test]
fn the_image_holds_a_second_tone_and_reports_wrong_settings() {
    let expected = UpperTone::new(0.15, 2.356);
    let mut scene = machine(50.0, 0.35);
    scene.target = Target::Tones {
        k: 0.35,
        shape: Shape::of_two(expected),
    };
    scene.settings.second_tone = 0.25;
    scene.settings.second_gain = 0.25;
    scene.drive.second_gain = 0.5;
    let mut rig = board(&scene, 9.0);
    let (amplitude, made) = rig.chip.board.world.bench.tones();
    let normal = f64::from(scene.settings.gravity) * 3_f64.to_radians().cos();
    let held = normal / (f64::from(amplitude) * (std::f64::consts::TAU * 50.0).powi(2));
    // As at the desk: the mean bridge voltage in a sample is its duty to 1/8400.
    assert!((held / 0.35 - 1.0).abs() < 0.02, "{held}");
    let made = made.second;
    assert!((made.ratio - expected.ratio).abs() < 0.003, "{made:?}");
    assert!((made.phase - expected.phase).abs() < 0.03, "{made:?}");
    let (unlike, events) = (Event::SecondToneUnlike.number(), rig.events());
    let mut numbers = events.iter().map(|record| record.event);
    assert!(numbers.any(|number| number == unlike), "{events:?}");
    // Without the enable input the second tone stops with the first.
    rig.act(&Act::Enable(false));
    rig.run_for(3.0);
    assert!(rig.amplitude() < 1e-3, "{}", rig.amplitude());
}
