//! A launch on a track of several tones.

use core::f64::consts::TAU;

use super::track::Track;
use crate::arithmetic::square_root;
use crate::arithmetic::vector::sine_cosine;
use crate::impact::double::launch::{MAX_CHATTER_REMAINDER, MAX_PULL_CHANGE};
use crate::impact::double::low::ROUNDING_MARGIN;
use crate::impact::wave::{Motion, Parts, motion};

/// The state just after an impact, with the quantities that every kind of flight uses.
#[derive(Clone, Copy)]
pub(super) struct Launch {
    /// Phase t in rad, 0..2 pi.
    pub phase: f64,
    /// Velocity psi relative to the track.
    pub velocity: f64,
    pub parts: Parts,
    pub at: Motion,
}

impl Launch {
    #[inline(always)]
    pub fn new<const N: usize>(track: &Track, phase: f64, velocity: f64) -> Self {
        let (sine, cosine) = sine_cosine(phase);
        Self::with_sine_cosine::<N>(track, phase, velocity, sine, cosine)
    }

    #[inline(always)]
    pub fn with_sine_cosine<const N: usize>(
        track: &Track,
        phase: f64,
        velocity: f64,
        sine: f64,
        cosine: f64,
    ) -> Self {
        let parts = track.wave.parts::<N>(sine, cosine);
        Self {
            phase,
            velocity,
            parts,
            at: motion::<N>(&parts),
        }
    }

    /// The ball's velocity at launch, `psi + S'`.
    #[inline(always)]
    pub fn rise(&self) -> f64 {
        self.velocity + self.at.speed
    }

    /// Pull to the track, `k - A`, in `b w^2`.
    #[inline(always)]
    pub fn pull(&self, track: &Track) -> f64 {
        track.k - self.at.push
    }

    /// Height of the ball over the middle of the stroke, `d` after launch.
    #[inline(always)]
    pub fn height(&self, track: &Track, d: f64) -> f64 {
        self.at.height + d * (self.rise() - 0.5 * track.k * d)
    }

    /// Square of the ball's speed at a height; negative if it does not reach it.
    #[inline(always)]
    pub fn speed_at(&self, track: &Track, height: f64) -> f64 {
        let v = self.rise();
        v * v + 2.0 * track.k * (self.at.height - height)
    }

    /// Time in rad at which the ball falls through a height.
    #[inline(always)]
    pub fn falls_to(&self, track: &Track, height: f64) -> f64 {
        let speed = square_root(self.speed_at(track, height).max(0.0));
        (self.rise() + speed) * track.per_k
    }

    /// Bound of the rounding error of a height: 30 times that at the apex.
    #[inline(always)]
    pub fn margin(&self, track: &Track) -> f64 {
        let v = self.rise();
        6e-14 * (2.0 + v * v * track.per_k)
    }

    /// Whether the ball leaves the track's reach faster than the track's top speed. It returns
    /// equally fast, so it meets the track once, in one monotone interval.
    #[inline(always)]
    pub fn is_tall(&self, track: &Track) -> bool {
        let leaving = self.speed_at(track, track.wave.top);
        1.2 * track.fastest + ROUNDING_MARGIN < leaving && 0.0 < self.rise()
    }

    /// Time in rad until a phase is reached, in 0..=2 pi, without 0.
    #[inline(always)]
    pub fn ahead(&self, phase: f64) -> f64 {
        let ahead = phase - self.phase;
        if ahead > 0.0 { ahead } else { ahead + TAU }
    }

    /// Whether the part rests: its velocity is 0 and the track does not throw it. Within rounding
    /// of lift-off (A rising through k) the part is thrown.
    #[inline(always)]
    pub fn rests(&self, track: &Track) -> bool {
        let rounding = if self.at.jerk > 0.0 {
            16.0 * f64::EPSILON
        } else {
            0.0
        };
        self.velocity <= 0.0 && self.pull(track) >= rounding
    }

    /// Duration in rad of the infinitely many hops that end at rest. `None` if its closed form does
    /// not hold within `limits`, and the part continues to hop.
    ///
    /// It is the form of [`Map::time_to_rest`](crate::impact::Map::time_to_rest) with the push A
    /// for the sine and A' for the cosine: `z = psi / (P (1 - R))` with the pull `P = k - A`.
    #[inline(always)]
    pub fn time_to_rest(
        &self,
        track: &Track,
        restitution: f64,
        limits: ChatterLimits,
    ) -> Option<f64> {
        let (hop, at) = (self.velocity, &self.at);
        let pull = self.pull(track);
        if hop <= 0.0 {
            let lower_bound = if at.jerk > 0.0 {
                -16.0 * f64::EPSILON
            } else {
                0.0
            };
            return (pull >= lower_bound).then_some(0.0);
        }
        let loss = 1.0 - restitution;
        if pull <= 0.0 || loss <= 0.0 {
            return None;
        }
        let (c, s) = (at.jerk.abs(), at.snap.abs());
        let z = hop / (pull * loss);
        let third = z * z * z * (2.1 * (c / pull) * (c / pull) + 0.9 * s / pull);
        let change = limits.pull_change * pull;
        let steady = 2.0 * z * c <= change && 2.0 * z * z * s <= change;
        (third <= limits.remainder && steady)
            .then(|| 2.0 * z + 4.0 / 3.0 * (at.jerk / pull) * z * z)
    }
}

/// Limits within which a chatter is summed in closed form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ChatterLimits {
    /// Largest third order of its duration, in rad.
    remainder: f64,
    /// Largest relative change of the pull during it.
    pull_change: f64,
}

impl ChatterLimits {
    /// The closed form is exact to f64.
    pub const EXACT: Self = Self {
        remainder: MAX_CHATTER_REMAINDER,
        pull_change: MAX_PULL_CHANGE,
    };

    /// The duration is within 1e-4 rad, as in the board's plan. The pull lasts, so that the part
    /// comes to rest and is thrown off at the same phase.
    pub const COARSE: Self = Self {
        remainder: 1e-4,
        pull_change: 0.1,
    };
}
