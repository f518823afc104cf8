//! Properties that every impact has, on launches drawn by proptest from a fixed seed.

use std::f64::consts::TAU;

use kband::impact::batch::{Block, LANES};
use kband::impact::{
    Exact, Growth, Hybrid, Integer, Kernel, Map, Observer, Single, State, Tangent,
};
use kband_tests::certificate::is_first;
use kband_tests::oracle::{gap, rounding};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

/// A launch: k, restitution, phase, velocity.
type Launch = (f64, f64, f64, f64);

fn launches() -> impl Strategy<Value = Launch> {
    let restitution = prop_oneof![1 => Just(0.0), 1 => Just(1.0), 6 => 0.0..1.0];
    let velocity = prop_oneof![
        4 => 0.0..3.0,
        4 => 0.0..20.0,
        2 => (-25.0..0.0).prop_map(f64::exp),
    ];
    (0.01..1.6, restitution, 0.0..TAU, velocity)
}

/// Runs `property` on always the same launches; what fails is made smaller and printed, nothing is kept.
fn holds(property: impl Fn(Launch) -> Result<(), TestCaseError>) {
    let config = Config {
        cases: 2_000,
        failure_persistence: None,
        ..Config::default()
    };
    let seed = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let result = TestRunner::new_with_rng(config, seed).run(&launches(), property);
    if let Err(failure) = result {
        panic!("{failure}");
    }
}

#[test]
fn an_impact_follows_its_launch_on_the_track_and_nothing_came_before() {
    holds(|(k, restitution, phase, velocity)| {
        let state = State { phase, velocity };
        let impact = Map::build(k, restitution).unwrap().impact(state);
        let State {
            phase: next,
            velocity: speed,
        } = impact.next;
        prop_assert!(impact.flight >= 0.0 && speed >= 0.0 && (0.0..TAU).contains(&next));
        if impact.flight == 0.0 {
            prop_assert!(velocity == 0.0 && phase.sin() <= k + 1e-15);
            return Ok(());
        }
        let turns = (phase + impact.flight - next) / TAU;
        prop_assert!((turns - turns.round()).abs() < 1e-15 * (2.0 + impact.flight));
        let [height, slope, curvature] = gap(k, phase, velocity, impact.flight);
        let noise = rounding(k, phase, velocity, impact.flight);
        prop_assert!(height.abs() <= 16.0 * noise + f64::EPSILON * slope.abs() * impact.flight);
        // The slope is the arrival speed, but for what the rounding of a flight moves it.
        let moved = f64::EPSILON * (1.0 + impact.flight) * (1.0 + curvature.abs())
            + 64.0 * noise / slope.abs();
        prop_assert!((speed + restitution * slope).abs() <= 4.0 * moved);
        prop_assert!(impact.grazes || is_first(k, phase, velocity, impact.flight));
        Ok(())
    });
}

#[test]
fn a_faster_launch_lands_later() {
    // The gap at any time rises with the velocity, so its first zero does not come earlier.
    holds(|(k, restitution, phase, velocity)| {
        let map = Map::build(k, restitution).unwrap();
        let flight = |velocity| map.impact(State { phase, velocity }).flight;
        let (slower, faster) = (flight(velocity), flight(velocity * 1.01 + 1e-3));
        prop_assert!(faster > slower, "{faster} {slower}");
        Ok(())
    });
}

#[test]
fn velocity_after_is_restitution_times_the_arrival_speed() {
    fn check<K: Kernel>(launch: Launch, tolerance: f64) -> Result<(), TestCaseError> {
        let (k, restitution, phase, velocity) = launch;
        let state = K::state(phase, velocity).unwrap();
        let with = |restitution| {
            let impact = K::build(k, restitution).unwrap().impact(state);
            (impact.flight, K::observe(impact.next).velocity)
        };
        let (flight, elastic) = with(1.0);
        let (same, damped) = with(restitution);
        let (dead, stuck) = with(0.0);
        prop_assert!(flight == same && flight == dead && (stuck == 0.0 || flight == 0.0));
        prop_assert!(
            flight == 0.0 || (damped - restitution * elastic).abs() <= tolerance * (1.0 + elastic)
        );
        Ok(())
    }
    holds(|launch| {
        check::<Map>(launch, f64::EPSILON)?;
        check::<Exact>(launch, f64::EPSILON)?;
        check::<Hybrid>(launch, 2e-8)?;
        check::<Integer>(launch, 2e-8)?;
        check::<Single>(launch, 2e-7)
    });
}

#[test]
fn a_whole_turn_later_is_the_same_launch() {
    fn check<K: Kernel>((k, restitution, phase, velocity): Launch) -> Result<(), TestCaseError> {
        // On a step of the binary phase, and below 2 pi so much that adding turns keeps its digits.
        let phase = (phase * 1e8).round() * TAU * 2_f64.powi(-30);
        let kernel = K::build(k, restitution).unwrap();
        let here = K::state(phase, velocity).unwrap();
        for turns in [-3.0, 1.0, 5.0] {
            prop_assert_eq!(K::state(phase + turns * TAU, velocity).unwrap(), here);
        }
        let impact = kernel.impact(here);
        let (before, after) = (K::observe(here).phase, K::observe(impact.next).phase);
        prop_assert!((0.0..TAU).contains(&before) && (0.0..TAU).contains(&after));
        Ok(())
    }
    holds(|launch| {
        check::<Hybrid>(launch)?;
        check::<Integer>(launch)?;
        check::<Single>(launch)
    });
    holds(|(k, restitution, phase, velocity)| {
        let map = Map::build(k, restitution).unwrap();
        let here = map.impact(Map::state(phase, velocity).unwrap());
        let later = map.impact(Map::state(phase + TAU, velocity).unwrap());
        // The sum rounds to 9e-16; a phase moves the gap by at most 2 d.
        let arrival = (-gap(k, phase, velocity, here.flight)[1]).max(1e-9);
        let noise = rounding(k, phase, velocity, here.flight);
        let moved = (4e-15 * (1.0 + here.flight) + 32.0 * noise) / arrival;
        prop_assert!(arrival < 1e-4 || (here.flight - later.flight).abs() <= moved);
        Ok(())
    });
}

#[test]
fn a_lane_of_a_block_is_the_scalar_map_bit_for_bit() {
    let mut block = Block::new();
    let mut waiting: Vec<(Map, State)> = Vec::new();
    let cell = std::cell::RefCell::new((&mut block, &mut waiting));
    holds(|(k, restitution, phase, velocity)| {
        let mut held = cell.borrow_mut();
        let (block, waiting) = &mut *held;
        waiting.push((
            Map::build(k, restitution).unwrap(),
            State { phase, velocity },
        ));
        if waiting.len() < LANES {
            return Ok(());
        }
        for (lane, (map, state)) in waiting.iter().enumerate() {
            block.put(lane, map, *state).unwrap();
        }
        block.advance(1);
        for (lane, (map, state)) in waiting.drain(..).enumerate() {
            let impact = block.impact(lane).filter(|impact| impact.flight > 0.0);
            prop_assert!(
                impact.is_none_or(|impact| impact == map.impact(state)),
                "lane {lane}: {map:?} {state:?}"
            );
        }
        Ok(())
    });
}

#[test]
fn areas_shrink_by_restitution_squared() {
    holds(|(k, restitution, phase, velocity)| {
        let restitution = restitution.max(0.01);
        let map = Map::build(k, restitution).unwrap();
        let state = State { phase, velocity };
        let impact = map.impact(state);
        let Some(tangent) = Tangent::of(&map, state, &impact) else {
            return Ok(());
        };
        let expected = restitution * restitution * velocity / impact.next.velocity;
        let [[a, b], [c, d]] = tangent.jacobian;
        // A difference of products: 1e-12 of the larger, and what the flight's own rounding moves.
        let size = (a * d).abs() + (b * c).abs();
        prop_assert!(
            (tangent.determinant() - expected).abs() <= 1e-12 * size.max(expected),
            "{tangent:?} {expected}"
        );
        Ok(())
    });
}

#[test]
fn both_exponents_together_are_twice_the_logarithm_of_restitution() {
    holds(|(k, restitution, phase, velocity)| {
        let (k, restitution) = (0.05 + 0.3 * k, 0.8 + 0.2 * restitution);
        let map = Map::build(k, restitution).unwrap();
        let start = State {
            phase,
            velocity: 1.0 + velocity,
        };
        let mut growth = Growth::new(&map);
        let (mut state, mut impacts) = (start, 0.0);
        for _ in 0..40 {
            let impact = map.impact(state);
            if impact.flight == 0.0 || impact.next.velocity < 1e-3 {
                break;
            }
            growth.impact(state, &impact);
            state = impact.next;
            impacts += 1.0;
        }
        let Some([larger, smaller]) = growth.exponents() else {
            return Ok(());
        };
        let ends = (start.velocity / state.velocity).ln() / impacts;
        prop_assert!((larger + smaller - 2.0 * restitution.ln() - ends).abs() < 1e-12);
        Ok(())
    });
}
