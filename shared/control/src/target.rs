//! Targets: the requested behaviour of the parts.

use crate::{Shape, identify};
use kband::feeder::OutOfRange;
use serde::{Deserialize, Serialize};

/// The user's target for the parts. On the line a variant is its index here.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Target {
    /// Parts locked to the drive, one impact every `order` cycles.
    Locked {
        /// Drive cycles per impact (symbol r), 1..=8.
        order: u8,
    },
    /// Parts in chaotic motion.
    Chaotic,
    /// A value of k, 0.02..10.
    K(f32),
    /// A normal amplitude b in mm.
    Amplitude(f32),
    /// A conveying speed in mm/s, positive upwards: the lock that conveys at it.
    Speed(f32),
    /// Identification of the parts' restitution from hops and rests
    /// ([`Identification`](crate::Identification)): a step of commissioning.
    Identify,
    /// Parts in gear, one flight every `order` cycles, for as long as the lot allows.
    Gear {
        /// Drive cycles per flight (symbol r), 1..=8.
        order: u8,
    },
    /// A value of k, 0.02..10, with upper tones of the track.
    Tones {
        /// k of the first tone.
        k: f32,
        /// The upper tones; their ratios at most the settings `second_tone` and `third_tone`.
        shape: Shape,
    },
    /// A mass flow in g/s, above 0: parts in gear, of the order that gives this flow.
    Flow(f32),
    /// Parts a minute, above 0: the lock that conveys touching parts of `part_length` at this rate.
    PartsPerMinute(f32),
}

impl Target {
    /// The error for its number, with the accepted range.
    pub(crate) fn refused(self, accepted: &'static str) -> OutOfRange {
        let (parameter, value) = match self {
            Self::Locked { order } => ("target locked order", f64::from(order)),
            Self::Gear { order } => ("target gear order", f64::from(order)),
            Self::K(k) | Self::Tones { k, .. } => ("target k", f64::from(k)),
            Self::Amplitude(b) => ("target amplitude", f64::from(b)),
            Self::Speed(speed) => ("target speed", f64::from(speed)),
            Self::Flow(flow) => ("target flow", f64::from(flow)),
            Self::PartsPerMinute(rate) => ("target parts a minute", f64::from(rate)),
            Self::Chaotic => ("target chaotic, order of its lock", 1.0),
            Self::Identify => ("target identify, k that it begins at", identify::FIRST_K),
        };
        OutOfRange {
            parameter,
            value,
            accepted,
        }
    }
}
