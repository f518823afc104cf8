//! The impact map on a CPU with a single-precision FPU: integer state and residual, f32
//! corrections.

use super::approach::fall;
use super::candidate::{Candidate, candidate};
use super::flight::{Flight, Launch, Local, OverSine, STEPS_PER_RADIAN};
use super::search::search;
use super::settle::{Settled, settle, settle_carefully};
use super::sine_track::SineTrack;
use super::solve::Found;
use crate::arithmetic::fixed::Fixed;
use crate::arithmetic::node::{self, Fine};
use crate::arithmetic::positive::Positive;
use crate::arithmetic::trigonometry::{RADIANS_PER_TURN, sine_cosine_fine};
use crate::arithmetic::{Phase, Velocity};
use crate::feeder::OutOfRange;
use crate::impact::kernel::{
    HybridState, Impact, Kernel, Landing, MAX_VELOCITY, PartState, SingleImpact,
};
use crate::impact::set_up::SetUp;

/// The impact map for the Cortex-M4F, the default on the board (`hybrid`).
///
/// Phase and velocity are integers. The height at a table node is a 64-bit integer, exact but for
/// the last places. Only the correction from that node, below 0.0123 rad, is f32. Measured against
/// the f64 map from the same 400 000 states, k 0.02..0.98:
///
/// | velocities | phase error: median | p99 | max (rad) | velocity: max |
/// |---|---|---|---|---|
/// | 0..20 | 8.0e-10 | 4.1e-9 | 4.3e-7 | 7.2e-8 |
/// | 0..3 | 1.1e-9 | 1.7e-8 | 1.4e-6 | 9.5e-8 |
/// | 3e-7..3, logarithmic | 1.1e-9 | 1.4e-7 | 1.1e-5 | 2.4e-7 |
/// | launches within 0.1 rad of lift-off | 7e-10 | 2.1e-8 | 7.2e-6 | 7.1e-8 |
///
/// One step of the phase is 1.46e-9 rad. The first impact is the right one down to a gap of 1e-8
/// over a hump, at any flight time; nearer ones are flagged. An impact takes about 290 instructions
/// on a Cortex-M4F, at most 400 on any locked or chaotic orbit tried.
///
/// Range: k 0.005..=4, restitution 0..=1, velocity 0..=60. With a restitution above 0.96 an impact
/// may leave faster, by at most 2.5. Its velocity is then right. `Hybrid::state` refuses it,
/// [`Kernel::is_in_range`] returns false, and a launch from it is limited to 60.
///
/// ```
/// use kband::impact::{Hybrid, Kernel, Map};
///
/// let (board, desk) = (Hybrid::build(0.34, 0.2)?, Map::build(0.34, 0.2)?);
/// let start = Hybrid::state(0.7, 0.36)?;
/// let landing = board.land(start);
/// // The phase goes on by the flight time exactly, and both are right to a few steps of 1.5e-9 rad.
/// assert_eq!(landing.next.phase.bits(), start.phase.bits().wrapping_add(landing.steps as u32));
/// let impact = desk.impact(Hybrid::observe(start));
/// assert!((landing.flight() - impact.flight).abs() < 2e-8);
/// assert!((landing.next.velocity.value() - impact.next.velocity).abs() < 1e-7);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hybrid {
    track: SineTrack,
    /// The smaller of k and 1.
    threshold: Fixed<30>,
    /// Excess of k over 1, at least 0.
    excess: f32,
    /// k pi.
    half_turn_fall: Fixed<48, i64>,
    /// Restitution, 1 as 1 - 2^-32.
    restitution: Fixed<32, u32>,
}

/// Largest arrival velocity in `b w`. A launch at the top arrives at most 2 faster.
const MAX_ARRIVAL_VELOCITY: Fixed<26, u32> = Fixed::<26, u32>::from_constant(MAX_VELOCITY + 3.0);

impl Hybrid {
    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[inline(always)]
    pub fn land(&self, state: HybridState) -> Landing<HybridState> {
        let state = state.limited();
        let (sine, fine) = sine_cosine_fine(state.phase);
        let phase = state.phase.bits();
        let velocity = state.velocity.fixed();
        let flight = Ballistic {
            kernel: self,
            phase,
            sine,
            rise: Fixed::<26, i64>(i64::from(velocity.0)).to::<48>() + fine,
        };
        let mut launch = Launch {
            phase,
            velocity: velocity.single(),
            sine: sine.single(),
            cosine: fine.narrow::<30>().single(),
            pull: 0.0,
        };
        if let Some(approach) = fall::<Ballistic<'_>>(
            &self.track,
            phase,
            launch.sine,
            launch.velocity + launch.cosine,
        ) {
            let (node, offset) = approach.end;
            let (local, slope) = flight.exact(node);
            if let Some(settled) = settle::<Ballistic<'_>>(self.track.k, &local, offset) {
                let steps = flight.steps_at(node, &settled);
                return self.landing(phase, steps, speed(&settled, slope), false);
            }
        }
        let throws = self.track.throws(phase);
        if state.velocity == Velocity::ZERO && !throws {
            return Landing {
                steps: 0,
                next: state,
                grazes: false,
            };
        }
        // At lift-off itself rounding must not change the sign of the pull, nor make it 0.
        let pull = self.threshold.saturating_sub(sine);
        let pull = if throws {
            pull.min(-Fixed::<30>::STEP)
        } else {
            pull.max(Fixed::<30>::STEP)
        };
        launch.pull = pull.single() + self.excess;
        let Launch {
            velocity,
            cosine,
            pull,
            ..
        } = launch;
        self.land_low(phase, sine, flight.rise, velocity, cosine, pull)
    }

    /// A flight that is not tall. Its arguments stay in registers: a struct would be stored before
    /// it is needed.
    #[inline(never)]
    fn land_low(
        &self,
        phase: u32,
        sine: Fixed<30>,
        rise: Fixed<48, i64>,
        velocity: f32,
        cosine: f32,
        pull: f32,
    ) -> Landing<HybridState> {
        let flight = &Ballistic {
            kernel: self,
            phase,
            sine,
            rise,
        };
        let launch = &Launch {
            phase,
            velocity,
            sine: sine.single(),
            cosine,
            pull,
        };
        match candidate::<Ballistic<'_>>(&self.track, launch) {
            Candidate::Hop { flight, arrival } => {
                return self.land_short(launch, flight, arrival, false);
            }
            Candidate::Near { node, offset } => {
                let (local, slope) = flight.exact(node);
                if let Some(settled) = settle::<Ballistic<'_>>(self.track.k, &local, offset) {
                    let steps = flight.steps_at(node, &settled);
                    if self.track.ends::<Ballistic<'_>>(flight.phase, steps)
                        || self.track.clears(phase, velocity + cosine, pull, steps)
                    {
                        return self.landing(flight.phase, steps, speed(&settled, slope), false);
                    }
                }
            }
            Candidate::Final(_) | Candidate::Unknown => {}
        }
        self.land_by_search(&{ *flight }, &{ *launch })
    }

    /// The impact at the end of a short hop.
    #[inline(always)]
    fn land_short(
        &self,
        launch: &Launch,
        flight: f32,
        arrival: f32,
        grazes: bool,
    ) -> Landing<HybridState> {
        let steps = (flight * STEPS_PER_RADIAN) as u32;
        let speed = Fixed::<26, u32>::from_single(arrival);
        self.landing(launch.phase, i64::from(steps), speed, grazes)
    }

    /// The impact from the search, settled.
    #[inline(always)]
    fn land_by_search(&self, flight: &Ballistic<'_>, launch: &Launch) -> Landing<HybridState> {
        let (k, phase) = (self.track.k, flight.phase);
        let (found, grazes) = search(&self.track, launch, flight);
        match found {
            Found::Short {
                flight: time,
                arrival,
            } => self.land_short(launch, time, arrival, grazes),
            Found::Near {
                node,
                offset,
                simple,
            } => {
                let (local, slope) = flight.exact(node);
                let impact_at = |settled: Settled, grazes: bool| {
                    let speed = speed(&settled, slope);
                    let steps = flight.steps_at(node, &settled);
                    // Faster than any arrival: the speed was rounded below 0 at a graze.
                    if speed > MAX_ARRIVAL_VELOCITY {
                        return self.landing(phase, steps, Fixed(0), true);
                    }
                    self.landing(phase, steps, speed, grazes)
                };
                if simple && let Some(settled) = settle::<Ballistic<'_>>(k, &local, offset) {
                    return impact_at(settled, grazes);
                }
                let (settled, doubtful) = settle_carefully(k, local, offset);
                let grazes = grazes || doubtful;
                // At a graze the arrival speed may round below 0.
                if settled.speed_gain <= local.slope {
                    let steps = flight.steps_at(node, &settled);
                    return self.landing(phase, steps.max(0), Fixed(0), true);
                }
                impact_at(settled, grazes)
            }
        }
    }

    /// The state after an impact at `speed`.
    #[inline(always)]
    fn landing(
        &self,
        phase: u32,
        steps: i64,
        speed: Fixed<26, u32>,
        grazes: bool,
    ) -> Landing<HybridState> {
        let product = u64::from(speed.0) * u64::from(self.restitution.0) + (1 << 31);
        let velocity = Fixed((product >> 32) as u32);
        Landing {
            steps,
            next: HybridState {
                phase: Phase::from_bits(phase.wrapping_add(steps as u32)),
                velocity: Velocity::from_fixed(velocity),
            },
            grazes,
        }
    }
}

/// Arrival speed; negative ones wrap above [`MAX_ARRIVAL_VELOCITY`].
#[inline(always)]
fn speed(settled: &Settled, slope: Fixed<26, u32>) -> Fixed<26, u32> {
    let Fixed(gain) = Fixed::<26>::from_single(settled.speed_gain);
    Fixed::<26, u32>(gain as u32).wrapping_sub(slope)
}

/// A flight in integers.
#[derive(Clone, Copy)]
struct Ballistic<'a> {
    kernel: &'a Hybrid,
    phase: u32,
    /// Sine of the phase of launch.
    sine: Fixed<30>,
    /// Launch velocity in the frame of the feeder, psi + cos t.
    rise: Fixed<48, i64>,
}

impl Ballistic<'_> {
    #[inline(always)]
    fn steps_to(&self, node: i32) -> i64 {
        (i64::from(node) << 24) - i64::from(self.phase)
    }

    #[inline(always)]
    fn steps_at(&self, node: i32, settled: &Settled) -> i64 {
        self.steps_to(node) + i64::from((settled.offset * STEPS_PER_RADIAN) as i32)
    }

    /// Mean velocity `v - k d / 2` and velocity `v - k d` of the ball after `steps`.
    #[inline(always)]
    fn velocities(&self, steps: i64) -> (Fixed<48, i64>, Fixed<48, i64>) {
        let fall = product_32(steps, self.kernel.half_turn_fall);
        let mean = self.rise.wrapping_sub(fall);
        (mean, mean.wrapping_sub(fall))
    }

    /// The flight at a node near an impact, with its slope downwards modulo 2^6.
    #[inline(always)]
    fn exact(&self, node: i32) -> (Local, Fixed<26, u32>) {
        let steps = self.steps_to(node);
        let (mean, velocity) = self.velocities(steps);
        let rise = rise_after(steps, mean);
        let Fine {
            single,
            fixed,
            cosine,
        } = &node::FINE_NODES[(node & 255) as usize];
        let slope = velocity.wrapping_sub(*cosine);
        (
            Local {
                height: rise.wrapping_add(self.sine).wrapping_sub(fixed[0]).single(),
                slope: slope.narrow::<24>().single(),
                push: single[0],
                surge: single[1],
                bend: single[0],
            },
            Fixed(slope.narrow::<26>().0 as u32),
        )
    }
}

/// Rise of the ball `steps` after launch at this mean velocity, modulo 4; near an impact it is
/// within 2.
#[inline(always)]
fn rise_after(steps: i64, mean: Fixed<48, i64>) -> Fixed<30> {
    let turns = product_32(steps, mean).narrow::<32>();
    turns.product(RADIANS_PER_TURN)
}

/// `turns b`, with `turns` in steps of a phase, modulo 2^64 steps.
#[inline(always)]
fn product_32<const F: u32>(turns: i64, Fixed(b): Fixed<F, i64>) -> Fixed<F, i64> {
    let a = turns;
    let (a_low, a_high) = (a as u32, (a >> 32) as u32);
    let (b_low, b_high) = (b as u32, (b >> 32) as u32);
    let product = |a: u32, b: u32| u64::from(a) * u64::from(b);
    let sum = ((product(a_low, b_low) >> 32) + product(a_low, b_high))
        .wrapping_add(product(a_high, b_low));
    // The upper halves are signed.
    let signs = (b_low & (a >> 63) as u32).wrapping_add(a_low & (b >> 63) as u32);
    let high = ((sum >> 32) as u32)
        .wrapping_add(a_high.wrapping_mul(b_high))
        .wrapping_sub(signs);
    Fixed((u64::from(high) << 32 | u64::from(sum as u32)) as i64)
}

impl Flight for Ballistic<'_> {
    // Flight time in rad. Larger values reduce the errors of slow flights, but more flights take
    // the longer form.
    const MAX_SHORT_FLIGHT: f32 = 0.06;
    // Step in rad: from here on settling uses all digits.
    const MAX_LAST_STEP: f32 = 0.25;
    // Arrival speed in `b w` of a possible graze.
    const MAX_GRAZING_SPEED: f32 = 1e-3;
    const APPROACH_IS_FINAL: bool = false;
    // Correction in rad: the remaining error is its cube.
    const MAX_LAST_CORRECTION: f32 = 1e-3;
    // Two steps of 2^-30.
    const PULL_ROUNDING: f32 = 2e-9;
    // Gap in b: eleven steps of 2^-30.
    const GAP_ROUNDING: f32 = 1e-8;
    // Gap in b per rad of flight: effect of the launch velocity's rounding.
    const GAP_ROUNDING_PER_RADIAN: f32 = 3e-11;

    fn local(&self, node: i32) -> Local {
        let local = self.exact(node).0;
        let steps = self.steps_to(node);
        // Height over 2 pi: larger than the track's stroke. Beyond a height of 2 the exact bits
        // wrap.
        const MAX_EXACT_HEIGHT: Fixed<32, i64> = Fixed::<32, i64>::from_constant(0.375);
        let turns = product_32(steps, self.velocities(steps).0).to::<32>();
        let height = if turns > MAX_EXACT_HEIGHT {
            2.0
        } else if turns < -MAX_EXACT_HEIGHT {
            -2.0
        } else {
            let rise: Fixed<26> = turns.product(RADIANS_PER_TURN);
            let coarse = (rise + self.sine.to::<26>()).single() - local.push;
            if (-1.9..=1.9).contains(&coarse) {
                local.height
            } else {
                coarse
            }
        };
        Local { height, ..local }
    }
}

impl OverSine for Ballistic<'_> {
    #[inline(never)]
    fn above_k(&self, steps: i64, _: f32) -> f32 {
        let rise = rise_after(steps, self.velocities(steps).0);
        // Within rounding of k, far from the limits of i32.
        rise.wrapping_add(self.sine)
            .wrapping_sub(self.kernel.threshold)
            .single()
    }
}

impl Kernel for Hybrid {
    type State = HybridState;

    const NAME: &'static str = "hybrid";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let set_up = SetUp::build(k, restitution)?;
        Ok(Self {
            track: SineTrack::new(&set_up),
            threshold: set_up.threshold(),
            excess: set_up.excess(),
            half_turn_fall: set_up.half_turn_fall(),
            restitution: set_up.restitution,
        })
    }

    fn state(phase: f64, velocity: f64) -> Result<HybridState, OutOfRange> {
        HybridState::build(phase, velocity)
    }

    #[inline]
    fn is_in_range(state: HybridState) -> bool {
        state.is_in_range()
    }

    fn observe(state: HybridState) -> PartState {
        state.to_part_state()
    }

    #[inline]
    fn impact(&self, state: HybridState) -> Impact<HybridState> {
        self.land(state).impact()
    }

    fn impact_single(&self, state: HybridState) -> SingleImpact<HybridState> {
        let Landing { steps, next, .. } = self.land(state);
        let radians = |steps: u64| {
            Positive::from_steps(steps, 0)
                .times(Positive::RADIANS_PER_STEP)
                .single()
        };
        SingleImpact {
            flight: radians(steps.unsigned_abs()),
            phase: radians(u64::from(next.phase.bits())),
            velocity: next.velocity.fixed().single(),
            next,
        }
    }

    fn scaled(state: HybridState, factor: f32) -> Result<HybridState, OutOfRange> {
        let velocity = state.velocity.fixed();
        let factor = Positive::from_f64(f64::from(factor));
        let scaled = Positive::from_steps(u64::from(velocity.0), 26).times(factor);
        let scaled = if velocity.0 == 0 {
            0
        } else {
            scaled.nearest(26)
        };
        match u32::try_from(scaled) {
            Ok(steps) if steps <= HybridState::MAX_VELOCITY.bits() => Ok(HybridState {
                velocity: Velocity::from_fixed(Fixed(steps)),
                ..state
            }),
            _ => Self::state(state.phase.radians(), f64::INFINITY),
        }
    }

    fn resting(phase: f32) -> Result<HybridState, OutOfRange> {
        if !(phase > 0.0 && phase < core::f32::consts::TAU) {
            return Self::state(f64::from(phase), 0.0);
        }
        let turns = Positive::from_f64(f64::from(phase)).times(Positive::TURNS_PER_RADIAN);
        Ok(HybridState {
            phase: Phase::from_bits(turns.nearest(32) as u32),
            velocity: Velocity::ZERO,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The result of a kernel with f64.
    fn expected(kernel: &Hybrid, state: HybridState) -> SingleImpact<HybridState> {
        let impact = kernel.impact(state);
        let PartState { phase, velocity } = Hybrid::observe(impact.next);
        SingleImpact {
            flight: impact.flight as f32,
            phase: phase as f32,
            velocity: velocity as f32,
            next: impact.next,
        }
    }

    /// Launches that touch a hump so gently that their arrival rounds below 0; unsigned it is the
    /// largest number.
    #[test]
    fn arrival_rounded_below_zero_is_a_graze() {
        for [k, restitution, phase, velocity] in [
            [
                0.942_362_410_194_748_2,
                0.962_403_321_742_895_2,
                0.536_331_793_535_494_8,
                0.102_168_692_214_752_8,
            ],
            [
                0.195_098_795_574_910_56,
                1.0,
                4.399_616_753_945_056,
                1.494_849_640_294_900_5,
            ],
        ] {
            let board = Hybrid::build(k, restitution).unwrap();
            let landing = board.land(Hybrid::state(phase, velocity).unwrap());
            assert!(landing.grazes && landing.steps > 0, "{landing:?}");
            assert_eq!(landing.next.velocity, Velocity::ZERO);
        }
    }

    #[test]
    fn f32_impact_is_the_rounded_f64_impact() {
        for n in 0..200_000_u32 {
            let spread = |factor: f64| (f64::from(n) * factor).rem_euclid(1.0);
            let kernel = Hybrid::build(0.05 + spread(0.618_034), 0.5).unwrap();
            let velocity = [0.0, 1e-4, 1.0, 20.0, 60.0][n as usize % 5] * spread(0.303_577);
            let state = Hybrid::state(6.0 * spread(0.732_051), velocity).unwrap();
            assert_eq!(kernel.impact_single(state), expected(&kernel, state), "{n}");
            let factor = (4.0 * spread(0.444_444_1)) as f32 + 0.01;
            let PartState { phase, velocity } = Hybrid::observe(state);
            let slower = Hybrid::state(phase, velocity * f64::from(factor));
            assert_eq!(
                Hybrid::scaled(state, factor).ok(),
                slower.ok(),
                "{state:?} {factor}"
            );
            let phase = (6.2 * spread(0.123_456_7)) as f32;
            assert_eq!(
                Hybrid::resting(phase),
                Hybrid::state(f64::from(phase), 0.0),
                "{phase}"
            );
        }
    }
}
