//! The kernels on a track of two tones, side by side.

use std::hint::black_box;
use std::time::Instant;

use kband::impact::{Kernel, PartState, Tone, WaveKernel, WaveMap, WaveSingle};

use super::Errors;
use super::contest::{Contestant, Judge, LAUNCHES, per_impact, slice};
use super::workload::{Launch, TOGETHER, Workload};

/// Second tone, within a drive's limits; it keeps parts of restitution 0.1 to 0.5 in gear.
const TONES: [Tone; 2] = [
    Tone {
        amplitude: 0.15,
        angle: 2.356,
    },
    Tone {
        amplitude: 0.0,
        angle: 0.0,
    },
];

/// All contestants on two tones, with about as many launches as on one.
#[must_use]
pub fn contestants(workload: Workload, count: usize) -> Vec<Box<dyn Contestant>> {
    let launches = workload.launches_on(TONES, count);
    vec![
        Box::new(Waves::<WaveMap>::new(&launches)),
        Box::new(Waves::<WaveSingle>::new(&launches)),
    ]
}

/// The launches of one track.
struct Track<K: Kernel> {
    kernel: K,
    states: Vec<K::State>,
    launches: Vec<Launch>,
}

/// One kernel, one impact at a time.
struct Waves<K: Kernel> {
    tracks: Vec<Track<K>>,
}

impl<K: WaveKernel> Waves<K> {
    fn new(launches: &[Launch]) -> Self {
        let track = |launches: &[Launch]| {
            let Launch { k, restitution, .. } = *launches.first()?;
            let kernel = K::on_tones(TONES, k, restitution).ok()?;
            // Leaves out launches that the arithmetic cannot represent.
            let ready = launches.iter().filter_map(|launch| {
                let state = K::state(launch.state.phase, launch.state.velocity).ok()?;
                Some((state, *launch))
            });
            let (states, launches) = ready.unzip();
            Some(Track {
                kernel,
                states,
                launches,
            })
        };
        Self {
            tracks: launches.chunks(TOGETHER).filter_map(track).collect(),
        }
    }

    fn turns(&self) -> usize {
        self.tracks.len().div_ceil(LAUNCHES / TOGETHER)
    }

    fn judged(&self, impacts: impl Fn(&Track<K>) -> Vec<(f64, PartState)>) -> Errors {
        let mut judge = Judge::default();
        for track in &self.tracks {
            let Some(Launch { k, restitution, .. }) = track.launches.first() else {
                continue;
            };
            let Ok(map) = WaveMap::on_tones(TONES, *k, *restitution) else {
                continue;
            };
            for (state, (flight, next)) in track.states.iter().zip(impacts(track)) {
                judge.compare(&map.impact(K::observe(*state)), flight, next.phase);
            }
        }
        judge.verdict()
    }
}

impl<K: WaveKernel> Contestant for Waves<K> {
    fn name(&self) -> &'static str {
        K::NAME
    }

    fn turns(&self) -> usize {
        Self::turns(self)
    }

    fn turn(&mut self, n: usize) -> f64 {
        let tracks = slice(&self.tracks, n, LAUNCHES / TOGETHER);
        let begun = Instant::now();
        let mut count = 0;
        for track in tracks {
            for state in &track.states {
                black_box(&track.kernel.impact(*state));
            }
            count += track.states.len();
        }
        per_impact(begun.elapsed(), count)
    }

    fn errors(&mut self) -> Errors {
        self.judged(|track| {
            let impact = |state: &K::State| {
                let impact = track.kernel.impact(*state);
                (impact.flight, K::observe(impact.next))
            };
            track.states.iter().map(impact).collect()
        })
    }
}
