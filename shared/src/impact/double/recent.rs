//! The first impacts of one orbit, each begun where those from about the same launch were found.
//!
//! An impact of one orbit costs its chain of dependent operations, and much of that chain only finds which two nodes of
//! the table the impact is computed from. They are foreseen from the last flight from the same launch node, by how its
//! ends move with phase and velocity. The impact is computed from them at once, and beside it, with what the CPU has to
//! spare, whether they are the right ones. Where they are not, it is computed anew. So it has the bits of
//! [`first_impact`](super::first::first_impact) in any case.
//!
//! That is right of all impacts of a lock, and of 93 in 100 of a chaotic orbit that stays in gear. Where restitution is
//! near 1 an orbit hardly comes back to where it was before; there next to nothing is foreseen.

use core::f64::consts::TAU;
use core::hint::black_box;

use super::first::{Low, not_tall};
use super::launch::{Launch, Track};
use super::step::{Landing, Near, in_turn};
use super::{low, tall};
use crate::arithmetic::lane::{Lane, ROUNDER, between, name};
use crate::arithmetic::node;
use crate::impact::kernel::{Impact, PartState};

/// The recent impacts of one orbit, by which [`Kernel::next_impact`](crate::impact::Kernel::next_impact) finds the next
/// one sooner. No bit of it depends on them: they may be those of another orbit.
///
/// It takes 4 KiB, a few hundred bytes on a microcontroller.
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
#[derive(Clone, Debug)]
pub struct Recent {
    /// The [`ROUNDER`] sum that names the node, within its turn, about which the last flight ended.
    launch: f64,
    /// Flights from some nodes, each by the last bits of its number.
    flights: [Flight; FLIGHTS],
}

/// A power of two. The launches of a part in gear lie within half a turn, which has as many nodes.
const FLIGHTS: usize = if cfg!(target_os = "none") { 8 } else { 128 };

/// The last low flight from a node that another one would not have foreseen.
#[derive(Clone, Copy, Debug, Default)]
struct Flight {
    /// Of the node that the approach begins from, and of the impact: where they are, in nodes, where phase and
    /// velocity are 0, and how far they move with each. To f32 that is within a thousandth of a node.
    at: [f32; 2],
    by_phase: [f32; 2],
    by_velocity: [f32; 2],
    /// The number of the launch's node within its turn.
    launch: u8,
    /// Whether it [meets the track once](Launch::meets_once).
    once: bool,
    /// What is left of its trust.
    trust: u8,
}

/// Least trust of a flight that others are foreseen from. It takes two that would have been foreseen: one may be by chance.
const ENOUGH: u8 = 2;

/// Trust after those two. Each one that is foreseen wrong takes one.
const TRUSTED: u8 = 4;

/// What the next impact does not wait for: the duration of the flight, and whether it grazes; `None` where the part
/// rests.
type Aside = Option<(f64, bool)>;

impl Default for Recent {
    fn default() -> Self {
        Self {
            launch: 0.0,
            flights: [Flight::default(); FLIGHTS],
        }
    }
}

impl Recent {
    /// The first impact of a part of this restitution, launched in `state`.
    #[inline(always)]
    pub(super) fn impact(
        &mut self,
        track: &Track<f64>,
        restitution: f64,
        state: PartState,
    ) -> Impact<PartState> {
        // Alone, as a pair that an impact has just left in memory is not there at once.
        let (phase, velocity) = (state.phase.lone(), state.velocity.lone());
        let mut aside = None;
        let (phase, arrival) = self.landing(track, phase, velocity, &mut aside);
        let Some((flight, grazes)) = aside else {
            return Impact {
                flight: 0.0,
                next: state,
                grazes: false,
            };
        };
        Impact {
            flight,
            next: PartState {
                phase,
                velocity: restitution * arrival,
            },
            grazes,
        }
    }

    /// Phase and speed of the landing.
    // A pair of numbers: in memory, as the whole landing would be, they would delay the next impact.
    #[inline(always)]
    fn landing(
        &mut self,
        track: &Track<f64>,
        phase: f64,
        velocity: f64,
        aside: &mut Aside,
    ) -> (f64, f64) {
        let Some(flight) = self.trusted() else {
            return self.anew(track, phase, velocity, aside);
        };
        let [start, end] = flight.nodes(phase, velocity);
        let launch = [phase, velocity];
        let Some(landing) = flight.again(track, launch, [self.launch, start, end]) else {
            return self.missed(track, phase, velocity, aside);
        };
        self.launch = in_one_turn(end);
        *aside = Some((landing.flight, false));
        (landing.phase, landing.arrival)
    }

    /// The flight that the next one is foreseen from.
    #[inline(always)]
    fn trusted(&self) -> Option<&Flight> {
        let flight = &self.flights[place(self.launch)];
        (flight.trust >= ENOUGH && flight.launch == number(self.launch)).then_some(flight)
    }

    /// [`Recent::anew`] of a flight that was foreseen wrong.
    // By itself, as what has been computed in vain would hold registers that tall flights need.
    #[cold]
    #[inline(never)]
    fn missed(
        &mut self,
        track: &Track<f64>,
        phase: f64,
        velocity: f64,
        aside: &mut Aside,
    ) -> (f64, f64) {
        let from = place(self.launch);
        let trust = self.flights[from].trust;
        let landing = self.anew(track, phase, velocity, aside);
        // A low flight whose nodes are others has taken trust as it was learned; one of another kind takes it here.
        if self.flights[from].trust == trust {
            self.flights[from].trust = trust - 1;
        }
        landing
    }

    /// Phase and speed of the landing, from the launch alone.
    #[inline(always)]
    fn anew(
        &mut self,
        track: &Track<f64>,
        phase: f64,
        velocity: f64,
        aside: &mut Aside,
    ) -> (f64, f64) {
        let node = foreseen(name(phase), self.launch);
        let launch = Launch::with(phase, velocity, between(phase, node, f64::node(node)));
        if f64::any(launch.is_tall(track)) {
            let close = tall::approach(track, &tall::crossing(track, &launch));
            self.launch = in_one_turn(close.next());
            let landing = Near::at(track, &launch, &close).finish(track);
            *aside = Some((landing.flight, false));
            return (landing.phase, landing.arrival);
        }
        let Launch { sine, cosine, .. } = launch;
        self.lower(track, [phase, velocity], sine, cosine, node, aside)
    }

    /// The same of a flight that is not tall, from `node`.
    #[inline(never)]
    fn lower(
        &mut self,
        track: &Track<f64>,
        [phase, velocity]: [f64; 2],
        sine: f64,
        cosine: f64,
        node: f64,
        aside: &mut Aside,
    ) -> (f64, f64) {
        let landing = not_tall(track, phase, velocity, sine, cosine, |launch, flight| {
            self.learn(track, launch, node, flight);
        });
        let Some((landing, grazes)) = landing else {
            *aside = None;
            return (0.0, 0.0);
        };
        *aside = Some((landing.flight, grazes));
        (landing.phase, landing.arrival)
    }

    /// Learns how a low flight from `node` ends.
    #[inline(always)]
    fn learn(&mut self, track: &Track<f64>, launch: &Launch<f64>, node: f64, low: &Low) {
        let (start, end) = (low.close.rounded, low.close.next());
        self.launch = in_one_turn(end);
        let flight = &mut self.flights[place(node)];
        let known = flight.launch == number(node);
        let right = known
            && flight.once == low.once
            && flight.nodes(launch.phase, launch.velocity) == [start, end];
        if right {
            flight.trust = if flight.trust == 0 { 1 } else { TRUSTED };
        } else {
            let trust = if known { flight.trust } else { 0 };
            *flight = Flight::of(track, launch, node, low);
            flight.trust = trust.saturating_sub(1);
        }
    }
}

impl Flight {
    /// A low flight from `node`.
    #[inline(always)]
    fn of(track: &Track<f64>, launch: &Launch<f64>, node: f64, low: &Low) -> Self {
        let times = [low.stretch.start, low.landing.flight];
        let slopes = [
            low.stretch.slope(track, launch, low.close.rounded),
            -low.landing.arrival,
        ];
        // As what meets at the time d does so at t + d whatever the launch: the changes of the ball's height there with
        // t and v, over how fast the two part.
        let rates: [[f64; 2]; 2] = core::array::from_fn(|i| {
            let (d, per_slope) = (times[i], -PER_RAD / slopes[i]);
            let by_phase = d * (track.k - launch.sine) - launch.velocity;
            [by_phase * per_slope, d * per_slope]
        });
        Self {
            at: core::array::from_fn(|i| {
                let moved = rates[i][0] * launch.phase + rates[i][1] * launch.velocity;
                ((launch.phase + times[i]) * PER_RAD - moved) as f32
            }),
            by_phase: rates.map(|[by_phase, _]| by_phase as f32),
            by_velocity: rates.map(|[_, by_velocity]| by_velocity as f32),
            launch: number(node),
            once: low.once,
            trust: 0,
        }
    }

    /// The nodes that another such flight begins its approach from and ends next to, by their [`ROUNDER`] sums.
    #[inline(always)]
    fn nodes(&self, phase: f64, velocity: f64) -> [f64; 2] {
        core::array::from_fn(|i| {
            let at = f64::from(self.at[i]) + f64::from(self.by_velocity[i]) * velocity;
            (f64::from(self.by_phase[i]) * phase + at) + ROUNDER
        })
    }

    /// The landing of a launch if it is another such flight: from the node `named`, by `start` to `end`.
    #[inline(always)]
    fn again(
        &self,
        track: &Track<f64>,
        [phase, velocity]: [f64; 2],
        [named, start, end]: [f64; 3],
    ) -> Option<Landing<f64>> {
        let launch = Launch::with(phase, velocity, between(phase, named, f64::node(named)));
        let close = low::approach_from(track, &launch, start);
        let near = Near::around(track, &launch, &close, end);
        let (mut landing, settled) = low::settle_near(track, &near);
        // What follows decides: nothing that the landing waits for.
        let stretch = if self.once {
            low::once(track, &launch)
        } else {
            low::stretch(track, &launch)
        };
        let kind = !launch.is_tall(track) & !launch.is_short(track);
        let nodes = name(phase) == named
            && f64::any(launch.meets_once(track)) == self.once
            && stretch.node(&launch) == start
            && close.next() == end;
        landing.phase = in_turn(landing.phase);
        (velocity > 0.0 && nodes && f64::any(kind & settled & stretch.holds(&landing)))
            .then_some(landing)
    }
}

/// Nodes in a rad.
const PER_RAD: f64 = node::COUNT as f64 / TAU;

/// Where a flight from the node of this [`ROUNDER`] sum is remembered.
#[inline(always)]
fn place(rounded: f64) -> usize {
    rounded.to_bits() as usize % FLIGHTS
}

/// The number of that node within its turn.
#[inline(always)]
fn number(rounded: f64) -> u8 {
    const { assert!(node::COUNT == 1 << u8::BITS) };
    rounded.to_bits() as u8
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
    use crate::impact::Kernel;
    use crate::impact::double::Map;

    fn spread(n: u32, factor: f64) -> f64 {
        (f64::from(n) * factor).rem_euclid(1.0)
    }

    /// Of the next `count` impacts, how many are foreseen and how many of these are right. Each is that of the map, bit
    /// for bit.
    fn foreseen_of(map: &Map, state: &mut PartState, recent: &mut Recent, count: u32) -> [u32; 2] {
        let mut foreseen = [0; 2];
        for _ in 0..count {
            if let Some(flight) = recent.trusted() {
                let [start, end] = flight.nodes(state.phase, state.velocity);
                let launch = [state.phase, state.velocity];
                let again = flight.again(map.track(), launch, [recent.launch, start, end]);
                foreseen[0] += 1;
                foreseen[1] += u32::from(again.is_some());
            }
            let (impact, expected) = (map.next_impact(*state, recent), map.impact(*state));
            assert_eq!(impact, expected, "{map:?} {state:?}");
            *state = impact.next;
        }
        foreseen
    }

    /// From orbit to orbit, as what one has left is no harm to the next.
    #[test]
    fn the_recent_impacts_change_no_bit_of_the_next() {
        let mut recent = Recent::default();
        let (mut right, count) = (0, 100);
        for n in 0..20_000 {
            let (k, restitution) = (0.02 + 1.1 * spread(n, 0.618_034), spread(n, 0.414_214));
            let map = Map::build(k, restitution).unwrap();
            let top = if n % 3 == 0 { 20.0 } else { 2.0 };
            let velocity = top * spread(n, 0.236_068);
            let mut state = Map::state(7.0 * spread(n, 0.732_051), velocity).unwrap();
            right += foreseen_of(&map, &mut state, &mut recent, count)[1];
        }
        assert!(right > 10_000, "{right}");
    }

    fn after_2000(k: f64, restitution: f64, count: u32) -> [u32; 2] {
        let map = Map::build(k, restitution).unwrap();
        let (mut state, mut recent) = (Map::state(0.7, 0.36).unwrap(), Recent::default());
        foreseen_of(&map, &mut state, &mut recent, 2000);
        foreseen_of(&map, &mut state, &mut recent, count)
    }

    /// A lock, and the orbits of two and of four impacts that double from it.
    #[test]
    fn every_impact_of_an_orbit_that_recurs_is_foreseen() {
        for (k, restitution) in [(0.43, 0.2), (0.37, 0.2), (0.362, 0.2)] {
            assert_eq!(after_2000(k, restitution, 1000), [1000; 2], "{k}");
        }
    }

    /// 93 and 95 in 100 are, from nodes that each launch moves.
    #[test]
    fn nine_tenths_of_a_chaotic_orbit_are_foreseen() {
        for k in [0.34, 0.35] {
            let [tried, right] = after_2000(k, 0.2, 20_000);
            assert!(
                right > 18_000 && tried - right < 1200,
                "{k} {tried} {right}"
            );
        }
    }

    /// As a flight that is foreseen wrong costs more than one that is not: of 20 000 some 40 are tried.
    #[test]
    fn what_cannot_be_foreseen_is_hardly_tried() {
        let [tried, _] = after_2000(0.2, 0.95, 20_000);
        assert!(tried < 200, "{tried}");
    }
}
