//! The controller's report and the progress of an identification on the line.
//!
//! Items of the controller's numbered lists are sent as indices, its sets as bits. Other contents
//! of the controller's types are not sent, so their changes change no frame.

use serde::{Deserialize, Serialize};

use super::Unreadable;
use crate::arithmetic::Phase;
use crate::control;
use crate::regime::classify;

/// An upper tone of the track; [`control::UpperTone`] on the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UpperTone {
    /// Amplitude over that of the first tone (symbol e).
    pub ratio: f32,
    /// Phase angle (symbol th) in rad.
    pub phase: f32,
}

/// Shape of the track's motion; [`control::Shape`] on the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// The second tone.
    pub second: UpperTone,
    /// The third tone.
    pub third: UpperTone,
}

impl From<control::Shape> for Shape {
    fn from(control::Shape { second, third }: control::Shape) -> Self {
        let tone = |control::UpperTone { ratio, phase }| UpperTone { ratio, phase };
        Self {
            second: tone(second),
            third: tone(third),
        }
    }
}

impl From<Shape> for control::Shape {
    fn from(Shape { second, third }: Shape) -> Self {
        let tone = |UpperTone { ratio, phase }| control::UpperTone { ratio, phase };
        Self {
            second: tone(second),
            third: tone(third),
        }
    }
}

/// Report of one cycle: [`control::Report`] on the line, convertible both ways.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Cycles since the start of the controller.
    cycle: u32,
    /// Measured k; infinite at rest.
    k: f32,
    /// Measured normal amplitude of the track (symbol b) in m.
    amplitude: f32,
    /// Measured phase lead of the track over the output, in rad, -pi..pi.
    lead: f32,
    /// Measured shape of the track's motion.
    shape: Shape,
    /// Reference of the amplitude loop at the end of the next cycle but one, in m.
    reference: f32,
    /// Amplitude setpoint of the target in m; 0 without one.
    setpoint: f32,
    /// Detected impacts per cycle, over the last 16.
    rate: f32,
    /// Mean phase of the track (symbol t) at the detected impacts, in rad, -pi..pi.
    phase: f32,
    /// Concentration of these phases, 0..1.
    concentration: f32,
    /// Estimated regime of the parts, with its confidence.
    regime: Option<Verdict>,
    /// Drive frequency in Hz.
    frequency: f32,
    /// Confidence that the parts are in the requested lock, 0..1.
    confidence: f32,
    /// Estimated share of the parts' time in gear, 0..=1.
    in_gear: f32,
    /// Standard error of that share; infinite for a lower bound.
    in_gear_error: f32,
    /// Order of that gear.
    gear: u8,
    /// Mean drive cycles in gear before a loss.
    to_loss: f32,
    /// Stability margin of gear.
    margin: Option<Margin>,
    /// Predicted share of time in gear at the setpoint, 0..1.
    expected_in_gear: f32,
    /// Estimated load of the track.
    load: Option<Load>,
    /// Number of kicks begun for the present target.
    attempts: u8,
    /// Progress of the identification of the parts' restitution.
    identification: Identification,
    /// Index of the state in [`control::State::ALL`].
    state: u8,
    /// Index of the fault in [`control::Fault::ALL`].
    fault: Option<u8>,
    /// Bits of the limits ([`control::Limits`]).
    limits: u16,
    /// Indices of the events in [`control::Event::ALL`], in order of time.
    events: [Option<u8>; control::Events::MOST],
    /// Command of the drive.
    command: Command,
}

impl From<&control::Report> for Report {
    fn from(report: &control::Report) -> Self {
        let mut events = [None; control::Events::MOST];
        for (slot, event) in events.iter_mut().zip(report.events.iter()) {
            *slot = place(control::Event::ALL, event);
        }
        Self {
            cycle: report.cycle,
            k: report.k,
            amplitude: report.amplitude,
            lead: report.lead,
            shape: report.shape.into(),
            reference: report.reference,
            setpoint: report.setpoint,
            rate: report.rate,
            phase: report.phase,
            concentration: report.concentration,
            regime: report.regime.map(Into::into),
            frequency: report.frequency,
            confidence: report.confidence,
            in_gear: report.in_gear,
            in_gear_error: report.in_gear_error,
            gear: report.gear,
            to_loss: report.to_loss,
            margin: report.margin.map(Into::into),
            expected_in_gear: report.expected_in_gear,
            load: report.load.map(Into::into),
            attempts: report.attempts,
            identification: report.identification.into(),
            state: report.state.number(),
            fault: report
                .fault
                .and_then(|fault| place(control::Fault::ALL, fault)),
            limits: report.limits.bits(),
            events,
            command: report.command.into(),
        }
    }
}

impl TryFrom<Report> for control::Report {
    type Error = Unreadable;

    /// Error for an index past the end of its list, or for an unknown limit bit.
    fn try_from(report: Report) -> Result<Self, Unreadable> {
        let mut events = control::Events::default();
        for at in report.events.into_iter().flatten() {
            events.push(item(control::Event::ALL, at)?);
        }
        Ok(Self {
            cycle: report.cycle,
            k: report.k,
            amplitude: report.amplitude,
            lead: report.lead,
            shape: report.shape.into(),
            reference: report.reference,
            setpoint: report.setpoint,
            rate: report.rate,
            phase: report.phase,
            concentration: report.concentration,
            regime: report.regime.map(Into::into),
            frequency: report.frequency,
            confidence: report.confidence,
            in_gear: report.in_gear,
            in_gear_error: report.in_gear_error,
            gear: report.gear,
            to_loss: report.to_loss,
            margin: report.margin.map(Into::into),
            expected_in_gear: report.expected_in_gear,
            load: report.load.map(Into::into),
            attempts: report.attempts,
            identification: report.identification.into(),
            state: item(control::State::ALL, report.state)?,
            fault: report
                .fault
                .map(|at| item(control::Fault::ALL, at))
                .transpose()?,
            limits: control::Limits::from_bits(report.limits).ok_or(Unreadable::Unknown)?,
            events,
            command: report.command.into(),
        })
    }
}

fn place<T: Copy + PartialEq>(list: &[T], item: T) -> Option<u8> {
    let at = list.iter().position(|known| *known == item)?;
    u8::try_from(at).ok()
}

fn item<T: Copy>(list: &[T], at: u8) -> Result<T, Unreadable> {
    list.get(usize::from(at))
        .copied()
        .ok_or(Unreadable::Unknown)
}

/// Command of the drive from the next cycle on; [`control::Command`] on the line, without the parts
/// that leave the output unchanged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Command {
    /// Amplitude of the output over full output, 0..1.
    amplitude: f32,
    /// Phase lead of the output, in 2^-32 turns.
    lead: u32,
    /// Second and third tone of the output along sine and cosine of its multiplied phase, over full
    /// output.
    overtones: [[f32; 2]; control::UPPER],
    /// Advance of the phase per sample ([`control::phase_step`]).
    step: u32,
    /// Whether the output changes at once, not at the next cycle.
    immediate: bool,
    /// Output phase at which the folding of the residual over cycles begins, in 2^-32 turns.
    fold: Option<u32>,
}

impl From<control::Command> for Command {
    fn from(command: control::Command) -> Self {
        Self {
            amplitude: command.amplitude,
            lead: command.lead.bits(),
            overtones: command.overtones.map(|tone| [tone.sine, tone.cosine]),
            step: command.step,
            immediate: command.immediate,
            fold: command.fold.map(Phase::bits),
        }
    }
}

impl From<Command> for control::Command {
    fn from(command: Command) -> Self {
        let overtone = |[sine, cosine]: [f32; 2]| control::Overtone { sine, cosine };
        Self {
            amplitude: command.amplitude,
            lead: Phase::from_bits(command.lead),
            overtones: command.overtones.map(overtone),
            step: command.step,
            immediate: command.immediate,
            fold: command.fold.map(Phase::from_bits),
            whole: false,
        }
    }
}

/// Stability margin of gear; [`control::GearMargin`] on the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Margin {
    /// Trace of the tangent map (symbol tr J).
    pub trace: f32,
    /// Estimated restitution (symbol R).
    pub restitution: f32,
    /// Standard error of the restitution.
    pub error: f32,
    /// Estimated standard deviation of the restitution from impact to impact (symbol s).
    pub scatter: f32,
    /// Distance of the trace from its value at the flip bifurcation.
    pub flip: f32,
    /// Predicted drive cycles to the next loss of gear.
    pub to_loss: f32,
}

/// Estimated load of the track; [`control::Load`] on the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Load {
    /// Mass of the parts in g (symbol m).
    pub mass: f32,
    /// Their conveying speed in mm/s.
    pub speed: f32,
    /// Mass flow off the track in g/s; 0 without a configured length of the track.
    pub flow: f32,
}

impl From<control::Load> for Load {
    fn from(own: control::Load) -> Self {
        let control::Load { mass, speed, flow } = own;
        Self { mass, speed, flow }
    }
}

impl From<Load> for control::Load {
    fn from(sent: Load) -> Self {
        let Load { mass, speed, flow } = sent;
        Self { mass, speed, flow }
    }
}

/// A regime with its confidence; [`classify::Verdict`] on the line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Verdict {
    /// The regime.
    regime: Regime,
    /// Confidence, 0..=1.
    confidence: f32,
}

impl From<classify::Verdict> for Verdict {
    fn from(verdict: classify::Verdict) -> Self {
        Self {
            regime: verdict.regime.into(),
            confidence: verdict.confidence,
        }
    }
}

impl From<Verdict> for classify::Verdict {
    fn from(verdict: Verdict) -> Self {
        Self {
            regime: verdict.regime.into(),
            confidence: verdict.confidence,
        }
    }
}

/// Regime of a part; [`classify::Regime`] on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Regime {
    /// No impacts.
    Rest,
    /// Hops, chatters to rest, and is thrown off again.
    HopAndRest {
        /// Drive cycles from rest to rest.
        cycles: u32,
    },
    /// One impact every `order` cycles, at one phase.
    Locked {
        /// Drive cycles per impact (symbol r).
        order: u32,
    },
    /// The period is `2^doublings` impacts of `order` cycles on average.
    Doubled {
        /// Drive cycles per impact (symbol r).
        order: u32,
        /// Number of period doublings.
        doublings: u32,
    },
    /// The period is `impacts` impacts in `cycles` cycles, and no doubling of a lock.
    Periodic {
        /// Impacts in a period (symbol p).
        impacts: u32,
        /// Drive cycles in a period.
        cycles: u32,
    },
    /// No repetition.
    Chaotic,
    /// Too few impacts, or contradictory ones.
    Undecided,
}

/// Progress of an identification; [`control::Identification`] on the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Identification {
    /// None was requested.
    #[default]
    Idle,
    /// In progress.
    Listening {
        /// Number of hops detected.
        hops: u16,
    },
    /// Completed with a result.
    Found(Identified),
    /// Completed without a result.
    NotFound(Unidentified),
}

/// An identified restitution; [`control::Identified`] on the line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identified {
    /// Restitution normal to the track (symbol R).
    pub restitution: f32,
    /// Standard error.
    pub deviation: f32,
    /// k during the measurement.
    pub k: f32,
    /// Standard deviation of the restitution from impact to impact; 0 if none is detected.
    pub scatter: f32,
    /// Number of hops measured.
    pub hops: u16,
}

/// Reason for a missing result; [`control::Unidentified`] on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Unidentified {
    /// No pattern repeats in each cycle.
    Quiet,
    /// The repeating pattern is no chatter of parts with one restitution.
    Unlike,
    /// The second impact is hidden in the ringing of the first.
    Dead,
    /// The restitution scatters from impact to impact or from part to part.
    Scattered,
    /// The drive did not become steady in time.
    Unsteady,
}

/// Conversions between equal variants of a controller's type and its type on the line.
macro_rules! mirrored {
    ($kind:ident of $home:ident: $($item:ident $(($inner:ident))? $({ $($field:ident),+ })?),+) => {
        impl From<$home::$kind> for $kind {
            fn from(own: $home::$kind) -> Self {
                match own { $(
                    $home::$kind::$item $(($inner))? $({ $($field),+ })? =>
                        Self::$item $(($inner.into()))? $({ $($field),+ })?
                ),+ }
            }
        }
        impl From<$kind> for $home::$kind {
            fn from(sent: $kind) -> Self {
                match sent { $(
                    $kind::$item $(($inner))? $({ $($field),+ })? =>
                        Self::$item $(($inner.into()))? $({ $($field),+ })?
                ),+ }
            }
        }
    };
}

mirrored!(Regime of classify: Rest, HopAndRest { cycles }, Locked { order }, Doubled { order, doublings },
    Periodic { impacts, cycles }, Chaotic, Undecided);
mirrored!(Identification of control: Idle, Listening { hops }, Found(found), NotFound(why));
mirrored!(Unidentified of control: Quiet, Unlike, Dead, Scattered, Unsteady);

impl From<control::GearMargin> for Margin {
    fn from(own: control::GearMargin) -> Self {
        let control::GearMargin {
            trace,
            restitution,
            error,
            scatter,
            flip,
            to_loss,
        } = own;
        Self {
            trace,
            restitution,
            error,
            scatter,
            flip,
            to_loss,
        }
    }
}

impl From<Margin> for control::GearMargin {
    fn from(sent: Margin) -> Self {
        let Margin {
            trace,
            restitution,
            error,
            scatter,
            flip,
            to_loss,
        } = sent;
        Self {
            trace,
            restitution,
            error,
            scatter,
            flip,
            to_loss,
        }
    }
}

impl From<control::Identified> for Identified {
    fn from(found: control::Identified) -> Self {
        let control::Identified {
            restitution,
            deviation,
            k,
            scatter,
            hops,
        } = found;
        Self {
            restitution,
            deviation,
            k,
            scatter,
            hops,
        }
    }
}

impl From<Identified> for control::Identified {
    fn from(found: Identified) -> Self {
        let Identified {
            restitution,
            deviation,
            k,
            scatter,
            hops,
        } = found;
        Self {
            restitution,
            deviation,
            k,
            scatter,
            hops,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Event, Events, Fault, Limits, State};

    /// A report whose fields all differ from their defaults.
    fn report() -> control::Report {
        let mut events = Events::default();
        for event in [
            Event::Started,
            Event::NotIdentified,
            Event::Faulted,
            Event::Locked,
        ] {
            events.push(event);
        }
        control::Report {
            cycle: 70_000,
            k: 0.41,
            amplitude: 1.5e-3,
            lead: -1.5,
            shape: control::Shape {
                second: control::UpperTone {
                    ratio: 0.125,
                    phase: 2.25,
                },
                third: control::UpperTone {
                    ratio: 0.0625,
                    phase: -1.25,
                },
            },
            reference: 1.4e-3,
            setpoint: 1.6e-3,
            rate: 1.25,
            phase: 0.7,
            concentration: 0.9,
            regime: Some(classify::Verdict {
                regime: classify::Regime::Doubled {
                    order: 2,
                    doublings: 1,
                },
                confidence: 0.75,
            }),
            frequency: 50.0,
            confidence: 0.95,
            in_gear: 0.75,
            in_gear_error: 0.03125,
            gear: 1,
            to_loss: 500.0,
            margin: Some(control::GearMargin {
                trace: -0.5,
                restitution: 0.25,
                error: 0.125,
                scatter: 0.0625,
                flip: 0.5,
                to_loss: 1000.0,
            }),
            expected_in_gear: 0.85,
            load: Some(control::Load {
                mass: 250.0,
                speed: 93.5,
                flow: 46.75,
            }),
            attempts: 2,
            identification: control::Identification::NotFound(control::Unidentified::Dead),
            state: State::Fault,
            fault: Some(Fault::StackLow),
            limits: Limits::from_bits(Limits::OUTPUT.bits() | Limits::LINK_LOST.bits()).unwrap(),
            events,
            command: control::Command {
                amplitude: 0.3,
                lead: Phase::from_bits(1 << 27),
                overtones: [
                    control::Overtone {
                        sine: 0.25,
                        cosine: -0.5,
                    },
                    control::Overtone {
                        sine: 0.125,
                        cosine: 0.0625,
                    },
                ],
                step: 10_737_418,
                immediate: true,
                fold: Some(Phase::from_bits(1 << 30)),
                whole: false,
            },
        }
    }

    /// Postcard encoding of [`report`] by an independent program.
    const SENT: &[u8] = &[
        0xf0, 0xa2, 0x04, 0x85, 0xeb, 0xd1, 0x3e, 0xa6, 0x9b, 0xc4, 0x3a, 0x00, 0x00, 0xc0, 0xbf,
        0x00, 0x00, 0x00, 0x3e, 0x00, 0x00, 0x10, 0x40, 0x00, 0x00, 0x80, 0x3d, 0x00, 0x00, 0xa0,
        0xbf, 0x34, 0x80, 0xb7, 0x3a, 0x17, 0xb7, 0xd1, 0x3a, 0x00, 0x00, 0xa0, 0x3f, 0x33, 0x33,
        0x33, 0x3f, 0x66, 0x66, 0x66, 0x3f, 0x01, 0x03, 0x02, 0x01, 0x00, 0x00, 0x40, 0x3f, 0x00,
        0x00, 0x48, 0x42, 0x33, 0x33, 0x73, 0x3f, 0x00, 0x00, 0x40, 0x3f, 0x00, 0x00, 0x00, 0x3d,
        0x01, 0x00, 0x00, 0xfa, 0x43, 0x01, 0x00, 0x00, 0x00, 0xbf, 0x00, 0x00, 0x80, 0x3e, 0x00,
        0x00, 0x00, 0x3e, 0x00, 0x00, 0x80, 0x3d, 0x00, 0x00, 0x00, 0x3f, 0x00, 0x00, 0x7a, 0x44,
        0x9a, 0x99, 0x59, 0x3f, 0x01, 0x00, 0x00, 0x7a, 0x43, 0x00, 0x00, 0xbb, 0x42, 0x00, 0x00,
        0x3b, 0x42, 0x02, 0x03, 0x02, 0x07, 0x01, 0x08, 0x82, 0x01, 0x01, 0x00, 0x01, 0x14, 0x01,
        0x0e, 0x01, 0x08, 0x00, 0x00, 0x9a, 0x99, 0x99, 0x3e, 0x80, 0x80, 0x80, 0x40, 0x00, 0x00,
        0x80, 0x3e, 0x00, 0x00, 0x00, 0xbf, 0x00, 0x00, 0x00, 0x3e, 0x00, 0x00, 0x80, 0x3d, 0x8a,
        0xae, 0x8f, 0x05, 0x01, 0x01, 0x80, 0x80, 0x80, 0x80, 0x04,
    ];

    #[test]
    fn a_report_has_the_bytes_that_it_always_had() {
        let mut buffer = [0; 256];
        let bytes = postcard::to_slice(&Report::from(&report()), &mut buffer).unwrap();
        assert_eq!(bytes, SENT);
    }

    #[test]
    fn every_report_comes_back_as_it_was() {
        for &state in State::ALL {
            for fault in core::iter::once(None).chain(Fault::ALL.iter().copied().map(Some)) {
                let one = control::Report {
                    state,
                    fault,
                    ..report()
                };
                assert_eq!(control::Report::try_from(Report::from(&one)), Ok(one));
            }
        }
        for &event in Event::ALL {
            let mut events = Events::default();
            events.push(event);
            let one = control::Report { events, ..report() };
            assert_eq!(control::Report::try_from(Report::from(&one)), Ok(one));
        }
    }

    #[test]
    fn what_no_list_holds_is_refused() {
        let sound = Report::from(&report());
        for wrong in [
            Report {
                state: State::ALL.len() as u8,
                ..sound
            },
            Report {
                fault: Some(Fault::ALL.len() as u8),
                ..sound
            },
            Report { limits: 1, ..sound },
            Report {
                events: [Some(Event::ALL.len() as u8); 6],
                ..sound
            },
        ] {
            let read = control::Report::try_from(wrong);
            assert_eq!(read, Err(Unreadable::Unknown), "{wrong:?}");
        }
    }
}
