//! Histograms of impact energy over the drive phase, for parts in gear and out of it.
//!
//! The method is Monte Carlo simulation: parts across the lot, with scattered restitution, on one
//! track (docs/theory-real-parts.md#t10.7).

use core::f32::consts::TAU;

use super::draw::Draw;
use super::part::{SimulatedPart, Span, Tones, TrackMap};
use super::{GearDetector, MIN_FLIGHTS_IN_GEAR};
use crate::arithmetic::{Phase, sine_cosine_single, square_root_single};
use crate::feeder::{OutOfRange, Restitution};
use crate::impact::{ContactTime, speed_gain};

/// Bins of the histogram in a turn; 0.1 rad each.
pub const PHASE_BINS: usize = 64;
/// Groups of the lot by restitution; each has its own histogram in gear.
pub const GROUPS: usize = 4;
/// Number of simulated parts: half start at rest, half on the lock.
const SIMULATED_PARTS: u32 = 32;
/// Simulated parts of a group that start at rest, out of gear.
const PARTS_FROM_REST_PER_GROUP: f32 = SIMULATED_PARTS as f32 / (2 * GROUPS) as f32;
/// Drive periods of a simulated part. Of the shares of 1675 random lots as many lie within 1, 2 and
/// 3 standard errors with 256, 384 and 768 periods. With 192 READY is late in one scene.
const SIMULATED_PERIODS: u16 = 384;
/// Largest number of impacts of all parts. Chattering parts would have up to twice as many.
const MAX_IMPACTS: u32 = 300_000;
/// Margin in restitution beyond both ends of the lot. It covers an amplitude error of 2 %, which
/// shifts the phase in gear as `0.02 (1 - R^2)/2` does.
pub const RESTITUTION_MARGIN: f32 = 0.01;
/// Tolerance of the landing phase after rest, in steps of 2^-32 turns; 3e-3 rad.
const LANDING_PHASE_TOLERANCE: i32 = 1 << 21;

/// Inputs of the simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrikeSettings {
    /// Restitutions of the lot.
    pub restitution: Restitution,
    /// Standard deviation of the restitution from impact to impact (symbol s).
    pub scatter: f32,
    /// Order of the gear.
    pub order: u32,
    /// k of the track.
    pub k: f32,
    /// Tones of the track above the first.
    pub tones: Tones,
    /// Duration of an impact.
    pub contact: ContactTime,
}

/// Impact energy, as squared arrival speed in `(b w)^2` per drive period, over the drive phase.
#[derive(Clone, Copy, Debug)]
pub struct StrikeProfile {
    /// Energy of a part in gear, by group of the lot and phase.
    pub in_gear: [[f32; PHASE_BINS]; GROUPS],
    /// Energy of a part out of gear by phase, without [`StrikeProfile::landing_energy`].
    pub out_of_gear: [f32; PHASE_BINS],
    /// Energy of the first landings after rest, all at one phase.
    pub landing_energy: f32,
    /// Number of those landings per drive period.
    pub landing_rate: f32,
    /// Phase of those landings; `None` without any.
    pub landing_phase: Option<Phase>,
    /// Simulated drive periods in gear and out of it, by group.
    pub periods: [[f32; GROUPS]; 2],
    /// Losses of gear in those periods, by group.
    pub losses: [f32; GROUPS],
    /// Mean downward acceleration of the track (symbol A) at the launches in gear, by group.
    pub launch_accelerations: [f32; GROUPS],
}

impl StrikeProfile {
    const EMPTY: Self = Self {
        in_gear: [[0.0; PHASE_BINS]; GROUPS],
        out_of_gear: [0.0; PHASE_BINS],
        landing_energy: 0.0,
        landing_rate: 0.0,
        landing_phase: None,
        periods: [[0.0; GROUPS]; 2],
        losses: [0.0; GROUPS],
        launch_accelerations: [0.0; GROUPS],
    };

    /// Share of the followed time in gear, 0..=1.
    pub fn share(&self) -> f32 {
        let [in_gear, out_of_gear] = self.periods.map(|periods| periods.iter().sum::<f32>());
        in_gear / (in_gear + out_of_gear).max(1.0)
    }

    /// Mean drive periods in gear until it is lost; without a loss, all of them: a lower bound.
    pub fn time_to_loss(&self) -> f32 {
        self.periods[0].iter().sum::<f32>() / self.losses.iter().sum::<f32>().max(1.0)
    }

    /// Lower bound of a part's share of time in gear over a number of drive periods, 0..=1. It is
    /// three standard deviations below the mean of a group, the smallest of all groups.
    ///
    /// A part goes in and out of gear as a two-state Markov process. Its share over a time `T` has
    /// the variance `2 p (1 - p) t/T`, with `t = p d` and the mean duration `d` out of gear. The
    /// bound is 0 while one part in a thousand may still wait for its first capture.
    pub fn min_credible_share(&self, periods: f32) -> f32 {
        (0..GROUPS).fold(1.0, |minimum, group| {
            let [in_gear, out_of_gear] = self.periods.map(|periods| periods[group]);
            let mean = in_gear / (in_gear + out_of_gear).max(1.0);
            let out = out_of_gear / (self.losses[group] + PARTS_FROM_REST_PER_GROUP);
            if periods < 7.0 * out {
                return 0.0;
            }
            let variance = 2.0 * mean * mean * (1.0 - mean) * out / periods.max(1.0);
            let bound = mean - 3.0 * square_root_single(variance);
            minimum.min(bound).max(0.0)
        })
    }
}

/// A completed count, which replaces a repetition with the same inputs.
#[derive(Clone, Copy, Debug)]
pub struct StrikeCount {
    /// Inputs of the count.
    pub settings: StrikeSettings,
    steps: u32,
    profile: StrikeProfile,
}

impl StrikeCount {
    /// Counts to the end.
    pub fn compute(settings: StrikeSettings) -> Result<Self, OutOfRange> {
        let mut profiler = StrikeProfiler::new(settings)?;
        while profiler.advance(u32::MAX) {}
        Ok(Self {
            settings,
            steps: profiler.steps,
            profile: profiler.profile,
        })
    }
}

/// An impact of a run of flights that is still too short for gear.
#[derive(Clone, Copy, Debug, Default)]
struct PendingImpact {
    bin: u8,
    landed: bool,
    energy: f32,
    periods: f32,
}

/// Simulates the parts of a lot and accumulates their impact energies.
#[derive(Clone, Copy, Debug)]
pub struct StrikeProfiler {
    settings: StrikeSettings,
    map: TrackMap,
    gear: GearDetector<i64>,
    simulated: Option<SimulatedPart>,
    part: u32,
    impacts: u32,
    /// Steps so far, and the number of steps of a stored result.
    steps: u32,
    stored_steps: Option<u32>,
    pending: [PendingImpact; MIN_FLIGHTS_IN_GEAR as usize],
    pending_count: usize,
    was_in_gear: bool,
    periods: f32,
    /// Number of flights in [`StrikeProfile::launch_accelerations`], by group.
    launch_counts: [f32; GROUPS],
    profile: StrikeProfile,
}

impl StrikeProfiler {
    /// Begins a count; an error names the parameter out of range.
    pub fn new(settings: StrikeSettings) -> Result<Self, OutOfRange> {
        Ok(Self {
            settings,
            map: TrackMap::build(settings.k, settings.tones)?
                .with_contact(settings.contact.radians() as f32),
            gear: GearDetector::build_in_steps(settings.order)?,
            simulated: None,
            part: 0,
            impacts: 0,
            steps: 0,
            stored_steps: None,
            pending: [PendingImpact::default(); MIN_FLIGHTS_IN_GEAR as usize],
            pending_count: 0,
            was_in_gear: false,
            periods: 0.0,
            launch_counts: [0.0; GROUPS],
            profile: StrikeProfile::EMPTY,
        })
    }

    /// Inputs of the count.
    pub fn settings(&self) -> &StrikeSettings {
        &self.settings
    }

    /// Mean restitution of a group.
    pub fn restitution(&self, group: usize) -> f32 {
        let [low, high] = self.restitution_range();
        low + (high - low) * (group as f32 + 0.5) * (1.0 / GROUPS as f32)
    }

    fn restitution_range(&self) -> [f32; 2] {
        let lot = self.settings.restitution;
        let low = lot.low() as f32 - RESTITUTION_MARGIN;
        [
            low.max(0.0),
            (lot.high() as f32 + RESTITUTION_MARGIN).min(0.99),
        ]
    }

    /// Result; `None` before the end.
    pub fn profile(&self) -> Option<&StrikeProfile> {
        (self.part > SIMULATED_PARTS).then_some(&self.profile)
    }

    /// Inputs of a count in progress; `None` once it has ended or a stored result is set.
    pub fn pending_settings(&self) -> Option<&StrikeSettings> {
        Some(&self.settings).filter(|_| self.part <= SIMULATED_PARTS && self.stored_steps.is_none())
    }

    /// Sets a stored result if its inputs agree. It becomes available after the same number of
    /// steps.
    pub fn set_stored_result(&mut self, count: &StrikeCount) {
        if self.pending_settings() == Some(&count.settings) {
            self.profile = count.profile;
            self.stored_steps = Some(count.steps);
        }
    }

    /// Simulates at most this number of impacts and returns whether the count continues.
    pub fn advance(&mut self, impacts: u32) -> bool {
        if let Some(last) = self.stored_steps {
            let remaining = last.saturating_sub(self.steps);
            self.steps += remaining.min(impacts);
            if self.steps == last {
                self.part = SIMULATED_PARTS + 1;
            }
            return impacts <= remaining;
        }
        for _ in 0..impacts {
            if self.part > SIMULATED_PARTS {
                return false;
            }
            self.simulate_flight();
            self.steps += 1;
        }
        true
    }

    fn simulate_flight(&mut self) {
        let Some(simulated) = &mut self.simulated else {
            self.begin_part();
            return;
        };
        self.impacts += 1;
        let mut landed_impact = None;
        let over = simulated.simulate_flight(&self.map, |impact| landed_impact = Some(impact));
        if let Some(impact) = landed_impact {
            let speed = impact.arrival_speed(&self.map);
            let landed = impact.from_rest && {
                let landing = *self.profile.landing_phase.get_or_insert(impact.phase);
                let distance = (impact.phase - landing).bits() as i32;
                (-LANDING_PHASE_TOLERANCE..LANDING_PHASE_TOLERANCE).contains(&distance)
            };
            let pending_impact = PendingImpact {
                bin: (impact.phase.bits() >> 26) as u8,
                landed,
                energy: speed * speed,
                periods: impact.steps as f32 * (1.0 / Phase::TURN as f32),
            };
            if impact.from_rest || !self.is_in_gear(pending_impact.periods) {
                self.end_sequence();
            }
            if impact.in_gear {
                self.was_in_gear = true;
                for pending_impact in self.pending.into_iter().take(self.pending_count) {
                    self.add_in_gear(pending_impact);
                }
                self.pending_count = 0;
                self.add_in_gear(pending_impact);
                let group = self.group();
                self.profile.launch_accelerations[group] += impact.launch_acceleration(&self.map);
                self.launch_counts[group] += 1.0;
            } else if self.is_in_gear(pending_impact.periods)
                && self.pending_count < self.pending.len()
            {
                self.pending[self.pending_count] = pending_impact;
                self.pending_count += 1;
            } else {
                self.add_out_of_gear(pending_impact);
            }
        }
        if over || self.impacts >= MAX_IMPACTS {
            // The end of the simulation is no loss of gear.
            self.was_in_gear = false;
            self.end_sequence();
            let time = self.simulated.take().map_or(0, |part| part.time);
            let all = time as f32 * (1.0 / Phase::TURN as f32);
            let group = self.group();
            self.profile.periods[0][group] += self.periods;
            self.profile.periods[1][group] += (all - self.periods).max(0.0);
            self.periods = 0.0;
        }
    }

    fn group(&self) -> usize {
        (self.part as usize).saturating_sub(1) * GROUPS / SIMULATED_PARTS as usize % GROUPS
    }

    fn is_in_gear(&self, periods: f32) -> bool {
        super::is_in_gear(f64::from(periods), f64::from(self.settings.order))
    }

    /// Ends a run of flights; impacts of a run too short for gear count as out of gear.
    fn end_sequence(&mut self) {
        for pending_impact in self.pending.into_iter().take(self.pending_count) {
            self.add_out_of_gear(pending_impact);
        }
        self.pending_count = 0;
        if self.was_in_gear {
            self.profile.losses[self.group()] += 1.0;
        }
        self.was_in_gear = false;
    }

    fn add_in_gear(&mut self, impact: PendingImpact) {
        self.periods += impact.periods;
        let group = self.group();
        if let Some(sum) = self.profile.in_gear[group].get_mut(usize::from(impact.bin)) {
            *sum += impact.energy;
        }
    }

    fn add_out_of_gear(&mut self, impact: PendingImpact) {
        if impact.landed {
            self.profile.landing_energy += impact.energy;
            self.profile.landing_rate += 1.0;
        } else if let Some(sum) = self.profile.out_of_gear.get_mut(usize::from(impact.bin)) {
            *sum += impact.energy;
        }
    }

    fn begin_part(&mut self) {
        self.part += 1;
        if self.part > SIMULATED_PARTS || self.impacts >= MAX_IMPACTS {
            self.normalize();
            return;
        }
        // The restitutions are evenly spaced; each is simulated from rest and from the lock.
        let pair = (self.part - 1) / 2;
        let position = (pair as f32 + 0.5) * (2.0 / SIMULATED_PARTS as f32);
        let [low, high] = self.restitution_range();
        let mean = low + (high - low) * position;
        let draw = Draw::new(mean, self.settings.scatter, self.part);
        let span = Span::from_periods(SIMULATED_PERIODS, 0);
        let simulated = SimulatedPart::new(draw, self.gear, span);
        self.simulated = Some(match self.find_lock(mean) {
            Some((phase, velocity)) if self.part.is_multiple_of(2) => {
                simulated.with_launch(phase, velocity)
            }
            _ => simulated,
        });
    }

    fn normalize(&mut self) {
        self.part = SIMULATED_PARTS + 1;
        let profile = &mut self.profile;
        let in_gear_periods = profile.periods[0].map(|periods| 1.0 / periods.max(1.0));
        for (sums, in_gear_periods) in profile.in_gear.iter_mut().zip(in_gear_periods) {
            sums.iter_mut().for_each(|sum| *sum *= in_gear_periods);
        }
        let accelerations = profile.launch_accelerations.iter_mut();
        for (acceleration, count) in accelerations.zip(self.launch_counts) {
            *acceleration /= count.max(1.0);
        }
        let out_of_gear_periods = 1.0 / profile.periods[1].iter().sum::<f32>().max(1.0);
        for sum in &mut profile.out_of_gear {
            *sum *= out_of_gear_periods;
        }
        profile.landing_energy *= out_of_gear_periods;
        profile.landing_rate *= out_of_gear_periods;
    }

    /// Phase and launch velocity of the lock (docs/theory-real-parts.md#t10.3); `None` without one.
    /// A scan and a bisection solve `C(t0) = pi r k (1 - R)/(1 + R)`.
    fn find_lock(&self, restitution: f32) -> Option<(Phase, f32)> {
        let StrikeSettings { order, k, .. } = self.settings;
        let turns = TAU * order as f32 * k / (1.0 + restitution);
        let lock_velocity = 0.5 * turns * (1.0 - restitution);
        let upper = &self.map.upper;
        let [ratio, third] = upper.ratios;
        let track_velocity = |phase: Phase| {
            let (_, mut speed) = sine_cosine_single(phase);
            if ratio != 0.0 {
                speed += 2.0 * ratio * upper.second(phase).1;
            }
            if third != 0.0 {
                speed += 3.0 * third * upper.third(phase).1;
            }
            speed
        };
        let step = Phase::from_bits(1 << 26);
        let (mut fastest, mut max_velocity, mut phase) = (Phase::ZERO, -1.0, Phase::ZERO);
        for _ in 0..64 {
            let velocity = track_velocity(phase);
            if velocity > max_velocity {
                (fastest, max_velocity) = (phase, velocity);
            }
            phase += step;
        }
        if max_velocity <= lock_velocity {
            return None;
        }
        // The stable root lies where the velocity falls.
        let mut phase = fastest;
        while track_velocity(phase + step) > lock_velocity {
            phase += step;
        }
        let mut half = Phase::from_bits(1 << 25);
        for _ in 0..16 {
            if track_velocity(phase + half) > lock_velocity {
                phase += half;
            }
            half = Phase::from_bits(half.bits() >> 1);
        }
        let contact = self.settings.contact.radians() as f32;
        if contact == 0.0 {
            return Some((phase, restitution * turns));
        }
        // First order in the contact time (docs/theory-real-parts.md#t10.6).
        let push = k - self.map.pull(phase).0;
        let gain = speed_gain(restitution);
        let shift = contact / (1.0 + restitution);
        let velocity = restitution * turns - shift * (restitution + gain) * (k - push);
        let slower = k * (1.0 - restitution - gain) + (restitution + gain) * push;
        let phase_shift = (shift * slower / push.max(0.1)).min(contact + contact);
        let steps = (phase_shift * Phase::STEPS_PER_RADIAN as f32) as i32;
        Some((phase + Phase::from_bits(steps as u32), velocity.max(0.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regime::Lock;

    fn profiler(r: f64, order: u32, k: f32, tones: Tones, contact: ContactTime) -> StrikeProfiler {
        let restitution = Restitution::single(r).unwrap();
        let settings = StrikeSettings {
            restitution,
            scatter: 0.05,
            order,
            k,
            tones,
            contact,
        };
        StrikeProfiler::new(settings).unwrap()
    }

    /// The lock of the profile against the closed form, to second order in the contact time.
    #[test]
    fn lock_of_a_contact_is_that_of_the_closed_form() {
        for (k, restitution, order) in [
            (0.4, 0.2, 1),
            (0.46, 0.2, 1),
            (0.65, 0.4, 1),
            (0.23, 0.2, 2),
        ] {
            for contact in [0.0, 0.02, 0.05] {
                let contact = ContactTime::build(contact).unwrap();
                let exact = Lock::with_contact(k, restitution, order, contact).unwrap();
                let exact = exact.unwrap().state();
                let profiler = profiler(restitution, order, k as f32, [[0.0; 2]; 2], contact);
                let (phase, velocity) = profiler.find_lock(restitution as f32).unwrap();
                let bound = 1e-5 + 0.6 * contact.radians() * contact.radians();
                let error = (phase.radians() - exact.phase).abs();
                assert!(error < bound, "{k} {contact:?}: phase {error}");
                let error = (f64::from(velocity) - exact.velocity).abs();
                assert!(error < bound, "{k} {contact:?}: velocity {error}");
            }
        }
    }

    /// On one, two and three tones.
    #[test]
    fn a_part_launched_on_the_lock_repeats_its_flight() {
        for (k, tones) in [
            (0.44, [[0.0; 2]; 2]),
            (0.35, [[0.15, 2.4], [0.0; 2]]),
            (0.35, [[0.15, 2.4], [0.05, 5.3]]),
        ] {
            let profiler = profiler(0.25, 1, k, tones, ContactTime::INSTANT);
            let (phase, velocity) = profiler.find_lock(0.25).unwrap();
            let (draw, span) = (Draw::new(0.25, 0.0, 1), Span::from_periods(9, 0));
            let part = SimulatedPart::new(draw, profiler.gear, span);
            let (mut landed, mut part) = (Phase::ZERO, part.with_launch(phase, velocity));
            part.simulate_flight(&profiler.map, |impact| landed = impact.phase);
            let distance = (landed - phase).bits() as i32 as f32 * (TAU / Phase::TURN as f32);
            assert!(distance.abs() < 1e-3, "{tones:?}: {distance}");
        }
    }

    #[test]
    fn stored_result_equals_the_computed_one() {
        let settings = StrikeSettings {
            restitution: Restitution::interval(0.28, 0.32).unwrap(),
            scatter: 0.05,
            order: 1,
            k: 0.4438,
            tones: [[0.0; 2]; 2],
            contact: ContactTime::INSTANT,
        };
        let count = StrikeCount::compute(settings).unwrap();
        // Slice sizes that divide the number of steps, and one that does not; stored result set at
        // the start and later.
        let divides = |n: &u32| count.steps.is_multiple_of(*n);
        let factor = (2..64).find(divides).unwrap_or(1);
        for (slice, after) in [(64, 0), (64, 3), (factor, 1), (count.steps - 1, 0)] {
            let mut computed = StrikeProfiler::new(settings).unwrap();
            let mut stored = computed;
            for round in 0_u32.. {
                if round == after {
                    assert_eq!(stored.pending_settings(), Some(&settings));
                    stored.set_stored_result(&count);
                    assert_eq!(stored.pending_settings(), None);
                }
                let more = computed.advance(slice);
                assert_eq!(stored.advance(slice), more, "{slice} {round}");
                assert_eq!(computed.profile().is_some(), stored.profile().is_some());
                if !more {
                    break;
                }
            }
            let shown = |one: StrikeProfiler| std::format!("{:?}", one.profile().unwrap());
            assert_eq!(shown(computed), shown(stored));
        }
        // A result at another k is rejected.
        let mut other = settings;
        other.k = 0.45;
        let mut other = StrikeProfiler::new(other).unwrap();
        other.set_stored_result(&count);
        assert!(other.pending_settings().is_some());
    }
}
