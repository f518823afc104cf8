//! A shortened day: no fault without an injected one, and recovery after each event.
//!
//! Events: other parts, a drive that warms up, pauses, a lost link, an accelerometer with a loose
//! plug.
//!
//! `KBAND_DAYS` selects whole days, in the envelope from the second day on.

use std::collections::BTreeMap;

use kband_control::{Event, Fault, Limits, SAMPLE_RATE, State};
use kband_plant::{Change, Moment, Scene};
use kband_scene::{Engine, Fidelity};
use kband_tests::number;
use kband_tests::states::Random;

/// Longest time after an event in which parts of the lot may be out of lock, s. It includes a start
/// with its sweep, the soft start and eight kicks of 2 s each.
const RELOCK_TIMEOUT: f64 = 20.0;

/// Results by kind of event.
#[derive(Clone, Debug, Default)]
struct Shift {
    cycles: u64,
    locked: u64,
    happened: BTreeMap<&'static str, u32>,
    last_cycle: u32,
    wrong: Vec<String>,
}

impl Shift {
    fn look(&mut self, moment: &Moment, now: f64, upset: f64, may_fault: Option<f64>) {
        let report = &moment.report;
        let mut wrong = Vec::new();
        self.cycles += 1;
        // Exact: whole turns of the phase over its step per sample, plus one sample for the wrap.
        let samples = f64::from(report.cycle) * 4_294_967_296.0 / f64::from(report.command.step);
        let off = (moment.time - samples / f64::from(SAMPLE_RATE)).abs();
        // Two samples: one for the position of a wrap, one for its detection.
        if off > 2.01 / 20_000.0 {
            wrong.push(format!("{off} s between time and count of cycles"));
        }
        if report.cycle != self.last_cycle.wrapping_add(1) {
            wrong.push(format!("cycle {} after {}", report.cycle, self.last_cycle));
        }
        self.last_cycle = report.cycle;
        for event in report.events.iter() {
            let name = event.name();
            *self.happened.entry(name).or_default() += 1;
            let injected = may_fault.is_some_and(|at| now < at + 0.2);
            if event == Event::Faulted && (!injected || report.fault != Some(Fault::SensorLost)) {
                wrong.push(format!("{:?}", report.fault));
            }
            if event == Event::NotCaptured {
                wrong.push("not captured".into());
            }
        }
        if report.limits.contains(Limits::NO_SETPOINT) || report.limits.contains(Limits::OUTPUT) {
            wrong.push(format!("limits {:#06x}", report.limits.bits()));
        }
        if report.state == State::Locked {
            self.locked += 1;
        } else if now > upset + RELOCK_TIMEOUT {
            let (state, since) = (report.state, now - upset);
            wrong.push(format!("{state:?} {since:.1} s after the last trouble"));
        }
        let timed = |what| format!("at {now:.2} s: {what}");
        self.wrong.extend(wrong.into_iter().map(timed));
    }
}

/// Name of the event after which the board may report a lost sensor.
const LOST_SENSOR: &str = "lost sensor";

/// Changes over some seconds of operation with their times in s. The first change of an event has its
/// name.
fn script(seconds: f64) -> Vec<(f64, Option<&'static str>, Change)> {
    let mut random = Random::new(1);
    let (mut script, mut now) = (Vec::new(), 30.0);
    while now < seconds - 60.0 {
        let next = now + random.between(30.0, 120.0);
        let kind = random.bits() % 8;
        // For some seconds another state, then its return.
        let mut spell = |low: f64, high: f64, change: fn(bool) -> Change, on: bool| {
            let end = random.between(low, high);
            vec![(0.0, change(on)), (end, change(!on))]
        };
        let (name, changes) = match kind {
            0..3 => {
                let part = random.between(0.18, 0.22) as f32;
                ("other parts", vec![(0.0, Change::Restitution(part))])
            }
            // At most two cycles, from any start; no fault.
            3..5 => (
                "short drop-out",
                spell(0.01, 0.039, Change::SensorLost, true),
            ),
            5 => {
                let changes = vec![
                    (0.0, Change::SensorLost(true)),
                    (1.0, Change::SensorLost(false)),
                    (2.0, Change::Enable(false)),
                    (3.0, Change::Enable(true)),
                ];
                (LOST_SENSOR, changes)
            }
            6 => ("pause", spell(0.02, 8.0, Change::Enable, false)),
            _ => ("silent link", spell(0.5, 8.0, Change::Link, false)),
        };
        let mut name = Some(name);
        let changes = changes.into_iter();
        script.extend(changes.map(|(after, change)| (now + after, name.take(), change)));
        now = next;
    }
    script
}

/// The drive's gain follows the temperature through the day by +-20 %, with a ripple of minutes.
fn gain(now: f64, seconds: f64) -> Change {
    let turn = std::f64::consts::TAU * now;
    let day = 0.17 * (turn / 86_400.0_f64.min(seconds)).sin();
    Change::Gain((1.0 + day + 0.03 * (turn / 97.0).sin()) as f32)
}

/// Runs `seconds` of operation of the default feeder.
fn operate(seconds: f64, fidelity: Fidelity) -> Shift {
    let mut closed = Engine::build(&Scene::default(), fidelity).unwrap();
    closed.watch(true);
    let mut script = script(seconds).into_iter().peekable();
    let mut shift = Shift::default();
    let mut now = 0.0;
    let (mut upset, mut may_fault) = (0.0, None);
    while now < seconds && shift.wrong.len() <= 20 {
        closed.apply(gain(now, seconds));
        while let Some((_, name, change)) = script.next_if(|(at, ..)| *at <= now) {
            upset = now;
            if let Some(name) = name {
                *shift.happened.entry(name).or_default() += 1;
                may_fault = (name == LOST_SENSOR).then_some(now);
            }
            closed.apply(change);
        }
        closed.cycle().unwrap();
        let moment = closed.moment().unwrap();
        now = f64::from(moment.report.cycle) / f64::from(moment.report.frequency);
        shift.look(&moment, now, upset, may_fault);
    }
    shift
}

#[test]
fn half_an_hour_of_operation_has_no_fault_that_was_not_injected() {
    let days = number("KBAND_DAYS", 0);
    let fidelity = Fidelity::ALL[usize::from(days < 2)];
    let hours = if days > 0 { 24.0 * days as f64 } else { 0.5 };
    let shift = operate(3600.0 * hours, fidelity);
    assert!(shift.wrong.is_empty(), "{}", shift.wrong.join("\n"));
    let times = |name| shift.happened.get(name).copied().unwrap_or(0);
    // Every kind of event occurred, and each lost sensor gave a fault.
    for name in [
        "other parts",
        "short drop-out",
        LOST_SENSOR,
        "pause",
        "silent link",
    ] {
        assert!(times(name) > 0, "{name}");
    }
    assert_eq!(times(LOST_SENSOR), times("faulted"));
    assert_eq!(times("faulted"), times("acknowledged"));
    // An event takes about a minute; parts are out of lock for at most 4 s of it on average.
    let (locked, cycles) = (shift.locked, shift.cycles);
    assert!(locked * 10 > cycles * 8, "{locked} of {cycles}");
}
