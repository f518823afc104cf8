//! Control of the track's amplitude, tones and frequency.
//!
//! | file | holds |
//! |---|---|
//! | `scale` | conversion between amplitude, k and output; the hard limits |
//! | `reference` | the reference of the amplitude loop, from cycle to cycle |
//! | `envelope` | model of the amplitude under the output, at the resonance and off it |
//! | `amplitude` | the loop that holds the amplitude |
//! | `observer` | the observer that estimates and compensates the parts' load |
//! | `margins` | the stability margins of the amplitude loop |
//! | `answer` | the drive's response at its frequency and at multiples of it |
//! | `shape` | the upper tones of the motion |
//! | `tone` | the loop that holds one of them |
//! | `tones` | these loops together, within output and hard limits |
//! | `resonance` | the drive's frequency: a sweep that finds the resonance, a loop that tracks it |

mod amplitude;
mod answer;
mod envelope;
mod margins;
mod observer;
mod reference;
mod resonance;
mod scale;
mod shape;
mod tone;
mod tones;

pub use amplitude::AmplitudeLoop;
pub use answer::upper_response;
pub use envelope::absolute;
pub use margins::LoopMargins;
pub use observer::ImpactPhase;
pub use reference::{Approach, Reference};
pub use resonance::Resonance;
pub use scale::Scale;
pub use shape::{Shape, TrackMotion, UPPER, UpperTone};
pub use tones::{ToneInputs, Tones, affordable_tones};
