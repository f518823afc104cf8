//! Sensor failures on the flashed image: none may raise the amplitude of the track, and each ends
//! with the bridge open and its fault.

use kband_control::{Fault, Target};
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Event;
use kband_machines::draw::{ceiling, square};
use kband_machines::hazards::{
    ENABLE_TIME, Hazard, REST_TIME, measure_current, plant, play, sensitivity_hazard,
};
use kband_machines::on_both;
use kband_machines::rig::Act;
use kband_plant::{Change, Scene};

/// The failure: event, frequency in Hz, quality, setpoint over the hard limit. The result: number
/// of the fault, latest time in s at which the bridge opens, largest displacement of the track over
/// the limit.
///
/// Detection takes 3 cycles for a dead reading and 8 for one with noise alone. It takes 15 without
/// a response, 5 for a wrong sign, and 50 for an implausible amplitude.
type Row = (&'static str, f32, f32, f32, u8, f64, f64);

const ROWS: [Row; 13] = [
    ("lost", 5.0, 5.0, 0.5, 1, 0.9, 0.6),
    ("lost", 500.0, 200.0, 0.9, 1, 0.009, 1.25),
    ("noise alone", 50.0, 200.0, 0.9, 4, 0.4, 1.25),
    ("noise alone", 500.0, 25.0, 0.034, 1, 0.025, 0.1),
    ("supply fails", 50.0, 200.0, 0.9, 1, 0.09, 1.25),
    ("cable bounces", 50.0, 200.0, 0.9, 1, 0.3, 1.25),
    ("turned", 50.0, 25.0, 0.25, 3, 0.11, 0.6),
    ("turned", 500.0, 200.0, 0.9, 3, 0.013, 1.25),
    ("loses three quarters", 5.0, 5.0, 0.5, 12, 10.5, 0.6),
    ("loses three quarters", 50.0, 200.0, 0.9, 12, 1.1, 1.25),
    ("loses three quarters", 500.0, 25.0, 0.034, 12, 0.11, 0.1),
    ("supply halves", 50.0, 25.0, 0.25, 12, 1.1, 0.6),
    ("fades", 50.0, 200.0, 0.9, 12, 1.8, 1.25),
];

fn changes(event: &str, from: f64, noise: f32) -> Vec<(f64, Act)> {
    let now = |change| plant(from, change);
    let every = |pace: f64, n: i32| from + pace * f64::from(n);
    match event {
        "lost" => vec![now(Change::SensorLost(true))],
        "noise alone" => {
            // The noise of the reading is constant.
            let share = 0.01;
            let noise = Change::Noise(noise / share);
            vec![now(noise), now(Change::Sensitivity(share))]
        }
        "loses three quarters" => vec![now(Change::Sensitivity(0.25))],
        "fades" => (0..=16)
            .map(|n| plant(every(0.06, n), Change::Sensitivity(1.0 - 0.05 * n as f32)))
            .collect(),
        "turned" => vec![now(Change::SensorInverted(true))],
        "cable bounces" => (0..20)
            .flat_map(|n| {
                let lost = every(0.065, n);
                let returned = plant(lost + 0.05, Change::SensorLost(false));
                [plant(lost, Change::SensorLost(true)), returned]
            })
            .collect(),
        "supply halves" => vec![(from, Act::SensorSupply(0.5))],
        "supply fails" => vec![(from, Act::SensorSupply(0.0))],
        other => panic!("no event {other}"),
    }
}

/// A drive with much more gain than its limit needs, at its setpoint before the event.
fn failing(&(event, frequency, quality, share, ..): &Row) -> Hazard {
    let mut hazard = Hazard::new(event, frequency, Target::K(0.0));
    let scene = &mut hazard.scene;
    let settings = &mut scene.settings;
    settings.gain = if frequency > 400.0 { 1.0 } else { 5.0 };
    settings.quality = quality;
    settings.link_timeout = 0.0;
    let limit = 1e3 * ceiling(settings);
    settings.safe_amplitude = 0.05_f32.min(0.5 * limit);
    // The converter's range is 1.7 times the measured signal at the limit.
    settings.sensitivity = 1.65 * 9.8 / (1.7e-3 * limit * square(settings));
    scene.sensor.noise = 1.5 * 3.3 / 4096.0 / settings.sensitivity * 9.8;
    scene.drive.gain = settings.gain;
    scene.drive.quality = quality;
    let noise = scene.sensor.noise;
    hazard.target = Target::Amplitude(share * limit);
    let from = ENABLE_TIME + 1.4 + 20.0 / f64::from(frequency);
    hazard.acts(changes(event, from, noise))
}

fn no_sensor_raises_the_amplitude(kind: Kind) {
    for row in &ROWS {
        let &(_, _, _, share, fault, latest, upper_limit) = row;
        let hazard = failing(row);
        let limit = 1e3 * f64::from(ceiling(&hazard.scene.settings));
        let mut rig = hazard.before(kind);
        let before = rig.amplitude() / limit;
        rig.peak();
        for (time, act) in hazard.acts {
            rig.at(time, act);
        }
        while rig.time() < hazard.from + latest && rig.chip.is_driven() {
            rig.run_for(0.02);
        }
        rig.run_for(0.05);
        let (largest, opens) = (rig.peak() / limit, rig.opening_after(hazard.from));
        assert!(before > 0.8 * f64::from(share), "{row:?}: {before}");
        assert!(largest <= upper_limit, "{row:?}: {largest}");
        let in_time = opens.is_some_and(|time| time < latest);
        assert!(in_time, "{row:?}: {opens:?}");
        assert_eq!(rig.stored_fault(0), Some(fault), "{row:?}");
        assert_eq!(rig.resets().len(), 1, "{row:?}");
    }
}

/// A loss of 45 % of the sensitivity, or of the sensor's supply: at rest, in the test swing and in
/// the run. It is not detected without commissioning.
fn a_commissioned_sensor_that_loses_45_percent_is_found(kind: Kind) {
    let lost = |at: f64| plant(at, Change::Sensitivity(0.55));
    let supply = (REST_TIME, Act::SensorSupply(0.55));
    for (name, share, act, upper_limit, latest) in [
        ("at rest, 1 g seen", 1.0, lost(REST_TIME), 0.0, 0.25),
        ("supply at rest, nothing seen", 0.0, supply, 0.0, 0.25),
        ("swing, nothing seen", 0.0, lost(REST_TIME), 0.12, 1.0),
        ("in the run, 1 g seen", 1.0, lost(2.5), 0.52, 1.2),
        ("in the run, nothing seen", 0.0, lost(2.5), 0.52, 1.2),
    ] {
        let mut outcome = play(kind, &sensitivity_hazard(name, share).acts([act]));
        let (largest, fault) = (outcome.largest, outcome.fault);
        assert!(largest <= upper_limit, "{name}: {largest}");
        assert!(fault.is_some_and(|time| time < latest), "{name}: {fault:?}");
        assert!(outcome.after < 0.1, "{name}: {}", outcome.after);
        let stored = outcome.rig.stored_fault(0);
        assert_eq!(stored, Some(Fault::SensorImplausible.number()), "{name}");
    }
    let hazard = Hazard::new("not commissioned", 50.0, Target::Amplitude(0.5));
    let outcome = play(kind, &hazard.acts([lost(2.5)]));
    assert!((0.90..0.93).contains(&outcome.after), "{}", outcome.after);
    assert_eq!((outcome.fault, outcome.opens), (None, None));
    let dark = outcome.rig.find_time(3.5, &Event::Ready(false));
    assert!(outcome.ready.is_some() && dark.is_none());
}

fn a_healthy_sensor_that_drifts_is_no_fault(kind: Kind) {
    for (sensitivity, volts, current) in [(0.95, -0.02, true), (1.05, 0.02, false)] {
        let drift = |time: f64, share: f32| {
            [
                plant(time, Change::Sensitivity(1.0 + share * (sensitivity - 1.0))),
                (time, Act::SensorOffset(share * volts)),
            ]
        };
        let acts = [drift(REST_TIME, 0.7), drift(2.5, 1.0)];
        let mut hazard = sensitivity_hazard("a healthy sensor drifts", 1.0)
            .with(|scene| scene.parts = Scene::default().parts)
            .acts(acts.into_iter().flatten())
            .end(4.5);
        if current {
            hazard = hazard.with(measure_current);
        }
        let outcome = play(kind, &hazard);
        assert_eq!(outcome.fault, None, "{sensitivity} {volts}");
        assert!(outcome.ready.is_some(), "{sensitivity} {volts}");
        let share = outcome.after * f64::from(sensitivity);
        assert!((share / 0.5 - 1.0).abs() < 0.02, "{sensitivity}: {share}");
    }
}

on_both! {
    no_sensor_raises_the_amplitude,
    a_commissioned_sensor_that_loses_45_percent_is_found,
    a_healthy_sensor_that_drifts_is_no_fault,
}
