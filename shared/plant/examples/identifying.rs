//! Accuracy of identification for lots with random restitution (docs/commissioning.md).
//!
//! It prints the number of answers, their errors, and the number of false answers. An answer is
//! false if its error exceeds three of its estimated errors.
//!
//! `cargo run --release -p kband-plant --example identifying SEEDS FIRST
//! FIDELITY`, with FIDELITY `envelope` or `waveform`.

use std::ops::Range;

use kband_control::{Identification, Identified, Report, Settings, Target, Unidentified};
use kband_plant::{ClosedLoop, EnvelopeLoop, Scene};
use rayon::prelude::*;

/// Drive cycles: upper bound of an identification.
const LONGEST: usize = 4100;

/// A lot: restitution, scatter and number of its parts.
pub type Lot = (f32, f32, usize);

/// Drive frequency in Hz and decay time of the track's ringing in ms, of the built-in feeder.
pub const BUILT_IN: [f32; 2] = [50.0, 1.0];

fn heard(lot: Lot, track: [f32; 2], seed: u64, waveform: bool) -> Identification {
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
    let mut reports: Box<dyn Iterator<Item = Report>> = if waveform {
        let mut closed = ClosedLoop::build(&scene).expect("the lots are feeders");
        Box::new(std::iter::from_fn(move || Some(closed.cycle().report)))
    } else {
        let mut closed = EnvelopeLoop::build(&scene).expect("the lots are feeders");
        Box::new(std::iter::from_fn(move || Some(closed.cycle().report)))
    };
    let mut told = reports
        .by_ref()
        .take(LONGEST)
        .map(|report| report.identification);
    told.find(|told| {
        !matches!(
            told,
            Identification::Idle | Identification::Listening { .. }
        )
    })
    .expect("an identification ends")
}

/// The answers from runs with these seeds.
pub fn answers(lot: Lot, track: [f32; 2], seeds: Range<u64>, waveform: bool) -> Vec<Identified> {
    let runs = seeds.map(|seed| heard(lot, track, seed, waveform));
    runs.filter_map(|run| match run {
        Identification::Found(found) => Some(found),
        _ => None,
    })
    .collect()
}

/// A cell of the manual's tables: the number of answers where some are missing, and the largest
/// error.
///
/// It panics on a false answer, whose error exceeds three of its estimated errors.
pub fn cell(lot: Lot, track: [f32; 2], seeds: Range<u64>, waveform: bool) -> String {
    let runs = seeds.end - seeds.start;
    let answers = answers(lot, track, seeds, waveform);
    let mut largest = 0.0_f32;
    for found in &answers {
        let apart = (found.restitution - lot.0).abs();
        assert!(
            apart < 3.0 * found.deviation,
            "{lot:?} {track:?}: {found:?}"
        );
        largest = largest.max(apart);
    }
    match answers.len() as u64 {
        0 => "-".into(),
        all if all == runs => format!("{largest:.4}"),
        some => format!("{some} of {runs}: {largest:.4}"),
    }
}

fn main() {
    let given: Vec<_> = std::env::args().skip(1).collect();
    let number = |n: usize, otherwise| {
        let given = given.get(n);
        given.map_or(otherwise, |given| given.parse().expect("a whole number"))
    };
    let (seeds, first) = (number(0, 2_u64), number(1, 1_u64));
    let waveform = match given.get(2).map(String::as_str) {
        None | Some("waveform") => true,
        Some("envelope") => false,
        Some(other) => panic!("{other} is no fidelity: envelope or waveform"),
    };
    let mut lots: Vec<Lot> = Vec::new();
    for parts in [1, 2, 3, 6] {
        for scatter in [0.0, 0.02, 0.05, 0.10, 0.15] {
            lots.extend((1..=7_u8).map(|tenths| (f32::from(tenths) / 10.0, scatter, parts)));
        }
    }
    let found: Vec<Vec<Identification>> = lots
        .par_iter()
        .map(|&lot| {
            let runs = (first..first + seeds).map(|seed| heard(lot, BUILT_IN, seed, waveform));
            runs.collect()
        })
        .collect();
    println!(
        "parts  s     R    answered  false  farthest  in errors  error told  scatter told  refused as"
    );
    for ((restitution, scatter, parts), runs) in lots.into_iter().zip(found) {
        let answers: Vec<_> = runs
            .iter()
            .filter_map(|run| match run {
                Identification::Found(found) => Some(found),
                _ => None,
            })
            .collect();
        let refused: Vec<Unidentified> = runs
            .iter()
            .filter_map(|run| match run {
                Identification::NotFound(why) => Some(*why),
                _ => None,
            })
            .collect();
        let apart = answers
            .iter()
            .map(|found| (found.restitution - restitution).abs());
        let errors = apart
            .clone()
            .zip(&answers)
            .map(|(apart, found)| apart / found.deviation);
        let wrong = errors.clone().filter(|errors| *errors > 3.0).count();
        let mean = |of: fn(&&&Identified) -> f32| {
            let sum: f32 = answers.iter().map(|found| of(&found)).sum();
            sum / answers.len().max(1) as f32
        };
        println!(
            "{parts:<6} {scatter:<5} {restitution:<4} {:8}  {wrong:5}  {:8.4}  {:9.1}  {:10.4}  {:12.3}  {refused:?}",
            answers.len(),
            apart.fold(0.0, f32::max),
            errors.fold(0.0, f32::max),
            mean(|found| found.deviation),
            mean(|found| found.scatter),
        );
    }
}
