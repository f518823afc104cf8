//! The trace of a run: one row for each drive cycle.

use kband_control::{Event, UpperTone};
use kband_plant::{Moment, Sample};

use crate::report::{fields, finite};

/// Mean bytes of a row of the trace as CSV, for 20 000 s of the default scene.
pub const ROW_BYTES: u64 = 219;

fields! {
    /// The trace: one row for each cycle.
    pub fn trace(moment: Moment) {
        data TIME => moment.time;
        data B => moment.report.amplitude * 1e3;
        data K => finite(moment.report.k);
        data REFERENCE => moment.report.reference * 1e3;
        data OUTPUT => moment.report.command.amplitude;
        data LEAD => moment.report.lead;
        data STATE.text() => moment.report.state.name();
        data FAULT.text() => moment.report.fault.map(|fault| fault.name());
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
        data LOAD => moment.load;
        data MASS_WEIGHED => moment.report.load.map(|load| load.mass);
        data FLOW_WEIGHED => moment.report.load.map(|load| load.flow).filter(|flow| *flow != 0.0);
        data EVENTS.text() => moment.report.events.iter().map(Event::name).collect::<Vec<_>>().join("; ");
    }
}

fields! {
    /// The scope: one row for each sample.
    pub fn scope(sample: Sample) {
        data TIME => sample.time;
        data OUTPUT => sample.output;
        data READING => u32::from(sample.code);
        data TRACK_DISPLACEMENT => sample.displacement * 1e3;
        data TRACK_VELOCITY => sample.velocity * 1e3;
    }
}

/// Phase of a tone in rad; `None` without the tone.
fn angle(tone: UpperTone) -> Option<f32> {
    (tone.ratio > 0.0).then_some(tone.phase)
}
