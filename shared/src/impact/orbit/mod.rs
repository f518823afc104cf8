//! The orbit of a part: the sequence of impacts, rests and lift-offs, and its observers.

mod along;
mod contact;
mod events;
mod friction;
mod observe;
mod release;
mod tangent;
mod tangential;
mod wave_orbit;

pub use along::{Along, ContactMotion};
pub use contact::Contact;
pub use events::{Orbit, OrbitEvent, StopReason};
pub use friction::{Friction, FrictionSettings};
pub use observe::{Count, Observer};
pub use release::LIFT_OFF_DELAY;
pub use release::Release;
pub use tangent::{Growth, Tangent};
pub use tangential::{Tangential, TangentialSettings};
pub use wave_orbit::WaveOrbit;
