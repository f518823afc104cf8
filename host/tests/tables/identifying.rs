//! Accuracy of identification for lots with random restitution (docs/commissioning.md). A result is
//! false if its error exceeds three of its estimated standard errors.

use std::ops::Range;

use kband_control::Identification::{self, Idle, Listening};
use kband_control::{Settings, Target};
use kband_plant::{ClosedLoop, Scene};

const MAX_CYCLES: usize = 4100;

/// A lot: restitution, scatter and number of parts.
pub type Lot = (f32, f32, usize);

/// Drive frequency in Hz and decay time of the track's ringing in ms, of the default feeder.
pub const BUILT_IN_TRACK: [f32; 2] = [50.0, 1.0];

fn identify(lot: Lot, track: [f32; 2], seed: u64) -> Identification {
    let (restitution, scatter, parts) = lot;
    let [frequency, decay] = track;
    let mut scene = Scene {
        target: Target::Identify,
        parts: std::iter::repeat_n(restitution, parts).collect(),
        scatter: std::iter::repeat_n(scatter, parts).collect(),
        settings: Settings {
            restitution_low: 0.0,
            restitution_high: 0.9,
            frequency,
            resonance: frequency,
            ..Settings::default()
        },
        seed,
        ..Scene::default()
    };
    scene.drive.resonance = frequency;
    scene.sensor.ringing_decay = decay;
    let mut closed = ClosedLoop::build(&scene).expect("the lots are feeders");
    let mut results = (0..MAX_CYCLES).map(|_| closed.cycle().report.identification);
    let ended = results.find(|result| !matches!(result, Idle | Listening { .. }));
    ended.expect("an identification ends")
}

/// The largest error, and the number of results if some are missing; panics on a false result.
pub fn cell(lot: Lot, track: [f32; 2], seeds: Range<u64>) -> String {
    let runs = seeds.end - seeds.start;
    let (mut answers, mut largest) = (0, 0.0_f32);
    for seed in seeds {
        let Identification::Found(result) = identify(lot, track, seed) else {
            continue;
        };
        answers += 1;
        let error = (result.restitution - lot.0).abs();
        let is_true = error < 3.0 * result.deviation;
        assert!(is_true, "{lot:?} {track:?}: {result:?}");
        largest = largest.max(error);
    }
    match answers {
        0 => "-".into(),
        all if all == runs => format!("{largest:.4}"),
        some => format!("{some} of {runs}: {largest:.4}"),
    }
}
