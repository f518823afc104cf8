//! The result of a single run, in sentences and as JSON.

use std::path::Path;

use kband::regime::classify::Regime;
use kband_control::{Event, Fault, Report, State, Target, UpperTone};
use serde_json::{Value as Json, json};

use super::summary::Observed;
use crate::causes;
use crate::report::{Field, Printout, View, columns, fields, finite, number, numbers, span, when};
use crate::simulate::{
    Lot, Outcome, RESTING_AMPLITUDE, STATISTICS_START, band_name, describe, regime_text,
};

/// Smallest amplitude of the second tone, over the first, that is reported.
const MIN_TONE_RATIO: f64 = 0.01;

/// The kind of a written file, and its path.
pub(super) type Written<'a> = (&'static str, Option<&'a Path>);

pub(super) fn report(
    outcome: &Outcome,
    fidelity: &str,
    unmet: Option<&[String]>,
    written: &[Written<'_>; 3],
) -> Printout {
    let observed = Observed::from_outcome(outcome);
    let summary = observed.lines();
    let heading = format!("{}\n\n{}", summary.join("\n"), describe_scene(outcome));
    let speed = number(outcome.speed() * 1e3, 3);
    let times = number(outcome.times_real_time(), 3);
    let real_time = format!("speed            {times} times real time ({fidelity})");
    let sentences = [
        describe_state(outcome),
        describe_setpoint(outcome),
        describe_band(outcome),
        vec![format!("regime           {}", outcome.regime())],
        describe_share_in_gear(outcome),
        Vec::from_iter(describe_expected_share(outcome)),
        list_causes(&observed),
        Vec::from_iter(describe_strays(outcome)),
        Vec::from_iter(describe_measured_regime(outcome)),
        Vec::from_iter(describe_identification(outcome)),
        Vec::from_iter(describe_margin(outcome)),
        Vec::from_iter(describe_load(outcome)),
        describe_lock_phase(outcome),
        vec![format!("conveying speed  {speed} mm/s")],
        describe_expectation(unmet),
        list_files(written),
        vec![real_time],
    ];
    timeline(outcome)
        .heading(heading)
        .notes(sentences.into_iter().flatten())
        .json(as_json(outcome, &observed, fidelity, unmet, written))
}

type TimedEvent = (f64, String, Report);

fields! {
    fn state_after(at: TimedEvent) {
        all TIME.digits(4) => at.0;
        all EVENT => at.1.clone();
        all STATE => at.2.state.name();
        all B.digits(3) => is_moving(&at.2).then_some(1e3 * f64::from(at.2.amplitude));
        all K.digits(4) => is_moving(&at.2).then_some(f64::from(at.2.k));
    }
}

fields! {
    fn regime_after(at: TimedEvent) {
        all IN_GEAR_ESTIMATED.titled("in gear (estimated)").digits(2) => f64::from(at.2.in_gear);
        all FLIP_ESTIMATED.titled("margin (to the flip)").digits(2) =>
            at.2.margin.map(|margin| f64::from(margin.flip));
    }
}

fn is_moving(report: &Report) -> bool {
    f64::from(report.amplitude) > RESTING_AMPLITUDE
}

fn timeline(outcome: &Outcome) -> Printout {
    let mut tones = Vec::new();
    let upper = outcome.file().scene.settings.upper_tones();
    let named = [(columns::E, columns::TH), (columns::E3, columns::TH3)];
    for (n, (e, th)) in named.into_iter().enumerate().take(upper) {
        let tone = move |at: &TimedEvent| at.2.shape.tones()[n];
        let e = e.titled(e.name).digits(3);
        tones.push(Field::all(e, move |at| f64::from(tone(at).ratio)));
        tones.push(Field::all(th.digits(4), move |at| {
            let UpperTone { ratio, phase } = tone(at);
            (ratio > 0.0).then_some(f64::from(phase))
        }));
    }
    let event = |happened: kband_scene::TimedEvent| {
        let name = name_event(outcome, happened.event, &happened.report);
        (happened.time, name, happened.report)
    };
    let mut rows: Vec<TimedEvent> = outcome.events().map(event).collect();
    rows.push((outcome.file().duration, "end".into(), outcome.last()));
    let view = state_after().and(View::from_fields(tones));
    view.and(regime_after()).printout(&rows)
}

/// Name of an event, with the number of the kick or of the fault.
fn name_event(outcome: &Outcome, event: Event, report: &Report) -> String {
    let name = event.name();
    match (event, report.fault) {
        (Event::KickBegun, _) => {
            let (kick, allowed) = (report.attempts, outcome.attempts_allowed());
            format!("{name} ({kick} of {allowed})")
        }
        (Event::Faulted, Some(fault)) => {
            format!("{name}: {} (fault {})", fault.name(), fault.number())
        }
        _ => name.into(),
    }
}

fn describe_scene(outcome: &Outcome) -> String {
    let scene = &outcome.file().scene;
    let settings = &scene.settings;
    let widest = scene.scatter.iter().copied().fold(0.0, f32::max);
    let scatter = || format!(" scattering by {widest}");
    let scatter = when(outcome.file().scatters(), scatter);
    let (target, frequency) = (describe(outcome.target()), settings.frequency);
    let (incline, quality) = (settings.incline, settings.quality);
    let [low, high] = [settings.restitution_low, settings.restitution_high].map(f64::from);
    let restitution = span(low, high, 4);
    format!(
        "target {target}; {frequency} Hz, incline {incline} degrees, restitution {restitution}{scatter}, Q {quality}"
    )
}

fn describe_state(outcome: &Outcome) -> Vec<String> {
    let last = outcome.last();
    let fault = |fault: Fault| format!(": {} (fault {})", fault.name(), fault.number());
    let fault = last.fault.map(fault).unwrap_or_default();
    let mut lines = vec![format!("state            {}{fault}", last.state.name())];
    if last.state == State::Capturing {
        lines.push(format!(
            "                 the scene ended at kick {} of {}: --duration {} gives it time",
            last.attempts,
            outcome.attempts_allowed(),
            number((3.0 * outcome.file().duration).min(86_400.0), 4)
        ));
    }
    lines
}

fn describe_setpoint(outcome: &Outcome) -> Vec<String> {
    let limits = outcome.limits().into_iter();
    let mut lines = Vec::from_iter(limits.map(|limit| format!("held back by     {limit}")));
    let no_setpoint = outcome.no_setpoint();
    lines.extend(no_setpoint.map(|why| format!("no setpoint      {why}")));
    let mut values = ["-"; 2].map(String::from);
    if outcome.amplitude() > RESTING_AMPLITUDE {
        let b = number(outcome.amplitude() * 1e3, 4);
        values = [format!("{b} mm"), number(outcome.k(), 4)];
    }
    let [b, k] = values;
    lines.extend([
        format!("amplitude b      {b}"),
        format!("k                {k}"),
    ]);
    lines
}

/// Band of a target of gear or chaos, band of the lock, and whether k is inside.
fn describe_band(outcome: &Outcome) -> Vec<String> {
    let (k, is_moving) = (outcome.k(), outcome.amplitude() > RESTING_AMPLITUDE);
    let place = |inside: bool| match (is_moving, inside) {
        (false, _) => "",
        (true, true) => ", k inside",
        (true, false) => ", k outside",
    };
    let name = band_name(outcome.target());
    let target = outcome.last().target_band.map(|band| {
        let [low, high] = band.map(f64::from);
        let mm = |k_of_end: f64| number(outcome.amplitude() * 1e3 * k / k_of_end, 3);
        let b = when(is_moving, || format!(" (b {} .. {} mm)", mm(high), mm(low)));
        let place = place((low..=high).contains(&k));
        let [low, high] = numbers([low, high], 4);
        format!("{name:<17}k {low} .. {high}{b}{place}")
    });
    let lock = match outcome.band() {
        Some(band) => {
            let scatter = when(outcome.file().scatters(), || ", of a lock without scatter");
            let place = when(target.is_none(), || place(band.contains(k)));
            let ([low, high], order) = (numbers([band.low(), band.high()], 4), band.order());
            format!("band             k {low} .. {high} (order {order}{scatter}){place}")
        }
        None => format!(
            "band             none: {}",
            outcome.no_band().unwrap_or_default()
        ),
    };
    target.into_iter().chain([lock]).collect()
}

fn describe_share_in_gear(outcome: &Outcome) -> Vec<String> {
    let Some(share) = outcome.in_gear() else {
        return vec![];
    };
    let lost = match outcome.time_to_loss() {
        Some(periods) => format!("lost after {} cycles in the mean", number(periods, 3)),
        None => "never lost".into(),
    };
    let (share, order) = (number(share, 3), outcome.gear_order());
    let mut lines = vec![format!(
        "in gear          {share} of the time from {STATISTICS_START} s on (order {order}), {lost}"
    )];
    let record = outcome.record();
    if let Some(coverage) = record.in_gear_coverage() {
        lines.push(match (record.in_gear_estimated(), record.in_gear_error()) {
            (Some(estimate), Some(error)) => {
                let part = || format!(", over {} of that time", number(coverage, 3));
                let part = when(coverage != 1.0, part);
                let (estimate, error) = (number(estimate, 3), number(error, 1));
                format!("                 estimated {estimate} +- {error}{part}")
            }
            _ => "                 no estimate".into(),
        });
    }
    lines
}

fn configured_lot(outcome: &Outcome) -> Lot {
    let settings = &outcome.file().scene.settings;
    Lot {
        restitution: [settings.restitution_low, settings.restitution_high],
        scatter: settings.scatter,
    }
}

/// Lot for which the controller planned: the measured one, else that of the settings.
fn planned_lot(outcome: &Outcome) -> Lot {
    let planned = outcome.record().gear_lot;
    planned.unwrap_or_else(|| configured_lot(outcome))
}

/// Share of time in gear that the plan predicts, for a target of gear.
fn predicted_share(outcome: &Outcome) -> Option<f64> {
    matches!(outcome.target(), Target::Gear { .. })
        .then_some(f64::from(outcome.last().expected_in_gear))
}

fn describe_expected_share(outcome: &Outcome) -> Option<String> {
    let lot = planned_lot(outcome);
    let expected = number(predicted_share(outcome)?, 3);
    let estimated = lot != configured_lot(outcome);
    let [low, high] = lot.restitution.map(f64::from);
    let restitution = span(low, high, 3);
    Some(format!(
        "                 {expected} expected of restitution {restitution} that scatters by {}{}",
        number(lot.scatter, 2),
        when(estimated, || ", as estimated")
    ))
}

/// Predicted effect of one change of drive or lot, if parts do not stay in gear.
fn list_causes(observed: &Observed<'_>) -> Vec<String> {
    let causes = causes::describe(&observed.causes);
    let head = "causes           one change at a time is predicted to give";
    let head = (!causes.is_empty()).then(|| head.into());
    let line = |cause| format!("                 {cause}");
    head.into_iter()
        .chain(causes.into_iter().map(line))
        .collect()
}

fn describe_strays(outcome: &Outcome) -> Option<String> {
    let settings = &outcome.file().scene.settings;
    let strays: Vec<String> = outcome.strays().iter().map(f32::to_string).collect();
    let (low, high) = (settings.restitution_low, settings.restitution_high);
    let lot = format!("outside the lot {low}..{high} of the settings (part.actual)");
    (!strays.is_empty()).then(|| format!("parts            R {} {lot}", strays.join(", ")))
}

fn describe_measured_regime(outcome: &Outcome) -> Option<String> {
    let last = outcome.last();
    let measured = last.regime?;
    // With scatter no phases repeat, in gear or not.
    let unrepeated = matches!(measured.regime, Regime::Chaotic | Regime::Undecided);
    Some(if unrepeated && last.in_gear >= 0.5 {
        format!("estimated        in gear, order {}", last.gear)
    } else if let (State::Locked, Regime::Doubled { order, doublings }) =
        (last.state, measured.regime)
    {
        // The phases stay near the lock's and alternate there.
        format!(
            "estimated        at the lock of order {order}, {} phases in turn (confidence {})",
            1_u64 << doublings,
            number(measured.confidence, 2)
        )
    } else {
        let (regime, confidence) = (regime_text(measured.regime), number(measured.confidence, 2));
        format!("estimated        {regime} (confidence {confidence})")
    })
}

fn describe_identification(outcome: &Outcome) -> Option<String> {
    let identified = outcome.identified()?;
    let scatter = || format!(", scattering by {}", number(identified.scatter, 2));
    let scatter = when(identified.scatter > 0.0, scatter);
    let [r, k] = numbers([identified.restitution, identified.k], 3);
    let (error, hops) = (number(identified.deviation, 1), identified.hops);
    Some(format!(
        "restitution      {r} identified{scatter}, standard error {error}, {hops} hops at k {k}"
    ))
}

fn describe_margin(outcome: &Outcome) -> Option<String> {
    let margin = outcome.last().margin?;
    let [flip, trace, scatter] = numbers([margin.flip, margin.trace, margin.scatter], 2);
    let (r, error) = (number(margin.restitution, 3), number(margin.error, 1));
    let lost = margin.to_loss.round();
    Some(format!(
        "estimated margin {flip} to the flip (trace {trace}), R {r} +- {error} scattering by {scatter}; gear lost after {lost} cycles or more"
    ))
}

fn describe_load(outcome: &Outcome) -> Option<String> {
    let last = outcome.last();
    if let Some(load) = last.load {
        let flow = || format!(", {} g/s", number(load.flow, 3));
        let flow = when(load.flow != 0.0, flow);
        let [weighed, speed] = numbers([load.mass, load.speed], 3);
        let mass = number(outcome.mass(), 3);
        Some(format!(
            "weighed          {weighed} g on the track ({mass} g are) at {speed} mm/s{flow}"
        ))
    } else {
        let unknown = outcome.file().scene.settings.track_mass > 0.0
            && f64::from(last.shape.second.ratio) >= MIN_TONE_RATIO;
        unknown.then(|| "weighed          nothing: a second tone takes a power of its own".into())
    }
}

fn describe_lock_phase(outcome: &Outcome) -> Vec<String> {
    let Some(phase) = outcome.lock_phase() else {
        return vec![];
    };
    let last = outcome.last();
    let measures = |regime: Regime| last.regime.is_some_and(|end| end.regime == regime);
    let silent = measures(Regime::Rest);
    // Impacts that are too rare for the controller to detect a lock.
    let faint =
        matches!(last.state, State::Holding | State::Capturing) && measures(Regime::Undecided);
    let expected = outcome.expected_phase().map(|phase| {
        let phase = number(phase, 3);
        format!(" (the map says {phase} for the middle of the lot)")
    });
    let measured = match silent {
        true => "not measured".into(),
        false => format!("measured {} rad", number(last.phase, 3)),
    };
    let (phase, expected) = (number(phase, 3), expected.unwrap_or_default());
    let line = format!("lock phase       {phase} rad, {measured}{expected}");
    let quiet = "                 the parts are locked, but too quiet for the controller: \
                 [sensor] ringing against noise";
    let quiet = (silent || faint).then(|| quiet.into());
    [line].into_iter().chain(quiet).collect()
}

fn describe_expectation(unmet: Option<&[String]>) -> Vec<String> {
    match unmet {
        Some([]) => vec!["expectation      met".into()],
        _ => {
            let unmet = unmet.unwrap_or_default().iter();
            unmet
                .map(|line| format!("NOT AS EXPECTED  {line}"))
                .collect()
        }
    }
}

fn list_files(written: &[Written<'_>; 3]) -> Vec<String> {
    let line = |(name, file): &Written<'_>| Some(format!("{name:<16} {}", (*file)?.display()));
    written.iter().filter_map(line).collect()
}

fn as_json(
    outcome: &Outcome,
    observed: &Observed<'_>,
    fidelity: &str,
    unmet: Option<&[String]>,
    written: &[Written<'_>; 3],
) -> Json {
    let (last, lot) = (outcome.last(), planned_lot(outcome));
    let [picture, trace, scope] = written.map(|(_, path)| Some(path?.display().to_string()));
    let event = |at: kband_scene::TimedEvent| json!({"time": at.time, "event": at.event.name(), "state": at.report.state.name()});
    json!({
        "summary": observed.lines(),
        "causes": causes::describe(&observed.causes),
        "events": outcome.events().map(event).collect::<Vec<_>>(),
        "state": last.state.name(),
        "fault": last.fault.map(|fault| fault.name()),
        "limits": outcome.limits(),
        "b": outcome.amplitude() * 1e3,
        "k": finite(outcome.k()),
        "band": outcome.band().map(|band| [band.low(), band.high()]),
        "gear_band": last.target_band,
        "regime": outcome.regime(),
        "in_gear": outcome.in_gear(),
        "in_gear_estimated": outcome.record().in_gear_estimated(),
        "in_gear_error": outcome.record().in_gear_error(),
        "in_gear_coverage": outcome.record().in_gear_coverage(),
        "planned_for": json!({"restitution": lot.restitution, "scatter": lot.scatter}),
        "margin_estimated": last.margin.map(|margin| json!({
            "flip_estimated": margin.flip,
            "trace_estimated": margin.trace,
            "restitution_estimated": margin.restitution,
            "restitution_error": margin.error,
            "scatter_estimated": margin.scatter,
            "to_loss_estimated": margin.to_loss,
        })),
        "in_gear_expected": predicted_share(outcome),
        "to_loss": outcome.time_to_loss(),
        "lock_phase": outcome.lock_phase(),
        "speed": outcome.speed() * 1e3,
        "mass": outcome.file().scene.masses.iter().any(|mass| *mass > 0.0).then(|| outcome.mass()),
        "mass_weighed": last.load.map(|load| load.mass),
        "flow_weighed": last.load.map(|load| load.flow).filter(|flow| *flow != 0.0),
        "restitution_identified": outcome.identified().map(|identified| identified.restitution),
        "not_as_expected": unmet,
        "picture": picture,
        "trace": trace,
        "scope": scope,
        "fidelity": fidelity,
        "times_real_time": outcome.times_real_time(),
    })
}
