//! The impact map in integers alone, by steps that cannot pass an impact.
//!
//! The third derivative of the height above the track is at most 1. So from each place the height
//! is at least its Taylor polynomial of the second degree minus `h^3/6`. Each step leads to the
//! first zero of that bound. Near a simple impact the steps converge like Newton's.

use crate::arithmetic::fixed::Fixed;
use crate::arithmetic::trigonometry::{RADIANS_PER_TURN_FINE, sine_cosine_exact};
use crate::arithmetic::{Phase, Velocity};
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::kernel::{
    Impact, Kernel, Landing, MAX_VELOCITY, PartState, accept_phase, accept_velocity,
};
use crate::impact::set_up::SetUp;

/// Steps after which the current place counts as the impact; measured: at most 22.
const MAX_STEPS: u32 = 100;

/// Flight time of the series near launch: 1/1024 turn, with an error of 2e-14 of the quotient.
const MAX_SERIES_TIME: Turns = Fixed(1 << 38);

/// Flight time of a step below which it is the last: a sixteenth of a step of the phase.
const MIN_STEP: Turns = Fixed(1 << 12);

/// Gap in b over a hump that a launch's rounding may close: 4e-9, a quarter of a velocity step.
const GRAZING_GAP: Fixed<60, i64> = Fixed(1 << 32);

/// Longest step in rad.
const STRIDE: Fixed<60, i64> = Fixed(1 << 60);

const TURNS_PER_RADIAN: Fixed<60, i64> =
    Fixed::<60, i64>::from_constant(1.0 / core::f64::consts::TAU);

/// A time in turns: up to 2^11 of them, in 6.5e-14 of a step of the phase.
type Turns = Fixed<48, i64>;

/// A state of [`Integer`]: 8 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct IntegerState {
    /// Phase of the drive (symbol t), steps of 2^-32 turns.
    pub phase: Phase,
    /// Velocity relative to the track (symbol psi), steps of 2^-26 `b w`.
    pub velocity: Velocity,
}

const TOP_VELOCITY: Velocity = Velocity::from_bits(Fixed::<26, u32>::from_constant(MAX_VELOCITY).0);

/// The impact map in integers (`integer`), the map in fixed point.
///
/// It is the slowest map and the simplest: no table of branches, no f32, one way to every impact.
/// Its errors are measured against the f64 map from the same 80 000 states, k 0.02..0.98. The phase
/// is right to half its step (7.4e-10 rad), the velocity to two of its steps (3e-8). The first
/// impact is the right one down to a gap of 1e-8 over a hump; gaps below 4e-9 are flagged.
///
/// Range as [`Single`](crate::impact::Single).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integer {
    k: Fixed<60, i64>,
    /// k pi.
    half_turn_fall: Fixed<58, i64>,
    lift_off: Phase,
    hump: u32,
    /// 1 as 1 - 2^-32.
    restitution: Fixed<32, u32>,
}

impl Integer {
    /// One flight and the impact that ends it. A resting part stays: flight 0.
    pub fn land(&self, state: IntegerState) -> Landing<IntegerState> {
        let bits = state.velocity.bits().min(TOP_VELOCITY.bits());
        let state = IntegerState {
            velocity: Velocity::from_bits(bits),
            ..state
        };
        let throws = (state.phase - self.lift_off).bits() < self.hump;
        if state.velocity == Velocity::ZERO && !throws {
            return Landing::at_rest(state);
        }
        let flight = Flight::new(self, state);
        let [rise, fall] = flight.above_track();
        let mut time = Fixed(0);
        if throws && flight.cosine > Fixed(0) {
            // The height is at least `cos t h^3/6 - h^4/24` here, for any rounding of the pull.
            time = flight.cosine.times(TURNS_PER_RADIAN);
        }
        let (mut grazes, mut skims, mut round) = (false, false, 0);
        let place = loop {
            if time > rise && time < fall {
                time = fall;
            }
            let place = flight.at(time);
            grazes |= skims && place.slope > Fixed(0);
            skims = place.almost_touches();
            if time > Fixed(0) && place.height <= Fixed(0) {
                break place;
            }
            let step: Turns = place.clear_time().times(TURNS_PER_RADIAN);
            time = time + step;
            round += 1;
            if step < MIN_STEP || round == MAX_STEPS {
                break place;
            }
        };
        let steps = (time + Fixed(1 << 15)).to::<32>().0;
        let speed = place.fall.max(Fixed(0)).to::<26>().0 as u64;
        let velocity = (speed * u64::from(self.restitution.0) + (1 << 31)) >> 32;
        Landing {
            steps,
            next: IntegerState {
                phase: state.phase + Phase::from_bits(steps as u32),
                velocity: Velocity::from_bits(velocity as u32),
            },
            grazes: grazes || skims,
        }
    }
}

struct Flight<'a> {
    map: &'a Integer,
    phase: Turns,
    sine: Fixed<60, i64>,
    cosine: Fixed<60, i64>,
    velocity: Fixed<56, i64>,
    /// Launch velocity in the frame of the feeder.
    rise: Fixed<56, i64>,
}

impl<'a> Flight<'a> {
    fn new(map: &'a Integer, state: IntegerState) -> Self {
        let phase = Fixed::<32, i64>(state.phase.bits().into()).to();
        let [sine, cosine] = sine_cosine_exact(phase);
        let velocity = Fixed::<26, i64>(state.velocity.bits().into()).to();
        Self {
            map,
            phase,
            sine,
            cosine,
            velocity,
            rise: velocity + cosine.to(),
        }
    }

    /// Times between which the part is above the highest place of the track.
    fn above_track(&self) -> [Turns; 2] {
        let rise = i128::from(self.rise.0);
        let margin = Fixed::<60, i64>(1 << 60) - self.sine;
        // Squared speed there, in steps of 2^-112.
        let square = rise * rise - ((i128::from(self.map.k.0) * i128::from(margin.0)) >> 7);
        if rise <= 0 || square <= 0 {
            return [Fixed(i64::MAX); 2];
        }
        let root = square.unsigned_abs().isqrt() as i128;
        let [up, down] = [rise - root, rise + root]
            .map(|speed| ((speed << 49) / i128::from(self.map.half_turn_fall.0)) as i64);
        // A step of the phase is more than the rounding.
        [Fixed(up + (1 << 16)), Fixed(down - (1 << 16))]
    }

    fn at(&self, time: Turns) -> Place {
        if time < MAX_SERIES_TIME && self.velocity < Fixed(1 << 56) {
            return self.near_launch(time.times(RADIANS_PER_TURN_FINE));
        }
        let [sine, cosine] = sine_cosine_exact(self.phase + time);
        let fall = self.map.half_turn_fall.times(time);
        let mean = self.rise - fall;
        let distance: Fixed<60, i64> = mean.times(time);
        let slope = mean - fall - cosine.to();
        Place {
            height: distance.times::<60, 60>(RADIANS_PER_TURN_FINE) + self.sine - sine,
            slope,
            quadratic: (sine - self.map.k).scaled::<61>().to(),
            fall: -slope,
        }
    }

    /// The height divided by the time `d` in rad, which keeps its digits down to `d = 0`. It is
    /// `psi + d ((S - k)/2 - S d^2/24) + C d^2/6 (1 - d^2/20)`, with a third derivative of at most
    /// 1/4.
    fn near_launch(&self, d: Fixed<60, i64>) -> Place {
        let product = |a: Fixed<60, i64>, b| -> Fixed<60, i64> { a.times(b) };
        let over = |x: Fixed<60, i64>, n: i64| Fixed(x.0 / n);
        let square = product(d, d);
        let factor = |n: i64| product(self.cosine, Fixed::<60, i64>(1 << 60) - over(square, n));
        let push = product(self.sine, square);
        let half_push = (self.sine - self.map.k).scaled::<61>().to::<60>();
        let height = self.velocity.to::<60>()
            + product(d, half_push - over(push, 24))
            + over(product(square, factor(20)), 6);
        let slope = half_push - over(push, 8) + over(product(d, factor(10)), 3);
        let quadratic = over(factor(3), 6) - over(product(self.sine, d), 8);
        Place {
            height,
            slope: slope.to(),
            quadratic: quadratic.to(),
            fall: -(height + product(d, slope)).to(),
        }
    }
}

/// Height above the track or that divided by the time, its slope, and half its second derivative.
struct Place {
    height: Fixed<60, i64>,
    slope: Fixed<56, i64>,
    quadratic: Fixed<58, i64>,
    /// Speed towards the track, where the height is 0.
    fall: Fixed<56, i64>,
}

impl Place {
    /// `slope^2 - 4 quadratic height` in steps of 2^-112.
    fn discriminant(&self, quadratic: Fixed<58, i64>) -> i128 {
        let slope = i128::from(self.slope.0);
        slope * slope - ((i128::from(quadratic.0) * i128::from(self.height.0)) >> 4)
    }

    /// Time in rad, at most [`STRIDE`], for which the height surely stays above 0. Within a stride
    /// the bound is above a parabola. The stride is shortened until it is near the parabola's zero.
    fn clear_time(&self) -> Fixed<60, i64> {
        let (height, slope) = (i128::from(self.height.0), i128::from(self.slope.0));
        let (mut stride, mut clear) = (STRIDE.0, 0);
        while stride > 0 && clear <= stride / 4 {
            let quadratic = self.quadratic - Fixed(stride / 24);
            let square = self.discriminant(quadratic);
            let root = square.max(0).unsigned_abs().isqrt() as i128;
            let zero = if quadratic >= Fixed(0) && (slope >= 0 || square < 0) {
                i128::from(stride)
            } else if slope < 0 {
                (height << 57) / (root - slope)
            } else {
                ((slope + root) << 61) / -i128::from(quadratic.0)
            };
            clear = clear.max(zero.min(stride.into()) as i64);
            stride = (stride / 8).max(clear + clear / 4);
        }
        Fixed(clear)
    }

    /// Whether the height falls to a minimum within [`GRAZING_GAP`] of 0.
    fn almost_touches(&self) -> bool {
        let gap = (i128::from(self.quadratic.0) * i128::from(GRAZING_GAP.0)) >> 4;
        self.slope < Fixed(0) && self.discriminant(self.quadratic).abs() < gap
    }
}

impl Kernel for Integer {
    type State = IntegerState;

    const NAME: &'static str = "integer";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let set_up = SetUp::build(k)?;
        accept_in("restitution", restitution, 0.0..=1.0, "0..1")?;
        let k = Fixed::<60, i64>(set_up.k.nearest(60) as i64);
        Ok(Self {
            k,
            half_turn_fall: k.times(RADIANS_PER_TURN_FINE.scaled::<61>()),
            lift_off: set_up.lift_off,
            hump: set_up.hump,
            restitution: Fixed::<32, u32>::nearest(restitution),
        })
    }

    fn state(phase: f64, velocity: f64) -> Result<IntegerState, OutOfRange> {
        accept_phase(phase)?;
        accept_velocity(velocity)?;
        let (phase, velocity) = (Phase::from_radians(phase), Velocity::nearest(velocity));
        Ok(IntegerState { phase, velocity })
    }

    fn observe(state: IntegerState) -> PartState {
        PartState::new(state.phase.radians(), state.velocity.value())
    }

    fn impact(&self, state: IntegerState) -> Impact<IntegerState> {
        self.land(state).impact()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn restitutions_are_rounded_and_refusals_name_them() {
        for (restitution, steps) in [
            (0.0, 0),
            (-0.0, 0),
            (1e-300, 0),
            (0.5, 1 << 31),
            (1.0 - 1e-12, u32::MAX),
            (1.0, u32::MAX),
        ] {
            let map = Integer::build(0.5, restitution).unwrap();
            assert_eq!(map.restitution.0, steps);
        }
        for restitution in [-1e-300, 1.000_001, f64::NAN] {
            let refused = Integer::build(0.5, restitution).unwrap_err();
            assert_eq!(refused.parameter, "restitution");
        }
        for k in [0.004_999, 4.000_1, -0.5, f64::NAN, f64::INFINITY] {
            assert_eq!(Integer::build(k, 0.5).unwrap_err().parameter, "k");
        }
    }
}
