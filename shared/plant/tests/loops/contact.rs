//! Impacts that take time: lock, share in gear and detection in the closed loop.

use core::f64::consts::TAU;

use kband::impact::{ContactTime, Scatter, TangentialSettings, Wave, WaveMap};
use kband::regime::Lock;
use kband::regime::gear::{GearWatch, Share, shares_with_contact};
use kband::transport::locked;
use kband_control::{Limits, State, Target};
use kband_plant::{Moment, Scene};

use super::fidelity::{Loop, record};

/// Contact in ms at 50 Hz, 2 % of the cycle.
const CONTACT: f32 = 0.4;

fn with_contact(mut scene: Scene, contact: f32) -> Scene {
    (scene.contact, scene.settings.contact) = (contact, contact);
    scene
}

#[test]
fn parts_lock_at_the_predicted_phase() {
    for waveform in [false, true] {
        let scene = Scene {
            parts: [0.19, 0.2, 0.21].into_iter().collect(),
            ..Scene::default()
        };
        let mut scene = with_contact(scene, CONTACT);
        // A contact of a period of the ringing leaves a third of it.
        scene.sensor.ringing *= 3.0;
        let contact = ContactTime::from_milliseconds(CONTACT.into(), 50.0).unwrap();
        let mut closed = Loop::build(&scene, waveform);
        let (mut apart, mut shift, mut stamped, mut count) = ([0.0, 0.0_f64], 0.0, 0.0, 0);
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
                let off = strike.phase - predicted;
                apart[0] += off;
                apart[1] = apart[1].max(off.abs());
                shift += predicted - lock(ContactTime::INSTANT).unwrap().strike_phase();
                stamped += f64::from(report.phase) - strike.phase;
                count += 1;
            }
        }
        let [bias, shift, stamped] = [apart[0], shift, stamped].map(|sum| sum / f64::from(count));
        std::println!(
            "{waveform}: bias {bias:.5} max {:.5} shift {shift:.5} stamp {stamped:.5}",
            apart[1]
        );
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
        std::println!("{waveform}: speed {speed:.5} predicted {predicted:.5} m/s");
        assert!(
            (speed / predicted - 1.0).abs() < 0.01,
            "{speed} {predicted}"
        );
        // The amplitude is measured within 0.3 %, which moves the phase by 0.006 rad.
        assert!(
            bias.abs() < 0.006 && apart[1] < 0.03,
            "{waveform}: {bias} {apart:?}"
        );
    }
}

/// One part at R = 0.3, s = 0.05 with k = 0.45.
#[test]
fn restitution_is_estimated_from_impacts_that_take_time() {
    for seed in 1..4 {
        let mut scene = Scene {
            target: Target::K(0.45),
            parts: core::iter::once(0.3).collect(),
            scatter: core::iter::once(0.05).collect(),
            seed,
            ..Scene::default()
        };
        (
            scene.settings.restitution_low,
            scene.settings.restitution_high,
        ) = (0.3, 0.3);
        let mut closed = Loop::build(&with_contact(scene, CONTACT), false);
        let mut margins = std::vec::Vec::new();
        for _ in 0..3000 {
            margins.extend(closed.cycle().0.report.margin);
        }
        let margin = margins.last().unwrap();
        std::println!("{seed}: {margin:?}");
        let error = (margin.restitution - 0.3).abs();
        assert!(error < 4.0 * margin.error + 0.002, "{seed}: {margin:?}");
    }
}

/// R = 0.3, s = 0.05 at k = 0.48: instant impacts would give 0.42.
#[test]
fn share_in_gear_is_the_predicted_one() {
    const CYCLES: usize = 3000;
    const SETTLED: usize = 250;
    let contact = ContactTime::from_milliseconds(CONTACT.into(), 50.0).unwrap();
    let map = WaveMap::on(Wave::sine(), 0.48, 0.3).unwrap();
    let scatters: [Scatter; 48] =
        core::array::from_fn(|seed| Scatter::build(0.3, 0.05, seed as u64).unwrap());
    let mut predicted = Share::default();
    shares_with_contact(&map, contact, &scatters, 1, 1000.0, |_, share| {
        predicted = predicted.plus(&share);
    })
    .unwrap();
    for (waveform, runs) in [(false, 3), (true, 1)] {
        let (mut truth, mut heard, mut heard_cycles) = (0.0, 0.0, 0.0);
        for seed in 0..runs {
            let mut scene = Scene {
                target: Target::K(0.48),
                parts: core::iter::repeat_n(0.3, 12).collect(),
                scatter: core::iter::repeat_n(0.05, 12).collect(),
                seed,
                ..Scene::default()
            };
            (
                scene.settings.restitution_low,
                scene.settings.restitution_high,
            ) = (0.3, 0.3);
            let scene = with_contact(scene, CONTACT);
            let mut closed = Loop::build(&scene, waveform);
            let mut watches = std::vec![GearWatch::build(1).unwrap(); 12];
            for cycle in 0..CYCLES {
                if cycle == SETTLED {
                    watches
                        .iter_mut()
                        .for_each(|watch| watch.begin(cycle as f64 * TAU));
                }
                let (Moment { report, .. }, strikes, _) = closed.cycle();
                record(&mut watches, &strikes);
                if cycle >= SETTLED && report.in_gear_error.is_finite() {
                    heard += f64::from(report.in_gear);
                    heard_cycles += 1.0;
                }
            }
            let shares = watches
                .iter()
                .map(|watch| watch.share(CYCLES as f64 * TAU).share());
            truth += shares.sum::<f64>() / 12.0 / runs as f64;
        }
        let (heard, predicted) = (heard / heard_cycles, predicted.share());
        std::println!("{waveform}: predicted {predicted:.3} true {truth:.3} estimated {heard:.3}");
        // Twelve parts of a minute scatter by 0.02 in each run.
        assert!(
            (truth - predicted).abs() < 0.04,
            "{waveform}: {truth} {predicted}"
        );
        assert!((heard - truth).abs() < 0.07, "{waveform}: {heard} {truth}");
    }
}

/// The ringing frequency is 2400 Hz: 0.1 and 0.6 ms are 0.24 and 1.44 of its periods.
#[test]
fn impacts_longer_than_a_period_of_the_ringing_are_reported_as_not_measurable() {
    for waveform in [false, true] {
        for (contact, deaf) in [(0.1, false), (0.3, false), (0.6, true), (0.8, true)] {
            let scene = Scene {
                parts: [0.19, 0.2, 0.21].into_iter().collect(),
                ..Scene::default()
            };
            let mut closed = Loop::build(&with_contact(scene, contact), waveform);
            let mut last = 0;
            for _ in 0..1500 {
                last = u32::from(closed.cycle().0.report.limits.contains(Limits::DEAF));
            }
            std::println!("{waveform} {contact}: {last}");
            assert_eq!(last == 1, deaf, "{waveform} {contact}");
        }
    }
}
