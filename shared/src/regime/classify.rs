//! Regime of a part from the phases of its impacts, by the close-returns method (Lathrop and
//! Kostelich, Phys. Rev. A 40 (1989) 4028).
//!
//! A board measures impact times only, neither velocity nor rest. The classifier stores the last N
//! times. It tests after which number of impacts, and of whole drive cycles, the pattern repeats.
//! Intervals that shrink towards zero indicate a part coming to rest.

use core::f64::consts::TAU;

use super::gear::is_in_gear;
use crate::arithmetic::Phase;
use crate::feeder::{OutOfRange, accept_in};

/// Long-term motion of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Regime {
    /// No impacts: the part rests, or there is none.
    Rest,
    /// It hops, chatters to rest and is thrown off again, in a constant number of cycles.
    HopAndRest {
        /// Drive cycles from rest to rest.
        cycles: u32,
    },
    /// One impact every `order` cycles, at one phase.
    Locked {
        /// Drive cycles per impact (symbol r).
        order: u32,
    },
    /// The period is `2^doublings` impacts of `order` cycles on average.
    Doubled {
        /// Drive cycles per impact (symbol r).
        order: u32,
        /// Number of period doublings.
        doublings: u32,
    },
    /// The period is `impacts` impacts in `cycles` cycles, and no doubling of a lock.
    Periodic {
        /// Impacts in a period (symbol p).
        impacts: u32,
        /// Drive cycles in a period.
        cycles: u32,
    },
    /// No repetition within the memory.
    Chaotic,
    /// Too few impacts, or contradictory ones.
    Undecided,
}

/// A regime and its confidence.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Verdict {
    /// The regime.
    pub regime: Regime,
    /// Confidence, 0..=1: the share of agreeing pairs beyond chance, times the available over the
    /// required number of pairs.
    pub confidence: f32,
}

impl Verdict {
    const fn new(regime: Regime, confidence: f32) -> Self {
        Self { regime, confidence }
    }
}

/// Accuracy of the measured impact times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimingAccuracy {
    /// Standard deviation of an impact's phase in rad, 0..=0.5; 0 for computed impacts.
    pub noise: f64,
    /// Shortest interval at which two impacts are resolved, in rad, 1e-6..=1.
    pub resolution: f64,
}

impl TimingAccuracy {
    /// Accuracy of computed impacts.
    pub const COMPUTED: Self = Self {
        noise: 0.0,
        resolution: 1e-3,
    };

    /// Accuracy on the board at an impact-to-noise ratio of 26 dB and 20 kHz.
    pub const BOARD: Self = Self {
        noise: 0.03,
        resolution: 0.2,
    };
}

/// Drive cycles without impact that indicate rest, beyond three times the longest recent interval.
const MIN_SILENT_CYCLES: u64 = 4;

const COMPARED_RESTS: usize = 4;

/// Drive cycle in units of the classifier's time.
const STEPS_PER_CYCLE: u64 = 1 << 32;

/// Classifier with the last N impact times of one part; it resolves periods up to N/3 impacts.
#[derive(Clone, Copy, Debug)]
pub struct Classifier<const N: usize> {
    /// Largest difference of two times that counts as equal, in 2^-32 cycles.
    tolerance: u32,
    noise: f64,
    resolution: u64,
    /// Impact times in 2^-32 cycles.
    times: [u64; N],
    count: u64,
    now: u64,
    began: u64,
    /// Last interval, and the number of successive shrinking intervals before it.
    interval: u64,
    shrinking: u32,
    resting: bool,
    /// Times of the first impacts after the last rests, newest first.
    launches: [u64; COMPARED_RESTS],
    rests: u32,
}

impl<const N: usize> Classifier<N> {
    /// A classifier without impacts; an error names the parameter out of range.
    pub fn build(settings: TimingAccuracy) -> Result<Self, OutOfRange> {
        let TimingAccuracy { noise, resolution } = settings;
        accept_in("noise", noise, 0.0..=0.5, "0..0.5 rad")?;
        accept_in("resolution", resolution, 1e-6..=1.0, "0.000001..1 rad")?;
        let steps = |radians: f64| radians * (STEPS_PER_CYCLE as f64 / TAU);
        Ok(Self {
            // Three standard deviations of a difference. Without noise, the bound of rounding and
            // of the end of a transient.
            tolerance: steps((3.0 * core::f64::consts::SQRT_2 * noise).max(1e-6)) as u32,
            noise: steps(noise),
            resolution: steps(resolution) as u64,
            times: [0; N],
            count: 0,
            now: 0,
            began: 0,
            interval: 0,
            shrinking: 0,
            resting: false,
            launches: [0; COMPARED_RESTS],
            rests: 0,
        })
    }

    /// Clears all impacts; time continues.
    pub fn forget(&mut self) {
        self.count = 0;
        self.began = self.now;
        self.shrinking = 0;
        self.resting = false;
        self.rests = 0;
    }

    /// Advances the time to the start of drive cycle `cycle`, counted from 0.
    pub fn cycle(&mut self, cycle: u32) {
        self.now = self.now.max(u64::from(cycle) << 32);
    }

    /// Adds an impact in drive cycle `cycle` at `phase`; one before the last impact is ignored.
    pub fn impact(&mut self, cycle: u32, phase: Phase) {
        self.impact_at(u64::from(cycle) << 32 | u64::from(phase.bits()));
    }

    /// Advances the time by `duration` rad of drive phase without an impact.
    pub fn wait(&mut self, duration: f64) {
        self.now = self.after(duration);
    }

    /// Time after a further `duration` rad of drive phase.
    fn after(&self, duration: f64) -> u64 {
        self.now + libm::round(duration.max(0.0) * (STEPS_PER_CYCLE as f64 / TAU)) as u64
    }

    /// Adds an impact after a further `flight` rad of drive phase.
    pub fn flight(&mut self, flight: f64) {
        self.impact_at(self.after(flight));
    }

    fn impact_at(&mut self, time: u64) {
        let last = self.time(0);
        if self.count > 0 && time < last {
            return;
        }
        self.now = self.now.max(time);
        if self.count > 0 {
            let interval = time - last;
            // The tail of a chatter may appear as intervals of about the resolution.
            if self.resting && interval > 3 * self.resolution {
                self.launches.rotate_right(1);
                self.launches[0] = time;
                self.rests = self.rests.saturating_add(1);
                self.resting = false;
            }
            let is_shrinking = self.count > 1 && interval < self.interval;
            self.shrinking = if is_shrinking { self.shrinking + 1 } else { 0 };
            // Chatter intervals shrink geometrically; is the next one below the resolution?
            if self.shrinking >= 2
                && interval < STEPS_PER_CYCLE / 4
                && u128::from(interval) * u128::from(interval)
                    < u128::from(self.resolution) * u128::from(self.interval)
            {
                self.resting = true;
            }
            self.interval = interval;
        }
        self.times[(self.count % N as u64) as usize] = time;
        self.count += 1;
    }

    /// Time of the impact `age` impacts ago.
    fn time(&self, age: usize) -> u64 {
        let index = self.count + 2 * N as u64 - 1 - age as u64;
        self.times[(index % N as u64) as usize]
    }

    /// The regime indicated by the stored times.
    pub fn verdict(&self) -> Verdict {
        let filled = self.count.min(N as u64) as usize;
        let resting = self.detect_rest(filled);
        if let Some(verdict) = resting.or_else(|| self.detect_hop_and_rest()) {
            return verdict;
        }
        let mut best = 0.0_f32;
        for impacts in 1..=filled / 3 {
            let compared = filled - impacts;
            let required = (2 * impacts).max(8);
            if compared < required {
                break;
            }
            let (share, cycles) = self.find_repetition(impacts, filled);
            best = best.max(share);
            if share >= 0.9 && cycles > 0 {
                let enough = (compared as f32 / (2 * required) as f32).min(1.0);
                let regime = self.name_period(impacts as u32, cycles, filled);
                return Verdict::new(regime, self.correct_for_chance(share) * enough);
            }
        }
        let against = 1.0 - self.correct_for_chance(best);
        if filled < N {
            Verdict::new(Regime::Undecided, filled as f32 / N as f32 * 0.5)
        } else if against > 0.5 {
            Verdict::new(Regime::Chaotic, against)
        } else {
            Verdict::new(Regime::Undecided, 0.5)
        }
    }

    fn detect_rest(&self, filled: usize) -> Option<Verdict> {
        let silent = self.now - if filled > 0 { self.time(0) } else { self.began };
        if silent <= MIN_SILENT_CYCLES * STEPS_PER_CYCLE {
            return None;
        }
        let intervals = (1..filled).map(|age| self.time(age - 1) - self.time(age));
        let longest = intervals.max().unwrap_or(STEPS_PER_CYCLE);
        let enough = 3 * longest + MIN_SILENT_CYCLES * STEPS_PER_CYCLE;
        let confidence = (silent as f32 / (2 * enough) as f32).min(1.0);
        (silent > enough).then_some(Verdict::new(Regime::Rest, confidence))
    }

    /// Hop and rest, if the last rests are a constant number of whole cycles apart.
    fn detect_hop_and_rest(&self) -> Option<Verdict> {
        if self.rests < COMPARED_RESTS as u32 {
            return None;
        }
        let period = (self.launches[0] - self.launches[1] + STEPS_PER_CYCLE / 2) / STEPS_PER_CYCLE;
        if period == 0 || self.now - self.launches[0] > 2 * period * STEPS_PER_CYCLE {
            return None;
        }
        let pairs = self.launches.windows(2);
        let is_regular = |pair: &&[u64]| self.is_multiple(pair[0] - pair[1], period);
        let regular = pairs.filter(is_regular).count();
        // One of three intervals may be wrong.
        let cycles = period as u32;
        let confidence = self.correct_for_chance(regular as f32 / (COMPARED_RESTS - 1) as f32);
        let verdict = Verdict::new(Regime::HopAndRest { cycles }, confidence);
        (regular + 1 >= COMPARED_RESTS - 1).then_some(verdict)
    }

    fn is_multiple(&self, duration: u64, cycles: u64) -> bool {
        duration.abs_diff(cycles * STEPS_PER_CYCLE) <= u64::from(self.tolerance)
    }

    /// Share of impacts repeated `impacts` later after one number of whole cycles, and this number.
    fn find_repetition(&self, impacts: usize, filled: usize) -> (f32, u32) {
        let mut best = (0, 0);
        // The newest three pairs propose the number, because one may be wrong.
        for newest in 0..3 {
            let duration = self.time(newest) - self.time(newest + impacts);
            let cycles = (duration + STEPS_PER_CYCLE / 2) / STEPS_PER_CYCLE;
            let agree = (0..filled - impacts)
                .filter(|&age| self.is_multiple(self.time(age) - self.time(age + impacts), cycles))
                .count();
            if agree > best.0 {
                best = (agree, cycles as u32);
            }
            if agree == filled - impacts {
                break;
            }
        }
        (best.0 as f32 / (filled - impacts) as f32, best.1)
    }

    /// Regime of a pattern with a period of `impacts` impacts in `cycles` cycles.
    fn name_period(&self, impacts: u32, cycles: u32, filled: usize) -> Regime {
        let order = cycles / impacts;
        let is_power = impacts.is_power_of_two() && cycles.is_multiple_of(impacts);
        if !is_power || !self.stays_in_gear(impacts as usize, order) {
            return Regime::Periodic { impacts, cycles };
        }
        let doublings = match impacts.trailing_zeros() {
            0 => self.alternates(order, filled).into(),
            doublings => doublings,
        };
        match doublings {
            0 => Regime::Locked { order },
            doublings => Regime::Doubled { order, doublings },
        }
    }

    /// Whether each of the last `impacts` intervals is a flight of `order` cycles, as in a doubled
    /// lock. A part that hops and rests may have as many impacts if its chatter is not resolved.
    fn stays_in_gear(&self, impacts: usize, order: u32) -> bool {
        (0..impacts).all(|age| {
            let interval = (self.time(age) - self.time(age + 1)) as f64;
            is_in_gear(interval / STEPS_PER_CYCLE as f64, f64::from(order))
        })
    }

    /// Detects a doubling smaller than one impact's noise, from the alternating mean of intervals.
    fn alternates(&self, order: u32, filled: usize) -> bool {
        let (mut sum, mut terms) = (0_i64, 0_u32);
        let mut later = self.time(0);
        for age in 1..filled {
            let time = self.time(age);
            let excess = (later - time) as i64 - (u64::from(order) * STEPS_PER_CYCLE) as i64;
            later = time;
            if excess.unsigned_abs() <= u64::from(self.tolerance) {
                sum += if age % 2 == 1 { excess } else { -excess };
                terms += 1;
            }
        }
        // Threshold of four standard deviations; the alternating sum has 2 sigma sqrt(n).
        self.noise > 0.0
            && terms > 15
            && libm::fabs(sum as f64) > 8.0 * self.noise * libm::sqrt(f64::from(terms))
    }

    /// Share of agreement corrected for chance: 0 for random phases, 1 for full agreement.
    fn correct_for_chance(&self, share: f32) -> f32 {
        let chance = (2.0 * self.tolerance as f32 / STEPS_PER_CYCLE as f32).min(0.9);
        ((share - chance) / (1.0 - chance)).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::Noise;
    use crate::impact::{Kernel, Map, Orbit, OrbitEvent};
    use crate::regime::exponent;

    fn verdict(orbit: Orbit<'_>, events: usize) -> Verdict {
        let mut classifier = Classifier::<256>::build(TimingAccuracy::COMPUTED).unwrap();
        for event in orbit.take(3000 + events).skip(3000) {
            match event {
                OrbitEvent::Impact(impact) => classifier.flight(impact.flight),
                rest => classifier.wait(rest.duration()),
            }
        }
        classifier.verdict()
    }

    #[test]
    fn unresolved_chatter_is_no_doubled_lock() {
        // A part that hops and rests: four resolved impacts in four cycles, of which two intervals
        // are no flights of one cycle.
        let mut classifier = Classifier::<64>::build(TimingAccuracy::BOARD).unwrap();
        for flight in [0.25, 1.75, 1.15, 0.85].repeat(16) {
            classifier.flight(flight * TAU);
        }
        let (impacts, cycles) = (4, 4);
        let periodic = Regime::Periodic { impacts, cycles };
        assert_eq!(classifier.verdict().regime, periodic);
    }

    #[test]
    fn computed_orbits_are_classified() {
        let locked = |order| Regime::Locked { order };
        let doubled = |order, doublings| Regime::Doubled { order, doublings };
        for (k, restitution, order, regime) in [
            (0.43, 0.2, 1, locked(1)),
            (0.23, 0.2, 2, locked(2)),
            (0.157, 0.2, 3, locked(3)),
            (0.75, 0.5, 1, locked(1)),
            (0.38, 0.2, 1, doubled(1, 1)),
            (0.363, 0.2, 1, doubled(1, 2)),
            (0.3596, 0.2, 1, doubled(1, 3)),
            (0.35889, 0.2, 1, doubled(1, 4)),
            (0.41, 0.5, 2, doubled(2, 1)),
            (0.35, 0.2, 1, Regime::Chaotic),
            (0.34, 0.2, 1, Regime::Chaotic),
            (0.582, 0.5, 1, Regime::Chaotic),
        ] {
            let map = Map::build(k, restitution).unwrap();
            let start = exponent::start_near_lock(&map, order);
            let actual = verdict(Orbit::new(&map, start), 600);
            assert_eq!(actual.regime, regime, "k {k} R {restitution}: {actual:?}");
            assert!(actual.confidence > 0.9, "k {k} R {restitution}: {actual:?}");
        }
    }

    #[test]
    fn parts_from_rest_hop_and_rest() {
        let from_rest = |k, restitution| {
            let map = Map::build(k, restitution).unwrap();
            verdict(Orbit::from_rest(&map), 2000)
        };
        for (k, restitution) in [(0.43, 0.2), (0.9, 0.5), (0.55, 0.3), (0.97, 0.8)] {
            let actual = from_rest(k, restitution);
            let hops = matches!(actual.regime, Regime::HopAndRest { .. });
            assert!(hops && actual.confidence > 0.9, "{k}: {actual:?}");
        }
        // Just below k = 1 the hop is short: one rest in each cycle.
        let actual = from_rest(0.97, 0.2);
        assert_eq!(actual.regime, Regime::HopAndRest { cycles: 1 });
    }

    #[test]
    fn silence_is_rest_and_few_impacts_are_undecided() {
        let mut classifier = Classifier::<64>::build(TimingAccuracy::BOARD).unwrap();
        assert_eq!(classifier.verdict().regime, Regime::Undecided);
        for cycle in 0..4 {
            classifier.impact(cycle, Phase::from_bits(1 << 28));
        }
        assert_eq!(classifier.verdict().regime, Regime::Undecided);
        classifier.cycle(40);
        let actual = classifier.verdict();
        assert_eq!(actual.regime, Regime::Rest);
        assert!(actual.confidence > 0.9);
        classifier.forget();
        assert_eq!(classifier.verdict().regime, Regime::Undecided);
        classifier.cycle(60);
        assert_eq!(classifier.verdict().regime, Regime::Rest);
    }

    /// Regime of 120 cycles of an orbit with noise, in the board's memory.
    fn regime_in_noise(orbit: Orbit<'_>, seed: u64) -> Regime {
        let settings = TimingAccuracy::BOARD;
        let mut classifier = Classifier::<64>::build(settings).unwrap();
        let mut random = Noise::new(seed);
        let (mut time, mut last) = (0.0, -1.0);
        for event in orbit {
            time += event.duration();
            // Impacts within the resolution merge into one.
            if matches!(event, OrbitEvent::Impact(_)) && time - last > settings.resolution {
                last = time;
                let noise = settings.noise * f64::from(random.gauss());
                let stamp = ((time + noise) / TAU).max(0.0);
                let cycle = libm::floor(stamp);
                classifier.impact(cycle as u32, Phase::from_radians((stamp - cycle) * TAU));
            }
            if time > 120.0 * TAU {
                break;
            }
        }
        classifier.verdict().regime
    }

    #[test]
    fn board_classifies_regimes_in_noise() {
        let (order, doublings) = (1, 1);
        let doubled = Regime::Doubled { order, doublings };
        // Of 300 starts all but 3 were classified right, in the narrow chaos of the last case 93 %.
        // The bound of 30 in 40 is 4.5 standard deviations below.
        for (k, restitution, regime, min_hits) in [
            (0.43, 0.2, Regime::Locked { order }, 38),
            (0.75, 0.5, Regime::Locked { order }, 38),
            (0.38, 0.2, doubled, 38),
            (0.34, 0.2, Regime::Chaotic, 38),
            (0.575, 0.5, Regime::Chaotic, 30),
        ] {
            let map = Map::build(k, restitution).unwrap();
            let is_hit = |seed: &u64| {
                // Each start lies in a different part of the chaos.
                let mut start = exponent::start_near_lock(&map, order);
                start.phase += 1e-7 * *seed as f64;
                regime_in_noise(Orbit::new(&map, start), *seed) == regime
            };
            let hits = (1..=40).filter(is_hit).count();
            assert!(hits >= min_hits, "k {k} R {restitution}: {hits} of 40");
        }
        for (k, restitution) in [(0.43, 0.2), (0.55, 0.3), (0.75, 0.5)] {
            let map = Map::build(k, restitution).unwrap();
            let regimes = (1..=40).map(|seed| regime_in_noise(Orbit::from_rest(&map), seed));
            let hits = regimes.filter(|regime| matches!(regime, Regime::HopAndRest { .. }));
            let hits = hits.count();
            assert!(hits >= 36, "k {k} R {restitution}: {hits} of 40");
        }
    }

    /// Phases alternate by 0.6 standard deviations of their noise, or not at all.
    #[test]
    fn alternation_below_the_noise_is_a_doubled_lock() {
        let settings = TimingAccuracy::BOARD;
        let (order, doublings) = (1, 1);
        let cases = [
            (0.0, Regime::Locked { order }),
            (0.6, Regime::Doubled { order, doublings }),
        ];
        for (share, regime) in cases {
            for seed in 1..=20 {
                let mut classifier = Classifier::<256>::build(settings).unwrap();
                let mut random = Noise::new(seed);
                for cycle in 0..256 {
                    let offset = if cycle % 2 == 0 { share } else { -share };
                    let angle = 1.0 + settings.noise * (offset + f64::from(random.gauss()));
                    classifier.impact(cycle, Phase::from_radians(angle));
                }
                assert_eq!(classifier.verdict().regime, regime, "{share}, seed {seed}");
            }
        }
    }

    #[test]
    fn backward_times_are_ignored() {
        let mut undisturbed = Classifier::<64>::build(TimingAccuracy::BOARD).unwrap();
        let mut disturbed = undisturbed;
        for cycle in 1..100 {
            undisturbed.impact(cycle, Phase::ZERO);
            disturbed.impact(cycle, Phase::ZERO);
            disturbed.impact(cycle / 2, Phase::from_bits(77));
            assert_eq!(disturbed.verdict(), undisturbed.verdict(), "{cycle}");
        }
        assert_eq!(undisturbed.verdict().regime, Regime::Locked { order: 1 });
    }

    #[test]
    fn refusals_name_the_parameter() {
        for (noise, resolution, parameter) in [(-0.1, 0.1, "noise"), (0.1, 0.0, "resolution")] {
            let refused = Classifier::<64>::build(TimingAccuracy { noise, resolution });
            assert_eq!(refused.unwrap_err().parameter, parameter);
        }
    }
}
