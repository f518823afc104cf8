//! What a single run came to, in words and as JSON.

use std::path::Path;

use kband::control::{Event, Report, State, Target, UpperTone};
use kband::regime::classify::Regime;
use serde_json::json;

use super::compare::LEAST;
use super::summary::Seen;
use crate::refusal::Refusal;
use crate::report::{Printout, Table, Value, columns, number};
use crate::simulate::{Lot, Outcome, SETTLED, describe, words};

/// Files of a single run.
pub(super) struct Written<'a> {
    pub picture: &'a Path,
    pub trace: Option<&'a Path>,
    pub scope: Option<&'a Path>,
}

/// Expected share of time in gear below which it is said that nothing serves the lot.
const POORLY: f64 = 0.7;
/// Widest lot that is one restitution: what one part is planned for by what is heard.
const NARROW: f32 = 0.045;

/// The timeline and the result in words.
pub(super) fn told(
    outcome: &Outcome,
    fidelity: &str,
    unmet: Option<&[String]>,
    written: &Written<'_>,
) -> Result<Printout, Refusal> {
    let upper = outcome.file().scene.settings.upper_tones();
    let mut columns = vec![
        columns::TIME.digits(4),
        columns::EVENT,
        columns::STATE,
        columns::B.digits(3),
        columns::K.digits(4),
    ];
    let tones = [(columns::E, columns::TH), (columns::E3, columns::TH3)];
    for (e, th) in tones.into_iter().take(upper) {
        columns.push(e.titled(e.name()).digits(3));
        columns.push(th.digits(4));
    }
    columns.push(columns::IN_GEAR_HEARD.titled("in gear (heard)").digits(2));
    columns.push(columns::FLIP_HEARD.titled("margin (to the flip)").digits(2));
    let mut table = Table::new(&columns);
    let mut row = |time: f64, event: String, report: &Report| {
        let k = f64::from(report.k);
        let mut row: Vec<Value> = vec![
            time.into(),
            event.into(),
            report.state.name().into(),
            (f64::from(report.amplitude) * 1e3).into(),
            if k < 1e3 { k.into() } else { Value::Missing },
        ];
        for UpperTone { ratio, phase } in report.shape.tones().into_iter().take(upper) {
            row.push(f64::from(ratio).into());
            row.push(if ratio > 0.0 {
                f64::from(phase).into()
            } else {
                Value::Missing
            });
        }
        row.push(f64::from(report.in_gear).into());
        row.push(report.margin.map(|margin| f64::from(margin.flip)).into());
        table.push_row(row);
    };
    for happened in outcome.events() {
        let report = happened.report;
        let mut event = happened.event.name().to_string();
        if happened.event == Event::KickBegun {
            event = format!(
                "{event} ({} of {})",
                report.attempts,
                outcome.attempts_allowed()
            );
        }
        if let (Event::Faulted, Some(fault)) = (happened.event, report.fault) {
            event = format!("{event}: {} (fault {})", fault.name(), fault.number());
        }
        row(happened.time, event, &report);
    }
    row(outcome.file().duration, "end".into(), &outcome.last());
    let scene = &outcome.file().scene;
    let settings = &scene.settings;
    let last = outcome.last();
    let summary = Seen::of(outcome).lines();
    let mut report = Printout::new(table).heading(format!(
        "{}\n\ntarget {}; {} Hz, incline {} degrees, restitution {}..{}{}, Q {}",
        summary.join("\n"),
        describe(outcome.target()),
        settings.frequency,
        settings.incline,
        settings.restitution_low,
        settings.restitution_high,
        if outcome.file().scatters() {
            let widest = scene.scatter.iter().copied().fold(0.0, f32::max);
            format!(" scattering by {widest}")
        } else {
            String::new()
        },
        settings.quality
    ));
    let expected =
        matches!(outcome.target(), Target::Gear { .. }).then_some(f64::from(last.expected_in_gear));
    let mut say = |words: String| report = std::mem::take(&mut report).note(words);
    say(format!(
        "state            {}{}",
        last.state.name(),
        last.fault.map_or(String::new(), |fault| format!(
            ": {} (fault {})",
            fault.name(),
            fault.number()
        ))
    ));
    if last.state == State::Capturing {
        say(format!(
            "                 the scene ended at kick {} of {}: --duration {} gives it time",
            last.attempts,
            outcome.attempts_allowed(),
            number((3.0 * outcome.file().duration).min(86_400.0), 4)
        ));
    }
    for limit in outcome.limits() {
        say(format!("held back by     {limit}"));
    }
    if let Some(why) = outcome.no_setpoint() {
        say(format!("no setpoint      {why}"));
    }
    say(format!(
        "amplitude b      {} mm",
        number(outcome.amplitude() * 1e3, 4)
    ));
    let k = outcome.k();
    if k.is_finite() {
        say(format!("k                {}", number(k, 4)));
    }
    match outcome.band() {
        Some(band) => say(format!(
            "band             k {} .. {} (order {}{}), {}",
            number(band.low(), 4),
            number(band.high(), 4),
            band.order(),
            if outcome.file().scatters() {
                ", of a lock without scatter"
            } else {
                ""
            },
            if band.contains(k) {
                "k inside"
            } else {
                "k outside"
            }
        )),
        None => say(format!(
            "band             none: {}",
            outcome.no_band().unwrap_or_default()
        )),
    }
    say(format!("regime           {}", outcome.regime()));
    if let Some(share) = outcome.in_gear() {
        let lost = outcome
            .time_to_loss()
            .map_or("never lost".into(), |periods| {
                format!("lost after {} cycles in the mean", number(periods, 3))
            });
        say(format!(
            "in gear          {} of the time from {SETTLED} s on (order {}), {lost}",
            number(share, 3),
            outcome.gear_order()
        ));
        let record = outcome.record();
        if let (Some(heard), Some(error), Some(told)) = (
            record.in_gear_heard(),
            record.in_gear_error(),
            record.in_gear_told(),
        ) {
            let told = match told {
                1.0 => String::new(),
                told => format!(", told for {} of that time", number(told, 3)),
            };
            say(format!(
                "                 heard {} +- {}{told}",
                number(heard, 3),
                number(error, 1)
            ));
        } else if record.in_gear_told().is_some() {
            say("                 heard: not told".into());
        }
    }
    let as_told = Lot {
        restitution: [settings.restitution_low, settings.restitution_high],
        scatter: settings.scatter,
    };
    let lot = outcome.record().planned_for().unwrap_or(as_told);
    if let Some(expected) = expected {
        let Lot {
            restitution: [low, high],
            scatter,
        } = lot;
        let heard = if lot == as_told {
            ""
        } else {
            ", as it is heard"
        };
        say(format!(
            "                 {} expected of restitution {}..{} that scatters by {}{heard}",
            number(expected, 3),
            number(f64::from(low), 3),
            number(f64::from(high), 3),
            number(f64::from(scatter), 2)
        ));
    }
    if let Some(expected) = expected
        && expected < POORLY
        && last.reference > 0.0
    {
        let Lot {
            restitution: [low, high],
            scatter,
        } = lot;
        let wide = high - low > NARROW;
        let (low, high) = (number(f64::from(low), 3), number(f64::from(high), 3));
        let what = if wide {
            format!("a lot of R {low}..{high} is wider than any amplitude of this drive serves")
        } else {
            format!(
                "a scatter of {} is more than any amplitude of this drive bears",
                number(f64::from(scatter), 2)
            )
        };
        let more = if settings.second_tone < 0.15 {
            "a second tone in the drive (drive.second_tone = 0.15), "
        } else {
            ""
        };
        say(format!(
            "lot              {what}: {} of the time in gear is the best there is, and held; {more}parts sorted \
             into narrower lots, or less scatter would keep them in gear for longer: kband gear --restitution {low}..{high} \
             --scatter {}",
            number(expected, 2),
            number(f64::from(scatter), 2)
        ));
    }
    let strays: Vec<String> = outcome.strays().iter().map(f32::to_string).collect();
    if !strays.is_empty() {
        say(format!(
            "parts            R {} outside the lot {}..{} that the controller is told (part.actual)",
            strays.join(", "),
            settings.restitution_low,
            settings.restitution_high
        ));
    }
    let silent = last
        .regime
        .is_some_and(|heard| heard.regime == Regime::Rest);
    // What is heard now and then only is no lock to the controller.
    let faint = matches!(last.state, State::Holding | State::Capturing)
        && last
            .regime
            .is_some_and(|heard| heard.regime == Regime::Undecided);
    if let Some(heard) = last.regime {
        // Scattering phases repeat nothing, in gear or not.
        let unrepeated = matches!(heard.regime, Regime::Chaotic | Regime::Undecided);
        say(if unrepeated && last.in_gear >= 0.5 {
            format!("heard            in gear, order {}", last.gear)
        } else if let (State::Locked, Regime::Doubled { order, doublings }) =
            (last.state, heard.regime)
        {
            // The phases stay where the lock has them, and take turns there.
            format!(
                "heard            at the lock of order {order}, {} phases in turn (confidence {})",
                1_u64 << doublings,
                number(f64::from(heard.confidence), 2)
            )
        } else {
            format!(
                "heard            {} (confidence {})",
                words(heard.regime),
                number(f64::from(heard.confidence), 2)
            )
        });
    }
    if let Some(found) = outcome.identified() {
        say(format!(
            "restitution      {} identified{}, standard error {}, {} hops at k {}",
            number(f64::from(found.restitution), 3),
            if found.scatter > 0.0 {
                format!(", scattering by {}", number(f64::from(found.scatter), 2))
            } else {
                String::new()
            },
            number(f64::from(found.deviation), 1),
            found.hops,
            number(f64::from(found.k), 3)
        ));
    }
    if let Some(margin) = last.margin {
        say(format!(
            "margin heard     {} to the flip (trace {}), R {} +- {} scattering by {}; gear lost after {} cycles or more",
            number(f64::from(margin.flip), 2),
            number(f64::from(margin.trace), 2),
            number(f64::from(margin.restitution), 3),
            number(f64::from(margin.error), 1),
            number(f64::from(margin.scatter), 2),
            margin.to_loss.round()
        ));
    }
    if let Some(load) = last.load {
        let flow = if load.flow == 0.0 {
            String::new()
        } else {
            format!(", {} g/s", number(f64::from(load.flow), 3))
        };
        say(format!(
            "weighed          {} g on the track ({} g are) at {} mm/s{flow}",
            number(f64::from(load.mass), 3),
            number(outcome.mass(), 3),
            number(f64::from(load.speed), 3),
        ));
    } else if outcome.file().scene.settings.track_mass > 0.0
        && f64::from(last.shape.second.ratio) >= LEAST
    {
        say("weighed          nothing: a second tone takes a power of its own".into());
    }
    if let Some(phase) = outcome.lock_phase() {
        let expected = outcome.expected_phase().map_or(String::new(), |phase| {
            format!(
                " (the map says {} for the middle of the lot)",
                number(phase, 3)
            )
        });
        let heard = if silent {
            "not heard".into()
        } else {
            format!("heard {} rad", number(f64::from(last.phase), 3))
        };
        say(format!(
            "lock phase       {} rad, {heard}{expected}",
            number(phase, 3)
        ));
        if silent || faint {
            say(
                "                 the parts are locked, but too quiet for the controller: \
                 [sensor] ringing against noise"
                    .into(),
            );
        }
    }
    say(format!(
        "conveying speed  {} mm/s",
        number(outcome.speed() * 1e3, 3)
    ));
    if let Some(unmet) = unmet {
        if unmet.is_empty() {
            say("expectation      met".into());
        }
        for line in unmet {
            say(format!("NOT AS EXPECTED  {line}"));
        }
    }
    say(format!("picture          {}", written.picture.display()));
    for (name, file) in [("trace", written.trace), ("scope", written.scope)] {
        if let Some(file) = file {
            say(format!("{name:<16} {}", file.display()));
        }
    }
    let speed = outcome.times_real_time();
    say(format!(
        "speed            {} times real time ({fidelity})",
        number(speed, 3)
    ));
    let path = |path: &Path| path.display().to_string();
    let events: Vec<_> = outcome
        .events()
        .map(|happened| json!({"time": happened.time, "event": happened.event.name(), "state": happened.report.state.name()}))
        .collect();
    report.json(&json!({
        "summary": summary,
        "events": events,
        "state": last.state.name(),
        "fault": last.fault.map(|fault| fault.name()),
        "limits": outcome.limits(),
        "b": outcome.amplitude() * 1e3,
        "k": k.is_finite().then_some(k),
        "band": outcome.band().map(|band| [band.low(), band.high()]),
        "regime": outcome.regime(),
        "in_gear": outcome.in_gear(),
        "in_gear_heard": outcome.record().in_gear_heard(),
        "in_gear_error": outcome.record().in_gear_error(),
        "in_gear_told": outcome.record().in_gear_told(),
        "planned_for": json!({"restitution": lot.restitution, "scatter": lot.scatter}),
        "margin_heard": last.margin.map(|margin| json!({
            "flip_heard": margin.flip,
            "trace_heard": margin.trace,
            "restitution_heard": margin.restitution,
            "restitution_error": margin.error,
            "scatter_heard": margin.scatter,
            "to_loss_heard": margin.to_loss,
        })),
        "in_gear_expected": expected,
        "to_loss": outcome.time_to_loss(),
        "lock_phase": outcome.lock_phase(),
        "speed": outcome.speed() * 1e3,
        "mass": outcome.file().scene.masses.iter().any(|mass| *mass > 0.0).then(|| outcome.mass()),
        "mass_weighed": last.load.map(|load| load.mass),
        "flow_weighed": last.load.map(|load| load.flow).filter(|flow| *flow != 0.0),
        "restitution_identified": outcome.identified().map(|found| found.restitution),
        "not_as_expected": unmet,
        "picture": path(written.picture),
        "trace": written.trace.map(path),
        "scope": written.scope.map(path),
        "fidelity": fidelity,
        "times_real_time": speed,
    }))
}
