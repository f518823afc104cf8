//! What carries parts along the track.

use crate::impact::{FrictionSettings, TangentialSettings};

/// What carries parts along the track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// The paper's: an impact leaves a share of the velocity along the track, and a part at rest lies still.
    Restitution(TangentialSettings),
    /// Coulomb's friction, sliding included.
    Friction(FrictionSettings),
}
