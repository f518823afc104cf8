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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn low_restitution_reaches_the_lower_part_of_the_band() {
        // Locks below 0.41136 except for slivers, in patches up to 0.4179
        // (docs/theory-capture.md#t7.2). The grid starts above k2, where the convergence is too
        // slow to detect.
        let actual = Reach::measure(0.394, 0.42, &[0.2], 1, 2600).unwrap();
        let edge = actual.edge.unwrap();
        assert!((edge - 0.409_385).abs() < 1e-6, "{actual:?}");
        assert!(!locks_from_rest(0.409_395, 0.2, 1).unwrap());
        let highest = actual.highest.unwrap();
        assert!((highest - 0.417_865).abs() < 1e-6, "{actual:?}");
        let solid = Reach::measure(0.394, 0.411_36, &[0.2], 1, 1000).unwrap();
        assert!(solid.share > 0.998, "{solid:?}");
        let beyond = Reach::measure(0.411_36, 0.4179, &[0.2], 1, 400).unwrap();
        assert!(beyond.share < 0.9, "{beyond:?}");
    }
}
