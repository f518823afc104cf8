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
//! | `WaveMap` | f64, two or three tones | `wave_map/first.rs` | `wave_map/search.rs` |
//! | `batch::Block` | many f64 orbits | `batch/mod.rs` | `double/first.rs` |
//! | [`Single`] | f32, one tone: the board | `anchor/{single,candidate}.rs` | `anchor/search.rs` |
//! | [`Single`] | f32, two or three tones | `anchor/wave_single/search.rs` | |
//! | [`Integer`] | fixed point alone | `integer.rs` | |
//!
//! `kernel.rs` defines the states, the impact and the common trait. `wave.rs` defines the motion of
//! a track of several tones. `set_up.rs` computes the constants of the microcontroller kernels.
//! `contact_time.rs` lets an impact take time. `orbit/` joins impacts, rests and lift-offs. The
//! families share no search, because each is certified against the rounding of its own arithmetic.

mod anchor;
pub mod batch;
mod contact_time;
mod double;
mod integer;
mod kernel;
mod orbit;
mod scatter;
mod set_up;
mod wave;
mod wave_map;

#[cfg(test)]
mod tests;

pub use anchor::{Single, SingleState};
pub use contact_time::ContactTime;
pub(crate) use contact_time::speed_gain;
pub use double::Map;
pub use integer::{Integer, IntegerState};
pub use kernel::{Impact, Kernel, Landing, PartState, WaveKernel};
pub(crate) use orbit::{Along, OrbitMap, StopReason};
pub use orbit::{
    ContactMotion, Friction, FrictionSettings, Growth, LIFT_OFF_DELAY, Observer, Orbit, OrbitEvent,
    Release, Tangent, Tangential, TangentialSettings,
};
pub use scatter::Scatter;
pub use wave::{Tone, Wave};
pub use wave_map::{Hop, WaveMap};
