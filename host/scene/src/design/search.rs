//! Pareto front of the candidates by parts a minute and share in gear.

use kband::arithmetic::Noise;
use kband_control::Settings;

use super::feeder::{Feeder, lowest_k};
use super::table::{THIRD_TONE_ANGLE, Table};
use super::{Ranges, Workers};
use crate::refusal::Refusal;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub feeder: Feeder,
    pub share: f64,
    pub speed: f64,
    /// Coordinates within the ranges, each 0..1.
    place: [f64; COORDINATES],
}

/// Frequency, angle of throw, phase lead, incline, k, e, th, e3.
const COORDINATES: usize = 8;
const TASK: usize = 8192;
/// Amplitude over the first below which a second tone counts as absent.
const MIN_TONE: f64 = 0.01;
/// Step of the share; the front has at most one candidate in each.
const STEP: f64 = 0.002;

/// Rounds of the search: share of the candidates, and largest distance from the present front.
const ROUNDS: [(f64, f64); 5] = [
    (0.5, 0.0),
    (0.15, 0.2),
    (0.15, 0.1),
    (0.1, 0.05),
    (0.1, 0.02),
];

/// Number of candidates, number within the drive's limits, and front by falling speed.
#[derive(Default)]
pub(super) struct SearchResult {
    pub tried: usize,
    pub within: usize,
    pub front: Vec<Candidate>,
}

pub(super) fn search(
    base: &Settings,
    ranges: &Ranges,
    table: &Table,
    workers: &impl Workers,
) -> Result<SearchResult, Refusal> {
    let mut result = SearchResult::default();
    for (round, (part, width)) in ROUNDS.into_iter().enumerate() {
        let count = (ranges.candidates as f64 * part).round() as usize;
        let before = &result.front;
        if round > 0 && before.is_empty() {
            break;
        }
        let tasks = workers.map("candidates", count.div_ceil(TASK), |task, check_stop| {
            check_stop()?;
            let seed = ranges.seed.rotate_left(32) ^ (round as u64) << 48 ^ task as u64;
            let mut noise = Noise::new(seed);
            let mut uniform = || f64::from(noise.bits()) / 4_294_967_296.0;
            let mut candidates = Vec::new();
            let mut within = 0;
            for n in task * TASK..count.min((task + 1) * TASK) {
                let centre = (round > 0).then(|| before[n % before.len()].place);
                let place = std::array::from_fn(|coordinate| {
                    let drawn = uniform();
                    match centre {
                        None => drawn,
                        Some(at) => (at[coordinate] + width * (2.0 * drawn - 1.0)).clamp(0.0, 1.0),
                    }
                });
                let candidate = candidate(base, ranges, table, place);
                within += usize::from(candidate.is_some());
                candidates.extend(candidate.filter(|new| new.share >= ranges.least_share));
            }
            Ok((within, front(candidates)))
        })?;
        result.tried += count;
        let mut all = std::mem::take(&mut result.front);
        for (within, candidates) in tasks {
            result.within += within;
            all.extend(candidates);
        }
        result.front = front(all);
    }
    Ok(result)
}

/// The candidate at these coordinates; `None` beyond the limits of the drive.
fn candidate(
    base: &Settings,
    ranges: &Ranges,
    table: &Table,
    place: [f64; COORDINATES],
) -> Option<Candidate> {
    let [k, e, th, e3, ..] = table.axes;
    let mut coordinates = place.into_iter();
    let mut next_in =
        |[low, high]: [f64; 2]| low + (high - low) * coordinates.next().unwrap_or(0.0);
    let (frequency, throw_angle) = (next_in(ranges.frequency), next_in(ranges.throw_angle));
    let (phase_lead, incline) = (next_in(ranges.phase_lead), next_in(ranges.incline));
    let [k, mut e, th, mut e3] = [k, e, th, e3].map(|axis| next_in([axis.low, axis.high]));
    // A third tone requires a second one.
    if e < MIN_TONE {
        (e, e3) = (0.0, 0.0);
    }
    let tone = |size: f64, angle: f64| if size > 0.0 { [size, angle] } else { [0.0; 2] };
    let feeder = Feeder {
        frequency,
        throw_angle,
        phase_lead,
        incline,
        k,
        tones: [tone(e, th), tone(e3, THIRD_TONE_ANGLE)],
    };
    let amplitude = feeder.amplitude(base.gravity.into());
    let [low, high] = ranges.amplitude;
    if !(low..=high).contains(&amplitude) || k < lowest_k(base, &feeder) {
        return None;
    }
    let tangent = incline.to_radians().tan();
    let point = [k, e, th, e3, feeder.amplitude_ratio(), phase_lead, tangent];
    let (share, speed) = table.at(point);
    Some(Candidate {
        feeder,
        share,
        speed: speed * amplitude * std::f64::consts::TAU * frequency,
        place,
    })
}

/// The fastest candidate in every step of the share, without those that another exceeds in both.
fn front(candidates: Vec<Candidate>) -> Vec<Candidate> {
    let mut best: Vec<Option<Candidate>> = vec![None; (1.0 / STEP) as usize + 2];
    for candidate in candidates {
        let step = &mut best[(candidate.share.clamp(0.0, 1.0) / STEP) as usize];
        if candidate.speed > 0.0 && step.is_none_or(|other| candidate.speed > other.speed) {
            *step = Some(candidate);
        }
    }
    let best: Vec<Candidate> = best.into_iter().flatten().collect();
    let front = pareto_front(&best, |best| (best.share, best.speed));
    front.into_iter().map(|n| best[n]).collect()
}

/// Indices of the pairs that no other equals or exceeds in both numbers, by falling second one.
pub(super) fn pareto_front<T>(all: &[T], numbers: impl Fn(&T) -> (f64, f64)) -> Vec<usize> {
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by(|a, b| {
        let ((share, speed), (other, faster)) = (numbers(&all[*a]), numbers(&all[*b]));
        faster.total_cmp(&speed).then(other.total_cmp(&share))
    });
    let mut largest = f64::NEG_INFINITY;
    order.retain(|n| {
        let (share, _) = numbers(&all[*n]);
        let is_larger = share > largest;
        largest = largest.max(share);
        is_larger
    });
    order
}
