//! The first impact of a flight, by the kind of the flight.
//!
//! With `v = psi + cos t` the ball's height over the middle of the track's stroke is the parabola
//! `y(d) = sin t + v d - k d^2/2`; the gap to the track is `u(d) = y(d) - sin(t + d)`. A flight is
//!
//! - [`tall`]: it leaves height 1 faster than the track ever moves, so it meets the track once, in one
//!   monotone stretch;
//! - [`short`]: over within a fraction of a turn; solved for `u/d`, which keeps every digit down to the
//!   smallest hops;
//! - [home](low::home): over before the track next pushes as hard as k, or faster at height 1 than the
//!   track ever moves; so it meets the track once;
//! - [`low`]: anything else that closed forms can certify;
//! - left to [`search`] where a decision comes close to rounding.
//!
//! All but the last are written over [`Lane`]: one orbit or several side by side, the same bits. A flight
//! costs nearly its whole chain of dependent operations, as a CPU cannot hold enough of them waiting to
//! begin the next flight early. So the kinds are told apart early, each has a short chain of its own, and
//! sums are in the order in which their terms are ready. Those few that need another step take it in
//! [`hard`].

pub(crate) mod low;
pub(crate) mod search;
pub(crate) mod short;
pub(crate) mod tall;

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::arithmetic::lane::{Arc, Lane, Node, ROUNDER, sine_cosine};
use crate::arithmetic::node;

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
        Self::with(phase, velocity, sine_cosine(phase))
    }

    /// The launch of a state that an impact near `node` leads to.
    #[inline(always)]
    pub fn near(phase: L, velocity: L, node: &Node<L>) -> Self {
        Self::with(phase, velocity, node.sine_cosine(phase))
    }

    #[inline(always)]
    fn with(phase: L, velocity: L, (sine, cosine): (L, L)) -> Self {
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

    /// Square of the ball's speed at height 0; negative where it does not reach it.
    #[inline(always)]
    fn level(&self, track: &Track<L>) -> L {
        let v = self.rise();
        v * v + (track.k + track.k) * self.sine
    }

    /// Whether the flight is [`tall`].
    #[inline(always)]
    pub fn is_tall(&self, track: &Track<L>) -> L::Mask {
        let least = L::splat(tall::LEAVING) + (track.k + track.k);
        least.below(self.level(track)) & L::splat(0.0).below(self.rise())
    }

    /// How long until the track next pushes harder than k: the edge that comes.
    #[inline(always)]
    fn wait(&self, track: &Track<L>) -> L {
        let wait = track.edge - self.phase;
        wait + L::splat(TAU).only(!L::splat(0.0).below(wait))
    }

    /// Bound of the rounding of a height: 30 times that at the apex.
    #[inline(always)]
    fn margin(&self, track: &Track<L>) -> L {
        let v = self.rise();
        L::splat(6e-14) * (L::splat(1.0) + v * v * track.per_k)
    }

    /// Whether the ball leaves height 1 faster than the track ever moves: it meets the track once.
    #[inline(always)]
    fn is_certified(&self, track: &Track<L>) -> L::Mask {
        L::splat(1.0 + SPARE).below(self.leaving(track)) & L::splat(0.0).below(self.rise())
    }

    /// Whether the flight, if it is neither tall nor short, meets the track once: it
    /// [is certified](Self::is_certified), or over before the edge that comes, as the ball is below the
    /// track there. Up to there the gap is concave, or convex (and grows) and then concave; so it has one
    /// root.
    #[inline(always)]
    pub fn is_home(&self, track: &Track<L>) -> L::Mask {
        let height = self.height(track, self.wait(track));
        self.is_certified(track) | (height + L::splat(SPARE)).below(track.edge_sine())
    }

    /// Whether the flight, if it is not tall, is [`short`].
    #[inline(always)]
    pub fn is_short(&self, track: &Track<L>) -> L::Mask {
        self.is_over_within(track, short::LONGEST)
    }

    /// Whether the flight, if it is not tall, is over within about `longest`, by the quadratic of `u/d`:
    /// either it crosses zero before half of that and its two roots are well apart, or it bends down and
    /// is below zero then.
    #[inline(always)]
    fn is_over_within(&self, track: &Track<L>, longest: f64) -> L::Mask {
        let (psi, c) = (self.velocity, self.cosine);
        let pull = track.k - self.sine;
        let caught = (psi * L::splat(2.75 / longest)).below(pull)
            & (c * psi).below(L::splat(0.3) * (pull * pull));
        let falling = c.below(L::splat(0.0))
            & (psi + c * L::splat(longest * longest / 6.0)).below(pull * L::splat(longest / 2.0));
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

/// More than the rounding of a height or of the square of a speed, where the flight is not tall.
const SPARE: f64 = 1e-9;

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

impl<L: Lane> Landing<L> {
    /// `self` where the mask holds, else `other`.
    #[inline(always)]
    fn or(self, mask: L::Mask, other: Self) -> Self {
        Self {
            flight: L::select(mask, self.flight, other.flight),
            phase: L::select(mask, self.phase, other.phase),
            arrival: L::select(mask, self.arrival, other.arrival),
        }
    }
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

    /// `u''` at the node.
    #[inline(always)]
    fn curvature(&self, track: &Track<L>) -> L {
        self.node.sine - track.k
    }
}

/// Householder's fourth-order step to the root of a function, from its value `f` and its derivatives
/// `g`, `g2`, `g3` and `g4`: how far the root lies behind; one division. The sign of the whole function
/// does not matter.
#[inline(always)]
fn householder<L: Lane>(f: L, g: L, g2: L, g3: L, g4: L) -> L {
    let (gg, ff, bent) = ((g * g).lone(), (f * f).lone(), (g2 * f).lone());
    let turned = ((g3 * L::splat(1.0 / 6.0)) * ff).lone();
    let top = g * (gg - bent) + turned;
    let rest = (bent * bent) * L::splat(0.25) - ((g4 * L::splat(1.0 / 24.0)) * f) * ff;
    let bottom = gg * (gg - L::splat(1.5) * bent) + (rest + (turned + turned) * g);
    (f * top / bottom).lone()
}

/// About where a flight ends: so far before a node of the table.
#[derive(Clone, Copy)]
pub(crate) struct Close<L> {
    /// The [`ROUNDER`] sum that names the node.
    pub rounded: L,
    /// How far before it, in rad.
    pub back: L,
}

impl<L: Lane> Close<L> {
    /// `d` after the launch.
    #[inline(always)]
    fn after(launch: &Launch<L>, d: L) -> Self {
        let node = Node::near(launch.phase, d);
        Self {
            rounded: node.rounded,
            back: node.distance - d,
        }
    }
}

/// The gap near an impact, to rounding: the ball from the node that the approach began at, the track from
/// the node next to the impact.
///
/// What comes late is used late: every sum is in the order in which its terms are ready.
#[derive(Clone, Copy)]
pub(crate) struct Near<L> {
    /// The node next to the impact, and how far the other lies ahead of the launch.
    pub node: Node<L>,
    /// Time from that other node back.
    pub back: L,
    /// Time from the node next to it.
    pub x: L,
    /// `u`.
    pub value: L,
    /// `u'`.
    pub slope: L,
    /// The track's sine.
    pub sine: L,
    /// Its cosine.
    pub cosine: L,
}

impl<L: Lane> Near<L> {
    /// At `close`.
    #[inline(always)]
    pub fn at(track: &Track<L>, launch: &Launch<L>, close: &Close<L>) -> Self {
        let (half, back) = (track.half(), close.back);
        let rounded = close.rounded - back * L::splat(node::COUNT as f64 / TAU);
        let (node_sine, node_cosine) = L::node(rounded);
        let x = (close.rounded - rounded) * L::splat(node::SPACING) - back;
        let count = close.rounded - L::splat(ROUNDER);
        let distance = (count * L::splat(node::SPACING_HIGH) - launch.phase)
            + count * L::splat(node::SPACING_LOW);
        let v = launch.rise();
        let height = launch.sine + distance * (v - half * distance);
        let speed = v - track.k * distance;
        let arc = Arc::of(x);
        let rise = (node_cosine * arc.sine - node_sine * arc.versine).lone();
        let fall = (node_sine * arc.sine + node_cosine * arc.versine).lone();
        let cosine = node_cosine - fall;
        Self {
            node: Node {
                sine: node_sine,
                cosine: node_cosine,
                distance,
                rounded,
            },
            back,
            x,
            value: ((height - back * (speed + half * back)) - node_sine) - rise,
            slope: (speed + track.k * back) - cosine,
            sine: node_sine + rise,
            cosine,
        }
    }

    /// The landing `back` before; its phase may be a hair below zero.
    #[inline(always)]
    fn landing(&self, back: L, arrival: L) -> Landing<L> {
        let (high, low) = L::within_turn(self.node.rounded);
        Landing {
            flight: (self.node.distance - (self.back + back)).lone(),
            phase: (high + ((low + self.x) - back)).lone(),
            arrival: arrival.lone(),
        }
    }

    /// The last step, to the root, of fourth order.
    #[inline(always)]
    pub fn finish(&self, track: &Track<L>) -> Landing<L> {
        let (f, g, sine, g3) = (self.value, self.slope, self.sine, self.cosine);
        let g2 = sine - track.k;
        let back = householder(f, g, g2, g3, -sine);
        let half_third = g3 * L::splat(0.5);
        let bend = half_third
            + back * (sine * L::splat(1.0 / 6.0) - back * (half_third * L::splat(1.0 / 12.0)));
        let mut landing = self.landing(back, back * (g2 - back * bend) - g);
        landing.phase = in_turn(landing.phase);
        landing
    }
}

/// A phase in 0..2 pi from one that may be a hair below zero.
#[inline(always)]
fn in_turn<L: Lane>(phase: L) -> L {
    let below = phase.below(L::splat(0.0));
    if L::any(below) {
        // A hair below zero rounds up to the whole turn.
        (phase + L::splat(TAU).only(below)).min(L::splat(TAU.next_down()))
    } else {
        phase
    }
}

/// The first impact after `launch`, and whether it grazes; `None` where the part rests.
#[inline(always)]
pub(crate) fn first_impact(
    track: &Track<f64>,
    launch: &Launch<f64>,
) -> Option<(Landing<f64>, bool)> {
    if f64::any(launch.is_tall(track)) {
        return Some((tall::landing(track, launch), false));
    }
    let Launch {
        phase,
        velocity,
        sine,
        cosine,
    } = *launch;
    // By value: in memory the launch would delay the tall flights, too.
    not_tall(track, phase, velocity, sine, cosine)
}

/// [`first_impact`] of a flight that is not tall.
#[inline(never)]
fn not_tall(
    track: &Track<f64>,
    phase: f64,
    velocity: f64,
    sine: f64,
    cosine: f64,
) -> Option<(Landing<f64>, bool)> {
    let launch = Launch {
        phase,
        velocity,
        sine,
        cosine,
    };
    if velocity <= 0.0 && f64::any(launch.rests(track)) {
        return None;
    }
    let (landing, certain) = if f64::any(launch.is_short(track)) {
        short::landing(track, &launch, short::guess(track, &launch))
    } else {
        let stretch = if f64::any(launch.is_home(track)) {
            low::home(track, &launch)
        } else {
            low::stretch(track, &launch)
        };
        let close = low::approach(track, &launch, &stretch);
        low::landing(track, &launch, &stretch, &close)
    };
    Some(if f64::any(certain) {
        (landing, false)
    } else {
        hard(track, &launch)
    })
}

/// The first impact of a flight of which its kind's quick form is not certain, and whether it grazes.
#[cold]
pub(crate) fn hard(track: &Track<f64>, launch: &Launch<f64>) -> (Landing<f64>, bool) {
    let careful = if f64::any(launch.is_short(track)) {
        short::careful(track, launch)
    } else {
        low::careful(track, launch)
    };
    careful.map_or_else(
        || search::landing(track, launch, search::Envelope::Skip),
        |landing| (landing, false),
    )
}
