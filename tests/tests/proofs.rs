//! Mutation test of the scenes: each scene fails if the behaviour that it shows is broken.
//!
//! Together the scenes show every state transition, every fault and every limit.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use kband_control::{Cycle, Fault, Limits, Report, StartCause, State, TRANSITIONS, Target};
use kband_host::desk::Desk;
use kband_host::simulate::Outcome;
use kband_plant::{Change, Scene};
use kband_tests::broken::{Break, run};
use kband_tests::scenes::read;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Behaviour {
    Stops(Fault),
    Limit(Limits),
    /// The controller follows settings, target and inputs.
    Obeying,
    /// The controller uses its measurements of track and parts.
    Listening,
}
use Behaviour::{Limit, Listening, Obeying, Stops};
use Break::{Commanded, Hidden, Measured, Misconfigured, Never, Nothing, Restarted};
use Fault::*;
use StartCause::Ordinary;

const DEAF: fn(&mut Cycle) = |cycle| cycle.impacts.clear();
const UNAVERAGED: fn(&mut Cycle) = |cycle| cycle.average.residual.fill(0.01);
const UNSATURATED: fn(&mut Cycle) = |cycle| cycle.saturated = 0;

/// Output that the drive would need at a gain of 1 mm, the configured one.
const UNCONTROLLED: fn(&mut Report) = |report| report.command.amplitude = 1e3 * report.reference;

const FORGET_RESET: fn(&mut Scene) = |scene| scene.start = Ordinary;
const NARROW_LOT: fn(&mut Scene) = |scene| set_lot(scene, 0.199, 0.201);
const LIVELIER_LOT: fn(&mut Scene) = |scene| set_lot(scene, 0.24, 0.27);
const FIXED_FREQUENCY: fn(&mut Scene) = |scene| scene.settings.tracking = 0.0;
const NO_KICKS: fn(&mut Scene) = |scene| scene.settings.capture_attempts = 0.0;
const ANOTHER_TARGET: fn(&mut Scene) = |scene| scene.target = Target::K(0.5);
/// Configures a track that is too heavy, which falsifies the estimated mass.
const HEAVIER: fn(&mut Scene) = |scene| scene.settings.track_mass *= 4.0 / 3.0;
/// Configures a drive at its resonance.
const TUNED: fn(&mut Scene) = |scene| scene.settings.resonance = scene.settings.frequency;
const NO_LIMITS: fn(&mut Scene) = |scene| {
    scene.settings.amplitude_limit = 100.0;
    scene.settings.acceleration_limit = 1000.0;
};

fn set_lot(scene: &mut Scene, low: f32, high: f32) {
    let settings = &mut scene.settings;
    (settings.restitution_low, settings.restitution_high) = (low, high);
}

macro_rules! table {
    ($($name:ident: $behaviour:expr, $how:expr;)+) => {
        /// Each scene, the behaviour that it shows, and the break.
        const PROOFS: &[(&str, Behaviour, Break)] = &[$((stringify!($name), $behaviour, $how)),+];
    };
}
kband_tests::all_scenes!(table);

/// The scenes without an injected fault, in the order of the proofs, run once for all tests.
fn sound() -> &'static [Outcome] {
    static ALL: OnceLock<Vec<Outcome>> = OnceLock::new();
    ALL.get_or_init(|| {
        let scene = |n: usize| run(&read(PROOFS[n].0), Nothing);
        let desk = Desk::new(None);
        desk.map("scenes", PROOFS.len(), scene).unwrap()
    })
}

fn expected(outcome: &Outcome) -> bool {
    outcome.unmet().expect("every scene expects").is_empty()
}

fn is_shown(behaviour: Behaviour, outcome: &Outcome) -> bool {
    let mut reports = outcome.moments().iter().map(|moment| moment.report);
    match behaviour {
        Stops(fault) => reports.any(|report| report.fault == Some(fault)),
        Limit(limit) => reports.any(|report| report.limits.contains(limit)),
        Obeying | Listening => true,
    }
}

fn changes(outcome: &Outcome) -> BTreeSet<(u8, u8)> {
    let states = outcome.moments().iter().map(|moment| moment.report.state);
    let states: Vec<u8> = states.map(State::number).collect();
    let pairs = states.windows(2).map(|pair| (pair[0], pair[1]));
    // Before the first cycle of an ordinary start the state is off.
    let first = states.first().map(|&first| (State::Off.number(), first));
    let ordinary = outcome.file().scene.start == Ordinary;
    let pairs = pairs.chain(first.filter(|_| ordinary));
    pairs.filter(|(from, to)| from != to).collect()
}

fn describe_change((from, to): (u8, u8)) -> String {
    let name = |number: u8| State::ALL[usize::from(number)].name();
    format!("{} to {}", name(from), name(to))
}

#[test]
fn each_scene_fails_under_its_injected_fault() {
    let mut wrong = Vec::new();
    for (&(name, behaviour, how), sound) in PROOFS.iter().zip(sound()) {
        if !expected(sound) || !is_shown(behaviour, sound) {
            wrong.push(format!("{name} does not show {behaviour:?}"));
        }
        let broken = run(sound.file(), how);
        if matches!(behaviour, Stops(_) | Limit(_)) && is_shown(behaviour, &broken) {
            wrong.push(format!("{name} shows {behaviour:?} in spite of {how:?}"));
        }
        if expected(&broken) {
            wrong.push(format!("{name} does not notice {how:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn each_state_change_has_a_scene_that_fails_without_it() {
    let mut scenes: Vec<&Outcome> = sound().iter().collect();
    // Shortest scenes first: each transition is assigned to the first scene that fails without it.
    scenes.sort_by_key(|outcome| outcome.moments().len());
    let mut made = BTreeSet::new();
    let mut proven = BTreeSet::new();
    for outcome in scenes {
        for (from, to) in changes(outcome) {
            made.insert((from, to));
            let state = |number: u8| State::ALL[usize::from(number)];
            let never = Never(state(from), state(to));
            if !proven.contains(&(from, to)) && !expected(&run(outcome.file(), never)) {
                proven.insert((from, to));
            }
        }
    }
    let drawn = TRANSITIONS.map(|change| (change.from.number(), change.to.number()));
    for change in drawn {
        let what = describe_change(change);
        assert!(made.contains(&change), "no scene goes from {what}");
        assert!(proven.contains(&change), "no scene misses {what}");
    }
    let undrawn = made.into_iter().filter(|change| !drawn.contains(change));
    let undrawn: Vec<String> = undrawn.map(describe_change).collect();
    assert!(undrawn.is_empty(), "not in the state table: {undrawn:?}");
}

#[test]
fn the_proofs_are_those_of_all_scenes_faults_and_limits() {
    for entry in std::fs::read_dir(kband_tests::root().join("tests/scenes")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|ending| ending == "toml") {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            let proven = PROOFS.iter().any(|(scene, ..)| *scene == name);
            assert!(proven, "{name} has no proof");
        }
    }
    let behaviour = |searched| PROOFS.iter().any(|(_, shown, _)| *shown == searched);
    for &fault in Fault::ALL {
        assert!(behaviour(Stops(fault)), "no scene shows {}", fault.name());
    }
    for limit in Limits::ALL {
        assert!(behaviour(Limit(limit)), "no scene shows {}", limit.name());
    }
}

#[test]
fn a_withdrawn_enable_is_obeyed_within_one_cycle() {
    let mut times = 0;
    for (&(name, ..), outcome) in PROOFS.iter().zip(sound()) {
        for disturbance in &outcome.file().scene.disturbances {
            if disturbance.change != Change::Enable(false) {
                continue;
            }
            // The cycle with the withdrawal ends at the first moment after it.
            let at = disturbance.at;
            let mut after = outcome.moments().iter().filter(|moment| moment.time > at);
            let state = after.next().map(|moment| moment.report.state);
            let obeyed = matches!(state, Some(State::Off | State::Stopping | State::Fault));
            assert!(obeyed, "{name} at {at} s: {state:?}");
            times += 1;
        }
    }
    assert!(times >= 12, "{times}");
}
