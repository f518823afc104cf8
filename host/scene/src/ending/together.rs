//! Final regimes of many orbits at once: in blocks, several times faster than single ones.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use kband::impact::batch::{Block, LANES};
use kband::impact::{Impact, OrbitEvent, PartState};
use kband::regime::classify::Regime;
use kband::regime::gear;

use super::followed::{Followed, Verdict};
use super::{Endings, MAX_ORBIT_IMPACTS};

/// Number of impacts for which irregular flights must stay in gear to count as chaos. Of 89 000
/// orbits below the flips (orders 1 to 3, R 0.025 to 0.925), from next to the period-1 orbit, the
/// last left after 29 640 impacts; 6500 stayed for 100 000.
const MAX_GEAR_IMPACTS: usize = 40_000;
const SETTLING_IMPACTS: usize = 1000;

/// Final regimes of parts that start just after an impact, each on one of `tracks` by its number.
pub fn of_each(
    tracks: &[Endings],
    starts: impl ExactSizeIterator<Item = (usize, PartState)>,
) -> Vec<Regime> {
    let mut ends = vec![Regime::Undecided; starts.len()];
    let queries = starts.enumerate().map(|(index, (track, start))| {
        let followed = Followed::new(tracks[track].impacts);
        (start, Query::new(index, track, followed))
    });
    follow(tracks, queries, &mut ends, |query, _| {
        tracks[query.track].from_rest()
    });
    ends
}

/// Final regimes of parts from rest; one that rests again has the cycles between lift-offs.
pub(super) fn after_rest(tracks: &[Endings]) -> Vec<Regime> {
    let mut ends = vec![Regime::Rest; tracks.len()];
    let mut thrown = Vec::new();
    for (track, endings) in tracks.iter().enumerate() {
        // A block cannot start from rest: a single orbit computes the first flight.
        let first = endings.orbit(None).find_map(|event| match event {
            OrbitEvent::Impact(impact) => Some(impact),
            _ => None,
        });
        let Some(first) = first else { continue };
        let followed = Followed::new(endings.impacts.max(MAX_ORBIT_IMPACTS));
        let mut query = Query::new(track, track, followed);
        if query.add_impact(endings, &first) {
            thrown.push((first.next, query));
        } else {
            ends[track] = match query.verdict {
                Verdict::Ends(end) => end,
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
    let cycles = (query.followed.time + until_lift_off(&tracks[query.track], last)) / TAU;
    Regime::HopAndRest {
        cycles: cycles.round() as u32,
    }
}

/// Time in rad from the last impact before a rest to the next lift-off.
fn until_lift_off(endings: &Endings, last: PartState) -> f64 {
    let mut time = 0.0;
    for event in endings.orbit(Some(last)) {
        match event {
            OrbitEvent::Impact(impact) => time += impact.flight,
            OrbitEvent::Rest { chatter, .. } => time += chatter,
            OrbitEvent::LiftOff { wait, .. } => return time + wait,
        }
    }
    time
}

struct Query {
    index: usize,
    track: usize,
    followed: Followed,
    verdict: Verdict,
}

impl Query {
    fn new(index: usize, track: usize, followed: Followed) -> Self {
        Self {
            index,
            track,
            followed,
            verdict: Verdict::Continues,
        }
    }

    fn add_impact(&mut self, endings: &Endings, impact: &Impact<PartState>) -> bool {
        let verdict = self.followed.take(endings, impact);
        if verdict == Verdict::Continues {
            return true;
        }
        self.verdict = verdict;
        false
    }
}

/// Follows orbits to their final regimes, those that depend on gear once it is computed for all.
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
            queries.map(|(start, query)| (&tracks[query.track], start, query)),
            |query, impact| query.add_impact(&tracks[query.track], impact),
            |query, last| match query.verdict {
                Verdict::Ends(end) => ends[query.index] = end,
                Verdict::Continues | Verdict::Rests => ends[query.index] = rested(&query, last),
                Verdict::NeedsGear(_) => waiting.push((last, query)),
            },
        );
        if waiting.is_empty() {
            return;
        }
        let gears = waiting.iter().filter_map(|(_, query)| match query.verdict {
            Verdict::NeedsGear(order) => Some((query.track, order)),
            _ => None,
        });
        hold(tracks, &gears.collect());
        let mut resumed = Vec::new();
        for (last, mut query) in waiting {
            query.verdict = query.followed.judge(&tracks[query.track]);
            match query.verdict {
                Verdict::Ends(end) => ends[query.index] = end,
                _ => resumed.push((last, query)),
            }
        }
        queries = Box::new(resumed.into_iter());
    }
}

/// Computes whether flights stay in gear, for pairs of a track and an order. A gear has one
/// attractor at a time, so one orbit from near the period-1 orbit decides.
pub(super) fn hold(tracks: &[Endings], gears: &BTreeSet<(usize, u32)>) {
    let mut flown = Vec::new();
    for (track, order) in gears.iter().copied() {
        let mut trial = Trial {
            track,
            order,
            flights: 0,
            stays: true,
        };
        let endings = &tracks[track];
        let mut orbit = endings.orbit(Some(endings.start_near_lock(order)));
        let mut first = orbit.next();
        // Without a period-1 orbit the start is a lift-off.
        if let Some(OrbitEvent::LiftOff { .. }) = first {
            trial.flights += 1;
            first = orbit.next();
        }
        let Some(OrbitEvent::Impact(impact)) = first else {
            endings.set_stays(order, false);
            continue;
        };
        if trial.add_impact(&impact) {
            flown.push((endings, impact.next, trial));
        } else {
            endings.set_stays(order, trial.stays);
        }
    }
    fly(
        flown.into_iter(),
        |trial, impact| trial.add_impact(impact),
        |trial, _| {
            let stays = trial.stays && trial.flights >= MAX_GEAR_IMPACTS;
            tracks[trial.track].set_stays(trial.order, stays);
        },
    );
}

struct Trial {
    track: usize,
    order: u32,
    flights: usize,
    stays: bool,
}

impl Trial {
    fn add_impact(&mut self, impact: &Impact<PartState>) -> bool {
        let settled = self.flights >= SETTLING_IMPACTS;
        self.flights += 1;
        if settled {
            self.stays = gear::is_in_gear(impact.flight, TAU * f64::from(self.order));
        }
        self.stays && self.flights < MAX_GEAR_IMPACTS
    }
}

/// Smallest number of orbits in a block. Below it single orbits are as fast.
const MIN_BLOCK_ORBITS: usize = 16;

struct Flying<'m, W> {
    lane: usize,
    endings: &'m Endings,
    last: PartState,
    watch: W,
}

/// Flies orbits side by side, each until `add_impact` returns false or it rests; then `done`.
fn fly<'m, W>(
    mut orbits: impl Iterator<Item = (&'m Endings, PartState, W)>,
    mut add_impact: impl FnMut(&mut W, &Impact<PartState>) -> bool,
    mut done: impl FnMut(W, PartState),
) {
    let mut next = |lane: usize| {
        let (endings, last, watch) = orbits.next()?;
        Some(Flying {
            lane,
            endings,
            last,
            watch,
        })
    };
    let mut flying: Vec<_> = (0..LANES).map_while(&mut next).collect();
    if flying.len() >= MIN_BLOCK_ORBITS {
        let mut block = Block::new();
        for orbit in &flying {
            // Every lane is within the block.
            let _ = block.put(orbit.lane, &orbit.endings.map, orbit.last);
        }
        while flying.len() >= MIN_BLOCK_ORBITS {
            block.advance(1);
            let mut place = 0;
            while let Some(orbit) = flying.get_mut(place) {
                let lane = orbit.lane;
                // A lane at rest from the start has no impact.
                let struck = block.impact(lane).filter(|impact| impact.flight > 0.0);
                let on = struck.is_some_and(|touch| {
                    let impact = orbit.endings.extend(touch);
                    orbit.last = impact.next;
                    if !orbit.endings.contact.is_instant() {
                        // The block ends at the touch; the launch after the contact is a new start.
                        let _ = block.put(lane, &orbit.endings.map, orbit.last);
                    }
                    add_impact(&mut orbit.watch, &impact) && !block.rests(lane)
                });
                if on {
                    place += 1;
                    continue;
                }
                let ended = match next(lane) {
                    Some(new) => {
                        let _ = block.put(lane, &new.endings.map, new.last);
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
        for event in orbit.endings.orbit(Some(orbit.last)) {
            let OrbitEvent::Impact(impact) = event else {
                break;
            };
            orbit.last = impact.next;
            if !add_impact(&mut orbit.watch, &impact) {
                break;
            }
        }
        done(orbit.watch, orbit.last);
    }
}

#[cfg(test)]
mod tests {
    use kband::impact::{ContactTime, Kernel, Map, Orbit};

    use super::*;

    fn alone(
        endings: &Endings,
        start: Option<PartState>,
        mut followed: Followed,
    ) -> Option<Regime> {
        for event in endings.orbit(start) {
            match event {
                OrbitEvent::Impact(impact) => match followed.take(endings, &impact) {
                    Verdict::Ends(end) => return Some(end),
                    Verdict::Continues => {}
                    Verdict::Rests => return None,
                    Verdict::NeedsGear(order) => {
                        let period = TAU * f64::from(order);
                        let mut orbit = endings.orbit(Some(endings.start_near_lock(order)));
                        let stays = (0..MAX_GEAR_IMPACTS).all(|n| match orbit.next() {
                            Some(OrbitEvent::Impact(impact)) => {
                                n < SETTLING_IMPACTS || gear::is_in_gear(impact.flight, period)
                            }
                            Some(OrbitEvent::LiftOff { .. }) => n == 0,
                            Some(OrbitEvent::Rest { .. }) | None => false,
                        });
                        endings.set_stays(order, stays);
                        if let Verdict::Ends(end) = followed.judge(endings) {
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
        // The cascade, chaos in and out of gear, hopping and resting, and k above 1.
        let places: Vec<(f64, f64)> = (0..40)
            .map(|n| 0.31 + 0.02 * f64::from(n))
            .flat_map(|k| [(k, 0.2), (k, 0.0), (k, 0.6)])
            .collect();
        let mut chaotic = 0;
        let all = [0.0, 0.1].map(|c| {
            let contact = ContactTime::build(c).unwrap();
            let together = Endings::from_tracks(&places, 1500, contact).unwrap();
            let start = PartState::new(0.7, 0.9);
            let starts: Vec<(usize, PartState)> = (0..places.len()).map(|n| (n, start)).collect();
            let ends = of_each(&together, starts.into_iter());
            for (n, (k, restitution)) in places.iter().copied().enumerate() {
                let one = Endings::with_contact(k, restitution, 1500, contact).unwrap();
                let after_rest = alone(&one, None, Followed::new(MAX_ORBIT_IMPACTS));
                let from_rest = together[n].from_rest();
                let hops = matches!(from_rest, Regime::HopAndRest { .. } | Regime::Rest);
                assert_eq!(after_rest.is_none(), hops, "{k} {restitution}");
                if let Some(end) = after_rest {
                    assert_eq!(from_rest, end, "{k} {restitution}");
                }
                assert_eq!(one.from_rest(), from_rest, "{k} {restitution}");
                let end = alone(&one, Some(start), Followed::new(1500));
                assert_eq!(ends[n], end.unwrap_or(one.from_rest()), "{k} {restitution}");
                chaotic += u32::from(ends[n] == Regime::Chaotic);
            }
            ends
        });
        assert!(chaotic > 0 && all[0] != all[1]);
    }

    #[test]
    fn a_part_hops_and_rests_for_as_many_cycles_as_its_orbit_takes() {
        let start = PartState::new(0.7, 0.1);
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
            // The table of states that certainly come to rest, for many starts, changes no result.
            let many = Endings::new(k, restitution, 1500).unwrap();
            many.classify_all([start; 64].into_iter());
            for endings in [endings, many] {
                assert_eq!(endings.from_rest(), Regime::HopAndRest { cycles }, "{k}");
            }
        }
    }
}
