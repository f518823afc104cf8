//! Control of the track's amplitude, tones and frequency.

mod amplitude;
mod envelope;
mod margins;
mod observer;
mod reference;
mod resonance;
mod scale;
mod shape;
mod tone;
mod tones;

pub use amplitude::{AmplitudeLoop, DEAD_TIME_CYCLES};
pub use envelope::absolute;
pub use margins::LoopMargins;
pub use observer::ImpactPhase;
pub use reference::{Approach, Reference};
pub use resonance::Resonance;
pub use scale::Scale;
pub use shape::{Shape, TrackMotion, UPPER, UpperTone};
pub use tones::{ToneInputs, Tones, affordable_tones, upper_response};
