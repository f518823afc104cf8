//! The impact map in f64 with the residual in twofold arithmetic: phases are right to their rounding.

use core::f64::consts::TAU;

use super::first::first_impact;
use super::launch::Launch;
use super::map::Map;
use crate::arithmetic::lane::Node;
use crate::arithmetic::node;
use crate::arithmetic::twofold::Twofold;
use crate::feeder::OutOfRange;
use crate::impact::kernel::{Impact, Kernel, PartState};

/// The impact map of [`Map`], its root polished once by the gap in twofold arithmetic.
///
/// The phase of an impact is within 0.51 ulp of the exact one (for phases above 0.1 rad, where the
/// condition `d/s` of the flight is below 1000), its flight and velocity within 1 ulp.
///
/// ```
/// use kband::impact::{Exact, Kernel, Map};
///
/// // To 18 digits, from 50: the first flight of a part thrown off at k = 0.9.
/// let exact = Exact::build(0.9, 0.5)?;
/// let refined = exact.refine(Exact::state(1.119_769_514_998_634_2, 0.0)?);
/// assert!((refined.flight[0] - 1.830_107_180_055_872).abs() < 1e-14);
/// // The map in f64 is within rounding of it.
/// let map = Map::build(0.9, 0.5)?;
/// let impact = map.impact(Map::state(1.119_769_514_998_634_2, 0.0)?);
/// assert!((impact.flight - refined.flight[0]).abs() < 1e-14);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exact {
    map: Map,
}

/// An impact to about 30 digits: each number is the sum of two f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined {
    /// Duration of the flight in rad.
    pub flight: [f64; 2],
    /// Phase of the impact in rad, 0..2 pi.
    pub phase: [f64; 2],
    /// Velocity after it.
    pub velocity: [f64; 2],
    /// Whether it grazes; it is then not polished.
    pub grazes: bool,
}

impl Refined {
    /// The impact in f64.
    pub(in crate::impact) fn rounded(&self) -> Impact<PartState> {
        Impact {
            flight: self.flight[0],
            next: PartState {
                phase: self.phase[0],
                velocity: self.velocity[0],
            },
            grazes: self.grazes,
        }
    }
}

impl Exact {
    /// The first impact after `state` to more digits than an f64 holds: absolute error of flight and
    /// phase about 1e-19 rad times the condition of the flight; with it other kernels are judged.
    #[must_use]
    pub fn refine(&self, state: PartState) -> Refined {
        let track = self.map.track();
        let launch = Launch::new(state.phase, state.velocity);
        let Some((landing, grazes)) = first_impact(track, &launch) else {
            return Refined {
                flight: [0.0; 2],
                phase: [state.phase, 0.0],
                velocity: [state.velocity, 0.0],
                grazes: false,
            };
        };
        let mut flight = Twofold::from(landing.flight);
        let mut phase = Twofold::from(landing.phase);
        let mut arrival = Twofold::from(landing.arrival);
        if !grazes && landing.arrival > 0.0 {
            let polished = if landing.flight < SHORT {
                short_hop(track.k, state, landing.flight)
            } else {
                flight_from_node(track.k, state, landing.flight)
            };
            // A root that moves by more than rounding is doubtful: left as it is.
            if (polished.flight.high - landing.flight).abs() <= 1e-9 * landing.flight {
                Polished {
                    flight,
                    phase,
                    arrival,
                } = polished;
            }
        }
        let velocity = arrival.times(Twofold::from(self.map.restitution()));
        Refined {
            flight: [flight.high, flight.low],
            phase: [phase.high, phase.low],
            velocity: [velocity.high, velocity.low],
            grazes,
        }
    }
}

impl Kernel for Exact {
    type State = PartState;

    const NAME: &'static str = "f64-exact";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Map::build(k, restitution).map(|map| Self { map })
    }

    fn state(phase: f64, velocity: f64) -> Result<PartState, OutOfRange> {
        Map::state(phase, velocity)
    }

    fn observe(state: PartState) -> PartState {
        state
    }

    fn impact(&self, state: PartState) -> Impact<PartState> {
        self.refine(state).rounded()
    }
}

/// A root after a Newton step.
pub(in crate::impact) struct Polished {
    pub flight: Twofold,
    pub phase: Twofold,
    pub arrival: Twofold,
}

/// 2 pi.
const TWO_PI: Twofold = Twofold {
    high: TAU,
    low: 256.0 * node::SPACING_REST,
};

/// `angle` less than 2 turns, in 0..2 pi.
pub(in crate::impact) fn turned(angle: Twofold) -> Twofold {
    let angle = if angle.high < 0.0 {
        angle.plus(TWO_PI)
    } else {
        angle
    };
    let angle = if angle.high >= TAU {
        angle.minus(TWO_PI)
    } else {
        angle
    };
    // Nearer to the whole turn than to any f64 below it, or a hair below zero.
    if (0.0..TAU).contains(&angle.high) {
        angle
    } else {
        Twofold::from(0.0)
    }
}

/// `count` node spacings.
pub(in crate::impact) fn nodes(count: f64) -> Twofold {
    Twofold::product(count, node::SPACING).plus(Twofold::product(count, node::SPACING_REST))
}

/// Sine and cosine of `x`, a node and an offset from it.
pub(in crate::impact) fn at_node(index: usize, x: Twofold) -> (Twofold, Twofold) {
    let twofold = |i: usize| Twofold {
        high: node::DOUBLE[index][i],
        low: node::DOUBLE_REST[index][i],
    };
    let (sine, cosine) = (twofold(0), twofold(1));
    // Only the first order needs more than an f64: the others are below 1e-4.
    let (s, c) = (sine.high, cosine.high);
    let z = x.high * x.high;
    let versine = z * (0.5 - z * (1.0 / 24.0 - z * (1.0 / 720.0 - z * (1.0 / 40_320.0))));
    let sagitta =
        x.high * z * (1.0 / 6.0 - z * (1.0 / 120.0 - z * (1.0 / 5040.0 - z * (1.0 / 362_880.0))));
    let sine_rest = Twofold::from(-(s * versine + c * sagitta));
    let cosine_rest = Twofold::from(s * sagitta - c * versine);
    (
        sine.plus(cosine.times(x)).plus(sine_rest),
        cosine.minus(sine.times(x)).plus(cosine_rest),
    )
}

/// Sine and cosine of a phase.
pub(in crate::impact) fn sine_cosine(phase: f64) -> (Twofold, Twofold) {
    let count = libm::round(phase / node::SPACING);
    let x = Twofold::from(phase).minus(nodes(count));
    at_node(count as usize % node::COUNT, x)
}

/// One Newton step on the gap at `d`, around the nearest node.
fn flight_from_node(k: f64, state: PartState, d: f64) -> Polished {
    let (s, c) = sine_cosine(state.phase);
    let v = Twofold::from(state.velocity).plus(c);
    let near = Node::near(state.phase, d);
    let distance = nodes(near.count()).minus(Twofold::from(state.phase));
    // The offset from the node, as an f64, exact.
    let x = Twofold::from(d).minus(distance).high;
    let time = distance.plus(Twofold::from(x));
    let (sine, cosine) = at_node(near.index(), Twofold::from(x));
    let fallen = time.times(Twofold::from(k));
    let half = Twofold {
        high: 0.5 * fallen.high,
        low: 0.5 * fallen.low,
    };
    let gap = time.times(v.minus(half)).plus(s.minus(sine));
    let slope = v.minus(fallen).minus(cosine);
    let step = Twofold::from(-gap.value() / slope.high);
    // The slope at the root.
    let slope = slope.plus(Twofold::from((sine.high - k) * step.high));
    let index = near.index() as f64;
    Polished {
        flight: time.plus(step),
        phase: turned(nodes(index).plus(Twofold::from(x)).plus(step)),
        arrival: slope.negative(),
    }
}

/// Longest hop in rad whose few terms beyond those in twofold arithmetic are exact enough. At 0.5
/// `the_exact_mode_rounds_phases_correctly` fails.
const SHORT: f64 = 0.25;

/// One Newton step on the gap of a short hop divided by its time.
fn short_hop(k: f64, state: PartState, d: f64) -> Polished {
    let (s, c) = sine_cosine(state.phase);
    let psi = Twofold::from(state.velocity);
    let pull = Twofold::from(k).minus(s);
    let z = d * d;
    let time = Twofold::from(d);
    let square = Twofold::product(d, d);
    // (d - sin d)/d^3 and (d^2/2 - 1 + cos d)/d^4: only their constants need more than an f64.
    let third = Twofold::from(1.0).over(6.0).plus(Twofold::from(
        -z * (1.0 / 120.0
            - z * (1.0 / 5040.0
                - z * (1.0 / 362_880.0 - z * (1.0 / 39_916_800.0 - z * (1.0 / 6_227_020_800.0))))),
    ));
    let fourth = Twofold::from(1.0).over(24.0).plus(Twofold::from(
        -z * (1.0 / 720.0
            - z * (1.0 / 40_320.0 - z * (1.0 / 3_628_800.0 - z * (1.0 / 479_001_600.0)))),
    ));
    let half_pull = Twofold {
        high: 0.5 * pull.high,
        low: 0.5 * pull.low,
    };
    let bend = c
        .times(third)
        .times(time)
        .minus(s.times(fourth).times(square));
    let gap = psi.minus(time.times(half_pull.minus(bend)));
    let half = Twofold::from(0.5);
    let versine = square.times(half.minus(square.times(fourth)));
    let sagitta = square.times(time).times(third);
    let slope = psi
        .minus(pull.times(time))
        .plus(c.times(versine))
        .minus(s.times(sagitta));
    // d w' = u' - w.
    let step = Twofold::from(-gap.value() * d / (slope.high - gap.high));
    let curvature = c.high * (d - sagitta.high) - s.high * versine.high - pull.high;
    let slope = slope.plus(Twofold::from(curvature * step.high));
    let flight = time.plus(step);
    Polished {
        flight,
        phase: turned(Twofold::from(state.phase).plus(flight)),
        arrival: slope.negative(),
    }
}
