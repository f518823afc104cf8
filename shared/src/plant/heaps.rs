//! The amplitude under parts that grow heavy within a second, as under a hopper's many light ones, in both fidelities.

use core::f64::consts::TAU;

use super::{ClosedLoop, EnvelopeLoop, Moment, Scene};
use crate::control::Target;

/// Cycles until the parts begin to grow heavy, and in which they do: a second.
const BEGIN: usize = 1500;
const DUMP: usize = 50;

/// A track of 10 kg with 24 parts in gear.
fn feeder(quality: f32) -> Scene {
    let mut scene = Scene {
        target: Target::Gear { order: 1 },
        ..Scene::default()
    };
    let settings = &mut scene.settings;
    (settings.quality, settings.gain) = (quality, 20.0);
    (settings.restitution_low, settings.restitution_high) = (0.19, 0.21);
    settings.scatter = 0.02;
    settings.track_mass = 10.0;
    (scene.drive.quality, scene.drive.gain, scene.drive.mass) = (quality, 20.0, 10.0);
    scene.parts = (0..24).map(|n| 0.19 + 0.02 * n as f32 / 24.0).collect();
    scene.scatter = (0..24).map(|_| 0.02).collect();
    scene.masses = (0..24).map(|_| 1e-3).collect();
    scene
}

/// How far the track's amplitude is off its reference while the parts come to weigh `most` of the track's mass, at most.
fn dip(most: f64, mut cycle: impl FnMut(f64) -> (Moment, f64)) -> f64 {
    let mut dip = 0.0_f64;
    for n in 0..BEGIN + DUMP + 10 {
        let share = n.saturating_sub(BEGIN).min(DUMP) as f64 / DUMP as f64 * most;
        let (moment, amplitude) = cycle(share.max(1e-6));
        assert_eq!(moment.report.fault, None);
        if n >= BEGIN {
            dip = dip.max((amplitude / f64::from(moment.report.reference) - 1.0).abs());
        }
    }
    dip
}

fn envelope(quality: f32, most: f64) -> f64 {
    let mut closed = EnvelopeLoop::build(&feeder(quality)).unwrap();
    dip(most, |share| {
        closed.heap(share);
        (closed.cycle(), closed.amplitude())
    })
}

fn waveform(quality: f32, most: f64) -> f64 {
    let mut closed = ClosedLoop::build(&feeder(quality)).unwrap();
    dip(most, |share| {
        closed.heap(share);
        let (mut sine, mut cosine, mut count) = (0.0, 0.0, 0.0);
        let moment = closed.cycle_shown(|sample| {
            let phase = TAU * 50.0 * sample.time;
            sine += f64::from(sample.displacement) * libm::sin(phase);
            cosine += f64::from(sample.displacement) * libm::cos(phase);
            count += 1.0;
        });
        (moment, libm::hypot(sine, cosine) * 2.0 / count)
    })
}

/// Where what the accelerometer lacks of the impacts' push is left out as soon as gear is no longer heard for sure, 4 and 7 %.
#[test]
fn the_track_keeps_its_amplitude_while_its_load_grows() {
    for (quality, most, held) in [(25.0, 0.1, 0.03), (50.0, 0.05, 0.022)] {
        let dips = [envelope(quality, most), waveform(quality, most)];
        assert!(
            dips.iter().all(|dip| *dip < held),
            "{quality} {most}: {dips:?}"
        );
    }
    let dip = waveform(50.0, 0.1);
    assert!(dip < 0.03, "{dip}");
}
