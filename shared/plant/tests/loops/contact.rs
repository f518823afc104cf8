//! Impacts with a duration: lock, share in gear and detection in the closed loop.

use super::fidelity::{Loop, ShareResult, lot, measure_share};
use kband::impact::{ContactTime, Scatter, TangentialSettings, Wave, WaveMap};
use kband::regime::Lock;
use kband::regime::gear::{Share, shares_from_rest};
use kband::transport::locked;
use kband_control::{Limits, State, Target};
use kband_plant::Scene;

/// Contact in ms at 50 Hz, 2 % of the cycle.
const CONTACT: f32 = 0.4;

fn three_part_scene() -> Scene {
    Scene {
        parts: [0.19, 0.2, 0.21].into_iter().collect(),
        ..Scene::default()
    }
}

fn with_contact(mut scene: Scene, contact: f32) -> Scene {
    (scene.contact, scene.settings.contact) = (contact, contact);
    scene
}

#[test]
fn parts_lock_at_the_predicted_phase() {
    for waveform in [false, true] {
        let mut scene = with_contact(three_part_scene(), CONTACT);
        // A contact as long as a period of the ringing leaves a third of the ringing.
        scene.sensor.ringing *= 3.0;
        let contact = ContactTime::from_milliseconds(CONTACT.into(), 50.0).unwrap();
        let mut closed = Loop::build(&scene, waveform);
        let (mut errors, mut shift, mut count) = ([0.0, 0.0_f64], 0.0, 0);
        let (mut begun, mut ended) = (closed.cycle().0, closed.cycle().0);
        for cycle in 0..2500 {
            let (moment, strikes, _) = closed.cycle();
            let report = moment.report;
            if cycle < 2000 {
                begun = moment;
                continue;
            }
            ended = moment;
            assert_eq!(report.state, State::Locked, "{waveform} {cycle}");
            for strike in strikes {
                let restitution = f64::from(scene.parts[usize::from(strike.part)]);
                let k = f64::from(report.k);
                let lock = |contact| Lock::with_contact(k, restitution, 1, contact).unwrap();
                let predicted = lock(contact).unwrap().strike_phase();
                let error = strike.phase - predicted;
                errors[0] += error;
                errors[1] = errors[1].max(error.abs());
                shift += predicted - lock(ContactTime::INSTANT).unwrap().strike_phase();
                count += 1;
            }
        }
        let [bias, shift] = [errors[0], shift].map(|sum| sum / f64::from(count));
        assert!(count > 1400 && shift < -0.01, "{shift}");
        let speed = (ended.displacement - begun.displacement) / (ended.time - begun.time);
        let track = scene.settings.track().unwrap();
        let along = TangentialSettings::on(&track, scene.settings.tangential_restitution.into());
        let speeds = scene.parts.iter().map(|&restitution| {
            let k = f64::from(ended.report.k);
            let lock = Lock::with_contact(k, restitution.into(), 1, contact).unwrap();
            let unit = track.velocity_unit(track.amplitude(k));
            locked::velocity(&lock.unwrap(), k, &along) * unit
        });
        let predicted = speeds.sum::<f64>() / 3.0;
        let error = (speed / predicted - 1.0).abs();
        assert!(error < 0.01, "{speed} {predicted}");
        // The amplitude is measured within 0.3 %, which moves the phase by 0.006 rad.
        let is_close = bias.abs() < 0.006 && errors[1] < 0.03;
        assert!(is_close, "{waveform}: {bias} {errors:?}");
    }
}

/// One part at R = 0.3, s = 0.05 with k = 0.45.
#[test]
fn restitution_is_estimated_from_impacts_that_take_time() {
    for seed in 1..4 {
        let scene = with_contact(lot([0.3; 2], 0.05, 0.45, 1, seed), CONTACT);
        let mut closed = Loop::build(&scene, false);
        let margins = (0..3000).filter_map(|_| closed.cycle().0.report.margin);
        let margin = margins.last().unwrap();
        let error = (margin.restitution - 0.3).abs();
        assert!(error < 4.0 * margin.error + 0.002, "{seed}: {margin:?}");
    }
}

/// R = 0.3, s = 0.05 at k = 0.48: instant impacts would give 0.42.
#[test]
fn share_in_gear_is_the_predicted_one() {
    let contact = ContactTime::from_milliseconds(CONTACT.into(), 50.0).unwrap();
    let map = WaveMap::on(Wave::sine(), 0.48, 0.3).unwrap();
    let scatters: [Scatter; 48] =
        core::array::from_fn(|seed| Scatter::build(0.3, 0.05, seed as u64).unwrap());
    let mut predicted = Share::default();
    shares_from_rest(&map, contact, &scatters, 1, 1000.0, |_, share| {
        predicted = predicted.plus(&share);
    })
    .unwrap();
    let predicted = predicted.share();
    for (waveform, runs) in [(false, 3), (true, 1)] {
        let runs: Vec<_> = (0..runs)
            .map(|seed| {
                let scene = with_contact(lot([0.3; 2], 0.05, 0.48, 12, seed), CONTACT);
                measure_share(&scene, waveform)
            })
            .collect();
        let mean =
            |of: fn(&ShareResult) -> f64| runs.iter().map(of).sum::<f64>() / runs.len() as f64;
        let (actual, estimated) = (mean(|run| run.actual), mean(|run| run.estimated));
        // The share of twelve parts over a minute scatters by 0.02 from run to run.
        let is_close = (actual - predicted).abs() < 0.04 && (estimated - actual).abs() < 0.07;
        assert!(is_close, "{waveform}: {estimated} {actual} {predicted}");
    }
}

/// The ringing frequency is 2400 Hz: 0.1 and 0.6 ms are 0.24 and 1.44 of its periods.
#[test]
fn impacts_longer_than_a_period_of_the_ringing_are_reported_as_not_measurable() {
    for waveform in [false, true] {
        for (contact, expected) in [(0.1, false), (0.3, false), (0.6, true), (0.8, true)] {
            let mut closed = Loop::build(&with_contact(three_part_scene(), contact), waveform);
            let last = (0..1500).map(|_| closed.cycle().0.report.limits).last();
            let is_deaf = last.unwrap().contains(Limits::DEAF);
            assert_eq!(is_deaf, expected, "{waveform} {contact}");
        }
    }
}

/// Mean velocities in `b w`, from integrated contacts with friction; the first order errs by 0.1.
#[test]
fn sliding_parts_convey_as_in_an_integrated_contact() {
    for (k, restitution, expected) in [
        (0.7, 0.46, 0.854),
        (0.6, 0.46, 0.566),
        (0.5, 0.2, 1.668),
        (0.7, 0.2, 0.756),
    ] {
        let mut scene = with_contact(three_part_scene(), CONTACT);
        scene.parts = [restitution].into_iter().collect();
        (scene.settings.incline, scene.settings.amplitude_ratio) = (0.0, 2.889);
        (scene.target, scene.friction) = (Target::K(k), Some([0.278; 2]));
        for mut closed in Loop::both(&scene) {
            let mut after = |cycles| (0..cycles).map(|_| closed.cycle().0).last().unwrap();
            let [from, to] = [after(300), after(1000)];
            let speed = (to.displacement - from.displacement) / (to.time - from.time);
            let velocity = speed * f64::from(k) * core::f64::consts::TAU * 50.0 / 9.80665;
            assert!(
                (velocity - expected).abs() < 0.1,
                "{k} {restitution}: {velocity}"
            );
        }
    }
}
