//! The exact impact map of a part on a vibrating track (Hongler & Figour 1989, equations 7 to 10).
//!
//! A part is launched at phase t with velocity psi relative to the track, in units of `b w`. The
//! flight time is the smallest d > 0 with
//! `u(d) = (cos t + psi) d - k d^2 / 2 - [sin(t + d) - sin t] = 0`. After the impact `psi' = R v`,
//! with the arrival speed `v = -u'(d)`. On a track of several tones S replaces the sine and S' the
//! cosine (`Wave`).
//!
//! Where each arithmetic finds the first impact:
//!
//! | kernel | for | from launch to landing | cases without a closed form |
//! |---|---|---|---|
//! | [`Map`] | f64, desk | `double/{first,tall,short,low}.rs` | `double/search.rs` |
//! | `WaveMap` | f64, two or three tones | `tones/first.rs` | `tones/search.rs` |
//! | `batch::Block` | many f64 orbits | `batch/{in_place,gathered}.rs` | `double/first.rs` |
//! | [`Hybrid`] | CPU with f32: the board | `anchor/{hybrid,candidate}.rs` | `anchor/search.rs` |
//! | [`Single`] | f32, pictures | `anchor/{single,candidate}.rs` | `anchor/search.rs` |
//! | `WaveSingle` | f32, two or three tones | `anchor/tones/search.rs` | |
//! | [`Integer`] | CPU without an FPU | `integer/{map,approach}.rs` | `integer/search.rs` |
//!
//! `kernel.rs` defines the states, the impact and the common trait. `wave.rs` defines the motion of
//! a track of several tones. `set_up.rs` computes the constants of the microcontroller kernels.
//! `orbit/` joins impacts, rests and lift-offs. The families share no search, because each is
//! certified against the rounding of its own arithmetic.

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
