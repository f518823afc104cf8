//! How much of their time the parts are in gear, as far as that is heard.

use super::signal::Cycle;
use crate::arithmetic::Phase;
use crate::control::angle::radians_of;

/// Drive cycles that the share of time in gear remembers.
pub const GEAR_WINDOW: f32 = 64.0;
/// Shortest and longest flight in gear, as a share of r drive periods, in steps of 2^-32 of a period
/// (docs/theory-real-parts.md#t10.1).
const FLIGHTS: [u64; 2] = [2_576_980_377, 6_012_954_214];
/// Flights in a row that are gear.
const ROW: u32 = 8;
/// Phases at which a part in gear strikes, in rad: the track's velocity is then high and falling.
const STRIKES: [f32; 2] = [-0.6, 1.8];

/// The share of time in gear of what strikes in gear's phases.
#[derive(Clone, Copy, Debug, Default)]
pub struct GearHearing {
    /// Time of the last impact at gear's phases, in steps of 2^-32 cycles; 0 before the first.
    last: u64,
    row: u32,
    /// Cycles of the row that are not counted yet.
    waiting: f32,
    in_gear: f32,
    watched: f32,
    cycles: f32,
    losses: f32,
}

impl GearHearing {
    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Takes cycle number `count` with the track's lead, for gear of an order.
    pub fn cycle(&mut self, cycle: &Cycle, count: u32, lead: Phase, order: u8) {
        let keep = 1.0 - 1.0 / GEAR_WINDOW;
        for sum in [&mut self.in_gear, &mut self.watched] {
            *sum *= keep;
        }
        self.watched += 1.0;
        let order = u64::from(order.max(1));
        for heard in &cycle.heard {
            let phase = radians_of(heard.phase + lead);
            if !(STRIKES[0]..STRIKES[1]).contains(&phase) {
                continue;
            }
            let time = (u64::from(count) << 32 | u64::from(heard.phase.bits()))
                .wrapping_add_signed(i64::from(lead.bits() as i32));
            let flight = time.wrapping_sub(self.last);
            // Another part's, or the same impact's ringing.
            if self.last > 0 && flight < FLIGHTS[0] * order {
                continue;
            }
            let right = self.last > 0 && flight <= FLIGHTS[1] * order;
            self.last = time;
            self.take(right.then_some(flight as f32 / Phase::TURN as f32));
        }
        let now = u64::from(count) << 32;
        if self.last > 0 && now.wrapping_sub(self.last) as i64 > (FLIGHTS[1] * order) as i64 {
            self.take(None);
        }
    }

    fn take(&mut self, flight: Option<f32>) {
        let Some(flight) = flight else {
            self.losses += f32::from(u8::from(self.row >= ROW));
            self.row = 0;
            self.waiting = 0.0;
            return;
        };
        self.row = self.row.saturating_add(1);
        self.waiting += flight;
        if self.row >= ROW {
            self.in_gear += self.waiting;
            self.cycles += self.waiting;
            self.waiting = 0.0;
        }
    }

    /// Share of time in gear, 0..=1, over the last [`GEAR_WINDOW`] cycles.
    #[must_use]
    pub fn share(&self) -> f32 {
        if self.watched > 0.0 {
            (self.in_gear / self.watched).min(1.0)
        } else {
            0.0
        }
    }

    /// Mean drive cycles in gear until it was lost; infinite where it was not.
    #[must_use]
    pub fn to_loss(&self) -> f32 {
        if self.losses > 0.0 {
            self.cycles / self.losses
        } else {
            f32::INFINITY
        }
    }
}
