//! The orbit of a part: the sequence of impacts, rests and lift-offs, and its observers.

#[cfg(any(test, feature = "analysis", feature = "control"))]
mod along;
mod contact;
mod events;
#[cfg(any(test, feature = "analysis", feature = "control"))]
mod friction;
mod observe;
mod release;
mod tangent;
#[cfg(any(test, feature = "analysis", feature = "control"))]
mod tangential;
#[cfg(any(test, feature = "analysis", feature = "control"))]
mod wave_contact;
#[cfg(any(test, feature = "analysis", feature = "control"))]
mod wave_orbit;

#[cfg(any(test, feature = "analysis", feature = "plant"))]
pub(crate) use along::AlongLaw;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use along::{Along, Lain};
pub use contact::Contact;
#[cfg(any(test, feature = "unstable"))]
pub use events::Skips;
pub use events::{Ended, Orbit, OrbitEvent};
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use friction::{Friction, FrictionSettings};
pub use observe::{Count, Observer};
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use release::LATE;
#[cfg(any(test, feature = "control"))]
pub use release::Release;
pub use tangent::{Growth, Tangent};
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use tangential::{Tangential, TangentialSettings};
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub use wave_orbit::WaveOrbit;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub(crate) use wave_orbit::{Next, WavePart};
