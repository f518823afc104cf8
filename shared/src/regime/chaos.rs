//! The chaotic band below a cascade, measured.

use super::cascade::Cascade;
use super::exponent::{self, Dynamics, ExponentSettings};
use crate::feeder::{OutOfRange, accept};
use crate::impact::{Kernel, Map};

/// A band of k below the cascade in which parts hop on without ever coming to rest, mostly chaotically.
///
/// It is measured, not derived: no rest within the impacts that were spent, exponent above zero by three
/// standard errors. Below it the hopping is transient and parts end at rest and relaunch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChaoticBand {
    /// Lowest k at which no rest was seen.
    pub low: f64,
    /// Where the doublings accumulate (k_infinity).
    pub high: f64,
    /// Share of the k tried in it whose exponent is positive; the rest are periodic windows.
    pub chaotic: f64,
    /// Step of k.
    pub step: f64,
    /// Impacts spent at each k.
    pub impacts: u32,
}

/// Steps that must end at rest before the band is taken to be over. With 1 to 5 every test passes.
const GONE: u32 = 3;

impl ChaoticBand {
    /// Walks down from k_infinity in steps of `step` (fraction of k, 1e-5..=0.1), `impacts` (320..=1e9) at
    /// each, until three steps running come to rest; `None` where the first ones do.
    pub fn measure(
        restitution: f64,
        order: u32,
        step: f64,
        impacts: u32,
    ) -> Result<Option<Self>, OutOfRange> {
        accept("step", step, (1e-5..=0.1).contains(&step), "0.00001..0.1")?;
        let Some(limit) = Cascade::locate(restitution, order, 6)?.k_infinity() else {
            return Ok(None);
        };
        let step = step * limit.value;
        let mut band = Self {
            low: f64::NAN,
            high: limit.value,
            chaotic: 0.0,
            step,
            impacts,
        };
        let (mut alive, mut chaotic, mut gone) = (0_u32, 0_u32, 0_u32);
        for n in 0..=100_000_u32 {
            let k = limit.value - (f64::from(n) + 0.5) * step;
            if gone == GONE || k < 0.01 {
                break;
            }
            let map = Map::build(k, restitution)?;
            let settings = ExponentSettings {
                settle: 1000,
                impacts,
            };
            let found = exponent::measure(&map, exponent::start(&map, order), settings)?;
            match found.dynamics {
                Dynamics::Rest { .. } => gone += 1,
                dynamics => {
                    gone = 0;
                    alive += 1;
                    chaotic += u32::from(dynamics == Dynamics::Chaotic);
                    band.low = k;
                }
            }
        }
        if alive == 0 {
            return Ok(None);
        }
        band.chaotic = f64::from(chaotic) / f64::from(alive);
        Ok(Some(band))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_band_is_as_narrow_as_the_design_says() {
        // docs/theory-bands.md#t6.3: at R = 0.2 it ends near k = 0.33, at R = 0.5 near 0.57. The edge is a
        // crisis: the transient below it lengthens towards it, so it is known to a few steps.
        for (restitution, edge, within) in [(0.2, 0.33, 0.008), (0.5, 0.57, 0.008)] {
            let band = ChaoticBand::measure(restitution, 1, 0.005, 6400)
                .unwrap()
                .unwrap();
            assert!((band.low - edge).abs() < within, "{band:?}");
            assert!(band.chaotic > 0.5, "{band:?}");
        }
    }

    #[test]
    fn refusals_name_the_parameter() {
        let refused = ChaoticBand::measure(0.2, 1, 0.2, 6400).unwrap_err();
        assert_eq!(refused.parameter, "step");
    }
}
