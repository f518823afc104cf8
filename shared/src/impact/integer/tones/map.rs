//! The map in integers on several tones: a launch, by the kind of its flight.

use super::constants::{Constants, Parts};
use super::flight::Ballistic;
use super::search::{Search, Stretch, short_radians};
use super::short::{LONGEST, Near, steps_of};
use crate::arithmetic::Velocity;
use crate::arithmetic::fixed::Fixed;
use crate::feeder::{OutOfRange, accept};
use crate::impact::integer::Integer;
use crate::impact::integer::anchored::Anchored;
use crate::impact::integer::approach::{StepsFrom, approach, near_launch};
use crate::impact::integer::constants::{HALF, SHORT, SLOW};
use crate::impact::integer::settle::{arrival, landing, settle, solve};
use crate::impact::kernel::{HybridState, Impact, Kernel, Landing, PartState, WaveKernel};
use crate::impact::wave::Tone;

/// The impact map in integers on a track of two or three tones (`integer-tones`); of one tone it is [`Integer`], bit
/// for bit.
///
/// Measured against the map of a wave in f64 from the same 20 000 states each, e = 5/32, th = 2.487, k 0.02..0.98:
///
/// | velocities | phase error: median | p99 | max (rad) | velocity: max |
/// |---|---|---|---|---|
/// | 0..20 | 4.0e-9 | 7.2e-8 | 2.8e-7 | 2.8e-7 |
/// | 0..3 | 3.7e-9 | 7.1e-8 | 1.1e-6 | 9.9e-7 |
/// | 3e-7..3, logarithmic | 1.3e-9 | 1.7e-7 | 4.2e-6 | 5.7e-7 |
///
/// A third tone bends the track more within a node's reach than the expansion about it takes in: the speed of arrival is then off by up
/// to `S e/3200 + 1.6e-8 S'` of the largest derivatives of S, with a last step e of at most 2.4e-4 rad below a speed of 0.25, twice that
/// below 1, four times below 4 and twelve times beyond: with tones of 0.5, 1e-5 below a speed of 1 and 5e-5 beyond 4.
///
/// No wrong impact among them, nor among 40 000 hard launches on random tracks of two and three tones. About 2700
/// instructions an impact on a Cortex-M0 in gear, 3700 on launches up to velocity 3; it is set up in 530 000, for the
/// edges of the humps are found in f32.
///
/// Amplitudes and angles are rounded to steps of 2^-31 and of 2^-32 turns. Range: that of [`Integer`], but for the
/// velocity: 0..=24, for a track of three tones is itself as fast as 3.5.
///
/// ```
/// use kband::impact::{Kernel, Tone, WaveInteger, WaveKernel, WaveMap};
/// let tones = [Tone { amplitude: 0.15, angle: 2.356 }, Tone::default()];
/// let board = WaveInteger::on_tones(tones, 0.35, 0.2)?;
/// let start = WaveInteger::state(0.7, 0.36)?;
/// let expected = WaveMap::on_tones(tones, 0.35, 0.2)?.impact(WaveInteger::observe(start));
/// assert!((board.land(start).flight() - expected.flight).abs() < 5e-8);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveInteger(Shape);

/// What the track is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Sine(Integer),
    Tones(Constants),
}

const TOP: f64 = 24.0;
const TOP_VELOCITY: Fixed<26, u32> = Fixed::<26, u32>::of(TOP);

impl WaveInteger {
    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[must_use]
    pub fn land(&self, state: HybridState) -> Landing<HybridState> {
        match &self.0 {
            Shape::Sine(integer) => integer.land(state),
            Shape::Tones(constants) => land(constants, state),
        }
    }
}

/// The impact on a track that is no sine.
fn land(constants: &Constants, state: HybridState) -> Landing<HybridState> {
    let state = state.held_below(TOP_VELOCITY);
    let phase = state.phase.bits();
    let velocity = state.velocity.fixed();
    let parts = constants.at(phase);
    let flight = Ballistic {
        constants,
        phase,
        start: parts.height(),
        velocity,
        rise: Fixed::<26, i64>(i64::from(velocity.0)).to::<48>() + parts.long_speed(),
    };
    if let Some((node, offset)) = flight.fall() {
        let settled = settle(&flight, node, flight.local(node), offset);
        // The steps may have led back to launch, where the part rises over the track.
        if settled.converged && settled.speed > Fixed::<26>::ZERO && settled.steps > 0 {
            return landing(&flight, settled.steps, settled.speed, false);
        }
    }
    let throws = constants.throws(phase);
    if state.velocity == Velocity::ZERO && !throws {
        return Landing {
            steps: 0,
            next: state,
            grazes: false,
        };
    }
    low(&flight, &parts, throws)
}

#[inline(never)]
fn low(flight: &Ballistic<'_>, parts: &Parts, throws: bool) -> Landing<HybridState> {
    let limit = flight.limit();
    let mut close = None;
    if flight.velocity < Fixed::<26, u32>::of(1.0) {
        let near = close.insert(Near::new(flight, parts, throws));
        if let Some(hop) = near.first().and_then(|first| near.hop(first)) {
            let steps = steps_of(hop.duration);
            if limit.is_none_or(|limit| steps <= limit) {
                return landing(flight, steps, hop.arrival, false);
            }
        }
    }
    if let Some(limit) = limit
        && let Some((node, offset)) = candidate(flight, parts, limit)
        && flight.steps_to(node) <= limit + (1 << 23)
    {
        let settled = settle(flight, node, flight.local(node), offset);
        if settled.converged
            && settled.speed > SLOW
            && settled.steps >= SHORT
            && settled.steps <= limit
        {
            return landing(flight, settled.steps, settled.speed, false);
        }
    }
    let near = close.unwrap_or_else(|| Near::new(flight, parts, throws));
    searched(&Search {
        flight,
        near: &near,
    })
}

/// Where the first impact of a low flight may be, nearly, without a search: from the quadratic near launch or the fall of
/// the parabola.
#[inline(always)]
fn candidate(flight: &Ballistic<'_>, parts: &Parts, limit: i64) -> Option<(i32, Fixed<34>)> {
    // Half the pull, a sixth of the surge, the velocity.
    let pull: Fixed<27> = flight.constants.k - parts.push();
    let a1 = pull.to::<14>().scaled::<15>();
    let surge = parts.surge().to::<12>();
    let a2: Fixed<15> = surge.short_times(Fixed::<12>::of(1.0 / 6.0));
    let one = Fixed::<15, u32>::of(1.0);
    if a1.unsigned_abs() < one
        && a2.unsigned_abs() < Fixed::<15, u32>::of(0.5)
        && flight.velocity < Fixed::<26, u32>::of(1.0)
    {
        let psi = flight.velocity.to::<15>().signed();
        if let Some(near) = near_launch(a1, a2, psi, Fixed::<17>::of(1.0 / 16.0))? {
            let speed = -flight.rise.narrow::<26>().to::<13>();
            let base = flight.start.coarse.to::<29>();
            return approach(flight, StepsFrom::launch(flight.phase, near, speed, base));
        }
    }
    let crossing = flight.crossing(Fixed::<52, i64>(1 << 49))?;
    // The root of a fall lies at most half a rad before the parabola's crossing.
    (flight.steps_to(crossing.node) < limit + HALF)
        .then(|| approach(flight, crossing))
        .flatten()
}

/// The first impact by the stretches between edges.
#[inline(never)]
fn searched(search: &Search<'_>) -> Landing<HybridState> {
    let Search { flight, near } = *search;
    let Stretch {
        mut bracket,
        grazes,
    } = search.stretch();
    if bracket.low < SHORT {
        let (high, end) = if bracket.high < SHORT {
            (short_radians(bracket.high), bracket.high)
        } else {
            (LONGEST - Fixed(1), SHORT)
        };
        if near.gap(high).height <= Fixed::<30>::ZERO {
            let hop = near.hop_between(short_radians(bracket.low), high);
            let steps = steps_of(hop.duration);
            return landing(flight, steps, hop.arrival, grazes);
        }
        bracket.low = end;
        bracket.start = bracket.start.max(end);
    }
    let (node, local, offset) = solve(flight, bracket);
    let settled = settle(flight, node, local, offset);
    // Where the gap is all but flat steps lead anywhere, back to launch for one.
    let slack = 1 << 20;
    let outside = settled.steps < bracket.low - slack
        || settled.steps > bracket.high + slack
        || settled.steps < bracket.low / 2;
    if settled.speed < SLOW + SLOW && outside {
        let (steps, speed) = search.halved(&bracket);
        return landing(flight, steps, speed, true);
    }
    arrival(
        flight,
        &settled,
        grazes || !settled.converged && settled.speed < Fixed::<26>::of(1e-4),
    )
}

impl Kernel for WaveInteger {
    type State = HybridState;

    const NAME: &'static str = "integer-tones";

    /// The map of the sine alone; [`WaveKernel::on_tones`] takes tones.
    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Self::on_tones([Tone::default(); 2], k, restitution)
    }

    fn state(phase: f64, velocity: f64) -> Result<HybridState, OutOfRange> {
        HybridState::build(phase, velocity, TOP, "0..24 (units of b w)")
    }

    #[inline]
    fn flies(state: HybridState) -> bool {
        state.velocity.fixed() <= TOP_VELOCITY
    }

    fn observe(state: HybridState) -> PartState {
        state.observed()
    }

    #[inline]
    fn impact(&self, state: HybridState) -> Impact<HybridState> {
        self.land(state).impact()
    }
}

impl WaveKernel for WaveInteger {
    fn on_tones(tones: [Tone; 2], k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let held = (0.0..=1.0).contains(&restitution);
        accept("restitution", restitution, held, "0..1")?;
        let constants = Constants::build(tones, k, restitution)?;
        let [second, third] = tones;
        let is_sine = second.amplitude == 0.0 && third.amplitude == 0.0;
        Ok(Self(if is_sine {
            Shape::Sine(Integer::build(k, restitution)?)
        } else {
            Shape::Tones(constants)
        }))
    }
}
