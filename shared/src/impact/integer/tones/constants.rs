//! A track of several tones in the integers that a flight is computed from.

use core::f64::consts::{PI, TAU};

use crate::arithmetic::Phase;
use crate::arithmetic::fixed::Fixed;
use crate::arithmetic::node;
use crate::arithmetic::trigonometry::{sine_cosine_fine, sine_cosine_narrow};
use crate::feeder::OutOfRange;
use crate::impact::anchor::tones::{
    Edge as SingleEdge, Harmonic as Single, Harmonics, Hump as SingleHump, Track,
};
use crate::impact::integer::ballistic::product_32;
use crate::impact::wave::Tone;

/// A height of the track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Level {
    /// Modulo 4.
    pub fine: Fixed<30>,
    pub coarse: Fixed<27>,
}

/// One harmonic, `e sin(n t + th)`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Harmonic {
    /// th.
    angle: Phase,
    /// e.
    size: Fixed<31>,
    /// `e cos th` and `e sin th`, and to 15 places.
    turned: [Fixed<31>; 2],
    short: [Fixed<15>; 2],
}

/// A number in steps half as large; 1, which has no place there, becomes the step below it.
#[inline(always)]
fn doubled(Fixed(x): Fixed<30>) -> Fixed<31> {
    Fixed(x.saturating_add(x))
}

impl Harmonic {
    fn new(harmonic: &Single) -> Self {
        let Fixed(amplitude) = harmonic.amplitude;
        let angle = harmonic.angle;
        let turned = [angle, angle - Phase::from_bits(1 << 30)]
            .map(|phase| product_32(i64::from(amplitude), sine_cosine_fine(phase).1).narrow());
        Self {
            angle,
            size: Fixed((amplitude >> 1) as i32),
            turned,
            short: turned.map(|part: Fixed<31>| Fixed((part.0 + (1 << 15)) >> 16)),
        }
    }

    /// `e sin` and `e cos` of its angle at a node of n times the phase.
    #[inline(always)]
    fn at_node(&self, node: i32) -> [Fixed<30>; 2] {
        let [sine, cosine] = node::FIXED[(node & 255) as usize].map(doubled);
        let [a, b] = self.turned;
        [
            a.times::<31, 30>(sine) + b.times(cosine),
            a.times::<31, 30>(cosine) - b.times(sine),
        ]
    }

    /// The same to 15 places.
    #[inline(always)]
    fn near_node(&self, node: i32) -> [Fixed<30>; 2] {
        let [sine, cosine] = node::FIXED[(node & 255) as usize].map(|part| part.to::<15>());
        let [a, b] = self.short;
        [
            a.short_times::<15, 30>(sine) + b.short_times(cosine),
            a.short_times::<15, 30>(cosine) - b.short_times(sine),
        ]
    }

    /// The same at a phase `n t`.
    #[inline(always)]
    fn at(&self, phase: u32) -> [Fixed<30>; 2] {
        let phase = Phase::from_bits(phase.wrapping_add(self.angle.bits()));
        sine_cosine_narrow(phase).map(|part| self.size.times(doubled(part)))
    }
}

/// Sine and cosine of each tone, times its amplitude.
#[derive(Clone, Copy, Debug)]
pub(super) struct Parts([[Fixed<30>; 2]; 3]);

impl Parts {
    /// S.
    #[inline(always)]
    pub fn height(&self) -> Level {
        let [[s, _], [s2, _], [s3, _]] = self.0;
        Level {
            fine: s.wrapping_add(s2).wrapping_add(s3),
            coarse: s.to::<27>() + s2.to() + s3.to(),
        }
    }

    /// S'.
    #[inline(always)]
    pub fn speed(&self) -> Fixed<26> {
        let [c, c2, c3] = self.0.map(|[_, c]| c.to::<28>());
        (c + c2.times_integer(2) + c3.times_integer(3)).to()
    }

    /// The same, as the flight starts with it.
    #[inline(always)]
    pub fn long_speed(&self) -> Fixed<48, i64> {
        let [c, c2, c3] = self.0.map(|[_, c]| Fixed::<30, i64>(i64::from(c.0)));
        let sum = c + c2 + c2 + c3 + c3 + c3;
        sum.to()
    }

    /// `A = -S''`.
    #[inline(always)]
    pub fn push(&self) -> Fixed<27> {
        let [[s, _], [s2, _], [s3, _]] = self.0;
        s.to::<27>() + s2.scaled::<28>().to() + s3.to::<27>().times_integer(9)
    }

    /// The same modulo 4.
    #[inline(always)]
    fn fine_push(&self) -> Fixed<30> {
        let [[s, _], [s2, _], [s3, _]] = self.0;
        let times = |x: Fixed<30>, n: i32| Fixed::<30>(x.0.wrapping_mul(n));
        s.wrapping_add(times(s2, 4)).wrapping_add(times(s3, 9))
    }

    /// A'.
    #[inline(always)]
    pub fn surge(&self) -> Fixed<26> {
        let [[_, c], [_, c2], [_, c3]] = self.0;
        c.to::<26>() + c2.scaled::<27>().to() + c3.to::<26>().times_integer(27)
    }

    /// A''.
    #[inline(always)]
    pub fn bend(&self) -> Fixed<25> {
        let [[s, _], [s2, _], [s3, _]] = self.0;
        -(s.to::<25>() + s2.scaled::<26>().to() + s3.to::<25>().times_integer(81))
    }

    /// The third to fifth derivative of A.
    #[inline(always)]
    pub fn higher(&self) -> (Fixed<23>, Fixed<22>, Fixed<20>) {
        let [[s, c], [s2, c2], [s3, c3]] = self.0;
        (
            -(c.to::<23>() + c2.scaled::<25>().to() + c3.to::<23>().times_integer(243)),
            s.to::<22>() + s2.scaled::<24>().to() + s3.to::<22>().times_integer(729),
            c.to::<20>() + c2.scaled::<23>().to() + c3.to::<20>().times_integer(2187),
        )
    }
}

/// Where the push passes k.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Edge {
    /// S there.
    pub height: Level,
    /// S' there.
    pub speed: Fixed<26>,
}

/// A stretch on which the track pushes harder than k.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Hump {
    /// Where it begins: a resting part is thrown off here.
    pub phase: u32,
    /// Its length in steps of a phase.
    pub length: u32,
    pub begin: Edge,
    pub end: Edge,
}

/// The constants of one track and one restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Constants {
    tones: Harmonics,
    second: Harmonic,
    third: Harmonic,
    humps: [Hump; 3],
    count: usize,
    /// k.
    pub k: Fixed<27>,
    threshold: Fixed<35, i64>,
    /// k pi.
    pub half_turn_fall: Fixed<48, i64>,
    /// 1 / (2 pi k).
    pub inverse: Fixed<24, u32>,
    /// The least square of the speed at height 0 of a tall flight.
    pub tall: Fixed<52, i64>,
    /// Bound of |S|.
    pub reach: Level,
    /// Restitution, 1 as 1 - 2^-32.
    pub restitution: Fixed<32, u32>,
}

impl Constants {
    /// Those of a track, rounded to their steps.
    pub fn build([second, third]: [Tone; 2], k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let track = Track::build(second, third, k)?;
        let level = |height: f32, fine| Level {
            fine,
            coarse: Fixed::<27>::from_single(height),
        };
        let hump = |hump: &SingleHump| {
            let edge = |edge: &SingleEdge| Edge {
                height: level(edge.height, edge.fixed),
                speed: Fixed::<26>::from_single(edge.speed),
            };
            Hump {
                phase: hump.phase,
                length: hump.length,
                begin: edge(&hump.begin),
                end: edge(&hump.end),
            }
        };
        let mut humps = [Hump::default(); 3];
        for (place, found) in humps.iter_mut().zip(track.humps()) {
            *place = hump(found);
        }
        let coarse = Fixed::<27>::from_single(track.reach) + Fixed(64);
        Ok(Self {
            second: Harmonic::new(&track.tones.second),
            third: Harmonic::new(&track.tones.third),
            humps,
            count: track.humps().len(),
            k: Fixed::<27>::nearest(k),
            threshold: Fixed::<35, i64>::nearest(k),
            half_turn_fall: Fixed::<48, i64>::nearest(k * PI),
            inverse: Fixed::<24, u32>::nearest(1.0 / (TAU * k)),
            // With the reserve that it has for what f32 rounds.
            tall: Fixed::<26, i64>(i64::from(Fixed::<26>::from_single(0.5 * track.tall).0))
                .to::<53>()
                .scaled(),
            reach: Level {
                fine: Fixed(coarse.0.wrapping_shl(3)),
                coarse,
            },
            restitution: Fixed::<32, u32>::nearest(restitution),
            tones: track.tones,
        })
    }

    /// Its humps in the order of their phases, from any of them.
    #[inline(always)]
    pub fn humps(&self) -> &[Hump] {
        &self.humps[..self.count.min(3)]
    }

    /// Whether the track throws a part at `phase`.
    #[inline(always)]
    pub fn throws(&self, phase: u32) -> bool {
        self.humps()
            .iter()
            .any(|hump| phase.wrapping_sub(hump.phase) < hump.length)
    }

    /// `k - A` modulo 4, from the tones at the phase.
    #[inline(always)]
    pub fn pull(&self, parts: &Parts) -> Fixed<30> {
        self.threshold
            .narrow::<30>()
            .wrapping_sub(parts.fine_push())
    }

    /// The same within 3e-9.
    #[inline(never)]
    pub fn fine_pull(&self, phase: u32) -> Fixed<30> {
        let push = self.tones.sines(Phase::from_bits(phase), [4, 9]);
        (self.threshold - push).narrow()
    }

    /// The tones at a phase.
    #[inline(always)]
    pub fn at(&self, phase: u32) -> Parts {
        let third = if self.tones.is_of_three {
            self.third.at(phase.wrapping_mul(3))
        } else {
            [Fixed(0); 2]
        };
        Parts([
            sine_cosine_narrow(Phase::from_bits(phase)),
            self.second.at(phase.wrapping_mul(2)),
            third,
        ])
    }

    /// The tones at a node.
    #[inline(always)]
    pub fn at_node(&self, node: i32) -> Parts {
        let third = if self.tones.is_of_three {
            self.third.at_node(node.wrapping_mul(3))
        } else {
            [Fixed(0); 2]
        };
        Parts([
            node::FIXED[(node & 255) as usize],
            self.second.at_node(node.wrapping_mul(2)),
            third,
        ])
    }

    /// The same to 15 places.
    #[inline(always)]
    pub fn near_node(&self, node: i32) -> Parts {
        let third = if self.tones.is_of_three {
            self.third.near_node(node.wrapping_mul(3))
        } else {
            [Fixed(0); 2]
        };
        Parts([
            node::FIXED[(node & 255) as usize],
            self.second.near_node(node.wrapping_mul(2)),
            third,
        ])
    }
}
