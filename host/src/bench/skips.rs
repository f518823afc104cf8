//! Time saved by each shortcut: the same work with and without it.

use std::hint::black_box;
use std::time::Instant;

use kband::impact::{
    Count, Impact, Kernel, Map, Observer, Orbit, PartState, PassedHumps, Skips, Tangential,
    TangentialSettings,
};

use super::{Measurement, median, workload::Workload};

/// Number of impacts of the measured orbits.
const IMPACTS: u64 = 4_000;

/// Velocity along the track of an orbit.
struct Along {
    tangential: Tangential,
    velocity: f64,
}

impl Observer for Along {
    fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
        self.velocity = self.tangential.after(launch, impact, self.velocity);
    }

    fn rest(&mut self, _: PartState, _: f64, _: f64) {
        self.velocity = 0.0;
    }
}

/// Measurements of every shortcut: kernel `f64` uses it, `f64-unskipped` does all the work.
///
/// The results have the same bits.
#[must_use]
pub fn lines(turns: usize) -> Vec<Measurement> {
    let mut lines = Vec::new();
    let launches = Workload::High.launches(2_048);
    let maps: Vec<(Map, PartState)> = launches
        .iter()
        .filter_map(|launch| Some((Map::build(launch.k, launch.restitution).ok()?, launch.state)))
        .collect();
    let search = |envelope| {
        for (map, state) in &maps {
            black_box(map.search(*state, envelope));
        }
        maps.len() as u64
    };
    lines.extend(pair(
        "envelope",
        turns,
        || search(PassedHumps::Skip),
        || search(PassedHumps::Walk),
    ));

    // A part that rests in every cycle (k = 0.43, R = 0.1), and one that always hops (R = 0.8).
    if let (Ok(resting), Ok(hopping)) = (Map::build(0.43, 0.1), Map::build(0.3, 0.8)) {
        let settings = TangentialSettings {
            restitution: 0.5,
            amplitude_ratio: 1.5,
            phase_lead: 0.0,
            incline_tangent: 0.05,
        };
        let start = PartState {
            phase: 1.0,
            velocity: 2.0,
        };
        let orbit = |map: &Map, skips: Skips| {
            let mut count = Count::default();
            Orbit::new(map, start)
                .with(skips)
                .watch(IMPACTS, &mut count);
            black_box(count);
            IMPACTS
        };
        let all = Skips {
            repeat: false,
            ..Skips::default()
        };
        if let Ok(tangential) = Tangential::build(0.3, settings) {
            let watched = || {
                let mut along = Along {
                    tangential,
                    velocity: 0.0,
                };
                Orbit::new(&hopping, start)
                    .with(all)
                    .watch(IMPACTS, &mut along);
                black_box(along.velocity);
                IMPACTS
            };
            lines.extend(pair("tangential", turns, || orbit(&hopping, all), watched));
        }
        let without = [
            (
                "rest-jump",
                Skips {
                    rest_jump: false,
                    ..all
                },
            ),
            (
                "release",
                Skips {
                    release: false,
                    ..all
                },
            ),
        ];
        for (name, skips) in without {
            lines.extend(pair(
                name,
                turns,
                || orbit(&resting, all),
                || orbit(&resting, skips),
            ));
        }
        lines.extend(pair(
            "repeat",
            turns,
            || orbit(&resting, Skips::default()),
            || orbit(&resting, all),
        ));
    }
    lines
}

/// Two measurements, turn by turn; each function returns its number of impacts.
fn pair(
    name: &'static str,
    turns: usize,
    skipped: impl Fn() -> u64,
    unskipped: impl Fn() -> u64,
) -> [Measurement; 2] {
    let time = |work: &dyn Fn() -> u64| {
        let begun = Instant::now();
        let impacts = work();
        begun.elapsed().as_nanos() as f64 / impacts as f64
    };
    let (mut with, mut without) = (Vec::new(), Vec::new());
    for _ in 0..turns {
        with.push(time(&skipped));
        without.push(time(&unskipped));
    }
    let line = |kernel, times| Measurement {
        kernel,
        workload: name,
        nanoseconds: median(times),
        errors: None,
    };
    [line("f64", with), line("f64-unskipped", without)]
}
