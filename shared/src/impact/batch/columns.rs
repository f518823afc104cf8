//! The orbits of a block as columns, one per quantity (structure of arrays).

use super::lanes::LANES;
use crate::arithmetic::lane::{Lane, MAX_LANES};
use crate::impact::double::launch::{Launch, Track};

/// One quantity of many orbits, aligned to a cache line, so that no register spans two.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub(super) struct Aligned<const N: usize>(pub [f64; N]);

impl<const N: usize> Aligned<N> {
    pub const ZERO: Self = Self([0.0; N]);
}

/// The columns of a block.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    phase: Aligned<LANES>,
    velocity: Aligned<LANES>,
    sine: Aligned<LANES>,
    cosine: Aligned<LANES>,
    flight: Aligned<LANES>,
    k: Aligned<LANES>,
    per_k: Aligned<LANES>,
    lift_off: Aligned<LANES>,
    restitution: Aligned<LANES>,
}

impl Columns {
    pub const ZERO: Self = Self {
        phase: Aligned::ZERO,
        velocity: Aligned::ZERO,
        sine: Aligned::ZERO,
        cosine: Aligned::ZERO,
        flight: Aligned::ZERO,
        k: Aligned::ZERO,
        per_k: Aligned::ZERO,
        lift_off: Aligned::ZERO,
        restitution: Aligned::ZERO,
    };

    /// Puts a lane on a track.
    pub fn put(&mut self, lane: usize, track: &Track<f64>, restitution: f64) {
        self.k.0[lane] = track.k;
        self.per_k.0[lane] = track.per_k;
        self.lift_off.0[lane] = track.lift_off;
        self.restitution.0[lane] = restitution;
    }

    /// Sets phase and velocity of a lane; its sine and cosine are computed later.
    pub fn start(&mut self, lane: usize, phase: f64, velocity: f64) {
        self.phase.0[lane] = phase;
        self.velocity.0[lane] = velocity;
        self.flight.0[lane] = 0.0;
    }

    /// Phase and velocity of a lane.
    pub fn state(&self, lane: usize) -> [f64; 2] {
        [self.phase.0[lane], self.velocity.0[lane]]
    }

    /// The last flight of a lane.
    pub fn flight(&self, lane: usize) -> f64 {
        self.flight.0[lane]
    }

    /// The launches of a register of neighbouring lanes.
    #[inline(always)]
    pub fn launch_at<L: Lane>(&self, at: usize) -> Launch<L> {
        Launch {
            phase: L::load(&self.phase.0, at),
            velocity: L::load(&self.velocity.0, at),
            sine: L::load(&self.sine.0, at),
            cosine: L::load(&self.cosine.0, at),
        }
    }

    /// The launches of a register of neighbouring lanes.
    ///
    /// Computes and stores sine and cosine for the lanes of `which`.
    #[inline(always)]
    pub fn begin_at<L: Lane>(&mut self, at: usize, which: L::Mask) -> Launch<L> {
        let Launch {
            phase, velocity, ..
        } = self.launch_at::<L>(at);
        let launch = Launch::new(phase, velocity);
        launch.sine.store_where(which, &mut self.sine.0, at);
        launch.cosine.store_where(which, &mut self.cosine.0, at);
        launch
    }

    /// k of a register of neighbouring lanes: the only track constant of a tall flight after its
    /// crossing.
    #[inline(always)]
    pub fn track_at<L: Lane>(&self, at: usize) -> Track<L> {
        let k = L::load(&self.k.0, at);
        Track {
            k,
            per_k: L::load(&self.per_k.0, at),
            lift_off: L::load(&self.lift_off.0, at),
            lift_off_cosine: Track::lift_off_cosine(k),
        }
    }

    /// The restitutions of a register of neighbouring lanes.
    #[inline(always)]
    pub fn restitution_at<L: Lane>(&self, at: usize) -> L {
        L::load(&self.restitution.0, at)
    }

    /// Stores the landings of the lanes of `which` in a register of neighbouring lanes.
    #[inline(always)]
    pub fn land_at<L: Lane>(&mut self, at: usize, which: L::Mask, flight: L, next: &Launch<L>) {
        flight.store_where(which, &mut self.flight.0, at);
        next.phase.store_where(which, &mut self.phase.0, at);
        next.velocity.store_where(which, &mut self.velocity.0, at);
        next.sine.store_where(which, &mut self.sine.0, at);
        next.cosine.store_where(which, &mut self.cosine.0, at);
    }

    /// The launches of these lanes.
    #[inline(always)]
    pub fn launch<L: Lane>(&self, lanes: [u8; MAX_LANES]) -> Launch<L> {
        Launch {
            phase: L::pick(&self.phase.0, lanes),
            velocity: L::pick(&self.velocity.0, lanes),
            sine: L::pick(&self.sine.0, lanes),
            cosine: L::pick(&self.cosine.0, lanes),
        }
    }

    /// The tracks of these lanes.
    #[inline(always)]
    pub fn track<L: Lane>(&self, lanes: [u8; MAX_LANES]) -> Track<L> {
        let k = L::pick(&self.k.0, lanes);
        Track {
            k,
            per_k: L::pick(&self.per_k.0, lanes),
            lift_off: L::pick(&self.lift_off.0, lanes),
            lift_off_cosine: Track::lift_off_cosine(k),
        }
    }

    /// The restitutions of these lanes.
    #[inline(always)]
    pub fn restitution<L: Lane>(&self, lanes: [u8; MAX_LANES]) -> L {
        L::pick(&self.restitution.0, lanes)
    }

    /// Stores the landings of these lanes.
    #[inline(always)]
    pub fn land<L: Lane>(&mut self, lanes: [u8; MAX_LANES], flight: L, next: &Launch<L>) {
        scatter(flight, &mut self.flight, lanes);
        scatter(next.phase, &mut self.phase, lanes);
        scatter(next.velocity, &mut self.velocity, lanes);
        scatter(next.sine, &mut self.sine, lanes);
        scatter(next.cosine, &mut self.cosine, lanes);
    }
}

#[inline(always)]
fn scatter<L: Lane>(values: L, column: &mut Aligned<LANES>, lanes: [u8; MAX_LANES]) {
    let values = values.to_array();
    for (lane, value) in lanes.into_iter().zip(values).take(L::WIDTH) {
        column.0[usize::from(lane)] = value;
    }
}
