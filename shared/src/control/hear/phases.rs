//! What the impacts heard say together: circular statistics of their phases.

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
}

/// Share of the memory that a cycle leaves: 16 cycles. Tuned: with 8 or 32 cycles
/// `the_table_is_what_the_controller_does` fails.
const KEEP: f32 = 1.0 - 1.0 / 16.0;

impl PhaseStatistics {
    /// Adds the impacts of one cycle with the track's lead; `lock` is the phase at which a locked part
    /// would strike and the half width around it that counts, in rad.
    pub fn cycle(&mut self, cycle: &Cycle, lead: Phase, lock: Option<(Phase, f32)>) {
        for sum in [
            &mut self.sine,
            &mut self.cosine,
            &mut self.weight,
            &mut self.cycles,
            &mut self.at_lock,
        ] {
            *sum *= KEEP;
        }
        self.cycles += 1.0;
        for heard in &cycle.heard {
            let phase = heard.phase + lead;
            let (sine, cosine) = sine_cosine_single(phase);
            self.sine += sine;
            self.cosine += cosine;
            self.weight += 1.0;
            if let Some((centre, width)) = lock {
                let apart = radians_of(phase - centre);
                if apart > -width && apart < width {
                    self.at_lock += 1.0;
                }
            }
        }
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
    /// lock's phase, of the impacts heard to the impacts due, and of the memory that is filled.
    #[must_use]
    pub fn lock_confidence(&self, order: u8) -> f32 {
        let due = self.cycles / f32::from(order);
        if due <= 0.0 {
            return 0.0;
        }
        self.share_at_lock()
            .min(self.at_lock / due)
            .min(self.cycles / 8.0)
            .min(1.0)
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
            one.cycle(&heard(&[3.1 + 2.0 * jitter]), phase_of(0.04), None);
            two.cycle(
                &heard(&[0.3 + jitter, 0.3 + core::f32::consts::PI]),
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
    fn a_lock_is_believed_where_it_belongs_at_its_rate_and_not_elsewhere() {
        let lock = Some((phase_of(0.45), 0.3));
        let run = |phases: &[&[f32]], order| {
            let mut hearing = PhaseStatistics::default();
            for n in 0..60 {
                hearing.cycle(&heard(phases[n % phases.len()]), Phase::ZERO, lock);
            }
            hearing.lock_confidence(order)
        };
        assert!(run(&[&[0.5]], 1) > 0.99);
        assert!(run(&[&[0.5], &[]], 2) > 0.95);
        assert!(run(&[&[0.5], &[]], 1) < 0.6);
        assert!(run(&[&[5.6]], 1) == 0.0);
        assert!(run(&[&[0.5, 5.6]], 1) < 0.6);
        assert!(run(&[&[]], 1) == 0.0);
    }
}
