//! Properties of every impact, on launches drawn by proptest from a fixed seed.
//!
//! Each property takes the kernel as an argument. A broken kernel for each assertion shows that the
//! property can fail.

use std::f64::consts::TAU;

use kband::impact::{Hybrid, Impact, Integer, Kernel, Map, PartState, Single};
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

/// Result of a property for one launch.
type Said = Result<(), TestCaseError>;

/// A kernel with f64 states: the impact for k, restitution and state.
type Impacts<'a> = &'a dyn Fn(f64, f64, PartState) -> Impact<PartState>;

fn map(k: f64, restitution: f64, state: PartState) -> Impact<PartState> {
    Map::build(k, restitution).unwrap().impact(state)
}

/// The map with its impacts falsified.
fn spoilt(
    spoil: impl Fn(&mut Impact<PartState>),
) -> impl Fn(f64, f64, PartState) -> Impact<PartState> {
    move |k, restitution, state| {
        let mut impact = map(k, restitution, state);
        spoil(&mut impact);
        impact
    }
}

fn run(property: impl Fn(Launch) -> Said) -> Result<(), proptest::test_runner::TestError<Launch>> {
    let config = Config {
        cases: 2_000,
        failure_persistence: None,
        ..Config::default()
    };
    let seed = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    TestRunner::new_with_rng(config, seed).run(&launches(), property)
}

/// Runs `property` on fixed launches; a failure is shrunk and printed, nothing is stored.
fn holds(property: impl Fn(Launch) -> Said) {
    if let Err(failure) = run(property) {
        panic!("{failure}");
    }
}

/// Runs a `property` of a broken kernel on the same launches, until it fails.
fn fails(broken: &str, property: impl Fn(Launch) -> Said) {
    let found = std::cell::Cell::new(false);
    let result = run(|launch| {
        // After a failure every smaller launch passes, so there is nothing to shrink.
        let said = if found.get() {
            Ok(())
        } else {
            property(launch)
        };
        found.set(found.get() || said.is_err());
        said
    });
    assert!(result.is_err(), "{broken}: not caught");
}

fn lands_later((k, restitution, phase, velocity): Launch, impacts: Impacts) -> Said {
    // The gap increases with the velocity at any time, so its first zero does not come earlier.
    let flight = |velocity| impacts(k, restitution, PartState { phase, velocity }).flight;
    let (slower, faster) = (flight(velocity), flight(velocity * 1.01 + 1e-3));
    prop_assert!(faster > slower, "{faster} {slower}");
    Ok(())
}

#[test]
fn a_faster_launch_lands_later() {
    holds(|launch| lands_later(launch, &map));
    let earlier = spoilt(|i| i.flight = 1.0 / (1.0 + i.flight));
    fails("earlier", |launch| lands_later(launch, &earlier));
    let coarse = spoilt(|i| i.flight = (i.flight * 64.0).floor());
    fails("as late", |launch| lands_later(launch, &coarse));
}

/// Flight and velocity, for a restitution.
type Restituted<'a> = &'a dyn Fn(f64) -> (f64, f64);

fn restitutes(restitution: f64, tolerance: f64, with: Restituted) -> Said {
    let (flight, elastic) = with(1.0);
    let (same, damped) = with(restitution);
    let (dead, stuck) = with(0.0);
    prop_assert!(flight == same && flight == dead && (stuck == 0.0 || flight == 0.0));
    prop_assert!(
        flight == 0.0 || (damped - restitution * elastic).abs() <= tolerance * (1.0 + elastic)
    );
    Ok(())
}

#[test]
fn velocity_after_is_restitution_times_the_arrival_speed() {
    fn with<K: Kernel>((k, _, phase, velocity): Launch) -> impl Fn(f64) -> (f64, f64) {
        let state = K::state(phase, velocity).unwrap();
        move |restitution| {
            let impact = K::build(k, restitution).unwrap().impact(state);
            (impact.flight, K::observe(impact.next).velocity)
        }
    }
    holds(|launch| {
        restitutes(launch.1, f64::EPSILON, &with::<Map>(launch))?;
        restitutes(launch.1, 2e-8, &with::<Hybrid>(launch))?;
        restitutes(launch.1, 2e-8, &with::<Integer>(launch))?;
        restitutes(launch.1, 2e-7, &with::<Single>(launch))
    });
    fails("squared", |launch| {
        let with = with::<Map>(launch);
        restitutes(launch.1, f64::EPSILON, &|r| (with(r).0, with(r * r).1))
    });
    fails("a little lively", |launch| {
        let with = with::<Map>(launch);
        restitutes(launch.1, f64::EPSILON, &|r| (with(r).0, with(r).1 + 1e-9))
    });
    fails("a flight of its own", |launch| {
        let with = with::<Map>(launch);
        restitutes(launch.1, f64::EPSILON, &|r| {
            (with(r).0 * (1.0 + r * 1e-12), with(r).1)
        })
    });
}

/// `state` builds the kernel's state at a phase and a velocity.
fn wraps<K: Kernel>(
    (k, restitution, phase, velocity): Launch,
    state: &dyn Fn(f64, f64) -> K::State,
) -> Said {
    // On a step of the binary phase, and so far below 2 pi that adding turns keeps its digits.
    let phase = (phase * 1e8).round() * TAU * 2_f64.powi(-30);
    let kernel = K::build(k, restitution).unwrap();
    let here = state(phase, velocity);
    for turns in [-3.0, 1.0, 5.0] {
        prop_assert_eq!(state(phase + turns * TAU, velocity), here);
    }
    let impact = kernel.impact(here);
    let (before, after) = (K::observe(here).phase, K::observe(impact.next).phase);
    prop_assert!((0.0..TAU).contains(&before) && (0.0..TAU).contains(&after));
    Ok(())
}

#[test]
fn a_whole_turn_later_is_the_same_launch() {
    fn state<K: Kernel>(phase: f64, velocity: f64) -> K::State {
        K::state(phase, velocity).unwrap()
    }
    holds(|launch| {
        wraps::<Hybrid>(launch, &state::<Hybrid>)?;
        wraps::<Integer>(launch, &state::<Integer>)?;
        wraps::<Single>(launch, &state::<Single>)
    });
    fails("drifts", |launch| {
        wraps::<Single>(launch, &|phase, velocity| {
            state::<Single>(phase * (1.0 + 1e-9), velocity)
        })
    });
    fails("mirrored", |launch| {
        wraps::<Hybrid>(launch, &|phase, velocity| {
            state::<Hybrid>(phase.abs(), velocity)
        })
    });
}
