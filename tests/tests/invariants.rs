//! Properties of every impact, on launches drawn by proptest from a fixed seed.
//!
//! Each property takes the kernel as an argument. A broken kernel for each assertion shows that the
//! property can fail.

use std::f64::consts::TAU;

use kband::impact::batch::{Block, LANES};
use kband::impact::{
    Growth, Hybrid, Impact, Integer, Kernel, Map, Observer, PartState, Single, Tangent,
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

fn comes_first((k, restitution, phase, velocity): Launch, impacts: Impacts) -> Said {
    let state = PartState { phase, velocity };
    let impact = impacts(k, restitution, state);
    let PartState {
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
    // The slope is the arrival speed, but for the effect of a flight's rounding.
    let moved =
        f64::EPSILON * (1.0 + impact.flight) * (1.0 + curvature.abs()) + 64.0 * noise / slope.abs();
    prop_assert!((speed + restitution * slope).abs() <= 4.0 * moved);
    prop_assert!(impact.grazes || is_first(k, phase, velocity, impact.flight));
    Ok(())
}

/// A kernel that skips the first impact and returns the next zero of the gap, if there is one.
fn passes_the_first(k: f64, restitution: f64, state: PartState) -> Impact<PartState> {
    let first = map(k, restitution, state);
    let PartState { phase, velocity } = state;
    let height = |d: f64| gap(k, phase, velocity, d)[0];
    let later = (1..2_000).map(|n| first.flight + 0.01 * f64::from(n));
    let Some(end) = later
        .clone()
        .zip(later.skip(1))
        .find(|(a, b)| height(*a) > 0.0 && height(*b) <= 0.0)
    else {
        return first;
    };
    let (mut above, mut below) = end;
    for _ in 0..60 {
        let middle = 0.5 * (above + below);
        if height(middle) > 0.0 {
            above = middle;
        } else {
            below = middle;
        }
    }
    let speed = -restitution * gap(k, phase, velocity, below)[1];
    Impact {
        flight: below,
        next: Map::state(phase + below, speed.max(0.0)).unwrap(),
        grazes: false,
    }
}

#[test]
fn an_impact_follows_its_launch_on_the_track_and_nothing_came_before() {
    holds(|launch| comes_first(launch, &map));
    let broken: [(&str, Impacts); 9] = [
        ("back in time", &spoilt(|i| i.flight = -i.flight)),
        (
            "negative velocity",
            &spoilt(|i| i.next.velocity = -i.next.velocity),
        ),
        ("a phase beyond the turn", &spoilt(|i| i.next.phase += TAU)),
        ("no flight", &spoilt(|i| i.flight = 0.0)),
        (
            "the phase of another flight",
            &spoilt(|i| i.next.phase *= 1.0 - 1e-12),
        ),
        (
            "off the track",
            &spoilt(|i| {
                i.flight += 1e-11;
                i.next.phase = (i.next.phase + 1e-11).min(TAU.next_down());
            }),
        ),
        ("too fast", &spoilt(|i| i.next.velocity *= 1.0 + 1e-9)),
        ("a later root", &passes_the_first),
        ("no number", &spoilt(|i| i.flight = f64::NAN)),
    ];
    for (name, impacts) in broken {
        fails(name, |launch| comes_first(launch, impacts));
    }
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

fn recurs((k, restitution, phase, velocity): Launch, impacts: Impacts) -> Said {
    let here = impacts(k, restitution, Map::state(phase, velocity).unwrap());
    let later = impacts(k, restitution, Map::state(phase + TAU, velocity).unwrap());
    // The sum rounds to 9e-16; a phase moves the gap by at most 2 d.
    let arrival = (-gap(k, phase, velocity, here.flight)[1]).max(1e-9);
    let noise = rounding(k, phase, velocity, here.flight);
    let moved = (4e-15 * (1.0 + here.flight) + 32.0 * noise) / arrival;
    prop_assert!(arrival < 1e-4 || (here.flight - later.flight).abs() <= moved);
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
    holds(|launch| recurs(launch, &map));
    // A kernel that depends on the last digits of a wrapped phase.
    fails("restless", |launch| {
        recurs(launch, &|k, restitution, state| {
            let last = (state.phase.to_bits() % 8) as f64;
            map(
                k,
                restitution,
                PartState {
                    velocity: state.velocity + 1e-11 * last,
                    ..state
                },
            )
        })
    });
}

/// Whether the lanes of a block are the impacts of a scalar kernel, bit for bit.
struct Lanes<'a> {
    block: Block,
    waiting: Vec<(Map, PartState)>,
    impacts: Impacts<'a>,
}

impl<'a> Lanes<'a> {
    fn against(impacts: Impacts<'a>) -> std::cell::RefCell<Self> {
        std::cell::RefCell::new(Self {
            block: Block::new(),
            waiting: Vec::new(),
            impacts,
        })
    }

    /// Adds a launch; a full block is tested as a whole.
    fn take(&mut self, (k, restitution, phase, velocity): Launch) -> Said {
        let state = PartState { phase, velocity };
        self.waiting
            .push((Map::build(k, restitution).unwrap(), state));
        if self.waiting.len() < LANES {
            return Ok(());
        }
        for (lane, (map, state)) in self.waiting.iter().enumerate() {
            self.block.put(lane, map, *state).unwrap();
        }
        self.block.advance(1);
        for (lane, (map, state)) in self.waiting.drain(..).enumerate() {
            let impact = self.block.impact(lane).filter(|impact| impact.flight > 0.0);
            let alone = (self.impacts)(map.k(), map.restitution(), state);
            prop_assert!(
                impact.is_none_or(|impact| impact == alone),
                "lane {lane}: {map:?} {state:?}"
            );
        }
        Ok(())
    }
}

#[test]
fn a_lane_of_a_block_is_the_scalar_map_bit_for_bit() {
    let lanes = Lanes::against(&map);
    holds(|launch| lanes.borrow_mut().take(launch));
    let last_bit = |value: &mut f64| *value = value.next_up();
    let broken: [(&str, Impacts); 3] = [
        ("flight", &spoilt(|i| last_bit(&mut i.flight))),
        ("phase", &spoilt(|i| last_bit(&mut i.next.phase))),
        ("velocity", &spoilt(|i| last_bit(&mut i.next.velocity))),
    ];
    for (name, impacts) in broken {
        let lanes = Lanes::against(impacts);
        fails(name, |launch| lanes.borrow_mut().take(launch));
    }
}

/// `spoil` falsifies the tangent map.
fn shrinks((k, restitution, phase, velocity): Launch, spoil: &dyn Fn(&mut Tangent)) -> Said {
    let restitution = restitution.max(0.01);
    let map = Map::build(k, restitution).unwrap();
    let state = PartState { phase, velocity };
    let impact = map.impact(state);
    let Some(mut tangent) = Tangent::of(&map, state, &impact) else {
        return Ok(());
    };
    spoil(&mut tangent);
    let expected = restitution * restitution * velocity / impact.next.velocity;
    let [[a, b], [c, d]] = tangent.jacobian;
    // A difference of products: 1e-12 of the larger, and the effect of the flight's rounding.
    let size = (a * d).abs() + (b * c).abs();
    prop_assert!(
        (tangent.determinant() - expected).abs() <= 1e-12 * size.max(expected),
        "{tangent:?} {expected}"
    );
    Ok(())
}

#[test]
fn areas_shrink_by_restitution_squared() {
    holds(|launch| shrinks(launch, &|_| {}));
    for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        fails("an entry", |launch| {
            shrinks(launch, &|tangent| {
                tangent.jacobian[row][column] *= 1.0 + 1e-10
            })
        });
    }
}

/// `impacts` is the observer's input.
fn adds_up((k, restitution, phase, velocity): Launch, impacts: Impacts) -> Said {
    let (k, restitution) = (0.05 + 0.3 * k, 0.8 + 0.2 * restitution);
    let map = Map::build(k, restitution).unwrap();
    let start = PartState {
        phase,
        velocity: 1.0 + velocity,
    };
    let mut growth = Growth::new(&map);
    let (mut state, mut seen) = (start, 0.0);
    for _ in 0..40 {
        let impact = map.impact(state);
        if impact.flight == 0.0 || impact.next.velocity < 1e-3 {
            break;
        }
        growth.impact(state, &impacts(k, restitution, state));
        state = impact.next;
        seen += 1.0;
    }
    let Some([larger, smaller]) = growth.exponents() else {
        return Ok(());
    };
    let ends = (start.velocity / state.velocity).ln() / seen;
    prop_assert!((larger + smaller - 2.0 * restitution.ln() - ends).abs() < 1e-12);
    Ok(())
}

#[test]
fn both_exponents_together_are_twice_the_logarithm_of_restitution() {
    holds(|launch| adds_up(launch, &map));
    let slower = spoilt(|i| i.next.velocity *= 1.0 - 1e-9);
    fails("slower", |launch| adds_up(launch, &slower));
    fails("less lively", |launch| {
        adds_up(launch, &|k, restitution, state| {
            map(k, restitution * (1.0 - 1e-9), state)
        })
    });
}
