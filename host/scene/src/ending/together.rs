//! Final regimes of many orbits at once, on one track or on many.
//!
//! They fly side by side in blocks, several times faster than in sequence. Each ends as it would
//! alone.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use kband::impact::batch::{Block, LANES};
use kband::impact::{Impact, Map, Orbit, OrbitEvent, PartState};
use kband::regime::classify::Regime;
use kband::regime::{exponent, gear};

use super::followed::{Followed, Said};
use super::{Endings, FOLLOWED};

/// Number of impacts for which irregular flights must stay in gear before their order's flights
/// count as chaos.
///
/// They start next to the period-1 orbit. 89 000 orbits below the flips were tried (orders 1 to 3,
/// R 0.025 to 0.925). The last to leave did so after 29 640 impacts, and 6500 stayed for 100 000.
const MAX_GEAR_IMPACTS: usize = 40_000;

/// Number of impacts left out at the start of those.
const SETTLING_IMPACTS: usize = 1000;

/// Final regimes of parts that start just after an impact, each on one of `tracks` by its number.
pub fn of_each(
    tracks: &[Endings],
    starts: impl ExactSizeIterator<Item = (usize, PartState)>,
) -> Vec<Regime> {
    let mut ends = vec![Regime::Undecided; starts.len()];
    let queries = starts.enumerate().map(|(answer, (track, start))| {
        let followed = Followed::new(tracks[track].impacts);
        (start, Query::new(answer, track, followed))
    });
    follow(tracks, queries, &mut ends, |query, _| {
        tracks[query.track].from_rest()
    });
    ends
}

/// Final regimes of parts that are thrown from rest, on each track.
///
/// For a return to rest it contains the drive cycles from one lift-off to the next.
pub(super) fn after_rest(tracks: &[Endings]) -> Vec<Regime> {
    let mut ends = vec![Regime::Rest; tracks.len()];
    let mut thrown = Vec::new();
    for (track, endings) in tracks.iter().enumerate() {
        // A block has no release: an orbit computes the first flight.
        let first = Orbit::from_rest(&endings.map).find_map(|event| match event {
            OrbitEvent::Impact(impact) => Some(impact),
            _ => None,
        });
        let Some(first) = first else {
            continue;
        };
        let mut query = Query::new(track, track, Followed::new(endings.impacts.max(FOLLOWED)));
        if query.goes_on(endings, &first) {
            thrown.push((first.next, query));
        } else {
            ends[track] = match query.said {
                Said::Ends(end) => end,
                _ => hops_and_rests(tracks, &query, first.next),
            };
        }
    }
    follow(tracks, thrown.into_iter(), &mut ends, |query, last| {
        hops_and_rests(tracks, query, last)
    });
    ends
}

/// The regime of an orbit from lift-off that comes to rest after this impact.
fn hops_and_rests(tracks: &[Endings], query: &Query, last: PartState) -> Regime {
    let cycles = (query.followed.time() + until_lift_off(&tracks[query.track].map, last)) / TAU;
    Regime::HopAndRest {
        cycles: cycles.round() as u32,
    }
}

/// Time in rad from the last impact before a rest to the next lift-off.
fn until_lift_off(map: &Map, last: PartState) -> f64 {
    let mut time = 0.0;
    for event in Orbit::new(map, last) {
        match event {
            OrbitEvent::Impact(impact) => time += impact.flight,
            OrbitEvent::Rest { chatter, .. } => time += chatter,
            OrbitEvent::LiftOff { wait, .. } => return time + wait,
        }
    }
    time
}

/// An orbit that is followed to its final regime.
struct Query {
    /// Index of the answer.
    answer: usize,
    track: usize,
    followed: Followed,
    said: Said,
}

impl Query {
    fn new(answer: usize, track: usize, followed: Followed) -> Self {
        Self {
            answer,
            track,
            followed,
            said: Said::GoesOn,
        }
    }

    fn goes_on(&mut self, endings: &Endings, impact: &Impact<PartState>) -> bool {
        let said = self.followed.take(endings, impact);
        if said == Said::GoesOn {
            return true;
        }
        self.said = said;
        false
    }
}

/// Follows orbits to their final regimes; `rested` gives that of an orbit that came to rest.
///
/// Orbits that depend on whether flights stay in gear wait until that is computed for all.
fn follow(
    tracks: &[Endings],
    queries: impl Iterator<Item = (PartState, Query)>,
    ends: &mut [Regime],
    rested: impl Fn(&Query, PartState) -> Regime,
) {
    let mut queries: Box<dyn Iterator<Item = (PartState, Query)>> = Box::new(queries);
    loop {
        let mut waiting: Vec<(PartState, Query)> = Vec::new();
        fly(
            queries.map(|(start, query)| (&tracks[query.track].map, start, query)),
            |query, impact| query.goes_on(&tracks[query.track], impact),
            |query, last| match query.said {
                Said::Ends(end) => ends[query.answer] = end,
                Said::GoesOn | Said::Rests => ends[query.answer] = rested(&query, last),
                Said::Asks(_) => waiting.push((last, query)),
            },
        );
        if waiting.is_empty() {
            return;
        }
        let gears = waiting.iter().filter_map(|(_, query)| match query.said {
            Said::Asks(order) => Some((query.track, order)),
            _ => None,
        });
        hold(tracks, &gears.collect());
        let mut resumed = Vec::new();
        for (last, mut query) in waiting {
            query.said = query.followed.weighed(&tracks[query.track]);
            match query.said {
                Said::Ends(end) => ends[query.answer] = end,
                _ => resumed.push((last, query)),
            }
        }
        queries = Box::new(resumed.into_iter());
    }
}

/// Computes for gears, each of a track and an order, whether flights stay in them.
///
/// A gear has one attractor at a time, so one orbit from beside the period-1 orbit decides. Long
/// transients count as lost: all of them leave gear sooner or later.
pub(super) fn hold(tracks: &[Endings], gears: &BTreeSet<(usize, u32)>) {
    let mut flown = Vec::new();
    for (track, order) in gears.iter().copied() {
        let mut held = Held {
            track,
            order,
            flights: 0,
            stays: true,
        };
        let map = &tracks[track].map;
        let mut orbit = Orbit::new(map, exponent::start_near_lock(map, order));
        // Up to its first impact: a period-1 orbit that does not exist begins with a throw.
        loop {
            match orbit.next() {
                Some(OrbitEvent::Impact(impact)) => {
                    if held.goes_on(&impact) {
                        flown.push((map, impact.next, held));
                    } else {
                        tracks[track].set_held(order, held.stays);
                    }
                    break;
                }
                Some(OrbitEvent::LiftOff { .. }) if held.flights == 0 => held.flights += 1,
                _ => {
                    tracks[track].set_held(order, false);
                    break;
                }
            }
        }
    }
    fly(
        flown.into_iter(),
        |held, impact| held.goes_on(impact),
        |held, _| {
            tracks[held.track].set_held(held.order, held.stays && held.flights >= MAX_GEAR_IMPACTS)
        },
    );
}

/// Irregular flights of one gear.
struct Held {
    track: usize,
    order: u32,
    flights: usize,
    stays: bool,
}

impl Held {
    fn goes_on(&mut self, impact: &Impact<PartState>) -> bool {
        let settled = self.flights >= SETTLING_IMPACTS;
        self.flights += 1;
        if settled {
            self.stays = gear::is_in_gear(impact.flight, TAU * f64::from(self.order));
        }
        self.stays && self.flights < MAX_GEAR_IMPACTS
    }
}

/// Number of orbits in a block: smallest; with fewer the registers are not full, and a sequence is
/// as fast.
const MIN_BLOCK_ORBITS: usize = 16;

/// A flying orbit.
struct Flying<'m, W> {
    lane: usize,
    map: &'m Map,
    last: PartState,
    watch: W,
}

/// Flies orbits side by side, each from its state just after an impact.
///
/// An orbit ends when `goes_on` returns false or when it rests; `done` gets its observer and its
/// last state.
fn fly<'m, W>(
    mut orbits: impl Iterator<Item = (&'m Map, PartState, W)>,
    mut goes_on: impl FnMut(&mut W, &Impact<PartState>) -> bool,
    mut done: impl FnMut(W, PartState),
) {
    let mut next = |lane: usize| {
        let (map, last, watch) = orbits.next()?;
        Some(Flying {
            lane,
            map,
            last,
            watch,
        })
    };
    let mut flying: Vec<_> = (0..LANES).map_while(&mut next).collect();
    if flying.len() >= MIN_BLOCK_ORBITS {
        let mut block = Block::new();
        for orbit in &flying {
            // Every lane is one of the block's.
            let _ = block.put(orbit.lane, orbit.map, orbit.last);
        }
        while flying.len() >= MIN_BLOCK_ORBITS {
            block.advance(1);
            let mut place = 0;
            while let Some(orbit) = flying.get_mut(place) {
                let lane = orbit.lane;
                // A lane that rests from the start has no impact.
                let struck = block.impact(lane).filter(|impact| impact.flight > 0.0);
                let on = struck.is_some_and(|impact| {
                    orbit.last = impact.next;
                    goes_on(&mut orbit.watch, &impact) && !block.rests(lane)
                });
                if on {
                    place += 1;
                    continue;
                }
                let ended = match next(lane) {
                    Some(new) => {
                        let _ = block.put(lane, new.map, new.last);
                        place += 1;
                        std::mem::replace(&mut flying[place - 1], new)
                    }
                    None => {
                        block.clear(lane);
                        flying.swap_remove(place)
                    }
                };
                done(ended.watch, ended.last);
            }
        }
    }
    for mut orbit in flying {
        for event in Orbit::new(orbit.map, orbit.last) {
            let OrbitEvent::Impact(impact) = event else {
                break;
            };
            orbit.last = impact.next;
            if !goes_on(&mut orbit.watch, &impact) {
                break;
            }
        }
        done(orbit.watch, orbit.last);
    }
}

#[cfg(test)]
mod tests {
    use kband::impact::Kernel;

    use super::*;

    /// Final regime of one orbit, event by event.
    fn alone(endings: &Endings, orbit: Orbit<'_>, mut followed: Followed) -> Option<Regime> {
        for event in orbit {
            match event {
                OrbitEvent::Impact(impact) => match followed.take(endings, &impact) {
                    Said::Ends(end) => return Some(end),
                    Said::GoesOn => {}
                    Said::Rests => return None,
                    Said::Asks(order) => {
                        let map = &endings.map;
                        let period = TAU * f64::from(order);
                        let mut orbit = Orbit::new(map, exponent::start_near_lock(map, order));
                        let stays = (0..MAX_GEAR_IMPACTS).all(|n| match orbit.next() {
                            Some(OrbitEvent::Impact(impact)) => {
                                n < SETTLING_IMPACTS || gear::is_in_gear(impact.flight, period)
                            }
                            Some(OrbitEvent::LiftOff { .. }) => n == 0,
                            Some(OrbitEvent::Rest { .. }) | None => false,
                        });
                        endings.set_held(order, stays);
                        if let Said::Ends(end) = followed.weighed(endings) {
                            return Some(end);
                        }
                    }
                },
                OrbitEvent::Rest { .. } => return None,
                OrbitEvent::LiftOff { .. } => {}
            }
        }
        None
    }

    #[test]
    fn many_tracks_side_by_side_end_as_each_alone() {
        // Through the cascade into chaos in gear and out of it, hops and rests, and above the limit
        // of lift-off.
        let places: Vec<(f64, f64)> = (0..40)
            .map(|n| 0.31 + 0.02 * f64::from(n))
            .flat_map(|k| [(k, 0.2), (k, 0.0), (k, 0.6)])
            .collect();
        let together = Endings::of_tracks(&places, 1500).unwrap();
        let start = PartState {
            phase: 0.7,
            velocity: 0.9,
        };
        let starts: Vec<(usize, PartState)> = (0..places.len()).map(|n| (n, start)).collect();
        let ends = of_each(&together, starts.into_iter());
        let mut chaotic = 0;
        for (n, (k, restitution)) in places.into_iter().enumerate() {
            let one = Endings::new(k, restitution, 1500).unwrap();
            let from_rest = Orbit::from_rest(&one.map);
            let after_rest = alone(&one, from_rest, Followed::new(FOLLOWED));
            let hops = matches!(
                together[n].from_rest(),
                Regime::HopAndRest { .. } | Regime::Rest
            );
            assert_eq!(after_rest.is_none(), hops, "{k} {restitution}");
            if let Some(end) = after_rest {
                assert_eq!(together[n].from_rest(), end, "{k} {restitution}");
            }
            assert_eq!(
                one.from_rest(),
                together[n].from_rest(),
                "{k} {restitution}"
            );
            let end = alone(&one, Orbit::new(&one.map, start), Followed::new(1500));
            assert_eq!(ends[n], end.unwrap_or(one.from_rest()), "{k} {restitution}");
            chaotic += u32::from(ends[n] == Regime::Chaotic);
        }
        assert!(chaotic > 0);
    }

    #[test]
    fn a_part_hops_and_rests_for_as_many_cycles_as_its_orbit_takes() {
        let start = PartState {
            phase: 0.7,
            velocity: 0.1,
        };
        for (k, restitution) in [(0.43, 0.2), (0.6, 0.5), (0.97, 0.1), (0.45, 0.0)] {
            let endings = Endings::new(k, restitution, 1500).unwrap();
            let map = Map::build(k, restitution).unwrap();
            let mut lifted = 0;
            let mut time = 0.0;
            for event in Orbit::from_rest(&map) {
                match event {
                    OrbitEvent::Impact(impact) => time += impact.flight,
                    OrbitEvent::Rest { chatter, .. } => time += chatter,
                    OrbitEvent::LiftOff { wait, .. } => {
                        lifted += 1;
                        if lifted == 2 {
                            time += wait;
                            break;
                        }
                    }
                }
            }
            let cycles = (time / TAU).round() as u32;
            // The table of certain rests, which many starts make, changes no answer.
            let many = Endings::new(k, restitution, 1500).unwrap();
            many.of_all([start; 64].into_iter());
            for endings in [endings, many] {
                assert_eq!(endings.from_rest(), Regime::HopAndRest { cycles }, "{k}");
            }
        }
    }
}
