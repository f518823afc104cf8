//! The order of gear at which the track gives so many grams per second.

use super::setpoint::ORDERS;

/// Deviation of a flow from the wanted one that still serves: that of a speed. A neighbouring order is at least a ninth away.
const TOLERANCE: f32 = 0.1;
/// Cycles for which another order has to be the better one, or none to serve: eight times the memory of the weight.
const PATIENCE: u32 = 512;

/// The orders of gear held against a wanted flow: in gear the speed of the parts does not depend on the amplitude, and is
/// proportional to the order.
#[derive(Clone, Copy, Debug)]
pub struct FlowChoice {
    wanted: f32,
    /// Cycles for which what is now does not serve.
    amiss: u32,
}

/// What is to be done for a flow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FlowStep {
    /// It is as wanted, or not long enough otherwise.
    Stay,
    /// Another order serves it better.
    Order(u8),
    /// None serves it; the nearest, in g/s.
    None(f32),
}

impl FlowChoice {
    /// For a flow in g/s.
    pub fn new(wanted: f32) -> Self {
        Self { wanted, amiss: 0 }
    }

    /// A cycle in which the flow in gear of an order is `flow` g/s; `None` where that is not known.
    pub fn cycle(&mut self, order: u8, flow: Option<f32>) -> FlowStep {
        let Some(flow) = flow else {
            return FlowStep::Stay;
        };
        let each = flow / f32::from(order);
        let misses = |order: u8| (each * f32::from(order) - self.wanted).abs();
        let best = ORDERS.fold(order, |best, other| {
            if misses(other) < misses(best) {
                other
            } else {
                best
            }
        });
        if best == order && misses(best) <= TOLERANCE * self.wanted {
            self.amiss = 0;
            return FlowStep::Stay;
        }
        self.amiss += 1;
        if self.amiss < PATIENCE {
            return FlowStep::Stay;
        }
        self.amiss = 0;
        if misses(best) > TOLERANCE * self.wanted {
            FlowStep::None(each * f32::from(best))
        } else {
            FlowStep::Order(best)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What comes of a flow that stays.
    fn comes_of(wanted: f32, order: u8, flow: f32) -> FlowStep {
        let mut choice = FlowChoice::new(wanted);
        (0..PATIENCE)
            .map(|_| choice.cycle(order, Some(flow)))
            .find(|step| *step != FlowStep::Stay)
            .unwrap_or(FlowStep::Stay)
    }

    #[test]
    fn a_flow_is_that_of_the_order_that_serves_it_or_refused_with_the_nearest() {
        assert_eq!(comes_of(50.0, 1, 47.0), FlowStep::Stay);
        assert_eq!(comes_of(100.0, 1, 48.0), FlowStep::Order(2));
        assert_eq!(comes_of(50.0, 3, 150.0), FlowStep::Order(1));
        assert_eq!(comes_of(70.0, 1, 48.0), FlowStep::None(48.0));
        assert_eq!(comes_of(1000.0, 1, 48.0), FlowStep::None(384.0));
        // What is not weighed is not judged.
        let mut choice = FlowChoice::new(50.0);
        assert!((0..2 * PATIENCE).all(|_| choice.cycle(1, None) == FlowStep::Stay));
    }
}
