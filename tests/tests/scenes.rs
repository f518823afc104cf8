//! One test per scene: the events are exactly the expected ones.

use kband::control::Event;
use kband::plant::Moment;
use kband_host::desk::Desk;
use kband_host::simulate::{Fidelity, Outcome, SceneFile, Watch};

fn run(name: &str) {
    let path = kband_tests::root()
        .join("tests/scenes")
        .join(name)
        .with_extension("toml");
    let text = std::fs::read_to_string(path).unwrap();
    let file = SceneFile::parse(&text).unwrap_or_else(|refusal| panic!("{refusal}"));
    let desk = Desk::new(Some(1)).unwrap();
    let come_to = |fidelity: Fidelity| {
        let outcome = Outcome::watched(&file, fidelity, Watch::KEPT, &desk)
            .unwrap_or_else(|refusal| panic!("{refusal}"));
        let unmet = outcome
            .unmet()
            .expect("a scene states what must come of it");
        assert!(
            unmet.is_empty(),
            "{}: {}",
            fidelity.name(),
            unmet.join("\n")
        );
        let most = 1.0001e-3 * file.scene.settings.amplitude_limit;
        for moment in outcome.moments() {
            let reference = moment.report.reference;
            assert!(reference <= most, "{reference} at {} s", moment.time);
        }
        outcome
    };
    let [envelope, waveform] = Fidelity::ALL.map(come_to);
    agree(&envelope, &waveform);
}

/// Drive cycles by which noise may shift a decision of one fidelity against the other.
const SHIFT: usize = 3;

/// The events with each row of kicks merged, and the end time of the first kick.
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

/// Both fidelities have the same events, and b within 1 % of its largest at every time.
///
/// A part that a kick missed bounces chaotically, and the last bit decides which later kick
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
    let until = if alike {
        f64::INFINITY
    } else {
        fast_first.min(slow_first)
    };
    let b = |moment: &Moment| f64::from(moment.report.amplitude);
    // Where the drive never runs, b is noise, and a ratio is meaningless.
    let safe = f64::from(waveform.file().scene.settings.safe_amplitude) * 1e-3;
    let largest = slow.iter().map(b).fold(safe, f64::max);
    let off = |n: usize| {
        // A kick that begins a few cycles apart is the same kick.
        let near = n.saturating_sub(SHIFT)..(n + SHIFT + 1).min(slow.len());
        let (low, high) = near
            .map(|n| b(&slow[n]))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), b| {
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
    // The regime of parts that never lock depends on the last bit; scenes about it expect it of
    // both.
    if waveform.is_locked() {
        assert_eq!(envelope.regime(), waveform.regime());
    }
}

macro_rules! scenes {
    ($($name:ident)+) => {
        $(#[test]
        fn $name() {
            run(stringify!($name));
        })+

        #[test]
        fn every_scene_has_its_test() {
            let listed = [$(stringify!($name)),+];
            for entry in std::fs::read_dir(kband_tests::root().join("tests/scenes")).unwrap() {
                let path = entry.unwrap().path();
                let name = path.file_stem().unwrap().to_string_lossy().into_owned();
                assert!(listed.contains(&name.as_str()), "{name} has no test");
            }
        }
    };
}

scenes! {
    acceleration_limit
    amplitude_limit
    amplitude_oscillates
    brown_out
    brown_out_stays_off
    chaotic
    deaf
    detuned
    doubled
    drawn_parts
    empty_band
    enable_in_stopping
    fault_at_rest
    fault_in_capture
    fault_in_holding
    fault_in_limiting
    fault_in_lost
    fault_in_stopping
    friction
    from_rest
    gain_drift
    hopper_dump
    identification
    identification_without_parts
    in_gear
    link_lost
    link_lost_in_capture
    link_lost_in_holding
    lock_lost
    lock_comes_back
    locked
    locked_order_2
    mains_ripple
    nan
    many_parts
    new_target
    no_common_chaos
    no_response
    not_captured
    output_limit
    outside_every_band
    over_amplitude
    over_current
    over_temperature
    over_temperature_in_start
    image_damaged
    repeated_resets
    resonance_tracking
    sensor_implausible
    second_tone_cut
    sensor_inverted
    sensor_lost
    sensor_saturated
    settings_invalid
    speed
    speed_of_no_lock
    stack_low
    supply_low
    clock_failed
    control_late
    stop_and_start
    stop_in_capture
    stop_in_holding
    stop_in_limiting
    stop_in_lost
    stop_in_start
    stop_in_sweep
    stopped
    target_in_capture
    target_in_holding
    target_in_limiting
    target_in_lost
    track_mass_unstable_gear
    track_mass_unstable_k
    watchdog_reset
    watchdog_reset_stays_off
}
