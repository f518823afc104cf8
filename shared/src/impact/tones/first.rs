//! The first impact of a flight on a track of several tones, over lanes.
//!
//! Where the push passes k the gap is `y - S` with S known there: no trigonometry. The earliest edge at which
//! the gap is below zero ends the stretch that holds the impact: the concave one before a hump, or the hump
//! itself. It has one root there, provided that every hump before it that the flight passes over with both
//! ends is cleared by its tangents, too. A tall flight and one that is over at once need no edge.

use core::f64::consts::TAU;

use super::launch::{Launch, SPARE};
use super::search;
use super::short;
use super::track::Track;
use crate::arithmetic::lane::{Arc, Lane, Node, floor};
use crate::impact::double::step::{Landing, householder, in_turn};
use crate::impact::wave::motion;

/// Flights shorter than this, in rad of the highest tone, are left to the search where they are not short hops: it
/// keeps their relative accuracy. From 0.03 to 0.25 `every_golden_impact_has_the_right_root`.
const SHORTEST: f64 = 0.125;

/// Flights over within this, in rad of the highest tone, are started from their launch. From 0.5 to 2.2
/// `every_golden_impact_has_the_right_root`: it costs steps.
const HOP: f64 = 1.1;

/// Slower arrivals are left to the search: where three roots nearly meet steps end anywhere. From 0.001 to 0.1
/// `every_golden_impact_has_the_right_root`; the map of one tone needs it from 0.03 on.
const SLOWEST: f64 = 0.03;

/// Turns whose humps are looked at one by one. From 1 to 8 `every_golden_impact_has_the_right_root`: a longer
/// flight goes to the search.
const TURNS: u32 = 4;

/// The stretch of the track that holds the impact, with one root of the gap in it.
struct Stretch<L: Lane> {
    start: L,
    low: L,
    high: L,
    certain: L::Mask,
}

/// The first impact after `launch`, and whether it grazes; `None` where the part rests.
#[inline]
pub(super) fn first_impact<const N: usize>(
    track: &Track,
    launch: &Launch<f64>,
) -> Option<(Landing<f64>, bool)> {
    if launch.velocity <= 0.0 && f64::any(launch.rests(track)) {
        return None;
    }
    let (landing, certain) = quick::<f64, N>(track, launch);
    Some(if f64::any(certain) {
        (landing, false)
    } else {
        search::landing::<N>(track, launch)
    })
}

/// The first impact, and where it is certain.
#[inline(always)]
pub(super) fn quick<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
) -> (Landing<L>, L::Mask) {
    let tall = launch.is_tall(track);
    let short = launch.is_over_within(track, short::LONGEST_HOP / N as f64) & !tall;
    if !L::any(!short) {
        return short::landing::<L, N>(track, launch);
    }
    let plain = track.humps().is_empty();
    let edges = !(tall | short);
    let stretch = if plain || !L::any(edges) {
        falling(track, launch, plain, tall)
    } else {
        let found = between_edges::<L, N>(track, launch, edges);
        if L::any(tall) {
            let fall = falling(track, launch, plain, tall);
            Stretch {
                start: L::select(tall, fall.start, found.start),
                low: L::select(tall, fall.low, found.low),
                high: L::select(tall, fall.high, found.high),
                certain: tall | found.certain,
            }
        } else {
            found
        }
    };
    let mut d = stretch.start;
    let (mut below, mut above) = (stretch.low, stretch.high);
    let mut far = !short;
    for _ in 0..APPROACHES {
        let (node, next, before) = approach::<L, N>(track, launch, d);
        below = L::select(before, below.max(node), below);
        above = L::select(before, above, above.min(node));
        let inside = below.below(next) & next.below(above);
        let next = L::select(inside, next, (below + above) * L::splat(0.5));
        let near = (next - d).abs().below(L::splat(LEAP / N as f64));
        d = L::select(far, next, d);
        far = far & !near;
        if !L::any(far) {
            break;
        }
    }
    let (mut landing, mut settled) = settle::<L, N>(track, launch, d);
    for _ in 0..2 {
        if L::any(!(settled | short)) {
            let next = landing.flight.max(stretch.low).min(stretch.high);
            let (again, then) = settle::<L, N>(track, launch, next);
            landing = landing.or(settled, again);
            settled = settled | then;
        }
    }
    landing.phase = in_turn(landing.phase);
    let mut certain = stretch.certain
        & settled
        & stretch.low.below(landing.flight)
        & landing.flight.below(stretch.high)
        & L::splat(SLOWEST).below(landing.arrival);
    if L::any(short) {
        let (hop, held) = short::landing::<L, N>(track, launch);
        landing = hop.or(short, landing);
        certain = (held & short) | (certain & !short);
    }
    (landing, certain)
}

/// The fall from the track's highest reach down to its lowest of a ball that meets the track once: of
/// those that are `tall`, and of all where the gap is concave throughout as on a `plain` track.
#[inline(always)]
fn falling<L: Lane>(track: &Track, launch: &Launch<L>, plain: bool, tall: L::Mask) -> Stretch<L> {
    Stretch {
        start: launch.falls_to(track, 0.0),
        low: launch.falls_to(track, track.wave.top()).only(tall),
        high: launch.falls_to(track, -track.wave.bottom()) + L::splat(1e-9),
        certain: if plain { !tall | tall } else { tall },
    }
}

/// The stretch by the signs of the gap at the edges of the humps, for those lanes that `wanted` holds for.
#[inline(always)]
fn between_edges<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
    wanted: L::Mask,
) -> Stretch<L> {
    let (zero, turn, never) = (L::splat(0.0), L::splat(TAU), L::splat(f64::MAX));
    let (k, v) = (L::splat(track.k), launch.rise());
    let margin = launch.margin(track);
    // What is left of the hump that the launch is in.
    let mut inside = zero;
    for hump in track.humps() {
        let left = launch.ahead(hump.end.phase);
        inside = inside.max(left.only(left.below(L::splat(hump.width))));
    }
    let mut low = inside;
    let mut high = never;
    let mut start = zero;
    let mut doubt = never;
    let mut turns = zero;
    for round in 0..TURNS {
        for hump in track.humps() {
            let begin = launch.ahead(hump.begin.phase) + turns;
            let end = begin + L::splat(hump.width);
            let over_begin = launch.height(track, begin) - L::splat(hump.begin.height);
            let over_end = launch.height(track, end) - L::splat(hump.end.height);
            let slope_begin = (v - k * begin) - L::splat(hump.begin.speed);
            let slope_end = (v - k * end) - L::splat(hump.end.speed);
            let before = over_begin.below(-margin);
            let above = margin.below(over_begin);
            let within = above & over_end.below(-margin);
            // u is convex here: it lies above its tangents at both ends.
            let cross = over_begin * slope_end - slope_begin * over_end
                + slope_begin * slope_end * L::splat(hump.width);
            let clear = !slope_begin.below(zero) | !zero.below(slope_end) | margin.below(cross);
            let passed = above & margin.below(over_end) & clear;
            doubt = doubt.min(L::select(before | within | passed, never, begin));
            let stop = L::select(before, begin, end);
            let sooner = (before | within) & stop.below(high);
            // At the edge u'' is 0.
            let back = householder(
                over_begin,
                slope_begin,
                zero,
                L::splat(hump.begin.surge),
                L::splat(-hump.begin.bend),
            );
            low = L::select(
                sooner,
                L::select(before, inside.max(begin - L::splat(hump.before)), begin),
                low,
            );
            start = L::select(sooner, begin - back, start);
            high = L::select(sooner, stop, high);
        }
        if !L::any(wanted & !high.below(never)) {
            break;
        }
        turns = turns + turn;
        if round == 0 {
            // While the ball is above the track's reach no hump meets it.
            let square = launch.speed_at(track, track.wave.top()) - L::splat(SPARE);
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
    let hop = launch.is_over_within(track, HOP / N as f64);
    let start = L::select(hop, launch.over_after(track), start);
    let low = low.max(L::splat(SHORTEST / N as f64));
    Stretch {
        start: start.max(low).min(high),
        low,
        high,
        certain: wanted & high.below(doubt),
    }
}

/// The time of the node next to `d`, a time closer to the impact, and whether the gap at the node is
/// positive: from it a step of fourth order where that is fair, else to where the quadratic crosses zero
/// going down.
#[inline(always)]
fn approach<L: Lane, const N: usize>(track: &Track, launch: &Launch<L>, d: L) -> (L, L, L::Mask) {
    let zero = L::splat(0.0);
    let node = Node::near(launch.phase, d);
    let at = motion::<L, N>(&track.wave.parts::<L, N>(node.sine, node.cosine));
    let f = launch.height(track, node.distance) - at.height;
    let g = (launch.rise() - L::splat(track.k) * node.distance) - at.speed;
    let g2 = at.push - L::splat(track.k);
    let fair = g.below(zero) & (f * g2).abs().below(L::splat(FAIR) * (g * g));
    let mut step = -householder(f, g, g2, at.surge, -at.bend);
    if L::any(!fair) {
        let root = (g * g - L::splat(2.0) * (f * g2)).max(zero).sqrt();
        let rising = zero.below(g);
        let crossing = L::select(rising, -(g + root), f + f) / L::select(rising, g2, root - g);
        step = L::select(fair, step, crossing);
    }
    (node.distance, node.distance + step, zero.below(f))
}

/// Largest `f u''/u'^2` from which a step of fourth order is taken.
const FAIR: f64 = 0.24;

/// A step shorter than this, in rad of the highest tone, ends near enough to the impact for the last step.
const LEAP: f64 = 0.25;

/// Most steps towards an impact.
const APPROACHES: u32 = 4;

/// The last step, of third order; the mask says where it was so short that what it leaves is below
/// rounding. The phase may be a hair below zero.
#[inline(always)]
fn settle<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
    d: L,
) -> (Landing<L>, L::Mask) {
    let (k, half) = (L::splat(track.k), L::splat(0.5 * track.k));
    let node = Node::near(launch.phase, d);
    let x = d - node.distance;
    let arc = Arc::of(x);
    let sine = node.sine + (node.cosine * arc.sine - node.sine * arc.versine);
    let cosine = node.cosine - (node.sine * arc.sine + node.cosine * arc.versine);
    let at = motion::<L, N>(&track.wave.parts::<L, N>(sine, cosine));
    let speed = launch.rise() - k * node.distance;
    let height = launch.height(track, node.distance);
    let value = (height - at.height) + x * (speed - half * x);
    let slope = (speed - k * x) - at.speed;
    let curvature = at.push - k;
    let per_slope = L::splat(1.0) / slope;
    let newton = value * per_slope;
    let turn = ((curvature * L::splat(0.5)) * per_slope) * newton;
    let back = newton + newton * turn;
    let arrival = back * (curvature - back * (at.surge * L::splat(0.5))) - slope;
    let settled = newton.abs().below(L::splat(NEAR)) & turn.abs().below(L::splat(NEAR));
    let (phase_high, phase_low) = L::within_turn(node.rounded);
    let landing = Landing {
        flight: node.distance + (x - back),
        phase: phase_high + (phase_low + (x - back)),
        arrival,
    };
    (landing, settled)
}

/// Largest Newton step of a last step of third order that leaves less than rounding.
const NEAR: f64 = 1e-6;
