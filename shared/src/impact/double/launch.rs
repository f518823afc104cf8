//! A launch on a track: what every kind of flight needs of it.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::arithmetic::lane::{Lane, sine_cosine};

/// The set-up constants of one track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Track<L> {
    /// k.
    pub k: L,
    /// `1/k`.
    pub per_k: L,
    /// `arcsin k`, where the track's acceleration passes the ball's going up; pi/2 where k >= 1.
    pub lift_off: L,
    /// Cosine of `lift_off`.
    pub lift_off_cosine: L,
}

impl Track<f64> {
    /// The track of `k`.
    pub fn new(k: f64) -> Self {
        Self {
            k,
            per_k: 1.0 / k,
            lift_off: if k < 1.0 { libm::asin(k) } else { FRAC_PI_2 },
            lift_off_cosine: Self::lift_off_cosine(k),
        }
    }
}

impl<L: Lane> Track<L> {
    /// Cosine of the phase of lift-off.
    #[inline(always)]
    pub fn lift_off_cosine(k: L) -> L {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        ((one - k) * (one + k)).max(zero).sqrt()
    }

    /// `k/2`.
    #[inline(always)]
    pub(super) fn half(&self) -> L {
        self.k * L::splat(0.5)
    }

    /// Sine of the phase of lift-off: k, at most 1.
    #[inline(always)]
    pub(super) fn lift_off_sine(&self) -> L {
        self.k.min(L::splat(1.0))
    }

    /// Phase where the track stops pushing, `pi - arcsin k`: the end of a hump. `u` is convex over the hump, from
    /// lift-off to here, and concave from here to the next lift-off.
    #[inline(always)]
    pub(super) fn hump_end(&self) -> L {
        L::splat(PI) - self.lift_off
    }
}

/// A launch: the state just after an impact, with what every kind of flight needs of it.
#[derive(Clone, Copy)]
pub(crate) struct Launch<L> {
    /// Phase t in rad, 0..2 pi.
    pub phase: L,
    /// Velocity psi relative to the track.
    pub velocity: L,
    /// `sin t`.
    pub sine: L,
    /// `cos t`.
    pub cosine: L,
}

impl<L: Lane> Launch<L> {
    /// The launch of a state.
    #[inline(always)]
    pub fn new(phase: L, velocity: L) -> Self {
        Self::with(phase, velocity, sine_cosine(phase))
    }

    /// The launch of a state of which the node nearest to its phase is known: the sum that names it, its sine and cosine.
    #[cfg(any(test, feature = "analysis"))]
    #[inline(always)]
    pub fn at(phase: L, velocity: L, rounded: L, node: (L, L)) -> Self {
        let near = crate::arithmetic::lane::between(phase, rounded, node);
        Self::with(phase, velocity, near)
    }

    /// The launch of a state that an impact near `node` leads to, in those lanes that `which` holds for.
    #[cfg(any(test, feature = "analysis"))]
    #[inline(always)]
    pub fn near(
        phase: L,
        velocity: L,
        node: &crate::arithmetic::lane::Node<L>,
        which: L::Mask,
    ) -> Self {
        Self::with(phase, velocity, node.sine_cosine(phase, which))
    }

    #[inline(always)]
    pub(super) fn with(phase: L, velocity: L, (sine, cosine): (L, L)) -> Self {
        Self {
            phase,
            velocity,
            sine,
            cosine,
        }
    }

    /// The ball's velocity at launch, `psi + cos t`.
    #[inline(always)]
    pub(super) fn rise(&self) -> L {
        self.velocity + self.cosine
    }

    /// Height of the ball over the middle of the stroke, `d` after launch.
    #[inline(always)]
    pub(super) fn height(&self, track: &Track<L>, d: L) -> L {
        self.sine + d * (self.rise() - track.half() * d)
    }

    /// How fast the ball leaves height 1, squared; negative where it does not reach it.
    #[inline(always)]
    pub fn leaving(&self, track: &Track<L>) -> L {
        let v = self.rise();
        v * v - (track.k + track.k) * (L::splat(1.0) - self.sine)
    }

    /// Square of the ball's speed at height 0; negative where it does not reach it.
    #[inline(always)]
    pub(super) fn level(&self, track: &Track<L>) -> L {
        let v = self.rise();
        v * v + (track.k + track.k) * self.sine
    }

    /// How long until the track next pushes harder than k: the begin of the next hump.
    #[inline(always)]
    pub(super) fn wait(&self, track: &Track<L>) -> L {
        let wait = track.lift_off - self.phase;
        wait + L::splat(TAU).only(!L::splat(0.0).below(wait))
    }

    /// Bound of the rounding of a height: 30 times that at the apex.
    #[inline(always)]
    pub(super) fn margin(&self, track: &Track<L>) -> L {
        let v = self.rise();
        L::splat(6e-14) * (L::splat(1.0) + v * v * track.per_k)
    }

    /// Whether the part rests: it has no velocity and the track does not push it off.
    ///
    /// Within rounding of lift-off (`sin t = k` going up) it is thrown off.
    #[inline(always)]
    pub fn rests(&self, track: &Track<L>) -> L::Mask {
        let zero = L::splat(0.0);
        let pull = track.k - self.sine;
        let held = L::select(
            zero.below(self.cosine),
            pull - L::splat(4.0 * f64::EPSILON),
            pull,
        );
        !zero.below(self.velocity) & !held.below(zero)
    }

    /// Whether the part is slow enough that it may [chatter out](Self::chatters_out), which is dearer to ask.
    ///
    /// With `A = k - sin t`, at most `1 + k`: `psi^3 (2.1 c^2 + 0.9 |s| A)` is then at most [`REMAINDER`] `A^5`. Either `|s|` is at
    /// least 1/2, or `c^2` is at least 3/4: psi is at most 7.7e-6 (1 + k)^(5/3).
    #[cfg(any(test, feature = "analysis"))]
    #[inline(always)]
    pub fn may_chatter_out(&self, track: &Track<L>) -> L::Mask {
        let reach = L::splat(1.0) + track.k;
        !(L::splat(1e-5) * (reach * reach)).below(self.velocity)
    }

    /// Whether the part rests, or hops so little that the closed form of its chatter to rest is exact
    /// to f64.
    ///
    /// With `A = k - sin t` and `z = psi / (A (1 - R))`: the third order of the chatter's duration, at
    /// most `z^3 (2.1 (c/A)^2 + 0.9 |s|/A)`, is below [`REMAINDER`], and A changes by less than
    /// [`CHANGE`] of itself meanwhile. Written without divisions.
    #[inline(always)]
    pub fn chatters_out(&self, track: &Track<L>, restitution: L) -> L::Mask {
        let zero = L::splat(0.0);
        let (s, c, hop) = (self.sine.abs(), self.cosine.abs(), self.velocity);
        let pull = track.k - self.sine;
        let lost = L::splat(1.0) - restitution;
        let reach = pull * lost;
        let squared = pull * pull;
        let third = (hop * hop * hop) * (L::splat(2.1) * (c * c) + L::splat(0.9) * (s * pull));
        let exact = !(L::splat(REMAINDER) * (reach * reach * reach) * squared).below(third);
        let turning = !(L::splat(CHANGE) * (reach * pull)).below((hop + hop) * c);
        let bending = !(L::splat(CHANGE) * (reach * reach) * pull).below((hop + hop) * hop * s);
        let closing = zero.below(pull) & zero.below(lost) & exact & turning & bending;
        closing | self.rests(track)
    }
}

/// Largest third order of a chatter's duration that its closed form leaves out, in rad: half an ulp of
/// a phase.
pub(crate) const REMAINDER: f64 = 2e-16;
/// Largest relative change of the pull during a chatter that is closed. It keeps the rest inside
/// `sin < k` and the fourth order below the third.
pub(crate) const CHANGE: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    /// Launches of every speed at which some chatter out, on tracks that pull as hard as they can there.
    #[test]
    fn none_that_may_not_chatter_out_does() {
        let (mut closed, mut largest) = (0, 0.0_f64);
        for n in 0..1_000_000 {
            let spread = |factor: f64| (f64::from(n) * factor).rem_euclid(1.0);
            let k = libm::pow(10.0, 5.0 * spread(0.618_034) - 2.0);
            let restitution = 0.1 * spread(0.236_068);
            let velocity = 2e-5 * (1.0 + k) * (1.0 + k) * spread(0.732_051);
            let launch = Launch::new(TAU * spread(0.414_214), velocity);
            let track = Track::new(k);
            if f64::any(launch.chatters_out(&track, restitution)) {
                assert!(f64::any(launch.may_chatter_out(&track)), "{k} {velocity}");
                closed += 1;
                largest = largest.max(velocity / ((1.0 + k) * (1.0 + k)));
            }
        }
        assert!(closed > 10_000 && largest > 3e-6, "{closed} {largest}");
    }
}
