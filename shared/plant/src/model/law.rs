//! Laws of the parts' motion along the track (docs/theory-transport.md#t8.1).

use kband::impact::{FrictionSettings, TangentialSettings, Wave};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// Tangential restitution: an impact keeps a share of the velocity along the track; at rest 0.
    Restitution(TangentialSettings),
    /// Coulomb friction with sliding.
    Friction(FrictionSettings),
}

impl Law {
    /// Acceleration of a free part along the track over it, in `b w^2`, at a phase in rad.
    pub fn push(&self, wave: Option<&Wave>, k: f64, phase: f64) -> f64 {
        let [ratio, lead, incline] = match self {
            Self::Restitution(it) => [it.amplitude_ratio, it.phase_lead, it.incline_tangent],
            Self::Friction(it) => [it.amplitude_ratio, it.phase_lead, it.incline_tangent],
        };
        ratio * push_of(wave, phase + lead) - k * incline
    }
}

/// Downward acceleration of the track in `b w^2` at a phase in rad; without a wave it is a sine.
pub fn push_of(wave: Option<&Wave>, phase: f64) -> f64 {
    wave.map_or_else(|| libm::sin(phase), |wave| wave.push(phase))
}
