//! Runs a scene, evaluates its result, and compares it with the expected one.

use std::sync::OnceLock;
use std::time::Instant;

use kband::arithmetic::Phase;
use kband::regime::Lock;
use kband::regime::band::{Band, BandError};
use kband::regime::classify::{Classifier, Regime, TimingAccuracy};
use kband::regime::gear::Share;
use kband_control::{
    Controller, Event, Fault, Identification, Identified, Limits, NoSetpoint, Report, StartCause,
    State, Target,
};
use kband_plant::{Change, Disturbance, Moment, Scene, Strike};

use super::engine::{Engine, Fidelity, Plans};
use super::record::{END_PERIOD, IMPACT_WINDOWS, Record, TimedEvent, Watch};
use super::scene::{SceneFile, describe_detuning};
use crate::ending::{Endings, MAX_ORBIT_IMPACTS, chaotic_so_far};
use crate::refusal::Refusal;

/// Timing noise and resolution of impacts under amplitude control with a noisy sensor.
const JITTER: TimingAccuracy = TimingAccuracy {
    noise: 0.02,
    resolution: 1e-3,
};

const SCOPE_CYCLES: usize = 10;

/// Receives the number of completed cycles; a refusal ends the run.
pub type ProgressCheck<'a> = &'a mut dyn FnMut(u64) -> Result<(), Refusal>;

/// Result of a scene.
#[derive(Clone, Debug)]
pub struct Outcome {
    file: SceneFile,
    record: Record,
    /// Parts on the track at the end and their regimes; filled when they are first read.
    regimes: OnceLock<Vec<(u8, Regime)>>,
    /// Time that the simulation took, s.
    wall_time: f64,
    /// Controller with the final target; it gives the predicted setpoint.
    controller: Controller,
}

impl Outcome {
    /// Runs a scene to its end. `check_stop` is called every 256 cycles with that number. Refused:
    /// a scene out of range, and as by `watch` and `check_stop`.
    pub fn run(
        file: &SceneFile,
        fidelity: Fidelity,
        watch: Watch<'_>,
        check_stop: ProgressCheck<'_>,
    ) -> Result<Self, Refusal> {
        let engine = Engine::build(&file.scene, fidelity)?;
        Self::gather(file, engine, watch, check_stop)
    }

    /// Evaluates a scene whose cycles and impacts come from `cycle`; refused as by its callbacks.
    pub fn from_cycles(
        file: &SceneFile,
        mut cycle: impl FnMut() -> Result<(Moment, Vec<Strike>), Refusal> + Send,
        watch: Watch<'_>,
        check_stop: ProgressCheck<'_>,
    ) -> Result<Self, Refusal> {
        Self::gather(file, Engine::given(&mut cycle), watch, check_stop)
    }

    fn gather(
        file: &SceneFile,
        mut engine: Engine<'_>,
        mut watch: Watch<'_>,
        check_stop: ProgressCheck<'_>,
    ) -> Result<Self, Refusal> {
        let cycles = cycles(file);
        let parts = file.scene.parts.len();
        let order = order(last_target(file));
        let mut record = Record::new(file.duration, cycles, parts, order, &watch);
        let is_planned = |event| matches!(event, Event::KickPlanned | Event::KickUncertain);
        // Only an observer of every cycle needs complete cycles before the end.
        let mut watched = watch.cycle.is_some() || watch.all_cycles;
        let mut moving = watched;
        engine.watch(watched);
        let began = Instant::now();
        let mut time = 0.0;
        for n in 0..cycles {
            if n % 256 == 255 {
                check_stop(256)?;
            }
            let ends = record.ends(time);
            if !moving && (ends || record.needs_motion(time)) {
                moving = true;
                engine.watch_displacement();
            }
            if !watched && ends && watch.regime {
                watched = true;
                engine.watch(true);
            }
            let glance = match &mut watch.sample {
                Some(take) if n + SCOPE_CYCLES >= cycles => {
                    let mut sample_result = Ok(());
                    let glance = engine.trace_cycle(&mut |sample| {
                        if sample_result.is_ok() {
                            sample_result = take(&sample);
                        }
                    })?;
                    sample_result?;
                    glance
                }
                _ => engine.cycle()?,
            };
            time = glance.time;
            record.take(&glance, engine.strikes(), || engine.moment());
            if let Some(take) = &mut watch.cycle
                && let Some(moment) = engine.moment()
            {
                take(&moment)?;
            }
            if glance.events.iter().any(is_planned) {
                engine.cache_plan();
                record.set_gear_lot(engine.gear_lot());
            }
        }
        let wall_time = began.elapsed().as_secs_f64();
        engine.cache_plan();
        record.set_gear_lot(engine.gear_lot());
        let settings = &file.scene.settings;
        let mut controller = Controller::build(settings, last_target(file), StartCause::Ordinary)?;
        Plans::share(&mut controller);
        while !controller.is_setpoint_found() && controller.plan_step() {}
        Ok(Self {
            controller,
            file: file.clone(),
            record,
            regimes: OnceLock::new(),
            wall_time,
        })
    }

    /// Record of the run.
    pub fn record(&self) -> &Record {
        &self.record
    }

    /// Every cycle; empty unless [`Watch::all_cycles`] was set.
    pub fn moments(&self) -> &[Moment] {
        self.record.all_cycles.as_deref().unwrap_or_default()
    }

    /// Simulated time over wall-clock time, including the observers.
    pub fn times_real_time(&self) -> f64 {
        self.record.last.map_or(0.0, |moment| moment.time) / self.wall_time.max(1e-9)
    }

    /// The scene.
    pub fn file(&self) -> &SceneFile {
        &self.file
    }

    /// The report of the last cycle.
    pub fn last(&self) -> Report {
        self.record.last.map(|last| last.report).unwrap_or_default()
    }

    /// All events in the order of time.
    pub fn events(&self) -> impl Iterator<Item = TimedEvent> + '_ {
        self.record.events.iter().copied()
    }

    /// Time in s at which a state was entered and then held to the end.
    pub fn reached(&self, state: State) -> Option<f64> {
        let (last, since) = self.record.held?;
        (last == state).then_some(since)
    }

    /// Sum of a quantity over the last cycles, and their number, at least 1.
    fn sum_at_end(&self, value: impl Fn(&Report) -> f64) -> (f64, f64) {
        let end = &self.record.end;
        let values = end.iter().map(|moment| value(&moment.report));
        let sum = values.fold(0.0, |sum, value| sum + value);
        (sum, f64::max(end.len() as f64, 1.0))
    }

    /// Mean amplitude b at the end in m.
    pub fn amplitude(&self) -> f64 {
        let (sum, count) = self.sum_at_end(|report| report.amplitude.into());
        sum / count
    }

    /// k at the end, by the mean acceleration, also at a varying frequency; infinite at rest.
    pub fn k(&self) -> f64 {
        let (sum, count) = self.sum_at_end(|report| f64::from(report.k).recip());
        count / sum
    }

    /// Mass of the parts on the track: pairs of start time in s and mass in g, by time.
    pub fn masses(&self) -> Vec<(f64, f64)> {
        let (file, scene) = (self.file(), &self.file().scene);
        let parts = || 0..scene.parts.len();
        let mut times: Vec<f64> = vec![0.0];
        for disturbance in &scene.disturbances {
            times.push(disturbance.at);
            if let Change::Dump(_) = disturbance.change {
                times.extend(parts().map(|part| arrival(scene, part, disturbance.at)));
            }
        }
        times.retain(|time| *time <= file.duration);
        times.sort_by(f64::total_cmp);
        let mass_at = |time: f64| {
            let on = parts().filter(|part| arrival(scene, *part, time) <= time);
            let masses = on.filter_map(|part| scene.masses.get(part));
            masses.map(|mass| f64::from(*mass)).sum()
        };
        let masses = times.into_iter().map(|time| (time, mass_at(time)));
        let mut masses: Vec<(f64, f64)> = masses.collect();
        masses.dedup_by_key(|(_, mass)| *mass);
        masses
    }

    /// Numbers, from 0, of the parts on the track at the end.
    fn on_track(&self) -> Vec<u8> {
        let (scene, end) = (&self.file.scene, self.file.duration);
        let on = |part: &u8| arrival(scene, usize::from(*part), end) <= end;
        (0..scene.parts.len() as u8).filter(on).collect()
    }

    /// Mass of the parts on the track at the end, in g.
    pub fn mass(&self) -> f64 {
        self.masses().last().map_or(0.0, |(_, mass)| *mass)
    }

    /// Mean conveying speed in m/s, positive upwards: from [`STATISTICS_START`](super::STATISTICS_START)
    /// on, or of the last second after a late change or a short run.
    pub fn speed(&self) -> f64 {
        let changes = self.file.scene.disturbances.iter().map(|it| it.at);
        let mut changes = changes.chain(self.events().map(|it| it.time));
        let is_steady = changes.all(|time| time < super::STATISTICS_START);
        if let Some(speed) = self.record.speed().filter(|_| is_steady) {
            return speed;
        }
        let speed = |(first, last): (&Moment, Moment)| {
            let time = last.time - first.time;
            (time > 0.0).then(|| (last.displacement - first.displacement) / time)
        };
        let ends = self.record.end.first().zip(self.record.last);
        ends.and_then(speed).unwrap_or(0.0)
    }

    /// Simulated share of time in gear from [`STATISTICS_START`](super::STATISTICS_START) on,
    /// 0..=1, mean over the parts. `None` without parts or after a shorter run.
    pub fn in_gear(&self) -> Option<f64> {
        let shares: Vec<f64> = self.record.shares().map(|share| share.share()).collect();
        let sum = shares.iter().fold(0.0, |sum, share| sum + share);
        (!shares.is_empty()).then(|| sum / shares.len() as f64)
    }

    /// Mean time in gear before a loss, in drive periods; `None` without a loss.
    pub fn time_to_loss(&self) -> Option<f64> {
        let shares = self.record.shares();
        let all = shares.fold(Share::default(), |sum, share| sum.plus(&share));
        all.time_to_loss()
    }

    fn band_of_target(&self) -> Result<Band, BandError> {
        let settings = &self.file.scene.settings;
        Band::common_with_contact(settings.lot()?, self.order(), settings.contact_time())
    }

    /// Lock band of the whole lot for the target's order (default 1).
    pub fn band(&self) -> Option<Band> {
        self.band_of_target().ok()
    }

    /// The target at the end.
    pub fn target(&self) -> Target {
        self.controller.target()
    }

    /// Impacts of one part in the last `time` s.
    fn late(&self, part: u8, time: f64) -> impl Iterator<Item = &Strike> {
        let mut from = self.file.duration - time;
        if self.last().state == State::Locked {
            // Impacts before the lock are excluded.
            let locked = self.reached(State::Locked).unwrap_or(from);
            from = from.max(locked.min(self.file.duration - END_PERIOD));
        }
        let late = self.record.late.iter();
        late.filter(move |(time, strike)| *time > from && strike.part == part)
            .map(|(_, strike)| strike)
    }

    /// Simulated regime of the parts at the end, in words.
    pub fn regime(&self) -> String {
        if self.on_track().is_empty() {
            return "no parts".into();
        }
        // Restitution that scatters has no repeating orbit, so no regime to name.
        if self.file.scatters()
            && let Some(share) = self.in_gear()
        {
            return format!("in gear {share:.2}, order {}", self.gear_order());
        }
        let words = |(part, regime): &(u8, Regime)| self.regime_in_words(*part, *regime);
        let mut regimes: Vec<String> = self.regimes().iter().map(words).collect();
        regimes.sort();
        regimes.dedup();
        regimes.join(" / ")
    }

    /// Regime of one part in words; an undecided one has its number of impacts.
    fn regime_in_words(&self, part: u8, regime: Regime) -> String {
        let impacts = || self.late(part, IMPACT_WINDOWS[0]).count();
        match regime {
            Regime::Chaotic if !self.stays_chaotic(part) => chaotic_so_far(impacts()),
            Regime::Undecided => format!("undecided after {} impacts", impacts()),
            regime => regime_text(regime),
        }
    }

    /// Whether irregular flights of a part at the end persist, by [`Endings::stays_in_gear`]. False
    /// for a long transient, and on two tones, where it is unknown.
    fn stays_chaotic(&self, part: u8) -> bool {
        let (mut time, mut flights) = (0.0, 0.0);
        for strike in self.late(part, IMPACT_WINDOWS[0]) {
            time += f64::from(strike.flight);
            flights += 1.0;
        }
        let scene = &self.file.scene;
        let changed = |change: &Disturbance| match change.change {
            Change::Restitution(restitution) => Some(restitution),
            _ => None,
        };
        let now = scene.disturbances.iter().rev().find_map(changed);
        let restitution = now.or_else(|| scene.parts.get(usize::from(part)).copied());
        let (Some(restitution), true) = (restitution, self.last().shape.second.ratio == 0.0) else {
            return false;
        };
        let order = (time / f64::max(flights, 1.0)).round() as u32;
        let contact = scene.settings.contact_time();
        Endings::with_contact(self.k(), f64::from(restitution), MAX_ORBIT_IMPACTS, contact)
            .is_ok_and(|endings| endings.stays_in_gear(order))
    }

    /// Simulated regime of one part at the end, by the longest window of its impacts that decides.
    fn regime_of(&self, part: u8) -> Regime {
        for window in IMPACT_WINDOWS {
            let Ok(mut classifier) = Classifier::<256>::build(JITTER) else {
                break;
            };
            let mut impacts = 0;
            for strike in self.late(part, window) {
                let cycle = (strike.time >> 32) as u32;
                classifier.impact(cycle, Phase::from_bits(strike.time as u32));
                impacts += 1;
            }
            classifier.cycle(self.record.cycles);
            let regime = classifier.verdict().regime;
            // A silent window counts as rest only if the longest window is silent, too.
            let silent = impacts == 0 && window < IMPACT_WINDOWS[0];
            if regime != Regime::Undecided && !silent {
                return regime;
            }
        }
        Regime::Undecided
    }

    fn regimes(&self) -> &[(u8, Regime)] {
        self.regimes.get_or_init(|| {
            let parts = self.on_track().into_iter();
            parts.map(|part| (part, self.regime_of(part))).collect()
        })
    }

    /// Whether every part is locked at the end, from its impacts alone.
    pub fn is_locked(&self) -> bool {
        let regimes = self.regimes();
        let is_locked = |(_, regime): &(u8, Regime)| matches!(regime, Regime::Locked { .. });
        !regimes.is_empty() && regimes.iter().all(is_locked)
    }

    /// Number of parts on the track that are at rest at the end.
    pub fn resting(&self) -> usize {
        let regimes = self.regimes().iter();
        regimes
            .filter(|(_, regime)| *regime == Regime::Rest)
            .count()
    }

    /// Share of time in the air at the end, mean over the parts on the track.
    pub fn in_air(&self) -> f64 {
        let parts = self.on_track();
        let strikes = parts.iter().flat_map(|part| self.late(*part, END_PERIOD));
        let in_air: f64 = strikes.map(|strike| f64::from(strike.flight)).sum();
        let frequency = f64::from(self.file.scene.settings.frequency);
        let watched = END_PERIOD.min(self.file.duration) * frequency;
        // The flight that began before the period counts whole.
        (in_air / (watched * parts.len().max(1) as f64)).min(1.0)
    }

    /// Mean impact phase of the first part if all are locked, in rad.
    pub fn lock_phase(&self) -> Option<f64> {
        if !self.is_locked() {
            return None;
        }
        let (sine, cosine) = self.late(0, END_PERIOD).fold((0.0, 0.0), |(s, c), strike| {
            (s + strike.phase.sin(), c + strike.phase.cos())
        });
        Some(f64::atan2(sine, cosine))
    }

    /// Predicted impact phase of the target's lock for the mean restitution of the lot, in rad.
    pub fn expected_phase(&self) -> Option<f64> {
        let settings = &self.file.scene.settings;
        let (middle, contact) = (settings.lot().ok()?.middle(), settings.contact_time());
        let lock = Lock::with_contact(self.k(), middle, self.order(), contact).ok()??;
        Some(lock.strike_phase())
    }

    /// Largest number of kicks of the controller.
    pub fn attempts_allowed(&self) -> u32 {
        self.file.scene.settings.capture_attempts as u32
    }

    /// Restitutions of the simulated parts outside the configured lot.
    pub fn strays(&self) -> Vec<f32> {
        let scene = &self.file.scene;
        let lot = scene.settings.restitution_low..=scene.settings.restitution_high;
        let mut strays: Vec<f32> = scene.parts.iter().copied().collect();
        strays.retain(|r| !lot.contains(r));
        strays.sort_by(f32::total_cmp);
        strays.dedup();
        strays
    }

    /// Reason why the lot has no band of the target's order, and bounds that would have one.
    pub fn no_band(&self) -> Option<String> {
        self.band_of_target().err().map(|none| none.to_string())
    }

    /// Order of the requested lock at the end; 1 without one.
    fn order(&self) -> u32 {
        let order_of_lock = self.controller.order().map(u32::from);
        order_of_lock.unwrap_or_else(|| order(self.target()))
    }

    /// Order of gear for the statistics of gear.
    pub fn gear_order(&self) -> u32 {
        order(self.target())
    }

    /// Reason for a missing setpoint in the controller's words, if the target has none.
    pub fn no_setpoint(&self) -> Option<String> {
        let no_setpoint = self.last().limits.contains(Limits::NO_SETPOINT);
        // Without a stated reason it is chaos: only a search shows that a lot has none.
        let why = self.controller.no_setpoint().unwrap_or(NoSetpoint::Chaos);
        let settings = &self.file.scene.settings;
        let distance = match why {
            NoSetpoint::Gear { .. } | NoSetpoint::Output { .. } => describe_detuning(settings),
            _ => None,
        };
        let distance = distance.map_or(String::new(), |distance| format!("; {distance}"));
        no_setpoint.then(|| format!("{why}{distance}"))
    }

    /// Estimated restitution, if identification succeeded.
    pub fn identified(&self) -> Option<Identified> {
        match self.last().identification {
            Identification::Found(result) => Some(result),
            _ => None,
        }
    }

    /// Names of the active limits at the end.
    pub fn limits(&self) -> Vec<&'static str> {
        let active = self.last().limits;
        let limits = Limits::ALL.into_iter();
        let limits = limits.filter(|limit| active.contains(*limit));
        limits.map(Limits::name).collect()
    }

    /// Unmet expectations of the scene, one in each line; `None` without an expectation.
    pub fn unmet(&self) -> Option<Vec<String>> {
        let expectation = self.file().expectation.as_ref()?;
        let mut unmet = Vec::new();
        let last = self.last();
        if let Some(state) = expectation.state {
            unmet.extend(mismatch("state", state.name(), last.state.name()));
        }
        if let Some(fault) = expectation.fault {
            let [expected, actual] = [fault, last.fault].map(|f| f.map_or("none", Fault::name));
            unmet.extend(mismatch("fault", expected, actual));
        }
        if let Some(events) = &expectation.events {
            let names = |events: &mut dyn Iterator<Item = Event>| {
                events.map(Event::name).collect::<Vec<_>>().join(", ")
            };
            let actual = names(&mut self.events().map(|timed| timed.event));
            let expected = names(&mut events.iter().copied());
            if actual != expected {
                unmet.push(format!("events: expected {expected}; came {actual}"));
            }
        }
        if let Some(limits) = &expectation.limits {
            let [expected, actual] = [limits.join(", "), self.limits().join(", ")];
            let [expected, actual] = [expected, actual].map(|names| format!("[{names}]"));
            unmet.extend(mismatch("limits", &expected, &actual));
        }
        if let Some(regime) = &expectation.regime {
            unmet.extend(mismatch("regime", regime, &self.regime()));
        }
        let identified = self.identified();
        let restitution = identified.map_or(f64::NAN, |result| f64::from(result.restitution));
        let values = [
            ("k", self.k()),
            ("speed in mm/s", self.speed() * 1e3),
            ("share of time in gear", self.in_gear().unwrap_or(f64::NAN)),
            ("restitution identified", restitution),
        ];
        for ((name, value), range) in values.into_iter().zip(expectation.ranges) {
            if let Some((low, high)) = range
                && !(low..=high).contains(&value)
            {
                let expected = format!("{low}..{high}");
                unmet.extend(mismatch(name, &expected, &format!("{value:.4}")));
            }
        }
        if let (Some(within), Some(state)) = (expectation.within, expectation.state) {
            let expected = format!("{} within {within} s", state.name());
            match self.reached(state) {
                Some(time) if time <= within => {}
                Some(time) => unmet.push(format!("{expected}: came at {time:.2} s")),
                None => unmet.push(format!("{expected}: never came")),
            }
        }
        Some(unmet)
    }
}

/// Time in s at which a part enters the track, by the disturbances up to `time`, else infinite.
fn arrival(scene: &Scene, part: usize, time: f64) -> f64 {
    let mut first_waiting = scene.parts.len() - usize::from(scene.waiting);
    let mut arrives = if part < first_waiting {
        0.0
    } else {
        f64::INFINITY
    };
    for disturbance in scene.disturbances.iter().filter(|change| change.at <= time) {
        let at = disturbance.at;
        match disturbance.change {
            Change::Dump(within) => {
                if part >= first_waiting {
                    let waiting = (scene.parts.len() - first_waiting) as f64;
                    let fallen = (part - first_waiting + 1) as f64;
                    arrives = at + f64::from(within) * fallen / waiting;
                }
                first_waiting = scene.parts.len();
            }
            Change::Parts(count) => {
                let count = usize::from(count);
                arrives = if part < count {
                    arrives.min(at)
                } else {
                    f64::INFINITY
                };
                first_waiting = first_waiting.max(count);
            }
            _ => {}
        }
    }
    arrives
}

fn last_target(file: &SceneFile) -> Target {
    file.scene.targets().last().unwrap_or(file.scene.target)
}

/// Order of gear that a target requests; 1 if it requests none.
fn order(target: Target) -> u32 {
    match target {
        Target::Locked { order } | Target::Gear { order } => u32::from(order),
        _ => 1,
    }
}

/// Number of drive cycles of a scene.
pub fn cycles(file: &SceneFile) -> usize {
    (file.duration * f64::from(file.scene.settings.frequency)).ceil() as usize
}

/// A regime in words.
pub fn regime_text(regime: Regime) -> String {
    match regime {
        Regime::Rest => "rest".into(),
        Regime::HopAndRest { cycles: 1 } => "hops and rests every cycle".into(),
        Regime::HopAndRest { cycles } => format!("hops and rests every {cycles} cycles"),
        Regime::Locked { order } => format!("locked, order {order}"),
        Regime::Doubled { order, doublings } => {
            format!("order {order}, {} times the period", 1_u64 << doublings)
        }
        Regime::Periodic { impacts, cycles } => format!("{impacts} impacts in {cycles} cycles"),
        Regime::Chaotic => "chaotic".into(),
        Regime::Undecided => "undecided".into(),
    }
}

fn mismatch(what: &str, expected: &str, actual: &str) -> Option<String> {
    (expected != actual).then(|| format!("{what}: expected {expected}, came to {actual}"))
}
