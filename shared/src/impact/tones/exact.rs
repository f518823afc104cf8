//! The impact map in f64 on a track of several tones with the residual in twofold arithmetic.

use super::first::first_impact;
use super::launch::Launch;
use super::map::WaveMap;
use crate::arithmetic::lane::Node;
use crate::arithmetic::twofold::Twofold;
use crate::feeder::OutOfRange;
use crate::impact::double::Refined;
use crate::impact::double::exact::{Polished, at_node, nodes, sine_cosine, turned};
use crate::impact::kernel::{Impact, Kernel, PartState, WaveKernel};
use crate::impact::wave::{Tone, Wave};

/// The impact map of [`WaveMap`], its root polished once by the gap in twofold arithmetic
/// (`f64-exact-tones`), as [`Exact`](crate::impact::Exact) is that of one tone.
///
/// The harmonics' sines follow from the first's by the addition theorems, in twofold arithmetic. Phases are right to their
/// rounding where the flight's condition is below 1000.
///
/// ```
/// use kband::impact::{Kernel, Tone, WaveExact, WaveKernel, WaveMap};
/// let tones = [Tone { amplitude: 0.15, angle: 2.356 }, Tone::default()];
/// let state = WaveMap::state(0.7, 0.36)?;
/// let refined = WaveExact::on_tones(tones, 0.35, 0.2)?.refine(state);
/// let impact = WaveMap::on_tones(tones, 0.35, 0.2)?.impact(state);
/// assert!((impact.flight - refined.flight[0]).abs() < 1e-13);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveExact {
    map: WaveMap,
    /// `e cos th` and `e sin th` of each harmonic.
    mixed: [[Twofold; 2]; 2],
}

impl WaveExact {
    /// The map for a wave, k within 0.001..=1000 and a restitution.
    pub(crate) fn on(wave: Wave, k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let mixed = [wave.second(), wave.third()].map(|tone| {
            let (sine, cosine) = sine_cosine(tone.angle.abs());
            let sine = if tone.angle < 0.0 {
                sine.negative()
            } else {
                sine
            };
            let amplitude = Twofold::from(tone.amplitude);
            [amplitude.times(cosine), amplitude.times(sine)]
        });
        Ok(Self {
            map: WaveMap::on(wave, k, restitution)?,
            mixed,
        })
    }

    /// The first impact after `state` to more digits than an f64 holds: absolute error of flight and
    /// phase about 1e-19 rad times the condition of the flight.
    #[must_use]
    pub fn refine(&self, state: PartState) -> Refined {
        if self.map.wave().is_of_two() {
            self.refined::<2>(state)
        } else {
            self.refined::<3>(state)
        }
    }

    fn refined<const N: usize>(&self, state: PartState) -> Refined {
        let track = self.map.track();
        let launch = Launch::new::<N>(track, state.phase, state.velocity);
        let Some((landing, grazes)) = first_impact::<N>(track, &launch) else {
            return Refined {
                flight: [0.0; 2],
                phase: [state.phase, 0.0],
                velocity: [state.velocity, 0.0],
                grazes: false,
            };
        };
        let mut found = Polished {
            flight: Twofold::from(landing.flight),
            phase: Twofold::from(landing.phase),
            arrival: Twofold::from(landing.arrival),
        };
        if !grazes && landing.arrival > 0.0 {
            let polished = if landing.flight < SHORT / N as f64 {
                self.short_hop::<N>(state, landing.flight)
            } else {
                self.flight_from_node::<N>(state, landing.flight)
            };
            // A root that moves by more than rounding is doubtful: left as it is.
            if (polished.flight.high - landing.flight).abs() <= 1e-9 * landing.flight {
                found = polished;
            }
        }
        let velocity = found.arrival.times(Twofold::from(self.map.restitution()));
        let pair = |value: Twofold| [value.high, value.low];
        Refined {
            flight: pair(found.flight),
            phase: pair(found.phase),
            velocity: pair(velocity),
            grazes,
        }
    }

    /// Displacement and velocity of each tone over its frequency, from the sine and cosine of the first.
    fn parts<const N: usize>(&self, (sine, cosine): (Twofold, Twofold)) -> [[Twofold; 2]; N] {
        let mixed = |[a, b]: [Twofold; 2], s: Twofold, c: Twofold| {
            [a.times(s).plus(b.times(c)), a.times(c).minus(b.times(s))]
        };
        let product = sine.times(cosine);
        let double = product.plus(product);
        let turned = cosine.minus(sine).times(cosine.plus(sine));
        let mut parts = [[sine, cosine]; N];
        parts[1] = mixed(self.mixed[0], double, turned);
        if N > 2 {
            parts[2] = mixed(
                self.mixed[1],
                double.times(cosine).plus(turned.times(sine)),
                turned.times(cosine).minus(double.times(sine)),
            );
        }
        parts
    }

    /// One Newton step on the gap at `d`, around the nearest node.
    fn flight_from_node<const N: usize>(&self, state: PartState, d: f64) -> Polished {
        let k = self.map.k();
        let launch = self.parts::<N>(sine_cosine(state.phase));
        let v = Twofold::from(state.velocity).plus(sum(&launch, 1, 1));
        let near = Node::near(state.phase, d);
        let distance = nodes(near.count()).minus(Twofold::from(state.phase));
        // The offset from the node, as an f64, exact.
        let x = Twofold::from(d).minus(distance).high;
        let time = distance.plus(Twofold::from(x));
        let end = self.parts::<N>(at_node(near.index(), Twofold::from(x)));
        let fallen = time.times(Twofold::from(k));
        let height = sum(&launch, 0, 0).minus(sum(&end, 0, 0));
        let gap = time.times(v.minus(scaled(fallen, 0.5))).plus(height);
        let slope = v.minus(fallen).minus(sum(&end, 1, 1));
        let step = Twofold::from(-gap.value() / slope.high);
        // The slope at the root.
        let bend = sum(&end, 0, 2).high - k;
        let slope = slope.plus(Twofold::from(bend * step.high));
        let index = near.index() as f64;
        Polished {
            flight: time.plus(step),
            phase: turned(nodes(index).plus(Twofold::from(x)).plus(step)),
            arrival: slope.negative(),
        }
    }

    /// One Newton step on the gap of a short hop divided by its time.
    fn short_hop<const N: usize>(&self, state: PartState, d: f64) -> Polished {
        let launch = self.parts::<N>(sine_cosine(state.phase));
        let psi = Twofold::from(state.velocity);
        let pull = Twofold::from(self.map.k()).minus(sum(&launch, 0, 2));
        let time = Twofold::from(d);
        let mut bend = scaled(pull, 0.5);
        let mut slope = psi.minus(pull.times(time));
        let mut curvature = -pull.high;
        for (n, &[s, c]) in launch.iter().enumerate() {
            let q = (n + 1) as f64;
            let x = Twofold::product(q, d);
            let square = x.times(x);
            let z = square.high;
            // (x - sin x)/x^3 and (x^2/2 - 1 + cos x)/x^4: only their constants need more than an f64.
            let third = Twofold::from(1.0).over(6.0).plus(Twofold::from(
                -z * (1.0 / 120.0
                    - z * (1.0 / 5040.0
                        - z * (1.0 / 362_880.0
                            - z * (1.0 / 39_916_800.0 - z * (1.0 / 6_227_020_800.0))))),
            ));
            let fourth = Twofold::from(1.0).over(24.0).plus(Twofold::from(
                -z * (1.0 / 720.0
                    - z * (1.0 / 40_320.0 - z * (1.0 / 3_628_800.0 - z * (1.0 / 479_001_600.0)))),
            ));
            let weight = Twofold::from(q * q);
            let gained = c.times(third).times(x).minus(s.times(fourth).times(square));
            bend = bend.minus(weight.times(gained));
            let half = Twofold::from(0.5);
            let versine = square.times(half.minus(square.times(fourth)));
            let sagitta = square.times(x).times(third);
            let turning = c.times(versine).minus(s.times(sagitta));
            slope = slope.plus(Twofold::from(q).times(turning));
            curvature += q * q * (c.high * (x.high - sagitta.high) - s.high * versine.high);
        }
        let gap = psi.minus(time.times(bend));
        // d w' = u' - w.
        let step = Twofold::from(-gap.value() * d / (slope.high - gap.high));
        let slope = slope.plus(Twofold::from(curvature * step.high));
        let flight = time.plus(step);
        Polished {
            flight,
            phase: turned(Twofold::from(state.phase).plus(flight)),
            arrival: slope.negative(),
        }
    }
}

/// The sum over the tones of displacement (0) or velocity (1), each times its frequency to a power up to 2.
fn sum(parts: &[[Twofold; 2]], which: usize, power: usize) -> Twofold {
    let Some((first, upper)) = parts.split_first() else {
        return Twofold::from(0.0);
    };
    let mut sum = first[which];
    for (part, weights) in upper.iter().zip(WEIGHTS) {
        let (part, weight) = (part[which], weights[power]);
        sum = sum.plus(if weight == 3.0 || weight == 9.0 {
            part.times(Twofold::from(weight))
        } else {
            scaled(part, weight)
        });
    }
    sum
}

/// The frequencies of the upper tones, to each power.
const WEIGHTS: [[f64; 3]; 2] = [[1.0, 2.0, 4.0], [1.0, 3.0, 9.0]];

/// Times a power of two: exact.
fn scaled(value: Twofold, factor: f64) -> Twofold {
    Twofold {
        high: factor * value.high,
        low: factor * value.low,
    }
}

/// Longest hop in rad of the highest tone whose few terms beyond those in twofold arithmetic are exact enough.
const SHORT: f64 = 0.25;

impl Kernel for WaveExact {
    type State = PartState;

    const NAME: &'static str = "f64-exact-tones";

    /// The map of the sine alone; [`WaveExact::on`] takes a wave.
    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Self::on(Wave::sine(), k, restitution)
    }

    fn state(phase: f64, velocity: f64) -> Result<PartState, OutOfRange> {
        WaveMap::state(phase, velocity)
    }

    fn observe(state: PartState) -> PartState {
        state
    }

    fn impact(&self, state: PartState) -> Impact<PartState> {
        self.refine(state).rounded()
    }
}

impl WaveKernel for WaveExact {
    fn on_tones([second, third]: [Tone; 2], k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Self::on(Wave::build(second, third)?, k, restitution)
    }
}
