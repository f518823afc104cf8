//! The first impacts of one orbit, each begun where the recent ones were found.
//!
//! An impact of one orbit costs its chain of dependent operations, and much of that chain only finds which nodes of the
//! table the impact is computed from. Where an orbit recurs, as a lock does and the orbits that double from it, they are
//! those of before: the impact is computed from them at once, and beside it, with what the CPU has to spare, whether they
//! are the right ones. Where they are not, it is computed anew. So it has the bits of
//! [`first_impact`](super::first::first_impact) in any case.

use core::hint::black_box;

use super::first::not_tall;
use super::launch::{Launch, Track};
use super::step::{Close, Landing, Near, in_turn};
use super::{low, tall};
use crate::arithmetic::lane::{Lane, ROUNDER, between, name};
use crate::arithmetic::node;

/// The recent impacts of one orbit, by which [`Kernel::next_impact`](crate::impact::Kernel::next_impact) finds the next
/// one sooner. No bit of it depends on them: they may be those of another orbit.
///
/// ```
/// use kband::impact::{Kernel, Map, Recent};
/// let map = Map::build(0.43, 0.2)?;
/// let mut recent = Recent::default();
/// let mut state = Map::state(0.5, 0.45)?;
/// for _ in 0..100 {
///     let next = map.next_impact(state, &mut recent);
///     assert_eq!(next, map.impact(state));
///     state = next.next;
/// }
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Recent {
    /// The [`ROUNDER`] sum that names the node, within its turn, about which the last flight ended.
    launch: f64,
    /// Flights from some nodes, each by the last bits of its number.
    flights: [Flight; FLIGHTS],
}

/// As many impacts may a cycle of the orbit have. A power of two.
const FLIGHTS: usize = 8;

/// A low flight, by the [`ROUNDER`] sums that name its nodes.
#[derive(Clone, Copy, Debug, Default)]
struct Flight {
    /// Next to the launch.
    launch: f64,
    /// That the approach began from.
    start: f64,
    /// Next to the impact.
    end: f64,
    /// Whether the flight before it from there was the same.
    recurs: bool,
}

impl Recent {
    /// The first impact of a launch, and whether it grazes; `None` where the part rests.
    #[inline(always)]
    pub(super) fn first_impact(
        &mut self,
        track: &Track<f64>,
        phase: f64,
        velocity: f64,
    ) -> Option<(Landing<f64>, bool)> {
        let flight = self.flights[place(self.launch)];
        if flight.recurs && flight.launch == self.launch {
            if let Some(landing) = flight.again(track, phase, velocity) {
                self.launch = in_one_turn(flight.end);
                return Some((landing, false));
            }
            // One that recurs and takes more than a step at its end is not tried each time.
            self.flights[place(self.launch)] = Flight::default();
        }
        let node = foreseen(name(phase), self.launch);
        let launch = Launch::with(phase, velocity, between(phase, node, f64::node(node)));
        if f64::any(launch.is_tall(track)) {
            let close = tall::approach(track, &tall::crossing(track, &launch));
            self.launch = in_one_turn(close.next());
            return Some((Near::at(track, &launch, &close).finish(track), false));
        }
        let Launch { sine, cosine, .. } = launch;
        not_tall(track, phase, velocity, sine, cosine, |close| {
            self.learn(node, close);
        })
    }

    /// Learns that a low flight from `node` ends `close`.
    #[inline(always)]
    fn learn(&mut self, node: f64, close: &Close<f64>) {
        let end = close.next();
        let flight = &mut self.flights[place(node)];
        let recurs = flight.launch == node && flight.start == close.rounded && flight.end == end;
        *flight = Flight {
            launch: node,
            start: close.rounded,
            end,
            recurs,
        };
        self.launch = in_one_turn(end);
    }
}

impl Flight {
    /// The landing of a launch if it is another such flight.
    #[inline(always)]
    fn again(&self, track: &Track<f64>, phase: f64, velocity: f64) -> Option<Landing<f64>> {
        let node = f64::node(self.launch);
        let launch = Launch::with(phase, velocity, between(phase, self.launch, node));
        let close = low::approach_from(track, &launch, self.start);
        let near = Near::around(track, &launch, &close, self.end);
        let (mut landing, settled) = low::settle_near(track, &near);
        // What follows decides: nothing that the landing waits for.
        let stretch = if f64::any(launch.meets_once(track)) {
            low::once(track, &launch)
        } else {
            low::stretch(track, &launch)
        };
        let kind = !launch.is_tall(track) & !launch.is_short(track);
        let nodes = name(phase) == self.launch
            && stretch.node(&launch) == self.start
            && close.next() == self.end;
        landing.phase = in_turn(landing.phase);
        (velocity > 0.0 && nodes && f64::any(kind & settled & stretch.holds(&landing)))
            .then_some(landing)
    }
}

/// Where a flight from the node of this [`ROUNDER`] sum is remembered.
#[inline(always)]
fn place(rounded: f64) -> usize {
    rounded.to_bits() as usize % FLIGHTS
}

/// The [`ROUNDER`] sum of a node within its turn.
#[inline(always)]
fn in_one_turn(rounded: f64) -> f64 {
    f64::from_bits(ROUNDER.to_bits() + rounded.to_bits() % node::COUNT as u64)
}

/// `value`. Where it is `guess`, a CPU that predicts branches goes on with it before it is computed.
#[inline(always)]
fn foreseen(value: f64, guess: f64) -> f64 {
    // Hidden from the compiler, to which the two are the same number there.
    if value.to_bits() == black_box(guess).to_bits() {
        black_box(guess)
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::double::Map;
    use crate::impact::{Kernel, PartState};

    fn spread(n: u32, factor: f64) -> f64 {
        (f64::from(n) * factor).rem_euclid(1.0)
    }

    /// How many of the next `count` impacts are found again. Each is that of the map, bit for bit.
    fn found_again(map: &Map, state: &mut PartState, recent: &mut Recent, count: u32) -> u32 {
        let mut found = 0;
        for _ in 0..count {
            let flight = recent.flights[place(recent.launch)];
            let again = flight.again(map.track(), state.phase, state.velocity);
            found += u32::from(flight.recurs && again.is_some());
            let (impact, expected) = (map.next_impact(*state, recent), map.impact(*state));
            assert_eq!(impact, expected, "{map:?} {state:?}");
            *state = impact.next;
        }
        found
    }

    /// From orbit to orbit, as what one has left is no harm to the next.
    #[test]
    fn the_recent_impacts_change_no_bit_of_the_next() {
        let mut recent = Recent::default();
        let (mut found, count) = (0, 100);
        for n in 0..20_000 {
            let (k, restitution) = (0.02 + 1.1 * spread(n, 0.618_034), spread(n, 0.414_214));
            let map = Map::build(k, restitution).unwrap();
            let top = if n % 3 == 0 { 20.0 } else { 2.0 };
            let velocity = top * spread(n, 0.236_068);
            let mut state = Map::state(7.0 * spread(n, 0.732_051), velocity).unwrap();
            found += found_again(&map, &mut state, &mut recent, count);
        }
        assert!(found > 10_000, "{found}");
    }

    /// A lock, and the orbits of two and of four impacts that double from it.
    #[test]
    fn an_orbit_that_recurs_is_found_again() {
        for (k, restitution) in [(0.43, 0.2), (0.37, 0.2), (0.362, 0.2)] {
            let map = Map::build(k, restitution).unwrap();
            let (mut state, mut recent) = (Map::state(0.5, 0.45).unwrap(), Recent::default());
            found_again(&map, &mut state, &mut recent, 2000);
            let found = found_again(&map, &mut state, &mut recent, 1000);
            assert_eq!(found, 1000, "{k} {restitution}");
        }
    }
}
