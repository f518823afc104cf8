//! The trace of a run: one row for each drive cycle.

use kband_control::{Event, UpperTone};
use kband_plant::{Moment, Sample};

use crate::report::{Value, fields};

/// Bytes of a row of the trace as CSV, the mean over the default scene.
pub const ROW_BYTES: u64 = 205;

fields! {
    /// The trace: a row of a cycle.
    pub fn trace(moment: Moment) {
        data TIME => Value::Short(moment.time);
        data B => moment.report.amplitude * 1e3;
        data K => finite(moment.report.k);
        data REFERENCE => moment.report.reference * 1e3;
        data OUTPUT => moment.report.command.amplitude;
        data LEAD => moment.report.lead;
        data STATE.words() => moment.report.state.name();
        data FAULT.words() => moment.report.fault.map(|fault| fault.name());
        data LIMITS => u32::from(moment.report.limits.bits());
        data IMPACTS_DETECTED => moment.report.rate;
        data PHASE_MEASURED => moment.report.phase;
        data CONFIDENCE => moment.report.confidence;
        data IN_GEAR_ESTIMATED => moment.report.in_gear;
        data IN_GEAR_ERROR => finite(moment.report.in_gear_error);
        data TRACE_ESTIMATED => moment.report.margin.map(|margin| margin.trace);
        data FLIP_ESTIMATED => moment.report.margin.map(|margin| margin.flip);
        data RESTITUTION_ESTIMATED => moment.report.margin.map(|margin| margin.restitution);
        data RESTITUTION_ERROR => moment.report.margin.map(|margin| margin.error);
        data SCATTER_ESTIMATED => moment.report.margin.map(|margin| margin.scatter);
        data TO_LOSS_ESTIMATED => moment.report.margin.map(|margin| margin.to_loss);
        data E => moment.report.shape.second.ratio;
        data TH => angle(moment.report.shape.second);
        data E3 => moment.report.shape.third.ratio;
        data TH3 => angle(moment.report.shape.third);
        data IN_GEAR_EXPECTED => moment.report.expected_in_gear;
        data IMPACTS => moment.strikes;
        data WAY => moment.displacement * 1e3;
        data LOAD => Value::Short(moment.load);
        data MASS_WEIGHED => moment.report.load.map(|load| load.mass);
        data FLOW_WEIGHED => moment.report.load.map(|load| load.flow).filter(|flow| *flow != 0.0);
        data EVENTS.words() => moment.report.events.iter().map(Event::name).collect::<Vec<_>>().join("; ");
    }
}

fields! {
    /// The scope: a row of a sample.
    pub fn scope(sample: Sample) {
        data TIME => Value::Short(sample.time);
        data OUTPUT => sample.output;
        data READING => u32::from(sample.code);
        data TRACK_DISPLACEMENT => sample.displacement * 1e3;
        data TRACK_VELOCITY => sample.velocity * 1e3;
    }
}

fn finite(value: f32) -> Option<f32> {
    Some(value).filter(|value| value.is_finite())
}

/// Phase of a tone in rad, where there is one.
fn angle(tone: UpperTone) -> Option<f32> {
    (tone.ratio > 0.0).then_some(tone.phase)
}
