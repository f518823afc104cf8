//! One test per scene: the events are exactly the expected ones, and the trace keeps its bits. What
//! is not read is not computed, and changes no bit of the rest.

use std::fmt::Write;
use std::sync::Mutex;

use kband_control::Event;
use kband_control::wire::crc32;
use kband_host::desk::Desk;
use kband_host::simulate::{Fidelity, Outcome, Watch, run_watched};
use kband_plant::Moment;
use kband_tests::scenes;

fn run(name: &str) {
    let file = scenes::read(name);
    let desk = Desk::new(Some(1));
    let run_fidelity = |fidelity: Fidelity| {
        let watched = |watch| {
            run_watched(&file, fidelity, watch, &desk).unwrap_or_else(|refusal| panic!("{refusal}"))
        };
        let outcome = watched(Watch::ALL_CYCLES);
        assert_eq!(results(&watched(Watch::default())), results(&outcome));
        let unmet = outcome.unmet().expect("every scene expects");
        assert!(unmet.is_empty(), "{fidelity:?}: {}", unmet.join("\n"));
        let upper_limit = 1.0001e-3 * file.scene.settings.amplitude_limit;
        for moment in outcome.moments() {
            let reference = moment.report.reference;
            assert!(reference <= upper_limit, "{reference} at {} s", moment.time);
        }
        outcome
    };
    let [envelope, waveform] = Fidelity::ALL.map(run_fidelity);
    agree(&envelope, &waveform);
    let [envelope, waveform] = [envelope, waveform].map(|outcome| checksum(&outcome));
    keeps_bits(name, &format!("{name}: {envelope:08x} {waveform:08x}"));
}

/// What a run finds out without a reader of its cycles; speed is summed from another origin.
fn results(outcome: &Outcome) -> String {
    let (last, record) = (outcome.last(), outcome.record());
    let events: Vec<_> = outcome.events().map(|it| it.event).collect();
    let (shares, estimated) = (outcome.in_gear(), record.in_gear_estimated());
    let (state, command, speed) = (last.state, last.command, outcome.speed());
    format!("{events:?} {state:?} {command:?} {shares:?} {estimated:?} {speed:.12}")
}

/// Checksum of what a run records in every cycle.
fn checksum(outcome: &Outcome) -> u32 {
    let mut text = String::new();
    for moment in outcome.moments() {
        write!(text, "{moment:?}").unwrap();
    }
    crc32(text.as_bytes())
}

/// Compares a scene's line with the accepted one. `KBAND_ACCEPT=1` replaces it.
fn keeps_bits(name: &str, line: &str) {
    static FILE: Mutex<()> = Mutex::new(());
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/reference/scene_bits.txt");
    let accepts = std::env::var_os("KBAND_ACCEPT").is_some();
    let file = FILE.lock().unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    let accepted = |other: &&str| other.split(':').next() == Some(name);
    if !accepts {
        drop(file);
        assert_eq!(
            Some(line),
            text.lines().find(accepted),
            "reference/scene_bits.txt"
        );
        return;
    }
    let mut lines: Vec<_> = text.lines().filter(|other| !accepted(other)).collect();
    lines.push(line);
    lines.sort_unstable();
    std::fs::write(path, lines.join("\n") + "\n").unwrap();
}

/// Number of drive cycles by which noise may shift a decision of one fidelity against the other.
const MAX_SHIFT_CYCLES: usize = 3;

/// Events with consecutive kicks merged, and the end time of the first kick.
fn kicks_as_one(outcome: &Outcome) -> (Vec<Event>, f64) {
    let (mut events, mut first) = (Vec::new(), f64::INFINITY);
    for happened in outcome.events() {
        if happened.event == Event::KickEnded {
            first = first.min(happened.time);
        }
        let kick = [Event::KickBegun, Event::KickEnded];
        if !(kick.contains(&happened.event) && events.contains(&happened.event)) {
            events.push(happened.event);
        }
    }
    (events, first)
}

/// Both fidelities have the same events, and the same b within 1 % of its largest value at every
/// time. A part that a kick missed bounces chaotically, and the last bit decides which later kick
/// captures it. If the kicks differ, the comparison ends after the first kick, and only the final
/// states must agree.
fn agree(envelope: &Outcome, waveform: &Outcome) {
    let (fast, slow) = (envelope.moments(), waveform.moments());
    assert_eq!(fast.len(), slow.len());
    let events =
        |outcome: &Outcome| -> Vec<_> { outcome.events().map(|happened| happened.event).collect() };
    let alike = events(envelope) == events(waveform);
    let [(fast_events, fast_first), (slow_events, slow_first)] =
        [envelope, waveform].map(kicks_as_one);
    assert_eq!(fast_events, slow_events);
    let first = fast_first.min(slow_first);
    let until = if alike { f64::INFINITY } else { first };
    let b = |moment: &Moment| f64::from(moment.report.amplitude);
    // If the drive never runs, b is noise, and a ratio has no meaning.
    let safe = f64::from(waveform.file().scene.settings.safe_amplitude) * 1e-3;
    let largest = slow.iter().map(b).fold(safe, f64::max);
    let off = |n: usize| {
        // A kick that starts a few cycles earlier or later is the same kick.
        let near = n.saturating_sub(MAX_SHIFT_CYCLES)..(n + MAX_SHIFT_CYCLES + 1).min(slow.len());
        let near = near.map(|n| b(&slow[n]));
        let (low, high) = near.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), b| {
            (low.min(b), high.max(b))
        });
        (b(&fast[n]) - high).max(low - b(&fast[n])).max(0.0) / largest
    };
    let (worst, when) = (0..fast.len())
        .filter(|&n| fast[n].time < until)
        .map(|n| (off(n), fast[n].time))
        .fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a });
    assert!(worst < 0.01, "b is {worst} off at {when} s");
    assert_eq!(envelope.last().state, waveform.last().state);
    assert_eq!(envelope.last().fault, waveform.last().fault);
    assert_eq!(envelope.limits(), waveform.limits());
    // The regime of parts that never lock depends on the last bit. Scenes about such a regime
    // expect it at both fidelities.
    if waveform.is_locked() {
        assert_eq!(envelope.regime(), waveform.regime());
    }
}

macro_rules! test_each {
    ($($name:ident: $shows:expr, $how:expr;)+) => {
        $(#[test]
        fn $name() {
            run(stringify!($name));
        })+
    };
}
kband_tests::all_scenes!(test_each);
