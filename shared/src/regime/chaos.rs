//! Chaotic band below a cascade, measured by a scan over k with the Lyapunov exponent
//! (docs/theory-bands.md#t6.3).

use super::cascade::Cascade;
use super::exponent::{self, Dynamics, ExponentSettings};
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::{Kernel, Map};

/// Band of k below the cascade in which parts hop without rest within the simulated impacts, mostly
/// chaotically. Below it the hopping is transient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChaoticBand {
    /// Lowest k without a rest.
    pub low: f64,
    /// Accumulation point of the doublings (k_infinity).
    pub high: f64,
    /// Share of the scanned k with an exponent above 0 by three standard errors; the others are
    /// periodic windows.
    pub chaotic: f64,
    /// Impacts simulated at each k.
    pub impacts: u32,
}

const MAX_STEPS_WITH_REST: u32 = 3;

impl ChaoticBand {
    /// Scans down from k_infinity in steps of `step` (fraction of k, 1e-5..=0.1) with `impacts`
    /// (320..=1e9) each, up to three successive ones with a rest. `None` if each has one.
    pub fn measure(
        restitution: f64,
        order: u32,
        step: f64,
        impacts: u32,
    ) -> Result<Option<Self>, OutOfRange> {
        accept_in("step", step, 1e-5..=0.1, "0.00001..0.1")?;
        let Some(limit) = Cascade::locate(restitution, order, 6)?.k_infinity() else {
            return Ok(None);
        };
        let step = step * limit.value;
        let mut band = Self {
            low: f64::NAN,
            high: limit.value,
            chaotic: 0.0,
            impacts,
        };
        let (mut steps_without_rest, mut chaotic, mut steps_with_rest) = (0_u32, 0_u32, 0_u32);
        for n in 0..=100_000_u32 {
            let k = limit.value - (f64::from(n) + 0.5) * step;
            if steps_with_rest == MAX_STEPS_WITH_REST || k < 0.01 {
                break;
            }
            let map = Map::build(k, restitution)?;
            let settle = 1000;
            let settings = ExponentSettings { settle, impacts };
            let found = exponent::measure(&map, exponent::start_near_lock(&map, order), settings)?;
            match found.dynamics {
                Dynamics::Rest { .. } => steps_with_rest += 1,
                dynamics => {
                    steps_with_rest = 0;
                    steps_without_rest += 1;
                    chaotic += u32::from(dynamics == Dynamics::Chaotic);
                    band.low = k;
                }
            }
        }
        if steps_without_rest == 0 {
            return Ok(None);
        }
        band.chaotic = f64::from(chaotic) / f64::from(steps_without_rest);
        Ok(Some(band))
    }
}
