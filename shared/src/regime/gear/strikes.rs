//! Where in the turn the parts of a lot strike and how loudly, in gear and out of it.

use core::f32::consts::TAU;

use super::draw::Draw;
use super::rider::{Rider, Span, Surface, Tones};
use super::{Gear, ROW};
use crate::arithmetic::{Phase, sine_cosine_single};
use crate::feeder::{OutOfRange, Restitution};

/// Places of a turn at which strikes are counted: 0.1 rad each.
pub const PLACES: usize = 64;
/// Groups of the lot by restitution, each with a profile in gear of its own.
pub const GROUPS: usize = 4;
/// Parts that are followed, half from rest and half from the lock.
const PARTS: u32 = 32;
/// Drive periods that each is followed for, over the order of the gear.
const PERIODS: u16 = 768;
/// Impacts of all parts together, at most: parts that chatter have twice that many in all.
const MOST: u32 = 600_000;
/// What is followed beyond either end of the lot: where a part in gear strikes depends on `k (1 - R)/(1 + R)`, so that an
/// amplitude that is 2 % off moves it as `0.02 (1 - R^2)/2` does.
pub const WIDE: f32 = 0.01;
/// How near in steps of 2^-32 turns to where the first part from rest lands others do: 3e-3 rad.
const NEAR: i32 = 1 << 21;

/// What strikes are counted of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrikeSettings {
    /// Restitutions of the lot, and their scatter from impact to impact.
    pub restitution: Restitution,
    /// See above.
    pub scatter: f32,
    /// Order of the gear.
    pub order: u32,
    /// k of the track.
    pub k: f32,
    /// Tones of the track above the first.
    pub tones: Tones,
}

/// Squares of the speeds of arrival, in `(b w)^2`, summed by the phase of the track and divided by the drive periods.
#[derive(Clone, Copy, Debug)]
pub struct StrikeProfile {
    /// By parts in gear, in one period of one of them, for each group of the lot.
    pub in_gear: [[f32; PLACES]; GROUPS],
    /// By parts out of gear, in one period of one of them, without [`StrikeProfile::landed`].
    pub out: [f32; PLACES],
    /// By those of them that land after having been thrown from rest: all at one phase.
    pub landed: f32,
    /// How often they do in a period.
    pub landings: f32,
    /// That phase; `None` where none was thrown from rest.
    pub landing: Option<Phase>,
    /// Drive periods followed in gear and out of it, for each group.
    pub periods: [[f32; GROUPS]; 2],
    /// Losses of gear in them.
    pub losses: f32,
    /// For each group the track's mean downward acceleration (symbol A) where its flights in gear begin, from the eighth in a row on.
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

/// Strikes counted to the end: of what, in how many steps, and what came of it.
///
/// Two counts of the same take as many steps and find the same, so that one that is told need not count
/// ([`Controller::strikes_known`](crate::control::Controller::strikes_known)).
#[cfg(any(test, feature = "unstable"))]
#[derive(Clone, Copy, Debug)]
pub struct StrikeCount {
    /// What was counted.
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

/// A strike that is not known yet to be in gear.
#[derive(Clone, Copy, Debug, Default)]
struct Waiting {
    place: u8,
    landed: bool,
    energy: f32,
    turns: f32,
}

/// Follows parts of a lot, impact by impact, and counts their strikes.
#[derive(Clone, Copy, Debug)]
pub struct StrikeProfiler {
    settings: StrikeSettings,
    surface: Surface,
    gear: Gear<i64>,
    rider: Option<Rider>,
    part: u32,
    impacts: u32,
    /// Steps taken, and those after which a count that was told of ends.
    steps: u32,
    known: Option<u32>,
    row: [Waiting; ROW as usize],
    waiting: usize,
    was_in: bool,
    /// Drive periods in gear of the part under way.
    turns: f32,
    /// Flights in gear that [`StrikeProfile::bends`] is the mean of.
    bent: [f32; GROUPS],
    profile: StrikeProfile,
}

impl StrikeProfiler {
    /// The count for these settings; the refusal names what is out of range.
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

    /// What is counted.
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

    /// Lowest and highest restitution that is followed.
    fn followed(&self) -> [f32; 2] {
        let lot = self.settings.restitution;
        [
            (lot.low() as f32 - WIDE).max(0.0),
            (lot.high() as f32 + WIDE).min(0.99),
        ]
    }

    /// What was counted; `None` before its end.
    #[must_use]
    pub fn profile(&self) -> Option<&StrikeProfile> {
        (self.part > PARTS).then_some(&self.profile)
    }

    /// What is being counted; `None` once it is counted or known.
    #[cfg(any(test, feature = "unstable"))]
    #[must_use]
    pub fn asked(&self) -> Option<&StrikeSettings> {
        Some(&self.settings).filter(|_| self.part <= PARTS && self.known.is_none())
    }

    /// Spares the count, if it is this one: the same is then found after as many steps.
    #[cfg(any(test, feature = "unstable"))]
    pub fn know(&mut self, count: &StrikeCount) {
        if self.asked() == Some(&count.settings) {
            self.profile = count.profile;
            self.known = Some(count.steps);
        }
    }

    /// Follows the parts for so many impacts; whether more are to be done.
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
            // What ended is the time that it is followed for, not its gear.
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

    /// Group of the part under way.
    fn group(&self) -> usize {
        (self.part as usize).saturating_sub(1) * GROUPS / PARTS as usize % GROUPS
    }

    fn is_row(&self, turns: f32) -> bool {
        super::is_in_gear(f64::from(turns), f64::from(self.settings.order))
    }

    /// The row is over; what waits was none.
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

    /// The next part, or the end.
    fn begin(&mut self) {
        self.part += 1;
        if self.part > PARTS || self.impacts >= MOST {
            self.end();
            return;
        }
        // They fill the lot evenly, each restitution from rest and from the lock.
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

    /// Phase and launch velocity of the lock of a restitution (docs/theory-real-parts.md#t10.3); `None` where there is none.
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
        // It is stable where the velocity falls.
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
        // Slices that the count is a multiple of, and that it is none of; told at the begin and later.
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
        // Of another k nothing is taken.
        let mut other = StrikeProfiler::new(StrikeSettings {
            k: 0.45,
            ..settings
        })
        .unwrap();
        other.know(&count);
        assert!(other.asked().is_some());
    }
}
