//! Laws of the parts' motion along the track (docs/theory-transport.md#t8.1).

use kband::impact::{FrictionSettings, TangentialSettings};

/// Law of the parts' motion along the track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// Tangential restitution: an impact keeps a share of the velocity along the track, and a part
    /// at rest does not slide.
    Restitution(TangentialSettings),
    /// Coulomb friction with sliding.
    Friction(FrictionSettings),
}
