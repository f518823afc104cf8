//! What the stages of the kernels hand on: register by register, dense.

use super::columns::Aligned;
use crate::arithmetic::lane::{Lane, Node};
use crate::impact::double::launch::{Launch, Track};
use crate::impact::double::step::{Close, Landing, Near};
use crate::impact::double::{low, tall};

/// Lanes that go through the stages together.
pub(super) const ROOM: usize = 64;

/// What the stages hand on: all of a register together, so that the cache holds them all.
#[derive(Clone, Debug)]
pub(super) struct Stages(Aligned<{ ROOM * QUANTITIES }>);

const QUANTITIES: usize = 16;
const LAUNCH: usize = 0;
const TRACK: usize = 4;
/// Where the first stage takes the flight: a crossing, or a stretch.
const BEGIN: usize = 7;
const CLOSE: usize = 11;
const LANDING: usize = 13;
/// In the place of launch, track and beginning, where lanes fly as they stand: those are in the columns.
const NEAR: usize = 0;

impl Stages {
    pub const EMPTY: Self = Self(Aligned::ZERO);

    /// Hands on quantities of register `n`, from number `first` on.
    #[inline(always)]
    fn put<L: Lane, const N: usize>(&mut self, n: usize, first: usize, values: [L; N]) {
        for (m, value) in values.into_iter().enumerate() {
            value.store(&mut self.0.0, (n * QUANTITIES + first + m) * L::WIDTH);
        }
    }

    #[inline(always)]
    fn get<L: Lane, const N: usize>(&self, n: usize, first: usize) -> [L; N] {
        let mut values = [L::splat(0.0); N];
        for (m, value) in values.iter_mut().enumerate() {
            *value = L::load(&self.0.0, (n * QUANTITIES + first + m) * L::WIDTH);
        }
        values
    }

    #[inline(always)]
    pub fn put_launch<L: Lane>(&mut self, n: usize, launch: &Launch<L>) {
        let Launch {
            phase,
            velocity,
            sine,
            cosine,
        } = *launch;
        self.put(n, LAUNCH, [phase, velocity, sine, cosine]);
    }

    #[inline(always)]
    pub fn launch<L: Lane>(&self, n: usize) -> Launch<L> {
        let [phase, velocity, sine, cosine] = self.get(n, LAUNCH);
        Launch {
            phase,
            velocity,
            sine,
            cosine,
        }
    }

    #[inline(always)]
    pub fn put_track<L: Lane>(&mut self, n: usize, track: &Track<L>) {
        self.put(n, TRACK, [track.k, track.per_k, track.lift_off]);
    }

    #[inline(always)]
    pub fn track<L: Lane>(&self, n: usize) -> Track<L> {
        let [k, per_k, lift_off] = self.get(n, TRACK);
        Track {
            k,
            per_k,
            lift_off,
            lift_off_cosine: Track::lift_off_cosine(k),
        }
    }

    #[inline(always)]
    pub fn put_crossing<L: Lane>(&mut self, n: usize, crossing: &tall::Crossing<L>) {
        self.put(n, BEGIN, [crossing.nodes, crossing.speed]);
    }

    #[inline(always)]
    pub fn crossing<L: Lane>(&self, n: usize) -> tall::Crossing<L> {
        let [nodes, speed] = self.get(n, BEGIN);
        tall::Crossing { nodes, speed }
    }

    #[inline(always)]
    pub fn put_stretch<L: Lane>(&mut self, n: usize, stretch: &low::Stretch<L>) {
        let certain = L::splat(1.0).only(stretch.certain);
        self.put(
            n,
            BEGIN,
            [stretch.start, stretch.low, stretch.high, certain],
        );
    }

    #[inline(always)]
    pub fn stretch<L: Lane>(&self, n: usize) -> low::Stretch<L> {
        let [start, low, high, certain] = self.get(n, BEGIN);
        low::Stretch {
            start,
            low,
            high,
            certain: L::splat(0.0).below(certain),
        }
    }

    /// The stretch of one lane of register `n`.
    #[inline(always)]
    pub fn stretch_of<L: Lane>(&self, n: usize, lane: usize) -> low::Stretch<f64> {
        let [start, low, high, certain] =
            [0, 1, 2, 3].map(|m| self.0.0[(n * QUANTITIES + BEGIN + m) * L::WIDTH + lane]);
        low::Stretch {
            start,
            low,
            high,
            certain: Lane::below(0.0, certain),
        }
    }

    #[inline(always)]
    pub fn put_guess<L: Lane>(&mut self, n: usize, guess: L) {
        self.put(n, CLOSE, [guess]);
    }

    #[inline(always)]
    pub fn guess<L: Lane>(&self, n: usize) -> L {
        let [guess] = self.get(n, CLOSE);
        guess
    }

    #[inline(always)]
    pub fn put_close<L: Lane>(&mut self, n: usize, close: &Close<L>) {
        self.put(n, CLOSE, [close.rounded, close.back]);
    }

    #[inline(always)]
    pub fn close<L: Lane>(&self, n: usize) -> Close<L> {
        let [rounded, back] = self.get(n, CLOSE);
        Close { rounded, back }
    }

    #[inline(always)]
    pub fn put_near<L: Lane>(&mut self, n: usize, near: &Near<L>) {
        let Near {
            node,
            back,
            x,
            value,
            slope,
            sine,
            cosine,
        } = *near;
        let at = [node.sine, node.cosine, node.rounded, node.distance];
        self.put(n, NEAR, at);
        self.put(n, NEAR + at.len(), [back, x, value, slope, sine, cosine]);
    }

    #[inline(always)]
    pub fn near<L: Lane>(&self, n: usize) -> Near<L> {
        let node = self.node(n);
        let [back, x, value, slope, sine, cosine] = self.get(n, NEAR + 4);
        Near {
            node,
            back,
            x,
            value,
            slope,
            sine,
            cosine,
        }
    }

    #[inline(always)]
    pub fn node<L: Lane>(&self, n: usize) -> Node<L> {
        let [sine, cosine, rounded, distance] = self.get(n, NEAR);
        Node {
            sine,
            cosine,
            rounded,
            distance,
        }
    }

    #[inline(always)]
    pub fn put_landing<L: Lane>(&mut self, n: usize, landing: &Landing<L>) {
        let Landing {
            flight,
            phase,
            arrival,
        } = *landing;
        self.put(n, LANDING, [flight, phase, arrival]);
    }

    #[inline(always)]
    pub fn landing<L: Lane>(&self, n: usize) -> Landing<L> {
        let [flight, phase, arrival] = self.get(n, LANDING);
        Landing {
            flight,
            phase,
            arrival,
        }
    }

    /// Replaces the landing of one lane of register `n`.
    #[inline(always)]
    pub fn replace_landing<L: Lane>(&mut self, n: usize, lane: usize, landing: &Landing<f64>) {
        let Landing {
            flight,
            phase,
            arrival,
        } = *landing;
        for (m, value) in [flight, phase, arrival].into_iter().enumerate() {
            self.0.0[(n * QUANTITIES + LANDING + m) * L::WIDTH + lane] = value;
        }
    }
}
