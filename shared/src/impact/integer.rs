//! The impact map in integers alone, for a CPU without an FPU (Cortex-M0+, M3).
//!
//! The same search as in the kernels with an FPU, on exact heights: the phase is an integer, so a
//! flight to a table node or to the end of a hump has an exact time, and its height follows from 64-bit
//! products. No 64-bit division, and 32-bit ones only by a reciprocal from a table.

use super::anchor::SetUp;
use super::{HybridState, Impact, Kernel, Landing, State};
use crate::arithmetic::fixed::{
    Reciprocal, high, high as product_high, square_root_scaled, wide, wide_signed,
};
use crate::arithmetic::trigonometry::Powers;
use crate::arithmetic::{Phase, Velocity, node, sine_cosine_integer};
use crate::feeder::{OutOfRange, accept};

/// The impact map in integers (`integer`).
///
/// Measured against the f64 map from the same 400 000 states, k 0.02..0.98:
///
/// | velocities | phase error: median | p99 | max (rad) | velocity: max |
/// |---|---|---|---|---|
/// | 0..20 | 1.6e-9 | 3.2e-8 | 1.2e-6 | 2.9e-7 |
/// | 0..3 | 2.3e-9 | 4.6e-8 | 3.3e-6 | 3.1e-7 |
/// | 3e-7..3, logarithmic | 1.2e-9 | 4.4e-7 | 2.1e-5 | 3.7e-7 |
/// | launches within 0.1 rad of lift-off | 1.4e-9 | 5.0e-8 | 3.5e-5 | 5.4e-7 |
///
/// No wrong impact among them. The first impact is the right one down to a gap of 1e-7 over a hump (times
/// the flight time, where that is above 1); nearer it is flagged. About 2100 instructions an impact on a
/// Cortex-M0, at most 3363 on any locked or chaotic orbit tried.
///
/// State and range as [`Hybrid`](super::Hybrid), but for the velocity: 0..=29. An impact may leave faster
/// (by at most 2.5, and only with a restitution above 0.93): its velocity is then right,
/// `Integer::state` refuses it, and a launch from it is held at 29.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integer {
    /// Phase where a hump begins, and its length.
    entry: u32,
    hump: u32,
    /// k, steps of 2^-28, and steps of 2^-30 modulo 4.
    k: i32,
    threshold: i32,
    /// Slope of the sine at the entry of a hump, steps of 2^-26.
    flank: i32,
    /// k pi, steps of 2^-48.
    half_turn_fall: u64,
    /// 1 / (2 pi k), steps of 2^-24.
    inverse: u32,
    /// The least square of the speed at height 0 of a high flight, steps of 2^-27.
    high: i32,
    /// Restitution, steps of 2^-32, 1 as 2^32 - 1.
    restitution: u32,
}

const TOP: f64 = 29.0;
const TOP_BITS: u32 = 29 << 26;
const ONE: i32 = 1 << 30;
/// An arrival at less than 1/64, steps of 2^-26, may be a graze within rounding.
const SLOW: i32 = 1 << 20;
/// A flight of 1/16 rad in steps of a phase: shorter ones have a form that keeps every digit.
const SHORT: i64 = 42_722_829;
/// Half a rad in steps of a phase.
const HALF: i64 = 8 * SHORT;
/// A height, steps of 2^-30, below which the lowest point over a hump is looked for, though its middle
/// is under the track: the flight may graze.
const BARELY: i32 = 1 << 17;
/// 2 pi, steps of 2^-28.
const TURN: i32 = 1_686_629_713;
/// 1 / (2 pi), steps of 2^-32: turns in a radian.
const TURNS: i32 = 683_565_276;
/// A turn in steps of a phase.
const WHOLE: i64 = 1 << 32;
/// The farthest that the expansion about a node is used: 1/40 rad in steps of 2^-34.
const REACH: i32 = ((1_i64 << 34) / 40) as i32;

/// Distance of two nodes, steps of 2^-34 rad.
const SPACING: i32 = (node::SPACING * 17_179_869_184.0) as i32;

/// Height and slope of the flight above the track at a node, with sine and cosine there.
#[derive(Clone, Copy, Debug)]
struct Local {
    /// Steps of 2^-30, saturating.
    height: i32,
    /// Steps of 2^-26.
    slope: i32,
    sine: i32,
    cosine: i32,
    /// `sin - k`, steps of 2^-28: the curvature.
    curvature: i32,
}

/// A flight.
struct Ballistic<'a> {
    kernel: &'a Integer,
    phase: u32,
    sine: i32,
    cosine: i32,
    velocity: u32,
    /// Launch velocity in the frame of the feeder, psi + cos t, steps of 2^-48.
    rise: i64,
}

/// The flight near launch: its height is `d (2 psi - d G) / 2` with
/// `G = pull - cos d / 3 + sin d^2 / 12`.
#[derive(Clone, Copy)]
struct Near {
    /// `k - sin` and sine of the phase of launch, cosine / 3: steps of 2^(down - 30).
    pull: i32,
    sine: i32,
    third: i32,
    cosine: i32,
    /// 2 psi, steps of 2^(down - 64), at most 1/4 (1 where `down` is 2), which no short hop reaches.
    twice: i64,
    down: u32,
}

impl Near {
    #[inline(always)]
    fn new(pull: i32, sine: i32, cosine: i32, velocity: u32, down: u32) -> Self {
        Self {
            pull,
            sine,
            // 1/3 in steps of 2^-32.
            third: high(cosine, 1_431_655_765),
            cosine,
            twice: i64::from(velocity.min(1 << (23 + down))) << (39 - down),
            down,
        }
    }

    /// `G` and the derivative of `d G` at `d`, below 1/16 in steps of 2^-34.
    #[inline(always)]
    fn mean_and_slope(&self, d: i32) -> (i32, i32) {
        let linear = high(self.third, d) >> 2;
        let quadratic = high(self.sine, high(d, d)) >> 4;
        (
            // 10923 / 2^17 is 1/12.
            self.pull - linear + (((quadratic >> 5) * 10_923) >> 12),
            self.pull - 2 * linear + (quadratic >> 2),
        )
    }

    /// Newton's step from `d` to where `d G` reaches 2 psi, for a slope above 0.
    #[inline(always)]
    fn newton(&self, d: i32, mean: i32, slope: i32) -> i32 {
        let reciprocal = Reciprocal::coarse(slope as u32);
        let rest = self.twice - wide_signed(d, mean);
        // So that the shortest hops from rest keep their digits.
        if rest == i64::from(rest as i32) {
            return reciprocal.times(rest as i32, 0);
        }
        // Steps of 2^-40; a saturated one still leads towards the root.
        let rest = (rest >> 24).clamp(-i64::from(i32::MAX), i64::from(i32::MAX)) as i32;
        reciprocal.times(rest, 24)
    }

    /// The hop where `d G` reaches 2 psi, by Newton's steps from near it, or from its left on a concave
    /// or its right on a convex `d G`.
    #[inline(always)]
    fn hop(&self, mut d: i32) -> Start {
        let mut round = 0;
        loop {
            let (mean, slope) = self.mean_and_slope(d);
            if slope <= 0 {
                return self.before_end();
            }
            let step = self.newton(d, mean, slope);
            d = d.saturating_add(step).max(0);
            if d >= ONE {
                return self.before_end();
            }
            round += 1;
            // Or the steps go around the root by the resolution of a small pull.
            if step.unsigned_abs() <= (d >> 12).unsigned_abs() || round == 24 {
                // u' = -d (d G)' / 2 at the root; half a step rounds.
                let slope = slope - 2 * (high(self.third, step) >> 2);
                let up = 7 - self.down;
                let arrival = (high(d, slope) + (1 << (up - 1))) >> up;
                // Rounding of the pull, some 2^-29, moves d G by what separates the root from the
                // greatest value of d G: slope^2 / (4 cos / 3).
                let grazes = self.down == 0
                    && slope.unsigned_abs() < 1 << 15
                    && slope * slope < high(self.cosine, d);
                return Start::Hop {
                    flight: d,
                    arrival,
                    grazes,
                };
            }
        }
    }

    /// The hop from the right end, 1/16 rad, if there is one before it.
    #[inline(never)]
    fn before_end(&self) -> Start {
        let mut d = ONE - 1;
        let (mean, _) = self.mean_and_slope(d);
        if self.twice >= wide_signed(d, mean) {
            // So near to the throw d G has its greatest value, at 3 pull / (2 cos), before the right end,
            // and 2 psi is above it.
            let clears = self.down == 0 && self.pull > 0 && self.pull < self.cosine >> 5;
            return if clears {
                Start::Clears {
                    grazes: self.skims(),
                }
            } else {
                Start::Open
            };
        }
        for _ in 0..60 {
            let (mean, slope) = self.mean_and_slope(d);
            if slope <= 0 {
                break;
            }
            let step = self.newton(d, mean, slope);
            d = (d + step).max(0);
            if step.unsigned_abs() <= (d >> 12).unsigned_abs() {
                break;
            }
        }
        let (_, slope) = self.mean_and_slope(d);
        let arrival = high(d, slope.max(0)) >> (7 - self.down);
        Start::Hop {
            flight: d,
            arrival,
            grazes: false,
        }
    }

    /// Whether 2 psi is above the greatest `d G` by rounding alone.
    #[inline(never)]
    fn skims(&self) -> bool {
        let reciprocal = Reciprocal::coarse(self.cosine as u32);
        let mut d = reciprocal.times(self.pull + self.pull / 2, 34).min(ONE - 1);
        for _ in 0..2 {
            let (_, slope) = self.mean_and_slope(d);
            // -(d G)'' = 2 cos / 3 - sin d / 2.
            let bend = (2 * self.third - (high(self.sine, d) >> 3)).max(1);
            let step = Reciprocal::coarse(bend as u32).times(slope, 34);
            d = d.saturating_add(step).clamp(0, ONE - 1);
        }
        let gap = self.twice - wide_signed(d, self.mean_and_slope(d).0);
        gap < i64::from(d) << 3
    }
}

/// Where steps on nodes start: a node `late` (steps of 2^-17 rad) after the part was at height `base` (steps
/// of 2^-30), going down at `speed` (steps of 2^-13).
struct Approach {
    node: i32,
    late: i32,
    speed: i32,
    base: i32,
}

/// An impact: steps of a phase after launch, arrival speed in steps of 2^-26, and whether it is a simple root.
struct Settled {
    steps: i64,
    speed: i32,
    converged: bool,
}

/// A bracket with one down-crossing, where to begin in it, all in steps of a phase.
struct Bracket {
    low: i64,
    high: i64,
    start: i64,
}

/// What the flight near launch says.
enum Start {
    /// A short hop: flight in steps of 2^-34 rad and arrival speed in steps of 2^-26; whether it
    /// clears the coming hump but for rounding.
    Hop {
        flight: i32,
        arrival: i32,
        grazes: bool,
    },
    /// The flight clears the coming hump; whether by rounding alone.
    Clears { grazes: bool },
    /// Nothing.
    Open,
}

impl Integer {
    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[must_use]
    pub fn land(&self, state: HybridState) -> Landing<HybridState> {
        let state = state.held_below(TOP_BITS);
        let (sine, cosine) = sine_cosine_integer(state.phase);
        let phase = state.phase.bits();
        let velocity = state.velocity.bits();
        let flight = Ballistic {
            kernel: self,
            phase,
            sine,
            cosine,
            velocity,
            rise: (i64::from(velocity) << 22) + (i64::from(cosine) << 18),
        };
        if let Some((node, offset)) = flight.fall() {
            let settled = flight.settle(node, flight.local(node), offset);
            // The steps may have led back to launch, where the part rises over the track.
            if settled.converged && settled.speed > 0 && settled.steps > 0 {
                return flight.landing(settled.steps, settled.speed as u32, false);
            }
        }
        let throws = phase.wrapping_sub(self.entry) < self.hump;
        if velocity == 0 && !throws {
            return Landing {
                steps: 0,
                next: state,
                grazes: false,
            };
        }
        self.low(&flight, throws)
    }

    #[inline(never)]
    fn low(&self, flight: &Ballistic<'_>, throws: bool) -> Landing<HybridState> {
        if let Some((node, offset)) = flight.candidate()
            && flight.steps_to(node) <= self.limit(flight.phase) + (1 << 23)
        {
            let settled = flight.settle(node, flight.local(node), offset);
            if settled.converged && settled.speed > SLOW && self.ends(flight.phase, settled.steps) {
                return flight.landing(settled.steps, settled.speed as u32, false);
            }
        }
        let (clears, skims) = match flight.start(throws) {
            Start::Hop {
                flight: d,
                arrival,
                grazes,
            } => {
                let steps = (high(d, TURNS) + 2) >> 2;
                return flight.landing(i64::from(steps), arrival.max(0) as u32, grazes);
            }
            Start::Clears { grazes } => (true, grazes),
            Start::Open => (false, false),
        };
        let (bracket, grazes) = flight.segment(throws, clears);
        let (node, local, offset) = flight.solve(bracket);
        let settled = flight.settle(node, local, offset);
        flight.arrival(&settled, grazes || skims)
    }

    /// Whether a down-crossing `steps` after launch at `phase` comes before the end of the next hump, and
    /// not so soon that it is settled with more digits as a short hop.
    #[inline(always)]
    fn ends(&self, phase: u32, steps: i64) -> bool {
        steps >= SHORT && steps <= self.limit(phase)
    }

    /// Steps from `phase` to the end of the next hump, and no fewer than 1 to its entry.
    #[inline(always)]
    fn limit(&self, phase: u32) -> i64 {
        let to_entry = self.entry.wrapping_sub(phase).wrapping_sub(1);
        i64::from(to_entry) + i64::from(self.hump)
    }
}

impl Ballistic<'_> {
    /// `mean` flight velocity, `v - k d / 2`, after `steps`, and what it fell short of the launch
    /// velocity; steps of 2^-48.
    #[inline(always)]
    fn mean(&self, steps: i64) -> (i64, i64) {
        let fall = product_32(steps, self.kernel.half_turn_fall as i64);
        (self.rise - fall, fall)
    }

    /// Ballistic rise in turns (steps of 2^-32 of rad / 2 pi, saturating) and velocity (steps of 2^-26)
    /// after `steps`.
    #[inline(never)]
    fn ballistic(&self, steps: i64) -> (i32, i64) {
        let (mean, fall) = self.mean(steps);
        let rise = product_32(steps, mean) >> 16;
        let turns = if rise > i64::from(i32::MAX) {
            i32::MAX
        } else if rise < i64::from(i32::MIN) {
            i32::MIN
        } else {
            rise as i32
        };
        (turns, mean - fall)
    }

    /// Height over `level` (steps of 2^-30) after `steps`, steps of 2^-30, saturating; and velocity.
    #[inline(always)]
    fn over(&self, steps: i64, level: i32) -> (i32, i32) {
        let (turns, velocity) = self.ballistic(steps);
        // Steps of 2^-28 do not overflow; those of 2^-30 do beyond a height of 2.
        let coarse = high(turns, TURN) + (self.sine >> 2) - (level >> 2);
        let height = if coarse >= 1 << 29 {
            i32::MAX
        } else if coarse < -(1 << 29) {
            -i32::MAX
        } else {
            let rise = (high(turns, TURN) << 2) | (turns.wrapping_mul(TURN) as u32 >> 30) as i32;
            rise.wrapping_add(self.sine).wrapping_sub(level)
        };
        (height, (velocity >> 22) as i32)
    }

    #[inline(always)]
    fn steps_to(&self, node: i32) -> i64 {
        (i64::from(node) << 24) - i64::from(self.phase)
    }

    #[inline(never)]
    fn local(&self, node: i32) -> Local {
        let [sine, cosine] = node::FIXED[(node & 255) as usize];
        let (height, velocity) = self.over(self.steps_to(node), sine);
        Local {
            height,
            slope: velocity - (cosine >> 4),
            sine,
            cosine,
            curvature: (sine >> 2) - self.kernel.k,
        }
    }

    /// The impact of a high flight, nearly; see the search of the kernels with an FPU.
    #[inline(always)]
    fn fall(&self) -> Option<(i32, i32)> {
        let crossing = self.crossing(self.kernel.high)?;
        self.approach(crossing)
    }

    /// Where the parabola crosses height 0 on its fall, if the square of the speed there is at least
    /// `high`, steps of 2^-27.
    #[inline(always)]
    fn crossing(&self, high_square: i32) -> Option<Approach> {
        let kernel = self.kernel;
        let rise = self.velocity as i32 + (self.cosine >> 4);
        if rise <= 0 {
            return None;
        }
        // The velocity in 15 bits, steps of 2^-scale, its square in 32 with room for 2 k.
        let mut scale = 14;
        while rise >> (26 - scale) > 0x7fff {
            scale -= 1;
        }
        let v = (rise >> (26 - scale)) as u32;
        let shift = 28 - 2 * scale;
        // 2 k sin, steps of 2^-27, and so the square of the speed at the top of the track and at height 0.
        let lift = high(kernel.k, self.sine) << 2;
        let needed = high_square.wrapping_sub(lift) as u32;
        if lift < high_square && (v * v) >> 1 < needed >> shift {
            return None;
        }
        let square = (v * v).wrapping_add(((lift >> shift) << 1) as u32);
        // Steps of 2^-26.
        let mut speed = square_root_scaled(square) >> (scale - 10);
        let mut turns = (wide(rise as u32 + speed, kernel.inverse) >> 32) as u32;
        if turns > 3 << 18 {
            // So long a flight shows the error of the root: one step of Heron's.
            let square = wide(rise as u32, rise as u32) as i64 + (i64::from(lift) << 25);
            let rest = (square - wide(speed, speed) as i64) >> 22;
            let gain = Reciprocal::coarse(speed).times(rest as i32, 21);
            speed = speed.saturating_add_signed(gain);
            turns = (wide(rise as u32 + speed, kernel.inverse) >> 32) as u32;
        }
        // Times in steps of 2^-18 turns; a node every 2^10.
        let time = (self.phase >> 14).wrapping_add(turns) as i32;
        let node = (time + (1 << 9)) >> 10;
        // How late the node is: steps of 2^-17 rad; 3217 / 2^10 is pi.
        let late = (((node << 10) - time) * 3217) >> 10;
        Some(Approach {
            node,
            late,
            speed: (speed >> 13) as i32,
            base: 0,
        })
    }

    /// Steps on nodes until they are short: a node and the distance from it in steps of 2^-34 rad.
    #[inline(never)]
    fn approach(&self, from: Approach) -> Option<(i32, i32)> {
        let Approach {
            mut node,
            mut late,
            speed,
            base,
        } = from;
        let k = self.kernel.k >> 16;
        for _ in 0..8 {
            let [sine, cosine] = node::FIXED[(node & 255) as usize];
            // Speed in steps of 2^-13, k of 2^-12, heights of 2^-16.
            let fall = (k.wrapping_mul(late) >> 16) + speed;
            // Below 8 in size.
            let fallen = ((speed + fall) >> 1).wrapping_mul(late >> 2) >> 12;
            let u0 = fallen + ((sine - base) >> 14);
            let u1 = fall + (cosine >> 17);
            if u1 < 1 << 8 {
                return None;
            }
            // Newton's step and the quadratic correction b2 u0 / u1^2, steps of 2^-16 and 2^-15.
            let reciprocal = Reciprocal::coarse(u1 as u32);
            let newton = reciprocal.times(u0, 13).clamp(-(1 << 16), 1 << 16);
            let ratio = reciprocal.times(newton, 13).clamp(-(1 << 17), 1 << 17);
            let twice = (((self.kernel.k >> 15) - (sine >> 17)) * (ratio >> 2)) >> 12;
            let bend = (twice >> 1).clamp(-(1 << 14), 1 << 14);
            let step = -(newton + ((newton * bend) >> 15));
            // Nodes are 1608.5 steps apart; 2608 / 2^22 is the inverse.
            let jump = (step * 2608 + (1 << 21)) >> 22;
            node += jump;
            if step.unsigned_abs() < 2600 {
                return Some((node, (step - ((jump * 3217) >> 1)) << 18));
            }
            late += jump * 3217;
        }
        None
    }

    /// Where the first impact of a low flight may be, nearly; see the search of the kernels with an FPU.
    #[inline(always)]
    fn candidate(&self) -> Option<(i32, i32)> {
        // Steps of 2^-15: half the pull, a sixth of the cosine, the velocity.
        let a1 = (self.kernel.k - (self.sine >> 2)) >> 14;
        let a2 = ((self.cosine >> 15) * 10_923) >> 16;
        if a1.unsigned_abs() < 1 << 15 && self.velocity < 3 << 25 {
            let psi = (self.velocity >> 11) as i32;
            // Steps of 2^-29.
            let square = (a1 * a1) >> 1;
            let discriminant = square - ((a2 * psi) << 1);
            let falls = a1 > 0 && discriminant > -(square >> 4);
            if falls || (a1 <= 0 && a2 < 0) {
                // Steps of 2^-15.
                let root = (square_root_scaled((discriminant.max(0) >> 1) as u32) >> 15) as i32;
                let (over, under) = if falls {
                    (psi << 1, a1 + root)
                } else {
                    (root - a1, -(a2 << 1))
                };
                if under <= 0 {
                    return None;
                }
                // Steps of 2^-17 rad.
                let near = Reciprocal::coarse(under as u32).times(over, 17);
                if near < 1 << 14 {
                    return None;
                }
                if near < 4 << 17 {
                    // Steps of 2^-18 turns: 2^-17 rad in 20861 / 2^16 of them.
                    let turns = ((near >> 3) * 20_861) >> 13;
                    let time = (self.phase >> 14) as i32 + turns;
                    let node = (time + (1 << 9)) >> 10;
                    let late = near + ((((node << 10) - time) * 3217) >> 10);
                    return self.approach(Approach {
                        node,
                        late,
                        speed: -((self.velocity as i32 + (self.cosine >> 4)) >> 13),
                        base: self.sine,
                    });
                }
            }
        }
        // A tenth, steps of 2^-27.
        let crossing = self.crossing(13_421_773)?;
        // A root more than half a rad before the crossing is none of a fall.
        let limit = self.kernel.limit(self.phase) + HALF;
        (self.steps_to(crossing.node) < limit)
            .then(|| self.approach(crossing))
            .flatten()
    }

    /// The flight near launch: short hops, below 1/16 rad, in a form that keeps every digit.
    #[inline(always)]
    fn start(&self, throws: bool) -> Start {
        let kernel = self.kernel;
        // Steps of 2^-28, or of 2^-30 where they have room.
        let wide_pull = kernel.k - (self.sine >> 2);
        let near = if wide_pull < 1 << 28 {
            let pull = kernel.threshold.wrapping_sub(self.sine);
            // At lift-off itself the pull must not be rounded against the phase, nor to 0.
            let pull = if throws { pull.min(-1) } else { pull.max(1) };
            Near::new(pull, self.sine, self.cosine, self.velocity, 0)
        } else {
            Near::new(
                wide_pull.max(1),
                self.sine >> 2,
                self.cosine >> 2,
                self.velocity,
                2,
            )
        };
        if throws {
            return near.before_end();
        }
        let reciprocal = Reciprocal::fine(near.pull as u32);
        // 2 psi / pull, steps of 2^-34.
        let ratio = wide(self.velocity, reciprocal.mantissa);
        let shift = (23 + near.down).checked_sub(reciprocal.shift);
        let Some(first) = shift
            .map(|shift| ratio >> shift)
            .filter(|&z| z < ONE as u64)
        else {
            return near.before_end();
        };
        let first = first as i32;
        // d = z (1 + e + 2 e^2) with z = 2 psi / pull, e = cos z / (3 pull).
        let bend = reciprocal.times(high(near.third, first), 28);
        if bend.abs() < ONE >> 4 {
            let square = high(bend, bend) << 2;
            near.hop(first + (high(first, bend + 2 * square) << 2))
        } else {
            near.hop(first)
        }
    }

    /// The bracket of the first impact, and whether the flight grazes.
    #[inline(never)]
    fn segment(&self, throws: bool, clears: bool) -> (Bracket, bool) {
        let kernel = self.kernel;
        if kernel.hump == 0 {
            return (self.concave(), false);
        }
        let to_entry = match kernel.entry.wrapping_sub(self.phase) {
            0 => WHOLE,
            steps => i64::from(steps),
        };
        let (over, velocity) = self.over(to_entry, kernel.threshold);
        if over <= 0 && !clears {
            let low = if throws {
                (to_entry - (WHOLE - i64::from(kernel.hump))).max(0)
            } else {
                0
            };
            let start = from_entry(to_entry, over, velocity - kernel.flank, low);
            let bracket = Bracket {
                low,
                high: to_entry,
                start,
            };
            return (bracket, false);
        }
        let mut begin = to_entry;
        let mut slope = velocity - kernel.flank;
        let mut height = over;
        if clears {
            begin += WHOLE;
            (height, slope) = self.entry(begin);
        }
        let mut grazes = false;
        for _ in 0..16 {
            if height <= 0 {
                let low = begin - (WHOLE - i64::from(kernel.hump));
                let start = from_entry(begin, height, slope, low);
                let bracket = Bracket {
                    low,
                    high: begin,
                    start,
                };
                return (bracket, grazes);
            }
            let end = begin + i64::from(kernel.hump);
            let (over_end, end_velocity) = self.over(end, kernel.threshold);
            let high_end = if over_end <= 0 {
                Some((end, end))
            } else {
                let middle = begin + i64::from(kernel.hump >> 1);
                let (over_top, top_velocity) = self.over(middle, ONE);
                if over_top <= -BARELY {
                    Some((middle, middle))
                } else if slope < 0
                    && end_velocity + kernel.flank > 0
                    && !self.is_safe(over_top, top_velocity)
                {
                    let (poke, touches) = self.lowest(begin, end);
                    grazes |= touches;
                    poke
                } else {
                    (over_top <= 0).then_some((middle, middle))
                }
            };
            if let Some((high_end, farthest)) = high_end {
                let start = from_entry(begin, height, slope, begin).min(farthest);
                let bracket = Bracket {
                    low: begin,
                    high: high_end,
                    start,
                };
                return (bracket, grazes);
            }
            begin = self.skip(begin) + WHOLE;
            (height, slope) = self.entry(begin);
        }
        let bracket = Bracket {
            low: to_entry,
            high: begin,
            start: begin,
        };
        (bracket, true)
    }

    /// Height over k and slope over the track at the entry of a hump.
    #[inline(always)]
    fn entry(&self, begin: i64) -> (i32, i32) {
        let (height, velocity) = self.over(begin, self.kernel.threshold);
        (height, velocity - self.kernel.flank)
    }

    /// The bracket where the track is concave throughout: up to where the parabola leaves height -1.
    #[inline(never)]
    fn concave(&self) -> Bracket {
        // v^2 + 2 k (1 + sin), steps of 2^-26; below 37 where the flight is not high.
        let rise = (self.rise >> 22) as i32;
        let v = rise >> 13;
        let drop = high(self.kernel.k, (self.sine >> 1) + (ONE >> 1)) << 2;
        let square = ((v * v) as u32).wrapping_add(drop as u32);
        let speed = square_root_scaled(square) >> 3;
        let turns = wide(speed.saturating_add_signed(rise), self.kernel.inverse) >> 32;
        let high = ((turns as i64) << 14) + (1 << 18);
        Bracket {
            low: 0,
            high,
            start: high,
        }
    }

    /// Whether `1 - cos x >= 4 x^2 / pi^2` within the hump keeps the track below the parabola, from the
    /// height over 1 and the velocity at the middle of the hump.
    #[inline(always)]
    fn is_safe(&self, over_top: i32, velocity: i32) -> bool {
        // 16 / pi^2, steps of 2^-28; below it k is below 1.
        const BOUND: i32 =
            (16.0 / (core::f64::consts::PI * core::f64::consts::PI) * 268_435_456.0) as i32;
        let spare = BOUND - 2 * self.kernel.k;
        // Both products in steps of 2^-26, rounded to the careful side.
        spare > 0
            && i64::from(high(spare, over_top)) - 1 > (wide_signed(velocity, velocity) >> 26) + 1
    }

    /// The last hump at or after the one at `begin` under a ball above height 1, with all between them.
    #[inline(never)]
    fn skip(&self, begin: i64) -> i64 {
        let (over, velocity) = self.over(begin, ONE);
        if over < ONE || velocity <= 0 {
            return begin;
        }
        // Rising above height 2: 2 velocity / k until it is there again.
        let rounds = (wide(velocity as u32, self.kernel.inverse) >> 49) as i64;
        begin + (rounds - 2).max(0) * WHOLE
    }

    /// The lowest point over the hump from `begin` to `end`: where it is, twice, if it is below the
    /// track, and whether that is within rounding.
    #[inline(never)]
    fn lowest(&self, begin: i64, end: i64) -> (Option<(i64, i64)>, bool) {
        let phase = i64::from(self.phase);
        let mut low = ((begin + phase) >> 24) as i32;
        let mut high_node = ((end + phase) >> 24) as i32 + 1;
        while high_node - low > 1 {
            let middle = (low + high_node) / 2;
            if self.local(middle).slope > 0 {
                high_node = middle;
            } else {
                low = middle;
            }
        }
        let (node, local) = (low, self.local(low));
        // Within the hump the slope rises, so that bisection finds its zero.
        let place = |steps: i64| {
            let steps = (steps - self.steps_to(node)).clamp(0, 1 << 24) as i32;
            high(steps, TURN) << 6
        };
        let (mut left, mut right) = (place(begin), place(end));
        for _ in 0..16 {
            let middle = (left + right) / 2;
            if local.slope + self.gain(&local, middle, &Powers::of(middle)) > 0 {
                right = middle;
            } else {
                left = middle;
            }
        }
        let d = (left + right) / 2;
        let powers = Powers::of(d);
        let height = self.height(&local, d, &powers);
        // The cosine at launch, rounded to 4e-9, moves the height by that times the flight.
        let drift = (self.steps_to(node) >> 27) as u32;
        let touches = height.unsigned_abs() < 11 + drift;
        let place = (self.steps_to(node) + i64::from(high(d, TURNS) >> 2)).clamp(begin, end);
        ((height <= 0).then_some((place, place)), touches)
    }

    /// Height at `d` (steps of 2^-34) from a node, steps of 2^-30, where it is small.
    #[inline(always)]
    fn height(&self, local: &Local, d: i32, powers: &Powers) -> i32 {
        // u1 d + (S - k) d^2/2 - S d^4/24 + C (d - sin d), with |d| < 2^29.
        let bent =
            (high(local.curvature, powers.versine) >> 2) - (high(self.kernel.k, powers.flat) >> 2);
        local
            .height
            .saturating_add(high(local.slope, d << 2))
            .saturating_add(bent + (high(local.cosine, powers.lag) >> 2))
    }

    /// Slope gained over `d` from a node, steps of 2^-26.
    #[inline(always)]
    fn gain(&self, local: &Local, d: i32, powers: &Powers) -> i32 {
        // (S - k) d - S (d - sin d) + C (1 - cos d).
        (high(local.curvature, d) + (high(local.cosine, powers.versine) >> 4)
            - (high(local.sine, powers.lag) >> 2))
            >> 4
    }

    /// The root in `bracket`: a node, the flight there, and the offset of the root from it, nearly.
    #[inline(never)]
    fn solve(&self, bracket: Bracket) -> (i32, Local, i32) {
        let Bracket {
            mut low,
            mut high,
            start: mut place,
        } = bracket;
        let mut round = 0;
        loop {
            let node = ((place + i64::from(self.phase) + (1 << 23)) >> 24) as i32;
            let time = self.steps_to(node);
            let local = self.local(node);
            // The bracket's middle if steps do not find the root in time: within the reach of the node.
            if round >= 60 {
                let offset = (place - time) as i32;
                return (node, local, product_high(offset, TURN) << 6);
            }
            let (step, crosses) = down_crossing(&local);
            let next = time + (i64::from(product_high(step, TURNS)) << 8);
            let inside = crosses && next >= low - (1 << 16) && next <= high + (1 << 16);
            if inside && step.abs() < REACH >> 10 {
                return (node, local, step << 10);
            }
            if time > low && time < high {
                // The one down-crossing is after every height above 0; near launch, on a concave rise,
                // even one rounded below 0 is before it.
                let before = local.height > 0 || (local.curvature < 0 && local.slope > 0);
                if before {
                    low = time;
                } else {
                    high = time;
                }
            }
            round += 1;
            place = if inside && round < 30 {
                next
            } else {
                (low + high) / 2
            };
        }
    }

    /// The impact at the root near `offset` from a node.
    #[inline(never)]
    fn settle(&self, mut node: i32, mut local: Local, offset: i32) -> Settled {
        let mut d = offset.clamp(-REACH, REACH);
        let mut round = 0;
        loop {
            let powers = Powers::of(d);
            let height = self.height(&local, d, &powers);
            let slope = local.slope + self.gain(&local, d, &powers);
            let curvature = local.curvature + (high(local.cosine, d) >> 4);
            round += 1;
            // 2 (S - k) u0 below u1^2 / 4, steps of 2^-28, with the slope at most 4.
            let bend = (curvature.unsigned_abs() >> 16) * (height.unsigned_abs() >> 14).min(0x7fff);
            let square = (slope.unsigned_abs() >> 12).min(0xffff);
            let simple = if slope < -SLOW {
                bend < (square * square) >> 3
            } else {
                let (square, bend) = squares(height, slope, curvature);
                slope < 0 && bend.abs() < square >> 2
            };
            let step = if simple {
                let reciprocal = Reciprocal::fine(slope.unsigned_abs());
                let newton = reciprocal.times(height, 30);
                // (S - k) e / (2 |u'|), steps of 2^-30.
                let bend = reciprocal.times(high(curvature, newton), 25);
                newton.saturating_add(high(newton, bend) << 2)
            } else {
                let nearly = Local {
                    height,
                    slope,
                    curvature,
                    ..local
                };
                down_crossing(&nearly).0.clamp(-REACH >> 10, REACH >> 10) << 10
            };
            // What is left of a simple root is about 2 (b2 e / slope)^2 e.
            let reach = match slope.unsigned_abs() >> 24 {
                0 => 1 << 22,
                1..4 => 1 << 23,
                4..16 => 1 << 24,
                _ => 3 << 24,
            };
            let converged = simple && step.unsigned_abs() < reach;
            let small = step.unsigned_abs() < 1 << 22;
            d = d.saturating_add(step);
            if d.unsigned_abs() > REACH as u32 && round < 10 {
                // From far along a long fall by several nodes at once.
                let jump = (high(d, TURNS) + (1 << 25)) >> 26;
                node += jump;
                local = self.local(node);
                d = (d - jump * SPACING).clamp(-REACH, REACH);
            } else if converged || small || round >= 10 {
                d = d.clamp(-REACH, REACH);
                let last = high(curvature + (high(local.cosine, step) >> 5), step) >> 4;
                return Settled {
                    steps: self.steps_to(node) + i64::from((high(d, TURNS) + 2) >> 2),
                    speed: -(slope + last),
                    converged,
                };
            }
        }
    }

    /// The state after a settled impact, which at a graze may have come out at launch or with a speed of 0.
    #[inline(always)]
    fn arrival(&self, settled: &Settled, grazes: bool) -> Landing<HybridState> {
        let steps = settled.steps.max(0);
        if settled.speed <= 0 {
            return self.landing(steps, 0, true);
        }
        self.landing(steps, settled.speed as u32, grazes)
    }

    /// The state after an impact at `speed`, steps of 2^-26.
    #[inline(always)]
    fn landing(&self, steps: i64, speed: u32, grazes: bool) -> Landing<HybridState> {
        let product = wide(speed, self.kernel.restitution) + (1 << 31);
        let velocity = (product >> 32) as u32;
        Landing {
            steps,
            next: HybridState {
                phase: Phase::from_bits(self.phase.wrapping_add(steps as u32)),
                velocity: Velocity::from_bits(velocity),
            },
            grazes,
        }
    }
}

/// Where Newton's step leads from the entry of a hump, steps of a phase, not before `low`.
#[inline(always)]
fn from_entry(entry: i64, height: i32, slope: i32, low: i64) -> i64 {
    if slope >= 0 {
        return entry;
    }
    let step = Reciprocal::coarse(slope.unsigned_abs()).times(height, 20);
    // Steps of 2^-24 rad.
    let step = step.clamp(-(3 << 24), 3 << 24);
    (entry + (i64::from(high(step, TURNS)) << 8)).max(low)
}

/// `u1^2` and `2 (S - k) u0`, whose difference is the discriminant of the local parabola; steps of 2^-52.
#[inline(always)]
fn squares(height: i32, slope: i32, curvature: i32) -> (i64, i64) {
    (
        wide_signed(slope, slope),
        wide_signed(curvature, height) >> 5,
    )
}

/// Root of what is positive of `square`, from steps of 2^-52 to 2^-26, to about 2^-15 of it.
#[inline(always)]
fn square_root(square: i64) -> u32 {
    if square <= 0 {
        0
    } else if square >> 32 == 0 {
        square_root_scaled(square as u32) >> 16
    } else if square >> 48 == 0 {
        square_root_scaled((square >> 16) as u32) >> 8
    } else {
        square_root_scaled((square >> 32) as u32)
    }
}

/// The step to the first down-crossing of the parabola at a node, steps of 2^-24 rad, at most 2.9 rad;
/// to its extremum where there is none, which the second value tells.
#[inline(always)]
fn down_crossing(local: &Local) -> (i32, bool) {
    let Local {
        height,
        slope,
        curvature,
        ..
    } = *local;
    let (square, bend) = squares(height, slope, curvature);
    let discriminant = square - bend;
    let step = if slope < 0 && bend.abs() < square >> 3 {
        // u0 / |u1| (1 + b2 u0 / u1^2).
        let reciprocal = Reciprocal::coarse(slope.unsigned_abs());
        let newton = reciprocal.times(height, 20);
        let bend = reciprocal.times(product_high(curvature, newton), 35);
        newton.saturating_add(product_high(newton, bend) << 2)
    } else {
        let root = square_root(discriminant) as i32;
        if slope > 0 || discriminant <= 0 {
            // -(u1 + r) / (S - k).
            if curvature == 0 {
                return (0, false);
            }
            let step =
                Reciprocal::coarse(curvature.unsigned_abs()).times(slope.saturating_add(root), 26);
            if curvature > 0 { -step } else { step }
        } else {
            // 2 u0 / (r - u1).
            let sum = root as u32 + slope.unsigned_abs();
            if sum == 0 {
                return (0, false);
            }
            Reciprocal::coarse(sum).times(height, 21)
        }
    };
    (
        step.clamp(-(29 << 24) / 10, (29 << 24) / 10),
        discriminant > 0,
    )
}

/// `a b / 2^32`, modulo 2^64, for an `a` below 2^48.
#[inline(always)]
fn product_32(a: i64, b: i64) -> i64 {
    let (a_low, a_high) = (a as u32, (a >> 32) as i32);
    let (b_low, b_high) = (b as u32, (b >> 32) as u32);
    let mut sum = ((wide(a_low, b_low) >> 32) + wide(a_low, b_high)) as i64;
    if (b_high as i32) < 0 {
        sum = sum.wrapping_sub(i64::from(a_low) << 32);
    }
    if a_high != 0 {
        // Signed: -1 is 2^32 - 1 less 2^32.
        let mut upper = (a_high as u32).wrapping_mul(b_high);
        if a_high < 0 {
            upper = upper.wrapping_sub(b_low);
        }
        sum = sum
            .wrapping_add(wide(a_high as u32, b_low) as i64)
            .wrapping_add(i64::from(upper) << 32);
    }
    sum
}

impl Kernel for Integer {
    type State = HybridState;

    const NAME: &'static str = "integer";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let set_up = SetUp::build(k, restitution)?;
        let pi = core::f64::consts::PI;
        Ok(Self {
            entry: set_up.entry.bits(),
            hump: set_up.hump,
            k: libm::round(k * 268_435_456.0) as i32,
            threshold: libm::round(k * 1_073_741_824.0) as u64 as i32,
            flank: libm::round(set_up.flank * 67_108_864.0) as i32,
            half_turn_fall: libm::round(k * pi * 281_474_976_710_656.0) as u64,
            inverse: libm::round(16_777_216.0 / (2.0 * pi * k)) as u32,
            high: libm::round(set_up.high() * 134_217_728.0) as i32,
            restitution: libm::round(restitution * 4_294_967_296.0) as u32,
        })
    }

    fn state(phase: f64, velocity: f64) -> Result<HybridState, OutOfRange> {
        accept("phase", phase, phase.is_finite(), "any finite angle in rad")?;
        Ok(HybridState {
            phase: Phase::from_radians(phase),
            velocity: Velocity::build(velocity, TOP, "0..29 (units of b w)")?,
        })
    }

    fn observe(state: HybridState) -> State {
        State {
            phase: state.phase.radians(),
            velocity: state.velocity.value(),
        }
    }

    #[inline]
    fn impact(&self, state: HybridState) -> Impact<HybridState> {
        let landing = self.land(state);
        Impact {
            flight: landing.flight(),
            next: landing.next,
            grazes: landing.grazes,
        }
    }
}
