//! A launch and its track, with the quantities that every kind of flight uses.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::arithmetic::vector::{Vector, sine_cosine};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Track<V> {
    pub k: V,
    pub per_k: V,
    /// Phase of lift-off, `arcsin k`, in rad; pi/2 if k >= 1. A hump begins here.
    pub lift_off: V,
    pub lift_off_cosine: V,
}

impl Track<f64> {
    pub fn new(k: f64) -> Self {
        Self {
            k,
            per_k: 1.0 / k,
            lift_off: if k < 1.0 { libm::asin(k) } else { FRAC_PI_2 },
            lift_off_cosine: Self::lift_off_cosine(k),
        }
    }
}

impl<V: Vector> Track<V> {
    #[inline(always)]
    pub fn lift_off_cosine(k: V) -> V {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        ((one - k) * (one + k)).max(zero).sqrt()
    }

    #[inline(always)]
    pub(super) fn half(&self) -> V {
        self.k * V::splat(0.5)
    }

    /// Sine of the phase of lift-off: k, at most 1.
    #[inline(always)]
    pub(super) fn lift_off_sine(&self) -> V {
        self.k.min(V::splat(1.0))
    }

    /// Whether a velocity is low enough for [`Launch::chatters_out`], which costs more. The pull
    /// `A = k - sin t` is at most `1 + k`. Then `psi^3 (2.1 c^2 + 0.9 |s| A)` is at most
    /// [`MAX_CHATTER_REMAINDER`] `A^5`. Either `|s|` is at least 1/2, or `c^2` is at least 3/4: psi
    /// is at most 7.7e-6 (1 + k)^(5/3).
    #[inline(always)]
    pub fn may_chatter_out(&self, velocity: V) -> V::Mask {
        let reach = V::splat(1.0) + self.k;
        !(V::splat(1e-5) * (reach * reach)).below(velocity)
    }

    /// Phase in rad at which a hump ends, `pi - arcsin k`: the track's push falls below k. `u` is
    /// convex over the hump, from lift-off to here, and concave from here to the next lift-off.
    #[inline(always)]
    pub(super) fn hump_end(&self) -> V {
        V::splat(PI) - self.lift_off
    }
}

/// The state just after an impact, with sine and cosine of its phase.
#[derive(Clone, Copy)]
pub(crate) struct Launch<V> {
    /// Phase t in rad, 0..2 pi.
    pub phase: V,
    /// Velocity psi relative to the track.
    pub velocity: V,
    pub sine: V,
    pub cosine: V,
}

impl<V: Vector> Launch<V> {
    #[inline(always)]
    pub fn new(phase: V, velocity: V) -> Self {
        let (sine, cosine) = sine_cosine(phase);
        Self {
            phase,
            velocity,
            sine,
            cosine,
        }
    }

    /// The ball's velocity at launch, `psi + cos t`.
    #[inline(always)]
    pub(super) fn rise(&self) -> V {
        self.velocity + self.cosine
    }

    /// Height of the ball over the middle of the stroke, `d` after launch.
    #[inline(always)]
    pub(super) fn height(&self, track: &Track<V>, d: V) -> V {
        self.sine + d * (self.rise() - track.half() * d)
    }

    /// Square of the ball's speed at height 1; negative if the ball does not reach it.
    #[inline(always)]
    pub fn speed_squared_at_crest(&self, track: &Track<V>) -> V {
        let v = self.rise();
        v * v - (track.k + track.k) * (V::splat(1.0) - self.sine)
    }

    /// Square of the ball's speed at height 0; negative if the ball does not reach it.
    #[inline(always)]
    pub(super) fn speed_squared_at_zero(&self, track: &Track<V>) -> V {
        let v = self.rise();
        v * v + (track.k + track.k) * self.sine
    }

    /// Time in rad until the track next pushes harder than k: the start of the next hump.
    #[inline(always)]
    pub(super) fn time_to_next_hump(&self, track: &Track<V>) -> V {
        let wait = track.lift_off - self.phase;
        wait + V::splat(TAU).keep_where(!V::splat(0.0).below(wait))
    }

    /// Bound of the rounding error of a height: 30 times that at the apex.
    #[inline(always)]
    pub(super) fn margin(&self, track: &Track<V>) -> V {
        let v = self.rise();
        V::splat(6e-14) * (V::splat(1.0) + v * v * track.per_k)
    }

    /// Whether the part rests: its velocity is 0 and the track does not throw it. Within rounding
    /// of lift-off (`sin t = k` going up) the part is thrown.
    #[inline(always)]
    pub fn rests(&self, track: &Track<V>) -> V::Mask {
        let zero = V::splat(0.0);
        let pull = track.k - self.sine;
        let rounded_pull = V::select(
            zero.below(self.cosine),
            pull - V::splat(4.0 * f64::EPSILON),
            pull,
        );
        !zero.below(self.velocity) & !rounded_pull.below(zero)
    }

    /// Whether the part rests, or hops so little that its chatter has a closed form exact to f64.
    /// Let `A = k - sin t` and `z = psi / (A (1 - R))`. The third order of the chatter's duration
    /// is at most `z^3 (2.1 (c/A)^2 + 0.9 |s|/A)`. It must be below [`MAX_CHATTER_REMAINDER`], and
    /// the relative change of A below [`MAX_PULL_CHANGE`]. The form has no divisions.
    #[inline(always)]
    pub fn chatters_out(&self, track: &Track<V>, restitution: V) -> V::Mask {
        let zero = V::splat(0.0);
        let (s, c, hop) = (self.sine.abs(), self.cosine.abs(), self.velocity);
        let pull = track.k - self.sine;
        let loss = V::splat(1.0) - restitution;
        let reach = pull * loss;
        let squared = pull * pull;
        let third = (hop * hop * hop) * (V::splat(2.1) * (c * c) + V::splat(0.9) * (s * pull));
        let exact =
            !(V::splat(MAX_CHATTER_REMAINDER) * (reach * reach * reach) * squared).below(third);
        let turning = !(V::splat(MAX_PULL_CHANGE) * (reach * pull)).below((hop + hop) * c);
        let curving =
            !(V::splat(MAX_PULL_CHANGE) * (reach * reach) * pull).below((hop + hop) * hop * s);
        let closing = zero.below(pull) & zero.below(loss) & exact & turning & curving;
        closing | self.rests(track)
    }
}

/// Largest third order in rad that a chatter's closed form omits: half an ulp of a phase.
pub(crate) const MAX_CHATTER_REMAINDER: f64 = 2e-16;
/// Largest relative change of the pull during a chatter in closed form. It keeps the rest inside
/// `sin < k` and the fourth order below the third.
pub(crate) const MAX_PULL_CHANGE: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    /// Launches at every speed at which some chatter out, on tracks with the hardest pull there.
    #[test]
    fn fast_velocity_test_excludes_no_chatter() {
        let (mut closed, mut largest) = (0, 0.0_f64);
        for n in 0..1_000_000 {
            let spread = |factor: f64| (f64::from(n) * factor).rem_euclid(1.0);
            let k = libm::pow(10.0, 5.0 * spread(0.618_034) - 2.0);
            let restitution = 0.1 * spread(0.236_068);
            let velocity = 2e-5 * (1.0 + k) * (1.0 + k) * spread(0.732_051);
            let launch = Launch::new(TAU * spread(0.414_214), velocity);
            let track = Track::new(k);
            if f64::any(launch.chatters_out(&track, restitution)) {
                assert!(f64::any(track.may_chatter_out(velocity)), "{k} {velocity}");
                closed += 1;
                largest = largest.max(velocity / ((1.0 + k) * (1.0 + k)));
            }
        }
        assert!(closed > 10_000 && largest > 3e-6, "{closed} {largest}");
    }
}
