//! The impact map on a CPU with a single-precision FPU on a track of several tones: integer state and
//! residual, f32 corrections.

use super::harmonics::{Harmonic, Harmonics, Parts};
use super::launch::Launch;
use super::search::{Candidate, Edged, candidate, halved, has_left, search};
use super::track::Track;
use crate::arithmetic::Phase;
use crate::arithmetic::fixed::Fixed;
use crate::arithmetic::node::{self, Fine};
use crate::arithmetic::trigonometry::sine_cosine_fine;
use crate::feeder::{OutOfRange, accept};
use crate::impact::anchor::approach::fall;
use crate::impact::anchor::flight::{self, Flight, Local, STEPS_PER_RADIAN};
use crate::impact::anchor::hybrid::Hybrid;
use crate::impact::anchor::hybrid::{
    Exact, Parabola, TOP_VELOCITY, hop, landing, product_32, settled, speed,
};
use crate::impact::anchor::settle::settle;
use crate::impact::anchor::solve::Found;
use crate::impact::kernel::{HybridState, Impact, Kernel, Landing, PartState, WaveKernel};
use crate::impact::wave::Tone;

/// The impact map for the Cortex-M4F on a track of two or three tones (`hybrid-tones`); of one tone it is
/// [`Hybrid`], bit for bit.
///
/// The harmonics, too, stand on nodes of the sine table, in 64-bit integers. Range and rounding are those of
/// [`Hybrid`]; amplitudes and angles are rounded to steps of 2^-32.
///
/// ```
/// use kband::impact::{Kernel, Hybrid, Tone, WaveHybrid, WaveKernel, WaveMap};
/// let tones = [Tone { amplitude: 0.15, angle: 2.356 }, Tone::default()];
/// let board = WaveHybrid::on_tones(tones, 0.35, 0.2)?;
/// let start = Hybrid::state(0.7, 0.36)?;
/// let expected = WaveMap::on_tones(tones, 0.35, 0.2)?.impact(Hybrid::observe(start));
/// assert!((board.land(start).flight() - expected.flight).abs() < 2e-8);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveHybrid {
    shape: Shape,
    /// Restitution, 1 as 1 - 2^-32.
    restitution: Fixed<32, u32>,
}

/// What the track is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Sine(Hybrid),
    Tones(Tones),
}

/// A track of several tones in integers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tones {
    track: Track,
    second: Turned,
    third: Turned,
    /// k pi.
    half_turn_fall: Fixed<48, i64>,
}

/// `e cos th` and `e sin th`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Turned([Fixed<31>; 2]);

impl WaveHybrid {
    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[must_use]
    #[inline(always)]
    pub fn land(&self, state: HybridState) -> Landing<HybridState> {
        match &self.shape {
            Shape::Sine(hybrid) => on_sine(hybrid, state),
            Shape::Tones(tones) => tones.land(state, self.restitution),
        }
    }
}

/// Apart from the tones, which need all registers.
#[inline(never)]
fn on_sine(hybrid: &Hybrid, state: HybridState) -> Landing<HybridState> {
    hybrid.land(state)
}

impl Turned {
    fn new(harmonic: &Harmonic) -> Self {
        let cosine = |phase: Phase| {
            let product = product_32(i64::from(harmonic.amplitude.0), sine_cosine_fine(phase).1);
            product.narrow::<31>()
        };
        let angle = harmonic.angle;
        Self([cosine(angle), cosine(angle - Phase::from_bits(1 << 30))])
    }

    /// `e sin` and `e cos` at a node of n times the phase.
    #[inline(always)]
    fn at_node(&self, node: i32) -> [Fixed<61, i64>; 2] {
        let [a, b] = self.0;
        let [sine, cosine] = node::FINE[(node & 255) as usize].fixed;
        [
            a.whole(sine) + b.whole(cosine),
            a.whole::<30, 61>(cosine) - b.whole(sine),
        ]
    }
}

/// `e sin` to f32 and 30 places, `e cos` to f32 and 48, at a phase of launch.
#[inline(always)]
fn at_launch(harmonic: &Harmonic, phase: u32) -> ([f32; 2], Fixed<30>, Fixed<48, i64>) {
    let (sine, fine) = sine_cosine_fine(harmonic.turned(phase));
    let amplitude = i64::from(harmonic.amplitude.0);
    let height = Fixed(((i64::from(sine.0) * amplitude + (1 << 31)) >> 32) as i32);
    let speed = product_32(amplitude, fine);
    (
        [
            height.single(),
            harmonic.size * fine.narrow::<30>().single(),
        ],
        height,
        speed,
    )
}

impl Tones {
    #[inline(always)]
    fn land(&self, state: HybridState, restitution: Fixed<32, u32>) -> Landing<HybridState> {
        let track = &self.track;
        let state = state.held_below(TOP_VELOCITY);
        let phase = state.phase.bits();
        let (sine, fine) = sine_cosine_fine(state.phase);
        let Harmonics {
            second,
            third,
            is_of_three,
        } = &track.tones;
        let (second, height, speed_2) = at_launch(second, phase.wrapping_mul(2));
        let mut height = sine.saturating_add(height);
        let velocity = state.velocity.fixed();
        let mut rise =
            Fixed::<26, i64>(i64::from(velocity.0)).to::<48>() + fine + speed_2 + speed_2;
        let mut parts = Parts([
            [sine.single(), fine.narrow::<30>().single()],
            second,
            [0.0; 2],
        ]);
        if *is_of_three {
            let (third, height_3, speed_3) = at_launch(third, phase.wrapping_mul(3));
            parts.0[2] = third;
            height = height.saturating_add(height_3);
            rise = rise + speed_3 + speed_3 + speed_3;
        }
        let flight = Ballistic {
            tones: self,
            phase,
            height,
            rise,
        };
        let psi = velocity.single();
        let (start, up) = (parts.sines(1.0, 1.0), psi + parts.cosines(2.0, 3.0));
        if let Some(approach) = fall::<Ballistic<'_>>(track, phase, start, up) {
            let (node, offset) = approach.end;
            let (local, slope) = flight.exact(node);
            if let Some(settled) = settle::<Ballistic<'_>>(track.k, &local, offset) {
                let steps = flight.steps_at(node, &settled);
                return landing(phase, steps, speed(&settled, slope), restitution, false);
            }
        }
        self.low(&flight, psi, &parts, restitution)
    }

    /// The impact of a flight that is not tall.
    #[inline(never)]
    fn low(
        &self,
        flight: &Ballistic<'_>,
        psi: f32,
        parts: &Parts,
        restitution: Fixed<32, u32>,
    ) -> Landing<HybridState> {
        let (track, phase) = (&self.track, flight.phase);
        let throws = track.throws(phase);
        if psi == 0.0 && !throws {
            return landing(phase, 0, Fixed(0), restitution, false);
        }
        let launch = Launch::new(track, phase, psi, parts, throws);
        if let Some((candidate, limits)) = candidate::<Ballistic<'_>>(track, &launch) {
            match candidate {
                Candidate::Hop {
                    flight: time,
                    arrival,
                } => {
                    let landing = hop(phase, time, arrival, restitution, false);
                    if limits.hold(track, &launch, landing.steps) {
                        return landing;
                    }
                }
                Candidate::Near(approach) => {
                    let (node, offset) = approach.end;
                    let (local, slope) = flight.exact(node);
                    if let Some(settled) = settle::<Ballistic<'_>>(track.k, &local, offset) {
                        let steps = flight.steps_at(node, &settled);
                        if limits.hold(track, &launch, steps) {
                            let speed = speed(&settled, slope);
                            return landing(phase, steps, speed, restitution, false);
                        }
                    }
                }
            }
        }
        self.searched(flight, &launch, restitution)
    }

    #[inline(never)]
    fn searched(
        &self,
        flight: &Ballistic<'_>,
        launch: &Launch,
        restitution: Fixed<32, u32>,
    ) -> Landing<HybridState> {
        let (track, phase) = (&self.track, flight.phase);
        let (found, grazes, bracket) = search(track, launch, flight);
        let found_impact = settled(track.k, restitution, flight, found, grazes);
        let speed = found_impact.next.velocity.fixed().single();
        if matches!(found, Found::Near { .. }) && has_left(&bracket, found_impact.steps, speed) {
            let (time, speed) = halved(track, launch, flight, &bracket);
            let steps = (time * STEPS_PER_RADIAN) as i64;
            let speed = Fixed::<26, u32>::from_single(speed);
            return landing(phase, steps, speed, restitution, true);
        }
        found_impact
    }
}

/// A flight in integers.
#[derive(Clone, Copy)]
struct Ballistic<'a> {
    tones: &'a Tones,
    phase: u32,
    /// S at launch.
    height: Fixed<30>,
    /// Launch velocity in the frame of the feeder, psi + S'.
    rise: Fixed<48, i64>,
}

impl Ballistic<'_> {
    #[inline(always)]
    fn parabola(&self) -> Parabola {
        Parabola {
            rise: self.rise,
            half_turn_fall: self.tones.half_turn_fall,
        }
    }
}

impl Exact for Ballistic<'_> {
    #[inline(always)]
    fn phase(&self) -> u32 {
        self.phase
    }

    #[inline(always)]
    fn exact(&self, node: i32) -> (Local, Fixed<26, u32>) {
        let steps = self.steps_to(node);
        let (mean, velocity) = self.parabola().velocities(steps);
        let rise = Parabola::long_rise_after(steps, mean);
        let Fine { fixed, cosine, .. } = &node::FINE[(node & 255) as usize];
        let [sine, turned] = self.tones.second.at_node(node.wrapping_mul(2));
        let mut sines = sine;
        let mut cosines = turned + turned;
        if self.tones.track.tones.is_of_three {
            let [sine, turned] = self.tones.third.at_node(node.wrapping_mul(3));
            sines = sines + sine;
            cosines = cosines + turned + turned + turned;
        }
        let below = fixed[0].wrapping_add(Fixed((sines.0 >> 31) as i32));
        let slope = velocity
            .wrapping_sub(*cosine)
            .wrapping_sub(cosines.to::<48>());
        let at = flight::Track::at(&self.tones.track, node);
        (
            Local {
                height: rise.wrapping_add(self.height).wrapping_sub(below).single(),
                slope: slope.narrow::<24>().single(),
                push: at.push,
                surge: at.surge,
                bend: at.bend,
            },
            Fixed(slope.narrow::<26>().0 as u32),
        )
    }
}

impl Flight for Ballistic<'_> {
    const SHORT: f32 = 0.06;
    const LEAP: f32 = 0.12;
    const SLOW: f32 = 1e-3;
    const FINAL: bool = false;
    const NEAR: f32 = 5e-4;
    const PULL: f32 = 4e-9;
    const ROUNDING: f32 = 2e-8;
    const DRIFT: f32 = 1e-9;

    #[inline(never)]
    fn local(&self, node: i32) -> Local {
        /// More than a stroke of 4.
        const FAR: Fixed<32, i64> = Fixed::<32, i64>::of(0.9);
        let local = self.exact(node).0;
        let below = flight::Track::at(&self.tones.track, node).height;
        let steps = self.steps_to(node);
        let parabola = self.parabola();
        let height = parabola.height(steps, self.height, below, local.height, FAR);
        Local { height, ..local }
    }
}

impl Edged for Ballistic<'_> {
    #[inline(never)]
    fn above(&self, steps: i64, edge: Fixed<30>, _: f32) -> f32 {
        let rise = Parabola::long_rise_after(steps, self.parabola().velocities(steps).0);
        // Within rounding of the edge, far from the ends of i32.
        rise.wrapping_add(self.height).wrapping_sub(edge).single()
    }
}

impl Kernel for WaveHybrid {
    type State = HybridState;

    const NAME: &'static str = "hybrid-tones";

    /// The map of the sine alone; [`WaveKernel::on_tones`] takes tones.
    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Self::on_tones([Tone::default(); 2], k, restitution)
    }

    fn state(phase: f64, velocity: f64) -> Result<HybridState, OutOfRange> {
        Hybrid::state(phase, velocity)
    }

    #[inline]
    fn flies(state: HybridState) -> bool {
        Hybrid::flies(state)
    }

    fn observe(state: HybridState) -> PartState {
        Hybrid::observe(state)
    }

    #[inline]
    fn impact(&self, state: HybridState) -> Impact<HybridState> {
        self.land(state).impact()
    }
}

impl WaveKernel for WaveHybrid {
    fn on_tones([second, third]: [Tone; 2], k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let held = (0.0..=1.0).contains(&restitution);
        accept("restitution", restitution, held, "0..1")?;
        let shape = if second.amplitude == 0.0 && third.amplitude == 0.0 {
            Harmonics::build(second, third)?;
            Shape::Sine(Hybrid::build(k, restitution)?)
        } else {
            let track = Track::build(second, third, k)?;
            Shape::Tones(Tones {
                second: Turned::new(&track.tones.second),
                third: Turned::new(&track.tones.third),
                half_turn_fall: Fixed::<48, i64>::nearest(k * core::f64::consts::PI),
                track,
            })
        };
        Ok(Self {
            shape,
            restitution: Fixed::<32, u32>::nearest(restitution),
        })
    }
}
