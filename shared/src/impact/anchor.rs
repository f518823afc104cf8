//! The search for the first impact that the kernels with an FPU share, anchored on table nodes.
//!
//! The flight time at which the height `u` is evaluated is free, so it is chosen such that the phase
//! falls on a node of the sine table: sine and cosine there are table constants, the reduction modulo
//! 2 pi is a mask, and the local expansion
//! `u(D + d) = u0 + u1 d - k d^2/2 + S (1 - cos d) + C (d - sin d)` has all its derivatives for free.
//!
//! Which root is the first is decided in closed form. With `y` the ballistic parabola and
//! `u = y - sin`: `u` is convex where `sin > k` (the hump, from `arcsin k` to `pi - arcsin k`) and
//! concave elsewhere, and at both ends of a hump `sin = k` exactly. So the segment that holds the root
//! follows from `y` alone, unless an earlier hump pokes through the parabola, which a closed test on
//! its ends and middle decides in nearly every case, a one-dimensional minimum in the rest.

use core::f64::consts::{PI, TAU};

use crate::arithmetic::node;
use crate::arithmetic::{Phase, sine_cosine_single, square_root_single};
use crate::feeder::{OutOfRange, accept};

/// Node spacing in rad, and nodes in a rad.
pub(crate) const SPACING: f32 = node::SPACING as f32;
const PER_RADIAN: f32 = (1.0 / node::SPACING) as f32;
/// Radians in a step of a phase, and steps in a radian.
pub(crate) const STEP: f32 = (TAU / 4_294_967_296.0) as f32;
pub(crate) const PER_STEP: f32 = (4_294_967_296.0 / TAU) as f32;
const TURN: f32 = TAU as f32;
/// A turn in steps of a phase.
const WHOLE: i64 = 1 << 32;
/// No start near launch is farther, in rad: there the cubic does not tell.
const FAR: f32 = 4.0;
/// 1.5 * 2^23: adding it rounds an f32 below 2^22 to an integer, which then stands in the low bits.
const ROUND: f32 = 12_582_912.0;

/// Set-up constants of a track in f64: the one routine all kernels take theirs from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SetUp {
    /// k.
    pub k: f64,
    /// Phase where a hump begins, `arcsin k`; a quarter turn where k >= 1.
    pub entry: Phase,
    /// Length of a hump, `pi - 2 arcsin k`, in steps of a phase; 0 where k >= 1.
    pub hump: u32,
    /// Slope of the sine at `entry`, `sqrt(1 - k^2)`.
    pub flank: f64,
}

impl SetUp {
    /// The constants for `k`, with the refusal of a k or a restitution that no kernel for
    /// microcontrollers takes.
    pub fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        accept("k", k, (0.005..=4.0).contains(&k), "0.005..4")?;
        accept(
            "restitution",
            restitution,
            (0.0..=1.0).contains(&restitution),
            "0..1",
        )?;
        Ok(Self::new(k))
    }

    /// The least square of the speed at height 0 of a high flight, with what rounding may take: from
    /// there on the speed at every height h is above `sqrt(1 - h^2)`, the track's.
    pub fn high(&self) -> f64 {
        let k = self.k;
        0.01 + if k < 1.0 { 1.0 + k * k } else { 2.0 * k }
    }

    fn new(k: f64) -> Self {
        if k >= 1.0 {
            return Self {
                k,
                entry: Phase::from_bits(1 << 30),
                hump: 0,
                flank: 0.0,
            };
        }
        let entry = Phase::from_radians(libm::asin(k));
        Self {
            k,
            entry,
            hump: (1_u32 << 31) - 2 * entry.bits(),
            flank: libm::sqrt((1.0 - k) * (1.0 + k)),
        }
    }
}

/// What the search needs to know of the track, in f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shape {
    pub k: f32,
    half_k: f32,
    inverse: f32,
    /// What of k is above 1.
    excess: f32,
    flank: f32,
    hump_length: f32,
    /// The least square of the speed at height 0 of a high flight.
    high: f32,
    /// The steepest slope down to a hump's entry from which its near side is told by the cubic.
    skim: f32,
    pub entry: u32,
    pub hump: u32,
}

impl Shape {
    pub fn new(set_up: &SetUp) -> Self {
        // How far into a hump the cubic of [`Shape::clears`] holds.
        let reach = (0.48 * set_up.flank / set_up.k).min(1.26);
        Self {
            k: set_up.k as f32,
            half_k: (0.5 * set_up.k) as f32,
            inverse: (1.0 / set_up.k) as f32,
            excess: (set_up.k - 1.0).max(0.0) as f32,
            flank: set_up.flank as f32,
            hump_length: (f64::from(set_up.hump) * (TAU / 4_294_967_296.0)) as f32,
            high: set_up.high() as f32,
            skim: (0.4 * set_up.flank * reach * reach) as f32,
            entry: set_up.entry.bits(),
            hump: set_up.hump,
        }
    }

    /// Whether the track throws a part at `phase`: `sin > k`.
    #[inline(always)]
    pub fn throws(&self, phase: u32) -> bool {
        phase.wrapping_sub(self.entry) < self.hump
    }

    /// Whether a down-crossing `steps` after launch at `phase` comes before the end of the next hump, and
    /// not so soon that it may be launch itself or is settled with more digits as a short hop.
    #[inline(always)]
    pub fn ends<F: Flight>(&self, phase: u32, steps: i64) -> bool {
        let to_entry = self.entry.wrapping_sub(phase).wrapping_sub(1);
        steps >= (0.8 * F::SHORT * PER_STEP) as i64
            && steps <= i64::from(to_entry) + i64::from(self.hump)
    }

    /// Whether a down-crossing `steps` after launch comes before the hump after the next one, and the flight
    /// clears the next one.
    ///
    /// From its entry, where `u` has the height `h` and falls at `p`, `u` is above `h - p x + f x^3 / 6`
    /// with `f = 0.8 flank`, as far as `k x / (4 flank) + x^2 / 20 <= 0.2`. The least of that, at
    /// `x^2 = 2 p / f`, is above 0 where `h^2 f > 8 p^3 / 9`; from there on `u` rises.
    #[inline(never)]
    pub fn clears(&self, launch: &Launch, steps: i64) -> bool {
        let to_entry = self.entry.wrapping_sub(launch.phase).wrapping_sub(1);
        let x = to_entry as f32 * STEP;
        let v = launch.velocity + launch.cosine;
        let height = x * (v - self.half_k * x) - launch.pull - 1e-4;
        let fall = larger(self.flank + self.k * x - v, 0.0) + 1e-5;
        height > 0.0
            && fall < self.skim
            && 0.8 * self.flank * height * height > (8.0 / 9.0) * fall * fall * fall
            && steps > 0
            && steps <= i64::from(to_entry) + WHOLE
    }

    /// `k - sin` where the difference of the rounded ones is small: by the distance from the nearer end
    /// of a hump, to which half a step of the phase is all that rounds.
    #[inline(never)]
    pub fn pull_near_edge(&self, phase: u32) -> f32 {
        let after_begin = phase.wrapping_sub(self.entry) as i32 as f32 * STEP;
        let before_end =
            self.entry.wrapping_add(self.hump).wrapping_sub(phase) as i32 as f32 * STEP;
        let d = if abs(after_begin) < abs(before_end) {
            after_begin
        } else {
            before_end
        };
        let z = d * d;
        let rise = self.flank * d * (1.0 - z * (1.0 / 6.0)) - self.k * z * (0.5 - z * (1.0 / 24.0));
        self.excess - rise
    }
}

/// A launch in f32.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Launch {
    /// Phase, steps.
    pub phase: u32,
    /// Velocity relative to the track (psi).
    pub velocity: f32,
    /// Sine and cosine of the phase.
    pub sine: f32,
    pub cosine: f32,
    /// `k - sin` of the phase, to the precision of the kernel.
    pub pull: f32,
}

/// Height and slope of the flight above the track at a node, with sine and cosine there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Local {
    pub height: f32,
    pub slope: f32,
    pub sine: f32,
    pub cosine: f32,
}

/// A flight as its kernel knows it.
pub(crate) trait Flight {
    /// The flight at a node, counted from phase 0 of the turn of launch; near an impact to the full
    /// precision of the kernel.
    fn local(&self, node: i32) -> Local;
    /// Ballistic height over k at `steps` after launch, where f32 makes it `nearly` 0; k < 1.
    fn above_k(&self, steps: i64, nearly: f32) -> f32;
    /// Flights below this many rad keep more digits in the deflated form than on a node.
    const SHORT: f32;
    /// A gap over a hump below this, and what is added to it for each rad of flight, is within rounding.
    const ROUNDING: f32;
    const DRIFT: f32;
    /// Rounding of the pull.
    const PULL: f32;
    /// Where an approach begins.
    #[inline(always)]
    fn node_of(phase: u32, x: f32) -> (i32, f32) {
        node_of(phase, x)
    }
    /// The step at which an approach ends, in rad.
    const LEAP: f32;
    /// An arrival at less than this speed may be a graze within rounding.
    const SLOW: f32;
    /// Whether the end of an approach is the impact, as near as the kernel can tell.
    const FINAL: bool;
    /// The last correction of a settled impact that leaves an error within rounding, in rad at an arrival
    /// speed of 1.
    const NEAR: f32;
}

/// Where the first impact is, nearly.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Found {
    /// A short hop: flight in rad and arrival speed, final.
    Short { flight: f32, arrival: f32 },
    /// At `offset` rad from a node; settled with care for a double root unless it is `simple`.
    Near {
        node: i32,
        offset: f32,
        simple: bool,
    },
}

/// A settled impact: offset from its node in rad, and the arrival speed less minus the node's slope.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Settled {
    pub offset: f32,
    pub speed_gain: f32,
}

#[inline(always)]
fn abs(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0x7fff_ffff)
}

#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Square root of what is positive of `x`.
#[inline(always)]
fn root(x: f32) -> f32 {
    if x > 0.0 { square_root_single(x) } else { 0.0 }
}

/// Nearest integer to `x`, |x| < 2^22, as integer and as f32.
#[inline(always)]
fn nearest(x: f32) -> (i32, f32) {
    let shifted = x + ROUND;
    (
        (shifted.to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32),
        shifted - ROUND,
    )
}

/// The node nearest to flight time `x` (rad) and the distance of `x` from it.
#[inline(always)]
fn node_of(phase: u32, x: f32) -> (i32, f32) {
    let angle = phase as f32 * STEP + x;
    let (node, count) = nearest(angle * PER_RADIAN);
    (node, angle - count * SPACING)
}

/// As [`node_of`], from the node nearest to the phase: the angle from there keeps its digits.
#[inline(always)]
pub(crate) fn node_from_near(phase: u32, x: f32) -> (i32, f32) {
    let first = ((phase >> 23) + 1) >> 1;
    let angle = phase.wrapping_sub(first << 24) as i32 as f32 * STEP + x;
    let (jump, count) = nearest(angle * PER_RADIAN);
    (first as i32 + jump, angle - count * SPACING)
}

#[inline(always)]
fn sine_cosine_at(node: i32) -> (f32, f32) {
    let [sine, cosine] = node::SINGLE[(node & 255) as usize];
    (sine, cosine)
}

/// The impact of a high flight, nearly: node and offset; `None` where the flight is not high or the
/// steps do not converge soon.
///
/// High is a flight that passes every height h of the track faster than the track ever does there, which
/// is at most `sqrt(1 - h^2)`: on the rise it cannot meet the track, on the fall it crosses it once. The
/// square of its speed, `v^2 + 2 k (sin - h)`, is above `1 - h^2` for all of them where that at height 0
/// is above `1 + k^2`, or `2 k` where k >= 1.
#[inline(always)]
pub(crate) fn fall<F: Flight>(shape: &Shape, launch: &Launch) -> Option<Approach> {
    let rise = launch.velocity + launch.cosine;
    let square = rise * rise + 2.0 * shape.k * launch.sine;
    if !(rise > 0.0 && square >= shape.high) {
        return None;
    }
    let speed = square_root_single(square);
    let x = (rise + speed) * shape.inverse;
    let (node, offset) = F::node_of(launch.phase, x);
    approach::<F>(shape, node, -offset, speed, 0.0)
}

/// The last of some steps on nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Approach {
    /// Where it started.
    pub node: i32,
    /// Its length, rad.
    pub step: f32,
    /// Speed downwards against the track at that node, half the rate at which it grows, sine and cosine.
    speed: f32,
    gain: f32,
    sine: f32,
    cosine: f32,
    /// The node nearest to where it ends and the distance from there.
    pub end: (i32, f32),
}

impl Approach {
    /// Arrival speed where it ends, near to its node.
    #[inline(always)]
    pub fn arrival(&self) -> f32 {
        let bend = 0.5 * self.cosine - self.sine * (1.0 / 6.0) * self.step;
        self.speed + self.step * (self.gain + self.gain - bend * self.step)
    }
}

/// Householder's third-order step on nodes until it is short: from a node `late` after the part was at
/// height `base`, going down at `speed`.
#[inline(always)]
fn approach<F: Flight>(
    shape: &Shape,
    mut node: i32,
    mut late: f32,
    speed: f32,
    base: f32,
) -> Option<Approach> {
    for _ in 0..6 {
        let (sine, cosine) = sine_cosine_at(node);
        let u0 = late * (speed + shape.half_k * late) + (sine - base);
        let u1 = speed + shape.k * late + cosine;
        let b2 = 0.5 * (shape.k - sine);
        let square = u1 * u1;
        let product = b2 * u0;
        let step = householder(u0, u1, square, product, -cosine);
        let (jump, count) = nearest(step * PER_RADIAN);
        let next = node.wrapping_add(jump);
        // Householder's step is short as well where it leads to no root, but not Newton's. The steps may
        // have led back to launch, where the part rises over the track.
        let ends = if F::FINAL {
            abs(u0) < F::LEAP * (u1 - F::SLOW) && abs(product) < 0.1 * square
        } else {
            abs(step) < F::LEAP
        };
        if ends {
            return Some(Approach {
                node,
                step,
                speed: u1,
                gain: b2,
                sine,
                cosine,
                end: (next, step - count * SPACING),
            });
        }
        node = next;
        late += count * SPACING;
    }
    None
}

/// Where the first impact of a low flight may be.
pub(crate) enum Candidate {
    /// A short hop: flight in rad and arrival speed, final.
    Hop { flight: f32, arrival: f32 },
    /// Near `offset` rad from a node, if a down-crossing there is the first.
    Near { node: i32, offset: f32 },
    /// At the end of an approach that is [`Flight::FINAL`], if that is the first.
    Final(Approach),
    /// Nowhere that is told so quickly.
    Unknown,
}

/// A candidate from the flight near launch or the fall of the parabola.
///
/// Up to the end of the next hump a down-crossing is the first impact: it may lie in that hump, where `u`
/// is convex and so above it from the entry on, and where `u` is above 0 at the entry it is above 0 on
/// the concave stretch from launch; or it lies on that stretch, which it ends. From within a hump `u`
/// rises to the stretch. See [`Shape::ends`].
#[inline(always)]
pub(crate) fn candidate<F: Flight>(shape: &Shape, launch: &Launch) -> Candidate {
    let Launch {
        velocity,
        sine,
        cosine,
        pull,
        ..
    } = *launch;
    // u/d = psi - a1 d + a2 d^2 - sin d^3 / 24 - cos d^4 / 120 + sin d^5 / 720 + ...
    let a1 = 0.5 * pull;
    let a2 = cosine * (1.0 / 6.0);
    let discriminant = a1 * a1 - 4.0 * a2 * velocity;
    let mut near = FAR;
    // Below the lower bound it clears the coming hump, or nearly so.
    let square = a1 * a1;
    if a1 > 0.0 && discriminant > -0.06 * square {
        let slope = root(discriminant);
        near = 2.0 * velocity / (a1 + slope);
        if near < F::SHORT {
            if discriminant < 0.2 * square || sine > 0.96 && near_top::<F>(launch) {
                return Candidate::Unknown;
            }
            let (flight, arrival) = hop(launch, near);
            return Candidate::Hop { flight, arrival };
        }
        if near < 1.0 && discriminant > 0.02 * square {
            let z = near * near;
            let third = cosine * near;
            let over = sine * (1.0 / 24.0 - z * (1.0 / 720.0)) + third * (1.0 / 120.0);
            let steeper = slope + z * (sine * (1.0 / 8.0) + third * (1.0 / 30.0));
            let inverse = 1.0 / steeper;
            let newton = z * near * over * inverse;
            let bend = (a2 - sine * (1.0 / 8.0) * near) * inverse;
            near -= newton * (1.0 - newton * bend);
            if !F::FINAL {
                let (node, offset) = F::node_of(launch.phase, near);
                return Candidate::Near { node, offset };
            }
        }
    } else if a1 <= 0.0 && a2 < 0.0 {
        near = (a1 - square_root_single(discriminant)) / (a2 + a2);
        if near < F::SHORT {
            return Candidate::Unknown;
        }
    }
    let rise = velocity + cosine;
    let (mut speed, mut origin, mut base) = (-rise, 0.0, sine);
    if near >= FAR {
        let square = rise * rise + 2.0 * shape.k * sine;
        if !(rise > 0.0 && square > 0.1) {
            return Candidate::Unknown;
        }
        speed = square_root_single(square);
        origin = (rise + speed) * shape.inverse;
        // No flight that ends after the hump after the next one is told here.
        let to_entry = shape.entry.wrapping_sub(launch.phase) as f32 * STEP;
        if origin > to_entry + (TURN + 0.5) {
            return Candidate::Unknown;
        }
        near = origin;
        base = 0.0;
    }
    let (node, offset) = F::node_of(launch.phase, near);
    match approach::<F>(shape, node, (near - origin) - offset, speed, base) {
        Some(approach) if F::FINAL => Candidate::Final(approach),
        Some(approach) => {
            let (node, offset) = approach.end;
            Candidate::Near { node, offset }
        }
        None => Candidate::Unknown,
    }
}

/// Whether the cubic does not tell a short hop: pull and cosine vanish together at the top of the track
/// with k near 1.
#[inline(always)]
fn near_top<F: Flight>(launch: &Launch) -> bool {
    abs(launch.cosine) < F::SHORT && abs(launch.pull) < 0.3 * F::SHORT * F::SHORT
}

/// Height and slope gained over `d` from a node, and half the curvature there.
#[inline(always)]
fn expand(k: f32, local: &Local, d: f32) -> (f32, f32, f32) {
    let Local {
        height,
        slope,
        sine,
        cosine,
    } = *local;
    let curvature = sine - k;
    let third = cosine * d;
    let fourth = sine * d * d;
    let b2 = 0.5 * curvature + 0.5 * third;
    (
        height + d * (slope + d * (0.5 * curvature + third * (1.0 / 6.0) - fourth * (1.0 / 24.0))),
        d * (curvature + 0.5 * third - fourth * (1.0 / 6.0)),
        b2,
    )
}

/// A simple root from `offset` near a node by Newton steps with their quadratic correction, the second
/// only where the first is not enough; `None` where that is not either, or at no down-crossing (the steps
/// may have led back to launch), or at one so slow that it may be a graze.
#[inline(always)]
pub(crate) fn settle<F: Flight>(shape: &Shape, local: &Local, offset: f32) -> Option<Settled> {
    let (settled, left) = settle_once::<F>(shape, local, offset);
    if left < 0.0 {
        return Some(settled);
    }
    // So near to the node the expansion holds.
    if abs(settled.offset) < 0.03 {
        let (settled, left) = settle_once::<F>(shape, local, settled.offset);
        return (left < 0.0).then_some(settled);
    }
    None
}

/// One step; and a value below 0 where it is enough.
#[inline(always)]
fn settle_once<F: Flight>(shape: &Shape, local: &Local, offset: f32) -> (Settled, f32) {
    let (height, gain, b2) = expand(shape.k, local, offset);
    let slope = local.slope + gain;
    let inverse = 1.0 / slope;
    let newton = height * inverse;
    let e = -newton * (1.0 + b2 * newton * inverse);
    // What is left is about 2 (b2 newton / slope)^2 newton.
    (
        finished(local, offset, gain, b2, e),
        abs(newton) + F::NEAR * (slope + F::SLOW),
    )
}

/// The state after the last step `e`.
#[inline(always)]
fn finished(local: &Local, offset: f32, gain: f32, b2: f32, e: f32) -> Settled {
    Settled {
        offset: offset + e,
        speed_gain: -(gain + e * (b2 + b2 + 0.5 * local.cosine * e)),
    }
}

/// The first root of `u0 + u1 d + b2 d^2` by a down-crossing (its extremum where there is none) and
/// the root of the discriminant (Cauchy's step).
#[inline(always)]
fn down_crossing(u0: f32, u1: f32, b2: f32) -> (f32, f32) {
    let square = root(u1 * u1 - 4.0 * b2 * u0);
    let (over, under) = if u1 > 0.0 || square == 0.0 {
        (-(u1 + square), 2.0 * b2)
    } else {
        (2.0 * u0, square - u1)
    };
    (if under != 0.0 { over / under } else { 0.0 }, square)
}

/// The first root from `offset` near a node, also where two roots nearly meet; and whether it is doubtful.
#[inline(never)]
pub(crate) fn settle_carefully(shape: &Shape, local: Local, mut offset: f32) -> (Settled, bool) {
    // The search came nearer than this, but where three roots nearly meet within rounding.
    const LONGEST: f32 = 0.02;
    let mut doubtful = false;
    let mut round = 0;
    loop {
        let (height, gain, b2) = expand(shape.k, &local, offset);
        let slope = local.slope + gain;
        let simple = slope < 0.0 && abs(height * b2) < 2e-3 * slope * slope;
        let (mut e, square) = if simple {
            let newton = height / slope;
            (-newton * (1.0 + b2 * newton / slope), 0.0)
        } else {
            down_crossing(height, slope, b2)
        };
        if square > 0.0 {
            let cubic = e * e * e * local.cosine * (1.0 / 6.0) / square;
            if abs(cubic) < 0.25 * abs(e) {
                e += cubic;
            }
        }
        if abs(e) > LONGEST {
            e = smaller(larger(e, -LONGEST), LONGEST);
            doubtful = true;
        }
        round += 1;
        if (simple && abs(e) < 2e-3) || abs(e) < 2e-4 || round >= 8 {
            return (finished(&local, offset, gain, b2, e), doubtful);
        }
        offset += e;
    }
}

/// `w = u / d` of a short flight and its derivative, in forms that keep every digit.
#[inline(always)]
fn deflated(launch: &Launch, x: f32) -> (f32, f32) {
    let Launch {
        velocity,
        sine,
        cosine,
        pull,
        ..
    } = *launch;
    let z = x * x;
    let q3 = 1.0 / 6.0 - z * (1.0 / 120.0 - z * (1.0 / 5040.0));
    let q4 = 1.0 / 24.0 - z * (1.0 / 720.0);
    let half = 0.5 * pull;
    (
        velocity - x * (half - cosine * x * q3 + sine * z * q4),
        cosine * x * (1.0 / 3.0 - z * (1.0 / 30.0))
            - half
            - sine * z * (1.0 / 8.0 - z * (1.0 / 144.0)),
    )
}

/// What the cubic near launch says of the first impact.
enum Start {
    /// Nothing.
    Open,
    /// The first impact is `near` this flight time, as far as the cubic holds; whether the flight clears
    /// the coming hump but for rounding.
    Hop { near: f32, grazes: bool },
    /// The flight clears the coming hump; whether by rounding alone.
    Clears { grazes: bool },
}

#[inline(always)]
fn start<F: Flight>(launch: &Launch) -> Start {
    let (limit, rounding) = (F::SHORT, F::PULL);
    if launch.sine > 0.96 && near_top::<F>(launch) {
        return flat_start(*launch, limit, rounding);
    }
    // u/d = psi - a1 d + a2 d^2 - ...
    let a1 = 0.5 * launch.pull;
    let a2 = launch.cosine * (1.0 / 6.0);
    if a1 <= 0.0 && a2 >= 0.0 {
        return Start::Open;
    }
    let discriminant = a1 * a1 - 4.0 * a2 * launch.velocity;
    if a1 > 0.0 {
        if a2 > 0.0 && discriminant < 0.2 * a1 * a1 {
            return double_start(*launch, a1, a2, rounding);
        }
        simple_hop(2.0 * launch.velocity / (a1 + root(discriminant)))
    } else if discriminant >= 0.0 {
        simple_hop((a1 - root(discriminant)) / (2.0 * a2))
    } else {
        Start::Open
    }
}

/// The first root below `limit` of `u/d` where its cubic term decides.
#[inline(never)]
fn flat_start(launch: Launch, limit: f32, rounding: f32) -> Start {
    let a1 = 0.5 * launch.pull;
    let a2 = launch.cosine * (1.0 / 6.0);
    let a3 = launch.sine * (1.0 / 24.0);
    let square = a2 * a2 - 3.0 * a1 * a3;
    let valley = if a2 > 0.0 && square > 0.0 {
        a1 / (a2 + root(square))
    } else {
        (a2 - root(square)) / (3.0 * a3)
    };
    // Newton's steps do not overshoot from launch down a convex slope into the valley (or to the
    // inflection where there is none), nor from the right of the last root.
    let least = if valley > 0.0 {
        deflated(&launch, smaller(valley, limit)).0
    } else {
        1.0
    };
    let grazes = abs(least) < rounding * valley + 4e-7 * launch.velocity;
    let mut x = if least <= 0.0 {
        0.0
    } else if deflated(&launch, limit).0 <= 0.0 {
        limit
    } else if launch.pull > 0.0 && launch.cosine > 0.0 {
        return Start::Clears { grazes };
    } else {
        return Start::Open;
    };
    for _ in 0..40 {
        let (w, w1) = deflated(&launch, x);
        if w1 >= 0.0 {
            break;
        }
        let next = x - w / w1;
        if !(next > 0.0 && next < limit) {
            break;
        }
        let moved = abs(next - x);
        x = next;
        if moved < 1e-3 * x {
            break;
        }
    }
    Start::Hop { near: x, grazes }
}

#[inline(always)]
fn simple_hop(near: f32) -> Start {
    Start::Hop {
        near,
        grazes: false,
    }
}

/// Two nearly equal short roots: find the minimum of `u/d` between them.
#[inline(never)]
fn double_start(launch: Launch, a1: f32, a2: f32, rounding: f32) -> Start {
    let mut x = a1 / (2.0 * a2);
    // Beyond, heights keep enough digits.
    if x > 0.08 {
        return Start::Open;
    }
    let (mut minimum, mut b2) = (0.0, 1.0);
    for _ in 0..4 {
        let (w, w1) = deflated(&launch, x);
        b2 = a2 - launch.sine * (1.0 / 8.0) * x - launch.cosine * (1.0 / 20.0) * x * x;
        let e = -w1 / (2.0 * b2);
        minimum = w + 0.5 * w1 * e;
        x += e;
    }
    let grazes = abs(minimum) < rounding * x + 4e-7 * launch.velocity;
    if minimum > 0.0 {
        Start::Clears { grazes }
    } else {
        let near = x - root(-minimum / b2);
        Start::Hop { near, grazes }
    }
}

/// A short hop from its start `x`: third-order steps on `u/d`.
#[inline(always)]
fn hop(launch: &Launch, mut x: f32) -> (f32, f32) {
    let mut round = 0;
    loop {
        let (w, w1) = deflated(launch, x);
        let b2 = launch.cosine * (1.0 / 6.0) - launch.sine * (1.0 / 8.0) * x;
        let e = if w1 < 0.0 && abs(w * b2) < 1e-2 * w1 * w1 {
            let inverse = 1.0 / w1;
            let newton = w * inverse;
            -newton * (1.0 + b2 * newton * inverse)
        } else {
            down_crossing(w, w1, b2).0
        };
        round += 1;
        if abs(e) <= 4e-3 * x || round >= 6 {
            // At the root u' = d w'; w'' = 2 b2 carries w' over the last step.
            let flight = x + e;
            return (flight, larger(-flight * (w1 + 2.0 * b2 * e), 0.0));
        }
        x += e;
    }
}

/// The bracket and start that the segment search hands to the solver.
#[derive(Clone, Copy)]
struct Bracket {
    low: f32,
    high: f32,
    start: f32,
}

/// The first impact of any flight that is not at rest, and whether it grazes a hump.
#[inline(always)]
pub(crate) fn search<F: Flight>(shape: &Shape, launch: &Launch, flight: &F) -> (Found, bool) {
    let first = start::<F>(launch);
    let (mut guess, mut clears, mut skims) = (0.0, false, false);
    match first {
        Start::Hop { near, grazes } if near > 0.0 => {
            if near < F::SHORT {
                let (flight, arrival) = hop(launch, near);
                return (Found::Short { flight, arrival }, grazes);
            }
            guess = near;
        }
        Start::Clears { grazes } => (clears, skims) = (true, grazes),
        _ => {}
    }
    let (bracket, grazes) = segment(shape, launch, flight, clears, guess);
    (solve(shape, launch, flight, &bracket), grazes || skims)
}

#[inline(always)]
fn segment<F: Flight>(
    shape: &Shape,
    launch: &Launch,
    flight: &F,
    clears: bool,
    guess: f32,
) -> (Bracket, bool) {
    let Shape {
        k,
        half_k,
        inverse,
        flank,
        hump_length,
        ..
    } = *shape;
    let Launch { sine, pull, .. } = *launch;
    let v = launch.velocity + launch.cosine;
    if shape.hump == 0 {
        // Concave throughout: one root, before the parabola leaves height -1.
        let high = (v + root(v * v + 2.0 * k * (1.0 + sine))) * inverse;
        let start = if guess > 0.0 && guess < high {
            guess
        } else {
            high
        };
        let bracket = Bracket {
            low: 0.0,
            high,
            start,
        };
        return (bracket, false);
    }
    // Ballistic height over k, and slope over that of the track at a hump's entry.
    let over_k = |x: f32| x * (v - half_k * x) - pull;
    let over_flank = |x: f32| v - k * x - flank;
    // From the very entry of a hump the next one is a whole turn away.
    let (to_entry, entry) = match shape.entry.wrapping_sub(launch.phase) {
        0 => (WHOLE, TURN),
        steps => (i64::from(steps), steps as f32 * STEP),
    };
    // f32 keeps the height over k to 1e-5 here; nearer to 0 the kernel's own precision decides.
    let mut at_entry = over_k(entry);
    if abs(at_entry) < 3e-5 {
        at_entry = flight.above_k(to_entry, at_entry);
    }
    if at_entry <= 0.0 && !clears {
        let low = if shape.throws(launch.phase) {
            entry - (TURN - hump_length)
        } else {
            0.0
        };
        let start = if guess > 0.0 && guess < entry && guess < 1.2 {
            guess
        } else {
            let newton = entry - at_entry / over_flank(entry);
            if guess > 0.0 && guess < newton {
                0.5 * (guess + newton)
            } else {
                newton
            }
        };
        let bracket = Bracket {
            low,
            high: entry,
            start,
        };
        return (bracket, false);
    }
    // Time when the ball falls through height k.
    let through = (v + root(v * v - 2.0 * k * pull)) * inverse;
    // Whether the ball has fallen through height k, by f32 unless that is near.
    let falls = |time: f32, steps: i64| {
        if abs(time - through) < 1e-4 {
            flight.above_k(steps, over_k(time)) <= 0.0
        } else {
            time > through
        }
    };
    let mut grazes = false;
    let (mut begin, mut begin_steps) = if clears {
        (entry + TURN, to_entry + WHOLE)
    } else {
        (entry, to_entry)
    };
    // A hump that ends below height 1 holds the root; so at most the humps at either end of the window
    // above height 1 are looked at, and the rounds are bounded by their count with room for rounding.
    for _ in 0..16 {
        // Newton's step from the entry does not overshoot, on the convex side nor on the concave one.
        let from_entry = || {
            let slope = over_flank(begin);
            let step = if slope < 0.0 {
                over_k(begin) / slope
            } else {
                0.0
            };
            begin - step
        };
        if falls(begin, begin_steps) {
            let bracket = Bracket {
                low: smaller(through, begin) - 1e-4,
                high: begin,
                start: from_entry(),
            };
            return (bracket, grazes);
        }
        let end = begin + hump_length;
        if falls(end, begin_steps + i64::from(shape.hump)) {
            let bracket = Bracket {
                low: begin,
                high: through + 1e-4,
                start: from_entry(),
            };
            return (bracket, grazes);
        }
        {
            let middle = begin + 0.5 * hump_length;
            let over_top = (sine - 1.0) + middle * (v - half_k * middle);
            let slope = v - k * middle;
            if over_top <= -1e-4 {
                let bracket = Bracket {
                    low: begin,
                    high: middle,
                    start: from_entry(),
                };
                return (bracket, grazes);
            }
            // 1 - cos x >= 4 x^2 / pi^2 within the hump keeps the track below a parabola of its own.
            let spare = (4.0 / (PI * PI)) as f32 - half_k;
            let safe =
                spare > 0.0 && over_top > 1e-4 && 4.0 * spare * (over_top - 1e-4) > slope * slope;
            let half = 0.5 * hump_length;
            if !safe && slope + k * half < flank && slope - k * half > -flank {
                let (poke, touches) = lowest(shape, *launch, flight, middle, slope);
                grazes |= touches;
                if let Some(mut bracket) = poke {
                    bracket.low = begin;
                    bracket.start = smaller(larger(bracket.start, begin), bracket.high);
                    return (bracket, grazes);
                }
            }
        }
        let mut turns = 1;
        if begin + hump_length < through - 3.0 * TURN {
            turns += skip(shape, *launch, begin + TURN);
        }
        begin += turns as f32 * TURN;
        begin_steps += i64::from(turns) << 32;
    }
    let bracket = Bracket {
        low: entry,
        high: through,
        start: through,
    };
    (bracket, true)
}

/// Humps between the one that begins at `begin` and the last after it that lies under a ball above
/// height 1 with all between them.
#[inline(never)]
fn skip(shape: &Shape, launch: Launch, begin: f32) -> i32 {
    let v = launch.velocity + launch.cosine;
    let leaving = v * v - 2.0 * shape.k * (1.0 - launch.sine);
    let speed = root(leaving);
    let (rises, sinks) = ((v - speed) * shape.inverse, (v + speed) * shape.inverse);
    let last = begin + shape.hump_length;
    if leaving > 0.0 && v > 0.0 && begin > rises && last < sinks {
        ((sinks - last) * (1.0 / TURN)) as i32
    } else {
        0
    }
}

/// The lowest point over a hump around `middle`: a bracket that ends there if it is below the track,
/// and whether that is within rounding.
#[inline(never)]
fn lowest<F: Flight>(
    shape: &Shape,
    launch: Launch,
    flight: &F,
    middle: f32,
    slope: f32,
) -> (Option<Bracket>, bool) {
    let half = 0.5 * shape.hump_length;
    let k = shape.k;
    let (mut low, mut high) = (-half, half);
    let mut d = smaller(larger(-slope / (1.0 - k), low), high);
    for _ in 0..40 {
        // sin and cos of d: the track is cos(d) around the middle of its hump.
        let (s, c) = sine_cosine_single(Phase::from_bits((d * PER_STEP) as i32 as u32));
        let rate = slope - k * d + s;
        if rate > 0.0 {
            high = d;
        } else {
            low = d;
        }
        let newton = d - rate / (c - k);
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        let moved = abs(next - d);
        d = next;
        if moved < 1e-6 {
            break;
        }
    }
    let time = middle + d;
    let (node, offset) = node_of(launch.phase, time);
    let local = flight.local(node);
    let (height, gain, b2) = expand(k, &local, offset);
    let rate = local.slope + gain;
    let curvature = b2 + b2;
    let lowest = height - 0.5 * rate * rate / curvature;
    let bracket = (lowest <= 0.0).then(|| Bracket {
        low: 0.0,
        high: time,
        start: time - root(-2.0 * lowest / curvature),
    });
    (bracket, abs(lowest) < F::ROUNDING + F::DRIFT * time)
}

/// The root in `bracket`, nearly. The bracket holds one down-crossing, so that any step that converges
/// within it has found it: Householder's where the root is simple and near, else the safeguarded
/// search.
#[inline(always)]
fn solve<F: Flight>(shape: &Shape, launch: &Launch, flight: &F, bracket: &Bracket) -> Found {
    let v = launch.velocity + launch.cosine;
    let (mut node, offset) = node_of(launch.phase, bracket.start);
    let mut time = bracket.start - offset;
    for _ in 0..3 {
        let (sine, cosine) = sine_cosine_at(node);
        let u0 = (launch.sine - sine) + time * (v - shape.half_k * time);
        let u1 = v - shape.k * time - cosine;
        let b2 = 0.5 * (sine - shape.k);
        let square = u1 * u1;
        let product = b2 * u0;
        if !(u1 < -0.01 && abs(product) < 0.15 * square) {
            break;
        }
        let step = householder(u0, u1, square, product, cosine);
        let next = time + step;
        if !(next >= bracket.low - 1e-4 && next <= bracket.high + 1e-4) {
            break;
        }
        let (jump, count) = nearest(step * PER_RADIAN);
        node = node.wrapping_add(jump);
        if abs(step) < 0.15 {
            return Found::Near {
                node,
                offset: step - count * SPACING,
                simple: true,
            };
        }
        time += count * SPACING;
    }
    let (node, offset) = solve_safely(shape, *launch, flight, *bracket);
    Found::Near {
        node,
        offset,
        simple: false,
    }
}

/// Householder's third-order step on `u0 + u1 d + b2 d^2 + cos d^3 / 6`, from the square of `u1` and the
/// product `b2 u0`.
#[inline(always)]
fn householder(u0: f32, u1: f32, square: f32, product: f32, cosine: f32) -> f32 {
    -u0 * (square - product) / (u1 * (square - 2.0 * product) + cosine * (1.0 / 6.0) * u0 * u0)
}

/// The root in `bracket`, nearly, by Cauchy's step on nodes to the full precision of the kernel, with
/// bisection where there is no root near or the step leaves the bracket.
#[inline(never)]
fn solve_safely<F: Flight>(
    shape: &Shape,
    launch: Launch,
    flight: &F,
    bracket: Bracket,
) -> (i32, f32) {
    let Bracket {
        mut low,
        mut high,
        start: mut x,
    } = bracket;
    let mut round = 0;
    loop {
        let (node, offset) = node_of(launch.phase, x);
        let time = x - offset;
        let local = flight.local(node);
        let Local { height, slope, .. } = local;
        let b2 = 0.5 * (local.sine - shape.k);
        let (mut step, square) = down_crossing(height, slope, b2);
        if square > 1e-3 {
            let cubic = step * step * step * local.cosine * (1.0 / 6.0) / square;
            if abs(cubic) < 0.5 * abs(step) {
                step += cubic;
            }
        }
        // The one down-crossing is after every height above 0; near launch, on a concave rise, even one
        // rounded below 0 is before it.
        let before = height > 0.0 || (b2 < 0.0 && slope > 0.0);
        if time > low && time < high {
            if before {
                low = time;
            } else {
                high = time;
            }
        }
        let mut next = time + step;
        let found = square > 0.0 && next >= low - 1e-4 && next <= high + 1e-4;
        if !found {
            next = 0.5 * (low + high);
            step = next - time;
        }
        let moved = abs(next - x);
        x = next;
        round += 1;
        let near = (abs(step) < 0.1 * square && abs(step) < 0.15) || moved < 2e-3;
        if found && near || high - low < 1e-4 || round >= 32 {
            let (jump, count) = nearest(step * PER_RADIAN);
            return (node.wrapping_add(jump), step - count * SPACING);
        }
    }
}
