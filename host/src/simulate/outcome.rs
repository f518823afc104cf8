//! Running a scene, and what came of it.

use kband::arithmetic::Phase;
use kband::control::{Controller, Event, Limits, NoSetpoint, Report, Start, State, Target};
use kband::feeder::Restitution;
use kband::plant::{Change, ClosedLoop, Moment, Strike};
use kband::regime::band::BandError;
use kband::regime::classify::{Classifier, HearingSettings, Regime};
use kband::regime::{Band, Lock};

use super::scene::SceneFile;
use crate::board::{BoardLoop, Line};
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;
use crate::report::{Column, Table, Value};

/// Time over which the end of a scene is judged, in s.
const END: f32 = 1.0;
/// Time over which the parts' impacts are listened to, in s: the last three tell rest from silence at
/// the slowest hopping, and hold enough impacts to tell chaos.
const HEARD: f32 = 6.0;
/// How exactly an impact repeats on a drive whose amplitude is controlled through a noisy sensor.
const JITTER: HearingSettings = HearingSettings {
    noise: 0.02,
    resolution: 1e-3,
};

/// An event with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Happened {
    /// Time in s.
    pub time: f32,
    /// What happened.
    pub event: Event,
    /// The cycle in which it did.
    pub report: Report,
}

/// What came of a scene.
#[derive(Clone, Debug)]
pub struct Outcome {
    file: SceneFile,
    moments: Vec<Moment>,
    /// Impacts with their time in s.
    strikes: Vec<(f32, Strike)>,
    /// A controller with the target of the end, for what it would choose.
    controller: Controller,
}

impl Outcome {
    /// Runs a scene to its end, with progress.
    pub fn run(file: &SceneFile, desk: &Desk) -> Result<Self, Refusal> {
        let progress = Progress::new("simulating", cycles(file) as u64);
        let outcome = Self::simulate(file, &mut |done| {
            progress.advance(done);
            desk.go_on()
        });
        progress.finish();
        outcome
    }

    /// Runs a scene to its end; `go_on` is told of cycles done and may refuse to go on.
    pub(super) fn simulate(
        file: &SceneFile,
        go_on: &mut dyn FnMut(u64) -> Result<(), Refusal>,
    ) -> Result<Self, Refusal> {
        let mut closed = ClosedLoop::build(&file.scene)?;
        Self::gather(file, go_on, || {
            let moment = closed.cycle();
            Ok((moment, closed.plant().strikes().to_vec()))
        })
    }

    /// What comes of a scene where `cycle` gives each of its cycles with the impacts in it.
    pub fn of(
        file: &SceneFile,
        mut cycle: impl FnMut() -> (Moment, Vec<Strike>),
    ) -> Result<Self, Refusal> {
        Self::gather(file, &mut |_| Ok(()), || Ok(cycle()))
    }

    /// Runs a scene to its end with its controller on the board at the end of `line`, with progress.
    pub fn run_on(line: Line, file: &SceneFile, desk: &Desk) -> Result<Self, Refusal> {
        let mut closed = BoardLoop::start(line, &file.scene)?;
        let progress = Progress::new("simulating", cycles(file) as u64);
        let outcome = Self::gather(
            file,
            &mut |done| {
                progress.advance(done);
                desk.go_on()
            },
            || {
                let moment = closed.cycle()?;
                Ok((moment, closed.plant().strikes().to_vec()))
            },
        );
        progress.finish();
        outcome
    }

    fn gather(
        file: &SceneFile,
        go_on: &mut dyn FnMut(u64) -> Result<(), Refusal>,
        mut cycle: impl FnMut() -> Result<(Moment, Vec<Strike>), Refusal>,
    ) -> Result<Self, Refusal> {
        let turns_per_second = f64::from(file.scene.settings.frequency) * 4_294_967_296.0;
        let cycles = cycles(file);
        let mut moments = Vec::with_capacity(cycles);
        let mut strikes = Vec::new();
        for n in 0..cycles {
            if n % 256 == 255 {
                go_on(256)?;
            }
            let (moment, struck) = cycle()?;
            for strike in struck {
                strikes.push(((strike.time as f64 / turns_per_second) as f32, strike));
            }
            moments.push(moment);
        }
        let settings = &file.scene.settings;
        Ok(Self {
            controller: Controller::build(settings, last_target(file), Start::Ordinary)?,
            file: file.clone(),
            moments,
            strikes,
        })
    }

    /// The scene.
    #[must_use]
    pub fn file(&self) -> &SceneFile {
        &self.file
    }

    /// Every cycle.
    #[must_use]
    pub fn moments(&self) -> &[Moment] {
        &self.moments
    }

    /// Every impact with its time in s.
    #[must_use]
    pub fn strikes(&self) -> &[(f32, Strike)] {
        &self.strikes
    }

    /// The report of the last cycle.
    #[must_use]
    pub fn last(&self) -> Report {
        self.moments
            .last()
            .map_or_else(Report::default, |moment| moment.report)
    }

    /// Every event in the order of time.
    pub fn events(&self) -> impl Iterator<Item = Happened> + '_ {
        self.moments.iter().flat_map(|moment| {
            let events: Vec<Event> = moment.report.events.iter().collect();
            events.into_iter().map(|event| Happened {
                time: moment.time,
                event,
                report: moment.report,
            })
        })
    }

    /// When a state was first reached for good, i.e. held to the end, in s.
    #[must_use]
    pub fn reached(&self, state: State) -> Option<f32> {
        let held = self
            .moments
            .iter()
            .rev()
            .take_while(|moment| moment.report.state == state);
        held.last().map(|moment| moment.time)
    }

    fn end(&self) -> impl Iterator<Item = &Moment> {
        let from = self.file.duration - END;
        self.moments.iter().filter(move |moment| moment.time > from)
    }

    /// Mean amplitude b at the end in m.
    #[must_use]
    pub fn amplitude(&self) -> f64 {
        let (sum, count) = self.end().fold((0.0, 0.0), |(sum, count), moment| {
            (sum + f64::from(moment.report.amplitude), count + 1.0)
        });
        sum / f64::max(count, 1.0)
    }

    /// k at the end: of the mean acceleration, so that it stands where the frequency moves, and infinite
    /// at rest.
    #[must_use]
    pub fn k(&self) -> f64 {
        let (sum, count) = self.end().fold((0.0, 0.0), |(sum, count), moment| {
            (sum + f64::from(moment.report.k).recip(), count + 1.0)
        });
        f64::max(count, 1.0) / sum
    }

    /// Mean conveying speed at the end in m/s, positive upwards (time mean).
    #[must_use]
    pub fn speed(&self) -> f64 {
        let mut end = self.end();
        let (Some(first), Some(last)) = (end.next(), self.moments.last()) else {
            return 0.0;
        };
        let time = f64::from(last.time - first.time);
        if time > 0.0 {
            (last.way - first.way) / time
        } else {
            0.0
        }
    }

    fn band_of_target(&self) -> Result<Band, BandError> {
        let settings = &self.file.scene.settings;
        let lot = Restitution::interval(
            f64::from(settings.restitution_low),
            f64::from(settings.restitution_high),
        );
        Band::common(lot?, self.order())
    }

    /// The band that the target's order (else order 1) has for the whole lot.
    #[must_use]
    pub fn band(&self) -> Option<Band> {
        self.band_of_target().ok()
    }

    /// The target at the end.
    #[must_use]
    pub fn target(&self) -> Target {
        self.controller.target()
    }

    /// The impacts of one part in the last `time` s.
    fn late(&self, part: u8, time: f32) -> Vec<Strike> {
        let from = self.file.duration - time;
        self.strikes
            .iter()
            .filter(|(time, strike)| *time > from && strike.part == part)
            .map(|(_, strike)| *strike)
            .collect()
    }

    /// What the parts really do at the end, in words.
    #[must_use]
    pub fn regime(&self) -> String {
        let parts = self.file.scene.part_count;
        let mut words: Vec<String> = (0..parts).map(|part| words(self.regime_of(part))).collect();
        words.sort();
        words.dedup();
        if words.is_empty() {
            return "no parts".into();
        }
        words.join(" / ")
    }

    /// What one part really does at the end, told from its impacts alone.
    fn regime_of(&self, part: u8) -> Regime {
        let Ok(mut classifier) = Classifier::<256>::build(JITTER) else {
            return Regime::Undecided;
        };
        for strike in self.late(part, HEARD) {
            let cycle = (strike.time >> 32) as u32;
            classifier.impact(cycle, Phase::from_bits(strike.time as u32));
        }
        classifier.cycle(self.moments.len() as u32);
        classifier.verdict().regime
    }

    /// Mean phase at which the parts strike where they are locked, in rad.
    #[must_use]
    pub fn lock_phase(&self) -> Option<f64> {
        if !self.regime().starts_with("locked") {
            return None;
        }
        let strikes = self.late(0, END);
        let (sine, cosine) = strikes.iter().fold((0.0, 0.0), |(s, c), strike| {
            (s + strike.phase.sin(), c + strike.phase.cos())
        });
        Some(f64::atan2(sine, cosine))
    }

    /// Phase at which the target's lock would strike for the middle of the lot, in rad.
    #[must_use]
    pub fn expected_phase(&self) -> Option<f64> {
        let settings = &self.file.scene.settings;
        let middle =
            0.5 * (f64::from(settings.restitution_low) + f64::from(settings.restitution_high));
        let lock = Lock::at(self.k(), middle, self.order()).ok()??;
        Some(lock.state().phase)
    }

    /// The trace: one row a cycle.
    #[must_use]
    pub fn trace(&self) -> Table {
        let mut table = Table::new(&[
            Column::new("time", "s"),
            Column::new("amplitude", "mm"),
            Column::new("k", ""),
            Column::new("reference", "mm"),
            Column::new("output", "of full"),
            Column::new("lead", "rad"),
            Column::new("state", ""),
            Column::new("fault", ""),
            Column::new("limits", ""),
            Column::new("impacts_heard", "per cycle"),
            Column::new("phase_heard", "rad"),
            Column::new("confidence", ""),
            Column::new("impacts", ""),
            Column::new("way", "mm"),
            Column::new("events", ""),
        ]);
        for moment in &self.moments {
            let report = &moment.report;
            let events: Vec<&str> = report.events.iter().map(Event::name).collect();
            table.push([
                single(moment.time),
                single(report.amplitude * 1e3),
                if report.k.is_finite() {
                    single(report.k)
                } else {
                    Value::Missing
                },
                single(report.reference * 1e3),
                single(report.command.amplitude),
                single(report.lead),
                report.state.name().into(),
                report
                    .fault
                    .map_or(Value::Missing, |fault| fault.name().into()),
                u32::from(report.limits.bits()).into(),
                single(report.rate),
                single(report.phase),
                single(report.confidence),
                moment.strikes.into(),
                (moment.way * 1e3).into(),
                events.join("; ").into(),
            ]);
        }
        table
    }

    /// Kicks that the controller may try.
    #[must_use]
    pub fn attempts_allowed(&self) -> u32 {
        self.file.scene.settings.capture_attempts as u32
    }

    /// Why the lot has no band of the target's order, and which bounds would have one.
    #[must_use]
    pub fn no_band(&self) -> Option<String> {
        Some(match self.band_of_target() {
            Ok(_) => return None,
            Err(none) => none.to_string(),
        })
    }

    /// Order of the lock that was wanted at the end; 1 where none was.
    fn order(&self) -> u32 {
        self.controller.order().map_or(1, u32::from)
    }

    /// Why the target has no setpoint, if it has none, in the controller's words.
    #[must_use]
    pub fn no_setpoint(&self) -> Option<String> {
        let held = self.last().limits.contains(Limits::NO_SETPOINT);
        // That a lot has no chaos of its own is only known once it was searched for.
        let why = self.controller.no_setpoint().unwrap_or(NoSetpoint::Chaos);
        held.then(|| why.to_string())
    }

    /// Names of the limits that hold the drive back at the end.
    #[must_use]
    pub fn limits(&self) -> Vec<&'static str> {
        let held = self.last().limits;
        Limits::ALL
            .into_iter()
            .filter(|limit| held.contains(*limit))
            .map(Limits::name)
            .collect()
    }
}

/// The target at the end of a scene.
fn last_target(file: &SceneFile) -> Target {
    let changes = file.scene.disturbances.iter().flatten().rev();
    changes
        .filter_map(|disturbance| match disturbance.change {
            Change::Target(target) => Some(target),
            _ => None,
        })
        .next()
        .unwrap_or(file.scene.target)
}

/// Drive cycles of a scene.
fn cycles(file: &SceneFile) -> usize {
    f64::from(file.duration * file.scene.settings.frequency).ceil() as usize
}

/// A number of single precision with the digits it has, not those of its nearest double.
fn single(value: f32) -> Value {
    Value::Number(value.to_string().parse().unwrap_or(f64::from(value)))
}

/// A regime in words.
#[must_use]
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
