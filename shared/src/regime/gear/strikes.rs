//! Histograms of impact energy over the drive phase, for parts in gear and out of it.
//!
//! The method is Monte Carlo simulation: parts across the lot, with scattered restitution, on one
//! track (docs/theory-real-parts.md#t10.7).

use core::f32::consts::TAU;

use super::draw::Draw;
use super::rider::{Rider, Span, Surface, Tones};
use super::{Gear, ROW};
use crate::arithmetic::{Phase, sine_cosine_single};
use crate::feeder::{OutOfRange, Restitution};

/// Bins of the histogram in a turn; 0.1 rad each.
pub const PLACES: usize = 64;
/// Groups of the lot by restitution; each has its own histogram in gear.
pub const GROUPS: usize = 4;
/// Number of simulated parts: half start at rest, half on the lock.
const PARTS: u32 = 32;
/// Simulated drive periods of each part.
const PERIODS: u16 = 768;
/// Largest number of impacts of all parts. Chattering parts would have up to twice as many.
const MOST: u32 = 600_000;
/// Margin in restitution beyond both ends of the lot. It covers an amplitude error of 2 %, which
/// shifts the phase in gear as `0.02 (1 - R^2)/2` does.
pub const WIDE: f32 = 0.01;
/// Tolerance of the landing phase after rest, in steps of 2^-32 turns; 3e-3 rad.
const NEAR: i32 = 1 << 21;

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
}

/// Impact energy, as squared arrival speed in `(b w)^2` per drive period, over the drive phase.
#[derive(Clone, Copy, Debug)]
pub struct StrikeProfile {
    /// Energy of a part in gear, by group of the lot and phase.
    pub in_gear: [[f32; PLACES]; GROUPS],
    /// Energy of a part out of gear by phase, without [`StrikeProfile::landed`].
    pub out: [f32; PLACES],
    /// Energy of the first landings after rest, all at one phase.
    pub landed: f32,
    /// Number of those landings per drive period.
    pub landings: f32,
    /// Phase of those landings; `None` without any.
    pub landing: Option<Phase>,
    /// Simulated drive periods in gear and out of it, by group.
    pub periods: [[f32; GROUPS]; 2],
    /// Losses of gear in those periods.
    pub losses: f32,
    /// Mean downward acceleration of the track (symbol A) at the launches in gear, by group.
    pub bends: [f32; GROUPS],
}

impl StrikeProfile {
    const NONE: Self = Self {
        in_gear: [[0.0; PLACES]; GROUPS],
        out: [0.0; PLACES],
        landed: 0.0,
        landings: 0.0,
        landing: None,
        periods: [[0.0; GROUPS]; 2],
        losses: 0.0,
        bends: [0.0; GROUPS],
    };

    /// Share of the followed time in gear, 0..=1.
    #[must_use]
    pub fn share(&self) -> f32 {
        let [within, without] = self.periods.map(|periods| periods.iter().sum::<f32>());
        within / (within + without).max(1.0)
    }

    /// Mean drive periods in gear until it is lost; where it was not lost, a least.
    #[must_use]
    pub fn time_to_loss(&self) -> f32 {
        self.periods[0].iter().sum::<f32>() / self.losses.max(1.0)
    }
}

/// Result of a completed count, with its inputs and its number of steps.
///
/// A count is deterministic, so a stored result replaces a repetition
/// ([`Controller::strikes_known`](crate::control::Controller::strikes_known)).
#[cfg(any(test, feature = "unstable"))]
#[derive(Clone, Copy, Debug)]
pub struct StrikeCount {
    /// Inputs of the count.
    pub settings: StrikeSettings,
    steps: u32,
    profile: StrikeProfile,
}

#[cfg(any(test, feature = "unstable"))]
impl StrikeCount {
    /// Counts to the end.
    pub fn of(settings: StrikeSettings) -> Result<Self, OutOfRange> {
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
struct Waiting {
    place: u8,
    landed: bool,
    energy: f32,
    turns: f32,
}

/// Simulates the parts of a lot and accumulates their impact energies.
#[derive(Clone, Copy, Debug)]
pub struct StrikeProfiler {
    settings: StrikeSettings,
    surface: Surface,
    gear: Gear<i64>,
    rider: Option<Rider>,
    part: u32,
    impacts: u32,
    /// Steps so far, and the number of steps of a stored result.
    steps: u32,
    known: Option<u32>,
    row: [Waiting; ROW as usize],
    waiting: usize,
    was_in: bool,
    /// Drive periods in gear of the current part.
    turns: f32,
    /// Number of flights in [`StrikeProfile::bends`], by group.
    bent: [f32; GROUPS],
    profile: StrikeProfile,
}

impl StrikeProfiler {
    /// Begins a count; an error names the parameter out of range.
    pub fn new(settings: StrikeSettings) -> Result<Self, OutOfRange> {
        Ok(Self {
            settings,
            surface: Surface::at(settings.k, settings.tones)?,
            gear: Gear::in_steps(settings.order)?,
            rider: None,
            part: 0,
            impacts: 0,
            steps: 0,
            known: None,
            row: [Waiting::default(); ROW as usize],
            waiting: 0,
            was_in: false,
            turns: 0.0,
            bent: [0.0; GROUPS],
            profile: StrikeProfile::NONE,
        })
    }

    /// Inputs of the count.
    #[must_use]
    pub fn settings(&self) -> &StrikeSettings {
        &self.settings
    }

    /// Mean restitution of a group.
    #[must_use]
    pub fn restitution(&self, group: usize) -> f32 {
        let [low, high] = self.followed();
        low + (high - low) * (group as f32 + 0.5) * (1.0 / GROUPS as f32)
    }

    /// Lowest and highest simulated restitution.
    fn followed(&self) -> [f32; 2] {
        let lot = self.settings.restitution;
        [
            (lot.low() as f32 - WIDE).max(0.0),
            (lot.high() as f32 + WIDE).min(0.99),
        ]
    }

    /// Result; `None` before the end.
    #[must_use]
    pub fn profile(&self) -> Option<&StrikeProfile> {
        (self.part > PARTS).then_some(&self.profile)
    }

    /// Inputs of a count in progress; `None` once it has ended or a stored result is set.
    #[cfg(any(test, feature = "unstable"))]
    #[must_use]
    pub fn asked(&self) -> Option<&StrikeSettings> {
        Some(&self.settings).filter(|_| self.part <= PARTS && self.known.is_none())
    }

    /// Sets a stored result if its inputs agree. It becomes available after the same number of
    /// steps.
    #[cfg(any(test, feature = "unstable"))]
    pub fn know(&mut self, count: &StrikeCount) {
        if self.asked() == Some(&count.settings) {
            self.profile = count.profile;
            self.known = Some(count.steps);
        }
    }

    /// Simulates at most this number of impacts and returns whether the count continues.
    pub fn advance(&mut self, impacts: u32) -> bool {
        if let Some(last) = self.known {
            let left = last.saturating_sub(self.steps);
            self.steps += left.min(impacts);
            if self.steps == last {
                self.part = PARTS + 1;
            }
            return impacts <= left;
        }
        for _ in 0..impacts {
            if self.part > PARTS {
                return false;
            }
            self.step();
            self.steps += 1;
        }
        true
    }

    fn step(&mut self) {
        let Some(rider) = &mut self.rider else {
            self.begin();
            return;
        };
        self.impacts += 1;
        let mut struck = None;
        let over = rider.step_heard(&self.surface, |heard| struck = Some(heard));
        if let Some(heard) = struck {
            let speed = heard.speed(&self.surface);
            let place = (heard.phase.bits() >> 26) as u8;
            let landed = heard.rested && {
                let landing = *self.profile.landing.get_or_insert(heard.phase);
                (-NEAR..NEAR).contains(&((heard.phase - landing).bits() as i32))
            };
            let strike = Waiting {
                place,
                landed,
                energy: speed * speed,
                turns: heard.steps as f32 * (1.0 / Phase::TURN as f32),
            };
            if heard.rested || !self.is_row(strike.turns) {
                self.lose();
            }
            if heard.in_gear {
                self.was_in = true;
                for strike in self.row.into_iter().take(self.waiting) {
                    self.count_in(strike);
                }
                self.waiting = 0;
                self.count_in(strike);
                let group = self.group();
                self.profile.bends[group] += heard.bend(&self.surface);
                self.bent[group] += 1.0;
            } else if self.is_row(strike.turns) && self.waiting < self.row.len() {
                self.row[self.waiting] = strike;
                self.waiting += 1;
            } else {
                self.count_out(strike);
            }
        }
        if over || self.impacts >= MOST {
            // The end of the simulation is no loss of gear.
            self.was_in = false;
            self.lose();
            let time = self.rider.take().map_or(0, |rider| rider.time());
            let all = time as f32 * (1.0 / Phase::TURN as f32);
            let group = self.group();
            self.profile.periods[0][group] += self.turns;
            self.profile.periods[1][group] += (all - self.turns).max(0.0);
            self.turns = 0.0;
        }
    }

    /// Group of the current part.
    fn group(&self) -> usize {
        (self.part as usize).saturating_sub(1) * GROUPS / PARTS as usize % GROUPS
    }

    fn is_row(&self, turns: f32) -> bool {
        super::is_in_gear(f64::from(turns), f64::from(self.settings.order))
    }

    /// Ends a run of flights; impacts of a run too short for gear count as out of gear.
    fn lose(&mut self) {
        for strike in self.row.into_iter().take(self.waiting) {
            self.count_out(strike);
        }
        self.waiting = 0;
        if self.was_in {
            self.profile.losses += 1.0;
        }
        self.was_in = false;
    }

    fn count_in(&mut self, strike: Waiting) {
        self.turns += strike.turns;
        let group = self.group();
        if let Some(sum) = self.profile.in_gear[group].get_mut(usize::from(strike.place)) {
            *sum += strike.energy;
        }
    }

    fn count_out(&mut self, strike: Waiting) {
        if strike.landed {
            self.profile.landed += strike.energy;
            self.profile.landings += 1.0;
        } else if let Some(sum) = self.profile.out.get_mut(usize::from(strike.place)) {
            *sum += strike.energy;
        }
    }

    /// Begins the next part, or ends the count.
    fn begin(&mut self) {
        self.part += 1;
        if self.part > PARTS || self.impacts >= MOST {
            self.end();
            return;
        }
        // The restitutions are evenly spaced; each is simulated from rest and from the lock.
        let pair = (self.part - 1) / 2;
        let place = (pair as f32 + 0.5) * (2.0 / PARTS as f32);
        let [low, high] = self.followed();
        let mean = low + (high - low) * place;
        let draw = Draw::new(mean, self.settings.scatter, self.part);
        let span = Span::periods(PERIODS, 0);
        let rider = Rider::new(draw, self.gear, span);
        self.rider = Some(match self.lock(mean) {
            Some((phase, velocity)) if self.part.is_multiple_of(2) => rider.thrown(phase, velocity),
            _ => rider,
        });
    }

    fn end(&mut self) {
        self.part = PARTS + 1;
        let profile = &mut self.profile;
        let within = profile.periods[0].map(|periods| 1.0 / periods.max(1.0));
        for (sums, within) in profile.in_gear.iter_mut().zip(within) {
            sums.iter_mut().for_each(|sum| *sum *= within);
        }
        for (bend, count) in profile.bends.iter_mut().zip(self.bent) {
            *bend /= count.max(1.0);
        }
        let without = 1.0 / profile.periods[1].iter().sum::<f32>().max(1.0);
        profile.out.iter_mut().for_each(|sum| *sum *= without);
        profile.landed *= without;
        profile.landings *= without;
    }

    /// Phase and launch velocity of the lock (docs/theory-real-parts.md#t10.3); `None` without one.
    /// A scan and a bisection solve `C(t0) = pi r k (1 - R)/(1 + R)`.
    fn lock(&self, restitution: f32) -> Option<(Phase, f32)> {
        let StrikeSettings {
            order, k, tones, ..
        } = self.settings;
        let turns = TAU * order as f32 * k / (1.0 + restitution);
        let wanted = 0.5 * turns * (1.0 - restitution);
        let [[ratio, _], [third, _]] = tones;
        let [angle, of_third] = tones.map(|[_, angle]| Phase::from_radians(f64::from(angle)));
        let rises = |phase: Phase| {
            let (_, mut speed) = sine_cosine_single(phase);
            if ratio != 0.0 {
                let twice = Phase::from_bits(phase.bits().wrapping_mul(2)) + angle;
                speed += 2.0 * ratio * sine_cosine_single(twice).1;
            }
            if third != 0.0 {
                let thrice = Phase::from_bits(phase.bits().wrapping_mul(3)) + of_third;
                speed += 3.0 * third * sine_cosine_single(thrice).1;
            }
            speed
        };
        let step = Phase::from_bits(1 << 26);
        let (mut fastest, mut most, mut phase) = (Phase::ZERO, -1.0, Phase::ZERO);
        for _ in 0..64 {
            let velocity = rises(phase);
            if velocity > most {
                (fastest, most) = (phase, velocity);
            }
            phase += step;
        }
        if most <= wanted {
            return None;
        }
        // The stable root lies where the velocity falls.
        let mut phase = fastest;
        while rises(phase + step) > wanted {
            phase += step;
        }
        let mut half = Phase::from_bits(1 << 25);
        for _ in 0..16 {
            if rises(phase + half) > wanted {
                phase += half;
            }
            half = Phase::from_bits(half.bits() >> 1);
        }
        Some((phase, restitution * turns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_that_is_told_of_ends_as_one_s_own() {
        let settings = StrikeSettings {
            restitution: Restitution::interval(0.28, 0.32).unwrap(),
            scatter: 0.05,
            order: 1,
            k: 0.4438,
            tones: [[0.0; 2]; 2],
        };
        let count = StrikeCount::of(settings).unwrap();
        // Slice sizes that divide the number of steps, and one that does not; stored result set at
        // the start and later.
        let factor = (2..64)
            .find(|n| count.steps.is_multiple_of(*n))
            .unwrap_or(1);
        for (slice, after) in [(64, 0), (64, 3), (factor, 1), (count.steps - 1, 0)] {
            let mut own = StrikeProfiler::new(settings).unwrap();
            let mut told = own;
            for round in 0_u32.. {
                if round == after {
                    assert_eq!(told.asked(), Some(&settings));
                    told.know(&count);
                    assert_eq!(told.asked(), None);
                }
                let more = own.advance(slice);
                assert_eq!(told.advance(slice), more, "{slice} {round}");
                assert_eq!(own.profile().is_some(), told.profile().is_some());
                if !more {
                    break;
                }
            }
            let [own, told] = [own, told].map(|of| std::format!("{:?}", of.profile().unwrap()));
            assert_eq!(own, told);
        }
        // A result at another k is rejected.
        let mut other = StrikeProfiler::new(StrikeSettings {
            k: 0.45,
            ..settings
        })
        .unwrap();
        other.know(&count);
        assert!(other.asked().is_some());
    }
}
