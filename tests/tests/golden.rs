//! The golden impacts and hops (25 digits) against the map in every arithmetic.

use std::f64::consts::TAU;

use kband::arithmetic::Twofold;
use kband::impact::{Hybrid, Integer, Kernel, Map, Single};
use kband_tests::{exact, oracle};

/// One row: launch and impact.
struct Golden {
    k: f64,
    restitution: f64,
    phase: f64,
    velocity: f64,
    flight: &'static str,
    next_phase: Option<&'static str>,
    next_velocity: &'static str,
    condition: f64,
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

fn impacts() -> impl Iterator<Item = Golden> {
    include_str!("../reference/impacts.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let field: Vec<&'static str> = line.split(',').collect();
            Golden {
                k: number(field[1]),
                restitution: number(field[2]),
                phase: number(field[3]),
                velocity: number(field[4]),
                flight: field[5],
                next_phase: Some(field[6]),
                next_velocity: field[7],
                condition: number(field[8]),
            }
        })
}

fn hops() -> impl Iterator<Item = Golden> {
    include_str!("../reference/hops.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let field: Vec<&'static str> = line.split(',').collect();
            let (restitution, flight) = (number(field[2]), number(field[5]));
            let arrival = number(field[6]) / restitution;
            Golden {
                k: number(field[1]),
                restitution,
                phase: number(field[3]),
                velocity: number(field[4]),
                flight: field[5],
                next_phase: None,
                next_velocity: field[6],
                condition: flight / arrival,
            }
        })
}

#[test]
fn every_golden_impact_has_the_right_root() {
    let mut counted = 0;
    for golden in impacts().chain(hops()) {
        let map = Map::build(golden.k, golden.restitution).unwrap();
        let state = Map::state(golden.phase, golden.velocity).unwrap();
        let impact = map.impact(state);
        let (flight, velocity) = (number(golden.flight), number(golden.next_velocity));
        // The right root at any condition number: another one is at least 1e-3 away.
        assert!(
            (impact.flight / flight - 1.0).abs() < 1e-6,
            "{flight}: {impact:?}"
        );
        // Half a dozen roundings of 1.1e-16, times a condition number of up to 100; 1e-12 includes
        // a factor of 10.
        if golden.condition < 100.0 {
            assert!((impact.flight / flight - 1.0).abs() < 1e-12, "{impact:?}");
            let error = (impact.next.velocity - velocity).abs();
            assert!(error <= 1e-12 * velocity.max(1e-3 * flight), "{impact:?}");
            if let Some(phase) = golden.next_phase {
                let error = (impact.next.phase - number(phase)).abs();
                assert!(error < 1e-12 * flight.max(1.0), "{impact:?}");
            }
            counted += 1;
        }
    }
    assert!(counted > 2_500, "{counted}");
}

/// Fixed-point value in units of 1e-20, of an f64 in 2^-10..2^9 or of a decimal with at least 20
/// places.
fn fixed(value: f64) -> i128 {
    let bits = value.to_bits();
    let mantissa = i128::from(bits & ((1 << 52) - 1) | 1 << 52);
    let exponent = (bits >> 52) as i32 - 1075;
    let scaled = mantissa * 10_i128.pow(20);
    (scaled + (1_i128 << (-exponent - 1))) >> -exponent
}

fn fixed_decimal(text: &str) -> i128 {
    let (whole, places) = text.split_once('.').unwrap();
    let places: i128 = places[..20].parse().unwrap();
    whole.parse::<i128>().unwrap() * 10_i128.pow(20) + places
}

#[test]
fn the_oracle_in_twofold_rounds_phases_correctly() {
    let mut counted = 0;
    for golden in impacts() {
        let map = Map::build(golden.k, golden.restitution).unwrap();
        let state = Map::state(golden.phase, golden.velocity).unwrap();
        let Some(exact) = exact::refine(&map, state) else {
            continue;
        };
        let phase = exact.phase.value();
        let expected = golden.next_phase.unwrap();
        if golden.condition < 1000.0 && phase > 0.1 && expected.len() > 22 {
            let error = (fixed(phase) - fixed_decimal(expected)).abs();
            let ulp = 1e20 * (f64::from_bits(phase.to_bits() + 1) - phase);
            assert!(
                error as f64 <= 0.51 * ulp + 2.0,
                "{} ulp: {expected} {phase}",
                error as f64 / ulp
            );
            counted += 1;
        }
    }
    assert!(counted > 900, "{counted}");
}

/// A step of the phase in rad, and half a step of a velocity in integers.
const STEP: f64 = TAU / 4_294_967_296.0;
const HALF: f64 = 0.5 / 67_108_864.0;

/// Golden impacts and hops in a microcontroller's arithmetic; grazing ones and merged roots are
/// left out.
///
/// The roundings are of `velocity` at launch and of `height`, relative to the gap's terms and to 1.
fn golden<K: Kernel>(velocity: fn(f64) -> f64, [relative, height]: [f64; 2]) {
    let mut tried = 0;
    for golden in impacts().chain(hops()) {
        let Golden { k, phase, .. } = golden;
        let kernel = K::build(k, golden.restitution).unwrap();
        let impact = kernel.impact(K::state(phase, golden.velocity).unwrap());
        let next = K::observe(impact.next);
        let flight = number(golden.flight);
        let [_, slope, curvature] = oracle::gap(k, phase, golden.velocity, flight);
        // The velocity moves the gap by d, the phase by at most 2 d, rounded to half a step.
        let terms = oracle::rounding(k, phase, golden.velocity, flight) / (0.5 * f64::EPSILON);
        let moved = flight * (STEP + velocity(golden.velocity))
            + relative * terms
            + height * flight.min(1.0);
        if impact.grazes || slope * slope < 8.0 * curvature.abs() * moved {
            continue;
        }
        let allowed = moved / slope.abs() + STEP;
        let error = (impact.flight - flight).abs() / allowed;
        assert!(
            error < 6.0,
            "{} {error}: k {k:e} {phase:e} {:e}: {flight} {impact:?}",
            K::NAME,
            golden.velocity
        );
        let expected = number(golden.next_velocity);
        let off = (next.velocity - expected).abs();
        let room = golden.restitution
            * (4.0 * allowed * curvature.abs() + 2.0 * (STEP + moved / flight))
            + 4.0 * velocity(expected);
        assert!(
            off <= room,
            "{} {off:e} of {room:e}: k {k:e} {phase:e} {:e}: {expected} {impact:?}",
            K::NAME,
            golden.velocity
        );
        tried += 1;
    }
    assert!(tried > 2_300, "{}: {tried}", K::NAME);
}

#[test]
fn golden_impacts_hold_in_the_microcontrollers_arithmetic() {
    // Hybrid: sine and height to 2^-30. Integer: also the cosine, which moves the gap by the flight
    // time. f32: every term of the gap to 2^-24.
    golden::<Hybrid>(|_| HALF, [0.0, 3e-9]);
    golden::<Integer>(|_| HALF + 4e-9, [0.0, 3e-9]);
    golden::<Single>(|v| 6e-8 * v, [6e-8, 0.0]);
}

/// Residual of the f64 map in roundings of the gap's terms, against 30 digits of the oracle.
#[test]
fn the_residual_of_f64_is_within_four_roundings() {
    use kband_tests::states::{Kind, Random};
    for kind in [Kind::High, Kind::Low, Kind::Chatter, Kind::Edge] {
        let mut random = Random::new(77);
        let mut count = 0;
        for _ in 0..40_000 {
            let launch = kind.draw(&mut random);
            let map = Map::build(launch.k, 1.0).unwrap();
            let impact = map.impact(launch.state());
            if impact.grazes || impact.flight == 0.0 || impact.next.velocity == 0.0 {
                continue;
            }
            let Some(exact) = exact::refine(&map, launch.state()) else {
                continue;
            };
            let off = Twofold::from(impact.flight)
                .minus(exact.flight)
                .value()
                .abs();
            // Half an ulp of the flight, and of each term of the gap.
            let gap = oracle::rounding(launch.k, launch.phase, launch.velocity, impact.flight);
            let roundings =
                off * exact.arrival / (gap + 0.5 * f64::EPSILON * impact.flight * exact.arrival);
            count += 1;
            assert!(
                roundings <= 4.0,
                "{kind:?} {roundings}: {launch:?} {impact:?} {exact:?}"
            );
        }
        assert!(count > 20_000, "{kind:?}: {count}");
    }
}
