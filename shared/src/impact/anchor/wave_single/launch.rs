//! Launch from a track of several tones in f32, and the gap of its short flight.
//!
//! The gap is `u = y - S` in b, of the part's height y over the track's displacement S. The track's
//! downward acceleration is `A = -S''` in `b w^2`, gravity is k in the same unit, and psi is the
//! velocity relative to the track in `b w`. A short flight takes the Taylor series of `q = u/d`,
//! with the time d since launch in rad. The division removes the root at launch (deflation).

use super::harmonics::Parts;
use super::track::Track;
use crate::impact::anchor::flight::{abs, larger, smaller};

/// Largest pull in `b w^2` that is computed in fixed point, with an error of at most 3e-9. A larger
/// one is a sum in f32, with an error of some 1e-7.
const MAX_FIXED_POINT_PULL: f32 = 0.02;

/// Typical error in `b w^2` of a pull in fixed point: some steps of 2^-35 for each tone.
const TYPICAL_PULL_ERROR: f32 = 5e-10;

/// Pull over its typical error above which rounding does not decide its sign.
const MAX_PULL_OVER_ERROR: f32 = 20.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct Launch {
    /// Phase in steps of 2^-32 turns.
    pub phase: u32,
    /// Velocity psi relative to the track.
    pub velocity: f32,
    /// S at launch.
    pub height: f32,
    /// Velocity `psi + S'` of the part.
    pub rise: f32,
    /// Pull `k - A` towards the track, below 0 where the track throws.
    pub pull: f32,
    /// A' at launch.
    pub jerk: f32,
    parts: Parts,
}

/// `q = u/d` of a short flight, its derivative, and half its second derivative.
#[derive(Clone, Copy, Debug)]
pub(super) struct DeflatedGap {
    pub value: f32,
    pub slope: f32,
    pub half_curvature: f32,
}

impl Launch {
    /// A launch from the tones at its phase, and whether the track throws there.
    #[inline(always)]
    pub fn new(track: &Track, phase: u32, velocity: f32, parts: &Parts, throws: bool) -> Self {
        let mut pull = track.gravity.k - parts.sines(4.0, 9.0);
        if abs(pull) < MAX_FIXED_POINT_PULL {
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
            jerk: parts.cosines(8.0, 27.0),
            parts: *parts,
        }
    }

    #[inline(always)]
    pub fn has_fixed_point_pull(&self) -> bool {
        abs(self.pull) < MAX_FIXED_POINT_PULL
    }

    /// Whether rounding decides between a throw and a short hop: the pull is near 0 and falls, and
    /// its error decides whether the quadratic of q has a root.
    #[inline(always)]
    pub fn is_undecided(&self) -> bool {
        if abs(self.pull) > MAX_PULL_OVER_ERROR * TYPICAL_PULL_ERROR {
            return false;
        }
        let touches = |pull: f32| {
            let half = 0.5 * pull;
            half > 0.0 && half * half > self.jerk * self.velocity * (2.0 / 3.0)
        };
        self.jerk > 0.0
            && touches(self.pull - TYPICAL_PULL_ERROR) != touches(self.pull + TYPICAL_PULL_ERROR)
    }

    /// q after `x` rad, at most [`super::search::max_short_flight`]: `q = psi - x (k - A)/2 + x^2
    /// A'/6 + x^3 A''/24 + ...`. The sums keep every digit. The derivative of order m of A weighs
    /// the tone of order n by n^(m + 2). In q, q' and half of q'' it has the coefficients 1/(m +
    /// 2)!, (m + 1)/(m + 2)! and m (m + 1)/(2 (m + 2)!). Half of q'' only improves the last step,
    /// so that it needs fewer terms.
    #[inline(always)]
    pub fn deflated_gap(&self, x: f32) -> DeflatedGap {
        let (parts, a1) = (&self.parts, self.jerk);
        let (a2, a3) = (-parts.sines(16.0, 81.0), -parts.cosines(32.0, 243.0));
        let (a4, a5) = (parts.sines(64.0, 729.0), parts.cosines(128.0, 2187.0));
        let half = 0.5 * self.pull;
        let of_value = a1 * (1.0 / 6.0)
            + x * (a2 * (1.0 / 24.0)
                + x * (a3 * (1.0 / 120.0) + x * (a4 * (1.0 / 720.0) + x * a5 * (1.0 / 5040.0))));
        let of_slope = a1 * (1.0 / 3.0)
            + x * (a2 * (1.0 / 8.0)
                + x * (a3 * (1.0 / 30.0) + x * (a4 * (1.0 / 144.0) + x * a5 * (1.0 / 840.0))));
        let half_curvature = a1 * (1.0 / 6.0) + x * (a2 * (1.0 / 8.0) + x * a3 * (1.0 / 20.0));
        DeflatedGap {
            value: self.velocity - x * (half - x * of_value),
            slope: x * of_slope - half,
            half_curvature,
        }
    }
}
