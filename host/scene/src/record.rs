//! Record of a run, sufficient to evaluate and draw a run of any duration.

use std::f64::consts::TAU;

use kband::arithmetic::Phase;
use kband::regime::gear::{GearWatch, Share};
use kband_control::{Event, Load, Report, State};
use kband_plant::{Moment, PARTS, Sample, Strike};

use super::engine::{Glance, Lot};
use crate::refusal::Refusal;

/// Start of the statistics of gear and speed, in s; the first kicks are over by then.
pub const STATISTICS_START: f64 = 5.0;
/// Duration of the evaluated end of a scene, s.
pub(crate) const END_PERIOD: f64 = 1.0;
/// Windows before the end for the regime of a part, s. 6 s have enough impacts to detect chaos.
/// In 3 s rest differs from the slowest hopping. In 1.5 s a lock of order 8 repeats enough.
pub(crate) const IMPACT_WINDOWS: [f64; 3] = [6.0, 3.0, 1.5];

/// Receives an item; a refusal ends the run.
pub type Take<'a, T> = &'a mut dyn FnMut(&T) -> Result<(), Refusal>;

/// Optional results of a run; only selected ones are computed.
#[derive(Default)]
pub struct Watch<'a> {
    /// Whether a picture is drawn.
    pub drawn: bool,
    /// Whether the controller estimates the regime at the end even if it does not act on it.
    pub regime: bool,
    /// Whether every cycle is kept.
    pub all_cycles: bool,
    /// Receives every cycle.
    pub cycle: Option<Take<'a, Moment>>,
    /// Receives every sample of the last cycles, at waveform fidelity.
    pub sample: Option<Take<'a, Sample>>,
}

impl Watch<'_> {
    /// Drawn, with the estimated regime.
    pub const FOR_PICTURE: Self = Self {
        drawn: true,
        regime: true,
        all_cycles: false,
        cycle: None,
        sample: None,
    };

    /// With every cycle and the estimated regime.
    pub const ALL_CYCLES: Self = Self {
        drawn: false,
        all_cycles: true,
        ..Self::FOR_PICTURE
    };
}

/// An event with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedEvent {
    /// Time in s.
    pub time: f64,
    /// What happened.
    pub event: Event,
    /// Report of the cycle of the event.
    pub report: Report,
}

impl TimedEvent {
    /// Name of the event; a fault has its number and name.
    pub fn name(&self) -> String {
        match (self.event, self.report.fault) {
            (Event::Faulted, Some(fault)) => format!("fault {}: {}", fault.number(), fault.name()),
            (event, _) => event.name().into(),
        }
    }
}

/// The record of a run.
#[derive(Clone, Debug, Default)]
pub struct Record {
    duration: f64,
    pub(crate) cycles: u32,
    pub(crate) last: Option<Moment>,
    pub(crate) events: Vec<TimedEvent>,
    /// Present state, and the time in s since which it is held.
    pub(crate) held: Option<(State, f64)>,
    /// Cycles of the last second.
    pub(crate) end: Vec<Moment>,
    /// Time in gear of each part, and the start of the statistics.
    gear: Vec<GearWatch>,
    settled: Option<StatisticsStart>,
    /// Sums of the estimated shares of time in gear and of their errors; cycles with an estimate.
    shares: f64,
    errors: f64,
    estimated_cycles: u32,
    /// Lot of the last plan for gear; the estimated lot if the parts changed.
    pub gear_lot: Option<Lot>,
    /// Impacts of the last 6 s, with the time at the end of their cycle in s.
    pub(crate) late: Vec<(f64, Strike)>,
    /// Every cycle, if [`Watch::all_cycles`] was set.
    pub(crate) all_cycles: Option<Vec<Moment>>,
    /// The run, reduced for a picture.
    pub sketch: Option<Sketch>,
}

#[derive(Clone, Copy, Debug)]
struct StatisticsStart {
    time: f64,
    cycles: u32,
    displacement: f64,
}

/// Adds an impact to the time in gear of its part.
pub fn add_strike(gear: &mut GearWatch, strike: &Strike) {
    let landed = strike.time as f64 / Phase::TURN * TAU;
    let flight = f64::from(strike.flight) * TAU;
    if strike.rested {
        gear.add_rest(landed - flight);
    }
    gear.add_landing(landed, flight);
}

impl Record {
    pub(crate) fn new(
        duration: f64,
        cycles: usize,
        parts: usize,
        order: u32,
        watch: &Watch<'_>,
    ) -> Self {
        // Gear is undefined for an order out of range.
        let gear = GearWatch::build(order);
        Self {
            gear: gear.map_or_else(|_| Vec::new(), |gear| vec![gear; parts]),
            duration,
            all_cycles: watch.all_cycles.then(|| Vec::with_capacity(cycles)),
            sketch: watch.drawn.then(|| Sketch::new(cycles)),
            ..Self::default()
        }
    }

    /// Whether the displacement is needed for the speed at the end, which settles meanwhile.
    pub(crate) fn ends(&self, time: f64) -> bool {
        time > self.duration - 2.0 * END_PERIOD
    }

    /// Adds a cycle; `moment` computes the complete cycle if it is kept.
    #[inline]
    pub(crate) fn take(
        &mut self,
        glance: &Glance,
        strikes: &[Strike],
        moment: impl Fn() -> Option<Moment>,
    ) {
        self.cycles += 1;
        let time = glance.time;
        if self.held.is_none_or(|(held, _)| held != glance.state) {
            self.held = Some((glance.state, time));
        }
        for strike in strikes {
            if let Some(gear) = self.gear.get_mut(usize::from(strike.part)) {
                add_strike(gear, strike);
            }
        }
        if self.settled.is_some() {
            if glance.error.is_finite() {
                self.shares += f64::from(glance.in_gear);
                self.errors += f64::from(glance.error);
                self.estimated_cycles += 1;
            }
        } else if time >= STATISTICS_START && time < self.duration {
            self.settled = Some(StatisticsStart {
                time,
                cycles: self.cycles,
                displacement: moment().map_or(0.0, |moment| moment.displacement),
            });
            let now = f64::from(self.cycles) * TAU;
            self.gear.iter_mut().for_each(|gear| gear.begin(now));
        }
        if time > self.duration - IMPACT_WINDOWS[0] {
            self.late
                .extend(strikes.iter().map(|strike| (time, *strike)));
        }
        if let Some(sketch) = &mut self.sketch {
            sketch.take(glance, strikes);
        }
        let ends = time > self.duration - END_PERIOD;
        if (ends || self.all_cycles.is_some() || glance.events.iter().next().is_some())
            && let Some(moment) = moment()
        {
            self.retain(&moment);
        }
    }

    fn retain(&mut self, moment: &Moment) {
        let Moment { time, report, .. } = *moment;
        let events = report.events.iter();
        self.events.extend(events.map(|event| TimedEvent {
            time,
            event,
            report,
        }));
        if time > self.duration - END_PERIOD {
            self.end.push(*moment);
        }
        if let Some(all_cycles) = &mut self.all_cycles {
            all_cycles.push(*moment);
        }
        self.last = Some(*moment);
    }

    /// The same for the speed from [`STATISTICS_START`] on, which settles in the 1 s before.
    pub(crate) fn needs_motion(&self, time: f64) -> bool {
        self.duration > STATISTICS_START && time >= STATISTICS_START - END_PERIOD
    }

    /// Share of time in gear of each part from [`STATISTICS_START`] on; empty after a shorter run.
    pub fn shares(&self) -> impl Iterator<Item = Share> + '_ {
        let now = f64::from(self.cycles) * TAU;
        let counted = self.settled.map_or(0, |_| self.gear.len());
        self.gear[..counted].iter().map(move |gear| gear.share(now))
    }

    /// Estimated share of time in gear from [`STATISTICS_START`] on, mean over cycles with one.
    pub fn in_gear_estimated(&self) -> Option<f64> {
        (self.estimated_cycles > 0).then(|| self.shares / f64::from(self.estimated_cycles))
    }

    /// Mean of its reported standard errors.
    pub fn in_gear_error(&self) -> Option<f64> {
        (self.estimated_cycles > 0).then(|| self.errors / f64::from(self.estimated_cycles))
    }

    pub(crate) fn set_gear_lot(&mut self, lot: Option<Lot>) {
        self.gear_lot = lot.or(self.gear_lot);
    }

    /// Share of the cycles from [`STATISTICS_START`] on with an estimate, if the run was longer.
    pub fn in_gear_coverage(&self) -> Option<f64> {
        let cycles = self.cycles - self.settled?.cycles;
        (cycles > 0).then(|| f64::from(self.estimated_cycles) / f64::from(cycles))
    }

    /// Mean conveying speed from [`STATISTICS_START`] on in m/s, positive upwards; none before.
    pub fn speed(&self) -> Option<f64> {
        let (from, to) = (self.settled?, self.last?);
        let time = to.time - from.time;
        (time > 0.0).then(|| (to.displacement - from.displacement) / time)
    }
}

/// Largest number of stretches of a sketched curve, about one for 1.5 pixels.
const MAX_SKETCH_STRETCHES: usize = 450;
const MAX_SKETCH_IMPACTS: usize = 4096;

/// A curve reduced to the lowest and highest point of each stretch.
#[derive(Clone, Debug, Default)]
pub struct Curve {
    points: Vec<(f64, f64)>,
    /// Number of points in the present stretch, its lowest and its highest point.
    count: usize,
    low: (f64, f64),
    high: (f64, f64),
}

impl Curve {
    #[inline]
    fn take(&mut self, time: f64, value: f64) {
        if self.count == 0 || value < self.low.1 {
            self.low = (time, value);
        }
        if self.count == 0 || value > self.high.1 {
            self.high = (time, value);
        }
        self.count += 1;
    }

    fn end_stretch(&mut self) {
        let (mut first, mut second) = (self.low, self.high);
        if first.0 > second.0 {
            (first, second) = (second, first);
        }
        if std::mem::take(&mut self.count) > 0 {
            self.points.push(first);
            let other = Some(second).filter(|second| second.0 != first.0);
            self.points.extend(other);
        }
    }

    /// Points of the curve, including the present stretch.
    pub fn drawn(&self) -> Vec<(f64, f64)> {
        let mut whole = self.clone();
        whole.end_stretch();
        whole.points
    }
}

/// A run, reduced for a picture.
#[derive(Clone, Debug, Default)]
pub struct Sketch {
    stretch: usize,
    within: usize,
    /// Amplitude b over time, in m.
    pub amplitude: Curve,
    /// Reference of the amplitude over time, in m.
    pub reference: Curve,
    /// k over time.
    pub k: Curve,
    /// Estimated share of time in gear, over time.
    pub in_gear: Curve,
    /// Estimated mass on the track over time, in g; NaN without an estimate.
    pub mass: Curve,
    /// Estimated flow over time, in g/s; NaN without an estimate.
    pub flow: Curve,
    /// References of the last two cycles; a reference applies to the cycle after the next.
    ahead: [f32; 2],
    /// States in order, each with its start time in s.
    pub states: Vec<(f64, State)>,
    /// Time at the end in s.
    pub time: f64,
    /// Every `stride`-th impact of each part, with the end of its cycle in s.
    pub impacts: Vec<(f64, Strike)>,
    stride: usize,
    /// Impacts of each part since its last one in the sketch: parts may strike in turn.
    skipped: [usize; PARTS],
}

impl Sketch {
    fn new(cycles: usize) -> Self {
        let is_short = cycles <= 2 * MAX_SKETCH_STRETCHES;
        let stretch = cycles.div_ceil(MAX_SKETCH_STRETCHES);
        Self {
            stretch: if is_short { 1 } else { stretch },
            stride: 1,
            ..Self::default()
        }
    }

    fn take(&mut self, glance: &Glance, strikes: &[Strike]) {
        let time = glance.time;
        let weighed = |value: fn(Load) -> f32| glance.load.map_or(f32::NAN, value);
        self.within = (self.within + 1) % self.stretch;
        for (curve, value) in [
            (&mut self.amplitude, glance.amplitude),
            (&mut self.reference, self.ahead[1]),
            (&mut self.k, glance.k),
            (&mut self.in_gear, glance.in_gear),
            (&mut self.mass, weighed(|load| load.mass)),
            (&mut self.flow, weighed(|load| load.flow)),
        ] {
            curve.take(time, value.into());
            if self.within == 0 {
                curve.end_stretch();
            }
        }
        self.ahead = [glance.reference, self.ahead[0]];
        let last = self.states.last();
        if last.is_none_or(|(_, state)| *state != glance.state) {
            self.states.push((self.time, glance.state));
        }
        self.time = time;
        for strike in strikes {
            let Some(skipped) = self.skipped.get_mut(usize::from(strike.part)) else {
                continue;
            };
            *skipped += 1;
            if *skipped < self.stride {
                continue;
            }
            *skipped = 0;
            self.impacts.push((time, *strike));
            if self.impacts.len() == MAX_SKETCH_IMPACTS {
                let mut retain = [false; PARTS];
                self.impacts.retain(|(_, strike)| {
                    let retain = &mut retain[usize::from(strike.part)];
                    *retain = !*retain;
                    *retain
                });
                self.stride *= 2;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_keeps_the_extremes_and_the_order_of_time() {
        let mut curve = Curve::default();
        for n in 0..50_000_u32 {
            let value = if n == 31_234 { 9.0 } else { f64::from(n % 7) };
            curve.take(f64::from(n), value);
            if n % 112 == 111 {
                curve.end_stretch();
            }
        }
        let points = curve.drawn();
        assert!(points.len() <= 2 * MAX_SKETCH_STRETCHES);
        assert!(points.contains(&(31_234.0, 9.0)));
        assert!(points.windows(2).all(|pair| pair[0].0 < pair[1].0));
    }
}
