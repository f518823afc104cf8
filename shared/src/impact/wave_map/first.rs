//! The first impact of a flight on a track of several tones: the first root of the gap `u = y - S`.
//!
//! Input is a launch: phase in rad, and velocity in `b w`. The outputs are the flight and the phase
//! in rad, the arrival speed in `b w`, and whether the result is certain. Without certainty
//! `search` decides.
//!
//! Convexity isolates the root. The gap is convex on a hump, where the push `A` exceeds k, and
//! concave elsewhere. At the humps' edges S is precomputed, without trigonometry. The earliest edge
//! with `u < 0` ends the stretch of the impact: the hump itself, or the concave stretch before it.
//! The root there is the first one if the flight clears every earlier hump. The tangents at both
//! ends of a hump bound the gap from below. Tall flights and very short ones need no edge.
//!
//! The root is found by Householder's method of order 4 (Householder 1970). The fallback is
//! Cauchy's step, the root of the second-order Taylor polynomial (Traub 1964).

use core::f64::consts::TAU;

use super::launch::Launch;
use super::search;
use super::short;
use super::track::{Hump, Track};
use crate::arithmetic::lane::{Arc, Lane, Node, floor};
use crate::arithmetic::node;
use crate::impact::double::low::{
    MAX_CONVERGENCE_RATIO, MAX_FLIGHT_FROM_LAUNCH, MIN_FLIGHT_TIME, ROUNDING_MARGIN,
};
use crate::impact::double::short::MAX_SHORT_HOP;
use crate::impact::double::step::{Landing, householder, in_turn};
use crate::impact::wave::motion;

/// Arrival speed in `b w` below which the search decides: near a triple root the steps diverge.
const MIN_ARRIVAL_SPEED: f64 = 0.01;

/// Number of turns whose humps are visited one by one; the search takes longer flights.
const MAX_TURNS: u32 = 8;

/// The stretch of the track that holds the impact, with exactly one root of the gap.
struct Stretch<L: Lane> {
    /// First estimate of the root, in rad after launch.
    start: L,
    /// Ends, in rad after launch.
    low: L,
    high: L,
    /// Lanes in which the first impact is certainly in it.
    certain: L::Mask,
}

/// Mask with every lane set.
#[inline(always)]
fn everywhere<L: Lane>() -> L::Mask {
    L::splat(0.0).below(L::splat(1.0))
}

/// Whether a flight that is not tall is short.
#[inline(always)]
fn is_short<L: Lane, const N: usize>(track: &Track, launch: &Launch<L>) -> L::Mask {
    launch.is_over_within(track, MAX_SHORT_HOP / N as f64)
}

/// Whether the ball is below the track at the next hump's begin.
#[inline(always)]
fn meets_once<L: Lane>(track: &Track, launch: &Launch<L>) -> L::Mask {
    Edge::at_next_hump(track, launch)
        .over
        .below(-launch.margin(track))
}

/// The first impact after `launch`, and whether it grazes; `None` where the part rests.
#[inline(always)]
pub(super) fn first_impact<const N: usize>(
    track: &Track,
    launch: &Launch<f64>,
) -> Option<(Landing<f64>, bool)> {
    if f64::any(launch.is_tall(track)) {
        let (landing, certain) = land_tall::<f64, N>(track, launch);
        if f64::any(certain) {
            return Some((landing, false));
        }
    }
    // By value: in memory the launch would delay the tall flights, too.
    let [sine, cosine] = launch.parts[0];
    land_not_tall::<N>(track, launch.phase, launch.velocity, sine, cosine)
}

/// [`first_impact`] of a flight that is not tall, or whose tall form is not certain.
#[inline(never)]
fn land_not_tall<const N: usize>(
    track: &Track,
    phase: f64,
    velocity: f64,
    sine: f64,
    cosine: f64,
) -> Option<(Landing<f64>, bool)> {
    let launch = &Launch::with_sine_cosine::<N>(track, phase, velocity, sine, cosine);
    if velocity <= 0.0 && f64::any(launch.rests(track)) {
        return None;
    }
    if !f64::any(launch.is_tall(track)) {
        let (landing, certain) = if f64::any(is_short::<f64, N>(track, launch)) {
            short::landing::<f64, N>(track, launch)
        } else if f64::any(meets_once(track, launch)) {
            land_in_stretch::<f64, N>(track, launch, &before_next_hump::<f64, N>(track, launch))
        } else {
            land_in_stretch::<f64, N>(track, launch, &between_edges::<f64, N>(track, launch))
        };
        if f64::any(certain) {
            return Some((landing, false));
        }
    }
    Some(search::landing::<N>(track, launch))
}

/// Landing of a tall flight, the only contact on the ball's fall.
#[inline(always)]
fn land_tall<L: Lane, const N: usize>(track: &Track, launch: &Launch<L>) -> (Landing<L>, L::Mask) {
    let mut d = launch.falls_to(track, 0.0);
    let mut far = everywhere::<L>();
    for _ in 0..MAX_APPROACHES {
        let (_, next, _) = approach::<L, N>(track, launch, d);
        let near = (next - d)
            .abs()
            .below(L::splat(MAX_LAST_APPROACH_STEP / N as f64));
        d = L::select(far, next, d);
        far = far & !near;
        if !L::any(far) {
            break;
        }
    }
    let (mut landing, mut settled) = take_householder_step::<L, N>(track, launch, d);
    for _ in 0..2 {
        if L::any(!settled) {
            let (again, then) = take_householder_step::<L, N>(track, launch, landing.flight);
            landing = landing.or(settled, again);
            settled = settled | then;
        }
    }
    landing.phase = in_turn(landing.phase);
    let certain = settled & L::splat(MIN_ARRIVAL_SPEED).below(landing.arrival);
    (landing, certain)
}

/// Landing in a stretch; the mask marks certified first impacts.
#[inline(always)]
fn land_in_stretch<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
    stretch: &Stretch<L>,
) -> (Landing<L>, L::Mask) {
    let mut d = stretch.start;
    let (mut below, mut above) = (stretch.low, stretch.high);
    let mut far = stretch.certain;
    for _ in 0..MAX_APPROACHES {
        if !L::any(far) {
            break;
        }
        let (node, next, before) = approach::<L, N>(track, launch, d);
        below = L::select(before, below.max(node), below);
        above = L::select(before, above, above.min(node));
        let inside = below.below(next) & next.below(above);
        let next = L::select(inside, next, (below + above) * L::splat(0.5));
        let near = (next - d)
            .abs()
            .below(L::splat(MAX_LAST_APPROACH_STEP / N as f64));
        d = L::select(far, next, d);
        far = far & !near;
    }
    let (mut landing, mut settled) = take_householder_step::<L, N>(track, launch, d);
    for _ in 0..2 {
        if L::any(stretch.certain & !settled) {
            let next = landing.flight.max(stretch.low).min(stretch.high);
            let (again, then) = take_householder_step::<L, N>(track, launch, next);
            landing = landing.or(settled, again);
            settled = settled | then;
        }
    }
    landing.phase = in_turn(landing.phase);
    let certain = stretch.certain
        & settled
        & stretch.low.below(landing.flight)
        & landing.flight.below(stretch.high)
        & L::splat(MIN_ARRIVAL_SPEED).below(landing.arrival);
    (landing, certain)
}

/// The stretch down to the track's lowest reach, where the gap is concave throughout.
#[inline(always)]
fn find_falling_stretch<L: Lane>(track: &Track, launch: &Launch<L>) -> Stretch<L> {
    let zero = L::splat(0.0);
    Stretch {
        start: launch.falls_to(track, 0.0),
        low: zero,
        high: launch.falls_to(track, -track.wave.bottom()) + L::splat(1e-9),
        certain: everywhere::<L>(),
    }
}

/// The gap at a hump's begin.
#[derive(Clone, Copy)]
struct Edge<L> {
    /// Time in rad after launch.
    time: L,
    /// u there.
    over: L,
    /// u' there.
    slope: L,
    /// A' there.
    surge: L,
    /// -A'' there.
    bend: L,
    /// Length in rad of the concave stretch before it.
    before: L,
}

impl<L: Lane> Edge<L> {
    /// The edge at the begin of `hump`, `time` rad after the launch.
    #[inline(always)]
    fn new(track: &Track, launch: &Launch<L>, hump: &Hump, time: L) -> Self {
        Self {
            time,
            over: launch.height(track, time) - L::splat(hump.begin.height),
            slope: (launch.rise() - L::splat(track.k) * time) - L::splat(hump.begin.speed),
            surge: L::splat(hump.begin.surge),
            bend: L::splat(hump.begin.bend),
            before: L::splat(hump.before),
        }
    }

    /// No edge.
    #[inline(always)]
    fn none() -> Self {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        Self {
            time: L::splat(f64::MAX),
            over: one,
            slope: one,
            surge: zero,
            bend: zero,
            before: zero,
        }
    }

    /// `self` where the mask holds, else `other`.
    #[inline(always)]
    fn or(self, mask: L::Mask, other: Self) -> Self {
        Self {
            time: L::select(mask, self.time, other.time),
            over: L::select(mask, self.over, other.over),
            slope: L::select(mask, self.slope, other.slope),
            surge: L::select(mask, self.surge, other.surge),
            bend: L::select(mask, self.bend, other.bend),
            before: L::select(mask, self.before, other.before),
        }
    }

    /// The begin of the next hump.
    #[inline(always)]
    fn at_next_hump(track: &Track, launch: &Launch<L>) -> Self {
        let Some((first, others)) = track.humps().split_first() else {
            return Self::none();
        };
        let mut next = Self::new(track, launch, first, launch.ahead(first.begin.phase));
        for hump in others {
            let edge = Self::new(track, launch, hump, launch.ahead(hump.begin.phase));
            next = edge.or(edge.time.below(next.time), next);
        }
        next
    }

    /// The stretch `low..high` of the impact; its start is one step of Householder's method from
    /// this edge.
    #[inline(always)]
    fn find_stretch<const N: usize>(
        &self,
        track: &Track,
        launch: &Launch<L>,
        low: L,
        high: L,
        certain: L::Mask,
    ) -> Stretch<L> {
        // At the edge u'' is 0.
        let back = householder(self.over, self.slope, L::splat(0.0), self.surge, -self.bend);
        let hop = launch.is_over_within(track, MAX_FLIGHT_FROM_LAUNCH / N as f64);
        let start = L::select(hop, launch.over_after(track), self.time - back);
        let low = low.max(L::splat(MIN_FLIGHT_TIME / N as f64));
        Stretch {
            start: start.max(low).min(high),
            low,
            high,
            certain,
        }
    }
}

/// The stretch before the next hump, if the ball is below the track at that hump's begin.
#[inline(always)]
fn before_next_hump<L: Lane, const N: usize>(track: &Track, launch: &Launch<L>) -> Stretch<L> {
    let edge = Edge::at_next_hump(track, launch);
    let low = edge.time - edge.before;
    edge.find_stretch::<N>(track, launch, low, edge.time, everywhere::<L>())
}

/// The stretch, from the signs of the gap at the edges of the humps.
#[inline(always)]
fn between_edges<L: Lane, const N: usize>(track: &Track, launch: &Launch<L>) -> Stretch<L> {
    if track.humps().is_empty() {
        return find_falling_stretch(track, launch);
    }
    let (zero, turn, never) = (L::splat(0.0), L::splat(TAU), L::splat(f64::MAX));
    let (k, v) = (L::splat(track.k), launch.rise());
    let margin = launch.margin(track);
    let mut low = zero;
    let mut high = never;
    let mut met = Edge::none();
    let mut doubt = never;
    let mut turns = zero;
    for round in 0..MAX_TURNS {
        for hump in track.humps() {
            let begin = launch.ahead(hump.begin.phase) + turns;
            let end = begin + L::splat(hump.width);
            let edge = Edge::new(track, launch, hump, begin);
            let over_end = launch.height(track, end) - L::splat(hump.end.height);
            let slope_end = (v - k * end) - L::splat(hump.end.speed);
            let before = edge.over.below(-margin);
            let above = margin.below(edge.over);
            let mut within = above & over_end.below(-margin);
            let mut stop = L::select(before, begin, end);
            let width = L::splat(hump.width);
            let mut passed = above
                & margin.below(over_end)
                & is_clear(
                    margin,
                    [edge.over, edge.slope],
                    [over_end, slope_end],
                    width,
                );
            let open = above & !(within | passed) & begin.below(high);
            if L::any(open) {
                let ends = [edge.over, edge.slope, over_end, slope_end];
                let (lowest, touches, clears) =
                    over_hump::<L, N>(track, launch, begin, width, ends, margin);
                let touches = touches & open & margin.below(over_end);
                stop = L::select(touches, lowest, stop);
                within = within | touches;
                passed = passed | (clears & margin.below(over_end) & open);
            }
            doubt = doubt.min(L::select(before | within | passed, never, begin));
            let sooner = (before | within) & stop.below(high);
            low = L::select(sooner, L::select(before, begin - edge.before, begin), low);
            met = edge.or(sooner, met);
            high = L::select(sooner, stop, high);
        }
        if !L::any(!high.below(never)) {
            break;
        }
        turns = turns + turn;
        if round == 0 {
            // While the ball is above the track's reach no hump meets it.
            let square = launch.speed_at(track, track.wave.top()) - L::splat(ROUNDING_MARGIN);
            let leaving = square.max(zero).sqrt();
            let per_k = L::splat(track.per_k);
            let above_to = ((v + leaving) * per_k * L::splat(1.0 - 1e-12)).min(L::splat(1e12));
            let last = floor(above_to * L::splat(1.0 / TAU)) - L::splat(2.0);
            let rises = ((v - leaving) * per_k).below(turn)
                & zero.below(v)
                & zero.below(leaving)
                & L::splat(1.0).below(last);
            turns = L::select(rises, last * turn, turns);
        }
    }
    met.find_stretch::<N>(track, launch, low, high, high.below(doubt))
}

/// Whether a convex gap is certainly above `margin`, by value and slope at both ends.
///
/// The gap lies above its tangents there.
#[inline(always)]
fn is_clear<L: Lane>(margin: L, [u, du]: [L; 2], [then, dthen]: [L; 2], width: L) -> L::Mask {
    let zero = L::splat(0.0);
    let cross = u * dthen - du * then + du * dthen * width;
    !du.below(zero) | !zero.below(dthen) | (margin * (dthen - du)).below(cross)
}

/// Minimum of the gap over a hump whose ends are above the track: approximate time in rad after
/// launch.
///
/// The masks: the gap there is below 0; the gap is certainly above 0 over the whole hump.
#[inline(always)]
fn over_hump<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
    begin: L,
    width: L,
    [over, slope, over_end, slope_end]: [L; 4],
    margin: L,
) -> (L, L::Mask, L::Mask) {
    let k = L::splat(track.k);
    // Nodes nearer to an edge may lie beyond it.
    let inset = L::splat(node::SPACING);
    let end = begin + width;
    let mut d = begin - slope * width / (slope_end - slope);
    let mut at = [begin, over, slope];
    for _ in 0..2 {
        let node = Node::near(launch.phase, d.max(begin + inset).min(end - inset));
        let motion = motion::<L, N>(&track.wave.parts::<L, N>(node.sine, node.cosine));
        let speed = (launch.rise() - k * node.distance) - motion.speed;
        at = [
            node.distance,
            launch.height(track, node.distance) - motion.height,
            speed,
        ];
        d = node.distance - speed / (motion.push - k);
    }
    let [lowest, value, speed] = at;
    let inside = begin.below(lowest) & lowest.below(end);
    let here = [value, speed];
    let clears = margin.below(value)
        & is_clear(margin, [over, slope], here, lowest - begin)
        & is_clear(margin, here, [over_end, slope_end], end - lowest);
    (lowest, inside & value.below(-margin), inside & clears)
}

/// Time of the node next to `d`, a time closer to the impact, and whether the gap at the node is
/// positive.
///
/// The step is Householder's of order 4 within [`MAX_CONVERGENCE_RATIO`], else Cauchy's to the
/// down-crossing.
#[inline(always)]
fn approach<L: Lane, const N: usize>(track: &Track, launch: &Launch<L>, d: L) -> (L, L, L::Mask) {
    let zero = L::splat(0.0);
    let node = Node::near(launch.phase, d);
    let at = motion::<L, N>(&track.wave.parts::<L, N>(node.sine, node.cosine));
    let f = launch.height(track, node.distance) - at.height;
    let g = (launch.rise() - L::splat(track.k) * node.distance) - at.speed;
    let g2 = at.push - L::splat(track.k);
    let fair = g.below(zero)
        & (f * g2)
            .abs()
            .below(L::splat(MAX_CONVERGENCE_RATIO) * (g * g));
    let mut step = -householder(f, g, g2, at.surge, -at.bend);
    if L::any(!fair) {
        let root = (g * g - L::splat(2.0) * (f * g2)).max(zero).sqrt();
        let rising = zero.below(g);
        let crossing = L::select(rising, -(g + root), f + f) / L::select(rising, g2, root - g);
        step = L::select(fair, step, crossing);
    }
    (node.distance, node.distance + step, zero.below(f))
}

/// Largest step, in rad of the highest tone, after which the last step follows.
const MAX_LAST_APPROACH_STEP: f64 = 0.7;

/// Largest number of steps towards an impact.
const MAX_APPROACHES: u32 = 4;

/// The last step, by Householder's method of order 4 (convergence of order 5).
///
/// The mask marks steps so short that the remaining error is below rounding. The phase may be a
/// rounding error below zero.
#[inline(always)]
fn take_householder_step<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
    d: L,
) -> (Landing<L>, L::Mask) {
    let (k, half) = (L::splat(track.k), L::splat(0.5 * track.k));
    let node = Node::near(launch.phase, d);
    let x = d - node.distance;
    let arc = Arc::new(x);
    let sine = node.sine + (node.cosine * arc.sine - node.sine * arc.versine);
    let cosine = node.cosine - (node.sine * arc.sine + node.cosine * arc.versine);
    let at = motion::<L, N>(&track.wave.parts::<L, N>(sine, cosine));
    let speed = launch.rise() - k * node.distance;
    let height = launch.height(track, node.distance);
    let value = (height - at.height) + x * (speed - half * x);
    let slope = (speed - k * x) - at.speed;
    let curvature = at.push - k;
    let back = householder(value, slope, curvature, at.surge, -at.bend);
    let third = (at.surge + back * (at.bend * L::splat(1.0 / 3.0))) * L::splat(0.5);
    let arrival = back * (curvature - back * third) - slope;
    let square = slope * slope;
    let near = L::splat(MAX_LAST_NEWTON_STEP / N as f64);
    let settled = (value * value).below(near * near * square)
        & (value * curvature)
            .abs()
            .below(L::splat(2.0) * near * square);
    let (phase_high, phase_low) = L::within_turn(node.rounded);
    let landing = Landing {
        flight: node.distance + (x - back),
        phase: phase_high + (phase_low + (x - back)),
        arrival,
    };
    (landing, settled)
}

/// Largest Newton step, in rad of the highest tone, for which the last step leaves an error below
/// rounding.
const MAX_LAST_NEWTON_STEP: f64 = 2e-4;
