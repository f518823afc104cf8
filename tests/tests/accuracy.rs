//! Decisions of the microcontroller kernels near a touch, and the range of each arithmetic.

use std::f64::consts::TAU;

use kband::impact::{Integer, Kernel, Map, PartState, Single, WaveMap};
use kband_tests::oracle::Track;
use kband_tests::states::{Random, touching};

/// k, phase and velocity of a launch that just touches a hump or passes it by 1e-9 to 1e-3.5, and
/// the time of the touch.
fn touch(random: &mut Random) -> Option<[f64; 4]> {
    let k = random.between(0.02, 0.98);
    let (phase, velocity, time) = touching(&Track::sine(k), random)?;
    let gap = 10_f64.powf(random.between(-9.0, -3.5));
    let velocity = velocity + random.sign() * gap / time;
    let flies = (0.0..20.0).contains(&velocity);
    flies.then_some([k, phase, velocity, time])
}

/// Checks the decision for flights that pass a hump by at least a limit, above or below. The limit
/// depends on the flight time if the kernel rounds the cosine at launch.
fn decides<K: Kernel>(limit: fn(f64) -> f64) {
    let mut random = Random::new(9);
    let (mut narrow, mut flagged) = (0, 0);
    for _ in 0..80_000 {
        let Some([k, phase, velocity, time]) = touch(&mut random) else {
            continue;
        };
        let kernel = K::build(k, 0.5).unwrap();
        let state = K::state(phase, velocity).unwrap();
        let held = K::observe(state);
        // Minimum height near the touch, of the state as the kernel represents it.
        let gap_at = |d| Track::sine(k).gap(held.phase, held.velocity, d);
        let mut d = time;
        for _ in 0..6 {
            let [_, slope, curvature] = gap_at(d);
            d -= slope / curvature;
        }
        let [gap, ..] = gap_at(d);
        let limit = limit(d);
        if !((d - time).abs() < 0.1 && gap.abs() < 10.0 * limit) {
            continue;
        }
        let impact = kernel.impact(state);
        flagged += usize::from(impact.grazes);
        if gap.abs() < limit {
            continue;
        }
        narrow += 1;
        let expected = Map::build(k, 0.5).unwrap().impact(held).flight;
        let (name, flight) = (K::NAME, impact.flight);
        let case = format!("{name}: k {k:e} {held:?} gap {gap:e}: {flight} for {expected}");
        assert!((flight - expected).abs() < 0.01, "{case}");
    }
    // Minimum numbers of narrow decisions, and of flags within rounding.
    assert!(narrow > 1_000 && flagged > 20, "{narrow} {flagged}");
}

#[test]
fn grazing_flights_are_decided_down_to_rounding() {
    decides::<Integer>(|_| 1e-8);
    decides::<Single>(|d| 1e-5 * d.max(1.0));
}

/// An elastic orbit that gains velocity until it leaves the range. Its state is refused as a start,
/// and the kernel continues at its largest velocity.
fn reports_the_end_of_its_range<K: Kernel>(top: f64) {
    let kernel = K::build(0.5, 1.0).unwrap();
    let highest = |phase| K::state(phase, top).unwrap();
    // Some launches at the largest velocity gain velocity.
    let fast = (0..64)
        .map(|i| kernel.impact(highest(0.1 * f64::from(i))).next)
        .find(|&next| K::observe(next).velocity > top)
        .unwrap();
    let PartState { phase, velocity } = K::observe(fast);
    assert!(K::state(phase, velocity).is_err());
    let flights = [fast, highest(phase)].map(|state| kernel.impact(state).flight);
    assert_eq!(flights[0], flights[1]);
}

#[test]
fn a_launch_beyond_the_range_is_refused() {
    reports_the_end_of_its_range::<Single>(60.0);
    reports_the_end_of_its_range::<Integer>(60.0);
}

/// Phase of the track in rad that an arithmetic uses for `phase`.
fn place<K: Kernel>(phase: f64) -> Option<f64> {
    let state = K::state(phase, 0.5).ok()?;
    Some(K::observe(state).phase)
}

#[test]
fn every_arithmetic_maps_a_phase_to_the_same_place() {
    // The input is exact to half a digit, at most 9.3e-10 rad, and so is its remainder by 2 pi. The
    // last digit of 2 pi, times 2^21 turns, adds 2^21 2.4e-16 = 5.1e-10. Half a step of the phase
    // adds 7.3e-10.
    let tolerance = 9.4e-10 + 5.2e-10 + 7.4e-10;
    for turns in [0.0, 1.0, 12_345.0, 2_097_150.0, -1.0, -2_097_151.0] {
        for part in [0.1, 1.0, 3.0, 6.2] {
            let phase = turns * TAU + part;
            for place in [place::<Map>, place::<Single>, place::<Integer>] {
                let place = place(phase).unwrap();
                assert!((place - part).abs() < tolerance, "{phase}: {place}");
            }
        }
    }
}

#[test]
fn every_arithmetic_refuses_a_phase_too_large_for_a_place() {
    for phase in [1.32e7, -1.32e7, 1e12, 1e16, 1e300, f64::INFINITY, f64::NAN] {
        let coarse = [place::<Single>, place::<Integer>];
        for place in coarse.into_iter().chain([place::<Map>, place::<WaveMap>]) {
            assert_eq!(place(phase), None, "{phase}");
        }
    }
}
