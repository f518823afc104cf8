//! At which k, and with which second tone, the parts of a lot stay in gear: a search bounded in time and memory, for the
//! board.

use core::f32::consts::{FRAC_PI_2, PI};

use heapless::Vec;

use super::Gear;
use super::draw::Draw;
use super::limits::GearLimits;
use super::rider::{Rider, Second, Span, Surface};
use crate::feeder::{OutOfRange, Restitution, accept};

/// What a plan for gear is asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearPlanSettings {
    /// Mean restitution of the parts of the lot.
    pub restitution: Restitution,
    /// Standard deviation of a part's restitution from impact to impact (symbol s), 0..=0.3.
    pub scatter: f32,
    /// Drive periods in a flight (symbol r), 1..=100.
    pub order: u32,
    /// Lowest and highest k that may be chosen, 0.005..=4.
    pub k: [f32; 2],
    /// Largest second tone that may be chosen (symbol e), 0..=0.5; below 0.01 there is none.
    pub second_tone: f32,
    /// What the drive affords of it.
    pub limits: GearLimits,
}

/// What a plan has found so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearPlan {
    /// The k at which the lot's parts are in gear the longest.
    pub k: f32,
    /// Amplitude over the first (symbol e) and angle in rad (symbol th) of the second tone there; 0 and 0: none.
    pub second: [f32; 2],
    /// The share of time in gear to expect there, the mean over the lot, 0..=1.
    pub share: f32,
    /// Whether the search is over: the share is then that of parts on which the choice did not rest.
    pub settled: bool,
}

/// Most candidates of a round.
const CANDIDATES: usize = 40;

/// A k and a second tone that are tried.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    k: f32,
    second: Second,
    /// Sum of the shares of its runs, and their number.
    sum: f32,
    runs: u16,
}

impl Candidate {
    fn at(k: f32, second: Second) -> Self {
        Self {
            k,
            second,
            sum: 0.0,
            runs: 0,
        }
    }

    fn share(&self) -> f32 {
        if self.runs == 0 {
            0.0
        } else {
            self.sum / f32::from(self.runs)
        }
    }
}

/// A round of the search.
#[derive(Clone, Copy, Debug)]
struct Round {
    /// Runs that each candidate gets, and how long they are in drive periods.
    runs: u16,
    periods: u16,
    /// Candidates kept after it.
    kept: usize,
    /// How far from the best one new candidates are set after it, over the distance between the first ones; 0: none.
    about: f32,
}

const fn round(runs: u16, periods: u16, kept: usize, about: f32) -> Round {
    Round {
        runs,
        periods,
        kept,
        about,
    }
}

/// The rounds of one tone: successive halving (Karnin, Koren & Somekh 2013), about as much work for every round, shared by
/// ever fewer; then steps about the best. The last one tells the share, by parts on which the choice did not rest.
const ONE_TONE: [Round; 6] = [
    round(4, 200, 8, 0.0),
    round(8, 300, 3, 0.0),
    round(12, 500, 1, 1.0),
    round(16, 400, 2, 0.0),
    round(16, 500, 1, 0.0),
    round(14, 1600, 1, 0.0),
];

/// Those of two tones, which cost half as much again an impact.
const TWO_TONES: [Round; 6] = [
    round(4, 150, 10, 0.0),
    round(6, 250, 3, 0.0),
    round(12, 300, 1, 1.0),
    round(8, 300, 2, 0.5),
    round(6, 300, 1, 0.0),
    round(12, 1200, 1, 0.0),
];

/// Share from which on nothing better is searched: what is missing is two and a half standard errors of what the last round
/// tells (22 400 flights, lost eight at a time). From 0.9 on every test passes.
const ENOUGH: f32 = 0.998;

/// k tried at first of one tone, and at each angle of the second one.
const STEPS: usize = 24;
const STEPS_OF_TWO: usize = 10;

/// Angles of the second tone tried at first, in rad: of order 1 the best of 32 around the circle lay between them for every
/// lot that was asked (docs/theory-real-parts.md#t10.2); else around the circle.
const ANGLES: [f32; 4] = [2.4, 2.6, 2.2, 2.8];
const ROUND: [f32; 4] = [0.0, FRAC_PI_2, PI, 1.5 * PI];

/// Steps in k (over the first distance), e (over the largest) and th (rad) to the candidates about the best one.
const ABOUT_ONE: [[f32; 3]; 4] = [
    [-0.667, 0.0, 0.0],
    [-0.333, 0.0, 0.0],
    [0.333, 0.0, 0.0],
    [0.667, 0.0, 0.0],
];
const ABOUT_TWO: [[f32; 3]; 8] = [
    [-0.5, 0.0, 0.0],
    [0.5, 0.0, 0.0],
    [0.0, 0.0, 0.1],
    [0.0, 0.0, -0.1],
    [0.0, -0.25, 0.0],
    [0.25, -0.25, 0.0],
    [-0.3, 0.0, 0.1],
    [0.3, 0.0, -0.1],
];

/// Second tones below this are none. From 1e-4 to 0.1 every test passes.
const LEAST: f32 = 0.01;

/// Impacts after which the search of one tone, and of two, ends with what it has: within what 84 million instructions buy on
/// a Cortex-M4F, where one takes 449 to 470 of one tone with all that belongs to it, and 804 of two (88.5 million were
/// counted for 110 000 impacts).
const EFFORT: [u32; 2] = [170_000, 101_000];

/// The search for the k, and the second tone, with which parts of a lot are in gear for the largest share of time, from
/// rest and without a kick.
///
/// Each is tried with parts of the whole lot whose restitution scatters, the same parts for every candidate (common random
/// numbers), and the better third goes on to longer trials. Everything is integers and f32 without fused operations: the
/// same bits at the desk, in the emulator and on the board.
///
/// ```
/// use kband::feeder::Restitution;
/// use kband::regime::gear::{GearLimits, GearPlanSettings, GearPlanner};
/// let mut planner = GearPlanner::new(GearPlanSettings {
///     restitution: Restitution::single(0.3)?,
///     scatter: 0.05,
///     order: 1,
///     k: [0.28, 0.6],
///     second_tone: 0.0,
///     limits: GearLimits::NONE,
/// })?;
/// while planner.advance(1000) {}
/// let plan = planner.plan().unwrap();
/// assert!((0.41..0.48).contains(&plan.k));
/// assert!(plan.share > 0.7 && plan.settled);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Debug)]
pub struct GearPlanner {
    settings: GearPlanSettings,
    candidates: Vec<Candidate, CANDIDATES>,
    /// Whether a second tone is tried.
    two: bool,
    /// Distance of the first candidates in k.
    step: f32,
    /// Which round is under way.
    round: usize,
    /// The candidate and the run of it that are under way.
    candidate: usize,
    run: u16,
    rider: Option<(Surface, Rider)>,
    gear: Gear<i64>,
    plan: Option<GearPlan>,
    impacts: u32,
}

impl GearPlanner {
    /// The search; the refusal names the parameter.
    pub fn new(settings: GearPlanSettings) -> Result<Self, OutOfRange> {
        let [low, high] = settings.k;
        let within = |parameter, value: f32, accepts, accepted| {
            accept(parameter, f64::from(value), accepts, accepted).map(|_| ())
        };
        within(
            "scatter",
            settings.scatter,
            (0.0..=0.3).contains(&settings.scatter),
            "0..0.3",
        )?;
        within(
            "k",
            low,
            0.005 <= low && low <= high && high <= 4.0,
            "0.005..4, the lowest first",
        )?;
        within(
            "second tone",
            settings.second_tone,
            (0.0..=0.5).contains(&settings.second_tone),
            "0..0.5 of the first",
        )?;
        let mut planner = Self {
            settings,
            candidates: Vec::new(),
            two: false,
            step: 0.0,
            round: 0,
            candidate: 0,
            run: 0,
            rider: None,
            gear: Gear::in_steps(settings.order)?,
            plan: None,
            impacts: 0,
        };
        planner.begin();
        Ok(planner)
    }

    /// The first candidates.
    fn begin(&mut self) {
        let [low, high] = self.settings.k;
        let most = self.settings.second_tone;
        self.two = most >= LEAST;
        let (angles, steps): (&[f32], usize) = match (self.two, self.settings.order) {
            (false, _) => (&[0.0], STEPS),
            (true, 1) => (&ANGLES, STEPS_OF_TWO),
            (true, _) => (&ROUND, STEPS_OF_TWO),
        };
        self.step = (high - low) / (steps - 1) as f32;
        for &angle in angles {
            for n in 0..steps as u8 {
                let k = low + self.step * f32::from(n);
                let _ = self
                    .candidates
                    .push(Candidate::at(k, self.afforded(k, most, angle)));
            }
        }
    }

    /// As much of a second tone as the drive affords at a k, at most `most`; `[0, 0]` where it affords none.
    fn afforded(&self, k: f32, most: f32, angle: f32) -> Second {
        let parts = [1.0, 0.8, 0.6, 0.4, 0.2].map(|part| [most * part, angle]);
        let affords =
            |second: &&Second| second[0] >= LEAST && self.settings.limits.afford(k, **second);
        parts.iter().find(affords).copied().unwrap_or([0.0; 2])
    }

    /// What was asked.
    #[must_use]
    pub fn settings(&self) -> &GearPlanSettings {
        &self.settings
    }

    /// What was found so far; `None` before the first round is over.
    #[must_use]
    pub fn plan(&self) -> Option<&GearPlan> {
        self.plan.as_ref()
    }

    /// Impacts computed so far.
    #[must_use]
    #[cfg(test)]
    pub fn impacts(&self) -> u32 {
        self.impacts
    }

    /// Goes on by at most so many impacts; whether more are to be done.
    pub fn advance(&mut self, impacts: u32) -> bool {
        for _ in 0..impacts {
            if self.is_over() {
                return false;
            }
            self.step();
        }
        !self.is_over()
    }

    fn is_over(&self) -> bool {
        self.plan.is_some_and(|plan| plan.settled)
    }

    fn rounds(&self) -> &'static [Round; 6] {
        if self.two { &TWO_TONES } else { &ONE_TONE }
    }

    fn now(&self) -> Round {
        let rounds = self.rounds();
        rounds[self.round.min(rounds.len() - 1)]
    }

    /// The part of a run: it fills the lot evenly (additive recurrence of the golden ratio), whatever the number of runs.
    fn part(&self, run: u32) -> Draw {
        let turn = run.wrapping_mul(0x9E37_79B9).wrapping_add(1 << 31);
        let place = (turn >> 8) as f32 * (1.0 / 16_777_216.0);
        let lot = self.settings.restitution;
        let (low, high) = (lot.low() as f32, lot.high() as f32);
        Draw::new(low + (high - low) * place, self.settings.scatter, run)
    }

    /// One impact of the run under way, or what lies between two runs.
    fn step(&mut self) {
        self.impacts += 1;
        if self.impacts >= EFFORT[usize::from(self.two)] {
            self.end();
            return;
        }
        if let Some((surface, rider)) = &mut self.rider {
            if rider.step(surface) {
                let share = rider.share();
                self.rider = None;
                self.take(share);
            }
            return;
        }
        let round = self.now();
        let Some(candidate) = self.candidates.get(self.candidate) else {
            self.end_round();
            return;
        };
        // Runs of different rounds are different parts.
        let number = (self.round as u32) << 16 | u32::from(self.run);
        let draw = self.part(number);
        let span = Span::periods(round.periods, round.periods / 4);
        match Surface::at(candidate.k, candidate.second) {
            Ok(surface) => self.rider = Some((surface, Rider::new(draw, self.gear, span))),
            Err(_) => self.take(0.0),
        }
    }

    /// The share of the run that has ended.
    fn take(&mut self, share: f32) {
        let runs = self.now().runs;
        if let Some(candidate) = self.candidates.get_mut(self.candidate) {
            candidate.sum += share;
            candidate.runs += 1;
        }
        self.run += 1;
        if self.run >= runs {
            self.run = 0;
            self.candidate += 1;
        }
    }

    /// The effort is spent: what is best so far is the plan.
    fn end(&mut self) {
        let told = self.candidates.first().filter(|best| best.runs > 0);
        let share = told.map(Candidate::share);
        self.plan = self.plan.map(|plan| GearPlan {
            share: share.unwrap_or(plan.share),
            settled: true,
            ..plan
        });
    }

    fn end_round(&mut self) {
        let round = self.now();
        let last = self.rounds().len() - 1;
        let told = self.round >= last;
        let first = self.round == 0;
        if first && self.two {
            self.smooth();
        }
        self.rank();
        self.candidates.truncate(round.kept);
        let Some(best) = self.candidates.first().copied() else {
            return;
        };
        self.plan = Some(GearPlan {
            k: best.k,
            second: best.second,
            share: best.share(),
            settled: told,
        });
        if first && self.two {
            // What they were ranked by is not theirs alone.
            for candidate in &mut self.candidates {
                *candidate = Candidate::at(candidate.k, candidate.second);
            }
        }
        self.candidate = 0;
        self.round += 1;
        if !first && !told && best.share() >= ENOUGH {
            self.round = last;
        }
        if self.round == last {
            self.candidates.truncate(1);
            if let Some(best) = self.candidates.first_mut() {
                // What it has won with does not count.
                *best = Candidate::at(best.k, best.second);
            }
        } else if round.about > 0.0 {
            self.surround(&best, round.about);
        }
    }

    /// Takes each candidate with its two neighbours in k: of many that are never out of gear the best is the one that is
    /// farthest from where they are.
    fn smooth(&mut self) {
        for row in self.candidates.chunks_mut(STEPS_OF_TWO) {
            let mut before = 0.0;
            for n in 0..row.len() {
                let next = row.get(n + 1).map_or(0.0, |next| next.sum);
                if let Some(here) = row.get_mut(n) {
                    let sum = here.sum;
                    here.sum = 0.25 * (before + 2.0 * sum + next);
                    before = sum;
                }
            }
        }
    }

    /// The best first; stable, without allocation.
    fn rank(&mut self) {
        for end in (1..self.candidates.len()).rev() {
            for rank in 0..end {
                if let Some([first, second]) = self.candidates.get_mut(rank..rank + 2)
                    && second.share() > first.share()
                {
                    core::mem::swap(first, second);
                }
            }
        }
    }

    /// Sets new candidates about the best one.
    fn surround(&mut self, best: &Candidate, scale: f32) {
        let steps: &[[f32; 3]] = if self.two { &ABOUT_TWO } else { &ABOUT_ONE };
        let [low, high] = self.settings.k;
        let most = self.settings.second_tone;
        for &[k, ratio, angle] in steps {
            let k = (best.k + k * scale * self.step).max(low).min(high);
            let ratio = (best.second[0] + ratio * scale * most).max(0.0).min(most);
            let second = if ratio < LEAST {
                [0.0; 2]
            } else {
                self.afforded(k, ratio, best.second[1] + angle * scale)
            };
            let _ = self.candidates.push(Candidate::at(k, second));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Scatter, Tone, Wave, WaveMap};
    use crate::regime::band;
    use crate::regime::gear::{Share, shares_from_rest};

    /// The share in f64, by other draws, over 20 parts of 2000 periods.
    fn truth(plan: &GearPlan, lot: Restitution, scatter: f32) -> f64 {
        let [amplitude, angle] = plan.second.map(f64::from);
        let wave = Wave::build(Tone { amplitude, angle }, Tone::default()).unwrap();
        let map = WaveMap::on(wave, f64::from(plan.k), lot.middle()).unwrap();
        let part = |n: u64| {
            let mean = lot.low() + (lot.high() - lot.low()) * (n as f64 + 0.5) / 20.0;
            Scatter::build(mean, f64::from(scatter), n + 1000).unwrap()
        };
        let parts: [Scatter; 20] = core::array::from_fn(|n| part(n as u64));
        let mut sum = Share::default();
        shares_from_rest(&map, &parts, 1, 2000.0, |_, share| sum = sum.and(&share)).unwrap();
        sum.share()
    }

    fn plan(lot: Restitution, scatter: f32, second_tone: f32) -> GearPlanner {
        let born = band::birth(lot.high(), 1).unwrap();
        let mut planner = GearPlanner::new(GearPlanSettings {
            restitution: lot,
            scatter,
            order: 1,
            k: [0.28, (1.02 * born).min(0.98) as f32],
            second_tone,
            limits: GearLimits::NONE,
        })
        .unwrap();
        while planner.advance(1000) {}
        planner
    }

    /// What a grid of 60 values of k and 40 parts of 3000 periods each found at best; the share told is that of 20 parts
    /// of 1200 periods, in which gear is lost some 20 times a part where the share is 0.4: it errs by 0.02.
    #[test]
    fn the_share_at_the_chosen_k_is_that_of_a_fine_grid_and_is_told() {
        for (low, high, scatter, second_tone, best) in [
            (0.2, 0.2, 0.05, 0.0, 0.955),
            (0.3, 0.3, 0.05, 0.0, 0.840),
            (0.5, 0.5, 0.05, 0.0, 0.398),
            (0.3, 0.3, 0.1, 0.0, 0.455),
            (0.1, 0.3, 0.03, 0.0, 0.912),
            (0.2, 0.2, 0.05, 0.15, 1.0),
            (0.5, 0.5, 0.05, 0.15, 1.0),
            (0.3, 0.3, 0.1, 0.15, 0.952),
            (0.3, 0.3, 0.1, 0.25, 0.947),
            (0.5, 0.5, 0.1, 0.25, 0.942),
            (0.1, 0.3, 0.03, 0.15, 1.0),
        ] {
            let lot = Restitution::interval(low, high).unwrap();
            let planner = plan(lot, scatter, second_tone);
            let plan = planner.plan().unwrap();
            let truth = truth(plan, lot, scatter);
            assert!(
                plan.settled && truth > best - 0.04,
                "{low} {scatter}: {truth} {plan:?}"
            );
            assert!(
                (f64::from(plan.share) - truth).abs() < 0.05,
                "{low} {scatter}: {truth} {plan:?}"
            );
        }
    }

    #[test]
    fn slices_change_no_bit_and_the_effort_is_bounded() {
        let lot = Restitution::single(0.7).unwrap();
        let whole = plan(lot, 0.05, 0.0);
        let mut sliced = GearPlanner::new(whole.settings).unwrap();
        while sliced.advance(7) {}
        assert_eq!(
            (sliced.plan(), sliced.impacts()),
            (whole.plan(), whole.impacts())
        );
        assert!(whole.impacts() <= EFFORT[0]);
    }

    #[test]
    fn what_cannot_be_planned_is_refused() {
        let settings = GearPlanSettings {
            restitution: Restitution::single(0.2).unwrap(),
            scatter: 0.05,
            order: 1,
            k: [0.3, 0.4],
            second_tone: 0.0,
            limits: GearLimits::NONE,
        };
        for (settings, parameter) in [
            (
                GearPlanSettings {
                    scatter: 0.31,
                    ..settings
                },
                "scatter",
            ),
            (
                GearPlanSettings {
                    scatter: f32::NAN,
                    ..settings
                },
                "scatter",
            ),
            (
                GearPlanSettings {
                    second_tone: 0.6,
                    ..settings
                },
                "second tone",
            ),
            (
                GearPlanSettings {
                    order: 0,
                    ..settings
                },
                "order",
            ),
            (
                GearPlanSettings {
                    k: [0.4, 0.3],
                    ..settings
                },
                "k",
            ),
            (
                GearPlanSettings {
                    k: [0.4, 4.1],
                    ..settings
                },
                "k",
            ),
        ] {
            assert_eq!(GearPlanner::new(settings).unwrap_err().parameter, parameter);
        }
    }
}
