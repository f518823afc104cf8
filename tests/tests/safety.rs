//! What no failure of a sensor, a link or a setting may do, in the closed loop over all that the settings accept.

use kband::control::{Limits, State, Target};
use kband::plant::{Change, ClosedLoop, Disturbance, Scene};
use kband_tests::draw::{Draw, ceiling, failure, machine, settled, square};

fn disturb(scene: &mut Scene, changes: impl IntoIterator<Item = (f64, Change)>) {
    for (at, change) in changes {
        scene.disturbances.push(Disturbance { at, change }).unwrap();
    }
}

/// Runs a scene for a time in s; the largest true displacement in m, and what is shown of each cycle.
fn run(scene: &Scene, seconds: f64, mut look: impl FnMut(f64, f32, &ClosedLoop)) -> f32 {
    let mut closed = ClosedLoop::build(scene).unwrap();
    let mut largest = 0.0_f32;
    let mut time = 0.0;
    while time < seconds {
        let mut in_cycle = 0.0_f32;
        time = closed
            .cycle_shown(|sample| in_cycle = in_cycle.max(sample.displacement.abs()))
            .time;
        largest = largest.max(in_cycle);
        look(time, in_cycle, &closed);
    }
    largest
}

#[test]
fn no_failure_of_the_sensor_raises_the_amplitude_beyond_its_limit() {
    let mut draw = Draw::new(11);
    let (mut worst, mut faults) = (0.0_f32, 0);
    for n in 0..200 {
        let failure = failure(&mut draw);
        let mut scene = failure.scene.clone();
        disturb(&mut scene, failure.changes.iter().copied());
        let (limit, ready) = (ceiling(&scene.settings), failure.ready);
        let mut fault = None;
        let largest = run(&scene, 3.5 * ready, |_, _, closed| {
            fault = fault.or(closed.controller().report().fault);
        });
        faults += u32::from(fault.is_some());
        worst = worst.max(largest / limit);
        assert!(
            largest <= 1.3 * limit,
            "{n}: {:.4} mm, limit {:.4} mm, {fault:?}: {:?}: {:?}",
            1e3 * largest,
            1e3 * limit,
            failure.changes,
            scene.settings
        );
    }
    println!("largest amplitude over its limit {worst:.3}, {faults} of 200 ended in a fault");
}

/// Machines beside their resonance, whose amplitude beats.
#[test]
fn no_failure_of_the_sensor_raises_a_beating_amplitude_beyond_its_limit() {
    let mut draw = Draw::new(17);
    let mut worst = 0.0_f32;
    for n in 0..60 {
        let failure = failure(&mut draw);
        let mut scene = failure.scene.clone();
        let x = 1.0 + draw.between(-0.2, 0.2) * draw.unit();
        let settings = &mut scene.settings;
        let quality = settings.quality;
        settings.resonance = (settings.frequency / x).clamp(5.0, 500.0);
        let x = settings.frequency / settings.resonance;
        // As strong at its frequency as it was at its resonance.
        let response = 1.0 / (quality * ((1.0 - x * x).powi(2) + (x / quality).powi(2)).sqrt());
        settings.gain = (settings.gain / response).min(100.0);
        scene.drive.resonance = settings.resonance;
        scene.drive.gain = settings.gain;
        disturb(&mut scene, failure.changes.iter().copied());
        let limit = ceiling(&scene.settings);
        let largest = run(&scene, 3.5 * failure.ready, |_, _, _| {});
        worst = worst.max(largest / limit);
        assert!(
            largest <= 1.3 * limit,
            "{n}: {:.4} mm, limit {:.4} mm: {:?}: {:?}",
            1e3 * largest,
            1e3 * limit,
            failure.changes,
            scene.settings
        );
    }
    println!("largest amplitude over its limit {worst:.3} beside the resonance");
}

#[test]
fn a_healthy_machine_reaches_its_setpoint_without_a_fault_at_any_frequency() {
    let mut draw = Draw::new(12);
    for n in 0..80 {
        let mut scene = machine(&mut draw);
        let limit = ceiling(&scene.settings);
        let reach = 0.85e-3 * scene.settings.output_maximum * scene.settings.gain;
        let goal = draw.between(0.2, 1.0) * limit.min(reach);
        scene.target = Target::Amplitude(1e3 * goal);
        // The drive is as strong as it is said to be within a tenth.
        scene.drive.gain *= draw.between(0.9, 1.1);
        let mut last = 0.0;
        let mut fault = None;
        run(
            &scene,
            2.0 * settled(&scene.settings),
            |_, largest, closed| {
                last = largest;
                fault = fault.or(closed.controller().report().fault);
            },
        );
        assert_eq!(fault, None, "{n}: {:?}", scene.settings);
        assert!(
            (last / goal - 1.0).abs() < 0.1,
            "{n}: {last} m of {goal} m: {:?}",
            scene.settings
        );
    }
}

#[test]
fn a_lost_link_never_raises_the_amplitude() {
    let mut draw = Draw::new(13);
    for n in 0..80 {
        let mut scene = machine(&mut draw);
        let limit = ceiling(&scene.settings);
        let goal = if n % 4 == 0 {
            0.0
        } else {
            draw.scale(0.01, 1.0) * limit
        };
        scene.target = Target::Amplitude(1e3 * goal);
        scene.settings.link_timeout = 0.2;
        let ready = settled(&scene.settings);
        let at = 3.0 / f64::from(scene.settings.frequency) + f64::from(draw.unit()) * ready;
        disturb(&mut scene, [(at, Change::Link(false))]);
        // What the drive had under way when the link was found to be lost.
        let found = at + 0.2 + 6.0 / f64::from(scene.settings.frequency);
        let mut before = 0.0_f32;
        let mut reference = f32::INFINITY;
        let safe = 1e-3 * scene.settings.safe_amplitude;
        let end = found + 5.0_f64.min(ready);
        run(&scene, end, |time, largest, closed| {
            let report = closed.controller().report();
            if time <= found {
                before = before.max(largest);
                return;
            }
            assert!(
                report.limits.contains(Limits::LINK_LOST),
                "{n} at {time}, {found}: {report:?}"
            );
            assert!(report.reference <= reference, "{n}: the reference rises");
            reference = report.reference;
            // The reference of the last two cycles is still on its way to the track.
            let most = before.max(reference) + 0.1 * limit;
            assert!(
                largest <= most,
                "{n} at {time}: {largest} m after {before} m"
            );
            assert!(
                goal > 0.0 || largest < 1e-3 * limit,
                "{n}: standstill moves"
            );
        });
        let most = safe.min(goal).min(limit);
        assert!(
            reference <= most.max(1e-12) * 1.001 || end < found + 4.9,
            "{n}: {reference} m stays, {most} m is allowed"
        );
    }
}

#[test]
fn without_a_setpoint_nothing_moves() {
    for frequency in [25.0, 50.0, 120.0, 300.0, 500.0] {
        let mut scene = Scene::default();
        let settings = &mut scene.settings;
        settings.frequency = frequency;
        settings.resonance = frequency;
        settings.safe_amplitude = 0.01;
        // No lock of such a lot.
        settings.restitution_low = 0.1;
        settings.restitution_high = 0.3;
        scene.drive.resonance = frequency;
        let mut state = State::Off;
        let largest = run(&scene, 3.0, |_, _, closed| {
            state = closed.controller().state();
        });
        assert_eq!((state, largest), (State::Limiting, 0.0), "{frequency} Hz");
    }
}

#[test]
fn every_accepted_band_of_tracking_starts_a_healthy_machine() {
    let mut draw = Draw::new(14);
    let mut started = 0;
    while started < 12 {
        let mut scene = machine(&mut draw);
        let settings = &mut scene.settings;
        settings.quality = draw.scale(8.0, 60.0);
        settings.frequency = draw.scale(20.0, 300.0);
        settings.resonance = settings.frequency;
        settings.tracking = draw.scale(0.02, 0.4) * settings.frequency;
        settings.amplitude_limit = 100.0;
        settings.acceleration_limit = 60.0;
        settings.safe_amplitude = 10.0 * 60.0 / square(settings) * 1e3 / 40.0;
        settings.sensitivity = 0.1;
        scene.sensor.noise = 0.15;
        let highest = (settings.frequency + settings.tracking) / settings.frequency;
        settings.safe_amplitude /= highest * highest * 2.5;
        if settings.check().is_err() {
            continue;
        }
        started += 1;
        let at = settings.frequency + draw.between(-0.9, 0.9) * settings.tracking;
        scene.drive.resonance = at;
        scene.drive.quality = settings.quality;
        scene.drive.gain = settings.gain;
        let goal = 0.3 * ceiling(settings).min(1e-3 * settings.gain);
        scene.target = Target::Amplitude(1e3 * goal);
        let mut report = None;
        let points = 4.0 * settings.tracking * settings.quality
            / (settings.frequency - settings.tracking).max(5.0);
        let dwell = 4.0 * settings.quality / 3.0 + 5.0;
        let sweep =
            f64::from((points + 2.0) * dwell / (settings.frequency - settings.tracking).max(5.0));
        let seconds = sweep + 3.0 * settled(settings);
        run(&scene, seconds, |_, _, closed| {
            report = Some(closed.controller().report());
        });
        let report = report.unwrap();
        assert_eq!(report.fault, None, "{at} Hz: {:?}", scene.settings);
        assert_eq!(
            report.state,
            State::Holding,
            "{at} Hz: {:?}",
            scene.settings
        );
    }
}
