//! Reference of the amplitude loop: a ramp, a first-order lag or a step, advanced once per cycle.

use crate::saturate::saturate;
use core::f32::consts::TAU;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Approach {
    /// By at most this much per cycle, in m.
    Ramp(f32),
    /// With the first-order lag of a kick.
    Lag,
    Step,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct Reference {
    /// Reference amplitude now, in m.
    pub value: f32,
    /// Command of the last cycle of a kick, in m.
    commanded: f32,
}

impl Reference {
    /// Advances one cycle towards a goal in m; `lead` in rad, `time_constant` of a kick in cycles.
    pub fn advance(&mut self, goal: f32, approach: Approach, lead: f32, time_constant: f32) {
        self.value = match approach {
            Approach::Step => goal,
            Approach::Ramp(rate) => self.value + saturate(goal - self.value, -rate, rate),
            Approach::Lag => self.lag_one_cycle(goal, lead, time_constant),
        };
        self.commanded = goal;
    }

    /// The reference one cycle on, with the first-order lag of kicks. A kick's cycles begin at
    /// phase 0 of the track: the first part of the output's cycle still has the previous command.
    fn lag_one_cycle(&self, goal: f32, lead: f32, time_constant: f32) -> f32 {
        let before = -lead * (1.0 / TAU);
        let before = before - libm::floorf(before);
        let decay_towards = |from: f32, to: f32, cycles: f32| {
            to + (from - to) * libm::expf(-cycles / time_constant)
        };
        let middle = decay_towards(self.value, self.commanded, before);
        let next = decay_towards(middle, goal, 1.0 - before);
        // A remainder of a thousandth has no effect on the parts.
        let has_arrived = (next - goal).abs() < 1e-3 * goal;
        if has_arrived { goal } else { next }
    }
}
