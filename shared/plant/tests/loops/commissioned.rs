//! Tests of a commissioned sensor: at rest, by a small swing at each start, and in the run.

use super::fidelity::changes;
use kband_control::{Fault, State, Target};
use kband_plant::{Change, ClosedLoop, EnvelopeLoop, Scene};

/// A commissioned machine whose sensor measures the share `mean` of 1 g at rest.
fn commissioned(mean: f32) -> Scene {
    let mut scene = Scene {
        target: Target::Amplitude(0.5),
        ..Scene::default()
    };
    scene.parts.clear();
    scene.settings.sensor_rest = 1.65 + 0.1 * mean;
    scene.settings.gain_tolerance = 1.3;
    scene.settings.load_tolerance = 1.3;
    scene
}

/// A scene's fault within a time in s, largest amplitude over the hard limit, time of the fault.
fn run(scene: &Scene, seconds: f64) -> (Option<Fault>, f64, f64) {
    let mut closed = EnvelopeLoop::build(scene).unwrap();
    let limit = f64::from(scene.settings.amplitude_limit) * 1e-3;
    let mut largest = 0.0_f64;
    loop {
        let moment = closed.cycle();
        largest = largest.max(closed.amplitude() / limit);
        if moment.report.fault.is_some() || moment.time > seconds {
            return (moment.report.fault, largest, moment.time);
        }
    }
}

#[test]
fn a_deviating_mean_at_rest_starts_nothing() {
    for (mean, sensitivity, refused) in [
        (1.0, 0.7, true),
        (1.0, 0.8, false),
        (-1.0, 1.3, true),
        (0.5, 0.45, true),
    ] {
        let mut scene = commissioned(mean);
        (scene.settings.gain_tolerance, scene.settings.load_tolerance) = (2.5, 2.5);
        scene.sensor.sensitivity = sensitivity;
        let (fault, largest, _) = run(&scene, 0.5);
        let expected = refused.then_some(Fault::SensorImplausible);
        assert_eq!(fault, expected, "{mean} {sensitivity}");
        assert_eq!(largest == 0.0, refused);
    }
    // An inverted sensor measures gravity with the other sign.
    let mut scene = commissioned(1.0);
    scene.disturbances = changes([(0.0, Change::SensorInverted(true))]);
    let (fault, largest, _) = run(&scene, 0.5);
    assert_eq!((fault, largest), (Some(Fault::SensorImplausible), 0.0));
}

#[test]
fn a_loss_just_before_the_enable_input_starts_nothing() {
    for at in [1.0, 1.93, 1.99] {
        let mut scene = commissioned(1.0);
        scene.disturbances = changes([
            (0.0, Change::Enable(false)),
            (at, Change::Sensitivity(0.55)),
            (2.0, Change::Enable(true)),
        ]);
        let (fault, largest, time) = run(&scene, 3.0);
        assert_eq!((fault, largest), (Some(Fault::SensorImplausible), 0.0));
        assert!((2.08..2.15).contains(&time), "{at}: {time}");
    }
}

#[test]
fn a_fading_mean_is_a_fault_at_any_gain() {
    for gain in [1.0, 2.0] {
        let mut scene = commissioned(1.0);
        (scene.settings.gain_tolerance, scene.settings.load_tolerance) = (2.5, 2.5);
        scene.drive.gain = gain;
        scene.disturbances = changes(core::array::from_fn::<_, 30, _>(|n| {
            let factor = 1.0 - 0.02 * n as f32;
            (2.0 + 0.5 * n as f64, Change::Sensitivity(factor))
        }));
        let (fault, largest, time) = run(&scene, 17.0);
        assert_eq!(fault, Some(Fault::SensorImplausible));
        assert!(largest < 0.5 / 0.68, "{gain}: {largest}");
        // After 8.5 s a quarter is lost.
        assert!((8.4..10.1).contains(&time), "{gain}: {time}");
    }
}

#[test]
fn the_test_swing_is_no_reference_for_a_loaded_track() {
    // Load changes the ratio of measured to predicted amplitude by 1.25 / 0.87, more than the
    // tolerance of 1.3. The change is just after the swing, or half a second later.
    for (at, fault) in [(0.65, None), (1.1, Some(Fault::SensorImplausible))] {
        let factors = [(0.0, 1.25), (at, 0.87)];
        let scene = Scene {
            disturbances: changes(factors.map(|(at, factor)| (at, Change::Sensitivity(factor)))),
            ..commissioned(0.0)
        };
        assert_eq!(run(&scene, 8.0).0, fault, "{at} s");
    }
}

/// As [`commissioned`], without gravity on the sensor's axis, with a current sensor.
fn with_current_sensor() -> Scene {
    let mut scene = commissioned(0.0);
    scene.settings.current_sensitivity = 0.3;
    scene.settings.current_gain = 0.5;
    scene
}

/// Fault within a time in s and largest amplitude over the limit, in waveform and envelope.
fn run_both(scene: &Scene, seconds: f64) -> [(Option<Fault>, f64); 2] {
    let mut closed = ClosedLoop::build(scene).unwrap();
    let limit = f64::from(scene.settings.amplitude_limit) * 1e-3;
    let mut largest = 0.0_f32;
    let fault = (0..(seconds * 50.0) as usize).find_map(|_| {
        let moment = closed.trace_cycle(|sample| largest = largest.max(sample.displacement.abs()));
        moment.report.fault
    });
    let (envelope, worst, _) = run(scene, seconds);
    [(fault, f64::from(largest) / limit), (envelope, worst)]
}

/// The sensor's fault within a time in s, at an amplitude over the hard limit below `limit`.
fn finds_the_loss(scene: &Scene, seconds: f64, limit: f64) {
    for (fault, largest) in run_both(scene, seconds) {
        assert_eq!(fault, Some(Fault::SensorImplausible), "{scene:?}");
        assert!(largest < limit, "{largest} of {limit}: {scene:?}");
    }
}

#[test]
fn the_current_shows_a_lost_sensitivity_at_any_gain() {
    for gain in [1.0, 1.4, 2.0] {
        let mut scene = with_current_sensor();
        scene.sensor.sensitivity = 0.55;
        scene.drive.gain = gain;
        finds_the_loss(&scene, 1.0, 0.05 * 1.3 * f64::from(gain) * 1.02);
        // During the run, gain and sensitivity change simultaneously.
        let mut scene = with_current_sensor();
        scene.disturbances =
            changes([Change::Gain(gain), Change::Sensitivity(0.55)].map(|change| (2.0, change)));
        // The output is held meanwhile.
        finds_the_loss(&scene, 4.0, 0.5 * f64::from(gain) * 1.02);
    }
}

#[test]
fn the_current_bounds_the_amplitude_at_the_hard_limit() {
    let mut scene = with_current_sensor();
    scene.target = Target::Amplitude(1.0);
    (scene.settings.gain, scene.settings.current_gain) = (5.0, 2.5);
    (scene.drive.gain, scene.drive.current_gain) = (5.0, 2.5);
    scene.disturbances =
        changes([Change::Gain(2.0), Change::Sensitivity(0.55)].map(|change| (2.0, change)));
    // 1.15 times the tolerance of 1.3, plus the growth in two cycles of dead time.
    finds_the_loss(&scene, 4.0, 1.7);
}

#[test]
fn a_supply_or_coil_that_changes_is_no_fault_of_the_current() {
    for (resonance, gain) in [(50.0, 0.6), (50.0, 1.7), (48.5, 1.7), (51.5, 0.6)] {
        let mut scene = with_current_sensor();
        scene.target = Target::Amplitude(0.2);
        (scene.settings.gain_tolerance, scene.settings.load_tolerance) = (2.5, 2.5);
        (scene.settings.resonance, scene.drive.resonance) = (resonance, resonance);
        scene.disturbances = changes([(2.0, Change::Gain(gain))]);
        for (fault, _) in run_both(&scene, 5.0) {
            assert_eq!(fault, None, "{resonance} {gain}");
        }
        // The swing's tolerance leaves 1.3 for the current.
        scene.disturbances.clear();
        (scene.settings.gain_tolerance, scene.settings.load_tolerance) = (1.3, 1.3);
        for (fault, _) in run_both(&scene, 3.0) {
            assert_eq!(fault, None, "{resonance}");
        }
    }
}

#[test]
fn a_current_sensor_that_fails_is_a_fault() {
    for factor in [0.5, 2.0] {
        let mut scene = with_current_sensor();
        scene.drive.current_gain *= factor;
        finds_the_loss(&scene, 1.0, 0.07);
    }
}

#[test]
fn each_start_makes_a_test_swing() {
    let mut scene = commissioned(0.0);
    scene.disturbances = changes([
        (2.0, Change::Enable(false)),
        (3.5, Change::Sensitivity(0.55)),
        (4.0, Change::Enable(true)),
    ]);
    let mut closed = EnvelopeLoop::build(&scene).unwrap();
    let mut largest = [0.0_f64; 2];
    for _ in 0..250 {
        let moment = closed.cycle();
        let second = usize::from(moment.time > 4.0);
        largest[second] = largest[second].max(closed.amplitude());
    }
    let fault = closed.controller().report().fault;
    assert_eq!(fault, Some(Fault::SensorImplausible));
    assert!(largest[0] > 0.49e-3 && largest[1] < 0.07e-3, "{largest:?}");
}

#[test]
fn the_reference_waits_at_the_swing_and_ready_stays_off() {
    let scene = commissioned(1.0);
    let mut closed = ClosedLoop::build(&scene).unwrap();
    let mut waited = 0;
    let mut first_ready = None;
    for n in 0..200 {
        let report = closed.cycle().report;
        assert_eq!(report.fault, None);
        let ready = closed.controller().is_ready();
        // The default limit is 1 mm.
        if report.reference > 0.0 && report.reference <= 0.051e-3 {
            waited += 1;
            assert_eq!(report.state, State::Starting);
            assert!(!ready);
        }
        first_ready = first_ready.or(ready.then_some(n));
    }
    // 2 x 8 cycles of the envelope, 3 of dead time, 8 of averaging.
    assert!((27..=30).contains(&waited), "{waited}");
    assert!(first_ready.is_some_and(|n| n < 70), "{first_ready:?}");
}
