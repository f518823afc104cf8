//! The orbit of a part: impacts, rests and lift-offs in turn, and what is watched of them.

mod contact;
mod events;
mod observe;
mod release;
mod tangent;
mod tangential;
mod wave_contact;
mod wave_orbit;

pub use contact::Contact;
#[cfg(any(test, feature = "unstable"))]
pub use events::Skips;
pub use events::{Ended, Event, Orbit};
pub use observe::{Count, Observer};
pub use release::LATE;
#[cfg(any(test, feature = "control"))]
pub use release::Release;
pub use tangent::{Growth, Tangent};
pub use tangential::{Tangential, TangentialSettings};
pub use wave_contact::WaveContact;
pub use wave_orbit::WaveOrbit;
pub(crate) use wave_orbit::{Next, WavePart};
