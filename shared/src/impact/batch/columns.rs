//! The orbits of a block as columns, one per quantity (structure of arrays).

use super::lanes::LANES;
use crate::arithmetic::vector::{MAX_LANES, Vector};
use crate::impact::double::launch::{Launch, Track};
use crate::impact::kernel::PartState;

/// One quantity of many orbits, aligned to a cache line, so that no register spans two.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub(super) struct Aligned<const N: usize>(pub [f64; N]);

impl<const N: usize> Aligned<N> {
    pub const ZERO: Self = Self([0.0; N]);
}

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

    pub fn state(&self, lane: usize) -> PartState {
        PartState::new(self.phase.0[lane], self.velocity.0[lane])
    }

    pub fn flight(&self, lane: usize) -> f64 {
        self.flight.0[lane]
    }

    #[inline(always)]
    pub fn states<V: Vector>(&self, lanes: [u8; MAX_LANES]) -> [V; 2] {
        [&self.phase, &self.velocity].map(|column| V::pick(&column.0, lanes))
    }

    #[inline(always)]
    pub fn launch<V: Vector>(&self, lanes: [u8; MAX_LANES]) -> Launch<V> {
        Launch {
            phase: V::pick(&self.phase.0, lanes),
            velocity: V::pick(&self.velocity.0, lanes),
            sine: V::pick(&self.sine.0, lanes),
            cosine: V::pick(&self.cosine.0, lanes),
        }
    }

    #[inline(always)]
    pub fn track<V: Vector>(&self, lanes: [u8; MAX_LANES]) -> Track<V> {
        let k = V::pick(&self.k.0, lanes);
        Track {
            k,
            per_k: V::pick(&self.per_k.0, lanes),
            lift_off: V::pick(&self.lift_off.0, lanes),
            lift_off_cosine: Track::lift_off_cosine(k),
        }
    }

    #[inline(always)]
    pub fn restitution<V: Vector>(&self, lanes: [u8; MAX_LANES]) -> V {
        V::pick(&self.restitution.0, lanes)
    }

    /// Stores the landings of the lanes whose bits are set.
    #[inline(always)]
    pub fn land<V: Vector>(
        &mut self,
        lanes: [u8; MAX_LANES],
        bits: u32,
        flight: V,
        next: &Launch<V>,
    ) {
        let landings = [
            (flight, &mut self.flight),
            (next.phase, &mut self.phase),
            (next.velocity, &mut self.velocity),
            (next.sine, &mut self.sine),
            (next.cosine, &mut self.cosine),
        ];
        for (values, column) in landings {
            let values = values.to_array();
            for (m, (lane, value)) in lanes.into_iter().zip(values).enumerate().take(V::WIDTH) {
                if bits >> m & 1 == 1 {
                    column.0[usize::from(lane)] = value;
                }
            }
        }
    }
}
