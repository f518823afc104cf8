//! Model of the energy by sector. Its components are profiles of the predicted impacts, ringing and
//! delayed, the merged landings of parts out of gear, and the drive's own energy.

use super::super::energy::SECTORS;
use super::super::onset::OnsetDetector;
use super::fit::{COMPONENTS, DesignMatrix, NOISE_INDEX, PADDED_COMPONENTS, SectorEnergy};
use crate::angle::{SAMPLE_RATE, phase_of};
use kband::arithmetic::{Phase, sine_cosine_single};
use kband::regime::gear::{GROUPS, PHASE_BINS, StrikeProfile};

/// Minimum predicted drive periods in gear of a group for its profile: two rows of eight flights.
const MIN_PERIODS_IN_GEAR: f32 = 16.0;
/// Minimum predicted drive periods out of gear for a profile of parts out of gear.
const MIN_PERIODS_OUT: f32 = 256.0;
/// Largest number of parts that land together: as many as a scene has.
const MAX_MERGED_PARTS: f32 = 24.0;
/// Number of predicted impact profiles: one per group in gear, and one out of gear.
const IMPACT_PROFILES: usize = GROUPS + 1;
/// Attenuation of the second harmonic by the average over a sector, `sin x / x`.
const SECTOR_ATTENUATION: f32 = 0.993_6;

/// Predicted energy of each component by sector. `lead`: phase lead of the track; `step`: advance
/// of the phase per sample; `ringing`: decay time in s; `delay`: delay in samples.
pub fn predict_design_matrix(
    profile: &StrikeProfile,
    lead: Phase,
    step: u32,
    decay_time: f32,
    delay: f32,
) -> DesignMatrix {
    // Decay time in turns of the drive.
    let decay_turns = decay_time * SAMPLE_RATE as f32 * step as f32 * (1.0 / Phase::TURN as f32);
    let delay = delay * step as f32 * (1.0 / Phase::TURN as f32);
    let lead = lead.bits() as f32 * (1.0 / Phase::TURN as f32) - delay;
    let lead = lead - libm::floorf(lead);
    let landing = profile.landing_phase.unwrap_or(Phase::ZERO);
    let landing = landing.bits() as f32 * (1.0 / Phase::TURN as f32) - lead;
    let mut rows = [[1.0 / SECTORS as f32; PADDED_COMPONENTS]; SECTORS];
    let [first, second, third, fourth] = &profile.in_gear;
    let impact_energy = [first, second, third, fourth, &profile.out_of_gear];
    convolve_ringing(&mut rows, impact_energy, lead, decay_turns);
    for (group, periods) in profile.periods[0].into_iter().enumerate() {
        if periods < MIN_PERIODS_IN_GEAR {
            rows.iter_mut().for_each(|row| row[group] = 0.0);
        }
    }
    let has_profile = has_out_of_gear_profile(profile);
    let out_of_gear_factor = if has_profile { 1.0 } else { 0.0 };
    let merged_energy_ratio = merged_energy_ratio(profile);
    for (row, impulse_response) in rows.iter_mut().zip(impulse_response(landing, decay_turns)) {
        let out = row[GROUPS];
        row[GROUPS] = out_of_gear_factor * (out + profile.landing_energy * impulse_response);
        row[GROUPS + 1] = out_of_gear_factor
            * (out + merged_energy_ratio * profile.landing_energy * impulse_response);
    }
    rows
}

/// Energy per cycle that the drive's own acceleration (in m/s^2) leaves in each sector.
pub fn drive_energy([cosines, sines]: [f32; 2], step: u32) -> SectorEnergy {
    let theta = Phase::from_bits(step);
    let (sine, cosine) = sine_cosine_single(theta);
    // (1 - c)(1 - z^-1) / (1 - (1 - c) z^-1), twice, at z = e^(i theta).
    let decay = 1.0 - OnsetDetector::CORNER as f32;
    let numerator = 2.0 - 2.0 * cosine;
    let denominator = 1.0 - 2.0 * decay * cosine + decay * decay;
    let gain = decay * decay * numerator / denominator;
    // Angle of (1 - z^-1): numerator over denominator.
    let angle = libm::atan2f(sine, 1.0 - cosine) - libm::atan2f(decay * sine, 1.0 - decay * cosine);
    let (sine_2, cosine_2) = sine_cosine_single(phase_of(2.0 * angle));
    // Re((a - i b) e^(i x)) is a cos x + b sin x.
    let re = gain * (cosines * cosine_2 + sines * sine_2);
    let im = gain * (cosines * sine_2 - sines * cosine_2);
    let samples = Phase::TURN as f32 / step.max(1) as f32 / SECTORS as f32;
    let level = 0.5 * (re * re + im * im);
    let second_harmonic = [re * re - im * im, 2.0 * re * im];
    // The energy has twice the drive's frequency: both halves of the turn are equal.
    let half: [f32; SECTORS / 2] = core::array::from_fn(|n| {
        let middle = Phase::from_bits((2 * n as u32 + 1) << 26);
        let (sine, cosine) = sine_cosine_single(middle + middle);
        samples
            * (level
                + 0.5
                    * SECTOR_ATTENUATION
                    * (second_harmonic[0] * cosine - second_harmonic[1] * sine))
    });
    core::array::from_fn(|n| half[n % half.len()])
}
pub fn has_out_of_gear_profile(profile: &StrikeProfile) -> bool {
    profile.periods[1].iter().sum::<f32>() >= MIN_PERIODS_OUT
}

/// Energy of the parts per cycle, by the weights of a mixture.
pub fn impact_energy(weights: &[f32; COMPONENTS], profile: &StrikeProfile) -> f32 {
    let out_weight = weights[GROUPS..NOISE_INDEX].iter().sum::<f32>();
    let landing = weights[GROUPS] + merged_energy_ratio(profile) * weights[GROUPS + 1];
    let sum = |row: &[f32; PHASE_BINS]| row.iter().sum::<f32>();
    let groups = profile.in_gear.iter().zip(weights);
    groups.map(|(row, weight)| weight * sum(row)).sum::<f32>()
        + out_weight * sum(&profile.out_of_gear)
        + landing * profile.landing_energy
}

/// Energy of merged landings over that of separate ones, with all parts out of gear. Amplitudes
/// add: each other part lands at the same time with the probability of a landing per period.
fn merged_energy_ratio(profile: &StrikeProfile) -> f32 {
    1.0 + (MAX_MERGED_PARTS - 1.0) * profile.landing_rate
}

/// Convolves the profiles with the ringing's exponential decay, one per column of the rows. The
/// track leads the output by `lead` turns; energy falls by e in `decay_turns` turns.
fn convolve_ringing(
    rows: &mut DesignMatrix,
    profiles: [&[f32; PHASE_BINS]; IMPACT_PROFILES],
    lead: f32,
    decay_turns: f32,
) {
    let width = 1.0 / PHASE_BINS as f32;
    let decay = libm::expf(-width / decay_turns);
    // Impacts are spread evenly over their place: share of their energy that falls into it.
    let immediate_share = 1.0 - (1.0 - decay) * decay_turns / width;
    let bins = lead * PHASE_BINS as f32;
    let whole_bins = libm::floorf(bins);
    let fraction = bins - whole_bins;
    let first = whole_bins as i32 as usize;
    let interpolate_energy = |n: usize| {
        let [low, high] = [n + first, n + first + 1].map(|n| n % PHASE_BINS);
        profiles.map(|profile| profile[low] + (profile[high] - profile[low]) * fraction)
    };
    let mut ringing = [0.0; IMPACT_PROFILES];
    for (sector, row) in rows.iter_mut().enumerate() {
        let mut sector_energy = [0.0; IMPACT_PROFILES];
        for n in 0..PHASE_BINS / SECTORS {
            let impact_energy = interpolate_energy(sector * (PHASE_BINS / SECTORS) + n);
            let sums = sector_energy.iter_mut().zip(&mut ringing);
            for ((sector_energy, ringing), impact_energy) in sums.zip(impact_energy) {
                *sector_energy += immediate_share * impact_energy + *ringing * (1.0 - decay);
                *ringing = *ringing * decay + (1.0 - immediate_share) * impact_energy;
            }
        }
        row[..IMPACT_PROFILES].copy_from_slice(&sector_energy);
    }
    // The turn is periodic: ringing at its end continues at its beginning.
    let periodic_gain = periodic_gain::<PHASE_BINS>(decay);
    let decay: f32 = core::iter::repeat_n(decay, PHASE_BINS / SECTORS).product();
    let mut ringing = ringing.map(|ringing| ringing * periodic_gain * (1.0 - decay));
    for row in rows {
        for (sector_energy, ringing) in row.iter_mut().zip(&mut ringing) {
            *sector_energy += *ringing;
            *ringing *= decay;
        }
    }
}

/// Sum of the geometric series over all turns; `decay` remains after one of `STEPS` steps.
fn periodic_gain<const STEPS: usize>(decay: f32) -> f32 {
    const { assert!(STEPS.is_power_of_two()) };
    let turn = (0..STEPS.trailing_zeros()).fold(decay, |decay, _| decay * decay);
    1.0 / (1.0 - turn)
}

/// Energy by sector of one impact of unit energy at phase `phase`, in turns; decay time in turns.
fn impulse_response(phase: f32, decay_turns: f32) -> SectorEnergy {
    let phase = (phase - libm::floorf(phase)) * SECTORS as f32;
    let first = phase as usize % SECTORS;
    let decay = libm::expf(-1.0 / (SECTORS as f32 * decay_turns));
    let mut row = [0.0; SECTORS];
    let mut ringing = libm::expf(-(first as f32 + 1.0 - phase) / (SECTORS as f32 * decay_turns));
    row[first] = 1.0 - ringing;
    ringing *= periodic_gain::<SECTORS>(decay) * (1.0 - decay);
    for n in 1..=SECTORS {
        row[(first + n) % SECTORS] += ringing;
        ringing *= decay;
    }
    row
}
