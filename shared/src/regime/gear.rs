//! Gear: one flight every r drive periods, also when doubled or chaotic, and the share of time in
//! it (docs/theory-real-parts.md#t10.1).
//!
//! The detector is a run rule: 8 successive flights within a tolerance begin gear, one other flight
//! or a rest ends it. The share is a Monte Carlo estimate over parts with scattered restitution.

#[cfg(feature = "control")]
mod draw;
#[cfg(feature = "control")]
mod fit;
#[cfg(feature = "control")]
mod limits;
#[cfg(feature = "control")]
mod plan;
#[cfg(feature = "control")]
mod rider;
#[cfg(feature = "control")]
mod strikes;

use core::f64::consts::TAU;
use core::ops::AddAssign;

use super::lock::accept_order;
#[cfg(any(test, feature = "control"))]
use crate::arithmetic::Phase;
use crate::feeder::{OutOfRange, accept};
use crate::impact::{Next, OrbitEvent, Scatter, WaveMap, WavePart};

#[cfg(feature = "control")]
pub(crate) use limits::{GearLimits, peaks};
#[cfg(feature = "control")]
pub(crate) use plan::{GearPlan, GearPlanSettings, GearPlanner};
#[cfg(feature = "control")]
pub(crate) use rider::Tones;
#[cfg(all(feature = "control", any(test, feature = "unstable")))]
pub use strikes::StrikeCount;
#[cfg(feature = "control")]
pub(crate) use strikes::{GROUPS, PLACES, StrikeProfile, StrikeProfiler, StrikeSettings, WIDE};

/// Shortest and longest flight in gear, over r drive periods.
pub(crate) const FLIGHTS: [f64; 2] = [0.6, 1.4];

/// Successive flights within [`FLIGHTS`] that begin gear.
const ROW: u32 = 8;

/// Whether a flight lies within 0.6 to 1.4 times `period`, the r drive periods of its order, both
/// in the same unit.
#[must_use]
#[inline]
pub fn is_in_gear(flight: f64, period: f64) -> bool {
    FLIGHTS[0] * period < flight && flight < FLIGHTS[1] * period
}

/// Gear detector of one order, fed with flights and rests.
///
/// Gear lasts from the first of at least 8 successive flights within 0.6 to 1.4 times r drive
/// periods. It ends at the first other flight or rest. The mean flight is then r periods, so the
/// mean arrival speed is that of the lock.
///
/// Times are in rad of the drive, in `Gear<i64>` in steps of 2^-32 turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gear<T = f64> {
    shortest: T,
    longest: T,
    row: u32,
    /// Duration of the current run of flights.
    duration: T,
    losses: u64,
}

impl Gear {
    /// Detector of an order, 1..=100 drive periods a flight.
    pub(crate) fn build(order: u32) -> Result<Self, OutOfRange> {
        let period = TAU * accept_order(order)?;
        Ok(Self::between(FLIGHTS.map(|share| share * period)))
    }
}

#[cfg(any(test, feature = "control"))]
impl Gear<i64> {
    /// Detector of an order, 1..=100 drive periods a flight, with times in steps of 2^-32 turns.
    pub(crate) fn in_steps(order: u32) -> Result<Self, OutOfRange> {
        let period = Phase::TURN * accept_order(order)?;
        Ok(Self::between(FLIGHTS.map(|share| (share * period) as i64)))
    }
}

impl<T: Copy + Default + PartialOrd + AddAssign> Gear<T> {
    fn between([shortest, longest]: [T; 2]) -> Self {
        Self {
            shortest,
            longest,
            row: 0,
            duration: T::default(),
            losses: 0,
        }
    }

    /// Whether the part is in gear.
    #[must_use]
    pub(crate) fn is_in(&self) -> bool {
        self.row >= ROW
    }

    /// Number of losses of gear.
    #[must_use]
    pub(crate) fn losses(&self) -> u64 {
        self.losses
    }

    /// Adds a flight and returns the time in gear that it adds; the eighth adds the duration of all
    /// eight.
    pub(crate) fn flight(&mut self, flight: T) -> T {
        if !(self.shortest < flight && flight < self.longest) {
            self.lose();
            return T::default();
        }
        self.row = self.row.saturating_add(1);
        self.duration += flight;
        match self.row {
            row if row < ROW => T::default(),
            ROW => self.duration,
            _ => flight,
        }
    }

    /// Adds a rest, which ends gear.
    pub(crate) fn rest(&mut self) {
        self.lose();
    }

    fn lose(&mut self) {
        self.losses += u64::from(self.is_in());
        self.row = 0;
        self.duration = T::default();
    }
}

/// Time in gear and losses of gear over an observation time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// Time in gear in drive periods.
    pub in_gear: f64,
    /// Observation time in drive periods.
    pub watched: f64,
    /// Losses of gear in that time.
    pub losses: u64,
}

impl Share {
    /// Share of time in gear, 0..=1; 0 without observation time.
    #[must_use]
    pub fn share(&self) -> f64 {
        if self.watched > 0.0 {
            (self.in_gear / self.watched).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    /// Mean time in gear before a loss, in drive periods; `None` without a loss.
    #[must_use]
    pub fn time_to_loss(&self) -> Option<f64> {
        (self.losses > 0).then(|| self.in_gear / self.losses as f64)
    }

    /// Sum of two observations.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        Self {
            in_gear: self.in_gear + other.in_gear,
            watched: self.watched + other.watched,
            losses: self.losses + other.losses,
        }
    }
}

/// Measures one part's time in gear from its flights and rests. It counts from [`GearWatch::begin`]
/// on.
///
/// ```
/// use core::f64::consts::TAU;
/// use kband::regime::gear::GearWatch;
/// let mut watch = GearWatch::build(1)?;
/// watch.begin(5.0 * TAU);
/// // Twenty flights of one period each, of which the last fifteen count.
/// for landed in 1..=20 {
///     watch.landed(f64::from(landed) * TAU, TAU);
/// }
/// watch.rested(20.0 * TAU);
/// let share = watch.share(25.0 * TAU);
/// assert!((share.share() - 0.75).abs() < 1e-12 && share.losses == 1);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearWatch {
    gear: Gear,
    begin: f64,
    end: f64,
    in_gear: f64,
    lost_before: u64,
}

impl GearWatch {
    /// A watch of an order, 1..=100 drive periods a flight.
    pub fn build(order: u32) -> Result<Self, OutOfRange> {
        Ok(Self {
            gear: Gear::build(order)?,
            begin: f64::INFINITY,
            end: f64::INFINITY,
            in_gear: 0.0,
            lost_before: 0,
        })
    }

    /// Begins to count at time `now` in rad of drive phase.
    pub fn begin(&mut self, now: f64) {
        self.begin = now;
        self.in_gear = 0.0;
        self.lost_before = self.gear.losses();
    }

    /// Ends the count at time `now` in rad of drive phase.
    pub(crate) fn end(&mut self, now: f64) {
        self.end = now;
    }

    /// Adds a landing at `time` after a `flight`, both in rad of drive phase.
    pub fn landed(&mut self, time: f64, flight: f64) {
        let added = self.gear.flight(flight);
        let from = (time - added).max(self.begin);
        self.in_gear += (time.min(self.end) - from).max(0.0);
        self.pass(time);
    }

    /// Adds a rest that began at `time` in rad of drive phase.
    pub fn rested(&mut self, time: f64) {
        self.gear.rest();
        self.pass(time);
    }

    fn pass(&mut self, time: f64) {
        if time <= self.begin {
            self.lost_before = self.gear.losses();
        }
    }

    /// Time in gear and losses up to `now` in rad of drive phase.
    #[must_use]
    pub fn share(&self, now: f64) -> Share {
        Share {
            in_gear: self.in_gear / TAU,
            watched: (now.min(self.end) - self.begin).max(0.0) / TAU,
            losses: self.gear.losses() - self.lost_before,
        }
    }
}

/// Follows parts that start at rest for `periods` of the drive, 16..=1e7, each with the restitutions that a `scatter`
/// draws; `each` is told the number of each part and for how much of the last three quarters of that time it was in gear of
/// this order.
///
/// `each` receives the index of a part and its time in gear of this order over the last three
/// quarters of the time. `map` gives wave and k; its restitution is unused. A chatter is summed at
/// the mean restitution. A part at rest for ever is out of gear.
pub fn shares_from_rest(
    map: &WaveMap,
    scatters: &[Scatter],
    order: u32,
    periods: f64,
    mut each: impl FnMut(usize, Share),
) -> Result<(), OutOfRange> {
    accept(
        "periods",
        periods,
        (16.0..=1e7).contains(&periods),
        "16..1e7 drive periods",
    )?;
    let mut gear = GearWatch::build(order)?;
    gear.begin(0.25 * periods * TAU);
    gear.end(periods * TAU);
    let watch = Watch {
        gear,
        time: 0.0,
        end: periods * TAU,
    };
    for (n, scatter) in scatters.iter().enumerate() {
        let (mut scatter, mut watch) = (*scatter, watch);
        let mut part = WavePart::at_rest(scatter.mean(), 0.0);
        while watch.time < watch.end {
            let event = match part.next(map) {
                None => break,
                Some(Next::Contact(event)) => event,
                Some(Next::Flight(launch)) => part.land(map.elastic_impact(launch), scatter.draw()),
            };
            watch.see(&event);
        }
        each(n, watch.gear.share(watch.end));
    }
    Ok(())
}

/// One part's time in gear up to an end.
#[derive(Clone, Copy)]
struct Watch {
    gear: GearWatch,
    time: f64,
    end: f64,
}

impl Watch {
    fn see(&mut self, event: &OrbitEvent) {
        match event {
            OrbitEvent::Impact(impact) => {
                self.time += impact.flight;
                self.gear.landed(self.time, impact.flight);
            }
            OrbitEvent::Rest { chatter, .. } => {
                self.time += chatter;
                self.gear.rested(self.time);
            }
            OrbitEvent::LiftOff { wait, .. } => self.time += wait,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Tone, Wave};

    #[test]
    fn gear_begins_with_eight_flights_and_ends_with_a_wrong_one_or_a_rest() {
        let mut gear = Gear::build(2).unwrap();
        let period = 2.0 * TAU;
        for n in 0..8 {
            assert!(!gear.is_in());
            let added = gear.flight(period * if n % 2 == 0 { 0.65 } else { 1.35 });
            assert_eq!(added > 0.0, n == 7);
            if n == 7 {
                assert!((added - 8.0 * period).abs() < 1e-12);
            }
        }
        assert!(gear.is_in() && gear.flight(period) == period);
        assert!(gear.flight(1.41 * period) == 0.0 && !gear.is_in() && gear.losses() == 1);
        for _ in 0..20 {
            gear.flight(period);
        }
        gear.rest();
        assert!(!gear.is_in() && gear.losses() == 2);
        gear.rest();
        assert_eq!(gear.losses(), 2);
    }

    fn share(wave: &Wave, k: f64, restitution: f64, deviation: f64) -> Share {
        let map = WaveMap::on(*wave, k, restitution).unwrap();
        let scatters: [Scatter; 20] = core::array::from_fn(|seed| {
            Scatter::build(restitution, deviation, seed as u64).unwrap()
        });
        let mut sum = Share::default();
        shares_from_rest(&map, &scatters, 1, 1000.0, |_, share| sum = sum.and(&share)).unwrap();
        sum
    }

    /// Shares by a sketch in C of its own map, generator and bookkeeping, over 20 runs of 1000 periods each. Both
    /// scatter: by 0.01 where a loss comes every 30 periods.
    #[test]
    fn shares_are_those_of_an_independent_program() {
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
            let tone = |amplitude, angle| Tone { amplitude, angle };
            let wave = Wave::build(tone(e, th), tone(e3, th3)).unwrap();
            let found = share(&wave, k, restitution, deviation);
            assert!((found.share() - expected).abs() < 0.03, "{k} {found:?}");
        }
    }

    #[test]
    fn without_scatter_a_locked_part_is_in_gear_and_a_resting_one_is_not() {
        let sine = Wave::sine();
        // The launch from rest locks.
        let locked = share(&sine, 0.405, 0.2, 0.0);
        assert_eq!((locked.share(), locked.time_to_loss()), (1.0, None));
        assert_eq!(share(&sine, 0.43, 0.2, 0.0).share(), 0.0);
        // It rests for ever.
        assert_eq!(share(&sine, 1.2, 0.2, 0.05).share(), 0.0);
    }

    #[test]
    fn what_cannot_be_watched_is_refused() {
        let map = WaveMap::on(Wave::sine(), 0.4, 0.2).unwrap();
        let refused = |order, periods| {
            let told = |_, _| panic!("nothing is followed");
            let scatters = [Scatter::build(0.2, 0.0, 0).unwrap()];
            shares_from_rest(&map, &scatters, order, periods, told).unwrap_err()
        };
        assert_eq!(refused(0, 100.0).parameter, "order");
        assert_eq!(refused(1, 10.0).parameter, "periods");
    }
}
