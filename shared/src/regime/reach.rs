//! Range of a band in which a part from rest locks, by simulation on a grid of k
//! (docs/theory-capture.md#t7.2).

use super::lock::Lock;
use crate::feeder::OutOfRange;
use crate::impact::{Kernel, Map, Orbit, OrbitEvent};

/// Whether a part from rest at `k` locks in `order` within 5000 events.
fn locks_from_rest(k: f64, restitution: f64, order: u32) -> Result<bool, OutOfRange> {
    let lock = Lock::build(k, restitution, order)?.filter(Lock::attracts);
    let map = Map::build(k, restitution)?;
    for event in Orbit::from_rest(&map).take(5000) {
        match event {
            OrbitEvent::LiftOff { .. } => {}
            // Each rest leads to the same orbit, so the part never locks.
            OrbitEvent::Rest { .. } => return Ok(false),
            OrbitEvent::Impact(impact) => {
                if lock.is_some_and(|lock| lock.distance(impact.next) < 1e-3) {
                    return Ok(true);
                }
            }
        }
    }
    Ok(false)
}

/// Range of a band in which a part from rest locks, on a grid of k.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Highest k of the unbroken range from the low edge that locks; `None` without any.
    pub edge: Option<f64>,
    /// Highest k of the grid that locks; `None` without any.
    pub highest: Option<f64>,
    /// Share of the grid that locks, 0..=1.
    pub share: f64,
    /// Step of the grid.
    pub step: f64,
}

impl Reach {
    /// Simulates at `samples` (at least 1) equidistant k inside `low..high`, with every restitution
    /// of `parts`. A k counts if all parts lock.
    pub fn measure(
        low: f64,
        high: f64,
        parts: &[f64],
        order: u32,
        samples: u32,
    ) -> Result<Self, OutOfRange> {
        let samples = samples.max(1);
        let step = (high - low) / f64::from(samples);
        let mut reach = Self {
            edge: None,
            highest: None,
            share: 0.0,
            step,
        };
        let mut unbroken = true;
        let mut locked = 0_u32;
        for sample in 0..samples {
            let k = low + (f64::from(sample) + 0.5) * step;
            let lock = |all, part: &f64| Ok(all && locks_from_rest(k, *part, order)?);
            let all = parts.iter().try_fold(true, lock)?;
            unbroken &= all;
            locked += u32::from(all);
            reach.highest = if all { Some(k) } else { reach.highest };
            reach.edge = if unbroken { Some(k) } else { reach.edge };
        }
        reach.share = f64::from(locked) / f64::from(samples);
        Ok(reach)
    }
}
