//! Low flights: closed forms find the interval of the track that holds the first impact.
//!
//! The track's sine equals k at both ends of a hump and 1 in its middle. So the gap there is
//! `y - k` or `y - 1`, without trigonometry. In the turn where the parabola falls through height 0,
//! these three signs select the interval with the one root. No earlier hump may poke through the
//! parabola. A flight that meets the track only once needs no signs.
//!
//! The start is the intersection of two parabolas; Householder's method then converges to the root.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use super::launch::{Launch, Track};
use super::step::{GapNearImpact, Landing, LandingEstimate, Local, householder, in_turn};
use crate::arithmetic::node;
use crate::arithmetic::vector::{Node, ROUNDING_OFFSET, Vector, floor};

/// Height of the parabola `sin(pi/2 + x) ~ PARABOLA_HEIGHT - PARABOLA_CURVATURE x^2`, in units of
/// b. Its error is within 0.028 up to 1.45 rad, 0.059 at the ends of the half turn.
const PARABOLA_HEIGHT: f64 = 0.972;
/// Curvature of the parabola of [`PARABOLA_HEIGHT`], per rad^2.
const PARABOLA_CURVATURE: f64 = 0.4177;

/// Flight time in rad below which the search decides, because it keeps the relative accuracy. With
/// several tones it is the flight time in rad of the highest one, here and below.
pub(crate) const MIN_FLIGHT_TIME: f64 = 0.125;

/// Flight time in rad up to which `u/d` gives the start, from the launch; it affects cost only.
pub(crate) const MAX_FLIGHT_FROM_LAUNCH: f64 = 1.1;

/// Arrival speed in `b w` below which the search decides: near a triple root steps end anywhere.
const MIN_ARRIVAL_SPEED: f64 = 0.03;

/// Largest `f u''/u'^2` of a step that ends near the impact; a parabola has roots below 1/4.
pub(crate) const MAX_CONVERGENCE_RATIO: f64 = 0.24;

/// Margin above the rounding of a height or of a squared speed, for flights that are not tall.
pub(crate) const ROUNDING_MARGIN: f64 = 1e-9;

impl<V: Vector> Launch<V> {
    /// Whether the ball leaves height 1 faster than the track's top speed: it meets the track once.
    #[inline(always)]
    fn is_certified(&self, track: &Track<V>) -> V::Mask {
        V::splat(1.0 + ROUNDING_MARGIN).below(self.speed_squared_at_crest(track))
            & V::splat(0.0).below(self.rise())
    }

    /// Whether a flight that is neither tall nor short meets the track once. Either it [is
    /// certified](Self::is_certified), or the ball is below the track at the next hump's begin. Up
    /// to there the gap is concave, or convex and growing and then concave; so it has one root.
    #[inline(always)]
    pub fn has_one_root(&self, track: &Track<V>) -> V::Mask {
        let height = self.height(track, self.time_to_next_hump(track));
        self.is_certified(track) | (height + V::splat(ROUNDING_MARGIN)).below(track.lift_off_sine())
    }
}

/// Signs of the gap at begin, middle and end of a hump.
struct Hump<V: Vector> {
    begin_above: V::Mask,
    begin_below: V::Mask,
    middle_above: V::Mask,
    middle_below: V::Mask,
    end_above: V::Mask,
    end_below: V::Mask,
    /// Whether the gap is above 0 over the whole hump, if all three signs are +.
    clear: V::Mask,
    /// Times in rad of the estimated down-crossing and of the minimum after it, if computed.
    dip: [V; 2],
    /// Whether the minimum of the gap is below 0.
    dips: V::Mask,
}

impl<V: Vector> Hump<V> {
    /// The hump of the turn that begins `turn` rad after the launch. `FIND_MINIMUM` computes the
    /// minimum of the gap if the tangents leave its sign open.
    #[inline(always)]
    fn new<const FIND_MINIMUM: bool>(
        track: &Track<V>,
        launch: &Launch<V>,
        turn: V,
        margin: V,
    ) -> Self {
        let zero = V::splat(0.0);
        let v = launch.rise();
        let begin = turn + track.lift_off;
        let middle = turn + V::splat(FRAC_PI_2);
        let end = turn + track.hump_end();
        let u_begin = launch.height(track, begin) - track.lift_off_sine();
        let u_middle = launch.height(track, middle) - V::splat(1.0);
        let u_end = launch.height(track, end) - track.lift_off_sine();
        let slope_begin = (v - track.k * begin) - track.lift_off_cosine;
        let slope_middle = v - track.k * middle;
        let slope_end = (v - track.k * end) + track.lift_off_cosine;
        // u is convex here: it lies above its tangents, and 1 - cos x >= 4 x^2/pi^2.
        let quadratic = V::splat(4.0 / (PI * PI)) - track.half();
        let above_parabola = zero.below(quadratic)
            & (slope_middle * slope_middle).below(V::splat(4.0) * quadratic * u_middle);
        let half_width = middle - begin;
        // Height at which the middle's and one end's tangent cross, times the slopes' difference.
        let at_begin = u_begin * slope_middle - slope_begin * u_middle
            + slope_begin * slope_middle * half_width;
        let at_end =
            u_middle * slope_end - slope_middle * u_end + slope_middle * slope_end * half_width;
        let falling = slope_middle.below(zero);
        let tangents = V::select(falling, at_end, at_begin);
        let monotone = !(slope_begin.below(zero)) | !(zero.below(slope_end));
        let mut clear = above_parabola | monotone | margin.below(tangents);
        let (mut dip, mut dips) = ([middle; 2], zero.below(zero));
        if FIND_MINIMUM {
            let (lowest, near) = find_minimum(track, launch, begin, end);
            clear = clear | margin.below(near.value - near.slope.abs() * (end - begin));
            dips = near.value.below(-margin);
            let curvature = near.sine - track.k;
            let half = (V::splat(-2.0) * near.value / curvature).max(zero).sqrt();
            dip = [(lowest - half).max(begin), lowest];
        }
        Self {
            begin_above: margin.below(u_begin),
            begin_below: u_begin.below(-margin),
            middle_above: margin.below(u_middle),
            middle_below: u_middle.below(-margin),
            end_above: margin.below(u_end),
            end_below: u_end.below(-margin),
            clear,
            dip,
            dips,
        }
    }

    #[inline(always)]
    fn passes_hump(&self) -> V::Mask {
        self.begin_above & self.middle_above & self.end_above & self.clear
    }
}

/// The gap near its minimum over the hump `begin..end`, where it is convex. The tangent there
/// bounds the gap from below. Newton's steps on the slope start in the middle, where the slope
/// grows fastest, and converge from one side.
// Not inlined on a microcontroller, like `settle`: four soft-f64 copies would take 6 KiB of flash.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn find_minimum<V: Vector>(
    track: &Track<V>,
    launch: &Launch<V>,
    begin: V,
    end: V,
) -> (V, GapNearImpact<V>) {
    /// Smallest curvature that a step divides by; below it the hump is at its end.
    const MIN_CURVATURE: f64 = 1e-9;
    let mut d = (begin + end) * V::splat(0.5);
    for _ in 0..4 {
        let node = Node::near(launch.phase, d);
        let slope = (launch.rise() - track.k * node.distance) - node.cosine;
        let curvature = (node.sine - track.k).max(V::splat(MIN_CURVATURE));
        d = (node.distance - slope / curvature).max(begin).min(end);
    }
    (
        d,
        GapNearImpact::new(track, launch, &LandingEstimate::after_launch(launch, d)),
    )
}

/// The interval of the track that holds the impact, with exactly one root of the gap.
#[derive(Clone, Copy)]
pub(crate) struct Interval<V: Vector> {
    /// Start in rad after launch: intersection of the ball's and the track's parabola.
    pub start: V,
    /// Begin and end of the interval, after launch.
    pub low: V,
    pub high: V,
    /// Whether the closed forms certify the interval.
    pub certain: V::Mask,
}

impl<V: Vector> Interval<V> {
    /// Whether a landing is certainly the root in this interval.
    #[inline(always)]
    pub(super) fn contains(&self, landing: &Landing<V>) -> V::Mask {
        self.certain
            & self.low.below(landing.flight)
            & landing.flight.below(self.high)
            & V::splat(MIN_ARRIVAL_SPEED).below(landing.arrival)
    }

    /// The [`ROUNDING_OFFSET`] sum of the node nearest to the start.
    #[inline(always)]
    fn node(&self, launch: &Launch<V>) -> V {
        let per_node = V::splat(node::COUNT as f64 / TAU);
        (self.start * per_node + launch.phase * per_node) + V::splat(ROUNDING_OFFSET)
    }

    /// The interval `low..high` in the half turn, upper or lower, with its middle at `centre`.
    #[inline(always)]
    fn around(
        track: &Track<V>,
        launch: &Launch<V>,
        centre: V,
        upper: V::Mask,
        low: V,
        high: V,
        certain: V::Mask,
    ) -> Self {
        let top = V::select(upper, V::splat(PARABOLA_HEIGHT), V::splat(-PARABOLA_HEIGHT));
        let quadratic = V::select(
            upper,
            V::splat(PARABOLA_CURVATURE),
            V::splat(-PARABOLA_CURVATURE),
        ) - track.half();
        let gap = launch.height(track, centre) - top;
        let slope = launch.rise() - track.k * centre;
        let start = centre + down_crossing(gap, slope, quadratic);
        Self {
            start: start.max(low).min(high),
            low,
            high,
            certain,
        }
    }
}

/// The interval of a flight that [meets the track once](Launch::has_one_root). It lies in the half
/// turn in which the parabola falls through height 0. At the ends of that half turn the sine is 0,
/// and the track is not at the ball's height.
#[inline(always)]
pub(crate) fn find_single_interval<V: Vector>(track: &Track<V>, launch: &Launch<V>) -> Interval<V> {
    let (zero, quarter) = (V::splat(0.0), V::splat(FRAC_PI_2));
    let (v, k) = (launch.rise(), track.k);
    let high = V::select(
        launch.is_certified(track),
        V::splat(f64::MAX),
        launch.time_to_next_hump(track),
    );
    // A ball that stays below has no root here: NaN gives 0.
    let crossing = ((v + launch.speed_squared_at_zero(track).sqrt()) * track.per_k)
        .max(zero)
        .min(high);
    let turns = (launch.phase + crossing) * V::splat(1.0 / TAU);
    let rounded_turns = (turns + V::splat(ROUNDING_OFFSET)) - V::splat(ROUNDING_OFFSET);
    let to_middle = V::select(turns.below(rounded_turns), -quarter, quarter);
    let centre = (rounded_turns * V::splat(TAU) - launch.phase) + to_middle;
    let quadratic = to_middle * V::splat(PARABOLA_CURVATURE / FRAC_PI_2) - track.half();
    let below = launch.sine - to_middle * V::splat(PARABOLA_HEIGHT / FRAC_PI_2);
    let gap = below + centre * (v - track.half() * centre);
    let slope = v - k * centre;
    // A short flight starts more accurately from its launch, by u/d.
    let hop = launch.is_over_within(track, MAX_FLIGHT_FROM_LAUNCH);
    let centre = centre.keep_where(!hop);
    let gap = V::select(hop, launch.velocity, gap);
    let slope = V::select(hop, (launch.sine - k) * V::splat(0.5), slope);
    let quadratic = V::select(hop, launch.cosine * V::splat(1.0 / 6.0), quadratic);
    let root = (slope * slope - (quadratic * V::splat(4.0)) * gap)
        .max(zero)
        .sqrt();
    Interval {
        start: centre + ((gap + gap) / (root - slope)),
        low: V::splat(MIN_FLIGHT_TIME),
        high,
        certain: zero.below(quarter),
    }
}

#[inline(always)]
pub(crate) fn find_interval<V: Vector>(track: &Track<V>, launch: &Launch<V>) -> Interval<V> {
    search_interval::<V, false>(track, launch)
}

/// [`find_interval`]; `FIND_MINIMUM` also decides flights that barely clear or touch a hump.
#[inline(always)]
fn search_interval<V: Vector, const FIND_MINIMUM: bool>(
    track: &Track<V>,
    launch: &Launch<V>,
) -> Interval<V> {
    let (zero, one, turn) = (V::splat(0.0), V::splat(1.0), V::splat(TAU));
    let v = launch.rise();
    let leaving = launch.speed_squared_at_crest(track);
    let level = launch.speed_squared_at_zero(track);
    let crossing = (v + level.max(zero).sqrt()) * track.per_k;
    let crossing = V::select(level.below(zero), zero, crossing.max(zero));
    // The turn of the crossing begins at `base`; its hump at `begin`.
    let base = floor((launch.phase + crossing) * V::splat(1.0 / TAU)) * turn - launch.phase;
    let begin = base + track.lift_off;
    let lower = !(crossing - base).below(V::splat(PI));

    let margin = launch.margin(track);
    let certified = (one + margin).below(leaving) & zero.below(v);
    let mut centre = base + V::select(lower, V::splat(1.5 * PI), V::splat(FRAC_PI_2));
    let mut upper = !lower;
    let mut low = V::select(lower, crossing, base);
    let mut high = V::select(lower, base + turn, crossing);
    let mut certain = certified;
    let (mut dip, mut dips) = (zero, zero.below(zero));

    if V::any(!certified) {
        // The deciding hump is that of the crossing's turn, unless an earlier one pokes through.
        let passes = !certified & turn.below(begin);
        let (mut base, mut clear, mut earlier) = (base, !passes, zero.below(zero));
        if V::any(passes) {
            let first = V::select(
                launch.phase.below(track.lift_off),
                -launch.phase,
                turn - launch.phase,
            );
            let last = base - turn;
            clear = clear | is_above_humps(track, launch, first, last, margin);
            if V::any(!clear) {
                // Between the first and the last the parabola is highest.
                let inner = last.below(first + turn + one)
                    | is_above_humps(track, launch, first + turn, last - turn, margin);
                let over_first =
                    Hump::new::<FIND_MINIMUM>(track, launch, first, margin).passes_hump();
                let over_last =
                    Hump::new::<FIND_MINIMUM>(track, launch, last, margin).passes_hump();
                if FIND_MINIMUM {
                    let at_first = !clear & !over_first;
                    let at_last = !clear & over_first & inner & !over_last;
                    base = V::select(at_first, first, V::select(at_last, last, base));
                    earlier = at_first | at_last;
                }
                clear = clear | earlier | (inner & over_first & over_last);
            }
        }
        let begin = base + track.lift_off;
        let end = base + track.hump_end();
        let ahead = zero.below(begin);
        let hump = Hump::new::<FIND_MINIMUM>(track, launch, base, margin);
        let before = !certified & ahead & hump.begin_below;
        let rising = !certified & ahead & hump.begin_above & hump.middle_below;
        let falling = !certified & ahead & hump.begin_above & hump.middle_above & hump.end_below;
        let after = !certified & !earlier & (!ahead | hump.passes_hump());
        certain = certified | before | rising | falling | after;

        let middle = base + V::splat(FRAC_PI_2);
        let in_lower = before & !zero.below(launch.height(track, base));
        let in_upper = before | rising | falling;
        upper = (upper | in_upper) & !in_lower;
        centre = V::select(in_upper, middle, centre);
        centre = V::select(in_lower, base - V::splat(FRAC_PI_2), centre);
        low = V::select(before, end - turn, low);
        low = V::select(rising, begin, low);
        low = V::select(falling, middle, low);
        low = V::select(after, end, low);
        high = V::select(before, begin, high);
        high = V::select(rising, middle, high);
        high = V::select(falling, end, high);
        high = V::select(after, begin + turn, high);
        if FIND_MINIMUM {
            let above = hump.begin_above & hump.middle_above & hump.end_above;
            dips = !certified & ahead & above & hump.dips;
            certain = certain | dips;
            low = V::select(dips, begin, low);
            [dip, high] = [hump.dip[0], V::select(dips, hump.dip[1], high)];
        }

        certain = certain & clear;
    }

    let mut interval = Interval::around(
        track,
        launch,
        centre,
        upper,
        low.max(V::splat(MIN_FLIGHT_TIME)),
        high,
        certain,
    );
    if FIND_MINIMUM {
        interval.start = V::select(dips, dip, interval.start);
    }
    interval
}

/// Whether the parabola is above height 1 from the hump of the turn at `from` to that at `to`.
#[inline(always)]
fn is_above_humps<V: Vector>(
    track: &Track<V>,
    launch: &Launch<V>,
    from: V,
    to: V,
    margin: V,
) -> V::Mask {
    let bar = V::splat(1.0) + margin;
    !launch.height(track, from + track.lift_off).below(bar)
        & !launch.height(track, to + track.hump_end()).below(bar)
}

/// Flight time close to the impact in the interval, by one step of Householder's method of order 4.
/// The error is within 1e-6 rad for all but one flight in a hundred.
#[inline(always)]
pub(crate) fn approach<V: Vector>(
    track: &Track<V>,
    launch: &Launch<V>,
    interval: &Interval<V>,
) -> LandingEstimate<V> {
    let rounded = interval.node(launch);
    let (sine, cosine) = V::node(rounded);
    // An error of 1e-12 is small enough here.
    let distance = (rounded - V::splat(ROUNDING_OFFSET)) * V::splat(node::SPACING) - launch.phase;
    let v = launch.rise();
    let f = distance * (v - track.half() * distance) + (launch.sine - sine);
    let g = (v - track.k * distance) - cosine;
    let step = householder(f, g, sine - track.k, cosine, -sine);
    LandingEstimate { rounded, step }
}

/// Landing of a low flight from a time close to it; the mask marks certified first impacts. Lanes
/// of a certain interval whose last step is too long repeat it.
#[inline(always)]
pub(crate) fn landing<V: Vector>(
    track: &Track<V>,
    launch: &Launch<V>,
    interval: &Interval<V>,
    estimate: &LandingEstimate<V>,
) -> (Landing<V>, V::Mask) {
    let (mut landing, mut settled) = take_chebyshev_step(track, launch, estimate);
    if V::any(!settled & interval.certain) {
        let estimate = LandingEstimate::after_launch(launch, landing.flight);
        let (repeated, is_settled) = take_chebyshev_step(track, launch, &estimate);
        landing = landing.or(settled, repeated);
        settled = settled | is_settled;
    }
    landing.phase = in_turn(landing.phase);
    (landing, settled & interval.contains(&landing))
}

/// Landing of a low flight that barely clears a hump or barely touches it. Nearly every flight
/// whose [`Interval`] is not certain is of this kind. The mask marks certified first impacts.
#[inline(always)]
pub(crate) fn land_near_hump<V: Vector>(
    track: &Track<V>,
    launch: &Launch<V>,
) -> (Landing<V>, V::Mask) {
    let interval = search_interval::<V, true>(track, launch);
    let estimate = approach(track, launch, &interval);
    landing(track, launch, &interval, &estimate)
}

/// Landing of a low flight that [`landing`] cannot certify, with up to eight steps. Without a
/// certain interval it searches the one of `FIND_MINIMUM`; `None` if that is not certain either.
#[cold]
pub(crate) fn land_by_iteration(
    track: &Track<f64>,
    launch: &Launch<f64>,
    mut interval: Interval<f64>,
) -> Option<Landing<f64>> {
    if !f64::any(interval.certain) {
        interval = search_interval::<f64, true>(track, launch);
        if !f64::any(interval.certain) {
            return None;
        }
        let estimate = approach(track, launch, &interval);
        let (landing, certain) = landing(track, launch, &interval, &estimate);
        if f64::any(certain) {
            return Some(landing);
        }
    }
    let mut d = interval.start;
    for _ in 0..8 {
        d = d.max(interval.low).min(interval.high);
        let local = Local::at_nearest_node(track, launch, d);
        let (f, g, curvature) = (local.value, local.slope, local.node.sine - track.k);
        let step = if g < 0.0 && (f * curvature).abs() < MAX_CONVERGENCE_RATIO * g * g {
            -householder(f, g, curvature, local.node.cosine, -local.node.sine)
        } else {
            down_crossing(f, g, 0.5 * curvature)
        };
        d = (local.node.distance + step)
            .max(interval.low)
            .min(interval.high);
        let estimate = LandingEstimate {
            rounded: local.node.rounded,
            step: local.node.distance - d,
        };
        let (mut landing, settled) = take_chebyshev_step(track, launch, &estimate);
        if f64::any(settled) {
            landing.phase = in_turn(landing.phase);
            return f64::any(interval.contains(&landing)).then_some(landing);
        }
    }
    None
}

/// The last step, by Chebyshev's method (third order, Traub 1964). The mask marks steps so short
/// that the remaining error is below rounding. The phase may be a rounding error below zero.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn take_chebyshev_step<V: Vector>(
    track: &Track<V>,
    launch: &Launch<V>,
    estimate: &LandingEstimate<V>,
) -> (Landing<V>, V::Mask) {
    let near = GapNearImpact::new(track, launch, estimate);
    let per_slope = V::splat(1.0) / near.slope;
    let newton = near.value * per_slope;
    let curvature = near.sine - track.k;
    let turn = ((curvature * V::splat(0.5)) * per_slope) * newton;
    let step = newton + newton * turn;
    let arrival = step * (curvature - step * (near.cosine * V::splat(0.5))) - near.slope;
    let settled = newton.abs().below(V::splat(MAX_LAST_NEWTON_STEP))
        & turn.abs().below(V::splat(MAX_LAST_NEWTON_STEP / 3.0));
    (near.landing(step, arrival), settled)
}

/// Newton step in rad up to which Chebyshev's method leaves an error below rounding.
const MAX_LAST_NEWTON_STEP: f64 = 3e-6;

/// Cauchy's step: to the down-crossing of `f + g x + b x^2`, or to its extremum without one.
#[inline(always)]
fn down_crossing<V: Vector>(f: V, g: V, b: V) -> V {
    let zero = V::splat(0.0);
    let root = (g * g - V::splat(4.0) * (b * f)).max(zero).sqrt();
    let rising = zero.below(g);
    V::select(rising, -(g + root), f + f) / V::select(rising, b + b, root - g)
}
