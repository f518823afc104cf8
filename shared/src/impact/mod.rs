//! The exact impact map of a part on a vibrating track (Hongler & Figour 1989, equations 7 to 10).
//!
//! A part launched at phase t with velocity psi relative to the track, in units of `b w`, flies for
//! the FIRST d > 0 with
//! `u(d) = (cos t + psi) d - k d^2 / 2 - [sin(t + d) - sin t] = 0` and leaves again with
//! `psi' = R v`, where `v = -u'(d)` is its arrival speed. On a track of several tones S stands for the sine
//! and S' for the cosine (`Wave`).
//!
//! Where the first impact is found, for each arithmetic:
//!
//! | kernel | for | its impact, from the launch to the landing | the cases that closed forms leave open |
//! |---|---|---|---|
//! | [`Map`] | f64, at the desk | `double/first.rs`, by kind: `double/{tall,short,low}.rs` | `double/search.rs` |
//! | `WaveMap` | f64, a track of two or three tones | `tones/first.rs` | `tones/search.rs` |
//! | `batch::Block` | many orbits in f64 | `batch/{in_place,gathered}.rs`: that of [`Map`] over lanes | `double/first.rs` |
//! | [`Hybrid`] | a CPU with an FPU for f32: the board | `anchor/hybrid.rs`, by `anchor/candidate.rs` | `anchor/search.rs` |
//! | [`Single`] | f32, pictures | `anchor/single.rs`, by `anchor/candidate.rs` | `anchor/search.rs` |
//! | `WaveSingle` | f32, tracks of two or three tones: plans on the board | `anchor/tones/search.rs` | |
//! | [`Integer`] | a CPU without an FPU | `integer/map.rs`, by `integer/approach.rs` | `integer/search.rs` |
//!
//! `kernel.rs` says what they have in common, `wave.rs` how a track of several tones moves, `set_up.rs` what those for
//! microcontrollers are set up from, and `orbit/` strings impacts, rests and lift-offs together. The families share no search: each is
//! certified by the rounding of its own arithmetic.

mod anchor;
#[cfg(any(test, feature = "analysis"))]
pub mod batch;
mod double;
mod integer;
mod kernel;
mod orbit;
mod scatter;
mod set_up;
#[cfg(any(test, feature = "analysis", feature = "control"))]
mod tones;
#[cfg(any(test, feature = "analysis", feature = "control"))]
mod wave;

#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use anchor::WaveSingle;
pub use anchor::{Hybrid, Single, SingleState};
pub use double::Map;
#[cfg(any(test, feature = "unstable"))]
pub use double::PassedHumps;
pub use integer::Integer;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use kernel::WaveKernel;
pub use kernel::{HybridState, Impact, Kernel, Landing, PartState, SingleImpact};
#[cfg(any(test, feature = "analysis", feature = "plant"))]
pub(crate) use orbit::AlongLaw;
#[cfg(feature = "control")]
pub(crate) use orbit::Release;
#[cfg(any(test, feature = "unstable"))]
pub use orbit::Skips;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use orbit::{Along, Friction, FrictionSettings, Lain};
pub use orbit::{Contact, Count, Ended, Growth, Observer, Orbit, OrbitEvent, Tangent};
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub(crate) use orbit::{LATE, Next, WavePart};
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use orbit::{Tangential, TangentialSettings, WaveOrbit};
pub use scatter::Scatter;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use tones::WaveMap;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use wave::{Tone, Wave};
