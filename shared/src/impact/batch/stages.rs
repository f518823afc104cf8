//! What the stages of the kernels hand on: register by register, dense.

use super::columns::Aligned;
use crate::arithmetic::lane::Lane;
use crate::impact::flight::{Landing, Launch, Track, low, tall};

/// Lanes that go through the stages together.
pub(super) const ROOM: usize = 128;

/// What the stages hand on.
#[derive(Clone, Debug)]
pub(super) struct Stages {
    launch: [Aligned<ROOM>; 4],
    track: [Aligned<ROOM>; 3],
    /// Where the first stage takes the flight: a crossing, or a stretch.
    begin: [Aligned<ROOM>; 4],
    close: Aligned<ROOM>,
    landing: [Aligned<ROOM>; 3],
}

impl Stages {
    pub const EMPTY: Self = Self {
        launch: [Aligned::ZERO; 4],
        track: [Aligned::ZERO; 3],
        begin: [Aligned::ZERO; 4],
        close: Aligned::ZERO,
        landing: [Aligned::ZERO; 3],
    };

    #[inline(always)]
    pub fn put_launch<L: Lane>(&mut self, n: usize, launch: &Launch<L>) {
        let Launch {
            phase,
            velocity,
            sine,
            cosine,
        } = *launch;
        put(&mut self.launch, n, [phase, velocity, sine, cosine]);
    }

    #[inline(always)]
    pub fn launch<L: Lane>(&self, n: usize) -> Launch<L> {
        let [phase, velocity, sine, cosine] = get(&self.launch, n);
        Launch {
            phase,
            velocity,
            sine,
            cosine,
        }
    }

    #[inline(always)]
    pub fn put_track<L: Lane>(&mut self, n: usize, track: &Track<L>) {
        put(&mut self.track, n, [track.k, track.per_k, track.edge]);
    }

    #[inline(always)]
    pub fn track<L: Lane>(&self, n: usize) -> Track<L> {
        let [k, per_k, edge] = get(&self.track, n);
        Track {
            k,
            per_k,
            edge,
            edge_cosine: Track::edge_cosine(k),
        }
    }

    #[inline(always)]
    pub fn put_crossing<L: Lane>(&mut self, n: usize, crossing: &tall::Crossing<L>) {
        let [time, speed, ..] = &mut self.begin;
        crossing.time.store(&mut time.0, n * L::WIDTH);
        crossing.speed.store(&mut speed.0, n * L::WIDTH);
    }

    #[inline(always)]
    pub fn crossing<L: Lane>(&self, n: usize) -> tall::Crossing<L> {
        let [time, speed, ..] = get(&self.begin, n);
        tall::Crossing { time, speed }
    }

    #[inline(always)]
    pub fn put_stretch<L: Lane>(&mut self, n: usize, stretch: &low::Stretch<L>) {
        let certain = L::splat(1.0).only(stretch.certain);
        put(
            &mut self.begin,
            n,
            [stretch.start, stretch.low, stretch.high, certain],
        );
    }

    #[inline(always)]
    pub fn stretch<L: Lane>(&self, n: usize) -> low::Stretch<L> {
        let [start, low, high, certain] = get(&self.begin, n);
        low::Stretch {
            start,
            low,
            high,
            certain: L::splat(0.0).below(certain),
        }
    }

    #[inline(always)]
    pub fn put_close<L: Lane>(&mut self, n: usize, close: L) {
        close.store(&mut self.close.0, n * L::WIDTH);
    }

    #[inline(always)]
    pub fn close<L: Lane>(&self, n: usize) -> L {
        L::load(&self.close.0, n * L::WIDTH)
    }

    #[inline(always)]
    pub fn put_landing<L: Lane>(&mut self, n: usize, landing: &Landing<L>) {
        let Landing {
            flight,
            phase,
            arrival,
        } = *landing;
        put(&mut self.landing, n, [flight, phase, arrival]);
    }

    #[inline(always)]
    pub fn landing<L: Lane>(&self, n: usize) -> Landing<L> {
        let [flight, phase, arrival] = get(&self.landing, n);
        Landing {
            flight,
            phase,
            arrival,
        }
    }

    /// Replaces the landing of one lane.
    pub fn replace_landing(&mut self, lane: usize, landing: &Landing<f64>) {
        put(
            &mut self.landing,
            lane,
            [landing.flight, landing.phase, landing.arrival],
        );
    }
}

#[inline(always)]
fn put<L: Lane, const N: usize>(columns: &mut [Aligned<ROOM>; N], n: usize, values: [L; N]) {
    for (column, value) in columns.iter_mut().zip(values) {
        value.store(&mut column.0, n * L::WIDTH);
    }
}

#[inline(always)]
fn get<L: Lane, const N: usize>(columns: &[Aligned<ROOM>; N], n: usize) -> [L; N] {
    columns
        .each_ref()
        .map(|column| L::load(&column.0, n * L::WIDTH))
}
