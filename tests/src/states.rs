//! Launch states for testing a kernel: ordinary and adversarial ones.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use kband::impact::PartState;

use crate::oracle::Track;
use crate::tones::touching;

/// A launch: the input of a kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Launch {
    /// k of the track.
    pub k: f64,
    /// Restitution.
    pub restitution: f64,
    /// Phase in rad, 0..2 pi.
    pub phase: f64,
    /// Velocity relative to the track.
    pub velocity: f64,
}

impl Launch {
    /// A launch at this k and restitution.
    pub const fn new(k: f64, restitution: f64, phase: f64, velocity: f64) -> Self {
        Self {
            k,
            restitution,
            phase,
            velocity,
        }
    }

    /// Phase and velocity.
    pub fn state(&self) -> PartState {
        PartState::new(self.phase, self.velocity)
    }

    /// Rounding error of the gap `d` after this launch: half a unit in the last place of every term
    /// it sums.
    pub fn rounding(&self, d: f64) -> f64 {
        let (s, c) = self.phase.sin_cos();
        let terms = if d < 0.5 {
            d * (self.velocity + d * ((s - self.k).abs() + self.k + s.abs() + d * c.abs()))
        } else {
            d * ((self.velocity + c).abs() + self.velocity + self.k * d + 1.0) + 2.0
        };
        0.5 * f64::EPSILON * terms
    }
}

/// A small reproducible generator of random numbers (SplitMix64).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The sequence of `seed`.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `from..to`.
    pub fn between(&mut self, from: f64, to: f64) -> f64 {
        let unit = (self.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        from + (to - from) * unit
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

/// The kinds of launch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// psi uniform in 0..20, k in 0.02..0.98.
    High,
    /// psi uniform in 0..3, k in 0.02..0.98.
    Low,
    /// psi log-uniform in 1e-30..3.
    Chatter,
    /// Phases within 1e-15..0.1 of `sin t = k`, psi = 0 or tiny.
    Edge,
    /// Flights that touch a hump within 1e-17..1e-2.
    Grazing,
    /// Phases at the wrap.
    Wrap,
    /// k log-uniform in 0.005..3, psi log-uniform in 1e-30..100.
    Wide,
    /// k within 1e-16..1e-2 of 1, phases equally near to the top of the stroke or anywhere.
    Flat,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 8] = [
        Self::High,
        Self::Low,
        Self::Chatter,
        Self::Edge,
        Self::Grazing,
        Self::Wrap,
        Self::Wide,
        Self::Flat,
    ];

    /// A random launch of this kind.
    pub fn draw(self, random: &mut Random) -> Launch {
        self.drawn(random, None)
    }

    /// A random launch of this kind from the track of `first`, a launch of the same kind.
    pub fn draw_beside(self, random: &mut Random, first: &Launch) -> Launch {
        self.drawn(random, Some(first))
    }

    fn drawn(self, random: &mut Random, beside: Option<&Launch>) -> Launch {
        let track =
            |k, restitution| beside.map_or((k, restitution), |first| (first.k, first.restitution));
        let restitution = match random.bits() % 8 {
            0 => 0.0,
            1 => 1.0,
            _ => random.between(0.0, 1.0),
        };
        let (mut k, restitution) = track(random.between(0.02, 0.98), restitution);
        let mut phase = random.between(0.0, TAU);
        let velocity = match self {
            Self::High => random.between(0.0, 20.0),
            Self::Low => random.between(0.0, 3.0),
            Self::Chatter => random.scale(1e-30, 3.0),
            Self::Edge => {
                k = track(random.between(0.005, 1.0), restitution).0;
                let edge = if random.sign() > 0.0 {
                    k.asin()
                } else {
                    PI - k.asin()
                };
                phase = edge + random.sign() * random.scale(1e-16, 0.1);
                if random.sign() > 0.0 {
                    0.0
                } else {
                    random.scale(1e-30, 0.1)
                }
            }
            Self::Grazing => {
                k = track(random.between(0.005, 0.98), restitution).0;
                return grazing(random, k, restitution);
            }
            Self::Wrap => {
                phase = match random.bits() % 4 {
                    0 => 0.0,
                    1 => f64::from_bits(TAU.to_bits() - 1 - random.bits() % 8),
                    2 => random.scale(1e-300, 1e-3),
                    _ => TAU - random.scale(1e-15, 1e-3),
                };
                random.scale(1e-30, 20.0)
            }
            Self::Wide => {
                k = track(random.scale(0.005, 3.0), restitution).0;
                random.scale(1e-30, 100.0)
            }
            Self::Flat => {
                k = track(1.0 + random.sign() * random.scale(1e-16, 1e-2), restitution).0;
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
        Launch::new(
            k,
            restitution,
            if phase < TAU { phase } else { 0.0 },
            velocity,
        )
    }
}

/// A launch whose parabola touches a hump, but for 1e-17..1e-2 of velocity.
fn grazing(random: &mut Random, k: f64, restitution: f64) -> Launch {
    let track = Track::sine(k);
    loop {
        let Some((phase, velocity, _)) = touching(&track, random) else {
            continue;
        };
        let velocity = velocity + random.sign() * random.scale(1e-17, 1e-2);
        if (0.0..20.0).contains(&velocity) && phase < TAU {
            return Launch::new(k, restitution, phase, velocity);
        }
    }
}
