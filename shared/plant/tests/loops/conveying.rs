//! Conveying speed of random lots on one tone and on two: in both plants, and with a light mass.

use super::fidelity::{Loop, drive_of};
use super::lots::{between, number, random_lot};
use core::f64::consts::TAU;
use kband::arithmetic::Noise;
use kband_control::{Shape, Target, UpperTone};
use kband_plant::Scene;

/// Drive cycles until the parts hop steadily, and of the measurement.
const CYCLES: [u32; 2] = [200, 1000];
/// Smallest difference of two mean speeds, over the track's largest speed along itself, that counts.
/// Other noise brings parts to another attractor in up to 3 of 30 lots; a light mass in none of 150.
const DIFFERENCE: f64 = 0.1;
/// Largest time in turns by which a throw may precede the last impact: 0.2 rad.
const MAX_OVERLAP: f64 = 0.04;

/// A lot at a fixed k, whose drive has a second tone. Half of the tones are off.
fn lot(seed: u64, lot: u64) -> Scene {
    let (mut scene, _) = random_lot(seed, lot);
    let noise = &mut Noise::new(seed ^ lot << 20);
    let k = between(noise, 0.3, 0.9) as f32;
    let shape = Shape::of_two(UpperTone::new(0.35, between(noise, 0.0, TAU) as f32));
    scene.target = match lot % 2 {
        0 => Target::K(k),
        _ => Target::Tones { k, shape },
    };
    scene.friction = Some([0.4; 2]).filter(|_| lot.is_multiple_of(3));
    let settings = &mut scene.settings;
    settings.incline = between(noise, -8.0, 8.0) as f32;
    settings.amplitude_ratio = between(noise, 0.5, 3.0) as f32;
    settings.phase_lead = between(noise, -150.0, 150.0) as f32;
    (settings.second_tone, settings.track_mass) = (0.4, 10.0);
    settings.second_gain = settings.gain;
    scene.drive = drive_of(settings);
    scene.drive.second_quality = settings.quality;
    scene
}

/// Mean speed over the track's, `None` after a fault; a flight begins after the last impact.
fn convey(scene: &Scene, waveform: bool) -> Option<f64> {
    let mut closed = Loop::build(scene, waveform);
    let mut last = vec![0.0_f64; scene.parts.len()];
    let [from, to] = CYCLES.map(|cycles| {
        let mut cycle = || {
            let (moment, strikes, _) = closed.cycle();
            for strike in strikes {
                let time = strike.time as f64 / 4_294_967_296.0;
                let last = &mut last[usize::from(strike.part)];
                let began = time - f64::from(strike.flight);
                assert!(began > *last - MAX_OVERLAP, "{began} {last} {scene:?}");
                *last = time;
            }
            moment
        };
        (0..cycles).map(|_| cycle()).last().expect("a cycle")
    });
    let settings = &scene.settings;
    let amplitude = f64::from(settings.amplitude_ratio * to.report.amplitude);
    let speed = (to.displacement - from.displacement) / (to.time - from.time);
    let track_speed = amplitude * TAU * f64::from(settings.frequency);
    to.report.fault.is_none().then_some(speed / track_speed)
}

#[test]
fn random_lots_convey_alike_in_both_plants_and_with_mass() {
    let (seed, lots) = (number("KBAND_SEED", 1), number("KBAND_LOTS", 12));
    let (mut compared, mut differing) = (0, [0; 2]);
    for n in 0..lots {
        let scene = lot(seed, n);
        let mut heavy = scene.clone();
        heavy.masses = scene.parts.iter().map(|_| 1e-3).collect();
        heavy.drive.mass = 10.0;
        let speeds = [(&scene, true), (&scene, false), (&heavy, true)];
        if let [Some(slow), others @ ..] = speeds.map(|(scene, waveform)| convey(scene, waveform)) {
            compared += 1;
            for (count, other) in differing.iter_mut().zip(others) {
                *count += u64::from(other.is_none_or(|other| (other - slow).abs() > DIFFERENCE));
            }
        }
    }
    let ([envelope, heavy], enough) = (differing, 10 * compared >= 9 * lots);
    assert!(
        enough && envelope <= lots / 5 && heavy <= lots / 15,
        "{compared} {differing:?}"
    );
}
