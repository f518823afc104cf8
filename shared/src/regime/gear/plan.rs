//! Search for the k and the upper tones at which a lot is in gear for the largest share of time.
//!
//! The method is the response surface method (Box and Wilson, J. R. Stat. Soc. B 13 (1951) 1;
//! docs/theory-real-parts.md#t10.8). Its objective is the share of time in gear, estimated by
//! simulated runs. Impacts and memory are bounded, so the search runs on the board.

use core::f32::consts::{FRAC_PI_2, PI};

use heapless::Vec;

use super::GearDetector;
use super::draw::Draw;
use super::fit::{Fit, FittedShare};
use super::limits::GearLimits;
use super::part::{SimulatedPart, Span, Tones, TrackMap};
use crate::feeder::{OutOfRange, Restitution, accept};
use crate::impact::ContactTime;

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
    pub max_tones: [f32; 2],
    /// Limits of the drive.
    pub limits: GearLimits,
    /// Duration of an impact.
    pub contact: ContactTime,
}

/// Result of the search so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearPlan {
    /// The k with the largest share of time in gear.
    pub k: f32,
    /// Amplitude over the first tone (symbol e) and angle in rad (symbol th) of the second and
    /// third tone; 0 and 0 without one.
    pub tones: Tones,
    /// Gear band: lowest and highest k, about this one and at these tones, whose fitted share is
    /// within [`GEAR_BAND_LOSS`] of the share here. It ends where the search or the drive ends.
    pub band: [f32; 2],
    /// Predicted share of time in gear at this k and these tones, mean over the lot, 0..=1.
    pub share: f32,
    /// Whether the search has ended.
    pub settled: bool,
}

/// Loss of the share of time in gear at the ends of the gear band.
pub const GEAR_BAND_LOSS: f32 = 0.02;

const MAX_CANDIDATES: usize = ORDER_1_ROWS.len() * GRID_STEPS[1];

/// A grid point of the first round; its index gives k and tones.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// Factor on the tones' amplitudes at which the drive's limits hold, 0..=1.
    amplitude_factor: f32,
    /// Sum of the shares in gear of its runs, and the number of runs.
    sum: f32,
    runs: u16,
}

/// Number of runs, sum of their shares in gear and of the squared shares.
#[derive(Clone, Copy, Debug, Default)]
struct RunStatistics {
    runs: f32,
    sum: f32,
    squares: f32,
}

impl RunStatistics {
    fn add(&mut self, share: f32) {
        self.runs += 1.0;
        self.sum += share;
        self.squares += share * share;
    }

    /// Whether the standard error of the mean is at most [`MAX_STANDARD_ERROR`].
    fn is_precise(&self) -> bool {
        let Self { runs, sum, squares } = *self;
        let max_variance = MAX_STANDARD_ERROR * MAX_STANDARD_ERROR * runs;
        runs > 0.0 && squares / runs - (sum / runs) * (sum / runs) <= max_variance
    }
}

#[derive(Clone, Copy, Debug)]
struct SearchPoint {
    k: f32,
    tones: Tones,
}

impl SearchPoint {
    const fn new(k: f32, tones: Tones) -> Self {
        Self { k, tones }
    }
}

/// Runs of a candidate of the first round, with one, two and three tones; two if they have share 0.
const RUNS_PER_CANDIDATE: [u16; 3] = [4, 3, 3];

/// Standard error of the mean share at which regions and verification end, and their smallest
/// number of runs with one, two and three tones: about three for each term of the fit.
const MAX_STANDARD_ERROR: f32 = 0.008;
const MIN_RUNS: [f32; 3] = [16.0, 40.0, 40.0];

/// Drive periods of a run and of its discarded transient, in the first round and in regions.
const RUN_AND_TRANSIENT_PERIODS: [[u16; 2]; 2] = [[130, 25], [300, 30]];

/// Cumulative share of [`MAX_IMPACTS`] at which each stage ends at the latest, with one, two and
/// three tones. The stages are first round, regions and verification; the rest completes the run in
/// progress.
const STAGE_END_EFFORT: [&[f32]; 3] = [
    &[0.30, 0.50, 0.80, 0.97],
    &[0.38, 0.57, 0.82, 0.97],
    &[0.36, 0.52, 0.68, 0.87, 0.97],
];

/// Predicted share from which the simulated scatter is multiplied by [`SATURATED_SCATTER_FACTOR`].
/// Above it points differ by less than the error of the fit; more scatter separates them.
const SATURATED_SHARE: f32 = 0.985;
const SATURATED_SCATTER_FACTOR: f32 = 1.5;

/// Weight of a verification run over a selection run, which is biased upwards (winner's curse).
const VERIFICATION_WEIGHT: f32 = 6.0;

/// Half-widths of the first region: in k in candidate spacings, in e over the largest tried, in th
/// in rad. The next region is [`REGION_SHRINK_FACTOR`] times as wide. The last region of a search
/// with three tones uses [`THIRD_TONE_HALF_WIDTHS`].
const REGION_HALF_WIDTHS: [f32; 3] = [1.3, 0.25, 0.2];
const THIRD_TONE_HALF_WIDTHS: [f32; 3] = [0.7, 0.6, 0.6];
const REGION_SHRINK_FACTOR: f32 = 0.75;

/// Grid points in k of each row of the first round, with one, two and three tones.
const GRID_STEPS: [usize; 3] = [20, 12, 12];

/// Upper tones of the rows of the first round: e over the largest tried, th in rad. For order 1 the
/// best of 32 angles was between these for each lot tried (docs/theory-real-parts.md#t10.2). From
/// order 3 on [`FULL_CIRCLE_ROWS`] spans the circle.
const ORDER_1_ROWS: [Tones; 3] = [
    [[1.0, 2.4], NO_TONE],
    [[1.0, 2.65], NO_TONE],
    [[0.7, 2.5], NO_TONE],
];
const FULL_CIRCLE_ROWS: [Tones; 3] = [
    [[1.0, FRAC_PI_2], NO_TONE],
    [[1.0, PI], NO_TONE],
    [[1.0, 2.4], NO_TONE],
];
/// Rows for order 2, with amplitudes larger by [`ORDER_2_AMPLITUDE_FACTOR`]. A dense search found
/// its best angles at 2.88 to 3.14 rad.
const ORDER_2_ROWS: [Tones; 3] = [
    [[1.0, 2.75], NO_TONE],
    [[1.0, 3.0], NO_TONE],
    [[0.75, 2.9], NO_TONE],
];
const ORDER_2_AMPLITUDE_FACTOR: f32 = 1.3;
const NO_TONE: [f32; 2] = [0.0; 2];
/// Rows with a third tone, at the angle th3 = [`THIRD_TONE_ANGLE`] rad. A random search over some
/// thousand shapes found its best there (docs/theory-real-parts.md#t10.3).
const THREE_TONE_ROWS: [Tones; 3] = [
    [[1.0, 2.6], [1.0, THIRD_TONE_ANGLE]],
    [[0.8, 2.6], [0.5, THIRD_TONE_ANGLE]],
    [[0.8, 2.6], [0.0, THIRD_TONE_ANGLE]],
];
const THIRD_TONE_ANGLE: f32 = 5.3;

/// Largest second tone tried, over the first tone: TRIED_SECOND_TONE_AT_R_0 plus
/// TRIED_SECOND_TONE_SLOPES, with one, two and three tones, times the mean restitution R. The best
/// for order 1 was between 0.13 at R = 0.15 and 0.25 at R = 0.6, for scatter of 0.03 to 0.15. The
/// third tone is at most [`MAX_THIRD_TONE`], the bound of the random search.
const TRIED_SECOND_TONE_AT_R_0: f32 = 0.08;
const TRIED_SECOND_TONE_SLOPES: [f32; 3] = [0.3, 0.3, 0.4];
const MAX_THIRD_TONE: f32 = 0.07;

/// Grid points at which the fitted share is evaluated: in each of e and th, and in k.
const TONE_GRID_POINTS: u8 = 5;
const K_GRID_POINTS: u8 = 17;

/// Penalty on the share per squared normalized distance from the centre: it breaks ties at 1.
const DISTANCE_PENALTY: f32 = 0.03;

/// Amplitude over the first below which a tone counts as absent.
const MIN_TONE_AMPLITUDE: f32 = 0.01;

/// Largest number of impacts of a search with one, two and three tones. The liveliest parts take
/// 42, 61 and 73 million instructions on a Cortex-M4F.
const MAX_IMPACTS: [u32; 3] = [101_000, 101_000, 115_000];

/// Cost, in impacts, of the peak search of upper tones and of the set-up of a run.
const PEAK_SEARCH_COST: u32 = 8;
const RUN_SET_UP_COST: u32 = 30;

/// A stage of the search, with the results of its runs.
#[derive(Clone, Debug)]
enum Stage {
    Grid(Vec<Candidate, MAX_CANDIDATES>),
    Region(Fit),
    /// Maximization of the fitted share on a grid; holds the next row.
    Maximization(u8, FittedShare),
    Verification,
}

/// A box of the search space in k and in amplitude and angle of one upper tone.
#[derive(Clone, Copy, Debug)]
struct Region {
    centre: SearchPoint,
    half_widths: [f32; 3],
    /// Whether the third tone varies instead of the second.
    varies_third: bool,
}

impl Region {
    fn varied_coordinates(&self, point: SearchPoint) -> [f32; 3] {
        let [ratio, angle] = point.tones[usize::from(self.varies_third)];
        [point.k, ratio, angle]
    }

    /// The point with these three coordinates; the other tone is the centre's.
    fn point(&self, [k, ratio, angle]: [f32; 3]) -> SearchPoint {
        let mut tones = self.centre.tones;
        tones[usize::from(self.varies_third)] = [ratio, angle];
        SearchPoint::new(k, tones)
    }

    /// Coordinates normalized to -1..1 within the region.
    fn normalize(&self, point: SearchPoint) -> [f32; 3] {
        let [k, ratio, angle] = self.varied_coordinates(point);
        let centre = self.varied_coordinates(self.centre);
        // An amplitude below 0 is the same tone with its angle turned by half a turn.
        let point = if self.varies_third && angle < centre[2] - FRAC_PI_2 {
            [k, -ratio, angle + PI]
        } else {
            [k, ratio, angle]
        };
        core::array::from_fn(|n| {
            if self.half_widths[n] > 0.0 {
                (point[n] - centre[n]) / self.half_widths[n]
            } else {
                0.0
            }
        })
    }
}

/// Searches k and upper tones for the largest share of time in gear, of parts from rest.
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
    /// Number of upper tones searched, 0..=2.
    upper_tones: usize,
    /// Lowest candidate and spacing in k, and largest second and third tone tried.
    low: f32,
    step: f32,
    max_tones: [f32; 2],
    stage: Stage,
    /// Number of regions begun, and the current region.
    regions: usize,
    region: Region,
    /// Index of the current candidate, and the round of runs.
    candidate: usize,
    round: u16,
    runs: u32,
    running: Option<(TrackMap, SimulatedPart, Run)>,
    gear: GearDetector<i64>,
    best: Option<(f32, SearchPoint)>,
    scatter_factor: f32,
    /// Runs of the current region or of the verification, and the weight of the fitted share.
    statistics: RunStatistics,
    fit_weight: f32,
    plan: Option<GearPlan>,
    impacts: u32,
}

/// A run: restitution of its part (`None` in a lot of one) and point, normalized to -1..1.
#[derive(Clone, Copy, Debug)]
struct Run {
    lot: Option<f32>,
    point: [f32; 3],
}

impl GearPlanner {
    /// Begins a search; an error names the parameter out of range.
    pub fn new(settings: GearPlanSettings) -> Result<Self, OutOfRange> {
        let [low, high] = settings.k;
        let [second, third] = settings.max_tones;
        for (parameter, value, maximum, accepted) in [
            ("scatter", settings.scatter, 0.3, "0..0.3"),
            ("amplitude_error", settings.amplitude_error, 0.2, "0..0.2"),
            ("second tone", second, 0.5, "0..0.5 of the first"),
            ("third tone", third, 0.5, "0..0.5 of the first"),
        ] {
            let accepts = (0.0..=maximum).contains(&value);
            accept(parameter, value.into(), accepts, accepted)?;
        }
        let accepts = 0.005 <= low && low <= high && high <= 4.0;
        accept("k", low.into(), accepts, "0.005..4, the lowest first")?;
        let tones = settings.max_tones.into_iter();
        let upper = tones
            .take_while(|e| *e >= MIN_TONE_AMPLITUDE)
            .count()
            .min(2);
        let middle = settings.restitution.middle() as f32;
        let slope = TRIED_SECOND_TONE_SLOPES[upper];
        let mut max_second = TRIED_SECOND_TONE_AT_R_0 + slope * middle;
        let mut range = settings.k;
        if upper > 0 && settings.order <= 2 {
            let mut best = 0.28 + (0.15 + 0.95 * middle) * middle;
            if settings.order == 2 {
                best *= 0.5;
                max_second *= ORDER_2_AMPLITUDE_FACTOR;
            }
            let near = [low.max(0.75 * best), high.min(1.3 * best)];
            if near[0] < near[1] {
                range = near;
            }
        }
        let [low, high] = range;
        let step = (high - low) / (GRID_STEPS[upper] - 1) as f32;
        let mut max_tones = [second.min(max_second), third.min(MAX_THIRD_TONE)];
        max_tones[upper..].fill(0.0);
        Ok(Self {
            settings,
            upper_tones: upper,
            low,
            step,
            max_tones,
            stage: Stage::Grid(Vec::new()),
            regions: 0,
            region: Region {
                centre: SearchPoint::new(low, [NO_TONE; 2]),
                half_widths: [0.0; 3],
                varies_third: false,
            },
            candidate: 0,
            round: 0,
            runs: 0,
            running: None,
            gear: GearDetector::build_in_steps(settings.order)?,
            best: None,
            scatter_factor: 1.0,
            statistics: RunStatistics::default(),
            fit_weight: 0.0,
            plan: None,
            impacts: 0,
        })
    }

    /// Largest factor on the tones' amplitudes at which the drive's limits hold; 0 if none does.
    fn allowed_amplitude_factor(&mut self, point: SearchPoint) -> f32 {
        for part in [1.0, 0.85, 0.7, 0.55, 0.4, 0.2] {
            let tones = scale_tones(point.tones, part);
            let [[ratio, _], _] = tones;
            if ratio < MIN_TONE_AMPLITUDE {
                break;
            }
            self.impacts += PEAK_SEARCH_COST;
            if point.k >= self.settings.limits.min_k(tones) {
                return part;
            }
        }
        0.0
    }

    /// Inputs of the search.
    pub fn settings(&self) -> &GearPlanSettings {
        &self.settings
    }

    /// Result so far; `None` before the first round ends.
    pub fn plan(&self) -> Option<&GearPlan> {
        self.plan.as_ref()
    }

    /// Works for about this number of impacts and returns whether the search continues.
    pub fn advance(&mut self, impacts: u32) -> bool {
        let until = self.impacts.saturating_add(impacts);
        while self.impacts < until && !self.is_over() {
            if self.running.is_some() {
                self.advance_run(until);
            } else {
                self.advance_once();
            }
        }
        !self.is_over()
    }

    fn is_over(&self) -> bool {
        self.plan.is_some_and(|plan| plan.settled)
    }

    fn by_tone_count<T: Copy>(&self, values: [T; 3]) -> T {
        values[self.upper_tones.min(2)]
    }

    /// Computes impacts of the current run, to its end or to this number of impacts.
    fn advance_run(&mut self, until: u32) {
        let until = until.min(self.by_tone_count(MAX_IMPACTS).max(self.impacts + 1));
        let Some((map, part, run)) = &mut self.running else {
            return;
        };
        // A copy stays in registers.
        let mut simulated = *part;
        let mut ended = false;
        while self.impacts < until && !ended {
            self.impacts += 1;
            ended = simulated.simulate_flight(map, |_| {});
        }
        if ended {
            let run = *run;
            self.running = None;
            self.record_share(simulated.share(), &run);
        } else {
            *part = simulated;
            if self.impacts >= self.by_tone_count(MAX_IMPACTS) {
                self.running = None;
            }
        }
    }

    fn advance_once(&mut self) {
        self.impacts += 1;
        let ends = self.by_tone_count(STAGE_END_EFFORT);
        let end = ends.get(self.regions).or(ends.last());
        let used = self.impacts as f32 / self.by_tone_count(MAX_IMPACTS) as f32;
        let has_runs = self.statistics.runs >= self.by_tone_count(MIN_RUNS);
        let is_stage_over =
            end.is_none_or(|end| used >= *end) || has_runs && self.statistics.is_precise();
        match self.stage {
            Stage::Maximization(row, shape) => self.evaluate_row(row, shape),
            _ if is_stage_over => self.end_stage(),
            Stage::Grid(_) => self.begin_candidate_run(),
            Stage::Region(_) => self.begin_region_run(),
            Stage::Verification => {
                if let Some(plan) = self.plan {
                    self.begin_run(plan.point(), self.runs);
                }
            }
        }
    }

    fn steps(&self) -> usize {
        // Constants, so that no division by them can panic.
        match self.upper_tones {
            0 => GRID_STEPS[0],
            _ => GRID_STEPS[1],
        }
    }

    fn rows(&self) -> &'static [Tones] {
        match (self.upper_tones, self.settings.order) {
            (0, _) => &[[NO_TONE; 2]],
            (1, 1) => &ORDER_1_ROWS,
            (_, 1) => &THREE_TONE_ROWS,
            (_, 2) => &ORDER_2_ROWS,
            _ => &FULL_CIRCLE_ROWS,
        }
    }

    /// Point of a candidate, with its tones' amplitudes times `part`; no tones beyond the last row.
    fn point(&self, number: usize, part: f32) -> SearchPoint {
        let row = self.rows().get(number / self.steps());
        let [second, third] = row.copied().unwrap_or_default();
        let [of_second, of_third] = self.max_tones;
        let tones = [
            [second[0] * of_second, second[1]],
            [third[0] * of_third, third[1]],
        ];
        let k = self.low + self.step * (number % self.steps()) as f32;
        SearchPoint::new(k.min(self.settings.k[1]), scale_tones(tones, part))
    }

    fn begin_candidate_run(&mut self) {
        let number = self.candidate;
        if number >= self.steps() * self.rows().len() {
            self.candidate = 0;
            self.round += 1;
            if self.round >= self.by_tone_count(RUNS_PER_CANDIDATE) {
                self.end_stage();
            }
            return;
        }
        let recorded = match &self.stage {
            Stage::Grid(candidates) => candidates.get(number).copied(),
            _ => None,
        };
        let candidate = recorded.unwrap_or_else(|| {
            let candidate = Candidate {
                amplitude_factor: self.allowed_amplitude_factor(self.point(number, 1.0)),
                sum: 0.0,
                runs: 0,
            };
            if let Stage::Grid(candidates) = &mut self.stage {
                // MAX_CANDIDATES is the largest product of rows and steps.
                let _ = candidates.push(candidate);
            }
            candidate
        });
        if candidate.runs >= 2 && candidate.sum == 0.0 {
            self.candidate += 1;
            return;
        }
        let point = self.point(number, candidate.amplitude_factor);
        self.begin_run(point, u32::from(self.round));
    }

    /// Begins a run at the next low-discrepancy point of the region.
    fn begin_region_run(&mut self) {
        // R3 sequence, the additive recurrence of M. Roberts (2018), in units of 2^-32.
        const R3_STEPS: [u32; 3] = [0xD1B5_4A33, 0xABC9_8388, 0x8CB9_2BA7];
        let run = self.runs;
        let centre = self.region.varied_coordinates(self.region.centre);
        let half = self.region.half_widths;
        let varied = core::array::from_fn(|n| {
            centre[n] + half[n] * (2.0 * unit_fraction(run.wrapping_mul(R3_STEPS[n])) - 1.0)
        });
        let point = self.check(self.region.point(varied));
        self.begin_run(point, run);
    }

    /// Clamps a point to the configured ranges and to the drive's limits.
    fn check(&mut self, SearchPoint { k, tones }: SearchPoint) -> SearchPoint {
        let [low, high] = self.settings.k;
        let k = k.max(low).min(high);
        if self.upper_tones == 0 {
            return SearchPoint::new(k, [NO_TONE; 2]);
        }
        let ([second, third], maximum) = (tones, self.settings.max_tones);
        let tone = |[ratio, angle]: [f32; 2], max_amplitude: f32| {
            [ratio.max(0.0).min(max_amplitude), angle]
        };
        // A third tone below 0 is one turned by half a turn.
        let tones = [
            tone(second, maximum[0]),
            tone(with_positive_amplitude(third), maximum[1]),
        ];
        let afforded = self.allowed_amplitude_factor(SearchPoint::new(k, tones));
        SearchPoint::new(k, scale_tones(tones, afforded))
    }

    /// Begins a run; its number gives restitution and amplitude error by the R2 sequence (M.
    /// Roberts 2018). Any number of runs covers lot and errors evenly.
    fn begin_run(&mut self, point: SearchPoint, number: u32) {
        self.runs += 1;
        self.impacts += RUN_SET_UP_COST;
        let spread =
            |step| 2.0 * unit_fraction(number.wrapping_mul(step).wrapping_add(1 << 31)) - 1.0;
        let (lot, error) = (spread(0xC13F_A9A9), spread(0x91E1_0DA5));
        let restitution = self.settings.restitution;
        let (low, high) = (restitution.low() as f32, restitution.high() as f32);
        let mean = low + (high - low) * (0.5 + 0.5 * lot);
        let seed = (self.regions as u32) << 24 ^ self.runs;
        let k = point.k * (1.0 + self.settings.amplitude_error * error);
        let [first, later] = RUN_AND_TRANSIENT_PERIODS;
        let [periods, before] = if self.regions == 0 { first } else { later };
        let run = Run {
            lot: (high > low).then_some(lot),
            point: self.region.normalize(SearchPoint { k, ..point }),
        };
        match TrackMap::build(k, point.tones) {
            Ok(map) => {
                let map = map.with_contact(self.settings.contact.radians() as f32);
                let scatter_factor = match self.stage {
                    Stage::Verification => 1.0,
                    _ => self.scatter_factor,
                };
                let draw = Draw::new(mean, self.settings.scatter * scatter_factor, seed);
                let part = SimulatedPart::new(draw, self.gear, Span::from_periods(periods, before));
                self.running = Some((map, part, run));
            }
            Err(_) => self.record_share(0.0, &run),
        }
    }

    fn record_share(&mut self, share: f32, run: &Run) {
        match &mut self.stage {
            Stage::Grid(candidates) => {
                if let Some(candidate) = candidates.get_mut(self.candidate) {
                    candidate.sum += share;
                    candidate.runs += 1;
                }
                self.candidate += 1;
            }
            Stage::Region(fit) => {
                self.statistics.add(share);
                fit.add_run(run.point, run.lot, share);
            }
            Stage::Maximization(..) | Stage::Verification => self.statistics.add(share),
        }
    }

    fn end_stage(&mut self) {
        match &self.stage {
            Stage::Grid(candidates) => {
                let best = self.best_candidate(candidates);
                self.set_plan(best);
                let [of_k, of_ratio, of_angle] = REGION_HALF_WIDTHS;
                let half = [of_k * self.step, of_ratio * self.max_tones[0], of_angle];
                self.begin_region(best.1, half, false);
            }
            Stage::Region(fit) => {
                self.stage = Stage::Maximization(0, fit.solve());
                self.best = None;
            }
            Stage::Maximization(..) => {}
            Stage::Verification => {
                if let Some(plan) = &mut self.plan {
                    plan.settled = true;
                    let weight = self.fit_weight + self.statistics.runs;
                    if weight > 0.0 {
                        plan.share = (self.fit_weight * plan.share + self.statistics.sum) / weight;
                    }
                }
            }
        }
    }

    fn begin_region(&mut self, centre: SearchPoint, half_widths: [f32; 3], varies_third: bool) {
        let half_widths = match self.upper_tones {
            0 => [half_widths[0], 0.0, 0.0],
            _ => half_widths,
        };
        self.regions += 1;
        self.region = Region {
            centre,
            half_widths,
            varies_third,
        };
        self.statistics = RunStatistics::default();
        self.stage = Stage::Region(Fit::EMPTY);
    }

    /// The candidate with the largest share, smoothed over k: so it is the middle of a range in
    /// which no run left gear. If all shares are 0, it is the middle of k without tones.
    fn best_candidate(&self, candidates: &[Candidate]) -> (f32, SearchPoint) {
        let share = |candidate: &Candidate| match candidate.runs {
            0 => 0.0,
            runs => candidate.sum / f32::from(runs),
        };
        let middle = 0.5 * (self.settings.k[0] + self.settings.k[1]);
        let mut best = (0.0, SearchPoint::new(middle, [NO_TONE; 2]));
        for (first, row) in candidates.chunks(self.steps()).enumerate() {
            for (n, here) in row.iter().enumerate() {
                let before = n.checked_sub(1).and_then(|n| row.get(n));
                let neighbours = before.map_or(0.0, share) + row.get(n + 1).map_or(0.0, share);
                let mean = 0.25 * neighbours + 0.5 * share(here);
                if mean > best.0 {
                    let number = first * self.steps() + n;
                    best = (mean, self.point(number, here.amplitude_factor));
                }
            }
        }
        best
    }

    /// Evaluates the fitted share at one row of the grid, for each k, and keeps the best point.
    fn evaluate_row(&mut self, row: u8, shape: FittedShare) {
        let at = |n: u8, all: u8| 2.0 * f32::from(n) / f32::from(all - 1) - 1.0;
        let (rows, [y, z]) = match self.upper_tones {
            0 => (1, [0.0; 2]),
            _ => (
                TONE_GRID_POINTS * TONE_GRID_POINTS,
                [row % TONE_GRID_POINTS, row / TONE_GRID_POINTS].map(|n| at(n, TONE_GRID_POINTS)),
            ),
        };
        if row >= rows {
            self.end_maximization(&shape);
            return;
        }
        let centre = self.region.varied_coordinates(self.region.centre);
        let half = self.region.half_widths;
        let (ratio, angle) = (centre[1] + half[1] * y, centre[2] + half[2] * z);
        let is_absent = match self.region.varies_third {
            false => ratio < MIN_TONE_AMPLITUDE,
            true => ratio.abs() < MIN_TONE_AMPLITUDE,
        };
        let ratio = if is_absent { 0.0 } else { ratio };
        let mut min_k = self.settings.k[0];
        let [second, third] = self.region.point([0.0, ratio, angle]).tones;
        let tones = [second, with_positive_amplitude(third)];
        let [second, _] = second;
        if second > 0.0 {
            self.impacts += PEAK_SEARCH_COST;
            min_k = min_k.max(self.settings.limits.min_k(tones));
        }
        let maximum = self.settings.max_tones[usize::from(self.region.varies_third)];
        let error = self.normalized_k_error();
        for n in 0..K_GRID_POINTS {
            let x = at(n, K_GRID_POINTS);
            let k = centre[0] + half[0] * x;
            let square = [x, y, z].iter().map(|x| x * x).sum::<f32>();
            let share = shape.mean_share([x, y, z], error).min(1.0);
            let weighed = share - DISTANCE_PENALTY * square;
            if square <= 1.0
                && k >= min_k
                && k <= self.settings.k[1]
                && ratio.abs() <= maximum
                && self.best.is_none_or(|(best, _)| weighed > best)
            {
                self.best = Some((weighed, SearchPoint::new(k, tones)));
            }
        }
        self.stage = Stage::Maximization(row + 1, shape);
    }

    fn end_maximization(&mut self, shape: &FittedShare) {
        if let Some((_, point)) = self.best.take() {
            self.set_plan((self.fitted_share(shape, point), point));
            let band = [-1.0, 1.0].map(|side| self.gear_band_end(shape, point, side));
            if let Some(plan) = &mut self.plan {
                plan.band = band;
            }
        }
        // If no point is within the drive's limits, the former plan remains.
        let Some(plan) = self.plan else {
            return;
        };
        let stages = self.by_tone_count(STAGE_END_EFFORT).len();
        let remaining = stages.saturating_sub(self.regions);
        if remaining > 2 {
            let of_third = self.upper_tones > 1 && remaining == 3;
            let half = self.region.half_widths;
            let half = if of_third {
                let [of_k, of_ratio, of_angle] = THIRD_TONE_HALF_WIDTHS;
                [of_k * half[0], of_ratio * self.max_tones[1], of_angle]
            } else {
                half.map(|half| half * REGION_SHRINK_FACTOR)
            };
            let mut centre = plan.point();
            let [_, third] = &mut centre.tones;
            if of_third && third[0] == 0.0 {
                third[1] = THIRD_TONE_ANGLE;
            }
            self.begin_region(centre, half, of_third);
        } else {
            self.regions += 1;
            self.stage = Stage::Verification;
            if self.scatter_factor == 1.0 {
                self.fit_weight = self.statistics.runs / VERIFICATION_WEIGHT;
            }
            self.statistics = RunStatistics::default();
        }
    }

    fn fitted_share(&self, shape: &FittedShare, point: SearchPoint) -> f32 {
        shape.mean_share(self.region.normalize(point), self.normalized_k_error())
    }

    /// End of the gear band below (`side` -1) or above (1) a point of the region.
    fn gear_band_end(&self, shape: &FittedShare, point: SearchPoint, side: f32) -> f32 {
        let step = side * self.region.half_widths[0] / f32::from(K_GRID_POINTS);
        let [min_k, max_k] = self.settings.k;
        let min_k = min_k.max(self.settings.limits.min_k(point.tones));
        let threshold = self.fitted_share(shape, point).min(1.0) - GEAR_BAND_LOSS;
        let is_inside = |k: f32| {
            let there = SearchPoint::new(k, point.tones);
            (min_k..=max_k).contains(&k)
                && self.region.normalize(there)[0].abs() <= 1.0
                && self.fitted_share(shape, there) >= threshold
        };
        let ks = (1..=2 * K_GRID_POINTS).map(|n| point.k + step * f32::from(n));
        ks.take_while(|k| is_inside(*k)).last().unwrap_or(point.k)
    }

    /// Error of k from the error of the amplitude, in the region's normalized coordinate.
    fn normalized_k_error(&self) -> f32 {
        let [half, ..] = self.region.half_widths;
        if half > 0.0 {
            self.settings.amplitude_error * self.region.centre.k / half
        } else {
            0.0
        }
    }

    fn set_plan(&mut self, (share, SearchPoint { k, tones }): (f32, SearchPoint)) {
        let share = share.clamp(0.0, 1.0);
        if share >= SATURATED_SHARE {
            self.scatter_factor *= SATURATED_SCATTER_FACTOR;
        }
        self.plan = Some(GearPlan {
            k,
            tones: match tones {
                [[second, _], _] if second < MIN_TONE_AMPLITUDE => [NO_TONE; 2],
                [second, [third, _]] if third < MIN_TONE_AMPLITUDE => [second, NO_TONE],
                _ => tones,
            },
            band: [k; 2],
            share,
            settled: false,
        });
    }
}

impl GearPlan {
    fn point(&self) -> SearchPoint {
        SearchPoint::new(self.k, self.tones)
    }
}

fn with_positive_amplitude([ratio, angle]: [f32; 2]) -> [f32; 2] {
    if ratio < 0.0 {
        [-ratio, angle - PI]
    } else {
        [ratio, angle]
    }
}

fn scale_tones(tones: Tones, part: f32) -> Tones {
    tones.map(|[ratio, angle]| [ratio * part, angle])
}

/// Uniform in 0..1, from the upper 24 bits.
fn unit_fraction(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Scatter, Tone, Wave, WaveMap};
    use crate::regime::band;
    use crate::regime::gear::{Share, peaks, shares_from_rest};

    /// Share in f64 from other random draws, over 20 parts of 2000 periods.
    fn reference_share(order: u32, plan: &GearPlan, lot: Restitution, scatter: f32) -> f64 {
        let tone = |[amplitude, angle]: [f32; 2]| Tone::new(amplitude.into(), angle.into());
        let [second, third] = plan.tones.map(tone);
        let wave = Wave::build(second, third).unwrap();
        let map = WaveMap::on(wave, f64::from(plan.k), lot.middle()).unwrap();
        let parts: [Scatter; 20] = core::array::from_fn(|n| {
            let mean = lot.low() + (lot.high() - lot.low()) * (n as f64 + 0.5) / 20.0;
            Scatter::build(mean, f64::from(scatter), n as u64 + 1000).unwrap()
        });
        let mut sum = Share::default();
        let add = |_, share: Share| sum = sum.plus(&share);
        shares_from_rest(&map, ContactTime::INSTANT, &parts, order, 2000.0, add).unwrap();
        sum.share()
    }

    fn settings(order: u32, lot: Restitution, scatter: f32, tones: [f32; 2]) -> GearPlanSettings {
        let birth = band::birth(lot.high(), order).unwrap();
        GearPlanSettings {
            restitution: lot,
            scatter,
            amplitude_error: 0.02,
            order,
            k: [0.28 / order as f32, (1.02 * birth).min(0.98) as f32],
            max_tones: tones,
            limits: GearLimits::NONE,
            contact: ContactTime::INSTANT,
        }
    }

    fn plan(settings: GearPlanSettings) -> GearPlanner {
        let mut planner = GearPlanner::new(settings).unwrap();
        while planner.advance(1000) {}
        planner
    }

    /// Plans, and checks the plan's true share against the best one, its predicted share, its peak
    /// acceleration over gravity and the effort.
    fn check(settings: GearPlanSettings, best: f64) -> GearPlan {
        let planner = plan(settings);
        let plan = *planner.plan().unwrap();
        let exact = reference_share(
            settings.order,
            &plan,
            settings.restitution,
            settings.scatter,
        );
        assert!(plan.settled && exact > best - 0.03, "{exact} {plan:?}");
        let error = (f64::from(plan.share) - exact).abs();
        let bound = 0.04 + 0.01 * f64::from(settings.order - 1);
        assert!(error < bound, "{exact} {plan:?}");
        let [_, pushed] = peaks(plan.tones);
        let min_k = settings.limits.acceleration * pushed;
        assert!(min_k < plan.k * 1.001, "{plan:?}");
        let [second, third] = settings.max_tones.map(|tone| usize::from(tone > 0.0));
        assert!(planner.impacts <= MAX_IMPACTS[second + third]);
        plan
    }

    /// Best shares of a random search over some thousand shapes of two and of three tones, at the
    /// same peak acceleration (docs/theory-real-parts.md#t10.3).
    #[test]
    fn three_tone_plan_matches_a_random_search() {
        for (restitution, scatter, peak, two, three) in [
            (0.5, 0.10, 5.0, 0.947, 0.987),
            (0.5, 0.15, 5.0, 0.65, 0.77),
            (0.3, 0.10, 3.23, 0.87, 0.937),
            (0.3, 0.10, 5.0, 0.960, 0.961),
        ] {
            let lot = Restitution::single(restitution).unwrap();
            for (third, best) in [(0.0, two), (0.06, three)] {
                let mut settings = settings(1, lot, scatter, [0.3, third]);
                settings.limits.acceleration = 1.0 / peak;
                check(settings, best);
            }
        }
    }

    /// Best shares of `kband gear --order 2 --largest-second-tone 0.3 --runs 12`: a dense map over
    /// k, e and th in f64. The map is refined at its best points.
    #[test]
    fn order_2_plan_matches_a_dense_search() {
        for (restitution, scatter, one, two) in [
            (0.2, 0.05, 0.047, 0.940),
            (0.4, 0.05, 0.133, 0.883),
            (0.6, 0.05, 0.084, 0.711),
            (0.3, 0.03, 0.137, 0.998),
        ] {
            let lot = Restitution::single(restitution).unwrap();
            for (second, best) in [(0.0, one), (0.3, two)] {
                check(settings(2, lot, scatter, [second, 0.0]), best);
            }
        }
    }

    /// Reference shares: the best over 60 values of k, with 40 parts of 3000 periods each, or over
    /// a random search, in f64; 0 where there is none. At a share of 0.4 plan and reference each
    /// have an error of 0.01. The loss at the ends of the gear band is 0.02 with an error of 0.02.
    #[test]
    fn shares_of_a_plan_and_its_band_match_a_fine_grid() {
        let mut losses = [0.0; 2];
        let mut unsaturated = 0.0;
        for (low, high, scatter, second, best) in [
            (0.2, 0.2, 0.05, 0.0, 0.955),
            (0.3, 0.3, 0.05, 0.0, 0.838),
            (0.5, 0.5, 0.05, 0.0, 0.390),
            (0.3, 0.3, 0.1, 0.0, 0.455),
            (0.1, 0.3, 0.03, 0.0, 0.912),
            (0.18, 0.22, 0.04, 0.0, 0.0),
            (0.35, 0.45, 0.05, 0.0, 0.0),
            (0.2, 0.2, 0.05, 0.15, 1.0),
            (0.5, 0.5, 0.05, 0.15, 0.0),
            (0.3, 0.3, 0.1, 0.15, 0.952),
            (0.5, 0.5, 0.1, 0.25, 0.944),
            (0.1, 0.3, 0.03, 0.15, 1.0),
            (0.2, 0.2, 0.15, 0.15, 0.522),
            (0.1, 0.4, 0.03, 0.0, 0.673),
        ] {
            let lot = Restitution::interval(low, high).unwrap();
            let plan = check(settings(1, lot, scatter, [second, 0.0]), best);
            let [below, above] = plan.band;
            assert!(below <= plan.k && plan.k <= above && below < 0.99 * above);
            let share = |k: f32| reference_share(1, &GearPlan { k, ..plan }, lot, scatter);
            let loss = |k: f32| share(plan.k) - share(k);
            let (ends, half) = (loss(below).max(loss(above)), 0.5 * (above - below));
            assert!(ends < 0.06, "{low} {high} {scatter}: {ends} {plan:?}");
            if plan.share < SATURATED_SHARE {
                unsaturated += 1.0;
                losses[0] += 0.5 * (loss(below) + loss(above));
                losses[1] += 0.5 * (loss(below - half) + loss(above + half));
            }
        }
        let [at_ends, beyond] = losses.map(|sum| sum / unsaturated);
        assert!((0.0..0.03).contains(&at_ends), "{at_ends}");
        assert!(beyond > 2.0 * at_ends && beyond > 0.03, "{beyond}");
    }

    #[test]
    fn plan_exists_without_gear_and_without_effort() {
        let lot = Restitution::single(0.3).unwrap();
        for max_tones in [[0.0; 2], [0.2, 0.0], [0.2, 0.05]] {
            // No part at rest is ever thrown at these k.
            let mut settings = settings(1, lot, 0.3, max_tones);
            settings.k = [1.4, 2.0];
            settings.limits.acceleration = 2.0;
            let planner = plan(settings);
            let plan = planner.plan().unwrap();
            assert!(plan.share == 0.0 && plan.tones == [NO_TONE; 2], "{plan:?}");
            assert!((1.4..=2.0).contains(&plan.k));
        }
        let mut exhausted = GearPlanner::new(settings(1, lot, 0.05, [0.0; 2])).unwrap();
        // As if the effort were exhausted before each candidate had a run.
        exhausted.impacts = MAX_IMPACTS[0];
        while exhausted.advance(64) {}
        let plan = exhausted.plan().unwrap();
        assert!(plan.settled && (0.28..0.61).contains(&plan.k), "{plan:?}");
    }

    #[test]
    fn slices_change_no_bit_and_effort_is_bounded() {
        let lot = Restitution::single(0.7).unwrap();
        let unsliced = plan(settings(1, lot, 0.05, [0.0; 2]));
        let mut sliced = GearPlanner::new(unsliced.settings).unwrap();
        while sliced.advance(7) {}
        assert_eq!(sliced.plan(), unsliced.plan());
        assert_eq!(sliced.impacts, unsliced.impacts);
        assert!(unsliced.impacts <= MAX_IMPACTS[0]);
    }

    /// Lots in gear for more than 0.9 of the time. Without the end at a standard error a plan takes
    /// 0.97 of the largest effort.
    #[test]
    fn stages_end_once_the_share_is_precise() {
        let lots = [
            (0.10, 0.10, 0.03),
            (0.20, 0.20, 0.02),
            (0.20, 0.20, 0.03),
            (0.18, 0.22, 0.04),
            (0.10, 0.20, 0.02),
            (0.30, 0.30, 0.02),
        ];
        let effort = |(low, high, scatter)| {
            let lot = Restitution::interval(low, high).unwrap();
            let planner = plan(settings(1, lot, scatter, [0.0; 2]));
            assert!(planner.plan().unwrap().share > 0.9, "{low} {high}");
            f64::from(planner.impacts) / f64::from(MAX_IMPACTS[0])
        };
        let mean = lots.map(effort).iter().sum::<f64>() / lots.len() as f64;
        assert!((0.2..0.5).contains(&mean), "{mean} {:?}", lots.map(effort));
    }

    #[test]
    fn plan_settings_out_of_range_are_refused() {
        let valid = settings(1, Restitution::single(0.2).unwrap(), 0.05, [0.0; 2]);
        let refused = |change: fn(&mut GearPlanSettings)| {
            let mut settings = valid;
            change(&mut settings);
            GearPlanner::new(settings).unwrap_err().parameter
        };
        assert_eq!(refused(|s| s.scatter = 0.31), "scatter");
        assert_eq!(refused(|s| s.scatter = f32::NAN), "scatter");
        assert_eq!(refused(|s| s.amplitude_error = 0.3), "amplitude_error");
        assert_eq!(refused(|s| s.max_tones = [0.6, 0.0]), "second tone");
        assert_eq!(refused(|s| s.max_tones = [0.2, 0.6]), "third tone");
        assert_eq!(refused(|s| s.order = 0), "order");
        assert_eq!(refused(|s| s.k = [0.4, 0.3]), "k");
        assert_eq!(refused(|s| s.k = [0.4, 4.1]), "k");
    }
}
