//! The controller of a feeder drive: what it measures, hears, decides and does.
//!
//! Two calls make a drive: [`Signal::sample`] in the sample interrupt at [`SAMPLE_RATE`], and
//! [`Controller::cycle`] once per drive cycle, whose command the signal path latches at the next wrap
//! of its phase. [`Controller::plan_step`] plans in idle time. All of it is single precision,
//! integers and the map: the same bits at the desk, in the emulator and on the board.
//!
//! | word | means |
//! |---|---|
//! | output | what the drive is given, a share of full output |
//! | reference | the amplitude that the loop follows now |
//! | setpoint | the amplitude chosen for the target |
//! | target | what the user wants of the parts |
//! | lead | phase of the track before the output |
//! | kick | a rise of the amplitude that throws parts onto the wanted orbit |
//! | fold | what is heard of many cycles, summed by phase |
//! | limit | it is holding back |
//! | fault | it stopped |

mod aim;
mod amplitude;
mod angle;
mod capture;
mod chaos;
mod chatter;
mod controller;
mod course;
mod fit;
mod fold;
mod hearing;
mod identify;
mod listen;
mod listening;
mod reference;
mod report;
mod resonance;
mod restraint;
mod ringing;
mod scale;
mod setpoint;
mod settings;
mod signal;
mod speed;
mod supervise;
mod suspicion;
mod transition;

pub use amplitude::AmplitudeLoop;
pub use angle::{phase_of, radians_of};
pub use capture::Planned;
pub use chaos::Chaos;
pub use controller::{Controller, PLAN_SLICES};
pub(crate) use fold::Fold;
pub use fold::Folded;
pub use hearing::Hearing;
pub use identify::{Identification, Identified, Unidentified};
pub use listen::{Ear, HEARD_PER_CYCLE, Heard};
pub use report::{Inputs, Report, Start};
pub use setpoint::{NoSetpoint, Target};
pub use settings::{Key, Settings};
pub use signal::{AdcCode, Command, Cycle, SAMPLE_RATE, Sampled, Signal, phase_step};
pub use supervise::{Event, Events, Fault, Limits, State};
pub use transition::{TRANSITIONS, Transition};
