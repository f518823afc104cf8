//! The orbit of a part: the sequence of impacts, rests and lift-offs, and its observers.

mod along;
mod contact;
mod events;
mod friction;
mod observe;
mod orbit_map;
mod push;
mod tangent;
mod tangential;

pub(crate) use along::Along;
pub use along::ContactMotion;
pub(crate) use events::StopReason;
pub use events::{Orbit, OrbitEvent};
pub use friction::{Friction, FrictionSettings};
pub use observe::Observer;
pub(crate) use orbit_map::OrbitMap;
pub use orbit_map::{LIFT_OFF_DELAY, Release};
pub use tangent::{Growth, Tangent};
pub use tangential::{Tangential, TangentialSettings};
