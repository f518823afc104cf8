//! Reference of the amplitude loop: a ramp, a first-order lag or a step, advanced once per cycle.

use core::f32::consts::TAU;

use crate::saturate::saturate;

/// Way of the reference to its goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Approach {
    /// By at most this much per cycle, in m.
    Ramp(f32),
    /// With the first-order lag of a kick.
    Lag,
    /// At once.
    Step,
}

/// The reference.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reference {
    /// Reference amplitude now, in m.
    pub now: f32,
    /// Command of the last cycle of a kick, in m.
    commanded: f32,
}

impl Reference {
    /// Advances one cycle towards a goal in m; `lead` in rad, `time_constant` of a kick in cycles.
    pub fn advance(&mut self, goal: f32, pace: Approach, lead: f32, time_constant: f32) {
        self.now = match pace {
            Approach::Step => goal,
            Approach::Ramp(rate) => self.now + saturate(goal - self.now, -rate, rate),
            Approach::Lag => self.after_a_cycle(goal, lead, time_constant),
        };
        self.commanded = goal;
    }

    /// The reference one cycle on, with the first-order lag of kicks. A kick's cycles begin at
    /// phase 0 of the track: the first part of the output's cycle still has the previous command.
    fn after_a_cycle(&self, goal: f32, lead: f32, time_constant: f32) -> f32 {
        let before = -lead * (1.0 / TAU);
        let before = before - libm::floorf(before);
        let along = |from: f32, to: f32, cycles: f32| {
            to + (from - to) * libm::expf(-cycles / time_constant)
        };
        let next = along(along(self.now, self.commanded, before), goal, 1.0 - before);
        // A last thousandth makes no difference to the parts.
        if (next - goal).abs() < 1e-3 * goal {
            goal
        } else {
            next
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lagging_track_keeps_the_previous_command() {
        // A quarter turn behind its output: a quarter of the cycle has the previous command.
        let quarter = -0.25 * TAU;
        let mut reference = Reference {
            now: 1.0,
            commanded: 1.0,
        };
        reference.advance(2.0, Approach::Lag, quarter, 5.0);
        let first = 2.0 - libm::expf(-0.75 / 5.0);
        assert!((reference.now - first).abs() < 1e-6, "{}", reference.now);
        reference.advance(1.0, Approach::Lag, quarter, 5.0);
        let middle = 2.0 + (first - 2.0) * libm::expf(-0.25 / 5.0);
        let second = 1.0 + (middle - 1.0) * libm::expf(-0.75 / 5.0);
        assert!((reference.now - second).abs() < 1e-6, "{}", reference.now);
    }

    #[test]
    fn a_ramp_takes_its_step_a_cycle_and_ends_at_its_goal() {
        let mut reference = Reference::default();
        let mut way = |goal: f32, pace| {
            reference.advance(goal, pace, 0.0, 5.0);
            reference.now
        };
        assert_eq!(way(1.0, Approach::Ramp(0.75)), 0.75);
        assert_eq!(way(1.0, Approach::Ramp(0.75)), 1.0);
        assert_eq!(way(0.5, Approach::Ramp(0.25)), 0.75);
        assert_eq!(way(0.1, Approach::Step), 0.1);
    }
}
