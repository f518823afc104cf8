//! Tracks of several tones: an independent map, and properties of every impact.

use std::f64::consts::TAU;
use std::sync::Mutex;

use kband::impact::{
    Kernel, OrbitEvent, PartState, Single, Tangent, Tone, WaveKernel, WaveMap, WaveOrbit,
    WaveSingle,
};
use kband_tests::states::Random;
use kband_tests::tones::{Kind, NAMES, Seen, Tally, soak, track};

/// An impact without a graze flag is the first, within rounding; `soak --tones` tests more.
#[test]
fn no_impact_is_missed_in_any_arithmetic() {
    let each = 20_000;
    let wrong = Mutex::new(String::new());
    let tallies = soak(each, 81, 2, |cause| {
        let mut wrong = wrong.lock().unwrap();
        wrong.push_str(cause);
        wrong.push('\n');
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{wrong}");
    for (kind, Tally(seen)) in tallies {
        for (name, seen) in NAMES.iter().zip(seen) {
            let Seen {
                launches,
                flagged,
                doubtful,
                ..
            } = seen;
            let least = if kind == Kind::Wide { each / 2 } else { each };
            assert!(launches >= least, "{name} {kind:?}: {launches}");
            let most = match (kind, *name) {
                (Kind::Edge, _) => launches / 4,
                (Kind::Grazing, _) => launches,
                _ => launches / 1000,
            };
            assert!(
                flagged + doubtful < most.max(10),
                "{name} {kind:?}: {seen:?}"
            );
        }
    }
}

#[test]
fn one_tone_keeps_its_bits() {
    let mut random = Random::new(3);
    for _ in 0..20_000 {
        let (k, restitution) = (random.between(0.02, 1.2), random.between(0.0, 1.0));
        let start = Single::state(random.between(0.0, TAU), random.scale(1e-7, 20.0)).unwrap();
        let one = Single::build(k, restitution).unwrap().impact(start);
        let tones = [Tone::new(0.0, 1.0); 2];
        let same = WaveSingle::on_tones(tones, k, restitution).unwrap();
        assert_eq!(one, same.impact(start));
    }
}

/// `det J = R^2 psi/psi'` of the tangent map itself.
///
/// So the sum of an orbit's exponents is `2 ln R` plus the difference of its ends.
#[test]
fn the_tangent_on_tones_has_its_determinant() {
    let mut random = Random::new(44);
    let mut counted = 0;
    for _ in 0..400 {
        let (track, wave) = track(&mut random);
        let restitution = random.between(0.3, 1.0);
        let map = WaveMap::on(wave, track.k, restitution).unwrap();
        let start = PartState::new(random.between(0.0, TAU), random.between(0.5, 4.0));
        let (mut state, mut sum) = (start, 0.0);
        for n in 0..40 {
            let impact = map.impact(state);
            let Some(tangent) = Tangent::on_tones(&map, state, &impact) else {
                break;
            };
            if impact.next.velocity < 1e-3 || impact.grazes {
                break;
            }
            let [[a, b], [c, d]] = tangent.jacobian;
            let expected = restitution * restitution * state.velocity / impact.next.velocity;
            let scale = (a * d).abs() + (b * c).abs();
            let error = (a * d - b * c - expected).abs() / scale;
            assert!(error < 1e-11, "{track:?} {state:?} {error:e}");
            if scale < 1e4 * expected {
                sum += (a * d - b * c).ln();
                counted += 1;
            } else {
                sum += expected.ln();
            }
            state = impact.next;
            let ends = (start.velocity / state.velocity).ln();
            let flights = f64::from(n + 1);
            assert!((sum - 2.0 * flights * restitution.ln() - ends).abs() < 1e-6 * flights);
        }
    }
    assert!(counted > 4_000, "{counted}");
}

/// Resting parts are thrown where the push rises through k, in the next window.
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
            let mut orbit = WaveOrbit::new(&map, PartState { phase, velocity });
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
    // One window a turn, two and three.
    assert!(
        windows[1] > 1000 && windows[2] > 500 && windows[3] > 20,
        "{windows:?}"
    );
}
