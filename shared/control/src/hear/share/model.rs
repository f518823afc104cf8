//! Model of the energy by sector: profiles of the predicted impacts, ringing and delayed, the merged
//! landings of parts out of gear, and the drive's own share.

use super::super::energy::SECTORS;
use super::super::onset::OnsetDetector;
use super::fit::{LANES, NOISE, PARTS, Row, Rows};
use crate::angle::{SAMPLE_RATE, phase_of};
use kband::arithmetic::{Phase, sine_cosine_single};
use kband::regime::gear::{GROUPS, PHASE_BINS, StrikeProfile};

/// Minimum predicted drive periods in gear of a group for its profile: two rows of eight flights.
const KNOWN: f32 = 16.0;
/// Minimum predicted drive periods out of gear for a profile of parts out of gear.
const MIN_PERIODS_OUT: f32 = 256.0;
/// Largest number of parts that land together: as many as a scene has.
const TOGETHER: f32 = 24.0;
/// Number of predicted impact profiles: one per group in gear, and one out of gear.
const STRUCK: usize = GROUPS + 1;

/// Attenuation of the second harmonic by the average over a sector, `sin x / x`.
const SQUEEZED: f32 = 0.993_6;

/// Predicted energy of each component by sector. `lead`: phase lead of the track; `step`: advance
/// of the phase per sample; `rings`: decay time in s; `late`: delay in samples.
pub fn predict_rows(
    profile: &StrikeProfile,
    lead: Phase,
    step: u32,
    rings: f32,
    late: f32,
) -> Rows {
    // Decay time in turns of the drive.
    let turns = rings * SAMPLE_RATE as f32 * step as f32 * (1.0 / Phase::TURN as f32);
    let late = late * step as f32 * (1.0 / Phase::TURN as f32);
    let lead = lead.bits() as f32 * (1.0 / Phase::TURN as f32) - late;
    let lead = lead - libm::floorf(lead);
    let landing = profile.landing_phase.unwrap_or(Phase::ZERO);
    let landing = landing.bits() as f32 * (1.0 / Phase::TURN as f32) - lead;
    let mut rows = [[1.0 / SECTORS as f32; LANES]; SECTORS];
    let [first, second, third, fourth] = &profile.in_gear;
    let struck = [first, second, third, fourth, &profile.out_of_gear];
    ring(&mut rows, struck, lead, turns);
    for (group, periods) in profile.periods[0].into_iter().enumerate() {
        if periods < KNOWN {
            rows.iter_mut().for_each(|row| row[group] = 0.0);
        }
    }
    let known = if knows_out(profile) { 1.0 } else { 0.0 };
    let together = together(profile);
    for (row, landed) in rows.iter_mut().zip(landed(landing, turns)) {
        let out = row[GROUPS];
        row[GROUPS] = known * (out + profile.landing_energy * landed);
        row[GROUPS + 1] = known * (out + together * profile.landing_energy * landed);
    }
    rows
}

/// Energy per cycle that the drive's own acceleration (`cosines`, `sines`, in m/s^2) leaves in each
/// sector of the residual.
pub fn drive_leak([cosines, sines]: [f32; 2], step: u32) -> Row {
    let theta = Phase::from_bits(step);
    let (sine, cosine) = sine_cosine_single(theta);
    // (1 - c)(1 - z^-1) / (1 - (1 - c) z^-1), twice, at z = e^(i theta).
    let left = 1.0 - OnsetDetector::CORNER as f32;
    let above = 2.0 - 2.0 * cosine;
    let below = 1.0 - 2.0 * left * cosine + left * left;
    let gain = left * left * above / below;
    // Angle of (1 - z^-1): numerator over denominator.
    let angle = libm::atan2f(sine, 1.0 - cosine) - libm::atan2f(left * sine, 1.0 - left * cosine);
    let (turn, straight) = sine_cosine_single(phase_of(2.0 * angle));
    // Re((a - i b) e^(i x)) is a cos x + b sin x.
    let re = gain * (cosines * straight + sines * turn);
    let im = gain * (cosines * turn - sines * straight);
    let samples = Phase::TURN as f32 / step.max(1) as f32 / SECTORS as f32;
    let level = 0.5 * (re * re + im * im);
    let double = [re * re - im * im, 2.0 * re * im];
    // The energy has twice the drive's frequency: both halves of the turn are equal.
    let half: [f32; SECTORS / 2] = core::array::from_fn(|n| {
        let middle = Phase::from_bits((2 * n as u32 + 1) << 26);
        let (sine, cosine) = sine_cosine_single(middle + middle);
        samples * (level + 0.5 * SQUEEZED * (double[0] * cosine - double[1] * sine))
    });
    core::array::from_fn(|n| half[n % half.len()])
}
/// Whether the profile of parts out of gear counts.
pub fn knows_out(profile: &StrikeProfile) -> bool {
    profile.periods[1].iter().sum::<f32>() >= MIN_PERIODS_OUT
}

/// Energy of the parts per cycle, by the weights of a mixture.
pub fn struck(weights: &[f32; PARTS], profile: &StrikeProfile) -> f32 {
    let without = weights[GROUPS..NOISE].iter().sum::<f32>();
    let landing = weights[GROUPS] + together(profile) * weights[GROUPS + 1];
    let sum = |row: &[f32; PHASE_BINS]| row.iter().sum::<f32>();
    let groups = profile.in_gear.iter().zip(weights);
    groups.map(|(row, weight)| weight * sum(row)).sum::<f32>()
        + without * sum(&profile.out_of_gear)
        + landing * profile.landing_energy
}

/// Energy of merged landings over that of separate ones, with all parts out of gear. Amplitudes
/// add: each other part lands with it with the probability of a landing per period.
fn together(profile: &StrikeProfile) -> f32 {
    1.0 + (TOGETHER - 1.0) * profile.landing_rate
}

/// Convolves the profiles with the ringing's exponential decay, one per column of the rows. The
/// track leads the output by `lead` turns; energy falls by e in `turns` turns.
fn ring(rows: &mut Rows, profiles: [&[f32; PHASE_BINS]; STRUCK], lead: f32, turns: f32) {
    let width = 1.0 / PHASE_BINS as f32;
    let left = libm::expf(-width / turns);
    // Impacts are spread evenly over their place: share of their energy that falls into it.
    let stays = 1.0 - (1.0 - left) * turns / width;
    let places = lead * PHASE_BINS as f32;
    let whole = libm::floorf(places);
    let share = places - whole;
    let first = whole as i32 as usize;
    let struck_at = |n: usize| {
        let [low, high] = [n + first, n + first + 1].map(|n| n % PHASE_BINS);
        profiles.map(|profile| profile[low] + (profile[high] - profile[low]) * share)
    };
    let mut rings = [0.0; STRUCK];
    for (sector, row) in rows.iter_mut().enumerate() {
        let mut heard = [0.0; STRUCK];
        for n in 0..PHASE_BINS / SECTORS {
            let struck = struck_at(sector * (PHASE_BINS / SECTORS) + n);
            for ((heard, rings), struck) in heard.iter_mut().zip(&mut rings).zip(struck) {
                *heard += stays * struck + *rings * (1.0 - left);
                *rings = *rings * left + (1.0 - stays) * struck;
            }
        }
        row[..STRUCK].copy_from_slice(&heard);
    }
    // The turn is periodic: ringing at its end continues at its beginning.
    let around = around::<PHASE_BINS>(left);
    let left: f32 = core::iter::repeat_n(left, PHASE_BINS / SECTORS).product();
    let mut rings = rings.map(|rings| rings * around * (1.0 - left));
    for row in rows {
        for (heard, rings) in row.iter_mut().zip(&mut rings) {
            *heard += *rings;
            *rings *= left;
        }
    }
}

/// Sum of the geometric series over all turns; `left` remains after one of `STEPS` steps.
fn around<const STEPS: usize>(left: f32) -> f32 {
    const { assert!(STEPS.is_power_of_two()) };
    let turn = (0..STEPS.trailing_zeros()).fold(left, |left, _| left * left);
    1.0 / (1.0 - turn)
}

/// Energy by sector of one impact of unit energy at phase `at`, in turns; decay time in turns.
fn landed(at: f32, turns: f32) -> Row {
    let at = (at - libm::floorf(at)) * SECTORS as f32;
    let first = at as usize % SECTORS;
    let left = libm::expf(-1.0 / (SECTORS as f32 * turns));
    let mut row = [0.0; SECTORS];
    let mut rings = libm::expf(-(first as f32 + 1.0 - at) / (SECTORS as f32 * turns));
    row[first] = 1.0 - rings;
    rings *= around::<SECTORS>(left) * (1.0 - left);
    for n in 1..=SECTORS {
        row[(first + n) % SECTORS] += rings;
        rings *= left;
    }
    row
}
