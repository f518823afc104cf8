//! Launches for testing a map: ordinary and adversarial ones, from tracks of one to three tones.

use kband_host::random::SplitMix;
use std::f64::consts::{FRAC_PI_2, TAU};

use kband::impact::{PartState, Tone, Wave};

use crate::oracle::Track;

/// A launch: the input of a kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Launch {
    /// The track.
    pub track: Track,
    /// Restitution.
    pub restitution: f64,
    /// Phase in rad, 0..2 pi.
    pub phase: f64,
    /// Velocity relative to the track.
    pub velocity: f64,
}

impl Launch {
    /// Phase and velocity.
    pub fn state(&self) -> PartState {
        PartState::new(self.phase, self.velocity)
    }

    /// The gap `d` after this launch and its first two derivatives.
    pub fn gap(&self, d: f64) -> [f64; 3] {
        self.track.gap(self.phase, self.velocity, d)
    }

    /// Excess of the track's downward acceleration over k at this launch, and its derivative by the
    /// phase.
    pub fn excess(&self) -> [f64; 2] {
        let [.., curvature, third] = self.track.at(self.phase);
        [-curvature - self.track.k, -third]
    }

    /// Rounding error of the gap `d` after this launch: half a unit in the last place of every
    /// summed term.
    pub fn rounding(&self, d: f64) -> f64 {
        let [_, speed, curvature, _] = self.track.at(self.phase);
        let [reach, fastest, ..] = self.track.sums();
        let (mut push, mut surge) = (0.0, 0.0);
        for (q, e, th) in self.track.tones {
            let (s, c) = (q * self.phase + th).sin_cos();
            push += e * q * q * s.abs();
            surge += e * q * q * q * c.abs();
        }
        let (k, velocity) = (self.track.k, self.velocity);
        let terms = if d < 0.5 {
            let bent = (curvature + k).abs() + k + push + d * surge;
            d * (velocity + d * bent)
        } else {
            d * ((velocity + speed).abs() + velocity + k * d + fastest) + 2.0 * reach
        };
        0.5 * f64::EPSILON * terms
    }
}

/// A reproducible generator of random numbers.
pub struct Random(SplitMix);

impl Random {
    /// The sequence of `seed`.
    pub fn new(seed: u64) -> Self {
        Self(SplitMix(seed))
    }

    /// The next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// Uniform in `from..to`.
    pub fn between(&mut self, from: f64, to: f64) -> f64 {
        self.0.within(from, to)
    }

    /// Log-uniform in `from..to`.
    pub fn scale(&mut self, from: f64, to: f64) -> f64 {
        self.between(from.ln(), to.ln()).exp()
    }

    /// +1 or -1.
    pub fn sign(&mut self) -> f64 {
        if self.bits() & 1 == 0 { 1.0 } else { -1.0 }
    }
}

/// Kinds of launch; k is relative to the largest k at which the track throws a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// psi uniform in 0..20, k in 0.02..0.98.
    High,
    /// psi uniform in 0..3, k in 0.02..0.98.
    Low,
    /// psi log-uniform in 1e-30..3.
    Chatter,
    /// Phases within 1e-16..0.1 of an edge, where the track's downward acceleration crosses k; psi
    /// = 0 or tiny.
    Edge,
    /// Flights that touch a hump within 1e-17..1e-2.
    Grazing,
    /// Phases near the wrap.
    Wrap,
    /// k log-uniform in 0.005..3, psi log-uniform in 1e-30..100.
    Wide,
    /// k within 1e-16..1e-2 of 1; phases equally near to the top of a sine's stroke, or anywhere.
    Flat,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 8] = {
        use Kind::*;
        [High, Low, Chatter, Edge, Grazing, Wrap, Wide, Flat]
    };

    /// A random launch of this kind from a track with one tone.
    pub fn draw(self, random: &mut Random) -> Launch {
        let restitution = restitution(random);
        let track = self.track(random, [Tone::default(); 2]);
        self.launch(random, track, restitution)
    }

    /// A random track with these tones. It panics if the library refuses them.
    pub fn track(self, random: &mut Random, tones: [Tone; 2]) -> Track {
        let k = match self {
            Self::High | Self::Low | Self::Chatter | Self::Wrap => random.between(0.02, 0.98),
            Self::Edge => random.between(0.005, 1.0),
            Self::Grazing => random.between(0.005, 0.98),
            Self::Wide => random.scale(0.005, 3.0),
            Self::Flat => 1.0 + random.sign() * random.scale(1e-16, 1e-2),
        };
        if tones.iter().all(|tone| tone.amplitude == 0.0) {
            return Track::sine(k);
        }
        let wave = Wave::build(tones[0], tones[1]).expect("tones of at most 0.5");
        Track::on(k * wave.highest_throw(), tones)
    }

    /// A random launch of this kind from a track.
    pub fn launch(self, random: &mut Random, track: Track, restitution: f64) -> Launch {
        let mut phase = random.between(0.0, TAU);
        let velocity = match self {
            Self::High => random.between(0.0, 20.0),
            Self::Low => random.between(0.0, 3.0),
            Self::Chatter => random.scale(1e-30, 3.0),
            Self::Edge => {
                phase = edge(&track, random) + random.sign() * random.scale(1e-16, 0.1);
                if random.sign() > 0.0 {
                    0.0
                } else {
                    random.scale(1e-30, 0.1)
                }
            }
            Self::Grazing => loop {
                let Some((start, velocity, _)) = touching(&track, random) else {
                    continue;
                };
                let velocity = velocity + random.sign() * random.scale(1e-17, 1e-2);
                if (0.0..20.0).contains(&velocity) {
                    phase = start;
                    break velocity;
                }
            },
            Self::Wrap => {
                phase = match random.bits() % 4 {
                    0 => 0.0,
                    1 => f64::from_bits(TAU.to_bits() - 1 - random.bits() % 8),
                    2 => random.scale(1e-300, 1e-3),
                    _ => TAU - random.scale(1e-15, 1e-3),
                };
                random.scale(1e-30, 20.0)
            }
            Self::Wide => random.scale(1e-30, 100.0),
            Self::Flat => {
                if random.sign() > 0.0 {
                    phase = FRAC_PI_2 + random.sign() * random.scale(1e-16, 1e-1);
                }
                match random.bits() % 4 {
                    0 => 0.0,
                    1 => random.between(0.0, 10.0),
                    _ => random.scale(1e-30, 1.0),
                }
            }
        };
        let phase = phase.rem_euclid(TAU);
        Launch {
            track,
            restitution,
            phase: if phase < TAU { phase } else { 0.0 },
            velocity,
        }
    }
}

/// A random restitution, often 0 or 1.
pub fn restitution(random: &mut Random) -> f64 {
    match random.bits() % 8 {
        0 => 0.0,
        1 => 1.0,
        _ => random.between(0.0, 1.0),
    }
}

/// Random second and third tones; half of the tracks have two tones.
pub fn tones(random: &mut Random) -> [Tone; 2] {
    let max_ratio = if random.sign() > 0.0 { 0.5 } else { 0.2 };
    let second = Tone::new(random.between(0.0, max_ratio), random.between(-TAU, TAU));
    let third = if random.sign() > 0.0 {
        Tone::new(random.between(0.0, 0.5), random.between(-TAU, TAU))
    } else {
        Tone::default()
    };
    [second, third]
}

/// Halves an interval 60 times; `is_low` holds at its low end alone.
pub(crate) fn bisect(mut low: f64, mut high: f64, is_low: impl Fn(f64) -> bool) -> [f64; 2] {
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if is_low(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    [low, high]
}

/// The first phase after a random one at which the track's downward acceleration crosses k; the
/// random phase if there is none.
fn edge(track: &Track, random: &mut Random) -> f64 {
    const STEP: f64 = TAU / 500.0;
    let excess = |phase: f64| -track.at(phase)[2] - track.k;
    let start = random.between(0.0, TAU);
    let rises = excess(start) < 0.0;
    let mut phases = (1..=500).map(|n| start + f64::from(n) * STEP);
    let Some(beyond) = phases.find(|phase| (excess(*phase) < 0.0) != rises) else {
        return start;
    };
    bisect(beyond - STEP, beyond, |phase| {
        (excess(phase) < 0.0) == rises
    })[0]
}

/// Phase and velocity of a flight that touches the track at a random place, and the time of the
/// touch.
pub fn touching(track: &Track, random: &mut Random) -> Option<(f64, f64, f64)> {
    let touch = random.between(0.0, TAU);
    let [s, c, curvature, _] = track.at(touch);
    if -curvature <= track.k {
        return None;
    }
    let gap = |past: f64| s - c * past - 0.5 * track.k * past * past - track.at(touch - past)[0];
    let mut high = random.between(0.05, 9.0);
    while gap(high) <= 0.0 || gap(high + 0.05) > 0.0 {
        high += 0.05;
        if high > 60.0 {
            return None;
        }
    }
    let [_, high] = bisect(high, high + 0.05, |past| gap(past) > 0.0);
    let phase = (touch - high).rem_euclid(TAU);
    Some((phase, c + track.k * high - track.at(phase)[1], high))
}
