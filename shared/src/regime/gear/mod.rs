//! Gear: one flight every r drive periods, also when doubled or chaotic, and the share of time in
//! it (docs/theory-real-parts.md#t10.1).
//!
//! The detector is a run rule: 8 successive flights within a tolerance begin gear, one other flight
//! or a rest ends it. The share is a Monte Carlo estimate over parts with scattered restitution.

mod draw;
mod fit;
mod limits;
mod part;
mod plan;
mod strikes;

use core::f64::consts::TAU;
use core::ops::AddAssign;

use super::lock::accept_order;
use crate::arithmetic::Phase;
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::{ContactTime, Orbit, OrbitEvent, PartState, Scatter, WaveMap};

pub use limits::{GearLimits, peaks};
pub use part::Tones;
pub use plan::{GEAR_BAND_LOSS, GearPlan, GearPlanSettings, GearPlanner};
pub use strikes::{GROUPS, PHASE_BINS, RESTITUTION_MARGIN};
pub use strikes::{StrikeCount, StrikeProfile, StrikeProfiler, StrikeSettings};

/// Shortest and longest flight in gear, over r drive periods.
pub const FLIGHT_RANGE: [f64; 2] = [0.6, 1.4];

/// Successive flights within [`FLIGHT_RANGE`] that begin gear.
const MIN_FLIGHTS_IN_GEAR: u32 = 8;

/// Whether a flight lies within 0.6 to 1.4 times `period`, the r drive periods of its order, both
/// in the same unit.
#[inline]
pub fn is_in_gear(flight: f64, period: f64) -> bool {
    FLIGHT_RANGE[0] * period < flight && flight < FLIGHT_RANGE[1] * period
}

/// Gear detector of one order, fed with flights and rests.
///
/// Gear lasts from the first of at least 8 successive flights within 0.6 to 1.4 times r drive
/// periods. It ends at the first other flight or rest. The mean flight is then r periods, so the
/// mean arrival speed is that of the lock.
///
/// Times are in rad of the drive, in `GearDetector<i64>` in steps of 2^-32 turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GearDetector<T = f64> {
    shortest: T,
    longest: T,
    flights: u32,
    duration: T,
    losses: u64,
}

impl GearDetector {
    /// Detector of an order, 1..=100 drive periods a flight.
    pub(crate) fn build(order: u32) -> Result<Self, OutOfRange> {
        let period = TAU * accept_order(order)?;
        Ok(Self::from_range(FLIGHT_RANGE.map(|share| share * period)))
    }
}

impl GearDetector<i64> {
    /// Detector of an order, 1..=100 drive periods a flight, with times in steps of 2^-32 turns.
    pub(crate) fn build_in_steps(order: u32) -> Result<Self, OutOfRange> {
        let period = Phase::TURN * accept_order(order)?;
        let range = FLIGHT_RANGE.map(|share| (share * period) as i64);
        Ok(Self::from_range(range))
    }
}

impl<T: Copy + Default + PartialOrd + AddAssign> GearDetector<T> {
    fn from_range([shortest, longest]: [T; 2]) -> Self {
        Self {
            shortest,
            longest,
            flights: 0,
            duration: T::default(),
            losses: 0,
        }
    }

    pub(crate) fn is_in_gear(&self) -> bool {
        self.flights >= MIN_FLIGHTS_IN_GEAR
    }

    /// Adds a flight and returns the time in gear that it adds; the eighth adds all eight.
    pub(crate) fn add_flight(&mut self, flight: T) -> T {
        if !(self.shortest < flight && flight < self.longest) {
            self.add_rest();
            return T::default();
        }
        self.flights = self.flights.saturating_add(1);
        self.duration += flight;
        match self.flights {
            flights if flights < MIN_FLIGHTS_IN_GEAR => T::default(),
            MIN_FLIGHTS_IN_GEAR => self.duration,
            _ => flight,
        }
    }

    pub(crate) fn add_rest(&mut self) {
        self.losses += u64::from(self.is_in_gear());
        self.flights = 0;
        self.duration = T::default();
    }
}

/// Time in gear and losses of gear over an observation time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// Time in gear in drive periods.
    pub in_gear: f64,
    observed: f64,
    /// Losses of gear in that time.
    pub losses: u64,
    /// Part of the observation time before the first gear, in drive periods.
    before: f64,
    /// Time from the start of the simulation to the first gear, or to its end, in drive periods.
    waited: f64,
    captured: u64,
}

impl Share {
    /// Share of time in gear, 0..=1; 0 without observation time.
    pub fn share(&self) -> f64 {
        if self.observed > 0.0 {
            (self.in_gear / self.observed).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    /// Share of time in gear after the first gear, 0..=1; `None` without gear.
    pub fn share_after_capture(&self) -> Option<f64> {
        let after = self.observed - self.before;
        (after > 0.0 && self.captured > 0).then(|| (self.in_gear / after).clamp(0.0, 1.0))
    }

    /// Mean time from the start to the first gear, in drive periods; `None` without gear. It is the
    /// waiting time of all parts, captured or not, over the number of captures.
    pub fn time_to_capture(&self) -> Option<f64> {
        (self.captured > 0).then(|| self.waited / self.captured as f64)
    }

    /// Mean time in gear before a loss, in drive periods; `None` without a loss. Its relative error
    /// is 1 over the root of the losses, which are a Poisson process.
    pub fn time_to_loss(&self) -> Option<f64> {
        (self.losses > 0).then(|| self.in_gear / self.losses as f64)
    }

    /// Sum of two observations.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            in_gear: self.in_gear + other.in_gear,
            observed: self.observed + other.observed,
            losses: self.losses + other.losses,
            before: self.before + other.before,
            waited: self.waited + other.waited,
            captured: self.captured + other.captured,
        }
    }
}

/// Measures one part's time in gear from its flights and rests, from [`GearWatch::begin`] on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearWatch {
    gear: GearDetector,
    begin: f64,
    end: f64,
    in_gear: f64,
    losses_before: u64,
    /// Time at which the first gear began; infinite before.
    captured: f64,
}

impl GearWatch {
    /// A timer of an order, 1..=100 drive periods a flight.
    pub fn build(order: u32) -> Result<Self, OutOfRange> {
        Ok(Self {
            gear: GearDetector::build(order)?,
            begin: f64::INFINITY,
            end: f64::INFINITY,
            in_gear: 0.0,
            losses_before: 0,
            captured: f64::INFINITY,
        })
    }

    /// Begins to count at time `now` in rad of drive phase.
    pub fn begin(&mut self, now: f64) {
        self.begin = now;
        self.in_gear = 0.0;
        self.losses_before = self.gear.losses;
    }

    /// Adds a landing at `time` after a `flight`, both in rad of drive phase.
    pub fn add_landing(&mut self, time: f64, flight: f64) {
        let added = self.gear.add_flight(flight);
        if added > 0.0 {
            self.captured = self.captured.min(time - added);
        }
        let from = (time - added).max(self.begin);
        self.in_gear += (time.min(self.end) - from).max(0.0);
        self.update_losses_before(time);
    }

    /// Adds a rest that began at `time` in rad of drive phase.
    pub fn add_rest(&mut self, time: f64) {
        self.gear.add_rest();
        self.update_losses_before(time);
    }

    fn update_losses_before(&mut self, time: f64) {
        if time <= self.begin {
            self.losses_before = self.gear.losses;
        }
    }

    /// Time in gear and losses up to `now` in rad of drive phase.
    pub fn share(&self, now: f64) -> Share {
        let end = now.min(self.end);
        let waited = self.captured.min(end);
        Share {
            in_gear: self.in_gear / TAU,
            observed: (end - self.begin).max(0.0) / TAU,
            losses: self.gear.losses - self.losses_before,
            before: (waited - self.begin).max(0.0) / TAU,
            waited: waited / TAU,
            captured: u64::from(self.captured < end),
        }
    }
}

/// Simulates parts from rest for `periods` drive periods (16..=1e7), one per entry of `scatters`.
///
/// `each` receives the index of a part and its time in gear of this order over the last three
/// quarters of the time. `map` gives wave and k; its restitution is unused. A chatter is summed at
/// the mean restitution, within 1e-4 rad. A part at rest for ever is out of gear.
pub fn shares_from_rest(
    map: &WaveMap,
    contact: ContactTime,
    scatters: &[Scatter],
    order: u32,
    periods: f64,
    mut each: impl FnMut(usize, Share),
) -> Result<(), OutOfRange> {
    let map = map.with_coarse_chatter();
    let orbit = Orbit::from_rest(&map).with_contact(contact);
    let each = |n, share, _, ()| each(n, share);
    watch_from_rest(orbit, scatters, order, periods, (), |_, _, _, _| {}, each)
}

/// As [`shares_from_rest`]. `watch` receives the time before each event, the state there and the
/// event; `each` also receives the time at the end. Both have a `record` of each part. The map of
/// the orbit sums chatters coarsely.
pub(crate) fn watch_from_rest<R: Clone>(
    mut orbit: Orbit<'_, WaveMap>,
    scatters: &[Scatter],
    order: u32,
    periods: f64,
    record: R,
    watch: impl Fn(&mut R, f64, PartState, &OrbitEvent),
    mut each: impl FnMut(usize, Share, f64, R),
) -> Result<(), OutOfRange> {
    accept_in("periods", periods, 16.0..=1e7, "16..1e7 drive periods")?;
    let (begin, end) = (0.25 * periods * TAU, periods * TAU);
    let mut gear_watch = GearWatch::build(order)?;
    gear_watch.begin(begin);
    gear_watch.end = end;
    for (n, scatter) in scatters.iter().enumerate() {
        let (mut gear, mut time, mut record) = (gear_watch, 0.0, record.clone());
        orbit.restart(*scatter);
        while time < end {
            let before = orbit.state();
            let Some(event) = orbit.next() else { break };
            watch(&mut record, time, before, &event);
            time += event.duration();
            match event {
                OrbitEvent::Impact(impact) => gear.add_landing(time, impact.flight),
                OrbitEvent::Rest { .. } => gear.add_rest(time),
                OrbitEvent::LiftOff { .. } => {}
            }
        }
        each(n, gear.share(end), time, record);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Tone, Wave};

    #[test]
    fn a_flight_at_the_end_of_the_range_is_out_of_gear() {
        let mut gear = GearDetector::<i64>::build_in_steps(1).unwrap();
        for (flight, counts) in [
            (gear.shortest, false),
            (gear.longest, false),
            (1 << 32, true),
        ] {
            (0..8).for_each(|_| _ = gear.add_flight(flight));
            assert_eq!(gear.is_in_gear(), counts, "{flight}");
        }
    }

    #[test]
    fn gear_begins_after_eight_flights_and_ends_at_a_rest() {
        let mut gear = GearDetector::build(2).unwrap();
        let period = 2.0 * TAU;
        for n in 0..8 {
            assert!(!gear.is_in_gear());
            let added = gear.add_flight(period * if n % 2 == 0 { 0.65 } else { 1.35 });
            assert_eq!(added > 0.0, n == 7);
            if n == 7 {
                assert!((added - 8.0 * period).abs() < 1e-12);
            }
        }
        assert!(gear.is_in_gear() && gear.add_flight(period) == period);
        assert!(gear.add_flight(1.41 * period) == 0.0 && !gear.is_in_gear() && gear.losses == 1);
        for _ in 0..20 {
            gear.add_flight(period);
        }
        gear.add_rest();
        assert!(!gear.is_in_gear() && gear.losses == 2);
        gear.add_rest();
        assert_eq!(gear.losses, 2);
    }

    /// Share of N runs of 1000 periods from successive seeds.
    fn watched<const N: usize>(
        map: &WaveMap,
        contact: ContactTime,
        deviation: f64,
        first_seed: u64,
    ) -> Share {
        let scatters: [Scatter; N] = core::array::from_fn(|n| {
            Scatter::build(map.restitution(), deviation, first_seed + n as u64).unwrap()
        });
        let mut sum = Share::default();
        let add = |_, share: Share| sum = sum.plus(&share);
        shares_from_rest(map, contact, &scatters, 1, 1000.0, add).unwrap();
        sum
    }

    fn share(wave: &Wave, k: f64, restitution: f64, deviation: f64) -> Share {
        let map = WaveMap::on(*wave, k, restitution).unwrap();
        watched::<20>(&map, ContactTime::INSTANT, deviation, 0)
    }

    /// Shares from a separate C program with its own map and generator, over 20 runs of 1000
    /// periods each. Both vary by 0.01 if gear is lost every 30 periods.
    #[test]
    fn shares_match_an_independent_program() {
        for (restitution, deviation, k, [e, th, e3, th3], expected) in [
            (0.3, 0.05, 0.45, [0.0; 4], 0.811),
            (0.3, 0.05, 0.523, [0.0; 4], 0.0),
            (0.3, 0.10, 0.44, [0.0; 4], 0.459),
            (0.2, 0.05, 0.41, [0.0; 4], 0.935),
            (0.5, 0.06, 0.54, [0.0; 4], 0.290),
            (0.3, 0.10, 0.42, [0.15, 2.487, 0.0, 0.0], 0.938),
            (0.5, 0.10, 0.46, [0.15, 2.356, 0.0, 0.0], 0.704),
            (0.5, 0.10, 0.573, [0.23, 2.60, 0.0, 0.0], 0.945),
            (0.5, 0.10, 0.55, [0.274, 2.73, 0.07, 5.74], 0.982),
        ] {
            let wave = Wave::build(Tone::new(e, th), Tone::new(e3, th3)).unwrap();
            let actual = share(&wave, k, restitution, deviation);
            assert!((actual.share() - expected).abs() < 0.03, "{k} {actual:?}");
        }
    }

    /// Contacts of 2 % of the cycle change the share by up to 0.27.
    #[test]
    fn shares_with_contact_agree_in_f64_and_f32() {
        let contact = ContactTime::build(0.02 * TAU).unwrap();
        for (restitution, deviation, k) in [
            (0.2, 0.05, 0.40),
            (0.3, 0.05, 0.45),
            (0.3, 0.05, 0.48),
            (0.4, 0.05, 0.50),
            (0.5, 0.05, 0.56),
            (0.3, 0.10, 0.44),
        ] {
            let map = WaveMap::on(Wave::sine(), k, restitution).unwrap();
            let double = watched::<160>(&map, contact, deviation, 100).share();
            let track = part::TrackMap::build(k as f32, [[0.0; 2]; 2]).unwrap();
            let track = track.with_contact(contact.radians() as f32);
            let span = part::Span::from_periods(1000, 250);
            let mut single = 0.0;
            for seed in 0..160 {
                let draw = draw::Draw::new(restitution as f32, deviation as f32, seed);
                let gear = GearDetector::build_in_steps(1).unwrap();
                let mut part = part::SimulatedPart::new(draw, gear, span);
                while !part.simulate_flight(&track, |_| {}) {}
                single += f64::from(part.share()) / 160.0;
            }
            // Means of 160 runs scatter by 0.006; those of 1000 runs agree within 0.004.
            assert!((single - double).abs() < 0.02, "{k}: {single} {double}");
        }
    }

    /// R 0.55 on two tones is slow to capture, and then never lost.
    #[test]
    fn time_to_capture_is_apart_from_the_share_after_it() {
        let second = Tone::new(0.15, 2.356);
        let wave = Wave::build(second, Tone::default()).unwrap();
        let actual = share(&wave, 0.585, 0.55, 0.03);
        let after = actual.share_after_capture().unwrap();
        let waited = actual.time_to_capture().unwrap();
        assert!(actual.share() < 0.99 && after > 0.999, "{actual:?}");
        assert!(waited > 100.0 && actual.captured == 20, "{actual:?}");
        let unlocked = share(&Wave::sine(), 1.2, 0.2, 0.05);
        assert_eq!(unlocked.share_after_capture(), None);
        assert_eq!(unlocked.time_to_capture(), None);
        assert!((unlocked.waited - 20_000.0).abs() < 1e-6, "{unlocked:?}");
    }

    #[test]
    fn order_and_periods_out_of_range_are_refused() {
        let map = WaveMap::on(Wave::sine(), 0.4, 0.2).unwrap();
        let refused = |order, periods| {
            let each = |_, _| panic!("no part is simulated");
            let scatters = [Scatter::build(0.2, 0.0, 0).unwrap()];
            shares_from_rest(&map, ContactTime::INSTANT, &scatters, order, periods, each)
                .unwrap_err()
        };
        assert_eq!(refused(0, 100.0).parameter, "order");
        assert_eq!(refused(1, 10.0).parameter, "periods");
    }
}
