//! Search for the kick that captures the largest share of a lot (docs/theory-capture.md#t7.4).
//!
//! The method is ranking and selection over a list of candidate kicks (Bechhofer, Santner and
//! Goldsman 1995). A screen on few parts drops weak kicks early; confirmation and a recount on more
//! parts follow. Time and memory are bounded.

use core::task::Poll;

use heapless::Vec;

use super::{DriveLag, Kick, KickSettings, Outcome, Trial, TrialRun};
use crate::feeder::{OutOfRange, Restitution, accept_in};
use crate::impact::{ContactTime, Kernel, Single};
use crate::regime::band;

/// Parts that one kick must capture, and the error of their amplitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lot {
    /// k at the target amplitude.
    pub k: f64,
    /// Restitution of the parts.
    pub restitution: Restitution,
    /// Requested lock order, 1..=100.
    pub order: u32,
    /// Largest relative error of the amplitude, 0..=0.2.
    pub amplitude_error: f64,
    /// Duration of an impact.
    pub contact: ContactTime,
}

impl Lot {
    /// Part number `index` of the lot. The four corners of restitution and amplitude error come
    /// first, then Roberts' R2 low-discrepancy sequence.
    pub fn part(&self, index: u32) -> Trial {
        let corners = [[0.0, 1.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]];
        let corner = corners.get(index as usize).copied();
        let [a, b] = corner.unwrap_or_else(|| {
            [0.754_877_666_246_692_8, 0.569_840_290_998_053_2].map(|step| {
                let x = f64::from(index - 4) * step + 0.5;
                x - libm::floor(x)
            })
        });
        let (low, high) = (self.restitution.low(), self.restitution.high());
        Trial {
            k: self.k / (1.0 + self.amplitude_error * (2.0 * b - 1.0)),
            restitution: low + (high - low) * a,
            order: self.order,
            contact: self.contact,
        }
    }
}

/// Inputs of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanSettings {
    /// The parts.
    pub lot: Lot,
    /// The drive.
    pub drive: DriveLag,
    /// Time constant of the drive in cycles; it scales the holds of the candidates.
    pub time_constant: f64,
    /// Work in impacts after which the search ends with the best kick so far. A set-up of the map
    /// counts as [`SET_UP_COST`] impacts.
    pub effort: u32,
}

impl PlanSettings {
    /// Default work in impacts. It takes 16.5 million instructions on a Cortex-M4F, 411 an impact.
    pub const DEFAULT_EFFORT: u32 = 40_000;
}

/// Cost of a set-up of the map, in impacts: an arcsine, a square root and a division in integers.
pub const SET_UP_COST: u32 = 3;

/// A kick and its count of captures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoredKick {
    /// The kick.
    pub kick: Kick,
    /// Number of parts tried.
    pub tried: u32,
    /// Number of parts captured.
    pub locked: u32,
}

impl ScoredKick {
    /// Share of the tried parts that it captured, 0..=1.
    pub fn share(&self) -> f64 {
        f64::from(self.locked) / f64::from(self.tried.max(1))
    }

    /// Expected share on further parts by Laplace's rule of succession.
    fn expected(&self) -> f64 {
        f64::from(self.locked + 1) / f64::from(self.tried + 2)
    }
}

/// Number of kicks kept for later attempts.
const MAX_KICKS: usize = 4;

/// Result of a search: the kept kicks, best first.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    ranked: Vec<ScoredKick, MAX_KICKS>,
    /// Number of impacts computed, waits of resting parts included.
    pub impacts: u32,
    /// Number of set-ups of the map for another amplitude or part.
    pub set_ups: u32,
    /// Number of kicks tried.
    pub kicks: u32,
}

impl Plan {
    fn sort_by_share(&mut self) {
        // Bubble sort: stable and without allocation.
        for end in (1..self.ranked.len()).rev() {
            for rank in 0..end {
                if let Some([first, second]) = self.ranked.get_mut(rank..rank + 2)
                    && second.expected() > first.expected()
                {
                    core::mem::swap(first, second);
                }
            }
        }
    }

    /// Cost of the search, in impacts.
    pub fn effort(&self) -> u32 {
        self.impacts + SET_UP_COST * self.set_ups
    }

    /// The best kick; `None` if no kick captured a part.
    pub fn best(&self) -> Option<ScoredKick> {
        self.ranked.first().copied()
    }

    /// Kick for attempt number `attempt`, counted from 0. Attempts cycle through the kept kicks;
    /// each further cycle holds the kick one drive cycle longer, so no attempt repeats.
    pub fn attempt(&self, attempt: u32) -> Option<Kick> {
        let mut settings = self.scored(attempt)?.kick.settings();
        let longer = (attempt / self.ranked.len() as u32).min(1000) as u16;
        settings.hold = settings.hold.saturating_add(longer).min(10_000);
        Kick::build(settings).ok()
    }

    /// Probability that attempt number `attempt` misses a part of the lot, 0..1; 1 without a kick.
    pub fn miss_probability(&self, attempt: u32) -> f64 {
        1.0 - self.scored(attempt).map_or(0.0, |entry| entry.expected())
    }

    fn scored(&self, attempt: u32) -> Option<&ScoredKick> {
        let turn = attempt.checked_rem(self.ranked.len() as u32)?;
        self.ranked.get(turn as usize)
    }
}

/// Search for kicks, resumable in slices.
///
/// Candidates are rectangular kicks and slow descents, the more suitable and shorter ones first. A
/// kick that cannot reach the kept ones is dropped. The search ends at the first kick that captures
/// 48 of 48 parts. Otherwise two fifths of the work recount the kept kicks, because selection
/// biases their first counts upwards. Memory is fixed.
#[derive(Clone, Debug)]
pub struct Planner {
    settings: PlanSettings,
    flip: f64,
    candidate: u16,
    running: Option<(ScoredKick, Option<TrialRun>)>,
    /// Rank of the kept kick that is recounted next; `None` during the search.
    recounted: Option<usize>,
    plan: Plan,
    done: bool,
}

const _: () = assert!(size_of::<Planner>() <= 1024);

/// Parts on which a kick is screened, confirmed and recounted.
const SCREENED_PARTS: u32 = 16;
const CONFIRMED_PARTS: u32 = 48;
const RECOUNTED_PARTS: u32 = 96;

/// Largest number of misses in the screen while fewer than four kicks are kept.
const MAX_SCREEN_MISSES: u32 = 3;

/// Share of the work spent on the search, in fifths; the rest is for the recount.
const SEARCH_EFFORT_FIFTHS: u32 = 3;

/// Number of impacts after which a trial counts as missed; it bounds the work of one trial.
const MAX_TRIAL_IMPACTS: u32 = 6_000;

/// Commanded k of the rectangular kicks over the lot's highest flip.
const KICK_DEPTHS: [f64; 8] = [0.93, 0.88, 0.82, 0.75, 0.65, 0.55, 0.45, 0.35];

/// Holds of the rectangular kicks, in time constants of the drive.
const KICK_HOLDS: [f64; 3] = [2.5, 4.0, 6.5];

/// Descents of the rectangular kicks, in cycles.
const SHORT_DESCENTS: [u16; 2] = [0, 30];

/// Lengths of the slow descents, in cycles.
const SLOW_DESCENTS: [u16; 4] = [60, 120, 240, 400];

/// Upper bound of restitution at which slow descents come first, in order 1. Below, rectangular
/// kicks are more reliable; above, neither is, and shorter kicks allow more attempts.
const SLOW_DESCENT_RESTITUTIONS: core::ops::Range<f64> = 0.35..0.58;

/// Commanded k at the start and end of a slow descent, over the lot's highest flip.
const SLOW_DESCENT_SPANS: [(f64, f64); 4] = [(0.82, 1.0), (0.80, 0.90), (0.82, 0.88), (0.70, 0.90)];

impl Planner {
    /// Begins a search; an error names the parameter out of range.
    pub fn new(settings: PlanSettings) -> Result<Self, OutOfRange> {
        let lot = settings.lot;
        accept_in("amplitude_error", lot.amplitude_error, 0.0..=0.2, "0..0.2")?;
        Single::build(lot.k, lot.restitution.high())?;
        Ok(Self {
            settings,
            flip: band::edges_with_contact(lot.restitution.high(), lot.order, lot.contact)?[1],
            candidate: 0,
            running: None,
            recounted: None,
            plan: Plan {
                ranked: Vec::new(),
                impacts: 0,
                set_ups: 0,
                kicks: 0,
            },
            done: false,
        })
    }

    /// Candidate number `index`; `Err` past the last, `Ok(None)` beyond the drive's limit.
    fn candidate(&self, index: u16) -> Result<Option<Kick>, ()> {
        let mut index = usize::from(index);
        if index == 0 {
            return Ok(Some(Kick::NONE));
        }
        index -= 1;
        let factor = |depth: f64| (self.settings.lot.k / (depth * self.flip)) as f32;
        let hold = |constants: f64| {
            libm::round(constants * self.settings.time_constant + 2.0).min(10_000.0) as u16
        };
        let rectangles = KICK_DEPTHS.len() * KICK_HOLDS.len() * SHORT_DESCENTS.len();
        let slow = SLOW_DESCENT_SPANS.len() * SLOW_DESCENTS.len();
        if index >= rectangles + slow {
            return Err(());
        }
        let lot = self.settings.lot;
        if lot.order == 1 && SLOW_DESCENT_RESTITUTIONS.contains(&lot.restitution.high()) {
            index = (index + rectangles) % (rectangles + slow);
        }
        let settings = if index < rectangles {
            let depth = KICK_DEPTHS[index % KICK_DEPTHS.len()];
            index /= KICK_DEPTHS.len();
            KickSettings {
                factor: factor(depth),
                hold: hold(KICK_HOLDS[index % KICK_HOLDS.len()]),
                descent: SHORT_DESCENTS[index / KICK_HOLDS.len()],
                release: 1.0,
            }
        } else {
            index -= rectangles;
            let (from, to) = SLOW_DESCENT_SPANS[index % SLOW_DESCENT_SPANS.len()];
            KickSettings {
                factor: factor(from),
                hold: hold(4.0),
                descent: SLOW_DESCENTS[index / SLOW_DESCENT_SPANS.len()],
                release: factor(to).max(1.0),
            }
        };
        let is_within_limit = settings.factor <= self.settings.drive.limit;
        Ok(Kick::build(settings).ok().filter(|_| is_within_limit))
    }

    /// Computes at most `slice` further impacts and returns the plan at the end of the search.
    pub fn advance(&mut self, slice: u32) -> Poll<Plan> {
        for _ in 0..slice {
            if !self.done && !self.advance_one_impact() {
                self.plan.sort_by_share();
                self.done = true;
            }
            if self.done {
                return Poll::Ready(self.plan.clone());
            }
        }
        Poll::Pending
    }

    /// Computes one impact; returns `false` at the end of the search.
    fn advance_one_impact(&mut self) -> bool {
        let effort = self.plan.effort();
        if effort >= self.settings.effort {
            return false;
        }
        if self.recounted.is_none() && effort >= self.settings.effort / 5 * SEARCH_EFFORT_FIFTHS {
            self.begin_recount();
        }
        match self.recounted {
            Some(rank) => self.step_recount(rank),
            None => self.step_search(),
        }
    }

    /// Ends the search and begins the recount, which removes the selection bias of the kept kicks.
    fn begin_recount(&mut self) {
        self.running = None;
        self.recounted = Some(0);
    }

    /// Computes one impact of the recount; returns `false` once each kept kick has
    /// [`RECOUNTED_PARTS`] trials.
    fn step_recount(&mut self, rank: usize) -> bool {
        let open = |rank: usize| {
            let entry = self.plan.ranked.get(rank).copied();
            entry.filter(|scored| scored.tried < RECOUNTED_PARTS)
        };
        let Some(scored) = open(rank) else {
            let mut others = (1..=MAX_KICKS).map(|ahead| (rank + ahead) % MAX_KICKS);
            let next = others.find(|rank| open(*rank).is_some());
            self.recounted = next.or(self.recounted);
            return next.is_some();
        };
        let progress = self.simulate_part(scored);
        if let Ok(Poll::Ready(scored)) = progress {
            if let Some(entry) = self.plan.ranked.get_mut(rank) {
                *entry = scored;
            }
            self.recounted = Some((rank + 1) % MAX_KICKS);
        }
        progress.is_ok()
    }

    /// Computes one impact of the search; returns `false` once a kick captured each of
    /// [`CONFIRMED_PARTS`] parts.
    fn step_search(&mut self) -> bool {
        let Some(scored) = self.running.as_ref().map(|(scored, _)| *scored) else {
            match self.candidate(self.candidate) {
                Err(()) => self.begin_recount(),
                Ok(kick) => {
                    self.candidate += 1;
                    if let Some(kick) = kick {
                        self.plan.kicks += 1;
                        let scored = ScoredKick {
                            kick,
                            tried: 0,
                            locked: 0,
                        };
                        self.running = Some((scored, None));
                    }
                }
            }
            return true;
        };
        let scored = match self.simulate_part(scored) {
            Ok(Poll::Ready(scored)) => scored,
            progress => return progress.is_ok(),
        };
        let missed = scored.tried - scored.locked;
        let enough = match missed {
            0 | 1 => CONFIRMED_PARTS,
            _ => SCREENED_PARTS,
        };
        // Even with no further miss in the screen this kick would not be kept.
        let is_rejected = match self.plan.ranked.get(MAX_KICKS - 1) {
            None => missed > MAX_SCREEN_MISSES,
            Some(last) => {
                let best = ScoredKick {
                    locked: SCREENED_PARTS.saturating_sub(missed),
                    tried: SCREENED_PARTS,
                    ..scored
                };
                scored.tried <= SCREENED_PARTS && best.expected() <= last.expected()
            }
        };
        if scored.tried < enough && !is_rejected {
            self.running = Some((scored, None));
            return true;
        }
        self.insert_by_rank(scored);
        missed > 0 || scored.tried < CONFIRMED_PARTS
    }

    /// Computes one impact of the next part of `scored`; returns the new count at its outcome.
    fn simulate_part(&mut self, mut scored: ScoredKick) -> Result<Poll<ScoredKick>, OutOfRange> {
        let PlanSettings { lot, drive, .. } = &self.settings;
        let (_, trial_run) = self.running.get_or_insert((scored, None));
        let trial_run = match trial_run {
            Some(begun) => begun,
            None => {
                let begun = TrialRun::new(lot.part(scored.tried), *drive, scored.kick)?;
                self.plan.set_ups += begun.set_ups;
                trial_run.insert(begun)
            }
        };
        let set_ups = trial_run.set_ups;
        let outcome = trial_run.simulate_impact();
        let ends = trial_run.steps() >= MAX_TRIAL_IMPACTS;
        let outcome = outcome.or(ends.then_some(Outcome::Missed));
        self.plan.impacts += 1;
        self.plan.set_ups += trial_run.set_ups - set_ups;
        let Some(outcome) = outcome else {
            return Ok(Poll::Pending);
        };
        self.running = None;
        scored.tried += 1;
        scored.locked += u32::from(outcome == Outcome::Locked);
        Ok(Poll::Ready(scored))
    }

    /// Inserts a kick by rank; at equal rank the earlier, shorter one stays ahead.
    fn insert_by_rank(&mut self, scored: ScoredKick) {
        if scored.locked == 0 {
            return;
        }
        let mut next = scored;
        for entry in &mut self.plan.ranked {
            if next.expected() > entry.expected() {
                core::mem::swap(entry, &mut next);
            }
        }
        // The lowest-ranked kick is dropped when the list is full.
        let _ = self.plan.ranked.push(next);
    }
}

#[cfg(test)]
mod tests {
    use super::super::DriveLagSettings;
    use super::*;
    use crate::regime::band::Band;

    fn settings(low: f64, high: f64, time_constant: f64) -> PlanSettings {
        let restitution = Restitution::interval(low, high).unwrap();
        PlanSettings {
            lot: Lot {
                k: Band::common(restitution, 1).unwrap().setpoint(),
                restitution,
                order: 1,
                amplitude_error: 0.02,
                contact: ContactTime::INSTANT,
            },
            drive: drive(time_constant, 0.0),
            time_constant,
            effort: PlanSettings::DEFAULT_EFFORT,
        }
    }

    fn drive(time_constant: f64, start: f64) -> DriveLag {
        let settings = DriveLagSettings {
            time_constant,
            start,
            ..DriveLagSettings::DEFAULT
        };
        DriveLag::build(settings).unwrap()
    }

    fn plan(settings: PlanSettings, slice: u32) -> Plan {
        let mut planner = Planner::new(settings).unwrap();
        for _ in 0..1_000_000 / slice {
            if let Poll::Ready(plan) = planner.advance(slice) {
                return plan;
            }
        }
        panic!("a plan ends within its effort");
    }

    fn captured(part: Trial, drive: DriveLag, kick: Kick) -> bool {
        let mut trial_run = TrialRun::new(part, drive, kick).unwrap();
        let outcome = (0..MAX_TRIAL_IMPACTS).find_map(|_| trial_run.simulate_impact());
        outcome == Some(Outcome::Locked)
    }

    /// Share of `runs` parts captured within `attempts` kicks, on parts other than those of the
    /// plan.
    fn rate(settings: PlanSettings, plan: &Plan, runs: u32, attempts: u32) -> f64 {
        let is_captured = |run: &u32| {
            let part = settings.lot.part(1000 + run);
            (0..attempts).any(|attempt| {
                let drive = drive(settings.time_constant, f64::from(attempt.min(1)));
                let kick = plan.attempt(attempt);
                kick.is_some_and(|kick| captured(part, drive, kick))
            })
        };
        (0..runs).filter(is_captured).count() as f64 / f64::from(runs)
    }

    #[test]
    fn planned_kicks_reach_the_capture_goals() {
        // The controller's goals are 0.99, 0.99, 0.97 and 0.90; 1000 runs with 6 attempts gave
        // 1.000, 1.000, 1.000, 0.991. At 0.9 the standard error of 100 runs is 0.03.
        for (low, high, time_constant, min_rate) in [
            (0.18, 0.22, 5.0, 0.99),
            (0.28, 0.32, 5.0, 0.99),
            (0.38, 0.42, 8.0, 0.97),
            (0.48, 0.52, 5.0, 0.90),
        ] {
            let settings = settings(low, high, time_constant);
            let plan = plan(settings, 1000);
            // The last step may add up to three set-ups.
            assert!(plan.effort() <= settings.effort + 3 * SET_UP_COST);
            let captured = rate(settings, &plan, 100, 6);
            assert!(captured >= min_rate, "{low}..{high}: {captured}");
            if low > 0.26 {
                let parts = (0..100).map(|run| settings.lot.part(run));
                let by_band =
                    parts.filter(|part| self::captured(*part, settings.drive, Kick::NONE));
                assert!(by_band.count() <= 2, "{low}..{high}: by the band alone");
            }
        }
    }

    #[test]
    fn slices_do_not_change_the_plan() {
        let settings = settings(0.28, 0.32, 5.0);
        let at_once = plan(settings, 1000);
        for slice in [1, 7] {
            assert_eq!(plan(settings, slice), at_once);
        }
    }

    #[test]
    fn plan_is_empty_where_the_drive_limit_is_too_low() {
        let mut weak = settings(0.28, 0.32, 5.0);
        let limit = 1.1;
        let default = DriveLagSettings::DEFAULT;
        weak.drive = DriveLag::build(DriveLagSettings { limit, ..default }).unwrap();
        let plan = plan(weak, 1000);
        assert_eq!(plan.best(), None);
        assert_eq!(plan.attempt(0), None);
    }
}
