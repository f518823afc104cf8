//! Lift-off from tracks with several tones, compared with an independent track.

use std::f64::consts::TAU;

use kband::impact::{Orbit, OrbitEvent, PartState, Wave, WaveMap};
use kband_tests::oracle::Track;
use kband_tests::states::{Random, tones};

/// A random track; k up to the largest k at which the track throws a part.
fn track(random: &mut Random) -> (Track, Wave) {
    let tones = tones(random);
    let wave = Wave::build(tones[0], tones[1]).unwrap();
    let k = if random.sign() > 0.0 {
        random.between(0.02, 1.0)
    } else {
        random.scale(0.01, 1.2 * wave.highest_throw())
    };
    (Track::on(k, tones), wave)
}

/// A resting part is thrown at the next phase at which the track's downward acceleration rises
/// above k.
#[test]
fn a_resting_part_is_thrown_by_the_next_window() {
    let mut random = Random::new(9);
    let mut windows = [0; 4];
    for _ in 0..4_000 {
        let (track, wave) = track(&mut random);
        let map = WaveMap::on(wave, track.k, 0.3).unwrap();
        let excess = |phase: f64| -track.at(phase)[2] - track.k;
        let mut phases: Vec<f64> = Vec::new();
        for n in 0..64 {
            let phase = TAU * f64::from(n) / 64.0;
            let velocity = 0.0;
            let mut orbit = Orbit::new(&map, PartState { phase, velocity });
            if let Some(OrbitEvent::Impact(_)) = orbit.next() {
                assert!(excess(phase) > -1e-12);
                continue;
            }
            let Some(OrbitEvent::LiftOff {
                wait,
                phase: thrown,
            }) = orbit.next()
            else {
                assert!(wave.highest_throw() <= track.k);
                continue;
            };
            assert!(wait < TAU && excess(thrown).abs() < 1e-9);
            assert!(excess(thrown + 1e-4) > excess(thrown - 1e-4));
            // No earlier phase throws the part.
            let earlier = (1..200).map(|m| excess(phase + wait * f64::from(m) / 200.0));
            assert!(earlier.fold(f64::MIN, f64::max) < 1e-9);
            if !phases.contains(&thrown) {
                phases.push(thrown);
            }
        }
        windows[phases.len()] += 1;
    }
    // Tracks with one, two and three such windows in a turn.
    let [_, one, two, three] = windows;
    assert!(one > 1000 && two > 500 && three > 20, "{windows:?}");
}
