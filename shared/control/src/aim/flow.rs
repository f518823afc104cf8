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

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FlowStep {
    Stay,
    Order(u8),
    /// No order gives the flow; the nearest one's flow, in g/s.
    None(f32),
}

impl FlowChoice {
    /// Comparison for a requested flow in g/s.
    pub fn new(requested: f32) -> Self {
        Self {
            requested,
            wrong_cycles: 0,
        }
    }

    /// Processes a cycle with the estimated flow of the present order, in g/s.
    pub fn cycle(&mut self, order: u8, flow: Option<f32>) -> FlowStep {
        let Some(flow) = flow else {
            return FlowStep::Stay;
        };
        let flow_per_order = flow / f32::from(order);
        let flow_error = |order: u8| (flow_per_order * f32::from(order) - self.requested).abs();
        // The present order wins a tie.
        let orders = core::iter::once(order).chain(ORDERS);
        let best = orders.min_by(|one, other| flow_error(*one).total_cmp(&flow_error(*other)));
        let best = best.unwrap_or(order);
        let serves = flow_error(best) <= FLOW_TOLERANCE * self.requested;
        if best == order && serves {
            self.wrong_cycles = 0;
            return FlowStep::Stay;
        }
        self.wrong_cycles += 1;
        if self.wrong_cycles < DECISION_CYCLES {
            return FlowStep::Stay;
        }
        self.wrong_cycles = 0;
        if serves {
            FlowStep::Order(best)
        } else {
            FlowStep::None(flow_per_order * f32::from(best))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decide(requested: f32, order: u8, flow: f32) -> FlowStep {
        let mut choice = FlowChoice::new(requested);
        let mut steps = (0..DECISION_CYCLES).map(|_| choice.cycle(order, Some(flow)));
        let decision = steps.find(|step| *step != FlowStep::Stay);
        decision.unwrap_or(FlowStep::Stay)
    }

    #[test]
    fn flow_choice_finds_the_nearest_order_or_refuses() {
        assert_eq!(decide(50.0, 1, 47.0), FlowStep::Stay);
        assert_eq!(decide(100.0, 1, 48.0), FlowStep::Order(2));
        assert_eq!(decide(50.0, 3, 150.0), FlowStep::Order(1));
        assert_eq!(decide(70.0, 1, 48.0), FlowStep::None(48.0));
        assert_eq!(decide(1000.0, 1, 48.0), FlowStep::None(384.0));
        // Without an estimate there is no decision.
        let mut choice = FlowChoice::new(50.0);
        assert!((0..2 * DECISION_CYCLES).all(|_| choice.cycle(1, None) == FlowStep::Stay));
    }
}
