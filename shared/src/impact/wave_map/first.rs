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
use crate::arithmetic::{node, square_root};
use crate::impact::double::low::{
    MAX_CONVERGENCE_RATIO, MAX_FLIGHT_FROM_LAUNCH, MIN_FLIGHT_TIME, ROUNDING_MARGIN,
};
use crate::impact::double::short::{MAX_SHORT_HOP, ends_within, quadratic_root};
use crate::impact::double::step::{Landing, householder, in_turn};
use crate::impact::wave::motion;

/// Arrival speed in `b w` below which the search decides: near a triple root the steps diverge.
const MIN_ARRIVAL_SPEED: f64 = 0.01;

/// Number of turns whose humps are visited one by one; the search takes longer flights.
const MAX_TURNS: u32 = 8;

/// The stretch of the track that certainly holds the first impact, the one root of the gap in it.
struct Stretch {
    /// First estimate of the root, in rad after launch.
    start: f64,
    /// Ends, in rad after launch.
    low: f64,
    high: f64,
}

/// The first impact after `launch`, and whether it grazes; `None` where the part rests.
#[inline(always)]
pub(super) fn first_impact<const N: usize>(
    track: &Track,
    launch: &Launch,
) -> Option<(Landing<f64>, bool)> {
    if launch.is_tall(track)
        && let Some(landing) = land_tall::<N>(track, launch)
    {
        return Some((landing, false));
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
    if launch.rests(track) {
        return None;
    }
    let landing = if launch.is_tall(track) {
        None
    } else if is_over_within(track, launch, MAX_SHORT_HOP / N as f64) {
        short::landing::<N>(track, launch)
    } else {
        let stretch = before_next_hump::<N>(track, launch);
        let stretch = stretch.or_else(|| between_edges::<N>(track, launch));
        stretch.and_then(|stretch| land_in_stretch::<N>(track, launch, &stretch))
    };
    match landing {
        Some(landing) => Some((landing, false)),
        None => Some(search::landing::<N>(track, launch)),
    }
}

/// Whether a flight that is not tall ends within about `longest` rad.
#[inline(always)]
fn is_over_within(track: &Track, launch: &Launch, longest: f64) -> bool {
    ends_within(
        launch.velocity,
        launch.pull(track),
        launch.at.surge,
        longest,
    )
}

/// Landing of a tall flight, the only contact on the ball's fall, if it is certain.
#[inline(always)]
fn land_tall<const N: usize>(track: &Track, launch: &Launch) -> Option<Landing<f64>> {
    let mut d = launch.falls_to(track, 0.0);
    for _ in 0..MAX_APPROACHES {
        let (_, next, _) = approach::<N>(track, launch, d);
        let near = (next - d).abs() < MAX_LAST_APPROACH_STEP / N as f64;
        d = next;
        if near {
            break;
        }
    }
    finish::<N>(track, launch, d, |d| d)
}

/// Landing in a stretch, if it is certain.
#[inline(always)]
fn land_in_stretch<const N: usize>(
    track: &Track,
    launch: &Launch,
    stretch: &Stretch,
) -> Option<Landing<f64>> {
    let mut d = stretch.start;
    let (mut below, mut above) = (stretch.low, stretch.high);
    for _ in 0..MAX_APPROACHES {
        let (node, next, before) = approach::<N>(track, launch, d);
        if before {
            below = below.max(node);
        } else {
            above = above.min(node);
        }
        let next = if below < next && next < above {
            next
        } else {
            (below + above) * 0.5
        };
        let near = (next - d).abs() < MAX_LAST_APPROACH_STEP / N as f64;
        d = next;
        if near {
            break;
        }
    }
    let landing = finish::<N>(track, launch, d, |d| d.max(stretch.low).min(stretch.high))?;
    (stretch.low < landing.flight && landing.flight < stretch.high).then_some(landing)
}

/// The landing near `d`, by up to three last steps, each from a time that `within` limits; `None`
/// without certainty.
#[inline(always)]
fn finish<const N: usize>(
    track: &Track,
    launch: &Launch,
    d: f64,
    within: impl Fn(f64) -> f64,
) -> Option<Landing<f64>> {
    let (mut landing, mut settled) = take_householder_step::<N>(track, launch, d);
    for _ in 0..2 {
        if !settled {
            let next = within(landing.flight);
            (landing, settled) = take_householder_step::<N>(track, launch, next);
        }
    }
    landing.phase = in_turn(landing.phase);
    (settled && MIN_ARRIVAL_SPEED < landing.arrival).then_some(landing)
}

/// The gap at a hump's begin.
#[derive(Clone, Copy)]
struct Edge<'a> {
    hump: &'a Hump,
    /// Time in rad after launch.
    time: f64,
    /// u there.
    over: f64,
    /// u' there.
    slope: f64,
}

impl<'a> Edge<'a> {
    /// The edge at the begin of `hump`, `time` rad after the launch.
    #[inline(always)]
    fn new(track: &Track, launch: &Launch, hump: &'a Hump, time: f64) -> Self {
        Self {
            hump,
            time,
            over: launch.height(track, time) - hump.begin.height,
            slope: (launch.rise() - track.k * time) - hump.begin.speed,
        }
    }

    /// The stretch `low..high` of the impact; its start is one step of Householder's method from
    /// this edge.
    #[inline(always)]
    fn find_stretch<const N: usize>(
        &self,
        track: &Track,
        launch: &Launch,
        low: f64,
        high: f64,
    ) -> Stretch {
        let start = if is_over_within(track, launch, MAX_FLIGHT_FROM_LAUNCH / N as f64) {
            quadratic_root(launch.velocity, launch.pull(track), launch.at.surge)
        } else {
            // At the edge u'' is 0.
            let begin = &self.hump.begin;
            self.time - householder(self.over, self.slope, 0.0, begin.surge, -begin.bend)
        };
        let low = low.max(MIN_FLIGHT_TIME / N as f64);
        Stretch {
            start: start.max(low).min(high),
            low,
            high,
        }
    }
}

/// The stretch before the next hump, if the ball is below the track at that hump's begin.
#[inline(always)]
fn before_next_hump<const N: usize>(track: &Track, launch: &Launch) -> Option<Stretch> {
    let (first, others) = track.humps().split_first()?;
    let mut next = (launch.ahead(first.begin.phase), first);
    for hump in others {
        let time = launch.ahead(hump.begin.phase);
        if time < next.0 {
            next = (time, hump);
        }
    }
    let (time, hump) = next;
    let edge = Edge::new(track, launch, hump, time);
    (edge.over < -launch.margin(track))
        .then(|| edge.find_stretch::<N>(track, launch, time - hump.before, time))
}

/// The stretch, from the signs of the gap at the edges of the humps; `None` without certainty.
#[inline(always)]
fn between_edges<const N: usize>(track: &Track, launch: &Launch) -> Option<Stretch> {
    if track.humps().is_empty() {
        // Concave throughout, down to the track's lowest reach.
        return Some(Stretch {
            start: launch.falls_to(track, 0.0),
            low: 0.0,
            high: launch.falls_to(track, -track.wave.bottom()) + 1e-9,
        });
    }
    let (k, v) = (track.k, launch.rise());
    let margin = launch.margin(track);
    let (mut met, mut low, mut high) = (None, 0.0, f64::MAX);
    let mut doubt = f64::MAX;
    let mut turns = 0.0;
    for round in 0..MAX_TURNS {
        for hump in track.humps() {
            let begin = launch.ahead(hump.begin.phase) + turns;
            let end = begin + hump.width;
            let edge = Edge::new(track, launch, hump, begin);
            let over_end = launch.height(track, end) - hump.end.height;
            let slope_end = (v - k * end) - hump.end.speed;
            let before = edge.over < -margin;
            let above = margin < edge.over;
            let mut within = above && over_end < -margin;
            let mut stop = if before { begin } else { end };
            let ends = [[edge.over, edge.slope], [over_end, slope_end]];
            let mut passed =
                above && margin < over_end && is_clear(margin, ends[0], ends[1], hump.width);
            if above && margin < over_end && !passed && begin < high {
                let (lowest, touches, clears) =
                    over_hump::<N>(track, launch, begin, hump.width, ends, margin);
                if touches {
                    stop = lowest;
                }
                (within, passed) = (touches, clears);
            }
            if !(before || within || passed) {
                doubt = doubt.min(begin);
            }
            if (before || within) && stop < high {
                low = if before { begin - hump.before } else { begin };
                (met, high) = (Some(edge), stop);
            }
        }
        if high < f64::MAX {
            break;
        }
        turns += TAU;
        if round == 0 {
            // While the ball is above the track's reach no hump meets it.
            let square = launch.speed_at(track, track.wave.top()) - ROUNDING_MARGIN;
            let leaving = square_root(square.max(0.0));
            let above_to = ((v + leaving) * track.per_k * (1.0 - 1e-12)).min(1e12);
            let last = floor(above_to * (1.0 / TAU)) - 2.0;
            let rises = (v - leaving) * track.per_k < TAU;
            if rises && 0.0 < v && 0.0 < leaving && 1.0 < last {
                turns = last * TAU;
            }
        }
    }
    met.filter(|_| high < doubt)
        .map(|edge| edge.find_stretch::<N>(track, launch, low, high))
}

/// Whether a convex gap is certainly above `margin`, by value and slope at both ends.
///
/// The gap lies above its tangents there.
#[inline(always)]
fn is_clear(margin: f64, [u, du]: [f64; 2], [then, dthen]: [f64; 2], width: f64) -> bool {
    let cross = u * dthen - du * then + du * dthen * width;
    du >= 0.0 || dthen <= 0.0 || margin * (dthen - du) < cross
}

/// Minimum of the gap over a hump whose ends are above the track: approximate time in rad after
/// launch; whether the gap there is below 0; whether it is certainly above 0 over the whole hump.
///
/// `ends` holds value and slope of the gap at both ends.
#[inline(always)]
fn over_hump<const N: usize>(
    track: &Track,
    launch: &Launch,
    begin: f64,
    width: f64,
    ends: [[f64; 2]; 2],
    margin: f64,
) -> (f64, bool, bool) {
    // Nodes nearer to an edge may lie beyond it.
    let inset = node::SPACING;
    let end = begin + width;
    let [[_, slope], [_, slope_end]] = ends;
    let mut d = begin - slope * width / (slope_end - slope);
    let (mut lowest, mut here) = (begin, ends[0]);
    for _ in 0..2 {
        let node = Node::near(launch.phase, d.max(begin + inset).min(end - inset));
        let motion = motion::<N>(&track.wave.parts::<N>(node.sine, node.cosine));
        let speed = (launch.rise() - track.k * node.distance) - motion.speed;
        lowest = node.distance;
        here = [launch.height(track, node.distance) - motion.height, speed];
        d = node.distance - speed / (motion.push - track.k);
    }
    let inside = begin < lowest && lowest < end;
    let clears = margin < here[0]
        && is_clear(margin, ends[0], here, lowest - begin)
        && is_clear(margin, here, ends[1], end - lowest);
    (lowest, inside && here[0] < -margin, inside && clears)
}

/// Time of the node next to `d`, a time closer to the impact, and whether the gap at the node is
/// positive.
///
/// The step is Householder's of order 4 within [`MAX_CONVERGENCE_RATIO`], else Cauchy's to the
/// down-crossing.
#[inline(always)]
fn approach<const N: usize>(track: &Track, launch: &Launch, d: f64) -> (f64, f64, bool) {
    let node = Node::near(launch.phase, d);
    let at = motion::<N>(&track.wave.parts::<N>(node.sine, node.cosine));
    let f = launch.height(track, node.distance) - at.height;
    let g = (launch.rise() - track.k * node.distance) - at.speed;
    let g2 = at.push - track.k;
    let step = if g < 0.0 && (f * g2).abs() < MAX_CONVERGENCE_RATIO * (g * g) {
        -householder(f, g, g2, at.surge, -at.bend)
    } else {
        let root = square_root((g * g - 2.0 * (f * g2)).max(0.0));
        if g > 0.0 {
            -(g + root) / g2
        } else {
            (f + f) / (root - g)
        }
    };
    (node.distance, node.distance + step, 0.0 < f)
}

/// Largest step, in rad of the highest tone, after which the last step follows.
const MAX_LAST_APPROACH_STEP: f64 = 0.7;

/// Largest number of steps towards an impact.
const MAX_APPROACHES: u32 = 4;

/// The last step, by Householder's method of order 4 (convergence of order 5).
///
/// The flag marks steps so short that the remaining error is below rounding. The phase may be a
/// rounding error below zero.
#[inline(always)]
fn take_householder_step<const N: usize>(
    track: &Track,
    launch: &Launch,
    d: f64,
) -> (Landing<f64>, bool) {
    let node = Node::near(launch.phase, d);
    let x = d - node.distance;
    let arc = Arc::new(x);
    let sine = node.sine + (node.cosine * arc.sine - node.sine * arc.versine);
    let cosine = node.cosine - (node.sine * arc.sine + node.cosine * arc.versine);
    let at = motion::<N>(&track.wave.parts::<N>(sine, cosine));
    let speed = launch.rise() - track.k * node.distance;
    let height = launch.height(track, node.distance);
    let value = (height - at.height) + x * (speed - 0.5 * track.k * x);
    let slope = (speed - track.k * x) - at.speed;
    let curvature = at.push - track.k;
    let back = householder(value, slope, curvature, at.surge, -at.bend);
    let third = (at.surge + back * (at.bend * (1.0 / 3.0))) * 0.5;
    let arrival = back * (curvature - back * third) - slope;
    let square = slope * slope;
    let near = MAX_LAST_NEWTON_STEP / N as f64;
    let settled =
        value * value < near * near * square && (value * curvature).abs() < 2.0 * near * square;
    let (phase_high, phase_low) = f64::within_turn(node.rounded);
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
