//! The amplitude that the loop follows, moved from cycle to cycle.

use core::f32::consts::TAU;

use crate::control::saturate::saturate;

/// How the reference moves to its goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Move {
    /// By at most this much a cycle, in m.
    Ramp(f32),
    /// With the first-order lag of a kick.
    Lag,
    /// At once.
    Step,
}

/// The reference.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reference {
    /// Amplitude that the loop follows now, in m.
    pub now: f32,
    /// Amplitude commanded for the last cycle of a kick, in m.
    commanded: f32,
}

impl Reference {
    /// A cycle on to a goal in m, with the lead of the track in rad and the time constant of a kick's
    /// lag in cycles.
    pub fn go(&mut self, goal: f32, pace: Move, lead: f32, time_constant: f32) {
        self.now = match pace {
            Move::Step => goal,
            Move::Ramp(rate) => self.now + saturate(goal - self.now, -rate, rate),
            Move::Lag => self.after_a_cycle(goal, lead, time_constant),
        };
        self.commanded = goal;
    }

    /// The reference a cycle on, with the first-order lag of kicks. A kick's cycles begin at phase 0 of the
    /// track, where the plan has them, so the first part of the output's cycle still belongs to the
    /// command before.
    fn after_a_cycle(&self, goal: f32, lead: f32, time_constant: f32) -> f32 {
        let before = -lead * (1.0 / TAU);
        let before = before - libm::floorf(before);
        let along = |from: f32, to: f32, cycles: f32| {
            to + (from - to) * libm::expf(-cycles / time_constant)
        };
        let next = along(along(self.now, self.commanded, before), goal, 1.0 - before);
        // The last thousandth is no use to the parts.
        if (next - goal).abs() < 1e-3 * goal {
            goal
        } else {
            next
        }
    }
}
