//! A launch from a track of several tones, and its flight while it is short.

use super::harmonics::Parts;
use super::track::Track;
use crate::impact::anchor::flight::{abs, larger, smaller};

/// Pull in `b w^2` below which its error is 3e-9; above it is a sum's rounding in f32.
const MAX_NEAR_LEVEL_PULL: f32 = 0.02;

/// Rounding of a pull near level in `b w^2`: typical, some steps of 2^-35 per tone; the bound
/// is 3e-9.
const LEVEL_PULL_ROUNDING: f32 = 5e-10;

/// A launch in f32.
#[derive(Clone, Copy, Debug)]
pub(super) struct Launch {
    /// Phase, steps.
    pub phase: u32,
    /// Velocity relative to the track (psi).
    pub velocity: f32,
    /// S at launch.
    pub height: f32,
    /// The ball's velocity, `psi + S'`.
    pub rise: f32,
    /// `k - A`, with the sign given by the humps.
    pub pull: f32,
    /// A' there.
    pub surge: f32,
    parts: Parts,
}

/// `w = u / d` of a short flight, its derivative, and half its second one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Short {
    pub value: f32,
    pub slope: f32,
    pub half_bend: f32,
}

impl Launch {
    /// A launch that is not tall, from the tones at its phase.
    #[inline(always)]
    pub fn new(track: &Track, phase: u32, velocity: f32, parts: &Parts, throws: bool) -> Self {
        let mut pull = track.k - parts.sines(4.0, 9.0);
        if abs(pull) < MAX_NEAR_LEVEL_PULL {
            pull = -track.excess(phase);
        }
        Self {
            phase,
            velocity,
            height: parts.sines(1.0, 1.0),
            rise: velocity + parts.cosines(2.0, 3.0),
            // At lift-off itself rounding must not change the sign of the pull, nor make it 0.
            pull: if throws {
                smaller(pull, -1e-20)
            } else {
                larger(pull, 1e-20)
            },
            surge: parts.cosines(8.0, 27.0),
            parts: *parts,
        }
    }

    /// Whether the pull has more digits than a sum in f32.
    #[inline(always)]
    pub fn is_near_level(&self) -> bool {
        abs(self.pull) < MAX_NEAR_LEVEL_PULL
    }

    /// Whether rounding alone decides between a throw and a hop.
    ///
    /// The pull is level and falls, and its rounding decides whether the quadratic near launch has
    /// a root.
    #[inline(always)]
    pub fn is_level(&self) -> bool {
        if abs(self.pull) > 20.0 * LEVEL_PULL_ROUNDING {
            return false;
        }
        let touches = |pull: f32| {
            let half = 0.5 * pull;
            half > 0.0 && half * half > self.surge * self.velocity * (2.0 / 3.0)
        };
        self.surge > 0.0
            && touches(self.pull - LEVEL_PULL_ROUNDING) != touches(self.pull + LEVEL_PULL_ROUNDING)
    }

    /// The flight after `x`, at most [`super::search::max_short_flight`], in forms that keep every
    /// digit: `w = psi - x (k - A)/2 + x^2 A'/6 + x^3 A''/24 + ...`.
    #[inline(always)]
    pub fn short(&self, x: f32) -> Short {
        let (parts, a1) = (&self.parts, self.surge);
        let (a2, a3) = (-parts.sines(16.0, 81.0), -parts.cosines(32.0, 243.0));
        let (a4, a5) = (parts.sines(64.0, 729.0), parts.cosines(128.0, 2187.0));
        let half = 0.5 * self.pull;
        let inner = a1 * (1.0 / 6.0)
            + x * (a2 * (1.0 / 24.0)
                + x * (a3 * (1.0 / 120.0) + x * (a4 * (1.0 / 720.0) + x * a5 * (1.0 / 5040.0))));
        let outer = a1 * (1.0 / 3.0)
            + x * (a2 * (1.0 / 8.0)
                + x * (a3 * (1.0 / 30.0) + x * (a4 * (1.0 / 144.0) + x * a5 * (1.0 / 840.0))));
        let half_bend = a1 * (1.0 / 6.0) + x * (a2 * (1.0 / 8.0) + x * a3 * (1.0 / 20.0));
        Short {
            value: self.velocity - x * (half - x * inner),
            slope: x * outer - half,
            half_bend,
        }
    }
}
