//! Running a scene, and what came of it.

use std::time::Instant;

use kband::arithmetic::Phase;
use kband::feeder::Restitution;
use kband::regime::Lock;
use kband::regime::band::Band;
use kband::regime::band::BandError;
use kband::regime::classify::{Classifier, Regime, TimingAccuracy};
use kband::regime::gear::Share;
use kband_control::{
    Controller, Event, Identification, Identified, Limits, NoSetpoint, Report, StartCause, State,
    Target,
};
use kband_plant::{Change, Disturbance, Moment, Scene, Strike};

use super::engine::{Engine, Fidelity, Plans};
use super::record::{END, HEARD, Happened, Record, Watch};
use super::scene::{SceneFile, beside_resonance};
use crate::ending::{Endings, FOLLOWED, chaotic_so_far};
use crate::refusal::Refusal;

/// How exactly an impact repeats on a drive whose amplitude is controlled through a noisy sensor.
const JITTER: TimingAccuracy = TimingAccuracy {
    noise: 0.02,
    resolution: 1e-3,
};

/// Drive cycles at the end that a scope shows.
const SCOPE_CYCLES: usize = 10;

/// Hears of cycles that are done, and refuses to go on where the run is to end.
pub type GoOn<'a> = &'a mut dyn FnMut(u64) -> Result<(), Refusal>;

/// What came of a scene.
#[derive(Clone, Debug)]
pub struct Outcome {
    file: SceneFile,
    record: Record,
    /// Seconds that the simulation took.
    took: f64,
    /// A controller with the target of the end, for what it would choose.
    controller: Controller,
}

impl Outcome {
    /// Runs a scene to its end in a fidelity, watched.
    ///
    /// `go_on` is called every 256 cycles with that number; where it refuses, the run ends with
    /// its refusal.
    ///
    /// # Errors
    /// A `Refusal` for a scene out of range, and those of `watch` and `go_on`.
    pub fn run(
        file: &SceneFile,
        fidelity: Fidelity,
        watch: Watch<'_>,
        go_on: GoOn<'_>,
    ) -> Result<Self, Refusal> {
        Self::gather(file, Engine::build(&file.scene, fidelity)?, watch, go_on)
    }

    /// What comes of a scene where `cycle` gives each of its cycles with the impacts in it.
    ///
    /// # Errors
    /// Those of `cycle`, `watch` and `go_on`.
    pub fn of(
        file: &SceneFile,
        mut cycle: impl FnMut() -> Result<(Moment, Vec<Strike>), Refusal> + Send,
        watch: Watch<'_>,
        go_on: GoOn<'_>,
    ) -> Result<Self, Refusal> {
        Self::gather(file, Engine::given(&mut cycle), watch, go_on)
    }

    fn gather(
        file: &SceneFile,
        mut engine: Engine<'_>,
        mut watch: Watch<'_>,
        go_on: GoOn<'_>,
    ) -> Result<Self, Refusal> {
        let cycles = cycles(file);
        let parts = file.scene.parts.len();
        let order = order(last_target(file));
        let mut record = Record::new(file.duration, cycles, parts, order, &watch);
        // Who takes every cycle takes all of it; else only what it comes to at the end is told.
        let mut watched = watch.cycle.is_some() || watch.kept;
        let mut moving = watched;
        engine.watch(watched);
        let began = Instant::now();
        let mut time = 0.0;
        for n in 0..cycles {
            if n % 256 == 255 {
                go_on(256)?;
            }
            let ends = record.ends(time);
            if !moving && (ends || record.settles(time)) {
                moving = true;
                engine.watch_displacement();
            }
            if !watched && ends && watch.regime {
                watched = true;
                engine.watch(true);
            }
            let glance = match &mut watch.sample {
                Some(take) if n + SCOPE_CYCLES >= cycles => {
                    let mut taken = Ok(());
                    let glance = engine.cycle_shown(&mut |sample| {
                        if taken.is_ok() {
                            taken = take(&sample);
                        }
                    })?;
                    taken?;
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
                engine.keep_plan();
                record.plan_for(engine.planned_for());
            }
        }
        let took = began.elapsed().as_secs_f64();
        engine.keep_plan();
        record.plan_for(engine.planned_for());
        let settings = &file.scene.settings;
        let mut controller = Controller::build(settings, last_target(file), StartCause::Ordinary)?;
        Plans::share(&mut controller);
        while !controller.is_setpoint_found() && controller.plan_step() {}
        Ok(Self {
            controller,
            file: file.clone(),
            record,
            took,
        })
    }

    /// What was kept of the run.
    pub fn record(&self) -> &Record {
        &self.record
    }

    /// Every cycle, where they were to be kept.
    pub fn moments(&self) -> &[Moment] {
        self.record.moments()
    }

    /// Simulated time over the time that the simulation took, with all that was watched.
    pub fn times_real_time(&self) -> f64 {
        self.record.last().map_or(0.0, |moment| moment.time) / self.took.max(1e-9)
    }

    /// The scene.
    pub fn file(&self) -> &SceneFile {
        &self.file
    }

    /// The report of the last cycle.
    pub fn last(&self) -> Report {
        let last = self.record.last();
        last.map_or_else(Report::default, |moment| moment.report)
    }

    /// Every event in the order of time.
    pub fn events(&self) -> impl Iterator<Item = Happened> + '_ {
        self.record.happened().iter().copied()
    }

    /// When a state was first reached for good, i.e. held to the end, in s.
    pub fn reached(&self, state: State) -> Option<f64> {
        let (held, since) = self.record.held()?;
        (held == state).then_some(since)
    }

    fn end(&self) -> impl Iterator<Item = &Moment> {
        self.record.end().iter()
    }

    /// Sum of a quantity over the cycles at the end, and their number, at least 1.
    fn sum_at_end(&self, of: impl Fn(&Report) -> f64) -> (f64, f64) {
        let sum = self.end().fold(0.0, |sum, moment| sum + of(&moment.report));
        (sum, f64::max(self.end().count() as f64, 1.0))
    }

    /// Mean amplitude b at the end in m.
    pub fn amplitude(&self) -> f64 {
        let (sum, count) = self.sum_at_end(|report| report.amplitude.into());
        sum / count
    }

    /// k at the end: of the mean acceleration, so that it stands where the frequency moves, and
    /// infinite at rest.
    pub fn k(&self) -> f64 {
        let (sum, count) = self.sum_at_end(|report| f64::from(report.k).recip());
        count / sum
    }

    /// Mass of the parts on the track in g, from each time in s on, in the order of time.
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

    /// The parts that are on the track at the end, by their numbers from 0.
    fn on_track(&self) -> Vec<u8> {
        let file = self.file();
        let parts = 0..file.scene.parts.len() as u8;
        let on =
            |part: &u8| arrival(&file.scene, usize::from(*part), file.duration) <= file.duration;
        parts.filter(on).collect()
    }

    /// Mass of the parts that are on the track at the end, in g.
    pub fn mass(&self) -> f64 {
        self.masses().last().map_or(0.0, |(_, mass)| *mass)
    }

    /// Mean conveying speed at the end in m/s, positive upwards (time mean).
    pub fn speed(&self) -> f64 {
        let mut end = self.end();
        let (Some(first), Some(last)) = (end.next(), self.record.last()) else {
            return 0.0;
        };
        let time = last.time - first.time;
        if time > 0.0 {
            (last.displacement - first.displacement) / time
        } else {
            0.0
        }
    }

    /// The share of time that the parts were in gear from [`SETTLED`](super::SETTLED) on, mean over
    /// the parts, 0..=1; `None` without parts or where the run was shorter.
    pub fn in_gear(&self) -> Option<f64> {
        let (sum, count) = self
            .record
            .shares()
            .fold((0.0, 0_u32), |(sum, count), share| {
                (sum + share.share(), count + 1)
            });
        (count > 0).then(|| sum / f64::from(count))
    }

    /// Mean time in drive periods after which gear was lost; `None` where it was not.
    pub fn time_to_loss(&self) -> Option<f64> {
        let all = self.record.shares();
        all.fold(Share::default(), |sum, share| sum.plus(&share))
            .time_to_loss()
    }

    fn band_of_target(&self) -> Result<Band, BandError> {
        let settings = &self.file.scene.settings;
        let lot = Restitution::interval(
            f64::from(settings.restitution_low),
            f64::from(settings.restitution_high),
        );
        Band::common_with_contact(lot?, self.order(), settings.contact_time())
    }

    /// The band that the target's order (else order 1) has for the whole lot.
    pub fn band(&self) -> Option<Band> {
        self.band_of_target().ok()
    }

    /// The target at the end.
    pub fn target(&self) -> Target {
        self.controller.target()
    }

    /// The impacts of one part in the last `time` s.
    fn late(&self, part: u8, time: f64) -> impl Iterator<Item = &Strike> {
        let mut from = self.file.duration - time;
        if self.last().state == State::Locked {
            // What the parts did before the lock is no part of it.
            let locked = self.reached(State::Locked).unwrap_or(from);
            from = from.max(locked.min(self.file.duration - END));
        }
        let late = self.record.late().iter();
        late.filter(move |(time, strike)| *time > from && strike.part == part)
            .map(|(_, strike)| strike)
    }

    /// What the parts really do at the end, in words.
    pub fn regime(&self) -> String {
        let parts = self.on_track();
        if parts.is_empty() {
            return "no parts".into();
        }
        // Parts that scatter repeat nothing that a regime could name.
        if self.file.scatters()
            && let Some(share) = self.in_gear()
        {
            return format!("in gear {share:.2}, order {}", self.gear_order());
        }
        let parts = parts.into_iter();
        let mut words: Vec<String> = parts.map(|part| self.regime_in_words(part)).collect();
        words.sort();
        words.dedup();
        words.join(" / ")
    }

    /// The same of one part, and where nothing is decided after how many impacts that is.
    fn regime_in_words(&self, part: u8) -> String {
        match self.regime_of(part) {
            Regime::Chaotic if !self.stays_chaotic(part) => {
                chaotic_so_far(self.late(part, HEARD[0]).count())
            }
            Regime::Undecided => {
                let impacts = self.late(part, HEARD[0]).count();
                format!("undecided after {impacts} impacts")
            }
            regime => words(regime),
        }
    }

    /// Whether the irregular flights that a part makes at the end stay what they are, by the rule
    /// of every verb ([`Endings::holds`]); a long transient does not, and on two tones it is not
    /// known.
    fn stays_chaotic(&self, part: u8) -> bool {
        let (mut time, mut flights) = (0.0, 0.0);
        for strike in self.late(part, HEARD[0]) {
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
        Endings::with_contact(self.k(), f64::from(restitution), FOLLOWED, contact)
            .is_ok_and(|endings| endings.holds(order))
    }

    /// What one part really does at the end, told from its impacts alone: over the longest of some
    /// windows that tells it, as a part may have come to it only just now.
    fn regime_of(&self, part: u8) -> Regime {
        for window in HEARD {
            let Ok(mut classifier) = Classifier::<256>::build(JITTER) else {
                break;
            };
            let mut impacts = 0;
            for strike in self.late(part, window) {
                let cycle = (strike.time >> 32) as u32;
                classifier.impact(cycle, Phase::from_bits(strike.time as u32));
                impacts += 1;
            }
            classifier.cycle(self.record.cycles());
            let regime = classifier.verdict().regime;
            // A window without an impact is too short to call that rest if a longer one had some.
            let silent = impacts == 0 && window < HEARD[0];
            if regime != Regime::Undecided && !silent {
                return regime;
            }
        }
        Regime::Undecided
    }

    /// Whether every part is locked at the end, decided from its impacts alone.
    pub fn is_locked(&self) -> bool {
        let parts = self.on_track();
        let locked = |part: &u8| matches!(self.regime_of(*part), Regime::Locked { .. });
        !parts.is_empty() && parts.iter().all(locked)
    }

    /// How many of the parts on the track lie at rest at the end.
    pub fn resting(&self) -> usize {
        let parts = self.on_track().into_iter();
        parts
            .filter(|part| self.regime_of(*part) == Regime::Rest)
            .count()
    }

    /// Share of the time at the end that the parts on the track are in the air, mean over the parts.
    pub fn in_air(&self) -> f64 {
        let parts = self.on_track();
        let strikes = parts.iter().flat_map(|part| self.late(*part, END));
        let in_air: f64 = strikes.map(|strike| f64::from(strike.flight)).sum();
        let watched = END.min(self.file.duration) * f64::from(self.file.scene.settings.frequency);
        in_air / (watched * parts.len().max(1) as f64)
    }

    /// Mean phase at which the first part strikes where all are locked, in rad.
    pub fn lock_phase(&self) -> Option<f64> {
        if !self.is_locked() {
            return None;
        }
        let (sine, cosine) = self.late(0, END).fold((0.0, 0.0), |(s, c), strike| {
            (s + strike.phase.sin(), c + strike.phase.cos())
        });
        Some(f64::atan2(sine, cosine))
    }

    /// Phase at which the target's lock would strike for the middle of the lot, in rad.
    pub fn expected_phase(&self) -> Option<f64> {
        let settings = &self.file.scene.settings;
        let middle =
            0.5 * (f64::from(settings.restitution_low) + f64::from(settings.restitution_high));
        let contact = settings.contact_time();
        let lock = Lock::with_contact(self.k(), middle, self.order(), contact).ok()??;
        Some(lock.strike_phase())
    }

    /// Kicks that the controller may try.
    pub fn attempts_allowed(&self) -> u32 {
        self.file.scene.settings.capture_attempts as u32
    }

    /// Restitutions of the simulated parts outside the configured lot.
    pub fn strays(&self) -> Vec<f32> {
        let scene = &self.file.scene;
        let settings = &scene.settings;
        let lot = settings.restitution_low..=settings.restitution_high;
        let strays = scene.parts.iter().copied().filter(|r| !lot.contains(r));
        let mut strays: Vec<f32> = strays.collect();
        strays.sort_by(f32::total_cmp);
        strays.dedup();
        strays
    }

    /// Why the lot has no band of the target's order, and which bounds would have one.
    pub fn no_band(&self) -> Option<String> {
        self.band_of_target().err().map(|none| none.to_string())
    }

    /// Order of the lock that was wanted at the end; 1 where none was.
    fn order(&self) -> u32 {
        self.controller
            .order()
            .map_or_else(|| order(self.target()), u32::from)
    }

    /// Order of the gear that is watched.
    pub fn gear_order(&self) -> u32 {
        order(self.target())
    }

    /// Why the target has no setpoint, if it has none, in the controller's words.
    pub fn no_setpoint(&self) -> Option<String> {
        let held = self.last().limits.contains(Limits::NO_SETPOINT);
        // Only a search shows that a lot has no chaos of its own.
        let why = self.controller.no_setpoint().unwrap_or(NoSetpoint::Chaos);
        let far = match why {
            NoSetpoint::Gear { .. } | NoSetpoint::Output { .. } => {
                beside_resonance(&self.file.scene.settings)
            }
            _ => None,
        };
        held.then(|| far.map_or_else(|| why.to_string(), |far| format!("{why}; {far}")))
    }

    /// The restitution that was identified, if one was.
    pub fn identified(&self) -> Option<Identified> {
        match self.last().identification {
            Identification::Found(found) => Some(found),
            _ => None,
        }
    }

    /// Names of the limits that hold the drive back at the end.
    pub fn limits(&self) -> Vec<&'static str> {
        let held = self.last().limits;
        Limits::ALL
            .into_iter()
            .filter(|limit| held.contains(*limit))
            .map(Limits::name)
            .collect()
    }
}

/// Time in s at which a part comes onto the track, by the disturbances up to `time`; infinite for a
/// part in the hopper or off the track.
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

/// Order of the gear that a target asks for; 1 where it asks for none.
fn order(target: Target) -> u32 {
    match target {
        Target::Locked { order } | Target::Gear { order } => u32::from(order),
        _ => 1,
    }
}

fn is_planned(event: Event) -> bool {
    matches!(event, Event::KickPlanned | Event::KickUncertain)
}

/// Drive cycles of a scene.
pub fn cycles(file: &SceneFile) -> usize {
    (file.duration * f64::from(file.scene.settings.frequency)).ceil() as usize
}

/// A regime in words.
pub fn words(regime: Regime) -> String {
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
