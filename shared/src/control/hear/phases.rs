//! What the impacts heard say together: circular statistics of their phases.

use super::lock::LockWindow;
use super::signal::Cycle;
use crate::arithmetic::{Phase, sine_cosine_single, square_root_single};
use crate::control::angle::radians_of;

/// Circular statistics of the phases at which parts strike, with a memory of some cycles.
///
/// Phases are the track's own (symbol t): the stamp of the impact plus the track's lead. Locked parts
/// strike at one phase, however many they are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhaseStatistics {
    sine: f32,
    cosine: f32,
    /// Impacts in memory.
    weight: f32,
    /// Cycles in memory.
    cycles: f32,
    /// Impacts in memory that struck where a lock would.
    at_lock: f32,
    /// Cycles in memory in which one did, by their number modulo the lock's order, and the last of them.
    struck: [f32; ORDERS],
    last: u32,
    /// Sum of how far from the lock's phase they struck, in rad, every other one negative.
    swing: f32,
}

/// Half of the difference between strikes in turn, in rad, from which a lock is doubted, and over which it is no lock at all:
/// what a lot holds alternates by 0.01 (jitter of 0.05 rad in the mean of the memory), flights that have doubled just beyond
/// it (R 0.255 where the lot ends at 0.22) by 0.13. With twice as much `doubled_flights_within_the_window_are_no_lock`
/// fails.
const UNEVEN: [f32; 2] = [0.04, 0.24];

/// Share of a memory of sixteen cycles that one of them has, or lacks.
const GAP: f32 = 0.1;
/// Highest order of a lock.
const ORDERS: usize = 8;

/// Share of the memory that a cycle leaves: 16 cycles. Tuned: with 8 or 32 cycles
/// `the_table_is_what_the_controller_does` fails.
const KEEP: f32 = 1.0 - 1.0 / 16.0;

impl PhaseStatistics {
    /// Adds the impacts of the cycle of a number with the track's lead; `lock` says at which phase and how far around it a
    /// locked part would strike, and in which order.
    pub fn cycle(&mut self, cycle: &Cycle, count: u32, lead: Phase, lock: Option<&LockWindow>) {
        for sum in [
            &mut self.sine,
            &mut self.cosine,
            &mut self.weight,
            &mut self.cycles,
            &mut self.at_lock,
            &mut self.swing,
        ] {
            *sum *= KEEP;
        }
        for sum in &mut self.struck {
            *sum *= KEEP;
        }
        self.cycles += 1.0;
        for heard in &cycle.heard {
            let phase = heard.phase + lead;
            let (sine, cosine) = sine_cosine_single(phase);
            self.sine += sine;
            self.cosine += cosine;
            self.weight += 1.0;
            if let Some(lock) = lock {
                let apart = radians_of(phase - lock.phase);
                if apart > -lock.width && apart < lock.width {
                    self.at_lock += 1.0;
                    let number = self.strike(count, heard.phase, lead, lock);
                    self.swing += if number & 1 == 0 { apart } else { -apart };
                }
            }
        }
    }

    /// A strike where a lock has it: parts of order r strike in every r-th cycle, not in as many of them. The number of the
    /// flight that ends with it.
    fn strike(&mut self, count: u32, phase: Phase, lead: Phase, lock: &LockWindow) -> u32 {
        let time = (u64::from(count) << 32 | u64::from(phase.bits()))
            .wrapping_add_signed(i64::from(lead.bits() as i32));
        // Cycles that begin half a turn before the lock's phase.
        let begun = time.wrapping_sub(u64::from(lock.phase.bits())) + (1 << 31);
        let number = (begun >> 32) as u32;
        let order = u32::from(lock.order.max(1));
        if number != self.last
            && let Some(sum) = self.struck.get_mut((number % order) as usize)
        {
            *sum += 1.0;
            self.last = number;
        }
        number / order
    }

    /// How little the strikes where a lock has them alternate, 1 and less: flights that have doubled strike before and behind
    /// the lock's phase in turn. Of parts that have doubled out of step with each other it tells nothing, nor does anything else
    /// that is heard of them (docs/theory-capture.md#t7.6).
    fn evenness(&self) -> f32 {
        if self.at_lock <= 0.0 {
            return 1.0;
        }
        let swing = (self.swing / self.at_lock).abs();
        1.0 - (swing - UNEVEN[0]) / (UNEVEN[1] - UNEVEN[0])
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Impacts per cycle.
    #[must_use]
    pub fn rate(&self) -> f32 {
        if self.cycles > 0.0 {
            self.weight / self.cycles
        } else {
            0.0
        }
    }

    /// Mean phase of the impacts in rad, -pi..pi; 0 where none was heard.
    #[must_use]
    pub fn phase(&self) -> f32 {
        libm::atan2f(self.sine, self.cosine)
    }

    /// Concentration of the phases, 0 (spread over the turn) to 1 (one phase): the length of their mean
    /// resultant.
    #[must_use]
    pub fn concentration(&self) -> f32 {
        if self.weight > 0.0 {
            square_root_single(self.sine * self.sine + self.cosine * self.cosine) / self.weight
        } else {
            0.0
        }
    }

    /// Share of the impacts that struck where a lock would, 0..1.
    #[must_use]
    pub fn share_at_lock(&self) -> f32 {
        if self.weight > 0.0 {
            self.at_lock / self.weight
        } else {
            0.0
        }
    }

    /// Confidence that the parts are locked in `order`, 0..1: the least of the share of impacts at the
    /// lock's phase, of the impacts heard to the impacts due (in every r-th cycle; less what strikes in some of the others), of how
    /// evenly they strike, and of the memory that is filled.
    #[must_use]
    pub fn lock_confidence(&self, order: u8) -> f32 {
        let due = self.cycles / f32::from(order);
        if due <= 0.0 {
            return 0.0;
        }
        let often = if order > 1 {
            // What strikes in some of the other cycles, but not in all or none of them, is not locked.
            let shares = self.struck.iter().map(|sum| (sum / due).min(1.0));
            let most = shares.clone().fold(0.0_f32, f32::max);
            most - shares.fold(0.0, |most, share| (share.min(1.0 - share) - GAP).max(most))
        } else {
            self.at_lock / due
        };
        self.share_at_lock()
            .min(often)
            .min(self.cycles / 8.0)
            .min(self.evenness())
            .clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::angle::phase_of;
    use crate::control::hear::Heard;

    fn heard(phases: &[f32]) -> Cycle {
        let heard = phases.iter().map(|&phase| Heard {
            phase: phase_of(phase),
            strength: 1.0,
        });
        Cycle {
            heard: heard.collect(),
            ..Cycle::default()
        }
    }

    #[test]
    fn one_phase_is_concentrated_across_the_wrap_and_two_opposite_ones_are_not() {
        let mut one = PhaseStatistics::default();
        let mut two = PhaseStatistics::default();
        for n in 0..100 {
            let jitter = 0.02 * (n % 3 - 1) as f32;
            one.cycle(&heard(&[3.1 + 2.0 * jitter]), 0, phase_of(0.04), None);
            two.cycle(
                &heard(&[0.3 + jitter, 0.3 + core::f32::consts::PI]),
                0,
                Phase::ZERO,
                None,
            );
        }
        assert!(one.concentration() > 0.999);
        assert!((one.phase().abs() - 3.135).abs() < 0.01, "{}", one.phase());
        assert!(two.concentration() < 0.02);
        assert!((one.rate() - 1.0).abs() < 1e-3 && (two.rate() - 2.0).abs() < 1e-3);
    }

    #[test]
    fn a_lock_is_believed_no_sooner_than_half_of_the_memory_is_filled() {
        let lock = LockWindow {
            order: 1,
            k: 0.43,
            phase: phase_of(0.45),
            width: 0.3,
        };
        let mut statistics = PhaseStatistics::default();
        let mut before = 0.0;
        for n in 1..=8 {
            statistics.cycle(&heard(&[0.45]), n, Phase::ZERO, Some(&lock));
            let confidence = statistics.lock_confidence(1);
            assert!(
                confidence <= n as f32 / 8.0 && confidence > before,
                "{n}: {confidence}"
            );
            before = confidence;
        }
    }

    #[test]
    fn a_lock_is_believed_where_it_belongs_at_its_rate_and_not_elsewhere() {
        let run = |phases: &[&[f32]], order| {
            let lock = LockWindow {
                order,
                k: 0.43,
                phase: phase_of(0.45),
                width: 0.3,
            };
            let mut statistics = PhaseStatistics::default();
            for n in 0..60 {
                let cycle = heard(phases[n % phases.len()]);
                statistics.cycle(&cycle, n as u32, Phase::ZERO, Some(&lock));
            }
            statistics.lock_confidence(order)
        };
        assert!(run(&[&[0.5]], 1) > 0.99);
        assert!(run(&[&[0.5], &[]], 2) > 0.95);
        assert!(run(&[&[0.5], &[]], 1) < 0.6);
        // Two of three cycles are no lock of order 2, though as many are struck as one would; two groups of it are.
        assert!(run(&[&[0.5], &[0.5], &[]], 2) < 0.8);
        assert!(run(&[&[0.5], &[0.52]], 2) > 0.95);
        assert!(run(&[&[5.6]], 1) == 0.0);
        assert!(run(&[&[0.5, 5.6]], 1) < 0.6);
        assert!(run(&[&[]], 1) == 0.0);
    }

    #[test]
    fn doubled_flights_within_the_window_are_no_lock() {
        let run = |order: u8, apart: f32, jitter: f32| {
            let lock = LockWindow {
                order,
                k: 0.43,
                phase: phase_of(0.45),
                width: 0.4,
            };
            let mut statistics = PhaseStatistics::default();
            let mut worst = (1.0_f32, 0.0_f32);
            for n in 0..400_u32 {
                let flight = n / u32::from(order);
                let side = if flight % 2 == 0 { apart } else { -apart };
                // Evenly spread, of the standard deviation asked for.
                let even = (n.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
                let phase = 0.55 + side + jitter * 3.0_f32.sqrt() * (2.0 * even - 1.0);
                let struck = [phase];
                let struck = if n % u32::from(order) == 0 {
                    &struck[..]
                } else {
                    &[]
                };
                statistics.cycle(&heard(struck), n, Phase::ZERO, Some(&lock));
                if n > 40 {
                    let confidence = statistics.lock_confidence(order);
                    worst = (worst.0.min(confidence), worst.1.max(confidence));
                }
            }
            worst
        };
        // Heard with a jitter of 0.05 rad: a lock is always believed, flights doubled as those of R 0.255 and 0.26 at the
        // setpoint of 0.18..0.22 never are, and are no longer.
        for order in [1, 2, 3] {
            assert!(run(order, 0.0, 0.05).0 > 0.9, "{:?}", run(order, 0.0, 0.05));
            assert!(
                run(order, 0.133, 0.0).1 < 0.6,
                "{:?}",
                run(order, 0.133, 0.0)
            );
            assert!(
                run(order, 0.208, 0.05).1 < 0.6,
                "{:?}",
                run(order, 0.208, 0.05)
            );
        }
    }
}
