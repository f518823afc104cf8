//! The track's amplitude, brought to where it is wanted.
//!
//! | file | holds |
//! |---|---|
//! | `scale` | what an amplitude means for the parts, for the hard limits, for the output |
//! | `reference` | the amplitude that the loop follows, from cycle to cycle |
//! | `envelope` | how the amplitude follows the output from cycle to cycle, at the resonance and off it |
//! | `amplitude` | the loop that holds the amplitude |
//! | `margins` | the margins of that loop |
//! | `answer` | what the drive answers at its frequency and at the multiples of it |
//! | `shape` | the tones of the motion above the first |
//! | `tone` | the loop that holds one of them |
//! | `tones` | these loops together, and what output and hard limits leave them |
//! | `resonance` | the drive's frequency: a sweep that finds the resonance, a loop that follows it |

mod amplitude;
mod answer;
mod envelope;
#[cfg(any(test, feature = "unstable"))]
mod margins;
mod observer;
mod reference;
mod resonance;
mod scale;
mod shape;
mod tone;
mod tones;

pub use amplitude::AmplitudeLoop;
pub use answer::Answer;
pub use envelope::size;
#[cfg(feature = "unstable")]
pub use margins::LoopMargins;
pub use observer::Struck;
pub use reference::{Move, Reference};
pub use resonance::Resonance;
pub use scale::Scale;
pub use shape::{Shape, TrackMotion, UPPER, UpperTone};
pub use tones::{Asked, Tones, affordable_tones};
