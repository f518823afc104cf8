//! Circular statistics of the impacts' phases: mean direction and mean resultant length.
//!
//! Source: Fisher, Statistical Analysis of Circular Data, 1993. Sums forget exponentially.

use super::signal::Cycle;
use crate::angle::{impact_time, radians_of};
use kband::arithmetic::{Phase, sine_cosine_single, square_root_single};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LockWindow {
    /// Drive cycles per impact (symbol r).
    pub order: u8,
    pub k: f64,
    pub phase: Phase,
    /// Half width of the window, in rad.
    pub width: f32,
}

/// Circular statistics of the impacts' phases, with a memory of 16 cycles.
///
/// Phases are the track's own (symbol t): the stamp of the impact plus the track's lead.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhaseStatistics {
    sine: f32,
    cosine: f32,
    weight: f32,
    cycles: f32,
    at_lock: f32,
    /// Weight of the cycles with such an impact, by their number modulo the order.
    cycles_by_remainder: [f32; MAX_ORDER],
    /// Number of the last such cycle.
    last: u32,
    /// Sum of the phase differences to the lock in rad, with alternating sign.
    alternating_sum: f32,
}

/// Half difference of alternate impact phases, in rad, where the confidence begins to fall, and
/// where it is 0. A locked lot alternates by 0.01, flights just beyond the doubling by 0.13.
const ALTERNATION_BOUNDS: [f32; 2] = [0.04, 0.24];
/// Tolerance of the share of cycles with an impact: one cycle of the memory of sixteen.
const CYCLE_TOLERANCE: f32 = 0.1;
/// Highest order of a lock.
const MAX_ORDER: usize = 8;
/// Forgetting factor per drive cycle: memory of 16 cycles.
const FORGETTING_FACTOR: f32 = 1.0 - 1.0 / 16.0;

pub fn share_of(part: f32, whole: f32) -> f32 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

impl PhaseStatistics {
    /// Adds the impacts of cycle number `count`, with the track's lead and the window of the lock.
    pub fn cycle(&mut self, cycle: &Cycle, count: u32, lead: Phase, lock: Option<&LockWindow>) {
        let sums = [
            &mut self.sine,
            &mut self.cosine,
            &mut self.weight,
            &mut self.cycles,
            &mut self.at_lock,
            &mut self.alternating_sum,
        ];
        for sum in sums.into_iter().chain(&mut self.cycles_by_remainder) {
            *sum *= FORGETTING_FACTOR;
        }
        self.cycles += 1.0;
        for impact in &cycle.impacts {
            let phase = impact.phase + lead;
            let (sine, cosine) = sine_cosine_single(phase);
            self.sine += sine;
            self.cosine += cosine;
            self.weight += 1.0;
            if let Some(lock) = lock {
                let difference = radians_of(phase - lock.phase);
                if difference > -lock.width && difference < lock.width {
                    self.at_lock += 1.0;
                    let time = impact_time(count, impact.phase, lead);
                    let number = self.add_impact_in_window(time, lock);
                    let even = number & 1 == 0;
                    self.alternating_sum += if even { difference } else { -difference };
                }
            }
        }
    }

    /// Counts an impact within the lock's window; returns the number of the flight that it ends.
    fn add_impact_in_window(&mut self, time: u64, lock: &LockWindow) -> u32 {
        // Cycles that begin half a turn before the lock's phase.
        let shifted = time.wrapping_sub(u64::from(lock.phase.bits())) + (1 << 31);
        let number = (shifted >> 32) as u32;
        let order = u32::from(lock.order.max(1));
        if number != self.last
            && let Some(sum) = self.cycles_by_remainder.get_mut((number % order) as usize)
        {
            *sum += 1.0;
            self.last = number;
        }
        number / order
    }

    /// Confidence from alternation, up to 1: doubled flights strike before and after the lock's
    /// phase in turn. Parts doubled out of step stay undetected (docs/theory-capture.md#t7.6).
    fn alternation_confidence(&self) -> f32 {
        if self.at_lock <= 0.0 {
            return 1.0;
        }
        let alternation = (self.alternating_sum / self.at_lock).abs();
        1.0 - (alternation - ALTERNATION_BOUNDS[0])
            / (ALTERNATION_BOUNDS[1] - ALTERNATION_BOUNDS[0])
    }

    /// Mean number of impacts per cycle.
    pub fn rate(&self) -> f32 {
        share_of(self.weight, self.cycles)
    }

    /// Mean phase of the impacts in rad, -pi..pi; 0 without any impact.
    pub fn phase(&self) -> f32 {
        libm::atan2f(self.sine, self.cosine)
    }

    /// Mean cosine of the phases, -1..1; 0 without any impact.
    pub fn mean_cosine(&self) -> f32 {
        share_of(self.cosine, self.weight)
    }

    /// Concentration of the phases: mean resultant length, 0 (uniform) to 1 (one phase).
    pub fn concentration(&self) -> f32 {
        let square = self.sine * self.sine + self.cosine * self.cosine;
        share_of(square_root_single(square), self.weight)
    }

    /// Confidence that the parts are locked in `order`, 0..1: the smallest of four values. They are
    /// the share of impacts in the window, detected over due impacts, evenness, and filled memory.
    pub fn lock_confidence(&self, order: u8) -> f32 {
        let expected = self.cycles / f32::from(order);
        if expected <= 0.0 {
            return 0.0;
        }
        let filled_share = if order > 1 {
            // Impacts in part of the other cycles, but not in all or none, contradict a lock.
            let shares = (self.cycles_by_remainder.iter()).map(|sum| (sum / expected).min(1.0));
            let largest = shares.clone().fold(0.0_f32, f32::max);
            largest
                - shares.fold(0.0, |largest, share| {
                    (share.min(1.0 - share) - CYCLE_TOLERANCE).max(largest)
                })
        } else {
            self.at_lock / expected
        };
        share_of(self.at_lock, self.weight)
            .min(filled_share)
            .min(self.cycles / 8.0)
            .min(self.alternation_confidence())
            .clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::phase_of;
    use crate::hear::DetectedImpact;
    use crate::testing::with;

    #[test]
    fn lock_needs_its_phase_and_rate() {
        let run = |phases: &[&[f32]], order| {
            let lock = LockWindow {
                order,
                k: 0.43,
                phase: phase_of(0.45),
                width: 0.3,
            };
            let mut statistics = PhaseStatistics::default();
            for n in 0..60 {
                let impacts = phases[n % phases.len()].iter().map(|phase| DetectedImpact {
                    phase: phase_of(*phase),
                    strength: 1.0,
                });
                let cycle = with(Cycle::default(), |it| it.impacts = impacts.collect());
                statistics.cycle(&cycle, n as u32, Phase::ZERO, Some(&lock));
            }
            statistics.lock_confidence(order)
        };
        assert!(run(&[&[0.5]], 1) > 0.99);
        assert!(run(&[&[0.5], &[]], 2) > 0.95);
        assert!(run(&[&[0.5], &[]], 1) < 0.6);
        // Impacts in two of three cycles are no lock of order 2; two groups of parts are one.
        assert!(run(&[&[0.5], &[0.5], &[]], 2) < 0.8);
        assert!(run(&[&[0.5], &[0.52]], 2) > 0.95);
        assert!(run(&[&[5.6]], 1) == 0.0);
        assert!(run(&[&[0.5, 5.6]], 1) < 0.6);
        assert!(run(&[&[]], 1) == 0.0);
    }
}
