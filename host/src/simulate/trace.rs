//! The trace of a run: one row for each drive cycle.

use kband::control::{Event, UpperTone};
use kband::plant::{Moment, Sample};

use crate::report::{Column, Value, columns};

/// Columns of the trace.
pub const TRACE: [Column; 31] = [
    columns::TIME,
    columns::B,
    columns::K,
    columns::REFERENCE,
    columns::OUTPUT,
    columns::LEAD,
    columns::STATE.words(),
    columns::FAULT.words(),
    columns::LIMITS,
    columns::IMPACTS_HEARD,
    columns::PHASE_HEARD,
    columns::CONFIDENCE,
    columns::IN_GEAR_HEARD,
    columns::IN_GEAR_ERROR,
    columns::TRACE_HEARD,
    columns::FLIP_HEARD,
    columns::RESTITUTION_HEARD,
    columns::RESTITUTION_ERROR,
    columns::SCATTER_HEARD,
    columns::TO_LOSS_HEARD,
    columns::E,
    columns::TH,
    columns::E3,
    columns::TH3,
    columns::IN_GEAR_EXPECTED,
    columns::IMPACTS,
    columns::WAY,
    columns::LOAD,
    columns::MASS_WEIGHED,
    columns::FLOW_WEIGHED,
    columns::EVENTS.words(),
];

/// The row of a cycle.
#[must_use]
pub fn row(moment: &Moment) -> [Value; TRACE.len()] {
    let report = &moment.report;
    let events: Vec<&str> = report.events.iter().map(Event::name).collect();
    let fault = report.fault.map(|fault| fault.name());
    [
        Value::Short(moment.time),
        single(report.amplitude * 1e3),
        if report.k.is_finite() {
            single(report.k)
        } else {
            Value::Missing
        },
        single(report.reference * 1e3),
        single(report.command.amplitude),
        single(report.lead),
        report.state.name().into(),
        fault.map_or(Value::Missing, Into::into),
        u32::from(report.limits.bits()).into(),
        single(report.rate),
        single(report.phase),
        single(report.confidence),
        single(report.in_gear),
        heard(Some(report.in_gear_error).filter(|error| error.is_finite())),
        heard(report.margin.map(|margin| margin.trace)),
        heard(report.margin.map(|margin| margin.flip)),
        heard(report.margin.map(|margin| margin.restitution)),
        heard(report.margin.map(|margin| margin.error)),
        heard(report.margin.map(|margin| margin.scatter)),
        heard(report.margin.map(|margin| margin.to_loss)),
        single(report.shape.second.ratio),
        angle(report.shape.second),
        single(report.shape.third.ratio),
        angle(report.shape.third),
        single(report.expected_in_gear),
        moment.strikes.into(),
        (moment.displacement * 1e3).into(),
        Value::Short(moment.load),
        heard(report.load.map(|load| load.mass)),
        heard(
            report
                .load
                .map(|load| load.flow)
                .filter(|flow| *flow != 0.0),
        ),
        events.join("; ").into(),
    ]
}

/// Columns of a scope.
pub const SCOPE: [Column; 5] = [
    columns::TIME,
    columns::OUTPUT,
    columns::READING,
    columns::TRACK_DISPLACEMENT,
    columns::TRACK_VELOCITY,
];

/// The row of a sample.
#[must_use]
pub fn scope_row(sample: &Sample) -> [Value; SCOPE.len()] {
    [
        Value::Short(sample.time),
        single(sample.output),
        u32::from(sample.code).into(),
        single(sample.displacement * 1e3),
        single(sample.velocity * 1e3),
    ]
}

/// A quantity that is reported only where it is measured.
fn heard(value: Option<f32>) -> Value {
    value.map_or(Value::Missing, single)
}

/// A number of single precision with the digits it has, not those of its nearest double.
/// Phase of a tone in rad, where there is one.
fn angle(tone: UpperTone) -> Value {
    if tone.ratio > 0.0 {
        single(tone.phase)
    } else {
        Value::Missing
    }
}

fn single(value: f32) -> Value {
    Value::Short(value.to_string().parse().unwrap_or(f64::from(value)))
}
