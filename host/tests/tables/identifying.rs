//! Accuracy of identification for lots with random restitution (docs/commissioning.md).
//!
//! An answer is false if its error exceeds three of its estimated errors.

use std::ops::Range;

use kband_control::{Identification, Settings, Target};
use kband_plant::{ClosedLoop, Scene};

/// Drive cycles: upper bound of an identification.
const LONGEST: usize = 4100;

/// A lot: restitution, scatter and number of its parts.
pub type Lot = (f32, f32, usize);

/// Drive frequency in Hz and decay time of the track's ringing in ms, of the built-in feeder.
pub const BUILT_IN: [f32; 2] = [50.0, 1.0];

fn heard(lot: Lot, track: [f32; 2], seed: u64) -> Identification {
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
    let mut told = (0..LONGEST).map(|_| closed.cycle().report.identification);
    told.find(|told| {
        !matches!(
            told,
            Identification::Idle | Identification::Listening { .. }
        )
    })
    .expect("an identification ends")
}

/// A cell of the manual's tables: the number of answers where some are missing, and the largest
/// error.
///
/// It panics on a false answer, whose error exceeds three of its estimated errors.
pub fn cell(lot: Lot, track: [f32; 2], seeds: Range<u64>) -> String {
    let runs = seeds.end - seeds.start;
    let (mut answers, mut largest) = (0, 0.0_f32);
    for seed in seeds {
        let Identification::Found(found) = heard(lot, track, seed) else {
            continue;
        };
        answers += 1;
        let apart = (found.restitution - lot.0).abs();
        assert!(
            apart < 3.0 * found.deviation,
            "{lot:?} {track:?}: {found:?}"
        );
        largest = largest.max(apart);
    }
    match answers {
        0 => "-".into(),
        all if all == runs => format!("{largest:.4}"),
        some => format!("{some} of {runs}: {largest:.4}"),
    }
}
