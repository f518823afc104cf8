//! What an impact costs by how many are made, with one thread and with two.

use std::hint::black_box;
use std::time::Instant;

use kband::impact::batch::{Block, LANES};
use kband::impact::{Kernel, Map, PartState};

use super::median;
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;

/// The least that is made.
pub const LEAST: usize = 1000;
/// Where the orbits fly: chaos in gear, which never rests.
const K: f64 = 0.34;
const RESTITUTION: f64 = 0.2;
/// States from which orbits start.
const STARTS: usize = 4096;
/// Impacts of a task: of one orbit, or of a block of orbits.
const TASK: usize = 1 << 17;
/// Impacts of a point of fewer are made again and again, until so many have been made.
const MEASURED: usize = 1 << 20;

/// Nanoseconds for an impact where so many are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The kernel: `f64` one orbit after the other, `batch` in blocks.
    pub kernel: &'static str,
    /// Impacts that are made.
    pub impacts: usize,
    /// Nanoseconds for one, by threads.
    pub nanoseconds: [f64; 2],
}

/// Makes so many impacts of a task's orbits.
type Fly = fn(&Map, &[PartState], usize, usize);

/// Points in decades from [`LEAST`] to `most`, kernels and threads in turns; medians of so many rounds.
pub fn points(most: usize, rounds: usize, desk: &Desk) -> Result<Vec<Point>, Refusal> {
    let map = Map::build(K, RESTITUTION)?;
    let amounts: Vec<usize> = std::iter::successors(Some(LEAST), |amount| amount.checked_mul(10))
        .take_while(|amount| *amount <= most)
        .collect();
    let desks = [desk.with_threads(1)?, desk.with_threads(2)?];
    let starts = starts(&map);
    let kernels: [(&str, Fly); 2] = [("f64", chain), ("batch", block)];
    let progress = Progress::new("bench", (rounds * amounts.len()) as u64);
    let mut times = vec![[const { [const { Vec::new() }; 2] }; 2]; amounts.len()];
    for _ in 0..rounds {
        for (&amount, times) in amounts.iter().zip(&mut times) {
            for ((_, fly), times) in kernels.into_iter().zip(times) {
                for (desk, times) in desks.iter().zip(times) {
                    times.push(nanoseconds(
                        |task, impacts| fly(&map, &starts, task, impacts),
                        amount,
                        desk,
                    )?);
                }
            }
            progress.advance(1);
        }
    }
    progress.finish();
    let mut points = Vec::new();
    for (n, (kernel, _)) in kernels.into_iter().enumerate() {
        for (&impacts, times) in amounts.iter().zip(&mut times) {
            points.push(Point {
                kernel,
                impacts,
                nanoseconds: std::mem::take(&mut times[n]).map(median),
            });
        }
    }
    Ok(points)
}

/// Nanoseconds for one of `amount` impacts.
fn nanoseconds(
    fly: impl Fn(usize, usize) + Sync + Send,
    amount: usize,
    desk: &Desk,
) -> Result<f64, Refusal> {
    let tasks = amount.div_ceil(TASK);
    let again = (MEASURED / amount).max(1);
    let begun = Instant::now();
    for _ in 0..again {
        desk.quietly(tasks, |task| {
            let rest = amount - task * TASK;
            fly(task, rest.min(TASK));
        })?;
    }
    Ok(begun.elapsed().as_nanos() as f64 / (again * amount) as f64)
}

/// States along one orbit that stays in gear: from there others do.
fn starts(map: &Map) -> Vec<PartState> {
    let first = PartState {
        phase: 0.7,
        velocity: 0.36,
    };
    let next = |state: &PartState| Some(map.impact(*state).next);
    std::iter::successors(Some(first), next)
        .take(STARTS)
        .collect()
}

/// So many impacts of one orbit, each from where the one before ended.
fn chain(map: &Map, starts: &[PartState], task: usize, impacts: usize) {
    let mut state = starts[task % STARTS];
    for _ in 0..impacts {
        state = map.impact(state).next;
    }
    black_box(state);
}

/// So many impacts of a block of orbits, or up to a lane's worth more.
fn block(map: &Map, starts: &[PartState], task: usize, impacts: usize) {
    let mut block = Block::new();
    let lanes = impacts.min(LANES);
    for lane in 0..lanes {
        // Every start is a state of the map.
        let _ = block.put(lane, map, starts[(task * LANES + lane) % STARTS]);
    }
    block.advance(impacts.div_ceil(lanes.max(1)) as u32);
    black_box(block.state(0));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_orbit_that_is_timed_rests() {
        let map = Map::build(K, RESTITUTION).unwrap();
        let mut block = Block::new();
        for starts in starts(&map).chunks(LANES) {
            for (lane, start) in starts.iter().enumerate() {
                block.put(lane, &map, *start).unwrap();
            }
            block.advance(TASK as u32 / LANES as u32);
            assert_eq!(block.resting().count(), 0);
        }
    }

    #[test]
    fn each_decade_has_a_point_for_each_kernel() {
        let points = points(10_000, 1, &Desk::new(Some(1)).unwrap()).unwrap();
        let told: Vec<_> = points
            .iter()
            .map(|point| (point.kernel, point.impacts))
            .collect();
        assert_eq!(
            told,
            [
                ("f64", 1000),
                ("f64", 10_000),
                ("batch", 1000),
                ("batch", 10_000)
            ]
        );
        let times = points.iter().flat_map(|point| point.nanoseconds);
        assert!(times.into_iter().all(|time| time > 0.0), "{points:?}");
    }
}
