//! The first impact of a flight, by the kind of the flight.
//!
//! With `v = psi + cos t` the ball's height over the middle of the track's stroke is the parabola
//! `y(d) = sin t + v d - k d^2/2`; the gap to the track is `u(d) = y(d) - sin(t + d)`. A flight is
//!
//! - [`tall`]: it leaves height 1 faster than the track ever moves, so it meets the track once, in one
//!   monotone stretch;
//! - [`short`]: over within a fraction of a turn; solved for `u/d`, which keeps every digit down to the
//!   smallest hops;
//! - [`low`]: anything else that closed forms can certify;
//! - left to [`search`] where a decision comes close to rounding.
//!
//! The first three are written over [`Lane`]: one orbit or several side by side, the same bits.

pub(crate) mod low;
pub(crate) mod search;
pub(crate) mod short;
pub(crate) mod tall;

use core::f64::consts::{FRAC_PI_2, PI};

use crate::arithmetic::lane::{Arc, Lane, Node, sine_cosine};

/// The set-up constants of one track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Track<L> {
    /// k.
    pub k: L,
    /// `1/k`.
    pub per_k: L,
    /// `arcsin k`, where the track's acceleration passes the ball's going up; pi/2 where k >= 1.
    pub edge: L,
    /// Cosine of `edge`.
    pub edge_cosine: L,
}

impl Track<f64> {
    /// The track of `k`.
    pub fn new(k: f64) -> Self {
        Self {
            k,
            per_k: 1.0 / k,
            edge: if k < 1.0 { libm::asin(k) } else { FRAC_PI_2 },
            edge_cosine: Self::edge_cosine(k),
        }
    }
}

impl<L: Lane> Track<L> {
    /// Cosine of the edge of `k`.
    #[inline(always)]
    pub fn edge_cosine(k: L) -> L {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        ((one - k) * (one + k)).max(zero).sqrt()
    }

    /// `k/2`.
    #[inline(always)]
    fn half(&self) -> L {
        self.k * L::splat(0.5)
    }

    /// `sin(edge)`: k, at most 1.
    #[inline(always)]
    fn edge_sine(&self) -> L {
        self.k.min(L::splat(1.0))
    }

    /// Phase where the track stops pushing, `pi - edge`: between it and the next edge `u` is concave,
    /// from `edge` to it `u` is convex (a hump of the track).
    #[inline(always)]
    fn hump_end(&self) -> L {
        L::splat(PI) - self.edge
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
    fn rise(&self) -> L {
        self.velocity + self.cosine
    }

    /// Height of the ball over the middle of the stroke, `d` after launch.
    #[inline(always)]
    fn height(&self, track: &Track<L>, d: L) -> L {
        self.sine + d * (self.rise() - track.half() * d)
    }

    /// How fast the ball leaves height 1, squared; negative where it does not reach it.
    #[inline(always)]
    pub fn leaving(&self, track: &Track<L>) -> L {
        let v = self.rise();
        v * v - (track.k + track.k) * (L::splat(1.0) - self.sine)
    }

    /// Whether the flight is [`tall`].
    #[inline(always)]
    pub fn is_tall(&self, track: &Track<L>) -> L::Mask {
        L::splat(tall::LEAVING).below(self.leaving(track)) & L::splat(0.0).below(self.rise())
    }

    /// Whether the flight, if it is not tall, is [`short`], by the quadratic of `u/d`: either it crosses
    /// zero before a quarter of [`short::LONGEST`] and its two roots are well apart, or it bends down
    /// and is below zero at [`short::LONGEST`].
    #[inline(always)]
    pub fn is_short(&self, track: &Track<L>) -> L::Mask {
        let (psi, c) = (self.velocity, self.cosine);
        let pull = track.k - self.sine;
        let caught = (psi * L::splat(4.0 / short::LONGEST)).below(pull)
            & (c * psi).below(L::splat(0.3) * (pull * pull));
        let falling = c.below(L::splat(0.0))
            & (psi + c * L::splat(short::LONGEST * short::LONGEST / 6.0))
                .below(pull * L::splat(short::LONGEST / 2.0));
        caught | falling
    }
}

impl<L: Lane> Launch<L> {
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

/// The end of a flight.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Landing<L> {
    /// Duration of the flight.
    pub flight: L,
    /// Phase of the impact, in 0..2 pi.
    pub phase: L,
    /// Speed of arrival relative to the track, at least 0.
    pub arrival: L,
}

/// The gap `u0 + u1 x + b2 x^2 + ...` around a node of the table.
#[derive(Clone, Copy)]
struct Local<L> {
    node: Node<L>,
    /// `u` at the node.
    value: L,
    /// `u'` at the node.
    slope: L,
}

impl<L: Lane> Local<L> {
    /// Around the node nearest to `d` after the launch.
    #[inline(always)]
    fn near(track: &Track<L>, launch: &Launch<L>, d: L) -> Self {
        let node = Node::near(launch.phase, d);
        let v = launch.rise();
        Self {
            node,
            value: node.distance * (v - track.half() * node.distance) + (launch.sine - node.sine),
            slope: (v - track.k * node.distance) - node.cosine,
        }
    }

    /// `u''/2` at the node.
    #[inline(always)]
    fn second(&self, track: &Track<L>) -> L {
        (self.node.sine - track.k) * L::splat(0.5)
    }

    /// `u'''/6` at the node.
    #[inline(always)]
    fn third(&self) -> L {
        self.node.cosine * L::splat(1.0 / 6.0)
    }
}

/// Householder's third-order step to the root of `f + g x + b2 x^2 + b3 x^3`; one division.
#[inline(always)]
fn householder<L: Lane>(f: L, g: L, b2: L, b3: L) -> L {
    let gg = g * g;
    let top = gg - b2 * f;
    let bottom = g * (gg - (b2 + b2) * f) + b3 * (f * f);
    -(f * top / bottom)
}

/// The last step: from `d`, close to the root, to the root, by the reverted Taylor series; one division.
///
/// The mask says where that holds: the step is so short that the series, cut after the fifth power, is
/// exact to rounding.
#[inline(always)]
pub(crate) fn finish<L: Lane>(track: &Track<L>, launch: &Launch<L>, d: L) -> (Landing<L>, L::Mask) {
    let local = Local::near(track, launch, d);
    let node = &local.node;
    let x = d - node.distance;
    let arc = Arc::of(x);
    let turning = node.sine * arc.sine + node.cosine * arc.versine;
    let f = local.value
        + (x * (local.slope - track.half() * x)
            + (node.sine * arc.versine + node.cosine * arc.sagitta));
    let g = local.slope + (turning - track.k * x);
    let sine = node.sine + (node.cosine * arc.sine - node.sine * arc.versine);
    let cosine = node.cosine - turning;
    let pull = sine - track.k;
    let (b2, b3, b4) = (
        pull * L::splat(0.5),
        cosine * L::splat(1.0 / 6.0),
        sine * L::splat(-1.0 / 24.0),
    );
    let gg = g * g;
    let certain = g.below(L::splat(0.0))
        & (f * b2).abs().below(gg * L::splat(1e-3))
        & (f * f * b3).abs().below((gg * g).abs() * L::splat(1e-6));

    let per_g = L::splat(1.0) / g;
    let n = -(f * per_g);
    let (a2, a3, a4) = (b2 * per_g, b3 * per_g, b4 * per_g);
    let a22 = a2 * a2;
    let c3 = (a22 + a22) - a3;
    let c4 = L::splat(-5.0) * a2 * (a22 - a3) - a4;
    let c5 = a22 * (L::splat(14.0) * a22 - L::splat(21.0) * a3)
        + (L::splat(6.0) * (a2 * a4) + L::splat(3.0) * (a3 * a3));
    let step = n * (L::splat(1.0) + n * (n * (c3 + n * (c4 + n * c5)) - a2));

    let offset = x + step;
    let arrival = g + step
        * (pull
            + step
                * (cosine * L::splat(0.5)
                    - step
                        * (sine * L::splat(1.0 / 6.0) + step * (cosine * L::splat(1.0 / 24.0)))));
    let landing = Landing {
        flight: node.distance + offset,
        phase: node.phase(offset),
        arrival: -arrival,
    };
    (landing, certain)
}

/// The first impact after `launch`, and whether it grazes. The launch is not at rest.
#[inline(always)]
pub(crate) fn first_impact(track: &Track<f64>, launch: &Launch<f64>) -> (Landing<f64>, bool) {
    if launch.is_tall(track) {
        (tall::landing(track, launch), false)
    } else {
        let (landing, certain) = if launch.is_short(track) {
            short::landing(track, launch, short::guess(track, launch))
        } else {
            let stretch = low::stretch(track, launch);
            let close = low::approach(track, launch, &stretch);
            low::landing(track, launch, &stretch, close)
        };
        if certain {
            (landing, false)
        } else {
            search::landing(track, launch, search::Envelope::Skip)
        }
    }
}
