//! Contact of the part with the track: chatter, rest and lift-off.

use core::f64::consts::{PI, TAU};

use super::{Map, State};

/// When contact of a part with the track begins and ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Phase where a resting part is thrown off (`arcsin k`) in rad, `None` where k >= 1: it rests
    /// for ever.
    lift_off: Option<f64>,
}

impl Contact {
    /// Contact on the track of `map`.
    #[must_use]
    pub fn new(map: &Map) -> Self {
        Self {
            lift_off: (map.k() < 1.0).then(|| libm::asin(map.k())),
        }
    }

    /// Phase where a resting part is thrown off (`arcsin k`) in rad; `None` where it rests for ever.
    #[must_use]
    pub fn lift_off(&self) -> Option<f64> {
        self.lift_off
    }

    /// Duration of the infinitely many hops that end at rest, in rad, where `state` chatters to rest
    /// so closely that the second-order closure is exact to f64 (physics, section 4); else `None`.
    ///
    /// `x = 2 psi / (A (1 - R))`, duration `x (1 + x cos t / (3 A))`, `A = k - sin t`.
    #[must_use]
    pub fn time_to_rest(&self, map: &Map, state: State) -> Option<f64> {
        let pull = map.k() - libm::sin(state.phase);
        if map.restitution() >= 1.0
            || pull <= 0.0
            || state.velocity > 1e-5 * pull * (1.0 - map.restitution())
        {
            return None;
        }
        let x = 2.0 * state.velocity / (pull * (1.0 - map.restitution()));
        let c = libm::cos(state.phase);
        let duration = x * (1.0 + x * c / (3.0 * pull));
        // The expansion holds where the pull barely changes during the chatter, which also keeps the
        // rest inside sin < k.
        (x * libm::fabs(c) <= 1e-4 * pull).then_some(duration)
    }

    /// Wait from `phase`, where the part rests, to lift-off, in rad, 0 where the track throws it at
    /// once; `None` where it rests for ever.
    #[must_use]
    pub fn wait(&self, phase: f64) -> Option<f64> {
        let lift_off = self.lift_off?;
        let past = (phase - lift_off).rem_euclid_tau();
        Some(if past <= PI - 2.0 * lift_off {
            0.0
        } else {
            TAU - past
        })
    }
}

trait Turn {
    fn rem_euclid_tau(self) -> f64;
}

impl Turn for f64 {
    fn rem_euclid_tau(self) -> f64 {
        self - TAU * libm::floor(self / TAU)
    }
}
