//! What is kept of a run while it goes on: enough to judge and draw it, however long it lasts.

use std::f64::consts::TAU;

use kband::arithmetic::Phase;
use kband::regime::gear::{GearWatch, Share};
use kband_control::{Event, Load, Report, State};
use kband_plant::{Moment, PARTS, Sample, Strike};

use super::engine::{Glance, Lot};
use crate::refusal::Refusal;

/// Start of the statistics of gear and speed, in s. By then the drive has reached its setpoint and
/// the first kicks are over.
pub const SETTLED: f64 = 5.0;

/// Time over which the end of a scene is judged, in s.
pub(crate) const END: f64 = 1.0;
/// Times over which the parts' impacts are listened to, in s: the last three seconds tell rest from
/// silence at the slowest hopping, six hold enough impacts to tell chaos, and in one and a half a
/// lock of order 8 repeats often enough.
pub(crate) const HEARD: [f64; 3] = [6.0, 3.0, 1.5];

/// Takes what it is shown, or refuses to go on.
pub type Take<'a, T> = &'a mut dyn FnMut(&T) -> Result<(), Refusal>;

/// What of a run is wanted besides what it comes to; nothing else is computed.
#[derive(Default)]
pub struct Watch<'a> {
    /// Whether it is to be drawn.
    pub drawn: bool,
    /// Whether the regime estimated at the end is reported, even if the controller does not act on
    /// it.
    pub regime: bool,
    /// Whether every cycle is kept.
    pub kept: bool,
    /// Takes every cycle.
    pub cycle: Option<Take<'a, Moment>>,
    /// Takes every sample of the last cycles, in the waveform.
    pub sample: Option<Take<'a, Sample>>,
}

impl Watch<'_> {
    /// It is drawn and reported.
    pub const DRAWN: Self = Self {
        drawn: true,
        regime: true,
        kept: false,
        cycle: None,
        sample: None,
    };

    /// Every cycle is kept.
    pub const KEPT: Self = Self {
        drawn: false,
        regime: true,
        kept: true,
        cycle: None,
        sample: None,
    };
}

/// An event with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Happened {
    /// Time in s.
    pub time: f64,
    /// What happened.
    pub event: Event,
    /// The cycle in which it did.
    pub report: Report,
}

impl Happened {
    /// Its name; of a fault its number and name.
    pub fn words(&self) -> String {
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
    cycles: u32,
    last: Option<Moment>,
    happened: Vec<Happened>,
    /// State now, and the time at which it was reached.
    held: Option<(State, f64)>,
    end: Vec<Moment>,
    /// Time in gear of each part, and the cycle that ended as that began to count.
    gear: Vec<GearWatch>,
    settled: Option<Settled>,
    /// Sums of the estimated shares of time in gear since then, and of their errors, and the
    /// number of cycles with an estimate.
    shares: f64,
    errors: f64,
    estimated_cycles: u32,
    /// The lot that gear was planned for at the end.
    planned_for: Option<Lot>,
    late: Vec<(f64, Strike)>,
    kept: Option<Vec<Moment>>,
    sketch: Option<Sketch>,
}

/// Where a run stood as its parts' time in gear began to count.
#[derive(Clone, Copy, Debug)]
struct Settled {
    time: f64,
    cycles: u32,
    displacement: f64,
}

impl Record {
    pub(crate) fn new(
        duration: f64,
        cycles: usize,
        parts: usize,
        order: u32,
        watch: &Watch<'_>,
    ) -> Self {
        // An order out of range has no gear.
        let gear = GearWatch::build(order).into_iter();
        Self {
            gear: gear
                .flat_map(|gear| std::iter::repeat_n(gear, parts))
                .collect(),
            duration,
            kept: watch.kept.then(|| Vec::with_capacity(cycles)),
            sketch: watch.drawn.then(|| Sketch::new(cycles)),
            ..Self::default()
        }
    }

    /// Whether the end is near enough that the way of the parts is wanted: two windows of the end,
    /// in the first of which the speed along the track settles.
    pub(crate) fn ends(&self, time: f64) -> bool {
        time > self.duration - 2.0 * END
    }

    /// Takes a cycle; `moment` gives the whole of it where more than a glance is kept.
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
            let Some(gear) = self.gear.get_mut(usize::from(strike.part)) else {
                continue;
            };
            let landed = strike.time as f64 / Phase::TURN * TAU;
            let flight = f64::from(strike.flight) * TAU;
            if strike.rested {
                gear.add_rest(landed - flight);
            }
            gear.add_landing(landed, flight);
        }
        if self.settled.is_some() {
            if glance.error.is_finite() {
                self.shares += f64::from(glance.in_gear);
                self.errors += f64::from(glance.error);
                self.estimated_cycles += 1;
            }
        } else if time >= SETTLED && time < self.duration {
            let displacement = moment().map_or(0.0, |moment| moment.displacement);
            let cycles = self.cycles;
            self.settled = Some(Settled {
                time,
                cycles,
                displacement,
            });
            let now = f64::from(cycles) * TAU;
            self.gear.iter_mut().for_each(|gear| gear.begin(now));
        }
        let late = time > self.duration - HEARD[0];
        if late {
            let stamped = strikes.iter().map(|strike| (time, *strike));
            self.late.extend(stamped);
        }
        if let Some(sketch) = &mut self.sketch {
            sketch.take(glance, strikes);
        }
        let ends = time > self.duration - END;
        if (ends || self.kept.is_some() || glance.events.iter().next().is_some())
            && let Some(moment) = moment()
        {
            self.keep(&moment);
        }
    }

    fn keep(&mut self, moment: &Moment) {
        for event in moment.report.events.iter() {
            self.happened.push(Happened {
                time: moment.time,
                event,
                report: moment.report,
            });
        }
        if moment.time > self.duration - END {
            self.end.push(*moment);
        }
        if let Some(kept) = &mut self.kept {
            kept.push(*moment);
        }
        self.last = Some(*moment);
    }

    /// Cycles so far.
    pub fn cycles(&self) -> u32 {
        self.cycles
    }

    /// Every cycle, where they were to be kept.
    pub fn moments(&self) -> &[Moment] {
        self.kept.as_deref().unwrap_or_default()
    }

    /// The last cycle.
    pub fn last(&self) -> Option<&Moment> {
        self.last.as_ref()
    }

    /// Every event in the order of time.
    pub fn happened(&self) -> &[Happened] {
        &self.happened
    }

    /// The state at the end, and since when.
    pub fn held(&self) -> Option<(State, f64)> {
        self.held
    }

    /// Whether the displacement has to be known from this time on for the speed from [`SETTLED`]
    /// on: a second before, in which the speed along the track settles.
    pub(crate) fn settles(&self, time: f64) -> bool {
        self.duration > SETTLED && time >= SETTLED - END
    }

    /// How much of the time from [`SETTLED`] on each part was in gear; empty where the run was
    /// shorter.
    pub fn shares(&self) -> impl Iterator<Item = Share> + '_ {
        let now = f64::from(self.cycles) * TAU;
        let counted = self.settled.map_or(0, |_| self.gear.len());
        self.gear[..counted].iter().map(move |gear| gear.share(now))
    }

    /// Estimated share of time in gear, mean over the cycles with an estimate from [`SETTLED`] on;
    /// `None` without one.
    pub fn in_gear_estimated(&self) -> Option<f64> {
        (self.estimated_cycles > 0).then(|| self.shares / f64::from(self.estimated_cycles))
    }

    /// Mean of its reported standard errors.
    pub fn in_gear_error(&self) -> Option<f64> {
        (self.estimated_cycles > 0).then(|| self.errors / f64::from(self.estimated_cycles))
    }

    /// Lot of the last plan for gear: of parts that changed, the estimated one.
    pub fn planned_for(&self) -> Option<Lot> {
        self.planned_for
    }

    pub(crate) fn plan_for(&mut self, lot: Option<Lot>) {
        self.planned_for = lot.or(self.planned_for);
    }

    /// Share of the cycles from [`SETTLED`] on with an estimate; `None` where the run was shorter.
    pub fn in_gear_coverage(&self) -> Option<f64> {
        let cycles = self.cycles - self.settled?.cycles;
        (cycles > 0).then(|| f64::from(self.estimated_cycles) / f64::from(cycles))
    }

    /// Mean conveying speed from [`SETTLED`] on in m/s, positive upwards; `None` where the run was
    /// shorter.
    pub fn speed(&self) -> Option<f64> {
        let (from, to) = (self.settled?, self.last()?);
        let time = to.time - from.time;
        (time > 0.0).then(|| (to.displacement - from.displacement) / time)
    }

    /// The cycles of the last second.
    pub fn end(&self) -> &[Moment] {
        &self.end
    }

    /// The impacts of the last seconds, with the time at the end of their cycle in s.
    pub fn late(&self) -> &[(f64, Strike)] {
        &self.late
    }

    /// The run in few enough points for a picture.
    pub fn sketch(&self) -> Option<&Sketch> {
        self.sketch.as_ref()
    }
}

/// Most stretches of a sketched curve: about one a pixel and a half, low and high of each.
const MAX_SKETCH_STRETCHES: usize = 450;
/// Most impacts that a sketch keeps; a choice of them is drawn.
const MAX_SKETCH_IMPACTS: usize = 4096;

/// A curve as the lowest and highest point of each stretch.
#[derive(Clone, Debug, Default)]
pub struct Curve {
    points: Vec<(f64, f64)>,
    /// Points of this stretch, and the lowest and highest of them.
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
        let [first, second] = if self.low.0 > self.high.0 {
            [self.high, self.low]
        } else {
            [self.low, self.high]
        };
        match self.count {
            0 => {}
            _ if first.0 == second.0 => self.points.push(first),
            _ => self.points.extend([first, second]),
        }
        self.count = 0;
    }

    /// The points, those of the stretch that has begun included.
    pub fn drawn(&self) -> Vec<(f64, f64)> {
        let mut whole = self.clone();
        whole.end_stretch();
        whole.points
    }
}

/// An impact of a run that is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Struck {
    /// End of its cycle in s.
    pub time: f64,
    /// Phase of the track in rad.
    pub phase: f64,
    /// Speed normal to the track in m/s.
    pub speed: f64,
    /// Number of the part, from 0.
    pub part: u8,
}

/// A run in few enough points for a picture.
#[derive(Clone, Debug, Default)]
pub struct Sketch {
    stretch: usize,
    within: usize,
    /// Amplitude b over time, in m.
    pub amplitude: Curve,
    /// Its reference over time, in m.
    pub reference: Curve,
    /// k over time.
    pub k: Curve,
    /// Estimated share of time in gear, over time.
    pub in_gear: Curve,
    /// Mass on the track as weighed over time, in g; not a number where it is not.
    pub mass: Curve,
    /// Flow as weighed over time, in g/s; not a number where it is not.
    pub flow: Curve,
    /// References of the last two cycles: each is for the cycle after next.
    ahead: [f32; 2],
    states: Vec<(f64, State)>,
    time: f64,
    /// An even choice of the impacts, every `stride`-th of them.
    impacts: Vec<Struck>,
    stride: usize,
    /// Impacts left out since the last that was kept, part by part: parts that strike in turn are
    /// drawn alike.
    skipped: [usize; PARTS],
}

impl Sketch {
    fn new(cycles: usize) -> Self {
        Self {
            stretch: if cycles <= 2 * MAX_SKETCH_STRETCHES {
                1
            } else {
                cycles.div_ceil(MAX_SKETCH_STRETCHES)
            },
            stride: 1,
            ..Self::default()
        }
    }

    fn take(&mut self, glance: &Glance, strikes: &[Strike]) {
        let time = glance.time;
        self.amplitude.take(time, f64::from(glance.amplitude));
        self.reference.take(time, f64::from(self.ahead[1]));
        self.ahead = [glance.reference, self.ahead[0]];
        self.k.take(time, f64::from(glance.k));
        self.in_gear.take(time, f64::from(glance.in_gear));
        let weighed = |of: fn(Load) -> f32| glance.load.map_or(f64::NAN, |load| of(load).into());
        self.mass.take(time, weighed(|load| load.mass));
        self.flow.take(time, weighed(|load| load.flow));
        self.within += 1;
        if self.within == self.stretch {
            self.within = 0;
            for curve in [
                &mut self.amplitude,
                &mut self.reference,
                &mut self.k,
                &mut self.in_gear,
                &mut self.mass,
                &mut self.flow,
            ] {
                curve.end_stretch();
            }
        }
        if self
            .states
            .last()
            .is_none_or(|(_, state)| *state != glance.state)
        {
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
            self.impacts.push(Struck {
                time,
                phase: strike.phase,
                speed: strike.speed,
                part: strike.part,
            });
            if self.impacts.len() == MAX_SKETCH_IMPACTS {
                let mut keep = [false; PARTS];
                self.impacts.retain(|impact| {
                    let keep = &mut keep[usize::from(impact.part)];
                    *keep = !*keep;
                    *keep
                });
                self.stride *= 2;
            }
        }
    }

    /// Time at the end in s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// The states one after the other, each with the time from which it was held.
    pub fn states(&self) -> &[(f64, State)] {
        &self.states
    }

    /// An even choice of the impacts.
    pub fn impacts(&self) -> &[Struck] {
        &self.impacts
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
