//! At which k the parts of a lot stay in gear: a search bounded in time and memory, for the board.

use heapless::Vec;

use super::Gear;
use super::draw::Draw;
use super::rider::{OneTone, Rider, Span};
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
}

/// What a plan has found so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearPlan {
    /// The k at which the lot's parts are in gear the longest.
    pub k: f32,
    /// The share of time in gear to expect there, the mean over the lot, 0..=1.
    pub share: f32,
    /// Whether the search is over: the share is then that of parts that had no say in the choice.
    pub settled: bool,
}

/// Candidates for k that the search begins with.
const CANDIDATES: usize = 24;

/// A k that is tried.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    k: f32,
    /// Sum of the shares of its runs, and their number.
    sum: f32,
    runs: u16,
}

impl Candidate {
    fn at(k: f32) -> Self {
        Self {
            k,
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
    /// Candidates set about the best one after it, at thirds of the distance between the first ones.
    about: bool,
}

/// Successive halving (Karnin, Koren & Somekh 2013): about as much work for every round, shared by ever fewer.
const ROUNDS: [Round; 5] = [
    Round {
        runs: 6,
        periods: 200,
        kept: 8,
        about: false,
    },
    Round {
        runs: 12,
        periods: 300,
        kept: 3,
        about: false,
    },
    Round {
        runs: 16,
        periods: 500,
        kept: 1,
        about: true,
    },
    Round {
        runs: 24,
        periods: 400,
        kept: 2,
        about: false,
    },
    Round {
        runs: 24,
        periods: 500,
        kept: 1,
        about: false,
    },
];

/// Impacts after which the search ends with what it has.
const EFFORT: u32 = 260_000;

/// The runs that tell the share at the chosen k: parts that had no say in the choice.
const TOLD: Round = Round {
    runs: 20,
    periods: 1600,
    kept: 1,
    about: false,
};

/// The search for the k at which parts of a lot are in gear for the largest share of time, from rest and without a kick.
///
/// Each k is tried with parts of the whole lot whose restitution scatters, the same parts for every k (common random
/// numbers), and the better third goes on to longer trials. Everything is integers and f32 without fused operations: the
/// same bits at the desk, in the emulator and on the board.
///
/// ```
/// use kband::feeder::Restitution;
/// use kband::regime::gear::{GearPlanSettings, GearPlanner};
/// let mut planner = GearPlanner::new(GearPlanSettings {
///     restitution: Restitution::single(0.3)?,
///     scatter: 0.05,
///     order: 1,
///     k: [0.28, 0.6],
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
    /// Which round is under way; past the last one the share is told, and then all is done.
    round: usize,
    /// The candidate and the run of it that are under way.
    candidate: usize,
    run: u16,
    rider: Option<(OneTone, Rider)>,
    gear: Gear<i64>,
    plan: Option<GearPlan>,
    impacts: u32,
}

impl GearPlanner {
    /// The search; the refusal names the parameter.
    pub fn new(settings: GearPlanSettings) -> Result<Self, OutOfRange> {
        let [low, high] = settings.k;
        accept(
            "scatter",
            f64::from(settings.scatter),
            (0.0..=0.3).contains(&settings.scatter),
            "0..0.3",
        )?;
        accept(
            "k",
            f64::from(low),
            0.005 <= low && low <= high && high <= 4.0,
            "0.005..4, the lowest first",
        )?;
        let step = (high - low) / (CANDIDATES - 1) as f32;
        Ok(Self {
            settings,
            candidates: (0..CANDIDATES as u8)
                .map(|n| Candidate::at(low + step * f32::from(n)))
                .collect(),
            round: 0,
            candidate: 0,
            run: 0,
            rider: None,
            gear: Gear::in_steps(settings.order)?,
            plan: None,
            impacts: 0,
        })
    }

    /// What was found so far; `None` before the first round is over.
    #[must_use]
    pub fn plan(&self) -> Option<&GearPlan> {
        self.plan.as_ref()
    }

    /// Impacts computed so far.
    #[must_use]
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

    fn now(&self) -> Round {
        ROUNDS.get(self.round).copied().unwrap_or(TOLD)
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
        if self.impacts >= EFFORT {
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
        match OneTone::at(candidate.k) {
            Some(surface) => self.rider = Some((surface, Rider::new(draw, self.gear, span))),
            None => self.take(0.0),
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
        let best = self.candidates.first();
        let share = best.map_or(0.0, Candidate::share);
        self.plan = self.plan.map(|plan| GearPlan {
            share: if share > 0.0 { share } else { plan.share },
            settled: true,
            ..plan
        });
    }

    fn end_round(&mut self) {
        let round = self.now();
        let told = self.round >= ROUNDS.len();
        self.round += 1;
        self.candidate = 0;
        // Stable, without allocation.
        for end in (1..self.candidates.len()).rev() {
            for rank in 0..end {
                if let Some([first, second]) = self.candidates.get_mut(rank..rank + 2)
                    && second.share() > first.share()
                {
                    core::mem::swap(first, second);
                }
            }
        }
        self.candidates.truncate(round.kept);
        let Some(best) = self.candidates.first_mut() else {
            return;
        };
        self.plan = Some(GearPlan {
            k: best.k,
            share: best.share(),
            settled: told,
        });
        let best_k = best.k;
        if self.round == ROUNDS.len() {
            // What it has won with does not count.
            *best = Candidate::at(best_k);
        }
        if round.about {
            let [low, high] = self.settings.k;
            let third = (high - low) / (3 * (CANDIDATES - 1)) as f32;
            for away in [-2.0, -1.0, 1.0, 2.0] {
                let k = best_k + third * away;
                if (low..=high).contains(&k) {
                    let _ = self.candidates.push(Candidate::at(k));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Scatter, Wave, WaveMap};
    use crate::regime::band;
    use crate::regime::gear::{Share, shares_from_rest};

    /// The share in f64, by other draws, over 20 parts of 2000 periods.
    fn truth(k: f32, lot: Restitution, scatter: f32) -> f64 {
        let map = WaveMap::on(Wave::sine(), f64::from(k), lot.middle()).unwrap();
        let part = |n: u64| {
            let mean = lot.low() + (lot.high() - lot.low()) * (n as f64 + 0.5) / 20.0;
            Scatter::build(mean, f64::from(scatter), n + 1000).unwrap()
        };
        let parts: [Scatter; 20] = core::array::from_fn(|n| part(n as u64));
        let mut sum = Share::default();
        shares_from_rest(&map, &parts, 1, 2000.0, |_, share| sum = sum.and(&share)).unwrap();
        sum.share()
    }

    fn plan(lot: Restitution, scatter: f32) -> GearPlanner {
        let born = band::birth(lot.high(), 1).unwrap();
        let mut planner = GearPlanner::new(GearPlanSettings {
            restitution: lot,
            scatter,
            order: 1,
            k: [0.28, (1.02 * born).min(0.98) as f32],
        })
        .unwrap();
        while planner.advance(1000) {}
        planner
    }

    /// What a grid of 60 values of k and 40 parts of 3000 periods each found at best; the share told is that of 20 parts
    /// of 1200 periods, in which gear is lost some 20 times a part where the share is 0.4: it errs by 0.02.
    #[test]
    fn the_share_at_the_chosen_k_is_that_of_a_fine_grid_and_is_told() {
        for (low, high, scatter, best) in [
            (0.2, 0.2, 0.05, 0.955),
            (0.3, 0.3, 0.05, 0.840),
            (0.5, 0.5, 0.05, 0.398),
            (0.3, 0.3, 0.1, 0.455),
            (0.1, 0.3, 0.03, 0.912),
        ] {
            let lot = Restitution::interval(low, high).unwrap();
            let planner = plan(lot, scatter);
            let plan = planner.plan().unwrap();
            let truth = truth(plan.k, lot, scatter);
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
        let whole = plan(lot, 0.05);
        let mut sliced = GearPlanner::new(whole.settings).unwrap();
        while sliced.advance(7) {}
        assert_eq!(
            (sliced.plan(), sliced.impacts()),
            (whole.plan(), whole.impacts())
        );
        assert!(whole.impacts() <= EFFORT);
    }

    #[test]
    fn what_cannot_be_planned_is_refused() {
        let settings = GearPlanSettings {
            restitution: Restitution::single(0.2).unwrap(),
            scatter: 0.05,
            order: 1,
            k: [0.3, 0.4],
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
