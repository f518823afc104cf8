//! Order of gear that gives a requested mass flow, in g/s.
//!
//! In gear the parts' speed is proportional to the order and does not depend on the amplitude
//! (docs/theory-transport.md#t8.3). The order with the nearest predicted flow wins, debounced.

use super::setpoint::ORDERS;

/// Largest accepted relative deviation from the requested flow, as for a speed.
const FLOW_TOLERANCE: f32 = 0.1;
/// Consecutive cycles in which another order must be the best: eight memories of the weight.
const DECISION_CYCLES: u32 = 512;

#[derive(Clone, Copy, Debug)]
pub struct FlowChoice {
    requested: f32,
    /// Consecutive cycles in which the present order was not the best.
    wrong_cycles: u32,
}

impl FlowChoice {
    /// Comparison for a requested flow in g/s.
    pub fn new(requested: f32) -> Self {
        Self {
            requested,
            wrong_cycles: 0,
        }
    }

    /// Processes a cycle with the estimated flow of the present order, in g/s. Returns another order
    /// that gives the flow, or else the nearest flow in g/s; `None` as long as the order stays.
    pub fn cycle(&mut self, order: u8, flow: Option<f32>) -> Option<Result<u8, f32>> {
        let flow_per_order = flow? / f32::from(order);
        let flow_error = |order: u8| (flow_per_order * f32::from(order) - self.requested).abs();
        // The present order wins a tie.
        let orders = core::iter::once(order).chain(ORDERS);
        let best = orders.min_by(|one, other| flow_error(*one).total_cmp(&flow_error(*other)));
        let best = best.unwrap_or(order);
        let serves = flow_error(best) <= FLOW_TOLERANCE * self.requested;
        if best == order && serves {
            self.wrong_cycles = 0;
            return None;
        }
        self.wrong_cycles += 1;
        if self.wrong_cycles < DECISION_CYCLES {
            return None;
        }
        self.wrong_cycles = 0;
        let nearest = flow_per_order * f32::from(best);
        Some(if serves { Ok(best) } else { Err(nearest) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decide(requested: f32, order: u8, flow: f32) -> Option<Result<u8, f32>> {
        let mut choice = FlowChoice::new(requested);
        (0..DECISION_CYCLES).find_map(|_| choice.cycle(order, Some(flow)))
    }

    #[test]
    fn flow_choice_finds_the_nearest_order_or_refuses() {
        assert_eq!(decide(50.0, 1, 47.0), None);
        assert_eq!(decide(100.0, 1, 48.0), Some(Ok(2)));
        assert_eq!(decide(50.0, 3, 150.0), Some(Ok(1)));
        assert_eq!(decide(70.0, 1, 48.0), Some(Err(48.0)));
        assert_eq!(decide(1000.0, 1, 48.0), Some(Err(384.0)));
        // Without an estimate there is no decision.
        let mut choice = FlowChoice::new(50.0);
        assert!((0..2 * DECISION_CYCLES).all(|_| choice.cycle(1, None).is_none()));
    }
}
