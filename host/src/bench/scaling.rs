//! Run time per impact by number of impacts, with one thread and with two.

use std::hint::black_box;
use std::time::Instant;

use kband::impact::batch::{Block, LANES};
use kband::impact::{Kernel, Map, PartState};

use super::median;
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;

/// Number of impacts: smallest.
pub const LEAST: usize = 1000;
/// Track of the orbits: chaos in gear, which never rests.
const K: f64 = 0.34;
const RESTITUTION: f64 = 0.2;
/// Number of start states.
const STARTS: usize = 4096;
/// Impacts per task: of one orbit, or of a block of orbits.
const TASK: usize = 1 << 17;
/// Impacts per point: smaller numbers are repeated until this total.
const MEASURED: usize = 1 << 20;

/// Run time per impact for one number of impacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Kernel: `f64` one orbit after the other, `batch` in blocks.
    pub kernel: &'static str,
    /// Number of impacts.
    pub impacts: usize,
    /// Run time per impact in ns, with one thread and with two.
    pub nanoseconds: [f64; 2],
}

/// Makes the impacts of a task: map, starts, task number, number of impacts.
type Fly = fn(&Map, &[PartState], usize, usize);

/// Points in decades from [`LEAST`] to `most`: medians over `rounds`, kernels and threads in turns.
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

/// Run time per impact in ns, for `amount` impacts.
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

/// States along one orbit that stays in gear; other orbits from these stay there, too.
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

/// `impacts` impacts of one orbit, each from the end of the one before.
fn chain(map: &Map, starts: &[PartState], task: usize, impacts: usize) {
    let mut state = starts[task % STARTS];
    for _ in 0..impacts {
        state = map.impact(state).next;
    }
    black_box(state);
}

/// `impacts` impacts of a block of orbits, or up to a lane's worth more.
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
