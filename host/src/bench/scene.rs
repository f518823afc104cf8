//! Run time of a drive cycle of the closed loop, in both fidelities.

use std::time::Instant;

use kband::plant::{ClosedLoop, EnvelopeLoop, Scene};

use super::{Measurement, median};

/// Drive cycles of the default scene until the kick has led to the lock.
const SETTLED: usize = 500;
/// Drive cycles per turn: half a millisecond, shorter than a time slice of a busy machine.
const WAVEFORM: usize = 30;
const ENVELOPE: usize = 2_000;

/// A long hold of the default scene, waveform and envelope turn by turn.
///
/// Its part is locked, one impact a cycle, so the time per impact is that of a cycle.
#[must_use]
pub fn lines(turns: usize) -> Vec<Measurement> {
    let scene = Scene::default();
    let (Ok(mut waveform), Ok(mut envelope)) =
        (ClosedLoop::build(&scene), EnvelopeLoop::build(&scene))
    else {
        return Vec::new();
    };
    envelope.watch(false);
    let mut times = [Vec::new(), Vec::new()];
    let mut turn = |cycles: [usize; 2]| {
        let begun = Instant::now();
        for _ in 0..cycles[0] {
            std::hint::black_box(waveform.cycle());
        }
        let between = Instant::now();
        for _ in 0..cycles[1] {
            envelope.advance();
        }
        std::hint::black_box(envelope.moment());
        [between - begun, between.elapsed()]
    };
    turn([SETTLED; 2]);
    for _ in 0..turns {
        let took = turn([WAVEFORM, ENVELOPE]);
        for ((times, took), cycles) in times.iter_mut().zip(took).zip([WAVEFORM, ENVELOPE]) {
            times.push(took.as_nanos() as f64 / cycles as f64);
        }
    }
    let line = |(kernel, times)| Measurement {
        kernel,
        workload: "scene",
        nanoseconds: median(times),
        errors: None,
    };
    ["waveform", "envelope"]
        .into_iter()
        .zip(times)
        .map(line)
        .collect()
}

/// Simulated time over run time of a measurement, for cycles of the default scene.
#[must_use]
pub fn times_real_time(line: &Measurement) -> f64 {
    1e9 / f64::from(Scene::default().settings.frequency) / line.nanoseconds
}
