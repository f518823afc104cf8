//! Intermediate results between the stages, dense and register by register.

use super::columns::Aligned;
use crate::arithmetic::lane::Lane;
use crate::impact::double::launch::{Launch, Track};
use crate::impact::double::step::{GapNearImpact, Landing, LandingEstimate};
use crate::impact::double::{low, tall};

/// Number of lanes that pass the stages together.
pub(super) const MAX_STAGED_LANES: usize = 64;

/// Intermediate results, with all quantities of a register side by side, so that the cache holds
/// them.
#[derive(Clone, Debug)]
pub(super) struct Stages(Aligned<{ MAX_STAGED_LANES * QUANTITIES_PER_REGISTER }>);

const QUANTITIES_PER_REGISTER: usize = 16;
const LAUNCH: usize = 0;
const TRACK: usize = 4;
/// Start of the first stage: a crossing or a stretch.
const STAGE_START: usize = 7;
const LANDING_ESTIMATE: usize = 11;
const LANDING: usize = 13;
/// [`ROUNDING_OFFSET`](crate::arithmetic::lane::ROUNDING_OFFSET) sum of the next stage's first
/// node, until there is a landing.
///
/// The next stage then waits only for its loads.
const NODE_SUM: usize = 13;
/// The gap near the impact, in the place of the launch.
///
/// Distance of the approach's node, time from the node next to the impact, value and slope.
const GAP: usize = LAUNCH;
/// Sine and cosine of the track there.
const GAP_TRACK: usize = 14;
/// Sum of the node next to a landing's phase, in the place of the landing's inputs.
const PHASE_NODE_SUM: usize = 11;
const RESTITUTION: usize = 12;

impl Stages {
    pub const EMPTY: Self = Self(Aligned::ZERO);

    /// Stores quantities of a register, from number `first` on.
    #[inline(always)]
    pub fn put_at<L: Lane, const N: usize>(&mut self, first: usize, values: [L; N]) {
        let places = &mut self.0.0[first * L::WIDTH..][..N * L::WIDTH];
        for (m, value) in values.into_iter().enumerate() {
            value.store(places, m * L::WIDTH);
        }
    }

    /// The quantities of a register from number `first` on.
    #[inline(always)]
    pub fn get_at<L: Lane, const N: usize>(&self, first: usize) -> [L; N] {
        let places = &self.0.0[first * L::WIDTH..][..N * L::WIDTH];
        let mut values = [L::splat(0.0); N];
        for (m, value) in values.iter_mut().enumerate() {
            *value = L::load(places, m * L::WIDTH);
        }
        values
    }

    /// Sine and cosine of the node whose sum is quantity number `place`.
    #[inline(always)]
    pub fn node_at<L: Lane>(&self, place: usize) -> (L, L) {
        L::node_at(&self.0.0, place * L::WIDTH)
    }

    /// Stores quantities of register `n`, from number `first` on.
    #[inline(always)]
    fn put<L: Lane, const N: usize>(&mut self, n: usize, first: usize, values: [L; N]) {
        self.put_at(n * QUANTITIES_PER_REGISTER + first, values);
    }

    #[inline(always)]
    fn get<L: Lane, const N: usize>(&self, n: usize, first: usize) -> [L; N] {
        self.get_at(n * QUANTITIES_PER_REGISTER + first)
    }

    /// Stores the sum of the next stage's first node.
    #[inline(always)]
    pub fn put_node_sum<L: Lane>(&mut self, n: usize, rounded: L) {
        self.put(n, NODE_SUM, [rounded]);
    }

    /// The sum of that node, and its sine and cosine.
    #[inline(always)]
    pub fn node_with_sum<L: Lane>(&self, n: usize) -> (L, (L, L)) {
        self.node_with_sum_at(n, NODE_SUM)
    }

    #[inline(always)]
    fn node_with_sum_at<L: Lane>(&self, n: usize, place: usize) -> (L, (L, L)) {
        let [rounded] = self.get(n, place);
        (rounded, self.node_at(n * QUANTITIES_PER_REGISTER + place))
    }

    /// Stores the sum of the node next to a landing, and the restitution.
    #[inline(always)]
    pub fn put_next_launch<L: Lane>(&mut self, n: usize, rounded: L, restitution: L) {
        self.put(n, PHASE_NODE_SUM, [rounded, restitution]);
    }

    /// The launch that follows a landing.
    #[inline(always)]
    pub fn next_launch<L: Lane>(&self, n: usize, landing: &Landing<L>) -> Launch<L> {
        let (rounded, node) = self.node_with_sum_at(n, PHASE_NODE_SUM);
        let velocity = self.restitution::<L>(n) * landing.arrival;
        Launch::with_node(landing.phase, velocity, rounded, node)
    }

    /// The restitution of [`Stages::put_next_launch`].
    #[inline(always)]
    pub fn restitution<L: Lane>(&self, n: usize) -> L {
        let [restitution] = self.get(n, RESTITUTION);
        restitution
    }

    #[inline(always)]
    pub fn put_launch<L: Lane>(&mut self, n: usize, launch: &Launch<L>) {
        let Launch {
            phase,
            velocity,
            sine,
            cosine,
        } = *launch;
        self.put(n, LAUNCH, [phase, velocity, sine, cosine]);
    }

    #[inline(always)]
    pub fn launch<L: Lane>(&self, n: usize) -> Launch<L> {
        let [phase, velocity, sine, cosine] = self.get(n, LAUNCH);
        Launch {
            phase,
            velocity,
            sine,
            cosine,
        }
    }

    #[inline(always)]
    pub fn put_track<L: Lane>(&mut self, n: usize, track: &Track<L>) {
        self.put(n, TRACK, [track.k, track.per_k, track.lift_off]);
    }

    #[inline(always)]
    pub fn track<L: Lane>(&self, n: usize) -> Track<L> {
        let [k, per_k, lift_off] = self.get(n, TRACK);
        Track {
            k,
            per_k,
            lift_off,
            lift_off_cosine: Track::lift_off_cosine(k),
        }
    }

    #[inline(always)]
    pub fn put_crossing<L: Lane>(&mut self, n: usize, crossing: &tall::Crossing<L>) {
        self.put(n, STAGE_START, [crossing.nodes, crossing.speed]);
    }

    #[inline(always)]
    pub fn crossing<L: Lane>(&self, n: usize) -> tall::Crossing<L> {
        let [nodes, speed] = self.get(n, STAGE_START);
        tall::Crossing { nodes, speed }
    }

    #[inline(always)]
    pub fn put_stretch<L: Lane>(&mut self, n: usize, stretch: &low::Stretch<L>) {
        let certain = L::splat(1.0).keep_where(stretch.certain);
        self.put(
            n,
            STAGE_START,
            [stretch.start, stretch.low, stretch.high, certain],
        );
    }

    #[inline(always)]
    pub fn stretch<L: Lane>(&self, n: usize) -> low::Stretch<L> {
        let [start, low, high, certain] = self.get(n, STAGE_START);
        low::Stretch {
            start,
            low,
            high,
            certain: L::splat(0.0).below(certain),
        }
    }

    /// The stretch of one lane of register `n`.
    #[inline(always)]
    pub fn stretch_of<L: Lane>(&self, n: usize, lane: usize) -> low::Stretch<f64> {
        let [start, low, high, certain] = [0, 1, 2, 3]
            .map(|m| self.0.0[(n * QUANTITIES_PER_REGISTER + STAGE_START + m) * L::WIDTH + lane]);
        low::Stretch {
            start,
            low,
            high,
            certain: Lane::below(0.0, certain),
        }
    }

    #[inline(always)]
    pub fn put_guess<L: Lane>(&mut self, n: usize, guess: L) {
        self.put(n, LANDING_ESTIMATE, [guess]);
    }

    #[inline(always)]
    pub fn guess<L: Lane>(&self, n: usize) -> L {
        let [guess] = self.get(n, LANDING_ESTIMATE);
        guess
    }

    #[inline(always)]
    pub fn put_estimate<L: Lane>(&mut self, n: usize, estimate: &LandingEstimate<L>) {
        self.put(n, LANDING_ESTIMATE, [estimate.rounded, estimate.back]);
    }

    #[inline(always)]
    pub fn estimate<L: Lane>(&self, n: usize) -> LandingEstimate<L> {
        let [rounded, back] = self.get(n, LANDING_ESTIMATE);
        LandingEstimate { rounded, back }
    }

    /// Computes the gap near the impact and stores it in the place of the launch.
    #[inline(always)]
    pub fn compute_gap<L: Lane>(&mut self, n: usize) {
        let (rounded, node) = self.node_with_sum(n);
        let (track, launch) = (self.track::<L>(n), self.launch(n));
        let near = GapNearImpact::with_node(&track, &launch, &self.estimate(n), rounded, node);
        let gap = [near.node.distance, near.x, near.value, near.slope];
        self.put(n, GAP, gap);
        self.put(n, GAP_TRACK, [near.sine, near.cosine]);
    }

    /// The gap near the impact.
    #[inline(always)]
    pub fn gap_near_impact<L: Lane>(&self, n: usize) -> GapNearImpact<L> {
        let [distance, x, value, slope] = self.get(n, GAP);
        let [_, back, rounded, sine, cosine] = self.get(n, LANDING_ESTIMATE);
        GapNearImpact::from_stage([back, rounded, distance, x, value, slope, sine, cosine])
    }

    #[inline(always)]
    pub fn put_landing<L: Lane>(&mut self, n: usize, landing: &Landing<L>) {
        let Landing {
            flight,
            phase,
            arrival,
        } = *landing;
        self.put(n, LANDING, [flight, phase, arrival]);
    }

    #[inline(always)]
    pub fn landing<L: Lane>(&self, n: usize) -> Landing<L> {
        let [flight, phase, arrival] = self.get(n, LANDING);
        Landing {
            flight,
            phase,
            arrival,
        }
    }

    /// Replaces the landing of one lane of register `n`.
    #[inline(always)]
    pub fn replace_landing<L: Lane>(&mut self, n: usize, lane: usize, landing: &Landing<f64>) {
        let Landing {
            flight,
            phase,
            arrival,
        } = *landing;
        for (m, value) in [flight, phase, arrival].into_iter().enumerate() {
            self.0.0[(n * QUANTITIES_PER_REGISTER + LANDING + m) * L::WIDTH + lane] = value;
        }
    }
}
