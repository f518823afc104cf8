//! Lost link, missing setpoint, sweep and settings on the flashed image: none raises the amplitude
//! beyond its limit.

use kband_control::Target;
use kband_control::wire::{Request, Response};
use kband_machines::chip::kind::Kind;
use kband_machines::hazards::{Hazard, play};
use kband_machines::on_both;
use kband_machines::rig::Act;

/// The amplitude becomes the smallest of safe amplitude, setpoint and reference.
fn a_lost_link_never_raises_the_amplitude(kind: Kind) {
    const LAST_FRAME_TIME: f64 = 2.3;
    for (frequency, target, safe) in [
        (50.0, Target::Amplitude(0.0), 0.05),
        (120.0, Target::K(0.41), 0.05),
        // The largest amplitude accepted here.
        (300.0, Target::K(0.41), 0.033),
    ] {
        let mut hazard = Hazard::new("link lost", frequency, target);
        hazard.from = LAST_FRAME_TIME;
        hazard.scene.settings.link_timeout = 0.8;
        hazard.scene.settings.safe_amplitude = safe as f32;
        let mut rig = hazard.before(kind);
        let before = rig.amplitude();
        rig.peak();
        rig.run(LAST_FRAME_TIME + 2.3);
        let (after, peak) = (rig.amplitude(), rig.peak());
        assert!(peak <= 1.02 * before + 1e-5, "{frequency} Hz: {peak}");
        let lower_limit = before.min(safe);
        let error = (after - lower_limit).abs();
        assert!(error <= 0.02 * lower_limit + 1e-4, "{after}");
        assert_eq!(rig.opening_after(LAST_FRAME_TIME), None, "{frequency} Hz");
    }
}

/// Without a setpoint the track rests. A resonance sweep of a strong drive, also over the widest
/// range, stays within safe amplitude and target, without a fault.
fn neither_a_missing_setpoint_nor_a_sweep_raises_the_amplitude(kind: Kind) {
    let none = Hazard::new("no setpoint", 50.0, Target::Speed(900.0));
    let strong = Hazard::new("sweep of a strong drive", 50.0, Target::Amplitude(0.242));
    let sweep = strong.with(|scene| {
        scene.settings.gain = 5.0;
        scene.drive.gain = 5.0;
        scene.settings.amplitude_limit = 0.25;
        scene.settings.tracking = 2.0;
    });
    let wide = Hazard::new("32 Hz of 200", 200.0, Target::K(0.41)).with(|scene| {
        scene.settings.tracking = 32.0;
        scene.settings.safe_amplitude = 0.005;
    });
    for (mut hazard, until, upper_limit) in
        [(none, 4.3, 0.0), (sweep, 6.0, 0.055), (wide, 6.0, 0.016)]
    {
        let name = hazard.name;
        (hazard.from, hazard.until) = (1.2, until);
        let outcome = play(kind, &hazard);
        let largest = outcome.largest;
        assert!(largest <= upper_limit, "{name}: {largest}");
        assert_eq!((outcome.fault, outcome.opens), (None, None), "{name}");
    }
}

/// A strong drive whose sensor has 0.6 of its sensitivity, with each setting at its largest
/// accepted value. The amplitude must follow target and safe amplitude, even without the link.
fn no_setting_overrides_a_limit(kind: Kind) {
    // Excluded settings describe the machine, are the limits, or would lengthen the test. A current
    // sensor that is configured but not wired causes fault 12.
    const EXCLUDED_KEYS: &str = " current_sensitivity current_gain frequency bus resonance quality gain \
        amplitude_limit acceleration_limit safe_amplitude soft_start soft_stop sensitivity \
        sensor_zero converter_reference link_timeout tracking ";
    let hazard = Hazard::new("settings", 50.0, Target::Amplitude(0.2)).with(|scene| {
        scene.settings.gain = 5.0;
        scene.drive.gain = 5.0;
        scene.settings.link_timeout = 0.8;
        scene.sensor.sensitivity = 0.6;
    });
    let mut rig = hazard.commissioned(kind);
    let mut accepted = 0;
    for number in 0..u8::MAX {
        let setting = rig.request(&Request::Setting(number), |response| match response {
            Response::Setting(setting) => Some((setting.key.to_string(), setting.high)),
            _ => None,
        });
        let Some((key, value)) = setting else {
            break;
        };
        if !EXCLUDED_KEYS.contains(&format!(" {key} ")) {
            let set = Request::Set { key: &key, value };
            accepted += u32::from(rig.request(&set, |response| response == Response::Done));
        }
    }
    assert!(accepted > 10, "{accepted} settings taken");
    let enabled = rig.time();
    rig.keep_link_alive(enabled, enabled + 2.0);
    rig.at(enabled + 0.05, Act::Enable(true)).run(enabled + 2.0);
    let held = 0.6 * rig.amplitude();
    rig.run(enabled + 5.0);
    let lost = 0.6 * rig.amplitude();
    assert!((held / 0.2 - 1.0).abs() < 0.05, "{held}");
    assert!((lost / 0.05 - 1.0).abs() < 0.05, "{lost}");
}

on_both! {
    a_lost_link_never_raises_the_amplitude,
    neither_a_missing_setpoint_nor_a_sweep_raises_the_amplitude,
    no_setting_overrides_a_limit,
}
