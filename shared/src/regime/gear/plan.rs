//! Search for the k and the upper tones at which a lot is in gear for the largest share of time.
//!
//! The method is the response surface method (Box and Wilson, J. R. Stat. Soc. B 13 (1951) 1;
//! docs/theory-real-parts.md#t10.8). Its objective is the share of time in gear, estimated by
//! simulated runs. Impacts and memory are bounded, so the search runs on the board.

use core::f32::consts::{FRAC_PI_2, PI};

use heapless::Vec;

use super::Gear;
use super::draw::Draw;
use super::fit::{Fit, FittedShare};
use super::limits::GearLimits;
use super::rider::{Rider, Span, Surface, Tones};
use crate::feeder::{OutOfRange, Restitution, accept};

/// Inputs of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearPlanSettings {
    /// Mean restitution of the parts of the lot.
    pub restitution: Restitution,
    /// Standard deviation of the restitution from impact to impact (symbol s), 0..=0.3.
    pub scatter: f32,
    /// Largest relative error of the amplitude, 0..=0.2.
    pub amplitude_error: f32,
    /// Drive periods in a flight (symbol r), 1..=100.
    pub order: u32,
    /// Lowest and highest k that may be chosen, 0.005..=4.
    pub k: [f32; 2],
    /// Largest amplitudes of the second and third tone (symbols e, e3) over the first, 0..=0.5. A
    /// value below 0.01 excludes the tone; without a second tone there is no third.
    pub most: [f32; 2],
    /// Limits of the drive.
    pub limits: GearLimits,
}

/// Result of the search so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearPlan {
    /// The k with the largest share of time in gear.
    pub k: f32,
    /// Amplitude over the first tone (symbol e) and angle in rad (symbol th) of the second and
    /// third tone; 0 and 0 without one.
    pub tones: Tones,
    /// Predicted share of time in gear at this k and these tones, mean over the lot, 0..=1.
    pub share: f32,
    /// Whether the search has ended.
    pub settled: bool,
}

/// Largest number of candidates of the first round.
const CANDIDATES: usize = 36;

/// A grid point of the first round; its index gives k and tones.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// Factor on the tones' amplitudes at which the drive's limits hold, 0..=1.
    afforded: f32,
    /// Sum of the shares in gear of its runs, and the number of runs.
    sum: f32,
    runs: u16,
}

/// A point of the search: k, and amplitude over the first (symbol e) and angle (symbol th, rad) of
/// two upper tones.
#[derive(Clone, Copy, Debug)]
struct Place {
    k: f32,
    tones: Tones,
}

/// Runs of a candidate of the first round, with one, two and three tones. A candidate with share 0
/// after two runs gets no third.
const RUNS: [u16; 3] = [5, 3, 3];

/// Drive periods of a run and of its discarded transient, in the first round and in the later
/// regions.
const PERIODS: [[u16; 2]; 2] = [[130, 25], [300, 30]];

/// Cumulative share of [`EFFORT`] at which each stage ends, with one, two and three tones. The
/// stages are first round, regions and verification.
const UNTIL: [&[f32]; 3] = [
    &[0.38, 0.57, 0.82, 0.97],
    &[0.38, 0.57, 0.82, 0.97],
    &[0.36, 0.52, 0.68, 0.87, 0.97],
];

/// Cumulative share of [`EFFORT`] at which a stage beyond the lists ends; the rest completes the
/// run in progress.
const LAST: f32 = 0.97;

/// Predicted share in gear from which the scatter of the simulated parts is multiplied by
/// [`STRAIN`]. Above it places differ by less than the error of the fit; more scatter separates
/// them.
const ENOUGH: f32 = 0.985;
const STRAIN: f32 = 1.5;

/// Weight of a verification run over a selection run in the predicted share. Selection runs are
/// biased upwards, because they chose the place (winner's curse).
const CHOSE: f32 = 6.0;

/// Half-widths of the first region: in k in candidate spacings, in e over the largest tried, in th
/// in rad. The next region is [`NARROWER`] times as wide. The last region of a search with three
/// tones uses [`HALF_OF_THIRD`].
const HALF: [f32; 3] = [1.3, 0.25, 0.2];
const HALF_OF_THIRD: [f32; 3] = [0.7, 0.6, 0.6];
const NARROWER: f32 = 0.75;

/// Grid points in k of the first round: with one tone, and in each row with two or three.
const STEPS: usize = 20;
const STEPS_OF_TWO: usize = 12;

/// Upper tones of the rows of the first round: e over the largest tried, th in rad. For order 1 the
/// best of 32 angles lay between these for each lot tried (docs/theory-real-parts.md#t10.2). From
/// order 3 on [`ROUND`] spans the circle.
const ROWS: [Tones; 3] = [[[1.0, 2.4], NONE], [[1.0, 2.65], NONE], [[0.7, 2.5], NONE]];
const ROUND: [Tones; 3] = [
    [[1.0, FRAC_PI_2], NONE],
    [[1.0, PI], NONE],
    [[1.0, 2.4], NONE],
];
/// Rows for order 2, with amplitudes larger by [`MORE_OF_ORDER_TWO`]. A dense search found its best
/// angles at 2.88 to 3.14 rad.
const ROWS_OF_ORDER_TWO: [Tones; 3] =
    [[[1.0, 2.75], NONE], [[1.0, 3.0], NONE], [[0.75, 2.9], NONE]];
const MORE_OF_ORDER_TWO: f32 = 1.3;
const NONE: [f32; 2] = [0.0; 2];
/// Rows with a third tone, at the angle th3 = [`THIRD`] rad. A random search over some thousand
/// shapes found its best there (docs/theory-real-parts.md#t10.3).
const ROWS_OF_THREE: [Tones; 3] = [
    [[1.0, 2.6], [1.0, THIRD]],
    [[0.8, 2.6], [0.5, THIRD]],
    [[0.8, 2.6], [0.0, THIRD]],
];
const THIRD: f32 = 5.3;

/// Largest second tone tried over the first, as LEAST_TRIED + TRIED R at mean restitution R. The
/// best for order 1 lay between 0.13 at R = 0.15 and 0.25 at R = 0.6, for scatter of 0.03 to 0.15.
///
/// With a third tone the slope is [`TRIED_OF_THREE`]. The third tone is at most [`MOST_OF_THIRD`],
/// the bound of the random search.
const LEAST_TRIED: f32 = 0.08;
const TRIED: f32 = 0.3;
const TRIED_OF_THREE: f32 = 0.4;
const MOST_OF_THIRD: f32 = 0.07;

/// Grid points at which the fitted share is evaluated: in each of e and th, and in k.
const LOOKED: u8 = 5;
const LOOKED_K: u8 = 17;

/// Penalty on the share per squared normalized distance from the region's centre. It breaks ties
/// where the share saturates at 1.
const AWAY: f32 = 0.03;

/// Amplitude over the first below which a tone counts as absent.
const LEAST: f32 = 0.01;

/// Largest number of impacts of a search with one, two and three tones. It bounds the search to 84
/// million instructions on a Cortex-M4F, at 416 to 452 an impact of one tone and 708 of two.
const EFFORT: [u32; 3] = [170_000, 101_000, 115_000];

/// Cost, in impacts, of the peak search of upper tones and of the set-up of a run.
const PEAKS: u32 = 8;
const SET_UP: u32 = 30;

/// Stage of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// Runs on the grid over the whole range of k.
    Wide,
    /// Runs in the region about the best point.
    Near,
    /// Maximization of the fitted share on a grid; holds the next row.
    Choice(u8),
    /// Verification runs at the chosen point.
    Verdict,
}

/// Results of the runs of the current stage.
#[derive(Clone, Debug)]
enum Tried {
    Candidates(Vec<Candidate, CANDIDATES>),
    Fit(Fit),
    Share(FittedShare),
}

/// A box of the search space in k and in amplitude and angle of one upper tone.
#[derive(Clone, Copy, Debug)]
struct Region {
    centre: Place,
    half: [f32; 3],
    /// Whether the third tone varies instead of the second.
    of_third: bool,
}

impl Region {
    /// The three coordinates that vary.
    fn varied(&self, place: Place) -> [f32; 3] {
        let [second, third] = place.tones;
        let [ratio, angle] = if self.of_third { third } else { second };
        [place.k, ratio, angle]
    }

    /// The point with these three coordinates; the other tone is the centre's.
    fn place(&self, [k, ratio, angle]: [f32; 3]) -> Place {
        let [second, third] = self.centre.tones;
        let varied = [ratio, angle];
        Place {
            k,
            tones: if self.of_third {
                [second, varied]
            } else {
                [varied, third]
            },
        }
    }

    /// Coordinates normalized to -1..1 within the region.
    fn inside(&self, place: Place) -> [f32; 3] {
        let ([k, ratio, angle], centre) = (self.varied(place), self.varied(self.centre));
        // An amplitude below 0 is the same tone with its angle turned by half a turn.
        let place = if self.of_third && angle < centre[2] - FRAC_PI_2 {
            [k, -ratio, angle + PI]
        } else {
            [k, ratio, angle]
        };
        core::array::from_fn(|n| {
            if self.half[n] > 0.0 {
                (place[n] - centre[n]) / self.half[n]
            } else {
                0.0
            }
        })
    }
}

/// Searches k and upper tones for the largest share of time in gear, for parts that start at rest
/// without a kick.
///
/// 1. Grid search: a few short runs at each candidate over the whole range.
/// 2. Response surface: runs at low-discrepancy points of a region about the best, and a polynomial
///    [fitted](Fit) to their shares. The next region is narrower, about the maximum of the fit.
/// 3. Verification runs at the chosen point estimate its share.
///
/// Each run draws a part of the lot and an error of the amplitude. Integers and unfused f32 give
/// the same bits at the desk, in the emulator and on the board.
#[derive(Clone, Debug)]
pub struct GearPlanner {
    settings: GearPlanSettings,
    tried: Tried,
    /// Number of upper tones searched, 0..=2.
    upper: usize,
    /// Lowest candidate and spacing in k, and largest second and third tone tried.
    low: f32,
    step: f32,
    most: [f32; 2],
    stage: Stage,
    /// Number of regions begun, and the current region.
    regions: usize,
    region: Region,
    /// Index of the current candidate, and the round of runs.
    candidate: usize,
    round: u16,
    /// Number of runs begun.
    runs: u32,
    rider: Option<(Surface, Rider, Run)>,
    gear: Gear<i64>,
    best: Option<(f32, Place)>,
    /// Factor on the lot's scatter in the simulated runs.
    strain: f32,
    /// Sum of the shares of the runs that estimate the result, and their weight; while a region is
    /// searched, its number of runs.
    told: [f32; 2],
    plan: Option<GearPlan>,
    impacts: u32,
}

/// A run in progress: the normalized restitution of its part within the lot, -1..1, and its
/// normalized point in the region. `None` for a lot of one restitution.
#[derive(Clone, Copy, Debug)]
struct Run {
    lot: Option<f32>,
    inside: [f32; 3],
}

impl GearPlanner {
    /// Begins a search; an error names the parameter out of range.
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
            "amplitude_error",
            settings.amplitude_error,
            (0.0..=0.2).contains(&settings.amplitude_error),
            "0..0.2",
        )?;
        within(
            "k",
            low,
            0.005 <= low && low <= high && high <= 4.0,
            "0.005..4, the lowest first",
        )?;
        for (name, most) in ["second tone", "third tone"].into_iter().zip(settings.most) {
            within(
                name,
                most,
                (0.0..=0.5).contains(&most),
                "0..0.5 of the first",
            )?;
        }
        let [second, third] = settings.most;
        let upper = match (second >= LEAST, third >= LEAST) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) => 2,
        };
        let middle = settings.restitution.middle() as f32;
        let tried = if upper > 1 { TRIED_OF_THREE } else { TRIED };
        let mut tried = LEAST_TRIED + tried * middle;
        let (steps, [low, high]) = if upper > 0 && settings.order <= 2 {
            let mut best = 0.28 + (0.15 + 0.95 * middle) * middle;
            if settings.order == 2 {
                best *= 0.5;
                tried *= MORE_OF_ORDER_TWO;
            }
            let within = [low.max(0.75 * best), high.min(1.3 * best)];
            let range = if within[0] < within[1] {
                within
            } else {
                settings.k
            };
            (STEPS_OF_TWO, range)
        } else if upper > 0 {
            (STEPS_OF_TWO, settings.k)
        } else {
            (STEPS, settings.k)
        };
        let step = (high - low) / (steps - 1) as f32;
        let most = match upper {
            0 => [0.0; 2],
            1 => [second.min(tried), 0.0],
            _ => [second.min(tried), third.min(MOST_OF_THIRD)],
        };
        Ok(Self {
            settings,
            tried: Tried::Candidates(Vec::new()),
            upper,
            low,
            step,
            most,
            stage: Stage::Wide,
            regions: 0,
            region: Region {
                centre: Place {
                    k: low,
                    tones: [NONE; 2],
                },
                half: [0.0; 3],
                of_third: false,
            },
            candidate: 0,
            round: 0,
            runs: 0,
            rider: None,
            gear: Gear::in_steps(settings.order)?,
            best: None,
            strain: 1.0,
            told: [0.0; 2],
            plan: None,
            impacts: 0,
        })
    }

    /// Largest factor on the tones' amplitudes at which the drive's limits hold; 0 if none does.
    fn afforded(&mut self, place: Place) -> f32 {
        for part in [1.0, 0.85, 0.7, 0.55, 0.4, 0.2] {
            let tones = scaled(place.tones, part);
            let [[ratio, _], _] = tones;
            if ratio < LEAST {
                break;
            }
            self.impacts += PEAKS;
            if self.settings.limits.afford(place.k, tones) {
                return part;
            }
        }
        0.0
    }

    /// Inputs of the search.
    #[must_use]
    pub fn settings(&self) -> &GearPlanSettings {
        &self.settings
    }

    /// Result so far; `None` before the first round ends.
    #[must_use]
    pub fn plan(&self) -> Option<&GearPlan> {
        self.plan.as_ref()
    }

    /// Work done so far, in impacts.
    #[must_use]
    #[cfg(test)]
    pub fn impacts(&self) -> u32 {
        self.impacts
    }

    /// Works for about this number of impacts and returns whether the search continues.
    pub fn advance(&mut self, impacts: u32) -> bool {
        let until = self.impacts.saturating_add(impacts);
        while self.impacts < until && !self.is_over() {
            self.step();
        }
        !self.is_over()
    }

    fn is_over(&self) -> bool {
        self.plan.is_some_and(|plan| plan.settled)
    }

    /// Selects the entry for the number of upper tones.
    fn of<T: Copy>(&self, [one, two, three]: [T; 3]) -> T {
        match self.upper {
            0 => one,
            1 => two,
            _ => three,
        }
    }

    /// Work done over [`EFFORT`].
    fn spent(&self) -> f32 {
        self.impacts as f32 / self.of(EFFORT) as f32
    }

    /// Computes one impact of the current run, or begins the next run or stage.
    fn step(&mut self) {
        self.impacts += 1;
        if let Some((surface, rider, run)) = &mut self.rider {
            if rider.step(surface) {
                let (share, run) = (rider.share(), *run);
                self.rider = None;
                self.take(share, &run);
            } else if self.impacts >= self.of(EFFORT) {
                self.rider = None;
            }
            return;
        }
        let until = self.of(UNTIL).get(self.regions).copied();
        if self.spent() >= until.unwrap_or(LAST) && !matches!(self.stage, Stage::Choice(_)) {
            self.end_stage();
            return;
        }
        match self.stage {
            Stage::Wide => self.try_candidate(),
            Stage::Near => self.try_about(),
            Stage::Choice(row) => self.look(row),
            Stage::Verdict => self.try_chosen(),
        }
    }

    fn steps(&self) -> usize {
        if self.upper > 0 { STEPS_OF_TWO } else { STEPS }
    }

    fn rows(&self) -> &'static [Tones] {
        match (self.upper, self.settings.order) {
            (0, _) => &[[NONE; 2]],
            (1, 1) => &ROWS,
            (_, 1) => &ROWS_OF_THREE,
            (_, 2) => &ROWS_OF_ORDER_TWO,
            _ => &ROUND,
        }
    }

    /// Upper tones of a candidate's row; none beyond the last row.
    fn row(&self, number: usize) -> Tones {
        let row = self.rows().get(number / self.steps());
        row.copied().unwrap_or_default()
    }

    /// Point of a candidate, its tones' amplitudes multiplied by `part`.
    fn place(&self, number: usize, part: f32) -> Place {
        let [second, third] = self.row(number);
        let [of_second, of_third] = self.most;
        let tones = [
            [second[0] * of_second, second[1]],
            [third[0] * of_third, third[1]],
        ];
        let k = self.low + self.step * (number % self.steps()) as f32;
        Place {
            k: k.min(self.settings.k[1]),
            tones: scaled(tones, part),
        }
    }

    /// Begins the next run of the first round.
    fn try_candidate(&mut self) {
        let number = self.candidate;
        if number >= self.steps() * self.rows().len() {
            self.candidate = 0;
            self.round += 1;
            if self.round >= self.of(RUNS) {
                self.end_stage();
            }
            return;
        }
        let tried = |tried: &Tried| match tried {
            Tried::Candidates(candidates) => candidates.get(number).copied(),
            _ => None,
        };
        if tried(&self.tried).is_none() {
            let afforded = self.afforded(self.place(number, 1.0));
            let candidate = Candidate {
                afforded,
                sum: 0.0,
                runs: 0,
            };
            if let Tried::Candidates(candidates) = &mut self.tried {
                // CANDIDATES is the largest product of steps and rows.
                let _ = candidates.push(candidate);
            }
        }
        let Some(candidate) = tried(&self.tried) else {
            self.end_stage();
            return;
        };
        if candidate.runs >= 2 && candidate.sum == 0.0 {
            self.candidate += 1;
            return;
        }
        self.begin_run(
            self.place(number, candidate.afforded),
            u32::from(self.round),
        );
    }

    /// Begins a run at the next low-discrepancy point of the region.
    fn try_about(&mut self) {
        // R3 sequence, the additive recurrence of M. Roberts (2018), in units of 2^-32.
        const STEP: [u32; 3] = [0xD1B5_4A33, 0xABC9_8388, 0x8CB9_2BA7];
        let run = self.runs;
        let (centre, half) = (self.region.varied(self.region.centre), self.region.half);
        let varied = core::array::from_fn(|n| {
            centre[n] + half[n] * (2.0 * part(run.wrapping_mul(STEP[n])) - 1.0)
        });
        let place = self.within(self.region.place(varied));
        self.begin_run(place, run);
    }

    /// Begins a verification run at the chosen point.
    fn try_chosen(&mut self) {
        if let Some(plan) = self.plan {
            self.begin_run(plan.place(), self.runs);
        }
    }

    /// Clamps a point to the configured ranges and to the drive's limits.
    fn within(&mut self, Place { k, tones }: Place) -> Place {
        let [low, high] = self.settings.k;
        let k = k.max(low).min(high);
        if self.upper == 0 {
            return Place {
                k,
                tones: [NONE; 2],
            };
        }
        let ([second, third], most) = (tones, self.settings.most);
        let tone = |[ratio, angle]: [f32; 2], most: f32| [ratio.max(0.0).min(most), angle];
        // A third tone below 0 is one turned by half a turn.
        let tones = [tone(second, most[0]), tone(upright(third), most[1])];
        let afforded = self.afforded(Place { k, tones });
        Place {
            k,
            tones: scaled(tones, afforded),
        }
    }

    /// Begins a run; its number gives restitution and amplitude error by the R2 sequence (M.
    /// Roberts 2018). Any number of runs covers lot and errors evenly.
    fn begin_run(&mut self, place: Place, number: u32) {
        self.runs += 1;
        self.impacts += SET_UP;
        let lot = 2.0 * part(number.wrapping_mul(0xC13F_A9A9).wrapping_add(1 << 31)) - 1.0;
        let error = 2.0 * part(number.wrapping_mul(0x91E1_0DA5).wrapping_add(1 << 31)) - 1.0;
        let (low, high) = (
            self.settings.restitution.low() as f32,
            self.settings.restitution.high() as f32,
        );
        let mean = low + (high - low) * (0.5 + 0.5 * lot);
        let seed = (self.regions as u32) << 24 ^ self.runs;
        let k = place.k * (1.0 + self.settings.amplitude_error * error);
        let [first, later] = PERIODS;
        let [periods, before] = if self.regions == 0 { first } else { later };
        let run = Run {
            lot: (high > low).then_some(lot),
            inside: self.region.inside(Place { k, ..place }),
        };
        match Surface::at(k, place.tones) {
            Ok(surface) => {
                let strain = if self.stage == Stage::Verdict {
                    1.0
                } else {
                    self.strain
                };
                let draw = Draw::new(mean, self.settings.scatter * strain, seed);
                let rider = Rider::new(draw, self.gear, Span::periods(periods, before));
                self.rider = Some((surface, rider, run));
            }
            Err(_) => self.take(0.0, &run),
        }
    }

    /// Records the share in gear of the run that ended.
    fn take(&mut self, share: f32, run: &Run) {
        match &mut self.tried {
            Tried::Candidates(candidates) => {
                if let Some(candidate) = candidates.get_mut(self.candidate) {
                    candidate.sum += share;
                    candidate.runs += 1;
                }
                self.candidate += 1;
            }
            Tried::Fit(fit) => {
                self.told[1] += 1.0;
                fit.take(run.inside, run.lot, share);
            }
            Tried::Share(_) => {
                self.told[0] += share;
                self.told[1] += 1.0;
            }
        }
    }

    /// Evaluates the runs of a stage and begins the next stage.
    fn end_stage(&mut self) {
        match self.stage {
            Stage::Wide => {
                let best = self.best_candidate();
                self.settle_for(best);
                let half = [HALF[0] * self.step, HALF[1] * self.most[0], HALF[2]];
                self.look_about(best.1, half, false);
            }
            Stage::Near => {
                if let Tried::Fit(fit) = &self.tried {
                    self.tried = Tried::Share(fit.solve());
                }
                self.best = None;
                self.stage = Stage::Choice(0);
            }
            Stage::Choice(_) => {}
            Stage::Verdict => {
                if let Some(plan) = &mut self.plan {
                    plan.settled = true;
                    let [sum, runs] = self.told;
                    if runs > 0.0 {
                        plan.share = sum / runs;
                    }
                }
            }
        }
    }

    /// Begins a region.
    fn look_about(&mut self, centre: Place, half: [f32; 3], of_third: bool) {
        let half = if self.upper > 0 {
            half
        } else {
            [half[0], 0.0, 0.0]
        };
        self.regions += 1;
        self.region = Region {
            centre,
            half,
            of_third,
        };
        self.tried = Tried::Fit(Fit::EMPTY);
        self.told = [0.0; 2];
        self.stage = Stage::Near;
    }

    /// The candidate with the largest share, smoothed over k with weights 1/4, 1/2, 1/4. Smoothing
    /// prefers the middle of a range in which no run left gear. If all shares are 0, it is the
    /// middle of the range of k without tones.
    fn best_candidate(&self) -> (f32, Place) {
        let share = |candidate: &Candidate| {
            if candidate.runs == 0 {
                0.0
            } else {
                candidate.sum / f32::from(candidate.runs)
            }
        };
        let middle = 0.5 * (self.settings.k[0] + self.settings.k[1]);
        let nowhere = Place {
            k: middle,
            tones: [NONE; 2],
        };
        let mut best = (0.0, nowhere);
        let candidates = match &self.tried {
            Tried::Candidates(candidates) => candidates.as_slice(),
            _ => &[],
        };
        for (first, row) in candidates.chunks(self.steps()).enumerate() {
            for (n, here) in row.iter().enumerate() {
                let before = n.checked_sub(1).and_then(|n| row.get(n));
                let beside = before.map_or(0.0, share) + row.get(n + 1).map_or(0.0, share);
                let mean = 0.25 * beside + 0.5 * share(here);
                if mean > best.0 {
                    best = (mean, self.place(first * self.steps() + n, here.afforded));
                }
            }
        }
        best
    }

    /// Evaluates the fitted share at one row of the grid, for each k, and keeps the best point.
    fn look(&mut self, row: u8) {
        let rows = if self.upper > 0 { LOOKED * LOOKED } else { 1 };
        if row >= rows {
            self.end_choice();
            return;
        }
        let (centre, half) = (self.region.varied(self.region.centre), self.region.half);
        let Tried::Share(shape) = self.tried else {
            self.end_choice();
            return;
        };
        let at = |n: u8, all: u8| {
            if all > 1 {
                2.0 * f32::from(n) / f32::from(all - 1) - 1.0
            } else {
                0.0
            }
        };
        let (y, z) = if self.upper > 0 {
            (at(row % LOOKED, LOOKED), at(row / LOOKED, LOOKED))
        } else {
            (0.0, 0.0)
        };
        let (ratio, angle) = (centre[1] + half[1] * y, centre[2] + half[2] * z);
        let ratio = match (self.region.of_third, ratio) {
            (false, ratio) if ratio < LEAST => 0.0,
            (true, ratio) if ratio.abs() < LEAST => 0.0,
            _ => ratio,
        };
        let mut least = self.settings.k[0];
        let [second, third] = self.region.place([0.0, ratio, angle]).tones;
        let tones = [second, upright(third)];
        let [second, _] = second;
        if second > 0.0 {
            self.impacts += PEAKS;
            least = least.max(self.settings.limits.least(tones));
        }
        let [of_second, of_third] = self.settings.most;
        let most = if self.region.of_third {
            of_third
        } else {
            of_second
        };
        let error = self.error();
        for n in 0..LOOKED_K {
            let x = at(n, LOOKED_K);
            let k = centre[0] + half[0] * x;
            let inside = [x, y, z];
            let away = AWAY * inside.iter().map(|x| x * x).sum::<f32>();
            let share = shape.at(inside, error).min(1.0);
            let weighed = share - away;
            if inside.iter().map(|x| x * x).sum::<f32>() <= 1.0
                && k >= least
                && k <= self.settings.k[1]
                && ratio.abs() <= most
                && self.best.is_none_or(|(best, _)| weighed > best)
            {
                self.best = Some((weighed, Place { k, tones }));
            }
        }
        self.stage = Stage::Choice(row + 1);
    }

    fn end_choice(&mut self) {
        if let Some((_, place)) = self.best.take() {
            self.settle_for((self.fitted(place), place));
        }
        // If no point meets the drive's limits, the former plan remains.
        let Some(plan) = self.plan else {
            return;
        };
        let left = self.of(UNTIL).len().saturating_sub(self.regions);
        if left > 2 {
            let of_third = self.upper > 1 && left == 3;
            let half = if of_third {
                let [k, _, _] = self.region.half;
                [
                    HALF_OF_THIRD[0] * k,
                    HALF_OF_THIRD[1] * self.most[1],
                    HALF_OF_THIRD[2],
                ]
            } else {
                self.region.half.map(|half| half * NARROWER)
            };
            let mut centre = plan.place();
            let [_, third] = &mut centre.tones;
            if of_third && third[0] == 0.0 {
                third[1] = THIRD;
            }
            self.look_about(centre, half, of_third);
        } else {
            self.regions += 1;
            self.stage = Stage::Verdict;
            let [_, chose] = self.told;
            let runs = if self.strain == 1.0 {
                chose / CHOSE
            } else {
                0.0
            };
            self.told = [runs * plan.share, runs];
        }
    }

    /// Fitted share at a point; 0 before the fit is solved.
    fn fitted(&self, place: Place) -> f32 {
        match &self.tried {
            Tried::Share(shape) => shape.at(self.region.inside(place), self.error()),
            _ => 0.0,
        }
    }

    /// Error of k from the error of the amplitude, in the region's normalized coordinate.
    fn error(&self) -> f32 {
        let Region { centre, half, .. } = &self.region;
        if half[0] > 0.0 {
            self.settings.amplitude_error * centre.k / half[0]
        } else {
            0.0
        }
    }

    fn settle_for(&mut self, (share, Place { k, tones }): (f32, Place)) {
        let share = share.clamp(0.0, 1.0);
        if share >= ENOUGH {
            self.strain *= STRAIN;
        }
        self.plan = Some(GearPlan {
            k,
            tones: match tones {
                [[second, _], _] if second < LEAST => [NONE; 2],
                [second, [third, _]] if third < LEAST => [second, NONE],
                _ => tones,
            },
            share,
            settled: false,
        });
    }
}

impl GearPlan {
    fn place(&self) -> Place {
        Place {
            k: self.k,
            tones: self.tones,
        }
    }
}

/// The same tone with an amplitude of at least 0.
fn upright([ratio, angle]: [f32; 2]) -> [f32; 2] {
    if ratio < 0.0 {
        [-ratio, angle - PI]
    } else {
        [ratio, angle]
    }
}

/// Tones with their amplitudes multiplied by `part`.
fn scaled(tones: Tones, part: f32) -> Tones {
    tones.map(|[ratio, angle]| [ratio * part, angle])
}

/// A uniform number in 0..1 from the upper 24 of 32 bits.
fn part(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Scatter, Tone, Wave, WaveMap};
    use crate::regime::band;
    use crate::regime::gear::{Share, shares_from_rest};

    /// Share in f64 from other random draws, over 20 parts of 2000 periods.
    fn truth(plan: &GearPlan, lot: Restitution, scatter: f32) -> f64 {
        truth_of(1, plan, lot, scatter)
    }

    fn truth_of(order: u32, plan: &GearPlan, lot: Restitution, scatter: f32) -> f64 {
        let [second, third] = plan.tones.map(|[amplitude, angle]| Tone {
            amplitude: f64::from(amplitude),
            angle: f64::from(angle),
        });
        let wave = Wave::build(second, third).unwrap();
        let map = WaveMap::on(wave, f64::from(plan.k), lot.middle()).unwrap();
        let part = |n: u64| {
            let mean = lot.low() + (lot.high() - lot.low()) * (n as f64 + 0.5) / 20.0;
            Scatter::build(mean, f64::from(scatter), n + 1000).unwrap()
        };
        let parts: [Scatter; 20] = core::array::from_fn(|n| part(n as u64));
        let mut sum = Share::default();
        shares_from_rest(&map, &parts, order, 2000.0, |_, share| {
            sum = sum.and(&share)
        })
        .unwrap();
        sum.share()
    }

    fn plan(lot: Restitution, scatter: f32, most: [f32; 2]) -> GearPlanner {
        let mut planner = plan_of(lot, scatter, most);
        while planner.advance(1000) {}
        planner
    }

    fn plan_of(lot: Restitution, scatter: f32, most: [f32; 2]) -> GearPlanner {
        let born = band::birth(lot.high(), 1).unwrap();
        GearPlanner::new(GearPlanSettings {
            restitution: lot,
            scatter,
            amplitude_error: 0.02,
            order: 1,
            k: [0.28, (1.02 * born).min(0.98) as f32],
            most,
            limits: GearLimits::NONE,
        })
        .unwrap()
    }

    /// Reference shares: the best over 60 values of k, with 40 parts of 3000 periods each, or over
    /// a random search, in f64. At a share of 0.4 plan and reference each have an error of 0.01.
    #[test]
    fn the_share_at_the_chosen_k_is_that_of_a_fine_grid_and_is_told() {
        for (low, high, scatter, second_tone, best) in [
            (0.2, 0.2, 0.05, 0.0, 0.955),
            (0.3, 0.3, 0.05, 0.0, 0.838),
            (0.5, 0.5, 0.05, 0.0, 0.390),
            (0.3, 0.3, 0.1, 0.0, 0.455),
            (0.1, 0.3, 0.03, 0.0, 0.912),
            (0.2, 0.2, 0.05, 0.15, 1.0),
            (0.5, 0.5, 0.05, 0.15, 1.0),
            (0.3, 0.3, 0.1, 0.15, 0.952),
            (0.3, 0.3, 0.1, 0.25, 0.961),
            (0.5, 0.5, 0.1, 0.25, 0.944),
            (0.1, 0.3, 0.03, 0.15, 1.0),
            (0.4, 0.4, 0.05, 0.0, 0.657),
            (0.2, 0.2, 0.15, 0.15, 0.522),
            (0.1, 0.4, 0.03, 0.0, 0.673),
        ] {
            let lot = Restitution::interval(low, high).unwrap();
            let planner = plan(lot, scatter, [second_tone, 0.0]);
            let plan = planner.plan().unwrap();
            let truth = truth(plan, lot, scatter);
            assert!(
                plan.settled && truth > best - 0.03,
                "{low} {scatter}: {truth} {plan:?}"
            );
            assert!(
                (f64::from(plan.share) - truth).abs() < 0.04,
                "{low} {scatter}: {truth} {plan:?}"
            );
        }
    }

    /// Best shares of a random search over some thousand shapes of two and of three tones, at the
    /// same peak acceleration (docs/theory-real-parts.md#t10.3).
    #[test]
    fn a_third_tone_buys_what_a_random_search_says() {
        for (restitution, scatter, peak, two, three) in [
            (0.5, 0.10, 5.0, 0.947, 0.987),
            (0.5, 0.15, 5.0, 0.65, 0.77),
            (0.3, 0.10, 3.23, 0.87, 0.937),
            (0.3, 0.10, 5.0, 0.960, 0.961),
        ] {
            let lot = Restitution::single(restitution).unwrap();
            for (third, best) in [(0.0, two), (0.06, three)] {
                let mut settings = plan_of(lot, scatter, [0.3, third]).settings;
                settings.limits.acceleration = 1.0 / peak;
                let mut planner = GearPlanner::new(settings).unwrap();
                while planner.advance(1000) {}
                let plan = planner.plan().unwrap();
                let truth = truth(plan, lot, scatter);
                let [_, pushed] = super::super::peaks(plan.tones);
                assert!(pushed / plan.k < peak * 1.001, "{plan:?}");
                assert!(
                    truth > best - 0.03,
                    "{restitution} {third}: {truth} {plan:?}"
                );
                assert!(
                    (f64::from(plan.share) - truth).abs() < 0.04,
                    "{truth} {plan:?}"
                );
                assert!(planner.impacts() <= EFFORT[if third > 0.0 { 2 } else { 1 }]);
            }
        }
    }

    /// Best shares of `kband gear --order 2 --largest-second-tone 0.3 --runs 12`: a dense map over
    /// k, e and th in f64. The map is refined at its best points.
    #[test]
    fn of_order_two_the_plan_comes_near_a_dense_search() {
        for (restitution, scatter, one, two) in [
            (0.2, 0.05, 0.047, 0.940),
            (0.4, 0.05, 0.133, 0.883),
            (0.6, 0.05, 0.084, 0.711),
            (0.3, 0.03, 0.137, 0.998),
        ] {
            let lot = Restitution::single(restitution).unwrap();
            let born = band::birth(lot.high(), 2).unwrap();
            for (second, best) in [(0.0, one), (0.3, two)] {
                let settings = GearPlanSettings {
                    order: 2,
                    k: [0.14, (1.02 * born).min(0.98) as f32],
                    ..plan_of(lot, scatter, [second, 0.0]).settings
                };
                let mut planner = GearPlanner::new(settings).unwrap();
                while planner.advance(1000) {}
                let plan = planner.plan().unwrap();
                let truth = truth_of(2, plan, lot, scatter);
                std::println!("{restitution} {second}: {truth:.3} of {best}, {plan:?}");
                assert!(truth > best - 0.03, "{restitution}: {truth} {plan:?}");
                assert!(
                    (f64::from(plan.share) - truth).abs() < 0.05,
                    "{truth} {plan:?}"
                );
            }
        }
    }

    #[test]
    fn a_plan_stands_however_soon_the_effort_ends_and_where_nothing_is_ever_in_gear() {
        let lot = Restitution::single(0.3).unwrap();
        for most in [[0.0; 2], [0.2, 0.0], [0.2, 0.05]] {
            let mut planner = GearPlanner::new(GearPlanSettings {
                restitution: lot,
                scatter: 0.3,
                amplitude_error: 0.0,
                order: 1,
                // No part at rest is ever thrown at these k.
                k: [1.4, 2.0],
                most,
                limits: GearLimits {
                    acceleration: 2.0,
                    ..GearLimits::NONE
                },
            })
            .unwrap();
            while planner.advance(1000) {}
            let plan = planner.plan().unwrap();
            assert!(plan.share == 0.0 && plan.tones == [NONE; 2], "{plan:?}");
            assert!((1.4..=2.0).contains(&plan.k));
        }
        let mut spent = plan_of(lot, 0.05, [0.0; 2]);
        // As if the effort were spent before each candidate had a run.
        spent.impacts = EFFORT[0];
        while spent.advance(64) {}
        let plan = spent.plan().unwrap();
        assert!(plan.settled && (0.28..0.61).contains(&plan.k), "{plan:?}");
    }

    #[test]
    fn slices_change_no_bit_and_the_effort_is_bounded() {
        let lot = Restitution::single(0.7).unwrap();
        let whole = plan(lot, 0.05, [0.0; 2]);
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
            amplitude_error: 0.02,
            order: 1,
            k: [0.3, 0.4],
            most: [0.0; 2],
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
                    amplitude_error: 0.3,
                    ..settings
                },
                "amplitude_error",
            ),
            (
                GearPlanSettings {
                    most: [0.6, 0.0],
                    ..settings
                },
                "second tone",
            ),
            (
                GearPlanSettings {
                    most: [0.2, 0.6],
                    ..settings
                },
                "third tone",
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
