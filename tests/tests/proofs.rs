//! Each scene fails when the behaviour that it shows is broken (mutation test of the scenes).
//!
//! Together the scenes show every change of state, every fault and every limit.

use std::collections::BTreeSet;

use kband_control::{Cycle, Fault, Limits, Report, StartCause, State, TRANSITIONS, Target};
use kband_host::simulate::Outcome;
use kband_plant::{Change, Scene};
use kband_tests::broken::{Break, run};
use kband_tests::scenes::read;

/// Behaviour that a scene shows.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shows {
    /// This fault stops the drive.
    Stops(Fault),
    /// This limit restricts the drive.
    Limit(Limits),
    /// The controller follows settings, target and inputs.
    Obeying,
    /// The controller uses its measurements of track and parts.
    Listening,
}
use Break::{Done, Hidden, Never, Nothing, Restarted, Seen, Told};
use Fault::*;
use Shows::{Limit, Listening, Obeying, Stops};
use StartCause::Ordinary;

/// Functions that recognise the changes that a break hides.
macro_rules! recognise {
    ($($name:ident: $change:ident,)+) => {
        $(fn $name(change: &Change) -> bool {
            matches!(change, Change::$change(_))
        })+
    };
}
recognise! {
    enable: Enable,
    gain: Gain,
    hot: OverTemperature,
    link: Link,
    lost: SensorLost,
    inverted: SensorInverted,
    stack: StackLow,
    over_current: OverCurrent,
    supply: SupplyLow,
    clock: ClockFailed,
    late: ControlLate,
    sensitivity: Sensitivity,
    target: Target,
    parts: Restitution,
    presence: Parts,
}

fn deaf(cycle: &mut Cycle) {
    cycle.deafen();
}
fn unfolded(cycle: &mut Cycle) {
    cycle.flatten(0.01);
}
fn unsaturated(cycle: &mut Cycle) {
    cycle.saturated = 0;
}

/// The output that the drive would need if its gain were the configured one, 1 mm.
fn uncontrolled(report: &mut Report) {
    report.command.amplitude = 1e3 * report.reference;
}

fn forget_reset(scene: &mut Scene) {
    scene.start = Ordinary;
}
fn narrow_lot(scene: &mut Scene) {
    scene.settings.restitution_low = 0.199;
    scene.settings.restitution_high = 0.201;
}
fn livelier_lot(scene: &mut Scene) {
    scene.settings.restitution_low = 0.24;
    scene.settings.restitution_high = 0.27;
}
fn fixed_frequency(scene: &mut Scene) {
    scene.settings.tracking = 0.0;
}
fn no_kicks(scene: &mut Scene) {
    scene.settings.capture_attempts = 0.0;
}
fn another_target(scene: &mut Scene) {
    scene.target = Target::K(0.5);
}
/// A track configured heavier than it is, which falsifies the weighed mass.
fn heavier(scene: &mut Scene) {
    scene.settings.track_mass *= 4.0 / 3.0;
}
/// A drive configured as if at its resonance.
fn tuned(scene: &mut Scene) {
    scene.settings.resonance = scene.settings.frequency;
}
fn no_limits(scene: &mut Scene) {
    scene.settings.amplitude_limit = 100.0;
    scene.settings.acceleration_limit = 1000.0;
}

macro_rules! table {
    ($($name:ident: $shows:expr, $how:expr;)+) => {
        /// Each scene, the behaviour that it shows, and the break.
        const PROOFS: &[(&str, Shows, Break)] = &[$((stringify!($name), $shows, $how)),+];
    };
}
kband_tests::all_scenes!(table);

/// Whether the outcome is that of the scene's expectations.
fn expected(outcome: &Outcome) -> bool {
    outcome.unmet().expect("every scene expects").is_empty()
}

/// Whether an outcome shows the behaviour.
fn shown(shows: Shows, outcome: &Outcome) -> bool {
    let mut reports = outcome.moments().iter().map(|moment| moment.report);
    match shows {
        Stops(fault) => reports.any(|report| report.fault == Some(fault)),
        Limit(limit) => reports.any(|report| report.limits.contains(limit)),
        Obeying | Listening => true,
    }
}

/// The changes of state in an outcome.
fn changes(outcome: &Outcome) -> BTreeSet<(u8, u8)> {
    let states = outcome.moments().iter().map(|moment| moment.report.state);
    let states: Vec<u8> = states.map(State::number).collect();
    let pairs = states.windows(2).map(|pair| (pair[0], pair[1]));
    // Before the first cycle an ordinary start is off.
    let first = states.first().map(|&first| (State::Off.number(), first));
    let ordinary = outcome.file().scene.start == Ordinary;
    pairs
        .chain(first.filter(|_| ordinary))
        .filter(|(from, to)| from != to)
        .collect()
}

fn words((from, to): (u8, u8)) -> String {
    let name = |number: u8| State::ALL[usize::from(number)].name();
    format!("{} to {}", name(from), name(to))
}

#[test]
fn each_scene_fails_where_what_it_shows_is_broken() {
    let mut wrong = Vec::new();
    for &(name, shows, how) in PROOFS {
        let file = read(name);
        let sound = run(&file, Nothing);
        if !expected(&sound) || !shown(shows, &sound) {
            wrong.push(format!("{name} does not show {shows:?}"));
        }
        let broken = run(&file, how);
        if matches!(shows, Stops(_) | Limit(_)) && shown(shows, &broken) {
            wrong.push(format!("{name} shows {shows:?} in spite of {how:?}"));
        }
        if expected(&broken) {
            wrong.push(format!("{name} does not notice {how:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn each_state_change_has_a_scene_that_fails_without_it() {
    let mut scenes: Vec<Outcome> = PROOFS
        .iter()
        .map(|(name, ..)| run(&read(name), Nothing))
        .collect();
    // The shortest first: each change is proven by the first scene that fails without it.
    scenes.sort_by_key(|outcome| outcome.moments().len());
    let mut made = BTreeSet::new();
    let mut proven = BTreeSet::new();
    for outcome in &scenes {
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
        let what = words(change);
        assert!(made.contains(&change), "no scene goes from {what}");
        assert!(proven.contains(&change), "no scene misses {what}");
    }
    let undrawn = made.into_iter().filter(|change| !drawn.contains(change));
    let undrawn: Vec<String> = undrawn.map(words).collect();
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
    let shows = |wanted: Shows| PROOFS.iter().any(|(_, shows, _)| *shows == wanted);
    for &fault in Fault::ALL {
        assert!(shows(Stops(fault)), "no scene shows {}", fault.name());
    }
    for limit in Limits::ALL {
        assert!(shows(Limit(limit)), "no scene shows {}", limit.name());
    }
}

#[test]
fn a_withdrawn_enable_is_obeyed_within_one_cycle() {
    let mut times = 0;
    for &(name, ..) in PROOFS {
        let outcome = run(&read(name), Nothing);
        let scene = &outcome.file().scene;
        for disturbance in &scene.disturbances {
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
