//! Track shape with the largest share in gear under one peak acceleration, with scatter, by random
//! search over shapes of one, two and three tones and local refinement.

use std::error::Error;
use std::f64::consts::TAU;

use kband::impact::{ContactTime, Scatter, Tone, Wave, WaveMap};
use kband::regime::gear::{Share, shares_from_rest};
use kband_host::random::SplitMix;

/// k, e, th, e3, th3.
type Shape = [f64; 5];

/// Largest acceleration of the track in units of gravity across the track: max |S''| over k.
fn peak([k, e, th, e3, th3]: Shape) -> f64 {
    let push = |n| {
        let t = TAU * f64::from(n) / 720.0;
        t.sin() + 4.0 * e * (2.0 * t + th).sin() + 9.0 * e3 * (3.0 * t + th3).sin()
    };
    (0..720).map(|n| push(n).abs()).fold(0.0, f64::max) / k
}

/// Share of time in gear of `parts`, over the last three quarters of `periods` from rest.
fn share(
    [k, e, th, e3, th3]: Shape,
    [restitution, deviation]: [f64; 2],
    seed: u64,
    parts: usize,
    periods: f64,
) -> Result<f64, Box<dyn Error>> {
    let tone = |amplitude, angle| Tone { amplitude, angle };
    let map = WaveMap::on(Wave::build(tone(e, th), tone(e3, th3))?, k, restitution)?;
    let scatters: Vec<Scatter> = (0..parts)
        .map(|part| Scatter::build(restitution, deviation, seed + part as u64))
        .collect::<Result<_, _>>()?;
    let mut sum = Share::default();
    let add = |_, share: Share| sum = sum.plus(&share);
    shares_from_rest(&map, ContactTime::INSTANT, &scatters, 1, periods, add)?;
    Ok(sum.share())
}

/// Best of `tries` random shapes of `tones` tones under a peak acceleration, after `moves`.
fn best(
    tones: usize,
    lot: [f64; 2],
    max_peak: f64,
    [tries, moves]: [usize; 2],
) -> Result<Shape, Box<dyn Error>> {
    let mut random = SplitMix(tones as u64);
    let mut candidates: Vec<(f64, Shape)> = Vec::new();
    while candidates.len() < tries {
        let mut shape = [random.within(0.2, 0.9), 0.0, 0.0, 0.0, 0.0];
        if tones > 1 {
            (shape[1], shape[2]) = (random.within(0.0, 0.4), random.within(1.5, 3.5));
        }
        if tones > 2 {
            (shape[3], shape[4]) = (random.within(0.0, 0.15), random.within(0.0, TAU));
        }
        if peak(shape) <= max_peak {
            candidates.push((share(shape, lot, 1, 4, 250.0)?, shape));
        }
    }
    let by_share = |a: &(f64, Shape), b: &(f64, Shape)| b.0.total_cmp(&a.0);
    candidates.sort_by(by_share);
    candidates.truncate((tries / 100).max(4));
    for (value, shape) in &mut candidates {
        *value = share(*shape, lot, 1000, 16, 500.0)?;
    }
    candidates.sort_by(by_share);
    candidates.truncate(4);
    // Moves become smaller; all are judged by the same longer runs.
    for (value, shape) in &mut candidates {
        *value = share(*shape, lot, 2000, 32, 1000.0)?;
        for n in 0..moves {
            let reach = 0.06 * 0.96_f64.powi(n as i32);
            let moved = [1.0, 1.0, 4.0, 0.5, 8.0].map(|by| by * random.within(-reach, reach));
            let mut other = *shape;
            for place in 0..2 * tones - 1 {
                other[place] += moved[place];
            }
            for (place, min) in [(0, 0.1), (1, 0.0), (3, 0.0)] {
                other[place] = f64::max(other[place], min);
            }
            other[4] = other[4].rem_euclid(TAU);
            if peak(other) <= max_peak {
                let share = share(other, lot, 2000, 32, 1000.0)?;
                if share > *value {
                    (*value, *shape) = (share, other);
                }
            }
        }
    }
    candidates.sort_by(by_share);
    let best = candidates.first().map(|best| best.1);
    best.ok_or_else(|| "no shape stays under this acceleration".into())
}

/// Restitution, scatter, and largest acceleration in g across the track.
pub const LOTS: [[f64; 3]; 6] = [
    [0.3, 0.10, 3.2],
    [0.3, 0.10, 4.2],
    [0.3, 0.15, 4.2],
    [0.5, 0.10, 3.2],
    [0.5, 0.10, 4.3],
    [0.5, 0.15, 4.3],
];

pub const HEAD: &str =
    "| R | s | at most | one tone: k | two tones: k, e, th | three tones: k, e, th, e3, th3 |";

pub const RANDOM_MOVES: usize = 60;

pub fn table(lots: &[[f64; 3]], effort: [usize; 2]) -> Result<Vec<String>, Box<dyn Error>> {
    let row = |&[restitution, deviation, max_peak]: &[f64; 3]| {
        let lot = [restitution, deviation];
        let mut cells = format!("| {restitution} | {deviation:.2} | {max_peak} g |");
        for tones in 1..=3 {
            let shape = best(tones, lot, max_peak, effort)?;
            let fresh = share(shape, lot, 9000, 64, 1000.0)?;
            let places = shape[..2 * tones - 1].iter().zip([3, 3, 2, 3, 2]);
            let places = places.map(|(value, digits)| format!("{value:.digits$}"));
            let places: Vec<String> = places.collect();
            cells += &format!(" {fresh:.3}: {} |", places.join(", "));
        }
        Ok(cells)
    };
    lots.iter().map(row).collect()
}
