//! Gear of an orbit with random restitution, and share of time in it.

use std::fmt;

use kband::impact::{Impact, Observer, PartState};
use kband::regime::gear::GearWatch;

use crate::refusal::Refusal;

/// Number of observed orders.
const ORDERS: u32 = 3;

/// Share of time in gear, for the order with the largest share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InGear {
    /// Drive periods of a flight (symbol r).
    pub order: u32,
    /// Share of time, 0..=1.
    pub share: f64,
}

impl InGear {
    fn longest(all: impl Iterator<Item = Self>) -> Option<Self> {
        let larger = |one: Self, other: Self| if other.share > one.share { other } else { one };
        all.reduce(larger)
    }

    /// For several orbits: the order with the largest total share, and the mean share in it. `None`
    /// if one orbit has no share.
    pub fn from_orbits(orbits: impl Iterator<Item = Option<Self>>) -> Option<Self> {
        let all: Vec<Self> = orbits.collect::<Option<_>>()?;
        let sum = |order| {
            let matching = all.iter().filter(|gear| gear.order == order);
            matching.map(|gear| gear.share).sum::<f64>()
        };
        let shares = (1..=ORDERS).map(|order| Self {
            order,
            share: sum(order) / all.len() as f64,
        });
        Self::longest(shares).filter(|_| !all.is_empty())
    }
}

impl fmt::Display for InGear {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "in gear {:.2}, r = {}", self.share, self.order)
    }
}

/// Observer of an orbit's gears.
#[derive(Clone, Debug)]
pub struct Gears {
    time: f64,
    gears: Vec<GearWatch>,
}

impl Gears {
    /// An observer that starts at the present time.
    pub fn start_now() -> Result<Self, Refusal> {
        let gear = |order| {
            let mut gear = GearWatch::build(order)?;
            gear.begin(0.0);
            Ok(gear)
        };
        let gears = (1..=ORDERS).map(gear).collect::<Result<_, Refusal>>()?;
        Ok(Self { time: 0.0, gears })
    }

    /// The gear with the largest share.
    pub fn longest(&self) -> Option<InGear> {
        let shares = self.gears.iter().zip(1..).map(|(gear, order)| InGear {
            order,
            share: gear.share(self.time).share(),
        });
        InGear::longest(shares)
    }
}

impl Observer for Gears {
    fn impact(&mut self, _: PartState, impact: &Impact<PartState>) {
        self.time += impact.flight;
        for gear in &mut self.gears {
            gear.add_landing(self.time, impact.flight);
        }
    }

    fn rest(&mut self, _: PartState, chatter: f64, _: f64) {
        self.time += chatter;
        for gear in &mut self.gears {
            gear.add_rest(self.time);
        }
    }

    fn lift_off(&mut self, wait: f64, _: f64) {
        self.time += wait;
    }
}

#[cfg(test)]
mod tests {
    use kband::impact::{Kernel, Map, Orbit, Scatter};

    use super::*;

    #[test]
    fn a_scattering_orbit_has_the_share_of_the_gear_map() {
        // docs/theory-real-parts.md#t10.1: by an independent program (regime/gear/mod.rs).
        for (k, restitution, expected) in [(0.45, 0.3, 0.811), (0.41, 0.2, 0.935)] {
            let map = Map::build(k, restitution).unwrap();
            let runs = (0..20).map(|seed| {
                let scatter = Scatter::build(restitution, 0.05, seed).unwrap();
                let mut gears = Gears::start_now().unwrap();
                let mut orbit = Orbit::from_rest(&map).scattering(scatter).unwrap();
                orbit.watch(1000, &mut gears);
                gears.longest()
            });
            let in_gear = InGear::from_orbits(runs).unwrap();
            assert_eq!(in_gear.order, 1);
            assert!((in_gear.share - expected).abs() < 0.03, "{in_gear}");
        }
    }
}
